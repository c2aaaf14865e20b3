"""Golf: the exact line, the course's published contours, and bad input."""

import functools

import numpy as np
import pytest

from rlcore.bellman import greedy, solve_policy
from rlcore.dp import value_iteration
from rlcore.envs import golf_course, golf_line
from rlcore.mdp import deterministic_policy, rollout
from rlcore.studies.ch02 import best_with_club, free_last_stroke, putting_values

TEE, HOLE = 5 * 31 + 4, 5 * 31 + 26
BUNKER = [r * 31 + c for r in (2, 3) for c in (20, 21, 22)] + [r * 31 + c for r in (7, 8) for c in (22, 23, 24)]


@pytest.fixture(scope="module")
def course():
    course = golf_course()
    object.__setattr__(course, "sampler", functools.cache(course.sampler))  # for 200 rollouts, once
    return course


@pytest.fixture(scope="module")
def best(course):
    return value_iteration(course, 1.0, tol=1e-9, record=1)


def test_line_always_putting_is_minus_half_the_distance_rounded_up():
    line = golf_line()
    longest = deterministic_policy(line, np.array([0, 0] + [1] * 11))
    np.testing.assert_allclose(solve_policy(line, longest, 1.0), -np.ceil(np.arange(13) / 2), atol=1e-12)


def test_line_best_values_and_clubs_at_the_far_end():
    line = golf_line()
    best = value_iteration(line, 1.0)
    np.testing.assert_array_equal(best.V, [0, -1, -1, -2, -2, -2, -2, -2, -3, -3, -3, -3, -3])
    assert best_with_club(line, best.Q, "putter")[12] == -4
    assert best_with_club(line, best.Q, "driver")[12] == -3


def test_line_drive_never_holes():
    line = golf_line()
    drive = line.n_actions - 1
    assert [int(line.next_state[d, drive, 0]) for d in (5, 6, 3, 12)] == [1, 1, 2, 7]
    assert not (line.next_state[1:, drive, 0] == 0).any()


def test_course_values_at_the_tee(course, best):
    assert abs(best.V[TEE] + 3) < 1e-9
    assert abs(best_with_club(course, best.Q, "driver")[TEE] + 3) < 1e-9
    assert abs(best_with_club(course, best.Q, "putter")[TEE] + 4) < 1e-9


def test_course_always_putting():
    history = putting_values(golf_course(with_driver=False), 20)
    changed = (history[1:] != history[:-1]).any(axis=0)
    grass = np.setdiff1d(np.arange(11 * 31), BUNKER)
    assert history[-1, TEE] == -6 and history[-1, HOLE] == 0
    assert changed[grass].sum() == grass.size - 1  # all but the hole
    assert (history[8] == history[9])[grass].all() and not (history[7] == history[8])[grass].all()  # 8 sweeps
    np.testing.assert_array_equal(history[:, BUNKER], -np.arange(21.0)[:, None] * np.ones(len(BUNKER)))


def test_all_clubs_need_four_sweeps_and_one_that_finds_nothing(best):
    change = np.abs(np.diff(best.history, axis=0)).max(axis=1)
    assert (change > 1e-9).sum() == 4 and best.n_iter == 5


def test_putting_does_not_move_the_ball_out_of_sand(course):
    putts = [a for a, name in enumerate(course.action_names) if name.startswith("putter")]
    for s in BUNKER:
        moved = course.next_state[s][putts][course.prob[s][putts] > 0]
        assert (moved == s).all()


def test_putting_alone_is_improper_in_sand():
    with pytest.raises(ValueError, match="terminat"):
        value_iteration(golf_course(with_driver=False), 1.0)


def test_without_sand_the_sweeps_agree_with_value_iteration():
    course = golf_course(sand=(), with_driver=False)
    np.testing.assert_array_equal(putting_values(course, 12)[-1], value_iteration(course, 1.0).V)


def test_drive_lands_on_the_nine_cells_around_its_aim_and_never_in_the_hole(course):
    a = course.action_names.index("driver +0 +11")
    found = sorted(course.next_state[TEE, a])
    assert found == sorted((5 + dr) * 31 + 15 + dc for dr in (-1, 0, 1) for dc in (-1, 0, 1))
    np.testing.assert_allclose(course.prob[TEE, a], 1 / 9)
    drives = [a for a, name in enumerate(course.action_names) if name.startswith("driver")]
    s = np.setdiff1d(np.arange(11 * 31), [HOLE])
    assert not (course.next_state[s][:, drives] == HOLE).any()
    straight = course.action_names.index("driver +0 +6")
    assert (course.next_state[HOLE - 6, straight] == HOLE + 1).sum() == 2  # its own share, and that of the hole


def test_driver_distances(course):
    drives = [name.split()[1:] for name in course.action_names if name.startswith("driver")]
    squared = {int(r) ** 2 + int(c) ** 2 for r, c in drives}
    assert min(squared) == 9 and max(squared) == 121
    putts = {int(r) ** 2 + int(c) ** 2 for r, c in (n.split()[1:] for n in course.action_names if n[0] == "p")}
    assert min(putts) == 1 and max(putts) == 16


def test_best_play_is_drive_drive_putt_in_every_round(course, best):
    pi = greedy(best.Q)
    for rng in np.random.default_rng(0).spawn(200):
        path = rollout(course, pi, 20, rng=rng)
        assert path.terminated and path.rewards.sum() == -3
        assert [course.action_names[a].split()[0] for a in path.actions] == ["driver", "driver", "putter"]


def test_a_free_last_stroke_makes_every_value_one_higher(course, best):
    free = value_iteration(free_last_stroke(course), 1.0, tol=1e-9)
    others = ~course.terminal
    np.testing.assert_allclose(free.V[others], best.V[others] + 1, atol=1e-9)


def test_without_scatter_every_value_is_a_whole_number_and_scatter_can_help(best):
    exact = value_iteration(golf_course(scatter=0), 1.0)
    assert (np.round(exact.V) == exact.V).all()
    assert exact.V[0] == -4 and best.V[0] > -3.9  # a lucky bounce carries farther than the aim


@pytest.mark.parametrize(
    "change, name",
    [
        (dict(hole=(0, 26)), "hole"),
        (dict(hole=(5, 40)), "hole"),
        (dict(tee=(11, 4)), "tee"),
        (dict(tee=(5, 26)), "hole"),
        (dict(sand=[(5, 31)]), "sand"),
        (dict(sand=[(5, 26)]), "hole"),
        (dict(putter=0), "putter"),
        (dict(driver=(0, 11)), "driver"),
        (dict(driver=(5, 4)), "driver"),
        (dict(scatter=-1), "scatter"),
    ],
)
def test_bad_course(change, name):
    with pytest.raises(ValueError, match=rf"^{name}: got"):
        golf_course(**change)


@pytest.mark.parametrize("change", [dict(length=0), dict(putter=0), dict(driver=2.5)])
def test_bad_line(change):
    with pytest.raises(ValueError, match=rf"^{next(iter(change))}: got"):
        golf_line(**change)


def test_unknown_club(course):
    with pytest.raises(ValueError, match="^club: got 'wedge'"):
        best_with_club(course, np.zeros((341, 398)), "wedge")
