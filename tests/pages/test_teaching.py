"""How a chapter that has a record looks at first sight, folds closed: words, equations, boxes, figures before code."""

import pytest
from conftest import HTML, PAGES

pytestmark = pytest.mark.pages
TAUGHT = [page for page in PAGES if (HTML / "book" / "record" / page.removeprefix("book/")).exists()]
WIDTH, HEIGHT = 1400, 1000
# Height of each kind of block, in pixels, and the longest stretch without words or an equation.
MEASURE = """() => {
    const kinds = {
        code: ".cell_input, .cell details.hide, .highlight-python, .highlight-sh", output: ".cell_output",
        figure: ".explore, .cell_output img", marks: "sup.to-record",
        words: "p, li, h1, h2, h3, h4, table, div.math, .sd-tab-set, .proof, .admonition, .caption",
    };
    const height = {}, teach = [];
    const article = document.querySelector("article");
    const outermost = selector => [...article.querySelectorAll(selector)].filter(e => {
        const box = e.getBoundingClientRect();
        return box.height > 0 && !e.parentElement.closest(selector);
    });
    for (const [kind, selector] of Object.entries(kinds)) height[kind] = 0;
    for (const e of outermost(kinds.words)) {
        if (e.closest(".cell")) continue;
        const box = e.getBoundingClientRect();
        height.words += box.height;
        teach.push([box.top, box.bottom]);
    }
    for (const e of outermost(kinds.figure)) height.figure += e.getBoundingClientRect().height;
    for (const e of outermost(".cell_output"))
        if (!e.querySelector("img")) height.output += e.getBoundingClientRect().height;
    for (const e of outermost(kinds.code))
        if (!e.closest(".sd-tab-set")) height.code += e.getBoundingClientRect().height;
    for (const e of outermost(kinds.marks))
        height.marks += e.getBoundingClientRect().height * e.offsetWidth / article.offsetWidth;
    teach.sort((a, b) => a[0] - b[0]);
    let gap = 0, end = teach[0][1];
    for (const [top, bottom] of teach) { gap = Math.max(gap, top - end); end = Math.max(end, bottom); }
    height.asserts = [...article.querySelectorAll("pre")].filter(e => /^\\s*assert /m.test(e.textContent)).length;
    return {...height, gap, all: article.getBoundingClientRect().height};
}"""


@pytest.fixture(scope="module")
def measured(browsers, site):
    tab = browsers["dejavu"].new_page(viewport={"width": WIDTH, "height": HEIGHT})
    tab.set_default_timeout(600_000)
    found = {}
    for page in TAUGHT:
        tab.goto(f"{site}/{page}", wait_until="load")
        found[page] = tab.evaluate(MEASURE)
    tab.close()
    return found


@pytest.mark.xdist_group("teaching")
@pytest.mark.parametrize("page", TAUGHT)
def test_a_chapter_is_read_not_audited(page, measured):
    m = measured[page]
    shown = m["words"] + m["figure"] + m["code"] + m["output"]
    teaches, runs = (m["words"] + m["figure"]) / shown, (m["code"] + m["output"]) / shown
    assert teaches >= 0.7 and runs <= 0.2 and m["marks"] / shown < 0.02 and m["asserts"] == 0, m
    assert m["gap"] <= 1000, m
