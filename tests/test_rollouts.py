"""Advantages, environments side by side, what is learned from them, and the agent that acts."""

import re

import gymnasium as gym
import numpy as np
import pytest
from agents import A, Counter, make_run, make_small, rng, rollouts
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from rlcore.core.agents import ActorCritic, Normaliser, action_box, make_agent
from rlcore.core.rollouts import Episodes, OneEnv, Rollout, Settings, collect, vector_env
from rlcore.distributions import Categorical, Gaussian
from rlcore.gae import gae, learning_data
from rlcore.nn import MLP
from rlcore.nstep import lambda_return
from rlcore.optimizers import SGD, Adam
from rlcore.ppo import PPOConfig
from rlcore.trpo import fit_values

# ---------------------------------------------------------------------- advantages

ENDS = {4: "terminated", 5: "truncated", 11: "truncated", 12: "terminated", 20: "terminated"}  # of 30 steps
SETTINGS = [(0.9, 0.8), (1.0, 0.5), (0.99, 0.95), (0.5, 1.0), (0.7, 0.0), (0.0, 0.3)]


def steps(seed=0, T=30):
    """rewards, values, next_values, terminated, truncated: five episodes and the beginning of a sixth."""
    g = rng(seed)
    rewards, values, next_values = g.normal(size=(3, T))
    terminated, truncated = (np.array([ENDS.get(t) == name for t in range(T)]) for name in ("terminated", "truncated"))
    inside = ~(terminated | truncated)
    inside[-1] = False
    next_values[inside] = values[1:][inside[:-1]]
    return rewards, values, next_values, terminated, truncated


@pytest.mark.parametrize("gamma, lam", SETTINGS)
def test_advantage_plus_value_is_the_lambda_return(gamma, lam):
    rewards, v, v_next, terminated, truncated = steps()
    advantages, start = gae(*steps(), gamma, lam), 0
    for end in [*ENDS, 29]:
        part = slice(start, end + 1)
        last = [] if terminated[end] else [v_next[end]]
        expected = lambda_return(rewards[part], np.append(v[part], last), gamma, lam)
        np.testing.assert_allclose(advantages[part] + v[part], expected, atol=1e-13)
        start = end + 1


@pytest.mark.parametrize("gamma, lam", SETTINGS)
def test_side_by_side_is_each_alone(gamma, lam):
    many = [steps(seed) for seed in range(3)]
    together = gae(*(np.stack(part, axis=1) for part in zip(*many)), gamma, lam)
    assert together.shape == (30, 3)
    np.testing.assert_array_equal(together, np.stack([gae(*one, gamma, lam) for one in many], axis=1))


def test_lambda_0_is_the_td_error_and_lambda_1_the_return_less_the_value():
    rewards, v, v_next, terminated, truncated = steps()
    np.testing.assert_array_equal(gae(*steps(), 0.9, 0.0), rewards + 0.9 * v_next * ~terminated - v)
    G, last = np.zeros(30), v_next[-1]
    for t in reversed(range(30)):
        last = 0.0 if terminated[t] else v_next[t] if truncated[t] else last
        last = G[t] = rewards[t] + 0.9 * last
    np.testing.assert_allclose(gae(*steps(), 0.9, 1.0), G - v, atol=1e-13)


def test_a_terminal_state_is_worth_nothing_and_a_truncated_one_keeps_its_value():
    args, gamma, lam = steps(), 0.9, 0.8
    before = gae(*args, gamma, lam)
    for t, how in ENDS.items():
        changed = args[2].copy()
        changed[t] += 10.0
        change = gae(*args[:2], changed, *args[3:], gamma, lam) - before
        start = max([end + 1 for end in ENDS if end < t], default=0)
        expected = np.zeros(30)
        if how == "truncated":
            expected[start : t + 1] = 10 * gamma * (gamma * lam) ** np.arange(t - start, -1, -1)
        np.testing.assert_allclose(change, expected, atol=1e-13)


def test_the_sum_stops_where_the_episode_does():
    """A reward just behind an end changes nothing before it."""
    args = steps()
    for end in ENDS:
        rewards = args[0].copy()
        rewards[end + 1] += 5.0
        change = gae(rewards, *args[1:], 0.9, 0.8) - gae(*args, 0.9, 0.8)
        assert not change[: end + 1].any() and change[end + 1] == pytest.approx(5.0)


