"""The equations on the page, read from their LaTeX, evaluated on a random process and compared with rlcore.

A flipped sign, a lost gamma, a lost prime or a maximum over the wrong variable on the page fails here; the same is done
to each equation on purpose, to see that it would be noticed.
"""

import re
from functools import cache

import numpy as np
import pytest
from latex import Scope, printed, sides

from rlcore.bellman import expectation_backup, expectation_backup_q, optimality_backup, optimality_backup_q, q_from_v
from rlcore.dp import policy_improvement
from rlcore.mdp import FiniteMDP, discounted_return, discounted_returns

S, A, GAMMAS = 3, 2, (0.7, 0.3)
REWARDS = (-2.0, 0.5, 3.0)
# What the page should show; the material of the tests of the tester.
EQUATIONS = {
    "eq-2": r"\sum_{s' \in \mathcal S} \sum_{r \in \mathcal R} p(s', r \mid s, a) = 1",
    "eq-3": r"p(s' \mid s, a) \doteq \Pr\{S_t = s' \mid S_{t-1} = s, A_{t-1} = a\} "
    r"= \sum_{r \in \mathcal R} p(s', r \mid s, a)",
    "eq-4": r"r(s, a) \doteq \mathbb E[R_t \mid S_{t-1} = s, A_{t-1} = a] "
    r"= \sum_{r \in \mathcal R} r \sum_{s' \in \mathcal S} p(s', r \mid s, a)",
    "eq-5": r"r(s, a, s') \doteq \mathbb E[R_t \mid S_{t-1} = s, A_{t-1} = a, S_t = s'] "
    r"= \sum_{r \in \mathcal R} r\, \frac{p(s', r \mid s, a)}{p(s' \mid s, a)}",
    "eq-6": r"G_t \doteq R_{t+1} + R_{t+2} + R_{t+3} + \dots + R_T",
    "eq-7": r"G_t \doteq R_{t+1} + \gamma R_{t+2} + \gamma^2 R_{t+3} + \dots = \sum_{k=0}^{\infty} \gamma^k R_{t+1+k}",
    "eq-8": r"G_t \doteq R_{t+1} + \gamma G_{t+1}",
    "eq-9": r"G_t \doteq \sum_{k=t+1}^{T} \gamma^{k-t-1} R_k",
    "eq-12": r"v_\pi(s) = \sum_a \pi(a \mid s) \sum_{s', r} p(s', r \mid s, a)\,\big[r + \gamma v_\pi(s')\big]",
    "eq-15": r"q_*(s, a) = \mathbb E[R_{t+1} + \gamma v_*(S_{t+1}) \mid S_t = s, A_t = a]",
    "eq-16": r"v_*(s) = \max_a \mathbb E[R_{t+1} + \gamma v_*(S_{t+1}) \mid S_t = s, A_t = a] "
    r"= \max_a \sum_{s', r} p(s', r \mid s, a)[r + \gamma v_*(s')]",
    "eq-17": r"q_*(s, a) = \mathbb E\big[R_{t+1} + \gamma \max_{a'} q_*(S_{t+1}, a') \mid S_t = s, A_t = a\big] "
    r"= \sum_{s', r} p(s', r \mid s, a)\big[r + \gamma \max_{a'} q_*(s', a')\big]",
    "eq-u-value-iteration": r"V_{k+1}(s) \leftarrow \max_a \sum_{s'} T(s, a, s')\big[R(s, a, s') + \gamma V_k(s')\big]",
    "om-bellman-q": r"q_\pi(s,a) = \sum_{s',r} p(s',r \mid s,a)"
    r"\Big[r + \gamma \sum_{a'} \pi(a' \mid s')\, q_\pi(s',a')\Big]",
    "om-bellman-derivation": r"v_\pi(s) = \mathbb E_\pi[R_{t+1} + \gamma G_{t+1} \mid S_t = s] = \sum_a \pi(a \mid s) "
    r"\sum_{s',r} p(s',r \mid s,a)\big[r + \gamma\, \mathbb E_\pi[G_{t+1} \mid S_{t+1} = s']\big]",
    "om-policy-evaluation": r"v_{k+1}(s) = \sum_a \pi(a \mid s) \sum_{s',r} p(s',r \mid s,a)[r + \gamma v_k(s')]",
    "om-policy-improvement": r"\pi'(s) = \arg\max_a \sum_{s',r} p(s',r \mid s,a)[r + \gamma v_\pi(s')]",
}
CHAPTERS = {
    "01_mdp": ["eq-2", "eq-3", "eq-4", "eq-5", "eq-6", "eq-7", "eq-8", "eq-9"],
    "02_bellman": ["eq-12", "eq-15", "eq-16", "eq-17", "om-bellman-q", "om-bellman-derivation"],
    "03_dynamic_programming": ["eq-u-value-iteration", "om-policy-evaluation", "om-policy-improvement"],
}
CHAPTER = {name: page for page, names in CHAPTERS.items() for name in names}


