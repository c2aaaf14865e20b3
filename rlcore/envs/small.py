"""Small processes that make one point each."""

from __future__ import annotations

import numpy as np

from rlcore.core.checks import check_count, check_entries, check_positive, check_probability, finite
from rlcore.core.outcomes import freeze
from rlcore.core.rules import anything, checked, count, sized, takes_none
from rlcore.core.types import ArrayLike, Rng
from rlcore.mdp import FiniteMDP

__all__ = [
    "branching_mdp",
    "jumping_walk",
    "myopic",
    "random_mdp",
    "random_walk",
    "short_corridor",
    "two_state_mdp",
    "zero_loop",
]


MOST_STATES = 10**6  # of a process made from a table of outcomes


@takes_none
def _two_rewards(name, rewards, given):
    if rewards is None:
        return (0.0, 1.0) if given["n"] < 19 else (-1.0, 1.0)
    rewards = finite(name, rewards)
    if rewards.shape != (2,):
        raise ValueError(f"{name}: got {rewards}, must be two numbers, for the left and the right end")
    return rewards


@checked(n=count(most=MOST_STATES), rewards=_two_rewards, start=anything, right=check_probability)
def random_walk(n: int, *, rewards: ArrayLike | None = None, start: int | None = None, right: float = 0.5) -> FiniteMDP:
    """States in a row, one action that steps right or left; a terminal state at each end.

    With the default rewards below n = 19 the true values are i / (n + 1).

    Parameters
    ----------
    n : int
        States between the ends: 1..n; 0 is the left end, n + 1 the right.
    rewards : ArrayLike | None
        (on the left end, on the right end); None: (0, 1) for n < 19, (-1, 1) from there on.
    start : int | None
        A state; the middle where None.
    right : float
        Probability of a step to the right.

    Returns
    -------
    FiniteMDP
        The process.

    References
    ----------
    Sutton and Barto (2018), example 6.2 (n = 5) and section 12.1 (n = 19).

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore.bellman import solve_policy
    >>> from rlcore.envs.small import random_walk
    >>> solve_policy(random_walk(3), np.ones((5, 1)), 1.0).round(2)
    array([0.  , 0.25, 0.5 , 0.75, 0.  ])
    """
    (at_left, at_right), p = rewards, right
    outcomes = {(s, 0): [(1 - p, s - 1, at_left * (s == 1)), (p, s + 1, at_right * (s == n))] for s in range(1, n + 1)}
    return FiniteMDP.from_outcomes(outcomes, start=(n + 1) // 2 if start is None else start, action_names=("step",))


@takes_none
def _successors(name, n_next, given):
    name, K = ("n_states", given["n_states"]) if n_next is None else (name, check_count(name, n_next))
    check_entries(name, given["n_states"], given["n_actions"], K)
    return n_next


@checked(n_next=_successors, concentration=check_positive)
def random_mdp(
    n_states: int, n_actions: int, *, n_next: int | None = None, concentration: float = 0.3, rng: Rng
) -> FiniteMDP:
    """A random process without terminal states: Dirichlet rows, normal rewards r(s, a, s').

    Parameters
    ----------
    n_states : int
        S.
    n_actions : int
        A.
    n_next : int | None
        How many successors each pair has, drawn with repetition, as sparse processes need; all states where None.
    concentration : float
        Of the Dirichlet distribution, above 0: the smaller, the more certain the outcomes.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: fig-13.
    """
    S, A, K = n_states, n_actions, n_states if n_next is None else n_next
    next_state = np.broadcast_to(np.arange(S), (S, A, S)) if n_next is None else rng.integers(S, size=(S, A, K))
    prob = rng.dirichlet(np.full(K, concentration), size=(S, A))
    reward = rng.normal(size=(S, A, K))
    return FiniteMDP(next_state, *freeze(prob, reward, np.ones((S, A), bool), np.zeros(S, bool), np.full(S, 1 / S)))


def short_corridor() -> FiniteMDP:
    """States 0, 1, 2 in a row, then the end; actions left and right, which state 1 confuses.

    Every step costs 1. With every state looking the same, the best policy goes right with probability 2 - sqrt(2) and
    is worth -11.66.

    Returns
    -------
    FiniteMDP
        The process.

    References
    ----------
    Sutton and Barto (2018), example 13.1.
    """
    left, right = 0, 1
    moves = {(0, left): 0, (0, right): 1, (1, left): 2, (1, right): 0, (2, left): 1, (2, right): 3}
    outcomes = {pair: [(1.0, s_next, -1.0)] for pair, s_next in moves.items()}
    return FiniteMDP.from_outcomes(outcomes, start=0, action_names=("left", "right"))


@checked
def zero_loop(*, reward: float = 1.0) -> FiniteMDP:
    """One state with two actions: stay, for reward 0, or leave, to the terminal state.

    At gamma = 1 every constant solves (12) for the policy that stays, and every number of at least `reward` solves
    (16): what the loop promises is never put to the test.

    Parameters
    ----------
    reward : float
        For leaving.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: cl-012, cl-014.

    References
    ----------
    Bertsekas (2012), section 3.1.2, in spirit.
    """
    return FiniteMDP.from_outcomes(
        {(0, 0): [(1.0, 0, 0.0)], (0, 1): [(1.0, 1, reward)]}, action_names=("stay", "leave")
    )


def myopic() -> FiniteMDP:
    """A choice at the start: now, for +1 and the end, or later, for rewards 0, 0, 0, +10 and the end.

    States 0 (start), 1, 2, 3 (the waiting, with one action) and 4 (the end). Best is later where 10 gamma^3 > 1.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-myopic, cl-005.
    """
    outcomes = {(0, 0): [(1.0, 4, 1.0)], (0, 1): [(1.0, 1, 0.0)], (1, 1): [(1.0, 2, 0.0)], (2, 1): [(1.0, 3, 0.0)]}
    outcomes[3, 1] = [(1.0, 4, 10.0)]
    return FiniteMDP.from_outcomes(outcomes, start=0, action_names=("now", "later"))


@checked(reach=sized("n", 2))
def jumping_walk(n: int = 1000, reach: int = 100) -> FiniteMDP:
    """States in a row, one action that jumps left or right, all distances equally likely.

    Jumps beyond an end terminate, with reward -1 on the left, +1 on the right. Start in the middle.

    Parameters
    ----------
    n : int
        States between the ends: 1..n; 0 is the left end, n + 1 the right.
    reach : int
        The longest jump.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-tabular.

    References
    ----------
    Sutton and Barto (2018), example 9.1.
    """
    jumps = np.concatenate([np.arange(-reach, 0), np.arange(1, reach + 1)])
    next_state = np.clip(np.arange(n + 2)[:, None, None] + jumps, 0, n + 1)
    terminal = np.isin(np.arange(n + 2), [0, n + 1])
    next_state[terminal] = np.flatnonzero(terminal)[:, None, None]
    reward = np.where(terminal[:, None, None], 0.0, 1.0 * (next_state == n + 1) - (next_state == 0))
    prob = np.full(next_state.shape, 1 / jumps.size)
    start = np.eye(n + 2)[(n + 1) // 2]
    return FiniteMDP(next_state, prob, reward, np.ones((n + 2, 1), bool), terminal, start, action_names=("jump",))


def two_state_mdp() -> FiniteMDP:
    """Two states, two actions: 0 tries to stay (works 9 times in 10), 1 to change (8 in 10).

    A step in state 1 pays 1, trying to change costs 0.2. Start in state 0.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: fig-8.
    """
    P = [[[0.9, 0.1], [0.2, 0.8]], [[0.1, 0.9], [0.8, 0.2]]]
    return FiniteMDP.from_arrays(P, [[0.0, -0.2], [1.0, 0.8]], start=0, action_names=("stay", "change"))


@checked(n_next=sized("n_states", 2))
def branching_mdp(n_states: int, n_next: int, *, stop: float = 0.1, rng: Rng) -> FiniteMDP:
    """Two actions a state, each to one of several states or to the end; normal rewards.

    The reward depends on (s, a, s'). Start: state 0.

    Parameters
    ----------
    n_states : int
        S, the end not counted.
    n_next : int
        Successors of a pair, drawn at random, equally likely; at most n_states.
    stop : float
        Probability that a step ends, with reward 0.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: cl-022.

    References
    ----------
    Sutton and Barto (2018), section 8.6, figure 8.8.
    """
    S, K = n_states, n_next
    next_state = np.full((S + 1, 2, K + 1), S)
    next_state[:S, :, :K] = rng.integers(S, size=(S, 2, K))
    prob = np.broadcast_to(np.append(np.full(K, (1 - stop) / K), stop), next_state.shape)
    reward = np.where(next_state < S, rng.normal(size=next_state.shape), 0.0)
    terminal = np.arange(S + 1) == S
    return FiniteMDP(next_state, prob, reward, np.ones((S + 1, 2), bool), terminal, np.eye(S + 1)[0])
