"""One-step actor-critic (chapter 7)."""

import numpy as np

from rlcore.core.checks import check_count, check_function, check_gamma, check_rng
from rlcore.core.compiled import compiled
from rlcore.core.results import Run
from rlcore.core.worlds import FOREVER, act, books, reset, run_loop
from rlcore.policies import Categorical, add_score, check_step, choose, dot, probabilities
from rlcore.reinforce import _is_box, _linear, _networks, _only_for, _run, _world


@compiled
def _actor_critic(
    world, X, legal, gamma, n_episodes, alpha, alpha_w, theta, w, discount_states, p_min, max_steps, record, rng
):
    (history, returns, lengths), pi = books(theta, n_episodes, record), np.zeros(len(theta))
    for k in range(n_episodes):
        s, done, discount = reset(world, rng), False, 1.0
        while not done:
            a = choose(probabilities(pi, theta, X[s], legal[s], p_min), rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            delta = r + gamma * dot(w, X[s_next]) * (not terminated) - dot(w, X[s])  # om-baseline-update
            w += alpha_w * delta * X[s]
            add_score(theta, alpha * discount * delta, pi, X[s], a)
            if discount_states:
                discount *= gamma
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = theta
    return returns, lengths, history


def actor_critic(
    world, *, n_episodes, gamma=0.99, alpha=0.01, alpha_w=0.01, discount_states=False, max_steps=None,
    features=None, theta0=0.0, w0=0.0, p_min=0.0, record=1, net=None, critic=None, on_episode=None, rng,
):  # fmt: skip
    """One-step actor-critic: after each step, delta = R + gamma v_hat(S') - v_hat(S) moves both. alg-actor-critic

    Arguments and result as for `reinforce`. alpha_w = 0 leaves v_hat at w0. A step that truncates the episode
    bootstraps like any other. cl-112, om-baseline-update
    Source: Barto, Sutton and Anderson (1983); Sutton and Barto (2018), section 13.5.
    """
    world, gamma, n_episodes = _world(world), check_gamma(gamma), check_count("n_episodes", n_episodes)
    alpha, alpha_w, rng = check_step("alpha", alpha), check_step("alpha_w", alpha_w, least=0), check_rng(rng)
    if _is_box(world):
        _only_for("FiniteMDPs", features=(features, None), theta0=(theta0, 0.0), w0=(w0, 0.0), p_min=(p_min, 0.0))
        limit = FOREVER if max_steps is None else check_count("max_steps", max_steps)
        net, critic = _networks(world, net, critic, alpha, alpha_w, rng)
        settings = gamma, n_episodes, bool(discount_states), limit, on_episode, rng
        return Run(*_actor_critic_network(world, net, critic, *settings), V=critic, policy=net)
    _only_for("Box observations", net=(net, None), critic=(critic, None), on_episode=(on_episode, None))
    legal, X, theta, w, p_min, limit, record = _linear(world, features, theta0, w0, p_min, max_steps, record)
    settings = X, legal, gamma, n_episodes, alpha, alpha_w, theta, w, bool(discount_states), p_min, limit, record
    returns, lengths, history = run_loop(_actor_critic, world, *settings, rng=rng)
    return _run(world, returns, lengths, X, legal, theta, w, p_min, history, record)


def _actor_critic_network(env, net, critic, gamma, n_episodes, discount_states, max_steps, on_episode, rng):
    if on_episode is not None:
        check_function("on_episode", on_episode, "(return, steps so far)")
    returns, lengths = [], []
    env.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    for _ in range(n_episodes):
        (s, _), total, n, discount, done = env.reset(), 0.0, 0, 1.0, False
        while not done:
            policy = Categorical(net.forward(s))
            a = policy.sample(rng)
            s_next, r, terminated, truncated, _ = env.step(int(a))
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
    return np.array(returns, float), np.array(lengths)
