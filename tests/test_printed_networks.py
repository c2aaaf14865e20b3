"""The equations of chapter 6 as they stand on the page, evaluated on a random network and compared with rlcore.

Slopes are read as slopes: the partial derivatives on the page are central differences of the cost.
"""

import re
from functools import cache

import numpy as np
import pytest
from latex import NOTICED, Scope, broken, code, gradient, inline, printed, sides

from rlcore.neurons import neuron, one_hot, quadratic_cost, relu, sigmoid, step_position
from rlcore.nn import MLP, backprop, sgd, step_bump_network
from rlcore.optimizers import SGD

PAGE = "06_neural_networks"
SIZES, L, EPSILON = [3, 4, 5, 2], 3, 0.7
INLINE = {  # key: (anchor, how it begins, how it ends)
    "eq-u-bump": ("eq-u-bump", "w_1 = ", "= h"),
    "alg-backprop z": ("alg-backprop", "z^l"),
    "alg-backprop a": ("alg-backprop", "a^l"),
    "alg-backprop output error": ("alg-backprop", r"\delta^L"),
    "alg-backprop error": ("alg-backprop", r"\delta^l"),
    "alg-backprop weights": ("alg-backprop", r"\partial J / \partial w"),
    "alg-backprop biases": ("alg-backprop", r"\partial J / \partial b"),
}
NEURON = ["eq-nn-20", "eq-nn-21", "eq-nn-22", "eq-nn-23"]
LAYERS = {  # the values that rlcore has for the two sides
    **dict.fromkeys(("eq-nn-30", "eq-nn-31", "alg-backprop a"), "a"),
    **dict.fromkeys(("eq-u-z", "alg-backprop z"), "z"),
    **dict.fromkeys(("eq-nn-34", "eq-nn-35", "alg-backprop output error", "alg-backprop error"), "delta"),
    **dict.fromkeys(("eq-nn-37", "alg-backprop weights"), "d_weights"),
    "alg-backprop biases": "d_biases", "eq-nn-29": "a", "eq-nn-32": "delta", "eq-nn-33": "delta", "eq-nn-36": "delta",
}  # fmt: skip
COMPONENTS = {"eq-nn-29", "eq-nn-32", "eq-nn-33", "eq-nn-36", "eq-nn-37", "alg-backprop weights", "alg-backprop biases"}
AT = {
    **dict.fromkeys(("eq-nn-33", "eq-nn-34", "alg-backprop output error"), [L]),
    **dict.fromkeys(("eq-nn-35", "alg-backprop error"), range(1, L)),
}
LEFT = {"eq-nn-26": r"\nabla C", "eq-nn-27": "w_k'", "eq-nn-28": "b_l'", "om-sgd": r"\theta"}  # compared as text
ONE = ["eq-u-sigmoid", "eq-u-relu", "eq-u-target-function", "eq-nn-24", "eq-nn-25", "eq-u-digit-target", "eq-u-bump"]
TESTED = [*NEURON, *LAYERS, *LEFT, *ONE, "om-uat-statement", "eq-u-layer-matrix", "eq-u-digit-output"]


def rng(seed=0):
    return np.random.default_rng(seed)


# ---------------------------------------------------------------------- a network, and what rlcore says


@cache
def network():
    """A network with weights and biases, three samples x, y; a cost of the first with its slopes by differences."""
    draw = rng(3)
    net = MLP(SIZES, hidden="sigmoid", output="sigmoid", dtype=np.float64, init="unit", rng=draw)
    net.theta[:] = draw.normal(size=net.theta.size)
    x, y = draw.normal(size=(3, SIZES[0])), draw.random((3, SIZES[-1]))
    gradient_of_first = backprop(net, x[0], y[0])[1]
    known = {("a", l): a for l, a in enumerate(net.activations)}
    for l, (z, delta) in enumerate(zip(net.zs, net.deltas), 1):
        known["z", l], known["delta", l] = z, delta
        known["w", l], known["b", l] = net.weights[l - 1], net.biases[l - 1]
    twin = net.copy()
    twin.theta[:] = gradient_of_first
    for l in range(1, L + 1):
        known["d_weights", l], known["d_biases", l] = twin.weights[l - 1], twin.biases[l - 1]
    return net, x, y, known


