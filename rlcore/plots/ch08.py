"""Figures of chapter 8: from labels to proximal policy optimisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator

from rlcore.core.types import ArrayLike, Floats
from rlcore.plots.style import PALETTE, SMALL, Curves, Figure, Point, arrow, band, box, new_figure, styles

BLUE, RED, GREEN, GREY, BLACK = (PALETTE[name] for name in ("blue", "vermillion", "green", "grey", "black"))
SYMLOG_TICKS = np.array([-30, -10, -3, -1, -0.5, 0, 0.5, 1])


def log_probability_step(
    screen: ArrayLike, names: Sequence[Any], before: ArrayLike, after: ArrayLike, put: ArrayLike, title: str = ""
) -> Figure:
    """A screen, the network, and log probabilities of the actions before and after one step.

    Parameters
    ----------
    screen : ArrayLike
        (rows, columns).
    names : Sequence[Any]
        Of the actions.
    before : ArrayLike
        (A,), log probabilities.
    after : ArrayLike
        (A,), likewise.
    put : ArrayLike
        (A,), the gradient that was put on each.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-57, ex-up-down.
    """
    fig, (left, middle, right) = new_figure(1, 3, height=3.4, width_ratios=[0.55, 1, 1.3])
    left.imshow(screen, cmap="Greys", vmin=0, vmax=1.4)
    left.set(xticks=[], yticks=[], title="screen")
    left.grid(False)
    left.spines[:].set_visible(True)
    middle.set(xlim=(0, 4), ylim=(0, 4))
    middle.axis("off")
    box(middle, (2, 2), "network", width=2.2, height=1.1, fontsize=SMALL)
    arrow(middle, (0, 2), (0.9, 2))
    for y, number in zip(np.linspace(3.3, 0.7, len(names)), put):
        arrow(middle, (3.1, 2), (3.9, y))
        colour = RED if number else GREY
        middle.text(3.9, y + (0.35 if y > 2 else -0.35), f"{number:+.1f}" if number else "0", color=colour, ha="right",
                    va="center", fontsize=SMALL)  # fmt: skip
    y = np.arange(len(names))[::-1]
    right.barh(y + 0.19, before, height=0.34, color=GREY, label="before")
    right.barh(y - 0.19, after, height=0.34, color=BLUE, label="after")
    right.set(yticks=y, yticklabels=names, xlabel="log probability", xlim=(-2.6, 0), ylim=(-1.4, len(names) - 0.4))
    right.legend(fontsize=SMALL, loc="lower left", handlelength=1)
    fig.suptitle(title, fontsize=SMALL)
    return fig


def progress(
    x: ArrayLike, curves: Curves, xlabel: str, ylabel: str, *, ylim: Point | None = None,
    spread: Curves | None = None, level: tuple[float, str] | None = None, logx: bool = False, title: str = "",
) -> Figure:  # fmt: skip
    """Lines over x with the spread over runs.

    Parameters
    ----------
    x : ArrayLike
        (n,).
    curves : Curves
        {label: (n,) or (n_runs, n)}.
    xlabel : str
        Of the x axis.
    ylabel : str
        Of the y axis.
    ylim : Point | None
        Ends of the axis.
    spread : Curves | None
        {label: (2, n)}, lowest and highest run, where curves holds means.
    level : tuple[float, str] | None
        (height, text) of a dashed line.
    logx : bool
        Whether x is logarithmic.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-117, ex-netflix, ex-entropy.
    """
    fig, ax = new_figure(height=3.8)
    for (label, values), style in zip(curves.items(), styles(curves).values()):
        values = np.atleast_2d(values)
        ends = spread[label] if spread else [values.min(axis=0), values.max(axis=0)]
        band(ax, x, values.mean(axis=0), ends, label, **style)
    if level is not None:
        ax.axhline(level[0], color=GREY, ls="--", lw=1.2, label=level[1])
    ax.set(xlabel=xlabel, ylabel=ylabel, ylim=ylim, title=title, xscale="log" if logx else "linear")
    ax.legend(fontsize=SMALL)
    return fig


def catch_rates(rates: Curves, *, width: int = 200) -> Figure:
    """Share of the balls that are caught, each seed and the mean.

    Parameters
    ----------
    rates : Curves
        {label: (n_seeds, n_episodes)}.
    width : int
        Each point is the mean of that many episodes.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-collapse.
    """
    fig, axes = new_figure(1, len(rates), height=3.6, sharey=True, squeeze=False)
    for ax, (label, values), colour in zip(axes[0], rates.items(), (BLUE, RED, GREEN)):
        n = values.shape[1] // width
        means = values[:, : n * width].reshape(len(values), n, width).mean(axis=2)
        x = width * np.arange(1, n + 1)
        ax.plot(x, means.T, color=colour, ls="-", lw=0.8, alpha=0.35)
        ax.plot(x, means.mean(axis=0), color=BLACK, ls="-", lw=2.6, label="mean")
        ax.axhline(0.2, color=GREY, ls="--", lw=1.2, label="at random")
        ax.set(xlabel="episode", title=label, ylim=(0, 1.02))
    axes[0, 0].set_ylabel("share caught")
    axes[0, 0].legend(fontsize=SMALL, loc="upper left")
    return fig


def two_distances(theta: ArrayLike, kls: ArrayLike) -> Figure:
    """The same step of the parameter from several starts, on the policy and as KL.

    Parameters
    ----------
    theta : ArrayLike
        (n,).
    kls : ArrayLike
        (n,).

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-distance.
    """
    fig, (left, right) = new_figure(1, 2, height=3.6)
    line = np.linspace(-1, theta[-1] + 2, 200)
    left.plot(line, 1 / (1 + np.exp(-line)), color=BLUE, ls="-")
    for start in theta:
        ends = np.array([start, start + 1])
        left.plot(ends, 1 / (1 + np.exp(-ends)), "o-", color=RED, ms=5)
    left.set(xlabel="parameter", ylabel="probability of action 1")
    right.bar(range(len(theta)), kls, color=RED, width=0.6)
    for i, value in enumerate(kls):
        right.text(i, value * 1.15, f"{value:.2g}", ha="center", fontsize=SMALL)
    right.set(yscale="log", ylim=(min(kls) / 2, max(kls) * 3), ylabel="KL(old, new)")
    right.set(xticks=range(len(theta)), xticklabels=[f"{t:g}→{t + 1:g}" for t in theta], xlabel="step of the parameter")
    right.tick_params(axis="x", labelsize=SMALL)
    return fig


def two_searches(
    f: Callable[[Floats], ArrayLike], paths: Curves, radii: ArrayLike, *, xlim: Point = (-1.7, 1.7),
    ylim: Point = (-0.8, 2.2),
) -> Figure:  # fmt: skip
    """Contours of a function with the paths of a line search and of a trust region.

    Parameters
    ----------
    f : Callable[[Floats], ArrayLike]
        Of arrays x, y.
    paths : Curves
        {label: (n, 2)}, the last one that of the trust region.
    radii : ArrayLike
        (n,), of its steps.
    xlim : Point
        Ends of the axis.
    ylim : Point
        Ends of the axis.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: alg-line-search, alg-trust-region.
    """
    from matplotlib.patches import Circle

    fig, ax = new_figure(height=4.8)
    x, y = np.meshgrid(np.linspace(*xlim, 200), np.linspace(*ylim, 200))
    ax.contour(x, y, np.log10(0.01 - f(x, y)), levels=12, cmap="Greys_r", linewidths=0.8, linestyles="-")
    for (label, path), colour, line in zip(paths.items(), (BLUE, RED), ("-", "--")):
        ax.plot(*path.T, "o", ls=line, color=colour, ms=4, lw=1.6, label=label)
    for centre, radius in list(zip(path, radii))[::4]:
        ax.add_patch(Circle(centre, radius, fill=False, ec=RED, lw=0.9, ls=":"))
    ax.plot(1, 1, "*", color=BLACK, ms=14, label="top")
    ax.set(xlabel="x", ylabel="y", xlim=xlim, ylim=ylim)
    ax.legend(loc="lower right", fontsize=SMALL)
    return fig


def minorize(theta: ArrayLike, performance: ArrayLike, bounds: Curves, path: ArrayLike, title: str = "") -> Figure:
    """Performance along one parameter, a bound for each step, and where each leads.

    Parameters
    ----------
    theta : ArrayLike
        (n,).
    performance : ArrayLike
        (n,).
    bounds : Curves
        (k, n), the last one drawn strongest.
    path : ArrayLike
        (k + 1,), parameters.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-58, ex-mm, alg-mm.
    """
    fig, ax = new_figure(height=4.2)
    ax.plot(theta, performance, color=RED, ls="-", label="performance η")
    for k, bound in enumerate(bounds):
        last = k == len(bounds) - 1
        below = np.all(bound <= performance + 1e-9)
        label = ("lower bound M" if below else "M, above η: no bound") if last else None
        ax.plot(theta, bound, color=BLUE, ls="--" if last else ":", lw=2.2 if last else 1.0, label=label)
        ax.plot(
            path[k], np.interp(path[k], theta, performance), "o", color=BLACK if last else GREY, ms=8 if last else 5
        )
    top = np.interp(path[-1], theta, bounds[-1])
    ax.plot(path[-1], top, "^", color=BLUE, ms=9, label="its maximum: the next point")
    ax.plot([path[-1]] * 2, [top, np.interp(path[-1], theta, performance)], color=GREY, ls=":", lw=1.2)
    low, high = performance.min(), performance.max()
    ax.set(xlabel="parameter θ", ylabel="expected return", ylim=(low - 0.5 * (high - low), high + 0.8 * (high - low)))
    ax.set(title=title)
    ax.legend(fontsize=SMALL, loc="upper left")
    return fig


def kl_by_scale(scales: ArrayLike, kls: Curves, target: float) -> Figure:
    """KL of one update against the scale of the rewards, a line for each rule.

    Parameters
    ----------
    scales : ArrayLike
        (n,).
    kls : Curves
        {label: (n,)}.
    target : float
        Height of a dashed line.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-beta, cl-130.
    """
    fig, ax = new_figure(height=3.8)
    for (label, values), style, mark in zip(kls.items(), styles(kls).values(), "os^"):
        ax.plot(scales, values, label=label, **style | {"marker": mark})
    ax.axhline(target, color=GREY, ls="--", lw=1.2)
    ax.set(xscale="log", yscale="log", xlabel="rewards times", ylabel="mean KL(old, new)")
    ax.set(xticks=scales, xticklabels=[f"{scale:g}" for scale in scales])
    ax.legend(fontsize=SMALL)
    return fig


def kl_and_beta(runs: Curves, target: float) -> Figure:
    """Mean KL and coefficient of each update, one line a rule.

    Parameters
    ----------
    runs : Curves
        {label: Steps}.
    target : float
        Height of a dashed line.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-127, cl-131.
    """
    fig, (top, bottom) = new_figure(2, 1, height=4.8, sharex=True)
    for (label, run), style in zip(runs.items(), styles(runs).values()):
        x = np.arange(1, len(run.kl) + 1)
        top.plot(x, run.kl, label=label, **style)
        bottom.plot(x, run.beta, **style)
    top.axhline(target, color=GREY, ls="--", lw=1.2)
    top.set(yscale="log", ylabel="mean KL")
    bottom.set(yscale="log", ylabel="β", xlabel="update")
    top.legend(fontsize=SMALL)
    return fig


def clip_term(
    ratio: ArrayLike, unclipped: ArrayLike, clipped: ArrayLike, at: Sequence[float], epsilon: float, title: str = ""
) -> Figure:
    """One term of the clipped objective against the ratio, and its slope at one ratio.

    Shaded: where the unclipped term is the lower one.

    Parameters
    ----------
    ratio : ArrayLike
        (n,).
    unclipped : ArrayLike
        (n,), one term of the minimum.
    clipped : ArrayLike
        (n,), the other.
    at : Sequence[float]
        (ratio, value, slope).
    epsilon : float
        Where it is clipped.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-59, fig-60, ex-clip-cases.
    """
    fig, ax = new_figure(height=4.8)
    low, high = min(unclipped.min(), clipped.min()), max(unclipped.max(), clipped.max())
    lower = unclipped < clipped - 1e-12
    ax.fill_between(
        ratio, low - 0.2, high + 0.2, where=lower, color=GREEN, alpha=0.15, lw=0, label="unclipped is lower"
    )
    ax.plot(ratio, unclipped, color=GREY, ls="--", lw=1.8, label="unclipped, r A")
    ax.plot(ratio, clipped, color=PALETTE["ochre"], ls="-.", lw=1.8, label="clipped")
    ax.plot(ratio, np.minimum(unclipped, clipped), color=BLUE, ls="-", lw=2.6, label="their minimum")
    r, value, slope = at
    ends = np.array([r - 0.35, r + 0.35])
    ax.plot(ends, value + slope * (ends - r), color=RED, ls="-", lw=1.4)
    ax.plot(r, value, "o", color=RED, label=f"slope {slope:g}: gradient {'on' if slope else 'off'}")
    for x in (1 - epsilon, 1 + epsilon):
        ax.axvline(x, color=BLACK, ls=":", lw=0.9)
    ax.set(
        xlabel="ratio r", ylabel="one term of L", xlim=(ratio[0], ratio[-1]), ylim=(low - 0.2, high + 0.2), title=title
    )
    fig.legend(fontsize=SMALL, loc="outside lower center", ncols=2, handlelength=1.6)
    return fig


def returns_and_kl(curves: Curves, *, top: int = 500, title: str = "") -> Figure:
    """Return and KL of each rollout.

    Bands: from the lowest to the highest seed; from the median to the largest KL.

    Parameters
    ----------
    curves : Curves
        {label: dict of (n,) low, mean, high, kl, largest_kl of the seeds}.
    top : int
        The highest return there is.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-61.
    """
    fig, (upper, lower) = new_figure(2, 1, height=5.2, sharex=True)
    for (label, of), style in zip(curves.items(), styles(curves).values()):
        x = np.arange(1, len(of["mean"]) + 1)
        band(upper, x, of["mean"], [of["low"], of["high"]], label, **style)
        band(lower, x, of["kl"], [of["kl"], of["largest_kl"]], label, **style)
    upper.set(ylabel="return", ylim=(0, 1.04 * top), title=title)
    lower.set(ylabel="KL(old, new)", xlabel="rollout of 512 steps", yscale="log")
    upper.legend(fontsize=SMALL, loc="lower right")
    return fig


def by_setting(
    runs: Curves,
    xlabel: str,
    *,
    marks: Curves | None = None,
    mark_label: str = "",
    linear: float | None = None,
    height: float = 4.4,
    title: str = "",
    ylabel: str = "",
    dots: str = "one run",
) -> Figure:
    """Each value as a dot, a row for each setting, means as bars.

    Parameters
    ----------
    runs : Curves
        {label: (n,)}.
    xlabel : str
        Of the x axis.
    marks : Curves | None
        {label: one more value}, such as the published one.
    mark_label : str
        What a mark is.
    linear : float | None
        Beyond +-linear the scale is logarithmic.
    height : float
        In inches.
    title : str
        Written above.
    ylabel : str
        Of the y axis.
    dots : str
        What a dot is.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-61, cl-138, cl-143.
    """
    fig, ax = new_figure(height=height)
    y = np.arange(len(runs))[::-1]
    if linear is not None:
        ax.set_xscale("symlog", linthresh=linear, linscale=1.5)
        ax.xaxis.set(major_locator=FixedLocator(linear * SYMLOG_TICKS), major_formatter="{x:g}")
    for row, values in zip(y, runs.values()):
        values = np.asarray(values)[np.isfinite(values)]
        named = {"label": dots} if row == y[0] else {}
        ax.plot(values, np.full(len(values), row), "o", color=BLUE, ms=5, alpha=0.45, **named)
        if len(values):
            named = {"label": "mean"} if row == y[0] else {}
            ax.plot([values.mean()] * 2, [row - 0.32, row + 0.32], color=BLUE, ls="-", lw=3, **named)
    if marks is not None:
        ax.plot(marks, y, "D", color=RED, ms=6, label=mark_label)
    fig.legend(fontsize=SMALL, loc="outside lower center", ncols=3, handlelength=1.2, frameon=False)
    ax.set(xlabel=xlabel, yticks=y, yticklabels=list(runs), ylim=(-0.7, len(runs) - 0.3), title=title, ylabel=ylabel)
    ax.tick_params(axis="y", labelsize=SMALL)
    return fig


def days_of_learning(days: Curves, title: str = "") -> Figure:
    """How long each amount of experience takes at one rate, on a logarithmic scale.

    Parameters
    ----------
    days : Curves
        {label: number}.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-dota.
    """
    fig, ax = new_figure(height=4.0)
    y = np.arange(len(days))[::-1]
    ax.barh(y, list(days.values()), left=1e-8, color=BLUE, height=0.6)
    units = (("years", 365.25, 730), ("days", 1, 2), ("hours", 1 / 24, 1 / 12), ("minutes", 1 / 1440, 1 / 720))
    for row, value in zip(y, days.values()):
        unit, size = next(((unit, size) for unit, size, least in units if value >= least), ("seconds", 1 / 86400))
        ax.text(value * 1.4, row, f"{float(f'{value / size:.2g}'):,g} {unit}", va="center", fontsize=SMALL)
    for value, text, side in ((1, "day ", "right"), (365.25, " year", "left"), (365.25 * 80, " 80 years", "left")):
        ax.axvline(value, color=GREY, ls=":", lw=1.1)
        height = len(days) - (0.42 if side == "right" or text == " year" else -0.1)
        ax.text(value, height, text, ha=side, fontsize=SMALL, color=GREY)
    ax.set(xscale="log", xlim=(1e-8, 1e9), ylim=(-0.6, len(days) + 0.6), xlabel="days", yticks=y)
    ax.set(yticklabels=list(days), title=title)
    return fig
