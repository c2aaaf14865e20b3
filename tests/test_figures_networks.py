"""Figures of chapters 5 to 8: what their axes show, against numbers computed otherwise, and which series is which."""

from types import SimpleNamespace

import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import plots
from rlcore.plots import ch05, ch06


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def words(ax):
    return [text.get_text() for text in ax.texts]


def series(ax):
    """{label: (x, y)} of the lines that have a label."""
    return {line.get_label(): line.get_xydata().T for line in ax.lines if not line.get_label().startswith("_")}


def labels(ax):
    return ax.get_xlabel(), ax.get_ylabel(), ax.get_title()


def near(found, expected):
    np.testing.assert_allclose(found, expected, atol=1e-9)


def edges(collection, x):
    """Lowest and highest point of a band above x."""
    points = collection.get_paths()[0].vertices
    at = points[np.isclose(points[:, 0], x), 1]
    return at.min(), at.max()


# ---------------------------------------------------------------------- chapter 5


def test_columns_of_figure_23_have_their_weights():
    (ax,) = plots.backup_spectrum([1, 2, 4], [0.3, 0.21, 0.49], "look ahead").axes
    place = {text.get_text(): text.get_position()[0] for text in ax.texts}
    for name, weight, x in (("1\nstep", "0.3", 0), ("2\nsteps", "0.21", 2), ("Monte\nCarlo", "0.49", 4)):
        assert place[name] == place[weight] == x
    assert ax.get_title() == "look ahead"
    for n, x in zip((1, 2, 4), (0, 2, 4)):
        column = [line for line in ax.lines if len(line.get_xdata()) == 1 and line.get_xdata()[0] == x]
        assert len(column) == 2 * n + 1  # a state more than actions
        assert [line.get_marker() for line in column][-1] == ("s" if x == 4 else "o")


def test_weights_of_figure_24():
    weights = np.array([0.2, 0.16, 0.128, 0.512])
    (ax,) = plots.return_weights(weights, 0.8).axes
    near(series(ax)["n-step returns"], [[1, 2, 3], weights[:3]])
    (bar,) = ax.patches
    near([bar.get_x() + bar.get_width() / 2, bar.get_height()], [4, 0.512])
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"n-step returns", "complete return, 0.51"}
    assert labels(ax) == ("n", "weight", "λ = 0.8, half of it every 3.1 steps")  # 0.8^3.1 = 0.5
    ticks = plots.return_weights(np.full(20, 0.05), 0.9).axes[0].get_xticks()
    near(ticks, ticks.round())


@pytest.mark.parametrize("forward", [True, False])
def test_time_lines_of_figures_25_and_27(forward):
    heights = np.array([0.5, 0.25, 0.125]) if forward else np.array([0.2, 0.4, 0.8])
    (ax,) = plots.time_line([3, 2, 3, 4, 5, 0], 2, heights, "walk", forward=forward).axes
    bars = [p for p in ax.patches if isinstance(p, matplotlib.patches.Rectangle)]
    near([bar.get_x() + bar.get_width() / 2 for bar in bars], [3, 4, 5] if forward else [0, 1, 2])
    near([bar.get_height() for bar in bars], heights / heights.max())
    assert words(ax) == ["C", "B", "C", "D", "E", ""]
    edge = [line.get_markeredgecolor() for line in ax.lines[:6]]
    assert [k for k in range(6) if edge[k] == ch05.RED] == [2]
    what = "effect on the target" if forward else "credit, share of the largest"
    assert labels(ax) == ("time", what, "walk")


def test_trace_courses_of_figure_26():
    courses = {"accumulating": np.array([1.0, 0.5, 1.25]), "replacing": np.array([1.0, 0.5, 1.0])}
    axes = plots.trace_courses(courses, [0, 2], "a state").axes
    for ax, (kind, course) in zip(axes, courses.items()):
        assert ax.get_ylabel() == kind
        near(ax.lines[0].get_xydata().T, [range(3), course])
        near(ax.lines[2].get_xydata(), [[0, 0], [2, 0]])
    assert axes[0].get_title() == "a state" and axes[-1].get_xlabel() == "time (marks: visits)"


