"""The learners of returns.py and traces.py on episodes that are written down, against a few plain lines."""

from functools import partial

import numpy as np
import pytest
from test_td_exact import FIRST, LOOSE, ONE, SECOND, THIRD, Script, close, rng
from worlds import chain, loop

from rlcore.mdp import FiniteMDP
from rlcore.nstep import (
    complex_backup,
    error_reduction,
    forward_increments,
    lambda_return,
    lambda_returns,
    lambda_weights,
    n_step_return,
    n_step_td,
    offline_lambda_return,
)
from rlcore.policies import epsilon_greedy, soft_greedy
from rlcore.traces import (
    TRACES,
    backward_increments,
    credit,
    kept,
    sarsa_lambda,
    td_lambda,
    trace_course,
    trace_update,
    true_online_td_lambda,
    visit,
    watkins_q_lambda,
)

GAMMA, LAM, ALPHA = 0.5, 0.75, 0.25
FOURTH = ([0, 1, 0, 1, 2, 0, 1, 1], [1.0, -1.0, 2.0, 0.5, 4.0, -3.0, 2.0], "end")
EPISODES = [SECOND, FIRST, THIRD, LOOSE, FOURTH, FIRST]
KEEP = {"accumulating": 1.0, "dutch": 1 - ALPHA, "replacing": 0.0}
V0 = np.array([1.0, -2.0, 10.0])


def played(max_steps):
    """The episodes; without a limit, a cut one in the place of the one that only a limit stops."""
    return EPISODES if max_steps else [THIRD if episode is LOOSE else episode for episode in EPISODES]


def seen(max_steps, episodes=None):
    """(states, rewards, 1 or, at an end, 0) of each episode, cut at max_steps."""
    for states, rewards, way in episodes or played(max_steps):
        T = min(len(rewards), max_steps or 99)
        yield np.array(states[: T + 1]), np.array(rewards[:T]), float(way != "end" or len(rewards) > T)


def check_run(run, history, record, max_steps):
    close(run.V, history[-1])
    assert run.history is None if record == 0 else not close(run.history, history[::record])
    found = list(seen(max_steps))
    close(run.returns, [rewards.sum() for _, rewards, _ in found])
    assert run.lengths.tolist() == [rewards.size for _, rewards, _ in found] and run.Q is None
    np.testing.assert_array_equal(run.policy, ONE)


limits = pytest.mark.parametrize("max_steps", [2, 4, None])


def values_of(V, states, goes_on):
    values = V[states]
    values[-1] *= goes_on
    return values


@limits
@pytest.mark.parametrize("record", [1, 4, 0])
@pytest.mark.parametrize("online", [True, False])
@pytest.mark.parametrize("trace", TRACES)
def test_td_lambda_on_six_episodes(max_steps, record, online, trace):
    options = dict(alpha=ALPHA, trace=trace, online=online, V0=V0, max_steps=max_steps, record=record, rng=rng())
    run = td_lambda(Script(played(max_steps), 3), ONE, GAMMA, LAM, 6, **options)
    V, history = V0.copy(), [V0]
    for states, rewards, goes_on in seen(max_steps):
        e, old = np.zeros(3), V.copy()
        for t, r in enumerate(rewards):
            now = V if online else old
            delta = r + GAMMA * values_of(now, states[: t + 2], goes_on if t == rewards.size - 1 else 1)[-1]
            delta -= now[states[t]]
            e *= GAMMA * LAM
            e[states[t]] = KEEP[trace] * e[states[t]] + 1
            V = V + ALPHA * delta * e
        history.append(V)
    check_run(run, history, record, max_steps)


