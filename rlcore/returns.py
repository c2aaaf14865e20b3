"""Targets of multi-step backups, on one recorded episode: n-step returns, their mixtures, lambda-returns (chapter 5).

One convention throughout: rewards (T,) holds R_1 ... R_T; values holds V(S_0) ... V(S_{T-1}) where the episode
terminated, and one more entry, V(S_T), where it was cut and goes on unseen.
"""

import numpy as np

from rlcore.bellman import policy_matrix, solve_policy
from rlcore.compiled import compiled
from rlcore.mdp import FiniteMDP, as_floats, as_integers, check_count, check_gamma, check_probability, check_values
from rlcore.tabular import check_rate

TRACES = ("accumulating", "dutch", "replacing")


# ---------------------------------------------------------------------- the forward view


@compiled
def return_to_horizon(rewards, gamma, t, h, c):
    """G_t^h(c): the rewards from t + 1 to h, then c. Older rewards may have been overwritten, R_{k+1} at k mod size."""
    for k in range(h - 1, t - 1, -1):
        c = rewards[k % rewards.size] + gamma * c  # eq-25
    return c


@compiled
def lambda_returns(rewards, values, gamma, lam, first):
    """L_t for t from `first` on, (T,), 0 before; values (T + 1,)."""
    L = np.zeros(rewards.size)
    G = values[rewards.size]
    for t in range(rewards.size - 1, first - 1, -1):
        G = rewards[t] + gamma * ((1 - lam) * values[t + 1] + lam * G)  # eq-32
        L[t] = G
    return L


def n_step_return(rewards, values, gamma, n, t=None):
    """G_t^{t+n}(V(S_{t+n})), or the complete return where t + n passes the end. eq-22, eq-23, eq-24, eq-25, cl-064

    rewards: (T,). values: (T,) where the episode terminated, (T + 1,) where it was cut. t: a time in 0..T-1; all times
    where it is None. Returns a number, or (T,). Source: Sutton and Barto (2018), (7.1).
    """
    rewards, values, gamma, n = *_episode(rewards, values), check_gamma(gamma), check_count("n", n)
    T = rewards.size
    if t is not None:
        t = FiniteMDP._index("t", t, T)
        return float(return_to_horizon(rewards, gamma, t, min(t + n, T), values[min(t + n, T)]))
    return np.array([n_step_return(rewards, values, gamma, n, t) for t in range(T)])


def complex_backup(rewards, values, gamma, weights):
    """A mixture of n-step returns, (T,). eq-u-complex-example, alg-complex-backup

    rewards, values: as in n_step_return. weights: {n: weight}, weights at least 0 that sum to 1.
    Source: Watkins (1989), section 7.2.
    """
    weights = _check_weights("weights", weights)
    return sum(w * n_step_return(rewards, values, gamma, n) for n, w in weights.items())


def lambda_return(rewards, values, gamma, lam):
    """L_0 ... L_{T-1}, (T,), by one backward pass. eq-31, eq-32, alg-lambda-return, cl-070

    rewards, values: as in n_step_return. lam = 0 gives the one-step target, lam = 1 the return, both exactly.
    Source: Sutton and Barto (2018), (12.18).
    """
    rewards, values, gamma, lam = *_episode(rewards, values), check_gamma(gamma), check_probability("lam", lam)
    return lambda_returns(rewards, values, gamma, lam, 0)


def lambda_weights(T_minus_t, lam):
    """Weights of the 1-step, 2-step, ... and of the complete return in L_t, (T_minus_t,). eq-32, fig-23, fig-24

    T_minus_t: how many steps are left. The complete return, which comes last, gets all that the others leave.
    """
    n, lam = np.arange(1, check_count("T_minus_t", T_minus_t) + 1), check_probability("lam", lam)
    return np.where(n < n.size, 1 - lam, 1.0) * lam ** (n - 1.0)  # eq-32


