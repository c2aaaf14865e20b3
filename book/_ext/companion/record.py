"""Quiet marks that lead from a place in a chapter to its row in the record, and from there back.

A place is an anchor, <span id="eq-7"></span>, or the label of an equation, that the ledger names as `page` or `record`
of a row. The mark stands at the end of the paragraph, or beside the number of the equation.
"""

import posixpath
import re

from docutils import nodes

from companion.ledger import rows

ANCHOR = re.compile(r'id="([^"]+)"')
KINDS = {"omission": "addition"}


def here(app):
    """{(page, anchor): (letter, words, page and anchor that the mark leads to)} for all rows with two places."""
    marks = {}
    for row in rows(app.srcdir).values():
        if "record" not in row:
            continue
        kind = KINDS.get(row["kind"], row["kind"])
        number = f"{row['chapter']}.{row['number']}" if row["kind"] == "equation" and row.get("number") else None
        name = f"{kind} {number or row.get('number') or row['id']}"
        page, record = (tuple(row[key].split("#")) for key in ("page", "record"))
        marks.setdefault(page, []).append(("r", f"record of {name}", record))
        marks.setdefault(record, []).append(("c", f"{name} in the chapter", page))
    return marks


def mark(docname, letter, words, target):
    page, anchor = target
    address = posixpath.relpath(page, posixpath.dirname(docname.removeprefix("book/")) or ".") + f".html#{anchor}"
    link = nodes.reference("", letter, refuri=address, internal=True, reftitle=words, classes=["to-record"])
    return nodes.superscript("", "", link, classes=["to-record"])


def add_marks(app, doctree):
    docname = app.env.docname
    if not docname.startswith("book/"):
        return
    page, marks = docname.removeprefix("book/"), here(app)
    for block in list(doctree.findall(nodes.math_block)):
        if found := marks.get((page, block.get("label"))):
            block["marks"] = [mark(docname, *one) for one in found]
    for raw in list(doctree.findall(nodes.raw)):
        for anchor in ANCHOR.findall(raw.astext()) if raw.get("format") == "html" else ():
            for one in marks.get((page, anchor), ()):
                place(raw, mark(docname, *one))


def place(raw, node):
    """At the end of the paragraph, in the equation that follows, or in a paragraph of its own."""
    parent = raw.parent
    if isinstance(parent, nodes.TextElement):
        parent += node
        return
    after = parent[parent.index(raw) + 1 :]
    follower = next((n for n in after if not isinstance(n, (nodes.raw, nodes.comment, nodes.target))), None)
    if isinstance(follower, nodes.math_block):
        follower["marks"] = [*follower.get("marks", []), node]
    elif isinstance(follower, nodes.paragraph):
        follower += node
    else:
        parent.insert(parent.index(raw) + 1, nodes.paragraph("", "", node))


def setup(app):
    app.connect("doctree-read", add_marks)
