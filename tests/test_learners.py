"""What all tabular learners share: records, schedules, environments by their id, counts of visits, one TD error."""

import inspect
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from worlds import awkward

from rlcore.core.results import Run
from rlcore.core.schedules import at, decaying, now
from rlcore.envs import MDPEnv, random_walk
from rlcore.mdp import FiniteMDP, uniform_policy
from rlcore.monte_carlo import constant_alpha_mc, mc_prediction
from rlcore.nstep import n_step_td, offline_lambda_return
from rlcore.planning import dyna_q
from rlcore.studies.ch02 import td0_groups
from rlcore.td import expected_sarsa, q_learning, sarsa, td0, td_error, td_target
from rlcore.traces import TRACES, sarsa_lambda, td_lambda, true_online_td_lambda, watkins_q_lambda

same = np.testing.assert_array_equal
# alpha counts the updates of a state or pair, or the episodes
BY_VISIT = {
    "constant_alpha_mc": constant_alpha_mc,
    "first-visit constant_alpha_mc": partial(constant_alpha_mc, first_visit=True),
    "td0": td0,
    "td0_groups": td0_groups,
    "sarsa under pi": partial(sarsa, epsilon=None),
    "sarsa": sarsa,
    "expected_sarsa": expected_sarsa,
    "q_learning": q_learning,
    "dyna_q without planning": partial(dyna_q, n_planning=0),
    "dyna_q": partial(dyna_q, n_planning=3),
}
BY_EPISODE = {"true_online_td_lambda": partial(true_online_td_lambda, lam=0.7)}
for _online in (True, False):
    BY_EPISODE[f"n_step_td {_online}"] = partial(n_step_td, n=3, online=_online)
    for _kind in TRACES:
        BY_EPISODE[f"td_lambda {_kind} {_online}"] = partial(td_lambda, lam=0.7, trace=_kind, online=_online)
for _kind in TRACES:
    BY_EPISODE[f"sarsa_lambda {_kind}"] = partial(sarsa_lambda, lam=0.7, trace=_kind)
    BY_EPISODE[f"watkins_q_lambda {_kind}"] = partial(watkins_q_lambda, lam=0.7, trace=_kind)
for _reading in ("in order", "summed", "recomputed"):
    BY_EPISODE[f"offline_lambda_return {_reading}"] = partial(offline_lambda_return, lam=0.7, reading=_reading)
MEANS = {
    "first-visit mc_prediction": mc_prediction,
    "mc_prediction": partial(mc_prediction, first_visit=False),
    "first-visit mc_prediction of pairs": partial(mc_prediction, target="q"),
    "mc_prediction of pairs": partial(mc_prediction, first_visit=False, target="q"),
}
LEARNERS = MEANS | BY_VISIT | BY_EPISODE
CONTROL = [name for name, learn in LEARNERS.items() if "epsilon" in inspect.signature(learn).parameters]
CONTROL.remove("sarsa under pi")


def rng(seed=0):
    return np.random.default_rng(seed)


def play(name, world, n_episodes=6, *, first=None, alpha=0.3, epsilon=0.4, seed=1, **options):
    """The Run of a learner; first: where its estimates begin."""
    learn = LEARNERS[name]
    names = inspect.signature(learn).parameters
    env = gym.make(world) if isinstance(world, str) else world
    model = getattr(getattr(env, "unwrapped", env), "mdp", env)
    if isinstance(model, FiniteMDP):
        pi = uniform_policy(model)
    else:
        pi = np.full((env.observation_space.n, env.action_space.n), 1 / env.action_space.n)
    if "alpha" in names:
        options["alpha"] = alpha
    if name in CONTROL:
        options["epsilon"] = epsilon
    elif "pi" in names:
        options["pi"] = pi
    if "groups" in names:
        options["groups"] = np.arange(len(pi)) // 2
    if first is not None:
        options[next(n for n in ("V0", "Q0", "w0") if n in names)] = first
    generator = rng(seed) if isinstance(seed, int) else seed
    return learn(world, gamma=0.9, n_episodes=n_episodes, rng=generator, **options)


def table(run):
    return run.V if run.Q is None else run.Q


def equal(one, two, *without):
    """The same bits in every field."""
    for field in vars(one):
        if field not in without:
            a, b = getattr(one, field), getattr(two, field)
            assert (a is None) == (b is None)
            assert a == b if isinstance(a, FiniteMDP) else same(a, b) is None


every_learner = pytest.mark.parametrize("name", LEARNERS)


# ---------------------------------------------------------------------- records


