"""Action rules of tabular methods, and checks of their settings."""

import numpy as np

from rlcore.bellman import greedy_actions
from rlcore.compiled import compiled
from rlcore.mdp import FiniteMDP


@compiled
def epsilon_greedy(Q, s, epsilon, rng):
    """A legal action at random with probability epsilon, else a maximising one; ties at random. -inf: not legal."""
    lowest = max_value(Q, s)
    if rng.random() < epsilon:
        lowest = -1.7976931348623157e308
    n = 0
    for a in range(Q.shape[1]):
        n += Q[s, a] >= lowest
    pick = int(rng.random() * n)
    for a in range(Q.shape[1]):
        if Q[s, a] >= lowest:
            if pick == 0:
                return a
            pick -= 1
    return -1


@compiled
def max_value(Q, s):
    """max over a of Q(s, a)."""
    best = Q[s, 0]
    for a in range(1, Q.shape[1]):
        best = max(best, Q[s, a])
    return best


def soft_greedy(Q, epsilon):
    """The epsilon-greedy policy (S, A) of Q: ties share the greedy part, -inf marks actions that are not legal."""
    best, legal = greedy_actions(Q), np.isfinite(Q)
    share = [x / x.sum(axis=1, keepdims=True) for x in (best, legal)]
    return (1 - check_probability("epsilon", epsilon)) * share[0] + epsilon * share[1]


def check_world(world):
    """world; ValueError unless it is a FiniteMDP to act in. cl-031"""
    if not isinstance(world, FiniteMDP):
        raise ValueError(f"world: got {type(world).__name__}, must be a FiniteMDP to act in")
    return world


def check_probability(name, value):
    """value as a float; ValueError unless it is in [0, 1]."""
    if not 0 <= value <= 1:
        raise ValueError(f"{name}: got {value!r}, must be a probability in [0, 1]")
    return float(value)


def check_rate(alpha):
    """alpha as a float; ValueError unless it is in (0, 1]."""
    if not 0 < alpha <= 1:
        raise ValueError(f"alpha: got {alpha!r}, must be in (0, 1]")
    return float(alpha)
