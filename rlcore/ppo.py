"""Proximal policy optimisation: clipped, unclipped, and with a fixed or an adaptive KL penalty (chapter 8).

What changes results besides the equations, and where it comes from ("ppo1": the code of the paper's authors, OpenAI
Baselines; "paper": Schulman et al., 2017):
  advantages of a rollout are centred and scaled before the epochs (ppo1): normalise_advantages
  weights start at Glorot and Bengio's spread (ppo1: those into a neuron have length 1 together)
  the policy's last layer starts 100 times smaller, so that the first policy is near uniform or centred (ppo1)
  log_std is a parameter of its own, 0 at first, the same in all states (Schulman et al., 2015, appendix D)
  v_hat learns the lambda-return A_hat + v_hat(s) by squared error, which is not clipped (ppo1)
  observations are centred and scaled by running statistics, with variances of at least 1e-4 (ppo1: 1e-2), and cut at
    +-5 (ppo1): normalise_observations
  these change before the epochs; old log-probabilities are computed with the new ones, so ratios start at 1 (ppo1)
  a truncated episode goes on with v_hat of its last state (ppo1 takes it for a terminal one)
  continuous actions of -1 and 1 are the ends of the action space, as they are in the paper's tasks: scale_actions
  continuous actions are cut to the action space before the environment sees them (Stable-Baselines3): clip_actions
  Adam's epsilon is 1e-5, and its moments live on from rollout to rollout (ppo1)
  the learning rate falls to 0 in a straight line (paper: on Atari; ppo1: everywhere): anneal
  an episode's step that only resets the environment is left out of the learning data
  gradients are not clipped, and no rollout is left early because of its KL
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.agents import AGENT, ActorCritic, Gradient, Policy, make_agent
from rlcore.core.checks import check_flag, check_nonnegative, check_positive
from rlcore.core.files import check_path
from rlcore.core.results import Run
from rlcore.core.rollouts import SETTINGS, Learning, Settings, config_of, vector_env
from rlcore.core.rules import anything, array, checked, choice, instance, rules
from rlcore.core.samples import finite_numbers
from rlcore.core.types import Array, ArrayLike, Floats, Network, OnEpisode, Rng
from rlcore.distributions import Categorical, Gaussian
from rlcore.gae import learning_data
from rlcore.trust_region import adapt_beta

OBJECTIVES = ("clip", "none", "kl_fixed", "kl_adaptive")
MAX_LOG_RATIO = 20.0  # exp of more overflows float32 once it is multiplied, as happens without clipping
FIELDS = ("steps", "kl", "largest_ratio", "outside", "entropy", "value_loss", "beta", "lr")


@checked(
    **SETTINGS,
    **rules(check_positive, "clip beta d_target"),
    **rules(check_nonnegative, "c1 c2"),
    **rules(check_flag, "shared anneal"),
    objective=choice(*OBJECTIVES),
)
@dataclass(frozen=True)
class PPOConfig(Settings):
    """Settings of `ppo`; the defaults are those of the paper's continuous tasks.

    Parameters
    ----------
    gamma : float
        Discount, in [0, 1].
    lam : float
        In [0, 1].
    horizon : int
        Steps of each environment in a rollout.
    n_envs : int
        Environments that run side by side.
    epochs : int
        Passes over each rollout.
    minibatch : int
        Samples in a step.
    lr : float
        Learning rate of Adam.
    hidden : tuple
        Tanh neurons of each layer.
    normalise_advantages : bool
        Centre and scale the advantages of a rollout.
    normalise_observations : bool
        Centre and scale observations by running statistics.
    clip_actions : bool
        Continuous actions are cut to the action space before the environment sees them, not in log pi.
    scale_actions : bool
        Continuous actions of -1 and 1 are the ends of the action space, where it has ends.
    objective : str
        "clip" (49), "none" (48), "kl_fixed" (46) or "kl_adaptive".
    clip : float
        The epsilon of the clipped ratio.
    beta : float
        Coefficient of the KL penalty, the first one where it adapts.
    d_target : float
        The KL that it adapts to.
    c1 : float
        Weight of the value loss in (50).
    c2 : float
        Weight of the entropy in (50).
    shared : bool
        Policy and value are outputs of one network.
    anneal : bool
        lr falls to 0 over n_steps.

    Notes
    -----
    Ledger: fig-61.

    References
    ----------
    Schulman et al. (2017), tables 1 and 3.

    Examples
    --------
    >>> from rlcore.ppo import PPOConfig
    >>> PPOConfig(objective="kl_adaptive").d_target
    0.01
    """

    objective: str = "clip"
    clip: float = 0.2
    beta: float = 1.0
    d_target: float = 0.01
    c1: float = 0.5
    c2: float = 0.0
    shared: bool = False
    anneal: bool = False


# ---------------------------------------------------------------------- objectives


def _beside_ratio(name, advantage, given):
    advantage, B = _samples(name, advantage, given), given["ratio"].shape
    if advantage.shape != B:
        raise ValueError(f"{name}: got shape {advantage.shape}, must be that of ratio, {B}")
    return advantage


_samples = array("B", kind=finite_numbers)
OF_RATIO = dict(ratio=_samples, advantage=_beside_ratio)


@checked(**OF_RATIO)
def surrogate_gradient(ratio: ArrayLike, advantage: ArrayLike) -> Floats:
    """Derivative of the surrogate with respect to log pi(a|s), per sample.

    At ratio 1 it is that of L^PG.

    Parameters
    ----------
    ratio, advantage : ArrayLike
        (B,).

    Returns
    -------
    Floats
        (B,).

    Notes
    -----
    Ledger: eq-ppo-44, eq-ppo-48, eq-ppo-41.
    """
    return ratio * advantage / ratio.size  # eq-ppo-48


@checked(**OF_RATIO, clip=check_positive)
def clip_gradient(ratio: ArrayLike, advantage: ArrayLike, clip: float) -> Floats:
    """Derivative of the clipped surrogate with respect to log pi(a|s), per sample.

    Parameters
    ----------
    ratio, advantage : ArrayLike
        (B,).
    clip : float
        The epsilon of the clipped ratio, above 0.

    Returns
    -------
    Floats
        (B,): 0 where the objective is flat.

    Notes
    -----
    Ledger: eq-ppo-49, fig-59, fig-60.
    """
    flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
    return np.where(flat, 0.0, surrogate_gradient.unchecked(ratio, advantage))  # eq-ppo-49


PENALISED = ("kl_fixed", "kl_adaptive")


def _actions(name, actions, given):
    """The rule of actions that the policy knows."""
    try:
        given["policy"].log_prob(actions)
    except ValueError as error:
        raise ValueError(f"{name}{str(error).removeprefix('a')}") from None
    return np.asarray(actions)


def _each(name, values, given):
    values = _samples(name, values, given)
    if values.shape != given["actions"].shape[:1]:
        raise ValueError(f"{name}: got shape {values.shape}, must be {given['actions'].shape[:1]}, one for each action")
    return values


def _config(name, config, given):
    """The rule of a PPOConfig, which says whether there has to be an old policy."""
    config, policy, old = instance(PPOConfig)(name, config, given), given["policy"], given["old"]
    if config.objective in PENALISED or old is not None:
        try:
            policy.kl(old)
        except ValueError as error:
            raise ValueError(str(error).replace("other", "old", 1)) from None
    return config


@checked(
    policy=instance(Categorical | Gaussian, "a Categorical or a Gaussian"), old=anything, actions=_actions,
    old_log_prob=_each, advantage=_each, config=_config, beta=check_nonnegative,
)  # fmt: skip
def objective_gradient(
    policy: Policy, old: Policy | None, actions: ArrayLike, old_log_prob: ArrayLike, advantage: ArrayLike,
    config: PPOConfig, beta: float | None = None,
) -> tuple[Gradient, Floats]:  # fmt: skip
    """Derivative of the policy's part of (50) with respect to its outputs, and the ratios (B,).

    Parameters
    ----------
    policy : Policy
        The new policy of the B states.
    old : Policy | None
        The old one of the same states; None where the objective needs none.
    actions : ArrayLike
        Of the B samples.
    old_log_prob, advantage : ArrayLike
        (B,).
    config : PPOConfig
        Says which objective.
    beta : float | None
        Coefficient of the penalty, config.beta where None.

    Returns
    -------
    tuple[Gradient, Floats]
        (B, A), or a pair of them for a Gaussian, and (B,).

    Notes
    -----
    Ledger: eq-ppo-46, eq-ppo-50.
    """
    log_ratio = policy.log_prob(actions) - old_log_prob
    ratio = np.exp(np.minimum(log_ratio, MAX_LOG_RATIO))  # eq-ppo-47
    if config.objective == "clip":
        weight = clip_gradient.unchecked(ratio, advantage, config.clip)
    else:
        weight = surrogate_gradient.unchecked(ratio, advantage)
    parts = [weight[:, None] * part for part in _parts(policy.grad_log_prob(actions))]
    if config.objective in PENALISED:
        weight = (config.beta if beta is None else beta) / ratio.size
        parts = [part - weight * kl for part, kl in zip(parts, _parts(old.grad_kl(policy)))]  # eq-ppo-46
    if config.c2:
        weight = config.c2 / ratio.size
        parts = [part + weight * entropy for part, entropy in zip(parts, _parts(policy.grad_entropy()))]  # eq-ppo-50
    return (parts[0] if len(parts) == 1 else tuple(parts)), ratio


def _parts(gradient):
    return gradient if isinstance(gradient, tuple) else (gradient,)


# ---------------------------------------------------------------------- learning


@checked(world=anything, config=config_of(PPOConfig), net=anything, critic=anything, agent=AGENT, log=check_path)
def ppo(
    world: Any, *, rng: Rng, n_steps: int, config: PPOConfig | None = None, net: Network | None = None,
    critic: Network | None = None, on_episode: OnEpisode | None = None, agent: ActorCritic | None = None,
    log: str | os.PathLike[str] | None = None,
) -> Run:  # fmt: skip
    """Rollouts of T steps in N environments, each followed by K epochs of minibatch ascent on (50).

    Parameters
    ----------
    world : Any
        Id or gymnasium environment with Box observations (n,), and actions that are Discrete or a Box (m,).
    rng : Rng
        Source of all that is random.
    n_steps : int
        The run ends with the rollout that reaches them.
    config : PPOConfig | None
        PPOConfig; its defaults where None.
    net : Network | None
        MLP or TorchNet with an optimizer, instead of a new MLP with Adam(config.lr); with config.shared it has one
        output more, the value.
    critic : Network | None
        Like net, from observations to one value.
    on_episode : OnEpisode | None
        Called as on_episode(return, steps so far) for each episode that ended, after its rollout; True ends the
        training.
    agent : ActorCritic | None
        One to learn on with, instead of net and critic: that of an earlier run, or what `load` gives.
    log : str | os.PathLike[str] | None
        Name of a CSV file that gets the rows of the history while it grows.

    Returns
    -------
    Run
        policy an `ActorCritic`, V its values(observations), history a record a rollout: steps so far, kl (mean KL(old,
        new)), largest_ratio and the part outside 1 +- clip of all minibatches, entropy, value_loss, beta, lr.

    Notes
    -----
    Ledger: om-ppo-box, alg-ppo-full, alg-ppo-clip, alg-kl-penalty, alg-kl-adaptive.

    References
    ----------
    Schulman et al. (2017), algorithm 1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore.ppo import PPOConfig, ppo
    >>> config = PPOConfig(horizon=128, epochs=2, hidden=(16,))
    >>> ppo("CartPole-v1", n_steps=256, config=config, rng=np.random.default_rng(0)).history.steps
    array([126., 248., 371.])
    """
    env = vector_env(world, config.n_envs)
    agent = make_agent(env, config, net, critic, rng, shared=config.shared, agent=agent)
    beta, lr, steps = config.beta, config.lr, 0
    with Learning(env, agent, config, n_steps, FIELDS, on_episode, log, rng) as learning:
        for rollout in learning.rollouts():
            if config.anneal:
                lr = config.lr * (1 - steps / n_steps)
                agent.set_lr(lr)
            kl, *record = improve(agent, learning_data(agent, rollout, config), config, beta, rng)
            steps = learning.episodes.steps
            learning.note(steps, kl, *record, beta, lr)
            if config.objective == "kl_adaptive":
                beta = adapt_beta(beta, max(kl, 0.0), config.d_target)  # rounding may leave it below 0
    return learning.run()


def improve(
    agent: ActorCritic, data: tuple[Array, ...], config: PPOConfig, beta: float, rng: Rng
) -> tuple[float, float, float, float, float]:
    """K epochs over the data of one rollout. Returns kl, largest_ratio, outside, entropy, value_loss."""
    x, actions, advantage, target = data
    old, _ = agent.forward(x)
    n, penalised = len(x), config.objective in PENALISED
    outside, largest, value_loss = 0, 0.0, 0.0
    shuffled = (x, actions, advantage, target, old.log_prob(actions))
    for _ in range(config.epochs):
        order = rng.permutation(n)
        for i in range(0, n, config.minibatch):
            chosen = order[i : i + config.minibatch]
            x_i, a_i, A_i, target_i, old_i = (part[chosen] for part in shuffled)
            policy, v = agent.forward(x_i)
            before = old.take(chosen) if penalised else None
            gradient, ratio = objective_gradient.unchecked(policy, before, a_i, old_i, A_i, config, beta)
            error = v - target_i
            d_values = 2 * config.c1 / error.size * error  # om-value-loss
            agent.step(tuple(-g for g in gradient) if isinstance(gradient, tuple) else -gradient, d_values)
            outside += np.count_nonzero(np.abs(ratio - 1) > config.clip)
            largest, value_loss = max(largest, float(ratio.max())), value_loss + float(error @ error)
    new, _ = agent.forward(x)
    seen = config.epochs * n
    return float(old.kl(new).mean()), largest, outside / seen, float(new.entropy().mean()), value_loss / seen
