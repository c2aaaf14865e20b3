"""Equations of chapters 1 to 5 that need more than one step of a process, one bound for all states, or every policy.

Expectations are sums over every episode of a small process, maxima over policies run through all deterministic ones.
"""

import itertools
import re
from functools import cache

import numpy as np
import pytest
from latex import Scope, displays, printed, sides

from rlcore.bellman import expectation_backup, q_from_v, solve_policy
from rlcore.dp import value_iteration
from rlcore.envs import recycling_robot
from rlcore.mdp import FiniteMDP, deterministic_policy, discounted_returns, uniform_policy
from rlcore.nstep import error_reduction, lambda_return, n_step_return
from rlcore.optimizers import gradient_descent
from rlcore.studies.ch03 import objective, trajectory_probability
from rlcore.traces import trace_update

GAMMA, ALPHA, LAM, T = 0.7, 0.3, 0.6, 6
PAGES = {
    "01_mdp": ["eq-1", "eq-10", "eq-11", "eq-u-pole-return"],
    "02_bellman": ["eq-13", "eq-14", r"v(\text{high}) ="],
    "03_dynamic_programming": ["eq-u-traj-prob", "eq-u-objective", r"v \leftarrow"],
    "05_eligibility_traces": [
        "eq-25", "eq-30", "eq-31", "om-state-traces dutch", "om-state-traces replacing", "eq-u-watkins-trace greedy",
        "eq-u-watkins-trace otherwise",
    ],
}  # fmt: skip
PAGE = {name: page for page, names in PAGES.items() for name in names}
LEFT = {  # compared as text
    r"v(\text{high}) =": r"v(\text{high})", r"v \leftarrow": "v", "eq-25": "G_t^{t+n}(c)", "eq-31": "L_t",
    "eq-u-traj-prob": r"p_\theta(s_1, a_1, \dots, s_T, a_T)", "om-state-traces dutch": "E_t(S_t)",
    "om-state-traces replacing": "E_t(S_t)", "eq-u-watkins-trace greedy": "E_t(s, a)",
    "eq-u-watkins-trace otherwise": "E_t(s, a)",
}  # fmt: skip


def rng(seed=0):
    return np.random.default_rng(seed)


@cache
def layers():
    """States 0 and 1, then 2 and 3, then the end: two actions, three outcomes each, no two rewards alike; and pi."""
    draw, outcomes = rng(1), {}
    for s, a in itertools.product(range(4), (0, 1)):
        after = (2, 3, 3) if s < 2 else (4, 4, 4)
        outcomes[s, a] = [*zip(draw.dirichlet(np.ones(3)), after, draw.normal(size=3))]
    mdp = FiniteMDP.from_outcomes(outcomes, start=[0.3, 0.7, 0, 0, 0])
    pi = np.vstack([draw.dirichlet(np.ones(2), size=4), [0.5, 0.5]])
    return mdp, pi, np.append(draw.normal(size=4), 0.0)


@cache
def episodes(first=(0, 1, 2, 3)):
    """(probability, names) of every episode from each of these states; equally often from each."""
    mdp, pi, _ = layers()
    found = []

    def go_on(p, names, s, t):
        if mdp.terminal[s]:
            G = discounted_returns([names["R", k + 1] for k in range(t)], GAMMA)
            found.append((p, {**names, **{("G", k): g for k, g in enumerate(G)}}))
            return
        for a, k in itertools.product((0, 1), range(3)):
            seen = {("A", t): a, ("R", t + 1): mdp.reward[s, a, k], ("S", t + 1): int(mdp.next_state[s, a, k])}
            go_on(p * pi[s, a] * mdp.prob[s, a, k], {**names, **seen}, seen["S", t + 1], t + 1)

    for s in first:
        go_on(1.0, {("S", 0): s}, s, 0)
    return found


