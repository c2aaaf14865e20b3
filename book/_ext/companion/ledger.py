"""The ledger, read once, and the appendices made from it: concordance, claims, errata, status."""

import functools
import json
import re
from importlib import metadata
from pathlib import Path

import yaml
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

from companion import repository

CHAPTERS = {
    1: "Finite Markov decision processes",
    2: "Bellman equations",
    3: "Dynamic programming",
    4: "Temporal-difference learning",
    5: "Eligibility traces",
    6: "Neural networks",
    7: "Policy gradients",
    8: "Proximal policy optimisation",
    9: "Conclusion",  # its entries count to chapter 8, its errata are its own
}
VERDICTS = {"true": "true", "false": "false", "true-with-conditions": "conditions"}


@functools.cache
def _load(path, changed):
    return yaml.safe_load(Path(path).read_text(encoding="utf-8")) or []


def load(srcdir, name):
    """The rows of book/NAME, read again only when the file changes."""
    path = Path(srcdir, "book", name)
    return _load(str(path), path.stat().st_mtime_ns) if path.exists() else []


def rows(srcdir):
    """The ledger's rows by id."""
    return {row["id"]: row for row in load(srcdir, "concordance.yml")}


def is_done(row):
    return row.get("status") != "missing"


def link(text, address, **attributes):
    inside = text if isinstance(text, nodes.Node) else nodes.Text(text)
    return nodes.reference("", "", inside, refuri=address, internal=True, **attributes)


def page_link(text, place):
    page, _, anchor = place.partition("#")
    return link(text, f"{page}.html#{anchor}")


def record_link(row):
    return [page_link("record", row["record"])]


def name_node(text):
    """A dotted or underscored name as code that may break after its dots and underscores."""
    return nodes.literal("", re.sub(r"(::|[._/])(?=\w)", "\\1\u200b", text))


def commas(items):
    """The nodes, separated by line breaks that a narrow cell can take."""
    spaced = []
    for item in items:
        spaced += [item, nodes.Text(" ")]
    return spaced[:-1]


def table(head, body, classes=()):
    """A table from lists of cells, each a list of inline nodes."""
    group = nodes.tgroup(cols=len(head))
    group += [nodes.colspec(colwidth=1) for _ in head]

    def line(cells):
        row = nodes.row()
        for cell in cells:
            row += nodes.entry("", nodes.paragraph("", "", *cell))
        return row

    group += nodes.thead("", line([[nodes.Text(text)] for text in head]))
    group += nodes.tbody("", *[line(cells) for cells in body])
    return nodes.table("", group, classes=[*classes, "colwidths-auto"])


def check_node(check):
    """A test or a tagged cell: its name, linked to the file where the repository is known."""
    path, _, name = check.partition("::" if "::" in check else "#")
    short = name_node(name or path)
    if path.endswith(".ipynb"):
        return link(short, str(Path(path).relative_to("book").with_suffix(".html")))
    address = repository.source_link(path)
    return link(short, address) if address else name_node(f"{Path(path).name}::{name}")


class Ledger(SphinxDirective):
    """One table a chapter: id, place, code, check. What is missing is said to be missing."""

    def run(self):
        out = []
        ledger = rows(self.env.srcdir).values()
        for chapter, title in CHAPTERS.items():
            mine = [row for row in ledger if row["chapter"] == chapter]
            if not mine:
                continue
            done = [row for row in mine if is_done(row)]
            section = nodes.section("", nodes.title("", f"Chapter {chapter}: {title}"), ids=[f"ledger-{chapter}"])
            section += nodes.paragraph("", f"{len(done)} of {len(mine)} entries are written and checked.")
            if done:
                body = [
                    [
                        commas([page_link(row["id"], row["page"]), *record_link(row)]),
                        commas([link(name_node(c), f"appendix_api.html#{c}") for c in row["code"]]),
                        commas([check_node(c) for c in row["check"]]),
                    ]
                    for row in done
                ]
                section += table(["Entry", "Code", "Checked by"], body, ["ledger"])
            missing = [row["id"] for row in mine if not is_done(row)]
            if missing:
                section += nodes.paragraph("", "", nodes.strong("", "Missing: "), nodes.Text(", ".join(missing) + "."))
            out.append(section)
        return out


@functools.cache
def _cells(path, changed):
    return json.loads(Path(path).read_text(encoding="utf-8"))["cells"]


TAG = re.compile(r"</?[A-Za-z][^>]*>")
BADGE = re.compile(r'<span class="verdict[^>]*>[^<]*</span>(?=\s*[A-Z*`$])\s*')  # one that is no part of its sentence


def paragraph_at(srcdir, place):
    """The Markdown paragraph that holds an anchor, without HTML tags; empty where there is none."""
    page, _, anchor = place.partition("#")
    path = Path(srcdir, "book", page + ".ipynb")
    if not path.exists():
        return ""
    for cell in _cells(str(path), path.stat().st_mtime_ns):
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown" and f'id="{anchor}"' in text:
            for paragraph in re.split(r"\n\s*\n|\n(?=:::|```)", text):
                if f'id="{anchor}"' in paragraph:
                    after = paragraph.split(f'id="{anchor}"')[1].partition(">")[2]
                    return TAG.sub("", BADGE.sub("", after)).removeprefix("</span>").strip()
    return ""


def sentences(text, count=2):
    """The first sentences of a Markdown paragraph; full stops inside mathematics and code end none."""
    inside, found = None, 0
    for i, letter in enumerate(text):
        if letter in "$`":
            inside = None if inside == letter else inside or letter
        elif letter in ".!?" and inside is None:
            end = re.compile(r'[*_)"]*(?=\s|$)').match(text, i + 1)
            found += bool(end)
            if found == count:
                return text[: end.end()]
    return text


