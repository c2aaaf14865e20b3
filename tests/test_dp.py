"""Dynamic programming: published runs, exact values, stopping rules and certified bounds."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from worlds import REFERENCE, agrees, awkward, chain, gambler, jacks_car_rental, loop, published, stay_or_go

from rlcore.bellman import (
    error_bound,
    greedy_actions,
    newton_optimality,
    optimality_backup,
    policy_error_bound,
    q_from_v,
    solve_policy,
    v_from_q,
)
from rlcore.dp import policy_evaluation, policy_improvement, policy_iteration, value_iteration
from rlcore.envs import gridworld, random_mdp, random_walk, recycling_robot
from rlcore.mdp import FiniteMDP, deterministic_policy, uniform_policy
from rlcore.solver import solve

STEPS = -np.array([0.0, 1, 2, 3, 1, 2, 3, 2, 2, 3, 2, 1, 3, 2, 1, 0])  # to the nearest corner of the 4x4 grid
SOLVERS = {
    "policy iteration": lambda mdp, gamma: policy_iteration(mdp, gamma),
    "value iteration": lambda mdp, gamma: value_iteration(mdp, gamma, tol=1e-12),
    "value iteration in place": lambda mdp, gamma: value_iteration(mdp, gamma, tol=1e-12, in_place=True),
    "solve": lambda mdp, gamma: solve(mdp, gamma, tol=1e-9),
}


@pytest.fixture(params=SOLVERS)
def solver(request):
    return SOLVERS[request.param]


def frozen_lake(name="4x4"):
    return FiniteMDP.from_env(gym.make("FrozenLake-v1", map_name=name))


# ---------------------------------------------------------------------- policy evaluation


def test_sweeps_of_figure_4_1():
    """Sutton and Barto (2018), figure 4.1, left column: after 0, 1, 2, 3, 10 sweeps."""
    grid = gridworld()
    found = policy_evaluation(grid, uniform_policy(grid), 1.0, tol=1e-4, record=1)
    for k, expected in REFERENCE["gridworld4x4.sweeps"]["value"].items():
        assert_allclose(found.history[int(k)], expected, atol=1e-9)
    assert_array_equal(found.history[0], 0.0)
    assert_allclose(found.V, published("gridworld4x4.v_pi")[0], atol=found.bound)
    assert found.history.shape == (found.n_iter + 1, 16) and found.converged
    assert_array_equal(found.history[-1], found.V)


def test_number_of_sweeps():
    grid, counts = gridworld(), REFERENCE["gridworld4x4.sweep_counts"]["value"]
    pi = uniform_policy(grid)
    assert policy_evaluation(grid, pi, 1.0, tol=1e-4).n_iter == counts["two_array"]
    assert policy_evaluation(grid, pi, 1.0, tol=1e-4, in_place=True).n_iter == counts["in_place_row_major"]


@pytest.mark.parametrize("in_place", [False, True])
def test_sweeps_are_backups(in_place):
    """Two arrays: the whole old one; in place: states in order, each from the newest values."""
    m, gamma = awkward(), 0.9
    pi = uniform_policy(m)
    options = dict(V0=1.5, in_place=in_place, max_iter=4, record=1)
    found, best = policy_evaluation(m, pi, gamma, **options), value_iteration(m, gamma, **options)
    assert len(found.history) == len(best.history) == 5
    assert_array_equal(found.history[0], np.where(m.terminal, 0.0, 1.5))
    for history, backup in ((found.history, lambda q: v_from_q(q, pi)), (best.history, lambda q: q.max(axis=1))):
        for V, V_next in zip(history, history[1:]):
            expected = V.copy()
            for s in range(m.n_states):
                expected[s] = backup(q_from_v(m, expected if in_place else V, gamma))[s]
            assert_allclose(V_next, expected, atol=1e-13)


def test_in_place_sweep_carries_news_along_the_states():
    m = FiniteMDP.from_outcomes({(s, 0): [(1.0, s - 1, -1.0)] for s in range(1, 6)})  # state 0 is the end
    pi = np.ones((6, 1))
    assert policy_evaluation(m, pi, 1.0, in_place=True).n_iter == 2  # one sweep finds all, one more sees it
    assert policy_evaluation(m, pi, 1.0).n_iter == 6
    assert value_iteration(m, 1.0, in_place=True).n_iter == 2
    assert value_iteration(m, 1.0).n_iter == 6


@pytest.mark.parametrize("method", [policy_evaluation, value_iteration])
def test_stops_when_no_value_changes_by_tol(method):
    """A ring with reward 1: sweep k changes every value by gamma^(k - 1)."""
    args = (loop(), np.ones((1, 1)), 0.5) if method is policy_evaluation else (loop(), 0.5)
    assert method(*args, tol=0.25).n_iter == 4  # changes 1, 1/2, 1/4, 1/8: a change of exactly tol goes on
    assert method(*args, tol=0.26).n_iter == 3
    stopped = method(*args, tol=1e-9, max_iter=3)
    assert stopped.n_iter == 3 and not stopped.converged and stopped.V[0] == 1.75
    exact = method(*args, tol=0.26, max_iter=3)
    assert exact.n_iter == 3 and exact.converged
    assert not method(*args, tol=0.25, max_iter=3).converged  # a change of exactly tol is not below it
    assert method(*args, tol=1.5).n_iter == 1 and method(*args, tol=1.5).converged
    assert method(*args, tol=1e-9, V0=2.0).n_iter == 1  # starts at the solution
    assert method(*args, V0=[2.0]).V[0] == 2.0
    assert 1e-9 < 2 - method(*args).V[0] < 1e-8  # default tol
    low = method(*args, tol=0.3, V0=10.0)  # changes downwards count too: 4, 2, 1, 1/2, 1/4
    assert low.n_iter == 5 and low.V[0] == 2.25


def test_evaluation_ignores_actions_of_probability_zero():
    m = stay_or_go()
    assert_array_equal(policy_evaluation(m, [[0.0, 1.0], [1.0, 0.0]], 1.0).V, [-1.0, 0.0])
    with pytest.raises(ValueError, match="pi: never terminates from state 0"):
        policy_evaluation(m, [[1.0, 0.0], [1.0, 0.0]], 1.0)
    found = policy_evaluation(m, [[1.0, 0.0], [1.0, 0.0]], 0.9)
    assert_array_equal(found.V, 0.0)
    assert_array_equal(found.Q, [[0.0, -1.0], [0.0, 0.0]])


# ---------------------------------------------------------------------- policy improvement and iteration


def test_improvement_of_the_uniform_policy_is_optimal_on_the_4x4_grid():
    grid = gridworld()
    v = solve_policy(grid, uniform_policy(grid), 1.0)
    assert_allclose(solve_policy(grid, policy_improvement(grid, v, 1.0), 1.0), STEPS)


def test_improvement_keeps_a_row_that_is_greedy():
    grid = gridworld()
    pi = np.zeros((16, 4))
    pi[:, 3] = 1.0  # left, which is one of several best actions in half of the states
    new = policy_improvement(grid, STEPS, 1.0, pi=pi)
    best = greedy_actions(q_from_v(grid, STEPS, 1.0))
    for s in range(16):
        assert_array_equal(new[s], pi[s] if best[s, 3] else np.eye(4)[best[s].argmax()])
    mixed = best / best.sum(axis=1, keepdims=True)
    assert_array_equal(policy_improvement(grid, STEPS, 1.0, pi=mixed), mixed)
    half = np.full((16, 4), 0.25)  # some of its actions are not greedy: the row is replaced
    kept = np.flatnonzero(best.all(axis=1))
    changed = np.flatnonzero((policy_improvement(grid, STEPS, 1.0, pi=half) != half).any(axis=1))
    assert_array_equal(np.setdiff1d(np.arange(16), changed), kept)
    assert policy_improvement(grid, STEPS, 1.0)[5].tolist() == [1.0, 0.0, 0.0, 0.0]


def test_improvement_margin_is_relative_and_small():
    def twin(gap, level):
        """One state, two actions that end with rewards level and level - gap."""
        return FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, level)], (0, 1): [(1.0, 1, level - gap)]})

    second = np.array([[0.0, 1.0], [1.0, 0.0]])
    for gap, level, keeps in [
        (1e-11, 0.0, True),
        (1e-10, 0.0, True),
        (1.5e-10, 0.0, False),
        (1e-5, 1e6, True),
        (1e-5, -1e6, True),
    ]:
        assert policy_improvement(twin(gap, level), 0.0, 1.0, pi=second)[0, 1] == keeps
    assert policy_improvement(twin(1e-3, 1e6), 0.0, 1.0, pi=second)[0, 1] == 0


@pytest.mark.parametrize("action", range(4))
def test_policy_iteration_takes_four_iterations_on_the_4x4_grid(action):
    grid = gridworld()
    found = policy_iteration(grid, 0.9, pi0=deterministic_policy(grid, np.full(16, action)), record=1)
    assert found.n_iter == 4 and found.converged
    assert (np.diff(found.history[1:], axis=0) >= -1e-12).all()  # v_pi never falls
    assert_allclose(found.history[-1], -(1 - 0.9**-STEPS) / 0.1)
    assert_array_equal(found.history[0], 0.0)


def test_policy_iteration_stops_where_it_is_told():
    grid = gridworld()
    left = deterministic_policy(grid, np.full(16, 3))
    found = policy_iteration(grid, 0.9, pi0=left, max_iter=3, record=1)
    assert found.n_iter == 3 and not found.converged and found.history.shape == (4, 16)
    assert policy_iteration(grid, 0.9, pi0=left, max_iter=4).converged
    first = policy_iteration(grid, 0.9, pi0=left, max_iter=1)
    assert_allclose(first.V, solve_policy(grid, left, 0.9))
    assert_array_equal(first.pi, policy_improvement(grid, first.V, 0.9, pi=left))
    assert_allclose(first.Q, q_from_v(grid, first.V, 0.9))
    assert first.bound >= np.abs(first.V - policy_iteration(grid, 0.9).V).max()


@pytest.mark.parametrize("in_place", [False, True])
def test_record_thins_the_history_and_changes_nothing(in_place):
    m = random_mdp(12, 3, rng=np.random.default_rng(5))
    pi, fields = uniform_policy(m), ("V", "Q", "pi", "n_iter", "converged", "bound")
    for method in (
        partial(policy_evaluation, m, pi, 0.9, in_place=in_place, V0=1.0),
        partial(value_iteration, m, 0.9, in_place=in_place, V0=1.0),
        partial(policy_iteration, m, 0.9),
    ):
        full, thin, none, plain = method(record=1), method(record=3), method(record=0), method()
        assert_array_equal(full.history[::3], thin.history)
        assert len(full.history) == full.n_iter + 1 and none.history is None and plain.history is None
        assert_array_equal(full.history[-1], full.V)
        for found in (thin, none, plain):
            assert all(np.array_equal(getattr(found, name), getattr(full, name)) for name in fields)
        for wrong in (-1, 0.5, None, True):
            with pytest.raises(ValueError, match="^record: got .*, must be a whole number of at least 0"):
                method(record=wrong)


def test_policy_iteration_is_newtons_method():
    m = random_mdp(12, 3, rng=np.random.default_rng(5))
    start = policy_improvement(m, 0.0, 0.9)
    found = policy_iteration(m, 0.9, pi0=start, record=1)
    assert_allclose(found.history[1:], newton_optimality(m, 0.9, found.n_iter)[1:], atol=1e-11)


@pytest.mark.parametrize("gamma", [0.5, 0.9, 0.99])
def test_few_policy_iterations_against_many_sweeps(gamma):
    """About 27, 170 and 1800 sweeps: as many as it takes for gamma^k max |V_1 - V_0| < 1e-8."""
    for seed in range(3 if gamma < 0.99 else 1):
        m = random_mdp(20, 4, rng=np.random.default_rng(seed))
        assert 2 <= policy_iteration(m, gamma).n_iter <= 4
        found = value_iteration(m, gamma, record=1)
        sweeps = np.log(1e-8 / np.abs(found.history[1]).max()) / np.log(gamma)
        assert 0.9 * sweeps <= found.n_iter <= sweeps + 2


@pytest.mark.parametrize("gamma", [0.9, 0.99, 1.0])
@pytest.mark.parametrize("name", ["4x4", "8x8"])
def test_policy_iteration_does_not_cycle_on_frozen_lake(name, gamma):
    """Tied actions: always taking the first maximum, a well-known package cycles here."""
    found = policy_iteration(frozen_lake(name), gamma)
    assert found.converged and found.n_iter < 12
    assert_allclose(found.V, value_iteration(frozen_lake(name), gamma, tol=1e-13).V, atol=1e-9)


def test_improper_policies_are_refused_at_gamma_1():
    grid = gridworld()
    with pytest.raises(ValueError, match="pi: never terminates from state 1,"):
        policy_iteration(grid, 1.0, pi0=deterministic_policy(grid, np.zeros(16, int)))
    trap = FiniteMDP.from_outcomes({(0, 0): [(1.0, 2, -1.0)], (1, 0): [(1.0, 1, -1.0)]})  # 0 ends, 1 does not
    with pytest.raises(ValueError, match="gamma: got 1, but no policy terminates from state 1,"):
        value_iteration(trap, 1.0)
    for method in (value_iteration, policy_iteration):
        with pytest.raises(ValueError, match="no policy terminates|never terminates"):
            method(loop(), 1.0)
    assert policy_iteration(loop(), 0.9).V[0] == pytest.approx(10.0)


# ---------------------------------------------------------------------- published problems


def test_jacks_car_rental():
    """Figure 4.2: the policies pi_0 to pi_4 and the values, exact Poisson tails."""
    m = jacks_car_rental()
    pi0 = deterministic_policy(m, np.full(441, 5))
    found = policy_iteration(m, 0.9, pi0=pi0, record=1)
    assert_array_equal(found.pi.argmax(axis=1).reshape(21, 21) - 5, published("jacks.policy")[0])
    corners = REFERENCE["jacks.corner_values"]["value"]
    assert_allclose(found.V[[0, 440, 220]], [corners["v00"], corners["v20_20"], corners["v10_10"]], atol=1e-6)
    assert_allclose([found.V.min(), found.V.max()], [corners["min"], corners["max"]], atol=1e-6)
    pi, changed = pi0, []
    for V in found.history[1:]:
        new = policy_improvement(m, V, 0.9, pi=pi)
        changed.append(int((new != pi).any(axis=1).sum()))
        pi = new
    assert changed == REFERENCE["jacks.improvement_steps"]["value"]["changed_states"]


def test_gamblers_problem():
    """Figure 4.3 with p_h = 0.25: values by exact rationals, every set of optimal stakes."""
    m = gambler(0.25)
    expected, band = published("gambler.v_star[ph=0.25]")
    stakes = [np.array(row) - 1 for row in REFERENCE["gambler.optimal_stakes[ph=0.25]"]["value"]]
    for found in (value_iteration(m, 1.0, tol=1e-14), policy_iteration(m, 1.0)):
        assert_allclose(found.V[:100], expected[:100], atol=band)
        best = greedy_actions(found.Q, tol=1e-12)
        for s in range(1, 100):
            assert_array_equal(np.flatnonzero(best[s]), stakes[s - 1])
        assert np.abs(found.V[:100] - expected[:100]).max() <= found.bound + band and found.bound < 1e-12


def test_gambler_with_a_good_coin_stakes_one():
    """Exercise 4.9, p_h = 0.55: timid play, (1 - (q/p)^s) / (1 - (q/p)^100)."""
    m, ratio = gambler(0.55), 0.45 / 0.55
    found = policy_iteration(m, 1.0)
    assert_allclose(found.V[:100], (1 - ratio ** np.arange(100)) / (1 - ratio**100), atol=1e-9)
    assert (found.pi[1:100].argmax(axis=1) == 0).all()


@pytest.mark.parametrize("name", [name for name in REFERENCE if name.startswith("recycling_robot")])
def test_recycling_robots(name, solver):
    given = REFERENCE[name]["settings"]
    robot = recycling_robot(**{key: given[key] for key in ("alpha", "beta", "r_search", "r_wait")})
    agrees(solver(robot, given["gamma"]).V, name)


def test_optimal_actions_of_the_recycling_robot(solver):
    usual, careful = solver(recycling_robot(), 0.9), solver(recycling_robot(beta=0.9), 0.9)
    assert_allclose(usual.V, [2000 / 109, 1800 / 109])
    assert usual.pi.argmax(axis=1).tolist() == [0, 2]  # search when high, recharge when low
    assert careful.pi.argmax(axis=1).tolist() == [0, 0]
    assert_allclose(careful.Q[1, [0, 2]], [16.6071, 16.5536], atol=5e-5)


@pytest.mark.parametrize("gamma", [0.9, 1.0])
def test_shortest_paths_on_the_4x4_grid(gamma):
    grid = gridworld()
    expected = STEPS if gamma == 1 else -(1 - gamma**-STEPS) / (1 - gamma)
    found = value_iteration(grid, gamma)
    assert found.n_iter == 4  # three sweeps reach every cell, the fourth changes nothing
    assert_allclose(found.V, expected, atol=1e-14)
    assert_allclose(policy_iteration(grid, gamma).V, expected, atol=1e-12)
    assert_array_equal(found.Q, q_from_v(grid, found.V, gamma))
    assert_allclose(solve_policy(grid, found.pi, gamma), expected, atol=1e-12)


def test_gamma_0_is_the_best_reward(solver):
    m = awkward()
    best = np.where(m.legal, m.expected_reward(), -np.inf).max(axis=1)
    assert_allclose(solver(m, 0.0).V, best, atol=1e-14)


# ---------------------------------------------------------------------- contraction and bounds


@pytest.mark.parametrize("gamma", [0.3, 0.9])
def test_value_iteration_contracts_from_any_start(gamma):
    m, rng = recycling_robot(), np.random.default_rng(0)
    v = policy_iteration(m, gamma).V
    for _ in range(100):
        found = value_iteration(m, gamma, V0=rng.normal(scale=50, size=2), record=1)
        error = np.abs(found.history - v).max(axis=1)
        assert (error <= gamma ** np.arange(error.size) * error[0] + 1e-12).all()
        assert_allclose(found.V, v, atol=1e-7)


def test_bound_is_tight_where_the_error_is_known():
    """A ring with reward 1: V after k sweeps is off by gamma^k / (1 - gamma), which is what the bound says."""
    for gamma in (0.5, 0.99):
        for k in (1, 5):
            for found in (
                value_iteration(loop(), gamma, max_iter=k),
                policy_evaluation(loop(), [[1.0]], gamma, max_iter=k),
            ):
                error = 1 / (1 - gamma) - found.V[0]
                assert error <= found.bound <= error * (1 + 1e-9)


def test_bound_at_gamma_1_counts_steps():
    """A chain of 5 steps at cost 1: V = 0 is off by 5; the residual is 1 and the horizon 5."""
    m = chain([-1.0] * 5)
    pi, zero = np.ones((6, 1)), np.zeros(6)
    assert policy_error_bound(m, pi, zero, 1.0) == pytest.approx(5.0, rel=1e-5)
    assert error_bound(m, zero, 1.0) == pytest.approx(5.0, rel=1e-5)
    exact = -np.arange(5, -1, -1.0)
    assert error_bound(m, exact, 1.0) < 1e-13 and policy_error_bound(m, pi, exact, 1.0) < 1e-13
    # too low by 2: the last step has a residual of 2, and nothing can take more than 5 steps
    assert error_bound(m, exact - 2.0, 1.0) == pytest.approx(10.0, rel=1e-5)
    cheap = chain([-0.25] * 5)
    assert error_bound(cheap, exact / 4 - 2.0, 1.0) == pytest.approx(10.0, rel=1e-5)
    assert error_bound(cheap, zero, 1.0) == pytest.approx(1.25, rel=1e-5)


def test_bound_at_gamma_1_includes_rounding():
    """At the solution itself it is the rounding of one backup, twice (of V and of the greedy policy's), for 5 steps."""
    m, exact = chain([-3.0] * 5), -3.0 * np.arange(5, -1, -1)
    one = 5 * np.finfo(float).eps * (3 + 15)  # one outcome and 4 more operations, on numbers up to |r| + |V|
    assert error_bound(m, exact, 1.0) == pytest.approx(2 * 5 * one, rel=1e-3, abs=0)
    assert policy_error_bound(m, np.ones((6, 1)), exact, 1.0) == pytest.approx(5 * one, rel=1e-3, abs=0)
    assert error_bound(m, exact, 0.5) > policy_error_bound(m, np.ones((6, 1)), exact, 0.5) - 1e-14 > 2.0
    twice = FiniteMDP.from_outcomes({(s, a): [(1.0, s + 1, -3.0)] for s in range(5) for a in (0, 1)}, n_states=6)
    assert error_bound(twice, exact, 1.0) == pytest.approx(2 * 5 * one, rel=1e-3, abs=0)  # outcomes count, not actions


def test_bound_is_infinite_where_nothing_is_certain():
    free = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 0.0)], (1, 0): [(1.0, 2, -1.0)]})
    assert error_bound(free, [0.0, 0.0, 0.0], 1.0) == pytest.approx(1.0)  # a step that costs nothing, and no loop
    m = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, -1.0)], (0, 1): [(1.0, 1, -3.0)]})
    assert error_bound(m, [0.0, 0.0], 1.0) == np.inf  # greedy for 0 stays for ever
    assert error_bound(m, [-3.0, 0.0], 1.0) < 1e-12