# ---------------------------------------------------------------------- a process, and what rlcore says


@cache
def world(seed=0):
    """A process with p(s', r | s, a) > 0 for every s' and r, values v and q that solve no equation, and an episode.

    Because they solve none, a right-hand side agrees with rlcore only if it is the same formula.
    """
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.ones(S * len(REWARDS)), size=(S, A))
    next_state = np.broadcast_to(np.repeat(np.arange(S), len(REWARDS)), p.shape)
    reward = np.broadcast_to(np.tile(REWARDS, S), p.shape)
    mdp = FiniteMDP(next_state, p, reward, np.ones((S, A), bool), np.zeros(S, bool), np.ones(S) / S)
    pi, v, q = rng.dirichlet(np.ones(A), size=S), 3 * rng.normal(size=S), rng.normal(size=(S, A))
    return mdp, pi, v, q, rng.normal(size=6)


def scope(seed, gamma):
    mdp, pi, v, q, rewards = world(seed)
    P, R = mdp.transition_probs(), mdp.expected_reward_sas()
    G = np.append(discounted_returns(rewards, gamma), 0.0)
    tables = {
        ("p|1", "", 4): mdp.p, ("p|0", "", 3): lambda s_next, s, a: P[int(s), int(a), int(s_next)],
        ("pi|0", "", 2): lambda a, s: pi[int(s), int(a)], ("r", "", 2): mdp.expected_reward(), ("r", "", 3): R,
        ("v", "pi", 1): v, ("v", "*", 1): v, ("v", "k", 1): v, ("V", "k", 1): v, ("q", "pi", 2): q, ("q", "*", 2): q,
        ("T", "", 3): P, ("R", "", 3): R, ("G", "", 1): lambda t: G[int(min(t, rewards.size))],
    }  # fmt: skip
    return Scope({"s": range(S), "a": range(A), "r": REWARDS}, tables, rewards, gamma)


def expected(name, seed, gamma):
    """What rlcore computes: an array over the variables that the equation leaves free."""
    mdp, pi, v, q, rewards = world(seed)
    return {
        "eq-2": lambda: np.ones((S, A)),
        "eq-3": mdp.transition_probs,
        "eq-4": mdp.expected_reward,
        "eq-5": mdp.expected_reward_sas,
        **dict.fromkeys(
            ("eq-6", "eq-7", "eq-9"),
            lambda: np.array([discounted_return(rewards, gamma, t) for t in range(rewards.size)]),
        ),
        "eq-8": lambda: discounted_returns(rewards, gamma),
        **dict.fromkeys(
            ("eq-12", "om-policy-evaluation", "om-bellman-derivation"), lambda: expectation_backup(mdp, pi, v, gamma)
        ),
        "eq-15": lambda: q_from_v(mdp, v, gamma),
        **dict.fromkeys(("eq-16", "eq-u-value-iteration"), lambda: optimality_backup(mdp, v, gamma)),
        "eq-17": lambda: optimality_backup_q(mdp, q, gamma),
        "om-bellman-q": lambda: expectation_backup_q(mdp, pi, q, gamma),
        "om-policy-improvement": lambda: policy_improvement(mdp, v, gamma).argmax(axis=1),
    }[name]()


