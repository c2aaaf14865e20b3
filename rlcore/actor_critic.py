"""One-step actor-critic, for a policy that is linear in features and for a network (chapter 7)."""

from __future__ import annotations

import numpy as np

from rlcore.core.learner import learner, log, note
from rlcore.core.results import Run
from rlcore.core.rules import checked
from rlcore.core.running import Watch, watched
from rlcore.core.schedules import at
from rlcore.core.types import ArrayLike, Network, OnEpisode, Rate, Rng, World
from rlcore.core.worlds import MOST_STEPS, Guard, act, reset, say_cut
from rlcore.distributions import Categorical
from rlcore.policies import LINEAR, add_score, choose, dot, gradient, probabilities
from rlcore.reinforce import NETWORKS, make_networks
from rlcore.td import td_error


@learner(gradient, **LINEAR)
def actor_critic(
    world: World, gamma: float, n_episodes: int, *, alpha: Rate = 0.01, alpha_w: Rate = 0.01,
    features: ArrayLike | None = None, theta0: ArrayLike = 0.0, w0: ArrayLike = 0.0, discount_states: bool = False,
    p_min: float = 0.0, max_steps: int | None = None, record: int = 0, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """One-step actor-critic: after each step, delta = R + gamma v_hat(S') - v_hat(S) moves both.

    alpha_w = 0 leaves v_hat at w0. A step that truncates the episode bootstraps like any other.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : Rate
        Step size, or decaying(...) with the episodes.
    alpha_w : Rate
        Step size of v_hat.
    features : ArrayLike | None
        x, (S, d), of policy and v_hat; one a state where None.
    theta0 : ArrayLike
        A number or (A, d).
    w0 : ArrayLike
        A number or (d,).
    discount_states : bool
        With the gamma^t of the theorem.
    p_min : float
        Floor of the probabilities.
    max_steps : int | None
        An episode that long is cut; None: a million steps, where the policy ends every episode.
    record : int
        history keeps theta before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Run
        weights is theta, V is v_hat.

    Notes
    -----
    Ledger: alg-actor-critic, cl-112, om-baseline-update.

    References
    ----------
    Barto, Sutton and Anderson (1983); Sutton and Barto (2018), section 13.5.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore.actor_critic import actor_critic
    >>> from rlcore.envs.grids import gridworld
    >>> run = actor_critic(gridworld(), 0.9, 200, alpha=0.1, alpha_w=0.1, max_steps=200, rng=np.random.default_rng(0))
    >>> bool(run.lengths[-20:].mean() < run.lengths[:20].mean())
    True
    """
    theta, w, (X, legal), pi = theta0, w0, features, np.zeros(len(theta0))
    returns, lengths, history = log(theta, n_episodes, record)
    for k in range(n_episodes):
        s, done, discount = reset(world, rng), False, 1.0
        while not done:
            a = choose(probabilities(pi, theta, X[s], legal[s], p_min), rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            delta = td_error(r, dot(w, X[s]), dot(w, X[s_next]), gamma, terminated)  # om-baseline-update
            w += at(alpha_w, k) * delta * X[s]
            add_score(theta, at(alpha, k) * discount * delta, pi, X[s], a)
            if discount_states:
                discount *= gamma
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, theta, k, record):
            break
    return theta, w, returns, lengths, history


@checked(**NETWORKS)
def actor_critic_network(
    world: World, gamma: float, n_episodes: int, *, alpha: float = 0.01, alpha_w: float = 0.01,
    net: Network | None = None, critic: Network | None = None, discount_states: bool = False,
    max_steps: int | None = None, on_episode: OnEpisode | None = None, rng: Rng,
) -> Run:  # fmt: skip
    """One-step actor-critic with two networks.

    Parameters
    ----------
    world : World
        gymnasium.Env with Box observations of shape (n,) and Discrete actions, or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    alpha : float
        Step size of the policy.
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
    Ledger: alg-actor-critic.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import actor_critic_network
    >>> actor_critic_network("CartPole-v1", 0.99, 3, rng=np.random.default_rng(0)).returns.shape
    (3,)
    """
    net, critic = make_networks(world, net, critic, alpha, alpha_w, rng)
    returns, lengths = [], []
    guard, watch = Guard(world, seed=int(rng.spawn(1)[0].integers(2**31))), Watch(n_episodes)
    most = max_steps or MOST_STEPS
    with watched(watch):
        for _ in range(n_episodes):
            s, total, n, discount, done = guard.reset(), 0.0, 0, 1.0, False
            while not done:
                policy = Categorical(net.forward(s))
                a = policy.sample(rng)
                s_next, r, terminated, truncated = guard.step(a)
                v_next = 0.0 if terminated else critic.forward(s_next)[0]
                delta = r + gamma * v_next - critic.forward(s)[0]  # om-baseline-update
                critic.step(critic.backward(np.array([-delta])))
                net.step(net.backward(-discount * delta * policy.grad_log_prob(a)))
                total, n, s = total + r, n + 1, s_next
                discount *= gamma if discount_states else 1.0
                done = terminated or truncated or n == most or bool(watch.marks[0])
            returns.append(total)
            lengths.append(n)
            if watch.ended(returns, lengths, on_episode):
                break
    say_cut(lengths, most, 4)
    return watch.left(Run(np.array(returns, float), np.array(lengths), V=critic, policy=net))
