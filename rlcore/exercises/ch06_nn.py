"""Exercises of chapter 6: neurons, layers, backpropagation and gradient descent."""

from functools import cache

import numpy as np

from rlcore.exercises.engine import Case, Exercise, Question, Wrong
from rlcore.neurons import bump, cross_entropy_gradient, one_hot, quadratic_cost, sigmoid, step_position
from rlcore.nn import MLP, backprop, sgd, step_bump_network
from rlcore.optimizers import SGD, gradient_descent

TITLE = "Exercises: neural networks"
NOTEBOOK = "06_neural_networks"
LABELS = {"build": "build a network"}
WITH_SIGMOID = "import numpy as np\nfrom rlcore.neurons import sigmoid"


def _net(sizes, *arrays, output="sigmoid"):
    """An MLP with sigmoid hidden neurons and the given weights and biases, w1, b1, w2, b2 ..."""
    net = MLP(sizes, hidden="sigmoid", output=output, init="zeros", dtype=np.float64, rng=None)
    net.theta[:] = np.concatenate([np.ravel(array) for array in arrays])
    return net


def _gradients(x, y, *arrays, output="sigmoid"):
    """backprop's gradient of the quadratic cost, in parts of the shapes of w1, b1, w2, b2."""
    net = _net([arrays[0].shape[1], *map(len, arrays[::2])], *arrays, output=output)
    parts = np.split(backprop(net, x, y)[1], np.cumsum([array.size for array in arrays])[:-1])
    return tuple(part.reshape(array.shape) for part, array in zip(parts, arrays, strict=True))


# ---------------------------------------------------------------------- neurons and layers


Exercise(
    id="ch06-count-parameters",
    kind="by hand",
    tier="core",
    section="A network to compute by hand",
    title="Thirteen thousand what?",
    statement=r"""
        The network for digits has 784 inputs, two hidden layers of 16 neurons and 10 output neurons; every neuron sees all of the layer
        before it and has a bias ({eq}`eq-nn-23`). Count, on paper, its weights, its biases, and all its parameters, the length of the gradient in
        {eq}`eq-nn-26`. Bind the tuple of the three numbers to `counts`.
    """,
    stub="counts = ...",
    cases=lambda rng: [Case({}, (784 * 16 + 16 * 16 + 16 * 10, 42, MLP([784, 16, 16, 10], rng=rng).n_parameters))],
    hints=(
        "Between two neighbouring layers there is one weight for each pair of neurons: $784 \\cdot 16$ between the first two.",
        "Inputs are numbers, not neurons: they have no bias.",
    ),
    solution="counts = (784 * 16 + 16 * 16 + 16 * 10, 16 + 16 + 10, 784 * 16 + 16 * 16 + 16 * 10 + 42)",
    wrong=(
        Wrong("counts = (12960, 826, 13786)", "the 784 inputs have no bias: they are what is given, not neurons"),
        Wrong(
            "counts = (12704, 26, 12730)", "there are two hidden layers: 16 times 16 weights and 16 biases are missing"
        ),
        Wrong("counts = (12960, 42, 12960)", "the total holds the weights only: add the biases"),
        Wrong(
            "counts = (12960, 12960, 25920)",
            "there is one bias for each neuron, not one for each weight, though the printed gradient pairs them",
        ),
        Wrong("counts = (12960, 3, 12963)", "each neuron has a bias of its own, not each layer"),
    ),
    minutes=3,
    covers=("eq-nn-26", "cl-095", "ex-digits", "fig-30"),
)


A_PRINTED = "a = np.array([0.20, 0.10, 0.55, 0.15, 0.28, 0.30, 0.25, 0.10, 0.21, 0.28])"


def _printed_costs():
    a = np.array([0.20, 0.10, 0.55, 0.15, 0.28, 0.30, 0.25, 0.10, 0.21, 0.28])
    return tuple(quadratic_cost(a, one_hot(k, 10)) for k in (2, 3))


Exercise(
    id="ch06-printed-cost",
    kind="by hand",
    tier="more",
    section="How wrong is it? The cost",
    title="A three that is labelled two",
    statement=r"""
        The document shows a 3 to a network and writes down its ten outputs, for the digits 0 to 9:
        0.20, 0.10, 0.55, 0.15, 0.28, 0.30, 0.25, 0.10, 0.21, 0.28. As desired output it prints (0, 0, 1, 0, 0, 0, 0, 0, 0, 0). Compute the cost
        ({eq}`eq-nn-25`) of this one example first with the label as printed, then with the label that a 3 should have. Bind the two numbers to the
        tuple `costs`.
    """,
    stub="costs = ...",
    cases=lambda rng: [Case({}, _printed_costs())],
    hints=(
        "Square the ten differences and add them up; with one example, $n = 1$, half of the sum is the cost.",
        "Only two of the ten squares change with the label. The digits start at 0: the 1 of a 3 stands in the fourth place.",
    ),
    solution=f"""
        {A_PRINTED}
        y = np.eye(10)
        costs = tuple(float(((y[k] - a) ** 2).sum() / 2) for k in (2, 3))
    """,
    wrong=(
        Wrong("costs = (0.6384, 1.4384)", "these are the squared distances: the cost is half of them"),
        Wrong(
            "costs = (0.03192, 0.07192)",
            "n counts the examples, and there is one; the ten outputs are added, not averaged",
        ),
        Wrong("costs = (0.7192, 0.3192)", "the two labels are swapped: the printed one has its 1 in the third place"),
        Wrong("costs = (0.3192, 0.3192)", "the printed label is that of a 2: the digits start at 0"),
        Wrong(
            "costs = (0.3192, 0.5892)",
            "the second cost is that of a 4: for a 3 the output 0.15 is compared with 1",
        ),
    ),
    minutes=6,
    digits=4,
    covers=("eq-nn-25", "ex-digit-cost", "eq-u-digit-target", "eq-u-digit-output"),
)


Exercise(
    id="ch06-step-position",
    kind="by hand",
    tier="core",
    section="Steps",
    title="Where the step is",
    statement=r"""
        A sigmoid neuron with one input has weight $w$ and bias $b$. Where does its output cross one half ({eq}`eq-nn-24`)? Do it for
        $(w, b) = (30, -5)$, $(30, -20)$, $(110, -20)$ and $(-50, 20)$, and bind the array of the four positions to `positions`.
    """,
    stub="positions = ...",
    cases=lambda rng: [
        Case({}, np.array([step_position(w, b) for w, b in ((30, -5), (30, -20), (110, -20), (-50, 20))]))
    ],
    hints=(r"The sigmoid is one half where its argument is 0.", "Solve $w x + b = 0$ for $x$."),
    solution="positions = -np.array([-5, -20, -20, 20]) / np.array([30, 30, 110, -50])",
    wrong=(
        Wrong({"-np": "np"}, "the sign is wrong: w x + b = 0 gives x = -b / w"),
        Wrong(
            "positions = -np.array([30, 30, 110, -50]) / np.array([-5, -20, -20, 20])",
            "the fraction is upside down: a larger weight brings the step nearer to 0",
        ),
        Wrong(
            "positions = -np.array([-5, -20, -20, 20.0])",
            "the weight is missing: the weighted input, not the input, has to reach -b",
        ),
        Wrong(
            "positions = np.array([1 / 6, 2 / 3, 2 / 11, -0.4])",
            "the last weight is negative, too: -20 / -50 is 0.4; this neuron steps down there",
        ),
    ),
    minutes=2,
    digits=4,
    covers=("eq-nn-24", "cl-089", "fig-41"),
)


def _layer(w, b, x):
    return sigmoid(x @ w.T + b)


