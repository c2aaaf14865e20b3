"""The natural gradient and its line search, against torch's Hessians and direct solves."""

import itertools
import re

import numpy as np
import pytest
from agents import A, Counter, make_small, move, rng, rollouts, samples

from rlcore.core.agents import ActorCritic
from rlcore.core.rollouts import vector_env
from rlcore.gae import learning_data
from rlcore.nn import MLP
from rlcore.optimizers import SGD, Adam
from rlcore.ppo import PPOConfig
from rlcore.torchnet import TorchNet
from rlcore.trpo import TRPOConfig, _surrogate_gradient, conjugate_gradient, fisher_vector_product, trpo, trpo_step

DISCRETE = pytest.mark.parametrize("discrete", [True, False])


# ---------------------------------------------------------------------- conjugate gradient


def system(n=12, seed=1):
    M, b = rng(seed).normal(size=(n, n)), rng(seed + 1).normal(size=n)
    return M @ M.T + 0.5 * np.eye(n), b


def test_conjugate_gradient_solves_in_as_many_steps_as_dimensions():
    H, b = system()
    x = conjugate_gradient(lambda v: H @ v, b, 12)
    np.testing.assert_allclose(x, np.linalg.solve(H, b), rtol=1e-6)
    kept = b.copy()
    conjugate_gradient(lambda v: H @ v, b, 5)
    np.testing.assert_array_equal(b, kept)
    np.testing.assert_array_equal(conjugate_gradient(lambda v: H @ v, np.zeros(12), 5), 0)


def test_after_k_steps_it_is_the_best_point_of_the_krylov_space():
    """The minimum of x H x / 2 - b x over the span of b, H b, ..., H^(k-1) b."""
    H, b = system()
    for k in (1, 2, 5):
        K = np.linalg.qr(np.stack([np.linalg.matrix_power(H, i) @ b for i in range(k)], axis=1))[0]
        best = K @ np.linalg.solve(K.T @ H @ K, K.T @ b)
        np.testing.assert_allclose(conjugate_gradient(lambda v: H @ v, b, k), best, rtol=1e-7, atol=1e-10)


def test_it_stops_where_nothing_is_left():
    calls = []
    x = conjugate_gradient(lambda v: calls.append(1) or 2 * v, np.ones(4), 10)
    np.testing.assert_array_equal(x, 0.5)
    assert len(calls) == 1
    calls.clear()
    H, b = system()
    conjugate_gradient(lambda v: calls.append(1) or H @ v, b, 10, tol=b @ b * 2)
    assert not calls
    conjugate_gradient(lambda v: calls.append(1) or H @ v, b, 10, tol=b @ b)
    assert len(calls) == 1


# ---------------------------------------------------------------------- products with the Fisher matrix


def directions(agent, n=3):
    P = agent.net.theta.size + (0 if agent.log_std is None else A)
    return rng(8).normal(size=(n, P))


@pytest.mark.parametrize("torch_net", [False, True])
def test_jvp_equals_finite_differences(torch_net):
    if torch_net:
        pytest.importorskip("torch")
    net = MLP([3, 5, 4, 2], dtype=np.float64, output="sigmoid", rng=rng(1))
    net.theta += rng(2).normal(size=net.theta.size)
    net, x, h = TorchNet.like(net) if torch_net else net, rng(3).normal(size=(6, 3)), 1e-6
    theta = net.theta.copy()
    for v in rng(4).normal(size=(3, theta.size)):
        net.forward(x)
        change = net.jvp(v)
        ends = []
        for sign in (1, -1):
            net.theta[:] = theta + sign * h * v
            ends.append(net.forward(x))
        net.theta[:] = theta
        np.testing.assert_allclose(change, (ends[0] - ends[1]) / (2 * h), rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("torch_net", [False, True])
@DISCRETE
def test_fisher_vector_product_is_the_hessian_of_mean_kl(discrete, torch_net):
    torch, losses = pytest.importorskip("torch"), pytest.importorskip("rlcore.losses")
    agent = make_small(discrete, torch_net=torch_net)
    move(agent, 0.5)
    x = samples(agent, B=9)[0]
    policy = agent.forward(x)[0]
    module = (agent.net.copy() if torch_net else TorchNet.like(agent.net)).module
    names, shapes = zip(*((name, p.shape) for name, p in module.named_parameters()))

    def outputs(theta):
        parts = theta[: agent.net.theta.size].split([shape.numel() for shape in shapes])
        values = {name: part.view(shape) for name, part, shape in zip(names, parts, shapes)}
        out = torch.func.functional_call(module, values, torch.tensor(x))
        return out if discrete else (out, theta[agent.net.theta.size :])

    theta = torch.tensor(agent.net.theta if discrete else np.append(agent.net.theta, agent.log_std))
    old = outputs(theta)
    H = torch.autograd.functional.hessian(lambda t: losses.mean_kl(old, outputs(t)), theta).numpy()
    for v in directions(agent):
        for damping in (0.0, 0.3):
            expected = H @ v + damping * v
            ours = fisher_vector_product(agent, policy, v, damping)
            np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12 * abs(expected).max())
        assert abs(H @ v).max() > 0.1


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@DISCRETE
def test_it_is_the_mean_of_the_scores_products(discrete, dtype):
    """F v = E[score (score . v)] over the policy's own actions, summed exactly for two actions."""
    agent = make_small(discrete, dtype)
    x = samples(agent, B=4)[0]
    policy = agent.forward(x)[0]
    v = directions(agent, 1)[0].astype(dtype)
    ours = fisher_vector_product(agent, policy, v)
    assert ours.dtype == dtype
    assert v @ ours > 0
    if not discrete:
        np.testing.assert_allclose(ours[-A:], 2 * v[-A:], rtol=1e-5)
        return
    expected = np.zeros_like(ours)
    for b in range(4):
        for a in range(A):
            agent.net.forward(x[b : b + 1])
            score = agent.net.backward(policy.take([b]).grad_log_prob(np.array([a])))
            expected += policy.probs[b, a] * score * (score @ v) / 4
    np.testing.assert_allclose(ours, expected, rtol=1e-4 if dtype == np.float32 else 1e-10, atol=1e-6)


