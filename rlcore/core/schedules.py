"""Step sizes and exploration rates that fall."""

from __future__ import annotations

from typing import Any

from rlcore.core.checks import check_flag, check_nonnegative, check_probability, check_rate, is_number, show
from rlcore.core.compiled import part
from rlcore.core.rules import checked
from rlcore.core.types import Given, Schedule


def _floor(name, floor, given):
    if check_probability(name, floor) > given["first"]:
        raise ValueError(f"{name}: got {show(floor)}, must be at most first, {given['first']:g}")
    return float(floor)


@checked(first=check_rate, rate=check_nonnegative, power=check_nonnegative, floor=_floor, per_step=check_flag)
def decaying(
    first: float, *, rate: float = 1.0, power: float = 1.0, floor: float = 0.0, per_step: bool = False
) -> Schedule:
    """A step size or epsilon that falls: first / (1 + rate n)^power, never below `floor`.

    n counts the earlier updates of the same state or pair where it is a step size, so that decaying(1.0) is 1/N, the
    sample average, and the earlier episodes where an episode has one step size (traces, n-step methods, gradients);
    for epsilon, the finished episodes, or with per_step the steps taken.

    Parameters
    ----------
    first : float
        The first value, in (0, 1].
    rate : float
        How soon it falls, at least 0.
    power : float
        How it falls, at least 0.
    floor : float
        It stays at or above this, at most first.
    per_step : bool
        Count steps instead of episodes, for epsilon.

    Returns
    -------
    Schedule
        What alpha and epsilon may be.

    Notes
    -----
    Ledger: om-convergence-conditions.

    Examples
    --------
    >>> from rlcore import decaying
    >>> decaying(1.0, power=0.8, floor=0.01)
    Schedule(first=1.0, rate=1.0, power=0.8, floor=0.01, per_step=False)
    """
    return Schedule(first, rate, power, floor, per_step)


def constant(value: float) -> Schedule:
    """The Schedule that never falls."""
    return Schedule(float(value), 0.0, 0.0, 0.0, False)


def check_schedule(name: str, value: Any, given: Given | None = None) -> Schedule:
    """value as a Schedule; a number is one that never falls. ValueError unless it is in (0, 1], or 0 for epsilon."""
    if isinstance(value, Schedule):
        return value
    if not (is_number(value) and (0 < value <= 1 or (name == "epsilon" and value == 0))):
        allowed = "[0, 1]" if name == "epsilon" else "(0, 1]"
        raise ValueError(f"{name}: got {show(value)}, must be in {allowed} or decaying(...)")
    return constant(value)


@part
def at(schedule: Schedule, n: int) -> float:
    """Value of a schedule after n."""
    if schedule.rate == 0.0:
        return schedule.first
    return max(schedule.floor, schedule.first / (1.0 + schedule.rate * n) ** schedule.power)


@part
def now(schedule: Schedule, n_episodes: int, n_steps: int) -> float:
    """Value of an exploration rate after so many finished episodes and so many steps."""
    return at(schedule, n_steps if schedule.per_step else n_episodes)
