"""Comparing what came with what was expected, in words that help."""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from decimal import Decimal
from typing import Any

import numpy as np

from rlcore.mdp import FiniteMDP

SINGLE = 2e-6  # what a computation in single precision leaves right of a number: 16 units of its last place


@dataclass(frozen=True)
class Opaque:
    """A result of a kind that no exercise asks for, in words."""

    text: str


@dataclass(frozen=True)
class Judged:
    """What is wanted where many results are right: in words, and judge(result), which is None or what is wrong."""

    text: str
    judge: Callable[[Any], str | None]


@dataclass(frozen=True)
class Rule:
    """How two results are compared.

    tol: largest absolute and relative difference. digits: significant ones that are enough where the statement says
    so. hide: say how a number is wrong without giving the right one. arrays: a list is no array.
    """

    tol: float = 1e-8
    digits: int | None = None
    hide: bool = False
    arrays: bool = True


def difference(got: Any, expected: Any, rule: Rule) -> str | None:
    """None where got is expected by the rule; otherwise what is wrong, in one sentence."""
    if isinstance(expected, Judged):
        return expected.judge(_in_floats(got))
    if isinstance(expected, FiniteMDP):
        return _mdp_difference(got, expected)
    if isinstance(expected, np.ndarray):
        return _array_difference(got, expected, rule)
    if isinstance(expected, (bool, np.bool_, str, type(None))):
        got = got[()] if isinstance(got, np.ndarray) and got.shape == () else got
        kinds = (bool, np.bool_) if isinstance(expected, (bool, np.bool_)) else type(expected)
        if not isinstance(got, kinds):
            return f"the result is {kind(got)}, expected {kind(expected)}"
        if isinstance(expected, str):
            got, expected = got.strip().lower(), expected.lower()
        return None if got == expected else "the result is another"
    if isinstance(expected, numbers.Real):
        value = number(got)
        if value is None:
            return f"the result is {kind(got)}, expected a number"
        if math.isnan(value) and not math.isnan(expected):
            return "the result is NaN"
        digits = None if isinstance(expected, numbers.Integral) else rule.digits
        close = _close(value, float(expected), replace(rule, digits=digits))
        return None if close else f"the number {_how(value, expected, rule)}"
    if isinstance(expected, (tuple, list)):
        sequence = isinstance(got, (tuple, list)) or (isinstance(got, np.ndarray) and got.ndim)
        if not sequence or len(got) != len(expected):
            return f"the result is {kind(got)}, expected {kind(expected)}"
        parts = (difference(g, e, rule) for g, e in zip(got, expected, strict=True))
        return next((f"part {i}: {problem}" for i, problem in enumerate(parts) if problem), None)
    if isinstance(expected, dict):
        if not isinstance(got, dict) or set(got) != set(expected):
            keys = sorted(map(str, got)) if isinstance(got, dict) else kind(got)
            return f"the keys are {keys}, expected {sorted(map(str, expected))}"
        parts = ((key, difference(got[key], value, rule)) for key, value in expected.items())
        return next((f"at {key!r}: {problem}" for key, problem in parts if problem), None)
    raise TypeError(f"no rule to compare with {type(expected).__name__}")


def number(value: Any) -> float | None:
    """Any real number as a float, an array without axes too; None where value is none."""
    if isinstance(value, np.ndarray) and value.shape == ():
        value = value[()]
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, Decimal)):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    except ValueError:  # Decimal("sNaN")
        return math.nan


def is_single(value: Any) -> bool:
    """Whether a result holds numbers of single precision."""
    if isinstance(value, (tuple, list, dict)):
        return any(map(is_single, value.values() if isinstance(value, dict) else value))
    return getattr(value, "dtype", None) == np.float32


def _close(got, expected, rule):
    """Whether numbers agree within the tolerance, or in the digits that the statement asks for."""
    close = np.isclose(got, expected, rtol=rule.tol, atol=rule.tol, equal_nan=True)
    if rule.digits is None:
        return close
    with np.errstate(divide="ignore", invalid="ignore"):
        size = np.where(np.abs(expected) > 1e-12, np.floor(np.log10(np.abs(expected))), 0)
        return close | (np.abs(got - expected) <= 0.5000001 * 10.0 ** (size - rule.digits + 1))


def _how(got, expected, rule):
    """In which way a number differs."""
    if not rule.hide:
        for precision in (6, 9, 12, 17):
            one, two = f"{got:.{precision}g}", f"{expected:.{precision}g}"
            if one != two:
                break
        return f"is {one}, expected {two}"
    if got * expected < 0:
        return (
            "has the right size and the wrong sign" if abs(got + expected) < 1e-3 * abs(got) else "has the wrong sign"
        )
    if not isinstance(expected, numbers.Integral) and abs(got - expected) <= 5e-3 * abs(expected):
        whole = ", or, where a whole number is asked for, round it" if expected == round(expected) else ""
        return f"is right in its first digits: give more of them{whole}"
    far = "far " if expected and not 0.1 < got / expected < 10 else ""
    return f"is {far}too {'high' if got > expected else 'low'}"


def _in_floats(value):
    """Arrays of objects that are numbers as arrays of floats, in tuples and lists, too."""
    if isinstance(value, (tuple, list)):
        return [_in_floats(part) for part in value]
    if isinstance(value, np.ndarray) and value.dtype == object:
        values = [number(v) for v in value.ravel()]
        return value if None in values else np.array(values).reshape(value.shape)
    return value


