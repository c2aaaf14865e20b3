"""Break the code on purpose, one place at a time: some test must fail.

    python tests/mutation.py [name ...]       modules of rlcore, or folders of them; all where none is named
    python tests/mutation.py --again          forget earlier results
    python tests/mutation.py --list           print the changes without running anything
    python tests/mutation.py --report         what is known from earlier runs
    python tests/mutation.py --sample         only the update lines named in SAMPLE, in a few seconds
    python tests/mutation.py --alone          one process instead of two

First every test runs once, interpreted, and it is noted which statements of rlcore it reaches. Then each change (a
mutant) is made in memory, in a fork of a process that has collected all tests, and those that reach its statement run,
the quick ones first, until one fails. What cannot be changed in memory (tables, and functions that run while modules
are imported) is written to a scratch copy, and imported from there.
A mutant is named by its function, its line and what is done to it, whatever module the function is in; "function in
module" where two modules have the same line in functions of one name.
Results are kept in _build/mutation/, one line a mutant, so that a run can be stopped and resumed: a mutant is run again
only where its function is new, or where it survived and the tests are new. Survivors are printed; those that cannot
change a result are listed with the reason in tests/mutation_allowed.txt. Exit status 1 where one is not listed there.
"""

import ast
import functools
import hashlib
import importlib
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from fnmatch import fnmatch
from pathlib import Path

import mutation_engine as engine

ROOT = Path(__file__).parents[1]
SCRATCH = ROOT / "_build" / "mutation"
ALLOWED = ROOT / "tests" / "mutation_allowed.txt"
LEFT_OUT = {
    "": "an index of names",
    "core.types": "names for annotations",
    "core.compiled": "how functions are compiled, not what they compute; its tests need numba and fresh interpreters",
    "envs": "gathers what its modules define",
    "exercises": "loads the chapters, no more",
    "exercises.__main__": "runs notebooks in kernels of their own, many seconds each time",
    "exercises.*_steps": "declarations; the tests of exercises put the answers in place of one another",
    "exercises.ch*": "declarations; the tests of exercises put the answers in place of one another",
    "plots": "finds the figures by name",
    "plots.*": "pictures are looked at; what they show is computed elsewhere",
}
NOT_HERE = {  # tests of files, of pages and of whole commands
    "test_chapters", "test_ledger", "test_live_cells", "test_mathematics", "test_mutation", "test_notebooks",
    "test_programs", "test_project", "test_reading", "test_release", "test_rows", "test_compiled",
}  # fmt: skip
HEAVY = ("torch", "sklearn.datasets", "matplotlib.pyplot")
SWAPS = {
    ast.Add: [ast.Sub], ast.Sub: [ast.Add], ast.Mult: [ast.Div], ast.Div: [ast.Mult], ast.FloorDiv: [ast.Mult],
    ast.Mod: [ast.FloorDiv], ast.Pow: [ast.Mult], ast.BitAnd: [ast.BitOr], ast.BitOr: [ast.BitAnd],
    ast.MatMult: [ast.Add], ast.Lt: [ast.LtE, ast.Gt], ast.LtE: [ast.Lt, ast.Gt], ast.Gt: [ast.GtE, ast.Lt],
    ast.GtE: [ast.Gt, ast.Lt], ast.Eq: [ast.NotEq], ast.NotEq: [ast.Eq], ast.Is: [ast.IsNot], ast.IsNot: [ast.Is],
    ast.In: [ast.NotIn], ast.NotIn: [ast.In], ast.And: [ast.Or], ast.Or: [ast.And],
}  # fmt: skip
NAMES = {
    "max": "min", "min": "max", "argmax": "argmin", "argmin": "argmax", "any": "all", "all": "any", "ones": "zeros",
    "zeros": "ones", "sum": "max", "cumsum": "cumprod", "sqrt": "square", "maximum": "minimum", "minimum": "maximum",
    "isfinite": "isnan", "flatnonzero": "atleast_1d", "abs": "asarray", "True": "False", "False": "True",
}  # fmt: skip