FREE = {1: ("s",), 2: ("s", "a"), 3: ("s", "a", "s'")}
LEFT = {  # the left-hand side defines this symbol; it is compared as text, what it is equal to is computed
    "eq-3": "p(s'|s,a)", "eq-4": "r(s,a)", "eq-5": "r(s,a,s')", "eq-12": r"v_\pi(s)", "eq-15": "q_*(s,a)",
    "eq-16": "v_*(s)", "eq-17": "q_*(s,a)", "eq-u-value-iteration": "V_{k+1}(s)", "om-bellman-q": r"q_\pi(s,a)",
    "om-bellman-derivation": r"v_\pi(s)", "om-policy-evaluation": "v_{k+1}(s)", "om-policy-improvement": r"\pi'(s)",
    **dict.fromkeys(("eq-6", "eq-7", "eq-8", "eq-9"), "G_t"),
}  # fmt: skip


def check(name, latex):
    """AssertionError where a side of the equation is not what rlcore computes, SyntaxError where it cannot be read."""
    first = re.split(r"=|\\doteq|\\leftarrow", latex)[0]
    symbol = re.sub(r"\s|\\[,;!]|&|\\begin\{\w+\*?\}", "", first.replace(r"\mid", "|"))
    symbol = symbol.replace("^\\prime", "'").replace("_{*}", "_*").replace(r"_{\pi}", r"_\pi")
    if name in LEFT:
        assert symbol == LEFT[name], f"{name} defines {symbol}, not {LEFT[name]}"
    sums = sides(latex)
    assert len(sums) > 1, f"{name}: no sign of equality"
    for side in sums if name == "eq-2" else sums[1:]:
        for seed in range(20 if name == "om-policy-improvement" else 2):  # an argmax tells less than a number
            gamma = 1.0 if name == "eq-6" else GAMMAS[seed % 2]
            want, here = expected(name, seed, gamma), scope(seed, gamma)
            free = ("t",) if LEFT.get(name) == "G_t" else FREE[want.ndim]
            want = want[:3] if name == "eq-6" else want  # with R_{t+3} and R_T written out, T is t + 4 or more
            got = [side(here, dict(zip(free, index))) for index in np.ndindex(want.shape)]
            np.testing.assert_allclose(got, want.ravel(), rtol=1e-10, atol=1e-12, err_msg=f"{name}: {latex}")


# ---------------------------------------------------------------------- the page


@pytest.mark.parametrize("name", EQUATIONS)
def test_equation_on_the_page_is_what_rlcore_computes(name):
    assert name in printed(CHAPTER[name]), f"{name} is not on the page {CHAPTER[name]}"
    check(name, printed(CHAPTER[name])[name])


@pytest.mark.parametrize("name", EQUATIONS)
def test_equation_as_it_should_be_printed(name):
    check(name, EQUATIONS[name])


# ---------------------------------------------------------------------- the tester itself

