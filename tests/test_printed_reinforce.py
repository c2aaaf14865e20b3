"""The equations of chapter 7 as they stand on the page, evaluated along episodes and compared with rlcore.

The gradients on the page are central differences of the probabilities and of J, which rlcore's closed forms must meet.
Episodes run down a tree: no state is met twice, and what a step changes does not reach the next.
"""

import itertools
import re
from functools import cache

import numpy as np
import pytest
from latex import NOTICED, Scope, broken, inline, printed, sides, unnamed

from rlcore.actor_critic import actor_critic
from rlcore.bellman import policy_matrix, q_from_v, solve_policy
from rlcore.distributions import Categorical
from rlcore.envs import random_mdp, short_corridor
from rlcore.mdp import FiniteMDP, discounted_returns
from rlcore.neurons import softmax
from rlcore.policies import grad_log_softmax, softmax_policy
from rlcore.policy_gradient import episode_gradient, gradient_ascent, objective, policy_gradient_exact
from rlcore.reinforce import reinforce

PAGE = "07_reinforce"
T, GAMMA, ALPHA, ALPHA_W = 2, 0.7, 0.3, 0.2  # T is the last step, as on the page
N = 2 ** (T + 1) - 1  # inner nodes of the tree; N + 1 leaves
INLINE = {
    "eq-u-alg2-return": r"R_t(\tau) =",
    "eq-u-alg2-gradient": r"g \leftarrow g",
    "eq-u-alg2-update": r"\theta \leftarrow",
}
PARTS = {  # of two equations side by side
    "om-score": ("om-score", 0),
    "om-score identity": ("om-score", 1),
    "om-baseline-update": ("om-baseline-update", 0),
    "om-baseline-update error": ("om-baseline-update", 1),
}
UPDATES = {  # name: the symbol on the left, the one that changes
    "eq-u-reinforce": r"\boldsymbol\theta_{t+1}",
    "eq-u-reinforce-baseline": r"\theta_{t+1}",
    "eq-u-alg2-gradient": "g",
    "om-baseline-update": "w",
}
LEFT = {  # compared as text
    **UPDATES,
    "eq-rf-39": r"J(\pi_\theta)",
    "eq-u-alg2-update": r"\theta",
    "eq-u-pg-update": r"\theta_{t+1}",
    "om-baseline-update error": r"\delta_t",
}
TESTED = [
    *INLINE, *PARTS, "om-softmax", "eq-rf-38", "eq-rf-39", "J(p)", "eq-u-pg-update", "eq-u-pg-theorem",
    "eq-u-reinforce", "eq-u-baseline-zero", "eq-u-reinforce-baseline",
]  # fmt: skip


def rng(seed=0):
    return np.random.default_rng(seed)


# ---------------------------------------------------------------------- two processes, and what rlcore says


@cache
def tree():
    """A binary tree whose steps pay differently; theta; values w, 0 at the leaves."""
    reward = rng(1).normal(size=(N, 2))
    outcomes = {(s, a): [(1.0, 2 * s + 1 + a, reward[s, a])] for s in range(N) for a in (0, 1)}
    w = np.append(rng(3).normal(size=N), np.zeros(N + 1))
    return FiniteMDP.from_outcomes(outcomes, start=0), rng(2).normal(size=(2, 2 * N + 1)), w


def walk(actions):
    """States and rewards of the episode with these actions."""
    mdp, states, rewards = tree()[0], [0], []
    for a in actions:
        rewards.append(mdp.reward[states[-1], a, 0])
        states.append(2 * states[-1] + 1 + a)
    return states, np.array(rewards)


def episodes():
    """(probability, names) of every episode."""
    for actions in itertools.product((0, 1), repeat=T + 1):
        states, rewards = walk(actions)
        G, names = discounted_returns(rewards, GAMMA), {"T": T}
        for t, a in enumerate(actions):
            names |= {("S", t): states[t], ("A", t): a, ("r", t): rewards[t], ("G", t): G[t], ("R(tau)", t): G[t]}
        yield np.prod([softmax(tree()[1][:, s])[a] for s, a in zip(states, actions)]), names


@cache
def run(method, **settings):
    """A run of one episode, and the actions that it happened to take."""
    mdp, theta, w = tree()
    if settings.pop("critic", method is actor_critic):
        settings["w0"] = w
    done = method(mdp, GAMMA, 1, alpha=ALPHA, theta0=theta, record=1, rng=rng(5), **settings)
    paths = itertools.product((0, 1), repeat=T + 1)
    return done, next(actions for actions in paths if np.isclose(walk(actions)[1].sum(), done.returns[0]))


