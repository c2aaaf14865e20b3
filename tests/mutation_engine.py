"""What runs the mutants of mutation.py: which tests reach a statement, and those tests on code changed in memory."""

import ast
import fcntl
import gc
import hashlib
import json
import os
import resource
import signal
import struct
import sys
import time
import traceback
import types
from collections import Counter, defaultdict

import pytest
from _pytest.runner import runtestprotocol

LONGEST = 5.0  # seconds of computing of a test that is run
ENOUGH = 8.0  # of all tests together that one mutant meets
F_SETPIPE_SZ = 1031  # of fcntl, for Pythons that do not name it


class TooLong(BaseException):
    pass


# ---------------------------------------------------------------------- statements, and what reaches them


def places(tree):
    """{node: the statement or lambda in a function that it is part of}; nodes outside functions are not in it."""
    found = {}

    def visit(node, place, inside):
        if isinstance(node, ast.stmt):
            place = node if inside else None
        elif isinstance(node, ast.Lambda):
            place = node
        if place is not None:
            found[node] = place
        deeper = isinstance(node, (ast.FunctionDef, ast.Lambda)) or (inside and not isinstance(node, ast.ClassDef))
        for field, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    visit(child, place, deeper and (field == "body" or inside))

    visit(tree, None, False)
    return found


def key(node):
    return f"{node.lineno}:{node.col_offset}"


def marked(tree, number, module):
    """The tree, each statement of a function preceded by one that writes down that it was reached; changed in place."""
    known = places(tree)
    wanted = {place: number.setdefault(f"{module}:{key(place)}", len(number)) for place in known.values()}

    def code(template, place):
        made = ast.parse(template.format(wanted[place])).body[0]
        for node in ast.walk(made):
            ast.copy_location(node, place)
        return made

    for node in list(ast.walk(tree)):
        if isinstance(node, ast.Lambda) and node in wanted:
            node.body = ast.BoolOp(ast.Or(), [code("__reached__.__setitem__({}, 1)", node).value, node.body])
        for field in ("body", "orelse", "finalbody"):
            block = getattr(node, field, None)
            if isinstance(block, list) and any(statement in wanted for statement in block):
                new = []
                for i, statement in enumerate(block):
                    doc = i == 0 and isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
                    if statement in wanted and not doc:
                        new.append(code("__reached__[{}] = 1", statement))
                    new.append(statement)
                setattr(node, field, new)
    return ast.fix_missing_locations(tree)


def chosen(tests, first=()):
    """Of {test: seconds} those that one mutant meets: of each function's cases the quickest first, then the next ..."""
    turn, ranks = Counter(), []
    for test in sorted(tests, key=tests.get):
        name = test.partition("[")[0]
        ranks.append((test not in first, turn[name], tests[test], test))
        turn[name] += 1
    found, total = [], 0.0
    for _, _, seconds, test in sorted(ranks):
        if total + seconds <= ENOUGH or not found:
            found.append(test)
            total += seconds
    return found


# ---------------------------------------------------------------------- changes in memory


def alive(folder):
    """{file: functions that exist now whose code is from it}"""
    found = defaultdict(list)
    for thing in gc.get_objects():
        if type(thing) is types.FunctionType and thing.__code__.co_filename.startswith(folder):
            found[thing.__code__.co_filename].append(thing)
    return found


def twins(old, new):
    """Pairs of the codes of the same function, before and after a change."""
    yield old, new
    inner = defaultdict(list)
    for code in new.co_consts:
        if isinstance(code, types.CodeType):
            inner[code.co_qualname, code.co_firstlineno].append(code)
    for code in old.co_consts:
        if isinstance(code, types.CodeType) and inner[code.co_qualname, code.co_firstlineno]:
            yield from twins(code, inner[code.co_qualname, code.co_firstlineno].pop(0))


def compiled(tree, file):
    return compile(tree, file, "exec", dont_inherit=True)


def changes(old, new, functions):
    """[(function, its new code)]"""
    table = {before: after for before, after in twins(old, new) if before != after}
    return [(function, table[function.__code__]) for function in functions if function.__code__ in table]


# ---------------------------------------------------------------------- processes


def tickets(n):
    """A pipe that hands out 0, 1, ..., n - 1 to whoever reads next."""
    read, write = os.pipe()
    fcntl.fcntl(write, F_SETPIPE_SZ, max(4096, 4 * n))
    os.write(write, struct.pack(f"{n}i", *range(n)))
    os.close(write)
    return read


def numbers(read):
    while ticket := os.read(read, 4):
        yield struct.unpack("i", ticket)[0]


def together(n, work):
    """work() in n forks; SystemExit where one fails."""
    children = []
    for _ in range(n):
        child = os.fork()
        if child == 0:
            status = 1
            try:
                work()
                status = 0
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(status)
        children.append(child)
    if any(statuses := [os.waitpid(child, 0)[1] for child in children]):
        sys.exit(f"a process of mutation.py failed: {statuses}")


def quiet():
    """A process group of its own, whose output is thrown away."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which a run in the background ignores
    nowhere = os.open(os.environ.get("MUTATION_LOG", os.devnull), os.O_RDWR | os.O_CREAT | os.O_APPEND)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))


def waited(child, patience):
    """(exit status, seconds computed) of a child; "slow" where its time was up."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        pid, status, used = os.wait4(child, os.WNOHANG)
        if pid:
            code = os.waitstatus_to_exitcode(status)
            slow = code in (-signal.SIGXCPU, -signal.SIGKILL)
            return "slow" if slow else code, used.ru_utime + used.ru_stime
        time.sleep(0.003)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "slow", patience


def passes(item, following=None):
    """Whether a test passes, and was not skipped."""
    reports = runtestprotocol(item, nextitem=following, log=False)
    return all(report.passed for report in reports)


