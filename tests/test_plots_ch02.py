"""What the figures of chapter 2 show: backup diagrams, golf, curves, against numbers got in another way."""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import Arc, Circle

from rlcore import plots
from rlcore.envs import recycling_robot
from rlcore.mdp import uniform_policy
from rlcore.plots.style import PALETTE


@pytest.fixture(autouse=True)
def own_style():
    with mpl.rc_context():
        plots.use_style()
        yield
    plt.close("all")


def texts(fig):
    return [text.get_text() for ax in fig.axes for text in ax.texts if text.get_text()]


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def nodes(fig):
    """How many open and how many filled circles there are."""
    filled = [circle.get_facecolor()[0] < 0.5 for circle in fig.axes[0].patches if isinstance(circle, Circle)]
    return filled.count(False), filled.count(True)


@pytest.mark.parametrize(
    "kind, states, actions, arcs", [("v_pi", 7, 3, 0), ("q_pi", 2, 7, 0), ("v_star", 7, 3, 1), ("q_star", 2, 7, 2)]
)
def test_backup_diagram_has_its_nodes_and_an_arc_at_each_maximum(kind, states, actions, arcs):
    fig = plots.backup_diagram(kind, n_actions=3, n_next=2)
    assert nodes(fig) == (states, actions)
    assert sum(isinstance(patch, Arc) for patch in fig.axes[0].patches) == texts(fig).count("max") == arcs
    assert ("$\\pi$" in texts(fig)) == kind.endswith("pi")


def test_backup_diagram_says_which_kinds_there_are():
    with pytest.raises(ValueError, match="kind: got 'v'"):
        plots.backup_diagram("v")


def test_numbers_on_the_branches_average_to_the_root():
    robot, gamma = recycling_robot(), 0.9
    words = texts(plots.value_diagram(robot, 0, uniform_policy(robot), gamma))
    v = np.linalg.solve(  # of the two states, by hand: search and wait, search, wait and recharge
        np.eye(2) - gamma * np.array([[0.95, 0.05], [1.4 / 3, 1.6 / 3]]), [1.5, (0.6 * 2 - 0.4 * 3 + 1) / 3]
    )
    q = [2 + gamma * (0.9 * v[0] + 0.1 * v[1]), 1 + gamma * v[0]]
    assert v[0] == pytest.approx(sum(q) / 2)
    for number in (*v, *q):
        assert f"{number:.2f}" in words
    assert words.count("π 0.5") == 2 and {"p 0.9\nr +2", "p 0.1\nr +2", "p 1\nr +1"} <= set(words)


def test_the_branch_of_the_maximum_is_strong():
    robot = recycling_robot()
    ax = plots.value_diagram(robot, 0, uniform_policy(robot), 0.9, take="max").axes[0]
    widths = [line.get_linewidth() for line in ax.lines]
    assert sorted(widths)[-2:] == [1.6, 4.5]
    with pytest.raises(ValueError, match="take: got 'both'"):
        plots.value_diagram(robot, 0, uniform_policy(robot), 0.9, take="both")


def test_golf_rounds_to_whole_strokes_and_names_the_sand_once():
    values = np.array([-2.5, -1.0, -np.inf, -3.999999999, -np.inf, 0.0])
    fig = plots.golf({"(a)": values, "(b)": np.full(6, -2.0)}, (2, 3), hole=(1, 2), tee=(0, 0), sand=[(0, 2), (1, 1)])
    first, second = fig.axes[:2]
    strokes = first.images[0].get_array()
    assert strokes.filled(9).tolist() == [[-3, -1, 9], [-4, 9, 0]]
    assert [text.get_text() for text in first.texts] == ["hole", "tee"]  # no label in a cell
    assert legend(first) == ["sand: −∞"] and second.get_legend() is None
    assert [first.get_title(), second.get_title()] == ["(a)", "(b)"] and len(fig.axes) == 3  # one colour bar


def test_best_club_of_every_cell():
    putter, driver = np.array([-1.0, -3, -2, -4]), np.array([-2.0, -3, -1, -4.5])
    ax = plots.best_clubs(putter, driver, (2, 2), hole=(0, 0), tee=(1, 0), sand=[(0, 1)]).axes[0]
    assert ax.images[0].get_array().tolist() == [[2, 1], [0, 2]]  # putter, either, driver, putter
    assert legend(ax) == ["driver", "either", "putter", "sand"] and "-1.00 from the tee" in ax.get_title()
    keys = [key.get_facecolor() for key in ax.get_legend().get_patches()[:3]]
    assert [ax.images[0].cmap(k / 2) for k in range(3)] == keys


def test_groups_and_table_keep_their_colours_in_both_figures():
    exact, runs = np.linspace(-1, 1, 5), {"ten groups": np.zeros((3, 5)), "table": np.ones((3, 5))}
    stairs = plots.staircase(exact, runs).axes[0]
    errors = plots.bands({name: (exact, runs[name]) for name in ("table", "ten groups")}, xlabel="e", ylabel="r").axes[
        0
    ]
    colours = [{line.get_label(): line.get_color() for line in ax.lines} for ax in (stairs, errors)]
    assert colours[0].pop("exact") == PALETTE["black"] and colours[0] == colours[1]
    assert [line.get_ydata()[0] for line in stairs.lines] == [-1, 0, 1]


def test_bands_are_means_with_one_standard_deviation():
    runs = np.array([[1.0, 2, 3], [3, 4, 5]])
    ax = plots.bands({"a": (np.arange(3), runs)}, xlabel="x", ylabel="y", log_x=True, log_y=True).axes[0]
    assert ax.lines[0].get_ydata().tolist() == [2, 3, 4]
    band = ax.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == (1, 5) and (ax.get_xscale(), ax.get_yscale()) == ("log", "log")


def test_visits_and_errors_are_points():
    ax = plots.visits_and_errors({"trajectory": (np.array([1, 10]), np.array([0.5, 0.1]))}).axes[0]
    assert ax.lines[0].get_linestyle() == "None" and ax.lines[0].get_xydata().tolist() == [[1, 0.5], [10, 0.1]]
    assert ax.get_xlabel() == "updates of the pair"
