"""Pages ask nothing of any other site: thebe's scripts are dropped; formulas are set when the book is built.

The fonts are asked for first, so that the first view has them and does not move.
"""

import functools

FONTS = ("serif", "serif-italic", "sans", "mono")
PRELOAD = '<link rel="preload" as="font" type="font/woff2" href="{}" crossorigin>'


def unused(script):
    """Thebe's scripts run cells on a server of somebody else; the book has no such button. No page needs MathJax's."""
    body = (getattr(script, "attributes", None) or {}).get("body") or ""
    name = str(getattr(script, "filename", script))
    return "THEBE_JS_URL" in body or "window.MathJax" in body or "sphinx-thebe" in name or "tex-mml-chtml" in name


def drop(app, pagename, templatename, context, doctree):
    context["script_files"] = [script for script in context["script_files"] if not unused(script)]
    context["css_files"] = [sheet for sheet in context["css_files"] if not unused(sheet)]
    address = functools.partial(context["pathto"], resource=True)
    links = [PRELOAD.format(address(f"_static/fonts/{name}.woff2")) for name in FONTS]
    context["metatags"] = "\n".join([context.get("metatags", ""), *links])


def setup(app):
    app.connect("html-page-context", drop, priority=900)
