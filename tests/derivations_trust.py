r"""The derivations of chapter 8: on which processes, policies, matrices and batches each is evaluated."""

import numpy as np
from derivations_networks import Smooth, differences
from latex import Scope
from processes import GAMMAS, Derivation, random_mdp, rng, times

from rlcore import trust_region as sur
from rlcore.bellman import q_from_v, solve_policy
from rlcore.distributions import Categorical
from rlcore.gae import gae
from rlcore.mdp import FiniteMDP
from rlcore.neurons import softmax
from rlcore.nstep import lambda_return

# ---------------------------------------------------------------------- two policies


class Vectors(Smooth):
    """P_\\pi (v - w): a matrix and the vector in the brackets after it."""

    def call(self, name, subscript, args):
        if len(args) == 1 and np.ndim(args[0]) == 1 and (name, subscript, 0) in self.tables:
            return self.tables[name, subscript, 0] @ args[0]
        return super().call(name, subscript, args)


def two(mdp, before, after, gamma, **more):
    """An old policy and a new one, with all that the bound is made of."""
    old, P, r = sur.old_policy(mdp, before, gamma), mdp.transition_probs(), mdp.expected_reward()
    v_old, v = (solve_policy(mdp, pi, gamma) for pi in (before, after))
    P_old, P_new = (np.einsum("sa,sat->st", pi, P) for pi in (before, after))
    one, n = np.eye(v.size), v.size
    mean = (after * old.A).sum(axis=1)
    C = sur.penalty_coefficient(old)
    tables = {
        ("pi|0", "", 2): lambda a, s: after[int(s), a], ("piold|0", "", 2): lambda a, s: before[int(s), a],
        ("pi", "", 0): lambda: after, ("piold", "", 0): lambda: before, ("pi'", "", 0): lambda: after,
        ("Aold", "", 2): old.A, ("qold", "", 2): q_from_v(mdp, v_old, gamma), ("I", "", 0): one,
        ("barA", "", 1): mean, ("barA", "", 0): lambda: mean, ("r", "pi", 1): (after * r).sum(axis=1),
        ("r", "pi", 0): (after * r).sum(axis=1), ("P", "pi", 2): P_new, ("P", "pi", 0): P_new,
        ("Pold", "", 0): P_old, ("v", "pi", 0): v, ("v", "pi", 1): v, ("vold", "", 0): v_old, ("vold", "", 1): v_old,
        ("mu", "0", 1): mdp.start, ("eta", "", 1): lambda pi: sur.eta(mdp, pi, gamma),
        ("mu", "pi", 1): np.linalg.solve(one - gamma * P_new.T, mdp.start), ("muold", "", 1): old.visits,
        ("ell", "", 0): lambda: v_old + np.linalg.solve(one - gamma * P_old, mean),
        ("L", "piold", 1): lambda pi: sur.local_performance(old, pi), ("f", "", 1): rng(1).normal(size=4),
        ("KL", "", 2): lambda p, q: Categorical(np.log(p)).kl(Categorical(np.log(q))),
        ("M", "", 1): lambda pi: sur.lower_bound(old, pi, C / 2),
        ("D", "", 0): lambda: np.abs(after - before).sum(axis=1).max() / 2,
    }  # fmt: skip
    epsilon = np.abs(old.A).max()
    assert np.isclose(C, 4 * epsilon * gamma / (1 - gamma) ** 2)
    return Vectors({"s": range(n), "a": range(before.shape[1])}, tables, None, gamma, {r"\epsilon": epsilon, **more})


def policies(free):
    for seed, gamma in enumerate(GAMMAS):
        before, after = rng(seed).dirichlet(np.ones(2), size=(2, 3))
        yield two(random_mdp(seed), before, after, gamma), free


