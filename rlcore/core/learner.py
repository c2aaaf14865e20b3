"""One function an algorithm: `learner` checks its arguments, compiles its source, and runs it in any tabular world."""

from __future__ import annotations

import functools
import types
from collections.abc import Callable
from typing import Any

import numpy as np

from rlcore.core.compiled import compiled
from rlcore.core.results import Run
from rlcore.core.rules import checker, count
from rlcore.core.sampling import cumulative
from rlcore.core.schedules import check_schedule
from rlcore.core.types import F, Floats, Given, Ints, Rule
from rlcore.core.worlds import run_loop, step_limit, tabular_world

LEARNERS = dict(
    world=tabular_world, alpha=check_schedule, epsilon=check_schedule, max_steps=step_limit, record=count(0)
)


def learner(result: Callable[..., Any], **special: Rule) -> Callable[[F], F]:
    """The function, called as it stands: arguments checked by name, its body compiled where there is numba.

    The body sees what the rules return: a policy as cumulative probabilities, a schedule for a step size, a table for a
    first estimate. It starts with `world` and ends with `rng`; on a FiniteMDP it runs compiled, on a
    gymnasium.Env (or its id) interpreted, with the same bits. What it returns, result(given, *found) makes a Run of.
    """

    def decorate(function):
        check, loop = checker(function, LEARNERS | special), compiled(_positional(function))

        @functools.wraps(function)
        def call(*args, **kwargs):
            given = check(*args, **kwargs)
            inputs = [
                cumulative(value) if name == "pi" and value is not None else value
                for name, value in given.items()
                if name not in ("world", "rng")
            ]
            return result(given, *run_loop(loop, given["world"], *inputs, rng=given["rng"]))

        call.loop = loop
        return call

    return decorate


def _positional(function):
    """The same body with positional arguments only, which is all that numba takes."""
    code = function.__code__
    code = code.replace(co_argcount=code.co_argcount + code.co_kwonlyargcount, co_kwonlyargcount=0)
    flat = types.FunctionType(code, function.__globals__, function.__name__)
    flat.__qualname__, flat.__module__ = function.__qualname__, function.__module__
    return flat


@compiled
def log(table: Floats, n_episodes: int, record: int) -> tuple[Floats, Ints, Floats]:
    """returns and lengths of the episodes to come, all 0, and a history with table as its first row."""
    history = np.zeros((1 + (n_episodes // record if record else 0), *table.shape))
    history[0] = table
    return np.zeros(n_episodes), np.zeros(n_episodes, np.int64), history


@compiled
def note(history: Floats, table: Floats, k: int, record: int) -> None:
    """Keep the table after episode k, where it is one of those that are kept."""
    if record and (k + 1) % record == 0:
        history[(k + 1) // record] = table


def prediction(
    given: Given, V: Floats, returns: Floats, lengths: Ints, history: Floats, visits: Ints | None = None
) -> Run:
    """The Run of a loop that learned v_pi."""
    history = history if given["record"] else None
    return Run(returns, lengths, V=V, policy=given["pi"], history=history, visits=visits)
