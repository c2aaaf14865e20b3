"""Surrogates, bounds, exact steps, line search and trust region: identities, closed forms, then the bound on many."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from rlcore import envs
from rlcore import trust_region as sur
from rlcore.distributions import Categorical
from rlcore.dp import policy_iteration
from rlcore.mdp import FiniteMDP, uniform_policy
from rlcore.policies import softmax_policy
from rlcore.policy_gradient import policy_gradient_exact


def rng(seed=0):
    return np.random.default_rng(seed)


def process(rng):
    """4 states, 3 actions, rewards between 0 and 1."""
    return FiniteMDP.from_arrays(rng.dirichlet(np.ones(4), size=(4, 3)), rng.random((4, 3)))


def policies(rng, n=2):
    return rng.dirichlet(np.ones(3), size=(n, 4))


MDP, (PI, NEW) = process(rng()), policies(rng(1))
OLD = sur.old_policy(MDP, PI, 0.9)
GRID = envs.gridworld()
WORLDS = {"random": (MDP, 0.9), "robot": (envs.recycling_robot(), 0.8), "grid": (envs.gridworld(), 1.0)}


def scaled(mdp, factor):
    return FiniteMDP.from_arrays(mdp.transition_probs(), factor * mdp.expected_reward(), start=mdp.start)


# ---------------------------------------------------------------------- at the old policy


@pytest.mark.parametrize("world", WORLDS)
def test_the_policy_average_of_the_advantage_is_0(world):
    mdp, gamma = WORLDS[world]
    pi = uniform_policy(mdp)
    A = sur.advantage(mdp, pi, gamma)
    assert (np.isneginf(A) == ~mdp.legal).all()
    assert np.abs((pi * np.where(mdp.legal, A, 0)).sum(axis=1)).max() < 1e-12
    old = sur.old_policy(mdp, pi, gamma)
    assert_allclose(old.A[mdp.legal], A[mdp.legal], atol=1e-12)
    assert sur.surrogate(old, pi) == pytest.approx(0, abs=1e-12)


def test_the_best_advantage_of_an_optimal_policy_is_0():
    A = sur.advantage(MDP, policy_iteration(MDP, 0.9).pi, 0.9)
    assert_allclose(A.max(axis=1), 0, atol=1e-12)
    assert A.min() < -0.01


@pytest.mark.parametrize("world", WORLDS)
def test_visits_count_the_discounted_steps(world):
    mdp, gamma = WORLDS[world]
    pi = uniform_policy(mdp)
    old, P = sur.old_policy(mdp, pi, gamma), np.einsum("sa,sat->st", pi, mdp.transition_probs())
    at, visits = mdp.start.copy(), np.zeros(mdp.n_states)
    for t in range(3000):
        visits += gamma**t * np.where(mdp.terminal, 0, at)
        at = at @ P
    assert_allclose(old.visits, visits, atol=1e-9)
    assert old.weight.sum() == pytest.approx(1)
    assert old.eta == pytest.approx(visits @ (pi * mdp.expected_reward()).sum(axis=1))  # eta is what the visits earn
    if gamma < 1 and not mdp.terminal.any():
        assert visits.sum() == pytest.approx(1 / (1 - gamma))


# ---------------------------------------------------------------------- objectives


def test_the_surrogate_is_the_mean_ratio_times_advantage_of_samples():
    states, r = rng(2).choice(4, p=OLD.weight, size=200_000), rng(3)
    actions = np.array([r.choice(3, p=PI[s], size=(states == s).sum()) for s in range(4)], dtype=object)
    s = np.repeat(np.arange(4), [len(a) for a in actions])
    a = np.concatenate(actions).astype(int)
    samples = NEW[s, a] / PI[s, a] * OLD.A[s, a]
    assert abs(samples.mean() - sur.surrogate(OLD, NEW)) < 4 * samples.std() / np.sqrt(samples.size)


def test_policies_of_single_precision_are_what_they_round():
    old, single = sur.old_policy(MDP, PI, 0.9), np.array([PI, NEW], np.float32)
    exact = single / single.sum(axis=-1, keepdims=True, dtype=float)
    assert_allclose(sur.surrogate(old, single), sur.surrogate(old, exact), rtol=1e-14)
    for beyond in (single * np.float32(1.00005), exact * (1 + 5e-9)):
        with pytest.raises(ValueError, match="^pi: has a row"):
            sur.surrogate(old, beyond)


def test_the_surrogate_with_the_new_states_is_the_whole_difference():
    """Kakade and Langford's identity: eta(new) - eta(old) = sum over s of visits_new(s) sum over a of pi_new A_old."""
    new = sur.old_policy(MDP, NEW, 0.9)
    assert new.visits @ (NEW * OLD.A).sum(axis=1) == pytest.approx(new.eta - OLD.eta, abs=1e-12)
    assert sur.local_performance(OLD, NEW) - OLD.eta == pytest.approx(OLD.visits @ (NEW * OLD.A).sum(axis=1), abs=1e-12)
    assert sur.local_performance(OLD, PI) == pytest.approx(OLD.eta, abs=1e-12)


