"""Break the code on purpose, once or more for each row of the ledger: the check that the row names must notice.

    python tests/rows.py [row or chapter ...]  trace and break these rows; all where none is named
    python tests/rows.py --trace [...]         only see that each name under `code` is executed by a check of its row
    python tests/rows.py --breaks [...]        only the breaks
    python tests/rows.py --report [...]        what is known from earlier runs, without running anything
    python tests/rows.py --again [...]         forget earlier results of these rows
    python tests/rows.py --search [...]        try changes for names that have no break yet, add what is noticed
    python tests/rows.py --sample              a few quick breaks, in seconds
    python tests/rows.py --alone               one process instead of two

A break is a line of tests/breaks.yml: the row, a file, what stands there once, and what a person might have written
instead. It is made in a scratch copy. A check that is a cell of a notebook runs with the statements that it depends
on, their own asserts left out, in the notebook's folder; a check that is a test runs by itself. The break is noticed
where an assert fails or something is raised; where only what is printed changes, that is said. Results are kept in
_build/rows, so that a run can be stopped and resumed: a row is run again where its break, its checks or the broken
file are new.
"""

import ast
import builtins
import contextlib
import functools
import hashlib
import importlib
import inspect
import io
import json
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
from fnmatch import fnmatch
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
SCRATCH = ROOT / "_build" / "rows"
BREAKS = ROOT / "tests" / "breaks.yml"
LIMIT = 240  # seconds on the clock for the checks of one row
ROWS = {row["id"]: row for row in yaml.safe_load((ROOT / "book" / "concordance.yml").read_text(encoding="utf-8"))}


def breaks():
    """[{row, file, old, new}] as they stand in the file."""
    return yaml.safe_load(BREAKS.read_text(encoding="utf-8")) if BREAKS.exists() else []


# ---------------------------------------------------------------------- cells and what they depend on


TRAINING = {"sgd"}  # functions that change their first argument


@functools.cache
def statements(path):
    """[(number of the cell, its tags, source, node)] of a notebook, top-level statements in order."""
    found = []
    for number, cell in enumerate(json.loads((ROOT / path).read_text(encoding="utf-8"))["cells"]):
        if cell["cell_type"] == "code":
            text = "".join(cell["source"])
            for node in ast.parse(text).body:
                found.append((number, cell["metadata"].get("tags", []), ast.get_source_segment(text, node), node))
    return found


def bound(node):
    """Names that a statement binds, and names whose object it may change."""
    binds, changes = set(), set()
    for n in ast.walk(node):
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store):
            binds.add(n.id)
        elif isinstance(n, (ast.FunctionDef, ast.ClassDef)):
            binds.add(n.name)
        elif isinstance(n, ast.alias):
            binds.add((n.asname or n.name).split(".")[0])
        elif isinstance(n, (ast.Subscript, ast.Attribute)) and isinstance(n.ctx, ast.Store):
            changes |= base(n)
        elif isinstance(n, ast.AugAssign):
            changes |= base(n.target)
        elif isinstance(n, ast.Expr) and isinstance(n.value, ast.Call):
            changes |= base(n.value.func)
        elif isinstance(n, ast.Call) and base(n) & TRAINING:
            changes |= base(n.args[0])
        elif isinstance(n, ast.Name) and re.search(r"^rngs?$|_rng$", n.id):
            changes.add(n.id)
    return binds, changes


def base(node):
    while isinstance(node, (ast.Subscript, ast.Attribute, ast.Call)):
        node = node.func if isinstance(node, ast.Call) else node.value
    return {node.id} if isinstance(node, ast.Name) else set()


def needs(node):
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and not hasattr(builtins, n.id)}


@functools.cache
def sliced(path, tag):
    """[(number in statements(path), whether it belongs to the check)]: the check and what it depends on."""
    rows = statements(path)
    mine = [i for i, (_, tags, _, _) in enumerate(rows) if tag in tags]
    wanted, chosen = set(), set(mine)
    for i in range(max(mine), -1, -1):
        node = rows[i][3]
        binds, changes = bound(node)
        if i in chosen or (binds | changes) & wanted or isinstance(node, (ast.Import, ast.ImportFrom)):
            chosen.add(i)
            if isinstance(node, ast.Assign) and not (binds & changes):
                wanted -= binds
            wanted |= needs(node)
    return [(i, i in mine) for i in sorted(chosen)]


class Quiet(ast.NodeTransformer):
    """Without asserts: a check must notice by itself, not by those that it builds on."""

    def visit_Assert(self, node):
        return ast.copy_location(ast.Pass(), node)


