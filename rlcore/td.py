"""Learning values from experience: Monte Carlo averages and temporal differences (chapters 1 and 4)."""

from dataclasses import replace

import numpy as np

from rlcore.bellman import v_from_q
from rlcore.compiled import compiled
from rlcore.episodes import batch_mc, batch_td, certainty_equivalence, td_error, td_target
from rlcore.experience import act, at, books, check_max_steps, check_schedule, reset, run_loop, spaces
from rlcore.mdp import check_count, check_gamma, check_pi, check_rng, cumulative, draw
from rlcore.results import Run
from rlcore.tabular import check_q0, check_v0, epsilon_greedy, expected_value, max_value, soft_greedy

__all__ = [
    "batch_mc",
    "batch_td",
    "certainty_equivalence",
    "constant_alpha_mc",
    "expected_sarsa",
    "mc_prediction",
    "q_learning",
    "sarsa",
    "td0",
    "td_error",
    "td_target",
]


def mc_prediction(world, pi, gamma, n_episodes, *, first_visit=True, target="v", max_steps, rng):
    """v_pi or q_pi as the average of the returns that followed each visit. alg-mc-prediction, eq-10, eq-11, cl-011

    world: FiniteMDP or gymnasium.Env. first_visit: average over the first visit in each episode only, else over every
    visit. target: "v" for states (Run.V), "q" for pairs (Run.Q, -inf where a is not in A(s)). What is never visited
    keeps 0. max_steps: an episode that long is cut (its length is max_steps); it still counts, its returns summed up to
    the cut, so that each lacks what would have come after. Returns a Run.
    Source: Sutton and Barto (2018), section 5.1.
    """
    legal, n_episodes = spaces(world)[0], check_count("n_episodes", n_episodes)
    max_steps = check_count("max_steps", max_steps)
    pi, gamma, rng = check_pi(legal, pi), check_gamma(gamma), check_rng(rng)
    if target not in ("v", "q"):
        raise ValueError(f'target: got {target!r}, allowed are "v" and "q"')
    S, A = legal.shape
    width = A if target == "q" else 1  # the averages stand at s * width, plus a where pairs are averaged
    settings = (gamma, n_episodes, bool(first_visit), S, width, max_steps)
    returns, lengths, history = run_loop(_mc_prediction, world, cumulative(pi), *settings, rng=rng)
    if target == "v":
        return Run(returns, lengths, V=history[-1].copy(), policy=pi, history=history)
    history = np.where(legal, history.reshape(-1, S, A), -np.inf)
    return Run(returns, lengths, Q=history[-1].copy(), policy=pi, history=history)


@compiled
def _mc_prediction(world, pi_cdf, gamma, n_episodes, first_visit, S, width, max_steps, rng):
    average, n_visits, seen_in = np.zeros(S * width), np.zeros(S * width), np.full(S * width, -1)
    history, returns, lengths = books(average, n_episodes, 1)
    visited, rewards, counts = np.zeros(max_steps, np.int64), np.zeros(max_steps), np.zeros(max_steps, np.bool_)
    for i in range(n_episodes):
        s, n, done = reset(world, rng), 0, False
        while not done:
            a = draw(pi_cdf[s], rng)
            x = s * width + a if width > 1 else s
            visited[n], counts[n] = x, not first_visit or seen_in[x] != i
            seen_in[x] = i
            s, rewards[n], terminated, truncated = act(world, s, a, rng)
            returns[i] += rewards[n]
            n += 1
            done = terminated or truncated or n == max_steps
        lengths[i] = n
        G = 0.0
        for t in range(n - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            if counts[t]:
                x = visited[t]
                n_visits[x] += 1
                average[x] += (G - average[x]) / n_visits[x]
        history[i + 1] = average
    return returns, lengths, history


def constant_alpha_mc(world, pi, gamma, n_episodes, *, alpha, V0=0.0, first_visit=False, max_steps=None, record=1, rng):
    """v_pi by moving V(s) a step towards each return that followed s. alg-constant-alpha-mc, eq-18

    world: FiniteMDP or gymnasium.Env. The updates come after the episode, from its last state back to its first, each
    at once. alpha: step size in (0, 1], or decaying(...); decaying(1.0) is the average of the returns. V0: a number or
    (S,). first_visit: only the first visit of a state in each episode counts. max_steps: an episode that long is cut;
    its returns, like those of a truncated one, go on with the V of the state that it was left in.
    record: history keeps V before the first and after each record-th episode; 0 keeps none. Returns a Run.
    Source: Sutton and Barto (2018), equation 6.1.
    """
    legal, terminal = spaces(world)
    pi, V, alpha, rng = check_pi(legal, pi), check_v0(terminal, V0), check_schedule("alpha", alpha), check_rng(rng)
    settings = (check_gamma(gamma), check_count("n_episodes", n_episodes), alpha, V, bool(first_visit))
    limits = check_max_steps(world, max_steps, pi), check_count("record", record, least=0)
    returns, lengths, history = run_loop(_constant_alpha_mc, world, cumulative(pi), *settings, *limits, rng=rng)
    return Run(returns, lengths, V=V, policy=pi, history=history if record else None)


@compiled
def _constant_alpha_mc(world, pi_cdf, gamma, n_episodes, alpha, V, first_visit, max_steps, record, rng):
    history, returns, lengths = books(V, n_episodes, record)
    N, seen_in = np.zeros(V.size, np.int64), np.full(V.size, -1)
    states, rewards, counts = np.zeros(64, np.int64), np.zeros(64), np.zeros(64, np.bool_)
    for k in range(n_episodes):
        s, n, done, terminated = reset(world, rng), 0, False, False
        while not done:
            if n == states.size:  # no longer episode so far
                states, rewards = np.append(states, states), np.append(rewards, rewards)
                counts = np.append(counts, counts)
            states[n], counts[n] = s, not first_visit or seen_in[s] != k
            seen_in[s] = k
            s, rewards[n], terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            returns[k] += rewards[n]
            n += 1
            done = terminated or truncated or n == max_steps
        lengths[k] = n
        G = 0.0 if terminated else V[s]
        for t in range(n - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            if counts[t]:
                s = states[t]
                V[s] += at(alpha, N[s]) * (G - V[s])  # eq-18
                N[s] += 1
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = V
    return returns, lengths, history


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


# ---------------------------------------------------------------------- control


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


# ---------------------------------------------------------------------- what the loops share


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
