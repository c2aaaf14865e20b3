"""A longer build: a network from one neuron to a player that learns by REINFORCE."""

from functools import cache

import numpy as np

from rlcore.envs.catch import catch, catch_pixels
from rlcore.exercises.compare import Judged
from rlcore.exercises.engine import Case, Exercise, Wrong

TITLE = "Build: a network that learns to catch"
NOTEBOOK = "build_network"
INTRO = """Nine steps, about {minutes} minutes in all, from one neuron to a network of your own that learns the game Catch by
REINFORCE. A step calls the functions of those before it, yours; where one of them is wrong its check says so. It builds on
[chapter 6](../06_neural_networks.ipynb) and [chapter 7](../07_reinforce.ipynb)."""
LABELS = dict.fromkeys(("fill in", "build", "experiment"), "a step of a longer build")


def _theta(rng, n, m, k):
    return tuple(rng.normal(size=shape).round(1) for shape in ((m, n), (m,), (k, m), (k,)))


def _forward(theta, x):
    w1, b1, w2, b2 = theta
    hidden = np.tanh(np.array([[w1[j] @ row + b1[j] for j in range(len(b1))] for row in x]))
    return hidden, np.array([[w2[j] @ row + b2[j] for j in range(len(b2))] for row in hidden])


def _softmax(logits):
    p = np.exp(logits - logits.max(axis=1, keepdims=True))
    return p / p.sum(axis=1, keepdims=True)


def _slopes(theta, f):
    """The gradient of f(theta) by central differences."""
    gradients = []
    for part, w in enumerate(theta):
        gradient = np.zeros(w.shape)
        for at in np.ndindex(w.shape):
            h = np.zeros(w.shape)
            h[at] = 1e-5
            up, down = (f((*theta[:part], w + sign * h, *theta[part + 1 :])) for sign in (1, -1))
            gradient[at] = (up - down) / 2e-5
        gradients.append(gradient)
    return tuple(gradients)


FAR = np.array([[0.0, 0, 0, 1000, 0], [0, 1000, 0, 0, 0]])
WHOLE = np.array([[1, 0], [0, 2], [3, -1]])  # of integers, whose returns are none


Exercise(
    id="network-neuron",
    kind="fill in",
    tier="core",
    title="One neuron",
    statement=r"""
        A neuron with the weights `w` `(n,)` and the bias `b` sees the input `x` `(n,)`. Return its activation, the number $\tanh(w \cdot x + b)$.
    """,
    stub="""
        def neuron(w, b, x):
            ...
    """,
    cases=lambda rng: [
        Case(dict(w=w, b=b, x=x), float(np.tanh(sum(p * q for p, q in zip(w, x)) + b)))
        for n, b in ((2, 0.5), (3, -1.0), (4, 0.3))
        for w, x in [rng.normal(size=(2, n)).round(1)]
    ],
    hints=("The weighted input is `w @ x + b`.", "`np.tanh` is the hyperbolic tangent."),
    solution="""
        def neuron(w, b, x):
            return float(np.tanh(w @ x + b))
    """,
    wrong=(
        Wrong({"np.tanh(w @ x + b)": "(w @ x + b)"}, "this is the weighted input: the tanh is missing"),
        Wrong({" + b": ""}, "the bias is missing"),
        Wrong({"np.tanh(w @ x + b)": "1 / (1 + np.exp(-(w @ x + b)))"}, "this is a sigmoid neuron: its activation lies between 0 and 1, here between -1 and 1"),
    ),
    minutes=2,
    covers=("eq-nn-23", "eq-nn-29"),
)  # fmt: skip

