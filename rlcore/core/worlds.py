"""Where experience comes from: the same loop on a FiniteMDP, compiled, or on a gymnasium environment, interpreted."""

import types

import numpy as np

from rlcore.bellman import policy_matrix, reaches
from rlcore.core.checks import check_count, check_gamma, check_pi, check_rng, check_v0
from rlcore.core.compiled import compiled
from rlcore.core.results import Run
from rlcore.core.sampling import draw, step
from rlcore.mdp import FiniteMDP

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
    return bool((reaches(P, mdp.terminal) | ~reaches(P.T, mdp.start > 0)).all())


# ---------------------------------------------------------------------- what the learners share


def check_prediction(world, pi, gamma, n_episodes, V0, max_steps, record, rng):
    """pi, gamma, n_episodes, V, max_steps, record as loops take them."""
    (legal, terminal), gamma, n_episodes = spaces(world), check_gamma(gamma), check_count("n_episodes", n_episodes)
    pi, V, record, _ = check_pi(legal, pi), check_v0(terminal, V0), check_count("record", record, 0), check_rng(rng)
    return pi, gamma, n_episodes, V, check_max_steps(world, max_steps, pi), record


def value_run(found, pi, record):
    """The Run of a loop that learned v_pi."""
    returns, lengths, V, history = found
    return Run(returns, lengths, V=V, policy=pi, history=history if record else None)
