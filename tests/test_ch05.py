"""Chapter 5: what is said of horizons, of code and of memory, and the figure that the document lacks."""

import inspect
import sys

import numpy as np
import pytest

from rlcore.bellman import solve_policy
from rlcore.envs import MDPEnv, random_walk, short_corridor
from rlcore.nstep import n_step_return, n_step_td
from rlcore.plots import backup_spectrum
from rlcore.studies.ch04 import repeat, walk_error
from rlcore.traces import trace_course


@pytest.mark.parametrize("n", [1, 2, 4, 6])
def test_what_comes_after_the_horizon_does_not_enter_the_target(n):
    """cl-063: the horizon is the time of the last reward of the target, and of the one estimate in it."""
    rng = np.random.default_rng(n)
    rewards, values, gamma = rng.normal(size=9), rng.normal(size=9), 0.8
    for t in range(9 - n):
        G, h = n_step_return(rewards, values, gamma, n, t), t + n
        later, others = rewards.copy(), rng.normal(size=9)
        later[h:] += 100.0
        others[h] = values[h]
        assert n_step_return(later, others, gamma, n, t) == G
        last, estimate = rewards.copy(), values.copy()
        last[h - 1] += 1.0
        estimate[h] += 1.0
        assert n_step_return(last, values, gamma, n, t) - G == pytest.approx(gamma ** (n - 1), rel=1e-12)
        assert n_step_return(rewards, estimate, gamma, n, t) - G == pytest.approx(gamma**n, rel=1e-12)


def test_a_horizon_maximises_nothing():
    """cl-063: whatever n is, the policy walks the same way, and its value is learned, -12, not that of the best, -3."""
    corridor, pi = short_corridor(), np.full((4, 2), 0.5)
    exact, runs = solve_policy(corridor, pi, 1.0), {}
    assert exact[0] == pytest.approx(-12)
    for n in (1, 3, 10):
        runs[n] = n_step_td(corridor, pi, 1.0, n, 3000, alpha=0.02, record=1, rng=np.random.default_rng(0))
        np.testing.assert_array_equal(runs[n].lengths, runs[1].lengths)
        np.testing.assert_allclose(runs[n].history[1000:].mean(axis=0), exact, atol=1.0)  # 20 seeds: 0.61


def test_n_step_methods_are_short_and_good():
    """cl-066: 22 lines with two buffers of n entries; on the 19 states n = 4 beats both ends."""
    code, sizes = inspect.unwrap(n_step_td.loop).__code__, []
    assert len({line for _, _, line in code.co_lines() if line}) <= 25

    def note(frame, event, arg):
        if event == "return" and frame.f_code is code:
            sizes.extend({id(x): x.size for x in frame.f_locals.values() if isinstance(x, np.ndarray)}.values())

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        options = dict(alpha=0.4, record=0, max_steps=100_000, rng=np.random.default_rng(0))
        run = n_step_td(MDPEnv(random_walk(19)), np.ones((21, 1)), 1.0, 4, 10, **options)
    finally:
        sys.setprofile(before)
    assert sorted(sizes) == [4, 4, 10, 10, 21, 21, 21] and run.lengths.max() > 100  # what grows is a number an episode
    walk, truth, errors = random_walk(19), np.arange(1, 20) / 10 - 1, {}
    for n, alpha, expected in ((1, 0.8, 0.344), (4, 0.4, 0.259), (512, 0.02, 0.492)):
        run_of = repeat(
            n_step_td, walk, np.ones((21, 1)), 1.0, n, 10, alpha=alpha, max_steps=100_000, record=1, n_runs=100,
            rng=np.random.default_rng(0),
        )  # fmt: skip
        errors[n] = np.mean([walk_error(run.history[1:], truth).mean() for run in run_of])
        assert errors[n] == pytest.approx(expected, abs=0.015)
    assert errors[4] < errors[1] < errors[512]


@pytest.mark.parametrize("decay, steps", [(0.2, 1), (0.5, 1), (0.8, 4), (0.9, 7), (0.99, 69)])
def test_a_larger_lambda_remembers_longer(decay, steps):
    """cl-075: a trace has fallen to half after ln 0.5 / ln(gamma lambda) steps, rounded up."""
    course = trace_course([0], 100, decay, "accumulating")
    assert course[0] == 1 and np.flatnonzero(course <= 0.5 + 1e-12)[0] == steps
    assert steps == np.ceil(np.log(0.5) / np.log(decay) - 1e-9)


def test_the_spectrum_has_a_state_more_than_actions_in_every_diagram():
    """om-spectrum-figure: five chains; a white circle for a state, a black dot for an action, a square for the end."""
    steps = [1, 2, 3, 5, 7]
    ax = backup_spectrum(steps, weights=[0.4, 0.3, 0.2, 0.08, 0.02]).axes[0]
    marks = [(line.get_xdata()[0], line) for line in ax.lines if line.get_marker() != "None"]
    for k, n in enumerate(steps):
        column = [line for x, line in marks if x == 2 * k]
        states = [line for line in column if line.get_markerfacecolor() != line.get_markeredgecolor()]
        last = min(column, key=lambda line: line.get_ydata()[0])
        assert len(states) == n + 1 and len(column) - len(states) == n
        assert [line.get_marker() for line in column].count("s") == (n == 7)
        assert last in states and last.get_marker() == ("s" if n == 7 else "o")
        heights = sorted(((line.get_ydata()[0], line in states) for line in column), reverse=True)
        assert [of_state for _, of_state in heights] == [True, False] * n + [True]
    assert len(marks) == sum(2 * n + 1 for n in steps)
    texts = [text.get_text().replace("\n", " ") for text in ax.texts]
    assert texts[::2] == ["1 step", "2 steps", "3 steps", "5 steps", "Monte Carlo"]
    assert texts[1::2] == ["0.4", "0.3", "0.2", "0.08", "0.02"]
