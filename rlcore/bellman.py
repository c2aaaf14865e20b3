"""Bellman equations: backups, optimality, exact solution of small systems (chapter 2)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from rlcore.core.chains import chain, reaches, require_end_of, solve_system
from rlcore.core.checks import as_floats, check_nonnegative
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
    """q(s, a) = E[R + gamma V(S')], (S, A); -inf where a is not in A(s). eq-15, one-step lookahead alg-greedy-lookahead

    V: (S,) or a number. Terminal states count as 0 whatever V says. With V = v_pi this is q_pi, with v_* it is q_*.
    """
    Q = (mdp.prob * (mdp.reward + gamma * V[mdp.next_state])).sum(axis=2)  # eq-15
    return np.where(mdp.legal, Q, -np.inf)


@checked(Q=table, pi=_weights)
def v_from_q(Q: ArrayLike, pi: ArrayLike) -> Floats:
    """v(s) = sum over a of pi(a|s) q(s, a), (S,). fig-3

    Q, pi: (S, A). An action of probability 0 counts 0 even where Q is -inf.
    """
    return (pi * np.where(pi > 0, Q, 0.0)).sum(axis=1)


@checked
def expectation_backup(mdp: FiniteMDP, pi: ArrayLike, V: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman equation for v_pi, (S,). eq-12, om-bellman-derivation, alg-bellman-operators

    V is v_pi exactly where this gives V back.
    """
    return v_from_q(q_from_v(mdp, V, gamma), pi)  # eq-12


@checked
def expectation_backup_q(mdp: FiniteMDP, pi: ArrayLike, Q: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman equation for q_pi, (S, A). om-bellman-q, fig-4"""
    return q_from_v(mdp, np.where(mdp.terminal, 0.0, v_from_q(Q, pi)), gamma)


def optimality_backup(mdp: FiniteMDP, V: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman optimality equation for v_*, (S,). eq-16"""
    return q_from_v(mdp, V, gamma).max(axis=1)  # eq-16


@checked
def optimality_backup_q(mdp: FiniteMDP, Q: ArrayLike, gamma: float) -> Floats:
    """Right-hand side of the Bellman optimality equation for q_*, (S, A). eq-17 corrected"""
    return q_from_v(mdp, Q.max(axis=1), gamma)  # eq-17


@checked(Q=table)
def greedy(Q: ArrayLike) -> Floats:
    """The policy (S, A) that takes the first maximising action of each row. alg-greedy-lookahead"""
    return np.eye(Q.shape[1])[Q.argmax(axis=1)]


@checked(Q=table, tol=check_nonnegative)
def greedy_actions(Q: ArrayLike, tol: float = 1e-9) -> Flags:
    """Every maximising action: (S, A) bool, Q(s, a) >= max - tol * (1 + |max|). cl-013"""
    best = Q.max(axis=1, keepdims=True)
    return best - tol * (1 + np.abs(best)) <= Q


@checked
def policy_matrix(mdp: FiniteMDP, pi: ArrayLike) -> tuple[Any, Floats]:
    """P_pi (S, S) as a scipy sparse array, and r_pi (S,): the Markov reward process of pi. eq-u-model-and-policy"""
    return chain(mdp, pi)


@checked
def is_proper(mdp: FiniteMDP, pi: ArrayLike) -> bool:
    """Whether pi reaches a terminal state with probability 1 from every state."""
    return bool(reaches(chain(mdp, pi)[0], mdp.terminal).all())


@checked
def solve_policy(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> Floats:
    """v_pi (S,), the solution of the linear system (12). eq-12, alg-bellman-operators

    Raises ValueError at gamma = 1 where pi may never reach a terminal state (an improper policy): there the system is
    singular. Source: Puterman (1994), theorem 6.1.1.
    """
    P, r = chain(mdp, pi)
    return solve_system(P, r, gamma, mdp.terminal)


@checked
def expected_visits(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> Floats:
    """Expected discounted number of visits to each state from the start distribution, (S,); 0 at terminal states.

    The solution of mu = start + gamma P_pi^T mu, which weights the states in the policy gradient. eq-u-pg-theorem
    Raises ValueError as `solve_policy` does. Source: Puterman (1994), section 6.9.
    """
    P, go = chain(mdp, pi)[0], ~mdp.terminal
    require_end_of(P, gamma, mdp.terminal)
    P, visits = P.toarray()[go][:, go], np.zeros(mdp.n_states)
    visits[go] = np.linalg.solve(np.eye(len(P)) - gamma * P.T, mdp.start[go])
    return visits


@checked
def deterministic_policies(mdp: FiniteMDP) -> Iterator[Floats]:
    """Every deterministic policy (S, A), for processes so small that they can be listed. eq-13, eq-14"""
    allowed = [np.flatnonzero(row)[: 1 if end else None] for row, end in zip(mdp.legal, mdp.terminal)]
    return (deterministic_policy(mdp, np.array(actions)) for actions in itertools.product(*allowed))


@checked
def newton_optimality(mdp: FiniteMDP, gamma: float, n_iter: int, *, V0: ArrayLike = 0.0) -> Floats:
    """Newton's method on V - (optimality backup of V) = 0; history (n_iter + 1, S). alg-nonlinear-system, eq-16

    The system is piecewise linear; its derivative at V is I - gamma P_pi with pi greedy for V, so that a Newton step is
    a step of policy iteration. Source: Puterman and Brumelle (1979).
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
    """Values (A,) of the actions of state s after an expectimax search of `depth` steps with V0 at the leaves.

    -inf where a is not in A(s). The error is at most gamma^depth times that of V0. alg-heuristic-search
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
    """A number that max |V - v_pi| does not exceed, rounding included; (residual + rounding) times the horizon.

    The horizon is 1 / (1 - gamma), or at gamma = 1 the largest expected number of steps to a terminal state under pi.
    V: (S,). Source: Puterman (1994), theorem 6.3.1; Bertsekas (2012), section 3.2.
    """
    residual = np.abs(expectation_backup(mdp, pi, V, gamma) - V)[~mdp.terminal].max() + _rounding(mdp, V)
    if gamma < 1:
        return float(residual / (1 - gamma))
    P, _ = chain(mdp, pi)
    steps = solve_system(P, (~mdp.terminal).astype(float), 1.0, mdp.terminal)
    return float(residual * steps.max() * (1 + 1e-6))


@checked
def error_bound(mdp: FiniteMDP, V: ArrayLike, gamma: float) -> float:
    """A number that max |V - v_*| does not exceed, rounding included; inf where nothing can be certified.

    gamma < 1: (residual + rounding) / (1 - gamma). gamma = 1 with a cost on every step: v_* lies between the value of
    the greedy policy and V plus the residual times the number of steps that an optimal policy can afford.
    V: (S,). Source: Puterman (1994), theorem 6.3.1; Bertsekas and Tsitsiklis (1991).
    """
    change, rounding = (optimality_backup(mdp, V, gamma) - V)[~mdp.terminal], _rounding(mdp, V)
    if gamma < 1:
        return float((np.abs(change).max() + rounding) / (1 - gamma))
    cost = -np.where(mdp.legal, mdp.expected_reward(), -np.inf)[~mdp.terminal].max()
    if cost <= 0:
        return np.inf
    P, r = chain(mdp, greedy(q_from_v(mdp, V, gamma)))
    if not reaches(P, mdp.terminal).all():
        return np.inf
    lower = solve_system(P, r, 1.0, mdp.terminal)
    most_steps = -lower.min() / cost * (1 + 1e-6)
    above = (max(change.max(), 0.0) + rounding) * most_steps
    return float(max(np.max(V - lower), above) + rounding * most_steps)


def _rounding(mdp, V):
    """How far a computed backup of V may lie from the exact one."""
    return (mdp.prob.shape[2] + 4) * np.finfo(float).eps * (np.abs(mdp.reward).max() + np.abs(V).max())
