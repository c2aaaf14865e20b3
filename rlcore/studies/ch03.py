"""What chapter 3 does once: whole trajectories, listed; where updates are spent; a pole balanced without a model."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rlcore.core.checks import as_integers, check_count, check_positive, finite, show
from rlcore.core.compiled import compiled
from rlcore.core.learner import keep
from rlcore.core.results import Run
from rlcore.core.rules import checked, choice, count, function_of
from rlcore.core.sampling import draw, step
from rlcore.core.types import ArrayLike, Floats, Ints, Rng
from rlcore.mdp import FiniteMDP, discounted_returns
from rlcore.neurons import softmax
from rlcore.policies import epsilon_greedy, max_value


def _visited(name, states, given):
    states, (S, _) = as_integers(name, states), given["mdp"].legal.shape
    if states.ndim != 1 or states.size == 0 or ((states < 0) | (states >= S)).any():
        raise ValueError(f"{name}: got {show(states)}, must be (T,) states in 0..{S - 1}")
    return states


def _taken(name, actions, given):
    actions, (_, A), shape = as_integers(name, actions), given["mdp"].legal.shape, given["states"].shape
    if actions.shape != shape or ((actions < 0) | (actions >= A)).any():
        raise ValueError(f"{name}: got {show(actions)}, must be {shape} as states, each in 0..{A - 1}")
    return actions


@checked(states=_visited, actions=_taken)
def trajectory_probability(mdp: FiniteMDP, pi: ArrayLike, states: ArrayLike, actions: ArrayLike) -> float:
    """p(s_1, a_1, ..., s_T, a_T): start, then policy and dynamics in turn; no dynamics after a_T.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy.
    states : ArrayLike
        (T,).
    actions : ArrayLike
        (T,).

    Returns
    -------
    float
        The probability.

    Notes
    -----
    Ledger: eq-u-traj-prob.

    Examples
    --------
    >>> from rlcore.envs.small import two_state_mdp
    >>> from rlcore.studies.ch03 import trajectory_probability
    >>> trajectory_probability(two_state_mdp(), [[0.5, 0.5], [0.5, 0.5]], [0, 1], [1, 0])
    0.2
    """
    policy, dynamics = pi[states, actions], mdp.transition_probs()[states[:-1], actions[:-1], states[1:]]
    return float(mdp.start[states[0]] * policy.prod() * dynamics.prod())  # eq-u-traj-prob


MOST = 10**6  # trajectories that are listed


def _few_steps(name, T, given):
    T, pairs = check_count(name, T), given["mdp"].legal.size
    if T > 20 or pairs**T > MOST:
        raise ValueError(
            f"{name}: got {T}, makes {pairs}^{T} trajectories, must make at most {MOST:,}, and be at most 20"
        )
    return T


@checked(T=_few_steps)
def trajectories(mdp: FiniteMDP, pi: ArrayLike, T: int) -> tuple[Ints, Ints, Floats]:
    """Every trajectory of T states and actions.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy.
    T : int
        At most 20, and at most a million trajectories.

    Returns
    -------
    states : Ints
        (n, T).
    actions : Ints
        (n, T).
    prob : Floats
        (n,), their probabilities.

    Notes
    -----
    Ledger: fig-8.
    """
    states = np.array(list(itertools.product(range(mdp.n_states), repeat=T)))
    actions = np.array(list(itertools.product(range(mdp.n_actions), repeat=T)))
    states, actions = np.repeat(states, len(actions), axis=0), np.tile(actions, (len(states), 1))
    return states, actions, np.array([trajectory_probability.unchecked(mdp, pi, *tau) for tau in zip(states, actions)])


def objective(mdp: FiniteMDP, pi: ArrayLike, T: int) -> float:
    """Expected sum of T rewards, by enumeration of every trajectory.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy.
    T : int
        As for `trajectories`.

    Returns
    -------
    float
        The sum, undiscounted.

    Notes
    -----
    Ledger: eq-u-objective, fig-8.
    """
    states, actions, prob = trajectories(mdp, pi, T)
    return float(prob @ mdp.expected_reward()[states, actions].sum(axis=1))  # eq-u-objective


@dataclass(frozen=True, eq=False)
class Updates:
    """What `spread_updates` found.

    Parameters
    ----------
    Q : np.ndarray
        (S, A).
    visits : np.ndarray
        (S, A), how often each pair was updated.
    history : np.ndarray
        (n_updates // record + 1, S, A), Q_0 first.
    """

    Q: np.ndarray
    visits: np.ndarray
    history: np.ndarray


@checked(where=choice("trajectory", "uniform"), record=count())
def spread_updates(
    mdp: FiniteMDP, gamma: float, n_updates: int, *, where: str, epsilon: float = 0.1, record: int = 1, rng: Rng
) -> Updates:
    """Backups (17), each of one pair, with the choice of pairs as the only difference.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    gamma : float
        Discount, in [0, 1].
    n_updates : int
        How many.
    where : str
        "trajectory": the pairs that an epsilon-greedy agent meets, from the start state to the end and again;
        "uniform": every pair outside terminal states equally often.
    epsilon : float
        Of that agent.
    record : int
        Keep Q after each record-th update.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Updates
        Q, visits and history.

    Notes
    -----
    Ledger: cl-022.

    References
    ----------
    Sutton and Barto (2018), section 8.6.
    """
    pairs = np.argwhere(mdp.legal & ~mdp.terminal[:, None])
    Q0 = np.where(mdp.legal, 0.0, -np.inf)
    follow = where == "trajectory"
    return Updates(*_spread_updates(mdp.sampler(), mdp.prob, pairs, Q0, gamma, n_updates, epsilon, follow, record, rng))


@compiled
def _spread_updates(world, prob, pairs, Q0, gamma, n_updates, epsilon, follow, record, rng):
    Q, visits = Q0.copy(), np.zeros(Q0.shape, np.int64)
    history = np.zeros((n_updates // record + 1, *Q0.shape))
    keep(history[0], Q)
    s = draw(world.start_cdf, rng)
    for i in range(n_updates):
        if follow:
            a = epsilon_greedy(Q, s, epsilon, rng)
        else:
            j = int(rng.random() * len(pairs))
            s, a = pairs[j, 0], pairs[j, 1]
        q = 0.0
        for k in range(prob.shape[2]):
            if prob[s, a, k] > 0:
                q += prob[s, a, k] * (world.reward[s, a, k] + gamma * max_value(Q, world.next_state[s, a, k]))
        Q[s, a] = q  # eq-17
        visits[s, a] += 1
        if (i + 1) % record == 0:
            keep(history[(i + 1) // record], Q)
        if follow:
            s, _ = step(world, s, a, rng)
            if world.terminal[s]:
                s = draw(world.start_cdf, rng)
    return Q, visits, history


def _divisors(name, scale, given):
    scale = finite(name, scale)
    if scale.ndim > 1 or not (scale > 0).all():
        raise ValueError(f"{name}: got {show(scale)}, must be (d,) or a number, above 0")
    return scale


@checked(
    start=function_of("rng="), step=function_of("(x, a)"), alive=function_of("x"), alpha=check_positive,
    scale=_divisors,
)  # fmt: skip
def reinforce_linear(
    start: Callable[..., Floats], step: Callable[[Floats, int], Floats], alive: Callable[[Floats], bool],
    n_actions: int, gamma: float, n_episodes: int, *, alpha: float, scale: ArrayLike = 1.0, max_steps: int = 200,
    rng: Rng,
) -> Run:  # fmt: skip
    """Policy gradient with a softmax linear in the state, returns to go less their mean.

    Each step pays 1.

    Parameters
    ----------
    start : Callable[..., Floats]
        start(rng=) gives the first state, (d,).
    step : Callable[[Floats, int], Floats]
        step(x, a) gives the next state.
    alive : Callable[[Floats], bool]
        alive(x) says whether to go on.
    n_actions : int
        A.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Episodes.
    alpha : float
        Step size.
    scale : ArrayLike
        (d,) or a number that divides the state, so that its parts are of order 1.
    max_steps : int
        Where an episode is cut.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Run
        policy is W (A, d), history (n_episodes + 1, A, d).

    Notes
    -----
    Ledger: cl-025.

    References
    ----------
    Williams (1992).
    """
    W = np.zeros((n_actions, np.size(start(rng=rng))))
    if scale.size not in (1, W.shape[1]):
        raise ValueError(f"scale: got {scale.size} numbers, must be one, or one for each of {W.shape[1]} of a state")
    lengths, history = [], [W]
    for _ in range(n_episodes):
        x, features, gradients = start(rng=rng), [], []
        while len(features) < max_steps and alive(x):
            probs = softmax(W @ (x / scale))
            a = min(int((np.cumsum(probs) <= rng.random()).sum()), n_actions - 1)
            features.append(x / scale)
            gradients.append(np.eye(n_actions)[a] - probs)  # of log pi(a|x) with respect to the preferences
            x = step(x, a)
        if not features:
            raise ValueError("start: gave a state in which there is nothing to do, must give one that is alive")
        G = discounted_returns(np.ones(len(features)), gamma)
        W = W + alpha * np.einsum("t,ta,td->ad", G - G.mean(), gradients, features) / len(features)
        lengths.append(len(features))
        history.append(W)
    return Run(np.array(lengths, float), np.array(lengths), policy=W, history=np.array(history))
