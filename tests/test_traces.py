import hashlib
import inspect
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from worlds import awkward, chain, loop

from rlcore.bellman import q_from_v, solve_policy
from rlcore.core import compiled
from rlcore.dp import value_iteration
from rlcore.envs import MDPEnv, dyna_maze, random_walk, recycling_robot, windy_gridworld
from rlcore.mdp import FiniteMDP, discounted_return, discounted_returns, uniform_policy
from rlcore.monte_carlo import constant_alpha_mc
from rlcore.nstep import (
    complex_backup,
    error_reduction,
    forward_increments,
    lambda_return,
    lambda_weights,
    n_step_return,
    n_step_td,
    offline_lambda_return,
)
from rlcore.policies import epsilon_greedy
from rlcore.td import q_learning, sarsa, td0
from rlcore.traces import (
    TRACES,
    backward_increments,
    sarsa_lambda,
    td_lambda,
    trace_course,
    trace_update,
    true_online_td_lambda,
    watkins_q_lambda,
)

HERE = Path(__file__).parent
REFERENCE = json.loads((HERE / "reference_traces.json").read_text())
DYNA_MAZE = dyna_maze()
GAMMA, LAM = 0.9, 0.7
READINGS = ("in order", "summed", "recomputed")
close = partial(np.testing.assert_allclose, rtol=0, atol=1e-12)
same = np.testing.assert_array_equal


def rng(seed=0):
    return np.random.default_rng(seed)


class Recorder(MDPEnv):
    """Keeps (s, a, r, s_next) of each episode."""

    def __init__(self, mdp):
        super().__init__(mdp)
        self.episodes = []

    def reset(self, **options):
        self.episodes.append([])
        return super().reset(**options)

    def step(self, action):
        s, found = self.s, super().step(action)
        self.episodes[-1].append((s, int(action), found[1], found[0]))
        return found


def recorded(learn, mdp, *args, **options):
    """The Run, and its episodes as lists of (s, a, r, s_next)."""
    env = Recorder(mdp)
    run = learn(env, *args, **options)
    return run, [path for path in env.episodes if path]


def arrays(path):
    s, a, r, s_next = (np.array(column) for column in zip(*path))
    return np.append(s, s_next[-1]), a, r


def some_episode(seed=3, T=9):
    g = rng(seed)
    return g.normal(size=T), g.normal(size=T + 1)


# ---------------------------------------------------------------------- targets


def test_n_step_return_is_the_sum_of_its_definition():
    rewards, values = some_episode()
    for t in range(9):
        for n in range(1, 12):
            h = min(t + n, 9)
            G = sum(GAMMA ** (k - t) * rewards[k] for k in range(t, h)) + GAMMA ** (h - t) * values[h]
            close(n_step_return(rewards, values, GAMMA, n, t), G)
            if t < 8 and n > 1:  # the recursion of (25)
                close(G, rewards[t] + GAMMA * n_step_return(rewards, values, GAMMA, n - 1, t + 1))
    close(n_step_return(rewards, values, GAMMA, 1), rewards + GAMMA * values[1:])
    two = rewards[0] + GAMMA * rewards[1] + GAMMA**2 * values[2]
    close(n_step_return(rewards, values, GAMMA, 2, 0), two)
    close(two, rewards[0] + GAMMA * n_step_return(rewards, values, GAMMA, 1, 1))


@pytest.mark.parametrize("n", [9, 10, 100])
def test_a_horizon_past_the_end_gives_the_complete_return(n):
    rewards, values = some_episode()
    close(n_step_return(rewards, values[:9], GAMMA, n), discounted_returns(rewards, GAMMA))
    assert n_step_return(rewards, values[:9], GAMMA, n - 4, 4) == pytest.approx(discounted_return(rewards, GAMMA, 4))


def test_the_printed_increment_differs_unless_gamma_is_1():
    rewards, values = some_episode()
    for gamma in (0.9, 1.0):
        right = n_step_return(rewards, values, gamma, 2, 0) - values[0]
        moved = values.copy()
        moved[2] -= values[0]  # -V(S_t) inside the argument of the return, as (26) is printed
        printed = n_step_return(rewards, moved, gamma, 2, 0)
        close(right - printed, (gamma**2 - 1) * values[0])


def test_complex_backup_mixes_n_step_returns():
    rewards, values = some_episode()
    mixed = complex_backup(rewards, values, GAMMA, {2: 0.5, 4: 0.5})
    close(mixed, (n_step_return(rewards, values, GAMMA, 2) + n_step_return(rewards, values, GAMMA, 4)) / 2)
    close(complex_backup(rewards, values, GAMMA, {3: 1}), n_step_return(rewards, values, GAMMA, 3))