# ---------------------------------------------------------------------- environments


def play(env, agent, T, n, *, clip_actions=True, seed=3):
    """n rollouts of T steps, one after the other."""
    s, over, g, found = env.reset(seed=1)[0], np.zeros(env.num_envs, bool), rng(seed), []
    for _ in range(n):
        if agent.log_std is not None:
            agent.box = action_box(env.single_action_space, scale=False, clip=clip_actions, dtype=np.float64)
        rollout, over = collect(env, agent, s, over, T, rng=g)
        s = rollout.observations[-1]
        found.append(rollout)
    return found


def small_agent(space, seed=0, critic_lr=0.1, normaliser=None):
    g = rng(seed)
    net, critic = (MLP([2, 4, n], optimizer=SGD(critic_lr), dtype=np.float64, rng=g) for n in (2, 1))
    if hasattr(space, "n"):
        return ActorCritic(net, critic, normaliser=normaliser)
    return ActorCritic(net, critic, np.log([0.4, 2.0]), SGD(0.1), normaliser)


@pytest.mark.parametrize("continuous", [False, True])
@pytest.mark.parametrize("N", [1, 3])
def test_learning_data_are_the_real_transitions_and_nothing_else(N, continuous):
    """Episodes of 2 to 5 steps, some cut, in rollouts of 7: resets fall inside rollouts and on their borders."""
    worlds = [Counter(first=10 * i, continuous=continuous) for i in range(N)]
    env = vector_env(worlds[0]) if N == 1 else SyncVectorEnv([lambda w=w: w for w in worlds])
    agent, gamma = small_agent(env.single_action_space), 0.7
    found = play(env, agent, 7, 6, clip_actions=False)
    assert any(~r.real[0].any() for r in found) if N == 1 else any((~r.real[0]).any() for r in found)
    values = lambda x: agent.critic.forward(np.array(x))[:, 0]  # noqa: E731
    seen = []
    for rollout in found:
        config = Settings(gamma=gamma, lam=0.0, normalise_advantages=False)
        x, actions, advantage, target = learning_data(agent, rollout, config)
        assert len(x) == len(actions) == len(advantage) == len(target) == rollout.real.sum() < 7 * N
        assert x.dtype == advantage.dtype == target.dtype == np.float64
        np.testing.assert_allclose(advantage, target - values(x), atol=1e-12)
        seen.append((x, actions, target))
    seen = [np.concatenate(part) for part in zip(*seen)]
    log = [row for world in worlds for row in world.log]
    assert len(log) == len(seen[0]) and sum(row[4] for row in log) > 3 and sum(row[5] for row in log) > 1
    mine = {tuple(np.round(10 * x).astype(int)): (a, target) for x, a, target in zip(*seen)}
    for s, a, r, s_next, terminated, _ in log:
        action, target = mine.pop(tuple(np.round(10 * s).astype(int)))
        np.testing.assert_allclose(action, a)
        assert target == pytest.approx(r + gamma * (0.0 if terminated else values([s_next])[0]), abs=1e-6)
    assert not mine
    if N == 1:
        assert {type(row[1]) for row in log} == {np.ndarray if continuous else int}


def test_advantages_are_centred_and_scaled_over_what_is_real_alone():
    agent = small_agent(gym.spaces.Discrete(2))
    rollout = play(vector_env(Counter()), agent, 20, 1)[0]
    plain = learning_data(agent, rollout, Settings(normalise_advantages=False))
    scaled = learning_data(agent, rollout, Settings())
    np.testing.assert_allclose(scaled[2], (plain[2] - plain[2].mean()) / plain[2].std(), rtol=1e-7)
    np.testing.assert_array_equal(scaled[3], plain[3])
    assert 0.3 < plain[2].std() < 30 and rollout.real.sum() < 20
    flat = Rollout(rollout.observations[:2] * 0, np.zeros((1, 1), int), *np.zeros((1, 1, 1)), *[np.zeros((1, 1), bool)] * 2, np.ones((1, 1), bool))  # fmt: skip  # noqa: E501
    assert learning_data(agent, flat, Settings())[2] == 0


