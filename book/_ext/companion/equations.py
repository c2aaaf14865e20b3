"""Equations carry the chapter's number and the document's: a block labelled eq-7 shows (1.7) and has the HTML id eq-7.

The second number is the ledger's where the ledger has one, else the digits of a label such as eq-7. Any other label
keeps Sphinx's own number.
"""

import re

from docutils import nodes

from companion.ledger import rows


def document_number(app, label, docname):
    """The chapter and the number that the document prints at this label, or None."""
    row = rows(app.srcdir).get(label, {})
    found = re.fullmatch(r"eq-(\d+)", label or "")
    number = row.get("number") or (found and found[1])
    chapter = re.match(r"book/0(\d)_", docname)
    return f"{row.get('chapter') or (chapter and chapter[1])}.{number}" if number else None


def add_ids(app, doctree):
    for block in doctree.findall(nodes.math_block):
        label = block.get("label")
        if label and label not in block["ids"]:
            block["ids"].append(label)  # after Sphinx's own id, which its numbering looks up first


def renumber(app, env):
    """Replace Sphinx's numbers once they are assigned; pages and {eq} references read them from here."""
    for label, (docname, _) in env.get_domain("math").equations.items():
        number = document_number(app, label, docname)
        if number:
            figures = env.toc_fignumbers.setdefault(docname, {}).setdefault("displaymath", {})
            figures[nodes.make_id(f"equation-{label}")] = (number,)
    return []


def setup(app):
    app.connect("doctree-read", add_ids)
    app.connect("env-get-updated", renumber, priority=900)
