r"""The derivations of chapters 1 to 4: on which processes each is evaluated, which variables are free."""

import itertools

import numpy as np
from latex import Scope
from processes import GAMMAS, Derivation, Numbers, Process, random_mdp, rng, times

from rlcore.bellman import greedy, optimality_backup, q_from_v, solve_policy
from rlcore.dp import value_iteration
from rlcore.mdp import FiniteMDP, discounted_returns

# ---------------------------------------------------------------------- chapter 1


def returns():
    for seed, gamma in enumerate(GAMMAS):
        rewards = rng(seed).normal(size=6)
        G = np.append(discounted_returns(rewards, gamma), np.zeros(9))
        yield Scope({}, {("G", "", 1): G}, rewards, gamma), times(t=range(4))


def constant_rewards(n_rewards=None):
    for gamma, r in zip(GAMMAS, (1.3, -0.6)):
        for n in (1, 2, 5) if n_rewards is None else (n_rewards,):
            G = discounted_returns([r] * n, gamma)
            yield Scope({}, {("G", "", 1): G}, (r,) * n, gamma), [{"t": 0, "n": n, "r": r}]


def histories():
    """Two steps of a process behind, with other states and rewards each time, and what may come."""
    for seed, gamma in enumerate(GAMMAS):
        mdp, draw = random_mdp(seed), rng(seed)
        scope = Process(mdp, gamma, {"pi": draw.dirichlet(np.ones(2), size=3)}, {})
        found = []
        for s_next, r, t in itertools.product(range(3), scope.sets["r"], (1, 2)):
            past = {("S", k): int(draw.integers(3)) for k in range(t + 1)}
            past |= {("A", k): int(draw.integers(2)) for k in range(t + 1)}
            past |= {("R", k): float(draw.choice(scope.sets["r"])) for k in range(1, t + 1)}
            found.append({"s'": s_next, "r": r, "t": t, **past})
        yield scope, found


def rolling_ball():
    x, u = 0.3, -1.7
    tables = {("x", "indexed", 1): lambda t: x + u * t, ("u", "indexed", 1): lambda t: u}
    yield Scope({}, tables), times(t=(1, 2))


def independent_numbers():
    """Every outcome of n numbers that take three values each, drawn independently."""
    x, p = np.array([-1.0, 0.5, 4.0]), np.array([0.5, 0.2, 0.3])
    mu = p @ x
    for n in (2, 3):
        outcomes = []
        for which in itertools.product(range(3), repeat=n):
            numbers = x[list(which)]
            seen = {("X", i + 1): number for i, number in enumerate(numbers)}
            averages = {("V", i + 1): numbers[: i + 1].mean() for i in range(n)}
            outcomes.append((p[list(which)].prod(), {**seen, **averages}))
        scope = Numbers({}, {}, (), 0.9, trajectories=outcomes)
        yield scope, [{"n": n, "mu": mu, "sigma": np.sqrt(p @ (x - mu) ** 2)}]


def first_visits():
    """Episodes up to the first visit of state 3, which comes at step 1, 2 or 3, or not at all."""
    draw = rng(5)
    after = {0: (1, 2, 3), 1: (2, 3, 4), 2: (3, 4, 4), 3: (0, 2, 4)}
    outcomes = {
        (s, a): [*zip(draw.dirichlet(np.ones(3)), after[s], draw.normal(size=3))] for s in after for a in (0, 1)
    }
    mdp = FiniteMDP.from_outcomes(outcomes, start=[0.5, 0.3, 0.2, 0, 0])
    pi = np.vstack([draw.dirichlet(np.ones(2), size=4), [0.5, 0.5]])
    found = []

    def go_on(p, seen, s, t):
        if s == 3:
            found.append((p, {**seen, "tau": t, ("tau", 0): t}))
        elif not mdp.terminal[s]:
            for a, k in np.ndindex(2, 3):
                more = {("A", t): a, ("R", t + 1): mdp.reward[s, a, k], ("S", t + 1): int(mdp.next_state[s, a, k])}
                go_on(p * pi[s, a] * mdp.prob[s, a, k], {**seen, **more}, more["S", t + 1], t + 1)

    for s in range(3):
        go_on(mdp.start[s], {("S", 0): s}, s, 0)
    visited = sum(p for p, _ in found)
    found = [(p / visited, {**seen, "policy": "pi"}) for p, seen in found]
    v = solve_policy(mdp, pi, 0.7)
    scope = Process(mdp, 0.7, {"pi": pi}, {("v", "pi"): v, ("q", "pi"): q_from_v(mdp, v, 0.7)}, trajectories=found)
    scope.sets["t"] = (1, 2, 3)
    yield scope, [{"s": 3}]


