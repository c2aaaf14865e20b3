"""Figure 61: reading and scoring the runs, and the comparison with the published column."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import spearmanr

from rlcore.ppo import PPOConfig
from rlcore.studies.figure61 import (
    PUBLISHED,
    RANDOM,
    SETTINGS,
    TASKS,
    average,
    bootstrap,
    by_seed,
    comparison,
    rank_correlation,
    scores,
)
from rlcore.studies.tables import read
from rlcore.sweep import Record

ROOT = Path(__file__).parents[1]
NAMES = list(SETTINGS)
RNG = np.random.default_rng(0)
DATA = {100_000: ROOT / "book" / "data" / "figure61_tenth.csv", 1_000_000: ROOT / "book" / "data" / "figure61.csv"}


def row(task, setting, seed, score):
    return {"task": task, "setting": setting, "seed": float(seed), "score": score}


def rows_of(tasks=TASKS, seeds=3, floor=-100.0, top=900.0):
    """Setting i, seed k of a task: i / 10 of the way from floor to top, less k / 10."""
    rows = [row(task, RANDOM, k, floor + 10 * (k - 1)) for task in tasks for k in range(seeds)]
    for task in tasks:
        rows += [
            row(task, name, k, floor + (top - floor) * (i - k) / 10)
            for i, name in enumerate(NAMES)
            for k in range(seeds)
        ]
    return rows


@pytest.mark.parametrize("n_steps", DATA)
def test_every_run_is_in_the_table_once_and_as_long_as_it_should_be(n_steps):
    rows = read(DATA[n_steps])
    wanted = [(task, name, seed) for task in TASKS for name in (RANDOM, *SETTINGS) for seed in range(3)]
    assert [(row["task"], row["setting"], row["seed"]) for row in rows] == wanted
    for row in rows:
        if row["setting"] == RANDOM:
            assert row["episodes"] == 100
        else:
            assert n_steps <= row["steps"] < n_steps + 20_000 and 0 < row["kl"] <= row["largest_kl"]
            assert np.isfinite([row[f"return_{i}"] or 0.0 for i in range(1, 11)]).all()
        assert np.isfinite(row["score"])


def test_the_two_tables_are_of_the_same_runs():
    """The first tenth of a long run: its mean return is that of the short run's tenths, which differ in length."""
    short, long = (read(path) for path in DATA.values())
    for a, b in zip(short, long):
        if a["setting"] == RANDOM:
            assert a["score"] == b["score"]
        else:
            tenths = [a[f"return_{i}"] for i in range(1, 11) if a[f"return_{i}"] is not None]
            assert min(tenths) <= b["return_1"] <= max(tenths) and a["episodes"] < b["episodes"]


def test_the_settings_are_the_published_ones():
    assert PUBLISHED.shape == (len(NAMES),) == (11,)
    assert NAMES[PUBLISHED.argmax()] == "clip 0.2" and PUBLISHED.max() == 0.82
    assert NAMES[PUBLISHED.argmin()] == "none" and PUBLISHED.min() == -0.39
    for name, setting in SETTINGS.items():
        config = PPOConfig(**setting)
        kind, _, number = name.partition(" ")
        value = {"none": None, "clip": config.clip, "adaptive": config.d_target, "fixed": config.beta}[kind]
        assert value is None or value == float(number)
        assert config.objective.endswith(kind) and config.lr == 3e-4


def test_scores_put_the_random_policy_at_0_and_the_best_run_at_1():
    table = scores(rows_of())
    assert table.shape == (11, 7, 3)
    expected = (np.arange(11)[:, None, None] - np.arange(3)) / 10 + np.zeros((11, 7, 3))
    np.testing.assert_allclose(table, expected, atol=1e-12)


def test_scores_do_not_depend_on_scale_and_shift_of_a_task():
    rows = rows_of(tasks=TASKS[:1]) + rows_of(tasks=TASKS[1:2], floor=5.0, top=6.0)
    for r in rows:
        if r["setting"] == RANDOM:
            r["score"] = -100.0 if r["task"] == TASKS[0] else 5.0
    table = scores(rows)
    np.testing.assert_allclose(table[:, 0], table[:, 1], atol=1e-12)
    assert np.isnan(table[:, 2:]).all()


