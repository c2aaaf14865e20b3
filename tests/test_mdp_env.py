"""MDPEnv behind gymnasium's interface, and FiniteMDP.from_env on gymnasium's own tables."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from worlds import agrees, awkward, chain, published

from rlcore.bellman import q_from_v, solve_policy
from rlcore.dp import policy_iteration, value_iteration
from rlcore.envs import MDPEnv, cliff_walking, gridworld, random_mdp, random_walk, recycling_robot
from rlcore.mdp import FiniteMDP, uniform_policy

WORLDS = {
    "recycling robot": recycling_robot(),  # has an illegal action
    "awkward": awkward(start=0),  # check_env draws its action before the reset: it needs one first state
    "grid": gridworld(),
    "slippery grid": gridworld(3, 4, slip=0.25),
    "walk": random_walk(5),
    "long walk": random_walk(19),
    "dense": random_mdp(6, 3, rng=np.random.default_rng(0)),
    "cliff": cliff_walking(),
}


@pytest.fixture(params=WORLDS)
def mdp(request):
    return WORLDS[request.param]


def table(name, **more):
    return FiniteMDP.from_env(gym.make(name, **more))


def play(env, seed, n=40):
    """What comes back from n random steps, with resets in between."""
    state, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    seen = [(state, info["action_mask"].tolist())]
    for _ in range(n):
        state, reward, terminated, truncated, info = env.step(env.action_space.sample())
        seen.append((state, reward, terminated, truncated, info["action_mask"].tolist()))
        if terminated or truncated:
            seen.append(env.reset()[0])
    return seen


# ---------------------------------------------------------------------- MDPEnv


def test_gymnasium_accepts_it_without_a_warning(mdp):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(MDPEnv(mdp), skip_render_check=True)


def test_same_seed_same_episode(mdp):
    assert play(MDPEnv(mdp), 3) == play(MDPEnv(mdp), 3)
    if mdp.n_states > 2:
        assert play(MDPEnv(mdp), 3) != play(MDPEnv(mdp), 4)


def test_steps_are_outcomes_of_the_process(mdp):
    env = MDPEnv(mdp)
    state, info = env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(60):
        assert_array_equal(info["action_mask"], mdp.legal[state])
        action = env.action_space.sample()
        assert mdp.legal[state, action]
        new, reward, terminated, truncated, info = env.step(action)
        assert mdp.p(new, reward, state, action) > 0
        assert terminated == mdp.terminal[new] and not truncated
        assert type(new) is int and type(reward) is float and type(terminated) is bool
        state = env.reset()[0] if terminated else new
        info = {"action_mask": mdp.legal[state]}


def test_round_trip(mdp):
    again = FiniteMDP.from_env(MDPEnv(mdp))
    assert again == mdp and (again.state_names, again.action_names) == (mdp.state_names, mdp.action_names)
    assert FiniteMDP.from_env(MDPEnv(mdp)) == mdp and isinstance(MDPEnv(mdp), MDPEnv)
    assert FiniteMDP.from_env(gym.wrappers.TimeLimit(MDPEnv(mdp), 5)) == mdp


def test_first_state_is_drawn_from_start():
    m = FiniteMDP.from_outcomes({(s, 0): [(1.0, 3, 0.0)] for s in range(3)}, start=[0.2, 0.0, 0.8, 0.0])
    env = MDPEnv(m)
    env.reset(seed=0)
    first = np.bincount([env.reset()[0] for _ in range(2000)], minlength=4) / 2000
    assert_allclose(first, m.start, atol=4 * np.sqrt(0.16 / 2000))
    assert first[1] == first[3] == 0


def test_frequencies_of_steps():
    env, n = MDPEnv(random_walk(5)), 4000
    env.reset(seed=0)
    ups = 0
    for _ in range(n):
        env.s = 3
        ups += env.step(0)[0] == 4
    assert abs(ups / n - 0.5) < 4 * 0.5 / np.sqrt(n)


def test_time_limit_truncates_and_does_not_terminate():
    env = gym.wrappers.TimeLimit(MDPEnv(recycling_robot()), 3)
    env.reset(seed=0)
    ends = [env.step(0)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    short = gym.wrappers.TimeLimit(MDPEnv(chain([1.0])), 3)
    short.reset(seed=0)
    assert short.step(0)[1:4] == (1.0, True, False)


def test_illegal_action_is_refused_and_changes_nothing():
    env = MDPEnv(recycling_robot())
    env.reset(seed=0)
    assert env.action_mask().tolist() == [1, 1, 0] and env.action_mask().dtype == np.int8
    with pytest.raises(ValueError, match=r"action: got 2 in state 0, allowed there: \[0, 1\]"):
        env.step(2)
    assert env.s == 0
    drawn = {int(env.action_space.sample()) for _ in range(60)}
    assert drawn == {0, 1}
    chosen = {int(env.action_space.sample(mask=np.array([0, 0, 1], np.int8))) for _ in range(5)}
    assert chosen == {2}  # a mask that is given wins


def test_table_of_a_world():
    env = MDPEnv(recycling_robot())
    assert set(env.P[0]) == {0, 1} and env.P[1][2] == [(1.0, 0, 0.0, False)]
    assert MDPEnv(chain([2.0])).P[0][0] == [(1.0, 1, 2.0, True)]
    assert env.P[1][0][0][0] == pytest.approx(0.6) and len(env.P[0][0]) == 2
    assert_array_equal(env.initial_state_distrib, [1.0, 0.0])
    assert env.observation_space.n == 2 and env.action_space.n == 3
    assert env.state_names == ("high", "low") and env.action_names[2] == "recharge"


# ---------------------------------------------------------------------- gymnasium's tables


@pytest.mark.parametrize("name, n, ends", [("4x4", 16, 5), ("8x8", 64, 11)])
def test_frozen_lake(name, n, ends):
    m = table("FrozenLake-v1", map_name=name)
    assert (m.n_states, m.n_actions, int(m.terminal.sum())) == (n, 4, ends)
    assert m.start[0] == 1.0
    assert_allclose(m.prob.max(axis=2)[~m.terminal].min(), 1 / 3)
    found = policy_iteration(m, 1.0)
    # probability of ever reaching the goal: 14 / 17 on the small lake, certain on the large one
    assert found.V[0] == pytest.approx({"4x4": 14 / 17, "8x8": 1.0}[name], abs=1e-9)
    assert value_iteration(m, 0.99, tol=1e-12).V[0] == pytest.approx({"4x4": 0.5420, "8x8": 0.4146}[name], abs=5e-5)
    still = table("FrozenLake-v1", map_name=name, is_slippery=False)
    assert policy_iteration(still, 0.9).V[0] == pytest.approx(0.9 ** (2 * n**0.5 - 3))


def test_cliff_walking():
    """Its goal row leads on in gymnasium's table; here the goal is absorbing."""
    m = table("CliffWalking-v1")
    assert m.terminal.nonzero()[0].tolist() == [47] and m.start.argmax() == 36
    found = policy_iteration(m, 1.0)
    assert found.V[36] == pytest.approx(published("cliff.v_star_start")[0])
    Q = q_from_v(m, found.V, 1.0)[:, [0, 2, 3, 1]]  # there up, right, down, left; here up, down, left, right
    met = [*range(37), 47]  # the cliff itself cannot be entered
    assert_allclose(Q[met], published("cliff.q_star")[0][met], atol=1e-9)
    assert not Q[47].any()