def built(P, A, start, before, after, gamma, worth=(2.5, -1.5)):
    """A process in which the old policy has these values and these advantages."""
    n, m = A.shape
    after_all = np.broadcast_to(np.arange(n), (n, m, n))
    reward = (A + np.array(worth)[:, None] - gamma * P @ worth)[:, :, None] * np.ones(n)
    mdp = FiniteMDP(after_all, P, reward, np.ones((n, m), bool), np.zeros(n, bool), np.array(start))
    scope = two(mdp, np.array(before), np.array(after), gamma)
    np.testing.assert_allclose(scope.call("Aold", "", [0, 0]), A[0, 0], atol=1e-9)
    return scope


def bounds(free):
    """Policies at random; then processes in which one inequality after the other is an equality."""
    yield from policies(free)
    stay, leave = [1.0, 0.0], [0.0, 1.0]
    half, first = [[0.5, 0.5]] * 2, [[1.0, 0.0]] * 2
    apart = np.array([[stay, leave], [leave, stay]])  # the first action keeps the state, and the sign of the gain
    yield built(apart, np.array([[1.0, -1.0], [-1.0, 1.0]]), [0.0, 1.0], half, first, 0.7), free
    same = np.array([[stay, leave], [stay, leave]])  # the action alone decides where one goes
    yield built(same, np.array([[1.0, -1.0], [0.2, -0.2]]), [1.0, 0.0], half, first, 0.7), free
    yield nearly_attained(), free


def lower_bounds():
    """Policies at random, those for which the bound in D or the one in KL is attained, and a bad one at gamma 0.9."""
    yield from policies([{}])
    yield nearly_attained(), [{}]
    yield attained_with_kl(), [{}]
    yield far_below(), [{}]


def attained_with_kl(D=1e-2, size=2.5, gamma=1e-3):
    """A start that leads to a gain or to a loss by halves, little discount: attained but for a share of gamma + 2 D^2.

    Nothing is gained at the start itself; what counts is that it moves towards the loss by D.
    """
    P = np.zeros((3, 2, 3))
    P[0, 0, 1] = P[0, 1, 2] = P[1, :, 1] = P[2, :, 2] = 1.0
    A = size * np.array([[0.0, 0.0], [1.0, -1.0], [-1.0, 1.0]])
    before, after = np.full((3, 2), 0.5), np.array([[0.5 - D, 0.5 + D], [0.5 + D, 0.5 - D], [0.5 + D, 0.5 - D]])
    return built(P, A, [1.0, 0.0, 0.0], before, after, gamma, worth=(2.5, -1.5, 0.5))


def far_below(D=0.02, leave=0.15, gamma=0.95):
    """The state that loses is left less often, the one that gains more: .064 of the bound, more than 1 - gamma."""
    stay, go = [1.0, 0.0], [0.0, 1.0]
    P = np.array([[stay, go, stay], [go, stay, go]])  # the second action changes the state
    A = np.array([[-1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    before = np.array([[0.5, leave, 0.5 - leave]] * 2)
    after = before + [[D, -D, 0.0], [-D, D, 0.0]]
    return built(P, A, [1.0, 0.0], before, after, gamma)


def nearly_attained(D=1e-6, size=1e6, gamma=0.7):
    """Rare actions lead from the state that loses to the state that gains: the bound is right to seven digits."""
    stay, leave = [1.0, 0.0], [0.0, 1.0]
    P = np.array([[stay, leave, stay], [leave, leave, leave]])
    before = np.array([[0.5, 2 * D, 0.5 - 2 * D], [0.5, 2 * D, 0.5 - 2 * D]])
    after = before + [[D, -D, 0.0], [D, -D, 0.0]]
    A = size * np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, -1.0]])
    return built(P, A, [1.0, 0.0], before, after, gamma)


