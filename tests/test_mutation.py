"""The update lines of chapters 1 to 3, broken one at a time: each must make a test fail. `make mutation` breaks all."""

import fnmatch
import subprocess
import sys
from pathlib import Path

import mutation
import mutation_engine
import pytest


@pytest.mark.long
def test_broken_update_lines_are_noticed():
    script = Path(__file__).parent / "mutation.py"
    done = subprocess.run([sys.executable, str(script), "--sample"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith(f"{len(mutation.SAMPLE)} of {len(mutation.SAMPLE)} noticed")


def test_every_line_of_an_equation_is_among_the_mutants():
    for module in ("mdp", "bellman", "dp"):
        source = mutation.file_of(module).read_text().splitlines()
        cited = {i + 1 for i, line in enumerate(source) if "  # eq-" in line}
        broken = {number for number, _ in mutation.lines(module)}
        assert cited and cited <= broken


def test_every_module_is_broken_or_has_a_reason_to_be_left_out():
    found = set(mutation.modules())
    assert set(mutation.broken()) == {module for module in found if not mutation.left_out(module)}
    assert len(mutation.broken()) > 60 and all(fnmatch.filter(found, pattern) for pattern in mutation.LEFT_OUT)


def test_excuses_are_for_mutants_that_exist():
    assert mutation.stale() == [] and all(len(reason) > 10 for reason in mutation.allowed().values())


@pytest.fixture
def package(tmp_path, monkeypatch):
    """write(**modules) makes these the package that is broken."""

    def write(**sources):
        for name, text in sources.items():
            path = mutation.file_of(name.replace("__", "."), tmp_path)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        modules = [name.replace("__", ".") for name in sources]
        monkeypatch.setattr(mutation, "broken", lambda: modules)
        for cached in (mutation.names, mutation._lines):
            cached.cache_clear()
        return {name: [row[1] for row in mutation.lines(name)] for name in modules}

    monkeypatch.setattr(mutation, "ROOT", tmp_path)
    yield write
    mutation.names.cache_clear()
    mutation._lines.cache_clear()


def test_a_mutant_keeps_its_name_when_its_function_moves(package):
    function = "class C:\n    def f(self, x):\n        return x + 1\n"
    found = ["C.f: return x + 1 | Add to Sub", "C.f: return x + 1 | 1 to 2", "C.f: return x + 1 | 1 to 0"]
    assert package(one=function + "N = True\n")["one"] == ["top level: N = True | True to False", *found]
    assert package(one="", core__two="\n\n" + function) == {"one": [], "core.two": found}


def test_two_mutants_of_one_name_say_their_modules(package):
    function = "def f(x):\n    return -x\n"
    found = package(one=function, core__two=function + "def g(x):\n    return -x\n")
    assert found["one"] == ["f in one: return -x | USub dropped"]
    assert found["core.two"] == ["f in core.two: return -x | USub dropped", "g: return -x | USub dropped"]


SOURCE = """
def f(x, n=1):
    y = x if x > 0 else -x
    g = lambda z: z + n
    while y > 3:
        y -= 1
    if y:
        return g(y)
    elif x:
        return 0
    return [z * 2 for z in (1, 2)]

def untouched(x):
    return -x
"""


@pytest.fixture
def loaded(tmp_path):
    """(file, its functions by name), imported from a folder of its own."""
    file = tmp_path / "loaded.py"
    file.write_text(SOURCE)
    scope = {}
    exec(compile(SOURCE, str(file), "exec"), scope)
    return str(file), scope


def test_marks_say_which_statements_a_call_reaches(loaded):
    file, scope = loaded
    number, reached = {}, bytearray(20)
    tree = mutation_engine.marked(mutation_engine.ast.parse(SOURCE), number, "loaded")
    before = mutation_engine.compiled(mutation_engine.ast.parse(SOURCE), file)
    new = mutation_engine.changes(before, mutation_engine.compiled(tree, file), mutation_engine.alive(file)[file])
    assert {function.__name__ for function, _ in new} == {"f", "untouched"}
    for function, code in new:
        function.__code__ = code
    scope["__reached__"] = reached
    names = list(number)

    def lines(x):
        reached[:] = bytes(20)
        value = scope["f"](x)
        return value, sorted({int(names[i].split(":")[1]) for i in range(len(names)) if reached[i]})

    assert lines(5) == (4, [3, 4, 5, 6, 7, 8])  # the lambda stands in line 4, and is a place of its own
    assert lines(0) == ([2, 4], [3, 4, 5, 7, 9, 11])
    assert len(number) == 11


def test_a_change_reaches_functions_that_exist(loaded):
    file, scope = loaded
    before = mutation_engine.compiled(mutation_engine.ast.parse(SOURCE), file)
    broken = mutation_engine.compiled(mutation_engine.ast.parse(SOURCE.replace("z + n", "z - n")), file)
    ((function, code),) = mutation_engine.changes(before, broken, mutation_engine.alive(file)[file])
    function.__code__ = code
    assert function is scope["f"] and scope["f"](3) == 2 and scope["untouched"](3) == -3


def test_a_mutant_meets_each_test_function_before_its_second_case():
    seconds = {"t[1]": 0.1, "t[2]": 0.2, "slow": 3.0, "slower": 5.5, "last": 0.3}
    assert mutation_engine.chosen(seconds) == ["t[1]", "last", "slow", "t[2]"]
    assert mutation_engine.chosen(seconds, ["slow"])[0] == "slow"
    assert mutation_engine.chosen({"only": 20.0}) == ["only"]
