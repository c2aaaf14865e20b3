"""Small worlds and experiments of chapter 2: games, metered models, where updates are spent, loops without reward."""

import numpy as np
import pytest

from rlcore.bellman import expectation_backup, heuristic_search, optimality_backup, q_from_v, solve_policy
from rlcore.dp import value_iteration
from rlcore.envs import (
    Metered,
    branching_mdp,
    dyna_maze,
    game_values,
    jumping_walk,
    random_mdp,
    random_walk,
    recycling_robot,
    tic_tac_toe,
    zero_loop,
)
from rlcore.mdp import deterministic_policy, uniform_policy
from rlcore.studies.ch02 import board_states, cost_of_a_sweep
from rlcore.studies.ch03 import spread_updates


def test_tic_tac_toe_has_5478_positions_and_is_a_draw():
    values = game_values()
    assert len(values) == 5478 and values[0, 0] == 0
    assert set(values.values()) == {-1, 0, 1}


def test_tic_tac_toe_positions_by_hand():
    values = game_values()
    assert values[0b011, 0b110000] == 1  # x has two in the top row and is to move
    assert values[0b000000001, 0b000000100] == 1  # corner answered by a corner of the same side: x wins
    assert values[0b000000001, 0b000010000] == 0  # corner answered by the centre


@pytest.mark.long
@pytest.mark.parametrize(
    "board, n, value", [((2, 3, 3), 265, 0), ((3, 4, 3), 111973, 1), ((1, 3, 3), 1 + 3 + 6 + 3, 0)]
)
def test_other_boards(board, n, value):
    values = game_values(*board)
    assert (len(values), values[0, 0]) == (n, value)


def test_bellman_and_backward_induction_agree_on_tic_tac_toe():
    mdp = tic_tac_toe("perfect")
    V = value_iteration(mdp, 1.0).V
    values = game_values()
    positions = sorted(p for p in values if _x_to_move(p))
    assert mdp.n_states == len(positions) + 1 == 2424
    np.testing.assert_allclose(V[:-1], [values[p] for p in positions], atol=1e-12)


def _x_to_move(p):
    lines = (0b111, 0b111000, 0b111000000, 0b1001001, 0b10010010, 0b100100100, 0b100010001, 0b1010100)
    full = any(p[i] & line == line for i in (0, 1) for line in lines)
    return not full and (p[0] | p[1]).bit_count() in (0, 2, 4, 6, 8)


def test_random_opponent_loses_191_games_of_192():
    mdp = tic_tac_toe("random")
    assert abs(mdp.start @ value_iteration(mdp, 1.0).V - 191 / 192) < 1e-12


def test_unknown_opponent():
    with pytest.raises(ValueError, match="^opponent: got 'weak'"):
        tic_tac_toe("weak")


def test_board_states_counts_every_board_where_nobody_can_win():
    assert board_states(2, 2) == len(game_values(2, 2, 3)) == 35
    assert board_states(1, 2) == 5  # empty, two with one mark, two with both
    assert board_states(3, 3) == 6046


def test_a_sweep_of_backgammon_takes_3169_years_and_800_exabytes():
    years, n_bytes = cost_of_a_sweep(1e20)
    assert round(years) == 3169 and n_bytes == 800e18
    assert cost_of_a_sweep(1e20, 1e12)[0] == pytest.approx(years / 1000)
    for bad in (dict(n_states=0), dict(n_states=1, per_second=0), dict(n_states=1, n_bytes=-8)):
        with pytest.raises(ValueError, match=rf"^{list(bad)[-1]}: got"):
            cost_of_a_sweep(**bad)


def test_metered_counts_one_query_a_pair():
    robot = recycling_robot()
    metered = Metered(robot)
    np.testing.assert_array_equal(optimality_backup(metered, 1.0, 0.9), optimality_backup(robot, 1.0, 0.9))
    assert metered.queries == 5  # (high, 2 actions) and (low, 3 actions)
    assert heuristic_search(metered, 0, 1, 0.9)[0] == heuristic_search(robot, 0, 1, 0.9)[0]
    assert metered.queries == 5 + 2
    metered = Metered(robot)
    heuristic_search(metered, 0, 3, 0.9)
    assert metered.queries == 2 + 5 + 5  # each state once a depth
    metered = Metered(random_walk(5))
    q_from_v(metered, 0.0, 1.0)
    assert metered.queries == 5  # terminal states are not read