# ---------------------------------------------------------------------- chapter 2


def optimal(mdp, gamma):
    """v_*, q_* and a greedy policy."""
    v = value_iteration(mdp, gamma, tol=1e-13).V
    pi = greedy(q_from_v(mdp, v, gamma))
    v = solve_policy(mdp, pi, gamma)
    return v, q_from_v(mdp, v, gamma), pi


def solved(mdp, gamma, arrays=(), greek=None, **policies):
    """A process with v and q of each policy, the best ones, and more arrays."""
    v, q, best = optimal(mdp, gamma)
    found = {("v", "*"): v, ("q", "*"): q}
    policies = {name.replace("_new", "'"): pi for name, pi in policies.items()} | {r"pi_*": best}
    for name, pi in policies.items():
        v_pi = solve_policy(mdp, pi, gamma)
        found |= {("v", name): v_pi, ("q", name): q_from_v(mdp, v_pi, gamma)}
    return Process(mdp, gamma, policies, found | dict(arrays), greek)


def random_policy(seed):
    return rng(seed + 10).dirichlet(np.ones(2), size=3)


STATES, FREE = times(s=range(3), t=(0,)), times(s=range(3), a=(0, 1), t=(0,))
STEPS = times(k=(2, 3), n=(2,), t=(0,), infinity=(90,))
LATER = times(k=(2, 3), m=(4, 26))  # 0.4^26 is nothing


def values(free=FREE):
    for seed, gamma in enumerate(GAMMAS):
        yield solved(random_mdp(seed), gamma, pi=random_policy(seed)), [{"s'": (x["s"] + 1) % 3, **x} for x in free]


def guesses(free=STEPS):
    """v, w and x at random, then where bounds are attained: a constant above and below v_*, and a constant."""
    for seed, gamma in enumerate(GAMMAS):
        mdp, draw = random_mdp(seed), rng(seed + 20)
        best = optimal(mdp, gamma)[0]
        for v, w, x in (
            [*draw.normal(size=(2, 3)), np.array([4.0, -2.0, 0.01])],
            (best + 1.5, best - 0.5, np.full(3, -2.0)),
        ):
            arrays = {("v", ""): v, ("w", ""): w, ("x", ""): x}
            arrays |= {("q", "v"): q_from_v(mdp, v, gamma), ("q", "w"): q_from_v(mdp, w, gamma)}
            yield solved(mdp, gamma, arrays, pi=random_policy(seed)), free


def two_functions():
    for f, g in (
        (rng(1).normal(size=3), rng(2).normal(size=3)),
        (np.array([1.0, 3.0, 2.0]), np.array([0.5, 2.5, 1.5])),
    ):
        yield Scope({"a": range(3)}, {("f", "", 1): f, ("g", "", 1): g}), times(a=range(3))


def ordered():
    """v <= w in every state; then v = w."""
    for seed, gamma in enumerate(GAMMAS):
        v, more = rng(seed).normal(size=(2, 3))
        for w in (v + np.abs(more), v):
            yield solved(random_mdp(seed), gamma, {("v", ""): v, ("w", ""): w}), FREE


