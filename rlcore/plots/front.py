"""The figure of the front page."""

from __future__ import annotations

import numpy as np

from rlcore.bellman import greedy_actions, q_from_v
from rlcore.core.results import Solution
from rlcore.core.types import Cell
from rlcore.mdp import FiniteMDP
from rlcore.plots.style import PALETTE, SMALL, Figure, heatmap, new_figure, text_colour

ARROWS = {"up": (0, -1), "down": (0, 1), "right": (1, 0), "left": (-1, 0)}


def front_page(mdp: FiniteMDP, solution: Solution, sweep: int, shape: Cell) -> Figure:
    """Values of a grid after some sweeps, with an arrow for each best move of a lookahead.

    Parameters
    ----------
    mdp : FiniteMDP
        The grid.
    solution : Solution
        With a history.
    sweep : int
        Which of it.
    shape : Cell
        (rows, columns).

    Returns
    -------
    Figure
        The figure.
    """
    V = solution.history[sweep]
    fig, ax = new_figure(height=5.0)
    image = heatmap(ax, V.reshape(shape), fmt=None, vmin=solution.V.min(), vmax=0)
    best = greedy_actions(q_from_v(mdp, V, 1.0), tol=1e-6)
    for s, (row, col) in enumerate(np.ndindex(*shape)):
        colour = text_colour(image.cmap(image.norm(V[s])))
        ax.text(
            col, row - 0.22, "goal" if mdp.terminal[s] else f"{V[s]:.1f}", ha="center", color=colour, fontsize=SMALL
        )
        for a in np.flatnonzero(best[s] & (not mdp.terminal[s]) & ~best[s].all()):
            dx, dy = ARROWS[mdp.action_names[a]]
            tip = {"arrowstyle": "-|>", "color": colour, "lw": 1.4}
            ax.annotate("", (col + 0.3 * dx, row + 0.2 + 0.17 * dy), (col, row + 0.2), arrowprops=tip)
    ax.set_title(f"sweep {sweep}", color=PALETTE["black"])
    return fig
