"""What chapters 4 and 5 measure: repeated runs, errors, the first updates one by one."""

from __future__ import annotations

import warnings
from collections import namedtuple
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

from rlcore.batch import Episodes, episode_pairs
from rlcore.core.checks import as_floats, check_count, check_function, check_rng, check_world
from rlcore.core.rules import anything, array, checked, function_of, rule_of
from rlcore.core.types import ArrayLike, Floats, Rate, Rng, World
from rlcore.mdp import FiniteMDP, discounted_returns
from rlcore.nstep import values_on_the_way


def repeat(method: Callable[..., Any], *args: Any, n_runs: int, rng: Rng, **settings: Any) -> list[Any]:
    """Independent runs of method(*args, **settings, rng=...).

    Parameters
    ----------
    method : Callable[..., Any]
        A learner.
    *args : Any
        What it is called with.
    n_runs : int
        How many.
    rng : Rng
        Each run gets a child of it.
    **settings : Any
        What it is called with.

    Returns
    -------
    list[Any]
        What it returned, run by run.

    Notes
    -----
    Ledger: fig-17, fig-22.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import td0
    >>> from rlcore.envs.small import random_walk
    >>> from rlcore.studies.ch04 import repeat
    >>> pi, rng = np.ones((5, 1)), np.random.default_rng(0)
    >>> [run.returns.size for run in repeat(td0, random_walk(3), pi, 1.0, 4, alpha=0.1, n_runs=2, rng=rng)]
    [4, 4]
    """
    check_function("method", method, "(*args, rng=, **settings)")
    children = check_rng(rng).spawn(check_count("n_runs", n_runs))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a step size that is too large is a result here
        return [method(*args, **settings, rng=child) for child in children]


def _inner_states(name, truth, given):
    truth, V = array("n")(name, truth, given), given["V"]
    if V.ndim == 0 or V.shape[-1] != truth.size + 2:
        raise ValueError(
            f"V: got shape {V.shape}, must be (..., {truth.size + 2}), the ends beside {truth.size} states"
        )
    return truth


@checked(V=rule_of(as_floats), truth=_inner_states)
def walk_error(V: ArrayLike, truth: ArrayLike) -> Floats:
    """Root mean square error over the n states of a random walk.

    Parameters
    ----------
    V : ArrayLike
        (..., n + 2) estimates, the two ends included but not counted.
    truth : ArrayLike
        (n,), the values.

    Returns
    -------
    Floats
        (...); NaN or infinity of estimates that diverged.

    Notes
    -----
    Ledger: fig-17, fig-18, ex-random-walk-19.
    """
    return np.sqrt(((V[..., 1:-1] - truth) ** 2).mean(axis=-1))


@checked(V=array("S"), episodes=episode_pairs)
def squared_error(V: ArrayLike, episodes: Episodes, gamma: float) -> float:
    """Sum of (G_t - V(S_t))^2 over all steps of all episodes.

    Parameters
    ----------
    V : ArrayLike
        (S,).
    episodes : Episodes
        Trajectories, or pairs of states and rewards.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    float
        The sum.

    Notes
    -----
    Ledger: cl-048.
    """
    total = 0.0
    for states, rewards in episodes:
        values = values_on_the_way(states, rewards, V)
        total += ((discounted_returns(rewards, gamma) - values[:-1]) ** 2).sum()
    return float(total)


Update = namedtuple("Update", "s a s_next old new")


@checked(method=function_of("(world, gamma, n_episodes, ...)"), world=check_world, alpha=anything, epsilon=anything)
def first_updates(
    method: Callable[..., Any], world: World, gamma: float, n_steps: int, *, alpha: float, epsilon: Rate, rng: Rng
) -> list[Update]:
    """The first updates of a control method, one by one.

    The same run is cut after 1, 2, ... steps; what differs is the update.

    Parameters
    ----------
    method : Callable[..., Any]
        A learner: method(world, gamma, n_episodes, ...).
    world : World
        What it learns from.
    gamma : float
        Discount, in [0, 1].
    n_steps : int
        How many.
    alpha : float
        Step size.
    epsilon : Rate
        Of its actions.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    list[Update]
        (s, a, s_next, old, new) each; s_next is -1 in the last.

    Raises
    ------
    ValueError
        Where an update changes no entry.

    Notes
    -----
    Ledger: fig-20, fig-21.
    """
    settings = dict(alpha=alpha, epsilon=epsilon, record=0)
    before, updates = np.where(world.legal, 0.0, -np.inf), []
    for n in range(1, n_steps + 1):
        Q = method(world, gamma, 1, max_steps=n, rng=rng if n == n_steps else deepcopy(rng), **settings).Q
        if np.array_equal(before, Q):
            raise ValueError(f"n_steps: got {n_steps}, but update {n} changes no entry; must be fewer")
        s, a = np.argwhere(before != Q)[0]
        updates.append((int(s), int(a), float(before[s, a]), float(Q[s, a])))
        before = Q
    after = [s for s, *_ in updates[1:]] + [-1]
    return [Update(s, a, s_next, old, new) for (s, a, old, new), s_next in zip(updates, after)]


@checked
def with_random_actions(mdp: FiniteMDP, epsilon: float) -> FiniteMDP:
    """The process in which each chosen action is replaced, with some probability, by any of A(s).

    Its optimal policy is the best that an epsilon-greedy agent can do.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    epsilon : float
        The probability.

    Returns
    -------
    FiniteMDP
        The other process; terminal states stay.

    Notes
    -----
    Ledger: fig-22.
    """
    P, R = mdp.transition_probs(), mdp.expected_reward()
    legal = mdp.legal / mdp.legal.sum(axis=1, keepdims=True)
    mean_P, mean_R = np.einsum("sa,sat->st", legal, P), (legal * R).sum(axis=1)
    P = np.where(mdp.legal[:, :, None], (1 - epsilon) * P + epsilon * mean_P[:, None], 0.0)
    R = np.where(mdp.legal, (1 - epsilon) * R + epsilon * mean_R[:, None], 0.0)
    return FiniteMDP.from_arrays(P, R, terminal=mdp.terminal, start=mdp.start)
