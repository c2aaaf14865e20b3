"""A neural network on one parameter vector: forward, backward, trained, and made by hand (chapter 6)."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from rlcore.core.checks import (
    LARGEST,
    check_count,
    check_function,
    check_nonnegative,
    check_positive,
    check_rng,
    finite,
    show,
)
from rlcore.core.rules import anything, check_dtype, checked, choice, count, function_of
from rlcore.core.samples import all_finite, as_samples, check_labels, check_samples, finite_numbers, pair
from rlcore.core.types import ArrayLike, Floats, Given, Network, Optimizer, Rng
from rlcore.neurons import ACTIVATIONS, COSTS
from rlcore.optimizers import take_step

INITIAL = {  # name: standard deviation of the weights of a layer with n_in inputs and n_out neurons
    "xavier": lambda n_in, n_out: np.sqrt(2 / (n_in + n_out)),
    "he": lambda n_in, n_out: np.sqrt(2 / n_in),
    "unit": lambda n_in, n_out: 1.0,
    "zeros": lambda n_in, n_out: 0.0,
}


def _sizes(name, sizes, given):
    if not isinstance(sizes, (tuple, list, np.ndarray)) or np.ndim(sizes[0] if len(sizes) else 0) or len(sizes) < 2:
        raise ValueError(f"{name}: got {show(sizes)}, must be two numbers of neurons or more, inputs first")
    sizes = [check_count(name, n) for n in sizes]
    if _n_parameters(sizes) > LARGEST:
        raise ValueError(f"{name}: got {show(sizes)}, must make at most {LARGEST:,} parameters")
    return sizes


def _n_parameters(sizes):
    return sum((m + 1) * n for m, n in zip(sizes, sizes[1:]))


def _rng(name, rng, given):
    return None if given["init"] == "zeros" and rng is None else check_rng(rng)


class MLP:
    """A multilayer perceptron: every neuron of a layer sees every one of the layer before.

    theta: (P,), all parameters, layer by layer, weights before biases; weights[l] (n_out, n_in) and biases[l] (n_out,)
    are views of it. Biases start at 0.

    Parameters
    ----------
    sizes : Sequence[int]
        Neurons of each layer, inputs first: [784, 16, 16, 10].
    hidden, output : str
        Name of ACTIVATIONS.
    optimizer : Optimizer | None
        What `step` uses, an SGD or Adam of its own.
    init : str
        Normal weights of standard deviation sqrt(2 / (n_in + n_out)) "xavier", sqrt(2 / n_in) "he", 1 "unit", or
        "zeros", which needs no rng (None).
    dtype : DTypeLike
        numpy.float32 or numpy.float64.
    rng : Rng | None
        Source of all that is random.

    Notes
    -----
    Ledger: alg-mlp-forward, fig-30.

    References
    ----------
    Nielsen (2015), chapters 1 and 2; Glorot and Bengio (2010); He et al. (2015).

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import MLP
    >>> net = MLP([2, 8, 1], rng=np.random.default_rng(0))
    >>> net.n_parameters, net.forward([0.5, -1.0]).shape
    (33, (1,))
    """

    @checked(sizes=_sizes, hidden=choice(*ACTIVATIONS), output=choice(*ACTIVATIONS), init=choice(*INITIAL), rng=_rng)
    def __init__(
        self, sizes: Sequence[int], *, hidden: str = "tanh", output: str = "linear", optimizer: Optimizer | None = None,
        init: str = "xavier", dtype: DTypeLike = np.float32, rng: Rng | None,
    ) -> None:  # fmt: skip
        self.sizes, self.hidden, self.output, self.optimizer = sizes, hidden, output, optimizer
        self.theta = np.zeros(_n_parameters(sizes), dtype)
        self._view()
        for w in self.weights if init != "zeros" else ():
            w[:] = INITIAL[init](*w.shape[::-1]) * rng.standard_normal(w.shape)

    def _view(self):
        self.weights, self.biases = _layers(self.theta, self.sizes)
        names = [self.hidden] * (len(self.weights) - 1) + [self.output]
        self._sigma, self._slope = zip(*(ACTIVATIONS[name] for name in names))
        self.zs, self.activations, self.deltas = [], [], []

    @property
    def n_parameters(self) -> int:
        return self.theta.size

    def forward(self, x: ArrayLike) -> Floats:
        """Outputs for one sample or a batch. eq-nn-29, eq-nn-30, eq-nn-31

        x: (n_0,) or (B, n_0). Returns (n_L,) or (B, n_L). Keeps activations[l], a^l with a^0 = x, and zs[l], the
        weighted inputs of layer l + 1, until the next call.
        """
        a = as_samples("x", x, self.theta.dtype)
        if a.ndim not in (1, 2) or a.shape[-1] != self.sizes[0] or not a.size:
            raise ValueError(f"x: got shape {a.shape}, must be ({self.sizes[0]},) or (B, {self.sizes[0]})")
        self.zs, self.activations = [], [a]
        for w, b, sigma in zip(self.weights, self.biases, self._sigma):
            z = a.dot(w.T)  # eq-nn-30, a sample a row
            z += b
            a = sigma(z)  # eq-nn-31
            self.zs.append(z)
            self.activations.append(a)
        if not all_finite(a):
            self._complain(x)
        return a

    def _complain(self, x):
        """ValueError about outputs that are not finite: because of x, or because steps were too large."""
        check_samples("x", x, self.theta.dtype)
        raise ValueError("theta: gives outputs that are not finite, must be smaller; take smaller steps (lr, alpha)")

    def backward(self, d_outputs: ArrayLike) -> Floats:
        """Gradient of the cost with respect to theta, summed over the samples of the last `forward`. alg-backprop

        d_outputs: dJ/da^L, of the outputs' shape. Returns (P,), ordered as theta. Keeps deltas[l], dJ/dz of layer
        l + 1. Source: Rumelhart, Hinton and Williams (1986); Nielsen (2015), chapter 2.
        """
        d_outputs, a, z = check_samples("d_outputs", d_outputs, self.theta.dtype), self.activations, self.zs
        if not a or d_outputs.shape != a[-1].shape:
            expected = a[-1].shape if a else "that of a forward pass, and there was none"
            raise ValueError(f"d_outputs: got shape {d_outputs.shape}, must be {expected}")
        gradient = np.empty_like(self.theta)
        d_weights, d_biases = _layers(gradient, self.sizes)
        self.deltas = deltas = [None] * len(z)
        deltas[-1] = d_outputs * self._slope[-1](z[-1], a[-1])  # eq-nn-34
        for l in reversed(range(len(z) - 1)):
            deltas[l] = deltas[l + 1].dot(self.weights[l + 1]) * self._slope[l](z[l], a[l + 1])  # eq-nn-35
        for l, delta in enumerate(deltas):
            if delta.ndim == 1:
                d_biases[l][:] = delta  # eq-nn-36
                np.multiply(delta[:, None], a[l], out=d_weights[l])  # eq-nn-37
            else:  # the same, summed over the samples
                np.add.reduce(delta, axis=0, out=d_biases[l])
                np.dot(delta.T, a[l], out=d_weights[l])
        return gradient

    def jvp(self, v: ArrayLike) -> Floats:
        """Change of the last `forward`'s outputs for a small change v (P,) of theta, divided by its size.

        Forward mode: beside each layer's activation goes its derivative. Source: Pearlmutter (1994).
        """
        v = check_samples("v", v, self.theta.dtype)
        if v.shape != self.theta.shape or not self.zs:
            raise ValueError(f"v: got shape {v.shape}, must be {self.theta.shape}, after a forward pass")
        da = np.zeros_like(self.activations[0])
        for l, (dw, db) in enumerate(zip(*_layers(v, self.sizes))):
            a, z = self.activations[l], self.zs[l]
            dz = da @ self.weights[l].T + a @ dw.T + db
            da = dz * self._slope[l](z, self.activations[l + 1])
        return da

    def step(self, gradient: ArrayLike) -> None:
        """One step of the optimizer, theta changed in place."""
        take_step(self, gradient)

    def copy(self, dtype: DTypeLike | None = None) -> MLP:
        """An independent copy, in another precision if dtype says so."""
        twin = copy.copy(self)
        twin.theta = self.theta.astype(self.theta.dtype if dtype is None else check_dtype("dtype", dtype))
        twin.optimizer = copy.deepcopy(self.optimizer) if dtype is None else None
        twin._view()
        return twin

    def __getstate__(self) -> dict[str, Any]:  # pickled and deep-copied without views, which would part from theta
        return {name: getattr(self, name) for name in ("sizes", "hidden", "output", "optimizer", "theta")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._view()


def _layers(theta, sizes):
    """Weights and biases of each layer, as views of theta."""
    weights, biases, i = [], [], 0
    for m, n in zip(sizes, sizes[1:]):
        weights.append(theta[i : i + m * n].reshape(n, m))
        biases.append(theta[i + m * n : i + m * n + n])
        i += m * n + n
    return weights, biases


def network(name: str, net: Any, given: Given) -> Network:
    """The rule of an MLP or a TorchNet."""
    if not all(hasattr(net, part) for part in ("forward", "backward", "step", "theta")):
        raise ValueError(f"{name}: got {type(net).__name__}, must be an MLP or a TorchNet")
    return net


def _samples(*dimensions):
    def rule(name, x, given):
        x = finite_numbers(name, x)
        if x.ndim not in dimensions or not x.size:
            raise ValueError(f"{name}: got shape {x.shape}, must be {'(d,) or ' * (1 in dimensions)}(B, d)")
        return x

    return rule


def _answers(name, y, given):
    """The rule of what a network is to answer, in the dtype that it has: as many as there are samples."""
    numbers, y, x = finite(name, y), np.asarray(y), given["x"]
    y = numbers if y.dtype.kind == "O" else y
    if x.ndim == 2 and y.shape[:1] != x.shape[:1]:
        raise ValueError(f"{name}: got shape {y.shape} with x of shape {x.shape}, must be as many samples")
    return y


LEARNING = dict(net=network, y=_answers, cost=choice(*COSTS))


@checked(**LEARNING, x=_samples(1, 2))
def backprop(net: Network, x: ArrayLike, y: ArrayLike, cost: str = "quadratic") -> tuple[float, Floats]:
    """Cost and its gradient, the mean over the samples where there are several.

    The errors of each layer are in net.deltas afterwards.

    Parameters
    ----------
    net : Network
        MLP or TorchNet.
    x : ArrayLike
        (d,) or (B, d).
    y : ArrayLike
        Desired outputs, or the labels of cost "cross_entropy".
    cost : str
        "quadratic" or "cross_entropy".

    Returns
    -------
    tuple[float, Floats]
        The cost, and its gradient (P,).

    Notes
    -----
    Ledger: alg-backprop, eq-nn-26, cl-097, eq-nn-32.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import MLP, backprop
    >>> cost, gradient = backprop(MLP([2, 8, 1], rng=np.random.default_rng(0)), [0.5, -1.0], [0.0])
    >>> gradient.shape
    (33,)
    """
    return _backprop(net, x, y, cost)


def _backprop(net, x, y, cost):
    outputs, (C, dC) = net.forward(x), COSTS[cost]
    y = _fit(y, outputs, cost)
    return C.unchecked(outputs, y), net.backward(dC.unchecked(outputs, y))


def _fit(y, outputs, cost):
    """y, where it is what the cost compares with the outputs."""
    if cost == "cross_entropy":
        return check_labels("y", y, outputs.shape[-1], outputs.shape[:-1])
    if y.shape != outputs.shape:
        raise ValueError(f"y: got shape {y.shape}, must be {outputs.shape}, that of the outputs")
    return y.astype(outputs.dtype, copy=False)


@checked(**LEARNING, x=_samples(1, 2), h=check_positive)
def gradient_check(net: MLP, x: ArrayLike, y: ArrayLike, cost: str = "quadratic", h: float = 1e-6) -> float:
    """Largest relative error of backprop's gradient against central differences, both in float64.

    Relative to the parameter's own derivative, or to a hundredth of the largest one where that is more. Needs two
    forward passes a parameter.

    Parameters
    ----------
    net : MLP
        The network.
    x : ArrayLike
        (d,) or (B, d).
    y : ArrayLike
        Desired outputs, or the labels of cost "cross_entropy".
    cost : str
        "quadratic" or "cross_entropy".
    h : float
        Change of each parameter.

    Returns
    -------
    float
        The largest relative error.

    Notes
    -----
    Ledger: alg-backprop.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import MLP, gradient_check
    >>> gradient_check(MLP([2, 8, 1], rng=np.random.default_rng(0)), [0.5, -1.0], [0.0]) < 1e-6
    True
    """
    net, C = net.copy(np.float64), COSTS[cost][0].unchecked
    gradient, numeric = _backprop(net, x, y, cost)[1], np.zeros(net.theta.size)
    for k, value in enumerate(net.theta.copy()):
        net.theta[k] = value + h
        above = C(net.forward(x), y)
        net.theta[k] = value - h
        numeric[k] = (above - C(net.forward(x), y)) / (2 * h)
        net.theta[k] = value
    scale = np.maximum(np.abs(gradient), np.abs(numeric))
    return float(np.max(np.abs(gradient - numeric) / np.maximum(scale, max(1e-2 * scale.max(), 1e-300))))


def _batch(name, batch, given):
    return len(given["x"]) if batch is None else check_count(name, batch)


@checked(**LEARNING, x=_samples(2), batch=_batch, epochs=count(), on_epoch=function_of("(epoch, cost)"))
def sgd(
    net: Network, x: ArrayLike, y: ArrayLike, *, optimizer: Optimizer | None = None, batch: int | None, epochs: int,
    cost: str = "quadratic", on_epoch: Callable[[int, float], object] | None = None, rng: Rng,
) -> Floats:  # fmt: skip
    """Train on minibatches drawn without replacement, anew in each epoch.

    Parameters
    ----------
    net : Network
        MLP or TorchNet.
    x : ArrayLike
        (n, d).
    y : ArrayLike
        (n, k), or labels (n,) for cost "cross_entropy".
    optimizer : Optimizer | None
        None for the net's own.
    batch : int | None
        Samples in a step; None takes all.
    epochs : int
        Passes over the samples.
    cost : str
        "quadratic" or "cross_entropy".
    on_epoch : Callable[[int, float], object] | None
        Called as on_epoch(epoch, cost) after each, counted from 1.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Floats
        (epochs,): the cost of each epoch, averaged over its minibatches before their step.

    Raises
    ------
    ValueError
        Where the cost becomes infinite, for smaller steps are needed.

    Notes
    -----
    Ledger: alg-sgd, om-sgd, fig-47.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import MLP, SGD, sgd
    >>> rng = np.random.default_rng(0)
    >>> x, net = rng.standard_normal((100, 2)), MLP([2, 8, 1], optimizer=SGD(0.1), rng=rng)
    >>> costs = sgd(net, x, x[:, :1], batch=10, epochs=20, rng=rng)
    >>> bool(costs[-1] < costs[0] / 10)
    True
    """
    net.optimizer = optimizer or net.optimizer
    x, history = x.astype(net.theta.dtype, copy=False), np.zeros(epochs)
    for epoch in range(epochs):
        order = rng.permutation(len(x))
        for i in range(0, len(x), batch):
            chosen = order[i : i + batch]
            mean, gradient = _backprop(net, x[chosen], y[chosen], cost)
            if not isfinite(mean):
                raise ValueError(f"optimizer: the cost of epoch {epoch + 1} is {mean}, must stay finite: smaller steps")
            net.step(gradient)
            history[epoch] += mean * len(chosen) / len(x)
        if on_epoch is not None:
            on_epoch(epoch + 1, history[epoch])
    return history


# ---------------------------------------------------------------------- approximation by hand


def _interval(name, ends, given):
    low, high = pair(name, ends)
    if not low < high:
        raise ValueError(f"{name}: got {ends!r}, must be two finite numbers, the lower first")
    return low, high


def _heights(name, heights, given):
    """The rule of what makes the heights of n bumps: a name, which needs f, or (n,) numbers."""
    n = given["n"]
    if isinstance(heights, str) and heights in ("centre", "mid-range"):
        check_function("f", given["f"], "an array")
        return heights
    if isinstance(heights, str):
        raise ValueError(f'{name}: got {heights!r}, allowed are "centre", "mid-range" and ({n},) numbers')
    h = finite(name, heights)
    if h.shape != (n,):
        raise ValueError(f"{name}: got shape {h.shape}, must be ({n},)")
    return h


@checked(f=anything, interval=_interval, w=check_positive, heights=_heights, ends=check_nonnegative)
def step_bump_network(
    f: Callable[[Floats], ArrayLike], n: int, *, interval: tuple[float, float] = (0.0, 1.0), w: float = 1000.0,
    heights: str | ArrayLike = "centre", ends: float = 0.05,
) -> MLP:  # fmt: skip
    """A network of 2n sigmoid neurons and a linear output that is n bumps beside each other.

    Parameters
    ----------
    f : Callable[[Floats], ArrayLike]
        The function to approximate, of an array.
    n : int
        Number of bumps.
    interval : tuple[float, float]
        Where f is approximated.
    w : float
        Weight of every hidden neuron.
    heights : str | ArrayLike
        f at the "centre" of each bump, the "mid-range" of f over it, or (n,) numbers.
    ends : float
        The first and the last step stand outside the interval, by this part of its length: with 0 the network has half
        the height there.

    Returns
    -------
    MLP
        An MLP [1, 2n, 1] in float64; its hidden neurons come in pairs, left and right step of each bump.

    Notes
    -----
    Ledger: alg-step-network, fig-46, cl-091, cl-092, om-uat-statement.

    References
    ----------
    Nielsen (2015), chapter 4.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import step_bump_network
    >>> net = step_bump_network(np.square, 100)
    >>> bool(abs(net.forward([0.5])[0] - 0.25) < 0.01)
    True
    """
    (low, high), h = interval, heights
    edges = np.linspace(low, high, n + 1)
    if isinstance(heights, str):
        values = _values(f, np.linspace(edges[:-1], edges[1:], 201, axis=1))
        h = values[:, 100] if heights == "centre" else (values.min(axis=1) + values.max(axis=1)) / 2
    edges[[0, -1]] += ends * (high - low) * np.array([-1, 1])
    net = MLP([1, 2 * n, 1], hidden="sigmoid", init="zeros", dtype=np.float64, rng=None)
    net.weights[0][:] = w
    net.biases[0][:] = -w * np.column_stack((edges[:-1], edges[1:])).ravel()  # eq-nn-24
    net.weights[1][0] = np.column_stack((h, -h)).ravel()  # eq-u-bump
    return net


def _values(f, x):
    """f(x), numbers in x's shape."""
    y = finite("f", f(x))
    if y.shape not in ((), x.shape):
        raise ValueError(f"f: gives shape {y.shape} for x of shape {x.shape}, must give as many numbers")
    return np.broadcast_to(y, x.shape)


def check_network(name: str, net: Any, n_in: int, n_out: int) -> None:
    """ValueError unless net is an MLP or TorchNet with an optimizer, from n_in numbers to n_out."""
    if getattr(network(name, net, None), "optimizer", None) is None:
        raise ValueError(f"{name}: has no optimizer, needs one such as Adam(0.01)")
    try:
        shape = np.shape(net.forward(np.zeros((2, n_in))))
    except Exception as error:
        raise ValueError(f"{name}: does not take observations of {n_in} numbers, as it must: {error}") from None
    if shape != (2, n_out):
        raise ValueError(f"{name}: got {shape[-1:]} outputs, must be {n_out}")
    return net
