"""One neuron, its activations, steps and bumps; the costs of what a network answers (chapter 6)."""

import numpy as np

from rlcore.core.checks import as_floats, check_count, is_number

# ---------------------------------------------------------------------- activations


def sigmoid(z):
    """1 / (1 + e^-z), elementwise. eq-u-sigmoid, fig-33

    Written with e^-|z|, which cannot overflow.
    """
    e = np.exp(-np.abs(z))
    return np.where(np.greater_equal(z, 0), 1.0, e) / (1.0 + e)


def relu(z):
    """max(0, z), elementwise. eq-u-relu, fig-34"""
    return np.maximum(z, 0)


def tanh(z):
    """The hyperbolic tangent, elementwise: 2 sigma(2z) - 1."""
    return np.tanh(z)


def linear(z):
    """z itself: the output of a network that has to reach any number."""
    return z


ACTIVATIONS = {  # name: (f, f' as a function of z and a = f(z))
    "sigmoid": (sigmoid, lambda z, a: a * (1 - a)),
    "relu": (relu, lambda z, a: np.greater(z, 0).astype(a.dtype)),  # 0 at z = 0
    "tanh": (tanh, lambda z, a: 1 - a * a),
    "linear": (linear, lambda z, a: np.ones_like(a)),
}


def neuron(w, x, b=0.0, activation="sigmoid"):
    """Output of one neuron, sigma(w . x + b). eq-nn-20, eq-nn-21, eq-nn-22, eq-nn-23

    w, x: (n,), or x (B, n) for a batch. activation: a name of ACTIVATIONS; "linear" leaves the weighted sum as it is.
    Returns a number, or (B,). Source: Nielsen (2015), chapter 1.
    """
    w, x = as_floats("w", w), as_floats("x", x)
    if w.ndim != 1 or x.ndim not in (1, 2) or x.shape[-1] != w.size:
        raise ValueError(f"x: got shape {x.shape} with w of shape {w.shape}, must be (n,) or (B, n) with w (n,)")
    f, _ = check_name("activation", activation, ACTIVATIONS)
    return f(x @ w + b)  # eq-nn-23


def log_softmax(logits):
    """Logarithms of the softmax of the last axis; adding a number to all logits changes nothing. om-softmax"""
    shifted = logits - logits.max(axis=-1, keepdims=True)  # exp of large logits would overflow
    return shifted - np.log(np.exp(shifted).sum(axis=-1, keepdims=True))  # om-softmax


def softmax(logits):
    """Probabilities proportional to exp(logits), along the last axis. om-softmax"""
    return np.exp(log_softmax(logits))


# ---------------------------------------------------------------------- costs


def one_hot(k, n):
    """Desired output for class k of n: 1 in place k, counted from 0, and 0 elsewhere. eq-u-digit-target corrected

    k: a whole number, or (B,) of them. Returns (n,) or (B, n).
    """
    n = check_count("n", n)
    return np.eye(n)[_check_labels("k", k, n)]


def quadratic_cost(a, y):
    """C = 1/(2n) sum over the n samples of |y - a|^2. eq-nn-25, ex-digit-cost

    a, y: (d,) for one sample or (B, d). Returns a number.
    """
    a, y = _check_pair(a, y)
    return float(np.square(y - a).sum() / (2 * np.atleast_2d(a).shape[0]))  # eq-nn-25


def quadratic_gradient(a, y):
    """Derivative of `quadratic_cost` with respect to a: (a - y) / n, of a's shape. eq-nn-33, eq-nn-34"""
    a, y = _check_pair(a, y)
    return (a - y) / np.atleast_2d(a).shape[0]


def cross_entropy(logits, labels):
    """Mean of -log of the softmax probability that the logits give to the label.

    logits: (K,) or (B, K), outputs of a linear layer. labels: a whole number below K, or (B,) of them.
    Returns a number. Source: Goodfellow et al. (2016), section 6.2.2.3.
    """
    logits, labels = _check_classes(logits, labels)
    return float(-log_softmax(logits)[np.arange(labels.size), labels].mean())


def cross_entropy_gradient(logits, labels):
    """Derivative of `cross_entropy` with respect to the logits: (softmax - one_hot) / n, of their shape."""
    shape = np.shape(logits)
    logits, labels = _check_classes(logits, labels)
    p = softmax(logits)
    p[np.arange(labels.size), labels] -= 1
    return (p / labels.size).reshape(shape)


