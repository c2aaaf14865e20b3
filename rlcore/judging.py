"""How good an agent is, and how sure one can be of it: returns with intervals, curves over seeds, films."""

from __future__ import annotations

import operator
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.agents import ActorCritic
from rlcore.core.checks import Model, as_floats, check_flag, check_pi, finite, is_discrete, show, spaces
from rlcore.core.extras import extra
from rlcore.core.files import check_path, whole
from rlcore.core.learner import learner, log, note
from rlcore.core.results import Run, Solution
from rlcore.core.rules import anything, array, check_positive, checked, count, takes_none
from rlcore.core.running import Interrupted
from rlcore.core.sampling import cumulative, draw
from rlcore.core.types import ArrayLike, Floats, Given, Ints, Rng, World
from rlcore.core.worlds import MOST_STEPS, Guard, act, open_world, reset, say_cut
from rlcore.distributions import Categorical

LEVEL = 0.95  # of all intervals
DRAWS = 2000  # samples of a bootstrap
BLOCK = 2**22  # numbers drawn at a time, 32 MB


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """What an agent earned in some episodes, learning switched off.

    Parameters
    ----------
    returns : np.ndarray
        (n_episodes,), undiscounted sum of the rewards of each episode.
    lengths : np.ndarray
        (n_episodes,), number of steps of each episode.
    mean : float
        Mean of the returns.
    interval : tuple[float, float]
        95 % interval of the mean, by Student's t; infinite for one episode.
    iqm : float
        Interquartile mean: that of the middle half, which a few episodes far off do not move.
    iqm_interval : tuple[float, float]
        95 % interval of iqm, by the bootstrap's percentiles.

    References
    ----------
    Agarwal et al. (2021), section 4.3.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import evaluate
    >>> from rlcore.envs.small import random_walk
    >>> evaluate(np.ones((5, 1)), random_walk(3), 100, rng=np.random.default_rng(0))
    Evaluation(100 episodes, return 0.49 [0.39, 0.59], iqm 0.48 [0.28, 0.68])
    """

    returns: np.ndarray
    lengths: np.ndarray
    mean: float
    interval: tuple[float, float]
    iqm: float
    iqm_interval: tuple[float, float]

    def __repr__(self) -> str:
        low, high, below, above = *self.interval, *self.iqm_interval
        numbers = f"return {self.mean:.3g} [{low:.3g}, {high:.3g}], iqm {self.iqm:.3g} [{below:.3g}, {above:.3g}]"
        return f"Evaluation({self.returns.size} episodes, {numbers})"


# ---------------------------------------------------------------------- acting


def _agent(name, agent, given):
    """The rule of what acts: a policy (S, A), or a function from an observation to an action or to a sampled one."""
    agent = agent.policy if isinstance(agent, Run) else agent.pi if isinstance(agent, Solution) else agent
    if hasattr(agent, "forward") or (callable(agent) and not isinstance(agent, type)):
        return agent
    if agent is None or isinstance(agent, (str, bytes, type)) or np.ndim(finite(name, agent)) != 2:
        raise ValueError(
            f"{name}: got {show(agent)}, must be a policy (S, A), a Run, an agent, a network or a function"
        )
    return np.asarray(agent)  # float32 as it is: check_pi knows how exact its rows can be


def _world(name, world, given):
    """The rule of a world that an agent can act in; a policy (S, A) is checked against it."""
    world, agent = open_world(name, world), given["agent"]
    if isinstance(agent, np.ndarray):
        given["agent"] = check_pi(spaces(world)[0], agent, "agent")
    elif isinstance(world, Model) or not hasattr(world, "observation_space") or not hasattr(world, "action_space"):
        raise ValueError(f"{name}: got {type(world).__name__}, must be a gymnasium.Env or its id for such an agent")
    return world


def _limit(name, max_steps, given):
    return MOST_STEPS if max_steps is None else count()(name, max_steps, given)


