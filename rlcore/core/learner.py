"""One function an algorithm: `learner` checks its arguments, compiles its source, and runs it in any tabular world."""

from __future__ import annotations

import functools
import types
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rlcore.core.checks import Model
from rlcore.core.compiled import HAVE_NUMBA, alone, compiled, part
from rlcore.core.results import Run
from rlcore.core.rules import checker, count, sized
from rlcore.core.running import ENOUGH, LOST, STOPPED, Interrupted, Watch, watched
from rlcore.core.sampling import cumulative, step
from rlcore.core.schedules import check_schedule
from rlcore.core.types import F, Floats, Given, Ints, OnEpisode, Rng, Rule, World
from rlcore.core.worlds import Guard, lent, say_cut, step_limit, tabular_world

LEARNERS = dict(
    world=tabular_world,
    alpha=check_schedule,
    epsilon=check_schedule,
    max_steps=step_limit,
    record=count(0),
    n_episodes=sized(),
)


def learner(result: Callable[..., Any], **special: Rule) -> Callable[[F], F]:
    """The function, called as it stands: arguments checked by name, its body compiled where there is numba.

    The body sees what the rules return: a policy as cumulative probabilities, a schedule for a step size, a table for a
    first estimate. It starts with `world` and ends with `rng`; on a FiniteMDP it runs compiled, on a
    gymnasium.Env (or its id) interpreted, with the same bits. What it returns, result(given, *found) makes a Run of.
    on_episode is called by an interpreted loop in place of the body, which does not see it.
    """

    def decorate(function):
        check, loop = checker(function, LEARNERS | special), compiled(_positional(function))

        @functools.wraps(function)
        def call(*args, **kwargs):
            given = check(*args, **kwargs)
            inputs = given | {"on_episode": None} if "on_episode" in given else given  # compiled loops call nobody
            inputs = [
                cumulative(value) if name == "pi" and value is not None else value
                for name, value in inputs.items()
                if name not in ("world", "rng")
            ]
            told = dict(n=given.get("n_episodes", 0), on_episode=given.get("on_episode"))
            first = _first(given)
            try:
                found, (why, ended), reward = run_loop(loop, given["world"], *inputs, rng=given["rng"], **told)
            except MemoryError:
                raise MemoryError(_too_much(given)) from None
            lost = not (found[0] < np.inf).all()
            if why == LOST or (lost and "epsilon" in given):  # no action is the best one
                raise ValueError(_lost(given, found, ended))
            if lost:  # how large a step size may be is a question, too
                warnings.warn(_lost(given, found, ended), RuntimeWarning, stacklevel=2)
            made = result(given, *found)
            if first is not None and (grown := _grown(given, made, first, reward)):
                warnings.warn(grown, RuntimeWarning, stacklevel=2)
            if isinstance(made, Run) and "max_steps" in given:
                say_cut(made.lengths, given["max_steps"])
            made = shorter(made, given, interrupted=why == STOPPED) if why and isinstance(made, Run) else made
            if why == STOPPED:
                raise Interrupted(made)
            return made

        call.loop = loop
        return call

    return decorate


def _too_much(given):
    """What to say where results do not fit into the memory."""
    counts = {name: given[name] for name in ("n_episodes", "record", "max_steps", "n_steps") if name in given}
    return f"{', '.join(counts)}: got {', '.join(map(str, counts.values()))}, must keep less: memory is full"


def _lost(given, found, ended):
    """What to say where estimates are no numbers any more; ended: how many episodes have."""
    lengths = next((x for x in found[1:] if getattr(x, "dtype", None) == np.int64 and x.ndim == 1), None)
    place = "" if lengths is None else f" in episode {ended}, step {lengths[max(ended - 1, 0)]} or before"
    name = next((name for name in ("alpha", "alpha_w") if name in given), None)
    if name is None:
        return f"world: its rewards must be smaller, as their sum is no finite number any more{place}"
    return f"{name}: got {given[name].first}, must be smaller: estimates are no finite numbers any more{place}"


def _size(table):
    return np.abs(table, where=np.isfinite(table), out=np.zeros(np.shape(table))).max()


def _first(given):
    """Size of the first estimates, before the loop writes there; None where estimates stay between targets."""
    if "alpha_w" in given:
        return _size(given["features"][0] @ given["w0"])
    return _size(given.get("Q0", given.get("V0"))) if "lam" in given else None


def _grown(given, run, first, reward):
    """What to say where estimates are many times what any return can be, "" where they are not."""
    table, gamma, world = run.V if run.Q is None else run.Q, given["gamma"], given["world"]
    if table is None or (size := _size(table)) <= 1e3:
        return ""
    reward = _size(world.reward) if isinstance(world, Model) else reward
    limit = max(first, reward / (1 - gamma) if gamma < 1 else first + reward * run.lengths.sum())
    if size <= 10 * limit:
        return ""
    name = "alpha_w" if "alpha_w" in given else "alpha"
    must = f"must be smaller: an estimate is {size:.3g}, and no return is beyond {limit:.3g}"
    return f"{name}: got {given[name].first}, {must}"


