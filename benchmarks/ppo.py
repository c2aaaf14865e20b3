"""rlcore.ppo beside Stable-Baselines3's PPO, in turns in one run: CPU seconds, one thread.

    python benchmarks/ppo.py                      everything, about 40 minutes
    python benchmarks/ppo.py --only CartPole      --seeds 5, counted from --first
    python benchmarks/ppo.py --only HalfCheetah --steps 20480

*CartPole*: until the last 100 training episodes average 475, or 200,000 steps. Ours with settings of its own, and with
those of rl-baselines3-zoo, beside Stable-Baselines3 with the latter. *HalfCheetah, Hopper, InvertedPendulum*: steps a
CPU second with the settings of the PPO paper, and the mean return of the last 20 training episodes.
Results are in results/ppo.csv.
"""

import argparse
import os
import time

os.environ |= {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}

import numpy as np  # noqa: E402
from rows import Solved, save, solved_rows  # noqa: E402

from rlcore.ppo import PPOConfig, ppo  # noqa: E402

OWN = PPOConfig(n_envs=16, horizon=64, minibatch=128, epochs=6, lr=3e-3, anneal=True, gamma=0.98, lam=0.9)
ZOO = PPOConfig(n_envs=8, horizon=32, minibatch=256, epochs=20, lr=1e-3, anneal=True, gamma=0.98, lam=0.8)
PAPER = PPOConfig(normalise_observations=True)
TASKS = ["HalfCheetah", "Hopper", "InvertedPendulum"]


def ours(world, config, n_steps, seed, stop=True):
    episodes = Solved(stop)
    ppo(world, rng=np.random.default_rng(seed), n_steps=n_steps, config=config, on_episode=episodes)
    return episodes


def cartpole_sb3(seed):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    torch.set_num_threads(1)
    settings = dict(n_steps=32, batch_size=256, gae_lambda=0.8, gamma=0.98, n_epochs=20, ent_coef=0.0)
    schedule = dict(learning_rate=lambda left: left * 1e-3, clip_range=lambda left: left * 0.2)
    env, episodes = make_vec_env("CartPole-v1", n_envs=8, seed=seed), Solved()
    PPO("MlpPolicy", env, seed=seed, device="cpu", **settings, **schedule).learn(100_000, callback=watch(episodes))
    return episodes


def mujoco_sb3(task, n_steps, seed):
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(1)
    settings = dict(n_steps=2048, batch_size=64, n_epochs=10, learning_rate=3e-4, gamma=0.99, gae_lambda=0.95)
    env = VecNormalize(make_vec_env(f"{task}-v5", n_envs=1, seed=seed), norm_reward=False, clip_obs=5.0)
    episodes = Solved(stop=False)
    PPO("MlpPolicy", env, seed=seed, device="cpu", **settings).learn(n_steps, callback=watch(episodes))
    return episodes


def watch(episodes):
    """A callback of Stable-Baselines3 that tells episodes of each end."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Watch(BaseCallback):
        def _on_step(self):
            ended = [info["episode"]["r"] for info in self.locals["infos"] if "episode" in info]
            return not any([episodes(r, self.num_timesteps) for r in ended])

    return Watch()


def outcome(last):
    """What the seeds came to, in words. last: mean of the last 20 returns of each."""
    error = f" ± {np.std(last, ddof=1) / len(last) ** 0.5:.0f}" if len(last) > 1 else ""
    seeds = " ".join(f"{G:.0f}" for G in last)
    return f"last 20 returns {np.mean(last):.0f}{error}, of each seed: {seeds}"


def timed(job, *args, **kwargs):
    start = time.process_time()
    episodes = job(*args, **kwargs)
    return time.process_time() - start, episodes


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--steps", type=int, default=102_400)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    import stable_baselines3  # noqa: F401

    ours("CartPole-v1", OWN, 2048, 0)
    if options.only in "CartPole":
        jobs = {
            "CartPole rlcore": lambda s: ours("CartPole-v1", OWN, 200_000, s),
            "CartPole rlcore, zoo settings": lambda s: ours("CartPole-v1", ZOO, 100_000, s),
            "CartPole Stable-Baselines3": cartpole_sb3,
        }
        rows = solved_rows(jobs, seeds, timed)
        save("ppo", rows, against="CartPole Stable-Baselines3")
    for task in TASKS:
        if options.only in task:
            jobs = {
                f"{task} rlcore": lambda s, t=task: ours(f"{t}-v5", PAPER, options.steps, s, stop=False),
                f"{task} Stable-Baselines3": lambda s, t=task: mujoco_sb3(t, options.steps, s),
            }
            runs = {name: [] for name in jobs}
            for seed in seeds:
                for name, job in jobs.items():
                    runs[name].append(timed(job, seed))
            rows = []
            for name, done in runs.items():
                speed = np.median([options.steps / t for t, _ in done])
                rows.append((name, speed, "steps/CPU s", outcome([np.mean(e.returns[-20:]) for _, e in done])))
            save("ppo", rows, against=f"{task} Stable-Baselines3")


if __name__ == "__main__":
    main()
