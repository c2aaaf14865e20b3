"""Exercises that know what went wrong: declarations, the checker, hints and solutions."""

from __future__ import annotations

import html
import inspect
import json
import os
import re
import sys
import textwrap
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from rlcore.exercises.compare import SINGLE, Rule, difference, is_single, kind, number, show, unchanged
from rlcore.exercises.sandbox import Crash, plain, run_guarded

EXERCISES = {}


@dataclass(frozen=True)
class Case:
    """One call of the answer: its arguments by name, and what it must give.

    given: dict of argument name -> value, empty where the answer is no function but a value. expected: from
    rlcore, a closed form or a committed number; or Judged, where many results are right. tol: largest absolute and
    relative difference. printed: whether the statement shows this case; at least one case of an exercise must not be.
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


@dataclass(frozen=True, kw_only=True)
class Exercise:
    """One exercise, whole: page, notebook, check and tests are made from this.

    id: "page-words", such as "ch01-first-visit". kind: one of KINDS. tier: one of TIERS. section: heading of the
    chapter that links here; empty in a longer build. statement, hints: Markdown. stub, solution: source that binds
    `name`, to a function or a value. cases: rng -> list of Case. minutes: estimate for a reader of the chapter.
    covers: ids of the concordance. uses: ids of earlier steps whose functions the answer calls. seconds: time limit of
    a check. digits: significant ones of each number that are enough, which the page says; None where numbers are exact
    or come from a program.
    """

    id: str
    kind: str
    tier: str
    section: str = ""
    title: str
    statement: str
    stub: str
    cases: Callable
    hints: tuple
    solution: str
    wrong: tuple
    minutes: int
    covers: tuple
    uses: tuple = ()
    seconds: float = 20.0
    digits: int | None = None
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
            (self.tier in TIERS, f"tier {self.tier!r} is not one of {TIERS}"),
            (set(self.uses) <= set(EXERCISES), "uses steps that are not declared before it"),
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
        """What `source` gives the exercise's name, after the solutions of earlier steps: a function or a value."""
        scope = {"__name__": self.id}
        earlier = [part for id in self.uses for part in (EXERCISES[id].setup, EXERCISES[id].solution)]
        for part in (
            *earlier,
            self.setup,
            source,
        ):  # apart, as in the cells of a notebook: together they compile otherwise
            exec(compile(part, f"<{self.id}>", "exec"), scope)
        return scope[self.name]

    @property
    def is_function(self) -> bool:
        """Whether the answer is a function; otherwise it is a value."""
        return isinstance(self.bind(self.stub), FunctionType)

    def rule(self, case: Case) -> Rule:
        """How a result of this case is compared: a list is no array where the statement asks for an array."""
        arrays = "array" in self.statement or re.search(r"`\([A-Za-z0-9]", self.statement) is not None
        hide = not case.given and self.id not in _solved
        return Rule(case.tol, self.digits, hide, arrays and bool(case.given))

    def make_cases(self) -> list[Case]:
        """The cases, the same each time."""
        return self.cases(np.random.default_rng(sum(map(ord, self.id))))


KINDS = ("fill in", "by hand", "find the bug", "predict", "build", "experiment")
TIERS = ("core", "more", "deep")


def on_page(page: str) -> list[Exercise]:
    """The exercises of a page, such as "ch01", as they stand there: by tier and minutes; steps as they are declared."""
    mine = [exercise for id, exercise in EXERCISES.items() if id.partition("-")[0] == page]
    if any(exercise.uses for exercise in mine):
        return mine
    return sorted(mine, key=lambda exercise: (TIERS.index(exercise.tier), exercise.minutes))


@dataclass(frozen=True)
class Question:
    """A question of understanding: choices are (text, whether it is right, why), exactly one of them right."""

    text: str
    choices: tuple

    def __post_init__(self) -> None:
        if sum(bool(right) for _, right, _ in self.choices) != 1:
            raise ValueError(f"question {self.text!r}: exactly one choice must be right")


