"""Figures of chapters 5 to 8 that were mended: fading credit, cuts, gaps for dots, a parabola, a bound that is none."""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import plots


@pytest.fixture(autouse=True)
def own_style():
    with mpl.rc_context():
        plots.use_style()
        yield
    plt.close("all")


STATES = [3, 4, 3, 4, 5, 4, 3, 4, 5, 6]


@pytest.mark.parametrize("trace", ["accumulating", "replacing", "dutch"])
@pytest.mark.parametrize("t", [0, 1, 6, 8])
def test_what_the_visits_left_adds_up_to_the_traces(trace, t):
    decay, alpha, e = 0.8, 0.25, np.zeros(7)
    for s in STATES[: t + 1]:
        e *= decay
        e[s] = {"accumulating": e[s] + 1, "replacing": 1, "dutch": (1 - alpha) * e[s] + 1}[trace]
    credits = plots.visit_credits(STATES, t, decay, trace, alpha)
    np.testing.assert_allclose(np.bincount(STATES[: t + 1], credits, minlength=7), e)
    assert credits[-1] == 1


def test_the_backward_view_fades_into_the_past():
    credits = plots.visit_credits(STATES, 6, 0.8, "accumulating")
    ax = plots.time_line(STATES, 6, credits, "t = 6", forward=False).axes[0]
    heights = [bar.get_height() for bar in ax.patches if isinstance(bar, mpl.patches.Rectangle)]
    np.testing.assert_allclose(heights, 0.8 ** np.arange(6, -1, -1))
    assert [text.get_text() for text in ax.texts if text.get_text()] == list("CDCDEDCDE")
    assert ax.get_yticks().tolist() == [0, 0.5, 1]


def test_cuts_are_counted_for_all_steps():
    cuts = np.array([1, 1, 2, 40])
    ax = plots.cut_histogram(cuts, "ε = 0.1", steps=100).axes[0]
    assert ax.get_title() == "ε = 0.1: one cut in 25 steps" and not ax.lines
    heights = [bar.get_height() for bar in ax.patches]
    assert heights[:3] == [0.5, 0.25, 0] and heights[29] == 0.25


@pytest.mark.parametrize("sizes", [[4, 16, 2], [784, 16, 16, 10]])
def test_dots_stand_in_a_gap_between_neurons(sizes):
    ax = plots.network_diagram(sizes).axes[0]
    neurons = [(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines if line.get_marker() == "o"]
    dots = [text.get_position() for text in ax.texts if text.get_text() == "⋮"]
    assert len(dots) == sum(n > 10 for n in sizes)
    for x, y in dots:
        column = sorted(height for k, height in neurons if k == x)
        assert len(column) == 10 and min(abs(height - y) for height in column) > 0.6 * (column[1] - column[0])


def test_a_bracket_spans_each_pair():
    ax = plots.network_diagram([1, 6, 1], brackets=True).axes[0]
    neurons = sorted(line.get_ydata()[0] for line in ax.lines if line.get_marker() == "o" and line.get_xdata()[0] == 1)
    spans = [(min(line.get_ydata()), max(line.get_ydata())) for line in ax.lines if len(line.get_xdata()) == 4]
    for (low, high), pair in zip(sorted(spans), np.reshape(neurons, (3, 2)), strict=True):
        assert low < pair[0] < pair[1] < high
    words = [text.get_text() for text in ax.texts]
    assert {"$h_1$", "$h_2$", "$h_3$"} <= set(words)


def test_no_arrow_of_the_flow_runs_through_a_text():
    fig = plots.flow()
    fig.draw_without_rendering()
    (words,) = [text for text in fig.axes[0].texts if "should be" in text.get_text()]
    box = words.get_window_extent()
    for arrow in (p for p in fig.axes[0].patches if isinstance(p, mpl.patches.FancyArrowPatch)):
        ends = fig.axes[0].transData.transform(arrow._posA_posB)
        for share in np.linspace(0, 1, 50):
            assert not box.contains(*((1 - share) * ends[0] + share * ends[1]))


def test_variance_against_the_baseline_is_a_parabola_with_the_best_one_marked():
    rng = np.random.default_rng(0)
    G, score = rng.normal(-12, 5, 4000), rng.normal(size=4000)
    ax = plots.baseline_variance({b: (G - b) * score for b in (-40, -20, -6, 0, 20)}).axes[0]
    curve, points, best, none = ax.lines
    assert points.get_ydata() == pytest.approx(np.interp(points.get_xdata(), *curve.get_data()), rel=0.01)
    x = np.linspace(-20, 0, 2001)
    variances = [np.var((G - b) * score) for b in x]
    assert best.get_xdata()[0] == pytest.approx(x[np.argmin(variances)], abs=0.02)
    assert none.get_xydata()[0] == pytest.approx([0, np.var(G * score)])


@pytest.mark.parametrize("lift, label", [(0.0, "lower bound M"), (0.5, "M, above η: no bound")])
def test_what_is_no_lower_bound_is_not_called_one(lift, label):
    theta = np.linspace(-2, 2, 101)
    performance = 6 - 0.1 * theta**2
    fig = plots.minorize(theta, performance, [performance - 0.2 * (theta - 1) ** 2 + lift], [1.0, 0.5])
    assert label in [text.get_text() for text in fig.axes[0].get_legend().get_texts()]


def test_both_terms_of_the_clipped_objective_are_drawn():
    r = np.linspace(0, 2, 201)
    fig = plots.clip_term(r, r, r.clip(0.8, 1.2), (1.1, 1.1, 1.0), 0.2)
    curves = {line.get_label(): line.get_ydata() for line in fig.axes[0].lines}
    np.testing.assert_allclose(curves["their minimum"], np.minimum(curves["unclipped, r A"], curves["clipped"]))
    assert {text.get_text() for text in fig.legends[0].get_texts()} >= {"clipped", "slope 1: gradient on"}