def test_one_environment_is_a_vector_of_one():
    alone, vector = OneEnv(gym.make("CartPole-v1")), SyncVectorEnv([lambda: gym.make("CartPole-v1")])
    agent = make_agent(alone, Settings(), None, None, rng(5))
    for mine, theirs in zip(*(play(env, agent, 50, 4) for env in (alone, vector))):
        for name in ("observations", "actions", "rewards", "terminated", "truncated", "real"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), err_msg=name)
    assert (~mine.real).sum() > 0
    s = alone.reset(seed=1)[0]
    alone.over = True
    np.testing.assert_array_equal(alone.reset(seed=1)[0], s)
    assert not alone.over and s.shape == (1, 4)


def test_cartpoles_own_vector_environment_and_its_reset_step():
    env = vector_env("CartPole-v1", 4)
    assert type(env).__name__ == "CartPoleVectorEnv" and isinstance(vector_env("CartPole-v1"), OneEnv)
    agent, episodes = make_agent(env, Settings(), None, None, rng(5)), Episodes(4, None)
    for rollout in play(env, agent, 100, 3):
        episodes.add(rollout)
        ends = np.argwhere((rollout.terminated | rollout.truncated)[:-2])
        for t, i in ends:
            assert not rollout.real[t + 1, i] and abs(rollout.observations[t + 2, i]).max() < 0.06  # a fresh start
            assert abs(rollout.observations[t + 1, i]).max() > 0.2  # where the episode ended
    assert len(episodes.returns) > 20 and episodes.returns == episodes.lengths


def test_a_time_limit_cuts_and_the_next_step_resets():
    env = vector_env(TimeLimit(Counter(first=3), 2))  # episode 3 has 5 steps
    rollout = play(env, small_agent(env.single_action_space), 4, 1)[0]
    np.testing.assert_array_equal(rollout.truncated[:, 0], [False, True, False, False])
    np.testing.assert_array_equal(rollout.real[:, 0], [True, True, False, True])
    assert not rollout.terminated.any() and rollout.rewards[2, 0] == 0


@pytest.mark.parametrize("clip_actions", [True, False])
def test_what_the_environment_sees_is_cut_and_what_is_learned_is_not(clip_actions):
    world = Counter(continuous=True)
    env = vector_env(world)
    rollout = play(env, small_agent(env.single_action_space), 40, 1, clip_actions=clip_actions)[0]
    drawn, seen = rollout.actions[rollout.real], np.array([row[1] for row in world.log])
    assert abs(drawn).max() > 2
    np.testing.assert_array_equal(seen, np.clip(drawn, -0.5, 0.5) if clip_actions else drawn)


@pytest.mark.parametrize("normalised", [False, True])
@pytest.mark.parametrize("continuous", [False, True])
def test_actions_are_draws_of_the_policy(continuous, normalised):
    """Outputs plus noise of the policy's spread; the argmax of logits plus Gumbel noise."""
    env = vector_env(Counter(continuous=continuous))
    normaliser = Normaliser(2, dtype=np.float64) if normalised else None
    agent = small_agent(env.single_action_space, normaliser=normaliser)
    if normalised:
        normaliser.update(np.array([[0.3, 0.1], [0.0, 0.4], [1.0, 0.2]]))
    rollout = play(env, agent, 30, 1, seed=8)[0]
    policy = agent.policy(rollout.observations[:-1, 0])
    if continuous:
        noise = rng(8).standard_normal((30, 1, A)) * [0.4, 2.0]
        np.testing.assert_allclose(rollout.actions[:, 0], policy.mean + noise[:, 0], atol=1e-12)
    else:
        noise = rng(8).gumbel(size=(30, 1, 2))
        np.testing.assert_array_equal(rollout.actions[:, 0], (policy.logits + noise[:, 0]).argmax(axis=1))
        assert rollout.actions.dtype == np.int64 and 5 < rollout.actions.sum() < 25
    assert rollout.observations.dtype == np.float64 and rollout.observations.shape == (31, 1, 2)


def test_a_rollout_has_the_precision_of_the_network():
    env = vector_env("Pendulum-v1")
    rollout = play(env, make_agent(env, Settings(), None, None, rng(1)), 5, 1)[0]
    assert rollout.actions.dtype == rollout.observations.dtype == np.float32 and rollout.rewards.dtype == float