@pytest.mark.parametrize("gamma", [0.5, 0.9])
def test_surrogate_and_performance_have_one_gradient_at_the_old_policy(gamma):
    theta, i = rng(4).normal(size=(3, 4)), (1, 2)
    old = sur.old_policy(MDP, softmax_policy(theta), gamma)
    nudge = np.zeros_like(theta)
    nudge[i] = 1e-5
    slope = (
        np.diff(sur.local_performance(old, [softmax_policy(theta - nudge), softmax_policy(theta + nudge)]))[0] / 2e-5
    )
    assert slope == pytest.approx(policy_gradient_exact(MDP, theta, gamma)[i], rel=1e-7)


def test_kl_is_that_of_the_distributions_and_not_symmetric():
    assert_allclose(sur.kl(OLD, NEW), Categorical(np.log(PI)).kl(Categorical(np.log(NEW))), rtol=1e-12)
    assert_allclose(sur.kl(OLD, PI), 0, atol=1e-15)
    assert sur.mean_kl(OLD, NEW) == pytest.approx(OLD.weight @ sur.kl(OLD, NEW))
    assert sur.max_kl(OLD, NEW) == sur.kl(OLD, NEW).max() > sur.mean_kl(OLD, NEW)
    half, nine = np.full((1, 2), 0.5), np.array([[0.1, 0.9]])
    one = FiniteMDP.from_arrays(np.ones((1, 2, 1)), np.array([[0.0, 1.0]]))
    assert sur.kl(sur.old_policy(one, half, 0.5), nine)[0] == pytest.approx(0.5108, abs=5e-5)
    assert sur.kl(sur.old_policy(one, nine, 0.5), half)[0] == pytest.approx(0.3681, abs=5e-5)


def test_kl_at_the_edges():
    one = FiniteMDP.from_arrays(np.ones((1, 2, 1)), np.array([[0.0, 1.0]]))
    sure, half = np.array([[1.0, 0.0]]), np.full((1, 2), 0.5)
    assert sur.kl(sur.old_policy(one, sure, 0.5), half)[0] == pytest.approx(np.log(2))
    assert sur.mean_kl(sur.old_policy(one, half, 0.5), sure) == np.inf


def test_states_that_are_never_met_count_neither_in_the_mean_nor_in_the_maximum():
    P = np.zeros((3, 2, 3))
    P[0, :, 1] = P[1, :, 0] = P[2, :, 0] = 1
    mdp = FiniteMDP.from_arrays(P, np.eye(3)[:, :2], start=[1.0, 0, 0])
    old, pi = sur.old_policy(mdp, np.full((3, 2), 0.5), 0.9), np.array([[0.5, 0.5], [0.4, 0.6], [1.0, 0.0]])
    assert old.weight[2] == 0 and sur.kl(old, pi)[2] == np.inf
    assert 0 < sur.mean_kl(old, pi) < sur.max_kl(old, pi) < 0.03


def test_many_policies_at_once():
    many = policies(rng(5), 6).reshape(2, 3, 4, 3)
    for f in (sur.surrogate, sur.local_performance, sur.mean_kl, sur.max_kl, sur.lower_bound):
        values = f(OLD, many)
        assert values.shape == (2, 3) and values[1, 2] == pytest.approx(f(OLD, many[1, 2]), abs=1e-12)


# ---------------------------------------------------------------------- the bound


def test_coefficient_of_the_bound():
    assert sur.penalty_coefficient(OLD) == pytest.approx(4 * np.abs(OLD.A).max() * 0.9 / 0.01)
    ten = sur.old_policy(scaled(MDP, 10), PI, 0.9)
    assert sur.penalty_coefficient(ten) == pytest.approx(10 * sur.penalty_coefficient(OLD))


