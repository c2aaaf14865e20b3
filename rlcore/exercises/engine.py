"""Exercises that know what went wrong: declarations, the checker, hints and solutions."""

from __future__ import annotations

import html
import inspect
import json
import os
import textwrap
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any

import numpy as np

from rlcore.exercises.compare import difference, show, unchanged
from rlcore.exercises.sandbox import Crash, run_guarded

EXERCISES = {}


@dataclass(frozen=True)
class Case:
    """One call of the answer: its arguments by name, and what it must give.

    given: dict of argument name -> value, empty where the answer is no function but a value. expected: from
    rlcore, a closed form or a committed number. tol: largest absolute and relative difference. printed: whether the
    statement shows this case; at least one case of an exercise must not be.
    """

    given: dict
    expected: object
    tol: float = 1e-8
    printed: bool = False


@dataclass(frozen=True)
class Wrong:
    """A usual mistake: an answer that makes it, and the message that it must get.

    source: a program, or dict of text of the solution -> what replaces it; each text must occur exactly once. The
    Exercise turns a dict into the program.
    """

    source: str | dict
    message: str


@dataclass(frozen=True)
class Exercise:
    """One exercise, whole: page, notebook, check and tests are made from this.

    id: "chNN-words". kind: one of KINDS. statement, hints: Markdown. stub, solution: source that binds `name`, to a
    function or a value. cases: rng -> list of Case. minutes: estimate for a reader of the chapter. covers: ids of the
    concordance. seconds: time limit of a check.
    """

    id: str
    kind: str
    title: str
    statement: str
    stub: str
    cases: Callable
    hints: tuple
    solution: str
    wrong: tuple
    minutes: int
    covers: tuple
    seconds: float = 20.0
    setup: str = "import numpy as np"
    name: str = field(init=False)

    def __post_init__(self) -> None:
        for part in ("statement", "stub", "solution", "setup"):
            object.__setattr__(self, part, textwrap.dedent(getattr(self, part)).strip())
        wrong = tuple(Wrong(self._program(w.source), " ".join(w.message.split())) for w in self.wrong)
        object.__setattr__(self, "wrong", wrong)
        object.__setattr__(self, "hints", tuple(" ".join(textwrap.dedent(h).split()) for h in self.hints))
        scope = {}
        exec(self.setup + "\n" + self.stub, scope)
        names = [n for n in self._bound(self.stub)]
        object.__setattr__(self, "name", names[-1])
        problems = [
            (self.kind in KINDS, f"kind {self.kind!r} is not one of {KINDS}"),
            (len(self.hints) >= 2, "needs at least two hints"),
            (len(self.wrong) >= 3, "needs at least three wrong answers"),
            (self.id not in EXERCISES, "is declared twice"),
        ]
        for fine, problem in problems:
            if not fine:
                raise ValueError(f"exercise {self.id}: {problem}")
        EXERCISES[self.id] = self

    def _program(self, source):
        if isinstance(source, str):
            return textwrap.dedent(source).strip()
        program = self.solution
        for old, new in source.items():
            if not self.solution.count(old) == program.count(old) == 1:
                raise ValueError(f"exercise {self.id}: {old!r} must occur exactly once in the solution")
            program = program.replace(old, new)
        return program

    @staticmethod
    def _bound(source):
        import ast

        tree = ast.parse(source)
        for node in tree.body:
            if isinstance(node, ast.FunctionDef):
                yield node.name
            elif isinstance(node, ast.Assign):
                yield node.targets[0].id

    def bind(self, source: str) -> Any:
        """What `source` gives the exercise's name: a function or a value."""
        scope = {"__name__": self.id}
        for part in (self.setup, source):  # apart, as in the cells of a notebook: together they compile to other code
            exec(compile(part, f"<{self.id}>", "exec"), scope)
        return scope[self.name]

    def make_cases(self) -> list[Case]:
        """The cases, the same each time."""
        return self.cases(np.random.default_rng(sum(map(ord, self.id))))


KINDS = ("fill in", "by hand", "find the bug", "predict", "build", "experiment")


@dataclass(frozen=True)
class Question:
    """A question of understanding: choices are (text, whether it is right, why), exactly one of them right."""

    text: str
    choices: tuple

    def __post_init__(self) -> None:
        if sum(bool(right) for _, right, _ in self.choices) != 1:
            raise ValueError(f"question {self.text!r}: exactly one choice must be right")


@dataclass(frozen=True)
class Verdict:
    """What check found. status: passed, failed, not attempted, or error (the answer raised, or was stopped)."""

    status: str
    message: str

    def __str__(self) -> str:
        return f"{self.status}: {self.message}"

    def _repr_pretty_(self, printer, cycle):
        printer.text(str(self))


