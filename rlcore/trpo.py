"""Trust region policy optimisation: the natural gradient, as far as the KL allows (chapter 8)."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rlcore.core.agents import AGENT, ActorCritic, Policy, make_agent
from rlcore.core.checks import check_fraction, check_nonnegative, check_positive
from rlcore.core.files import check_path
from rlcore.core.results import Run
from rlcore.core.rollouts import SETTINGS, Learning, Settings, config_of, vector_env
from rlcore.core.rules import anything, array, checked, count, function_of, instance, rules
from rlcore.core.samples import finite_numbers
from rlcore.core.types import ArrayLike, Floats, Network, OnEpisode, Rng
from rlcore.distributions import Categorical, Gaussian
from rlcore.gae import learning_data

FIELDS = ("steps", "kl", "improvement", "shrunk", "entropy", "value_loss")


@checked(
    **SETTINGS, **rules(count(), "cg_steps backtracks"), delta=check_positive, damping=check_nonnegative,
    shrink=check_fraction,
)  # fmt: skip
@dataclass(frozen=True)
class TRPOConfig(Settings):
    """Settings of `trpo`.

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
        Passes of the value network over the rollout.
    minibatch : int
        Samples in a step of the value network.
    lr : float
        Learning rate of the value network.
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
    delta : float
        Largest mean KL(old, new) of an update (45).
    damping : float
        Multiple of the identity that is added to the Fisher matrix.
    cg_steps : int
        Steps of conjugate gradient.
    backtracks : int
        How often the step is cut before the update is given up.
    shrink : float
        What the step is multiplied by where it is cut, in (0, 1).

    References
    ----------
    Schulman et al. (2015), appendix C.

    Examples
    --------
    >>> from rlcore.trpo import TRPOConfig
    >>> TRPOConfig().delta
    0.01
    """

    lr: float = 1e-3
    minibatch: int = 128
    delta: float = 0.01
    damping: float = 0.1
    cg_steps: int = 10
    backtracks: int = 10
    shrink: float = 0.8


@checked(product=function_of("v (P,)"), b=array("P", kind=finite_numbers))
def conjugate_gradient(product: Callable[[Floats], Floats], b: ArrayLike, n_steps: int, tol: float = 1e-10) -> Floats:
    """The solution of H x = b for a symmetric positive definite H that is known only by product(v) = H v.

    Parameters
    ----------
    product : Callable[[Floats], Floats]
        Gives H v of v (P,).
    b : ArrayLike
        (P,).
    n_steps : int
        Most steps.
    tol : float
        Stops where the squared residual is below it.

    Returns
    -------
    Floats
        x, (P,).

    Notes
    -----
    Ledger: om-trpo-step.

    References
    ----------
    Hestenes and Stiefel (1952).

    Examples
    --------
    >>> from rlcore import conjugate_gradient
    >>> conjugate_gradient(lambda v: 2 * v, [2.0, 4.0], 10)
    array([1., 2.])
    """
    x, r = np.zeros_like(b), b.copy()
    p, rr = r.copy(), r @ r
    for _ in range(n_steps):
        if rr < tol:
            break
        Hp = product(p)
        alpha = rr / (p @ Hp)
        x += alpha * p
        r -= alpha * Hp
        rr, before = r @ r, rr
        p = r + rr / before * p
    return x


def _policy(name, policy, given):
    """The rule of the policy that the agent's last forward pass gave."""
    policy = instance(Categorical | Gaussian, "a Categorical or a Gaussian")(name, policy, given)
    if isinstance(policy, Gaussian) != (given["agent"].log_std is not None):
        raise ValueError(f"{name}: got {type(policy).__name__}, must be what the agent's forward gives")
    return policy


def _parameters(name, v, given):
    v, P = finite_numbers(name, v), len(_get(given["agent"]))
    if v.shape != (P,):
        raise ValueError(f"{name}: got shape {v.shape}, must be ({P},)")
    return v