def tree_scope(actions):
    _, theta, w = tree()
    theta, w, (states, rewards) = theta.copy(), w.copy(), walk(actions)
    G = np.append(discounted_returns(rewards, GAMMA), 0.0)
    g = episode_gradient(theta, states, actions, rewards, GAMMA, discount_states=True)

    def pi(a, s, theta=theta):
        return softmax(theta[:, int(s)])[int(a)]

    tables = {
        ("S", "", 1): lambda t: states[int(t)], ("A", "", 1): lambda t: actions[int(t)], ("G", "", 1): G,
        ("s", "indexed", 1): lambda t: states[int(t)], ("a", "indexed", 1): lambda t: actions[int(t)],
        ("r", "indexed", 1): rewards, ("R(tau)", "", 1): G, ("g", "", 0): g, ("b", "", 1): w,
        ("pi|0", "", 3): pi, ("pi|0", "theta", 2): pi, ("pi", "", 0): lambda: pi(1, 2),
        ("theta", "", 0): theta, ("theta", "indexed", 1): lambda t: theta, ("w", "", 0): w,
        ("v", "", 2): lambda s, w: w[int(s)], ("J", "", 1): lambda theta: objective(tree()[0], theta, GAMMA),
    }  # fmt: skip
    greek = {r"\alpha": ALPHA, r"\alpha_w": ALPHA_W}
    return Scope({"a": (0, 1)}, tables, rewards, GAMMA, greek, [*episodes()])


@cache
def graph():
    """A process that goes on for ever, theta and features of its states, gamma."""
    return random_mdp(4, 3, n_next=2, rng=rng(6)), rng(7).normal(size=(3, 2)), rng(8).normal(size=(4, 2))


def graph_scope():
    mdp, theta, x = graph()
    theta = theta.copy()
    pi = softmax_policy(theta, x)
    visits = np.linalg.solve(np.eye(4) - GAMMA * policy_matrix(mdp, pi)[0].toarray().T, mdp.start)
    tables = {
        ("pi|0", "", 3): lambda a, s, theta: softmax(theta @ x[int(s)])[int(a)], ("mu", "", 1): visits,
        ("q", "pi", 2): q_from_v(mdp, solve_policy(mdp, pi, GAMMA), GAMMA), ("theta", "", 0): theta,
        ("h", "", 3): lambda s, a, theta: theta[int(a)] @ x[int(s)], ("theta", "indexed", 1): lambda t: theta,
        ("J", "", 1): lambda theta: objective(mdp, theta, GAMMA, features=x),
    }  # fmt: skip
    return Scope({"s": range(4), "a": range(3), "b": range(3)}, tables, gamma=GAMMA, greek={r"\alpha": ALPHA})


def cases(name):
    """(scope, names, what rlcore computes)."""
    (mdp, theta, x), (_, wide, w) = graph(), tree()
    first = (0, 1, 1)
    if name == "om-softmax":
        pi = softmax_policy(theta, x)
        np.testing.assert_allclose(Categorical(x @ theta.T).probs, pi)
        for s, a in np.ndindex(4, 3):
            yield graph_scope(), {"s": s, "a": a}, pi[s, a]
    elif name in ("eq-rf-38", "eq-u-alg2-return"):
        for t, G in enumerate(discounted_returns(walk(first)[1], GAMMA)):
            yield tree_scope(first), {"t": t, "T": T}, G
    elif name == "J(p)":
        for p in (0.2, 0.5, 0.9):
            theta = np.log([[1 - p], [p]])
            J = objective(short_corridor(), theta, 1.0, features=np.ones((4, 1)))
            yield Scope({}, {("J", "", 1): lambda p, J=J: J, ("p", "", 1): lambda x, p=p: p * x}), {"p": p}, J
    elif name == "eq-u-pg-update":
        yield graph_scope(), {"t": 0}, gradient_ascent(mdp, theta, GAMMA, 1, alpha=ALPHA, features=x)[1]
    elif name == "eq-u-pg-theorem":  # mu: discounted visits, with which the two sides are equal
        yield graph_scope(), {}, policy_gradient_exact(mdp, theta, GAMMA, features=x)
    elif name == "eq-u-baseline-zero":
        for s in range(3):
            pi, X = softmax(wide[:, s]), np.eye(2 * N + 1)
            yield tree_scope(first), {"s": s}, sum(pi[a] * w[s] * grad_log_softmax(wide, X[s], a) for a in (0, 1))
    elif name == "om-score identity":
        yield tree_scope(first), {}, grad_log_softmax(wide, np.eye(2 * N + 1)[2], 1)
    elif name == "eq-u-alg2-gradient":
        states, rewards = walk(first)
        change = episode_gradient(wide, states, first, rewards, GAMMA, discount_states=True)
        yield tree_scope(first), {"T": T}, change
    elif name == "om-baseline-update error":
        done, actions = run(actor_critic, alpha_w=ALPHA_W)
        for t, s in enumerate(walk(actions)[0][:-1]):
            yield tree_scope(actions), {"t": t}, (done.V - w)[s] / ALPHA_W
    elif name in ("eq-rf-39", "om-score"):
        exact = objective if name == "eq-rf-39" else policy_gradient_exact
        yield tree_scope(first), {}, exact(tree()[0], wide, GAMMA)
    elif name == "om-baseline-update":
        done, actions = run(reinforce, baseline="value", critic=True, alpha_w=ALPHA_W)
        yield tree_scope(actions), {}, done.V - w
    else:
        settings = dict(baseline="value", critic=True, alpha_w=0.0) if "baseline" in name else {}
        done, actions = run(reinforce, discount_states=True, every_step=name in UPDATES, **settings)
        yield tree_scope(actions), {}, done.history[-1] - (wide if name in UPDATES else 0.0)


