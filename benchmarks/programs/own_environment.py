"""An environment of one's own, two learners, and how sure one is of what they earn."""

import gymnasium as gym
import numpy as np

from rlcore import evaluate, q_learning, sarsa


class Bridge(gym.Env):
    """Seven planks; a step to the right may slip, off the bridge at -10, to the end for +10."""

    observation_space, action_space = gym.spaces.Discrete(7), gym.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.plank = 0
        return 0, {}

    def step(self, action):
        if action and self.np_random.random() < 0.05:
            return self.plank, -10.0, True, False, {}
        self.plank = max(0, self.plank + (1 if action else -1))
        return self.plank, 10.0 if self.plank == 6 else -1.0, self.plank == 6, False, {}


for learn in (q_learning, sarsa):
    run = learn(Bridge(), 1.0, 500, alpha=0.1, epsilon=0.1, max_steps=100, rng=np.random.default_rng(0))
    print(learn.__name__, evaluate(run, Bridge(), 200, likeliest=True, rng=np.random.default_rng(1)))
