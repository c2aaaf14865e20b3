"""A longer build: PPO from advantages to a cart-pole that stays up."""

from dataclasses import dataclass

import numpy as np

from rlcore.core.types import Floats
from rlcore.envs.cartpole import cartpole_start, cartpole_step, cartpole_upright, steps_upright
from rlcore.exercises.compare import Judged
from rlcore.exercises.engine import Case, Exercise, Wrong
from rlcore.gae import gae

TITLE = "Build: PPO that balances a pole"
NOTEBOOK = "build_ppo"
INTRO = """Seven steps, about {minutes} minutes in all, to a PPO of your own that solves CartPole-v1. A step calls the functions
of those before it, yours; where one of them is wrong its check says so. It builds on [chapter 8](../08_ppo.ipynb)."""
LABELS = dict.fromkeys(("fill in", "build", "experiment"), "a step of a longer build")


@dataclass(frozen=True)
class _Linear:
    """A network of one layer, whose text can be read: x @ w."""

    w: tuple

    def __call__(self, x: Floats) -> Floats:
        return x @ np.array(self.w)

    def __repr__(self) -> str:
        return f"lambda x: x @ np.array({self.w})"


def _flags(shape, *places):
    flags = np.zeros(shape, bool)
    for place in places:
        flags[place] = True
    return flags


Exercise(
    id="ppo-advantages",
    kind="fill in",
    tier="core",
    title="Advantages",
    statement=r"""
        A rollout has $T$ steps of $N$ poles side by side. All arguments but the last two are `(T, N)`: the rewards, $\hat v$ of the state of each step, $\hat v$ of the state that it led to, and whether that state is `terminated` (fallen) or `truncated` (out of time). Return the
        generalised advantage estimates, an array `(T, N)`: from the last step back, $\hat A_t = \delta_t + \gamma \lambda \hat A_{t+1}$ with $\delta_t = R_{t+1} + \gamma \hat v(s_{t+1}) - \hat v(s_t)$. A fallen state is worth 0; nothing flows back over either ending.
    """,
    stub="""
        def advantages(rewards, values, next_values, terminated, truncated, gamma, lam):
            ...
    """,
    cases=lambda rng: [
        Case(g, gae(**g))
        for T, N, end, cut, gamma, lam in (
            (4, 2, (0, 1), (1, 0), 0.9, 0.8),
            (5, 3, (3, 0), (1, 2), 0.99, 0.95),
            (3, 2, (1, 1), (2, 0), 0.5, 0.5),
            (4, 2, (1, 0), (1, 0), 0.9, 0.8),
        )
        for g in [
            dict(
                rewards=rng.normal(size=(T, N)).round(1),
                values=(rng.normal(size=(T, N)) + 2).round(1),
                next_values=(rng.normal(size=(T, N)) + 2).round(1),
                terminated=_flags((T, N), end),
                truncated=_flags((T, N), cut),
                gamma=gamma,
                lam=lam,
            )
        ]
    ],
    hints=(
        "One row at a time, from the last to the first; `last`, an array `(N,)`, carries the advantage of the next step.",
        "`~terminated[t]` multiplies the next value, `~(terminated[t] | truncated[t])` what is carried over.",
    ),
    solution="""
        def advantages(rewards, values, next_values, terminated, truncated, gamma, lam):
            A, last = np.zeros(rewards.shape), 0.0
            for t in reversed(range(len(rewards))):
                delta = rewards[t] + gamma * next_values[t] * ~terminated[t] - values[t]
                last = delta + gamma * lam * ~(terminated[t] | truncated[t]) * last
                A[t] = last
            return A
    """,
    wrong=(
        Wrong(
            {"next_values[t] * ~terminated[t]": "next_values[t] * ~(terminated[t] | truncated[t])"},
            "an episode that was only cut is taken for a fall: its last state keeps its value",
        ),
        Wrong(
            {"next_values[t] * ~terminated[t]": "next_values[t]"},
            "a fallen state is worth 0, whatever the network says",
        ),
        Wrong(
            {" * ~(terminated[t] | truncated[t])": ""},
            "the sum runs on into the next episode: stop it at either ending",
        ),
        Wrong({"gamma * lam *": "gamma *"}, "lambda is missing: from step to step the factor is gamma times lambda"),
        Wrong({"return A": "return A + values"}, "these are the targets of the value network: advantages plus values"),
    ),
    minutes=10,
    covers=("om-gae", "alg-gae"),
)

