"""Figure 56: the table of its runs is whole and can be run again; the code that reads and draws it, and plays on."""

import importlib.util
import itertools
from pathlib import Path

import numpy as np
import pytest

from rlcore.envs import balance, steps_upright
from rlcore.plots import steps_balanced
from rlcore.studies.ch07 import WINDOW, runs, solved, train
from rlcore.studies.tables import read

ROOT = Path(__file__).parents[1]
ROWS = read(ROOT / "book" / "data" / "figure56.csv")
USUAL = (16, 0.01, 0.99)
GRID = list(itertools.product((4, 16, 64), (0.003, 0.01, 0.03), (0.9, 0.99, 1.0)))


def benchmark():
    spec = importlib.util.spec_from_file_location("figure56", ROOT / "benchmarks" / "figure56.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rng(seed=0):
    return np.random.default_rng(seed)


def test_the_table_has_every_run_once():
    expected = [(b, *USUAL, seed) for b in ("time", "none", "normalised") for seed in range(10)]
    expected += [("time", *setting, seed) for setting in GRID if setting != USUAL for seed in range(5)]
    assert [tuple(row[k] for k in ("baseline", "hidden", "lr", "gamma", "seed")) for row in ROWS] == expected
    assert len(ROWS) == 30 + 26 * 5


@pytest.mark.parametrize("row", ROWS, ids=lambda row: "{baseline} {hidden:g} {lr} {gamma} {seed:g}".format(**row))
def test_columns_of_a_run_agree(row):
    blocks = np.array(row["blocks"].split(), float)
    assert blocks.shape == (50,) and blocks.min() >= 8 and blocks.max() <= 200
    assert abs(20 * blocks.sum() - row["steps"]) <= 50  # each of the fifty is rounded to 0.1
    assert abs(blocks[-5:].mean() - row["last"]) <= 0.06
    hundreds = np.convolve(blocks, np.ones(5) / 5, "valid")  # episodes 1-100, 21-120, ...
    if row["solved"] is None:
        assert hundreds.max() < 195.06
    else:
        first = int(row["solved"]) - 1
        assert (hundreds[: -(-first // 20)] < 195.06).all()
        assert blocks[first // 20 : (first + 119) // 20].mean() >= 195 * 100 / 120 - 0.06


def test_a_setting_is_picked_from_the_table():
    ours, grid = runs(ROWS, baseline="none"), runs(ROWS, hidden=64, lr=0.03, gamma=1.0)
    assert [part.shape for part in ours] == [(10,), (10,), (10,), (10, 50)]
    assert [part.shape for part in grid] == [(5,), (5,), (5,), (5, 50)]
    rows = [row for row in ROWS if row["baseline"] == "none"]
    np.testing.assert_array_equal(ours.steps, [row["steps"] for row in rows])
    np.testing.assert_array_equal(ours.last, [row["last"] for row in rows])
    np.testing.assert_array_equal(np.isnan(ours.solved), [row["solved"] is None for row in rows])
    assert ours.blocks[3, 1] == 40.9 and ours.solved[3] == 260
    with pytest.raises(ValueError, match=r"rows: got none with .*'lr': 0\.02.*, must have a run"):
        runs(ROWS, lr=0.02)


# With five kernels of OpenBLAS and with narrow vector units the first 60 episodes are the same to the step. One or two
# of the eight runs part between episodes 60 and 100, by at most 12 in a block of 20.
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("setting", [("time", *USUAL), (None, *USUAL), ("normalised", *USUAL), ("time", 4, 0.03, 0.9)])
def test_a_run_begins_as_the_table_says(setting, seed, monkeypatch):
    module = benchmark()
    monkeypatch.setattr(module, "EPISODES", 100)
    again = module.run(*setting, rng(seed))
    baseline, hidden, lr, gamma = setting
    table = runs(ROWS, baseline=baseline or "none", hidden=hidden, lr=lr, gamma=gamma).blocks[seed]
    np.testing.assert_allclose(again["blocks"][:3], table[:3], rtol=0, atol=0.051)
    np.testing.assert_allclose(again["blocks"][3:], table[3:5], rtol=0, atol=40)
    assert again["steps"] == round(20 * again["blocks"].sum()) and np.isclose(again["last"], again["blocks"].mean())


def test_solved_is_the_first_window_of_100_that_averages_195():
    assert solved(np.full(WINDOW - 1, 200)) is None
    assert solved(np.full(WINDOW, 195)) == 1
    assert solved(np.append(np.full(WINDOW - 1, 195), 194)) is None
    assert solved(np.concatenate([[9], np.full(WINDOW, 195)])) == 2
    assert solved(np.concatenate([np.full(40, 9), np.full(150, 200)])) == 39  # two short ones are made up for


@pytest.mark.long
def test_training_stops_when_it_is_solved():
    run = train(500, stop=True, rng=rng(4))
    assert solved(run.lengths) == run.lengths.size - WINDOW + 1 < 300  # 38 where the table was made; its slowest 160
    assert run.lengths.max() == 200 and run.policy.forward(np.zeros((3, 4), np.float32)).shape == (3, 2)
    on = train(run.lengths.size + 1, rng=rng(4))
    np.testing.assert_array_equal(on.lengths[:-1], run.lengths)
    with pytest.raises(ValueError, match="^rng: got None"):
        train(1, rng=None)


def rule(x):
    return (np.asarray(x) @ [0.05, 0.1, 1.0, 0.5] > 0).astype(int)


def test_steps_upright_are_those_of_balance():
    for choose, n_steps in ((rule, 300), (lambda x: (np.asarray(x)[..., 2] > 0).astype(int), 200)):
        one_by_one = [balance(choose, n_steps, rng=rng(k)) for k in range(20)]
        starts = np.array([rng(k).uniform(-0.05, 0.05, size=4) for k in range(20)])
        assert steps_upright(choose, starts, n_steps).tolist() == one_by_one
    assert one_by_one != [200] * 20
    assert steps_upright(rule, np.array([[3.0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0]]), 7).tolist() == [0, 7, 0]
    assert steps_upright(rule, np.zeros((0, 4)), 7).shape == (0,)
    with pytest.raises(ValueError, match=r"^x: got shape \(4,\), must be \(n, 4\)"):
        steps_upright(rule, np.zeros(4), 7)
    with pytest.raises(ValueError, match="^n_steps: got 0"):
        steps_upright(rule, np.zeros((1, 4)), 0)


def test_the_figure_draws_mean_and_middle_half_over_seeds():
    blocks = np.array([[10.0, 20.0, 30.0], [20.0, 40.0, 60.0], [60.0, 60.0, 60.0]])
    ax = steps_balanced({"plain": blocks}, block=20).axes[0]
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), [20, 40, 60])
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [30, 40, 50])
    ends = ax.collections[0].get_paths()[0].vertices
    assert ends[:, 1].min() == 15 and ends[:, 1].max() == 60 and ends[:, 0].max() == 60
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["plain", "solved: 195"]


def test_lengths_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="^lengths: "):
        solved("x")
