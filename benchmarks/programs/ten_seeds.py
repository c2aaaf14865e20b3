"""Three algorithms by ten seeds, with intervals."""

import numpy as np

from rlcore import expected_sarsa, learning_curve, q_learning, sarsa
from rlcore.envs import cliff_walking

for learn in (sarsa, expected_sarsa, q_learning):
    seeds = np.random.default_rng(0).spawn(10)
    runs = [learn(cliff_walking(), 1.0, 500, alpha=0.5, epsilon=0.1, rng=rng) for rng in seeds]
    curve = learning_curve(runs, window=100)
    print(f"{learn.__name__:15} {curve.mean[-1]:6.1f} [{curve.low[-1]:.1f}, {curve.high[-1]:.1f}]  {curve.name}")
