"""Figure 56's runs: REINFORCE with a small network on the cart-pole, 1,000 episodes cut at 200 steps.

    python benchmarks/figure56.py      about ten minutes on two cores; writes book/data/figure56.csv

Three baselines with 10 seeds, then hidden neurons x learning rate x gamma with the per-time-step mean as baseline and 5
seeds. Runs are kept in _build/figure56/, one file each: stop when you like, the same command goes on.
"""

import csv
import datetime
import itertools
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np

from rlcore.studies.ch07 import WINDOW, solved, train
from rlcore.sweep import sweep

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "book" / "data" / "figure56.csv"
BASELINES = ["time", None, "normalised"]
GRID = [
    dict(hidden=h, lr=lr, gamma=g) for h, lr, g in itertools.product([4, 16, 64], [0.003, 0.01, 0.03], [0.9, 0.99, 1.0])
]
USUAL = dict(hidden=16, lr=0.01, gamma=0.99)
EPISODES, BLOCK = 1000, 20


def run(baseline, hidden, lr, gamma, rng):
    """Mean length of each 20 episodes, of the last 100, and the first episode of 100 that average 195 (None: never)."""
    lengths = train(EPISODES, baseline=baseline, hidden=hidden, lr=lr, gamma=gamma, rng=rng).lengths
    blocks = lengths.reshape(-1, BLOCK).mean(axis=1)
    return dict(solved=solved(lengths), last=lengths[-WINDOW:].mean(), blocks=blocks, steps=int(lengths.sum()))


def main():
    store = ROOT / "_build" / "figure56"
    settings = [dict(baseline=b, **USUAL) for b in BASELINES]
    records = sweep(run, settings, range(10), store, progress=True)
    grid = [dict(baseline="time", **g) for g in GRID if g != USUAL]
    records += sweep(run, grid, range(5), store, progress=True)
    with open(TABLE, "w", newline="", encoding="utf-8") as file:
        file.write(f"# python benchmarks/figure56.py, {datetime.date.today()}\n")
        file.write(
            f"# Python {platform.python_version()}, numpy {version('numpy')}, gymnasium {version('gymnasium')}; "
        )
        file.write("rng = default_rng(seed)\n")
        file.write(f"# solved: first of {WINDOW} episodes that average 195 steps; last: mean of the last {WINDOW}; ")
        file.write(f"blocks: mean of each {BLOCK}\n")
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["baseline", "hidden", "lr", "gamma", "seed", "steps", "solved", "last", "blocks"])
        for record in records:
            s, r = record.setting, record.result
            blocks = " ".join(f"{b:g}" for b in np.round(r["blocks"], 1))
            out.writerow([s["baseline"] or "none", s["hidden"], s["lr"], s["gamma"], record.seed, r["steps"],
                          r["solved"], f"{r['last']:g}", blocks])  # fmt: skip


if __name__ == "__main__":
    main()
