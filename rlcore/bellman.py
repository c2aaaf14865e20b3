"""Bellman equations: backups, optimality, exact solution of small systems (chapter 2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from rlcore.core.chains import chain, reaches, require_end_of, solve_system
from rlcore.core.checks import as_floats, check_nonnegative
from rlcore.core.endings import bound_above, prefer_ends
from rlcore.core.rules import checked
from rlcore.core.types import ArrayLike, Flags, Floats, Given
from rlcore.mdp import FiniteMDP, deterministic_policy


def table(name: str, Q: Any, given: Given) -> Floats:
    """The rule of any Q (S, A) without NaN, -inf where an action is not legal."""
    Q = as_floats(name, Q)
    if Q.ndim != 2 or Q.shape[1] == 0 or np.isnan(Q).any():
        raise ValueError(f"{name}: got shape {Q.shape}{' with NaN' * bool(np.isnan(Q).any())}, must be (S, A) numbers")
    return Q


def _weights(name, pi, given):
    pi = as_floats(name, pi)
    if pi.shape != given["Q"].shape:
        raise ValueError(f"{name}: got shape {pi.shape}, must be that of Q, {given['Q'].shape}")
    if not (pi >= 0).all():
        raise ValueError(f"{name}: contains {pi[~(pi >= 0)][0]:g}, must be probabilities")
    return pi


@checked
def q_from_v(mdp: FiniteMDP, V: ArrayLike, gamma: float) -> Floats:
    """The action values q(s, a) = E[R + gamma V(S')] of a one-step lookahead.

    With V = v_pi this is q_pi, with v_* it is q_*.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    V : ArrayLike
        (S,) or a number; terminal states count as 0 whatever it says.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S, A), -inf where a is not in A(s).

    Notes
    -----
    Ledger: eq-15, alg-greedy-lookahead.

    Examples
    --------
    >>> from rlcore import q_from_v
    >>> from rlcore.envs.small import zero_loop
    >>> q_from_v(zero_loop(), [1.0, 0.0], 0.9)
    array([[0.9, 1. ],
           [0. , 0. ]])
    """
    Q = (mdp.prob * (mdp.reward + gamma * V[mdp.next_state])).sum(axis=2)  # eq-15
    return np.where(mdp.legal, Q, -np.inf)


@checked(Q=table, pi=_weights)
def v_from_q(Q: ArrayLike, pi: ArrayLike) -> Floats:
    """The values v(s) = sum over a of pi(a|s) q(s, a).

    Parameters
    ----------
    Q : ArrayLike
        (S, A); an action of probability 0 counts 0 even where Q is -inf.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.

    Returns
    -------
    Floats
        (S,).

    Notes
    -----
    Ledger: fig-3.

    Examples
    --------
    >>> from rlcore import v_from_q
    >>> v_from_q([[1.0, 3.0]], [[0.5, 0.5]])
    array([2.])
    """
    return (pi * np.where(pi > 0, Q, 0.0)).sum(axis=1)


@checked
def expectation_backup(mdp: FiniteMDP, pi: ArrayLike, V: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman equation for v_pi.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    V : ArrayLike
        (S,) or a number; terminal states count as 0 whatever it says.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S,); V is v_pi exactly where this gives V back.

    Notes
    -----
    Ledger: eq-12, om-bellman-derivation, alg-bellman-operators.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import expectation_backup
    >>> from rlcore.envs.small import random_walk
    >>> expectation_backup(random_walk(3), np.ones((5, 1)), 0.5, 1.0)
    array([0.  , 0.25, 0.5 , 0.75, 0.  ])
    """
    return v_from_q(q_from_v(mdp, V, gamma), pi)  # eq-12


@checked
def expectation_backup_q(mdp: FiniteMDP, pi: ArrayLike, Q: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman equation for q_pi.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    Q : ArrayLike
        (S, A), -inf where a is not in A(s).
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S, A).

    Notes
    -----
    Ledger: om-bellman-q, fig-4.
    """
    return q_from_v(mdp, np.where(mdp.terminal, 0.0, v_from_q(Q, pi)), gamma)


def optimality_backup(mdp: FiniteMDP, V: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman optimality equation for v_*.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    V : ArrayLike
        (S,) or a number; terminal states count as 0 whatever it says.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S,); V is v_* exactly where this gives V back.

    Notes
    -----
    Ledger: eq-16.

    Examples
    --------
    >>> from rlcore import optimality_backup
    >>> from rlcore.envs.small import zero_loop
    >>> optimality_backup(zero_loop(), 0.5, 0.9)
    array([1., 0.])
    """
    return q_from_v(mdp, V, gamma).max(axis=1)  # eq-16


@checked
def optimality_backup_q(mdp: FiniteMDP, Q: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman optimality equation for q_*.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    Q : ArrayLike
        (S, A), -inf where a is not in A(s).
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S, A).

    Notes
    -----
    Ledger: eq-17 corrected.
    """
    return q_from_v(mdp, Q.max(axis=1), gamma)  # eq-17


@checked(Q=table)
def greedy(Q: ArrayLike) -> Floats:
    """The policy that takes the first maximising action of each row of Q.

    Parameters
    ----------
    Q : ArrayLike
        (S, A), -inf where a is not in A(s).

    Returns
    -------
    Floats
        (S, A).

    Notes
    -----
    Ledger: alg-greedy-lookahead.

    Examples
    --------
    >>> from rlcore import greedy
    >>> greedy([[0.0, 1.0], [2.0, 2.0]])
    array([[0., 1.],
           [1., 0.]])
    """
    return np.eye(Q.shape[1])[Q.argmax(axis=1)]


@checked(Q=table, tol=check_nonnegative)
def greedy_actions(Q: ArrayLike, tol: float = 1e-9) -> Flags:
    """Every maximising action of each row of Q.

    Parameters
    ----------
    Q : ArrayLike
        (S, A), -inf where a is not in A(s).
    tol : float
        An action counts where Q(s, a) >= max - tol * (1 + |max|).

    Returns
    -------
    Flags
        (S, A).

    Notes
    -----
    Ledger: cl-013.

    Examples
    --------
    >>> from rlcore.bellman import greedy_actions
    >>> greedy_actions([[0.0, 1.0], [2.0, 2.0]])
    array([[False,  True],
           [ True,  True]])
    """
    best = Q.max(axis=1, keepdims=True)
    return best - tol * (1 + np.abs(best)) <= Q


@checked
def policy_matrix(mdp: FiniteMDP, pi: ArrayLike) -> tuple[Any, Floats]:
    """The Markov reward process of pi.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.

    Returns
    -------
    tuple[Any, Floats]
        P_pi (S, S), sparse, and r_pi (S,).

    Notes
    -----
    Ledger: eq-u-model-and-policy.
    """
    return chain(mdp, pi)


@checked
def is_proper(mdp: FiniteMDP, pi: ArrayLike) -> bool:
    """Whether pi reaches a terminal state with probability 1 from every state.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.

    Returns
    -------
    bool
        True where it does.
    """
    return bool(reaches(chain(mdp, pi)[0], mdp.terminal).all())


@checked
def solve_policy(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> Floats:
    """The values v_pi, as the solution of the linear system (12).

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S,).

    Raises
    ------
    ValueError
        At gamma = 1 where pi may never reach a terminal state (an improper policy), for there the system is singular.

    Notes
    -----
    Ledger: eq-12, alg-bellman-operators.

    References
    ----------
    Puterman (1994), theorem 6.1.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import solve_policy
    >>> from rlcore.envs.small import random_walk
    >>> solve_policy(random_walk(3), np.ones((5, 1)), 1.0)
    array([0.  , 0.25, 0.5 , 0.75, 0.  ])
    """
    P, r = chain(mdp, pi)
    V = solve_system(P, r, gamma, mdp.terminal)
    if not np.finfo(float).eps * np.abs(V).max() <= np.abs(r).max():  # a reward is lost in V's rounding, or V is NaN
        raise ValueError("pi: takes longer to end than doubles can say, must end sooner, or gamma be smaller")
    return V


@checked
def expected_visits(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> Floats:
    """Expected discounted number of visits to each state, from the start distribution.

    The solution of mu = start + gamma P_pi^T mu, which weights the states in the policy gradient.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S,), 0 at terminal states.

    Raises
    ------
    ValueError
        As `solve_policy` does.

    Notes
    -----
    Ledger: eq-u-pg-theorem.

    References
    ----------
    Puterman (1994), section 6.9.
    """
    P, go = chain(mdp, pi)[0], ~mdp.terminal
    require_end_of(P, gamma, mdp.terminal)
    P, visits = P.toarray()[go][:, go], np.zeros(mdp.n_states)
    visits[go] = np.linalg.solve(np.eye(len(P)) - gamma * P.T, mdp.start[go])
    return visits


@checked
def deterministic_policies(mdp: FiniteMDP) -> Iterator[Floats]:
    """Every deterministic policy (S, A), for processes so small that they can be listed.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.

    Returns
    -------
    Iterator[Floats]
        (S, A), one policy after the other.

    Notes
    -----
    Ledger: eq-13, eq-14.
    """
    allowed = [np.flatnonzero(row)[: 1 if end else None] for row, end in zip(mdp.legal, mdp.terminal)]
    return (deterministic_policy(mdp, np.array(actions)) for actions in itertools.product(*allowed))


@checked
def newton_optimality(mdp: FiniteMDP, gamma: float, n_iter: int, *, V0: ArrayLike = 0.0) -> Floats:
    """Newton's method on V - (optimality backup of V) = 0.

    The system is piecewise linear; its derivative at V is I - gamma P_pi with pi greedy for V, so that a Newton step
    is a step of policy iteration.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    gamma : float
        Discount, in [0, 1].
    n_iter : int
        Number of steps.
    V0 : ArrayLike
        First estimate, a number or (S,).

    Returns
    -------
    Floats
        History (n_iter + 1, S), V0 first.

    Notes
    -----
    Ledger: alg-nonlinear-system, eq-16.

    References
    ----------
    Puterman and Brumelle (1979).

    Examples
    --------
    >>> from rlcore import newton_optimality
    >>> from rlcore.envs.small import two_state_mdp
    >>> newton_optimality(two_state_mdp(), 0.9, 3).round(3)
    array([[0.   , 0.   ],
           [3.214, 6.786],
           [7.495, 8.813],
           [7.495, 8.813]])
    """
    V, history = V0, [V0]
    for _ in range(n_iter):
        pi = greedy(q_from_v(mdp, V, gamma))
        P, _ = chain(mdp, pi)
        V = V + solve_system(P, optimality_backup(mdp, V, gamma) - V, gamma, mdp.terminal)
        history.append(V)
    return np.array(history)


@checked
def heuristic_search(mdp: FiniteMDP, s: int, depth: int, gamma: float, *, V0: ArrayLike = 0.0) -> Floats:
    """Values of the actions of state s after an expectimax search of `depth` steps with V0 at the leaves.

    The error is at most gamma^depth times that of V0.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    s : int
        The state at the root.
    depth : int
        Steps that the search looks ahead.
    gamma : float
        Discount, in [0, 1].
    V0 : ArrayLike
        Values at the leaves, a number or (S,).

    Returns
    -------
    Floats
        (A,), -inf where a is not in A(s).

    Notes
    -----
    Ledger: alg-heuristic-search.

    Examples
    --------
    >>> from rlcore import heuristic_search
    >>> from rlcore.envs.small import two_state_mdp
    >>> heuristic_search(two_state_mdp(), 0, 5, 0.9).round(3)
    array([1.761, 2.392])
    """

    @cache
    def value(s, depth):
        return V0[s] if depth == 0 or mdp.terminal[s] else lookahead(s, depth).max()

    def lookahead(s, depth):
        q = np.full(mdp.n_actions, -np.inf)
        for a in np.flatnonzero(mdp.legal[s]):
            used = mdp.prob[s, a] > 0
            outcomes = zip(mdp.prob[s, a, used], mdp.reward[s, a, used], mdp.next_state[s, a, used])
            q[a] = sum(p * (r + gamma * value(s_next, depth - 1)) for p, r, s_next in outcomes)  # eq-16
        return q

    return lookahead(s, depth)


# ---------------------------------------------------------------------- certified error bounds


@checked
def policy_error_bound(mdp: FiniteMDP, pi: ArrayLike, V: ArrayLike, gamma: float) -> float:
    """A certified bound on max |V - v_pi|, rounding included: (residual + rounding) times the horizon.

    The horizon is 1 / (1 - gamma), or at gamma = 1 the largest expected number of steps to a terminal state under pi.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    V : ArrayLike
        (S,).
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    float
        What the error does not exceed.

    References
    ----------
    Puterman (1994), theorem 6.3.1; Bertsekas (2012), section 3.2.

    Examples
    --------
    >>> from rlcore import policy_error_bound, uniform_policy
    >>> from rlcore.envs.small import zero_loop
    >>> round(policy_error_bound(zero_loop(), uniform_policy(zero_loop()), [1.0, 0.0], 0.5), 9)
    0.5
    """
    residual = np.abs(expectation_backup(mdp, pi, V, gamma) - V)[~mdp.terminal].max() + _rounding(mdp, V)
    if gamma < 1:
        return float(residual / (1 - gamma))
    P, _ = chain(mdp, pi)
    steps = solve_system(P, (~mdp.terminal).astype(float), 1.0, mdp.terminal)
    return float(residual * steps.max() * (1 + 1e-6))


@checked
def error_bound(mdp: FiniteMDP, V: ArrayLike, gamma: float) -> float:
    """A certified bound on max |V - v_*|, rounding included.

    gamma < 1: (residual + rounding) / (1 - gamma). gamma = 1: v_* lies between the value of the greedy policy and V
    plus the residual times the number of steps that a policy which is nearly optimal can take. That is finite where
    policies that never end are worth minus infinity; where a loop costs nothing, the bound is inf.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    V : ArrayLike
        (S,).
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    float
        What the error does not exceed; inf where nothing can be certified.

    References
    ----------
    Puterman (1994), theorem 6.3.1; Bertsekas and Tsitsiklis (1991).

    Examples
    --------
    >>> from rlcore import error_bound
    >>> from rlcore.envs.small import zero_loop
    >>> round(error_bound(zero_loop(), [1.0, 0.0], 0.9), 9)
    0.0
    """
    change, rounding = (optimality_backup(mdp, V, gamma) - V)[~mdp.terminal], _rounding(mdp, V)
    if gamma < 1:
        return float((np.abs(change).max() + rounding) / (1 - gamma))
    Q = q_from_v(mdp, V, gamma)
    pi = prefer_ends(mdp, greedy(Q), greedy_actions(Q))
    P, r = chain(mdp, pi)
    if not reaches(P, mdp.terminal).all():
        return np.inf
    lower = solve_system(P, r, 1.0, mdp.terminal)
    cost = -np.where(mdp.legal, mdp.expected_reward(), -np.inf)[~mdp.terminal].max()
    if cost <= 0:
        return max(float(np.max(V - lower) + rounding), bound_above(mdp, V, Q, pi, float(rounding)))
    most_steps = -lower.min() / cost * (1 + 1e-6)
    above = (max(change.max(), 0.0) + rounding) * most_steps
    return float(max(np.max(V - lower), above) + rounding * most_steps)


def _rounding(mdp, V):
    """How far a computed backup of V may lie from the exact one."""
    return (mdp.prob.shape[2] + 4) * np.finfo(float).eps * (np.abs(mdp.reward).max() + np.abs(V).max())
