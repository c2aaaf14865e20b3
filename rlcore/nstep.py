"""Targets of multi-step backups, on one recorded episode: n-step returns, their mixtures, lambda-returns (chapter 5).

One convention throughout: rewards (T,) holds R_1 ... R_T; values holds V(S_0) ... V(S_{T-1}) where the episode
terminated, and one more entry, V(S_T), where it was cut and goes on unseen.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rlcore.bellman import solve_policy
from rlcore.core.chains import chain
from rlcore.core.checks import (
    as_integers,
    check_count,
    check_flag,
    check_index,
    check_probability,
    check_rate,
    finite,
    finite_values,
    show,
)
from rlcore.core.compiled import compiled
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import Run
from rlcore.core.rules import array, checked, choice, count
from rlcore.core.sampling import draw
from rlcore.core.schedules import at
from rlcore.core.types import ArrayLike, Floats, Given, Ints, OnEpisode, Rate, Rng, World
from rlcore.core.worlds import act, episode, reset, total
from rlcore.mdp import FiniteMDP

# ---------------------------------------------------------------------- what an episode is


def reward_list(name: str, rewards: Any, given: Given) -> Floats:
    """The rule of rewards (T,)."""
    rewards = finite(name, rewards)
    if rewards.ndim != 1 or rewards.size == 0:
        raise ValueError(f"{name}: got shape {rewards.shape}, must be (T,) with T at least 1")
    return rewards


def value_list(name: str, values: Any, given: Given) -> Floats:
    """The rule of values (T,), or (T + 1,) where the episode was cut: (T + 1,), the last 0 where it terminated."""
    values, T = finite(name, values), given["rewards"].size
    if values.shape not in ((T,), (T + 1,)):
        raise ValueError(f"{name}: got shape {values.shape}, must be ({T},) or ({T + 1},)")
    return np.append(values, 0.0) if values.size == T else values


def visited(name: str, states: Any, given: Given) -> Ints:
    """The rule of states (T,), or (T + 1,) where the episode was cut; `values_on_the_way` looks whether V has them."""
    states = as_integers(name, states)
    if states.ndim != 1 or states.size == 0 or (states < 0).any():
        raise ValueError(f"{name}: got {show(states)}, must be (T,) or (T + 1,) states from 0 on")
    return states


def values_on_the_way(states: Ints, rewards: Floats, V: Floats) -> Floats:
    """V of the states, (T + 1,), the last 0 where the episode terminated."""
    if ((states < 0) | (states >= V.size)).any():
        raise ValueError(f"states: got {states}, must be (T,) or (T + 1,) states in 0..{V.size - 1}")
    if states.size not in (rewards.size, rewards.size + 1):
        raise ValueError(f"states: got {states.size}, must be as many as rewards, or one more")
    return value_list("values", V[states], {"rewards": rewards})


def _time(name, t, given):
    return check_index(name, t, given["rewards"].size)


def _mixture(name, weights, given):
    """The rule of weights {n: weight}, at least 0, that sum to 1."""
    if not isinstance(weights, dict) or not weights:
        raise ValueError(f"{name}: got {show(weights)}, must be {{n: weight}} with at least one n")
    weights = {check_count(name, n): check_probability(name, w) for n, w in weights.items()}
    if abs(sum(weights.values()) - 1) > 1e-9:
        raise ValueError(f"{name}: weights sum to {sum(weights.values()):.12g}, must be 1")
    return weights


def _steps_or_mixture(name, n, given):
    return _mixture(name, n, given) if isinstance(n, dict) else {check_count(name, n): 1.0}


# ---------------------------------------------------------------------- targets of one episode


@compiled
def return_to_horizon(rewards: Floats, gamma: float, t: int, h: int, c: float) -> float:
    """G_t^h(c): the rewards from t + 1 to h, then c. Older rewards may have been overwritten, R_{k+1} at k mod size."""
    for k in range(h - 1, t - 1, -1):
        c = rewards[k % rewards.size] + gamma * c  # eq-25
    return c


@compiled
def lambda_returns(rewards: Floats, values: Floats, gamma: float, lam: float, first: int) -> Floats:
    """L_t for t from `first` on, (T,), 0 before; values (T + 1,)."""
    L = np.zeros(rewards.size)
    G = values[rewards.size]
    for t in range(rewards.size - 1, first - 1, -1):
        G = rewards[t] + gamma * ((1 - lam) * values[t + 1] + lam * G)  # eq-32
        L[t] = G
    return L


@checked(rewards=reward_list, values=value_list, t=_time)
def n_step_return(rewards: ArrayLike, values: ArrayLike, gamma: float, n: int, t: int | None = None) -> float | Floats:
    """The n-step return G_t^{t+n}(V(S_{t+n})), or the complete one where t + n passes the end.

    Parameters
    ----------
    rewards : ArrayLike
        (T,).
    values : ArrayLike
        (T,) where the episode terminated, (T + 1,) where it was cut.
    gamma : float
        Discount, in [0, 1].
    n : int
        Rewards before the bootstrap.
    t : int | None
        A time in 0..T-1; all times where None.

    Returns
    -------
    float | Floats
        A number, or (T,).

    Notes
    -----
    Ledger: eq-22, eq-23, eq-24, eq-25, cl-064.

    References
    ----------
    Sutton and Barto (2018), (7.1).

    Examples
    --------
    >>> from rlcore import n_step_return
    >>> n_step_return([1.0, 0.0, 2.0], [0.0, 4.0, 0.0], 0.5, 1)
    array([3., 0., 2.])
    """
    T = rewards.size
    G = [return_to_horizon(rewards, gamma, t, min(t + n, T), values[min(t + n, T)]) for t in ([t], range(T))[t is None]]
    return np.array(G) if t is None else float(G[0])


@checked(rewards=reward_list, values=value_list, weights=_mixture)
def complex_backup(rewards: ArrayLike, values: ArrayLike, gamma: float, weights: Mapping[int, float]) -> Floats:
    """A mixture of n-step returns.

    Parameters
    ----------
    rewards : ArrayLike
        (T,).
    values : ArrayLike
        (T,) where the episode terminated, (T + 1,) where it was cut.
    gamma : float
        Discount, in [0, 1].
    weights : Mapping[int, float]
        {n: weight}, weights at least 0 that sum to 1.

    Returns
    -------
    Floats
        (T,).

    Notes
    -----
    Ledger: eq-u-complex-example, alg-complex-backup.

    References
    ----------
    Watkins (1989), section 7.2.
    """
    return sum(w * n_step_return(rewards, values, gamma, n) for n, w in weights.items())


@checked(rewards=reward_list, values=value_list)
def lambda_return(rewards: ArrayLike, values: ArrayLike, gamma: float, lam: float) -> Floats:
    """The lambda-returns L_0 ... L_{T-1} by one backward pass.

    lam = 0 gives the one-step target, lam = 1 the return, both exactly.

    Parameters
    ----------
    rewards : ArrayLike
        (T,).
    values : ArrayLike
        (T,) where the episode terminated, (T + 1,) where it was cut.
    gamma : float
        Discount, in [0, 1].
    lam : float
        In [0, 1].

    Returns
    -------
    Floats
        (T,).

    Notes
    -----
    Ledger: eq-31, eq-32, alg-lambda-return, cl-070.

    References
    ----------
    Sutton and Barto (2018), (12.18).

    Examples
    --------
    >>> from rlcore import lambda_return
    >>> lambda_return([1.0, 0.0, 2.0], [0.0, 4.0, 0.0], 0.5, 0.5)
    array([2.125, 0.5  , 2.   ])
    """
    return lambda_returns(rewards, values, gamma, lam, 0)


@checked(T_minus_t=count())
def lambda_weights(T_minus_t: int, lam: float) -> Floats:
    """Weights of the 1-step, 2-step, ... and of the complete return in L_t.

    The complete return, which comes last, gets all that the others leave.

    Parameters
    ----------
    T_minus_t : int
        How many steps are left.
    lam : float
        In [0, 1].

    Returns
    -------
    Floats
        (T_minus_t,).

    Notes
    -----
    Ledger: eq-32, fig-23, fig-24.
    """
    n = np.arange(1, T_minus_t + 1)
    return np.where(n < n.size, 1 - lam, 1.0) * lam ** (n - 1.0)  # eq-32


@checked(v=lambda name, v, given: finite_values(given["mdp"], v, name), n=_steps_or_mixture, printed=check_flag)
def error_reduction(
    mdp: FiniteMDP, pi: ArrayLike, v: ArrayLike, n: int | Mapping[int, float], gamma: float, *, printed: bool = False
) -> tuple[float, float]:
    """Both sides of max |E[n-step return with v] - v_pi| <= gamma^n max |v - v_pi|.

    Exact, from powers of the transition matrix.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    v : ArrayLike
        A number or (S,).
    n : int | Mapping[int, float]
        A number of steps, or {n: weight} for a mixture of them, whose factor is the mixture of the gamma^n.
    gamma : float
        Discount, in [0, 1].
    printed : bool
        Bootstrap from S_{t+1} whatever n is, as printed in the document; then it may fail.

    Returns
    -------
    tuple[float, float]
        (left, right).

    Notes
    -----
    Ledger: eq-30, cl-065, cl-069.

    References
    ----------
    Sutton and Barto (2018), (7.3).
    """
    v_pi, (P, r) = solve_policy(mdp, pi, gamma), chain(mdp, pi)
    expected, factor = np.zeros_like(v), 0.0
    for steps, weight in n.items():
        rewards, last = np.zeros_like(v), P @ v if printed else v
        for _ in range(steps):
            rewards, last = r + gamma * (P @ rewards), last if printed else P @ last
        expected += weight * (rewards + gamma**steps * last)
        factor += weight * gamma**steps
    return float(np.abs(expected - v_pi).max()), float(factor * np.abs(v - v_pi).max())  # eq-30


@checked(states=visited, rewards=reward_list, V=array("S"), alpha=check_rate)
def forward_increments(
    states: ArrayLike, rewards: ArrayLike, V: ArrayLike, gamma: float, lam: float, alpha: float
) -> Floats:
    """What the lambda-returns of an episode add to V, V held fixed.

    Parameters
    ----------
    states : ArrayLike
        (T,) where the episode terminated, else (T + 1,).
    rewards : ArrayLike
        (T,).
    V : ArrayLike
        (S,).
    gamma : float
        Discount, in [0, 1].
    lam : float
        In [0, 1].
    alpha : float
        Step size in (0, 1].

    Returns
    -------
    Floats
        (T, S), row t at time t; the sum over t is the update.

    Notes
    -----
    Ledger: eq-33, fig-25.
    """
    T, values = rewards.size, values_on_the_way(states, rewards, V)
    increments = np.zeros((T, V.size))
    increments[np.arange(T), states[:T]] = alpha * (lambda_returns(rewards, values, gamma, lam, 0) - values[:T])
    return increments  # eq-33


# ---------------------------------------------------------------------- learning from them


@learner(prediction)
def n_step_td(
    world: World, pi: ArrayLike, gamma: float, n: int, n_episodes: int, *, alpha: Rate, online: bool = True,
    V0: ArrayLike = 0.0, max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """The values v_pi from n-step returns.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium.Env or its id.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    n : int
        The number of rewards in a target; a state is updated n steps after its visit, or at the end.
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    online : bool
        Update at each step, else add the summed increments when the episode ends.
    V0 : ArrayLike
        A number or (S,).
    max_steps : int | None
        An episode that long is cut, and its last targets bootstrap; None: a million steps.
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
    Ledger: alg-n-step-online, alg-n-step-offline, eq-26, eq-27, eq-28, eq-29, cl-067.

    References
    ----------
    Sutton and Barto (2018), section 7.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import n_step_td
    >>> from rlcore.envs.small import random_walk
    >>> n_step_td(random_walk(3), np.ones((5, 1)), 1.0, 2, 500, alpha=0.05, rng=np.random.default_rng(0)).V.round(2)
    array([0.  , 0.29, 0.67, 0.84, 0.  ])
    """
    V, states, rewards = V0, np.zeros(n, np.int64), np.zeros(n)  # the last n steps, that of time t at t mod n
    returns, lengths, history = log(V, n_episodes, record)
    change = V if online else np.zeros_like(V)
    for k in range(n_episodes):
        s, t, done, step = reset(world, rng), 0, False, at(alpha, k)
        while not done:
            a = draw(pi[s], rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            states[t % n], rewards[t % n] = s, r
            returns[k] += r
            t += 1
            done = terminated or truncated or t >= max_steps
            for tau in range(max(t - n, 0), t if done else t - n + 1):
                G = return_to_horizon(rewards, gamma, tau, t, V[s_next] * (not terminated))  # eq-25
                change[states[tau % n]] += step * (G - V[states[tau % n]])  # eq-26, eq-27
            s = s_next
        if not online:
            V += change  # eq-29
            change[:] = 0.0
        lengths[k] = t
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history


@learner(prediction, reading=choice("in order", "summed", "recomputed"))
def offline_lambda_return(
    world: World, pi: ArrayLike, gamma: float, lam: float, n_episodes: int, *, alpha: Rate, reading: str = "in order",
    V0: ArrayLike = 0.0, max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """The values v_pi from lambda-returns, at the end of each episode.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    lam : float
        In [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    reading : str
        How the increments (33) of an episode meet. "in order": the targets are those of the V before the episode, the
        updates follow each other, each from the V that the one before left. "summed": V is held fixed for the updates,
        too, and their sum is added once. "recomputed": the targets, too, use the newest V.
    V0 : ArrayLike
        First estimate, a number or (S,).
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
        V holds the estimate.

    Notes
    -----
    Ledger: alg-lambda-return, eq-33.

    References
    ----------
    Sutton and Barto (2018), section 12.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import offline_lambda_return
    >>> from rlcore.envs.small import random_walk
    >>> rng = np.random.default_rng(0)
    >>> offline_lambda_return(random_walk(3), np.ones((5, 1)), 1.0, 0.5, 500, alpha=0.05, rng=rng).V.round(2)
    array([0.  , 0.27, 0.65, 0.83, 0.  ])
    """
    V = V0
    returns, lengths, history = log(V, n_episodes, record)
    change = np.zeros_like(V) if reading == "summed" else V
    for k in range(n_episodes):
        states, actions, rewards, terminated = episode(world, pi, max_steps, rng)
        returns[k], lengths[k], step, L = total(rewards), rewards.size, at(alpha, k), rewards
        for t in range(rewards.size):
            if t == 0 or reading == "recomputed":
                values = V[states]
                values[-1] *= not terminated
                L = lambda_returns(rewards, values, gamma, lam, t)  # eq-32
            change[states[t]] += step * (L[t] - V[states[t]])  # eq-33
        if reading == "summed":
            V += change  # eq-29
            change[:] = 0.0
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history
