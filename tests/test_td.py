import hashlib
import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from worlds import awkward

from rlcore.batch import batch_mc, batch_td, certainty_equivalence
from rlcore.bellman import greedy, q_from_v, solve_policy, v_from_q
from rlcore.core.compiled import HAVE_NUMBA
from rlcore.core.schedules import decaying
from rlcore.dp import value_iteration
from rlcore.envs import MDPEnv, cliff_walking, dyna_maze, random_mdp, random_walk, recycling_robot, windy_gridworld
from rlcore.mdp import FiniteMDP, Trajectory, deterministic_policy, discounted_returns, rollout, uniform_policy
from rlcore.monte_carlo import constant_alpha_mc, mc_prediction
from rlcore.policies import expected_value, soft_greedy
from rlcore.studies.ch02 import td0_groups
from rlcore.td import expected_sarsa, q_learning, sarsa, td0, td_error, td_target

REFERENCE = json.loads((Path(__file__).parent / "reference_td.json").read_text())
many_runs = pytest.mark.skipif(not HAVE_NUMBA, reason="millions of steps: too slow without numba")
PREDICTION = [partial(mc_prediction, max_steps=50), partial(constant_alpha_mc, alpha=0.1), partial(td0, alpha=0.1)]
CONTROL = [sarsa, expected_sarsa, q_learning]


def rng(seed=0):
    return np.random.default_rng(seed)


def chain(rewards):
    """State t -> t + 1 with rewards[t]; the last state is terminal."""
    n = len(rewards)
    return FiniteMDP.from_outcomes({(s, 0): [(1.0, s + 1, r)] for s, r in enumerate(rewards)}, start=0, n_states=n + 1)


def bouncer():
    """State 0 returns to itself with probability 3/4 and reward 1, else ends with reward 2."""
    P, R = np.zeros((2, 1, 2)), np.zeros((2, 1, 2))
    P[0, 0], R[0, 0], P[1, 0, 1] = [0.75, 0.25], [1.0, 2.0], 1.0
    return FiniteMDP.from_arrays(P, R, terminal=[False, True], start=0)


@pytest.mark.long
@pytest.mark.parametrize("first_visit", [True, False])
def test_one_episode_of_a_chain_gives_its_returns(first_visit):
    rewards = [-1.0, 2.0, 6.0, 3.0, 2.0]
    mdp = chain(rewards)
    args = dict(first_visit=first_visit, max_steps=10, record=1, rng=np.random.default_rng(0))
    run = mc_prediction(mdp, uniform_policy(mdp), 0.5, 1, **args)
    np.testing.assert_allclose(run.V, [2, 6, 8, 4, 2, 0], rtol=0, atol=0)
    assert run.returns[0] == 12 and run.lengths[0] == 5
    np.testing.assert_array_equal(run.history, [np.zeros(6), run.V])


def test_visits_are_averaged_as_the_box_says():
    """One episode of state 0 at times 0..T-1: first visit keeps G_0, every visit the mean of all G_t."""
    mdp, gamma = bouncer(), 0.9
    pi, seed = uniform_policy(mdp), 11
    rewards = rollout(mdp, pi, 100, s=0, rng=_after_start(mdp, seed)).rewards
    G = discounted_returns(rewards, gamma)
    assert G.size > 2  # a seed whose episode comes back to state 0
    first = mc_prediction(mdp, pi, gamma, 1, max_steps=100, rng=np.random.default_rng(seed))
    every = mc_prediction(mdp, pi, gamma, 1, first_visit=False, max_steps=100, rng=np.random.default_rng(seed))
    np.testing.assert_allclose([first.V[0], every.V[0]], [G[0], G.mean()], rtol=1e-14)


def _after_start(mdp, seed):
    """A generator that has drawn the first state already, as mc_prediction does."""
    rng = np.random.default_rng(seed)
    rng.random()
    return rng


def test_history_is_the_running_average():
    mdp = bouncer()
    run = mc_prediction(mdp, uniform_policy(mdp), 1.0, 50, max_steps=1000, record=1, rng=np.random.default_rng(0))
    np.testing.assert_allclose(run.history[1:, 0], np.cumsum(run.returns) / np.arange(1, 51), rtol=1e-12)


@pytest.mark.parametrize("first_visit", [True, False])
def test_random_walk_converges(first_visit):
    """True values i / 6. Worst error over 20 seeds 0.012; averaging only half of each return gives 0.4."""
    mdp = random_walk(5)
    args = dict(first_visit=first_visit, max_steps=10_000, rng=np.random.default_rng(1))
    run = mc_prediction(mdp, uniform_policy(mdp), 1.0, 20_000, **args)
    assert np.abs(run.V[1:6] - np.arange(1, 6) / 6).max() < 0.02


def test_action_values_average_to_state_values():
    """v_pi from Q. Worst error over 20 seeds 0.075 (values about 5); gamma 0.8 instead of 0.9 is off by 1.1."""
    mdp = ending(random_mdp(4, 3, rng=np.random.default_rng(5)))
    pi = uniform_policy(mdp)
    run = mc_prediction(mdp, pi, 0.9, 20_000, target="q", max_steps=10_000, rng=np.random.default_rng(0))
    assert run.V is None and run.Q.shape == (5, 3)
    assert np.abs(v_from_q(run.Q, pi) - solve_policy(mdp, pi, 0.9)).max() < 0.2


def ending(mdp):
    """The same process with a chance of 1/5 to end at every step, in one more state."""
    S, A = mdp.n_states, mdp.n_actions
    P, R = np.zeros((S + 1, A, S + 1)), np.zeros((S + 1, A))
    P[:S, :, :S], P[:S, :, S], R[:S] = 0.8 * mdp.transition_probs(), 0.2, 1 + mdp.expected_reward()
    return FiniteMDP.from_arrays(P, R, terminal=np.arange(S + 1) == S)


def test_a_deterministic_policy_leaves_gaps():
    mdp = recycling_robot()
    args = dict(target="q", max_steps=50, rng=np.random.default_rng(0))
    Q = mc_prediction(mdp, deterministic_policy(mdp, [0, 2]), 0.9, 100, **args).Q
    assert Q[0, 1] == Q[1, 0] == Q[1, 1] == 0 and Q[0, 0] > 5 and Q[1, 2] > 5
    assert Q[0, 2] == -np.inf  # no recharging when the charge is high


def test_a_cut_episode_counts_up_to_the_cut():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)]})
    run = mc_prediction(mdp, np.ones((1, 1)), 0.5, 3, max_steps=4, rng=np.random.default_rng(0))
    assert run.V[0] == 1 + 0.5 + 0.25 + 0.125 and (run.lengths == 4).all() and (run.returns == 4).all()


def test_td0_on_a_chain_by_hand():
    """Each step V(s) += alpha (r + gamma V(s') - V(s)) with the values of that moment; the end counts 0."""
    mdp = chain([1.0, -2.0, 4.0])
    run = td0(mdp, uniform_policy(mdp), 0.5, 2, alpha=0.1, V0=1.0, record=1, rng=np.random.default_rng(0))
    V = np.array([1.0, 1.0, 1.0, 0.0])
    for episode in (1, 2):
        for s, r in enumerate([1.0, -2.0, 4.0]):
            V[s] += 0.1 * (r + 0.5 * V[s + 1] - V[s])
        np.testing.assert_allclose(run.history[episode], V, rtol=1e-14)
    np.testing.assert_array_equal(run.history[0], [1, 1, 1, 0])
    np.testing.assert_array_equal(run.V, run.history[-1])
    assert (run.lengths == 3).all() and (run.returns == 3).all()