def test_the_bound_touches_at_the_old_policy_and_is_never_violated():
    r, smallest = rng(6), np.inf
    for _ in range(300):
        mdp, (pi, new) = process(r), policies(r)
        old = sur.old_policy(mdp, pi, 0.9)
        near = 0.99 * pi + 0.01 * new
        assert sur.lower_bound(old, pi) == pytest.approx(old.eta, abs=1e-10)
        for p in (new, near):
            smallest = min(smallest, sur.eta(mdp, p, 0.9) - sur.lower_bound(old, p))
            assert smallest > -1e-10
    assert smallest < 0.1  # near the old policy the bound is close: the test would see a bound that is too high


def test_a_small_coefficient_breaks_the_bound_and_the_mean_is_below_the_maximum():
    r, broken = rng(7), 0
    for _ in range(200):
        mdp, (pi, new) = process(r), policies(r)
        old = sur.old_policy(mdp, pi, 0.9)
        broken += sur.lower_bound(old, new, 0.0) > sur.eta(mdp, new, 0.9)
        assert sur.mean_kl(old, new) <= sur.max_kl(old, new)
    assert broken > 50  # 99 of 200; with the coefficient of the theorem 0


LINE = (np.zeros((4, 3)), rng(8).normal(size=(4, 3)))


def test_a_line_of_policies():
    theta = np.array([[-1.0, 0.0], [0.5, 2.0]])
    pi = sur.policy_line(*LINE, theta)
    assert pi.shape == (2, 2, 4, 3)
    assert_allclose(pi[0, 1], 1 / 3)
    assert_allclose(pi[1, 1], softmax_policy(2.0 * LINE[1].T), atol=1e-12)


def climb(theta, n, C=None, **more):
    def bound(t, new):
        return sur.lower_bound(sur.old_policy(MDP, sur.policy_line(*LINE, t), 0.9), sur.policy_line(*LINE, new), C)

    path = sur.mm_maximise(bound, theta, n, **more)
    return path, np.array([sur.eta(MDP, sur.policy_line(*LINE, t), 0.9) for t in path])


def test_minorize_maximise_never_falls_and_its_steps_are_tiny():
    path, etas = climb(-2.0, 12)
    assert path.shape == (13,) and path[0] == -2.0
    assert (np.diff(etas) >= 0).all() and etas[-1] > etas[0]
    assert 0 < np.abs(np.diff(path)).max() < 0.2


def test_minorize_maximise_with_a_smaller_coefficient_comes_to_a_local_maximum():
    path, etas = climb(-2.0, 60, 0.5)
    line = np.linspace(path[-1] - 0.3, path[-1] + 0.3, 61)
    around = [sur.eta(MDP, sur.policy_line(*LINE, t), 0.9) for t in line]
    assert (np.diff(etas) >= -1e-12).all() and max(around) <= etas[-1] + 1e-6


def test_minorize_maximise_takes_the_best_candidate_within_reach():
    def parabola(t, new):
        return -((new - 1.0) ** 2)

    assert sur.mm_maximise(parabola, 0.0, 3)[-1] == pytest.approx(1.0, abs=1e-2)
    assert_allclose(sur.mm_maximise(parabola, 0.0, 2, reach=0.25), [0, 0.25, 0.5])
    assert_allclose(sur.mm_maximise(parabola, 3.0, 2, reach=0.25), [3, 2.75, 2.5])
    assert_allclose(sur.mm_maximise(lambda t, new: np.zeros_like(new), 0.7, 2), 0.7)


# ---------------------------------------------------------------------- exact steps


@pytest.mark.parametrize("beta", [0.003, 0.1, 1.0, 30.0])
def test_the_penalised_step_is_the_maximum(beta):
    new = sur.penalised_step(OLD, beta)

    def value(pi):
        return sur.surrogate(OLD, pi) - beta * sur.mean_kl(OLD, pi)

    assert_allclose(new.sum(axis=1), 1, rtol=1e-14)
    others = np.array([(1 - t) * new + t * p for t in (1e-4, 1e-2, 1.0) for p in policies(rng(9), 200)])
    assert (value(others) < value(new)).all() and value(new) > 0
    found = minimize(lambda h: -value(softmax_policy(h.reshape(3, 4))), np.zeros(12), tol=1e-14)
    assert -found.fun == pytest.approx(value(new), rel=1e-5)


