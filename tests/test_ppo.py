"""PPO: the gradient of each objective, what the penalty and the clip do to KL, and whether it learns."""

import re
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from agents import Counter, make_small, move, rng, rollouts, samples
from gymnasium.vector import SyncVectorEnv
from latex import gradient

from rlcore.core.agents import ActorCritic
from rlcore.core.rollouts import vector_env
from rlcore.distributions import Categorical, Gaussian
from rlcore.gae import learning_data
from rlcore.nn import MLP
from rlcore.optimizers import SGD, Adam
from rlcore.ppo import (
    MAX_LOG_RATIO,
    OBJECTIVES,
    PPOConfig,
    clip_gradient,
    objective_gradient,
    ppo,
    surrogate_gradient,
)
from rlcore.studies.tables import read
from rlcore.torchnet import TorchNet
from rlcore.trpo import TRPOConfig, trpo
from rlcore.trust_region import adapt_beta

EACH = pytest.mark.parametrize("objective", OBJECTIVES)

# ---------------------------------------------------------------------- gradients


def test_clipped_gradient_is_the_slope_of_the_printed_objective_and_0_where_it_is_flat():
    """d/d ln r of min(r A, clip(r, 1 - e, 1 + e) A), off the kinks. fig-59, fig-60"""
    r = np.array([0.0, 0.3, 0.79, 0.81, 1.0, 1.19, 1.21, 2.0, 9.0])
    L = lambda r, A: np.minimum(r * A, np.clip(r, 0.8, 1.2) * A)  # noqa: E731
    for A in (1.0, -1.0, 2.5, -0.3):
        slope = r * (L(r + 1e-6, A) - L(r - 1e-6, A)) / 2e-6
        ours = clip_gradient(r, np.full(9, A), 0.2) * 9
        np.testing.assert_allclose(ours, slope, atol=1e-8)
        flat = r > 1.2 if A > 0 else r < 0.8
        assert not ours[flat].any() and ours[~flat & (r > 0)].all() and flat.sum() == 3
    np.testing.assert_array_equal(clip_gradient(np.array([1.5, 0.5, 1.5, 0.5]), np.zeros(4), 0.2), 0)
    edges = clip_gradient(np.array([1.25, 0.75]), np.array([1.0, -1.0]), 0.25)  # exact in binary: not yet flat
    np.testing.assert_array_equal(edges, [0.625, -0.375])


def test_surrogate_gradient_is_ratio_times_advantage_over_the_samples():
    np.testing.assert_array_equal(surrogate_gradient(np.array([1.0, 2.0]), np.array([3.0, -1.0])), [1.5, -1.0])


@EACH
@pytest.mark.parametrize("discrete", [True, False])
def test_at_ratio_1_every_objective_has_the_plain_policy_gradient(discrete, objective):
    """g = mean of A grad ln pi. eq-ppo-41"""
    agent = make_small(discrete)
    x, actions, A, _ = samples(agent)
    policy = agent.forward(x)[0]
    gradient, ratio = objective_gradient(
        policy, policy, actions, policy.log_prob(actions), A, PPOConfig(objective=objective)
    )
    np.testing.assert_array_equal(ratio, 1)
    score = policy.grad_log_prob(actions)
    for g, s in zip(gradient if not discrete else [gradient], score if not discrete else [score]):
        np.testing.assert_allclose(g, A[:, None] * s / 40, atol=1e-15)
    assert isinstance(gradient, tuple) != discrete


def test_penalty_and_entropy_add_their_gradients():
    for discrete in (True, False):
        agent = make_small(discrete)
        x, actions, A, _ = samples(agent)
        old = agent.forward(x)[0]
        args = actions, old.log_prob(actions), A
        move(agent, 0.3)
        new = agent.forward(x)[0]
        both = np.atleast_3d if discrete else np.array
        plain = both(objective_gradient(new, old, *args, PPOConfig(objective="none"))[0])
        fixed = PPOConfig(objective="kl_fixed", beta=0.7)
        with_beta = both(objective_gradient(new, old, *args, fixed)[0])
        np.testing.assert_allclose(with_beta, plain - 0.7 / 40 * both(old.grad_kl(new)), atol=1e-15)
        adapted = both(objective_gradient(new, old, *args, PPOConfig(objective="kl_adaptive"), beta=3.0)[0])
        np.testing.assert_allclose(adapted, plain - 3.0 / 40 * both(old.grad_kl(new)), atol=1e-15)
        mixed = both(objective_gradient(new, old, *args, PPOConfig(objective="none", c2=0.2))[0])
        np.testing.assert_allclose(mixed, plain + 0.2 / 40 * both(new.grad_entropy()), atol=1e-15)
        assert abs(both(new.grad_entropy())).max() > 1e-3