Exercise(
    id="ch06-layer",
    kind="fill in",
    tier="core",
    section="A network to compute by hand",
    title="A layer, for a whole batch",
    statement=r"""
        The activations of a layer are those of {eq}`eq-nn-30` for one sample. Write them for a batch with a sample a row: `w` is `(m, n)`, `b` is `(m,)`, `x` is
        `(B, n)`, and the result `(B, m)`. The neurons are sigmoid neurons; `sigmoid` is imported.
    """,
    setup=WITH_SIGMOID,
    stub="""
        def layer(w, b, x):
            ...
    """,
    cases=lambda rng: [
        Case(dict(w=w, b=b, x=x), _layer(w, b, x))
        for B, n, m in ((4, 3, 2), (1, 2, 5), (3, 3, 3))
        for w, b, x in [
            (rng.normal(size=(m, n)).round(1), rng.normal(size=m).round(1), rng.normal(size=(B, n)).round(1))
        ]
    ],
    hints=(
        "Row `i` of the result is `sigmoid(w @ x[i] + b)`.",
        "All rows at once: `x @ w.T` has the shape `(B, m)`, and `b` is added to each of its rows.",
    ),
    solution="""
        def layer(w, b, x):
            return sigmoid(x @ w.T + b)
    """,
    wrong=(
        Wrong({"sigmoid(x @ w.T + b)": "x @ w.T + b"}, "these are the weighted inputs z: the sigmoid is missing"),
        Wrong({" + b": ""}, "the bias is missing"),
        Wrong(
            {"sigmoid(x @ w.T + b)": "sigmoid(x @ w.T) + b"},
            "the bias is added after the sigmoid: it belongs to the weighted input",
        ),
        Wrong({"+ b": "- b"}, "the bias is added, not subtracted: it is minus the threshold"),
        Wrong(
            {"x @ w.T + b": "w @ x.T + b[:, None]"},
            "the result lies on its side: a sample a row, so its shape is (B, m)",
        ),
        Wrong(
            {"sigmoid(x @ w.T + b)": "sigmoid(x[:, None] * w).sum(axis=2) + b"},
            "the sigmoid is taken of each product: first add up, then take the sigmoid once",
        ),
    ),
    minutes=5,
    covers=("eq-nn-29", "eq-nn-30", "eq-nn-31", "eq-u-z", "eq-u-layer-matrix", "alg-mlp-forward"),
)


# ---------------------------------------------------------------------- backpropagation


def _output_error(z, y):
    a = sigmoid(z)
    return (a - y) * a * (1 - a)


Exercise(
    id="ch06-output-error",
    kind="fill in",
    tier="core",
    section="In numbers",
    title="BP1: the error of the outputs",
    statement=r"""
        One sample, sigmoid outputs, quadratic cost. `z` holds the weighted inputs of the output layer, `y` the desired outputs. Return
        $\delta^L$ of {eq}`eq-nn-34`.
    """,
    setup=WITH_SIGMOID,
    stub="""
        def output_error(z, y):
            ...
    """,
    cases=lambda rng: [
        Case(dict(z=z, y=y), _output_error(z, y))
        for n in (3, 1, 5)
        for z, y in [(rng.normal(size=n).round(1) * 2, rng.integers(2, size=n).astype(float))]
    ],
    hints=(
        r"With $J = \frac{1}{2} |y - a|^2$ the derivative with respect to $a$ is $a - y$.",
        r"The slope of the sigmoid at $z$ is $a (1 - a)$ with $a = \sigma(z)$.",
    ),
    solution="""
        def output_error(z, y):
            a = sigmoid(z)
            return (a - y) * a * (1 - a)
    """,
    wrong=(
        Wrong({"a - y": "y - a"}, "the sign is turned round: the derivative of the cost with respect to a is a - y"),
        Wrong(
            """
            def output_error(z, y):
                return sigmoid(z) - y
            """,
            "the slope of the sigmoid is missing: this is the derivative with respect to a, not to z",
        ),
        Wrong(
            {"return (a - y) * a * (1 - a)": "s = sigmoid(a)\n    return (a - y) * s * (1 - s)"},
            "the slope is taken at a: the sigmoid is applied twice",
        ),
        Wrong({"a * (1 - a)": "z * (1 - z)"}, "z (1 - z) is not the slope: it is a (1 - a) with a = sigmoid(z)"),
        Wrong(
            {"(a - y)": "2 * (a - y)"},
            "twice too large: the cost has a factor 1/2, which takes away the 2 of the square",
        ),
    ),
    minutes=5,
    covers=("eq-nn-32", "eq-nn-33", "eq-nn-34"),
)


def _hidden_error(w, delta, z):
    a = sigmoid(z)
    return w.T @ delta * a * (1 - a)


Exercise(
    id="ch06-hidden-error",
    kind="fill in",
    tier="core",
    section="In numbers",
    title="BP2: passing the error back",
    statement=r"""
        `delta` is the error of a layer, `w` its weights, and `z` holds the weighted inputs of the layer before, of sigmoid neurons. Return the error of the
        layer before ({eq}`eq-nn-35`, whose left side is the whole vector $\delta^l$). Both layers have the same number of neurons here, so that
        NumPy does not complain about a product that is the wrong way round.
    """,
    setup=WITH_SIGMOID,
    stub="""
        def hidden_error(w, delta, z):
            ...
    """,
    cases=lambda rng: [
        Case(g, _hidden_error(**g))
        for n in (3, 2, 4)
        for g in [
            dict(w=rng.normal(size=(n, n)).round(1), delta=rng.normal(size=n).round(1), z=rng.normal(size=n).round(1))
        ]
    ],
    hints=(
        "Forward, `w[j, k]` carries the activation of neuron `k` to neuron `j`. Backward it carries the error of `j` to `k`.",
        "Multiply by `w.T`, then entry by entry by the slope at `z`.",
    ),
    solution="""
        def hidden_error(w, delta, z):
            a = sigmoid(z)
            return w.T @ delta * a * (1 - a)
    """,
    wrong=(
        Wrong({"w.T": "w"}, "the transpose is missing: this sends the errors forward through the weights"),
        Wrong(
            {"    a = sigmoid(z)\n": "", " * a * (1 - a)": ""},
            "the slope of the hidden neurons is missing: this is the derivative with respect to their activations",
        ),
        Wrong(
            {"a = sigmoid(z)": "s = sigmoid(sigmoid(z))", "a * (1 - a)": "s * (1 - s)"},
            "the slope is taken at a, not at z: the sigmoid is applied twice",
        ),
        Wrong(
            {"delta * a * (1 - a)": "(delta * a * (1 - a))"},
            "the slope is applied before the weights: it belongs to the layer that receives the error",
        ),
        Wrong({" * (1 - a)": ""}, "the slope of the sigmoid is a (1 - a): the second factor is missing"),
    ),
    minutes=6,
    covers=("eq-nn-35", "alg-backprop"),
)


Exercise(
    id="ch06-bias-gradient",
    kind="fill in",
    tier="core",
    section="In numbers",
    title="BP3: the gradient of the biases",
    statement=r"""
        `delta` `(B, m)` holds the errors of a layer, a sample a row, each row that of the sample's own cost. The cost of the batch is the mean of these
        costs. Return its gradient with respect to the biases of the layer ({eq}`eq-nn-36`), an array `(m,)`.
    """,
    stub="""
        def bias_gradient(delta):
            ...
    """,
    cases=lambda rng: [
        Case(dict(delta=delta), delta.mean(axis=0))
        for B, m in ((4, 3), (1, 2), (3, 3), (2, 5))
        for delta in [rng.normal(size=(B, m)).round(1)]
    ],
    hints=(
        "For one sample the gradient of the biases is the error itself.",
        "The gradient of a mean is the mean of the gradients: over the samples, not over the neurons.",
    ),
    solution="""
        def bias_gradient(delta):
            return delta.mean(axis=0)
    """,
    wrong=(
        Wrong(
            {"mean": "sum"},
            "this is the sum over the samples: with twice as many samples the step would be twice as large; take the mean",
        ),
        Wrong({"axis=0": "axis=1"}, "this averages over the neurons: each neuron has a bias of its own"),
        Wrong({"delta.mean(axis=0)": "delta[0]"}, "only the first sample counts here: all of them have a say"),
        Wrong(
            {"delta.mean": "-delta.mean"},
            "this points downhill: the gradient itself is asked for, the minus comes with the step",
        ),
    ),
    minutes=3,
    covers=("eq-nn-36", "alg-backprop"),
)