def test_cuts_of_figure_29_are_shares():
    cuts = np.array([1, 1, 2, 5, 40, 31, 30, 3])
    (ax,) = plots.cut_histogram(cuts, "cuts").axes
    heights = {round(bar.get_x() + bar.get_width() / 2): bar.get_height() for bar in ax.patches}
    near([heights[n] for n in (1, 2, 3, 4, 5, 30)], [2 / 8, 1 / 8, 1 / 8, 0, 1 / 8, 3 / 8])
    near(series(ax)["mean 14.1"][0], 113 / 8)
    assert labels(ax) == ("steps until a cut (30: 30 and more)", "share of the cuts", "cuts")


def test_sweep_has_means_and_standard_errors():
    values = np.random.default_rng(0).random((3, 5))
    curves = {"n = 1": (np.array([0.1, 0.2, 0.4]), values), "n = 4": (np.array([0.1, 0.2, 0.4]), values + 1)}
    (ax,) = plots.sweep(curves).axes
    for k, (label, (x, y)) in enumerate(curves.items()):
        mean = [sum(row) / 5 for row in y]
        near(series(ax)[label], [x, mean])
        error = np.sqrt(sum((y[1] - mean[1]) ** 2) / 5) / 5**0.5
        near(edges(ax.collections[k], 0.2), (mean[1] - error, mean[1] + error))
    assert labels(ax)[:2] == ("step size α", "RMS error, first 10 episodes")


# ---------------------------------------------------------------------- chapter 6


def test_network_diagram_draws_layers_weights_and_names():
    weights = [np.array([[1.0, -0.5], [0.2, 0.0], [0.3, 0.4]]), np.array([[0.1, -0.2, 0.6]])]
    values = [[0.1, 0.2], [0.3, 0.4, 0.5], [0.9]]
    options = dict(weights=weights, names={0: ["x", "y"], 2: ["out"]}, values=values, lit=[(1, 2)], title="net")
    (ax,) = plots.network_diagram([2, 3, 1], **options).axes
    lines = [line for line in ax.lines if len(line.get_xdata()) == 2]
    dots = [line for line in ax.lines if len(line.get_xdata()) == 1]
    assert (len(lines), len(dots)) == (2 * 3 + 3, 6)
    flat = [*weights[0].ravel(), *weights[1].ravel()]
    assert [line.get_color() for line in lines] == [ch06.RED if w < 0 else ch06.BLUE for w in flat]
    assert np.argmax([line.get_linewidth() for line in lines]) == 0  # the largest weight
    assert [k for k, dot in enumerate(dots) if dot.get_markeredgecolor() == ch06.RED] == [4]
    found = {text.get_text(): text.get_position() for text in ax.texts}
    assert {"0.10", "0.90", "x", "y", "out"} <= {*found}
    assert found["x"][0] < 0 < 2 < found["out"][0] and found["x"][1] > found["y"][1]
    assert [text for text in words(ax) if text in "123"] == ["2", "3", "1"] and ax.get_title() == "net"
    assert "⋮" in words(plots.network_diagram([20, 3]).axes[0])
    assert "$h_1$" in words(plots.network_diagram([1, 4, 1], brackets=True).axes[0])


def test_flow_of_figure_31():
    (ax,) = plots.flow().axes
    place = {text.get_text(): text.get_position()[0] for text in ax.texts}
    order = ["x", "network\nw, b", "a(x)", "y(x), what it should be", "cost\nC(w, b)"]
    assert sorted(place, key=place.get) == order


def test_digit_and_what_the_network_says():
    image, output = np.random.default_rng(0).random((28, 28)), np.linspace(0, 0.9, 10)[::-1].copy()
    output[3] = 0.95
    left, right = plots.digit(image, output, "five").axes[:2]
    near(left.images[0].get_array(), image)
    near([bar.get_height() for bar in right.patches], output)
    red = [
        k for k, bar in enumerate(right.patches) if matplotlib.colors.to_hex(bar.get_facecolor()) == ch06.RED.lower()
    ]
    assert red == [3] and left.get_title() == "a five"
    assert right.get_title() == "largest: 3" and right.get_xlabel() == "output neuron"


