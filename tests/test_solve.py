"""solve: its bound is never below the true error, whichever way it takes; the known faults of other libraries."""

import inspect
import os
import subprocess
import sys
from fractions import Fraction

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rlcore.solver as quick
from rlcore.bellman import greedy_actions, q_from_v, solve_policy
from rlcore.dp import policy_iteration, value_iteration
from rlcore.envs import cliff_walking, gridworld, random_mdp, recycling_robot
from rlcore.envs.small import zero_loop
from rlcore.mdp import FiniteMDP, uniform_policy
from rlcore.solver import solve

GAMMAS = [0.0, 0.5, 0.99, 0.9999]


def exact(mdp, gamma):
    """v_* to about 1e-13 of its size: Howard's algorithm with exact evaluations."""
    found = policy_iteration(mdp, gamma)
    assert found.converged
    return found.V


def assert_certified(mdp, gamma, tol=1e-6, V_star=None):
    found = solve(mdp, gamma, tol)
    V_star = exact(mdp, gamma) if V_star is None else V_star
    error = np.abs(found.V - V_star).max()
    reference = 1e-14 * np.abs(V_star).max() / (1 - gamma) if gamma < 1 else 1e-12  # what `exact` itself may miss
    assert found.converged and error <= found.bound + reference and found.bound <= tol
    assert (found.V[mdp.terminal] == 0).all() and found.history is None
    Q_star = q_from_v(mdp, V_star, gamma)
    assert np.abs(Q_star[mdp.legal] - found.Q[mdp.legal]).max() <= found.bound + reference
    assert np.isneginf(found.Q[~mdp.legal]).all()
    assert np.array_equal(found.pi, found.pi.astype(bool)) and (found.pi.sum(axis=1) == 1).all()
    assert not found.pi[~mdp.legal].any()
    return found


def with_holes(S, A, K, seed, *, ends, reward=1.0, shift=0.0):
    """A sparse random process, some of whose actions are not legal and some of whose states are terminal."""
    rng = np.random.default_rng(seed)
    next_state, prob = rng.integers(S, size=(S, A, K)), rng.dirichlet(np.ones(K), size=(S, A))
    rewards, legal = reward * (rng.normal(size=(S, A, K)) + shift), rng.random((S, A)) < 0.7
    legal[np.arange(S), rng.integers(A, size=S)] = True
    terminal = np.arange(S) < ends
    legal[terminal] = True
    next_state[terminal], rewards[terminal] = np.flatnonzero(terminal)[:, None, None], 0
    prob[~legal] = rewards[~legal] = 0
    return FiniteMDP(next_state, prob, rewards, legal, terminal, ~terminal / (~terminal).sum())


def ring(n, slip=0.1):
    """States in a circle, rewards drawn once, moves to either side: slow to forget, and it never ends."""
    rng = np.random.default_rng(n)
    s = np.arange(n)
    next_state = np.stack([np.stack([(s - 1) % n, s], 1), np.stack([(s + 1) % n, s], 1)], 1)
    prob = np.broadcast_to([1 - slip, slip], next_state.shape)
    reward = np.broadcast_to(rng.normal(size=n)[:, None, None], next_state.shape)
    return FiniteMDP(next_state, prob, reward, np.ones((n, 2), bool), np.zeros(n, bool), np.full(n, 1 / n))


def toy_text(name, **options):
    return FiniteMDP.from_env(gymnasium.make(name, **options))


# ---------------------------------------------------------------------- the certificate


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("ends", [0, 1, 3])
@pytest.mark.parametrize("K", [1, 3])
def test_true_error_is_at_most_the_bound(gamma, ends, K):
    for seed in range(4):
        assert_certified(with_holes(30, 3, K, seed, ends=ends), gamma)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    shape=st.tuples(st.integers(2, 12), st.integers(1, 4), st.integers(1, 4)),
    gamma=st.sampled_from([0.0, 0.3, 0.9, 0.999]),
    shift=st.sampled_from([-3.0, 0.0, 3.0]),
    data=st.data(),
)
def test_certified_on_any_process(seed, shape, gamma, shift, data):
    ends = data.draw(st.integers(0, shape[0] - 1))
    assert_certified(with_holes(*shape, seed, ends=ends, shift=shift), gamma)


