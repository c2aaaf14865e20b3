"""A policy network beside an estimate of its values (chapter 8)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from rlcore.core.checks import check_positive, finite
from rlcore.core.rules import array, check_optimizer, checked, count, instance
from rlcore.core.samples import check_samples, numbers
from rlcore.core.types import BODIES, Array, ArrayLike, Floats, Network, Optimizer, Rng
from rlcore.distributions import Categorical, Gaussian
from rlcore.nn import MLP, check_network, network
from rlcore.optimizers import Adam

if BODIES:
    Policy: TypeAlias = Any
else:
    Policy: TypeAlias = Categorical | Gaussian
Gradient: TypeAlias = Array | tuple[Array, Array]  # with respect to logits, or to mean and log_std


class Normaliser:
    """Observations less their mean, over their deviation, both of all that was seen so far.

    Parameters
    ----------
    d : int
        Numbers of an observation.
    limit : float
        What comes out is cut at +-limit.
    dtype : Any
        Of what comes out, as the networks take it.

    References
    ----------
    Chan, Golub and LeVeque (1979), for the running sums.
    """

    @checked(d=count(), limit=check_positive)
    def __init__(self, d: int, limit: float = 5.0, dtype: Any = np.float32) -> None:
        self.n, self._mean, self._square, self.limit = 0, np.zeros(d), np.zeros(d), limit
        self.mean, self.scale = np.zeros(d, dtype), np.ones(d, dtype)

    def update(self, x: ArrayLike) -> None:
        """Count x (B, d) in."""
        x = check_samples("x", x, self.mean.dtype)
        if x.ndim != 2 or not len(x) or x.shape[1:] != self.mean.shape:
            raise ValueError(f"x: got shape {x.shape}, must be (B, {self.mean.size}), with B at least 1")
        n, mean = self.n + len(x), x.mean(axis=0, dtype=float)
        apart = mean - self._mean
        self._square += ((x - mean) ** 2).sum(axis=0) + apart**2 * (self.n * len(x) / n)
        self._mean += apart * (len(x) / n)
        self.n = n
        self.mean[:] = self._mean
        self.scale[:] = 1 / np.sqrt(np.maximum(self._square / n, 1e-4))

    def __call__(self, x: Floats) -> Floats:
        x = (x - self.mean) * self.scale
        return np.minimum(np.maximum(x, -self.limit, out=x), self.limit, out=x)


def _writable(name, values):
    """values, which are to learn in place, as they are; ValueError unless they are an array of floats, all finite."""
    if not isinstance(values, np.ndarray) or values.dtype.kind != "f":
        raise ValueError(f"{name}: got {type(values).__name__}, must be an array of floats, (A,)")
    finite(name, values)
    return values


class ActorCritic:
    """A policy and an estimate of its values: two networks, or one that shares its layers.

    Parameters
    ----------
    net : Network
        Observations (B, d) to A logits or A means; without a critic it has one output more, the value.
    critic : Network | None
        Observations to (B, 1).
    log_std : Floats | None
        (A,) where actions are continuous, learned, the same in every state; None where they are discrete.
    log_std_optimizer : Optimizer | None
        What log_std learns by.
    normaliser : Normaliser | None
        What observations pass through first.
    box : Floats | None
        (4, A), what becomes of continuous actions before an environment gets them: centre and half of the range that
        -1 to 1 is stretched to, lowest, highest.

    Notes
    -----
    Ledger: cl-141.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore.core.agents import ActorCritic
    >>> from rlcore.nn import MLP
    >>> rng = np.random.default_rng(0)
    >>> agent = ActorCritic(MLP([3, 8, 2], rng=rng), MLP([3, 8, 1], rng=rng))
    >>> agent.values(np.zeros((5, 3))).shape
    (5,)
    """

    @checked(
        net=network, critic=network, log_std=array("A", kind=_writable), log_std_optimizer=check_optimizer,
        normaliser=instance(Normaliser), box=array("4", "A", kind=numbers),
    )  # fmt: skip
    def __init__(
        self, net: Network, critic: Network | None = None, log_std: Floats | None = None,
        log_std_optimizer: Optimizer | None = None, normaliser: Normaliser | None = None, box: Floats | None = None,
    ) -> None:  # fmt: skip
        self.net, self.critic, self.log_std, self.normaliser = net, critic, log_std, normaliser
        self.log_std_optimizer, self.box = log_std_optimizer, box
        self._n, self._d = -1 if critic is None else None, getattr(net, "sizes", (None,))[0]

    def forward(self, x: Floats) -> tuple[Policy, Floats]:
        """(policy, values (B,)) for observations x (B, d) that the normaliser has seen."""
        outputs = self.net.forward(x)
        if outputs.ndim != 2:
            raise ValueError(f"x: got shape {np.shape(x)}, must be (B, d)")
        values = outputs if self.critic is None else self.critic.forward(x)
        return self._policy(outputs[:, : self._n]), values[:, -1]

    def distribution(self, outputs: ArrayLike) -> Policy:
        """The policy that outputs (B, A) stand for; it stays as it is when log_std learns on."""
        outputs = check_samples("outputs", outputs, self.net.theta.dtype)
        if outputs.ndim != 2 or self.log_std is not None and outputs.shape[1:] != self.log_std.shape:
            raise ValueError(f"outputs: got shape {outputs.shape}, must be (B, A)")
        return self._policy(outputs)

    def _policy(self, outputs):
        return Categorical(outputs) if self.log_std is None else Gaussian(outputs, self.log_std.copy())

    def policy(self, observations: ArrayLike) -> Policy:
        """The policy in observations (B, d) as the environment gives them."""
        return self.forward(self.see(observations))[0]

    def values(self, observations: ArrayLike) -> Floats:
        """v_hat, (B,), of observations (B, d) as the environment gives them."""
        return self.forward(self.see(observations))[1]

    def likeliest(self, observation: ArrayLike) -> int | Floats:
        """The likeliest action for one observation (d,), as the environment takes it: a number, or (A,)."""
        x = finite("observation", observation)
        try:
            policy = self.policy(x[None])
        except ValueError:
            raise ValueError(f"observation: got shape {x.shape}, must be (d,), as the network takes it") from None
        return int(policy.logits[0].argmax()) if self.log_std is None else self.bounded(policy.mean[0])

    def bounded(self, actions: Floats) -> Floats:
        """Continuous actions (..., A) as an environment takes them: stretched to its range, and cut to it."""
        actions = check_samples("actions", actions, self.net.theta.dtype)
        if self.box is None:
            return actions
        centre, half, low, high = self.box
        return np.minimum(np.maximum(actions * half + centre, low), high)

    def step(self, d_policy: Gradient, d_values: Floats) -> None:
        """One step of every optimizer against a loss with these derivatives.

        d_policy: (B, A) with respect to the logits, or ((B, A), (B, A)) to mean and log_std. d_values: (B,).
        """
        d_outputs, d_log_std = d_policy if isinstance(d_policy, tuple) else (d_policy, None)
        try:
            if self.critic is None:
                gradient, d_critic = self.net.backward(np.column_stack((d_outputs, d_values))), None
            else:
                gradient, d_critic = self.net.backward(d_outputs), self.critic.backward(d_values[:, None])
            d_log_std = None if d_log_std is None else d_log_std.sum(axis=0)
        except (ValueError, TypeError, IndexError, AttributeError) as error:
            raise ValueError(f"d_policy, d_values: {error}; must be (B, A), or a pair of them, and (B,)") from None
        if d_critic is not None:
            self.critic.step(d_critic)
        self.net.step(gradient)
        if d_log_std is not None:
            self.log_std_optimizer.update(self.log_std, d_log_std)

    @checked
    def set_lr(self, lr: float) -> None:
        """The learning rate of every optimizer."""
        for part in (self.net.optimizer, self.critic and self.critic.optimizer, self.log_std_optimizer):
            if part is not None:
                part.lr = lr  # type: ignore[union-attr]

    def see(self, observations: ArrayLike) -> Floats:
        """observations as the networks take them."""
        x, d = check_samples("observations", observations, self.net.theta.dtype), self._d
        if x.ndim != 2 or not len(x) or x.shape[1] != (d or x.shape[1]):
            raise ValueError(f"observations: got shape {x.shape}, must be (B, {d or 'd'}), with B at least 1")
        return x if self.normaliser is None else self.normaliser(x)

    def acting(self) -> Callable[[Floats], Floats]:
        """The function from observations (N, d) to outputs (N, A), an MLP's layers spelt out: called for every step."""
        see, n, layers = self.normaliser or (lambda x: x), self._n, None
        if not isinstance(self.net, MLP):
            return lambda x: self.net.forward(see(x))[:, :n]
        layers = list(zip([w.T for w in self.net.weights], self.net.biases, self.net._sigma))  # views of theta

        def outputs(x):
            a = see(x)
            for w, b, sigma in layers:
                a = sigma(a @ w + b)
            return a[:, :n]

        return outputs


