"""Processes and published values that several tests use; values are of Sutton and Barto (2018), figure as noted."""

import json
from functools import cache
from math import factorial
from pathlib import Path

import numpy as np

from rlcore.mdp import FiniteMDP

REFERENCE = json.loads((Path(__file__).parent / "reference.json").read_text())


def published(name):
    """Value and tolerance of an entry of reference.json."""
    return np.array(REFERENCE[name]["value"]), REFERENCE[name]["band"]


def agrees(values, name):
    expected, band = published(name)
    np.testing.assert_allclose(values, expected, rtol=0, atol=max(band, 1e-12))


def loop(reward=1.0, n_states=1):
    """States in a ring, one action, the same reward at every step: v = reward / (1 - gamma)."""
    return FiniteMDP.from_outcomes({(s, 0): [(1.0, (s + 1) % n_states, reward)] for s in range(n_states)})


def chain(rewards):
    """State t goes to t + 1 with rewards[t]; the last state is terminal."""
    return FiniteMDP.from_outcomes({(t, 0): [(1.0, t + 1, r)] for t, r in enumerate(rewards)}, start=0)


def stay_or_go():
    """State 0 may stay (reward 0, for ever) or go to the end (reward -1): the policy that stays is improper."""
    return FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 0.0)], (0, 1): [(1.0, 1, -1.0)]})


def awkward(seed=0, n_states=7, n_actions=3, start=None):
    """A random process with illegal actions, two outcomes to the same state, padding and a terminal state."""
    rng = np.random.default_rng(seed)
    outcomes = {}
    for s in range(n_states - 1):
        for a in rng.permutation(n_actions)[: 1 + s % n_actions]:
            p = rng.dirichlet(np.ones(1 + (s + int(a)) % 4))
            outcomes[s, int(a)] = [(q, int(rng.integers(n_states)), float(rng.integers(-3, 4))) for q in p]
    outcomes[0, 0] = [(0.5, 1, 2.0), (0.25, 1, -1.0), (0.25, n_states - 1, 0.5)]
    return FiniteMDP.from_outcomes(outcomes, n_states=n_states, n_actions=n_actions, start=start)


def gridworld5x5():
    """Figure 3.2: from A (0, 1) to (4, 1) for 10, from B (0, 3) to (2, 3) for 5, off the grid -1; N, S, E, W."""
    outcomes = {}
    for s in range(25):
        for a, (dr, dc) in enumerate([(-1, 0), (1, 0), (0, 1), (0, -1)]):
            r, c = s // 5 + dr, s % 5 + dc
            inside = 0 <= r < 5 and 0 <= c < 5
            outcomes[s, a] = [(1.0, 5 * r + c, 0.0) if inside else (1.0, s, -1.0)]
        if s in (1, 3):
            for a in range(4):
                outcomes[s, a] = [(1.0, 21, 10.0) if s == 1 else (1.0, 13, 5.0)]
    return FiniteMDP.from_outcomes(outcomes)


def gambler(ph, goal=100):
    """Example 4.3: capital 1..goal - 1, action a stakes a + 1; reward 1 on reaching the goal."""
    outcomes = {}
    for s in range(1, goal):
        for stake in range(1, min(s, goal - s) + 1):
            outcomes[s, stake - 1] = [(ph, s + stake, float(s + stake == goal)), (1 - ph, s - stake, 0.0)]
    return FiniteMDP.from_outcomes(outcomes)


@cache
def jacks_car_rental(capacity=20, most=5):
    """Example 4.2: state (cars at 1, cars at 2), action m moves m - 5 cars from 1 to 2; Poisson tails are lumped."""
    n = capacity + 1
    place = [_rental(3, 3, n), _rental(4, 2, n)]
    morning = np.kron(place[0][0], place[1][0])
    income = 10 * (place[0][1][:, None] + place[1][1]).ravel()
    P, R = np.zeros((n * n, 2 * most + 1, n * n)), np.zeros((n * n, 2 * most + 1))
    for s in range(n * n):
        for m in range(-most, most + 1):
            i, j = s // n - m, s % n + m
            if i >= 0 and j >= 0:
                after = min(i, capacity) * n + min(j, capacity)
                P[s, m + most], R[s, m + most] = morning[after], income[after] - 2 * abs(m)
    return FiniteMDP.from_arrays(P / np.where(P.any(axis=2), P.sum(axis=2), 1)[:, :, None], R)


def _rental(requests, returns, n):
    """Day of one location: P (n, n) from the cars in the morning to those at night, and the expected rentals (n,)."""
    P, rented = np.zeros((n, n)), np.zeros(n)
    for cars in range(n):
        for out, p_out in enumerate(_poisson(requests, cars)):
            rented[cars] += p_out * out
            for back, p_back in enumerate(_poisson(returns, n - 1 - cars + out)):
                P[cars, cars - out + back] += p_out * p_back
    return P, rented


def _poisson(mean, most):
    """Probabilities of 0..most events, with the tail added to the last."""
    p = [np.exp(-mean) * mean**k / factorial(k) for k in range(most)]
    return [*p, 1 - sum(p)]
