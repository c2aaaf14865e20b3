"""The values that a fixed set of episodes determines (chapter 4)."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np

from rlcore.core.checks import as_integers, finite, show
from rlcore.core.rules import checked
from rlcore.core.types import ArrayLike, Floats, Given, Ints
from rlcore.mdp import Trajectory, discounted_returns
from rlcore.td import td_error

Episodes: TypeAlias = Iterable[Trajectory | tuple[ArrayLike, ArrayLike]]  # or pairs of states and rewards


def episode_pairs(name: str, episodes: Any, given: Given) -> list[tuple[Ints, Floats]]:
    """The rule of episodes, Trajectories or pairs: a list of (states, rewards)."""
    if isinstance(episodes, (str, bytes)) or not hasattr(episodes, "__iter__"):
        raise ValueError(f"{name}: got {show(episodes)}, must be Trajectories, or pairs of states and rewards")
    pairs = []
    for i, episode in enumerate(episodes):
        if not isinstance(episode, Trajectory) and not (isinstance(episode, (tuple, list)) and len(episode) == 2):
            raise ValueError(f"{name}: number {i} is {show(episode)}, must be a Trajectory, or (states, rewards)")
        states, rewards = (episode.states, episode.rewards) if isinstance(episode, Trajectory) else episode
        states, rewards = as_integers(name, states), finite(name, rewards)
        if states.ndim != 1 or rewards.ndim != 1 or rewards.size == 0:
            sizes = f"{states.shape} states and {rewards.shape} rewards"
            raise ValueError(f"{name}: number {i} has {sizes}, must be lists, with a reward at least")
        pairs.append((states, rewards))
    if not pairs:
        raise ValueError(f"{name}: got {show(episodes)}, must be at least one")
    return pairs


def _ended(name, episodes, given):
    """The rule of episodes that ran to their end, T + 1 states each."""
    episodes = list(episodes) if hasattr(episodes, "__iter__") and not isinstance(episodes, (str, bytes)) else episodes
    pairs = episode_pairs(name, episodes, given)
    for i, (episode, (states, rewards)) in enumerate(zip(episodes, pairs)):
        if not getattr(episode, "terminated", True):
            raise ValueError(f"{name}: number {i} was cut before its end, must run to a terminal state")
        if states.size != rewards.size + 1:
            sizes = f"{states.shape} states and {rewards.shape} rewards"
            raise ValueError(f"{name}: number {i} has {sizes}, must be T + 1 and T, with T at least 1")
    return pairs


@checked(episodes=_ended)
def batch_mc(
    episodes: Episodes, n_states: int, gamma: float, *, unvisited: float = 0.0, alpha: float | None = None,
    tol: float = 1e-10, max_sweeps: int = 100_000, each: bool = False,
) -> Floats:  # fmt: skip
    """The values with the least squared error on the episodes: the mean return of each state.

    Parameters
    ----------
    episodes : Episodes
        Trajectories, or pairs (states (T + 1,), rewards (T,)), each run to its end: the last state is terminal and
        worth 0. Every visit counts.
    n_states : int
        Number of states, S.
    gamma : float
        Discount, in [0, 1].
    unvisited : float
        Value of states that no episode meets.
    alpha : float | None
        None for the mean itself; a step size to reach it by sweeps that add up alpha (G - V(s)) over all visits before
        V changes.
    tol : float
        Sweeps end where no V(s) changes by it.
    max_sweeps : int
        Most sweeps.
    each : bool
        V after the first episode, the first two, ..., as (n_episodes, S).

    Returns
    -------
    Floats
        (S,); with each, (n_episodes, S).

    Raises
    ------
    ValueError
        Where the sweeps diverge.

    Notes
    -----
    Ledger: alg-batch-mc, cl-048.

    References
    ----------
    Sutton and Barto (2018), section 6.3.

    Examples
    --------
    >>> from rlcore import batch_mc
    >>> batch_mc([([0, 1, 2], [0.0, 0.0]), ([1, 2], [1.0]), ([1, 2], [1.0]), ([1, 2], [1.0])], 3, 1.0)
    array([0.  , 0.75, 0.  ])
    """
    batch = _pool(episodes, n_states)
    G = np.concatenate([discounted_returns(rewards, gamma) for rewards in batch.rewards])
    V0 = np.where(batch.terminal, 0.0, unvisited)
    if alpha is None:
        N, total = _sums(batch, 1.0, each), _sums(batch, G, each)
        V = np.where(N > 0, total / np.maximum(N, 1), V0)
        return V if each else V[0]
    if each:
        raise ValueError(f"each: got {each!r} with alpha = {alpha!r}, must be False for sweeps")
    return _sweep(lambda V: np.bincount(batch.s, G - V[batch.s], V.size), V0, alpha, tol, max_sweeps)  # eq-18


def _first_values(name, V0, given):
    V0, S = finite(name, V0), given["n_states"]
    if V0.shape not in ((), (S,)):
        raise ValueError(f"{name}: got shape {V0.shape}, must be a number or ({S},), finite")
    return V0


@checked(episodes=_ended, V0=_first_values)
def batch_td(
    episodes: Episodes, n_states: int, gamma: float, *, alpha: float = 1e-3, tol: float = 1e-10, V0: ArrayLike = 0.0,
    max_sweeps: int = 100_000,
) -> Floats:  # fmt: skip
    """The values that batch TD(0) settles at, the certainty-equivalence estimate.

    Each sweep adds up alpha (r + gamma V(s') - V(s)) over all steps of all episodes before V changes, until no V(s)
    changes by tol.

    Parameters
    ----------
    episodes : Episodes
        As for `batch_mc`.
    n_states : int
        Number of states, S.
    gamma : float
        Discount, in [0, 1].
    alpha : float
        At most 1 / (visits of a state) is safe.
    tol : float
        The sweeps end where no V(s) changes by it.
    V0 : ArrayLike
        A number or (S,); states that no episode meets keep it.
    max_sweeps : int
        Most sweeps.

    Returns
    -------
    Floats
        (S,).

    Raises
    ------
    ValueError
        Where the sweeps diverge.

    Notes
    -----
    Ledger: alg-batch-td, cl-046, cl-050.

    References
    ----------
    Sutton and Barto (2018), section 6.3.

    Examples
    --------
    >>> from rlcore import batch_td
    >>> episodes = [([0, 1, 2], [0.0, 0.0]), ([1, 2], [1.0]), ([1, 2], [1.0]), ([1, 2], [1.0])]
    >>> batch_td(episodes, 3, 1.0, alpha=0.1).round(6)
    array([0.75, 0.75, 0.  ])
    """
    batch = _pool(episodes, n_states)
    s, s_next = batch.s, batch.s_next

    def increments(V):
        delta = td_error.unchecked(batch.r, V[s], V[s_next], gamma)  # V stays 0 where episodes end
        return np.bincount(s, delta, V.size)  # eq-19

    return _sweep(increments, np.where(batch.terminal, 0.0, V0), alpha, tol, max_sweeps)


@checked(episodes=_ended)
def certainty_equivalence(
    episodes: Episodes, n_states: int, gamma: float, *, unvisited: float = 0.0, each: bool = False
) -> Floats:
    """The values of the most likely Markov process: transitions and rewards as counted.

    Parameters
    ----------
    episodes : Episodes
        As for `batch_mc`.
    n_states : int
        Number of states, S.
    gamma : float
        Discount, in [0, 1].
    unvisited : float
        Value of states that no episode meets.
    each : bool
        V after the first episode, the first two, ..., as (n_episodes, S).

    Returns
    -------
    Floats
        (S,); with each, (n_episodes, S).

    Notes
    -----
    Ledger: alg-certainty-equivalence, cl-050.

    References
    ----------
    Sutton and Barto (2018), section 6.3.

    Examples
    --------
    >>> from rlcore import certainty_equivalence
    >>> episodes = [([0, 1, 2], [0.0, 0.0]), ([1, 2], [1.0]), ([1, 2], [1.0]), ([1, 2], [1.0])]
    >>> certainty_equivalence(episodes, 3, 1.0)
    array([0.75, 0.75, 0.  ])
    """
    batch = _pool(episodes, n_states)
    N, total = _sums(batch, 1.0, each), _sums(batch, batch.r, each)
    P = _sums(batch, 1.0, each, to=batch.s_next) / np.maximum(N, 1)[:, :, None]
    r = np.where(N > 0, total / np.maximum(N, 1), np.where(batch.terminal, 0.0, unvisited))
    V = np.linalg.solve(np.eye(r.shape[1]) - gamma * P, r[:, :, None])[:, :, 0]  # eq-12
    return V if each else V[0]


# Steps of all episodes in a row, (n,) each, with the number of their episode; rewards by episode; terminal (S,)
Batch = namedtuple("Batch", "s r s_next episode rewards terminal")


def _pool(episodes, n_states):
    """The steps of all episodes as a Batch; ValueError unless they end in states that none goes on from."""
    s, s_next, r = (np.concatenate(x) for x in zip(*((states[:-1], states[1:], r) for states, r in episodes)))
    for x in (s, s_next):
        if x.min() < 0 or x.max() >= n_states:
            raise ValueError(f"episodes: got states {x.min()}..{x.max()}, must be in 0..{n_states - 1}")
    terminal = np.zeros(n_states, bool)
    terminal[[states[-1] for states, _ in episodes]] = True
    if terminal[s].any():
        raise ValueError(
            f"episodes: one ends in state {s[terminal[s]][0]}, another goes on from it; ends must be terminal"
        )
    rewards = [rewards for _, rewards in episodes]
    return Batch(s, r, s_next, np.repeat(np.arange(len(rewards)), [len(x) for x in rewards]), rewards, terminal)


def _sums(batch, x, each, to=None):
    """Sum of x over the visits of each state, (1, S), or (1, S, S) for each pair (s, to); each: running, by episode."""
    index = (batch.episode if each else np.zeros_like(batch.s), batch.s) + (() if to is None else (to,))
    sums = np.zeros((len(batch.rewards) if each else 1,) + (batch.terminal.size,) * (len(index) - 1))
    np.add.at(sums, index, x)
    return np.cumsum(sums, axis=0)


def _sweep(increments, V, alpha, tol, max_sweeps):
    """V after sweeps V + alpha increments(V), until none changes an entry by tol."""
    for _ in range(max_sweeps):
        change = alpha * increments(V)
        V, largest = V + change, np.abs(change).max()
        if largest < tol:
            return V
        if largest > 1e100:
            raise ValueError(
                f"alpha: got {alpha}, too large for so many visits: V grows with every sweep, beyond 1e100, "
                "must be smaller"
            )
    raise ValueError(
        f"max_sweeps: got {max_sweeps}, V still changes by {largest:.3g} a sweep, must be more (or tol larger)"
    )
