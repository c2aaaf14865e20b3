"""What the figures of chapter 1 show: labels, curves and bars, against numbers got in another way."""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import plots
from rlcore.dp import value_iteration
from rlcore.envs import can_robot, pick_and_place, recycling_robot
from rlcore.mdp import Trajectory, rollout, uniform_policy
from rlcore.plots.style import PALETTE


@pytest.fixture(autouse=True)
def own_style():
    with mpl.rc_context():
        plots.use_style()
        yield
    plt.close("all")


def texts(fig):
    return [text.get_text() for ax in fig.axes for text in ax.texts]


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_loop_carries_symbols_or_one_step_of_a_trajectory():
    assert {"agent, in $S_t$", "environment", "$A_t$", "$R_{t+1}$", "$S_{t+1}$"} <= set(
        texts(plots.agent_environment_diagram())
    )
    robot, walk = recycling_robot(), Trajectory(np.array([0, 1, 0]), np.array([0, 2]), np.array([2.0, 0.0]), False)
    words = texts(plots.agent_environment_diagram(robot, walk, 1))
    assert {"agent, in $S_1$ = low", "$A_1$ = recharge", "$R_2$ = +0", "$S_2$ = high"} <= set(words)


def test_recycling_graph_writes_probability_and_reward_of_every_transition():
    fig = plots.recycling_graph(recycling_robot(alpha=0.75, beta=0.25, r_search=4.0, r_wait=2.0, r_rescue=-5.0))
    words = [text for text in texts(fig) if text]
    expected = ["0.75, +4", "0.25, +4", "1, +2", "1, +2", "0.25, +4", "0.75, -5", "1, +0"]
    expected += ["search", "search", "wait", "wait", "recharge", "high", "low"]
    assert sorted(words) == sorted(expected)


def test_pick_and_place_shows_values_and_best_actions():
    arm = pick_and_place(jerk=0.1)
    solution = value_iteration(arm, 0.9)
    best = np.zeros((arm.n_states, arm.n_actions), bool)
    best[:, arm.action_names.index("grip")] = True
    best[3, arm.action_names.index("slow left")] = True
    ax = plots.pick_and_place_policy(arm, solution, best).axes[0]
    np.testing.assert_allclose(ax.collections[0].get_array().ravel(), solution.V)
    words = [text.get_text() for text in ax.texts]
    assert words[0] == f"grip\n{solution.V[0]:.2f}" and words[3].split("\n")[0] == "← or grip"
    assert [label.get_text() for label in ax.get_yticklabels()] == ["empty", "holding"]


@pytest.mark.parametrize("penalty", [0.0, 0.1])
def test_arm_tells_when_it_is_there_and_how_much_voltage_it_took(penalty):
    fig = plots.arm(penalty)
    seconds, position = fig.axes[0].lines[1].get_data()
    volts = fig.axes[1].lines[0].get_ydata()
    assert position[0] == 0 and position[-1] == pytest.approx(1, abs=0.02) and seconds[-1] == pytest.approx(3)
    there = float(fig.axes[0].get_title().split("after ")[1].split(" s")[0])
    assert np.all(np.abs(position[seconds >= there - 1e-9] - 1) <= 0.02)
    assert abs(position[np.searchsorted(seconds, there - 0.051)] - 1) > 0.02
    assert fig.axes[0].get_title().endswith(f"at most {max(abs(volts)):.1f} V")
    assert fig.axes[1].get_xlabel() == "time (s)"