def test_zero_loop_has_many_solutions_at_gamma_1_and_one_below():
    loop = zero_loop(reward=1.0)
    stay = deterministic_policy(loop, np.array([0, 0]))
    for c in (-3.0, 0.0, 7.0):
        assert expectation_backup(loop, stay, [c, 0], 1.0)[0] == c
        assert expectation_backup(loop, stay, [c, 0], 0.9)[0] == 0.9 * c
        assert optimality_backup(loop, [c, 0], 1.0)[0] == max(c, 1.0)
    with pytest.raises(ValueError, match="terminat"):
        solve_policy(loop, stay, 1.0)


def test_jumping_walk():
    walk = jumping_walk(10, 3)
    np.testing.assert_allclose(walk.prob[5, 0], 1 / 6)
    assert sorted(walk.next_state[5, 0]) == [2, 3, 4, 6, 7, 8]
    assert walk.p(0, -1.0, 2, 0) == pytest.approx(2 / 6)  # jumps of 2 and 3 to the left
    assert walk.p(11, 1.0, 10, 0) == pytest.approx(3 / 6)
    v = solve_policy(walk, np.ones((12, 1)), 1.0)
    np.testing.assert_allclose(v, -v[::-1], atol=1e-12)
    one = jumping_walk(9, 1)
    np.testing.assert_allclose(solve_policy(one, np.ones((11, 1)), 1.0)[1:-1], np.arange(-4, 5) / 5, atol=1e-12)


def test_branching_mdp_stops_with_its_probability():
    mdp = branching_mdp(20, 3, stop=0.1, rng=np.random.default_rng(0))
    assert mdp.n_states == 21 and mdp.terminal.sum() == 1
    np.testing.assert_allclose(mdp.transition_probs()[:20, :, 20], 0.1)
    assert (mdp.reward[mdp.next_state == 20] == 0).all() and abs(mdp.reward[:20]).max() > 1


@pytest.mark.long
@pytest.mark.parametrize("where", ["trajectory", "uniform"])
def test_spread_updates_reaches_q_star(where):
    mdp = random_mdp(4, 2, rng=np.random.default_rng(1))
    found = spread_updates(mdp, 0.8, 4000, where=where, epsilon=0.5, record=1000, rng=np.random.default_rng(2))
    np.testing.assert_allclose(found.Q, q_from_v(mdp, value_iteration(mdp, 0.8, tol=1e-12).V, 0.8), atol=1e-8)
    assert found.visits.sum() == 4000 and found.history.shape == (5, 4, 2)
    np.testing.assert_array_equal(found.history[-1], found.Q)


def test_uniform_updates_treat_pairs_alike_and_trajectories_do_not():
    maze = dyna_maze()
    counts = {}
    for where in ("trajectory", "uniform"):
        found = spread_updates(maze, 0.95, 20_000, where=where, record=20_000, rng=np.random.default_rng(0))
        assert (found.visits[maze.terminal] == 0).all()
        counts[where] = found.visits[~maze.terminal & (maze.legal.any(axis=1))].ravel()
    mean = counts["uniform"][counts["uniform"] > 0].mean()
    assert counts["uniform"].max() < mean + 6 * mean**0.5  # Poisson-like
    assert counts["trajectory"].max() > 3 * mean


def test_bad_spread_updates():
    mdp = recycling_robot()
    for change, name in ((dict(where="dream"), "where"), (dict(epsilon=2), "epsilon"), (dict(record=0), "record")):
        with pytest.raises(ValueError, match=rf"^{name}: got"):
            arguments = dict(where="uniform", rng=np.random.default_rng(0)) | change
            spread_updates(mdp, 0.9, 10, **arguments)


def test_first_update_is_the_expected_reward():
    robot = recycling_robot()
    found = spread_updates(robot, 0.9, 1, where="trajectory", epsilon=0.0, rng=np.random.default_rng(0))
    s, a = np.argwhere(found.visits)[0]
    assert s == 0 and found.Q[s, a] == robot.expected_reward()[s, a]
    assert uniform_policy(robot)[s, a] > 0
