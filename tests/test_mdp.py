"""Finite MDPs, policies, returns and trajectories: equations (1) to (11)."""

import copy
import pickle
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from worlds import awkward, chain, gridworld5x5, loop, stay_or_go

from rlcore.bellman import solve_policy
from rlcore.core.checks import check_count, check_policy, check_probability, finite_values
from rlcore.core.compiled import HAVE_NUMBA
from rlcore.core.sampling import cumulative, draw
from rlcore.envs import gridworld, random_mdp, random_walk, recycling_robot
from rlcore.mdp import (
    FiniteMDP,
    deterministic_policy,
    discounted_return,
    discounted_returns,
    rollout,
    sample_returns,
    uniform_policy,
)

HIGH, LOW, SEARCH, WAIT, RECHARGE = 0, 1, 0, 1, 2


@cache
def shipped():
    rng = np.random.default_rng(1)
    return {
        "recycling robot": recycling_robot(),
        "random walk": random_walk(5),
        "long walk": random_walk(19),
        "grid": gridworld(),
        "slippery grid": gridworld(3, 5, slip=0.3),
        "dense": random_mdp(6, 3, rng=rng),
        "sparse": random_mdp(9, 2, n_next=3, rng=rng),
        "awkward": awkward(),
        "5x5": gridworld5x5(),
    }


@pytest.fixture(params=shipped(), scope="module")
def mdp(request):
    return shipped()[request.param]


# ---------------------------------------------------------------------- dynamics, (1) to (5)


def test_dynamics_of_the_recycling_robot():
    robot = recycling_robot()
    assert robot.p(LOW, 2.0, HIGH, SEARCH) == pytest.approx(0.1)
    assert robot.p(HIGH, 2.0, HIGH, SEARCH) == 0.9
    assert robot.p(HIGH, -3.0, LOW, SEARCH) == pytest.approx(0.4)
    assert robot.p(HIGH, 2.0, LOW, SEARCH) == 0.0  # that state, but not with that reward
    assert robot.p(LOW, 1.0, LOW, WAIT) == robot.p(HIGH, 0.0, LOW, RECHARGE) == 1.0
    P = robot.transition_probs()
    assert P[HIGH, SEARCH, HIGH] == 0.9 and P[LOW, SEARCH, LOW] == 0.6
    assert robot.expected_reward()[LOW, SEARCH] == pytest.approx(0.0, abs=1e-15)  # 0.6 * 2 - 0.4 * 3
    assert robot.expected_reward_sas()[LOW, SEARCH, HIGH] == pytest.approx(-3.0)
    assert_array_equal(robot.legal, [[True, True, False], [True, True, True]])
    assert_array_equal(robot.start, [1.0, 0.0])
    assert robot.state_names == ("high", "low") and robot.action_names == ("search", "wait", "recharge")


def test_probabilities_sum_to_one(mdp):
    mdp.validate()
    assert_allclose(mdp.prob.sum(axis=2), mdp.legal, atol=1e-12)  # eq-2
    assert_allclose(mdp.transition_probs().sum(axis=2), mdp.legal, atol=1e-12)  # eq-3
    assert mdp.start.sum() == pytest.approx(1.0)


def test_marginals_are_sums_over_the_four_arguments(mdp):
    rng = np.random.default_rng(0)
    rewards = np.unique(mdp.reward)
    P, r = mdp.transition_probs(), mdp.expected_reward()
    with np.errstate(all="raise"):  # nothing is divided by 0 on the way
        r_next = mdp.expected_reward_sas()
    for s, a in zip(rng.integers(mdp.n_states, size=5), rng.integers(mdp.n_actions, size=5)):
        if not mdp.legal[s, a]:
            assert not P[s, a].any() and r[s, a] == 0 and np.isnan(r_next[s, a]).all()
            continue
        table = np.array([[mdp.p(j, x, s, a) for x in rewards] for j in np.unique(mdp.next_state[s, a])])
        seen = np.unique(mdp.next_state[s, a])
        assert_allclose(table.sum(axis=1), P[s, a, seen], atol=1e-15)  # eq-3
        assert_allclose((table * rewards).sum(), r[s, a], atol=1e-12)  # eq-4
        some = P[s, a, seen] > 0
        assert_allclose((table * rewards).sum(axis=1)[some] / P[s, a, seen][some], r_next[s, a, seen][some])  # eq-5
        assert_array_equal(np.isnan(r_next[s, a]), P[s, a] == 0)