def test_office_tells_reward_and_cans_and_draws_the_way():
    office = can_robot()
    walk = rollout(office, uniform_policy(office), 40, rng=np.random.default_rng(1))
    walk = Trajectory(walk.states, walk.actions, np.arange(1.0, walk.rewards.size + 1), walk.terminated)
    for t in (0, 7, len(walk.rewards)):
        fig = plots.can_office(office, walk, t)
        words = "\n".join(texts(fig))
        assert f"reward so far: {sum(walk.rewards[:t]):+g}" in words and f"step {t}:" in words
        (way,) = fig.axes[0].lines
        robots = [office.state_names[s][0] for s in walk.states[: t + 1]]
        assert [int(x) for x in way.get_xdata()] == [robot % 5 for robot in robots]
        assert [4 - int(y) for y in way.get_ydata()] == [robot // 5 for robot in robots]


def test_cart_pole_leans_as_its_state_says_and_leaves_few_ghosts():
    states = np.zeros((200, 4))
    states[:, 0], states[-1, 2] = np.linspace(0, 1, 200), np.radians(10)
    fig = plots.cart_pole(states)
    pole = fig.axes[0].lines[-1]
    dx, dy = np.diff(pole.get_xdata())[0], np.diff(pole.get_ydata())[0]
    assert np.degrees(np.arctan2(dx, dy)) == pytest.approx(10) and pole.get_xdata()[0] == 1
    assert len(fig.axes[0].patches) <= 6  # no smear, however long the run


def test_strip_shows_the_chosen_steps():
    states = np.zeros((100, 4))
    states[:, 0] = np.linspace(-1, 1, 100)
    fig = plots.cart_pole_strip(states, [0, 50, 99])
    assert [ax.get_title() for ax in fig.axes] == ["step 0", "step 50", "step 99"]
    assert [ax.lines[-1].get_xdata()[0] for ax in fig.axes] == pytest.approx([states[k, 0] for k in (0, 50, 99)])


def test_push_game_says_whether_the_pole_has_fallen():
    assert "fell at step" in "".join(texts(plots.push_game("left", "left", "left", "left")))
    assert "up after 4 steps" in "".join(texts(plots.push_game("right")))


def test_two_returns_of_the_pole():
    episodic, continuing = plots.pole_returns(0.9).axes
    np.testing.assert_array_equal(*episodic.lines[0].get_data())
    once, again = (line.get_ydata() for line in continuing.lines)
    assert once[9] == pytest.approx(-(0.9**9))
    assert again[9] == pytest.approx(-sum(0.9 ** (10 * k - 1) for k in range(1, 100)))
    assert legend(continuing) == ["one failure", "every K steps"]


@pytest.mark.parametrize(
    "gamma, horizon", [(0.0, "1"), (0.5, "2"), (0.9, "10"), (0.99, "100, off the axis"), (1.0, "∞")]
)
def test_first_reward_counts_whole_and_the_kth_gamma_to_the_k_minus_1(gamma, horizon):
    ax = plots.discount_weights(gamma).axes[0]
    bars = {segment[0][0]: segment[1][1] for segment in ax.collections[0].get_segments()}
    weight = 1.0
    for k in range(1, 61):
        assert bars[k] == pytest.approx(weight)
        weight *= gamma
    assert ax.get_xlabel() == "k-th reward from now" and ax.get_ylabel() == "weight $γ^{k-1}$"
    assert f"1/(1 − γ) = {horizon}" in ax.get_title()
    assert [line.get_xdata()[0] for line in ax.lines] == ([1 / (1 - gamma)] if gamma <= 0.9 else [])


def test_partial_sums_have_their_closed_forms():
    ax = plots.partial_sums(0.5, 200).axes[0]
    ends = [line.get_ydata()[-1] for line in ax.lines]
    assert ends[:2] == pytest.approx([1 / (1 - 0.5), 1 / (1 - 0.5) ** 2]) and ends[2] == pytest.approx(1.2 / (1 - 0.6))
    assert legend(ax) == ["$R_k = 1$", "$R_k = k$", "$R_k = 1.2^k$"]


@pytest.mark.parametrize("gamma, word", [(0.3, "now"), (0.9, "later")])
def test_myopic_values_cross_where_the_choice_switches(gamma, word):
    switch = 0.1 ** (1 / 3)
    ax = plots.myopic_values(gamma, switch).axes[0]
    now, later = (line.get_ydata() for line in ax.lines[:2])
    x = ax.lines[0].get_xdata()
    assert np.all((later > now) == (x > switch)) and ax.get_title().endswith(word)


def test_absorbing_chain_has_its_rewards_and_a_loop_of_0():
    words = texts(plots.absorbing_chain((1, -2)))
    assert [w for w in words if w.startswith(("+", "-"))] == ["+1", "-2"] and {"end", "0", "$S_0$", "$S_1$"} <= set(
        words
    )


def test_monte_carlo_errors_are_medians_with_their_slopes():
    n = np.array([1.0, 4, 16])
    runs = np.array([[4.0, 2, 1], [6, 3, 1.5], [8, 4, 2]])
    ax = plots.monte_carlo_error(
        n, {"first visit": runs, "every visit": 2 * runs}, {"first visit": -0.5, "every visit": -0.4}
    ).axes[0]
    assert ax.lines[0].get_ydata().tolist() == [6, 3, 1.5] and ax.lines[1].get_ydata().tolist() == [12, 6, 3]
    assert legend(ax) == ["first visit: slope -0.5", "every visit: slope -0.4", "slope -1/2"]
    assert np.polyfit(np.log(n), np.log(ax.lines[2].get_ydata()), 1)[0] == pytest.approx(-0.5)
    assert ax.get_xscale() == ax.get_yscale() == "log"


def test_averages_run_around_the_exact_value():
    ax = plots.averages(np.arange(1, 4), [[1, 2, 3], [3, 2, 1]], 2.0).axes[0]
    assert [line.get_ydata()[-1] for line in ax.lines[:2]] == [3, 1] and legend(ax) == ["exact value 2.0000"]


def test_ranks_are_whole_numbers_on_both_axes():
    episodic = np.array([30.0, 10, 20, 40, 50, 60])
    ax = plots.return_ranking(episodic, {0.9: episodic[::-1]}, {0.9: "γ = 0.9"}).axes[0]
    x, y = ax.lines[0].get_data()
    assert x.tolist() == [3, 1, 2, 4, 5, 6] and y.tolist() == [6, 5, 4, 2, 1, 3]
    assert ax.get_xticks().tolist() == ax.get_yticks().tolist() == [1, 5]
    assert ax.lines[0].get_color() != PALETTE["grey"] and legend(ax) == ["γ = 0.9"]
