"""Shared by the tests of the built pages: a server on the loopback interface and headless Chromium."""

import contextlib
import functools
import http.server
import os
import re
import shutil
import tempfile
import threading
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HTML = ROOT / "_build" / "html"
PAGES = sorted(path.relative_to(HTML).as_posix() for path in HTML.glob("book/**/*.html"))
CHAPTERS = [page for page in PAGES if re.match(r"book/0[1-8]_", page)]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Without these Chromium makes requests of its own, which the request log would take for the page's.
QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
]


def absent(reason):
    """Skip for a reader, fail where CI=true: there, nothing may be left out in silence."""
    if os.environ.get("CI", "").lower() in ("1", "true"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def built():
    """Folder of the built book."""
    if not (HTML / "book" / "index.html").exists():
        absent("the book is not built: run `make book` first")
    return HTML


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args):
        pass


@pytest.fixture(scope="session")
def site(built):
    """Address of the built book, served on the loopback interface."""
    handler = functools.partial(Quiet, directory=str(built))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


CONFIG = """<?xml version="1.0"?><!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig>{fonts}<cachedir>{home}/fontconfig</cachedir></fontconfig>"""


@pytest.fixture(scope="session")
def browsers():
    """Headless Chromium with a fontconfig of its own: "dejavu" has matplotlib's DejaVu fonts, "none" no font at all."""
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        absent("no Chromium: install it (Debian: apt-get install chromium) to run the page tests")
    import matplotlib
    from playwright.sync_api import sync_playwright

    folders = {"dejavu": f"<dir>{matplotlib.get_data_path()}/fonts/ttf</dir>", "none": ""}
    with sync_playwright() as playwright, contextlib.ExitStack() as stack:
        started = {}
        for name, fonts in folders.items():
            home = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
            Path(home, "fonts.conf").write_text(CONFIG.format(fonts=fonts, home=home), encoding="utf-8")
            env = {**os.environ, "HOME": home, "FONTCONFIG_FILE": f"{home}/fonts.conf"}
            browser = playwright.chromium.launch(
                executable_path=path, args=QUIET, ignore_default_args=["--hide-scrollbars"], env=env
            )
            stack.callback(browser.close)
            started[name] = browser
        yield started
