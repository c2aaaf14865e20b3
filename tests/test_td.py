import numpy as np
import pytest

from rlcore.bellman import solve_policy, v_from_q
from rlcore.envs import random_mdp, random_walk, recycling_robot
from rlcore.mdp import FiniteMDP, deterministic_policy, discounted_returns, rollout, uniform_policy
from rlcore.td import mc_prediction, td0


def chain(rewards):
    """State t -> t + 1 with rewards[t]; the last state is terminal."""
    n = len(rewards)
    return FiniteMDP.from_outcomes({(s, 0): [(1.0, s + 1, r)] for s, r in enumerate(rewards)}, start=0, n_states=n + 1)


def bouncer():
    """Visits state 0 three times, then ends: rewards 1, 2, 4. States 0, 1, 2 look alike but are told apart by time."""
    P, R = np.zeros((2, 1, 2)), np.zeros((2, 1, 2))
    P[0, 0], R[0, 0], P[1, 0, 1] = [0.75, 0.25], [1.0, 2.0], 1.0
    return FiniteMDP.from_arrays(P, R, terminal=[False, True], start=0)


@pytest.mark.parametrize("first_visit", [True, False])
def test_one_episode_of_a_chain_gives_its_returns(first_visit):
    rewards = [-1.0, 2.0, 6.0, 3.0, 2.0]
    mdp = chain(rewards)
    args = dict(first_visit=first_visit, max_steps=10, rng=np.random.default_rng(0))
    run = mc_prediction(mdp, uniform_policy(mdp), 0.5, 1, **args)
    np.testing.assert_allclose(run.V, [2, 6, 8, 4, 2, 0], rtol=0, atol=0)
    assert run.returns[0] == 12 and run.lengths[0] == 5
    np.testing.assert_array_equal(run.history, [np.zeros(6), run.V])


def test_visits_are_averaged_as_the_box_says():
    """One episode of state 0 at times 0..T-1: first visit keeps G_0, every visit the mean of all G_t."""
    mdp, gamma = bouncer(), 0.9
    pi, seed = uniform_policy(mdp), 11
    rewards = rollout(mdp, pi, 100, s=0, rng=_after_start(mdp, seed)).rewards
    G = discounted_returns(rewards, gamma)
    assert G.size > 2  # a seed whose episode comes back to state 0
    first = mc_prediction(mdp, pi, gamma, 1, max_steps=100, rng=np.random.default_rng(seed))
    every = mc_prediction(mdp, pi, gamma, 1, first_visit=False, max_steps=100, rng=np.random.default_rng(seed))
    np.testing.assert_allclose([first.V[0], every.V[0]], [G[0], G.mean()], rtol=1e-14)


def _after_start(mdp, seed):
    """A generator that has drawn the first state already, as mc_prediction does."""
    rng = np.random.default_rng(seed)
    rng.random()
    return rng


def test_history_is_the_running_average():
    mdp = bouncer()
    run = mc_prediction(mdp, uniform_policy(mdp), 1.0, 50, max_steps=1000, rng=np.random.default_rng(0))
    np.testing.assert_allclose(run.history[1:, 0], np.cumsum(run.returns) / np.arange(1, 51), rtol=1e-12)


@pytest.mark.parametrize("first_visit", [True, False])
def test_random_walk_converges(first_visit):
    """True values i / 6. Worst error over 20 seeds 0.0106; averaging only half of each return gives 0.4."""
    mdp = random_walk(5)
    args = dict(first_visit=first_visit, max_steps=10_000, rng=np.random.default_rng(1))
    run = mc_prediction(mdp, uniform_policy(mdp), 1.0, 20_000, **args)
    assert np.abs(run.V[1:6] - np.arange(1, 6) / 6).max() < 0.02


def test_action_values_average_to_state_values():
    """v_pi from Q. Worst error over 20 seeds 0.08 (values about 2); a gamma of 0.8 instead of 0.9 is off by 1."""
    mdp = ending(random_mdp(4, 3, rng=np.random.default_rng(5)))
    pi = uniform_policy(mdp)
    run = mc_prediction(mdp, pi, 0.9, 20_000, target="q", max_steps=10_000, rng=np.random.default_rng(0))
    assert run.V is None and run.Q.shape == (5, 3)
    assert np.abs(v_from_q(run.Q, pi) - solve_policy(mdp, pi, 0.9)).max() < 0.2


