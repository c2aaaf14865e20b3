"""The notebooks of the exercises, generated from the declarations."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rlcore.exercises.engine import EXERCISES, Verdict

KIND = {
    "fill in": "fill in the update",
    "by hand": "compute by hand, then check",
    "find the bug": "find the silent bug",
    "predict": "predict, then run",
    "build": "build an environment",
    "experiment": "confirm or refute a claim",
}

PAGES = (  # the last equation of each chapter that numbers any
    (11, "01_mdp"),
    (17, "02_bellman"),
    (21, "04_temporal_difference"),
    (41, "05_eligibility_traces"),
)

PAGES_AGAIN = {  # the document numbers from 20 a second time
    "nn": "06_neural_networks",
    "rf": "07_reinforce",
    "ppo": "08_ppo",
}


def write(chapters: Mapping[str, Any], folder: str | Path, *, force: bool = False) -> list[Path]:
    """Write the notebook of every chapter module into `folder`; returns the paths.

    Raises FileExistsError, and writes nothing, where one is there in which a cell of code differs from the untouched
    one, unless `force`.
    """
    new = {Path(folder) / f"{module.NOTEBOOK}.ipynb": build(module) for module in chapters.values()}
    answered = [str(path) for path, notebook in new.items() if path.exists() and _answered(path, notebook)]
    if answered and not force:
        raise FileExistsError(f"folder: {', '.join(answered)} would be overwritten; move them, or use --force")
    for path, notebook in new.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return list(new)


def _answered(path, notebook):
    """Whether a notebook holds code that the generated one does not."""
    try:
        old = json.loads(path.read_text(encoding="utf-8"))
        return not _programs(old) <= _programs(notebook)
    except (ValueError, KeyError, TypeError, AttributeError):
        return True


def _programs(notebook):
    return {"".join(cell["source"]).strip() for cell in notebook["cells"] if cell["cell_type"] == "code"} - {""}


def build(module: Any) -> dict[str, Any]:
    """The notebook of one chapter as a dictionary, with the outputs that an untouched copy shows."""
    prefix = module.__name__.rpartition(".")[2].split("_")[0]
    mine = [exercise for id, exercise in EXERCISES.items() if id.startswith(prefix + "-")]
    cells = [_markdown(_head(module, mine)), _code(_setup(mine))]
    labels = {**KIND, **getattr(module, "LABELS", {})}
    for number, exercise in enumerate(mine, 1):
        cells.append(_markdown(_statement(exercise, number, labels[exercise.kind])))
        cells.append(_code(exercise.stub))
        verdict = Verdict("not attempted", f"write your answer in `{exercise.name}`, then run the check again")
        cells.append(_code(f'check("{exercise.id}", {exercise.name})', str(verdict), tag=f"check-{exercise.id}"))
        cells.append(_markdown(_folded(exercise)))
    cells.append(_markdown(_questions(module.QUESTIONS)))
    for number, cell in enumerate(cells, 1):
        cell["id"] = f"c{number:03d}"
    count = 0
    for cell in cells:
        if cell["cell_type"] == "code":
            count += 1
            cell["execution_count"] = count
            for output in cell["outputs"]:
                output["execution_count"] = count
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}


def _head(module, exercises):
    minutes = sum(exercise.minutes for exercise in exercises)
    chapter = f"[chapter](../{module.NOTEBOOK}.ipynb)"
    return f"""# {module.TITLE}

{len(exercises)} exercises, about {minutes} minutes in all, on this {chapter}. Write your answer in the cell below a
statement and run the check under it. The check runs your answer on cases of its own, stops it if it never ends, and
names the mistake where it is a usual one. `hint("{exercises[0].id}")` shows the hints one after the other,
`solution(...)` the solution after them; on the page both are folded below each exercise. The button with the arrow at
the top of the page downloads this notebook."""


def _setup(exercises):
    lines = dict.fromkeys(line for exercise in exercises for line in exercise.setup.splitlines() if line)
    return "\n".join([*lines, "", "from rlcore.exercises import check, hint, solution"])


def _statement(exercise, number, label):
    minutes = "1 minute" if exercise.minutes == 1 else f"{exercise.minutes} minutes"
    words = {3: "three", 4: "four", 5: "five", 6: "six"}
    digits = f" Numbers to {words[exercise.digits]} digits, or as formulas." if exercise.digits else ""
    return f"""<span id="{exercise.id}"></span>

## {number}. {exercise.title}

*{label.capitalize()}; about {minutes}.*

{_with_links(exercise.statement)}{digits}"""


def _with_links(text):
    """Equation references as links that a notebook and the page both understand."""

    def link(found):
        series, number = found.groups()
        page = PAGES_AGAIN[series] if series else next(page for last, page in PAGES if int(number) <= last)
        return f"[equation ({int(page[:2])}.{number})](../{page}.ipynb)"

    return re.sub(r"\{eq\}`eq-(?:(nn|rf|ppo)-)?(\d+)`", link, text)


def _folded(exercise):
    hints = [_details(f"Hint {i}", text) for i, text in enumerate(exercise.hints, 1)]
    return "\n\n".join([*hints, _details("Solution", f"```python\n{exercise.solution}\n```")])


def _details(summary, text):
    return f"<details>\n<summary>{html.escape(summary)}</summary>\n\n{text}\n\n</details>"


def _questions(questions):
    parts = ["## Questions", "Open the answer that you think is right; each says why it is, or is not."]
    for number, question in enumerate(questions, 1):
        parts.append(f"**Question {number}.** {question.text}")
        for letter, (text, right, why) in zip("abcdef", question.choices):
            parts.append(_details(f"{letter}) {text}", f"**{'Right' if right else 'No'}.** {why}"))
    return "\n\n".join(parts)


def _markdown(text):
    return {"cell_type": "markdown", "id": "", "metadata": {}, "source": _lines(text)}


def _code(source, output=None, tag=None):
    data = {"data": {"text/plain": _lines(output)}, "metadata": {}, "output_type": "execute_result"} if output else None
    metadata = {"tags": [tag]} if tag else {}
    return {
        "cell_type": "code",
        "execution_count": None,
        "id": "",
        "metadata": metadata,
        "outputs": [data] if data else [],
        "source": _lines(source),
    }


def _lines(text):
    return text.strip("\n").splitlines(keepends=True)