def moving():
    """A softmax policy at its old parameters."""
    for seed, gamma in enumerate(GAMMAS):
        mdp, x, theta = random_mdp(seed), rng(seed).normal(size=(3, 2, 2)), rng(seed + 5).normal(size=2)

        def pi(x=x, theta=theta):
            return np.array([softmax(rows @ theta) for rows in x])

        scope = two(mdp, pi(), pi(), gamma)
        scope.tables |= {
            ("theta", "", 0): theta, ("pi", "indexed", 1): lambda theta, pi=pi: pi(),
            ("pi|0", "theta", 2): lambda a, s, pi=pi: pi()[int(s), int(a)],
        }  # fmt: skip
        yield scope, [{}]


def single(moved):
    """One state, at its old parameters or away from them."""
    x, theta = rng(2).normal(size=(3, 2)), rng(3).normal(size=2)
    before = softmax(x @ theta)
    theta += moved
    tables = {
        ("theta", "", 0): theta, ("pi", "theta", 1): lambda a: softmax(x @ theta)[int(a)],
        ("piold", "", 1): before, ("K", "", 1): lambda theta: before @ np.log(before / softmax(x @ theta)),
    }  # fmt: skip
    yield Smooth({"a": range(3)}, tables), times(i=(0, 1), j=(0, 1), a=range(3))


def outcomes():
    for p, q in ((0.3, 0.6), (0.5, 0.5), (0.7, 0.2)):

        def k(q, p=p):
            return p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q)) - 2 * (p - q) ** 2

        def slope(q, k=k):
            at = np.array([float(q)])
            return differences(lambda: k(at[0]), at, h=1e-3)[0]

        yield Scope({}, {("u", "", 1): k, ("u'", "", 1): slope}), [{"p": p, "q": q}]


def divergences():
    """Four actions; two; and two whose probabilities are nearly one half each."""
    for p, q in (
        (rng(1).dirichlet(np.ones(4)), rng(2).dirichlet(np.ones(4))),
        (np.array([0.6, 0.4]), np.array([0.3, 0.7])),
        (np.array([0.5, 0.5]), np.array([0.49999, 0.50001])),
    ):
        falls = p > q
        tables = {
            ("pi|0", "", 2): lambda a, s, q=q: q[a if isinstance(a, slice) else int(a)],
            ("piold|0", "", 2): lambda a, s, p=p: p[a if isinstance(a, slice) else int(a)],
            ("KL", "", 2): lambda p, q: Categorical(np.log(p)).kl(Categorical(np.log(q))),
        }  # fmt: skip
        yield Scope({"a": range(p.size)}, tables), [{"s": 0, "p": p[falls].sum(), "q": q[falls].sum()}]


def maximisers():
    """pi' is the best of many policies on the way to the greedy one; then pi_old itself, where nothing is better."""
    for seed, gamma in enumerate(GAMMAS):
        mdp, before = random_mdp(seed, more=9.0), rng(seed).dirichlet(np.ones(2), size=3)
        old = sur.old_policy(mdp, before, gamma)
        better = np.eye(2)[old.A.argmax(axis=1)]
        ways = [before + t * (better - before) for t in np.linspace(0, 0.9, 2001)]
        best = max(ways, key=lambda pi: sur.lower_bound(old, pi, sur.penalty_coefficient(old) / 2))
        for pi in (best, before):
            yield two(mdp, before, pi, gamma), [{}]


# ---------------------------------------------------------------------- steps


def steps():
    """The step that is derived; for the bound also others, shorter ones and one of the same length."""
    draw = rng(4)
    root = draw.normal(size=(3, 3))
    H, g, delta = root @ root.T + np.eye(3), draw.normal(size=3), 0.01
    x = np.linalg.solve(H, g)
    beta = np.sqrt(x @ H @ x / (2 * delta))
    return H, g, x, beta, delta


def natural(other=False):
    H, g, x, beta, delta = steps()
    found = [x / beta]
    if other:
        for y in rng(5).normal(size=(3, 3)):
            found += [y * np.sqrt(2 * delta / (y @ H @ y))]
        found.append(0.3 * found[0])
    yield Scope({}, {}, greek={r"\beta": beta}), [{"H": H, "g": g, "x": x, "y": y, "delta": delta} for y in found]


