"""The checker against right answers in other types, wrong ones in none, and answers that mean harm."""

import functools
import os
import sys
import time
from collections import namedtuple
from decimal import Decimal
from fractions import Fraction

import mutation_exercises
import numpy as np
import pytest

from rlcore.exercises import EXERCISES, check, hint, solution
from rlcore.exercises.engine import Verdict
from rlcore.exercises.sandbox import LARGEST, Crash, run_guarded

ALL = list(EXERCISES.values())
FUNCTIONS = [e for e in ALL if e.is_function]
VALUES = [e for e in ALL if not e.is_function]
HERE = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")


@functools.cache
def solution_of(exercise):
    return exercise.bind(exercise.solution)


def solved(exercise, change):
    """The solution, whose result is changed."""
    right = solution_of(exercise)
    return (lambda *a: change(right(*a))) if exercise.is_function else change(right)


def in_numbers(change):
    def changed(value):
        if isinstance(value, (tuple, list)):
            return type(value)(map(changed, value))
        number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
        return change(value) if number else value

    return changed


def in_arrays(change):
    def changed(value):
        if isinstance(value, (tuple, list)):
            return type(value)(map(changed, value))
        return change(value) if isinstance(value, np.ndarray) and value.dtype.kind == "f" else value

    return changed


# ---------------------------------------------------------------------- right answers


WRAPPINGS = {
    "Fraction": in_numbers(lambda x: Fraction(float(x))),
    "Decimal": in_numbers(lambda x: Decimal(float(x))),
    "scalar": in_numbers(np.float64),
    "array without axes": in_numbers(np.array),
    "list": lambda x: list(x) if isinstance(x, tuple) else x,
    "float32": in_arrays(lambda x: x.astype(np.float32)),
    "masked": in_arrays(np.ma.masked_array),
    "objects": in_arrays(lambda x: x.astype(object)),
}


@pytest.mark.long
@pytest.mark.parametrize("name", WRAPPINGS)
def test_right_answers_pass_in_other_types(name):
    refused = []
    for exercise in ALL:
        found = check(exercise.id, solved(exercise, WRAPPINGS[name]))
        if found.status != "passed":
            refused.append((exercise.id, str(found)[:100]))
    assert refused == []


@pytest.mark.parametrize("n, x", [("list", [1 / 3, 4 / 3]), ("array", np.array([1 / 3, 4 / 3])), ("tensor", None)])
def test_two_numbers_in_any_sequence(n, x):
    if x is None:
        torch = pytest.importorskip("torch")
        x = torch.tensor([1 / 3, 4 / 3])
    assert check("ch07-bluff", x).status == "passed"


def test_single_precision_is_said():
    one = EXERCISES["ch01-expected-reward"]
    found = check(one.id, solved(one, lambda x: x.astype(np.float32)))
    assert found.status == "passed" and "single precision" in found.message
    assert "single" not in check(one.id, solved(one, lambda x: x)).message
    assert check(one.id, solved(one, lambda x: (x * (1 + 1e-5)).astype(np.float32))).status == "failed"


@pytest.mark.parametrize("exercise", [e for e in VALUES if e.digits], ids=lambda e: e.id)
def test_the_digits_of_the_statement_are_enough_and_fewer_are_not(exercise):
    def rounded(digits):
        cut = lambda x: float(f"{x:.{digits}g}")  # noqa: E731
        return in_both(solved(exercise, lambda x: x), cut)

    assert check(exercise.id, rounded(exercise.digits)).status == "passed"
    assert check(exercise.id, rounded(1)).status == "failed"


def in_both(value, change):
    if isinstance(value, tuple):
        return tuple(in_both(v, change) for v in value)
    if isinstance(value, np.ndarray):
        return np.array([in_both(v, change) for v in value])
    return value if isinstance(value, (str, int)) else change(value)


def test_numbers_that_do_not_end_have_their_digits_stated():
    for exercise in VALUES:
        if exercise.kind in ("by hand", "predict"):
            for x in numbers_in(exercise.make_cases()[0].expected):
                assert exercise.digits or abs(x - round(x, 6)) < 1e-12, (exercise.id, x)


