"""Models as users have them: sparse matrices, other orders of axes, rounded rows, tables of environments, float32."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from scipy.sparse import csc_matrix, csr_array, csr_matrix, vstack
from worlds import awkward

from rlcore.bellman import solve_policy
from rlcore.core.checks import model_of, spaces, veil
from rlcore.dp import policy_evaluation
from rlcore.envs import MDPEnv, random_mdp
from rlcore.mdp import FiniteMDP
from rlcore.solver import solve
from rlcore.td import td0


def rng(seed=0):
    return np.random.default_rng(seed)


def arrays(S=5, A=3, seed=0):
    """P (S, A, S) with many zeros, R (S, A) and R (S, A, S)."""
    g = rng(seed)
    P = g.random((S, A, S)) * (g.random((S, A, S)) < 0.6)
    P[:, :, 0] += 0.1
    return P / P.sum(axis=2, keepdims=True), g.normal(size=(S, A)), g.normal(size=(S, A, S))


@pytest.mark.parametrize("S, A", [(5, 3), (4, 4)])
@pytest.mark.parametrize("kind", [csr_matrix, csr_array, csc_matrix])
@pytest.mark.parametrize("whole", [False, True])
def test_every_order_and_kind_is_the_same_process(S, A, kind, whole):
    P, R, R3 = arrays(S, A)
    R3 = R3 * (P > 0)
    ass = P.transpose(1, 0, 2)
    for r, r_ass in ((R, R), (R3, R3.transpose(1, 0, 2))):
        dense = FiniteMDP.from_arrays(P, r)
        assert FiniteMDP.from_arrays(ass, r_ass, axes="ASS") == dense
        one = lambda x: [kind(m) for m in x]  # noqa: E731
        sparse = r if r.ndim == 2 else one(r_ass)
        assert FiniteMDP.from_arrays(one(ass), sparse) == dense
        if whole:
            rows = r if r.ndim == 2 else kind(r.reshape(S * A, S))
            assert FiniteMDP.from_arrays(kind(P.reshape(S * A, S)), rows) == dense
            rows = r if r.ndim == 2 else vstack(one(r_ass))
            assert FiniteMDP.from_arrays(vstack(one(ass)), rows, axes="ASS") == dense
    assert FiniteMDP.from_arrays(ass, R[:, 0], axes="ASS") == FiniteMDP.from_arrays(P, np.repeat(R[:, :1], A, axis=1))


def test_illegal_pairs_and_terminal_states_may_be_empty_rows():
    P, R, _ = arrays()
    P[1, 2], P[4], R[4] = 0.0, 0.0, 0.0
    end = np.arange(5) == 4
    sparse = FiniteMDP.from_arrays([csr_matrix(p) for p in P.transpose(1, 0, 2)], R, terminal=end, start=2)
    assert sparse == FiniteMDP.from_arrays(P, R, terminal=end, start=2) and not sparse.legal[1, 2]
    stays = P.copy()
    stays[4, :, 4] = 1.0
    again = FiniteMDP.from_arrays([csr_matrix(p) for p in stays.transpose(1, 0, 2)], R, terminal=end, start=2)
    assert again == sparse


def test_entries_of_sparse_matrices_are_what_they_stand_for():
    """Twice the same place: the sum. A stored zero: nothing, and no slot. Rewards of any form."""
    P, R, R3 = arrays(6, 2)
    P[5], R[5], R3[5], end = 0.0, 0.0, 0.0, np.arange(6) == 5
    twice = np.tile(P.reshape(12, 6) / 2, 2).ravel(), np.tile(np.arange(6), 24), 12 * np.arange(13)
    half = csr_matrix(twice, shape=(12, 6))
    assert half.nnz == 144 and not half.has_canonical_format
    dense = FiniteMDP.from_arrays(P, R, terminal=end)
    for found in (
        FiniteMDP.from_arrays(half, R, terminal=end),
        FiniteMDP.from_arrays(half, R.ravel(), terminal=end),
        FiniteMDP.from_arrays([half[0::2], half[1::2]], R.T.ravel(), terminal=end, axes="ASS"),
    ):
        assert found == dense and found.prob.shape == dense.prob.shape
        np.testing.assert_array_equal(found.prob[5], np.eye(dense.prob.shape[2])[[0, 0]])
        assert (found.next_state[5] == 5).all() and not found.reward[5].any()
    rewards = csr_matrix((R3 * (P > 0)).reshape(12, 6))
    assert FiniteMDP.from_arrays(half, rewards, terminal=end) == FiniteMDP.from_arrays(P, R3 * (P > 0), terminal=end)


def test_a_large_sparse_process_is_not_made_dense():
    S, A = 20_000, 4
    g, row = rng(), np.arange(S * A)
    P = csr_matrix((np.full(3 * S * A, 1 / 3), (np.repeat(row, 3), g.integers(S, size=3 * S * A))), shape=(S * A, S))
    mdp = FiniteMDP.from_arrays(P, g.random((S, A)), normalise=True)
    assert mdp.prob.shape == (S, A, 3)
    assert solve(mdp, 0.9).converged


def test_rounded_rows():
    P, R, _ = arrays()
    rounded = P.round(3)
    sparse = [csr_matrix(p) for p in rounded.transpose(1, 0, 2)]
    for given in (rounded, sparse):
        with pytest.raises(ValueError, match="^prob: sums to"):
            FiniteMDP.from_arrays(given, R)
        mdp = FiniteMDP.from_arrays(given, R, normalise=True)
        np.testing.assert_allclose(mdp.prob.sum(axis=2), 1.0, atol=1e-15)
        np.testing.assert_allclose(mdp.transition_probs(), P, atol=2e-3)
    np.testing.assert_array_equal(rounded, P.round(3))  # the caller's array stays


@pytest.mark.parametrize("P, R, options, says", [
    ([csr_matrix((2, 2)), csr_matrix((3, 3))], np.zeros((2, 2)), {}, "P: got matrices of shapes"),
    (csr_matrix((5, 2)), np.zeros((2, 2)), {}, "P: got shape (5, 2)"),
    ([csr_matrix(np.eye(2))], np.zeros((3, 1)), {}, "R: got shape (3, 1)"),
    ([csr_matrix(np.eye(2))], [csr_matrix(np.eye(3))], {}, "R: got"),
    ([csr_matrix(-np.eye(2))], np.zeros((2, 1)), {}, "P: contains -1"),
    ([csr_matrix(np.eye(2))], np.full((2, 1), np.nan), {}, "R: contains"),
    ([csr_matrix(np.eye(2)[::-1])], np.zeros((2, 1)), dict(terminal=[True, False]), "P: leads out of state 0"),
    ([csr_matrix(np.eye(2))], np.ones((2, 1)), dict(terminal=[True, False]), "R: got 1 in a terminal state"),
    ([csr_matrix(np.eye(2))], np.ones((2, 1)), dict(terminal=[True]), "terminal: got shape (1,)"),
    ([csr_matrix(np.eye(3)[[2, 1, 0]])], np.zeros((3, 1)), dict(terminal=[True, False, True]),
     "P: leads out of state 0"),
    ([csr_matrix(np.eye(2)), csr_matrix(np.eye(2)[::-1])], np.zeros((2, 2)), dict(terminal=[False, True]),
     "P: leads out of state 1"),
    ([csr_matrix((2, 3)), csr_matrix((2, 3))], np.zeros((2, 2)), {}, "P: got matrices of shapes [(2, 3)]"),
    ([csr_matrix([[1.0, np.inf], [0.0, 1.0]])], np.zeros((2, 1)), {}, "P: contains"),
    ([csr_matrix([[0.5, 0.5], [-1.0, 2.0]])], np.zeros((2, 1)), {}, "P: contains -1"),
    ([csr_matrix(np.eye(2))], np.array([[0.0], [np.nan]]), {}, "R: contains"),
    ([csr_matrix(np.eye(2))], [["a"], ["b"]], {}, "R: got"),
    (csr_matrix((np.full(20_000, 5e-5), (np.zeros(20_000, int), np.arange(20_000))), shape=(20_000, 20_000)),
     np.zeros((20_000, 1)), {}, "P: needs an array of 20000 x 1 x 20000 numbers"),
    (np.zeros((3, 2, 2)), np.zeros((2, 3)), {}, "P: got shape (3, 2, 2)"),
    (np.zeros((2, 1, 2)), np.zeros((2, 1)), dict(axes="AS"), "axes: got 'AS'"),
    (np.zeros((2, 1, 2)), np.zeros((2, 1)), dict(normalise=1), "normalise: got 1"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(P, R, options, says):
    with pytest.raises(ValueError) as error:
        FiniteMDP.from_arrays(P, R, **options)
    assert str(error.value).startswith(says) and any(word in str(error.value) for word in ("must", "allowed"))


# ---------------------------------------------------------------------- policies and owners


def test_policies_of_single_precision():
    mdp = random_mdp(6, 7, rng=rng())
    pi = rng(1).dirichlet(np.ones(7), size=6).astype(np.float32)
    exact = pi / pi.sum(axis=1, keepdims=True, dtype=float)
    np.testing.assert_allclose(solve_policy(mdp, pi, 0.9), solve_policy(mdp, exact, 0.9), rtol=1e-14)
    assert policy_evaluation(mdp, pi, 0.9).converged
    assert td0(mdp, pi, 0.9, 2, alpha=0.1, max_steps=5, rng=rng()).policy.dtype == float
    with pytest.raises(ValueError, match="^pi: row 0"):
        solve_policy(mdp, pi * np.float32(1.00005), 0.9)
    with pytest.raises(ValueError, match="^pi: row 0"):
        solve_policy(mdp, exact * (1 + 5e-9), 0.9)


def test_a_process_owns_its_arrays():
    P, R, _ = arrays()
    mdp = FiniteMDP.from_arrays(P, R)
    before = mdp.prob.copy(), mdp.reward.copy()
    P[:], R[:] = 0.0, 7.0
    np.testing.assert_array_equal(mdp.prob, before[0])
    np.testing.assert_array_equal(mdp.reward, before[1])


# ---------------------------------------------------------------------- tables of environments


class Table(gym.Env):
    observation_space, action_space = gym.spaces.Discrete(3), gym.spaces.Discrete(2)

    def __init__(self, P):
        self.P = P


ROWS = [[[(0.5, 1, 1.0), (0.5, 0, 0.0)], [(1.0, 2, -1.0)]], [[(1.0, 2, 2.0)], [(1.0, 0, 0.0)]],
        [[(1.0, 2, 0.0)], [(1.0, 2, 0.0)]]]  # fmt: skip


def changed(s, a, out):
    return [[out if (i, j) == (s, a) else rows for j, rows in enumerate(state)] for i, state in enumerate(ROWS)]


@pytest.mark.parametrize(
    "P, says",
    [
        ([], "env: P has [], must be lists"),
        ({}, "env: P has {}, must be"),
        (5, "env: P has 5, must be"),
        ("ab", "env: P has 'ab', must be"),
        ({"a": ROWS[0]}, "env: P has {'a'"),
        ([ROWS[0], 3, ROWS[2]], "env: P has ["),
        (changed(1, 0, None), "env: P has [None, "),
        (changed(1, 0, []), "outcomes: no outcome at (1, 0)"),
        (changed(0, 0, [(0.5, 1, 0.0)]), "prob: sums to 0.5 at (s=0, a=0)"),
        (changed(0, 1, [(1.0, 1)]), "env: P has (1.0, 1) at (s=0, a=1), must be"),
        (changed(0, 1, [(1.0, 1, 0.0, True, 3)]), "env: P has (1.0, 1, 0.0, True, 3) at (s=0, a=1), must be"),
        (changed(0, 1, [(1.0, 7, 0.0)]), "next_state: got 7 at (s=0, a=1, k=0)"),
        (changed(0, 1, [(1.0, -1, 0.0)]), "outcomes: got s_next = -1"),
        (changed(0, 1, [("1", 1, 0.0)]), "env: P has ('1', 1, 0.0) at"),
        (changed(0, 1, [(1.0, 1, 10**400)]), "env: P has (1.0, 1, 1000"),
        (changed(0, 1, [(1.0, 1, 0.0, "no")]), "env: P has (1.0, 1, 0.0, 'no') at"),
        (changed(0, 1, [(np.nan, 1, 0.0)]), "prob: not finite at"),
        ([*ROWS, ROWS[2]], "outcomes: key (3, 0) is outside 0..2 states, 0..1 actions"),
        ([[*state, state[0]] for state in ROWS], "outcomes: key (0, 2) is outside"),
    ],
)
def test_odd_tables_say_where(P, says):
    with pytest.raises(ValueError) as error:
        FiniteMDP.from_env(Table(P))
    assert str(error.value).startswith(says)


def test_a_table_alone_says_how_large_it_is():
    """Without spaces; state 2 stays for nothing, state 1 does not: it pays, or may leave."""
    stays = [[[(1.0, 2, 0.0), (0.0, 0, 5.0)]] * 2]
    for second in ([[(1.0, 1, 0.0)], [(1.0, 1, 1.0)]], [[(1.0, 1, 0.0)], [(0.5, 1, 0.0), (0.5, 0, 0.0)]]):
        mdp = FiniteMDP.from_env(SimpleNamespace(P=[ROWS[0], second, *stays], action_names=["one", "two"]))
        assert mdp.legal.shape == (3, 2) and mdp.terminal.tolist() == [False, False, True]
        assert mdp.action_names == ("one", "two") and mdp.state_names is None
    told = [[[(*row, row[1] == 1) for row in out] for out in state] for state in ROWS[:1]]
    assert FiniteMDP.from_env(Table([ROWS[0], [], {}])).terminal.tolist() == [False, True, True]  # no rows: an end
    assert FiniteMDP.from_env(SimpleNamespace(P=[*told, ROWS[1], ROWS[2]])).terminal.tolist() == [False, True, False]


@pytest.mark.parametrize("fields", [3, 4])
@pytest.mark.parametrize("dicts", [False, True])
def test_tables_are_lists_or_dicts_with_three_or_four_fields(fields, dicts):
    rows = [[[row if fields == 3 else (*row, row[1] == 2) for row in out] for out in state] for state in ROWS]
    table = {s: dict(enumerate(state)) for s, state in enumerate(rows)} if dicts else rows
    mdp = FiniteMDP.from_env(Table(table))
    expected = {(s, a): ROWS[s][a] for s in range(2) for a in range(2)}
    assert mdp == FiniteMDP.from_outcomes(expected, n_states=3) and mdp.terminal.tolist() == [False, False, True]
    np.testing.assert_allclose(mdp.start, [0.5, 0.5, 0.0])
    with pytest.raises(ValueError, match=r"^env: P has \(1.0, 2\) at \(s=0, a=0\), must be"):
        FiniteMDP.from_env(Table([[[(1.0, 2)]]]))


def test_what_changes_the_world_is_not_read_past():
    env = MDPEnv(awkward(start=0))
    assert FiniteMDP.from_env(gym.wrappers.TimeLimit(env, 5)) == env.mdp
    for wrapped in (gym.wrappers.TransformReward(env, lambda r: 2 * r), gym.wrappers.TransformAction(env, int, None)):
        with pytest.raises(ValueError, match="^env: got one in a Transform"):
            FiniteMDP.from_env(wrapped)


class Slower(gym.Wrapper):
    """Each step costs one more."""

    def step(self, action):
        s, r, *rest = self.env.step(action)
        return s, r - 1.0, *rest


@pytest.mark.parametrize(
    "wrap", [Slower, gym.wrappers.NormalizeReward, lambda e: gym.wrappers.MaxAndSkipObservation(e)]
)
def test_a_wrapper_with_a_step_of_its_own_has_another_process(wrap):
    env = gym.make("CliffWalking-v1")
    with pytest.raises(ValueError, match="^env: got one in a .*; must be env.unwrapped"):
        FiniteMDP.from_env(wrap(env))
    plain = gym.wrappers.RecordEpisodeStatistics(gym.Wrapper(env))
    assert FiniteMDP.from_env(plain) == FiniteMDP.from_env(env.unwrapped)


class Elsewhere(gym.Wrapper):
    """Episodes begin in state 1."""

    def reset(self, **options):
        _, info = self.env.reset(**options)
        self.env.unwrapped.s = 1
        return 1, info


class Alone:
    """A layer that hides what it wraps."""

    def __init__(self, env):
        self._env, self.unwrapped = env, env.unwrapped
        self.observation_space, self.action_space = env.observation_space, env.action_space


@pytest.mark.parametrize("kind", [Slower, Elsewhere, Alone, gym.wrappers.NormalizeReward])
def test_what_a_layer_changes_is_read_past_by_nobody(kind):
    """Masks, ends and starts of the process inside are not those of the one outside."""
    env = MDPEnv(awkward(start=0))
    assert model_of(gym.Wrapper(env)) is env.mdp and not spaces(env)[0].all()
    outside = kind(gym.Wrapper(env))
    assert model_of(outside) is None and spaces(outside)[0].all() and not spaces(outside)[1].any()
    with pytest.raises(ValueError, match=f"^env: got one in a {kind.__name__}"):
        FiniteMDP.from_env(outside)
    changed = gym.Wrapper(env)
    changed.step = lambda a: env.step(0)
    assert model_of(changed) is None


def test_a_wrapper_that_only_looks_on_hides_nothing():
    class Bare:
        def __init__(self, env):
            self.env = env

    class Itself(MDPEnv):
        env = property(lambda self: self)

    class Renamed(gym.Wrapper):
        def __init__(self, env):
            super().__init__(env)
            self.action_space = gym.spaces.Discrete(2, start=1)

    env = MDPEnv(awkward(start=0))
    for inner in (env, gym.Wrapper(env), Bare(gym.Wrapper(env)), Bare(env), Itself(env.mdp)):
        assert veil(inner) is None
    for kind in (lambda e: gym.wrappers.TransformReward(e, float), Renamed):
        found = veil(gym.Wrapper(kind(gym.Wrapper(env))))
        assert found == type(kind(env)).__name__


def test_the_first_bad_place_is_named():
    with pytest.raises(ValueError, match=r"^prob: negative at \(s=0, a=1, k=0\)"):
        P = np.array([[[1.0, 0.0], [-0.5, 1.5]], [[1.5, -0.5], [1.0, 0.0]]])
        FiniteMDP(np.broadcast_to([0, 1], P.shape), P, 0 * P, P[:, :, 0] < 9, np.zeros(2, bool), np.array([1.0, 0.0]))
