"""Every public function and method says what it takes and what comes back; mypy holds the bodies to it."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = [
    path for path in sorted((ROOT / "rlcore").rglob("*.py"))
    if not path.name.startswith("_") and not (path.parent.name == "exercises" and path.name.startswith("ch"))
]  # fmt: skip


def functions(node, within=""):
    """(name, function) of the public functions of a module and of the methods of its public classes."""
    for inner in node.body:
        public = not inner.name.startswith("_") if hasattr(inner, "name") else False
        if isinstance(inner, ast.FunctionDef) and (public or (within and inner.name.startswith("__"))):
            yield within + inner.name, inner
        elif isinstance(inner, ast.ClassDef) and public:
            yield from functions(inner, f"{inner.name}.")
        elif isinstance(inner, (ast.If, ast.With, ast.Try)):
            yield from functions(inner, within)


def missing(function):
    """Arguments without a type, and "return"."""
    a = function.args
    arguments = [*a.posonlyargs, *a.args]
    arguments = arguments[1 if arguments and arguments[0].arg in ("self", "cls") else 0 :]
    arguments += [*a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
    return [x.arg for x in arguments if x.annotation is None] + ["return"] * (function.returns is None)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_public_function_has_types(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert {name: missing(function) for name, function in functions(tree) if missing(function)} == {}


def test_most_of_what_is_public_is_looked_at():
    found = sum(len(list(functions(ast.parse(path.read_text(encoding="utf-8"))))) for path in MODULES)
    assert found > 500  # measured: 567


def test_a_missing_type_is_noticed():
    tree = ast.parse("class A:\n    def f(self, a: int, *, b=1, **c): ...\ndef _g(x): ...")
    assert [(name, missing(function)) for name, function in functions(tree)] == [("A.f", ["b", "c", "return"])]


USER = """
import numpy as np
from rlcore.dp import value_iteration
from rlcore.envs.grids import gridworld
from rlcore.td import q_learning

mdp, rng = gridworld(), np.random.default_rng(0)
reveal_type(value_iteration(mdp, 0.9, V0=[0.0] * 16))
reveal_type(q_learning("FrozenLake-v1", 0.9, 10, alpha=0.1, epsilon=0.1, rng=rng))
value_iteration(mdp, "0.9")
q_learning(mdp, 0.9, 10, alpha=0.1, rng=rng)
"""


@pytest.mark.long
def test_who_calls_an_algorithm_is_told_of_wrong_types(tmp_path):
    (tmp_path / "user.py").write_text(USER)
    options = ["--config-file=", "--follow-imports=silent", f"--cache-dir={tmp_path}", "user.py"]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    command = [sys.executable, "-m", "mypy", *options]
    found = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True).stdout.splitlines()
    told = [line for line in found if line.startswith("user.py") and '"q_learning" defined in' not in line]
    assert [re.search(r"rlcore[\w.]+|arg-type|call-arg", line)[0] for line in told] == [
        "rlcore.core.results.Solution", "rlcore.core.results.Run", "arg-type", "call-arg",
    ]  # fmt: skip
