"""One neuron, its activations, steps and bumps; the costs of what a network answers (chapter 6)."""

from __future__ import annotations

import numpy as np

from rlcore.core.checks import check_count, check_finite, finite
from rlcore.core.rules import anything, array, checked, choice
from rlcore.core.samples import check_labels, finite_numbers, numbers, pair
from rlcore.core.types import ArrayLike, Floats

# ---------------------------------------------------------------------- activations


@checked(z=numbers)
def sigmoid(z: ArrayLike) -> Floats:
    """The sigmoid 1 / (1 + e^-z), elementwise.

    Written with e^-|z|, which cannot overflow.

    Parameters
    ----------
    z : ArrayLike
        Numbers, any shape.

    Returns
    -------
    Floats
        Of z's shape, in [0, 1].

    Notes
    -----
    Ledger: eq-u-sigmoid, fig-33.

    Examples
    --------
    >>> from rlcore import sigmoid
    >>> sigmoid([0.0, 2.0]).round(3)
    array([0.5  , 0.881])
    """
    e = np.exp(-np.abs(z))
    return np.where(np.greater_equal(z, 0), 1.0, e) / (1.0 + e)


@checked(z=numbers)
def relu(z: ArrayLike) -> Floats:
    """max(0, z), elementwise.

    Parameters
    ----------
    z : ArrayLike
        Numbers, any shape.

    Returns
    -------
    Floats
        Of z's shape.

    Notes
    -----
    Ledger: eq-u-relu, fig-34.
    """
    return np.maximum(z, 0)


@checked(z=numbers)
def tanh(z: ArrayLike) -> Floats:
    """The hyperbolic tangent, elementwise: 2 sigma(2z) - 1.

    Parameters
    ----------
    z : ArrayLike
        Numbers, any shape.

    Returns
    -------
    Floats
        Of z's shape.
    """
    return np.tanh(z)


@checked(z=numbers)
def linear(z: ArrayLike) -> Floats:
    """z itself: the output of a network that has to reach any number.

    Parameters
    ----------
    z : ArrayLike
        Numbers, any shape.

    Returns
    -------
    Floats
        Of z's shape.
    """
    return z


ACTIVATIONS = {  # name: (f, f' as a function of z and a = f(z))
    "sigmoid": (sigmoid.unchecked, lambda z, a: a * (1 - a)),
    "relu": (relu.unchecked, lambda z, a: np.greater(z, 0).astype(a.dtype)),  # 0 at z = 0
    "tanh": (tanh.unchecked, lambda z, a: 1 - a * a),
    "linear": (linear.unchecked, lambda z, a: np.ones_like(a)),
}


def _inputs(name, x, given):
    x, w = finite(name, x), given["w"]
    if x.ndim not in (1, 2) or x.shape[-1] != w.size:
        raise ValueError(f"{name}: got shape {x.shape} with w of shape {w.shape}, must be (n,) or (B, n) with w (n,)")
    return x


@checked(w=array("n"), x=_inputs, b=check_finite, activation=choice(*ACTIVATIONS))
def neuron(w: ArrayLike, x: ArrayLike, b: float = 0.0, activation: str = "sigmoid") -> Floats:
    """Output of one neuron, sigma(w . x + b).

    Parameters
    ----------
    w : ArrayLike
        (n,), the weights.
    x : ArrayLike
        (n,), the inputs, or (B, n) for a batch.
    b : float
        The bias.
    activation : str
        A name of ACTIVATIONS; "linear" leaves the weighted sum as it is.

    Returns
    -------
    Floats
        A number, or (B,).

    Notes
    -----
    Ledger: eq-nn-20, eq-nn-21, eq-nn-22, eq-nn-23.

    References
    ----------
    Nielsen (2015), chapter 1.

    Examples
    --------
    >>> from rlcore import neuron
    >>> neuron([1.0, -1.0], [2.0, 1.0], b=-1.0)
    np.float64(0.5)
    """
    return ACTIVATIONS[activation][0](x @ w + b)  # eq-nn-23


def _logits(name, logits, given):
    logits = finite_numbers(name, logits)
    if not logits.ndim or not logits.shape[-1]:
        raise ValueError(f"{name}: got shape {logits.shape}, must be (..., A), with A at least 1")
    return logits