Exercise(
    id="network-layer",
    kind="fill in",
    tier="core",
    title="A layer of them",
    statement=r"""
        `w` `(m, n)` and `b` `(m,)` are the weights and biases of $m$ neurons, `x` `(B, n)` holds a sample a row. Return the activations, an array `(B, m)`: row $i$, column $j$ is what neuron $j$ makes of sample $i$. Call your `neuron`, or compute all at once.
    """,
    stub="""
        def layer(w, b, x):
            ...
    """,
    cases=lambda rng: [
        Case(dict(w=w, b=b, x=x), _forward((w, b, np.eye(m), np.zeros(m)), x)[0])
        for B, m, n in ((2, 3, 2), (4, 2, 3), (3, 3, 3))
        for w, b, x in [
            (rng.normal(size=(m, n)).round(1), rng.normal(size=m).round(1), rng.normal(size=(B, n)).round(1))
        ]
    ],
    hints=(
        "`np.array([[neuron(w[j], b[j], row) for j in range(len(b))] for row in x])` is right, and slow.",
        "All at once: `x @ w.T + b`, and the tanh of it.",
    ),
    solution="""
        def layer(w, b, x):
            return np.tanh(x @ w.T + b)
    """,
    wrong=(
        Wrong({"x @ w.T + b": "x @ w.T"}, "the biases are missing"),
        Wrong({"np.tanh(x @ w.T + b)": "x @ w.T + b"}, "these are the weighted inputs: the tanh is missing"),
        Wrong(
            {"np.tanh(x @ w.T + b)": "np.tanh(x @ w.T + b).T"}, "the result is `(m, B)`: a sample a row is asked for"
        ),
    ),
    minutes=4,
    covers=("eq-nn-30", "eq-u-layer-matrix"),
    uses=("network-neuron",),
)

Exercise(
    id="network-forward",
    kind="fill in",
    tier="core",
    title="Forward",
    statement=r"""
        The network has a hidden layer and a linear output. Its parameters are the tuple `theta = (w1, b1, w2, b2)`, of shapes `(m, n)`, `(m,)`, `(k, m)` and `(k,)`. Return the pair `(hidden, logits)` for `x` `(B, n)`: the activations of the hidden layer, by your `layer`, `(B, m)`, and the outputs `(B, k)`.
    """,
    stub="""
        def forward(theta, x):
            w1, b1, w2, b2 = theta
            ...
    """,
    cases=lambda rng: [
        Case(dict(theta=theta, x=x), _forward(theta, x))
        for B, n, m, k in ((2, 3, 2, 2), (3, 2, 4, 3))
        for theta, x in [(_theta(rng, n, m, k), rng.normal(size=(B, n)).round(1))]
    ],
    hints=(
        "`hidden = layer(w1, b1, x)`.",
        "The output is linear: weighted inputs of the last layer, without a tanh.",
    ),
    solution="""
        def forward(theta, x):
            w1, b1, w2, b2 = theta
            hidden = layer(w1, b1, x)
            return hidden, hidden @ w2.T + b2
    """,
    wrong=(
        Wrong({"hidden @ w2.T + b2": "layer(w2, b2, hidden)"}, "the output has a tanh: it is linear here, so that logits can be large"),
        Wrong({"hidden @ w2.T + b2": "hidden @ w2.T"}, "the biases of the output are missing"),
        Wrong({"return hidden,": "return x @ w1.T + b1,"}, "the first of the two must be the activations, not the weighted inputs"),
    ),
    minutes=4,
    covers=("alg-mlp-forward", "eq-nn-31"),
    uses=("network-neuron", "network-layer"),
)  # fmt: skip

Exercise(
    id="network-softmax",
    kind="fill in",
    tier="core",
    title="From outputs to probabilities",
    statement=r"""
        Return the softmax of each row of `logits` `(B, k)`, an array `(B, k)` whose rows sum to 1. Logits of 1000 must do no harm.
    """,
    stub="""
        def softmax(logits):
            ...
    """,
    cases=lambda rng: [
        Case(dict(logits=z), _softmax(z))
        for z in (rng.normal(size=(3, 2)).round(1), rng.normal(size=(2, 4)).round(1), np.array([[1000.0, 0, 999], [-999, -1000, -1000]]), FAR)
    ],
    hints=(
        "Subtract the largest logit of each row before the exponential.",
        "`keepdims=True` keeps the shapes compatible, in the maximum and in the sum.",
    ),
    solution="""
        def softmax(logits):
            p = np.exp(logits - logits.max(axis=1, keepdims=True))
            return p / p.sum(axis=1, keepdims=True)
    """,
    wrong=(
        Wrong({"logits - logits.max(axis=1, keepdims=True)": "logits"}, "right for small logits, but the exponential of 1000 overflows"),
        Wrong({"logits.max(axis=1, keepdims=True)": "logits.max()"}, "one largest logit for all rows: a row far below it becomes 0 / 0"),
        Wrong({"p.sum(axis=1, keepdims=True)": "p.sum()"}, "the whole array sums to 1: each row must"),
    ),
    minutes=4,
    covers=("om-softmax",),
)  # fmt: skip

