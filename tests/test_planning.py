"""Learned models, certainty equivalence, Dyna, shooting: limits and identities first, then published numbers."""

import functools
import os
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from rlcore.bellman import solve_policy
from rlcore.core.results import PlanningRun
from rlcore.core.sampling import draw, step
from rlcore.core.schedules import decaying
from rlcore.dp import value_iteration
from rlcore.envs import (
    MDPEnv,
    balance,
    blocking_maze,
    cartpole_start,
    cartpole_step,
    cartpole_transitions,
    cartpole_upright,
    cliff_walking,
    dyna_maze,
    gridworld,
    random_mdp,
    random_walk,
    recycling_robot,
    two_state_mdp,
)
from rlcore.mdp import FiniteMDP, deterministic_policy, uniform_policy
from rlcore.mpc import fit_linear_dynamics, linear_dynamics, random_shooting, simulate
from rlcore.optimizers import gradient_descent
from rlcore.planning import (
    Transitions,
    certainty_equivalent_control,
    dyna_q,
    estimate_model,
    predict,
    replay,
    sample_transitions,
)
from rlcore.policies import epsilon_greedy, max_value, soft_greedy
from rlcore.studies.ch03 import objective, reinforce_linear, trajectories, trajectory_probability


def rng(seed=0):
    return np.random.default_rng(seed)


def learn(world, n_episodes=20, *, n_planning=0, alpha=0.1, epsilon=0.1, gamma=0.95, seed=0, **options):
    return dyna_q(
        world, gamma, n_episodes, n_planning=n_planning, alpha=alpha, epsilon=epsilon, rng=rng(seed), **options
    )


def lengths(n_planning, n_runs, n_episodes=20):
    maze = dyna_maze()
    return np.array(
        [
            dyna_q(maze, 0.95, n_episodes, n_planning=n_planning, alpha=0.1, epsilon=0.1, rng=child).lengths
            for child in rng(0).spawn(n_runs)
        ]
    )


def small_world(bonus=0.0):
    """Four states, the last one terminal; state 2 has only action 1. Every reward is raised by bonus."""
    outcomes = {
        (0, 0): [(0.5, 0, 1), (0.5, 1, 2)],
        (0, 1): [(1, 2, -1)],
        (1, 0): [(1, 0, 3)],
        (1, 1): [(0.7, 3, 1), (0.3, 2, 0)],
        (2, 1): [(0.6, 3, 5), (0.4, 1, -2)],
    }
    outcomes = {pair: [(p, s, r + bonus) for p, s, r in rows] for pair, rows in outcomes.items()}
    return FiniteMDP.from_outcomes(outcomes, n_states=4, start=[0.3, 0.7, 0.0, 0.0])


def dictionary_dyna(first, later, change, n_episodes, n_planning, alpha, epsilon, kappa, gamma, max_steps, Q, rng):
    """Dyna-Q written anew: what it remembers is {s: {a: (reward, s', step)}}, and dictionaries keep their order."""
    table, now, returns, lengths, history = {}, 0, [], [], [Q.copy()]
    for _ in range(n_episodes):
        s, G, n = draw(first.sampler().start_cdf, rng), 0.0, 0
        while s != 3 and n < max_steps:
            a = epsilon_greedy(Q, s, epsilon, rng)
            s_next, r = step((later if now >= change else first).sampler(), s, a, rng)
            Q[s, a] = (1 - alpha) * Q[s, a] + alpha * (r + gamma * Q[s_next].max())
            if kappa > 0:
                for b in np.flatnonzero(first.legal[s]):
                    table.setdefault(s, {}).setdefault(b, (0.0, s, 0))
            table.setdefault(s, {})[a] = (r, s_next, now)
            s, G, n, now = s_next, G + r, n + 1, now + 1
            for _ in range(n_planning):
                i = list(table)[int(rng.random() * len(table))]
                b = list(table[i])[int(rng.random() * len(table[i]))]
                r, j, tried = table[i][b]
                target = r + kappa * (now - tried) ** 0.5 + gamma * Q[j].max()
                Q[i, b] = (1 - alpha) * Q[i, b] + alpha * target
        returns, lengths, history = [*returns, G], [*lengths, n], [*history, Q.copy()]
    return table, returns, lengths, history


# ---------------------------------------------------------------------- models from counts


def test_counts_are_frequencies():
    data = Transitions(*map(np.array, ([0, 0, 0, 1], [0, 0, 0, 1], [1.0, 1.0, 2.0, 5.0], [1, 1, 0, 2])))
    model = estimate_model(data, 3, 2, terminal=[2], unseen=-4.0)
    assert model.p(1, 1.0, 0, 0) == pytest.approx(2 / 3) and model.p(0, 2.0, 0, 0) == pytest.approx(1 / 3)
    assert model.p(2, 5.0, 1, 1) == 1
    assert model.p(0, -4.0, 0, 1) == 1 and model.p(1, -4.0, 1, 0) == 1  # never tried: stays
    assert model.terminal.tolist() == [False, False, True]


def test_counts_converge_like_one_over_root_n():
    robot = recycling_robot()
    error = []
    for n in (1_000, 16_000):
        worst = []
        for seed in range(40):
            data = sample_transitions(robot, uniform_policy(robot), n, rng=rng(seed))
            model = estimate_model(data, 2, 3, legal=robot.legal)
            worst.append(np.abs(model.transition_probs() - robot.transition_probs()).max())
        error.append(np.mean(worst))
    # 4 = sqrt(16); 3.5 to 5.3 over 10 blocks of seeds; one that forgets old data stays at 1
    assert 3 < error[0] / error[1] < 6


def test_transitions_come_from_the_process_and_restart():
    walk = random_walk(5)
    data = sample_transitions(walk, uniform_policy(walk), 2_000, rng=rng(1))
    assert np.all(np.abs(data.s - data.s_next) == 1) and not walk.terminal[data.s].any()
    ended = walk.terminal[data.s_next]
    assert np.all(data.s[1:][ended[:-1]] == 3) and np.all(data.s[1:][~ended[:-1]] == data.s_next[:-1][~ended[:-1]])
    assert np.all(data.r == (data.s_next == 6))