# ---------------------------------------------------------------------- one step


def parameters(agent):
    return np.append(agent.net.theta, [] if agent.log_std is None else agent.log_std)


def natural_direction(agent, x, actions, A, damping):
    """(F + damping)^-1 g by a direct solve, and g, with F from its products with the unit vectors."""
    policy = agent.forward(x)[0]
    n = parameters(agent).size
    H = np.array([fisher_vector_product(agent, policy, e, damping) for e in np.eye(n)])
    score = policy.grad_log_prob(actions)
    if agent.log_std is None:
        g = agent.net.backward(A[:, None] * score / A.size)
    else:
        g = np.append(agent.net.backward(A[:, None] * score[0] / A.size), (A[:, None] * score[1]).mean(axis=0))
    return np.linalg.solve(H, g), H, g


@DISCRETE
def test_the_step_is_the_natural_gradient_cut_until_it_is_good(discrete):
    """theta + shrink^k sqrt(2 delta / x H x) x with the first k whose KL and surrogate allow it. om-trpo-step"""
    cut = set()
    for seed, delta in itertools.product(range(4), (0.5, 50.0)):
        agent = make_small(discrete, seed=seed)
        move(agent, 1.0, seed)
        x, actions, A, _ = samples(agent, seed=seed)
        config = TRPOConfig(delta=delta, damping=0.005, cg_steps=60, shrink=0.6)
        direction, H, g = natural_direction(agent, x, actions, A, 0.005)
        step, theta = np.sqrt(2 * delta / (direction @ H @ direction)) * direction, parameters(agent)
        old = agent.forward(x)[0]
        np.testing.assert_allclose(_surrogate_gradient(agent, old, actions, A), g, atol=1e-14)
        kl, improvement, k = trpo_step(agent, x, actions, A, config)
        cut.add(k)
        np.testing.assert_allclose(parameters(agent), theta + 0.6**k * step, rtol=0, atol=3e-3 * abs(step).max())
        ends = []
        for power in range(k + 1):
            agent.net.theta[:] = (theta + 0.6**power * step)[: agent.net.theta.size]
            if not discrete:
                agent.log_std[:] = (theta + 0.6**power * step)[agent.net.theta.size :]
            new = agent.forward(x)[0]
            r = np.exp(new.log_prob(actions) - old.log_prob(actions))
            ends.append((old.kl(new).mean(), (r * A).mean() - A.mean()))
        assert all(d > delta or better <= 0 for d, better in ends[:-1]), "an earlier one was good enough"
        assert (kl, improvement) == pytest.approx(ends[-1], rel=1e-2) and kl <= delta and improvement > 0
    assert len(cut) > 2


@pytest.mark.parametrize("torch_net", [False, True])
@DISCRETE
def test_scaling_the_advantages_changes_nothing(discrete, torch_net):
    """A fixed penalty is not so: see test_ppo. alg-trpo"""
    if torch_net:
        pytest.importorskip("torch")
    ends = []
    for scale in (1.0, 10.0):
        agent = make_small(discrete, torch_net=torch_net)
        x, actions, A, _ = samples(agent)
        record = trpo_step(agent, x, actions, scale * A, TRPOConfig(cg_steps=6))
        ends.append((parameters(agent), record[0], record[1] / scale, record[2]))
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-10)
    assert ends[0][1:] == pytest.approx(ends[1][1:], rel=1e-8) and ends[0][1] > 0.005