def test_one_epoch_of_one_minibatch_is_the_plain_policy_gradient():
    """The loop of alg-vpg: a batch of steps, their advantages, one ascent step on L^PG, its slope by differences."""
    config = PPOConfig(objective="none", epochs=1, minibatch=64, horizon=64, lam=0.8)
    agent, g, lr = ActorCritic(*plain_nets()), rng(5), 0.5
    for rollout, _ in rollouts(vector_env("CartPole-v1"), agent, config, 150, None, g):
        x, actions, A, target = learning_data(agent, rollout, config)
        slope = gradient(lambda d=(x, actions, A): L_pg(agent, *d), agent.net.theta)
        error = agent.critic.forward(x)[:, 0] - target
        agent.critic.theta -= lr * agent.critic.backward(2 * config.c1 * error[:, None] / error.size)  # om-value-loss
        agent.net.theta += lr * slope
        g.permutation(len(x))  # ppo shuffles
    learned = [
        ppo("CartPole-v1", rng=rng(5), n_steps=150, config=c, net=net, critic=critic)
        for c, (net, critic) in ((replace(config, **change), plain_nets())
                                 for change in ({}, dict(epochs=2), dict(minibatch=32)))
    ]  # fmt: skip
    np.testing.assert_allclose(learned[0].history.largest_ratio, [1, 1, 1], rtol=1e-12)
    apart = [abs(run.policy.net.theta - agent.net.theta).max() for run in learned]
    assert apart[0] < 1e-8 and min(apart[1:]) > 1e-2  # 2e-11; 0.19 and 0.11 with more than one step a batch


def plain_nets():
    return [MLP([4, 3, n], optimizer=SGD(0.5), dtype=np.float64, rng=rng(4)) for n in (2, 1)]


def L_pg(agent, x, actions, A):
    return (agent.forward(x)[0].log_prob(actions) * A).mean()  # eq-ppo-43


def test_a_fixed_penalty_does_not_survive_a_change_of_scale():
    """Ten times the advantages are not ten times the gradient: the penalty weighs less. cl-130"""
    agent = make_small()
    x, actions, A, _ = samples(agent)
    old = agent.forward(x)[0]
    move(agent, 0.3)
    new, config = agent.forward(x)[0], PPOConfig(objective="kl_fixed", beta=3.0)
    one, ten = (objective_gradient(new, old, actions, old.log_prob(actions), k * A, config)[0] for k in (1.0, 10.0))
    assert abs(ten - 10 * one).max() > 0.1 * abs(ten).max()


def test_a_ratio_too_large_for_floats_is_cut():
    for dtype in (np.float32, np.float64):
        policy = Gaussian(np.zeros((3, 1), dtype), np.zeros(1, dtype))
        ratio = objective_gradient(
            policy, policy, np.zeros((3, 1), dtype), np.array([-100.0, -19.5, 500.0], dtype),
            np.ones(3, dtype), PPOConfig(objective="none"),
        )[1]  # fmt: skip
        log_prob = -0.5 * np.log(2 * np.pi)
        np.testing.assert_allclose(ratio, [np.exp(MAX_LOG_RATIO), np.exp(19.5 + log_prob), 0], rtol=1e-5, atol=1e-99)
        assert MAX_LOG_RATIO == 20


def test_beta_doubles_halves_or_stays():
    """om-adaptive-beta: d below d_target / 1.5, above 1.5 d_target, between."""
    assert [adapt_beta(8.0, d, 0.03) for d in (0.0, 0.0199, 0.02, 0.03, 0.045, 0.0451)] == [4, 4, 8, 8, 8, 16]


# ---------------------------------------------------------------------- settings


