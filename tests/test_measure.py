"""Repeated runs, errors, first updates, and the world of an epsilon-greedy agent."""

import numpy as np
import pytest

from rlcore.batch import batch_mc
from rlcore.bellman import solve_policy
from rlcore.dp import policy_iteration, value_iteration
from rlcore.envs import cliff_walking, dyna_maze, gridworld, random_walk, recycling_robot
from rlcore.mdp import FiniteMDP, rollout, uniform_policy
from rlcore.policies import soft_greedy
from rlcore.studies.ch02 import backups_per_second
from rlcore.studies.ch04 import first_updates, repeat, squared_error, walk_error, with_random_actions
from rlcore.td import q_learning, sarsa, td0


def test_runs_differ_and_come_back():
    walk = random_walk(5)
    args = (td0, walk, uniform_policy(walk), 1.0, 20)
    runs, again = (repeat(*args, alpha=0.1, n_runs=3, rng=np.random.default_rng(0)) for _ in range(2))
    assert [np.array_equal(a.V, b.V) for a, b in zip(runs, again)] == [True] * 3
    assert len({run.V.tobytes() for run in runs}) == 3
    assert not np.array_equal(runs[0].V, repeat(*args, alpha=0.1, n_runs=1, rng=np.random.default_rng(1))[0].V)


def test_error_of_a_walk_leaves_the_ends_out():
    truth = np.arange(1, 6) / 6
    V = np.array([[9.0, 0.5, 0.5, 0.5, 0.5, 0.5, 9.0], [0.0, *truth, 0.0]])
    np.testing.assert_allclose(walk_error(V, truth), [np.sqrt(10 / 36 / 5), 0.0], atol=1e-15)
    assert walk_error(V[0], truth) == pytest.approx(0.23570226, abs=1e-8)  # where figure 17 starts
    with pytest.raises(ValueError, match=r"^V: got shape \(5,\), must be \(..., 7\)"):
        walk_error(truth, truth)


def test_the_mean_return_has_the_least_squared_error():
    walk = random_walk(5)
    episodes = [rollout(walk, uniform_policy(walk), 1000, rng=rng) for rng in np.random.default_rng(0).spawn(20)]
    V = batch_mc(episodes, 7, 0.9)
    least = squared_error(V, episodes, 0.9)
    for s in range(1, 6):
        for change in (-0.01, 0.01):
            assert squared_error(V + change * np.eye(7)[s], episodes, 0.9) > least
    assert squared_error(np.array([1.0, 0.0]), [([0, 1], [3.0])], 0.9) == 4.0
    assert squared_error(np.array([0.0, 1.0, 0.0]), [([0, 1, 2], [0.0, 3.0])], 0.5) == 1.5**2 + 2.0**2


@pytest.mark.long
@pytest.mark.parametrize("method", [sarsa, q_learning])
def test_first_updates_follow_each_other(method):
    rows = first_updates(method, cliff_walking(), 1.0, 12, alpha=0.5, epsilon=0.1, rng=np.random.default_rng(0))
    cliff, Q = cliff_walking(), np.zeros((48, 4))
    for row, after in zip(rows, rows[1:]):
        s_next, r = cliff.next_state[row.s, row.a, 0], cliff.reward[row.s, row.a, 0]
        assert row.s_next == s_next == after.s and row.old == Q[row.s, row.a]
        best = Q[s_next].max() if method is q_learning else Q[s_next, after.a]
        assert row.new == row.old + 0.5 * (r + best - row.old)
        Q[row.s, row.a] = row.new
    assert rows[0].s == 36 and rows[-1].s_next == -1
    assert [type(x) for x in rows[0]] == [int, int, int, float, float]


def test_first_updates_where_an_action_is_not_legal():
    mdp = FiniteMDP.from_outcomes({(0, 1): [(1.0, 1, 3.0)], (1, 0): [(1.0, 2, 1.0)], (1, 1): [(1.0, 2, 1.0)]}, start=0)
    [row] = first_updates(sarsa, mdp, 0.9, 1, alpha=0.5, epsilon=0.1, rng=np.random.default_rng(1))
    assert row == (0, 1, -1, 0.0, 1.5)


