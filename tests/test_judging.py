"""Evaluation of agents: what they earn, how sure that is, curves over seeds, films."""

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image
from worlds import awkward

import rlcore.judging as judging
from rlcore.bellman import solve_policy
from rlcore.core.agents import ActorCritic
from rlcore.core.results import Run
from rlcore.dp import value_iteration
from rlcore.envs import MDPEnv, cliff_walking, random_walk
from rlcore.judging import evaluate, film, interquartile_mean, learning_curve
from rlcore.mdp import uniform_policy
from rlcore.nn import MLP
from rlcore.ppo import PPOConfig, ppo
from rlcore.td import q_learning


def rng(seed=0):
    return np.random.default_rng(seed)


class Shifted(gym.Env):
    """States 5 and 6, actions 3 and 4: action 4 earns 1 in state 5, action 3 in state 6; two steps."""

    observation_space, action_space = gym.spaces.Discrete(2, start=5), gym.spaces.Discrete(2, start=3)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.s = 5
        return self.s, {}

    def step(self, action):
        r = float(action == (4 if self.s == 5 else 3))
        self.s += 1
        return min(self.s, 6), r, self.s == 7, False, {}


# ---------------------------------------------------------------------- evaluate


def test_the_mean_return_is_the_value():
    mdp = awkward(start=0)
    pi = uniform_policy(mdp)
    value = solve_policy(mdp, pi, 1.0)[0]
    found = evaluate(pi, mdp, 20_000, rng=rng())
    assert abs(found.mean - value) < 4 * found.returns.std() / np.sqrt(20_000)
    assert found.interval[0] < found.mean < found.interval[1] and found.lengths.min() >= 1


def test_an_environment_gives_the_bits_of_its_process():
    mdp = awkward(start=0)
    one, two = (evaluate(uniform_policy(mdp), world, 20, rng=rng()) for world in (mdp, MDPEnv(mdp)))
    np.testing.assert_array_equal(one.returns, two.returns)
    assert (one.mean, one.interval, one.iqm, one.iqm_interval) == (two.mean, two.interval, two.iqm, two.iqm_interval)


def test_intervals_cover_as_often_as_they_say():
    """Of 300 intervals, each of 20 returns, 95 % hold the mean: 285 +- 4 * 3.8."""
    mdp = random_walk(5)
    pi = uniform_policy(mdp)
    value = solve_policy(mdp, pi, 1.0)[3]
    held = [low <= value <= high for g in rng(1).spawn(300) for low, high in [evaluate(pi, mdp, 20, rng=g).interval]]
    assert 265 <= sum(held) <= 300


def test_results_stand_for_their_policy():
    mdp = cliff_walking()
    plan = value_iteration(mdp, 1.0)
    run = q_learning(mdp, 1.0, 500, alpha=0.5, epsilon=0.1, rng=rng())
    assert evaluate(plan, mdp, 3, rng=rng()).returns.tolist() == [-13.0] * 3
    assert evaluate(run, mdp, 3, likeliest=True, rng=rng()).returns.tolist() == [-13.0] * 3
    sampled = evaluate(run, mdp, 50, rng=rng())
    assert sampled.mean < -13 and sampled.returns.std() > 0
    np.testing.assert_array_equal(sampled.returns, evaluate(run.policy, mdp, 50, rng=rng()).returns)


def test_a_policy_of_single_precision_is_what_it_rounds():
    mdp = random_walk(5)
    pi = np.full((7, 1), np.float32(1) + np.finfo(np.float32).eps)
    exact, rounded = (evaluate(pi, mdp, 20, rng=np.random.default_rng(0)) for pi in (np.ones((7, 1)), pi))
    assert np.array_equal(exact.returns, rounded.returns)
    with pytest.raises(ValueError, match="^agent: row 0"):
        evaluate(pi.astype(float), mdp, 20, rng=np.random.default_rng(0))


def test_spaces_may_start_anywhere():
    assert evaluate([[0.0, 1.0], [1.0, 0.0]], Shifted(), 3, rng=rng()).returns.tolist() == [2.0] * 3
    assert evaluate(lambda s: 4 if s == 5 else 3, Shifted(), 3, rng=rng()).returns.tolist() == [2.0] * 3
    assert q_learning(Shifted(), 0.9, 200, alpha=0.5, epsilon=0.2, rng=rng()).Q.argmax(axis=1).tolist() == [1, 0]


@pytest.mark.parametrize("world", ["CartPole-v1", "Pendulum-v1"])
def test_agents_and_networks_act(world):
    run = ppo(world, rng=rng(), n_steps=64, config=PPOConfig(horizon=64, hidden=(8,)))
    for likeliest in (False, True):
        found = evaluate(run, world, 2, likeliest=likeliest, max_steps=30, rng=rng(1))
        again = evaluate(run.policy, gym.make(world), 2, likeliest=likeliest, max_steps=30, rng=rng(1))
        np.testing.assert_array_equal(found.returns, again.returns)
        assert found.lengths.max() <= 30
    by_hand = evaluate(run.policy.likeliest, world, 2, max_steps=30, rng=rng(1))
    np.testing.assert_array_equal(by_hand.returns, found.returns)


