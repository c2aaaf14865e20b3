"""Runs that end, or can be ended: caps, estimates that are lost, Ctrl-C, callbacks, bars."""

import importlib.util
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from test_learners import LEARNERS, play
from worlds import awkward

import rlcore.core.running as running
from rlcore.actor_critic import actor_critic, actor_critic_network
from rlcore.core.compiled import HAVE_NUMBA
from rlcore.core.learner import note, shorter
from rlcore.core.results import Run
from rlcore.core.running import LOST, STOPPED, Interrupted, Watch
from rlcore.core.worlds import MOST_STEPS
from rlcore.dp import policy_evaluation, policy_iteration, value_iteration
from rlcore.envs import MDPEnv, cliff_walking, gridworld, random_mdp, random_walk, recycling_robot
from rlcore.judging import evaluate
from rlcore.mdp import FiniteMDP, sample_returns
from rlcore.monte_carlo import mc_prediction
from rlcore.planning import dyna_q
from rlcore.reinforce import reinforce, reinforce_network
from rlcore.solver import solve
from rlcore.td import q_learning, td0
from rlcore.traces import sarsa_lambda

ROOT = Path(__file__).parents[1]
STAY = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 0.0)], (0, 1): [(1.0, 1, -1.0)]})


def rng(seed=0):
    return np.random.default_rng(seed)


# ---------------------------------------------------------------------- every episode ends


def test_an_episode_that_nothing_ends_is_cut():
    """Greedy play stays where staying costs nothing."""
    said = r"^max_steps: got None, and 3 of 3 episodes did not end in 1,000,000 steps: cut there$"
    with pytest.warns(RuntimeWarning, match=said) as found:
        run = q_learning(STAY, 1.0, 3, alpha=0.5, epsilon=0.0, Q0=[[0.0, -1.0], [0.0, 0.0]], rng=rng())
    assert found[0].filename == __file__
    assert run.lengths.tolist() == [MOST_STEPS] * 3
    with pytest.raises(ValueError, match="^max_steps: got None, must be a number"):
        dyna_q(recycling_robot(), 0.9, 2, n_planning=1, alpha=0.1, epsilon=0.1, rng=rng())


class Endless(gym.Env):
    """One state, no end; `slow`: seconds a step."""

    observation_space, action_space, slow = gym.spaces.Discrete(2), gym.spaces.Discrete(2), 0.0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return 0, {}

    def step(self, action):
        time.sleep(self.slow)
        return 0, 1.0, False, False, {}