def check(name, latex):
    """AssertionError where a side of the equation is not what rlcore computes, SyntaxError where it cannot be read."""
    found = sides(latex)
    assert len(found) > 1, f"{name}: no sign of equality"
    if name in LEFT:
        symbol = re.split(r"\\doteq|=|\\leftarrow", latex)[0].strip()
        assert symbol == LEFT[name], f"{name} is about {symbol}, not {LEFT[name]}"
    for scope, names, want in cases(name):
        for side in found[name in LEFT :]:
            if name in UPDATES:  # what all steps of the episode change together
                old = scope.tables["theta" if "theta" in LEFT[name] else LEFT[name], "", 0]
                got = sum(side(scope, {"t": t, **names}) - old for t in range(T + 1))
            else:
                got = np.broadcast_to(side(scope, names), np.shape(want))
            np.testing.assert_allclose(got, want, rtol=1e-6, atol=1e-8, err_msg=f"{name}: {latex}")


# ---------------------------------------------------------------------- the page


@cache
def on_page(name):
    if name in INLINE:
        return inline(PAGE, name, INLINE[name])
    if name == "J(p)":
        return next(latex for latex in unnamed(PAGE) if latex.startswith("J(p)"))
    name, part = PARTS.get(name, (name, 0))
    return re.split(r"[,;] \\qquad", printed(PAGE)[name])[part].strip()


@pytest.mark.long
@pytest.mark.parametrize("name", TESTED)
def test_equation_on_the_page_is_what_rlcore_computes(name):
    check(name, on_page(name))


# ---------------------------------------------------------------------- the tester itself

BREAKS = {
    "plus": (r"(?<!t)(?<!t')\+(?!1)", "-"),
    "minus": (r"(?<!t')- ?(?!t)", "+ "),
    "negative": (r"= -", "= "),
    "gamma": (r"\\gamma(\^t(?!')|\^\{t\}| )", ""),
    "power": (r"\{t'-t\}", "{t'}"),
    "alpha": (r"\\alpha(_w)?", ""),
    "wrong rate": (r"\\alpha_w", r"\\alpha"),
    "logarithm": (r"\\(ln|log) ", ""),
    "no score": (r"\\nabla(_\\theta)? \\(ln|log)", r"\\\2"),
    "no gradient": (r"\\nabla (?=\\pi\(|\\sum|1|\\hat)", ""),
    "return": (r"G_t|R_t\(\\tau\)(?!.*=)", "R_{t+1}"),
    "first reward only": (r"R_0\(\\tau\)", "r_0"),
    "start": (r"t'=t\}|t=0\}", "t'=t+1}"),
    "baseline": (r"\(G_t - ([^)]*\))\)", "G_t"),
    "baseline of the action": (r"b\(s\)", "b(a)"),
    "next state": (r"S_\{t\+1\}", "S_t"),
    "reward": (r"R_\{t\+1\}", "R_{t}"),
    "visits": (r"\\mu\(s\)", ""),
    "values": (r"q_\\pi\(s, a\)", ""),
    "swapped": (r"e\^\{h\(s,(.),\\theta\)\}", r"e^{-h(s,\1,\\theta)}"),
    "denominator": (r"\\sum_b e", "e"),
    "four": (r"4 - 2p", "4 - p"),
    "one": (r"1 - p", "p"),
    "zero": (r"= 0$", "= 1"),
    "divided": (r"\\frac\{\\nabla \\pi\}\{\\pi\}", r"\\nabla \\pi"),
    "symbol": (r"^(\S)", r"x"),
}


BROKEN = broken({name: on_page(name) for name in TESTED}, BREAKS)


@pytest.mark.parametrize("name, latex", [pytest.param(n, x, id=f"{n}-{kind}-{i}") for n, kind, i, x in BROKEN])
def test_an_error_on_the_page_is_noticed(name, latex):
    with pytest.raises(NOTICED):
        check(name, latex)


def test_every_equation_is_broken():
    kinds = {name: {kind for n, kind, *_ in BROKEN if n == name} for name in TESTED}
    assert all(found - {"symbol"} for found in kinds.values()), kinds
