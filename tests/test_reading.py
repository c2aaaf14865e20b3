"""What the PDF and the EPUB make of a page: formulas in words, tabs, folds, figures that move, links, numbers."""

import bundle
import epub
import pages
import pytest
import speech

MATH = '<math xmlns="http://www.w3.org/1998/Math/MathML">{}</math>'
V = "<msub><mi>v</mi><mi>π</mi></msub>"


@pytest.mark.parametrize(
    "inner, text",
    [(f"{V}<mo>(</mo><msup><mi>s</mi><mo>′</mo></msup><mo>)</mo>", "v_π(s')"),
     (f"<msup><mi>γ</mi><mn>2</mn></msup><mo>⋅</mo><mfrac>{V}<mrow><mn>1</mn><mo>−</mo><mi>γ</mi></mrow></mfrac>",
      "γ^2 · (v_π)/(1 − γ)"),
     ("<munderover><mo>∑</mo><mrow><mi>k</mi><mo>=</mo><mn>0</mn></mrow><mi>∞</mi></munderover><mi>x</mi>",
      "sum from k = 0 to ∞ of x"),
     ("<munder><mo>∑</mo><mi>a</mi></munder><msubsup><mi>x</mi><mi>t</mi><mrow><mi>n</mi><mo>+</mo><mn>1</mn></mrow>"
      "</msubsup>", "sum over a of x_t^(n + 1)"),
     ("<munder><mo>max</mo><mi>a</mi></munder><mi>q</mi>", "max_a q"),
     ("<mrow><mover><mi>A</mi><mo>^</mo></mover></mrow><mo>≐</mo><msqrt><mi>n</mi></msqrt>",
      "A-hat is defined as root of (n)"),
     ("<mtable><mtr><mtd><mi>a</mi></mtd><mtd><mtext>one</mtext></mtd></mtr><mtr><mtd><mi>b</mi></mtd></mtr></mtable>",
      "a one ; b"),
     ("<mi>a</mi><mo>←</mo><mi>b</mi><mo>,</mo><mi>c</mi>", "a becomes b, c")],
)  # fmt: skip
def test_formulas_are_said(inner, text):
    assert speech.said(MATH.format(inner)) == text


@pytest.mark.parametrize(
    "n, start, picked",
    [(1, 0, [0]), (4, 2, [0, 1, 2, 3]), (7, 3, [0, 3, 4, 6]), (7, 0, [0, 2, 4, 6]), (20, 19, [0, 6, 13, 19]),
     (20, 8, [0, 8, 13, 19])],
)  # fmt: skip
def test_up_to_four_frames_are_shown_with_the_telling_one_among_them(n, start, picked):
    assert pages.spread(n, start) == picked


