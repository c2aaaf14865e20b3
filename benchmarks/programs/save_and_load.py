"""Train and save; in a new process load, act, and go on learning."""

import subprocess
import sys
import tempfile

import numpy as np

from rlcore import PPOConfig, evaluate, load, save
from rlcore.ppo import ppo

config = PPOConfig(horizon=256)
if len(sys.argv) == 1:
    rng = np.random.default_rng(0)
    run = ppo("CartPole-v1", n_steps=2048, config=config, rng=rng)
    with tempfile.TemporaryDirectory() as folder:
        save({"agent": run.policy, "rng": rng}, f"{folder}/cartpole.rl")
        subprocess.run([sys.executable, __file__, f"{folder}/cartpole.rl"], check=True)
else:
    kept = load(sys.argv[1])
    print(evaluate(kept["agent"], "CartPole-v1", 20, rng=np.random.default_rng(1)))
    print(ppo("CartPole-v1", n_steps=2048, config=config, agent=kept["agent"], rng=kept["rng"]))
