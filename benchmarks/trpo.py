"""rlcore.trpo beside sb3-contrib's TRPO on CartPole-v1, in turns in one run: CPU seconds, one thread.

    python benchmarks/trpo.py      --seeds 5, counted from --first; about five minutes

Until the last 100 training episodes average 475, or 200,000 steps. Ours with settings of its own and with those of
rl-baselines3-zoo, beside sb3-contrib with the latter. Results are in results/trpo.csv.
"""

import argparse
import os

os.environ |= {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}

import numpy as np  # noqa: E402
from ppo import timed, watch  # noqa: E402
from rows import Solved, save, solved_rows  # noqa: E402

from rlcore.trpo import TRPOConfig, trpo  # noqa: E402

OWN = TRPOConfig(n_envs=16, horizon=128, epochs=5, minibatch=256, gamma=0.98, lam=0.95, lr=5e-3, delta=0.02)
ZOO = TRPOConfig(n_envs=2, horizon=512, minibatch=512, damping=1e-3, lam=0.98, lr=1e-3, epochs=20, cg_steps=15)


def ours(config, seed):
    episodes = Solved()
    trpo("CartPole-v1", rng=np.random.default_rng(seed), n_steps=200_000, config=config, on_episode=episodes)
    return episodes


def sb3(seed):
    import torch
    from sb3_contrib import TRPO
    from stable_baselines3.common.env_util import make_vec_env

    torch.set_num_threads(1)
    settings = dict(n_steps=512, batch_size=512, cg_damping=1e-3, gae_lambda=0.98, gamma=0.99, learning_rate=1e-3)
    env, episodes = make_vec_env("CartPole-v1", n_envs=2, seed=seed), Solved()
    model = TRPO("MlpPolicy", env, n_critic_updates=20, seed=seed, device="cpu", **settings)
    model.learn(200_000, callback=watch(episodes))
    return episodes


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1000)
    options = parser.parse_args()
    import sb3_contrib  # noqa: F401

    jobs = {
        "CartPole rlcore": lambda s: ours(OWN, s),
        "CartPole rlcore, zoo settings": lambda s: ours(ZOO, s),
        "CartPole sb3-contrib": sb3,
    }
    seeds = range(options.first, options.first + options.seeds)
    save("trpo", solved_rows(jobs, seeds, timed), against="CartPole sb3-contrib")


if __name__ == "__main__":
    main()
