"""Figures of chapters 1 to 4: what their axes show, against numbers computed otherwise, and which series is which."""

import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import envs, plots
from rlcore.bellman import solve_policy
from rlcore.mdp import Trajectory
from rlcore.mpc import simulate
from rlcore.plots import ch03
from rlcore.studies.ch04 import Update


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def words(ax):
    return [text.get_text() for text in ax.texts]


def series(ax):
    """{label: (x, y)} of the lines that have a label."""
    return {line.get_label(): line.get_xydata().T for line in ax.lines if not line.get_label().startswith("_")}


def colour(thing):
    return matplotlib.colors.to_hex(thing.get_color())


def near(found, expected):
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_loop_of_figure_1_tells_the_step_that_is_named():
    robot = envs.recycling_robot()
    path = Trajectory(np.array([0, 1, 1, 0]), np.array([0, 1, 2]), np.array([2.0, 1.0, -3.0]), False)
    (ax,) = plots.agent_environment_diagram(robot, path, 1).axes
    assert {"agent, in $S_1$ = low", "$A_1$ = wait", "$R_2$ = +1", "$S_2$ = low", "environment"} <= {*words(ax)}
    (ax,) = plots.agent_environment_diagram(robot, path, 2).axes
    assert {"$A_2$ = recharge", "$R_3$ = -3", "$S_3$ = high"} <= {*words(ax)}
    (ax,) = plots.agent_environment_diagram().axes
    place = {text.get_text(): text for text in ax.texts}
    assert {"$A_t$", "$R_{t+1}$", "$S_{t+1}$", "agent, in $S_t$"} <= {*place}
    # the action goes down on the right, what comes back is on the left
    assert place["$A_t$"].get_position()[0] > 5 > place["$R_{t+1}$"].get_position()[0]
    right, back, inner = ax.lines[:3]
    assert [line.get_color() for line in (right, back, inner)] == [
        place[name].get_color() for name in ("$A_t$", "$S_{t+1}$", "$R_{t+1}$")
    ]


def test_the_pole_of_figure_2_falls_when_it_is_pushed_to_one_side():
    pushes = ["right", "left", "right", "left"]
    verdict = words(plots.push_game(*pushes).axes[0])[-1]
    states = envs.push_pole([1, 0, 1, 0])
    assert verdict == f"up after 16 steps\nangle {np.degrees(states[-1, 2]):+.0f}°"
    fell = words(plots.push_game("right", "right", "right", "right").axes[0])[-1]
    assert fell.startswith("fell at step ") and "angle -" in fell  # pushed to the right, it falls to the left
    assert "angle +" in words(plots.push_game("left", "left", "left", "left").axes[0])[-1]


def test_returns_of_figure_2_against_the_failing_step():
    left, right = plots.pole_returns(0.9).axes
    K = np.arange(1, 101)
    near(left.lines[0].get_xydata(), np.column_stack([K, K]))
    shown = series(right)
    near(shown["one failure"], [K, -(0.9 ** (K - 1.0))])
    near(shown["every K steps"], [K, -(0.9 ** (K - 1.0)) / (1 - 0.9**K)])
    assert [left.get_xlabel(), right.get_xlabel(), left.get_ylabel()] == ["failing step K"] * 2 + ["return $G_0$"]
    assert left.get_title().startswith("episodic: +1") and right.get_title().startswith("continuing: -1")


@pytest.mark.parametrize("gamma, horizon", [(0.5, 2.0), (0.9, 10.0)])
def test_weights_of_rewards_fall_by_gamma_a_step(gamma, horizon):
    (ax,) = plots.discount_weights(gamma).axes
    bars = np.array(ax.collections[0].get_segments())
    near(bars[:, 1, 0], np.arange(1, 61))
    assert np.ptp(bars[:, 0, 1]) == 0
    near(bars[0, 1, 1], 1)
    near(bars[1:, 1, 1] / bars[:-1, 1, 1], gamma)
    near(ax.lines[0].get_xdata(), horizon)
    assert ax.get_title() == f"γ = {gamma:g}: horizon 1/(1 − γ) = {horizon:g}"
    assert ax.get_xlabel() == "k-th reward from now" and ax.get_ylabel() == "weight $γ^{k-1}$"


