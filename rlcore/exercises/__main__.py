"""python -m rlcore.exercises [notebook or folder ...]: check notebooks; --write generates them anew.

One folder a learner and --summary: a table of the class, a row a learner. A folder is searched for notebooks.
"""

import argparse
import ast
import json
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

from rlcore.core.extras import extra
from rlcore.exercises import EXERCISES, PAGES, own
from rlcore.exercises.notebook import page_of, write

STATUS = ("passed", "failed", "error", "not attempted", "missing")
TIME_LIMIT = 900  # seconds for one cell


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m rlcore.exercises", description=__doc__)
    parser.add_argument("notebooks", nargs="*", type=Path, help="default: every notebook in book/exercises")
    parser.add_argument("--junit", type=Path, default=Path("exercises.xml"), help="where to write the JUnit file")
    parser.add_argument("--markdown", type=Path, help="also append the table to this file, as Markdown")
    parser.add_argument(
        "--cases", type=Path, help="a file or folder with cases of your own, which learners do not have"
    )
    parser.add_argument("--summary", action="store_true", help="a row a folder (a learner): points, and what failed")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write fresh notebooks into FOLDER and stop")
    parser.add_argument("--force", action="store_true", help="with --write: also over notebooks with other contents")
    parser.add_argument("--timeout", type=int, default=TIME_LIMIT, help="seconds for one cell (%(default)s)")
    options = parser.parse_args(arguments)
    if options.write:
        try:
            paths = write(PAGES, options.write, force=options.force)
        except FileExistsError as error:
            print(error, file=sys.stderr)
            return 2
        print(*paths, sep="\n")
        return 0
    given = options.notebooks or [Path("book/exercises")]
    absent = [str(path) for path in given if not path.exists()]
    notebooks = [path for one in given for path in (sorted(one.rglob("*.ipynb")) if one.is_dir() else [one])]
    notebooks = [path for path in notebooks if ".ipynb_checkpoints" not in path.parts]
    if absent or not notebooks:
        print(f"no notebook {', '.join(absent) or 'in ' + ', '.join(map(str, given))}", file=sys.stderr)
        return 2
    try:
        cases = own.read(options.cases) if options.cases else {}
    except (ValueError, OSError, SyntaxError) as error:
        print(error, file=sys.stderr)
        return 2
    found = {path: results(path, options.timeout, cases) for path in notebooks}
    rows = [row for part in found.values() for row in part]
    text = summary(found, given) if options.summary else table(rows)
    print(text)
    junit(rows).write(options.junit, encoding="utf-8", xml_declaration=True)
    if options.markdown:
        with options.markdown.open("a", encoding="utf-8") as file:
            file.write(f"```\n{text}\n```\n" if options.summary else markdown(rows))
    return int(any(status in ("failed", "error", "missing") for *_, status, _ in rows))


def results(path, timeout=TIME_LIMIT, cases=None):
    """(notebook, id, status, message) of every exercise of the notebook, by running it; one row where it cannot run.

    cases: of an instructor's own, from own.read.
    """
    with extra("exercises"):
        import nbformat
        from nbclient import NotebookClient

    try:
        notebook = nbformat.read(path, as_version=4)
        cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    except Exception as error:
        return [(str(path), path.stem, "error", f"this is no notebook: {_short(error)}")]
    if cases:
        notebook.cells.append(nbformat.v4.new_code_cell(own.cell(cases)))
    asked, broken = {id for cell in cells for id in _checked(cell.source)}, None
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.jsonl")
        environment = {**os.environ, "RLCORE_EXERCISES_REPORT": str(report)}
        resources = {"metadata": {"path": path.parent}}
        try:
            client = NotebookClient(notebook, timeout=timeout, allow_errors=True, resources=resources)
            client.execute(env=environment, stderr=subprocess.DEVNULL)
        except Exception as error:  # a kernel that is unknown or dies, a cell that never ends
            broken = f"the notebook did not run to its end: {_short(error)}"
        lines = report.read_text(encoding="utf-8").splitlines() if report.exists() else []
    rows = list(map(json.loads, lines))
    found = {row["id"]: row for row in rows if "status" in row}
    for id in (cases or {}).keys() & {id for id, row in found.items() if row["status"] == "passed"}:
        mine = next((row for row in rows if row["id"] == id and "status" not in row), None)
        if wrong := own.judge(id, cases[id], mine):
            found[id] = dict(zip(("status", "message"), wrong))
    reasons, rows = [broken or _first_error(notebook)], []
    for id in _expected(path, asked):
        if id in found:
            rows.append((str(path), id, found[id]["status"], found[id]["message"]))
        elif id in asked:
            rows.append(
                (str(path), id, "error", f"its check was not reached: {reasons.pop() if reasons else 'as above'}")
            )
        else:
            rows.append((str(path), id, "missing", "no cell checks it"))
    if broken and reasons:
        rows.append((str(path), path.stem, "error", broken))
    return rows or [(str(path), path.stem, "missing", "no cell checks an exercise")]


