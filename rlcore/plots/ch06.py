"""Figures of chapter 6: neural networks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rlcore.core.types import ArrayLike
from rlcore.plots.style import PALETTE, Curves, Figure, Point, arrow, band, circle, heatmap, new_diagram, new_figure

BLUE, RED, GREEN, GREY, BLACK = (PALETTE[name] for name in ("blue", "vermillion", "green", "grey", "black"))
MOST = 10  # neurons of a layer that are drawn one by one


def network_diagram(
    sizes: Sequence[int], *, weights: ArrayLike | None = None, names: Mapping[int, Sequence[str]] | None = None,
    values: ArrayLike | None = None, lit: Iterable[Any] = (), brackets: bool = False, title: str = "",
) -> Figure:  # fmt: skip
    """A feedforward network as circles and lines. fig-30, fig-32, fig-45, fig-47, fig-56

    sizes: neurons of each layer, input first; of a layer with more than 10 the middle is left out. weights: list of
    (n_l, n_{l-1}), drawn as width and colour (orange: negative). names: texts of input and output neurons.
    values: activations of each layer, written in. lit: (layer, neuron) in red. brackets: pairs in the middle.
    """
    fig, ax = new_diagram((-0.6, len(sizes) - 0.4), (-0.62, 0.68), width=7.0, height=4.0)
    ax.set_aspect("auto")
    shown = [range(n) if n <= MOST else [*range(MOST // 2), *range(n - MOST // 2, n)] for n in sizes]
    place = [dict(zip(ids, 0.5 - (np.arange(len(ids)) + 0.5) / len(ids))) for ids in shown]
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
            ax.plot([k], [y], "o", ms=22 if len(ids) <= 6 else 14, color="white", mec=edge, mew=1.8, zorder=2)
            if values is not None:
                ax.text(k, y, f"{values[k][i]:.2f}", ha="center", va="center", fontsize=8, zorder=3)
        if sizes[k] > MOST:
            ax.text(k, 0.0, "⋮", ha="center", va="center", fontsize=18)
        ax.text(k, 0.6, str(sizes[k]), ha="center", va="center", fontsize=12)
    for k, side in ((0, "right"), (len(sizes) - 1, "left")):
        for text, (_, y) in zip((names or {}).get(k, ()), place[k].items()):
            ax.text(k + (-0.12 if side == "right" else 0.12), y, text, ha=side, va="center", fontsize=11)
    if brackets:
        for i in range(0, sizes[1] - 1, 2):
            y = (place[1][i] + place[1][i + 1]) / 2
            ax.text(1.1, y, f"}} h{i // 2 + 1}", va="center", fontsize=13)
    ax.set_title(title)
    return fig


def activation(
    curves: Curves, x: ArrayLike | None = None, *, xlabel: str = "z", title: str = "", ylim: Point | None = None
) -> Figure:
    """Activation functions and their derivatives; curves: {label: (x, y)}; x: a marked input. fig-33, fig-34"""
    fig, ax = new_figure(height=3.6)
    for label, (at, y) in curves.items():
        ax.plot(at, y, label=label)
        if x is not None:
            ax.plot([x], [np.interp(x, at, y)], "o", color=BLACK, ms=7)
    ax.set(xlabel=xlabel, title=title, ylim=ylim)
    ax.legend()
    return fig


def gradient_norms(depths: ArrayLike, norms: Curves) -> Figure:
    """Norm of the gradient that reaches the first of several layers; norms: {label: (n_depths, n_nets)}. fig-34"""
    fig, ax = new_figure(height=3.8)
    for label, values in norms.items():
        band(
            ax, depths, np.exp(np.log(values).mean(axis=1)), np.percentile(values, [10, 90], axis=1), label, marker="o"
        )
    ax.set(xlabel="layers", ylabel="norm of the gradient", yscale="log", xticks=depths)
    ax.legend()
    return fig


def function_plot(
    x: ArrayLike, y: ArrayLike, title: str = "", *, inset: tuple[ArrayLike, ArrayLike] | None = None
) -> Figure:
    """A function on an interval, with the same on a wider one inside. fig-35; x, y: (n,); inset: (x, y)."""
    fig, ax = new_figure()
    ax.plot(x, y)
    ax.set(xlabel="x", ylabel="f(x)", title=title)
    if inset is not None:
        small = ax.inset_axes([0.55, 0.12, 0.42, 0.42])
        small.plot(*inset)
        small.tick_params(labelsize=9)
    return fig


def hidden_neuron(x: ArrayLike, y: ArrayLike, w: ArrayLike, b: ArrayLike) -> Figure:
    """Output of one hidden neuron against its input, with the centre of its step. fig-36 to fig-41"""
    fig, ax = new_figure(height=3.4)
    ax.plot(x, y)
    s = -b / w if w else np.nan
    inside = x[0] <= s <= x[-1]
    if inside:
        ax.axvline(s, color=RED, ls="--", lw=1.4)
    where = f"s = −b/w = {s + 0.0:.4g}" if w else "w = 0: no step"
    ax.set(
        xlabel="x", ylabel="output", ylim=(-0.05, 1.05), title=f"w = {w:g}, b = {b:g}; {where}; slope w/4 = {w / 4:g}"
    )
    return fig


def step_places(w: ArrayLike, b: ArrayLike, s: ArrayLike) -> Figure:
    """Map of s = -b/w over weights and biases. fig-41; w: (n,), b: (m,), s: (m, n)."""
    fig, ax = new_figure(height=4.0)
    image = ax.pcolormesh(w, b, np.clip(s, 0, 1), cmap="cividis", shading="nearest")
    for level in (0.2, 0.4, 0.6, 0.8):
        ax.plot(w, -level * w, color="white", ls="-", lw=1.0)
        ax.text(w[-1], -level * w[-1], f" {level:g}", va="center", fontsize=10)
    ax.set(xlabel="weight w", ylabel="bias b", ylim=(b.min(), b.max()), title="position of the step, s = −b/w")
    fig.colorbar(image, ax=ax, pad=0.1)
    return fig


def weighted_output(x: ArrayLike, y: ArrayLike, steps: Sequence[Any], weights: ArrayLike) -> Figure:
    """What two step neurons add up to, weighted. fig-42, fig-43, fig-44; steps, weights: of the two."""
    fig, ax = new_figure(height=3.4)
    ax.plot(x, y, color=BLUE, ls="-")
    for s in steps:
        ax.axvline(s, color=GREY, ls=":", lw=1.2)
    title = ", ".join(f"s{i + 1} = {s:g}, w{i + 1} = {w:g}" for i, (s, w) in enumerate(zip(steps, weights)))
    ax.set(xlabel="x", ylabel="weighted output", title=title, ylim=(-1.1, 1.6))
    return fig


def approximation(x: ArrayLike, f: ArrayLike, networks: Curves, title: str = "") -> Figure:
    """A function and what networks make of it; networks: {label: (n,)}. fig-46, ex-universal"""
    fig, ax = new_figure(height=4.0)
    ax.plot(x, f, color=BLACK, ls="-", lw=1.4, label="f(x) = cos² x + x")
    for (label, y), colour, line in zip(networks.items(), (BLUE, RED, GREEN), ("-", "--", "-.")):
        ax.plot(x, y, color=colour, ls=line, lw=1.8, label=label)
    ax.set(xlabel="x", title=title, ylim=(0.95, 1.35))
    ax.legend(loc="lower right")
    return fig


def errors_by_size(n: int, errors: ArrayLike) -> Figure:
    """Largest error against the number of bumps, on log axes; errors: {label: (n,)}. fig-46, cl-091"""
    fig, ax = new_figure(height=3.8)
    for label, values in errors.items():
        ax.plot(n, values, marker="o", label=label)
    ax.plot(n, 0.5 / np.asarray(n), color=GREY, ls="-", lw=1.0, label="1 / (2N)")
    ax.set(xscale="log", yscale="log", xlabel="bumps N", ylabel="largest error")
    ax.legend()
    return fig


def decision(surface: ArrayLike, points: ArrayLike, labels: Sequence[Any], title: str = "") -> Figure:
    """Output of a network over two inputs, with examples. fig-32; surface: (n, n) over [0, 1]^2; points: (m, 2)."""
    fig, ax = new_figure(width=5.4, height=4.4)
    image = ax.imshow(surface, origin="lower", extent=(0, 1, 0, 1), cmap="cividis", vmin=0, vmax=1)
    for value, mark in ((0, "o"), (1, "s")):
        ax.plot(*points[labels == value].T, mark, ms=4, color="white" if value == 0 else RED, mec=BLACK, mew=0.5)
    ax.set(xlabel="temperature", ylabel="pain", title=title)
    ax.grid(False)
    fig.colorbar(image, ax=ax)
    return fig


def digit(image: ArrayLike, output: ArrayLike, label: str) -> Figure:
    """One digit, and what the network says of it. fig-31, fig-47; image: (28, 28); output: (10,)."""
    fig, (left, right) = new_figure(1, 2, width=6.6, height=2.8, width_ratios=[1, 1.6])
    heatmap(left, image, fmt=None, cmap="Greys")
    left.set_title(f"a {label}")
    colours = [RED if k == int(output.argmax()) else BLUE for k in range(10)]
    right.bar(range(10), output, color=colours)
    right.set(xticks=range(10), ylim=(0, 1.05), xlabel="output neuron", title=f"largest: {int(output.argmax())}")
    return fig


def training_curves(
    curves: Curves, *, ylabel: str, xlabel: str = "epoch", log: bool = False, ylim: Point | None = None
) -> Figure:
    """One line a run, or a mean with its spread; curves: {label: (n_runs, n)}. fig-47, cl-085, cl-098"""
    fig, ax = new_figure(height=3.8)
    for label, values in curves.items():
        values = np.atleast_2d(values)
        spread = np.percentile(values, [25, 75], axis=0)
        band(ax, np.arange(1, values.shape[1] + 1), values.mean(axis=0), spread, label)
    ax.set(xlabel=xlabel, ylabel=ylabel, yscale="log" if log else "linear", ylim=ylim)
    ax.legend()
    return fig


def descent_1d(v: ArrayLike, C: ArrayLike, slope: ArrayLike, path: ArrayLike, title: str = "") -> Figure:
    """A cost of one parameter, its derivative, and the steps of a descent. fig-48, ex-one-dim"""
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
    """From an image through the network to a cost. fig-31"""
    fig, ax = new_diagram((-0.8, 10.6), (-1.4, 1.4), width=7.2)
    for x, text in ((0, "x"), (3, "network\nw, b"), (6.2, "a(x)"), (9.6, "cost\nC(w, b)")):
        circle(ax, (x, 0), text, radius=0.75, fontsize=11)
    for start, end in ((0.75, 2.25), (3.75, 5.45), (6.95, 8.85)):
        arrow(ax, (start, 0), (end, 0))
    ax.text(7.9, -1.1, "y(x), what it should be", ha="center", fontsize=11)
    arrow(ax, (8.6, -0.95), (9.1, -0.6))
    return fig
