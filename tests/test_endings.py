"""Without discounting: policies that reach the end, loops that leave values undetermined, bounds."""

import gymnasium as gym
import numpy as np
import pytest
from worlds import gambler, stay_or_go

from rlcore.bellman import error_bound, is_proper, q_from_v, solve_policy
from rlcore.core.endings import bound_above, grow, loops, prefer_ends, settled
from rlcore.dp import policy_iteration, value_iteration
from rlcore.envs.small import zero_loop
from rlcore.judging import evaluate
from rlcore.mdp import FiniteMDP, deterministic_policy
from rlcore.solver import solve

METHODS = [value_iteration, policy_iteration, solve]
each = pytest.mark.parametrize("method", METHODS)


def lake(name, slippery):
    return FiniteMDP.from_env(gym.make("FrozenLake-v1", map_name=name, is_slippery=slippery))


@each
@pytest.mark.parametrize("name", ["4x4", "8x8"])
def test_the_lake_without_slip_is_crossed(method, name):
    mdp = lake(name, False)
    found = method(mdp, 1.0)
    met = found.V > 0
    assert found.V[0] == pytest.approx(1.0) and is_proper(mdp, found.pi)
    np.testing.assert_allclose(solve_policy(mdp, found.pi, 1.0)[met], 1.0)
    assert evaluate(found, mdp, 5, rng=np.random.default_rng(0)).returns.tolist() == [1.0] * 5


@each
def test_a_loop_that_costs_nothing_leaves_values_open(method):
    for mdp in (stay_or_go(), zero_loop(reward=-1.0)):
        with pytest.raises(
            ValueError, match="^gamma: got 1, but from state 0 a loop that costs nothing .* must be below"
        ):
            method(mdp, 1.0)


@each
def test_a_loop_that_is_not_worth_staying_in_does_not(method):
    found = method(zero_loop(reward=2.0), 1.0)
    mdp = zero_loop(reward=2.0)
    assert found.V[0] == 2.0 and is_proper(mdp, found.pi) and solve_policy(mdp, found.pi, 1.0)[0] == 2.0


@each
def test_a_loop_that_gains_is_refused(method):
    gain = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)], (0, 1): [(1.0, 1, 0.0)]})
    with pytest.raises(ValueError, match="^gamma: got 1, but values still grow"):
        method(gain, 1.0)


@each
def test_a_loop_that_pays_and_takes_as_much_is_no_better(method):
    """+1 and -1 in turn, and an exit for -5: to stay is worth more than any end."""
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 1.0)], (1, 0): [(1.0, 0, -1.0)], (1, 1): [(1.0, 2, -5.0)]})
    with pytest.raises(ValueError, match="^gamma: got 1, but .* must be below 1"):
        method(mdp, 1.0)


def test_where_one_can_stay_for_ever():
    mdp = FiniteMDP.from_outcomes(
        {(0, 0): [(0.5, 1, 0.0), (0.5, 2, 0.0)], (1, 0): [(1.0, 0, 0.0)], (2, 0): [(1.0, 0, 0.0)],
         (2, 1): [(0.9, 1, 0.0), (0.1, 4, 0.0)], (3, 0): [(1.0, 0, 0.0)], (3, 1): [(1.0, 4, 0.0)]}
    )  # fmt: skip
    assert loops(mdp, mdp.legal).tolist() == [True, True, True, False, False]
    only = mdp.legal & np.array([True, True, False, True, True])[:, None]
    only[2, 1] = True
    assert not loops(mdp, only).any()


@pytest.mark.parametrize("p", [0.25, 0.55])
def test_values_without_a_cost_are_certified_where_all_policies_end(p):
    """The gambler's policies all end; V with an error of 1e-3 here and there is bounded by more than that."""
    mdp = gambler(p)
    for method in METHODS:
        found = method(mdp, 1.0)
        assert 0 < found.bound < 1e-3
    exact = policy_iteration(mdp, 1.0).V
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-6, 1e-9):
        V = np.where(mdp.terminal, 0.0, exact + rng.uniform(-size, size, exact.size))
        assert np.abs(V - exact).max() <= error_bound(mdp, V, 1.0)
    assert error_bound(mdp, exact, 1.0) < 1e-9


