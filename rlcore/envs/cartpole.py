"""Cart-pole dynamics, many states at once."""

import numpy as np

from rlcore.core.checks import check_count, check_function

__all__ = ["balance", "cartpole_start", "cartpole_step", "cartpole_transitions", "cartpole_upright", "steps_upright"]

GRAVITY, CART, POLE, HALF_LENGTH, FORCE, TAU = 9.8, 1.0, 0.1, 0.5, 10.0, 0.02
MAX_X, MAX_ANGLE = 2.4, 12 * 2 * np.pi / 360


def cartpole_step(x, a):
    """States (n, 4) one step of 0.02 s after pushing left (0) or right (1); a: (n,). ex-pole-episodic

    A state is (position, velocity, angle, angular velocity). Constants and Euler steps are those of gymnasium's
    CartPole-v1. Source: Barto, Sutton and Anderson (1983).
    """
    position, velocity, angle, spin = np.moveaxis(np.asarray(x, float), -1, 0)
    force = np.where(np.asarray(a) == 1, FORCE, -FORCE)
    push = (force + POLE * HALF_LENGTH * spin**2 * np.sin(angle)) / (CART + POLE)
    inertia = HALF_LENGTH * (4 / 3 - POLE * np.cos(angle) ** 2 / (CART + POLE))
    turn = (GRAVITY * np.sin(angle) - np.cos(angle) * push) / inertia
    speed_up = push - POLE * HALF_LENGTH * turn * np.cos(angle) / (CART + POLE)
    change = [velocity, speed_up, spin, turn]
    return np.stack([old + TAU * new for old, new in zip((position, velocity, angle, spin), change)], axis=-1)


def cartpole_upright(x):
    """Whether a state (..., 4) is neither off the track nor past 12 degrees."""
    x = np.asarray(x)
    return (np.abs(x[..., 0]) <= MAX_X) & (np.abs(x[..., 2]) <= MAX_ANGLE)


def cartpole_start(*, rng):
    """A first state (4,), each part uniform between -0.05 and 0.05."""
    return rng.uniform(-0.05, 0.05, size=4)


def cartpole_transitions(n, *, rng):
    """n transitions under random pushes, from a new start after each fall: x (n, 4), a (n,), x_next (n, 4). fig-7"""
    n = check_count("n", n)
    x, a, x_next = np.zeros((n, 4)), (rng.random(n) < 0.5).astype(int), np.zeros((n, 4))
    state = cartpole_start(rng=rng)
    for t in range(n):
        x[t] = state
        state = x_next[t] = cartpole_step(state, a[t])
        if not cartpole_upright(state):
            state = cartpole_start(rng=rng)
    return x, a, x_next


def balance(choose, n_steps=200, *, rng):
    """Steps (at most n_steps) before the pole falls when choose(x) picks the pushes. alg-mpc, ex-model-based"""
    x, t, n_steps = cartpole_start(rng=rng), 0, check_count("n_steps", n_steps)
    check_function("choose", choose, "the state (4,)")
    while t < n_steps and cartpole_upright(x):
        x = cartpole_step(x, choose(x))
        t += 1
    return t


def steps_upright(choose, x, n_steps):
    """Steps (n,), at most n_steps, before the pole falls from each first state x (n, 4). cl-114

    choose(x) picks the pushes (m,) of the m states (m, 4) that are still upright.
    """
    n_steps, x = check_count("n_steps", n_steps), np.asarray(x, float)
    check_function("choose", choose, "the states (m, 4)")
    if x.ndim != 2 or x.shape[1] != 4:
        raise ValueError(f"x: got shape {x.shape}, must be (n, 4)")
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
