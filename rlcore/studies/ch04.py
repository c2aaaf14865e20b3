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
    """n_runs independent runs of method(*args, **settings, rng=...), as a list. fig-17, fig-22

    rng: each run gets a child of it.
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
    """Root mean square error over the n states of a random walk. fig-17, fig-18, ex-random-walk-19

    V: (..., n + 2) estimates, the two ends included but not counted; those that diverged give NaN or infinity.
    truth: (n,). Returns (...).
    """
    return np.sqrt(((V[..., 1:-1] - truth) ** 2).mean(axis=-1))


@checked(V=array("S"), episodes=episode_pairs)
def squared_error(V: ArrayLike, episodes: Episodes, gamma: float) -> float:
    """Sum of (G_t - V(S_t))^2 over all steps of all episodes (Trajectories or pairs of states, rewards). cl-048"""
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
    """The first n_steps updates of a control method as a list of Update. fig-20, fig-21

    The same run is cut after 1, 2, ... steps; what differs is the update. Every update must change its entry.
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
    """The process in which each chosen action is replaced, with probability epsilon, by one of A(s) at random. fig-22

    Its optimal policy is the best that an epsilon-greedy agent can do. Terminal states stay.
    """
    P, R = mdp.transition_probs(), mdp.expected_reward()
    legal = mdp.legal / mdp.legal.sum(axis=1, keepdims=True)
    mean_P, mean_R = np.einsum("sa,sat->st", legal, P), (legal * R).sum(axis=1)
    P = np.where(mdp.legal[:, :, None], (1 - epsilon) * P + epsilon * mean_P[:, None], 0.0)
    R = np.where(mdp.legal, (1 - epsilon) * R + epsilon * mean_R[:, None], 0.0)
    return FiniteMDP.from_arrays(P, R, terminal=mdp.terminal, start=mdp.start)
