"""Policies in a table: epsilon-greedy, and softmax in features (chapters 4 and 7)."""

from __future__ import annotations

from collections.abc import Callable
from math import exp
from typing import Any

import numpy as np

from rlcore.bellman import greedy_actions, table
from rlcore.core.checks import as_flags, as_floats, check_probability, is_number, show, spaces
from rlcore.core.compiled import compiled, part
from rlcore.core.results import Run
from rlcore.core.rules import checked, takes_none
from rlcore.core.samples import check_labels
from rlcore.core.schedules import Schedule, constant, now
from rlcore.core.types import ArrayLike, Flags, Floats, Given, Ints, Rng
from rlcore.core.worlds import open_world, tabular_world
from rlcore.neurons import softmax


@part
def epsilon_greedy(Q: Floats, s: int, epsilon: float, rng: Rng) -> int:
    """A legal action at random with probability epsilon, else a maximising one; ties at random.

    For loops that are compiled: arguments are not checked.

    Parameters
    ----------
    Q : Floats
        (S, A), -inf where an action is not legal.
    s : int
        The state.
    epsilon : float
        In [0, 1].
    rng : Rng
        Source of all that is random.

    Returns
    -------
    int
        The action.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import epsilon_greedy
    >>> int(epsilon_greedy(np.array([[0.0, 1.0]]), 0, 0.0, np.random.default_rng(0)))
    1
    """
    lowest, n = -np.inf, 0
    for a in range(Q.shape[1]):  # maximum and ties in one pass: 1.6 times the speed where there is no numba
        q = Q[s, a]
        if q > lowest:
            lowest, n = q, 1
        elif q == lowest:
            n += 1
    if rng.random() < epsilon:
        lowest, n = -1.7976931348623157e308, 0
        for a in range(Q.shape[1]):
            if Q[s, a] >= lowest:
                n += 1
    pick = int(rng.random() * n)
    for a in range(Q.shape[1]):
        if Q[s, a] >= lowest:
            if pick == 0:
                return a
            pick -= 1
    return -1


@compiled
def max_value(Q: Floats, s: int) -> float:
    """max over a of Q(s, a)."""
    best = Q[s, 0]
    for a in range(1, Q.shape[1]):
        best = max(best, Q[s, a])
    return best


@compiled
def expected_value(Q: Floats, s: int, epsilon: float) -> float:
    """Mean of Q(s, .) under the epsilon-greedy policy of Q; -inf marks actions that are not legal."""
    total, n = 0.0, 0
    for a in range(Q.shape[1]):
        if Q[s, a] > -np.inf:
            total += Q[s, a]
            n += 1
    return (1 - epsilon) * max_value(Q, s) + epsilon * (total / n)


def _acting(name, Q, given):
    """The rule of a Q to act on: a legal action in every state, none worth infinity."""
    Q = table(name, Q, given)
    best = Q.max(axis=1)
    if not np.isfinite(best).all():
        raise ValueError(f"{name}: row {np.flatnonzero(~np.isfinite(best))[0]} has no maximum, must have a finite one")
    return Q


@checked(Q=_acting, epsilon=check_probability)
def soft_greedy(Q: ArrayLike, epsilon: float) -> Floats:
    """The epsilon-greedy policy of Q: ties share the greedy part.

    Parameters
    ----------
    Q : ArrayLike
        (S, A), -inf where a is not in A(s).
    epsilon : float
        In [0, 1].

    Returns
    -------
    Floats
        (S, A).

    Examples
    --------
    >>> from rlcore import soft_greedy
    >>> soft_greedy([[0.0, 1.0], [2.0, 2.0]], 0.1)
    array([[0.05, 0.95],
           [0.5 , 0.5 ]])
    """
    best, legal = greedy_actions(Q), np.isfinite(Q)
    share = [x / x.sum(axis=1, keepdims=True) for x in (best, legal)]
    return (1 - epsilon) * share[0] + epsilon * share[1]


def control(
    given: Given, Q: Floats, returns: Floats, lengths: Ints, history: Floats, visits: Ints | None = None,
    kind: Callable[..., Run] = Run, **more: Any,
) -> Run:  # fmt: skip
    """The Run of a loop that learned Q: V its maximum, the policy epsilon-greedy in the last Q."""
    epsilon = float(now(given["epsilon"], int(np.count_nonzero(lengths)), lengths.sum()))
    history = history if given["record"] else None
    policy = soft_greedy(Q, epsilon)
    return kind(returns, lengths, V=Q.max(axis=1), Q=Q, policy=policy, history=history, visits=visits, **more)


# ---------------------------------------------------------------------- the policy


