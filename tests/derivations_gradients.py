r"""The derivations of chapter 7: on which processes, policies and games each is evaluated, which variables are free.

Episodes run through three layers of states, so that all of them can be listed; the preferences are theta^T x(s, a).
"""

import itertools

import numpy as np
from derivations_networks import Smooth, differences
from latex import Scope
from processes import GAMMAS, Derivation, Numbers, rng, times

from rlcore.envs import short_corridor
from rlcore.neurons import softmax
from rlcore.policy_gradient import objective

T = 2  # the last step at which an action is taken
AFTER = {0: (1, 2), 1: (3, 4), 2: (3, 4), 3: (5,), 4: (5,)}
END, N = 5, 6
REWARDS = (-1.0, 2.0)


class Episodes(Smooth):
    """A process of three steps, a softmax policy whose theta can be moved, and all its episodes."""

    def __init__(self, seed, gamma):
        draw = rng(seed)
        self.P = np.zeros((N, 2, N))
        for s, after in AFTER.items():
            self.P[s][:, list(after)] = draw.dirichlet(np.ones(len(after)), size=2)
        self.P[END, :, END] = 0.0
        self.paid = draw.integers(2, size=(N, 2, N))  # which of the two rewards
        self.x, self.theta, self.b = draw.normal(size=(N, 2, 2)), draw.normal(size=2), draw.normal(size=N)
        self.r, self.known = np.array(REWARDS)[self.paid], {}
        tables = {
            ("theta", "", 0): self.theta, ("pi|0", "", 2): lambda a, s: self.solved(gamma)[0][int(s), int(a)],
            ("v", "pi", 1): lambda s: self.solved(gamma)[1][int(s)],
            ("q", "pi", 2): lambda s, a: self.solved(gamma)[2][int(s), int(a)],
            ("J", "", 1): lambda theta: self.solved(gamma)[1][0], ("b", "", 1): self.b,
            ("p|0", "", 3): lambda y, s, a: self.P[int(s), int(a), int(y)],
            ("p|1", "", 4): lambda y, r, s, a: self.P[s, a, y] * (self.r[s, a, y] == r),
        }  # fmt: skip
        pi, v, q = self.solved(gamma)
        P = np.einsum("sa,sat->st", pi, self.P)
        visits = np.linalg.solve(np.eye(N) - gamma * P.T, np.eye(N)[0]) * (np.arange(N) != END)
        slopes = pi[:, :, None] * (self.x - (pi[:, :, None] * self.x).sum(axis=1, keepdims=True))
        tables |= {
            ("P", "pi", 0): P, ("P", "pi", 2): P, ("mu", "", 1): visits,
            ("u", "", 1): (slopes * q[:, :, None]).sum(axis=1),
        }  # fmt: skip
        sets = {"s": range(N), "a": (0, 1), "r": REWARDS}
        super().__init__(sets, tables, None, gamma, trajectories=[*self.episodes(pi, v, gamma)])

    def solved(self, gamma):
        """pi, v and q for the theta of now."""
        key = self.theta.tobytes()
        if key not in self.known:
            pi = np.array([softmax(x @ self.theta) for x in self.x])
            r, P = (self.P * self.r).sum(axis=2), np.einsum("sa,sat->st", pi, self.P)
            v = np.linalg.solve(np.eye(N) - gamma * P, (pi * r).sum(axis=1))
            self.known[key] = pi, v, r + gamma * self.P @ v
        return self.known[key]

    def episodes(self, pi, v, gamma):
        """(probability, names)"""
        for path in itertools.product(AFTER[0], AFTER[1], AFTER[3]):
            for actions in itertools.product((0, 1), repeat=T + 1):
                states, p, seen, G = (0, *path), 1.0, {}, 0.0
                for t in reversed(range(T + 1)):
                    s, a, s_next = states[t], actions[t], states[t + 1]
                    reward, p = self.r[s, a, s_next], p * pi[s, a] * self.P[s, a, s_next]
                    G = reward + gamma * G
                    seen |= {("S", t): s, ("A", t): a, ("R", t + 1): reward, ("G", t): G, ("S", t + 1): s_next}
                    seen["delta", t] = reward + gamma * v[s_next] - v[s]
                yield p, {"T": T, **seen}

    def expect(self, kind, policy, what, given, names):
        fixed = {(letter, at(self, names)): x(self, names) for letter, at, x in given}
        found = [(p, seen) for p, seen in self.trajectories if all(seen[key] == x for key, x in fixed.items())]
        if not found:
            raise KeyError("a condition that never holds")
        if kind == r"\Pr":
            events = {(letter, at(self, names)): x(self, names) for letter, at, x in what}
            return sum(p for p, seen in found if all(seen[key] == x for key, x in events.items()))
        return sum(p * what(self, {**names, **seen}) for p, seen in found) / sum(p for p, _ in found)


