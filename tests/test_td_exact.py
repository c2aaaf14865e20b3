"""The learners of td.py and the batches of episodes.py on episodes that are written down, against a few plain lines."""

import inspect
from collections import namedtuple
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from rlcore.batch import batch_mc, batch_td, certainty_equivalence
from rlcore.core.learner import log, note
from rlcore.core.sampling import cumulative, draw
from rlcore.core.schedules import decaying
from rlcore.dp import value_iteration
from rlcore.mdp import FiniteMDP, Trajectory, uniform_policy
from rlcore.monte_carlo import constant_alpha_mc, mc_prediction
from rlcore.policies import epsilon_greedy, soft_greedy
from rlcore.studies.ch02 import backups_per_second, td0_groups
from rlcore.studies.ch04 import first_updates, repeat, squared_error, walk_error, with_random_actions
from rlcore.td import expected_sarsa, q_learning, sarsa, td0

GAMMA = 0.5


def rng(seed=0):
    return np.random.default_rng(seed)


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)


class Script(gym.Env):
    """Plays the given episodes whatever is done; going on after an end is an error. No state is known to be terminal.

    An episode is (states (T + 1,), rewards (T,), "end" or "cut" or "on"); "on": the learner has to stop by itself.
    """

    def __init__(self, episodes, n_states, n_actions=1):
        self.episodes, self.actions = episodes, []
        self.observation_space, self.action_space = gym.spaces.Discrete(n_states), gym.spaces.Discrete(n_actions)

    def reset(self, *, seed=None, options=None):
        if seed is not None:  # once before a run
            self.actions = []
            return 0, {}
        self.actions.append([])
        return self.episodes[len(self.actions) - 1][0][0], {}

    def step(self, action):
        states, rewards, way = self.episodes[len(self.actions) - 1]
        self.actions[-1].append(int(action))
        t = len(self.actions[-1])
        assert t <= len(rewards), "the episode is over"
        over = t == len(rewards)
        return states[t], rewards[t - 1], over and way == "end", over and way == "cut", {}


FIRST = ([0, 1, 0, 2], [1.0, 2.0, 4.0], "end")  # G = 3, 4, 4
SECOND = ([1, 0, 2], [6.0, 16.0], "end")  # G = 14, 16
THIRD = ([0, 0, 1, 1], [3.0, -2.0, 5.0], "cut")
LOOSE = ([0, 1, 1, 0, 0], [2.0, 1.0, -3.0, 100.0], "on")  # for max_steps = 3: ends in state 0
ONE = np.ones((3, 1))


# ---------------------------------------------------------------------- Monte Carlo


@pytest.mark.parametrize("first_visit, V", [(True, [9.5, 9, 0]), (False, [23 / 3, 9, 0])])
def test_means_of_two_episodes(first_visit, V):
    world = Script([FIRST, SECOND], 3)
    run = mc_prediction(world, ONE, GAMMA, 2, first_visit=first_visit, max_steps=9, record=1, rng=rng())
    close(run.history, [[0, 0, 0], [3 if first_visit else 3.5, 4, 0], V])
    close(run.V, V)
    assert run.returns.tolist() == [7, 22] and run.lengths.tolist() == [3, 2] and run.Q is None
    np.testing.assert_array_equal(run.policy, ONE)
    run.history[:] = 9
    close(run.V, V)  # a copy


@pytest.mark.parametrize("first_visit", [True, False])
def test_means_of_pairs(first_visit):
    episodes, pi = [FIRST, SECOND, THIRD, LOOSE] * 3, np.array([[0.5, 0.5], [0.3, 0.7], [1.0, 0.0]])
    world = Script(episodes, 3, 2)
    options = dict(first_visit=first_visit, target="q", max_steps=3, record=1, rng=rng(1))
    run = mc_prediction(world, pi, GAMMA, 12, **options)
    G_of, history = {}, [np.zeros((3, 2))]
    for (states, rewards, _), actions in zip(episodes, world.actions):
        pairs = list(zip(states, actions))
        for t, pair in enumerate(pairs):
            if not (first_visit and pair in pairs[:t]):
                G_of.setdefault(pair, []).append(sum(GAMMA**k * r for k, r in enumerate(rewards[t:3])))
        history.append([[np.mean(G_of.get((s, a), 0.0)) for a in range(2)] for s in range(3)])
    close(run.history, history)
    close(run.Q, history[-1])
    np.testing.assert_array_equal(run.policy, pi)
    assert len(G_of) == 4 and run.V is None and run.lengths.tolist() == [3, 2, 3, 3] * 3
    assert run.returns.tolist() == [7, 22, 6, 0] * 3
    run.history[:] = 9
    close(run.Q, history[-1])