def test_defaults_are_the_papers():
    c = PPOConfig()
    assert (c.gamma, c.lam, c.horizon, c.epochs, c.minibatch, c.lr, c.hidden) == (
        0.99,
        0.95,
        2048,
        10,
        64,
        3e-4,
        (64, 64),
    )
    assert (c.objective, c.clip, c.beta, c.d_target, c.c1, c.c2, c.shared, c.anneal) == (
        "clip", 0.2, 1.0, 0.01, 0.5, 0.0, False, False,
    )  # fmt: skip
    assert c.n_envs == 1 and c.normalise_advantages and c.clip_actions and not c.normalise_observations
    assert PPOConfig(hidden=[3]).hidden == (3,) and PPOConfig(c1=0, c2=0).c1 == 0


# ---------------------------------------------------------------------- runs

QUICK = dict(horizon=128, epochs=3, hidden=(8,), lr=3e-3)


@pytest.mark.parametrize("learn, kind", [(ppo, PPOConfig), (trpo, TRPOConfig)])
def test_a_rollout_of_one_step_may_be_a_reset(learn, kind):
    run = learn("CartPole-v1", n_steps=100, config=kind(horizon=1, hidden=(4,)), rng=rng())
    assert run.lengths.size >= 2 and len(run.history) == 100


def test_history_has_a_record_for_each_rollout():
    run = ppo("CartPole-v1", rng=rng(1), n_steps=500, config=PPOConfig(**QUICK))
    h = run.history
    assert h.dtype.names == ("steps", "kl", "largest_ratio", "outside", "entropy", "value_loss", "beta", "lr")
    assert 4 <= len(h) <= 5 and (h.beta == 1).all() and (h.lr == 3e-3).all() and (h.steps[:-1] < 500).all()
    assert h.steps[-1] >= 500 and sum(run.lengths) <= h.steps[-1] and (h.kl > 0).all() and (h.largest_ratio > 1).all()
    assert ((h.outside >= 0) & (h.outside < 0.5)).all() and h.entropy[0] == pytest.approx(np.log(2), abs=0.02)
    assert run.policy.critic is not None and run.policy.values == run.V and (run.returns == run.lengths).all()
    assert ppo("CartPole-v1", rng=rng(1), n_steps=1).history.steps == pytest.approx(2048, abs=200)  # config=None


@pytest.mark.long
@pytest.mark.parametrize("world", ["CartPole-v1", "Pendulum-v1"])
def test_same_rng_same_run_and_the_twin_in_torch_learns_the_same(world):
    """Float64, so that five updates stay within 1e-8."""
    pytest.importorskip("torch")
    n, n_out = (4, 2) if world.startswith("Cart") else (3, 1)
    runs = []
    for kind in (lambda net: net, lambda net: net, TorchNet.like):
        nets = [kind(MLP([n, 8, k], optimizer=Adam(3e-3), dtype=np.float64, rng=rng(k))) for k in (n_out, 1)]
        config = PPOConfig(objective="kl_adaptive" if n == 3 else "clip", normalise_observations=n == 3, **QUICK)
        runs.append(ppo(world, rng=rng(3), n_steps=600, config=config, net=nets[0], critic=nets[1]))
        assert runs[-1].policy.net is nets[0] and runs[-1].policy.critic is nets[1]
    one, two, twin = runs
    np.testing.assert_array_equal(one.history, two.history)
    np.testing.assert_array_equal(one.policy.net.theta, two.policy.net.theta)
    np.testing.assert_array_equal(one.returns, two.returns)
    np.testing.assert_array_equal(one.lengths, twin.lengths)
    np.testing.assert_allclose(one.policy.net.theta, twin.policy.net.theta, atol=1e-8)
    np.testing.assert_allclose(one.policy.critic.theta, twin.policy.critic.theta, atol=1e-8)
    np.testing.assert_allclose(one.history.tolist(), twin.history.tolist(), rtol=1e-6, atol=1e-8)
    assert len(one.history) >= 5