CHAPTER = """<article><section id="a"><h1>1. One</h1><p>By <span class="math"><mjx-container><mjx-assistive-mml>{v}
</mjx-assistive-mml></mjx-container></span>. <span class="on-screen">Click.</span> See <a class="reference internal"
href="exercises/01_x.html#e1">1.1</a>, <a class="to-record reference" href="record/01_x.html#r">r</a>,
<a href="01_x.html#b">here</a>, <a href="https://example.org/">there</a>, <a href="nowhere.html">lost</a>,
<a href="#no">lost</a>.</p><p><span id="b"></span><span id="unused"></span></p>
<div class="math" id="eq"><span class="eqno">(1.7)<sup>r</sup></span></div>
<div class="cell"><details class="hide"><summary>Show</summary><div class="cell_input"><pre>x = 1</pre></div></details>
</div><div class="cell"><div class="cell_output"><div class="explore"><div class="title">T</div>
<fieldset class="ordered"><legend>n</legend><input type="radio"><label>1</label><input checked type="radio">
<label>2</label></fieldset>
<div class="frame f0"><img alt="one" src="../_images/1.png"></div><div class="frame f1 first"><img alt="two"
src="data:,2"></div></div></div></div><div class="caption"><p>Figure 1.</p></div>
<div class="sd-tab-set"><input id="t0"><label class="sd-tab-label">Pseudocode</label><div class="sd-tab-content">
<div class="proof"><p>box</p></div></div><input id="t1"><label class="sd-tab-label">rlcore</label>
<div class="sd-tab-content"><pre>def f(): ...</pre></div></div></section></article>""".replace("{v}", MATH.format(V))
EXERCISES = """<article><section id="x"><h1>Exercises</h1><p><span id="e1"></span></p><section id="first">
<h2>1. First</h2><p>Do <a href="../01_x.html">equation (1.7)</a>.</p>
<div class="cell"><div class="cell_input"><pre>y = ...</pre></div></div>
<div class="cell tag_check-e1"><div class="cell_input"><pre>check("e1", y)</pre></div></div>
<details><summary>Hint 1</summary><p>Think.</p></details>
<details><summary>Solution</summary><pre>y = 2</pre></details></section><section id="q"><h2>Questions</h2>
<p><strong>Question 1.</strong> Why?</p><details><summary>a) This</summary><p>No.</p></details><details>
<summary>b) That</summary><p>Yes.</p></details></section></section></article>"""
RECORD = """<article><section id="z"><h1>Record</h1><p><span id="r"></span><a href="../01_x.html#b">c</a></p></section>
</article>"""
LISTED = {
    "book": [("book/01_x", "Chapters"), ("book/exercises/01_x", "Exercises")],
    "record": [("book/record/01_x", "Record")],
}


@pytest.fixture(scope="module")
def volumes(tmp_path_factory):
    html = tmp_path_factory.mktemp("html")
    for name, text in {"01_x": CHAPTER, "exercises/01_x": EXERCISES, "record/01_x": RECORD}.items():
        path = html / "book" / f"{name}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"<html><body><nav>no</nav>{text}</body></html>", encoding="utf-8")
    return pages.Volumes(html, LISTED)


def spoken(tag):
    return " ".join(tag.get_text(" ").split())


def article(volumes, n):
    return volumes.pages["book"][n].article


def test_links_lead_within_a_volume_or_to_the_other_and_what_leads_nowhere_is_told(volumes):
    found = {pages.words(a): (a["href"], a["class"][0]) for a in article(volumes, 0).select("a")}
    assert found == {
        "1.1": ("#exercises-01-x--e1", "inside"),
        "r": ("record:#record-01-x--r", "to-record"),
        "here": ("#01-x--b", "inside"),
        "there": ("https://example.org/", "outside"),
    }
    assert volumes.lost == [("book/01_x", "nowhere.html"), ("book/01_x", "#no")]
    assert {tag["id"] for tag in article(volumes, 0).select("[id]")} == {"01-x--a", "01-x--b", "01-x--eq"}
    (equation,) = [a["href"] for a in article(volumes, 1).select("p:not(.leads) > a")]
    assert equation == "#01-x--eq"


def test_a_formula_is_text_until_it_is_put_back_and_keeps_its_point(volumes):
    assert pages.words(article(volumes, 0).select_one(".kept")) == "v_π."
    whole = volumes.put_back(str(article(volumes, 0)), lambda html: f"[{pages.mathml(html)}]")
    assert f"[{MATH.format(V)}]</span>.</span>" in whole and "x-math" not in whole


def test_what_is_for_the_screen_goes_and_tabs_are_open(volumes):
    text = pages.words(article(volumes, 0))
    assert "Click" not in text and "x = 1" not in text and not article(volumes, 0).select("input, .cell:empty, details")
    assert len(article(volumes, 0).select(".cell")) == 1
    assert [pages.words(tag) for tag in article(volumes, 0).select(".tab-name")] == ["rlcore"]


