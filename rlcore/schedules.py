"""Step sizes and exploration rates that fall."""

from collections import namedtuple

import numpy as np

from rlcore.core.checks import is_number
from rlcore.core.compiled import compiled

# ---------------------------------------------------------------------- schedules


# first / (1 + rate n)^power after n visits (a step size), n episodes or n steps (epsilon)
Schedule = namedtuple("Schedule", "first rate power per_step")


def decaying(first, *, rate=1.0, power=1.0, per_step=False):
    """A step size or epsilon that falls: first / (1 + rate n)^power. om-convergence-conditions

    n counts the earlier updates of the same state or pair where it is a step size, so that decaying(1.0) is 1/N, the
    sample average; for epsilon, the finished episodes, or with per_step the steps taken.
    """
    if not is_number(first) or not 0 < first <= 1:
        raise ValueError(f"first: got {first!r}, must be in (0, 1]")
    if not (is_number(rate) and is_number(power) and 0 <= rate < np.inf and 0 <= power < np.inf):
        raise ValueError(f"rate, power: got {rate!r}, {power!r}, must be at least 0")
    return Schedule(float(first), float(rate), float(power), bool(per_step))


def check_schedule(name, value):
    """value as a Schedule; a number is one that never falls. ValueError unless it is in (0, 1], or 0 for epsilon."""
    if isinstance(value, Schedule):
        return value
    if not (is_number(value) and (0 < value <= 1 or (name == "epsilon" and value == 0))):
        raise ValueError(
            f"{name}: got {value!r}, must be in {'[0, 1]' if name == 'epsilon' else '(0, 1]'} or decaying(...)"
        )
    return Schedule(float(value), 0.0, 0.0, False)


@compiled
def at(schedule, n):
    """Value of a schedule after n."""
    return schedule.first if schedule.rate == 0.0 else schedule.first / (1.0 + schedule.rate * n) ** schedule.power
