"""Generalised advantage estimates, and what PPO and TRPO learn from a rollout (chapter 8)."""

from __future__ import annotations

import numpy as np

from rlcore.core.agents import ActorCritic
from rlcore.core.checks import as_flags, finite
from rlcore.core.rollouts import Rollout, Settings
from rlcore.core.rules import checked
from rlcore.core.types import Array, ArrayLike, Floats


def _like_rewards(kind):
    def rule(name, values, given):
        values = kind(name, values)
        shape = given["rewards"].shape if name != "rewards" else values.shape
        if values.shape != shape or values.ndim not in (1, 2) or not values.size:
            shown = f"{name}: got shape {values.shape}"
            raise ValueError(f"{shown}, must be that of rewards, (T,) or (T, N), and not empty")
        return values

    return rule


_numbers, _flags = _like_rewards(finite), _like_rewards(as_flags)


@checked(rewards=_numbers, values=_numbers, next_values=_numbers, terminated=_flags, truncated=_flags)
def gae(
    rewards: ArrayLike, values: ArrayLike, next_values: ArrayLike, terminated: ArrayLike, truncated: ArrayLike,
    gamma: float, lam: float,
) -> Floats:  # fmt: skip
    """Generalised advantage estimates: sums of (gamma lam)^l delta_{t+l} within the episode.

    A terminal state is worth 0 whatever next_values says; a truncated one keeps its value. Both end the sum.

    Parameters
    ----------
    rewards : ArrayLike
        (T,), or (T, N) for N environments side by side.
    values : ArrayLike
        v_hat(s_t), like rewards.
    next_values : ArrayLike
        v_hat of the state that step t led to, also where the episode was cut there; like rewards.
    terminated : ArrayLike
        Whether that state is terminal, like rewards.
    truncated : ArrayLike
        Whether the episode was cut there, like rewards.
    gamma : float
        Discount, in [0, 1].
    lam : float
        In [0, 1].

    Returns
    -------
    Floats
        Of the shape of rewards.

    Notes
    -----
    Ledger: om-gae, alg-gae.

    References
    ----------
    Schulman et al. (2016), (16).

    Examples
    --------
    >>> from rlcore.gae import gae
    >>> gae([1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [False, True], [False, False], 1.0, 0.5)
    array([1.5, 1. ])
    """
    delta = rewards + gamma * next_values * ~terminated - values  # om-gae
    decay = gamma * lam * ~(terminated | truncated)
    advantages, last = np.zeros_like(delta), 0.0
    if delta.ndim == 1:  # plain numbers: 10 times as fast as arrays without dimensions
        delta, decay = delta.tolist(), decay.tolist()
    for t in range(len(delta) - 1, -1, -1):
        advantages[t] = last = delta[t] + decay[t] * last  # om-gae
    return advantages


def learning_data(agent: ActorCritic, rollout: Rollout, config: Settings) -> tuple[Floats, Array, Floats, Floats]:
    """(x, actions, advantages, targets of v_hat) of the steps that are transitions. om-gae, om-value-loss

    x: (B, d), normalised observations. The target A_hat + v_hat(s) is the lambda-return.
    """
    T, N = rollout.rewards.shape
    x = agent.see(rollout.observations.reshape((T + 1) * N, -1))
    v = agent.forward(x)[1].reshape(T + 1, N)
    arrays = rollout.rewards, v[:-1], v[1:], rollout.terminated, rollout.truncated
    A = gae(*(a[:, 0] if N == 1 else a for a in arrays), config.gamma, config.lam).reshape(T, N)
    keep, target = rollout.real.ravel(), (A + v[:-1]).ravel()
    A = A.ravel()[keep]
    if config.normalise_advantages:
        A = (A - A.mean()) / (A.std() + 1e-8)
    actions = rollout.actions.reshape(T * N, *rollout.actions.shape[2:])
    return x[: T * N][keep], actions[keep], A.astype(x.dtype), target[keep].astype(x.dtype)
