"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from rlcore.core.checks import show


def check_path(name: str, path: Any, given: Any = None) -> Path:
    """path as a Path; ValueError unless a file can have this name."""
    if not isinstance(path, str | os.PathLike) or not str(path) or "\0" in str(path) or Path(path).is_dir():
        raise ValueError(f"{name}: got {show(path)}, must be the name of a file")
    if not Path(path).parent.is_dir():
        raise ValueError(f"{name}: got {show(str(path))}, must be in a folder that exists")
    return Path(path)


@contextmanager
def whole(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """A file to write to, which takes the place of `path` when it is finished: all of it, or nothing."""
    path = Path(path)
    part = path.with_name(f".{secrets.token_hex(8)}.part")  # nobody else's, also of a long name
    try:
        with open(part, mode) as out:
            yield out
            out.flush()
            os.fsync(out.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
