"""Figure 61 again: eleven settings of PPO on seven MuJoCo tasks, three seeds each.

    python benchmarks/figure61.py smoke      3 settings, 2 tasks, 4,096 steps: under a minute
    python benchmarks/figure61.py quick      4 settings, 7 tasks, 3 seeds, 100,000 steps: about ten minutes on two cores
    python benchmarks/figure61.py tenth      11 settings, 7 tasks, 3 seeds, 100,000 steps: to figure61_tenth.csv
    python benchmarks/figure61.py full       the same with 1,000,000 steps: about nine CPU hours; to figure61.csv
    python benchmarks/figure61.py table      what the two tables in book/data/ hold, as scores

Runs are kept in _build/figure61/, one file each: stop when you like, the same command goes on. `tenth` and `full` add
finished runs to their table in book/data/, one row a run, and do not repeat what stands there; a run of 1,000,000 steps
is one of 100,000, too, since nothing depends on what is left of it: `full` adds that row as well. Settings are those of
Schulman et al. (2017), tables 1 and 3; details that the paper leaves open follow its authors' code (OpenAI Baselines,
ppo1): observations normalised, actions not cut to their range; the learning rate is constant, as in the paper's table
(in their code it falls to 0). Different here: the tasks are gymnasium's version 5 instead of version 1, and an episode
that a time limit ends is not taken for one that failed; variances of observations count at least 1e-4, there 1e-2;
weights start at Glorot and Bengio's spread, there with length 1 for each neuron.
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

from rlcore.ppo import PPOConfig, ppo
from rlcore.studies.figure61 import RANDOM, SETTINGS, TASKS, average, scores
from rlcore.studies.tables import read
from rlcore.sweep import sweep

ROOT = Path(__file__).parents[1]
DATA = ROOT / "book" / "data"
TABLES = {"tenth": DATA / "figure61_tenth.csv", "full": DATA / "figure61.csv"}
POINTS = 10
COLUMNS = ["task", "setting", "seed", "steps", "episodes", "score", "kl", "largest_kl", "entropy", "beta", "seconds"]
COLUMNS += [f"return_{i}" for i in range(1, POINTS + 1)]


def run(task, setting, n_steps, rng, *, anneal=False):
    """One run: mean return of the last 100 episodes, what the updates did, and the returns in tenths of the run."""
    if setting == RANDOM:
        return random_run(task, rng)
    plain = dict(clip_actions=False, scale_actions=False)
    config = PPOConfig(normalise_observations=True, anneal=anneal, **plain, **SETTINGS[setting])
    ends = []
    done = ppo(f"{task}-v5", rng=rng, n_steps=n_steps, config=config, on_episode=lambda _, steps: ends.append(steps))
    result = summary(done, ends, n_steps)
    return result if anneal else result | {"tenth": summary(done, ends, n_steps // 10)}


def summary(done, ends, n_steps):
    """What a run came to by n_steps; without annealing it does not depend on what follows. ends: steps, by episode."""
    h = done.history
    h = h[: np.searchsorted(h.steps, n_steps) + 1]
    ends = np.array(ends, int)
    ends = ends[ends <= h.steps[-1]]
    returns, part = done.returns[: ends.size], np.minimum(ends * POINTS // n_steps, POINTS - 1)
    curve = {f"return_{i + 1}": _mean(returns[part == i]) for i in range(POINTS)}
    diagnosis = dict(kl=np.median(h.kl), largest_kl=h.kl.max(), entropy=h.entropy[-1], beta=h.beta[-1])
    totals = dict(steps=int(h.steps[-1]), episodes=returns.size, score=_mean(returns[-100:]))
    return totals | {name: float(value) for name, value in diagnosis.items()} | curve


def random_run(task, rng):
    """Mean return of 100 episodes whose actions are uniform in the action space."""
    import gymnasium as gym

    env = gym.make(f"{task}-v5", disable_env_checker=True)
    env.reset(seed=int(rng.integers(2**31)))
    low, high, returns, steps = env.action_space.low, env.action_space.high, [], 0
    for _ in range(100):
        env.reset()
        total, done = 0.0, False
        while not done:
            _, r, terminated, truncated, _ = env.step(rng.uniform(low, high).astype(np.float32))
            total, steps, done = total + r, steps + 1, terminated or truncated
        returns.append(total)
    return dict(steps=steps, episodes=100, score=_mean(returns))


def _mean(values):
    return float(np.mean(values)) if len(values) else None


# ---------------------------------------------------------------------- the table


def row(record):
    """A finished run as a row of the table."""
    return record.result | record.setting | dict(seed=record.seed, seconds=record.seconds)


def tenth_row(record):
    """What a run of `full` had come to after a tenth of its steps; random episodes are the same in both tables."""
    result = record.result if record.setting["setting"] == RANDOM else record.result["tenth"]
    return result | record.setting | dict(seed=record.seed)


def key(row):
    return row["task"], row["setting"], int(row["seed"])


def add(rows, path):
    """Those rows that the table lacks are written to it. Returns all of its rows."""
    there = read(path)
    known = {key(r) for r in there}
    there += [r for r in rows if key(r) not in known]
    write(there, path)
    return there


def write(rows, path):
    """The table, sorted; its first lines say where the numbers come from."""
    order = [RANDOM, *SETTINGS]
    rows = sorted(rows, key=lambda r: (TASKS.index(r["task"]), order.index(r["setting"]), r["seed"]))
    path.parent.mkdir(exist_ok=True)
    part = path.with_suffix(".part")
    with open(part, "w", newline="", encoding="utf-8") as file:
        file.write(provenance(path))
        out = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        out.writeheader()
        out.writerows({c: _short(r.get(c)) for c in COLUMNS} for r in rows)
    part.replace(path)


def provenance(path):
    import datetime
    import importlib.metadata as metadata
    import platform

    names = "numpy", "gymnasium", "mujoco"
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in names)
    return (
        f"# python benchmarks/figure61.py {'full' if path == TABLES['full'] else 'tenth'}, {datetime.date.today()}\n"
        f"# Python {platform.python_version()}, {versions}; rng = default_rng(seed)\n"
        "# score: mean return of the last 100 episodes; kl: median over updates; return_i: mean in the i-th tenth;\n"
        "# seconds: wall time, two runs side by side; none where a run was paused or other work went on, or where the\n"
        "# row is the first tenth of a run of 1,000,000 steps\n"
    )


def _short(value):
    if value is None or isinstance(value, str):
        return value or ""
    return int(value) if float(value).is_integer() else f"{value:.6g}"


# ---------------------------------------------------------------------- tiers


def main(tier):
    """Run what the tier still lacks; the rows of all that it has."""
    settings, tasks, seeds, n_steps = list(SETTINGS), TASKS, 3, 1_000_000 if tier == "full" else 100_000
    if tier == "smoke":
        settings, tasks, seeds, n_steps = ["none", "clip 0.2", "adaptive 0.01"], TASKS[3:5], 1, 4096
    elif tier == "quick":
        settings = ["none", "clip 0.2", "adaptive 0.01", "fixed 3"]
    path = TABLES.get(tier)
    rows = read(path) if path else []
    known = {key(r) for r in rows}
    for seed in range(seeds):
        for task in tasks:
            wanted = [dict(task=task, setting=s, n_steps=n_steps) for s in [RANDOM, *settings]]
            wanted = [w for w in wanted if (task, w["setting"], seed) not in known]
            if wanted:
                print(f"{task}, seed {seed}", file=sys.stderr)
                records = sweep(run, wanted, [seed], ROOT / "_build" / "figure61", progress=True)
                ended = [record for record in records if record.error is None]
                if tier == "full":
                    add([tenth_row(record) for record in ended], TABLES["tenth"])
                new = [row(record) for record in ended]
                rows = add(new, path) if path else rows + new
    return rows


def show(rows):
    """Scores of the settings that were run, best first."""
    table = scores(rows)
    names = [i for i, by_task in enumerate(table) if not np.isnan(by_task).all()]
    print(f"{'setting':16}{'score':>7}{'runs':>6}   " + " ".join(f"{t[:12]:>12}" for t in TASKS))
    for mean, i in sorted(zip(average(table[names]), names), reverse=True):
        ran = ~np.isnan(table[i])
        cells = " ".join(f"{s[r].mean():12.2f}" if r.any() else " " * 12 for s, r in zip(table[i], ran))
        print(f"{list(SETTINGS)[i]:16}{mean:7.2f}{ran.sum():6d}   {cells}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tier", choices=["smoke", "quick", *TABLES, "table"])
    tier = parser.parse_args().tier
    try:
        for rows in [read(path) for path in TABLES.values()] if tier == "table" else [main(tier)]:
            show(rows)
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on from here")
