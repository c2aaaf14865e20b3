"""A neural network on one parameter vector: forward, backpropagation, optimisers, and a twin in torch (chapter 6)."""

import copy

import numpy as np

from rlcore.core.checks import as_floats, check_count, check_function, check_positive, check_rng
from rlcore.neurons import ACTIVATIONS, COSTS, check_dtype, check_name
from rlcore.optimizers import check_optimizer, take_step

INITIAL = {  # name: standard deviation of the weights of a layer with n_in inputs and n_out neurons
    "xavier": lambda n_in, n_out: np.sqrt(2 / (n_in + n_out)),
    "he": lambda n_in, n_out: np.sqrt(2 / n_in),
    "unit": lambda n_in, n_out: 1.0,
    "zeros": lambda n_in, n_out: 0.0,
}


class MLP:
    """A multilayer perceptron: every neuron of a layer sees every one of the layer before. alg-mlp-forward, fig-30

    sizes: neurons of each layer, inputs first: [784, 16, 16, 10]. hidden, output: names of ACTIVATIONS. optimizer: what
    `step` uses, an SGD or Adam of its own. init: normal weights of standard deviation sqrt(2 / (n_in + n_out))
    "xavier", sqrt(2 / n_in) "he", 1 "unit", or "zeros", which needs no rng (None). Biases start at 0.
    theta: (P,), all parameters, layer by layer, weights before biases; weights[l] (n_out, n_in) and biases[l] (n_out,)
    are views of it. Source: Nielsen (2015), chapters 1 and 2; Glorot and Bengio (2010); He et al. (2015).
    """

    def __init__(self, sizes, *, hidden="tanh", output="linear", optimizer=None, init="xavier", dtype=np.float32, rng):
        if np.ndim(sizes) != 1 or len(sizes) < 2:
            raise ValueError(f"sizes: got {sizes!r}, must be two numbers of neurons or more, inputs first")
        self.sizes = [check_count("sizes", n) for n in sizes]
        check_name("hidden", hidden, ACTIVATIONS), check_name("output", output, ACTIVATIONS)
        deviation = check_name("init", init, INITIAL)
        self.hidden, self.output, self.optimizer = hidden, output, check_optimizer(optimizer)
        self.theta = np.zeros(sum((m + 1) * n for m, n in zip(self.sizes, self.sizes[1:])), check_dtype(dtype))
        self._view()
        if init != "zeros":
            check_rng(rng)
            for w in self.weights:
                w[:] = deviation(*w.shape[::-1]) * rng.standard_normal(w.shape)

    def _view(self):
        self.weights, self.biases = _layers(self.theta, self.sizes)
        names = [self.hidden] * (len(self.weights) - 1) + [self.output]
        self._sigma, self._slope = zip(*(ACTIVATIONS[name] for name in names))
        self.zs, self.activations, self.deltas = [], [], []

    @property
    def n_parameters(self):
        return self.theta.size

    def forward(self, x):
        """Outputs for one sample or a batch. eq-nn-29, eq-nn-30, eq-nn-31

        x: (n_0,) or (B, n_0). Returns (n_L,) or (B, n_L). Keeps activations[l], a^l with a^0 = x, and zs[l], the
        weighted inputs of layer l + 1, until the next call.
        """
        a = np.asarray(x, self.theta.dtype)
        if a.ndim not in (1, 2) or a.shape[-1] != self.sizes[0] or not a.size:
            raise ValueError(f"x: got shape {a.shape}, must be ({self.sizes[0]},) or (B, {self.sizes[0]})")
        self.zs, self.activations = [], [a]
        for w, b, sigma in zip(self.weights, self.biases, self._sigma):
            z = a @ w.T  # eq-nn-30, a sample a row
            z += b
            a = sigma(z)  # eq-nn-31
            self.zs.append(z)
            self.activations.append(a)
        return a

    def backward(self, d_outputs):
        """Gradient of the cost with respect to theta, summed over the samples of the last `forward`. alg-backprop

        d_outputs: dJ/da^L, of the outputs' shape. Returns (P,), ordered as theta. Keeps deltas[l], dJ/dz of layer
        l + 1. Source: Rumelhart, Hinton and Williams (1986); Nielsen (2015), chapter 2.
        """
        d_outputs, a, z = np.asarray(d_outputs, self.theta.dtype), self.activations, self.zs
        if not a or d_outputs.shape != a[-1].shape:
            expected = a[-1].shape if a else "that of a forward pass, and there was none"
            raise ValueError(f"d_outputs: got shape {d_outputs.shape}, must be {expected}")
        gradient = np.empty_like(self.theta)
        d_weights, d_biases = _layers(gradient, self.sizes)
        self.deltas = deltas = [None] * len(z)
        deltas[-1] = d_outputs * self._slope[-1](z[-1], a[-1])  # eq-nn-34
        for l in reversed(range(len(z) - 1)):
            deltas[l] = deltas[l + 1] @ self.weights[l + 1] * self._slope[l](z[l], a[l + 1])  # eq-nn-35
        for l, delta in enumerate(deltas):
            if delta.ndim == 1:
                d_biases[l][:] = delta  # eq-nn-36
                d_weights[l][:] = np.outer(delta, a[l])  # eq-nn-37
            else:  # the same, summed over the samples
                np.add.reduce(delta, axis=0, out=d_biases[l])
                np.matmul(delta.T, a[l], out=d_weights[l])
        return gradient

    def jvp(self, v):
        """Change of the last `forward`'s outputs for a small change v (P,) of theta, divided by its size.

        Forward mode: beside each layer's activation goes its derivative. Source: Pearlmutter (1994).
        """
        v = np.asarray(v, self.theta.dtype)
        if v.shape != self.theta.shape or not self.zs:
            raise ValueError(f"v: got shape {v.shape}, must be {self.theta.shape}, after a forward pass")
        da = np.zeros_like(self.activations[0])
        for l, (dw, db) in enumerate(zip(*_layers(v, self.sizes))):
            a, z = self.activations[l], self.zs[l]
            dz = da @ self.weights[l].T + a @ dw.T + db
            da = dz * self._slope[l](z, self.activations[l + 1])
        return da

    def step(self, gradient):
        """One step of the optimizer, theta changed in place."""
        take_step(self, gradient)

    def copy(self, dtype=None):
        """An independent copy, in another precision if dtype says so."""
        twin = copy.copy(self)
        twin.theta = self.theta.astype(self.theta.dtype if dtype is None else check_dtype(dtype))
        twin.optimizer = copy.deepcopy(self.optimizer) if dtype is None else None
        twin._view()
        return twin

    def __getstate__(self):  # pickled and deep-copied without views, which would part from theta
        return {name: getattr(self, name) for name in ("sizes", "hidden", "output", "optimizer", "theta")}

    def __setstate__(self, state):
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


