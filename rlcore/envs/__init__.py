"""The document's worlds as FiniteMDPs, and MDPEnv, which shows any of them as a gymnasium environment."""

from rlcore.envs.cartpole import *  # noqa: F403
from rlcore.envs.games import *  # noqa: F403
from rlcore.envs.golf import *  # noqa: F403
from rlcore.envs.grids import *  # noqa: F403
from rlcore.envs.meter import *  # noqa: F403
from rlcore.envs.poker import *  # noqa: F403
from rlcore.envs.robots import *  # noqa: F403
from rlcore.envs.small import *  # noqa: F403


def __getattr__(name):
    if name == "MDPEnv":  # gymnasium takes 0.3 s to import: only who asks for it pays
        from rlcore.envs.gym import MDPEnv

        return MDPEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