@checked(agent=AGENT, policy=_policy, v=_parameters, damping=check_nonnegative)
def fisher_vector_product(agent: ActorCritic, policy: Policy, v: ArrayLike, damping: float = 0.0) -> Floats:
    """The product H v with the Fisher matrix H of the policy, averaged over the states of the agent's last forward.

    H = mean of J^T F J with the network's Jacobian J and the Fisher matrix F of the distribution with respect to its
    outputs: the Hessian of mean KL(old, new) at old.

    Parameters
    ----------
    agent : ActorCritic
        The policy and its critic.
    policy : Policy
        What the agent's last forward gave.
    v : ArrayLike
        (P,), or (P + A,) where log_std belongs to the parameters.
    damping : float
        Multiple of the identity that is added to H.

    Returns
    -------
    Floats
        Of v's shape.

    Notes
    -----
    Ledger: eq-ppo-45.
    """
    P, B = agent.net.theta.size, len(_outputs(policy))
    change = agent.net.jvp(v[:P])
    if agent.log_std is None:
        return agent.net.backward(policy.fisher(change) / B) + damping * v
    d_mean, d_log_std = policy.fisher(change, v[P:])
    return np.append(agent.net.backward(d_mean / B), d_log_std.mean(axis=0)) + damping * v


def _samples(name, x, given):
    """The rule of observations (B, d) of the agent."""
    x = finite_numbers(name, x)
    given["agent"].forward(x)
    return x


def _actions(name, actions, given):
    try:
        given["agent"].forward(given["x"])[0].log_prob(actions)
    except ValueError as error:
        raise ValueError(f"{name}{str(error).removeprefix('a')}") from None
    return np.asarray(actions)


def _advantage(name, advantage, given):
    advantage = finite_numbers(name, advantage)
    if advantage.shape != given["x"].shape[:1]:
        raise ValueError(f"{name}: got shape {advantage.shape}, must be {given['x'].shape[:1]}, one for each sample")
    return advantage


@checked(agent=AGENT, x=_samples, actions=_actions, advantage=_advantage, config=instance(TRPOConfig))
def trpo_step(
    agent: ActorCritic, x: ArrayLike, actions: ArrayLike, advantage: ArrayLike, config: TRPOConfig
) -> tuple[float, float, int]:
    """One update of the policy: the largest step along the natural gradient that (45) and (44) allow.

    Parameters change in place, or stay where no step is good enough.

    Parameters
    ----------
    agent : ActorCritic
        The policy and its critic.
    x : ArrayLike
        (B, d).
    actions : ArrayLike
        Of the B samples.
    advantage : ArrayLike
        (B,).
    config : TRPOConfig
        The settings.

    Returns
    -------
    tuple[float, float, int]
        KL, improvement of the surrogate, and how often the step was cut.

    Notes
    -----
    Ledger: alg-trpo.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import MLP, TRPOConfig, trpo_step
    >>> from rlcore.core.agents import ActorCritic
    >>> rng = np.random.default_rng(0)
    >>> agent = ActorCritic(MLP([1, 2], rng=rng), MLP([1, 1], rng=rng))
    >>> kl, gain, cuts = trpo_step(agent, [[0.0], [1.0]], [0, 1], [1.0, -1.0], TRPOConfig())
    >>> kl <= 0.01, gain > 0
    (True, True)
    """
    old = agent.forward(x)[0]
    old_log_prob, theta = old.log_prob(actions), _get(agent)
    before = float(advantage.mean())  # eq-ppo-44 at ratio 1
    gradient = _surrogate_gradient(agent, old, actions, advantage)
    product = lambda v: fisher_vector_product.unchecked(agent, old, v, config.damping)  # noqa: E731
    direction = conjugate_gradient.unchecked(product, gradient, config.cg_steps)
    curvature = float(direction @ product(direction))
    if not curvature > 0:
        return 0.0, 0.0, 0
    step = np.sqrt(2 * config.delta / curvature) * direction  # om-trpo-step
    for k in range(config.backtracks):
        _set(agent, theta + step * config.shrink**k)
        new = agent.forward(x)[0]
        surrogate = float((np.exp(new.log_prob(actions) - old_log_prob) * advantage).mean())  # eq-ppo-44
        kl = float(old.kl(new).mean())
        if kl <= config.delta and surrogate > before:  # eq-ppo-45
            return kl, surrogate - before, k
    _set(agent, theta)
    return 0.0, 0.0, config.backtracks


