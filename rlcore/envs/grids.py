"""Grid worlds."""

import numpy as np

from rlcore.mdp import FiniteMDP, check_count

__all__ = ["gridworld"]

MOVES = {"up": (-1, 0), "down": (1, 0), "right": (0, 1), "left": (0, -1)}


def gridworld(n_rows=4, n_cols=4, *, terminals=None, reward=-1.0, slip=0.0):
    """A grid of n_rows x n_cols cells, numbered row by row; moves off the grid stay. Source below.

    terminals: cells that end the episode; the default is the first and the last, as in figure 4.1 of Sutton and Barto
    (2018). reward: of every step. slip: probability that the robot moves in one of the four directions at random.
    """
    n_rows, n_cols = check_count("n_rows", n_rows), check_count("n_cols", n_cols)
    if not 0 <= slip <= 1:
        raise ValueError(f"slip: got {slip!r}, must be a probability in [0, 1]")
    S, A = n_rows * n_cols, len(MOVES)
    terminals = [0, S - 1] if terminals is None else list(terminals)
    if any(not 0 <= s < S for s in terminals):
        raise ValueError(f"terminals: got {terminals}, must be cells in 0..{S - 1}")
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
    return FiniteMDP(next_state, prob, rewards, np.ones((S, A), bool), terminal, start, None, tuple(MOVES))