def test_means_of_pairs_leave_out_what_is_not_legal():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 2.0)], (1, 1): [(1.0, 2, 4.0)]}, start=0, n_states=3, n_actions=2)
    options = dict(target="q", max_steps=9, record=1, rng=rng())
    run = mc_prediction(mdp, np.array([[1, 0], [0, 1], [1, 0.0]]), GAMMA, 1, **options)
    close(run.Q[[0, 1, 2], [0, 1, 0]], [4, 4, 0])
    assert run.Q[0, 1] == run.Q[1, 0] == -np.inf and run.history.shape == (2, 3, 2)


def moved_to_returns(episodes, V, alpha, first_visit, history):
    """Constant-alpha Monte Carlo, from the last state of each episode back; alpha(n) after n updates."""
    V, N, history = np.array(V), np.zeros(len(V)), [np.array(V)] if history is None else history
    for states, rewards, way in episodes:
        G = 0.0 if way == "end" else V[states[len(rewards)]]
        for t in reversed(range(len(rewards))):
            s, G = states[t], rewards[t] + GAMMA * G
            if not (first_visit and s in states[:t]):
                V[s] += alpha(N[s]) * (G - V[s])
                N[s] += 1
        history.append(V.copy())
    return np.array(history)


@pytest.mark.parametrize("record, kept", [(0, 1), (1, 8), (3, 3), (8, 1)])
@pytest.mark.parametrize("first", [[1.0, 2.0], [[3.0, -np.inf]]])
def test_a_log_starts_with_the_first_estimates(first, record, kept):
    table = np.array(first)
    returns, lengths, history = log(table, 7, record)
    assert history.shape == (kept, *table.shape) and np.array_equal(history[0], table) and not history[1:].any()
    assert returns.tolist() == lengths.tolist() == [0] * 7 and (returns.dtype, lengths.dtype) == (float, np.int64)
    table[:] = 0.0  # history does not share the memory of what is learned
    assert np.array_equal(history[0], first)
    world = namedtuple("World", "marks")(np.zeros(2, np.int64))
    for k in range(7):
        table[:] = k
        assert not note(world, history, table, k, record)
    assert np.array_equal(history[0], first)
    assert [row.flat[0] for row in history[1:]] == ([] if record == 0 else list(range(record - 1, 7, record)))


@pytest.mark.parametrize("first_visit", [True, False])
@pytest.mark.parametrize("record", [0, 1, 3])
def test_constant_alpha_on_four_episodes(first_visit, record):
    V0 = [1.0, -2.0, 10.0]
    for alpha, rate in (
        (0.25, lambda n: 0.25),
        (decaying(0.9, rate=2.0, power=0.5), lambda n: 0.9 / (1 + 2 * n) ** 0.5),
    ):
        run = constant_alpha_mc(
            Script([FIRST, SECOND, THIRD, LOOSE, THIRD], 3),
            ONE,
            GAMMA,
            5,
            alpha=alpha,
            V0=V0,
            first_visit=first_visit,
            max_steps=3,
            record=record,
            rng=rng(),
        )
        short = (LOOSE[0][:4], LOOSE[1][:3], "cut")
        history = moved_to_returns([FIRST, SECOND, THIRD, short, THIRD], V0, rate, first_visit, None)
        close(run.V, history[-1])
        assert run.history is None if record == 0 else not close(run.history, history[::record])
        assert run.returns.tolist() == [7, 22, 6, 0, 6] and run.lengths.tolist() == [3, 2, 3, 3, 3]
        assert run.policy.tolist() == [[1], [1], [1]] and run.Q is None


