"""The built pages in headless Chromium: whole in three settings of fonts and at every width, controls that
move figures, accessibility, no request to any other site. A page is opened
once for a setting; every test leaves it as it was."""

import re

import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import CHAPTERS, HTML, PAGES, ROOT

from rlcore import plots
from rlcore.explore import explore
from rlcore.plots import style

pytestmark = pytest.mark.pages
# Fonts of the site; none of any site, DejaVu installed; none of any site and none installed.
SETTINGS = ("site fonts", "DejaVu", "no font")
WIDTH, HEIGHT = 1280, 900
MOVING = [page for page in PAGES if 'class="explore"' in (HTML / page).read_text(encoding="utf-8")]


def views(pages, settings):
    """Parameters of the tests that share a page: those of one page run one after the other, in one process."""
    slow = {"no font": [pytest.mark.slow]}
    return [
        pytest.param((page, at), id=f"{page}, {at}", marks=[pytest.mark.xdist_group(page), *slow.get(at, [])])
        for at in settings
        for page in pages
    ]


every_view = pytest.mark.parametrize("view", views(PAGES, SETTINGS), indirect=True)
every_page = pytest.mark.parametrize("view", views(PAGES, SETTINGS[:1]), indirect=True)


@pytest.fixture(scope="module")
def tabs(browsers, site):
    """A tab for each setting; open(page, setting) leads it to a page, with what the page asks for and complains of."""
    tabs = {}

    def new(setting):
        browser = browsers["none" if setting == "no font" else "dejavu"]
        tab = browser.new_context(java_script_enabled=setting != "no script").new_page()
        tab.set_default_timeout(600_000)  # a net, not a measure: machines may be busy
        if setting in ("DejaVu", "no font"):
            tab.route(re.compile(r"\.(woff2?|ttf)\b"), lambda route: route.fulfill(status=200, body=""))
        tab.foreign, tab.errors = [], []
        tab.on("request", lambda r: r.url.startswith((site, "data:", "blob:")) or tab.foreign.append(r.url))
        tab.on("console", lambda message: message.type == "error" and tab.errors.append(message.text))
        tab.on("pageerror", lambda error: tab.errors.append(str(error)))
        return tab

    def open(page, setting, width=WIDTH):
        tab = tabs.get(setting) or tabs.setdefault(setting, new(setting))
        tab.goto("about:blank")
        tab.foreign.clear()
        tab.errors.clear()
        tab.set_viewport_size({"width": width, "height": HEIGHT})
        tab.goto(f"{site}/{page}", wait_until="load")
        return tab

    yield open
    for tab in tabs.values():
        tab.context.close()


SHIFT = """() => new Promise(done => {
    let sum = 0;
    new PerformanceObserver(list => list.getEntries().forEach(shift => { sum += shift.value })).observe({
        type: "layout-shift", buffered: true });
    requestAnimationFrame(() => requestAnimationFrame(() => done(sum)));
})"""


@pytest.fixture(scope="module")
def view(request, tabs):
    page, setting = request.param
    tab = tabs(page, setting)
    tab.own, tab.moved = setting == "site fonts", tab.evaluate(SHIFT)
    return tab


@every_view
def test_a_page_stands_on_its_own(view):
    assert view.foreign == []
    assert [error for error in view.errors if view.own or "decode downloaded font" not in error] == []
    visible = view.locator("article").inner_text()
    assert not re.search(r"\\\(|\\\[|\\frac|\$\$|:::|\{eq\}|\{prf:", visible)


def test_every_claim_is_told_in_words(tabs):
    told = (
        tabs("book/appendix_claims.html", "no script").locator("table.claims tbody tr td:last-child").all_inner_texts()
    )
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
NO_BAR = """() => [...document.querySelectorAll("article :not(mjx-container *)")].filter(e => {
    if (e.scrollWidth <= e.clientWidth + 1 || !["auto", "scroll"].includes(getComputedStyle(e).overflowX)) return false;
    e.scrollLeft = 1e6;
    const moved = e.scrollLeft;
    e.scrollLeft = 0;
    const room = 1 + parseFloat(getComputedStyle(e).paddingRight);
    return moved > room && e.offsetHeight - e.clientHeight - 2 * e.clientTop < 6;
}).map(e => e.outerHTML.slice(0, 120))"""  # scrolls sideways by more than its padding, and nothing shows that it does
SIZES = ((WIDTH, 100), (640, 200), (360, 100), (320, 100))  # width of the window, size of the text in percent