def backprop(net, x, y, cost="quadratic"):
    """Cost and its gradient, the mean over the samples where there are several. alg-backprop, eq-nn-26, cl-097

    net: MLP or TorchNet. x: (d,) or (B, d). y: desired outputs, or the labels of cost "cross_entropy".
    Returns a number and (P,). The errors of each layer are in net.deltas afterwards. eq-nn-32
    """
    return _backprop(net, _check_finite("x", x), _check_finite("y", y), *check_name("cost", cost, COSTS))


def _backprop(net, x, y, C, dC):
    outputs = net.forward(x)
    return C(outputs, y), net.backward(dC(outputs, y))


def gradient_check(net, x, y, cost="quadratic", h=1e-6):
    """Largest relative error of backprop's gradient against central differences, both in float64. alg-backprop

    Relative to the parameter's own derivative, or to a hundredth of the largest one where that is more. Arguments as
    for `backprop`. h: change of each parameter. Needs two forward passes a parameter.
    """
    check_positive("h", h)
    net = net.copy(np.float64)
    C = check_name("cost", cost, COSTS)[0]
    gradient, numeric = backprop(net, x, y, cost)[1], np.zeros(net.theta.size)
    for k, value in enumerate(net.theta.copy()):
        net.theta[k] = value + h
        above = C(net.forward(x), y)
        net.theta[k] = value - h
        numeric[k] = (above - C(net.forward(x), y)) / (2 * h)
        net.theta[k] = value
    scale = np.maximum(np.abs(gradient), np.abs(numeric))
    return float(np.max(np.abs(gradient - numeric) / np.maximum(scale, max(1e-2 * scale.max(), 1e-300))))


