"""The exact policy gradient, and its estimates from episodes (chapter 7)."""

from __future__ import annotations

from typing import Any

import numpy as np

from rlcore.bellman import expected_visits, q_from_v, solve_policy
from rlcore.core.checks import check_flag, check_positive, finite, spaces
from rlcore.core.compiled import compiled
from rlcore.core.learner import learner
from rlcore.core.rules import anything, array, checked, takes_none
from rlcore.core.samples import check_labels
from rlcore.core.types import ArrayLike, Flags, Floats, Ints, Rng, World
from rlcore.core.worlds import act, reset
from rlcore.mdp import FiniteMDP, discounted_returns
from rlcore.policies import (
    add_score,
    check_features,
    check_parameters,
    choose,
    grad_log_softmax,
    linear,
    probabilities,
    softmax_policy,
)

# ---------------------------------------------------------------------- the exact gradient


@checked(theta=anything, features=linear)
def objective(mdp: FiniteMDP, theta: ArrayLike, gamma: float, *, features: ArrayLike | None = None) -> float:
    """J(theta), the expected discounted return from the start distribution.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    theta : ArrayLike
        (A, d).
    gamma : float
        Discount, in [0, 1].
    features : ArrayLike | None
        (S, d), one a state where None.

    Returns
    -------
    float
        J.

    Notes
    -----
    Ledger: eq-rf-39 corrected.
    """
    X, legal = features
    return float(mdp.start @ solve_policy(mdp, softmax_policy(theta, X, legal), gamma))


@checked(
    theta=anything,
    features=linear,
)
def policy_gradient_exact(
    mdp: FiniteMDP, theta: ArrayLike, gamma: float, *, features: ArrayLike | None = None, V: ArrayLike | None = None
) -> Floats:
    """The exact gradient of J with respect to theta.

    Two linear solves: q_pi, and the expected discounted number of visits to each state, which weights it; there is no
    constant of proportion left.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    theta : ArrayLike
        (A, d).
    gamma : float
        Discount, in [0, 1].
    features : ArrayLike | None
        (S, d); one feature a state where None.
    V : ArrayLike | None
        (S,) values instead of v_pi: what one-step actor-critic follows on average while its critic holds V.

    Returns
    -------
    Floats
        (A, d).

    Notes
    -----
    Ledger: eq-u-pg-theorem, alg-policy-gradient-exact, fig-50.

    References
    ----------
    Sutton et al. (2000), theorem 1.

    Examples
    --------
    >>> from rlcore import policy_gradient_exact
    >>> from rlcore.envs.small import short_corridor
    >>> policy_gradient_exact(short_corridor(), [[0.0], [0.0]], 1.0, features=[[1.0]] * 4).round(3)
    array([[-2.],
           [ 2.]])
    """
    X, legal = features
    pi = softmax_policy(theta, X, legal)
    V = solve_policy(mdp, pi, gamma) if V is None else V
    Q = np.where(legal, q_from_v(mdp, V, gamma), 0.0)
    d_h = expected_visits(mdp, pi, gamma)[:, None] * pi * (Q - (pi * Q).sum(axis=1, keepdims=True))  # eq-u-pg-theorem
    return d_h.T @ X


@checked(theta=anything, alpha=check_positive, features=linear)
def gradient_ascent(
    mdp: FiniteMDP, theta: ArrayLike, gamma: float, n_steps: int, *, alpha: float, features: ArrayLike | None = None
) -> Floats:
    """The parameters theta_0 ... theta_n of ascent along the exact gradient.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    theta : ArrayLike
        (A, d), where it starts.
    gamma : float
        Discount, in [0, 1].
    n_steps : int
        Number of steps.
    alpha : float
        Step size, above 0.
    features : ArrayLike | None
        (S, d); one feature a state where None.

    Returns
    -------
    Floats
        (n_steps + 1, A, d).

    Notes
    -----
    Ledger: eq-u-pg-update, fig-49.

    Examples
    --------
    >>> from rlcore import gradient_ascent
    >>> from rlcore.envs.small import short_corridor
    >>> gradient_ascent(short_corridor(), [[0.0], [0.0]], 1.0, 2, alpha=0.01, features=[[1.0]] * 4)[:, :, 0].round(3)
    array([[ 0.   ,  0.   ],
           [-0.02 ,  0.02 ],
           [-0.038,  0.038]])
    """
    history, (X, _) = [theta], features
    for _ in range(n_steps):
        history.append(history[-1] + alpha * policy_gradient_exact(mdp, history[-1], gamma, features=X))
    return np.array(history)


