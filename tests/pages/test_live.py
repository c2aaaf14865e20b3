"""Live pages in Chromium: cells that run and print what the page shows, exercises that are checked, what is kept, what
is missing. Skipped where the book is built without them (make live)."""

import contextlib
import gzip
import io
import json
import re
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import HTML, PAGES, ROOT
from test_live_cells import NEEDS

from rlcore.exercises import CHAPTERS

FOLDER = next(iter(sorted(HTML.glob("live/*/"))), None)
pytestmark = [
    pytest.mark.pages,
    pytest.mark.xdist_group("live"),
    pytest.mark.skipif(FOLDER is None, reason="the book is built without live pages: make live"),
]
CHAPTER, EXERCISES = "book/04_temporal_difference.html", "book/exercises/04_temporal_difference.html"
LIVE_PAGES = [page for page in PAGES if re.match(r"book/(0[1-8]_|exercises/)", page)]
ENDED = r"/^(Done|Ended|Stopped|Python|A cell|Another|The editor)/"
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21aa", "wcag22aa"]}
OPEN = {"include": [["div.cell:has(.cm-content)"], [".live-bar"]]}
VERDICTS = """
import json
from rlcore.exercises import CHAPTERS
rows = []
for e in CHAPTERS["{name}"].__dict__.values():
    if type(e).__name__ == "Exercise":
        for source in (e.solution, e.stub, *(w.source for w in e.wrong)):
            rows.append((e.id, str(check(e.id, e.bind(source)))))
print(json.dumps(rows))
"""


class Tab:
    """A page with live cells."""

    def __init__(self, browser, site, page, **context):
        self.tab = browser.new_context(**context).new_page()
        self.tab.set_default_timeout(600_000)  # a net, not a measure
        self.seen, self.errors = [], []
        self.tab.on("request", lambda request: self.seen.append(request.url))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.site, self.address = site, f"{site}/{page}"

    def open(self):
        self.tab.goto(self.address, wait_until="load")
        return self

    def cell(self, n):
        return self.tab.evaluate_handle("n => liveCells[n]", n).as_element()

    def find(self, words):
        found = self.tab.evaluate(
            "w => liveCells.findIndex(c => c.querySelector('pre').textContent.includes(w))", words
        )
        assert found >= 0, words
        return found

    def status(self, n):
        return self.cell(n).query_selector(".live-bar > [role=status]")

    def press(self, n, word):
        """Press a button of a cell, and wait until what it began has ended; what the page then says."""
        self.tab.evaluate(
            "c => { for (let d = c; d = d.closest('details:not([open])'); ) d.open = true;"
            "c.querySelectorAll('details').forEach(d => { d.open = true }) }",
            self.cell(n),
        )
        button = next(b for b in self.cell(n).query_selector_all(".live-bar button") if b.inner_text() == word)
        if word in ("Run", "Check"):
            self.tab.evaluate("s => { s.textContent = '' }", self.status(n))
        button.click()
        return self.ended(n) if word in ("Run", "Check", "Edit and run") else None

    def ended(self, n):
        self.tab.wait_for_function(f"s => {ENDED}.test(s.textContent)", arg=self.status(n))
        return self.status(n).inner_text()

    def write(self, n, code):
        self.cell(n).query_selector(".cm-content").click()
        self.tab.keyboard.press("Control+a")
        self.tab.keyboard.press("Delete")
        self.tab.keyboard.insert_text(code)

    def text(self, n):
        output = self.cell(n).query_selector(".cell_output")
        return output.inner_text().strip() if output else ""

    def answer(self, n, code):
        """What the page says to an answer that is written into cell n."""
        if self.cell(n).query_selector(".cm-content") is None:
            self.press(n, "Answer here")
            self.tab.wait_for_function("c => c.querySelector('.cm-content')", arg=self.cell(n))
        self.write(n, code)
        self.press(n, "Check")
        return self.text(n + 1)


@pytest.fixture
def new(browsers, site):
    opened = []

    def start(page, **context):
        opened.append(Tab(browsers["dejavu"], site, page, **context))
        return opened[-1]

    yield start
    for one in opened:
        one.tab.context.close()


@pytest.fixture(scope="module")
def chapter(browsers, site):
    one = Tab(browsers["dejavu"], site, CHAPTER).open()
    yield one
    one.tab.context.close()


@pytest.fixture(scope="module")
def exercises(browsers, site):
    one = Tab(browsers["dejavu"], site, EXERCISES).open()
    yield one
    one.tab.context.close()


def opened(one, words):
    """The number of the cell with these words, in its editor."""
    n = one.find(words)
    if one.cell(n).query_selector(".cm-content") is None:
        one.press(n, "Edit and run")
    return n


