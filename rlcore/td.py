"""Learning values from experience: Monte Carlo averages and temporal differences (chapters 1 and 4)."""

import numpy as np

from rlcore.bellman import is_proper
from rlcore.compiled import compiled
from rlcore.mdp import FiniteMDP, check_count, check_gamma, check_policy, check_values, cumulative, draw, step
from rlcore.results import Run


def mc_prediction(world, pi, gamma, n_episodes, *, first_visit=True, target="v", max_steps, rng):
    """v_pi or q_pi as the average of the returns that followed each visit. alg-mc-prediction, eq-10, eq-11, cl-011

    world: FiniteMDP. first_visit: average over the first visit in each episode only, else over every visit.
    target: "v" for states (Run.V), "q" for pairs (Run.Q, -inf where a is not in A(s)). What is never visited keeps 0.
    max_steps: an episode that long is cut (its length is max_steps); it still counts, its returns summed up to the cut,
    so that each lacks what would have come after. Returns a Run.
    Source: Sutton and Barto (2018), section 5.1.
    """
    pi, gamma = check_policy(_check_world(world), pi), check_gamma(gamma)
    n_episodes, max_steps = check_count("n_episodes", n_episodes), check_count("max_steps", max_steps)
    if target not in ("v", "q"):
        raise ValueError(f'target: got {target!r}, allowed are "v" and "q"')
    S, A = world.n_states, world.n_actions
    width = A if target == "q" else 1  # the averages stand at s * width, plus a where pairs are averaged
    returns, lengths, history = _mc_prediction(
        world.sampler(), cumulative(pi), gamma, n_episodes, bool(first_visit), S, width, max_steps, rng
    )
    if target == "v":
        return Run(returns, lengths, V=history[-1].copy(), policy=pi, history=history)
    history = np.where(world.legal, history.reshape(-1, S, A), -np.inf)
    return Run(returns, lengths, Q=history[-1].copy(), policy=pi, history=history)


@compiled
def _mc_prediction(world, pi_cdf, gamma, n_episodes, first_visit, S, width, max_steps, rng):
    average, n_visits, seen_in = np.zeros(S * width), np.zeros(S * width), np.full(S * width, -1)
    history = np.zeros((n_episodes + 1, S * width))
    returns, lengths = np.zeros(n_episodes), np.zeros(n_episodes, np.int64)
    visited, rewards, counts = np.zeros(max_steps, np.int64), np.zeros(max_steps), np.zeros(max_steps, np.bool_)
    for i in range(n_episodes):
        s = draw(world.start_cdf, rng)
        n = 0
        while not world.terminal[s] and n < max_steps:
            a = draw(pi_cdf[s], rng)
            x = s * width + a if width > 1 else s
            visited[n], counts[n] = x, not first_visit or seen_in[x] != i
            seen_in[x] = i
            s, rewards[n] = step(world, s, a, rng)
            returns[i] += rewards[n]
            n += 1
        lengths[i] = n
        G = 0.0
        for t in range(n - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            if counts[t]:
                x = visited[t]
                n_visits[x] += 1
                average[x] += (G - average[x]) / n_visits[x]
        history[i + 1] = average
    return returns, lengths, history


def td0(world, pi, gamma, n_episodes, *, alpha, V0=0.0, groups=None, max_steps=None, record=1, rng):
    """v_pi by tabular TD(0): each step moves V(s) towards r + gamma V(s'). alg-td0

    world: FiniteMDP. alpha: step size in (0, 1]. V0: a number or (S,). groups: (S,) integers from 0 on; states of one
    group share one value (state aggregation), and V0 is then a number. max_steps: an episode that long is cut, and its
    last step bootstraps like any other; None needs a policy that ends every episode.
    record: history keeps V before the first and after each record-th episode; 0 keeps none. Returns a Run.
    Source: Sutton (1988); Sutton and Barto (2018), section 6.1, and 9.3 for groups.
    """
    pi, gamma, n_episodes = (
        check_policy(_check_world(world), pi),
        check_gamma(gamma),
        check_count("n_episodes", n_episodes),
    )
    record = check_count("record", record, least=0)
    if not 0 < alpha <= 1:
        raise ValueError(f"alpha: got {alpha!r}, must be in (0, 1]")
    if max_steps is None and not is_proper(world, pi):
        raise ValueError("max_steps: got None, must be a number because some episode under pi never ends")
    max_steps = np.iinfo(np.int64).max if max_steps is None else check_count("max_steps", max_steps)
    w, groups = check_values(world, V0, "V0"), _check_groups(world, V0, groups)
    if np.ndim(V0) == 0:
        w = np.full(groups.max() + 1, float(V0))
    returns, lengths, w, history = _td0(
        world.sampler(), cumulative(pi), gamma, n_episodes, float(alpha), w, groups, max_steps, record, rng
    )
    V, history = check_values(world, w[groups]), np.where(world.terminal, 0.0, history[:, groups])
    return Run(returns, lengths, V=V, policy=pi, history=history if record else None)


@compiled
def _td0(world, pi_cdf, gamma, n_episodes, alpha, w, groups, max_steps, record, rng):
    history = np.zeros((1 + (n_episodes // record if record else 0), w.size))
    history[0] = w
    returns, lengths = np.zeros(n_episodes), np.zeros(n_episodes, np.int64)
    for i in range(n_episodes):
        s = draw(world.start_cdf, rng)
        terminated = False
        while not terminated and lengths[i] < max_steps:
            s_next, r = step(world, s, draw(pi_cdf[s], rng), rng)
            terminated = world.terminal[s_next]
            g = groups[s]
            delta = r + gamma * w[groups[s_next]] * (not terminated) - w[g]
            w[g] += alpha * delta
            returns[i] += r
            lengths[i] += 1
            s = s_next
        if record and (i + 1) % record == 0:
            history[(i + 1) // record] = w
    return returns, lengths, w, history


def _check_world(world):
    if not isinstance(world, FiniteMDP):
        raise ValueError(f"world: got {type(world).__name__}, must be a FiniteMDP")
    return world


def _check_groups(world, V0, groups):
    """groups as (S,) integers; each state its own group where None."""
    if groups is None:
        return np.arange(world.n_states)
    groups = np.asarray(groups)
    if groups.shape != (world.n_states,) or groups.dtype.kind not in "iu" or groups.min() < 0:
        raise ValueError(
            f"groups: got {groups.dtype} of shape {groups.shape}, must be ({world.n_states},) integers from 0"
        )
    if np.ndim(V0):
        raise ValueError(f"V0: got shape {np.shape(V0)}, must be a number where groups share values")
    return groups.astype(np.int64)
