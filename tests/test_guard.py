"""The boundary to environments: what they may answer, what they must not, and how they are left."""

import re

import gymnasium as gym
import numpy as np
import pytest

from rlcore.actor_critic import actor_critic, actor_critic_network
from rlcore.core.checks import show
from rlcore.core.running import LOST, Watch
from rlcore.core.worlds import Guard
from rlcore.envs import MDPEnv, random_walk
from rlcore.judging import evaluate
from rlcore.mdp import rollout
from rlcore.monte_carlo import mc_prediction
from rlcore.planning import dyna_q
from rlcore.ppo import PPOConfig, ppo
from rlcore.reinforce import reinforce, reinforce_network
from rlcore.td import expected_sarsa, q_learning, sarsa, td0
from rlcore.traces import sarsa_lambda, td_lambda, watkins_q_lambda
from rlcore.trpo import TRPOConfig, trpo


def rng(seed=0):
    return np.random.default_rng(seed)


SMALL = dict(horizon=8, minibatch=8, epochs=1, hidden=(4,))
TABLES = {
    "td0": lambda env: td0(env, np.full((3, 2), 0.5), 0.9, 3, alpha=0.1, rng=rng()),
    "td_lambda": lambda env: td_lambda(env, np.full((3, 2), 0.5), 0.9, 0.5, 3, alpha=0.1, rng=rng()),
    "mc_prediction": lambda env: mc_prediction(env, np.full((3, 2), 0.5), 0.9, 3, rng=rng()),
    "rollout": lambda env: rollout(env, np.full((3, 2), 0.5), 9, rng=rng()),
    "sarsa": lambda env: sarsa(env, 0.9, 3, alpha=0.1, epsilon=0.5, rng=rng()),
    "expected_sarsa": lambda env: expected_sarsa(env, 0.9, 3, alpha=0.1, epsilon=0.5, rng=rng()),
    "q_learning": lambda env: q_learning(env, 0.9, 3, alpha=0.1, epsilon=0.5, rng=rng()),
    "sarsa_lambda": lambda env: sarsa_lambda(env, 0.9, 0.5, 3, alpha=0.1, epsilon=0.5, rng=rng()),
    "watkins_q_lambda": lambda env: watkins_q_lambda(env, 0.9, 0.5, 3, alpha=0.1, epsilon=0.5, rng=rng()),
    "dyna_q": lambda env: dyna_q(env, 0.9, 3, n_planning=2, alpha=0.1, epsilon=0.5, rng=rng()),
    "reinforce": lambda env: reinforce(env, 0.9, 3, rng=rng()),
    "actor_critic": lambda env: actor_critic(env, 0.9, 3, rng=rng()),
    "evaluate": lambda env: evaluate(np.full((3, 2), 0.5), env, 3, rng=rng()),
}
VECTORS = {
    "reinforce_network": lambda env: reinforce_network(env, 0.9, 3, rng=rng()),
    "actor_critic_network": lambda env: actor_critic_network(env, 0.9, 3, rng=rng()),
    "ppo": lambda env: ppo(env, rng=rng(), n_steps=20, config=PPOConfig(**SMALL)),
    "trpo": lambda env: trpo(env, rng=rng(), n_steps=20, config=TRPOConfig(**SMALL)),
    "evaluate": lambda env: evaluate(lambda s: 0, env, 3, rng=rng()),
}