def test_td_lambda_by_hand():
    """gamma lam = 1/4, alpha = 1/2, V = (0, 1, 7); states 0, 1, 0, end.

    Time 0: delta = 1 + 1/2, e = (1, 0), V = (3/4, 1). Time 1: delta = 2 + 3/8 - 1 = 11/8, e = (1/4, 1),
    V = (59/64, 27/16). Time 2: delta = 4 - 59/64 = 197/64, e = (17/16, 1/4).
    Off line: deltas 3/2, 1, 4 with e = (1, 0), (1/4, 1), (17/16, 1/4): 1/2 (3/2 + 1/4 + 17/4), 1/2 (1 + 1).
    """
    options = dict(alpha=0.5, V0=[0.0, 1.0, 7.0], record=1, rng=rng())
    run = td_lambda(Script([FIRST], 3), ONE, 0.5, 0.5, 1, **options)
    close(run.V, [59 / 64 + 197 / 128 * 17 / 16, 27 / 16 + 197 / 128 / 4, 7])
    close(run.history, [[0, 1, 7], run.V])
    run = td_lambda(Script([FIRST], 3), ONE, 0.5, 0.5, 1, online=False, **options)
    close(run.V, [3, 2, 7])
    run = td_lambda(Script([FIRST], 3), ONE, 0.5, 0.5, 1, alpha=0.5, online=False, rng=rng())
    close(run.V, [(1 + 0.5 + 4.25) / 2, (2 + 1) / 2, 0])  # from V = 0: deltas 1, 2, 4


@limits
@pytest.mark.parametrize("record", [1, 4, 0])
@pytest.mark.parametrize("lam", [0.0, 0.75, 1.0])
def test_true_online_td_lambda_on_six_episodes(max_steps, record, lam):
    """Its V at the end of an episode is that of all lambda-returns, each from the V of its own time."""
    options = dict(alpha=ALPHA, V0=V0, max_steps=max_steps, record=record, rng=rng())
    run = true_online_td_lambda(Script(played(max_steps), 3), ONE, GAMMA, lam, 6, **options)
    history = [V0]
    for states, rewards, goes_on in seen(max_steps):
        tables = [history[-1]]
        for h in range(1, rewards.size + 1):
            worth = [tables[k - 1][states[k]] * (goes_on if k == rewards.size else 1) for k in range(1, h + 1)]
            V = history[-1].copy()
            for t in range(h):
                L = worth[h - 1]
                for k in range(h - 1, t - 1, -1):
                    L = rewards[k] + GAMMA * ((1 - lam) * worth[k] + lam * L)
                V[states[t]] += ALPHA * (L - V[states[t]])
            tables.append(V)
        history.append(tables[-1])
    check_run(run, history, record, max_steps)


def test_true_online_td_lambda_by_hand():
    """gamma lam = 1/4, alpha = 1/2, V = (0, 1, 7); states 0, 1, 0, end.

    Time 0: V(0) = 1/2 (1 + 1/2) = 3/4. Redone at time 1 with V_1(0) = 3/4 for the end: L_1 = 2 + 3/8, so that
    L_0 = 1 + 1/2 (1/2 + 1/2 L_1) = 59/32, V = (59/64, 27/16).
    """
    options = dict(alpha=0.5, V0=[0.0, 1.0, 7.0], record=1, rng=rng())
    run = true_online_td_lambda(Script([FIRST], 3), ONE, 0.5, 0.5, 1, max_steps=1, **options)
    close(run.V, [0.75, 1, 7])
    run = true_online_td_lambda(Script([FIRST], 3), ONE, 0.5, 0.5, 1, max_steps=2, **options)
    close(run.V, [59 / 64, 27 / 16, 7])
    # L_2 = 4; L_1 = 2 + 1/2 (1/2 3/4 + 2) = 51/16; L_0 = 1 + 1/2 (1/2 + 51/32) = 131/64; V(0): 131/128, then 643/256
    run = true_online_td_lambda(Script([FIRST], 3), ONE, 0.5, 0.5, 1, **options)
    close(run.V, [643 / 256, 67 / 32, 7])
    assert run.history.shape == (2, 3)


