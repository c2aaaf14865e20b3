"""The notebooks as committed: run from first to last, short cells, text for every picture, enough that is compared."""

import json
import re
from pathlib import Path

import pytest

BOOK = Path(__file__).parents[1] / "book"
NOTEBOOKS = sorted([*BOOK.glob("*.ipynb"), *BOOK.glob("record/*.ipynb")])
RECORDS = [path for path in NOTEBOOKS if path.parent.name == "record" and re.match(r"0[1-8]_", path.name)]


def cells(path, kind):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [cell for cell in notebook["cells"] if cell["cell_type"] == kind]


def source(cell):
    return "".join(cell["source"])


def name(path):
    return path.relative_to(BOOK).with_suffix("").as_posix()


@pytest.fixture(params=NOTEBOOKS, ids=name)
def notebook(request):
    return cells(request.param, "code")


def test_there_are_notebooks():
    assert len(RECORDS) == 8 and len(NOTEBOOKS) >= 18


def test_every_cell_was_run_in_order(notebook):
    assert [cell["execution_count"] for cell in notebook] == list(range(1, len(notebook) + 1))


def test_no_cell_warns_or_fails(notebook):
    for cell in notebook:
        for output in cell["outputs"]:
            assert output["output_type"] != "error", source(cell)
            assert output.get("name") != "stderr", (source(cell), output["text"])


def test_cells_are_short_and_define_nothing(notebook):
    for cell in notebook:
        folded = {"hide-input", "hide-cell"} & {*cell["metadata"].get("tags", [])}
        assert len(source(cell).splitlines()) <= (20 if folded else 15), source(cell)
        assert not re.search(r"^\s*(def|class) ", source(cell), re.M), source(cell)


def test_every_picture_says_what_it_shows(notebook):
    for cell in notebook:
        kinds = {kind for output in cell["outputs"] for kind in output.get("data", {})}
        if "image/png" in kinds or "image/svg+xml" in kinds:
            alt = cell["metadata"].get("mystnb", {}).get("image", {}).get("alt", "")
            assert len(alt) >= 20, source(cell)
        for output in cell["outputs"]:
            for tag in re.findall(r"<img\b[^>]*>", "".join(output.get("data", {}).get("text/html", []))):
                assert re.search(r'alt="[^"]{20,}"', tag), source(cell)


def test_seeds_are_local_and_no_time_is_printed(notebook):
    for cell in notebook:
        assert "np.random.seed" not in source(cell)
        assert not re.search(r"%%?time|perf_counter|process_time", source(cell)), source(cell)


@pytest.mark.parametrize("path", RECORDS, ids=name)
def test_a_record_compares_at_least_fifteen_texts(path):
    def compared(cell):
        data = [output.get("data", {}).get("text/plain", []) for output in cell["outputs"]]
        streams = [output.get("text", []) for output in cell["outputs"]]
        text = "".join(part for block in data + streams for part in block)
        return re.search(r"\d", re.sub(r"<Figure size .*?>|<explore: .*?>", "", text))

    assert sum(bool(compared(cell)) for cell in cells(path, "code")) >= 15


@pytest.mark.parametrize("path", RECORDS, ids=name)
def test_checks_that_are_tagged_assert_something(path):
    for cell in cells(path, "code"):
        if any(tag.startswith("check-") for tag in cell["metadata"].get("tags", [])):
            assert "assert" in source(cell), source(cell)