def stored(path, tag):
    """What the check printed when the notebook was last run."""
    cells = json.loads((ROOT / path).read_text(encoding="utf-8"))["cells"]
    outputs = [o for cell in cells if tag in cell["metadata"].get("tags", []) for o in cell.get("outputs", [])]
    return "".join("".join(o["text"]) for o in outputs if o.get("name") == "stdout")


def source_of(check):
    """The text that a check consists of, to see whether it is new."""
    if "::" in check:
        return (ROOT / check.split("::")[0]).read_text(encoding="utf-8")
    path, tag = check.split("#")
    return "\n".join(statements(path)[i][2] for i, _ in sliced(path, tag))


# ---------------------------------------------------------------------- running a check, in a child


def run_cell(folder, check):
    """'', or how the cell notices: 'assert: ...', 'raises: ...', 'prints: ...'."""
    path, tag = check.split("#")
    os.chdir((folder / path).parent)
    names, out, rows = {"__name__": "__main__"}, io.StringIO(), statements(path)
    sys.setrecursionlimit(3000)
    for i, own in sliced(path, tag):
        node = rows[i][3] if own else Quiet().visit(ast.parse(rows[i][2]).body[0])
        module = ast.fix_missing_locations(ast.Module([node], []))
        try:
            with contextlib.redirect_stdout(out if own else io.StringIO()):
                exec(compile(module, f"{path} cell {rows[i][0]}", "exec"), names)
        except AssertionError:
            return f"assert: {rows[i][2].splitlines()[0][:100]}"
        except Exception as error:
            return f"raises: {type(error).__name__}: {str(error)[:100]}"
        finally:
            if "matplotlib.pyplot" in sys.modules:
                sys.modules["matplotlib.pyplot"].close("all")
    return "" if out.getvalue() == stored(path, tag) else "prints: something else"


def run_test(folder, check, row):
    """'', or 'assert: ...' where the test fails; of a test with the row's id as a parameter, only that one."""
    import pytest

    os.chdir(folder)
    log = io.StringIO()
    with contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
        for name in (f"{check}[{row}]", check):
            options = ["-x", "-q", "--no-header", "--tb=line", "-p", "no:cacheprovider"]
            status = int(pytest.main([*options, name]))
            if status != 4:
                break
    if status == 1:
        return f"assert: {check.split('::')[1]}"
    return "" if status == 0 else f"raises: pytest ends with {status}: {log.getvalue()[-200:]}"


def run_check(folder, check, row):
    return run_test(folder, check, row) if "::" in check else run_cell(folder, check)


def set_up(folder, changed=()):
    """In the child: the copy is what gets imported; machine code is kept where nothing in it is changed."""
    os.environ["NUMBA_CACHE_DIR"] = str(SCRATCH / "compiled")
    sys.path[:0] = [str(folder), str(folder / "tests")]
    importlib.invalidate_caches()
    compiled = importlib.import_module("rlcore.core.compiled")
    assert str(folder) in compiled.__file__
    text, calls = machine_code()

    def dispatcher(function, inner):
        import numba

        found = numba.njit(function, no_cpython_wrapper=inner)
        if not {*changed} & reached(function.__name__, calls):
            found.enable_caching()
            found._cache._cache_file._source_stamp = text
        return found

    compiled._dispatcher = dispatcher
    return compiled


COMPILED = ("compiled", "part", "learner", "inlined")