class Line(gym.Env):
    """Three steps an episode; the second step of the second episode answers with `odd` in place of its own."""

    action_space = gym.spaces.Discrete(2)

    def __init__(self, vector=False, first=None, **odd):
        self.vector, self.first, self.odd, self.episode = vector, first, odd, -1
        self.observation_space = gym.spaces.Box(-9, 9, (2,), np.float32) if vector else gym.spaces.Discrete(3)

    def state(self):
        return np.array([self.t, 1.0], np.float32) if self.vector else min(self.t, 2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t, self.episode = 0, self.episode + 1  # the first reset only seeds
        return (self.state(), {}) if self.first is None else self.first

    def step(self, action):
        assert action in (0, 1) and not isinstance(action, bool)
        self.t += 1
        answer = dict(s=self.state(), r=1.0, terminated=self.t == 3, truncated=False, info={})
        if self.episode == 2 and self.t == 2:
            answer |= self.odd
        if isinstance(answer["r"], Exception):
            raise answer["r"]
        return answer.get("whole", tuple(answer.values()))


BAD = {
    "reward NaN": (dict(r=np.nan), "reward nan in episode 2, step 2, must be a finite number"),
    "reward infinite": (dict(r=-np.inf), "reward -inf in episode 2, step 2, must be a finite number"),
    "reward None": (dict(r=None), "reward None in episode 2, step 2, must be a number"),
    "reward text": (dict(r="1"), "reward '1' in episode 2, step 2, must be a number"),
    "reward no float can hold": (dict(r=10**400), f"reward {show(10**400)} in episode 2, step 2, must be a number"),
    "ragged rewards": (dict(r=[1.0, [2.0]]), "reward [1.0, [2.0]] in episode 2, step 2, must be a number"),
    "terminated ragged": (dict(terminated=[0, [1]]), "terminated [0, [1]] in episode 2, step 2, must be True or False"),
    "two rewards": (dict(r=np.ones(2)), "reward array([1., 1.]) in episode 2, step 2, must be a number"),
    "terminated text": (dict(terminated="no"), "terminated 'no' in episode 2, step 2, must be True or False"),
    "truncated None": (dict(truncated=None), "truncated None in episode 2, step 2, must be True or False"),
    "four values": (dict(whole=(0, 1.0, False, {})), "step gave 4 values in episode 2, step 2, must be (observation, "
                    "reward, terminated, truncated, info); four are the old API of gym"),
    "three values": (dict(whole=(0, 1.0, False)), "step gave 3 values in episode 2, step 2, must be"),
    "no values": (dict(whole=None), "step gave None in episode 2, step 2, must be"),
}  # fmt: skip
BAD_STATES = {
    "far outside": (dict(s=10**9), "observation 1000000000 in episode 2, step 2, must be in Discrete(3)"),
    "one too far": (dict(s=3), "observation 3 in episode 2, step 2, must be in Discrete(3)"),
    "below": (dict(s=-1), "observation -1 in episode 2, step 2, must be in Discrete(3)"),
    "a float": (dict(s=1.5), "observation 1.5 in episode 2, step 2, must be a whole number"),
    "a list": (dict(s=[1]), "observation [1] in episode 2, step 2, must be a whole number"),
    "none": (dict(s=None), "observation None in episode 2, step 2, must be a whole number"),
}
BAD_VECTORS = {
    "NaN": (dict(s=np.array([np.nan, 0.0])), "observation array([nan,  0.]) in episode 2, step 2, must be finite"),
    "another shape": (dict(s=np.zeros(3)), "an observation of shape (3,) in episode 2, step 2, must be of shape (2,)"),
    "a number": (dict(s=1.0), "an observation of shape () in episode 2, step 2, must be of shape (2,)"),
    "text": (dict(s="text"), "observation 'text' in episode 2, step 2, must be numbers"),
    "ragged": (dict(s=[1.0, [2.0]]), "observation [1.0, [2.0]] in episode 2, step 2, must be numbers"),
}


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("odd", BAD | BAD_STATES)
def test_a_bad_answer_is_named_with_its_place(name, odd):
    answer, says = (BAD | BAD_STATES)[odd]
    if name == "rollout":  # one episode only
        says = says.replace("episode 2", "episode 1")
    env = Line(**answer)
    env.episode = 0 if name == "rollout" else -1
    with pytest.raises(ValueError, match="^world: " + re.escape(says)):
        TABLES[name](env)


@pytest.mark.parametrize("name", VECTORS)
@pytest.mark.parametrize("odd", BAD | BAD_VECTORS)
def test_a_bad_answer_in_vectors_is_named_with_its_place(name, odd):
    answer, says = (BAD | BAD_VECTORS)[odd]
    env = Line(vector=True, **answer)
    if name in ("evaluate", "ppo", "trpo"):  # their first reset is that of the first episode
        env.episode = 0
    with pytest.raises(ValueError, match="^world: " + re.escape(says)):
        VECTORS[name](env)


GOOD = {
    "numpy numbers": dict(s=np.int64(2), r=np.float32(1.0), terminated=np.False_, truncated=np.bool_(False)),
    "arrays without dimensions": dict(s=np.array(2), r=np.array(1.0), terminated=np.array(False)),
    "a reward of shape (1,)": dict(r=np.ones(1), truncated=np.zeros(1, bool)),
    "whole numbers": dict(r=1, terminated=0, truncated=np.int8(0)),
}


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("odd", GOOD)
def test_numbers_of_every_kind_are_understood(name, odd):
    one, two = TABLES[name](Line(**GOOD[odd])), TABLES[name](Line())
    for field in ("returns", "V", "Q", "rewards"):
        np.testing.assert_array_equal(getattr(one, field, None), getattr(two, field, None))


@pytest.mark.parametrize("name", VECTORS)
@pytest.mark.parametrize("s", [[2.0, 1.0], np.array([2, 1]), np.array([2.0, 1.0])])
def test_vectors_of_every_kind_are_understood(name, s):
    one = VECTORS[name](Line(vector=True, s=s, r=np.ones(1, np.float32), terminated=np.False_))
    np.testing.assert_array_equal(one.returns, VECTORS[name](Line(vector=True)).returns)


@pytest.mark.parametrize("name", TABLES | VECTORS)
def test_an_error_of_the_environments_own_is_passed_on(name):
    learn, env = (TABLES | VECTORS)[name], Line(vector=name in VECTORS, r=ZeroDivisionError("its own"))
    env.episode = 0 if name in ("ppo", "trpo") else -1
    if name in ("evaluate", "rollout"):
        pytest.skip("their episodes are counted otherwise, see above")
    with pytest.raises(ZeroDivisionError) as error:
        learn(env)
    assert (
        error.value.__notes__[0] == "in the step of the environment, episode 2, step 2"
        and str(error.value) == "its own"
    )


@pytest.mark.parametrize("first, says", [(0, "reset gave 0"), ((0, 1), "reset gave (0, 1)"), ([0, {}], "reset gave [")])
def test_the_old_reset_is_named_as_such(first, says):
    with pytest.raises(ValueError, match="^world: " + re.escape(says)) as error:
        q_learning(Line(first=first), 0.9, 1, alpha=0.1, epsilon=0.1, rng=rng())
    assert "without info it is the old API of gym" in str(error.value)


# ---------------------------------------------------------------------- spaces


def test_actions_and_states_are_counted_from_where_the_space_begins():
    class Far(Line):
        observation_space, action_space = gym.spaces.Discrete(3, start=-7), gym.spaces.Discrete(2, start=40)

        def __init__(self):
            super().__init__()
            self.observation_space, self.seen = Far.observation_space, set()

        def state(self):
            return super().state() - 7

        def step(self, action):
            self.seen.add(action)
            return super().step(action - 40)

    env = Far()
    np.testing.assert_array_equal(TABLES["q_learning"](env).Q, TABLES["q_learning"](Line()).Q)
    assert env.seen == {40, 41}
    found = ppo(gym.wrappers.TransformAction(Line(vector=True), lambda a: a - 5, gym.spaces.Discrete(2, start=5)),
                rng=rng(), n_steps=20, config=PPOConfig(**SMALL))  # fmt: skip
    np.testing.assert_array_equal(found.returns, VECTORS["ppo"](Line(vector=True)).returns)


def test_the_outermost_wrapper_says_what_the_spaces_are():
    mdp = random_walk(3)
    swapped = gym.wrappers.TransformObservation(MDPEnv(mdp), lambda s: 9 - s, gym.spaces.Discrete(10))
    run = td0(swapped, np.ones((10, 1)), 1.0, 50, alpha=0.1, rng=rng())
    assert run.V.shape == (10,) and run.V[[6, 7, 8]].any() and not run.V[:5].any()
    reversed_actions = gym.wrappers.TransformAction(Line(), lambda a: 1 - a, gym.spaces.Discrete(2))
    assert q_learning(reversed_actions, 0.9, 3, alpha=0.1, epsilon=0.5, rng=rng()).Q.shape == (3, 2)


@pytest.mark.parametrize("observations, actions", [
    (gym.spaces.MultiBinary(3), gym.spaces.Discrete(2)), (gym.spaces.Discrete(2), gym.spaces.MultiBinary(3)),
    (gym.spaces.MultiDiscrete([2, 2]), gym.spaces.Discrete(2)), (gym.spaces.Dict(), gym.spaces.Discrete(2)),
    (gym.spaces.Discrete(2), gym.spaces.MultiDiscrete([2, 2])),
    (gym.spaces.Discrete(2), gym.spaces.Box(0, 3, (1,), int)),
    (gym.spaces.Discrete(2), gym.spaces.Dict()), (gym.spaces.Discrete(2), gym.spaces.Tuple([])),
])  # fmt: skip
def test_other_spaces_are_refused(observations, actions):
    env = Line(vector=True)
    env.observation_space, env.action_space = observations, actions
    for learn in TABLES.values():
        with pytest.raises(ValueError, match="^world: got .*, must be"):
            learn(env)
    env.observation_space = gym.spaces.Box(-9, 9, (2,), np.float32)
    for name, learn in VECTORS.items():
        if name != "evaluate" and observations == gym.spaces.Discrete(2):
            with pytest.raises(ValueError, match="^world: got actions .*, must be"):
                learn(env)
    env.observation_space, env.action_space = observations, gym.spaces.Discrete(2)
    for name, learn in VECTORS.items():
        if name != "evaluate":
            with pytest.raises(ValueError, match="^world: got observations .*, must be"):
                learn(env)


# ---------------------------------------------------------------------- afterwards


@pytest.mark.parametrize("name", TABLES)
def test_an_environment_keeps_its_own_generator(name):
    env = Line()
    TABLES[name](env)
    assert env._np_random is None or name == "evaluate"
    env.reset(seed=3)
    own = env.np_random
    before = own.bit_generator.state
    TABLES[name](env)
    assert env.np_random is own and own.bit_generator.state == before
    with pytest.raises(ValueError):
        TABLES[name](Line(r=np.nan) if name != "rollout" else Line(s=9, first=(0, {}), r=None) and Line(first=3))
    assert env.np_random_seed == 3


def test_what_it_draws_from_while_it_learns_is_the_callers():
    one, two = (
        q_learning(w, 0.9, 5, alpha=0.1, epsilon=0.1, rng=rng()) for w in (random_walk(3), MDPEnv(random_walk(3)))
    )
    np.testing.assert_array_equal(one.Q, two.Q)


def test_a_guard_counts():
    guard = Guard(Line(), seed=1)
    assert (guard.episode, guard.reset(), guard.step(np.int64(1))) == (0, 0, (1, 1.0, False, False))
    assert (guard.episode, guard.t) == (1, 1)


def test_an_id_whose_module_is_missing_is_no_environment():
    with pytest.raises(ValueError, match="^world: got 'nosuchmodule:Env-v0', must be a FiniteMDP"):
        q_learning("nosuchmodule:Env-v0", 0.9, 1, alpha=0.5, epsilon=0.1, rng=rng())


def test_more_episodes_than_memory_holds_are_refused():
    with pytest.raises(ValueError, match="^n_episodes: needs an array of 1000000000 numbers"):
        q_learning(random_walk(3), 0.9, 10**9, alpha=0.5, epsilon=0.1, rng=rng())


def test_the_largest_reward_is_kept_whatever_passes_quickly():
    rewards = [0.5, -0.25, 1, np.float32(0.75), -3, 2.5, 3, -3.5, 1]
    env = Line()
    env.step = lambda action: (0, rewards[guard.t - 1], False, False, {})
    guard = Guard(env)
    act, largest = guard.acting(Watch(1)), []
    for r in rewards:
        assert act(None, 0, 0, None) == (0, float(r), False, False)
        largest.append(guard.largest)
    assert largest == [0.5, 0.5, 1.0, 1.0, 3.0, 3.0, 3.0, 3.5, 3.5]


@pytest.mark.parametrize("start", [0, 2, 5])
def test_states_are_counted_from_the_spaces_start(start):
    env = Line()
    env.observation_space = gym.spaces.Discrete(3, start=start)
    guard = Guard(env)
    for s in range(-2, 10):
        guard._step = lambda action, s=s: (s, 0.0, False, False, {})
        act = guard.acting(Watch(1))
        if start <= s < start + 3:
            assert act(None, 0, 0, None)[0] == s - start
        else:
            with pytest.raises(ValueError, match=f"^world: observation {s} in .*, must be in Discrete"):
                act(None, 0, 0, None)


def test_where_no_action_is_best_the_run_is_lost():
    watch = Watch(1)
    assert Guard(Line()).acting(watch)(None, 2, -1, None) == (2, 0.0, False, True)
    assert watch.marks[0] == LOST


def test_observations_take_the_spaces_kind_of_float():
    guard = Guard(Line(vector=True))
    assert [guard._see(s).dtype for s in ([0, 1], np.zeros(2, int), np.zeros(2, np.float64))] == [
        np.float32,
        np.float32,
        float,
    ]
    guard._dtype = np.dtype(int)
    assert guard._see([0, 1]).dtype == float


def test_flags_are_0_or_1():
    guard = Guard(Line())
    for kind in (bool, np.bool_, int, np.int8, np.array, lambda x: np.full(1, x)):
        assert guard._flag("terminated", kind(1)) is True and guard._flag("terminated", kind(0)) is False
    for value in (2, -1, np.array([1, 1]), np.zeros(0, bool), 1.0):
        with pytest.raises(ValueError, match="^world: terminated .* must be True or False"):
            guard._flag("terminated", value)