def test_constant_alpha_by_hand():
    """Every visit by default: V(0) = 0 + (4 - 0) / 2 = 2, V(1) = 1 + (4 - 1) / 2 = 2.5, V(0) = 2 + (3 - 2) / 2."""
    run = constant_alpha_mc(Script([FIRST], 3), ONE, GAMMA, 1, alpha=0.5, V0=[0.0, 1.0, 7.0], record=1, rng=rng())
    close(run.V, [2.5, 2.5, 7.0])
    assert run.history.shape == (2, 3)
    close(constant_alpha_mc(Script([FIRST], 3), ONE, GAMMA, 1, alpha=0.5, rng=rng()).V, [2.5, 2.0, 0.0])


@pytest.mark.parametrize("first_visit", [True, False])
def test_constant_alpha_on_a_long_episode(first_visit):
    """There is room for 64 steps at first; 63, 64, 65 and 300 come back to their states."""
    g = rng(3)
    lengths = (63, 64, 65, 300)
    episodes = [(g.integers(9, size=n + 1).tolist(), g.normal(size=n).tolist(), "end") for n in lengths]
    options = dict(alpha=0.5, V0=1.0, first_visit=first_visit, record=1, rng=rng())
    run = constant_alpha_mc(Script(episodes, 9), np.ones((9, 1)), GAMMA, 4, **options)
    close(run.history, moved_to_returns(episodes, np.ones(9), lambda n: 0.5, first_visit, None))


# ---------------------------------------------------------------------- TD(0)


@pytest.mark.parametrize("record", [0, 1, 3])
@pytest.mark.parametrize("groups", [None, [0, 1, 1, 2], [1, 0, 0, 1]])
def test_td0_on_four_episodes(record, groups):
    goes = np.arange(4) if groups is None else np.array(groups)
    V0 = np.array([1.0, -2.0, 10.0, 4.0]) if groups is None else 3.0
    for alpha, rate in (
        (0.25, lambda n: 0.25),
        (decaying(0.9, rate=2.0, power=0.5), lambda n: 0.9 / (1 + 2 * n) ** 0.5),
    ):
        options = dict(alpha=alpha, max_steps=3, record=record, rng=rng())
        options |= dict(V0=V0) if groups is None else dict(w0=V0, groups=groups)
        learn = td0 if groups is None else td0_groups
        run = learn(Script([FIRST, SECOND, THIRD, LOOSE, THIRD], 4), np.ones((4, 1)), GAMMA, 5, **options)
        w, N = V0 + np.zeros(4), np.zeros(4)  # w: of the groups
        history = [w[goes]]
        for states, rewards, way in (FIRST, SECOND, THIRD, LOOSE, THIRD):
            for t, r in enumerate(rewards[:3]):
                here, there = goes[states[t]], goes[states[t + 1]]
                end = way == "end" and t == len(rewards) - 1
                w[here] += rate(N[here]) * (r + (0.0 if end else GAMMA * w[there]) - w[here])
                N[here] += 1
            history.append(w[goes])
        close(run.V, history[-1])
        assert run.history is None if record == 0 else not close(run.history, history[::record])
        assert run.returns.tolist() == [7, 22, 6, 0, 6] and run.lengths.tolist() == [3, 2, 3, 3, 3]
        assert run.policy.tolist() == [[1]] * 4 and run.Q is None
        assert run.visits.tolist() == N[: goes.max() + 1].tolist()
        assert run.weights is None if groups is None else not close(run.weights, w[: goes.max() + 1])


def test_td0_by_hand():
    """V(0) = 0 + (1 + 1/2 - 0) / 2 = 3/4, V(1) = 1 + (2 + 3/8 - 1) / 2 = 27/16, V(0) = 3/4 + (4 - 3/4) / 2."""
    run = td0(Script([FIRST], 3), ONE, GAMMA, 1, alpha=0.5, V0=[0.0, 1.0, 7.0], record=1, rng=rng())
    close(run.V, [2.375, 1.6875, 7.0])
    close(run.history, [[0, 1, 7], [2.375, 1.6875, 7.0]])
    start = td0(Script([FIRST], 3), ONE, GAMMA, 1, alpha=0.5, record=1, rng=rng())
    close(start.history, [[0, 0, 0], [2.25, 1.125, 0]])


