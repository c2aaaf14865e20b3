"""The built pages in headless Chromium: mathematics, controls, links, accessibility, no request to any other site."""

import re
from html.parser import HTMLParser
from urllib.parse import urldefrag, urljoin

import pytest
import yaml
from conftest import HTML, ROOT

pytestmark = pytest.mark.pages
PAGES = sorted(path.relative_to(HTML).as_posix() for path in HTML.glob("book/**/*.html"))
CHAPTERS = [page for page in PAGES if re.match(r"book/0[1-8]_", page)]
MEGABYTE = 1 << 20


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


@pytest.mark.parametrize("page", PAGES)
def test_pages_are_light(page):
    assert (HTML / page).stat().st_size < 2 * MEGABYTE


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
            page, anchor = row["page"].split("#")
            assert anchor in parsed[f"book/{page}.html"].ids, row["id"]
            for name in row["code"]:
                assert name in parsed["book/appendix_api.html"].ids, f"{name} is not on the API page"


def test_images_have_alt_text(parsed):
    for page, content in parsed.items():
        for image in content.images:
            assert (image.get("alt") or "").strip(), (page, image.get("src", "")[:80])


@pytest.mark.parametrize("page", CHAPTERS)
def test_equations_carry_the_numbers_of_the_document(page):
    text = (HTML / page).read_text(encoding="utf-8")
    shown = re.findall(r'id="equation-eq-(\d+)">\s*(?:<span id="[^"]*"></span>)?\s*<span class="eqno">\((\d+)\)<', text)
    assert all(label == number for label, number in shown)
    assert len(shown) == len(re.findall(r'id="equation-eq-\d+"', text))


@pytest.fixture
def visit(browser, site):
    """Open a page in a fresh context; collects requests to other sites and console errors."""
    contexts = []

    def visit(page, width=1280, scheme="light", javascript=True):
        context = browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=scheme, java_script_enabled=javascript
        )
        contexts.append(context)
        tab = context.new_page()
        tab.foreign, tab.errors = [], []
        tab.on("request", lambda r: r.url.startswith((site, "data:", "blob:")) or tab.foreign.append(r.url))
        tab.on("console", lambda message: message.type == "error" and tab.errors.append(message.text))
        tab.on("pageerror", lambda error: tab.errors.append(str(error)))
        tab.goto(f"{site}/{page}", wait_until="load")
        if javascript and tab.locator("div.math, span.math").count():
            tab.wait_for_function("window.MathJax && MathJax.startup && MathJax.startup.promise", timeout=60_000)
            tab.evaluate("MathJax.startup.promise")
        return tab

    yield visit
    for context in contexts:
        context.close()


@pytest.mark.parametrize("page", PAGES)
def test_a_page_stands_on_its_own(page, visit):
    tab = visit(page)
    assert tab.foreign == [] and tab.errors == []
    blocks = tab.locator("div.math, span.math").count()
    assert tab.locator("mjx-container").count() >= blocks
    assert tab.locator("mjx-merror").count() == 0
    visible = tab.locator("article").inner_text()
    assert not re.search(r"\\\(|\\\[|\\frac|\$\$|:::|\{eq\}|\{prf:", visible)


def test_every_claim_is_told_in_words(visit):
    tab = visit("book/appendix_claims.html")
    told = tab.locator("table.claims tbody tr td:last-child").all_inner_texts()
    assert len(told) >= 115
    for text in told:
        assert len(text.split()) >= 5 and not re.search(r"\*\*|\$|<[a-z/]", text), text


CUT_OFF = """() => [...document.querySelectorAll("article *")].filter(e => {
    const box = e.getBoundingClientRect();
    if (!box.width || box.right <= innerWidth + 1 || e.closest("mjx-assistive-mml")) return false;
    for (let p = e.parentElement; p.tagName != "ARTICLE"; p = p.parentElement)
        if (["auto", "scroll"].includes(getComputedStyle(p).overflowX)) return false;
    return true;
}).map(e => e.outerHTML.slice(0, 120))"""  # beyond the right edge, and nothing around it scrolls


@pytest.mark.parametrize("width", [1280, 360, 320])
@pytest.mark.parametrize("page", PAGES)
def test_nothing_is_wider_than_the_page(page, width, visit):
    tab = visit(page, width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate(CUT_OFF) == []


ONE_OF_A_LOOK = """() => {
    const looks = new Set(), again = [];
    for (const e of document.querySelectorAll("pre span")) {
        let ground = e;
        while (ground && getComputedStyle(ground).backgroundColor == "rgba(0, 0, 0, 0)") ground = ground.parentElement;
        const {color, fontSize, fontWeight} = getComputedStyle(e);
        const look = [color, fontSize, fontWeight, ground && getComputedStyle(ground).backgroundColor].join();
        if (looks.has(look)) again.push(e); else looks.add(look);
    }
    for (const e of again) e.replaceWith(...e.childNodes);
}"""  # of words of code that look the same one is enough: axe takes a fifth of the time


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("page", PAGES)
def test_no_accessibility_violation(page, scheme, visit):
    from axe_playwright_python.sync_playwright import Axe

    tab = visit(page, scheme=scheme)
    tab.evaluate(f"document.documentElement.dataset.theme = '{scheme}'")
    tab.wait_for_timeout(400)  # colours change over a moment
    tab.evaluate(ONE_OF_A_LOOK)
    options = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"], "resultTypes": ["violations"]}
    found = Axe().run(tab, options=options).response["violations"]
    assert [(v["id"], [node["html"][:160] for node in v["nodes"][:3]]) for v in found] == []


def frames(tab, index):
    """For one explore figure: which of its frames is visible."""
    return (
        tab.locator(".explore")
        .nth(index)
        .locator(".frame")
        .evaluate_all(
            "all => all.map((f, i) => [i, getComputedStyle(f).display]).filter(f => f[1] != 'none').map(f => f[0])"
        )
    )


MOVING = [page for page in PAGES if 'class="explore"' in (HTML / page).read_text(encoding="utf-8")]


@pytest.mark.parametrize("javascript", [True, False], ids=["with script", "without script"])
@pytest.mark.parametrize("page", MOVING)
def test_controls_move_every_figure(page, javascript, visit):
    tab = visit(page, javascript=javascript)
    for index in range(tab.locator(".explore").count()):
        figure = tab.locator(".explore").nth(index)
        assert frames(tab, index) == [0]
        for row in range(figure.locator("fieldset").count()):
            before = frames(tab, index)
            knobs = figure.locator("fieldset").nth(row).locator("input")
            knobs.first.focus()
            tab.keyboard.press("ArrowRight")
            assert knobs.nth(1).is_checked()
            after = frames(tab, index)
            assert len(after) == 1 and after != before
            knobs.first.click()
            assert frames(tab, index) == before


def test_the_chapters_have_moving_figures():
    assert set(CHAPTERS) <= set(MOVING)