class Line(Endless):
    """The same, seen as a number."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 1.0, False, False, {}


@pytest.mark.parametrize(
    "play",
    [
        lambda **options: q_learning(Endless(), 0.9, 2, alpha=0.5, epsilon=0.1, **options),
        lambda **options: actor_critic_network(Line(), 0.9, 2, **options),
        lambda **options: reinforce_network(Line(), 0.9, 2, **options),
        lambda **options: evaluate(lambda s: 0, Line(), 2, **options),
    ],
    ids=["table", "actor-critic", "reinforce", "evaluate"],
)
def test_an_environment_that_nothing_ends_is_cut(play, monkeypatch):
    for module in ("core.worlds", "actor_critic", "reinforce", "judging"):
        monkeypatch.setattr(f"rlcore.{module}.MOST_STEPS", 1000)
    with pytest.warns(RuntimeWarning, match="^max_steps: got None, and 2 of 2 episodes did not end") as found:
        run = play(rng=rng())
    assert run.lengths.tolist() == [1000, 1000]
    assert (found[0].filename, found[0].lineno) == (__file__, play.__code__.co_firstlineno)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert play(max_steps=7, rng=rng()).lengths.tolist() == [7, 7]


# ---------------------------------------------------------------------- estimates that are lost


@pytest.mark.parametrize("world", [cliff_walking(), MDPEnv(cliff_walking())], ids=["process", "environment"])
def test_what_diverges_says_when(world):
    options = dict(alpha=0.9, epsilon=0.1, max_steps=2000, rng=rng())
    with pytest.raises(ValueError, match=r"^alpha: got 0.9, must be smaller: .* in episode \d+, step \d+ or before"):
        sarsa_lambda(world, 1.0, 0.95, 1000, trace="accumulating", **options)


@pytest.mark.parametrize("kind", [lambda mdp: mdp, MDPEnv], ids=["process", "environment"])
def test_rewards_that_doubles_cannot_add_say_so(kind):
    """An error where actions are to be chosen by the estimates, or during a run; else, at its end, a warning."""
    mdp = FiniteMDP.from_outcomes({(0, 0): [(0.9, 0, 1e308), (0.1, 1, 1e308)], (0, 1): [(1.0, 1, -1e308)]})
    options, said = dict(gamma=1.0, alpha=0.5, max_steps=200), "are no finite numbers any more in episode"
    with np.errstate(all="ignore"):
        with pytest.raises(ValueError, match=f"^alpha: got 0.5, .*{said}"):
            q_learning(kind(mdp), n_episodes=50, epsilon=0.1, rng=rng(), **options)
        with pytest.warns(RuntimeWarning, match=f"^alpha: got 0.5, .*{said}") as found:
            assert not np.isfinite(td0(kind(mdp), [[1.0, 0.0]] * 2, n_episodes=9, rng=rng(), **options).V).all()
    assert found[0].filename == __file__


@pytest.mark.parametrize("kind", [lambda mdp: mdp, MDPEnv], ids=["process", "environment"])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_returns_that_doubles_cannot_hold_are_the_rewards_fault(kind):
    mdp, pi = FiniteMDP.from_outcomes({(0, 0): [(0.5, 0, 1e308), (0.5, 1, 1e308)]}), np.ones((2, 1))
    message = "^world: its rewards must be smaller, as their sum is no finite number any more"
    told = ValueError, RuntimeWarning
    with np.errstate(all="ignore"):
        for play in (partial(mc_prediction, kind(mdp), pi, 1.0), partial(evaluate, pi, kind(mdp))):
            with pytest.raises(told, match=message + r" in episode \d+, step \d+ or before"):
                play(n_episodes=50, rng=rng())
        with pytest.raises(told, match=message + "$"):
            sample_returns(mdp, pi, 1.0, 50, s=0, max_steps=99, rng=rng())


def test_the_notes_of_a_compiled_loop():
    """Kept every `record` episodes; a part of the table is looked at every 64, all of it in the end."""
    world, history, table = SimpleNamespace(marks=np.zeros(2, int)), np.zeros((3, 600)), np.arange(600.0)
    assert not note(world, history, table, 0, 2) and not history.any() and world.marks.tolist() == [0, 1]
    assert not note(world, history, table, 1, 2) and world.marks.tolist() == [0, 2]
    np.testing.assert_array_equal(history, [np.zeros(600), table, np.zeros(600)])
    looked_at = {63: range(256), 127: range(256, 512), 191: range(512, 600), 255: range(168, 424)}
    for place in (0, 167, 168, 255, 256, 423, 424, 511, 512, 599):
        for k in range(256):
            table, world.marks[:] = np.zeros(600), 0
            table[place] = np.nan if k % 2 else np.inf
            lost = place in looked_at.get(k, ())
            assert note(world, history, table, k, 0) == lost == (world.marks[0] == LOST)
    world.marks[0] = STOPPED
    assert note(world, history, np.zeros(600), 0, 0)


def test_a_run_that_was_stopped_is_shorter():
    run = Run(np.array([1.0, 2.0, 3.0, 0.0]), np.array([4, 5, 6, 0]), Q=np.eye(2), history=np.arange(5.0))
    for interrupted in (True, False):
        short = shorter(run, dict(record=1), interrupted=interrupted)
        assert short.returns.tolist() == [1.0, 2.0, 3.0] and short.lengths.tolist() == [4, 5, 6]
        assert short.history.tolist() == [0.0, 1.0, 2.0, 3.0] and short.interrupted is interrupted
    assert shorter(run, dict(record=2), interrupted=True).history.tolist() == [0.0, 1.0]
    assert shorter(Run(run.returns, run.lengths), dict(record=0), interrupted=True).history is None


def test_what_diverges_softly_says_so_too():
    with pytest.raises(ValueError, match="^alpha, alpha_w: got|^alpha: got"), np.errstate(all="ignore"):
        actor_critic(random_walk(5), 1.0, 200, alpha=1e300, alpha_w=1e300, max_steps=100, rng=rng())


def explode(world, **options):
    options = dict(alpha=0.7, epsilon=0.1, max_steps=200, rng=rng()) | options
    return sarsa_lambda(world, 1.0, 0.95, 20, trace="accumulating", **options)


@pytest.mark.parametrize("world", [cliff_walking(), MDPEnv(cliff_walking())], ids=["process", "environment"])
def test_what_grows_beyond_every_return_says_so(world):
    """Finite, -2e13: a step costs 100 at most."""
    with pytest.warns(
        RuntimeWarning, match=r"^alpha: got 0.7, must be smaller: an estimate is .*e\+13, and no"
    ) as told:
        run = explode(world)
    assert f"beyond {100.0 * run.lengths.sum():.3g}" in str(told[0].message) and told[0].filename == __file__
    with pytest.warns(RuntimeWarning, match="and no return is beyond 1e"):
        explode(world, Q0=-1e10, alpha=0.9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        explode(world, alpha=0.1)
        explode(world, alpha=0.1, Q0=-1e13)
        sarsa_lambda(world, 0.9999, 0.9, 20, alpha=0.1, epsilon=0.1, Q0=-9e6, max_steps=100, rng=rng())


def test_a_value_that_grows_beyond_every_return_says_so():
    with pytest.warns(RuntimeWarning, match=r"^alpha_w: got 2.5, must be smaller: an estimate is .*, and no return"):
        actor_critic(random_walk(5), 0.5, 10, alpha=1e-9, alpha_w=2.5, max_steps=100, rng=rng(1))


# ---------------------------------------------------------------------- Ctrl-C


def soon(seconds=0.5, episodes=-1):
    """A signal as Ctrl-C sends it, in a while, when more than so many episodes have ended."""

    def send():
        time.sleep(seconds)
        while episodes >= 0 and not ((watch := running._ear(os.getpid()).watch) and watch.marks[1] > episodes):
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=send, daemon=True).start()


@pytest.mark.parametrize("name", LEARNERS)
def test_a_compiled_loop_hears_ctrl_c(name):
    if not HAVE_NUMBA:
        pytest.skip("nothing is compiled")
    mdp = awkward(start=0)
    whole = play(name, mdp, 50, record=10)  # compiled before the clock runs
    soon(episodes=60)
    with pytest.raises(Interrupted) as stopped:
        play(name, mdp, 10**7, record=10**5)
    run = stopped.value.run
    n = run.returns.size
    assert run.interrupted and 50 < n < 10**7 and run.lengths.size == n and run.lengths.min() >= 1
    assert len(run.history) == 1 + n // 10**5 and "interrupted" in repr(run)
    np.testing.assert_array_equal(run.returns[:50], whole.returns)
    assert not whole.interrupted and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert signal.set_wakeup_fd(-1) == -1


def test_a_stopped_run_is_the_run_of_fewer_episodes():
    """But for the last episode, which is cut where the signal came."""
    mdp, options = cliff_walking(), dict(alpha=0.1, epsilon=0.1)
    q_learning(mdp, 0.9, 1, rng=rng(), **options)
    soon(episodes=1)
    with pytest.raises(Interrupted) as stopped:
        q_learning(mdp, 0.9, 10**7, rng=rng(), **options)
    run = stopped.value.run
    again = q_learning(mdp, 0.9, run.returns.size, rng=rng(), **options)
    np.testing.assert_array_equal(run.returns[:-1], again.returns[:-1])
    assert run.lengths[-1] <= again.lengths[-1] and np.abs(run.Q - again.Q).max() < 1


@pytest.mark.parametrize(("max_steps", "told"), [(10**9, None), (3 * 10**6, lambda G, n: None)])
def test_an_endless_episode_hears_ctrl_c(max_steps, told):
    """Compiled, and, with someone to tell, interpreted."""
    options = dict(alpha=0.1, on_episode=told, rng=rng())
    td0(STAY, [[1.0, 0.0], [1.0, 0.0]], 0.9, 1, max_steps=1, **options)
    soon()
    with pytest.raises(Interrupted) as stopped:
        td0(STAY, [[1.0, 0.0], [1.0, 0.0]], 0.9, 1, max_steps=max_steps, **options)
    assert 1 < stopped.value.run.lengths[0] < max_steps


def test_an_environment_hears_ctrl_c_and_is_left_as_it_was():
    env = Endless()
    env.slow = 0.001
    soon(episodes=1)
    with pytest.raises(Interrupted) as stopped:
        q_learning(env, 0.9, 10**6, alpha=0.5, epsilon=0.1, max_steps=100, rng=rng())
    assert stopped.value.run.returns.size >= 1
    assert stopped.value.run.lengths[:-1].tolist() == [100] * (stopped.value.run.lengths.size - 1)
    assert env._np_random is None


@pytest.mark.parametrize("agent", [np.full((48, 4), 0.25), lambda s: 0], ids=["compiled", "interpreted"])
def test_evaluate_leaves_the_episodes_that_ended(agent):
    env = Endless()
    env.slow = 0.001
    world, options = (cliff_walking(), {}) if isinstance(agent, np.ndarray) else (env, dict(max_steps=10))
    whole = evaluate(agent, world, 3, rng=rng(), **options)
    soon(2.0 if callable(agent) else 0.5)
    with pytest.raises(Interrupted) as stopped:
        evaluate(agent, world, 10**5, rng=rng(), **options)
    found = stopped.value.run
    assert 3 <= found.returns.size == found.lengths.size < 10**5 and found.lengths.min() >= 10
    np.testing.assert_array_equal(found.returns[:3], whole.returns)
    assert found.mean == found.returns.mean() and found.interval[0] <= found.mean <= found.interval[1]


def test_a_second_ctrl_c_does_not_wait():
    env = Endless()
    env.slow = 60.0
    soon(0.3)
    soon(0.6)
    with pytest.raises(KeyboardInterrupt) as stopped:
        q_learning(env, 0.9, 2, alpha=0.5, epsilon=0.1, rng=rng())
    assert not isinstance(stopped.value, Interrupted)


def test_what_leaves_no_run_is_stopped_too():
    pi = np.array([[1.0, 0.0], [1.0, 0.0]])
    options = dict(s=0, rng=rng())
    sample_returns(STAY, pi, 0.9, 1, max_steps=1, **options)
    soon()
    with pytest.raises(KeyboardInterrupt):
        sample_returns(STAY, pi, 0.9, 1000, max_steps=10**9, **options)


def wheel(n):
    """n states around; each step goes on, or stays, at even odds; only state 0 pays. Slow to forget where it was."""
    s = np.arange(n)
    next_state = np.stack((np.stack(((s + 1) % n, s), 1), np.stack(((s - 1) % n, s), 1)), 1)
    reward = np.zeros((n, 2, 2))
    reward[0] = 1.0
    everywhere = np.ones((n, 2), bool), np.zeros(n, bool), np.full(n, 1 / n)
    return FiniteMDP(next_state, np.full((n, 2, 2), 0.5), reward, *everywhere)


WALK = FiniteMDP.from_outcomes(  # gains in a loop at gamma = 1, out of which it can go
    {(s, 0): [(1.0, (s + 1) % 2000, 1.0)] for s in range(2000)} | {(s, 1): [(1.0, 2000, 0.0)] for s in range(2000)}
)
ENDLESS = dict(tol=1e-300, max_iter=10**9)
PLANNERS = {  # a short run, for the compiler, and a long one
    "solve": (lambda: solve(wheel(9), 0.9), lambda: solve(wheel(8_000), 1 - 1e-7, 1e-300)),
    "solve, undiscounted": (lambda: solve(gridworld(), 1.0), lambda: solve(WALK, 1.0)),
    "value_iteration": (lambda: value_iteration(wheel(9), 0.9), lambda: value_iteration(wheel(9), 1 - 1e-9, **ENDLESS)),
    "policy_evaluation": (
        lambda: policy_evaluation(wheel(9), UNIFORM, 0.9),
        lambda: policy_evaluation(wheel(9), UNIFORM, 1 - 1e-9, **ENDLESS, record=2),
    ),
}
UNIFORM = np.full((9, 2), 0.5)


@pytest.mark.parametrize("name", PLANNERS)
def test_planning_hears_ctrl_c(name):
    if not HAVE_NUMBA:
        pytest.skip("nothing is compiled")
    short, long = PLANNERS[name]
    short()
    soon()
    with pytest.raises(Interrupted) as stopped:
        long()
    found = stopped.value.run
    assert not found.converged and found.n_iter >= 1 and np.isfinite(found.V).all()
    if name == "solve":
        other = solve(wheel(8_000), 1 - 1e-7, 1e3)
        assert np.abs(found.V - other.V).max() <= found.bound + other.bound < np.inf
    if name == "value_iteration":
        again = value_iteration(wheel(9), 1 - 1e-9, tol=1e-300, max_iter=found.n_iter)
        np.testing.assert_array_equal(found.V, again.V)
    if name == "policy_evaluation":
        assert len(found.history) == 1 + found.n_iter // 2
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("plan", [
    lambda: solve(DENSE, 0.99, 1e-300), lambda: solve(wheel(9), 0.99, 1e-300), lambda: policy_iteration(wheel(9), 0.99),
    lambda: policy_iteration(DENSE, 0.99), lambda: value_iteration(gridworld(), 1.0), lambda: solve(gridworld(), 1.0),
])  # fmt: skip
def test_what_planning_is_stopped_with_is_certified(plan, monkeypatch):
    """As if Ctrl-C came before all else."""
    monkeypatch.setattr(Watch, "__init__", lambda watch, *_, init=Watch.__init__: init(watch) or watch.stop())
    with pytest.raises(Interrupted) as stopped:
        plan()
    monkeypatch.undo()
    found, whole = stopped.value.run, plan()
    assert not found.converged and found.n_iter < whole.n_iter
    assert np.abs(found.V - whole.V).max() <= found.bound + whole.bound


DENSE = random_mdp(100, 3, rng=rng())


def test_a_handler_of_the_users_own_stays():
    heard = []
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(1))
    try:
        q_learning(STAY, 0.9, 2, alpha=0.5, epsilon=0.1, rng=rng())
        os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [1]


def test_other_threads_learn_too():
    found = []
    options = dict(alpha=0.1, epsilon=0.1)
    threads = [
        threading.Thread(target=lambda: found.append(q_learning(cliff_walking(), 0.9, 200, rng=rng(), **options)))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    here = q_learning(cliff_walking(), 0.9, 200, rng=rng(), **options)
    for thread in threads:
        thread.join()
    for run in found:
        np.testing.assert_array_equal(run.Q, here.Q)


# ---------------------------------------------------------------------- callbacks


@pytest.mark.parametrize("name", LEARNERS)
@pytest.mark.parametrize("world", [awkward(start=0), MDPEnv(awkward(start=0))], ids=["process", "environment"])
def test_a_callback_is_told_and_changes_nothing(name, world):
    seen = []
    plain, run = play(name, world, 7), play(name, world, 7, on_episode=lambda G, n: seen.append((G, n)))
    for field in ("returns", "lengths", "V", "Q", "visits"):
        np.testing.assert_array_equal(getattr(plain, field), getattr(run, field))
    assert seen == list(zip(run.returns.tolist(), np.cumsum(run.lengths).tolist())) and not run.interrupted


@pytest.mark.parametrize("name", LEARNERS)
def test_a_callback_may_end_the_run(name):
    mdp = awkward(start=0)
    run = play(name, mdp, 9, record=2, on_episode=lambda G, n: True)
    short = play(name, mdp, 1, record=2)
    np.testing.assert_array_equal(run.returns, short.returns)
    assert run.lengths.size == 1 and len(run.history) == 1 and not run.interrupted
    np.testing.assert_array_equal(run.policy, short.policy)


def test_linear_learners_have_callbacks():
    for learn in (reinforce, actor_critic):
        seen = []
        run = learn(random_walk(5), 0.9, 4, on_episode=lambda G, n, seen=seen: seen.append(n), rng=rng())
        assert seen == np.cumsum(run.lengths).tolist()


def test_a_callback_that_is_none_is_refused():
    with pytest.raises(ValueError, match="^on_episode: got 3, must be a function of"):
        q_learning(STAY, 0.9, 2, alpha=0.5, epsilon=0.1, on_episode=3, rng=rng())


# ---------------------------------------------------------------------- bars

BAR = """
import sys
import numpy as np
import rlcore.core.running as running
from rlcore.envs import cliff_walking
from rlcore.td import q_learning
running.PATIENCE = float(sys.argv[1])
running.PAUSE = 0.05
for n in (1, 3_000_000):
    q_learning(cliff_walking(), 0.9, n, alpha=0.1, epsilon=0.1, on_episode=None, rng=np.random.default_rng(0))