@cache
def slopes():
    """dJ/dw, dJ/db, dJ/dz and dJ/da of every layer, for the first sample."""
    net, x, y, known = network()
    added = {(letter, l): np.zeros(n) for letter in "za" for l, n in enumerate(SIZES)}

    def J():
        a = x[0]
        for l in range(1, L + 1):
            a = sigmoid(net.weights[l - 1] @ a + net.biases[l - 1] + added["z", l]) + added["a", l]
        return quadratic_cost(a, y[0])

    arrays = {(letter, l): known[letter, l] for letter in "wb" for l in range(1, L + 1)}
    return {key: gradient(J, array) for key, array in {**arrays, **added}.items() if key[1] > 0}


def layer_scope(l):
    known, slope = network()[3], slopes()
    tables = {("sigma", "", 1): sigmoid, ("sigma'", "", 1): lambda z: (sigmoid(z + 1e-6) - sigmoid(z - 1e-6)) / 2e-6}
    tables["nabla_a", "J", 0] = slope["a", L]
    for letter in ("a", "z", "delta", "w", "b"):
        n = 3 if letter == "w" else 2
        tables[letter, "indexed", 1] = lambda l, x=letter: known[x, l]
        tables[letter, "indexed", n] = lambda l, *i, x=letter: known[x, l][tuple(int(k) for k in i)]
        tables[letter, "dJ", n] = lambda l, *i, x=letter: slope[x, l][tuple(int(k) for k in i)]
    return Scope({"k": range(SIZES[l - 1])}, tables)


def cost_scope():
    """The cost of three samples, weights w_1 ... w_K and biases b_1 ... b_M counted through; and its gradient."""
    net, x, y, _ = network()
    outputs, d_cost = net.forward(x), net.copy()
    d_cost.theta[:] = gradient(lambda: quadratic_cost(net.forward(x), y), net.theta)
    tables = {
        ("y", "", 1): y, ("a", "", 1): outputs, ("C", "", 2): lambda w, b: quadratic_cost(outputs, y),
        ("w", "indexed", 1): lambda k: flat(net.weights)[int(k) - 1],
        ("b", "indexed", 1): lambda k: flat(net.biases)[int(k) - 1],
        ("w", "dC", 1): lambda k: flat(d_cost.weights)[int(k) - 1],
        ("b", "dC", 1): lambda k: flat(d_cost.biases)[int(k) - 1],
        ("C", "indexed", 1): lambda i: quadratic_cost(net.forward(x[i]), y[i]), ("theta", "", 0): net.theta,
    }  # fmt: skip
    sizes = {"n": 3, "K": flat(net.weights).size, "M": flat(net.biases).size, "w": 0, "b": 0}
    return Scope({"x": range(3), "B": range(3)}, tables, greek={r"\epsilon": EPSILON}), sizes


def flat(arrays):
    return np.concatenate([a.ravel() for a in arrays])