def test_a_page_that_nobody_clicks_on_costs_two_kilobytes(new):
    one = new(CHAPTER).open()
    asked = {url.split("/")[-1] for url in one.seen if "/live/" in url}
    assert asked == {"hook.js", "live.css"} and all(url.startswith((one.site, "data:", "blob:")) for url in one.seen)
    assert sum(len(gzip.compress((FOLDER / name).read_bytes())) for name in asked) < 2048


def test_cells_print_what_the_page_shows(chapter):
    for words in ("against the next guess", "sum of squares", "first_updates(sarsa, cliff"):
        n = chapter.find(words)
        stored = chapter.text(n)
        assert chapter.press(n, "Edit and run").startswith("Done in"), chapter.text(n)
        assert chapter.text(n) == stored
    assert chapter.errors == [] and all(url.startswith((chapter.site, "data:", "blob:")) for url in chapter.seen)


def test_a_changed_cell_shows_its_own_numbers_and_figures(chapter):
    n = opened(chapter, "against the next guess")
    chapter.write(n, "import matplotlib.pyplot as plt\nplt.plot(legs_of_mine := [1, 4, 9])\nprint(sum(legs_of_mine))")
    chapter.press(n, "Run")
    assert "14" in chapter.text(n)
    image = chapter.cell(n).query_selector(".cell_output img")
    assert image.get_attribute("alt") == "The figure that this cell drew"  # not what the unchanged one showed
    assert image.evaluate("i => i.decode().then(() => i.naturalWidth)") > 300
    chapter.write(n, "def f(x):\n    return 1 / x\nf(0)")
    assert chapter.press(n, "Run").startswith("Ended with an error")
    assert "line 2, in f" in chapter.text(n) and "ZeroDivisionError" in chapter.text(n)
    assert "shell.py" not in chapter.text(n) and "pyodide" not in chapter.text(n)
    chapter.press(n, "Undo changes")
    chapter.press(n, "Run")
    assert "sum 13.0" in chapter.text(n)


def test_an_edit_above_reaches_what_builds_on_it(chapter):
    above, n = opened(chapter, "against the next guess"), opened(chapter, "sum of squares")
    chapter.write(n, "print(mark + 1)")
    for mark in (1, 2):
        chapter.write(above, f"mark = {mark}")
        assert chapter.press(n, "Run").startswith("Done") and chapter.text(n) == str(mark + 1)
    chapter.write(above, "mark = (")
    assert chapter.press(n, "Run").startswith("A cell that this one builds on ended with an error")
    assert "SyntaxError" in chapter.text(n)
    chapter.press(above, "Undo changes")
    chapter.press(n, "Undo changes")


def test_an_explorer_is_drawn_anew_and_moves(chapter):
    n = chapter.find("stories = ")
    chapter.press(n, "Edit and run")
    panel = chapter.cell(n).query_selector(".explore")
    assert len(chapter.cell(n).query_selector_all(".explore")) == 1
    shown = "p => [...p.querySelectorAll('.frame')].filter(f => f.getClientRects().length).map(f => f.className)"
    before = panel.evaluate(shown)
    panel.evaluate("p => p.querySelectorAll('input[type=radio]')[1].click()")
    assert len(before) == len(panel.evaluate(shown)) == 1 and before != panel.evaluate(shown)


def test_the_browsers_python_finds_the_same_needs(chapter):
    """Its symbol tables are those of another version."""
    cells, needed = zip(*NEEDS)
    n = opened(chapter, "against the next guess")
    code = f"cells = json.loads({json.dumps(json.dumps(cells))})\nprint([analyse(some)[0][-1] for some in cells])"
    chapter.write(n, f"import json\nfrom needs import analyse\n{code}")
    assert chapter.press(n, "Run").startswith("Done") and json.loads(chapter.text(n)) == list(needed)
    chapter.press(n, "Undo changes")


def test_an_endless_loop_is_stopped_and_python_starts_again(chapter):
    n = opened(chapter, "against the next guess")
    chapter.write(n, "print('begun', flush=True)\nwhile True:\n    pass")
    chapter.tab.keyboard.press("Shift+Enter")
    chapter.tab.wait_for_function(
        "c => c.querySelector('.cell_output').textContent.includes('begun')", arg=chapter.cell(n)
    )
    chapter.press(n, "Stop")
    assert chapter.ended(n).startswith("Stopped")
    chapter.write(n, "print(legs_again := 2)")
    assert chapter.press(n, "Run").startswith("Done") and chapter.text(n) == "2"


