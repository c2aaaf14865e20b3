"""Target and error of one step, and the values that a fixed set of episodes determines (chapter 4)."""

from dataclasses import replace

import numpy as np

from rlcore.bellman import v_from_q
from rlcore.core.checks import check_count, check_gamma, check_pi, check_q0, check_rng, check_v0
from rlcore.core.compiled import compiled
from rlcore.core.results import Run
from rlcore.core.sampling import cumulative, draw
from rlcore.core.worlds import act, books, check_max_steps, reset, run_loop, spaces
from rlcore.policies import epsilon_greedy, expected_value, max_value, soft_greedy
from rlcore.schedules import at, check_schedule


def td_target(r, V_next, gamma, terminated=False):
    """r + gamma V(s'), where an end counts 0; elementwise. eq-u-td-target corrected, eq-23"""
    return r + gamma * V_next * np.logical_not(terminated)  # eq-u-td-target


def td_error(r, V, V_next, gamma, terminated=False):
    """delta = r + gamma V(s') - V(s), elementwise. om-td-error, eq-36"""
    return td_target(r, V_next, gamma, terminated) - V  # eq-36


def td0(world, pi, gamma, n_episodes, *, alpha, V0=0.0, groups=None, max_steps=None, record=1, rng):
    """v_pi by tabular TD(0): each step moves V(s) towards r + gamma V(s'). alg-td0, eq-19 corrected

    world: FiniteMDP or gymnasium.Env. alpha: step size in (0, 1], or decaying(...). V0: a number or (S,).
    groups: (S,) integers from 0 on; states of one group share one value (state aggregation), and V0 is then a number.
    max_steps: an episode that long is cut, and its last step bootstraps like any other; None needs a policy that ends
    every episode. record: history keeps V before the first and after each record-th episode; 0 keeps none.
    Returns a Run. Source: Sutton (1988); Sutton and Barto (2018), section 6.1, and 9.3 for groups.
    """
    legal, terminal = spaces(world)
    pi, alpha, rng = check_pi(legal, pi), check_schedule("alpha", alpha), check_rng(rng)
    V, groups = check_v0(terminal, V0), _check_groups(terminal.size, V0, groups)
    if np.ndim(V0) == 0:
        V = np.full(groups.max() + 1, float(V0))
    settings = (check_gamma(gamma), check_count("n_episodes", n_episodes), alpha, V, groups)
    limits = check_max_steps(world, max_steps, pi), check_count("record", record, least=0)
    returns, lengths, history = run_loop(_td0, world, cumulative(pi), *settings, *limits, rng=rng)
    V, history = np.where(terminal, 0.0, V[groups]), np.where(terminal, 0.0, history[:, groups])
    return Run(returns, lengths, V=V, policy=pi, history=history if record else None)


@compiled
def _td0(world, pi_cdf, gamma, n_episodes, alpha, V, groups, max_steps, record, rng):
    history, returns, lengths = books(V, n_episodes, record)
    N = np.zeros(V.size, np.int64)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            s_next, r, terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            g, g_next = groups[s], groups[s_next]
            V[g] += at(alpha, N[g]) * (r + gamma * V[g_next] * (not terminated) - V[g])  # eq-19
            N[g] += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = V
    return returns, lengths, history


def sarsa(world, gamma, n_episodes, *, alpha, epsilon=None, pi=None, Q0=0.0, max_steps=None, record=1, rng):
    """Q(s, a) moves towards r + gamma Q(s', a') of the action a' that is taken next. alg-sarsa, eq-20, cl-053

    world: FiniteMDP or gymnasium.Env. alpha: step size in (0, 1], or decaying(...). epsilon: probability of a random
    action, else a greedy one; or decaying(...). pi: (S, A) instead of epsilon: actions come from it, and Q estimates
    q_pi. Q0: a number or (S, A). max_steps: an episode that long is cut; as in every truncated episode, its last step
    bootstraps. record: history keeps Q before the first and after each record-th episode; 0 keeps none.
    Returns a Run: Q (S, A), -inf where a is not in A(s), 0 in terminal states (Q0 where an environment does not tell
    them); policy (S, A), epsilon-greedy in the last Q, or pi; V (S,), the maximum of Q over a, under pi the mean.
    Source: Sutton and Barto (2018), section 6.4.
    """
    if (epsilon is None) == (pi is None):
        raise ValueError(f"epsilon: got {epsilon!r} with pi = {pi!r}, one of the two must be given")
    args = (gamma, n_episodes, alpha, epsilon if pi is None else 0.0, Q0, max_steps, record, rng)
    if pi is None:
        return _control(_sarsa, world, *args, None)
    pi = check_pi(spaces(world)[0], pi)
    run = _control(_sarsa, world, *args, cumulative(pi), pi=pi)
    return replace(run, V=v_from_q(run.Q, pi), policy=pi)