def test_symbols_of_the_backup_diagrams():
    for kind, root, leaf, marks in (("v_pi", "$s$", "$s'$", 0), ("q_star", "$s,a$", "$a'$", 2)):
        (ax,) = plots.backup_diagram(kind).axes
        found = words(ax)
        assert root in found and leaf in found and found.count("max") == marks
        assert (found.count("$\\pi$") > 0) == kind.endswith("pi")
        assert found.count(leaf) == 6


LEAN = np.array([[0.7, 0.3, 0.0], [0.2, 0.5, 0.3]])  # a policy of the robot that is not uniform


def lean_values(gamma=0.8):
    """Values of LEAN by hand: two linear equations; search, wait, recharge as in the text."""
    P = np.array([[0.7 * 0.9 + 0.3, 0.7 * 0.1], [0.2 * 0.4 + 0.3, 0.2 * 0.6 + 0.5]])
    r = np.array([0.7 * 2 + 0.3, 0.2 * (0.4 * -3 + 0.6 * 2) + 0.5])
    return np.linalg.solve(np.eye(2) - gamma * P, r)


def test_tree_of_figure_3_shows_values_and_their_weights():
    (ax,) = plots.value_diagram(envs.recycling_robot(), 0, LEAN, 0.8).axes
    high, low = lean_values()
    found = words(ax)
    search = 0.9 * (2 + 0.8 * high) + 0.1 * (2 + 0.8 * low)
    for text in (
        f"{high:.2f}",
        f"{search:.2f}",
        f"{1 + 0.8 * high:.2f}",
        "π 0.7",
        "π 0.3",
        "p 0.9\nr +2",
        "p 0.1\nr +2",
    ):
        assert text in found, text
    assert f"{low:.2f}" in found and "max" not in found and "high" in found and "search" in found


def test_tree_of_figure_4_starts_from_a_pair():
    (ax,) = plots.value_diagram(envs.recycling_robot(), (1, 0), LEAN, 0.8).axes
    high, low = lean_values()
    search = 0.4 * (-3 + 0.8 * high) + 0.6 * (2 + 0.8 * low)
    found = words(ax)
    assert "low, search" in found
    assert {f"{search:.2f}", "p 0.4\nr -3", "p 0.6\nr +2", "π 0.2", "π 0.5", f"{0.8 * high:.2f}"} <= {*found}


def test_tree_of_figure_6_takes_the_best():
    (ax,) = plots.value_diagram(envs.recycling_robot(), 0, LEAN, 0.9, take="max").axes
    found = words(ax)
    assert {"18.35", "17.51", "max"} <= {*found} and not any("π" in text for text in found)
    strong = [line for line in ax.lines if line.get_linewidth() > 4]
    assert len(strong) == 1 and strong[0].get_xdata()[1] < ax.texts[0].get_position()[0] + 20
    name = min(
        (text for text in ax.texts if text.get_text() in ("search", "wait")),
        key=lambda text: abs(text.get_position()[0] - strong[0].get_xdata()[1]),
    )
    assert name.get_text() == "search"


def test_golf_panels_show_whole_strokes_and_sand():
    values = np.array([-1.0, -2.0, -3.0, -np.inf, -2.5, -6.0])
    fig = plots.golf({"(a) one": values, "(b) two": values[::-1]}, (2, 3), hole=(0, 0), tee=(1, 2), sand=[(1, 0)])
    first, second = fig.axes[:2]
    assert (first.get_title(), second.get_title()) == ("(a) one", "(b) two")
    expected = np.array([[-1, -2, -3], [np.nan, -3, -6]])
    np.testing.assert_array_equal(first.images[0].get_array().filled(np.nan), expected)
    np.testing.assert_array_equal(second.images[0].get_array().filled(np.nan), expected.ravel()[::-1].reshape(2, 3))
    marks = {text.get_text(): line.get_xydata()[0].tolist() for text, line in zip(first.texts, first.lines)}
    assert marks == {"hole": [0, 0], "tee": [2, 1]}  # x is the column
    assert first.get_legend().get_texts()[0].get_text() == "sand: −∞"
    assert fig.axes[2].get_ylabel() == "value: strokes left, negative"


