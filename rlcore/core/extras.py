"""What comes with an extra says so where it is missing: `with extra("gym"): import gymnasium`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Imports inside it that find no package raise an error that names the extra of rlcore which brings it."""
    try:
        yield
    except ModuleNotFoundError as error:
        advice = f"{error.name} is not installed, it comes with: pip install 'rlcore[{name}]'"
        raise ModuleNotFoundError(advice, name=error.name, path=error.path) from None
