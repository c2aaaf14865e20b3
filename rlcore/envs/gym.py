"""A FiniteMDP as a gymnasium environment, and Catch from its pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from rlcore.core.checks import is_number, show
from rlcore.core.extras import extra
from rlcore.core.rules import anything, checked, index
from rlcore.core.sampling import cumulative, draw
from rlcore.core.types import Floats, Ints
from rlcore.envs.catch import catch, catch_pixels
from rlcore.mdp import FiniteMDP

ACTION = index(lambda given: given["self"].mdp.n_actions)


def _seed(name, seed, given):
    if not is_number(seed) or not 0 <= seed < np.inf or int(seed) != seed:
        raise ValueError(f"{name}: got {show(seed)}, must be a whole number of at least 0, or None")
    return int(seed)


def _legal(name, action, given):
    env, a = given["self"], ACTION(name, action, given)
    legal = env.mdp.legal[env.s]
    if not legal[a]:
        raise ValueError(f"{name}: got {a} in state {env.s}, allowed there: {legal.nonzero()[0].tolist()}")
    return a


with extra("gym"):
    import gymnasium as gym


class LegalActions(gym.spaces.Discrete):
    """Discrete actions, of which sample() draws those that are legal now, unless told otherwise.

    Parameters
    ----------
    env : MDPEnv
        Whose actions they are.
    """

    def __init__(self, env: MDPEnv) -> None:
        super().__init__(env.mdp.n_actions)
        self._env = env

    def sample(self, mask: Any = None, probability: Any = None) -> np.int64:
        if mask is None and probability is None:
            mask = self._env.action_mask()
        return super().sample(mask, probability)


class MDPEnv(gym.Env):
    """A FiniteMDP behind gymnasium's interface: Discrete observations and actions.

    `terminated` at terminal states; never truncates: wrap it in gymnasium.wrappers.TimeLimit for that. `P` and
    `initial_state_distrib` are the tables of gymnasium's toy-text environments, info carries "action_mask". step
    raises ValueError for an action not in A(s).

    Parameters
    ----------
    mdp : FiniteMDP
        The process.

    Examples
    --------
    >>> from rlcore.envs import MDPEnv
    >>> from rlcore.envs.small import random_walk
    >>> env = MDPEnv(random_walk(5))
    >>> env.reset(seed=0)
    (3, {'action_mask': array([1], dtype=int8)})
    """

    metadata = {"render_modes": []}

    @checked
    def __init__(self, mdp: FiniteMDP) -> None:
        self.mdp = mdp
        self.state_names, self.action_names = mdp.state_names, mdp.action_names
        self.s = int(mdp.start.argmax())
        self.observation_space = gym.spaces.Discrete(mdp.n_states)
        self.action_space = LegalActions(self)
        self.initial_state_distrib = mdp.start
        self._start, self._cdf = cumulative(mdp.start), cumulative(mdp.prob)

    @property
    def P(self) -> dict[int, dict[int, list[tuple[float, int, float, bool]]]]:
        mdp = self.mdp
        return {s: {a: self._row(s, a) for a in range(mdp.n_actions) if mdp.legal[s, a]} for s in range(mdp.n_states)}

    def _row(self, s, a):
        m = self.mdp
        outcomes = zip(m.prob[s, a].tolist(), m.next_state[s, a].tolist(), m.reward[s, a].tolist())
        return [(p, s_next, r, bool(m.terminal[s_next])) for p, s_next, r in outcomes if p > 0]

    def action_mask(self) -> Ints:
        """A(s) of the current state as (A,) int8."""
        return self.mdp.legal[self.s].astype("int8")

    @checked(seed=_seed, options=anything)
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        super().reset(seed=seed)
        self.s = int(draw(self._start, self.np_random))
        return self.s, {"action_mask": self.action_mask()}

    @checked(action=_legal)
    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        m, s, a = self.mdp, self.s, action
        k = draw(self._cdf[s, a], self.np_random)
        self.s = int(m.next_state[s, a, k])
        terminated = bool(m.terminal[self.s])
        return self.s, float(m.reward[s, a, k]), terminated, False, {"action_mask": self.action_mask()}


class Catch(gym.Env):
    """The game of `catch` seen as 50 pixels: a Box observation of 0 and 1, float32.

    An episode has 9 steps and never truncates; `s` is the state's number in `catch`.

    Parameters
    ----------
    n_actions : int
        3 for left, stay and right, 2 without stay.

    Notes
    -----
    Ledger: ex-up-down, ex-outcome.
    """

    metadata = {"render_modes": []}

    def __init__(self, n_actions: int = 3) -> None:
        self.mdp, pixels = catch(n_actions), catch_pixels()
        self.observation_space = gym.spaces.Box(0.0, 1.0, pixels.shape[1:], np.float32)
        self.action_space = gym.spaces.Discrete(n_actions)
        self.s = int(self.mdp.terminal.argmax())
        self._pixels, self._terminal = list(pixels), self.mdp.terminal.tolist()
        self._start = np.flatnonzero(self.mdp.start).tolist()
        self._next, self._reward = (x[:, :, 0].tolist() for x in (self.mdp.next_state, self.mdp.reward))

    @checked(seed=_seed, options=anything)
    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        super().reset(seed=seed)
        self.s = self._start[int(self.np_random.random() * len(self._start))]
        return self._pixels[self.s].copy(), {}

    @checked(action=ACTION)
    def step(self, action: int) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        s, self.s = self.s, self._next[self.s][action]
        return self._pixels[self.s].copy(), self._reward[s][action], self._terminal[self.s], False, {}