# ---------------------------------------------------------------------- sampled gradients


@takes_none
def _features(name, x, given):
    """The rule of features (S, d), one a state where None; a state and an action for each reward."""
    theta = given["theta"]
    X = np.eye(theta.shape[1]) if x is None else check_features(name, x, None, theta.shape[1])
    T = given["rewards"].size
    given["actions"] = check_labels("actions", given["actions"], len(theta), (T,))
    given["states"] = check_labels("states", given["states"], len(X))
    if given["states"].shape not in ((T,), (T + 1,)):
        raise ValueError(f"states: got shape {given['states'].shape}, must be ({T},) or ({T + 1},), a state for each")
    return X


def _of_states(name, b, given):
    b, S = finite(name, b), len(given["features"])
    if b.shape not in ((), (S,)):
        raise ValueError(f"{name}: got shape {b.shape}, must be a number or ({S},)")
    return np.broadcast_to(b, S)


@checked(
    theta=lambda name, theta, given: check_parameters(name, theta), states=anything, actions=anything,
    rewards=array("T"), features=_features, baseline=_of_states,
)  # fmt: skip
def episode_gradient(
    theta: ArrayLike, states: ArrayLike, actions: ArrayLike, rewards: ArrayLike, gamma: float, *,
    features: ArrayLike | None = None, baseline: ArrayLike = 0.0, discount_states: bool = False,
) -> Floats:  # fmt: skip
    """The gradient of figure 52 from one finished episode: lines 4 to 9.

    Parameters
    ----------
    theta : ArrayLike
        (A, d).
    states : ArrayLike
        (T,) or (T + 1,).
    actions : ArrayLike
        (T,).
    rewards : ArrayLike
        (T,); rewards[t] is R_{t+1}.
    gamma : float
        Discount, in [0, 1].
    features : ArrayLike | None
        (S, d); one feature a state where None.
    baseline : ArrayLike
        b(s), a number or (S,).
    discount_states : bool
        With the factor gamma^t of the theorem, which the document's box leaves out; so does the default.

    Returns
    -------
    Floats
        (A, d).

    Notes
    -----
    Ledger: alg-reinforce, fig-52, eq-u-reinforce.

    Examples
    --------
    >>> from rlcore import episode_gradient
    >>> episode_gradient([[0.0], [0.0]], [0, 0], [1, 1], [-1.0, -1.0], 1.0, features=[[1.0]])
    array([[ 1.5],
           [-1.5]])
    """
    G, g = discounted_returns(rewards, gamma), np.zeros_like(theta)  # eq-u-alg2-return
    for t, (s, a) in enumerate(zip(states, actions)):
        discount = gamma**t if discount_states else 1.0
        score = grad_log_softmax.unchecked(theta, features[s], a)
        g += discount * (G[t] - baseline[s]) * score  # eq-u-alg2-gradient
    return g


@compiled
def softmax_episode(
    world: Any, theta: Floats, X: Floats, legal: Flags, p_min: float, max_steps: int, rng: Rng
) -> tuple[Ints, Ints, Floats, bool]:
    """One episode of the softmax policy: states (T + 1,), actions (T,), rewards (T,), whether the last is terminal."""
    pi = np.zeros(len(theta))
    states, actions, rewards = np.empty(257, np.int64), np.empty(256, np.int64), np.empty(256)
    s, t, done, terminated = reset(world, rng), 0, False, False
    states[0] = s
    while not done:
        if t == rewards.size:
            states, actions = np.append(states, states), np.append(actions, actions)
            rewards = np.append(rewards, rewards)
        actions[t] = choose(probabilities(pi, theta, X[s], legal[s], p_min), rng)
        s, rewards[t], terminated, truncated = act(world, s, actions[t], rng)
        t += 1
        states[t] = s
        done = terminated or truncated or t == max_steps
    return states[: t + 1], actions[:t], rewards[:t], terminated


