"""Figures of chapter 7: policy gradients."""

from __future__ import annotations

import numpy as np

from rlcore.core.types import ArrayLike
from rlcore.plots.style import PALETTE, Curves, Figure, Point, band, new_figure

BLUE, RED, GREEN, GREY, BLACK = (PALETTE[name] for name in ("blue", "vermillion", "green", "grey", "black"))


def corridor_ascent(p: ArrayLike, J: ArrayLike, path: ArrayLike, best: float, title: str = "") -> Figure:
    """J of the short corridor against the probability of going right, and the steps of an ascent. fig-49

    p, J: (n,). path: (m,) probabilities that the ascent goes through. best: the best p.
    """
    fig, ax = new_figure(height=3.8)
    ax.plot(p, J, color=BLUE, ls="-")
    ax.plot(path, np.interp(path, p, J), "o-", color=RED, ms=5, lw=1.2, label="ascent")
    ax.axvline(best, color=GREY, ls="--", lw=1.2, label=f"best: p = {best:.3f}")
    ax.set(xlabel="probability of right", ylabel="expected return J", ylim=(-90, 0), title=title)
    ax.legend(loc="lower center")
    return fig


def slope_against_differences(x: ArrayLike, J: ArrayLike, at: Point, slope: float, title: str = "") -> Figure:
    """J along one parameter, and the exact gradient as its tangent. fig-50; x, J: (n,); at: a point (x, J)."""
    fig, ax = new_figure(height=3.6)
    ax.plot(x, J, color=BLUE, ls="-", label="J along one parameter")
    reach = 0.25 * (x[-1] - x[0])
    ax.plot(
        [at[0] - reach, at[0] + reach],
        [at[1] - slope * reach, at[1] + slope * reach],
        color=RED,
        ls="--",
        label="exact slope",
    )
    ax.plot(*at, "o", color=RED)
    ax.set(xlabel="parameter", ylabel="J", title=title)
    ax.legend()
    return fig


def update_bars(updates: Curves, title: str = "") -> Figure:
    """Expected change of each action's preference; updates: {label: (A,)}. fig-51, cl-105"""
    fig, ax = new_figure(height=3.4)
    for k, ((label, values), colour) in enumerate(zip(updates.items(), (BLUE, RED))):
        ax.bar(np.arange(len(values)) + 0.36 * (k - 0.5), values, width=0.34, color=colour, label=label)
    ax.axhline(0, color=BLACK, ls="-", lw=0.8)
    ax.set(xticks=range(len(values)), xticklabels=[f"action {a + 1}" for a in range(len(values))], title=title)
    ax.set(ylabel="expected change")
    ax.legend()
    return fig


def returns_by_episode(
    curves: Curves, best: float, *, ylim: Point = (-90, -5), title: str = "", medians: bool = True
) -> Figure:
    """Return of each episode, mean over runs with its standard error, and medians; curves: {label: (n_runs, n)}. fig-53

    best: dashed line. Smoothed over 10 episodes.
    """
    fig, ax = new_figure(height=4.4)
    for (label, values), colour in zip(curves.items(), (BLUE, RED, GREEN)):
        smooth = np.apply_along_axis(np.convolve, 1, values, np.ones(10) / 10, "valid")[:, ::10]
        x = 10 * np.arange(smooth.shape[1]) + 10
        error = smooth.std(axis=0) / np.sqrt(len(smooth))
        band(ax, x, smooth.mean(axis=0), error, f"{label}, mean", color=colour, ls="-")
        if medians:
            ax.plot(x, np.median(smooth, axis=0), color=colour, ls=":", lw=1.4, label=f"{label}, median")
    ax.axhline(best, color=GREY, ls="--", lw=1.2, label=f"{best:.2f}")
    ax.set(xlabel="episode", ylabel="return", ylim=ylim, title=title)
    ax.legend(ncols=2, fontsize=10)
    return fig


def gradient_histograms(estimates: Curves, title: str = "") -> Figure:
    """Distribution of single-episode gradient estimates, means marked; estimates: {label: (n,)}. fig-54"""
    fig, ax = new_figure(height=3.8)
    edges = np.linspace(-60, 60, 121)
    for (label, values), colour in zip(estimates.items(), (BLUE, RED)):
        text = f"{label}: mean {values.mean():.1f}, variance {values.var():.0f}"
        ax.hist(values.clip(-60, 60), edges, density=True, histtype="step", color=colour, lw=1.8, label=text)
    ax.axvline(0, color=GREY, ls="-", lw=0.8)
    ax.set(xlabel="gradient estimate of one episode", ylabel="density", title=title)
    ax.legend(fontsize=10)
    return fig


def two_rules(d: ArrayLike, soft: ArrayLike, greedy: ArrayLike) -> Figure:
    """Probability of the second action against the difference of the values. ex-eps-greedy-jump; all (n,)."""
    fig, ax = new_figure(height=3.4)
    ax.plot(d, soft, color=BLUE, ls="-", label="softmax")
    ax.plot(d, greedy, color=RED, ls="--", label="ε-greedy, ε = 0.1")
    ax.set(
        xlabel="difference of the values",
        ylabel="probability of action 2",
        ylim=(0, 1),
        xticks=np.linspace(d[0], d[-1], 5),
    )
    ax.legend()
    return fig


def bluff_paths(paths: Curves) -> Figure:
    """How often to bluff and how often to call, while both learn; paths: {label: (n, 2)}. ex-bluff, cl-102"""
    fig, ax = new_figure(width=5.2, height=4.4)
    for (label, path), colour, line in zip(paths.items(), (BLUE, RED), ("-", ":")):
        ax.plot(*path.T, color=colour, ls=line, lw=1.2, label=label)
    ax.plot([1 / 3], [2 / 3], "X", color=BLACK, ms=11, label="equilibrium (1/3, 2/3)")
    ax.set(xlabel="probability of bluffing", ylabel="probability of calling", xlim=(0, 1), ylim=(0, 1))
    ax.legend(fontsize=10)
    return fig


def steps_balanced(blocks: Curves, *, block: int = 20, solved: float = 195, title: str = "") -> Figure:
    """Steps on the pole, mean over seeds and the middle half of them; blocks: {label: (seeds, blocks)}, mean length of
    each `block` episodes. fig-56
    """
    fig, ax = new_figure(height=4.0)
    for (label, runs), colour in zip(blocks.items(), (BLUE, RED, GREEN)):
        episode = block * (np.arange(runs.shape[1]) + 1)
        band(ax, episode, runs.mean(axis=0), np.percentile(runs, [25, 75], axis=0), label, color=colour)
    ax.axhline(solved, color=GREY, ls="--", lw=1.2, label=f"solved: {solved}")
    ax.set(xlabel="episode", ylabel=f"steps, mean of {block} episodes", ylim=(0, 210), title=title)
    ax.legend(loc="lower right")
    return fig