def test_the_best_deterministic_model_of_the_robot_is_right_nine_times_in_ten():
    robot = recycling_robot()
    data = sample_transitions(robot, uniform_policy(robot), 20_000, rng=rng(2))
    searched_high = (data.s == 0) & (data.a == 0)
    stays = np.mean(data.s_next[searched_high] == 0)
    assert stays == pytest.approx(0.9, abs=0.015)  # 5 standard errors of the 7,000 or so trials


def test_certainty_equivalence_on_complete_counts_is_the_optimum():
    maze = dyna_maze()
    options = dict(epsilon=0.0, unseen=1.0, max_steps=2000)
    run = certainty_equivalent_control(maze, 0.95, 30, record=1, rng=rng(3), **options)
    assert run.lengths[-5:].tolist() == [14] * 5  # optimism tries all that could pay, then walks the shortest path
    assert solve_policy(maze, run.policy, 0.95)[18] == pytest.approx(0.95**13)
    assert run.history.shape == (31, 54, 4) and run.returns.tolist() == (run.lengths < 2000).astype(float).tolist()
    np.testing.assert_array_equal(run.history[-1], run.Q)
    some, none = (certainty_equivalent_control(maze, 0.95, 30, record=k, rng=rng(3), **options) for k in (7, 0))
    np.testing.assert_array_equal(some.history, run.history[::7])
    assert none.history is None and np.array_equal(none.Q, run.Q) and none.model == run.model
    assert run.visits is None and run.weights is None


def test_certainty_equivalence_without_optimism_may_stay_with_a_detour():
    steps = [
        certainty_equivalent_control(dyna_maze(), 0.95, 15, epsilon=0.0, rng=rng(seed)).lengths[-1] for seed in range(5)
    ]
    assert min(steps) >= 14 and max(steps) > 14


@pytest.mark.parametrize("epsilon", [0.0, 0.4])
def test_certainty_equivalence_acts_at_random_as_often_as_it_is_told(epsilon):
    grid = gridworld(3, 3)
    run = certainty_equivalent_control(grid, 0.9, 200, epsilon=epsilon, rng=rng(1))
    steps = -grid.start @ solve_policy(grid, soft_greedy(value_iteration(grid, 0.9).Q, epsilon), 1.0)  # -1 a step
    late = run.lengths[50:]
    # over 20 seeds at most 2.0 standard errors off; with epsilon = 0 in place of 0.4, more than 10
    assert abs(late.mean() - steps) < 5 * late.std() / np.sqrt(late.size) + 1e-9


def test_an_estimated_model_keeps_what_the_data_do_not_show():
    data = Transitions(*map(np.array, ([0], [0], [1.0], [1])))
    legal = np.array([[1, 1, 0]] * 2 + [[0, 0, 0]] * 2)  # nobody has the last action, nobody met the last state
    model = estimate_model(data, 4, 3, terminal=[2, 3], legal=legal, start=1)
    assert model == FiniteMDP.from_outcomes(
        {(0, 0): [(1, 1, 1)], (0, 1): [(1, 0, 0)], (1, 0): [(1, 1, 0)], (1, 1): [(1, 1, 0)]},
        n_states=4, n_actions=3, start=1,
    )  # fmt: skip


def test_predictions_of_counts_are_means():
    data = Transitions(*map(np.array, ([0, 0, 0], [0, 0, 0], [1.0, 1.0, 2.0], [1, 1, 0])))
    run = PlanningRun(np.zeros(1), np.ones(1), model=estimate_model(data, 3, 2, terminal=[2]))
    p, r = predict(run, 0, 0)
    np.testing.assert_allclose(p, [1 / 3, 2 / 3, 0], atol=1e-15)
    assert r == pytest.approx(4 / 3, abs=1e-15)


def test_certainty_equivalence_of_one_endless_state_by_hand():
    # reward 1, gamma = 1/2: each plan is one sweep nearer to 2 than the one that it starts from
    endless = FiniteMDP.from_outcomes({(0, 0): [(1, 0, 1)]})
    run = certainty_equivalent_control(endless, 0.5, 2, max_steps=3, record=1, rng=rng())
    assert run.lengths.tolist() == [3, 3] and run.returns.tolist() == [3.0, 3.0]
    q = run.history[:, 0, 0]
    assert q[0] == 0 and 0 < 2 - q[1] < 1e-8 and 2 - q[2] == (2 - q[1]) / 2
    assert run.Q[0, 0] == q[2] and run.V[0] == 2 * q[2] - 2 and run.policy.tolist() == [[1.0]]


def test_certainty_equivalence_needs_a_discount():
    with pytest.raises(ValueError, match="gamma: got 1, must be below 1: pairs that were never tried"):
        certainty_equivalent_control(small_world(), 1.0, 2, rng=rng())


def test_certainty_equivalence_is_told_what_does_not_have_to_be_learned():
    world = small_world()
    run = certainty_equivalent_control(world, 0.9, 2, max_steps=4, rng=rng())
    for name in ("legal", "terminal", "start"):
        np.testing.assert_array_equal(getattr(run.model, name), getattr(world, name))
    assert run.returns.shape == run.lengths.shape == (2,) and run.lengths.max() <= 4


def test_certainty_equivalence_explores_once_in_ten_for_ten_thousand_steps_at_most():
    world, endless = small_world(), FiniteMDP.from_outcomes({(0, 0): [(1, 0, 0)]})
    plain = certainty_equivalent_control(world, 0.9, 6, record=1, rng=rng(1))
    explicit = certainty_equivalent_control(world, 0.9, 6, epsilon=0.1, unseen=0.0, record=1, rng=rng(1))
    np.testing.assert_array_equal(plain.history, explicit.history)
    assert certainty_equivalent_control(endless, 0.9, 1, rng=rng()).lengths.tolist() == [10_000]


# ---------------------------------------------------------------------- Dyna-Q


