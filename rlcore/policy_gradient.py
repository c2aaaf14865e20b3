"""The softmax policy in features, the exact policy gradient, and its estimates from episodes (chapter 7)."""

from math import exp

import numpy as np

from rlcore.bellman import expected_visits, q_from_v, solve_policy
from rlcore.compiled import compiled
from rlcore.experience import act, check_max_steps, reset, run_loop, spaces
from rlcore.mdp import (
    as_floats,
    as_integers,
    check_count,
    check_gamma,
    check_mdp,
    check_rng,
    discounted_returns,
    is_number,
)
from rlcore.neurons import softmax

__all__ = [
    "episode_gradient",
    "grad_log_softmax",
    "gradient_ascent",
    "gradient_estimates",
    "objective",
    "policy_gradient_exact",
    "softmax",
    "softmax_policy",
]


# ---------------------------------------------------------------------- the policy


def softmax_policy(theta, x=None, legal=None, *, p_min=0.0):
    """pi(a|s) proportional to exp(h), h(s, a) = theta[a] . x(s), as (S, A). om-softmax, alg-softmax-policy

    theta: (A, d). x: (S, d) features, rows that are equal where states look alike; None where there is one feature a
    state, theta[a, s] = h(s, a). legal: (S, A) bool. p_min: below it no legal action's probability falls; the others
    share the rest. Source: Sutton and Barto (2018), (13.2), (13.3).
    """
    theta = _parameters("theta", theta)
    x = np.eye(theta.shape[1]) if x is None else _features(x, None, theta.shape[1])
    legal = np.ones((len(x), len(theta)), bool) if legal is None else np.asarray(legal, bool)
    p_min = _check_p_min(p_min, len(theta))
    if legal.shape != (len(x), len(theta)) or not legal.any(axis=1).all():
        raise ValueError(f"legal: got shape {legal.shape}, must be {(len(x), len(theta))}, an action in every state")
    return np.array([_probabilities(np.zeros(len(theta)), theta, row, ok, p_min) for row, ok in zip(x, legal)])


def grad_log_softmax(theta, x, a):
    """The score, gradient of ln pi(a|x) with respect to theta, (A, d). om-score, alg-softmax-policy

    x: (d,) features of one state.
    """
    theta = _parameters("theta", theta)
    x, a = _features([x], None, theta.shape[1])[0], _indices("a", a, len(theta))
    return np.outer(np.eye(len(theta))[a] - softmax(theta @ x), x)  # om-score


@compiled
def _probabilities(pi, theta, x, legal, p_min):
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
def _choose(pi, rng):
    u, last = rng.random(), 0
    for a in range(pi.size):
        if pi[a] > 0.0:
            last = a
            u -= pi[a]
            if u < 0.0:
                break
    return last


@compiled
def _add_score(g, scale, pi, x, a):
    """g += scale * grad ln pi(a|s). om-score"""
    for b in range(pi.size):
        for i in range(x.size):
            g[b, i] += scale * ((1.0 if b == a else 0.0) - pi[b]) * x[i]  # om-score


@compiled
def _dot(w, x):
    total = 0.0
    for i in range(x.size):
        total += w[i] * x[i]
    return total


# ---------------------------------------------------------------------- the exact gradient


def objective(mdp, theta, gamma, *, features=None):
    """J(theta), the expected discounted return from the start distribution. eq-rf-39 corrected

    theta: (A, d). features: (S, d), one a state where None.
    """
    X = _features(features, check_mdp(mdp).n_states)
    return float(mdp.start @ solve_policy(mdp, softmax_policy(_shaped(mdp, theta, X), X, mdp.legal), gamma))


def policy_gradient_exact(mdp, theta, gamma, *, features=None, V=None):
    """Gradient of J with respect to theta, (A, d). eq-u-pg-theorem, alg-policy-gradient-exact, fig-50

    Two linear solves: q_pi, and the expected discounted number of visits to each state, which weights it; there is no
    constant of proportion left.
    V: (S,) values instead of v_pi: what one-step actor-critic follows on average while its critic holds V.
    Source: Sutton et al. (2000), theorem 1.
    """
    X = _features(features, check_mdp(mdp).n_states)
    pi = softmax_policy(_shaped(mdp, theta, X), X, mdp.legal)
    V = solve_policy(mdp, pi, gamma) if V is None else V
    Q = np.where(mdp.legal, q_from_v(mdp, V, gamma), 0.0)
    d_h = expected_visits(mdp, pi, gamma)[:, None] * pi * (Q - (pi * Q).sum(axis=1, keepdims=True))  # eq-u-pg-theorem
    return d_h.T @ X


def gradient_ascent(mdp, theta, gamma, n_steps, *, alpha, features=None):
    """theta_0 ... theta_n of ascent along the exact gradient, (n_steps + 1, A, d). eq-u-pg-update, fig-49"""
    history, alpha = [_parameters("theta", theta)], _check_step("alpha", alpha)
    for _ in range(check_count("n_steps", n_steps)):
        history.append(history[-1] + alpha * policy_gradient_exact(mdp, history[-1], gamma, features=features))
    return np.array(history)


# ---------------------------------------------------------------------- sampled gradients


