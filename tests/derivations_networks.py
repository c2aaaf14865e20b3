r"""The derivations of chapter 6: on which networks, costs and random numbers each is evaluated."""

import itertools

import numpy as np
from latex import Scope
from processes import Derivation, Numbers, rng, times

from rlcore.neurons import sigmoid
from rlcore.nn import step_bump_network
from rlcore.optimizers import SGD, Adam

H = 1e-30  # an imaginary step: slopes without cancellation


def sigma(z):
    return 1 / (1 + np.exp(-np.asarray(z)))  # of complex numbers, too


def slope_of_sigma(z):
    return sigma(np.asarray(z) + 1j * H).imag / H


# ---------------------------------------------------------------------- neurons and networks


def neurons():
    yield (
        Scope({}, {("sigma", "", 1): sigmoid, ("sigma'", "", 1): slope_of_sigma}),
        times(z=np.array([-1.3, 0.0, 0.4, 2.0])),
    )


class Net:
    """Layers of sigmoids, at last a softmax if wanted. run: all its numbers after small changes of some of them."""

    def __init__(self, w, b, x, y, softmax=False):
        self.w, self.b, self.x, self.y, self.softmax = w, b, np.asarray(x), np.asarray(y), softmax
        self.known = self.run()

    def run(self, changed=()):
        def add(letter, l, array):
            array = np.array(array, complex)
            for key, step in changed:
                if key[:2] == (letter, l):
                    array[key[2:]] += step
            found[letter, l] = array
            return array

        found = {("a", 0): np.array(self.x, complex)}
        for l, (w, b) in enumerate(zip(self.w, self.b), 1):
            z = add("z", l, add("w", l, w) @ found["a", l - 1] + add("b", l, b))
            last = self.softmax and l == len(self.w)
            add("a", l, np.exp(z) / np.exp(z).sum() if last else sigma(z))
        a = found["a", len(self.w)]
        found["J", 0] = -(self.y * np.log(a)).sum() if self.softmax else 0.5 * ((a - self.y) ** 2).sum()
        return found

    def slope(self, of, by):
        letter, l, *at = of
        return self.run([(by, 1j * H)])[letter, l][tuple(at)].imag / H

    def scope(self, sets):
        def at(letter):
            return lambda l, *i: self.known[letter, int(l)].real[tuple(int(k) - 1 for k in i)]

        def index(numbers):
            l, *i = (int(x) for x in numbers)
            return l, *(k - 1 for k in i)

        def slopes(of, by, counts):
            return lambda *i: self.slope((of, *index(i[:counts])), (by, *index(i[counts:])))

        tables = {("sigma", "", 1): sigma, ("sigma'", "", 1): slope_of_sigma, ("J", "", 0): self.known["J", 0].real}
        for letter, counts in (("a", 2), ("z", 2), ("b", 2), ("w", 3)):
            tables[letter, "indexed", 1] = tables[letter, "indexed", counts] = at(letter)
            tables[letter, "dJ", counts] = lambda *i, x=letter: self.slope(("J", 0), (x, *index(i)))
            for of in "az":
                tables["d" + of, "d" + letter, 2 + counts] = slopes(of, letter, 2)
        tables["delta", "indexed", 2] = tables["z", "dJ", 2]
        tables["delta", "indexed", 1] = lambda l: np.array(
            [self.slope(("J", 0), ("z", int(l), j)) for j in range(len(self.b[int(l) - 1]))]
        )
        tables["nabla_a", "J", 0] = lambda: np.array(
            [self.slope(("J", 0), ("a", len(self.w), j)) for j in range(len(self.b[-1]))]
        )
        tables["y", "indexed", 1] = lambda i: self.y[int(i) - 1]
        return Scope(sets, tables)


def net(softmax=False):
    draw, sizes = rng(3), (2, 3, 2, 3)
    w = [draw.normal(size=(m, n)) for n, m in itertools.pairwise(sizes)]
    b = [draw.normal(size=n) for n in sizes[1:]]
    return Net(w, b, draw.normal(size=2), [0.2, 0.5, 0.3], softmax)


def outputs(softmax=False):
    yield net(softmax).scope({"k": (1, 2, 3), "i": (1, 2, 3)}), times(j=(1, 3), L=(3,))


def hidden():
    for l, later in ((1, 2), (2, 3)):
        yield net().scope({"k": range(1, later + 1)}), [{"j": j, "l": l} for j in (1, 2)]


