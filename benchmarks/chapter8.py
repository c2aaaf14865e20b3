"""The slow experiments of chapter 8: PPO on cart-pole and in a maze, actions cut to their range, a step that falls.

    python benchmarks/chapter8.py          what is not done yet, to book/data/chapter8_*.csv: an hour of a core
    python benchmarks/chapter8.py table    what the tables hold

Runs are kept in _build/chapter8/, one file each: stop when you like, the same command goes on. `chapter8_runs.csv` has
a row for each run, `chapter8_curves.csv` one for each setting and rollout, over the seeds; `chapter8_actions.csv` the
runs on HalfCheetah, Swimmer and Reacher; `chapter8_late.csv` those on the double pendulum, a million steps each.
"""

import argparse
import csv
import datetime
import platform
import sys
from importlib.metadata import version
from pathlib import Path

import figure61
import gymnasium as gym
import numpy as np

from rlcore.envs import MDPEnv, dyna_maze
from rlcore.ppo import PPOConfig, ppo
from rlcore.studies.figure61 import SETTINGS
from rlcore.studies.tables import read
from rlcore.sweep import sweep
from rlcore.trpo import TRPOConfig, trpo

ROOT = Path(__file__).parents[1]
DATA, STORE = ROOT / "book" / "data", ROOT / "_build" / "chapter8"
ROLLOUTS, LAST = 60, 10
COMMON = dict(hidden=(32,), horizon=512, gamma=0.99, lam=0.95, epochs=10, minibatch=64)
CART_POLE = (  # name: what differs from the objective clip 0.2 with Adam 3e-3
    SETTINGS
    | {f"lr {lr:g}": dict(lr=lr) for lr in (1e-5, 1e-4, 3e-4, 1e-3, 1e-2, 3e-2, 1e-1)}
    | {"fixed 1, lr 0.01": dict(objective="kl_fixed", beta=1.0, lr=0.01)}
    | {"adaptive 0.01 from 100": dict(objective="kl_adaptive", beta=100.0)}
    | {f"c2 {c2:g}": dict(c2=c2) for c2 in (0.01, 0.1)}
    | {"shared": dict(shared=True), "shared, c1 0.001": dict(shared=True, c1=0.001), "c1 0.001": dict(c1=0.001)}
    | {"advantages as they are": dict(normalise_advantages=False), "lam 1": dict(lam=1.0), "lam 0": dict(lam=0.0)}
    | {"1 epoch": dict(epochs=1), "no minibatches": dict(minibatch=512), "anneal": dict(anneal=True)}
    | {"observations normalised": dict(normalise_observations=True)}
)
MAZE = {f"maze, c2 {c2:g}": dict(c2=c2) for c2 in (0.0, 0.01, 0.1)}


def cart_pole(setting, rng):
    if setting == "trpo":
        return summary(trpo("CartPole-v1", rng=rng, n_steps=n_steps(), config=TRPOConfig(**COMMON)))
    config = PPOConfig(**COMMON | dict(lr=3e-3) | CART_POLE[setting])
    return summary(ppo("CartPole-v1", rng=rng, n_steps=n_steps(), config=config))


def maze(setting, rng):
    env = gym.wrappers.TimeLimit(gym.wrappers.FlattenObservation(MDPEnv(dyna_maze())), 60)
    return summary(ppo(env, rng=rng, n_steps=n_steps(), config=PPOConfig(**COMMON | dict(lr=3e-3) | MAZE[setting])))


def actions(task, cut, rng):
    """Neither clipping nor penalty as in figure 61, actions cut to their range or not; a tenth of the steps, or all."""
    config = PPOConfig(objective="none", normalise_observations=True, clip_actions=cut, scale_actions=False)
    run = ppo(f"{task}-v5", rng=rng, n_steps=1_000_000 if task == "Reacher" else 100_000, config=config)
    h, std = run.history, np.exp(run.policy.log_std).max()
    return dict(score=run.returns[-100:].mean(), kl=np.median(h.kl), largest_kl=h.kl.max(), largest_std=float(std))


def n_steps():
    return ROLLOUTS * COMMON["horizon"]


def summary(run):
    """Returns and KL rollout by rollout; a rollout in which no episode ended repeats the one before."""
    h = run.history[:ROLLOUTS]
    rollout = np.searchsorted(h.steps, np.cumsum(run.lengths))
    returns = [run.returns[rollout == i].mean() if (rollout == i).any() else np.nan for i in range(len(h))]
    for i in np.flatnonzero(np.isnan(returns)):
        returns[i] = returns[i - 1] if i else 0.0
    record = dict(final=np.mean(returns[-LAST:]), mean=np.mean(returns), mean_kl=h.kl.mean(), largest_kl=h.kl.max())
    record |= dict(last_entropy=h.entropy[-1], curve=returns, kl=h.kl, entropy=h.entropy)
    return record | (dict(beta=h.beta) if "beta" in h.dtype.names else {})