def test_our_cliff_is_gymnasiums():
    theirs, ours = table("CliffWalking-v1"), cliff_walking()
    assert ours.n_states == theirs.n_states == 48 and ours.start.argmax() == 36
    assert policy_iteration(ours, 1.0).V[36] == pytest.approx(-13.0)
    agrees(policy_iteration(ours, 1.0).V[36], "cliff.v_star_start")


def test_taxi():
    m = table("Taxi-v4")
    assert (m.n_states, m.n_actions, int(m.terminal.sum())) == (500, 6, 4)
    assert m.terminal.nonzero()[0].tolist() == [0, 85, 410, 475]  # passenger delivered at each of the four places
    found = policy_iteration(m, 1.0)
    assert m.start @ found.V == pytest.approx(7.93)  # mean over the 300 first states, none of them terminal
    assert (m.start > 0).sum() == 300 and found.converged


def test_state_entered_both_ways_is_refused():
    class Both(gym.Env):
        observation_space, action_space = gym.spaces.Discrete(2), gym.spaces.Discrete(2)
        initial_state_distrib = np.array([1.0, 0.0])
        P = {0: {0: [(1.0, 1, 0.0, True)], 1: [(1.0, 1, 0.0, False)]}, 1: {0: [(1.0, 0, 0.0, False)]}}

    with pytest.raises(ValueError, match=r"env: \(s=0, a=1\) enters the terminal state 1 with terminated=False"):
        FiniteMDP.from_env(Both())
    later = Both()  # the contradiction lies two steps away from the start
    later.observation_space = gym.spaces.Discrete(4)
    later.initial_state_distrib = np.array([1.0, 0.0, 0.0, 0.0])
    on = [(1.0, 1, 0.0, False)], [(1.0, 2, 0.0, False)]
    later.P = {0: {0: on[0]}, 1: {0: on[1]}, 2: {0: [(1.0, 3, 0.0, True)], 1: [(1.0, 3, 0.0, False)]}, 3: {}}
    with pytest.raises(ValueError, match=r"env: \(s=2, a=1\) enters the terminal state 3"):
        FiniteMDP.from_env(later)
    Both.P = {0: {0: [(1.0, 1, 0.0, True), (0.0, 0, 9.0, True), (0.0, 1, 9.0, False)]}, 1: {0: [(1.0, 0, 0.0, False)]}}
    m = FiniteMDP.from_env(Both())  # an outcome of probability 0 ends nothing
    assert m.terminal.tolist() == [False, True] and m.legal[0].tolist() == [True, False]


def test_unreachable_state_may_be_entered_both_ways():
    """Taxi's table has such states: nothing that can be met contradicts itself."""

    class Hidden(gym.Env):
        observation_space, action_space = gym.spaces.Discrete(3), gym.spaces.Discrete(1)
        initial_state_distrib = np.array([1.0, 0.0, 0.0])
        P = {0: {0: [(1.0, 1, 2.0, True)]}, 1: {0: [(1.0, 1, 0.0, True)]}, 2: {0: [(1.0, 1, 0.0, False)]}}

    m = FiniteMDP.from_env(Hidden())
    assert m.terminal.tolist() == [False, True, False] and m.p(1, 2.0, 0, 0) == 1.0


def test_environments_without_a_table_are_refused():
    with pytest.raises(ValueError, match="env: BlackjackEnv has no transition table P; from_env reads toy-text"):
        table("Blackjack-v1")


@pytest.mark.parametrize("name", ["walk", "slippery grid"])
def test_mean_return_of_random_play_is_the_value(name):
    mdp, n, G = WORLDS[name], 400, []
    env, pi = MDPEnv(mdp), uniform_policy(mdp)
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(n):
        env.reset()
        total, terminated = 0.0, False
        while not terminated:
            _, reward, terminated, _, _ = env.step(env.action_space.sample())
            total += reward
        G.append(total)
    expected = mdp.start @ solve_policy(mdp, pi, 1.0)
    assert abs(np.mean(G) - expected) < 4 * np.std(G) / np.sqrt(n)