@pytest.mark.parametrize("lam", [0.0, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("cut", [False, True])
def test_lambda_return_is_the_weighted_mean_of_n_step_returns(lam, cut):
    rewards, values = some_episode()
    values = values if cut else values[:9]
    L = lambda_return(rewards, values, GAMMA, lam)
    for t in range(9):
        weights = lambda_weights(9 - t, lam)
        returns = [n_step_return(rewards, values, GAMMA, n, t) for n in range(1, 10 - t)]
        close(L[t], weights @ returns)
        close(weights.sum(), 1)
        used = {n + 1: w for n, w in enumerate(weights) if w > 0}
        close(L[t], complex_backup(rewards, values, GAMMA, used)[t])


def test_lambda_return_is_exact_at_both_ends():
    rewards, values = some_episode()
    same(lambda_return(rewards, values[:9], GAMMA, 1.0), discounted_returns(rewards, GAMMA))
    same(lambda_return(rewards, values, GAMMA, 0.0), n_step_return(rewards, values, GAMMA, 1))


def test_lambda_weights_of_figures_23_and_24():
    close(lambda_weights(5, 0.9), [0.1, 0.09, 0.081, 0.0729, 0.6561])
    close(lambda_weights(5, 0.5), [0.5, 0.25, 0.125, 0.0625, 0.0625])
    assert lambda_weights(20, 0.9)[-1] == pytest.approx(0.135, abs=5e-4)
    assert lambda_weights(20, 0.6)[-1] == pytest.approx(6.1e-5, abs=5e-7)
    same(lambda_weights(3, 0.0), [1, 0, 0])
    same(lambda_weights(3, 1.0), [0, 0, 1])
    assert lambda_weights(1, 0.4) == [1]


@pytest.mark.parametrize("n", [1, 2, 3, 5, 10, {2: 0.5, 4: 0.5}])
def test_error_reduction_holds(n):
    mdp = random_walk(5)
    pi = uniform_policy(mdp)
    pairs = np.array([error_reduction(mdp, pi, v, n, 0.9) for v in rng().normal(size=(1000, 7))])
    assert (pairs[:, 0] <= pairs[:, 1] + 1e-12).all()
    factor = 0.73305 if isinstance(n, dict) else 0.9**n
    v = rng().normal(size=7)
    gap = np.abs(v - solve_policy(mdp, pi, 0.9))[1:6].max()
    close(error_reduction(mdp, pi, v, n, 0.9)[1], factor * gap)


def test_error_reduction_as_printed_fails():
    mdp = random_walk(5)
    pi = uniform_policy(mdp)
    v_pi = solve_policy(mdp, pi, 0.9)
    left, right = error_reduction(mdp, pi, v_pi, 2, 0.9, printed=True)
    assert left == pytest.approx(0.182, abs=5e-4) and right == 0
    close(error_reduction(mdp, pi, v_pi, 2, 0.9), 0)
    v = rng(1).normal(size=7)
    close(error_reduction(mdp, pi, v, 1, 0.9), error_reduction(mdp, pi, v, 1, 0.9, printed=True))


def test_error_reduction_is_the_expectation_of_n_step_returns():
    """On a chain nothing is random: the left side is the error of the n-step returns themselves."""
    rewards, v = rng(4).normal(size=6), np.append(rng(5).normal(size=6), 0.0)
    mdp = chain(rewards)
    G = n_step_return(rewards, v, GAMMA, 3)
    left, _ = error_reduction(mdp, uniform_policy(mdp), v, 3, GAMMA)
    close(left, np.abs(G - discounted_returns(rewards, GAMMA)).max())


# ---------------------------------------------------------------------- traces


COURSES = {
    "accumulating": [1, 1.8, 2.44, 1.952, 1.5616, 1.2493, 1.9994],
    "dutch": [1, 1.4, 1.56, 1.248, 0.9984, 0.7987, 1.3195],
    "replacing": [1, 1, 1, 0.8, 0.64, 0.512, 1],
}


@pytest.mark.parametrize("kind", TRACES)
def test_traces_of_figure_26(kind):
    course = trace_course([0, 1, 2, 6], 10, 0.8, kind, 0.5)
    np.testing.assert_allclose(course[:7], COURSES[kind], atol=5e-5)
    close(course[7:], course[6] * 0.8 ** np.arange(1, 4))


def test_dutch_as_printed_shrinks_all_traces():
    course = trace_course([0, 1, 2], 4, 0.8, "dutch as printed", 0.5)
    close(course, [1, 1.4, 1.56, 0.624])


def test_traces_visited_for_ever():
    for kind, limit in (("accumulating", 5.0), ("dutch", 1 / 0.6), ("replacing", 1.0)):
        close(trace_course(range(300), 300, 0.8, kind, 0.5)[-1], limit)


def test_a_trace_decays_by_itself():
    close(trace_course([0], 6, 0.8, "accumulating"), 0.8 ** np.arange(6))


def test_alpha_of_a_dutch_trace_interpolates():
    e, visited = np.array([0.5, 2.0, 0.0]), np.array([1, 0, 0])
    dutch = trace_update(e, visited, 0.8, "dutch", 1.0)
    same(dutch, trace_update(e, visited, 0.8, "replacing"))
    close(trace_update(e, visited, 0.8, "dutch", 1e-14), trace_update(e, visited, 0.8, "accumulating"))
    close(trace_update(e, visited, 0.8, "accumulating"), [1.4, 1.6, 0.0])


# ---------------------------------------------------------------------- forward and backward view


def prediction_world():
    mdp = awkward(start=0)
    return mdp, uniform_policy(mdp)


@pytest.mark.parametrize("lam", [0.0, 0.5, 0.9, 1.0])
def test_backward_view_matches_forward_view(lam):
    rewards, alpha = np.array([1.0, -2.0, 0.5, 3.0]), 1e-6
    run = td_lambda(chain(rewards), np.ones((5, 1)), 0.9, lam, 1, alpha=alpha, rng=rng())
    G = lambda_return(rewards, np.zeros(4), 0.9, lam)
    np.testing.assert_allclose(run.V[:4] / alpha, G, rtol=1e-4)


@pytest.mark.parametrize("lam", [0.0, 0.4, 0.9, 1.0])
@pytest.mark.parametrize("max_steps", [None, 4])
def test_offline_td_lambda_is_the_lambda_return_algorithm(lam, max_steps):
    mdp, pi = prediction_world()
    options = dict(alpha=0.05, V0=rng(1).normal(size=7), max_steps=max_steps, record=1)
    backward = td_lambda(mdp, pi, GAMMA, lam, 50, online=False, rng=rng(2), **options)
    forward = offline_lambda_return(mdp, pi, GAMMA, lam, 50, reading="summed", rng=rng(2), **options)
    close(backward.history, forward.history)
    same(backward.returns, forward.returns)
    assert np.abs(np.diff(backward.history, axis=0)).max() > 0.1


@pytest.mark.parametrize("cut", [False, True])
def test_increments_of_one_episode_agree(cut):
    mdp, pi = prediction_world()
    V = rng(1).normal(size=7)
    options = dict(alpha=0.1, V0=V, online=False, max_steps=8, record=1)
    seed = next(k for k in range(99) if (td_lambda(mdp, pi, GAMMA, LAM, 1, rng=rng(k), **options).lengths == 8) == cut)
    run, [path] = recorded(td_lambda, mdp, pi, GAMMA, LAM, 1, rng=rng(seed), **options)
    states, _, rewards = arrays(path)
    states = states if cut else states[:-1]
    forward = forward_increments(states, rewards, np.where(mdp.terminal, 0, V), GAMMA, LAM, 0.1)
    for trace in TRACES:
        backward = backward_increments(states, rewards, np.where(mdp.terminal, 0, V), GAMMA, LAM, 0.1, trace)
        run = td_lambda(mdp, pi, GAMMA, LAM, 1, trace=trace, rng=rng(seed), **options)
        close(run.history[1] - run.history[0], backward.sum(axis=0))
        if trace == "accumulating":
            close(forward.sum(axis=0), backward.sum(axis=0))
    assert ((forward != 0).sum(axis=1) <= 1).all()


def test_backward_increments_by_hand():
    """States 0, 1, 0; V = (1, 2); gamma lam = 0.45; the episode ends."""
    increments = backward_increments([0, 1, 0], [1.0, 0.0, 3.0], [1.0, 2.0], 0.9, 0.5, 0.1)
    delta = np.array([1 + 1.8 - 1, 0.9 - 2, 3 - 1])
    E = np.array([[1, 0], [0.45, 1], [1.2025, 0.45]])
    close(increments, 0.1 * delta[:, None] * E)
    forward = forward_increments([0, 1, 0], [1.0, 0.0, 3.0], [1.0, 2.0], 0.9, 0.5, 0.1)
    L = lambda_return([1.0, 0.0, 3.0], [1.0, 2.0, 1.0], 0.9, 0.5)
    close(forward, 0.1 * np.array([[L[0] - 1, 0], [0, L[1] - 2], [L[2] - 1, 0]]))


def test_td_errors_add_up_to_the_return():
    rewards, values = some_episode()
    delta = rewards + GAMMA * np.append(values[1:9], 0) - values[:9]
    close(GAMMA ** np.arange(9) @ delta, discounted_return(rewards, GAMMA) - values[0])


# ---------------------------------------------------------------------- limits: TD(0), Monte Carlo, SARSA, Q-learning


@pytest.mark.parametrize("max_steps", [None, 5])
def test_lambda_0_and_one_step_are_td0(max_steps):
    mdp, pi = prediction_world()
    options = dict(alpha=0.3, V0=0.5, max_steps=max_steps, record=1)
    expected = td0(mdp, pi, GAMMA, 30, rng=rng(4), **options)
    for trace in TRACES:
        run = td_lambda(mdp, pi, GAMMA, 0.0, 30, trace=trace, rng=rng(4), **options)
        same(run.history, expected.history)
        same(run.lengths, expected.lengths)
        same(run.returns, expected.returns)
    same(n_step_td(mdp, pi, GAMMA, 1, 30, rng=rng(4), **options).history, expected.history)
    close(true_online_td_lambda(mdp, pi, GAMMA, 0.0, 30, rng=rng(4), **options).history, expected.history)
    one_step = offline_lambda_return(mdp, pi, GAMMA, 0.0, 30, reading="recomputed", rng=rng(4), **options)
    close(one_step.history, expected.history)


def every_visit(V, path, alpha, gamma):
    """V after the summed constant-alpha Monte Carlo increments of an episode."""
    states, _, rewards = arrays(path)
    change = np.zeros_like(V)
    np.add.at(change, states[:-1], alpha * (discounted_returns(rewards, gamma) - V[states[:-1]]))
    return V + change


def test_lambda_1_and_many_steps_are_monte_carlo():
    mdp, pi = prediction_world()
    options = dict(alpha=0.02, V0=1.0, record=1)
    run, paths = recorded(td_lambda, mdp, pi, GAMMA, 1.0, 30, online=False, rng=rng(5), **options)
    V = run.history[0]
    for k, path in enumerate(paths):
        V = every_visit(V, path, 0.02, GAMMA)
        close(run.history[k + 1], V)
    close(n_step_td(mdp, pi, GAMMA, 10_000, 30, online=False, rng=rng(5), **options).history, run.history)
    summed = offline_lambda_return(mdp, pi, GAMMA, 1.0, 30, reading="summed", rng=rng(5), **options)
    close(summed.history, run.history)


def test_lambda_1_with_replacing_traces_is_first_visit_monte_carlo():
    """Off line and undiscounted. Source: Singh and Sutton (1996)."""
    mdp, pi = prediction_world()
    options = dict(alpha=0.1, V0=1.0, record=1)
    run = td_lambda(mdp, pi, 1.0, 1.0, 30, trace="replacing", online=False, rng=rng(5), **options)
    first = constant_alpha_mc(mdp, pi, 1.0, 30, first_visit=True, rng=rng(5), **options)
    close(run.history, first.history)


@pytest.mark.parametrize("trace", TRACES)
@pytest.mark.parametrize("max_steps", [None, 6])
def test_sarsa_lambda_0_is_sarsa(trace, max_steps):
    options = dict(alpha=0.3, epsilon=0.2, Q0=0.5, max_steps=max_steps, record=1)
    for mdp in (awkward(start=0), windy_gridworld()):
        expected = sarsa(mdp, GAMMA, 20, rng=rng(6), **options)
        run = sarsa_lambda(mdp, GAMMA, 0.0, 20, trace=trace, rng=rng(6), **options)
        for field in ("history", "Q", "V", "policy", "returns", "lengths"):
            same(getattr(run, field), getattr(expected, field))


@pytest.mark.parametrize("trace", TRACES)
def test_watkins_lambda_0_is_q_learning(trace):
    """Where no state follows itself: there the box of figure 29 chooses before the update, Q-learning after it."""
    moves = {(s, a): [(0.5, s + 1 + a, 1.0 + a), (0.5, s - 1 if s else 3, -1.0)] for s in range(5) for a in (0, 1)}
    mdp, Q = FiniteMDP.from_outcomes(moves, start=0, n_states=7), np.zeros((7, 2))
    for k in range(50):  # an episode at a time, for at its end the box draws one more action
        options = dict(alpha=0.3, epsilon=0.3, Q0=Q)
        run = watkins_q_lambda(mdp, GAMMA, 0.0, 1, trace=trace, rng=rng(k), **options)
        same(run.Q, q_learning(mdp, GAMMA, 1, rng=rng(k), **options).Q)
        Q = run.Q
    assert np.abs(Q).max() > 1


# ---------------------------------------------------------------------- step by step against the definitions


@pytest.mark.parametrize("n", [2, 3, 7])
@pytest.mark.parametrize("online", [True, False])
@pytest.mark.parametrize("max_steps", [None, 5])
def test_n_step_td_is_its_definition(n, online, max_steps):
    mdp, pi = prediction_world()
    options = dict(alpha=0.2, V0=rng(1).normal(size=7), online=online, max_steps=max_steps, record=1)
    run, paths = recorded(n_step_td, mdp, pi, GAMMA, n, 12, rng=rng(7), **options)
    V = run.history[0].copy()
    for k, path in enumerate(paths):
        states, _, rewards = arrays(path)
        T, change = rewards.size, np.zeros_like(V)
        for now in range(1, T + n):  # at time `now` the increment of time now - n is known
            t = now - n
            if t >= 0:
                h = min(now, T)
                G = discounted_return(rewards[t:h], GAMMA) + GAMMA ** (h - t) * V[states[h]]  # V = 0 at the end
                (V if online else change)[states[t]] += 0.2 * (G - V[states[t]])
        V += change
        close(run.history[k + 1], V)
    assert len(paths) == 12 and max(len(path) for path in paths) > 4


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("max_steps", [None, 5])
def test_offline_lambda_return_is_what_its_reading_says(reading, max_steps):
    mdp, pi = prediction_world()
    options = dict(alpha=0.2, V0=rng(1).normal(size=7), reading=reading, max_steps=max_steps, record=1)
    run, paths = recorded(offline_lambda_return, mdp, pi, GAMMA, LAM, 12, rng=rng(8), **options)
    V = run.history[0].copy()
    for k, path in enumerate(paths):
        states, _, rewards = arrays(path)
        before = V.copy()
        for t, s in enumerate(states[:-1]):
            L = lambda_return(rewards, (V if reading == "recomputed" else before)[states], GAMMA, LAM)
            V[s] += 0.2 * (L[t] - (before if reading == "summed" else V)[s])
        close(run.history[k + 1], V)


def test_long_episodes_are_kept_whole():
    """More steps than the first buffers hold."""
    rewards = rng(2).normal(size=700)
    mdp = chain(rewards)
    for reading in READINGS[:2]:
        run = offline_lambda_return(mdp, uniform_policy(mdp), 0.99, 0.95, 1, alpha=1.0, reading=reading, rng=rng())
        close(run.V[:-1], lambda_return(rewards, np.zeros(700), 0.99, 0.95))


@pytest.mark.parametrize("trace", TRACES)
@pytest.mark.parametrize("online", [True, False])
@pytest.mark.parametrize("gamma, lam", [(0.9, 0.7), (1.0, 1.0), (0.3, 0.1), (0.0, 0.5)])
def test_td_lambda_is_its_box(trace, online, gamma, lam):
    mdp, pi = prediction_world()
    options = dict(alpha=0.1, V0=1.0, trace=trace, online=online, record=1)
    run, paths = recorded(td_lambda, mdp, pi, gamma, lam, 15, rng=rng(9), **options)
    V = run.history[0].copy()
    for k, path in enumerate(paths):
        E, change = np.zeros(7), np.zeros(7)
        for s, _, r, s_next in path:
            delta = r + gamma * V[s_next] - V[s]
            E = trace_update(E, np.arange(7) == s, gamma * lam, trace, 0.1)
            (V if online else change)[:] += 0.1 * delta * E
        V += change
        close(run.history[k + 1], V)
    compiled_run = td_lambda(mdp, pi, gamma, lam, 15, rng=rng(9), **options)
    same(compiled_run.history, run.history)


@pytest.mark.parametrize("lam", [0.05, 0.5])
def test_traces_too_small_for_a_float(lam):
    """One long episode in which traces vanish and states come back: the same as by the box."""
    mdp = random_walk(60, rewards=(1.0, 2.0), start=30)
    pi, options = uniform_policy(mdp), dict(alpha=0.5, V0=1.0, max_steps=6000, record=1)
    seed = next(k for k in range(99) if td_lambda(mdp, pi, 0.5, lam, 1, rng=rng(k), **options).lengths[0] > 2500)
    run, [path] = recorded(td_lambda, mdp, pi, 0.5, lam, 1, rng=rng(seed), **options)
    V, E = run.history[0].copy(), np.zeros(62)
    for s, _, r, s_next in path:
        delta = r + 0.5 * V[s_next] - V[s]
        E *= 0.5 * lam
        E[s] += 1
        V += 0.5 * delta * E
    same(run.V, V)
    ring = loop(n_states=3)  # every state has a trace, and they are listed once
    run = td_lambda(ring, uniform_policy(ring), 0.9, 0.9, 1, alpha=0.1, max_steps=5000, rng=rng())
    close(run.V, 10)


def interim_lambda_return(states, rewards, weights, gamma, lam, t, h):
    """L_t of the rewards up to h; the n-step return to t + n bootstraps from the V of time t + n - 1."""
    G = [
        discounted_return(rewards[t:k], gamma) + gamma ** (k - t) * weights[k - 1][states[k]]
        for k in range(t + 1, h + 1)
    ]
    return lambda_weights(h - t, lam) @ G


@pytest.mark.parametrize("lam", [0.0, 0.6, 0.95, 1.0])
def test_true_online_td_lambda_is_the_online_lambda_return_algorithm(lam):
    """At each step V is what redoing all updates of the episode with the lambda-returns up to this step gives."""
    mdp, pi = prediction_world()
    V0 = np.where(mdp.terminal, 0.0, rng(1).normal(size=7))
    options = dict(alpha=0.3, V0=V0)
    seed = next(
        k for k in range(99) if true_online_td_lambda(mdp, pi, GAMMA, lam, 1, rng=rng(k), **options).lengths > 11
    )
    run, [path] = recorded(true_online_td_lambda, mdp, pi, GAMMA, lam, 1, rng=rng(seed), **options)
    states, _, rewards = arrays(path)
    weights = [V0]
    for h in range(1, rewards.size + 1):
        V = V0.copy()
        for t in range(h):
            L = interim_lambda_return(states, rewards, weights, GAMMA, lam, t, h)
            V[states[t]] += 0.3 * (L - V[states[t]])
        weights.append(V)
        up_to_here = true_online_td_lambda(mdp, pi, GAMMA, lam, 1, max_steps=h, rng=rng(seed), **options)
        close(up_to_here.V, V)
    close(run.V, V)
    two = true_online_td_lambda(mdp, pi, GAMMA, lam, 2, rng=rng(seed), **options)
    g = rng(seed)
    one = true_online_td_lambda(mdp, pi, GAMMA, lam, 1, rng=g, **options)
    again = true_online_td_lambda(mdp, pi, GAMMA, lam, 1, alpha=0.3, V0=one.V, rng=g)
    same(two.V, again.V)  # nothing but V passes from one episode to the next


def test_true_online_differs_from_dutch_traces_alone():
    mdp, pi = prediction_world()
    one = true_online_td_lambda(mdp, pi, GAMMA, 0.9, 5, alpha=0.5, rng=rng())
    two = td_lambda(mdp, pi, GAMMA, 0.9, 5, alpha=0.5, trace="dutch", rng=rng())
    assert np.abs(one.V - two.V).max() > 1e-3


def box(mdp, gamma, lam, n_episodes, alpha, epsilon, trace, Q, max_steps, cut, g):
    """Figures 28 and 29 over whole tables: (history, E after each step, lengths between cuts)."""
    history, traces, cuts, world = [Q.copy()], [], [], MDPEnv(mdp)
    world.reset(seed=0)
    world.np_random = g
    for _ in range(n_episodes):
        E, s = np.zeros_like(Q), world.reset()[0]
        a, terminated, t, last = epsilon_greedy(Q, s, epsilon, g), False, 0, 0
        while not terminated and t < max_steps:
            s_next, r, terminated, _, _ = world.step(a)
            a_next = epsilon_greedy(Q, s_next, epsilon, g)
            next_value = Q[s_next].max() if cut else Q[s_next, a_next]
            explores = cut and Q[s_next, a_next] < Q[s_next].max()
            delta = r + gamma * (0 if terminated else next_value) - Q[s, a]
            here = np.zeros(Q.shape, bool)
            here[s, a] = True
            E = trace_update(E, here, gamma * lam, trace, alpha)
            Q = Q + alpha * delta * E
            traces.append(E)
            t += 1
            if explores:
                E = np.zeros_like(E)
                cuts.append(t - last)
                last = t
            s, a = s_next, a_next
        history.append(Q.copy())
    return np.array(history), traces, cuts


@pytest.mark.parametrize("trace", TRACES)
@pytest.mark.parametrize("max_steps", [300, 7])
@pytest.mark.parametrize("learn", [sarsa_lambda, watkins_q_lambda])
def test_control_is_its_box(trace, max_steps, learn):
    for mdp in (awkward(start=0), dyna_maze()):
        Q0 = np.where(mdp.legal & ~mdp.terminal[:, None], rng(1).normal(size=mdp.legal.shape), 0.0)
        table = np.where(mdp.legal, Q0, -np.inf)
        table[mdp.terminal] = 0.0
        cut = learn is watkins_q_lambda
        history, traces, cuts = box(mdp, GAMMA, LAM, 8, 0.2, 0.3, trace, table, max_steps, cut, rng(5))
        options = dict(alpha=0.2, epsilon=0.3, trace=trace, Q0=Q0, max_steps=max_steps, record=1)
        run = learn(mdp, GAMMA, LAM, 8, rng=rng(5), **options)
        legal = np.isfinite(table)
        close(run.history[:, legal], history[:, legal])
        assert (run.history[:, ~legal] == -np.inf).all()
        if cut:
            same(run.cuts, cuts)
            assert len(cuts) > 1 or max_steps == 7


def test_all_traces_fall_at_an_exploratory_action():
    """cl-082: not only that of the exploratory pair. After each cut the next trace table holds one 1 and zeros."""
    mdp = awkward(start=0)
    table = np.where(mdp.legal, rng(1).normal(size=mdp.legal.shape), -np.inf)
    table[mdp.terminal] = 0.0
    for k in range(99):
        _, traces, cuts = box(mdp, GAMMA, LAM, 1, 0.2, 0.5, "accumulating", table, 100, True, rng(k))
        if len(cuts) > 1 and cuts[0] > 2 and sum(cuts) < len(traces):
            break
    assert len(cuts) > 1
    for t in np.cumsum(cuts):
        assert traces[t].max() == 1 and np.count_nonzero(traces[t]) == 1
    assert np.count_nonzero(traces[cuts[0] - 1]) > 1
    run = watkins_q_lambda(mdp, GAMMA, LAM, 1, alpha=0.2, epsilon=0.5, Q0=table, max_steps=100, rng=rng(k))
    same(run.cuts, cuts)


def test_sarsa_lambda_is_its_forward_view():
    """With a step size so small that Q stays put, each pair moves by the sum of L_t - Q over its visits."""
    mdp, alpha = awkward(start=0), 1e-9
    Q0 = rng(1).normal(size=mdp.legal.shape)
    run, [path] = recorded(sarsa_lambda, mdp, GAMMA, LAM, 1, alpha=alpha, epsilon=0.5, Q0=Q0, rng=rng(4))
    states, actions, rewards = arrays(path)
    values = Q0[states[:-1], actions]
    expected = np.zeros(Q0.shape)
    np.add.at(expected, (states[:-1], actions), lambda_return(rewards, values, GAMMA, LAM) - values)
    used = mdp.legal & ~mdp.terminal[:, None]
    np.testing.assert_allclose((run.Q - Q0)[used] / alpha, expected[used], atol=1e-5)
    assert len(path) > 5


def test_watkins_q_lambda_is_its_forward_view():
    """The lambda-return goes on to the next exploratory action, and takes the maximum there."""
    mdp, alpha = awkward(start=0), 1e-9
    Q0 = np.where(mdp.legal, rng(1).normal(size=mdp.legal.shape), -np.inf)
    Q0[mdp.terminal] = 0.0
    settings = dict(alpha=alpha, epsilon=0.4, Q0=Q0)
    seed = next(k for k in range(99) if watkins_q_lambda(mdp, GAMMA, LAM, 1, rng=rng(k), **settings).cuts.size > 2)
    run, [path] = recorded(watkins_q_lambda, mdp, GAMMA, LAM, 1, rng=rng(seed), **settings)
    states, actions, rewards = arrays(path)
    T, expected = rewards.size, np.zeros(Q0.shape)
    explores = [Q0[s, a] < Q0[s].max() for s, a in zip(states, actions)]
    for t in range(T):
        h = next((k for k in range(t + 1, T) if explores[k]), T)
        L = lambda_return(rewards[t:h], Q0[states[t : h + 1]].max(axis=1), GAMMA, LAM)[0]
        expected[states[t], actions[t]] += L - Q0[states[t], actions[t]]
    legal = mdp.legal & ~mdp.terminal[:, None]
    np.testing.assert_allclose(((run.Q[legal] - Q0[legal]) / alpha), expected[legal], atol=1e-5)


def test_six_td_errors_are_credited_before_a_sixth_action_that_explores():
    """ex-trace-example, cl-080: rewards 1, 2, 4, ... show which TD errors reach the first pair."""
    moves = {(s, a): [(1.0, s + 1, 2.0**s)] for s in range(9) for a in (0, 1)}
    mdp, Q0 = FiniteMDP.from_outcomes(moves, start=0), np.tile([1.0, 0.0], (10, 1))
    options = dict(alpha=1e-9, epsilon=0.3, Q0=Q0)

    def first_six(run):
        return run.cuts.size and run.cuts[0] == 6 and run.Q[0, 0] != 1

    seed = next(k for k in range(999) if first_six(watkins_q_lambda(mdp, 1.0, 1.0, 1, rng=rng(k), **options)))
    run, [path] = recorded(watkins_q_lambda, mdp, 1.0, 1.0, 1, rng=rng(seed), **options)
    assert [a for _, a, _, _ in path][:7] == [0, 0, 0, 0, 0, 0, 1]
    assert (run.Q[0, 0] - 1) / 1e-9 == pytest.approx(2**6 - 1, rel=1e-5)
    assert (run.Q[5, 0] - 1) / 1e-9 == pytest.approx(2**5, rel=1e-5)


def test_delta_of_watkins_does_not_depend_on_the_next_action():
    mdp = awkward(start=0)
    Q0 = rng(1).normal(size=mdp.legal.shape)
    found = set()
    for k in range(40):
        options = dict(alpha=0.5, epsilon=1.0, Q0=Q0, max_steps=1)
        run, [[(s, a, r, s_next)]] = recorded(watkins_q_lambda, mdp, GAMMA, LAM, 1, rng=rng(k), **options)
        best = 0 if mdp.terminal[s_next] else Q0[s_next, mdp.legal[s_next]].max()
        close(run.Q[s, a], Q0[s, a] + 0.5 * (r + GAMMA * best - Q0[s, a]))
        found.add(int(run.cuts.size))
    assert found == {0, 1}  # greedy or not


def test_ties_count_as_greedy():
    mdp = dyna_maze()
    run = watkins_q_lambda(mdp, 0.95, 0.9, 1, alpha=0.1, epsilon=1.0, max_steps=20, rng=rng())
    assert run.cuts.size == 0  # all values are 0 until the goal is found


# ---------------------------------------------------------------------- ends, cuts, environments, records


def learners():
    """name: function of (world, rng, options), all with one signature."""
    found = {}
    for trace in TRACES:
        found[f"td_lambda {trace}"] = partial(_predict, td_lambda, LAM, trace=trace)
        found[f"sarsa_lambda {trace}"] = partial(_control, sarsa_lambda, trace=trace)
        found[f"watkins {trace}"] = partial(_control, watkins_q_lambda, trace=trace)
    for reading in READINGS:
        found[f"offline_lambda_return {reading}"] = partial(_predict, offline_lambda_return, LAM, reading=reading)
    for online in (True, False):
        found[f"n_step_td {online}"] = partial(_predict, n_step_td, 3, online=online)
    found["td_lambda off line"] = partial(_predict, td_lambda, LAM, online=False)
    found["true online"] = partial(_predict, true_online_td_lambda, LAM)
    return found


def _predict(learn, how, world, g, n_episodes=20, gamma=GAMMA, alpha=0.3, first=0.5, record=1, **options):
    mdp = getattr(getattr(world, "unwrapped", world), "mdp", world)
    pi = uniform_policy(mdp) if isinstance(mdp, FiniteMDP) else np.ones((world.observation_space.n, 1))
    return learn(world, pi, gamma, how, n_episodes, alpha=alpha, V0=first, record=record, rng=g, **options)


def _control(learn, world, g, n_episodes=20, gamma=GAMMA, alpha=0.3, first=0.5, record=1, **options):
    options = dict(epsilon=0.2) | options
    return learn(world, gamma, LAM, n_episodes, alpha=alpha, Q0=first, record=record, rng=g, **options)


LEARNERS = learners()
every_learner = pytest.mark.parametrize("learn", LEARNERS.values(), ids=LEARNERS)


def table(run):
    return run.V if run.Q is None else run.Q


@every_learner
def test_an_environment_gives_the_bits_of_its_process(learn):
    mdp = awkward(start=0)
    one, two = learn(mdp, rng(1)), learn(MDPEnv(mdp), rng(1))
    for field in ("returns", "lengths", "V", "Q", "policy", "history", "cuts"):
        same(getattr(one, field, None), getattr(two, field, None))
    same(table(one), table(learn(mdp, rng(1))))


@every_learner
def test_a_truncated_episode_is_one_cut_by_max_steps(learn):
    mdp = awkward(start=0)
    one, two = learn(mdp, rng(1), max_steps=3), learn(gym.wrappers.TimeLimit(MDPEnv(mdp), 3), rng(1))
    same(one.history, two.history)
    same(one.lengths, two.lengths)
    assert one.lengths.max() == 3 and one.lengths.min() < 3


@every_learner
def test_a_cut_bootstraps(learn):
    run = learn(loop(), rng(), n_episodes=1, gamma=0.5, alpha=1.0, first=10.0, max_steps=1)
    assert table(run).item() == 1 + 0.5 * 10


class Ending(gym.Env):
    """One step with reward 1 from state 0, then the end, which is state 0 again: only `terminated` tells."""

    observation_space, action_space = gym.spaces.Discrete(1), gym.spaces.Discrete(1)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return 0, {}

    def step(self, action):
        return 0, 1.0, True, False, {}


@every_learner
def test_an_end_does_not_bootstrap(learn):
    run = learn(Ending(), rng(), n_episodes=1, alpha=1.0, first=10.0)
    assert table(run).item() == 1 and run.lengths[0] == 1 and run.returns[0] == 1


@every_learner
def test_history_keeps_every_record_th_table(learn):
    mdp = awkward(start=0)
    full, some, none = (learn(mdp, rng(1), record=k) for k in (1, 6, 0))
    same(full.history[::6], some.history)
    same(full.history[-1], table(full))
    assert full.history.shape == (21, *table(full).shape) and none.history is None
    same(table(none), table(full))
    assert (full.returns.shape, full.lengths.shape) == ((20,), (20,)) and full.lengths.dtype == np.int64
    _, paths = recorded(learn, mdp, rng(1))
    same(full.lengths, [len(path) for path in paths])
    close(full.returns, [sum(r for _, _, r, _ in path) for path in paths])


def test_control_returns_greedy_values_and_a_soft_policy():
    mdp = awkward(start=0)
    for learn in (sarsa_lambda, watkins_q_lambda):
        run = learn(mdp, GAMMA, LAM, 20, alpha=0.3, epsilon=0.2, rng=rng())
        same(run.V, run.Q.max(axis=1))
        close(run.policy.sum(axis=1), 1)
        assert ((run.policy > 0) == mdp.legal)[~mdp.terminal].all()
        assert (run.policy[np.arange(7), run.Q.argmax(axis=1)] >= 0.8).all() or mdp.n_actions > 2


def test_first_estimates_are_not_changed():
    mdp, pi = prediction_world()
    V0, Q0 = np.ones(7), np.ones(mdp.legal.shape)
    td_lambda(mdp, pi, GAMMA, LAM, 3, alpha=0.5, V0=V0, rng=rng())
    sarsa_lambda(mdp, GAMMA, LAM, 3, alpha=0.5, epsilon=0.1, Q0=Q0, rng=rng())
    assert (V0 == 1).all() and (Q0 == 1).all()


def digests():
    found = {}
    for name, learn in LEARNERS.items():
        for k, mdp in enumerate((awkward(start=0), random_walk(19))):
            run = learn(mdp, rng(k))
            parts = [x for x in (*vars(run).values(),) if x is not None]
            found[f"{name} {k}"] = hashlib.sha256(
                b"".join(np.ascontiguousarray(x).tobytes() for x in parts)
            ).hexdigest()
    rewards, values = some_episode()
    for name, x in dict(
        n=n_step_return(rewards, values, GAMMA, 3), L=lambda_return(rewards, values, GAMMA, LAM)
    ).items():
        found[name] = hashlib.sha256(x.tobytes()).hexdigest()
    return found


@pytest.mark.long
@pytest.mark.skipif(not compiled.HAVE_NUMBA, reason="numba is absent or switched off")
def test_compiled_and_interpreted_results_have_the_same_bits():
    code = "import json, test_traces as t; assert not t.compiled.HAVE_NUMBA; print(json.dumps(t.digests()))"
    paths = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "PYTHONPATH": paths, "RLCORE_NO_NUMBA": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    interpreted, here = json.loads(done.stdout), digests()
    assert here.keys() == interpreted.keys() and len(here) > 30
    assert [name for name in here if here[name] != interpreted[name]] == []


# ---------------------------------------------------------------------- exact values


@pytest.mark.parametrize("learn", ["td_lambda accumulating", "td_lambda dutch", "td_lambda replacing", "true online"])
def test_v_pi_is_learned(learn):
    """The mean of V from episode 5000 on. Worst error over 20 seeds 0.18; with gamma left out at least 0.88."""
    mdp, pi = prediction_world()
    run = LEARNERS[learn](mdp, rng(), n_episodes=20_000, alpha=0.003)
    np.testing.assert_allclose(run.history[5000:].mean(axis=0), solve_policy(mdp, pi, GAMMA), atol=0.4)
    np.testing.assert_array_equal(run.V, run.history[-1])


def test_q_pi_of_the_random_policy_is_learned_by_sarsa_lambda():
    """The mean of Q from episode 20,000 on. Worst error over 20 seeds 0.11; with gamma left out at least 1.17."""
    mdp, pi = prediction_world()
    q_pi = q_from_v(mdp, solve_policy(mdp, pi, GAMMA), GAMMA)
    run = sarsa_lambda(mdp, GAMMA, 0.5, 80_000, alpha=0.005, epsilon=1.0, record=4000, rng=rng())
    used = mdp.legal & ~mdp.terminal[:, None]
    np.testing.assert_allclose(run.history[5:].mean(axis=0)[used], q_pi[used], atol=0.3)


def test_watkins_learns_the_shortest_path():
    mdp = dyna_maze()
    run = watkins_q_lambda(mdp, 0.95, 0.9, 2000, alpha=0.5, epsilon=0.3, Q0=0.6, record=0, rng=rng())
    best = value_iteration(mdp, 0.95, tol=1e-9).V
    start = int(mdp.start.argmax())
    assert run.V[start] == pytest.approx(best[start], abs=1e-6) and best[start] == pytest.approx(0.95**13)


# ---------------------------------------------------------------------- published numbers


WALK, TRUE = random_walk(19), np.arange(-9, 10) / 10


def errors(learn, n_runs=100, **options):
    """RMS error of the 19-state walk over the first 10 episodes, a number for each run."""
    options |= dict(max_steps=10**6, record=1)
    runs = [learn(WALK, np.ones((21, 1)), 1.0, rng=g, **options) for g in rng(0).spawn(n_runs)]
    return np.array([np.sqrt(((run.history[1:, 1:20] - TRUE) ** 2).mean(axis=1)).mean() for run in runs])


def test_walk19_before_learning():
    assert np.sqrt((TRUE**2).mean()) == pytest.approx(REFERENCE["walk19.initial_rms"]["value"], abs=1e-12)


GRIDS = {
    "walk19.lambda_return[time_order]": partial(offline_lambda_return, reading="in order"),
    "walk19.lambda_return[summed]": partial(offline_lambda_return, reading="summed"),
    "walk19.lambda_return[recomputed]": partial(offline_lambda_return, reading="recomputed"),
    "walk19.td_lambda[true_online_dutch]": true_online_td_lambda,
    "walk19.td_lambda[replacing]": partial(td_lambda, trace="replacing"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", GRIDS)
def test_walk19_grids(name):
    """Figures 12.3 and 12.8 of Sutton and Barto (2018): every other cell, and the best, in its band for 100 runs."""
    entry, n_cells = REFERENCE[name], 0
    value = entry["value"]
    for i, lam in enumerate(value["rows"]["lambda"]):
        for j, alpha in enumerate(value["alphas"][i]):
            expected, sd = value["grid"][i][j], entry["sd_run"][i][j]
            best = value["best_at"] == {"lambda": lam, "alpha": alpha}
            if alpha == 0 or expected is None or expected > 0.55 or not (best or (i + j) % 2):
                continue
            n = 40 if "recomputed" in name else 100
            band = 4 * sd * (1 / np.sqrt(n) + 1 / np.sqrt(entry["runs_ref"]))
            found = errors(partial(GRIDS[name], lam=lam, n_episodes=10, alpha=alpha), n).mean()
            assert abs(found - expected) < band, (lam, alpha, found, expected, band)
            n_cells += 1
    assert n_cells > 8


def test_walk19_readings_in_order_of_their_best_errors():
    best = {name: REFERENCE[f"walk19.lambda_return[{name}]"]["value"]["best"] for name in ("time_order", "summed")}
    assert best["time_order"] == pytest.approx(0.261, abs=5e-4) and best["summed"] == pytest.approx(0.348, abs=5e-4)


NSTEP = [(n, alpha, rms, 0.012, True) for n, alpha, rms in REFERENCE["walk19.nstep_best_per_n"]["value"]]
NSTEP += [(1, 0.8, 0.344, 0.012, True), (2, 0.6, 0.273, 0.012, True), (4, 0.4, 0.259, 0.014, True)]
NSTEP += [(8, 0.25, 0.272, 0.015, True), (16, 0.14, 0.307, 0.014, True), (64, 0.06, 0.415, 0.016, True)]
NSTEP += [(512, 0.02, 0.492, 0.017, True), (1, 0.22, 0.470, 0.02, False), (8, 0.14, 0.330, 0.02, False)]
NSTEP += [(16, 0.1, 0.343, 0.02, False), (64, 0.04, 0.427, 0.02, False)]


@pytest.mark.parametrize("n, alpha, rms, band, online", NSTEP)
def test_walk19_n_step(n, alpha, rms, band, online):
    assert errors(partial(n_step_td, n=n, n_episodes=10, alpha=alpha, online=online)).mean() == pytest.approx(
        rms, abs=band
    )


BEST = {
    "accumulating": [(0.0, 0.8, 0.344), (0.4, 0.7, 0.269), (0.8, 0.3, 0.258), (0.9, 0.2, 0.286), (0.95, 0.1, 0.333)],
    "dutch": [(0.4, 0.7, 0.269), (0.8, 0.4, 0.248), (0.9, 0.3, 0.269), (0.95, 0.2, 0.306), (1.0, 0.03, 0.488)],
    "replacing": [(0.4, 0.7, 0.269), (0.8, 0.5, 0.243), (0.9, 0.4, 0.251), (0.95, 0.35, 0.268), (1.0, 0.25, 0.366)],
}
BEST["accumulating"] += [(1.0, 0.02, 0.505), (0.975, 0.07, 0.377)]
BEST["replacing"] += [(0.975, 0.35, 0.292)]


@pytest.mark.parametrize("trace", TRACES)
def test_walk19_td_lambda_at_the_best_step_size(trace):
    """Band: 4 standard errors of 100 runs (0.06) and as many of the 400 of the published mean."""
    for lam, alpha, rms in BEST[trace]:
        found = errors(partial(td_lambda, lam=lam, n_episodes=10, alpha=alpha, trace=trace))
        assert found.mean() == pytest.approx(rms, abs=4 * found.std() * (0.1 + 0.05) + 5e-4), (lam, alpha)


WINDY = [name for name in REFERENCE if name.startswith("windy")]


@pytest.mark.parametrize("name", WINDY)
def test_windy_gridworld(name):
    entry = REFERENCE[name]
    trace, alpha = name.split("[")[1].rstrip("]").split(",")[1], entry["settings"]["alpha"]
    learn = sarsa_lambda if "sarsa" in name else watkins_q_lambda
    options = dict(alpha=alpha, epsilon=0.1, trace=trace, record=0, max_steps=10**6)
    steps = [
        learn(windy_gridworld(), 1.0, entry["settings"]["lam"], 50, rng=g, **options).lengths.sum()
        for g in rng(0).spawn(50)
    ]
    assert np.mean(steps) == pytest.approx(entry["value"], abs=entry["band"])


MAZE = [(0.0, "accumulating", 3718), (0.5, "accumulating", 1076), (0.9, "accumulating", 1336)]
MAZE += [(0.9, "dutch", 1367), (0.9, "replacing", 1059)]


@pytest.mark.parametrize("lam, trace, steps", MAZE)
def test_maze_of_figure_28(lam, trace, steps):
    """Steps of the first ten episodes, 200 runs; band: 4 standard errors of each of the two means."""
    options = dict(alpha=0.1, epsilon=0.1, trace=trace, record=1)
    runs = [sarsa_lambda(DYNA_MAZE, 0.95, lam, 10, rng=g, **options) for g in rng(0).spawn(200)]
    found = np.array([run.lengths.sum() for run in runs])
    assert found.mean() == pytest.approx(steps, abs=8 * found.std() / np.sqrt(200))
    positive = np.mean([(run.history[1] > 0).sum() for run in runs])
    assert positive == (1 if lam == 0 else pytest.approx(145, abs=8))


RUNS = [(0.01, 9.2, 0.13), (0.05, 7.8, 0.17), (0.1, 6.5, 0.24), (0.2, 4.7, 0.35), (0.4, 2.9, 0.55), (0.8, 1.6, 0.85)]


@pytest.mark.parametrize("epsilon, mean, share", RUNS)
def test_cuts_of_figure_29(epsilon, mean, share):
    """100 runs; 200 give 9.24, 7.80, 6.53, 4.82, 2.95, 1.63."""
    options = dict(alpha=0.1, epsilon=epsilon, trace="replacing")
    runs = [watkins_q_lambda(DYNA_MAZE, 0.95, 0.9, 50, rng=g, **options) for g in rng(0).spawn(100)]
    cuts = np.concatenate([run.cuts for run in runs])
    assert cuts.mean() == pytest.approx(mean, abs=0.2 if epsilon > 0.1 else 0.6)
    assert (cuts <= 2).mean() == pytest.approx(share, abs=0.03)
    if epsilon == 0.1:
        assert np.mean([run.lengths.mean() for run in runs]) == pytest.approx(37, abs=2)
        slow = [watkins_q_lambda(DYNA_MAZE, 0.95, 0.0, 50, rng=g, **options) for g in rng(0).spawn(100)]
        assert np.mean([run.lengths.mean() for run in slow]) == pytest.approx(99, abs=4)


# ---------------------------------------------------------------------- bad input


PI = np.array([[0.5, 0.5, 0.0], [0.4, 0.3, 0.3]])
GOOD = {
    n_step_return: dict(rewards=[1.0, 2.0], values=[0.0, 1.0], gamma=0.9, n=1),
    complex_backup: dict(rewards=[1.0, 2.0], values=[0.0, 1.0], gamma=0.9, weights={1: 1.0}),
    lambda_return: dict(rewards=[1.0, 2.0], values=[0.0, 1.0], gamma=0.9, lam=0.5),
    lambda_weights: dict(T_minus_t=3, lam=0.5),
    error_reduction: dict(mdp=recycling_robot(), pi=PI, v=0.0, n=2, gamma=0.9),
    trace_update: dict(e=0.0, visited=1, gamma_lam=0.8, kind="dutch", alpha=0.5),
    trace_course: dict(visits=[0], n_steps=3, gamma_lam=0.8, kind="replacing"),
    forward_increments: dict(states=[0, 1], rewards=[1.0, 2.0], V=[0.0, 1.0], gamma=0.9, lam=0.5, alpha=0.1),
    backward_increments: dict(states=[0, 1], rewards=[1.0, 2.0], V=[0.0, 1.0], gamma=0.9, lam=0.5, alpha=0.1),
}
for _learn in (td_lambda, true_online_td_lambda, offline_lambda_return):
    GOOD[_learn] = dict(world=recycling_robot(), pi=PI, gamma=0.9, lam=0.5, n_episodes=2, alpha=0.1, max_steps=5)
GOOD[n_step_td] = dict(world=recycling_robot(), pi=PI, gamma=0.9, n=2, n_episodes=2, alpha=0.1, max_steps=5)
for _learn in (sarsa_lambda, watkins_q_lambda):
    GOOD[_learn] = dict(world=recycling_robot(), gamma=0.9, lam=0.5, n_episodes=2, alpha=0.1, epsilon=0.1, max_steps=5)
WRONG = {
    "rewards": [[], [[1.0]], [np.nan, 1.0], "ab"],
    "values": [[1.0], [0.0] * 4, [np.inf, 0.0], None],
    "gamma": [-0.1, 1.1, "a", np.nan],
    "n": [0, 1.5, -1],
    "weights": [{}, {1: 0.5}, {0: 1.0}, {1: 2.0, 2: -1.0}, 3],
    "lam": [-0.1, 1.1, None],
    "T_minus_t": [0, 2.5],
    "pi": [np.ones((2, 3)), np.ones((2, 2)), "a"],
    "v": [[1.0], np.nan],
    "visited": [2, 0.5],
    "gamma_lam": [-1, 1.5],
    "kind": ["none", None],
    "alpha": [0.0, 1.5, np.nan],
    "visits": [[3], [-1], [0.5]],
    "n_steps": [0],
    "states": [[0], [0, 1, 0, 1], [0, 2], [[0, 1]]],
    "V": [[[0.0]]],
    "world": [3, "robot", gym.make("CartPole-v1")],
    "n_episodes": [0, 1.5],
    "max_steps": [None, 0],
    "V0": [[1.0], np.nan],
    "Q0": [[1.0], np.nan, np.ones(3)],
    "epsilon": [-0.1, 1.1],
    "record": [-1, 0.5],
    "rng": [None, 3],
    "trace": ["none", None, "dutch as printed"],
    "reading": ["none"],
    "mdp": [3],
}
EXTRA = {"rng", "trace", "reading", "V0", "Q0", "record", "online"}
BAD = []
for _learn, _good in GOOD.items():
    _names = set(inspect.signature(_learn).parameters)
    assert set(_good) <= _names
    BAD += [(_learn, name, value) for name in sorted(_names & set(WRONG)) for value in WRONG[name]]


@pytest.mark.parametrize("learn, name, value", BAD, ids=lambda x: getattr(x, "__name__", None))
def test_bad_input_names_the_argument(learn, name, value):
    good = GOOD[learn] | ({"rng": rng()} if "world" in GOOD[learn] else {})
    if name == "alpha" and learn is trace_course:
        good = good | {"kind": "dutch", "alpha": 0.5}
    learn(**good)
    with pytest.raises(ValueError, match=f"^{name}: "):
        learn(**good | {name: value})