def test_td0_with_step_one_and_gamma_zero_keeps_the_last_reward():
    mdp = chain([1.0, -2.0, 4.0])
    run = td0(mdp, uniform_policy(mdp), 0.0, 1, alpha=1.0, V0=9.0, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(run.V, [1, -2, 4, 0])


def test_td0_random_walk():
    """Sutton and Barto (2018), example 6.2. Worst error over 20 seeds 0.046 with alpha 0.01; V0 is off by 0.33."""
    mdp = random_walk(5)
    run = td0(mdp, uniform_policy(mdp), 1.0, 5000, alpha=0.01, V0=0.5, rng=np.random.default_rng(0))
    assert np.abs(run.V[1:6] - np.arange(1, 6) / 6).max() < 0.1


def test_a_cut_bootstraps_and_an_end_does_not():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)]})
    run = td0(mdp, np.ones((1, 1)), 0.5, 1, alpha=1.0, V0=10.0, max_steps=1, rng=np.random.default_rng(0))
    assert run.V[0] == 1 + 0.5 * 10 and run.lengths[0] == 1
    mdp = chain([1.0])
    run = td0_groups(mdp, np.ones((2, 1)), 0.5, 1, alpha=1.0, groups=[0, 0], w0=10.0, rng=np.random.default_rng(0))
    assert run.V[0] == 1 and run.V[1] == 0  # though the end shares a group with a value of 10


def test_groups_share_one_value():
    """The fixed point of TD(0) with two groups is 5/11 and 6/11: visits weigh the two ends of each group.

    Worst error over 20 seeds 0.05; the average of each group's true values would be 3/11 and 8/11, V0 is off by 0.55.
    """
    mdp = random_walk(10)
    groups = np.r_[0, np.repeat([0, 1], 5), 1]
    args = dict(alpha=0.002, w0=0.0, record=100, rng=np.random.default_rng(0))
    run = td0_groups(mdp, uniform_policy(mdp), 1.0, 3000, groups=groups, **args)
    assert np.unique(run.V[1:6]).size == np.unique(run.V[6:11]).size == 1
    assert run.V[0] == run.V[11] == 0 and run.history.shape == (31, 12)
    np.testing.assert_allclose(run.V[[1, 6]], [5 / 11, 6 / 11], atol=0.08)
    np.testing.assert_array_equal(run.V[1:11], run.weights[groups[1:11]])
    own = td0(mdp, uniform_policy(mdp), 1.0, 50, alpha=0.1, record=1, rng=rng())
    same = td0_groups(mdp, uniform_policy(mdp), 1.0, 50, alpha=0.1, groups=range(12), record=1, rng=rng())
    np.testing.assert_array_equal(own.history, same.history)
    np.testing.assert_array_equal(own.visits, same.visits)


def test_groups_reach_the_fixed_point_of_their_own_equation():
    """sum over the states s of a group of d(s) (r + w(s') - w(s)) = 0, d expected visits.

    Worst error over 10 seeds 0.016; V0 is off by 0.045, the mean of a group's true values by 0.18.
    """
    mdp, gamma = random_walk(10), 1.0
    P, r = mdp.transition_probs()[1:11, 0], mdp.expected_reward()[1:11, 0]
    visits = np.linalg.solve(np.eye(10) - P[:, 1:11].T, mdp.start[1:11])
    X = np.kron(np.eye(2), np.ones((5, 1)))  # (10, 2), the group of each state
    w = np.linalg.solve(X.T @ (visits[:, None] * (X - gamma * P[:, 1:11] @ X)), X.T @ (visits * r))
    groups = np.r_[0, np.repeat([0, 1], 5), 1]
    run = td0_groups(mdp, uniform_policy(mdp), gamma, 20_000, alpha=0.001, w0=0.5, groups=groups, rng=rng())
    np.testing.assert_allclose(run.V[[1, 6]], w, atol=0.03)