def numbers_in(value):
    if isinstance(value, (tuple, list, np.ndarray)):
        return [x for v in value for x in numbers_in(v)]
    return [] if isinstance(value, str) else [float(value)]


# ---------------------------------------------------------------------- anything whatever


class Odd:
    def __eq__(self, other):
        raise RuntimeError("eq")

    def __repr__(self):
        raise RuntimeError("repr")

    def __getattr__(self, name):
        raise RuntimeError("getattr")

    __hash__ = None


class Slow:
    def __reduce__(self):
        return exec, ("while True: pass",)


class Liar(np.ndarray):
    def __array_function__(self, *_, **__):
        return True

    def __array_ufunc__(self, *_, **__):
        return True


def anything():
    itself = []
    itself.append(itself)
    deep = []
    for _ in range(10**5):
        deep = [deep]
    yield from (None, ..., NotImplemented, True, 0, -1, 10**400, 10**6000, float("nan"), float("inf"), 1j, "", "\ud800")
    yield from ("\x00\x1b[31m", b"x", bytearray(3), Fraction(1, 3), Decimal("sNaN"), Decimal("NaN"), Decimal(1), object)
    yield from ([], (), {}, set(), {1, 2}, [[]], [1, [2, 3]], (1, None), {"a": 1}, {1: {2: [3]}}, range(3), slice(2))
    yield from (
        np.float32(1),
        np.float16(1),
        np.int8(1),
        np.bool_(True),
        np.str_("a"),
        np.datetime64("2020"),
        np.void(b"a"),
    )
    yield from (
        np.array(1.0),
        np.array([]),
        np.zeros((0, 3)),
        np.zeros((2, 2), bool),
        np.array(["a"]),
        np.array([None]),
    )
    yield from (
        np.array([1, "a", None], object),
        np.ma.masked_array([1.0, 2], [0, 1]),
        np.ma.masked,
        np.zeros(3).view(Liar),
    )
    yield from (
        np.zeros(2, [("a", int)]),
        np.array([1 + 2j]),
        np.full((2, 2), np.nan),
        np.float32("nan"),
        np.matrix("1 2"),
    )
    yield from (itself, deep, Odd(), [Odd()], Slow(), (Slow(), 1), (x for x in "ab"), iter([1]), open, print, Odd, sys)
    yield from (
        namedtuple("P", "x y")(1, 2),
        ValueError("x"),
        {"a": Odd()},
        memoryview(b"ab"),
        np.random.default_rng(0),
    )
    yield np.broadcast_to(0.0, (10**6, 10**6))


VALUE_IDS = ["ch01-return-by-hand", "ch01-claim-bounded", "ch04-driving-home", "ch03-predict-descent"]
FUNCTION_IDS = ["ch01-expected-reward", "ch01-build-ferry", "ch03-value-iteration", "ch03-q-learning-update"]


@pytest.mark.parametrize("id", VALUE_IDS + FUNCTION_IDS)
def test_check_never_raises(id):
    for answer in anything():
        given = (lambda *_, a=answer: a) if EXERCISES[id].is_function else answer
        found = check(id, given)
        assert isinstance(found, Verdict) and str(found)
        assert found.status != "passed" and (answer is ... or found.status != "not attempted")


def test_a_lying_array_fails():
    assert check("ch01-expected-reward", lambda prob, reward: np.zeros(prob.shape[:2]).view(Liar)).status == "failed"


@pytest.mark.parametrize(
    "make, word",
    [
        (lambda: (i for i in "a"), "a generator, of which nothing is computed yet"),
        (lambda: map(float, "1"), "a map, of which nothing is computed yet"),
        (lambda: Odd, "type"),
        (lambda: [[0.0]], "a list of length 1, expected an array of shape (3, 2): np.array makes one of it"),
    ],
)
def test_a_result_of_no_kind_is_named(make, word):
    assert word in check("ch01-expected-reward", lambda prob, reward: make()).message