def test_without_planning_one_update_is_the_q_learning_update():
    robot = recycling_robot()
    Q0 = np.array([[1.0, 2.0, 0.0], [3.0, 5.0, 4.0]])
    run = learn(robot, 1, alpha=0.5, epsilon=0.0, gamma=0.9, Q0=Q0, max_steps=1)
    # greedy in `high` is wait: reward 1, stays; 2 + 0.5 (1 + 0.9 * 2 - 2)
    assert run.Q[0].tolist() == [1.0, 2.4, -np.inf] and run.Q[1].tolist() == [3.0, 5.0, 4.0]
    assert run.returns.tolist() == [1.0] and run.lengths.tolist() == [1]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kappa", [0.0, 0.4])
@pytest.mark.parametrize("n_planning", [0, 3])
def test_dyna_is_what_a_second_program_of_it_does(n_planning, kappa, seed):
    first, later = small_world(), small_world(bonus=1.0)
    Q0 = np.array([[1.0, 2.0], [0.5, -1.0], [7.0, 4.0], [9.0, 9.0]])
    run = learn(first, 5, n_planning=n_planning, kappa=kappa, alpha=0.5, epsilon=0.4, gamma=0.9, max_steps=4,
                seed=seed, Q0=Q0, change=(6, later), record=1)  # fmt: skip
    Q = np.array([[1.0, 2.0], [0.5, -1.0], [-np.inf, 4.0], [0.0, 0.0]])
    table, returns, lengths, history = dictionary_dyna(
        first, later, 6, 5, n_planning, 0.5, 0.4, kappa, 0.9, 4, Q, rng(seed)
    )
    assert run.returns.tolist() == returns and run.lengths.tolist() == lengths and run.lengths.dtype == np.int64
    np.testing.assert_allclose(run.history, history, rtol=1e-12)
    np.testing.assert_array_equal(run.Q, run.history[-1])
    assert run.V.tolist() == run.Q.max(axis=1).tolist()
    np.testing.assert_array_equal(run.policy[:3], np.eye(2)[run.Q[:3].argmax(axis=1)])
    if n_planning:
        known = {(s, a): (r, s_next) for s, row in table.items() for a, (r, s_next, _) in row.items()}
        rows = {(s, a): known.get((s, a), (0.0, s)) for s, a in zip(*np.nonzero(first.legal)) if s != 3}
        assert run.model == FiniteMDP.from_outcomes(
            {pair: [(1.0, s_next, r)] for pair, (r, s_next) in rows.items()}, n_states=4, start=first.start
        )
    else:
        assert run.model is None


def test_one_replay_carries_the_reward_back_through_all_states_met():
    # a chain of three steps that pays 1 at its end; 200 replays of three pairs reach each of them
    chain = FiniteMDP.from_outcomes({(s, 0): [(1, s + 1, float(s == 2))] for s in range(3)}, start=0)
    run = learn(chain, 1, n_planning=200, alpha=1.0, gamma=0.5, record=1)
    assert run.V.tolist() == [0.25, 0.5, 1.0, 0.0] and run.lengths.tolist() == [3]
    assert run.history[0].tolist() == [[0.0]] * 4 and run.history[1].tolist() == run.Q.tolist()


def test_an_action_gains_the_root_of_the_steps_since_it_was_tried():
    # one state, gamma = 0, alpha = 1: a replay leaves kappa times the root, untried actions count from step 0
    both = FiniteMDP.from_outcomes({(0, a): [(1, 0, 0)] for a in range(2)})
    for n_steps, roots in ((1, [[1, 1]]), (2, [[1, 2], [2, 1]]), (3, [[1, 2], [2, 1]])):
        run = learn(both, 1, n_planning=60, kappa=0.5, alpha=1.0, epsilon=0.0, gamma=0.0, max_steps=n_steps)
        assert run.Q.tolist() in (0.5 * np.sqrt(roots))[:, None].tolist()  # greedy: takes turns


def test_defaults_of_dyna_are_plain_q_learning_from_zero():
    plain = learn(small_world(), 4, n_planning=2, gamma=0.9, record=1)
    options = dict(Q0=0.0, kappa=0.0, max_steps=None, change=None, record=1)
    explicit = learn(small_world(), 4, n_planning=2, gamma=0.9, **options)
    np.testing.assert_array_equal(plain.history, explicit.history)
    assert np.all(plain.history[0][small_world().legal] == 0)


def test_first_episode_changes_one_entry_without_planning_and_many_with():
    plain, dyna = learn(dyna_maze(), 1), learn(dyna_maze(), 1, n_planning=50)
    assert np.count_nonzero(plain.Q > 0) == 1 and plain.Q.max() == pytest.approx(0.1)
    # the goal ends the episode; its planning steps carry the value back once
    assert np.count_nonzero(dyna.Q > 0) >= 2


def test_planning_replays_only_what_was_remembered():
    """Two states in a row that pay 1 at the end: with alpha = 1 one pass and enough replays give the exact values."""
    walk = random_walk(3, rewards=(0.0, 1.0))
    run = learn(walk, 50, n_planning=200, alpha=1.0, epsilon=1.0, gamma=0.5)
    model = run.model
    s = np.flatnonzero(~walk.terminal)
    r, s_next = model.reward[s, 0, 0], model.next_state[s, 0, 0]
    np.testing.assert_array_equal(run.Q[s, 0], r + 0.5 * run.Q[s_next, 0])  # a fixed point of its own last memories


def test_converges_to_the_optimum_where_the_world_is_deterministic():
    maze = dyna_maze()
    exact = value_iteration(maze, 0.95, tol=1e-12).Q
    run = learn(maze, 300, n_planning=50, alpha=0.5, epsilon=0.5)
    reached = np.isin(np.arange(54), np.unique(maze.next_state[exact.max(axis=1) > 0])) & (exact.max(axis=1) > 0)
    np.testing.assert_allclose(run.Q[reached], exact[reached], atol=1e-6)


def test_behaviour_at_random_still_learns_the_optimal_values():
    # stochastic world, no planning: epsilon = 1 never follows its own estimates
    mdp = random_mdp(4, 2, rng=rng(0))
    exact = value_iteration(mdp, 0.5).Q
    run = dyna_q(mdp, 0.5, 1, n_planning=0, alpha=0.005, epsilon=1.0, max_steps=400_000, rng=rng(4))
    # worst error over 10 seeds 0.06; SARSA's fixed point (the random policy's values) is 0.40 away
    assert np.abs(run.Q - exact).max() < 0.15