def test_float32_twins_agree_for_a_few_updates():
    pytest.importorskip("torch")
    nets = [MLP([4, 8, k], optimizer=Adam(1e-3), rng=rng(k)) for k in (2, 1)]
    twins = [TorchNet.like(net) for net in nets]
    runs = [
        ppo("CartPole-v1", rng=rng(3), n_steps=300, config=PPOConfig(**QUICK), net=net, critic=critic)
        for net, critic in (nets, twins)
    ]
    np.testing.assert_allclose(nets[0].theta, twins[0].theta, atol=2e-4)
    np.testing.assert_allclose(runs[0].history.kl, runs[1].history.kl, atol=1e-4)


def test_another_rng_gives_another_run():
    a, b = (ppo("CartPole-v1", rng=rng(k), n_steps=200, config=PPOConfig(**QUICK)) for k in (1, 2))
    assert (a.policy.net.theta != b.policy.net.theta).mean() > 0.9 and list(a.returns) != list(b.returns)


@pytest.mark.parametrize("continuous", [False, True])
def test_one_environment_learns_as_a_vector_of_one(continuous):
    id = "Pendulum-v1" if continuous else "CartPole-v1"
    config = PPOConfig(normalise_observations=True, **QUICK)
    one, two, three = (
        ppo(world, rng=rng(3), n_steps=500, config=config)
        for world in (id, gym.make(id), SyncVectorEnv([lambda: gym.make(id)]))
    )
    for other in (two, three):
        np.testing.assert_array_equal(one.policy.net.theta, other.policy.net.theta)
        np.testing.assert_array_equal(one.returns, other.returns)


def test_several_environments_share_a_rollout():
    run = ppo("CartPole-v1", rng=rng(3), n_steps=1000, config=PPOConfig(n_envs=4, **QUICK))
    assert len(run.history) == 3 and 3 * 4 * 128 * 0.9 < run.history.steps[-1] < 3 * 4 * 128
    assert (run.returns == run.lengths).all() and len(run.returns) > 40


def test_on_episode_hears_of_each_and_may_stop():
    heard = []
    run = ppo(
        "CartPole-v1", rng=rng(), n_steps=50_000, config=PPOConfig(**QUICK),
        on_episode=lambda *news: heard.append(news) or len(heard) == 13,
    )  # fmt: skip
    assert run.returns.size == 13
    np.testing.assert_array_equal(heard, np.column_stack([run.returns, np.cumsum(run.lengths)]))
    assert run.history.steps[-1] == heard[-1][1] and len(run.history) < 10


def test_anneal_lets_the_rate_fall_in_a_straight_line():
    nets = [MLP([4, 4, k], optimizer=SGD(5.0), rng=rng(k)) for k in (2, 1)]
    run = ppo(
        "CartPole-v1", rng=rng(1), n_steps=1000, config=PPOConfig(anneal=True, **QUICK), net=nets[0], critic=nets[1]
    )
    before = np.append(0, run.history.steps[:-1])
    np.testing.assert_allclose(run.history.lr, 3e-3 * (1 - before / 1000), rtol=1e-12)
    assert nets[0].optimizer.lr == nets[1].optimizer.lr == run.history.lr[-1] and len(before) > 5
    run = ppo("Pendulum-v1", rng=rng(1), n_steps=300, config=PPOConfig(anneal=True, **QUICK))
    assert run.policy.log_std_optimizer.lr == run.policy.net.optimizer.lr == run.history.lr[-1] < 2e-3
    fixed = [MLP([4, 4, k], optimizer=SGD(0.5), rng=rng(k)) for k in (2, 1)]
    ppo("CartPole-v1", rng=rng(1), n_steps=300, config=PPOConfig(**QUICK), net=fixed[0], critic=fixed[1])
    assert fixed[0].optimizer.lr == 0.5


def test_c1_does_not_move_a_policy_of_its_own():
    """With SGD and two networks c1 scales the critic's step alone, in a shared one it turns the policy too. cl-141

    One rollout: in the next one the critic's values are part of the advantages.
    """
    ends = {}
    for shared in (False, True):
        for c1 in (0.1, 1.0):
            nets = [MLP([4, 6, k], optimizer=SGD(0.01), dtype=np.float64, rng=rng(k)) for k in (2 + shared, 1)]
            config = PPOConfig(c1=c1, shared=shared, **QUICK)
            critic = None if shared else nets[1]
            run = ppo("CartPole-v1", rng=rng(2), n_steps=10, config=config, net=nets[0], critic=critic)
            assert len(run.history) == 1 and (run.policy.critic is None) == shared
            ends[shared, c1] = nets[0].theta, nets[1].theta
    np.testing.assert_array_equal(ends[False, 0.1][0], ends[False, 1.0][0])
    assert abs(ends[False, 0.1][1] - ends[False, 1.0][1]).max() > 1e-3
    assert abs(ends[True, 0.1][0][:24] - ends[True, 1.0][0][:24]).max() > 1e-3