Exercise(
    id="network-backward",
    kind="fill in",
    tier="core",
    title="Backward",
    statement=r"""
        Backpropagation: `d_logits` `(B, k)` holds the derivatives of some number $J$ with respect to the logits of `x` `(B, n)`. Return its gradient with respect to the four parameters, a tuple of arrays shaped as `theta`, **summed** over the samples. Get the hidden activations from your `forward`.
    """,
    stub="""
        def backward(theta, x, d_logits):
            w1, b1, w2, b2 = theta
            ...
    """,
    cases=lambda rng: [
        Case(dict(theta=theta, x=x, d_logits=d), _slopes(theta, lambda t, x=x, d=d: (_forward(t, x)[1] * d).sum()), tol=1e-6)
        for B, n, m, k in ((1, 3, 2, 2), (3, 2, 4, 3), (4, 3, 3, 3))
        for theta, x, d in [(_theta(rng, n, m, k), rng.normal(size=(B, n)).round(1), rng.normal(size=(B, k)).round(1))]
    ],
    hints=(
        "The output is linear: its error is `d_logits`. The error of the hidden layer is `d_logits @ w2` times the slope of the tanh.",
        "The slope of the tanh is `1 - hidden**2`. Gradients: `delta.T @ activations` for weights, `delta.sum(axis=0)` for biases.",
    ),
    solution="""
        def backward(theta, x, d_logits):
            w1, b1, w2, b2 = theta
            hidden, _ = forward(theta, x)
            delta = d_logits @ w2 * (1 - hidden**2)
            return delta.T @ x, delta.sum(axis=0), d_logits.T @ hidden, d_logits.sum(axis=0)
    """,
    wrong=(
        Wrong({" * (1 - hidden**2)": ""}, "the slope of the tanh is missing"),
        Wrong({"1 - hidden**2": "hidden * (1 - hidden)"}, "this is the slope of a sigmoid: that of the tanh is 1 - a squared"),
        Wrong({"delta.sum(axis=0)": "delta.mean(axis=0)", "d_logits.sum(axis=0)": "d_logits.mean(axis=0)"}, "the biases are averaged over the samples, the weights summed: sum both"),
        Wrong({"d_logits.T @ hidden": "d_logits.T @ np.arctanh(hidden)"}, "the output sees the activations of the hidden layer, not its weighted inputs"),
    ),
    minutes=12,
    covers=("alg-backprop", "eq-nn-35", "eq-nn-36", "eq-nn-37"),
    uses=("network-neuron", "network-layer", "network-forward"),
)  # fmt: skip


@cache
def _world():
    mdp = catch()
    return mdp.next_state[:, :, 0], mdp.reward[:, :, 0], catch_pixels().astype(float)


def _play(theta, s, rng):
    next_state, reward, pixels = _world()
    rows = []
    for _ in range(9):
        p = _softmax(_forward(theta, pixels[s])[1])
        u = rng.random(len(s))
        a = np.array([np.searchsorted(np.cumsum(row), x, side="right") for row, x in zip(p, u)])
        rows.append((s, a, reward[s, a]))
        s = next_state[s, a]
    return tuple(map(np.array, zip(*rows)))


WORLD = """
import numpy as np
from rlcore.envs.catch import catch, catch_pixels
game, pixels = catch(), catch_pixels().astype(float)
next_state, reward = game.next_state[:, :, 0], game.reward[:, :, 0]
"""

