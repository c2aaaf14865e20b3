"""What chapter 2 measures once."""

from __future__ import annotations

import time
from dataclasses import replace
from math import comb

import numpy as np

from rlcore.bellman import optimality_backup
from rlcore.core.checks import as_integers, check_count, check_finite, check_positive, show, spaces
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import Run
from rlcore.core.rules import checked, count, rules
from rlcore.core.sampling import draw
from rlcore.core.schedules import at
from rlcore.core.types import ArrayLike, Floats, OnEpisode, Rate, Rng, World
from rlcore.core.worlds import act, reset
from rlcore.dp import value_iteration
from rlcore.mdp import FiniteMDP
from rlcore.td import td_error


@checked
def backups_per_second(mdp: FiniteMDP, gamma: float = 0.9) -> float:
    """State values that value iteration computes in a second on this machine, on one core.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    gamma : float
        Discount, below 1.

    Returns
    -------
    float
        Backups a second.

    Notes
    -----
    Ledger: ex-backgammon.
    """
    value_iteration(mdp, gamma, tol=1.0)  # compiles
    start = time.perf_counter()
    sweeps = value_iteration(mdp, gamma, tol=1e-3).n_iter
    return sweeps * mdp.n_states / (time.perf_counter() - start)


def _club(name, club, given):
    clubs = sorted({action.split()[0] for action in given["mdp"].action_names or ()})
    if not isinstance(club, str) or club not in clubs:
        raise ValueError(f"{name}: got {show(club)}, must be one of {clubs}, the first words of the actions' names")
    return club


@checked(club=_club)
def best_with_club(mdp: FiniteMDP, Q: ArrayLike, club: str) -> Floats:
    """The best value of playing a club first: max of Q over its actions.

    Parameters
    ----------
    mdp : FiniteMDP
        A golf course.
    Q : ArrayLike
        (S, A).
    club : str
        The first word of its actions' names: "putter" or "driver".

    Returns
    -------
    Floats
        (S,), -inf where the club has no legal shot.

    Notes
    -----
    Ledger: eq-14, fig-5.
    """
    mine = [a for a, name in enumerate(mdp.action_names) if name.split()[0] == club]
    return Q[:, mine].max(axis=1)


@checked
def putting_values(mdp: FiniteMDP, n_sweeps: int) -> Floats:
    """Sweeps of (16) where some states may never reach the end.

    In a state from which the hole cannot be reached it falls by 1 in each sweep, for ever, so that its limit is
    -infinity; value_iteration refuses such a process at gamma = 1.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    n_sweeps : int
        How many.

    Returns
    -------
    Floats
        (n_sweeps + 1, S), V_0 first; V_k is the best return of k strokes.

    Notes
    -----
    Ledger: ex-golf-putter.
    """
    history = [np.zeros(mdp.n_states)]
    for _ in range(n_sweeps):
        history.append(optimality_backup(mdp, history[-1], 1.0))  # eq-16
    return np.array(history)


@checked
def free_last_stroke(mdp: FiniteMDP) -> FiniteMDP:
    """The same process, but the stroke that reaches the hole costs nothing (the document's wording).

    Parameters
    ----------
    mdp : FiniteMDP
        A golf course.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-golf-putter.
    """
    reward = np.where(mdp.terminal[mdp.next_state], 0.0, mdp.reward)
    names = (mdp.state_names, mdp.action_names)
    return FiniteMDP(mdp.next_state, mdp.prob, reward, mdp.legal, mdp.terminal, mdp.start, *names)


SECONDS_PER_YEAR = 365.25 * 24 * 3600


MOST_CELLS = 1000  # the number of boards has 400 digits then


def _few_cells(name, cols, given):
    cols = check_count(name, cols)
    if given["rows"] * cols > MOST_CELLS:
        raise ValueError(f"{name}: got {cols} and {given['rows']} rows, must make at most {MOST_CELLS} cells")
    return cols


@checked(rows=count(), cols=_few_cells)
def board_states(rows: int, cols: int) -> int:
    """Boards that two players who move in turn can fill, wins left aside.

    Parameters
    ----------
    rows : int
        Rows; rows * cols at most 1,000.
    cols : int
        Columns.

    Returns
    -------
    int
        The sum over k of C(n, k) C(k, k // 2), n = rows * cols.

    Notes
    -----
    Ledger: cl-023.

    Examples
    --------
    >>> from rlcore.studies.ch02 import board_states
    >>> board_states(3, 3)
    6046
    """
    n = rows * cols
    return sum(comb(n, k) * comb(k, k // 2) for k in range(n + 1))


@checked(**rules(check_positive, "n_states per_second n_bytes"))
def cost_of_a_sweep(n_states: float, per_second: float = 1e9, n_bytes: float = 8) -> tuple[float, float]:
    """What one backup of every state takes.

    Parameters
    ----------
    n_states : float
        S.
    per_second : float
        Backups a second.
    n_bytes : float
        Of a number.

    Returns
    -------
    years : float
        The time.
    bytes : float
        Memory for one number a state.

    Notes
    -----
    Ledger: ex-backgammon.
    """
    return n_states / per_second / SECONDS_PER_YEAR, n_states * n_bytes


def _shared(name, groups, given):
    """The rule of groups: (S,) whole numbers from 0, one value for the states of each."""
    groups, S = as_integers(name, groups), spaces(given["world"])[1].size
    if groups.shape != (S,) or groups.min() < 0:
        raise ValueError(
            f"{name}: got shape {groups.shape} from {groups.min(initial=0)}, must be ({S},) integers from 0"
        )
    return groups


def _spread(given, w, *more):
    """The Run in which each state has the value of its group, and terminal states 0."""
    run, terminal, groups = prediction(given, w, *more), spaces(given["world"])[1], given["groups"]
    history = None if run.history is None else np.where(terminal, 0.0, run.history[:, groups])
    return replace(run, V=np.where(terminal, 0.0, w[groups]), history=history, weights=w)


@learner(_spread, groups=_shared, w0=check_finite)
def td0_groups(
    world: World, pi: ArrayLike, gamma: float, n_episodes: int, *, groups: ArrayLike, alpha: Rate, w0: float = 0.0,
    max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """TD(0) with state aggregation: the states of a group share one value.

    Parameters
    ----------
    world : World
        What is learned from.
    pi : ArrayLike
        (S, A), the policy.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Episodes.
    groups : ArrayLike
        (S,), integers from 0.
    alpha : Rate
        Step size.
    w0 : float
        The first value of all.
    max_steps : int | None
        Where an episode is cut; see `td0`.
    record : int
        Keep the values after each record-th episode.
    on_episode : OnEpisode | None
        on_episode(return, steps so far); True ends the run.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Run
        As of `td0`; weights are the values of the groups.

    Notes
    -----
    Ledger: ex-tabular.

    References
    ----------
    Sutton and Barto (2018), section 9.3.
    """
    w, N = np.full(groups.max() + 1, w0), np.zeros(groups.max() + 1, np.int64)
    returns, lengths, history = log(w, n_episodes, record)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            a = draw(pi[s], rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            g = groups[s]
            w[g] += at(alpha, N[g]) * td_error(r, w[g], w[groups[s_next]], gamma, terminated)  # eq-19
            N[g] += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, w, k, record):
            break
    return w, returns, lengths, history, N
