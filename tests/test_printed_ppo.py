"""The equations of chapter 8 as they stand on the page, evaluated on a random batch and compared with rlcore.

Objectives are compared twice: their values with `rlcore.losses`, and where gradient ascent on what the page says, by
central differences, leads to with the epochs of `ppo`.
"""

import operator
import re
from functools import cache

import numpy as np
import pytest
from latex import NOTICED, Scope, broken, gradient, inline, printed, sides, unnamed

from rlcore import trust_region as sur
from rlcore.bellman import q_from_v, solve_policy
from rlcore.core.agents import ActorCritic
from rlcore.core.rollouts import Rollout
from rlcore.distributions import Categorical
from rlcore.envs import random_mdp
from rlcore.gae import gae, learning_data
from rlcore.nn import MLP
from rlcore.optimizers import SGD
from rlcore.policies import softmax_policy
from rlcore.ppo import PPOConfig, improve, objective_gradient
from rlcore.studies.ch08 import supervised_logprob_grad
from rlcore.trpo import TRPOConfig, _surrogate_gradient, conjugate_gradient, fisher_vector_product, trpo_step

PAGE = "08_ppo"
S, ACTIONS, B = 3, 3, 16  # B samples
GAMMA, LAM, EPSILON, BETA, C1, C2, LR, DELTA = 0.9, 0.7, 0.2, 0.7, 0.3, 0.4, 2.0, 0.01
INLINE = {  # key: (anchor, how it begins)
    "(1 - p) x": ("alg-supervised-logprob", r"(1 - p)"),
    "sum of advantages": ("cl-122", r"\sum_a"),
    "KL": ("cl-123", "KL[p, q]"),
    "box-trpo system": ("alg-trpo", "H x"),
    "box-trpo step": ("alg-trpo", r"\theta \leftarrow"),
    "penalised step": ("cl-130", r"\pi(a) ="),
    "box-ppo target": ("om-ppo-box", r"V_t^{targ} ="),
}
BOUND = r"\eta(\pi) \ge"
PARTS = {  # of equations side by side: (id, or how an unnamed one begins; number)
    "om-gae": ("om-gae", 0), "om-gae error": ("om-gae", 1),
    "om-trpo-step": ("om-trpo-step", 0), "om-trpo-step system": ("om-trpo-step", 1),
    BOUND: (BOUND, 0), "bound, C": (BOUND, 1), "bound, epsilon": (BOUND, 2),
    "L_t^{VF}": ("L_t^{VF}", 0), "L_t^{VF}, entropy": ("L_t^{VF}", 1),
}  # fmt: skip
LEFT = {  # compared as text
    "eq-ppo-41": r"\hat g", "eq-ppo-43": r"L^{PG}(\theta)", "eq-ppo-47": r"r_t(\theta)",
    "eq-ppo-48": r"L^{CPI}(\theta)", "eq-ppo-49": r"L^{CLIP}(\theta)", "eq-ppo-50": r"L_t^{CLIP+VF+S}(\theta)",
    "L_t^{VF}": "L_t^{VF}",
    "L_t^{VF}, entropy": r"S[\pi](s)", "om-gae": r"\hat A_t", "om-gae error": r"\delta_t", "om-trpo-step": r"\theta",
    "box-trpo step": r"\theta", "box-ppo target": "V_t^{targ}", "penalised step": r"\pi(a)", "bound, C": "C",
    "bound, epsilon": r"\epsilon",
}  # fmt: skip
ASCENT = {  # what the epochs of ppo climb on
    "eq-ppo-43": PPOConfig(objective="none", epochs=1, c1=0),
    "eq-ppo-44": PPOConfig(objective="none", epochs=2, c1=0),
    "eq-ppo-46": PPOConfig(objective="kl_fixed", epochs=2, beta=BETA, c1=0),
    "eq-ppo-48": PPOConfig(objective="none", epochs=2, c1=0),
    "eq-ppo-49": PPOConfig(epochs=2, clip=EPSILON, c1=0),
    "eq-ppo-50": PPOConfig(epochs=2, clip=EPSILON, c1=C1, c2=C2),
}
RELATIONS = {r"\le": operator.le, r"\ge": operator.ge}
RELATED = {"eq-ppo-45": r"\le", BOUND: r"\ge"}
TESTED = [*INLINE, *PARTS, *LEFT, *ASCENT, "eq-ppo-40", "eq-ppo-42", "eq-ppo-45", "om-adaptive-beta"]
TESTED = list(dict.fromkeys(TESTED))