def test_the_entropy_term_keeps_the_policy_even():
    """ln 2 = 0.693; after 4,000 steps at most 0.56 without the term, seeds 0 to 3."""
    config = QUICK | dict(lr=1e-2)
    last = [ppo("CartPole-v1", rng=rng(2), n_steps=4000, config=PPOConfig(c2=c2, **config)) for c2 in (0.0, 3.0)]
    without, with_term = (run.history.entropy[-1] for run in last)
    assert without < 0.62 < 0.68 < with_term <= np.log(2)


# ---------------------------------------------------------------------- distance between policies


@pytest.mark.long
def test_an_initial_beta_of_100_is_halved_down_until_the_target_is_met():
    """Published: about 7 to 10 updates; here the 7th is the last that halves it, for each of seeds 0 to 7."""
    for seed in range(2):
        config = PPOConfig(objective="kl_adaptive", beta=100.0, lr=3e-3, horizon=512, hidden=(32,))
        h = ppo("CartPole-v1", rng=rng(seed), n_steps=14 * 500, config=config).history
        assert h.beta[0] == 100
        for beta, kl, following in zip(h.beta, h.kl, h.beta[1:]):
            assert following == (beta / 2 if kl < 0.01 / 1.5 else 2 * beta if kl > 0.015 else beta)
        first = int(np.argmax(np.diff(h.beta) >= 0)) + 1
        assert 6 <= first <= 10 and h.beta[-1] < 4


def test_clipping_keeps_the_policies_near_each_other():
    """Mean KL of an update with epsilon 0.2 at least 5 times smaller than without: 108 times or more, seeds 0 to 4."""
    mean = {}
    for objective in ("clip", "none"):
        config = PPOConfig(objective=objective, lr=1e-2, horizon=512, hidden=(32,))
        runs = [ppo("CartPole-v1", rng=rng(seed), n_steps=6 * 500, config=config) for seed in range(2)]
        mean[objective] = np.mean([run.history.kl.mean() for run in runs])
    assert mean["none"] > 5 * mean["clip"] > 0


@EACH
def test_what_is_recorded_of_ratios(objective):
    h = ppo(
        "CartPole-v1", rng=rng(1), n_steps=1500, config=PPOConfig(objective=objective, **QUICK | dict(lr=1e-2))
    ).history
    assert (h.largest_ratio > 1).all() and (h.outside > 0).any() and (h.outside < 1).all()
    if objective != "kl_adaptive":
        assert (h.beta == 1).all()


def test_each_update_adapts_the_next_beta():
    config = PPOConfig(objective="kl_adaptive", beta=20.0, d_target=0.003, **QUICK | dict(lr=1e-2))
    h = ppo("CartPole-v1", rng=rng(1), n_steps=2500, config=config).history
    factors = [0.5 if kl < 0.002 else 2.0 if kl > 0.0045 else 1.0 for kl in h.kl[:-1]]
    np.testing.assert_array_equal(h.beta[1:], h.beta[:-1] * factors)
    assert h.beta[0] == 20 and {0.5, 2.0} <= set(factors)


# ---------------------------------------------------------------------- learning

SMALL = dict(hidden=(32,), horizon=512)
CONFIGS = {name: PPOConfig(objective=name, lr=1e-2, **SMALL) for name in OBJECTIVES}
CONFIGS["none"] = PPOConfig(objective="none", lr=3e-3, epochs=4, **SMALL)  # with more it collapses
CONFIGS["trpo"] = TRPOConfig(delta=0.02, lr=1e-2, **SMALL)


def last_returns(world, config, seeds, n_steps=8192):
    """Mean return of the last ten episodes, averaged over the seeds."""
    learn = trpo if isinstance(config, TRPOConfig) else ppo
    runs = [learn(world, rng=rng(seed), n_steps=n_steps, config=config) for seed in seeds]
    return np.mean([run.returns[-10:].mean() for run in runs])