def test_missing_runs_are_missing():
    rows = rows_of()
    lacking = [r for r in rows if not (r["task"] == "Hopper" and r["setting"] == "clip 0.3" and r["seed"] == 1)]
    table = scores(lacking)
    assert np.argwhere(np.isnan(table)).tolist() == [[NAMES.index("clip 0.3"), 1, 1]]
    assert np.isfinite(average(table)).all()
    seeds = by_seed(table)
    assert np.argwhere(np.isnan(seeds)).tolist() == [[NAMES.index("clip 0.3"), 1]]
    # a task that lacks a whole setting does not count for any setting: else they were compared on different tasks
    lacking = [r for r in rows if not (r["task"] == "Hopper" and r["setting"] == "clip 0.3")]
    lacking = [r | {"score": 1e6} if r["task"] == "Hopper" and r["setting"] == "none" else r for r in lacking]
    np.testing.assert_allclose(average(scores(lacking)), (np.arange(11) - 1) / 10, atol=1e-12)
    no_floor = [r for r in rows if not (r["task"] == "Hopper" and r["setting"] == RANDOM)]
    assert np.isnan(scores(no_floor)[:, 1]).all() and np.isfinite(scores(no_floor)[:, 0]).all()
    no_score = [r | {"score": None} if r["seed"] == 2 else r for r in rows]
    assert np.isnan(scores(no_score)[..., 2]).all() and np.isfinite(scores(no_score)[..., :2]).all()


def test_nothing_gives_nothing():
    table = scores([])
    assert table.shape == (11, 7, 1) and np.isnan(average(table)).all() and np.isnan(by_seed(table)).all()


def test_averages_are_over_seeds_then_tasks():
    table = np.random.default_rng(0).normal(size=(11, 7, 3))
    np.testing.assert_allclose(average(table), table.mean(axis=(1, 2)))
    np.testing.assert_allclose(by_seed(table), table.mean(axis=1))
    table[:, 0, 1:] = np.nan  # one run in the first task weighs as much as three elsewhere
    expected = (table[:, 0, 0] + table[:, 1:].mean(axis=2).sum(axis=1)) / 7
    np.testing.assert_allclose(average(table), expected)


def test_the_comparison_has_both_columns_and_both_ranks():
    table = scores(rows_of())
    table[4, 2, 0] = np.nan
    lines = comparison(table)
    assert [line.setting for line in lines] == NAMES
    assert [line.runs for line in lines] == [21, 21, 21, 21, 20, 21, 21, 21, 21, 21, 21]
    assert [line.rank_ours for line in lines] == list(range(11, 0, -1))
    best, worst = lines[NAMES.index("clip 0.2")], lines[0]
    assert (best.published, best.rank_published, worst.published, worst.rank_published) == (0.82, 1, -0.39, 11)
    assert lines[NAMES.index("fixed 1")].rank_published == lines[NAMES.index("adaptive 0.03")].rank_published == 5.5
    last = lines[-1]  # seed 0 scores 1, seed 1 scores 0.9, seed 2 scores 0.8
    np.testing.assert_allclose([last.ours, last.low, last.high], [0.9, 0.8, 1.0])
    np.testing.assert_allclose([lines[4].low, lines[4].high], [0.2, 0.3])  # its seed 0 lacks a run
    assert all(
        np.isnan([line.ours, line.low, line.rank_ours]).all() and line.runs == 0 for line in comparison(scores([]))
    )


def test_rank_correlation_is_spearmans():
    x = [1.0, 2.0, 3.0, 4.0]
    assert rank_correlation(x, [10, 20, 30, 1000]) == pytest.approx(1)
    assert rank_correlation(x, [4, 3, 2, 1]) == pytest.approx(-1)
    assert rank_correlation(x, [1, 3, 2, 4]) == pytest.approx(0.8)  # 1 - 6 * 2 / (4 * 15)
    rng = np.random.default_rng(0)
    for _ in range(20):  # ties as scipy counts them; the published column has two
        many = rng.integers(5, size=(3, 11)).astype(float)
        expected = [spearmanr(values, PUBLISHED)[0] for values in many]
        np.testing.assert_allclose(rank_correlation(many, PUBLISHED), expected)


