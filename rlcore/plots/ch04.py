"""Figures of chapter 4: temporal differences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from rlcore.core.types import ArrayLike
from rlcore.plots.style import (
    PALETTE,
    SMALL,
    Curves,
    Figure,
    Point,
    arrow,
    band,
    box,
    circle,
    new_diagram,
    new_figure,
    styles,
)

BLUE, RED, GREY = (PALETTE[name] for name in ("blue", "vermillion", "grey"))


def predictions(elapsed: ArrayLike, predicted: ArrayLike, targets: Sequence[Any], alpha: float, title: str) -> Figure:
    """Predicted totals of a journey along its time, and what each is moved to.

    Parameters
    ----------
    elapsed : ArrayLike
        (n,), minutes.
    predicted : ArrayLike
        (n,), minutes.
    targets : Sequence[Any]
        (n,), minutes.
    alpha : float
        The part of the way to its target that each prediction moves.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-14, fig-15, table-driving.
    """
    fig, ax = new_figure(height=4.2)
    ax.plot(elapsed, predicted, "o-", color=BLUE, label="prediction before")
    for x, old, target in zip(elapsed[:-1], predicted, targets):
        if alpha and old != target:
            ax.annotate(
                "",
                (x, old + alpha * (target - old)),
                (x, old),
                arrowprops={"arrowstyle": "-|>", "color": RED, "lw": 2, "mutation_scale": 14},
            )
    new = predicted[:-1] + alpha * (targets - predicted[:-1])
    ax.plot(elapsed[:-1], new, "s", color=RED, ms=7, label="after the update")
    ax.axhline(predicted[-1], color=GREY, ls="--", lw=1.2, label=f"what it took: {predicted[-1]:g} minutes")
    ax.set(xlabel="minutes since leaving", ylabel="predicted total, minutes", title=title, ylim=(25, 55))
    ax.legend(loc="lower right")
    return fig


def walk_graph(n: int, right: float, states: ArrayLike = (), names: Sequence[Any] | None = None) -> Figure:
    """The random walk as a graph, and below it the walk of one episode, downwards in time.

    Parameters
    ----------
    n : int
        States between the ends.
    right : float
        Probability of a step to the right.
    states : ArrayLike
        The states met, 0 and n + 1 being the ends.
    names : Sequence[Any] | None
        Of the n states.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-16.
    """
    names = names or [chr(ord("A") + i) for i in range(n)]
    last = len(states) - 1
    step = min(0.45, 5.0 / max(last, 1))
    foot = -1.2 - step * max(last, 0) - 0.75 if len(states) else -0.6
    fig, ax = new_diagram((-0.9, n + 1.9), (foot, 1.35))
    for s in range(n + 2):
        if s in (0, n + 1):
            box(ax, (s, 0), "", width=0.5, height=0.5, face="#D9D9D9")
        else:
            circle(ax, (s, 0), names[s - 1], radius=0.32, fontsize=SMALL)
        if len(states):
            ax.plot([s, s], [-0.45, foot + 0.3], color="#D9D9D9", ls="-", lw=1, zorder=0)
    for s in range(1, n + 1):
        arrow(ax, (s + 0.3, 0.14), (s + 0.72, 0.14), colour=GREY)
        arrow(ax, (s - 0.3, -0.14), (s - 0.72, -0.14), colour=GREY)
    ax.text((n + 1) / 2, 0.85, f"right with probability {right:g}, left {1 - right:g}", ha="center", fontsize=SMALL)
    ax.text(n + 1, 0.45, "+1", ha="center", fontsize=SMALL)
    ax.text(0, 0.45, "0", ha="center", fontsize=SMALL)
    if len(states):
        down = -1.2 - step * np.arange(len(states))
        ax.plot(states, down, "o-", color=RED, lw=2, ms=5)
        ax.text(states[0] + 0.15, down[0] + 0.2, "t = 0", color=RED, fontsize=SMALL, ha="left", va="bottom")
        ax.text(states[-1], down[-1] - 0.2, f"t = {last}", color=RED, fontsize=SMALL, ha="center", va="top")
    return fig


def error_curves(
    curves: Curves, *, ylabel: str = "RMS error over the states", xlabel: str = "episodes", ylim: Point = (0, 0.26),
    height: float = 4.4,
) -> Figure:  # fmt: skip
    """Mean over runs with its standard error.

    Parameters
    ----------
    curves : Curves
        {label: (n_runs, n + 1)}.
    ylabel : str
        Of the y axis.
    xlabel : str
        Of the x axis.
    ylim : Point
        Ends of the axis.
    height : float
        In inches.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-17, fig-18.
    """
    fig, ax = new_figure(height=height)
    for (label, values), style in zip(curves.items(), styles(curves).values()):
        mean, error = values.mean(axis=0), values.std(axis=0) / np.sqrt(len(values))
        band(ax, np.arange(mean.size), mean, error, label, **style)
    ax.set(xlabel=xlabel, ylabel=ylabel, ylim=ylim)
    ax.legend(ncols=2)
    return fig


def estimates_against_truth(truth: ArrayLike, estimates: Curves, title: str) -> Figure:
    """Estimates of several methods beside the true values.

    Parameters
    ----------
    truth : ArrayLike
        (S,), values.
    estimates : Curves
        {label: (S,)}.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-18.
    """
    fig, ax = new_figure(height=3.8)
    x = np.arange(1, truth.size + 1)
    ax.plot(x, truth, color=PALETTE["black"], ls="-", lw=1.4, label="true")
    for (label, values), mark, style in zip(estimates.items(), "so^", styles(estimates).values()):
        ax.plot(x, values, mark, color=style["color"], ms=8, label=label)
    names = [chr(ord("A") + i) for i in range(truth.size)]
    ax.set(xticks=x, xticklabels=names, ylim=(-0.05, 1.05), ylabel="value", title=title)
    ax.legend()
    return fig


def predictor_graph(p_b: float, p_one: float, values: ArrayLike) -> Figure:
    """The most likely model of the predictor's episodes: A leads to B, B ends with 1 or 0.

    Parameters
    ----------
    p_b : float
        Share of A's transitions that go to B.
    p_one : float
        Share of B's ends with reward 1.
    values : ArrayLike
        {label: (V(A), V(B))}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-19.
    """
    fig, ax = new_diagram((-0.7, 8.2), (-3.2, 1.6))
    circle(ax, (0, 0), "A", radius=0.45, fontsize=15)
    circle(ax, (3.4, 0), "B", radius=0.45, fontsize=15)
    for y in (1.1, -1.1):
        box(ax, (7.3, y), "", width=0.5, height=0.5, face="#d9d9d9")
    arrow(ax, (0.45, 0), (2.95, 0), f"p = {p_b:.2g}\nr = 0", fontsize=SMALL)
    arrow(ax, (3.8, 0.2), (7.0, 1.1), f"p = {p_one:.3g}, r = 1", fontsize=SMALL)
    arrow(ax, (3.8, -0.2), (7.0, -1.1), f"p = {1 - p_one:.3g}, r = 0", fontsize=SMALL)
    for i, (label, (a, b)) in enumerate(values.items()):
        colour = styles(values)[label]["color"]
        ax.text(-0.6, -2.2 - 0.7 * i, f"{label}:  V(A) = {a:.3g},  V(B) = {b:.3g}", fontsize=SMALL, color=colour)
    return fig


def _cliff(foot=-0.6):
    """The cliff world, with S and G beside it; foot: how far down the picture reaches, in cells below the last row."""
    fig, ax = new_diagram((-1.1, 12.1), (foot, 3.7))
    for row, col in np.ndindex(4, 12):
        face = GREY if row == 3 and 0 < col < 11 else "#F2F2F2"
        ax.add_patch(Rectangle((col - 0.5, 2.5 - row), 1, 1, fc=face, ec="white", lw=1, zorder=0))
    ax.text(5.5, 0, "the cliff", ha="center", va="center", color="white")
    for x, name in ((-0.8, "S"), (11.8, "G")):
        ax.text(x, 0, name, ha="center", va="center", fontweight="bold")
    return fig, ax


def cliff_paths(paths: Curves, title: str = "") -> Figure:
    """The cliff world with greedy paths, each drawn with a small offset.

    Parameters
    ----------
    paths : Curves
        {label: list of states}.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-22.
    """
    fig, ax = _cliff(-2.0)
    for k, ((label, states), style) in enumerate(zip(paths.items(), styles(paths).values())):
        row, col = np.divmod(np.asarray(states), 12)
        shift = 0.16 * (k - (len(paths) - 1) / 2)
        ax.plot(col + shift, 3 - row - shift, label=f"{label}: {len(states) - 1} steps", lw=2.6, **style)
    ax.set_title(title)
    ax.legend(loc="lower center", ncols=2, frameon=False)
    return fig


def reward_curves(returns: Curves, *, window: int = 10, ylim: Point = (-100, 0), title: str = "") -> Figure:
    """Sum of rewards per episode, smoothed; mean and standard error over runs.

    Parameters
    ----------
    returns : Curves
        {label: (n_runs, n_episodes)}.
    window : int
        Episodes smoothed over.
    ylim : Point
        The axis, which reaches further down where a curve ends below it.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-22.
    """
    fig, ax = new_figure(height=4.2)
    lowest = ylim[0]
    for (label, values), style in zip(returns.items(), styles(returns).values()):
        smooth = np.apply_along_axis(np.convolve, 1, np.asarray(values, float), np.ones(window) / window, "valid")
        x, smooth = (np.arange(smooth.shape[1]) + window)[:: window // 2], smooth[:, :: window // 2]
        mean = smooth.mean(axis=0)
        band(ax, x, mean, smooth.std(axis=0) / np.sqrt(len(smooth)), label, **style)
        lowest = min(lowest, 1.15 * mean[mean.size // 2 :].min())
    ax.set(xlabel="episode", ylabel=f"sum of rewards,\nmean of {window} episodes", ylim=(lowest, ylim[1]), title=title)
    ax.legend(loc="lower right")
    return fig


def value_paths(runs: Curves, ends: Curves, *, names: Sequence[Any] = ("V(A)", "V(B)")) -> Figure:
    """How pairs of estimates move in the plane.

    Parameters
    ----------
    runs : Curves
        {label: (n, 2)}.
    ends : Curves
        {label: point}.
    names : Sequence[Any]
        Of the axes.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-047.
    """
    fig, ax = new_figure(height=4.6)
    for (label, path), style in zip(runs.items(), styles(runs).values()):
        ax.plot(*path.T, label=label, lw=1.2, color=style["color"], ls="-")
    for (label, (x, y)), mark in zip(ends.items(), "Xo"):
        ax.plot([x], [y], mark, color=PALETTE["black"], ms=10)
        ground = {"fc": "white", "ec": "none", "pad": 1.0}
        ax.annotate(label, (x, y), (0, 40), textcoords="offset points", fontsize=SMALL, ha="left", bbox=ground)
    ax.set(xlabel=names[0], ylabel=names[1], xlim=(-0.05, 1.25), ylim=(0.4, 1.05))
    ax.legend(loc="lower left")
    return fig


def cliff_step(update: Any, names: Sequence[str], title: str, *, target: str, alpha: float = 0.5) -> Figure:
    """One update of a control method on the cliff: where it is, what it does, its numbers.

    Parameters
    ----------
    update : Any
        Of `first_updates`.
    names : Sequence[str]
        Of the actions.
    title : str
        Written above.
    target : str
        What the rule bootstraps from, in words.
    alpha : float
        The step size of the update.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-20, fig-21.
    """
    fig, ax = _cliff(-3.9)
    row, col = divmod(update.s, 12)
    circle(ax, (col, 3 - row), "s", radius=0.32, face=BLUE, fontsize=SMALL)
    if update.s_next >= 0:
        row_next, col_next = divmod(update.s_next, 12)
        same = update.s_next == update.s
        ring = circle if not same else (lambda ax, xy, text, **look: circle(ax, xy, "", **look))
        ring(ax, (col_next, 3 - row_next), "s'", radius=0.44 if same else 0.32, edge=RED, fontsize=SMALL)
        if same:  # the ring goes round the filled circle
            ax.patches[-1].set(fill=False, linewidth=2.6)
    goal = update.old + (update.new - update.old) / alpha
    old = f"({update.old:.2f})" if update.old < 0 else f"{update.old:.2f}"
    move = f"{names[update.a]}" + (", back to s" if update.s_next == update.s else "")
    lines = [
        "Q[s, a] += alpha * (target − Q[s, a])",
        f"a = {move};  target = R + {target} = {goal:.2f}",
        f"{update.old:.2f} + {alpha:g} · ({goal:.2f} − {old}) = {update.new:.2f}",
    ]
    for k, line in enumerate(lines):
        font = {"family": "DejaVu Sans Mono"} if k == 0 else {}
        colour = RED if k == 2 else PALETTE["black"]
        ax.text(
            5.5,
            -1.2 - 1.0 * k,
            line.replace("-", "−"),
            ha="center",
            va="center",
            fontsize=SMALL,
            color=colour,
            **font,
        )
    ax.set_title(title)
    return fig