def rng(seed=0):
    return np.random.default_rng(seed)


# ---------------------------------------------------------------------- a batch, and what rlcore says


@cache
def batch():
    """x (B, S), a one in the place of the state; states; actions; advantages; targets of the values."""
    draw = rng(1)
    s, a = draw.integers(S, size=B), draw.integers(ACTIONS, size=B)
    return np.eye(S)[s], s, a, draw.normal(size=B), draw.normal(size=B)


def agent(seed=2, spread=0.7):
    nets = [MLP([S, n], optimizer=SGD(LR), dtype=np.float64, rng=rng(0)) for n in (ACTIONS, 1)]
    for net in nets:
        net.theta[:] = spread * rng(seed).normal(size=net.theta.size)
    return ActorCritic(*nets)


def losses():
    return pytest.importorskip("rlcore.losses")


def tensors(*arrays):
    torch = pytest.importorskip("torch")
    return [torch.tensor(np.asarray(array)) for array in arrays]


def scope_of(new, old):
    """The page's symbols for two agents and the batch; probabilities follow the agents' parameters."""
    x, s, a, A, target = batch()
    actions, rows = np.arange(ACTIONS), np.eye(S)
    before = old.forward(x)[0]

    def probability(agent):
        return lambda a, s: agent.forward(rows[[s]])[0].probs[0, actions[a if isinstance(a, slice) else int(a)]]

    def ratio(t, theta):
        return objective_gradient(new.forward(x)[0], before, a, before.log_prob(a), A, PPOConfig())[1][t]

    def one_sample(objective, *more):
        def value(t, theta):
            return objective(*tensors(new.forward(x[[t]])[0].logits, before.logits[[t]], a[[t]], A[[t]]), *more).item()

        return value

    tables = {
        ("s", "indexed", 1): lambda t: int(s[t]), ("a", "indexed", 1): lambda t: int(a[t]), ("A", "", 1): A,
        ("theta", "", 0): new.net.theta, ("thetaold", "", 0): lambda: old.net.theta, ("r", "t", 2): ratio,
        ("pi|0", "theta", 2): probability(new), ("pi|0", "thetaold", 2): probability(old),
        ("pi|0", "", 2): probability(new), ("Vtarg", "indexed", 1): target,
        ("KL", "", 2): kl, ("min", "", 2): np.minimum, ("clip", "", 3): np.clip, ("delta", "", 0): np.array(DELTA),
        ("LCLIP", "t", 2): one_sample(losses().clip_objective, EPSILON),
        ("LCPI", "t", 2): one_sample(losses().surrogate), ("c", "indexed", 1): lambda i: (C1, C2)[int(i) - 1],
        ("LVF", "t", 2): lambda t, theta: losses().value_loss(*tensors(new.forward(x[[t]])[1], target[[t]])).item(),
        ("S", r"pi_\theta", 1): lambda s: losses().entropy(*tensors(new.forward(rows[[s]])[0].logits)).item(),
        ("V", "theta", 1): lambda s: new.forward(rows[[s]])[1][0],
    }  # fmt: skip
    return Scope({"t": range(B), "a": actions}, tables, greek={r"\epsilon": EPSILON, r"\beta": BETA})


def kl(p, q):
    return Categorical(np.log(p)).kl(Categorical(np.log(q)))


def climb(side, epochs):
    """Parameters of both networks after plain ascent, step by step, on what the page says."""
    new, old = agent(), agent()
    scope = scope_of(new, old)
    for _ in range(epochs):
        thetas = new.net.theta, new.critic.theta
        slopes = [gradient(lambda: side(scope, {}), theta) for theta in thetas]
        for theta, slope in zip(thetas, slopes):
            theta += LR * slope
    return np.concatenate([new.net.theta, new.critic.theta])