def test_decision_of_figure_32():
    surface, points = np.arange(16).reshape(4, 4) / 16, np.array([[0.1, 0.2], [0.8, 0.9], [0.3, 0.6]])
    ax = plots.decision(surface, points, np.array([0, 1, 0]), "stay or leave").axes[0]
    near(ax.images[0].get_array(), surface)
    assert ax.images[0].origin == "lower" and list(ax.images[0].get_extent()) == [0, 1, 0, 1]
    near(ax.lines[0].get_xydata(), points[[0, 2]])
    near(ax.lines[1].get_xydata(), points[[1]])
    assert labels(ax) == ("temperature", "pain", "stay or leave")


def test_activations_of_figures_33_and_34():
    z = np.linspace(-2, 2, 5)
    curves = {"sigmoid": (z, 1 / (1 + np.exp(-z))), "ReLU": (z, np.maximum(z, 0))}
    (ax,) = plots.activation(curves, 1.0, title="both").axes
    for label, (x, y) in curves.items():
        near(series(ax)[label], [x, y])
    near([line.get_xydata()[0] for line in (ax.lines[1], ax.lines[3])], [[1, 1 / (1 + np.exp(-1))], [1, 1]])
    assert labels(ax) == ("z", "", "both")


def test_gradient_norms_are_geometric_means():
    norms = {"sigmoid": np.array([[1.0, 4.0], [0.1, 0.001]]), "ReLU": np.array([[1.0, 1.0], [2.0, 8.0]])}
    (ax,) = plots.gradient_norms([2, 8], norms).axes
    near(series(ax)["sigmoid"], [[2, 8], [2.0, 0.01]])
    near(series(ax)["ReLU"], [[2, 8], [1.0, 4.0]])
    assert ax.get_yscale() == "log" and labels(ax)[:2] == ("layers", "norm of the gradient")


def test_function_of_figure_35_and_its_inset():
    x = np.linspace(0, 1, 5)
    (ax,) = plots.function_plot(x, x**2, "f", inset=(3 * x, -x)).axes
    near(ax.lines[0].get_xydata().T, [x, x**2])
    near(ax.child_axes[0].lines[0].get_xydata().T, [3 * x, -x])
    assert labels(ax) == ("x", "f(x)", "f")


def test_hidden_neuron_marks_the_centre_of_its_step():
    x = np.linspace(0, 1, 5)
    (ax,) = plots.hidden_neuron(x, x / 2, 100.0, -40.0).axes
    near(ax.lines[0].get_xydata().T, [x, x / 2])
    near(ax.lines[1].get_xdata(), 0.4)
    assert ax.get_title() == "w = 100, b = -40; s = −b/w = 0.4; slope w/4 = 25"
    assert labels(ax)[:2] == ("x", "output")
    (outside,) = plots.hidden_neuron(x, x, 10.0, 40.0).axes
    assert len(outside.lines) == 1 and "s = −b/w = -4;" in outside.get_title()
    assert "w = 0: no step" in plots.hidden_neuron(x, x, 0.0, 1.0).axes[0].get_title()


def test_places_of_the_steps_of_figure_41():
    w, b = np.array([10.0, 20.0, 40.0]), np.array([-30.0, -10.0, 5.0])
    s = -b[:, None] / w
    ax = plots.step_places(w, b, s).axes[0]
    shown = ax.collections[0].get_array().reshape(3, 3)
    assert (shown.mask == (s > 1) | (s < 0)).all() and shown.count() == 4
    near(shown.compressed(), s[~shown.mask])
    for line, level in zip(ax.lines, (0.2, 0.4, 0.6, 0.8), strict=True):
        near(line.get_xydata().T, [w, -level * w])
    assert labels(ax) == ("weight w", "bias b", "position of the step, s = −b/w")


def test_weighted_outputs_of_figures_42_to_44():
    x = np.linspace(0, 1, 4)
    (ax,) = plots.weighted_output(x, 0.8 * x, (0.4, 0.6), (0.8, -0.8)).axes
    near(ax.lines[0].get_xydata().T, [x, 0.8 * x])
    near([line.get_xdata()[0] for line in ax.lines[1:]], [0.4, 0.6])
    assert labels(ax) == ("x", "weighted output", "$s_1$ = 0.4, $w_1$ = 0.8,  $s_2$ = 0.6, $w_2$ = -0.8")


