"""Tic-tac-toe and its larger relatives, solved exactly."""

from __future__ import annotations

from rlcore.core.checks import check_count
from rlcore.core.rules import checked, choice, count
from rlcore.mdp import FiniteMDP

MOST_CELLS = 12  # of a board whose positions are listed: 3 x 4 has 111,973


def _few_cells(name, cols, given):
    cols = check_count(name, cols)
    if given["rows"] * cols > MOST_CELLS:
        raise ValueError(f"{name}: got {cols} and {given['rows']} rows, must make at most {MOST_CELLS} cells")
    return cols


@checked(rows=count(), cols=_few_cells, in_row=count())
def game_values(rows: int = 3, cols: int = 3, in_row: int = 3) -> dict[tuple[int, int], int]:
    """Value for the first player of every position that play can reach.

    A position is a pair of integers whose bits are the cells of either player. x moves first and takes the maximum, o
    the minimum: equation (16) with two players, solved in one pass from the last move to the first.

    Parameters
    ----------
    rows : int
        Rows of the board; rows * cols at most 12.
    cols : int
        Columns.
    in_row : int
        How many in a row, a column or a diagonal win.

    Returns
    -------
    dict[tuple[int, int], int]
        {(x, o): value}: 1 where the first player wins, -1 where the other does, 0 for a draw.

    Notes
    -----
    Ledger: ex-chess, cl-023.

    Examples
    --------
    >>> from rlcore.envs.games import game_values
    >>> game_values()[0, 0]
    0
    """
    lines, n = _lines(rows, cols, in_row), rows * cols
    levels = [{(0, 0)}]
    while levels[-1]:
        x_to_move = len(levels) % 2 == 1
        levels.append({m for xo in levels[-1] if not _won(xo, lines) for m in _moves(xo, x_to_move, n)})
    values = {}
    for level in range(len(levels) - 2, -1, -1):
        x_to_move = level % 2 == 0
        best = max if x_to_move else min
        for xo in levels[level]:
            moves = () if _won(xo, lines) else _moves(xo, x_to_move, n)
            values[xo] = best(values[m] for m in moves) if moves else _won(xo, lines)
    return values


@checked(opponent=choice("random", "perfect"))
def tic_tac_toe(opponent: str = "random") -> FiniteMDP:
    """Tic-tac-toe for the first player: +1 for a win, -1 for a loss, an action is a cell.

    A state is a position in which x is to move; the opponent's answer belongs to the environment.

    Parameters
    ----------
    opponent : str
        "random": any free cell with equal chance; "perfect": any best answer with equal chance.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-chess.
    """
    values, lines = game_values(), _lines(3, 3, 3)
    number = {xo: i for i, xo in enumerate(sorted(p for p in values if _bits(p) % 2 == 0 and _open(p, lines)))}
    end, outcomes = len(number), {}
    for xo, s in number.items():
        for x in _moves(xo, True, 9):
            answers = _moves(x, False, 9) if _open(x, lines) else [x]
            if opponent == "perfect":
                answers = [m for m in answers if values[m] == min(values[m] for m in answers)]
            after = [(number.get(m, end), float(_won(m, lines))) for m in answers]
            outcomes[s, (x[0] ^ xo[0]).bit_length() - 1] = [(1 / len(after), *outcome) for outcome in after]
    return FiniteMDP.from_outcomes(outcomes, n_states=end + 1, start=number[0, 0])


def _lines(rows, cols, k):
    """Bit masks of every k cells in a row, a column or a diagonal."""
    starts = [(r, c, dr, dc) for r in range(rows) for c in range(cols) for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1))]
    inside = [t for t in starts if t[0] + (k - 1) * t[2] < rows and 0 <= t[1] + (k - 1) * t[3] < cols]
    return [sum(1 << (r + i * dr) * cols + c + i * dc for i in range(k)) for r, c, dr, dc in inside]


def _won(xo, lines):
    """1 where x has a full line, -1 where o has one, else 0."""
    x, o = xo
    for line in lines:
        if x & line == line:
            return 1
        if o & line == line:
            return -1
    return 0


def _moves(xo, x_to_move, n):
    """Positions after one more mark."""
    x, o = xo
    free = [1 << i for i in range(n) if not (x | o) >> i & 1]
    return [(x | cell, o) if x_to_move else (x, o | cell) for cell in free]


def _bits(xo):
    return (xo[0] | xo[1]).bit_count()


def _open(xo, lines):
    return not _won(xo, lines) and _bits(xo) < 9
