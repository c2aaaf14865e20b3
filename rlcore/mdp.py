"""Finite Markov decision processes, policies, trajectories and returns (chapter 1)."""

from collections import namedtuple
from dataclasses import dataclass
from numbers import Real

import numpy as np

from rlcore.compiled import compiled

Sampler = namedtuple("Sampler", "next_state reward cdf terminal start_cdf")


@dataclass(frozen=True, eq=False, repr=False)
class FiniteMDP:
    """The four-argument dynamics p(s', r | s, a), one padded row of outcomes for each pair. eq-1, alg-model-marginals.

    next_state: (S, A, K) int32, prob: (S, A, K), reward: (S, A, K); outcome k of (s, a) is (s', r) with its
    probability; outcomes of probability 0 are padding. legal: (S, A), whether a is in A(s). terminal: (S,); a terminal
    state returns to itself with reward 0 under every action. start: (S,), distribution of S_0. Arrays are read-only
    after construction. Raises ValueError naming the array, state and action at fault.
    Source: Sutton and Barto (2018), section 3.1.
    """

    next_state: np.ndarray
    prob: np.ndarray
    reward: np.ndarray
    legal: np.ndarray
    terminal: np.ndarray
    start: np.ndarray
    state_names: tuple | None = None
    action_names: tuple | None = None

    def __post_init__(self):
        dtypes = dict(next_state=np.int32, prob=float, reward=float, legal=bool, terminal=bool, start=float)
        for name, dtype in dtypes.items():
            values = getattr(self, name)
            values = as_integers(name, values) if dtype is np.int32 else as_floats(name, values)
            if dtype is bool and ((values != 0) & (values != 1)).any():
                raise ValueError(f"{name}: got {values!r}, must be True or False")
            view = np.ascontiguousarray(values, dtype).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)
        for name in ("state_names", "action_names"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _names(name, getattr(self, name)))
        self.validate()

    @property
    def n_states(self):
        return self.prob.shape[0]

    @property
    def n_actions(self):
        return self.prob.shape[1]

    def __repr__(self):
        S, A, K = self.prob.shape
        return f"FiniteMDP({S} states, {A} actions, {K} outcomes, {int(self.terminal.sum())} terminal)"

    def __eq__(self, other):
        if not isinstance(other, FiniteMDP):
            return NotImplemented
        names = self.state_names == other.state_names and self.action_names == other.action_names
        return names and all(np.array_equal(a, b) for a, b in zip(_canonical(self), _canonical(other)))

    __hash__ = None

    # ------------------------------------------------------------------ construction

    @classmethod
    def from_outcomes(cls, outcomes, *, n_states=None, n_actions=None, start=None, state_names=None, action_names=None):
        """Build from {(s, a): [(probability, s_next, reward), ...]}; a state without any action is terminal.

        start: a state or a distribution (S,); the default is uniform over the states that are not terminal.
        Outcomes with the same (s_next, reward) are merged. Pairs that are absent are not in A(s).
        """
        if not isinstance(outcomes, dict) or not outcomes:
            raise ValueError(f"outcomes: got {outcomes!r}, must be a table with at least one (s, a)")
        merged = {_pair(key): _merge(key, rows) for key, rows in outcomes.items()}
        S = 1 + max(max(s for s, _ in merged), max(s for row in merged.values() for s, _ in row))
        A = 1 + max(a for _, a in merged)
        S = S if n_states is None else check_count("n_states", n_states)
        A = A if n_actions is None else check_count("n_actions", n_actions)
        K = max(len(row) for row in merged.values())
        next_state = np.repeat(np.arange(S), A * K).reshape(S, A, K)
        prob, reward, legal = np.zeros((S, A, K)), np.zeros((S, A, K)), np.zeros((S, A), bool)
        for (s, a), row in merged.items():
            if s >= S or a >= A:
                raise ValueError(f"outcomes: key {(s, a)} is outside 0..{S - 1} states, 0..{A - 1} actions")
            legal[s, a] = True
            for k, ((s_next, r), p) in enumerate(row.items()):
                next_state[s, a, k], prob[s, a, k], reward[s, a, k] = s_next, p, r
        terminal = ~legal.any(axis=1)
        legal[terminal], prob[terminal, :, 0] = True, 1.0
        start = _start(start, terminal)
        return cls(next_state, prob, reward, legal, terminal, start, state_names, action_names)

    @classmethod
    def from_arrays(cls, P, R, *, terminal=None, start=None, state_names=None, action_names=None):
        """Build from P (S, A, S) = p(s'|s, a) and R, either r(s, a) of shape (S, A) or r(s, a, s') of shape (S, A, S).

        A row of zeros in P means that the action is not in A(s); R does not matter where P is 0. terminal: (S,) bool,
        default none; their rows of P may be zeros, their rewards must be.
        """
        P, R = as_floats("P", P), as_floats("R", R)
        if P.ndim != 3 or P.shape[0] != P.shape[2] or 0 in P.shape:
            raise ValueError(f"P: got shape {P.shape}, must be (S, A, S)")
        if R.shape not in (P.shape, P.shape[:2]):
            raise ValueError(f"R: got shape {R.shape}, must be {P.shape[:2]} or {P.shape}")
        if not (np.isfinite(P).all() and (P >= 0).all()):
            bad = P[~(np.isfinite(P) & (P >= 0))][0]
            raise ValueError(f"P: contains {bad:g}, must be probabilities")
        R = np.broadcast_to(R if R.ndim == 3 else R[:, :, None], P.shape)
        terminal = np.zeros(len(P), bool) if terminal is None else as_floats("terminal", terminal).astype(bool)
        if terminal.shape != (len(P),):
            raise ValueError(f"terminal: got shape {terminal.shape}, must be ({len(P)},)")
        bad = terminal[:, None, None] & (
            (np.nan_to_num(R) != 0) | (P > 0) & (np.arange(len(P)) != np.arange(len(P))[:, None, None])
        )
        if bad.any():
            s, a, s_next = np.argwhere(bad)[0]
            name, value = ("R", R[s, a, s_next]) if R[s, a, s_next] else ("P", P[s, a, s_next])
            raise ValueError(f"{name}: got {value:g} at (s={s}, a={a}, s_next={s_next}), must be 0 as {s} is terminal")
        K = max(1, int((P > 0).sum(axis=2).max()))
        order = np.argsort(P == 0, axis=2, kind="stable")[:, :, :K]  # positive entries first, in order of s'
        prob = np.take_along_axis(P, order, axis=2)
        legal = (prob > 0).any(axis=2) | terminal[:, None]
        reward = np.where(prob > 0, np.take_along_axis(R, order, axis=2), 0.0)
        prob[terminal], prob[terminal, :, 0], order[terminal] = 0.0, 1.0, np.flatnonzero(terminal)[:, None, None]
        return cls(order, prob, reward, legal, terminal, _start(start, terminal), state_names, action_names)

    @classmethod
    def from_env(cls, env):
        """Read the transition table `P` of a gymnasium environment (FrozenLake, Taxi, CliffWalking, MDPEnv).

        A state that is entered with terminated=True becomes terminal, hence absorbing with reward 0, whatever its own
        row says. Raises ValueError where there is no table (Blackjack), or where a state can be entered both ways.
        """
        env = getattr(env, "unwrapped", env)
        table = getattr(env, "P", None)
        if table is None:
            raise ValueError(
                f"env: {type(env).__name__} has no transition table P; from_env reads toy-text tables only"
            )
        S, A = int(env.observation_space.n), int(env.action_space.n)
        terminal = {s2 for row in table.values() for out in row.values() for p, s2, _, done in out if done and p > 0}
        outcomes = {
            (s, a): [(p, s2, r) for p, s2, r, _ in out]
            for s, row in table.items()
            if s not in terminal
            for a, out in row.items()
        }
        start = np.asarray(env.initial_state_distrib, float)
        names = (getattr(env, "state_names", None), getattr(env, "action_names", None))
        mdp = cls.from_outcomes(
            outcomes, n_states=S, n_actions=A, start=start, state_names=names[0], action_names=names[1]
        )
        reachable = _reachable(mdp)
        for s in np.flatnonzero(reachable & ~mdp.terminal):
            for a, out in table[s].items():
                for p, s2, _, done in out:
                    if p > 0 and not done and s2 in terminal:
                        raise ValueError(f"env: (s={s}, a={a}) enters the terminal state {s2} with terminated=False")
        return mdp

    def to_env(self):
        """This process as a gymnasium environment with Discrete spaces."""
        from rlcore.envs.gym import MDPEnv

        return MDPEnv(self)

    # ------------------------------------------------------------------ checks and equations (1)-(5)

    def validate(self):
        """Raise ValueError unless the arrays describe a finite MDP: shapes, ranges, and rows that sum to 1. eq-2"""
        S, A = _check_shapes(self)
        for name in ("prob", "reward", "start"):
            bad = ~np.isfinite(getattr(self, name))
            if bad.any():
                raise ValueError(f"{name}: not finite at {_where(bad)}, must be finite")
        for name in ("prob", "start"):
            bad = getattr(self, name) < 0
            if bad.any():
                raise ValueError(f"{name}: negative at {_where(bad)}, must be at least 0")
        bad = (self.next_state < 0) | (self.next_state >= S)
        if bad.any():
            raise ValueError(f"next_state: got {self.next_state[bad][0]} at {_where(bad)}, must be in 0..{S - 1}")
        total = self.prob.sum(axis=2)  # eq-2
        bad = np.abs(total - self.legal) > 1e-9
        if bad.any():
            allowed = "1, or 0 for an action that is not legal"
            raise ValueError(f"prob: sums to {total[bad][0]:.12g} at {_where(bad)}, must be {allowed}")
        if not self.legal.any(axis=1).all():
            raise ValueError(
                f"legal: no action at (s={np.flatnonzero(~self.legal.any(axis=1))[0]}), needs at least one"
            )
        used = (self.prob > 0) & self.terminal[:, None, None]
        bad = used & (self.next_state != np.arange(S)[:, None, None])
        if bad.any():
            raise ValueError(f"next_state: terminal state left at {_where(bad)}, must return to itself")
        bad = used & (self.reward != 0)
        if bad.any():
            raise ValueError(f"reward: got {self.reward[bad][0]:g} on a terminal state at {_where(bad)}, must be 0")
        if abs(self.start.sum() - 1) > 1e-9:
            raise ValueError(f"start: sums to {self.start.sum():.12g}, must be 1")
        if (self.start[self.terminal] > 0).any():
            raise ValueError("start: puts probability on a terminal state, must be 0 there")

    def p(self, s_next, r, s, a):
        """Probability of s_next and reward r after action a in state s. eq-1"""
        s, a = self._index("s", s, self.n_states), self._index("a", a, self.n_actions)
        same = (self.next_state[s, a] == self._index("s_next", s_next, self.n_states)) & (self.reward[s, a] == r)
        return float(self.prob[s, a, same].sum())

    def transition_probs(self):
        """p(s'|s, a) as (S, A, S); rows of illegal actions are 0. eq-3, eq-u-transition-inline"""
        S, A = self.n_states, self.n_actions
        P = np.zeros((S, A, S))
        np.add.at(P, (np.arange(S)[:, None, None], np.arange(A)[:, None], self.next_state), self.prob)  # eq-3
        return P

    def expected_reward(self):
        """r(s, a) as (S, A); 0 for illegal actions. eq-4"""
        return (self.reward * self.prob).sum(axis=2)  # eq-4

    def expected_reward_sas(self):
        """r(s, a, s') as (S, A, S); NaN where p(s'|s, a) = 0, for there it is not defined. eq-5"""
        S, A = self.n_states, self.n_actions
        total = np.zeros((S, A, S))
        index = (np.arange(S)[:, None, None], np.arange(A)[:, None], self.next_state)
        np.add.at(total, index, self.reward * self.prob)
        P = self.transition_probs()
        return np.divide(total, P, out=np.full_like(P, np.nan), where=P > 0)  # eq-5

    def sampler(self):
        """Arrays from which compiled loops draw: next_state, reward, cumulative probabilities, terminal, start."""
        return Sampler(self.next_state, self.reward, cumulative(self.prob), self.terminal, cumulative(self.start))

    def predecessors(self):
        """States from which each state can be reached in one step, as (indptr (S + 1,), indices): those of s are
        indices[indptr[s]:indptr[s + 1]], in increasing order."""
        S = self.n_states
        s = np.broadcast_to(np.arange(S)[:, None, None], self.prob.shape)
        edges = np.unique(self.next_state[self.prob > 0].astype(np.int64) * S + s[self.prob > 0])
        indptr = np.concatenate([[0], np.cumsum(np.bincount(edges // S, minlength=S))])
        return indptr, (edges % S).astype(np.int32)

    @staticmethod
    def _index(name, value, size):
        if not is_number(value) or not 0 <= value < size or int(value) != value:
            raise ValueError(f"{name}: got {value!r}, must be an integer in 0..{size - 1}")
        return int(value)


def is_number(value):
    """Whether value is a real number; True and False are not."""
    return isinstance(value, (float, int, Real)) and not isinstance(value, bool)  # the common ones first


def as_floats(name, values):
    """values as a float array; ValueError where they are not numbers."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: got {values!r}, must be numbers") from None


def as_integers(name, values):
    """values as an array of integers; ValueError where they are not."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise ValueError(f"{name}: got {values!r}, must be integers") from None
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"{name}: got dtype {array.dtype}, must be integers")
    return array.astype(np.int64, copy=False)


def _names(name, values):
    if isinstance(values, str) or not hasattr(values, "__iter__"):
        raise ValueError(f"{name}: got {values!r}, must be a sequence of names")
    return tuple(values)


def _check_shapes(mdp):
    if mdp.prob.ndim != 3 or 0 in mdp.prob.shape:
        raise ValueError(f"prob: got shape {mdp.prob.shape}, must be (S, A, K) with S, A, K at least 1")
    S, A, _ = mdp.prob.shape
    shapes = dict(next_state=mdp.prob.shape, reward=mdp.prob.shape, legal=(S, A), terminal=(S,), start=(S,))
    for name, shape in shapes.items():
        if getattr(mdp, name).shape != shape:
            raise ValueError(f"{name}: got shape {getattr(mdp, name).shape}, must be {shape}")
    for name, size in (("state_names", S), ("action_names", A)):
        if getattr(mdp, name) is not None and len(getattr(mdp, name)) != size:
            raise ValueError(f"{name}: got {len(getattr(mdp, name))} names, must be {size}")
    return S, A


def _where(bad):
    return "(" + ", ".join(f"{name}={i}" for name, i in zip("sak", np.argwhere(bad)[0])) + ")"


def _is_index(i):
    return is_number(i) and isinstance(i, (int, np.integer)) and i >= 0


def _pair(key):
    if not (isinstance(key, tuple) and len(key) == 2 and all(_is_index(i) for i in key)):
        raise ValueError(f"outcomes: got key {key!r}, must be (s, a), two integers that are at least 0")
    return key


def _merge(key, rows):
    merged = {}
    for row in rows if hasattr(rows, "__iter__") else [rows]:
        if not (isinstance(row, (tuple, list)) and len(row) == 3 and all(map(is_number, row))):
            raise ValueError(f"outcomes: got {row!r} at {key}, must be (probability, s_next, reward)")
        p, s_next, r = row
        if not _is_index(s_next):
            raise ValueError(f"outcomes: got s_next = {s_next!r} at {key}, must be an integer that is at least 0")
        if p < 0:
            raise ValueError(f"outcomes: got probability {p!r} at {key}, must be at least 0")
        merged[int(s_next), float(r)] = merged.get((int(s_next), float(r)), 0.0) + float(p)
    if not merged:
        raise ValueError(f"outcomes: no outcome at {key}, needs at least one; leave the pair out if it is not in A(s)")
    return merged


def _start(start, terminal):
    if start is None:
        if terminal.all():
            raise ValueError("terminal: every state is terminal, needs at least one that is not")
        return ~terminal / np.sum(~terminal)
    if np.ndim(start) == 0:
        return np.arange(terminal.size) == FiniteMDP._index("start", start, terminal.size)
    return start


def _canonical(mdp):
    """Arrays with equal outcomes merged, ordered by (s', r) and padding blanked: equal processes have equal arrays."""
    s_next, r, p = _ordered(mdp.next_state, mdp.reward, mdp.prob)
    for k in range(1, p.shape[2]):
        same = (p[:, :, k] > 0) & (s_next[:, :, k] == s_next[:, :, k - 1]) & (r[:, :, k] == r[:, :, k - 1])
        p[:, :, k] += np.where(same, p[:, :, k - 1], 0.0)
        p[:, :, k - 1] = np.where(same, 0.0, p[:, :, k - 1])
    return [*_ordered(s_next, r, p), mdp.legal, mdp.terminal, mdp.start]


def _ordered(next_state, reward, prob):
    used = prob > 0
    fields = [np.where(used, x, 0) for x in (next_state, reward, prob)]
    order = np.lexsort((fields[1], fields[0], ~used), axis=2)[:, :, : int(used.sum(axis=2).max())]
    return [np.take_along_axis(x, order, axis=2) for x in fields]


def _reachable(mdp):
    """States that some policy can meet, (S,) bool."""
    seen, frontier = mdp.start > 0, np.flatnonzero(mdp.start > 0)
    while frontier.size:
        found = np.unique(mdp.next_state[frontier][mdp.prob[frontier] > 0])
        frontier = found[~seen[found]]
        seen[frontier] = True
    return seen


# ---------------------------------------------------------------------- policies


def uniform_policy(mdp):
    """The equiprobable policy over A(s), (S, A)."""
    check_mdp(mdp)
    return mdp.legal / mdp.legal.sum(axis=1, keepdims=True)


def deterministic_policy(mdp, actions):
    """pi (S, A) that takes actions[s] in state s; actions: (S,) integers, each in A(s)."""
    check_mdp(mdp)
    actions = as_integers("actions", actions)
    if actions.shape != (mdp.n_states,):
        raise ValueError(f"actions: got shape {actions.shape}, must be ({mdp.n_states},)")
    if ((actions < 0) | (actions >= mdp.n_actions)).any():
        raise ValueError(f"actions: got {actions.min()}..{actions.max()}, must be in 0..{mdp.n_actions - 1}")
    return check_policy(mdp, np.eye(mdp.n_actions)[actions])


def check_mdp(mdp):
    """mdp; ValueError unless it is a FiniteMDP."""
    if not isinstance(mdp, FiniteMDP):
        raise ValueError(f"mdp: got {type(mdp).__name__}, must be a FiniteMDP; from_env reads gymnasium's tables")
    return mdp


def check_rng(rng):
    """rng; ValueError unless it is a numpy.random.Generator."""
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng: got {rng!r}, must be a numpy.random.Generator such as numpy.random.default_rng(0)")
    return rng


def check_policy(mdp, pi):
    """pi as a float array; ValueError unless it is (S, A) with rows that are distributions over A(s)."""
    return check_pi(check_mdp(mdp).legal, pi)


def check_pi(legal, pi):
    """As check_policy, where all that is known is which actions are legal, (S, A) bool."""
    pi = as_floats("pi", pi)
    if pi.shape != legal.shape:
        raise ValueError(f"pi: got shape {pi.shape}, must be {legal.shape}")
    bad = ~((pi >= 0).all(axis=1) & (np.abs(pi.sum(axis=1) - 1) <= 1e-9))
    if bad.any():
        s = np.flatnonzero(bad)[0]
        raise ValueError(f"pi: row {s} is {pi[s]}, must be probabilities that sum to 1")
    if (pi[~legal] > 0).any():
        raise ValueError(f"pi: probability on an action that is not legal at {_where((pi > 0) & ~legal)}, must be 0")
    return pi


def check_gamma(gamma):
    """gamma as a float; ValueError unless 0 <= gamma <= 1."""
    return check_probability("gamma", gamma)


def check_probability(name, value):
    """value as a float; ValueError unless it is a number in [0, 1]."""
    if not is_number(value) or not 0 <= value <= 1:
        raise ValueError(f"{name}: got {value!r}, must be a number in [0, 1]")
    return float(value)


def check_values(mdp, V, name="V"):
    """V as a new (S,) float array, from a number or an array; terminal states get 0."""
    V = as_floats(name, V)
    if V.shape not in ((), (check_mdp(mdp).n_states,)):
        raise ValueError(f"{name}: got shape {V.shape}, must be a number or ({mdp.n_states},)")
    if np.isnan(V).any():
        raise ValueError(f"{name}: contains NaN, must be numbers")
    return np.where(mdp.terminal, 0.0, V)


def check_count(name, value, least=1):
    """value as an int; ValueError unless it is a whole number of at least `least`."""
    if not is_number(value) or not least <= value < np.inf or int(value) != value:
        raise ValueError(f"{name}: got {value!r}, must be a whole number of at least {least}")
    return int(value)


def check_function(name, f, of):
    """f; ValueError unless it can be called. of: what it is called with, for the message."""
    if not callable(f):
        raise ValueError(f"{name}: got {f!r}, must be a function of {of}")
    return f


# ---------------------------------------------------------------------- returns


def discounted_return(rewards, gamma, t=0):
    """G_t as the direct sum over rewards R_{t+1} ... R_T; rewards[k] is R_{k+1}. eq-6, eq-7, eq-9

    gamma = 1 gives the undiscounted return (6); an episode padded with the zero rewards of an absorbing state has the
    same return, which is why (9) serves both kinds of task. Source: Sutton and Barto (2018), (3.11).
    """
    rewards, gamma = _rewards(rewards), check_gamma(gamma)
    t = FiniteMDP._index("t", t, rewards.size + 1)
    k = np.arange(t + 1, rewards.size + 1)
    return float(np.sum(gamma ** (k - t - 1) * rewards[t:]))  # eq-9


def discounted_returns(rewards, gamma):
    """G_0 ... G_{T-1}, shape (T,), by one backward pass from G_T = 0. eq-8 corrected, alg-returns

    rewards: (T,), rewards[t] is R_{t+1}.
    """
    rewards, gamma = _rewards(rewards), check_gamma(gamma)
    G = np.zeros(rewards.size + 1)
    for t in reversed(range(rewards.size)):
        G[t] = rewards[t] + gamma * G[t + 1]  # eq-8
    return G[:-1]


def _rewards(rewards):
    rewards = as_floats("rewards", rewards)
    if rewards.ndim != 1:
        raise ValueError(f"rewards: got shape {rewards.shape}, must be (T,)")
    if not np.isfinite(rewards).all():
        raise ValueError("rewards: contains a value that is not finite, must be finite")
    return rewards


# ---------------------------------------------------------------------- trajectories


@dataclass(frozen=True, eq=False)
class Trajectory:
    """S_0, A_0, R_1, S_1, ... : states (T + 1,), actions (T,), rewards (T,). eq-u-trajectory

    rewards[t] is R_{t+1}, which actions[t] earned in states[t]. terminated: whether states[-1] is terminal; a
    trajectory that only ran out of steps is not.
    """

    states: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    terminated: bool


def rollout(mdp, pi, n_steps, *, s=None, rng):
    """Follow pi for n_steps or to a terminal state. eq-u-trajectory, fig-1, alg-rollout

    s: first state; drawn from the start distribution where it is None. Returns a Trajectory.
    """
    pi, n_steps, rng = check_policy(mdp, pi), check_count("n_steps", n_steps), check_rng(rng)
    if s is not None:
        s = mdp._index("s", s, mdp.n_states)
    states, actions, rewards = _rollout(mdp.sampler(), cumulative(pi), n_steps, -1 if s is None else s, rng)
    return Trajectory(states, actions, rewards, bool(mdp.terminal[states[-1]]))


@compiled
def _rollout(world, pi_cdf, n_steps, s, rng):
    states = np.zeros(n_steps + 1, np.int64)
    actions = np.zeros(n_steps, np.int64)
    rewards = np.zeros(n_steps)
    if s < 0:
        s = draw(world.start_cdf, rng)
    states[0] = s
    t = 0
    while t < n_steps and not world.terminal[s]:
        actions[t] = draw(pi_cdf[s], rng)
        s, rewards[t] = step(world, s, actions[t], rng)
        t += 1
        states[t] = s
    return states[: t + 1], actions[:t], rewards[:t]


def sample_returns(mdp, pi, gamma, n_episodes, *, s, a=None, max_steps, rng):
    """Returns G_0 of n_episodes trajectories from state s (and first action a), (n_episodes,). eq-10, eq-11

    Their mean estimates v_pi(s), or q_pi(s, a) where a is given. Each trajectory is cut after max_steps steps, which
    leaves out at most gamma^max_steps of the value to come.
    """
    pi, gamma, rng = check_policy(mdp, pi), check_gamma(gamma), check_rng(rng)
    n_episodes, max_steps = check_count("n_episodes", n_episodes), check_count("max_steps", max_steps)
    s = mdp._index("s", s, mdp.n_states)
    if a is not None and not mdp.legal[s, mdp._index("a", a, mdp.n_actions)]:
        raise ValueError(f"a: got {a}, which is not legal in state {s}; allowed: {np.flatnonzero(mdp.legal[s])}")
    a = -1 if a is None else int(a)
    return _sample_returns(mdp.sampler(), cumulative(pi), gamma, n_episodes, s, a, max_steps, rng)


@compiled
def _sample_returns(world, pi_cdf, gamma, n_episodes, s_first, a_first, max_steps, rng):
    G = np.zeros(n_episodes)
    for i in range(n_episodes):
        s, discount = s_first, 1.0
        for t in range(max_steps):
            if world.terminal[s]:
                break
            a = a_first if t == 0 and a_first >= 0 else draw(pi_cdf[s], rng)
            s, r = step(world, s, a, rng)
            G[i] += discount * r  # eq-7
            discount *= gamma
    return G


def cumulative(prob):
    """Cumulative probabilities along the last axis, exactly 1 from the last positive entry on."""
    prob = np.asarray(prob)
    positive_after = np.cumsum(prob[..., ::-1] > 0, axis=-1)[..., ::-1] - (prob > 0)
    return np.where(positive_after > 0, np.cumsum(prob, axis=-1), 1.0)


@compiled
def draw(cdf, rng):
    """Index drawn from cumulative probabilities cdf, (K,)."""
    u = rng.random()
    k = 0
    while cdf[k] <= u:
        k += 1
    return k


@compiled
def step(world, s, a, rng):
    """One transition (s', r) of the sampled process. eq-1"""
    k = draw(world.cdf[s, a], rng)
    return world.next_state[s, a, k], world.reward[s, a, k]