def test_approximations_and_errors_of_figure_46():
    x = np.linspace(0, 1, 6)
    (ax,) = plots.approximation(x, x**2, {"5 bumps": x, "20 bumps": 1 - x}, "networks").axes
    shown = series(ax)
    near(shown["f(x) = cos² x + x"], [x, x**2])
    near(shown["5 bumps"], [x, x])
    near(shown["20 bumps"], [x, 1 - x])
    assert ax.get_title() == "networks"
    (ax,) = plots.errors_by_size([2, 4, 8], {"steps": np.array([0.3, 0.2, 0.1])}).axes
    near(series(ax)["steps"], [[2, 4, 8], [0.3, 0.2, 0.1]])
    near(series(ax)["1 / (2N)"], [[2, 4, 8], [1 / 4, 1 / 8, 1 / 16]])
    assert labels(ax)[:2] == ("bumps N", "largest error") and ax.get_xscale() == ax.get_yscale() == "log"


def test_descent_of_figure_48_walks_on_the_cost():
    v = np.linspace(-2, 2, 41)
    (ax,) = plots.descent_1d(v, v**2 / 2, v, np.array([1.5, 0.5, -0.1]), "descent").axes
    shown = series(ax)
    near(shown["cost"], [v, v**2 / 2])
    near(shown["its derivative"], [v, v])
    near(shown["descent"], [[1.5, 0.5, -0.1], [1.125, 0.125, 0.005]])
    assert ax.get_xlabel() == "v" and ax.get_title() == "descent"


# ---------------------------------------------------------------------- chapter 7


def test_ascent_of_figure_49():
    p = np.linspace(0.1, 0.9, 9)
    (ax,) = plots.corridor_ascent(p, -20 - 10 * p, np.array([0.2, 0.5]), 0.586, "ascent").axes
    near(ax.lines[0].get_xydata().T, [p, -20 - 10 * p])
    near(series(ax)["ascent"], [[0.2, 0.5], [-22, -25]])
    near(series(ax)["best: p = 0.586"][0], 0.586)
    assert labels(ax) == ("probability of right", "expected return J", "ascent")


def test_tangent_of_figure_50():
    x = np.linspace(-1, 1, 5)
    (ax,) = plots.slope_against_differences(x, x**2, (0.5, 0.25), 1.0, "tangent").axes
    near(series(ax)["J along one parameter"], [x, x**2])
    near(series(ax)["exact slope"], [[0.0, 1.0], [-0.25, 0.75]])
    near(ax.lines[2].get_xydata(), [[0.5, 0.25]])
    assert labels(ax) == ("parameter", "J", "tangent")


def test_bars_of_figure_51_stand_at_their_actions():
    updates = {"expected": np.array([0.2, -0.1, -0.1]), "misprinted": np.array([0.5, 0.3, 0.2])}
    (ax,) = plots.update_bars(updates, "change").axes
    for bars, (label, values) in zip(ax.containers, updates.items()):
        assert bars.get_label() == label
        near([bar.get_height() for bar in bars], values)
        centres = [bar.get_x() + bar.get_width() / 2 for bar in bars]
        near(np.round(centres), range(3))
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["action 1", "action 2", "action 3"]
    assert ax.get_ylabel() == "expected change" and ax.get_title() == "change"


def test_returns_by_episode_are_smoothed_means_and_medians():
    runs = {"plain": np.random.default_rng(0).normal(-30, 9, (5, 40)), "baseline": np.zeros((5, 40)) - 12}
    (ax,) = plots.returns_by_episode(runs, -11.66, title="corridor").axes
    shown = series(ax)
    parts = runs["plain"].reshape(5, 4, 10).mean(axis=2)
    near(shown["plain, mean"], [[10, 20, 30, 40], parts.mean(axis=0)])
    near(shown["plain, median"], [[10, 20, 30, 40], np.sort(parts, axis=0)[2]])
    near(shown["baseline, mean"][1], -12)
    near(shown["-11.66"][1], -11.66)
    error = parts[:, 1].std() / 5**0.5
    near(edges(ax.collections[0], 20), (parts[:, 1].mean() - error, parts[:, 1].mean() + error))
    assert labels(ax) == ("episode", "return", "corridor")