def ending(mdp):
    """The same process with a chance of 1/5 to end at every step, in one more state."""
    S, A = mdp.n_states, mdp.n_actions
    P, R = np.zeros((S + 1, A, S + 1)), np.zeros((S + 1, A))
    P[:S, :, :S], P[:S, :, S], R[:S] = 0.8 * mdp.transition_probs(), 0.2, 1 + mdp.expected_reward()
    return FiniteMDP.from_arrays(P, R, terminal=np.arange(S + 1) == S)


def test_a_deterministic_policy_leaves_gaps():
    mdp = recycling_robot()
    args = dict(target="q", max_steps=50, rng=np.random.default_rng(0))
    Q = mc_prediction(mdp, deterministic_policy(mdp, [0, 2]), 0.9, 100, **args).Q
    assert Q[0, 1] == Q[1, 0] == Q[1, 1] == 0 and Q[0, 0] > 5 and Q[1, 2] > 5
    assert Q[0, 2] == -np.inf  # no recharging when the charge is high


def test_a_cut_episode_counts_up_to_the_cut():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)]})
    run = mc_prediction(mdp, np.ones((1, 1)), 0.5, 3, max_steps=4, rng=np.random.default_rng(0))
    assert run.V[0] == 1 + 0.5 + 0.25 + 0.125 and (run.lengths == 4).all() and (run.returns == 4).all()


def test_td0_on_a_chain_by_hand():
    """Each step V(s) += alpha (r + gamma V(s') - V(s)) with the values of that moment; the end counts 0."""
    mdp = chain([1.0, -2.0, 4.0])
    run = td0(mdp, uniform_policy(mdp), 0.5, 2, alpha=0.1, V0=1.0, rng=np.random.default_rng(0))
    V = np.array([1.0, 1.0, 1.0, 0.0])
    for episode in (1, 2):
        for s, r in enumerate([1.0, -2.0, 4.0]):
            V[s] += 0.1 * (r + 0.5 * V[s + 1] - V[s])
        np.testing.assert_allclose(run.history[episode], V, rtol=1e-14)
    np.testing.assert_array_equal(run.history[0], [1, 1, 1, 0])
    np.testing.assert_array_equal(run.V, run.history[-1])
    assert (run.lengths == 3).all() and (run.returns == 3).all()


def test_td0_with_step_one_and_gamma_zero_keeps_the_last_reward():
    mdp = chain([1.0, -2.0, 4.0])
    run = td0(mdp, uniform_policy(mdp), 0.0, 1, alpha=1.0, V0=9.0, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(run.V, [1, -2, 4, 0])


def test_td0_random_walk():
    """Sutton and Barto (2018), example 6.2. Worst error over 20 seeds 0.06 with alpha 0.01; V0 is off by 0.33."""
    mdp = random_walk(5)
    run = td0(mdp, uniform_policy(mdp), 1.0, 5000, alpha=0.01, V0=0.5, rng=np.random.default_rng(0))
    assert np.abs(run.V[1:6] - np.arange(1, 6) / 6).max() < 0.1


def test_a_cut_bootstraps_and_an_end_does_not():
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)]})
    run = td0(mdp, np.ones((1, 1)), 0.5, 1, alpha=1.0, V0=10.0, max_steps=1, rng=np.random.default_rng(0))
    assert run.V[0] == 1 + 0.5 * 10 and run.lengths[0] == 1
    mdp = chain([1.0])
    run = td0(mdp, np.ones((2, 1)), 0.5, 1, alpha=1.0, groups=[0, 0], V0=10.0, rng=np.random.default_rng(0))
    assert run.V[0] == 1 and run.V[1] == 0  # though the end shares a group with a value of 10


