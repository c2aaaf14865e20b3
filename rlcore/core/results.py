"""What algorithms return."""

from dataclasses import dataclass

import numpy as np

from rlcore.mdp import FiniteMDP


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


@dataclass(frozen=True, eq=False)
class Run:
    """What a learning run leaves behind; what is not estimated is None.

    returns, lengths: (n_episodes,), undiscounted sum of rewards and number of steps of each episode. V: (S,).
    Q, policy: (S, A). history: (n_episodes + 1, ...), the estimates before the first and after each episode.
    """

    returns: np.ndarray
    lengths: np.ndarray
    V: np.ndarray | None = None
    Q: np.ndarray | None = None
    policy: np.ndarray | None = None
    history: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PlanningRun(Run):
    """A Run that keeps the model it learned, so that it can answer `predict`. ex-prediction-test"""

    model: FiniteMDP | None = None


@dataclass(frozen=True, eq=False)
class WatkinsRun(Run):
    """A Run that keeps `cuts`: over how many steps the traces had grown whenever an exploratory action cut them."""

    cuts: np.ndarray | None = None
