"""Between TD(0) and Monte Carlo: n-step targets, lambda-returns and eligibility traces (chapter 5)."""

from dataclasses import dataclass

import numpy as np

from rlcore.compiled import compiled
from rlcore.experience import act, check_max_steps, reset, run_loop, spaces
from rlcore.mdp import as_floats, check_count, check_gamma, check_probability, check_rng, cumulative, draw
from rlcore.results import Run
from rlcore.returns import (
    TRACES,
    backward_increments,
    complex_backup,
    error_reduction,
    forward_increments,
    kept,
    lambda_return,
    lambda_returns,
    lambda_weights,
    n_step_return,
    return_to_horizon,
    trace_course,
    trace_update,
)
from rlcore.tabular import check_rate, epsilon_greedy, max_value, soft_greedy

__all__ = [
    "TRACES",
    "WatkinsRun",
    "backward_increments",
    "complex_backup",
    "error_reduction",
    "forward_increments",
    "lambda_return",
    "lambda_weights",
    "n_step_return",
    "n_step_td",
    "offline_lambda_return",
    "sarsa_lambda",
    "td_lambda",
    "trace_course",
    "trace_update",
    "true_online_td_lambda",
    "watkins_q_lambda",
]
READINGS = ("in order", "summed", "recomputed")


# ---------------------------------------------------------------------- prediction, forward view


def n_step_td(world, pi, gamma, n, n_episodes, *, alpha, online=True, V0=0.0, max_steps=None, record=1, rng):
    """v_pi from n-step returns. alg-n-step-online, alg-n-step-offline, eq-26, eq-27, eq-28, eq-29, cl-067

    world: FiniteMDP, or gymnasium.Env with Discrete spaces. n: the number of rewards in a target; a state is updated n
    steps after its visit, or at the end. alpha: step size in (0, 1]. online: update at each step, else add the summed
    increments when the episode ends. V0: a number or (S,). max_steps: an episode that long is cut, and its last targets
    bootstrap; None needs a policy that ends every episode. record: history keeps V before the first and after each
    record-th episode; 0 keeps none. Returns a Run with V and history (n_episodes // record + 1, S).
    Source: Sutton and Barto (2018), section 7.1.
    """
    alpha, n = check_rate(alpha), check_count("n", n)
    pi, *settings = _prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng)
    return _run(run_loop(_n_step_td, world, cumulative(pi), *settings, n, alpha, bool(online), rng=rng), V=pi)


@compiled
def _n_step_td(world, pi_cdf, gamma, n_episodes, V, max_steps, record, n, alpha, online, rng):
    history, returns, lengths = _books(V, n_episodes, record)
    change = V if online else np.zeros_like(V)
    states, rewards = np.zeros(n, np.int64), np.zeros(n)  # the last n steps, that of time t at t mod n
    for i in range(n_episodes):
        s = reset(world, rng)
        t, done = 0, False
        while not done:
            s_next, r, terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            states[t % n], rewards[t % n] = s, r
            returns[i] += r
            t += 1
            done = terminated or truncated or t >= max_steps
            for tau in range(max(t - n, 0), t if done else t - n + 1):
                G = return_to_horizon(rewards, gamma, tau, t, V[s_next] * (not terminated))  # eq-25
                change[states[tau % n]] += alpha * (G - V[states[tau % n]])  # eq-26, eq-27
            s = s_next
        if not online:
            V += change  # eq-29
            change[:] = 0.0
        lengths[i] = t
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = V
    return returns, lengths, V, history


def offline_lambda_return(
    world, pi, gamma, lam, n_episodes, *, alpha, reading="in order", V0=0.0, max_steps=None, record=1, rng
):
    """v_pi from lambda-returns, at the end of each episode. alg-lambda-return, eq-33

    reading: how the increments (33) of an episode meet. "in order": the targets are those of the V before the episode,
    the updates follow each other, each from the V that the one before left. "summed": V is held fixed for the updates,
    too, and their sum is added once. "recomputed": the targets, too, use the newest V. lam: in [0, 1].
    Others, and the Run that it returns: as in n_step_td. Source: Sutton and Barto (2018), section 12.1.
    """
    alpha, lam = check_rate(alpha), check_probability("lam", lam)
    if reading not in READINGS:
        raise ValueError(f"reading: got {reading!r}, allowed are {', '.join(map(repr, READINGS))}")
    pi, *settings = _prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng)
    how = (lam, alpha, reading == "summed", reading == "recomputed")
    return _run(run_loop(_offline_lambda_return, world, cumulative(pi), *settings, *how, rng=rng), V=pi)