@pytest.mark.parametrize("mdp", [recycling_robot(), ring(12), gridworld(5, 6, slip=0.2), gridworld(7, 7)])
@pytest.mark.parametrize("gamma", GAMMAS)
def test_agrees_with_policy_and_value_iteration(mdp, gamma):
    found = assert_certified(mdp, gamma)
    slow = value_iteration(mdp, gamma, tol=1e-10 * max(1 - gamma, 1e-3), max_iter=400_000)
    assert np.abs(found.V - slow.V).max() <= found.bound + slow.bound


@pytest.mark.parametrize("scale", [1e6, 1e-6])
def test_scale_of_the_rewards(scale):
    mdp = with_holes(25, 3, 3, 0, ends=1, reward=scale)
    assert_certified(mdp, 0.99, tol=1e-6 * scale)


@pytest.mark.parametrize("tol", [1e-12, 1e-15, 1e-300])
def test_tol_beyond_doubles_is_admitted(tol):
    mdp = random_mdp(20, 3, rng=np.random.default_rng(0))
    found = solve(mdp, 0.999, tol)
    assert not found.converged and tol < found.bound < 1e-8
    assert np.abs(found.V - exact(mdp, 0.999)).max() <= found.bound


def test_bound_covers_rounding_in_exact_arithmetic():
    """One state that pays 0.1 for ever: v = 0.1 / (1 - gamma) in rational numbers, gamma and 0.1 as doubles."""
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 0.1)]})
    for gamma in (0.3, 0.9, 0.99, 0.9999, 0.999999):
        found = solve(mdp, gamma, 1e-300)
        error = abs(Fraction(found.V[0]) - Fraction(0.1) / (1 - Fraction(gamma)))
        assert error <= Fraction(found.bound) < Fraction(1e-15) * 10 / Fraction(1 - gamma) ** 2


@pytest.mark.parametrize("miss", [9e-10, 9e-13])
def test_probabilities_that_miss_1_are_covered(miss):
    """Rows that sum to 1 + 9e-10 or 1 + 9e-13 are divided: what is solved is a process."""
    P = np.array([[[0.5, 0.5 + miss]], [[0.25, 0.75 - miss]]])
    mdp = FiniteMDP.from_arrays(P, np.array([[1.0], [3.0]]))
    P = P / P.sum(axis=2, keepdims=True)
    for gamma in (0.9, 0.999):
        V = np.linalg.solve(np.eye(2) - gamma * P[:, 0], mdp.expected_reward()[:, 0])
        assert_certified(mdp, gamma, V_star=V)


@pytest.mark.parametrize("gamma", [0.9, 1.0])
def test_values_that_doubles_cannot_hold(gamma):
    mdp = FiniteMDP.from_outcomes({(0, 0): [(0.9, 0, 1e308), (0.1, 1, 1e308)]})
    with pytest.raises(ValueError, match="^(mdp|V): .*inf"), np.errstate(all="ignore"):
        solve(mdp, gamma)


@pytest.mark.parametrize("miss", [9e-10, 1e-12, -9e-13, 1e-15])
def test_bounds_hold_for_rows_that_were_rounded(miss):
    """In rational numbers, for rows divided by their sums: the way to the end costs R / (1 - gamma p)."""
    p, gamma, R = 0.9 + miss, 0.99, -1e6
    mdp = FiniteMDP.from_outcomes({(0, 0): [(p, 0, R), (0.1, 1, R)]})
    exact = Fraction(R) / (1 - Fraction(gamma) * Fraction(p) / (Fraction(p) + Fraction(0.1)))
    for found in (solve(mdp, gamma), value_iteration(mdp, gamma, tol=1e-9), policy_iteration(mdp, gamma)):
        assert abs(Fraction(found.V[0]) - exact) <= Fraction(found.bound)


def test_probabilities_that_miss_1_without_a_discount():
    """A step that costs 1 and ends with probability 1/1000: -1000, where rows that sum to 1 + 9e-10 give -1000.0009."""
    mdp = FiniteMDP.from_outcomes({(0, 0): [(0.999 + 9e-10, 0, -1.0), (0.001, 1, -1.0)]})
    p = (0.999 + 9e-10) / (1 + 9e-10)
    for found in (solve(mdp, 1.0, 1e-9), value_iteration(mdp, 1.0, tol=1e-13), policy_iteration(mdp, 1.0)):
        assert found.V[0] == pytest.approx(-1 / (1 - p), rel=1e-9)


# ---------------------------------------------------------------------- each way by itself


