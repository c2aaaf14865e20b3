"""The notebooks of the exercises, generated from the declarations."""

from __future__ import annotations

import html
import json
import re
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rlcore.exercises.engine import Verdict, on_page

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
    """The notebook of one module of declarations as a dictionary, with the outputs that an untouched copy shows."""
    mine = on_page(page_of(module))
    cells = [_markdown(_head(module, mine)), _code(_setup(mine))]
    labels = {**KIND, **getattr(module, "LABELS", {})}
    for number, exercise in enumerate(mine, 1):
        if number == 1 or exercise.tier != mine[number - 2].tier:
            cells.append(_markdown(_tier(exercise.tier, mine, module)))
        cells.append(_markdown(_statement(exercise, number, labels[exercise.kind], module)))
        cells.append(_code(exercise.stub))
        verdict = Verdict("not attempted", f"write your answer in `{exercise.name}`, then run the check again")
        source = f'check("{exercise.id}", {exercise.name})'
        cells.append(_code(source, str(verdict), [f"check-{exercise.id}", "remove-output"]))
        cells.append(_markdown(_folded(exercise)))
    for part, write in (("PROOFS", _proofs), ("QUESTIONS", _questions)):
        if declared := getattr(module, part, ()):
            cells.append(_markdown(write(declared)))
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


def page_of(module: Any) -> str:
    """What the ids of a module's exercises begin with: ch01 of ch01_mdp, agent of agent_steps."""
    return module.__name__.rpartition(".")[2].partition("_")[0]


HOW = """Write your answer in the cell below a statement and run the check under it: it runs your answer on cases of its
own, stops what never ends, and names the mistake where it is a usual one. `hint("{id}")` shows the hints one after the
other, `solution(...)` the solution after them<span class="on-screen">; on the page both are folded below each
exercise</span>.

<span class="on-screen">**How to work on it:** on the page, where it has buttons *Answer here*; in JupyterLab, which
`make lab` opens; on a fork, where the workflow *exercises* checks each push. The button with the arrow at the top
downloads the notebook.</span>"""


def _head(module, exercises):
    minutes = sum(exercise.minutes for exercise in exercises)
    chapter = f"on this [chapter](../{module.NOTEBOOK}.ipynb)"
    what = getattr(module, "INTRO", f"{len(exercises)} exercises, about {minutes} minutes in all, {chapter}.")
    return f"# {module.TITLE}\n\n{what.format(minutes=minutes)} {HOW.format(id=exercises[0].id)}"


TIER = {
    "core": "what every reader of the chapter should be able to do",
    "more": "for practice, and for the places where programs go wrong",
    "deep": "longer, or closer to research",
}


def _tier(tier, exercises, module):
    mine = [exercise for exercise in exercises if exercise.tier == tier]
    if hasattr(module, "INTRO"):
        return f"## Steps\n\n{len(mine)} steps; each uses those before it."
    minutes = sum(exercise.minutes for exercise in mine)
    count = "One exercise" if len(mine) == 1 else f"{len(mine)} exercises"
    return f"## {tier.capitalize()}\n\n{count}, about {minutes} minutes: {TIER[tier]}."


def _setup(exercises):
    lines = dict.fromkeys(line for exercise in exercises for line in exercise.setup.splitlines() if line)
    return "\n".join([*lines, "", "from rlcore.exercises import check, hint, solution"])


def _statement(exercise, number, label, module):
    minutes = "1 minute" if exercise.minutes == 1 else f"{exercise.minutes} minutes"
    words = {3: "three", 4: "four", 5: "five", 6: "six"}
    digits = f" Numbers to {words[exercise.digits]} digits, or as formulas." if exercise.digits else ""
    section = f" On [{exercise.section}](../{module.NOTEBOOK}.ipynb#{slug(exercise.section)})." * bool(exercise.section)
    return f"""<span id="{exercise.id}"></span>

### {number}. {exercise.title}

*{label.capitalize()}; about {minutes}.*{section}

{_with_links(exercise.statement)}{digits}"""


def slug(heading: str) -> str:
    """The id that a heading has on its page."""
    text = unicodedata.normalize("NFKD", re.sub(r"[$`*\\]", "", heading)).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", text).strip("-")


def _with_links(text):
    """Equation references as links that a notebook and the page both understand."""

    def link(found):
        series, number = found.groups()
        page = PAGES_AGAIN[series] if series else next(page for last, page in PAGES if int(number) <= last)
        label = found[0].split("`")[1]
        return f"[equation ({int(page[:2])}.{number})](../{page}.ipynb#{label})"

    return re.sub(r"\{eq\}`eq-(?:(nn|rf|ppo)-)?(\d+)`", link, text)


def _folded(exercise):
    hints = [_details(f"Hint {i}", text) for i, text in enumerate(exercise.hints, 1)]
    return "\n\n".join([*hints, _details("Solution", f"```python\n{exercise.solution}\n```")])


def _details(summary, text):
    return f"<details>\n<summary>{html.escape(summary)}</summary>\n\n{text}\n\n</details>"


ASKED = '<span class="on-screen">Open the answer that you think is right; each says why it is, or is not.</span>'


def _questions(questions):
    parts = ["## Questions", ASKED]
    for number, question in enumerate(questions, 1):
        parts.append(f"**Question {number}.** {question.text}")
        for letter, (text, right, why) in zip("abcdef", question.choices):
            parts.append(_details(f"{letter}) {text}", f"**{'Right' if right else 'No'}.** {why}"))
    return "\n\n".join(parts)


def _proofs(proofs):
    parts = ["## Proofs", "On paper. When you are done, see whether all of it is there, and compare."]
    for number, proof in enumerate(proofs, 1):
        needs = "\n".join(f"* {need}" for need in proof.needs)
        parts.append(f"**Proof {number}. {proof.title}.** {_with_links(proof.statement)}")
        parts.append(_details("What a proof must contain", needs))
        parts.append(_details("A proof", _with_links(proof.proof)))
    return "\n\n".join(parts)


def _markdown(text):
    return {"cell_type": "markdown", "id": "", "metadata": {}, "source": _lines(text)}


def _code(source, output=None, tags=()):
    data = {"data": {"text/plain": _lines(output)}, "metadata": {}, "output_type": "execute_result"} if output else None
    metadata = {"tags": list(tags)} if tags else {}
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