Exercise(
    id="ppo-scale",
    kind="fill in",
    tier="core",
    title="On one scale",
    statement=r"""
        Return the advantages `A` `(T, N)` centred and scaled over the whole rollout: minus their mean, divided by their standard deviation plus $10^{-8}$. An array `(T, N)`.
    """,
    stub="""
        def scale(A):
            ...
    """,
    cases=lambda rng: [
        Case(dict(A=A), (A - A.mean()) / (A.std() + 1e-8))
        for A in [(rng.normal(size=(T, N)) + 2 * np.arange(N)).round(1) for T, N in ((4, 2), (3, 3))]
        + [np.ones((2, 2)), 1e-8 * np.eye(3)]
    ],
    hints=(
        "Both are taken over all entries: no `axis`.",
        "`(A - A.mean()) / (A.std() + 1e-8)`.",
    ),
    solution="""
        def scale(A):
            return (A - A.mean()) / (A.std() + 1e-8)
    """,
    wrong=(
        Wrong(
            {"A.mean()": "A.mean(axis=0)", "A.std()": "A.std(axis=0)"},
            "each pole is compared with itself only: take mean and deviation over the whole rollout",
        ),
        Wrong({"A.std()": "A.var()"}, "this divides by the variance: the spread must become 1"),
        Wrong({"A - A.mean()": "A"}, "the advantages are scaled, but not centred"),
    ),
    minutes=2,
    covers=("om-ppo-box", "alg-ppo-full"),
)

Exercise(
    id="ppo-log-probs",
    kind="fill in",
    tier="core",
    title="Logarithms of probabilities",
    statement=r"""
        A policy gives a row of logits for each state, `logits` `(B, A)`. Return $\ln \pi(a | s)$ of all actions, `(B, A)`: the logarithm of the softmax of each row. Logits of 1000 must do no harm.
    """,
    stub="""
        def log_probs(logits):
            ...
    """,
    cases=lambda rng: [
        Case(dict(logits=z), z - z.max(axis=1, keepdims=True) - _log_sum(z))
        for z in (
            rng.normal(size=(3, 2)).round(1),
            rng.normal(size=(2, 4)).round(1),
            np.array([[1000.0, 0.0, 990.0], [-1000.0, -1000.0, -1001.0]]),
            np.array([[0.0, 0.0, 0.0, 1000.0, 0.0], [0.0, 1000.0, 0.0, 0.0, 0.0]]),
        )
    ],
    hints=(
        "$\\ln \\pi(a) = z_a - \\ln \\sum_b e^{z_b}$; adding the same number to a row of logits changes nothing.",
        "Subtract the largest logit of each row first (`keepdims=True`), then the logarithm of the sum of exponentials.",
    ),
    solution="""
        def log_probs(logits):
            z = logits - logits.max(axis=1, keepdims=True)
            return z - np.log(np.exp(z).sum(axis=1, keepdims=True))
    """,
    wrong=(
        Wrong(
            {"logits - logits.max(axis=1, keepdims=True)": "logits"},
            "right for small logits, but the exponential of 1000 overflows: subtract the largest of each row first",
        ),
        Wrong({"z - np.log": "np.exp(z) / "}, "these are the probabilities: their logarithms are asked for"),
        Wrong(
            {"np.exp(z).sum(axis=1, keepdims=True)": "np.exp(z).sum()"}, "one sum for all states: each row has its own"
        ),
    ),
    minutes=5,
    covers=("om-softmax", "alg-ppo-full"),
)


def _log_sum(z):
    return np.log(np.exp(z - z.max(axis=1, keepdims=True)).sum(axis=1, keepdims=True))