@limits
@pytest.mark.parametrize("record", [1, 4, 0])
@pytest.mark.parametrize("online", [True, False])
@pytest.mark.parametrize("n", [1, 2, 3, 9])
def test_n_step_td_on_six_episodes(max_steps, record, online, n):
    options = dict(alpha=ALPHA, online=online, V0=V0, max_steps=max_steps, record=record, rng=rng())
    run = n_step_td(Script(played(max_steps), 3), ONE, GAMMA, n, 6, **options)
    V, history = V0.copy(), [V0]
    for states, rewards, goes_on in seen(max_steps):
        old, T = V.copy(), rewards.size
        for t in range(T):  # the last n increments come together when the episode is over
            h, now = min(t + n, T), V if online else old
            G = sum(GAMMA ** (k - t) * rewards[k] for k in range(t, h))
            G += GAMMA ** (h - t) * now[states[h]] * (goes_on if h == T else 1)
            V[states[t]] += ALPHA * (G - now[states[t]])
        history.append(V.copy())
    check_run(run, history, record, max_steps)


def test_n_step_td_by_hand():
    """n = 2, V = (0, 1, 7): G_0 = 1 + 1 + 0 = 2, V(0) = 1; then G_1 = 2 + 2 = 4, V(1) = 5/2; G_2 = 4, V(0) = 5/2."""
    run = n_step_td(Script([FIRST], 3), ONE, 0.5, 2, 1, alpha=0.5, V0=[0.0, 1.0, 7.0], record=1, rng=rng())
    close(run.history, [[0, 1, 7], [2.5, 2.5, 7]])
    close(n_step_td(Script([FIRST], 3), ONE, 0.5, 2, 1, alpha=0.5, online=False, rng=rng()).V, [3, 2, 0])


@limits
@pytest.mark.parametrize("record", [1, 4, 0])
@pytest.mark.parametrize("reading", ["in order", "summed", "recomputed"])
def test_offline_lambda_return_on_six_episodes(max_steps, record, reading):
    options = dict(alpha=ALPHA, reading=reading, V0=V0, max_steps=max_steps, record=record, rng=rng())
    run = offline_lambda_return(Script(played(max_steps), 3), ONE, GAMMA, LAM, 6, **options)
    V, history = V0.copy(), [V0]
    for states, rewards, goes_on in seen(max_steps):
        old = V.copy()
        for t in range(rewards.size):
            values = values_of(V if reading == "recomputed" else old, states, goes_on)
            L = values[-1]
            for k in reversed(range(t, rewards.size)):
                L = rewards[k] + GAMMA * ((1 - LAM) * values[k + 1] + LAM * L)
            V[states[t]] += ALPHA * (L - (old if reading == "summed" else V)[states[t]])
        history.append(V.copy())
    check_run(run, history, record, max_steps)


def test_offline_lambda_return_by_hand():
    """V = (0, 1, 7): L_2 = 4, L_1 = 2 + 1/2 (0 + 2) = 3, L_0 = 1 + 1/2 (1/2 + 3/2) = 2; V(0) = 1, 5/2, V(1) = 2."""
    options = dict(alpha=0.5, V0=[0.0, 1.0, 7.0], record=1, rng=rng())
    run = offline_lambda_return(Script([FIRST], 3), ONE, 0.5, 0.5, 1, **options)
    close(run.history, [[0, 1, 7], [2.5, 2, 7]])
    close(offline_lambda_return(Script([FIRST], 3), ONE, 0.5, 0.5, 1, reading="summed", **options).V, [3, 2, 7])
    # recomputed after V(0) = 1: L_1 = 2 + 1/2 (1/2 + 2) = 13/4
    run = offline_lambda_return(Script([FIRST], 3), ONE, 0.5, 0.5, 1, reading="recomputed", **options)
    close(run.V, [2.5, 17 / 8, 7])