def shorter(run: Run, given: Given, *, interrupted: bool) -> Run:
    """The Run of the episodes that were begun, where it was to have more of them."""
    n, record = np.count_nonzero(run.lengths), given["record"]
    history = None if run.history is None else run.history[: 1 + n // record]
    return replace(run, returns=run.returns[:n], lengths=run.lengths[:n], history=history, interrupted=interrupted)


def _positional(function):
    """The same body with positional arguments only, which is all that numba takes."""
    code = function.__code__
    code = code.replace(co_argcount=code.co_argcount + code.co_kwonlyargcount, co_kwonlyargcount=0)
    flat = types.FunctionType(code, function.__globals__, function.__name__)
    flat.__qualname__, flat.__module__ = function.__qualname__, function.__module__
    return alone(flat)


@part
def keep(row: Floats, table: Floats) -> None:
    """row[...] = table, number by number: numba compiles a fourth of a second, not 5 s."""
    new, old = row.reshape(-1), table.reshape(-1)
    for i in range(old.size):
        new[i] = old[i]


@part
def log(table: Floats, n_episodes: int, record: int) -> tuple[Floats, Ints, Floats]:
    """returns and lengths of the episodes to come, all 0, and a history with table as its first row."""
    history = np.zeros((1 + (n_episodes // record if record else 0), *table.shape))
    keep(history[0], table)
    return np.zeros(n_episodes), np.zeros(n_episodes, np.int64), history


@part
def note(world: Any, history: Floats, table: Floats, k: int, record: int) -> bool:
    """Keep the table after episode k, where it is one of those that are kept. True: this was the last episode.

    That is so where the run was stopped, or where the table holds what is no number, which is looked at now and then.
    """
    if record and (k + 1) % record == 0:
        keep(history[(k + 1) // record], table)
    world.marks[1] = k + 1
    if k % 64 == 63:
        flat = table.reshape(-1)
        first = k // 64 * 256 % flat.size
        for i in range(first, min(first + 256, flat.size)):
            if not flat[i] < np.inf:
                world.marks[0] = LOST
    return world.marks[0] != 0


# ---------------------------------------------------------------------- where it runs


def run_loop(
    loop: Callable[..., Any], world: World, *args: Any, rng: Rng, n: int = 0, on_episode: OnEpisode | None = None
) -> Any:
    """loop(world, *args, rng) on a FiniteMDP; on an environment, the same body with its steps. With it the marks of its
    Watch, and the size of the largest reward, where an environment gave it.

    The environment draws from `rng`, too, so that MDPEnv(mdp) gives what mdp gives, bit by bit. n: episodes, for a bar.
    """
    watch = Watch(n)
    with watched(watch):
        if isinstance(world, Model):
            sampler = world.sampler()._replace(marks=watch.marks)
            watch.terminal = sampler.terminal
            if on_episode is not None or not HAVE_NUMBA:
                told = _Told(watch, on_episode)
                loop = interpreted(loop, log=told.log, note=told.note, act=_acting(watch))
            return loop(sampler, *args, rng), watch.marks.tolist(), 0.0
        with lent(world, rng):
            guard, told = Guard(world, seed=int(rng.spawn(1)[0].integers(2**31))), _Told(watch, on_episode)
            world.unwrapped.np_random = rng
            changes = dict(log=told.log, note=told.note, reset=lambda env, rng: guard.reset(), act=guard.acting(watch))
            return interpreted(loop, **changes)(world, *args, rng), watch.marks.tolist(), guard.largest


def _acting(watch):
    """`act` on a FiniteMDP for an interpreted loop: with Python's own flags a step is a fourth quicker."""
    take, ends = interpreted(step), (watch.terminal == 1).tolist()

    def act(world, s, a, rng):
        s_next, r = take(world, s, a, rng)
        return s_next, r, ends[s_next], watch.asked

    return act


class _Told:
    """What an interpreted loop calls for log and note: it tells on_episode, and the bar, how far it is."""

    def __init__(self, watch, on_episode):
        self.watch, self.on_episode, self.steps = watch, on_episode, 0

    def log(self, table, n_episodes, record):
        found = log(table, n_episodes, record)
        self.returns, self.lengths, _ = found
        return found

    def note(self, world, history, table, k, record):
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = table
        self.watch.marks[1] = k + 1
        if k % 16 == 15 and not (table < np.inf).all():
            self.watch.stop(LOST)
        elif self.on_episode is not None:
            self.steps += int(self.lengths[k])
            if self.on_episode(float(self.returns[k]), self.steps):
                self.watch.stop(ENOUGH)
        return bool(self.watch.marks[0])


def interpreted(loop: Callable[..., Any], **changes: Any) -> Callable[..., Any]:
    """The Python body of a compiled function with other globals, formulas unchecked.

    So are those that it calls with a generator or a schedule, which numba takes 1 to 7 us to unpack.
    """
    body = _body(loop)
    names = body.__globals__ | changes
    for name in (names.keys() & set(body.__code__.co_names)) - changes.keys():
        formula = getattr(names[name], "unchecked", None)
        if formula is not None or {"rng", "schedule"} & set(_arguments(names[name])):
            names[name] = interpreted(formula or names[name], **changes)
    return types.FunctionType(body.__code__, names, body.__name__, body.__defaults__)


def _body(function):
    return getattr(function, "__wrapped__", None) or getattr(function, "py_func", function)


def _arguments(function):
    code = getattr(_body(function), "__code__", None)
    return code.co_varnames[: code.co_argcount] if code else ()


# ---------------------------------------------------------------------- what it leaves


def prediction(
    given: Given, V: Floats, returns: Floats, lengths: Ints, history: Floats, visits: Ints | None = None
) -> Run:
    """The Run of a loop that learned v_pi."""
    history = history if given["record"] else None
    return Run(returns, lengths, V=V, policy=given["pi"], history=history, visits=visits)
