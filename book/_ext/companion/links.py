"""Short ways to link: {task}`ch01-first-visit` to an exercise, {tasks}`01_mdp` to all of a page, {fn}`td.sarsa` to the
API; and from exercises to places in chapters."""

import json
import re
from pathlib import Path

from docutils import nodes
from sphinx.util import logging
from sphinx.util.docutils import SphinxRole

from companion.ledger import link

logger = logging.getLogger(__name__)
HEADING = re.compile(r'<span id="([\w-]+)"></span>\s*\n+### (\d+)\. (.+)')
PLACE = re.compile(r"\[([^]\[]+)\]\(((?:\.\./)?\w+)\.ipynb#([\w-]+)\)")


def exercises(srcdir, page):
    """{id: (number, title)} of a page of exercises."""
    path = Path(srcdir, "book", "exercises", f"{page}.ipynb")
    if not path.exists():
        return {}
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    return {name: (number, title) for name, number, title in HEADING.findall(text)}


class Link(SphinxRole):
    def up(self):
        """The way from this page to the folder of the book."""
        return "../" * (self.env.docname.count("/") - 1)

    def task(self, page, name, number, title):
        words = f"{int(page[:2])}.{number} {title}"
        return link(words, f"{self.up()}exercises/{page}.html#{name}")

    def lost(self, what):
        logger.warning("%s: there is no %s", self.name, what, location=self.get_location())
        return [nodes.Text(what)], []


class Task(Link):
    def run(self):
        folder = Path(self.env.srcdir, "book", "exercises")
        page = next((path.stem for path in folder.glob(f"{self.text[2:4]}_*.ipynb")), "")
        known = exercises(self.env.srcdir, page)
        return ([self.task(page, self.text, *known[self.text])], []) if self.text in known else self.lost(self.text)


class Tasks(Link):
    def run(self):
        found, out = exercises(self.env.srcdir, self.text), []
        for name, about in found.items():
            out += [nodes.Text("; "), self.task(self.text, name, *about)]
        return (out[1:], []) if found else self.lost(self.text)


class Function(Link):
    def run(self):
        name = f"rlcore.{self.text}"
        return [link(nodes.literal("", self.text.rpartition(".")[2]), f"{self.up()}appendix_api.html#{name}")], []


def follow_places(app, docname, source):
    """In notebooks of exercises [words](../page.ipynb#place) leads to the place on the page."""
    if docname.startswith("book/exercises/"):
        source[0] = PLACE.sub(r"<a class='reference internal' href='\2.html#\3'>\1</a>", source[0])


def setup(app):
    app.connect("source-read", follow_places)
    for name, role in {"task": Task, "tasks": Tasks, "fn": Function}.items():
        app.add_role(name, role())