@pytest.mark.parametrize("mdp", [with_holes(40, 3, 3, 1, ends=0), gridworld(6, 6, slip=0.2), ring(20)])
def test_every_way_finds_the_same(mdp, monkeypatch):
    """Forced from the interpreted source: sweeps with the span stop only, queue at once, policies at once."""
    V_star = exact(mdp, 0.95)
    for patience, cap in ((np.inf, 400), (0.0, 10**6), (0.0, 0)):
        source = plain(PATIENCE=patience, QUEUE_CAP=cap)
        V, Q, pi, bound, n_iter = source["_solve_sparse"](
            *quick._arrays(mdp), mdp.reward, mdp.legal, mdp.terminal, 0.95, 1e-6, np.zeros(2, int)
        )
        assert np.abs(V - V_star).max() <= bound <= 1e-6
        assert np.abs(solve_policy(mdp, pi, 0.95) - V_star).max() <= 2 * 0.95 * bound / 0.05


def plain(**constants):
    """The compiled functions as plain Python, with other constants."""
    names = dict(vars(quick), **constants)
    for name, value in vars(quick).items():
        function = inspect.unwrap(getattr(value, "__wrapped__", getattr(value, "py_func", None)))
        if function is not None:
            names[name] = type(function)(function.__code__, names, name)
    return names


def test_dense_and_sparse_form_agree():
    mdp = random_mdp(90, 3, rng=np.random.default_rng(1))
    shuffled = np.random.default_rng(2).permuted(np.broadcast_to(np.arange(90), (90, 3, 90)), axis=2)
    prob, reward = (np.take_along_axis(x, shuffled, axis=2) for x in (mdp.prob, mdp.reward))
    other = FiniteMDP(shuffled, prob, reward, mdp.legal, mdp.terminal, mdp.start)
    assert quick._is_dense(mdp) and not quick._is_dense(other)
    a, b = assert_certified(mdp, 0.99), assert_certified(other, 0.99)
    assert np.abs(a.V - b.V).max() <= a.bound + b.bound


@pytest.mark.parametrize("gamma", [0.0, 0.99])
def test_dense_with_terminal_and_illegal(gamma):
    mdp = with_holes(80, 3, 80, 5, ends=2)
    order = np.broadcast_to(np.arange(80), mdp.prob.shape)
    prob = np.where(mdp.terminal[:, None, None], np.eye(80)[:, None, :], mdp.prob)
    dense = FiniteMDP(order, prob, mdp.reward, mdp.legal, mdp.terminal, mdp.start)
    assert quick._is_dense(dense)
    assert_certified(dense, gamma)


def test_dense_that_does_not_forget():
    n = 100
    P = np.full((n, 1, n), 1e-9 / n)
    P[np.arange(n), 0, (np.arange(n) + 1) % n] += 1 - 1e-9
    mdp = FiniteMDP.from_arrays(P, np.random.default_rng(0).normal(size=(n, 1)))
    assert quick._is_dense(mdp)
    assert_certified(mdp, 0.99)


def test_predecessors_are_those_of_the_process():
    for mdp in (with_holes(30, 3, 3, 0, ends=2), gridworld(4, 5, slip=0.1), recycling_robot()):
        first, indices = quick._predecessors(*quick._arrays(mdp))
        expected = mdp.predecessors()
        assert np.array_equal(first, expected[0]) and np.array_equal(indices, expected[1])


def test_long_corridor_numbered_at_random():
    """200 000 steps to the exit: sweeps would need as many rounds, the queue a handful."""
    n = 200_000
    name = np.random.default_rng(0).permutation(n)
    next_state = np.empty((n, 2, 1), int)
    next_state[name[1:], 0, 0], next_state[name[:-1], 1, 0] = name[:-1], name[1:]
    next_state[name[0]], next_state[name[-1], 1] = name[0], name[-1]
    terminal = np.arange(n) == name[0]
    reward = np.where(terminal[:, None, None], 0.0, np.full((n, 2, 1), -1.0))
    mdp = FiniteMDP(next_state, np.ones((n, 2, 1)), reward, np.ones((n, 2), bool), terminal, ~terminal / (n - 1))
    found = solve(mdp, 0.9999)
    steps = np.empty(n)
    steps[name] = np.arange(n)
    assert np.abs(found.V + (1 - 0.9999**steps) / (1 - 0.9999)).max() <= found.bound <= 1e-6
    assert found.n_iter < 20


# ---------------------------------------------------------------------- gymnasium, ties, gamma = 1