class Claims(SphinxDirective):
    """Every claim with its verdict, in the book's own words, linked to its evidence."""

    def run(self):
        out = []
        claims = [row for row in rows(self.env.srcdir).values() if row["kind"] == "claim"]
        for chapter, title in CHAPTERS.items():
            mine = [row for row in claims if row["chapter"] == chapter]
            if not mine:
                continue
            done = [row for row in mine if is_done(row)]
            section = nodes.section("", nodes.title("", f"Chapter {chapter}: {title}"), ids=[f"claims-{chapter}"])
            if done:
                section += table(
                    ["Claim", "Verdict", "What the page says"], [self.line(row) for row in done], ["claims"]
                )
            if len(done) < len(mine):
                section += nodes.paragraph("", f"{len(mine) - len(done)} claims are not looked at yet.")
            out.append(section)
        return out

    def line(self, row):
        verdict = VERDICTS[str(row["verdict"])]
        words = {"conditions": "on conditions"}.get(verdict, verdict)
        text = nodes.container()
        said = sentences(paragraph_at(self.env.srcdir, row["record"]))
        lines = re.sub(r"^\*\*Claim: (.)", lambda first: "**" + first[1].upper(), said).splitlines()
        self.state.nested_parse(StringList(lines, "claim"), 0, text)
        inline = text.children[0].children if text.children and isinstance(text.children[0], nodes.paragraph) else []
        return [
            [page_link(row["id"], row["record"])],
            [nodes.inline("", words, classes=["verdict", verdict])],
            [child.deepcopy() for child in inline],
        ]


ERRATUM = re.compile(r"^:::\{admonition\} (Errat(?:um|a) [\d, and]+)\n(?::[^\n]*\n)*(.*?)^:::", re.M | re.S)


def errata(path):
    """(numbers, text) of every erratum box in a notebook, in order."""
    for cell in _cells(str(path), path.stat().st_mtime_ns):
        if cell["cell_type"] == "markdown":
            for title, text in ERRATUM.findall("".join(cell["source"])):
                yield [int(number) for number in re.findall(r"\d+", title)], text.strip()


def add_errata_ids(app, doctree):
    """Give the box of erratum 43 the id err-43."""
    for box in doctree.findall(nodes.admonition):
        title = box.children[0].astext()
        if title.startswith("Errat"):
            box["ids"] += [f"err-{number}" for number in re.findall(r"\d+", title)]


class Errata(SphinxDirective):
    """What is wrong in the document, gathered from the boxes of the chapters, each with a link to its place."""

    def run(self):
        out = []
        book = Path(self.env.srcdir, "book")
        for path in sorted(book.glob("0*.ipynb")):
            chapter, record = int(path.stem[:2]), book / "record" / path.name
            path = record if record.exists() else path
            section = nodes.section("", nodes.title("", f"Chapter {chapter}: {CHAPTERS[chapter]}"))
            section["ids"] = [f"errata-{chapter}"]
            page = path.relative_to(book).with_suffix("").as_posix()
            body = [self.line(page, numbers, text) for numbers, text in errata(path)]
            section += table(["No.", "What is right"], body, ["errata"])
            out.append(section)
        return out

    def line(self, page, numbers, text):
        box = nodes.container()
        self.state.nested_parse(StringList(text.splitlines(), "errata"), 0, box)
        places = [page_link(str(number), f"{page}#err-{number}") for number in numbers]
        return [
            commas(places),
            [child.deepcopy() for part in box.children for child in [*part.children, nodes.Text(" ")]],
        ]


class Status(SphinxDirective):
    """What the stored outputs were made with, and how long each notebook took then."""

    PACKAGES = ("numpy", "scipy", "numba", "matplotlib", "gymnasium", "jupyter-book", "sphinx", "myst-nb")

    def run(self):
        times = load(self.env.srcdir, "data/run_times.yml") or {}
        body = []
        book = Path(self.env.srcdir, "book")
        for path in sorted([*book.glob("0*.ipynb"), *book.glob("record/*.ipynb")]):
            cells = [c for c in _cells(str(path), path.stat().st_mtime_ns) if c["cell_type"] == "code"]
            page = path.relative_to(book).with_suffix("").as_posix()
            seconds = times.get("seconds", {}).get(page)
            said = f"{seconds} s" if seconds is not None else "not measured"
            name = link(nodes.literal("", page), page + ".html")
            body.append([[name], [nodes.Text(str(len(cells)))], [nodes.Text(said)]])
        here = table(["Notebook", "Code cells", "Run time, two cores"], body, ["status"])
        stored = times.get("versions", {})
        lines = [
            [[nodes.Text(name)], [nodes.Text(stored.get(name, "-"))], [nodes.Text(metadata.version(name))]]
            for name in self.PACKAGES
        ]
        return [here, table(["Package", "Outputs made with", "Pages built with"], lines, ["status"])]


def setup(app):
    for name, directive in {"ledger": Ledger, "claims": Claims, "errata": Errata, "status": Status}.items():
        app.add_directive(name, directive)
    app.connect("env-before-read-docs", reread)
    app.connect("doctree-read", add_errata_ids)


def reread(app, env, docnames):
    """The appendices follow the ledger and the notebooks, so they are read again in every build."""
    docnames += [d for d in env.found_docs if "appendix_" in d and d not in docnames]
