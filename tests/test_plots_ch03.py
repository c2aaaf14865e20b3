"""What the figures of chapter 3 show: labels, curves and bars, against numbers got in another way; see test_ch03."""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import plots
from rlcore.envs import dyna_maze, recycling_robot
from rlcore.mdp import uniform_policy
from rlcore.plots.style import PALETTE


@pytest.fixture(autouse=True)
def own_style():
    with mpl.rc_context():
        plots.use_style()
        yield
    plt.close("all")


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_loop_names_its_four_steps_in_order():
    fig = plots.loop_diagram(("a", "b", "c", "d"))
    places = {text.get_text(): text.get_position() for text in fig.axes[0].texts}
    assert places["a"][0] == places["d"][0] < places["b"][0] == places["c"][0]
    assert places["a"][1] == places["b"][1] > places["c"][1] == places["d"][1]


def test_prediction_error_at_k_is_marked():
    real = np.zeros((4, 3, 4))
    predicted = real.copy()
    predicted[3, :, 3] = np.radians([1.0, 2.0, 2.0])
    left, right = plots.prediction_errors(real, predicted, 3).axes
    assert left.lines[1].get_ydata() == pytest.approx([1, 2, 2]) and left.get_title() == "3 steps ahead"
    assert right.lines[1].get_xydata()[0] == pytest.approx([3, np.sqrt(3)])


def test_trajectory_bars_tell_the_expected_sum():
    states, actions = np.zeros((2, 2), int), np.zeros((2, 2), int)
    top, bottom = plots.trajectory_bars(states, actions, np.array([0.25, 0.75]), np.array([3.0, 1.0]), 1.5).axes
    assert [bar.get_height() for bar in top.patches] == [0.75, 0.25]  # in the order of their sums
    assert bottom.lines[0].get_ydata().tolist() == [1, 3] and bottom.lines[1].get_ydata()[0] == 1.5
    assert "2 trajectories; expected sum 1.500" in bottom.get_xlabel()


@pytest.mark.parametrize("a", [0, 1, 2])
def test_model_and_policy_frames_the_chosen_action_and_shows_the_chain_of_the_policy(a):
    robot = recycling_robot()
    pi = np.array([[0.25, 0.75, 0.0], [0.5, 0.0, 0.5]])
    fig = plots.model_and_policy(robot, pi, a)
    framed = [all(side.get_visible() for side in ax.spines.values()) for ax in fig.axes[:3]]
    assert framed == [k == a for k in range(3)]
    assert [ax.get_title() for ax in fig.axes] == ["search", "wait", "recharge", "policy π", "", "$P_π$"]
    chain = np.array([[text.get_text() for text in fig.axes[5].texts]]).astype(float).reshape(2, 2)
    high, low = [0.25 * 0.9 + 0.75, 0.25 * 0.1], [0.5 * 0.4 + 0.5, 0.5 * 0.6]  # by hand
    np.testing.assert_allclose(chain, [high, low], atol=0.0051)


def test_family_tree_lights_one_leaf():
    ax = plots.family_tree("SARSA").axes[0]
    lit = [patch for patch in ax.patches if mpl.colors.to_hex(patch.get_facecolor()) == PALETTE["blue"].lower()]
    assert len(lit) == 1 and ax.texts[-1].get_text() == "chapter 4: rlcore.td.sarsa"
    assert plots.family_tree().axes[0].texts[-1].get_text() == ""


def test_descent_starts_at_the_square_and_stays_on_the_curve():
    def cost(v):
        return v**2

    fig = plots.descent_panels(cost, {0.1: np.array([2.0, 1.6]), 1.5: np.array([2.0, -4000.0])})
    curve, path, start = fig.axes[0].lines
    np.testing.assert_allclose(path.get_ydata(), path.get_xdata() ** 2)
    assert start.get_xydata().tolist() == [[2, 4]] and "1.6000" in fig.axes[0].get_title()
    assert fig.axes[1].get_title().endswith("beyond 1000") and fig.axes[1].lines[1].get_xdata().tolist() == [2]


def test_small_action_values_are_seen_and_zero_is_white():
    maze, Q = dyna_maze(), np.zeros((54, 4))
    Q[0] = [0.001, 0.01, 0.1, 1.0]
    bitmap = plots.q_table(Q, maze, (6, 9)).axes[0].images[0].get_array()
    up, down, right, left = (bitmap[y, x] for y, x in [(4, 12), (20, 12), (12, 20), (12, 4)])
    grey = [colour.mean() for colour in (up, down, right, left)]
    assert grey == sorted(grey, reverse=True) and grey[0] < 0.9 and grey[-1] < 0.4
    assert bitmap[24 + 4, 12].tolist() == [1, 1, 1]


def test_q_table_writes_the_change_of_the_entry_in_red():
    maze, Q = dyna_maze(), np.zeros((54, 4))
    Q[10, 2] = 0.15  # row 2, column 2, right
    ax = plots.q_table(Q, maze, (6, 9), flash=(10, 2), old=0.1, title="update 3").axes[0]
    assert ax.get_xlabel() == "Q(row 2, column 2; right) = 0.1 → 0.15" and ax.get_title() == "update 3"
    np.testing.assert_allclose(ax.images[0].get_array()[24 + 12, 24 + 20], mpl.colors.to_rgb(PALETTE["vermillion"]))
    assert plots.q_table(Q, maze, (6, 9), flash=(10, 2)).axes[0].get_xlabel().endswith("= 0.15")
    assert plots.q_table(Q, maze, (6, 9)).axes[0].get_xlabel() == ""