BREAKS = {
    "sign": (r"(?<![kt])\s*\+(?!\d)", " - "),  # of a sum, not of an index
    "gamma": (r"\\gamma(?!\^)\s*", ""),
    "prime": (r"(v_\\pi|v_\*|v_k|V_k)\(s'\)", r"\1(s)"),
    "prime of q": (r"q_(\\pi|\*)\(s',\s*a'\)", r"q_\1(s, a')"),
    "policy": (r"\\pi\(a \\mid s\)", ""),
    "swapped": (r"p\(s',\s*r \\mid s,\s*a\)", r"p(s, r \\mid s', a)"),
    "maximum": (r"\\max_\{?a'?\}?", r"\\max_{s''}"),
    "sum for maximum": (r"(?<!\\arg)\\max(?=_)", r"\\sum"),
    "no maximum": (r"\\max_\{a'\} q_\*\(([^,]*), a'\)", r"q_*(\1, a)"),
    "reward": (r"(?<=[\[(]) *r \+", ""),
    "power": (r"\\gamma\^\{?k(-t-1)?\}?", r"\\gamma^{k+1}"),
    "index": (r"R_\{t\+1\+k\}|R_k", r"R_{k}" + " R_{1}"),
    "next return": (r"G_\{t\+1\}", "R_{t+1}"),  # the erratum of (8)
    "first term": (r"R_\{t\+2\}", "R_{t+1}"),
    "limit": (r"\^\{T\}", "^{t+2}"),
    "start": (r"k=t\+1|k=0", "k=t+2"),
    "one": (r"= 1$", "= 2"),
    "set": (r"\\sum_\{r \\in \\mathcal R\}", ""),
    "denominator": (r"\\frac\{([^}]*)\}\{[^}]*\}", r"\1"),
    "symbol": (r"^(\S)", r"x"),
    "condition": (r"A_(t|\{t-1\}) = a", r"A_\1 = 0"),
}


def broken():
    for name, latex in EQUATIONS.items():
        for kind, (pattern, new) in BREAKS.items():
            for i, found in enumerate(re.finditer(pattern, latex)):
                if kind == "symbol" and name == "eq-2":
                    continue  # it defines nothing: its first token is the sum
                yield pytest.param(
                    name, latex[: found.start()] + found.expand(new) + latex[found.end() :], id=f"{name}-{kind}-{i}"
                )


@pytest.mark.parametrize("name, latex", list(broken()))
def test_an_error_on_the_page_is_noticed(name, latex):
    with pytest.raises((AssertionError, SyntaxError, KeyError, IndexError)):
        check(name, latex)


def test_errata_of_the_document_are_noticed():
    for name, latex in {
        "eq-8": r"G_t \doteq R_{t+1} + \gamma R_{t+1}",
        "eq-12": r"v_\pi(s) \doteq \sum_a pi(a|s) \sum_{s', r} p(s', r \mid s, a)[r + \gamma v_\pi(s')]",
        "eq-17": r"q_*(s, a) = \mathbb E[R_{t+1} + \gamma G_{t+1} \mid S_t = s, A_t = a]",
    }.items():
        with pytest.raises((AssertionError, SyntaxError, KeyError)):
            check(name, latex)


def test_other_ways_to_write_the_same_are_read():
    same = {
        "eq-8": r"G_t = R_{t+1} + \gamma\, G_{t+1}, \qquad G_T = 0",
        "eq-9": r"G_t \doteq \sum_{k=t+1}^T \gamma^{k-t-1}\, R_k,\quad \text{T infinite or } \gamma = 1",
        "eq-12": r"\begin{aligned} v_\pi(s) &= \mathbb{E}_\pi\left[G_t \mid S_t = s\right] \\ "
        r"&= \mathbb{E}_{\pi}[R_{t+1} + \gamma G_{t+1} | S_t = s] \\ "
        r"&= \sum_{a} \pi(a|s) \sum_{s',\,r} p(s', r | s, a) \bigl[ r + \gamma\, v_{\pi}(s') \bigr] \end{aligned}",
        "eq-16": r"v_{*}(s) = \max_{a \in \mathcal{A}(s)} \sum_{s',r} p(s',r|s,a) \left[ r + \gamma v_{*}(s') \right].",
        "eq-2": r"\sum_{s' \in \mathcal{S}} \sum_{r \in \mathcal{R}} p(s', r \mid s, a) = 1, \quad \text{for all } s",
        "om-policy-improvement": r"\pi^\prime(s) = \arg\max_{a} "
        r"\mathbb E[R_{t+1} + \gamma v_\pi(S_{t+1}) \mid S_t = s, A_t = a]",
    }
    for name, latex in same.items():
        check(name, latex)
