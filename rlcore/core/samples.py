"""Arrays that functions of numbers and networks take: in float32 where they are, finite, labels in their range."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from rlcore.core.checks import as_floats, as_integers, finite, show
from rlcore.core.types import Floats, Given, Ints


def check_labels(name: str, values: Any, n: int, shape: tuple[int, ...] | None = None, what: str = "integers") -> Ints:
    """values as an array of integers in 0..n - 1, at least one, of a shape where one is given."""
    array = as_integers(name, values, what)
    if not array.size or (shape is not None and array.shape != shape):
        raise ValueError(f"{name}: got shape {array.shape}, must be {shape or '(n,), at least one'}")
    if array.view(np.uint64).max() >= n:  # -1 is the largest there is
        raise ValueError(f"{name}: got {array.min()}..{array.max()}, must be in 0..{n - 1}")
    return array


def all_finite(values: Floats) -> bool:
    """Whether an array of floats has finite numbers only: one dot product says so where they are not huge."""
    return isfinite(np.vdot(values, values)) or bool(np.isfinite(values).all())


def as_samples(name: str, values: Any, dtype: Any) -> Floats:
    """values as an array of a floating dtype; ValueError where they are not numbers. Not checked: whether finite."""
    if isinstance(values, np.ndarray) and values.dtype == dtype:
        return values
    return as_floats(name, values).astype(dtype)


def check_samples(name: str, values: Any, dtype: Any) -> Floats:
    """As as_samples, and all of them finite."""
    values = as_samples(name, values, dtype)
    if not all_finite(values):
        raise ValueError(f"{name}: contains {values[~np.isfinite(values)][0]:g}, must be finite")
    return values


# ---------------------------------------------------------------------- rules


def numbers(name: str, values: Any, given: Given | None = None) -> Floats:
    """The rule of numbers of any shape, infinite ones, too; in float32 where they are, else in float64."""
    values = values if isinstance(values, np.ndarray) and values.dtype == np.float32 else as_floats(name, values)
    if np.isnan(values).any():
        raise ValueError(f"{name}: contains NaN, must be numbers")
    return values


def finite_numbers(name: str, values: Any, given: Given | None = None) -> Floats:
    """The rule of finite numbers of any shape, in float32 where they are, else in float64."""
    values = numbers(name, values)
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains {values[~np.isfinite(values)][0]:g}, must be finite")
    return values


def probabilities(name: str, values: Any, given: Given | None = None) -> Floats:
    """The rule of numbers in [0, 1], of any shape."""
    array = as_floats(name, values)
    if not ((array >= 0) & (array <= 1)).all():
        raise ValueError(f"{name}: got {show(values)}, must be in [0, 1]")
    return array


def pair(name: str, values: Any, given: Given | None = None) -> tuple[float, float]:
    """The rule of two finite numbers."""
    values = finite(name, values)
    if values.shape != (2,):
        raise ValueError(f"{name}: got shape {values.shape}, must be two finite numbers")
    return tuple(values.tolist())
