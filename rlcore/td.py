"""Temporal-difference learning of values and of behaviour, one step at a time (chapter 4)."""

from dataclasses import replace

import numpy as np

from rlcore.bellman import v_from_q
from rlcore.core.checks import as_flags, check_pi, spaces
from rlcore.core.compiled import inlined
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.rules import anything, checked, elementwise, takes_none
from rlcore.core.sampling import draw
from rlcore.core.schedules import at, check_schedule, constant, now
from rlcore.core.worlds import act, reset
from rlcore.policies import control, epsilon_greedy, expected_value, max_value

TERMS = dict(
    r=elementwise(), V=elementwise("r"), V_next=elementwise("r", "V"),
    terminated=elementwise("r", "V", "V_next", kind=as_flags),
)  # fmt: skip


@inlined
@checked(**TERMS)
def td_target(r, V_next, gamma, terminated=False):
    """r + gamma V(s'), where an end counts 0; elementwise. eq-u-td-target corrected, eq-23"""
    return r + gamma * V_next * (1 - terminated)  # eq-u-td-target


@inlined
@checked(**TERMS)
def td_error(r, V, V_next, gamma, terminated=False):
    """delta = r + gamma V(s') - V(s), elementwise. om-td-error, eq-36"""
    return td_target(r, V_next, gamma, terminated) - V  # eq-36


@learner(prediction)
def td0(world, pi, gamma, n_episodes, *, alpha, V0=0.0, max_steps=None, record=0, rng):
    """v_pi by tabular TD(0): each step moves V(s) towards r + gamma V(s'). alg-td0, eq-19 corrected

    world: FiniteMDP, gymnasium.Env or its id. alpha: step size in (0, 1], or decaying(...). V0: a number or (S,).
    max_steps: an episode that long is cut, and its last step bootstraps like any other; None needs a policy that ends
    every episode. record: history keeps V before the first and after each record-th episode; 0 keeps none.
    Returns a Run. Source: Sutton (1988); Sutton and Barto (2018), section 6.1.
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
def sarsa(world, gamma, n_episodes, *, alpha, epsilon=None, pi=None, Q0=0.0, max_steps=None, record=0, rng):
    """Q(s, a) moves towards r + gamma Q(s', a') of the action a' that is taken next. alg-sarsa, eq-20, cl-053

    world: FiniteMDP, gymnasium.Env or its id. alpha: step size in (0, 1], or decaying(...). epsilon: probability of a
    random action, else a greedy one; or decaying(...). pi: (S, A) instead of epsilon: actions come from it, and Q
    estimates q_pi. Q0: a number or (S, A). max_steps: an episode that long is cut; as in every truncated episode, its
    last step bootstraps. record: history keeps Q before the first and after each record-th episode; 0 keeps none.
    Returns a Run: Q (S, A), -inf where a is not in A(s), 0 in terminal states (Q0 where an environment does not tell
    them); policy (S, A), epsilon-greedy in the last Q, or pi; V (S,), the maximum of Q over a, under pi the mean.
    Source: Sutton and Barto (2018), section 6.4.
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
def expected_sarsa(world, gamma, n_episodes, *, alpha, epsilon, Q0=0.0, max_steps=None, record=0, rng):
    """Q(s, a) moves towards r + gamma times the mean of Q(s', .) under the epsilon-greedy policy. alg-expected-sarsa

    Arguments and result as for `sarsa`. With epsilon = 0 it is Q-learning. Source: van Seijen et al. (2009); Sutton and
    Barto (2018), section 6.6.
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
def q_learning(world, gamma, n_episodes, *, alpha, epsilon, Q0=0.0, max_steps=None, record=0, rng):
    """Q(s, a) moves towards r + gamma max over a' of Q(s', a'), whatever is done next. alg-q-learning, eq-21, cl-056

    Arguments and result as for `sarsa`. Source: Watkins (1989); Sutton and Barto (2018), section 6.5.
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
