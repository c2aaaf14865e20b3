"""Figures of chapter 4: temporal differences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rlcore.core.types import ArrayLike
from rlcore.plots.style import (
    PALETTE,
    Curves,
    Figure,
    Point,
    arrow,
    band,
    box,
    circle,
    heatmap,
    new_diagram,
    new_figure,
)

BLUE, RED, GREY, GREEN = (PALETTE[name] for name in ("blue", "vermillion", "grey", "green"))


def predictions(elapsed: ArrayLike, predicted: ArrayLike, targets: Sequence[Any], alpha: float, title: str) -> Figure:
    """Predicted totals of a journey along its time, and what each is moved to. fig-14, fig-15, table-driving

    elapsed, predicted, targets: (n,) minutes. Each prediction moves the fraction alpha of the way to its target.
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
    """The random walk as a graph, and the states of one episode in red with the order of visits. fig-16

    right: probability of a step to the right. states: the states met, 0 and n + 1 being the ends.
    """
    names = names or [chr(ord("A") + i) for i in range(n)]
    fig, ax = new_diagram((-0.7, n + 1.7), (-1.1, 1.1), width=7.2)
    last = {s: i for i, s in enumerate(states)}
    for s in range(n + 2):
        if s in (0, n + 1):
            box(ax, (s, 0), "", width=0.45, height=0.45, face="#d9d9d9", edge=RED if s in last else PALETTE["black"])
        else:
            circle(ax, (s, 0), names[s - 1], radius=0.3, edge=RED if s in last else PALETTE["black"], fontsize=13)
        if s in last:
            ax.text(s, -0.6, f"t = {last[s]}", ha="center", color=RED, fontsize=11)
    for s in range(1, n + 1):
        arrow(ax, (s + 0.28, 0.12), (s + 0.72, 0.12), colour=GREY)
        arrow(ax, (s - 0.28, -0.12), (s - 0.72, -0.12), colour=GREY)
    ax.text((n + 1) / 2, 0.8, f"right with probability {right:g}, left {1 - right:g}", ha="center", fontsize=12)
    ax.text(n + 1, 0.45, "+1", ha="center", fontsize=12)
    ax.text(0, 0.45, "0", ha="center", fontsize=12)
    return fig


def error_curves(
    curves: Curves, *, ylabel: str = "RMS error over the states", xlabel: str = "episodes", ylim: Point = (0, 0.26),
    height: float = 4.4,
) -> Figure:  # fmt: skip
    """Mean over runs with its standard error; curves: {label: (n_runs, n + 1)}. fig-17, fig-18

    A label that starts with "MC" is drawn broken.
    """
    fig, ax = new_figure(height=height)
    count = {"MC": 0, "TD": 0}
    for label, values in curves.items():
        kind = "MC" if label.startswith("MC") else "TD"
        shades = ("vermillion", "ochre", "purple", "grey") if kind == "MC" else ("blue", "green", "black", "grey")
        mean, error = values.mean(axis=0), values.std(axis=0) / np.sqrt(len(values))
        style = {"color": PALETTE[shades[count[kind] % 4]], "ls": "--" if kind == "MC" else "-"}
        band(ax, np.arange(mean.size), mean, error, label, **style)
        count[kind] += 1
    ax.set(xlabel=xlabel, ylabel=ylabel, ylim=ylim)
    ax.legend(ncols=2)
    return fig


def estimates_against_truth(truth: ArrayLike, estimates: Curves, title: str) -> Figure:
    """Estimates of several methods beside the true values; estimates: {label: (S,)}. fig-18"""
    fig, ax = new_figure(height=3.8)
    x = np.arange(1, truth.size + 1)
    ax.plot(x, truth, color=PALETTE["black"], ls="-", lw=1.4, label="true")
    for (label, values), mark, colour in zip(estimates.items(), "so", (BLUE, RED)):
        ax.plot(x, values, mark, color=colour, ms=8, label=label)
    names = [chr(ord("A") + i) for i in range(truth.size)]
    ax.set(xticks=x, xticklabels=names, ylim=(-0.05, 1.05), ylabel="value", title=title)
    ax.legend()
    return fig


def predictor_graph(p_b: float, p_one: float, values: ArrayLike) -> Figure:
    """Most likely model of the predictor's episodes: A leads to B, B ends with 1 or 0. fig-19

    p_b: share of A's transitions that go to B. p_one: share of B's ends with reward 1. values: {label: (V(A), V(B))}.
    """
    fig, ax = new_diagram((-0.9, 8.2), (-2.3, 1.9), width=7.0)
    circle(ax, (0, 0), "A", radius=0.45, fontsize=15)
    circle(ax, (3.4, 0), "B", radius=0.45, fontsize=15)
    for y in (1.1, -1.1):
        box(ax, (7.3, y), "", width=0.5, height=0.5, face="#d9d9d9")
    arrow(ax, (0.45, 0), (2.95, 0), f"p = {p_b:.2g}, r = 0", fontsize=12)
    arrow(ax, (3.8, 0.2), (7.0, 1.1), f"p = {p_one:.3g}, r = 1", fontsize=12)
    arrow(ax, (3.8, -0.2), (7.0, -1.1), f"p = {1 - p_one:.3g}, r = 0", fontsize=12)
    for i, (label, (a, b)) in enumerate(values.items()):
        ax.text(-0.6, -1.5 - 0.55 * i, f"{label}:  V(A) = {a:.3g},  V(B) = {b:.3g}", fontsize=12)
    return fig


