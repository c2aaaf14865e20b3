"""Dynamic programming: planning with a known model (chapter 3)."""

from __future__ import annotations

import numpy as np

from rlcore.bellman import error_bound, greedy, greedy_actions, policy_error_bound, q_from_v, solve_policy
from rlcore.core.chains import chain, reaches
from rlcore.core.checks import check_policy
from rlcore.core.compiled import compiled
from rlcore.core.endings import grow, prefer_ends, settled
from rlcore.core.results import Solution
from rlcore.core.rules import checked
from rlcore.core.running import interruptible, marks
from rlcore.core.types import ArrayLike, Flags, Floats, Ints
from rlcore.mdp import FiniteMDP, uniform_policy


@checked
@interruptible
def policy_evaluation(
    mdp: FiniteMDP, pi: ArrayLike, gamma: float, *, tol: float = 1e-8, V0: ArrayLike = 0.0, in_place: bool = False,
    max_iter: int = 100_000, record: int = 0,
) -> Solution:  # fmt: skip
    """The values v_pi by sweeps of the Bellman equation (12).

    Stops when no value changes by tol or more in a sweep.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    tol : float
        Stops when no value changes by it or more, above 0.
    V0 : ArrayLike
        First estimate, a number or (S,).
    in_place : bool
        A sweep uses the values that it has just computed (one array, states in order) instead of those of the sweep
        before (two arrays).
    max_iter : int
        Most sweeps or iterations.
    record : int
        history keeps V before the first and after each record-th sweep; 0 keeps none.

    Returns
    -------
    Solution
        V is v_pi up to `bound`; pi is the policy that came.

    Raises
    ------
    ValueError
        At gamma = 1 where pi is improper.

    Notes
    -----
    Ledger: om-policy-evaluation, alg-policy-evaluation.

    References
    ----------
    Sutton and Barto (2018), section 4.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import policy_evaluation
    >>> from rlcore.envs.small import random_walk
    >>> policy_evaluation(random_walk(3), np.ones((5, 1)), 1.0).V.round(6)
    array([0.  , 0.25, 0.5 , 0.75, 0.  ])
    """
    _require_end(mdp, pi, gamma, "pi: never terminates")
    V, n, delta, history = V0, 0, np.inf, [V0]
    while delta >= tol and n < max_iter:
        V_new = V.copy()
        delta = evaluation_sweep(*_model(mdp), pi, gamma, V_new if in_place else V, V_new)
        V, n = V_new, n + 1
        if _keep(history, V, n, record):
            break
    bound = policy_error_bound(mdp, pi, V, gamma)
    return Solution(V, q_from_v(mdp, V, gamma), pi, n, bool(delta < tol), bound, _kept(history, record))


def _keep(history, V, n, record):
    """Keep the n-th V where it is one of those that are kept. True where Ctrl-C came."""
    if record and n % record == 0:
        history.append(V)
    return marks()[0] != 0


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
    """The policy that is greedy for V; a row of pi that is greedy already is kept.

    Keeping it is what lets policy iteration stop: where two actions are equally good, rounding would otherwise swap
    them for ever.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    V : ArrayLike
        (S,) or a number; terminal states count as 0 whatever it says.
    gamma : float
        Discount, in [0, 1].
    pi : ArrayLike | None
        (S, A), the policy so far, or None.

    Returns
    -------
    Floats
        (S, A).

    Notes
    -----
    Ledger: om-policy-improvement, alg-policy-improvement.

    References
    ----------
    Sutton and Barto (2018), section 4.2 and exercise 4.4.

    Examples
    --------
    >>> from rlcore import policy_improvement
    >>> from rlcore.envs.small import zero_loop
    >>> policy_improvement(zero_loop(), [0.0, 0.0], 0.9)
    array([[0., 1.],
           [1., 0.]])
    """
    Q = q_from_v(mdp, V, gamma)
    pi_new = greedy(Q)
    if pi is None:
        return pi_new
    best = Q.max(axis=1)
    keep = np.where(pi > 0, Q, np.inf).min(axis=1) >= best - 1e-10 * (1 + np.abs(best))
    return np.where(keep[:, None], pi, pi_new)


