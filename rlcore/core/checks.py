"""What an argument may be: each check returns the value that the code works with, or says what is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np

from rlcore.core.types import Flags, Floats, Given, Ints, Model, Rng, World

LARGEST = 10**9  # of anything that is counted
ENTRIES = 10**8  # of an array that a world is made of, 0.8 GB
HUGE = float(np.finfo(float).max)


def show(value: Any) -> str:
    """repr of a value, short."""
    text = repr(value)
    return text if len(text) < 200 else f"{text[:190]}..."


# ---------------------------------------------------------------------- one value


def is_number(value: Any) -> bool:
    """Whether value is a real number; True and False are not."""
    return isinstance(value, (float, int, Real)) and not isinstance(value, bool)  # the common ones first


def is_float(value: Any) -> bool:
    """Whether value is a real number that a double comes near to; 10**400 is none."""
    return is_number(value) and (isinstance(value, float) or bool(abs(value) <= HUGE))


def check_probability(name: str, value: Any, given: Given | None = None) -> float:
    """value as a float; ValueError unless it is a number in [0, 1]."""
    if not is_number(value) or not 0 <= value <= 1:
        raise ValueError(f"{name}: got {show(value)}, must be a number in [0, 1]")
    return float(value)


def check_positive(name: str, value: Any, given: Given | None = None) -> float:
    """value as a float; ValueError unless it is a finite number above 0."""
    if not is_number(value) or not 0 < value <= HUGE:
        raise ValueError(f"{name}: got {show(value)}, must be a positive number")
    return float(value)


def check_nonnegative(name: str, value: Any, given: Given | None = None) -> float:
    """value as a float; ValueError unless it is a finite number, 0 or more."""
    if not is_number(value) or not 0 <= value <= HUGE:
        raise ValueError(f"{name}: got {show(value)}, must be a number of at least 0")
    return float(value)


def check_fraction(name: str, value: Any, given: Given | None = None) -> float:
    """value as a float; ValueError unless it is above 0 and below 1."""
    if not is_number(value) or not 0 < value < 1:
        raise ValueError(f"{name}: got {show(value)}, must be above 0 and below 1")
    return float(value)


def check_rate(name: str, value: Any, given: Given | None = None) -> float:
    """value as a float; ValueError unless it is in (0, 1]."""
    if not (is_number(value) and 0 < value <= 1):
        raise ValueError(f"{name}: got {show(value)}, must be in (0, 1]")
    return float(value)


def check_finite(name: str, value: Any, given: Given | None = None) -> float:
    """value as a float; ValueError unless it is a finite number."""
    if not is_number(value) or not -HUGE <= value <= HUGE:
        raise ValueError(f"{name}: got {show(value)}, must be a finite number")
    return float(value)


def check_count(name: str, value: Any, least: int = 1, most: int = LARGEST) -> int:
    """value as an int; ValueError unless it is a whole number from `least` to `most`."""
    if not is_number(value) or not least <= value < np.inf or int(value) != value:
        raise ValueError(f"{name}: got {show(value)}, must be a whole number of at least {least}")
    if value > most:
        raise ValueError(f"{name}: got {show(value)}, must be a whole number of at most {most:,}")
    return int(value)


def check_entries(name: str, *sizes: int) -> None:
    """ValueError where an array of these sizes would exhaust the memory."""
    if math.prod(sizes) > ENTRIES:
        made = " x ".join(map(str, sizes))
        raise ValueError(f"{name}: needs an array of {made} numbers, must be at most {ENTRIES:,} in all")


def check_index(name: str, value: Any, size: int) -> int:
    """value as an int; ValueError unless it is a whole number in 0..size - 1."""
    if not is_number(value) or not 0 <= value < size or int(value) != value:
        raise ValueError(f"{name}: got {show(value)}, must be an integer in 0..{size - 1}")
    return int(value)


def check_flag(name: str, value: Any, given: Given | None = None) -> bool:
    """value as a bool; ValueError unless it is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}: got {show(value)}, must be True or False")
    return bool(value)


def check_rng(rng: Any) -> Rng:
    """rng; ValueError unless it is a numpy.random.Generator."""
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng: got {show(rng)}, must be a numpy.random.Generator such as numpy.random.default_rng(0)")
    return rng


