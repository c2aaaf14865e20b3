"""The short programs of benchmarks/programs, as a user would write them, say what they should."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SAYS = {
    "inventory": r"certified to \de-\d\d; order \d+ at 0, nothing from \d+ on\n",
    "own_environment": r"q_learning Evaluation\(200 episodes, .*\)\nsarsa Evaluation\(200 episodes, .*\)\n",
    "continuous": r"Evaluation\(200 episodes, return -0\.[01].*\)\n",
    "save_and_load": r"Evaluation\(20 episodes, .*\)\nRun\(.* episodes, .* steps, .*\)\n",
    "ten_seeds": r"(\w+ +-\d+\.\d \[-\d+\.\d, -\d+\.\d\]  mean of 10 runs, band: 95 % interval of the mean\n){3}",
    "bare": r"-13\.0 -13\.0\n",
}


@pytest.mark.long
@pytest.mark.parametrize("name", SAYS)
def test_a_program(name, tmp_path):
    path = ROOT / "benchmarks" / "programs" / f"{name}.py"
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, str(path)], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(SAYS[name], done.stdout), done.stdout


def test_every_program_is_tried():
    assert {path.stem for path in (ROOT / "benchmarks" / "programs").glob("*.py")} == set(SAYS)