def test_groups_share_one_value():
    """The fixed point of TD(0) with two groups is 5/11 and 6/11: visits weigh the two ends of each group.

    Worst error over 20 seeds 0.05; the average of each group's true values would be 3/11 and 8/11, V0 is off by 0.55.
    """
    mdp = random_walk(10)
    groups = np.r_[0, np.repeat([0, 1], 5), 1]
    args = dict(alpha=0.002, V0=0.0, record=100, rng=np.random.default_rng(0))
    run = td0(mdp, uniform_policy(mdp), 1.0, 3000, groups=groups, **args)
    assert np.unique(run.V[1:6]).size == np.unique(run.V[6:11]).size == 1
    assert run.V[0] == run.V[11] == 0 and run.history.shape == (31, 12)
    np.testing.assert_allclose(run.V[[1, 6]], [5 / 11, 6 / 11], atol=0.08)
    own = td0(mdp, uniform_policy(mdp), 1.0, 50, alpha=0.1, rng=np.random.default_rng(0))
    same = td0(mdp, uniform_policy(mdp), 1.0, 50, alpha=0.1, groups=range(12), rng=np.random.default_rng(0))
    np.testing.assert_array_equal(own.history, same.history)


def test_groups_reach_the_fixed_point_of_their_own_equation():
    """sum over the states s of a group of d(s) (r + w(s') - w(s)) = 0, d expected visits. Seeds 0..9: within 0.02."""
    mdp, gamma = random_walk(10), 1.0
    P, r = mdp.transition_probs()[1:11, 0], mdp.expected_reward()[1:11, 0]
    visits = np.linalg.solve(np.eye(10) - P[:, 1:11].T, mdp.start[1:11])
    X = np.kron(np.eye(2), np.ones((5, 1)))  # (10, 2), the group of each state
    w = np.linalg.solve(X.T @ (visits[:, None] * (X - gamma * P[:, 1:11] @ X)), X.T @ (visits * r))
    groups = np.r_[0, np.repeat([0, 1], 5), 1]
    run = td0(mdp, uniform_policy(mdp), gamma, 20_000, alpha=0.001, V0=0.5, groups=groups, rng=np.random.default_rng(0))
    np.testing.assert_allclose(run.V[[1, 6]], w, atol=0.04)


def test_same_rng_same_run():
    mdp = random_walk(5)
    for learn in (
        lambda rng: mc_prediction(mdp, uniform_policy(mdp), 0.9, 20, max_steps=1000, rng=rng),
        lambda rng: td0(mdp, uniform_policy(mdp), 0.9, 20, alpha=0.1, record=0, rng=rng),
    ):
        one, two = learn(np.random.default_rng(3)), learn(np.random.default_rng(3))
        np.testing.assert_array_equal(one.V, two.V)
        np.testing.assert_array_equal(one.lengths, two.lengths)
    assert one.history is None


BAD = [
    (mc_prediction, dict(target="w"), "target"),
    (mc_prediction, dict(max_steps=0), "max_steps"),
    (mc_prediction, dict(world="robot"), "world"),
    (mc_prediction, dict(n_episodes=0), "n_episodes"),
    (mc_prediction, dict(gamma=1.5), "gamma"),
    (mc_prediction, dict(pi=np.ones((2, 2))), "pi"),
    (td0, dict(alpha=0.0), "alpha"),
    (td0, dict(alpha=np.nan), "alpha"),
    (td0, dict(max_steps=None), "max_steps"),
    (td0, dict(groups=[0]), "groups"),
    (td0, dict(groups=[0, -1]), "groups"),
    (td0, dict(groups=[0, 0], V0=[1.0, 2.0]), "V0"),
    (td0, dict(V0=[1.0, 2.0, 3.0]), "V0"),
    (td0, dict(record=-1), "record"),
    (td0, dict(world=3), "world"),
]


@pytest.mark.parametrize("learn, wrong, name", BAD)
def test_bad_input_names_the_argument(learn, wrong, name):
    mdp = recycling_robot()
    args = dict(world=mdp, pi=uniform_policy(mdp), gamma=0.9, n_episodes=5, max_steps=10) | (
        dict(alpha=0.1) if learn is td0 else {}
    )
    with pytest.raises(ValueError, match=f"^{name}: "):
        learn(**(args | wrong), rng=np.random.default_rng(0))
