"""Monte Carlo: values from the returns of whole episodes (chapters 1 and 4)."""

import numpy as np

from rlcore.core.checks import check_count, check_gamma, check_pi, check_rng, check_v0
from rlcore.core.compiled import compiled
from rlcore.core.results import Run
from rlcore.core.sampling import cumulative, draw
from rlcore.core.worlds import act, books, check_max_steps, reset, run_loop, spaces
from rlcore.schedules import at, check_schedule


def mc_prediction(world, pi, gamma, n_episodes, *, first_visit=True, target="v", max_steps, rng):
    """v_pi or q_pi as the average of the returns that followed each visit. alg-mc-prediction, eq-10, eq-11, cl-011

    world: FiniteMDP or gymnasium.Env. first_visit: average over the first visit in each episode only, else over every
    visit. target: "v" for states (Run.V), "q" for pairs (Run.Q, -inf where a is not in A(s)). What is never visited
    keeps 0. max_steps: an episode that long is cut (its length is max_steps); it still counts, its returns summed up to
    the cut, so that each lacks what would have come after. Returns a Run.
    Source: Sutton and Barto (2018), section 5.1.
    """
    legal, n_episodes = spaces(world)[0], check_count("n_episodes", n_episodes)
    max_steps = check_count("max_steps", max_steps)
    pi, gamma, rng = check_pi(legal, pi), check_gamma(gamma), check_rng(rng)
    if target not in ("v", "q"):
        raise ValueError(f'target: got {target!r}, allowed are "v" and "q"')
    S, A = legal.shape
    width = A if target == "q" else 1  # the averages stand at s * width, plus a where pairs are averaged
    settings = (gamma, n_episodes, bool(first_visit), S, width, max_steps)
    returns, lengths, history = run_loop(_mc_prediction, world, cumulative(pi), *settings, rng=rng)
    if target == "v":
        return Run(returns, lengths, V=history[-1].copy(), policy=pi, history=history)
    history = np.where(legal, history.reshape(-1, S, A), -np.inf)
    return Run(returns, lengths, Q=history[-1].copy(), policy=pi, history=history)


@compiled
def _mc_prediction(world, pi_cdf, gamma, n_episodes, first_visit, S, width, max_steps, rng):
    average, n_visits, seen_in = np.zeros(S * width), np.zeros(S * width), np.full(S * width, -1)
    history, returns, lengths = books(average, n_episodes, 1)
    visited, rewards, counts = np.zeros(max_steps, np.int64), np.zeros(max_steps), np.zeros(max_steps, np.bool_)
    for i in range(n_episodes):
        s, n, done = reset(world, rng), 0, False
        while not done:
            a = draw(pi_cdf[s], rng)
            x = s * width + a if width > 1 else s
            visited[n], counts[n] = x, not first_visit or seen_in[x] != i
            seen_in[x] = i
            s, rewards[n], terminated, truncated = act(world, s, a, rng)
            returns[i] += rewards[n]
            n += 1
            done = terminated or truncated or n == max_steps
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


def constant_alpha_mc(world, pi, gamma, n_episodes, *, alpha, V0=0.0, first_visit=False, max_steps=None, record=1, rng):
    """v_pi by moving V(s) a step towards each return that followed s. alg-constant-alpha-mc, eq-18

    world: FiniteMDP or gymnasium.Env. The updates come after the episode, from its last state back to its first, each
    at once. alpha: step size in (0, 1], or decaying(...); decaying(1.0) is the average of the returns. V0: a number or
    (S,). first_visit: only the first visit of a state in each episode counts. max_steps: an episode that long is cut;
    its returns, like those of a truncated one, go on with the V of the state that it was left in.
    record: history keeps V before the first and after each record-th episode; 0 keeps none. Returns a Run.
    Source: Sutton and Barto (2018), equation 6.1.
    """
    legal, terminal = spaces(world)
    pi, V, alpha, rng = check_pi(legal, pi), check_v0(terminal, V0), check_schedule("alpha", alpha), check_rng(rng)
    settings = (check_gamma(gamma), check_count("n_episodes", n_episodes), alpha, V, bool(first_visit))
    limits = check_max_steps(world, max_steps, pi), check_count("record", record, least=0)
    returns, lengths, history = run_loop(_constant_alpha_mc, world, cumulative(pi), *settings, *limits, rng=rng)
    return Run(returns, lengths, V=V, policy=pi, history=history if record else None)


@compiled
def _constant_alpha_mc(world, pi_cdf, gamma, n_episodes, alpha, V, first_visit, max_steps, record, rng):
    history, returns, lengths = books(V, n_episodes, record)
    N, seen_in = np.zeros(V.size, np.int64), np.full(V.size, -1)
    states, rewards, counts = np.zeros(64, np.int64), np.zeros(64), np.zeros(64, np.bool_)
    for k in range(n_episodes):
        s, n, done, terminated = reset(world, rng), 0, False, False
        while not done:
            if n == states.size:  # no longer episode so far
                states, rewards = np.append(states, states), np.append(rewards, rewards)
                counts = np.append(counts, counts)
            states[n], counts[n] = s, not first_visit or seen_in[s] != k
            seen_in[s] = k
            s, rewards[n], terminated, truncated = act(world, s, draw(pi_cdf[s], rng), rng)
            returns[k] += rewards[n]
            n += 1
            done = terminated or truncated or n == max_steps
        lengths[k] = n
        G = 0.0 if terminated else V[s]
        for t in range(n - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            if counts[t]:
                s = states[t]
                V[s] += at(alpha, N[s]) * (G - V[s])  # eq-18
                N[s] += 1
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = V
    return returns, lengths, history