Exercise(
    id="ch06-weight-gradient",
    kind="fill in",
    tier="core",
    section="In numbers",
    title="BP4: the outer product, the right way round",
    statement=r"""
        `delta` `(m,)` is the error of a layer, `a` `(n,)` holds the activations of the layer before. Return the gradient with respect to the weights
        ({eq}`eq-nn-37`), with the shape `(m, n)` of the weights themselves: row `j`, column `k` belongs to the weight from neuron `k` to neuron `j`.
    """,
    stub="""
        def weight_gradient(delta, a):
            ...
    """,
    cases=lambda rng: [
        Case(dict(delta=delta, a=a), np.outer(delta, a))
        for m, n in ((2, 3), (3, 3), (4, 1))
        for delta, a in [(rng.normal(size=m).round(1), rng.random(size=n).round(2) + 0.1)]
    ],
    hints=(
        "Entry `[j, k]` is `delta[j] * a[k]`.",
        "`np.outer` makes a table of all products; its first argument numbers the rows.",
    ),
    solution="""
        def weight_gradient(delta, a):
            return np.outer(delta, a)
    """,
    wrong=(
        Wrong(
            {"np.outer(delta, a)": "np.outer(a, delta)"},
            "the table lies on its side: the error numbers the rows, as the neurons of this layer do in w",
        ),
        Wrong(
            {"np.outer(delta, a)": "np.outer(delta, np.ones_like(a))"},
            "this is the gradient of the bias, repeated: the activation that enters the weight is missing",
        ),
        Wrong(
            {"np.outer(delta, a)": "np.outer(delta, a * (1 - a))"},
            "the slope of the layer before does not belong here: its activation itself enters the weight",
        ),
        Wrong(
            {"np.outer(delta, a)": "float(delta.sum() * a.sum())"},
            "this adds all the products up: each weight has a derivative of its own",
        ),
    ),
    minutes=4,
    covers=("eq-nn-37", "alg-backprop"),
)


def _two_layers(rng, n0, n1, n2):
    shapes = dict(w1=(n1, n0), b1=n1, w2=(n2, n1), b2=n2, x=n0)
    given = {name: rng.normal(size=shape).round(1) for name, shape in shapes.items()}
    return {**given, "y": rng.integers(2, size=n2).astype(float)}


BACKPROP = """
            def gradients(w1, b1, w2, b2, x, y):
                slope = lambda z: sigmoid(z) * (1 - sigmoid(z))
                z1 = w1 @ x + b1
                a1 = sigmoid(z1)
                z2 = w2 @ a1 + b2
                a2 = sigmoid(z2)
                delta2 = (a2 - y) * slope(z2)
                delta1 = w2.T @ delta2 * slope(z1)
                return np.outer(delta1, x), delta1, np.outer(delta2, a1), delta2
"""

Exercise(
    id="ch06-bug-slope",
    kind="find the bug",
    tier="more",
    section="In numbers",
    title="It learns, but not by the gradient",
    statement=r"""
        Backpropagation of one sample through a network with one hidden layer, sigmoid neurons and the quadratic cost; the four gradients come in the order
        `w1`, `b1`, `w2`, `b2`. Shapes fit and the cost usually falls during training, yet a comparison with finite differences says that
        every gradient is wrong. Compare the lines with {eq}`eq-nn-34` and {eq}`eq-nn-35`, and mend it.
    """,
    setup=WITH_SIGMOID,
    stub=BACKPROP.replace("slope(z1)", "slope(a1)").replace("slope(z2)", "slope(a2)"),
    cases=lambda rng: [
        Case(g, _gradients(g["x"], g["y"], g["w1"], g["b1"], g["w2"], g["b2"]))
        for sizes in ((2, 3, 1), (3, 3, 3), (4, 2, 3))
        for g in [_two_layers(rng, *sizes)]
    ],
    hints=(
        "`slope` expects the weighted input of a neuron. What is it given?",
        "The slope of a sigmoid can be had from the activation, too, but then it is `a * (1 - a)`, without another sigmoid.",
    ),
    solution=BACKPROP,
    wrong=(
        Wrong(
            {"slope(z1)": "slope(a1)"},
            "the output layer is right now; the hidden layer still takes its slope at the activation",
        ),
        Wrong(
            {"slope(z2)": "slope(a2)"},
            "the hidden layer takes its slope at the right place now, the output layer still does not, and its error is passed back",
        ),
        Wrong(
            {" * slope(z1)": "", " * slope(z2)": ""},
            "without the slopes these are no errors: each neuron's error is the derivative with respect to z",
        ),
        Wrong(
            {"(a2 - y) * slope(z2)": "a2 - y"}, "the output layer has lost its slope: with the quadratic cost it stays"
        ),
        Wrong(
            {"(a2 - y)": "(y - a2)"},
            "the slopes are right, but every gradient points downhill: the derivative of the cost is a - y",
        ),
    ),
    minutes=8,
    covers=("alg-backprop", "eq-nn-34", "eq-nn-35", "cl-098"),
)


STEP = """
            def step(w1, b1, w2, b2, x, y, lr):
                a1 = sigmoid(w1 @ x + b1)
                delta2 = w2 @ a1 + b2 - y
                delta1 = w2.T @ delta2 * a1 * (1 - a1)
                w2 = w2 - lr * np.outer(delta2, a1)
                b2 = b2 - lr * delta2
                w1 = w1 - lr * np.outer(delta1, x)
                b1 = b1 - lr * delta1
                return w1, b1, w2, b2
"""
EARLY = STEP.replace("                delta1 = w2.T @ delta2 * a1 * (1 - a1)\n", "").replace(
    "                w1 = w1 -", "                delta1 = w2.T @ delta2 * a1 * (1 - a1)\n                w1 = w1 -"
)


def _step(w1, b1, w2, b2, x, y, lr):
    d = _gradients(x, y, w1, b1, w2, b2, output="linear")
    return tuple(p - lr * g for p, g in zip((w1, b1, w2, b2), d, strict=True))


Exercise(
    id="ch06-bug-order",
    kind="find the bug",
    tier="more",
    section="In numbers",
    title="Too soon",
    statement=r"""
        One step of gradient descent ({eq}`eq-nn-27`, {eq}`eq-nn-28`) on one sample: hidden sigmoid neurons, linear outputs, quadratic cost. With a small
        learning rate it is almost right, and the larger the rate, the less it is the step that it should be. Every formula in it is one of the chapter.
        Mend it.
    """,
    setup=WITH_SIGMOID,
    stub=EARLY,
    cases=lambda rng: [
        Case(g, _step(**g))
        for sizes, lr in (((2, 3, 1), 0.5), ((3, 2, 2), 0.1), ((3, 3, 3), 1.0))
        for g in [dict(**_two_layers(rng, *sizes), lr=lr)]
    ],
    hints=(
        "The gradient is that of one point. Are all its parts computed at the same parameters?",
        "Which weights does the error pass through on its way back, the old or the new ones?",
    ),
    solution=STEP,
    wrong=(
        Wrong(
            {"w2.T @ delta2": "(w2 - lr * np.outer(delta2, a1)).T @ delta2"},
            "the error still passes back through the new weights: compute every gradient before any parameter changes",
        ),
        Wrong({"* a1 * (1 - a1)": ""}, "the order is right, but the hidden error has lost the slope of its neurons"),
        Wrong(
            {"w1 = w1 -": "w1 = w1 +", "b1 = b1 -": "b1 = b1 +"},
            "the first layer climbs: every parameter moves against its gradient",
        ),
        Wrong(
            {"b2 = b2 - lr * delta2": "b2 = b2 * 1.0"}, "the biases of the outputs stay as they are: they learn, too"
        ),
    ),
    minutes=6,
    covers=("eq-nn-27", "eq-nn-28", "alg-backprop"),
)