def test_terminal_states_are_worth_0_in_a_process_whose_groups_hold_them():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 2.0)], (1, 0): [(1.0, 2, 4.0)]}, start=0)
    run = td0_groups(mdp, ONE, GAMMA, 2, alpha=0.5, w0=8.0, groups=[0, 1, 1], record=1, rng=rng())
    close(run.history, [[8, 8, 0], [7, 6, 0], [6, 5, 0]])
    close(run.V, [6, 5, 0])
    own = td0(mdp, ONE, GAMMA, 1, alpha=0.5, V0=[8.0, 8.0, 8.0], record=1, rng=rng())
    close(own.history, [[8, 8, 0], [7, 6, 0]])
    mdp = FiniteMDP.from_outcomes({(1, 0): [(1.0, 2, 2.0)], (2, 0): [(1.0, 0, 4.0)]}, start=1)
    run = td0_groups(mdp, ONE, GAMMA, 1, alpha=0.5, w0=8, groups=[1, 0, 0], record=1, rng=rng())
    close(run.history, [[0, 8, 8], [0, 5.5, 5.5]])  # 8 + (2 + 4 - 8) / 2 = 7, 7 + (4 - 7) / 2; state 0 ends


@pytest.mark.parametrize("groups", [[0, 1], [[0, 1, 0]], [0, 1, -1], [0.0, 1.0, 1.0], None, [True, False, True]])
def test_bad_groups(groups):
    whole = np.asarray(groups).dtype.kind == "i"
    with pytest.raises(ValueError, match=f"^groups: got .* must be {'.3,. ' if whole else ''}integers"):
        td0_groups(Script([FIRST], 3), ONE, GAMMA, 1, alpha=0.5, groups=groups, rng=rng())


def test_groups_may_be_of_any_integers():
    groups = np.array([0, 1, 1], np.uint8)
    learn = partial(td0_groups, Script([FIRST], 3), ONE, GAMMA, 1, alpha=0.5)
    run = learn(w0=1.0, groups=groups, rng=rng())
    close(run.V, learn(w0=1.0, groups=[0, 1, 1], rng=rng()).V)
    with pytest.raises(ValueError, match="^w0: got .1.0, 1.0, 1.0., must be a finite number"):
        learn(w0=[1.0, 1.0, 1.0], groups=groups, rng=rng())


# ---------------------------------------------------------------------- control


def control(learn, world, n_episodes, max_steps, Q, alpha, epsilon, g, pi=None):
    """(history, returns, lengths, steps) of a run; alpha(n), epsilon(k, now): the schedules; pi instead of epsilon."""
    Q, N, now, history, G, T = np.array(Q), np.zeros(np.shape(Q)), 0, [np.array(Q)], [], []

    def choose(s):
        return epsilon_greedy(Q, s, epsilon(len(T), now), g) if pi is None else draw(cumulative(pi)[s], g)

    world.reset(seed=0)
    for _ in range(n_episodes):
        (s, _), t, total, over, a = world.reset(), 0, 0.0, False, None
        while not over:
            a = choose(s) if a is None else a
            eps = epsilon(len(T), now)
            s_next, r, terminated, truncated, _ = world.step(a)
            t, now, total = t + 1, now + 1, total + r
            a_next = choose(s_next) if learn is sarsa else None
            best, mean = Q[s_next].max(), Q[s_next].mean()
            value = {sarsa: Q[s_next, a_next or 0], q_learning: best, expected_sarsa: (1 - eps) * best + eps * mean}
            Q[s, a] += alpha(N[s, a]) * (r + (0.0 if terminated else GAMMA * value[learn]) - Q[s, a])
            N[s, a] += 1
            s, a, over = s_next, a_next, terminated or truncated or t == max_steps
        history.append(Q.copy())
        G.append(total)
        T.append(t)
    return np.array(history), G, T, now


EPSILON = [
    (0.4, lambda k, now: 0.4),
    (decaying(0.9, rate=0.3), lambda k, now: 0.9 / (1 + 0.3 * k)),
    (decaying(0.9, rate=0.05, power=1.5, per_step=True), lambda k, now: 0.9 / (1 + 0.05 * now) ** 1.5),
]
ALPHA = [(0.25, lambda n: 0.25), (decaying(0.9, rate=2.0, power=0.5), lambda n: 0.9 / (1 + 2 * n) ** 0.5)]
Q0 = np.array([[1.0, -2.0], [3.0, 3.5], [10.0, 12.0]])