def policies_and_best():
    """A policy at random, then the best one."""
    for seed, gamma in enumerate(GAMMAS):
        mdp = random_mdp(seed)
        for pi in (random_policy(seed), optimal(mdp, gamma)[2]):
            yield solved(mdp, gamma, pi=pi), times(n=(2, 3))


def greedy_on_estimates():
    """pi greedy on a V so wrong that pi is best nowhere; then the example in which the loss is as large as can be."""
    for gamma, seed, error in zip(GAMMAS, (0, 1), ([-9.0, 3.0, 9.0], [-9.0, 9.0, 0.0])):
        mdp = random_mdp(seed, more=50.0)
        V = optimal(mdp, gamma)[0] + error
        yield solved(mdp, gamma, {("V", ""): V}, {r"\varepsilon": 9.0}, pi=greedy(q_from_v(mdp, V, gamma))), [{}]
        after, pays, stay = (
            np.array([[1, 0], [1, 1]]),
            np.array([[0, -3 * gamma], [0, 0]]),
            np.array([[0.0, 1], [0, 1]]),
        )
        of_all = np.ones((2, 2), bool), np.zeros(2, bool), [1.0, 0.0]
        mdp = FiniteMDP(after[..., None], np.ones((2, 2, 1)), 50 + pays[..., None], *of_all)
        V = optimal(mdp, gamma)[0] + [1.5, -1.5]
        yield solved(mdp, gamma, {("V", ""): V}, {r"\varepsilon": 1.5}, pi=stay), [{}]


# ---------------------------------------------------------------------- chapter 3


def improved(free, soft=0.0):
    """pi and pi', greedy for it but not best; then pi optimal, so that nothing improves. soft: the epsilon of both."""
    for seed, gamma in zip(UNFINISHED, GAMMAS):
        mdp = random_mdp(seed, more=-9.0)
        policies = [random_policy(seed), optimal(mdp, gamma)[2]]
        if soft:
            policies = [soft / 2 + (1 - soft) * policies[0], best_soft(mdp, gamma, soft)]
        for pi in policies:
            better = soft / 2 + (1 - soft) * greedy(q_from_v(mdp, solve_policy(mdp, pi, gamma), gamma))
            yield solved(mdp, gamma, (), {r"\varepsilon": soft}, pi=pi, pi_new=better), free


UNFINISHED = (12, 46)  # seeds with which one round of improvement does not reach the best


def unrolled():
    for i, (scope, found) in enumerate(improved(times(s=(0, 2), t=(0,), n=(2,)))):
        yield scope, found + times(s=(1,), t=(0,), n=(3,)) * (not i)


def best_soft(mdp, gamma, soft):
    pi = np.full((3, 2), 0.5)
    for _ in range(20):
        pi = soft / 2 + (1 - soft) * greedy(q_from_v(mdp, solve_policy(mdp, pi, gamma), gamma))
    return pi


def sweeps():
    """V_0 ... V_3 of value iteration, k = 2; from a start at random, then from a constant above v_*."""
    for seed, gamma in enumerate(GAMMAS):
        mdp = random_mdp(seed)
        for V in (9 * rng(seed).normal(size=3), optimal(mdp, gamma)[0] + 2.0):
            found = [V]
            for _ in range(3):
                found.append(optimality_backup(mdp, found[-1], gamma))
            arrays = {("V", name): x for name, x in zip(("0", "k-1", "k", "k+1"), found)}
            yield solved(mdp, gamma, arrays), [{"k": 2}]


def newton():
    """v_k at random, pi' greedy for it, v_{k+1} the values of pi'; h does not change what is greedy."""
    for seed, gamma in enumerate(GAMMAS):
        mdp = random_mdp(seed)
        v, h = rng(seed).normal(size=3), 1e-3 * rng(seed + 1).normal(size=3)
        better = greedy(q_from_v(mdp, v, gamma))
        arrays = {("v", "k"): v, ("v", "k+1"): solve_policy(mdp, better, gamma), ("h", ""): h}
        yield solved(mdp, gamma, arrays, pi=random_policy(seed), pi_new=better), [{}]