def test_a_network_of_logits_acts():
    net = MLP([4, 8, 2], rng=rng())
    agent = ActorCritic(net, MLP([4, 8, 1], rng=rng()))
    one, two = (evaluate(x, "CartPole-v1", 3, likeliest=True, rng=rng()) for x in (net, agent))
    np.testing.assert_array_equal(one.returns, two.returns)
    assert evaluate(net, "CartPole-v1", 3, rng=rng()).returns.min() > 1


def test_one_episode_says_nothing_about_others():
    found = evaluate(np.ones((5, 1)), random_walk(3), 1, rng=rng())
    assert found.interval == (-np.inf, np.inf) and found.iqm == found.mean == found.returns[0]


@pytest.mark.parametrize("agent, world, says", [
    (None, random_walk(3), "agent: got None"), ("pi", random_walk(3), "agent: got 'pi'"),
    (np.ones((3, 1)), random_walk(3), "agent: got shape (3, 1)"), (lambda s: 0, random_walk(3), "world: got FiniteMDP"),
    (np.ones((3, 1)), "CartPole-v1", "world: got"), (MLP([3, 1], rng=rng()), "Pendulum-v1", "agent: got a network"),
    (3, "CartPole-v1", "agent: got 3"), ([0.5, 0.5], random_walk(3), "agent: got [0.5, 0.5]"),
    (lambda s: 7, "CartPole-v1", "agent: gave action 7"), (lambda s: None, "CartPole-v1", "agent: gave action None"),
    (lambda s: 0.5, "CartPole-v1", "agent: gave action 0.5"), (lambda s: 0.5, "Pendulum-v1", "agent: gave action 0.5"),
    (lambda s: "left", "Pendulum-v1", "agent: got"), (lambda s: 2, Shifted(), "agent: gave action 2"),
    (lambda s: 5, Shifted(), "agent: gave action 5"),
])  # fmt: skip
def test_what_cannot_be_judged_is_refused(agent, world, says):
    with pytest.raises(ValueError) as error:
        evaluate(agent, world, 2, rng=rng())
    assert str(error.value).startswith(says) and "must" in str(error.value)


# ---------------------------------------------------------------------- summaries


def test_interquartile_mean_is_that_of_scipy():
    from scipy.stats import trim_mean

    x = rng().normal(size=(4, 11))
    np.testing.assert_allclose(interquartile_mean(x), trim_mean(x, 0.25, axis=1), rtol=1e-12)
    assert interquartile_mean([7.0]) == 7.0


def test_a_curve_has_a_band_and_its_name():
    runs = [Run(np.arange(6.0) + k, np.ones(6, int)) for k in range(3)] + [np.zeros(5)]
    curve = learning_curve(runs, window=2)
    assert curve.x.tolist() == [2, 4] and curve.name == "mean of 4 runs, band: 95 % interval of the mean"
    points = np.array([[0.5, 2.5], [1.5, 3.5], [2.5, 4.5], [0.0, 0.0]])
    np.testing.assert_allclose(curve.mean, points.mean(axis=0))
    half = 3.182446 * points.std(axis=0, ddof=1) / 2  # t of 3 degrees of freedom, 97.5 %
    np.testing.assert_allclose([curve.low, curve.high], curve.mean + [[-1], [1]] * half, rtol=1e-6)
    with pytest.raises(ValueError, match="^window: got 6, must be at most the episodes of a run, 5"):
        learning_curve(runs, window=6)


# ---------------------------------------------------------------------- films


class Lamp(Shifted):
    """Grey at first, brighter with each step."""

    metadata, render_mode = {"render_modes": ["rgb_array"], "render_fps": 4}, "rgb_array"

    def render(self):
        return np.full((8, 8, 3), 40 * (self.s - 4), np.uint8)


def test_a_film_shows_the_episode(tmp_path):
    total = film([[0.0, 1.0], [1.0, 0.0]], Lamp(), tmp_path / "lamp.gif", rng=rng())
    with Image.open(tmp_path / "lamp.gif") as picture:
        assert picture.n_frames == 3 and total == 2.0 and picture.info["duration"] == 250
        shades = []
        for k in range(3):
            picture.seek(k)
            shades.append(picture.convert("L").getpixel((0, 0)))
    np.testing.assert_allclose(shades, [40, 80, 120], atol=3)
    film(lambda s: 3, Lamp(), tmp_path / "lamp.gif", max_steps=1, fps=1000, rng=rng())
    with Image.open(tmp_path / "lamp.gif") as picture:
        assert picture.n_frames == 2 and picture.info["duration"] == 20
    with pytest.raises(ValueError, match="^env: got .* render_mode None, must be made with render_mode='rgb_array'"):
        film(np.full((16, 4), 0.25), gym.make("FrozenLake-v1"), tmp_path / "lake.gif", rng=rng())