def check(id: str, answer: Any) -> Verdict:
    """Run the exercise's cases on the answer and say what is wrong, by name where the mistake is a usual one.

    id: of the exercise. answer: what the exercise asks for, a function or a value. Returns a Verdict, which shows
    itself in a notebook. The answer gets copies of its arguments and runs in a process of its own where the system
    can fork.
    """
    exercise = _find(id)
    verdict = _check(exercise, answer)
    if path := os.environ.get("RLCORE_EXERCISES_REPORT"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps({"id": id, "status": verdict.status, "message": verdict.message}) + "\n")
    return verdict


def _find(id):
    if id not in EXERCISES:
        close = [name for name in EXERCISES if name.startswith(str(id)[:4])]
        raise ValueError(f"id: got {id!r}, must be one of {sorted(close or EXERCISES)}")
    return EXERCISES[id]


def _check(exercise, answer):
    stub = exercise.bind(exercise.stub)
    if _same_code(stub, answer):
        return Verdict("not attempted", f"write your answer in `{exercise.name}`, then run the check again")
    if isinstance(stub, FunctionType) and not callable(answer):
        return Verdict("failed", f"got {show(answer)}; the answer must be the function `{exercise.name}` itself")
    if callable(answer) and not isinstance(stub, FunctionType):
        return Verdict("failed", f"got a function; the answer must be a value: check({exercise.id!r}, {exercise.name})")
    cases = exercise.make_cases()
    try:
        results = run_guarded(lambda: [_call(answer, case) for case in cases], exercise.seconds)
    except Crash as crash:
        return Verdict("error", str(crash))
    for case, (got, given) in zip(cases, results, strict=True):
        if (changed := unchanged(given, case.given)) is not None:
            return Verdict("failed", f"your function changes its argument `{changed}`; work on a copy of it")
        problem = difference(got, case.expected, case.tol)
        if problem:
            mistake = _known_mistake(exercise, cases, [got for got, _ in results])
            return Verdict("failed", mistake or _luck(cases, results) + _report(case, got, problem))
    return Verdict("passed", "right" if len(cases) == 1 else f"right on all {len(cases)} cases")


def _call(answer, case):
    given = deepcopy(case.given)
    return (answer(*given.values()) if case.given else answer), given


def _known_mistake(exercise, cases, got):
    for wrong in exercise.wrong:
        function = exercise.bind(wrong.source)
        try:
            outputs = [_call(function, case)[0] for case in cases]
        except Exception:  # this mistake crashes on these cases; an answer that ran did not make it
            continue
        if all(difference(g, o, c.tol) is None for g, o, c in zip(got, outputs, cases, strict=True)):
            return wrong.message
    return None


def _luck(cases, results):
    printed = [
        difference(got, case.expected, case.tol) is None for case, (got, _) in zip(cases, results) if case.printed
    ]
    return "right on the example of the statement, not in general: " if printed and all(printed) else ""


def _report(case, got, problem):
    rows = [
        *((f"with {name} = ", value) for name, value in case.given.items()),
        ("got ", got),
        ("expected ", case.expected),
    ]
    return "\n".join([problem, *(label + textwrap.indent(show(v), " " * len(label)).lstrip() for label, v in rows)])


def _same_code(stub, answer):
    if isinstance(stub, FunctionType) and isinstance(answer, FunctionType):
        return _code(stub.__code__) == _code(answer.__code__)
    return type(stub) is type(answer) and not callable(answer) and (stub is answer or repr(stub) == repr(answer))


def _code(code):
    constants = tuple(_code(c) if inspect.iscode(c) else repr(c) for c in code.co_consts)
    return code.co_code, constants, code.co_names, code.co_varnames


_given = {}


def hint(id: str) -> Note:
    """The next hint of the exercise; after the last one, the last one again."""
    exercise = _find(id)
    _given[id] = min(_given.get(id, 0) + 1, len(exercise.hints))
    return Note(f"Hint {_given[id]} of {len(exercise.hints)}: {exercise.hints[_given[id] - 1]}")


def solution(id: str) -> Note:
    """The solution, once every hint has been seen."""
    exercise = _find(id)
    left = len(exercise.hints) - _given.get(id, 0)
    if left > 0:
        return Note(f"There {'is 1 hint' if left == 1 else f'are {left} hints'} left: hint({id!r}) shows the next.")
    return Note(exercise.solution, is_code=True)


@dataclass(frozen=True)
class Note:
    """Text that shows itself in a notebook."""

    text: str
    is_code: bool = False

    def __str__(self) -> str:
        return self.text

    def _repr_pretty_(self, printer, cycle):
        printer.text(self.text)

    def _repr_html_(self):
        text = html.escape(self.text)
        return f"<pre><code>{text}</code></pre>" if self.is_code else f"<p>{text}</p>"