@pytest.mark.parametrize("reading", ["in order", "recomputed"])
def test_offline_lambda_return_on_long_episodes(reading):
    """There is room for 64 steps at first, then for twice as many."""
    g = rng(3)
    lengths = (63, 64, 65, 127, 128, 129) + (254, 255, 256, 257, 300) * (reading == "in order")
    episodes = [(g.integers(9, size=n + 1).tolist(), g.normal(size=n).tolist(), "end") for n in lengths]
    options = dict(alpha=0.5, reading=reading, V0=1.0, rng=rng())
    run = offline_lambda_return(Script(episodes, 9), np.ones((9, 1)), 0.9, 0.8, len(lengths), **options)
    V = np.ones(9)
    for states, rewards, _ in episodes:
        states, rewards = np.array(states), np.array(rewards)
        L = lambda_return(rewards, V[states[:-1]], 0.9, 0.8)
        for t in range(rewards.size):
            if reading == "recomputed":
                L = lambda_return(rewards, V[states[:-1]], 0.9, 0.8)
            V[states[t]] += 0.5 * (L[t] - V[states[t]])
    close(run.V, V)


# ---------------------------------------------------------------------- control

Q0 = np.array([[1.0, -2.0], [3.0, 3.5], [10.0, 12.0]])


def control(world, cut, n_episodes, max_steps, lam, trace, epsilon, g):
    """(history, cuts, pairs after a cut) of SARSA(lambda), or with `cut` of Watkins's Q(lambda), over whole tables."""
    Q, history, cuts = Q0.copy(), [Q0], []
    world.reset(seed=0)
    for _ in range(n_episodes):
        (s, _), t, since, over, e = world.reset(), 0, 0, False, np.zeros((3, 2))
        a = epsilon_greedy(Q, s, epsilon, g)
        while not over:
            s_next, r, terminated, truncated, _ = world.step(a)
            a_next = epsilon_greedy(Q, s_next, epsilon, g)
            explores = Q[s_next, a_next] < Q[s_next].max()
            value = Q[s_next].max() if cut else Q[s_next, a_next]
            delta = r + (0 if terminated else GAMMA * value) - Q[s, a]
            e[s, a] = KEEP[trace] * e[s, a] + 1
            Q = Q + ALPHA * delta * e
            e *= 0 if cut and explores else GAMMA * lam
            t, since = t + 1, since + 1
            if explores:
                cuts.append(since)
                since = 0
            s, a, over = s_next, a_next, terminated or truncated or t == max_steps
        history.append(Q)
    return np.array(history), cuts


@pytest.mark.parametrize("learn", [sarsa_lambda, watkins_q_lambda])
@pytest.mark.parametrize("trace", TRACES)
@limits
@pytest.mark.parametrize("lam", [0.0, 0.75])
def test_control_on_eighteen_episodes(learn, trace, max_steps, lam):
    episodes = played(max_steps) * 3
    world, cut = Script(episodes, 3, 2), learn is watkins_q_lambda
    history, cuts = control(world, cut, 18, max_steps, lam, trace, 0.5, rng(3))
    actions = world.actions
    for record in (1, 4, 0):
        options = dict(alpha=ALPHA, epsilon=0.5, trace=trace, Q0=Q0, max_steps=max_steps, record=record, rng=rng(3))
        run = learn(world, GAMMA, lam, 18, **options)
        assert world.actions == actions
        close(run.Q, history[-1])
        close(run.V, history[-1].max(axis=1))
        close(run.policy, soft_greedy(history[-1], 0.5))
        assert run.history is None if record == 0 else not close(run.history, history[::record])
        found = list(seen(max_steps, episodes))
        close(run.returns, [rewards.sum() for _, rewards, _ in found])
        assert run.lengths.tolist() == [rewards.size for _, rewards, _ in found]
        if cut:
            assert run.cuts.tolist() == cuts and len(cuts) > 5 and run.cuts.dtype == np.int64
    assert max_steps == 2 or len(set(cuts)) > 1


