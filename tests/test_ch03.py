"""Chapter 3: what its figures show, and that the family tree of figure 10 tells the truth."""

import importlib
import importlib.util

import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import plots
from rlcore.dp import value_iteration
from rlcore.envs import dyna_maze, gridworld, recycling_robot, two_state_mdp
from rlcore.mdp import uniform_policy
from rlcore.plots import ch03

LEAVES = [(name, function) for group in ch03.FAMILY.values() for name, function, _ in group]


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def exists(path):
    module, name = path.rsplit(".", 1)
    return importlib.util.find_spec(module) is not None and callable(
        getattr(importlib.import_module(module), name, None)
    )


@pytest.mark.parametrize("path", [path for _, path in LEAVES])
def test_leaf_of_the_family_tree_exists(path):
    assert exists(path)


def texts(fig):
    return [text.get_text() for ax in fig.axes for text in ax.texts]


@pytest.mark.parametrize("name, path", LEAVES)
def test_family_tree_names_the_function_of_the_chosen_leaf(name, path):
    words = texts(plots.family_tree(name))
    assert all(leaf in words for leaf, _ in LEAVES)
    assert words[-1].endswith(f": {path}")


def test_rows_of_the_heat_maps_are_those_of_the_model():
    robot = recycling_robot()
    fig = plots.model_and_policy(robot, uniform_policy(robot), 0)
    maps = [ax.collections[0].get_array() if ax.collections else None for ax in fig.axes]
    P = robot.transition_probs()
    for a in range(2):
        np.testing.assert_array_equal(maps[a], P[:, a])
    np.testing.assert_allclose(np.ma.filled(maps[3], 0), uniform_policy(robot).T)  # a row for each action
    chain = [(P[0, 0] + P[0, 1]) / 2, P[1].mean(axis=0)]  # two actions with a high battery, three with a low one
    np.testing.assert_allclose(maps[5], chain)
    assert maps[2].mask.tolist() == [[True, True], [False, False]]  # no recharging with a high battery


def test_q_table_draws_each_action_on_its_side():
    maze = dyna_maze()
    Q = np.zeros((54, 4))
    Q[0] = [0.25, 0.5, 0.75, 1.0]  # up, down, right, left of the top left cell
    bitmap = plots.q_table(Q, maze, (6, 9)).axes[0].images[0].get_array()
    for a, (y, x) in enumerate([(4, 12), (20, 12), (12, 20), (12, 4)]):
        np.testing.assert_allclose(bitmap[y, x], ch03.Q_CMAP(ch03.Q_NORM(Q[0, a]))[:3], atol=1e-9)
    wall = bitmap[24 + 12, 2 * 24 + 4]  # cell (1, 2)
    assert np.allclose(wall, 0.6)
    flashed = plots.q_table(Q, maze, (6, 9), flash=(0, 1)).axes[0].images[0].get_array()
    assert np.any(flashed[20, 12] != bitmap[20, 12]) and np.all(flashed[4, 12] == bitmap[4, 12])


def test_bars_show_the_probabilities_in_order_of_the_rewards():
    states, actions = np.array([[0, 1], [0, 0], [1, 1]]), np.zeros((3, 2), int)
    fig = plots.trajectory_bars(states, actions, np.array([0.3, 0.7, 0.0]), np.array([2.0, 1.0, 5.0]), 1.3)
    assert [bar.get_height() for bar in fig.axes[0].patches] == [0.7, 0.3]


def test_factors_multiply_to_the_probability():
    words = texts(plots.trajectory_factors(two_state_mdp(), np.full((2, 2), 0.5), [0, 1, 1], [1, 0, 0]))
    assert np.prod([float(word.split("\n")[1]) for word in words]) == pytest.approx(0.09)


def test_value_iteration_figure_marks_sweep_k_on_the_error():
    errors = 0.5 ** np.arange(30.0)
    V = value_iteration(gridworld(), 0.5, record=1).history[2]
    fig = plots.value_iteration_progress(V, (4, 4), errors, 0.5, 3)
    mark = fig.axes[1].lines[-1]
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (3, 0.125)
    np.testing.assert_array_equal(fig.axes[0].collections[0].get_array().reshape(16), V)


def test_prediction_error_is_the_root_mean_square():
    real = np.zeros((3, 2, 4))
    predicted = real.copy()
    predicted[2, :, 3] = np.radians([3.0, 4.0])
    fig = plots.prediction_errors(real, predicted, 2)
    assert fig.axes[1].lines[0].get_ydata()[1] == pytest.approx(np.sqrt(12.5))


def test_descent_title_tells_the_last_point():
    fig = plots.descent_path(lambda v: v**2 / 2, np.array([2.0, 1.0, 0.5]), 0.5)
    assert fig.axes[0].get_title().endswith("0.5000")
