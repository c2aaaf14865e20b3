"""Targets of multi-step backups, on one recorded episode: n-step returns, their mixtures, lambda-returns (chapter 5).

One convention throughout: rewards (T,) holds R_1 ... R_T; values holds V(S_0) ... V(S_{T-1}) where the episode
terminated, and one more entry, V(S_T), where it was cut and goes on unseen.
"""

import numpy as np

from rlcore.bellman import solve_policy
from rlcore.core.chains import chain
from rlcore.core.checks import (
    as_integers,
    check_count,
    check_flag,
    check_index,
    check_probability,
    check_rate,
    finite,
    finite_values,
    show,
)
from rlcore.core.compiled import compiled
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.rules import array, checked, choice, count
from rlcore.core.sampling import draw
from rlcore.core.schedules import at
from rlcore.core.worlds import act, episode, reset, total

# ---------------------------------------------------------------------- what an episode is


def reward_list(name, rewards, given):
    """The rule of rewards (T,)."""
    rewards = finite(name, rewards)
    if rewards.ndim != 1 or rewards.size == 0:
        raise ValueError(f"{name}: got shape {rewards.shape}, must be (T,) with T at least 1")
    return rewards


def value_list(name, values, given):
    """The rule of values (T,), or (T + 1,) where the episode was cut: (T + 1,), the last 0 where it terminated."""
    values, T = finite(name, values), given["rewards"].size
    if values.shape not in ((T,), (T + 1,)):
        raise ValueError(f"{name}: got shape {values.shape}, must be ({T},) or ({T + 1},)")
    return np.append(values, 0.0) if values.size == T else values


def visited(name, states, given):
    """The rule of states (T,), or (T + 1,) where the episode was cut; `values_on_the_way` looks whether V has them."""
    states = as_integers(name, states)
    if states.ndim != 1 or states.size == 0 or (states < 0).any():
        raise ValueError(f"{name}: got {show(states)}, must be (T,) or (T + 1,) states from 0 on")
    return states


def values_on_the_way(states, rewards, V):
    """V of the states, (T + 1,), the last 0 where the episode terminated."""
    if ((states < 0) | (states >= V.size)).any():
        raise ValueError(f"states: got {states}, must be (T,) or (T + 1,) states in 0..{V.size - 1}")
    if states.size not in (rewards.size, rewards.size + 1):
        raise ValueError(f"states: got {states.size}, must be as many as rewards, or one more")
    return value_list("values", V[states], {"rewards": rewards})


def _time(name, t, given):
    return check_index(name, t, given["rewards"].size)


def _mixture(name, weights, given):
    """The rule of weights {n: weight}, at least 0, that sum to 1."""
    if not isinstance(weights, dict) or not weights:
        raise ValueError(f"{name}: got {show(weights)}, must be {{n: weight}} with at least one n")
    weights = {check_count(name, n): check_probability(name, w) for n, w in weights.items()}
    if abs(sum(weights.values()) - 1) > 1e-9:
        raise ValueError(f"{name}: weights sum to {sum(weights.values()):.12g}, must be 1")
    return weights


def _steps_or_mixture(name, n, given):
    return _mixture(name, n, given) if isinstance(n, dict) else {check_count(name, n): 1.0}


# ---------------------------------------------------------------------- targets of one episode


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


@checked(rewards=reward_list, values=value_list, t=_time)
def n_step_return(rewards, values, gamma, n, t=None):
    """G_t^{t+n}(V(S_{t+n})), or the complete return where t + n passes the end. eq-22, eq-23, eq-24, eq-25, cl-064

    rewards: (T,). values: (T,) where the episode terminated, (T + 1,) where it was cut. t: a time in 0..T-1; all times
    where it is None. Returns a number, or (T,). Source: Sutton and Barto (2018), (7.1).
    """
    T = rewards.size
    G = [return_to_horizon(rewards, gamma, t, min(t + n, T), values[min(t + n, T)]) for t in ([t], range(T))[t is None]]
    return np.array(G) if t is None else float(G[0])


@checked(rewards=reward_list, values=value_list, weights=_mixture)
def complex_backup(rewards, values, gamma, weights):
    """A mixture of n-step returns, (T,). eq-u-complex-example, alg-complex-backup

    rewards, values: as in n_step_return. weights: {n: weight}, weights at least 0 that sum to 1.
    Source: Watkins (1989), section 7.2.
    """
    return sum(w * n_step_return(rewards, values, gamma, n) for n, w in weights.items())


@checked(rewards=reward_list, values=value_list)
def lambda_return(rewards, values, gamma, lam):
    """L_0 ... L_{T-1}, (T,), by one backward pass. eq-31, eq-32, alg-lambda-return, cl-070

    rewards, values: as in n_step_return. lam = 0 gives the one-step target, lam = 1 the return, both exactly.
    Source: Sutton and Barto (2018), (12.18).
    """
    return lambda_returns(rewards, values, gamma, lam, 0)


@checked(T_minus_t=count())
def lambda_weights(T_minus_t, lam):
    """Weights of the 1-step, 2-step, ... and of the complete return in L_t, (T_minus_t,). eq-32, fig-23, fig-24

    T_minus_t: how many steps are left. The complete return, which comes last, gets all that the others leave.
    """
    n = np.arange(1, T_minus_t + 1)
    return np.where(n < n.size, 1 - lam, 1.0) * lam ** (n - 1.0)  # eq-32