def test_where_a_process_differs_is_said_and_no_place_in_memory():
    cliff = EXERCISES["ch04-build-cliff"].bind(EXERCISES["ch04-build-cliff"].solution)
    turned = check("ch04-build-cliff", lambda n_rows, n_cols: cliff(n_cols, n_rows)).message
    assert turned.startswith("start differs at s=36: 0.0, expected 1.0")
    assert " at 0x" not in check("agent-draw", lambda p, rng: -1).message


# ---------------------------------------------------------------------- messages


@pytest.mark.parametrize("exercise", VALUES, ids=lambda e: e.id)
def test_a_value_is_not_given_away(exercise):
    for change in (in_numbers(lambda x: x * 1.5 + 3), in_arrays(lambda x: x * 1.5 + 3)):
        answer = change(exercise.bind(exercise.solution))
        found = check(exercise.id, answer)
        assert "expected " not in found.message.partition("\n")[2] and not hasattr(check.case, "expected")


def test_a_value_is_told_once_the_solution_was_shown():
    id = "ch01-return-by-hand"
    assert "too high" in check(id, 9.5).message and "wrong sign" in check(id, -9.0).message
    assert "far too high" in check(id, 400.0).message and "first digits" in check(id, 9.01).message
    while "left" in str(solution(id)):
        hint(id)
    assert "expected 9" in check(id, 9.5).message


def test_a_verdict_is_its_word_and_a_whole_number_is_asked_for():
    assert check("ch01-claim-bounded", ("Refuted ", 400)).status == "passed"
    assert check("ch01-claim-bounded", ("refused", 400)).status == "failed"
    near, far = (check("ch01-claim-bounded", ("refuted", x)).message for x in (399.9986, 390.0))
    assert "round it" in near and "round" not in far


def test_what_differs_is_shown_and_can_be_taken_in_hand():
    one = EXERCISES["ch01-expected-reward"]
    found = check(one.id, solved(one, lambda x: x + 1e-7 * (np.arange(x.size).reshape(x.shape) == 1)))
    got, expected = found.message.partition("which is ")[2].splitlines()[0].split(", expected ")
    assert got != expected and "the first at (0, 1)" in found.message
    case = check.case
    assert set(vars(case)) == {"given", "got", "expected"}
    right = one.bind(one.solution)(**case.given)
    assert np.allclose(right, case.expected) and not np.array_equal(case.got, case.expected)
    check(one.id, one.bind(one.solution))
    assert check.case is None


def test_zeros_and_ones_name_no_mistake():
    from rlcore.exercises.engine import telling

    assert not telling([0, 1, 1.0]) and not telling([True]) and not telling([np.array([0, 1])])
    assert telling([0.5]) and telling([np.zeros(8)])
    assert not telling([1e-5] * 20, 0.01) and not telling([np.zeros(8)], 0.01) and telling([1e-5], 1e-8)


def named(id):
    """What --named finds for an exercise, and what was judged."""
    looked_at = mutation_exercises.judged()
    found = mutation_exercises.named(EXERCISES[id])[1]
    return found, {name: begin for name, begin in looked_at.items() if name.startswith(f"{id}: ")}


@pytest.mark.long
@pytest.mark.parametrize("id", ["ch01-return-by-hand", "ch02-bug-illegal", "ch06-build-xor", "ch08-clip"])
def test_a_mistake_is_named_only_where_it_is_the_one_made(id):
    found, looked_at = named(id)
    assert set(found) == set(looked_at)
    assert all(message.startswith(looked_at[name]) for name, message in found.items())


def test_names_of_mistakes_were_judged_for_exercises_that_exist():
    assert len(mutation_exercises.judged()) > 100
    for name, begin in mutation_exercises.judged().items():
        assert any(wrong.message.startswith(begin) for wrong in EXERCISES[name.partition(": ")[0]].wrong), name


# ---------------------------------------------------------------------- limits


def spin():
    while True:
        pass


def closes():
    os.closerange(3, 200)
    spin()


def ignores():
    import signal

    signal.signal(signal.SIGPROF, signal.SIG_IGN)
    signal.setitimer(signal.ITIMER_PROF, 0)
    spin()