"""


needs_tqdm = pytest.mark.skipif(importlib.util.find_spec("tqdm") is None, reason="tqdm is not installed")


@pytest.mark.long
@needs_tqdm
@pytest.mark.parametrize("patience, notes, shown", [(0.3, "1", True), (1e6, "1", False), (0.3, "0", False)])
def test_a_bar_where_a_run_is_long_and_somebody_looks(patience, notes, shown):
    env = {**os.environ, "RLCORE_NOTES": notes}
    command = [sys.executable, "-c", BAR, str(patience)]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=True)
    assert ("/3000000" in done.stderr) == shown and done.stdout == ""


@needs_tqdm
def test_a_bar_counts_to_its_end(monkeypatch, capsys):
    monkeypatch.setenv("RLCORE_NOTES", "1")
    watch = Watch(10)
    watch.show(3)
    assert capsys.readouterr().err == ""
    watch.start -= 3
    watch.show(3)
    watch.show(12)
    assert watch.bar.n == 10
    bar = watch.bar
    watch.marks[:] = 8, 7  # why it ends, how many have ended
    watch.show()
    assert watch.bar is bar and bar.n == 7 and type(bar.n) is int
    assert watch.bar.unit == " episodes" and not watch.bar.leave
    watch.close()
    watch.show(4)
    assert "3/10" in capsys.readouterr().err


def test_no_bar_where_its_package_is_missing(monkeypatch, capsys):
    monkeypatch.setenv("RLCORE_NOTES", "1")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    watch = Watch(10)
    watch.start -= 3
    watch.show(3)
    assert watch.bar is None and not watch.wanted and capsys.readouterr().err == ""


def test_a_watch_counts_episodes_and_says_how_a_run_ended():
    watch, run = Watch(9), Run(np.zeros(2), np.ones(2, int))
    assert not watch.ended([1.0, 2.0], [3, 4], None) and watch.marks.tolist() == [0, 2] and not watch.asked
    assert not watch.ended([1.0], [3], lambda G, steps: (G, steps) != (1.0, 3)) and watch.left(run) is run
    assert watch.ended([1.0, 2.0], [3, 4], lambda G, steps: (G, steps) == (2.0, 7)) and watch.asked
    assert watch.left(run) is run  # on_episode ended it, not Ctrl-C
    watch = Watch()
    watch.stop()
    with pytest.raises(Interrupted) as found:
        watch.left(run)
    assert found.value.run.interrupted and watch.asked