def layers_scope():
    mdp, pi, v = layers()
    v_pi = solve_policy(mdp, pi, GAMMA)
    tables = {
        ("v", "pi", 1): v_pi,
        ("q", "pi", 2): q_from_v(mdp, v_pi, GAMMA),
        ("v", "", 1): v,
        ("S", "", 1): lambda t: 4,
    }
    return Scope({"s": range(4)}, tables, (0.0, 0.0), GAMMA, trajectories=episodes())


def policies(mdp):
    actions = itertools.product(*(np.flatnonzero(row) for row in mdp.legal))
    return [deterministic_policy(mdp, np.array(a)) for a in actions]


def episode():
    """Rewards, values of the states met, traces before, state and pair of the visit."""
    draw = rng(3)
    return draw.normal(size=T), draw.normal(size=T), draw.random((T, 2)), 2, 1


def cases(name):
    """(scope, names, what rlcore computes: for every side, or one number)."""
    mdp, pi, v = layers()
    rewards, V, E, s_t, a_t = episode()
    if name == "eq-1":
        tables = {("p|1", "", 4): mdp.p}
        scope = Scope({"s": range(5), "a": (0, 1), "r": sorted({*mdp.reward[:4].ravel()})}, tables, gamma=GAMMA)
        for s, a, k in np.ndindex(4, 2, 3):
            names = {"s": s, "a": a, "s'": int(mdp.next_state[s, a, k]), "r": mdp.reward[s, a, k]}
            yield scope, names, mdp.prob[s, a, k]
    elif name in ("eq-10", "eq-11"):
        v_pi = solve_policy(mdp, pi, GAMMA)
        for s, a in np.ndindex(4, 2):
            yield layers_scope(), {"s": s, "a": a}, v_pi[s] if name == "eq-10" else q_from_v(mdp, v_pi, GAMMA)[s, a]
    elif name == "eq-30":
        for n in (1, 2):
            yield layers_scope(), {"n": n, "t": 0}, error_reduction(mdp, pi, v, n, GAMMA)
    elif name in ("eq-13", "eq-14"):
        best, scopes = value_iteration(mdp, GAMMA, tol=1e-12).V, []
        for one in policies(mdp):
            v_one = solve_policy(mdp, one, GAMMA)
            scopes.append(Scope({}, {("v", "pi", 1): v_one, ("q", "pi", 2): q_from_v(mdp, v_one, GAMMA)}))
        scope = Scope({r"\pi": scopes}, {("v", "*", 1): best, ("q", "*", 2): q_from_v(mdp, best, GAMMA)})
        for s, a in np.ndindex(4, 2):
            yield scope, {"s": s, "a": a}, best[s] if name == "eq-13" else q_from_v(mdp, best, GAMMA)[s, a]
    elif name == "eq-u-pole-return":
        for K in (1, 4):
            yield Scope({}, {}, gamma=GAMMA), {"K": K}, discounted_returns([0.0] * (K - 1) + [-1.0], GAMMA)[0]
    elif name == r"v(\text{high}) =":
        robot, values = recycling_robot(), rng(4).normal(size=2)
        want = expectation_backup(robot, uniform_policy(robot), values, 0.9)[0]
        yield Scope({}, {("v", "", 1): values}), {"high": 0, "low": 1}, want
    elif name == r"v \leftarrow":
        scope = Scope({}, {("C'", "", 1): np.cos}, greek={r"\epsilon": ALPHA})
        yield scope, {"v": 0.4}, gradient_descent(np.cos, 0.4, ALPHA, 1)[1]
    elif name == "eq-u-traj-prob":
        P = mdp.transition_probs()
        tables = {("p", "", 1): mdp.start, ("p|0", "", 3): lambda s_next, s, a: P[int(s), int(a), int(s_next)],
                  ("pi|0", "theta", 2): lambda a, s: pi[int(s), int(a)]}  # fmt: skip
        for states, actions in (((0, 3, 4), (1, 0, 0)), ((1, 2), (0, 1))):
            names = {("s", t): s for t, s in enumerate(states, 1)} | {("a", t): a for t, a in enumerate(actions, 1)}
            want = trajectory_probability(mdp, pi, states, actions)
            yield Scope({}, tables), {**names, "T": len(states)}, want
    elif name == "eq-u-objective":
        scopes, two = [], policies(mdp)[:6:5]
        for one in two:
            r, found = mdp.expected_reward(), []
            for s, s_next in itertools.product((0, 1), (2, 3)):
                a, a_next = one[s].argmax(), one[s_next].argmax()
                p = mdp.start[s] * mdp.transition_probs()[s, a, s_next]
                found.append((p, {"T": 0, ("s", 1): s, ("a", 1): a, ("s", 2): s_next, ("a", 2): a_next}))
            scopes.append(Scope({"t": (1, 2)}, {("r", "", 2): r}, trajectories=found))
        yield Scope({r"\theta": scopes}, {}), {}, max(objective(mdp, one, 2) for one in two)
    elif name == "eq-25":
        c = 1.3
        for n in (3, 5):
            want = n_step_return(rewards[:n], np.append(V[:n], c), GAMMA, n, 0)
            yield Scope({}, {}, rewards[:n], GAMMA), {"t": 0, "n": n, "h": n, "c": c}, want
    elif name == "eq-31":
        tables = {("S", "", 1): lambda t: min(t, T), ("V", "t", 1): np.append(V, 0.0)}
        scope = Scope({}, tables, rewards, GAMMA, {r"\lambda": LAM})
        for t, want in enumerate(lambda_return(rewards, V, GAMMA, LAM)):
            yield scope, {"t": t, "infinity": 60}, want  # lambda^60 is 5e-14
    else:
        tables = {("E", "t-1", 1): E[:, a_t], ("E", "t-1", 2): E,
                  ("S", "", 1): lambda t: s_t, ("A", "", 1): lambda t: a_t}  # fmt: skip
        scope = Scope({}, tables, rewards, GAMMA, {r"\alpha": ALPHA, r"\lambda": LAM})
        visited = np.zeros_like(E)
        visited[s_t, a_t] = 1.0
        if name.startswith("om-state-traces"):
            after = trace_update(E, visited, GAMMA * LAM, name.split()[1], ALPHA)
            yield scope, {"t": 0}, after[s_t, a_t]
            return
        cut = E if name.endswith("greedy") else 0 * E  # an action that was not greedy has cut them
        after = trace_update(cut, visited, GAMMA * LAM, "accumulating")
        for s, a in np.ndindex(after.shape):
            yield scope, {"t": 0, "s": s, "a": a}, after[s, a]


