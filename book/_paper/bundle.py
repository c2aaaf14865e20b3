"""The site as one zip that works from a disk: unzip it, open index.html; no network, no server.

python book/_paper/bundle.py     _build/paper/site.zip
"""

import re
import zipfile
from pathlib import Path

from pages import HTML, OUT, ROOT
from pdf import CITATION, LICENCE, date, version

PRELOAD = re.compile(rb'<link rel="preload" as="font"[^>]*>')  # browsers refuse it on a disk, and load the font later
README = f"""{CITATION["title"]}, version {version()}, {date()}

Open index.html in a browser. Pages, formulas, figures and search need no network.

Where cells can be run in the page (a folder "live" lies beside this file), a browser asks for a server. In this folder:

    python3 -m http.server

and open http://localhost:8000.

{LICENCE}
"""


def make(html=HTML, out=OUT):
    """The zip of the built site; its path."""
    out.mkdir(parents=True, exist_ok=True)
    path, folder = out / "site.zip", f"book-{version()}"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(f"{folder}/README.txt", README)
        for file in sorted(Path(html).rglob("*")):
            if file.is_file():
                data = file.read_bytes()
                if file.suffix == ".html":
                    data = PRELOAD.sub(b"", data)
                archive.writestr(f"{folder}/{file.relative_to(html)}", data)
    return path


if __name__ == "__main__":
    path = make()
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e6:.1f} MB")