def machine_functions(tree):
    """Definitions that numba compiles."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and any(
            ast.unparse(d).partition("(")[0] in COMPILED for d in node.decorator_list
        ):
            yield node


@functools.cache
def machine_code():
    """(digest of all that is compiled, {name of a function: names in it})"""
    texts, calls = [], {}
    for path in sorted((ROOT / "rlcore").rglob("*.py")):
        for node in machine_functions(ast.parse(path.read_text(encoding="utf-8"))):
            texts.append(ast.unparse(node))
            calls.setdefault(node.name, set()).update(n.id for n in ast.walk(node) if isinstance(n, ast.Name))
    return hashlib.sha256("".join(texts).encode()).hexdigest(), calls


def reached(name, calls):
    """Names of all compiled functions that one calls, by name, itself included."""
    found, ahead = set(), {name}
    while ahead:
        found |= ahead
        ahead = {n for one in ahead for n in calls.get(one, ()) if n in calls} - found
    return found


def compiled_at(file, old):
    """Names of the compiled functions that a change of these lines may alter."""
    if not file.startswith("rlcore/"):
        return []
    text = (ROOT / file).read_text(encoding="utf-8")
    tree = ast.parse(text)
    line = text[: text.index(old)].count("\n") + 1
    last = line + old.rstrip("\n").count("\n")
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.lineno <= line and last <= node.end_lineno:
            return [n.name for n in machine_functions(tree) if n is node]
    return [node.name for node in machine_functions(tree)]  # a constant of the module


class Tracer:
    """Which of the places {name: (file, first line, last line)} run; compiled ones by the call that starts them."""

    def __init__(self, folder, compiled, places, hasty):
        self.hasty, self.left, self.runs, self.met, self.root = hasty, places, [], set(), str(folder / "rlcore")
        meet, call = self.meet, compiled._Lazy.__call__

        def noted(lazy, *args):
            meet(lazy.__wrapped__.__code__)
            return call(lazy, *args)

        compiled._Lazy.__call__ = noted

    def meet(self, code):
        if code not in self.met:
            self.met.add(code)
            for name, (file, first, last) in list(self.left.items()):
                if code.co_filename == file and first <= code.co_firstlineno <= last:
                    self.runs.append(name)
                    del self.left[name]

    def __call__(self, frame, event, arg):
        code = frame.f_code
        if not self.left:
            sys.setprofile(None)
            if self.hasty:
                self.hasty(self.runs)
        elif event == "call" and code.co_filename.startswith(self.root):
            self.meet(code)
            if code.co_name == "call" and code.co_filename.endswith("learner.py"):
                self.meet(inspect.unwrap(frame.f_locals["loop"]).__code__)


def span(name):
    """(file, first line, last line) of a dotted name's source, decorators included; in the child."""
    return span_of(resolved(name))


def span_of(thing):
    if not isinstance(thing, type):
        thing = inspect.unwrap(thing)
    file = inspect.getsourcefile(thing)
    if isinstance(thing, type):
        lines, first = inspect.getsourcelines(thing)
    else:
        first = thing.__code__.co_firstlineno
        lines = inspect.getblock(Path(file).read_text(encoding="utf-8").splitlines(True)[first - 1 :])
    return file, first, first + len(lines) - 1


def resolved(name):
    parts = name.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        with contextlib.suppress(ModuleNotFoundError):
            thing = importlib.import_module(".".join(parts[:cut]))
            break
    for part in parts[cut:]:
        thing = inspect.getattr_static(thing, part) if isinstance(thing, type) else getattr(thing, part)
    thing = getattr(thing, "__func__", getattr(thing, "fget", None) or getattr(thing, "func", None) or thing)
    return thing if isinstance(thing, type) else inspect.unwrap(thing)


def trace(folder, check, hasty):
    """Names of the ledger that a check executes, and how it fails, if it does, without any change; in the child.

    hasty: end the child where all names have been seen, whatever the check would say.
    """

    def enough(runs):
        os.write(RESULTS[0], (json.dumps({"check": check, "runs": runs, "how": "", "whole": False}) + "\n").encode())
        os._exit(0)

    compiled = set_up(folder)
    names = sorted({name for row in ROWS.values() if check in row["check"] for name in row["code"]})
    tracer = Tracer(folder, compiled, {name: span(name) for name in names}, hasty and enough)
    ids = [row["id"] for row in ROWS.values() if check in row["check"]]
    sys.setprofile(tracer)
    how = run_check(folder, check, ids[0] if len(ids) == 1 else "")
    sys.setprofile(None)
    return {"check": check, "runs": tracer.runs, "how": how, "whole": True}


def tried(folder, changed, rows):
    """How each of the rows notices what was changed; in the child, one line of results a row."""
    set_up(folder, changed)
    found = {}
    for row in rows:
        start, how = time.time(), ""
        for check in sorted(ROWS[row]["check"], key=lambda c: ("::" not in c, "figures" not in c)):  # quick ones first
            key = check if "::" not in check else (check, row)
            found[key] = found[key] if key in found else run_check(folder, check, row)
            how = found[key] if not how or not found[key].startswith("prints") and found[key] else how
            if how.startswith(("assert", "raises")):
                break
        yield {"row": row, "how": how, "seconds": round(time.time() - start, 1)}


# ---------------------------------------------------------------------- children


RESULTS = []  # where a child writes to