@pytest.mark.parametrize("learn", [sarsa, expected_sarsa, q_learning])
@pytest.mark.parametrize("epsilon, eps", EPSILON, ids=["fixed", "by episode", "by step"])
@pytest.mark.parametrize("alpha, rate", ALPHA, ids=["fixed", "falling"])
def test_control_on_twelve_episodes(learn, epsilon, eps, alpha, rate):
    world = Script([FIRST, SECOND, THIRD, LOOSE] * 3, 3, 2)
    history, returns, lengths, now = control(learn, world, 12, 3, Q0, rate, eps, rng(2))
    actions = world.actions
    assert len({a for row in actions for a in row}) == 2
    for record in (1, 5, 0):
        options = dict(alpha=alpha, epsilon=epsilon, Q0=Q0, max_steps=3, record=record, rng=rng(2))
        run = learn(world, GAMMA, 12, **options)
        assert world.actions == actions
        assert run.returns.tolist() == returns == [7, 22, 6, 0] * 3 and run.lengths.tolist() == lengths
        close(run.Q, history[-1])
        close(run.V, history[-1].max(axis=1))
        close(run.policy, soft_greedy(history[-1], eps(12, now)))
        assert run.history is None if record == 0 else not close(run.history, history[::record])


@pytest.mark.parametrize("record", [1, 5, 0])
def test_sarsa_under_a_policy_on_twelve_episodes(record):
    world, pi = Script([FIRST, SECOND, THIRD, LOOSE] * 3, 3, 2), np.array([[0.5, 0.5], [0.25, 0.75], [0.1, 0.9]])
    history, returns, lengths, _ = control(sarsa, world, 12, 3, Q0, lambda n: 0.25, lambda k, now: 0.0, rng(2), pi)
    actions = world.actions
    run = sarsa(world, GAMMA, 12, alpha=0.25, pi=pi, Q0=Q0, max_steps=3, record=record, rng=rng(2))
    assert world.actions == actions and run.returns.tolist() == returns and run.lengths.tolist() == lengths
    close(run.Q, history[-1])
    close(run.V, (pi * history[-1]).sum(axis=1))
    np.testing.assert_array_equal(run.policy, pi)
    assert run.history is None if record == 0 else not close(run.history, history[::record])


@pytest.mark.parametrize("learn, first", [(sarsa, 0.75), (expected_sarsa, 0.75), (q_learning, 0.75)])
def test_control_by_hand(learn, first):
    """One action: Q(0) = (1 + 1/2) / 2 = 3/4, Q(1) = 1 + (2 + 3/8 - 1) / 2 = 27/16, Q(0) = 3/4 + (4 - 3/4) / 2."""
    run = learn(Script([FIRST], 3), GAMMA, 1, alpha=0.5, epsilon=0.1, Q0=[[0.0], [1.0], [7.0]], record=1, rng=rng())
    close(run.history[:, :, 0], [[0, 1, 7], [2.375, 1.6875, 7.0]])
    start = learn(Script([FIRST], 3), GAMMA, 1, alpha=0.5, epsilon=0.1, record=1, rng=rng())
    close(start.history[:, :, 0], [[0, 0, 0], [2.1875 + 0.0625, 1.125, 0.0]])


@pytest.mark.parametrize("learn", [sarsa, expected_sarsa, q_learning])
def test_no_limit_is_needed_where_random_actions_end_every_episode(learn):
    """Under pi, the actions of pi count: it may end though random actions would not, and the other way round."""
    ends = {(0, 0): [(1.0, 2, 1.0)], (0, 1): [(1.0, 1, 1.0)]}
    trap = FiniteMDP.from_outcomes(ends | {(1, 0): [(1.0, 1, 0.0)]}, start=0, n_states=3)
    stay = FiniteMDP.from_outcomes({(0, 0): [(1.0, 2, 1.0)], (0, 1): [(1.0, 0, 0.0)]}, start=0, n_states=3)
    options = dict(alpha=0.5, rng=rng())
    assert learn(stay, GAMMA, 2, epsilon=0.5, **options).returns.tolist() == [1, 1]
    with pytest.raises(ValueError, match="^max_steps"):
        learn(trap, GAMMA, 2, epsilon=0.5, **options)
    if learn is sarsa:
        left, right = ([[p, 1 - p], [1.0, 0.0], [1.0, 0.0]] for p in (1.0, 0.0))
        assert learn(trap, GAMMA, 2, pi=left, **options).returns.tolist() == [1, 1]
        with pytest.raises(ValueError, match="^max_steps"):
            learn(stay, GAMMA, 2, pi=np.where(uniform_policy(stay) == 0.5, right, uniform_policy(stay)), **options)