@cache
def improved(name):
    """The same, by the epochs of ppo; far enough for every ratio to leave its range."""
    x, _, a, A, target = batch()
    new = agent()
    improve(new, (x, a, A, target), ASCENT[name], BETA, rng())
    return np.concatenate([new.net.theta, new.critic.theta])


def objective_value(name, new, old):
    """What rlcore.losses has for it."""
    x, _, a, A, target = batch()
    (policy, values), L = new.forward(x), losses()
    out, before, a, A, values, target = tensors(policy.logits, old.forward(x)[0].logits, a, A, values, target)
    return {
        "eq-ppo-43": lambda: L.pg_objective(out, a, A),
        "eq-ppo-46": lambda: L.kl_penalised(out, before, a, A, BETA),
        "eq-ppo-49": lambda: L.clip_objective(out, before, a, A, EPSILON),
        "eq-ppo-50": lambda: L.ppo_objective(out, before, a, A, values, target, EPSILON, C1, C2),
    }.get(name, lambda: L.surrogate(out, before, a, A))().item()


@cache
def natural_step():
    """A step of TRPO that was not cut: the agents before and after, its record, g and the Fisher matrix."""
    x, _, a, A, _ = batch()
    old, new, config = agent(), agent(), TRPOConfig(delta=DELTA, damping=0.1, cg_steps=30)
    policy = old.forward(x)[0]
    g = _surrogate_gradient(old, policy, a, A)
    H = np.array([fisher_vector_product(old, policy, v, config.damping) for v in np.eye(g.size)])
    record = trpo_step(new, x, a, A, config)
    assert record[2] == 0
    return old, new, record, g, H


@cache
def exact():
    """A process, an old policy, whose largest advantage is a negative one, and a new policy."""
    mdp, pi = random_mdp(4, 3, n_next=2, rng=rng(9)), softmax_policy(rng(7).normal(size=(3, 4)))
    return mdp, sur.old_policy(mdp, pi, GAMMA), softmax_policy(rng(8).normal(size=(3, 4)))


def exact_scope():
    mdp, old, new = exact()
    V = solve_policy(mdp, old.pi, GAMMA)

    def row(pi):
        return lambda a, s: pi[int(s), a]

    tables = {
        ("A", "", 2): sur.advantage(mdp, old.pi, GAMMA), ("Q", "", 2): q_from_v(mdp, V, GAMMA), ("V", "", 1): V,
        ("A", "piold", 2): old.A, ("pi", "", 0): lambda: new, ("pi|0", "", 2): lambda a, s: new[int(s), a],
        ("piold|0", "", 2): lambda a, s: old.pi[int(s), a], ("KL", "", 2): kl,
        ("eta", "", 1): lambda pi: sur.eta(mdp, pi, GAMMA), ("C", "", 0): lambda: sur.penalty_coefficient(old),
        ("L", "piold", 1): lambda pi: sur.local_performance(old, pi),
    }  # fmt: skip
    return Scope({"s": range(4), "a": range(3)}, tables, gamma=GAMMA, greek={r"\epsilon": np.abs(old.A).max()})


def episode_scope(r, V, delta):
    """An episode through states 0, 1, ..., T."""
    last = len(r) - 1
    tables = {
        ("s", "indexed", 1): lambda t: t, ("V", "", 1): V,
        ("delta", "indexed", 1): lambda t: delta[int(t)] if t <= last else 0.0,
    }  # fmt: skip
    return Scope({"l": range(last + 1)}, tables, rewards=r, gamma=GAMMA, greek={r"\lambda": LAM})