def test_law_of_total_expectation(mdp):
    total = np.nansum(mdp.transition_probs() * mdp.expected_reward_sas(), axis=2)
    assert_allclose(total, mdp.expected_reward(), atol=1e-12)


def test_sampled_transitions_have_the_stated_frequencies():
    robot, rng, n = recycling_robot(), np.random.default_rng(0), 100_000
    tau = rollout(robot, deterministic_policy(robot, [SEARCH, SEARCH]), n, rng=rng)
    low, s_next = tau.states[:-1] == LOW, tau.states[1:]
    # 4 standard deviations of 20,000 and 80,000 draws; swapped probabilities would be 0.2 and 0.8 off
    assert abs(np.mean(s_next[low] == LOW) - 0.6) < 4 * np.sqrt(0.24 / low.sum()) < 0.014
    assert abs(np.mean(s_next[~low] == LOW) - 0.1) < 4 * np.sqrt(0.09 / (~low).sum()) < 0.0043
    assert_array_equal(tau.rewards, np.where(low & (s_next == HIGH), -3.0, 2.0))
    assert low.mean() == pytest.approx(0.2, abs=0.02)  # stationary: 0.1 / (0.1 + 0.4)


def test_outcome_with_the_same_state_and_reward_is_one_outcome():
    two = FiniteMDP.from_outcomes({(0, 0): [(0.5, 0, 1.0), (0.25, 0, 1.0), (0.25, 1, 1.0)]})
    one = FiniteMDP.from_outcomes({(0, 0): [(0.75, 0, 1.0), (0.25, 1, 1.0)]})
    assert two == one and two.prob.shape[2] == 2
    assert two.p(0, 1.0, 0, 0) == 0.75


def test_predecessors_are_the_transposed_graph(mdp):
    indptr, indices = mdp.predecessors()
    reached = mdp.transition_probs().sum(axis=1) > 0
    for s in range(mdp.n_states):
        assert_array_equal(indices[indptr[s] : indptr[s + 1]], np.flatnonzero(reached[:, s]))
    assert indices.dtype == np.int32 and indptr[-1] == indices.size and indptr.size == mdp.n_states + 1


def test_a_state_may_have_no_predecessor():
    indptr, indices = FiniteMDP.from_outcomes({(s, 0): [(1.0, 0, 0.0)] for s in range(3)}).predecessors()
    assert indptr.tolist() == [0, 3, 3, 3] and indices.tolist() == [0, 1, 2]


# ---------------------------------------------------------------------- construction


def test_absent_state_is_terminal_and_start_is_uniform_over_the_others():
    m = FiniteMDP.from_outcomes({(0, 1): [(1.0, 2, -1.0)], (1, 0): [(1.0, 0, 0.0)]}, n_states=4, n_actions=3)
    assert_array_equal(m.terminal, [False, False, True, True])
    assert_array_equal(m.legal, [[False, True, False], [True, False, False], [True] * 3, [True] * 3])
    assert_array_equal(m.start, [0.5, 0.5, 0.0, 0.0])
    assert m.prob[2:, :, 0].all() and not m.reward[2:].any()
    assert_array_equal(m.next_state[2:, :, 0], [[2] * 3, [3] * 3])
    assert repr(m) == "FiniteMDP(4 states, 3 actions, 1 outcomes, 2 terminal)"


def test_sizes_are_read_from_the_outcomes():
    m = FiniteMDP.from_outcomes({(0, 2): [(1.0, 5, 0.0)], (3, 0): [(1.0, 0, 0.0)]})
    assert (m.n_states, m.n_actions) == (6, 3)
    assert FiniteMDP.from_outcomes({(4, 0): [(1.0, 0, 0.0)], (0, 0): [(1.0, 0, 0.0)]}).n_states == 5
    assert_array_equal(FiniteMDP.from_outcomes({(0, 0): [(1, 1, 0)]}, start=[1.0, 0.0]).start, [1.0, 0.0])


