"""The built pages, made fit to be read where nothing moves, folds or is clicked: what the PDF and the EPUB are made of.

Nothing is built again and nothing is known of what the pages say: all goes by the classes and ids of their elements.
"""

import posixpath
import re
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import unquote

import yaml
from bs4 import BeautifulSoup, Comment, NavigableString, Tag
from speech import said

ROOT = Path(__file__).parents[2]
HTML, OUT = ROOT / "_build" / "html", ROOT / "_build" / "paper"
MAKER = BeautifulSoup("", "lxml")
FORMULA = re.compile(r"<mjx-container.*?</mjx-container>", re.S)
ON_SCREEN = "a.headerlink, button, script, style, .toctree-wrapper, .on-screen, details.hide, .sd-tab-set > input"
EMPTIED = ".cell:not(:has(.cell_input, .cell_output))"
AT_THE_BACK = "Hints and solutions"
OPTION = re.compile(r"[a-z]\) ")
RECORD = ("Record", "book/appendix_claims", "book/appendix_errata", "book/appendix_concordance", "book/appendix_api",
          "book/appendix_status")  # parts and pages of the second volume  # fmt: skip


@dataclass
class Page:
    """One page: its name as in _toc.yml, its part, its article, in which <x-math n="5">text</x-math> is a formula."""

    name: str
    part: str | None
    article: Tag

    @property
    def slug(self):
        return slug(self.name)

    @property
    def title(self):
        """What the page is called: its first heading."""
        return words(self.article.find(re.compile("^h[12]$")))


def mathml(formula):
    return re.search(r"<math\b.*</math>", formula, re.S).group()


def slug(name):
    return re.sub(r"[^a-z0-9]+", "-", name.removeprefix("book/").lower())


def words(tag):
    return " ".join(tag.get_text().split())


def volumes():
    """{volume: [(page, part)]} in the order of _toc.yml."""
    toc = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
    out = {"book": [(toc["root"], None)], "record": []}
    for part in toc["parts"]:
        for chapter in part["chapters"]:
            name = chapter["file"]
            out["record" if {part["caption"], name} & set(RECORD) else "book"].append((name, part["caption"]))
    return out


class Volumes:
    """The pages of each volume, their formulas, and where their links lead."""

    def __init__(self, html=HTML, listed=None):
        self.html, self.formulas, self.lost = Path(html), [], []
        self.pages = {
            volume: [self.read(*entry) for entry in entries] for volume, entries in (listed or volumes()).items()
        }
        self.home = {page.name: volume for volume, pages in self.pages.items() for page in pages}
        for volume, pages in self.pages.items():
            if answers := [found for page in pages if page.part == "Exercises" and (found := answers_of(page))]:
                self.pages[volume] = [*pages, *answers]
        self.link()

    def read(self, name, part):
        text = (self.html / f"{name}.html").read_text(encoding="utf-8")
        article = re.search(r"<article\b.*?</article>", text, re.S).group()
        page = Page(name, part, BeautifulSoup(FORMULA.sub(self.keep, article), "lxml").article)
        for image in page.article.find_all("img", src=re.compile("^(?!data:)")):
            image["src"] = posixpath.normpath(posixpath.join(posixpath.dirname(name), image["src"]))
        for step in (tidy, keep_points, open_tabs, still_figures, without_checks):
            step(page)
        return page

    def keep(self, match):
        self.formulas.append(match.group())
        return f'<x-math n="{len(self.formulas) - 1}">{escape(said(mathml(match.group())))}</x-math>'

    def put_back(self, text, write):
        """The text with what `write` makes of each formula in its place."""
        return re.sub(r'<x-math n="(\d+)">[^<]*</x-math>', lambda m: write(self.formulas[int(m[1])]), text)

    def link(self):
        """Ids get the name of their page; links lead to #id in the volume or to volume:id; ids without link go."""
        known = {page.name: ids(page) for pages in self.pages.values() for page in pages}
        self.equations = {
            (page.name, next(number.stripped_strings).strip("()")): number.find_parent("div", id=True)["id"]
            for pages in self.pages.values()
            for page in pages
            for number in page.article.select("div.math[id] > .eqno")
        }
        wanted = set()
        for volume, pages in self.pages.items():
            for page in pages:
                for a in page.article.find_all("a", href=True):
                    target = self.target(page, a["href"], known)
                    if target is None:
                        a["class"] = ["outside"]
                    elif target is False:
                        a.unwrap()
                    else:
                        name, anchor = target = self.numbered(a, *target)
                        wanted.add(target)
                        there = self.home.get(name, volume)
                        a["href"] = f"{'' if there == volume else there + ':'}#{full(name, anchor)}"
                        a["class"] = ["to-record"] if "to-record" in a.get("class", []) else ["inside"]
                        del a["title"]
        for pages in self.pages.values():
            for page in pages:
                seen = set()
                for tag in page.article.find_all(id=True):
                    anchor, heads = tag["id"], tag.name == "section"
                    if anchor in seen or not (heads or (page.name, anchor) in wanted):
                        del tag["id"]
                    else:
                        tag["id"] = full(page.name, anchor)
                    seen.add(anchor)

    def numbered(self, a, name, anchor):
        """A link to a page that names one of its equations leads to the equation."""
        equation = re.search(r"\((\d+\.\w+)\)", a.get_text())
        return name, anchor or (equation and self.equations.get((name, equation[1]))) or anchor

    def target(self, page, href, known):
        """(page, anchor) of a link; None where it leaves the book, False where it leads to what is not printed."""
        if re.match(r"[a-z]+:", href):
            return None
        path, _, anchor = unquote(href).partition("#")
        there = posixpath.normpath(posixpath.join(posixpath.dirname(page.name), path)).removesuffix(".html")
        name = there if path else page.name
        if name not in known or (anchor and anchor not in known[name]):
            self.lost.append((page.name, href))
            return False
        return name, anchor