@pytest.mark.long
@pytest.mark.parametrize("name", CONFIGS)
def test_cartpole(name):
    """After 8,192 steps: 159 (no clipping) to 478 for each of six seeds; 22 without learning, 9 with the minus lost."""
    assert last_returns("CartPole-v1", CONFIGS[name], range(3)) > 120


@pytest.mark.long
@pytest.mark.parametrize("name", CONFIGS)
def test_inverted_pendulum(name):
    """After 8,192 steps: 76 to 563 for each of four seeds; 6 without learning."""
    pytest.importorskip("mujoco", reason="the task needs MuJoCo: pip install gymnasium[mujoco]")
    assert last_returns("InvertedPendulum-v5", CONFIGS[name], range(2)) > 50


@pytest.mark.long
@pytest.mark.parametrize("scale, lr", [(False, 1e-2), (True, 5e-3)])
def test_pendulum(scale, lr):
    """After 24,000 steps: -840 to -226 for seeds 0 to 5; about -1,250 without learning, -1,800 with the minus lost.

    Scaled, actions are twice as large, and so is a step: half the learning rate, -731 to -258 for seeds 0 to 3.
    """
    config = PPOConfig(lr=lr, gamma=0.9, lam=0.9, horizon=800, hidden=(32,), scale_actions=scale)
    assert last_returns("Pendulum-v1", config, range(2), 24_000) > -900


def test_too_small_a_step_makes_progress_very_slow():
    """cl-125, from the book's table: 30,720 steps with learning rate 1e-5 end at 27 to 31, eight seeds; the claim's
    experiment has 37. Without learning 22; 3e-3 ends at 500 and is further after three rollouts of the 60.
    """
    data = Path(__file__).parents[1] / "book" / "data"
    runs, curves = (read(data / f"chapter8_{name}.csv") for name in ("runs", "curves"))
    of = lambda rows, setting, key: np.array([row[key] for row in rows if row["setting"] == setting])  # noqa: E731
    slow, fast = of(runs, "lr 1e-05", "final"), of(runs, "clip 0.2", "final")
    assert slow.size == fast.size == 8 and slow.mean() == pytest.approx(37, abs=10) and slow.max() < 40
    assert fast.min() > 450 and of(runs, "lr 0.0001", "final").min() > 3 * slow.max()
    rollout, curve = of(curves, "lr 1e-05", "rollout"), of(curves, "clip 0.2", "mean")
    assert rollout.size * 512 == 30_720 and curve[:3].max() > slow.max()
    moved = {
        lr: ppo("CartPole-v1", n_steps=3 * 512, config=PPOConfig(lr=lr, horizon=512), rng=rng()).history.kl
        for lr in (1e-5, 3e-3)
    }
    assert 0 < moved[1e-5].max() < 1e-4 < 1e-3 < moved[3e-3].min()


def test_policies_that_were_learned_act():
    run = ppo("CartPole-v1", rng=rng(0), n_steps=8192, config=CONFIGS["clip"])
    assert isinstance(run.policy.policy(np.zeros((2, 4))), Categorical) and run.policy.likeliest(np.zeros(4)) in (0, 1)
    env, total = gym.make("CartPole-v1"), 0
    s, done = env.reset(seed=5)[0], False
    while not done:
        s, r, terminated, truncated, _ = env.step(run.policy.likeliest(s))
        total, done = total + r, terminated or truncated
    assert total >= 150
    leaning = [run.V(np.array([[0, 0, angle, 0]]))[0] for angle in (0.0, 0.2)]
    assert leaning[0] > leaning[1] > 0


@pytest.mark.parametrize("first", [1.0, 1e-300, 1e300])
def test_beta_adapts_for_ever(first):
    """However many quiet or wild rollouts there are, it stays a positive number that float32 holds, if it was one."""
    for kl, last in ((0.0, min(first, 1e-30)), (1.0, max(first, 1e30))):
        beta = first
        for _ in range(3000):
            beta = adapt_beta(beta, kl, 0.01)
        assert beta == last


# ---------------------------------------------------------------------- bad input


def call(world="CartPole-v1", **change):
    return lambda: ppo(world, **(dict(rng=rng(), n_steps=10) | change))