@dataclass(frozen=True)
class Proof:
    """Something to prove on paper: Markdown of what is claimed, what a proof must contain, and one that is whole."""

    title: str
    statement: str
    needs: tuple
    proof: str

    def __post_init__(self) -> None:
        for part in ("statement", "proof"):
            object.__setattr__(self, part, textwrap.dedent(getattr(self, part)).strip())


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
    can fork. After a failure `check.case` holds the case to try: `given`, `got`, and for a function `expected`.
    """
    exercise = _find(id)
    check.case = None  # type: ignore[attr-defined]
    last_answers[id] = answer
    verdict = _check(exercise, answer, sys._getframe(1).f_globals)
    if path := os.environ.get("RLCORE_EXERCISES_REPORT"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(json.dumps({"id": id, "status": verdict.status, "message": verdict.message}) + "\n")
    return verdict


check.case = None  # type: ignore[attr-defined]
last_answers: dict[str, Any] = {}


def problem_of(exercise: Exercise, got: Any, case: Case) -> str | None:
    """What is wrong with a result of a case, in single precision, too; None where it is right."""
    rule = exercise.rule(case)
    return _problem(got, case, replace(rule, tol=max(rule.tol, SINGLE)) if is_single(got) else rule)


def report_of(exercise: Exercise, case: Case, got: Any, problem: str) -> str:
    """The problem, the arguments, what came and what was expected."""
    return _report(case, got, problem, exercise.rule(case))


def _find(id):
    if not isinstance(id, str) or id not in EXERCISES:
        close = [name for name in EXERCISES if name.partition("-")[0] == str(id).partition("-")[0]]
        raise ValueError(f"id: got {id!r}, must be one of {sorted(close or EXERCISES)}")
    return EXERCISES[id]


def _check(exercise, answer, scope):
    verdict = _verdict(exercise, answer)
    return _earlier(exercise, answer, scope) or verdict if verdict.status in ("failed", "error") else verdict


def _earlier(exercise, answer, scope):
    """What is wrong with an earlier step of the learner's that this answer calls; None where all of them are right.

    scope: the names where check was called, among which the steps are that a value was made with.
    """
    case, function = check.case, isinstance(answer, FunctionType)
    scope = answer.__globals__ if function else scope
    called = set(_names(answer.__code__)) if function else set(scope)
    for step in [EXERCISES[id] for id in exercise.uses if EXERCISES[id].name in called]:
        if step.name not in scope:
            return Verdict("failed", f"`{step.name}` is missing, which this step calls: do {step.title!r} first")
        verdict = _check(step, scope[step.name], scope)
        if verdict.status != "passed":
            alone = function and _verdict(exercise, _with_right_steps(exercise, answer)).status == "passed"
            what = "not attempted yet" if verdict.status == "not attempted" else f"wrong: {verdict.message}"
            return Verdict("failed", f"{'this step is right; ' * alone}the earlier step `{step.name}` is {what}")
        check.case = case
    return None


def _with_right_steps(exercise, answer):
    right = {EXERCISES[id].name: EXERCISES[id].bind(EXERCISES[id].solution) for id in exercise.uses}
    scope = {**answer.__globals__, **right}
    return FunctionType(answer.__code__, scope, answer.__name__, answer.__defaults__, answer.__closure__)


def _names(code):
    yield from code.co_names
    for part in code.co_consts:
        if inspect.iscode(part):
            yield from _names(part)


def _verdict(exercise, answer):
    stub, function = exercise.bind(exercise.stub), exercise.is_function
    untouched = Verdict("not attempted", f"write your answer in `{exercise.name}`, then run the check again")
    if function and _same_code(stub, answer):
        return untouched
    if function and not callable(answer):
        return Verdict("failed", f"got {kind(answer)}; the answer must be the function `{exercise.name}` itself")
    if callable(answer) and not function:
        return Verdict("failed", f"got a function; the answer must be a value: check({exercise.id!r}, {exercise.name})")
    try:
        results = run_guarded(lambda: _results(exercise, answer), exercise.seconds)
    except Crash as crash:
        return Verdict("error", str(crash))
    if not function and type(results[0][0]) is type(stub) and show(results[0][0]) == show(stub):
        return untouched
    cases = exercise.make_cases()  # after the answer has ended, so that it meets no result that is expected
    single = any(is_single(got) for got, _ in results)
    rules = [exercise.rule(case) for case in cases]
    if single and any(_problem(got, *row) for (got, _), *row in zip(results, cases, rules)):
        rules = [replace(rule, tol=max(rule.tol, SINGLE)) for rule in rules]
    for case, (got, changed), rule in zip(cases, results, rules, strict=True):
        if changed is not None:
            return Verdict("failed", f"your function changes its argument `{changed}`; work on a copy of it")
        if problem := _problem(got, case, rule):
            known = {} if rule.hide else {"expected": case.expected}
            check.case = SimpleNamespace(given=deepcopy(case.given), got=got, **known)
            mistake = known_mistake(exercise, cases, results, rules)
            luck = _luck(cases, results, rules)
            return Verdict("failed", mistake or luck + _report(case, got, problem, rule))
    precision = ", in single precision" if single else ""
    return Verdict("passed", ("right" if len(cases) == 1 else f"right on all {len(cases)} cases") + precision)


def _results(exercise, answer):
    """(what came, the argument that was changed or None) of each case."""
    if not exercise.is_function:
        return [(plain(answer), None)]
    return [call(answer, given) for given in [case.given for case in exercise.make_cases()]]


def call(answer: Callable, original: dict) -> tuple[Any, str | None]:
    """(what came, the argument that was changed or None) of one call."""
    given = deepcopy(original)
    got = plain(answer(*given.values()))
    return got, unchanged(given, original)


def _problem(got, case, rule):
    try:
        return difference(got, case.expected, rule)
    except Exception:  # whatever came, the check ends in a verdict
        return f"the result is {kind(got)}, which cannot be compared"


def known_mistake(exercise: Exercise, cases: list[Case], results: list, rules: list[Rule]) -> str | None:
    """The message of the usual mistake that gives these results, where they are telling enough."""
    for message, outputs in _mistakes(exercise):
        if all(_same(got, *row) for (got, _), *row in zip(results, outputs, rules, strict=True)):
            return message if telling(outputs, cases[0].tol) else None
    return None


def _same(got, output, rule):
    try:
        return not difference(got, output, rule)
    except Exception:  # no kind of result that any exercise asks for
        return False


@cache
def _mistakes(exercise):
    """(message, results) of each usual mistake; one that crashes was not made by an answer that ran."""
    found = []
    for wrong in exercise.wrong:
        try:
            found.append((wrong.message, [plain(got) for got, _ in _results(exercise, exercise.bind(wrong.source))]))
        except Exception:
            continue
    return found


def telling(outputs: list, tol: float = 0.0) -> bool:
    """Whether results name their mistake: a few zeros and ones, or yes and no, come from many.

    So do numbers of any count that need only be near 0 or 1.
    """
    values = list(_leaves(outputs))
    if any(value is None or min(abs(value), abs(abs(value) - 1)) > tol for value in values):
        return True
    return len(values) >= 8 and tol < 1e-3


def _leaves(value):
    """The numbers in a result; None for what is none, such as a process."""
    if isinstance(value, (list, tuple, dict)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _leaves(part)
    elif isinstance(value, np.ndarray) and value.ndim:
        yield from _leaves(value.tolist())
    elif not isinstance(value, str):
        yield int(value) if isinstance(value, (bool, np.bool_)) else number(value)


def _luck(cases, results, rules):
    rows = zip(results, cases, rules, strict=True)
    printed = [not _problem(got, case, rule) for (got, _), case, rule in rows if case.printed]
    return "right on the example of the statement, not in general: " if printed and all(printed) else ""


def _report(case, got, problem, rule):
    rows = [*((f"with {name} = ", value) for name, value in case.given.items()), ("got ", got)]
    rows += [] if rule.hide else [("expected ", case.expected)]
    text = [problem, *(label + textwrap.indent(show(v), " " * len(label)).lstrip() for label, v in rows)]
    return "\n".join([*text, *(["all of it is in check.case"] if case.given else [])])


def _same_code(stub, answer):
    return type(answer) is FunctionType and _code(stub.__code__) == _code(answer.__code__)


def _code(code):
    constants = tuple(_code(c) if inspect.iscode(c) else repr(c) for c in code.co_consts)
    return code.co_code, constants, code.co_names, code.co_varnames


_given = {}
_solved = set()


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
    _solved.add(id)
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