def forks():
    if os.fork() == 0:
        spin()
    return 1


LIMITS = {
    "loop": (spin, "of computing"),
    "ignored": (ignores, "of computing|signal 9"),
    "closed": (closes, "closed the way|of computing"),
    "fork": (forks, "must not start"),
    "system": (lambda: os.system("true"), "must not start"),
    "input": (lambda: input("x"), "keyboard"),
    "large": (lambda: np.zeros(LARGEST // 8 + 10), "takes more than"),
    "many": (lambda: [np.zeros(LARGEST // 16) for _ in range(3)], "takes more than"),
    "sleep": (lambda: time.sleep(60), "by the clock"),
    "unpickling": (lambda: Slow(), None),
}


@HERE
@pytest.mark.parametrize("name", LIMITS)
def test_every_limit_has_its_own_words(name, monkeypatch):
    answer, words = LIMITS[name]
    monkeypatch.setattr("rlcore.exercises.sandbox.PATIENCE", 2 if name == "sleep" else 20)
    start = time.monotonic()
    if words is None:
        assert "Slow" in run_guarded(answer, 1.0).text
    else:
        with pytest.raises(Crash, match=words):
            run_guarded(answer, 1.0)
    assert time.monotonic() - start < 60


@HERE
def test_a_huge_view_is_too_large_for_check():
    assert "takes more than" in check("ch01-expected-reward", lambda *_: np.broadcast_to(0.0, (10**6, 10**6))).message


@HERE
def test_prints_of_stopped_answers_survive(capsys):
    with pytest.raises(Crash):
        run_guarded(lambda: [print("so far"), spin()], 0.5)
    assert "so far" in capsys.readouterr().out


@HERE
def test_figures_come_back():
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    from rlcore.exercises.sandbox import _in_child

    status, _, _, figures = _in_child(lambda: plt.plot([1, 2]) and 1 / 0, 20)
    assert status == "crash" and len(figures) == 1 and figures[0].startswith(b"\x89PNG")
    assert plt.get_fignums() == []


def test_the_answer_meets_no_expected_result():
    def spy(*_):
        frame = sys._getframe(1)
        while frame:
            values = [v for v in frame.f_locals.values() if isinstance(v, (list, tuple))]
            if any(hasattr(x, "expected") for v in values for x in v):
                return 1
            frame = frame.f_back
        return 0

    check("ch01-expected-reward", spy)
    assert check.case.got == 0


# ---------------------------------------------------------------------- cases


ADVERSARIAL = {  # answers that the cases of an exercise once let through
    "ch03-bug-stops-early": (
        {"np.abs(V_new - V).max()": "-(V_new - V).min()"},
        {"np.abs(V_new - V).max()": "abs((V_new - V).sum())"},
        {"np.abs(V_new - V).max()": "np.abs((V_new - V) / V_new).max()"},
        {"change >= tol": "change > 0"},
        {"change >= tol": "change > tol"},
        {"np.abs(V_new - V).max()": "np.linalg.norm(V_new - V)"},
        {"np.abs(V_new - V).max()": "np.abs(V_new - V).sum()"},
        {"np.abs(V_new - V).max()": "np.abs(V_new - V)[-1]"},
    ),
    "ch07-score": ({"h.max()": "h.mean()"}, {"h.max()": "h[a]"}, {"h.max()": "h.min()"}),
    "ch02-greedy-ties": (
        {">= Q.max(axis=1, keepdims=True) - 1e-9": ">= Q.max(axis=1, keepdims=True) - 1e-2"},
        {"Q >= Q.max(axis=1, keepdims=True) - 1e-9": "np.isclose(Q, Q.max(axis=1, keepdims=True))"},
    ),
    "ch03-improvement-ties": (
        {"1e-9": "1e-2"},
        {"1e-9": "1e-8"},
        {"Q.max(axis=1) - 1e-9": "Q.max(axis=1) * (1 - 1e-9)"},
    ),
    "ch06-softmax-gradient": ({"logits.max()": "logits.mean()"}, {"logits.max()": "logits[0]"}),
    "ch07-softmax": ({"h.max()": "h[0]"}, {"h.max()": "h.mean()"}),
    "network-softmax": (
        {"logits.max(axis=1, keepdims=True)": "logits.mean(axis=1, keepdims=True)"},
        {"logits.max(axis=1, keepdims=True)": "logits[:, :1]"},
    ),
    "ppo-log-probs": (
        {"logits.max(axis=1, keepdims=True)": "logits.mean(axis=1, keepdims=True)"},
        {"logits.max(axis=1, keepdims=True)": "logits[:, :1]"},
    ),
    "ch08-gae": ({"(not terminated[t])": "(not (terminated[t] and not truncated[t]))"},),
    "ch08-bug-time-limit": ({"* ~terminated[t]": "* ~(terminated[t] & ~truncated[t])"},),
    "ppo-advantages": ({"* ~terminated[t]": "* ~(terminated[t] & ~truncated[t])"},),
    "ch08-reset-steps": ({"terminated | truncated": "terminated ^ truncated"},),
    "ch02-expectation-backup": ({"np.where(terminal, 0.0, (pi * Q).sum(axis=1))": "(pi * Q).sum(axis=1)"},),
    "ch04-sample-average": ({"V, N = V.copy()": "V, N = np.zeros(len(V))"},),
    "ch04-bug-terminal": ({"goes_on = t < len(rewards) - 1": "goes_on = 0 < states[t + 1] < len(V) - 1"},),
    "ch08-build-score": ({"above.max(axis=(0, 2))": "abs(above).max(axis=(0, 2))"},),
    "ch01-backward-returns": ({"np.zeros(len(rewards))": "np.zeros_like(rewards)"},),
    "network-returns": ({"np.zeros(rewards.shape)": "np.zeros_like(rewards)"},),
    "ch07-entropy": ({"np.log(p)": "np.log(np.maximum(p, 1e-3))"}, {"p[p > 0]": "p[(p > 0) & (p < 0.9)]"}),
    "ch08-bug-line-search": ({"new @ advantage > old @ advantage": "new @ advantage > 0"},),
    "ch05-three-traces": ({"0.75": "0.25"},),
    "ch03-two-sweeps-by-hand": ({"max(7.5, 2 + 0.5 * 6)": "max(7.5, 2 + 6)"},),
    "ch08-adaptive-beta": ({"d < d_target": "d <= d_target"}, {"d > 1.5": "d >= 1.5"}),
    "ch01-predict-pole": ({"-(0.8**4) / (1 - 0.8**5)": "-0.61"},),
    "ch08-predict-distances": ({"(kl(0, 1), kl(6, 7))": "(kl(0, 1), 0.0010)"},),
    "ch03-count-model": (
        {"counts / np.maximum(total, 1)": "np.divide(counts, total, where=total > 0, out=np.ones(counts.shape))"},
    ),
}


@pytest.mark.parametrize("id, changes", [(id, c) for id, all_ in ADVERSARIAL.items() for c in all_])
def test_answers_that_once_passed_fail(id, changes):
    program = EXERCISES[id].solution
    for old, new in changes.items():
        assert old in program
        program = program.replace(old, new)
    with np.errstate(all="ignore"):
        assert not mutation_exercises.passes(EXERCISES[id], EXERCISES[id].make_cases(), program)


QUICK = (
    "ch01-backward-returns",
    "ch02-greedy-ties",
    "ch03-improvement-ties",
    "ch04-batch-answer",
    "ch08-adaptive-beta",
)


@pytest.mark.long
@pytest.mark.parametrize("id", QUICK)
def test_every_change_of_a_solution_fails_or_has_its_reason(id):
    n, alive = mutation_exercises.survivors(EXERCISES[id])
    listed = {name for name in mutation_exercises.allowed() if name.startswith(f"{id}: ")}
    assert n > 5 and set(alive) == listed


def test_reasons_are_given_for_exercises_that_exist():
    for name, reason in mutation_exercises.allowed().items():
        assert name.partition(": ")[0] in EXERCISES and len(reason) > 10
