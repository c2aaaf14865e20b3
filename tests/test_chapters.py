"""The form of the chapters that have a record: they teach, the record accounts; what can be counted is counted."""

import json
import re
from pathlib import Path

import pytest
import yaml

BOOK = Path(__file__).parents[1] / "book"
RECORDS = sorted((BOOK / "record").glob("0*.ipynb"))
RECORDS = [path for path in RECORDS if not path.name.startswith("09")]  # the conclusion has a form of its own
CHAPTERS = [BOOK / path.name for path in RECORDS]
ROWS = yaml.safe_load((BOOK / "concordance.yml").read_text(encoding="utf-8"))
COLUMNS, LINES = 88, 10
# What a newcomer finds in the list of sections, in every chapter.
LAST = ("Summary", "Formulas of this chapter", "What practitioners do", "To read on")


def cells(path, kind):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [cell for cell in notebook["cells"] if cell["cell_type"] == kind]


def source(cell):
    return "".join(cell["source"])


def prose(path):
    return "\n\n".join(source(cell) for cell in cells(path, "markdown"))


def tags(cell):
    return cell["metadata"].get("tags", [])


def name(path):
    return path.stem


chapters = pytest.mark.parametrize("path", CHAPTERS, ids=name)


def test_there_are_chapters_with_a_record():
    assert len(CHAPTERS) == 8 and all(path.exists() for path in CHAPTERS)


@chapters
def test_a_chapter_holds_no_audit(path):
    """No assert, no erratum, no verdict, no claim, no table of checks."""
    code = [source(cell) for cell in cells(path, "code")]
    assert not [text for text in code if re.search(r"^\s*assert\b", text, re.M)]
    assert not [cell for cell in cells(path, "code") if any(tag.startswith("check-") for tag in tags(cell))]
    text = prose(path)
    for word in ("class: erratum", 'class="verdict', "**Claim:", "What was checked", "{admonition} Errat"):
        assert word not in text, word


@chapters
def test_what_is_visible_is_short(path):
    for cell in cells(path, "code"):
        if "hide-input" in tags(cell) or "hide-cell" in tags(cell):
            continue
        lines = source(cell).splitlines()
        assert len(lines) <= LINES and max(map(len, lines)) <= COLUMNS, source(cell)
        assert not re.search(r"^\s*(def|class|from|import) ", source(cell), re.M), source(cell)
        assert cell["outputs"], source(cell)


@chapters
def test_pictures_are_folded_and_have_a_caption(path):
    """The code of a picture is folded, and a caption follows at once: number, what is drawn, what to see."""
    notebook = json.loads(path.read_text(encoding="utf-8"))["cells"]
    numbers = []
    for cell, after in zip(notebook, notebook[1:]):
        kinds = {kind for output in cell.get("outputs", []) for kind in output.get("data", {})}
        if not kinds & {"image/png", "text/html"}:
            continue
        assert "hide-input" in tags(cell), source(cell)
        found = re.match(r":::\{div\} caption\n(.*?)\n:::", source(after), re.S)
        assert found, source(cell)
        said = re.search(r"\*\*Figures? (\d\.\w+)(?: and (\d\.\w+))?\.\*\*", found[1])
        assert said and "*See:*" in found[1], found[1]
        numbers += [number for number in said.groups() if number]
    assert len(numbers) == len(set(numbers)) >= 8
    assert all(number.startswith(str(int(path.name[:2]))) for number in numbers)


@chapters
def test_numbers_are_printed_not_verdicts(path):
    for cell in cells(path, "code"):
        for output in cell["outputs"]:
            assert not re.search(r"\b(True|False)\b", "".join(output.get("text", []))), source(cell)


@chapters
def test_a_chapter_opens_and_ends_as_all_do(path):
    text = prose(path)
    assert "**You will be able to**" in text and "**You need**" in text
    headings = re.findall(r"^## (.+)$", text, re.M)
    assert tuple(headings[-4:]) == LAST
    summary = text.split("## Summary")[1].split("\n## ")[0]
    assert 6 <= len(re.findall(r"^\* ", summary, re.M)) <= 10
    assert "{tasks}`" in text and f"record/{path.name}" in text


@chapters
def test_words_stand_beside_code(path):
    """QuantEcon's lectures have 6 to 22 words of text for a line of code, d2l 17 to 45."""
    shown = [cell for cell in cells(path, "code") if not {"hide-input", "hide-cell"} & {*tags(cell)}]
    lines = sum(len(source(cell).splitlines()) for cell in shown)
    words = len(re.sub(r"```.*?```|\$\$.*?\$\$", "", prose(path), flags=re.S).split())
    assert words / lines > 25


@chapters
def test_sections_can_be_found(path):
    for heading in re.findall(r"^#{2,3} (.+)$", prose(path), re.M):
        assert len(heading) <= 64, heading
        assert not re.search(r"`|\{", heading), heading


def test_sections_that_readers_search_for():
    headings = "\n".join(re.findall(r"^#{1,3} .+$", "\n".join(map(prose, CHAPTERS)), re.M))
    for word in ("SARSA", "Q-learning", "Dyna", "Monte Carlo prediction", "contraction", "Policy improvement", "TD(0)",
                 "Bellman equation", "Bellman optimality equation", "Value iteration", "Policy iteration", "Returns",
                 "Markov property", "Importance sampling", "Linear features", "Monte Carlo control"):  # fmt: skip
        assert word.lower() in headings.lower(), word


@chapters
def test_links_lead_on(path):
    text = prose(path)
    assert len(re.findall(r"\]\(0\d_\w+\.ipynb\)", text)) >= 2
    assert len(re.findall(r"\{task\}`", text)) >= 4


@pytest.mark.parametrize("path", RECORDS, ids=name)
def test_a_record_holds_what_the_chapter_leaves_out(path):
    mine = [row for row in ROWS if row["record"].startswith(f"record/{path.stem}#")]
    checks = [cell for cell in cells(path, "code") if any(tag.startswith("check-") for tag in tags(cell))]
    assert len(mine) > 30 and len(checks) >= 24
    assert all("assert" in source(cell) for cell in checks)
    for row in mine:
        assert row["page"] == row["record"].removeprefix("record/")
    for words in re.findall(r"\$\$(.+?)\$\$", prose(path), re.S):
        assert words.strip() in prose(BOOK / path.name), words


@pytest.mark.parametrize("path", RECORDS, ids=name)
def test_a_record_repeats_no_number_of_an_equation(path):
    assert not re.search(r"\$\$ *\(eq-", prose(path))


SCREEN = re.compile(r'<span class="on-screen">(.*?)</span>', re.S)
HANDS = re.compile(
    r"(?:[.;:*>] |^)(?:Choose|Move|Drag|Press|Click)\b(?! \$A)|[;:] (?:choose|move|drag|press|click) the\b", re.M
)


def test_what_asks_for_a_screen_is_marked():
    """On paper nothing can be chosen or moved; the pattern finds at least half of what is marked."""
    pages = [*BOOK.glob("0*.ipynb"), *(BOOK / "record").glob("0*.ipynb"), BOOK / "index.ipynb"]
    texts = [prose(path) for path in pages]
    assert [found for text in texts for found in HANDS.findall(SCREEN.sub("", text))] == []
    marked = [part.strip() for text in texts for part in SCREEN.findall(text)]
    assert sum(bool(HANDS.search(part)) for part in marked) > len(marked) / 2
