"""The Sphinx extension of this book: equation numbers, offline pages, accessibility, generated appendices."""

from companion import (
    accessible,
    api,
    downloads,
    equations,
    ledger,
    links,
    listing,
    mathematics,
    offline,
    record,
    repository,
)

PARTS = (equations, mathematics, offline, accessible, repository, ledger, links, listing, record, api, downloads)


def setup(app):
    for part in PARTS:
        part.setup(app)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
