"""Small agents and environments for the tests of chapter 8."""

import gymnasium as gym
import numpy as np

from rlcore.core.agents import ActorCritic
from rlcore.core.rollouts import Learning, Settings
from rlcore.nn import MLP
from rlcore.optimizers import SGD
from rlcore.torchnet import TorchNet

D, A = 3, 2  # numbers in an observation; actions, or numbers in one


def rng(seed=0):
    return np.random.default_rng(seed)


def rollouts(env, agent, config, n_steps, on_episode, rng):
    """What ppo and trpo learn from, and the episodes so far."""
    learning = Learning(env, agent, config, n_steps, (), on_episode, None, rng)
    for rollout in learning.rollouts():
        yield rollout, learning.episodes


def make_run(agent, episodes, rows, fields):
    """The Run of these episodes and this history."""
    env = type("Env", (), dict(num_envs=1))
    learning = Learning(env, agent, Settings(), 1, fields, None, None, rng())
    learning.episodes, learning.history = episodes, rows
    return learning.run()


def make_small(discrete=True, dtype=np.float64, *, shared=False, torch_net=False, optimizer=SGD, lr=0.1, seed=0):
    """An agent with one hidden layer of 5 neurons, and a TorchNet in place of the MLP if wanted."""
    g, kind = rng(seed), TorchNet.like if torch_net else lambda net: net
    net = kind(MLP([D, 5, A + shared], optimizer=optimizer(lr), dtype=dtype, rng=g))
    critic = None if shared else kind(MLP([D, 4, 1], optimizer=optimizer(lr), dtype=dtype, rng=g))
    if discrete:
        return ActorCritic(net, critic)
    return ActorCritic(net, critic, np.array([-0.3, 0.2], dtype), optimizer(lr))


def move(agent, scale, seed=1):
    """Another policy: all parameters of the agent moved at random, in place."""
    g = rng(seed)
    agent.net.theta += (scale * g.normal(size=agent.net.theta.size)).astype(agent.net.theta.dtype)
    if agent.log_std is not None:
        agent.log_std += (scale * g.normal(size=A)).astype(agent.log_std.dtype)


def samples(agent, B=40, seed=2):
    """x (B, D), actions of the agent's policy, advantages and targets (B,)."""
    g, dtype = rng(seed), agent.net.theta.dtype
    x = g.normal(size=(B, D)).astype(dtype)
    return x, agent.forward(x)[0].sample(g), g.normal(size=B).astype(dtype), g.normal(size=B).astype(dtype)


class Counter(gym.Env):
    """Observations (episode, step) / 10; the k-th episode has 2 + k % 4 steps and is cut where k % 3 == 1.

    Rewards tell what happened: episode + step / 8 + action / 64. Keeps every transition in `log`.
    """

    observation_space = gym.spaces.Box(-np.inf, np.inf, (2,))

    def __init__(self, first=0, continuous=False):
        self.k, self.log, self.seen = first - 1, [], []
        self.action_space = gym.spaces.Box(-0.5, 0.5, (A,)) if continuous else gym.spaces.Discrete(2)

    def state(self):
        return np.array([self.k / 10, self.t / 10], np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.k, self.t = self.k + 1, 0
        return self.state(), {}

    def step(self, a):
        s, r = self.state(), self.k + self.t / 8 + float(np.sum(a)) / 64
        self.t += 1
        end, cut = self.t == 2 + self.k % 4, self.k % 3 == 1
        self.log.append((s, a, r, self.state(), end and not cut, end and cut))
        return self.state(), r, end and not cut, end and cut, {}
