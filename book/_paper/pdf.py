"""The book as PDF, in two volumes, out of the pages that `make book` built: printed by Chromium.

python book/_paper/pdf.py A4 Letter     _build/paper/book-A4.pdf, record-A4.pdf, book-Letter.pdf, record-Letter.pdf

Chromium knows no page numbers of places, so a volume is printed until the numbers that stand in it are those of the
places they name: twice, as a rule.
"""

import datetime
import os
import re
import subprocess
import sys
from html import escape
from pathlib import Path

import chromium
import pikepdf
import yaml
from fontTools.ttLib import TTFont
from fontTools.varLib import instancer
from pages import HTML, OUT, ROOT, Volumes, ids, mathml, new, words
from playwright.sync_api import sync_playwright
from speech import said

SIZES = {"A4": (210, 297), "Letter": (215.9, 279.4)}  # width, height in mm
MARGINS = {"top": 24, "bottom": 20, "left": 23, "right": 23}
COLUMN = 164  # mm of text on the narrower of the two
WEIGHTS = 400, 600, 700
CODE = 8.2, 0.6  # points of code, and the width of its letters in their height
VOLUMES = {"book": "Chapters and exercises", "record": "Record: claims, errata, concordance, functions"}
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
LICENCE = (
    "Text, figures and code are under the MIT licence: they may be copied, changed and printed, the notice with them."
)
FORMULA = "Formula: "  # begins the text of a picture that is one
FACES = (
    "The typefaces are cut from Adobe's Source family and from DejaVu, under the SIL Open Font License and DejaVu's."
)


def date():
    """Day of the build, or the one that SOURCE_DATE_EPOCH says."""
    now = os.environ.get("SOURCE_DATE_EPOCH")
    return datetime.datetime.fromtimestamp(int(now), datetime.UTC).date() if now else datetime.date.today()


def revision():
    """The commit that the pages were made from, where there is git."""
    asked = subprocess.run(["git", "rev-parse", "--short=10", "HEAD"], cwd=ROOT, capture_output=True, text=True)
    return asked.stdout.strip()


def version():
    return re.search(r'^__version__ = "(.+)"$', (ROOT / "rlcore" / "__init__.py").read_text(encoding="utf-8"), re.M)[1]


def citation():
    by, title = CITATION["authors"][0]["name"], CITATION["title"]
    return f"{by}, {title}, version {version()}, {date().year}"


# ---------------------------------------------------------------------- one file of HTML


def formula(html):
    """A formula as it is shown, with what it says as the text of the picture."""
    text = escape(said(mathml(html)))
    html = re.sub(r"<mjx-assistive-mml.*</mjx-assistive-mml>", "", html, flags=re.S).replace(' aria-hidden="true"', "")
    return html.replace("<mjx-container", f'<mjx-container role="img" aria-label="{FORMULA}{text}"', 1)


def prepare(page):
    """What only paper needs: wide code in smaller type, places for page numbers, addresses of links that lead out."""
    for block in page.article.select("pre"):
        columns = max(map(len, block.get_text().splitlines()), default=0)
        points = COLUMN * 72 / 25.4 - 16
        if columns * CODE[0] * CODE[1] > points:
            block["style"] = f"font-size: {points / columns / CODE[1]:.2f}pt"
    for a in page.article.select("a.inside, a.to-record"):
        section, target = a.find_parent("section", id=True), a["href"]
        if section is None or f"#{section['id']}" != target:
            a.append(new("span", cls="page-of", data_to=target))
    for a in page.article.select("a.outside"):
        address = re.sub(r"^https?://", "", a["href"])
        if address.rstrip("/") not in re.sub(r"^https?://", "", a.get_text()):
            a.insert_after(new("span", f" ({address})", cls="address"))
    for n in range(5, 0, -1):  # the part is level 1
        for heading in page.article.find_all(f"h{n}"):
            heading.name = f"h{n + 1}"


def contents(pages):
    out, part = [], None
    for page in pages:
        if page.part != part:
            part = page.part
            out.append(line("part", f"part-{slug_of(part)}", part))
        deep = page.part == "Chapters"
        for heading in page.article.find_all(["h2", "h3"] if deep else "h2"):
            out.append(line(heading.name, heading.find_parent("section")["id"], words(heading)))
    return "\n".join(out)