BACKUP = "(reward[s, a, k] + gamma * V[next_state[s, a, k]])"
SAMPLE = [  # (module, part of a line, what it is broken to, the test that must notice)
    ("dp", f"{BACKUP}  # eq-12", BACKUP.replace("gamma * ", ""), "test_dp::test_sweeps_are_backups"),
    ("dp", f"{BACKUP}  # eq-15", BACKUP.replace("+", "-"), "test_dp::test_sweeps_are_backups"),
    ("dp", "best = max(best, q)  # eq-16", "best = min(best, q)", "test_dp::test_sweeps_are_backups"),
    ("dp", "V_new if in_place else V, V_new)", "V, V_new)", "test_dp::test_sweeps_are_backups"),
    ("dp", "np.where(keep[:, None], pi, pi_new)", "pi_new", "test_dp::test_improvement_keeps_a_row_that_is_greedy"),
    ("bellman", "residual / (1 - gamma)", "residual", "test_dp::test_bound_is_tight_where_the_error_is_known"),
    ("bellman", "gamma * V[mdp.next_state]", "V[mdp.next_state]", "test_bellman::test_backups_are_the_sums"),
    ("bellman", "Q.max(axis=1), gamma)  # eq-17", "Q.min(axis=1), gamma)", "test_bellman::test_backups_are_the_sums"),
    ("core.chains", "eye_array(go.size) -", "eye_array(go.size) +", "test_bellman::test_sparse_and_dense_solution"),
    ("core.chains", "np.eye(go.size) -", "np.eye(go.size) +", "test_bellman::test_values_in_closed_form"),
    ("mdp", "rewards[t] + gamma * G[t + 1]", "rewards[t] + gamma * rewards[t]", "test_mdp::test_worked_return"),
    ("mdp", "gamma ** (k - t - 1)", "gamma ** (k - t)", "test_mdp::test_worked_return"),
    ("mdp", "discount *= gamma", "discount = gamma", "test_mdp::test_sampled_returns_of_a_certain_process"),
    ("core.sampling", "cdf[k] <= u:", "cdf[k] < u:", "test_mdp::test_draw_inverts_the_cumulative_probabilities"),
]  # fmt: skip


def mutants(tree):
    """(node, label, change) for each single change; change() alters the tree in place."""
    skip = {id(n) for top in ast.walk(tree) for n in _untouched(top)}
    for node in ast.walk(tree):
        if id(node) in skip:
            continue
        yield from _of_operators(node)
        yield from _of_values(node)
        yield from _of_statements(node)


def _untouched(node):
    """Messages, annotations, decorators, imports and docstrings: they change no result."""
    roots = []
    if isinstance(node, (ast.Raise, ast.Import, ast.ImportFrom, ast.JoinedStr)):
        roots = [node]
    elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        roots = [*node.decorator_list, *([node.returns] if getattr(node, "returns", None) else [])]
        if node.name in ("__repr__", "__hash__"):
            roots.append(node)
    elif isinstance(node, ast.AnnAssign) and getattr(node.annotation, "id", "") == "TypeAlias":
        roots = [node]
    elif isinstance(node, (ast.AnnAssign, ast.arg)):
        roots = [node.annotation] if node.annotation else []
    elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("__all__", "__hash__"):
        roots = [node]
    return [n for root in roots for n in ast.walk(root)]


def _set(node, field, value):
    return lambda: setattr(node, field, value)


def _of_operators(node):
    if isinstance(node, (ast.BinOp, ast.AugAssign, ast.BoolOp)):
        for new in SWAPS.get(type(node.op), []):
            yield node, f"{type(node.op).__name__} to {new.__name__}", _set(node, "op", new())
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            for new in SWAPS.get(type(op), []):
                ops = [*node.ops[:i], new(), *node.ops[i + 1 :]]
                yield node, f"{type(op).__name__} to {new.__name__} ({i})", _set(node, "ops", ops)
    if isinstance(node, (ast.If, ast.While, ast.IfExp)):
        yield node.test, "condition negated", _set(node, "test", ast.UnaryOp(ast.Not(), node.test))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Invert, ast.Not)):
        new = {ast.USub: ast.UAdd, ast.Invert: ast.UAdd, ast.Not: ast.UAdd}[type(node.op)]
        if not isinstance(node.op, ast.Invert):
            yield node, f"{type(node.op).__name__} dropped", _set(node, "op", new())
        else:
            yield node, "Invert to logical_not of itself", _replace_with_operand(node)


def _replace_with_operand(node):
    def change():
        node.op, node.operand = ast.UAdd(), ast.BinOp(node.operand, ast.BitOr(), node.operand)

    return change


