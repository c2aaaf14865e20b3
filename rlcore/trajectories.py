"""Probabilities of whole trajectories, by enumeration (chapter 3; chapter 7 differentiates them)."""

import itertools

import numpy as np

from rlcore.mdp import check_count, check_policy


def trajectory_probability(mdp, pi, states, actions):
    """p(s_1, a_1, ..., s_T, a_T): start, then policy and dynamics in turn; no dynamics after a_T. eq-u-traj-prob

    states, actions: (T,) each.
    """
    states, actions = np.asarray(states), np.asarray(actions)
    if states.shape != actions.shape or states.ndim != 1 or states.size == 0:
        raise ValueError(f"states: got shape {states.shape}, must be that of actions, {actions.shape}, and not empty")
    pi, P = check_policy(mdp, pi), mdp.transition_probs()
    policy, dynamics = pi[states, actions], P[states[:-1], actions[:-1], states[1:]]
    return float(mdp.start[states[0]] * policy.prod() * dynamics.prod())  # eq-u-traj-prob


def trajectories(mdp, pi, T):
    """Every trajectory of T states and actions: states (n, T), actions (n, T), probabilities (n,). fig-8"""
    T = check_count("T", T)
    states = np.array(list(itertools.product(range(mdp.n_states), repeat=T)))
    actions = np.array(list(itertools.product(range(mdp.n_actions), repeat=T)))
    states, actions = np.repeat(states, len(actions), axis=0), np.tile(actions, (len(states), 1))
    return states, actions, np.array([trajectory_probability(mdp, pi, *tau) for tau in zip(states, actions)])


def objective(mdp, pi, T):
    """Expected sum of T rewards, by enumeration of every trajectory. eq-u-objective, fig-8"""
    states, actions, prob = trajectories(mdp, pi, T)
    return float(prob @ mdp.expected_reward()[states, actions].sum(axis=1))  # eq-u-objective
