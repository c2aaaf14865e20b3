"""The update lines of chapters 1 to 3, broken one at a time: each must make a test fail. `make mutation` breaks all."""

import fnmatch
import subprocess
import sys
from pathlib import Path

import mutation
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


def test_every_module_has_its_tests_or_a_reason_to_be_left_out():
    found = set(mutation.modules())
    assert found == set(mutation.TESTS) | {module for module in found if mutation.left_out(module)}
    assert not [module for module in mutation.TESTS if mutation.left_out(module)]
    assert all(fnmatch.filter(found, pattern) for pattern in mutation.LEFT_OUT)
    assert all(
        path.exists() for module in found & set(mutation.TESTS) for path in mutation.files(mutation.ROOT, module)
    )


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
        monkeypatch.setattr(mutation, "TESTS", {name.replace("__", "."): "" for name in sources})
        for cached in (mutation.names, mutation._lines):
            cached.cache_clear()
        return {name: [row[1] for row in mutation.lines(name)] for name in mutation.TESTS}

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