def _of_values(node):
    if isinstance(node, ast.Constant) and not isinstance(node.value, (str, bytes)) and node.value is not None:
        if isinstance(node.value, bool):
            yield node, f"{node.value} to {not node.value}", _set(node, "value", not node.value)
        elif isinstance(node.value, int):
            for new in (node.value + 1, node.value - 1):
                yield node, f"{node.value} to {new}", _set(node, "value", new)
        elif isinstance(node.value, float):
            for new in {1.0 - node.value, node.value * 10 if node.value else 1.0} - {node.value}:
                yield node, f"{node.value} to {new}", _set(node, "value", new)
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in NAMES:
        yield node, f"{node.id} to {NAMES[node.id]}", _set(node, "id", NAMES[node.id])
    if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and node.attr in NAMES:
        yield node, f".{node.attr} to .{NAMES[node.attr]}", _set(node, "attr", NAMES[node.attr])
    if isinstance(node, ast.Call):
        for i in range(len(node.keywords)):
            if node.keywords[i].arg is not None:
                rest = [*node.keywords[:i], *node.keywords[i + 1 :]]
                yield node, f"without {node.keywords[i].arg}=", _set(node, "keywords", rest)
        if len(node.args) > 1:
            yield node, "without its last argument", _set(node, "args", node.args[:-1])
        if len(node.args) == 1 and not node.keywords and not isinstance(node.args[0], ast.GeneratorExp):
            yield node, "call replaced by its argument", _becomes_argument(node)


def _becomes_argument(node):
    def change():
        node.func, node.args = ast.Name("_same", ast.Load()), [node.args[0]]

    return change


def _of_statements(node):
    for field in ("body", "orelse"):
        block = getattr(node, field, None)
        if not isinstance(block, list) or isinstance(node, (ast.Module, ast.ClassDef)):
            continue
        for i, statement in enumerate(block):
            doc = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
            if not doc and isinstance(statement, (ast.Assign, ast.AugAssign, ast.Expr, ast.If, ast.For, ast.Continue)):
                dropped = [*block[:i], ast.Pass(), *block[i + 1 :]]
                yield statement, "statement dropped", _set(node, field, dropped)