def check(name, latex):
    """AssertionError where a side of the equation is not what rlcore computes, SyntaxError where it cannot be read."""
    latex = re.sub(r"\\ ?\\text\{\([a-z]+\)\}|\\cdot", "", latex)
    if name in LEFT:
        left, latex = re.split(r"=|\\leftarrow", latex, maxsplit=1)
        assert left.strip() == LEFT[name], f"{name} is about {left}, not {LEFT[name]}"
    for scope, names, want in cases(name):
        found = sides(latex)
        wants = want if name == "eq-30" else [want] * len(found)
        for side, want in zip(found, wants, strict=True):
            got = side(scope, {"t": 0, **names})
            np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-12, err_msg=f"{name}: {latex}")


# ---------------------------------------------------------------------- the page


@cache
def on_page(name):
    if name.startswith("v"):
        return next(x.strip() for ids, x in displays(PAGE[name]) if not ids and x.strip().startswith(name))
    key, _, kind = name.partition(" ")
    latex = re.split(r", \\qquad", printed(PAGE[name])[key])
    if kind in ("dutch", "replacing"):
        return latex[kind == "replacing"].strip()
    if kind:
        left, greedy, otherwise = re.split(r"\\begin\{cases\}|\\\\", latex[0])
        return left + (greedy if kind == "greedy" else otherwise).split("&")[0]
    return latex[0].strip()


