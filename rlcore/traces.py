"""Between TD(0) and Monte Carlo: n-step targets, lambda-returns and eligibility traces (chapter 5)."""

import numpy as np

from rlcore.core.checks import (
    as_floats,
    as_integers,
    check_count,
    check_gamma,
    check_probability,
    check_q0,
    check_rate,
    check_rng,
)
from rlcore.core.compiled import compiled
from rlcore.core.results import Run, WatkinsRun
from rlcore.core.sampling import cumulative, draw
from rlcore.core.worlds import act, books, check_max_steps, check_prediction, reset, run_loop, spaces, value_run
from rlcore.nstep import visited_values
from rlcore.policies import epsilon_greedy, max_value, soft_greedy

TRACES = ("accumulating", "dutch", "replacing")


# ---------------------------------------------------------------------- the trace of a state or a pair


def trace_update(e, visited, gamma_lam, kind, alpha=None):
    """The trace after one step, from the trace e before it. eq-34, eq-35, om-state-traces, om-indicator, fig-26

    e: a number or an array. visited: 1 for the state (or pair) of this step, else 0; like e. gamma_lam: in [0, 1].
    kind: "accumulating", "dutch", "replacing" or "dutch as printed", which shrinks all pairs, not the visited one
    (eq-u-trace-dutch). alpha: step size in (0, 1], for the dutch kinds. Source: Sutton and Barto (2018), section 12.5.
    """
    e, visited = as_floats("e", e), as_floats("visited", visited)
    if not np.isin(visited, (0, 1)).all():
        raise ValueError(f"visited: got {visited}, must be 0 or 1")
    decay = check_probability("gamma_lam", gamma_lam)
    if kind == "dutch as printed":
        return (1 - check_rate(alpha)) * decay * e + visited  # eq-u-trace-dutch
    keep = kept(kind, alpha, "kind")
    return decay * e * np.where(visited == 1, keep, 1.0) + visited  # eq-34, eq-35


def kept(kind, alpha, name="trace"):
    """How much of the decayed trace of the visited state stays when 1 is added: 1, 1 - alpha or 0. cl-076"""
    if kind not in TRACES:
        raise ValueError(f"{name}: got {kind!r}, allowed are {', '.join(map(repr, TRACES))}")
    if kind == "dutch":
        return 1 - check_rate(alpha)
    return 1.0 if kind == "accumulating" else 0.0


def trace_course(visits, n_steps, gamma_lam, kind, alpha=None):
    """The trace of one state at times 0 ... n_steps - 1, (n_steps,). fig-26, cl-075

    visits: the times at which the state is visited. Others: as in trace_update.
    """
    n_steps, visits = check_count("n_steps", n_steps), as_integers("visits", visits)
    if ((visits < 0) | (visits >= n_steps)).any():
        raise ValueError(f"visits: got {visits}, must be times in 0..{n_steps - 1}")
    course, e = np.zeros(n_steps), 0.0
    for t in range(n_steps):
        course[t] = e = trace_update(e, t in visits, gamma_lam, kind, alpha)
    return course


def backward_increments(states, rewards, V, gamma, lam, alpha, trace="accumulating"):
    """alpha delta_t E_t(s) of an episode, V held fixed: (T, S), row t at time t. eq-36, eq-37, fig-27, cl-073

    states, rewards, V: as in forward_increments. With accumulating traces the sums over t are equal.
    """
    states, rewards, values, V = visited_values(states, rewards, V)
    gamma_lam = check_gamma(gamma) * check_probability("lam", lam)
    kept(trace, alpha)
    delta = rewards + gamma * values[1:] - values[:-1]  # eq-36
    E, e = np.zeros((rewards.size, V.size)), np.zeros(V.size)
    for t, s in enumerate(states[: rewards.size]):
        E[t] = e = trace_update(e, np.arange(V.size) == s, gamma_lam, trace, alpha)
    return check_rate(alpha) * delta[:, None] * E  # eq-37


# ---------------------------------------------------------------------- prediction


@compiled
def visit(e, live, n, x, keep):
    """Add 1 to the trace of x, of which a part `keep` stays; how many traces live[:n] lists then."""
    if e[x] == 0.0:
        live[n] = x
        k = 0
        while live[k] != x:  # it is listed already if its trace has become too small for a float
            k += 1
        n = max(n, k + 1)
    e[x] = keep * e[x] + 1.0  # eq-35
    return n


@compiled
def credit(table, e, live, n, step, decay):
    """table += step e, then e *= decay, at live[:n], for elsewhere e is 0; how many traces live[:n] lists then."""
    for k in range(n):
        x = live[k]
        table[x] += step * e[x]  # eq-37, eq-38, eq-40
        e[x] *= decay  # eq-34
    return n if decay > 0.0 else 0


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
    pi, *settings = check_prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng)
    found = run_loop(_td_lambda, world, cumulative(pi), *settings, lam, alpha, keep, bool(online), rng=rng)
    return value_run(found, pi, record)


@compiled
def _td_lambda(world, pi_cdf, gamma, n_episodes, V, max_steps, record, lam, alpha, keep, online, rng):
    history, returns, lengths = books(V, n_episodes, record)
    change = V if online else np.zeros_like(V)
    e, live, n = np.zeros_like(V), np.zeros(V.size + 1, np.int64), 0  # states whose trace is not 0: live[:n]
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
    pi, *settings = check_prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng)
    found = run_loop(_true_online_td_lambda, world, cumulative(pi), *settings, lam, alpha, rng=rng)
    return value_run(found, pi, record)