@compiled
def _offline_lambda_return(world, pi_cdf, gamma, n_episodes, V, max_steps, record, lam, alpha, summed, recomputed, rng):
    history, returns, lengths = _books(V, n_episodes, record)
    change = np.zeros_like(V) if summed else V
    states, rewards = np.zeros(128, np.int64), np.zeros(128)
    for i in range(n_episodes):
        s = reset(world, rng)
        T, done, terminated = 0, False, False
        while not done:
            if states.size < T + 2:
                states, rewards = np.concatenate((states, states)), np.concatenate((rewards, rewards))
            s_next, r, terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            states[T], states[T + 1], rewards[T] = s, s_next, r
            returns[i] += r
            T += 1
            s, done = s_next, terminated or truncated or T >= max_steps
        L = rewards
        for t in range(T):
            if t == 0 or recomputed:
                values = V[states[: T + 1]]
                values[T] *= not terminated
                L = lambda_returns(rewards[:T], values, gamma, lam, t)  # eq-32
            change[states[t]] += alpha * (L[t] - V[states[t]])  # eq-33
        if summed:
            V += change  # eq-29
            change[:] = 0.0
        lengths[i] = T
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = V
    return returns, lengths, V, history


# ---------------------------------------------------------------------- prediction, backward view


@compiled
def visit(e, live, n, x, keep):
    """Add 1 to the trace of x, of which a part `keep` stays; how many traces are alive then."""
    if e[x] == 0.0:
        live[n] = x
        n += 1
    e[x] = keep * e[x] + 1.0  # eq-35
    return n


@compiled
def credit(table, e, live, n, step, decay):
    """table += step e, then e *= decay, where e is not 0: at live[:n]; how many traces are alive then."""
    alive = 0
    for k in range(n):
        x = live[k]
        table[x] += step * e[x]  # eq-37, eq-38, eq-40
        e[x] *= decay  # eq-34
        if e[x] != 0.0:
            live[alive] = x
            alive += 1
    return alive


def td_lambda(
    world,
    pi,
    gamma,
    lam,
    n_episodes,
    *,
    alpha,
    trace="accumulating",
    online=True,
    V0=0.0,
    max_steps=None,
    record=1,
    rng,
):
    """v_pi by TD(lambda), each TD error credited to all states by their traces. alg-td-lambda-acc, cl-073, cl-074

    lam: trace decay in [0, 1]; 0 is TD(0). trace: "accumulating", "dutch" (alg-td-lambda-dutch) or "replacing"
    (alg-td-lambda-replacing). online: update at each step, else add the summed increments when the episode ends, which
    with accumulating traces gives what offline_lambda_return(reading="summed") gives.
    Others, and the Run that it returns: as in n_step_td.
    Source: Sutton (1988); Sutton and Barto (2018), section 12.2.
    """
    alpha, lam = check_rate(alpha), check_probability("lam", lam)
    keep = kept(trace, alpha)
    pi, *settings = _prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng)
    return _run(run_loop(_td_lambda, world, cumulative(pi), *settings, lam, alpha, keep, bool(online), rng=rng), V=pi)


@compiled
def _td_lambda(world, pi_cdf, gamma, n_episodes, V, max_steps, record, lam, alpha, keep, online, rng):
    history, returns, lengths = _books(V, n_episodes, record)
    change = V if online else np.zeros_like(V)
    e, live, n = np.zeros_like(V), np.zeros(V.size, np.int64), 0  # states whose trace is not 0: live[:n]
    for i in range(n_episodes):
        s = reset(world, rng)
        e[live[:n]] = 0.0
        t, n, done = 0, 0, False
        while not done:
            s_next, r, terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            delta = r + gamma * V[s_next] * (not terminated) - V[s]  # eq-36
            n = visit(e, live, n, s, keep)  # eq-35
            n = credit(change, e, live, n, alpha * delta, gamma * lam)  # eq-37, eq-34
            returns[i] += r
            t += 1
            s, done = s_next, terminated or truncated or t >= max_steps
        if not online:
            V += change  # eq-29
            change[:] = 0.0
        lengths[i] = t
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = V
    return returns, lengths, V, history


def true_online_td_lambda(world, pi, gamma, lam, n_episodes, *, alpha, V0=0.0, max_steps=None, record=1, rng):
    """v_pi by TD(lambda) whose V at each step is that of the lambda-returns up to this step. alg-td-lambda-dutch

    Dutch traces, and a correction for what V(S_t) has gained since it was the target. Arguments and the Run that it
    returns: as in td_lambda. Source: van Seijen and Sutton (2014); Sutton and Barto (2018), section 12.5.
    """
    alpha, lam = check_rate(alpha), check_probability("lam", lam)
    pi, *settings = _prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng)
    return _run(run_loop(_true_online_td_lambda, world, cumulative(pi), *settings, lam, alpha, rng=rng), V=pi)