@every_learner
@pytest.mark.parametrize("world", [awkward(start=0), MDPEnv(awkward(start=0))], ids=["process", "environment"])
def test_what_is_kept_changes_nothing(name, world):
    full, thin, none = (play(name, world, 7, record=k) for k in (1, 3, 0))
    plain = play(name, world, 7)
    same(full.history[::3], thin.history)
    same(full.history[-1], table(full))
    assert len(full.history) == 8 and none.history is None and plain.history is None
    for run in (thin, none, plain):
        equal(full, run, "history")


@every_learner
def test_a_record_longer_than_the_run_keeps_the_first_estimates(name):
    mdp = random_walk(5)
    run = play(name, mdp, 3, record=4)
    same(run.history, [np.zeros_like(table(run))])
    assert table(run).any()


@every_learner
def test_a_run_is_shown_in_one_line(name):
    run = play(name, random_walk(5), 3, record=1)
    text = repr(run)
    assert text.startswith(f"{type(run).__name__}(3 episodes, {run.lengths.sum():,} steps, ") and len(text) < 200
    assert f"history {run.history.shape}" in text and f"policy {run.policy.shape}" in text and "None" not in text
    assert (f"V {run.V.shape}" in text) if run.V is not None else ("V (" not in text)


def test_what_a_run_holds_is_named():
    run = Run(np.zeros(2), np.array([1000, 234]), V=object(), weights=np.zeros((2, 3)))
    assert repr(run) == "Run(2 episodes, 1,234 steps, V object, weights (2, 3))"


# ---------------------------------------------------------------------- schedules