def test_numbers_that_no_double_is_near_are_refused():
    for row in ((1.0, 0, 10**400), (10**400, 0, 1.0)):
        with pytest.raises(ValueError, match=r"^outcomes: got \(.*10000.*at \(0, 0\), must be"):
            FiniteMDP.from_outcomes({(0, 0): [row]})
    with pytest.raises(ValueError, match="^rewards: got"):
        discounted_return([10**400], 0.9)
    assert discounted_return([10**30, Fraction(1, 2)], 1.0) == 1e30


@pytest.mark.parametrize("miss", [1e-10, -1e-10, 1e-13, 1e-15])
def test_sums_may_miss_1_by_rounding(miss):
    """Far off, by 1e-15 or more, they are divided; within the last digit of each number they stay, bit by bit."""
    table = {(0, 0): [(0.5, 1, 0.0), (0.5 + miss, 0, 0.0)], (0, 1): [(1 + 2**-52, 1, 0.0)]}
    mdp = FiniteMDP.from_outcomes(table, start=[1 - miss, 0.0])
    typed = np.sort([0.5, 0.5 + miss])
    assert_array_equal(np.sort(mdp.prob[0, 0]), typed / typed.sum())
    assert mdp.prob[0, 1].max() == 1 + 2**-52 and mdp.start[0] == 1.0
    assert not mdp.prob.flags.writeable and not mdp.start.flags.writeable
    assert_array_equal(replace(mdp).prob, mdp.prob)


def test_start_is_a_state_or_a_distribution():
    table = {(0, 0): [(1.0, 2, 0.0)], (1, 0): [(1.0, 0, 0.0)]}
    assert_array_equal(FiniteMDP.from_outcomes(table, start=1).start, [0.0, 1.0, 0.0])
    assert_array_equal(FiniteMDP.from_outcomes(table, start=[0.25, 0.75, 0.0]).start, [0.25, 0.75, 0.0])
    large = FiniteMDP.from_outcomes({(0, 0): [(1, 0, 0)]}, n_states=10**6, start=0)  # no table of states by states
    assert_array_equal(np.flatnonzero(large.start), [0])


def test_from_arrays_inverts_the_views(mdp):
    P, R = mdp.transition_probs(), mdp.expected_reward_sas()  # NaN where P is 0
    again = FiniteMDP.from_arrays(P, R, terminal=mdp.terminal, start=mdp.start)
    assert_allclose(again.transition_probs(), P, atol=1e-15)
    assert_allclose(again.expected_reward_sas(), mdp.expected_reward_sas(), atol=1e-12)
    assert_array_equal(again.legal, mdp.legal | mdp.terminal[:, None])
    coarse = FiniteMDP.from_arrays(P, mdp.expected_reward(), terminal=mdp.terminal)
    assert_allclose(coarse.expected_reward(), mdp.expected_reward(), atol=1e-12)
    assert again.prob.shape[2] == max(1, (P > 0).sum(axis=2).max())


def test_from_arrays_makes_terminal_states_absorbing():
    P = np.zeros((3, 2, 3))
    P[0, 0, 1], P[1, 1, 0], P[1, 0, 2], P[2, 0, 2] = 1.0, 1.0, 1.0, 1.0
    m = FiniteMDP.from_arrays(P, [[7.0] * 2, [7.0] * 2, [0.0] * 2], terminal=[False, False, True], start=0)
    assert_array_equal(m.legal, [[True, False], [True, True], [True, True]])
    assert_array_equal(m.expected_reward(), [[7.0, 0.0], [7.0, 7.0], [0.0, 0.0]])
    assert_array_equal(m.transition_probs()[2], [[0, 0, 1]] * 2)
    assert not FiniteMDP.from_arrays(P, P).terminal.any()
    named = FiniteMDP.from_arrays(P, P, start=0, state_names=("a", "b", "c"), action_names=["x", "y"])
    assert named.state_names == ("a", "b", "c") and named.action_names == ("x", "y")


def test_arrays_are_read_only_and_typed(mdp):
    for name, kind in dict(next_state="i4", prob="f8", reward="f8", legal="b1", terminal="b1", start="f8").items():
        array = getattr(mdp, name)
        assert array.dtype == np.dtype(kind) and array.flags.c_contiguous
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


ARRAYS = ("next_state", "prob", "reward", "legal", "terminal", "start")