def child(work, limit):
    """Lines that work() yields as JSON in a forked child; one {'how': 'slow'} at the end where the time is up."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.setsid()
        os.close(read)
        RESULTS[:] = [write]
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        resource.setrlimit(resource.RLIMIT_AS, (12 << 30, 12 << 30))
        try:
            for line in work():
                os.write(write, (json.dumps(line) + "\n").encode())
        except BaseException:
            os.write(write, (json.dumps({"how": f"crashes: {traceback.format_exc()[-600:]}"}) + "\n").encode())
        finally:
            os._exit(0)
    os.close(write)
    rest, end = b"", time.time() + limit
    try:
        while True:
            ready, _, _ = select.select([read], [], [], max(0.0, end - time.time()))
            if not ready:
                yield {"how": "slow"}
                return
            piece = os.read(read, 65536)
            if not piece:
                return
            rest += piece
            *lines, rest = rest.split(b"\n")
            for line in lines:
                end = time.time() + limit
                yield json.loads(line)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        os.close(read)


def copy(folder):
    """A scratch copy of the package, the tests and the book."""
    shutil.rmtree(folder, ignore_errors=True)
    ignored = shutil.ignore_patterns("__pycache__", "_build", ".ipynb_checkpoints")
    for name in ("rlcore", "tests", "book"):
        shutil.copytree(ROOT / name, folder / name, ignore=ignored, copy_function=shutil.copyfile)
    shutil.copy(ROOT / "pyproject.toml", folder)
    if (ROOT / "benchmarks").exists():
        (folder / "benchmarks").symlink_to(ROOT / "benchmarks")
    return folder


@contextlib.contextmanager
def broken(folder, file, old, new):
    """The copy with one change in it."""
    text = (ROOT / file).read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{file}: {old!r} is there {text.count(old)} times"
    try:
        (folder / file).write_text(text.replace(old, new), encoding="utf-8")
        yield
    finally:
        (folder / file).write_text(text, encoding="utf-8")


def preload():
    """Import what is slow and not under test, once, before the forks."""
    os.environ |= dict(
        MPLBACKEND="agg",
        RLCORE_QUICK_PROPERTIES="1",
        PYTHONDONTWRITEBYTECODE="1",
        OMP_NUM_THREADS="1",
        OPENBLAS_NUM_THREADS="1",
        NUMBA_NUM_THREADS="1",
        PYTEST_DISABLE_PLUGIN_AUTOLOAD="1",
    )
    sys.dont_write_bytecode = True
    for name in (
        *("gymnasium", "matplotlib.pyplot", "numba", "pytest", "scipy.sparse.csgraph", "scipy.sparse.linalg"),
        *("scipy.stats", "hypothesis.strategies", "IPython.display", "ipywidgets", "matplotlib.animation"),
    ):
        with contextlib.suppress(ModuleNotFoundError):
            importlib.import_module(name)
    assert "rlcore" not in sys.modules


# ---------------------------------------------------------------------- the whole run


def digest(row, change):
    """Of all that the result of a break depends on but the rest of the package."""
    texts = [source_of(check) for check in ROWS[row]["check"]] + ROWS[row]["check"]
    texts += [change["old"], change["new"], (ROOT / change["file"]).read_text(encoding="utf-8")]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]


def mark_of(check):
    """Of a check and the names that its rows say it runs."""
    names = [name for row in ROWS.values() if check in row["check"] for name in row["code"]]
    return hashlib.sha256("\n".join([check, source_of(check), *names]).encode()).hexdigest()[:16]


def known():
    """{digest: result}"""
    path = SCRATCH / "results.jsonl"
    lines = path.read_text().splitlines() if path.exists() else []
    return {line["digest"]: line for line in map(json.loads, lines)}


def note(result):
    SCRATCH.mkdir(parents=True, exist_ok=True)
    with open(SCRATCH / "results.jsonl", "a") as out:
        out.write(json.dumps(result) + "\n")


def checks_of(chosen):
    return list(dict.fromkeys(check for row in chosen for check in ROWS[row]["check"]))


def work(worker, workers, chosen, only):
    """One of the processes: every workers-th check and break."""
    folder, done = copy(SCRATCH / f"copy{worker}"), known()
    for check in [] if only == "breaks" else checks_of(chosen)[worker::workers]:
        before = done.get(mark_of(check))
        if not before or not (only == "trace" or before.get("whole")):
            for line in child(lambda check=check: [trace(folder, check, only == "trace")], LIMIT):
                note({**line, "digest": mark_of(check), "check": check})
    if only == "trace":
        return
    mine = [change for change in breaks() if change["row"] in chosen]
    for change in mine[worker::workers]:
        row, mark = change["row"], digest(change["row"], change)
        if mark in done:
            continue
        for line in outcome(folder, change):
            note({**line, "digest": mark, "row": row})


def outcome(folder, change):
    """[how the row of a break notices it]"""
    file, old = change["file"], change["old"]
    changed = compiled_at(file, old)
    with broken(folder, file, old, change["new"]):
        return list(child(lambda: tried(folder, changed, [change["row"]]), LIMIT))


QUICK = (
    "rlcore/plots/ch0[1-4].py",
    "rlcore/bellman.py",
    "rlcore/mdp.py",
    "rlcore/studies/ch0[24].py",
    "rlcore/envs/*.py",
)


def sample(size=6):
    """Exit status 1 unless all of a few quick breaks are noticed, chosen by the digest of their rows' names."""
    some = [change for change in breaks() if any(fnmatch(change["file"], pattern) for pattern in QUICK)]
    some = [change for change in some if all("::" in check for check in ROWS[change["row"]]["check"][-1:])]
    some = sorted(some, key=lambda change: hashlib.sha256(change["row"].encode()).hexdigest())[:size]
    with tempfile.TemporaryDirectory() as folder:
        folder = copy(Path(folder, "copy"))
        left = [change for change in some if not noticed(outcome(folder, change))]
    print(f"{len(some) - len(left)} of {len(some)} noticed", *left, sep="\n")
    return 1 if left else 0