def test_bootstrap_draws_tasks_and_seeds():
    table = np.zeros((11, 7, 3)) + np.arange(11)[:, None, None]
    drawn = bootstrap(table, 50, rng=np.random.default_rng(0))
    assert drawn.shape == (50, 11)
    np.testing.assert_allclose(drawn, np.arange(11) + np.zeros((50, 1)))  # nothing differs: nothing scatters
    noise = np.random.default_rng(1).normal(size=(11, 7, 3))
    tasks_only = noise[:, :, :1] + np.zeros(3)
    drawn = bootstrap(tasks_only, 4000, rng=np.random.default_rng(2))
    # deviation of a mean of 7 drawn tasks, of 3 drawn seeds: worst relative errors of seeds 0-9 are 0.025 and 0.033,
    # 1 where nothing is drawn
    np.testing.assert_allclose(drawn.std(axis=0), tasks_only[:, :, 0].std(axis=1) / np.sqrt(7), rtol=0.06)
    one_task = noise[:, :1]
    drawn = bootstrap(one_task, 4000, rng=np.random.default_rng(2))
    np.testing.assert_allclose(drawn.std(axis=0), one_task[:, 0].std(axis=1) / np.sqrt(3), rtol=0.06)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(11)).max() < 0.1  # seeds of different settings are not drawn together


def test_bootstrap_leaves_missing_runs_out():
    table = np.random.default_rng(0).normal(size=(11, 7, 3))
    table[2, 4, 0] = table[5, 1, 2] = np.nan
    drawn = bootstrap(table, 2000, rng=np.random.default_rng(1))
    assert np.isfinite(drawn).all()
    np.testing.assert_allclose(drawn.mean(axis=0), average(table), atol=0.03)  # worst of seeds 0-9: 0.014
    table[3, 6] = np.nan
    drawn = bootstrap(table, 2000, rng=np.random.default_rng(1))
    np.testing.assert_allclose(drawn.mean(axis=0), average(table), atol=0.05)


def test_read_gives_numbers_words_and_none(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("# where from\n# when, and why\ntask,setting,seed,score\nHopper,clip 0.2,1,2.5e3\nHopper,none,0,\n")
    assert read(path) == [
        {"task": "Hopper", "setting": "clip 0.2", "seed": 1.0, "score": 2500.0},
        {"task": "Hopper", "setting": "none", "seed": 0.0, "score": None},
    ]
    assert read(tmp_path / "nothing.csv") == []


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: scores([row("Ant", "none", 0, 1.0)]), "task: got 'Ant', must be one of HalfCheetah"),
        (lambda: scores([row("Hopper", "clip 0.4", 0, 1.0)]), "setting: got 'clip 0.4', must be one of random, none"),
        (lambda: rank_correlation([1.0, 2.0], [1.0, 2.0, 3.0]), r"x: got shape \(2,\) with y \(3,\), must be"),
        (lambda: rank_correlation(1.0, 2.0), r"x: got shape \(\), must be \(\.\.\., n\)"),
        (lambda: rank_correlation([1.0], [2.0]), "n at least 2"),
        (lambda: rank_correlation([[1.0, 2.0], [3.0, 3.0]], [1.0, 2.0]), "x: got values that are all equal, must"),
        (lambda: rank_correlation([1.0, 2.0], [3.0, 3.0]), "y: got values that are all equal, must"),
        (lambda: rank_correlation([1.0, np.nan], [1.0, 2.0]), "x: contains nan, must be finite"),
        (lambda: scores([dict(task="Hopper", setting="none", score=1.0)]), "seed: got None, must be"),
        (lambda: scores([row("Hopper", "none", 0, np.inf)]), "score: got inf, must be"),
        (lambda: bootstrap(scores([]), 10, rng=np.random.default_rng(0)), "table: got no task"),
        (lambda: bootstrap(np.zeros((11, 7, 3)), 0, rng=np.random.default_rng(0)), "n: got 0, must be"),
        (lambda: bootstrap(np.zeros((11, 7, 3)), 10, rng=0), "rng: got 0, must be"),
    ],
)
def test_bad_input_is_refused_by_name(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.long
def test_the_smoke_tier_runs(tmp_path):
    """Three settings and random actions on two tasks, through processes and files; the same call repeats nothing."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install -e '.[deep]'")
    for folder in ("benchmarks", "rlcore"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    script = tmp_path / "figure61.py"  # its runs are kept beside it
    script.write_text((ROOT / "benchmarks" / "figure61.py").read_text().replace("parents[1]", "parents[0]"))
    command = [sys.executable, str(script), "smoke"]
    first, second = (subprocess.run(command, cwd=tmp_path, capture_output=True, text=True) for _ in range(2))
    assert first.returncode == 0, first.stderr[-2000:]
    table = [line.split() for line in first.stdout.splitlines()[1:]]
    table = {" ".join(words[:-4]) for words in table if words}
    assert table == {"none", "clip 0.2", "adaptive 0.01"}
    assert len(list((tmp_path / "_build" / "figure61").iterdir())) == 8
    assert second.stdout == first.stdout and "1 of" not in second.stderr


@pytest.fixture
def script():
    spec = importlib.util.spec_from_file_location("script_of_figure_61", ROOT / "benchmarks" / "figure61.py")
    spec.loader.exec_module(module := importlib.util.module_from_spec(spec))
    return module


@pytest.mark.long
def test_a_tenth_of_a_long_run_is_a_short_run(script):
    """What a run has done by then does not depend on how long it goes on; 2,500 is no whole number of rollouts."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install -e '.[deep]'")
    name = "InvertedPendulum", "adaptive 0.01"
    long, short = (script.run(*name, n, np.random.default_rng(1)) for n in (25_000, 2_500))
    assert short["steps"] < 5_000 < 25_000 <= long["steps"]
    assert {name: value for name, value in short.items() if name != "tenth"} == long["tenth"]