def test_histograms_of_figure_54_name_mean_and_variance():
    estimates = {"without": np.array([-10.0, 10.0, 30.0, 10.0]), "with baseline": np.array([9.0, 11.0, 10.0, 10.0])}
    (ax,) = plots.gradient_histograms(estimates, "spread").axes
    names = {text.get_text() for text in ax.get_legend().get_texts()}
    assert names == {"without: mean 10.0, variance 200", "with baseline: mean 10.0, variance 0"}
    for outline, values in zip(ax.patches, estimates.values()):
        heights = outline.get_xy()[1:-1:2, 1]
        near(heights.sum() * 1.0, 1.0)  # bins of width 1
        assert heights.size == 120 and heights.max() == np.bincount((values + 60).astype(int)).max() / 4
    assert labels(ax) == ("gradient estimate of one episode", "density", "spread")


def test_two_rules_of_choice():
    d = np.linspace(-1, 1, 5)
    (ax,) = plots.two_rules(d, d / 4 + 0.5, np.where(d > 0, 0.95, 0.05)).axes
    near(series(ax)["softmax"], [d, d / 4 + 0.5])
    near(series(ax)["ε-greedy, ε = 0.1"], [d, [0.05, 0.05, 0.05, 0.95, 0.95]])
    assert labels(ax)[:2] == ("difference of the values", "probability of action 2")


def test_paths_of_bluffing_and_calling():
    paths = {"both learn": np.array([[0.5, 0.5], [0.4, 0.6]]), "averages": np.array([[0.5, 0.5], [0.3, 0.7]])}
    (ax,) = plots.bluff_paths(paths).axes
    for label, path in paths.items():
        near(series(ax)[label], path.T)
    near(series(ax)["equilibrium (1/3, 2/3)"], [[1 / 3], [2 / 3]])
    assert labels(ax)[:2] == ("probability of bluffing", "probability of calling")


def test_steps_of_figure_56_by_blocks_of_episodes():
    blocks = {"4-4-2": np.array([[20.0, 60.0], [40.0, 100.0]]), "4-128-2": np.array([[50.0, 190.0], [70.0, 200.0]])}
    (ax,) = plots.steps_balanced(blocks, block=20, title="cart-pole").axes
    near(series(ax)["4-4-2"], [[20, 40], [30, 80]])
    near(series(ax)["4-128-2"], [[20, 40], [60, 195]])
    near(edges(ax.collections[0], 40), (70, 90))
    near(series(ax)["solved: 195"][1], 195)
    assert labels(ax) == ("episode", "steps, mean of 20 episodes", "cart-pole")


# ---------------------------------------------------------------------- chapter 8


def test_log_probabilities_of_figure_57_before_and_after():
    before, after = np.log([0.5, 0.3, 0.2]), np.log([0.4, 0.4, 0.2])
    fig = plots.log_probability_step(np.eye(3), ("up", "stay", "down"), before, after, [0.0, 1.0, 0.0], "a step")
    left, middle, right = fig.axes
    near(left.images[0].get_array(), np.eye(3))
    for bars, label, values, shift in zip(right.containers, ("before", "after"), (before, after), (0.19, -0.19)):
        assert bars.get_label() == label
        near([bar.get_width() for bar in bars], values)
        near([bar.get_y() + bar.get_height() / 2 for bar in bars], np.array([2, 1, 0]) + shift)
    assert [tick.get_text() for tick in right.get_yticklabels()] == ["up", "stay", "down"]
    assert [text for text in words(middle) if text != "network"] == ["0", "+1.0", "0"]
    assert right.get_xlabel() == "log probability" and fig.get_suptitle() == "a step"