@compiled
def _sarsa(world, gamma, n_episodes, alpha, epsilon, Q, max_steps, record, pi_cdf, rng):
    history, returns, lengths = books(Q, n_episodes, record)
    N, now = np.zeros(Q.shape, np.int64), 0
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        eps = at(epsilon, now if epsilon.per_step else k)
        a = epsilon_greedy(Q, s, eps, rng) if pi_cdf is None else draw(pi_cdf[s], rng)
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            now += 1
            eps = at(epsilon, now if epsilon.per_step else k)
            a_next = epsilon_greedy(Q, s_next, eps, rng) if pi_cdf is None else draw(pi_cdf[s_next], rng)
            Q[s, a] += at(alpha, N[s, a]) * (r + gamma * Q[s_next, a_next] * (not terminated) - Q[s, a])  # eq-20
            N[s, a] += 1
            returns[k] += r
            lengths[k] += 1
            s, a, done = s_next, a_next, terminated or truncated or lengths[k] == max_steps
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = Q
    return returns, lengths, history


def expected_sarsa(world, gamma, n_episodes, *, alpha, epsilon, Q0=0.0, max_steps=None, record=1, rng):
    """Q(s, a) moves towards r + gamma times the mean of Q(s', .) under the epsilon-greedy policy. alg-expected-sarsa

    Arguments and result as for `sarsa`. With epsilon = 0 it is Q-learning. Source: van Seijen et al. (2009); Sutton and
    Barto (2018), section 6.6.
    """
    return _control(_expected_sarsa, world, gamma, n_episodes, alpha, epsilon, Q0, max_steps, record, rng)


@compiled
def _expected_sarsa(world, gamma, n_episodes, alpha, epsilon, Q, max_steps, record, rng):
    history, returns, lengths = books(Q, n_episodes, record)
    N, now = np.zeros(Q.shape, np.int64), 0
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            eps = at(epsilon, now if epsilon.per_step else k)
            a = epsilon_greedy(Q, s, eps, rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            target = r + gamma * expected_value(Q, s_next, eps) * (not terminated)
            Q[s, a] += at(alpha, N[s, a]) * (target - Q[s, a])
            N[s, a] += 1
            now += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = Q
    return returns, lengths, history


def q_learning(world, gamma, n_episodes, *, alpha, epsilon, Q0=0.0, max_steps=None, record=1, rng):
    """Q(s, a) moves towards r + gamma max over a' of Q(s', a'), whatever is done next. alg-q-learning, eq-21, cl-056

    Arguments and result as for `sarsa`. Source: Watkins (1989); Sutton and Barto (2018), section 6.5.
    """
    return _control(_q_learning, world, gamma, n_episodes, alpha, epsilon, Q0, max_steps, record, rng)


@compiled
def _q_learning(world, gamma, n_episodes, alpha, epsilon, Q, max_steps, record, rng):
    history, returns, lengths = books(Q, n_episodes, record)
    N, now = np.zeros(Q.shape, np.int64), 0
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            a = epsilon_greedy(Q, s, at(epsilon, now if epsilon.per_step else k), rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            Q[s, a] += at(alpha, N[s, a]) * (r + gamma * max_value(Q, s_next) * (not terminated) - Q[s, a])  # eq-21
            N[s, a] += 1
            now += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = Q
    return returns, lengths, history


def _control(loop, world, gamma, n_episodes, alpha, epsilon, Q0, max_steps, record, rng, *more, pi=None):
    """Check the settings, run the loop, and return its Run with the epsilon-greedy policy of the last Q."""
    (legal, terminal), gamma, n_episodes = spaces(world), check_gamma(gamma), check_count("n_episodes", n_episodes)
    alpha, epsilon = check_schedule("alpha", alpha), check_schedule("epsilon", epsilon)
    Q, record = check_q0(legal, terminal, Q0), check_count("record", record, least=0)
    max_steps = check_max_steps(world, max_steps, legal / legal.sum(axis=1, keepdims=True) if pi is None else pi)
    settings = (gamma, n_episodes, alpha, epsilon, Q, max_steps, record, *more)
    returns, lengths, history = run_loop(loop, world, *settings, rng=check_rng(rng))
    policy = soft_greedy(Q, float(at(epsilon, lengths.sum() if epsilon.per_step else n_episodes)))
    return Run(returns, lengths, Q.max(axis=1), Q, policy, history if record else None)


def _check_groups(S, V0, groups):
    """groups as (S,) integers; each state its own group where None."""
    if groups is None:
        return np.arange(S)
    groups = np.asarray(groups)
    if groups.shape != (S,) or groups.dtype.kind not in "iu" or groups.min() < 0:
        raise ValueError(f"groups: got {groups.dtype} of shape {groups.shape}, must be ({S},) integers from 0")
    if np.ndim(V0):
        raise ValueError(f"V0: got shape {np.shape(V0)}, must be a number where groups share values")
    return groups.astype(np.int64)
