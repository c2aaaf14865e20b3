"""The ledger is complete, and every row that is done points at a place, code and a check that exist."""

import ast
import functools
import importlib
import json
import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ROWS = yaml.safe_load((ROOT / "book" / "concordance.yml").read_text(encoding="utf-8"))
DONE = [row for row in ROWS if row.get("status") != "missing"]
# How many entries of each kind the document has, chapter by chapter: a row that is lost is noticed.
COUNTS = {
    "equation": (13, 6, 7, 5, 25, 26, 10, 11),
    "figure": (2, 4, 7, 9, 7, 19, 8, 5),
    "table": (0, 0, 0, 2, 0, 0, 0, 1),
    "algorithm": (4, 4, 8, 9, 10, 5, 5, 12),
    "example": (8, 5, 7, 5, 2, 5, 4, 13),
    "claim": (11, 12, 15, 22, 22, 16, 17, 29),
    "omission": (0, 2, 3, 2, 3, 2, 3, 5),
}


@functools.cache
def cells(page):
    return json.loads((ROOT / "book" / f"{page}.ipynb").read_text(encoding="utf-8"))["cells"]


def test_every_entry_of_the_document_has_one_row():
    ids = [row["id"] for row in ROWS]
    assert len(ids) == len(set(ids))
    found = {kind: [0] * 8 for kind in COUNTS}
    for row in ROWS:
        found[row["kind"]][row["chapter"] - 1] += 1
    assert {kind: tuple(numbers) for kind, numbers in found.items()} == COUNTS


def test_nothing_is_missing():
    assert [row["id"] for row in ROWS if row.get("status") == "missing"] == []


@pytest.mark.parametrize("row", DONE, ids=lambda row: row["id"])
def test_a_row_that_is_done_resolves(row):
    for page, anchor in (row[key].split("#") for key in ("page", "record")):
        source = "\n\n".join("".join(cell["source"]) for cell in cells(page) if cell["cell_type"] == "markdown")
        assert f'id="{anchor}"' in source or f"$$ ({anchor})" in source, f"no anchor {anchor} on page {page}"
    assert row["code"] and row["check"]
    for name in row["code"]:
        assert resolves(name), f"no {name}"
    for check in row["check"]:
        assert exists(check), f"no {check}"
    if row["kind"] == "claim":
        assert str(row["verdict"]) in ("true", "false", "true-with-conditions")


def resolves(name):
    """Whether a dotted name under rlcore can be imported."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        return functools.reduce(
            lambda at, part: getattr(at, part, None) if at is not None else None, parts[cut:], thing
        )
    return None


@functools.cache
def functions_of(path):
    """Names of the test functions of a file, with those of test classes as Class::name."""
    names = set()
    for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.ClassDef):
            names |= {f"{node.name}::{inner.name}" for inner in node.body if isinstance(inner, ast.FunctionDef)}
    return names


def exists(check):
    """Whether a check is a test that exists, or the tag of a code cell that checks something."""
    if "::" in check:
        path, name = check.split("::", 1)
        return name.partition("[")[0] in functions_of(path) and name.rpartition("::")[2].startswith("test_")
    path, tag = check.split("#")
    page = Path(path).relative_to("book").with_suffix("").as_posix()
    tagged = [cell for cell in cells(page) if tag in cell["metadata"].get("tags", [])]
    return any(cell["cell_type"] == "code" and "assert" in "".join(cell["source"]) for cell in tagged)


def test_errata_of_the_chapters_all_have_their_place():
    numbers = set()
    pages = {row["record"].split("#")[0] for row in DONE}
    for page in pages:
        for cell in cells(page):
            if cell["cell_type"] == "markdown":
                for title in re.findall(
                    r"^:::\{admonition\} Errat(?:um|a) ([\d, and]+)$", "".join(cell["source"]), re.M
                ):
                    numbers |= {int(n) for n in re.findall(r"\d+", title)}
    assert set(range(12, 428)) - numbers == set(), "errata without a box"