@pytest.mark.parametrize("beta", [1e-12, 1e-6, 1e6, 1e12])
def test_the_penalised_step_at_its_limits(beta):
    new = sur.penalised_step(OLD, beta)
    assert np.isfinite(new).all() and (new > 0).all()
    if beta < 1:
        assert_allclose(new[np.arange(4), OLD.A.argmax(axis=1)], 1, atol=1e-4)
    else:
        assert_allclose(new, PI, atol=1e-5)
        assert_allclose(new - PI, PI * OLD.A / beta, rtol=1e-4, atol=1e-15)  # first order in 1 / beta


def test_the_penalised_step_of_two_actions_in_closed_form():
    """pi = 1/2, A = (-a, a): lambda = (beta + sqrt(beta^2 + 4 a^2)) / 2."""
    one = FiniteMDP.from_arrays(np.ones((1, 2, 1)), np.array([[0.0, 1.0]]))
    old, beta = sur.old_policy(one, np.full((1, 2), 0.5), 0.0), 0.3
    lam = (beta + np.sqrt(beta**2 + 4 * 0.25)) / 2
    assert_allclose(sur.penalised_step(old, beta), [[0.5 * beta / (lam + 0.5), 0.5 * beta / (lam - 0.5)]], rtol=1e-12)


def test_actions_that_are_not_legal_stay_so():
    robot = envs.recycling_robot()
    old = sur.old_policy(robot, uniform_policy(robot), 0.9)
    new, _ = sur.constrained_step(old, 0.01)
    assert (new[~robot.legal] == 0).all() and (new[robot.legal] > 0).all()


@pytest.mark.parametrize("delta", [1e-6, 0.01, 1.0])
def test_the_constrained_step_uses_up_its_constraint(delta):
    new, beta = sur.constrained_step(OLD, delta)
    assert sur.mean_kl(OLD, new) == pytest.approx(delta, rel=1e-6)
    assert_allclose(new, sur.penalised_step(OLD, beta), rtol=1e-12)
    for p in policies(rng(10), 300):  # the same distance in another direction gains less
        low, high = 0.0, 1.0
        for _ in range(50):
            t = (low + high) / 2
            low, high = (t, high) if sur.mean_kl(OLD, (1 - t) * PI + t * p) < delta else (low, t)
        assert sur.surrogate(OLD, (1 - low) * PI + low * p) <= sur.surrogate(OLD, new) + 1e-12


def test_the_constrained_step_does_not_see_the_scale_of_the_rewards_and_the_penalised_one_does():
    kls = []
    new, beta = sur.constrained_step(OLD, 0.01)
    for factor in (1, 10, 100):
        old = sur.old_policy(scaled(MDP, factor), PI, 0.9)
        other, other_beta = sur.constrained_step(old, 0.01)
        assert_allclose(other, new, rtol=1e-7)
        assert other_beta == pytest.approx(factor * beta, rel=1e-6)
        kls.append(sur.mean_kl(old, sur.penalised_step(old, 1.0)))
    assert kls[0] < 0.1 < kls[1] < 1 < kls[2]


def test_nothing_to_gain_nothing_changes():
    flat = FiniteMDP.from_arrays(MDP.transition_probs(), np.ones((4, 3)))
    old = sur.old_policy(flat, PI, 0.9)
    new, beta = sur.constrained_step(old, 0.01)
    assert_allclose(new, PI)
    assert beta == np.inf
    assert_allclose(sur.penalised_step(old, 1.0), PI, rtol=1e-9)


@pytest.mark.parametrize("kl, after", [(0.0066, 2.0), (0.0067, 4.0), (0.0149, 4.0), (0.0151, 8.0), (0.0, 2.0)])
def test_the_coefficient_adapts(kl, after):
    assert sur.adapt_beta(4.0, kl, 0.01) == after