@pytest.mark.parametrize("learn", [sarsa_lambda, watkins_q_lambda])
def test_control_by_hand(learn):
    """One action: as in the hand-computed TD(lambda)."""
    options = dict(alpha=0.5, epsilon=0.1, Q0=[[0.0], [1.0], [7.0]], record=1, rng=rng())
    run = learn(Script([FIRST], 3), 0.5, 0.5, 1, **options)
    close(run.Q[:, 0], [59 / 64 + 197 / 128 * 17 / 16, 27 / 16 + 197 / 128 / 4, 7])
    assert run.history.shape == (2, 3, 1) and run.returns.tolist() == [7] and run.lengths.tolist() == [3]
    close(learn(Script([FIRST], 3), 0.5, 0.0, 1, alpha=0.5, epsilon=0.1, rng=rng()).Q[:, 0], [2.25, 1.125, 0])


def test_cuts_of_a_long_run_are_all_kept():
    """More than 256."""
    g = rng(5)
    episodes = [(g.integers(2, size=701).tolist(), [0.0] * 700, "end")]
    counts = []
    for n_episodes, Q in ((1, [[1.0, 0.0], [1.0, 0.0]]), (1, [[1.0, 1.0], [1.0, 1.0]])):
        world = Script(episodes, 2, 2)
        run = watkins_q_lambda(world, 1.0, 0.9, n_episodes, alpha=1e-9, epsilon=1.0, Q0=Q, rng=rng())
        explores = [t for t, a in enumerate(world.actions[0]) if a == 1 and t > 0]
        counts.append(run.cuts.size)
        if counts[0] == run.cuts.size:  # the action drawn at the end may explore, too
            assert run.cuts[: len(explores)].tolist() == np.diff([0, *explores]).tolist()
            assert 256 < len(explores) <= run.cuts.size <= len(explores) + 1
    assert counts[1] < 400


@pytest.mark.parametrize("learn", [sarsa_lambda, watkins_q_lambda])
def test_no_limit_is_needed_where_random_actions_end_every_episode(learn):
    """Three states and two actions of which not all are legal."""
    stay = {(0, 0): [(1.0, 2, 1.0)], (0, 1): [(1.0, 0, 0.0)], (1, 1): [(1.0, 2, 0.0)]}
    mdp = FiniteMDP.from_outcomes(stay, start=0, n_states=3)
    assert learn(mdp, 0.5, 0.5, 2, alpha=0.5, epsilon=0.5, rng=rng()).returns.tolist() == [1, 1]
    trap = FiniteMDP.from_outcomes(stay | {(0, 1): [(1.0, 1, 0.0)], (1, 1): [(1.0, 1, 0.0)]}, start=0, n_states=3)
    with pytest.raises(ValueError, match="^max_steps: got None"):
        learn(trap, 0.5, 0.5, 2, alpha=0.5, epsilon=0.5, rng=rng())


LEARNERS = [partial(f, pi=ONE, lam=0.5, alpha=0.5) for f in (td_lambda, true_online_td_lambda, offline_lambda_return)]
LEARNERS += [partial(n_step_td, pi=ONE, n=2, alpha=0.5)]
LEARNERS += [partial(f, lam=0.5, alpha=0.5, epsilon=0.5) for f in (sarsa_lambda, watkins_q_lambda)]


@pytest.mark.parametrize("learn", LEARNERS)
def test_results_are_arrays(learn):
    run = learn(Script([FIRST] * 2, 3), gamma=0.5, n_episodes=2, record=1, rng=rng())
    assert run.lengths.dtype == np.int64 and run.returns.dtype == run.history.dtype == run.policy.dtype == np.float64
    assert run.policy.shape == (3, 1) and run.returns.shape == run.lengths.shape == (2,)
    assert run.V.shape == (3,) and len(run.history) == 3


