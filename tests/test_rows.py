"""Each row of the ledger has a break that its check must notice; a few are tried here, all by `make rows`."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
import rows

ROOT = Path(__file__).parents[1]


def test_every_row_has_a_break():
    assert {change["row"] for change in rows.breaks()} == {*rows.ROWS}


@pytest.mark.parametrize("file", sorted({change["file"] for change in rows.breaks()}))
def test_a_break_is_one_place_of_its_file_and_can_be_run(file):
    text = (ROOT / file).read_text(encoding="utf-8")
    for change in rows.breaks():
        if change["file"] == file:
            assert text.count(change["old"]) == 1, f"{change['row']}: {change['old']}"
            assert change["new"] != change["old"]
            if file.endswith(".py"):
                ast.parse(text.replace(change["old"], change["new"]))


@pytest.mark.long
def test_some_breaks_are_noticed():
    done = subprocess.run([sys.executable, str(ROOT / "tests" / "rows.py"), "--sample"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    noticed, of, total, *_ = done.stdout.split()
    assert noticed == total and int(total) >= 6


CELLS = {
    "first": "import numpy as np\nrng = np.random.default_rng(0)\nunused = 1",
    "second": "x = rng.normal(size=3)\nassert x.size == 4\ny = []",
    "third": "for k in range(2):\n    y.append(k)\nz = 2",
    "check": "assert np.sum(x) > -100 and y == [0, 1]",
}


def write(path, cells, printed=""):
    stream = [{"output_type": "stream", "name": "stdout", "text": printed}]
    found = [
        {"cell_type": "code", "source": text, "metadata": {"tags": [tag]}, "outputs": stream if tag == "check" else []}
        for tag, text in cells.items()
    ]
    path.write_text(json.dumps({"cells": found}), encoding="utf-8")


def test_a_slice_has_what_the_check_depends_on_and_no_other_assert(tmp_path, monkeypatch):
    write(tmp_path / "a.ipynb", CELLS)
    monkeypatch.setattr(rows, "ROOT", tmp_path)
    monkeypatch.chdir(tmp_path)
    found = [rows.statements("a.ipynb")[i][2].splitlines()[0] for i, _ in rows.sliced("a.ipynb", "check")]
    expected = ["import numpy as np", "rng = np.random.default_rng(0)", "x = rng.normal(size=3)", "y = []"]
    assert found == [*expected, "for k in range(2):", "assert np.sum(x) > -100 and y == [0, 1]"]
    assert rows.run_cell(tmp_path, "a.ipynb#check") == ""  # the assert of the second cell, which fails, is not its own


@pytest.mark.parametrize(
    "source, printed, how",
    [
        ("assert z == 3", "", "assert: assert z == 3"),
        ("z.lost", "", "raises: AttributeError"),
        ("print(z)", "3\n", "prints: something else"),
        ("print(z)", "2\n", ""),
    ],
)
def test_how_a_check_notices(tmp_path, monkeypatch, source, printed, how):
    path = f"{how[:4] or 'fine'}.ipynb"
    write(tmp_path / path, CELLS | {"check": source}, printed)
    monkeypatch.setattr(rows, "ROOT", tmp_path)
    monkeypatch.chdir(tmp_path)
    rows.statements.cache_clear()
    rows.sliced.cache_clear()
    assert rows.run_cell(tmp_path, f"{path}#check").startswith(how) and bool(how) == bool(
        rows.run_cell(tmp_path, f"{path}#check")
    )


def test_a_change_is_made_once_and_taken_back(tmp_path):
    target = tmp_path / "rlcore" / "bellman.py"
    target.parent.mkdir()
    with rows.broken(tmp_path, "rlcore/bellman.py", "Q.argmax(axis=1)]", "Q.argmin(axis=1)]"):
        assert "Q.argmin(axis=1)]" in target.read_text()
    assert target.read_bytes() == (ROOT / "rlcore" / "bellman.py").read_bytes()


def test_machine_code_is_made_anew_where_a_compiled_function_changes():
    assert rows.compiled_at("rlcore/bellman.py", "Q.argmax(axis=1)]") == []
    assert rows.compiled_at("rlcore/td.py", "# eq-19") == ["td0"]
    _, calls = rows.machine_code()
    assert {"td0", "log", "note"} <= rows.reached("td0", calls)