def cases(name):
    """(scope, names, what rlcore computes: for all sides, or a tuple with one for each)."""
    x, s, a, A, target = batch()
    new, old = agent(3), agent(4)
    if name in ASCENT:
        yield scope_of(new, old), {}, objective_value(name, new, old)
    elif name in ("eq-ppo-40", "(1 - p) x"):
        net, up = MLP([4, 2], dtype=np.float64, rng=rng(5)), rng(6).normal(size=4)
        want = supervised_logprob_grad(net, up, 1)
        p = {("p|0", "", 2): lambda y, x: Categorical(net.forward(x)).probs[int(y)]}
        tables = {**p, ("W", "", 0): net.theta, ("UP", "", 0): np.array(1)}
        chance = Categorical(net.forward(up)).probs[1]
        yield Scope({}, tables), {"x": up, "p": chance}, want if name == "eq-ppo-40" else want[4:8]
    elif name == "eq-ppo-41":
        yield scope_of(new, old), {}, _surrogate_gradient(new, new.forward(x)[0], a, A)
    elif name == "eq-ppo-47":
        r = losses().ratio(*tensors(new.forward(x)[0].logits, old.forward(x)[0].logits, a)).numpy()
        assert all(((r * sign > edge * sign) & (A * a_sign > 0)).any() for sign, edge in ((1, 1.2), (-1, 0.8))
                   for a_sign in (1, -1)), "a case of clipping is not in the batch"  # fmt: skip
        for t in range(B):
            np.testing.assert_allclose(scope_of(new, old).call("r", "t", [t, None]), r[t])
            yield scope_of(new, old), {"t": t}, r[t]
    elif name == "eq-ppo-42":
        mdp, before, _ = exact()
        for at in np.ndindex(4, 3):
            yield exact_scope(), dict(zip("sa", at)), sur.advantage(mdp, before.pi, GAMMA)[at]
    elif name == "sum of advantages":
        mdp, _, pi = exact()
        scope = exact_scope()
        scope.tables["A", "", 2] = sur.advantage(mdp, pi, GAMMA)
        for state in range(4):
            yield scope, {"s": state}, 0.0
    elif name == "eq-ppo-45":
        before, after, (moved, _, _), *_ = natural_step()
        out = tensors(before.forward(x)[0].logits, after.forward(x)[0].logits)
        np.testing.assert_allclose(losses().mean_kl(*out).item(), moved)
        yield scope_of(after, before), {}, (moved, DELTA)
    elif "trpo" in name:
        before, after, _, g, H = natural_step()
        direction = conjugate_gradient(lambda v: H @ v, g, 30, tol=1e-24 if "system" in name else 1e-10)
        names = {"x": direction, "H": H, "g": g}
        yield scope_of(after, before), names, g if "system" in name else after.net.theta
    elif name in (BOUND, "bound, C", "bound, epsilon"):
        mdp, before, after = exact()
        C = sur.penalty_coefficient(before)
        yield exact_scope(), {}, {
            BOUND: (sur.eta(mdp, after, GAMMA), sur.lower_bound(before, after)),
            "bound, C": C, "bound, epsilon": C * (1 - GAMMA) ** 2 / (4 * GAMMA),
        }[name]  # fmt: skip
    elif name == "penalised step":
        before = exact()[1]
        after = sur.penalised_step(before, BETA)
        for state in range(4):
            nu = BETA * before.pi[state, 0] / after[state, 0] + before.A[state, 0]
            tables = {("piold", "", 1): before.pi[state], ("A", "", 1): before.A[state], ("pi", "", 1): after[state]}
            for action in (1, 2):
                yield Scope({}, tables, greek={r"\beta": BETA}), {"a": action, "nu": nu}, after[state, action]
    elif name == "KL":
        p, q = rng(9).dirichlet(np.ones(5), size=2)
        scope = Scope({"a": range(5)}, {("p", "", 1): p, ("q", "", 1): q, ("KL", "", 2): kl})
        yield scope, {"p": p, "q": q}, kl(p, q)
    elif name in ("om-gae", "om-gae error"):
        T = 6
        r, V, ends = rng(10).normal(size=T), rng(11).normal(size=T + 1), np.arange(T) == T - 1
        for terminal in (True, False):
            flags = (ends & terminal, ends & (not terminal))
            worth = np.append(V[:-1], 0.0 if terminal else V[-1])
            delta, want = (gae(r, V[:-1], V[1:], *flags, GAMMA, lam) for lam in (0.0, LAM))
            for t in range(T):
                yield episode_scope(r, worth, delta), {"t": t}, (want if name == "om-gae" else delta)[t]
    elif name == "box-ppo target":
        config, steps = PPOConfig(normalise_advantages=False, gamma=GAMMA, lam=LAM), np.zeros((B - 1, 1))
        rollout = Rollout(x[:, None], a[:-1, None], rng(12).normal(size=(B - 1, 1)), steps > 0, steps > 0, steps == 0)
        *_, advantage, want = learning_data(old, rollout, config)
        scope = scope_of(new, old)
        scope.tables |= {("A", "", 1): advantage, ("V", "thetaold", 1): lambda s: old.forward(np.eye(S)[[s]])[1][0]}
        for t in range(B - 1):
            yield scope, {"t": t}, want[t]
    elif name == "L_t^{VF}":
        values = new.forward(x)[1]
        for t in range(B):
            yield scope_of(new, old), {"t": t}, losses().value_loss(*tensors(values[[t]], target[[t]])).item()
    else:
        assert name == "L_t^{VF}, entropy"
        want = new.forward(np.eye(S))[0].entropy()
        np.testing.assert_allclose(losses().entropy(*tensors(new.forward(np.eye(S))[0].logits)), want)
        for state in range(S):
            yield scope_of(new, old), {"s": state}, want[state]


