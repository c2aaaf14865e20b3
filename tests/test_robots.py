import numpy as np
import pytest

from rlcore.bellman import greedy_actions, solve_policy
from rlcore.dp import value_iteration
from rlcore.envs import (
    arm_motion,
    balance,
    can_robot,
    cartpole_step,
    myopic,
    pick_and_place,
    pole_balancing,
    pole_continuing,
    pole_return,
    push_pole,
    recycling_robot,
    steps_upright,
)
from rlcore.envs.robots import BINNED, HELD
from rlcore.mdp import discounted_return, discounted_returns, rollout, uniform_policy


def rng(seed=0):
    return np.random.default_rng(seed)


# ---------------------------------------------------------------------- recycling robot


def test_recycling_robot_values():
    """Exact: v(high) = 2 + 0.9 (0.9 v(high) + 0.1 v(low)), v(low) = 0.9 v(high)."""
    best = value_iteration(recycling_robot(), 0.9, tol=1e-12)
    np.testing.assert_allclose(best.V, [2 / 0.109, 1.8 / 0.109], rtol=1e-9)
    np.testing.assert_allclose(best.Q[1], [15.5229, 15.8624, 16.5138], atol=1e-4)
    assert best.pi.argmax(axis=1).tolist() == [0, 2]
    kind = value_iteration(recycling_robot(beta=0.9), 0.9)
    np.testing.assert_allclose(kind.Q[1, [0, 2]], [16.6071, 16.5536], atol=1e-4)
    mdp = recycling_robot()
    np.testing.assert_allclose(solve_policy(mdp, uniform_policy(mdp), 0.9), [14.0708, 12.0059], atol=1e-4)


def test_recycling_robot_dynamics():
    mdp = recycling_robot(alpha=0.7, beta=0.2, r_search=5.0, r_wait=0.5, r_rescue=-7.0)
    high, low, search, wait, recharge = 0, 1, 0, 1, 2
    table = [
        (high, 5.0, high, search, 0.7),
        (low, 5.0, high, search, 0.3),
        (low, 5.0, low, search, 0.2),
        (high, -7.0, low, search, 0.8),
        (high, 0.5, high, wait, 1.0),
        (low, 0.5, low, wait, 1.0),
        (high, 0.0, low, recharge, 1.0),
    ]
    for s_next, r, s, a, p in table:
        assert mdp.p(s_next, r, s, a) == pytest.approx(p, abs=1e-15)
    assert mdp.legal.tolist() == [[True, True, False], [True, True, True]] and mdp.start.tolist() == [1, 0]


@pytest.mark.parametrize("name, value", [("alpha", 1.5), ("beta", -0.1), ("beta", np.nan)])
def test_recycling_robot_rejects(name, value):
    with pytest.raises(ValueError, match=f"^{name}: "):
        recycling_robot(**{name: value})


# ---------------------------------------------------------------------- pick and place


@pytest.mark.parametrize("jerk, value", [(0, 3.236), (0.05, 2.504), (0.1, 1.943), (0.2, 1.928), (0.5, 1.928)])
def test_pick_and_place_values(jerk, value):
    assert value_iteration(pick_and_place(jerk=jerk), 0.95).V[0] == pytest.approx(value, abs=6e-4)


def test_pick_and_place_by_hand():
    """Without jerk a round trip takes 6 steps, with slow moves 10; +1 comes at the end of the first half."""
    best = value_iteration(pick_and_place(jerk=0.0), 0.95, tol=1e-12)
    assert best.V[0] == pytest.approx(0.95**3 / (1 - 0.95**6), rel=1e-9)
    slow = value_iteration(pick_and_place(jerk=1.0), 0.95, tol=1e-12)
    assert slow.V[0] == pytest.approx(0.95**5 / (1 - 0.95**10), rel=1e-9)