def wrong_models():
    """Two processes, one the model of the other; then one in which the bound is attained."""
    for seed, gamma in enumerate(GAMMAS):
        pi = random_policy(seed)
        yield modelled(random_mdp(seed, more=seed), random_mdp(seed + 5), pi, gamma)
        # The state keeps its sign in the model and may lose it in the world. Another action would be far better.
        after, ones = np.array([[[0, 1]] * 2, [[1, 0]] * 2]), np.ones((2, 2), bool)
        true, model = (
            FiniteMDP(after, np.full((2, 2, 2), [1 - leak, leak]), reward, ones, np.zeros(2, bool), [1.0, 0.0])
            for leak, pays in ((0.1, 1.0), (0.0, 1.2))
            for reward in [np.array([[[pays], [99.0]], [[-pays], [99.0]]]) * np.ones(2)]
        )
        yield modelled(true, model, np.array([[1.0, 0], [1, 0]]), gamma)


def modelled(mdp, model, pi, gamma):
    true, other = (solved(x, gamma, pi=pi).tables for x in (mdp, model))
    arrays = {("bar" + letter, "pi"): other[letter, "pi", 0] for letter in "vrP"}
    errors = {
        r"\varepsilon_r": np.abs(true["r", "pi", 0] - other["r", "pi", 0]).max(),
        r"\varepsilon_p": np.abs(true["P", "pi", 0] - other["P", "pi", 0]).sum(axis=1).max(),
    }
    return solved(mdp, gamma, arrays, errors, pi=pi), [{}]


def ending():
    """gamma = 1, a chance to end at every step; pi at random, or the best one; pi' greedy for it; x: ones at last."""
    for seed in (0, 1):
        draw = rng(seed)
        outcomes = {
            (s, a): [*zip(draw.dirichlet(np.ones(4)), range(4), draw.normal(size=4))] for s in range(3) for a in (0, 1)
        }
        mdp = FiniteMDP.from_outcomes(outcomes, start=0)
        for pi in (np.vstack([random_policy(seed), [0.5, 0.5]]), optimal(mdp, 1.0)[2]):
            better = greedy(q_from_v(mdp, solve_policy(mdp, pi, 1.0), 1.0))
            for x in (draw.normal(size=4), np.ones(4)):
                scope = solved(mdp, 1.0, {("x", ""): x * [1, 1, 1, 0]}, pi=pi, pi_new=better)
                for name in ("pi", "pi'", "pi_*"):
                    P = scope.tables["P", name, 0]
                    P[3] = P[:, 3] = 0.0
                scope.tables["ones", "", 0] = np.array([1.0, 1, 1, 0])
                scope.greek[r"\rho"] = np.linalg.matrix_power(scope.tables["P", "pi", 0], 2).sum(axis=1).max()
                yield scope, times(j=(1, 2), n=(2,), infinity=(200,))


# ---------------------------------------------------------------------- chapter 4


def running_means(alpha=None):
    """X_1 ... X_5 and their means; with alpha, what a constant step size makes of them and of V_0."""
    for seed in (0, 1):
        X, V = rng(seed).normal(size=6), [0.7]
        for n in range(1, 6):
            V.append(V[-1] + (alpha or 1 / n) * (X[n] - V[-1]))
        tables = {("X", "indexed", 1): X, ("V", "indexed", 1): np.array(V)}
        yield Scope({}, tables, greek={r"\alpha": alpha}), times(n=(2, 3, 5))


