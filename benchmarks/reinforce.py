"""rlcore.reinforce beside torch and a textbook loop: CPU seconds, one thread.

    python benchmarks/reinforce.py                 everything
    python benchmarks/reinforce.py --only corridor
    python benchmarks/reinforce.py --seeds 5       seeds of each CartPole row, counted from --first

*CartPole*: REINFORCE with a learned baseline on CartPole-v1, until the last 100 training episodes average 475 or 1,000
episodes are over. `MLP` is rlcore's default; `TorchNet` the same function with torch's networks; `torch example` the
loop of PyTorch's own examples (one episode an update, 128 relu neurons with dropout, normalised returns), up to 130,000
steps. *corridor*: 1,000 episodes of figure 53 at 2^-13, compiled, and as a plain NumPy loop in the manner of code that
accompanies the textbook.
"""

import argparse
import csv
import datetime
import os
import platform
import time
from importlib.metadata import version
from pathlib import Path

os.environ |= {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}

import numpy as np  # noqa: E402

from rlcore.envs import short_corridor  # noqa: E402
from rlcore.nn import MLP  # noqa: E402
from rlcore.optimizers import Adam  # noqa: E402
from rlcore.reinforce import reinforce, reinforce_network  # noqa: E402
from rlcore.torchnet import TorchNet  # noqa: E402

RESULTS = Path(__file__).parent / "results" / "reinforce.csv"


class Solved:
    """on_episode that stops when the last 100 returns average 475."""

    def __init__(self):
        self.returns, self.steps = [], 0

    def __call__(self, G, steps):
        self.returns.append(G)
        self.steps = steps
        return len(self.returns) >= 100 and np.mean(self.returns[-100:]) >= 475


def cartpole(seed, twin=False):
    rng, solved = np.random.default_rng(seed), Solved()
    nets = {}
    if twin:
        nets = {name: TorchNet.like(MLP([4, 32, n], optimizer=Adam(0.01), rng=rng)) for name, n in NETS.items()}
    reinforce_network("CartPole-v1", 0.99, 1000, baseline="value", on_episode=solved, rng=rng, **nets)
    return solved


NETS = {"net": 2, "critic": 1}


def torch_example(seed):
    import gymnasium as gym
    import torch

    torch.manual_seed(seed)
    layers = torch.nn.Linear(4, 128), torch.nn.Dropout(0.6), torch.nn.ReLU(), torch.nn.Linear(128, 2)
    net, env, solved = torch.nn.Sequential(*layers), gym.make("CartPole-v1"), Solved()
    adam, steps = torch.optim.Adam(net.parameters(), lr=1e-2), 0
    env.reset(seed=seed)
    while steps < 130_000:
        s, logs, rewards, done = env.reset()[0], [], [], False
        while not done:
            policy = torch.distributions.Categorical(logits=net(torch.from_numpy(s)))
            a = policy.sample()
            logs.append(policy.log_prob(a))
            s, r, terminated, truncated, _ = env.step(a.item())
            rewards.append(r)
            done = terminated or truncated
        G = np.zeros(len(rewards) + 1)
        for t in reversed(range(len(rewards))):
            G[t] = rewards[t] + 0.99 * G[t + 1]
        G = torch.tensor(G[:-1], dtype=torch.float32)
        G = (G - G.mean()) / (G.std() + 1e-8)
        adam.zero_grad()
        (-torch.stack(logs) * G).sum().backward()
        adam.step()
        steps += len(rewards)
        if solved(sum(rewards), steps):
            break
    return solved


def corridor(seed):
    start = dict(features=np.ones((4, 1)), theta0=np.array([[1.47], [-1.47]]))
    settings = dict(alpha=2.0**-13, p_min=0.001, max_steps=1000, every_step=True, **start)
    return reinforce(short_corridor(), 1.0, 1000, rng=np.random.default_rng(seed), **settings).returns


def corridor_loop(seed):
    rng, theta, x, returns = np.random.default_rng(seed), np.array([1.47, -1.47]), np.eye(2), []

    def probabilities():
        weights = np.exp(x @ theta - (x @ theta).max())
        return np.clip(weights / weights.sum(), 0.001, 0.999)

    for _ in range(1000):
        s, actions, rewards = 0, [], []
        while s != 3 and len(rewards) < 1000:
            actions.append(int(rng.random() < probabilities()[1]))
            right = actions[-1] != (s == 1)
            s = s + 1 if right else max(0, s - 1)
            rewards.append(-1.0)
        G = np.cumsum(rewards[::-1])[::-1]
        for a, g in zip(actions, G):
            theta = theta + 2.0**-13 * g * (x[a] - probabilities())
        returns.append(sum(rewards))
    return np.array(returns)


def timed(function, *args):
    start = time.process_time()
    result = function(*args)
    return time.process_time() - start, result


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=1000)
    options, rows = parser.parse_args(), []
    seeds = range(options.first, options.first + options.seeds)
    jobs = {
        "CartPole MLP": cartpole,
        "CartPole TorchNet": lambda s: cartpole(s, True),
        "CartPole torch example": torch_example,
    }
    for name, job in jobs.items():
        if options.only in name:
            reinforce_network("CartPole-v1", 0.99, 1, rng=np.random.default_rng(0))  # imports
            runs = [timed(job, seed) for seed in seeds]
            n_solved = sum(np.mean(run.returns[-100:]) >= 475 for _, run in runs)
            steps = int(np.median([run.steps for _, run in runs]))
            rows.append((name, np.median([t for t, _ in runs]), f"{n_solved} of {len(runs)} at 475, {steps} steps"))
            print(*rows[-1], flush=True)
    for name, job, n in (("corridor compiled", corridor, 20), ("corridor loop", corridor_loop, 2)):
        if options.only in name:
            corridor(0)  # compiles
            runs = [timed(job, seed) for seed in range(n)]
            last = np.mean([returns[-100:].mean() for _, returns in runs])
            rows.append((name, np.median([t for t, _ in runs]), f"last 100 episodes {last:.1f}"))
            print(*rows[-1], flush=True)
    where = [str(datetime.date.today()), platform.machine(), f"numpy {version('numpy')}, torch {version('torch')}"]
    new = {name: [name, f"{seconds:.3g}", outcome, *where] for name, seconds, outcome in rows}
    old = {row[0]: row for row in csv.reader(RESULTS.open())} if RESULTS.exists() else {}
    table = {"job": ["job", "cpu_seconds_median", "outcome", "date", "machine", "versions"]} | old | new
    with RESULTS.open("w", newline="") as file:
        csv.writer(file).writerows(table.values())


if __name__ == "__main__":
    main()