@checked(logits=_logits)
def log_softmax(logits: ArrayLike) -> Floats:
    """Logarithms of the softmax of the last axis; adding a number to all logits changes nothing.

    Parameters
    ----------
    logits : ArrayLike
        (K,) or (B, K).

    Returns
    -------
    Floats
        Of the shape of the logits.

    Notes
    -----
    Ledger: om-softmax.
    """
    shifted = logits - logits.max(axis=-1, keepdims=True)  # exp of large logits would overflow
    return shifted - np.log(np.exp(shifted).sum(axis=-1, keepdims=True))  # om-softmax


@checked(logits=_logits)
def softmax(logits: ArrayLike) -> Floats:
    """Probabilities proportional to exp(logits), along the last axis.

    Parameters
    ----------
    logits : ArrayLike
        (K,) or (B, K).

    Returns
    -------
    Floats
        Of the shape of the logits.

    Notes
    -----
    Ledger: om-softmax.

    Examples
    --------
    >>> from rlcore import softmax
    >>> softmax([0.0, 0.0])
    array([0.5, 0.5])
    """
    return np.exp(log_softmax.unchecked(logits))


# ---------------------------------------------------------------------- costs


def _n_classes(name, n, given):
    n = check_count(name, n)
    given["k"] = check_labels("k", given["k"], n)
    if given["k"].ndim > 1:
        raise ValueError(f"k: got shape {given['k'].shape}, must be a whole number, or (B,)")
    return n


@checked(k=anything, n=_n_classes)
def one_hot(k: ArrayLike, n: int) -> Floats:
    """Desired output for class k of n: 1 in place k, counted from 0, and 0 elsewhere.

    Parameters
    ----------
    k : ArrayLike
        A whole number, or (B,) of them.
    n : int
        Number of classes.

    Returns
    -------
    Floats
        (n,) or (B, n).

    Notes
    -----
    Ledger: eq-u-digit-target corrected.
    """
    return (k[..., None] == np.arange(n)).astype(float)


def _outputs(name, a, given):
    a = finite_numbers(name, a)
    if a.ndim not in (1, 2) or not a.size:
        raise ValueError(f"{name}: got shape {a.shape}, must be (d,) or (B, d)")
    return a


def _desired(name, y, given):
    y, a = finite_numbers(name, y), given["a"]
    if a.shape != y.shape:
        raise ValueError(f"{name}: got shape {y.shape} with a of shape {a.shape}, must be both (d,) or both (B, d)")
    return y.astype(a.dtype, copy=False)


@checked(a=_outputs, y=_desired)
def quadratic_cost(a: ArrayLike, y: ArrayLike) -> float:
    """The cost C = 1/(2n) sum over the n samples of |y - a|^2.

    Parameters
    ----------
    a : ArrayLike
        (d,) for one sample or (B, d), outputs.
    y : ArrayLike
        Like a, what is wanted.

    Returns
    -------
    float
        The mean over the samples.

    Notes
    -----
    Ledger: eq-nn-25, ex-digit-cost.
    """
    return float(np.square(y - a).sum() / (2 * np.atleast_2d(a).shape[0]))  # eq-nn-25


@checked(a=_outputs, y=_desired)
def quadratic_gradient(a: ArrayLike, y: ArrayLike) -> Floats:
    """Derivative of `quadratic_cost` with respect to a: (a - y) / n.

    Parameters
    ----------
    a : ArrayLike
        (d,) for one sample or (B, d), outputs.
    y : ArrayLike
        Like a, what is wanted.

    Returns
    -------
    Floats
        Of a's shape.

    Notes
    -----
    Ledger: eq-nn-33, eq-nn-34.
    """
    return (a - y) / np.atleast_2d(a).shape[0]


def _classes(name, labels, given):
    logits = given["logits"]
    return check_labels(name, labels, logits.shape[-1], logits.shape[:-1])


@checked(logits=_outputs, labels=_classes)
def cross_entropy(logits: ArrayLike, labels: ArrayLike) -> float:
    """Mean of -log of the softmax probability that the logits give to the label.

    Parameters
    ----------
    logits : ArrayLike
        (K,) or (B, K), outputs of a linear layer.
    labels : ArrayLike
        A whole number below K, or (B,) of them.

    Returns
    -------
    float
        The mean over the samples.

    References
    ----------
    Goodfellow et al. (2016), section 6.2.2.3.

    Examples
    --------
    >>> from rlcore import cross_entropy
    >>> round(cross_entropy([0.0, 0.0], 1), 4)
    0.6931
    """
    return float(-np.atleast_2d(log_softmax.unchecked(logits))[np.arange(labels.size), labels].mean())