def main():
    """A few seeds of everything, then the others."""
    DATA.mkdir(exist_ok=True)
    for n_seeds in (3, 5, 8):
        names = [dict(setting=name) for name in [*CART_POLE, "trpo"]]
        records = sweep(cart_pole, names, range(n_seeds), STORE, progress=True)
        records += sweep(maze, [dict(setting=name) for name in MAZE], range(2 * n_seeds), STORE, progress=True)
        tables([record for record in records if record.error is None])
    records = []
    for task in ("HalfCheetah", "Swimmer", "Reacher"):
        records += sweep(actions, [dict(task=task, cut=cut) for cut in (False, True)], range(3), STORE, progress=True)
        rows = [r.result | r.setting | dict(seed=r.seed, cut=int(r.setting["cut"])) for r in records if not r.error]
        write("chapter8_actions.csv", ["task", "cut", "seed", "score", "kl", "largest_kl", "largest_std"], rows)
    common = dict(task="InvertedDoublePendulum", setting="clip 0.2", n_steps=1_000_000)
    records = sweep(figure61.run, [common | dict(anneal=a) for a in (False, True)], range(3), STORE, progress=True)
    rows = [r.result | r.setting | dict(seed=r.seed, anneal=int(r.setting["anneal"])) for r in records if not r.error]
    columns = ["anneal", "seed", "score", "kl", "largest_kl", "entropy", *figure61.COLUMNS[-figure61.POINTS :]]
    write("chapter8_late.csv", columns, rows)


def tables(records):
    columns = ["setting", "seed", "final", "mean", "mean_kl", "largest_kl", "last_entropy"]
    write("chapter8_runs.csv", columns, [r.result | r.setting | dict(seed=r.seed) for r in records])
    columns = ["setting", "rollout", "low", "mean", "high", "kl", "largest_kl", "entropy", "entropy_low"]
    columns += ["entropy_high", "beta"]
    write("chapter8_curves.csv", columns, curves(records))


def curves(records):
    """A row for each setting and rollout: lowest, mean and highest return of the seeds, median and largest KL, ..."""
    for name in dict.fromkeys(record.setting["setting"] for record in records):
        of = [record.result for record in records if record.setting["setting"] == name]
        for i in range(min(len(result["curve"]) for result in of)):
            at = {key: np.array([result[key][i] for result in of]) for key in of[0] if isinstance(of[0][key], list)}
            G, kl, entropy = at["curve"], at["kl"], at["entropy"]
            row = dict(setting=name, rollout=i + 1, low=G.min(), mean=G.mean(), high=G.max())
            row |= dict(kl=np.median(kl), largest_kl=kl.max())
            row |= dict(entropy=entropy.mean(), entropy_low=entropy.min(), entropy_high=entropy.max())
            yield row | (dict(beta=np.median(at["beta"])) if "beta" in at else {})


def write(name, columns, rows):
    """A table in book/data/; its first lines say where the numbers come from."""
    versions = ", ".join(f"{package} {version(package)}" for package in ("numpy", "gymnasium", "mujoco"))
    with open(DATA / name, "w", newline="", encoding="utf-8") as file:
        file.write(f"# python benchmarks/chapter8.py, {datetime.date.today()}\n")
        file.write(f"# Python {platform.python_version()}, {versions}; rng = default_rng(seed)\n")
        out = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        out.writeheader()
        out.writerows({key: _short(row.get(key)) for key in columns} for row in rows)


def _short(value):
    if value is None or isinstance(value, str):
        return value or ""
    return f"{value:.5g}"


def show():
    rows = read(DATA / "chapter8_runs.csv")
    print(f"{'setting':26}{'final':>7}{'worst':>7}{'mean':>7}{'kl':>9}{'largest':>9}{'runs':>6}")
    for name in dict.fromkeys(row["setting"] for row in rows):
        of = [row for row in rows if row["setting"] == name]
        final, mean, kl, top = (
            np.array([row[key] for row in of]) for key in ("final", "mean", "mean_kl", "largest_kl")
        )
        print(
            f"{name:26}{final.mean():7.2f}{final.min():7.2f}{mean.mean():7.2f}{kl.mean():9.4f}{top.max():9.3f}{len(of):6}"
        )
    for row in [*read(DATA / "chapter8_actions.csv"), *read(DATA / "chapter8_late.csv")]:
        print(*(f"{value:>12.5g}" if isinstance(value, float) else f"{value:>12}" for value in row.values()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="?", choices=["run", "table"], default="run")
    try:
        if parser.parse_args().what == "run":
            main()
        show()
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on from here")