def test_bound_includes_rounding():
    m = awkward()
    for gamma in (0.9, 0.999999):
        v = policy_iteration(m, gamma)
        assert v.bound >= 4 * np.finfo(float).eps * np.abs(v.V).max() / (1 - gamma)
        assert v.bound < 1e-8 / (1 - gamma)
        assert policy_error_bound(m, v.pi, v.V, gamma) >= 4 * np.finfo(float).eps * np.abs(v.V).max() / (1 - gamma)


def test_terminal_values_given_are_counted_as_zero():
    walk = random_walk(3)
    v = np.array([99.0, 0.25, 0.5, 0.75, -99.0])
    pi = uniform_policy(walk)
    assert policy_error_bound(walk, pi, v, 1.0) < 1e-12 and policy_error_bound(walk, pi, v, 0.9) < 1.0
    assert error_bound(walk, v, 0.9) < 1.0
    assert_allclose(optimality_backup(walk, v, 1.0), [0.0, 0.25, 0.5, 0.75, 0.0])


def test_solution_says_what_it_is():
    found = value_iteration(recycling_robot(), 0.9)
    assert found.pi.shape == found.Q.shape == (2, 3) and found.V.shape == (2,)
    grid = gridworld()
    several = [found, policy_iteration(grid, 1.0), policy_evaluation(grid, uniform_policy(grid), 1.0, tol=1e-3)]
    several += [
        policy_evaluation(grid, uniform_policy(grid), 0.9),
        value_iteration(grid, 1),
        policy_iteration(grid, 0.9),
    ]
    for x in several:
        assert type(x.converged) is bool and type(x.bound) is float and type(x.n_iter) is int
    assert found.Q[0, 2] == -np.inf
    with pytest.raises(AttributeError):
        found.V = 0
