"""The Sphinx extension of live pages: with LIVE=1, a button under each cell and, beside the pages, what runs them."""

import hashlib
import io
import json
import os
import re
import shutil
import zipfile
from pathlib import Path

from docutils import nodes
from sphinx.errors import ExtensionError

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
FETCHED = ROOT / "_build" / "live" / "python"
LIVE = re.compile(r"book/(0[1-8]_|exercises/)")  # chapter 9 counts the ledger, with a package that browsers lack
OWN = ("hook.js", "live.js", "worker.js", "live.css")


def package():
    """rlcore, the data that cells read and what runs them, as one archive, the same bytes each time."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as file:
        parts = [(ROOT, "rlcore/**/*.py"), (ROOT / "book", "data/*"), (HERE, "needs.py"), (HERE, "shell.py")]
        found = {path.relative_to(base).as_posix(): path for base, pattern in parts for path in base.glob(pattern)}
        for name, path in sorted(found.items()):
            file.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), path.read_bytes(), zipfile.ZIP_DEFLATED, 9)
    return out.getvalue()


def prepare(app, config):
    """Make the value `live` the hash of all that runs, so that pages are written anew when that changes."""
    if not config.live:
        return
    if not (FETCHED / "files.json").exists():
        raise ExtensionError("live pages need files that are not there: run `make live`")
    files = {name: (HERE / name).read_bytes() for name in OWN} | {"rlcore.zip": package()}
    files["python/files.json"] = (FETCHED / "files.json").read_bytes()
    shown = [*files.values(), (HERE / "seconds.json").read_bytes()]
    config.live, app.live = hashlib.sha256(b"".join(shown)).hexdigest()[:12], files


def add_buttons(app, pagename, templatename, context, doctree):
    if app.config.live and LIVE.match(pagename):
        folder = f"live/{app.config.live}"
        app.add_css_file(f"../{folder}/live.css")
        app.add_js_file(f"../{folder}/hook.js", loading_method="defer", **slow(pagename, doctree))


def digest(source):
    """By what the seconds of a cell are known."""
    return hashlib.sha256(source.strip().encode()).hexdigest()[:12]


def slow(pagename, doctree):
    """The seconds of the cells that take long in a browser, 0 for one that takes too long to be offered."""
    measured = json.loads((HERE / "seconds.json").read_text(encoding="utf-8"))
    cells = (
        [node.astext() for node in doctree.findall(nodes.container) if "cell_input" in node["classes"]]
        if doctree
        else []
    )
    known = {n: measured.get(digest(text)) for n, text in enumerate(cells)}
    words = ",".join(f"{n}:{seconds}" for n, seconds in known.items() if seconds is not None)
    return {"data-slow": words} if words else {}


def place(app, error):
    shutil.rmtree(Path(app.outdir) / "live", ignore_errors=True)
    if error or not app.config.live:
        (Path(app.outdir) / "live-shelf.js").unlink(missing_ok=True)
        return
    folder = Path(app.outdir) / "live" / app.config.live
    shutil.copytree(FETCHED, folder / "python")
    for name, data in app.live.items():
        (folder / name).write_bytes(data)
    shutil.copy(HERE / "shelf.js", Path(app.outdir) / "live-shelf.js")


def setup(app):
    app.add_config_value("live", "yes" if os.environ.get("LIVE") == "1" else "", "html")
    app.connect("config-inited", prepare)
    app.connect("html-page-context", add_buttons)
    app.connect("build-finished", place)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
