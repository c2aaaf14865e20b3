"""The document's worlds as FiniteMDPs; as gymnasium environments, any of them (MDPEnv), and Catch from pixels."""

from rlcore.envs.cartpole import *  # noqa: F403
from rlcore.envs.catch import *  # noqa: F403
from rlcore.envs.games import *  # noqa: F403
from rlcore.envs.golf import *  # noqa: F403
from rlcore.envs.grids import *  # noqa: F403
from rlcore.envs.meter import *  # noqa: F403
from rlcore.envs.robots import *  # noqa: F403
from rlcore.envs.small import *  # noqa: F403

ENVIRONMENTS = ("Catch", "MDPEnv")


def __getattr__(name):
    if name in ENVIRONMENTS:  # gymnasium takes 0.3 s to import: only who asks for it pays
        from rlcore.envs import gym

        return getattr(gym, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