def cases(name):
    """(scope, names, what rlcore computes) for every layer, neuron, parameter or input that the equation speaks of."""
    net, x, y, known = network()
    if name in NEURON:
        w, values, b = rng(1).normal(size=(2, 7)), None, 0.4
        w, values = w if name != "eq-nn-20" else w[:, :2]
        plain, bias = name in ("eq-nn-20", "eq-nn-21"), b if name == "eq-nn-23" else 0.0
        want = neuron(w, values, bias, activation="linear" if plain else "sigmoid")
        tables = {(word, "", 0): np.array(want) for word in ("output", "activation")}
        tables |= {("w", "indexed", 1): lambda i: w[int(i) - 1], ("x", "indexed", 1): lambda i: values[int(i) - 1]}
        yield Scope({}, {**tables, ("sigma", "", 1): sigmoid}), {"n": 7, "b": b}, want
    elif name in LAYERS:
        for l in AT.get(name, range(1, L + 1)):
            value = known[LAYERS[name], l]
            for at in np.ndindex(value.shape) if name in COMPONENTS else [()]:
                yield layer_scope(l), {"l": l, "L": L, **dict(zip("jk", at))}, value[at]
    elif name in LEFT:
        scope, names = cost_scope()
        after = net.copy()
        if name == "om-sgd":
            sgd(after, x, y, optimizer=SGD(EPSILON), batch=None, epochs=1, rng=rng())
            yield scope, names, after.theta
            return
        after.theta[:] = backprop(net, x, y)[1]
        if name == "eq-nn-26":
            yield scope, names, flat([*after.weights, *after.biases])
            return
        step = after.theta.copy()
        after.theta[:] = net.theta
        SGD(EPSILON).update(after.theta, step)
        for k, want in enumerate(flat(after.weights if name == "eq-nn-27" else after.biases), 1):
            yield scope, {**names, "k": k, "l": k}, want
    elif name == "eq-nn-25":
        yield *cost_scope(), quadratic_cost(net.forward(x), y)
    elif name == "om-uat-statement":
        wide, points = MLP([2, 6, 1], hidden="sigmoid", dtype=np.float64, rng=rng()), list(rng(1).random((9, 2)))
        wide.biases[0][:] = rng(2).normal(size=6)
        want = max(abs(p.sum() - wide.forward(p)[0]) for p in points)
        tables = {("f", "", 1): np.sum, ("sigma", "", 1): sigmoid}
        for letter, array in (("v", wide.weights[1][0]), ("w", wide.weights[0]), ("b", wide.biases[0])):
            tables[letter, "indexed", 1] = lambda i, array=array: array[int(i) - 1]
        yield Scope({"x": points}, tables, greek={r"\varepsilon": want}), {"N": 6}, want  # the least bound
    elif name == "eq-u-layer-matrix":
        tables = {
            ("w", "indexed", 2): lambda j, k: net.weights[0][int(j) - 1, int(k) - 1], ("sigma", "", 1): sigmoid,
            ("x", "indexed", 1): lambda k: x[0][int(k) - 1],
            ("b", "indexed", 2): lambda l, j: net.biases[0][int(j) - 1],
            ("a", "indexed", 1): lambda l: known["a", 1], ("a", "indexed", 2): lambda l, j: known["a", 1][int(j) - 1],
        }  # fmt: skip
        yield Scope({}, tables), {"n": SIZES[0], "m": SIZES[1]}, known["a", 1]  # the inputs are layer 1 here
    elif name == "eq-nn-24":
        for w, b in rng(4).normal(size=(3, 2)):
            yield Scope({}, {}), {"w": w, "b": b, "s": step_position(w, b)}, step_position(w, b)
    elif name == "eq-u-bump":
        weights = step_bump_network(lambda x: x, 1, heights=[1.7]).weights[1][0]
        yield Scope({}, {("w", "indexed", 1): lambda i: weights[int(i) - 1]}), {"h": 1.7}, 1.7
    elif name == "eq-u-digit-target":
        yield Scope({}, {("y", "", 1): lambda x: one_hot(3, 10)}), {"x": 0}, one_hot(3, 10)
    else:
        letter, f = {
            "eq-u-sigmoid": ("sigma", sigmoid), "eq-u-relu": ("g", relu),
            "eq-u-target-function": ("f", eval(code(PAGE, "f = "), {"np": np})),
        }[name]  # fmt: skip
        for z in (-2.0, -0.3, 0.4, 3.0):
            yield Scope({}, {(letter, "", 1): f}), {"x": z, "z": z}, f(z)