def test_q_tables_stand_side_by_side_with_one_scale():
    history = np.zeros((11, 54, 4))
    fig = plots.q_tables(history, [0, 1, 10], dyna_maze(), (6, 9))
    titles = [ax.get_title() for ax in fig.axes[:3]]
    assert titles == ["after 0 episodes", "after 1 episode", "after 10 episodes"]
    assert fig.axes[-1].get_ylabel() == "Q(s, a); white: 0"


def test_learning_curves_are_means_with_the_middle_half():
    runs = np.array([[1.0, 10], [2, 20], [3, 30], [6, 60]])
    ax = plots.learning_curves({"0 planning steps": runs}).axes[0]
    assert ax.lines[0].get_xydata().tolist() == [[1, 3], [2, 30]] and ax.get_yscale() == "log"
    band = ax.collections[0].get_paths()[0].vertices
    assert {tuple(corner) for corner in band} >= {(1, 1.75), (1, 3.75), (2, 17.5), (2, 37.5)}  # quartiles, by hand


def test_an_error_of_rounding_is_called_exact_and_does_not_stretch_the_axis():
    sweeps = np.arange(172)
    ax = plots.decay(
        {"value iteration": (sweeps, 0.9**sweeps), "policy iteration": (np.arange(3), np.array([1.0, 0.1, 1e-15]))},
        xlabel="sweeps or rounds", ylabel="largest error", log_x=False,
    ).axes[0]  # fmt: skip
    value, policy = ax.lines
    assert legend(ax) == ["value iteration", "policy iteration"] and value.get_ydata()[2] == pytest.approx(0.81)
    assert [text.get_text() for text in ax.texts] == ["exact"] and 1e-10 < policy.get_ydata()[2] < 0.9**171
    assert policy.get_marker() == "o" and value.get_marker() == "None"
    ends = ax.transData.transform([[0, 1], [1, 1], [2, 1], [171, 1]])[:, 0]
    assert (ends[2] - ends[0]) > 0.2 * (ends[3] - ends[0])  # two rounds are seen beside 171 sweeps


def test_decay_has_its_reference_in_grey():
    n = np.array([100.0, 10_000])
    ax = plots.decay({"error": (n, 3 / n)}, xlabel="n", ylabel="e", reference={"1 / n": (n, 1 / n)}).axes[0]
    assert ax.lines[1].get_color() == PALETTE["grey"] and ax.get_xscale() == "log" and legend(ax) == ["error", "1 / n"]


def test_pole_costs_put_each_episode_where_its_steps_are_spent():
    ax = plots.cart_pole_costs([np.full(12, 10)], 50).axes[0]
    assert ax.lines[0].get_xydata().tolist() == [[100, 10], [110, 10], [120, 10]]
    assert "REINFORCE, mean of 10 episodes" in legend(ax) and ax.lines[-1].get_xydata().tolist() == [[50, 200]]


def test_rewards_over_time_mark_the_change():
    ax = plots.rewards_over_time({"Dyna-Q": [[0, 10, 20]], "Dyna-Q+": [[0, 20, 60]]}, 1000).axes[0]
    assert [line.get_ydata()[-1] for line in ax.lines[:2]] == [20, 60] and ax.lines[2].get_xdata()[0] == 1000
    assert ax.lines[0].get_xdata().tolist() == [0, 1500, 3000] and legend(ax) == ["Dyna-Q", "Dyna-Q+"]


def test_spread_by_setting_names_the_settings():
    ax = plots.spread_by_setting([0, 0.1, 1], np.array([[1, 3], [2, 4], [0, 0]]), xlabel="ε", ylabel="r").axes[0]
    assert ax.lines[0].get_ydata().tolist() == [2, 3, 0]
    assert [label.get_text() for label in ax.get_xticklabels()] == ["0", "0.1", "1"]


def test_sweep_values_stand_in_their_cells():
    ax = plots.sweep_values(np.array([0, -14.0, -20, -22]), (2, 2), "sweep 9").axes[0]
    places = {text.get_position(): text.get_text() for text in ax.texts}
    assert places == {(0, 0): "0.00", (1, 0): "-14.00", (0, 1): "-20.00", (1, 1): "-22.00"}
    assert ax.get_title() == "sweep 9"


@pytest.mark.parametrize("gamma", [0.5, 0.99])
def test_the_bound_is_seen_beside_the_error_and_the_problems_are_named(gamma):
    errors = 3 * gamma ** np.arange(120.0)
    left, right = plots.value_iteration_progress(np.zeros(4), (2, 2), errors, gamma, 2).axes
    bound, error, mark = right.lines
    assert bound.get_linewidth() >= 3 * error.get_linewidth() and bound.get_color() != error.get_color()
    assert bound.get_zorder() <= error.get_zorder() and legend(right) == [r"bound $\gamma^k$", "error"]
    assert bound.get_ydata()[[0, 1, 10]] == pytest.approx([3, 3 * gamma, 3 * gamma**10])
    assert mark.get_xydata().tolist() == [[2, errors[2]]] and right.texts[0].get_text() == f"{errors[2]:.2g}"
    assert left.get_title().startswith("grid") and right.get_title() == "random process"


def test_uniform_policy_weighs_the_legal_actions_alike():
    robot = recycling_robot()
    words = [text.get_text() for text in plots.model_and_policy(robot, uniform_policy(robot), 0).axes[3].texts]
    assert words == ["0.50", "0.33", "0.50", "0.33", "0.33"]  # search, wait, recharge: high, low