def _parameters(name, theta, given):
    return check_parameters(name, theta)


@takes_none
def _features(name, x, given):
    d = given["theta"].shape[1]
    return np.eye(d) if x is None else check_features(name, x, None, d)


@takes_none
def _legal(name, legal, given):
    shape = len(given["x"]), len(given["theta"])
    legal = np.ones(shape, bool) if legal is None else as_flags(name, legal)
    if legal.shape != shape or not legal.any(axis=1).all():
        raise ValueError(f"{name}: got shape {legal.shape}, must be {shape}, an action in every state")
    return legal


@checked(theta=_parameters, x=_features, legal=_legal, p_min=lambda name, p, given: check_p_min(p, len(given["theta"])))
def softmax_policy(
    theta: ArrayLike, x: ArrayLike | None = None, legal: ArrayLike | None = None, *, p_min: float = 0.0
) -> Floats:
    """The softmax policy: pi(a|s) proportional to exp(h(s, a)), h(s, a) = theta[a] . x(s).

    Parameters
    ----------
    theta : ArrayLike
        (A, d).
    x : ArrayLike | None
        (S, d) features, rows that are equal where states look alike; None where there is one feature a state, theta[a,
        s] = h(s, a).
    legal : ArrayLike | None
        (S, A); all where None.
    p_min : float
        Below it no legal action's probability falls; the others share the rest.

    Returns
    -------
    Floats
        (S, A).

    Notes
    -----
    Ledger: om-softmax, alg-softmax-policy.

    References
    ----------
    Sutton and Barto (2018), (13.2), (13.3).

    Examples
    --------
    >>> from rlcore import softmax_policy
    >>> softmax_policy([[0.0], [1.0]], [[0.0], [1.0]]).round(3)
    array([[0.5  , 0.5  ],
           [0.269, 0.731]])
    """
    return np.array([probabilities(np.zeros(len(theta)), theta, row, ok, p_min) for row, ok in zip(x, legal)])


def _one_state(name, x, given):
    x = check_features(name, np.atleast_1d(as_floats(name, x))[None], None, given["theta"].shape[1])
    return x[0]


def _action(name, a, given):
    return int(check_labels(name, a, len(given["theta"]), ()))


@checked(theta=_parameters, x=_one_state, a=_action)
def grad_log_softmax(theta: ArrayLike, x: ArrayLike, a: int) -> Floats:
    """The score, gradient of ln pi(a|x) with respect to theta.

    Parameters
    ----------
    theta : ArrayLike
        (A, d).
    x : ArrayLike
        (d,) features of one state.
    a : int
        The action.

    Returns
    -------
    Floats
        (A, d).

    Notes
    -----
    Ledger: om-score, alg-softmax-policy.

    Examples
    --------
    >>> from rlcore import grad_log_softmax
    >>> grad_log_softmax([[0.0], [0.0]], [1.0], 0)
    array([[ 0.5],
           [-0.5]])
    """
    return np.outer(np.eye(len(theta))[a] - softmax.unchecked(theta @ x), x)  # om-score


@compiled
def probabilities(pi: Floats, theta: Floats, x: Floats, legal: Flags, p_min: float) -> Floats:
    """pi (A,), filled with the softmax of theta x over the legal actions.

    One number at a time, beside neurons.softmax: 3 times as fast as arrays in compiled loops, and the same bits without
    numba, whose exp of an array differs from numpy's.
    """
    top, total = -np.inf, 0.0
    for a in range(pi.size):
        pi[a] = -np.inf
        if legal[a]:
            pi[a] = 0.0
            for i in range(x.size):
                pi[a] += theta[a, i] * x[i]
            top = max(top, pi[a])
    for a in range(pi.size):
        pi[a] = exp(pi[a] - top)
        total += pi[a]
    for a in range(pi.size):
        pi[a] /= total  # om-softmax
    n_low, before, scale = 0, -1, 1.0
    while n_low > before:  # what is scaled down may fall below the floor in its turn
        before, n_low, rest = n_low, 0, 0.0
        for a in range(pi.size):
            if legal[a] and pi[a] * scale < p_min:
                n_low += 1
            else:
                rest += pi[a]
        if n_low > 0 and rest > 0.0:
            scale = (1.0 - n_low * p_min) / rest
    for a in range(pi.size):
        if legal[a]:
            pi[a] = max(pi[a] * scale, p_min)
    return pi


@compiled
def choose(pi: Floats, rng: Rng) -> int:
    u, last = rng.random(), 0
    for a in range(pi.size):
        if pi[a] > 0.0:
            last = a
            u -= pi[a]
            if u < 0.0:
                break
    return last


