"""Break the code on purpose, one place at a time: some test must fail.

    python tests/mutation.py [module ...]     of TESTS below; all of them where none is named
    python tests/mutation.py --again          forget earlier results
    python tests/mutation.py --list           print the changes without running anything
    python tests/mutation.py --report         what is known from earlier runs
    python tests/mutation.py --sample         only the update lines named in SAMPLE, in a few seconds

Each change (a mutant) is made in a scratch copy and the tests of that module run on it, interpreted, until one fails.
Results are kept in _build/mutation/, one line a mutant, so that a run can be stopped and resumed: a mutant is run again
only where its function is new, or where it survived and the tests are new. Survivors are printed; those that cannot
change a result are listed with the reason in tests/mutation_allowed.txt. Exit status 1 where one is not listed there.
"""

import ast
import hashlib
import importlib
import itertools
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
SCRATCH = ROOT / "_build" / "mutation"
ALLOWED = ROOT / "tests" / "mutation_allowed.txt"
TIME_LIMIT = 60  # seconds for one mutant; a healthy run of one module's tests takes less than half
TESTS = {  # in the order in which they are most likely to notice
    "mdp": "test_mdp test_bad_input test_mdp_env test_properties",
    "bellman": "test_bellman test_bad_input test_properties",
    "dp": "test_dp test_bad_input test_properties",
    "planning": "test_planning test_bad_input",
    "_solve": "test_solve test_properties test_bad_input",
    "td": "test_td_exact test_td",
    "episodes": "test_td_exact test_td",
    "returns": "test_traces_exact test_traces",
    "traces": "test_traces_exact test_traces",
    "nn": "test_nn test_trpo test_reinforce",
    "neurons": "test_nn",
    "policies": "test_policies",
    "policy_gradient": "test_reinforce",
    "reinforce": "test_reinforce",
    "measure": "test_measure test_td_exact",
    "sweep": "test_sweep",
    "ppo": "test_ppo test_losses",
    "trpo": "test_trpo",
    "rollouts": "test_rollouts test_ppo",
    "actor_critic": "test_rollouts test_ppo test_losses",
    "losses": "test_losses",
}
OF_TD = "fixed_point or average_to_state or errors_of or random_walk or share_one or windy or not_met or gymnasium"
OF_TD += " or in_an_environment or by_episode_or_by_step or never_explores or bits"
OF_TRACES = "walk19 or windy or maze_of or cuts_of or v_pi_is or q_pi_of or shortest_path or same_bits or too_small or"
OF_TRACES += " reduction_holds or control_is_its_box or watkins_lambda_0"
OF_PPO = "test_cartpole[ or test_pendulum or inverted or policies_that or beta_of_100 or clipping_keeps"
TOO_SLOW = {  # interpreted, these take seconds or a minute each: left out, which can only make a mutant survive
    "_solve": "memory or 0.9999 or without_numba or does_not_forget or long_corridor",
    "planning": "real_steps or steps_per_episode or converges_to_the_optimum or behaviour_at_random or bonus or root_n "
    "or plain_python or reinforce or recorded_actions",
    "td": OF_TD,
    "episodes": OF_TD,
    "returns": OF_TRACES,
    "traces": OF_TRACES,
    "sweep": "cluster",
    "ppo": OF_PPO,
    "rollouts": OF_PPO,
    "actor_critic": OF_PPO,
}
TORCH = {"nn", "neurons", "policies", "policy_gradient", "reinforce", "ppo", "trpo", "actor_critic", "losses"}
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
    ("dp", "residual / (1 - gamma)", "residual", "test_dp::test_bound_is_tight_where_the_error_is_known"),
    ("bellman", "gamma * V[mdp.next_state]", "V[mdp.next_state]", "test_bellman::test_backups_are_the_sums"),
    ("bellman", "check_q(mdp, Q).max(", "check_q(mdp, Q).min(", "test_bellman::test_backups_are_the_sums"),
    ("bellman", "eye_array(go.size) -", "eye_array(go.size) +", "test_bellman::test_sparse_and_dense_solution"),
    ("bellman", "np.eye(go.size) -", "np.eye(go.size) +", "test_bellman::test_values_in_closed_form"),
    ("mdp", "rewards[t] + gamma * G[t + 1]", "rewards[t] + gamma * rewards[t]", "test_mdp::test_worked_return"),
    ("mdp", "gamma ** (k - t - 1)", "gamma ** (k - t)", "test_mdp::test_worked_return"),
    ("mdp", "discount *= gamma", "discount = gamma", "test_mdp::test_sampled_returns_of_a_certain_process"),
    ("mdp", "while cdf[k] <= u:", "while cdf[k] < u:", "test_mdp::test_draw_inverts_the_cumulative_probabilities"),
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
    elif isinstance(node, ast.AnnAssign):
        roots = [node.annotation]
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


