"""The tables of runs in book/data: text files with one row a run."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, TypeAlias

from rlcore.core.checks import show
from rlcore.core.rules import checked
from rlcore.core.types import File

Rows: TypeAlias = list[dict[str, Any]]  # {column: value} each


def _path(name, path, given):
    if not isinstance(path, str | Path) or Path(path).is_dir():
        raise ValueError(f"{name}: got {show(path)}, must be the name of a file")
    return Path(path)


@checked(path=_path)
def read(path: File) -> Rows:
    """Rows of a table of runs.

    Parameters
    ----------
    path : File
        A CSV file; lines that begin with # say where the numbers come from.

    Returns
    -------
    Rows
        {column: value} each: numbers as float, None where there is none; [] where no file is.

    Raises
    ------
    ValueError
        Where a row is longer than the first.

    Notes
    -----
    Ledger: fig-56, fig-61.
    """
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        rows = [{key: _value(text) for key, text in row.items()} for row in rows]
    if any(None in row for row in rows):
        raise ValueError(f"path: {path} has a row longer than the first, must be a table")
    return rows


def _value(text):
    try:
        return float(text) if text else None
    except (ValueError, TypeError):
        return text