class Reused(Lamp):
    """The same lamp, which draws into one array."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.picture = None

    def render(self):
        frame = super().render()
        self.picture = frame.copy() if self.picture is None else self.picture
        self.picture[:] = frame
        return self.picture


def test_a_film_keeps_its_frames(tmp_path):
    for name, kind in (("own", Lamp), ("reused", Reused)):
        film(lambda s: 4, kind(), tmp_path / name, max_steps=3, rng=rng())
    assert (tmp_path / "own").read_bytes() == (tmp_path / "reused").read_bytes()


@pytest.mark.parametrize("likeliest", [False, True])
def test_a_network_of_another_task_is_refused(likeliest):
    net = MLP([4, 5], rng=rng())
    net.biases[0][:] = [0, 0, 0, 0, 99]
    box = ppo("Pendulum-v1", n_steps=16, config=PPOConfig(horizon=16, hidden=(4,)), rng=rng())
    pole = ppo("CartPole-v1", n_steps=16, config=PPOConfig(horizon=16, hidden=(4,)), rng=rng())
    with pytest.raises(ValueError, match=r"^agent: gave action 4, must be in Discrete\(2\)"):
        evaluate(net, "CartPole-v1", 1, likeliest=likeliest, rng=rng())
    with pytest.raises(ValueError, match="^agent: gave action"):
        evaluate(box, gym.wrappers.TransformAction(gym.make("Pendulum-v1"), int, gym.spaces.Discrete(2)), 1, rng=rng())
    with pytest.raises(ValueError, match="^agent: gave action"):
        evaluate(
            pole,
            gym.wrappers.TransformObservation(
                gym.make("Pendulum-v1"), lambda o: np.append(o, 0.0), gym.spaces.Box(-9, 9, (4,))
            ),
            1,
            rng=rng(),
        )


def test_a_continuous_action_may_be_a_list():
    found = [
        evaluate(lambda s, a=a: a, "Pendulum-v1", 1, max_steps=3, rng=rng()) for a in ([0.5], (0.5,), np.array([0.5]))
    ]
    assert found[0].mean == found[1].mean == found[2].mean


@pytest.mark.parametrize(
    "pictures, message",
    [
        ([None], "render[(][)] gave None"), ([np.zeros((8, 8, 3))], "render[(][)] gave float64 of shape [(]8, 8, 3[)]"),
        ([np.zeros((8, 8), np.uint8)], "render[(][)] gave uint8 of shape [(]8, 8[)]"),
        ([np.zeros((8, 8, 2), np.uint8)], "render[(][)] gave uint8 of shape [(]8, 8, 2[)]"),
        ([np.zeros((n, 8, 3), np.uint8) for n in (8, 9)], "render[(][)] gave .*, must be uint8 of shape [(]8, 8, 3"),
    ],
)  # fmt: skip
def test_pictures_that_are_none_are_refused(pictures, message, tmp_path):
    lamp = Lamp()
    lamp.render = iter(pictures).__next__
    with pytest.raises(ValueError, match=f"^env: {message}"):
        film(lambda s: 4, lamp, tmp_path / "lamp.gif", rng=rng())
    assert not list(tmp_path.iterdir())


def test_films_of_any_speed(tmp_path):
    for fps in (0, -1.0, np.nan, np.inf, "30"):
        with pytest.raises(ValueError, match="^fps: got"):
            film(lambda s: 4, Lamp(), tmp_path / "lamp.gif", fps=fps, rng=rng())
        lamp = Lamp()
        lamp.metadata = {"render_fps": fps or -1}
        with pytest.raises(ValueError, match="^env.metadata.*: got"):
            film(lambda s: 4, lamp, tmp_path / "lamp.gif", rng=rng())
    film(lambda s: 4, Lamp(), tmp_path / "lamp.gif", fps=1e-320, max_steps=1, rng=rng())
    with Image.open(tmp_path / "lamp.gif") as picture:
        assert picture.info["duration"] == 655_350


def test_the_bootstrap_takes_blocks_of_the_same_draws(monkeypatch):
    """So that many episodes need no table of 2000 times as many."""
    returns = rng(1).normal(size=300)
    whole = judging._judged(returns, np.ones(300, int), rng())
    monkeypatch.setattr(judging, "BLOCK", 1000)
    parts = judging._judged(returns, np.ones(300, int), rng())
    assert parts.iqm_interval == whole.iqm_interval
    drawn = interquartile_mean(returns[rng().integers(300, size=(2000, 300))])
    assert whole.iqm_interval == tuple(np.quantile(drawn, [(1 - 0.95) / 2, (1 + 0.95) / 2]))
