"""Robots of chapter 1."""

from rlcore.mdp import FiniteMDP, check_probability

__all__ = ["recycling_robot"]


def recycling_robot(*, alpha=0.9, beta=0.6, r_search=2.0, r_wait=1.0, r_rescue=-3.0):
    """A robot that searches for cans, waits for them or recharges; states high and low charge. ex-recycling

    alpha, beta: probability that searching leaves a high, a low battery as it is. r_search, r_wait: expected cans per
    step; r_rescue: reward when the battery runs empty and the robot is carried home. A(high) = {search, wait}.
    Source: Sutton and Barto (2018), example 3.3.
    """
    for name, value in dict(alpha=alpha, beta=beta).items():
        check_probability(name, value)
    high, low, search, wait, recharge = 0, 1, 0, 1, 2
    outcomes = {
        (high, search): [(alpha, high, r_search), (1 - alpha, low, r_search)],
        (high, wait): [(1.0, high, r_wait)],
        (low, search): [(beta, low, r_search), (1 - beta, high, r_rescue)],
        (low, wait): [(1.0, low, r_wait)],
        (low, recharge): [(1.0, high, 0.0)],
    }
    names = dict(state_names=("high", "low"), action_names=("search", "wait", "recharge"))
    return FiniteMDP.from_outcomes(outcomes, start=high, **names)
