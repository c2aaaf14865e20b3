"""Cart-pole dynamics, many states at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rlcore.core.checks import as_flags, finite
from rlcore.core.rules import checked, function_of
from rlcore.core.types import ArrayLike, Flags, Floats, Ints, Rng

__all__ = ["balance", "cartpole_start", "cartpole_step", "cartpole_transitions", "cartpole_upright", "steps_upright"]

GRAVITY, CART, POLE, HALF_LENGTH, FORCE, TAU = 9.8, 1.0, 0.1, 0.5, 10.0, 0.02
MAX_X, MAX_ANGLE = 2.4, 12 * 2 * np.pi / 360


def _poles(name, x, given):
    x = finite(name, x)
    if x.ndim == 0 or x.shape[-1] != 4:
        raise ValueError(f"{name}: got shape {x.shape}, must be (..., 4)")
    return x


def _pushes(name, a, given):
    a, poles = as_flags(name, a), given["x"].shape[:-1]
    if a.shape not in ((), poles):
        raise ValueError(f"{name}: got shape {a.shape}, must be one push, or {poles}")
    return a


@checked(x=_poles, a=_pushes)
def cartpole_step(x: ArrayLike, a: ArrayLike) -> Floats:
    """States one step of 0.02 s after a push.

    Constants and Euler steps are those of gymnasium's CartPole-v1.

    Parameters
    ----------
    x : ArrayLike
        (..., 4): position in m, velocity, angle in radians, angular velocity.
    a : ArrayLike
        0 pushes left, 1 right: a number, or (...).

    Returns
    -------
    Floats
        (..., 4), the states that follow.

    Notes
    -----
    Ledger: ex-pole-episodic.

    References
    ----------
    Barto, Sutton and Anderson (1983).

    Examples
    --------
    >>> from rlcore.envs.cartpole import cartpole_step
    >>> cartpole_step([0.0, 0.0, 0.0, 0.0], 1).round(3)
    array([ 0.   ,  0.195,  0.   , -0.293])
    """
    position, velocity, angle, spin = np.moveaxis(x, -1, 0)
    force = np.where(a, FORCE, -FORCE)
    push = (force + POLE * HALF_LENGTH * spin**2 * np.sin(angle)) / (CART + POLE)
    inertia = HALF_LENGTH * (4 / 3 - POLE * np.cos(angle) ** 2 / (CART + POLE))
    turn = (GRAVITY * np.sin(angle) - np.cos(angle) * push) / inertia
    speed_up = push - POLE * HALF_LENGTH * turn * np.cos(angle) / (CART + POLE)
    change = [velocity, speed_up, spin, turn]
    return np.stack([old + TAU * new for old, new in zip((position, velocity, angle, spin), change)], axis=-1)


@checked(x=_poles)
def cartpole_upright(x: ArrayLike) -> Flags:
    """Whether a pole is neither off the track (2.4 m) nor past 12 degrees.

    Parameters
    ----------
    x : ArrayLike
        (..., 4), as in `cartpole_step`.

    Returns
    -------
    Flags
        (...), true while it stands.
    """
    return (np.abs(x[..., 0]) <= MAX_X) & (np.abs(x[..., 2]) <= MAX_ANGLE)


@checked
def cartpole_start(*, rng: Rng) -> Floats:
    """A first state, each part uniform between -0.05 and 0.05.

    Parameters
    ----------
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Floats
        (4,).
    """
    return rng.uniform(-0.05, 0.05, size=4)


@checked
def cartpole_transitions(n: int, *, rng: Rng) -> tuple[Floats, Ints, Floats]:
    """Transitions under random pushes, from a new start after each fall.

    Parameters
    ----------
    n : int
        How many.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    x : Floats
        (n, 4), the states.
    a : Ints
        (n,), the pushes, 0 or 1.
    x_next : Floats
        (n, 4), what followed.

    Notes
    -----
    Ledger: fig-7.
    """
    x, a, x_next = np.zeros((n, 4)), (rng.random(n) < 0.5).astype(int), np.zeros((n, 4))
    state = cartpole_start(rng=rng)
    for t in range(n):
        x[t] = state
        state = x_next[t] = cartpole_step(state, a[t])
        if not cartpole_upright(state):
            state = cartpole_start(rng=rng)
    return x, a, x_next


@checked(choose=function_of("the state (4,)"))
def balance(choose: Callable[[Floats], int], n_steps: int = 200, *, rng: Rng) -> int:
    """How many steps a pole stays up.

    Parameters
    ----------
    choose : Callable[[Floats], int]
        choose(x) picks the push, 0 or 1, in state x (4,).
    n_steps : int
        Where to stop.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    int
        Steps before the pole falls, at most n_steps.

    Notes
    -----
    Ledger: alg-mpc, ex-model-based.
    """
    x, t = cartpole_start(rng=rng), 0
    while t < n_steps and cartpole_upright(x):
        x = cartpole_step(x, choose(x))
        t += 1
    return t


def _many_poles(name, x, given):
    x = _poles(name, x, given)
    if x.ndim != 2:
        raise ValueError(f"{name}: got shape {x.shape}, must be (n, 4)")
    return x


@checked(choose=function_of("the states (m, 4)"), x=_many_poles)
def steps_upright(choose: Callable[[Floats], ArrayLike], x: ArrayLike, n_steps: int) -> Ints:
    """How many steps each of many poles stays up.

    Parameters
    ----------
    choose : Callable[[Floats], ArrayLike]
        choose(x) picks the pushes (m,) of the m states (m, 4) that are still upright.
    x : ArrayLike
        (n, 4), first states.
    n_steps : int
        Where to stop.

    Returns
    -------
    Ints
        (n,), steps before each falls, at most n_steps.

    Notes
    -----
    Ledger: cl-114.
    """
    steps, left = np.zeros(len(x), int), np.flatnonzero(cartpole_upright(x))
    x = x[left]
    for _ in range(n_steps):
        if not left.size:
            break
        x = cartpole_step(x, choose(x))
        steps[left] += 1
        up = cartpole_upright(x)
        x, left = x[up], left[up]
    return steps
