r"""The derivations of chapter 5: on which episodes each is evaluated, which variables are free."""

import numpy as np
from derivations_tables import random_policy, solved
from latex import Scope
from processes import GAMMAS, Derivation, random_mdp, rng, times

from rlcore.bellman import solve_policy
from rlcore.mdp import discounted_returns
from rlcore.nstep import lambda_return
from rlcore.traces import trace_course

T, END = 6, 3  # steps of the episode; the terminal state
S = np.array([0, 1, 0, 0, 2, 1, END])  # states that are met again
A = np.array([1, 0, 1, 1, 0, 0, 0])
ALPHA, FOREVER = 0.3, 230  # 0.7 ** FOREVER is nothing
LAMBDAS = (0.7, 0.6)


def later(x):
    """x_t, and 0 after the end and before the start."""
    return lambda t: x[int(t)] if 0 <= t < len(x) else 0.0


def traces(decay, c):
    """E_t(s), E_{-1}(s) = 0, as rlcore counts it."""
    kind = {0.0: "accumulating", 1.0: "replacing"}.get(c, "dutch")
    course = [trace_course(np.flatnonzero(S[:T] == s), T, decay, kind, c or None) for s in range(3)]
    return lambda t, s: course[int(s)][int(t)] if t >= 0 else 0.0


def walks(free, lambdas=LAMBDAS, shares=(0.0,)):
    """An episode with V held fixed; rho: the share of its old trace that a visit takes away."""
    for gamma, lam in zip(GAMMAS, lambdas):
        R, V = rng(int(10 * gamma)).normal(size=T), np.append(rng(int(10 * lam)).normal(size=3), 0.0)
        fixed = {
            ("S", "", 1): lambda t: S[int(t)] if t < T else END, ("V", "", 1): V,
            ("G", "", 1): later(discounted_returns(R, gamma)), ("L", "", 1): later(lambda_return(R, V[S], gamma, lam)),
            ("delta", "indexed", 1): later(R + gamma * V[S[1:]] - V[S[:-1]]),
        }  # fmt: skip
        for c in shares:
            tables = {**fixed, ("E", "timed", 2): traces(gamma * lam, c)}
            greek = {r"\lambda": lam, r"\alpha": ALPHA, r"\rho": c}
            yield (
                Scope({"s": range(3)}, tables, R, gamma, greek),
                [{"T": T, "infinity": FOREVER, **x} for x in free],
            )


def means():
    """V at random, then one that is wrong by the same number everywhere."""
    for seed, gamma in enumerate(GAMMAS):
        mdp, pi = random_mdp(seed), random_policy(seed)
        for V in (rng(seed).normal(size=3), solve_policy(mdp, pi, gamma) - 1.5):
            yield solved(mdp, gamma, {("V", ""): V}, pi=pi), times(s=range(3), t=(0,), n=(2,))


def two_visits():
    for c in (0.0, 0.5, 1.0):
        trace = (1 - c) * 0.125 + 0.5
        yield Scope({}, {("E", "timed", 2): lambda t, s, e=trace: e}, (), 1.0, {r"\rho": c}), [{"s": 0}]


def one_target():
    """V_m and E_m after m updates towards x."""
    V, E, x = [0.4], [0.0], 2.5
    for _ in range(5):
        V.append(V[-1] + ALPHA * (x - V[-1]))
        E.append((1 - ALPHA) * E[-1] + 1)
    tables = {("V", "indexed", 1): np.array(V), ("E", "indexed", 1): np.array(E)}
    yield Scope({}, tables, greek={r"\alpha": ALPHA}), [{"m": m, "x": x} for m in (2, 3, 5)]


class Online(Scope):
    """V changes on the way: at the horizon h stands what V_{h-1} has for S_h."""

    def stand_in(self, h, state):
        return self.call("V", "timed", [h - 1, state])


def online(free):
    for gamma, lam in zip(GAMMAS, LAMBDAS):
        yield begun_anew(gamma, lam), free


def begun_anew(gamma, lam):
    """The on-line forward view, begun anew at each horizon, and the traces of rlcore."""
    R, W = rng(int(10 * gamma)).normal(size=T), {}
    start = np.append(rng(9).normal(size=3), 0.0)
    V = {-1: start, 0: start}

    def to_horizon(t, h):
        return sum(gamma ** (k - t) * R[k] for k in range(t, h)) + gamma ** (h - t) * V[h - 1][S[h]]

    def target(t, h):
        t, h = int(t), int(h)
        before = sum((1 - lam) * lam ** (n - 1) * to_horizon(t, t + n) for n in range(1, h - t))
        return before + lam ** (h - t - 1) * to_horizon(t, h)

    for h in range(T + 1):
        table = start.copy()
        W[0, h] = table.copy()
        for k in range(h):
            table[S[k]] += ALPHA * (target(k, h) - table[S[k]])
            W[k + 1, h] = table.copy()
        V[h] = W[h, h]
    tables = {
        ("S", "", 1): lambda t: S[int(t)], ("V", "timed", 2): lambda t, s: V[int(t)][int(s)],
        ("L", "timed", 2): target, ("W", "timed", 3): lambda k, h, s: W[int(k), int(h)][int(s)],
        ("E", "timed", 2): traces(gamma * lam, ALPHA),
        ("delta'", "indexed", 1): lambda h: R[int(h)] + gamma * V[h][S[h + 1]] - V[h - 1][S[h]],
    }  # fmt: skip
    return Online({"s": range(3)}, tables, R, gamma, {r"\lambda": lam, r"\alpha": ALPHA})