def _act(logits, rng):
    p = np.exp(logits - logits.max(axis=1, keepdims=True))
    p /= p.sum(axis=1, keepdims=True)
    u = rng.random(len(p))
    a = np.array([np.searchsorted(np.cumsum(row), x, side="right") for row, x in zip(p, u)])
    return a, np.log(p[np.arange(len(p)), a])


Exercise(
    id="ppo-act",
    kind="fill in",
    tier="core",
    title="Actions, and how probable they were",
    statement=r"""
        Draw an action for each row of `logits` `(B, A)` with your `log_probs`, and return the pair `(actions, logp)`: the actions, whole numbers `(B,)`, and the logarithms of their probabilities `(B,)`. So that the check can follow: call `rng.random(B)` once; the action of a
        row is how many of the running sums of its probabilities are less than or equal to its number, so that with the probabilities 0.3, 0.7 the number 0.2 gives action 0 and 0.5 action 1.
    """,
    stub="""
        def act(logits, rng):
            ...
    """,
    cases=lambda rng: [
        Case(dict(logits=z, rng=np.random.default_rng(seed)), _act(z, np.random.default_rng(seed)))
        for seed, (B, A) in enumerate(((5, 2), (8, 3), (6, 4)))
        for z in [rng.normal(size=(B, A)).round(1)]
    ],
    hints=(
        "`np.exp(log_probs(logits)).cumsum(axis=1)` holds the running sums; compare each row with its number, `u[:, None]`.",
        "`(u[:, None] >= sums).sum(axis=1)` counts them; `lp[np.arange(len(lp)), a]` picks one entry a row.",
    ),
    solution="""
        def act(logits, rng):
            lp = log_probs(logits)
            u = rng.random(len(lp))
            a = (u[:, None] >= np.exp(lp).cumsum(axis=1)).sum(axis=1)
            return a, lp[np.arange(len(lp)), a]
    """,
    wrong=(
        Wrong(
            {"(u[:, None] >= np.exp(lp).cumsum(axis=1)).sum(axis=1)": "lp.argmax(axis=1)"},
            "this takes the most probable action: PPO learns from actions that are drawn",
        ),
        Wrong(
            {".cumsum(axis=1)).sum(axis=1)": ")[:, :-1].sum(axis=1)"},
            "the number is compared with the probabilities: compare it with their running sums",
        ),
        Wrong(
            {"lp[np.arange": "np.exp(lp)[np.arange"},
            "the actions are right; return the logarithms of their probabilities",
        ),
        Wrong(
            {"u[:, None] >=": "u[:, None] <", ".cumsum(axis=1)).sum": ".cumsum(axis=1))[:, :-1].sum"},
            "this counts the running sums above the number: count those at or below",
        ),
    ),
    minutes=8,
    covers=("alg-ppo-full", "eq-ppo-47"),
    uses=("ppo-log-probs",),
)


def _rollout(policy, value, x, age, T, rng):
    rows = []
    for _ in range(T):
        a, logp = _act(policy(x), rng)
        x_next = cartpole_step(x, a)
        age = age + 1
        terminated = ~cartpole_upright(x_next)
        truncated = (age >= 500) & ~terminated
        rows.append((x, a, logp, value(x), value(x_next), terminated, truncated))
        over = terminated | truncated
        x = np.array([cartpole_start(rng=rng) if stop else y for stop, y in zip(over, x_next)])
        age = np.where(over, 0, age)
    return (*map(np.array, zip(*rows)), x, age)