def adaptive():
    H, _, x, beta, _ = steps()
    beta = 0.7 * beta
    d, target = x @ H @ x / (2 * beta**2), 0.03
    names = {"H": H, "x": x, "d": d, "b": beta * np.sqrt(d / target)}
    yield Scope({}, {("dtarg", "", 0): np.array(target)}, greek={r"\beta": beta}), [names]


def conjugate():
    """Two steps in two dimensions, each as long as its own line asks for."""
    for seed in (0, 1):
        root, g = rng(seed).normal(size=(2, 2)), rng(seed + 9).normal(size=2)
        H, x, r, names, greek = root @ root.T + np.eye(2), np.zeros(2), g, {"g": g}, {}
        p = r
        for k in (0, 1):
            alpha = (p @ r) / (p @ H @ p)
            names |= {("p", k): p, ("r", k): r, ("alpha", k): alpha, ("x", k): x}
            greek[rf"\alpha_{k}"] = alpha
            x, r = x + alpha * p, r - alpha * H @ p
            names["beta", k] = -(p @ H @ r) / (p @ H @ p)
            p = r + names["beta", k] * p
        names |= {("x", 2): x, ("r", 2): r, "H": H}
        np.testing.assert_allclose(H @ x, g)
        yield Scope({}, {}, greek=greek), [names]


# ---------------------------------------------------------------------- advantages, clipping


def advantages(free):
    T, lam = 5, 0.5
    for seed, gamma in enumerate(GAMMAS):
        R, V, ends = rng(seed).normal(size=T), np.append(rng(seed + 3).normal(size=T), 0.0), np.arange(T) == T - 1
        delta, want = (gae(R, V[:-1], V[1:], ends, ends & False, gamma, x) for x in (0.0, lam))
        L = lambda_return(R, V[:-1], gamma, lam)

        def padded(x):
            return lambda t: x[int(t)] if t < x.size else 0.0

        def of_steps(t, k, delta=delta, gamma=gamma):
            return sum(gamma**l * delta[int(t) + l] for l in range(int(k)) if t + l < T)

        tables = {
            ("s", "indexed", 1): lambda t: int(t), ("V", "", 1): padded(V), ("delta", "indexed", 1): padded(delta),
            ("A", "", 1): padded(want), ("A", "steps", 2): of_steps, ("L", "", 1): padded(L),
        }  # fmt: skip
        yield Scope({}, tables, R, gamma, {r"\lambda": lam}), [{"infinity": 60, **x} for x in free]


def three_steps():
    R, V, ends = np.array([0.0, 0, 1]), np.array([0.5, 0.6, 0.8]), np.array([False, False, True])
    delta, want = (gae(R, V, np.append(V[1:], 0.0), ends, ends & False, 0.9, lam) for lam in (0.0, 0.5))
    yield Scope({}, {("delta", "indexed", 1): delta, ("A", "", 1): want}), [{}]


def terms(*advantages):
    tables = {("min", "", 2): min, ("clip", "", 3): np.clip}
    found = [{"r": r, "A": A} for A in advantages for r in (0.4, 0.9, 1.0, 1.15, 1.7)]
    yield Scope({}, tables, greek={r"\epsilon": 0.2}), found


STATE, MANY = times(s=range(3)), [{"infinity": 90}]