Exercise(
    id="network-play",
    kind="build",
    tier="core",
    title="Play",
    statement=r"""
        In Catch a ball falls nine rows, and a paddle moves left, stays or moves right; a catch pays 1, a miss $-1$. `pixels[s]` is what the network sees of state `s`, `next_state[s, a]` and `reward[s, a]` say what follows; all three are arrays, so that `s` and `a` may be arrays of many games. Play `len(s)` games at once from the states `s` `(N,)`, nine moves
        each. So that the check can follow: in each move compute the probabilities by your `forward` and `softmax`, call `rng.random(N)` once, and take as the action of a game how many of the running sums of its probabilities are less than or equal to its number. Return `(states, actions, rewards)`, three arrays `(9, N)`.
    """,
    setup=WORLD,
    stub="""
        def play(theta, s, rng):
            rows = []
            for _ in range(9):
                ...
            return tuple(map(np.array, zip(*rows)))
    """,
    cases=lambda rng: [
        Case(dict(theta=theta, s=s, rng=np.random.default_rng(seed)), _play(theta, s, np.random.default_rng(seed)))
        for seed in (0, 1)
        for theta, s in [(_theta(rng, 50, 3, 3), rng.choice(np.flatnonzero(catch().start), 4))]
    ],
    hints=(
        "`p = softmax(forward(theta, pixels[s])[1])`; the running sums are `p.cumsum(axis=1)`.",
        "`a = (u[:, None] >= p.cumsum(axis=1)).sum(axis=1)`; append `(s, a, reward[s, a])`, then `s = next_state[s, a]`.",
    ),
    solution="""
        def play(theta, s, rng):
            rows = []
            for _ in range(9):
                p = softmax(forward(theta, pixels[s])[1])
                u = rng.random(len(s))
                a = (u[:, None] >= p.cumsum(axis=1)).sum(axis=1)
                rows.append((s, a, reward[s, a]))
                s = next_state[s, a]
            return tuple(map(np.array, zip(*rows)))
    """,
    wrong=(
        Wrong({"(u[:, None] >= p.cumsum(axis=1)).sum(axis=1)": "p.argmax(axis=1)"}, "this takes the most probable action: REINFORCE learns from actions that are drawn"),
        Wrong({"rows.append((s, a, reward[s, a]))": "rows.append((next_state[s, a], a, reward[s, a]))"}, "the states are those after the moves: a row holds the state in which the action was drawn"),
        Wrong({"forward(theta, pixels[s])[1]": "np.tanh(forward(theta, pixels[s])[1])"}, "the softmax must get the logits as they are"),
    ),
    minutes=12,
    covers=("ex-outcome", "alg-reinforce"),
    uses=("network-neuron", "network-layer", "network-forward", "network-softmax"),
)  # fmt: skip

Exercise(
    id="network-returns",
    kind="fill in",
    tier="core",
    title="What came of it",
    statement=r"""
        Return the discounted returns of `rewards` `(T, N)`, a game a column: row $t$ holds $G_t = R_{t+1} + \gamma G_{t+1}$ of every game, and nothing follows the last row. An array `(T, N)`.
    """,
    stub="""
        def returns(rewards, gamma):
            ...
    """,
    cases=lambda rng: [
        Case(dict(rewards=R, gamma=gamma), np.array([sum(gamma**k * R[t + k] for k in range(len(R) - t)) for t in range(len(R))]))
        for R, gamma in (*((rng.normal(size=(T, N)).round(1), gamma) for T, N, gamma in ((3, 2, 0.5), (4, 3, 0.9), (2, 4, 1.0))), (WHOLE, 0.9))
    ],
    hints=(
        "Backward over the rows: `following = rewards[t] + gamma * following`.",
        "`following` starts at 0 and is an array of `N` numbers from the first row on.",
    ),
    solution="""
        def returns(rewards, gamma):
            G, following = np.zeros(rewards.shape), 0.0
            for t in reversed(range(len(rewards))):
                following = rewards[t] + gamma * following
                G[t] = following
            return G
    """,
    wrong=(
        Wrong({"reversed(range(len(rewards)))": "range(len(rewards))"}, "the pass runs forward: it adds up past rewards"),
        Wrong({"gamma * following": "following"}, "gamma is missing"),
        Wrong({"rewards[t] + gamma * following": "gamma * (rewards[t] + following)"}, "the first reward is discounted already"),
    ),
    minutes=4,
    covers=("eq-rf-38", "alg-returns"),
)  # fmt: skip


def _log_likelihood(theta, x, actions, weight):
    p = _softmax(_forward(theta, x)[1])
    return (weight * np.log(p[np.arange(len(p)), actions])).sum()