def test_a_figure_that_moves_is_its_frames_with_what_they_show_and_its_caption(volumes):
    (figure,) = article(volumes, 0).select(".figure")
    assert spoken(figure) == "T n = 1 n = 2 Figure 1."
    assert [(image["alt"], image["src"]) for image in figure.select("img")] == [
        ("one", "_images/1.png"),
        ("two", "data:,2"),
    ]


def test_of_many_frames_the_telling_one_is_left_with_the_choices():
    frames = "".join(
        f'<div class="frame f{i}-{j}{" first" * ((i, j) == (1, 0))}"><img alt="{i}{j}" src="data:,"></div>'
        for i in range(2)
        for j in range(3)
    )
    rows = "".join(
        f"<fieldset><legend>{name}</legend>"
        + "".join(f"<input{' checked' * (i == on)}><label>{v}</label>" for i, v in enumerate(values))
        + "</fieldset>"
        for name, values, on in (("method", ("TD", "MC"), 1), ("n", ("1", "2", "3"), 0))
    )
    panel = pages.BeautifulSoup(f'<div class="explore"><div class="title">T</div>{rows}{frames}</div>', "lxml").div
    figure = pages.still(panel)
    assert [image["alt"] for image in figure.select("img")] == ["10"]
    assert pages.words(figure.select_one(".choice")) == "method: MC; n = 1"
    assert "all 6 pictures" in pages.words(figure) and "method: TD, MC; n: 1, 2, 3" in pages.words(figure)


def test_hints_and_solutions_stand_at_the_back_and_each_leads_to_the_other(volumes):
    exercises, answers = volumes.pages["book"][1:]
    assert (answers.part, answers.title) == ("Hints and solutions", "Exercises")
    text = spoken(exercises.article)
    assert "Think" not in text and "check(" not in text and "y = ..." in text and "a) This b) That" in text
    first, questions = (spoken(entry) for entry in answers.article.select(".answer"))
    assert first == "1. First Exercise Hint 1. Think. Solution. y = 2"
    assert questions == "Questions Exercise Question 1. a) This. No. b) That. Yes."
    there = [a["href"] for a in exercises.article.select(".leads a")]
    back = [a["href"] for a in answers.article.select(".leads a")]
    assert there == ["#exercises-01-x-answers--answer-1", "#exercises-01-x-answers--answer-2"]
    assert back == ["#exercises-01-x--first", "#exercises-01-x--q"]


def test_every_page_of_the_contents_is_in_one_volume():
    listed = pages.volumes()
    named = [name for entries in listed.values() for name, _ in entries]
    toc = pages.yaml.safe_load((pages.ROOT / "_toc.yml").read_text(encoding="utf-8"))
    files = [toc["root"], *(chapter["file"] for part in toc["parts"] for chapter in part["chapters"])]
    assert sorted(named) == sorted(files)
    assert all(name in files or name == "Record" for name in pages.RECORD)


def test_the_bundle_asks_for_no_font_that_a_disk_refuses():
    kept = b'<link rel="preload" as="style" href="a.css"><p>'
    assert (
        bundle.PRELOAD.sub(b"", b'<link rel="preload" as="font" type="font/woff2" href="f.woff2" crossorigin>' + kept)
        == kept
    )


@pytest.mark.parametrize(
    "sign, variant, shown",
    [("E", "double-struck", "𝔼"), ("R", "double-struck", "ℝ"), ("A", "script", "𝒜"), ("R", "script", "ℛ"),
     ("θ", "bold-italic", "𝜽"), ("1", "bold", "𝟏"), ("+", "bold", "+")],
)  # fmt: skip
def test_readers_see_the_style_of_a_letter(sign, variant, shown):
    inner = f'<mi mathvariant="{variant}" data-mjx-variant="-tex">{sign}</mi>'
    namespace = ' xmlns="http://www.w3.org/1998/Math/MathML"'
    assert epub.formula(MATH.format(inner)) == f'<math{namespace} alttext="{sign}"><mi>{shown}</mi></math>'
