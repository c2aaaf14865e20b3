"""Eligibility traces: TD(lambda) of values and of behaviour, between TD(0) and Monte Carlo (chapter 5)."""

import numpy as np

from rlcore.core.checks import as_flags, as_integers, check_rate, show
from rlcore.core.compiled import compiled, inlined
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import WatkinsRun
from rlcore.core.rules import anything, array, checked, choice, elementwise, takes_none
from rlcore.core.sampling import draw
from rlcore.core.schedules import at, now
from rlcore.core.worlds import act, reset
from rlcore.nstep import reward_list, values_on_the_way, visited
from rlcore.policies import control, epsilon_greedy, max_value
from rlcore.td import td_error

TRACES = ("accumulating", "dutch", "replacing")
PRINTED = "dutch as printed"

# ---------------------------------------------------------------------- the trace of a state or a pair


@takes_none
def _dutch_rate(name, alpha, given):
    """The rule of a step size that only dutch traces need."""
    kind = given.get("kind") or given.get("trace")
    return check_rate(name, alpha) if kind in ("dutch", PRINTED) or alpha is not None else None


@checked(e=elementwise(), visited=elementwise("e", kind=as_flags), kind=choice(*TRACES, PRINTED), alpha=_dutch_rate)
def trace_update(e, visited, gamma_lam, kind, alpha=None):
    """The trace after one step, from the trace e before it. eq-34, eq-35, om-state-traces, om-indicator, fig-26

    e: a number or an array. visited: 1 for the state (or pair) of this step, else 0; like e. gamma_lam: in [0, 1].
    kind: "accumulating", "dutch", "replacing" or "dutch as printed", which shrinks all pairs, not the visited one
    (eq-u-trace-dutch). alpha: step size in (0, 1], for the dutch kinds. Source: Sutton and Barto (2018), section 12.5.
    """
    if kind == PRINTED:
        return (1 - alpha) * gamma_lam * e + visited  # eq-u-trace-dutch
    return gamma_lam * e * np.where(visited, kept(kind, alpha), 1.0) + visited  # eq-34, eq-35


@inlined
def kept(trace, alpha):
    """How much of the decayed trace of the visited state stays when 1 is added: 1, 1 - alpha or 0. cl-076"""
    if trace == "dutch":
        return 1 - alpha
    return 1.0 if trace == "accumulating" else 0.0


def _times(name, visits, given):
    visits, n = as_integers(name, visits), given["n_steps"]
    if visits.ndim != 1 or ((visits < 0) | (visits >= n)).any():
        raise ValueError(f"{name}: got {show(visits)}, must be times in 0..{n - 1}")
    return visits


@checked(visits=anything, kind=choice(*TRACES, PRINTED), alpha=_dutch_rate)
def trace_course(visits, n_steps, gamma_lam, kind, alpha=None):
    """The trace of one state at times 0 ... n_steps - 1, (n_steps,). fig-26, cl-075

    visits: the times at which the state is visited. Others: as in trace_update.
    """
    visits, course, e = _times("visits", visits, {"n_steps": n_steps}), np.zeros(n_steps), 0.0
    for t in range(n_steps):
        course[t] = e = trace_update(e, t in visits, gamma_lam, kind, alpha)
    return course


@checked(states=visited, rewards=reward_list, V=array("S"), alpha=check_rate, trace=choice(*TRACES))
def backward_increments(states, rewards, V, gamma, lam, alpha, trace="accumulating"):
    """alpha delta_t E_t(s) of an episode, V held fixed: (T, S), row t at time t. eq-36, eq-37, fig-27, cl-073

    states, rewards, V: as in forward_increments. With accumulating traces the sums over t are equal.
    """
    values = values_on_the_way(states, rewards, V)
    delta = td_error(rewards, values[:-1], values[1:], gamma)  # eq-36
    E, e = np.zeros((rewards.size, V.size)), np.zeros(V.size)
    for t, s in enumerate(states[: rewards.size]):
        E[t] = e = trace_update(e, np.arange(V.size) == s, gamma * lam, trace, alpha)
    return alpha * delta[:, None] * E  # eq-37


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