def test_bounds_of_figure_58():
    theta = np.linspace(0, 1, 11)
    performance, bounds = theta * (2 - theta), np.array([theta - 0.5, 0.9 * theta])
    (ax,) = plots.minorize(theta, performance, bounds, np.array([0.1, 0.3, 0.8]), "bounds").axes
    shown = series(ax)
    near(shown["performance η"], [theta, performance])
    near(shown["lower bound M"], [theta, bounds[1]])
    near(shown["its maximum: the next point"], [[0.8], [0.72]])
    first, last = (line.get_xydata() for line in ax.lines if line.get_marker() == "o")
    near([first[0], last[0]], [[0.1, 0.19], [0.3, 0.51]])
    assert labels(ax) == ("parameter θ", "expected return", "bounds")


@pytest.mark.parametrize("advantage", [1.0, -2.0])
def test_one_term_of_figures_59_and_60(advantage):
    ratio = np.linspace(0, 2, 21)
    unclipped, clipped = ratio * advantage, np.clip(ratio, 0.8, 1.2) * advantage
    at = (1.5, 1.2, 0.0) if advantage > 0 else (1.5, -3.0, -2.0)
    (ax,) = plots.clip_term(ratio, unclipped, clipped, at, 0.2, "one term").axes
    shown = series(ax)
    near(shown["unclipped, r A"], [ratio, unclipped])
    lowest = [min(r * advantage, min(max(r, 0.8), 1.2) * advantage) for r in ratio]
    near(shown["their minimum"], [ratio, lowest])
    label = f"slope {at[2]:g}: gradient {'off' if advantage > 0 else 'on'}"
    near(shown[label], [[at[0]], [at[1]]])
    near([line.get_xdata()[0] for line in ax.lines[-2:]], [0.8, 1.2])
    slope = ax.lines[3].get_xydata()
    near((slope[1, 1] - slope[0, 1]) / (slope[1, 0] - slope[0, 0]), at[2])
    assert labels(ax) == ("ratio r", "one term of L", "one term")


def test_runs_of_figure_61_have_a_row_for_each_setting():
    runs = {"clip 0.2": np.array([0.5, 0.9, np.nan]), "KL": np.array([0.2, 0.4, 0.6])}
    (ax,) = plots.by_setting(runs, "score", marks=[0.8, 0.5], mark_label="published", title="figure 61", dots="a").axes
    assert "a" in series(ax)
    names = {tick.get_text(): y for tick, y in zip(ax.get_yticklabels(), ax.get_yticks())}
    assert names["clip 0.2"] > names["KL"]
    dots = [line.get_xydata() for line in ax.lines if line.get_marker() == "o"]
    near(dots[0], [[0.5, names["clip 0.2"]], [0.9, names["clip 0.2"]]])
    near(dots[1][:, 0], [0.2, 0.4, 0.6])
    bars = [line.get_xdata()[0] for line in ax.lines if line.get_linewidth() == 3]
    near(bars, [0.7, 0.4])
    near(series(ax)["published"], [[0.8, 0.5], [names["clip 0.2"], names["KL"]]])
    assert labels(ax)[::2] == ("score", "figure 61")


def test_two_searches_climb_the_same_hill():
    paths = {
        "line search": np.array([[-1.0, 1.0], [0.0, 0.5]]),
        "trust region": np.array([[-1.0, 1.0], [0.5, 0.2], [1, 1]]),
    }
    (ax,) = plots.two_searches(lambda x, y: -((x - 1) ** 2) - (y - 1) ** 2, paths, np.array([0.3, 0.2])).axes
    for label, path in paths.items():
        near(series(ax)[label], path.T)
    near(series(ax)["top"], [[1], [1]])
    (circle,) = [p for p in ax.patches if isinstance(p, matplotlib.patches.Circle)]
    near([*circle.center, circle.radius], [-1, 1, 0.3])
    assert labels(ax)[:2] == ("x", "y")


