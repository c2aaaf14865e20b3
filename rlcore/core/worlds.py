"""Where experience comes from: the same loop on a FiniteMDP, compiled, or on a gymnasium environment, interpreted."""

from __future__ import annotations

import types
from collections.abc import Callable
from typing import Any

import numpy as np

from rlcore.core.chains import ends
from rlcore.core.checks import Model, check_count, show, spaces
from rlcore.core.compiled import HAVE_NUMBA, compiled
from rlcore.core.extras import extra
from rlcore.core.rules import takes_none
from rlcore.core.sampling import draw, step
from rlcore.core.types import Floats, Given, Ints, Rng, World

FOREVER = np.iinfo(np.int64).max


@compiled
def reset(world: Any, rng: Rng) -> int:
    """First state of an episode."""
    return draw(world.start_cdf, rng)


@compiled
def act(world: Any, s: int, a: int, rng: Rng) -> tuple[int, float, bool, bool]:
    """(s', r, terminated, truncated) of one step. A FiniteMDP truncates nothing: the loops count max_steps."""
    s_next, r = step(world, s, a, rng)
    return s_next, r, world.terminal[s_next], False


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


def _reset_env(env, rng):
    return int(env.reset()[0])


def _act_env(env, s, a, rng):
    s_next, r, terminated, truncated, _ = env.step(int(a))
    return int(s_next), float(r), bool(terminated), bool(truncated)


def run_loop(loop: Callable[..., Any], world: World, *args: Any, rng: Rng) -> Any:
    """loop(world, *args, rng) on a FiniteMDP; where world is an environment, the same body with its reset and step.

    The environment draws from `rng`, too, so that MDPEnv(mdp) gives what mdp gives, bit by bit.
    """
    if isinstance(world, Model):
        return (loop if HAVE_NUMBA else _interpreted(loop))(world.sampler(), *args, rng)
    world.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    world.unwrapped.np_random = rng
    return _interpreted(loop, reset=_reset_env, act=_act_env)(world, *args, rng)


def _interpreted(loop, **changes):
    """The Python body of a compiled function, and of those that act for it, with other globals, formulas unchecked."""
    body = getattr(loop, "__wrapped__", None) or getattr(loop, "py_func", loop)
    names = body.__globals__ | changes
    for name in names.keys() & set(body.__code__.co_names):
        formula = getattr(names[name], "unchecked", None)
        if formula is not None or name in RECORDERS:
            names[name] = _interpreted(formula or names[name], **changes)
    return types.FunctionType(body.__code__, names, body.__name__, body.__defaults__)


RECORDERS = {"episode", "softmax_episode"}  # compiled functions that act in the world, called by learners


def open_world(name: str, world: Any, given: Given | None = None) -> Any:
    """world; an id is made an environment. ValueError where there is none of that name."""
    if not isinstance(world, str):
        return world
    with extra("gym"):
        import gymnasium as gym

    try:
        return gym.make(world, disable_env_checker=True)
    except gym.error.Error as error:
        message = f"{name}: got {show(world)}, must be a FiniteMDP, an environment or its id ({error})"
        raise ValueError(message) from None


def tabular_world(name: str, world: Any, given: Given) -> Any:
    """The rule of a world whose states and actions are numbered."""
    world = open_world(name, world)
    spaces(world)
    return world


@takes_none
def step_limit(name: str, max_steps: Any, given: Given) -> int:
    """The rule of max_steps: None, for no limit, is refused where an episode may never end."""
    if max_steps is not None:
        return check_count(name, max_steps)
    world, pi = given["world"], given.get("pi")
    if isinstance(world, Model):
        pi = world.legal / world.legal.sum(axis=1, keepdims=True) if pi is None else pi
        if not ends(world, pi):
            raise ValueError(f"{name}: got None, must be a number because some episode under pi never ends")
    return FOREVER
