"""The book as EPUB 3, out of the pages that `make book` built: formulas as MathML, figures as files.

python book/_paper/epub.py     _build/paper/book.epub
"""

import base64
import hashlib
import re
import unicodedata
import uuid
import zipfile
from html import escape
from pathlib import Path
from urllib.parse import unquote_to_bytes

from lxml import etree
from pages import HTML, OUT, ROOT, Volumes, mathml, words
from pdf import CITATION, FACES, LICENCE, citation, date, version
from speech import said

KINDS = {".xhtml": "application/xhtml+xml", ".css": "text/css", ".png": "image/png", ".svg": "image/svg+xml"}
CONTAINER = """<?xml version="1.0" encoding="utf-8"?>
<container version="1.0" xmlns="urn:oasis:names:tc:opendocument:xmlns:container"><rootfiles>
<rootfile full-path="book/book.opf" media-type="application/oebps-package+xml"/></rootfiles></container>
"""
XHTML = """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE html>
<html xmlns="http://www.w3.org/1999/xhtml" xmlns:epub="http://www.idpf.org/2007/ops" lang="en" xml:lang="en">
<head><title>{title}</title><link rel="stylesheet" href="book.css"/></head>
<body>
{body}
</body></html>
"""
ACCESS = {
    "accessMode": ("textual", "visual"),
    "accessModeSufficient": ("textual",),
    "accessibilityFeature": ("alternativeText", "MathML", "readingOrder", "structuralNavigation", "tableOfContents"),
    "accessibilityHazard": ("none",),
    "accessibilitySummary": ("Every figure has a text, every formula is MathML with a text; pages have headings.",),
}


def styled(sign, variant):
    """A letter or digit in another style: readers go by the sign, not by the attribute."""
    name = re.sub(r"^(LATIN|GREEK) | LETTER", "", unicodedata.name(sign))
    for prefix in ("MATHEMATICAL ", ""):
        try:
            return unicodedata.lookup(f"{prefix}{variant.replace('bold-italic', 'bold italic').upper()} {name}")
        except KeyError:
            continue
    return sign


def formula(html):
    """Its MathML without what is MathJax's own, with its text for readers that know no MathML."""
    root = etree.fromstring(mathml(html))
    for element in root.iter():
        if (variant := element.get("mathvariant", "normal")) != "normal" and len(element.text or "") == 1:
            element.text = styled(element.text, variant)
            del element.attrib["mathvariant"]
        for name in [name for name in element.attrib if name.startswith("data-")]:
            del element.attrib[name]
    root.set("alttext", said(mathml(html)))
    return etree.tostring(root, encoding="unicode")


class Files:
    """What goes into the archive: {name: bytes}, pictures once each."""

    def __init__(self, html):
        self.html, self.all = html, {"book.css": Path(__file__).with_name("epub.css").read_bytes()}

    def picture(self, source):
        """The name of the file that holds an image of a page."""
        if found := re.match(r"data:image/(svg\+xml|png)(;base64)?,(.*)", source, re.S):
            kind, packed, text = found.groups()
            data = base64.b64decode(text) if packed else unquote_to_bytes(text)
            ending = "svg" if kind.startswith("svg") else "png"
        else:
            data, ending = (self.html / source).read_bytes(), source.rpartition(".")[2]
        name = f"images/{hashlib.sha256(data).hexdigest()[:16]}.{ending}"
        self.all[name] = data
        return name


def chapter(volumes, page, files, home):
    """The XHTML of one page; home: {id: file} of all of them."""
    for image in page.article.find_all("img"):
        image["src"] = files.picture(image["src"])
    for a in page.article.find_all("a", href=True):
        volume, hash_, target = a["href"].partition("#")
        if "outside" in a["class"]:
            continue
        if volume or target not in home:  # the other volume is no part of this file
            (a.find_parent("sup", class_="to-record") or a).decompose() if "to-record" in a["class"] else a.unwrap()
        else:
            a["href"] = home[target] + (hash_ + target if target != page.slug else "")
    for tag in page.article.find_all(["th", "td", "table"]):
        tag.attrs = {name: value for name, value in tag.attrs.items() if name in ("class", "id", "colspan", "rowspan")}
    body = volumes.put_back(page.article.decode_contents(), formula)
    return XHTML.format(title=escape(page.title), body=f'<section id="{page.slug}">{body}</section>')


