"""The built pages as files: all there, light, every link, id and formula, texts of images, fonts that suffice."""

import gzip
import re
from html import unescape
from html.parser import HTMLParser
from urllib.parse import urldefrag, urljoin

import pytest
import yaml
from conftest import CHAPTERS, HTML, PAGES, ROOT
from fontTools.ttLib import TTFont

pytestmark = pytest.mark.built


class Page(HTMLParser):
    """Ids, links and images of one page."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.images = set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        if values.get("id"):
            self.ids.add(values["id"])
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        if tag == "img":
            self.images.append(values)


@pytest.fixture(scope="session")
def parsed(built):
    paths = [*built.glob("book/**/*.html"), built / "index.html"]
    return {path.relative_to(built).as_posix(): Page(path.read_text(encoding="utf-8")) for path in paths}


def test_the_book_has_its_pages(parsed):
    listed = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
    files = [listed["root"], *(chapter["file"] for part in listed["parts"] for chapter in part["chapters"])]
    for file in files:
        text = (HTML / f"{file}.html").read_text(encoding="utf-8")
        article = re.search(r"<article.*?</article>", text, re.S).group()
        words = re.sub(r"<[^>]+>", " ", article).split()
        assert len(words) > (1500 if re.search(r"/0[1-8]_[a-z_]+$", file) and "exercises" not in file else 15), file


def test_exercises_show_no_verdict_before_an_answer(built):
    pages = sorted(built.glob("book/exercises/*.html"))
    assert len(pages) == 11
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert "not attempted:" not in text and "How to work on it" in text and "tag_check-" in text, page.name


@pytest.mark.parametrize("page", PAGES)
def test_pages_are_light(page):
    """As it lies on the disk, with figures and formulas inside, and as servers send it."""
    page = (HTML / page).read_bytes()
    assert len(page) < 2_200_000 and len(gzip.compress(page)) < 500_000


def test_links_and_anchors_resolve(parsed, built):
    broken = []
    for page, content in parsed.items():
        for link in content.links:
            target, anchor = urldefrag(urljoin(f"/{page}", link))
            if re.match(r"[a-z]+:", target):
                continue
            path = target.lstrip("/") or page
            if not (built / path).exists() or (anchor and path in parsed and anchor not in parsed[path].ids):
                broken.append((page, link))
    assert broken == []


def test_every_row_of_the_ledger_has_its_anchor(parsed):
    rows = yaml.safe_load((ROOT / "book" / "concordance.yml").read_text(encoding="utf-8"))
    for row in rows:
        if row.get("status") != "missing":
            for page, anchor in (row["page"].split("#"), row["record"].split("#")):
                assert anchor in parsed[f"book/{page}.html"].ids, row["id"]
            for name in row["code"]:
                assert name in parsed["book/appendix_api.html"].ids, f"{name} is not on the API page"


def test_images_have_alt_text(parsed):
    for page, content in parsed.items():
        for image in content.images:
            assert (image.get("alt") or "").strip(), (page, image.get("src", "")[:80])


@pytest.mark.parametrize("page", CHAPTERS)
def test_equations_carry_the_numbers_of_chapter_and_document(page):
    text, chapter = (HTML / page).read_text(encoding="utf-8"), re.search(r"/0(\d)_", page)[1]
    label = r'id="equation-eq-(\d+)">\s*(?:<span id="[^"]*"></span>)?\s*<span class="eqno">\(([\d.]+)\)<'
    shown = re.findall(label, text)
    assert all(f"{chapter}.{label}" == number for label, number in shown)
    assert len(shown) == len(re.findall(r'id="equation-eq-\d+"', text))


def test_no_two_equations_share_a_number():
    texts = [(HTML / page).read_text(encoding="utf-8") for page in PAGES]
    numbers = [number for text in texts for number in re.findall(r'<span class="eqno">\(([\d.]+)\)<', text)]
    assert len(numbers) == len(set(numbers)) > 60


def test_marks_lead_to_the_record_and_back(parsed):
    for row in yaml.safe_load((ROOT / "book" / "concordance.yml").read_text(encoding="utf-8")):
        for here, there in ((row["page"], row["record"]), (row["record"], row["page"])):
            page, (target, anchor) = here.split("#")[0], there.split("#")
            links = {urljoin(f"/book/{page}.html", link) for link in parsed[f"book/{page}.html"].links}
            assert f"/book/{target}.html#{anchor}" in links, (row["id"], here)


@pytest.mark.parametrize("page", PAGES)
def test_every_formula_is_set(page):
    text = (HTML / page).read_text(encoding="utf-8")
    places = re.findall(r'<(?:div|span) class="math notranslate[^>]*>', text)
    assert text.count("<mjx-container") == len(places) == text.count("<mjx-assistive-mml")
    assert "mjx-merror" not in text and "MathJax" not in re.sub(r'class="MathJax', "", text)


def test_every_character_of_a_formula_has_its_rule(built):
    used = set()
    for page in PAGES:
        used |= set(re.findall(r"<mjx-c class=\"(mjx-c[0-9A-F]+)", (HTML / page).read_text(encoding="utf-8")))
    rules = (built / "_static" / "mathjax.css").read_text(encoding="utf-8")
    assert len(used) > 100 and {name for name in used if f".{name}" not in rules} == set()
    assert rules.count("{") == rules.count("}")


def test_the_sites_fonts_have_every_character_of_the_pages(parsed):
    fonts = HTML / "_static" / "fonts"
    assert "OPEN FONT LICENSE" in (fonts / "OFL.txt").read_text(encoding="utf-8")
    code, prose = set(), set()
    for page in PAGES:
        text = re.sub(
            r"<(script|style|mjx-container)\b.*?</\1>", "", (HTML / page).read_text(encoding="utf-8"), flags=re.S
        )
        for part in re.findall(r"<(?:pre|code)\b.*?</(?:pre|code)>", text, re.S):
            code |= set(unescape(re.sub(r"<[^>]+>", "", part)))
        prose |= set(unescape(re.sub(r"<[^>]+>", "", re.sub(r"<(pre|code)\b.*?</\1>", "", text, flags=re.S))))
    for name, used in {"mono": code, "serif": prose, "sans": prose}.items():
        has = TTFont(fonts / f"{name}.woff2").getBestCmap()
        assert {c for c in used if c.isprintable() and ord(c) not in has} == set(), name