@pytest.mark.parametrize("learn", [td_lambda, true_online_td_lambda, sarsa_lambda, watkins_q_lambda])
def test_traces_that_become_0_while_all_are_listed(learn):
    """gamma = 1e-200: two steps later a trace is 0, and V(s) has gone half of the way to the reward, each time."""
    episode = ([0, 1, 2, 0, 1, 2, 2, 0, 1], [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0], "end")
    options = dict(pi=ONE) if learn in (td_lambda, true_online_td_lambda) else dict(epsilon=0.0)
    run = learn(Script([episode] * 2, 3), gamma=1e-200, lam=1.0, n_episodes=2, alpha=0.5, rng=rng(), **options)
    V = np.zeros(3)
    for s, r in [*zip(episode[0], episode[1])] * 2:
        V[s] += (r - V[s]) / 2
    close(run.V, V)


# ---------------------------------------------------------------------- targets and traces

REWARDS, VALUES = [1.0, 2.0, 4.0], [8.0, 16.0, 32.0, 64.0]


def test_returns_by_hand():
    """gamma = 1/2. Cut: the last value is 64; ended: 0."""
    one, two, three = [9, 18, 36], [1 + 1 + 8, 2 + 2 + 16, 36], [1 + 1 + 1 + 8, 20, 36]
    for n, G in ((1, one), (2, two), (3, three), (7, three)):
        close(n_step_return(REWARDS, VALUES, 0.5, n), G)
        assert [n_step_return(REWARDS, VALUES, 0.5, n, t) for t in range(3)] == G
        assert isinstance(n_step_return(REWARDS, VALUES, 0.5, n, 0), float)
    close(n_step_return(REWARDS, VALUES[:3], 0.5, 2), [10, 4, 4])
    close(n_step_return(REWARDS, VALUES[:3], 0.5, 1), [9, 18, 4])
    close(complex_backup(REWARDS, VALUES, 0.5, {1: 0.25, 3: 0.75}), np.array(one) / 4 + 0.75 * np.array(three))
    close(complex_backup(REWARDS, VALUES, 0.5, {2: 1}), two)
    close(lambda_return(REWARDS, VALUES, 0.5, 0.25), [1 + (12 + 18.5 / 4) / 2, 2 + (24 + 36 / 4) / 2, 36])


def test_lambda_returns_are_0_before_the_first_that_is_asked_for():
    found = [lambda_returns(np.array(REWARDS), np.array(VALUES), 0.5, 0.25, first).tolist() for first in (1, 2)]
    assert found == [[0, 18.5, 36], [0, 0, 36]]


def test_weights_by_hand():
    close(lambda_weights(3, 0.25), [0.75, 0.1875, 0.0625])
    close(lambda_weights(1, 0.25), [1])
    with pytest.raises(ValueError, match="^T_minus_t"):
        lambda_weights(0, 0.25)
    with pytest.raises(ValueError, match="^t: "):
        n_step_return(REWARDS, VALUES, 0.5, 1, 3)


def test_error_reduction_by_hand():
    """Chain 0 -> 1 -> 2 -> end with rewards 1, 2, 4: v_pi = (3, 4, 4, 0) at gamma = 1/2. v is 8 above, in state 1."""
    mdp, v = chain([1.0, 2.0, 4.0]), [3.0, 12.0, 4.0, 0.0]
    pi = np.ones((4, 1))
    close(error_reduction(mdp, pi, v, 1, 0.5), (4, 4))
    close(error_reduction(mdp, pi, v, 2, 0.5), (0, 2))
    close(error_reduction(mdp, pi, [3.0, 4.0, 12.0, 0.0], 2, 0.5), (2, 2))
    close(error_reduction(mdp, pi, [3.0, 4.0, -4.0, 0.0], 2, 0.5), (2, 2))
    close(error_reduction(mdp, pi, [3.0, 4.0, 12.0, 0.0], {1: 0.25, 2: 0.75}, 0.5), (1.5, 0.25 * 4 + 0.75 * 2))
    # printed: r + gamma r' + gamma^2 v(next state), from v_pi: 2 + 1, 4 + 1, 4 + 0 against 3, 4, 4
    close(error_reduction(mdp, pi, [3.0, 4.0, 4.0, 0.0], 2, 0.5, printed=True), (1, 0))
    ring = loop(1.0, 3)
    close(error_reduction(ring, np.ones((3, 1)), 0.0, 3, 0.5), (0.25, 0.25))  # v = 0 against 2