# ---------------------------------------------------------------------- bookkeeping


@pytest.mark.parametrize("N", [1, 3])
def test_episodes_are_counted_as_by_a_plain_loop(N):
    g, heard, mine = rng(2), [], ([], [], 0)
    episodes = Episodes(N, lambda *news: heard.append(news))
    G, n, over = np.zeros(N), np.zeros(N, int), np.zeros(N, bool)
    for _ in range(4):
        rewards, terminated, truncated = g.normal(size=(25, N)), g.random((25, N)) < 0.1, g.random((25, N)) < 0.1
        real = np.ones((25, N), bool)
        returns, lengths, count = mine
        told = []
        for t in range(25):
            real[t] = ~over
            terminated[t] &= ~over
            truncated[t] &= ~over
            count += int((~over).sum())
            for i in range(N):
                if over[i]:
                    over[i] = False
                    continue
                G[i], n[i] = G[i] + rewards[t, i], n[i] + 1
                if terminated[t, i] or truncated[t, i]:
                    returns.append(G[i])
                    lengths.append(n[i])
                    told.append((G[i], count))
                    G[i], n[i], over[i] = 0, 0, True
        mine = returns, lengths, count
        before = len(heard)
        stop = episodes.add(Rollout(None, None, rewards, terminated, truncated, real))
        assert stop is False
        np.testing.assert_allclose(np.reshape(heard[before:], (-1, 2)), np.reshape(told, (-1, 2)))
    assert episodes.returns == pytest.approx(mine[0]) and episodes.lengths == mine[1] and episodes.steps == mine[2]
    assert len(episodes.returns) > 10 and type(episodes.returns[0]) is float and type(episodes.lengths[0]) is int


def test_rollouts_go_on_until_the_steps_are_reached_or_somebody_stops_them():
    config, lengths = Settings(horizon=10), []
    agent = small_agent(gym.spaces.Discrete(2))
    for _, episodes in rollouts(vector_env(Counter()), agent, config, 25, None, rng(1)):
        lengths.append(episodes.steps)
    assert lengths[-1] >= 25 > lengths[-2] and all(7 <= b - a <= 9 for a, b in zip([0, *lengths], lengths))
    exactly = [e.steps for _, e in rollouts(vector_env(Counter()), agent, config, lengths[1], None, rng(1))]
    assert exactly == lengths[:2]
    heard = []
    stop = lambda *news: heard.append(news) or len(heard) == 4  # noqa: E731
    episodes = [e for _, e in rollouts(vector_env(Counter()), agent, config, 1000, stop, rng(1))][-1]
    assert len(heard) == len(episodes.returns) == 4 and episodes.steps == heard[-1][1] == sum(episodes.lengths)


def test_each_rollout_goes_on_where_the_last_one_stopped():
    config, agent, world = Settings(horizon=7), small_agent(gym.spaces.Discrete(2)), Counter()
    found = [rollout for rollout, _ in rollouts(vector_env(world), agent, config, 30, None, rng(1))]
    for a, b in zip(found, found[1:]):
        np.testing.assert_array_equal(a.observations[-1], b.observations[0])
    assert sum(r.real.sum() for r in found) == len(world.log)
    rewards = np.concatenate([r.rewards[r.real] for r in found])
    np.testing.assert_allclose(rewards, [row[2] for row in world.log])


def test_environments_are_seeded_from_the_rng():
    firsts = [
        next(rollouts(vector_env("CartPole-v1"), make_agent(vector_env("CartPole-v1"), Settings(), None, None, rng(9)),
                      Settings(horizon=3), 3, None, rng(seed)))[0].observations[0]
        for seed in (1, 1, 2)
    ]  # fmt: skip
    np.testing.assert_array_equal(firsts[0], firsts[1])
    assert (firsts[0] != firsts[2]).all()