def _sum_of_cubes(theta):
    return float((theta**3).sum() - 2 * theta[0])


def _wave(theta):
    return float(np.sin(theta[0]) * np.exp(0.5 * theta[-1]))


def _central(f, theta, h):
    return np.array([(f(theta + h * e) - f(theta - h * e)) / (2 * h) for e in np.eye(theta.size)])


Exercise(
    id="ch06-gradient-check",
    kind="fill in",
    tier="more",
    section="In numbers",
    title="A gradient from two looks",
    statement=r"""
        To test a backpropagation, compute the gradient in another way: entry $k$ of {eq}`eq-nn-26` is about
        $\big(C(\theta + h e_k) - C(\theta - h e_k)\big) / 2h$, where $e_k$ changes parameter $k$ alone. `C` is a function of an array `theta` and returns a number. Return
        the array of these central differences, and leave `theta` as it was. (With 13,002 parameters this needs 26,004 evaluations; backpropagation needs
        two passes.)
    """,
    stub="""
        def numeric_gradient(C, theta, h):
            ...
    """,
    cases=lambda rng: [
        Case(dict(C=C, theta=theta, h=h), _central(C, theta, h))
        for C, n, h in ((_sum_of_cubes, 3, 0.01), (_wave, 2, 0.1), (_sum_of_cubes, 5, 0.1))
        for theta in [rng.normal(size=n).round(1) + 0.3]
    ],
    hints=(
        "Loop over the parameters; in each turn make two copies of `theta` and change one entry of each.",
        "`theta + h * np.eye(theta.size)[k]` is a new array that differs from `theta` in entry `k`.",
    ),
    solution="""
        def numeric_gradient(C, theta, h):
            rows = h * np.eye(theta.size)
            return np.array([(C(theta + row) - C(theta - row)) / (2 * h) for row in rows])
    """,
    wrong=(
        Wrong(
            {" - row": "", "2 * h": "h"},
            "this is a forward difference, whose error shrinks with h only, not with its square: look to both sides",
        ),
        Wrong({"2 * h": "h"}, "twice too large: the two points are 2h apart"),
        Wrong(
            """
            def numeric_gradient(C, theta, h):
                return np.full(theta.size, (C(theta + h) - C(theta - h)) / (2 * h))
            """,
            "all parameters are changed at once: a partial derivative changes one and keeps the others",
        ),
        Wrong(
            {"C(theta + row) - C(theta - row)": "C(theta - row) - C(theta + row)"},
            "the sign is turned round: the value above minus the value below",
        ),
    ),
    minutes=8,
    covers=("eq-nn-26", "alg-backprop", "cl-097"),
)


# ---------------------------------------------------------------------- gradient descent


Exercise(
    id="ch06-minibatch",
    kind="fill in",
    tier="core",
    section="Momentum and Adam",
    title="The gradient of a minibatch",
    statement=r"""
        A linear neuron answers $a = w \cdot x + b$. `x` is `(B, n)`, `y` is `(B,)`, and the cost is {eq}`eq-nn-25` over the `B` samples. Return the
        gradient as an array of `n + 1` numbers, first those of the weights, then that of the bias. When it is right, the mean of
        the gradients of equally large minibatches is the gradient of all samples together: that is why small ones will do.
    """,
    stub="""
        def minibatch_gradient(w, b, x, y):
            ...
    """,
    cases=lambda rng: [
        Case(g, np.append((g["x"] @ g["w"] + g["b"] - g["y"]) @ g["x"], (g["x"] @ g["w"] + g["b"] - g["y"]).sum()) / B)
        for B, n in ((4, 2), (1, 3), (3, 3), (8, 1))
        for g in [
            dict(
                w=rng.normal(size=n).round(1), b=0.7, x=rng.normal(size=(B, n)).round(1), y=rng.normal(size=B).round(1)
            )
        ]
    ],
    hints=(
        "The error of each sample is `delta = x @ w + b - y`, an array `(B,)`.",
        "Each sample's gradient is `delta[i] * x[i]` for the weights and `delta[i]` for the bias; average over the samples.",
    ),
    solution="""
        def minibatch_gradient(w, b, x, y):
            delta = x @ w + b - y
            return np.append(delta @ x, delta.sum()) / len(x)
    """,
    wrong=(
        Wrong(
            {" / len(x)": ""},
            "this is the sum over the samples: a larger batch would take larger steps; divide by their number",
        ),
        Wrong({"/ len(x)": "* 2 / len(x)"}, "twice too large: the 1/2 of the cost takes away the 2 of the square"),
        Wrong(
            {"(delta @ x, delta.sum()) / len(x)": "(delta @ x / len(x), delta.sum())"},
            "the weights get the mean, the bias still gets the sum",
        ),
        Wrong(
            {"x @ w + b - y": "y - x @ w - b"},
            "this points downhill: the derivative of the cost with respect to the output is a - y",
        ),
        Wrong(
            """
            def minibatch_gradient(w, b, x, y):
                delta = (x @ w + b - y).mean()
                return np.append(delta * x.mean(axis=0), delta)
            """,
            "the mean of products is not the product of the means: multiply each sample's error by its own input first",
        ),
    ),
    minutes=8,
    covers=("eq-nn-25", "om-sgd", "alg-sgd", "cl-096"),
)


def _momentum(theta, v, gradient, lr, momentum):
    v = momentum * v + gradient
    return theta - lr * v, v


Exercise(
    id="ch06-momentum",
    kind="fill in",
    tier="more",
    section="Momentum and Adam",
    title="A heavy ball",
    statement=r"""
        Gradient descent with momentum remembers its direction: $v \leftarrow \mu v + \nabla C$, then $\theta \leftarrow \theta - \epsilon v$. With
        $\mu = 0$ it is {eq}`eq-nn-27`. Return the new pair `(theta, v)`; leave the arguments as they are.
    """,
    stub="""
        def momentum_step(theta, v, gradient, lr, momentum):
            ...
            return theta, v
    """,
    cases=lambda rng: [
        Case(g, _momentum(**g))
        for n, lr, mu in ((3, 0.1, 0.9), (2, 0.5, 0.0), (4, 0.2, 0.5))
        for g in [
            dict(
                theta=rng.normal(size=n).round(1),
                v=rng.normal(size=n).round(1),
                gradient=rng.normal(size=n).round(1),
                lr=lr,
                momentum=mu,
            )
        ]
    ],
    hints=(
        "Two lines: first the new `v`, then the new `theta` from the new `v`.",
        "Write `v = momentum * v + gradient`, not `v *= momentum`, which would change the argument.",
    ),
    solution="""
        def momentum_step(theta, v, gradient, lr, momentum):
            v = momentum * v + gradient
            theta = theta - lr * v
            return theta, v
    """,
    wrong=(
        Wrong(
            """
            def momentum_step(theta, v, gradient, lr, momentum):
                return theta - lr * v, momentum * v + gradient
            """,
            "theta moves with the old v: first bring v up to date",
        ),
        Wrong(
            """
            def momentum_step(theta, v, gradient, lr, momentum):
                v = momentum * v + (1 - momentum) * gradient
                return theta - lr * v, v
            """,
            "this v is a running mean, as Adam has it: here the gradient enters with weight 1",
        ),
        Wrong(
            """
            def momentum_step(theta, v, gradient, lr, momentum):
                v = momentum * v + lr * gradient
                return theta - lr * v, v
            """,
            "the learning rate enters twice: it multiplies v in the step only",
        ),
        Wrong(
            {"theta = theta - lr * v\n    return theta, v": "return theta + lr * v, v"},
            "this climbs: theta moves against v",
        ),
        Wrong(
            """
            def momentum_step(theta, v, gradient, lr, momentum):
                return theta - lr * gradient, momentum * v + gradient
            """,
            "v is remembered but never used: this step is plain gradient descent",
        ),
    ),
    minutes=4,
    covers=("eq-nn-27", "om-sgd", "cl-098"),
)