Exercise(
    id="network-gradient",
    kind="fill in",
    tier="core",
    title="The gradient of REINFORCE",
    statement=r"""
        Return the gradient with respect to `theta` of $\sum_i g_i \ln \pi_\theta(a_i | x_i)$, a tuple of four arrays: `x` `(B, n)` holds what the network saw, `actions` `(B,)` what it did, `weight` `(B,)` the numbers $g_i$, returns minus a baseline. Use your `forward`, `softmax` and `backward`.
    """,
    stub="""
        def reinforce_gradient(theta, x, actions, weight):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(theta=theta, x=x, actions=a, weight=g), _slopes(theta, lambda t, x=x, a=a, g=g: _log_likelihood(t, x, a, g)), tol=1e-6
        )
        for B, n, m, k in ((1, 3, 2, 2), (4, 2, 3, 3), (3, 3, 3, 3))
        for theta, x in [(_theta(rng, n, m, k), rng.normal(size=(B, n)).round(1))]
        for a, g in [(rng.integers(k, size=B), rng.normal(size=B).round(1))]
    ],
    hints=(
        "The derivative of $\\ln \\pi(a)$ with respect to the logits is the score: 1 at the place of $a$, minus the probabilities.",
        "`d_logits = weight[:, None] * (np.eye(k)[actions] - p)`, and `backward` does the rest.",
    ),
    solution="""
        def reinforce_gradient(theta, x, actions, weight):
            p = softmax(forward(theta, x)[1])
            score = np.eye(p.shape[1])[actions] - p
            return backward(theta, x, weight[:, None] * score)
    """,
    wrong=(
        Wrong({"np.eye(p.shape[1])[actions] - p": "np.eye(p.shape[1])[actions]"}, "the score lacks the probabilities"),
        Wrong({"weight[:, None] * score": "score"}, "the weights are missing: a good action and a bad one would be pushed alike"),
        Wrong({"np.eye(p.shape[1])[actions] - p": "p - np.eye(p.shape[1])[actions]"}, "the sign is turned round: this is the gradient of a cost"),
    ),
    minutes=8,
    covers=("alg-reinforce", "om-score"),
    uses=("network-neuron", "network-layer", "network-forward", "network-softmax", "network-backward"),
)  # fmt: skip


def _catches(got):
    shapes = [(32, 50), (32,), (3, 32), (3,)]
    if not isinstance(got, (tuple, list)) or [getattr(w, "shape", None) for w in got] != shapes:
        return f"the result must be a tuple of four arrays of shapes {shapes}"
    if not all(w.dtype.kind == "f" and np.isfinite(w).all() for w in got):
        return "some parameters are no finite numbers: are the steps too large?"
    starts = np.repeat(np.flatnonzero(catch().start), 200)
    share = (_play(got, starts, np.random.default_rng(95))[2][-1] > 0).mean()
    return None if share >= 0.95 else f"it catches {100 * share:.0f} of 100 balls, 95 are wanted"


START = """
def learn(n_updates, rng):
    theta = [0.05 * rng.normal(size=(32, 50)), np.zeros(32), 0.05 * rng.normal(size=(3, 32)), np.zeros(3)]
    starts = np.flatnonzero(game.start)
    for _ in range(n_updates):
"""
LOOP = """
        states, actions, rewards = play(theta, rng.choice(starts, 64), rng)
        G = returns(rewards, 0.9)
        weight = (G - G.mean(axis=1, keepdims=True)).ravel()
        gradient = reinforce_gradient(theta, pixels[states.ravel()], actions.ravel(), weight)
        theta = [w + 0.008 * d for w, d in zip(theta, gradient)]
"""

Exercise(
    id="network-catches",
    kind="experiment",
    tier="core",
    title="It learns to catch",
    statement=r"""
        Join the steps: in each update play 64 games from states drawn by `rng.choice(starts, 64)`, take the returns with $\gamma = 0.9$, subtract from each row its mean over the games, the baseline, and let every parameter climb by 0.008 times the gradient that is summed over all moves of all games. Bind `theta_catch` to the parameters, a tuple or list of four
        arrays of the shapes in the stub. The check lets the network play 1000 games, with actions drawn from its probabilities: it should catch 95 of 100 balls. About 400 updates will do, a few seconds.
    """,
    setup=WORLD,
    stub=START + "        ...\n    return theta\n\n\ntheta_catch = ...",
    cases=lambda rng: [Case({}, Judged("a network that catches 95 of 100 balls", _catches))],
    hints=(
        "`G.mean(axis=1, keepdims=True)` is the mean of each row; flatten the states, actions and weights alike with `ravel()`.",
        "It climbs: `theta = [w + 0.008 * d for w, d in zip(theta, gradient)]`.",
    ),
    solution=START + LOOP.strip("\n") + "\n    return theta\n\n\ntheta_catch = learn(400, np.random.default_rng(0))",
    wrong=(
        Wrong({"learn(400,": "learn(0,"}, "nothing was learned yet: these are the parameters that the generator gave"),
        Wrong({"learn(400,": "learn(20,"}, "after 20 updates the network is only a beginning: let it learn on"),
        Wrong({"w + 0.008": "w - 0.008", "learn(400,": "learn(200,"}, "this descends: it learns to miss"),
    ),
    minutes=20,
    covers=("alg-reinforce", "alg-reinforce-baseline", "ex-outcome"),
    uses=("network-neuron", "network-layer", "network-forward", "network-softmax", "network-backward", "network-play", "network-returns", "network-gradient"),
)  # fmt: skip