def _acting(agent: Any, env: Any, likeliest: bool, rng: Rng) -> Callable[[Any], Any]:
    """The function from an observation to an action of env; Discrete ones are counted from 0."""
    if isinstance(agent, np.ndarray):
        cdf = cumulative(agent)
        return lambda s: int(agent[s].argmax()) if likeliest else draw(cdf[s], rng)
    discrete, first = is_discrete(env.action_space), 0
    less = shift = int(getattr(env.action_space, "start", 0)) if discrete else 0  # networks count from 0
    if isinstance(agent, ActorCritic):
        sample = lambda s: agent.policy(np.asarray(s, float)[None]).sample(rng)[0]  # noqa: E731
        choose = agent.likeliest if likeliest else sample
        if not likeliest and agent.log_std is not None:
            choose = lambda s: agent.bounded(sample(s))  # noqa: E731
    elif not hasattr(agent, "forward"):
        shift, choose = 0, agent
        first = int(getattr(env.observation_space, "start", 0)) if is_discrete(env.observation_space) else 0
    elif not discrete:
        raise ValueError(f"agent: got a network for {env.action_space}, must be an ActorCritic there")
    else:

        def choose(s):
            outputs = agent.forward(s)
            return int(outputs.argmax()) if likeliest else int(Categorical(outputs).sample(rng))

    def act(s):
        action = choose(s + first if first else s)
        action = _allowed(action + shift if shift else action, env.action_space)
        return action - less if less else action

    return act


def _allowed(action, space):
    """What an agent gave, as an action of the space; ValueError where it is none."""
    if is_discrete(space):
        try:
            if operator.index(action) - int(getattr(space, "start", 0)) in range(int(space.n)):
                return operator.index(action)
        except TypeError:
            pass
    elif as_floats("agent", action).shape == space.shape:
        return action
    raise ValueError(f"agent: gave action {show(action)}, must be in {space}")


@learner(lambda given, returns, lengths: (returns, lengths), pi=lambda name, pi, given: pi, max_steps=anything)
def _play(world, pi, n_episodes, *, max_steps, rng):
    returns, lengths, history = log(pi, n_episodes, 0)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            s, r, terminated, truncated = act(world, s, draw(pi[s], rng), rng)
            returns[k] += r
            lengths[k] += 1
            done = terminated or truncated or lengths[k] == max_steps
        if note(world, history, pi, k, 0):
            break
    return returns, lengths


def _played(env: Any, agent: Any, n_episodes: int, max_steps: int, likeliest: bool, rng: Rng) -> tuple[Floats, Ints]:
    returns, lengths, guard = np.zeros(n_episodes), np.zeros(n_episodes, np.int64), Guard(env)
    choose = _acting(agent, env, likeliest, rng)
    try:
        for k in range(n_episodes):
            s, done = guard.reset(seed=int(rng.integers(2**31))), False
            while not done:
                s, r, terminated, truncated = guard.step(choose(s))
                returns[k] += r
                lengths[k] += 1
                done = terminated or truncated or lengths[k] == max_steps
    except KeyboardInterrupt:
        raise Interrupted((returns, lengths)) from None
    return returns, lengths


@checked(agent=_agent, world=_world, likeliest=check_flag, max_steps=takes_none(_limit))
def evaluate(
    agent: Any, world: World, n_episodes: int, *, likeliest: bool = False, max_steps: int | None = None, rng: Rng
) -> Evaluation:
    """Let an agent act for some episodes, without learning, and say what it earns.

    Parameters
    ----------
    agent : Any
        A policy (S, A), a Run or Solution (its policy), an ActorCritic, an MLP or TorchNet that gives logits, or a
        function from an observation to an action, both as the environment has them.
    world : World
        FiniteMDP, environment or its id.
    n_episodes : int
        Number of episodes.
    likeliest : bool
        The likeliest action instead of one drawn from the policy.
    max_steps : int | None
        An episode that long is cut; None: a million steps.
    rng : Rng
        Source of all that is random, the environment included.

    Returns
    -------
    Evaluation
        Returns, lengths, their mean and interquartile mean, each with a 95 % interval.

    References
    ----------
    Agarwal et al. (2021).

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import evaluate, q_learning
    >>> from rlcore.envs.grids import cliff_walking
    >>> run = q_learning(cliff_walking(), 1.0, 500, alpha=0.5, epsilon=0.1, rng=np.random.default_rng(0))
    >>> evaluate(run, cliff_walking(), 10, likeliest=True, rng=np.random.default_rng(1)).mean
    -13.0
    """
    try:
        if isinstance(agent, np.ndarray):
            pi = np.eye(agent.shape[1])[agent.argmax(axis=1)] if likeliest else agent
            returns, lengths = _play(world, pi, n_episodes, max_steps=max_steps, rng=rng)
        else:
            returns, lengths = _played(world, agent, n_episodes, max_steps, likeliest, rng)
    except Interrupted as stopped:
        returns, lengths = stopped.run
        ended = np.count_nonzero(lengths) - 1  # the last one was cut
        if ended < 1:
            raise KeyboardInterrupt from None
        raise Interrupted(_judged(returns[:ended], lengths[:ended], rng)) from None
    say_cut(lengths, max_steps, 4)
    return _judged(returns, lengths, rng)