Exercise(
    id="ch06-softmax-gradient",
    kind="fill in",
    tier="deep",
    section="Digits",
    title="The simplest gradient of all",
    statement=r"""
        A classifier turns its linear outputs, the logits $z$, into probabilities $p_k = e^{z_k} / \sum_j e^{z_j}$, and the cost of a sample
        is $-\log p_c$ with $c$ its `label`. Work out the derivative with respect to the logits, the error $\delta^L$ of {eq}`eq-nn-32`, and return
        it. Logits of 1000 must do no harm.
    """,
    stub="""
        def logit_gradient(logits, label):
            ...
    """,
    cases=lambda rng: [
        Case(dict(logits=logits, label=label), cross_entropy_gradient(logits, label))
        for logits, label in (
            (rng.normal(size=4).round(1), 2),
            (rng.normal(size=2).round(1), 0),
            (np.array([1000.0, 998.0, -1000.0]), 1),
            (np.array([0.0, 0.0, 0.0, 1000.0, 0.0]), 4),
        )
    ],
    hints=(
        "Write the cost as $\\log \\sum_j e^{z_j} - z_c$ and take its derivative with respect to each $z_k$.",
        "The probabilities do not change when the largest logit is subtracted from all logits first.",
    ),
    solution="""
        def logit_gradient(logits, label):
            p = np.exp(logits - logits.max())
            p = p / p.sum()
            p[label] -= 1
            return p
    """,
    wrong=(
        Wrong(
            {"p = p / p.sum()\n    p[label] -= 1\n    return p": "return p / p.sum()"},
            "these are the probabilities: subtract 1 from that of the label",
        ),
        Wrong(
            {"p = p / p.sum()\n    p[label] -= 1\n    return p": "return np.eye(len(p))[label] - p / p.sum()"},
            "the sign is turned round: the cost falls where the logit of the label grows",
        ),
        Wrong(
            """
            def logit_gradient(logits, label):
                with np.errstate(all="ignore"):
                    p = np.exp(logits)
                    p = p / p.sum()
                p[label] -= 1
                return p
            """,
            "right for small logits, but the exponential of 1000 overflows: subtract the largest logit first",
        ),
        Wrong(
            {"p[label] -= 1\n    return p": "return (p - np.eye(len(p))[label]) * p * (1 - p)"},
            "there is no further slope: softmax and logarithm together leave p minus the desired output",
        ),
        Wrong(
            {"p[label] -= 1\n    return p": "return -np.eye(len(p))[label] / p[label]"},
            "this is the derivative with respect to the probabilities: every logit changes all of them",
        ),
    ),
    minutes=10,
    covers=("eq-nn-32", "alg-backprop"),
)


Exercise(
    id="ch06-predict-learning-rate",
    kind="predict",
    tier="core",
    section="Which way, and how far",
    title="Four learning rates",
    statement=r"""
        Gradient descent on $C(v) = v^2 / 2$ from $v = 2$, 20 steps of {eq}`eq-nn-27`. Predict first, for $\epsilon = 0.1$, $0.5$, $2$ and $2.1$, whether $v$ creeps, hurries,
        swings or runs away. Then bind the array of the four last values of $v$ to `arrivals`, and see whether you were right.
    """,
    stub="arrivals = ...",
    cases=lambda rng: [
        Case({}, np.array([gradient_descent(lambda v: v, 2.0, lr, 20)[-1] for lr in (0.1, 0.5, 2.0, 2.1)]))
    ],
    hints=(
        r"The derivative of $v^2 / 2$ is $v$. By which factor does a step multiply $v$?",
        r"After 20 steps $v$ is $2 (1 - \epsilon)^{20}$. What does an even power do with the sign?",
    ),
    solution="arrivals = 2 * (1 - np.array([0.1, 0.5, 2, 2.1])) ** 20",
    wrong=(
        Wrong({"1 - np.array": "1 - 2 * np.array"}, "the derivative is v, not 2 v: the 1/2 takes away the 2"),
        Wrong({"** 20": "** 19"}, "one step too few: after k steps the factor has the power k"),
        Wrong({"= 2": "= -2"}, "after an even number of steps v is on the side where it began"),
        Wrong(
            "arrivals = 2 * (1 - 20 * np.array([0.1, 0.5, 2, 2.1]))",
            "the gradient does not stay as it is: each step multiplies v by 1 - epsilon",
        ),
        Wrong(
            {"2, 2.1": "1, 1"},
            "a step larger than 1 does not stop at the minimum: it goes past it, and above 2 farther than it came from",
        ),
    ),
    minutes=4,
    digits=4,
    covers=("eq-nn-27", "alg-gradient-descent", "cl-093", "ex-one-dim", "fig-48"),
)


Exercise(
    id="ch06-predict-zeros",
    kind="predict",
    tier="more",
    section="Where to start",
    title="All weights zero",
    statement=r"""
        Two inputs, three hidden sigmoid neurons, one linear output; all weights and biases are 0. The sample is $x = (1, 2)$, $y = 1$, the cost quadratic.
        Predict the derivatives with respect to a weight from the first input to a hidden neuron, the bias of a hidden neuron, a weight from a hidden neuron to the output, and
        the bias of the output ({eq}`eq-nn-34` to {eq}`eq-nn-37`). Bind the tuple of the four numbers to `at_zero`. Then say what the three hidden neurons have in common, now and for ever.
    """,
    stub="at_zero = ...",
    cases=lambda rng: [
        Case(
            {},
            tuple(
                float(part.flat[0])
                for part in _gradients(
                    np.array([1.0, 2.0]),
                    np.array([1.0]),
                    np.zeros((3, 2)),
                    np.zeros(3),
                    np.zeros((1, 3)),
                    np.zeros(1),
                    output="linear",
                )
            ),
        )
    ],
    hints=(
        r"The output is 0, so its error is $0 - 1$. The hidden activations are $\sigma(0)$.",
        "What is left of the error of the output once it has passed back through weights of 0?",
    ),
    solution="at_zero = (0.0, 0.0, -0.5, -1.0)",
    wrong=(
        Wrong("at_zero = (0.0, 0.0, 0.5, 1.0)", "the sign is turned round: the error of the output is a - y = -1"),
        Wrong(
            "at_zero = (-0.25, -0.25, -0.5, -1.0)",
            "the error passes back through the weights of the output, which are 0: nothing reaches the hidden neurons",
        ),
        Wrong("at_zero = (0.0, 0.0, 0.0, -1.0)", "a sigmoid neuron answers 0.5 to an input of 0, not 0"),
        Wrong("at_zero = (0.0, 0.0, -0.125, -0.25)", "the output is linear: its slope is 1, not 1/4"),
        Wrong("at_zero = (0.0, 0.0, 0.0, 0.0)", "not everything stands still: the output is 0 and should be 1"),
    ),
    minutes=5,
    covers=("eq-nn-34", "eq-nn-35", "eq-nn-36", "eq-nn-37"),
)


# ---------------------------------------------------------------------- building networks