@pytest.mark.parametrize("n_planning, episode, published, band", [
    (0, 1, 882.564, 680.37),
    (0, 2, 705.073, 566.97),
    (0, 20, 47.308, 34.08),
    (5, 5, 23.014, 9.67),
    (5, 10, 17.105, 2.17),
    (5, 20, 16.839, 2.15),
    (50, 1, 940.0375, 851.04),
    (50, 2, 39.155, 9.11),
    (50, 10, 16.85, 2.63),
    (50, 20, 16.735, 2.55),
])  # fmt: skip
def test_steps_per_episode_of_the_maze(n_planning, episode, published, band):
    # Sutton and Barto (2018), figure 8.2; bands for 30 runs: 4 standard deviations of the mean of 30 runs
    assert lengths(n_planning, 30)[:, episode - 1].mean() == pytest.approx(published, abs=band)


def test_planning_saves_real_steps():
    # 200 runs: 4,360 / 1,390 / 1,200 steps in 20 episodes, standard errors 90 / 58 / 53
    total = [lengths(n, 200).sum(axis=1).mean() for n in (0, 5, 50)]
    np.testing.assert_allclose(total, [4364, 1392, 1201], atol=330)


def test_bonus_finds_the_way_that_opens_and_a_stale_plan_never_does():
    first, second = blocking_maze(gap="right"), blocking_maze(gap="left")
    stale = value_iteration(first, 0.95).pi
    data = sample_transitions(second, stale, 2_000, rng=rng(0))
    assert data.r.sum() == 0  # runs into the wall that its model does not have
    late = []
    for kappa in (0.0, 1e-3):
        totals = []
        for child in rng(1).spawn(10):
            run = dyna_q(first, 0.95, 300, n_planning=10, alpha=1.0, epsilon=0.1, kappa=kappa,
                         change=(1000, second), max_steps=3000, rng=child)  # fmt: skip
            totals.append(np.sum(np.cumsum(run.lengths) <= 3000))
        late.append(np.mean(totals))
    # episodes ended by step 3000, 10 runs: 69 to 75 without bonus, 121 to 143 with it (5 blocks of seeds)
    assert late[1] > late[0] + 25


@pytest.mark.parametrize("n_planning", [0, 3])
def test_dyna_with_a_schedule_that_never_falls_is_dyna_with_a_number(n_planning):
    plain = learn(small_world(), 6, n_planning=n_planning, alpha=0.3, epsilon=0.2, record=1)
    for per_step in (False, True):
        epsilon = decaying(0.2, rate=0.0, per_step=per_step)
        same = learn(small_world(), 6, n_planning=n_planning, alpha=decaying(0.3, rate=0.0), epsilon=epsilon, record=1)
        np.testing.assert_array_equal(plain.history, same.history)
    falls = learn(small_world(), 6, n_planning=n_planning, alpha=decaying(0.3), epsilon=decaying(0.2), record=1)
    assert not np.array_equal(plain.Q, falls.Q)


def test_replays_count_as_updates_of_their_pair():
    # one state, reward 3, gamma = 0: the n-th update of a pair leaves 1 - 0.5 / n of what 3 - Q was
    both = FiniteMDP.from_outcomes({(0, a): [(1, 0, 3)] for a in range(2)})
    run = learn(both, 2, n_planning=4, alpha=decaying(0.5), epsilon=1.0, gamma=0.0, max_steps=7)
    assert run.visits.sum() == 2 * 7 * (1 + 4) and run.visits.min() > 0
    left = [3 * np.prod([1 - 0.5 / n for n in range(1, N + 1)]) for N in run.visits[0]]
    np.testing.assert_allclose(run.Q[0], 3 - np.array(left), rtol=1e-12)


def test_record_thins_the_history_of_dyna():
    full, thin, none = (learn(dyna_maze(), 7, n_planning=2, record=k) for k in (1, 3, 0))
    np.testing.assert_array_equal(full.history[::3], thin.history)
    assert none.history is None and len(full.history) == 8
    for run in (thin, none):
        for name in ("returns", "lengths", "V", "Q", "policy", "visits"):
            np.testing.assert_array_equal(getattr(full, name), getattr(run, name))
        assert full.model == run.model