@compiled
def add_score(g: Floats, scale: float, pi: Floats, x: Floats, a: int) -> None:
    """g += scale * grad ln pi(a|s). om-score"""
    for b in range(pi.size):
        for i in range(x.size):
            g[b, i] += scale * ((1.0 if b == a else 0.0) - pi[b]) * x[i]  # om-score


@compiled
def dot(w: Floats, x: Floats) -> float:
    total = 0.0
    for i in range(x.size):
        total += w[i] * x[i]
    return total


# ---------------------------------------------------------------------- checks


def check_features(name: str, x: Any, n_states: int | None, d: int | None = None) -> Floats:
    """x as (S, d) floats; one feature a state where None."""
    if x is None:
        return np.eye(n_states)
    x = np.ascontiguousarray(as_floats(name, x))
    if x.ndim != 2 or x.size == 0 or len(x) != (n_states or len(x)) or x.shape[1] != (d or x.shape[1]):
        expected = (n_states or "S", d or "d")
        raise ValueError(f"{name}: got shape {x.shape}, must be ({expected[0]}, {expected[1]})")
    if not np.isfinite(x).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return x


def check_parameters(name: str, values: Any, shape: tuple[int, ...] | None = None) -> Floats:
    """values as a new float array, a number broadcast to shape; (A, d) where shape is None."""
    values = as_floats(name, values)
    if shape is not None and values.ndim == 0:
        values = np.full(shape, values)
    if values.shape != (shape or values.shape) or values.ndim != len(shape or "Ad") or values.size == 0:
        raise ValueError(f"{name}: got shape {values.shape}, must be {shape or '(A, d)'}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return np.array(values)


def check_p_min(p_min: Any, A: int) -> float:
    """p_min as a float; ValueError unless all A actions can have it."""
    if not is_number(p_min) or not 0 <= p_min < 1 / A:
        raise ValueError(f"p_min: got {show(p_min)}, must be in [0, 1 / {A})")
    return float(p_min)


@takes_none
def linear(name: str, x: Any, given: Given) -> tuple[Floats, Flags]:
    """The rule of features (S, d), one a state where None, and with them of theta (A, d): (features, legal)."""
    legal = given["mdp"].legal if "mdp" in given else spaces(given["world"])[0]
    x = check_features(name, x, len(legal))
    if "theta" in given:
        given["theta"] = check_parameters("theta", given["theta"], (legal.shape[1], x.shape[1]))
    return x, legal


def _linear_world(name, world, given):
    world = open_world(name, world)
    observations = getattr(world, "observation_space", None)
    if observations is not None and not hasattr(observations, "n"):
        networks = "reinforce_network and actor_critic_network take vectors"
        raise ValueError(f"{name}: got observations {observations}, must be Discrete; {networks}")
    return tabular_world(name, world, given)


def _step_size(least):
    def rule(name, alpha, given):
        if isinstance(alpha, Schedule):
            return alpha
        if not is_number(alpha) or not (alpha > 0 or alpha == least) or not alpha < np.inf:
            allowed = "of at least 0" if least == 0 else "above 0"
            raise ValueError(f"{name}: got {show(alpha)}, must be a number {allowed}, or decaying(...)")
        return constant(alpha)

    return rule


LINEAR = dict(  # the rules of a policy that is a softmax of theta . x(s), and of a v_hat that is w . x(s)
    world=_linear_world,
    alpha=_step_size(None),
    alpha_w=_step_size(0),
    features=linear,
    theta0=lambda name, theta, given: check_parameters(
        name, theta, (given["features"][1].shape[1], given["features"][0].shape[1])
    ),
    w0=lambda name, w, given: check_parameters(name, w, given["features"][0].shape[1:]),
    p_min=lambda name, p_min, given: check_p_min(p_min, given["features"][1].shape[1]),
)


def gradient(given: Given, theta: Floats, w: Floats, returns: Floats, lengths: Ints, history: Floats) -> Run:
    """The Run of a loop that learned theta, and w where there is a v_hat."""
    if not (np.isfinite(theta).all() and np.isfinite(w).all()):
        steps = ", ".join(f"{name} {given[name].first}" for name in ("alpha", "alpha_w"))
        raise ValueError(f"alpha, alpha_w: got {steps}, must be smaller: theta or w is beyond all numbers")
    (X, legal), history = given["features"], history if given["record"] else None
    V = np.where(spaces(given["world"])[1], 0.0, X @ w)
    if "baseline" in given and not given["baseline"].learned:
        V = None
    policy = softmax_policy(theta, X, legal, p_min=given["p_min"])
    return Run(returns, lengths, V=V, policy=policy, history=history, weights=theta)
