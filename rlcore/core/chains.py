"""The Markov chain that a policy makes of a process: where it leads, and the linear system of its values."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from rlcore.core.types import Flags, Floats, Model


def chain(mdp: Model, pi: Floats) -> tuple[Any, Floats]:
    """P_pi (S, S) as a scipy sparse array, and r_pi (S,); pi is not checked."""
    from scipy.sparse import csr_array

    weight = pi[:, :, None] * mdp.prob
    rows = np.broadcast_to(np.arange(mdp.n_states)[:, None, None], weight.shape)
    used = weight > 0
    P = csr_array((weight[used], (rows[used], mdp.next_state[used])), shape=(mdp.n_states, mdp.n_states))
    P.sum_duplicates()
    return P, (weight * mdp.reward).sum(axis=(1, 2))


def reaches(P: Any, target: Flags) -> Flags:
    """States from which the chain P can reach the target set, (S,) bool."""
    from scipy.sparse import csr_array, vstack
    from scipy.sparse.csgraph import breadth_first_order

    S = target.size
    source = csr_array((np.ones(target.sum()), (np.zeros(target.sum(), int), np.flatnonzero(target))), shape=(1, S))
    graph = csr_array(vstack([P.T, source]))
    graph.resize(S + 1, S + 1)
    reached = np.zeros(S + 1, bool)
    reached[breadth_first_order(graph, S, return_predecessors=False)] = True
    return reached[:S]


def ends(mdp: Model, pi: Floats) -> bool:
    """Whether every state that pi can meet leads to a terminal one; walled-off cells do not matter."""
    P, _ = chain(mdp, pi)
    return bool((reaches(P, mdp.terminal) | ~reaches(P.T, mdp.start > 0)).all())


def solve_system(P: Any, r: Floats, gamma: float, terminal: Flags) -> Floats:
    """V with V = r + gamma P V, 0 on terminal states; NaN where to doubles the system is a singular one."""
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import MatrixRankWarning, spsolve

    require_end_of(P, gamma, terminal)
    go = np.flatnonzero(~terminal)
    V = np.zeros(terminal.size)
    P = P[go][:, go]
    if go.size > 100 and P.nnz < 0.05 * go.size**2:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MatrixRankWarning)
            V[go] = spsolve((eye_array(go.size) - gamma * P).tocsc(), r[go])
        return V
    try:
        V[go] = np.linalg.solve(np.eye(go.size) - gamma * P.toarray(), r[go])
    except np.linalg.LinAlgError:
        V[go] = np.nan
    return V


def require_end_of(P: Any, gamma: float, terminal: Flags) -> None:
    """ValueError where a system with P would be singular."""
    if gamma == 1 and not (ends := reaches(P, terminal)).all():
        s = np.flatnonzero(~ends)[0]
        raise ValueError(f"pi: never terminates from state {s}, must reach a terminal state when gamma = 1")