REGISTRY = {
    "dv-ratio": Derivation(8, lambda: policies(STATE)),
    "dv-mean-advantage": Derivation(8, lambda: policies(STATE)),
    "dv-performance-difference": Derivation(8, lambda: policies(MANY)),
    "dv-performance-visits": Derivation(8, lambda: policies(MANY)),
    "dv-surrogate": Derivation(8, lambda: policies([{}])),
    "dv-surrogate-slope": Derivation(8, moving),
    "dv-advantage-bound": Derivation(8, lambda: bounds(times(s=(0, 1)))),
    "dv-surrogate-error": Derivation(8, lambda: policies([{}])),
    "dv-bound": Derivation(8, lambda: bounds([{}])),
    "dv-two-outcomes": Derivation(8, outcomes),
    "dv-pinsker": Derivation(8, divergences),
    "dv-lower-bound": Derivation(8, lower_bounds),
    "dv-minorise": Derivation(8, maximisers),
    "dv-natural-gradient": Derivation(8, natural),
    "dv-natural-best": Derivation(8, lambda: natural(other=True)),
    "dv-kl-slopes": Derivation(8, lambda: single([0.4, -0.7])),
    "dv-fisher": Derivation(8, lambda: single([0.0, 0.0])),
    "dv-cg-first": Derivation(8, conjugate),
    "dv-cg-second": Derivation(8, conjugate),
    "dv-gae-steps": Derivation(8, lambda: advantages(times(t=(0, 1), k=(2, 3)))),
    "dv-gae": Derivation(8, lambda: advantages(times(t=(0, 2)))),
    "dv-gae-example": Derivation(8, three_steps),
    "dv-clip-good": Derivation(8, lambda: terms(1.3, 0.4)),
    "dv-clip-bad": Derivation(8, lambda: terms(-1.3, -0.4)),
    "dv-adaptive": Derivation(8, adaptive),
}

BREAKS = {
    "old for new": (r"\\pi(?=\(a \\mid s\))", r"\\pi_{old}"),
    "new for old": (r"\\pi_\{old\}", r"\\pi"),
    "inverted": (r"\\frac\{(\\pi\(a \\mid s\))\}\{(\\pi_\{old\}\(a \\mid s\))\}", r"\\frac{\2}{\1}"),
    "old value": (r"v_\{old\}(?=[ )(])", r"v_\\pi"),
    "old values of pairs": (r"q_\{old\}\(s, a\)", "1"),
    "old advantages": (r"(\\, )?A_\{old\}\(s, a\)", ""),
    "old visits": (r"\\mu_\{old\}\(s\)", "1"),
    "new visits": (r"\\mu_\\pi\(s'\)", "1"),
    "old transitions": (r"P_\{old\}", r"P_\\pi"),
    "new transitions": (r"P_\\pi(?!\^)", "I"),
    "start": (r"\\mu_0\(s\)", ""),
    "function": (r"(\\, )?f\(a\)", ""),
    "mean advantage": (r"\\bar A(?! \\r)", "v_{old}"),
    "surrogate": (r"\\ell", r"v_{old}"),
    "epsilon": (r"\\epsilon", ""),
    "distance": (r"(?<=[ }])D(\^2)?", ""),
    "four": (r"4 \\eps", r"3 \\eps"),
    "two epsilon": (r"2 (?=\\eps|\\gamma)", ""),
    "half": (r"\\frac12(\\,)? ", ""),
    "quarter": (r"\\frac14(\\,)? ", ""),
    "slope": (r"\\nabla (?=L|\\eta|\\pi)", ""),
    "logarithm": (r"\\ln ", ""),
    "outcome": (r"(?<![\w\\])([pq])(?![\w'(])", lambda m: {"p": "q", "q": "p"}[m[1]]),
    "derivative": (r"\\partial_[ij] ", ""),
    "other derivative": (r"\\partial_j", r"\\partial_i"),
    "swapped policies": (r"KL\[(.*?\)), (.*?\))\]", r"KL[\2, \1]"),
    "divergence": (r"\\max_s KL\[.*?\]", ""),
    "curvature": (r"(?<=[ T])H (?=[pxyr])", ""),
    "no inverse": (r"H\^\{-1\} ", ""),
    "penalty": (r"\\beta(_0)?(\^2)?(?=[ }\\])", "1"),
    "limit": (r"\\delta(?=[} ])(?! &)", "1"),
    "direction": (r"(?<=[T= \\},])([xy])(?= \\\\| &&|\^T)", lambda m: {"x": "y", "y": "x"}[m[1]]),
    "first": (r"(?<=[prx])_0", "_1"),
    "second": (r"(?<=[prx])_1", "_0"),
    "third": (r"(?<=[rx])_2", "_1"),
    "length": (r"\\alpha_[01](\\,)? ", ""),
    "part": (r"p_(1)\^T (?=\w+(_\d)? )", r"r_\1^T "),
    "both": (r"\(\\gamma \\lambda\)\^l", r"\\gamma^l"),
    "lambda": (r"\\lambda(?![\^a-z])", "1"),
    "power of lambda": (r"\\lambda\^(\{[^}]*\}|\w)", r"\\lambda"),
    "later": (r"_\{t\+[lk](\+1)?\}", "_t"),
    "number": (r"\^\{\(k\)\}", "^{(k+1)}"),
    "digit": (r"(?<=0\.\d)\d|(?<=0\.)\d(?!\d)", lambda m: str((int(m[0]) + 4) % 10)),
    "whole": (r"(?<=[= ] )[01](?= [+-])", "2"),
    "advantage": (r"(?<=[ )r]) A(?=[,) ])", ""),
    "clipped": (r"\\mathrm\{clip\}\(r, 1 - \\epsilon, 1 \+ \\epsilon\)", "1"),
    "ratio": (r"(?<=\()r(?=[, ])", "1"),
    "maximum": (r"\\max\(", r"\\min("),
    "minimum": (r"\\min\(", r"\\max("),
    "aim": (r"d_\{targ\}", "d"),
    "last": (r"(?<= - )V\(s_t\)|V\(s_t\)", "0"),
    "zero": (r"(?<=&= )0(?= &&)", "1"),
}

