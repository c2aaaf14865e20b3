"""Robots of chapter 1: recycling, pick-and-place, an arm, a can collector, and the pole on its cart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rlcore.core.checks import (
    as_floats,
    as_integers,
    check_finite,
    check_index,
    check_nonnegative,
    check_positive,
    check_probability,
    check_rate,
    finite,
    show,
)
from rlcore.core.extras import extra
from rlcore.core.results import Run
from rlcore.core.rules import checked, choice, function_of, rules
from rlcore.core.types import ArrayLike, Floats, Rng
from rlcore.mdp import FiniteMDP

__all__ = [
    "arm_motion",
    "can_robot",
    "pick_and_place",
    "pole_balancing",
    "pole_continuing",
    "pole_return",
    "push_pole",
    "recycling_robot",
]


@checked(**rules(check_probability, "alpha beta"), **rules(check_finite, "r_search r_wait r_rescue"))
def recycling_robot(
    *, alpha: float = 0.9, beta: float = 0.6, r_search: float = 2.0, r_wait: float = 1.0, r_rescue: float = -3.0
) -> FiniteMDP:
    """A robot that searches for cans, waits for them or recharges; charge high or low.

    A(high) = {search, wait}.

    Parameters
    ----------
    alpha : float
        Probability that searching leaves a high battery high.
    beta : float
        Probability that searching leaves a low battery low.
    r_search : float
        Expected cans of a step of searching.
    r_wait : float
        Expected cans of a step of waiting.
    r_rescue : float
        Reward when the battery runs empty and the robot is carried home.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-recycling.

    References
    ----------
    Sutton and Barto (2018), example 3.3.

    Examples
    --------
    >>> from rlcore import solve
    >>> from rlcore.envs.robots import recycling_robot
    >>> mdp = recycling_robot()
    >>> [mdp.action_names[a] for a in solve(mdp, 0.9).pi.argmax(axis=1)]
    ['search', 'recharge']
    """
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


# ---------------------------------------------------------------------- pick and place


@checked
def pick_and_place(*, jerk: float = 0.0) -> FiniteMDP:
    """An arm over five cells that carries parts from cell 0 to cell 4, for ever.

    State 5 * holding + cell. Slow moves go one cell, fast ones two. grip takes a part at cell 0 and puts it down at
    cell 4 for reward +1; anywhere else it costs -1.

    Parameters
    ----------
    jerk : float
        Probability that a fast move goes one cell only, with a jerk of reward -1.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-pick-and-place.
    """
    outcomes = {}
    for holding in (0, 1):
        for cell in range(5):
            s = 5 * holding + cell
            for a, (steps, sign) in enumerate([(1, -1), (1, 1), (2, -1), (2, 1)]):
                far = 5 * holding + min(max(cell + sign * steps, 0), 4)
                near = 5 * holding + min(max(cell + sign, 0), 4)
                outcomes[s, a] = [(1 - jerk, far, 0.0), (jerk, near, -1.0)] if steps == 2 else [(1.0, near, 0.0)]
            outcomes[s, 4] = [(1.0, s, -1.0)]
    outcomes[0, 4] = [(1.0, 5, 0.0)]  # grips
    outcomes[9, 4] = [(1.0, 4, 1.0)]  # releases
    states = tuple(f"{cell} {word}" for word in ("empty", "holding") for cell in range(5))
    actions = ("slow left", "slow right", "fast left", "fast right", "grip")
    return FiniteMDP.from_outcomes(outcomes, start=0, state_names=states, action_names=actions)


@checked(smoothness=check_nonnegative, dt=check_rate, effort=check_positive)
def arm_motion(smoothness: float, *, n_steps: int = 60, dt: float = 0.05, effort: float = 0.001) -> tuple[Floats, ...]:
    """Best motion of a one-joint arm from position 0 to 1 under a penalty on changes of its voltage.

    Position x, velocity v, voltage u: x' = x + dt v, v' = v + dt (u - v). The reward of a step is -(x - 1)^2 - effort
    u^2 - smoothness (u - u_before)^2, x and u as the step finds and chooses them; gamma = 1. The dynamic program is
    solved exactly, for rewards are quadratic and the dynamics linear.

    Parameters
    ----------
    smoothness : float
        Weight of the penalty, at least 0.
    n_steps : int
        Steps.
    dt : float
        Length of a step, in (0, 1].
    effort : float
        Weight of the squared voltage, above 0.

    Returns
    -------
    position : Floats
        (n_steps + 1,).
    velocity : Floats
        (n_steps + 1,).
    voltage : Floats
        (n_steps,).
    rewards : Floats
        (n_steps,).

    Notes
    -----
    Ledger: ex-pick-and-place.
    """
    # state z = (x - 1, v, u_before), action w = u - u_before: z' = A z + B w, cost z D z + 2 z C w + R w w
    A, B = np.array([[1, dt, 0], [0, 1 - dt, dt], [0, 0, 1]]), np.array([0, dt, 1])
    D, C, R = np.diag([1, 0, effort]), np.array([0, 0, effort]), effort + smoothness
    P, gains = np.diag([1.0, 0, 0]), []
    for _ in range(n_steps):  # value -z P z, backwards from the last step
        gain = (B @ P @ A + C) / (B @ P @ B + R)
        P = D + A.T @ P @ A - np.outer(A.T @ P @ B + C, gain)
        gains.append(gain)
    z, rewards = np.zeros((n_steps + 1, 3)), np.zeros(n_steps)
    z[0, 0] = -1
    for t, gain in enumerate(reversed(gains)):
        w = -gain @ z[t]
        z[t + 1] = A @ z[t] + B * w
        rewards[t] = -(z[t, 0] ** 2) - effort * z[t + 1, 2] ** 2 - smoothness * w**2
    return z[:, 0] + 1, z[:, 1], z[1:, 2], rewards


# ---------------------------------------------------------------------- a robot that collects cans

OFFICE = ("R..#c", ".#...", "...#.", "c#..w", "....B")  # robot, can, obstacle, wrong object, bin
HELD, BINNED = 25, 26


@checked(reward_for=choice("delivery", "pick-up"))
def can_robot(*, reward_for: str = "delivery") -> FiniteMDP:
    """A robot in an office of 5 x 5 cells with two cans, a bin, obstacles and one wrong object.

    Bumping and picking up the wrong object give -1. The episode ends with both cans in the bin. state_names: (cell of
    the robot, place of can 1, place of can 2), where a place is a cell, 25 (in the hand) or 26 (in the bin).

    Parameters
    ----------
    reward_for : str
        "delivery": +1 for a can dropped into the bin; "pick-up": +1 for every can picked up, while dropping it on the
        floor costs nothing.

    Returns
    -------
    FiniteMDP
        The process.

    Notes
    -----
    Ledger: ex-recycling, cl-008.
    """
    layout = "".join(OFFICE)
    states = [(layout.index("R"), layout.index("c"), layout.rindex("c"))]
    index, outcomes = {states[0]: 0}, {}
    for s, state in enumerate(states):  # grows while it is read: what can be reached from the start
        if state[1:] == (BINNED, BINNED):
            continue
        for a in range(6):
            state_next, r = _office_step(layout, state, a, reward_for)
            if state_next not in index:
                index[state_next] = len(states)
                states.append(state_next)
            outcomes[s, a] = [(1.0, index[state_next], r)]
    actions = ("up", "down", "right", "left", "pick", "drop")
    return FiniteMDP.from_outcomes(outcomes, n_states=len(states), start=0, state_names=states, action_names=actions)


def _office_step(layout, state, a, reward_for):
    """(next state, reward) of action a: 0..3 move, 4 picks, 5 drops."""
    robot, *cans = state
    if a < 4:
        row, col = robot // 5 + (-1, 1, 0, 0)[a], robot % 5 + (0, 0, 1, -1)[a]
        if not (0 <= row < 5 and 0 <= col < 5) or layout[5 * row + col] == "#":
            return state, -1.0
        return (5 * row + col, *cans), 0.0
    if a == 4 and layout[robot] == "w":
        return state, -1.0
    if a == 4 and HELD not in cans and robot in cans:
        cans[cans.index(robot)] = HELD
        return (robot, *cans), float(reward_for == "pick-up")
    if a == 5 and HELD in cans:
        in_bin = layout[robot] == "B"
        cans[cans.index(HELD)] = BINNED if in_bin else robot
        return (robot, *cans), float(in_bin and reward_for == "delivery")
    return state, 0.0


# ---------------------------------------------------------------------- the pole on its cart


def _failures(name, K, given):
    K = as_floats(name, K)
    if not (K >= 1).all():
        raise ValueError(f"{name}: got {show(K)}, must be at least 1")
    return K


@checked(fail_step=_failures)
def pole_return(fail_step: int, gamma: float, *, again: bool = False) -> float:
    """G_0 of pole balancing as a continuing task: reward -1 at the step of a failure, else 0.

    Parameters
    ----------
    fail_step : int
        K, the first failing step, at least 1; a number or an array.
    gamma : float
        Discount, in [0, 1].
    again : bool
        Whether the pole, put upright, falls again every K steps for ever.

    Returns
    -------
    float
        As fail_step; -inf for `again` at gamma = 1.

    Notes
    -----
    Ledger: eq-u-pole-return.

    References
    ----------
    Sutton and Barto (2018), example 3.4.

    Examples
    --------
    >>> from rlcore.envs.robots import pole_return
    >>> float(pole_return(3, 0.5)), float(pole_return(1, 0.5, again=True))
    (-0.25, -2.0)
    """
    K = fail_step
    first = -(gamma ** (K - 1))  # eq-u-pole-return
    if not again:
        return first
    return np.divide(first, 1 - gamma**K, out=np.full_like(first, -np.inf), where=gamma < 1)


@checked(policy=function_of("(state, rng)"))
def pole_balancing(policy: Callable[[Floats, Rng], int], n_episodes: int, *, max_steps: int, rng: Rng) -> Run:
    """Pole balancing as an episodic task: +1 for each step until the pole falls.

    The world is gymnasium's CartPole.

    Parameters
    ----------
    policy : Callable[[Floats, Rng], int]
        policy(state, rng) gives 0 (push left) or 1 (push right); state: (x, x_dot, theta, theta_dot).
    n_episodes : int
        Episodes.
    max_steps : int
        An episode that long is cut; its length is max_steps.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Run
        Returns and lengths.

    Notes
    -----
    Ledger: ex-pole-episodic.
    """
    env = _cart_pole(rng)
    returns, lengths = np.zeros(n_episodes), np.zeros(n_episodes, int)
    for i in range(n_episodes):
        state, terminated = env.reset()[0], False
        while not terminated and lengths[i] < max_steps:
            state, r, terminated, _, _ = env.step(check_index("policy", policy(state, rng), 2))
            returns[i] += r
            lengths[i] += 1
    return Run(returns, lengths)


@checked(policy=function_of("(state, rng)"))
def pole_continuing(policy: Callable[[Floats, Rng], int], n_steps: int, *, rng: Rng) -> Floats:
    """Pole balancing as a continuing task: -1 where the pole falls and is put up again, else 0.

    Parameters
    ----------
    policy : Callable[[Floats, Rng], int]
        As for `pole_balancing`.
    n_steps : int
        Steps.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Floats
        (n_steps,), the rewards.

    Notes
    -----
    Ledger: ex-pole-continuing.
    """
    env, rewards = _cart_pole(rng), np.zeros(n_steps)
    state = env.reset()[0]
    for t in range(rewards.size):
        state, _, fell, _, _ = env.step(check_index("policy", policy(state, rng), 2))
        if fell:
            rewards[t] = -1.0
            state = env.reset()[0]
    return rewards


def _pushes(name, pushes, given):
    pushes = as_integers(name, pushes)
    if pushes.ndim != 1 or not np.isin(pushes, [0, 1]).all():
        raise ValueError(f"{name}: got {show(pushes)}, must be a list of 0 and 1")
    return pushes


def _pole(name, state, given):
    state = finite(name, state)
    if state.shape != (4,):
        raise ValueError(f"{name}: got shape {state.shape}, must be (4,)")
    return state


@checked(pushes=_pushes, state=_pole)
def push_pole(pushes: ArrayLike, *, state: ArrayLike = (0.0, 0.0, 0.04, 0.0), hold: int = 4) -> Floats:
    """States of the cart-pole under pushes, up to a failure.

    Parameters
    ----------
    pushes : ArrayLike
        (n,), 0 left, 1 right.
    state : ArrayLike
        (x, x_dot, theta, theta_dot) in metres, radians and seconds.
    hold : int
        Steps of 0.02 s that each push lasts.

    Returns
    -------
    Floats
        (T + 1, 4), T at most n hold.

    Notes
    -----
    Ledger: fig-2.
    """
    env = _cart_pole(None)
    env.reset(seed=0)
    env.state = np.array(state)
    states = [env.state]
    for push in np.repeat(pushes, hold):
        _, _, fell, _, _ = env.step(int(push))
        states.append(np.array(env.state))
        if fell:
            break
    return np.array(states)


def _cart_pole(rng):
    """gymnasium's CartPole without its wrappers, seeded from rng."""
    with extra("gym"):
        import gymnasium

    env = gymnasium.make("CartPole-v1").unwrapped
    if rng is not None:
        env.reset(seed=int(rng.integers(2**31)))
    return env
