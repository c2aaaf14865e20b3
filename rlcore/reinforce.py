"""REINFORCE, the model-free counterpart of planning in chapter 3 (chapter 7 treats it properly)."""

import numpy as np

from rlcore.mdp import check_count, check_gamma, check_rng, discounted_returns
from rlcore.results import Run

__all__ = ["reinforce_linear"]


def reinforce_linear(start, step, alive, n_actions, gamma, n_episodes, *, alpha, scale=1.0, max_steps=200, rng):
    """Policy gradient with a softmax that is linear in the state, returns to go and their mean as baseline. cl-025

    start(rng=) -> (d,) first state; step(x, a) -> next state; alive(x) -> whether to go on. Each step pays 1.
    alpha: step size; scale: (d,) or a number that divides the state, so that its parts are of order 1.
    Returns a Run; policy is W (A, d), history (n_episodes + 1, A, d). Source: Williams (1992).
    """
    gamma, max_steps, rng = check_gamma(gamma), check_count("max_steps", max_steps), check_rng(rng)
    if not alpha > 0:
        raise ValueError(f"alpha: got {alpha!r}, must be positive")
    W = np.zeros((check_count("n_actions", n_actions), np.size(start(rng=rng))))
    lengths, history = [], [W]
    for _ in range(check_count("n_episodes", n_episodes)):
        x, features, gradients = start(rng=rng), [], []
        while len(features) < max_steps and alive(x):
            probs = softmax(W @ (x / scale))
            a = min(int((np.cumsum(probs) <= rng.random()).sum()), n_actions - 1)
            features.append(x / scale)
            gradients.append(np.eye(n_actions)[a] - probs)  # of log pi(a|x) with respect to the preferences
            x = step(x, a)
        G = discounted_returns(np.ones(len(features)), gamma)
        W = W + alpha * np.einsum("t,ta,td->ad", G - G.mean(), gradients, features) / len(features)
        lengths.append(len(features))
        history.append(W)
    return Run(np.array(lengths, float), np.array(lengths), policy=W, history=np.array(history))


def softmax(preferences):
    """Probabilities proportional to exp(preferences)."""
    weights = np.exp(preferences - preferences.max())
    return weights / weights.sum()