def test_best_clubs_are_those_of_higher_value():
    putter, driver = np.array([-1.0, -3.0, -2.0, -5.0]), np.array([-2.0, -2.0, -2.0, -4.0])
    fig = plots.best_clubs(putter, driver, (2, 2), hole=(0, 0), tee=(1, 1))
    (ax,) = fig.axes
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    keys = [patch.get_facecolor() for patch in ax.get_legend().get_patches()]
    drawn = ax.images[0].cmap(ax.images[0].norm(ax.images[0].get_array())).reshape(-1, 4)
    got = [names[[np.allclose(cell, key) for key in keys].index(True)] for cell in drawn]
    assert got == ["putter", "driver", "either", "driver"]
    assert "-4.00" in ax.get_title()  # at the tee


def test_loop_of_figure_7_is_in_its_order():
    (ax,) = plots.loop_diagram().axes
    place = {text.get_text(): text.get_position() for text in ax.texts}
    (act, store, fit, plan) = (
        place[name] for name in ("act", "store (s, a, r, s')", "fit the model", "plan in the model")
    )
    assert act[0] < store[0] and act[1] == store[1] and fit[0] == store[0] and fit[1] < store[1]
    assert plan == (act[0], fit[1])


def test_prediction_errors_of_figure_7():
    rng = np.random.default_rng(0)
    real, predicted = rng.normal(size=(2, 6, 5, 4))
    left, right = plots.prediction_errors(real, predicted, 2).axes
    dots = left.lines[1].get_xydata()
    near(dots[:, 0], real[2, :, 3] * 180 / np.pi)
    near(dots[:, 1], predicted[2, :, 3] * 180 / np.pi)
    assert (left.get_xlabel(), left.get_ylabel(), left.get_title()) == (
        "real speed (degrees/s)",
        "predicted",
        "2 steps ahead",
    )
    errors = [np.linalg.norm(predicted[k, :, 3] - real[k, :, 3]) / np.sqrt(5) * 180 / np.pi for k in range(1, 6)]
    near(right.lines[0].get_xydata().T, [range(1, 6), errors])
    near(right.lines[1].get_xydata(), [[2, errors[1]]])
    assert right.get_xlabel() == "steps ahead k" and right.get_ylabel() == "error (degrees/s)"


def test_simulation_of_a_model_applies_it_step_by_step():
    def step(states, actions):
        return 0.5 * states + np.asarray(actions)[:, None]

    states = simulate(step, np.array([[1.0, 2.0]]), np.array([[1], [0], [2]]))
    near(states[:, 0], [[1, 2], [1.5, 2], [0.75, 1], [2.375, 2.5]])


def test_factors_of_figure_8_are_named_and_in_order():
    lean = np.array([[0.8, 0.2], [0.4, 0.6]])
    world = envs.two_state_mdp()
    found = words(plots.trajectory_factors(world, lean, [0, 1, 1], [1, 0, 1]).axes[0])
    names, numbers = zip(*(word.split("\n") for word in found))
    assert names[:3] == ("$p(s_1)$", r"$\pi(a_1|s_1)$", "$p(s_2|s_1,a_1)$") and names[5] == r"$\pi(a_3|s_3)$"
    chances = [
        world.prob[s, a][world.next_state[s, a] == z].sum() for s, a, z in ((0, 1, 1), (1, 0, 1))
    ]  # summed over outcomes, not over the transition matrix
    near([float(n) for n in numbers], [1, 0.2, chances[0], 0.4, chances[1], 0.6])


def test_bars_of_figure_8_stand_over_their_sums_of_rewards():
    states, actions = np.array([[0, 1], [0, 0], [1, 1], [0, 1]]), np.zeros((4, 2), int)
    fig = plots.trajectory_bars(states, actions, np.array([0.3, 0.5, 0.0, 0.2]), np.array([2.0, 1.0, 5.0, -1.0]), 0.9)
    top, bottom = fig.axes
    assert [bar.get_height() for bar in top.patches] == [0.2, 0.5, 0.3]
    near(bottom.lines[0].get_ydata(), [-1, 1, 2])
    near(bottom.lines[1].get_ydata(), 0.9)
    assert top.get_ylabel() == "probability" and bottom.get_ylabel() == "reward sum"
    assert bottom.get_xlabel() == "the 3 trajectories; expected sum 0.900 (dashed)"