@pytest.mark.parametrize("gamma", [0.5, 0.99, 0.9999])
@pytest.mark.parametrize(
    "name, options",
    [("FrozenLake-v1", {"map_name": "4x4"}), ("FrozenLake-v1", {"map_name": "8x8"}), ("CliffWalking-v1", {})],
)
def test_toy_text(name, options, gamma):
    assert_certified(toy_text(name, **options), gamma)


def test_taxi():
    assert_certified(toy_text("Taxi-v4"), 0.99)


def test_ties_take_the_first_action():
    mdp = FiniteMDP.from_outcomes({(s, a): [(1.0, 1 - s, 2.0)] for s in range(2) for a in range(3)})
    found = assert_certified(mdp, 0.9)
    assert np.allclose(found.V, 20) and np.array_equal(found.pi, [[1, 0, 0], [1, 0, 0]])


def test_undiscounted_shortest_path():
    mdp = gridworld(6, 9)
    row, col = np.divmod(np.arange(54), 9)
    steps = np.minimum(row + col, 5 - row + 8 - col)
    found = solve(mdp, 1.0)
    assert found.converged and np.abs(found.V + steps).max() <= found.bound <= 1e-6
    slippery = solve(gridworld(6, 9, slip=0.3), 1.0)
    assert slippery.converged and np.abs(slippery.V - exact(gridworld(6, 9, slip=0.3), 1.0)).max() <= slippery.bound


def test_undiscounted_without_cost_has_values_but_no_bound():
    mdp = toy_text("FrozenLake-v1", map_name="4x4")
    found = solve(mdp, 1.0)
    others = value_iteration(mdp, 1.0), policy_iteration(mdp, 1.0)
    assert all(other.bound == found.bound == np.inf and other.converged is found.converged is True for other in others)
    assert abs(found.V[0] - 14 / 17) < 1e-4  # 0.8235, the best chance to cross the slippery 4x4 lake


def test_a_discount_that_rounding_hides_has_no_bound_and_has_not_converged():
    found = solve(zero_loop(), 1 - 1e-13)
    assert found.bound == np.inf and not found.converged
    found = solve(zero_loop(), 1 - 1e-10)  # v_* is 1
    assert abs(found.V[0] - 1) <= found.bound < 1e-4 and not found.converged


def test_undiscounted_refusals():
    with pytest.raises(ValueError, match="gamma: got 1, but no policy ends from state 0"):
        solve(recycling_robot(), 1.0)
    gain = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 1.0)], (0, 1): [(1.0, 1, 0.0)]})
    with pytest.raises(ValueError, match="gamma: got 1, but values still grow"):
        solve(gain, 1.0)


# ---------------------------------------------------------------------- known faults of other libraries


def test_span_stop_shifts_the_values():
    """pymdptoolbox stops on the span and returns V as it stands: off by 83 where all values are near 100."""
    mdp = random_mdp(50, 3, rng=np.random.default_rng(0))
    mdp = FiniteMDP(mdp.next_state, mdp.prob, mdp.reward * 0.1 + 1, mdp.legal, mdp.terminal, mdp.start)
    found = assert_certified(mdp, 0.99)
    assert found.V.min() > 90 and found.n_iter < 60


@pytest.mark.parametrize("gamma", [0.9, 0.95, 0.99, 0.999])
@pytest.mark.parametrize("size", ["4x4", "8x8"])
def test_frozen_lake_with_its_ties_ends_and_is_right(size, gamma):
    """quantecon's policy iteration swaps tied policies for ever; mdpsolver's Gauss-Seidel variant is wrong there."""
    mdp = toy_text("FrozenLake-v1", map_name=size)
    found = assert_certified(mdp, gamma)
    best = greedy_actions(q_from_v(mdp, exact(mdp, gamma), gamma), tol=1e-5)
    assert best[found.pi.astype(bool)].all()


