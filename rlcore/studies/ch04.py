"""What chapters 4 and 5 measure: repeated runs, errors, the first updates one by one."""

from collections import namedtuple
from copy import deepcopy

import numpy as np

from rlcore.core.checks import (
    anything,
    array,
    as_floats,
    check_count,
    check_probability,
    check_rng,
    check_world,
    checked,
)
from rlcore.mdp import FiniteMDP, discounted_returns
from rlcore.nstep import reward_list, values_on_the_way, visited


def repeat(method, *args, n_runs, rng, **settings):
    """n_runs independent runs of method(*args, **settings, rng=...), as a list. fig-17, fig-22

    rng: each run gets a child of it.
    """
    children = check_rng(rng).spawn(check_count("n_runs", n_runs))
    return [method(*args, **settings, rng=child) for child in children]


def walk_error(V, truth):
    """Root mean square error over the n states of a random walk. fig-17, fig-18, ex-random-walk-19

    V: (..., n + 2) estimates, the two ends included but not counted. truth: (n,). Returns (...).
    """
    V, truth = as_floats("V", V), as_floats("truth", truth)
    if truth.ndim != 1 or V.ndim == 0 or V.shape[-1] != truth.size + 2:
        raise ValueError(
            f"V: got shape {V.shape}, must be (..., {truth.size + 2}), the ends beside {truth.size} states"
        )
    return np.sqrt(((V[..., 1:-1] - truth) ** 2).mean(axis=-1))


@checked(V=array("S"), episodes=anything)
def squared_error(V, episodes, gamma):
    """Sum of (G_t - V(S_t))^2 over all steps of all episodes (Trajectories or pairs of states, rewards). cl-048"""
    total = 0.0
    for e in episodes:
        states, rewards = (e.states, e.rewards) if hasattr(e, "states") else e
        states, rewards = visited("states", states, {}), reward_list("rewards", rewards, {})
        values = values_on_the_way(states, rewards, V)
        total += ((discounted_returns(rewards, gamma) - values[:-1]) ** 2).sum()
    return float(total)


Update = namedtuple("Update", "s a s_next old new")


def first_updates(method, world, gamma, n_steps, *, alpha, epsilon, rng):
    """The first n_steps updates of a control method as a list of Update. fig-20, fig-21

    The same run is cut after 1, 2, ... steps; what differs is the update. Every update must change its entry.
    """
    settings = dict(alpha=alpha, epsilon=epsilon, record=0)
    before, updates = np.where(check_world("world", world).legal, 0.0, -np.inf), []
    for n in range(1, check_count("n_steps", n_steps) + 1):
        Q = method(world, gamma, 1, max_steps=n, rng=rng if n == n_steps else deepcopy(rng), **settings).Q
        if np.array_equal(before, Q):
            raise ValueError(f"n_steps: got {n_steps}, but update {n} changes no entry; must be fewer")
        s, a = np.argwhere(before != Q)[0]
        updates.append((int(s), int(a), float(before[s, a]), float(Q[s, a])))
        before = Q
    after = [s for s, *_ in updates[1:]] + [-1]
    return [Update(s, a, s_next, old, new) for (s, a, old, new), s_next in zip(updates, after)]


def with_random_actions(mdp, epsilon):
    """The process in which each chosen action is replaced, with probability epsilon, by one of A(s) at random. fig-22

    Its optimal policy is the best that an epsilon-greedy agent can do. Terminal states stay.
    """
    epsilon, P, R = check_probability("epsilon", epsilon), mdp.transition_probs(), mdp.expected_reward()
    legal = mdp.legal / mdp.legal.sum(axis=1, keepdims=True)
    mean_P, mean_R = np.einsum("sa,sat->st", legal, P), (legal * R).sum(axis=1)
    P = np.where(mdp.legal[:, :, None], (1 - epsilon) * P + epsilon * mean_P[:, None], 0.0)
    R = np.where(mdp.legal, (1 - epsilon) * R + epsilon * mean_R[:, None], 0.0)
    return FiniteMDP.from_arrays(P, R, terminal=mdp.terminal, start=mdp.start)