def estimates(free=STATES, epsilon=0.2):
    """V, Q and U at random; then U below Q by a constant. pi: epsilon-greedy for Q."""
    for seed, gamma in enumerate(GAMMAS):
        V, (Q, U) = rng(seed).normal(size=3), rng(seed).normal(size=(2, 3, 2))
        pi = epsilon / 2 + (1 - epsilon) * greedy(Q)
        for table in (U, Q - 1.5):
            arrays = {("V", ""): V, ("Q", ""): Q, ("U", ""): table}
            yield solved(random_mdp(seed), gamma, arrays, {r"\varepsilon": epsilon}, pi=pi), free


PAIRS = times(s=range(3), a=(0, 1), t=(0,), m=(2,))


def record():
    """An episode of 8 steps in three states, V at random, and the model that was counted."""
    for gamma in GAMMAS:
        S, R, V = np.array([0, 1, 2, 0, 0, 2, 1, 1, 2]), rng(3).normal(size=8), rng(4).normal(size=3)
        N, P, r = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
        for s, s_next, reward in zip(S, S[1:], R):
            N[s], P[s, s_next], r[s] = N[s] + 1, P[s, s_next] + 1, r[s] + reward
        P, r = P / N[:, None], r / N
        tables = {
            ("S", "", 1): S, ("V", "", 1): V, ("N", "", 1): N, ("barr", "", 1): r, ("barP", "", 2): P,
            ("barv", "", 1): np.linalg.solve(np.eye(3) - gamma * P, r),
            ("delta", "indexed", 1): R + gamma * V[S[1:]] - V[S[:-1]],
        }  # fmt: skip
        yield Scope({"s": range(3)}, tables, R, gamma), [{"s": s, "s'": s_next} for s, s_next in np.ndindex(3, 3)]


def ended():
    """An episode that ends after 6 steps in a state worth 0."""
    for gamma in GAMMAS:
        R, V = rng(6).normal(size=6), np.append(rng(7).normal(size=6), 0.0)
        G = np.append(discounted_returns(R, gamma), 0.0)
        tables = {
            ("S", "", 1): lambda t: int(t), ("V", "", 1): V, ("G", "", 1): G,
            ("delta", "indexed", 1): R + gamma * V[1:] - V[:-1],
        }  # fmt: skip
        yield Scope({}, tables, R, gamma), times(t=range(4))


SHRINKING = (0.5, 0.3, 0.2), (0.9, 0.1, 0.4)


def noisy_steps(*attained):
    """Every outcome of X_0, X_1, X_2, and V_1, V_2, V_3; at last step sizes with which a bound is attained."""
    x, p = np.array([-1.0, 4.0]), np.array([0.4, 0.6])
    mu = p @ x
    for alpha in (*SHRINKING, *attained):
        outcomes = []
        for which in itertools.product(range(2), repeat=3):
            V = [0.7]
            for a, k in zip(alpha, which):
                V.append(V[-1] + a * (x[k] - V[-1]))
            seen = {("X", t): x[k] for t, k in enumerate(which)} | {("V", t): v for t, v in enumerate(V)}
            outcomes.append((p[list(which)].prod(), seen))
        scope = Numbers({}, {("alpha", "indexed", 1): np.array(alpha)}, (), 0.9, trajectories=outcomes)
        known = {"n": 3, "m": 1, "mu": mu, "sigma": np.sqrt(p @ (x - mu) ** 2), ("V", 0): 0.7}
        yield scope, [{"t": t, **known} for t in (1, 2)]


def one_outcome():
    for scope, found in noisy_steps():
        for _, seen in scope.trajectories[1:5:3]:
            yield scope, [{**names, **seen} for names in found]


def constant_noise():
    alpha, sigma = 0.3, 1.7
    yield Scope({}, {}, greek={r"\alpha": alpha}), [{"sigma": sigma, "x": alpha * sigma**2 / (2 - alpha)}]


# ---------------------------------------------------------------------- which is which