@pytest.mark.parametrize("mdp", [small_world(), dyna_maze(), random_walk(5)], ids=["small", "maze", "walk"])
@pytest.mark.parametrize("kappa", [0.0, 0.1])
def test_an_environment_gives_dyna_the_bits_of_its_process(mdp, kappa):
    options = dict(n_planning=3, kappa=kappa, alpha=decaying(0.9, rate=0.1), epsilon=0.3, max_steps=60, record=1)
    here, there = learn(mdp, 6, **options), learn(MDPEnv(mdp), 6, **options)
    for name in ("returns", "lengths", "V", "Q", "policy", "history", "visits"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert here.model == there.model
    cut = learn(gym.wrappers.TimeLimit(MDPEnv(mdp), 60), 6, **options | dict(max_steps=None))
    np.testing.assert_array_equal(here.history, cut.history)


@pytest.mark.parametrize("name", ["FrozenLake-v1", "CliffWalking-v1", "Taxi-v4"])
def test_dyna_in_environments_of_gymnasium(name):
    options = dict(n_planning=4, alpha=0.5, epsilon=0.5, max_steps=80, record=1)
    env = gym.make(name)
    by_id, by_hand = learn(name, 8, **options), learn(env, 8, **options)
    np.testing.assert_array_equal(by_id.history, by_hand.history)
    assert by_id.model == by_hand.model and by_id.history.shape == (9, env.observation_space.n, env.action_space.n)
    exact = FiniteMDP.from_env(env)
    for s, a in np.argwhere(by_id.visits > 0):  # remembered: one of the outcomes that there are
        p, r = predict(by_id, s, a)
        assert exact.p(p.argmax(), r, s, a) > 0
    assert not (by_id.model.terminal & ~exact.terminal).any()


class Laps(gym.Env):
    """From state 0 to 1 and back, where the episode ends and the next one starts."""

    observation_space, action_space = gym.spaces.Discrete(2), gym.spaces.Discrete(1)

    def reset(self, *, seed=None, options=None):
        self.s = 0
        return 0, {}

    def step(self, a):
        self.s = 1 - self.s
        return self.s, float(self.s == 0), self.s == 0, False, {}


def test_an_end_in_a_state_that_goes_on_counts_nothing():
    run = learn(Laps(), 30, n_planning=50, alpha=1.0, gamma=0.5)
    assert run.Q.tolist() == [[0.5], [1.0]] and (run.returns == 1).all() and (run.lengths == 2).all()
    assert not run.model.terminal.any() and predict(run, 1, 0)[1] == 1.0


def test_a_bonus_prefers_what_was_not_tried_for_long():
    corridor = random_walk(3)
    run = learn(corridor, 1, n_planning=5, kappa=1.0, alpha=0.1, max_steps=20)
    plain = learn(corridor, 1, n_planning=5, kappa=0.0, alpha=0.1, max_steps=20)
    assert run.Q.max() > plain.Q.max()


def test_truncation_is_not_termination():
    # one step, then cut: the bootstrap from the state reached must be there
    walk = random_walk(5)
    run = learn(walk, 1, alpha=1.0, gamma=0.5, Q0=2.0, max_steps=1)
    assert run.Q[3, 0] == 0.5 * 2.0
    assert run.Q[0, 0] == 0.0 and run.Q[6, 0] == 0.0  # terminal states stay 0


def test_change_comes_at_its_step():
    first, second = blocking_maze(gap="right"), blocking_maze(gap="left")
    never = learn(first, 5, change=(10**9, second))
    plain, at_once = learn(first, 5), learn(first, 5, change=(0, second))
    np.testing.assert_array_equal(never.Q, plain.Q)
    np.testing.assert_array_equal(at_once.Q, learn(second, 5).Q)


def test_change_comes_between_two_steps():
    slow, fast = (FiniteMDP.from_outcomes({(0, 0): [(1, 0, r)]}) for r in (1, 10))
    for at, total in ((0, 50), (1, 41), (3, 23), (4, 14), (5, 5)):
        assert learn(slow, 1, max_steps=5, change=(at, fast)).returns.tolist() == [total]
    assert learn(slow, 2, max_steps=2, change=(3, fast)).returns.tolist() == [2, 11]  # steps go on over episodes


def test_same_generator_same_run():
    a, b = (learn(dyna_maze(), 5, n_planning=3, record=1) for _ in range(2))
    for name in ("returns", "lengths", "V", "Q", "policy", "history", "visits"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert not np.array_equal(a.lengths, learn(dyna_maze(), 5, n_planning=3, seed=1).lengths)


@pytest.mark.long
def test_plain_python_gives_the_same_bits():
    code = """if True:
        import numpy as np
        from rlcore.envs import dyna_maze, recycling_robot
        from rlcore.mdp import uniform_policy
        from rlcore.planning import dyna_q, sample_transitions
        run = dyna_q(dyna_maze(), 0.95, 3, n_planning=4, alpha=0.1, epsilon=0.1, kappa=0.01,
                     change=(500, dyna_maze(walls=())), rng=np.random.default_rng(7))
        robot = recycling_robot()
        data = sample_transitions(robot, uniform_policy(robot), 50, rng=np.random.default_rng(7))
        print(run.Q.tobytes().hex(), run.lengths.tolist(), data.s_next.tolist(), data.r.tolist())"""
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "RLCORE_NO_NUMBA": plain},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for plain in ("0", "1")
    }
    assert len(outputs) == 1


def test_epsilon_greedy_frequencies():
    Q = np.array([[1.0, 1.0, 0.0, -np.inf]])
    generator = rng(5)
    counts = np.bincount([epsilon_greedy(Q, 0, 0.3, generator) for _ in range(20_000)], minlength=4) / 20_000
    np.testing.assert_allclose(counts, [0.45, 0.45, 0.1, 0.0], atol=0.015)  # 4 standard errors
    np.testing.assert_allclose(soft_greedy(Q, 0.3)[0], [0.45, 0.45, 0.1, 0.0])
    assert max_value(np.array([[-3.0, -2.0, -5.0]]), 0) == -2.0 and max_value(np.array([[4.0, -2.0]]), 0) == 4.0


def test_recorded_actions_matter_and_their_author_does_not():
    mdp = random_mdp(4, 2, rng=rng(0))
    exact = value_iteration(mdp, 0.5).Q
    data = sample_transitions(mdp, uniform_policy(mdp), 400_000, rng=rng(1))
    labels = Transitions(data.s, (rng(2).random(data.a.size) < 0.5).astype(int), data.r, data.s_next)
    true, mislabelled = (np.abs(replay(d, 4, 2, 0.5, alpha=0.005) - exact).max() for d in (data, labels))
    # over 10 seeds: 0.16 at worst with the true actions, 0.79 at least with random labels
    assert true < 0.4 < mislabelled


def test_replay_is_the_q_learning_update():
    data = Transitions(*map(np.array, ([0, 1, 0], [1, 0, 1], [2.0, -1.0, 0.0], [1, 0, 1])))
    # 0.5 * 2 = 1; then 0.5 (-1 + 0.8 * 1) = -0.1; then 1 + 0.5 (0 + 0.8 * 0 - 1)
    np.testing.assert_allclose(replay(data, 2, 2, 0.8, alpha=0.5), [[0.0, 0.5], [-0.1, 0.0]], atol=1e-15)


def test_replay_starts_from_the_first_estimates():
    data = Transitions(*map(np.array, ([0, 1, 0], [1, 0, 1], [2.0, -1.0, 0.0], [1, 0, 1])))
    # 1 + 0.5 (2 + 0.8 - 1) = 1.9; 1 + 0.5 (-1 + 0.8 * 1.9 - 1) = 0.76; 1.9 + 0.5 (0 + 0.8 - 1.9) = 1.35
    np.testing.assert_allclose(replay(data, 2, 2, 0.8, alpha=0.5, Q0=1), [[1.0, 1.35], [0.76, 1.0]], atol=1e-15)


