"""Where experience comes from: the same loop on a FiniteMDP, compiled, or on a gymnasium environment, interpreted."""

import types
from collections import namedtuple

import numpy as np

from rlcore.bellman import _reaches, policy_matrix
from rlcore.compiled import compiled
from rlcore.mdp import FiniteMDP, check_count, draw, is_number, step

FOREVER = np.iinfo(np.int64).max


@compiled
def reset(world, rng):
    """First state of an episode."""
    return draw(world.start_cdf, rng)


@compiled
def act(world, s, a, rng):
    """(s', r, terminated, truncated) of one step. A FiniteMDP truncates nothing: the loops count max_steps."""
    s_next, r = step(world, s, a, rng)
    return s_next, r, world.terminal[s_next], False


@compiled
def books(table, n_episodes, record):
    """history with table as its first row, and returns and lengths of the episodes to come, all 0."""
    n_kept = 1 + (n_episodes // record if record else 0)
    history = np.zeros((n_kept, *table.shape))
    history[0] = table
    return history, np.zeros(n_episodes), np.zeros(n_episodes, np.int64)


def _reset_env(env, rng):
    return int(env.reset()[0])


def _act_env(env, s, a, rng):
    s_next, r, terminated, truncated, _ = env.step(int(a))
    return int(s_next), float(r), bool(terminated), bool(truncated)


def run_loop(loop, world, *args, rng):
    """loop(world, *args, rng) on a FiniteMDP; where world is an environment, the same body with its reset and step.

    The environment draws from `rng`, too, so that MDPEnv(mdp) gives what mdp gives, bit by bit.
    """
    if isinstance(world, FiniteMDP):
        return loop(world.sampler(), *args, rng)
    world.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    world.unwrapped.np_random = rng
    body = getattr(loop, "__wrapped__", loop)
    names = body.__globals__ | {"reset": _reset_env, "act": _act_env}
    return types.FunctionType(body.__code__, names, body.__name__, body.__defaults__)(world, *args, rng)


def spaces(world):
    """(legal, terminal) of a world, (S, A) and (S,) bool; every action is legal and no state known to be terminal in an
    environment that is not an MDPEnv.

    Raises ValueError unless world is a FiniteMDP or a gymnasium.Env whose observations and actions are Discrete.
    """
    model = world if isinstance(world, FiniteMDP) else getattr(getattr(world, "unwrapped", None), "mdp", None)
    if isinstance(model, FiniteMDP):
        return model.legal, model.terminal
    sizes = [getattr(getattr(world, f"{name}_space", None), "n", None) for name in ("observation", "action")]
    if None in sizes:
        kind = type(world).__name__
        raise ValueError(
            f"world: got {kind}, must be a FiniteMDP or a gymnasium.Env with Discrete observations and actions"
        )
    return np.ones(sizes, bool), np.zeros(sizes[0], bool)


def check_max_steps(world, max_steps, pi=None):
    """max_steps as an integer; None, for no limit, is refused where an episode under pi may never end."""
    if max_steps is not None:
        return check_count("max_steps", max_steps)
    if isinstance(world, FiniteMDP) and pi is not None and not _ends(world, pi):
        raise ValueError("max_steps: got None, must be a number because some episode under pi never ends")
    return FOREVER


def _ends(mdp, pi):
    """Whether every state that pi can meet leads to a terminal one; walled-off cells do not matter."""
    P, _ = policy_matrix(mdp, pi)
    return bool((_reaches(P, mdp.terminal) | ~_reaches(P.T, mdp.start > 0)).all())


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
