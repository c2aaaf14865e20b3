"""Dynamic programming: planning with a known model (chapter 3)."""

import numpy as np

from rlcore.bellman import error_bound, greedy, policy_error_bound, policy_matrix, q_from_v, reaches, solve_policy
from rlcore.core.checks import check_count, check_gamma, check_policy, check_tol, finite_values
from rlcore.core.compiled import compiled
from rlcore.core.results import Solution
from rlcore.mdp import uniform_policy


def policy_evaluation(mdp, pi, gamma, *, tol=1e-8, V0=0.0, in_place=False, max_iter=100_000):
    """v_pi by sweeps of the Bellman equation (12). om-policy-evaluation, alg-policy-evaluation

    Stops when no value changes by tol or more in a sweep. in_place: a sweep uses the values that it has just computed
    (one array, states in order) instead of those of the sweep before (two arrays). Returns a Solution; history has one
    row a sweep. Raises ValueError at gamma = 1 where pi is improper.
    Source: Sutton and Barto (2018), section 4.1.
    """
    pi, gamma = check_policy(mdp, pi), check_gamma(gamma)
    tol, max_iter = check_tol(tol), check_count("max_iter", max_iter)
    _require_end(mdp, pi, gamma, "pi: never terminates")
    V = finite_values(mdp, V0, "V0")
    history, delta = [V], np.inf
    while delta >= tol and len(history) <= max_iter:
        V_new = V.copy()
        delta = _evaluation_sweep(*_model(mdp), pi, gamma, V_new if in_place else V, V_new)
        V = V_new
        history.append(V)
    bound = policy_error_bound(mdp, pi, V, gamma)
    return Solution(V, q_from_v(mdp, V, gamma), pi, len(history) - 1, bool(delta < tol), bound, np.array(history))


@compiled
def _evaluation_sweep(next_state, prob, reward, terminal, pi, gamma, V, V_new):
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


def policy_improvement(mdp, V, gamma, *, pi=None):
    """The policy (S, A) that is greedy for V; a row of pi that is greedy already is kept. om-policy-improvement

    Keeping it is what lets policy iteration stop: where two actions are equally good, rounding would otherwise swap
    them for ever. alg-policy-improvement. Source: Sutton and Barto (2018), section 4.2 and exercise 4.4.
    """
    Q = q_from_v(mdp, V, gamma)
    pi_new = greedy(Q)
    if pi is None:
        return pi_new
    pi = check_policy(mdp, pi)
    best = Q.max(axis=1)
    keep = np.where(pi > 0, Q, np.inf).min(axis=1) >= best - 1e-10 * (1 + np.abs(best))
    return np.where(keep[:, None], pi, pi_new)


def policy_iteration(mdp, gamma, *, pi0=None, max_iter=1000):
    """Optimal values and policy: evaluate exactly, improve, until the policy stays. alg-policy-iteration, cl-038

    pi0: the first policy, uniform where None. Returns a Solution; n_iter counts evaluations, the one that finds nothing
    to improve included, and history[k] is the value found in iteration k (history[0] = 0).
    Raises ValueError at gamma = 1 where a policy that comes up is improper. Source: Howard (1960).
    """
    gamma, max_iter = check_gamma(gamma), check_count("max_iter", max_iter)
    pi = uniform_policy(mdp) if pi0 is None else check_policy(mdp, pi0)
    history, stable = [np.zeros(mdp.n_states)], False
    while not stable and len(history) <= max_iter:
        V = solve_policy(mdp, pi, gamma)
        pi_new = policy_improvement(mdp, V, gamma, pi=pi)
        stable = np.array_equal(pi_new, pi)
        pi = pi_new
        history.append(V)
    return Solution(
        V, q_from_v(mdp, V, gamma), pi, len(history) - 1, stable, error_bound(mdp, V, gamma), np.array(history)
    )


def value_iteration(mdp, gamma, *, tol=1e-8, V0=0.0, in_place=False, max_iter=100_000):
    """v_* by sweeps of the Bellman optimality equation (16). eq-u-value-iteration, fig-13, alg-value-iteration

    Stops when no value changes by tol or more in a sweep; in_place as in policy_evaluation. Returns a Solution whose
    policy is greedy for V; history has one row a sweep. Raises ValueError at gamma = 1 where no policy can end from
    some state. Source: Bellman (1957); Puterman (1994), section 6.3.
    """
    gamma, tol, max_iter = check_gamma(gamma), check_tol(tol), check_count("max_iter", max_iter)
    _require_end(mdp, uniform_policy(mdp), gamma, "gamma: got 1, but no policy terminates")
    V = finite_values(mdp, V0, "V0")
    history, delta = [V], np.inf
    while delta >= tol and len(history) <= max_iter:
        V_new = V.copy()
        delta = _optimality_sweep(*_model(mdp), mdp.legal, gamma, V_new if in_place else V, V_new)
        V = V_new
        history.append(V)
    Q = q_from_v(mdp, V, gamma)
    bound = error_bound(mdp, V, gamma)
    return Solution(V, Q, greedy(Q), len(history) - 1, bool(delta < tol), bound, np.array(history))


@compiled
def _optimality_sweep(next_state, prob, reward, terminal, legal, gamma, V, V_new):
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
        ends = reaches(policy_matrix(mdp, pi)[0], mdp.terminal)
        if not ends.all():
            s = np.flatnonzero(~ends)[0]
            raise ValueError(f"{fault} from state {s}, must reach a terminal state when gamma = 1")