def raw():
    """Arrays of exactly the types that a FiniteMDP keeps, of a state 0 that leads to the end 1."""
    return dict(
        next_state=np.full((2, 1, 1), 1, np.int32), prob=np.ones((2, 1, 1)), reward=np.array([[[5.0]], [[0.0]]]),
        legal=np.ones((2, 1), bool), terminal=np.array([False, True]), start=np.array([1.0, 0.0]),
    )  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_what_a_caller_does_to_his_arrays_changes_nothing(name):
    arrays = raw()
    m, before = FiniteMDP(**arrays), FiniteMDP(**raw())
    arrays[name][...] = 0
    assert m == before and not np.shares_memory(getattr(m, name), arrays[name])
    views = {key: value[:] for key, value in raw().items()}
    views[name].flags.writeable = False  # a view that cannot be written to, of an array that can
    m = FiniteMDP(**views)
    views[name].base[...] = 0
    assert m == before
    frozen = raw()
    frozen[name].flags.writeable = False
    assert getattr(FiniteMDP(**frozen), name) is frozen[name]  # nobody can write to it: no copy


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))], ids=["copy", "deepcopy", "pickle"]
)
def test_copies_are_equal_and_read_only(again, mdp):
    other = again(mdp)
    assert other == mdp
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(other, name)[...] = 0


@pytest.mark.parametrize("state", [2**32 + 1, 2**31, -(2**32) + 1])
def test_states_beyond_32_bits_are_refused(state):
    with pytest.raises(ValueError, match=rf"^next_state: got .*{state}.*must be"):
        FiniteMDP(**raw() | dict(next_state=np.array([[[state]], [[1]]])))
    if state > 0:
        with pytest.raises(ValueError, match="^outcomes: needs an array of|^next_state: got"):
            FiniteMDP.from_outcomes({(0, 0): [(1.0, state, 0.0)]})
        with pytest.raises(ValueError, match=f"^next_state: got {state} at \\(s=0, a=0, k=0\\), must be in 0..1"):
            FiniteMDP.from_outcomes({(0, 0): [(1.0, state, 0.0)]}, n_states=2)


def test_a_list_of_states_is_no_mask():
    P = np.zeros((3, 1, 3))
    P[[0, 1], 0, 2] = 1.0
    with pytest.raises(ValueError, match=r"^terminal: got \[2, 0, 0\], must be True or False"):
        FiniteMDP.from_arrays(P, np.zeros((3, 1)), terminal=[2, 0, 0])
    with pytest.raises(ValueError, match="^terminal: got shape"):
        FiniteMDP.from_arrays(P, np.zeros((3, 1)), terminal=[1])


def test_names_are_told_apart():
    for names in ([float("nan"), "b"], [[1], [2]], "ab", b"ab"):
        with pytest.raises(ValueError, match="^state_names: got .*must be a sequence of names"):
            FiniteMDP(**raw(), state_names=names)


def test_equality_ignores_padding_and_order_of_outcomes_only():
    m = awkward()
    fields = ("next_state", "prob", "reward", "legal", "terminal", "start")
    arrays = {name: getattr(m, name) for name in fields}

    def build(**change):
        return FiniteMDP(**(arrays | change))

    flipped = {name: arrays[name][:, :, ::-1] for name in fields[:3]}
    padded = {name: np.pad(arrays[name], ((0, 0), (0, 0), (0, 2))) for name in fields[:3]}
    padded["reward"] = np.where(padded["prob"] > 0, padded["reward"], 99.0)
    assert build(**flipped) == m and build(**padded) == m
    split = {name: np.concatenate([arrays[name]] * 2, axis=2) for name in fields[:3]} | {"legal": arrays["legal"]}
    assert build(**(split | {"prob": split["prob"] / 2})) == m  # two halves of an outcome are one outcome
    other = arrays["reward"].copy()
    other[0, 0, 0] += 1.0
    start = np.roll(arrays["start"], 1) * 0.0
    start[1] = 1.0
    assert build(reward=other) != m and build(start=start) != m
    names = tuple("abcdefg")
    assert build(state_names=names) != m and build(state_names=names) == build(state_names=list(names))
    assert build(action_names=("x", "y", "z")) != m
    left, right = (FiniteMDP.from_outcomes({(0, 0): [(1, s, 0)], (1, 0): [(1, 0, 0)]}) for s in (0, 1))
    even, odd = (FiniteMDP.from_outcomes({(0, 0): [(p, 0, 0), (1 - p, 1, 0)]}) for p in (0.5, 0.25))
    one, other = (FiniteMDP.from_outcomes({(0, 0): [(0.5, 0, r), (0.5, 0, 3 - r)]}) for r in (1, 2))
    assert one == other
    fair, bent = (FiniteMDP.from_outcomes({(0, 0): [(p, 0, 1), (1 - p, 0, 2)]}) for p in (0.5, 0.25))
    assert left != right and even != odd and fair != bent  # same state, other rewards: two outcomes
    assert m != "a process" and FiniteMDP.__hash__ is None


