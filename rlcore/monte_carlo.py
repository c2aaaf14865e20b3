"""Monte Carlo: values from the returns of whole episodes (chapters 1 and 4)."""

import numpy as np

from rlcore.core.checks import spaces
from rlcore.core.learner import learner, log, note, prediction
from rlcore.core.results import Run
from rlcore.core.rules import choice
from rlcore.core.schedules import at
from rlcore.core.worlds import episode, total


def _averages(name, target, given):
    """The rule of mc_prediction's target: zeros to average in, (S,) for states or (S, A) for pairs."""
    choice("v", "q")(name, target, given)
    legal = spaces(given["world"])[0]
    return np.zeros(legal.shape if target == "q" else len(legal))


def _of_averages(given, average, returns, lengths, history, visits):
    history, visits = history if given["record"] else None, visits.reshape(average.shape)
    if average.ndim == 1:
        return Run(returns, lengths, V=average, policy=given["pi"], history=history, visits=visits)
    legal = spaces(given["world"])[0]
    history = None if history is None else np.where(legal, history, -np.inf)
    Q = np.where(legal, average, -np.inf)
    return Run(returns, lengths, Q=Q, policy=given["pi"], history=history, visits=visits)


@learner(_of_averages, target=_averages)
def mc_prediction(world, pi, gamma, n_episodes, *, first_visit=True, target="v", max_steps=None, record=0, rng):
    """v_pi or q_pi as the average of the returns that followed each visit. alg-mc-prediction, eq-10, eq-11, cl-011

    world: FiniteMDP, gymnasium.Env or its id. first_visit: average over the first visit in each episode only, else over
    every visit. target: "v" for states (Run.V), "q" for pairs (Run.Q, -inf where a is not in A(s)). What is never
    visited keeps 0. max_steps: an episode that long is cut (its length is max_steps); it still counts, its returns
    summed up to the cut, so that each lacks what would have come after. record: history keeps the averages before the
    first and after each record-th episode; 0 keeps none. Returns a Run. Source: Sutton and Barto (2018), section 5.1.
    """
    average, width = target.reshape(-1), target.size // len(target)  # of pair (s, a) at s width + a, of state s at s
    N, first = np.zeros(average.size, np.int64), np.zeros(average.size, np.int64)
    returns, lengths, history = log(target, n_episodes, record)
    for k in range(n_episodes):
        states, actions, rewards, terminated = episode(world, pi, max_steps, rng)
        returns[k], lengths[k] = total(rewards), rewards.size
        if width > 1:
            states = states[:-1] * width + actions
        if first_visit:
            for t in range(rewards.size - 1, -1, -1):
                first[states[t]] = t
        G = 0.0
        for t in range(rewards.size - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            x = states[t]
            if not first_visit or first[x] == t:
                N[x] += 1
                average[x] += (G - average[x]) / N[x]
        if note(world, history, target, k, record):
            break
    return target, returns, lengths, history, N


@learner(prediction)
def constant_alpha_mc(world, pi, gamma, n_episodes, *, alpha, V0=0.0, first_visit=False, max_steps=None, record=0, rng):
    """v_pi by moving V(s) a step towards each return that followed s. alg-constant-alpha-mc, eq-18

    world: FiniteMDP, gymnasium.Env or its id. The updates come after the episode, from its last state back to its
    first, each at once. alpha: step size in (0, 1], or decaying(...); decaying(1.0) is the average of the returns.
    V0: a number or (S,). first_visit: only the first visit of a state in each episode counts. max_steps: an episode
    that long is cut; its returns, like those of a truncated one, go on with the V of the state that it was left in.
    record: history keeps V before the first and after each record-th episode; 0 keeps none. Returns a Run.
    Source: Sutton and Barto (2018), equation 6.1.
    """
    V, N, first = V0, np.zeros(V0.shape, np.int64), np.zeros(V0.shape, np.int64)
    returns, lengths, history = log(V, n_episodes, record)
    for k in range(n_episodes):
        states, actions, rewards, terminated = episode(world, pi, max_steps, rng)
        returns[k], lengths[k] = total(rewards), rewards.size
        if first_visit:
            for t in range(rewards.size - 1, -1, -1):
                first[states[t]] = t
        G = 0.0 if terminated else V[states[-1]]
        for t in range(rewards.size - 1, -1, -1):
            G = rewards[t] + gamma * G  # eq-8
            s = states[t]
            if not first_visit or first[s] == t:
                V[s] += at(alpha, N[s]) * (G - V[s])  # eq-18
                N[s] += 1
        if note(world, history, V, k, record):
            break
    return V, returns, lengths, history, N