def lines(module):
    """Every mutant of a module as (line number, name); the name is the line and what is done to it."""
    text = (ROOT / "rlcore" / f"{module}.py").read_text()
    seen = {}
    for node, label, _ in mutants(ast.parse(text)):
        name = f"{module}: {text.splitlines()[node.lineno - 1].strip()} | {label}"
        seen[name] = seen.get(name, 0) + 1
        yield node.lineno, name if seen[name] == 1 else f"{name} #{seen[name]}"


def plan(module, first=0, step=1):
    """Mutants first, first + step, ... as (name, line number, digest of the function it is in, source)."""
    text = (ROOT / "rlcore" / f"{module}.py").read_text()
    for i, (number, name) in list(enumerate(lines(module)))[first::step]:
        tree = ast.parse(text)
        _, _, change = next(itertools.islice(mutants(tree), i, None))
        change()
        source = ast.unparse(ast.fix_missing_locations(tree)) + "\n\ndef _same(x):\n    return x\n"
        digest = hashlib.sha256(ast.unparse(_function_of(tree, number)).encode()).hexdigest()[:12]
        yield name, number, digest, source


def _function_of(tree, number):
    """The smallest definition that holds the line, or all where none does."""
    kinds = (ast.FunctionDef, ast.ClassDef)
    around = [n for n in ast.walk(tree) if isinstance(n, kinds) and n.lineno <= number <= n.end_lineno]
    return min(around, key=lambda n: n.end_lineno - n.lineno, default=tree)


# ---------------------------------------------------------------------- running


def scratch(folder):
    """A copy of what the tests need; the package in it shadows the installed one."""
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("rlcore", "tests"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / name, ignore=ignored, copy_function=shutil.copyfile)
    shutil.copy(ROOT / "pyproject.toml", folder)
    if (ROOT / "book").exists():
        (folder / "book").symlink_to(ROOT / "book")
    return folder


def preload():
    """Import what is slow and not under test, once, before the forks."""
    for name in ("gymnasium", "hypothesis.strategies", "pytest", "scipy.sparse.csgraph", "scipy.sparse.linalg"):
        importlib.import_module(name)
    import gymnasium

    for name in ("FrozenLake-v1", "Taxi-v4", "CliffWalking-v1"):
        gymnasium.make(name)
    assert "rlcore" not in sys.modules