@takes_none
def _acting(name, theta, given):
    return given["theta"] if theta is None else check_parameters(name, theta, given["theta"].shape)


def _corrected(name, corrected, given):
    """The rule of corrected: where one policy acts and is judged there is nothing to correct."""
    return check_flag(name, corrected) and given["acting"] is not given["theta"]


def _any_baseline(name, b, given):
    """The rule of a number, (S,) or (S, A), as (S, A)."""
    b, shape = finite(name, b), spaces(given["world"])[0].shape
    if b.shape not in ((), shape[:1], shape):
        raise ValueError(f"{name}: got shape {b.shape}, must be a number, {shape[:1]} or {shape}")
    return np.ascontiguousarray(np.broadcast_to(b[:, None] if b.ndim == 1 else b, shape))


@learner(
    lambda given, gradients: gradients,
    theta=anything, features=linear, baseline=_any_baseline, acting=_acting, corrected=_corrected,
)  # fmt: skip
def gradient_estimates(
    world: World, theta: ArrayLike, gamma: float, n_episodes: int, *, features: ArrayLike | None = None,
    baseline: ArrayLike = 0.0, discount_states: bool = False, acting: ArrayLike | None = None, corrected: bool = True,
    max_steps: int | None = None, rng: Rng,
) -> Floats:  # fmt: skip
    """The gradient of figure 52 for each of n_episodes episodes under one theta.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    theta : ArrayLike
        (A, d).
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    features : ArrayLike | None
        (S, d); one feature a state where None.
    baseline : ArrayLike
        A number, (S,), or (S, A) for one that depends on the action and is therefore wrong.
    discount_states : bool
        With the gamma^t of the theorem.
    acting : ArrayLike | None
        (A, d), parameters of the policy that acts, where it is not theta's.
    corrected : bool
        Weight each episode with the ratio of its probabilities under the two.
    max_steps : int | None
        An episode that long is cut; None: a million steps, where the policy ends every episode.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Floats
        (n_episodes, A, d).

    Notes
    -----
    Ledger: fig-54, eq-u-reinforce, cl-106, cl-110.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import gradient_estimates
    >>> from rlcore.envs.small import short_corridor
    >>> rng = np.random.default_rng(0)
    >>> gradient_estimates(short_corridor(), [[0.0], [0.0]], 1.0, 5, features=[[1.0]] * 4, rng=rng).shape
    (5, 2, 1)
    """
    X, legal = features
    gradients, pi, mu = np.zeros((n_episodes,) + theta.shape), np.zeros(len(theta)), np.zeros(len(theta))
    for k in range(n_episodes):
        states, actions, rewards, terminated = softmax_episode(world, acting, X, legal, 0.0, max_steps, rng)
        ratio, G = 1.0, 0.0
        for t in range(rewards.size):
            s, a = states[t], actions[t]
            if corrected:
                probabilities(mu, acting, X[s], legal[s], 0.0)
                ratio *= probabilities(pi, theta, X[s], legal[s], 0.0)[a] / mu[a]
        for t in range(rewards.size - 1, -1, -1):
            s, a = states[t], actions[t]
            G = rewards[t] + gamma * G  # eq-u-alg2-return
            probabilities(pi, theta, X[s], legal[s], 0.0)
            discount = gamma ** float(t) if discount_states else 1.0  # float: the same power compiled and not
            add_score(gradients[k], ratio * discount * (G - baseline[s, a]), pi, X[s], a)  # eq-u-reinforce-baseline
    return (gradients,)