def file_of(module, root=None):
    path = Path(root or ROOT, "rlcore", *module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def modules():
    """Every module of rlcore that has something to break, by its name without "rlcore."."""
    for path in sorted(ROOT.glob("rlcore/**/*.py")):
        if any(mutants(ast.parse(path.read_text()))):
            parts = path.relative_to(ROOT / "rlcore").with_suffix("").parts
            yield ".".join(part for part in parts if part != "__init__")


def left_out(module):
    """The reason for which a module has no tests to be broken for, or None."""
    return next((reason for pattern, reason in LEFT_OUT.items() if fnmatch(module, pattern)), None)


def lines(module):
    """Every mutant of a module as (line number, name): the function, the line, and what is done to it."""
    return [(number, names()[module, i]) for i, (number, _) in enumerate(_lines(module))]


@functools.cache
def names():
    """{(module, i): name} of all mutants."""
    found = {(module, i): name for module in broken() for i, (_, name) in enumerate(_lines(module))}
    count = Counter(found.values())
    for (module, i), name in found.items():
        if count[name] > 1:
            found[module, i] = name.replace(":", f" in {module}:", 1)
    return found


@functools.cache
def _lines(module):
    text = file_of(module).read_text()
    tree, rows, seen, found = ast.parse(text), text.splitlines(), Counter(), []
    around = _around(tree)
    for node, label, _ in mutants(tree):
        place = ".".join(n.name for n in around.get(node.lineno, ())) or "top level"
        name = f"{place}: {rows[node.lineno - 1].strip()} | {label}"
        seen[name] += 1
        found.append((node.lineno, name if seen[name] == 1 else f"{name} #{seen[name]}"))
    return found


def plan(module):
    """Every mutant of a module as (name, line number, digest of the function it is in, place, tree)."""
    text = file_of(module).read_text()
    for i, (number, name) in enumerate(lines(module)):
        yield mutant(module, text, i, number, name)


def mutant(module, text, i, number, name):
    tree = ast.parse(text)
    where = engine.places(tree)
    node, _, change = next(itertools.islice(mutants(tree), i, None))
    place = engine.key(where[node]) if node in where else None
    change()
    tree = ast.fix_missing_locations(tree)
    whole = _around(tree).get(number, [tree])[-1]
    digest = hashlib.sha256(ast.unparse(whole).encode()).hexdigest()[:12]
    return name, number, digest, place and f"{module}:{place}", tree


def _around(tree):
    """{line number: definitions that hold the line, from the outside in}"""
    around = {}
    for node in ast.walk(tree):  # by depth
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            for number in range(node.lineno, node.end_lineno + 1):
                around[number] = (*around.get(number, ()), node)
    return around


# ---------------------------------------------------------------------- running


def scratch(folder):
    """A copy of what the tests need; the package in it shadows the installed one."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("rlcore", "tests"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored, copy_function=shutil.copyfile)
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name in ("book", "benchmarks"):
        if (ROOT / name).exists():
            (folder / name).symlink_to(ROOT / name)
    return folder


def preload():
    """Import what is slow and not under test, once, before the forks."""
    for name in ("gymnasium", "hypothesis.strategies", "pytest", "scipy.sparse.csgraph", "scipy.sparse.linalg", *HEAVY):
        importlib.import_module(name)
    import gymnasium

    for name in ("FrozenLake-v1", "Taxi-v4", "CliffWalking-v1"):
        gymnasium.make(name)
    assert "rlcore" not in sys.modules


def keep(name, number, digest, status, mark, seconds, **more):
    """Append a result; several processes do."""
    row = dict(name=name, line=number, killed=status != 0, status=status, digest=digest, mark=mark)
    with open(SCRATCH / "results.jsonl", "a") as out:
        out.write(json.dumps(row | {"seconds": round(seconds, 1)} | more) + "\n")


def in_memory(chosen):
    """Job of the engine: every mutant whose statement a test reaches, in a fork with other code."""

    def job(session):
        todo, done, excused = [], results(), allowed()
        for module in chosen:
            for i, (number, name) in enumerate(lines(module)):
                todo.append((module, i, number, name))
        queue, texts = engine.tickets(len(todo)), {module: file_of(module).read_text() for module in chosen}

        def work():
            killers = {}
            before = {
                module: engine.compiled(ast.parse(texts[module]), str(session.modules[module])) for module in chosen
            }
            for ticket in engine.numbers(queue):
                module, i, number, name = todo[ticket]
                file = str(session.modules[module])
                _, _, digest, place, tree = mutant(module, texts[module], i, number, name)
                reached = session.reach.get(place, {})
                tests = engine.chosen(reached, killers.get(place, ()))
                mark = session.mark(tests)
                known = done.get(name, {})
                # a mutant once killed stays killed while its function is the same; a survivor meets every new test
                if known.get("digest") == digest and (known["killed"] or known["mark"] == mark or name in excused):
                    continue
                patches = engine.changes(before[module], engine.compiled(tree, file), session.functions[file])
                again = place is None or not tests or any(f.__code__ in session.ran for f, _ in patches)
                status, seconds, test = 0, 0.0, None
                if patches and tests and all(len(f.__code__.co_freevars) == len(c.co_freevars) for f, c in patches):
                    status, seconds, test = session.run(patches, tests)
                elif engine.compiled(tree, file) == before[module]:
                    status, again = "same", False
                else:
                    again = True
                if status != 0 and test:
                    killers.setdefault(place, set()).add(test)
                keep(name, number, digest, status, mark, seconds, again=bool(again and status == 0), test=test)

        engine.together(session.processes, work)

    return job


def run_tests(folder, tests, limit):
    """(exit status, seconds computed) of tests, imported anew in a forked child."""
    child = os.fork()
    if child == 0:
        status = 3
        try:
            engine.quiet()
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            os.chdir(folder)
            sys.path.insert(0, str(folder))
            import pytest

            assert str(folder) in importlib.util.find_spec("rlcore").origin
            status = int(pytest.main(["-x", "-q", "--assert=plain", "--no-header", *tests]))
        finally:
            os._exit(status)
    return engine.waited(child, 4 * limit)


def on_disk(worker, workers, chosen):
    """One of the processes: mutants that were not to be changed in memory, written to a copy that is imported anew."""
    folder, done = scratch(SCRATCH / f"copy{worker}"), results()
    reach = json.loads((SCRATCH / "reach.json").read_text())
    preload()
    for module in chosen:
        path = file_of(module, folder)
        original = path.read_text()
        todo = [row for row in plan(module) if done.get(row[0], {}).get("again")]
        for name, number, digest, place, tree in todo[worker::workers]:
            tests = engine.chosen(reach["places"].get(place) or reach["modules"].get(module, {}))
            path.write_text(ast.unparse(tree) + "\n\ndef _same(x):\n    return x\n")
            status, seconds = run_tests(folder, tests, 60) if tests else (0, 0.0)
            keep(name, number, digest, status, done[name]["mark"], seconds)
        path.write_text(original)


def sample(folder):
    """Exit status 1 unless every change of SAMPLE makes a test fail."""
    folder, alive = scratch(Path(folder, "copy")), []
    preload()
    for module, line, broken_to, test in SAMPLE:
        path = file_of(module, folder)
        original = path.read_text()
        if line not in original:
            sys.exit(f"{module}: {line!r} is no longer there")
        path.write_text(original.replace(line, broken_to))
        if run_tests(folder, [f"tests/{test.replace('::', '.py::')}"], 60)[0] != 1:
            alive.append(f"{module}: {line}")
        path.write_text(original)
    print(f"{len(SAMPLE) - len(alive)} of {len(SAMPLE)} noticed", *alive, sep="\n")
    return 1 if alive else 0


def results():
    """{name: last result}"""
    path = SCRATCH / "results.jsonl"
    rows = map(json.loads, path.read_text().splitlines() if path.exists() else [])
    return {row["name"]: row for row in rows}


def allowed():
    """{mutant: reason}; a line of the file is 'mutant  # reason'."""
    rows = ALLOWED.read_text().splitlines() if ALLOWED.exists() else []
    pairs = (row.rsplit("  # ", 1) for row in rows if row.strip() and not row.startswith("#"))
    return {name.strip(): reason for name, reason in pairs}


def stale():
    """Excuses for mutants that do not exist, or of which two modules have one."""
    return [name for name in allowed() if name not in names().values()]


def report(chosen):
    found, excused, left = results(), allowed(), []
    for module in chosen:
        mine = [name for _, name in lines(module)]
        rows = [found[name] for name in mine if name in found]
        alive = [row for row in rows if not row["killed"]]
        new = [row for row in alive if row["name"] not in excused]
        left += [(module, row) for row in new]
        slow = sum(row["status"] == "slow" for row in rows)
        print(
            f"{module}: {len(mine)} mutants, {len(rows)} run, {len(rows) - len(alive)} killed ({slow} by the "
            f"clock), {len(alive) - len(new)} equivalent, {len(new)} survived"
        )
    for module, row in left:
        print(f"  {module}, line {row['line']}  {row['name']}")
    for name in stale():
        print(f"  no longer there: {name}")
    return 1 if left or stale() else 0


@functools.cache
def broken():
    """The modules that are broken."""
    return [module for module in modules() if not left_out(module)]


def choose(wanted):
    """The modules that are named, or that are in a folder that is."""
    for name in wanted:
        if not any(m == name or m.startswith(name + ".") for m in broken()):
            sys.exit(f"{name}: {left_out(name) or 'is no module of rlcore'}")
    return [m for m in broken() if not wanted or any(m == name or m.startswith(name + ".") for name in wanted)]


def first(chosen, processes):
    """In memory. Leaves which tests reach what in reach.json."""
    folder = scratch(SCRATCH / "copy")
    every = {module: file_of(module, folder) for module in broken()}
    job = in_memory(chosen)

    def then(session):
        by_module = defaultdict(dict)
        for place, tests in session.reach.items():
            by_module[place.partition(":")[0]] |= tests
        (SCRATCH / "reach.json").write_text(json.dumps(dict(places=session.reach, modules=by_module)))
        job(session)

    preload()
    return engine.session(folder, SCRATCH, every, processes, then, NOT_HERE)


def main(arguments):
    chosen = choose([a for a in arguments if not a.startswith("-")])
    if "--list" in arguments:
        for number, name in (row for module in chosen for row in lines(module)):
            print(number, name)
        return 0
    if "--report" in arguments:
        return report(chosen)
    if "--again" in arguments:
        shutil.rmtree(SCRATCH, ignore_errors=True)
    sys.dont_write_bytecode = True  # a mutant may be as long and as old, to the second, as the one before
    os.environ |= dict(
        RLCORE_NO_NUMBA="1",
        RLCORE_QUICK_PROPERTIES="1",
        PYTHONDONTWRITEBYTECODE="1",
        OMP_NUM_THREADS="1",
        PYTEST_DISABLE_PLUGIN_AUTOLOAD="1",
    )
    if "--sample" in arguments:
        with tempfile.TemporaryDirectory() as folder:
            return sample(folder)
    SCRATCH.mkdir(parents=True, exist_ok=True)
    n = 1 if "--alone" in arguments else 2
    if "--memory" in arguments:
        return first(chosen, n)
    for a in arguments:
        if a.startswith("--disk="):
            on_disk(*map(int, a.removeprefix("--disk=").split("/")), chosen)
            return 0
    command = [sys.executable, __file__, *chosen]
    subprocess.run([*command, "--memory", *["--alone"] * (n == 1)], env=os.environ, check=True)
    workers = [subprocess.Popen([*command, f"--disk={i}/{n}"], env=os.environ) for i in range(n)]
    for worker in workers:
        worker.wait()
    return report(chosen)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
