"""Eligibility traces: TD(lambda) of values and of behaviour, between TD(0) and Monte Carlo (chapter 5)."""

from __future__ import annotations

from typing import Any

import numpy as np

from rlcore.core.checks import as_flags, as_integers, check_rate, show
from rlcore.core.compiled import compiled, inlined
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import Run, WatkinsRun
from rlcore.core.rules import anything, array, checked, choice, elementwise, takes_none
from rlcore.core.sampling import draw
from rlcore.core.schedules import at, now
from rlcore.core.types import ArrayLike, Floats, Ints, OnEpisode, Rate, Rng, World
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
def trace_update(e: ArrayLike, visited: ArrayLike, gamma_lam: float, kind: str, alpha: float | None = None) -> Any:
    """The trace after one step, from the trace e before it.

    Parameters
    ----------
    e : ArrayLike
        A number or an array.
    visited : ArrayLike
        1 for the state (or pair) of this step, else 0; like e.
    gamma_lam : float
        In [0, 1].
    kind : str
        "accumulating", "dutch", "replacing" or "dutch as printed", which shrinks all pairs, not the visited one.
    alpha : float | None
        Step size in (0, 1], for the dutch kinds.

    Returns
    -------
    Any
        A number, or an array like e.

    Notes
    -----
    Ledger: eq-34, eq-35, om-state-traces, om-indicator, fig-26, eq-u-trace-dutch.

    References
    ----------
    Sutton and Barto (2018), section 12.5.
    """
    if kind == PRINTED:
        return (1 - alpha) * gamma_lam * e + visited  # eq-u-trace-dutch
    return gamma_lam * e * np.where(visited, kept(kind, alpha), 1.0) + visited  # eq-34, eq-35


@inlined
def kept(trace: str, alpha: float) -> float:
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
def trace_course(visits: ArrayLike, n_steps: int, gamma_lam: float, kind: str, alpha: float | None = None) -> Floats:
    """The trace of one state at times 0 ... n_steps - 1.

    Parameters
    ----------
    visits : ArrayLike
        The times at which the state is visited.
    n_steps : int
        Number of times.
    gamma_lam : float
        Decay in [0, 1].
    kind : str
        As in `trace_update`.
    alpha : float | None
        Step size in (0, 1], for the dutch kinds.

    Returns
    -------
    Floats
        (n_steps,).

    Notes
    -----
    Ledger: fig-26, cl-075.
    """
    visits, course, e = _times("visits", visits, {"n_steps": n_steps}), np.zeros(n_steps), 0.0
    for t in range(n_steps):
        course[t] = e = trace_update(e, t in visits, gamma_lam, kind, alpha)
    return course


@checked(states=visited, rewards=reward_list, V=array("S"), alpha=check_rate, trace=choice(*TRACES))
def backward_increments(
    states: ArrayLike, rewards: ArrayLike, V: ArrayLike, gamma: float, lam: float, alpha: float,
    trace: str = "accumulating",
) -> Floats:  # fmt: skip
    """What the traces of an episode add to V, alpha delta_t E_t(s), V held fixed.

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
    trace : str
        "accumulating", "dutch" or "replacing".

    Returns
    -------
    Floats
        (T, S), row t at time t; with accumulating traces the sums over t are those of `forward_increments`.

    Notes
    -----
    Ledger: eq-36, eq-37, fig-27, cl-073.
    """
    values = values_on_the_way(states, rewards, V)
    delta = td_error(rewards, values[:-1], values[1:], gamma)  # eq-36
    E, e = np.zeros((rewards.size, V.size)), np.zeros(V.size)
    for t, s in enumerate(states[: rewards.size]):
        E[t] = e = trace_update(e, np.arange(V.size) == s, gamma * lam, trace, alpha)
    return alpha * delta[:, None] * E  # eq-37


# ---------------------------------------------------------------------- prediction


@compiled
def visit(e: Floats, live: Ints, n: int, x: int, keep: float) -> int:
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
def credit(table: Floats, e: Floats, live: Ints, n: int, step: float, decay: float) -> int:
    """table += step e, then e *= decay, at live[:n], for elsewhere e is 0; how many traces live[:n] lists then."""
    for k in range(n):
        x = live[k]
        table[x] += step * e[x]  # eq-37, eq-38, eq-40
        e[x] *= decay  # eq-34
    return n if decay > 0.0 else 0