def episodes(free):
    for seed, gamma in enumerate(GAMMAS):
        yield Episodes(seed, gamma), [{"T": T, "infinity": T, **x} for x in free]


def pairs():
    """State and action at a time at which they come up."""
    for seed, gamma in enumerate(GAMMAS):
        yield Episodes(seed, gamma), [{"t": t, "s": s, "a": a} for t, s in ((0, 0), (1, 2), (2, 3)) for a in (0, 1)]


def preferences():
    h = np.array([0.3, -0.8, 1.1])

    def pi():
        return softmax(h)

    tables = {
        ("h", "", 0): h, ("h", "indexed", 1): lambda a: h[int(a)], ("e", "indexed", 1): lambda a: np.eye(3)[int(a)],
        ("pi", "", 0): pi, ("pi", "", 1): lambda a: pi()[int(a)],
    }  # fmt: skip
    yield Smooth({"b": range(3)}, tables), times(a=range(3))


def one_step():
    """A bandit with two outcomes an action; the score Z of one parameter; two baselines."""
    pi, x = softmax(np.array([0.2, -0.5, 0.9])), np.array([1.0, -0.4, 0.3])
    Z, outcomes = x - pi @ x, []
    for a, G in enumerate(((1.0, 3.0), (-2.0, 0.5), (2.0, 4.0))):
        outcomes += [(pi[a] * q, {"G": g, "Z": Z[a]}) for q, g in zip((0.3, 0.7), G)]
    best = sum(p * o["G"] * o["Z"] ** 2 for p, o in outcomes) / sum(p * o["Z"] ** 2 for p, o in outcomes)
    yield Numbers({}, {("c", "*", 0): best}, (), 0.9, trajectories=outcomes), times(c=(0.0, 1.4, -3.0))


def corridor():
    """Three values solved by rlcore; J as a function of p."""
    mdp, wall = short_corridor(), {}

    def J(p):
        return objective(mdp, np.log([[1 - float(p)], [float(p)]]), 1.0, features=np.ones((4, 1)))

    def slope(p):
        x = np.array([float(p)])
        return differences(lambda: J(x[0]), x, h=1e-3)[0]

    for p in (0.2, 0.5, 0.8):
        A = np.array([[p, -p, 0], [-p, 1, p - 1], [0, p - 1, 1]])
        v = np.linalg.solve(A, -np.ones(3))
        np.testing.assert_allclose(v[0], J(p))
        tables = {
            ("v", "indexed", 1): lambda i, v=v: v[int(i) - 1], ("J", "", 1): J, ("J'", "", 1): slope,
            ("p", "", 1): lambda x, p=p: p * x, **wall,
        }  # fmt: skip
        yield Scope({}, tables), [{"p": p}]


def gain(x, y):
    """The expected gain of the bettor, hand by hand and answer by answer."""
    better = y * 3 + (1 - y) * 2
    return 0.5 * better + 0.5 * (x * (y * -1 + (1 - y) * 2) + (1 - x) * 0)


def bluff():
    alpha = 0.3
    found = []
    for x, y in ((0.1, 0.9), (0.6, 0.2)):
        point = np.array([x, y])
        up, down = differences(lambda at=point: gain(*at), point)
        found.append({"x": x, "y": y, "x'": x + alpha * up, "y'": y - alpha * down})
    yield Scope({}, {("f", "", 2): gain}, greek={r"\alpha": alpha}), found


ONCE = [{}]

REGISTRY = {
    "dv-score": Derivation(7, preferences),
    "dv-score-mean": Derivation(7, lambda: episodes(times(s=(0, 2), a=(0, 1)))),
    "dv-pg-recursion": Derivation(7, lambda: episodes(times(s=(0, 2)))),
    "dv-pg-unroll": Derivation(7, lambda: episodes(times(s=(0, 2)))),
    "dv-pg-theorem": Derivation(7, lambda: episodes(times(s=(0, 2, 3)))),
    "dv-pg-log": Derivation(7, lambda: episodes(ONCE)),
    "dv-causality": Derivation(7, lambda: episodes([{"k": 1, "t": 1}, {"k": 1, "t": 2}, {"k": 2, "t": 2}])),
    "dv-causality-sum": Derivation(7, lambda: episodes(ONCE)),
    "dv-baseline-mean": Derivation(7, lambda: episodes(times(t=(0, 2)))),
    "dv-baseline-best": Derivation(7, one_step),
    "dv-corridor-equations": Derivation(7, corridor),
    "dv-corridor": Derivation(7, corridor),
    "dv-corridor-best": Derivation(7, corridor),
    "dv-bluff": Derivation(7, bluff),
    "dv-bluff-spiral": Derivation(7, bluff),
    "dv-actor-critic": Derivation(7, pairs),
    "dv-actor-critic-gradient": Derivation(7, lambda: episodes(ONCE)),
}

