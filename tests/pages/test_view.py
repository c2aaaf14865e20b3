"""The built pages in headless Chromium: whole in three settings of fonts and at every width, controls that
move figures, accessibility, no request to any other site. A page is opened
once for a setting; every test leaves it as it was."""

import re

import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import CHAPTERS, HTML, PAGES

pytestmark = pytest.mark.pages
# Fonts of the site; none of any site, DejaVu installed; none of any site and none installed.
SETTINGS = ("site fonts", "DejaVu", "no font")
WIDTH, HEIGHT = 1280, 900
MOVING = [page for page in PAGES if 'class="explore"' in (HTML / page).read_text(encoding="utf-8")]


def views(pages, settings):
    """Parameters of the tests that share a page: those of one page run one after the other, in one process."""
    return [
        pytest.param((page, setting), id=f"{page}, {setting}", marks=pytest.mark.xdist_group(page))
        for setting in settings
        for page in pages
    ]


every_view = pytest.mark.parametrize("view", views(PAGES, SETTINGS), indirect=True)
every_page = pytest.mark.parametrize("view", views(PAGES, SETTINGS[:1]), indirect=True)


def visit(browser, address, **options):
    """A tab with the page in a context of its own, and what it asked of other sites and complained of."""
    tab = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}, **options).new_page()
    site = address[: address.index("/book/")]
    tab.foreign, tab.errors = [], []
    tab.on("request", lambda r: r.url.startswith((site, "data:", "blob:")) or tab.foreign.append(r.url))
    tab.on("console", lambda message: message.type == "error" and tab.errors.append(message.text))
    tab.on("pageerror", lambda error: tab.errors.append(str(error)))
    return tab


SHIFT = """() => new Promise(done => {
    let sum = 0;
    new PerformanceObserver(list => list.getEntries().forEach(shift => { sum += shift.value })).observe({
        type: "layout-shift", buffered: true });
    requestAnimationFrame(() => requestAnimationFrame(() => done(sum)));
})"""


@pytest.fixture(scope="module")
def view(request, browsers, site):
    page, setting = request.param
    tab = visit(browsers["none" if setting == "no font" else "dejavu"], f"{site}/{page}")
    if setting != "site fonts":
        tab.route(re.compile(r"\.(woff2?|ttf)\b"), lambda route: route.fulfill(status=200, body=""))
    tab.goto(f"{site}/{page}", wait_until="load")
    tab.own, tab.moved = setting == "site fonts", tab.evaluate(SHIFT)
    yield tab
    tab.context.close()


@every_view
def test_a_page_stands_on_its_own(view):
    assert view.foreign == []
    assert [error for error in view.errors if view.own or "decode downloaded font" not in error] == []
    visible = view.locator("article").inner_text()
    assert not re.search(r"\\\(|\\\[|\\frac|\$\$|:::|\{eq\}|\{prf:", visible)


def test_every_claim_is_told_in_words(browsers, site):
    tab = visit(browsers["dejavu"], f"{site}/book/appendix_claims.html")
    tab.goto(f"{site}/book/appendix_claims.html")
    told = tab.locator("table.claims tbody tr td:last-child").all_inner_texts()
    tab.context.close()
    assert len(told) >= 115
    for text in told:
        assert len(text.split()) >= 5 and not re.search(r"\*\*|\$|<[a-z/]", text), text


CUT = """() => [...document.querySelectorAll("article :is(mjx-math, :not(mjx-container *))")].filter(e => {
    const box = e.getBoundingClientRect(), formula = e.tagName == "MJX-MATH";
    if (!box.width || (box.right <= innerWidth + 1 && !formula)) return false;
    for (let p = e.parentElement; p.tagName != "ARTICLE"; p = p.parentElement) {
        const {overflowX} = getComputedStyle(p);
        if (["auto", "scroll"].includes(overflowX)) return false;
        if (formula && overflowX != "visible" && box.right > p.getBoundingClientRect().right + 1) return true;
    }
    return box.right > innerWidth + 1;
}).map(e => e.outerHTML.slice(0, 120))"""  # beyond the edge of the window or of what hides it; nothing there scrolls
NO_BAR = """() => [...document.querySelectorAll("article :not(mjx-container *)")].filter(e =>
    e.scrollWidth > e.clientWidth + 1 && e.clientWidth && ["auto", "scroll"].includes(getComputedStyle(e).overflowX)
    && e.offsetHeight - e.clientHeight - 2 * e.clientTop < 6
).map(e => e.outerHTML.slice(0, 120))"""  # scrolls sideways, and nothing shows that it does


@pytest.mark.parametrize("width, text", [(WIDTH, 100), (640, 200), (360, 100), (320, 100)])
@every_view
def test_nothing_is_wider_than_the_page(view, width, text):
    view.set_viewport_size({"width": width, "height": HEIGHT})
    view.evaluate("size => document.documentElement.style.fontSize = size", f"{text}%")
    wide, cut, bare = view.evaluate("document.documentElement.scrollWidth"), view.evaluate(CUT), view.evaluate(NO_BAR)
    view.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    view.evaluate("document.documentElement.style.fontSize = ''")
    assert (wide <= width, cut, bare) == (True, [], [])