def test_two_distances_of_the_same_step():
    kls = np.array([0.1, 0.002])
    left, right = plots.two_distances(np.array([0.0, 4.0]), kls).axes
    sigmoid = lambda t: 1 / (1 + np.exp(-np.asarray(t)))  # noqa: E731
    near(left.lines[1].get_xydata().T, [[0, 1], sigmoid([0.0, 1.0])])
    near(left.lines[2].get_xydata().T, [[4, 5], sigmoid([4.0, 5.0])])
    near([bar.get_height() for bar in right.patches], kls)
    assert words(right) == ["0.1", "0.002"]
    assert [tick.get_text() for tick in right.get_xticklabels()] == ["0→1", "4→5"]
    assert labels(left)[:2] == ("parameter", "probability of action 1")
    assert labels(right)[:2] == ("step of the parameter", "KL(old, new)")


def test_catch_rates_are_means_of_their_episodes():
    rates = {"small step": np.random.default_rng(0).random((3, 40)), "large step": np.zeros((3, 40))}
    axes = plots.catch_rates(rates, width=10).axes
    for ax, (label, values) in zip(axes, rates.items()):
        near(series(ax)["mean"], [[10, 20, 30, 40], values.reshape(3, 4, 10).mean(axis=(0, 2))])
        near(ax.lines[1].get_ydata(), values[1].reshape(4, 10).mean(axis=1))
        near(series(ax)["at random"][1], 0.2)
        assert labels(ax)[::2] == ("episode", label)
    assert axes[0].get_ylabel() == "share caught"


def test_kl_against_the_scale_of_the_rewards():
    kls = {"penalty": np.array([0.001, 0.1]), "constraint": np.array([0.01, 0.01])}
    (ax,) = plots.kl_by_scale([0.1, 10.0], kls, 0.01).axes
    for label, values in kls.items():
        near(series(ax)[label], [[0.1, 10], values])
    near(ax.lines[-1].get_ydata(), 0.01)
    assert labels(ax)[:2] == ("rewards times", "mean KL(old, new)")
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["0.1", "10"]


def test_kl_and_beta_of_each_update():
    runs = {
        "adaptive": SimpleNamespace(kl=np.array([0.1, 0.02, 0.01]), beta=np.array([1.0, 2.0, 4.0])),
        "constraint": SimpleNamespace(kl=np.array([0.01, 0.012, 0.009]), beta=np.array([3.0, 3.5, 2.5])),
    }
    top, bottom = plots.kl_and_beta(runs, 0.01).axes
    for k, (label, run) in enumerate(runs.items()):
        near(series(top)[label], [[1, 2, 3], run.kl])
        near(bottom.lines[k].get_xydata().T, [[1, 2, 3], run.beta])
        assert bottom.lines[k].get_color() == top.lines[k].get_color()
    near(top.lines[-1].get_ydata(), 0.01)
    assert (top.get_ylabel(), bottom.get_ylabel(), bottom.get_xlabel()) == ("mean KL", "β", "update")


def test_days_of_learning_are_written_in_their_units():
    days = {"a game": 0.5 / 24, "a player": 730.5, "the program": 365.25 * 45000}
    (ax,) = plots.days_of_learning(days, "experience").axes
    near([bar.get_x() + bar.get_width() for bar in ax.patches], np.array(list(days.values())) + 1e-8)
    names = {tick.get_text(): y for tick, y in zip(ax.get_yticklabels(), ax.get_yticks())}
    place = {text.get_text(): text.get_position()[1] for text in ax.texts}
    assert place["30 minutes"] == names["a game"] and place["2 years"] == names["a player"]
    assert place["45,000 years"] == names["the program"]
    assert ax.get_xscale() == "log" and labels(ax)[::2] == ("days", "experience")
    near([line.get_xdata()[0] for line in ax.lines], [1, 365.25, 80 * 365.25])
    assert [text.strip() for text in words(ax)][-3:] == ["day", "year", "80 years"]


def test_progress_draws_the_spread_that_it_is_given():
    fig = plots.progress([1, 2], {"a": [1.0, 2.0]}, "x", "y", spread={"a": [[0.0, 1.0], [3.0, 5.0]]})
    corners = {tuple(corner) for corner in fig.axes[0].collections[0].get_paths()[0].vertices}
    assert corners == {(1, 0), (2, 1), (2, 5), (1, 3)}
    np.testing.assert_array_equal(fig.axes[0].lines[0].get_ydata(), [1, 2])
