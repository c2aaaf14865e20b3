"""What a release has to take along, on the first page; where BOOK_REPOSITORY and BOOK_RELEASE=v1.2.3 are set."""

import os

from docutils import nodes

FILES = {
    "the book as PDF, A4": "book-A4.pdf",
    "Letter": "book-Letter.pdf",
    "the record, A4": "record-A4.pdf",
    "Letter ": "record-Letter.pdf",
    "the book as EPUB": "book.epub",
    "the site as a zip": "site.zip",
}


def offer(app, doctree):
    url, tag = os.environ.get("BOOK_REPOSITORY", "").rstrip("/"), os.environ.get("BOOK_RELEASE", "")
    if app.env.docname != app.config.root_doc or not url or not tag:
        return
    links = [
        nodes.reference("", name.strip(), refuri=f"{url}/releases/download/{tag}/{f}") for name, f in FILES.items()
    ]
    parts = [part for link in links for part in (nodes.Text(", "), link)][1:]
    section = next(doctree.findall(nodes.section))
    section.append(
        nodes.paragraph("", "", nodes.strong("", "To take along"), nodes.Text(f", version {tag[1:]}: "), *parts)
    )


def setup(app):
    app.connect("doctree-read", offer)