def _judged(returns, lengths, rng):
    mean, interval = float(returns.mean()), _mean_interval(returns)
    block = max(1, min(DRAWS, BLOCK // returns.size))
    sizes = [min(block, DRAWS - i) for i in range(0, DRAWS, block)]
    draws = (rng.integers(returns.size, size=(size, returns.size)) for size in sizes)
    drawn = np.concatenate([interquartile_mean(returns[i]) for i in draws])
    low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Evaluation(returns, lengths, mean, interval, float(interquartile_mean(returns)), (float(low), float(high)))


# ---------------------------------------------------------------------- how sure one can be


def _mean_interval(x):
    from scipy.special import stdtrit

    if x.size == 1:
        return -np.inf, np.inf
    half = float(stdtrit(x.size - 1, (1 + LEVEL) / 2) * x.std(ddof=1) / np.sqrt(x.size))
    return float(x.mean()) - half, float(x.mean()) + half


def _scores(name, scores, given):
    scores = finite(name, scores)
    if scores.ndim < 1 or not scores.size:
        raise ValueError(f"{name}: got shape {scores.shape}, must be (..., n), n at least 1")
    return scores


@checked(scores=_scores)
def interquartile_mean(scores: ArrayLike) -> Any:
    """Mean of the middle half of the last axis: a quarter of the numbers, rounded down, is left out at each end.

    Parameters
    ----------
    scores : ArrayLike
        (..., n).

    Returns
    -------
    Any
        (...).

    References
    ----------
    Agarwal et al. (2021), section 4.3.

    Examples
    --------
    >>> from rlcore import interquartile_mean
    >>> float(interquartile_mean([1.0, 2.0, 3.0, 1000.0]))
    2.5
    """
    out = scores.shape[-1] // 4
    return np.sort(scores, axis=-1)[..., out : scores.shape[-1] - out].mean(axis=-1)


@dataclass(frozen=True, eq=False)
class Curve:
    """A learning curve over seeds, with its band.

    Parameters
    ----------
    x : np.ndarray
        (n,), episodes.
    mean : np.ndarray
        (n,), mean over the seeds.
    low : np.ndarray
        (n,), lower edge of the band.
    high : np.ndarray
        (n,), upper edge.
    name : str
        What the band is, for a caption.

    Examples
    --------
    >>> from rlcore import learning_curve
    >>> learning_curve([[1.0, 2.0], [3.0, 4.0]]).name
    'mean of 2 runs, band: 95 % interval of the mean'
    """

    x: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    name: str


def _runs(name, runs, given):
    """The rule of runs, as a list of their returns."""
    if isinstance(runs, (str, bytes)) or not hasattr(runs, "__iter__"):
        raise ValueError(f"{name}: got {show(runs)}, must be Runs, or lists of returns")
    runs = [array("n")(name, run.returns if isinstance(run, Run) else run, given) for run in runs]
    if not runs:
        raise ValueError(f"{name}: got none, must be at least one")
    return runs


@checked(runs=_runs, window=count())
def learning_curve(runs: Sequence[Run | ArrayLike], window: int = 1) -> Curve:
    """Mean return over seeds, episode by episode, with the 95 % interval of the mean as its band.

    Parameters
    ----------
    runs : Sequence[Run | ArrayLike]
        A Run, or its returns, for each seed; where they differ in length, the first episodes that all of them have.
    window : int
        Returns are averaged over so many episodes before.

    Returns
    -------
    Curve
        One point for each whole window.

    Examples
    --------
    >>> from rlcore import learning_curve
    >>> learning_curve([[0.0, 2.0, 4.0, 6.0], [2.0, 4.0, 6.0, 8.0]], window=2).mean
    array([2., 6.])
    """
    returns = [np.asarray(run) for run in runs]
    shortest = min(run.size for run in returns)
    n = shortest // window
    if n == 0:
        raise ValueError(f"window: got {window}, must be at most the episodes of a run, {shortest}")
    points = np.array([run[: n * window].reshape(n, window).mean(axis=1) for run in returns])
    edges = np.array([_mean_interval(column) for column in points.T])
    name = f"mean of {len(runs)} runs, band: {LEVEL:.0%} interval of the mean".replace("%", " %")
    return Curve(window * np.arange(1, n + 1), points.mean(axis=0), edges[:, 0], edges[:, 1], name)


# ---------------------------------------------------------------------- films


def _filmed(name: str, env: Any, given: Given) -> Any:
    """The rule of an environment that gives pictures."""
    try:
        env = _world(name, env, given)
    except ValueError as error:
        raise ValueError(re.sub("^world:", f"{name}:", str(error))) from None
    if getattr(env, "render_mode", None) != "rgb_array":
        got = f"{type(env).__name__} with render_mode {getattr(env, 'render_mode', None)!r}"
        raise ValueError(f"{name}: got {got}, must be made with render_mode='rgb_array'")
    return env


def _frame(env, shape=None):
    """A copy of what env shows, for it may draw into the same array again."""
    frame = np.array(env.render())
    if (
        frame.dtype != np.uint8
        or frame.ndim != 3
        or frame.shape[2] not in (3, 4)
        or frame.shape != (shape or frame.shape)
    ):
        got = f"{frame.dtype} of shape {frame.shape}" if frame.ndim else show(frame[()])
        raise ValueError(f"env: render() gave {got}, must be uint8 of shape {shape or '(height, width, 3)'}")
    return frame


@checked(agent=_agent, env=_filmed, path=check_path, likeliest=check_flag, max_steps=count(), fps=check_positive)
def film(
    agent: Any, env: Any, path: str | os.PathLike[str], *, likeliest: bool = True, max_steps: int = 1000,
    fps: float | None = None, rng: Rng,
) -> float:  # fmt: skip
    """Write a GIF of one episode, and return what the agent earned in it.

    Parameters
    ----------
    agent : Any
        As for `evaluate`.
    env : Any
        An environment made with render_mode="rgb_array".
    path : str | os.PathLike[str]
        Name of the file.
    likeliest : bool
        The likeliest action instead of one drawn from the policy.
    max_steps : int
        An episode that long is cut.
    fps : float | None
        Pictures a second; what the environment says where None, else 30. A GIF shows at most 50.
    rng : Rng
        Source of all that is random, the environment included.

    Returns
    -------
    float
        Undiscounted return of the episode.

    Examples
    --------
    >>> import gymnasium, numpy
    >>> from rlcore import film
    >>> env = gymnasium.make("CartPole-v1", render_mode="rgb_array")
    >>> film(lambda s: int(s[2] > 0), env, "pole.gif", rng=numpy.random.default_rng(0))  # doctest: +SKIP
    41.0
    """
    with extra("plots"):
        from PIL import Image

    guard, choose, total, t, done = Guard(env), _acting(agent, env, likeliest, rng), 0.0, 0, False
    s = guard.reset(seed=int(rng.integers(2**31)))
    frames = [_frame(env)]
    while not done:
        s, r, terminated, truncated = guard.step(choose(s))
        frames.append(_frame(env, frames[0].shape))
        total, t = total + r, t + 1
        done = terminated or truncated or t == max_steps
    pictures = [Image.fromarray(frame) for frame in frames]
    fps = fps or check_positive("env.metadata['render_fps']", getattr(env, "metadata", {}).get("render_fps") or 30)
    options: dict[str, Any] = dict(
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=round(min(max(20, 1000 / fps), 655_350)),
        loop=0,
    )
    with whole(path, "wb") as out:
        pictures[0].save(out, **options)
    return total