# ---------------------------------------------------------------------- policies


def test_uniform_policy_is_uniform_over_legal_actions(mdp):
    pi = uniform_policy(mdp)
    assert_allclose(pi.sum(axis=1), 1.0)
    assert_array_equal(pi > 0, mdp.legal)
    assert_allclose(pi.max(axis=1) * mdp.legal.sum(axis=1), 1.0)


def test_deterministic_policy_takes_the_named_action():
    pi = deterministic_policy(recycling_robot(), [WAIT, RECHARGE])
    assert_array_equal(pi, [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert_array_equal(deterministic_policy(recycling_robot(), [0, 0])[:, 0], 1.0)


def test_policy_and_values_are_copied_to_floats():
    walk = random_walk(1)
    assert check_policy(walk, [[1], [1], [1]]).dtype == float
    V = np.array([5.0, 1.0, 7.0])
    assert_array_equal(finite_values(walk, V), [0.0, 1.0, 0.0])  # terminal states count as 0
    assert_array_equal(finite_values(walk, 2), [0.0, 2.0, 0.0])
    assert V[0] == 5.0
    assert_allclose(check_policy(stay_or_go(), [[0.5 + 4e-10, 0.5], [1.0, 0.0]])[0, 0], 0.5)


# ---------------------------------------------------------------------- returns, (6) to (9)


def test_worked_return():
    """Sutton and Barto (2018), exercise 3.8: -1, 2, 6, 3, 2 at gamma 0.5; erratum of (8) would give G_0 = -1.5."""
    G = discounted_returns([-1, 2, 6, 3, 2], 0.5)
    assert_array_equal(G, [2.0, 6.0, 8.0, 4.0, 2.0])
    assert [discounted_return([-1, 2, 6, 3, 2], 0.5, t) for t in range(6)] == [2.0, 6.0, 8.0, 4.0, 2.0, 0.0]


def test_undiscounted_and_myopic_returns():
    rewards = np.array([3.0, -1.0, 4.0, 1.0])
    assert discounted_return(rewards, 1.0) == 7.0
    assert_array_equal(discounted_returns(rewards, 1.0), [7.0, 4.0, 5.0, 1.0])
    assert_array_equal(discounted_returns(rewards, 0.0), rewards)
    assert discounted_return(rewards, 0) == 3.0
    assert discounted_return(np.ones(30), 1) == 30.0  # a pole held up for 30 steps


def test_infinite_sums():
    k = np.arange(1, 2000)
    assert discounted_return(np.ones(1000), 0.9) == pytest.approx(10.0)
    assert discounted_return(k, 0.9) == pytest.approx(100.0)  # unbounded rewards, finite return
    assert discounted_return(-1.0 * (k == 10), 0.9) == pytest.approx(-(0.9**9))
    assert discounted_return(-1.0 * (k % 10 == 0), 0.9) == pytest.approx(-(0.9**9) / (1 - 0.9**10))


@pytest.mark.parametrize("gamma", [0.0, 0.3, 0.95, 1.0])
def test_absorbing_state_changes_no_return(gamma):
    rewards = np.random.default_rng(0).normal(size=6)
    for n in (1, 4, 1000):
        padded = np.concatenate([rewards, np.zeros(n)])
        assert discounted_return(padded, gamma) == pytest.approx(discounted_return(rewards, gamma), rel=1e-14)
        assert_array_equal(discounted_returns(padded, gamma)[:6], discounted_returns(rewards, gamma))
    assert_allclose(discounted_returns(rewards, gamma)[2], discounted_return(rewards, gamma, t=2), rtol=1e-13)


def test_numbers_come_back_as_plain_numbers():
    assert type(check_probability("gamma", 1)) is float and type(check_count("n", 3.0)) is int
    assert type(discounted_return([1, 2], 1)) is float and type(recycling_robot().p(0, 2.0, 0, 0)) is float


def test_no_rewards_no_return():
    assert discounted_return([], 0.9) == 0.0 and discounted_returns([], 0.9).shape == (0,)


# ---------------------------------------------------------------------- trajectories, (10), (11)


def test_trajectory_has_one_state_more_than_actions_and_rewards():
    rng = np.random.default_rng(3)
    tau = rollout(recycling_robot(), uniform_policy(recycling_robot()), 50, rng=rng)
    assert tau.states.shape == (51,) and tau.actions.shape == tau.rewards.shape == (50,)
    assert tau.states[0] == HIGH and not tau.terminated
    robot = recycling_robot()
    for s, a, r, s_next in zip(tau.states, tau.actions, tau.rewards, tau.states[1:]):
        assert robot.p(s_next, r, s, a) > 0


def test_trajectory_ends_at_the_terminal_state():
    m = chain([3.0, -1.0, 2.0])
    tau = rollout(m, uniform_policy(m), 10, rng=np.random.default_rng(0))
    assert_array_equal(tau.states, [0, 1, 2, 3])
    assert_array_equal(tau.rewards, [3.0, -1.0, 2.0])
    assert tau.terminated is True and tau.actions.shape == (3,)
    short = rollout(m, uniform_policy(m), 2, rng=np.random.default_rng(0))
    assert_array_equal(short.states, [0, 1, 2])
    assert not short.terminated
    assert_array_equal(rollout(m, uniform_policy(m), 9, s=2, rng=np.random.default_rng(0)).states, [2, 3])
    assert rollout(m, uniform_policy(m), 1, s=0, rng=np.random.default_rng(0)).states.tolist() == [0, 1]
    assert rollout(m, uniform_policy(m), 4, s=3, rng=np.random.default_rng(0)).states.tolist() == [3]


def test_rollout_starts_where_it_is_told():
    m = FiniteMDP.from_outcomes({(0, 0): [(1.0, 2, 5.0)], (1, 0): [(1.0, 2, 7.0)]}, start=1)
    pi = uniform_policy(m)
    assert rollout(m, pi, 1.0, s=0, rng=np.random.default_rng(0)).rewards.tolist() == [5.0]
    assert rollout(m, pi, 1, rng=np.random.default_rng(0)).rewards.tolist() == [7.0]


def test_same_seed_same_trajectory():
    m = awkward()
    runs = [rollout(m, uniform_policy(m), 30, rng=np.random.default_rng(seed)) for seed in (5, 5, 6)]
    for field in ("states", "actions", "rewards"):
        assert_array_equal(getattr(runs[0], field), getattr(runs[1], field))
    assert runs[0].states.tolist() != runs[2].states.tolist()


def test_first_state_and_actions_are_drawn_from_start_and_policy():
    m = FiniteMDP.from_outcomes({(s, a): [(1.0, 3, 0.0)] for s in range(3) for a in range(2)}, start=[0.2, 0.3, 0.5, 0])
    pi, rng = np.array([[0.9, 0.1], [0.5, 0.5], [0.0, 1.0], [1.0, 0.0]]), np.random.default_rng(0)
    first = np.array([(t.states[0], t.actions[0]) for t in (rollout(m, pi, 1, rng=rng) for _ in range(4000))])
    # 4 standard deviations of 4000 draws: below 0.032
    assert_allclose(np.bincount(first[:, 0]) / 4000, [0.2, 0.3, 0.5], atol=0.032)
    for s in range(3):
        assert abs(first[first[:, 0] == s, 1].mean() - pi[s, 1]) < 4 * np.sqrt(0.25 / 800)
    assert (first[first[:, 0] == 2, 1] == 1).all()


def test_mean_return_is_the_value():
    robot = recycling_robot()
    pi, rng = uniform_policy(robot), np.random.default_rng(0)
    v = solve_policy(robot, pi, 0.9)
    assert_allclose(v, [14.0708, 12.0059], atol=5e-5)
    n = 20_000 if HAVE_NUMBA else 1000  # a band of 0.07, or 0.33
    for s, a, expected in [(HIGH, None, v[HIGH]), (LOW, None, v[LOW]), (LOW, RECHARGE, 0.9 * v[HIGH])]:
        G = sample_returns(robot, pi, 0.9, n, s=s, a=a, max_steps=200, rng=rng)
        # worst over 20 seeds 0.03 at n = 20,000; with the first action ignored 0.66 off
        assert abs(G.mean() - expected) < 4 * G.std() / np.sqrt(n) < 0.1 * np.sqrt(20_000 / n)


def test_sampled_returns_of_a_certain_process():
    m, rewards = chain([1.0, 2.0, -4.0, 8.0]), [1.0, 2.0, -4.0, 8.0]
    pi, rng = uniform_policy(m), np.random.default_rng(0)
    G = sample_returns(m, pi, 0.5, 3, s=0, max_steps=10, rng=rng)
    assert_array_equal(G, np.full(3, discounted_return(rewards, 0.5)))
    assert sample_returns(m, pi, 0.5, 1, s=1, max_steps=2, rng=rng)[0] == 2.0 - 2.0  # cut after two steps
    assert sample_returns(m, pi, 0.5, 1, s=0, max_steps=1, rng=rng)[0] == 1.0
    assert sample_returns(m, pi, 0.5, 1, s=4, max_steps=5, rng=rng)[0] == 0.0  # terminal
    assert sample_returns(loop(), [[1.0]], 0.9, 1, s=0, max_steps=500, rng=rng)[0] == pytest.approx(10.0)


def test_given_first_action_only_is_forced():
    m = stay_or_go()
    pi, rng = np.array([[0.0, 1.0], [1.0, 0.0]]), np.random.default_rng(0)
    assert sample_returns(m, pi, 0.5, 2, s=0, a=0, max_steps=9, rng=rng).tolist() == [-0.5, -0.5]  # stay, then go
    assert sample_returns(m, pi, 0.5, 2, s=0.0, a=1.0, max_steps=9, rng=rng).tolist() == [-1.0, -1.0]
    assert sample_returns(m, pi, 0.5, 2, s=0, max_steps=9, rng=rng).tolist() == [-1.0, -1.0]
    assert sample_returns(m, pi, 0.5, 1, s=0, a=0, max_steps=1, rng=rng).tolist() == [0.0]


# ---------------------------------------------------------------------- drawing


class Fixed:
    """Stands in for a generator: random() gives one number."""

    def __init__(self, u):
        self.u = u

    def random(self):
        return self.u


def test_draw_inverts_the_cumulative_probabilities():
    cdf = cumulative([0.25, 0.0, 0.5, 0.25, 0.0])
    assert_array_equal(cdf, [0.25, 0.25, 0.75, 1.0, 1.0])
    plain = getattr(draw, "__wrapped__", draw)
    plain = getattr(plain, "py_func", plain)
    below_one = np.nextafter(1.0, 0.0)
    for u, k in [(0.0, 0), (0.2499, 0), (0.25, 2), (0.7499, 2), (0.75, 3), (below_one, 3)]:
        assert plain(cdf, Fixed(u)) == k


def test_cumulative_is_one_from_the_last_positive_entry_on_whatever_rounding_does():
    rng = np.random.default_rng(0)
    prob = rng.dirichlet(np.ones(50), size=(4, 3))
    prob[..., 40:] = 0.0
    prob[0, 0] = 0.0  # an illegal action
    cdf = cumulative(prob / 1.001)
    assert (cdf[..., 39:] == 1.0).all() and (np.diff(cdf[1:], axis=-1) >= 0).all()
    assert_allclose(cdf[1:, :, :39], np.cumsum(prob / 1.001, axis=-1)[1:, :, :39])


def test_sampler_holds_the_process():
    m = awkward()
    world = m.sampler()
    assert_array_equal(world.next_state, m.next_state)
    assert_array_equal(world.reward, m.reward)
    assert_array_equal(world.terminal, m.terminal)
    assert_array_equal(world.cdf, cumulative(m.prob))
    assert_array_equal(world.start_cdf, cumulative(m.start))