@DISCRETE
def test_a_step_that_is_never_good_enough_is_given_up(discrete):
    agent = make_small(discrete)
    move(agent, 1.0)
    x, actions, A, _ = samples(agent, B=5)
    theta, critic = parameters(agent), agent.critic.theta.copy()
    hopeless = TRPOConfig(delta=2000.0, damping=1e-4, cg_steps=40, backtracks=3, shrink=0.999)
    assert trpo_step(agent, x, actions, A, hopeless) == (0.0, 0.0, 3)
    np.testing.assert_array_equal(parameters(agent), theta)
    assert trpo_step(agent, x, actions, 0 * A, TRPOConfig()) == (0.0, 0.0, 0)
    np.testing.assert_array_equal(parameters(agent), theta)
    assert trpo_step(agent, x, actions, A, TRPOConfig())[0] > 0
    np.testing.assert_array_equal(agent.critic.theta, critic)


@DISCRETE
def test_a_step_too_small_for_the_precision_is_no_improvement(discrete):
    agent = make_small(discrete, np.float32)
    x, actions, A, _ = samples(agent)
    assert trpo_step(agent, x, actions, A, TRPOConfig(delta=1e-30, backtracks=2)) == (0.0, 0.0, 2)
    assert [type(part) for part in trpo_step(agent, x, actions, A, TRPOConfig())] == [float, float, int]


# ---------------------------------------------------------------------- a run


@pytest.mark.parametrize("world", ["CartPole-v1", "Pendulum-v1"])
def test_every_update_keeps_to_the_trust_region_and_improves(world):
    config = TRPOConfig(horizon=256, hidden=(16,), epochs=2, delta=0.02)
    run = trpo(world, rng=rng(1), n_steps=6 * 256, config=config)
    h = run.history
    assert len(h) in (6, 7) and run.history.dtype.names == (
        "steps",
        "kl",
        "improvement",
        "shrunk",
        "entropy",
        "value_loss",
    )
    taken = h.shrunk < config.backtracks
    assert taken.sum() >= 5 and (h.kl[taken] > 0.002).all() and (h.kl <= 0.02).all()
    assert (h.improvement[taken] > 0).all() and not h.kl[~taken].any()
    assert h.steps[-1] >= 6 * 256 * 0.9 and (np.diff(h.steps) > 200).all()


def test_records_are_those_of_the_updates():
    """Two rollouts played again by hand."""
    config = TRPOConfig(horizon=40, hidden=(6,), epochs=2, minibatch=16)
    run = trpo(Counter(), rng=rng(4), n_steps=50, config=config)
    nets = [MLP([2, 6, n], optimizer=Adam(config.lr, eps=1e-5), rng=rng(0)) for n in (2, 1)]
    again = trpo(Counter(), rng=rng(4), n_steps=50, config=config, net=nets[0].copy(), critic=nets[1].copy())
    g, agent = rng(4), ActorCritic(*nets)
    for row, (rollout, episodes) in zip(again.history, rollouts(vector_env(Counter()), agent, config, 50, None, g)):
        x, actions, A, target = learning_data(agent, rollout, config)
        old, v = agent.forward(x)
        record = trpo_step(agent, x, actions, A, config)
        new = agent.forward(x)[0]
        assert row.steps == episodes.steps == round(row.steps) and tuple(row)[1:4] == pytest.approx(record)
        assert row.kl == pytest.approx(old.kl(new).mean(), abs=1e-7)
        assert row.entropy == pytest.approx(new.entropy().mean(), rel=1e-6)
        assert row.value_loss == pytest.approx(((v - target) ** 2).mean(), rel=1e-5)
        for _ in range(2):
            order = g.permutation(len(x))
            for i in range(0, len(x), 16):
                c = order[i : i + 16]
                error = agent.critic.forward(x[c])[:, 0] - target[c]
                agent.critic.step(agent.critic.backward(error[:, None] / len(c)))
    np.testing.assert_array_equal(again.policy.net.theta, agent.net.theta)
    np.testing.assert_array_equal(again.policy.critic.theta, agent.critic.theta)
    assert len(again.history) == 2 and again.policy.values == again.V and len(run.history) == 2


