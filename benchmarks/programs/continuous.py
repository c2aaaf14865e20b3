"""PPO on a continuous task of one's own, whose actions run from -20 to 20."""

import gymnasium as gym
import numpy as np

from rlcore import PPOConfig, evaluate
from rlcore.ppo import ppo


class Target(gym.Env):
    """Name the number that is shown, between -20 and 20; the reward is minus the distance, over ten."""

    observation_space, action_space = gym.spaces.Box(-1, 1, (1,)), gym.spaces.Box(-20, 20, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = self.np_random.uniform(-1, 1, 1).astype(np.float32)
        return self.x, {}

    def step(self, action):
        return self.x, -abs(20 * float(self.x[0]) - float(action[0])) / 10, True, False, {}


config = PPOConfig(horizon=512, hidden=(32,), lr=1e-3)
run = ppo(Target(), n_steps=20_000, config=config, rng=np.random.default_rng(0))
print(evaluate(run, Target(), 200, likeliest=True, rng=np.random.default_rng(1)))
