"""The update lines of chapters 1 to 3, broken one at a time: each must make a test fail. `make mutation` breaks all."""

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
        source = (mutation.ROOT / "rlcore" / f"{module}.py").read_text().splitlines()
        cited = {i + 1 for i, line in enumerate(source) if "  # eq-" in line}
        broken = {number for number, _ in mutation.lines(module)}
        assert cited and cited <= broken


def test_excuses_are_for_mutants_that_exist():
    names = {name for module in mutation.TESTS for _, name in mutation.lines(module)}
    excused = {name for name in mutation.allowed() if name.split(":")[0] in mutation.TESTS}
    assert excused <= names and all(len(reason) > 10 for reason in mutation.allowed().values())