def test_increments_by_hand():
    """States 0, 1, 0; V = (8, 16); gamma = 1/2, lam = 1/2, alpha = 1/2. Cut in state 1, or ended."""
    states, rewards, V = [0, 1, 0, 1], [1.0, 2.0, 4.0], [8.0, 16.0]
    L = [1 + 0.5 * (8 + 0.5 * 7), 2 + 0.5 * (4 + 6), 12]
    close(forward_increments(states, rewards, V, 0.5, 0.5, 0.5), [[(L[0] - 8) / 2, 0], [0, (L[1] - 16) / 2], [2, 0]])
    deltas = np.array([1 + 8 - 8, 2 + 4 - 16, 4 + 8 - 8])
    for trace, e in (("accumulating", 17 / 16), ("dutch", 33 / 32), ("replacing", 1)):
        E = np.array([[1, 0], [0.25, 1], [e, 0.25]])
        close(backward_increments(states, rewards, V, 0.5, 0.5, 0.5, trace), 0.5 * deltas[:, None] * E)
        ended = backward_increments(states[:3], rewards, V, 0.5, 0.5, 0.5, trace)
        close(ended, 0.5 * (deltas - [0, 0, 8])[:, None] * E)
    close(forward_increments(states[:3], rewards, V, 0.5, 0.5, 0.5)[2], [-2, 0])
    assert forward_increments([0], [1.0], [0.0, 0.0, 0.0], 0.5, 0.5, 0.5).shape == (1, 3)


@pytest.mark.parametrize("states", [[0, 1], [0, 1, 0, 1, 0], [0, 1, 2], [0, -1, 0], [[0, 1, 0]]])
def test_states_that_do_not_fit(states):
    for increments in (forward_increments, backward_increments):
        with pytest.raises(ValueError, match="^states: got"):
            increments(states, [1.0, 2.0, 4.0], [8.0, 16.0], 0.5, 0.5, 0.5)


def test_trace_update_by_hand():
    e, here = [4.0, 4.0, 0.0], [1, 0, 1]
    for kind, expected in (
        ("accumulating", [3, 2, 1]),
        ("dutch", [2.5, 2, 1]),
        ("replacing", [1, 2, 1]),
        ("dutch as printed", [2.5, 1.5, 1]),
    ):
        close(trace_update(e, here, 0.5, kind, 0.25), expected)
        close(trace_update(4.0, 1, 0.5, kind, 0.25), expected[0])
    assert [kept(kind, 0.25) for kind in TRACES] == [1, 0.75, 0]
    close(trace_course([0, 2], 4, 0.5, "dutch", 0.5), [1, 0.5, 1.125, 0.5625])
    close(trace_course([3], 4, 0.5, "replacing"), [0, 0, 0, 1])
    for wrong in ([4], [-1]):
        with pytest.raises(ValueError, match=r"^visits: got .* must be times in 0\.\.3"):
            trace_course(wrong, 4, 0.5, "replacing")
    with pytest.raises(ValueError, match="^kind: got 'x', allowed are 'accumulating', 'dutch', 'replacing', 'dutch as"):
        trace_update(4.0, 1, 0.5, "x", 0.25)
    for learn in (td_lambda, sarsa_lambda, watkins_q_lambda):
        options = dict(pi=np.ones((2, 1))) if learn is td_lambda else dict(epsilon=0.5)
        with pytest.raises(ValueError, match="^trace: got 'x', allowed are 'accumulating', 'dutch', 'replacing'$"):
            learn(chain([1.0]), gamma=0.5, lam=0.5, n_episodes=1, alpha=0.5, trace="x", rng=rng(), **options)
    with pytest.raises(ValueError, match="^trace: got 'x', allowed are 'accumulating', 'dutch', 'replacing'$"):
        backward_increments([0], [1.0], [0.0], 0.5, 0.5, 0.5, "x")