def test_replay_of_nothing_and_of_one_bad_row():
    nothing = Transitions(*(np.zeros(0, kind) for kind in (int, int, float, int)))
    assert replay(nothing, 2, 3, 0.8, alpha=0.5, Q0=0.25).tolist() == [[0.25] * 3] * 2
    for column in (0, 1, 3):
        rows = np.zeros((4, 2), int)
        rows[column, 0] = 2
        with pytest.raises(ValueError, match="^data:"):
            replay(Transitions(*rows), 2, 2, 0.8, alpha=0.5)


# ---------------------------------------------------------------------- predictions


def test_model_based_results_answer_predict_and_others_do_not():
    maze = dyna_maze()
    dyna = learn(maze, 3, n_planning=5)
    p, r = predict(dyna, 7 + 9, 0)  # (1, 7) is a wall that nobody stands on: unknown, stays
    assert p[16] == 1 and r == 0
    p, r = predict(dyna, 17, 0)  # up from (1, 8): the goal
    assert p[8] == 1 and r == 1
    for run in (learn(maze, 3), value_iteration(maze, 0.95), cartpole_reinforce(1)):
        with pytest.raises(ValueError, match="^run:"):
            predict(run, 0, 0)
    with pytest.raises(ValueError, match="^s:"):
        predict(dyna, 54, 0)
    with pytest.raises(ValueError, match="^a:"):
        predict(dyna, 0, 4)


# ---------------------------------------------------------------------- cart-pole


def test_cartpole_is_that_of_gymnasium_step_for_step():
    gym = pytest.importorskip("gymnasium")
    env = gym.make("CartPole-v1").unwrapped
    for seed in range(5):
        x = np.asarray(env.reset(seed=seed)[0], float)
        env.state = tuple(x)
        ended = False
        while not ended:
            a = int(env.np_random.random() < 0.5)
            _, _, ended, _, _ = env.step(a)
            x = cartpole_step(x, a)
            np.testing.assert_allclose(x, env.state, rtol=0, atol=1e-12)
            assert cartpole_upright(x) == (not ended)


def test_least_squares_recovers_a_linear_world():
    generator = rng(0)
    W = generator.normal(size=(5, 3))
    x, a = generator.normal(size=(40, 3)), generator.integers(2, size=40)
    fitted = fit_linear_dynamics(x, a, linear_dynamics(W, x, a), 2)
    np.testing.assert_allclose(fitted, W, atol=1e-10)


def test_a_linear_model_takes_lists_of_whole_numbers():
    # x' = 2 x + 1 for action 0, 2 x - 1 for action 1
    W = fit_linear_dynamics([[0], [1], [2], [3]], [0.0, 1.0, 0.0, 1.0], [[1], [1], [5], [5]], 2)
    np.testing.assert_allclose(W, [[2], [1], [-1]], atol=1e-12)
    np.testing.assert_allclose(linear_dynamics(W, [[5], [5]], [0.0, 1.0]), [[11], [9]], atol=1e-12)


def test_linear_model_of_the_cartpole_is_almost_exact_one_step_ahead():
    W = fit_linear_dynamics(*cartpole_transitions(500, rng=rng(0)), 2)
    x, a, x_next = cartpole_transitions(500, rng=rng(1))
    change, error = x_next - x, linear_dynamics(W, x, a) - x_next
    unexplained = (error**2).mean(axis=0) / change.var(axis=0)
    assert unexplained.max() < 0.01  # R^2 > 0.99 of the changes; measured 5e-5 at worst over 20 seeds


@pytest.mark.parametrize("n", [20, 50, 100, 300])
def test_shooting_in_the_learned_model_balances(n):
    steps = []
    for generator in rng(n).spawn(5):
        model = functools.partial(linear_dynamics, fit_linear_dynamics(*cartpole_transitions(n, rng=generator), 2))
        shoot = functools.partial(
            random_shooting, model, lambda x: x[:, 2] ** 2 + 0.1 * x[:, 0] ** 2,
            n_actions=2, horizon=20, n_candidates=100, rng=generator,
        )  # fmt: skip
        steps.append(balance(shoot, rng=generator))
    assert steps == [200] * 5  # random pushes last 20 or so


def test_shooting_takes_the_first_action_of_the_cheapest_plan():
    # x' = x + a - 1 for a in 0, 1, 2; cost |x|: from 3 the best first move is down, from -3 up, from 0 none
    for x, best in ((3.0, 0), (-3.0, 2), (0.0, 1)):
        a = random_shooting(
            lambda x, a: x + a[:, None] - 1, lambda x: np.abs(x[:, 0]), [x], 3, horizon=2, n_candidates=500, rng=rng()
        )
        assert a == best


def test_open_loop_simulation_feeds_back_its_own_states():
    actions = np.array([[1, 0], [1, 1], [0, 2]])
    path = simulate(lambda x, a: 2 * x + a[:, None], [[1.0], [0.0]], actions)
    np.testing.assert_array_equal(path[:, :, 0], [[1, 0], [3, 0], [7, 1], [14, 4]])


def test_simulation_takes_lists_and_counts_in_floats():
    path = simulate(lambda x, a: x + a[:, None], [[1], [0]], [[1, 0], [1, 1]])
    assert path[:, :, 0].tolist() == [[1, 0], [2, 0], [3, 1]] and path.dtype == float


@pytest.mark.parametrize("seed", range(10))
def test_shooting_adds_up_the_costs_of_every_candidate(seed):
    x, plans, costs = [0.5, -1.0], np.floor(3 * rng(seed).random((4, 6))), []
    for plan in plans.T:
        state, total = np.array(x), 0.0
        for a in plan:
            state = 1.5 * state + [a - 1, 0.5]
            total += state[0] ** 2 + state[1] * state[0]
        costs.append(total)
    best = random_shooting(
        lambda x, a: 1.5 * x + np.stack([a - 1, 0.5 + 0 * a], axis=1), lambda x: x[:, 0] ** 2 + x[:, 1] * x[:, 0],
        x, 3, horizon=4, n_candidates=6, rng=rng(seed),
    )  # fmt: skip
    assert best == plans[0, np.argmin(costs)]


