"""Monte Carlo: values from the returns of whole episodes (chapters 1 and 4)."""

from __future__ import annotations

import numpy as np

from rlcore.core.checks import spaces
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import Run
from rlcore.core.rules import choice
from rlcore.core.schedules import at
from rlcore.core.types import ArrayLike, OnEpisode, Rate, Rng, World
from rlcore.core.worlds import episode, total


def _averages(name, target, given):
    """The rule of mc_prediction's target: zeros to average in, (S,) for states or (S, A) for pairs."""
    choice("v", "q")(name, target, given)
    legal = spaces(given["world"])[0]
    return np.zeros(legal.shape if target == "q" else len(legal))


def _of_averages(given, average, returns, lengths, history, visits):
    history, visits = history if given["record"] else None, visits.reshape(average.shape)
    if average.ndim == 1:
        return Run(returns, lengths, V=average, policy=given["pi"], history=history, visits=visits)
    legal = spaces(given["world"])[0]
    history = None if history is None else np.where(legal, history, -np.inf)
    Q = np.where(legal, average, -np.inf)
    return Run(returns, lengths, Q=Q, policy=given["pi"], history=history, visits=visits)


@learner(_of_averages, target=_averages)
def mc_prediction(
    world: World, pi: ArrayLike, gamma: float, n_episodes: int, *, first_visit: bool = True, target: str = "v",
    max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """v_pi or q_pi as the average of the returns that followed each visit.

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
    first_visit : bool
        Average over the first visit in each episode only, else over every visit.
    target : str
        "v" for states (Run.V), "q" for pairs (Run.Q, -inf where a is not in A(s)). What is never visited keeps 0.
    max_steps : int | None
        An episode that long is cut, a million steps where None; it still counts, its returns summed up to the cut, so
        that each lacks what would have come after.
    record : int
        history keeps the averages before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        V or Q holds the estimate.

    Notes
    -----
    Ledger: alg-mc-prediction, eq-10, eq-11, cl-011.

    References
    ----------
    Sutton and Barto (2018), section 5.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import mc_prediction
    >>> from rlcore.envs.small import random_walk
    >>> run = mc_prediction(random_walk(3), np.ones((5, 1)), 1.0, 500, rng=np.random.default_rng(0))
    >>> run.V.round(2)
    array([0.  , 0.23, 0.48, 0.7 , 0.  ])
    """
    average, width = target.reshape(-1), target.size // len(target)  # of pair (s, a) at s width + a, of state s at s
    N, first = np.zeros(average.size, np.int64), np.zeros(average.size, np.int64)
    returns, lengths, history = log(target, n_episodes, record)
    for k in range(n_episodes):
        states, actions, rewards, terminated = episode(world, pi, max_steps, rng)
        returns[k], lengths[k] = total(rewards), rewards.size
        if width > 1:
            states = states[:-1] * width + actions
        if first_visit:
            for t in range(rewards.size - 1, -1, -1):
                first[states[t]] = t
        G = 0.0
        for t in range(rewards.size - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            x = states[t]
            if not first_visit or first[x] == t:
                N[x] += 1
                average[x] += (G - average[x]) / N[x]
        if note(world, history, target, k, record):
            break
    return target, returns, lengths, history, N


@learner(prediction)
def constant_alpha_mc(
    world: World, pi: ArrayLike, gamma: float, n_episodes: int, *, alpha: Rate, V0: ArrayLike = 0.0,
    first_visit: bool = False, max_steps: int | None = None, record: int = 0,
    on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """v_pi by moving V(s) a step towards each return that followed s.

    The updates come after the episode, from its last state back to its first, each at once.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...); decaying(1.0) is the average of the returns.
    V0 : ArrayLike
        A number or (S,).
    first_visit : bool
        Only the first visit of a state in each episode counts.
    max_steps : int | None
        An episode that long is cut, a million steps where None; its returns, like those of a truncated one, go on with
        the V of the state that it was left in.
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
    Ledger: alg-constant-alpha-mc, eq-18.

    References
    ----------
    Sutton and Barto (2018), equation 6.1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import constant_alpha_mc
    >>> from rlcore.envs.small import random_walk
    >>> rng = np.random.default_rng(0)
    >>> constant_alpha_mc(random_walk(3), np.ones((5, 1)), 1.0, 500, alpha=0.05, rng=rng).V.round(2)
    array([0.  , 0.24, 0.64, 0.83, 0.  ])
    """
    V, N, first = V0, np.zeros(V0.shape, np.int64), np.zeros(V0.shape, np.int64)
    returns, lengths, history = log(V, n_episodes, record)
    for k in range(n_episodes):
        states, actions, rewards, terminated = episode(world, pi, max_steps, rng)
        returns[k], lengths[k] = total(rewards), rewards.size
        if first_visit:
            for t in range(rewards.size - 1, -1, -1):
                first[states[t]] = t
        G = 0.0 if terminated else V[states[-1]]
        for t in range(rewards.size - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            s = states[t]
            if not first_visit or first[s] == t:
                V[s] += at(alpha, N[s]) * (G - V[s])  # eq-18
                N[s] += 1
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history, N