def test_ascents_keep_their_books():
    fixed = sur.penalised_ascent(MDP, PI, 0.9, 5, beta=1.0)
    assert fixed.eta.shape == (6,) and fixed.kl.shape == fixed.beta.shape == (5,) and (fixed.beta == 1).all()
    assert fixed.eta[0] == pytest.approx(OLD.eta) and fixed.eta[5] == pytest.approx(sur.eta(MDP, fixed.pi, 0.9))
    assert fixed.kl[0] == pytest.approx(sur.mean_kl(OLD, sur.penalised_step(OLD, 1.0)))
    assert fixed.eta[1] == pytest.approx(sur.eta(MDP, sur.penalised_step(OLD, 1.0), 0.9))
    hard = sur.constrained_ascent(MDP, PI, 0.9, 5, delta=0.01)
    assert_allclose(hard.kl, 0.01, rtol=1e-6)
    assert hard.beta[0] == pytest.approx(sur.constrained_step(OLD, 0.01)[1])
    assert hard.eta[5] == pytest.approx(sur.eta(MDP, hard.pi, 0.9)) and (np.diff(hard.eta) > 0).all()
    adaptive = sur.penalised_ascent(scaled(MDP, 10), np.full((4, 3), 1 / 3), 0.9, 8, beta=1.0, d_target=0.01)
    betas = [1.0]
    for d in adaptive.kl:
        betas.append(sur.adapt_beta(betas[-1], d, 0.01))
    assert_allclose(adaptive.beta, betas[:-1])
    assert adaptive.kl[0] > 0.5 and adaptive.kl[2:].max() < 0.015 and adaptive.beta[3] == 4


@pytest.mark.parametrize("factor", [1, 10, 100])
def test_beta_adapts_to_the_scale_of_the_rewards(factor):
    old, beta = sur.old_policy(scaled(MDP, factor), np.full((4, 3), 1 / 3), 0.9), 1.0
    for _ in range(12):
        d = sur.mean_kl(old, sur.penalised_step(old, beta))
        beta = sur.adapt_beta(beta, d, 0.01)
    # KL falls as 1 / beta^2: a factor of 2 is one of 4, more than the band is wide, so that beta may go to and fro
    assert 0.01 / 4 < d < 4 * 0.01 and factor <= beta < 3 * factor


def test_an_action_that_is_never_taken_stays_so():
    old = sur.old_policy(MDP, np.tile([0.5, 0.5, 0.0], (4, 1)), 0.9)
    new = sur.penalised_step(old, 0.5)
    assert (new[:, 2] == 0).all() and (new[:, :2] > 0).all() and sur.surrogate(old, new) > 0
    assert np.isfinite(sur.mean_kl(old, new))


# ---------------------------------------------------------------------- line search and trust region

PEAK = np.array([[3.0, 1.0], [1.0, 2.0]])


def hill(x):
    return -0.5 * x @ PEAK @ x


