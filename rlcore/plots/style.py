"""One look for every figure, and the few shapes that the chapters share.

Convention. A plot function builds its figure with ``new_figure`` or ``new_diagram`` and returns it. In a notebook the
cell's last line is an assignment, ``fig = plots.some_figure(...)``: the inline backend shows the figure once, at the
end of the cell, and the compared text is ``<Figure size 600x360 with 1 Axes>``. A cell that ends with the bare
``plots.some_figure(...)`` shows it once, too. ``explore`` hands each frame to ``encode``, which closes it, so that
frames neither pile up nor show a second time. ``plots.use_style()`` stands in the first code cell.

Every figure is 6 inches wide, so that all have the same type; no text is smaller than SMALL, which on a page of 360
pixels is 10 pixels. A method has the colour and line of METHODS wherever it is drawn: ``styles(labels)``. On a dark
page the book's style sheet turns light and dark round and keeps the hues, so that a figure is drawn on white.
"""

from __future__ import annotations

import io
import itertools
import re
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from rlcore.core.extras import extra
from rlcore.core.types import ArrayLike

with extra("plots"):
    import matplotlib as mpl
    import matplotlib.figure
    import matplotlib.pyplot as plt
    from cycler import cycler
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch

# Okabe and Ito's colours (2008), darkened: each has a contrast of 4.5:1 or more on white, so that texts may have them.
PALETTE = {
    "blue": "#0072B2",
    "vermillion": "#C45100",
    "green": "#00875F",
    "purple": "#A8508A",
    "ochre": "#A06A00",
    "black": "#222222",
    "grey": "#767676",
    "light": "#E8EEF4",  # fills only
}
_LINES = ["-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1, 1, 1))]
CYCLE = [PALETTE[name] for name in ("blue", "vermillion", "green", "purple", "ochre", "black")]
FONTS = "DejaVu Sans,Verdana,Geneva,sans-serif"
WIDTH, HEIGHT, DPI = 6.0, 3.6, 100
TEXT, SMALL = 14, 13  # points

# Colour and line of each method; of two that fit a label the longer name counts.
METHODS = {
    "TD": ("blue", "-"),
    "TD(0)": ("blue", "-"),
    "batch TD": ("blue", "-"),
    "MC": ("vermillion", "--"),
    "Monte Carlo": ("vermillion", "--"),
    "batch Monte Carlo": ("vermillion", "--"),
    "first visit": ("vermillion", "--"),
    "every visit": ("blue", "-."),
    "SARSA": ("green", "-"),
    "Q-learning": ("purple", "--"),
    "expected SARSA": ("ochre", "-."),
    "Dyna-Q": ("blue", "-."),
    "Dyna-Q+": ("vermillion", "-"),
    "never corrected": ("black", ":"),
    "old model": ("black", ":"),
    "policy evaluation": ("green", "-."),
    "policy iteration": ("vermillion", "--"),
    "value iteration": ("blue", "-"),
    "table": ("vermillion", "--"),
    "ten groups": ("blue", "-"),
    "accumulating": ("blue", "-"),
    "dutch": ("green", "-."),
    "replacing": ("vermillion", "--"),
    "REINFORCE": ("blue", "-"),
    "baseline": ("vermillion", "--"),
    "REINFORCE with baseline": ("vermillion", "--"),
    "actor-critic": ("green", "-."),
    "TRPO": ("purple", "-."),
    "PPO": ("ochre", "-"),
}

STYLE = {
    "axes.prop_cycle": cycler(color=CYCLE) + cycler(linestyle=_LINES),
    "axes.axisbelow": True,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": TEXT,
    "figure.constrained_layout.use": True,
    "figure.dpi": DPI,
    "figure.facecolor": "white",
    "figure.figsize": (WIDTH, HEIGHT),
    "font.family": "DejaVu Sans",
    "font.size": TEXT,
    "grid.color": "#E2E2E2",
    "grid.linewidth": 0.8,
    "image.cmap": "cividis",
    "legend.fontsize": SMALL,
    "legend.framealpha": 0.9,
    "legend.handlelength": 2.2,
    "legend.handletextpad": 0.5,
    "legend.columnspacing": 1.2,
    "lines.linewidth": 2.2,
    "lines.markersize": 7,
    "savefig.facecolor": "white",
    "svg.hashsalt": "rlcore",
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
}

Point: TypeAlias = tuple[float, float]
Curves: TypeAlias = Mapping[Any, Any]  # {label: what is drawn under it}


def use_style() -> None:
    """Set the book's look for every figure from here on, and sharp PNG of a fixed size in a notebook."""
    mpl.rcParams.update(STYLE)
    if "ipykernel" in sys.modules:
        from matplotlib_inline.backend_inline import set_matplotlib_formats

        set_matplotlib_formats("retina", bbox_inches=None)


class Figure(mpl.figure.Figure):
    """A figure that a notebook shows once: as a cell's last value, displayed, or left to the end of the cell."""

    def _ipython_display_(self):
        plt.close(self)  # else the inline backend shows it again at the end of the cell
        raise NotImplementedError  # IPython goes on in its usual way


def new_figure(nrows: int = 1, ncols: int = 1, *, height: float = HEIGHT, **subplots: Any) -> tuple[Figure, Any]:
    """A figure and its axes, as of matplotlib's subplots, in the book's width.

    Parameters
    ----------
    nrows : int
        Rows of axes.
    ncols : int
        Columns.
    height : float
        In inches.
    **subplots : Any
        As of matplotlib's subplots.

    Returns
    -------
    tuple[Figure, Any]
        (figure, axes).
    """
    return plt.subplots(nrows, ncols, figsize=(WIDTH, height), FigureClass=Figure, **subplots)


def new_diagram(
    xlim: tuple[float, float], ylim: tuple[float, float], *, height: float | None = None
) -> tuple[Figure, Axes]:
    """A figure and its axes for a drawing: equal units, no frame.

    Parameters
    ----------
    xlim : tuple[float, float]
        In the drawing's own units.
    ylim : tuple[float, float]
        Likewise.
    height : float | None
        In inches; what equal units need where None.

    Returns
    -------
    tuple[Figure, Axes]
        (figure, axes).
    """
    height = WIDTH * (ylim[1] - ylim[0]) / (xlim[1] - xlim[0]) if height is None else height
    fig, ax = new_figure(height=height)
    ax.set(xlim=xlim, ylim=ylim, aspect="equal")
    ax.axis("off")
    return fig, ax


def method_of(label: str) -> str | None:
    """The method of METHODS that a label names, or None; of several the one with the longest name."""
    found = [m for m in METHODS if re.search(rf"(?<![\w-]){re.escape(m)}(?![\w+-])", str(label), re.IGNORECASE)]
    return max(found, key=len, default=None)


def rung(label: str) -> str | None:
    """The colour of "λ = 0.9" or "n = 4": from that of TD(0) to that of Monte Carlo; None for other labels."""
    found = re.match(r"(λ|n) = ([\d.]+)", str(label))
    if found is None:
        return None
    value = float(found[2])
    place = 1 - np.sqrt(1 - min(value, 1)) if found[1] == "λ" else np.log2(max(value, 1)) / 9
    ends = [PALETTE[name] for name in ("blue", "purple", "vermillion")]
    return mpl.colors.to_hex(mpl.colors.LinearSegmentedColormap.from_list("rungs", ends)(min(place, 1.0)))


def styles(labels: Iterable[str], marks: str = "osv^Dx") -> dict[str, dict[str, Any]]:
    """A line style for each label: that of the method that it names, see METHODS.

    Several settings of one method differ in line and marker; other labels get the colours that are left.

    Parameters
    ----------
    labels : Iterable[str]
        Names of curves.
    marks : str
        Markers for several settings of one method.

    Returns
    -------
    dict[str, dict[str, Any]]
        {label: {"color": ..., "ls": ...}}.
    """
    methods = {label: method_of(label) for label in labels}
    taken = {PALETTE[METHODS[method][0]] for method in methods.values() if method}
    free = (
        itertools.cycle([(c, _LINES[i]) for i, c in enumerate(CYCLE) if c not in taken])
        if len(taken) < len(CYCLE) else itertools.cycle(zip(CYCLE, _LINES))
    )  # fmt: skip
    found, count = {}, Counter()
    for k, (label, method) in enumerate(methods.items()):
        if colour := rung(label):
            found[label] = {"color": colour, "ls": _LINES[k % 4], "marker": marks[k % len(marks)], "ms": 5}
        elif method:
            name, line = METHODS[method]
            found[label] = {"color": PALETTE[name], "ls": line}
            if [METHODS[m] for m in methods.values() if m].count((name, line)) > 1:
                k = count[name, line]
                found[label] |= {"ls": _LINES[(_LINES.index(line) + k) % 4], "marker": marks[k % len(marks)], "ms": 6}
                found[label]["markevery"] = (0.03 + 0.02 * k, 0.14)
                count[name, line] += 1
        else:
            colour, line = next(free)
            found[label] = {"color": colour, "ls": line}
    return found


def band(ax: Axes, x: ArrayLike, mean: ArrayLike, spread: ArrayLike, label: str, **line: Any) -> Line2D:
    """Draw a curve and its spread.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    x : ArrayLike
        (n,).
    mean : ArrayLike
        (n,).
    spread : ArrayLike
        (n,) for mean +- spread, or (2, n) for low and high.
    label : str
        For the legend.
    **line : Any
        Style of the line.

    Returns
    -------
    Line2D
        The line.
    """
    mean, spread = np.asarray(mean, float), np.asarray(spread, float)
    low, high = spread if spread.ndim == 2 else (mean - spread, mean + spread)
    (curve,) = ax.plot(x, mean, label=label, **line)
    ax.fill_between(x, low, high, color=curve.get_color(), alpha=0.2, linewidth=0)
    return curve


def text_colour(background: Any) -> str:
    """Black or white, whichever has the higher contrast on a background.

    Parameters
    ----------
    background : Any
        A colour of matplotlib.

    Returns
    -------
    str
        Its name or number.
    """
    rgb = np.array(mpl.colors.to_rgb(background))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return "white" if linear @ [0.2126, 0.7152, 0.0722] < 0.179 else "black"


def heatmap(
    ax: Axes, values: ArrayLike, *, fmt: str | None = "{:.1f}", labels: Sequence[Sequence[str]] | None = None,
    cmap: str = "cividis", vmin: float | None = None, vmax: float | None = None, fontsize: float = 11,
) -> QuadMesh:  # fmt: skip
    """Draw a matrix as coloured cells, each with its number; NaN is a grey wall without text.

    Row i, column j is centred at x = j, y = i.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    values : ArrayLike
        (rows, columns), first row on top.
    fmt : str | None
        How a number is written, None for no text.
    labels : Sequence[Sequence[str]] | None
        Texts of the same shape, instead of the numbers.
    cmap : str
        A colour map of matplotlib.
    vmin : float | None
        Fix it where several pictures are compared.
    vmax : float | None
        Likewise.
    fontsize : float
        In points.

    Returns
    -------
    QuadMesh
        The image, for a colour bar.
    """
    values = np.ma.masked_invalid(np.asarray(values, float))
    rows, columns = (np.arange(n + 1) - 0.5 for n in values.shape)
    shades = mpl.colormaps[cmap].with_extremes(bad="#9A9A9A")
    many = values.size > 900  # then one bitmap inside the SVG
    lines = {} if many else {"edgecolors": "white", "linewidth": 1}
    image = ax.pcolormesh(columns, rows, values, cmap=shades, vmin=vmin, vmax=vmax, rasterized=many, **lines)
    ax.set(aspect="equal", xlim=columns[[0, -1]], ylim=rows[[-1, 0]])
    ax.spines[:].set_visible(False)
    ax.grid(False)
    ax.set(xticks=[], yticks=[])
    for (i, j), value in np.ma.ndenumerate(values):  # passes over what is masked
        if labels is None and fmt is None:
            continue
        text = str(labels[i][j]) if labels is not None else re.sub(r"^-(?=[0.]+$)", "", fmt.format(value))  # not -0.0
        colour = text_colour(image.cmap(image.norm(value)))
        ax.text(j, i, text, ha="center", va="center", color=colour, fontsize=fontsize)
    return image


def box(
    ax: Axes, xy: Point, text: str = "", *, width: float = 2.0, height: float = 1.0, face: str = PALETTE["light"],
    edge: str = PALETTE["black"], **font: Any,
) -> None:  # fmt: skip
    """Draw a rounded box with its text.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    xy : Point
        Its centre.
    text : str
        In it.
    width : float
        In units of the drawing.
    height : float
        Likewise.
    face : str
        Colour inside.
    edge : str
        Colour of the line.
    **font : Any
        As of matplotlib's text.
    """
    corner = (xy[0] - width / 2, xy[1] - height / 2)
    style = f"round,pad=0,rounding_size={0.15 * min(width, height)}"
    ax.add_patch(FancyBboxPatch(corner, width, height, boxstyle=style, fc=face, ec=edge, lw=1.8, zorder=2))
    ax.text(*xy, text, ha="center", va="center", color=text_colour(face), zorder=3, **font)


def circle(
    ax: Axes, xy: Point, text: str = "", *, radius: float = 0.4, face: str = "white", edge: str = PALETTE["black"],
    **font: Any,
) -> None:  # fmt: skip
    """Draw a circle: white for a state, filled for an action (face=edge).

    Parameters
    ----------
    ax : Axes
        Where to draw.
    xy : Point
        Its centre.
    text : str
        In it.
    radius : float
        In units of the drawing.
    face : str
        Colour inside.
    edge : str
        Colour of the line.
    **font : Any
        As of matplotlib's text.
    """
    ax.add_patch(Circle(xy, radius, fc=face, ec=edge, lw=1.8, zorder=2))
    ax.text(*xy, text, ha="center", va="center", color=text_colour(face), zorder=3, **font)


def arrow(
    ax: Axes, start: ArrayLike, end: ArrayLike, text: str = "", *, curve: float = 0.0, colour: str = PALETTE["black"],
    line: str = "-", at: float = 0.5, offset: Point = (0.0, 0.0), **font: Any,
) -> None:  # fmt: skip
    """Draw an arrow.

    Parameters
    ----------
    ax : Axes
        Where to draw.
    start : ArrayLike
        A point.
    end : ArrayLike
        A point.
    text : str
        On a white ground, beside it.
    curve : float
        How far it is bent, a fraction of its length, to the left of travel.
    colour : str
        Of line and text.
    line : str
        Style of the line.
    at : float
        Fraction of the way at which the text stands.
    offset : Point
        Moves the text, in the drawing's units.
    **font : Any
        As of matplotlib's text.
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    style = {"arrowstyle": "-|>", "mutation_scale": 16, "connectionstyle": f"arc3,rad={-curve}"}
    ax.add_patch(FancyArrowPatch(start, end, lw=1.8, ls=line, color=colour, shrinkA=0, shrinkB=0, zorder=1, **style))
    if text:
        left = np.array([start[1] - end[1], end[0] - start[0]])
        x, y = start + at * (end - start) + 2 * at * (1 - at) * curve * left + offset
        ground = {"fc": "white", "ec": "none", "pad": 1.0}
        ax.text(x, y, text, ha="center", va="center", color=colour, bbox=ground, zorder=1.5, **font)


def encode(fig: Any, fmt: str = "svg", *, dpi: int = 150) -> tuple[str, bytes]:
    """The bytes of a figure, which is closed: SVG with real text, or PNG of 256 colours.

    Parameters
    ----------
    fig : Any
        The figure.
    fmt : str
        "svg", or "png" for pictures with very many points.
    dpi : int
        Pixels an inch of a PNG.

    Returns
    -------
    tuple[str, bytes]
        (mime type, bytes); the same figure gives the same bytes.
    """
    if not isinstance(fig, mpl.figure.Figure):
        raise ValueError(f"draw returned {type(fig).__name__}; it must return a matplotlib Figure")
    out = io.BytesIO()
    if fmt == "svg":
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "rlcore"}):
            fig.savefig(out, format="svg", metadata=nothing)
        plt.close(fig)
        return "image/svg+xml", _small_svg(out.getvalue().decode()).encode()
    if fmt != "png":
        raise ValueError(f'fmt={fmt!r}; allowed are "svg" and "png"')
    with extra("plots"):
        from PIL import Image

    fig.savefig(out, format="png", dpi=dpi)
    plt.close(fig)
    small = io.BytesIO()
    Image.open(out).convert("RGB").quantize(256).save(small, "PNG", optimize=True)
    return "image/png", small.getvalue()


def _small_svg(svg):
    """Drop comments, unused ids and digits beyond 1/10 point of a path, 1/100 of a place; name the fonts once."""
    svg = " ".join(re.sub(r"<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.S).split())
    svg = re.sub(r'<g id="[^"]*"', "<g", svg).replace("> <", "><")
    svg = svg.replace("<svg ", f'<svg font-family="{FONTS}" ', 1)
    svg = re.sub(r' (?:d|x|y|width|height|points|transform|style)="[^"]*"', _shorter, svg)
    return _share_styles(_name_briefly(_ungroup(svg)))


def _ungroup(svg):
    """Drop the groups that have no attribute, and so no effect."""
    kept, bare = [], []
    for part in re.split(r"(<g\b[^>]*>|</g>)", svg.replace("<g/>", "")):
        if part.startswith("<g"):
            bare.append(part == "<g>")
        kept.append("" if part.startswith(("<g", "</g")) and (bare.pop() if part == "</g>" else bare[-1]) else part)
    return "".join(kept)


def _name_briefly(svg):
    """Ids of a letter and a number in place of matplotlib's hashes."""
    for n, name in enumerate(re.findall(r' id="([^"]+)"', svg)):
        svg = re.sub(rf'(?<=["#]){re.escape(name)}(?=[")])', f"i{n}", svg)
    return svg


def _share_styles(svg):
    """Each style that stands more than once becomes a class."""
    count = Counter(re.findall(r' style="([^"]*)"', svg))
    shared = {text: f"c{n}" for n, text in enumerate(text for text, times in count.items() if times > 1)}
    rules = "".join(f".{name}{{{text}}}" for text, name in shared.items())
    svg = svg.replace("</style>", rules + "</style>", 1)
    return re.sub(
        r' style="([^"]*)"', lambda found: f' class="{shared[found[1]]}"' if found[1] in shared else found[0], svg
    )


def _shorter(attribute):
    text = attribute.group()
    if text.startswith(" style="):
        return re.sub(r"(?<=[;:]) |(; )?font-family: 'DejaVu Sans'", "", text).replace(";;", ";").replace('";', '"')
    if text.startswith(' transform="rotate(-0 '):
        return ""
    if "scale" in text or "matrix" in text:
        return text
    places = 1 if text.startswith(" d=") else 2
    text = re.sub(r"-?\d+\.\d{2,}", lambda x: f"{float(x.group()):.{places}f}".rstrip("0").rstrip("."), text)
    return re.sub(r" ?\b([A-Zz])\b ?", r"\1", text) if text.startswith(" d=") else text