def test_start_and_transitions_are_within_bounds():
    x, a, x_next = cartpole_transitions(300, rng=rng(0))
    assert np.abs(cartpole_start(rng=rng())).max() <= 0.05 and cartpole_upright(x).all() and set(a) == {0, 1}
    np.testing.assert_array_equal(x_next, cartpole_step(x, a))
    fell = ~cartpole_upright(x_next)[:-1]
    np.testing.assert_array_equal(x[1:][~fell], x_next[:-1][~fell])
    assert fell.any() and np.abs(x[1:][fell]).max() <= 0.05


# ---------------------------------------------------------------------- model-free: REINFORCE, gradient descent


def cartpole_reinforce(n_episodes, *, alpha=0.2, seed=0):
    scale = np.array([2.4, 2.0, 0.21, 2.0])
    return reinforce_linear(
        cartpole_start, cartpole_step, cartpole_upright, 2, 0.99, n_episodes,
        alpha=alpha, scale=scale, rng=rng(seed),
    )  # fmt: skip


@pytest.mark.long
def test_reinforce_balances_after_thousands_of_steps():
    for seed in range(3):
        run = cartpole_reinforce(80, seed=seed)
        last = run.lengths[-10:].mean()
        # measured 151 to 200 over 10 seeds; random pushes 20
        assert last > 100 and run.lengths.sum() > 2000
    assert run.history.shape == (81, 2, 4)


def test_first_reinforce_step_is_the_gradient_by_hand():
    """Two steps, then the end: G = (1 + gamma, 1); with equal preferences the gradient of log pi is +-1/2."""
    run = reinforce_linear(
        lambda rng: np.array([1.0]), lambda x, a: x + 1, lambda x: x[0] < 3, 2, 0.5, 1, alpha=2.0, scale=2.0, rng=rng(0)
    )
    a = [int(rng_value >= 0.5) for rng_value in rng(0).random(2)]
    expected = np.zeros(2)
    for t, (G, x) in enumerate([(1.5 - 1.25, 0.5), (1.0 - 1.25, 1.0)]):
        expected += 2.0 * G * (np.eye(2)[a[t]] - 0.5) * x / 2
    np.testing.assert_allclose(run.policy[:, 0], expected, atol=1e-15)


@pytest.mark.parametrize("epsilon", [0.1, 1.0, 1.9, 2.1])
def test_gradient_descent_on_a_parabola_multiplies_by_one_minus_epsilon(epsilon):
    path = gradient_descent(lambda v: v, 2.0, epsilon, 20)
    np.testing.assert_allclose(path, 2.0 * (1 - epsilon) ** np.arange(21), rtol=1e-12, atol=1e-300)


# ---------------------------------------------------------------------- trajectories


@pytest.mark.parametrize("theta", [0.0, 0.3, 1.0])
def test_trajectory_probabilities_sum_to_one_and_give_the_value(theta):
    mdp = two_state_mdp()
    pi = np.tile([1 - theta, theta], (2, 1))
    states, actions, prob = trajectories(mdp, pi, 3)
    assert states.shape == actions.shape == (64, 3) and prob.sum() == pytest.approx(1, abs=1e-12)
    P, r = np.einsum("sa,sat->st", pi, mdp.transition_probs()), (pi * mdp.expected_reward()).sum(axis=1)
    assert objective(mdp, pi, 3) == pytest.approx(mdp.start @ (r + P @ (r + P @ r)), abs=1e-12)


def test_one_trajectory_by_hand():
    mdp = two_state_mdp()
    pi = np.array([[0.7, 0.3], [0.4, 0.6]])
    # start 1, change .3, to state 1 .8, stay .4, to state 1 .9, change .6
    assert trajectory_probability(mdp, pi, [0, 1, 1], [1, 0, 1]) == pytest.approx(0.3 * 0.8 * 0.4 * 0.9 * 0.6)
    assert trajectory_probability(mdp, pi, [1, 1, 1], [1, 0, 1]) == 0


# ---------------------------------------------------------------------- bad input


# from 0 to the terminal state 1, with one legal action of two; with both; and a state 1 that goes back
ONE_ACTION = FiniteMDP.from_outcomes({(0, 0): [(1, 1, 0)]}, n_actions=2)
TWO_ACTIONS = FiniteMDP.from_outcomes({(0, a): [(1, 1, 0)] for a in range(2)})
ENDLESS = FiniteMDP.from_outcomes({pair: [(1, 1 - pair[0], 0)] for pair in ((0, 0), (1, 0), (1, 1))})


@pytest.mark.parametrize("options, name", [
    (dict(gamma=1.5), "gamma"), (dict(n_episodes=0), "n_episodes"), (dict(n_planning=-1), "n_planning"),
    (dict(alpha=0.0), "alpha"), (dict(alpha=1.1), "alpha"), (dict(epsilon=-0.1), "epsilon"),
    (dict(epsilon=2), "epsilon"), (dict(kappa=-1.0), "kappa"), (dict(max_steps=0), "max_steps"),
    (dict(Q0=np.nan), "Q0"), (dict(Q0=[1.0, 2.0]), "Q0"), (dict(world=None), "world"), (dict(rng=0), "rng"),
    (dict(world="Maze-v0"), "world"), (dict(kappa=np.inf), "kappa"), (dict(kappa=True), "kappa"),
    (dict(record=-1), "record"), (dict(record=0.5), "record"), (dict(n_planning=0.5), "n_planning"),
    (dict(alpha="fast"), "alpha"), (dict(max_steps=None, world=ENDLESS), "max_steps"),
    (dict(change=5), "change"), (dict(change=(5,)), "change"), (dict(change=(5, None)), "change"),
    (dict(change=(0.5, dyna_maze())), "change"), (dict(change=(5, MDPEnv(dyna_maze()))), "change"),
    (dict(change=(5, dyna_maze()), world=MDPEnv(dyna_maze())), "world"),
    (dict(change=(-1, dyna_maze())), "change"), (dict(change=(5, cliff_walking())), "change"),
    (dict(change=(5, TWO_ACTIONS), world=ONE_ACTION), "change"),
    (dict(change=(5, ENDLESS), world=ONE_ACTION), "change"),
])  # fmt: skip
def test_bad_arguments_of_dyna_q(options, name):
    settings = dict(n_planning=0, alpha=0.1, epsilon=0.1, rng=rng())
    with pytest.raises(ValueError, match=f"^{name}:"):
        dyna_q(**(dict(world=dyna_maze(), gamma=0.9, n_episodes=1) | settings | options))