@learner(prediction, trace=choice(*TRACES))
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
    record=0,
    rng,
):
    """v_pi by TD(lambda), each TD error credited to all states by their traces. alg-td-lambda-acc, cl-073, cl-074

    lam: trace decay in [0, 1]; 0 is TD(0). trace: "accumulating", "dutch" (alg-td-lambda-dutch) or "replacing"
    (alg-td-lambda-replacing). online: update at each step, else add the summed increments when the episode ends, which
    with accumulating traces gives what offline_lambda_return(reading="summed") gives.
    Others, and the Run that it returns: as in n_step_td.
    Source: Sutton (1988); Sutton and Barto (2018), section 12.2.
    """
    V, e, live, n = V0, np.zeros_like(V0), np.zeros(V0.size + 1, np.int64), 0  # states whose trace is not 0: live[:n]
    returns, lengths, history = log(V, n_episodes, record)
    change = V if online else np.zeros_like(V)
    for k in range(n_episodes):
        s, done, step = reset(world, rng), False, at(alpha, k)
        keep = kept(trace, step)
        e[live[:n]] = 0.0
        n = 0
        while not done:
            a = draw(pi[s], rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            delta = td_error(r, V[s], V[s_next], gamma, terminated)  # eq-36
            n = visit(e, live, n, s, keep)  # eq-35
            n = credit(change, e, live, n, step * delta, gamma * lam)  # eq-37, eq-34
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if not online:
            V += change  # eq-29
            change[:] = 0.0
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history


@learner(prediction)
def true_online_td_lambda(world, pi, gamma, lam, n_episodes, *, alpha, V0=0.0, max_steps=None, record=0, rng):
    """v_pi by TD(lambda) whose V at each step is that of the lambda-returns up to this step. alg-td-lambda-dutch

    Dutch traces, and a correction for what V(S_t) has gained since it was the target. Arguments and the Run that it
    returns: as in td_lambda. Source: van Seijen and Sutton (2014); Sutton and Barto (2018), section 12.5.
    """
    V, e, live, n = V0, np.zeros_like(V0), np.zeros(V0.size + 1, np.int64), 0
    returns, lengths, history = log(V, n_episodes, record)
    for k in range(n_episodes):
        s, done, step = reset(world, rng), False, at(alpha, k)
        e[live[:n]] = 0.0
        n, V_old = 0, V[s]
        while not done:
            a = draw(pi[s], rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            V_s, V_next = V[s], V[s_next] * (not terminated)
            delta = td_error(r, V_s, V_next, gamma)  # eq-36
            n = visit(e, live, n, s, 1 - step)  # eq-35
            n = credit(V, e, live, n, step * (delta + V_s - V_old), gamma * lam)  # eq-37, eq-34
            V[s] -= step * (V_s - V_old)
            V_old = V_next
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history


# ---------------------------------------------------------------------- control


@learner(control, trace=choice(*TRACES))
def sarsa_lambda(
    world, gamma, lam, n_episodes, *, alpha, epsilon, trace="accumulating", Q0=0.0, max_steps=None, record=0, rng
):
    """SARSA with a trace for each pair. alg-sarsa-lambda, fig-28, cl-078

    world: FiniteMDP, gymnasium.Env or its id. lam: trace decay in [0, 1]; 0 is SARSA. alpha: in (0, 1], or
    decaying(...). epsilon: probability of a random action, or decaying(...). trace: "accumulating", "dutch" or
    "replacing". Q0: a number or (S, A). max_steps: an episode that long is cut, and its last step bootstraps; None:
    never. record: as in n_step_td. Returns a Run: Q (-inf where a is not in A(s)), V = max Q, the epsilon-greedy policy
    of the last Q. Source: Sutton and Barto (1998), section 7.5; Rummery and Niranjan (1994).
    """
    Q, A, q, steps = Q0, Q0.shape[1], Q0.reshape(-1), 0  # the pair (s, a) at s A + a of q
    E, live, n = np.zeros_like(q), np.zeros(q.size + 1, np.int64), 0  # pairs whose trace is not 0: live[:n]
    returns, lengths, history = log(Q, n_episodes, record)
    for k in range(n_episodes):
        s, done, step = reset(world, rng), False, at(alpha, k)
        a, keep = epsilon_greedy(Q, s, now(epsilon, k, steps), rng), kept(trace, step)
        E[live[:n]] = 0.0
        n = 0
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            steps += 1
            a_next = epsilon_greedy(Q, s_next, now(epsilon, k, steps), rng)
            delta = td_error(r, Q[s, a], Q[s_next, a_next], gamma, terminated)  # eq-39
            n = visit(E, live, n, s * A + a, keep)  # eq-u-trace-accumulating, eq-u-trace-replacing
            n = credit(q, E, live, n, step * delta, gamma * lam)  # eq-38
            returns[k] += r
            lengths[k] += 1
            s, a, done = s_next, a_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, Q, k, record):
            break
    return Q, returns, lengths, history


def _with_cuts(given, *found):
    *found, cuts = found
    return control(given, *found, kind=WatkinsRun, cuts=cuts)


@learner(_with_cuts, trace=choice(*TRACES))
def watkins_q_lambda(
    world, gamma, lam, n_episodes, *, alpha, epsilon, trace="accumulating", Q0=0.0, max_steps=None, record=0, rng
):
    """Q-learning with a trace for each pair, all cut at an exploratory action. alg-watkins, fig-29, eq-u-watkins-trace

    lam = 0 is Q-learning. An action that ties for the maximum is greedy. Arguments: as in sarsa_lambda. Returns what it
    returns, as a WatkinsRun. Source: Watkins (1989); Sutton and Barto (1998), section 7.6.
    """
    Q, A, q, steps = Q0, Q0.shape[1], Q0.reshape(-1), 0
    E, live, n = np.zeros_like(q), np.zeros(q.size + 1, np.int64), 0
    returns, lengths, history = log(Q, n_episodes, record)
    cuts, since_cut = [0 for _ in range(0)], 0
    for k in range(n_episodes):
        s, done, step = reset(world, rng), False, at(alpha, k)
        a, keep = epsilon_greedy(Q, s, now(epsilon, k, steps), rng), kept(trace, step)
        E[live[:n]] = 0.0
        n = since_cut = 0
        while not done:
            s_next, r, terminated, truncated = act(world, s, a, rng)
            steps += 1
            a_next = epsilon_greedy(Q, s_next, now(epsilon, k, steps), rng)
            best = max_value(Q, s_next)
            greedy = Q[s_next, a_next] == best
            delta = td_error(r, Q[s, a], best, gamma, terminated)  # eq-41
            n = visit(E, live, n, s * A + a, keep)  # eq-u-watkins-trace
            n = credit(q, E, live, n, step * delta, gamma * lam if greedy else 0.0)  # eq-40
            since_cut += 1
            if not greedy:
                cuts.append(since_cut)
                since_cut = 0
            returns[k] += r
            lengths[k] += 1
            s, a, done = s_next, a_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, Q, k, record):
            break
    return Q, returns, lengths, history, np.array(cuts, np.int64)