PREDICTION = [partial(mc_prediction, max_steps=9), partial(constant_alpha_mc, alpha=0.5), partial(td0, alpha=0.5)]
CONTROL = [partial(learn, alpha=0.5, epsilon=0.5) for learn in (sarsa, expected_sarsa, q_learning)]
LEARNERS = [partial(learn, pi=[[1.0]] * 3) for learn in [*PREDICTION, partial(sarsa, alpha=0.5)]] + CONTROL
BAD = [("gamma", 1.5), ("gamma", -0.5), ("n_episodes", 0), ("n_episodes", 1.5), ("rng", None), ("rng", 0)]
BAD += [("max_steps", 0), ("record", -1), ("record", 0.5), ("alpha", 0), ("epsilon", -1), ("pi", [[1.0]])]


@pytest.mark.parametrize("learn", LEARNERS)
def test_results_are_arrays_and_settings_are_checked(learn):
    good = dict(world=Script([FIRST] * 2, 3), gamma=0.5, n_episodes=2, rng=rng())
    run = learn(**good, record=1)
    assert run.lengths.dtype == run.visits.dtype == np.int64 and run.visits.sum() == (4 if learn is LEARNERS[0] else 6)
    assert run.returns.dtype == run.history.dtype == run.policy.dtype == np.float64
    assert run.policy.shape == (3, 1) and run.returns.shape == run.lengths.shape == (2,)
    names = inspect.signature(learn.func).parameters
    for name, value in BAD:
        if name in names and (name in learn.keywords or name not in ("pi", "epsilon")):
            with pytest.raises(ValueError, match=f"^{name}: "):
                learn(**good | {name: value})


# ---------------------------------------------------------------------- batches

PAIRS = [([0, 1, 0, 2], [1.0, 2.0, 4.0]), ([1, 0, 2], [6.0, 16.0])]


def test_batch_mc_by_hand():
    """State 0: G = 3, 4, 16; state 1: 4, 14. State 2 ends; 3 is not met."""
    close(batch_mc(PAIRS, 4, GAMMA, unvisited=5.0), [23 / 3, 9, 0, 5])
    with np.errstate(all="raise"):
        close(batch_mc(PAIRS, 4, GAMMA), [23 / 3, 9, 0, 0])
    close(batch_mc(PAIRS, 4, GAMMA, unvisited=5.0, each=True), [[3.5, 4, 0, 5], [23 / 3, 9, 0, 5]])
    V = batch_mc(PAIRS, 4, GAMMA, unvisited=5.0, alpha=0.1, tol=10.0, max_sweeps=1)  # 5 + 0.1 sum of (G - 5)
    close(V, [5 + 0.1 * (23 - 15), 5 + 0.1 * (18 - 10), 0, 5])


def test_batch_td_by_hand():
    """Steps 0 -> 1 (1), 1 -> 0 (2), 0 -> end (4), 1 -> 0 (6), 0 -> end (16), all from V = (2, 8)."""
    V = batch_td(PAIRS, 4, GAMMA, alpha=0.1, V0=[2.0, 8.0, 9.0, 3.0], tol=10.0, max_sweeps=1)
    close(V, [2 + 0.1 * (1 + 4 + 4 + 16 - 6), 8 + 0.1 * (2 + 1 + 6 + 1 - 16), 0, 3])
    close(batch_td(PAIRS, 4, GAMMA, alpha=0.1, tol=10.0, max_sweeps=1), [2.1, 0.8, 0, 0])
    close(batch_td(PAIRS, 4, GAMMA, tol=10.0, max_sweeps=1), [0.021, 0.008, 0, 0])  # alpha = 0.001 where none is given