Exercise(
    id="ch06-build-stove",
    kind="build",
    tier="core",
    section="The stove, by hand and learned",
    title="The hot stove",
    statement=r"""
        Two inputs between 0 and 1, temperature and pain; the hand is pulled back (output near 1) if at least one of them exceeds 0.5, and stays (near 0) otherwise. Choose weights
        and biases of two hidden sigmoid neurons, each a steep step at 0.5 of one input, and of a sigmoid output that fires if any of them does
        ({eq}`eq-nn-23`). Complete the network of the stub; the check looks only at its outputs, which must be within 0.01 of 0 or 1, also at lukewarm inputs such as 0.4 and 0.4.
    """,
    setup=WITH_SIGMOID,
    stub="""
        def pull_back(temperature, pain):
            x = np.array([temperature, pain])
            w1, b1 = ..., ...
            w2, b2 = ..., ...
            return float(sigmoid(w2 @ sigmoid(w1 @ x + b1) + b2))
    """,
    cases=lambda rng: [
        Case(dict(temperature=t, pain=p), float(t > 0.5 or p > 0.5), tol=0.01)
        for t, p in ((0.0, 0.0), (0.4, 0.4), (0.9, 0.1), (0.4, 0.6), (0.6, 0.0), (0.9, 0.8), (0.3, 0.4))
    ],
    hints=(
        "A step at $s$ has the bias $b = -w s$: with $w = 100$ the hidden biases are -50. Each hidden neuron gives the weight 0 to the other input.",
        "The output sees 0, 1 or 2 hidden neurons on. Put its step between 0 and 1: weights 20 and 20, bias -10.",
    ),
    solution="""
        def pull_back(temperature, pain):
            x = np.array([temperature, pain])
            w1, b1 = np.array([[100.0, 0.0], [0.0, 100.0]]), np.array([-50.0, -50.0])
            w2, b2 = np.array([20.0, 20.0]), -10.0
            return float(sigmoid(w2 @ sigmoid(w1 @ x + b1) + b2))
    """,
    wrong=(
        Wrong(
            {"-10.0": "-30.0"},
            "it waits for both inputs: the step of the output lies between 1 and 2 neurons on; put it between 0 and 1",
        ),
        Wrong(
            {"[[100.0, 0.0], [0.0, 100.0]]": "[[100.0, 100.0], [100.0, 100.0]]"},
            "two lukewarm inputs pull the hand back: each hidden neuron must look at one input alone",
        ),
        Wrong(
            {"[-50.0, -50.0]": "[-100.0, -100.0]"},
            "the hidden steps stand at 1: the bias for a step at 0.5 is minus half the weight",
        ),
        Wrong(
            {"[-50.0, -50.0]": "[50.0, 50.0]"},
            "the hidden steps stand at -0.5, and the neurons are always on: the bias is minus the threshold",
        ),
        Wrong(
            {"-10.0": "0.0"},
            "with no bias the output is one half when nothing happens: it needs a threshold of its own",
        ),
    ),
    minutes=8,
    covers=("ex-hot-stove", "eq-nn-23", "fig-32", "cl-087"),
)


Exercise(
    id="ch06-build-xor",
    kind="build",
    tier="deep",
    section="The stove, by hand and learned",
    title="Either, but not both",
    statement=r"""
        No single neuron can tell whether **exactly** one of its two inputs is 1: its border is a straight line. Two hidden steps and an output can. `x` is an array of two numbers, each near 0 or near 1; choose
        the weights and biases so that the output is within 0.03 of 1 if exactly one is near 1, and of 0 otherwise.
    """,
    setup=WITH_SIGMOID,
    stub="""
        def xor(x):
            w1, b1 = ..., ...
            w2, b2 = ..., ...
            return float(sigmoid(w2 @ sigmoid(w1 @ x + b1) + b2))
    """,
    cases=lambda rng: [
        Case(dict(x=np.array(x)), one, tol=0.03)
        for x, one in (
            ((0.0, 0.0), 0.0),
            ((0.0, 1.0), 1.0),
            ((1.0, 0.0), 1.0),
            ((1.0, 1.0), 0.0),
            ((0.05, 0.95), 1.0),
            ((0.95, 0.95), 0.0),
        )
    ],
    hints=(
        "Let one hidden neuron say *at least one* (a step at 1/2 of the sum of the inputs) and the other *both* (a step at 3/2).",
        "The output wants the first and not the second: weights 20 and -20, and a step at 1/2 of their difference.",
    ),
    solution="""
        def xor(x):
            w1, b1 = np.array([[20.0, 20.0], [20.0, 20.0]]), np.array([-10.0, -30.0])
            w2, b2 = np.array([20.0, -20.0]), -10.0
            return float(sigmoid(w2 @ sigmoid(w1 @ x + b1) + b2))
    """,
    wrong=(
        Wrong(
            {"[20.0, -20.0]": "[20.0, 0.0]"},
            "it also fires when both inputs are on: the neuron that says *both* must hold it back",
        ),
        Wrong(
            {"[20.0, -20.0]": "[-20.0, 20.0]"},
            "it never fires: the output wants the neuron that says *at least one* and not the one that says *both*, and the two must differ",
        ),
        Wrong(
            {"[-10.0, -30.0]": "[-10.0, -20.0]"},
            "the neuron that says *both* has its step at 1, just where a single input brings it: put it at 3/2",
        ),
        Wrong(
            {"[20.0, -20.0]), -10.0": "[20.0, -20.0]), 10.0"},
            "the output fires for nothing at all: its bias is minus the threshold, -10",
        ),
        Wrong(
            {"[20.0, -20.0]": "[-20.0, -20.0]", "-20.0]), -10.0": "-20.0]), 10.0"},
            "it fires when no input is on: this is *neither*, not *exactly one*",
        ),
    ),
    minutes=12,
    covers=("alg-mlp-forward", "alg-step-network", "eq-nn-30"),
)


Exercise(
    id="ch06-bump",
    kind="fill in",
    tier="more",
    section="Bumps",
    title="A bump from two steps",
    statement=r"""
        Two steep sigmoid neurons with the weight `w`, one with its step at `s1`, the other at `s2` ({eq}`eq-nn-24`), and a linear output with the weights $h$ and $-h$: about `h` between
        `s1` and `s2`, about 0 elsewhere. Return the output for an array `x`.
    """,
    setup=WITH_SIGMOID,
    stub="""
        def two_steps(x, s1, s2, h, w):
            ...
    """,
    cases=lambda rng: [
        Case(dict(x=x, s1=s1, s2=s2, h=h, w=w), bump(x, s1, s2, h, w))
        for s1, s2, h, w in ((0.2, 0.6, 0.8, 100.0), (0.0, 0.5, 0.6, 40.0), (0.4, 0.5, -1.5, 60.0))
        for x in [np.linspace(0.05, 1, 6)]
    ],
    hints=(
        "A step at `s` is `sigmoid(w * x + b)` with `b = -w * s`.",
        "The first step lifts the output by `h`, the second takes it away again.",
    ),
    solution="""
        def two_steps(x, s1, s2, h, w):
            left = sigmoid(w * x - w * s1)
            right = sigmoid(w * x - w * s2)
            return h * left - h * right
    """,
    wrong=(
        Wrong(
            """
            def two_steps(x, s1, s2, h, w):
                return h * sigmoid(w * (x - s1)) + h * sigmoid(w * (x - s2))
            """,
            "a staircase: the second step must take away what the first one gave",
        ),
        Wrong(
            """
            def two_steps(x, s1, s2, h, w):
                return h * sigmoid(w * x - s1) - h * sigmoid(w * x - s2)
            """,
            "both steps stand near 0: the bias for a step at s is -w s, not -s",
        ),
        Wrong(
            """
            def two_steps(x, s1, s2, h, w):
                return h * sigmoid(w * (x - s2)) - h * sigmoid(w * (x - s1))
            """,
            "the bump hangs upside down: the step at s1 goes up, that at s2 down",
        ),
        Wrong(
            """
            def two_steps(x, s1, s2, h, w):
                return h * sigmoid(w * (x + s1)) - h * sigmoid(w * (x + s2))
            """,
            "the bump stands at the negative positions: the bias is -w s, with a minus",
        ),
        Wrong(
            """
            def two_steps(x, s1, s2, h, w):
                return sigmoid(w * (x - s1)) - sigmoid(w * (x - s2))
            """,
            "this bump has height 1: the output weights are h and -h",
        ),
        Wrong(
            """
            def two_steps(x, s1, s2, h, w):
                return sigmoid(h * sigmoid(w * (x - s1)) - h * sigmoid(w * (x - s2)))
            """,
            "the output neuron is linear here: with a sigmoid it is one half outside the bump",
        ),
    ),
    minutes=5,
    covers=("eq-u-bump", "eq-nn-24", "fig-44"),
)


