"""Figures of chapter 6: neural networks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rlcore.core.types import ArrayLike
from rlcore.plots.style import (
    PALETTE,
    SMALL,
    Curves,
    Figure,
    Point,
    arrow,
    band,
    circle,
    new_diagram,
    new_figure,
    styles,
)

BLUE, RED, GREEN, GREY, BLACK = (PALETTE[name] for name in ("blue", "vermillion", "green", "grey", "black"))
MOST = 10  # neurons of a layer that are drawn one by one


def network_diagram(
    sizes: Sequence[int], *, weights: ArrayLike | None = None, names: Mapping[int, Sequence[str]] | None = None,
    values: ArrayLike | None = None, lit: Iterable[Any] = (), brackets: bool = False, title: str = "",
) -> Figure:  # fmt: skip
    """A feedforward network as circles and lines.

    Parameters
    ----------
    sizes : Sequence[int]
        Neurons of each layer, input first; of more than 10 the middle is left out.
    weights : ArrayLike | None
        List of (n_l, n_{l-1}), drawn as width and colour (orange: negative).
    names : Mapping[int, Sequence[str]] | None
        Texts of the neurons of a layer.
    values : ArrayLike | None
        Activations of each layer, written in.
    lit : Iterable[Any]
        (layer, neuron) each, in red.
    brackets : bool
        Whether pairs in the middle are bracketed.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-30, fig-32, fig-45, fig-47, fig-56.
    """
    fig, ax = new_diagram((-0.6, len(sizes) - 0.4), (-0.62, 0.68), height=4.0)
    ax.set_aspect("auto")
    shown = [range(n) if n <= MOST else [*range(MOST // 2), *range(n - MOST // 2, n)] for n in sizes]
    place = [_heights(ids, n) for ids, n in zip(shown, sizes)]
    largest = max((np.abs(w).max() for w in weights), default=1.0) if weights is not None else 1.0
    for k in range(1, len(sizes)):
        for i, y in place[k].items():
            for j, y0 in place[k - 1].items():
                w = 0.5 if weights is None else weights[k - 1][i, j] / max(largest, 1e-12)
                colour = GREY if weights is None else (BLUE if w >= 0 else RED)
                width = 0.8 if weights is None else 0.2 + 3.0 * abs(w)
                ax.plot([k - 1, k], [y0, y], color=colour, ls="-", lw=width, alpha=0.7, zorder=1)
    for k, ids in enumerate(place):
        for i, y in ids.items():
            edge = RED if (k, i) in lit else BLACK
            ax.plot(
                [k],
                [y],
                "o",
                ms=34 if values is not None else 22 if len(ids) <= 6 else 14,
                color="white",
                mec=edge,
                mew=1.8,
                zorder=2,
            )
            if values is not None:
                ax.text(k, y, f"{values[k][i]:.2f}", ha="center", va="center", fontsize=SMALL, zorder=3)
        if sizes[k] > MOST:
            ax.text(k, 0.0, "⋮", ha="center", va="center", fontsize=18)
        ax.text(k, 0.6, str(sizes[k]), ha="center", va="center", fontsize=SMALL)
    for k, side in ((0, "right"), (len(sizes) - 1, "left")):
        for text, (_, y) in zip((names or {}).get(k, ()), place[k].items()):
            ax.text(k + (-0.12 if side == "right" else 0.12), y, text, ha=side, va="center", fontsize=SMALL)
    if brackets:
        for i in range(0, sizes[1] - 1, 2):
            high, low = place[1][i] + 0.02, place[1][i + 1] - 0.02
            ax.plot([1.09, 1.13, 1.13, 1.09], [high, high, low, low], color=BLUE, ls="-", lw=2, zorder=3)
            ground = {"fc": "white", "ec": "none", "pad": 0.5}
            text = f"$h_{i // 2 + 1}$"
            ax.text(1.17, (high + low) / 2, text, va="center", fontsize=14, color=BLUE, bbox=ground, zorder=3)
    ax.set_title(title)
    return fig


def _heights(ids, n):
    """Height of each neuron that is drawn; where some of the n are left out, a gap for the dots in the middle."""
    slots = np.arange(len(ids), dtype=float)
    if n > len(ids):
        slots[len(ids) // 2 :] += 1
    return dict(zip(ids, 0.5 - (slots + 0.5) / (slots[-1] + 1)))


def activation(
    curves: Curves, x: ArrayLike | None = None, *, xlabel: str = "z", title: str = "", ylim: Point | None = None
) -> Figure:
    """Activation functions and their derivatives.

    Parameters
    ----------
    curves : Curves
        {label: (x, y)}.
    x : ArrayLike | None
        A marked input.
    xlabel : str
        Of the x axis.
    title : str
        Written above.
    ylim : Point | None
        Ends of the axis.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-33, fig-34.
    """
    fig, ax = new_figure(height=3.6)
    for (label, (at, y)), style in zip(curves.items(), styles(curves).values()):
        ax.plot(at, y, label=label, **style)
        if x is not None:
            ax.plot([x], [np.interp(x, at, y)], "o", color=BLACK, ms=7)
    ax.set(xlabel=xlabel, title=title, ylim=ylim)
    ax.legend()
    return fig


def gradient_norms(depths: ArrayLike, norms: Curves) -> Figure:
    """Norm of the gradient that reaches the first of several layers.

    Parameters
    ----------
    depths : ArrayLike
        (n_depths,).
    norms : Curves
        {label: (n_depths, n_nets)}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-34.
    """
    fig, ax = new_figure(height=3.8)
    for (label, values), style in zip(norms.items(), styles(norms).values()):
        mean, spread = np.exp(np.log(values).mean(axis=1)), np.percentile(values, [10, 90], axis=1)
        band(ax, depths, mean, spread, label, **style | {"marker": "o"})
    ax.set(xlabel="layers", ylabel="norm of the gradient", yscale="log", xticks=depths)
    ax.legend()
    return fig


def function_plot(
    x: ArrayLike, y: ArrayLike, title: str = "", *, inset: tuple[ArrayLike, ArrayLike] | None = None
) -> Figure:
    """A function on an interval, with the same on a wider one inside.

    Parameters
    ----------
    x : ArrayLike
        (n,).
    y : ArrayLike
        (n,).
    title : str
        Written above.
    inset : tuple[ArrayLike, ArrayLike] | None
        (x, y) of the wider one.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-35.
    """
    fig, ax = new_figure()
    ax.plot(x, y)
    ax.set(xlabel="x", ylabel="f(x)", title=title)
    if inset is not None:
        small = ax.inset_axes([0.55, 0.12, 0.42, 0.42])
        small.plot(*inset)
        small.tick_params(labelsize=SMALL)
        small.set_xticks([-3, 0, 3, 6])
    return fig


def hidden_neuron(x: ArrayLike, y: ArrayLike, w: ArrayLike, b: ArrayLike) -> Figure:
    """Output of one hidden neuron against its input, with the centre of its step.

    Parameters
    ----------
    x : ArrayLike
        (n,).
    y : ArrayLike
        (n,).
    w : ArrayLike
        Its weight.
    b : ArrayLike
        Its bias.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-36 to fig-41.
    """
    fig, ax = new_figure(height=3.4)
    ax.plot(x, y)
    s = -b / w if w else np.nan
    inside = x[0] <= s <= x[-1]
    if inside:
        ax.axvline(s, color=RED, ls="--", lw=1.4)
    where = f"s = −b/w = {s + 0.0:.3g}" if w else "w = 0: no step"
    ax.set(xlabel="x", ylabel="output", ylim=(-0.05, 1.05))
    ax.set_title(f"w = {w:g}, b = {b:g}; {where}; slope w/4 = {w / 4:g}", fontsize=SMALL)
    return fig


def step_places(w: ArrayLike, b: ArrayLike, s: ArrayLike) -> Figure:
    """Map of s = -b/w over weights and biases.

    Parameters
    ----------
    w : ArrayLike
        (n,).
    b : ArrayLike
        (m,).
    s : ArrayLike
        (m, n).

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-41.
    """
    fig, ax = new_figure(height=4.0)
    inside = np.ma.masked_outside(s, 0, 1)
    ax.set_facecolor("#BBBBBB")
    image = ax.pcolormesh(w, b, inside, cmap="cividis", shading="nearest", vmin=0, vmax=1, rasterized=True)
    for level in (0.2, 0.4, 0.6, 0.8):
        ax.plot(w, -level * w, color="white", ls="-", lw=1.0)
    ax.text(0.25 * w[-1], 0.75 * b[0], "s > 1: beyond\nthe interval", va="center", ha="center", fontsize=SMALL)
    ax.set(xlabel="weight w", ylabel="bias b", ylim=(b.min(), b.max()), title="position of the step, s = −b/w")
    ax.grid(False)
    fig.colorbar(image, ax=ax, ticks=[0, 0.2, 0.4, 0.6, 0.8, 1])
    return fig


def weighted_output(x: ArrayLike, y: ArrayLike, steps: Sequence[Any], weights: ArrayLike) -> Figure:
    """What two step neurons add up to, weighted.

    Parameters
    ----------
    x : ArrayLike
        (n,).
    y : ArrayLike
        (n,).
    steps : Sequence[Any]
        Places of the two steps.
    weights : ArrayLike
        Of the two.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-42, fig-43, fig-44.
    """
    fig, ax = new_figure(height=3.4)
    ax.plot(x, y, color=BLUE, ls="-")
    for s in steps:
        ax.axvline(s, color=GREY, ls=":", lw=1.2)
    title = ",  ".join(f"$s_{i + 1}$ = {s:g}, $w_{i + 1}$ = {w:g}" for i, (s, w) in enumerate(zip(steps, weights)))
    ax.set(xlabel="x", ylabel="weighted output", title=title, ylim=(-1.1, 1.6))
    return fig


def approximation(x: ArrayLike, f: ArrayLike, networks: Curves, title: str = "") -> Figure:
    """A function and what networks make of it.

    Parameters
    ----------
    x : ArrayLike
        (n,).
    f : ArrayLike
        (n,).
    networks : Curves
        {label: (n,)}.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-46, ex-universal.
    """
    fig, ax = new_figure(height=4.0)
    ax.plot(x, f, color=BLACK, ls="-", lw=1.4, label="f(x) = cos² x + x")
    for (label, y), style in zip(networks.items(), styles(networks).values()):
        ax.plot(x, y, lw=1.8, label=label, **style)
    ax.set(xlabel="x", title=title, ylim=(0.95, 1.35))
    ax.legend(loc="lower right")
    return fig


def errors_by_size(n: int, errors: ArrayLike) -> Figure:
    """Largest error against the number of bumps, on log axes.

    Parameters
    ----------
    n : int
        (n,), numbers of bumps.
    errors : ArrayLike
        {label: (n,)}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-46, cl-091.
    """
    fig, ax = new_figure(height=3.8)
    for (label, values), style in zip(errors.items(), styles(errors).values()):
        ax.plot(n, values, label=label, **style | {"marker": "o"})
    ax.plot(n, 0.5 / np.asarray(n), color=GREY, ls="-", lw=1.0, label="1 / (2N)")
    ax.set(xscale="log", yscale="log", xlabel="bumps N", ylabel="largest error")
    ax.legend()
    return fig


def decision(surface: ArrayLike, points: ArrayLike, labels: ArrayLike, title: str = "") -> Figure:
    """Output of a network over two inputs, with examples.

    Parameters
    ----------
    surface : ArrayLike
        (n, n), over [0, 1]^2.
    points : ArrayLike
        (m, 2).
    labels : ArrayLike
        (m,), 0 or 1.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-32.
    """
    fig, ax = new_figure(height=4.4)
    image = ax.imshow(surface, origin="lower", extent=(0, 1, 0, 1), cmap="cividis", vmin=0, vmax=1)
    for value, mark in ((0, "o"), (1, "s")):
        ax.plot(*points[labels == value].T, mark, ms=4, color="white" if value == 0 else RED, mec=BLACK, mew=0.5)
    ax.set(xlabel="temperature", ylabel="pain", title=title)
    ax.grid(False)
    fig.colorbar(image, ax=ax)
    return fig


def digit(image: ArrayLike, output: ArrayLike, label: str) -> Figure:
    """One digit, and what the network says of it.

    Parameters
    ----------
    image : ArrayLike
        (28, 28).
    output : ArrayLike
        (10,).
    label : str
        What it is.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-31, fig-47.
    """
    fig, (left, right) = new_figure(1, 2, height=2.8, width_ratios=[1, 1.6])
    left.imshow(image, cmap="Greys", interpolation="nearest")
    left.set(xticks=[], yticks=[], title=f"a {label}")
    left.grid(False)
    colours = [RED if k == int(output.argmax()) else BLUE for k in range(10)]
    right.bar(range(10), output, color=colours)
    right.set(xticks=range(10), ylim=(0, 1.05), xlabel="output neuron", title=f"largest: {int(output.argmax())}")
    return fig


def training_curves(
    curves: Curves, *, ylabel: str, xlabel: str = "epoch", log: bool = False, ylim: Point | None = None
) -> Figure:
    """One line a run, or a mean with its spread.

    Parameters
    ----------
    curves : Curves
        {label: (n_runs, n)}.
    ylabel : str
        Of the y axis.
    xlabel : str
        Of the x axis.
    log : bool
        Whether y is logarithmic.
    ylim : Point | None
        Ends of the axis.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-47, cl-085, cl-098.
    """
    fig, ax = new_figure(height=3.8)
    for (label, values), style in zip(curves.items(), styles(curves).values()):
        values = np.atleast_2d(values)
        spread = np.percentile(values, [25, 75], axis=0)
        band(ax, np.arange(1, values.shape[1] + 1), values.mean(axis=0), spread, label, **style)
    ax.set(xlabel=xlabel, ylabel=ylabel, yscale="log" if log else "linear", ylim=ylim)
    ax.legend()
    return fig


def descent_1d(v: ArrayLike, C: ArrayLike, slope: ArrayLike, path: ArrayLike, title: str = "") -> Figure:
    """A cost of one parameter, its derivative, and the steps of a descent.

    Parameters
    ----------
    v : ArrayLike
        (n,), the parameter.
    C : ArrayLike
        (n,), the cost.
    slope : ArrayLike
        (n,), its derivative.
    path : ArrayLike
        (m,), the steps.
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-48, ex-one-dim.
    """
    fig, ax = new_figure(height=3.8)
    ax.plot(v, C, color=BLUE, ls="-", label="cost")
    ax.plot(v, slope, color=GREY, ls="--", lw=1.2, label="its derivative")
    at = np.interp(path, v, C)
    ax.plot(path, at, "o-", color=RED, ms=5, lw=1.2, label="descent")
    ax.axhline(0, color=BLACK, ls="-", lw=0.6)
    ax.set(xlabel="v", xlim=(v[0], v[-1]), ylim=(min(C.min(), -1.2) - 0.2, max(C.max(), 1.0)), title=title)
    ax.legend(loc="upper center", ncols=3)
    return fig


def flow() -> Figure:
    """From an image through the network to a cost.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-31.
    """
    fig, ax = new_diagram((-1.0, 10.8), (-1.9, 1.1))
    for x, text in ((0, "x"), (3, "network\nw, b"), (6.2, "a(x)"), (9.6, "cost\nC(w, b)")):
        circle(ax, (x, 0), text, radius=0.95, fontsize=SMALL)
    for start, end in ((0.95, 2.05), (3.95, 5.25), (7.15, 8.65)):
        arrow(ax, (start, 0), (end, 0))
    ax.text(7.7, -1.55, "y(x), what it should be", ha="right", va="center", fontsize=SMALL)
    arrow(ax, (7.85, -1.5), (8.85, -0.65))
    return fig