def test_sweeps_stop_below_the_tolerance():
    """V = 1 - 2^-k after k sweeps of V += (1 - V) / 2; the k-th sweep changes V by 2^-k."""
    one = [([0, 1], [1.0])]
    for tol, V in ((0.13, 1 - 2**-3), (0.125, 1 - 2**-4)):
        for estimate in (batch_mc, batch_td):
            close(estimate(one, 2, 1.0, alpha=0.5, tol=tol, max_sweeps=4), [V, 0])
            with pytest.raises(ValueError, match="^max_sweeps: got 2, V still changes by 0.25"):
                estimate(one, 2, 1.0, alpha=0.5, tol=tol, max_sweeps=2)
    assert batch_td(one, 2, 1.0, alpha=0.5)[0] == 1 - 2.0**-34  # 2^-34 is the first below 1e-10
    for tol in (0, "small", None, [1.0]):
        with pytest.raises(ValueError, match="^tol: got "):
            batch_td(one, 2, 1.0, tol=tol)


def test_certainty_equivalence_by_hand():
    """From 0 to 1 in 1 of 3, mean reward 7; from 1 always to 0, mean reward 4: V0 = 7 + V1 / 6, V1 = 4 + V0 / 2."""
    V0 = (7 + 4 / 6) / (1 - 1 / 12)
    last = [V0, 4 + V0 / 2, 0, 5]
    close(certainty_equivalence(PAIRS, 4, GAMMA, unvisited=5.0), last)
    with np.errstate(all="raise"):
        close(certainty_equivalence(PAIRS, 4, GAMMA), [*last[:3], 0])
    W0 = (2.5 + 2 / 4) / (1 - 1 / 8)  # after one episode: from 0 to 1 in 1 of 2, mean reward 2.5
    close(certainty_equivalence(PAIRS, 4, GAMMA, unvisited=5.0, each=True), [[W0, 2 + W0 / 2, 0, 5], last])


@pytest.mark.parametrize(
    "episodes, message",
    [
        ([], r"got \[\], must be at least one"),
        (PAIRS + [([0, 1, 2], [1.0])], r"number 2 has \(3,\) states and \(1,\) rewards"),
        ([([0], [])], "number 0 has"),
        ([([0, 2], [[1.0]])], "number 0 has"),
        ([([0, 4], [1.0])], r"got states 4\.\.4, must be in 0\.\.3"),
        ([([4, 0], [1.0])], r"got states 4\.\.4, must be in 0\.\.3"),
        ([([-1, 0], [1.0])], r"got states -1\.\.-1, must be"),
        ([([0, -1], [1.0])], r"got states -1\.\.-1, must be"),
        ([([1, 0, -1], [1.0, 1.0])], r"got states -1\.\.0, must be"),
        ([([0, 1, 4], [1.0, 1.0])], r"got states 1\.\.4, must be"),
        ([([0, 1], [np.inf])], "contains (nan|inf), must be finite"),
        ([([0, 1, 2], [1.0, np.nan])], "contains (nan|inf), must be finite"),
        (PAIRS + [([2, 3], [1.0])], "one ends in state 2, another goes on from it"),
    ],
)
def test_bad_episodes(episodes, message):
    for estimate in (batch_mc, batch_td, certainty_equivalence):
        with pytest.raises(ValueError, match=f"^episodes: {message}"):
            estimate(episodes, 4, GAMMA)


@pytest.mark.parametrize("value", ["many", [1.0, 2.0], np.nan, None, True])
def test_bad_first_values(value):
    for estimate in (batch_mc, certainty_equivalence):
        with pytest.raises(ValueError, match="^unvisited: got .*, must be a finite number"):
            estimate(PAIRS, 4, GAMMA, unvisited=value)
    with pytest.raises(ValueError, match="^V0: contains nan, must be finite"):
        batch_td(PAIRS, 4, GAMMA, V0=[np.nan, 0, 0, 0])


# ---------------------------------------------------------------------- measures


def test_backups_of_value_iteration_in_two_seconds(monkeypatch):
    """One state that earns 1 - gamma = 0.1 for ever: sweep k changes V by 0.1 0.9^(k - 1), below 1e-3 when k = 45."""
    mdp, clock = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 0.1)]}), iter([10.0, 12.0])
    monkeypatch.setattr("rlcore.studies.ch02.time.perf_counter", lambda: next(clock))
    sweeps = value_iteration(mdp, 0.9, tol=1e-3).n_iter
    assert backups_per_second(mdp) == sweeps / 2 and sweeps == 45