def parameters():
    yield net().scope({}), times(j=(1, 2), k=(1, 2), l=(1, 2, 3))


def by_hand():
    w, b = [np.array([[1.0, -1], [2, -1]]), np.array([[2.0, -1]])], [np.array([1.0, 1]), np.array([-0.5])]
    yield Net(w, b, [1, 2], [1]).scope({}), [{}]


def chains():
    """One neuron a layer; then with biases that put every neuron where it is steepest."""
    for steep in (False, True):
        w, b, a = (1.7, -0.8, 2.1, 0.6), [], 0.9
        for l, weight in enumerate(w):
            b.append(-weight * a if steep else 0.3 * l)
            a = sigma(weight * a + b[-1])
        yield (
            Chain(Net([np.array([[x]]) for x in w], [np.array([x]) for x in b], [0.9], [0.1])),
            [{"l": l, "L": 4} for l in (1, 2)],
        )


class Chain(Scope):
    """A network in which every layer is a number."""

    def __init__(self, of):
        tables = of.scope({}).tables
        one = {
            (x, "indexed", 1): lambda l, x=x: np.squeeze(tables[x, "indexed", 1](l)) for x in ("a", "z", "w", "delta")
        }
        super().__init__({}, {("sigma'", "", 1): slope_of_sigma, **one})


# ---------------------------------------------------------------------- descent


def directions():
    """Directions of length 1; the last is against the gradient."""
    g = np.array([1.2, -0.7, 0.4])
    units = [*rng(1).normal(size=(2, 3)), -g]
    yield Scope({}, {}), [{"g": g, "u": u / np.linalg.norm(u)} for u in units]


def costs():
    """Curvatures from 0.5 to K; all K; and one that is nowhere a parabola."""
    K, theta = 2.0, np.array([0.8, -0.5])
    for C, slope in (
        (lambda x: 0.25 * x[0] ** 2 + x[1] ** 2, lambda x: x * [0.5, 2.0]),
        (lambda x: x @ x, lambda x: 2 * x),
        (lambda x: 2 * np.log(np.cosh(x)).sum(), lambda x: 2 * np.tanh(x)),
    ):
        scope = Smooth({}, {("C", "", 1): C, ("theta", "", 0): theta.copy()}, greek={r"\epsilon": 0.3})
        yield scope, times(kappa=(K,), t=(0.2,), g=(slope(theta),))


def differences(f, x, h=0.01):
    """The gradient of f() in every entry of x, by differences of the sixth order."""
    slope = None
    for i in np.ndindex(x.shape):
        old, total = x[i], 0.0
        for k, weight in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)):
            for sign in (1, -1):
                x[i] = old + sign * k * h
                total = total + sign * weight * f()
        x[i] = old
        slope = np.zeros(x.shape) if slope is None else slope
        slope[i] = total / h
    return slope


class Smooth(Scope):
    """Gradients to ten digits, where what is derived has no corners."""

    def gradient(self, f, x):
        return differences(f, x)

    def slope(self, f, i):
        """In the i-th entry of theta alone."""
        theta = self.tables["theta", "", 0]
        return differences(f, theta[i : i + 1])[0]


def parabola():
    K, epsilon, v = 2.0, 0.7, [1.3]
    for _ in range(4):
        v.append(v[-1] - epsilon * K * v[-1])
    yield Scope({}, {("v", "indexed", 1): np.array(v)}, greek={r"\epsilon": epsilon}), times(n=(2, 3, 4), kappa=(K,))


def optimisers(kind, same=False):
    """m_t and v_t by their recursions, theta_t by rlcore."""
    g, epsilon, beta, beta1, beta2 = rng(2).normal(size=6), 0.1, 0.8, 0.7, 0.9
    g[0] = 0.0  # there is no g_0
    g[1:] = -1.7 if same else g[1:]
    m, v, theta = [0.0], [0.0], [np.array([0.4])]
    made = SGD(epsilon, momentum=beta) if kind == "momentum" else Adam(epsilon, beta1, beta2, eps=1e-3)
    for x in g[1:]:
        m.append(beta1 * m[-1] + (1 - beta1) * x)
        v.append(beta2 * v[-1] + (1 - beta2) * x**2 if kind == "adam" else beta * v[-1] + x)
        theta.append(theta[-1].copy())
        made.update(theta[-1], np.array([x]))
        if kind == "momentum":
            np.testing.assert_allclose(theta[-1], theta[-2] - epsilon * v[-1])
    t = np.arange(6)
    with np.errstate(invalid="ignore"):
        corrected = {"barm": m / (1 - beta1**t), "barv": v / (1 - beta2**t)}
    arrays = {"g": g, "m": np.array(m), "v": np.array(v), "theta": np.concatenate(theta), **corrected}
    tables = {(name, "indexed", 1): array for name, array in arrays.items()}
    greek = {r"\epsilon": epsilon, r"\beta": beta, r"\beta_1": beta1, r"\beta_2": beta2}
    yield Scope({}, tables, greek=greek), [{"t": t, "eta": 1e-3, **({"g": -1.7} if same else {})} for t in (2, 3, 5)]