def check(name, latex):
    """AssertionError where a side of the equation is not what rlcore computes, SyntaxError where it cannot be read."""
    found = sides(latex)
    if name == "eq-u-digit-output":
        answer = np.squeeze(found[1](Scope({}, {}), {}))
        assert latex.startswith("a(x) =") and abs(quadratic_cost(answer, one_hot(3, 10)) - 0.7192) < 5e-5
        return
    assert len(found) > 1, f"{name}: no sign of equality"
    if name in LEFT:
        symbol = re.sub(r"\s", "", re.split(r"=|\\leftarrow", latex)[0])
        assert symbol == LEFT[name].replace(" ", ""), f"{name} is about {symbol}, not {LEFT[name]}"
    for scope, names, want in cases(name):
        for side in found[name in LEFT :]:
            got = np.squeeze(side(scope, names))
            assert got.shape == np.shape(want), f"{name}: shape {got.shape}, not {np.shape(want)}"
            np.testing.assert_allclose(got, want, rtol=1e-6, atol=1e-8, err_msg=f"{name}: {latex}")


# ---------------------------------------------------------------------- the page


@cache
def on_page(name):
    return (inline(PAGE, *INLINE[name]) if name in INLINE else printed(PAGE)[name]).strip()


@pytest.mark.parametrize("name", TESTED)
def test_equation_on_the_page_is_what_rlcore_computes(name):
    check(name, on_page(name))


# ---------------------------------------------------------------------- the tester itself

BREAKS = {
    "plus": (r"(?<![{lL]) *\+ *(?!1)", " - "),
    "minus": (r"(?<![{l]) *-(?![1x]) *", " + "),
    "sign of x": (r"\{-x\}", "{x}"),
    "bias": (r"\+ b(_j)?(\^l)?", ""),
    "layer": (r"\{l-1\}", "l"),
    "next layer": (r"\{l\+1\}", "l"),
    "transposed": (r"_\{jk\}", "_{kj}"),
    "no transposition": (r"(?<=\)|i)\^T(?=.*(odot|x))", ""),
    "neuron": (r"(?<=[za])_j", "_k"),
    "other neuron": (r"a_k", "a_j"),
    "product": (r"\\odot", ""),
    "slope": (r"\\sigma'", r"\\sigma"),
    "sigma": (r"\\sigma(?=\(|\\Big| \\left)", ""),
    "derivative": (r"\\nabla_a J", "a^L"),
    "half": (r"2n", "n"),
    "square": (r"\^2(?= | *$)(?! =)", ""),
    "desired": (r"y\(x\) - ", ""),
    "rate": (r"\\epsilon", ""),
    "size of the batch": (r"\{\|B\|\}", "{2}"),
    "gradient of the cost": (r"\\partial C\}\{\\partial [wb]_[kl]\}", r"\\partial C}{\\partial w_1}"),
    "vector": (r"\\partial [wb]_1\}", r"\\partial b_2}"),
    "third": (r"w_3", "w_2"),
    "corner": (r"w_\{1n\}", "w_{n1}"),
    "wrong digit": (r"0, 1, 0", "1, 0, 0"),
    "answer": (r"0\.15", "0.16"),
    "pair": (r"-w_2", "w_2"),
    "negative": (r"\\frac\{-b\}", r"\\frac{b}"),
    "inverted": (r"\\frac\{-b\}\{w\}", r"\\frac{-w}{b}"),
    "one": (r"\{1 \+", "{2 +"),
    "maximum": (r"\{0, z", "{1, z"),
    "cosine": (r"\\cos\^2", r"\\cos"),
    "one term less": (r"i=1\}", "i=2}"),
    "second": (r"w_2 x_2", "w_2 x_1"),
    "left": (r"^(a|z|\\delta)(?=_j\^l|\^l|\^L)", "b"),
    "target": (r"^([wb])_\w'", r"\1_1'"),
    "weight": (r"a_k\^\{l-1\} ", ""),
    "wrong slope": (r"\\partial [zb]_j\^l", r"\\partial a_j^l"),
}


BROKEN = broken({name: on_page(name) for name in TESTED}, BREAKS)


@pytest.mark.parametrize("name, latex", [pytest.param(n, x, id=f"{n}-{kind}-{i}") for n, kind, i, x in BROKEN])
def test_an_error_on_the_page_is_noticed(name, latex):
    with pytest.raises(NOTICED):
        check(name, latex)


def test_every_equation_is_broken():
    assert {name for name, *_ in BROKEN} == {*TESTED}