def sgd(net, x, y, *, optimizer=None, batch, epochs, cost="quadratic", on_epoch=None, rng):
    """Train on minibatches drawn without replacement, anew in each epoch. alg-sgd, om-sgd, fig-47

    net: MLP or TorchNet. x: (n, d). y: (n, k), or labels (n,) for cost "cross_entropy". optimizer: None for the net's
    own. batch: samples in a step; None takes all. on_epoch(epoch, cost): called after each, counted from 1.
    Returns (epochs,): the cost of each epoch, averaged over its minibatches before their step.
    """
    x, y, epochs = _check_finite("x", x), _check_finite("y", y), check_count("epochs", epochs)
    if x.ndim != 2 or len(x) == 0 or len(x) != len(np.atleast_1d(y)):
        raise ValueError(f"x: got shape {x.shape} with y of shape {y.shape}, must be as many samples, one at least")
    batch, rng = len(x) if batch is None else check_count("batch", batch), check_rng(rng)
    net.optimizer = check_optimizer(optimizer) or net.optimizer
    if on_epoch is not None:
        check_function("on_epoch", on_epoch, "(epoch, cost)")
    (C, dC), x, history = check_name("cost", cost, COSTS), np.asarray(x, net.theta.dtype), np.zeros(epochs)
    for epoch in range(epochs):
        order = rng.permutation(len(x))
        for i in range(0, len(x), batch):
            chosen = order[i : i + batch]
            mean, gradient = _backprop(net, x[chosen], y[chosen], C, dC)
            net.step(gradient)
            history[epoch] += mean * len(chosen) / len(x)
        if on_epoch is not None:
            on_epoch(epoch + 1, history[epoch])
    return history


# ---------------------------------------------------------------------- approximation by hand


def step_bump_network(f, n, *, interval=(0.0, 1.0), w=1000.0, heights="centre", ends=0.05):
    """A network of 2n sigmoid neurons and a linear output that is n bumps beside each other. alg-step-network, fig-46

    f: the function to approximate, of an array. heights: f at the "centre" of each bump, the "mid-range" of f over it,
    or (n,) numbers. w: weight of every hidden neuron. ends: the first and the last step stand outside the interval, by
    this part of its length: with 0 the network has half the height there. Returns an MLP [1, 2n, 1] in float64; its
    hidden neurons come in pairs, left and right step of each bump. cl-091, cl-092, om-uat-statement
    Source: Nielsen (2015), chapter 4.
    """
    (low, high), n = interval, check_count("n", n)
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ValueError(f"interval: got {interval!r}, must be two finite numbers, the lower first")
    if ends < 0:
        raise ValueError(f"ends: got {ends!r}, must be 0 or more")
    edges = np.linspace(low, high, n + 1)
    if isinstance(heights, str):
        if heights not in ("centre", "mid-range"):
            raise ValueError(f'heights: got {heights!r}, allowed are "centre", "mid-range" and ({n},) numbers')
        inside = np.linspace(edges[:-1], edges[1:], 201, axis=1)
        values = check_function("f", f, "an array")(inside)
        heights = values[:, 100] if heights == "centre" else (values.min(axis=1) + values.max(axis=1)) / 2
    h = as_floats("heights", heights)
    if h.shape != (n,):
        raise ValueError(f"heights: got shape {h.shape}, must be ({n},)")
    edges[[0, -1]] += ends * (high - low) * np.array([-1, 1])
    net = MLP([1, 2 * n, 1], hidden="sigmoid", init="zeros", dtype=np.float64, rng=None)
    net.weights[0][:] = check_positive("w", w)
    net.biases[0][:] = -w * np.column_stack((edges[:-1], edges[1:])).ravel()  # eq-nn-24
    net.weights[1][0] = np.column_stack((h, -h)).ravel()  # eq-u-bump
    return net


def check_network(name, net, n_in, n_out):
    """ValueError unless net is an MLP or TorchNet with an optimizer, from n_in numbers to n_out."""
    if not all(hasattr(net, part) for part in ("forward", "backward", "step", "theta")):
        raise ValueError(f"{name}: got {type(net).__name__}, must be an MLP or a TorchNet")
    if getattr(net, "optimizer", None) is None:
        raise ValueError(f"{name}: has no optimizer, needs one such as Adam(0.01)")
    try:
        shape = np.shape(net.forward(np.zeros((2, n_in))))
    except Exception as error:
        raise ValueError(f"{name}: does not take observations of {n_in} numbers ({error})") from None
    if shape != (2, n_out):
        raise ValueError(f"{name}: got {shape[-1:]} outputs, must be {n_out}")
    return net


def _check_finite(name, x):
    """x as an array of numbers, none of them NaN or infinite, in the precision that it has."""
    if not np.isfinite(as_floats(name, x)).all():
        raise ValueError(f"{name}: contains NaN or infinity, must be finite numbers")
    return np.asarray(x)
