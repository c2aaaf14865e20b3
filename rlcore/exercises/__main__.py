"""python -m rlcore.exercises [notebook ...]: check the learner's notebooks; --write generates them anew."""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from rlcore.core.extras import extra
from rlcore.exercises import CHAPTERS, EXERCISES
from rlcore.exercises.notebook import write


def main(arguments=None):
    parser = argparse.ArgumentParser(prog="python -m rlcore.exercises", description=__doc__)
    parser.add_argument("notebooks", nargs="*", type=Path, help="default: every notebook in book/exercises")
    parser.add_argument("--junit", type=Path, default=Path("exercises.xml"), help="where to write the JUnit file")
    parser.add_argument("--markdown", type=Path, help="also append the table to this file, as Markdown")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write fresh notebooks into FOLDER and stop")
    options = parser.parse_args(arguments)
    if options.write:
        for path in write(CHAPTERS, options.write):
            print(path)
        return 0
    notebooks = options.notebooks or sorted(Path("book/exercises").glob("*.ipynb"))
    if not notebooks or (absent := [str(path) for path in notebooks if not path.is_file()]):
        print(f"no notebook {', '.join(absent) if notebooks else 'in book/exercises'}", file=sys.stderr)
        return 2
    rows = [row for path in notebooks for row in results(path)]
    print(table(rows))
    junit(rows).write(options.junit, encoding="utf-8", xml_declaration=True)
    if options.markdown:
        with options.markdown.open("a", encoding="utf-8") as file:
            file.write(markdown(rows))
    return int(any(status in ("failed", "error") for *_, status, _ in rows))


def results(path):
    """(notebook, id, status, message) of every exercise that the notebook checks, by running it."""
    with extra("exercises"):
        import nbformat
        from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.jsonl")
        environment = {**os.environ, "RLCORE_EXERCISES_REPORT": str(report)}
        client = NotebookClient(notebook, timeout=900, allow_errors=True, resources={"metadata": {"path": path.parent}})
        client.execute(env=environment)
        lines = report.read_text(encoding="utf-8").splitlines() if report.exists() else []
    found = {row["id"]: row for row in map(json.loads, lines)}
    text = "\n".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    asked = [id for id in EXERCISES if f'"{id}"' in text or f"'{id}'" in text]
    nothing = {"status": "error", "message": f"the notebook never reached its check: {_first_error(notebook)}"}
    return [(path.name, id, *(found.get(id, nothing)[key] for key in ("status", "message"))) for id in asked]


def _first_error(notebook):
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if output.output_type == "error":
                return f"{output.ename}: {output.evalue}"
    return "no cell calls it"


def table(rows):
    width = max((len(id) for _, id, _, _ in rows), default=0)
    lines = [f"{id:{width}}  {status:13}  {_why(status, message)}".rstrip() for _, id, status, message in rows]
    counts = {
        status: sum(row[2] == status for row in rows) for status in ("passed", "failed", "error", "not attempted")
    }
    return "\n".join([*lines, "", ", ".join(f"{count} {status}" for status, count in counts.items())])


def markdown(rows):
    cells = ((id, status, _why(status, message).replace("|", "\\|")) for _, id, status, message in rows)
    lines = [f"| {id} | {status} | {why} |" for id, status, why in cells]
    return "\n".join(["| exercise | result | why |", "| --- | --- | --- |", *lines, ""])


def _why(status, message):
    return message.strip().splitlines()[-1 if status == "error" else 0] if status in ("failed", "error") else ""


def junit(rows):
    counts = {"tests": len(rows)}
    for name, status in (("failures", "failed"), ("errors", "error"), ("skipped", "not attempted")):
        counts[name] = sum(row[2] == status for row in rows)
    suite = ElementTree.Element("testsuite", name="exercises", **{name: str(n) for name, n in counts.items()})
    for name, id, status, message in rows:
        case = ElementTree.SubElement(suite, "testcase", classname=name.removesuffix(".ipynb"), name=id)
        if tag := {"failed": "failure", "error": "error", "not attempted": "skipped"}.get(status):
            ElementTree.SubElement(case, tag, message=message.splitlines()[0]).text = message
    return ElementTree.ElementTree(suite)


if __name__ == "__main__":
    sys.exit(main())