def test_no_bound_where_a_loop_costs_nothing():
    mdp = lake("4x4", False)
    found = value_iteration(mdp, 1.0)
    assert found.bound == np.inf and found.converged
    assert np.abs(q_from_v(mdp, found.V, 1.0).max(axis=1) - found.V).max() == 0


def detour(cost, direct=-1.0):
    """From 0 straight to the end, or for `cost` by 1 and 2, which cost nothing more; 4 leads to 1."""
    return FiniteMDP.from_outcomes(
        {(0, 0): [(1.0, 3, direct)], (0, 1): [(1.0, 1, -cost)], (1, 0): [(1.0, 2, 0.0)], (2, 0): [(1.0, 3, 0.0)],
         (4, 0): [(1.0, 1, 0.0)]}
    )  # fmt: skip


def bound(mdp, V, pi, rounding):
    return bound_above(mdp, np.array(V), q_from_v(mdp, V, 1.0), deterministic_policy(mdp, pi), rounding)


def test_the_bound_above_by_hand():
    """A step gains 1/2 over V, rounding 1/4: V + 2 (1/2 + 1/4) (1, 2, 1, 0, 3) is enough from a detour of 3.25 on."""
    V, pi = [-1.5, 0.0, 0.0, 0.0, 0.0], [0, 0, 0, 0, 0]
    assert bound(detour(3.25), V, pi, 0.25) == 4.5
    assert bound(detour(3.1875), V, pi, 0.25) == np.inf


def test_the_bound_above_takes_the_longest_way_that_is_nearly_best():
    """More steps in place of one: that counts where it is worse by 2.5e-6, not by 3.5e-6, with 1 + |V| = 3."""
    for worse, expected in ((0.0, 6.0), (2.5e-6, 6.0), (3.5e-6, np.inf)):
        mdp = detour(2.0 + worse, direct=-2.0)
        assert bound(mdp, [-2.0, 0.0, 0.0, 0.0, 0.0], [0, 0, 0, 0, 0], 1.0) == expected


def padded():
    """Action 0 stays, with an outcome of probability 0 that ends; action 1 ends half of the time; nothing costs."""
    next_state, prob = (
        np.array([[[0, 1], [0, 1]], [[1, 1], [1, 1]]]),
        np.array([[[1, 0], [0.5, 0.5]], [[1, 0], [1, 0]]]),
    )
    legal, end = np.ones((2, 2), bool), np.array([False, True])
    return FiniteMDP(next_state, prob.astype(float), np.zeros((2, 2, 2)), legal, end, np.array([1.0, 0.0]))


def test_what_never_happens_leads_nowhere():
    mdp, pi = padded(), np.array([[1.0, 0.0], [1.0, 0.0]])
    assert loops(mdp, mdp.legal).tolist() == [True, False]
    assert prefer_ends(mdp, pi, mdp.legal).tolist() == [[0.0, 1.0], [1.0, 0.0]]
    assert pi.tolist() == [[1.0, 0.0], [1.0, 0.0]]  # a copy
    np.testing.assert_array_equal(settled(mdp, np.zeros(2), pi, mdp.legal, 1e-9)[0], [0.0, 1.0])


@pytest.mark.parametrize("method", METHODS)
def test_the_first_state_in_doubt_is_named(method):
    """1 and 2 go in a circle for nothing and pay to leave; 0 and 3 end."""
    mdp = FiniteMDP.from_outcomes(
        {(0, 0): [(1.0, 4, -1.0)], (1, 0): [(1.0, 2, 0.0)], (1, 1): [(1.0, 4, -1.0)], (2, 0): [(1.0, 1, 0.0)],
         (2, 1): [(1.0, 4, -1.0)], (3, 0): [(1.0, 4, 0.0)]}
    )  # fmt: skip
    with pytest.raises(ValueError, match="^gamma: got 1, but .*from state 1"):
        method(mdp, 1.0)


def test_the_first_state_that_gains_is_named():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 3, 1.0)], (1, 0): [(1.0, 2, 1.0)], (2, 0): [(1.0, 1, 1.0)]})
    with pytest.raises(ValueError, match="^gamma: got 1, but values still grow in a loop from state 1,"):
        grow(mdp, mdp.legal / mdp.legal.sum(axis=1, keepdims=True))