@every_view
def test_nothing_is_wider_than_the_page(view):
    found = {}
    for width, text in SIZES:
        view.set_viewport_size({"width": width, "height": HEIGHT})
        view.evaluate("size => document.documentElement.style.fontSize = size", f"{text}%" if text != 100 else "")
        wide = view.evaluate("document.documentElement.scrollWidth")
        found[width, text] = wide <= width, view.evaluate(CUT), view.evaluate(NO_BAR)
    view.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    assert found == dict.fromkeys(SIZES, (True, [], []))


def other_fonts(tab):
    """Fonts that are not the site's, in text of every kind."""
    session = tab.context.new_cdp_session(tab)
    for command in ("DOM.enable", "CSS.enable"):
        session.send(command)
    root = session.send("DOM.getDocument", {"depth": 0})["root"]["nodeId"]
    found = []
    for selector in ("article h1", "article p", "article em", "article code", "article pre span"):
        node = session.send("DOM.querySelector", {"nodeId": root, "selector": selector})["nodeId"]
        used = session.send("CSS.getPlatformFontsForNode", {"nodeId": node})["fonts"] if node else []
        found += [(selector, font["familyName"]) for font in used if not font["isCustomFont"]]
    session.detach()
    return found


@every_page
def test_text_is_set_in_the_fonts_of_the_site(view):
    for _ in range(100):  # a font that comes late is not shown until the next look at a page
        if not (others := other_fonts(view)):
            break
        view.reload()
    assert others == []