Exercise(
    id="ppo-rollout",
    kind="build",
    tier="core",
    title="A rollout",
    statement=r"""
        Let $N$ poles run for `T` steps. `x` `(N, 4)` holds their states, `age` `(N,)` the steps since each was set up. `policy(x)` gives logits `(N, 2)`, `value(x)` the values `(N,)`. In each step: draw actions with your `act`; `x_next = cartpole_step(x, a)`; every age grows by 1; a pole has `terminated` where
        `cartpole_upright(x_next)` is false, and is `truncated` where its age has reached 500 and it has not fallen. The poles that are over, in the order of their numbers, get a new state, `cartpole_start(rng=rng)` each, and the age 0.

        Return the tuple `(states, actions, logp, values, next_values, terminated, truncated, x, age)`: seven arrays with a row a step, `(T, N, 4)` the first and `(T, N)` the others, where `next_values` is the value of `x_next` **before** a new state takes its place; then the states and ages from which the next rollout goes on. Do not change the arguments.
    """,
    setup="import numpy as np\nfrom rlcore.envs.cartpole import cartpole_start, cartpole_step, cartpole_upright",
    stub="""
        def rollout(policy, value, x, age, T, rng):
            rows = []
            for _ in range(T):
                ...
            return (*map(np.array, zip(*rows)), x, age)
    """,
    cases=lambda rng: [
        Case(
            dict(policy=policy, value=value, x=x, age=np.array(age), T=T, rng=np.random.default_rng(seed)),
            _rollout(policy, value, x, np.array(age), T, np.random.default_rng(seed)),
        )
        for seed, (T, age) in enumerate(((3, (0, 0)), (6, (497, 10, 499)), (12, (0, 495))))
        for policy in [_Linear(((0.5, -0.5), (0.1, 0.3), (-3.0, 3.0), (-1.0, 1.0)))]
        for value in [_Linear((0.5, 1.0, -2.0, 0.5))]
        for x in [np.vstack([rng.uniform(-0.2, 0.2, (len(age) - 1, 4)).round(2), [[0.1, 0.5, 0.2, 0.6]]])]
    ],
    hints=(
        "Append a tuple of the seven to `rows` in each step; take `value(x_next)` before anything is set up anew.",
        "`x = x_next.copy()`, then `for i in np.flatnonzero(terminated | truncated): x[i] = cartpole_start(rng=rng)`, and `age = np.where(terminated | truncated, 0, age)`.",
    ),
    solution="""
        def rollout(policy, value, x, age, T, rng):
            rows = []
            for _ in range(T):
                a, logp = act(policy(x), rng)
                x_next = cartpole_step(x, a)
                age = age + 1
                terminated = ~cartpole_upright(x_next)
                truncated = (age >= 500) & ~terminated
                rows.append((x, a, logp, value(x), value(x_next), terminated, truncated))
                x = x_next.copy()
                for i in np.flatnonzero(terminated | truncated):
                    x[i] = cartpole_start(rng=rng)
                age = np.where(terminated | truncated, 0, age)
            return (*map(np.array, zip(*rows)), x, age)
    """,
    wrong=(
        Wrong(
            {"rows.append((x, a, logp, value(x), value(x_next), terminated, truncated))": "pass",
             "age = np.where(terminated | truncated, 0, age)": "rows.append((x_next, a, logp, value(x_next), value(x), terminated, truncated)); age = np.where(terminated | truncated, 0, age)"},
            "the states are those after the steps: a row holds the state in which the action was drawn",
        ),
        Wrong({"(age >= 500) & ~terminated": "age >= 500"}, "a pole that falls in its last step has fallen: it is not truncated"),
        Wrong({"(age >= 500)": "(age > 500)"}, "one step too many: an episode has at most 500 steps"),
        Wrong({"np.flatnonzero(terminated | truncated)": "np.flatnonzero(terminated)"}, "an episode that was cut goes on from its last state: it gets a new one, too"),
        Wrong({"age = np.where(terminated | truncated, 0, age)": "pass"}, "the age of a new pole is 0: without that every later step is cut"),
    ),
    minutes=20,
    covers=("alg-ppo-full", "om-ppo-box"),
    uses=("ppo-log-probs", "ppo-act"),
)  # fmt: skip


def _logits_gradient(logits, actions, logp_old, advantage, clip, c2):
    """By central differences."""

    def objective(z):
        lp = z - z.max(axis=1, keepdims=True) - _log_sum(z)
        ratio = np.exp(lp[np.arange(len(z)), actions] - logp_old)
        surrogate = np.minimum(ratio * advantage, np.clip(ratio, 1 - clip, 1 + clip) * advantage)
        return surrogate.mean() - c2 * (np.exp(lp) * lp).sum(axis=1).mean()

    gradient = np.zeros(logits.shape)
    for at in np.ndindex(logits.shape):
        h = np.zeros(logits.shape)
        h[at] = 1e-5
        gradient[at] = (objective(logits + h) - objective(logits - h)) / 2e-5
    return gradient