def _checked(source):
    """The ids that a cell gives to check; text and comments do not count."""
    source = "\n".join(line for line in source.splitlines() if not line.lstrip().startswith(("%", "!")))
    try:
        calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call) and node.args]
    except (SyntaxError, ValueError):
        return re.findall(r"^[^#\n]*check\(\s*[\"']([a-z0-9]+-[a-z0-9-]+)", source, re.M)
    named = [c.args[0] for c in calls if getattr(c.func, "id", getattr(c.func, "attr", "")) == "check"]
    return [node.value for node in named if isinstance(node, ast.Constant) and node.value in EXERCISES]


def _expected(path, asked):
    """The exercises of the notebook's page, told by its name or by what it checks; and others that it checks."""
    pages = {page_of(module) for module in PAGES.values() if module.NOTEBOOK in path.stem}
    pages = pages or {id.partition("-")[0] for id in asked}
    return [id for id in EXERCISES if id in asked or id.partition("-")[0] in pages]


def _short(error):
    lines = [line for line in re.sub(r"\x1b\[[0-9;]*m", "", str(error)).splitlines() if line.strip()]
    return f"{type(error).__name__}: {(lines or ['no more is known'])[0][:200]}"


def _first_error(notebook):
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if output.output_type == "error":
                return f"{output.ename}: {output.evalue}"
    return "no cell calls it"


def points(rows):
    """The points that were reached, and all there are: the minutes of an exercise."""
    worth = {id: EXERCISES[id].minutes if id in EXERCISES else 0 for _, id, _, _ in rows}
    return sum(worth[id] for _, id, status, _ in rows if status == "passed"), sum(worth[id] for _, id, _, _ in rows)


def table(rows):
    width = max((len(id) for _, id, _, _ in rows), default=0)
    lines = [f"{id:{width}}  {status:13}  {_why(status, message)}".rstrip() for _, id, status, message in rows]
    counts = [f"{sum(row[2] == status for row in rows)} {status}" for status in STATUS]
    return "\n".join([*lines, "", ", ".join(counts), "{} of {} points".format(*points(rows))])


def summary(found, given):
    """A row a folder or notebook that was named: its points out of those of the class, counts, and what is not right.

    An exercise that others have and this learner has not, a notebook left out or broken, is missing.
    """
    everything = {id for rows in found.values() for _, id, _, _ in rows if id in EXERCISES}
    worth = sum(EXERCISES[id].minutes for id in everything)
    lines = [f"{'learner':24} points     {'  '.join(STATUS)}"]
    for one in given:
        rows = [row for path, part in found.items() if path == one or one in path.parents for row in part]
        count = Counter(status for *_, status, _ in rows)
        count["missing"] += len(everything - {id for _, id, _, _ in rows})
        counts = "  ".join(f"{count[status]:{len(status)}}" for status in STATUS)
        wrong = ", ".join(id for _, id, status, _ in rows if status in ("failed", "error"))
        lines.append(f"{one.name:24} {points(rows)[0]:4} / {worth:<4} {counts}  {wrong}".rstrip())
    return "\n".join(lines)


def markdown(rows):
    cells = ((id, status, _why(status, message).replace("|", "\\|")) for _, id, status, message in rows)
    lines = [f"| {id} | {status} | {why} |" for id, status, why in cells]
    return "\n".join(["| exercise | result | why |", "| --- | --- | --- |", *lines, ""])


def _why(status, message):
    if status not in ("failed", "error", "missing"):
        return ""
    lines = _printable(message).strip().splitlines() or [""]
    return lines[-1 if status == "error" else 0]


def _printable(text):
    """text without the characters that XML forbids, and without the colours of a terminal."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", text)
    return re.sub("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)


def junit(rows):
    tags = {"failed": "failure", "error": "error", "missing": "error", "not attempted": "skipped"}
    counts = {f"{tag}s": 0 for tag in ("failure", "error")} | {"skipped": 0}
    suite = ElementTree.Element("testsuite", name="exercises")
    for name, id, status, message in rows:
        classname = _printable(name.removesuffix(".ipynb"))
        case = ElementTree.SubElement(suite, "testcase", classname=classname, name=_printable(id))
        if tag := tags.get(status):
            counts[tag if tag == "skipped" else f"{tag}s"] += 1
            text = _printable(message)
            ElementTree.SubElement(case, tag, message=(text.splitlines() or [""])[0]).text = text
    suite.attrib |= {"tests": str(len(rows)), **{name: str(n) for name, n in counts.items()}}
    return ElementTree.ElementTree(suite)


if __name__ == "__main__":
    sys.exit(main())