def full(name, anchor):
    return f"{slug(name)}--{anchor}" if anchor else slug(name)


def ids(page):
    return {tag["id"] for tag in page.article.find_all(id=True)}


def new(name, text="", **attributes):
    """A new element; `cls` is its class."""
    tag = MAKER.new_tag(
        name, attrs={key.replace("cls", "class").replace("_", "-"): value for key, value in attributes.items()}
    )
    if text:
        tag.string = text
    return tag


def tidy(page):
    """Without what works on a screen only, and without the ids that Sphinx gives twice."""
    for comment in page.article.find_all(string=lambda text: isinstance(text, Comment)):
        comment.extract()
    for tag in page.article.select(ON_SCREEN):
        if not tag.decomposed:
            tag.decompose()
    for tag in page.article.select(EMPTIED):
        tag.decompose()
    for tag in page.article.select(".proof[id=proof], .proof > section"):
        tag.attrs.pop("id", None)
    for tag in page.article.find_all(attrs={"aria-live": True}):
        del tag["aria-live"]


def keep_points(page):
    """No line begins with the point or comma after a formula."""
    for formula in page.article.select("span.math"):
        after = formula.next_sibling
        if isinstance(after, NavigableString) and (point := re.match(r"[.,;:!?)’”]+", after)):
            formula.insert_before(kept := new("span", cls="kept"))
            after.replace_with(after[point.end() :])
            kept.extend([formula.extract(), point[0]])


def open_tabs(page):
    """Tabs one below the other, each under its name, unless it opens with a box that has a title of its own."""
    for label in page.article.select("label.sd-tab-label"):
        content = label.find_next_sibling(class_="sd-tab-content")
        content.attrs.pop("id", None)
        if content.find(True, recursive=False) is content.select_one(":scope > .proof"):
            label.decompose()
        else:
            label.replace_with(new("p", words(label), cls="tab-name"))


def still_figures(page):
    """Every figure with its caption in one block; of one that moves, frames that tell what the others would."""
    for output in page.article.select(".cell_output"):
        made = []
        for panel in output.select(".explore"):
            figure = still(panel)
            panel.replace_with(figure)
            made.append(figure)
        for image in output.select("img"):
            if image.find_parent(class_="figure"):
                continue
            around = image.find_parent("a", class_="image-reference") or image
            figure = new("div", cls="figure")
            around.replace_with(figure)
            figure.append(image)
            made.append(figure)
        caption = output.find_parent(class_="cell").find_next_sibling()
        if made and caption is not None and "caption" in caption.get("class", []):
            made[-1].append(caption.extract())
    for image in page.article.select("img[style]"):
        image.attrs = {name: value for name, value in image.attrs.items() if name in ("src", "alt")}