def check(name, latex):
    """AssertionError where a side of the equation is not what rlcore computes, SyntaxError where it cannot be read."""
    if name == "om-adaptive-beta":
        return check_rule(latex)
    found = sides(latex)
    symbol = re.split(r"(?<!\\)=|\\leftarrow", latex)[0].strip()
    assert name not in LEFT or symbol == LEFT[name], f"{name} is about {symbol}, not {LEFT[name]}"
    for scope, names, want in cases(name):
        got = [np.squeeze(side(scope, names)) for side in found[name in LEFT :]]
        assert got, f"{name}: no sign of equality"
        for value, expected in zip(got, want if isinstance(want, tuple) else [want] * len(got), strict=True):
            assert value.shape == np.shape(expected), f"{name}: shape {value.shape}, not {np.shape(expected)}"
            np.testing.assert_allclose(value, expected, rtol=1e-6, atol=1e-8, err_msg=f"{name}: {latex}")
        if name in RELATED:
            sign = re.search(r"\\[lg]e(?![a-z])", latex)[0]
            assert sign == RELATED[name] and RELATIONS[sign](*got)
    if name in ASCENT:
        after = climb(found[-1], ASCENT[name].epochs)
        np.testing.assert_allclose(after, improved(name), rtol=1e-6, atol=1e-7, err_msg=f"{name}: {latex}")


def check_rule(latex):
    """d < ...: beta <- ...; d > ...: beta <- ..., each tried on both sides of its edge."""
    target, relations = 0.03, {"<": operator.lt, ">": operator.gt}
    rules = [part.split(":", 1) for part in re.split(r"; \\qquad", latex.replace(r":\ ", ": "))]
    assert len(rules) == 2
    for d in target * np.array([0.3, 0.66, 0.67, 1.0, 1.49, 1.51, 2.5]):
        scope, beta = Scope({}, {("dtarg", "", 0): np.array(target)}, greek={r"\beta": BETA}), BETA
        for condition, update in rules:
            assert update.strip().startswith(r"\beta \leftarrow")
            left, right = (side(scope, {"d": d}) for side in sides(condition))
            if relations[re.search("[<>]", condition)[0]](left, right):
                beta = sides(update)[1](scope, {})
        assert beta == pytest.approx(sur.adapt_beta(BETA, d, target)), f"d = {d}: {latex}"


# ---------------------------------------------------------------------- the page


@cache
def on_page(name):
    if name in INLINE:
        return inline(PAGE, *INLINE[name]).strip()
    key, part = PARTS.get(name, (name, None))
    found = printed(PAGE)
    latex = found[key] if key in found else next(x for x in unnamed(PAGE) if x.startswith(key))
    return latex.strip() if part is None else re.split(r"[,;] \\q?quad", latex)[part].strip()


@pytest.mark.parametrize("name", TESTED)
def test_equation_on_the_page_is_what_rlcore_computes(name):
    check(name, on_page(name))


# ---------------------------------------------------------------------- the tester itself