@pytest.mark.parametrize("first_visit", [True, False])
def test_constant_alpha_with_one_over_n_is_the_sample_mean(first_visit):
    for mdp in (bouncer(), random_walk(5), awkward()):
        pi = uniform_policy(mdp)
        args = dict(first_visit=first_visit, record=1)
        mean = mc_prediction(mdp, pi, 0.9, 60, max_steps=10_000, rng=rng(4), **args)
        run = constant_alpha_mc(mdp, pi, 0.9, 60, alpha=decaying(1.0), rng=rng(4), **args)
        np.testing.assert_allclose(run.history, mean.history, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(run.lengths, mean.lengths)
        np.testing.assert_allclose(run.returns, mean.returns, rtol=1e-14)


def test_constant_alpha_updates_from_the_last_state_back():
    """The same state at each time: V is moved by the last return first."""
    mdp, pi = bouncer(), np.ones((2, 1))
    rewards = rollout(mdp, pi, 100, s=0, rng=_after_start(mdp, 11)).rewards
    V = 5.0
    for G in discounted_returns(rewards, 0.9)[::-1]:
        V += 0.3 * (G - V)
    run = constant_alpha_mc(mdp, pi, 0.9, 1, alpha=0.3, V0=5.0, rng=rng(11))
    assert rewards.size > 2 and run.V[0] == pytest.approx(V, rel=1e-14) and run.V[1] == 0
    first = constant_alpha_mc(mdp, pi, 0.9, 1, alpha=0.3, V0=5.0, first_visit=True, rng=rng(11))
    assert first.V[0] == pytest.approx(5 + 0.3 * (discounted_returns(rewards, 0.9)[0] - 5), rel=1e-14)


def test_constant_alpha_keeps_episodes_of_any_length():
    """More than the 64 steps that there is room for at first."""
    mdp = chain(np.arange(300.0))
    run = constant_alpha_mc(mdp, uniform_policy(mdp), 0.9, 1, alpha=1.0, rng=rng())
    np.testing.assert_allclose(run.V[:-1], discounted_returns(np.arange(300.0), 0.9), rtol=1e-14)


def test_a_step_size_may_fall_with_the_visits_of_the_state():
    mdp, rewards = chain([1.0, -2.0, 4.0]), [1.0, -2.0, 4.0]
    run = td0(mdp, uniform_policy(mdp), 0.5, 3, alpha=decaying(0.5, rate=2.0, power=0.7), V0=1.0, rng=rng())
    V = np.array([1.0, 1.0, 1.0, 0.0])
    for n in range(3):
        for s, r in enumerate(rewards):
            V[s] += 0.5 / (1 + 2 * n) ** 0.7 * (r + 0.5 * V[s + 1] - V[s])
    np.testing.assert_allclose(run.V, V, rtol=1e-14)


def test_driving_home():
    """43 - 30 = 13 minutes for the first prediction by Monte Carlo, 40 - 30 = 10 by TD(0). Example 6.1."""
    expected, data = REFERENCE["driving_home"]["value"], REFERENCE["driving_home"]["settings"]
    elapsed, to_go = np.array(data["elapsed"], float), np.array(data["predicted_to_go"], float)
    mdp, r = chain(np.diff(elapsed)), np.diff(elapsed)
    for learn, changes in ((constant_alpha_mc, "mc_error_alpha1"), (td0, "td_error_alpha1")):
        for alpha in (1.0, 0.5):
            run = learn(mdp, uniform_policy(mdp), 1.0, 1, alpha=alpha, V0=to_go, rng=rng())
            np.testing.assert_allclose(run.V - to_go, alpha * np.array([*expected[changes]][:6] + [0])[:6], atol=1e-12)
    delta = td_error(r, to_go[:-1], to_go[1:], 1.0)
    np.testing.assert_array_equal(delta, expected["td_error_alpha1"])
    assert delta.sum() == expected["mc_error_alpha1"][0] == 13
    np.testing.assert_array_equal(elapsed + to_go, expected["predicted_total"])


def test_first_episode_changes_one_end_only():
    mdp = random_walk(5)
    for seed in range(10):
        run = td0(mdp, uniform_policy(mdp), 1.0, 1, alpha=0.1, V0=0.5, record=1, rng=rng(seed))
        change = run.history[1] - run.history[0]
        end = 5 if run.returns[0] else 1
        np.testing.assert_allclose(change, 0.05 * (1 if end == 5 else -1) * (np.arange(7) == end), atol=1e-15)
        args = dict(alpha=0.1, V0=0.5, first_visit=True, record=1, rng=rng(seed))
        mc = constant_alpha_mc(mdp, uniform_policy(mdp), 1.0, 1, **args)
        seen = mc.V[mc.history[0] != mc.V]
        np.testing.assert_allclose(seen, 0.55 if end == 5 else 0.45, atol=1e-15)
        assert seen.size >= 3


@many_runs
def test_equation_19_with_the_parenthesis_in_its_place():
    """gamma = 0.9: v_pi. Worst error over 20 seeds 0.012; gamma (V' - V) would settle 0.12 to 0.31 away."""
    mdp = random_walk(5)
    run = td0(mdp, uniform_policy(mdp), 0.9, 40_000, alpha=decaying(0.5, rate=0.01), record=0, rng=rng())
    np.testing.assert_allclose(run.V[1:6], [0.0655, 0.1456, 0.2580, 0.4277, 0.6925], atol=0.03)
    np.testing.assert_allclose(
        solve_policy(mdp, uniform_policy(mdp), 0.9)[1:6], [0.0655, 0.1456, 0.2580, 0.4277, 0.6925], atol=5e-5
    )


def test_target_and_error():
    r, V, V_next = np.array([1.0, 2.0]), np.array([3.0, 5.0]), np.array([7.0, 11.0])
    np.testing.assert_array_equal(td_target(r, V_next, 0.5), [4.5, 7.5])
    np.testing.assert_array_equal(td_target(r, V_next, 0.5, np.array([True, False])), [1.0, 7.5])
    np.testing.assert_array_equal(td_error(r, V, V_next, 0.5), [1.5, 2.5])
    np.testing.assert_array_equal(td_error(r, V, V_next, 0.5, True), [-2.0, -3.0])
    assert td_error(1.0, 3.0, 7.0, 0.5) == 1.5


# ---------------------------------------------------------------------- batches

A, B, END = range(3)
PREDICTOR = [([A, B, END], [0, 0])] + [([B, END], [1])] * 6 + [([B, END], [0])]


def walks(n, seed, mdp=None):
    mdp, draws = mdp or random_walk(5), rng(seed)
    return [rollout(mdp, uniform_policy(mdp), 10_000, rng=draws) for _ in range(n)]


def test_you_are_the_predictor():
    """Example 6.4: both say 3/4 for B; for A the data say 0, the process that they suggest 3/4."""
    np.testing.assert_allclose(batch_mc(PREDICTOR, 3, 1.0), [0, 0.75, 0], atol=1e-15)
    np.testing.assert_allclose(batch_td(PREDICTOR, 3, 1.0, alpha=0.1), [0.75, 0.75, 0], atol=1e-8)
    np.testing.assert_allclose(certainty_equivalence(PREDICTOR, 3, 1.0), [0.75, 0.75, 0], atol=1e-15)
    np.testing.assert_allclose(certainty_equivalence(PREDICTOR, 3, 0.8), [0.6, 0.75, 0], atol=1e-15)


@pytest.mark.parametrize("learn", [batch_mc, batch_td, certainty_equivalence])
def test_batches_may_come_one_by_one_and_are_looked_at(learn):
    np.testing.assert_array_equal(learn(iter(PREDICTOR), 3, 0.9), learn(PREDICTOR, 3, 0.9))
    cut = rollout(random_walk(5), uniform_policy(random_walk(5)), 1, s=3, rng=rng())
    with pytest.raises(ValueError, match="^episodes: number 1 was cut before its end"):
        learn(iter([PREDICTOR[0], cut]), 7, 0.9)
    with pytest.raises(ValueError, match="^episodes: got 3, must be Trajectories"):
        learn(3, 7, 0.9)


@pytest.mark.parametrize("gamma", [1.0, 0.9])
def test_batch_td_is_certainty_equivalence(gamma):
    for mdp in (random_walk(5), awkward()):
        episodes, S = walks(30, 1, mdp), mdp.n_states
        exact = certainty_equivalence(episodes, S, gamma, unvisited=0.5)
        np.testing.assert_allclose(batch_td(episodes, S, gamma, alpha=0.005, V0=0.5), exact, rtol=0, atol=1e-7)
        mean = batch_mc(episodes, S, gamma, unvisited=0.5)
        swept = batch_mc(episodes, S, gamma, unvisited=0.5, alpha=0.005)
        np.testing.assert_allclose(swept, mean, rtol=0, atol=1e-8)
        assert np.abs(mean - exact).max() > 0.01  # two answers


def test_one_sweep_of_batch_td_by_hand():
    """Increments add up with V as it was before the sweep. A: 0 + 0.5 V(B); B: six times 1, twice 0, less 8 V(B)."""
    with pytest.raises(ValueError, match="max_sweeps"):
        batch_td(PREDICTOR, 3, 0.5, alpha=0.1, V0=2.0, max_sweeps=1)
    V = batch_td(PREDICTOR, 3, 0.5, alpha=0.1, V0=2.0, max_sweeps=1, tol=10.0)
    np.testing.assert_allclose(V, [2 + 0.1 * (0.5 * 2 - 2), 2 + 0.1 * (6 - 8 * 2), 0], rtol=1e-14)


def test_certainty_equivalence_solves_the_counted_process():
    mdp = awkward()
    episodes = walks(200, 3, mdp)
    N, R = np.zeros((7, 1, 7)), np.zeros((7, 1))
    for tau in episodes:
        for s, r, s_next in zip(tau.states, tau.rewards, tau.states[1:]):
            N[s, 0, s_next] += 1
            R[s, 0] += r
    total = np.maximum(N.sum(axis=2), 1)
    model = FiniteMDP.from_arrays(N / total[:, :, None], R / total, terminal=np.arange(7) == 6, start=0)
    exact = solve_policy(model, np.ones((7, 1)), 0.9)
    np.testing.assert_allclose(certainty_equivalence(episodes, 7, 0.9), exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("estimate", [batch_mc, certainty_equivalence])
def test_after_each_episode(estimate):
    episodes = walks(12, 5)
    V = estimate(episodes, 7, 0.9, unvisited=0.5, each=True)
    for n in range(1, 13):
        alone = estimate(episodes[:n], 7, 0.9, unvisited=0.5)
        seen = np.unique(np.concatenate([tau.states for tau in episodes[:n]]))
        np.testing.assert_allclose(V[n - 1, seen], alone[seen], rtol=0, atol=1e-12)
    assert V.shape == (12, 7)


def test_batches_take_pairs_and_leave_out_what_was_not_met():
    episodes = walks(5, 2)
    pairs = [(tau.states, tau.rewards) for tau in episodes]
    for estimate in (batch_mc, batch_td, certainty_equivalence):
        np.testing.assert_array_equal(estimate(episodes, 9, 0.9), estimate(pairs, 9, 0.9))
    assert batch_mc(pairs, 9, 0.9, unvisited=7.0)[8] == certainty_equivalence(pairs, 9, 0.9, unvisited=7.0)[8] == 7.0
    assert batch_td(pairs, 9, 0.9, V0=7.0)[8] == 7.0


def test_batch_td_says_when_it_diverges():
    with pytest.raises(ValueError, match="^alpha: got 1.0, too large for so many visits"):
        batch_td(PREDICTOR, 3, 1.0, alpha=1.0)


BAD_BATCHES = [
    (dict(episodes=[]), "episodes"),
    (dict(episodes=[([0, 1], [1.0, 2.0])]), "episodes"),
    (dict(episodes=[([0], [])]), "episodes"),
    (dict(episodes=[([0, 3], [1.0])]), "episodes"),
    (dict(episodes=[([-1, 2], [1.0])]), "episodes"),
    (dict(episodes=[([0.0, 2.0], [1.0])]), "episodes"),
    (dict(episodes=[([0, 2], [np.nan])]), "episodes"),
    (dict(episodes=[([0, 2], ["a"])]), "episodes"),
    (dict(episodes=[([0, 1], [1.0]), ([1, 2], [1.0])]), "episodes"),  # 1 ends and goes on
    (dict(episodes=[Trajectory(np.array([0, 1]), np.array([0]), np.array([1.0]), False)]), "episodes"),
    (dict(episodes=[Trajectory(np.array([0, 1]), np.array([0]), np.array([1.0]), np.False_)]), "episodes"),
    (dict(episodes=[rollout(random_walk(5), np.ones((7, 1)), 1, rng=rng())], n_states=7), "episodes"),
    (dict(n_states=0), "n_states"),
    (dict(gamma=1.1), "gamma"),
]


@pytest.mark.parametrize("wrong, name", BAD_BATCHES)
@pytest.mark.parametrize("estimate", [batch_mc, batch_td, certainty_equivalence])
def test_bad_batches(estimate, wrong, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        estimate(**(dict(episodes=PREDICTOR, n_states=3, gamma=1.0) | wrong))


@pytest.mark.parametrize(
    "estimate, wrong, name",
    [
        (batch_td, dict(alpha=0.0), "alpha"),
        (batch_td, dict(tol=0.0), "tol"),
        (batch_td, dict(max_sweeps=0), "max_sweeps"),
        (batch_td, dict(V0=[1.0, 2.0]), "V0"),
        (batch_td, dict(V0=np.nan), "V0"),
        (batch_mc, dict(unvisited="x"), "unvisited"),
        (batch_mc, dict(alpha=2.0), "alpha"),
        (batch_mc, dict(alpha=0.1, each=True), "each"),
        (certainty_equivalence, dict(unvisited="x"), "unvisited"),
    ],
)
def test_bad_settings_of_batches(estimate, wrong, name):
    with pytest.raises(ValueError, match=f"^{name}: "):
        estimate(PREDICTOR, 3, 1.0, **wrong)


# ---------------------------------------------------------------------- control


class Log(MDPEnv):
    """Remembers (s, a, r, s', terminated) of every step."""

    def __init__(self, mdp):
        super().__init__(mdp)
        self.steps = []

    def step(self, a):
        s, found = self.s, super().step(a)
        s_next, r, terminated, *_ = found
        self.steps.append((s, a, r, s_next, terminated))
        return found


TARGETS = {
    sarsa: lambda Q, s_next, a_next, epsilon: Q[s_next, a_next],
    q_learning: lambda Q, s_next, a_next, epsilon: Q[s_next].max(),
    expected_sarsa: lambda Q, s_next, a_next, epsilon: (
        soft_greedy(Q, epsilon)[s_next] * np.where(Q > -9e9, Q, 0)[s_next]
    ).sum(),
}


@pytest.mark.parametrize("learn", CONTROL)
@pytest.mark.parametrize("alpha", [0.3, decaying(0.5, rate=0.5, power=0.7)])
def test_each_update_is_that_of_the_equation(learn, alpha):
    """The steps of a run, written down by the environment, and the equation applied to them one by one."""
    mdp, gamma, epsilon = awkward(seed=1), 0.9, 0.3
    env = Log(mdp)
    run = learn(env, gamma, 25, alpha=alpha, epsilon=epsilon, Q0=1.5, record=1, rng=rng(2))
    Q, N = run.history[0].copy(), np.zeros((7, 3))
    assert (Q[mdp.legal & ~mdp.terminal[:, None]] == 1.5).all() and (Q[mdp.terminal] == 0).all()
    assert (Q[~mdp.legal] == -np.inf).all() and len(env.steps) == run.lengths.sum() > 50
    ends = []
    for t, (s, a, r, s_next, terminated) in enumerate(env.steps):
        a_next = -1 if terminated else env.steps[t + 1][1]
        G = r + (0.0 if terminated else gamma * TARGETS[learn](Q, s_next, a_next, epsilon))
        step_size = alpha if isinstance(alpha, float) else 0.5 / (1 + 0.5 * N[s, a]) ** 0.7
        Q[s, a] += step_size * (G - Q[s, a])
        N[s, a] += 1
        if terminated:
            ends.append(Q.copy())
    np.testing.assert_allclose(run.history[1:], ends, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(run.Q, run.history[-1])
    np.testing.assert_array_equal(run.V, run.Q.max(axis=1))
    np.testing.assert_array_equal(run.policy, soft_greedy(run.Q, epsilon))
    assert run.returns.sum() == pytest.approx(sum(step[2] for step in env.steps))


@pytest.mark.long
@pytest.mark.parametrize("learn", CONTROL)
def test_one_action_leaves_td0(learn):
    mdp = chain([1.0, -2.0, 4.0])
    for alpha in (0.3, decaying(1.0), decaying(0.9, rate=0.1)):
        V = td0(mdp, uniform_policy(mdp), 0.5, 5, alpha=alpha, V0=2.0, record=1, rng=rng()).history
        Q = learn(mdp, 0.5, 5, alpha=alpha, epsilon=0.1, Q0=2.0, record=1, rng=rng()).history
        np.testing.assert_allclose(Q[:, :, 0], V, rtol=1e-14, atol=1e-14)


def test_expected_sarsa_that_never_explores_is_q_learning():
    for mdp in (awkward(start=0), windy_gridworld(), dyna_maze()):
        args = dict(alpha=0.4, epsilon=0.0, Q0=0.1, record=1)
        one = q_learning(mdp, 0.9, 30, max_steps=3000, rng=rng(3), **args)
        two = expected_sarsa(mdp, 0.9, 30, max_steps=3000, rng=rng(3), **args)
        np.testing.assert_array_equal(one.history, two.history)
        np.testing.assert_array_equal(one.lengths, two.lengths)


def test_expected_value_is_the_mean_under_the_policy():
    Q = np.array([[1.0, 3.0, 3.0, -np.inf], [0.0, 0.0, 0.0, 0.0], [-2.0, -np.inf, -np.inf, -np.inf]])
    for epsilon in (0.0, 0.3, 1.0):
        means = [expected_value(Q, s, epsilon) for s in range(3)]
        np.testing.assert_allclose(means, v_from_q(Q, soft_greedy(Q, epsilon)), rtol=1e-14)


def test_epsilon_may_fall_by_episode_or_by_step():
    """From 1 (random) to 0 (greedy): in the end only Q's ties are left to chance."""
    mdp = cliff_walking()
    for learn in CONTROL:
        by_episode = learn(mdp, 1.0, 20, alpha=0.5, epsilon=decaying(1.0, power=2.0), rng=rng())
        np.testing.assert_array_equal(by_episode.policy, soft_greedy(by_episode.Q, 1 / 21**2))
        by_step = learn(mdp, 1.0, 20, alpha=0.5, epsilon=decaying(1.0, rate=0.01, per_step=True), rng=rng())
        now = by_step.lengths.sum()
        np.testing.assert_array_equal(by_step.policy, soft_greedy(by_step.Q, 1 / (1 + 0.01 * now)))


@pytest.mark.parametrize("learn", CONTROL)
@pytest.mark.parametrize("per_step", [False, True])
def test_when_epsilon_falls(learn, per_step):
    """Random at n = 0, greedy from then on: for the first of two episodes, or for the first step only."""
    env = Log(FiniteMDP.from_outcomes({(0, a): [(1.0, 0, 2.0 + a)] for a in range(2)}))
    epsilon = decaying(1.0, rate=1e9, power=9, per_step=per_step)
    seen = []
    for seed in range(5):
        env.steps = []
        learn(env, 0.0, 2, alpha=0.5, epsilon=epsilon, Q0=[[2.0, 3.0]], max_steps=30, rng=rng(seed))
        seen.append([a for _, a, _, _, _ in env.steps])
    seen = np.array(seen)
    assert seen[:, 30:].all() and seen[:, 1:30].all() == per_step and not seen[:, 0].all()


def soft_optimum(mdp, gamma, epsilon):
    """The best epsilon-soft policy, by policy iteration: its values (S,) and itself."""
    pi = soft_greedy(np.where(mdp.legal, 0.0, -np.inf), epsilon)
    for _ in range(100):
        V = solve_policy(mdp, pi, gamma)
        Q = q_from_v(mdp, V, gamma)
        new = (1 - epsilon) * greedy(Q) + epsilon * mdp.legal / mdp.legal.sum(axis=1, keepdims=True)
        if np.abs((new * np.where(mdp.legal, Q, 0)).sum(axis=1) - V).max() < 1e-11:
            return V, new
        pi = new


def path(mdp, Q):
    """States that the greedy policy visits."""
    tau = rollout(mdp, greedy(Q), 100, rng=rng())
    return tau.states.tolist()


@pytest.mark.parametrize("epsilon, value", [(0.1, -20.71), (0.05, -17.519231855902312), (0.01, -15.44081065987908)])
def test_best_soft_policy_on_the_cliff(epsilon, value):
    mdp = cliff_walking()
    V, pi = soft_optimum(mdp, 1.0, epsilon)
    np.testing.assert_allclose(V[36], value, rtol=0, atol=0.005 if epsilon == 0.1 else 1e-6)
    assert len(path(mdp, np.where(pi > 0.5, 1.0, 0.0))) == 16  # 15 steps, one row above the edge


def test_soft_around_the_optimum_on_the_cliff():
    mdp = cliff_walking()
    Q = value_iteration(mdp, 1.0).Q
    V = solve_policy(mdp, soft_greedy(Q, 0.1), 1.0)
    expected = REFERENCE["cliff.eps_greedy_of_q_star_return"]
    np.testing.assert_allclose(V[36], expected["value"], rtol=0, atol=expected["band"])
    assert len(path(mdp, Q)) - 1 == REFERENCE["cliff.path_lengths"]["value"]["edge"]


@pytest.mark.parametrize("name, moves", [("8_king", dict(king=True)), ("9_king_stay", dict(king=True, stay=True))])
def test_limits_of_the_windy_gridworld(name, moves):
    mdp, expected = windy_gridworld(**moves), REFERENCE[f"windy.steps[{name}]"]
    V, _ = soft_optimum(mdp, 1.0, 0.1)
    Q = value_iteration(mdp, 1.0).Q
    around = solve_policy(mdp, soft_greedy(Q, 0.1), 1.0)
    found = dict(optimal=-Q[30].max(), eps_greedy_of_q_star=-around[30], best_eps_soft=-V[30])
    for limit, value in found.items():
        np.testing.assert_allclose(value, expected["value"][limit], rtol=0, atol=expected["band"], err_msg=limit)


@many_runs
def test_expected_sarsa_reaches_the_best_soft_policy():
    """Moves are certain and the mean leaves nothing to chance, so that Q settles though alpha does not fall."""
    mdp = cliff_walking()
    run = expected_sarsa(mdp, 1.0, 30_000, alpha=1.0, epsilon=0.1, record=0, rng=rng())
    V, _ = soft_optimum(mdp, 1.0, 0.1)
    value = (run.policy * run.Q).sum(axis=1)
    np.testing.assert_allclose(value[[36, 24, 12, 18, 23, 35]], V[[36, 24, 12, 18, 23, 35]], rtol=0, atol=1e-6)
    assert run.history is None


@pytest.mark.long
@many_runs
def test_q_learning_reaches_the_optimum_whatever_is_done():
    """Exactly, where moves are certain and alpha = 1; also on the cliff, from a random policy."""
    mdp = dyna_maze()
    exact = value_iteration(mdp, 0.95, tol=1e-15)
    run = q_learning(mdp, 0.95, 300, alpha=1.0, epsilon=1.0, record=0, rng=rng())
    reached = [s for s in range(54) if exact.V[s] > 0 and run.V[s] > 0]
    assert len(reached) == 54 - 7 - 1  # all but the walls and the goal
    np.testing.assert_allclose(run.Q[reached], exact.Q[reached], rtol=0, atol=0)
    mdp = cliff_walking()
    for epsilon in (0.1, 1.0):
        run = q_learning(mdp, 1.0, 3000, alpha=0.5, epsilon=epsilon, record=0, rng=rng())
        assert len(path(mdp, run.Q)) == 14 and run.V[36] == pytest.approx(-13, abs=1e-9)


@many_runs
def test_sarsa_under_a_fixed_policy():
    """q_pi of the robot after 2e6 steps. Worst error over 10 seeds 0.07; with alpha = 1/N it is still off by 3."""
    mdp = recycling_robot()
    pi = uniform_policy(mdp)
    args = dict(alpha=decaying(1.0, power=0.7), max_steps=2_000_000, record=0, rng=rng())
    run = sarsa(mdp, 0.9, 1, pi=pi, **args)
    q_pi = q_from_v(mdp, solve_policy(mdp, pi, 0.9), 0.9)
    np.testing.assert_allclose(q_pi[mdp.legal], [14.4779, 13.6637, 11.5487, 11.8053, 12.6637], atol=5e-5)
    np.testing.assert_allclose(run.Q[mdp.legal], q_pi[mdp.legal], rtol=0, atol=0.15)
    np.testing.assert_array_equal(run.policy, pi)
    np.testing.assert_allclose(run.V, v_from_q(run.Q, pi))


def test_sarsa_takes_the_actions_of_the_policy_given():
    mdp = recycling_robot()
    run = sarsa(mdp, 0.9, 1, pi=deterministic_policy(mdp, [0, 2]), alpha=0.1, max_steps=200, rng=rng())
    assert run.Q[0, 1] == run.Q[1, 0] == run.Q[1, 1] == 0 and run.Q[0, 0] > 1 and run.Q[1, 2] > 1


@many_runs
def test_q_learning_of_the_robot():
    """Q-learning finds q*, SARSA the values of the epsilon-soft optimum, 0.40 away. cl-055

    alpha = N^-0.7, epsilon 0.1, 2e6 steps. Worst error over 20 seeds 0.12 for Q-learning, over 10 seeds 0.12 for SARSA,
    which over 20 seeds is 0.39 to 0.51 away from q*.
    """
    mdp = recycling_robot()
    exact = value_iteration(mdp, 0.9, tol=1e-10).Q[mdp.legal]
    args = dict(alpha=decaying(1.0, power=0.7), epsilon=0.1, max_steps=2_000_000, record=0)
    assert np.abs(q_learning(mdp, 0.9, 1, rng=rng(), **args).Q[mdp.legal] - exact).max() < 0.15
    soft, _ = soft_optimum(mdp, 0.9, 0.1)
    Q = sarsa(mdp, 0.9, 1, rng=rng(), **args).Q[mdp.legal]
    assert np.abs(Q - q_from_v(mdp, soft, 0.9)[mdp.legal]).max() < 0.2 and np.abs(Q - exact).max() > 0.25


# ---------------------------------------------------------------------- published curves


def within(id, runs):
    """runs: (R,), the quantity in each run; the mean lies within four standard errors, its own and the reference's."""
    entry = REFERENCE[id]
    band = 4 * entry["sd_run"] / np.sqrt(len(runs)) + 4 * entry["se_ref"]
    return (
        []
        if abs(np.mean(runs) - entry["value"]) <= band
        else [f"{id}: {np.mean(runs):.5g}, {entry['value']:.5g} +- {band:.2g}"]
    )


def settings(prefix):
    """(id, words in brackets) of every entry whose name begins with prefix[."""
    return [(id, id.split("[")[1][:-1].split(",")) for id in REFERENCE if id.startswith(prefix + "[")]


@many_runs
def test_errors_on_the_random_walk():
    """Sutton and Barto (2018), example 6.2: RMS error by episode, 300 runs."""
    mdp, truth, wrong, errors = random_walk(5), np.arange(1, 6) / 6, [], {}
    for id, (method, alpha, *episode) in settings("walk5.rms") + settings("walk5.rms_mean100"):
        if (method, alpha) not in errors:
            options = dict(alpha=float(alpha.split("=")[1]), V0=0.5, max_steps=10**6, record=1)
            learn = partial({"td": td0, "mc": constant_alpha_mc}[method], **options)
            V = np.array([learn(mdp, uniform_policy(mdp), 1.0, 100, rng=g).history for g in rng(8).spawn(300)])
            errors[method, alpha] = np.sqrt(((V[:, :, 1:6] - truth) ** 2).mean(axis=2))
            np.testing.assert_allclose(errors[method, alpha][:, 0], 0.2357, atol=1e-4)
        rms = errors[method, alpha]
        wrong += within(id, rms[:, int(episode[0].split("=")[1])] if episode else rms[:, 1:].mean(axis=1))
    assert not wrong and len(errors) == 7


def test_errors_of_batches_on_the_random_walk():
    """Figure 6.2: the mean return against certainty equivalence, 60 runs of 100 episodes."""
    truth, wrong, errors = np.arange(1, 6) / 6, [], {}
    for seed in range(60):
        episodes = walks(100, seed)
        for method, estimate in (("td", certainty_equivalence), ("mc", batch_mc)):
            for unvisited in (0.5, -1.0):
                V = estimate(episodes, 7, 1.0, unvisited=unvisited, each=True)[:, 1:6]
                errors.setdefault((method, unvisited), []).append(np.sqrt(((V - truth) ** 2).mean(axis=1)))
    for id, (method, episode, unvisited) in settings("walk5.batch"):
        rms = np.array(errors[method, float(unvisited.split("=")[1])])
        wrong += within(id, rms[:, int(episode.split("=")[1]) - 1])
    assert not wrong
    assert (np.mean(errors["td", 0.5], axis=0) <= np.mean(errors["mc", 0.5], axis=0) + 1e-12).all()


@pytest.mark.long
@many_runs
def test_returns_on_the_cliff():
    """Sutton and Barto (2018), example 6.6 and figure 6.3."""
    mdp, wrong, found = cliff_walking(), [], {}
    kinds = [("cliff.return", 500, 100), ("cliff.interim", 100, 100), ("cliff.asymptotic", 10_000, 10)]
    for prefix, n_episodes, n_runs in kinds:
        for id, (method, what) in settings(prefix):
            alpha = float(what.split("=")[1]) if "alpha" in what else 0.5
            key = method, alpha, n_episodes
            if key not in found:
                learn = partial(
                    {f.__name__: f for f in CONTROL}[method], alpha=alpha, epsilon=0.1, max_steps=10**6, record=0
                )
                found[key] = np.array([learn(mdp, 1.0, n_episodes, rng=g).returns for g in rng(9).spawn(n_runs)])
            first, last = (n_episodes // 2 + 1, n_episodes) if prefix == "cliff.asymptotic" else (1, 100)
            if prefix == "cliff.return":
                first, last = map(int, what[2:].split("-"))
            wrong += within(id, found[key][:, first - 1 : last].mean(axis=1))
    assert not wrong and len(found) > 20


@many_runs
def test_sarsa_on_the_windy_gridworld():
    """Sutton and Barto (2018), example 6.5."""
    mdp, lengths, paths = windy_gridworld(), [], []
    for g in rng(10).spawn(100):
        run = sarsa(mdp, 1.0, 500, alpha=0.5, epsilon=0.1, record=0, rng=g)
        lengths.append(run.lengths)
        paths.append(min(len(path(mdp, run.Q)) - 1, 200))
    lengths = np.array(lengths)
    wrong = within("windy.sarsa.episodes_by_8000_steps", (lengths.cumsum(axis=1) <= 8000).sum(axis=1))
    wrong += within("windy.sarsa.mean_length[ep401-500]", lengths[:, 400:].mean(axis=1))
    wrong += within("windy.sarsa.length_first_episode", lengths[:, 0])
    assert not wrong
    expected = REFERENCE["windy.sarsa.greedy_path_after_500"]["value"]
    for steps in (15, 16, 17, 18):
        p = expected[str(steps)]
        assert abs(np.mean(np.array(paths) == steps) - p) < 4 * np.sqrt(p * (1 - p) / 100)


# ---------------------------------------------------------------------- worlds, ends and cuts


def everything(world, n_episodes, max_steps, seed=0):
    """Every learning function on one world, which may be an environment: {name: Run}."""
    model = getattr(getattr(world, "unwrapped", world), "mdp", world)
    pi = uniform_policy(model)
    limit = dict(max_steps=max_steps)
    calls = {
        "mc first v": partial(mc_prediction, pi=pi, max_steps=max_steps or 400, record=1),
        "mc every q": partial(
            mc_prediction, pi=pi, first_visit=False, target="q", max_steps=max_steps or 400, record=1
        ),
        "constant alpha mc": partial(constant_alpha_mc, pi=pi, alpha=0.1, V0=0.5, record=1, **limit),
        "1/N mc": partial(constant_alpha_mc, pi=pi, alpha=decaying(1.0), first_visit=True, record=2, **limit),
        "td0": partial(td0, pi=pi, alpha=0.1, V0=0.5, record=1, **limit),
        "td0 falling": partial(td0, pi=pi, alpha=decaying(0.9, power=0.6), record=3, **limit),
        "td0 groups": partial(
            td0_groups, pi=pi, alpha=0.2, w0=1.0, groups=np.arange(model.n_states) // 2, record=1, **limit
        ),
        "sarsa pi": partial(sarsa, pi=pi, alpha=0.3, record=1, **limit),
    }
    for learn in CONTROL:
        steps = decaying(0.8, rate=0.3, power=0.8)
        epsilon = decaying(0.9, rate=0.01, per_step=True)
        calls[learn.__name__] = partial(learn, alpha=0.4, epsilon=0.2, Q0=0.3, record=1, **limit)
        calls[learn.__name__ + " falling"] = partial(learn, alpha=steps, epsilon=epsilon, record=2, **limit)
        calls[learn.__name__ + " by episode"] = partial(learn, alpha=0.2, epsilon=decaying(0.5), record=0, **limit)
    return {name: f(world, gamma=0.9, n_episodes=n_episodes, rng=rng(seed)) for name, f in calls.items()}


def bits(runs):
    digest = {}
    for name, run in runs.items():
        arrays = [x for x in vars(run).values() if x is not None]
        digest[name] = hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in arrays)).hexdigest()
    return digest


WORLDS = {"awkward": awkward(start=0), "walk": random_walk(5), "windy": windy_gridworld(king=True)}


def all_bits():
    return {name: bits(everything(mdp, 5, 200)) for name, mdp in WORLDS.items()}


@pytest.mark.parametrize("name", WORLDS)
def test_an_environment_gives_the_bits_of_its_process(name):
    mdp = WORLDS[name]
    assert bits(everything(mdp, 4, 300)) == bits(everything(MDPEnv(mdp), 4, 300))


@pytest.mark.parametrize("name", WORLDS)
def test_a_truncated_episode_is_one_cut_at_max_steps(name):
    """TimeLimit and max_steps leave the same bits: what is cut bootstraps, what ends within the limit does not."""
    mdp = WORLDS[name]
    cut = everything(mdp, 6, 7)
    assert bits(cut) == bits(everything(TimeLimit(MDPEnv(mdp), 7), 6, 300))
    assert any((run.lengths == 7).any() for run in cut.values())


@pytest.mark.parametrize("through", ["max_steps", "TimeLimit"])
def test_every_function_bootstraps_where_it_is_cut_and_not_at_an_end(through):
    """One step with reward 1, then either the end or a cut in a state worth 10."""
    goes_on = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 1.0)], (1, 0): [(1.0, 0, 1.0)]}, start=0)
    ends = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 1.0)]}, start=0, n_states=2)
    pi = np.ones((2, 1))
    calls = [partial(f, pi=pi, V0=[0.0, 10.0]) for f in (constant_alpha_mc, td0)]
    calls += [partial(f, epsilon=0.1, Q0=[[0.0], [10.0]]) for f in CONTROL] + [
        partial(sarsa, pi=pi, Q0=[[0.0], [10.0]])
    ]
    for learn in calls:
        for mdp, value in ((goes_on, 6.0), (ends, 1.0)):
            world, limit = (mdp, 1) if through == "max_steps" else (TimeLimit(MDPEnv(mdp), 1), None)
            run = learn(world, gamma=0.5, n_episodes=1, alpha=1.0, max_steps=limit, rng=rng())
            assert (run.V if run.Q is None else run.Q[:, 0])[0] == value and run.lengths[0] == 1


