"""Generalised advantage estimates, and what PPO and TRPO learn from a rollout (chapter 8)."""

import numpy as np

from rlcore.core.checks import check_gamma, check_probability


def gae(rewards, values, next_values, terminated, truncated, gamma, lam):
    """Generalised advantage estimates: sums of (gamma lam)^l delta_{t+l} within the episode. om-gae, alg-gae

    All arrays: (T,), or (T, N) for N environments side by side. values: v_hat(s_t). next_values: v_hat of the state
    that step t led to, also where the episode was cut there. A terminal state is worth 0 whatever next_values says; a
    truncated one keeps its value. Both end the sum. Returns the shape of rewards.
    Source: Schulman et al. (2016), (16).
    """
    gamma, lam = check_gamma(gamma), check_probability("lam", lam)
    rewards, values, next_values = _alike(float, rewards=rewards, values=values, next_values=next_values)
    terminated, truncated = _alike(bool, rewards.shape, terminated=terminated, truncated=truncated)
    delta = rewards + gamma * next_values * ~terminated - values  # om-gae
    decay = gamma * lam * ~(terminated | truncated)
    advantages, last = np.zeros_like(delta), 0.0
    if delta.ndim == 1:  # plain numbers: 10 times as fast as arrays without dimensions
        delta, decay = delta.tolist(), decay.tolist()
    for t in range(len(delta) - 1, -1, -1):
        advantages[t] = last = delta[t] + decay[t] * last  # om-gae
    return advantages


def _alike(dtype, shape=None, **arrays):
    """The arrays, all finite and of one shape."""
    for name, values in arrays.items():
        values = np.asarray(values)
        if values.dtype.kind not in "biuf":
            raise ValueError(f"{name}: got {values.dtype}, must be numbers")
        shape = values.shape if shape is None else shape
        if values.shape != shape or values.ndim not in (1, 2) or not values.size:
            raise ValueError(
                f"{name}: got shape {values.shape}, must be that of rewards, (T,) or (T, N), and not empty"
            )
        if not np.isfinite(values).all():
            raise ValueError(f"{name}: contains NaN or infinity, must be finite numbers")
        arrays[name] = values.astype(dtype)
    return arrays.values()


def learning_data(agent, rollout, config):
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