def test_heat_maps_of_figure_9_with_a_policy_that_is_not_uniform():
    fig = plots.model_and_policy(envs.recycling_robot(), LEAN, 1)
    maps = [ax.collections[0].get_array() if ax.collections else None for ax in fig.axes]
    near(maps[0], [[0.9, 0.1], [0.4, 0.6]])
    near(np.ma.filled(maps[3], 0), LEAN.T)
    near(maps[5], [[0.93, 0.07], [0.38, 0.62]])
    assert [ax.get_title() for ax in fig.axes[:4]] == ["search", "wait", "recharge", "policy π"]
    assert [fig.axes[a].title.get_color() == ch03.RED for a in range(3)] == [False, True, False]
    assert fig.axes[0].get_ylabel() == "state" and fig.axes[0].get_xlabel() == fig.axes[5].get_xlabel() == "next state"
    assert [tick.get_text() for tick in fig.axes[0].get_yticklabels()] == ["high", "low"]


def test_family_tree_groups_its_methods():
    (ax,) = plots.family_tree("SARSA").axes
    place = {text.get_text(): text.get_position()[1] for text in ax.texts}
    for group, leaves in ch03.FAMILY.items():
        heights = [place[name] for name, _, _ in leaves]
        assert min(heights) <= place[group] <= max(heights)
    assert words(ax)[-1] == "chapter 4: rlcore.td.sarsa"


def test_descent_panels_of_figure_11():
    def C(v):
        return (v - 1) ** 2

    paths = {
        0.1: np.array([2.5, 2.2, 1.96]),
        0.9: np.array([2.5, -0.2, 1.96]),
        0.5: np.array([2.5, 1.0]),
        1.5: np.array([2, -1e4]),
    }
    axes = plots.descent_panels(C, paths).axes
    for ax, (epsilon, path) in zip(axes, paths.items()):
        shown = path[np.abs(path) <= 3.5]
        near(ax.lines[1].get_xydata(), np.column_stack([shown, (shown - 1) ** 2]))
        near(ax.lines[2].get_xydata(), [[path[0], (path[0] - 1) ** 2]])
        last = "beyond 1000" if epsilon == 1.5 else f"{path[-1]:.4f}"
        assert ax.get_title() == rf"$\epsilon$ = {epsilon:g}: $v_{{{path.size - 1}}}$ = {last}"
    curve = axes[0].lines[0].get_xydata()
    near(curve[:, 1], (curve[:, 0] - 1) ** 2)
    assert axes[2].get_xlabel() == "v" and axes[0].get_ylabel() == "C(v)"


def test_tables_of_figure_12_are_those_of_their_episodes():
    maze, history = envs.dyna_maze(), np.zeros((9, 54, 4))
    history[1:, 0, 0] = np.geomspace(1e-3, 1, 8)
    fig = plots.q_tables(history, [0, 1, 4, 8], maze, (6, 9))
    titles = ["after 0 episodes", "after 1 episode", "after 4 episodes", "after 8 episodes"]
    for ax, k, title in zip(fig.axes, (0, 1, 4, 8), titles):
        assert ax.get_title() == title
        expected = [1, 1, 1] if k == 0 else ch03.Q_CMAP(ch03.Q_NORM(history[k, 0, 0]))[:3]
        near(ax.images[0].get_array()[4, 12], expected)  # the upper triangle of the first cell
        assert {text.get_text(): text.get_position() for text in ax.texts} == {"S": (0, 2), "G": (8, 0)}
    assert fig.axes[4].get_ylabel() == "Q(s, a); white: 0"


def test_a_changed_entry_of_figure_12_is_told_in_words():
    Q = np.zeros((54, 4))
    Q[12, 3] = 0.25
    (ax,) = plots.q_table(Q, envs.dyna_maze(), (6, 9), flash=(12, 3), old=0.125).axes
    assert ax.get_xlabel() == "Q(row 2, column 4; left) = 0.125 → 0.25"
    near(ax.images[0].get_array()[24 + 12, 3 * 24 + 4], matplotlib.colors.to_rgb(ch03.RED))


