"""What chapter 7 does once: the two cart-poles of figure 56, and two players who learn to bluff."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from rlcore.core.checks import as_floats, check_flag, check_fraction, check_positive, check_probability, show
from rlcore.core.results import Run
from rlcore.core.rules import anything, checked, choice, count
from rlcore.core.samples import probabilities
from rlcore.core.types import ArrayLike, Floats, Rng
from rlcore.nn import MLP
from rlcore.optimizers import Adam
from rlcore.reinforce import reinforce_network
from rlcore.studies.tables import Rows

STEPS, WINDOW, ENOUGH = 200, 100, 195
Runs = namedtuple("Runs", "solved last steps blocks")


@checked(baseline=anything, hidden=count(), stop=check_flag)
def train(
    n_episodes: int, *, baseline: str = "time", hidden: int = 16, lr: float = 0.01, gamma: float = 0.99,
    stop: bool = False, rng: Rng,
) -> Run:  # fmt: skip
    """A run of `reinforce_network` on CartPole-v1, cut at 200 steps: hidden tanh neurons, Adam.

    Parameters
    ----------
    n_episodes : int
        Episodes, at most.
    baseline : str
        As of `reinforce_network`.
    hidden : int
        Neurons of the one hidden layer.
    lr : float
        Learning rate.
    gamma : float
        Discount, in [0, 1].
    stop : bool
        Whether to end after the first 100 episodes that average 195 steps.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Run
        The run.

    Notes
    -----
    Ledger: fig-56, ex-cartpole.
    """
    lengths, net = [], MLP([4, hidden, 2], optimizer=Adam(lr), rng=rng)

    def on_episode(length, _):
        lengths.append(length)
        return stop and solved.unchecked(lengths[-WINDOW:]) is not None

    settings = dict(baseline=baseline, max_steps=STEPS, net=net, on_episode=on_episode)
    return reinforce_network("CartPole-v1", gamma, n_episodes, **settings, rng=rng)


def _lengths(name, lengths, given):
    lengths = as_floats(name, lengths)
    if lengths.ndim != 1 or not (lengths >= 0).all():
        raise ValueError(f"{name}: got {show(lengths)}, must be (n,) numbers of steps")
    return lengths


@checked(lengths=_lengths)
def solved(lengths: ArrayLike) -> int | None:
    """First of the first 100 episodes that average 195 steps.

    Parameters
    ----------
    lengths : ArrayLike
        (n,), steps of each episode.

    Returns
    -------
    int | None
        Its number, from 1; None where never.

    Notes
    -----
    Ledger: fig-56.

    Examples
    --------
    >>> from rlcore.studies.ch07 import solved
    >>> solved([10] * 5 + [200] * 100)
    4
    """
    total = np.append(0, np.cumsum(lengths))
    found = np.flatnonzero(total[WINDOW:] - total[:-WINDOW] >= ENOUGH * WINDOW)
    return int(found[0]) + 1 if found.size else None


BASELINES = ("none", "time", "value", "normalised")


def _rows(name, rows, given):
    """The rule of a table of runs."""
    columns = {"baseline", "hidden", "lr", "gamma", "solved", "last", "steps", "blocks"}
    if not isinstance(rows, list) or not all(isinstance(row, dict) and columns <= set(row) for row in rows):
        raise ValueError(f"{name}: got {show(rows)}, must be a table of runs, as rlcore.tables.read gives it")
    return rows


@checked(rows=_rows, baseline=choice(*BASELINES), hidden=count())
def runs(rows: Rows, *, baseline: str = "time", hidden: int = 16, lr: float = 0.01, gamma: float = 0.99) -> Runs:
    """The table's runs of a setting, 1,000 episodes each, one a seed.

    Parameters
    ----------
    rows : Rows
        Of book/data/figure56.csv, as `rlcore.studies.tables.read` gives them.
    baseline : str
        "none" for plain REINFORCE, "time", "value" or "normalised".
    hidden : int
        Neurons of the one hidden layer.
    lr : float
        Learning rate.
    gamma : float
        Discount.

    Returns
    -------
    Runs
        solved (n,), as of `solved`, NaN where never; last (n,), mean length of the last 100; steps (n,) of all
        episodes; blocks (n, 50), mean length of each 20 episodes.

    Raises
    ------
    ValueError
        Where no run has this setting.

    Notes
    -----
    Ledger: fig-56.
    """
    setting = dict(baseline=baseline, hidden=hidden, lr=lr, gamma=gamma)
    chosen = [row for row in rows if all(row[name] == value for name, value in setting.items())]
    if not chosen:
        raise ValueError(f"rows: got none with {setting}, must have a run at least")
    numbers = (np.array([row[name] for row in chosen], float) for name in ("solved", "last", "steps"))
    return Runs(*numbers, np.array([row["blocks"].split() for row in chosen], float))


POT, BET = 2.0, 1.0


def _with_x(name, y, given):
    """The rule of numbers in [0, 1] beside x."""
    y = probabilities(name, y)
    try:
        np.broadcast_shapes(y.shape, given["x"].shape)
    except ValueError:
        raise ValueError(f"{name}: got shape {y.shape}, must be a number or that of x, {given['x'].shape}") from None
    return y


@checked(x=probabilities, y=_with_x)
def bluff_values(x: ArrayLike, y: ArrayLike) -> Floats:
    """Expected gain of the bettor, who bluffs with probability x while the other calls with y.

    The pot is 2, the bet 1. The bettor has the better hand half of the time, and then bets; with the worse it bets
    (bluffs) or checks and loses the pot. Equilibrium: x = 1/3, y = 2/3, value 4/3.

    Parameters
    ----------
    x : ArrayLike
        In [0, 1], a number or an array.
    y : ArrayLike
        Likewise.

    Returns
    -------
    Floats
        The gain, as x and y.

    Notes
    -----
    Ledger: ex-bluff.

    References
    ----------
    von Neumann and Morgenstern (1944), chapter 19, in spirit.

    Examples
    --------
    >>> from rlcore.studies.ch07 import bluff_values
    >>> bluff_values(1 / 3, [0.0, 0.5, 1.0]).round(3)
    array([1.333, 1.333, 1.333])
    """
    good = y * (POT + BET) + (1 - y) * POT
    bad = x * (-y * BET + (1 - y) * POT)
    return 0.5 * good + 0.5 * bad


@checked(x=probabilities)
def bluff_guarantee(x: ArrayLike) -> Floats:
    """What bluffing with probability x gains against the caller who does best against it.

    Parameters
    ----------
    x : ArrayLike
        In [0, 1], a number or an array.

    Returns
    -------
    Floats
        As x.

    Notes
    -----
    Ledger: ex-bluff.
    """
    return np.minimum(bluff_values(x, 0.0), bluff_values(x, 1.0))


@checked(x=probabilities, y=_with_x)
def bluff_gradients(x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    """Derivatives of each player's own gain with respect to its preference.

    Both are softmax policies of two actions: x = 1 / (1 + exp(-theta)), and y alike.

    Parameters
    ----------
    x : ArrayLike
        Probability of bluffing.
    y : ArrayLike
        Probability of calling.

    Returns
    -------
    d_bettor : Floats
        With respect to the preference for bluffing.
    d_caller : Floats
        With respect to the preference for calling.

    Notes
    -----
    Ledger: ex-bluff.
    """
    d_x = 0.5 * (POT - y * (POT + BET))
    d_y = -0.5 * (BET - x * (POT + BET))
    return x * (1 - x) * d_x, y * (1 - y) * d_y


@checked(
    x=check_fraction, y=check_fraction, alpha=check_positive, epsilon=check_probability,
    caller=choice("gradient", "best"),
)  # fmt: skip
def bluff_learning(
    x: float, y: float, n_steps: int, *, alpha: float, epsilon: float | None = None, caller: str = "gradient"
) -> Floats:
    """Both players learn with exact gradients, the bettor first.

    Of two learning players the policies circle the equilibrium; their mean goes to it. Against the best caller x
    itself does, up to alpha.

    Parameters
    ----------
    x : float
        Where the bettor starts, in (0, 1).
    y : float
        Where the caller starts, in (0, 1).
    n_steps : int
        Steps of each.
    alpha : float
        Step size.
    epsilon : float | None
        Instead of gradients: each player takes the action that is better against the other's last policy with
        probability 1 - epsilon / 2.
    caller : str
        "gradient", or "best" for one who always answers with what is best against x.

    Returns
    -------
    Floats
        (n_steps + 1, 2), the probabilities x, y.

    Notes
    -----
    Ledger: ex-bluff, cl-102.
    """
    theta, history = [np.log(p / (1 - p)) for p in (x, y)], [(x, y)]
    for _ in range(n_steps):
        for player in (0, 1):
            slope = bluff_gradients.unchecked(x, y)[player]
            theta[player] += alpha * slope
            p = 1 / (1 + np.exp(-theta[player]))
            if epsilon is not None:
                p = 1 - epsilon / 2 if slope > 0 else epsilon / 2
            if player == 1 and caller == "best":
                p = float(bluff_values.unchecked(x, 1.0) < bluff_values.unchecked(x, 0.0))
            x, y = (p, y) if player == 0 else (x, p)
        history.append((x, y))
    return np.array(history, float)