def _bump_parameters(edges, heights, w):
    net = step_bump_network(None, len(heights), interval=(edges[0], edges[-1]), w=w, heights=heights, ends=0)
    return net.weights[0], net.biases[0], net.weights[1]


Exercise(
    id="ch06-build-bumps",
    kind="build",
    tier="deep",
    section="Any curve from bumps",
    title="Any function, by hand",
    statement=r"""
        Bumps beside each other follow a function. `edges` holds `n + 1` equally spaced positions, `heights` the `n` heights between them. Build the network: `2 n` hidden sigmoid neurons with the weight
        `w`, in the order *left and right step of the first bump, left and right step of the second* and so on, and a linear output without bias. Return `(w1, b1, w2)`,
        of shapes `(2 n, 1)`, `(2 n,)` and `(1, 2 n)`. How many step functions does a picture with five bumps have?
    """,
    stub="""
        def bump_network(edges, heights, w):
            ...
            return w1, b1, w2
    """,
    cases=lambda rng: [
        Case(dict(edges=edges, heights=heights, w=w), _bump_parameters(edges, heights, w))
        for n, low, high, w in ((5, 0.0, 1.0, 1000.0), (2, -1.0, 3.0, 50.0), (1, 0.0, 0.5, 10.0))
        for edges, heights in [(np.linspace(low, high, n + 1), rng.normal(size=n).round(1) + 1.05)]
    ],
    hints=(
        "List the positions of the steps first: `edges[0], edges[1], edges[1], edges[2], ...`; each inner edge comes twice.",
        "`np.column_stack((edges[:-1], edges[1:])).ravel()` is this list, and `np.column_stack((heights, -heights))` does the same for the output weights.",
    ),
    solution="""
        def bump_network(edges, heights, w):
            steps = np.column_stack((edges[:-1], edges[1:])).ravel()
            w1 = np.full((len(steps), 1), w)
            b1 = -w * steps
            w2 = np.column_stack((heights, -heights)).reshape(1, -1)
            return w1, b1, w2
    """,
    wrong=(
        Wrong(
            {"-w * steps": "w * steps"}, "the steps stand at the negative positions: the bias of a step at s is -w s"
        ),
        Wrong(
            {"(heights, -heights)": "(heights, heights)"},
            "a staircase: the right step of each bump takes its height away again",
        ),
        Wrong(
            {"(edges[:-1], edges[1:])).ravel()": "(edges[:-1], edges[1:])).T.ravel()"},
            "all left steps come first, then all right ones, but the output weights come in pairs: keep one order",
        ),
        Wrong({"-w * steps": "-steps"}, "a bias of -s gives a step at s / w: multiply by the weight"),
        Wrong({"(heights, -heights)": "(-heights, heights)"}, "every bump hangs upside down: the left step goes up"),
    ),
    minutes=12,
    covers=("alg-step-network", "fig-46", "cl-091", "cl-092", "ex-universal"),
)


# ---------------------------------------------------------------------- claims


Exercise(
    id="ch06-claim-position",
    kind="experiment",
    tier="deep",
    section="Steps",
    title="Proportional to the weight?",
    statement=r"""
        The document says that the position of the step is proportional to the weight and to the bias. Measure it: for the weights 20, 40 and 80 and the bias -10 find the first point of
        `x = np.linspace(0, 1, 100_001)` at which `sigmoid(w * x - 10)` exceeds 0.499999 (a half, but for rounding). Bind `verdict_position` to `(word, s20, s40, s80)`: `"confirmed"` if the position grows with
        the weight, else `"refuted"`, and the three positions.
    """,
    setup=WITH_SIGMOID,
    stub="verdict_position = ...",
    cases=lambda rng: [Case({}, ("refuted", *(step_position(w, -10) for w in (20, 40, 80))), tol=1e-4)],
    hints=(
        "`np.argmax` of an array of truth values gives the place of the first true one.",
        "Twice the weight reaches the threshold with half the input: compare the numbers with $-b / w$.",
    ),
    solution="""
        x, found = np.linspace(0, 1, 100_001), []
        for w in (20, 40, 80):
            found.append(float(x[np.argmax(sigmoid(w * x - 10) > 0.499999)]))
        verdict_position = ("confirmed" if found[0] < found[1] < found[2] else "refuted", *found)
    """,
    wrong=(
        Wrong(
            {'"confirmed" if found[0] < found[1] < found[2] else "refuted"': '"confirmed"'},
            "the positions are right, and they halve as the weight doubles: inversely proportional",
        ),
        Wrong(
            {"(20, 40, 80)": "(80, 40, 20)"},
            "the order is turned round, from the largest weight: it makes the position seem to grow",
        ),
        Wrong(
            {"x - 10": "x - w / 2"}, "the bias has moved with the weight and held the step at one half: keep it at -10"
        ),
        Wrong(
            'verdict_position = ("confirmed", 0.5, 1.0, 2.0)',
            "this is what the claim says, not what the neurons do: measure it",
        ),
    ),
    minutes=5,
    covers=("cl-090", "cl-089", "eq-nn-24"),
)


def _log_gradients():
    ws = np.sqrt(2 / 64) * np.random.default_rng(0).normal(size=(10, 64, 64))
    powers = []
    for negative, positive in ((0.0, 1.0), (0.0, 0.25), (-1.0, 1.0)):  # the slopes left and right of 0
        a, back = np.random.default_rng(1).normal(size=64), np.eye(64)
        for w in ws:
            slope = np.where(w @ a > 0, positive, negative)
            a, back = slope * (w @ a), back @ w.T * slope
        powers.append(float(np.log10(np.linalg.norm(back @ np.ones(64) / 8))))
    return powers


