"""Without numba, torch, matplotlib and gymnasium: NumPy and SciPy are enough to plan and to learn."""

import os
import sys

os.environ["RLCORE_NO_NUMBA"] = "1"
sys.modules.update(dict.fromkeys(("torch", "matplotlib", "gymnasium")))  # as if they were not installed

import numpy as np  # noqa: E402

from rlcore import evaluate, q_learning, solve  # noqa: E402
from rlcore.envs import cliff_walking  # noqa: E402

mdp = cliff_walking()
run = q_learning(mdp, 1.0, 200, alpha=0.5, epsilon=0.1, rng=np.random.default_rng(0))
print(solve(mdp, 1.0).V[36], evaluate(run, mdp, 5, likeliest=True, rng=np.random.default_rng(1)).mean)
