"""The Sphinx extension of this book: equation numbers, offline pages, accessibility, generated appendices."""

from companion import accessible, api, equations, ledger, listing, mathematics, offline, repository

PARTS = (equations, mathematics, offline, accessible, repository, ledger, listing, api)


def setup(app):
    for part in PARTS:
        part.setup(app)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