BREAKS = {
    "logarithm": (r"\\ln ", ""),
    "no slope": (r"\\nabla(_h)? (?=\\ln|\\pi|v|q|\\sum|J)", ""),
    "preference": (r"h_b", "h_a"),
    "unit": (r"(?<![\w{])e_[ab]", "1"),
    "policy of one argument": (r"\\pi\(b\)(\\,)?", ""),
    "values": (r"q_\\pi\(\w+, \w+\)|q_\\pi\(S_t, A_t\)", "1"),
    "value": (r" - v_\\pi\((s|S_t)\)", ""),
    "visits": (r"\\mu\(s\)(\\,)? (?!&)", ""),
    "chance of a state": (r"\\Pr\\\{S_t = s\\\}", ""),
    "return": (r"G_[t0](?= )", "R_{t+1}"),
    "other return": (r"G_t", "G_0"),
    "whole return": (r"G_0", "G_t"),
    "error": (r"\\delta_t(?= \\n)", "R_{t+1}"),
    "reward of the time": (r"(?<=R)_k", "_{t+1}"),
    "action": (r"A_t(?= \\mid)", "0"),
    "transition": (r"p\(s' \\mid s, a\)|P_\\pi\(s, s'\)|\(P_\\pi\^[k2]\)\(s, s'\)", ""),
    "first effect": (r"u\(s'?\)", "0"),
    "baseline": (r"(?<=[\[ ])b\(S_t\)", "b(A_t)"),
    "chosen baseline": (r"c_\*", "c"),
    "given baseline": (r"(?<![_\w])c(?![_\w])", "0"),
    "score": (r"(?<=[ )\]])Z(\^2)?(?=[\])])", "1"),
    "result": (r"(?<=&= )0", "1"),
    "of the corridor": (r"(?<=v)_([123])", lambda m: "_" + str(int(m[1]) % 3 + 1)),
    "cost": (r"(?<=&= - )1(?= \+)", "2"),
    "right": (r"(?<=\+ )p (?=v)", "(1 - p) "),
    "left": (r"\(1 - p\) (?=v)", "p "),
    "number": (r"(?<=[={( ])([34])(?=[p }y]| -)", lambda m: str(int(m[1]) + 1)),
    "number alone": (r"(?<=[={( ])2(?=[p }y]| -)", "3"),
    "fraction": (r"\\frac(\d)(\d)", lambda m: rf"\frac{m[1]}{int(m[2]) + 1}"),
    "digit": (r"(?<=11\.65)\d", "1"),
    "next of the game": (r"(?<=[xy])'", ""),
    "step of the game": (r"\\alpha(\^2)? ", ""),
    "exchanged": (r"- \\frac13", r"- \\frac23"),
    "exchanged back": (r"- \\frac23", r"- \\frac13"),
}

NOTHING = "0 is 0, however often"
HARMLESS = {
    "dv-score-mean": {r"&= 2 \sum": NOTHING, r"&= 2 \nabla": NOTHING, "&= 2 0": NOTHING},
    "dv-causality": {
        r"&= 2 \mathbb": NOTHING,
        "&= 2 0": NOTHING,
        r"[R_{t+1} \sum": "the mean of the score is 0 in every state, whatever stands before it",
    },
    "dv-causality-sum": {
        r"\gamma R_k": "the rewards before t drop out, whatever they count",
        r"\gamma^{k} R_k": "the rewards before t drop out, whatever they count",
    },
    "dv-corridor-best": {"&= 2 0": NOTHING},
    "dv-actor-critic-gradient": {"A_t) + v_": "any function of the state is a baseline"},
    "dv-baseline-mean": {
        r"&= 2 \mathbb": NOTHING,
        "&= 2 0": NOTHING,
        "b(S_{t+1})": "the mean of the score is 0 in every state, whatever stands before it",
        "a \\mid S_{t+1}": "it is 0 in every state",
        "b(A_t) \\sum": "the sum over the actions is 0 in every state",
        "b(A_t) \\nabla 1": "the slope of a constant",
    },
}
