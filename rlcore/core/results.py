"""What algorithms return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.checks import Model


@dataclass(frozen=True, eq=False)
class Solution:
    """Values and policy that planning found.

    Parameters
    ----------
    V : np.ndarray
        (S,), the values.
    Q : np.ndarray
        (S, A), -inf where a is not in A(s).
    pi : np.ndarray
        (S, A), the policy.
    n_iter : int
        Sweeps or iterations done.
    converged : bool
        Whether the stopping rule was met before max_iter.
    bound : float
        The sup-norm error of V is at most this, rounding included; inf where nothing can be certified.
    history : np.ndarray | None
        (n_iter + 1, S), V_0 first; None where the method keeps none.

    Examples
    --------
    >>> from rlcore import solve
    >>> from rlcore.core.results import Solution
    >>> from rlcore.envs.small import zero_loop
    >>> solve(zero_loop(), 0.9).V
    array([1., 0.])
    """

    V: np.ndarray
    Q: np.ndarray
    pi: np.ndarray
    n_iter: int
    converged: bool
    bound: float
    history: np.ndarray | None


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """What a learning run leaves behind; what is not estimated or not kept is None.

    Parameters
    ----------
    returns : np.ndarray
        (n_episodes,), undiscounted sum of the rewards of each episode.
    lengths : np.ndarray
        (n_episodes,), number of steps of each episode.
    V : Any
        (S,), or the critic.
    Q : np.ndarray | None
        (S, A), -inf where a is not in A(s).
    policy : Any
        What one acts with, (S, A) or a network.
    history : np.ndarray | None
        The estimates before the first and after each record-th episode, where `record` asks for them.
    visits : np.ndarray | None
        Updates of each state (S,) or pair (S, A).
    weights : np.ndarray | None
        theta of a linear policy, (A, d).
    interrupted : bool
        Whether Ctrl-C ended it before its time.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import td0
    >>> from rlcore.core.results import Run
    >>> from rlcore.envs.small import random_walk
    >>> td0(random_walk(3), np.ones((5, 1)), 1.0, 2, alpha=0.1, rng=np.random.default_rng(0))
    Run(2 episodes, 6 steps, V (5,), policy (5, 1), visits (5,))
    """

    returns: np.ndarray
    lengths: np.ndarray
    V: Any = None
    Q: np.ndarray | None = None
    policy: Any = None
    history: np.ndarray | None = None
    visits: np.ndarray | None = None
    weights: np.ndarray | None = None
    interrupted: bool = False

    def __repr__(self) -> str:
        size = f"{self.returns.size} episodes, {self.lengths.sum():,} steps"
        told = ("returns", "lengths", "interrupted")
        held = {name: value for name, value in vars(self).items() if value is not None and name not in told}
        held = [f"{k} {getattr(v, 'shape', type(v).__name__)}" for k, v in held.items()]
        return f"{type(self).__name__}({', '.join([size, *held, *['interrupted'] * self.interrupted])})"


@dataclass(frozen=True, eq=False, repr=False)
class PlanningRun(Run):
    """A Run that keeps the model it learned, so that it can answer `predict`. ex-prediction-test"""

    model: Model | None = None


@dataclass(frozen=True, eq=False, repr=False)
class WatkinsRun(Run):
    """A Run that keeps `cuts`: over how many steps the traces had grown whenever an exploratory action cut them."""

    cuts: np.ndarray | None = None
