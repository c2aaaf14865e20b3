"""Catch: a ball falls through a field of 10 x 5 pixels, and the paddle has to be under it at the end."""

from __future__ import annotations

import numpy as np

from rlcore.core.checks import show
from rlcore.core.rules import checked
from rlcore.core.types import Floats
from rlcore.mdp import FiniteMDP

__all__ = ["CATCH_ROWS", "CATCH_COLS", "catch", "catch_pixels"]

CATCH_ROWS, CATCH_COLS = 10, 5
MOVES = {2: (-1, 1), 3: (-1, 0, 1)}
NAMES = {2: ("left", "right"), 3: ("left", "stay", "right")}


def _two_or_three(name, n_actions, given):
    if not isinstance(n_actions, (int, np.integer)) or n_actions not in MOVES:
        raise ValueError(f"{name}: got {show(n_actions)}, must be 2 (left, right) or 3 (left, stay, right)")
    return int(n_actions)


@checked(n_actions=_two_or_three)
def catch(n_actions: int = 3) -> FiniteMDP:
    """Catch as a process of 250 states: row of the ball, its column, column of the paddle.

    The ball starts in the top row of 10 x 5 pixels, its column random, the paddle in the middle. Each of the 9 steps
    moves the ball a row down and the paddle a column, walls permitting. +1 for a catch, -1 for a miss, 0 before.

    Parameters
    ----------
    n_actions : int
        3 for left, stay and right, 2 without stay.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-outcome, ex-up-down.

    References
    ----------
    Mnih et al. (2014); Osband et al. (2020), bsuite.

    Examples
    --------
    >>> from rlcore.envs.catch import catch
    >>> catch().n_states, catch(2).action_names
    (250, ('left', 'right'))
    """
    outcomes = {}
    for row, ball, paddle in np.ndindex(CATCH_ROWS - 1, CATCH_COLS, CATCH_COLS):
        for a, move in enumerate(MOVES[n_actions]):
            under = min(max(paddle + move, 0), CATCH_COLS - 1)
            r = 0.0 if row + 2 < CATCH_ROWS else 1.0 if under == ball else -1.0
            outcomes[_number(row, ball, paddle), a] = [(1.0, _number(row + 1, ball, under), r)]
    n_states = CATCH_ROWS * CATCH_COLS**2
    start = np.zeros(n_states)
    start[[_number(0, ball, CATCH_COLS // 2) for ball in range(CATCH_COLS)]] = 1 / CATCH_COLS
    return FiniteMDP.from_outcomes(outcomes, n_states=n_states, start=start, action_names=NAMES[n_actions])


def catch_pixels() -> Floats:
    """What the screen of `catch` shows in each state.

    Returns
    -------
    Floats
        (250, 50) float32: row by row, 1 where the ball or the paddle is, else 0.
    """
    pixels = np.zeros((CATCH_ROWS * CATCH_COLS**2, CATCH_ROWS, CATCH_COLS), np.float32)
    for row, ball, paddle in np.ndindex(CATCH_ROWS, CATCH_COLS, CATCH_COLS):
        pixels[_number(row, ball, paddle), [row, -1], [ball, paddle]] = 1
    return pixels.reshape(len(pixels), -1)


def _number(row, ball, paddle):
    return (row * CATCH_COLS + ball) * CATCH_COLS + paddle