# ---------------------------------------------------------------------- sizes, bumps


def sums():
    """Every outcome of three weights of mean 0 and of inputs that hang together; z is what a neuron adds up."""
    w, p = np.array([-2.0, 0.5, 1.0]), np.array([0.2, 0.4, 0.4])
    w -= p @ w
    inputs = [(0.25, (1.0, 0.3, 1.0)), (0.35, (0.3, 1.0, 1.0)), (0.4, (1.0, 1.0, 0.3))]
    same = sum(q * np.array(a) for q, a in inputs)
    inputs = [(q / 3, np.roll(a, k)) for q, a in inputs for k in range(3)]
    assert same.shape == (3,)
    outcomes = []
    for which in itertools.product(range(3), repeat=3):
        for q, a in inputs:
            weights = w[list(which)]
            seen = {("w", i + 1): x for i, x in enumerate(weights)} | {("a", i + 1): x for i, x in enumerate(a)}
            outcomes.append((q * p[list(which)].prod(), {**seen, "z": weights @ a}))
    yield Numbers({}, {}, (), 0.9, trajectories=outcomes), [{"n": 3}]


def symmetric():
    found = [(0.1, -3.0), (0.4, -1.0), (0.4, 1.0), (0.1, 3.0)]
    yield Numbers({}, {}, (), 0.9, trajectories=[(p, {"z": z}) for p, z in found]), [{}]


def bumps():
    """Two steps around x."""
    for w, d in ((5.0, 0.3), (20.0, 0.1)):
        names = {"w": w, "d": d, "h": 1.7, "x": 0.5, "z": 0.8}
        tables = {("sigma", "", 1): sigmoid, ("s", "indexed", 1): lambda i, d=d: 0.5 + (d if i == 2 else -d)}
        yield Scope({}, tables), [names]


def cells():
    """f(x) = cos^2 x + x, as the chapter has it, and a straight line, for which every bound is attained."""
    N, K = 5, 1.0
    centres = (np.arange(N) + 0.5) / N
    for f in (lambda x: np.cos(x) ** 2 + x, lambda x: K * x):
        values = f(np.linspace(0, 1, 2001))

        def omega(d, y=values):
            n = int(round(float(d) * 2000))
            return max(np.abs(y[k:] - y[: y.size - k]).max() for k in range(n + 1))

        wide = step_bump_network(f, N, heights=f(centres), w=1e12)
        tables = {
            ("f", "", 1): f, ("omega", "", 1): omega, ("F", "", 1): lambda x, n=wide: n.forward(np.array([x]))[0],
            ("B", "timed", 2): lambda i, x: float((i - 1) / N <= x < i / N),
            ("c", "indexed", 1): lambda j: centres[int(j) - 1],
        }  # fmt: skip
        yield (
            Scope({}, tables, greek={r"\rho": K}),
            [{"N": N, "x": x, "j": int(x * N) + 1} for x in (0.05, 0.2 + 1e-10, 0.45, 0.55, 0.8 - 1e-10)],
        )