def test_normaliser_is_mean_and_deviation_of_all_that_was_seen():
    g = rng(3)
    parts = [g.normal(loc=[1e4, 0, 5, 3], scale=[1, 1e-3, 0, 2], size=(n, 4)) for n in (1, 2, 50, 7)]
    normaliser = Normaliser(4, dtype=np.float64)
    np.testing.assert_array_equal(normaliser(np.array([[1.0, -2, 7, -9]])), [[1, -2, 5, -5]])  # before: only cut
    for k, part in enumerate(parts):
        normaliser.update(part)
        seen = np.concatenate(parts[: k + 1])
        np.testing.assert_allclose(normaliser.mean, seen.mean(axis=0), rtol=1e-12)
        np.testing.assert_allclose(normaliser.scale, 1 / np.maximum(seen.std(axis=0), 0.01), rtol=1e-7)
        assert normaliser.n == len(seen)
    x = seen[:5].copy()
    expected = np.clip((x - normaliser.mean) * normaliser.scale, -5, 5)
    np.testing.assert_allclose(normaliser(x), expected, atol=1e-12)
    np.testing.assert_array_equal(x, seen[:5])
    far = normaliser(seen.mean(axis=0) + np.array([100.0, 0, 0, -100]))
    np.testing.assert_allclose(far[[0, 3]], [5, -5])
    sums = Normaliser(4, dtype=np.float64)
    sums.update(seen.astype(np.float32))
    np.testing.assert_allclose(sums.mean, seen.astype(np.float32).mean(axis=0, dtype=float), rtol=1e-12)
    half = Normaliser(4)
    half.update(parts[2])
    assert half(parts[2].astype(np.float32)).dtype == half.mean.dtype == half.scale.dtype == np.float32
    assert half(np.full((1, 4), 1e9, np.float32)).max() == 5


def test_rollouts_show_the_normaliser_every_observation_once_and_after_acting():
    config, env = Settings(horizon=9, normalise_observations=True), vector_env(Counter())
    agent = make_agent(env, config, None, None, rng(1))
    assert agent.normaliser.mean.dtype == np.float32
    seen, before = [], agent.normaliser.mean.copy()
    for rollout, _ in rollouts(env, agent, config, 30, None, rng(1)):
        seen.append(rollout.observations[:-1].reshape(-1, 2))
        assert (agent.normaliser.mean != before).any()
        np.testing.assert_allclose(agent.normaliser.mean, np.concatenate(seen).mean(axis=0), rtol=1e-5)
    assert agent.normaliser.n == 9 * len(seen)
    x = learning_data(agent, rollout, config)[0]
    np.testing.assert_array_equal(x, agent.see(rollout.observations[:-1, 0])[rollout.real[:, 0]])


def test_fit_values_is_descent_on_half_the_squared_error():
    """A linear critic by hand: w moves by -lr mean(error x), b by -lr mean(error), minibatch after minibatch."""
    critic = MLP([2, 1], optimizer=SGD(0.05), dtype=np.float64, rng=rng(1))
    agent = ActorCritic(MLP([2, 2], optimizer=SGD(0.1), dtype=np.float64, rng=rng(2)), critic)
    x, target, theta, g = rng(3).normal(size=(10, 2)), rng(4).normal(size=10), critic.theta.copy(), rng(5)
    kept = agent.net.theta.copy()
    for _ in range(3):
        order = g.permutation(10)
        for chosen in (order[:4], order[4:8], order[8:]):
            error = x[chosen] @ theta[:2] + theta[2] - target[chosen]
            theta = theta - 0.05 * np.append((error[:, None] * x[chosen]).mean(axis=0), error.mean())
    fit_values(agent, x, target, Settings(epochs=3, minibatch=4), rng(5))
    np.testing.assert_allclose(critic.theta, theta, atol=1e-14)
    np.testing.assert_array_equal(agent.net.theta, kept)


def test_a_run_holds_a_record_for_each_rollout():
    episodes = Episodes(1, None)
    episodes.returns, episodes.lengths = [1.5, 2.0], [3, 4]
    agent = small_agent(gym.spaces.Discrete(2))
    run = make_run(agent, episodes, [(5, 0.1), (9, 0.2)], ("steps", "kl"))
    np.testing.assert_array_equal(run.history.steps, [5, 9])
    np.testing.assert_array_equal(run.history.kl, [0.1, 0.2])
    np.testing.assert_array_equal(run.returns, [1.5, 2.0])
    assert run.lengths.dtype == int and run.policy is agent and agent.values == run.V and run.Q is None
    assert make_run(agent, Episodes(1, None), [(5, 0.1)], ("steps", "kl")).lengths.dtype == int