def test_pick_and_place_policies():
    mdp = pick_and_place(jerk=0.1)
    fast = greedy_actions(value_iteration(mdp, 0.95).Q)[:, 2:4].any(axis=1)
    assert [name for name, yes in zip(mdp.state_names, fast) if yes] == ["2 holding"]
    assert not greedy_actions(value_iteration(pick_and_place(jerk=0.2), 0.95).Q)[:, 2:4].any()
    assert mdp.p(0, -1.0, 1, 2) == 0.1 and mdp.p(0, 0.0, 1, 2) == 0.9  # the wall stops it, the jerk costs all the same
    assert mdp.p(3, -1.0, 3, 4) == 1 and mdp.p(5, 0.0, 0, 4) == 1 and mdp.p(4, 1.0, 9, 4) == 1
    with pytest.raises(ValueError, match="^jerk: "):
        pick_and_place(jerk=2)


def test_arm_motion_is_optimal_and_follows_its_dynamics():
    """Any change of the voltages, small and random, makes the total reward smaller."""
    x, v, u, rewards = arm_motion(0.001)
    np.testing.assert_allclose(x[1:], x[:-1] + 0.05 * v[:-1], atol=1e-12)
    np.testing.assert_allclose(v[1:], v[:-1] + 0.05 * (u - v[:-1]), atol=1e-12)
    best = _arm_reward(u, 0.001)
    assert rewards.sum() - (x[-1] - 1) ** 2 == pytest.approx(best, rel=1e-9)
    assert all(_arm_reward(u + 0.01 * rng(k).normal(size=u.size), 0.001) < best for k in range(50))


def _arm_reward(u, smoothness):
    x, v, before, total = 0.0, 0.0, 0.0, 0.0
    for now in u:
        total -= (x - 1) ** 2 + 0.001 * now**2 + smoothness * (now - before) ** 2
        x, v, before = x + 0.05 * v, v + 0.05 * (now - v), now
    return total - (x - 1) ** 2


def test_smoothness_costs_time():
    jumps = [np.abs(np.diff(arm_motion(c)[2])).max() for c in (0, 0.001, 0.1)]
    late = [np.argmax(arm_motion(c)[0] > 0.95) for c in (0, 0.001, 0.1)]
    assert jumps[0] > jumps[1] > jumps[2] and late[0] < late[1] < late[2]
    with pytest.raises(ValueError, match="^smoothness: "):
        arm_motion(-1)


# ---------------------------------------------------------------------- cans


@pytest.mark.long
def test_can_robot_delivers_when_delivery_pays():
    mdp = can_robot()
    best = value_iteration(mdp, 0.95)
    path = rollout(mdp, best.pi, 100, rng=rng())
    assert path.terminated and path.rewards.sum() == 2 and path.actions.size == 20
    assert mdp.state_names[path.states[-1]][1:] == (BINNED, BINNED)


@pytest.mark.long
def test_can_robot_drops_and_picks_again_when_picking_pays():
    mdp = can_robot(reward_for="pick-up")
    path = rollout(mdp, value_iteration(mdp, 0.95).pi, 60, rng=rng())
    assert not path.terminated and path.rewards.sum() == 29
    assert all(BINNED not in mdp.state_names[s][1:] for s in path.states)
    assert {mdp.action_names[a] for a in path.actions[3:]} == {"pick", "drop"}


@pytest.mark.long
def test_can_robot_rules():
    mdp = can_robot()
    index = {state: s for s, state in enumerate(mdp.state_names)}
    up, right, left, pick, drop = 0, 2, 3, 4, 5
    table = [
        ((0, 4, 15), up, (0, 4, 15), -1.0),  # the edge
        ((2, 4, 15), right, (2, 4, 15), -1.0),  # an obstacle
        ((0, 4, 15), left, (0, 4, 15), -1.0),
        ((0, 4, 15), right, (1, 4, 15), 0.0),
        ((19, 4, 15), pick, (19, 4, 15), -1.0),  # the wrong object
        ((15, 4, 15), pick, (15, 4, HELD), 0.0),
        ((0, 4, 15), pick, (0, 4, 15), 0.0),
        ((24, 4, HELD), drop, (24, 4, BINNED), 1.0),
        ((23, 4, HELD), drop, (23, 4, 23), 0.0),
    ]
    for state, a, state_next, r in table:
        assert mdp.p(index[state_next], r, index[state], a) == 1, (state, a)
    paid = can_robot(reward_for="pick-up")
    index = {state: s for s, state in enumerate(paid.state_names)}
    assert paid.p(index[15, 4, HELD], 1.0, index[15, 4, 15], pick) == 1
    with pytest.raises(ValueError, match="^reward_for: "):
        can_robot(reward_for="nothing")


