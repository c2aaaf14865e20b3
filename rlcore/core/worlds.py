"""Where experience comes from: the same loop on a FiniteMDP, compiled, or on a gymnasium environment, interpreted."""

from __future__ import annotations

import operator
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import numpy as np

from rlcore.core.chains import ends
from rlcore.core.checks import HUGE, Model, check_count, is_discrete, show, spaces
from rlcore.core.compiled import compiled, part
from rlcore.core.extras import extra
from rlcore.core.rules import takes_none
from rlcore.core.running import CUT, LOST, Watch
from rlcore.core.samples import all_finite
from rlcore.core.sampling import draw, step
from rlcore.core.types import Floats, Given, Ints, Rng

MOST_STEPS = 1_000_000  # of an episode, where max_steps is None


@part
def reset(world: Any, rng: Rng) -> int:
    """First state of an episode."""
    return draw(world.start_cdf, rng)


@part
def act(world: Any, s: int, a: int, rng: Rng) -> tuple[int, float, bool, bool]:
    """(s', r, terminated, truncated) of one step. A FiniteMDP truncates where the run is stopped.

    One number says both: a second array to look into costs 3 % of a step.
    """
    s_next, r = step(world, s, a, rng)
    end = world.terminal[s_next]
    return s_next, r, end == 1, end == CUT


@compiled
def episode(world: Any, pi_cdf: Floats, max_steps: int, rng: Rng) -> tuple[Ints, Ints, Floats, bool]:
    """One episode under pi: states (T + 1,), actions (T,), rewards (T,), and whether its last state is terminal."""
    states, actions, rewards = np.empty(257, np.int64), np.empty(256, np.int64), np.empty(256)
    s, t, done, terminated = reset(world, rng), 0, False, False
    states[0] = s
    while not done:
        if t == rewards.size:
            states, actions, rewards = (
                np.append(states, states),
                np.append(actions, actions),
                np.append(rewards, rewards),
            )
        actions[t] = draw(pi_cdf[s], rng)
        s, rewards[t], terminated, truncated = act(world, s, actions[t], rng)
        t += 1
        states[t] = s
        done = terminated or truncated or t == max_steps
    return states[: t + 1], actions[:t], rewards[:t], terminated


@compiled
def total(rewards: Floats) -> float:
    """The sum of an episode's rewards, in their order."""
    G = 0.0
    for r in rewards:
        G += r
    return G


# ---------------------------------------------------------------------- environments