def valley(x):
    """Minus the function of Rosenbrock: 0 at (1, 1)."""
    return -((1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2)


def slope_of_valley(x):
    return np.array([2 * (1 - x[0]) + 400 * x[0] * (x[1] - x[0] ** 2), -200 * (x[1] - x[0] ** 2)])


def curve_of_valley(x):
    return np.array([[-2 + 400 * (x[1] - 3 * x[0] ** 2), 400 * x[0]], [400 * x[0], -200.0]])


def test_line_search_takes_the_first_step_that_is_good_enough():
    x, tried = np.array([1.0, -2.0]), []
    g = -PEAK @ x
    t, after = sur.backtracking_line_search(lambda y: tried.append(y) or hill(y), x, 10 * g, 10 * g @ g)
    assert t in 0.5 ** np.arange(1, 10)
    assert_allclose(after, x + 10 * t * g)
    assert (
        hill(after) >= hill(x) + 1e-4 * t * 10 * g @ g
        and hill(x + 2 * t * 10 * g) < hill(x) + 1e-4 * 2 * t * 10 * g @ g
    )
    assert len(tried) == 2 + round(np.log2(1 / t))
    demanding, _ = sur.backtracking_line_search(hill, x, 10 * g, 10 * g @ g, c=0.9)
    assert demanding < t
    for c in (0.2, 0.5, 0.9):
        good = [k for k in range(30) if hill(x + 10 * 0.5**k * g) >= hill(x) + c * 0.5**k * 10 * g @ g]
        assert sur.backtracking_line_search(hill, x, 10 * g, 10 * g @ g, c=c)[0] == 0.5 ** good[0]
    assert sur.backtracking_line_search(hill, x, 0.01 * g, 0.01 * g @ g)[0] == 1.0
    assert sur.backtracking_line_search(hill, x, 10 * g, 10 * g @ g, shrink=0.1)[0] in (0.1, 0.01)


def test_line_search_gives_up_where_nothing_is_good():
    t, after = sur.backtracking_line_search(lambda x: -np.abs(x).sum(), [0.0], [1.0], 1.0)
    assert t == 0 and after == [0.0]


def brute(g, H, radius):
    """The best point of a fine polar grid on the disc."""
    r, a = np.meshgrid(np.linspace(0, radius, 200), np.linspace(0, 2 * np.pi, 721))
    p = np.stack([r * np.cos(a), r * np.sin(a)], axis=-1).reshape(-1, 2)
    return (p @ g + 0.5 * np.einsum("ni,ij,nj->n", p, H, p)).max()


CASES = {
    "top inside": ([1.0, 0.5], -PEAK, 2.0),
    "top outside": ([5.0, 5.0], -PEAK, 0.5),
    "saddle": ([1.0, 1.0], [[1.0, 0.0], [0.0, -2.0]], 1.0),
    "bowl": ([0.3, -0.1], PEAK, 1.0),
    "hard case": ([0.0, 1.0], [[2.0, 0.0], [0.0, -1.0]], 1.5),
    "no slope on a bowl": ([0.0, 0.0], PEAK, 1.0),
    "flat": ([0.6, 0.8], [[0.0, 0.0], [0.0, 0.0]], 2.0),
    "flat along one axis": ([0.0, 1.0], [[0.0, 0.0], [0.0, -1.0]], 2.0),
}


@pytest.mark.parametrize("case", CASES)
def test_trust_region_step_is_the_best_point_of_the_disc(case):
    g, H, radius = np.array(CASES[case][0]), np.array(CASES[case][1]), CASES[case][2]
    p = sur.trust_region_step(g, H, radius)
    assert np.linalg.norm(p) <= radius * (1 + 1e-9)
    value = g @ p + 0.5 * p @ H @ p
    assert value >= brute(g, H, radius) - 1e-12
    assert value <= brute(g, H, radius) + 2e-3 * radius * (np.linalg.norm(g) + np.linalg.norm(H) * radius)


def test_trust_region_step_inside_is_newtons():
    g = np.array([1.0, 0.5])
    assert_allclose(sur.trust_region_step(g, -PEAK, 2.0), np.linalg.solve(PEAK, g), rtol=1e-12)
    assert_allclose(sur.trust_region_step(g, -1e-3 * np.eye(2), 0.1), 0.1 * g / np.linalg.norm(g), rtol=1e-3)


def test_trust_region_ascent_grows_and_shrinks_and_never_falls():
    xs, radii = sur.trust_region_ascent(
        valley, slope_of_valley, curve_of_valley, [-1.2, 1.0], 40, radius=0.5, max_radius=2.0
    )
    values, lengths = np.array([valley(x) for x in xs]), np.linalg.norm(np.diff(xs, axis=0), axis=1)
    assert_allclose(xs[-1], 1.0, atol=1e-8)
    assert (np.diff(values) >= 0).all() and (lengths <= radii[:-1] * (1 + 1e-9)).all()
    steps = set((radii[1:] / radii[:-1]).tolist())
    assert steps == {0.5, 1.0, 2.0} and radii.max() <= 2.0
    model = [slope_of_valley(x) @ p + p @ curve_of_valley(x) @ p / 2 for x, p in zip(xs, np.diff(xs, axis=0))]
    for k, (rise, said) in enumerate(zip(np.diff(values), model)):
        if rise == 0 and lengths[k] == 0 and values[k] < -1e-12:
            assert radii[k + 1] == radii[k] / 2  # a step not taken
        elif said > 1e-9:
            expected = (
                0.5 if rise / said < 0.25 else 2.0 if rise / said > 0.75 and lengths[k] > 0.999 * radii[k] else 1.0
            )
            assert radii[k + 1] == min(expected * radii[k], 2.0)


def test_the_radius_stops_growing_at_its_limit():
    peak = np.array([30.0, 0.0])
    xs, radii = sur.trust_region_ascent(
        lambda x: -0.5 * (x - peak) @ (x - peak),
        lambda x: peak - x,
        lambda x: -np.eye(2),
        [0.0, 0.0],
        8,
        max_radius=4.0,
    )
    assert_allclose(radii, [1, 2, 4, 4, 4, 4, 4, 4, 4])
    assert_allclose(xs[:, 0], [0, 1, 3, 7, 11, 15, 19, 23, 27])


# ---------------------------------------------------------------------- bad input

BAD = {
    "a policy of another shape": (lambda: sur.surrogate(OLD, PI[:2]), "pi: got shape (2, 3), must end in (4, 3)"),
    "rows that do not sum to 1": (lambda: sur.kl(OLD, 0.9 * PI), "pi: has a row that is no distribution"),
    "a negative probability": (lambda: sur.kl(OLD, np.tile([1.5, -0.5, 0.0], (4, 1))), "pi: has a row that is no"),
    "an old policy of another shape": (lambda: sur.old_policy(MDP, PI[:, :2], 0.9), "pi: got shape (4, 2)"),
    "gamma above 1": (lambda: sur.old_policy(MDP, PI, 1.1), "gamma: got 1.1"),
    "the bound without discount": (
        lambda: sur.lower_bound(sur.old_policy(GRID, uniform_policy(GRID), 1.0), uniform_policy(GRID)),
        "gamma: got 1, must be below 1",
    ),
    "a negative coefficient": (lambda: sur.lower_bound(OLD, PI, -1.0), "C: got -1.0, must be a number of at least 0"),
    "beta 0": (lambda: sur.penalised_step(OLD, 0), "beta: got 0, must be a positive number"),
    "beta nan": (lambda: sur.penalised_step(OLD, float("nan")), "beta: got nan"),
    "beta in words": (lambda: sur.penalised_step(OLD, "one"), "beta: got 'one'"),
    "beta true": (lambda: sur.penalised_step(OLD, True), "beta: got True"),
    "delta 0": (lambda: sur.constrained_step(OLD, 0.0), "delta: got 0.0, must be a positive number"),
    "an infinite target": (lambda: sur.adapt_beta(1.0, 0.1, float("inf")), "d_target: got inf"),
    "steps 0": (lambda: sur.penalised_ascent(MDP, PI, 0.9, 0, beta=1.0), "n_steps: got 0"),
    "half a step": (lambda: sur.constrained_ascent(MDP, PI, 0.9, 0.5, delta=0.1), "n_steps: got 0.5"),
    "directions of another shape": (lambda: sur.policy_line(PI, PI[:2], 0.0), "direction: got shape (2, 3)"),
    "reach 0": (lambda: sur.mm_maximise(lambda t, new: new, 0.0, 2, reach=0), "reach: got 0"),
    "a bound that is a number": (lambda: sur.mm_maximise(1.0, 0.0, 2), "bound: got 1.0, must be a function"),
    "a hill that is a number": (
        lambda: sur.backtracking_line_search(3, [1.0], [1.0], 1.0),
        "f: got 3, must be a function",
    ),
    "an ascent without f": (
        lambda: sur.trust_region_ascent(3, hill, hill, [1.0, 1.0], 1),
        "f: got 3, must be a function",
    ),
    "an ascent without gradient": (
        lambda: sur.trust_region_ascent(hill, None, hill, [1.0, 1.0], 1),
        "gradient: got None, must be a function",
    ),
    "an ascent with one Hessian": (
        lambda: sur.trust_region_ascent(hill, hill, PEAK, [1.0, 1.0], 1),
        "hessian: got array",
    ),
    "a way down": (lambda: sur.backtracking_line_search(hill, [1.0, 1.0], [1.0, 1.0], -7.0), "slope: got -7.0"),
    "a direction of another shape": (
        lambda: sur.backtracking_line_search(hill, [1.0, 1.0], [1.0], 1.0),
        "direction: got shape (1,), must be that of x",
    ),
    "a step that does not shrink": (
        lambda: sur.backtracking_line_search(hill, [1.0, 1.0], [-1.0, 0.0], 4.0, shrink=1.0),
        "shrink: got 1.0, must be above 0 and below 1",
    ),
    "c 0": (lambda: sur.backtracking_line_search(hill, [1.0, 1.0], [-1.0, 0.0], 4.0, c=0), "c: got 0, must be above 0"),
    "H of another shape": (lambda: sur.trust_region_step([1.0], PEAK, 1.0), "H: got shape (2, 2), must be symmetric"),
    "H that is not symmetric": (
        lambda: sur.trust_region_step([1.0, 0.0], [[1.0, 2.0], [0.0, 1.0]], 1.0),
        "H: got shape (2, 2), must be symmetric",
    ),
    "radius 0": (lambda: sur.trust_region_step([1.0, 0.0], PEAK, 0.0), "radius: got 0.0, must be a positive number"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    call, message = BAD[case]
    with pytest.raises(ValueError) as caught:
        call()
    assert str(caught.value).startswith(message)
