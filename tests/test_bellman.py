"""Bellman equations (12) to (17): backups, fixed points, enumeration, exact solution."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from worlds import agrees, awkward, chain, gridworld5x5, loop, published, stay_or_go

from rlcore.bellman import (
    deterministic_policies,
    expectation_backup,
    expectation_backup_q,
    expected_visits,
    greedy,
    greedy_actions,
    heuristic_search,
    is_proper,
    newton_optimality,
    optimality_backup,
    optimality_backup_q,
    policy_matrix,
    q_from_v,
    solve_policy,
    v_from_q,
)
from rlcore.dp import value_iteration
from rlcore.envs import gridworld, random_mdp, random_walk, recycling_robot
from rlcore.mdp import FiniteMDP, uniform_policy

ROBOT_V = [18.348623853, 16.513761468]  # 2000 / 109 and 1800 / 109
PROCESSES = {
    "robot": recycling_robot(),
    "awkward": awkward(),
    "walk": random_walk(7),
    "grid": gridworld(3, 4, slip=0.2),
    "dense": random_mdp(6, 3, rng=np.random.default_rng(2)),
}


@pytest.fixture(params=PROCESSES)
def mdp(request):
    return PROCESSES[request.param]


def random_policy(mdp, seed=0):
    pi = np.random.default_rng(seed).random(mdp.legal.shape) * mdp.legal
    return pi / pi.sum(axis=1, keepdims=True)


# ---------------------------------------------------------------------- expectation, (12)


def test_backups_are_the_sums(mdp):
    """Each backup against the four-argument sums, spelled out pair by pair."""
    rng, gamma, pi = np.random.default_rng(1), 0.8, random_policy(mdp)
    V = np.where(mdp.terminal, 0.0, rng.normal(size=mdp.n_states))
    Q_in = np.where(mdp.terminal[:, None], 0.0, rng.normal(size=mdp.legal.shape))
    Q, Q_pi, Q_max = np.full((3, *mdp.legal.shape), -np.inf)
    for s, a in np.argwhere(mdp.legal):
        Q[s, a] = Q_pi[s, a] = Q_max[s, a] = 0.0
        for p, s_next, r in zip(mdp.prob[s, a], mdp.next_state[s, a], mdp.reward[s, a]):
            legal = np.flatnonzero(mdp.legal[s_next])
            Q[s, a] += p * (r + gamma * V[s_next])
            Q_pi[s, a] += p * (r + gamma * sum(pi[s_next, b] * Q_in[s_next, b] for b in legal))
            Q_max[s, a] += p * (r + gamma * max(Q_in[s_next, b] for b in legal))
    assert_allclose(q_from_v(mdp, V, gamma), Q, atol=1e-14)
    assert_allclose(expectation_backup_q(mdp, pi, Q_in, gamma), Q_pi, atol=1e-14)
    assert_allclose(optimality_backup_q(mdp, Q_in, gamma), Q_max, atol=1e-14)
    assert_allclose(expectation_backup(mdp, pi, V, gamma), (pi * np.where(pi > 0, Q, 0)).sum(axis=1), atol=1e-14)
    assert_allclose(optimality_backup(mdp, V, gamma), Q.max(axis=1), atol=1e-14)


def test_value_of_terminal_states_counts_as_zero():
    m = chain([1.0, 2.0])
    assert_array_equal(q_from_v(m, [5.0, 7.0, 100.0], 0.5), [[1 + 3.5], [2.0], [0.0]])
    assert_array_equal(q_from_v(m, 4.0, 0.5), [[3.0], [2.0], [0.0]])
    assert_array_equal(q_from_v(m, 4.0, 0.0), [[1.0], [2.0], [0.0]])


def test_illegal_actions_are_minus_infinity_and_weigh_nothing():
    robot = recycling_robot()
    Q = q_from_v(robot, 0.0, 0.9)
    assert_array_equal(np.isneginf(Q), ~robot.legal)
    assert_allclose(v_from_q(Q, [[0.5, 0.5, 0.0], [0.0, 0.25, 0.75]]), [1.5, 0.25])
    Q[0, 2] = 1e9  # what stands there is not looked at
    assert_allclose(optimality_backup_q(robot, Q, 0.9)[0, 0], 2 + 0.9 * (0.9 * 2 + 0.1 * 1))
    assert_allclose(expectation_backup_q(robot, uniform_policy(robot), Q, 0.9)[0, 1], 1 + 0.9 * 1.5)


def test_values_of_the_4x4_gridworld():
    grid = gridworld()
    v = solve_policy(grid, uniform_policy(grid), 1.0)
    agrees(v, "gridworld4x4.v_pi")  # figure 4.1
    assert_allclose(v.reshape(4, 4)[1, 1], -18.0)
    assert_allclose(q_from_v(grid, v, 1.0)[[11, 7], 1], [-1.0, -15.0])  # exercise 4.1


def test_values_of_the_5x5_gridworld():
    grid = gridworld5x5()
    agrees(solve_policy(grid, uniform_policy(grid), 0.9), "gridworld5x5.v_pi")  # figure 3.2
    best = greedy_actions(value_iteration(grid, 0.9, tol=1e-12).Q)
    # figure 3.5; our actions are up, down, right, left = N, S, E, W
    assert_array_equal(best, published("gridworld5x5.optimal_actions")[0].astype(bool))


def test_values_of_random_walks():
    for n, expected in [(5, np.arange(1, 6) / 6), (19, np.arange(-9, 10) / 10)]:
        v = solve_policy(random_walk(n), np.ones((n + 2, 1)), 1.0)
        assert_allclose(v, [0.0, *expected, 0.0], atol=1e-12)
    agreed = solve_policy(random_walk(3, rewards=(-2.0, 6.0)), np.ones((5, 1)), 1.0)
    assert_allclose(agreed[1:4], [0.0, 2.0, 4.0], atol=1e-14)


@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.99])
def test_values_in_closed_form(gamma):
    assert_allclose(solve_policy(loop(3.0, n_states=4), np.ones((4, 1)), gamma), 3.0 / (1 - gamma))
    assert_allclose(solve_policy(chain([1.0, 2.0, 3.0]), np.ones((4, 1)), gamma)[0], 1 + 2 * gamma + 3 * gamma**2)


@pytest.mark.parametrize("gamma", [0.0, 0.3, 0.9, 0.999])
def test_value_of_a_policy_is_the_fixed_point(mdp, gamma):
    pi = random_policy(mdp)
    v = solve_policy(mdp, pi, gamma)
    q = q_from_v(mdp, v, gamma)
    assert (1 - gamma) * np.abs(expectation_backup(mdp, pi, v, gamma) - v).max() < 1e-12
    legal = mdp.legal
    assert (1 - gamma) * np.abs(expectation_backup_q(mdp, pi, q, gamma)[legal] - q[legal]).max() < 1e-12
    assert_allclose(v_from_q(q, pi), v, atol=1e-10 / (1 - gamma))
    assert not v[mdp.terminal].any()


@pytest.mark.parametrize("gamma", [0.0, 0.3, 0.9])
def test_rewards_weighted_with_visits_are_the_value_of_the_start(mdp, gamma):
    pi = random_policy(mdp)
    visits, (P, r) = expected_visits(mdp, pi, gamma), policy_matrix(mdp, pi)
    assert visits @ r == pytest.approx(mdp.start @ solve_policy(mdp, pi, gamma), rel=1e-12, abs=1e-12)
    go = ~mdp.terminal
    assert_allclose(visits[go], (mdp.start + gamma * P.T @ visits)[go], atol=1e-12)
    assert not visits[mdp.terminal].any()
    if go.all():
        assert visits.sum() == pytest.approx(1 / (1 - gamma))


def test_visits_without_discount_are_those_of_the_fair_walk():
    # from the middle of 7 places: 2 (distance to the nearer end) (4) / 8 visits, of 16 steps in all
    visits = expected_visits(random_walk(7), uniform_policy(random_walk(7)), 1.0)
    assert_allclose(visits, [0, 1, 2, 3, 4, 3, 2, 1, 0], atol=1e-12)
    with pytest.raises(ValueError, match="pi: never terminates from state 0"):
        expected_visits(loop(), [[1.0]], 1.0)
    with pytest.raises(ValueError, match="gamma: got 1.1"):
        expected_visits(loop(), [[1.0]], 1.1)


def test_markov_reward_process_of_a_policy(mdp):
    pi = random_policy(mdp)
    P, r = policy_matrix(mdp, pi)
    assert_allclose(P.toarray(), np.einsum("sa,sat->st", pi, mdp.transition_probs()), atol=1e-15)
    assert_allclose(r, (pi * mdp.expected_reward()).sum(axis=1), atol=1e-15)
    assert_allclose(P.sum(axis=1), 1.0)


def test_sparse_and_dense_solution():
    rng = np.random.default_rng(0)
    m = random_mdp(2500, 2, n_next=4, rng=rng)  # large and sparse enough for the sparse solver
    pi = uniform_policy(m)
    v = solve_policy(m, pi, 0.9)
    P, r = policy_matrix(m, pi)
    assert_allclose(v, r + 0.9 * (P @ v), atol=1e-12)


# ---------------------------------------------------------------------- improper policies


def test_proper_means_that_the_end_is_certain():
    m = stay_or_go()
    stay, go, either = ([[1.0 - p, p], [1.0, 0.0]] for p in (0.0, 1.0, 0.01))
    assert [is_proper(m, pi) for pi in (stay, go, either)] == [False, True, True] and is_proper(m, go) is True
    assert_allclose(solve_policy(m, either, 1.0), [-1.0, 0.0])
    assert_allclose(solve_policy(m, stay, 0.9), 0.0)
    with pytest.raises(ValueError, match="pi: never terminates from state 0"):
        solve_policy(m, stay, 1.0)
    assert not is_proper(loop(), [[1.0]])
    with pytest.raises(ValueError, match="pi: never terminates from state 0,"):
        solve_policy(loop(n_states=3), np.ones((3, 1)), 1.0)  # none ends: the first is named
    trap = FiniteMDP.from_outcomes({(0, 0): [(0.5, 2, 0.0), (0.5, 1, 0.0)], (1, 0): [(1.0, 1, 1.0)]})
    assert not is_proper(trap, np.ones((3, 1)))  # reaching the end sometimes is not enough
    with pytest.raises(ValueError, match="pi: never terminates from state 1"):
        solve_policy(trap, np.ones((3, 1)), 1.0)


# ---------------------------------------------------------------------- optimality, (13) to (17)


def test_optimal_values_of_the_recycling_robot_by_enumeration():
    robot = recycling_robot()
    policies = list(deterministic_policies(robot))
    v = np.array([solve_policy(robot, pi, 0.9) for pi in policies])
    assert len(policies) == 6 and len({pi.tobytes() for pi in policies}) == 6
    v_star = v.max(axis=0)  # eq-13
    assert_allclose(v_star, ROBOT_V)
    assert (v == v_star).all(axis=1).any()  # one policy is best in every state
    q = np.max([q_from_v(robot, x, 0.9) for x in v], axis=0)  # eq-14
    assert_allclose(q[0, :2], [18.3486, 17.5138], atol=5e-5)
    assert_allclose(q[1], [15.5229, 15.8624, 16.5138], atol=5e-5)
    assert_allclose(q_from_v(robot, v_star, 0.9), q)  # eq-15
    assert_allclose(q.max(axis=1), v_star)


def test_enumeration_takes_one_action_at_terminal_states():
    m = stay_or_go()
    assert [pi.argmax(axis=1).tolist() for pi in deterministic_policies(m)] == [[0, 0], [1, 0]]


@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.95])
def test_optimal_values_solve_the_optimality_equations(mdp, gamma):
    v = newton_optimality(mdp, gamma, 20)[-1]
    q = q_from_v(mdp, v, gamma)
    assert (1 - gamma) * np.abs(optimality_backup(mdp, v, gamma) - v).max() < 1e-12
    legal = mdp.legal
    assert (1 - gamma) * np.abs(optimality_backup_q(mdp, q, gamma)[legal] - q[legal]).max() < 1e-12
    if np.prod(np.where(mdp.terminal, 1, mdp.legal.sum(axis=1))) < 1000:
        best = np.max([solve_policy(mdp, pi, gamma) for pi in deterministic_policies(mdp)], axis=0)
        assert_allclose(v, best, atol=1e-11)


def test_printed_first_line_of_17_is_the_value_of_a_policy():
    """Erratum of (17): with G_{t+1} and no maximum the right-hand side is q of whatever policy follows."""
    robot = recycling_robot()
    pi = uniform_policy(robot)
    q_pi = q_from_v(robot, solve_policy(robot, pi, 0.9), 0.9)
    assert_allclose(expectation_backup_q(robot, pi, q_pi, 0.9)[robot.legal], q_pi[robot.legal])
    assert q_pi[0, 0] < 15 < ROBOT_V[0]


def test_newton_is_policy_iteration():
    robot = recycling_robot()
    history = newton_optimality(robot, 0.9, 3)
    assert history.shape == (4, 2)
    assert_array_equal(history[0], 0.0)
    myopic = greedy(robot.expected_reward() + np.where(robot.legal, 0.0, -np.inf))
    assert_allclose(history[1], solve_policy(robot, myopic, 0.9))
    assert_allclose(history[-1], ROBOT_V)
    assert_allclose(newton_optimality(robot, 0.9, 1, V0=ROBOT_V)[1], ROBOT_V)
    assert_allclose(newton_optimality(robot, 0.9, 1, V0=[1.0, 2.0])[0], [1.0, 2.0])
    grid = gridworld()
    with pytest.raises(ValueError, match="pi: never terminates"):
        newton_optimality(grid, 1.0, 1)  # greedy for 0 walks into the first wall for ever


# ---------------------------------------------------------------------- greedy


def test_greedy_takes_the_first_maximum_and_greedy_actions_all():
    Q = [[1.0, 3.0, 3.0], [-np.inf, -2.0, -2.0 - 1e-12], [0.0, 0.0, 1e-6]]
    assert_array_equal(greedy(Q), [[0, 1, 0], [0, 1, 0], [0, 0, 1]])
    assert_array_equal(greedy_actions(Q), [[False, True, True], [False, True, True], [False, False, True]])
    assert_array_equal(greedy_actions(Q, tol=0)[1], [False, True, False])
    assert greedy_actions(Q, tol=1e-5).all(axis=1).tolist() == [False, False, True]
    large = np.array([[1e6, 1e6 - 1e-4]])
    assert greedy_actions(large).all() and greedy_actions(-large).all()  # the margin is relative to the maximum
    assert not greedy_actions([[0.0, -1.5e-9]]).all() and not greedy_actions([[1.0, 1 - 2.5e-9]]).all()
    assert greedy_actions([[0.0, -1e-10]]).all() and not greedy_actions([[0.0, -1e-8]]).all()


def test_every_mixture_of_maximising_actions_is_optimal():
    grid = gridworld()
    best = greedy_actions(value_iteration(grid, 1.0).Q)
    assert best.sum(axis=1).tolist() == [4, 1, 1, 2, 1, 2, 4, 1, 1, 4, 2, 1, 2, 1, 1, 4]
    steps = -np.array([0, 1, 2, 3, 1, 2, 3, 2, 2, 3, 2, 1, 3, 2, 1, 0])
    for seed in range(3):
        pi = best * np.random.default_rng(seed).random(best.shape)
        assert_allclose(solve_policy(grid, pi / pi.sum(axis=1, keepdims=True), 1.0), steps)


def test_loss_of_acting_greedily_on_wrong_values_is_bounded(mdp):
    gamma, rng = 0.9, np.random.default_rng(0)
    v = newton_optimality(mdp, gamma, 20)[-1]
    for eps in (0.01, 0.3, 2.0):
        noisy = v + rng.uniform(-eps, eps, size=v.size)
        loss = v - solve_policy(mdp, greedy(q_from_v(mdp, noisy, gamma)), gamma)
        assert -1e-10 < loss.max() <= 2 * gamma * eps / (1 - gamma) + 1e-10


# ---------------------------------------------------------------------- heuristic search


def test_search_one_step_deep_is_the_backup(mdp):
    V = np.random.default_rng(0).normal(size=mdp.n_states)
    Q = q_from_v(mdp, V, 0.7)
    for s in np.flatnonzero(~mdp.terminal):
        assert_allclose(heuristic_search(mdp, s, 1, 0.7, V0=V), Q[s], atol=1e-14)


def test_deeper_search_is_value_iteration_and_its_error_shrinks(mdp):
    gamma, V = 0.8, np.zeros(mdp.n_states)
    v = newton_optimality(mdp, gamma, 20)[-1]
    q = q_from_v(mdp, v, gamma)
    for depth in range(1, 6):
        Q, V = q_from_v(mdp, V, gamma), optimality_backup(mdp, V, gamma)
        for s in range(min(3, mdp.n_states)):
            found = heuristic_search(mdp, s, depth, gamma)
            legal = mdp.legal[s]
            assert_allclose(found[legal], Q[s, legal], atol=1e-12)
            assert np.abs(found[legal] - q[s, legal]).max() <= gamma**depth * np.abs(v).max() + 1e-12
    assert heuristic_search(chain([2.0]), 1, 3, 0.9, V0=5.0).tolist() == [0.0]


def test_search_finds_the_best_action_where_it_looks_far_enough():
    m = FiniteMDP.from_outcomes({(0, 0): [(1, 3, 1.0)], (0, 1): [(1, 1, 0)], (1, 0): [(1, 2, 0)], (2, 0): [(1, 3, 10)]})
    assert [heuristic_search(m, 0, d, 0.9).argmax() for d in (1, 2, 3, 4)] == [0, 0, 1, 1]
    assert heuristic_search(m, 0, 3, 0.9)[1] == pytest.approx(8.1)