@compiled
def _true_online_td_lambda(world, pi_cdf, gamma, n_episodes, V, max_steps, record, lam, alpha, rng):
    history, returns, lengths = _books(V, n_episodes, record)
    e, live, n = np.zeros_like(V), np.zeros(V.size, np.int64), 0
    for i in range(n_episodes):
        s = reset(world, rng)
        e[live[:n]] = 0.0
        t, n, done, V_old = 0, 0, False, V[s]
        while not done:
            s_next, r, terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            V_s, V_next = V[s], V[s_next] * (not terminated)
            delta = r + gamma * V_next - V_s  # eq-36
            n = visit(e, live, n, s, 1 - alpha)  # eq-35
            n = credit(V, e, live, n, alpha * (delta + V_s - V_old), gamma * lam)  # eq-37, eq-34
            V[s] -= alpha * (V_s - V_old)
            V_old = V_next
            returns[i] += r
            t += 1
            s, done = s_next, terminated or truncated or t >= max_steps
        lengths[i] = t
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = V
    return returns, lengths, V, history


# ---------------------------------------------------------------------- control


def sarsa_lambda(
    world,
    gamma,
    lam,
    n_episodes,
    *,
    alpha,
    epsilon,
    trace="accumulating",
    Q0=0.0,
    max_steps=None,
    record=1,
    rng,
):
    """SARSA with a trace for each pair. alg-sarsa-lambda, fig-28, cl-078

    world: FiniteMDP, or gymnasium.Env with Discrete spaces. lam: trace decay in [0, 1]; 0 is SARSA. alpha: in (0, 1].
    epsilon: probability of a random action. trace: "accumulating", "dutch" or "replacing". Q0: a number or (S, A).
    max_steps: an episode that long is cut, and its last step bootstraps; None: never. record: as in n_step_td.
    Returns a Run with Q (-inf where a is not in A(s)), V = max Q, the greedy policy, and history
    (n_episodes // record + 1, S, A). Source: Sutton and Barto (1998), section 7.5; Rummery and Niranjan (1994).
    """
    settings = _control(world, gamma, lam, n_episodes, alpha, epsilon, trace, Q0, max_steps, record, rng)
    return _run(run_loop(_sarsa_lambda, world, *settings, rng=rng))


@compiled
def _sarsa_lambda(world, gamma, lam, n_episodes, alpha, epsilon, keep, Q, max_steps, record, rng):
    history, returns, lengths = _books(Q, n_episodes, record)
    A, table = Q.shape[1], Q.reshape(-1)  # the pair (s, a) at s A + a
    E, live, n = np.zeros_like(table), np.zeros(table.size, np.int64), 0  # pairs whose trace is not 0: live[:n]
    for i in range(n_episodes):
        s = reset(world, rng)
        a = epsilon_greedy(Q, s, epsilon, rng)
        E[live[:n]] = 0.0
        t, n, done = 0, 0, False
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            a_next = epsilon_greedy(Q, s_next, epsilon, rng)
            delta = r + gamma * Q[s_next, a_next] * (not terminated) - Q[s, a]  # eq-39
            n = visit(E, live, n, s * A + a, keep)  # eq-u-trace-accumulating, eq-u-trace-replacing
            n = credit(table, E, live, n, alpha * delta, gamma * lam)  # eq-38
            returns[i] += r
            t += 1
            s, a, done = s_next, a_next, terminated or truncated or t >= max_steps
        lengths[i] = t
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = Q
    return returns, lengths, Q, history


@dataclass(frozen=True, eq=False)
class WatkinsRun(Run):
    """A Run that keeps `cuts`: over how many steps the traces had grown whenever an exploratory action cut them."""

    cuts: np.ndarray | None = None


def watkins_q_lambda(
    world,
    gamma,
    lam,
    n_episodes,
    *,
    alpha,
    epsilon,
    trace="accumulating",
    Q0=0.0,
    max_steps=None,
    record=1,
    rng,
):
    """Q-learning with a trace for each pair, all cut at an exploratory action. alg-watkins, fig-29, eq-u-watkins-trace

    lam = 0 is Q-learning. An action that ties for the maximum is greedy. Arguments: as in sarsa_lambda. Returns what it
    returns, as a WatkinsRun. Source: Watkins (1989); Sutton and Barto (1998), section 7.6.
    """
    settings = _control(world, gamma, lam, n_episodes, alpha, epsilon, trace, Q0, max_steps, record, rng)
    *found, cuts = run_loop(_watkins_q_lambda, world, *settings, rng=rng)
    return WatkinsRun(**vars(_run(found)), cuts=cuts)


