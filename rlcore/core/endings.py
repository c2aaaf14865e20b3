"""What is best without discounting: policies that end, and loops that make the best values undetermined."""

from __future__ import annotations

import numpy as np

from rlcore.core.chains import chain, reaches, solve_system
from rlcore.core.types import Flags, Floats, Model

ROUNDS = 100  # of policy iteration on the number of steps


def prefer_ends(mdp: Model, pi: Floats, best: Flags) -> Floats:
    """pi (S, A), deterministic, with another of the best actions (S, A) where it would never end, if that can.

    From each state such an action leads, with some probability, one step nearer to where pi ends.
    """
    from scipy.sparse.csgraph import breadth_first_order

    ends = reaches(chain(mdp, pi)[0], mdp.terminal)
    if ends.all():
        return pi
    S, (P, _) = mdp.n_states, chain(mdp, best / best.sum(axis=1, keepdims=True))
    P = P.tolil()
    P.resize(S + 1, S + 1)
    P[np.flatnonzero(ends), S] = 1.0  # one state behind all from which pi ends
    order, after = breadth_first_order(P.T.tocsr(), S, return_predecessors=True)
    pi = pi.copy()
    for s in order[1:]:
        if not ends[s]:
            leads = ((mdp.next_state[s] == after[s]) & (mdp.prob[s] > 0)).any(axis=1) & best[s]
            pi[s] = np.arange(pi.shape[1]) == leads.argmax()
    return pi


def loops(mdp: Model, best: Flags) -> Flags:
    """States in which one can stay for ever by these actions (S, A) alone, (S,) bool: their end components.

    Source: de Alfaro (1997), algorithm 3.1.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    S, used, allowed = mdp.n_states, mdp.prob > 0, best & ~mdp.terminal[:, None]
    while True:
        s, a, k = np.nonzero(used & allowed[:, :, None])
        graph = csr_array((np.ones(s.size), (s, mdp.next_state[s, a, k])), shape=(S, S))
        part = connected_components(graph, connection="strong")[1]
        stays = np.where(used, part[mdp.next_state] == part[:, None, None], True).all(axis=2) & allowed
        if np.array_equal(stays, allowed):
            return np.asarray(stays.any(axis=1))
        allowed = stays


def settled(mdp: Model, V: Floats, pi: Floats, best: Flags, tol: float) -> Floats:
    """A policy of best actions that ends, for values V that solve the optimality equations at gamma = 1.

    ValueError where they have other solutions as well: in a loop that costs nothing one may stay for ever, for 0, which
    is more than V, or V counts on it. Where no loop is among the best actions, V is v_*. Source: Bertsekas and
    Tsitsiklis (1991).
    """
    pi = prefer_ends(mdp, pi, best)
    ends = reaches(chain(mdp, pi)[0], mdp.terminal)
    doubtful = ~ends | loops(mdp, best) & (-tol > V)
    if doubtful.any():
        s = np.flatnonzero(doubtful)[0]
        raise ValueError(
            f"gamma: got 1, but from state {s} a loop that costs nothing is as good as any way to the end, "
            "so that values are not determined; must be below 1 here"
        )
    return pi


def grow(mdp: Model, pi: Floats) -> None:
    """ValueError at gamma = 1 where a policy that is greedy never ends: its loop gains."""
    ends = reaches(chain(mdp, pi)[0], mdp.terminal)
    if not ends.all():
        s = np.flatnonzero(~ends)[0]
        raise ValueError(f"gamma: got 1, but values still grow in a loop from state {s}, must be below 1 here")


def bound_above(mdp: Model, V: Floats, Q: Floats, pi: Floats, rounding: float) -> float:
    """A number that v_* - V does not exceed at gamma = 1, inf where none is found. Q: lookahead of V; pi: ends.

    V + u is no less than its own backup, hence than v_*: u is a multiple of the longest expected way to the end among
    actions that are nearly best, and looked at for all. Exists where every policy that never ends is worth minus
    infinity. Source: Bertsekas and Tsitsiklis (1991).
    """
    go, legal = ~mdp.terminal, mdp.legal & ~mdp.terminal[:, None]
    gain = np.where(legal, Q - V[:, None], -np.inf)  # of a step, over V
    most = max(gain.max(), 0.0) + rounding
    near = gain >= -1e-6 * (1 + np.abs(V)[:, None])
    for _ in range(ROUNDS):
        P, _ = chain(mdp, pi)
        if not reaches(P, mdp.terminal).all():
            return np.inf
        steps = solve_system(P, go.astype(float), 1.0, mdp.terminal)
        after = (mdp.prob * steps[mdp.next_state]).sum(axis=2)
        longer = np.where(near, after, -np.inf)
        better = go & (longer.max(axis=1) > (after * pi).sum(axis=1) * (1 + 1e-9) + 1e-9)
        if not better.any():
            break
        pi = np.where(better[:, None], np.eye(pi.shape[1])[longer.argmax(axis=1)], pi)
    u = 2 * most * steps
    enough = u[:, None] >= gain + rounding + 2 * most * after
    return float(u.max()) if enough[legal].all() else np.inf