@pytest.mark.parametrize("name", PAGE)
def test_equation_on_the_page_is_what_rlcore_computes(name):
    check(name, on_page(name))


def test_traces_of_watkins_are_cut_where_the_action_was_not_greedy():
    latex = printed("05_eligibility_traces")["eq-u-watkins-trace"]
    condition = re.search(r"\\text\{if \} (.*?);", latex)[1]
    assert re.search(r"\\text\{otherwise", latex)
    left, right = sides(condition)
    for a in (0, 1):
        Q = np.array([[0.5, 2.0]])
        tables = {("Q", "t-1", 2): Q, ("S", "", 1): lambda t: 0, ("A", "", 1): lambda t, a=a: a}
        scope = Scope({"a": (0, 1)}, tables)
        assert (left(scope, {"t": 0}) == right(scope, {"t": 0})) == (a == 1)


# ---------------------------------------------------------------------- the tester itself

BREAKS = {
    "plus": (r"(?<![tk\d])(?<![TK]) *\+ *(?!\d\})(?!k)", "-"),
    "minus": (r" - ", " + "),
    "negative": (r"^-", ""),
    "gamma": (r"\\gamma(\^n|\^k)? ", ""),
    "power": (r"\\gamma\^(\{K-1\}|\{n-1\})", r"\\gamma"),
    "maximum": (r"\\max_\\(pi|theta)", ""),
    "maximum over states": (r"\\max_s", r"\\sum_s"),
    "absolute": (r"\|v\(s\) - ", "|v_\\\\pi(s) - "),
    "condition": (r"S_(t|\{t-1\}) = s", r"S_\1 = 0"),
    "action": (r"A_(t|\{t-1\}) = a", r"A_\1 = 0"),
    "reward": (r"R_\{t\+k\+1\}", "R_{t+1}"),
    "return": (r"G_t \\mid", r"R_{t+1} \\mid"),
    "symbol": (r"^(\S)", r"y"),
    "last": (r"\^\{T-1\}", "^{T}"),
    "last action": (r"\\pi_\\theta\(a_T \\mid s_T\)", ""),
    "next": (r"p\(s_\{t\+1\}", "p(s_t"),
    "rewards": (r"r\(s_t, a_t\)", "r(s_1, a_1)"),
    "rate": (r"\\epsilon", ""),
    "slope": (r"C'\(v\)", "C'(0)"),
    "number": (r"0\.1", "0.2"),
    "state": (r"\(\\text\{low\}\)", r"(\\text{high})"),
    "bootstrap": (r"S_\{t\+n\}", "S_t"),
    "lambda": (r"\\lambda(\^\{n-1\})?", ""),
    "indicator": (r"I_\{(sS|aA)_t\}", ""),
    "one": (r"= 1", "= 2"),
    "event": (r"R_t = r", "R_t = 0"),
}


def broken():
    for name in PAGE:
        latex = on_page(name)
        for kind, (pattern, new) in BREAKS.items():
            for i, m in enumerate(re.finditer(pattern, latex)):
                if not (kind == "maximum" and m.start() == 0):
                    yield name, kind, i, latex[: m.start()] + m.expand(new) + latex[m.end() :]


@pytest.mark.parametrize("name, latex", [pytest.param(n, x, id=f"{n}-{kind}-{i}") for n, kind, i, x in broken()])
def test_an_error_on_the_page_is_noticed(name, latex):
    with pytest.raises((AssertionError, SyntaxError, KeyError, IndexError, ValueError)):
        check(name, latex)


def test_every_equation_is_broken():
    kinds = {name: {kind for n, kind, *_ in broken() if n == name} for name in PAGE}
    assert all(found - {"symbol"} for found in kinds.values()), kinds