def line(kind, target, text):
    number, rest = re.match(r"((?:\d+\.)*) ?(.*)", text, re.S).groups()
    return (
        f'<p class="toc-{kind}"><a href="#{target}"><span class="number">{number.rstrip(".")}</span>'
        f'<span class="words">{escape(rest)}</span><span class="dots"></span>'
        f'<span class="page-of" data-to="#{target}"></span></a></p>'
    )


def slug_of(part):
    return part.lower().replace(" ", "-")


def assemble(volumes, volume, size, faces):
    """The HTML of one volume on one size of paper."""
    pages, title = volumes.pages[volume], CITATION["title"]
    body, rules, part = [], [], None
    for page in pages:
        if page.part != part:
            part = page.part
            body.append(f'<section class="part" id="part-{slug_of(part)}"><h1>{escape(part)}</h1></section>')
        head = page.title if page.part != "Hints and solutions" else f"Hints and solutions: {page.title}"
        running = re.sub(r'["\\]', "", head)
        rules.append(
            f'.p-{page.slug} {{ page: p-{page.slug} }} @page p-{page.slug} {{ @top-left {{ content: "{running}" }} }}'
        )
        for image in page.article.find_all("img", src=re.compile("^_")):
            image["src"] = f"{volumes.html.as_uri()}/{image['src']}"
        inner = volumes.put_back(page.article.decode_contents(), formula)
        body.append(
            f'<article class="page {slug_of(part or "front")} p-{page.slug}" id="{page.slug}">{inner}</article>'
        )
    width, height = SIZES[size]
    margins = " ".join(f"{MARGINS[side]}mm" for side in ("top", "right", "bottom", "left"))
    front = f"""<section class="title" id="title"><p class="booktitle">{escape(title)}</p>
<p class="volume">{VOLUMES[volume]}</p><p class="author">{escape(CITATION["authors"][0]["name"])}</p>
<p class="version">Version {version()}, {date():%-d %B %Y}</p></section>
<section class="imprint" id="imprint"><p>{escape(" ".join(CITATION["abstract"].split()))}</p>
<p><strong>Version.</strong> {version()}, {date():%-d %B %Y}{", commit " + revision() if revision() else ""}.</p>
<p><strong>Volumes.</strong> {"; ".join(f"<em>{name}</em>: {what}" for name, what in VOLUMES.items())}.
A number beside a link is the page that it leads to; one after the name of the other volume is a page of that.</p>
<p><strong>Figures that move</strong> on the page of the site stand here as a telling picture, or as up to four.</p>
<p><strong>To cite.</strong> {escape(citation())}.</p>
<p><strong>Licence.</strong> {LICENCE} {FACES}</p></section>
<nav class="contents" id="contents"><h1>Contents</h1>
{contents(pages)}
</nav>"""
    # a link makes its target a named place of the file, even a link that is not printed
    targets = [id for page in pages for id in (page.slug, *sorted(ids(page)))]
    wanted = "".join(f'<a href="#{id}"></a>' for id in targets)
    static = f"{volumes.html.as_uri()}/_static"
    css = Path(__file__).with_name("print.css").read_text(encoding="utf-8")
    return f"""<!DOCTYPE html>
<html lang="en" data-theme="light"><head><meta charset="utf-8"><title>{escape(title)}</title>
<link rel="stylesheet" href="{static}/mathjax.css"><link rel="stylesheet" href="{static}/pygments.css">
<style>
@page {{ size: {width}mm {height}mm; margin: {margins}; @top-right {{ content: "{escape(title)}" }} }}
{faces}
{css}
{chr(10).join(rules)}
</style></head><body>
{front}
{chr(10).join(body)}
<div hidden>{wanted}</div>
</body></html>"""


