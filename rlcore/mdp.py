"""Finite Markov decision processes, policies, trajectories and returns (chapter 1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.checks import Model, as_flags, as_floats, as_integers, check_finite, check_index, check_world, where
from rlcore.core.learner import learner
from rlcore.core.outcomes import (
    canonical,
    check_ends,
    check_shapes,
    freeze,
    from_arrays,
    from_env,
    from_outcomes,
    names,
    own,
    rounded_sums,
)
from rlcore.core.rules import checked, count, index, takes_none
from rlcore.core.sampling import Sampler, cumulative, draw, step
from rlcore.core.types import ArrayLike, Floats, Ints, Rng, World
from rlcore.core.worlds import act, reset

_state_of_self = index(lambda given: given["self"].n_states)


@dataclass(frozen=True, eq=False, repr=False)
class FiniteMDP(Model):
    """A finite Markov decision process: the dynamics p(s', r | s, a), one padded row of outcomes for each pair.

    Outcome k of (s, a) is (s', r) with its probability. Arrays are read-only after construction, and copies of those
    that could still be written to. The usual ways to make one are `from_outcomes`, `from_arrays` and `from_env`.

    Parameters
    ----------
    next_state : np.ndarray
        (S, A, K), the states s' of the outcomes.
    prob : np.ndarray
        (S, A, K), their probabilities, which sum to 1 for each legal pair, within 1e-9: rows further away than
        rounding, K times 2.2e-16, are divided by their sums. Outcomes of probability 0 are padding.
    reward : np.ndarray
        (S, A, K), their rewards.
    legal : np.ndarray
        (S, A), whether a is in A(s).
    terminal : np.ndarray
        (S,); a terminal state returns to itself with reward 0 under every action.
    start : np.ndarray
        (S,), distribution of S_0.
    state_names : Sequence[Any] | None
        What the states are called, for pictures.
    action_names : Sequence[Any] | None
        What the actions are called.

    Raises
    ------
    ValueError
        Where an array does not fit; the message names it, the state and the action.

    Notes
    -----
    Ledger: eq-1, alg-model-marginals.

    References
    ----------
    Sutton and Barto (2018), section 3.1.

    Examples
    --------
    >>> from rlcore import FiniteMDP
    >>> FiniteMDP.from_outcomes({(0, 0): [(0.5, 0, 1.0), (0.5, 1, 0.0)]})
    FiniteMDP(2 states, 1 actions, 2 outcomes, 1 terminal)
    """

    next_state: np.ndarray
    prob: np.ndarray
    reward: np.ndarray
    legal: np.ndarray
    terminal: np.ndarray
    start: np.ndarray
    state_names: Sequence[Any] | None = None
    action_names: Sequence[Any] | None = None

    def __post_init__(self) -> None:
        kinds = dict(next_state=as_integers, prob=as_floats, reward=as_floats, legal=as_flags, terminal=as_flags)
        for name, kind in (kinds | dict(start=as_floats)).items():
            object.__setattr__(self, name, own(name, getattr(self, name), kind))
        for name in ("state_names", "action_names"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, names(name, getattr(self, name)))
        self.validate()
        for name in ("prob", "start"):
            object.__setattr__(self, name, rounded_sums(getattr(self, name)))

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        freeze(*(x for x in state.values() if isinstance(x, np.ndarray)))

    @property
    def n_states(self) -> int:
        return self.prob.shape[0]

    @property
    def n_actions(self) -> int:
        return self.prob.shape[1]

    def __repr__(self) -> str:
        S, A, K = self.prob.shape
        return f"FiniteMDP({S} states, {A} actions, {K} outcomes, {int(self.terminal.sum())} terminal)"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FiniteMDP):
            return NotImplemented
        names = self.state_names == other.state_names and self.action_names == other.action_names
        return names and all(np.array_equal(a, b) for a, b in zip(canonical(self), canonical(other)))

    __hash__ = None

    # ------------------------------------------------------------------ construction

    @classmethod
    def from_outcomes(
        cls, outcomes: Mapping[tuple[int, int], Any], *, n_states: int | None = None, n_actions: int | None = None,
        start: ArrayLike | None = None, state_names: Sequence[Any] | None = None,
        action_names: Sequence[Any] | None = None,
    ) -> FiniteMDP:  # fmt: skip
        """Build from {(s, a): [(probability, s_next, reward), ...]}; a state without any action is terminal.

        start: a state or a distribution (S,); the default is uniform over the states that are not terminal.
        Outcomes with the same (s_next, reward) are merged. Pairs that are absent are not in A(s).
        """
        return cls(*from_outcomes(outcomes, n_states, n_actions, start), state_names, action_names)

    @classmethod
    def from_arrays(
        cls, P: Any, R: Any, *, terminal: ArrayLike | None = None, start: ArrayLike | None = None, axes: str = "SAS",
        normalise: bool = False, state_names: Sequence[Any] | None = None, action_names: Sequence[Any] | None = None,
    ) -> FiniteMDP:  # fmt: skip
        """Build from P (S, A, S) = p(s'|s, a) and R, either r(s, a) of shape (S, A) or r(s, a, s') of shape (S, A, S).

        A row of zeros in P means that the action is not in A(s); R does not matter where P is 0. terminal: (S,) bool,
        default none; their rows of P may be zeros, their rewards must be. axes: "SAS", as quantecon has them, or
        "ASS", as pymdptoolbox: P (A, S, S) and R (S, A), (A, S, S) or (S,). P may be scipy's sparse matrices, a list
        of (S, S), one for each action, or one (S A, S) whose rows have the order of axes; R is (S, A) then, or sparse
        like P. normalise: rows, which were rounded, are divided by their sums.
        """
        return cls(*from_arrays(P, R, terminal, start, axes, normalise), state_names, action_names)

    @classmethod
    def from_env(cls, env: Any) -> FiniteMDP:
        """Read the transition table `P` of a gymnasium environment (FrozenLake, Taxi, CliffWalking, MDPEnv).

        P[s][a], dicts or lists, are rows (probability, s_next, reward, terminated); where the fourth field lacks,
        states that every action stays in for reward 0 are terminal. Without initial_state_distrib an episode starts in
        any state that is not terminal.

        A state that is entered with terminated=True becomes terminal, hence absorbing with reward 0, whatever its own
        row says. Raises ValueError where there is no table (Blackjack), or where a state can be entered both ways.
        """
        outcomes, table, settings = from_env(env)
        mdp = cls.from_outcomes(outcomes, **settings)
        check_ends(mdp, table)
        return mdp

    # ------------------------------------------------------------------ checks and equations (1)-(5)

    def validate(self) -> None:
        """Raise ValueError unless the arrays describe a finite MDP: shapes, ranges, and rows that sum to 1. eq-2"""
        S, A = check_shapes(self)
        for name in ("prob", "reward", "start"):
            bad = ~np.isfinite(getattr(self, name))
            if bad.any():
                raise ValueError(f"{name}: not finite at {where(bad)}, must be finite")
        for name in ("prob", "start"):
            bad = getattr(self, name) < 0
            if bad.any():
                raise ValueError(f"{name}: negative at {where(bad)}, must be at least 0")
        if self.next_state.min() < 0 or self.next_state.max() >= S:
            bad = (self.next_state < 0) | (self.next_state >= S)
            raise ValueError(f"next_state: got {self.next_state[bad][0]} at {where(bad)}, must be in 0..{S - 1}")
        total = self.prob.sum(axis=2)  # eq-2
        bad = np.abs(total - self.legal) > 1e-9
        if bad.any():
            allowed = "1, or 0 for an action that is not legal"
            raise ValueError(f"prob: sums to {total[bad][0]:.12g} at {where(bad)}, must be {allowed}")
        if not self.legal.any(axis=1).all():
            raise ValueError(
                f"legal: no action at (s={np.flatnonzero(~self.legal.any(axis=1))[0]}), needs at least one"
            )
        used = (self.prob > 0) & self.terminal[:, None, None]
        bad = used & (self.next_state != np.arange(S)[:, None, None])
        if bad.any():
            raise ValueError(f"next_state: terminal state left at {where(bad)}, must return to itself")
        bad = used & (self.reward != 0)
        if bad.any():
            raise ValueError(f"reward: got {self.reward[bad][0]:g} on a terminal state at {where(bad)}, must be 0")
        if abs(self.start.sum() - 1) > 1e-9:
            raise ValueError(f"start: sums to {self.start.sum():.12g}, must be 1")
        if (self.start[self.terminal] > 0).any():
            raise ValueError("start: puts probability on a terminal state, must be 0 there")

    @checked(s_next=_state_of_self, r=check_finite, s=_state_of_self, a=index(lambda given: given["self"].n_actions))
    def p(self, s_next: int, r: float, s: int, a: int) -> float:
        """Probability of s_next and reward r after action a in state s. eq-1"""
        return float(self.prob[s, a, (self.next_state[s, a] == s_next) & (self.reward[s, a] == r)].sum())

    def transition_probs(self) -> Floats:
        """p(s'|s, a) as (S, A, S); rows of illegal actions are 0. eq-3, eq-u-transition-inline"""
        S, A = self.n_states, self.n_actions
        P = np.zeros((S, A, S))
        np.add.at(P, (np.arange(S)[:, None, None], np.arange(A)[:, None], self.next_state), self.prob)  # eq-3
        return P

    def expected_reward(self) -> Floats:
        """r(s, a) as (S, A); 0 for illegal actions. eq-4"""
        return (self.reward * self.prob).sum(axis=2)  # eq-4

    def expected_reward_sas(self) -> Floats:
        """r(s, a, s') as (S, A, S); NaN where p(s'|s, a) = 0, for there it is not defined. eq-5"""
        S, A = self.n_states, self.n_actions
        total = np.zeros((S, A, S))
        index = (np.arange(S)[:, None, None], np.arange(A)[:, None], self.next_state)
        np.add.at(total, index, self.reward * self.prob)
        P = self.transition_probs()
        return np.divide(total, P, out=np.full_like(P, np.nan), where=P > 0)  # eq-5

    def sampler(self) -> Sampler:
        """Arrays from which compiled loops draw: next_state, reward, cumulative probabilities, terminal, start."""
        terminal = self.terminal.astype(np.uint8)
        return Sampler(
            self.next_state, self.reward, cumulative(self.prob), terminal, cumulative(self.start), np.zeros(2, np.int64)
        )

    def predecessors(self) -> tuple[Ints, Ints]:
        """States from which each state can be reached in one step, as (indptr (S + 1,), indices): those of s are
        indices[indptr[s]:indptr[s + 1]], in increasing order."""
        S = self.n_states
        s = np.broadcast_to(np.arange(S)[:, None, None], self.prob.shape)
        edges = np.unique(self.next_state[self.prob > 0].astype(np.int64) * S + s[self.prob > 0])
        indptr = np.concatenate([[0], np.cumsum(np.bincount(edges // S, minlength=S))])
        return indptr, (edges % S).astype(np.int32)


# ---------------------------------------------------------------------- policies


@checked
def uniform_policy(mdp: FiniteMDP) -> Floats:
    """The policy that takes all legal actions with the same probability.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.

    Returns
    -------
    Floats
        (S, A).

    Examples
    --------
    >>> from rlcore import uniform_policy
    >>> from rlcore.envs.small import zero_loop
    >>> uniform_policy(zero_loop())
    array([[0.5, 0.5],
           [0.5, 0.5]])
    """
    return mdp.legal / mdp.legal.sum(axis=1, keepdims=True)


def _legal_actions(name, actions, given):
    actions, (S, A) = as_integers(name, actions), given["mdp"].legal.shape
    if actions.shape != (S,):
        raise ValueError(f"{name}: got shape {actions.shape}, must be ({S},)")
    if ((actions < 0) | (actions >= A)).any():
        raise ValueError(f"{name}: got {actions.min()}..{actions.max()}, must be in 0..{A - 1}")
    if not (legal := given["mdp"].legal[np.arange(S), actions]).all():
        s = np.flatnonzero(~legal)[0]
        raise ValueError(f"{name}: got {actions[s]} in state {s}, must be legal: {given['mdp'].legal[s].nonzero()[0]}")
    return actions


@checked(actions=_legal_actions)
def deterministic_policy(mdp: FiniteMDP, actions: ArrayLike) -> Floats:
    """The policy that takes actions[s] in state s.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    actions : ArrayLike
        (S,), each in A(s).

    Returns
    -------
    Floats
        (S, A).

    Examples
    --------
    >>> from rlcore import deterministic_policy
    >>> from rlcore.envs.small import zero_loop
    >>> deterministic_policy(zero_loop(), [1, 0])
    array([[0., 1.],
           [1., 0.]])
    """
    return np.eye(mdp.n_actions)[actions]


# ---------------------------------------------------------------------- returns


@checked(t=index(lambda given: given["rewards"].size + 1))
def discounted_return(rewards: ArrayLike, gamma: float, t: int = 0) -> float:
    """The return G_t as the direct sum over the rewards R_{t+1} ... R_T.

    gamma = 1 gives the undiscounted return (6); an episode padded with the zero rewards of an absorbing state has the
    same return, which is why (9) serves both kinds of task.

    Parameters
    ----------
    rewards : ArrayLike
        (T,); rewards[k] is R_{k+1}.
    gamma : float
        Discount, in [0, 1].
    t : int
        The time, in 0..T.

    Returns
    -------
    float
        G_t.

    Notes
    -----
    Ledger: eq-6, eq-7, eq-9.

    References
    ----------
    Sutton and Barto (2018), (3.11).

    Examples
    --------
    >>> from rlcore import discounted_return
    >>> discounted_return([1.0, 0.0, 2.0], 0.5)
    1.5
    """
    k = np.arange(t + 1, rewards.size + 1)
    return float(np.sum(gamma ** (k - t - 1) * rewards[t:]))  # eq-9


@checked
def discounted_returns(rewards: ArrayLike, gamma: float) -> Floats:
    """The returns G_0 ... G_{T-1} by one backward pass from G_T = 0.

    Parameters
    ----------
    rewards : ArrayLike
        (T,); rewards[t] is R_{t+1}.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (T,).

    Notes
    -----
    Ledger: eq-8 corrected, alg-returns.

    Examples
    --------
    >>> from rlcore import discounted_returns
    >>> discounted_returns([1.0, 0.0, 2.0], 0.5)
    array([1.5, 1. , 2. ])
    """
    G = np.zeros(rewards.size + 1)
    for t in reversed(range(rewards.size)):
        G[t] = rewards[t] + gamma * G[t + 1]  # eq-8
    return G[:-1]


# ---------------------------------------------------------------------- trajectories


@dataclass(frozen=True, eq=False)
class Trajectory:
    """What was met on the way: S_0, A_0, R_1, S_1, ....

    rewards[t] is R_{t+1}, which actions[t] earned in states[t].

    Parameters
    ----------
    states : np.ndarray
        (T + 1,).
    actions : np.ndarray
        (T,); actions[t] was taken in states[t].
    rewards : np.ndarray
        (T,); rewards[t] is R_{t+1}, which actions[t] earned.
    terminated : bool
        Whether states[-1] is terminal; a trajectory that only ran out of steps is not.

    Notes
    -----
    Ledger: eq-u-trajectory.
    """

    states: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    terminated: bool


@takes_none
def _first_state(name, s, given):
    """The rule of a first state, -1 for one drawn from the start distribution, as it always is in an environment."""
    if s is None:
        return -1
    return check_index(name, s, check_world("world", given["world"]).n_states)


@learner(lambda given, s, a, r, terminated: Trajectory(s, a, r, bool(terminated)), s=_first_state)
def rollout(world: World, pi: ArrayLike, n_steps: int, *, s: int | None = None, rng: Rng) -> Trajectory:
    """Follow pi for n_steps, or to a terminal state.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium.Env or its id.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    n_steps : int
        Most steps.
    s : int | None
        First state of a FiniteMDP; drawn from the start distribution where None.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Trajectory
        The states, actions and rewards; an environment that truncates the episode ends it, too.

    Notes
    -----
    Ledger: eq-u-trajectory, fig-1, alg-rollout.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import rollout
    >>> from rlcore.envs.small import random_walk
    >>> rollout(random_walk(3), np.ones((5, 1)), 20, rng=np.random.default_rng(0)).states
    array([2, 1, 2, 3, 4])
    """
    states, actions, rewards = np.zeros(n_steps + 1, np.int64), np.zeros(n_steps, np.int64), np.zeros(n_steps)
    if s < 0:
        s, terminated, truncated = reset(world, rng), False, False
    else:
        terminated, truncated = world.terminal[s] == 1, False
    states[0], t = s, 0
    while t < n_steps and not terminated and not truncated:
        actions[t] = draw(pi[s], rng)
        s, rewards[t], terminated, truncated = act(world, s, actions[t], rng)
        t += 1
        states[t] = s
    return states[: t + 1], actions[:t], rewards[:t], terminated


@takes_none
def _first_action(name, a, given):
    """The rule of a first action, -1 for one that the policy draws."""
    if a is None:
        return -1
    legal, s = given["world"].legal, given["s"]
    if not legal[s, check_index(name, a, legal.shape[1])]:
        raise ValueError(f"{name}: got {a}, which is not legal in state {s}; allowed: {np.flatnonzero(legal[s])}")
    return int(a)


@learner(lambda given, G: G, world=check_world, s=index(lambda given: given["world"].n_states), a=_first_action,
         max_steps=count())  # fmt: skip
def sample_returns(
    world: FiniteMDP, pi: ArrayLike, gamma: float, n_episodes: int, *, s: int, a: int | None = None, max_steps: int,
    rng: Rng,
) -> Floats:  # fmt: skip
    """Returns G_0 of trajectories that start in state s, with action a where it is given.

    Their mean estimates v_pi(s), or q_pi(s, a).

    Parameters
    ----------
    world : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    s : int
        First state.
    a : int | None
        First action; None where the policy chooses it, too.
    max_steps : int
        Each trajectory is cut there, which leaves out at most gamma^max_steps of the value to come.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Floats
        (n_episodes,).

    Notes
    -----
    Ledger: eq-10, eq-11.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import sample_returns
    >>> from rlcore.envs.small import random_walk
    >>> rng = np.random.default_rng(0)
    >>> sample_returns(random_walk(3), np.ones((5, 1)), 1.0, 8, s=2, max_steps=100, rng=rng)
    array([0., 1., 0., 0., 1., 0., 1., 1.])
    """
    G, s_first, a_first = np.zeros(n_episodes), s, a
    for i in range(n_episodes):
        s, discount = s_first, 1.0
        for t in range(max_steps):
            if world.terminal[s]:
                break
            a = a_first if t == 0 and a_first >= 0 else draw(pi[s], rng)
            s, r = step(world, s, a, rng)
            G[i] += discount * r  # eq-7
            discount *= gamma
    return (G,)
