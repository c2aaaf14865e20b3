"""solve: optimal values and policy, quick at every scale (chapter 3).

Three ways to repeat the Bellman optimality backup (16), tried in this order, and one certificate for all:

* sweeps over all states at once with the span stop, for processes that soon forget where they started;
* a queue of the states that may still change, for long paths;
* modified policy iteration with the span stop, for what neither of them ends.

Each starts below v_*. Source: MacQueen (1966); Puterman (1994), sections 6.5 to 6.7.
"""

from __future__ import annotations

import numpy as np

from rlcore.bellman import error_bound, greedy, greedy_actions, q_from_v
from rlcore.core.chains import chain, reaches, solve_system
from rlcore.core.compiled import alone, compiled
from rlcore.core.endings import prefer_ends, settled
from rlcore.core.results import Solution
from rlcore.core.rules import checked
from rlcore.core.running import interruptible, marks
from rlcore.mdp import FiniteMDP, uniform_policy

ULP = float(np.finfo(float).eps) / 2  # relative error of one operation
SUM_TOL = 1e-12  # by how much the probabilities of a pair of a FiniteMDP may miss 1
SWEEPS, QUEUE, POLICIES = 0, 1, 2  # the three ways
STAND = 4  # sweeps for which a policy stands
WINDOW = 6  # times that actions are compared before the contraction of the span is judged
PATIENCE = 10.0  # windows that it may still need; where it needs more, the queue takes over
QUEUE_CAP = 400  # backups a state, and a million in all, after which policies take over from the queue
MOST = 100_000  # backups a state at gamma = 1, where nothing contracts


@checked
@interruptible
def solve(mdp: FiniteMDP, gamma: float, tol: float = 1e-6) -> Solution:
    """Optimal values and policy with a certified error: max |V - v_*| <= bound.

    gamma = 1: a bound exists where every policy that never ends is worth minus infinity (see `error_bound`). Elsewhere
    bound is inf, and converged says that V solves the optimality equations up to rounding.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    gamma : float
        Discount, in [0, 1].
    tol : float
        The bound that is wanted, positive; where doubles cannot give it, converged is False and bound says what was
        reached.

    Returns
    -------
    Solution
        n_iter counts sweeps; history is None, for none is kept.

    Raises
    ------
    ValueError
        At gamma = 1 where a state cannot reach a terminal one, or values grow without end.

    Notes
    -----
    Ledger: eq-16, alg-value-iteration.

    References
    ----------
    Puterman (1994), theorems 6.6.3 and 6.6.6.

    Examples
    --------
    >>> from rlcore import solve
    >>> from rlcore.envs.grids import gridworld
    >>> found = solve(gridworld(), 0.9, tol=1e-9)
    >>> found.converged, found.V.round(2).reshape(4, 4)
    (True, array([[ 0.  , -1.  , -1.9 , -2.71],
           [-1.  , -1.9 , -2.71, -1.9 ],
           [-1.9 , -2.71, -1.9 , -1.  ],
           [-2.71, -1.9 , -1.  ,  0.  ]]))
    """
    if gamma == 1:
        V, bound, n_iter = _undiscounted(mdp, tol)
        Q = q_from_v(mdp, V, gamma)
        pi, best = greedy(Q), greedy_actions(Q)
        pi = prefer_ends(mdp, pi, best) if marks()[0] else settled(mdp, V, pi, best, 1e-9 * (1 + np.abs(V).max()))
    elif _is_dense(mdp):
        V, Q, pi, bound, n_iter = _solve_dense(mdp, gamma, tol)
    else:
        V, Q, pi, bound, n_iter = _solve_sparse(*_arrays(mdp), mdp.reward, mdp.legal, mdp.terminal, gamma, tol, marks())
    if not np.isfinite(V).all():
        raise ValueError(f"mdp: got rewards up to {np.abs(mdp.reward).max():g}, must be smaller: values are infinite")
    solved = bound <= tol or (gamma == 1 and bound == np.inf and not marks()[0])
    return Solution(V, Q, pi, n_iter, bool(solved), bound, None)


def _arrays(mdp):
    return mdp.next_state.view(np.uint32), mdp.prob  # unsigned: a gather V[next_state] without test for a sign, 3x