# ---------------------------------------------------------------------- agents


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("continuous", [False, True])
def test_new_networks_fit_the_spaces_and_start_near_an_even_policy(continuous, shared):
    env = vector_env(Counter(continuous=continuous))
    config = PPOConfig(hidden=(8, 6), lr=0.02, shared=shared)
    agent = make_agent(env, config, None, None, rng(1), shared=shared)
    assert agent.net.sizes == [2, 8, 6, A + shared] and agent.net.theta.dtype == np.float32
    twin = MLP([2, 8, 6, A + shared], rng=rng(1))
    np.testing.assert_array_equal(agent.net.weights[-1][:A], twin.weights[-1][:A] * np.float32(0.01))
    np.testing.assert_array_equal(agent.net.weights[-1][A:], twin.weights[-1][A:])
    np.testing.assert_array_equal(agent.net.weights[0], twin.weights[0])
    if shared:
        assert agent.critic is None
    else:
        assert agent.critic.sizes == [2, 8, 6, 1]
    optimizers = [net.optimizer for net in (agent.net, agent.critic) if net] + [agent.log_std_optimizer] * continuous
    assert all((o.lr, o.eps) == (0.02, 1e-5) for o in optimizers) and len(set(map(id, optimizers))) == len(optimizers)
    if continuous:
        assert agent.log_std.tolist() == [0, 0] and agent.log_std.dtype == np.float32
    else:
        assert agent.log_std is None
    agent.set_lr(0.5)
    assert all(o.lr == 0.5 for o in optimizers) and agent.normaliser is None


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("continuous", [False, True])
def test_what_the_agent_sees_has_the_precision_of_its_network(continuous, dtype):
    env, net = vector_env(Counter(continuous=continuous)), MLP([2, 3, A], optimizer=Adam(), dtype=dtype, rng=rng())
    plain = make_agent(env, Settings(), net, None, rng(1))
    scaled = make_agent(env, Settings(normalise_observations=True), net, None, rng(1))
    assert plain.normaliser is None and scaled.normaliser.mean.dtype == scaled.normaliser.scale.dtype == dtype
    for agent in (plain, scaled):
        assert agent.see([[1, 2]]).dtype == dtype
    np.testing.assert_array_equal(scaled.see([[1, 9]]), [[1, 5]])


@pytest.mark.parametrize("torch_net", [False, True])
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("discrete", [True, False])
def test_acting_is_forward_and_values_are_the_last_output(discrete, shared, torch_net):
    if torch_net:
        pytest.importorskip("torch")
    agent = make_small(discrete, shared=shared, torch_net=torch_net)
    agent.normaliser = Normaliser(3, dtype=np.float64)
    agent.normaliser.update(rng(1).normal(loc=2.0, size=(50, 3)))
    s = rng(2).normal(size=(6, 3))
    x, z = agent.see(s), agent.net.forward(agent.see(s))
    policy, v = agent.forward(x)
    outputs = policy.logits if discrete else policy.mean
    assert isinstance(policy, Categorical if discrete else Gaussian) and outputs.shape == (6, A)
    np.testing.assert_array_equal(outputs, z[:, :A])
    np.testing.assert_array_equal(v, z[:, A] if shared else agent.critic.forward(x)[:, 0])
    act = agent.acting()
    np.testing.assert_allclose(act(s), outputs, atol=1e-14)
    agent.net.theta[:] *= 1.5
    np.testing.assert_allclose(act(s), agent.net.forward(x)[:, :A], atol=1e-14)  # it follows the parameters
    policy = agent.policy(s)
    np.testing.assert_array_equal(agent.values(s), agent.forward(x)[1])
    if discrete:
        np.testing.assert_array_equal(policy.logits, agent.forward(x)[0].logits)
        assert [agent.likeliest(row) for row in s] == policy.probs.argmax(axis=1).tolist()
        assert type(agent.likeliest(s[0].tolist())) is int
    else:
        np.testing.assert_array_equal(policy.log_std, np.tile(agent.log_std, (6, 1)))
        np.testing.assert_allclose([agent.likeliest(row) for row in s], policy.mean, atol=1e-14)
    np.testing.assert_array_equal(ActorCritic(agent.net, agent.critic).see([[1, 2, 3]]), [[1.0, 2.0, 3.0]])