@checked(logits=_outputs, labels=_classes)
def cross_entropy_gradient(logits: ArrayLike, labels: ArrayLike) -> Floats:
    """Derivative of `cross_entropy` with respect to the logits: (softmax - one_hot) / n.

    Parameters
    ----------
    logits : ArrayLike
        (K,) or (B, K).
    labels : ArrayLike
        A whole number below K, or (B,) of them.

    Returns
    -------
    Floats
        Of the shape of the logits.
    """
    p = softmax.unchecked(logits)
    np.atleast_2d(p)[np.arange(labels.size), labels] -= 1
    return p / labels.size


COSTS = {  # name: (cost, its derivative with respect to the outputs)
    "quadratic": (quadratic_cost, quadratic_gradient),
    "cross_entropy": (cross_entropy, cross_entropy_gradient),
}


# ---------------------------------------------------------------------- steps, bumps, towers


def _slope(name, w, given):
    w = check_finite(name, w)
    if w == 0:
        raise ValueError(f"{name}: got {w!r}, must be a number other than 0: without a slope there is no step")
    return w


@checked(w=_slope, b=check_finite)
def step_position(w: ArrayLike, b: float) -> float:
    """Where sigma(w x + b) crosses 1/2: s = -b / w.

    Parameters
    ----------
    w : ArrayLike
        The weight, not 0.
    b : float
        The bias.

    Returns
    -------
    float
        s.

    Notes
    -----
    Ledger: eq-nn-24, fig-41, cl-090.
    """
    return -b / w  # eq-nn-24


@checked(x=finite, s=check_finite, w=_slope)
def step_neuron(x: ArrayLike, s: float, w: float = 1000.0) -> Floats:
    """A sigmoid neuron steep enough to be a step from 0 to 1 at s: sigma(w x + b) with b = -w s.

    Parameters
    ----------
    x : ArrayLike
        Any shape.
    s : float
        Where it steps.
    w : float
        The weight; a negative one steps down.

    Returns
    -------
    Floats
        Of x's shape.

    Notes
    -----
    Ledger: fig-40, fig-41.
    """
    return sigmoid(w * x - w * s)


@checked(x=finite, s1=check_finite, s2=check_finite, h=check_finite, w=_slope)
def bump(x: ArrayLike, s1: float, s2: float, h: float, w: float = 1000.0) -> Floats:
    """Two step neurons with output weights h and -h: about h between s1 and s2, about 0 elsewhere.

    Parameters
    ----------
    x : ArrayLike
        Any shape.
    s1 : float
        Where it begins.
    s2 : float
        Where it ends.
    h : float
        Its height.
    w : float
        Weight of the step neurons.

    Returns
    -------
    Floats
        Of x's shape.

    Notes
    -----
    Ledger: eq-u-bump, fig-44.
    """
    return h * step_neuron(x, s1, w) - h * step_neuron(x, s2, w)  # eq-u-bump


def _beside(name, y, given):
    y, x = finite(name, y), given["x"]
    if y.shape != x.shape:
        raise ValueError(f"{name}: got shape {y.shape}, must be that of x, {x.shape}")
    return y


@checked(x=finite, y=_beside, x_range=pair, y_range=pair, h=check_finite, w=_slope)
def tower(x: ArrayLike, y: ArrayLike, x_range: ArrayLike, y_range: ArrayLike, h: float, w: float = 1000.0) -> Floats:
    """About h inside the rectangle x_range x y_range, about 0 outside: bumps in two dimensions.

    A bump of height 1 along each axis; both together make 2, one alone 1, so that a step neuron at 3/2 fires inside
    only.

    Parameters
    ----------
    x : ArrayLike
        Any shape.
    y : ArrayLike
        Like x.
    x_range, y_range : ArrayLike
        A pair.
    h : float
        Its height.
    w : float
        Weight of the step neurons.

    Returns
    -------
    Floats
        Of x's shape.

    Notes
    -----
    Ledger: cl-083.

    References
    ----------
    Nielsen (2015), chapter 4.
    """
    both = bump(x, *x_range, 1.0, w) + bump(y, *y_range, 1.0, w)
    return h * step_neuron(both, 1.5, w)
