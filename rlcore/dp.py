"""Dynamic programming: planning with a known model (chapter 3)."""

from __future__ import annotations

import numpy as np

from rlcore.bellman import error_bound, greedy, policy_error_bound, q_from_v, solve_policy
from rlcore.core.chains import chain, reaches
from rlcore.core.checks import check_policy
from rlcore.core.compiled import compiled
from rlcore.core.results import Solution
from rlcore.core.rules import checked
from rlcore.core.types import ArrayLike, Flags, Floats, Ints
from rlcore.mdp import FiniteMDP, uniform_policy


@checked
def policy_evaluation(
    mdp: FiniteMDP, pi: ArrayLike, gamma: float, *, tol: float = 1e-8, V0: ArrayLike = 0.0, in_place: bool = False,
    max_iter: int = 100_000, record: int = 0,
) -> Solution:  # fmt: skip
    """v_pi by sweeps of the Bellman equation (12). om-policy-evaluation, alg-policy-evaluation

    Stops when no value changes by tol or more in a sweep. in_place: a sweep uses the values that it has just computed
    (one array, states in order) instead of those of the sweep before (two arrays). record: history keeps V before the
    first and after each record-th sweep; 0 keeps none. Returns a Solution. Raises ValueError at gamma = 1 where pi is
    improper. Source: Sutton and Barto (2018), section 4.1.
    """
    _require_end(mdp, pi, gamma, "pi: never terminates")
    V, n, delta, history = V0, 0, np.inf, [V0]
    while delta >= tol and n < max_iter:
        V_new = V.copy()
        delta = evaluation_sweep(*_model(mdp), pi, gamma, V_new if in_place else V, V_new)
        V, n = V_new, n + 1
        _keep(history, V, n, record)
    bound = policy_error_bound(mdp, pi, V, gamma)
    return Solution(V, q_from_v(mdp, V, gamma), pi, n, bool(delta < tol), bound, _kept(history, record))


def _keep(history, V, n, record):
    if record and n % record == 0:
        history.append(V)


def _kept(history, record):
    return np.array(history) if record else None


@compiled
def evaluation_sweep(
    next_state: Ints, prob: Floats, reward: Floats, terminal: Flags, pi: Floats, gamma: float, V: Floats, V_new: Floats
) -> float:
    """One sweep; in place where V_new is V. Returns the largest change."""
    delta = 0.0
    for s in range(V.size):
        if terminal[s]:
            continue
        v = 0.0
        for a in range(pi.shape[1]):
            for k in range(prob.shape[2]):
                if pi[s, a] * prob[s, a, k] > 0:
                    v += pi[s, a] * prob[s, a, k] * (reward[s, a, k] + gamma * V[next_state[s, a, k]])  # eq-12
        delta = max(delta, abs(v - V[s]))
        V_new[s] = v
    return delta


@checked
def policy_improvement(mdp: FiniteMDP, V: ArrayLike, gamma: float, *, pi: ArrayLike | None = None) -> Floats:
    """The policy (S, A) that is greedy for V; a row of pi that is greedy already is kept. om-policy-improvement

    Keeping it is what lets policy iteration stop: where two actions are equally good, rounding would otherwise swap
    them for ever. alg-policy-improvement. Source: Sutton and Barto (2018), section 4.2 and exercise 4.4.
    """
    Q = q_from_v(mdp, V, gamma)
    pi_new = greedy(Q)
    if pi is None:
        return pi_new
    best = Q.max(axis=1)
    keep = np.where(pi > 0, Q, np.inf).min(axis=1) >= best - 1e-10 * (1 + np.abs(best))
    return np.where(keep[:, None], pi, pi_new)


@checked(pi0=lambda name, pi, given: check_policy(given["mdp"], pi, name))
def policy_iteration(
    mdp: FiniteMDP, gamma: float, *, pi0: ArrayLike | None = None, max_iter: int = 1000, record: int = 0
) -> Solution:
    """Optimal values and policy: evaluate exactly, improve, until the policy stays. alg-policy-iteration, cl-038

    pi0: the first policy, uniform where None. record: history keeps 0 and the value found in each record-th iteration;
    0 keeps none. Returns a Solution; n_iter counts evaluations, the one that finds nothing to improve included.
    Raises ValueError at gamma = 1 where a policy that comes up is improper. Source: Howard (1960).
    """
    pi = uniform_policy(mdp) if pi0 is None else pi0
    n, stable, history = 0, False, [np.zeros(mdp.n_states)]
    while not stable and n < max_iter:
        V = solve_policy(mdp, pi, gamma)
        pi_new = policy_improvement(mdp, V, gamma, pi=pi)
        stable = np.array_equal(pi_new, pi)
        pi, n = pi_new, n + 1
        _keep(history, V, n, record)
    bound = error_bound(mdp, V, gamma)
    return Solution(V, q_from_v(mdp, V, gamma), pi, n, stable, bound, _kept(history, record))


@checked
def value_iteration(
    mdp: FiniteMDP, gamma: float, *, tol: float = 1e-8, V0: ArrayLike = 0.0, in_place: bool = False,
    max_iter: int = 100_000, record: int = 0,
) -> Solution:  # fmt: skip
    """v_* by sweeps of the Bellman optimality equation (16). eq-u-value-iteration, fig-13, alg-value-iteration

    Stops when no value changes by tol or more in a sweep; in_place and record as in policy_evaluation. Returns a
    Solution whose policy is greedy for V. Raises ValueError at gamma = 1 where no policy can end from some state.
    Source: Bellman (1957); Puterman (1994), section 6.3.
    """
    _require_end(mdp, uniform_policy(mdp), gamma, "gamma: got 1, but no policy terminates")
    V, n, delta, history = V0, 0, np.inf, [V0]
    while delta >= tol and n < max_iter:
        V_new = V.copy()
        delta = optimality_sweep(*_model(mdp), mdp.legal, gamma, V_new if in_place else V, V_new)
        V, n = V_new, n + 1
        _keep(history, V, n, record)
    Q, bound = q_from_v(mdp, V, gamma), error_bound(mdp, V, gamma)
    pi = greedy(Q)
    return Solution(V, Q, pi, n, bool(delta < tol), bound, _kept(history, record))


@compiled
def optimality_sweep(
    next_state: Ints, prob: Floats, reward: Floats, terminal: Flags, legal: Flags, gamma: float, V: Floats,
    V_new: Floats,
) -> float:  # fmt: skip
    """One sweep; in place where V_new is V. Returns the largest change."""
    delta = 0.0
    for s in range(V.size):
        if terminal[s]:
            continue
        best = -np.inf
        for a in range(legal.shape[1]):
            if legal[s, a]:
                q = 0.0
                for k in range(prob.shape[2]):
                    if prob[s, a, k] > 0:
                        q += prob[s, a, k] * (reward[s, a, k] + gamma * V[next_state[s, a, k]])  # eq-15
                best = max(best, q)  # eq-16
        delta = max(delta, abs(best - V[s]))
        V_new[s] = best
    return delta


def _model(mdp):
    return mdp.next_state, mdp.prob, mdp.reward, mdp.terminal


def _require_end(mdp, pi, gamma, fault):
    """ValueError at gamma = 1 unless pi reaches a terminal state from everywhere; uniform pi does where any does."""
    if gamma == 1:
        ends = reaches(chain(mdp, pi)[0], mdp.terminal)
        if not ends.all():
            s = np.flatnonzero(~ends)[0]
            raise ValueError(f"{fault} from state {s}, must reach a terminal state when gamma = 1")