def check_function(name: str, f: Any, of: str) -> Callable[..., Any]:
    """f; ValueError unless it can be called; a class is not. of: what it is called with, for the message."""
    if not callable(f) or isinstance(f, type):
        raise ValueError(f"{name}: got {show(f)}, must be a function of {of}")
    return f


# ---------------------------------------------------------------------- arrays


def as_floats(name: str, values: Any) -> Floats:
    """values as a float array; ValueError where they are not numbers."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values
    array = _array(name, values, "numbers")
    if array.dtype.kind == "O" and all(map(is_float, array.flat)):
        array = array.astype(float)
    if array.dtype.kind not in "iuf" and array.size:
        raise ValueError(f"{name}: got {show(values)}, must be numbers")
    return array.astype(float, copy=False)


def as_integers(name: str, values: Any, what: str = "integers") -> Ints:
    """values as an array of integers; ValueError where they are not."""
    array = _array(name, values, what)
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"{name}: got dtype {array.dtype}, must be {what}")
    return array.astype(np.int64, copy=False)


def as_flags(name: str, values: Any) -> Flags:
    """values as a bool array; ValueError unless they are True or False, or 1 and 0."""
    array = _array(name, values, "True or False")
    if array.dtype.kind not in "biuf" or ((array != 0) & (array != 1)).any():
        raise ValueError(f"{name}: got {show(values)}, must be True or False")
    return array.astype(bool, copy=False)


def _array(name, values, what):
    try:
        return np.asarray(values)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: got {show(values)}, must be {what}") from None


def finite(name: str, values: Any, given: Given | None = None) -> Floats:
    """values as a float array; ValueError where one is not finite."""
    values = as_floats(name, values)
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains {values[~np.isfinite(values)][0]:g}, must be finite")
    return values


def where(bad: Flags) -> str:
    """The first place that is True, as (s=0, a=1)."""
    return "(" + ", ".join(f"{name}={i}" for name, i in zip("sak", np.argwhere(bad)[0])) + ")"


# ---------------------------------------------------------------------- processes, policies, values


def check_mdp(mdp: Any) -> Model:
    """mdp; ValueError unless it is a FiniteMDP."""
    if not isinstance(mdp, Model):
        raise ValueError(f"mdp: got {type(mdp).__name__}, must be a FiniteMDP; from_env reads gymnasium's tables")
    return mdp


def check_world(name: str, world: Any, given: Given | None = None) -> Model:
    """world; ValueError unless it is a FiniteMDP to act in. cl-031"""
    if not isinstance(world, Model):
        raise ValueError(f"{name}: got {type(world).__name__}, must be a FiniteMDP to act in")
    return world


def model_of(world: Any) -> Model | None:
    """The FiniteMDP that world is, or that its MDPEnv plays as it stands there; None where there is none."""
    if isinstance(world, Model):
        return world
    model = getattr(getattr(world, "unwrapped", None), "mdp", None)
    return model if isinstance(model, Model) and veil(world) is None else None


ONLOOKERS = {"HumanRendering", "OrderEnforcing", "PassiveEnvChecker", "RecordEpisodeStatistics", "RecordVideo"}
ONLOOKERS |= {"RenderCollection", "TimeLimit", "Wrapper"}  # wrappers of gymnasium that leave the process as it is


def veil(env: Any) -> str | None:
    """Name of the first layer around env.unwrapped that may make another process of it; None where all only look on."""
    core = getattr(env, "unwrapped", env)
    while env is not core:
        inner = getattr(env, "env", None)
        if inner is None or not _looks_on(env, inner):
            return type(env).__name__
        env = inner
    return None


def _looks_on(env, inner):
    """Whether env has the spaces of inner, and step and reset as ONLOOKERS have them."""
    methods = [getattr(env, name, None) for name in ("step", "reset")]
    owners = {getattr(method, "__qualname__", "").split(".")[0] for method in methods}
    theirs = owners <= ONLOOKERS and all(method.__module__.startswith("gymnasium.") for method in methods)
    names = ("observation_space", "action_space")
    return theirs and all(getattr(env, name, None) is getattr(inner, name, None) for name in names)


def is_discrete(space: Any) -> bool:
    """Whether a space is gymnasium's Discrete: numbers from `start` on, n of them."""
    return hasattr(space, "n") and getattr(space, "shape", None) == ()