Exercise(
    id="ppo-gradient",
    kind="fill in",
    tier="core",
    title="The gradient at the logits",
    statement=r"""
        Return the gradient of $L^{CLIP} + c_2 S$ ({eq}`eq-ppo-49`, {eq}`eq-ppo-50`) with respect to `logits` `(B, A)`, an array of that shape: both terms are means over the $B$ steps, $S$ is the entropy of the policy. `actions`, `logp_old` and `advantage` are `(B,)`, `clip` is $\epsilon$. Use your `log_probs`.
        A step where the objective is flat, with the ratio above $1 + \epsilon$ and a positive advantage, or below $1 - \epsilon$ and a negative one, adds nothing to the first term.
    """,
    stub="""
        def logits_gradient(logits, actions, logp_old, advantage, clip, c2):
            ...
    """,
    cases=lambda rng: [
        Case(g, _logits_gradient(**g), tol=1e-6)
        for B, A, clip, c2 in ((7, 2, 0.2, 0.0), (8, 3, 0.1, 0.0), (7, 2, 0.2, 0.1), (9, 3, 0.3, 0.5))
        for z in [rng.normal(size=(B, A)).round(1)]
        for a in [rng.integers(A, size=B)]
        for g in [
            dict(
                logits=z,
                actions=a,
                logp_old=(z - z.max(axis=1, keepdims=True) - _log_sum(z))[np.arange(B), a]
                + np.resize([0.02, 0.5, -0.6, -0.01, 0.7, -0.5, 0.6], B),
                advantage=np.resize([1.0, -0.5, 0.6, -2.0, 0.8, -0.4, 2.0], B),
                clip=clip,
                c2=c2,
            )
        ]
    ],
    hints=(
        "The gradient of the ratio is the ratio times the score, $1_{a = b} - \\pi(b)$; where the objective is flat it is 0.",
        "The derivative of $S$ with respect to the logit of $b$ is $-\\pi(b) (\\ln \\pi(b) + S)$. Divide everything by $B$.",
    ),
    solution="""
        def logits_gradient(logits, actions, logp_old, advantage, clip, c2):
            lp = log_probs(logits)
            p, i = np.exp(lp), np.arange(len(lp))
            ratio = np.exp(lp[i, actions] - logp_old)
            flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
            push = np.where(flat, 0.0, ratio * advantage)
            S = -(p * lp).sum(axis=1)
            score = np.eye(p.shape[1])[actions] - p
            return (push[:, None] * score - c2 * p * (lp + S[:, None])) / len(lp)
    """,
    wrong=(
        Wrong({" / len(lp)": ""}, "the objective is a mean: each step counts one part in B"),
        Wrong({"- c2 * p": "+ c2 * p"}, "the entropy has the wrong sign: the bonus rewards a policy that is undecided"),
        Wrong({"ratio * advantage)": "advantage)"}, "the ratio is missing: it is 1 only as long as nothing has been learned"),
        Wrong(
            {"((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))": "np.abs(ratio - 1) > clip"},
            "a step that has made things worse is flat as well: it needs a gradient that leads back",
        ),
        Wrong({"np.eye(p.shape[1])[actions] - p": "np.eye(p.shape[1])[actions]"}, "the score lacks the probabilities: the other logits count, too"),
    ),
    minutes=15,
    covers=("eq-ppo-49", "eq-ppo-50", "alg-ppo-clip"),
    uses=("ppo-log-probs",),
)  # fmt: skip


def _balances(got):
    if not isinstance(got, np.ndarray) or got.shape != (226,) or got.dtype.kind != "f":
        return "the result must be the parameters of MLP([4, 32, 2]), an array of 226 numbers: bind policy.theta"
    if not np.isfinite(got).all():
        return "some parameters are no finite numbers: are the steps too large?"
    w1, b1, w2, b2 = got[:128].reshape(32, 4), got[128:160], got[160:224].reshape(2, 32), got[224:]
    starts = np.random.default_rng(475).uniform(-0.05, 0.05, (100, 4))
    steps = steps_upright(lambda x: (np.tanh(x @ w1.T + b1) @ w2.T + b2).argmax(axis=1), starts, 500).mean()
    return (
        None if steps >= 475 else f"in 100 episodes the pole stays up for {steps:.0f} steps on average, 475 are wanted"
    )


