"""Figure 61: the published scores, the table of our runs, and how well the two agree (chapter 8)."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from rlcore.core.checks import as_floats, check_finite, check_index, finite, show
from rlcore.core.rules import checked
from rlcore.core.types import ArrayLike, Floats, Rng
from rlcore.studies.tables import Rows

TASKS = ["HalfCheetah", "Hopper", "InvertedDoublePendulum", "InvertedPendulum", "Reacher", "Swimmer", "Walker2d"]

SETTINGS = {  # name: what differs from PPOConfig()
    "none": dict(objective="none"),
    "clip 0.1": dict(objective="clip", clip=0.1),
    "clip 0.2": dict(objective="clip", clip=0.2),
    "clip 0.3": dict(objective="clip", clip=0.3),
    "adaptive 0.003": dict(objective="kl_adaptive", d_target=0.003),
    "adaptive 0.01": dict(objective="kl_adaptive", d_target=0.01),
    "adaptive 0.03": dict(objective="kl_adaptive", d_target=0.03),
    "fixed 0.3": dict(objective="kl_fixed", beta=0.3),
    "fixed 1": dict(objective="kl_fixed", beta=1.0),
    "fixed 3": dict(objective="kl_fixed", beta=3.0),
    "fixed 10": dict(objective="kl_fixed", beta=10.0),
}

# Source: Schulman et al. (2017), table 1, in the order of SETTINGS. table-figure-61
PUBLISHED = np.array([-0.39, 0.76, 0.82, 0.70, 0.68, 0.74, 0.71, 0.62, 0.71, 0.72, 0.69])

RANDOM = "random"
Line = namedtuple("Line", "setting published ours low high runs rank_published rank_ours")


def _rows(name, rows, given):
    """The rule of a table of runs: of settings and tasks that are known, each with a seed and a score or None."""
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ValueError(f"{name}: got {show(rows)}, must be a list of rows, as rlcore.tables.read gives them")
    for row in rows:
        for column, known in (("setting", [RANDOM, *SETTINGS]), ("task", TASKS)):
            if row.get(column) not in known:
                raise ValueError(f"{column}: got {row.get(column)!r}, must be one of {', '.join(known)}")
        check_index("seed", row.get("seed"), 10_000)
        if row.get("score") is not None:
            check_finite("score", row["score"])
    return rows


@checked(rows=_rows)
def scores(rows: Rows) -> Floats:
    """Score of every run: 0 for the random policy, 1 for the best run of the task.

    Parameters
    ----------
    rows : Rows
        As `rlcore.studies.tables.read` gives them.

    Returns
    -------
    Floats
        (11 settings, 7 tasks, n seeds); NaN where a run is missing, or the task's random policy.

    Notes
    -----
    Ledger: fig-61.

    References
    ----------
    Schulman et al. (2017), section 6.1.
    """
    names, n_seeds = [RANDOM, *SETTINGS], 1 + max((int(row["seed"]) for row in rows), default=0)
    table = np.full((len(names), len(TASKS), n_seeds), np.nan)
    for row in rows:
        place = names.index(row["setting"]), TASKS.index(row["task"]), int(row["seed"])
        table[place] = np.nan if row["score"] is None else row["score"]
    for k in range(len(TASKS)):
        random, runs = table[0, k], table[1:, k]
        if np.isnan(random).all() or np.isnan(runs).all():
            table[:, k] = np.nan
        else:
            floor = np.nanmean(random)
            table[:, k] = (table[:, k] - floor) / (np.nanmax(runs) - floor)
    return table[1:]


def _whole(table):
    """Which tasks count: those with at least one run of every setting."""
    return (~np.isnan(table)).any(axis=2).all(axis=0)


def _table(name, table, given):
    """The rule of scores (settings, tasks, seeds), NaN where a run is missing."""
    table = as_floats(name, table)
    if table.ndim != 3 or 0 in table.shape[:2]:
        raise ValueError(f"{name}: got shape {table.shape}, must be (settings, tasks, seeds), as scores gives it")
    if np.isinf(table).any():
        raise ValueError(f"{name}: contains infinity, must be scores, NaN where a run is missing")
    return table


def _of_settings(name, table, given):
    table = _table(name, table, given)
    if len(table) != len(SETTINGS):
        raise ValueError(f"{name}: got shape {table.shape}, must be ({len(SETTINGS)}, tasks, seeds)")
    return table


@checked(table=_table)
def average(table: ArrayLike) -> Floats:
    """Mean score of each setting over seeds, then over the tasks that have a run of every setting.

    Parameters
    ----------
    table : ArrayLike
        (11, 7, n seeds), from `scores`.

    Returns
    -------
    Floats
        (11,); NaN where no such task is.

    Notes
    -----
    Ledger: fig-61.
    """
    whole = table[:, _whole(table)]
    return np.nanmean(whole, axis=2).mean(axis=1) if whole.size else np.full(len(table), np.nan)


@checked(table=_table)
def by_seed(table: ArrayLike) -> Floats:
    """Mean score of each setting and seed over the tasks that count.

    Parameters
    ----------
    table : ArrayLike
        (11, 7, n seeds), from `scores`.

    Returns
    -------
    Floats
        (11, n seeds); NaN where one of its runs lacks.
    """
    whole = table[:, _whole(table)]
    return whole.mean(axis=1) if whole.size else np.full((len(table), table.shape[2]), np.nan)


@checked(table=_of_settings)
def comparison(table: ArrayLike) -> list[Line]:
    """Published and our score of each setting, side by side.

    Parameters
    ----------
    table : ArrayLike
        (11, 7, n seeds), from `scores`.

    Returns
    -------
    list[Line]
        In the order of SETTINGS: scores, lowest and highest seed, number of runs, ranks, 1 for the best. NaN where
        runs lack.

    Notes
    -----
    Ledger: fig-61, ex-ppo-table.
    """
    from scipy.stats import rankdata

    ours, seeds, runs = average(table), by_seed(table), (~np.isnan(table)).sum(axis=(1, 2))
    low, high = np.fmin.reduce(seeds, axis=1), np.fmax.reduce(seeds, axis=1)
    ranks = rankdata(-PUBLISHED), rankdata(-ours, nan_policy="propagate")
    return [Line(*line) for line in zip(SETTINGS, PUBLISHED, ours, low, high, runs, *ranks)]


def _differ(name, values, given):
    """The rule of numbers that have ranks: two at least, not all equal along the last axis."""
    values = finite(name, values)
    if values.ndim < 1 or values.shape[-1] < 2:
        raise ValueError(f"{name}: got shape {values.shape}, must be (..., n), n at least 2")
    if (values == values[..., :1]).all(axis=-1).any():
        raise ValueError(f"{name}: got values that are all equal, must differ, or they have no order")
    return values


def _one_order(name, y, given):
    y, x = _differ(name, y, given), given["x"]
    if y.ndim != 1 or x.shape[-1:] != y.shape:
        raise ValueError(f"x: got shape {x.shape} with y {y.shape}, must be (..., n) and (n,), n at least 2")
    return y


@checked(x=_differ, y=_one_order)
def rank_correlation(x: ArrayLike, y: ArrayLike) -> Floats:
    """Spearman's rank correlation of the last axes, equal values sharing their mean rank.

    Parameters
    ----------
    x : ArrayLike
        (..., n), n at least 2.
    y : ArrayLike
        (n,).

    Returns
    -------
    Floats
        (...): 1 for the same order, -1 for the reverse.

    Notes
    -----
    Ledger: fig-61.

    References
    ----------
    Spearman (1904).

    Examples
    --------
    >>> from rlcore.studies.figure61 import rank_correlation
    >>> float(rank_correlation([1.0, 2.0, 3.0], [10.0, 30.0, 20.0]))
    0.5
    """
    from scipy.stats import rankdata

    a, b = rankdata(x, axis=-1), rankdata(y)
    a, b = a - a.mean(axis=-1, keepdims=True), b - b.mean()
    return (a * b).sum(axis=-1) / np.sqrt((a**2).sum(axis=-1) * (b**2).sum())


@checked(table=_table)
def bootstrap(table: ArrayLike, n: int, *, rng: Rng) -> Floats:
    """Averages of tables drawn from this one: its tasks and, within each, the seeds of a setting.

    Parameters
    ----------
    table : ArrayLike
        (11, 7, n seeds), from `scores`.
    n : int
        How many.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Floats
        (n, 11); drawn with replacement.

    Raises
    ------
    ValueError
        Where no task has a run of every setting.

    Notes
    -----
    Ledger: fig-61.

    References
    ----------
    Efron and Tibshirani (1993).
    """
    whole = table[:, _whole(table)]
    settings, tasks, seeds = whole.shape
    if not tasks:
        raise ValueError("table: got no task with a run of every setting, must have one at least")
    whole = np.sort(whole, axis=2)  # NaN, the missing runs, last
    runs = (~np.isnan(whole)).sum(axis=2)  # (11, tasks)
    drawn = np.zeros((n, settings))
    for i in range(n):
        task = (rng.random(tasks) * tasks).astype(int)
        seed = (rng.random((settings, tasks, seeds)) * runs[:, task, None]).astype(int)
        drawn[i] = np.take_along_axis(whole[:, task], seed, axis=2).mean(axis=(1, 2))
    return drawn
