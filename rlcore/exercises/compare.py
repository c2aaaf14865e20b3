"""Comparing what came with what was expected, in words that help."""

from __future__ import annotations

import numbers
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from rlcore.mdp import FiniteMDP


def difference(got: Any, expected: Any, tol: float) -> str | None:
    """None where got is expected within tol (absolute and relative); otherwise what is wrong, in one sentence."""
    if isinstance(expected, FiniteMDP):
        return _mdp_difference(got, expected)
    if isinstance(expected, np.ndarray):
        return _array_difference(got, expected, tol)
    if isinstance(expected, (bool, np.bool_, str, type(None))):
        fine = (
            isinstance(got, (bool, np.bool_)) if isinstance(expected, (bool, np.bool_)) else type(got) is type(expected)
        )
        if not fine:
            return f"the result is {_kind(got)}, expected {_kind(expected)}"
        return None if got == expected else "the result is another"
    if isinstance(expected, numbers.Real):
        if isinstance(got, (bool, np.bool_)) or not isinstance(got, numbers.Real):
            return f"the result is {_kind(got)}, expected a number"
        if np.isnan(got) and not np.isnan(expected):
            return "the result is NaN"
        close = np.isclose(float(got), float(expected), rtol=tol, atol=tol, equal_nan=True)
        return None if close else "the number differs"
    if isinstance(expected, (tuple, list)):
        if type(got) is not type(expected) or len(got) != len(expected):
            return f"the result is {_kind(got)}, expected {_kind(expected)}"
        parts = (difference(g, e, tol) for g, e in zip(got, expected, strict=True))
        return next((f"part {i}: {problem}" for i, problem in enumerate(parts) if problem), None)
    if isinstance(expected, dict):
        if not isinstance(got, dict) or set(got) != set(expected):
            keys = sorted(map(str, got)) if isinstance(got, dict) else _kind(got)
            return f"the keys are {keys}, expected {sorted(map(str, expected))}"
        parts = ((key, difference(got[key], value, tol)) for key, value in expected.items())
        return next((f"at {key!r}: {problem}" for key, problem in parts if problem), None)
    raise TypeError(f"no rule to compare with {type(expected).__name__}")


def _array_difference(got, expected, tol):
    if not isinstance(got, np.ndarray):
        return f"the result is {_kind(got)}, expected an array of shape {expected.shape}"
    if got.shape != expected.shape:
        return f"the result has shape {got.shape}, expected {expected.shape}"
    number = "iuf" if expected.dtype.kind in "iuf" else expected.dtype.kind
    if got.dtype.kind not in number:
        return f"the result holds {got.dtype} values, expected {expected.dtype}"
    if expected.dtype.kind not in "iuf":
        return None if np.array_equal(got, expected) else "the entries differ"
    close = np.isclose(got.astype(float), expected.astype(float), rtol=tol, atol=tol, equal_nan=True)
    if close.all():
        return None
    if np.isnan(got[~close].astype(float)).any():
        return "the result contains NaN"
    first = tuple(int(i) for i in np.argwhere(~close)[0])
    at = first[0] if len(first) == 1 else first
    return f"{int((~close).sum())} of {close.size} entries differ, the first at {at}"


def _mdp_difference(got, expected):
    if not isinstance(got, FiniteMDP):
        return f"the result is {_kind(got)}, expected a FiniteMDP"
    for name in ("n_states", "n_actions"):
        if getattr(got, name) != getattr(expected, name):
            return f"{name} is {getattr(got, name)}, expected {getattr(expected, name)}"
    for name in ("terminal", "legal", "start"):
        if not np.allclose(getattr(got, name), getattr(expected, name)):
            return f"{name} is {getattr(got, name).tolist()}, expected {getattr(expected, name).tolist()}"
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


def _kind(value):
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    if value is None:
        return "None (is a `return` missing?)"
    if value is ...:
        return "... (a part is still to be filled in)"
    if isinstance(value, (list, tuple, dict)):
        return f"a {type(value).__name__} of length {len(value)}"
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def show(value: Any) -> str:
    """A value in a few lines."""
    if isinstance(value, np.ndarray):
        text = np.array2string(value, precision=6, suppress_small=True, threshold=40, separator=", ")
        return text if value.size else f"an empty array of shape {value.shape}"
    if isinstance(value, (float, np.floating)):
        return f"{value:.8g}"
    text = repr(value)
    return text if len(text) <= 300 else text[:297] + "..."