def episode_gradient(theta, states, actions, rewards, gamma, *, features=None, baseline=0.0, discount_states=False):
    """g of figure 52 from one finished episode, (A, d): lines 4 to 9. alg-reinforce, fig-52, eq-u-reinforce

    states: (T,) or (T + 1,); actions, rewards: (T,), rewards[t] is R_{t+1}. baseline: b(s), a number or (S,).
    discount_states: the factor gamma^t of the theorem, which the document's box leaves out; so does the default.
    """
    theta = _parameters("theta", theta)
    X = np.eye(theta.shape[1]) if features is None else _features(features, None, theta.shape[1])
    actions, G = _indices("actions", actions, len(theta)), discounted_returns(rewards, gamma)  # eq-u-alg2-return
    states = _indices("states", states, len(X))[: actions.size]
    if not states.shape == actions.shape == G.shape:
        raise ValueError(f"actions: got shape {actions.shape}, must be that of rewards, {G.shape}, a state for each")
    b, g = np.broadcast_to(as_floats("baseline", baseline), len(X)), np.zeros_like(theta)
    for t, (s, a) in enumerate(zip(states, actions)):
        discount = gamma**t if discount_states else 1.0
        g += discount * (G[t] - b[s]) * grad_log_softmax(theta, X[s], a)  # eq-u-alg2-gradient
    return g


def gradient_estimates(world, theta, gamma, n_episodes, *, features=None, baseline=0.0, discount_states=False,
                       acting=None, corrected=True, max_steps=None, rng):  # fmt: skip
    """g of figure 52 for each of n_episodes episodes under one theta, (n_episodes, A, d). fig-54, eq-u-reinforce

    baseline: a number, (S,), or (S, A) for one that depends on the action and is therefore wrong. acting: (A, d)
    parameters of the policy that acts, where it is not theta's; corrected: weight each episode with the ratio of its
    probabilities under the two. cl-106, cl-110
    """
    (legal, _), rng = spaces(world), check_rng(rng)
    X = _features(features, len(legal))
    theta = _parameters("theta", theta, (legal.shape[1], X.shape[1]))
    acting = theta if acting is None else _parameters("acting", acting, theta.shape)
    b = as_floats("baseline", baseline)
    if b.shape not in ((), legal.shape[:1], legal.shape) or not np.isfinite(b).all():
        raise ValueError(f"baseline: got shape {b.shape}, must be a number, {legal.shape[:1]} or {legal.shape}")
    b = np.ascontiguousarray(np.broadcast_to(b[:, None] if b.ndim == 1 else b, legal.shape))
    settings = X, legal, check_gamma(gamma), check_count("n_episodes", n_episodes), b, bool(discount_states)
    limit = check_max_steps(world, max_steps, legal / legal.sum(axis=1, keepdims=True))
    return run_loop(_gradient_estimates, world, *settings, theta, acting, bool(corrected), limit, rng=rng)


@compiled
def _gradient_estimates(
    world, X, legal, gamma, n_episodes, b, discount_states, theta, acting, corrected, max_steps, rng
):
    gradients, pi, mu = np.zeros((n_episodes,) + theta.shape), np.zeros(len(theta)), np.zeros(len(theta))
    states, actions, rewards = np.zeros(64, np.int64), np.zeros(64, np.int64), np.zeros(64)
    for k in range(n_episodes):
        s, n, done, ratio = reset(world, rng), 0, False, 1.0
        while not done:
            if n == states.size:
                states, actions, rewards = (
                    np.append(states, states),
                    np.append(actions, actions),
                    np.append(rewards, rewards),
                )
            a = _choose(_probabilities(mu, acting, X[s], legal[s], 0.0), rng)
            if corrected:
                ratio *= _probabilities(pi, theta, X[s], legal[s], 0.0)[a] / mu[a]
            states[n], actions[n] = s, a
            s, rewards[n], terminated, truncated = act(world, s, a, rng)
            n += 1
            done = terminated or truncated or n == max_steps
        G = 0.0
        for t in range(n - 1, -1, -1):
            s, a = states[t], actions[t]
            G = rewards[t] + gamma * G  # eq-u-alg2-return
            _probabilities(pi, theta, X[s], legal[s], 0.0)
            discount = gamma**t if discount_states else 1.0
            _add_score(gradients[k], ratio * discount * (G - b[s, a]), pi, X[s], a)  # eq-u-reinforce-baseline
    return gradients


# ---------------------------------------------------------------------- checks


def _features(x, n_states, d=None):
    """x as (S, d) floats; one feature a state where None."""
    if x is None:
        return np.eye(n_states)
    x = np.ascontiguousarray(as_floats("features", x))
    if x.ndim != 2 or x.size == 0 or len(x) != (n_states or len(x)) or x.shape[1] != (d or x.shape[1]):
        expected = (n_states or "S", d or "d")
        raise ValueError(f"features: got shape {x.shape}, must be ({expected[0]}, {expected[1]})")
    if not np.isfinite(x).all():
        raise ValueError("features: contains a value that is not finite, must be numbers")
    return x


def _parameters(name, values, shape=None):
    """values as a new float array, a number broadcast to shape; (A, d) where shape is None."""
    values = as_floats(name, values)
    if shape is not None and values.ndim == 0:
        values = np.full(shape, values)
    if values.shape != (shape or values.shape) or values.ndim != len(shape or "Ad") or values.size == 0:
        raise ValueError(f"{name}: got shape {values.shape}, must be {shape or '(A, d)'}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return np.array(values)


def _shaped(mdp, theta, X):
    return _parameters("theta", theta, (mdp.n_actions, X.shape[1]))


def _indices(name, values, n):
    values = as_integers(name, values)
    if ((values < 0) | (values >= n)).any():
        raise ValueError(f"{name}: got {values.min()}..{values.max()}, must be in 0..{n - 1}")
    return values


def _check_step(name, value, least=None):
    if not is_number(value) or not (value > 0 or value == least) or not value < np.inf:
        raise ValueError(f"{name}: got {value!r}, must be a number {'of at least' if least == 0 else 'above'} 0")
    return float(value)


def _check_p_min(p_min, A):
    if not is_number(p_min) or not 0 <= p_min < 1 / A:
        raise ValueError(f"p_min: got {p_min!r}, must be in [0, 1 / {A})")
    return float(p_min)
