"""What chapter 3 does once: whole trajectories, listed; where updates are spent; a pole balanced without a model."""

import itertools
from dataclasses import dataclass

import numpy as np

from rlcore.core.checks import (
    check_count,
    check_gamma,
    check_policy,
    check_positive,
    check_probability,
    checked,
    finite,
    function_of,
)
from rlcore.core.compiled import compiled
from rlcore.core.results import Run
from rlcore.core.sampling import draw, step
from rlcore.mdp import discounted_returns
from rlcore.neurons import softmax
from rlcore.policies import epsilon_greedy, max_value


def trajectory_probability(mdp, pi, states, actions):
    """p(s_1, a_1, ..., s_T, a_T): start, then policy and dynamics in turn; no dynamics after a_T. eq-u-traj-prob

    states, actions: (T,) each.
    """
    states, actions = np.asarray(states), np.asarray(actions)
    if states.shape != actions.shape or states.ndim != 1 or states.size == 0:
        raise ValueError(f"states: got shape {states.shape}, must be that of actions, {actions.shape}, and not empty")
    pi, P = check_policy(mdp, pi), mdp.transition_probs()
    policy, dynamics = pi[states, actions], P[states[:-1], actions[:-1], states[1:]]
    return float(mdp.start[states[0]] * policy.prod() * dynamics.prod())  # eq-u-traj-prob


def trajectories(mdp, pi, T):
    """Every trajectory of T states and actions: states (n, T), actions (n, T), probabilities (n,). fig-8"""
    T = check_count("T", T)
    states = np.array(list(itertools.product(range(mdp.n_states), repeat=T)))
    actions = np.array(list(itertools.product(range(mdp.n_actions), repeat=T)))
    states, actions = np.repeat(states, len(actions), axis=0), np.tile(actions, (len(states), 1))
    return states, actions, np.array([trajectory_probability(mdp, pi, *tau) for tau in zip(states, actions)])


def objective(mdp, pi, T):
    """Expected sum of T rewards, by enumeration of every trajectory. eq-u-objective, fig-8"""
    states, actions, prob = trajectories(mdp, pi, T)
    return float(prob @ mdp.expected_reward()[states, actions].sum(axis=1))  # eq-u-objective


@dataclass(frozen=True, eq=False)
class Updates:
    """Q (S, A); visits (S, A), how often each pair was updated; history (n_updates // record + 1, S, A), Q_0 first."""

    Q: np.ndarray
    visits: np.ndarray
    history: np.ndarray


def spread_updates(mdp, gamma, n_updates, *, where, epsilon=0.1, record=1, rng):
    """n_updates backups (17), each of one pair, with the choice of pairs as the only difference. cl-022

    where: "trajectory" updates the pairs that an epsilon-greedy agent meets, from the start state to the end and again;
    "uniform" draws every pair outside terminal states equally often. Source: Sutton and Barto (2018), section 8.6.
    """
    if where not in ("trajectory", "uniform"):
        raise ValueError(f'where: got {where!r}, must be "trajectory" or "uniform"')
    epsilon = check_probability("epsilon", epsilon)
    n_updates, record = check_count("n_updates", n_updates), check_count("record", record)
    pairs = np.argwhere(mdp.legal & ~mdp.terminal[:, None])
    Q0 = np.where(mdp.legal, 0.0, -np.inf)
    follow = where == "trajectory"
    arguments = (mdp.sampler(), mdp.prob, pairs, Q0, check_gamma(gamma), n_updates, epsilon, follow, record, rng)
    return Updates(*_spread_updates(*arguments))


@compiled
def _spread_updates(world, prob, pairs, Q0, gamma, n_updates, epsilon, follow, record, rng):
    Q, visits = Q0.copy(), np.zeros(Q0.shape, np.int64)
    history = np.zeros((n_updates // record + 1, *Q0.shape))
    history[0] = Q
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
            history[(i + 1) // record] = Q
        if follow:
            s, _ = step(world, s, a, rng)
            if world.terminal[s]:
                s = draw(world.start_cdf, rng)
    return Q, visits, history


# ---------------------------------------------------------------------- chapter 3's form


@checked(
    start=function_of("rng="), step=function_of("(x, a)"), alive=function_of("x"), alpha=check_positive, scale=finite
)
def reinforce_linear(start, step, alive, n_actions, gamma, n_episodes, *, alpha, scale=1.0, max_steps=200, rng):
    """Policy gradient with a softmax that is linear in the state, returns to go and their mean as baseline. cl-025

    start(rng=) -> (d,) first state; step(x, a) -> next state; alive(x) -> whether to go on. Each step pays 1.
    alpha: step size; scale: (d,) or a number that divides the state, so that its parts are of order 1.
    Returns a Run; policy is W (A, d), history (n_episodes + 1, A, d). Source: Williams (1992).
    """
    W = np.zeros((n_actions, np.size(start(rng=rng))))
    lengths, history = [], [W]
    for _ in range(n_episodes):
        x, features, gradients = start(rng=rng), [], []
        while len(features) < max_steps and alive(x):
            probs = softmax(W @ (x / scale))
            a = min(int((np.cumsum(probs) <= rng.random()).sum()), n_actions - 1)
            features.append(x / scale)
            gradients.append(np.eye(n_actions)[a] - probs)  # of log pi(a|x) with respect to the preferences
            x = step(x, a)
        G = discounted_returns(np.ones(len(features)), gamma)
        W = W + alpha * np.einsum("t,ta,td->ad", G - G.mean(), gradients, features) / len(features)
        lengths.append(len(features))
        history.append(W)
    return Run(np.array(lengths, float), np.array(lengths), policy=W, history=np.array(history))
