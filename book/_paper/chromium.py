"""Headless Chromium with a fontconfig of its own, so that what it draws does not depend on the machine's fonts."""

import contextlib
import os
import shutil
import tempfile
from pathlib import Path

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Without these Chromium makes requests of its own, which a log of requests would take for the page's.
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
CONFIG = """<?xml version="1.0"?><!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig>{fonts}<cachedir>{home}/fontconfig</cachedir></fontconfig>"""


def path():
    """Where Chromium or Chrome is, or None."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def dejavu():
    """The fonts that figures are drawn with."""
    import matplotlib

    return f"<dir>{matplotlib.get_data_path()}/fonts/ttf</dir>"


@contextlib.contextmanager
def browser(playwright, fonts=""):
    """A browser that has the fonts of fontconfig's elements `fonts` and no others."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        Path(home, "fonts.conf").write_text(CONFIG.format(fonts=fonts, home=home), encoding="utf-8")
        env = {**os.environ, "HOME": home, "FONTCONFIG_FILE": f"{home}/fonts.conf"}
        started = playwright.chromium.launch(
            executable_path=path(), args=QUIET, ignore_default_args=["--hide-scrollbars"], env=env
        )
        yield started
        started.close()