class Ending(gym.Env):
    """One step with reward 1 into state 1: its end, or a cut there. Which states are terminal it does not tell."""

    observation_space, action_space = gym.spaces.Discrete(2), gym.spaces.Discrete(1)

    def __init__(self, terminated):
        self.terminated = terminated

    def reset(self, *, seed=None, options=None):
        return 0, {}

    def step(self, a):
        return 1, 1.0, self.terminated, not self.terminated, {}


@pytest.mark.parametrize("terminated, value", [(True, 1.0), (False, 6.0)])
def test_an_end_counts_nothing_whatever_its_state_is_worth(terminated, value):
    pi = np.ones((2, 1))
    calls = [partial(f, pi=pi, V0=10.0) for f in (constant_alpha_mc, td0)] + [partial(sarsa, pi=pi, Q0=10.0)]
    calls += [partial(f, epsilon=epsilon, Q0=10.0) for f in CONTROL for epsilon in (0.0, 0.5)]
    for learn in calls:
        run = learn(Ending(terminated), gamma=0.5, n_episodes=2, alpha=1.0, rng=rng())
        assert (run.V if run.Q is None else run.Q[:, 0]).tolist() == [value, 10.0]
        assert run.returns.tolist() == [1.0, 1.0] and run.lengths.tolist() == [1, 1]