@pytest.mark.long
@pytest.mark.parametrize("world", ["CartPole-v1", "Pendulum-v1"])
def test_same_rng_same_run_and_the_twin_in_torch_learns_the_same(world):
    pytest.importorskip("torch")
    n, n_out = (4, 2) if world.startswith("Cart") else (3, 1)
    runs = []
    for kind in (lambda net: net, lambda net: net, TorchNet.like):
        nets = [kind(MLP([n, 8, k], optimizer=Adam(1e-3), dtype=np.float64, rng=rng(k))) for k in (n_out, 1)]
        config = TRPOConfig(horizon=200, epochs=2)
        runs.append(trpo(world, rng=rng(3), n_steps=800, config=config, net=nets[0], critic=nets[1]))
    one, two, twin = runs
    np.testing.assert_array_equal(one.history, two.history)
    np.testing.assert_array_equal(one.policy.net.theta, two.policy.net.theta)
    np.testing.assert_allclose(one.policy.net.theta, twin.policy.net.theta, atol=1e-6)
    np.testing.assert_allclose(one.policy.critic.theta, twin.policy.critic.theta, atol=1e-6)
    np.testing.assert_array_equal(one.lengths, twin.lengths)
    np.testing.assert_allclose(one.history.tolist(), twin.history.tolist(), atol=1e-4)


def test_on_episode_hears_of_each_and_may_stop():
    heard = []
    config = TRPOConfig(horizon=100, epochs=1, hidden=(4,))
    run = trpo(
        "CartPole-v1", rng=rng(), n_steps=5000, config=config,
        on_episode=lambda *news: heard.append(news) or len(heard) == 9,
    )  # fmt: skip
    assert run.returns.size == 9 and len(run.history) < 10
    np.testing.assert_array_equal(heard, np.column_stack([run.returns, np.cumsum(run.lengths)]))


# ---------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: TRPOConfig(delta=0), "delta: got 0"),
        (lambda: TRPOConfig(delta=np.nan), "delta: got nan"),
        (lambda: TRPOConfig(damping=-0.1), "damping: got -0.1, must be a number of at least 0"),
        (lambda: TRPOConfig(damping=np.inf), "damping: got inf"),
        (lambda: TRPOConfig(damping="much"), "damping: got 'much'"),
        (lambda: TRPOConfig(damping=True), "damping: got True"),
        (lambda: TRPOConfig(cg_steps=0), "cg_steps: got 0"),
        (lambda: TRPOConfig(backtracks=2.5), "backtracks: got 2.5"),
        (lambda: TRPOConfig(shrink=1.0), "shrink: got 1.0, must be above 0 and below 1"),
        (lambda: TRPOConfig(shrink=0.0), "shrink: got 0.0"),
        (lambda: TRPOConfig(gamma=-1), "gamma: got -1"),
        (lambda: trpo("CartPole-v1", rng=0, n_steps=10), "rng: got 0"),
        (lambda: trpo("CartPole-v1", rng=0, n_steps=10, net=MLP([4, 2], optimizer=SGD(1), rng=rng()),
                      critic=MLP([4, 1], optimizer=SGD(1), rng=rng())), "rng: got 0"),
        (lambda: trpo(Counter(), rng=rng(), n_steps=10, config=TRPOConfig(n_envs=2)), "n_envs: got 2 with one"),
        (lambda: trpo("CartPole-v1", rng=rng(), n_steps=0), "n_steps: got 0"),
        (lambda: trpo("CartPole-v1", rng=rng(), n_steps=10, config=PPOConfig()), "config: got PPOConfig, must be"),
        (lambda: trpo("CartPole-v1", rng=rng(), n_steps=10, config={}), "config: got dict"),
        (lambda: trpo("NoSuchWorld-v0", rng=rng(), n_steps=10), "world: got 'NoSuchWorld-v0'"),
        (lambda: trpo("CartPole-v1", rng=rng(), n_steps=10, net=MLP([4, 2], rng=rng())), "net: has no optimizer"),
        (lambda: trpo("CartPole-v1", rng=rng(), n_steps=10, critic=MLP([4, 2], optimizer=SGD(1), rng=rng())),
         "critic: got (2,) outputs, must be 1"),
        (lambda: conjugate_gradient(lambda v: v, np.ones(2), 0), "n_steps: got 0"),
    ],
)  # fmt: skip
def test_bad_calls_name_the_argument(call, message):
    with pytest.raises(ValueError, match="^" + re.escape(message)):
        call()


def test_damping_may_be_nothing():
    assert TRPOConfig(damping=0).damping == 0 and TRPOConfig(shrink=0.999).shrink == 0.999
    defaults = TRPOConfig()
    assert (defaults.delta, defaults.damping, defaults.cg_steps, defaults.backtracks) == (0.01, 0.1, 10, 10)
    assert (defaults.shrink, defaults.lr, defaults.minibatch) == (0.8, 1e-3, 128)
