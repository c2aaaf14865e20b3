"""Formulas are set when the book is built, by MathJax in a JavaScript engine, and stand in the pages as they are shown.

So they are there without JavaScript, nothing moves while a page loads, and widths depend on MathJax's metrics alone.
"""

import functools
import importlib.util
import json
import re
import shutil
from pathlib import Path

from docutils import nodes
from py_mini_racer import MiniRacer
from sphinx.util.math import get_node_equation_number

PARTS = ("core", "input/tex-full", "output/chtml", "output/chtml/fonts/tex", "a11y/assistive-mml")


def source():
    """Folder of MathJax's files in sphinx-mathjax-offline (whose package name is no identifier)."""
    spec = importlib.util.find_spec("sphinx-mathjax-offline")
    if spec is None:
        raise RuntimeError("the package sphinx-mathjax-offline is missing: pip install -r requirements.txt")
    return Path(spec.origin).parent / "static" / "mathjax"


class Typesetter:
    """MathJax with one configuration; starts when first used."""

    def __init__(self, config):
        self.config = config
        self.typeset = functools.cache(self._typeset)

    @functools.cached_property
    def engine(self):
        files = {f"mathjax/{name}.js": (source() / f"{name}.js").read_text(encoding="utf-8") for name in PARTS}
        files["main"] = (source() / "node-main.js").read_text(encoding="utf-8")
        engine = MiniRacer()
        engine.eval(f"const FILES = {json.dumps(files)}, CONFIG = {json.dumps(self.config)}; 0")
        engine.eval(Path(__file__).with_name("mathematics.js").read_text(encoding="utf-8") + "; 0")
        if (state := engine.eval("state")) != "ready":
            raise RuntimeError(f"MathJax did not start: {state}")
        return engine

    def _typeset(self, tex, display):
        html = self.engine.eval(f"typeset({json.dumps(tex)}, {json.dumps(display)})")
        if "mjx-merror" in html:
            raise ValueError(f"tex={tex!r}: MathJax cannot set it")
        return html

    def stylesheet(self, pages):
        """MathJax's rules, of characters only those that stand in the pages."""
        used = {name for page in pages for name in re.findall(r"\bmjx-c[0-9A-F]+\b", page.read_text(encoding="utf-8"))}
        text = self.engine.eval("stylesheet()").replace('"{"', r'"\7B"').replace('"}"', r'"\7D"')
        rules = re.findall(r"[^{}]+\{[^{}]*\}", text)
        about = ((re.search(r"\bmjx-c[0-9A-F]+\b", rule.partition("{")[0]), rule) for rule in rules)
        return "".join(re.sub(r"\s+", " ", rule) for found, rule in about if not found or found.group() in used)


def visit_inline(translator, node):
    translator.body.append(translator.starttag(node, "span", "", CLASS="math notranslate nohighlight"))
    translator.body.append(translator.builder.env.app.typesetter.typeset(node.astext(), False) + "</span>")
    raise nodes.SkipNode


def visit_display(translator, node):
    translator.body.append(translator.starttag(node, "div", CLASS="math notranslate nohighlight"))
    if node["number"] or node.get("marks"):
        translator.body.append('<span class="eqno">')
        if node["number"]:
            translator.body.append(f"({get_node_equation_number(translator, node)})")
            translator.add_permalink_ref(node, "Link to this equation")
        for mark in node.get("marks", ()):
            mark.walkabout(translator)
        translator.body.append("</span>")
    translator.body.append(translator.builder.env.app.typesetter.typeset(whole(node), True) + "</div>\n")
    raise nodes.SkipNode


def whole(node):
    """The TeX of a displayed equation: parts between blank lines below each other, line breaks kept in each."""
    if node["nowrap"]:
        return node.astext()
    parts = [part.strip() for part in node.astext().split("\n\n") if part.strip()]
    parts = [rf"\begin{{split}}{part}\end{{split}}" if r"\\" in part else part for part in parts]
    if len(parts) == 1:
        return parts[0]
    rows = r"\\ ".join("&" + part for part in parts)
    return rf"\begin{{align}}\begin{{aligned}}{rows}\end{{aligned}}\end{{align}}"


def start(app, config):
    config.html_math_renderer = "typeset"
    app.typesetter = Typesetter(config.mathjax3_config)


def finish(app, error):
    if error or app.builder.format != "html":
        return
    static = Path(app.outdir, "_static")
    pages = sorted(Path(app.outdir).glob("**/*.html"))
    (static / "mathjax.css").write_text(app.typesetter.stylesheet(pages), encoding="utf-8")
    shutil.copytree(source() / "output/chtml/fonts/woff-v2", static / "mathjax", dirs_exist_ok=True)


def setup(app):
    app.add_html_math_renderer("typeset", (visit_inline, None), (visit_display, None))
    app.add_css_file("mathjax.css")
    app.connect("config-inited", start)
    app.connect("build-finished", finish)