# What axe says of contrast depends on looks alone: of the texts that look the same it gets one, and of formulas a text.
ONE_OF_A_LOOK = """() => {
    for (const e of document.querySelectorAll("article mjx-container")) e.replaceWith(e.textContent);
    const looks = new Set(), again = [];
    for (const e of document.querySelectorAll("article *")) {
        const texts = [...e.childNodes].filter(node => node.nodeType == Node.TEXT_NODE && node.data.trim());
        if (!texts.length) continue;
        let ground = e;
        while (ground && getComputedStyle(ground).backgroundColor == "rgba(0, 0, 0, 0)") ground = ground.parentElement;
        const {color, fontSize, fontWeight, opacity} = getComputedStyle(e), behind = ground && getComputedStyle(ground);
        const look = [e.tagName, color, fontSize, fontWeight, opacity, behind?.backgroundColor].join();
        if (looks.has(look)) again.push(...(e.children.length ? texts : [e])); else looks.add(look);
    }
    for (const node of again) node.remove();
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
    tab.evaluate("document.getAnimations().forEach(a => a.effect.getComputedTiming().endTime < Infinity && a.finish())")


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


DRAWN = """() => [...document.querySelectorAll("article :is(.explore .first img, div.cell_output img)")]
    .filter(e => e.clientWidth && !e.closest("table")).map(e => {
        const {paddingLeft, paddingRight} = getComputedStyle(e);
        return Math.round(e.clientWidth - parseFloat(paddingLeft) - parseFloat(paddingRight));
    })"""  # width of each figure


@every_page
def test_still_and_moving_figures_have_one_width_and_type_that_a_phone_shows(view):
    widths = {}
    for width in (WIDTH, 360):
        view.set_viewport_size({"width": width, "height": HEIGHT})
        widths[width] = set(view.evaluate(DRAWN))
    view.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    assert all(len(found) <= 1 for found in widths.values())
    assert all(style.SMALL * found / (72 * style.WIDTH) >= 10 for found in widths[360])


@every_page
def test_figures_do_not_glare_on_a_dark_page(view):
    grounds = "all => [...new Set(all.map(e => getComputedStyle(e).filter))]"
    figures = view.locator("article :is(.explore img, div.cell_output img)")
    show(view, "dark")
    dark = figures.evaluate_all(grounds)
    view.emulate_media(media="print")
    printed = figures.evaluate_all(grounds)
    view.emulate_media(media="screen")
    show(view, "light")
    assert dark in ([], ["invert(0.93) hue-rotate(180deg)"]) and not any("invert" in filter for filter in printed)
    assert figures.evaluate_all(grounds) in ([], ["none"])


def frames(figure):
    """Which frames of a moving figure are visible."""
    return figure.locator(".frame").evaluate_all(
        "all => all.map((f, i) => [i, getComputedStyle(f).display]).filter(f => f[1] != 'none').map(f => f[0])"
    )


def controls_move(tab):
    for figure in tab.locator(".explore").all():
        first = frames(figure)
        assert len(first) == 1 and "first" in figure.locator(".frame").nth(first[0]).get_attribute("class").split()
        for row in figure.locator("fieldset").all():
            knobs, slider = row.locator("input[type=radio]"), row.locator("input[type=range]")
            (start,) = knobs.evaluate_all("all => all.flatMap((knob, i) => knob.checked ? [i] : [])")
            last = start == knobs.count() - 1
            (slider if slider.count() else knobs.nth(start)).focus()
            tab.keyboard.press("ArrowLeft" if last else "ArrowRight")
            assert knobs.nth(start + (-1 if last else 1)).is_checked()
            after = frames(figure)
            assert len(after) == 1 and after != first
            if slider.count():
                value = row.locator("input:checked + label").inner_text()
                assert slider.get_attribute("aria-valuetext") == row.locator(".value").inner_text() == value
                tab.keyboard.press("ArrowRight" if last else "ArrowLeft")
            else:
                knobs.nth(start).click()
            assert frames(figure) == first


@pytest.mark.slow
@pytest.mark.parametrize("view", views(MOVING, SETTINGS[:1]), indirect=True)
def test_controls_move_every_figure(view):
    controls_move(view)


PANEL = explore(plots.discount_weights, title="Weights", start={"gamma": 0.9}, gamma=[0, 0.5, 0.9, 0.99])
BARE = "<!doctype html><html lang='en'><title>A panel</title><style>{css}</style><main><h1>A panel</h1>{panel}</main>"
STATIC = ROOT / "book" / "_static"


@pytest.mark.parametrize("script", [True, False])
def test_many_numbers_are_a_slider_on_the_screen_where_there_is_a_script(browsers, script):
    tab = browsers["dejavu"].new_context(java_script_enabled=script).new_page()
    js = f"<script>{(STATIC / 'book.js').read_text('utf-8')}</script>"
    css = (STATIC / "book.css").read_text("utf-8")
    tab.set_content(BARE.format(css=css, panel=PANEL.to_html()) + js)
    row = tab.locator("fieldset")
    assert row.locator("input[type=range]").count() == script
    assert row.locator("label").evaluate_all("all => all.filter(e => e.offsetParent).length") == (0 if script else 4)
    controls_move(tab)
    if script:
        slider = row.get_by_role("slider", name="γ")
        assert slider.get_attribute("aria-valuetext") == row.locator(".value").inner_text() == "0.9"
        slider.press("End")
        assert frames(tab.locator(".explore")) == [3] and row.locator(".value").inner_text() == "0.99"
        assert violations(tab, {"runOnly": STANDARD}) == []
        tab.set_viewport_size({"width": 320, "height": HEIGHT})
        assert tab.evaluate("document.documentElement.scrollWidth") <= 320
    tab.emulate_media(media="print")
    assert not script or not slider.is_visible()
    assert row.locator("label").evaluate_all("all => all.filter(e => e.offsetParent).map(e => e.textContent)") == [
        "0.99" if script else "0.9"
    ]
    assert len(frames(tab.locator(".explore"))) == 1
    tab.context.close()


@pytest.mark.parametrize("page", [pytest.param(page, marks=pytest.mark.xdist_group(page)) for page in PAGES])
def test_a_page_is_whole_without_script(page, tabs):
    tab = tabs(page, "no script")
    controls_move(tab)
    tab.set_viewport_size({"width": 320, "height": HEIGHT})
    wide, cut, bare = tab.evaluate("document.documentElement.scrollWidth"), tab.evaluate(CUT), tab.evaluate(NO_BAR)
    assert (wide <= 320, cut, bare) == (True, [], [])


@pytest.mark.slow
@every_page
def test_the_first_view_does_not_move(view):
    assert view.moved < 0.1  # which the web's usual measure (CLS) calls good


@pytest.mark.slow
@pytest.mark.parametrize("page", [pytest.param(page, marks=pytest.mark.xdist_group(page)) for page in CHAPTERS])
def test_the_first_view_on_a_phone_does_not_move(page, tabs):
    assert tabs(page, "phone", 360).evaluate(SHIFT) < 0.1


def test_the_chapters_have_moving_figures():
    assert set(CHAPTERS) <= set(MOVING)