def noticed(lines):
    return any(line["how"].startswith(("assert", "raises")) for line in lines)


def parallel(job, workers):
    """job(worker) in so many children; exit status of the worst."""
    children = []
    for worker in range(workers):
        pid = os.fork()
        if pid == 0:
            status = 1
            try:
                job(worker)
                status = 0
            except BaseException:
                traceback.print_exc()
            finally:
                sys.stdout.flush()
                os._exit(status)
        children.append(pid)
    return max(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in children)


def report(chosen, only=""):
    """Print a line a chapter and what is not as it should be; whether all is."""
    done, bad, table = known(), [], {}
    changes = {}
    for change in breaks():
        changes.setdefault(change["row"], []).append(change)
    for row in chosen:
        line = table.setdefault(ROWS[row]["chapter"], dict(rows=0, traced=0, broken=0, breaks=0, noticed=0))
        line["rows"] += 1
        results = [done.get(mark_of(check), {"how": "not run"}) for check in ROWS[row]["check"]]
        left = [name for name in ROWS[row]["code"] if not any(name in result.get("runs", ()) for result in results)]
        line["traced"] += not left
        if left and only != "breaks":
            bad.append(f"{row}: never runs {', '.join(left)}")
        for check, result in zip(ROWS[row]["check"], results):
            if result["how"]:
                bad.append(f"{row}: {check} without any change: {result['how']}")
        line["broken"] += row in changes
        for change in changes.get(row, []):
            how = done.get(digest(row, change), {}).get("how", "not run")
            line["breaks"] += 1
            line["noticed"] += how.startswith(("assert", "raises"))
            if not how.startswith(("assert", "raises")) and only != "trace":
                bad.append(
                    f"{row}: {change['old'].strip()[:60]!r} to {change['new'].strip()[:60]!r}: {how or 'unnoticed'}"
                )
    for chapter, line in table.items():
        print(
            f"chapter {chapter}: {line['rows']} rows, {line['traced']} run all that they name, {line['broken']} have a "
            f"break; {line['noticed']} of {line['breaks']} breaks noticed"
        )
    print(*bad, sep="\n")
    return not bad


def choose(wanted):
    if unknown := [w for w in wanted if w not in ROWS and w not in "12345678"]:
        sys.exit(f"no row {', '.join(unknown)}")
    return [r for r, row in ROWS.items() if not wanted or r in wanted or str(row["chapter"]) in wanted]


def main(arguments):
    chosen = choose([a for a in arguments if not a.startswith("-")])
    only = "trace" if "--trace" in arguments else "breaks" if "--breaks" in arguments else ""
    if "--again" in arguments:
        gone = {*chosen, *checks_of(chosen)}
        kept = [line for line in known().values() if line.get("row", line.get("check")) not in gone]
        (SCRATCH / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in kept))
    if "--report" not in arguments:
        SCRATCH.mkdir(parents=True, exist_ok=True)
        preload()
        if "--sample" in arguments:
            return sample()
        workers = 1 if "--alone" in arguments else 2
        if "--search" in arguments:
            import row_search

            return row_search.main(chosen, workers, "--pictures" in arguments)
        parallel(lambda worker: work(worker, workers, chosen, only), workers)
    return 0 if report(chosen, only) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
