"""Figures of chapter 2: backup diagrams, golf, uniqueness, search, cost, where updates go."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Arc, Rectangle

from rlcore.bellman import q_from_v, solve_policy
from rlcore.core.types import ArrayLike, Cell
from rlcore.dp import value_iteration
from rlcore.mdp import FiniteMDP
from rlcore.plots.style import PALETTE, SMALL, Curves, Figure, band, circle, new_diagram, new_figure, styles

# kind: "s" open circle, "a" solid circle; edge: words on the branch above; strong: whether that branch is a maximum
Node = namedtuple("Node", "kind text name edge strong children", defaults=("", "", False, ()))

# ---------------------------------------------------------------------- backup diagrams


def backup_diagram(kind: str, *, n_actions: int = 3, n_next: int = 2) -> Figure:
    """A backup diagram in symbols.

    Parameters
    ----------
    kind : str
        "v_pi", "q_pi", "v_star" or "q_star".
    n_actions : int
        Branches of a state.
    n_next : int
        Branches of an action.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        Where kind is another word.

    Notes
    -----
    Ledger: fig-3, fig-4, fig-6.
    """
    if kind not in ("v_pi", "q_pi", "v_star", "q_star"):
        raise ValueError(f'kind: got {kind!r}, must be one of "v_pi", "q_pi", "v_star", "q_star"')
    average = kind.endswith("pi")
    p, policy = "$p$\n$r$", "$\\pi$" if average else ""
    if kind[0] == "v":
        leaves = [Node("s", "$s'$", "", p)] * n_next
        root = Node("s", "$s$", children=[Node("a", "$a$", "", policy, children=leaves)] * n_actions)
    else:
        leaves = [Node("a", "$a'$", "", policy)] * n_actions
        root = Node("a", "$s,a$", children=[Node("s", "$s'$", "", p, children=leaves)] * n_next)
    return draw_tree(root, arcs=not average)


def value_diagram(mdp: FiniteMDP, root: Any, pi: ArrayLike, gamma: float, *, take: str = "average") -> Figure:
    """The backup diagram of one state, or of one pair, with its numbers.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    root : Any
        A state s or a pair (s, a).
    pi : ArrayLike
        (S, A), the policy.
    gamma : float
        Discount, in [0, 1].
    take : str
        "average" weighs actions by pi, "max" takes the best (pi is then not used).

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        Where take is another word.

    Notes
    -----
    Ledger: fig-3, fig-4, fig-6.
    """
    if take not in ("average", "max"):
        raise ValueError(f'take: got {take!r}, must be "average" or "max"')
    average = take == "average"
    V = solve_policy(mdp, pi, gamma) if average else value_iteration(mdp, gamma, tol=1e-10).V
    Q = q_from_v(mdp, V, gamma)

    def state(s, edge="", deep=True):
        actions = [action(s, a, deep) for a in np.flatnonzero(mdp.legal[s])] if deep else ()
        return Node("s", f"{V[s]:.2f}", mdp.state_names[s], edge, False, actions)

    def action(s, a, deep=True, top=False):
        edge = f"π {pi[s, a]:.2g}" if average and not top else ""
        used = np.flatnonzero(mdp.prob[s, a]) if deep else ()
        rows = [(mdp.next_state[s, a, k], f"p {mdp.prob[s, a, k]:.2g}\nr {mdp.reward[s, a, k]:+g}") for k in used]
        best = not average and not top and Q[s, a] >= V[s] - 1e-6
        return Node("a", f"{Q[s, a]:.2f}", mdp.action_names[a], edge, best, [state(n, text, top) for n, text in rows])

    if np.ndim(root) == 0:
        tree = state(root)._replace(children=[action(root, a) for a in np.flatnonzero(mdp.legal[root])])
    else:
        pair = action(*root, top=True)
        shallow = [n._replace(children=[leaf._replace(children=()) for leaf in n.children]) for n in pair.children]
        tree = pair._replace(name=f"{mdp.state_names[root[0]]}, {pair.name}", children=shallow)
    return draw_tree(tree, arcs=not average)


def draw_tree(root: Any, *, arcs: bool, drop: float = 2.8, radius: float = 0.62) -> Figure:
    """Root on top, leaves below; an arc across the branches under each state that has some, where arcs."""
    n_leaves = max(_leaves(root), 3)
    step = max(1.9, 9.5 / n_leaves)
    fig, ax = new_diagram((-0.75 * step, (n_leaves - 0.25) * step), (-2 * drop - (1.4 if root.name else 0.8), 0.8))
    _draw_node(ax, root, 0.0 if _leaves(root) == n_leaves else 0.5 * step, 0.0, step, drop, radius, arcs)
    return fig


def _leaves(node):
    return sum(map(_leaves, node.children)) or 1


def _draw_node(ax, node, left, y, step, drop, radius, arcs):
    """Draw node above its leaves, which start at `left`; returns its x."""
    xs, start = [], left
    for child in node.children:
        xs.append(_draw_node(ax, child, start, y - drop, step, drop, radius, arcs))
        start += _leaves(child) * step
    x = np.mean([xs[0], xs[-1]]) if xs else left
    for child, below in zip(node.children, xs):
        ax.plot([x, below], [y, y - drop], color=PALETTE["black"], ls="-", lw=4.5 if child.strong else 1.6, zorder=1)
        if child.edge:
            at = 0.66 if len(xs) > 2 and node.kind == "s" and not child.children else 0.5
            font = {"fontsize": SMALL, "linespacing": 1, "bbox": {"fc": "white", "ec": "none", "pad": 0.5}}
            ax.text(x + at * (below - x), y - at * drop, child.edge, ha="center", va="center", zorder=1.5, **font)
    if arcs and node.kind == "s" and xs:
        low, high = (np.degrees(np.arctan2(-drop, end - x)) for end in (xs[0], xs[-1]))
        ax.add_patch(
            Arc((x, y), 2.2, 2.2, theta1=low - 8, theta2=high + 8, color=PALETTE["vermillion"], lw=3, zorder=3)
        )
        ax.text(x - radius - 0.2, y + 0.3, "max", color=PALETTE["vermillion"], fontsize=13, ha="right")
    face = PALETTE["black"] if node.kind == "a" else "white"
    circle(ax, (x, y), node.text, radius=radius, face=face, edge=PALETTE["black"], fontsize=SMALL)
    if node.name:
        if node.children:
            ax.text(x + radius + 0.15, y + 0.1, node.name, fontsize=SMALL)
        else:
            ax.text(x, y - radius - 0.12, node.name, ha="center", va="top", fontsize=SMALL)
    return x


# ---------------------------------------------------------------------- golf, and curves


def golf(panels: Curves, shape: Cell, *, hole: Cell, tee: Cell, sand: Iterable[Cell] = ()) -> Figure:
    """Values of every cell of a golf hole, one panel above the other in the same colours.

    Parameters
    ----------
    panels : Curves
        {title: (S,)}, rounded up to whole strokes.
    shape : Cell
        (rows, columns).
    hole : Cell
        Its cell.
    tee : Cell
        Its cell.
    sand : Iterable[Cell]
        Cells drawn in grey where the value is -inf.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-5.
    """
    fig, axes = new_figure(len(panels), 1, height=0.5 + 2.3 * len(panels), squeeze=False)
    colours = ListedColormap(["#f7fcb9", "#d9f0a3", "#addd8e", "#78c679", "#41ab5d", "#238443", "#005a32"][::-1])
    colours = colours.with_extremes(bad="#8c8c8c")
    for ax, (title, values) in zip(axes[:, 0], panels.items()):
        strokes = np.where(np.isfinite(values), np.floor(np.asarray(values) + 1e-6), np.nan).reshape(shape)
        norm = BoundaryNorm(np.arange(-6.5, 1), 7)
        image = ax.imshow(np.ma.masked_invalid(strokes), cmap=colours, norm=norm, interpolation="nearest")
        _mark(ax, hole=hole, tee=tee)
        if any(not np.isfinite(strokes[cell]) for cell in sand):
            grey = ax.add_patch(Rectangle((0, 0), 0, 0, fc="#8c8c8c"))
            ax.legend([grey], ["sand: −∞"], loc="lower left", borderpad=0.3)
        ax.set(title=title, xticks=[], yticks=[])
        ax.grid(False)
    bar = fig.colorbar(image, ax=axes, ticks=np.arange(-6, 1), fraction=0.06, pad=0.02)
    bar.set_label("value: strokes left, negative")
    return fig


def _mark(ax, **places):
    """A dot and a name on a white ground for each place (row, column)."""
    for name, (row, col) in places.items():
        ax.plot(col, row, "o", color="white", ms=9, mec="black", mew=1.8)
        ground = {"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.85}
        side = "left" if col < 2 else "center"
        at = (col - 0.5 * (col < 2), row + 1.7)
        ax.annotate(name, at, ha=side, va="center", fontsize=SMALL, bbox=ground)


def best_clubs(
    putter: ArrayLike, driver: ArrayLike, shape: Cell, *, hole: Cell, tee: Cell, sand: Iterable[Cell] = ()
) -> Figure:
    """The best club of every cell.

    Parameters
    ----------
    putter : ArrayLike
        (S,), values of playing it first.
    driver : ArrayLike
        (S,), likewise.
    shape : Cell
        (rows, columns).
    hole : Cell
        Its cell.
    tee : Cell
        Its cell.
    sand : Iterable[Cell]
        Cells with a grey ground.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-5, ex-golf-driver.
    """
    fig, ax = new_figure(height=3.2)
    gap = np.asarray(putter) - driver
    club = np.where(np.abs(gap) < 1e-6, 1, np.where(gap > 0, 2, 0)).reshape(shape)
    colours = ListedColormap([PALETTE["blue"], "#c9d3dc", "#f2c14e"])
    ax.imshow(club, cmap=colours, vmin=-0.5, vmax=2.5, interpolation="nearest")
    for row, col in sand:
        cell = Rectangle((col - 0.5, row - 0.5), 1, 1, fill=False, ec="white", lw=0, hatch="xxxx")
        ax.add_patch(cell)
    _mark(ax, hole=hole, tee=tee)
    keys = [Rectangle((0, 0), 1, 1, fc=colour) for colour in colours.colors]
    names = ["driver", "either", "putter"]
    if len(sand):
        keys.append(Rectangle((0, 0), 1, 1, fc=PALETTE["grey"], ec="white", lw=0, hatch="xxxx"))
        names.append("sand")
    ax.legend(keys, names, loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=4, frameon=False, handlelength=1)
    ax.set(title=f"best play is worth {max(putter[i := tee[0] * shape[1] + tee[1]], driver[i]):.2f} from the tee")
    ax.set(xticks=[], yticks=[])
    ax.grid(False)
    return fig


def visits_and_errors(runs: Curves) -> Figure:
    """Error of each action value against how often it was updated.

    Parameters
    ----------
    runs : Curves
        {label: (visits (n,), errors (n,))}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-022.
    """
    fig, ax = new_figure()
    for (label, (visits, errors)), mark, style in zip(runs.items(), "os^", styles(runs).values()):
        ax.plot(visits, errors, mark, ms=5, alpha=0.6, label=label, color=style["color"])
    ax.set(xlabel="updates of the pair", ylabel="$|Q - q_*|$", xscale="symlog")
    ax.legend()
    return fig


def staircase(exact: ArrayLike, runs: Curves) -> Figure:
    """Learned values of a long walk beside the exact ones.

    Parameters
    ----------
    exact : ArrayLike
        (S,).
    runs : Curves
        {label: (n_runs, S)}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-tabular.
    """
    fig, ax = new_figure()
    x = np.arange(exact.size)
    ax.plot(x, exact, color=PALETTE["black"], ls="-", lw=1.4, label="exact")
    for (label, values), style in zip(runs.items(), styles(runs).values()):
        band(ax, x, values.mean(axis=0), values.std(axis=0), label, **style)
    ax.set(xlabel="state", ylabel="value")
    ax.legend()
    return fig


def bands(curves: Curves, *, xlabel: str, ylabel: str, log_y: bool = False, log_x: bool = False) -> Figure:
    """Mean and spread (one standard deviation over runs) of curves.

    Parameters
    ----------
    curves : Curves
        {label: (x, (n_runs, n))}.
    xlabel : str
        Of the x axis.
    ylabel : str
        Of the y axis.
    log_y : bool
        Whether y is logarithmic.
    log_x : bool
        Whether x is.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-tabular, cl-022.
    """
    fig, ax = new_figure()
    for (label, (x, values)), style in zip(curves.items(), styles(curves).values()):
        band(ax, x, values.mean(axis=0), values.std(axis=0), label, **style)
    ax.set(xlabel=xlabel, ylabel=ylabel)
    if log_y:
        ax.set_yscale("log")
    if log_x:
        ax.set_xscale("log")
    ax.legend()
    return fig
