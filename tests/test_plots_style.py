"""The look that all figures share: told apart without colour, readable, small, shown once."""

import io
import re
import warnings
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

from rlcore import plots
from rlcore.plots import style
from rlcore.plots.style import METHODS, PALETTE, SMALL, method_of, styles

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def own_style():
    plt.close("all")
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "IPython (parent|dir)")  # which it cannot write
        plots.use_style()
        yield
    plt.close("all")


def luminance(colour):
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in mpl.colors.to_rgb(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, two):
    low, high = sorted((luminance(one), luminance(two)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("colour", [c for name, c in plots.PALETTE.items() if name != "light"])
def test_lines_and_texts_stand_out_from_white_and_on_dark_pages(colour):
    assert contrast(colour, "white") >= 4.5  # WCAG 2.2, 1.4.3, since texts have these colours, too
    assert contrast(dark(colour), dark("white")) >= 4.5


def dark(colour):
    """What the style sheet makes of a colour in a figure on a dark page."""
    sheet = (ROOT / "book" / "_static" / "book.css").read_text("utf-8")
    (share,) = re.findall(r"filter: invert\(([\d.]+)\) hue-rotate\(180deg\)", sheet)
    turn = np.array([[-0.574, 1.430, 0.144], [0.426, 0.430, 0.144], [0.426, 1.430, -0.856]])  # of the CSS filter
    return turn.dot(float(share) - (2 * float(share) - 1) * np.array(mpl.colors.to_rgb(colour))).clip(0, 1)


@pytest.mark.parametrize("name", ["blue", "vermillion", "green", "purple", "ochre"])
def test_colours_keep_their_hue_on_dark_pages(name):
    before, after = (mpl.colors.rgb_to_hsv(mpl.colors.to_rgb(c)) for c in (PALETTE[name], dark(PALETTE[name])))
    assert abs((before[0] - after[0] + 0.5) % 1 - 0.5) < 20 / 360 and after[1] > 0.3


def test_a_figure_on_a_dark_page_stands_on_the_ground_of_the_page():
    assert contrast(dark("white"), "#121212") < 1.05


def test_curves_differ_in_colour_and_in_line():
    _, ax = plots.new_figure()
    lines = [ax.plot([0, 1], [0, i])[0] for i in range(6)]
    assert len({line.get_color() for line in lines}) == 6
    assert len({str(line._dash_pattern) for line in lines}) == 6
    assert min(line.get_linewidth() for line in lines) >= 1.8


def test_text_is_legible_at_360_pixels():
    fig, ax = plots.new_figure()
    ax.set(xlabel="x", ylabel="y", title="t")
    sizes = [text.get_fontsize() for text in (ax.title, ax.xaxis.label, ax.yaxis.label, *ax.get_xticklabels())]
    shown = 334 / (72 * fig.get_figwidth())  # pixels per point where the page of 360 pixels leaves 334
    assert min(*sizes, SMALL) * shown >= 10


def test_figure_has_a_fixed_size_and_a_white_ground():
    fig, _ = plots.new_figure()
    assert repr(fig) == "<Figure size 600x360 with 1 Axes>"
    assert mpl.colors.to_hex(fig.get_facecolor()) == "#ffffff"


def test_band_keeps_mean_and_spread():
    _, ax = plots.new_figure()
    x, mean, spread = np.arange(4), np.array([1.0, 2, 3, 4]), np.array([0.1, 0.2, 0.3, 0.4])
    line = plots.band(ax, x, mean, spread, "runs")
    np.testing.assert_allclose(line.get_ydata(), mean)
    plots.band(ax, x, mean, [mean - 1, mean + 2], "quartiles")
    for area, low, high in zip(ax.collections, (mean - spread, mean - 1), (mean + spread, mean + 2), strict=True):
        corners = {(float(a), round(float(b), 9)) for a, b in area.get_paths()[0].vertices}
        assert corners >= {(a, round(b, 9)) for a, b in [*zip(x, low, strict=True), *zip(x, high, strict=True)]}
    assert [text.get_text() for text in ax.legend().get_texts()] == ["runs", "quartiles"]
    assert ax.collections[0].get_facecolor()[0][:3] == pytest.approx(mpl.colors.to_rgb(line.get_color()))


@pytest.mark.parametrize("cmap", ["cividis", "viridis", "Blues", "gray"])
def test_numbers_on_a_heatmap_are_readable(cmap):
    _, ax = plots.new_figure()
    image = plots.heatmap(ax, np.linspace(0, 1, 100).reshape(10, 10), cmap=cmap, fmt="{:.2f}")
    assert len(ax.texts) == 100
    for text in ax.texts:
        ground = image.cmap(image.norm(float(text.get_text())))
        assert contrast(text.get_color(), ground) >= 4.5  # WCAG 2.2, 1.4.3


LABELS = {
    "SARSA": "SARSA", "expected SARSA, 0.5": "expected SARSA", "Q-learning goes on": "Q-learning", "TD, 0.05": "TD",
    "TD(0)": "TD(0)", "batch TD(0)": "batch TD", "batch Monte Carlo": "batch Monte Carlo", "MC, batch": "MC",
    "Dyna-Q+": "Dyna-Q+", "Dyna-Q": "Dyna-Q", "REINFORCE with baseline, mean": "REINFORCE with baseline",
    "first visit: slope -0.5": "first visit", "n-step TD": "TD", "exact": None, "stable": None, "MCTS": None,
}  # fmt: skip


@pytest.mark.parametrize("label, method", LABELS.items())
def test_a_label_names_its_method(label, method):
    assert method_of(label) == method
    if method is not None:
        colour, line = METHODS[method]
        assert styles([label])[label] == {"color": PALETTE[colour], "ls": line}


FAMILIES = [
    ["SARSA", "Q-learning", "expected SARSA"], ["TD", "MC"], ["TD(0)", "Monte Carlo"], ["first visit", "every visit"],
    ["batch TD", "batch Monte Carlo"], ["Dyna-Q", "Dyna-Q+", "never corrected"], ["Q-learning", "old model"],
    ["value iteration", "policy iteration", "policy evaluation"], ["table", "ten groups"],
    ["accumulating", "dutch", "replacing"], ["REINFORCE", "baseline", "actor-critic", "TRPO", "PPO"],
]  # fmt: skip


@pytest.mark.parametrize("methods", FAMILIES, ids=lambda methods: methods[0])
def test_methods_that_are_compared_differ_in_colour_and_in_line(methods):
    found = styles(methods).values()
    assert len({s["color"] for s in found}) == len(methods)
    assert len({str(s["ls"]) for s in found}) == len(methods) or len(methods) > 4


def test_settings_of_one_method_share_its_colour_and_differ_in_line_and_mark():
    found = styles(["TD, 0.05", "TD, 0.1", "MC, 0.1", "TD, 0.2", "truth"])
    settings = [found[f"TD, {alpha}"] for alpha in (0.05, 0.1, 0.2)]
    assert {s["color"] for s in settings} == {PALETTE["blue"]}
    assert len({str(s["ls"]) for s in settings}) == len({s["marker"] for s in settings}) == 3
    assert found["MC, 0.1"] == {"color": PALETTE["vermillion"], "ls": "--"}
    assert found["truth"]["color"] not in (PALETTE["blue"], PALETTE["vermillion"])


def test_settings_of_a_ladder_go_from_td_to_monte_carlo():
    for name, steps in (("λ", (0, 0.4, 0.8, 0.9, 0.95, 1)), ("n", (1, 2, 4, 8, 16, 64, 512))):
        labels = [f"{name} = {step}" for step in steps]
        colours = [style["color"] for style in styles(labels).values()]
        assert len(set(colours)) == len(steps)
        assert [colours[0], colours[-1]] == [PALETTE["blue"].lower(), PALETTE["vermillion"].lower()]
        assert min(contrast(colour, "white") for colour in colours) >= 4.5
        assert styles(labels[2:3])[labels[2]]["color"] == colours[2]  # alone or among others


def test_heatmap_puts_row_0_on_top_and_leaves_walls_without_text():
    fig, ax = plots.new_figure()
    values = np.array([[1.0, 2.0, np.nan], [4.0, -0.001, 6.0]])
    plots.heatmap(ax, values)
    texts = {text.get_position(): text.get_text() for text in ax.texts}
    assert texts == {(0, 0): "1.0", (1, 0): "2.0", (0, 1): "4.0", (1, 1): "0.0", (2, 1): "6.0"}
    fig.draw_without_rendering()
    assert ax.transData.transform((0, 0))[1] > ax.transData.transform((0, 1))[1]
    assert ax.transData.transform((0, 0))[0] < ax.transData.transform((1, 0))[0]


def test_heatmap_takes_its_own_texts_or_none():
    _, (left, right) = plots.new_figure(1, 2)
    plots.heatmap(left, np.eye(2), labels=[["a", "b"], ["c", "d"]])
    plots.heatmap(right, np.eye(2), fmt=None)
    assert [text.get_text() for text in left.texts] == list("abcd") and not right.texts


@pytest.mark.parametrize("ground", ["white", "black", "#808080", "#0072B2", "yellow", "red"])
def test_text_colour_has_the_higher_contrast(ground):
    chosen = plots.text_colour(ground)
    assert contrast(chosen, ground) == max(contrast("white", ground), contrast("black", ground))


@pytest.mark.parametrize("curve, side", [(0.3, 1), (0.0, 0), (-0.3, -1)])
def test_arrow_bends_to_the_left_of_travel_and_carries_its_text(curve, side):
    fig, ax = plots.new_diagram((0, 4), (-2, 2))
    plots.arrow(ax, (0.5, 0), (3.5, 0), "a", curve=curve)
    fig.draw_without_rendering()
    bent = ax.patches[0].get_path().vertices  # the middle point of the arc's three pulls it aside
    (text,) = ax.texts
    assert np.sign(np.round(text.get_position()[1], 6)) == side
    assert np.sign(np.round(bent[1, 1], 6)) == side


def test_diagram_has_equal_units_and_no_frame():
    fig, ax = plots.new_diagram((0, 10), (0, 4))
    plots.box(ax, (2, 2), "Agent")
    plots.circle(ax, (8, 2), "s", face="black")
    assert fig.get_size_inches() == pytest.approx([6, 2.4]) and not ax.axison
    assert [text.get_text() for text in ax.texts] == ["Agent", "s"]
    assert [text.get_color() for text in ax.texts] == ["black", "white"]


def curve():
    fig, ax = plots.new_figure()
    ax.plot(np.linspace(0, 1, 50), np.random.default_rng(0).normal(size=50), "o-")
    ax.set(xlabel=r"$\gamma^t$", title="a < b")
    return fig


def test_small_svg_draws_the_same_picture_in_fewer_bytes():
    full = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none"}):
        curve().savefig(full, format="svg")
    mime, raw = plots.encode(curve())
    small = raw.decode()
    assert mime == "image/svg+xml" and len(small) < 0.5 * len(full.getvalue())
    number = r"-?\d+(?:\.\d+)?"
    paths = [re.findall(r'<path[^>]* d="([^"]*)"', svg) for svg in (full.getvalue(), small)]
    assert len(paths[0]) == len(paths[1])
    for before, after in zip(*paths, strict=True):
        assert re.findall("[A-Za-z]", before) == re.findall("[A-Za-z]", after)
        before, after = (np.array(re.findall(number, path), float) for path in (before, after))
        np.testing.assert_allclose(before, after, atol=0.051)
    places = [re.findall(rf'<use [^>]*x="({number})" y="({number})"', svg) for svg in (full.getvalue(), small)]
    assert len(places[0]) > 50
    np.testing.assert_allclose(*(np.array(found, float) for found in places), atol=0.0051)


def test_small_svg_shares_styles_names_ids_briefly_and_keeps_no_empty_group():
    svg = plots.encode(curve())[1].decode()
    assert "<g>" not in svg and "<g/>" not in svg and svg.count("<g ") == svg.count("</g>") > 0
    ids = re.findall(r' id="([^"]*)"', svg)
    assert ids == [f"i{n}" for n in range(len(ids))] and len(ids) > 3
    assert set(re.findall(r'(?:url\(|href=")#([^")]*)', svg)) <= set(ids)
    styles = re.findall(r' style="([^"]*)"', svg)
    rules = dict(re.findall(r"\.(c\d+)\{([^}]*)\}", svg))
    assert len(set(styles)) == len(styles) and not set(styles) & {*rules.values()}
    used = re.findall(r' class="([^"]*)"', svg)
    assert set(used) == set(rules) and all(used.count(name) > 1 for name in rules)


def test_bare_groups_go_and_the_others_stay_where_they_are():
    assert style._ungroup('<g><g id="a"><g/><g>x</g></g></g><g>y</g>') == '<g id="a">x</g>y'


def test_svg_keeps_text_as_text_with_fonts_to_fall_back_on():
    svg = plots.encode(curve())[1].decode()
    assert f'font-family="{style.FONTS}"' in svg and svg.count("DejaVu Sans") == 1
    assert ">a &lt; b</text>" in svg and "γ" in svg


@pytest.mark.parametrize("fmt", ["svg", "png"])
def test_encode_closes_the_figure_and_repeats_itself(fmt):
    assert plots.encode(curve(), fmt) == plots.encode(curve(), fmt)
    assert plt.get_fignums() == []


def test_a_figure_shown_by_hand_is_not_shown_again_at_the_end_of_the_cell():
    fig, _ = plots.new_figure()
    assert plt.get_fignums() == [fig.number]
    with pytest.raises(NotImplementedError):  # which sends IPython to its usual way of showing a figure
        fig._ipython_display_()
    assert plt.get_fignums() == []


@pytest.mark.long
@pytest.mark.parametrize("last", ["fig = figure()", "figure()", "display(figure())"])
def test_notebook_shows_a_figure_once(last):
    cells = ["from rlcore import plots; plots.use_style(); figure = lambda: plots.new_figure()[0]", last]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    (output,) = notebook.cells[1].outputs
    assert output.data["text/plain"] == "<Figure size 600x360 with 1 Axes>" and output.data["image/png"]


def test_unknown_figure_names_the_chapters():
    with pytest.raises(AttributeError, match=r"no figure 'nonsense'.*ch01"):
        _ = plots.nonsense
    assert plots.ch01.__name__ == "rlcore.plots.ch01"
    assert {"use_style", "ch01"} <= set(dir(plots))