def test_annealing_depends_on_the_length_and_has_no_tenth(script):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install -e '.[deep]'")
    assert "tenth" not in script.run("InvertedPendulum", "clip 0.2", 2_500, np.random.default_rng(1), anneal=True)


def test_full_fills_both_tables_and_repeats_nothing(script, tmp_path, monkeypatch):
    asked = []

    def sweep(function, settings, seeds, store, progress):
        asked.extend((s["task"], s["setting"], seeds[0]) for s in settings)
        results = [{"score": 0.0} | ({} if s["setting"] == RANDOM else {"tenth": {"score": 1.0}}) for s in settings]
        return [Record("run", s, seeds[0], r, 9.0, None, {}) for s, r in zip(settings, results)]

    monkeypatch.setattr(script, "sweep", sweep)
    monkeypatch.setattr(script, "TABLES", tables := {tier: tmp_path / f"{tier}.csv" for tier in ("tenth", "full")})
    known = row("Hopper", "clip 0.3", 1, 7.0)
    for path in tables.values():
        script.write([known], path)
    assert len(script.main("full")) == 252 == 1 + len(set(asked)) == 1 + len(asked)
    full, tenth = (read(tables[tier]) for tier in ("full", "tenth"))
    assert [script.key(r) for r in full] == [script.key(r) for r in tenth] and len(full) == 252
    score = {(False, False): 1.0, (False, True): 0.0, (True, False): 7.0}
    for r in tenth:
        assert r["score"] == score[script.key(r) == script.key(known), r["setting"] == RANDOM] and r["seconds"] is None
    assert {r["score"] for r in full} == {0.0, 7.0} and {r["seconds"] for r in full} == {9.0, None}
    assert len(script.main("full")) == 252 == 1 + len(asked)


@pytest.mark.parametrize(
    "call", [average, by_seed, comparison, lambda t: bootstrap(t, 3, rng=np.random.default_rng(0))]
)
def test_a_table_of_another_shape_is_refused(call):
    with pytest.raises(ValueError, match=r"^table: got shape \(\), must be"):
        call(3)


def test_a_path_that_is_none_is_refused():
    with pytest.raises(ValueError, match="^path: got 5, must be the name of a file"):
        read(5)
