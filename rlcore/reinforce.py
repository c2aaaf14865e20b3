"""REINFORCE with a softmax policy or a network, with and without baseline, and one-step actor-critic (chapter 7)."""

import numpy as np

from rlcore.compiled import compiled
from rlcore.core.extras import extra
from rlcore.experience import FOREVER, act, books, check_max_steps, reset, run_loop, spaces
from rlcore.mdp import FiniteMDP, check_count, check_function, check_gamma, check_rng, discounted_returns, is_number
from rlcore.nn import MLP, Adam, check_network
from rlcore.policies import Categorical
from rlcore.policy_gradient import (
    _add_score,
    _check_p_min,
    _check_step,
    _choose,
    _dot,
    _features,
    _parameters,
    _probabilities,
    episode_gradient,
    grad_log_softmax,
    gradient_ascent,
    gradient_estimates,
    objective,
    policy_gradient_exact,
    softmax,
    softmax_policy,
)
from rlcore.results import Run

__all__ = [
    "actor_critic", "episode_gradient", "grad_log_softmax", "gradient_ascent", "gradient_estimates", "objective",
    "policy_gradient_exact", "reinforce", "reinforce_linear", "softmax", "softmax_policy",
]  # fmt: skip

# ---------------------------------------------------------------------- learning: softmax policies


@compiled
def _reinforce(
    world,
    X,
    legal,
    gamma,
    n_episodes,
    alpha,
    alpha_w,
    b,
    theta,
    w,
    discount_states,
    every_step,
    p_min,
    max_steps,
    record,
    rng,
):
    (history, returns, lengths), pi = books(theta, n_episodes, record), np.zeros(len(theta))
    states, actions, rewards, G = np.zeros(64, np.int64), np.zeros(64, np.int64), np.zeros(64), np.zeros(65)
    for k in range(n_episodes):
        s, n, done, terminated = reset(world, rng), 0, False, False
        while not done:
            if n == states.size:  # no longer episode so far
                states, actions = np.append(states, states), np.append(actions, actions)
                rewards, G = np.append(rewards, rewards), np.append(G, G)
            states[n], actions[n] = s, _choose(_probabilities(pi, theta, X[s], legal[s], p_min), rng)
            s, rewards[n], terminated, truncated = act(world, s, actions[n], rng)
            returns[k] += rewards[n]
            n += 1
            done = terminated or truncated or n == max_steps
        lengths[k] = n
        G[n] = 0.0 if terminated else _dot(w, X[s])  # a return that was cut goes on with the estimate, if there is one
        for t in range(n - 1, -1, -1):
            G[t] = rewards[t] + gamma * G[t + 1]  # eq-u-alg2-return
        g, g_w, discount = np.zeros_like(theta), np.zeros_like(w), 1.0
        for t in range(n):
            s = states[t]
            delta = G[t] - b - _dot(w, X[s])
            _probabilities(pi, theta, X[s], legal[s], p_min)
            _add_score(g, discount * delta, pi, X[s], actions[t])  # eq-u-alg2-gradient, eq-u-reinforce-baseline
            g_w += delta * X[s]
            if every_step or t == n - 1:
                theta += alpha * g  # eq-u-alg2-update
                w += alpha_w * g_w  # om-baseline-update
                g[:] = 0.0
                g_w[:] = 0.0
            if discount_states:
                discount *= gamma
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = theta
    return returns, lengths, history


