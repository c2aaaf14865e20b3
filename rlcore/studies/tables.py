"""The tables of runs in book/data: text files with one row a run."""

import csv
from pathlib import Path


def read(path):
    """Rows of a table of runs, [{column: value}]: numbers as float, None where there is none; [] where no file is.

    Lines that begin with # say where the numbers come from. fig-56, fig-61
    """
    if not isinstance(path, str | Path):
        raise ValueError(f"path: got {path!r}, must be the name of a file")
    if not Path(path).exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [{key: _value(text) for key, text in row.items()} for row in rows]


def _value(text):
    try:
        return float(text) if text else None
    except ValueError:
        return text