def title_page():
    body = f"""<section class="title" id="title"><h1>{escape(CITATION["title"])}</h1>
<p>{escape(CITATION["authors"][0]["name"])}</p><p>Version {version()}, {date():%-d %B %Y}</p>
<p>{escape(" ".join(CITATION["abstract"].split()))}</p>
<p>Figures that move on the page of the site stand here as a telling picture, or as up to four.</p>
<p>To cite: {escape(citation())}.</p><p>{LICENCE} {FACES}</p></section>"""
    return XHTML.format(title=escape(CITATION["title"]), body=body)


def contents(pages):
    """The contents, two levels deep, parts around them."""
    out, part, items = [], None, []

    def close():
        if items:
            inner = "".join(items)
            out.append(f"<li><span>{escape(part)}</span><ol>{inner}</ol></li>" if part else inner)

    for page in pages:
        if page.part != part:
            close()
            part, items = page.part, []
        sections = "".join(
            f'<li><a href="{page.slug}.xhtml#{section["id"]}">{escape(words(heading))}</a></li>'
            for heading in (page.article.find_all("h2") if page.part == "Chapters" else ())
            if (section := heading.find_parent("section", id=True))
        )
        inner = f"<ol>{sections}</ol>" if sections else ""
        items.append(f'<li><a href="{page.slug}.xhtml">{escape(page.title)}</a>{inner}</li>')
    close()
    return XHTML.format(
        title="Contents", body=f'<nav epub:type="toc" id="toc"><h1>Contents</h1><ol>{"".join(out)}</ol></nav>'
    )


def package(files, order):
    """The OPF file: what the book is, what is in it, in which order it is read."""
    entries = []
    for n, name in enumerate(files):
        properties = [word for word, sign in (("mathml", b"<math"), ("nav", b'epub:type="toc"')) if sign in files[name]]
        properties = properties if name.endswith(".xhtml") else []
        more = f' properties="{" ".join(properties)}"' if properties else ""
        entries.append(f'<item id="f{n}" href="{name}" media-type="{KINDS[Path(name).suffix]}"{more}/>')
    number = {name: n for n, name in enumerate(files)}
    spine = "".join(f'<itemref idref="f{number[name]}"/>' for name in order)
    access = "".join(f'<meta property="schema:{name}">{v}</meta>' for name, values in ACCESS.items() for v in values)
    unique = uuid.uuid5(uuid.NAMESPACE_URL, f"{CITATION['title']} {version()}")
    return f"""<?xml version="1.0" encoding="utf-8"?>
<package xmlns="http://www.idpf.org/2007/opf" version="3.0" unique-identifier="id" xml:lang="en">
<metadata xmlns:dc="http://purl.org/dc/elements/1.1/"><dc:identifier id="id">urn:uuid:{unique}</dc:identifier>
<dc:title>{escape(CITATION["title"])}</dc:title><dc:language>en</dc:language>
<dc:creator>{escape(CITATION["authors"][0]["name"])}</dc:creator><dc:rights>{LICENCE}</dc:rights>
<dc:date>{date()}</dc:date><meta property="dcterms:modified">{date()}T00:00:00Z</meta>{access}</metadata>
<manifest>{"".join(entries)}</manifest><spine>{spine}</spine></package>
"""


def make(html=HTML, out=OUT, listed=None):
    """The first volume as EPUB; its path."""
    out.mkdir(parents=True, exist_ok=True)
    volumes, files = Volumes(html, listed), Files(Path(html))
    pages = volumes.pages["book"]
    home = {tag["id"]: f"{page.slug}.xhtml" for page in pages for tag in page.article.find_all(id=True)}
    home |= {page.slug: f"{page.slug}.xhtml" for page in pages}
    written = {"title.xhtml": title_page(), "contents.xhtml": contents(pages)}
    written |= {f"{page.slug}.xhtml": chapter(volumes, page, files, home) for page in pages}
    every = {name: text.encode() for name, text in written.items()} | files.all
    path = out / "book.epub"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mimetype", "application/epub+zip", zipfile.ZIP_STORED)
        archive.writestr("META-INF/container.xml", CONTAINER)
        archive.writestr("book/book.opf", package(every, list(written)))
        for name, data in every.items():
            archive.writestr(f"book/{name}", data)
    return path


if __name__ == "__main__":
    path = make()
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e6:.1f} MB")