def test_a_policy_keeps_its_spread_when_the_agent_learns_on():
    """Otherwise KL(old, new) misses what log_std does."""
    agent = make_small(False)
    x = np.zeros((1, 3))
    old = agent.forward(x)[0]
    agent.log_std += 0.5
    new = agent.forward(x)[0]
    np.testing.assert_allclose(old.log_std[0], [-0.3, 0.2])
    np.testing.assert_allclose(old.kl(new), 2 * (0.5 + np.exp(-1.0) / 2 - 0.5), atol=1e-12)


def test_a_shared_network_moves_by_both_derivatives_and_log_std_by_its_sum():
    agent = make_small(False, shared=True, lr=0.1)
    x, g = rng(1).normal(size=(4, 3)), rng(2)
    d_mean, d_log_std, d_values = g.normal(size=(4, A)), g.normal(size=(4, A)), g.normal(size=4)
    agent.forward(x)
    expected = agent.net.theta - 0.1 * agent.net.backward(np.column_stack((d_mean, d_values)))
    agent.step((d_mean, d_log_std), d_values)
    np.testing.assert_allclose(agent.net.theta, expected, atol=1e-15)
    np.testing.assert_allclose(agent.log_std, [-0.3, 0.2] - 0.1 * d_log_std.sum(axis=0), atol=1e-15)


# ---------------------------------------------------------------------- bad input


def spaces(observations, actions):
    env = Counter()
    env.observation_space, env.action_space = observations, actions
    return env


def gae_with(**change):
    names = ("rewards", "values", "next_values", "terminated", "truncated")
    call = dict(zip(names, ([1.0, 2.0], [0.0, 0.0], [0.0, 0.0], [False, True], [False, False]))) | change
    return lambda: gae(*(call[name] for name in names), call.get("gamma", 0.9), call.get("lam", 0.9))


BOX, TWO = gym.spaces.Box(-1, 1, (2,)), gym.spaces.Discrete(2)
nan = float("nan")