def net(*sizes, optimizer=True):
    return MLP(list(sizes), optimizer=Adam() if optimizer else None, rng=rng())


@pytest.mark.parametrize(
    "call, message",
    [
        (
            lambda: PPOConfig(objective="CLIP"),
            "objective: got 'CLIP', allowed are 'clip', 'none', 'kl_fixed', 'kl_adaptive'",
        ),
        (lambda: PPOConfig(objective=None), "objective: got None"),
        (lambda: PPOConfig(clip=0), "clip: got 0"),
        (lambda: PPOConfig(clip="0.2"), "clip: got '0.2'"),
        (lambda: PPOConfig(beta=-1), "beta: got -1"),
        (lambda: PPOConfig(beta=np.inf), "beta: got inf"),
        (lambda: PPOConfig(d_target=0.0), "d_target: got 0.0"),
        (lambda: PPOConfig(c1=-0.5), "c1: got -0.5, must be a number of at least 0"),
        (lambda: PPOConfig(c1=True), "c1: got True"),
        (lambda: PPOConfig(c1=np.inf), "c1: got inf"),
        (lambda: PPOConfig(c2=np.nan), "c2: got nan"),
        (lambda: PPOConfig(c2=None), "c2: got None"),
        (lambda: PPOConfig(shared=1), "shared: got 1, must be True or False"),
        (lambda: PPOConfig(anneal="linear"), "anneal: got 'linear'"),
        (lambda: PPOConfig(gamma=1.5), "gamma: got 1.5"),
        (lambda: PPOConfig(lam=-1), "lam: got -1"),
        (lambda: PPOConfig(lr=0.0), "lr: got 0.0"),
        (lambda: PPOConfig(horizon=0), "horizon: got 0"),
        (call("nosuchmodule:Env-v0"), "world: got 'nosuchmodule:Env-v0'"),
        (call(config=PPOConfig(horizon=10**9)), "horizon: needs an array of 1000000000 x 1 x 4 numbers"),
        (lambda: PPOConfig(minibatch=0.5), "minibatch: got 0.5"),
        (lambda: PPOConfig(hidden=("a",)), "hidden: got 'a'"),
        (call("NoSuchWorld-v0"), "world: got 'NoSuchWorld-v0'"),
        (call(None), "world: got NoneType"),
        (call("FrozenLake-v1"), "world: got observations"),
        (call(Counter(), config=PPOConfig(n_envs=2)), "n_envs: got 2 with one environment"),
        (call(rng=1), "rng: got 1"),
        (call(rng=1, net=net(4, 2), critic=net(4, 1)), "rng: got 1"),
        (call(n_steps=0), "n_steps: got 0"),
        (call(n_steps=1e400), "n_steps: got inf"),
        (call(config={}), "config: got dict, must be a PPOConfig"),
        (call(config="clip"), "config: got str"),
        (call(config=TRPOConfig()), "config: got TRPOConfig"),
        (call(net=net(4, 2, optimizer=False)), "net: has no optimizer"),
        (call(net=net(3, 2)), "net: does not take observations of 4 numbers"),
        (call(net=net(4, 3)), "net: got (3,) outputs, must be 2"),
        (call(net=np.zeros(4)), "net: got ndarray, must be an MLP or a TorchNet"),
        (call(critic=net(4, 2)), "critic: got (2,) outputs, must be 1"),
        (call(critic=net(4, 1), config=PPOConfig(shared=True)), "critic: got a network with shared = True"),
        (call(net=net(4, 2), config=PPOConfig(shared=True)), "net: got (2,) outputs, must be 3"),
        (lambda: adapt_beta(0.0, 0.1, 0.01), "beta: got 0.0"),
        (lambda: adapt_beta(1.0, np.nan, 0.01), "d: got nan"),
    ],
)
def test_bad_calls_name_the_argument(call, message):
    with pytest.raises(ValueError, match="^" + re.escape(message)):
        call()


def test_on_episode_must_be_a_function():
    with pytest.raises(ValueError, match=r"^on_episode: got 3, must be a function of \(return, steps so far\)"):
        ppo("CartPole-v1", rng=np.random.default_rng(0), n_steps=10, on_episode=3)
