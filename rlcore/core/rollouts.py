"""Rollouts of a policy network, and what PPO and TRPO learn from them (chapter 8)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.agents import ActorCritic
from rlcore.core.checks import check_count, check_entries, check_flag, is_discrete, show
from rlcore.core.extras import extra
from rlcore.core.results import Run
from rlcore.core.rules import anything, checked, count, instance, rules, takes_none
from rlcore.core.running import Interrupted, Watch, watched
from rlcore.core.samples import all_finite
from rlcore.core.types import Array, Flags, Floats, OnEpisode, Rng, Rule
from rlcore.core.worlds import Guard


def _hidden(name, hidden, given):
    if not isinstance(hidden, (tuple, list)) or not hidden:
        raise ValueError(f"{name}: got {show(hidden)}, must be numbers of neurons, such as (64, 64)")
    return tuple(check_count(name, n) for n in hidden)


SETTINGS = {
    **rules(count(), "horizon n_envs epochs minibatch"),
    **rules(check_flag, "normalise_advantages normalise_observations clip_actions scale_actions"),
    "hidden": _hidden,
}


@checked(**SETTINGS)
@dataclass(frozen=True)
class Settings:
    """What PPO and TRPO have in common.

    horizon: T steps of each of n_envs environments in a rollout. epochs, minibatch: passes over the rollout. lr: of
    Adam. hidden: tanh neurons a layer. scale_actions: continuous actions of -1 and 1 are the ends of the action
    space. clip_actions: they are cut to it. Both happen before the environment sees them, not in log pi.
    """

    gamma: float = 0.99
    lam: float = 0.95
    horizon: int = 2048
    n_envs: int = 1
    epochs: int = 10
    minibatch: int = 64
    lr: float = 3e-4
    hidden: tuple = (64, 64)
    normalise_advantages: bool = True
    normalise_observations: bool = False
    clip_actions: bool = True
    scale_actions: bool = True


def config_of(kind: type[Settings]) -> Rule:
    """The rule of a config: the defaults of its kind where None."""
    rule = instance(kind)
    return takes_none(lambda name, config, given: kind() if config is None else rule(name, config, given))


# ---------------------------------------------------------------------- environments


class OneEnv:
    """One environment with a vector environment's step: after an episode's end the next step is a reset."""

    def __init__(self, env: Any) -> None:
        self.guard, self.num_envs, self.over = Guard(env), 1, False
        self.single_observation_space, self.single_action_space = env.observation_space, env.action_space

    def reset(self, *, seed: int) -> tuple[Any, dict[str, Any]]:
        self.over = False
        return self.guard.reset(seed=seed)[None], {}

    def step(self, actions: Array) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        if self.over:
            self.over = False
            return self.guard.reset(), 0.0, False, False, {}
        s, r, terminated, truncated = self.guard.step(actions[0])
        self.over = terminated or truncated
        return s, r, terminated, truncated, {}


@checked(world=anything, n_envs=count())
def vector_env(world: Any, n_envs: int = 1) -> Any:
    """world, an id or an environment, as n_envs environments that take their steps together.

    An id with n_envs above 1 gives gymnasium's own vector environment of that task where it has one. The step after an
    episode's end resets: it is no transition, and what learns leaves it out.
    """
    with extra("gym"):
        import gymnasium as gym

    try:
        if isinstance(world, str):
            one = n_envs == 1
            world = gym.make(world, disable_env_checker=True) if one else gym.make_vec(world, num_envs=n_envs)
    except (gym.error.Error, ImportError) as error:
        raise ValueError(f"world: got {show(world)}, must be an environment or its id ({error})") from None
    if isinstance(world, gym.Env):
        if n_envs != 1:
            raise ValueError(
                f"n_envs: got {n_envs} with one environment, must be 1; give its id or a vector environment"
            )
        _check_spaces(world.observation_space, world.action_space)
        return OneEnv(world)
    if not isinstance(world, gym.vector.VectorEnv):
        raise ValueError(f"world: got {type(world).__name__}, must be a gymnasium environment or its id")
    if n_envs not in (1, world.num_envs):
        raise ValueError(
            f"n_envs: got {n_envs} with a vector of {world.num_envs}, must be {world.num_envs} or left out"
        )
    if world.metadata.get("autoreset_mode") != gym.vector.AutoresetMode.NEXT_STEP:
        raise ValueError(f"world: got {world.metadata.get('autoreset_mode')}, must reset on the next step")
    _check_spaces(world.single_observation_space, world.single_action_space)
    return world


def _check_spaces(observations, actions):
    if not _is_vector(observations):
        raise ValueError(f"world: got observations {observations}, must be a Box of shape (n,)")
    if not is_discrete(actions) and not (_is_vector(actions) and np.dtype(actions.dtype).kind == "f"):
        raise ValueError(f"world: got actions {actions}, must be Discrete, or a Box of shape (n,) of floats")


def _is_vector(space):
    return hasattr(space, "low") and hasattr(space, "high") and len(space.shape) == 1


# ---------------------------------------------------------------------- acting


@dataclass(frozen=True, eq=False)
class Rollout:
    """T steps of N environments.

    observations: (T + 1, N, d), the last for bootstrapping. actions: (T, N) or (T, N, A). rewards, terminated,
    truncated: (T, N). real: (T, N), False for a step that only resets its environment.
    """

    observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    real: np.ndarray


def collect(
    env: Any, agent: ActorCritic, s: Floats, over: Flags, T: int, *, watch: Watch | None = None, rng: Rng
) -> tuple[Rollout, Flags] | None:
    """(Rollout, over): T steps with the agent's policy from observations s (N, d). over: (N,), whose next step resets.

    Only observations and actions are kept: values and log-probabilities come in one batch afterwards. Noise is drawn
    for all steps at once; the argmax of logits plus Gumbel noise is a draw from their softmax (Gumbel, 1954).
    None where watch asks to stop.
    """
    space, outputs, one = env.single_action_space, agent.acting(), isinstance(env, OneEnv)
    discrete, N, dtype = hasattr(space, "n"), env.num_envs, agent.net.theta.dtype
    first = 0 if one or not discrete else int(space.start)  # one environment's guard counts from 0
    marks = (watch or Watch()).marks
    shape = (T, N, int(space.n)) if discrete else (T, N, *space.shape)
    check_entries("horizon", T, N, max(math.prod(shape[2:]), s.shape[1]))
    noise = (rng.gumbel(size=shape) if discrete else rng.standard_normal(shape) * np.exp(agent.log_std)).astype(dtype)
    observations, rewards = np.zeros((T + 1, *s.shape), dtype), np.zeros((T, N))
    actions = np.zeros((T, N), np.int64) if discrete else np.zeros((T, N, *space.shape), dtype)
    terminated, truncated = np.zeros((T, N), bool), np.zeros((T, N), bool)
    observations[0] = s
    for t in range(T):
        z = outputs(observations[t]) + noise[t]
        a = actions[t] = z.argmax(axis=1) if discrete else z
        a = a + first if discrete else agent.bounded(a)
        observations[t + 1], rewards[t], terminated[t], truncated[t], _ = env.step(a)
        if marks[0]:
            return None
    for name, values in () if one else (("observations", observations), ("rewards", rewards)):
        if not all_finite(values):
            t, i = np.argwhere(~np.isfinite(values))[0][:2]
            raise ValueError(f"world: {name} {values[t, i]} in environment {i}, step {t} of a rollout, must be finite")
    done = terminated | truncated
    real = ~np.concatenate((over[None], done[:-1]))
    return Rollout(observations, actions, rewards, terminated, truncated, real), done[-1]


class Learning:
    """A run of PPO or TRPO while it goes on: its history, in a file, too, if wanted, and what Ctrl-C leaves.

    fields: of a row of the history, one a rollout. log: name of a CSV file, or None.
    """

    def __init__(
        self, env: Any, agent: ActorCritic, config: Settings, n_steps: int, fields: Sequence[str],
        on_episode: OnEpisode | None, log: Any, rng: Rng,
    ) -> None:  # fmt: skip
        self.env, self.agent, self.config, self.n_steps = env, agent, config, n_steps
        self.fields, self.rng = fields, rng
        self.episodes, self.history, self.watch = Episodes(env.num_envs, on_episode), [], Watch(n_steps, "steps")
        self._log, self._open = log, ExitStack()

    def __enter__(self) -> Learning:
        self._open.enter_context(watched(self.watch))
        if self._log is not None:
            self._log = self._open.enter_context(open(self._log, "w", encoding="utf-8"))
            self._write(self.fields)
        return self

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        self._open.close()
        if self.watch.marks[0] or isinstance(error, KeyboardInterrupt):
            raise Interrupted(self.run(interrupted=True)) from None
        if isinstance(error, ValueError):
            error.add_note(f"after {self.episodes.steps:,} steps, {len(self.episodes.returns)} episodes")

    def rollouts(self) -> Iterator[Rollout]:
        """Rollout after rollout, each with the policy of its time, until n_steps are reached."""
        env, episodes, normaliser, stop = self.env, self.episodes, self.agent.normaliser, False
        s, over = env.reset(seed=int(self.rng.spawn(1)[0].integers(2**31)))[0], np.zeros(env.num_envs, bool)
        while episodes.steps < self.n_steps and not stop:
            found = collect(env, self.agent, s, over, self.config.horizon, watch=self.watch, rng=self.rng)
            if found is None:
                return
            rollout, over = found
            s, stop = rollout.observations[-1], episodes.add(rollout)
            self.watch.marks[1] = episodes.steps
            if normaliser is not None:
                normaliser.update(rollout.observations[:-1].reshape(-1, s.shape[-1]))
            if rollout.real.any():  # one step may be a reset
                yield rollout

    def note(self, *row: float) -> None:
        """Append a row to the history."""
        if np.isnan(row).any():
            raise ValueError(f"lr: got {self.config.lr}, must be smaller: estimates are no numbers any more")
        self.history.append(row)
        if self._log is not None:
            self._write(row)

    def _write(self, row):
        self._log.write(",".join(map(str, row)) + "\n")
        self._log.flush()

    def run(self, *, interrupted: bool = False) -> Run:
        """The Run so far; its history holds one record a rollout, with a field for each name."""
        history = np.array(self.history, [(name, float) for name in self.fields]).view(np.recarray)
        returns, lengths = np.array(self.episodes.returns, float), np.array(self.episodes.lengths, int)
        agent = self.agent
        return Run(returns, lengths, V=agent.values, policy=agent, history=history, interrupted=interrupted)


class Episodes:
    """Returns and lengths of the episodes that ended so far, in order of time; steps counts all transitions."""

    def __init__(self, N: int, on_episode: OnEpisode | None) -> None:
        self.returns, self.lengths, self.steps, self.on_episode = [], [], 0, on_episode
        self._G, self._n = np.zeros(N), np.zeros(N, int)

    def add(self, rollout: Rollout) -> bool:
        """Count a rollout in; True where on_episode asks to stop."""
        rows = zip(rollout.rewards, rollout.real, rollout.terminated | rollout.truncated)
        for rewards, real, done in rows:
            self._G += rewards * real
            self._n += real
            self.steps += np.count_nonzero(real)
            for i in np.flatnonzero(done) if done.any() else ():
                self.returns.append(float(self._G[i]))
                self.lengths.append(int(self._n[i]))
                self._G[i] = self._n[i] = 0
                if self.on_episode is not None and self.on_episode(self.returns[-1], self.steps):
                    return True
        return False