def test_mc_counts_what_it_has_seen_of_a_truncated_episode():
    world = TimeLimit(MDPEnv(FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)]})), 4)
    run = mc_prediction(world, np.ones((1, 1)), 0.5, 3, max_steps=10, rng=rng())
    assert run.V[0] == 1.875 and (run.lengths == 4).all()


@pytest.mark.skipif(not HAVE_NUMBA, reason="numba is absent or switched off")
def test_compiled_and_interpreted_runs_have_the_same_bits():
    code = "import json, test_td as t; assert not t.HAVE_NUMBA; print(json.dumps(t.all_bits()))"
    here = Path(__file__).parent
    env = {**os.environ, "RLCORE_NO_NUMBA": "1", "PYTHONPATH": os.pathsep.join([str(here), str(here.parent)])}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == all_bits()


@pytest.mark.parametrize("name", ["CliffWalking-v1", "FrozenLake-v1", "Taxi-v4"])
def test_environments_of_gymnasium(name):
    """Q-learning and its kin run on toy-text environments as they are; bits are the same for the same rng."""
    env = gym.make(name, max_episode_steps=60)
    S, A = env.observation_space.n, env.action_space.n
    for learn in CONTROL:
        one, two = (learn(env, 0.9, 5, alpha=0.5, epsilon=0.2, record=1, rng=rng(1)) for _ in range(2))
        assert one.Q.shape == (S, A) and one.history.shape == (6, S, A) and (one.lengths <= 60).all()
        np.testing.assert_array_equal(one.Q, two.Q)
        assert np.isfinite(one.returns).all() and one.lengths.min() >= 1
    pi = np.full((S, A), 1 / A)
    for learn in PREDICTION:
        run = learn(env, pi, 0.9, 5, record=1, rng=rng(1))
        assert run.V.shape == (S,) and run.history.shape == (6, S)


