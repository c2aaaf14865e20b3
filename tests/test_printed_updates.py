"""The updates of chapters 4 and 5 as they stand on the page: their LaTeX, evaluated along an episode, against rlcore.

The episode visits states 0, 1, ..., T in turn, so that one step of a method changes one entry.
"""

import re
from functools import cache

import numpy as np
import pytest
from latex import Scope, printed, sides

from rlcore.mdp import FiniteMDP, deterministic_policy, discounted_returns
from rlcore.monte_carlo import constant_alpha_mc
from rlcore.nstep import (
    complex_backup,
    forward_increments,
    lambda_return,
    n_step_return,
    n_step_td,
    offline_lambda_return,
)
from rlcore.td import q_learning, sarsa, td0, td_error
from rlcore.traces import backward_increments, credit, sarsa_lambda, trace_update, watkins_q_lambda

T, N, GAMMA, ALPHA, LAM = 6, 3, 0.7, 0.3, 0.6
PAGES = {
    "04_temporal_difference": ["eq-18", "eq-19", "eq-20", "eq-21", "om-td-error"],
    "05_eligibility_traces": [
        *(f"eq-{n}" for n in (22, 23, 24, 26, 29, 32, 33, 34, 35, 36, 37, 38, 39, 40, 41)),
        *(f"eq-u-trace-{kind}" for kind in ("accumulating", "dutch", "replacing")),
        "eq-u-complex-example",
    ],
}
PAGE = {name: page for page, names in PAGES.items() for name in names}


def rng(seed=0):
    return np.random.default_rng(seed)


@cache
def episode():
    """A chain with two actions that pay differently; actions taken, rewards, V, Q, traces before, one error."""
    draw = rng(3)  # A_1 is not the greedy action
    reward, actions = draw.normal(size=(T, 2)), draw.integers(2, size=T)
    chain = FiniteMDP.from_outcomes({(s, a): [(1.0, s + 1, reward[s, a])] for s in range(T) for a in (0, 1)}, start=0)
    V, Q = np.append(draw.normal(size=T), 0.0), np.vstack([draw.normal(size=(T, 2)), np.zeros(2)])
    return chain, actions, reward[np.arange(T), actions], V, Q, draw.random((T + 1, 2)), float(draw.normal())


def scope():
    _, actions, rewards, V, Q, E, delta = episode()
    L = lambda_return(rewards, V[:T], GAMMA, LAM)
    G = np.append(discounted_returns(rewards, GAMMA), 0.0)
    tables = {
        ("S", "", 1): lambda t: int(t), ("A", "", 1): lambda t: int(actions[int(t)]), ("G", "", 1): G, ("L", "", 1): L,
        ("delta", "indexed", 1): lambda t: delta, ("V", "", 1): V, ("V", "t", 1): V, ("Q", "", 2): Q, ("Q", "t", 2): Q,
        ("V", "T-1", 1): V, ("Delta", "t", 2): forward_increments(np.arange(T), rewards, V, GAMMA, LAM, ALPHA),
        ("E", "t-1", 1): E[:, 0], ("E", "t", 1): E[:, 0], ("E", "t-1", 2): E, ("E", "t", 2): E,
    }  # fmt: skip
    return Scope({"a": range(2)}, tables, rewards, GAMMA, {r"\alpha": ALPHA, r"\lambda": LAM})


def traced(kind):
    """The three traces of all pairs after the visit of (S_0, A_0), as (T + 1, 2)."""
    _, actions, _, _, _, E, _ = episode()
    visited = np.zeros_like(E)
    visited[0, actions[0]] = 1.0
    return trace_update(E, visited, GAMMA * LAM, kind, ALPHA)


def first_step(method, **settings):
    """Q(S_0, A_0) after one step of a control method that happened to take A_0."""
    chain, actions, _, _, Q, _, _ = episode()
    for seed in range(50):
        after = method(chain, seed=seed, **settings).Q
        if after[0, actions[0]] != Q[0, actions[0]]:
            return after[0, actions[0]]
    raise AssertionError("A_0 never came up")


def sarsa_error():
    """delta_0 of Sarsa(lambda) in a run that happened to take A_0 and A_1."""
    chain, actions, _, _, Q, _, _ = episode()
    for seed in range(50):
        one, two = (
            sarsa_lambda(chain, GAMMA, LAM, 1, alpha=ALPHA, epsilon=1.0, Q0=Q, max_steps=n, rng=rng(seed)).Q
            for n in (1, 2)
        )
        if [*(two != Q)[:2].argmax(axis=1)] == [*actions[:2]]:
            return (one - Q)[0, actions[0]] / ALPHA
    raise AssertionError("A_0 and A_1 never came up")