def cast(fonts, out):
    """Faces of one weight from the site's, which have all: a PDF can embed no others as they are."""
    out.mkdir(exist_ok=True)
    rules = []
    for path in sorted(fonts.glob("*.woff2")):
        family, style = f"Companion {path.stem.split('-')[0].title()}", "italic" if "italic" in path.stem else "normal"
        for weight in WEIGHTS:
            face = out / f"{path.stem}-{weight}.ttf"
            font = instancer.instantiateVariableFont(TTFont(path), {"wght": weight})
            font.flavor = None
            font["name"].setName(f"{family.replace(' ', '')}-{weight}{style[0]}", 6, 3, 1, 0x409)
            font.save(face)
            about = f'font-family: "{family}"; font-weight: {weight}; font-style: {style}'
            rules.append(f'@font-face {{ {about}; src: url("{face.as_uri()}") }}')
    return "\n".join(rules)


# ---------------------------------------------------------------------- print

# A formula, a table or a picture that is wider than its column is set smaller.
FIT = """() => {
    const found = [];
    for (const e of document.querySelectorAll("mjx-container")) {
        const block = e.closest("div.math, p, li, td, dd") ?? e.parentElement, number = block.querySelector(".eqno");
        const room = block.clientWidth - (number?.offsetWidth + 8 || 0);
        const wide = Math.max(...[...e.querySelectorAll("mjx-math")].map(m => m.getBoundingClientRect().width));
        if (room > 0 && wide > room) found.push([e, room / wide]);
    }
    for (const [e, ratio] of found) e.style.setProperty("font-size", 105 * ratio + "%", "important");
    return found.length;
}"""
# MathJax's signs are drawn by CSS alone; a file with tags needs text, so each sign gets what its rule writes.
SIGNS = """css => {
    const all = [...document.querySelectorAll("mjx-c")];
    const signs = all.map(e => getComputedStyle(e, "::before").content.replace(/^"|"$/g, "").replace(/\\\\(.)/g, "$1"));
    all.forEach((e, i) => { e.append(Object.assign(document.createElement("mjx-g"), {textContent: signs[i]})) });
    document.querySelector("link[href$='mathjax.css']").remove();
    document.head.prepend(Object.assign(document.createElement("style"), {textContent: css}));
}"""
NUMBER = """pages => {
    const moved = [];
    for (const e of document.querySelectorAll(".page-of")) {
        const text = e.closest(".to-record") ? pages[e.dataset.to]?.replace(/^\\w+ /, "") : pages[e.dataset.to];
        if (e.textContent != text) moved.push(e.dataset.to);
        e.textContent = text ?? "";
    }
    return moved;
}"""
HEADINGS = """() => [...document.querySelectorAll("h1, h2, h3, h4, h5, h6")].map(h => {
    const copy = h.cloneNode(true);
    for (const e of copy.querySelectorAll("mjx-container")) e.replaceWith(e.ariaLabel);
    return copy.textContent;
})"""


def places(pdf):
    """{id: number of its page} of the places that links lead to."""
    with pikepdf.open(pdf) as file:
        numbers = {page.objgen: n for n, page in enumerate(file.pages, 1)}
        found = pikepdf.NameTree(file.Root.Names.Dests) if "/Names" in file.Root else file.Root.Dests
        return {name.lstrip("/"): numbers[place[0].objgen] for name, place in found.items()}


class Printer:
    """One volume in a tab of Chromium, to be printed again with the numbers of its pages."""

    def __init__(self, browser, source, html, pdf, volume):
        self.pdf, self.volume = pdf, volume
        self.tab = browser.new_page()
        self.tab.set_default_timeout(600_000)
        self.failed = []
        self.tab.on("requestfailed", lambda request: self.failed.append(request.url[:200]))
        self.tab.emulate_media(media="print")
        self.tab.set_viewport_size({"width": int(COLUMN * 96 / 25.4), "height": 1000})
        self.tab.goto(html.as_uri(), wait_until="load")
        css = (source / "_static" / "mathjax.css").read_text(encoding="utf-8").replace("::before", " > mjx-g")
        self.tab.evaluate(SIGNS, css.replace("mathjax/", f"{source.as_uri()}/_static/mathjax/"))
        self.tab.evaluate("document.fonts.ready.then(() => true)")
        self.tab.evaluate(FIT)
        if self.failed:
            raise RuntimeError(f"{html.name}: not found: {', '.join(self.failed[:5])}")
        self.headings = self.tab.evaluate(HEADINGS)

    def print(self):
        self.tab.pdf(path=str(self.pdf), prefer_css_page_size=True, print_background=True, tagged=True, outline=True)
        return places(self.pdf)