AGENT = instance(ActorCritic, "an ActorCritic")


def action_box(space: Any, *, scale: bool, clip: bool, dtype: Any) -> Floats:
    """The box of an ActorCritic for a Box of actions; sides without end, or too long for dtype, are not stretched."""
    low, high = (np.asarray(side, np.float64) for side in (space.low, space.high))
    with np.errstate(invalid="ignore", over="ignore"):
        box = np.array([(low + high) / 2, (high - low) / 2, low, high], dtype)
    known = np.isfinite(box[:2]).all(axis=0) & scale
    box[0], box[1] = np.where(known, box[0], 0.0), np.where(known, box[1], 1.0)
    if not clip:
        box[2], box[3] = -np.inf, np.inf
    else:  # dtype may have rounded the ends out of the Box
        box[2] = np.where(box[2] < low, np.nextafter(box[2], np.inf, dtype=dtype), box[2])
        box[3] = np.where(box[3] > high, np.nextafter(box[3], -np.inf, dtype=dtype), box[3])
    return box


def make_agent(
    env: Any, config: Any, net: Network | None, critic: Network | None, rng: Rng, *, shared: bool = False,
    agent: ActorCritic | None = None,
) -> ActorCritic:  # fmt: skip
    """Networks for the spaces of env, new ones where None; or the agent, if it fits to them."""
    d, actions = env.single_observation_space.shape[0], env.single_action_space
    discrete = hasattr(actions, "n")
    A = int(actions.n) if discrete else actions.shape[0]
    if agent is not None:
        return _fitting(agent, net, critic, d, A, discrete, shared)
    if net is None:
        net = MLP([d, *config.hidden, A + shared], optimizer=_adam(config), rng=rng)
        net.weights[-1][:A] *= 0.01
    if shared and critic is not None:
        raise ValueError("critic: got a network with shared = True, must be None: net's last output is the value")
    if critic is None and not shared:
        critic = MLP([d, *config.hidden, 1], optimizer=_adam(config), rng=rng)
    check_network("net", net, d, A + shared)
    if critic is not None:
        check_network("critic", critic, d, 1)
    normaliser = Normaliser(d, dtype=net.theta.dtype) if config.normalise_observations else None
    if discrete:
        return ActorCritic(net, critic, normaliser=normaliser)
    box = action_box(actions, scale=config.scale_actions, clip=config.clip_actions, dtype=net.theta.dtype)
    return ActorCritic(net, critic, np.zeros(A, net.theta.dtype), _adam(config), normaliser, box)


def _fitting(agent, net, critic, d, A, discrete, shared):
    """The agent; ValueError unless it is one for these spaces, and comes alone."""
    for name, given in (("net", net), ("critic", critic)):
        if given is not None:
            raise ValueError(f"{name}: got a network beside agent, must be None: the agent has its own")
    try:
        check_network("net", agent.net, d, A + shared)
        if agent.critic is not None:
            check_network("critic", agent.critic, d, 1)
    except ValueError as error:
        raise ValueError(f"agent: its {error}") from None
    if (agent.critic is None) != shared or (agent.log_std is None) != discrete:
        has = f"{'no' if agent.critic is None else 'a'} critic and {'no' if agent.log_std is None else 'a'} log_std"
        needs = f"with shared = {shared}, for {'discrete' if discrete else 'continuous'} actions"
        raise ValueError(f"agent: got one with {has}, must be one {needs}")
    return agent


def _adam(config):
    return Adam(config.lr, eps=1e-5)
