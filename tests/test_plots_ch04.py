"""What the figures of chapter 4 show: labels, curves and paths, against numbers got in another way."""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import Circle

from rlcore import plots
from rlcore.plots.style import METHODS, PALETTE
from rlcore.studies.ch04 import Update

NAMES = ("up", "down", "right", "left")


@pytest.fixture(autouse=True)
def own_style():
    with mpl.rc_context():
        plots.use_style()
        yield
    plt.close("all")


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def texts(fig):
    return [text.get_text() for ax in fig.axes for text in ax.texts if text.get_text()]


def test_predictions_move_the_fraction_alpha_of_the_way():
    predicted = np.array([30.0, 40, 35, 43])
    ax = plots.predictions(np.array([0, 5, 20, 43]), predicted, predicted[1:], 0.5, "TD").axes[0]
    before, after, took = ax.lines
    assert before.get_ydata().tolist() == [30, 40, 35, 43] and after.get_ydata().tolist() == [35, 37.5, 39]
    assert took.get_ydata()[0] == 43 and legend(ax)[2] == "what it took: 43 minutes"
    arrows = [(note.xyann, note.xy) for note in ax.texts]  # from the old prediction to the new one
    assert arrows == [((0, 30), (0, 35)), ((5, 40), (5, 37.5)), ((20, 35), (20, 39))]


def test_walk_is_drawn_step_by_step_below_its_states():
    walk = [3, 4, 3, 2, 3, 4, 5, 6]
    fig = plots.walk_graph(5, 0.25, walk)
    (line,) = [line for line in fig.axes[0].lines if line.get_marker() == "o"]
    assert line.get_xdata().tolist() == walk and np.all(np.diff(line.get_ydata()) < 0)
    names = {text.get_text(): text.get_position()[0] for text in fig.axes[0].texts}
    assert [names[name] for name in "ABCDE"] == [1, 2, 3, 4, 5] and {"t = 0", "t = 7"} <= set(names)
    assert names["t = 7"] == 6 and "right with probability 0.25, left 0.75" in names