REGISTRY = {
    "dv-sigmoid-slope": Derivation(6, neurons),
    "dv-steepest": Derivation(6, directions),
    "dv-descent": Derivation(6, costs),
    "dv-step-limit": Derivation(6, parabola),
    "dv-bp1": Derivation(6, outputs),
    "dv-bp1-quadratic": Derivation(6, outputs),
    "dv-bp2": Derivation(6, hidden),
    "dv-bp3": Derivation(6, parameters),
    "dv-bp4": Derivation(6, parameters),
    "dv-by-hand-forward": Derivation(6, by_hand),
    "dv-by-hand-backward": Derivation(6, by_hand),
    "dv-softmax-cost": Derivation(6, lambda: outputs(softmax=True)),
    "dv-variance-forward": Derivation(6, sums),
    "dv-variance-relu": Derivation(6, symmetric),
    "dv-vanishing": Derivation(6, chains),
    "dv-momentum": Derivation(6, lambda: optimisers("momentum")),
    "dv-momentum-constant": Derivation(6, lambda: optimisers("momentum", same=True)),
    "dv-adam-bias": Derivation(6, lambda: optimisers("adam")),
    "dv-adam-step": Derivation(6, lambda: optimisers("adam")),
    "dv-adam-constant": Derivation(6, lambda: optimisers("adam", same=True)),
    "dv-bump": Derivation(6, bumps),
    "dv-bumps": Derivation(6, cells),
}

BREAKS = {
    "layer": (r"\^\{l[+-]1\}", "^l"),
    "weight's layer": (r"\^\{k\+1\}", "^k"),
    "transposed": (r"_\{(\w)(?!\1)(\w)\}", r"_{\2\1}"),
    "no transposition": (r"(?<=\))\^T", ""),
    "slope": (r"\\sigma'", r"\\sigma"),
    "no sigma": (r"\\sigma(?=\()", ""),
    "neuron": (r"(?<=[az])_k", "_j"),
    "other neuron": (r"(?<=\\partial [az])_j", "_k"),
    "entry": (r"(?<=[yza])_[ij](?!\w)", "_1"),
    "cost": (r"\\nabla_a J", "a^L"),
    "entrywise": (r"\\odot", ""),
    "label": (r" - y_\w", ""),
    "digit": (r"(?<=0\.\d)\d", lambda m: str((int(m[0]) + 5) % 10)),
    "first digit": (r"(?<=0\.)\d(?!\d)", lambda m: str((int(m[0]) + 5) % 10)),
    "whole": (r"(?<=\\cdot )(\d)(?!\.)", lambda m: str(int(m[1]) + 1)),
    "whole before": (r"(?<![\d.])(\d)(?= \\cdot)", lambda m: str(int(m[1]) + 1)),
    "result": (r"(?<== )(\d)(?= &&)", lambda m: str(int(m[1]) + 1)),
    "other step": (r"\\epsilon(?!\^)(\\,)? ?", ""),
    "curvature": (r"\\kappa(?= )", "1"),
    "beta": (r"\\beta(_\d)?(?!\^)(\\,)? ", ""),
    "other beta": (r"\\beta_1", r"\\beta_2"),
    "one beta for the other": (r"\\beta_2", r"\\beta_1"),
    "power of beta": (r"(\\beta(_\d)?)\^(\{[^}]*\}|\w)", r"\1"),
    "step before": (r"(?<=[vgmta])_\{[tn]-\d\}", "_t"),
    "gradient": (r"(?<=[} ,])g_[tk]\^?2?", ""),
    "small": (r" \+ \\eta", ""),
    "exponential": (r"e\^\{(-?)(\w+( d)?)\}", lambda m: "e^{" + ("" if m[1] else "-") + m[2] + "}"),
    "half": (r"\\frac12", r"\\frac13"),
    "quarter": (r"\\frac14", r"\\frac15"),
    "logarithm": (r"\\ln ", ""),
    "direction": (r"g\^T u", "u^T u"),
    "place": (r"(?<=s)_[12]", lambda m: {"_1": "_2", "_2": "_1"}[m[0]]),
    "height": (r"(?<=[={-] )h(\\,)? ", ""),
    "centre": (r"(?<=c)_[ij](?=\))", "_1"),
    "halved cell": (r"\{2N\}", "{N}"),
    "other half": (r"- t g", "+ t g"),
    "dimension": (r"(?<== )n ", ""),
    "which": (r"(?<=[wa])_i(?!\w)", "_1"),
    "size": (r"\\operatorname\{Var\}\(w_1\)(\\,)? ?", ""),
    "of the same": (r"(?<== )g", "2"),
}

HARMLESS = {
    "dv-bp1": {r"\sum_k \frac{\partial J}{\partial a_j^L}": "only k = j counts"},
    "dv-variance-forward": {r"E[a_1^2] && \text{mixed": "all alike", r"E[w_1^2]": "all alike"},
}
