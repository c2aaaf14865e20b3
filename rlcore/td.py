"""Temporal-difference learning of values and of behaviour, one step at a time (chapter 4)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rlcore.bellman import v_from_q
from rlcore.core.checks import as_flags, check_pi, spaces
from rlcore.core.compiled import inlined
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import Run
from rlcore.core.rules import anything, checked, elementwise, takes_none
from rlcore.core.sampling import draw
from rlcore.core.schedules import at, check_schedule, constant, now
from rlcore.core.types import ArrayLike, OnEpisode, Rate, Rng, World
from rlcore.core.worlds import act, reset
from rlcore.policies import control, epsilon_greedy, expected_value, max_value

TERMS = dict(
    r=elementwise(), V=elementwise("r"), V_next=elementwise("r", "V"),
    terminated=elementwise("r", "V", "V_next", kind=as_flags),
)  # fmt: skip


@inlined
@checked(**TERMS)
def td_target(r: ArrayLike, V_next: ArrayLike, gamma: float, terminated: ArrayLike = False) -> Any:
    """The target r + gamma V(s'), where an end counts 0; elementwise.

    Parameters
    ----------
    r : ArrayLike
        Reward, a number or an array.
    V_next : ArrayLike
        V(s'), like r.
    gamma : float
        Discount, in [0, 1].
    terminated : ArrayLike
        Whether s' is terminal, like r.

    Returns
    -------
    Any
        A number, or an array.

    Notes
    -----
    Ledger: eq-u-td-target corrected, eq-23.

    Examples
    --------
    >>> from rlcore import td_target
    >>> td_target(1.0, 2.0, 0.5)
    2.0
    """
    return r + gamma * V_next * (1 - terminated)  # eq-u-td-target


@inlined
@checked(**TERMS)
def td_error(r: ArrayLike, V: ArrayLike, V_next: ArrayLike, gamma: float, terminated: ArrayLike = False) -> Any:
    """The TD error delta = r + gamma V(s') - V(s), elementwise.

    Parameters
    ----------
    r : ArrayLike
        Reward, a number or an array.
    V : ArrayLike
        V(s), like r.
    V_next : ArrayLike
        V(s'), like r.
    gamma : float
        Discount, in [0, 1].
    terminated : ArrayLike
        Whether s' is terminal, like r.

    Returns
    -------
    Any
        A number, or an array.

    Notes
    -----
    Ledger: om-td-error, eq-36.

    Examples
    --------
    >>> from rlcore import td_error
    >>> td_error(1.0, 1.5, 2.0, 0.5)
    0.5
    """
    return td_target(r, V_next, gamma, terminated) - V  # eq-36


@learner(prediction)
def td0(
    world: World, pi: ArrayLike, gamma: float, n_episodes: int, *, alpha: Rate, V0: ArrayLike = 0.0,
    max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """The values v_pi by tabular TD(0): each step moves V(s) towards r + gamma V(s').

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium.Env or its id.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    V0 : ArrayLike
        A number or (S,).
    max_steps : int | None
        An episode that long is cut, and its last step bootstraps like any other; None: a million steps, where pi ends
        every episode.
    record : int
        history keeps V before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        V holds the estimate.

    Notes
    -----
    Ledger: alg-td0, eq-19 corrected.

    References
    ----------
    Sutton (1988); Sutton and Barto (2018), section 6.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import td0
    >>> from rlcore.envs.small import random_walk
    >>> td0(random_walk(3), np.ones((5, 1)), 1.0, 500, alpha=0.05, rng=np.random.default_rng(0)).V.round(2)
    array([0.  , 0.25, 0.64, 0.83, 0.  ])
    """
    V, N = V0, np.zeros(V0.shape, np.int64)
    returns, lengths, history = log(V, n_episodes, record)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            a = draw(pi[s], rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            V[s] += at(alpha, N[s]) * td_error(r, V[s], V[s_next], gamma, terminated)  # eq-19
            N[s] += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history, N


# ---------------------------------------------------------------------- control


@takes_none
def _behaviour(name, pi, given):
    """The rule of sarsa's pi: given instead of epsilon, never beside it."""
    if (given["epsilon"] is None) == (pi is None):
        raise ValueError(f"epsilon: got {given['epsilon']!r} with pi = {pi!r}, one of the two must be given")
    if pi is None:
        given["epsilon"] = check_schedule("epsilon", given["epsilon"])
        return None
    given["epsilon"] = constant(0.0)
    return check_pi(spaces(given["world"])[0], pi)


def _of_behaviour(given, Q, *more):
    run = control(given, Q, *more)
    if given["pi"] is None:
        return run
    return replace(run, V=v_from_q(run.Q, given["pi"]), policy=given["pi"])


@learner(_of_behaviour, epsilon=anything, pi=_behaviour)
def sarsa(
    world: World, gamma: float, n_episodes: int, *, alpha: Rate, epsilon: Rate | None = None,
    pi: ArrayLike | None = None, Q0: ArrayLike = 0.0, max_steps: int | None = None, record: int = 0,
    on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """SARSA: Q(s, a) moves towards r + gamma Q(s', a') of the action a' that is taken next.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium.Env or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    epsilon : Rate | None
        Probability of a random action, else a greedy one; or decaying(...).
    pi : ArrayLike | None
        (S, A) instead of epsilon: actions come from it, and Q estimates q_pi.
    Q0 : ArrayLike
        A number or (S, A).
    max_steps : int | None
        An episode that long is cut, a million steps where None; as in every truncated one, its last step bootstraps.
    record : int
        history keeps Q before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        Q is 0 in terminal states (Q0 where an environment does not tell them), the policy epsilon-greedy in the last
        Q, or pi; V is the maximum of Q over a, under pi the mean.

    Notes
    -----
    Ledger: alg-sarsa, eq-20, cl-053.

    References
    ----------
    Sutton and Barto (2018), section 6.4.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import sarsa
    >>> from rlcore.envs.grids import gridworld
    >>> rng = np.random.default_rng(0)
    >>> run = sarsa(gridworld(3, 3, terminals=[0]), 1.0, 500, alpha=0.2, epsilon=0.1, rng=rng)
    >>> run.Q.argmax(axis=1)[1:4]
    array([3, 3, 0])
    """
    Q, N, t = Q0, np.zeros(Q0.shape, np.int64), 0
    returns, lengths, history = log(Q, n_episodes, record)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        a = epsilon_greedy(Q, s, now(epsilon, k, t), rng) if pi is None else draw(pi[s], rng)
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            t += 1
            a_next = epsilon_greedy(Q, s_next, now(epsilon, k, t), rng) if pi is None else draw(pi[s_next], rng)
            Q[s, a] += at(alpha, N[s, a]) * td_error(r, Q[s, a], Q[s_next, a_next], gamma, terminated)  # eq-20
            N[s, a] += 1
            returns[k] += r
            lengths[k] += 1
            s, a, done = s_next, a_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, Q, k, record):
            break
    return Q, returns, lengths, history, N


@learner(control)
def expected_sarsa(
    world: World, gamma: float, n_episodes: int, *, alpha: Rate, epsilon: Rate, Q0: ArrayLike = 0.0,
    max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """Expected SARSA: Q(s, a) moves towards r + gamma times the mean of Q(s', .) under the epsilon-greedy policy.

    With epsilon = 0 it is Q-learning.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    epsilon : Rate
        Probability of a random action, else a greedy one; or decaying(...).
    Q0 : ArrayLike
        First estimate, a number or (S, A).
    max_steps : int | None
        An episode that long is cut; None: a million steps, where the policy ends every episode.
    record : int
        history keeps the estimate before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        As `sarsa`.

    Notes
    -----
    Ledger: alg-expected-sarsa.

    References
    ----------
    van Seijen et al. (2009); Sutton and Barto (2018), section 6.6.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import expected_sarsa
    >>> from rlcore.envs.grids import gridworld
    >>> rng = np.random.default_rng(0)
    >>> run = expected_sarsa(gridworld(3, 3, terminals=[0]), 1.0, 500, alpha=0.2, epsilon=0.1, rng=rng)
    >>> run.Q.argmax(axis=1)[1:4]
    array([3, 3, 0])
    """
    Q, N, t = Q0, np.zeros(Q0.shape, np.int64), 0
    returns, lengths, history = log(Q, n_episodes, record)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            eps = now(epsilon, k, t)
            a = epsilon_greedy(Q, s, eps, rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            Q_next = expected_value(Q, s_next, eps)
            Q[s, a] += at(alpha, N[s, a]) * td_error(r, Q[s, a], Q_next, gamma, terminated)
            N[s, a] += 1
            t += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, Q, k, record):
            break
    return Q, returns, lengths, history, N


@learner(control)
def q_learning(
    world: World, gamma: float, n_episodes: int, *, alpha: Rate, epsilon: Rate, Q0: ArrayLike = 0.0,
    max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """Q-learning: Q(s, a) moves towards r + gamma max over a' of Q(s', a'), whatever is done next.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    epsilon : Rate
        Probability of a random action, else a greedy one; or decaying(...).
    Q0 : ArrayLike
        First estimate, a number or (S, A).
    max_steps : int | None
        An episode that long is cut; None: a million steps, where the policy ends every episode.
    record : int
        history keeps the estimate before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        As `sarsa`.

    Notes
    -----
    Ledger: alg-q-learning, eq-21, cl-056.

    References
    ----------
    Watkins (1989); Sutton and Barto (2018), section 6.5.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import q_learning
    >>> from rlcore.envs.grids import gridworld
    >>> rng = np.random.default_rng(0)
    >>> run = q_learning(gridworld(3, 3, terminals=[0]), 1.0, 500, alpha=0.2, epsilon=0.1, rng=rng)
    >>> run.Q.argmax(axis=1)[1:4]
    array([3, 3, 0])
    """
    Q, N, t = Q0, np.zeros(Q0.shape, np.int64), 0
    returns, lengths, history = log(Q, n_episodes, record)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            a = epsilon_greedy(Q, s, now(epsilon, k, t), rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            Q[s, a] += at(alpha, N[s, a]) * td_error(r, Q[s, a], max_value(Q, s_next), gamma, terminated)  # eq-21
            N[s, a] += 1
            t += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, Q, k, record):
            break
    return Q, returns, lengths, history, N
