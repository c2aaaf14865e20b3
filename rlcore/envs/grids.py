"""Grid worlds."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from rlcore.core.checks import as_integers, check_finite, check_flag, is_number, show
from rlcore.core.outcomes import freeze
from rlcore.core.rules import anything, checked, choice, sized, takes_none
from rlcore.core.types import ArrayLike, Cell
from rlcore.mdp import FiniteMDP

__all__ = ["blocking_maze", "cliff_walking", "dyna_maze", "gridworld", "maze", "two_goal_maze", "windy_gridworld"]

MOVES = {"up": (-1, 0), "down": (1, 0), "right": (0, 1), "left": (0, -1)}
KING = MOVES | {"up-right": (-1, 1), "up-left": (-1, -1), "down-right": (1, 1), "down-left": (1, -1)}
DYNA_WALLS = ((1, 2), (2, 2), (3, 2), (4, 5), (0, 7), (1, 7), (2, 7))
WIND = (0, 0, 0, 1, 1, 1, 2, 2, 1, 0)


@takes_none
def _terminals(name, cells, given):
    S = given["n_rows"] * given["n_cols"]
    cells = as_integers(name, [0, S - 1] if cells is None else cells)
    if cells.ndim != 1 or np.unique(cells).size == S or ((cells < 0) | (cells >= S)).any():
        raise ValueError(f"{name}: got {cells}, must be cells in 0..{S - 1}, one cell at least left out")
    return cells


@checked(n_cols=sized("n_rows", 4, 4), terminals=_terminals)
def gridworld(
    n_rows: int = 4, n_cols: int = 4, *, terminals: ArrayLike | None = None, reward: float = -1.0,
    slip: float = 0.0,
) -> FiniteMDP:  # fmt: skip
    """A grid of cells, numbered row by row; a move off the grid stays.

    Parameters
    ----------
    n_rows : int
        Rows.
    n_cols : int
        Columns.
    terminals : ArrayLike | None
        Cells that end the episode, by number; the first and the last where None.
    reward : float
        Of every step.
    slip : float
        Probability that the move is in one of the four directions at random.

    Returns
    -------
    FiniteMDP
        The process.

    References
    ----------
    Sutton and Barto (2018), figure 4.1.

    Examples
    --------
    >>> from rlcore import solve
    >>> from rlcore.envs.grids import gridworld
    >>> solve(gridworld(2, 3), 1.0).V
    array([ 0., -1., -1., -1., -1.,  0.])
    """
    S, A = n_rows * n_cols, len(MOVES)
    row, col = np.divmod(np.arange(S), n_cols)
    target = np.stack(
        [np.clip(row + dr, 0, n_rows - 1) * n_cols + np.clip(col + dc, 0, n_cols - 1) for dr, dc in MOVES.values()], 1
    )
    if slip == 0:
        next_state, prob = target[:, :, None], np.ones((S, A, 1))
    else:
        next_state = np.broadcast_to(target[:, None, :], (S, A, A)).copy()
        prob = np.broadcast_to(np.full((A, A), slip / A) + (1 - slip) * np.eye(A), (S, A, A)).copy()
    terminal = np.zeros(S, bool)
    terminal[terminals] = True
    next_state[terminal] = np.flatnonzero(terminal)[:, None, None]
    rewards = np.where(terminal[:, None, None], 0.0, np.full(prob.shape, reward))
    start = ~terminal / np.sum(~terminal)
    arrays = freeze(next_state, prob, rewards, np.ones((S, A), bool), terminal, start)
    return FiniteMDP(*arrays, action_names=tuple(MOVES))


def _cell(name, cell, given):
    """The rule of a cell (row, column): its number."""
    n_rows, n_cols = given["n_rows"], given["n_cols"]
    if not isinstance(cell, (tuple, list, np.ndarray)) or len(cell) != 2 or not all(map(is_number, cell)):
        raise ValueError(f"{name}: got cell {show(cell)}, must be (row, column)")
    row, col = cell
    if not (row in range(n_rows) and col in range(n_cols)):
        raise ValueError(f"{name}: got cell {cell}, must be (row, column) inside {n_rows} x {n_cols}")
    return int(row * n_cols + col)


def _cells(name, cells, given):
    if not hasattr(cells, "__iter__"):
        raise ValueError(f"{name}: got {show(cells)}, must be cells (row, column)")
    return {_cell(name, cell, given) for cell in cells}


def _goals(name, goals, given):
    if not isinstance(goals, dict) or not goals:
        raise ValueError(f"{name}: got {show(goals)}, must be {{cell: reward}} with at least one cell")
    goals = {_cell(name, cell, given): check_finite(name, reward) for cell, reward in goals.items()}
    walls, start = given["walls"], given["start"]
    for name, taken in (("start", {start} & (walls | goals.keys())), ("goals", goals.keys() & walls)):
        if taken:
            cell = divmod(min(taken), given["n_cols"])
            raise ValueError(f"{name}: cell {cell} is taken, must be free of walls and goals")
    return goals


@checked(n_cols=sized("n_rows", 100), walls=_cells, start=_cell, goals=_goals)
def maze(
    n_rows: int, n_cols: int, *, walls: Collection[Cell] = (), start: Cell, goals: Mapping[Cell, float]
) -> FiniteMDP:
    """A grid with walls: four moves, and goals that pay and end the episode.

    A move into a wall or the edge stays. Every step but the last pays 0: discounting alone makes short paths good.

    Parameters
    ----------
    n_rows : int
        Rows.
    n_cols : int
        Columns.
    walls : Collection[Cell]
        Cells that cannot be entered; they stay in the numbering, as states that nothing reaches.
    start : Cell
        Where an episode begins.
    goals : Mapping[Cell, float]
        {cell: reward}.

    Returns
    -------
    FiniteMDP
        The process.
    """
    outcomes = {}
    for s in range(n_rows * n_cols):
        for a, move in enumerate(MOVES.values()):
            s_next = _moved(s, move, n_rows, n_cols)
            s_next = s if s in walls or s_next in walls else s_next
            if s not in goals:
                outcomes[s, a] = [(1.0, s_next, goals.get(s_next, 0.0))]
    return FiniteMDP.from_outcomes(
        outcomes, n_states=n_rows * n_cols, n_actions=len(MOVES), start=start, action_names=tuple(MOVES)
    )


def _place(name, cell, given):
    _cell(name, cell, dict(n_rows=6, n_cols=9))
    return tuple(cell)


@checked(goal=_place, walls=anything)
def dyna_maze(*, goal: Cell = (0, 8), walls: Collection[Cell] = DYNA_WALLS) -> FiniteMDP:
    """The 6 x 9 maze: start (2, 0), reward 1 at the goal, seven walls, 14 steps at best.

    Parameters
    ----------
    goal : Cell
        Move it to ask what a learned model is still good for.
    walls : Collection[Cell]
        Likewise.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: fig-12, ex-model-based, ex-model-transfer.

    References
    ----------
    Sutton and Barto (2018), figure 8.2.
    """
    return maze(6, 9, walls=walls, start=(2, 0), goals={goal: 1.0})


@checked(gap=choice("right", "left"))
def blocking_maze(*, gap: str = "right") -> FiniteMDP:
    """A 6 x 9 maze with one passage, at the right or the left end of its wall; start (5, 3).

    Parameters
    ----------
    gap : str
        "right" (10 steps to the goal) or "left" (16 steps). The experiment closes the right one and opens the left.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-model-wrong.

    References
    ----------
    Sutton and Barto (2018), figure 8.4.
    """
    columns = range(8) if gap == "right" else range(1, 9)
    return maze(6, 9, walls=[(3, col) for col in columns], start=(5, 3), goals={(0, 8): 1.0})


@checked(near=check_finite, far=check_finite)
def two_goal_maze(*, near: float = 0.2, far: float = 1.0) -> FiniteMDP:
    """A 3 x 6 room: one reward 2 steps left of the start, one 3 steps to the right.

    At gamma = 0.95 the two of the defaults are worth 0.2 * 0.95 = 0.19 and 0.95^2 = 0.90 at the start.

    Parameters
    ----------
    near : float
        The reward on the left.
    far : float
        The reward on the right.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-explore.
    """
    return maze(3, 6, start=(1, 2), goals={(1, 0): near, (1, 5): far})


def cliff_walking() -> FiniteMDP:
    """4 x 12 cells with a cliff between start (36) and goal (47).

    Every step costs 1; a step into the cliff costs 100 and leads back to the start, without ending the episode.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: fig-22, ex-cliff.

    References
    ----------
    Sutton and Barto (2018), example 6.6.
    """
    n_rows, n_cols, start, goal = 4, 12, 36, 47
    cliff = range(start + 1, goal)
    outcomes = {}
    for s in range(n_rows * n_cols - 1):
        for a, move in enumerate(MOVES.values()):
            s_next = _moved(s, move, n_rows, n_cols)
            outcomes[s, a] = [(1.0, start, -100.0) if s_next in cliff else (1.0, s_next, -1.0)]
    return FiniteMDP.from_outcomes(outcomes, start=start, action_names=tuple(MOVES))


@checked(king=check_flag, stay=check_flag)
def windy_gridworld(*, king: bool = False, stay: bool = False) -> FiniteMDP:
    """7 x 10 cells, -1 a step, start (3, 0), goal (3, 7); a wind pushes up.

    The wind of the column that is left pushes by 0, 1 or 2 cells.

    Parameters
    ----------
    king : bool
        Eight moves instead of four: 7 steps at best instead of 15.
    stay : bool
        Also a ninth action, which does not move.

    Returns
    -------
    FiniteMDP
        The process.

    References
    ----------
    Sutton and Barto (2018), example 6.5 and exercise 6.9.
    """
    n_rows, n_cols, goal = 7, 10, 37
    moves = (KING if king else MOVES) | ({"stay": (0, 0)} if stay else {})
    outcomes = {}
    for s in range(n_rows * n_cols):
        for a, (dr, dc) in enumerate(moves.values()):
            if s != goal:
                outcomes[s, a] = [(1.0, _moved(s, (dr - WIND[s % n_cols], dc), n_rows, n_cols), -1.0)]
    return FiniteMDP.from_outcomes(outcomes, n_actions=len(moves), start=30, action_names=tuple(moves))


def _moved(s, move, n_rows, n_cols):
    """Number of the cell that a move (rows, columns) leads to; the edge of the grid stops it."""
    row, col = s // n_cols + move[0], s % n_cols + move[1]
    return min(max(row, 0), n_rows - 1) * n_cols + min(max(col, 0), n_cols - 1)
