"""Catch: its rules, its pixels, its two forms, and what it can be played at."""

import pickle

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from rlcore.bellman import solve_policy
from rlcore.dp import policy_iteration
from rlcore.envs import CATCH_COLS, CATCH_ROWS, Catch, catch, catch_pixels
from rlcore.mdp import rollout, uniform_policy
from rlcore.nn import MLP
from rlcore.optimizers import Adam
from rlcore.reinforce import reinforce_network


def place(s):
    """Row and column of the ball, column of the paddle."""
    return (*divmod(s // CATCH_COLS, CATCH_COLS), s % CATCH_COLS)


@pytest.mark.parametrize("n_actions", [2, 3])
def test_the_ball_falls_straight_and_the_paddle_stops_at_the_walls(n_actions):
    world, moves = catch(n_actions), {2: (-1, 1), 3: (-1, 0, 1)}[n_actions]
    assert world.n_states == 250 and world.terminal.sum() == 25 and world.prob.shape[2] == 1
    for s in np.flatnonzero(~world.terminal):
        row, ball, paddle = place(s)
        for a, move in enumerate(moves):
            after = place(world.next_state[s, a, 0])
            assert after == (row + 1, ball, int(np.clip(paddle + move, 0, CATCH_COLS - 1)))
            expected = 0 if row < CATCH_ROWS - 2 else 1 if after[1] == after[2] else -1
            assert world.reward[s, a, 0] == expected
    starts = [place(s) for s in np.flatnonzero(world.start)]
    assert starts == [(0, ball, 2) for ball in range(5)] and np.allclose(world.start[world.start > 0], 0.2)


def test_pixels_show_the_ball_and_the_paddle():
    pixels = catch_pixels()
    assert pixels.shape == (250, 50) and pixels.dtype == np.float32
    for s, screen in enumerate(pixels.reshape(-1, 10, 5)):
        row, ball, paddle = place(s)
        expected = np.zeros((10, 5))
        expected[row, ball] = expected[9, paddle] = 1
        np.testing.assert_array_equal(screen, expected)
    assert len(np.unique(pixels[~catch().terminal], axis=0)) == 225  # the screen is the state


@pytest.mark.parametrize("n_actions", [2, 3])
def test_random_play_catches_one_ball_in_five_and_the_best_play_every_one(n_actions):
    world = catch(n_actions)
    v = world.start @ solve_policy(world, uniform_policy(world), 1.0)
    if n_actions == 3:  # the paddle's column does not depend on the ball's, which is uniform
        assert v == pytest.approx(2 * 0.2 - 1, abs=1e-12)
    assert world.start @ policy_iteration(world, 1.0).V == pytest.approx(1.0)
    assert all(
        rollout(world, uniform_policy(world), 50, rng=np.random.default_rng(k)).rewards.size == 9 for k in range(5)
    )


@pytest.mark.parametrize("n_actions", [2, 3])
def test_the_environment_plays_the_process(n_actions):
    env, world, pixels = Catch(n_actions), catch(n_actions), catch_pixels()
    check_env(env, skip_render_check=True)
    rng, firsts = np.random.default_rng(0), []
    for seed in range(60):
        observation, _ = env.reset(seed=seed)
        s, terminated = env.s, False
        firsts.append(s)
        np.testing.assert_array_equal(observation, pixels[s])
        while not terminated:
            a = int(rng.integers(n_actions))
            observation, r, terminated, truncated, _ = env.step(a)
            assert r == world.reward[s, a, 0]
            s = world.next_state[s, a, 0]
            assert env.s == s and terminated == world.terminal[s] and not truncated
            np.testing.assert_array_equal(observation, pixels[s])
    assert set(firsts) == set(np.flatnonzero(world.start))
    np.testing.assert_array_equal(env.reset(seed=3)[0], pixels[firsts[3]])
    twin = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(twin.reset(seed=4)[0], env.reset(seed=4)[0])


def test_a_network_learns_it_from_pixels():
    net = MLP([50, 32, 3], optimizer=Adam(0.01), rng=np.random.default_rng(0))
    run = reinforce_network(Catch(), 1.0, 600, net=net, rng=np.random.default_rng(0))
    assert run.returns[:100].mean() < 0 < 0.5 < run.returns[-100:].mean()


BAD = {
    "four actions": (lambda: catch(4), "n_actions: got 4, must be 2"),
    "an environment of one": (lambda: Catch(1), "n_actions: got 1, must be 2"),
    "an action too many": (lambda: Catch().step(3), "action: got 3, must be an integer in 0..2"),
    "actions in words": (lambda: catch("two"), "n_actions: got 'two', must be 2"),
    "a list of actions": (lambda: catch([2]), "n_actions: got [2], must be 2"),
    "an action in words": (lambda: Catch().step("left"), "action: got 'left', must be an integer in 0..2"),
    "half an action": (lambda: Catch().step(0.5), "action: got 0.5, must be an integer in 0..2"),
    "an action below 0": (lambda: Catch(2).step(-1), "action: got -1, must be an integer in 0..1"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    call, message = BAD[case]
    with pytest.raises(ValueError) as caught:
        call()
    assert str(caught.value).startswith(message)
