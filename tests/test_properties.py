"""Properties that hold for every finite MDP, tried on random ones."""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from rlcore.bellman import (
    error_bound,
    expectation_backup,
    expectation_backup_q,
    greedy,
    newton_optimality,
    optimality_backup,
    optimality_backup_q,
    policy_error_bound,
    policy_matrix,
    q_from_v,
    solve_policy,
    v_from_q,
)
from rlcore.core.sampling import cumulative
from rlcore.dp import policy_evaluation, policy_improvement, policy_iteration, value_iteration
from rlcore.envs import MDPEnv
from rlcore.mdp import FiniteMDP, discounted_return, discounted_returns, rollout, uniform_policy
from rlcore.solver import solve

QUICK = os.environ.get("RLCORE_QUICK_PROPERTIES") == "1"  # fewer examples, and none is made smaller


def prop(n=60):
    """n examples, the same ones in every run; no database is left behind."""
    slow = [HealthCheck.too_slow, HealthCheck.data_too_large]
    phases = (Phase.explicit, Phase.generate, *(() if QUICK else (Phase.shrink,)))
    return settings(
        max_examples=n // 3 if QUICK else n,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=slow,
        phases=phases,
    )


numbers = st.floats(-100, 100, allow_nan=False).map(lambda x: round(x, 3))
gammas = st.one_of(st.floats(0, 0.99), st.sampled_from([0.0, 0.5, 0.9, 0.99]))
seeds = st.integers(0, 2**32 - 1)


@st.composite
def processes(draw, ends=False):
    """Up to 5 states and 3 actions; illegal actions, repeated outcomes, probabilities near 0 and terminal states.

    ends: every step may go to the last state, which is terminal, and costs something, so that gamma may be 1.
    """
    S, A = draw(st.integers(2 if ends else 1, 5)), draw(st.integers(1, 3))
    terminal = {S - 1} if ends else draw(st.sets(st.integers(0, S - 1), max_size=S - 1))
    rewards = st.floats(-10, -0.5).map(lambda x: round(x, 2)) if ends else st.one_of(st.integers(-2, 2), numbers)
    outcomes = {}
    for s in sorted(set(range(S)) - terminal):
        for a in sorted(draw(st.sets(st.integers(0, A - 1), min_size=1))):
            row = draw(
                st.lists(st.tuples(st.integers(1, 1000), st.integers(0, S - 1), rewards), min_size=1, max_size=4)
            )
            row += [(300, S - 1, -1.0)] if ends else []
            total = sum(weight for weight, _, _ in row)
            outcomes[s, a] = [(weight / total, s_next, float(r)) for weight, s_next, r in row]
    return FiniteMDP.from_outcomes(outcomes, n_states=S, n_actions=A)


def policy(mdp, seed, sharp=False):
    """A random policy; sharp: with zeros."""
    rng = np.random.default_rng(seed)
    weight = rng.random(mdp.legal.shape) * mdp.legal
    weight *= (weight == weight.max(axis=1, keepdims=True)) | (rng.random(weight.shape) < 0.5) if sharp else 1
    return weight / weight.sum(axis=1, keepdims=True)


def values(mdp, seed, scale=20.0):
    return np.where(mdp.terminal, 0.0, np.random.default_rng(seed).normal(scale=scale, size=mdp.n_states))


def action_values(mdp, seed):
    return np.where(mdp.terminal[:, None], 0.0, np.random.default_rng(seed).normal(scale=20.0, size=mdp.legal.shape))


def distance(x, y):
    """Largest difference; actions that are not legal are -inf on both sides."""
    return np.abs(np.subtract(x, y, where=np.isfinite(x) & np.isfinite(y), out=np.zeros(np.shape(x)))).max()


# ---------------------------------------------------------------------- processes


@pytest.mark.long
@prop()
@given(processes(), seeds)
def test_rows_are_distributions(mdp, seed):
    assert_allclose(mdp.transition_probs().sum(axis=2), mdp.legal, atol=1e-12)
    P, _ = policy_matrix(mdp, policy(mdp, seed))
    assert_allclose(P.sum(axis=1), 1.0)
    assert_allclose(uniform_policy(mdp).sum(axis=1), 1.0)
    assert_allclose(np.nansum(mdp.transition_probs() * mdp.expected_reward_sas(), axis=2), mdp.expected_reward())
    cdf = cumulative(mdp.prob)
    assert (np.diff(cdf, axis=2) >= 0).all() and (cdf[:, :, -1] == 1).all()