def error_reduction(mdp, pi, v, n, gamma, *, printed=False):
    """(left, right) of max |E[n-step return with v] - v_pi| <= gamma^n max |v - v_pi|. eq-30, cl-065, cl-069

    v: a number or (S,). n: a number of steps, or {n: weight} for a mixture of them, whose factor is the mixture of the
    gamma^n. printed: bootstrap from S_{t+1} whatever n is, as printed in the document; then it may fail.
    Exact, from powers of the transition matrix. Source: Sutton and Barto (2018), (7.3).
    """
    v_pi, v = solve_policy(mdp, pi, gamma), check_values(mdp, v, "v")
    P, r = policy_matrix(mdp, pi)
    weights = _check_weights("n", n) if isinstance(n, dict) else {check_count("n", n): 1.0}
    expected, factor = np.zeros_like(v), 0.0
    for steps, weight in weights.items():
        rewards, last = np.zeros_like(v), P @ v if printed else v
        for _ in range(steps):
            rewards, last = r + gamma * (P @ rewards), last if printed else P @ last
        expected += weight * (rewards + gamma**steps * last)
        factor += weight * gamma**steps
    return float(np.abs(expected - v_pi).max()), float(factor * np.abs(v - v_pi).max())  # eq-30


# ---------------------------------------------------------------------- the backward view


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


# ---------------------------------------------------------------------- both, on one recorded episode


def forward_increments(states, rewards, V, gamma, lam, alpha):
    """What the lambda-returns of an episode add to V, V held fixed: (T, S), row t at time t. eq-33, fig-25

    states: (T,) where the episode terminated, else (T + 1,). rewards: (T,). V: (S,). The sum over t is the update.
    """
    states, rewards, values, V = _visits(states, rewards, V)
    L = lambda_return(rewards, values, gamma, lam)
    increments = np.zeros((rewards.size, V.size))
    increments[np.arange(rewards.size), states[: rewards.size]] = check_rate(alpha) * (L - values[: rewards.size])
    return increments  # eq-33


def backward_increments(states, rewards, V, gamma, lam, alpha, trace="accumulating"):
    """alpha delta_t E_t(s) of an episode, V held fixed: (T, S), row t at time t. eq-36, eq-37, fig-27, cl-073

    states, rewards, V: as in forward_increments. With accumulating traces the sums over t are equal.
    """
    states, rewards, values, V = _visits(states, rewards, V)
    gamma_lam = check_gamma(gamma) * check_probability("lam", lam)
    values = np.append(values, 0.0) if values.size == rewards.size else values
    delta = rewards + gamma * values[1:] - values[:-1]  # eq-36
    E, e = np.zeros((rewards.size, V.size)), np.zeros(V.size)
    for t, s in enumerate(states[: rewards.size]):
        E[t] = e = trace_update(e, np.arange(V.size) == s, gamma_lam, trace, alpha)
    return check_rate(alpha) * delta[:, None] * E  # eq-37


# ---------------------------------------------------------------------- checks


def _episode(rewards, values):
    """rewards (T,) and values (T + 1,) as floats, the last value 0 where the episode terminated."""
    rewards, values = as_floats("rewards", rewards), as_floats("values", values)
    for name, x in (("rewards", rewards), ("values", values)):
        if not np.isfinite(x).all():
            raise ValueError(f"{name}: contains a number that is not finite, must be finite")
    if rewards.ndim != 1 or rewards.size == 0:
        raise ValueError(f"rewards: got shape {rewards.shape}, must be (T,) with T at least 1")
    if values.shape not in (rewards.shape, (rewards.size + 1,)):
        raise ValueError(f"values: got shape {values.shape}, must be ({rewards.size},) or ({rewards.size + 1},)")
    return rewards, np.append(values, 0.0) if values.size == rewards.size else values


def _visits(states, rewards, V):
    """states, rewards, the values of the states, and V; ValueError unless they fit each other."""
    states, V = as_integers("states", states), as_floats("V", V)
    if V.ndim != 1:
        raise ValueError(f"V: got shape {V.shape}, must be (S,)")
    if states.ndim != 1 or ((states < 0) | (states >= V.size)).any():
        raise ValueError(f"states: got {states}, must be (T,) or (T + 1,) states in 0..{V.size - 1}")
    if states.size not in (np.size(rewards), np.size(rewards) + 1):
        raise ValueError(f"states: got {states.size}, must be as many as rewards, or one more")
    return states, as_floats("rewards", rewards), V[states], V


def _check_weights(name, weights):
    """weights as {int: float}; ValueError unless they are at least 0 and sum to 1."""
    if not isinstance(weights, dict) or not weights:
        raise ValueError(f"{name}: got {weights!r}, must be {{n: weight}} with at least one n")
    weights = {check_count(name, n): check_probability(name, w) for n, w in weights.items()}
    if abs(sum(weights.values()) - 1) > 1e-9:
        raise ValueError(f"{name}: weights sum to {sum(weights.values()):.12g}, must be 1")
    return weights