def test_q_learning_learns_in_an_environment():
    """CliffWalking of gymnasium: the same cliff, action order and all its own; the greedy path has 13 steps."""
    env = gym.make("CliffWalking-v1")
    run = q_learning(env, 1.0, 400, alpha=0.5, epsilon=0.1, record=100, rng=rng())
    assert run.V[36] == pytest.approx(-13, abs=0.5) and run.history.shape == (5, 48, 4)
    s, n = env.reset(seed=0)[0], 0
    done = False
    while not done and n < 50:
        s, _, done, _, _ = env.step(int(run.Q[s].argmax()))
        n += 1
    assert n == 13


@pytest.mark.parametrize("learn", [constant_alpha_mc, td0, *CONTROL])
def test_record_thins_the_history(learn):
    mdp = random_walk(5)
    args = dict(alpha=0.1) | (dict(epsilon=0.1) if learn in CONTROL else dict(pi=uniform_policy(mdp)))
    full, thin, none = (learn(mdp, gamma=0.9, n_episodes=7, record=k, rng=rng(), **args) for k in (1, 3, 0))
    np.testing.assert_array_equal(full.history[::3], thin.history)
    assert none.history is None and len(full.history) == 8
    np.testing.assert_array_equal(none.V, full.V)
    with pytest.raises(ValueError, match="^V0|^Q0"):
        learn(mdp, gamma=0.9, n_episodes=7, rng=rng(), **args, **{"Q0" if learn in CONTROL else "V0": np.inf})