def still(panel):
    """The first frame and what it shows; with it, where one thing is chosen in order or from few, up to four frames."""
    title, frames = words(panel.find(class_="title")), panel.select(".frame")
    knobs = [(words(row.legend), [words(label) for label in row.select("label")]) for row in panel.select("fieldset")]
    start = next(i for i, frame in enumerate(frames) if "first" in frame["class"])
    shown = [start]
    if len(knobs) == 1 and (len(frames) <= 4 or "ordered" in panel.fieldset.get("class", [])):
        shown = spread(len(frames), start)
    figure = new("div", cls="figure moving")
    figure.append(new("p", title, cls="title"))
    grid = new("div", cls="frames" if len(shown) > 1 else "frame-alone")
    figure.append(grid)
    for i in shown:
        cell = new("div", cls="frame")
        cell.append(frames[i].img.extract())
        if len(shown) > 1:
            cell.append(new("p", choice(*knobs[0], i), cls="choice"))
        grid.append(cell)
    if len(shown) == 1:
        chosen = panel.select("fieldset input")
        chosen = [
            [knob.has_attr("checked") for knob in row.select("input")].index(True) for row in panel.select("fieldset")
        ]
        told = "; ".join(choice(name, values, i) for (name, values), i in zip(knobs, chosen))
        figure.append(new("p", told, cls="choice"))
    if len(frames) > len(shown):
        others = "; ".join(f"{name}: {', '.join(values)}" for name, values in knobs)
        figure.append(
            new("p", f"On the page of the site all {len(frames)} pictures can be chosen ({others}).", cls="others")
        )
    return figure


def spread(n, start):
    """Up to four of n frames: the first, the last, and those between, one of which is the telling one."""
    if n <= 4:
        return list(range(n))
    picked = [round(i * (n - 1) / 3) for i in range(4)]
    nearest = min(range(4), key=lambda i: abs(picked[i] - start))
    picked[nearest] = start
    return sorted(set(picked))


def choice(name, values, i):
    return f"{name} = {values[i]}" if re.match(r"[-−\d.]", values[i]) else f"{name}: {values[i]}"


def without_checks(page):
    """Exercises on paper: the cell that runs the check, and what it says of no answer, are of no use."""
    if page.part == "Exercises":
        for cell in page.article.select('.cell[class*="tag_check-"]'):
            cell.decompose()


def answers_of(page):
    """The hints and solutions of a page of exercises, taken from it to a page of their own; each leads to the other."""
    here = posixpath.basename(page.name)
    top = new("section", id="answers")
    top.append(new("h1", page.title))
    for number, section in enumerate(page.article.select("section:has(> details)"), 1):
        folds = section.find_all("details", recursive=False)
        entry = new("section", id=f"answer-{number}", cls="answer")
        entry.append(new("h2", words(section.find(re.compile("^h[2-6]$"), recursive=False))))
        entry.append(leads(f"{here}.html#{section['id']}", "Exercise"))
        folds[-1].insert_after(leads(f"{here}-answers.html#{entry['id']}", AT_THE_BACK))
        for fold in folds:
            if OPTION.match(words(fold.summary)):
                before = fold.find_previous_sibling(True)
                if "option" not in before.get("class", []) and before.strong:
                    entry.append(new("p", words(before.strong), cls="question"))
                fold.insert_before(new("p", words(fold.summary), cls="option"))
            entry.extend(opened(fold.extract()))
        top.append(entry)
    article = new("article")
    article.append(top)
    return Page(f"{page.name}-answers", AT_THE_BACK, article) if top.section else None


def leads(href, text):
    paragraph, a = new("p", cls="leads"), new("a", text, href=href)
    paragraph.append(a)
    return paragraph


def opened(fold):
    """What a fold holds, its name at the head of the first paragraph."""
    name = words(fold.summary)
    fold.summary.decompose()
    first = fold.find(True)
    if first is None or first.name != "p":
        first = new("p", cls="question")
        fold.insert(0, first)
    first.insert(0, new("strong", name if name.endswith((".", "?", "!")) else f"{name}."))
    first.strong.insert_after(" ")
    return list(fold.contents)