@checked(pi0=lambda name, pi, given: check_policy(given["mdp"], pi, name))
@interruptible
def policy_iteration(
    mdp: FiniteMDP, gamma: float, *, pi0: ArrayLike | None = None, max_iter: int = 1000, record: int = 0
) -> Solution:
    """Optimal values and policy: evaluate exactly, improve, until the policy stays.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    gamma : float
        Discount, in [0, 1].
    pi0 : ArrayLike | None
        The first policy, uniform where None.
    max_iter : int
        Most sweeps or iterations.
    record : int
        history keeps 0 and the value found in each record-th iteration; 0 keeps none.

    Returns
    -------
    Solution
        n_iter counts evaluations, the one that finds nothing to improve included.

    Raises
    ------
    ValueError
        At gamma = 1 where a policy that comes up is improper.

    Notes
    -----
    Ledger: alg-policy-iteration, cl-038.

    References
    ----------
    Howard (1960).

    Examples
    --------
    >>> from rlcore import policy_iteration
    >>> from rlcore.envs.small import zero_loop
    >>> found = policy_iteration(zero_loop(), 0.9)
    >>> found.V, found.n_iter
    (array([1., 0.]), 2)
    """
    pi = uniform_policy(mdp) if pi0 is None else pi0
    n, stable, history = 0, False, [np.zeros(mdp.n_states)]
    while not stable and n < max_iter:
        if gamma == 1 and n > 0:
            grow(mdp, pi)
        V = solve_policy(mdp, pi, gamma)
        pi_new = policy_improvement(mdp, V, gamma, pi=pi)
        stable = np.array_equal(pi_new, pi)
        pi, n = pi_new, n + 1
        if _keep(history, V, n, record):
            break
    Q, bound = q_from_v(mdp, V, gamma), error_bound(mdp, V, gamma)
    if gamma == 1 and stable:
        settled(mdp, V, greedy(Q), greedy_actions(Q), 1e-9 * (1 + np.abs(V).max()))
    return Solution(V, Q, pi, n, stable, bound, _kept(history, record))


@checked
@interruptible
def value_iteration(
    mdp: FiniteMDP, gamma: float, *, tol: float = 1e-8, V0: ArrayLike = 0.0, in_place: bool = False,
    max_iter: int = 100_000, record: int = 0,
) -> Solution:  # fmt: skip
    """The optimal values v_* by sweeps of the Bellman optimality equation (16).

    Stops when no value changes by tol or more in a sweep.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    gamma : float
        Discount, in [0, 1].
    tol : float
        Stops when no value changes by it or more, above 0.
    V0 : ArrayLike
        First estimate, a number or (S,).
    in_place : bool
        A sweep uses the values that it has just computed instead of those of the sweep before.
    max_iter : int
        Most sweeps or iterations.
    record : int
        history keeps V before the first and after each record-th sweep; 0 keeps none.

    Returns
    -------
    Solution
        The policy is greedy for V.

    Raises
    ------
    ValueError
        At gamma = 1 where no policy can end from some state.

    Notes
    -----
    Ledger: eq-u-value-iteration, fig-13, alg-value-iteration.

    References
    ----------
    Bellman (1957); Puterman (1994), section 6.3.

    Examples
    --------
    >>> from rlcore import value_iteration
    >>> from rlcore.envs.grids import gridworld
    >>> value_iteration(gridworld(3, 3, terminals=[0]), 1.0).V.reshape(3, 3)
    array([[ 0., -1., -2.],
           [-1., -2., -3.],
           [-2., -3., -4.]])
    """
    _require_end(mdp, uniform_policy(mdp), gamma, "gamma: got 1, but no policy terminates")
    V, n, delta, history = V0, 0, np.inf, [V0]
    while delta >= tol and n < max_iter:
        V_new = V.copy()
        delta = optimality_sweep(*_model(mdp), mdp.legal, gamma, V_new if in_place else V, V_new)
        V, n = V_new, n + 1
        if _keep(history, V, n, record):
            break
    Q, bound = q_from_v(mdp, V, gamma), error_bound(mdp, V, gamma)
    pi = greedy(Q)
    if gamma == 1:
        near = 1e-9 + 2 * delta / (1 + np.abs(V).max())
        pi = (
            settled(mdp, V, pi, greedy_actions(Q, near), near)
            if delta < tol
            else prefer_ends(mdp, pi, greedy_actions(Q))
        )
        if not marks()[0]:
            grow(mdp, pi)
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
