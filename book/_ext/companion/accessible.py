"""Every image says in words what it shows: a build warning (so a failed build) where one does not."""

import re

from docutils import nodes
from sphinx.util import logging

logger = logging.getLogger(__name__)
IMAGE = re.compile(r"<img\b[^>]*>", re.I)
ALT = re.compile(r'\balt\s*=\s*"([^"]*)"', re.I)


def check_alt(app, doctree):
    for image in doctree.findall(nodes.image):
        if not (image.get("alt") or "").strip():
            logger.warning("an image has no alt text: %s", image.get("uri", "")[:80], location=image)
    for raw in doctree.findall(nodes.raw):
        if raw.get("format") == "html":
            for tag in IMAGE.findall(raw.astext()):
                found = ALT.search(tag)
                if not (found and found.group(1).strip()):
                    logger.warning("an image has no alt text: %s", tag[:80], location=raw)


def mend_roles(app, pagename, templatename, context, doctree):
    """Take back a role that browsers have given up, and the list that is none without it (the references)."""
    if "body" in context:
        context["body"] = context["body"].replace(' role="doc-biblioentry"', "").replace('<div role="list"', "<div")


def setup(app):
    app.connect("doctree-read", check_alt)
    app.connect("html-page-context", mend_roles)