REGISTRY = {
    "dv-return-recursion": Derivation(1, returns),
    "dv-constant-finite": Derivation(1, constant_rewards),
    "dv-constant-forever": Derivation(1, lambda: constant_rewards(300)),
    "dv-markov": Derivation(1, histories),
    "dv-not-markov": Derivation(1, rolling_ball),
    "dv-average-unbiased": Derivation(1, independent_numbers),
    "dv-average-variance": Derivation(1, independent_numbers),
    "dv-first-visit": Derivation(1, first_visits),
    "dv-v-from-q": Derivation(2, lambda: values(STATES)),
    "dv-bellman-v": Derivation(2, lambda: values(STATES)),
    "dv-bellman-q": Derivation(2, values),
    "dv-bellman-matrix": Derivation(2, lambda: values(STATES)),
    "dv-average-norm": Derivation(2, lambda: guesses(STATES)),
    "dv-inverse-exists": Derivation(2, guesses),
    "dv-series": Derivation(2, guesses),
    "dv-contraction-policy": Derivation(2, guesses),
    "dv-two-maxima": Derivation(2, two_functions),
    "dv-contraction-best": Derivation(2, lambda: guesses(FREE)),
    "dv-banach-steps": Derivation(2, guesses),
    "dv-banach-distance": Derivation(2, lambda: guesses(LATER)),
    "dv-banach-unique": Derivation(2, guesses),
    "dv-banach-rate": Derivation(2, guesses),
    "dv-optimality-equation": Derivation(2, values),
    "dv-monotone": Derivation(2, ordered),
    "dv-no-policy-better": Derivation(2, policies_and_best),
    "dv-greedy-optimal": Derivation(2, values),
    "dv-greedy-loss": Derivation(2, greedy_on_estimates),
    "dv-improvement": Derivation(3, unrolled),
    "dv-improvement-greedy": Derivation(3, lambda: improved(STATES)),
    "dv-improvement-soft": Derivation(3, lambda: improved(times(s=range(3), m=(2,)), soft=0.3)),
    "dv-iteration-stops": Derivation(3, lambda: improved([{}])),
    "dv-value-iteration-rate": Derivation(3, sweeps),
    "dv-stopping": Derivation(3, sweeps),
    "dv-newton-slope": Derivation(3, newton),
    "dv-newton": Derivation(3, newton),
    "dv-model-errors": Derivation(3, wrong_models),
    "dv-simulation": Derivation(3, wrong_models),
    "dv-proper": Derivation(3, ending),
    "dv-undiscounted-greedy": Derivation(3, ending),
    "dv-undiscounted-others": Derivation(3, ending),
    "dv-undiscounted-improves": Derivation(3, ending),
    "dv-incremental-mean": Derivation(4, running_means),
    "dv-constant-alpha": Derivation(4, lambda: running_means(0.3)),
    "dv-td-mean": Derivation(4, estimates),
    "dv-mc-error": Derivation(4, ended),
    "dv-noise-recursion": Derivation(4, one_outcome),
    "dv-noise-bias": Derivation(4, lambda: noisy_steps((0.0, 0.0, 0.0))),
    "dv-noise-variance": Derivation(4, noisy_steps),
    "dv-noise-unrolled": Derivation(4, lambda: noisy_steps((0.5, 0.3, 0.0), (0.9, 0.0, 0.4))),
    "dv-noise-constant": Derivation(4, constant_noise),
    "dv-batch-td": Derivation(4, record),
    "dv-batch-rest": Derivation(4, record),
    "dv-q-learning-mean": Derivation(4, lambda: estimates(PAIRS)),
    "dv-q-contraction": Derivation(4, lambda: estimates(PAIRS)),
    "dv-sarsa-mean": Derivation(4, lambda: estimates(PAIRS)),
    "dv-sarsa-limit": Derivation(4, lambda: estimates([{"s'": x["a"], **x} for x in PAIRS])),
}