class Guard:
    """An environment, each of its answers looked at before anything learns from it; states are counted from 0.

    reset() gives an observation; step(a) an observation, a reward and whether the episode was terminated or truncated.
    Observations are ints where the space is Discrete, else arrays of numbers of the space's shape. What an environment
    must not answer is a ValueError, an error of its own is passed on, both with the episode and the step.
    """

    def __init__(self, env: Any, seed: int | None = None) -> None:
        self.env, self.episode, self.t, self.largest = env, 0, 0, 0.0
        self._step, space, actions = env.step, env.observation_space, env.action_space
        self._first_action = int(getattr(actions, "start", 0)) if is_discrete(actions) else None
        self._see = self._discrete if is_discrete(space) else self._vector
        self._shape, self._dtype = getattr(space, "shape", None), getattr(space, "dtype", None)
        self._first, self._n = (int(getattr(space, "start", 0)), int(space.n)) if is_discrete(space) else (0, 0)
        if seed is not None:  # of what it draws from; the first episode is yet to begin
            self.reset(seed=seed)
            self.episode = 0

    def reset(self, **options: Any) -> Any:
        self.episode, self.t = self.episode + 1, 0
        found = self._asked(self.env.reset, "reset", **options)
        if not (isinstance(found, tuple) and len(found) == 2 and isinstance(found[1], dict)):
            self._complain(f"reset gave {show(found)}", "(observation, info); without info it is the old API of gym")
        return self._see(found[0])

    def step(self, a: Any) -> tuple[Any, float, bool, bool]:
        self.t += 1
        try:
            answer = self._step(np.asarray(a) if self._first_action is None else int(a) + self._first_action)
        except Exception as error:
            self._pass_on(error)
        return self._look(answer)

    def acting(self, watch: Watch) -> Callable[..., tuple[int, float, bool, bool]]:
        """step for the loops of tables, in place of `act`: what is plainly right passes at once, the rest is looked at.

        The episode is cut where watch asks to stop, and where no action is the best one: estimates are no numbers then.
        largest: the size of the largest reward.
        """
        step, first, n = self._step, self._first_action, 0 if self._first else self._n
        least, most, low, high = 0.0, 0.0, 0, 0  # of rewards so far; in whole numbers, which compare quickly

        def act(world, s, a, rng):
            nonlocal least, most, low, high
            if a < 0:
                watch.stop(LOST)
                return s, 0.0, False, True
            self.t += 1
            try:
                answer = step((a if type(a) is int else int(a)) + first)
            except Exception as error:
                self._pass_on(error)
            if type(answer) is tuple and len(answer) == 5:
                s_next, r, terminated, truncated, _ = answer
                if type(r) is int and low <= r <= high:
                    r = float(r)
                if (
                    type(s_next) is int and 0 <= s_next < n and type(r) is float and least <= r <= most
                    and (terminated is False or terminated is True) and (truncated is False or truncated is True)
                ):  # fmt: skip
                    return s_next, r, terminated, truncated or watch.asked
            s_next, r, terminated, truncated = self._look(answer)
            most = self.largest = max(most, abs(r))
            least, low, high = -most, -int(most), int(most)
            return s_next, r, terminated, truncated or watch.asked

        return act

    def _look(self, answer):
        if not isinstance(answer, tuple) or len(answer) != 5:
            self._complain_of_size(answer)
        s, r, terminated, truncated, _ = answer
        if type(r) is not float or not -HUGE <= r <= HUGE:
            r = self._number(r)
        if type(terminated) is not bool:
            terminated = self._flag("terminated", terminated)
        if type(truncated) is not bool:
            truncated = self._flag("truncated", truncated)
        return self._see(s), r, terminated, truncated

    def _pass_on(self, error: Exception) -> NoReturn:
        error.add_note(f"in the step of the environment, {self._place()}")
        raise error

    def _asked(self, call, what, **options):
        try:
            return call(**options)
        except Exception as error:
            error.add_note(f"in the {what} of the environment, {self._place()}")
            raise

    def _discrete(self, s):
        if type(s) is not int:
            try:
                s = operator.index(s)
            except TypeError:
                self._complain(f"observation {show(s)}", f"a whole number, as {self.env.observation_space} says")
        s -= self._first
        if not 0 <= s < self._n:
            self._complain(f"observation {s + self._first}", f"in {self.env.observation_space}")
        return s

    def _vector(self, s):
        if type(s) is not np.ndarray or s.dtype.kind != "f":
            s = self._numbers(s)
        if s.shape != self._shape:
            self._complain(f"an observation of shape {s.shape}", f"of shape {self._shape}, as the space says")
        if not all_finite(s):
            self._complain(f"observation {show(s)}", "finite")
        return s

    def _numbers(self, s):
        found = _as_array(s)
        if found.dtype.kind not in "biuf":
            self._complain(f"observation {show(s)}", "numbers")
        return found.astype(self._dtype if np.dtype(self._dtype).kind == "f" else float)

    def _number(self, r):
        found = _as_array(r if isinstance(r, (int, float, np.ndarray, np.generic, list, tuple)) else None)
        if found.shape not in ((), (1,)) or found.dtype.kind not in "biuf":
            self._complain(f"reward {show(r)}", "a number")
        r = float(found.reshape(()))
        if not -HUGE <= r <= HUGE:
            self._complain(f"reward {r}", "a finite number")
        return r

    def _flag(self, name, value):
        found = _as_array(value)
        if found.shape not in ((), (1,)) or found.dtype.kind not in "biu" or found.reshape(()) not in (0, 1):
            self._complain(f"{name} {show(value)}", "True or False")
        return bool(found.reshape(()))

    def _place(self):
        return f"episode {self.episode}, step {self.t}"

    def _complain(self, what: str, must: str) -> NoReturn:
        raise ValueError(f"world: {what} in {self._place()}, must be {must}")

    def _complain_of_size(self, answer: Any) -> NoReturn:
        size = f"{len(answer)} values" if isinstance(answer, tuple) else show(answer)
        old = "; four are the old API of gym" if isinstance(answer, tuple) and len(answer) == 4 else ""
        self._complain(f"step gave {size}", f"(observation, reward, terminated, truncated, info){old}")


def _as_array(values):
    """values as an array; one of kind O where they are ragged."""
    try:
        return np.asarray(values)
    except ValueError:
        return np.array(None)


@contextmanager
def lent(env: Any, rng: Rng) -> Iterator[None]:
    """env draws from rng inside, and from what it drew from before afterwards."""
    inner = env.unwrapped
    names = ("_np_random", "_np_random_seed", "np_random")
    before = {name: vars(inner)[name] for name in names if name in vars(inner)}
    try:
        yield
    finally:
        for name in names:
            vars(inner).pop(name, None)
        vars(inner).update(before)


def open_world(name: str, world: Any, given: Given | None = None) -> Any:
    """world; an id is made an environment. ValueError where there is none of that name."""
    if not isinstance(world, str):
        return world
    with extra("gym"):
        import gymnasium as gym

    try:
        return gym.make(world, disable_env_checker=True)
    except (gym.error.Error, ImportError) as error:
        message = f"{name}: got {show(world)}, must be a FiniteMDP, an environment or its id ({error})"
        raise ValueError(message) from None


def tabular_world(name: str, world: Any, given: Given) -> Any:
    """The rule of a world whose states and actions are numbered."""
    world = open_world(name, world)
    spaces(world)
    return world


def say_cut(lengths: Ints | list[int], most: int, level: int = 3) -> None:
    """A RuntimeWarning where nobody gave a max_steps and an episode did not end by itself."""
    if most == MOST_STEPS and (cut := np.count_nonzero(np.asarray(lengths) == most)):
        message = f"max_steps: got None, and {cut} of {len(lengths)} episodes did not end in {most:,} steps: cut there"
        warnings.warn(message, RuntimeWarning, stacklevel=level)


@takes_none
def step_limit(name: str, max_steps: Any, given: Given) -> int:
    """The rule of max_steps: None is MOST_STEPS, and is refused where it is certain that an episode never ends."""
    if max_steps is not None:
        return check_count(name, max_steps)
    world, pi = given["world"], given.get("pi")
    if isinstance(world, Model):
        pi = world.legal / world.legal.sum(axis=1, keepdims=True) if pi is None else pi
        if not ends(world, pi):
            raise ValueError(f"{name}: got None, must be a number because some episode under pi never ends")
    return MOST_STEPS