def make(browser, size, html=HTML, out=OUT, listed=None):
    """Both volumes on one size of paper; {volume: path}."""
    out.mkdir(parents=True, exist_ok=True)
    volumes = Volumes(html, listed)
    if volumes.lost and listed is None:
        raise RuntimeError(f"links lead nowhere: {volumes.lost[:5]}")
    printers, faces = [], cast(volumes.html / "_static" / "fonts", out / "fonts")
    for volume, pages in volumes.pages.items():
        for page in pages:
            prepare(page)
        path = out / f"{volume}-{size}.html"
        path.write_text(assemble(volumes, volume, size, faces), encoding="utf-8")
        printers.append(Printer(browser, volumes.html, path, out / f"{volume}-{size}.pdf", volume))
    for _ in range(5):
        found = {printer.volume: printer.print() for printer in printers}
        if not any([printer.tab.evaluate(NUMBER, names(found, printer.volume)) for printer in printers]):
            break
    else:
        raise RuntimeError(f"{size}: the numbers of pages do not settle")
    for printer in printers:
        finish(printer, size)
    return {printer.volume: printer.pdf for printer in printers}


def names(found, volume):
    """{link: what stands beside it} in one volume: a page, or volume and page."""
    own = {f"#{name}": str(number) for name, number in found[volume].items()}
    others = {
        f"{other}:#{name}": f"{other} {number}"
        for other, places in found.items()
        if other != volume
        for name, number in places.items()
    }
    return own | others


def finish(printer, size):
    """Titles of the outline, links between the volumes, what the file says about itself; smaller."""
    with pikepdf.open(printer.pdf, allow_overwriting_input=True) as pdf:
        with pdf.open_outline() as outline:
            headings = iter(printer.headings)
            rename(outline.root, headings)
        for page in pdf.pages:
            for note in page.get("/Annots", ()):
                action = note.get("/A", {})
                if "/URI" in action and (found := re.match(r"(\w+):#(.+)", str(action.URI))) and found[1] in VOLUMES:
                    note.A = pdf.make_indirect(
                        pikepdf.Dictionary(
                            S=pikepdf.Name.GoToR, F=pikepdf.String(f"{found[1]}-{size}.pdf"), D=pikepdf.String(found[2])
                        )
                    )
        for element in pdf.objects:
            if isinstance(element, pikepdf.Dictionary) and str(element.get("/Alt", "")).startswith(FORMULA):
                element.S, element.Alt = pikepdf.Name.Formula, pikepdf.String(str(element.Alt).removeprefix(FORMULA))
        with pdf.open_metadata() as meta:
            meta["dc:title"] = f"{CITATION['title']}: {VOLUMES[printer.volume]}"
            meta["dc:creator"] = [CITATION["authors"][0]["name"]]
            meta["dc:language"] = ["en"]
        pdf.docinfo["/Author"] = CITATION["authors"][0]["name"]
        pdf.docinfo["/Title"] = f"{CITATION['title']}: {VOLUMES[printer.volume]}"
        pdf.Root.ViewerPreferences = pikepdf.Dictionary(DisplayDocTitle=True)
        pdf.Root.PageMode = pikepdf.Name.UseOutlines
        pdf.save(printer.pdf, object_stream_mode=pikepdf.ObjectStreamMode.generate, recompress_flate=True)


def rename(items, headings):
    """The headings themselves: Chromium drops the space where a line of one ends."""
    for item in items:
        item.title = " ".join(next(headings).split())
        rename(item.children, headings)


if __name__ == "__main__":
    with sync_playwright() as playwright, chromium.browser(playwright, chromium.dejavu()) as browser:
        for size in sys.argv[1:]:
            for path in make(browser, size).values():
                print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e6:.1f} MB", flush=True)
