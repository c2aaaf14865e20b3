"""Pages ask nothing of any other site: MathJax comes from a package, thebe's scripts are dropped."""

import importlib.util
import shutil
from pathlib import Path

MATHJAX = ("tex-chtml-full.js", "output/chtml/fonts/woff-v2")


def mathjax_source():
    """Folder of MathJax's files in sphinx-mathjax-offline (whose package name is no identifier)."""
    spec = importlib.util.find_spec("sphinx-mathjax-offline")
    if spec is None:
        raise RuntimeError("the package sphinx-mathjax-offline is missing: pip install -r requirements.txt")
    return Path(spec.origin).parent / "static" / "mathjax"


def copy_mathjax(app, error):
    if error or app.builder.format != "html":
        return
    target = Path(app.outdir, "_static", "mathjax")
    for name in MATHJAX:
        source, copy = mathjax_source() / name, target / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, copy, dirs_exist_ok=True)
        else:
            shutil.copy2(source, copy)


def unused(script):
    """Thebe's scripts run cells on a server of somebody else; the book has no such button."""
    body = (getattr(script, "attributes", None) or {}).get("body") or ""
    return "THEBE_JS_URL" in body or "sphinx-thebe" in str(getattr(script, "filename", script))


def drop_thebe(app, pagename, templatename, context, doctree):
    context["script_files"] = [script for script in context["script_files"] if not unused(script)]
    context["css_files"] = [sheet for sheet in context["css_files"] if not unused(sheet)]


def setup(app):
    app.config.mathjax_path = "mathjax/tex-chtml-full.js"
    app.connect("html-page-context", drop_thebe, priority=900)
    app.connect("build-finished", copy_mathjax)