def _surrogate_gradient(agent, policy, actions, advantage):
    """Gradient of the surrogate at ratio 1, (P,) or (P + A,). eq-ppo-41"""
    score, weight = policy.grad_log_prob(actions), advantage[:, None] / advantage.size
    if agent.log_std is None:
        return agent.net.backward(weight * score)
    return np.append(agent.net.backward(weight * score[0]), (weight * score[1]).sum(axis=0))


def _outputs(policy):
    return policy.logits if hasattr(policy, "logits") else policy.mean


def _get(agent):
    return agent.net.theta.copy() if agent.log_std is None else np.append(agent.net.theta, agent.log_std)


def _set(agent, theta):
    P = agent.net.theta.size
    agent.net.theta[:] = theta[:P]
    if agent.log_std is not None:
        agent.log_std[:] = theta[P:]


@checked(world=anything, config=config_of(TRPOConfig), net=anything, critic=anything, agent=AGENT, log=check_path)
def trpo(
    world: Any, *, rng: Rng, n_steps: int, config: TRPOConfig | None = None, net: Network | None = None,
    critic: Network | None = None, on_episode: OnEpisode | None = None, agent: ActorCritic | None = None,
    log: str | os.PathLike[str] | None = None,
) -> Run:  # fmt: skip
    """Rollouts, each followed by one natural gradient step within the trust region.

    Details that change results: those of `rlcore.ppo` except the optimizer of the policy, which has none; v_hat is
    fitted after the step.

    Parameters
    ----------
    world : Any
        Id or gymnasium environment with Box observations (n,), and actions that are Discrete or a Box (m,).
    rng : Rng
        Source of all that is random.
    n_steps : int
        The run ends with the rollout that reaches them.
    config : TRPOConfig | None
        Settings; the defaults where None.
    net : Network | None
        MLP or TorchNet, instead of a new MLP.
    critic : Network | None
        MLP or TorchNet with an optimizer, from observations to one value.
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
        As `ppo` does; history: steps so far, kl (mean KL(old, new)), improvement of the surrogate, shrunk (how often
        the step was cut; backtracks: given up), entropy, value_loss before the fit.

    Notes
    -----
    Ledger: alg-trpo, eq-ppo-44, eq-ppo-45.

    References
    ----------
    Schulman et al. (2015), section 6 and appendix C.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore.trpo import TRPOConfig, trpo
    >>> config = TRPOConfig(horizon=128, epochs=2, hidden=(16,))
    >>> trpo("CartPole-v1", n_steps=256, config=config, rng=np.random.default_rng(0)).history.steps
    array([126., 249., 374.])
    """
    env = vector_env(world, config.n_envs)
    agent = make_agent(env, config, net, critic, rng, agent=agent)
    with Learning(env, agent, config, n_steps, FIELDS, on_episode, log, rng) as learning:
        for rollout in learning.rollouts():
            x, actions, advantage, target = learning_data(agent, rollout, config)
            value_loss = float(((agent.forward(x)[1] - target) ** 2).mean())
            record = trpo_step.unchecked(agent, x, actions, advantage, config)
            fit_values(agent, x, target, config, rng)
            entropy = float(agent.forward(x)[0].entropy().mean())
            learning.note(learning.episodes.steps, *record, entropy, value_loss)
    return learning.run()


def fit_values(agent: ActorCritic, x: Floats, target: Floats, config: TRPOConfig, rng: Rng) -> None:
    """K epochs of minibatch descent on the squared error of v_hat, which is a network of its own. om-value-loss"""
    for _ in range(config.epochs):
        order = rng.permutation(len(x))
        for i in range(0, len(x), config.minibatch):
            chosen = order[i : i + config.minibatch]
            error = agent.critic.forward(x[chosen])[:, 0] - target[chosen]
            agent.critic.step(agent.critic.backward(error[:, None] / error.size))  # om-value-loss
