"""The exact policy gradient, and its estimates from episodes (chapter 7)."""

import numpy as np

from rlcore.bellman import expected_visits, q_from_v, solve_policy
from rlcore.core.checks import as_floats, check_count, check_gamma, check_mdp, check_rng
from rlcore.core.compiled import compiled
from rlcore.core.worlds import act, check_max_steps, reset, run_loop, spaces
from rlcore.mdp import discounted_returns
from rlcore.policies import (
    add_score,
    check_features,
    check_indices,
    check_parameters,
    check_step,
    choose,
    grad_log_softmax,
    probabilities,
    softmax_policy,
)

# ---------------------------------------------------------------------- the exact gradient


def objective(mdp, theta, gamma, *, features=None):
    """J(theta), the expected discounted return from the start distribution. eq-rf-39 corrected

    theta: (A, d). features: (S, d), one a state where None.
    """
    X = check_features(features, check_mdp(mdp).n_states)
    return float(mdp.start @ solve_policy(mdp, softmax_policy(_shaped(mdp, theta, X), X, mdp.legal), gamma))


def policy_gradient_exact(mdp, theta, gamma, *, features=None, V=None):
    """Gradient of J with respect to theta, (A, d). eq-u-pg-theorem, alg-policy-gradient-exact, fig-50

    Two linear solves: q_pi, and the expected discounted number of visits to each state, which weights it; there is no
    constant of proportion left.
    V: (S,) values instead of v_pi: what one-step actor-critic follows on average while its critic holds V.
    Source: Sutton et al. (2000), theorem 1.
    """
    X = check_features(features, check_mdp(mdp).n_states)
    pi = softmax_policy(_shaped(mdp, theta, X), X, mdp.legal)
    V = solve_policy(mdp, pi, gamma) if V is None else V
    Q = np.where(mdp.legal, q_from_v(mdp, V, gamma), 0.0)
    d_h = expected_visits(mdp, pi, gamma)[:, None] * pi * (Q - (pi * Q).sum(axis=1, keepdims=True))  # eq-u-pg-theorem
    return d_h.T @ X


def gradient_ascent(mdp, theta, gamma, n_steps, *, alpha, features=None):
    """theta_0 ... theta_n of ascent along the exact gradient, (n_steps + 1, A, d). eq-u-pg-update, fig-49"""
    history, alpha = [check_parameters("theta", theta)], check_step("alpha", alpha)
    for _ in range(check_count("n_steps", n_steps)):
        history.append(history[-1] + alpha * policy_gradient_exact(mdp, history[-1], gamma, features=features))
    return np.array(history)


# ---------------------------------------------------------------------- sampled gradients


def episode_gradient(theta, states, actions, rewards, gamma, *, features=None, baseline=0.0, discount_states=False):
    """g of figure 52 from one finished episode, (A, d): lines 4 to 9. alg-reinforce, fig-52, eq-u-reinforce

    states: (T,) or (T + 1,); actions, rewards: (T,), rewards[t] is R_{t+1}. baseline: b(s), a number or (S,).
    discount_states: the factor gamma^t of the theorem, which the document's box leaves out; so does the default.
    """
    theta = check_parameters("theta", theta)
    X = np.eye(theta.shape[1]) if features is None else check_features(features, None, theta.shape[1])
    actions, G = check_indices("actions", actions, len(theta)), discounted_returns(rewards, gamma)  # eq-u-alg2-return
    states = check_indices("states", states, len(X))[: actions.size]
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
    X = check_features(features, len(legal))
    theta = check_parameters("theta", theta, (legal.shape[1], X.shape[1]))
    acting = theta if acting is None else check_parameters("acting", acting, theta.shape)
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
            a = choose(probabilities(mu, acting, X[s], legal[s], 0.0), rng)
            if corrected:
                ratio *= probabilities(pi, theta, X[s], legal[s], 0.0)[a] / mu[a]
            states[n], actions[n] = s, a
            s, rewards[n], terminated, truncated = act(world, s, a, rng)
            n += 1
            done = terminated or truncated or n == max_steps
        G = 0.0
        for t in range(n - 1, -1, -1):
            s, a = states[t], actions[t]
            G = rewards[t] + gamma * G  # eq-u-alg2-return
            probabilities(pi, theta, X[s], legal[s], 0.0)
            discount = gamma**t if discount_states else 1.0
            add_score(gradients[k], ratio * discount * (G - b[s, a]), pi, X[s], a)  # eq-u-reinforce-baseline
    return gradients


def _shaped(mdp, theta, X):
    return check_parameters("theta", theta, (mdp.n_actions, X.shape[1]))