def cliff_paths(paths: Curves, title: str = "") -> Figure:
    """The cliff world with greedy paths; paths: {label: list of states}, drawn with a small offset each. fig-22"""
    fig, ax = new_figure(width=7.2, height=3.0)
    ground = np.full((4, 12), 0.12)
    ground[3, 1:11] = 1.0
    heatmap(ax, ground, fmt=None, cmap="Greys", vmin=0, vmax=1.6)
    ax.text(5.5, 3, "the cliff", ha="center", va="center", fontsize=13)
    for s, name in ((36, "S"), (47, "G")):
        ax.text(s % 12, s // 12, name, ha="center", va="center", fontsize=15, fontweight="bold")
    for k, (label, states) in enumerate(paths.items()):
        row, col = np.divmod(np.asarray(states), 12)
        shift = 0.12 * (k - (len(paths) - 1) / 2)
        style = {"color": (BLUE, RED, GREEN)[k % 3], "ls": ("-", "--", "-.")[k % 3], "lw": 2.4}
        ax.plot(col + shift, row + shift, label=f"{label}: {len(states) - 1} steps", **style)
    ax.set_title(title)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=3, frameon=False)
    return fig


def reward_curves(returns: Curves, *, window: int = 10, ylim: Point = (-100, 0), title: str = "") -> Figure:
    """Sum of rewards per episode, smoothed over `window` episodes; mean and standard error over runs. fig-22

    returns: {label: (n_runs, n_episodes)}.
    """
    fig, ax = new_figure(height=4.2)
    for (label, values), colour, line in zip(returns.items(), (BLUE, RED, GREEN), ("-", "--", "-.")):
        smooth = np.apply_along_axis(np.convolve, 1, np.asarray(values, float), np.ones(window) / window, "valid")
        x, smooth = (np.arange(smooth.shape[1]) + window)[:: window // 2], smooth[:, :: window // 2]
        band(ax, x, smooth.mean(axis=0), smooth.std(axis=0) / np.sqrt(len(smooth)), label, color=colour, ls=line)
    ax.set(xlabel="episode", ylabel=f"sum of rewards, mean of {window} episodes", ylim=ylim, title=title)
    ax.legend(loc="lower right")
    return fig


def value_paths(runs: Curves, ends: Curves, *, names: Sequence[Any] = ("V(A)", "V(B)")) -> Figure:
    """How pairs of estimates move in the plane; runs: {label: (n, 2)}, ends: {label: point}. cl-047"""
    fig, ax = new_figure(width=5.2, height=4.6)
    for (label, path), colour, line in zip(runs.items(), (RED, BLUE), ("--", "-")):
        ax.plot(*path.T, color=colour, ls=line, label=label)
    for (label, (x, y)), mark in zip(ends.items(), "Xo"):
        ax.plot([x], [y], mark, color=PALETTE["black"], ms=10)
        ground = {"fc": "white", "ec": "none", "pad": 1.0}
        ax.annotate(label, (x, y), (0, -42), textcoords="offset points", fontsize=11, ha="left", bbox=ground)
    ax.set(xlabel=names[0], ylabel=names[1], xlim=(-0.05, 1.25), ylim=(0.4, 1.05))
    ax.legend(loc="lower left")
    return fig


def cliff_step(update: Any, names: Sequence[Any], title: str, *, target: float) -> Figure:
    """One update of a control method on the cliff: where it is, what it does, which entry changes. fig-20, fig-21

    update: rlcore.studies.ch04.Update. names: of the actions. target: what the rule bootstraps from, in words.
    """
    fig, ax = new_figure(width=7.2, height=3.1)
    ground = np.full((4, 12), 0.12)
    ground[3, 1:11] = 1.0
    heatmap(ax, ground, fmt=None, cmap="Greys", vmin=0, vmax=1.6)
    row, col = divmod(update.s, 12)
    circle(ax, (col, row), "S", radius=0.3, face=BLUE, fontsize=12)
    if update.s_next >= 0:
        row_next, col_next = divmod(update.s_next, 12)
        circle(ax, (col_next, row_next), "S'", radius=0.3, edge=RED, fontsize=12)
    text = f"A = {names[update.a]}:  Q(S, A) goes from {update.old:.2f} to {update.new:.2f}, towards R + {target}"
    ax.text(5.5, 4.05, text, ha="center", va="center", fontsize=12)
    ax.set(title=title, ylim=(4.5, -0.5))
    return fig