SETUP = """
import numpy as np
from rlcore.envs.cartpole import cartpole_start
from rlcore.nn import MLP
from rlcore.optimizers import Adam
"""
START = """
def learn(n_rollouts, rng):
    policy = MLP([4, 32, 2], optimizer=Adam(3e-3), dtype=np.float64, rng=rng)
    net = MLP([4, 32, 1], optimizer=Adam(3e-3), dtype=np.float64, rng=rng)
    x, age = np.array([cartpole_start(rng=rng) for _ in range(16)]), np.zeros(16, int)
    for _ in range(n_rollouts):
"""
LOOP = """
        value = lambda s: net.forward(s)[:, 0]
        states, actions, logp, V, V_next, fell, cut, x, age = rollout(policy.forward, value, x, age, 64, rng)
        A = advantages(np.ones(V.shape), V, V_next, fell, cut, 0.99, 0.95)
        target, A = (A + V).ravel(), scale(A).ravel()
        states, actions, logp = states.reshape(-1, 4), actions.ravel(), logp.ravel()
        for _ in range(8):
            for part in np.array_split(rng.permutation(len(A)), 4):
                logits = policy.forward(states[part])
                ascent = logits_gradient(logits, actions[part], logp[part], A[part], 0.2, 0.0)
                policy.step(-policy.backward(ascent))
                error = net.forward(states[part]) - target[part, None]
                net.step(net.backward(2 * error / len(part)))
"""

Exercise(
    id="ppo-solved",
    kind="experiment",
    tier="core",
    title="The pole stays up",
    statement=r"""
        Join the steps. Each round: a rollout of 64 steps with 16 poles (`policy.forward` gives logits, `net.forward` values with one column); the reward of every step is 1; advantages with $\gamma = 0.99$ and $\lambda = 0.95$; the value network's targets, advantages plus values, and then the scaled advantages. Then 8 epochs, each in 4 minibatches of shuffled steps:
        the policy climbs, with $\epsilon = 0.2$ and $c_2 = 0$, and the value network descends on the mean squared error. `net.backward(d)` takes the derivative with respect to the outputs and returns the gradient, `net.step(gradient)` makes a step of Adam **down** it.

        Bind `pole_policy` to the parameters of the policy, an array of 226 numbers. The check lets it balance 100 poles, always with the likelier action: CartPole-v1 counts as solved when they stay up for 475 of 500 steps on average. About 50 rounds will do, a few seconds.
    """,
    setup=SETUP,
    stub=START + "        ...\n    return policy.theta\n\n\npole_policy = ...",
    cases=lambda rng: [Case({}, Judged("a policy under which poles stay up for 475 of 500 steps on average", _balances))],
    hints=(
        "For the policy: `policy.forward(states[part])`, then `policy.step(-policy.backward(ascent))`, with a minus, since the optimizer descends and you climb.",
        "The rollout's arrays are `(64, 16)`: flatten them once, `A.ravel()`, `states.reshape(-1, 4)`, and let `rng.permutation(1024)` choose the minibatches.",
    ),
    solution=START + LOOP.strip("\n") + "\n    return policy.theta\n\n\npole_policy = learn(50, np.random.default_rng(0))",
    wrong=(
        Wrong({"learn(50,": "learn(0,"}, "nothing was learned yet: these are the parameters that the generator gave"),
        Wrong({"learn(50,": "learn(3,"}, "after 3 rounds the policy is only a beginning: let it learn for 50"),
        Wrong({"-policy.backward": "policy.backward"}, "the policy descends on its objective: put a minus before its gradient"),
    ),
    minutes=30,
    covers=("alg-ppo-full", "alg-ppo-clip"),
    uses=("ppo-advantages", "ppo-scale", "ppo-log-probs", "ppo-act", "ppo-rollout", "ppo-gradient"),
)  # fmt: skip