def test_bound_and_error_of_figure_13():
    errors = 3 * 0.8 ** np.arange(40.0) * np.linspace(1, 0.5, 40)
    left, right = plots.value_iteration_progress(-np.arange(16) / 8, (4, 4), errors, 0.8, 5).axes
    shown = series(right)
    near(shown[r"bound $\gamma^k$"], [range(40), 3 * 0.8 ** np.arange(40)])
    near(shown["error"], [range(40), errors])
    near(right.lines[-1].get_xydata(), [[5, errors[5]]])
    assert words(right) == [f"{errors[5]:.2g}"] and right.get_yscale() == "log"
    assert left.get_title() == "grid: $V_{5}$, $\\gamma$ = 0.8" and right.get_title() == "random process"
    assert (right.get_xlabel(), right.get_ylabel()) == ("sweeps k", "largest error")
    near(left.collections[0].get_array().ravel(), -np.arange(16) / 8)


def journey():
    elapsed, to_go = np.array([0, 5, 20, 30, 40, 43.0]), np.array([30, 35, 15, 10, 3, 0.0])
    return elapsed, elapsed + to_go


@pytest.mark.parametrize("method", ["Monte Carlo", "TD"])
def test_arrows_of_figures_14_and_15_go_to_their_targets(method):
    elapsed, predicted = journey()
    targets = np.full(5, 43.0) if method == "Monte Carlo" else predicted[1:]
    (ax,) = plots.predictions(elapsed, predicted, targets, 0.5, method).axes
    shown = series(ax)
    near(shown["prediction before"], [elapsed, [30, 40, 35, 40, 43, 43]])
    after = [36.5, 41.5, 39, 41.5, 43] if method == "Monte Carlo" else [35, 37.5, 37.5, 41.5, 43]
    near(shown["after the update"], [elapsed[:-1], after])
    near(shown["what it took: 43 minutes"][1], 43)
    moved = [i for i in range(5) if targets[i] != predicted[i]]
    near([note.xy for note in ax.texts], [(elapsed[i], after[i]) for i in moved])
    near([note.xyann for note in ax.texts], [(elapsed[i], predicted[i]) for i in moved])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("minutes since leaving", "predicted total, minutes")
    assert ax.get_title() == method


def test_walk_of_figure_16():
    (ax,) = plots.walk_graph(5, 0.3, [3, 2, 3, 4, 5, 6]).axes
    found = {text.get_text(): text.get_position() for text in ax.texts if text.get_text()}
    assert [found[name][0] for name in "ABCDE"] == [1, 2, 3, 4, 5]
    assert "right with probability 0.3, left 0.7" in found
    assert found["+1"][0] == 6 and found["0"][0] == 0
    walk = ax.lines[-1].get_xydata()
    near(walk[:, 0], [3, 2, 3, 4, 5, 6])
    near(np.diff(walk[:, 1]), np.diff(walk[:, 1])[0])
    assert walk[1, 1] < walk[0, 1] and found["t = 5"][0] == 6 and abs(found["t = 0"][0] - 3) < 0.5


def test_error_curves_of_figures_17_and_18():
    rng = np.random.default_rng(1)
    curves = {"TD, 0.1": rng.random((6, 9)), "MC, 0.03": rng.random((6, 9)) + 1}
    (ax,) = plots.error_curves(curves).axes
    shown = series(ax)
    for k, (label, values) in enumerate(curves.items()):
        mean = sum(values) / 6
        near(shown[label], [range(9), mean])
        error = np.sqrt(sum((values - mean) ** 2) / 6) / 6**0.5
        edge = ax.collections[k].get_paths()[0].vertices
        near(
            [edge[edge[:, 0] == 4][:, 1].min(), edge[edge[:, 0] == 4][:, 1].max()],
            [mean[4] - error[4], mean[4] + error[4]],
        )
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("episodes", "RMS error over the states")
    legend = dict(zip((t.get_text() for t in ax.get_legend().get_texts()), ax.get_legend().get_lines()))
    assert colour(legend["TD, 0.1"]) != colour(legend["MC, 0.03"])


def test_estimates_of_figure_18_stand_beside_the_truth():
    truth, estimates = np.arange(1, 6) / 6, {"batch MC": np.linspace(0, 1, 5), "batch TD": np.linspace(0.2, 0.9, 5)}
    (ax,) = plots.estimates_against_truth(truth, estimates, "after 10 episodes").axes
    shown = series(ax)
    near(shown["true"], [range(1, 6), truth])
    for label, values in estimates.items():
        near(shown[label], [range(1, 6), values])
    assert [tick.get_text() for tick in ax.get_xticklabels()] == list("ABCDE")
    assert ax.get_ylabel() == "value" and ax.get_title() == "after 10 episodes"


