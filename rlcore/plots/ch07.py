"""Figures of chapter 7: policy gradients."""

from __future__ import annotations

import numpy as np

from rlcore.core.types import ArrayLike
from rlcore.plots.style import PALETTE, SMALL, Curves, Figure, Point, band, new_figure, styles

BLUE, RED, GREEN, GREY, BLACK = (PALETTE[name] for name in ("blue", "vermillion", "green", "grey", "black"))


def corridor_ascent(p: ArrayLike, J: ArrayLike, path: ArrayLike, best: float, title: str = "") -> Figure:
    """J of the short corridor against the probability of going right, and the steps of an ascent.

    Parameters
    ----------
    p : ArrayLike
        (n,).
    J : ArrayLike
        (n,).
    path : ArrayLike
        (m,), probabilities that the ascent goes through.
    best : float
        The best p.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-49.
    """
    fig, ax = new_figure(height=3.8)
    ax.plot(p, J, color=BLUE, ls="-")
    ax.plot(path, np.interp(path, p, J), "o-", color=RED, ms=5, lw=1.2, label="ascent")
    ax.axvline(best, color=GREY, ls="--", lw=1.2, label=f"best: p = {best:.3f}")
    ax.set(xlabel="probability of right", ylabel="expected return J", ylim=(-90, 0), title=title)
    ax.legend(loc="lower center")
    return fig


def slope_against_differences(x: ArrayLike, J: ArrayLike, at: Point, slope: float, title: str = "") -> Figure:
    """J along one parameter, and the exact gradient as its tangent.

    Parameters
    ----------
    x : ArrayLike
        (n,).
    J : ArrayLike
        (n,).
    at : Point
        A point (x, J).
    slope : float
        The gradient there.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-50.
    """
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
    """Expected change of each action's preference.

    Parameters
    ----------
    updates : Curves
        {label: (A,)}.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-51, cl-105.
    """
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
    """Return of each episode, smoothed over 10: mean over runs, its standard error, and medians.

    Parameters
    ----------
    curves : Curves
        {label: (n_runs, n)}.
    best : float
        Height of a dashed line.
    ylim : Point
        Ends of the axis.
    title : str
        Written above.
    medians : bool
        Whether medians are drawn.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-53.
    """
    fig, ax = new_figure(height=4.4)
    for (label, values), style in zip(curves.items(), styles(curves).values()):
        colour = style["color"]
        smooth = np.apply_along_axis(np.convolve, 1, values, np.ones(10) / 10, "valid")[:, ::10]
        x = 10 * np.arange(smooth.shape[1]) + 10
        error = smooth.std(axis=0) / np.sqrt(len(smooth))
        band(ax, x, smooth.mean(axis=0), error, f"{label}, mean", color=colour, ls="-")
        if medians:
            ax.plot(x, np.median(smooth, axis=0), color=colour, ls=":", lw=1.4, label=f"{label}, median")
    ax.axhline(best, color=GREY, ls="--", lw=1.2, label=f"{best:.2f}")
    ax.set(xlabel="episode", ylabel="return", ylim=ylim, title=title)
    ax.legend(ncols=2, fontsize=SMALL, handlelength=1.4)
    return fig


def baseline_variance(estimates: Curves, title: str = "") -> Figure:
    """Variance of a gradient estimate against the baseline: a parabola, its bottom marked.

    Parameters
    ----------
    estimates : Curves
        {baseline: (n,)}, at least three, estimates of the same episodes.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-54.
    """
    fig, ax = new_figure(height=3.6)
    b, variance = np.array(sorted(estimates), float), np.array([np.var(estimates[b]) for b in sorted(estimates)])
    curve = np.polynomial.Polynomial.fit(b, variance, 2)  # (G - b) times the score: its variance is quadratic in b
    x, best = np.linspace(b[0], b[-1], 200), float(curve.deriv().roots()[0])
    ax.plot(x, curve(x), color=BLUE, ls="-")
    ax.plot(b, variance, "o", color=BLUE, label="single-episode estimates")
    ax.plot([best], [curve(best)], "X", color=RED, ms=11, label=f"best: b = {best:.1f}, variance {curve(best):.0f}")
    ax.plot([0], [curve(0.0)], "s", color=BLACK, ms=9, label=f"none: b = 0, variance {curve(0.0):.0f}")
    ax.set(xlabel="baseline b", ylabel="variance", ylim=(0, 1.1 * variance.max()), title=title)
    ax.legend()
    return fig


def gradient_histograms(estimates: Curves, title: str = "") -> Figure:
    """Distribution of single-episode gradient estimates, means marked.

    Parameters
    ----------
    estimates : Curves
        {label: (n,)}.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-54.
    """
    fig, ax = new_figure(height=3.8)
    edges = np.linspace(-60, 60, 121)
    for (label, values), colour in zip(estimates.items(), (BLUE, RED)):
        text = f"{label}: mean {values.mean():.1f}, variance {values.var():.0f}"
        ax.hist(values.clip(-60, 60), edges, density=True, histtype="step", color=colour, lw=1.8, label=text)
    ax.axvline(0, color=GREY, ls="-", lw=0.8)
    ax.set(xlabel="gradient estimate of one episode", ylabel="density", title=title)
    ax.legend(fontsize=SMALL)
    return fig


def two_rules(d: ArrayLike, soft: ArrayLike, greedy: ArrayLike) -> Figure:
    """Probability of the second action against the difference of the values.

    Parameters
    ----------
    d : ArrayLike
        (n,), differences.
    soft : ArrayLike
        (n,), of softmax.
    greedy : ArrayLike
        (n,), of epsilon-greedy.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-eps-greedy-jump.
    """
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
    """How often to bluff and how often to call, while both learn.

    Parameters
    ----------
    paths : Curves
        {label: (n, 2)}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-bluff, cl-102.
    """
    fig, ax = new_figure(height=4.4)
    for (label, path), colour, line in zip(paths.items(), (BLUE, RED), ("-", ":")):
        ax.plot(*path.T, color=colour, ls=line, lw=1.2, label=label)
    ax.plot([1 / 3], [2 / 3], "X", color=BLACK, ms=11, label="equilibrium (1/3, 2/3)")
    ax.set(xlabel="probability of bluffing", ylabel="probability of calling", xlim=(0, 1), ylim=(0, 1))
    ax.legend(fontsize=SMALL)
    return fig


def steps_balanced(blocks: Curves, *, block: int = 20, solved: float = 195, title: str = "") -> Figure:
    """Steps on the pole, mean over seeds and the middle half of them.

    Parameters
    ----------
    blocks : Curves
        {label: (seeds, blocks)}, mean length of each `block` episodes.
    block : int
        Episodes of a block.
    solved : float
        Height of a dashed line.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-56.
    """
    fig, ax = new_figure(height=4.0)
    for (label, runs), style in zip(blocks.items(), styles(blocks).values()):
        episode = block * (np.arange(runs.shape[1]) + 1)
        band(ax, episode, runs.mean(axis=0), np.percentile(runs, [25, 75], axis=0), label, **style)
    ax.axhline(solved, color=GREY, ls="--", lw=1.2, label=f"solved: {solved}")
    ax.set(xlabel="episode", ylabel=f"steps, mean of {block} episodes", ylim=(0, 290), title=title)
    ax.set_yticks(range(0, 201, 50))
    ax.legend(loc="upper center", ncols=2, handlelength=1.6)
    return fig