ALIKE = "all have the same distribution, and different ones are independent"
STILL = "the same at every step"
MARKOV = "Markov: the state S_{t+1} makes it needless"
FIXED = "a fixed point of the backup"
ORDER = "the order holds between all of these, and for the best policy all are equal"
HARMLESS = {  # {id: {what the changed line holds: why it is no error}}
    "dv-constant-forever": {"= r + \\gamma\\, G_t && \\text{rec": STILL, "G_{t+1}": STILL},
    "dv-not-markov": {"x_t + u_t && \\text{no": STILL, "u_{t+1}": STILL},
    "dv-average-unbiased": {"E[V_1]": ALIKE, "E[X_1]": ALIKE},
    "dv-average-variance": {
        "E[(X_i)(X_j - \\mu)]": "mu times E[X_j - mu] is 0",
        "E[(X_i - \\mu)(X_j)]": "mu times E[X_i - mu] is 0",
        "E[(X_1 - \\mu)(X_j": ALIKE,
        "(X_1 - \\mu)]": ALIKE,
        "(X_1 - \\mu)^2": ALIKE,
        "(X_i + \\mu)(X_j - \\mu)": "E[X_j - mu] = 0, and E[(X + mu)(X - mu)] is the variance",
        "(X_i - \\mu)(X_j + \\mu)": "E[X_i - mu] = 0, and E[(X + mu)(X - mu)] is the variance",
    },
    "dv-v-from-q": {
        "E_\\pi[G_t \\mid S_t = s] && \\text{total": "what does not depend on a, times chances that add to 1"
    },
    "dv-bellman-v": {"S_t = 0, A_t = a, \\\\": MARKOV, "S_t = s, A_t = 0, \\\\": MARKOV, "S_t = s, \\\\": MARKOV},
    "dv-series": {
        "P_\\pi^{n+1}\\, x": "every power averages",
        "P_\\pi^{n-1}\\, x": "every power averages",
        "\\gamma^n x ": "no average is larger",
    },
    "dv-two-maxima": {"\\max_{a'} g(a) +": "g(a) itself, before it is replaced by the largest"},
    "dv-banach-rate": {"T_*^{k+1} v_*": FIXED},
    "dv-no-policy-better": {
        "T_*^{n+1} v_\\pi": ORDER,
        "T_* v_\\pi && \\text{keeps": ORDER,
        "T_*^n v_*": ORDER,
        "T_\\pi v_\\pi && \\text{mean": ORDER,
        "v_\\pi &= v_\\pi": FIXED,
        "\\le v_\\pi && \\text{mean": ORDER,
    },
    "dv-greedy-optimal": {"&= v_* && \\text{greedy}": FIXED},
    "dv-iteration-stops": {"T_{\\pi'} v_\\pi && \\text{keeps": ORDER, "v_\\pi &= v_\\pi": FIXED},
    "dv-value-iteration-rate": {"T_* V_{k-1} - v_*": FIXED},
    "dv-undiscounted-others": {
        "v_* &\\ge v_*": "true of anything",
        "v_\\pi &\\ge v_\\pi": "true of anything",
    },
    "dv-undiscounted-improves": {"T_{\\pi} v_\\pi && \\text{greedy}": ORDER},
    "dv-inverse-exists": {"\\, \\lVert x \\rVert_\\infty && \\text{triangle}": "the next line"},
    "dv-noise-bias": {"e^{- \\alpha_t}": "true, but less than what is known: one step instead of all"},
    "dv-noise-variance": {"(X_t - \\mu)] \\\\": "the mixed term is 0"},
    "dv-greedy-loss": {
        "(T_* v_* - T_\\pi V)": "greedy: T_pi V = T_* V",
        "&= v_* - T_\\pi v_\\pi": FIXED,
        "&= T_* v_* - v_\\pi": FIXED,
        "&= (v_* - T_* V)": FIXED,
        "(T_\\pi V - v_\\pi)": FIXED,
    },
}

BREAKS = {}  # those of every chapter are enough