@every_page
def test_text_is_set_in_the_fonts_of_the_site(view):
    view.evaluate("document.fonts.ready")
    session = view.context.new_cdp_session(view)
    for command in ("DOM.enable", "CSS.enable"):
        session.send(command)
    root = session.send("DOM.getDocument", {"depth": 0})["root"]["nodeId"]
    for selector in ("article h1", "article p", "article code", "article pre span"):
        node = session.send("DOM.querySelector", {"nodeId": root, "selector": selector})["nodeId"]
        used = session.send("CSS.getPlatformFontsForNode", {"nodeId": node})["fonts"] if node else []
        assert all(font["isCustomFont"] for font in used), (selector, used)


# What axe says of contrast depends on looks alone: one word of a look, and a formula's text for the formula.
ONE_OF_A_LOOK = """() => {
    for (const e of document.querySelectorAll("article mjx-container")) e.replaceWith(e.textContent);
    const looks = new Set(), again = [];
    for (const e of document.querySelectorAll("article :is(pre span, code, td)")) {
        let ground = e;
        while (ground && getComputedStyle(ground).backgroundColor == "rgba(0, 0, 0, 0)") ground = ground.parentElement;
        const {color, fontSize, fontWeight} = getComputedStyle(e), behind = ground && getComputedStyle(ground);
        const look = [e.tagName, color, fontSize, fontWeight, behind?.backgroundColor].join();
        if (looks.has(look)) again.push(e); else looks.add(look);
    }
    for (const e of again) e.replaceWith(...e.childNodes);
}"""
STANDARD = {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}
CONTRAST = {"runOnly": {"type": "rule", "values": ["color-contrast"]}, "resultTypes": ["violations"]}
OTHERS = {"runOnly": STANDARD, "rules": {"color-contrast": {"enabled": False}}, "resultTypes": ["violations"]}


def violations(tab, options):
    found = Axe().run(tab, options=options).response["violations"]
    return [(v["id"], [node["html"][:160] for node in v["nodes"][:3]]) for v in found]


def show(tab, scheme):
    tab.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    tab.evaluate("scheme => document.documentElement.dataset.theme = scheme", scheme)
    tab.evaluate("Promise.all(document.getAnimations().map(animation => animation.finished.catch(() => {})))")


@every_page
def test_no_accessibility_violation(view):
    show(view, "light")
    assert violations(view, OTHERS) == []


@every_page
def test_colours_can_be_told_from_their_ground(view):
    view.evaluate("() => { window.kept = document.querySelector('article').innerHTML }")
    show(view, "light")
    view.evaluate(ONE_OF_A_LOOK)
    found = {"light": violations(view, CONTRAST)}
    view.evaluate("() => { document.querySelector('article').innerHTML = window.kept }")
    show(view, "dark")
    view.evaluate(ONE_OF_A_LOOK)
    found["dark"] = violations(view, CONTRAST)
    view.evaluate("() => { document.querySelector('article').innerHTML = window.kept }")
    show(view, "light")
    assert found == {"light": [], "dark": []}


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@every_page
def test_no_accessibility_violation_in_any_element(view, scheme):
    show(view, scheme)
    found = violations(view, {"runOnly": STANDARD, "resultTypes": ["violations"]})
    show(view, "light")
    assert found == []


def frames(figure):
    """Which frames of a moving figure are visible."""
    return figure.locator(".frame").evaluate_all(
        "all => all.map((f, i) => [i, getComputedStyle(f).display]).filter(f => f[1] != 'none').map(f => f[0])"
    )


def controls_move(tab):
    for figure in tab.locator(".explore").all():
        assert frames(figure) == [0]
        for row in figure.locator("fieldset").all():
            knobs = row.locator("input")
            knobs.first.focus()
            tab.keyboard.press("ArrowRight")
            assert knobs.nth(1).is_checked()
            after = frames(figure)
            assert len(after) == 1 and after != [0]
            knobs.first.click()
            assert frames(figure) == [0]


@pytest.mark.parametrize("view", views(MOVING, SETTINGS[:1]), indirect=True)
def test_controls_move_every_figure(view):
    controls_move(view)


@pytest.mark.parametrize("page", [pytest.param(page, marks=pytest.mark.xdist_group(page)) for page in PAGES])
def test_a_page_is_whole_without_script(page, browsers, site):
    tab = visit(browsers["dejavu"], f"{site}/{page}", java_script_enabled=False)
    tab.goto(f"{site}/{page}", wait_until="load")
    controls_move(tab)
    tab.set_viewport_size({"width": 320, "height": HEIGHT})
    wide, cut, bare = tab.evaluate("document.documentElement.scrollWidth"), tab.evaluate(CUT), tab.evaluate(NO_BAR)
    tab.context.close()
    assert (wide <= 320, cut, bare) == (True, [], [])


@every_page
def test_the_first_view_does_not_move(view):
    assert view.moved < 0.1  # which the web's usual measure (CLS) calls good


@pytest.mark.parametrize("page", [pytest.param(page, marks=pytest.mark.xdist_group(page)) for page in CHAPTERS])
def test_the_first_view_on_a_phone_does_not_move(page, browsers, site):
    tab = visit(browsers["dejavu"], f"{site}/{page}")
    tab.set_viewport_size({"width": 360, "height": HEIGHT})
    tab.goto(f"{site}/{page}", wait_until="load")
    moved = tab.evaluate(SHIFT)
    tab.context.close()
    assert moved < 0.1


def test_the_chapters_have_moving_figures():
    assert set(CHAPTERS) <= set(MOVING)