NOTHING = "0 is 0, however often"
ANY = "true of any two policies"
GONE = "the other edge has no effect: that is what the line says"
HARMLESS = {
    "dv-ratio": {
        r"{\pi_{old}(a \mid s)}{\pi_{old}": ANY,
        r"{\pi(a \mid s)}{\pi(a": ANY,
        r"\pi_{old}(a \mid s) && \text{cancel": ANY,
    },
    "dv-advantage-bound": {r"{} + \pi_{old}": "the old advantages have mean 0 under the old policy"},
    "dv-two-outcomes": {r"\ge 2 0": NOTHING, "u(p) &": "it is 0"},
    "dv-lower-bound": {r"KL[\pi(\cdot": "Pinsker's inequality holds in either order"},
    "dv-minorise": {r"\eta(\pi) &": ANY, r"M(\pi) && \text{bound": ANY},
    "dv-natural-gradient": {"&= 2 0": NOTHING},
    "dv-fisher": {
        r"K(\theta) &= 0": "the divergence itself is 0, too",
        "&= 2 0": NOTHING,
        r"+ \sum_a \partial_i": "the probabilities add up to 1, so that their derivatives add up to 0",
        r"- \sum_a \partial_i \pi": "the probabilities add up to 1, so that their derivatives add up to 0",
        r"- \sum_a \partial_j \pi": "the probabilities add up to 1, so that their derivatives add up to 0",
        r"\partial_i \partial_i \pi": "the probabilities add up to 1, so that their derivatives add up to 0",
    },
    "dv-cg-first": {"&= 2 0": NOTHING},
    "dv-cg-second": {
        "&= 2 0": NOTHING,
        r"p_0^T r_2 &= 0 && \text{choice": "r_2 is 0",
        r"p_1^T r_2 &= 0 && \text{as": "r_2 is 0",
        r"r_1^T r_2": "r_2 is 0",
        r"p_0^T r_1 &= 0": "so is r_1, along p_0",
    },
    "dv-clip-good": {r"1 + \epsilon, 1 + \epsilon": GONE, r"2 - \epsilon": GONE},
    "dv-clip-bad": {r"1 - \epsilon, 1 - \epsilon": GONE},
}