@checked(v=lambda name, v, given: finite_values(given["mdp"], v, name), n=_steps_or_mixture, printed=check_flag)
def error_reduction(mdp, pi, v, n, gamma, *, printed=False):
    """(left, right) of max |E[n-step return with v] - v_pi| <= gamma^n max |v - v_pi|. eq-30, cl-065, cl-069

    v: a number or (S,). n: a number of steps, or {n: weight} for a mixture of them, whose factor is the mixture of the
    gamma^n. printed: bootstrap from S_{t+1} whatever n is, as printed in the document; then it may fail.
    Exact, from powers of the transition matrix. Source: Sutton and Barto (2018), (7.3).
    """
    v_pi, (P, r) = solve_policy(mdp, pi, gamma), chain(mdp, pi)
    expected, factor = np.zeros_like(v), 0.0
    for steps, weight in n.items():
        rewards, last = np.zeros_like(v), P @ v if printed else v
        for _ in range(steps):
            rewards, last = r + gamma * (P @ rewards), last if printed else P @ last
        expected += weight * (rewards + gamma**steps * last)
        factor += weight * gamma**steps
    return float(np.abs(expected - v_pi).max()), float(factor * np.abs(v - v_pi).max())  # eq-30


@checked(states=visited, rewards=reward_list, V=array("S"), alpha=check_rate)
def forward_increments(states, rewards, V, gamma, lam, alpha):
    """What the lambda-returns of an episode add to V, V held fixed: (T, S), row t at time t. eq-33, fig-25

    states: (T,) where the episode terminated, else (T + 1,). rewards: (T,). V: (S,). The sum over t is the update.
    """
    T, values = rewards.size, values_on_the_way(states, rewards, V)
    increments = np.zeros((T, V.size))
    increments[np.arange(T), states[:T]] = alpha * (lambda_returns(rewards, values, gamma, lam, 0) - values[:T])
    return increments  # eq-33


# ---------------------------------------------------------------------- learning from them


@learner(prediction)
def n_step_td(world, pi, gamma, n, n_episodes, *, alpha, online=True, V0=0.0, max_steps=None, record=0, rng):
    """v_pi from n-step returns. alg-n-step-online, alg-n-step-offline, eq-26, eq-27, eq-28, eq-29, cl-067

    world: FiniteMDP, gymnasium.Env or its id. n: the number of rewards in a target; a state is updated n steps after
    its visit, or at the end. alpha: step size in (0, 1], or decaying(...). online: update at each step, else add the
    summed increments when the episode ends. V0: a number or (S,). max_steps: an episode that long is cut, and its last
    targets bootstrap; None needs a policy that ends every episode. record: history keeps V before the first and after
    each record-th episode; 0 keeps none. Returns a Run. Source: Sutton and Barto (2018), section 7.1.
    """
    V, states, rewards = V0, np.zeros(n, np.int64), np.zeros(n)  # the last n steps, that of time t at t mod n
    returns, lengths, history = log(V, n_episodes, record)
    change = V if online else np.zeros_like(V)
    for k in range(n_episodes):
        s, t, done, step = reset(world, rng), 0, False, at(alpha, k)
        while not done:
            a = draw(pi[s], rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            states[t % n], rewards[t % n] = s, r
            returns[k] += r
            t += 1
            done = terminated or truncated or t >= max_steps
            for tau in range(max(t - n, 0), t if done else t - n + 1):
                G = return_to_horizon(rewards, gamma, tau, t, V[s_next] * (not terminated))  # eq-25
                change[states[tau % n]] += step * (G - V[states[tau % n]])  # eq-26, eq-27
            s = s_next
        if not online:
            V += change  # eq-29
            change[:] = 0.0
        lengths[k] = t
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history


@learner(prediction, reading=choice("in order", "summed", "recomputed"))
def offline_lambda_return(
    world, pi, gamma, lam, n_episodes, *, alpha, reading="in order", V0=0.0, max_steps=None, record=0, rng
):
    """v_pi from lambda-returns, at the end of each episode. alg-lambda-return, eq-33

    reading: how the increments (33) of an episode meet. "in order": the targets are those of the V before the episode,
    the updates follow each other, each from the V that the one before left. "summed": V is held fixed for the updates,
    too, and their sum is added once. "recomputed": the targets, too, use the newest V. lam: in [0, 1].
    Others, and the Run that it returns: as in n_step_td. Source: Sutton and Barto (2018), section 12.1.
    """
    V = V0
    returns, lengths, history = log(V, n_episodes, record)
    change = np.zeros_like(V) if reading == "summed" else V
    for k in range(n_episodes):
        states, actions, rewards, terminated = episode(world, pi, max_steps, rng)
        returns[k], lengths[k], step, L = total(rewards), rewards.size, at(alpha, k), rewards
        for t in range(rewards.size):
            if t == 0 or reading == "recomputed":
                values = V[states]
                values[-1] *= not terminated
                L = lambda_returns(rewards, values, gamma, lam, t)  # eq-32
            change[states[t]] += step * (L[t] - V[states[t]])  # eq-33
        if reading == "summed":
            V += change  # eq-29
            change[:] = 0.0
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history