def test_the_keyboard_and_every_width_and_colour(chapter):
    n = opened(chapter, "against the next guess")
    chapter.write(n, "")
    chapter.tab.keyboard.type("print(1 / 4, 'a?b')")
    chapter.press(n, "Run")
    assert chapter.text(n) == "0.25 a?b"
    chapter.cell(n).query_selector(".cm-content").focus()
    chapter.tab.keyboard.press("Tab")
    assert chapter.tab.evaluate("document.activeElement.textContent") == "Run"
    for scheme in ("light", "dark"):
        chapter.tab.evaluate("s => { document.documentElement.dataset.theme = s }", scheme)
        found = Axe().run(chapter.tab, context=OPEN, options=RULES).response["violations"]
        assert [(v["id"], [node["target"] for node in v["nodes"]]) for v in found] == []
    chapter.tab.evaluate("document.documentElement.dataset.theme = 'light'")
    chapter.tab.set_viewport_size({"width": 360, "height": 800})
    assert chapter.tab.evaluate("document.documentElement.scrollWidth") <= 360
    chapter.tab.set_viewport_size({"width": 1280, "height": 900})


def test_answers_are_checked_by_the_same_checker(exercises):
    n = exercises.find("chances = ...")
    assert exercises.answer(n, "chances = 0.925, 0.025, 1 - 0.975 ** 10") == "passed: right"
    assert "added" in exercises.answer(n, "chances = 0.925, 0.025, 0.25")  # the usual mistake
    assert exercises.answer(n, "chances = 3, 2, 1").startswith("failed: part 0")
    assert "ZeroDivisionError" in exercises.answer(n, "chances = 1 / 0")
    assert "SyntaxError" in exercises.answer(n, "chances = (")
    assert "here it is" in exercises.answer(n, "print('here it is')\nchances = 1")
    assert exercises.answer(n, "chances = ...").startswith("not attempted")


def test_an_answer_that_never_ends_is_stopped_with_the_usual_words(exercises):
    n = exercises.find("def td0_update")
    said = exercises.answer(n, "def td0_update(V, s, r, s_next, terminated, alpha, gamma):\n    while True: pass")
    assert said == "error: stopped after 20 s of computing: is there a loop that never ends?"


def test_the_verdicts_are_those_of_any_python(exercises):
    n = opened(exercises, "from rlcore.exercises import check")
    same_verdicts(exercises, n, "ch04_td")


def same_verdicts(one, n, name):
    code = VERDICTS.replace("{name}", name)
    one.write(n, code)
    assert one.press(n, "Run").startswith("Done"), one.text(n)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(code, {})
    here, there = json.loads(out.getvalue()), json.loads(one.text(n).splitlines()[-1])
    assert [(id, said.split("Traceback")[0]) for id, said in there] == [
        (id, said.split("Traceback")[0]) for id, said in here
    ]


def test_what_was_written_is_kept_in_this_browser(new):
    one = new(EXERCISES).open()
    n = one.find("chances = ...")
    one.answer(n, "chances = 0.925, 0.025, 1 - 0.975 ** 10")
    assert one.tab.query_selector(".live-kept").inner_text().startswith("1 of ")
    one.answer(n, "chances = 1 / 0")
    assert one.tab.query_selector(".live-kept").inner_text().startswith("0 of ")  # an error is no pass
    one.answer(n, "chances = 0.925, 0.025, 1 - 0.975 ** 10")
    one.open()
    one.tab.wait_for_selector(".live-kept")
    assert "0.975" in one.cell(n).query_selector(".cm-content").inner_text()
    with one.tab.expect_download() as got:
        one.tab.get_by_role("button", name="Download as notebook").click()
    notebook = json.loads(Path(got.value.path()).read_text(encoding="utf-8"))
    assert any("0.975" in "".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code")
    one.tab.get_by_role("button", name="Forget").click()
    one.tab.wait_for_function("() => window.liveCells && !document.querySelector('.live-kept')")
    assert one.tab.evaluate(
        "localStorage.length === 0 || !Object.keys(localStorage).some(k => k.startsWith('answers'))"
    )


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (
            "Object.defineProperty(window, 'localStorage', {get() { throw new DOMException('no', 'SecurityError') }})",
            "keeps nothing",
        ),
        ("localStorage.setItem('answers ' + location.pathname, '{cut')", "kept in this browser only"),
    ],
    ids=["no storage", "what was kept is broken"],
)
def test_answers_are_checked_where_none_can_be_kept(new, script, words):
    one = new(EXERCISES)
    one.tab.add_init_script(script)
    one.open()
    n = one.find("chances = ...")
    assert one.answer(n, "chances = 0.925, 0.025, 1 - 0.975 ** 10").startswith("passed")
    assert one.tab.query_selector(".live-kept").inner_text().startswith("1 of ")
    assert set(one.errors) <= {"no"}  # those of the theme
    assert words in one.tab.query_selector(".live-kept").inner_text()
    one.tab.get_by_role("button", name="Forget").click()
    one.tab.wait_for_function("() => window.liveCells && !document.querySelector('.live-kept')")


