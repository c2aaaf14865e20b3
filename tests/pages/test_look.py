"""Printed pages as pictures: one of each thing that pages are made of, beside what it looked like."""

import os
import sys
from pathlib import Path

import numpy as np
import pages
import pdf
import pypdfium2
import pytest
import yaml
from PIL import Image

pytestmark = pytest.mark.pages
PICTURES = Path(__file__).with_name("paper")
LOOK = 3  # mean difference of greys, of 255: 0.02 on one machine; code torn, frames in a column, other margins: 8 to 16
SHAPE = "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 600 300'><path d='{}' {}/></svg>"
BARS = "fill='none' stroke='black' stroke-width='6'"


def drawn(n):
    return SHAPE.format(f"M20 280 L{150 * n} 20 L580 280 Z", BARS).replace("<", "%3C").replace(">", "%3E")


def code(lines, kind="highlight-python"):
    return f'<div class="{kind} notranslate"><div class="highlight"><pre>{lines}</pre></div></div>'


def cell(lines, shown=""):
    shown = shown and f'<div class="cell_output">{shown}</div>'
    return f'<div class="cell"><div class="cell_input">{code(lines)}</div>{shown}</div>'


def article(title, body):
    return f'<article class="bd-article"><section id="top"><h1>{title}</h1>{body}</section></article>'


def specimen(typeset):
    """{page: its HTML}: one of each thing that pages are made of, in the form in which they have it."""
    words = "An agent acts, the world answers, and what was learned is kept for the next time. " * 4
    inline = f'<span class="math">{typeset(r"v(s) = r + 0.9 v(t)", False)}</span>'
    block = typeset(r"v(s) = \sum_a p(a) \left( r + \frac{1}{2} v(t) \right)", True)
    display = f'<div class="math" id="e"><span class="eqno">(1.7)</span>{block}</div>'
    frames = "".join(
        f'<div class="frame f{n}{" first" * (n == 1)}"><img alt="{n}" src="{drawn(n)}"></div>' for n in range(4)
    )
    knobs = "".join(f"<input{' checked' * (n == 1)}><label>{n}</label>" for n in range(4))
    moving = (
        f'<div class="explore"><div class="title">A figure</div><fieldset class="ordered"><legend>n</legend>{knobs}'
    )
    moving = f'<div class="cell"><div class="cell_output">{moving}</fieldset>{frames}</div></div></div>'
    still = f'<div class="cell"><div class="cell_output"><img alt="still" src="{drawn(2)}"></div></div>'
    caption = f'<div class="caption"><p><strong>Figure 1.</strong> {words}</p></div>'
    rows = "".join(f"<tr><td><p>state {n}</p></td><td><p>{n / 10}</p></td></tr>" for n in range(8))
    table = f'<table class="table"><thead><tr><th>state</th><th>value</th></tr></thead><tbody>{rows}</tbody></table>'
    title = '<p class="admonition-title">{}</p>'
    box = f'<div class="proof algorithm admonition">{title.format("Algorithm 1.1")}<ol><li>{words}</li></ol></div>'
    listing = "\n".join(f"    total_{n} = first + {n} * second  # a line of code" for n in range(24))
    tabs = f"""<div class="sd-tab-set"><label class="sd-tab-label">Pseudocode</label>
<div class="sd-tab-content">{box}</div><label class="sd-tab-label">rlcore</label>
<div class="sd-tab-content">{code(listing)}</div></div>"""
    link = '<a class="reference internal" href="#later">later</a>, <a href="exercises/01_x.html">exercises</a>'
    verdict = f'<p><span class="verdict false">false</span> {words}</p>'
    chapter = f"""<p>{words * 2}{inline}, {link}.</p>{display}<p>{words}</p>{moving}{caption}
<section id="later"><h2>1.1. Later</h2><p>{words * 3}</p>{cell("for n in range(3):", code("0 1 2", "output"))}
<p>{words * 6}</p>{tabs}<ul><li><p>{words}</p></li></ul></section>
<section id="last"><h2>1.2. Last</h2>{table}{still}{caption}
<div class="tip admonition">{title.format("Pitfall")}<p>{words}</p></div></section>"""
    folds = f"<details><summary>Hint 1</summary><p>{words}</p></details><details><summary>Solution</summary>"
    folds += code("answer = 2") + "</details>"
    exercises = f'<section id="a"><h2>1. First</h2><p>{words}</p>{cell("answer = ...")}{folds}</section>'
    record = f'<p><a class="reference internal" href="../01_x.html#e">equation (1.7)</a></p>{verdict}{display}'
    return {
        "01_x": article("1. A chapter", chapter),
        "exercises/01_x": article("Exercises", exercises),
        "record/01_x": article("Record of a chapter", record),
    }


@pytest.mark.xdist_group("paper sample A4")
def test_pages_look_as_they_did(browsers, built, tmp_path):
    """Pages with one of each thing beside their pictures in tests/pages/paper; LOOK=new makes these anew."""
    sys.path.insert(0, str(pages.ROOT / "book" / "_ext"))
    from companion.mathematics import Typesetter

    config = yaml.safe_load((pages.ROOT / "_config.yml").read_text(encoding="utf-8"))
    typeset = Typesetter(config["sphinx"]["config"]["mathjax3_config"]).typeset
    (tmp_path / "html").mkdir()
    (tmp_path / "html" / "_static").symlink_to(built / "_static")
    listed = {
        "book": [("book/01_x", "Chapters"), ("book/exercises/01_x", "Exercises")],
        "record": [("book/record/01_x", "Record")],
    }
    for name, text in specimen(typeset).items():
        path = tmp_path / "html" / "book" / f"{name}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    made = pdf.make(browsers["dejavu"], "A4", tmp_path / "html", tmp_path / "out", listed)
    shown = [("book", n) for n in (3, 5, 6, 7, 9, 11)] + [("record", 5)]
    found = {}
    for volume, n in shown:
        page = pypdfium2.PdfDocument(made[volume])[n - 1].render(scale=0.5, grayscale=True).to_pil()
        kept = PICTURES / f"{volume}-{n}.png"
        if os.environ.get("LOOK") == "new":
            kept.parent.mkdir(exist_ok=True)
            page.save(kept, optimize=True)
        images = [image.convert("L").resize((74, 105)) for image in (page, Image.open(kept))]
        new, old = (np.asarray(image, dtype=float) for image in images)
        found[kept.name] = np.abs(new - old).mean()
    assert max(found.values()) < LOOK, found