@pytest.mark.parametrize(
    "call, message",
    [
        (gae_with(gamma=1.1), "gamma: got 1.1"),
        (gae_with(lam=-0.1), "lam: got -0.1"),
        (gae_with(rewards=[1.0, nan]), "rewards: contains nan, must be finite"),
        (gae_with(rewards=["a", "b"]), "rewards: got ['a', 'b'], must be numbers"),
        (gae_with(rewards=3.0), "rewards: got shape (), must be"),
        (gae_with(rewards=[]), "rewards: got shape (0,)"),
        (gae_with(rewards=np.zeros((2, 2, 2))), "rewards: got shape (2, 2, 2)"),
        (gae_with(values=[0.0, 0.0, 0.0]), "values: got shape (3,)"),
        (gae_with(values=[0.0, np.inf]), "values: contains inf, must be finite"),
        (gae_with(next_values=[[0.0, 0.0]]), "next_values: got shape (1, 2)"),
        (gae_with(terminated=[True]), "terminated: got shape (1,)"),
        (gae_with(truncated=None), "truncated: got None, must be True or False"),
        (lambda: vector_env("NoSuchWorld-v0"), "world: got 'NoSuchWorld-v0'"),
        (lambda: vector_env("NoSuchWorld-v0", 2), "world: got 'NoSuchWorld-v0'"),
        (lambda: vector_env(3), "world: got int"),
        (lambda: vector_env("CartPole-v1", 0), "n_envs: got 0"),
        (lambda: vector_env(Counter(), 2), "n_envs: got 2 with one environment"),
        (lambda: vector_env(SyncVectorEnv([Counter] * 3), 2), "n_envs: got 2 with a vector of 3, must be 3 or"),
        (
            lambda: vector_env(SyncVectorEnv([Counter], autoreset_mode=AutoresetMode.SAME_STEP)),
            "world: got AutoresetMode.SAME_STEP, must reset on the next step",
        ),
        (lambda: vector_env("FrozenLake-v1"), "world: got observations Discrete(16)"),
        (lambda: vector_env("Blackjack-v1"), "world: got observations Tuple"),
        (lambda: vector_env(spaces(gym.spaces.Box(-1, 1, (2, 2)), TWO)), "world: got observations Box"),
        (lambda: vector_env(spaces(gym.spaces.Box(-1, 1, ()), TWO)), "world: got observations Box"),
        (lambda: vector_env(spaces(BOX, gym.spaces.Box(-1, 1, (2, 2)))), "world: got actions Box"),
        (lambda: vector_env(spaces(BOX, gym.spaces.Tuple([TWO]))), "world: got actions Tuple"),
        (lambda: vector_env(spaces(BOX, gym.spaces.MultiBinary(2))), "world: got actions MultiBinary(2)"),
        (lambda: vector_env(spaces(BOX, gym.spaces.MultiDiscrete([2, 2]))), "world: got actions MultiDiscrete([2 2])"),
        (lambda: vector_env(spaces(gym.spaces.MultiDiscrete([2, 2]), TWO)), "world: got observations MultiDiscrete"),
        (lambda: Settings(gamma=2), "gamma: got 2"),
        (lambda: Settings(lam="high"), "lam: got 'high'"),
        (lambda: Settings(lr=0), "lr: got 0"),
        (lambda: Settings(horizon=0), "horizon: got 0"),
        (lambda: Settings(n_envs=1.5), "n_envs: got 1.5"),
        (lambda: Settings(epochs=0), "epochs: got 0"),
        (lambda: Settings(minibatch=-1), "minibatch: got -1"),
        (lambda: Settings(hidden=64), "hidden: got 64, must be numbers of neurons"),
        (lambda: Settings(hidden=()), "hidden: got ()"),
        (lambda: Settings(hidden=(64, 0)), "hidden: got 0"),
        (lambda: Settings(normalise_advantages=1), "normalise_advantages: got 1, must be True or False"),
        (lambda: Settings(normalise_observations=None), "normalise_observations: got None"),
        (lambda: Settings(clip_actions="yes"), "clip_actions: got 'yes'"),
        (lambda: make_agent(vector_env(Counter()), Settings(), MLP([2, 3], optimizer=Adam(), rng=rng()), None, rng()),
         "net: got (3,) outputs, must be 2"),
        (lambda: make_agent(vector_env(Counter()), Settings(), None, MLP([2, 1], rng=rng()), rng()),
         "critic: has no optimizer"),
        (lambda: make_agent(vector_env(Counter()), Settings(), None, MLP([2, 1], rng=rng()), rng(), shared=True),
         "critic: got a network with shared = True"),
        (lambda: make_agent(vector_env(Counter()), Settings(), MLP([2, 2], optimizer=Adam(), rng=rng()), None, rng(),
                            shared=True), "net: got (2,) outputs, must be 3"),
        (lambda: make_agent(vector_env(Counter()), Settings(), "mlp", None, rng()), "net: got str"),
    ],
)  # fmt: skip
def test_bad_calls_name_the_argument(call, message):
    with pytest.raises(ValueError, match="^" + re.escape(message)):
        call()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_actions_stay_inside_every_box(dtype):
    """Also where float32 rounds the ends outwards, or has no such number."""
    low, high = np.array([-0.1, 0.3, -1e300, -1.0]), np.array([0.1, 0.7, 1e300, np.inf])
    space = gym.spaces.Box(low, high, dtype=np.float64)
    box = action_box(space, scale=True, clip=True, dtype=dtype)
    agent = ActorCritic(MLP([1, 4], dtype=dtype, rng=rng()), None, np.zeros(4, dtype), SGD(0.1), None, box)
    for x in (-np.finfo(np.float32).max, -1.0, 0.0, 1.0, np.finfo(np.float32).max):
        with np.errstate(over="ignore"):
            actions = agent.bounded(np.full(4, x, dtype))
        assert (low <= actions).all() and (actions <= high).all() and np.isfinite(actions).all()
    np.testing.assert_allclose(agent.bounded(np.ones(4, dtype))[:2], [0.1, 0.7], rtol=1e-6)
    stretched = agent.bounded(np.full(4, 0.5, dtype))
    np.testing.assert_allclose(stretched[[0, 1, 3]], [0.05, 0.6, 0.5], rtol=1e-6)
    assert stretched[2] == (0.5 if dtype == np.float32 else 5e299)
    assert action_box(space, scale=False, clip=False, dtype=dtype)[2:].tolist() == [[-np.inf] * 4, [np.inf] * 4]