def test_hints_and_the_solution_unfold(exercises):
    n = exercises.find("chances = ...")
    exercises.answer(n, "chances = 1")
    opened = """check => {
        let open = 0;
        for (let one = check.nextElementSibling; one?.matches("details"); one = one.nextElementSibling)
            open += one.open;
        return open;
    }"""
    before = exercises.cell(n + 1).evaluate(opened)
    exercises.press(n, "Hint")
    assert exercises.cell(n + 1).evaluate(opened) == before + 1
    exercises.press(n, "Solution")
    assert exercises.cell(n + 1).evaluate(opened) == before + 2


@pytest.mark.parametrize(
    "name", ["pyodide.asm.wasm.gz", "pyodide.mjs", "python_stdlib.zip", "numpy.zip", "plots.zip", "rlcore.zip"]
)
@pytest.mark.parametrize("how", ["missing", "changed"])
def test_a_file_that_is_not_the_right_one_is_named(new, name, how):
    if (name, how) == ("rlcore.zip", "changed"):
        pytest.skip("our own file, beside the page: whoever changes it can change the page")
    one = new(CHAPTER, service_workers="block")  # whose requests no test can change
    body = {"missing": {"status": 404, "body": ""}, "changed": {"status": 200, "body": "something else"}}[how]
    one.tab.route(re.compile(rf"/{re.escape(name)}$"), lambda route: route.fulfill(**body))
    n = one.open().find("against the next guess")
    stored, said = one.text(n), one.press(n, "Edit and run")
    assert name in said and said.startswith("Python cannot run here") and one.text(n) == stored
    one.tab.unroute_all()
    assert one.press(n, "Run").startswith("Done")


@pytest.mark.parametrize("name", ["live.js", "codemirror-view.js"])
def test_without_the_editor_the_page_stays_as_it_is(new, name):
    one = new(CHAPTER, service_workers="block")
    one.tab.route(re.compile(rf"/{name}$"), lambda route: route.fulfill(status=404, body=""))
    n = one.open().find("against the next guess")
    stored = one.text(n)
    assert one.press(n, "Edit and run") == "The editor could not be fetched." and one.text(n) == stored


@pytest.mark.parametrize("why", ["no script", "no WebAssembly", "a file"])
def test_where_it_cannot_work_there_is_no_button(new, why):
    one = new(CHAPTER, java_script_enabled=why != "no script")
    if why == "no WebAssembly":
        one.tab.add_init_script("delete globalThis.WebAssembly")
    if why == "a file":
        one.address = (HTML / CHAPTER).as_uri()
    one.open()
    assert one.tab.query_selector(".live-bar") is None
    assert one.tab.query_selector(".cell_output") is not None


def test_the_next_visit_needs_no_network(new):
    one = new(CHAPTER).open()
    n = one.find("against the next guess")
    one.press(n, "Edit and run")
    one.tab.wait_for_function("() => navigator.serviceWorker.controller !== null")
    one.tab.wait_for_function("() => caches.open('book').then(c => c.match(location.href.split('#')[0])).then(Boolean)")
    one.tab.context.set_offline(True)
    one.open()
    assert one.press(n, "Edit and run").startswith("Done")


# ---------------------------------------------------------------- the whole book, weekly


@pytest.mark.slow
@pytest.mark.parametrize("page", LIVE_PAGES)
def test_every_cell_prints_what_the_page_shows(new, page):
    """The slow ones, too; none leaves Python with more than 800 MB."""
    differs = json.loads((ROOT / "book" / "_live" / "differs.json").read_text(encoding="utf-8"))
    one, problems = new(page).open(), []
    for n in range(one.tab.evaluate("liveCells.length")):
        bar = one.cell(n).query_selector(".live-bar button")
        if bar is None or bar.inner_text() != "Edit and run":
            continue
        stored = one.text(n) if one.cell(n).query_selector(".cell_output .explore") is None else None
        said = one.press(n, "Edit and run")
        if not said.startswith("Done") or (stored is not None and one.text(n) != stored):
            problems.append((n, said, stored, one.text(n)))
    titles = one.tab.evaluate("[...document.querySelectorAll('.live-bar > [role=status]')].map(s => s.title)")
    held = [int(found[1]) for title in titles if (found := re.search(r"(\d+) MB", title))]
    wrong = [p for p in problems if f"{page}, cell {p[0] + 1}" not in differs]
    assert wrong == [] and max(held, default=0) < 800


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CHAPTERS))
def test_every_verdict_is_that_of_any_python(exercises, name):
    n = opened(exercises, "from rlcore.exercises import check")
    same_verdicts(exercises, n, name)
