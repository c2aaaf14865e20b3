"""One-step actor-critic, for a policy that is linear in features and for a network (chapter 7)."""

import numpy as np

from rlcore.core.learner import learner, log, note
from rlcore.core.results import Run
from rlcore.core.rules import checked
from rlcore.core.schedules import at
from rlcore.core.worlds import act, reset
from rlcore.distributions import Categorical
from rlcore.policies import LINEAR, add_score, choose, dot, gradient, probabilities
from rlcore.reinforce import NETWORKS, make_networks
from rlcore.td import td_error


@learner(gradient, **LINEAR)
def actor_critic(
    world, gamma, n_episodes, *, alpha=0.01, alpha_w=0.01, features=None, theta0=0.0, w0=0.0, discount_states=False,
    p_min=0.0, max_steps=None, record=0, rng,
):  # fmt: skip
    """One-step actor-critic: after each step, delta = R + gamma v_hat(S') - v_hat(S) moves both. alg-actor-critic

    Arguments and result as for `reinforce`. alpha_w = 0 leaves v_hat at w0. A step that truncates the episode
    bootstraps like any other. cl-112, om-baseline-update
    Source: Barto, Sutton and Anderson (1983); Sutton and Barto (2018), section 13.5.
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
    world, gamma, n_episodes, *, alpha=0.01, alpha_w=0.01, net=None, critic=None, discount_states=False,
    max_steps=None, on_episode=None, rng,
):  # fmt: skip
    """One-step actor-critic with two networks. Arguments and result as for `reinforce_network`. alg-actor-critic"""
    net, critic = make_networks(world, net, critic, alpha, alpha_w, rng)
    returns, lengths = [], []
    world.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    for _ in range(n_episodes):
        (s, _), total, n, discount, done = world.reset(), 0.0, 0, 1.0, False
        while not done:
            policy = Categorical(net.forward(s))
            a = policy.sample(rng)
            s_next, r, terminated, truncated, _ = world.step(int(a))
            v_next = 0.0 if terminated else critic.forward(s_next)[0]
            delta = r + gamma * v_next - critic.forward(s)[0]  # om-baseline-update
            critic.step(critic.backward(np.array([-delta])))
            net.step(net.backward(-discount * delta * policy.grad_log_prob(a)))
            total, n, s = total + r, n + 1, s_next
            discount *= gamma if discount_states else 1.0
            done = terminated or truncated or n == max_steps
        returns.append(total)
        lengths.append(n)
        if on_episode is not None and on_episode(float(total), sum(lengths)):
            break
    return Run(np.array(returns, float), np.array(lengths), V=critic, policy=net)