@pytest.mark.parametrize("call, name", [
    (lambda d: estimate_model(d, 0, 2), "n_states"),
    (lambda d: estimate_model(d, 2, 2, terminal=[2]), "terminal"),
    (lambda d: estimate_model(d, 2, 2, terminal=[0]), "data"),
    (lambda d: estimate_model(d, 2, 1), "data"),
    (lambda d: estimate_model(d, 2, 2, legal=np.ones((2, 3))), "legal"),
    (lambda d: estimate_model(d, 2, 2, legal=np.eye(2)), "data"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 0.9, 0, rng=rng()), "n_episodes"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 0.9, 1, epsilon=3, rng=rng()), "epsilon"),
    (lambda d: certainty_equivalent_control(None, 0.9, 1, rng=rng()), "world"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 1.5, 1, rng=rng()), "gamma"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 0.9, 1, rng=0), "rng"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 0.9, 1, record=-1, rng=rng()), "record"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 0.9, 1, unseen=np.nan, rng=rng()), "unseen"),
    (lambda d: certainty_equivalent_control(dyna_maze(), 0.9, 1, max_steps=0, rng=rng()), "max_steps"),
    (lambda d: estimate_model(Transitions(d.s + 2, d.a, d.r, d.s_next), 2, 2), "data"),
    (lambda d: sample_transitions(dyna_maze(), uniform_policy(dyna_maze()), 0, rng=rng()), "n_steps"),
    (lambda d: sample_transitions(dyna_maze(), uniform_policy(dyna_maze()), 1, rng=0), "rng"),
    (lambda d: sample_transitions(dyna_maze(), 2 * uniform_policy(dyna_maze()), 1, rng=rng()), "pi"),
    (lambda d: fit_linear_dynamics(np.zeros(3), [0, 1, 1], np.zeros(3), 2), "x"),
    (lambda d: fit_linear_dynamics(np.zeros((3, 2)), [0, 1, 1], np.zeros((3, 1)), 2), "x_next"),
    (lambda d: fit_linear_dynamics(np.zeros((3, 2)), [0, 1], np.zeros((3, 2)), 2), "a"),
    (lambda d: random_shooting(np.add, np.sum, [0.0], 2, horizon=0, n_candidates=5, rng=rng()), "horizon"),
    (lambda d: random_shooting(np.add, np.sum, [0.0], 2, horizon=3, n_candidates=0, rng=rng()), "n_candidates"),
    (lambda d: random_shooting(np.add, np.sum, [0.0], 0, horizon=3, n_candidates=5, rng=rng()), "n_actions"),
    (lambda d: random_shooting(np.add, np.sum, [0.0], 2, horizon=3, n_candidates=5, rng=0), "rng"),
    (lambda d: cartpole_transitions(0, rng=rng()), "n"),
    (lambda d: replay(d, 1, 2, 0.9, alpha=0.1), "data"),
    (lambda d: replay(d, 2, 1, 0.9, alpha=0.1), "data"),
    (lambda d: replay(d, 2, 2, 0.9, alpha=0.0), "alpha"),
    (lambda d: replay(d, 2, 2, 1.5, alpha=0.1), "gamma"),
    (lambda d: replay(d, 0, 2, 0.9, alpha=0.1), "n_states"),
    (lambda d: replay(d, 2, 0, 0.9, alpha=0.1), "n_actions"),
    (lambda d: replay(Transitions(d.s_next, d.a, d.r, d.s), 1, 2, 0.9, alpha=0.1), "data"),
    (lambda d: gradient_descent(2.0, 1.0, 0.1, 5), "gradient"),
    (lambda d: gradient_descent(lambda v: v, 1.0, np.inf, 5), "epsilon"),
    (lambda d: gradient_descent(lambda v: v, 1.0, 0.1, 0), "n_steps"),
    (lambda d: cartpole_reinforce(0), "n_episodes"),
    (lambda d: cartpole_reinforce(1, alpha=0.0), "alpha"),
    (lambda d: trajectories(two_state_mdp(), np.full((2, 2), 0.5), 0), "T"),
    (lambda d: trajectory_probability(two_state_mdp(), np.full((2, 2), 0.5), [0], [0, 1]), "actions"),
    (lambda d: trajectory_probability(two_state_mdp(), np.full((2, 2), 0.5), [], []), "states"),
    (lambda d: trajectory_probability(two_state_mdp(), np.full((2, 2), 0.5), [[0]], [[0]]), "states"),
])  # fmt: skip
def test_bad_arguments(call, name):
    data = Transitions(*map(np.array, ([0], [1], [0.0], [1])))
    with pytest.raises(ValueError, match=f"^{name}:"):
        call(data)


def test_illegal_actions_stay_out():
    robot = recycling_robot()
    run = learn(robot, 1, n_planning=3, epsilon=1.0, kappa=0.1, gamma=0.9, max_steps=200)
    assert run.Q[0, 2] == -np.inf and np.isfinite(run.Q[1]).all() and run.policy[0, 2] == 0
    assert run.model.legal.tolist() == robot.legal.tolist()
    deterministic_policy(robot, run.policy.argmax(axis=1))


@pytest.mark.parametrize("column", ["s", "a", "s_next"])
def test_negative_states_and_actions_of_data_are_refused(column):
    rows = {"s": [0, 1], "a": [0, 1], "r": [1.0, 1.0], "s_next": [1, 0]} | {column: [-1, 1]}
    data = Transitions(*(np.array(rows[name]) for name in ("s", "a", "r", "s_next")))
    with pytest.raises(ValueError, match=f"^data: {column} runs from -1 to 1, must be in 0..1"):
        replay(data, 2, 2, 0.9, alpha=0.1)
    with pytest.raises(ValueError):
        estimate_model(data, 2, 2)
