"""REINFORCE, with and without baseline, for a policy that is linear in features and for a network (chapter 7)."""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import numpy as np

from rlcore.core.checks import Model, check_positive, is_discrete, is_number, show
from rlcore.core.learner import learner, log, note
from rlcore.core.results import Run
from rlcore.core.rules import checked, takes_none
from rlcore.core.running import Watch, watched
from rlcore.core.schedules import at
from rlcore.core.types import ArrayLike, Floats, Given, Network, OnEpisode, Rate, Rng, Rule, World
from rlcore.core.worlds import MOST_STEPS, Guard, open_world, say_cut, total
from rlcore.distributions import Categorical
from rlcore.mdp import discounted_returns
from rlcore.nn import MLP, check_network
from rlcore.optimizers import Adam
from rlcore.policies import LINEAR, add_score, dot, gradient, probabilities
from rlcore.policy_gradient import softmax_episode

Baseline = namedtuple("Baseline", "b learned")


def _baseline(*names):
    """The rule of a baseline: None, a number, or one of the names."""

    @takes_none
    def rule(name, baseline, given):
        if isinstance(baseline, str) and baseline in names:
            return baseline
        if baseline is not None and not (is_number(baseline) and -np.inf < baseline < np.inf):
            allowed = "".join(f", {kind!r}" for kind in names)
            raise ValueError(f"{name}: got {show(baseline)}, must be None, a number{allowed}")
        return float(baseline or 0.0)

    return rule


@takes_none
def _learned_or_number(name, baseline, given):
    baseline = _baseline("value")(name, baseline, given)
    return Baseline(0.0, True) if baseline == "value" else Baseline(baseline, False)


def _w0(name, value, given):
    w = LINEAR["w0"](name, value, given)
    if w.any() and not given["baseline"].learned:
        raise ValueError(f'{name}: got {show(value)} with baseline = {given["baseline"].b}, needs baseline "value"')
    return w