def computing():
    return sum(os.times()[:4])


# ---------------------------------------------------------------------- the session


class Engine:
    """Takes the place of pytest's loop over tests. mutants(module) gives (name, line, digest, place, code or None)."""

    def __init__(self, folder, home, modules, processes, job):
        self.folder, self.home, self.modules, self.processes, self.job = folder, home, modules, processes, job
        self.ran = set()  # what ran while modules were imported and tests collected

    def watch(self, frame, event, argument):
        if event == "call" and frame.f_code.co_filename.startswith(self.folder):
            self.ran.add(frame.f_code)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session):
        sys.setprofile(None)
        gc.collect()
        self.functions = alive(self.folder)
        gc.freeze()  # which also hides everything from gc.get_objects
        self.items = {item.nodeid: item for item in session.items}
        self.measure(session.items)
        self.job(self)
        return True

    def measure(self, items):
        """Which tests reach which statements: self.reach {"module:line:column": {test: seconds}}."""
        self.reach_of = self.home / "reach"
        self.reach_of.mkdir(exist_ok=True)
        package = b"".join(file.read_bytes() for file in self.modules.values())
        by_file = defaultdict(list)
        for item in items:
            by_file[item.path].append(item)
        self.marks = {path.stem: hashlib.sha256(package + path.read_bytes()).hexdigest()[:12] for path in by_file}
        todo = [path for path in by_file if self.known(path.stem) is None]
        todo.sort(key=lambda path: -len(by_file[path]))
        queue = tickets(len(todo))

        def work():
            quiet()
            number = {}
            for module, file in self.modules.items():
                text = file.read_text()
                tree = marked(ast.parse(text), number, module)
                for function, code in changes(
                    compiled(ast.parse(text), str(file)), compiled(tree, str(file)), self.functions[str(file)]
                ):
                    function.__code__ = code
            names, reached = list(number), bytearray(len(number))
            for name, module in list(sys.modules.items()):
                if name.startswith("rlcore"):
                    module.__reached__ = reached
            signal.signal(signal.SIGVTALRM, too_long)
            signal.signal(signal.SIGALRM, too_long)
            for i in numbers(queue):
                print(todo[i].stem, flush=True)
                self.note(todo[i].stem, by_file[todo[i]], names, reached)

        together(self.processes, work)
        self.reach, self.seconds = defaultdict(dict), {}
        for path in by_file:
            for test, (seconds, reached) in self.known(path.stem).items():
                if test in self.items:
                    self.seconds[test] = seconds
                    for place in reached:
                        self.reach[place][test] = seconds

    def known(self, stem):
        file = self.reach_of / f"{stem}.json"
        found = json.loads(file.read_text()) if file.exists() else {}
        return found["tests"] if found.get("mark") == self.marks[stem] else None

    def note(self, stem, items, names, reached):
        found = {}
        for item in items:
            reached[:] = bytes(len(reached))
            start = computing()
            try:
                allow(LONGEST)
                good = passes(item)
                allow(0)
            except TooLong:  # perhaps when the test was over
                good = False
                allow(0)
            seconds = computing() - start
            if good and seconds <= LONGEST:
                found[item.nodeid] = (round(seconds, 3), [names[i] for i, hit in enumerate(reached) if hit])
        file = self.reach_of / f"{stem}.json"
        part = file.with_suffix(f".{os.getpid()}")
        part.write_text(json.dumps(dict(mark=self.marks[stem], tests=found)))
        part.replace(file)

    def mark(self, tests):
        """Digest of the files of tests."""
        files = sorted({test.partition("::")[0] for test in tests})
        return hashlib.sha256("".join(self.marks[file[6:-3]] for file in files).encode()).hexdigest()[:12]

    def run(self, patches, tests):
        """(exit status, seconds, the test that failed) of tests in a fork, the codes of functions changed there."""
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            status = 3
            try:
                quiet()
                for function, code in patches:
                    function.__code__ = code
                items = [self.items[test] for test in tests]
                for i, item in enumerate(items):
                    allowed = int(computing() + 4 + 5 * self.seconds[item.nodeid])
                    resource.setrlimit(resource.RLIMIT_CPU, (allowed, resource.getrlimit(resource.RLIMIT_CPU)[1]))
                    os.write(write, struct.pack("i", i))
                    if not passes(item, (items[i + 1 :] or [None])[0]):
                        status = 1
                        break
                else:
                    status = 0
            finally:
                os._exit(status)
        os.close(write)
        status, seconds = waited(child, 60 + 10 * sum(self.seconds[test] for test in tests))
        last = os.read(read, 4 * len(tests) or 4)[-4:]
        os.close(read)
        return status, seconds, tests[struct.unpack("i", last)[0]] if last else None


def allow(seconds):
    """Raise TooLong after so many seconds of computing, or four times as many of waiting; 0: never."""
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    signal.setitimer(signal.ITIMER_REAL, 4 * seconds)  # a test may wait for another process


def too_long(*_):
    raise TooLong


def session(folder, home, modules, processes, job, left_out):
    """A pytest session of the tests in `folder`, which hands itself to job(engine) once all tests are collected."""
    engine = Engine(str(folder / "rlcore"), home, modules, processes, job)
    sys.path.insert(0, str(folder))
    os.chdir(folder)
    files = [f"tests/{path.name}" for path in sorted(folder.glob("tests/test_*.py")) if path.stem not in left_out]
    options = ["-q", "-s", "--assert=plain", "--no-header", "--tb=no", "-m", "not (pages or built)"]
    sys.setprofile(engine.watch)
    status = pytest.main([*options, *files], plugins=[engine])
    sys.setprofile(None)
    return int(status)