def expected(name):
    """(what rlcore computes, names of the free variables): a number at t = 0, or one for each s, or each s and a."""
    chain, actions, rewards, V, Q, E, delta = episode()
    pi = deterministic_policy(chain, np.append(actions, 0))
    learn = dict(alpha=ALPHA, rng=rng())
    step = dict(alpha=ALPHA, Q0=Q, max_steps=1)
    here = (0, actions[0])
    n_step = n_step_td(chain, pi, GAMMA, N, 1, V0=V, online=False, **learn)
    summed = offline_lambda_return(chain, pi, GAMMA, LAM, 1, V0=V, reading="summed", **learn)
    if name in ("eq-38", "eq-40"):
        table = Q.copy().reshape(-1)
        credit(table, E.copy().reshape(-1), np.arange(table.size), table.size, ALPHA * delta, 0.5)
        return table.reshape(Q.shape), ("s", "a")
    if name == "eq-29":
        return summed.V, ("s",)
    if name.startswith("eq-u-trace"):
        return traced(name.removeprefix("eq-u-trace-")), ("s", "a")
    if name == "eq-34":
        return trace_update(E[:, 0], np.zeros(T + 1), GAMMA * LAM, "accumulating"), ("s",)
    if name == "eq-37":
        change = np.zeros(T + 1)
        credit(change, E[:, 0].copy(), np.arange(T + 1), T + 1, ALPHA * delta, 0.5)
        return change, ("s",)
    return {
        "eq-18": lambda: constant_alpha_mc(chain, pi, GAMMA, 1, V0=V, **learn).V[0],
        "eq-19": lambda: td0(chain, pi, GAMMA, 1, V0=V, max_steps=1, **learn).V[0],
        "eq-20": lambda: sarsa(chain, GAMMA, 1, pi=pi, rng=rng(), **step).Q[here],
        "eq-21": lambda: first_step(lambda m, seed: q_learning(m, GAMMA, 1, epsilon=1.0, rng=rng(seed), **step)),
        "eq-22": lambda: n_step_return(rewards, V[:T], GAMMA, T, 0),
        "eq-23": lambda: n_step_return(rewards, V[:T], GAMMA, 1, 0),
        "eq-24": lambda: n_step_return(rewards, V[:T], GAMMA, 2, 0),
        "eq-26": lambda: n_step.V[0] - V[0],
        "eq-32": lambda: lambda_return(rewards, V[:T], GAMMA, LAM)[0],
        "eq-33": lambda: summed.V[0] - V[0],
        "eq-35": lambda: trace_update(E[0, 0], 1.0, GAMMA * LAM, "accumulating"),
        "eq-36": lambda: backward_increments([0, 1], rewards[:1], V, GAMMA, LAM, 1.0)[0, 0],
        "eq-39": lambda: sarsa_error(),
        "eq-41": lambda: (first_step(
            lambda m, seed: watkins_q_lambda(m, GAMMA, LAM, 1, epsilon=1.0, rng=rng(seed), **step)
        ) - Q[here]) / ALPHA,
        "eq-u-complex-example": lambda: complex_backup(rewards, V[:T], GAMMA, {2: 0.5, 4: 0.5})[0],
        "om-td-error": lambda: td_error(rewards[0], V[0], V[1], GAMMA),
    }[name](), ()  # fmt: skip


def right_side(latex):
    """What stands right of the first = or arrow; all of it where there is none."""
    text = re.sub(r"\\text\{[^}]*\}", "", latex)
    parts = re.split(r"=|\\leftarrow", re.split(r"\\q?quad", text)[0], maxsplit=1)
    return sides(f"x = {parts[-1]}")[1]


def check(name, latex):
    want, free = expected(name)
    side, here = right_side(latex), scope()
    want = np.asarray(want)
    index = [i for i in np.ndindex(want.shape) if not (name == "eq-34" and i == (0,))]  # s other than S_t
    got = [side(here, {"t": 0, "n": N, **dict(zip(free, i))}) for i in index]
    np.testing.assert_allclose(got, [want[i] for i in index], rtol=1e-10, atol=1e-12, err_msg=f"{name}: {latex}")


@pytest.mark.long
@pytest.mark.parametrize("name", PAGE)
def test_update_on_the_page_is_what_rlcore_does(name):
    check(name, printed(PAGE[name])[name])


BREAKS = {
    "sign": (r"(?<![kt])\s*\+(?!\d|n)", " - "),
    "gamma": (r"\\gamma(?!\^)", ""),
    "first": (r"t=0", "t=1"),
    "last": (r"(?<=0\})\^\{T-1\}", "^{T-2}"),
    "no sum": (r"\\sum_\{t=0\}\^\{T-1\}", ""),
    "alpha": (r"\\alpha", ""),
    "lambda": (r"\\lambda(?!\^)", ""),
    "state": (r"S_\{t\+[12n4]\}", "S_t"),
    "reward": (r"R_\{t\+1\}", "R_{t+2}"),
    "maximum": (r"\\max_\{a'?\}", r"\\sum_{a}"),
    "greedy": (r"Q(_t)?\(S_\{t\+1\}, A_\{t\+1\}\)", r"\\max_{a} Q\1(S_{t+1}, a)"),
    "index": (r"\^\{t\+n\}", "^{t+1}"),
    "half": (r"\\tfrac12", r"\\tfrac13"),
    "indicator": (r"I_\{aA_t\}", ""),
    "one more": (r"\+ 1$", "+ 2"),
    "parenthesis": (r"V\(S_\{t\+1\}\) - V\(S_t\)", "(V(S_{t+1}) - V(S_t))"),  # the erratum of (19)
}


def broken():
    for name in PAGE:
        latex = printed(PAGE[name])[name]
        equals = re.search(r"=|\\leftarrow", latex)
        start = equals.end() if equals else 0
        for kind, (pattern, new) in BREAKS.items():
            for i, found in enumerate(m for m in re.finditer(pattern, latex.split(r"\qquad")[0]) if m.start() >= start):
                text = latex[: found.start()] + found.expand(new) + latex[found.end() :]
                yield pytest.param(name, text, id=f"{name}-{kind}-{i}")


@pytest.mark.long
@pytest.mark.parametrize("name, latex", list(broken()))
def test_an_error_in_an_update_is_noticed(name, latex):
    with pytest.raises((AssertionError, SyntaxError, KeyError, IndexError)):
        check(name, latex)
