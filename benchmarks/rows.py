"""Rows of results/*.csv for the benchmarks of chapter 8."""

import csv
import datetime
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

RESULTS = Path(__file__).parent / "results"
PACKAGES = "numpy", "gymnasium", "mujoco", "torch", "stable-baselines3", "sb3-contrib"


class Solved:
    """on_episode that stops, if it may, when the last 100 returns average 475."""

    def __init__(self, stop=True):
        self.returns, self.steps, self.stop = [], 0, stop

    def __call__(self, G, steps):
        self.returns.append(float(G))
        self.steps = steps
        return self.stop and self.solved

    @property
    def solved(self):
        return len(self.returns) >= 100 and np.mean(self.returns[-100:]) >= 475


def solved_rows(jobs, seeds, timed):
    """Rows of jobs {name: job(seed)} that take turns: median CPU seconds, how many seeds solved CartPole, steps."""
    runs = {name: [] for name in jobs}
    for seed in seeds:
        for name, job in jobs.items():
            runs[name].append(timed(job, seed))
    rows = []
    for name, done in runs.items():
        solved, steps = sum(e.solved for _, e in done), int(np.median([e.steps for _, e in done]))
        outcome = f"{solved} of {len(done)} at 475, {steps} steps"
        rows.append((name, np.median([t for t, _ in done]), "CPU s", outcome))
    return rows


def save(name, rows, against):
    """Print rows (job, value, unit, outcome) with their ratio to one of them, and keep them in results/name.csv."""
    base = next(value for job, value, *_ in rows if job == against)
    where = [str(datetime.date.today()), platform.machine(), ", ".join(f"{p} {_version(p)}" for p in PACKAGES)]
    path, header = (
        RESULTS / f"{name}.csv",
        ["job", "value", "unit", "times better", "outcome", "date", "machine", "versions"],
    )
    old = {row[0]: row for row in csv.reader(path.open())} if path.exists() else {}
    table = {"job": header} | old
    for job, value, unit, outcome in rows:
        ratio = base / value if unit == "CPU s" else value / base
        table[job] = [job, f"{value:.4g}", unit, f"{ratio:.1f}", outcome, *where]
        print(f"{job:34}{value:10.4g} {unit:12}{ratio:6.1f}x  {outcome}", flush=True)
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(table.values())


def _version(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