def test_the_list_of_traces_holds_each_state_once():
    """Also one whose trace has become 0 while it is listed."""
    e, live, V = np.zeros(3), np.zeros(4, np.int64), np.zeros(3)
    n = visit(e, live, 0, 2, 1.0)
    n = visit(e, live, n, 0, 1.0)
    assert n == 2 and live[:2].tolist() == [2, 0] and e.tolist() == [1, 0, 1]
    assert credit(V, e, live, n, 3.0, 0.5) == 2 and V.tolist() == [3, 0, 3] and e.tolist() == [0.5, 0, 0.5]
    n = visit(e, live, n, 2, 0.5)
    assert n == 2 and e.tolist() == [0.5, 0, 1.25]
    e[2] = 0.0
    n = visit(e, live, n, 2, 1.0)
    assert n == 2 and live[:2].tolist() == [2, 0] and e[2] == 1.0
    e[0] = 0.0
    assert visit(e, live, n, 0, 1.0) == 2 and visit(e, live, n, 1, 1.0) == 3 and live[:3].tolist() == [2, 0, 1]
    assert credit(V, e, live, 3, 0.0, 0.0) == 0 and e.tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    "rewards, values, message",
    [
        ([], [], r"rewards: got shape \(0,\)"),
        ([[1.0, 2.0]], [1.0, 2.0], r"rewards: got shape \(1, 2\)"),
        ([1.0, np.inf], [1.0, 2.0], "rewards: contains inf, must be finite"),
        ([1.0, 2.0], [1.0, np.nan], "values: contains nan, must be finite"),
        ([1.0, 2.0], [1.0], r"values: got shape \(1,\), must be \(2,\) or \(3,\)"),
        ([1.0, 2.0], [1.0] * 4, r"values: got shape \(4,\)"),
        ([1.0, 2.0], [[1.0, 2.0]], r"values: got shape \(1, 2\)"),
    ],
)
def test_episodes_that_do_not_fit(rewards, values, message):
    for target in (lambda: n_step_return(rewards, values, 0.5, 1), lambda: lambda_return(rewards, values, 0.5, 0.5)):
        with pytest.raises(ValueError, match=f"^{message}"):
            target()


@pytest.mark.parametrize("weights", [{1: 0.5, 2: 0.4}, {1: 0.5, 2: 0.6}, {1: 1 + 1e-6}, {}, 1])
def test_weights_that_do_not_fit(weights):
    with pytest.raises(ValueError, match="^weights: "):
        complex_backup([1.0], [1.0], 0.5, weights)


def test_cuts_of_more_episodes_follow_those_of_fewer():
    """The cuts of 300 episodes begin with those of 30, and each lies within its episode."""
    outcomes = {(0, 0): [(0.9, 0, 1.0), (0.1, 1, 0.0)], (0, 1): [(0.9, 0, 0.0), (0.1, 1, 0.0)]}
    mdp = FiniteMDP.from_outcomes(outcomes)
    few, many = (watkins_q_lambda(mdp, 0.9, 0.5, n, alpha=0.5, epsilon=0.4, rng=rng(0)) for n in (30, 300))
    assert few.cuts.size < 128 < many.cuts.size and many.cuts.min() >= 1
    np.testing.assert_array_equal(many.cuts[: few.cuts.size], few.cuts)
    assert many.cuts.sum() <= many.lengths.sum()


def test_one_wrong_number_among_right_ones_is_refused():
    with pytest.raises(ValueError, match=r"^visited: got \[0, 2\], must be True or False"):
        trace_update([0.5, 0.5], [0, 2], 0.9, "accumulating")
    with pytest.raises(ValueError, match=r"visits: got .*must be times in 0\.\.3"):
        trace_course([1, 4], 4, 0.9, "accumulating")
    for alpha in (0, 1.5, None):
        with pytest.raises(ValueError, match="alpha"):
            trace_update(0.5, 1, 0.9, "dutch as printed", alpha)