COSTS = {  # name: (cost, its derivative with respect to the outputs)
    "quadratic": (quadratic_cost, quadratic_gradient),
    "cross_entropy": (cross_entropy, cross_entropy_gradient),
}


# ---------------------------------------------------------------------- steps, bumps, towers


def step_position(w, b):
    """Where sigma(w x + b) crosses 1/2: s = -b / w. eq-nn-24, fig-41, cl-090"""
    return -_check_finite("b", b) / _check_slope(w)  # eq-nn-24


def step_neuron(x, s, w=1000.0):
    """A sigmoid neuron steep enough to be a step from 0 to 1 at s: sigma(w x + b) with b = -w s. fig-40, fig-41

    x: any shape. w: the weight; a negative one steps down. Returns an array of x's shape.
    """
    w, s = _check_slope(w), _check_finite("s", s)
    return sigmoid(w * as_floats("x", x) - w * s)


def bump(x, s1, s2, h, w=1000.0):
    """Two step neurons with output weights h and -h: about h between s1 and s2, about 0 elsewhere. eq-u-bump, fig-44"""
    return h * step_neuron(x, s1, w) - h * step_neuron(x, s2, w)  # eq-u-bump


def tower(x, y, x_range, y_range, h, w=1000.0):
    """About h inside the rectangle x_range x y_range, about 0 outside: bumps in two dimensions. cl-083

    A bump of height 1 along each axis; both together make 2, one alone 1, so that a step neuron at 3/2 fires inside
    only. x, y: arrays of one shape. x_range, y_range: pairs. Source: Nielsen (2015), chapter 4.
    """
    both = bump(x, *x_range, 1.0, w) + bump(y, *y_range, 1.0, w)
    return h * step_neuron(both, 1.5, w)


# ---------------------------------------------------------------------- checks


def check_name(argument, name, table):
    """table[name]; ValueError unless it is there."""
    if not isinstance(name, str) or name not in table:
        raise ValueError(f"{argument}: got {name!r}, allowed are {', '.join(table)}")
    return table[name]


def check_dtype(dtype):
    """dtype as a numpy.dtype; ValueError unless float32 or float64."""
    try:
        found = None if dtype is None else np.dtype(dtype)
    except (TypeError, ValueError):
        found = None
    if found not in (np.float32, np.float64):
        raise ValueError(f"dtype: got {dtype!r}, must be numpy.float32 or numpy.float64")
    return found


def _check_slope(w):
    if not is_number(w) or not np.isfinite(w) or w == 0:
        raise ValueError(f"w: got {w!r}, must be a finite number other than 0: without a slope there is no step")
    return w


def _check_finite(name, value):
    if not is_number(value) or not np.isfinite(value):
        raise ValueError(f"{name}: got {value!r}, must be a finite number")
    return value


def _floats(name, x):
    """x as an array, of float32 where it is one, else of float64."""
    return x if isinstance(x, np.ndarray) and x.dtype == np.float32 else as_floats(name, x)


def _check_pair(a, y):
    """a and y as arrays of one shape, (d,) or (B, d), in a's precision."""
    a, y = _floats("a", a), _floats("y", y)
    if a.shape != y.shape or a.ndim not in (1, 2) or not a.size:
        raise ValueError(f"y: got shape {y.shape} with a of shape {a.shape}, must be both (d,) or both (B, d)")
    return a, y.astype(a.dtype, copy=False)


def _check_classes(logits, labels):
    """logits as (B, K), labels as whole numbers below K, (B,) or one."""
    logits, shape = _floats("logits", logits), np.shape(labels)
    if logits.ndim not in (1, 2) or not logits.size or shape != logits.shape[:-1]:
        raise ValueError(f"labels: got shape {shape}, must be {logits.shape[:-1]} for logits of shape {logits.shape}")
    return np.atleast_2d(logits), _check_labels("labels", labels, logits.shape[-1])


def _check_labels(name, k, n):
    k = np.asarray(k)
    if k.dtype.kind not in "iu" or k.ndim > 1 or not k.size or k.min() < 0 or k.max() >= n:
        raise ValueError(f"{name}: got {k}, must be whole numbers from 0 to {n - 1}")
    return k