def test_model_of_figure_19():
    (ax,) = plots.predictor_graph(1.0, 0.75, {"Monte Carlo": (0.0, 0.75), "TD(0)": (0.5, 0.7)}).axes
    found = words(ax)
    assert {"p = 1\nr = 0", "p = 0.75, r = 1", "p = 0.25, r = 0"} <= {*found}
    assert {"Monte Carlo:  V(A) = 0,  V(B) = 0.75", "TD(0):  V(A) = 0.5,  V(B) = 0.7"} <= {*found}
    height = {text.get_text(): text.get_position()[1] for text in ax.texts}
    assert height["p = 0.75, r = 1"] > height["p = 0.25, r = 0"]


def test_a_step_on_the_cliff_is_drawn_and_computed():
    update = Update(s=24, a=2, s_next=25, old=-2.0, new=-2.5)
    (ax,) = plots.cliff_step(update, ("up", "down", "right", "left"), "step 7", target="Q[s', a']", alpha=0.25).axes
    place = {text.get_text(): text.get_position() for text in ax.texts}
    assert (place["s"], place["s'"]) == ((0, 1), (1, 1))
    assert "a = right;  target = R + Q[s', a'] = −4.00" in place
    assert "−2.00 + 0.25 · (−4.00 +2.00) = −2.50" in place
    assert ax.get_title() == "step 7" and (place["S"][0], place["G"][0]) == (-0.8, 11.8)


def test_paths_of_figure_22_are_those_of_their_methods():
    paths = {"SARSA": [36, 24, 25, 26], "Q-learning": [36, 24, 12]}
    (ax,) = plots.cliff_paths(paths, "greedy").axes
    shown = series(ax)
    assert set(shown) == {"SARSA: 3 steps", "Q-learning: 2 steps"} and ax.get_title() == "greedy"
    assert np.abs(shown["SARSA: 3 steps"] - [[0, 0, 1, 2], [0, 1, 1, 1]]).max() < 0.1
    assert np.abs(shown["Q-learning: 2 steps"] - [[0, 0, 0], [0, 1, 2]]).max() < 0.1
    assert {colour(line) for line in ax.lines if line.get_label() == "SARSA: 3 steps"} == {
        matplotlib.colors.to_hex(plots.style.styles(["SARSA"])["SARSA"]["color"])
    }


def test_rewards_of_figure_22_are_means_of_ten_episodes():
    rng = np.random.default_rng(2)
    returns = {"SARSA": rng.normal(-30, 5, (4, 60)), "Q-learning": rng.normal(-50, 5, (4, 60))}
    (ax,) = plots.reward_curves(returns, window=10).axes
    shown = series(ax)
    for label, values in returns.items():
        x, y = shown[label]
        near(x, np.arange(10, 61, 5))
        near(y, [values[:, end - 10 : end].mean() for end in range(10, 61, 5)])
    assert ax.get_xlabel() == "episode" and "mean of 10 episodes" in ax.get_ylabel()
    assert ax.get_ylim()[1] == 0


def test_paths_of_estimates_in_the_plane():
    runs = {"Monte Carlo": np.array([[0.5, 0.5], [0.4, 0.6]]), "TD(0)": np.array([[0.5, 0.5], [0.6, 0.7], [0.7, 0.8]])}
    (ax,) = plots.value_paths(runs, {"MC answer": (0.0, 0.75), "TD answer": (0.75, 0.7)}).axes
    shown = series(ax)
    for label, path in runs.items():
        near(shown[label], path.T)
    near([line.get_xydata()[0] for line in ax.lines[2:]], [[0, 0.75], [0.75, 0.7]])
    assert [(note.get_text(), note.xy) for note in ax.texts] == [("MC answer", (0.0, 0.75)), ("TD answer", (0.75, 0.7))]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("V(A)", "V(B)")


def test_values_of_the_tree_are_those_of_the_policy():
    near(solve_policy(envs.recycling_robot(), LEAN, 0.8), lean_values())
