"""Figure 56: REINFORCE with a small network on the cart-pole, and the table of its runs (chapter 7)."""

from collections import namedtuple

import numpy as np

from rlcore.mdp import as_floats, check_rng
from rlcore.nn import MLP, Adam
from rlcore.reinforce import reinforce

__all__ = ["WINDOW", "Runs", "runs", "solved", "train"]

STEPS, WINDOW, ENOUGH = 200, 100, 195
Runs = namedtuple("Runs", "solved last steps blocks")


def train(n_episodes, *, baseline="time", hidden=16, lr=0.01, gamma=0.99, stop=False, rng):
    """Run of `reinforce` on CartPole-v1, cut at 200 steps, with hidden tanh neurons and Adam(lr). fig-56, ex-cartpole

    baseline: as in `reinforce`. stop: at the end of the first 100 episodes that average 195, or after n_episodes.
    """
    lengths, net = [], MLP([4, hidden, 2], optimizer=Adam(lr), rng=check_rng(rng))

    def on_episode(length, _):
        lengths.append(length)
        return stop and solved(lengths[-WINDOW:]) is not None

    settings = dict(gamma=gamma, baseline=baseline, max_steps=STEPS, net=net, on_episode=on_episode)
    return reinforce("CartPole-v1", n_episodes=n_episodes, **settings, rng=rng)


def solved(lengths):
    """First of the first 100 episodes that average 195 steps, from 1; None where never. lengths: (n,). fig-56"""
    total = np.append(0, np.cumsum(as_floats("lengths", lengths)))
    found = np.flatnonzero(total[WINDOW:] - total[:-WINDOW] >= ENOUGH * WINDOW)
    return int(found[0]) + 1 if found.size else None


def runs(rows, *, baseline="time", hidden=16, lr=0.01, gamma=0.99):
    """The table's runs of a setting, n of 1,000 episodes, one a seed. fig-56

    rows: of book/data/figure56.csv, as rlcore.tables.read gives them. baseline: "none" for plain REINFORCE. Returns
    Runs: solved (n,), as of `solved`, NaN where never; last (n,), mean length
    of the last 100; steps (n,) of all episodes; blocks (n, 50), mean length of each 20 episodes.
    """
    setting = dict(baseline=baseline, hidden=hidden, lr=lr, gamma=gamma)
    chosen = [row for row in rows if all(row[name] == value for name, value in setting.items())]
    if not chosen:
        raise ValueError(f"rows: got none with {setting}, must have a run at least")
    numbers = (np.array([row[name] for row in chosen], float) for name in ("solved", "last", "steps"))
    return Runs(*numbers, np.array([row["blocks"].split() for row in chosen], float))