# ---------------------------------------------------------------------- pole


def test_pole_return_by_hand():
    assert pole_return(10, 0.9) == pytest.approx(-0.3874, abs=5e-5)
    assert pole_return(10, 0.9, again=True) == pytest.approx(-0.5948, abs=5e-5)
    rewards = np.tile(np.r_[np.zeros(9), -1.0], 60)
    assert pole_return(10, 0.9, again=True) == pytest.approx(discounted_return(rewards, 0.9), rel=1e-12)
    assert pole_return(7, 1.0) == -1 and pole_return(7, 1.0, again=True) == -np.inf
    assert (np.diff(pole_return(np.arange(1, 100), 0.9)) > 0).all()
    for wrong in (0, [3, 0.5]):
        with pytest.raises(ValueError, match="^fail_step: "):
            pole_return(wrong, 0.9)


def random_push(state, rng):
    return int(rng.random() * 2)


def test_random_policy_holds_the_pole_for_22_steps():
    """Concordance: 22.1 steps. Standard error of 500 episodes about 0.5; always pushing left gives 9."""
    run = pole_balancing(random_push, 500, max_steps=200, rng=rng())
    assert abs(run.lengths.mean() - 22.1) < 2.5
    np.testing.assert_array_equal(run.returns, run.lengths)
    assert abs(pole_balancing(lambda state, rng: 0, 50, max_steps=200, rng=rng()).lengths.mean() - 9.3) < 0.5


def test_pole_is_cut_at_max_steps():
    balanced = pole_balancing(lambda x, rng: int(x[2] + x[3] > 0), 3, max_steps=15, rng=rng())
    assert (balanced.lengths == 15).all()


def test_continuing_pole_restarts():
    """Always left: falls after 8 to 11 steps for ever; G_0 as the renewal formula says. Spread over seeds 0.01."""
    rewards = pole_continuing(lambda state, rng: 0, 2000, rng=rng())
    falls = np.flatnonzero(rewards)
    assert set(np.diff(falls)) <= {8, 9, 10, 11} and set(rewards) == {-1.0, 0.0}
    starts = np.r_[0, falls[:-20] + 1]
    G = discounted_returns(rewards, 0.9)[starts].mean()
    K = np.diff(np.r_[-1, falls])
    assert pytest.approx(-np.mean(0.9 ** (K - 1)) / (1 - np.mean(0.9**K)), abs=0.01) == G


def test_push_pole_follows_the_dynamics_to_the_fall():
    states = push_pole([0, 1, 1])
    assert states.shape == (13, 4) and states[0].tolist() == [0, 0, 0.04, 0]
    for t, a in enumerate(np.repeat([0, 1, 1], 4)):
        np.testing.assert_allclose(states[t + 1], cartpole_step(states[t], a), rtol=1e-6)
    fallen = push_pole([0] * 10)
    assert len(fallen) < 41 and abs(fallen[-1, 2]) > np.radians(12) > abs(fallen[-2, 2])


# ---------------------------------------------------------------------- myopic


@pytest.mark.parametrize("gamma", [0.0, 0.4, 0.46, 0.47, 0.9, 1.0])
def test_myopic_choice(gamma):
    best = value_iteration(myopic(), gamma)
    assert best.V[0] == pytest.approx(max(1, 10 * gamma**3), rel=1e-9)
    assert best.pi[0].argmax() == (gamma > 0.1 ** (1 / 3))


@pytest.mark.parametrize("call, message", [
    (lambda: pole_balancing(0, 1, max_steps=5, rng=rng()), "policy: got 0, must be a function"),
    (lambda: pole_balancing(lambda x, rng: 0, 1, max_steps=None, rng=rng()), "max_steps: got None"),
    (lambda: pole_continuing("left", 5, rng=rng()), "policy: got 'left', must be a function"),
    (lambda: balance(1, rng=rng()), "choose: got 1, must be a function"),
    (lambda: balance(lambda x: 0, 1.5, rng=rng()), "n_steps: got 1.5"),
    (lambda: steps_upright(1, np.zeros((1, 4)), 5), "choose: got 1, must be a function"),
])  # fmt: skip
def test_a_policy_that_is_no_function_is_refused(call, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        call()