@learner(gradient, **LINEAR | dict(baseline=_learned_or_number, w0=_w0))
def reinforce(
    world: World, gamma: float, n_episodes: int, *, alpha: Rate = 0.01, baseline: str | None = None,
    alpha_w: Rate = 0.01, features: ArrayLike | None = None, theta0: ArrayLike = 0.0, w0: ArrayLike = 0.0,
    every_step: bool = False, discount_states: bool = False, p_min: float = 0.0, max_steps: int | None = None,
    record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """Gradient ascent on J with the returns of whole episodes.

    The policy is a softmax in theta . x(s), see `softmax_policy`.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium.Env with Discrete spaces or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size, or decaying(...) with the episodes.
    baseline : str | None
        None; a number; or "value", a v_hat learned from the returns with step size alpha_w.
    alpha_w : Rate
        Step size of v_hat.
    features : ArrayLike | None
        x, (S, d), of policy and v_hat; one a state where None.
    theta0 : ArrayLike
        A number or (A, d).
    w0 : ArrayLike
        A number or (d,).
    every_step : bool
        theta moves after each step of the finished episode instead of once.
    discount_states : bool
        With the gamma^t of the theorem.
    p_min : float
        Floor of the probabilities; without it large step sizes end in a policy that is all but deterministic, whose
        episodes may never end.
    max_steps : int | None
        An episode that long is cut, a million steps where None; its returns, like those of a truncated one, go on with
        v_hat of the state it was left in, and end there where no v_hat is learned.
    record : int
        history keeps theta before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        weights is theta; V is v_hat where it is learned.

    Notes
    -----
    Ledger: alg-reinforce, alg-reinforce-baseline, fig-52, om-score, om-baseline-update.

    References
    ----------
    Williams (1992); Sutton and Barto (2018), sections 13.3 and 13.4.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore.envs.small import short_corridor
    >>> from rlcore.reinforce import reinforce
    >>> rng = np.random.default_rng(0)
    >>> reinforce(short_corridor(), 1.0, 200, alpha=0.01, features=[[1.0]] * 4, max_steps=200, rng=rng).weights.shape
    (2, 1)
    """
    theta, w, (b, learned), (X, legal) = theta0, w0, baseline, features
    returns, lengths, history = log(theta, n_episodes, record)
    pi, g, g_w = np.zeros(len(theta)), np.zeros_like(theta), np.zeros_like(w)
    for k in range(n_episodes):
        states, actions, rewards, terminated = softmax_episode(world, theta, X, legal, p_min, max_steps, rng)
        T = rewards.size
        returns[k], lengths[k], G = total(rewards), T, np.empty(T + 1)
        G[T] = 0.0 if terminated else dot(w, X[states[T]])  # a return that was cut goes on with the estimate
        for t in range(T - 1, -1, -1):
            G[t] = rewards[t] + gamma * G[t + 1]  # eq-u-alg2-return
        discount = 1.0
        for t in range(T):
            s = states[t]
            delta = G[t] - b - dot(w, X[s])
            probabilities(pi, theta, X[s], legal[s], p_min)
            add_score(g, discount * delta, pi, X[s], actions[t])  # eq-u-alg2-gradient, eq-u-reinforce-baseline
            g_w += delta * X[s]
            if every_step or t == T - 1:
                theta += at(alpha, k) * g  # eq-u-alg2-update
                if learned:
                    w += at(alpha_w, k) * g_w  # om-baseline-update
                g[:] = 0.0
                g_w[:] = 0.0
            if discount_states:
                discount *= gamma
        if note(world, history, theta, k, record):
            break
    return theta, w, returns, lengths, history


# ---------------------------------------------------------------------- a network


def network_world(name: str, world: Any, given: Given) -> Any:
    """The rule of an environment with Box observations (n,) and Discrete actions, or its id."""
    world = open_world(name, world)
    observations, actions = getattr(world, "observation_space", None), getattr(world, "action_space", None)
    if isinstance(world, Model) or observations is None or actions is None:
        raise ValueError(f"{name}: got {type(world).__name__}, must be a gymnasium.Env or its id")
    if not is_discrete(actions):
        raise ValueError(f"{name}: got actions {actions}, must be Discrete: the policy is a softmax")
    if not hasattr(observations, "low") or len(observations.shape or ()) != 1:
        raise ValueError(f"{name}: got observations {observations}, must be a Box of shape (n,)")
    return world


def sizes(world: Any) -> tuple[int, int]:
    """Length of an observation, and number of actions."""
    return world.observation_space.shape[0], int(world.action_space.n)


def _critic(name, critic, given):
    if given.get("baseline", "value") != "value":
        raise ValueError(f'{name}: got a network with baseline = {given["baseline"]!r}, needs baseline "value"')
    return check_network(name, critic, sizes(given["world"])[0], 1)


NETWORKS: dict[str, Rule] = (
    dict(  # the rules of net, which maps observations to logits, and of critic, which maps them to a value
        world=network_world,
        alpha=check_positive,
        alpha_w=check_positive,
        net=lambda name, net, given: check_network(name, net, *sizes(given["world"])),
        critic=_critic,
    )
)


def make_networks(
    world: Any, net: Network | None, critic: Network | bool | None, alpha: float, alpha_w: float, rng: Rng
) -> tuple[Network, Network | None]:
    """net and critic; where None, an MLP with 32 tanh neurons and Adam. critic = False: none is wanted."""
    n, A = sizes(world)
    net = MLP([n, 32, A], optimizer=Adam(alpha), rng=rng) if net is None else net
    if critic is False:
        return net, None
    return net, MLP([n, 32, 1], optimizer=Adam(alpha_w), rng=rng) if critic is None else critic


@checked(**NETWORKS, baseline=_baseline("value", "time", "normalised"))
def reinforce_network(
    world: World, gamma: float, n_episodes: int, *, alpha: float = 0.01, baseline: str | None = None,
    alpha_w: float = 0.01, net: Network | None = None, critic: Network | None = None, discount_states: bool = False,
    max_steps: int | None = None, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """REINFORCE for a policy that is a network: states are vectors, actions discrete.

    Parameters
    ----------
    world : World
        gymnasium.Env with Box observations of shape (n,), or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : float
        Step size of the policy.
    baseline : str | None
        None; a number; "value", the critic's v_hat; "time", the mean of the earlier episodes' G_t; or "normalised",
        which centres and scales the episode's own returns.
    alpha_w : float
        Step size of v_hat.
    net : Network | None
        Maps observations to the logits of the actions; MLP or TorchNet with an optimizer, where None an MLP with 32
        tanh neurons and Adam(alpha).
    critic : Network | None
        As net is, with one output and Adam(alpha_w).
    discount_states : bool
        With the gamma^t of the theorem.
    max_steps : int | None
        An episode that long is cut; None: a million steps, where the policy ends every episode.
    on_episode : OnEpisode | None
        Called as on_episode(return, steps so far) after each; True ends the training.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        policy is net, V the critic.

    Notes
    -----
    Ledger: alg-reinforce, fig-56.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import reinforce_network
    >>> reinforce_network("CartPole-v1", 0.99, 3, rng=np.random.default_rng(0)).returns.shape
    (3,)
    """
    net, critic = make_networks(world, net, critic if baseline == "value" else False, alpha, alpha_w, rng)
    returns, lengths, earlier = [], [], TimeBaseline()
    guard, watch = Guard(world, seed=int(rng.spawn(1)[0].integers(2**31))), Watch(n_episodes)
    most = max_steps or MOST_STEPS
    play = _player(guard, net, most, watch.marks, rng)
    with watched(watch):
        for _ in range(n_episodes):
            states, actions, rewards, terminated = play()
            returns.append(rewards.sum())
            lengths.append(rewards.size)
            G = discounted_returns(rewards, gamma)  # eq-u-alg2-return
            discount = gamma ** np.arange(rewards.size + 1)
            if baseline == "value":
                v = critic.forward(states)[:, 0]
                if not terminated:  # a return that was cut goes on with the estimate
                    G += discount[:0:-1] * v[-1]
                delta = G - v[:-1]
                critic.step(critic.backward(-np.append(delta, 0.0)[:, None]))  # om-baseline-update
            elif baseline == "time":
                delta = G - earlier(G)
            elif baseline == "normalised":
                delta = (G - G.mean()) / (G.std() + 1e-8)
            else:
                delta = G - baseline
            if discount_states:
                delta *= discount[:-1]
            policy = Categorical(net.forward(states[:-1]))
            g = delta[:, None] * policy.grad_log_prob(actions)  # eq-u-alg2-gradient, eq-u-reinforce-baseline
            net.step(net.backward(-g))  # eq-u-alg2-update
            if watch.ended(returns, lengths, on_episode):
                break
    say_cut(lengths, most, 4)
    return watch.left(Run(np.array(returns), np.array(lengths), V=critic, policy=net))


class TimeBaseline:
    """b(t): mean of G_t over the earlier episodes that were that long; 0 where there was none. fig-56"""

    def __init__(self) -> None:
        self.total, self.count = np.zeros(0), np.zeros(0)

    def __call__(self, G: Floats) -> Floats:
        """b(0) ... b(T-1), before G (T,) is counted in."""
        more = max(0, G.size - self.total.size)
        self.total, self.count = np.pad(self.total, (0, more)), np.pad(self.count, (0, more))
        b = self.total[: G.size] / np.maximum(self.count[: G.size], 1)
        self.total[: G.size] += G
        self.count[: G.size] += 1
        return b


def _player(guard, net, max_steps, marks, rng):
    """A function that plays one episode: states (T + 1, n), actions (T,), rewards (T,), terminated.

    The argmax of logits plus Gumbel noise is a draw from their softmax (Gumbel, 1954). Noise drawn ahead and the layers
    of an MLP spelt out make an action 8 times as fast as Categorical(net.forward(s)).sample(rng).
    """
    A, noise = int(guard.env.action_space.n), np.zeros((0, 1))
    dot, i = np.dot, 0
    if isinstance(net, MLP):
        layers = list(zip(net.weights, net.biases, net._sigma))  # views: they follow theta

    def forward(a):
        for w, b, sigma in layers:
            a = sigma(dot(w, a) + b)
        return a

    logits = forward if isinstance(net, MLP) else net.forward

    def play():
        nonlocal i, noise
        s, states, actions, rewards, done = guard.reset(), [], [], [], False
        while not done:
            if i == len(noise):
                i, noise = 0, rng.gumbel(size=(4096, A)).astype(net.theta.dtype)
            a = int((logits(s) + noise[i]).argmax())
            i += 1
            states.append(s)
            actions.append(a)
            s, r, terminated, truncated = guard.step(a)
            rewards.append(r)
            done = terminated or truncated or len(rewards) == max_steps or bool(marks[0])
        states.append(s)
        return np.array(states, net.theta.dtype), np.array(actions), np.array(rewards, float), terminated

    return play