@compiled
def _watkins_q_lambda(world, gamma, lam, n_episodes, alpha, epsilon, keep, Q, max_steps, record, rng):
    history, returns, lengths = _books(Q, n_episodes, record)
    A, table = Q.shape[1], Q.reshape(-1)
    E, live, n = np.zeros_like(table), np.zeros(table.size, np.int64), 0
    cuts, n_cuts = np.zeros(128, np.int64), 0
    for i in range(n_episodes):
        s = reset(world, rng)
        a = epsilon_greedy(Q, s, epsilon, rng)
        E[live[:n]] = 0.0
        t, n, done, since_cut = 0, 0, False, 0
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            a_next = epsilon_greedy(Q, s_next, epsilon, rng)
            greedy = Q[s_next, a_next] == max_value(Q, s_next)
            delta = r + gamma * max_value(Q, s_next) * (not terminated) - Q[s, a]  # eq-41
            n = visit(E, live, n, s * A + a, keep)  # eq-u-watkins-trace
            n = credit(table, E, live, n, alpha * delta, gamma * lam if greedy else 0.0)  # eq-40
            returns[i] += r
            t += 1
            since_cut += 1
            s, a, done = s_next, a_next, terminated or truncated or t >= max_steps
            if not greedy:
                if n_cuts == cuts.size:
                    cuts = np.concatenate((cuts, cuts))
                cuts[n_cuts] = since_cut
                n_cuts, since_cut = n_cuts + 1, 0
        lengths[i] = t
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = Q
    return returns, lengths, Q, history, cuts[:n_cuts].copy()


# ---------------------------------------------------------------------- what all of them share


@compiled
def _books(table, n_episodes, record):
    """history with the first estimates, returns and lengths of episodes still to come."""
    n_kept = 1 + (n_episodes // record if record else 0)
    history = np.zeros((n_kept, *table.shape))
    history[0] = table
    return history, np.zeros(n_episodes), np.zeros(n_episodes, np.int64)


def _run(found, V=None):
    """A Run from what a loop returns; V: the policy whose values were learned, None where Q was."""
    returns, lengths, table, history = found
    history = history if len(history) > 1 else None
    if V is not None:
        return Run(returns, lengths, V=table, policy=V, history=history)
    return Run(returns, lengths, table.max(axis=1), table, soft_greedy(table, 0.0), history)


def _prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng):
    """pi, gamma, n_episodes, V, max_steps, record, checked."""
    legal, terminal = spaces(world)
    pi, gamma, n_episodes = _check_policy(legal, pi), check_gamma(gamma), check_count("n_episodes", n_episodes)
    V = np.where(terminal, 0.0, _check_table("V0", V0, terminal.shape))
    check_rng(rng)
    return pi, gamma, n_episodes, V, check_max_steps(world, max_steps, pi), check_count("record", record, least=0)


def _control(world, gamma, lam, n_episodes, alpha, epsilon, trace, Q0, max_steps, record, rng):
    """gamma, lam, n_episodes, alpha, epsilon, keep, Q, max_steps, record, checked."""
    legal, terminal = spaces(world)
    gamma, lam, n_episodes = check_gamma(gamma), check_probability("lam", lam), check_count("n_episodes", n_episodes)
    alpha, epsilon = check_rate(alpha), check_probability("epsilon", epsilon)
    Q = np.where(legal, _check_table("Q0", Q0, legal.shape, legal), -np.inf)
    Q[terminal] = 0.0
    check_rng(rng)
    last = (check_max_steps(world, max_steps), check_count("record", record, least=0))
    return gamma, lam, n_episodes, alpha, epsilon, kept(trace, alpha), Q, *last


def _check_policy(legal, pi):
    """pi as floats; ValueError unless it is (S, A) with rows that are distributions over A(s)."""
    pi = as_floats("pi", pi)
    if pi.shape != legal.shape:
        raise ValueError(f"pi: got shape {pi.shape}, must be {legal.shape}")
    bad = ~((pi >= 0).all(axis=1) & (np.abs(pi.sum(axis=1) - 1) <= 1e-9) & ~(pi[:, :] * ~legal).any(axis=1))
    if bad.any():
        s = np.flatnonzero(bad)[0]
        raise ValueError(f"pi: row {s} is {pi[s]}, must be probabilities of the actions of that state that sum to 1")
    return pi


def _check_table(name, first, shape, used=True):
    """first estimates as an array of that shape; ValueError unless they are finite where they are used."""
    table = as_floats(name, first)
    if table.shape not in ((), shape):
        raise ValueError(f"{name}: got shape {table.shape}, must be a number or {shape}")
    if not np.isfinite(table[used] if table.shape else table).all():
        raise ValueError(f"{name}: contains a number that is not finite, must be finite")
    return np.broadcast_to(table, shape)