BREAKS = {
    "plus": (r"(?<![A-Zt{])\+ ?(?!\d)", "- "),
    "minus": (r"(?<!\{)- ?", "+ "),
    "negative": (r"= -", "= "),
    "subscript": (r"\\nabla_", r"\\nabla "),
    "no gradient": (r"\\nabla_\S+ ", ""),
    "label": (r"UP", "DOWN"),
    "logarithm": (r"\\(log|ln) ", ""),
    "new for old": (r"\\pi_\{\\theta_\{old\}\}", r"\\pi_\\theta"),
    "old for new": (r"\\pi_\\theta\(", r"\\pi_{\\theta_{old}}("),
    "inverted": (r"\\frac\{(\\pi_.*?\(.*?\))\}\{(\\pi_.*?\(.*?\))\}", r"\\frac{\2}{\1}"),
    "fraction": (r"\\frac\{(.*?)\}\{q\(a\)\}", r"\1"),
    "wrong fraction": (r"p\(a\)\}\{q\(a\)", "q(a)}{p(a)"),
    "advantage": (r" ?\\hat A_t", ""),
    "swapped": (r"KL\[(\\pi_.*?\)), (\\pi.*?\))\]", r"KL[\2, \1]"),
    "weight": (r"\\sum_a (p\(a\)|\\pi\(a \\mid s\)) ", r"\\sum_a "),
    "minimum": (r"\\min", r"\\max"),
    "clipped": (r"\\mathrm\{clip\}\((.*?\)),", r"\\mathrm{clip}(1,"),
    "range": (r"1 - \\epsilon, 1 \+ \\epsilon", r"1 + \\epsilon, 1 - \\epsilon"),
    "epsilon": (r"\\epsilon(?! =)", r"\\beta"),
    "beta": (r"\\beta(\\,| ) ?", ""),
    "relation": (r"\\le(?![a-z])", r"\\ge"),
    "other relation": (r"\\ge", r"\\le"),
    "less": (r"<", ">"),
    "more": (r">", "<"),
    "delta": (r"\\delta$", r"2\\delta"),
    "two deltas": (r"2\\delta", r"\\delta"),
    "one and a half": (r"1\.5", "2"),
    "half": (r"/2", "/3"),
    "twice": (r"2\\beta", r"3\\beta"),
    "target": (r"d_\{targ\}", "d"),
    "four": (r"4 ", "2 "),
    "square": (r"\^2", ""),
    "gamma": (r"\\gamma ?(?!\))", ""),
    "lambda": (r"\\lambda(?=\))", ""),
    "power": (r"\^l", ""),
    "terms": (r"\\ge 0", r"\\ge 1"),
    "later": (r"_\{t\+[l1]\}", "_t"),
    "state": (r"\(s_t\)", "(s_{t+1})"),
    "root": (r"\\sqrt", ""),
    "matrix": (r"H", ""),
    "direction": (r"(\\,|\\;) x", ""),
    "solution": (r"^H x", "H g"),
    "over states": (r"\\max_s", ""),
    "coefficient": (r"C \\max", r"\\max"),
    "absolute": (r"\|A(.*)\|", r"A\1"),
    "signed": (r"\\max_\{s,a\} \|", r"-\\max_{s,a} |"),
    "value": (r"- V\(s(_t)?\)", ""),
    "clip or not": (r"L_t\^\{CLIP\}", "L_t^{CPI}"),
    "name": (r"CLIP\+VF", "CPI+VF"),
    "other name": (r"^L\^\{\w+\}", r"L^{VF}"),
    "weights": (r"c_1", "c_2"),
    "other weights": (r"c_2", "c_1"),
    "no weight": (r"c_. ", ""),
    "entropy": (r"S\[\\pi_\\theta\]\(s_t\)", "1"),
    "one": (r"\(1 - p\)", "p"),
    "old step": (r"\\theta_\{old\} \+", r"\\theta +"),
    "zero": (r"= 0$", "= 1"),
    "symbol": (r"^(?=\S)", r"x "),
}


BROKEN = broken({name: on_page(name) for name in TESTED}, BREAKS)


@pytest.mark.parametrize("name, latex", [pytest.param(n, x, id=f"{n}-{kind}-{i}") for n, kind, i, x in BROKEN])
def test_an_error_on_the_page_is_noticed(name, latex):
    with pytest.raises(NOTICED):
        check(name, latex)


def test_every_equation_is_broken():
    kinds = {name: {kind for n, kind, *_ in BROKEN if n == name} for name in TESTED}
    assert all(found - {"symbol"} for found in kinds.values()), kinds