def exploring(free, lambdas=LAMBDAS):
    """A_t is greedy for Q, held fixed, at all times but 3 and 5; g_t says so."""
    for gamma, lam in zip(GAMMAS, lambdas):
        R, Q, g = (
            rng(int(10 * gamma)).normal(size=T),
            np.array([[0.9, -0.4], [0.3, 1.1], [0.7, -1.2], [0, 0]]),
            np.ones(T + 1),
        )
        best = Q.argmax(axis=1)
        actions = best[S]
        for t in (3, 5):
            actions[t], g[t] = 1 - actions[t], 0.0
        delta = R + gamma * Q.max(axis=1)[S[1:]] - Q[S[:-1], actions[:-1]]
        E, course = np.zeros((4, 2)), []
        for t in range(T):
            E = g[t] * gamma * lam * E
            E[S[t], actions[t]] += 1
            course.append(E)
        tables = {
            ("S", "", 1): lambda t: S[int(t)], ("A", "", 1): lambda t, a=actions: a[int(t)], ("Q", "", 2): Q,
            ("E", "timed", 3): lambda t, s, a, E=course: E[int(t)][int(s), int(a)] if t >= 0 else 0.0,
            ("delta", "indexed", 1): later(delta), ("g", "indexed", 1): g,
        }  # fmt: skip
        scope = Scope({"s": range(3), "a": range(2)}, tables, R, gamma, {r"\lambda": lam, r"\alpha": ALPHA})
        yield scope, [{"T": T, **x} for x in free]


AT = times(t=range(4))
SEEN = times(s=range(3), t=(2, 3, 5))
HORIZONS = times(s=range(3), h=(1, 2, 4))

REGISTRY = {
    "dv-n-step-return": Derivation(5, lambda: walks(times(t=range(3), n=(2, 3)))),
    "dv-n-step-mean": Derivation(5, means),
    "dv-error-reduction": Derivation(5, means),
    "dv-error-lambda": Derivation(5, lambda: walks([{}])),
    "dv-lambda-weights": Derivation(5, lambda: walks(times(m=(1, 3)))),
    "dv-lambda-episode": Derivation(5, lambda: walks(AT)),
    "dv-lambda-recursion": Derivation(5, lambda: walks(AT)),
    "dv-lambda-zero": Derivation(5, lambda: walks(AT, (0.0, 0.0))),
    "dv-lambda-one": Derivation(5, lambda: walks(AT, (1.0, 1.0))),
    "dv-telescoping": Derivation(5, lambda: walks(AT)),
    "dv-trace-sum": Derivation(5, lambda: walks(SEEN)),
    "dv-forward-backward": Derivation(5, lambda: walks(times(s=range(3)))),
    "dv-three-traces": Derivation(5, lambda: walks(SEEN, shares=(0.0, ALPHA, 1.0))),
    "dv-trace-example": Derivation(5, two_visits),
    "dv-dutch-steps": Derivation(5, one_target),
    "dv-online-target": Derivation(5, lambda: online(times(t=(0, 1), h=(3, 4)))),
    "dv-online-growth": Derivation(5, lambda: online(times(t=(0, 1), h=(3, 4)))),
    "dv-online-unrolled": Derivation(5, lambda: online([{**x, "k": k} for x in HORIZONS for k in range(x["h"])])),
    "dv-online-difference": Derivation(5, lambda: online(HORIZONS)),
    "dv-true-online": Derivation(5, lambda: online(HORIZONS + times(s=range(3), h=(0,)))),
    "dv-watkins-trace": Derivation(5, lambda: exploring(times(s=range(3), a=(0, 1), t=(1, 2, 4, 5)))),
    "dv-watkins-credit": Derivation(5, lambda: exploring(times(s=range(3), a=(0, 1)))),
    "dv-watkins-reach": Derivation(5, lambda: exploring([{"t": 0, "n": 3}, {"t": 3, "n": 2}], (1.0, 1.0))),
}

BREAKS = {
    "lambda": (r"\\lambda(?![\^a-z])(\\,)? ?", ""),
    "power of lambda": (r"\\lambda\^(\{[^}]*\}|\w)", r"\\lambda"),
    "exponent of both": (r"\(\\gamma \\lambda\)\^(\{[^}]*\}|\w)", r"\\gamma \\lambda"),
    "share": (r"\(1 - \\lambda\)", ""),
    "horizon": (r"(?<=[GL]_[tkh])\^(h|\{[^}]*\})", lambda m: "^{" + m[1].strip("{}") + "+1}"),
    "horizon of the table": (r"(?<=W_[kh])\^(h|\{h\+1\})", lambda m: "^{h+1}" if m[1] == "h" else "^h"),
    "visit": (r"I_\{[^}]*\}+", ""),
    "other visit": (r"(?<=I_\{[sa] [SA])_([kjt])\}", r"_{\1+1}}"),
    "taken": (r"(- )\\rho\\,", r"\1"),
    "cut": (r"g_(\w|\{[^}]*\})(\\,)?", ""),
    "time of the trace": (r"(?<=E)_\{(\w)-1\}", r"_\1"),
    "time of the table": (r"(?<=V)_\{h-1\}", "_h"),
    "later table": (r"(?<=[VW])_h(?=\()", "_{h-1}"),
    "step": (r"(?<=\\delta)('?)_(\w)(?!\w)", r"\1_{\2+1}"),
    "old error": (r"\\delta'_h", ""),
    "rest": (r"(?<=\()\\max_\{a'\} Q\(S_\{t\+n\}, a'\)", r"0"),
    "number of updates": (r"(?<=W)_\{k\+1\}", "_k"),
    "more updates": (r"(?<=[VE])_\{m-1\}", "_m"),
}

HARMLESS = {"dv-error-reduction": {"\\pi^{n+1} v_\\pi": "a fixed point of the backup"}}