Exercise(
    id="ch06-claim-relu",
    kind="experiment",
    tier="deep",
    section="Gradients that vanish",
    title="Why ReLU?",
    statement=r"""
        The document calls the ReLU more reliable *because it is 0 on half of its domain*. Test that reason on three activations: the ReLU; a quarter of it, $\max(0, z) / 4$, which is 0 just as often; and $|z|$, which is 0 nowhere. Each is a straight line on either side of 0, with the slope `left` where $z < 0$ and `right` where $z > 0$.

        The network has ten layers of 64 neurons without biases; the stub makes its weights `ws`, its input `a` and the gradient `g`, of length 1, with respect to the last activations. Complete the two inner loops:

        * forward ({eq}`eq-nn-30`): from `a` compute the weighted inputs, keep their slopes in the list `slopes`, and compute the new `a`;
        * backward ({eq}`eq-nn-35`): from `g`, the gradient with respect to a layer's activations, compute that with respect to the activations of the layer before.

        The stub then notes the power of ten of the gradient that has arrived at the input. Bind
        `verdict_relu` to `(word, relu, quarter, absolute)`: `"confirmed"` if the quarter keeps more than a tenth of the gradient and $|z|$ does not, else `"refuted"`, and the three powers of ten.
    """,
    stub="""
        ws = np.sqrt(2 / 64) * np.random.default_rng(0).normal(size=(10, 64, 64))
        powers = []
        for left, right in ((0, 1), (0, 0.25), (-1, 1)):
            a, slopes, g = np.random.default_rng(1).normal(size=64), [], np.ones(64) / 8
            for w in ws:
                ...
            for w, slope in zip(ws[::-1], slopes[::-1]):
                ...
            powers.append(float(np.log10(np.linalg.norm(g))))
        verdict_relu = ...
    """,
    cases=lambda rng: [Case({}, ("refuted", *_log_gradients()), tol=1e-6)],
    hints=(
        "Forward: `z = w @ a`, keep the slopes `np.where(z > 0, right, left)` in `slopes`, and the new `a` is slope times `z`.",
        "Backward: `g = w.T @ (g * slope)`. Ten layers multiply ten slopes: what is a quarter to the power 10?",
    ),
    solution="""
        ws = np.sqrt(2 / 64) * np.random.default_rng(0).normal(size=(10, 64, 64))
        powers = []
        for left, right in ((0, 1), (0, 0.25), (-1, 1)):
            a, slopes, g = np.random.default_rng(1).normal(size=64), [], np.ones(64) / 8
            for w in ws:
                z = w @ a
                slopes.append(np.where(z > 0, right, left))
                a = slopes[-1] * z
            for w, slope in zip(ws[::-1], slopes[::-1]):
                g = w.T @ (g * slope)
            powers.append(float(np.log10(np.linalg.norm(g))))
        verdict_relu = ("confirmed" if powers[1] > -1 > powers[2] else "refuted", *powers)
    """,
    wrong=(
        Wrong(
            {'"confirmed" if powers[1] > -1 > powers[2] else "refuted"': '"confirmed"'},
            "the numbers are right: the quarter is 0 on the same half, and its gradient vanishes all the same; what matters is the slope where it is not 0",
        ),
        Wrong(
            {"(0, 0.25), (-1, 1))": "(-1, 1), (0, 0.25))"},
            "the last two are swapped: first the quarter, then the absolute value",
        ),
        Wrong(
            {"w.T @ (g": "w @ (g"},
            "the transpose is missing on the way back: nothing complains, for every layer has 64 neurons",
        ),
        Wrong(
            {"g = w.T @ (g * slope)": "g = w.T @ g"},
            "the slopes are missing on the way back: without them every activation carries the same gradient",
        ),
        Wrong(
            {"g = w.T @ (g * slope)": "g = w.T @ g * slope"},
            "the slope is applied after the weights, but it belongs to the layer that the error has not yet left",
        ),
    ),
    minutes=20,
    covers=("cl-088", "eq-u-relu", "fig-34"),
)


@cache
def _depth_costs():
    x = np.linspace(0, 1, 21)[:, None]
    costs = []
    for depth in (1, 2, 4):
        rng = np.random.default_rng(0)
        net = MLP([1, *[16] * depth, 1], hidden="sigmoid", optimizer=SGD(0.5), dtype=np.float64, rng=rng)
        costs.append(float(sgd(net, x, np.cos(x) ** 2 + x, batch=None, epochs=400, rng=rng)[-1]))
    return tuple(costs)


Exercise(
    id="ch06-claim-depth",
    kind="experiment",
    tier="deep",
    section="Gradients that vanish",
    title="The more layers, the better?",
    statement=r"""
        *More hidden layers greatly improve accuracy*, says the document. Train networks with 1, 2 and 4 hidden layers of 16 sigmoid neurons on $f(x) = \cos^2 x + x$ at `x = np.linspace(0, 1, 21)[:, None]`: `net = MLP(sizes,
        hidden="sigmoid", optimizer=SGD(0.5), dtype=np.float64, rng=rng)` and `sgd(net, x, y, batch=None, epochs=400, rng=rng)`, with a new `rng = np.random.default_rng(0)` for each depth; `sgd` returns the cost of every epoch. Bind `verdict_depth` to
        `(word, c1, c2, c4)`: `"confirmed"` if the last costs fall with the depth, else `"refuted"`, and these costs. It is one seed and one task: enough to refute *always*, no more. Try another seed.
    """,
    setup="import numpy as np\nfrom rlcore.nn import MLP, sgd\nfrom rlcore.optimizers import SGD",
    stub="verdict_depth = ...",
    cases=lambda rng: [Case({}, ("refuted", *_depth_costs()), tol=1e-5)],
    hints=(
        "The sizes are `[1, 16, 1]`, `[1, 16, 16, 1]` and `[1, 16, 16, 16, 16, 1]`.",
        "`sgd` returns the cost of every epoch; take the last one.",
    ),
    solution="""
        x = np.linspace(0, 1, 21)[:, None]
        y, costs = np.cos(x) ** 2 + x, []
        for depth in (1, 2, 4):
            rng = np.random.default_rng(0)
            net = MLP([1] + depth * [16] + [1], hidden="sigmoid", optimizer=SGD(0.5), dtype=np.float64, rng=rng)
            costs.append(float(sgd(net, x, y, batch=None, epochs=400, rng=rng)[-1]))
        verdict_depth = ("confirmed" if costs[0] > costs[1] > costs[2] else "refuted", *costs)
    """,
    wrong=(
        Wrong(
            {'"confirmed" if costs[0] > costs[1] > costs[2] else "refuted"': '"confirmed"'},
            "the costs are right, and they grow with the depth: through sigmoid layers hardly any gradient comes back",
        ),
        Wrong({"(1, 2, 4)": "(4, 2, 1)"}, "the order is turned round: one hidden layer first"),
        Wrong({"[-1]))": "[0]))"}, "these are the costs of the first epoch, before anything was learned"),
        Wrong({"epochs=400": "epochs=40"}, "these are the costs after 40 epochs: 400 are asked for"),
    ),
    minutes=15,
    covers=("cl-085", "cl-084", "ex-universal", "eq-u-target-function"),
)


QUESTIONS = (
    Question(
        "What does backpropagation do?",
        (
            ("It computes the gradient of the cost", True, "What is done with it is the business of the optimiser."),
            ("It changes the weights", False, "That is the step of gradient descent, which only uses the gradient."),
            ("It sends the outputs back to the inputs", False, "Errors go back, multiplied by weights and slopes."),
        ),
    ),
    Question(
        "Why is the quadratic cost slow to correct a sigmoid output that is confidently wrong?",
        (
            ("The cost is small there", False, "It is near its largest value, 1/2 for this output."),
            (
                "The slope of the sigmoid is near 0 there",
                True,
                "The error of the output is a - y times this slope; with softmax and cross-entropy the slope drops out.",
            ),
            ("The learning rate is too large", False, "A larger one would hurry it, if anything."),
        ),
    ),
    Question(
        "What does the universal approximation theorem promise?",
        (
            ("That training finds the function", False, "It says that good weights exist, not how to find them."),
            ("That deep networks are needed", False, "One hidden layer is enough for it."),
            (
                "That one wide hidden layer can come close to a continuous function on a bounded region",
                True,
                "Outside this region, and about the number of neurons, it says nothing.",
            ),
        ),
    ),
    Question(
        "The gradient of a random minibatch is not that of all samples. Why may one use it?",
        (
            ("On average it is", True, "It is an unbiased estimate, and costs a fraction of the work."),
            ("It is always smaller", False, "It is often larger; it varies around the full gradient."),
            ("The network cannot tell them apart", False, "The steps differ, and the path is noisier."),
        ),
    ),
    Question(
        "All weights of a network start at the same number. What goes wrong?",
        (
            ("The outputs overflow", False, "Equal weights need not be large."),
            (
                "The neurons of a hidden layer stay equal",
                True,
                "They get equal gradients at every step, and the layer works like one neuron: start at random.",
            ),
            ("Nothing, the gradient sorts it out", False, "The gradients are as equal as the weights."),
        ),
    ),
)
