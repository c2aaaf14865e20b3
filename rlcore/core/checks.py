"""What an argument may be: each check returns the value that the code works with, or says what is wrong."""

from numbers import Real

import numpy as np


class Model:
    """What a FiniteMDP is known by here: `rlcore.mdp` imports this module, not the other way round."""


def is_number(value):
    """Whether value is a real number; True and False are not."""
    return isinstance(value, (float, int, Real)) and not isinstance(value, bool)  # the common ones first


def as_floats(name, values):
    """values as a float array; ValueError where they are not numbers."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: got {values!r}, must be numbers") from None


def as_integers(name, values):
    """values as an array of integers; ValueError where they are not."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise ValueError(f"{name}: got {values!r}, must be integers") from None
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"{name}: got dtype {array.dtype}, must be integers")
    return array.astype(np.int64, copy=False)


def where(bad):
    """The first place that is True, as (s=0, a=1)."""
    return "(" + ", ".join(f"{name}={i}" for name, i in zip("sak", np.argwhere(bad)[0])) + ")"


def check_mdp(mdp):
    """mdp; ValueError unless it is a FiniteMDP."""
    if not isinstance(mdp, Model):
        raise ValueError(f"mdp: got {type(mdp).__name__}, must be a FiniteMDP; from_env reads gymnasium's tables")
    return mdp


def check_rng(rng):
    """rng; ValueError unless it is a numpy.random.Generator."""
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng: got {rng!r}, must be a numpy.random.Generator such as numpy.random.default_rng(0)")
    return rng


def check_policy(mdp, pi):
    """pi as a float array; ValueError unless it is (S, A) with rows that are distributions over A(s)."""
    return check_pi(check_mdp(mdp).legal, pi)


def check_pi(legal, pi):
    """As check_policy, where all that is known is which actions are legal, (S, A) bool."""
    pi = as_floats("pi", pi)
    if pi.shape != legal.shape:
        raise ValueError(f"pi: got shape {pi.shape}, must be {legal.shape}")
    bad = ~((pi >= 0).all(axis=1) & (np.abs(pi.sum(axis=1) - 1) <= 1e-9))
    if bad.any():
        s = np.flatnonzero(bad)[0]
        raise ValueError(f"pi: row {s} is {pi[s]}, must be probabilities that sum to 1")
    if (pi[~legal] > 0).any():
        raise ValueError(f"pi: probability on an action that is not legal at {where((pi > 0) & ~legal)}, must be 0")
    return pi


def check_gamma(gamma):
    """gamma as a float; ValueError unless 0 <= gamma <= 1."""
    return check_probability("gamma", gamma)


def check_probability(name, value):
    """value as a float; ValueError unless it is a number in [0, 1]."""
    if not is_number(value) or not 0 <= value <= 1:
        raise ValueError(f"{name}: got {value!r}, must be a number in [0, 1]")
    return float(value)


def check_values(mdp, V, name="V"):
    """V as a new (S,) float array, from a number or an array; terminal states get 0."""
    V = as_floats(name, V)
    if V.shape not in ((), (check_mdp(mdp).n_states,)):
        raise ValueError(f"{name}: got shape {V.shape}, must be a number or ({mdp.n_states},)")
    if np.isnan(V).any():
        raise ValueError(f"{name}: contains NaN, must be numbers")
    return np.where(mdp.terminal, 0.0, V)


def check_count(name, value, least=1):
    """value as an int; ValueError unless it is a whole number of at least `least`."""
    if not is_number(value) or not least <= value < np.inf or int(value) != value:
        raise ValueError(f"{name}: got {value!r}, must be a whole number of at least {least}")
    return int(value)


def check_index(name, value, size):
    """value as an int; ValueError unless it is a whole number in 0..size - 1."""
    if not is_number(value) or not 0 <= value < size or int(value) != value:
        raise ValueError(f"{name}: got {value!r}, must be an integer in 0..{size - 1}")
    return int(value)


def check_function(name, f, of):
    """f; ValueError unless it can be called. of: what it is called with, for the message."""
    if not callable(f):
        raise ValueError(f"{name}: got {f!r}, must be a function of {of}")
    return f


def check_tol(tol):
    if not is_number(tol) or not 0 < tol < np.inf:
        raise ValueError(f"tol: got {tol!r}, must be a positive number")
    return float(tol)


def finite_values(mdp, V, name="V"):
    V = check_values(mdp, V, name)
    if not np.isfinite(V).all():
        raise ValueError(f"{name}: contains {V[~np.isfinite(V)][0]:g}, must be finite")
    return V


def check_positive(name, value):
    if not is_number(value) or not 0 < value < np.inf:
        raise ValueError(f"{name}: got {value!r}, must be a number above 0")
    return float(value)


def check_nonnegative(name, value):
    if not is_number(value) or not 0 <= value < np.inf:
        raise ValueError(f"{name}: got {value!r}, must be a number, 0 or more")
    return float(value)


def check_fraction(name, value):
    if not is_number(value) or not 0 < value < 1:
        raise ValueError(f"{name}: got {value!r}, must be above 0 and below 1")
    return float(value)


def check_world(world):
    """world; ValueError unless it is a FiniteMDP to act in. cl-031"""
    if not isinstance(world, Model):
        raise ValueError(f"world: got {type(world).__name__}, must be a FiniteMDP to act in")
    return world


def check_rate(alpha):
    """alpha as a float; ValueError unless it is in (0, 1]."""
    if not (is_number(alpha) and 0 < alpha <= 1):
        raise ValueError(f"alpha: got {alpha!r}, must be in (0, 1]")
    return float(alpha)


def check_v0(terminal, V0):
    """V0, a number or (S,), as a new (S,) float array with 0 at terminal states."""
    return _table("V0", V0, terminal.shape, np.zeros(terminal.shape), ~terminal)


def check_q0(legal, terminal, Q0):
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