def test_same_rng_same_run():
    mdp = random_walk(5)
    for learn in (
        lambda rng: mc_prediction(mdp, uniform_policy(mdp), 0.9, 20, max_steps=1000, record=1, rng=rng),
        lambda rng: td0(mdp, uniform_policy(mdp), 0.9, 20, alpha=0.1, rng=rng),
    ):
        one, two = learn(np.random.default_rng(3)), learn(np.random.default_rng(3))
        np.testing.assert_array_equal(one.V, two.V)
        np.testing.assert_array_equal(one.lengths, two.lengths)
    assert one.history is None


BAD = [
    (mc_prediction, dict(target="w"), "target"),
    (mc_prediction, dict(max_steps=0), "max_steps"),
    (mc_prediction, dict(world="robot"), "world"),
    (mc_prediction, dict(n_episodes=0), "n_episodes"),
    (mc_prediction, dict(gamma=1.5), "gamma"),
    (mc_prediction, dict(pi=np.ones((2, 2))), "pi"),
    (td0, dict(alpha=0.0), "alpha"),
    (td0, dict(alpha=np.nan), "alpha"),
    (td0, dict(max_steps=None), "max_steps"),
    (td0_groups, dict(groups=[0]), "groups"),
    (td0_groups, dict(groups=[0, -1]), "groups"),
    (td0_groups, dict(groups=[0.0, 1.0]), "groups"),
    (td0_groups, dict(groups=None), "groups"),
    (td0_groups, dict(w0=[1.0, 2.0]), "w0"),
    (td0_groups, dict(w0=np.inf), "w0"),
    (td0_groups, dict(alpha=0.0), "alpha"),
    (td0_groups, dict(max_steps=None), "max_steps"),
    (td0, dict(V0=[1.0, 2.0, 3.0]), "V0"),
    (td0, dict(record=-1), "record"),
    (td0, dict(world=3), "world"),
    (constant_alpha_mc, dict(alpha=1.5), "alpha"),
    (constant_alpha_mc, dict(alpha="fast"), "alpha"),
    (constant_alpha_mc, dict(max_steps=None), "max_steps"),
    (constant_alpha_mc, dict(pi=[[0.5, 0.5, 0.0], [1.0, 1.0, 1.0]]), "pi"),
    (constant_alpha_mc, dict(pi=[[0.5, 0.0, 0.5], [1.0, 0.0, 0.0]]), "pi"),  # not legal when the charge is high
    (constant_alpha_mc, dict(V0="a"), "V0"),
    (constant_alpha_mc, dict(record=0.5), "record"),
    (constant_alpha_mc, dict(rng=None), "rng"),
    *(
        (learn, wrong, name)
        for learn in CONTROL
        for wrong, name in (
            (dict(alpha=0), "alpha"),
            (dict(alpha=[0.1]), "alpha"),
            (dict(epsilon=1.2), "epsilon"),
            (dict(epsilon=-0.1), "epsilon"),
            (dict(gamma=-1), "gamma"),
            (dict(n_episodes=2.5), "n_episodes"),
            (dict(Q0=[1.0, 2.0]), "Q0"),
            (dict(Q0=np.nan), "Q0"),
            (dict(max_steps=None), "max_steps"),
            (dict(max_steps=0), "max_steps"),
            (dict(record=-1), "record"),
            (dict(rng=0), "rng"),
            (dict(world=None), "world"),
        )
    ),
    (sarsa, dict(epsilon=None), "epsilon"),
    (sarsa, dict(pi=[[0.5, 0.5, 0.0], [1.0, 0.0, 0.0]]), "epsilon"),
    (sarsa, dict(epsilon=None, pi=[[0.5, 0.5, 0.5], [1.0, 0.0, 0.0]]), "pi"),
    (sarsa, dict(epsilon=None, pi=[[0.5, 0.5, 0.0], [1.0, 0.0, 0.0]], max_steps=None), "max_steps"),
    (q_learning, dict(world=gym.make("CartPole-v1")), "world"),
]


@pytest.mark.parametrize("learn, wrong, name", BAD)
def test_bad_input_names_the_argument(learn, wrong, name):
    mdp = recycling_robot()
    args = dict(world=mdp, gamma=0.9, n_episodes=5, max_steps=10, rng=rng())
    args |= dict(epsilon=0.1) if learn in CONTROL else dict(pi=uniform_policy(mdp))
    args |= {} if learn is mc_prediction else dict(alpha=0.1)
    args |= dict(groups=[0, 1]) if learn is td0_groups else {}
    learn(**args)
    with pytest.raises(ValueError, match=f"^{name}: "):
        learn(**(args | wrong))