@compiled
@alone
def _solve_sparse(next_state, prob, reward, legal, terminal, gamma, tol, marks):
    """V, Q, pi, bound, number of sweeps. marks: (2,), the first is 0 while it is to go on."""
    r, low, scale = _expected_reward(prob, reward, legal, terminal)
    S, noise = r.shape[0], (prob.shape[2] + 6) * ULP  # of a backup: K products and sums, and a few more
    V, Q, pi = _lower_bound(low, terminal, gamma), np.empty_like(r), np.zeros(S, np.uint32)
    stand = np.empty((S, prob.shape[2])), np.empty((S, prob.shape[2]), np.uint32), np.empty(S), np.empty(S), marks
    way = SWEEPS if prob.shape[2] > 1 else QUEUE  # where nothing is random nothing is forgotten
    small = tol * (1 - gamma) / max(gamma, 0.5)  # a residual that certifies tol / 2
    rounds, n_iter, bound, old, rounding = 0, 0, np.inf, np.inf, np.inf
    while rounds == 0 or (bound > max(tol, 1.5 * rounding) and n_iter < 1000 + 60 / (1 - gamma) and marks[0] == 0):
        if way == QUEUE:
            n_iter += _queue(next_state, prob, r, terminal, gamma, V, small, max(QUEUE_CAP, 10**6 // S), marks)
            way = POLICIES if n_iter > QUEUE_CAP else QUEUE
        elif rounds > 0:
            n_iter += _stand(next_state, prob, r, terminal, gamma, V, pi, 20 if way == POLICIES else STAND, *stand)
        _lookahead(next_state, prob, r, gamma, V, Q)
        V, shift, half, bound, rounding = _certify(Q, V, terminal, pi, gamma, noise * scale, noise)
        if way == SWEEPS and rounds % WINDOW == 0:
            way, old = SWEEPS if _ends_soon(old, bound, tol) else QUEUE, bound
        if way == QUEUE and half * (1 - gamma) <= small:  # the queue did what it was asked; rounding wants more
            small = small / 4
        rounds, n_iter = rounds + 1, n_iter + 1
    return *_finish(Q, V, terminal, shift, half), bound, n_iter


@compiled
def _ends_soon(old, bound, tol):
    """Whether PATIENCE windows will do at the rate of the last one."""
    return old == np.inf or (bound < old and np.log(bound / tol) < PATIENCE * np.log(old / bound))


# ---------------------------------------------------------------------- the backup


@compiled
def _expected_reward(prob, reward, legal, terminal):
    """r(s, a) with -inf for actions that a state has not; min over s of max over a of it; largest E|R|. eq-4"""
    S, A, K = prob.shape
    r, low, scale = np.empty((S, A)), np.inf, 0.0
    for s in range(S):
        best = -np.inf
        for a in range(A):
            mean = size = 0.0
            for k in range(K):
                mean += prob[s, a, k] * reward[s, a, k]  # eq-4
                size += prob[s, a, k] * abs(reward[s, a, k])
            r[s, a] = mean if legal[s, a] else -np.inf
            best, scale = max(best, r[s, a]), max(scale, size)
        if not terminal[s]:
            low = min(low, best)
    return r, low, scale


@compiled
def _lower_bound(low, terminal, gamma):
    """A constant V below its own backup, hence below v_*: what earning `low` for ever is worth; 0 where it ends."""
    V, ends = np.zeros(terminal.size), False
    for s in range(V.size):
        ends = ends or terminal[s]
    for s in range(V.size):
        if not terminal[s]:
            V[s] = min(low / (1 - gamma), 0.0) if ends else low / (1 - gamma)
    return V


@compiled
def _value(next_state, prob, r, gamma, V, s, a):
    q = 0.0
    for k in range(prob.shape[2]):
        q += prob[s, a, k] * V[next_state[s, a, k]]
    return r[s, a] + gamma * q  # eq-15


@compiled
def _best(next_state, prob, r, gamma, V, s):
    """Largest value of an action in state s, and the first action that has it."""
    best, action = -np.inf, 0
    for a in range(prob.shape[1]):
        q = 0.0
        for k in range(prob.shape[2]):
            q += prob[s, a, k] * V[next_state[s, a, k]]
        q = r[s, a] + gamma * q  # eq-15
        if q > best:
            best, action = q, a
    return best, action  # eq-16


@compiled
def _lookahead(next_state, prob, r, gamma, V, Q):
    """Q (S, A), the values of all actions for V."""
    for s in range(Q.shape[0]):
        for a in range(Q.shape[1]):
            q = 0.0
            for k in range(prob.shape[2]):
                q += prob[s, a, k] * V[next_state[s, a, k]]
            Q[s, a] = r[s, a] + gamma * q  # eq-15


# ---------------------------------------------------------------------- the certificate


@compiled
def _certify(Q, V, terminal, pi, gamma, reward_noise, noise):
    """From Q, the lookahead of V: a lower bound of v_*, its shift, half the gap to the upper one, error, rounding.

    Where lo <= max Q - V <= hi in every state, v_* lies between max Q + gamma lo / (1 - gamma) and the same with hi.
    Fills pi with the maximising actions. noise: relative rounding error of a backup. Source: MacQueen (1966).
    """
    S, A = Q.shape
    lo, hi, top, TV = np.inf, -np.inf, 0.0, np.zeros(S)
    for s in range(S):
        change = 0.0
        if not terminal[s]:
            best, action = Q[s, 0], 0
            for a in range(1, A):
                if Q[s, a] > best:
                    best, action = Q[s, a], a
            TV[s], pi[s], change = best, action, best - V[s]
        lo, hi, top = min(lo, change), max(hi, change), max(top, abs(V[s]))
    shift, half = gamma * lo / (1 - gamma), gamma * (hi - lo) / (1 - gamma) / 2
    for s in range(S):
        if not terminal[s]:
            TV[s] += shift
    if gamma * (1 + SUM_TOL) >= 1:
        return TV, shift, half, np.inf, np.inf
    sums = 2 * SUM_TOL * max(abs(lo), abs(hi)) / (1 - gamma) / (1 - gamma * (1 + SUM_TOL))
    rounding = (reward_noise + noise * (top + abs(shift) + half)) / (1 - gamma)
    return TV, shift, half, half + sums + rounding, rounding


@compiled
def _finish(Q, V, terminal, shift, half):
    """V, Q and greedy policy in the middle of the bounds."""
    S, A = Q.shape
    pi = np.zeros(Q.shape)
    for s in range(S):
        pi[s, Q[s].argmax()] = 1.0
        if not terminal[s]:
            for a in range(A):
                Q[s, a] += shift + half
            V[s] += half
    return V, Q, pi


# ---------------------------------------------------------------------- three ways to repeat the backup


@compiled
def _stand(next_state, prob, r, terminal, gamma, V, pi, n, rows, columns, gain, old, marks):
    """n sweeps in which the actions pi stand, on a copy of their rows (2x). Returns n.

    rows, columns: (S, K), gain, old: (S,), to work in: fresh memory each time costs a fifth more at 10^6 states.
    """
    S, K = V.size, prob.shape[2]
    for s in range(S):
        gain[s] = r[s, pi[s]]
        for k in range(K):
            rows[s, k], columns[s, k] = prob[s, pi[s], k], next_state[s, pi[s], k]
    for _ in range(n):
        if marks[0] != 0:
            break
        old[:] = V
        for s in range(S):
            if not terminal[s]:
                q = 0.0
                for k in range(K):
                    q += rows[s, k] * old[columns[s, k]]
                V[s] = gain[s] + gamma * q
    return n


@compiled
@alone
def _queue(next_state, prob, r, terminal, gamma, V, small, most, marks):
    """Back up the states that wait, first come first served; a change by more than small calls the predecessors.

    A state compares its actions on its first two visits and on each eighth after them (2x). Returns the number of
    backups divided by that of the states, at least `most` where it stopped before the queue was empty.
    """
    S, n, head, length = V.size, 0, 0, 0
    first, predecessor = _predecessors(next_state, prob)
    queue, waits, visits = np.empty(S, np.uint32), np.zeros(S, np.bool_), np.zeros(S, np.uint8)
    pi = np.zeros(S, np.uint32)
    for s in range(S):
        if not terminal[s]:
            queue[length], waits[s] = s, True
            length += 1
    while length > 0 and n < most * S and marks[0] == 0:
        s = queue[head]
        head, length, n = head + 1 if head + 1 < S else 0, length - 1, n + 1
        waits[s] = False
        if visits[s] < 2:
            v, pi[s] = _best(next_state, prob, r, gamma, V, s)
        else:
            v = _value(next_state, prob, r, gamma, V, s, pi[s])
        visits[s] = visits[s] + 1 if visits[s] < 8 else 1
        if abs(v - V[s]) > small:
            V[s] = v
            for i in range(first[s], first[s + 1]):
                j = predecessor[i]
                if not (waits[j] or terminal[j]):
                    tail = head + length
                    queue[tail if tail < S else tail - S], waits[j] = j, True
                    length += 1
    return n // S


@compiled
def _predecessors(next_state, prob):
    """FiniteMDP.predecessors by counting instead of sorting (20x): (first (S + 1,), indices)."""
    S, A, K = prob.shape
    first, last = np.zeros(S + 2, np.int64), np.full(S, S, np.uint32)
    for s in range(S):
        for a in range(A):
            for k in range(K):
                j = next_state[s, a, k]
                if prob[s, a, k] > 0 and last[j] != s:
                    first[j + 2] += 1
                    last[j] = s
    for j in range(S):
        first[j + 2] += first[j + 1]
    indices, last = np.empty(first[S + 1], np.uint32), np.full(S, S, np.uint32)
    for s in range(S):
        for a in range(A):
            for k in range(K):
                j = next_state[s, a, k]
                if prob[s, a, k] > 0 and last[j] != s:
                    indices[first[j + 1]] = s
                    first[j + 1] += 1
                    last[j] = s
    return first[: S + 1], indices


# ---------------------------------------------------------------------- dense rows, and gamma = 1


def _is_dense(mdp):
    """Whether every row lists all states in order, so that a sweep is one matrix product."""
    S, A, K = mdp.prob.shape
    return K == S > 64 and _in_order(mdp.next_state)


@compiled
def _in_order(next_state):
    """Without the (S, A, S) booleans that NumPy would need: 3x."""
    S, A, K = next_state.shape
    for s in range(S):
        wrong = 0
        for a in range(A):
            for k in range(K):
                wrong |= next_state[s, a, k] ^ k
        if wrong != 0:
            return False
    return True


def _solve_dense(mdp, gamma, tol):
    """As _solve_sparse, each sweep one matrix product (5x at S = 1000)."""
    S, A, K = mdp.prob.shape
    P, noise = mdp.prob.reshape(S * A, S), (K + 6) * ULP
    r, scale = np.einsum("sak,sak->sa", mdp.prob, mdp.reward), max(mdp.reward.max(), -mdp.reward.min())
    r[~mdp.legal] = -np.inf
    V = _lower_bound(r.max(axis=1)[~mdp.terminal].min(), mdp.terminal, gamma)
    pi, P_pi, n_iter, bound, old = r.argmax(axis=1), np.empty((S, S)), 0, np.inf, np.inf
    while n_iter % (WINDOW * (1 + STAND)) or _ends_soon(old, bound, tol):
        old = old if n_iter % (WINDOW * (1 + STAND)) else bound
        row = np.arange(0, S * A, A) + pi
        np.take(P, row, axis=0, out=P_pi, mode="clip")
        for _ in range(STAND):
            V = r.ravel()[row] + gamma * (P_pi @ V)
        Q = r + gamma * (P @ V).reshape(S, A)
        V, shift, half, bound, _ = _certify(Q, V, mdp.terminal, pi, gamma, noise * scale, noise)
        n_iter += 1 + STAND
        if bound <= tol or marks()[0]:
            return *_finish(Q, V, mdp.terminal, shift, half), bound, n_iter
    *found, more = _solve_sparse(*_arrays(mdp), mdp.reward, mdp.legal, mdp.terminal, gamma, tol, marks())
    return *found, n_iter + more


def _undiscounted(mdp, tol):
    """V, bound, number of sweeps at gamma = 1, rising from the value of the uniform policy."""
    P, r_pi = chain(mdp, uniform_policy(mdp))
    if not (ends := reaches(P, mdp.terminal)).all():
        s = np.flatnonzero(~ends)[0]
        raise ValueError(f"gamma: got 1, but no policy ends from state {s}, must be below 1 here")
    V = solve_system(P, r_pi, 1.0, mdp.terminal)
    r, _, scale = _expected_reward(mdp.prob, mdp.reward, mdp.legal, mdp.terminal)
    rounding = lambda: (mdp.prob.shape[2] + 6) * ULP * (scale + np.abs(V).max())  # noqa: E731
    if not rounding() <= scale:  # at random it takes longer than doubles can say: start from a way to the end
        V = solve_system(*chain(mdp, prefer_ends(mdp, np.zeros(mdp.legal.shape), mdp.legal)), 1.0, mdp.terminal)
    n_iter, bound, small = 0, np.inf, np.inf
    while bound > tol and small > rounding() and not marks()[0]:  # V begins far below: its rounding is less each time
        small = max(min(small, tol) / 100, rounding())
        n_iter += (more := _queue(*_arrays(mdp), r, mdp.terminal, 1.0, V, small, MOST, marks()))
        if more >= MOST:
            raise ValueError(f"gamma: got 1, but values still grow after {MOST} sweeps, must be below 1 here")
        bound = error_bound(mdp, V, 1.0)
    return V, bound, n_iter
