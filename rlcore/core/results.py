"""What algorithms return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.checks import Model


@dataclass(frozen=True, eq=False)
class Solution:
    """Values and policy that planning found.

    V: (S,). Q: (S, A), -inf for actions that a state does not have. pi: (S, A). n_iter: sweeps or iterations done.
    converged: whether the stopping rule was met before max_iter. bound: the sup-norm error of V is at most this,
    rounding included; inf where nothing can be certified. history: (n_iter + 1, S), V_0 first; None where the
    method keeps none.
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

    returns, lengths: (n_episodes,), undiscounted sum of rewards and number of steps of each episode. V: (S,), or the
    critic. Q: (S, A). policy: what one acts with, (S, A) or a network. history: the estimates before the first and
    after each record-th episode, where `record` asks for them. visits: updates of each state (S,) or pair (S, A).
    weights: theta of a linear policy, (A, d). interrupted: whether Ctrl-C ended it before its time.
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