def spaces(world: World) -> tuple[Flags, Flags]:
    """(legal, terminal) of a world, (S, A) and (S,) bool; every action is legal and no state known to be terminal in an
    environment that is not an MDPEnv.

    Raises ValueError unless world is a FiniteMDP or a gymnasium.Env whose observations and actions are Discrete.
    """
    model = model_of(world)
    if model is not None:
        return model.legal, model.terminal
    found = [getattr(world, f"{name}_space", None) for name in ("observation", "action")]
    if not all(map(is_discrete, found)):
        kind = type(world).__name__ if None in found else f"{type(world).__name__} with {found[0]} and {found[1]}"
        raise ValueError(
            f"world: got {kind}, must be a FiniteMDP or a gymnasium.Env with Discrete observations and actions"
        )
    sizes = [int(space.n) for space in found]
    check_entries("world", *sizes)
    return np.ones(sizes, bool), np.zeros(sizes[0], bool)


def rounding(pi: Any) -> tuple[bool, float]:
    """Whether a policy is of float32, as networks give them, and how far from 1 its rows may sum."""
    rounded = getattr(pi, "dtype", None) == np.float32
    return rounded, 1e-5 if rounded else 1e-9


def check_policy(mdp: Model, pi: Any, name: str = "pi") -> Floats:
    """pi as a float array; ValueError unless it is (S, A) with rows that are distributions over A(s)."""
    return check_pi(check_mdp(mdp).legal, pi, name)


def check_pi(legal: Flags, pi: Any, name: str = "pi") -> Floats:
    """As check_policy, where all that is known is which actions are legal, (S, A) bool."""
    rounded, error = rounding(pi)
    pi = as_floats(name, pi)
    if pi.shape != legal.shape:
        raise ValueError(f"{name}: got shape {pi.shape}, must be {legal.shape}")
    bad = ~((pi >= 0).all(axis=1) & (np.abs(pi.sum(axis=1) - 1) <= error))
    if bad.any():
        s = np.flatnonzero(bad)[0]
        raise ValueError(f"{name}: row {s} is {pi[s]}, must be probabilities that sum to 1")
    if (pi[~legal] > 0).any():
        raise ValueError(f"{name}: probability on an action that is not legal at {where((pi > 0) & ~legal)}, must be 0")
    return pi / pi.sum(axis=1, keepdims=True) if rounded else pi


def finite_values(mdp: Model, V: Any, name: str = "V") -> Floats:
    """V as a new (S,) float array, from a number or an array of finite numbers; terminal states get 0."""
    V = finite(name, V)
    if V.shape not in ((), (check_mdp(mdp).n_states,)):
        raise ValueError(f"{name}: got shape {V.shape}, must be a number or ({mdp.n_states},)")
    return np.where(mdp.terminal, 0.0, V)


def check_q(mdp: Model, Q: Any, name: str = "Q") -> Floats:
    """Q as (S, A) floats with -inf at actions that are not legal; ValueError for another shape or NaN."""
    Q = as_floats(name, Q)
    if Q.shape != check_mdp(mdp).legal.shape:
        raise ValueError(f"{name}: got shape {Q.shape}, must be {mdp.legal.shape}")
    if np.isnan(Q).any():
        raise ValueError(f"{name}: contains NaN, must be numbers")
    return np.where(mdp.legal, Q, -np.inf)


def check_v0(terminal: Flags, V0: Any) -> Floats:
    """V0, a number or (S,), as a new (S,) float array with 0 at terminal states."""
    return _table("V0", V0, terminal.shape, np.zeros(terminal.shape), ~terminal)


def check_q0(legal: Flags, terminal: Flags, Q0: Any) -> Floats:
    """Q0, a number or (S, A), as a new (S, A) float array: -inf where not legal, 0 at terminal states."""
    Q0 = _table("Q0", Q0, legal.shape, np.full(legal.shape, -np.inf), legal)
    Q0[terminal] = 0.0
    return Q0


def _table(name, values, shape, otherwise, where):
    values = as_floats(name, values)
    if values.shape not in ((), shape):
        raise ValueError(f"{name}: got shape {values.shape}, must be a number or {shape}")
    values = np.where(where, values, otherwise)
    if not np.isfinite(values[where]).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return values