@pytest.mark.parametrize("floor", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("power", [0.0, 0.6, 1.0, 3.0])
def test_a_schedule_falls_to_its_floor(floor, power):
    schedule = decaying(0.3, rate=0.7, power=power, floor=floor)
    values = [at(schedule, n) for n in range(200)]
    np.testing.assert_allclose(values, [max(floor, 0.3 / (1 + 0.7 * n) ** power) for n in range(200)], rtol=1e-14)
    assert min(values) >= floor and values[0] == 0.3 and values == sorted(values, reverse=True)
    assert at(schedule, 10**9) == (0.3 if power == 0 else max(floor, 0.3 / (1 + 0.7e9) ** power))
    for per_step in (False, True):
        schedule = decaying(0.3, rate=0.7, power=power, floor=floor, per_step=per_step)
        assert now(schedule, 5, 70) == values[70 if per_step else 5]


def test_a_floor_above_the_first_value_is_refused():
    with pytest.raises(ValueError, match=r"^floor: got 0.5, must be at most first, 0.1"):
        decaying(0.1, rate=0.0, floor=0.5)
    assert at(decaying(0.5, rate=0.0, floor=0.5), 7) == 0.5


@pytest.mark.parametrize("name", BY_VISIT | BY_EPISODE)
@pytest.mark.parametrize("world", [awkward(start=0), MDPEnv(awkward(start=0))], ids=["process", "environment"])
def test_a_schedule_of_rate_0_is_a_number(name, world):
    plain = play(name, world, record=1)
    for per_step in (False, True):
        epsilon = decaying(0.4, rate=0.0, per_step=per_step)
        equal(plain, play(name, world, alpha=decaying(0.3, rate=0.0), epsilon=epsilon, record=1))
    equal(plain, play(name, world, alpha=decaying(0.3, power=0.0), epsilon=decaying(0.4, power=0.0), record=1))
    equal(plain, play(name, world, alpha=decaying(0.3, floor=0.3), epsilon=decaying(0.4, floor=0.4), record=1))
    assert not np.array_equal(table(plain), table(play(name, world, alpha=decaying(0.3))))


@pytest.mark.parametrize("name", BY_EPISODE)
@pytest.mark.parametrize("max_steps", [400, 4])
def test_an_episode_has_one_step_size(name, max_steps):
    """Thirty episodes with a falling alpha and epsilon are thirty runs of one, each with numbers of its own."""
    mdp, g, cuts = awkward(start=0), rng(3), []
    first = found = rng(4).normal(size=mdp.legal.shape if name in CONTROL else 7)
    alpha, epsilon = decaying(0.8, rate=0.5, power=0.7, floor=0.25), decaying(0.9, rate=0.2, floor=0.5)
    run = play(name, mdp, 30, first=first, alpha=alpha, epsilon=epsilon, max_steps=max_steps, seed=3, record=1)
    sizes = [max(0.25, 0.8 / (1 + 0.5 * k) ** 0.7) for k in range(30)]
    assert sizes[8] > sizes[9] == 0.25
    for k, size in enumerate(sizes):
        options = dict(alpha=size, epsilon=max(0.5, 0.9 / (1 + 0.2 * k)), max_steps=max_steps)
        one = play(name, mdp, 1, first=found, seed=g, **options)
        found = np.where(np.isfinite(table(one)), table(one), 0.0)
        np.testing.assert_allclose(run.history[k + 1], table(one), rtol=1e-13, atol=1e-13)
        assert one.lengths[0] == run.lengths[k]
        cuts.extend(getattr(one, "cuts", []))
    if "watkins" in name:
        assert run.cuts.tolist() == cuts and len(cuts) > 2


@pytest.mark.parametrize("name", CONTROL)
@pytest.mark.parametrize("per_step", [False, True])
def test_when_epsilon_falls(name, per_step):
    """Random at n = 0, greedy from then on: for the first of two episodes, or for the first action only."""
    mdp = FiniteMDP.from_outcomes({(0, a): [(1.0, 0, 2.0 + a)] for a in range(2)})
    epsilon, seen = decaying(1.0, rate=1e9, power=9, per_step=per_step), []
    for seed in range(8):
        env = Log(mdp)
        play(name, env, 2, first=[[2.0, 9.0]], alpha=1e-9, epsilon=epsilon, max_steps=30, seed=seed)
        seen.append([a for _, a, _, _ in env.steps])
    seen = np.array(seen)
    later = 31 if "sarsa_lambda" in name or "watkins" in name or name == "sarsa" else 30  # a' is chosen a step before
    assert seen[:, later:].all() and seen[:, 1:30].all() == per_step and not seen[:, 0].all()


# ---------------------------------------------------------------------- environments


@every_learner
@pytest.mark.parametrize("mdp", [awkward(start=0), random_walk(5)], ids=["awkward", "walk"])
def test_an_environment_gives_the_bits_of_its_process(name, mdp):
    options = dict(alpha=decaying(0.9, rate=0.2), epsilon=decaying(0.9, rate=0.01, per_step=True), record=2)
    run = play(name, mdp, **options)
    equal(run, play(name, MDPEnv(mdp), **options))
    equal(run, play(name, gym.wrappers.TimeLimit(MDPEnv(mdp), 10**6), **options))


@every_learner
@pytest.mark.parametrize("id", ["FrozenLake-v1", "CliffWalking-v1"])
def test_an_environment_may_be_named_by_its_id(name, id):
    options = dict(max_steps=60, record=1)
    by_id, by_hand = play(name, id, 5, **options), play(name, gym.make(id), 5, **options)
    equal(by_id, by_hand)
    assert by_id.lengths.max() <= 60 and np.isfinite(table(by_id)).all()
    with pytest.raises(ValueError, match="^world: got 'FrozenPond-v1', must be a FiniteMDP, an environment or its id"):
        LEARNERS[name](**play_arguments(name, "FrozenPond-v1"))


def play_arguments(name, world):
    """Arguments that are good but for the world."""
    names = inspect.signature(LEARNERS[name]).parameters
    good = dict(world=world, gamma=0.9, n_episodes=1, alpha=0.3, pi=np.ones((1, 1)), groups=[0], epsilon=0.1, rng=rng())
    return {key: value for key, value in good.items() if key in names and not (key == "pi" and "epsilon" in names)}


@every_learner
def test_an_environment_without_numbers_for_states_is_refused(name):
    for world in ("CartPole-v1", gym.make("Blackjack-v1"), 3, None):
        with pytest.raises(ValueError, match="^world: got .*, must be a FiniteMDP or a gymnasium.Env with Discrete"):
            LEARNERS[name](**play_arguments(name, world))


def test_worlds_and_results_that_no_memory_holds(monkeypatch):
    huge = gym.wrappers.TransformObservation(MDPEnv(random_walk(3)), lambda s: s, gym.spaces.Discrete(2**40))
    with pytest.raises(ValueError, match="^world: needs an array of 1099511627776 x 1 numbers, must be at most"):
        q_learning(huge, 1.0, 3, alpha=0.1, epsilon=0.1, rng=rng())

    def full(*args, **options):
        raise MemoryError

    monkeypatch.setattr("rlcore.core.learner.run_loop", full)
    with pytest.raises(MemoryError, match="^n_episodes, record, max_steps: got 1000, 1, 99, must keep less"):
        td0(random_walk(3), np.ones((5, 1)), 1.0, 1000, alpha=0.1, record=1, max_steps=99, rng=rng())


# ---------------------------------------------------------------------- visits


class Log(MDPEnv):
    """Remembers (episode, a, s, s') of every step."""

    def __init__(self, mdp):
        super().__init__(mdp)
        self.k, self.steps = -2, []  # a run resets once before its first episode

    def reset(self, **options):
        self.k += 1
        return super().reset(**options)

    def step(self, a):
        s, found = self.s, super().step(a)
        self.steps.append((self.k, int(a), s, self.s))
        return found


@pytest.mark.parametrize("name", MEANS | BY_VISIT)
def test_visits_are_counted(name):
    env = Log(awkward(start=0))
    run = play(name, env, 40)
    pairs = run.visits.ndim == 2
    rows = [(k, (s, a) if pairs else s) for k, a, s, _ in env.steps]
    if "first" in name:
        rows = list(dict.fromkeys(rows))
    expected = np.zeros(run.visits.shape, int)
    for _, x in rows:
        expected[(x // 2 if name == "td0_groups" else x)] += 1
    if name == "dyna_q":
        assert run.visits.sum() == 4 * run.lengths.sum() and (run.visits >= expected).all()
        same(run.visits > 0, expected > 0)
    else:
        same(run.visits, expected)
    assert run.visits.dtype == np.int64 and run.visits.max() > 9
    assert pairs == (run.Q is not None) and len(env.steps) == run.lengths.sum()


@pytest.mark.parametrize("name", BY_EPISODE)
def test_step_sizes_that_fall_with_the_episodes_count_no_visits(name):
    assert play(name, awkward(start=0)).visits is None


@pytest.mark.parametrize("name", MEANS)
def test_visits_make_the_averages(name):
    """The average moves by 1 / N: constant-alpha with 1 / N gives the same, and as many visits."""
    mdp = awkward(start=0)
    run = play(name, mdp, 40)
    if run.V is not None:
        other = "first-visit constant_alpha_mc" if "first" in name else "constant_alpha_mc"
        falls = play(other, mdp, 40, alpha=decaying(1.0))
        same(run.visits, falls.visits)
        np.testing.assert_allclose(run.V, falls.V, rtol=1e-12, atol=1e-12)
    else:
        assert (run.Q[run.visits == 0][mdp.legal[run.visits == 0]] == 0).all() and run.visits[~mdp.legal].sum() == 0


# ---------------------------------------------------------------------- the loop is the function


@pytest.mark.parametrize(
    "learn",
    [td0, sarsa, expected_sarsa, q_learning, dyna_q, td0_groups, td_lambda, true_online_td_lambda, sarsa_lambda,
     watkins_q_lambda],
)  # fmt: skip
def test_the_loop_updates_by_the_td_error_of_the_page(learn):
    body = inspect.unwrap(learn.loop)
    assert "td_error" in body.__code__.co_names and body.__globals__["td_error"] is td_error
    for r, V, V_next, terminated in rng().normal(size=(20, 4)):
        error = td_target(r, V_next, 0.9, terminated > 0) - V
        assert (
            td_error(r, V, V_next, 0.9, terminated > 0)
            == td_error.unchecked(r, V, V_next, 0.9, terminated > 0)
            == error
        )


@pytest.mark.parametrize("name", LEARNERS)
def test_the_loop_has_the_arguments_and_the_lines_of_the_function(name):
    learn = getattr(LEARNERS[name], "func", LEARNERS[name])
    body, source = inspect.unwrap(learn.loop), inspect.unwrap(learn)
    names = list(inspect.signature(learn).parameters)
    assert names[0] == "world" and names[-1] == "rng" and names == list(inspect.signature(body).parameters)
    code, written = body.__code__, source.__code__
    assert (code.co_code, code.co_firstlineno) == (written.co_code, written.co_firstlineno)
    assert learn.__doc__ == source.__doc__


@every_learner
def test_what_is_given_is_not_changed(name):
    mdp, names = awkward(start=0), inspect.signature(LEARNERS[name]).parameters
    V0, Q0, pi = np.ones(7), np.ones(mdp.legal.shape), uniform_policy(mdp)
    before = pi.copy()
    options = dict(world=mdp, gamma=0.9, n_episodes=6, alpha=0.3, V0=V0, Q0=Q0, pi=pi, groups=[0] * 7, epsilon=0.4)
    if "epsilon" in names:
        del options["epsilon" if name == "sarsa under pi" else "pi"]
    LEARNERS[name](**{key: value for key, value in options.items() if key in names}, rng=rng())
    assert (V0 == 1).all() and (Q0 == 1).all() and mdp == awkward(start=0)
    same(pi, before)


@every_learner
def test_no_limit_of_steps_is_only_for_episodes_that_end(name):
    moves = {(0, 0): [(1.0, 1, 1.0)], (1, 0): [(1.0, 0, 1.0)], (2, 0): [(1.0, 3, 0.0)]}
    endless = FiniteMDP.from_outcomes(moves, start=0)
    with pytest.raises(ValueError, match="^max_steps: got None, must be a number because some episode under pi never"):
        play(name, endless)
    assert (play(name, endless, max_steps=7).lengths == 7).all()