@pytest.mark.long
@prop()
@given(processes())
def test_round_trips(mdp):
    assert FiniteMDP.from_env(MDPEnv(mdp)) == mdp
    assert FiniteMDP.from_env(MDPEnv(mdp)) == mdp
    table = {
        (s, a): list(zip(mdp.prob[s, a].tolist(), mdp.next_state[s, a].tolist(), mdp.reward[s, a].tolist()))
        for s, a in np.argwhere(mdp.legal & ~mdp.terminal[:, None]).tolist()
    }
    assert FiniteMDP.from_outcomes(table, n_states=mdp.n_states, n_actions=mdp.n_actions, start=mdp.start) == mdp
    P, R = mdp.transition_probs(), np.nan_to_num(mdp.expected_reward_sas())
    merged = FiniteMDP.from_arrays(P, R, terminal=mdp.terminal)  # one outcome a successor, with its mean reward
    assert_allclose(merged.transition_probs(), P)
    V = values(mdp, 0)
    assert_allclose(q_from_v(merged, V, 0.9)[mdp.legal], q_from_v(mdp, V, 0.9)[mdp.legal], atol=1e-10)
    assert FiniteMDP.from_arrays(P, R, terminal=mdp.terminal) == merged


@prop(15)
@given(processes(), seeds)
def test_sampling_frequencies(mdp, seed):
    """Frequencies within 5 standard deviations, and nothing that has probability 0. About 5,000 comparisons: at 5
    deviations one would fail by chance in about 1 of 300 sets of seeds; these pass. Reversed probabilities fail."""
    pi, n = uniform_policy(mdp), 3000
    tau = [rollout(mdp, pi, 20, rng=rng) for rng in np.random.default_rng(seed).spawn(n // 20)]
    s = np.concatenate([t.states[:-1] for t in tau])
    s_next = np.concatenate([t.states[1:] for t in tau])
    a = np.concatenate([t.actions for t in tau])
    P = mdp.transition_probs()
    for i, j in np.unique(np.stack([s, a], 1), axis=0):
        here = (s == i) & (a == j)
        count = np.bincount(s_next[here], minlength=mdp.n_states)
        sd = np.sqrt(here.sum() * P[i, j] * (1 - P[i, j]))
        assert (np.abs(count - here.sum() * P[i, j]) <= 5 * sd + 1).all() and not count[P[i, j] == 0].any()
    first = np.bincount([t.states[0] for t in tau], minlength=mdp.n_states)
    assert (np.abs(first - len(tau) * mdp.start) <= 5 * np.sqrt(len(tau) * mdp.start * (1 - mdp.start))).all()


@prop()
@given(st.lists(numbers, max_size=12), st.floats(0, 1))
def test_returns_are_direct_sums(rewards, gamma):
    G = discounted_returns(rewards, gamma)
    direct = [sum(gamma**k * r for k, r in enumerate(rewards[t:])) for t in range(len(rewards))]
    assert_allclose(G, direct, atol=1e-11)
    assert_allclose([discounted_return(rewards, gamma, t) for t in range(len(rewards))], direct, atol=1e-11)


# ---------------------------------------------------------------------- operators


@prop()
@given(processes(), gammas, seeds)
def test_operators_contract(mdp, gamma, seed):
    x, y, pi = values(mdp, seed), values(mdp, seed + 1), policy(mdp, seed)
    q, w = action_values(mdp, seed), action_values(mdp, seed + 1)
    apart, apart_q = gamma * np.abs(x - y).max() + 1e-12, gamma * np.abs(q - w)[mdp.legal].max() + 1e-12
    assert distance(optimality_backup(mdp, x, gamma), optimality_backup(mdp, y, gamma)) <= apart
    assert distance(expectation_backup(mdp, pi, x, gamma), expectation_backup(mdp, pi, y, gamma)) <= apart
    assert distance(q_from_v(mdp, x, gamma), q_from_v(mdp, y, gamma)) <= apart
    assert distance(optimality_backup_q(mdp, q, gamma), optimality_backup_q(mdp, w, gamma)) <= apart_q
    assert distance(expectation_backup_q(mdp, pi, q, gamma), expectation_backup_q(mdp, pi, w, gamma)) <= apart_q


@prop()
@given(processes(), gammas, seeds)
def test_operators_are_monotone_and_shift_with_constants(mdp, gamma, seed):
    x, pi = values(mdp, seed), policy(mdp, seed)
    higher = x + np.abs(values(mdp, seed + 1)) * (np.random.default_rng(seed).random(x.size) < 0.5)
    backups = (lambda v: optimality_backup(mdp, v, gamma), lambda v: expectation_backup(mdp, pi, v, gamma))
    for backup in backups:
        assert (backup(higher) >= backup(x) - 1e-12).all()
        if not mdp.terminal.any():  # a constant cannot be added where the value is 0 by definition
            assert_allclose(backup(x + 7.5), backup(x) + gamma * 7.5, atol=1e-11)
    assert (optimality_backup(mdp, x, gamma) >= expectation_backup(mdp, pi, x, gamma) - 1e-12).all()


@prop()
@given(processes(), gammas, seeds)
def test_values_solve_their_equations(mdp, gamma, seed):
    pi = policy(mdp, seed, sharp=True)
    v, best = solve_policy(mdp, pi, gamma), newton_optimality(mdp, gamma, 20)[-1]
    assert (1 - gamma) * distance(expectation_backup(mdp, pi, v, gamma), v) < 1e-11
    assert (1 - gamma) * distance(optimality_backup(mdp, best, gamma), best) < 1e-11
    assert (best >= v - 1e-9).all()
    assert_allclose(v_from_q(q_from_v(mdp, v, gamma), pi), v, atol=1e-11 / (1 - gamma))


@prop()
@given(processes(), gammas, seeds)
def test_bounds_of_macqueen_enclose_the_optimum(mdp, gamma, seed):
    """identity.macqueen_bounds: T x + gamma / (1 - gamma) min (T x - x) <= v_* <= the same with max.

    Over the terminal states too, where the change is 0: an absorbing state is a state like any other.
    """
    x = values(mdp, seed)
    v, backed = newton_optimality(mdp, gamma, 20)[-1], optimality_backup(mdp, x, gamma)
    change = backed - x
    assert (backed + gamma / (1 - gamma) * change.min() <= v + 1e-8).all()
    assert (backed + gamma / (1 - gamma) * change.max() >= v - 1e-8).all()


@prop()
@given(processes(), gammas, seeds)
def test_greedy_improvement_never_loses(mdp, gamma, seed):
    pi = policy(mdp, seed, sharp=True)
    v = solve_policy(mdp, pi, gamma)
    slack = 1e-11 * (1 + np.abs(v).max()) / (1 - gamma)
    for new in (
        policy_improvement(mdp, v, gamma),
        policy_improvement(mdp, v, gamma, pi=pi),
        greedy(q_from_v(mdp, v, gamma)),
    ):
        assert (solve_policy(mdp, new, gamma) >= v - 100 * slack).all()
        assert not new[~mdp.legal].any()


# ---------------------------------------------------------------------- error bounds and agreement


def check_bound(found, exact):
    """The stated error is no smaller than the true one; exact itself is good to rounding, hence the factor."""
    tiny = 1e-13 * (1 + np.abs(exact).max())
    assert np.abs(found.V - exact).max() <= found.bound + tiny
    assert found.history.shape == (found.n_iter + 1, found.V.size)
    assert_array_equal(found.history[-1], found.V)


@pytest.mark.long
@prop(80)
@given(processes(), gammas, seeds, st.booleans(), st.integers(1, 30))
def test_errors_lie_within_the_bounds(mdp, gamma, seed, in_place, max_iter):
    pi, V0 = policy(mdp, seed, sharp=True), values(mdp, seed)
    v, best = solve_policy(mdp, pi, gamma), newton_optimality(mdp, gamma, 30)[-1]
    for how in (dict(max_iter=max_iter, tol=1e-9, record=1), dict(max_iter=300, tol=1.0, record=1)):
        check_bound(policy_evaluation(mdp, pi, gamma, V0=V0, in_place=in_place, **how), v)
        check_bound(value_iteration(mdp, gamma, V0=V0, in_place=in_place, **how), best)
    early = policy_iteration(mdp, gamma, pi0=pi, max_iter=1 + max_iter % 3, record=1)
    check_bound(early, best)
    assert_array_equal(early.history[1], v)
    assert np.abs(V0 - best).max() <= error_bound(mdp, V0, gamma) + 1e-11
    assert np.abs(V0 - v).max() <= policy_error_bound(mdp, pi, V0, gamma) + 1e-11


@pytest.mark.long
@prop(60)
@given(processes(ends=True), seeds, st.booleans(), st.integers(1, 20))
def test_errors_lie_within_the_bounds_at_gamma_1(mdp, seed, in_place, max_iter):
    pi, V0 = policy(mdp, seed), values(mdp, seed)
    v, best = solve_policy(mdp, pi, 1.0), policy_iteration(mdp, 1.0).V
    for how in (dict(max_iter=max_iter, tol=1e-9, record=1), dict(max_iter=200, tol=1.0, record=1)):
        check_bound(policy_evaluation(mdp, pi, 1.0, V0=V0, in_place=in_place, **how), v)
        check_bound(value_iteration(mdp, 1.0, V0=V0, in_place=in_place, **how), best)
    assert np.abs(V0 - best).max() <= error_bound(mdp, V0, 1.0) + 1e-11
    assert np.isfinite(error_bound(mdp, V0, 1.0)) and error_bound(mdp, best, 1.0) < 1e-9
    check_bound(policy_iteration(mdp, 1.0, pi0=pi, max_iter=1, record=1), best)


@prop(40)
@given(processes(), st.sampled_from([0.0, 0.3, 0.7, 0.9]))
def test_all_solvers_agree(mdp, gamma):
    exact = policy_iteration(mdp, gamma)
    assert exact.converged
    slack = 1e-12 * (1 + np.abs(exact.V).max())
    others = [
        value_iteration(mdp, gamma, tol=1e-6),
        value_iteration(mdp, gamma, tol=1e-6, in_place=True),
        *(solve(mdp, gamma, tol=tol) for tol in (1e-2, 1e-6)),
    ]
    for found in others:
        error = np.abs(found.V - exact.V).max()
        assert found.converged and error <= found.bound + slack
        assert_allclose(found.Q[mdp.legal], exact.Q[mdp.legal], atol=found.bound + slack)
        assert not found.pi[~mdp.legal].any()
        lost = exact.V - solve_policy(mdp, found.pi, gamma)
        assert lost.max() <= 2 * gamma * found.bound / (1 - gamma) + 1e-10  # greedy for values off by the bound
    assert others[2].bound <= 1e-2 and others[3].bound <= 1e-6
    assert_allclose(newton_optimality(mdp, gamma, 20)[-1], exact.V, atol=slack / (1 - gamma))


@prop(30)
@given(processes(ends=True), st.sampled_from([0.9, 1.0]))
def test_all_solvers_agree_on_tasks_that_end(mdp, gamma):
    exact = policy_iteration(mdp, gamma)
    for found in (value_iteration(mdp, gamma, tol=1e-9), solve(mdp, gamma, tol=1e-6)):
        assert_allclose(found.V, exact.V, atol=1e-6)
        assert np.abs(found.V - exact.V).max() <= found.bound + 1e-11


@prop(30)
@given(processes(), gammas, seeds)
def test_value_does_not_depend_on_how_states_are_numbered(mdp, gamma, seed):
    rng = np.random.default_rng(seed)
    new = rng.permutation(mdp.n_states)  # state s becomes new[s]
    old = np.argsort(new)
    fields = dict(next_state=new[mdp.next_state[old]], prob=mdp.prob[old], reward=mdp.reward[old], legal=mdp.legal[old])
    moved = FiniteMDP(**fields, terminal=mdp.terminal[old], start=mdp.start[old])
    assert_allclose(policy_iteration(moved, gamma).V[new], policy_iteration(mdp, gamma).V, atol=1e-9)
    assert_allclose(value_iteration(moved, min(gamma, 0.9)).V[new], value_iteration(mdp, min(gamma, 0.9)).V, atol=1e-12)


@pytest.mark.parametrize("factor", [-2.0, 0.5])
def test_values_scale_with_the_rewards(factor):
    """v_pi is linear in the rewards: twice the rewards, twice the value, whatever the sign."""
    rng = np.random.default_rng(0)
    P, R = rng.dirichlet(np.ones(4), size=(4, 2)), rng.normal(size=(4, 2))
    pi = np.full((4, 2), 0.5)
    one, other = (solve_policy(FiniteMDP.from_arrays(P, r), pi, 0.9) for r in (R, factor * R + 1.0))
    assert_allclose(other, factor * one + 10.0)