def _array_difference(got, expected, rule):
    if isinstance(got, (tuple, list)) and not rule.arrays:
        try:
            got = np.array(got)
        except ValueError:
            return f"the rows of the {type(got).__name__} have different lengths, expected shape {expected.shape}"
    if not isinstance(got, np.ndarray):
        make = ": np.array makes one of it" if isinstance(got, (tuple, list)) else ""
        return f"the result is {kind(got)}, expected an array of shape {expected.shape}{make}"
    if got.shape != expected.shape:
        return f"the result has shape {got.shape}, expected {expected.shape}"
    numeric = expected.dtype.kind in "iuf"
    got = _in_floats(got) if numeric else got
    if got.dtype.kind not in ("iuf" if numeric else expected.dtype.kind):
        return f"the result holds {got.dtype} values, expected {expected.dtype}"
    close = _close(got.astype(float), expected.astype(float), rule) if numeric else got == expected
    if np.all(close):
        return None
    if numeric and np.isnan(got[~close].astype(float)).any():
        return "the result contains NaN"
    first = tuple(int(i) for i in np.argwhere(~close)[0])
    at = first[0] if len(first) == 1 else first
    how = f", which {_how(got[first], expected[first], rule)}" if numeric else ""
    return f"{int((~close).sum())} of {close.size} entries differ, the first at {at}{how}"


def _mdp_difference(got, expected):
    if not isinstance(got, FiniteMDP):
        return f"the result is {kind(got)}, expected a FiniteMDP"
    for name in ("n_states", "n_actions"):
        if getattr(got, name) != getattr(expected, name):
            return f"{name} is {getattr(got, name)}, expected {getattr(expected, name)}"
    for name in ("terminal", "legal", "start"):
        one, two = getattr(got, name), getattr(expected, name)
        if not np.allclose(one, two):
            at = tuple(int(i) for i in np.argwhere(~np.isclose(one, two))[0])
            where = f"s={at[0]}" if len(at) == 1 else f"s={at[0]}, a={at[1]}"
            return f"{name} differs at {where}: {one[at].item()}, expected {two[at].item()}"
    for name, method in (("p(s'|s, a)", "transition_probs"), ("r(s, a)", "expected_reward")):
        one, two = getattr(got, method)(), getattr(expected, method)()
        if not np.allclose(one, two):
            s, a = np.argwhere(~np.isclose(one, two))[0][:2]
            return (
                f"{name} differs at s={s}, a={a}: {one[s, a].round(4).tolist()}, expected {two[s, a].round(4).tolist()}"
            )
    return (
        None if np.allclose(_sorted(got), _sorted(expected)) else "p(s', r | s, a) differs, though its marginals agree"
    )


def _sorted(mdp):
    P = mdp.transition_probs()
    return np.nan_to_num(mdp.expected_reward_sas()) * (P > 0)


def unchanged(given: Mapping[str, Any], original: Mapping[str, Any]) -> str | None:
    """None where every argument is as it was; otherwise the name of the first that is not."""
    return next((name for name in original if not _identical(given.get(name), original[name])), None)


def _identical(a, b):
    if isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and a.shape == b.shape and np.array_equal(a, b, equal_nan=b.dtype.kind == "f")
    if isinstance(b, FiniteMDP):
        return a == b
    if isinstance(b, np.random.Generator) or callable(b):
        return True  # drawing from a generator changes it, as it must
    if isinstance(b, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(_identical, a, b))
    if isinstance(b, dict):
        return isinstance(a, dict) and list(a) == list(b) and all(_identical(a[key], b[key]) for key in b)
    if is_dataclass(b):
        return all(_identical(getattr(a, f.name), getattr(b, f.name)) for f in fields(b))
    return a == b or a is b or (a != a and b != b)


def kind(value: Any) -> str:
    """What a value is, in words."""
    if isinstance(value, Opaque):
        return value.text
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if value is None:
        return "None (is a `return` missing?)"
    if value is ...:
        return "... (a part is still to be filled in)"
    if isinstance(value, (list, tuple, dict)):
        return f"a {type(value).__name__} of length {len(value)}"
    name = type(value).__name__
    if name in ("coroutine", "async_generator"):
        return f"a {name} (`async` makes one before anything is computed)"
    if hasattr(type(value), "__next__"):
        return f"a {name}, of which nothing is computed yet (`list` or `np.array` of a list of it holds the numbers)"
    return f"{'an' if name[:1] in 'aeiou' else 'a'} {name}"


def show(value: Any) -> str:
    """A value in a few lines, cut in the middle."""
    if isinstance(value, (Opaque, Judged)):
        return value.text
    if isinstance(value, np.ndarray):
        text = np.array2string(value, precision=6, suppress_small=True, threshold=40, edgeitems=3, separator=", ")
        return _cut(text, 1000) if value.size else f"an empty array of shape {value.shape}"
    if isinstance(value, (float, np.floating)):
        return f"{value:.8g}"
    try:
        return _cut(re.sub(r" at 0x[0-9A-Fa-f]+", "", repr(value)), 300)
    except Exception:  # a number of too many digits
        return kind(value)


def _cut(text, length):
    half = length // 2 - 3
    return text if len(text) <= length else f"{text[:half]} ... {text[-half:]}"