@pytest.mark.parametrize("n, steps", [(5, 0), (9, 60), (5, 200)])
def test_walk_of_any_length_stays_on_the_figure(n, steps):
    fig = plots.walk_graph(n, 0.5, [(n + 1) // 2 + k % 2 for k in range(steps)])
    ax = fig.axes[0]
    low, high = ax.get_ylim()
    assert 1 < fig.get_figheight() < 9
    for line in ax.lines:
        assert low <= min(line.get_ydata()) and max(line.get_ydata()) <= high


def test_error_curves_are_means_and_methods_keep_their_colours():
    runs = np.array([[0.2, 0.1], [0.4, 0.1]])
    ax = plots.error_curves({"TD, 0.1": runs, "MC, 0.1": 2 * runs, "TD, 0.2": 3 * runs}).axes[0]
    assert [line.get_ydata()[0] for line in ax.lines] == pytest.approx([0.3, 0.6, 0.9])
    assert [line.get_color() for line in ax.lines] == [PALETTE[c] for c in ("blue", "vermillion", "blue")]
    assert legend(ax) == ["TD, 0.1", "MC, 0.1", "TD, 0.2"]
    corners = ax.collections[0].get_paths()[0].vertices
    half = np.ptp(corners[corners[:, 0] == 0, 1]) / 2
    assert half == pytest.approx(0.1 / np.sqrt(2))  # the standard error of 0.2 and 0.4


def test_estimates_stand_beside_the_truth():
    truth = np.arange(1, 6) / 6
    ax = plots.estimates_against_truth(truth, {"batch TD": truth + 0.1, "batch Monte Carlo": truth - 0.1}, "10").axes[0]
    for line, shift in zip(ax.lines, (0, 0.1, -0.1), strict=True):
        np.testing.assert_allclose(line.get_ydata(), truth + shift)
    assert legend(ax) == ["true", "batch TD", "batch Monte Carlo"]
    assert [label.get_text() for label in ax.get_xticklabels()] == list("ABCDE")


def test_predictor_writes_both_answers():
    words = texts(plots.predictor_graph(1.0, 0.75, {"Monte Carlo": (0.0, 0.75), "TD(0)": (0.75, 0.75)}))
    assert "Monte Carlo:  V(A) = 0,  V(B) = 0.75" in words and "TD(0):  V(A) = 0.75,  V(B) = 0.75" in words
    assert {"p = 1\nr = 0", "p = 0.75, r = 1", "p = 0.25, r = 0"} <= set(words)


def test_value_paths_end_where_they_should():
    ax = plots.value_paths({"TD(0)": np.array([[0.5, 0.5], [0.75, 0.7]])}, {"batch TD(0)": (0.75, 0.75)}).axes[0]
    assert ax.lines[0].get_xydata()[-1].tolist() == [0.75, 0.7] and ax.lines[1].get_xydata().tolist() == [[0.75, 0.75]]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("V(A)", "V(B)") and texts(ax.figure) == ["batch TD(0)"]


SAFE = [36, 24, 12, 0, 1, 2, 14]


@pytest.mark.parametrize("order", [("SARSA", "Q-learning"), ("Q-learning", "SARSA")])
def test_paths_and_curves_of_a_method_have_one_colour(order):
    paths = plots.cliff_paths(dict.fromkeys(order, SAFE)).axes[0]
    curves = plots.reward_curves({name: np.full((2, 30), -20.0) for name in order}).axes[0]
    for line, curve, name in zip(paths.lines, curves.lines, order, strict=True):
        assert line.get_color() == curve.get_color() == PALETTE[METHODS[name][0]]
        assert line.get_label() == f"{name}: 6 steps" and curve.get_label() == name
    x, y = paths.lines[0].get_data()
    assert np.round(x).tolist() == [0, 0, 0, 0, 1, 2, 2] and np.round(y).tolist() == [0, 1, 2, 3, 3, 3, 2]
    assert {"S", "G", "the cliff"} <= set(texts(paths.figure))


def test_rewards_are_smoothed_over_the_window():
    returns = np.tile(np.arange(20.0), (3, 1)) - 50
    ax = plots.reward_curves({"SARSA": returns}, window=4).axes[0]
    first = np.mean([-50, -49, -48, -47])
    assert ax.lines[0].get_xydata()[0].tolist() == [4, first] and ax.get_ylim() == (-100, 0)


def test_no_curve_ends_below_the_axis():
    ax = plots.reward_curves({"SARSA": np.full((2, 40), -30.0), "Q-learning": np.full((2, 40), -400.0)}).axes[0]
    assert ax.get_ylim()[0] < -400 and ax.get_ylim()[1] == 0


def test_one_update_shows_its_place_its_code_and_its_numbers():
    fig = plots.cliff_step(Update(31, 1, 36, -50.0, -75.5), NAMES, "update 9", target="max Q(S', a)", alpha=0.5)
    words = texts(fig)
    assert {"S", "G", "s", "s'", "Q[s, a] += alpha * (target − Q[s, a])"} <= set(words)
    assert "a = down;  target = R + max Q(S', a) = −101.00" in words
    assert "−50.00 + 0.5 · (−101.00 − (−50.00)) = −75.50" in words
    here, after = (patch.center for patch in fig.axes[0].patches if isinstance(patch, Circle))
    assert (here, after) == ((31 % 12, 1), (0, 0)) and fig.axes[0].get_title() == "update 9"


@pytest.mark.parametrize("alpha", [0.1, 0.5, 1.0])
def test_the_target_is_what_the_entry_moves_towards(alpha):
    old, target = -3.0, -7.5
    update = Update(24, 2, 25, old, old + alpha * (target - old))
    words = texts(plots.cliff_step(update, NAMES, "", target="Q(S', A')", alpha=alpha))
    assert "a = right;  target = R + Q(S', A') = −7.50" in words
    assert f"−3.00 + {alpha:g} · (−7.50 − (−3.00)) = −{3 + 4.5 * alpha:.2f}" in words


def test_a_step_that_leads_nowhere_is_a_ring_round_the_place():
    fig = plots.cliff_step(Update(36, 3, 36, 0.0, -0.5), NAMES, "", target="Q(S', A')")
    here, ring = (patch for patch in fig.axes[0].patches if isinstance(patch, Circle))
    assert here.center == ring.center and ring.radius > here.radius and not ring.get_fill()
    assert {"a = left, back to s;  target = R + Q(S', A') = −1.00", "0.00 + 0.5 · (−1.00 − 0.00) = −0.50"} <= set(
        texts(fig)
    )
    last = plots.cliff_step(Update(36, 3, -1, 0.0, -0.5), NAMES, "", target="Q(S', A')")
    assert sum(isinstance(patch, Circle) for patch in last.axes[0].patches) == 1
