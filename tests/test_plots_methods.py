"""Every figure that draws curves by name gives a method the colour that it has throughout the book."""

from types import SimpleNamespace

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest

from rlcore import plots
from rlcore.plots.style import CYCLE, METHODS, PALETTE, SMALL, WIDTH, method_of

RNG = np.random.default_rng(0)
RUNS = RNG.uniform(0.2, 0.9, (4, 30))
X = np.arange(1.0, 31)
CONTROL = ["Q-learning", "expected SARSA", "SARSA"]
ROLLOUT = {name: RUNS[0] for name in ("low", "mean", "high", "kl", "largest_kl")}
PAIR = ["TD(0)", "Monte Carlo"]


def of(names, values):
    return {name: values for name in names}


FIGURES = {
    "monte_carlo_error": (["every visit", "first visit"],
        lambda n: plots.monte_carlo_error(X, of(n, RUNS), of(n, -0.5))),
    "staircase": (["table", "ten groups"], lambda n: plots.staircase(X, of(n, RUNS))),
    "bands": (["table", "ten groups"], lambda n: plots.bands(of(n, (X, RUNS)), xlabel="x", ylabel="y")),
    "visits_and_errors": (PAIR, lambda n: plots.visits_and_errors(of(n, (X, X)))),
    "learning_curves": (["Q-learning", "Dyna-Q", "planning in the old model"],
        lambda n: plots.learning_curves(of(n, RUNS))),
    "decay": (["policy iteration", "value iteration"],
        lambda n: plots.decay(of(n, (X, 1 / X)), xlabel="x", ylabel="y")),
    "cart_pole_costs": (["REINFORCE, mean of 10 episodes"], lambda n: plots.cart_pole_costs([np.full(20, 9)], 50)),
    "rewards_over_time": (["Dyna-Q+", "Dyna-Q", "plan, model never corrected"],
        lambda n: plots.rewards_over_time(of(n, RUNS), 1000)),
    "error_curves": (["TD, 0.1", "MC, 0.1", "TD, 0.2"], lambda n: plots.error_curves(of(n, RUNS))),
    "estimates_against_truth": (["batch TD", "batch Monte Carlo"],
        lambda n: plots.estimates_against_truth(X[:5], of(n, X[:5]), "")),
    "cliff_paths": (CONTROL, lambda n: plots.cliff_paths(of(n, [36, 24, 25, 26]))),
    "cliff_paths in another order": (CONTROL[::-1], lambda n: plots.cliff_paths(of(n, [36, 24, 25, 26]))),
    "reward_curves": (CONTROL, lambda n: plots.reward_curves(of(n, -100 * RUNS))),
    "value_paths": (PAIR, lambda n: plots.value_paths(of(n, RUNS[:2].T), {"batch TD(0)": (0.5, 0.5)})),
    "sweep": (["TD", "MC"], lambda n: plots.sweep(of(n, (X[:4], RUNS)))),
    "activation": (PAIR, lambda n: plots.activation(of(n, (X, X)))),
    "gradient_norms": (PAIR, lambda n: plots.gradient_norms(X[:4], of(n, RUNS))),
    "approximation": (PAIR, lambda n: plots.approximation(X, X, of(n, X))),
    "errors_by_size": (PAIR, lambda n: plots.errors_by_size(X, of(n, X))),
    "training_curves": (["PPO", "TRPO"], lambda n: plots.training_curves(of(n, RUNS), ylabel="y")),
    "returns_by_episode": (["REINFORCE", "baseline", "actor-critic"],
        lambda n: plots.returns_by_episode(of(n, -90 * RUNS), -11.66)),
    "steps_balanced": (["REINFORCE with baseline", "REINFORCE"], lambda n: plots.steps_balanced(of(n, 200 * RUNS))),
    "progress": (["PPO", "TRPO", "REINFORCE"], lambda n: plots.progress(X, of(n, RUNS), "x", "y")),
    "kl_by_scale": (["TRPO", "PPO"], lambda n: plots.kl_by_scale(X[:3], of(n, X[:3]), 0.01)),
    "kl_and_beta": (["TRPO", "PPO"], lambda n: plots.kl_and_beta(of(n, SimpleNamespace(kl=X, beta=X)), 0.01)),
    "returns_and_kl": (["TRPO", "PPO"], lambda n: plots.returns_and_kl(of(n, ROLLOUT))),
}  # fmt: skip


@pytest.fixture(autouse=True)
def own_style():
    with mpl.rc_context():
        plots.use_style()
        yield
    plt.close("all")


@pytest.mark.parametrize("names, draw", FIGURES.values(), ids=FIGURES)
def test_a_curve_that_a_method_labels_has_its_colour(names, draw):
    seen = set()
    for ax in draw(names).axes:
        for line in ax.lines:
            if method := method_of(line.get_label()):
                assert mpl.colors.to_hex(line.get_color()).upper() == PALETTE[METHODS[method][0]].upper()
                seen.add(method)
    assert seen == {method_of(name) for name in names}


def test_trace_courses_have_the_colours_of_their_kinds():
    fig = plots.trace_courses({kind: X for kind in ("replacing", "accumulating", "dutch")}, [0])
    colours = [PALETTE[METHODS[ax.get_ylabel()][0]] for ax in fig.axes]
    assert [ax.lines[0].get_color() for ax in fig.axes] == colours


def test_the_table_names_colours_of_the_palette_that_readers_tell_apart():
    assert {PALETTE[colour] for colour, _ in METHODS.values()} <= set(CYCLE)


@pytest.mark.parametrize("names, draw", FIGURES.values(), ids=FIGURES)
def test_every_figure_has_one_width_and_no_small_type(names, draw):
    fig = draw(names)
    assert fig.get_figwidth() == WIDTH
    fig.draw_without_rendering()  # which makes the labels of the ticks
    assert min(text.get_fontsize() for text in fig.findobj(mpl.text.Text) if text.get_text().strip()) >= SMALL