@pytest.mark.parametrize("epsilon, value", [(0.1, -20.71), (0.05, -17.519231855902312), (0.01, -15.44081065987908)])
def test_best_that_an_epsilon_greedy_agent_can_do_on_the_cliff(epsilon, value):
    cliff = cliff_walking()
    best = policy_iteration(with_random_actions(cliff, epsilon), 1.0)
    assert abs(best.V[36] - value) < (0.005 if epsilon == 0.1 else 1e-9)
    pi = (1 - epsilon) * best.pi + epsilon / 4
    np.testing.assert_allclose(solve_policy(cliff, pi, 1.0), best.V, atol=1e-8)
    assert rollout(cliff, best.pi, 100, rng=np.random.default_rng(0)).actions.size == 15


def test_random_actions_keep_to_what_is_legal():
    robot = recycling_robot()
    world, pi = with_random_actions(robot, 0.3), uniform_policy(robot)
    np.testing.assert_array_equal(world.legal, robot.legal)
    np.testing.assert_allclose(solve_policy(world, pi, 0.9), solve_policy(robot, pi, 0.9), atol=1e-12)
    same = with_random_actions(robot, 0.0)
    np.testing.assert_allclose(same.transition_probs(), robot.transition_probs(), atol=1e-15)
    maze = dyna_maze()
    q_star = policy_iteration(maze, 0.95).Q
    pi = soft_greedy(q_star, 0.1)
    soft = with_random_actions(maze, 0.1)
    np.testing.assert_allclose(
        solve_policy(soft, soft_greedy(q_star, 0.0), 0.95), solve_policy(maze, pi, 0.95), atol=1e-12
    )
    with pytest.raises(ValueError, match="^epsilon: got 2"):
        with_random_actions(maze, 2)


def test_backups_in_a_second_are_counted(monkeypatch):
    grid, clock = gridworld(20, 20), iter([10.0, 10.5])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    assert backups_per_second(grid) == value_iteration(grid, 0.9, tol=1e-3).n_iter * 400 / 0.5


def test_what_cannot_be_measured_is_refused():
    settings = dict(alpha=0.5, epsilon=0.0, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="^world: got str, must be a FiniteMDP"):
        first_updates(sarsa, "cliff", 1.0, 3, **settings)
    with pytest.raises(ValueError, match="^n_steps: got 2, but update 1 changes no entry"):
        first_updates(q_learning, dyna_maze(), 0.95, 2, **settings)
    with pytest.raises(ValueError, match=r"^V: got shape \(\), must be \(S,\)"):
        squared_error(0.0, [([0, 1], [3.0])], 0.9)
    for V, episode, gamma, says in (
        ([0.0, np.nan], ([0, 1], [3.0]), 0.9, "V: contains nan, must be finite"),
        ("ab", ([0, 1], [3.0]), 0.9, "V: got 'ab', must be numbers"),
        ([0.0, 1.0], ([0.0, 1.0], [3.0]), 0.9, "episodes: got dtype float64, must be integers"),
        ([0.0, 1.0], ([0, -1], [3.0]), 0.9, "states: got .*, must be .* states in 0..1"),
        ([0.0, 1.0], ([0, 2], [3.0]), 0.9, r"states: got .* states in 0\.\.1"),
        ([0.0, 1.0], ([0, 1], [np.inf]), 0.9, "episodes: contains inf, must be finite"),
        ([0.0, 1.0], ([0, 1], ["a"]), 0.9, "episodes: got .*, must be numbers"),
        (
            [0.0, 1.0],
            ([0, 1], []),
            0.9,
            "episodes: number 0 has .* states and .* rewards, must be lists, with a reward at least",
        ),
        ([0.0, 1.0], ([0, 1], [3.0]), 1.5, "gamma: got 1.5"),
    ):
        with pytest.raises(ValueError, match=f"^{says}"):
            squared_error(V, [episode], gamma)
    with pytest.raises(ValueError, match="^states: got 1, must be as many as rewards, or one more"):
        squared_error(np.zeros(2), [([0], [3.0, 1.0])], 0.9)
