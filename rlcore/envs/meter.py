"""A process that counts how often its model is read."""

from __future__ import annotations

from typing import Any

import numpy as np

from rlcore.core.rules import checked
from rlcore.mdp import FiniteMDP

__all__ = ["Metered"]


class Metered(FiniteMDP):
    """A FiniteMDP whose `queries` counts the rows p(., . | s, a) that were read.

    It stands in for the process in functions that are plain Python: heuristic_search, optimality_backup, q_from_v.

    Parameters
    ----------
    mdp : FiniteMDP
        The process it stands for.

    Notes
    -----
    Ledger: cl-021.

    Examples
    --------
    >>> from rlcore.bellman import optimality_backup
    >>> from rlcore.envs.meter import Metered
    >>> from rlcore.envs.small import two_state_mdp
    >>> mdp = Metered(two_state_mdp())
    >>> V, read = optimality_backup(mdp, [0.0, 0.0], 0.9), mdp.queries
    >>> V, read
    (array([0., 1.]), 4)
    """

    @checked
    def __init__(self, mdp: FiniteMDP) -> None:
        vars(self).update(vars(mdp), queries=0)  # the fields of a FiniteMDP are frozen

    @property
    def next_state(self) -> Any:  # type: ignore[override]
        return _Rows(vars(self))


class _Rows:
    """The array next_state; reading one pair counts 1, reading it whole counts every pair outside terminal states."""

    def __init__(self, fields):
        self.fields = fields

    def __getitem__(self, index):
        self.fields["queries"] += 1
        return self.fields["next_state"][index]

    def __array__(self, dtype=None, copy=None):
        self.fields["queries"] += int(self.fields["legal"][~self.fields["terminal"]].sum())
        return np.asarray(self.fields["next_state"], dtype)
