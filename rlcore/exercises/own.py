"""An instructor's own cases: arguments that learners do not have, results that never enter their kernel.

A file of Python, or a folder of such files, binds CASES, a dict of exercise id -> list of dicts of arguments. What is
right comes from the solution of the exercise.
"""

from __future__ import annotations

import base64
import json
import os
import pickle
import runpy
from collections.abc import Mapping
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

from rlcore.exercises.engine import EXERCISES, Case, call, last_answers, problem_of, report_of
from rlcore.exercises.sandbox import Crash, pack, run_guarded, unpack


def read(path: Path) -> dict[str, list[Case]]:
    """The cases of a file or of all files of a folder; ValueError where one cannot be used."""
    files = sorted(path.glob("*.py")) if path.is_dir() else [path]
    found: dict[str, list[Case]] = {}
    for file in files:
        declared = runpy.run_path(str(file)).get("CASES")
        if not isinstance(declared, dict):
            raise ValueError(f"cases: {file} binds no CASES, must bind a dict of exercise id -> list of arguments")
        for id, given in declared.items():
            if id not in EXERCISES or not EXERCISES[id].is_function:
                raise ValueError(f"cases: {file} has {id!r}, must be the id of an exercise whose answer is a function")
            found.setdefault(id, []).extend(_case(file, id, one) for one in given)
    if not any(found.values()):
        raise ValueError(f"cases: got {path}, must be a file or a folder with at least one case")
    return found


def _case(file, id, given):
    exercise = EXERCISES[id]
    first = exercise.make_cases()[0]
    if not isinstance(given, Mapping) or set(given) != set(first.given):
        raise ValueError(f"cases: {file}, {id}: got {given!r}, must be a dict with {', '.join(first.given)}")
    given = {name: given[name] for name in first.given}
    try:
        expected = exercise.bind(exercise.solution)(*deepcopy(given).values())
    except Exception as error:
        raise ValueError(f"cases: {file}, {id}: the solution raises {error!r} for {given}") from error
    return Case(given, expected, first.tol)


def cell(cases: Mapping[str, list[Case]]) -> str:
    """The code of the cell that runs the last answers of a notebook on the arguments of these cases."""
    data = base64.b64encode(pickle.dumps({id: [case.given for case in own] for id, own in cases.items()})).decode()
    return f"from rlcore.exercises.own import answer\nanswer({data!r})"


def answer(data: str) -> None:
    """In the learner's kernel: append what the answers give for the arguments to the report."""
    for id, given in pickle.loads(base64.b64decode(data)).items():
        if id not in last_answers:
            continue
        try:
            results = run_guarded(partial(_results, last_answers[id], given), EXERCISES[id].seconds)
            row = {"id": id, "own": base64.b64encode(pack("done", results, [])).decode()}
        except Crash as crash:
            row = {"id": id, "crash": str(crash)}
        with open(os.environ["RLCORE_EXERCISES_REPORT"], "a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def _results(last, given):
    return [call(last, one) for one in given]


def judge(id: str, cases: list[Case], row: Mapping[str, Any] | None) -> tuple[str, str] | None:
    """(status, message) where an answer is wrong on one of the instructor's own cases; None where it is right."""
    if row is None:
        return "error", "right on the cases of the page, but the notebook did not reach the own cases"
    if "crash" in row:
        return "error", f"on an own case: {row['crash']}"
    status, results, _ = unpack(base64.b64decode(row["own"]))
    if status != "done" or len(results) != len(cases):
        return "error", "the results of the own cases cannot be read"
    for number, (case, (got, changed)) in enumerate(zip(cases, results), 1):
        if changed:
            return "failed", f"own case {number}: changes its argument `{changed}`"
        if problem := problem_of(EXERCISES[id], got, case):
            return "failed", f"own case {number}: {report_of(EXERCISES[id], case, got, problem)}"
    return None
