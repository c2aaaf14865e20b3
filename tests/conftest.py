"""Shared by the tests of the built pages: a server on the loopback interface and headless Chromium."""

import contextlib
import functools
import http.server
import os
import re
import threading
from pathlib import Path

import chromium
import pytest

ROOT = Path(__file__).parents[1]
HTML = ROOT / "_build" / "html"
PAGES = sorted(path.relative_to(HTML).as_posix() for path in HTML.glob("book/**/*.html"))
CHAPTERS = [page for page in PAGES if re.match(r"book/0[1-8]_", page)]


def absent(reason):
    """Skip for a reader, fail where CI=true: there, nothing may be left out in silence."""
    if os.environ.get("CI", "").lower() in ("1", "true"):
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def environment():
    """Without what pytest sets, and the libraries that are loaded on the way."""
    others = ("PYTEST_CURRENT_TEST", "PYGAME_", "KMP_", "TORCHINDUCTOR_")
    return {name: value for name, value in os.environ.items() if not name.startswith(others)}


def pytest_configure(config):
    config.rl_environment = environment()


def pytest_collection_finish(session):
    """A variable that stays set would reach every kernel and every process that a later test starts."""
    if changed := set(environment().items()) ^ set(session.config.rl_environment.items()):
        raise pytest.UsageError(f"importing the tests changes the environment: {sorted(changed)}")


@pytest.fixture(autouse=True)
def environment_is_left():
    before = environment()
    yield
    assert environment() == before


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


@pytest.fixture(scope="session")
def browsers():
    """Headless Chromium with a fontconfig of its own: "dejavu" has matplotlib's DejaVu fonts, "none" no font at all."""
    if chromium.path() is None:
        absent("no Chromium: install it (Debian: apt-get install chromium) to run the page tests")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, contextlib.ExitStack() as stack:
        fonts = {"dejavu": chromium.dejavu(), "none": ""}
        yield {name: stack.enter_context(chromium.browser(playwright, known)) for name, known in fonts.items()}