def test_repeated_runs_have_generators_of_their_own():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(0.5, 0, 1.0), (0.5, 1, 2.0)]}, start=0, n_states=2)
    for seed in (0, 4):
        found = repeat(td0, mdp, np.ones((2, 1)), 0.5, 9, alpha=0.5, n_runs=3, rng=rng(seed))
        runs = [td0(mdp, np.ones((2, 1)), 0.5, 9, alpha=0.5, rng=g) for g in rng(seed).spawn(3)]
        assert [run.returns.tolist() for run in found] == [run.returns.tolist() for run in runs]
    with pytest.raises(ValueError, match="^n_runs"):
        repeat(td0, mdp, n_runs=0, rng=rng())
    with pytest.raises(ValueError, match="^rng: got 0, must be"):
        repeat(td0, mdp, n_runs=1, rng=0)


@pytest.mark.parametrize("V, truth", [(3.0, [1.0]), ([1.0, 2.0, 3.0], 2.0), ([1.0, 2.0, 3.0, 4.0], [1.0])])
def test_walks_that_do_not_fit(V, truth):
    with pytest.raises(ValueError, match="^V: got shape" if np.ndim(truth) else "^truth: got shape"):
        walk_error(V, truth)
    assert walk_error([9.0, 1.0, 2.0, 9.0], [4.0, 6.0]) == pytest.approx(12.5**0.5)


def test_squared_error_by_hand():
    """G = 3, 4, 4 against V = 1, 2, 1 in states 0, 1, 0."""
    pair = ([0, 1, 0, 2], [1.0, 2.0, 4.0])
    tau = Trajectory(np.array(pair[0]), np.zeros(3, int), np.array(pair[1]), True)
    for episode in (pair, tau):
        assert squared_error(np.array([1.0, 2.0, 9.0]), [episode] * 2, 0.5) == 2 * (4 + 4 + 9)


def test_first_updates_by_hand():
    """States 0, 1, 2 in a row, one action; rewards 2 and 4."""
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 2.0)], (1, 1): [(1.0, 2, 4.0)]}, start=0, n_states=3)
    rows = first_updates(q_learning, mdp, 0.5, 2, alpha=0.5, epsilon=0.0, rng=rng())
    assert rows == [(0, 0, 1, 0.0, 1.0), (1, 1, -1, 0.0, 2.0)] and rows[0]._fields == ("s", "a", "s_next", "old", "new")
    two = FiniteMDP.from_outcomes({(0, a): [(1.0, 0, 1.0 + a)] for a in range(9)})
    for seed in range(3):
        actions = [row.a for row in first_updates(sarsa, two, 0.5, 9, alpha=0.5, epsilon=1.0, rng=rng(seed))]
        assert len(set(actions)) > 3 and len(actions) == 9
    same, other = [rng(), rng()], rng(1)
    rows, again, different = (first_updates(sarsa, two, 0.5, 9, alpha=0.5, epsilon=1.0, rng=g) for g in (*same, other))
    assert rows == again != different
    assert first_updates(sarsa, two, 0.5, 9, alpha=0.5, epsilon=1.0, rng=same[0]) != rows, "rng has been drawn from"
    run, whole = rng(), same[1]
    sarsa(two, 0.5, 1, alpha=0.5, epsilon=1.0, max_steps=9, rng=run)
    assert run.bit_generator.state == whole.bit_generator.state, "as far as one run of n_steps draws"
    with pytest.raises(ValueError, match="^rng: got None, must be"):
        first_updates(sarsa, two, 0.5, 1, alpha=0.5, epsilon=0.5, rng=None)


def test_random_actions_by_hand():
    """epsilon = 1/2, two actions in state 0: 3/4 of the chosen one, 1/4 of the other; one action in state 1."""
    moves = {(0, 0): [(1.0, 1, 4.0)], (0, 1): [(1.0, 2, 8.0)], (1, 0): [(1.0, 0, 2.0)]}
    world = with_random_actions(FiniteMDP.from_outcomes(moves, start=[0.25, 0.75, 0.0], n_states=3), 0.5)
    close(world.transition_probs()[0], [[0, 0.75, 0.25], [0, 0.25, 0.75]])
    close(world.transition_probs()[1, 0], [1, 0, 0])
    close(world.expected_reward()[[0, 0, 1], [0, 1, 0]], [5, 7, 2])
    assert world.legal[:2].tolist() == [[True, True], [True, False]] and world.terminal.tolist() == [False, False, True]
    close(world.start, [0.25, 0.75, 0])