@learner(prediction, trace=choice(*TRACES))
def td_lambda(
    world: World, pi: ArrayLike, gamma: float, lam: float, n_episodes: int, *, alpha: Rate, trace: str = "accumulating",
    online: bool = True, V0: ArrayLike = 0.0, max_steps: int | None = None, record: int = 0,
    on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """The values v_pi by TD(lambda), each TD error credited to all states by their traces.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    lam : float
        Trace decay in [0, 1]; 0 is TD(0).
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    trace : str
        "accumulating", "dutch" or "replacing".
    online : bool
        Update at each step, else add the summed increments when the episode ends, which with accumulating traces gives
        what offline_lambda_return(reading="summed") gives.
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
    Ledger: alg-td-lambda-acc, alg-td-lambda-dutch, alg-td-lambda-replacing, cl-073, cl-074.

    References
    ----------
    Sutton (1988); Sutton and Barto (2018), section 12.2.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import td_lambda
    >>> from rlcore.envs.small import random_walk
    >>> rng = np.random.default_rng(0)
    >>> td_lambda(random_walk(3), np.ones((5, 1)), 1.0, 0.5, 500, alpha=0.05, rng=rng).V.round(2)
    array([0.  , 0.27, 0.65, 0.83, 0.  ])
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
def true_online_td_lambda(
    world: World, pi: ArrayLike, gamma: float, lam: float, n_episodes: int, *, alpha: Rate, V0: ArrayLike = 0.0,
    max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """TD(lambda) whose V at each step is that of the lambda-returns up to this step.

    Dutch traces, and a correction for what V(S_t) has gained since it was the target.

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
    Ledger: alg-td-lambda-dutch.

    References
    ----------
    van Seijen and Sutton (2014); Sutton and Barto (2018), section 12.5.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import true_online_td_lambda
    >>> from rlcore.envs.small import random_walk
    >>> rng = np.random.default_rng(0)
    >>> true_online_td_lambda(random_walk(3), np.ones((5, 1)), 1.0, 0.5, 500, alpha=0.05, rng=rng).V.round(2)
    array([0.  , 0.27, 0.65, 0.83, 0.  ])
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
    world: World, gamma: float, lam: float, n_episodes: int, *, alpha: Rate, epsilon: Rate, trace: str = "accumulating",
    Q0: ArrayLike = 0.0, max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """SARSA with a trace for each pair.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium.Env or its id.
    gamma : float
        Discount, in [0, 1].
    lam : float
        Trace decay in [0, 1]; 0 is SARSA.
    n_episodes : int
        Number of episodes.
    alpha : Rate
        In (0, 1], or decaying(...).
    epsilon : Rate
        Probability of a random action, or decaying(...).
    trace : str
        "accumulating", "dutch" or "replacing".
    Q0 : ArrayLike
        A number or (S, A).
    max_steps : int | None
        An episode that long is cut, and its last step bootstraps; None: a million steps.
    record : int
        history keeps Q before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        As `sarsa`.

    Notes
    -----
    Ledger: alg-sarsa-lambda, fig-28, cl-078.

    References
    ----------
    Sutton and Barto (1998), section 7.5; Rummery and Niranjan (1994).

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import sarsa_lambda
    >>> from rlcore.envs.grids import gridworld
    >>> rng = np.random.default_rng(0)
    >>> run = sarsa_lambda(gridworld(3, 3, terminals=[0]), 1.0, 0.5, 500, alpha=0.2, epsilon=0.1, rng=rng)
    >>> run.Q.argmax(axis=1)[1:4]
    array([3, 3, 0])
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
    world: World, gamma: float, lam: float, n_episodes: int, *, alpha: Rate, epsilon: Rate, trace: str = "accumulating",
    Q0: ArrayLike = 0.0, max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> WatkinsRun:  # fmt: skip
    """Watkins's Q(lambda): Q-learning with a trace for each pair, all cut at an exploratory action.

    lam = 0 is Q-learning. An action that ties for the maximum is greedy.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    gamma : float
        Discount, in [0, 1].
    lam : float
        In [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    epsilon : Rate
        Probability of a random action, else a greedy one; or decaying(...).
    trace : str
        "accumulating", "dutch" or "replacing".
    Q0 : ArrayLike
        First estimate, a number or (S, A).
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
    WatkinsRun
        As `sarsa`, and how long the traces were when they were cut.

    Notes
    -----
    Ledger: alg-watkins, fig-29, eq-u-watkins-trace.

    References
    ----------
    Watkins (1989); Sutton and Barto (1998), section 7.6.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import watkins_q_lambda
    >>> from rlcore.envs.grids import gridworld
    >>> rng = np.random.default_rng(0)
    >>> run = watkins_q_lambda(gridworld(3, 3, terminals=[0]), 1.0, 0.5, 500, alpha=0.2, epsilon=0.1, rng=rng)
    >>> run.Q.argmax(axis=1)[1:4]
    array([3, 3, 0])
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