@compiled
def _actor_critic(
    world, X, legal, gamma, n_episodes, alpha, alpha_w, theta, w, discount_states, p_min, max_steps, record, rng
):
    (history, returns, lengths), pi = books(theta, n_episodes, record), np.zeros(len(theta))
    for k in range(n_episodes):
        s, done, discount = reset(world, rng), False, 1.0
        while not done:
            a = _choose(_probabilities(pi, theta, X[s], legal[s], p_min), rng)
            s_next, r, terminated, truncated = act(world, s, a, rng)
            delta = r + gamma * _dot(w, X[s_next]) * (not terminated) - _dot(w, X[s])  # om-baseline-update
            w += alpha_w * delta * X[s]
            _add_score(theta, alpha * discount * delta, pi, X[s], a)
            if discount_states:
                discount *= gamma
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if record and (k + 1) % record == 0:
            history[(k + 1) // record] = theta
    return returns, lengths, history


def reinforce(
    world, *, n_episodes, gamma=0.99, baseline=None, alpha=0.01, alpha_w=0.01, discount_states=False, max_steps=None,
    features=None, theta0=0.0, w0=0.0, every_step=False, p_min=0.0, record=1,
    net=None, critic=None, on_episode=None, rng,
):  # fmt: skip
    """Gradient ascent on J with the returns of whole episodes. alg-reinforce, alg-reinforce-baseline, fig-52, om-score

    world: FiniteMDP, gymnasium.Env or its id. alpha: step size. baseline: None; a number; or "value", a v_hat learned
    from the returns with step size alpha_w (om-baseline-update). discount_states: with the gamma^t of the theorem.
    max_steps: an episode that long is cut; its returns, like those of a truncated one, go on with v_hat of the state
    it was left in, and end there where no v_hat is learned.

    Discrete observations: softmax policy in theta . x(s), see `softmax_policy`. features: x, (S, d), of policy and
    v_hat; one a state where None. theta0: a number or (A, d). w0: a number or (d,). every_step: theta moves after each
    step of the finished episode instead of once. p_min: floor of the probabilities; without it large step sizes end in
    a policy that is all but deterministic, whose episodes may never end. record: history keeps theta before the first
    and after each record-th episode, (n_episodes // record + 1, A, d); 0 keeps none. Run.V (S,) where v_hat is learned.

    Box observations: net maps them to the logits of the actions, critic to v_hat; MLP or TorchNet with an optimizer,
    where None an MLP with 32 tanh neurons and Adam(alpha) or Adam(alpha_w). baseline may also be "time", the mean of
    the earlier episodes' G_t, or "normalised", which centres and scales the episode's own returns.
    on_episode(return, steps_so_far): called after each; True ends the training. Run.policy is net, Run.V critic.
    Source: Williams (1992); Sutton and Barto (2018), sections 13.3 and 13.4.
    """
    world, gamma, n_episodes = _world(world), check_gamma(gamma), check_count("n_episodes", n_episodes)
    alpha, alpha_w, rng = _check_step("alpha", alpha), _check_step("alpha_w", alpha_w, least=0), check_rng(rng)
    if _is_box(world):
        _only_for("FiniteMDPs", features=(features, None), theta0=(theta0, 0.0), w0=(w0, 0.0), p_min=(p_min, 0.0))
        b = _check_baseline(baseline, ("value", "time", "normalised"))
        if critic is not None and b != "value":
            raise ValueError(f'critic: got a network with baseline = {baseline!r}, needs baseline "value"')
        limit = FOREVER if max_steps is None else check_count("max_steps", max_steps)
        net, critic = _networks(world, net, critic if b == "value" else False, alpha, alpha_w, rng)
        settings = gamma, n_episodes, b, bool(discount_states), limit, on_episode, rng
        return Run(*_reinforce_network(world, net, critic, *settings), V=critic, policy=net)
    _only_for("Box observations", net=(net, None), critic=(critic, None), on_episode=(on_episode, None))
    b = _check_baseline(baseline, ("value",))
    legal, X, theta, w, p_min, limit, record = _linear(world, features, theta0, w0, p_min, max_steps, record)
    if b != "value" and w.any():
        raise ValueError(f'w0: got {w0!r} with baseline = {baseline!r}, needs baseline "value"')
    b, alpha_w = (0.0, alpha_w) if b == "value" else (b, 0.0)
    flags = bool(discount_states), bool(every_step), p_min, limit, record
    settings = X, legal, gamma, n_episodes, alpha, alpha_w, b, theta, w, *flags
    returns, lengths, history = run_loop(_reinforce, world, *settings, rng=rng)
    return _run(world, returns, lengths, X, legal, theta, w if baseline == "value" else None, p_min, history, record)


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
    alpha, alpha_w, rng = _check_step("alpha", alpha), _check_step("alpha_w", alpha_w, least=0), check_rng(rng)
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


# ---------------------------------------------------------------------- learning: networks


def _reinforce_network(env, net, critic, gamma, n_episodes, baseline, discount_states, max_steps, on_episode, rng):
    if on_episode is not None:
        check_function("on_episode", on_episode, "(return, steps so far)")
    returns, lengths, earlier = [], [], TimeBaseline()
    env.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    play = _player(env, net, max_steps, rng)
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
        if on_episode is not None and on_episode(float(returns[-1]), sum(lengths)):
            break
    return np.array(returns), np.array(lengths)


class TimeBaseline:
    """b(t): mean of G_t over the earlier episodes that were that long; 0 where there was none. fig-56"""

    def __init__(self):
        self.total, self.count = np.zeros(0), np.zeros(0)

    def __call__(self, G):
        """b(0) ... b(T-1), before G (T,) is counted in."""
        more = max(0, G.size - self.total.size)
        self.total, self.count = np.pad(self.total, (0, more)), np.pad(self.count, (0, more))
        b = self.total[: G.size] / np.maximum(self.count[: G.size], 1)
        self.total[: G.size] += G
        self.count[: G.size] += 1
        return b


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


def _player(env, net, max_steps, rng):
    """A function that plays one episode: states (T + 1, n), actions (T,), rewards (T,), terminated.

    The argmax of logits plus Gumbel noise is a draw from their softmax (Gumbel, 1954). Noise drawn ahead and the layers
    of an MLP spelt out make an action 8 times as fast as Categorical(net.forward(s)).sample(rng).
    """
    A, noise = int(env.action_space.n), np.zeros((0, 1))
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
        s, states, actions, rewards, done = env.reset()[0], [], [], [], False
        while not done:
            if i == len(noise):
                i, noise = 0, rng.gumbel(size=(4096, A)).astype(net.theta.dtype)
            a = int((logits(s) + noise[i]).argmax())
            i += 1
            states.append(s)
            actions.append(a)
            s, r, terminated, truncated, _ = env.step(a)
            rewards.append(r)
            done = terminated or truncated or len(rewards) == max_steps
        states.append(s)
        return np.array(states, net.theta.dtype), np.array(actions), np.array(rewards, float), terminated

    return play


# ---------------------------------------------------------------------- checks


def _world(world):
    """world, or the gymnasium environment of that id."""
    if not isinstance(world, str):
        return world
    with extra("gym"):
        import gymnasium as gym

    try:
        return gym.make(world, disable_env_checker=True)
    except gym.error.Error as error:
        raise ValueError(f"world: got {world!r}, must be a FiniteMDP, an environment or its id ({error})") from None


def _is_box(world):
    """Whether observations are a vector of numbers; ValueError where actions are continuous."""
    space = getattr(world, "observation_space", None)
    if hasattr(world, "action_space") and not hasattr(world.action_space, "n"):
        raise ValueError(f"world: got actions {world.action_space}, must be Discrete: the policy is a softmax")
    if isinstance(world, FiniteMDP) or space is None or hasattr(space, "n"):
        return False
    if len(space.shape or ()) != 1:
        raise ValueError(f"world: got observations {space}, must be Discrete or a Box of shape (n,)")
    return True


def _networks(env, net, critic, alpha, alpha_w, rng):
    """net and critic, made where None; critic = False: none is wanted."""
    n, A = env.observation_space.shape[0], int(env.action_space.n)
    net = _network(n, A, alpha, rng) if net is None else check_network("net", net, n, A)
    if critic is False:
        return net, None
    return net, _network(n, 1, alpha_w, rng) if critic is None else check_network("critic", critic, n, 1)


def _network(n_in, n_out, alpha, rng):
    return MLP([n_in, 32, n_out], optimizer=Adam(_check_step("alpha_w", alpha)), rng=rng)


def _linear(world, features, theta0, w0, p_min, max_steps, record):
    """Checked settings of the loops with a softmax policy."""
    legal, _ = spaces(world)
    X, p_min = _features(features, len(legal)), _check_p_min(p_min, legal.shape[1])
    theta = _parameters("theta0", theta0, (legal.shape[1], X.shape[1]))
    w = _parameters("w0", w0, (X.shape[1],))
    limit = check_max_steps(world, max_steps, legal / legal.sum(axis=1, keepdims=True))
    return legal, X, theta, w, p_min, limit, check_count("record", record, least=0)


def _run(world, returns, lengths, X, legal, theta, w, p_min, history, record):
    V = None if w is None else np.where(spaces(world)[1], 0.0, X @ w)
    policy = softmax_policy(theta, X, legal, p_min=p_min)
    return Run(returns, lengths, V=V, policy=policy, history=history if record else None)


def _check_baseline(baseline, names):
    """baseline as a name, or as a number, 0.0 for None."""
    if isinstance(baseline, str) and baseline in names:
        return baseline
    if baseline is not None and not (is_number(baseline) and np.isfinite(baseline)):
        raise ValueError(f"baseline: got {baseline!r}, must be None, a number, " + " or ".join(map(repr, names)))
    return float(baseline or 0.0)


def _only_for(where, **settings):
    """ValueError where a setting differs from its default in a world in which it means nothing."""
    for name, (value, default) in settings.items():
        if value is not default and (default is None or np.any(np.asarray(value) != default)):
            raise ValueError(f"{name}: got {value!r}, but it is only for {where}")


# ---------------------------------------------------------------------- chapter 3's form


def reinforce_linear(start, step, alive, n_actions, gamma, n_episodes, *, alpha, scale=1.0, max_steps=200, rng):
    """Policy gradient with a softmax that is linear in the state, returns to go and their mean as baseline. cl-025

    start(rng=) -> (d,) first state; step(x, a) -> next state; alive(x) -> whether to go on. Each step pays 1.
    alpha: step size; scale: (d,) or a number that divides the state, so that its parts are of order 1.
    Returns a Run; policy is W (A, d), history (n_episodes + 1, A, d). Source: Williams (1992).
    """
    gamma, max_steps, rng = check_gamma(gamma), check_count("max_steps", max_steps), check_rng(rng)
    alpha = _check_step("alpha", alpha)
    W = np.zeros((check_count("n_actions", n_actions), np.size(start(rng=rng))))
    lengths, history = [], [W]
    for _ in range(check_count("n_episodes", n_episodes)):
        x, features, gradients = start(rng=rng), [], []
        while len(features) < max_steps and alive(x):
            probs = softmax(W @ (x / scale))
            a = min(int((np.cumsum(probs) <= rng.random()).sum()), n_actions - 1)
            features.append(x / scale)
            gradients.append(np.eye(n_actions)[a] - probs)  # of log pi(a|x) with respect to the preferences
            x = step(x, a)
        G = discounted_returns(np.ones(len(features)), gamma)
        W = W + alpha * np.einsum("t,ta,td->ad", G - G.mean(), gradients, features) / len(features)
        lengths.append(len(features))
        history.append(W)
    return Run(np.array(lengths, float), np.array(lengths), policy=W, history=np.array(history))