MEMORY = """
import numpy as np
from rlcore.envs import random_mdp
from rlcore.solver import solve
solve(random_mdp(9, 2, n_next=3, rng=np.random.default_rng(0)), 0.99)
mdp = random_mdp(100_000, 4, n_next=5, rng=np.random.default_rng(0))
assert solve(mdp, 0.99).converged
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.long
@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="peak memory is read from /proc")
def test_memory_at_100_000_states(tmp_path):
    """Process, solver and interpreter together; pymdptoolbox asks for 74 GiB."""
    usual = os.environ.get("NUMBA_CACHE_DIR", "")
    for folder in (usual, usual, tmp_path, tmp_path):  # until one need not compile, which takes 90 MiB more
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder), "RLCORE_NOTES": "1"}
        run = [sys.executable, "-c", MEMORY]
        done = subprocess.run(run, capture_output=True, text=True, check=True, env=environment)
        if "compiling" not in done.stderr:
            break
    assert int(done.stdout) / 1024 < 300  # MiB; measured: 233


# ---------------------------------------------------------------------- one source, two speeds; bad calls

DIGEST = """
import hashlib, numpy as np
from rlcore.core.compiled import HAVE_NUMBA
from rlcore.solver import solve
from rlcore.envs import gridworld, random_mdp, recycling_robot
sparse = random_mdp(20, 3, n_next=3, rng=np.random.default_rng(0))
digest = hashlib.sha256()
for mdp, gamma in ((recycling_robot(), 0.9), (gridworld(4, 5, slip=0.2), 0.99), (gridworld(), 1.0), (sparse, 0.95)):
    found = solve(mdp, gamma)
    for x in (found.V, found.Q, found.pi, np.array([found.bound, found.n_iter])):
        digest.update(np.ascontiguousarray(x).tobytes())
print(HAVE_NUMBA, digest.hexdigest())
"""


@pytest.mark.long
def test_same_bits_without_numba():
    def run(**extra):
        environment = {**os.environ, **extra}
        found = subprocess.run(
            [sys.executable, "-c", DIGEST], capture_output=True, text=True, check=True, env=environment
        )
        return found.stdout.split()

    with_numba, without = run(RLCORE_NO_NUMBA="0"), run(RLCORE_NO_NUMBA="1")
    assert without[0] == "False" and with_numba[1] == without[1]


@pytest.mark.parametrize("gamma", [-0.1, 1.1, np.nan])
def test_bad_gamma(gamma):
    with pytest.raises(ValueError, match=r"gamma: got .*must be .*in \[0, 1\]"):
        solve(recycling_robot(), gamma)


@pytest.mark.parametrize("tol", [0.0, -1e-6, np.nan, np.inf, [1e-6]])
def test_bad_tol(tol):
    with pytest.raises(ValueError, match="tol: got .*must be a positive number"):
        solve(recycling_robot(), 0.9, tol)


def lock(n, digits=2):
    """A lock of n digits, from the first on again after each that is wrong: at random it takes about digits^n steps."""
    row = lambda s, a: [(1.0, 0 if a else s + 1, -1.0)]  # noqa: E731
    return FiniteMDP.from_outcomes({(s, a): row(s, a) for s in range(n) for a in range(digits)})


DEEP = {
    "grid": (gridworld(3, 3, terminals=[0]), -4.0),
    "cliff": (cliff_walking(), -14.0),
    **{
        f"lock {n}, {k}": (lock(n, k), -n)
        for n, k in ((10, 2), (28, 2), (40, 2), (200, 2), (1100, 2), (28, 5), (60, 5))
    },
    "large rewards": (FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, -1e10)], (0, 1): [(1.0, 1, -3e10)]}), -1e10),
}


@pytest.mark.parametrize("tol", [1e-6, 1e-9, 1e-11, 1e-300])
@pytest.mark.parametrize("name", DEEP)
def test_undiscounted_values_do_not_stay_where_they_begin(name, tol):
    """Those of the uniform policy are so far below that their rounding is more than what is asked for."""
    mdp, least = DEEP[name]
    found = solve(mdp, 1.0, tol)
    assert found.V.min() == pytest.approx(least, rel=1e-12) and found.bound < 1e-14 * abs(least) * mdp.n_states
    assert found.converged == (found.bound <= tol)


@pytest.mark.parametrize("n, digits", [(200, 2), (90, 7), (1100, 3)])
def test_a_policy_that_takes_longer_than_doubles_say_is_refused(n, digits):
    """Policy iteration begins with the uniform one, and goes from another to the same values as `solve`."""
    mdp = lock(n, digits)
    for plan in (lambda: solve_policy(mdp, uniform_policy(mdp), 1.0), lambda: policy_iteration(mdp, 1.0)):
        with pytest.raises(ValueError, match="^pi: takes longer to end than doubles can say, must end sooner"):
            plan()
    found = policy_iteration(mdp, 1.0, pi0=np.eye(digits)[np.zeros(n + 1, int)])
    np.testing.assert_array_equal(found.V, solve(mdp, 1.0).V)