def run_tests(folder, tests, limit, leave_out=None):
    """Exit status of the tests in a forked child; 'slow' where the time is up. leave_out: names as pytest's -k."""
    child = os.fork()
    if child == 0:
        os.setsid()
        out = os.open(folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
        os.chdir(folder)
        sys.path.insert(0, str(folder))
        import pytest

        status = 3
        try:
            assert str(folder) in importlib.util.find_spec("rlcore").origin
            names = [name.partition("::") for name in tests.split()]
            files = [f"tests/{file}.py{colons}{test}" for file, colons, test in names]
            files = [name for name in files if (folder / name.split("::")[0]).exists()]
            choice = ["-k", f"not ({leave_out})"] if leave_out else []
            status = int(pytest.main(["-x", "-q", "--assert=plain", "--no-header", *choice, *files]))
        finally:
            os._exit(status)
    end = time.monotonic() + limit
    while time.monotonic() < end:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "slow"


def fingerprint(folder, module):
    """Of the tests that are run."""
    names = [folder / "tests" / f"{name}.py" for name in [*TESTS[module].split(), "worlds"]]
    text = b"".join(path.read_bytes() for path in names if path.exists())
    return hashlib.sha256(text).hexdigest()[:12]


def work(worker, workers, modules):
    """One of the processes: every workers-th mutant that has no result yet."""
    folder, done, excused = scratch(SCRATCH / f"copy{worker}"), results(), allowed()
    preload()
    if set(modules) & TORCH:
        importlib.import_module("torch")  # seconds for each mutant, if not here
        importlib.import_module("sklearn.datasets")
    with open(SCRATCH / "results.jsonl", "a") as out:  # both append whole lines
        for module in modules:
            path, tests, mark = folder / "rlcore" / f"{module}.py", TESTS[module], fingerprint(folder, module)
            original = path.read_text()
            for name, number, digest, source in plan(module, worker, workers):
                before = done.get(name, {})
                # a mutant once killed stays killed while its function is the same; a survivor meets every new test
                known = before.get("digest") == digest
                if known and (before["killed"] or before["mark"] == mark or name in excused):
                    continue
                path.write_text(source)
                start = time.monotonic()
                status = run_tests(folder, tests, TIME_LIMIT, TOO_SLOW.get(module))
                row = dict(name=name, line=number, killed=status != 0, status=status, digest=digest, mark=mark)
                out.write(json.dumps(row | {"seconds": round(time.monotonic() - start, 1)}) + "\n")
                out.flush()
            path.write_text(original)


def sample(folder):
    """Exit status 1 unless every change of SAMPLE makes a test fail."""
    folder, alive = scratch(Path(folder, "copy")), []
    preload()
    for module, line, broken, test in SAMPLE:
        path = folder / "rlcore" / f"{module}.py"
        original = path.read_text()
        if line not in original:
            sys.exit(f"{module}: {line!r} is no longer there")
        path.write_text(original.replace(line, broken))
        if run_tests(folder, test, TIME_LIMIT) != 1:
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
    lines = ALLOWED.read_text().splitlines() if ALLOWED.exists() else []
    pairs = (line.rsplit("  # ", 1) for line in lines if line.strip() and not line.startswith("#"))
    return {name.strip(): reason for name, reason in pairs}


def healthy(modules):
    """The tests pass on the unchanged copy; otherwise every mutant would count as killed."""
    folder = scratch(SCRATCH / "copy-check")
    for module in modules:
        start = time.monotonic()
        if run_tests(folder, TESTS[module], 5 * TIME_LIMIT, TOO_SLOW.get(module)) != 0:
            sys.exit((folder / "log.txt").read_text()[-3000:] + f"\nThe tests of {module} fail without any change.")
        print(f"{module}: unchanged, {time.monotonic() - start:.0f} s", flush=True)


def report(modules):
    found, excused = results(), allowed()
    names = {module: [name for _, name in lines(module)] for module in modules}
    left = []
    for module in modules:
        rows = [found[name] for name in names[module] if name in found]
        alive = [row for row in rows if not row["killed"]]
        new = [row for row in alive if row["name"] not in excused]
        left += new
        slow = sum(row["status"] == "slow" for row in rows)
        print(
            f"{module}: {len(names[module])} mutants, {len(rows)} run, {len(rows) - len(alive)} killed ({slow} by the "
            f"clock), {len(alive) - len(new)} equivalent, {len(new)} survived"
        )
    for row in left:
        print(f"  line {row['line']}  {row['name']}")
    unknown = [name for name in excused if name.split(":")[0] in modules and name not in names[name.split(":")[0]]]
    for name in unknown:
        print(f"  no longer there: {name}")
    return 1 if left or unknown else 0


def main(arguments):
    modules = [a for a in arguments if not a.startswith("-")] or list(TESTS)
    if "--list" in arguments:
        for number, name in (row for module in modules for row in lines(module)):
            print(number, name)
        return 0
    if "--report" in arguments:
        return report(modules)
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
    if "--worker" in arguments:
        number = int(arguments[arguments.index("--worker") + 1])
        work(number, 2, [m for m in modules if m in TESTS])
        return 0
    preload()
    healthy(modules)
    command = [sys.executable, __file__, *modules, "--worker"]
    workers = [subprocess.Popen([*command, str(i)], env=os.environ) for i in range(2)]
    for worker in workers:
        worker.wait()
    return report(modules)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
