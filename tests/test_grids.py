"""The grid worlds against the published distances and values."""

import numpy as np
import pytest

from rlcore.bellman import greedy_actions, q_from_v, solve_policy
from rlcore.dp import policy_iteration, value_iteration
from rlcore.envs import blocking_maze, cliff_walking, dyna_maze, maze, short_corridor, two_goal_maze, windy_gridworld
from rlcore.mdp import uniform_policy

UP, DOWN, RIGHT, LEFT = range(4)


def steps_to_goal(mdp):
    """Length of the shortest path from the start, read off V_* = gamma^(steps - 1)."""
    V = value_iteration(mdp, 0.5).V[mdp.start.argmax()]
    return round(1 - np.log2(V))


def test_dyna_maze_takes_14_steps_and_has_47_states_to_stand_on():
    mdp = dyna_maze()
    assert mdp.start.argmax() == 18 and mdp.terminal.nonzero()[0].tolist() == [8]
    assert steps_to_goal(mdp) == 14
    # Sutton and Barto (2018), figure 8.2, at gamma = 0.95: 0.95^13
    assert value_iteration(mdp, 0.95).V[18] == pytest.approx(0.5133420832795047, abs=1e-9)
    reached = set(np.unique(mdp.next_state[[s for s in range(54) if s not in (11, 20, 29, 41, 7, 16, 25)]]))
    assert len(reached) == 47 and not reached & {11, 20, 29, 41, 7, 16, 25}


def test_moves_walls_and_edges():
    mdp = maze(2, 3, walls=[(0, 1)], start=(0, 0), goals={(0, 2): 5.0})
    assert mdp.next_state[0, :, 0].tolist() == [0, 3, 0, 0]  # up: edge, down, right: wall, left: edge
    assert mdp.next_state[4, :, 0].tolist() == [4, 4, 5, 3]
    assert mdp.reward[5, :, 0].tolist() == [5.0, 0.0, 0.0, 0.0] and mdp.next_state[5, UP, 0] == 2


def test_moving_the_goal_or_a_wall_moves_the_path():
    assert steps_to_goal(dyna_maze(goal=(5, 8))) == 11
    assert steps_to_goal(dyna_maze(walls=())) == 10


@pytest.mark.parametrize("gap, steps", [("right", 10), ("left", 16)])
def test_blocking_maze_path_lengths(gap, steps):
    # Sutton and Barto (2018), figure 8.4: 10 steps before the change, 16 after it
    assert steps_to_goal(blocking_maze(gap=gap)) == steps


def test_two_goals_and_their_worth_from_the_start():
    mdp = two_goal_maze()
    start = mdp.start.argmax()
    assert value_iteration(mdp, 0.95).V[start] == pytest.approx(0.95**2)
    assert value_iteration(two_goal_maze(far=0.0), 0.95).V[start] == pytest.approx(0.2 * 0.95)


def test_cliff_walking_optimal_values():
    mdp = cliff_walking()
    Q = value_iteration(mdp, 1.0).Q
    assert Q[36].tolist() == [-13.0, -14.0, -113.0, -14.0]  # up along the edge: 13 steps; right: a fall first
    assert Q[0].tolist() == [-15.0, -14.0, -14.0, -15.0]
    assert mdp.start.argmax() == 36 and mdp.n_states == 48


def test_cliff_epsilon_greedy_around_the_optimum_is_worth_less():
    # exact chain: -50.80 with ties split evenly at epsilon = 0.1 (Sutton and Barto (2018), example 6.6, online return)
    mdp = cliff_walking()
    Q = value_iteration(mdp, 1.0).Q
    best = greedy_actions(Q)
    pi = 0.9 * best / best.sum(axis=1, keepdims=True) + 0.1 * uniform_policy(mdp)
    assert solve_policy(mdp, pi, 1.0)[36] == pytest.approx(-50.80004766676946, abs=1e-6)


def test_cliff_agrees_with_gymnasium():
    gym = pytest.importorskip("gymnasium")
    theirs = gym.make("CliffWalking-v1").unwrapped.P
    ours = cliff_walking()
    for s in [s for s in range(48) if not 37 <= s <= 47]:
        for a, b in ((UP, 0), (RIGHT, 1), (DOWN, 2), (LEFT, 3)):
            _, s_next, reward, _ = theirs[s][b][0]
            assert (ours.next_state[s, a, 0], ours.reward[s, a, 0]) == (s_next, reward)


@pytest.mark.parametrize("options, steps", [({}, 15), ({"king": True}, 7), ({"king": True, "stay": True}, 7)])
def test_windy_gridworld_path_lengths(options, steps):
    mdp = windy_gridworld(**options)
    assert value_iteration(mdp, 1.0).V[30] == -steps  # Sutton and Barto (2018), example 6.5 and exercise 6.9
    assert mdp.n_actions == 4 + 4 * ("king" in options) + ("stay" in options)


def test_wind_is_that_of_the_column_left():
    mdp = windy_gridworld()
    assert mdp.next_state[33, RIGHT, 0] == 24  # column 3 blows 1
    assert mdp.next_state[37 - 1, RIGHT, 0] == 17  # column 6 blows 2: past the goal
    assert mdp.next_state[6, UP, 0] == 6


def test_short_corridor_best_mixture():
    mdp = short_corridor()
    p = 2 - np.sqrt(2)
    V = solve_policy(mdp, np.tile([1 - p, p], (4, 1)), 1.0)
    # analytic, Sutton and Barto (2018), exercise 13.1
    np.testing.assert_allclose(V, [-11.656854249492381, -9.949747468305834, -5.121320343559644, 0.0], atol=1e-9)
    for q in (p - 0.01, p + 0.01):
        assert solve_policy(mdp, np.tile([1 - q, q], (4, 1)), 1.0)[0] < V[0]
    assert policy_iteration(mdp, 0.9).pi[:3].argmax(axis=1).tolist() == [1, 0, 1]
    assert q_from_v(mdp, 0.0, 1.0)[:3].max() == -1


@pytest.mark.parametrize(
    "call, name",
    [
        (lambda: maze(2, 2, start=(2, 0), goals={(0, 0): 1.0}), "start"),
        (lambda: maze(2, 2, start=(0, 0), goals={}), "goals"),
        (lambda: maze(2, 2, start=(0, 0), goals={(0, 0): 1.0}), "start"),
        (lambda: maze(2, 2, start=(0, 0), goals={(0, 1): 1.0}, walls=[(0, 1)]), "goals"),
        (lambda: maze(2, 2, start=(0, 0), goals={(0, 1): 1.0}, walls=[(0, -1)]), "walls"),
        (lambda: maze(0, 2, start=(0, 0), goals={(0, 1): 1.0}), "n_rows"),
        (lambda: dyna_maze(goal=(1, 2)), "goals"),
        (lambda: blocking_maze(gap="middle"), "gap"),
    ],
)
def test_bad_arguments(call, name):
    with pytest.raises(ValueError, match=f"^{name}:"):
        call()
