"""Statements of the record that its cells print or take for granted: asserted, so that the reverse fails."""

from pathlib import Path

import numpy as np
import pytest

from rlcore import envs
from rlcore.core.checks import check_policy
from rlcore.distributions import Categorical
from rlcore.mdp import uniform_policy
from rlcore.nn import MLP
from rlcore.planning import certainty_equivalent_control, dyna_q
from rlcore.studies.figure61 import PUBLISHED, average, bootstrap, scores
from rlcore.studies.tables import read

DATA = Path(__file__).parents[1] / "book" / "data"


@pytest.mark.parametrize(
    "pi, message",
    [
        ([[0.5, 0.4, 0.0], [0.0, 1.0, 0.0]], "row 0 is"),
        ([[1.2, -0.2, 0.0], [0.0, 1.0, 0.0]], "row 0 is"),
        ([[0.5, 0.5, 0.0], [0.3, 0.3, 0.3]], "row 1 is"),
        ([[0.5, 0.0, 0.5], [0.0, 1.0, 0.0]], "not legal"),
        ([[0.5, 0.5], [0.0, 1.0]], "got shape"),
    ],
)
def test_a_policy_is_a_distribution_over_legal_actions_in_each_state(pi, message):
    robot = envs.recycling_robot()
    fine = [[0.25, 0.75, 0.0], [0.0, 0.5, 0.5]]
    np.testing.assert_array_equal(check_policy(robot, fine), fine)
    with pytest.raises(ValueError, match=message):
        check_policy(robot, pi)
    np.testing.assert_allclose(uniform_policy(robot), [[1 / 2, 1 / 2, 0], [1 / 3, 1 / 3, 1 / 3]])


@pytest.mark.parametrize("world", [None, "a description", np.zeros((2, 3)), envs.dyna_maze().transition_probs()])
def test_without_a_world_nothing_is_learned(world):
    with pytest.raises(ValueError, match="^world: got .*, must be a FiniteMDP"):
        dyna_q(world, 0.95, 5, n_planning=0, alpha=0.1, epsilon=0.1, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="^world: got .*, must be a FiniteMDP to act in$"):
        certainty_equivalent_control(world, 0.95, 5, rng=np.random.default_rng(0))


def test_the_network_gives_preferences_and_their_softmax_the_probabilities():
    net = MLP([4, 8, 2], rng=np.random.default_rng(0))
    net.theta *= 3
    x = np.random.default_rng(1).normal(size=(50, 4)).astype(np.float32)
    outputs = net.forward(x)
    assert outputs.shape == (50, 2) and outputs.min() < 0 and np.abs(outputs.sum(axis=1) - 1).min() > 1e-3
    weights = np.exp(outputs.astype(float))
    expected = weights / weights.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(Categorical(outputs).probs, expected, rtol=1e-5)
    drawn = Categorical(np.repeat(outputs[:1], 20_000, axis=0)).sample(np.random.default_rng(2))
    assert set(drawn.tolist()) == {0, 1} and abs(drawn.mean() - expected[0, 1]) < 0.015  # four standard errors


CLIPS, TARGETS = slice(1, 4), slice(4, 7)  # 0.1, 0.2, 0.3; 0.003, 0.01, 0.03


@pytest.mark.parametrize("name, order, first, low, high", [
    ("figure61", [0, 2, 1], [0.70, 0.62, 0.67], 0.02, 0.15),
    ("figure61_tenth", [2, 1, 0], [0.49, 0.68, 0.77], 0.15, 0.35),
])  # fmt: skip
def test_order_of_the_clip_values_and_how_sure_it_is(name, order, first, low, high):
    runs = scores(read(DATA / f"{name}.csv"))
    means = average(runs)
    np.testing.assert_allclose(means[CLIPS], first, atol=0.006)
    assert np.argsort(-means[CLIPS]).tolist() == order
    np.testing.assert_allclose(means, [np.mean([task.mean() for task in setting]) for setting in runs])
    again = bootstrap(runs, 2000, rng=np.random.default_rng(0))
    assert low < (again[:, CLIPS].argmax(axis=1) == 1).mean() < high  # 0.2 the best: 7 % and 24 % of the draws
    ahead = (again[:, CLIPS].max(axis=1) > again[:, TARGETS].max(axis=1)).mean()
    assert 0.8 < ahead < 0.98 and means[CLIPS].max() > means[TARGETS].max()
    np.testing.assert_allclose(again.mean(axis=0), means, atol=0.02)
    assert PUBLISHED[CLIPS].tolist() == [0.76, 0.82, 0.70] and PUBLISHED[TARGETS].max() == 0.74
