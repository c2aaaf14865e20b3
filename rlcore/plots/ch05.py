"""Figures of chapter 5: eligibility traces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rlcore.core.types import ArrayLike, Floats
from rlcore.plots.style import PALETTE, SMALL, Curves, Figure, Point, arrow, band, new_diagram, new_figure, styles

BLUE, RED, GREEN, GREY, BLACK = (PALETTE[name] for name in ("blue", "vermillion", "green", "grey", "black"))


def backup_spectrum(steps: Sequence[Any], weights: ArrayLike | None = None, title: str = "") -> Figure:
    """Backup diagrams side by side, each a chain of states and actions.

    Parameters
    ----------
    steps : Sequence[Any]
        How many steps each looks ahead; the last one reaches the end.
    weights : ArrayLike | None
        Written under the columns.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: om-spectrum-figure, fig-23.
    """
    fig, ax = new_diagram((-1, 2 * len(steps) - 0.4), (-2 * max(steps) - 2.1, 2.6), height=4.8)
    ax.set_aspect("auto")
    for k, n in enumerate(steps):
        x, last = 2 * k, k == len(steps) - 1
        for i in range(n):
            ax.plot([x, x], [-2 * i, -2 * i - 2], color=BLACK, ls="-", lw=1.4, zorder=1)
            ax.plot([x], [-2 * i], "o", color="white", mec=BLACK, ms=12, zorder=2)
            ax.plot([x], [-2 * i - 1], "o", color=BLACK, ms=7, zorder=2)
        ax.plot([x], [-2 * n], "s" if last else "o", color="#d9d9d9" if last else "white", mec=BLACK, ms=13, zorder=2)
        ax.text(
            x, 0.9, "Monte\nCarlo" if last else f"{n}\nstep" + "s" * (n > 1), ha="center", va="bottom", fontsize=SMALL
        )
        if weights is not None:
            ax.text(x, -2 * n - 1.5, f"{weights[k]:.2g}", ha="center", va="center", color=BLUE, fontsize=SMALL)
    ax.set_title(title)
    return fig


def return_weights(weights: ArrayLike, lam: float) -> Figure:
    """Weights of the n-step returns in the lambda-return, the complete return in red.

    Parameters
    ----------
    weights : ArrayLike
        (T,).
    lam : float
        Lambda, for the title.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-24.
    """
    fig, ax = new_figure(height=3.6)
    n = np.arange(1, weights.size + 1)
    ax.vlines(n[:-1], 0, weights[:-1], color=BLUE, ls="-", lw=3)
    ax.plot(n[:-1], weights[:-1], "o", color=BLUE, label="n-step returns")
    ax.bar(n[-1:], weights[-1:], width=0.7, color=RED, label=f"complete return, {weights[-1]:.2g}")
    half = f", half of it every {np.log(0.5) / np.log(lam):.1f} steps" if 0 < lam < 1 else ""
    ax.set(xlabel="n", ylabel="weight", title=f"λ = {lam:g}{half}", ylim=(0, 1.05 * max(weights.max(), 0.1)))
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.legend()
    return fig


def time_line(states: ArrayLike, t: int, heights: ArrayLike, title: str, *, forward: bool) -> Figure:
    """An episode as a row of states; from one time, bars and arcs forward to rewards or back to states.

    Parameters
    ----------
    states : ArrayLike
        (T + 1,).
    t : int
        The time.
    heights : ArrayLike
        Forward, the effect of R_{t+1} ... R_T on the target, (T - t,); backward, what the states S_0 ... S_t are
        credited with, (t + 1,), see `visit_credits`.
    title : str
        Written above.
    forward : bool
        Which of the two.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-25, fig-27.
    """
    T = len(states) - 1
    fig, ax = new_figure(height=3.4)
    x = np.arange(t + 1, T + 1) if forward else np.arange(t + 1)
    largest = max(np.abs(heights).max(), 1e-12)
    ax.bar(x, np.asarray(heights) / largest, width=0.5, color=BLUE if forward else GREEN, alpha=0.85)
    for at in x[: None if forward else -1]:
        strength = abs(heights[at - t - 1 if forward else at]) / largest
        if strength > 0.01:
            start, end = ((t, -0.2), (at, -0.2)) if forward else ((t, -0.2), (at, -0.2))
            arrow(ax, start, end, curve=0.25 if forward else -0.25, colour=GREY)
            ax.patches[-1].set_linewidth(0.4 + 2.4 * strength)
    for k, s in enumerate(states):
        last = k == T
        ax.plot(
            [k], [-0.2], "s" if last else "o", ms=19, color="#d9d9d9" if last else "white", mec=RED if k == t else BLACK
        )
        ax.text(k, -0.2, "" if last else chr(ord("A") + s - 1), ha="center", va="center", fontsize=SMALL)
    what = "effect on the target" if forward else "credit, share of the largest"
    ax.set(xlabel="time", ylabel=what, title=title, xlim=(-0.7, T + 0.7), ylim=(-0.42, 1.08), yticks=[0, 0.5, 1])
    ax.axhline(0, color=GREY, ls="-", lw=0.8)
    return fig


def visit_credits(states: ArrayLike, t: int, gamma_lam: float, trace: str, alpha: float = 1.0) -> Floats:
    """What each visit so far has left in the trace of its state.

    Parameters
    ----------
    states : ArrayLike
        (T + 1,).
    t : int
        The time.
    gamma_lam : float
        What is left of a visit after a step.
    trace : str
        "accumulating": visits add up; "replacing": the last one of a state alone; "dutch": each later visit takes the
        share alpha away.
    alpha : float
        That share.

    Returns
    -------
    Floats
        (t + 1,); the sum over a state's visits is its trace.

    Notes
    -----
    Ledger: fig-27.
    """
    states, k = np.asarray(states[: t + 1]), np.arange(t + 1)
    later = np.array([(states[i + 1 :] == states[i]).sum() for i in k])
    kept = {"accumulating": 1.0, "replacing": 0.0, "dutch": 1 - alpha}[trace]
    return float(gamma_lam) ** (t - k) * kept**later


def trace_courses(courses: Curves, visits: ArrayLike, title: str = "") -> Figure:
    """The trace of one state in time, a panel for each kind, its visits marked.

    Parameters
    ----------
    courses : Curves
        {kind: (n,)}.
    visits : ArrayLike
        Times of the visits.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-26.
    """
    fig, axes = new_figure(len(courses), 1, height=5.4, sharex=True, sharey=True)
    for ax, (kind, course), style in zip(axes, courses.items(), styles(courses).values()):
        colour = style["color"]
        t = np.arange(course.size)
        ax.step(t, course, where="post", color=colour, ls="-")
        ax.plot(t, course, "o", color=colour, ms=5)
        ax.plot(visits, np.zeros(len(visits)), "|", color=BLACK, ms=14, mew=2.5)
        ax.set_ylabel(kind)
    axes[0].set_title(title)
    axes[-1].set(xlabel="time (marks: visits)", ylim=(-0.15, 3.0))
    return fig


def sweep(
    curves: Curves, *, xlabel: str = "step size α", ylabel: str = "RMS error, first 10 episodes",
    ylim: Point = (0.23, 0.56), title: str = "",
) -> Figure:  # fmt: skip
    """Error against step size, one curve a setting, with its standard error.

    Parameters
    ----------
    curves : Curves
        {label: (x, (n_x, n_runs))}.
    xlabel : str
        Of the x axis.
    ylabel : str
        Of the y axis.
    ylim : Point
        Ends of the axis.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-random-walk-19, alg-n-step-online.
    """
    fig, ax = new_figure(height=4.6)
    for (label, (x, values)), style in zip(curves.items(), styles(curves).values()):
        mean, error = values.mean(axis=1), values.std(axis=1) / np.sqrt(values.shape[1])
        band(ax, x, mean, error, label, **style)
    ax.set(xlabel=xlabel, ylabel=ylabel, ylim=ylim, title=title)
    ax.legend(ncols=2, fontsize=SMALL)
    return fig


def cut_histogram(cuts: ArrayLike, title: str, *, steps: int | None = None) -> Figure:
    """How many steps a trace grows before an exploratory action cuts it.

    The mean of the runs that were cut would leave the long ones out.

    Parameters
    ----------
    cuts : ArrayLike
        (n,), those numbers.
    title : str
        Written above.
    steps : int | None
        All steps taken, also those of traces that the goal ended; with it the title tells how many there are to a
        cut.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-29.
    """
    fig, ax = new_figure(height=3.4)
    length = np.minimum(cuts, 30)
    ax.bar(np.arange(1, 31), np.bincount(length, minlength=31)[1:] / cuts.size, color=BLUE)
    if steps is None:
        ax.axvline(cuts.mean(), color=RED, ls="--", label=f"mean {cuts.mean():.1f}")
        ax.legend()
    else:
        title = f"{title}: one cut in {steps / cuts.size:.3g} steps"
    ax.set(xlabel="steps until a cut (30: 30 and more)", ylabel="share of the cuts", title=title, ylim=(0, 0.7))
    return fig