@compiled
def _true_online_td_lambda(world, pi_cdf, gamma, n_episodes, V, max_steps, record, lam, alpha, rng):
    history, returns, lengths = books(V, n_episodes, record)
    e, live, n = np.zeros_like(V), np.zeros(V.size + 1, np.int64), 0
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
    world, gamma, lam, n_episodes, *, alpha, epsilon, trace="accumulating", Q0=0.0, max_steps=None, record=1, rng
):
    """SARSA with a trace for each pair. alg-sarsa-lambda, fig-28, cl-078

    world: FiniteMDP, or gymnasium.Env with Discrete spaces. lam: trace decay in [0, 1]; 0 is SARSA. alpha: in (0, 1].
    epsilon: probability of a random action. trace: "accumulating", "dutch" or "replacing". Q0: a number or (S, A).
    max_steps: an episode that long is cut, and its last step bootstraps; None: never. record: as in n_step_td.
    Returns a Run: Q (-inf where a is not in A(s)), V = max Q, the epsilon-greedy policy of the last Q, and history
    (n_episodes // record + 1, S, A). Source: Sutton and Barto (1998), section 7.5; Rummery and Niranjan (1994).
    """
    settings = _control(world, gamma, lam, n_episodes, alpha, epsilon, trace, Q0, max_steps, record, rng)
    return Run(**_action_value_run(run_loop(_sarsa_lambda, world, *settings, rng=rng), epsilon, record))


@compiled
def _sarsa_lambda(world, gamma, lam, n_episodes, alpha, epsilon, keep, Q, max_steps, record, rng):
    history, returns, lengths = books(Q, n_episodes, record)
    A, table = Q.shape[1], Q.reshape(-1)  # the pair (s, a) at s A + a
    E, live, n = np.zeros_like(table), np.zeros(table.size + 1, np.int64), 0  # pairs whose trace is not 0: live[:n]
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


def watkins_q_lambda(
    world, gamma, lam, n_episodes, *, alpha, epsilon, trace="accumulating", Q0=0.0, max_steps=None, record=1, rng
):
    """Q-learning with a trace for each pair, all cut at an exploratory action. alg-watkins, fig-29, eq-u-watkins-trace

    lam = 0 is Q-learning. An action that ties for the maximum is greedy. Arguments: as in sarsa_lambda. Returns what it
    returns, as a WatkinsRun. Source: Watkins (1989); Sutton and Barto (1998), section 7.6.
    """
    settings = _control(world, gamma, lam, n_episodes, alpha, epsilon, trace, Q0, max_steps, record, rng)
    *found, cuts = run_loop(_watkins_q_lambda, world, *settings, rng=rng)
    return WatkinsRun(**_action_value_run(found, epsilon, record), cuts=cuts)


@compiled
def _watkins_q_lambda(world, gamma, lam, n_episodes, alpha, epsilon, keep, Q, max_steps, record, rng):
    history, returns, lengths = books(Q, n_episodes, record)
    A, table = Q.shape[1], Q.reshape(-1)
    E, live, n = np.zeros_like(table), np.zeros(table.size + 1, np.int64), 0
    cuts, n_cuts = np.zeros(128, np.int64), 0
    for i in range(n_episodes):
        s = reset(world, rng)
        a = epsilon_greedy(Q, s, epsilon, rng)
        E[live[:n]] = 0.0
        t, n, done, since_cut = 0, 0, False, 0
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            a_next = epsilon_greedy(Q, s_next, epsilon, rng)
            Q_next, best = Q[s_next, a_next], max_value(Q, s_next)
            delta = r + gamma * best * (not terminated) - Q[s, a]  # eq-41
            n = visit(E, live, n, s * A + a, keep)  # eq-u-watkins-trace
            n = credit(table, E, live, n, alpha * delta, gamma * lam if Q_next == best else 0.0)  # eq-40
            returns[i] += r
            t += 1
            since_cut += 1
            s, a, done = s_next, a_next, terminated or truncated or t >= max_steps
            if Q_next != best:
                if n_cuts == cuts.size:
                    cuts = np.concatenate((cuts, cuts))
                cuts[n_cuts] = since_cut
                n_cuts, since_cut = n_cuts + 1, 0
        lengths[i] = t
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = Q
    return returns, lengths, Q, history, cuts[:n_cuts].copy()


def _control(world, gamma, lam, n_episodes, alpha, epsilon, trace, Q0, max_steps, record, rng):
    """gamma, lam, n_episodes, alpha, epsilon, keep, Q, max_steps, record as loops take them."""
    (legal, terminal), gamma, lam = spaces(world), check_gamma(gamma), check_probability("lam", lam)
    n_episodes, record, _ = check_count("n_episodes", n_episodes), check_count("record", record, 0), check_rng(rng)
    alpha, epsilon, Q = check_rate(alpha), check_probability("epsilon", epsilon), check_q0(legal, terminal, Q0)
    max_steps = check_max_steps(world, max_steps, legal / legal.sum(axis=1, keepdims=True))
    return gamma, lam, n_episodes, alpha, epsilon, kept(trace, alpha), Q, max_steps, record


def _action_value_run(found, epsilon, record):
    """The fields of the Run of a loop that learned Q."""
    returns, lengths, Q, history = found
    return dict(
        returns=returns,
        lengths=lengths,
        V=Q.max(axis=1),
        Q=Q,
        policy=soft_greedy(Q, epsilon),
        history=history if record else None,
    )
