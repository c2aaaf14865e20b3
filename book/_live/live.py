"""The Sphinx extension of live pages: with LIVE=1, a button under each cell and, beside the pages, what runs them."""

import json
import os
import re
import shutil
from hashlib import sha256
from pathlib import Path

from docutils import nodes
from fetch import zipped
from sphinx.errors import ExtensionError

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
FETCHED = ROOT / "_build" / "live" / "python"
LIVE = re.compile(r"book/(0[1-8]_|exercises/)")  # chapter 9 counts the ledger, with a package that browsers lack
SENT = [(ROOT, "rlcore/**/*.py"), (ROOT / "book", "data/*"), (HERE, "needs.py"), (HERE, "shell.py")]
OWN = ("hook.js", "live.js", "worker.js", "live.css")


def prepare(app, config):
    """Make the value `live` the hash of all that runs, so that pages are written anew when that changes."""
    if not config.live:
        return
    if not (FETCHED / "files.json").exists():
        raise ExtensionError("live pages need files that are not there: run `make live`")
    files = {name: (HERE / name).read_bytes() for name in OWN}
    found = {path.relative_to(base).as_posix(): path for base, pattern in SENT for path in base.glob(pattern)}
    files["rlcore.zip"] = zipped({name: path.read_bytes() for name, path in found.items()})
    files["python/files.json"] = (FETCHED / "files.json").read_bytes()
    shown = [*files.values(), (HERE / "seconds.json").read_bytes()]
    config.live, app.live = sha256(b"".join(shown)).hexdigest()[:12], files


def digest(source):
    """By what the seconds of a cell are known."""
    return sha256(source.strip().encode()).hexdigest()[:12]


def add_buttons(app, pagename, templatename, context, doctree):
    """The script of a page, which is told how many seconds a slow cell takes, 0 for one that is not to be offered."""
    if not app.config.live or not LIVE.match(pagename):
        return
    seconds = json.loads((HERE / "seconds.json").read_text(encoding="utf-8"))
    inputs = [node for node in doctree.findall(nodes.container) if "cell_input" in node["classes"]]
    known = {n: seconds.get(digest(node.astext())) for n, node in enumerate(inputs)}
    slow = json.dumps({n: value for n, value in known.items() if value is not None})
    folder = f"../live/{app.config.live}"
    app.add_css_file(f"{folder}/live.css")
    app.add_js_file(f"{folder}/hook.js", loading_method="defer", **{"data-slow": slow})


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
