"""Golf: each stroke costs 1; the putter is exact and short, the driver long and inexact."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from rlcore.core.checks import check_count, check_entries, check_flag, show
from rlcore.core.rules import checked, count, sized
from rlcore.core.types import Cell
from rlcore.mdp import FiniteMDP

SAND = tuple(
    (r, c) for rows, columns in (((2, 3), (20, 21, 22)), ((7, 8), (22, 23, 24))) for r in rows for c in columns
)


@checked(length=count(), putter=sized("length", 100), driver=count())
def golf_line(length: int = 12, *, putter: int = 2, driver: int = 5) -> FiniteMDP:
    """Golf in one dimension: states are distances from the hole, reward -1 a stroke.

    Parameters
    ----------
    length : int
        The distance at the start; the hole is state 0.
    putter : int
        The ball moves 1 to `putter` towards the hole, as chosen; at most 100 and length.
    driver : int
        It moves exactly `driver`, past the hole if need be. A drive never holes: a ball that would is left at
        distance 1.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-golf-putter, fig-5.

    Examples
    --------
    >>> from rlcore import solve
    >>> from rlcore.envs.golf import golf_line
    >>> solve(golf_line(6), 1.0).V
    array([ 0., -1., -1., -2., -2., -2., -2.])
    """
    outcomes = {}
    for d in range(1, length + 1):
        for step in range(1, min(putter, d) + 1):
            outcomes[d, step - 1] = [(1.0, d - step, -1.0)]
        if abs(d - driver) <= length:
            outcomes[d, putter] = [(1.0, abs(d - driver) or 1, -1.0)]
    names = [f"putter {step + 1}" for step in range(putter)] + [f"driver {driver}"]
    return FiniteMDP.from_outcomes(outcomes, n_actions=putter + 1, start=length, action_names=names)


def _pair(least):
    """The rule of two whole numbers of at least `least`."""

    def rule(name, pair, given):
        if not isinstance(pair, (tuple, list, np.ndarray)) or len(pair) != 2:
            raise ValueError(f"{name}: got {show(pair)}, must be two whole numbers")
        return tuple(check_count(name, x, least) for x in pair)

    return rule


def _cell(name, cell, given):
    (r, c), (rows, cols) = _pair(0)(name, cell, given), given["shape"]
    if r >= rows or c >= cols:
        raise ValueError(f"{name}: got {(r, c)}, must be a cell of the {rows} x {cols} course")
    return r, c


def _inner_cell(name, cell, given):
    r, c = _cell(name, cell, given)
    if r in (0, given["shape"][0] - 1) or c in (0, given["shape"][1] - 1):
        raise ValueError(f"{name}: got {(r, c)}, must not lie on the edge of the course")
    return r, c


def _cells(name, cells, given):
    if not hasattr(cells, "__iter__"):
        raise ValueError(f"{name}: got {show(cells)}, must be cells (row, column)")
    cells = [_cell(name, cell, given) for cell in cells]
    if given["hole"] == given["tee"] or given["hole"] in cells:
        raise ValueError(f"hole: got {given['hole']}, must be neither the tee nor in the {name}")
    return cells


def _range(name, driver, given):
    nearest, farthest = _pair(1)(name, driver, given)
    if farthest < nearest:
        raise ValueError(f"{name}: got {driver}, must be (nearest, farthest) in this order")
    return nearest, farthest


@checked(shape=_pair(1), hole=_inner_cell, tee=_cell, sand=_cells, putter=count(), driver=_range, scatter=count(0),
         with_driver=check_flag)  # fmt: skip
def golf_course(
    *, shape: Cell = (11, 31), hole: Cell = (5, 26), tee: Cell = (5, 4), sand: Collection[Cell] = SAND, putter: int = 4,
    driver: Cell = (3, 11), scatter: int = 1, with_driver: bool = True,
) -> FiniteMDP:  # fmt: skip
    """A golf hole seen from above: cells numbered row by row, reward -1 a stroke.

    A drive never holes: a ball on the hole rolls one cell on. Actions are named "putter +0 -2": rows down, columns to
    the right.

    Parameters
    ----------
    shape : Cell
        (rows, columns).
    hole : Cell
        The cell that ends the episode, not on the edge.
    tee : Cell
        The cell where it starts.
    sand : Collection[Cell]
        Cells from which the putter does not move the ball.
    putter : int
        It reaches any cell at a distance of at most this, exactly.
    driver : Cell
        (nearest, farthest) distance of the cell aimed at.
    scatter : int
        The ball of a drive lands on any of the (2 scatter + 1)^2 cells around the aim with equal chance, or on the
        edge of the grid where that is outside.
    with_driver : bool
        Whether there is a driver.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: fig-5, ex-golf-driver, cl-018.

    References
    ----------
    Built after the contours of Sutton and Barto (2018), figure 3.3; the geometry is this book's own.
    """
    S, hole, tee, *sand = shape[0] * shape[1], *(r * shape[1] + c for r, c in (hole, tee, *sand))
    putts, drives = _offsets("putter", shape, 1, putter), _offsets("driver", shape, *driver) if with_driver else []
    spread = scatter if with_driver else 0
    check_entries("scatter", S, len(putts) + len(drives), 2 * spread + 1, 2 * spread + 1)
    next_state, prob, legal = _strokes(shape, list(putts) + list(drives), spread)
    next_state[:, : len(putts)] = next_state[:, : len(putts), next_state.shape[2] // 2, None]  # exactly where aimed
    prob[:, : len(putts)] = legal[:, : len(putts), None] * np.eye(prob.shape[2])[0]
    next_state[sand, : len(putts)] = np.array(sand, int)[:, None, None]
    row, col = np.divmod(np.arange(S), shape[1])
    away = np.sign(hole // shape[1] - row) * shape[1] + np.sign(hole % shape[1] - col)
    drive = next_state[:, len(putts) :]
    drive[:] = np.where(drive == hole, hole + away[:, None, None], drive)
    end = np.arange(S) == hole
    next_state[end], prob[end], legal[end] = hole, np.eye(prob.shape[2])[0], True
    reward = np.where((prob > 0) & ~end[:, None, None], -1.0, 0.0)
    names = [f"putter {dr:+d} {dc:+d}" for dr, dc in putts] + [f"driver {dr:+d} {dc:+d}" for dr, dc in drives]
    return FiniteMDP(next_state, prob, reward, legal, end, 1.0 * (np.arange(S) == tee), action_names=names)


def _offsets(name, shape, nearest, farthest):
    """Every (rows, columns) at a distance of nearest to farthest; ValueError where the course is too large for them."""
    check_entries(name, *shape, *(2 * min(n - 1, farthest) + 1 for n in shape))
    rows, columns = (range(-min(n - 1, farthest), min(n - 1, farthest) + 1) for n in shape)
    return [(r, c) for r in rows for c in columns if nearest**2 <= r * r + c * c <= farthest**2]


def _strokes(shape, offsets, spread):
    """next_state, prob (S, A, K) and legal (S, A): the cells around the aim, equally likely; aims on the grid only."""
    cells = np.stack(np.unravel_index(np.arange(shape[0] * shape[1]), shape), axis=1)
    aim = cells[:, None] + np.array(offsets)
    legal = ((aim >= 0) & (aim < shape)).all(axis=2)
    side = np.arange(-spread, spread + 1)
    around = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    ball = np.clip(aim[:, :, None] + around, 0, np.array(shape) - 1)
    next_state = ball @ [shape[1], 1]
    return next_state, np.where(legal[:, :, None], np.full(next_state.shape, 1 / len(around)), 0.0), legal
