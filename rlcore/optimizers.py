"""Steps that lower a cost: gradient descent, momentum, Adam; each acts on one flat parameter vector (chapter 6)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rlcore.core.checks import check_finite, check_positive, is_number, show
from rlcore.core.rules import checked, function_of
from rlcore.core.samples import check_samples
from rlcore.core.types import ArrayLike, Floats, Network


def _decay(name, value, given):
    if not is_number(value) or not 0 <= value < 1:
        raise ValueError(f"{name}: got {show(value)}, must be a number in [0, 1)")
    return float(value)


class SGD:
    """Gradient descent, with momentum if wanted; stochastic if the gradient is that of a minibatch.

    update(theta, gradient) changes theta in place: v <- momentum v + gradient, theta <- theta - lr v. lr may be
    changed between updates.

    Parameters
    ----------
    lr : float
        Learning rate, above 0.
    momentum : float
        In [0, 1).

    Notes
    -----
    Ledger: om-sgd.

    References
    ----------
    Polyak (1964); Nielsen (2015), chapter 3.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import SGD
    >>> theta = np.array([1.0, 2.0])
    >>> SGD(0.1).update(theta, [1.0, 1.0])
    >>> theta
    array([0.9, 1.9])
    """

    @checked(momentum=_decay)
    def __init__(self, lr: float, momentum: float = 0.0) -> None:
        self.lr, self.momentum, self.v = lr, momentum, None

    def update(self, theta: Floats, gradient: ArrayLike) -> None:
        gradient = _check_gradient(theta, gradient, self.v)
        if self.momentum:
            self.v = gradient + (0.0 if self.v is None else self.momentum * self.v)
        theta -= self.lr * (self.v if self.momentum else gradient)  # eq-nn-27, eq-nn-28


GradientDescent = SGD


class Adam:
    """Steps scaled by running means of the gradient and of its square.

    update(theta, gradient) changes theta in place.

    Parameters
    ----------
    lr : float
        Learning rate, above 0.
    beta1 : float
        Decay of the mean of the gradient, in [0, 1).
    beta2 : float
        Decay of the mean of its square, in [0, 1).
    eps : float
        Added to the root of the latter, above 0.

    References
    ----------
    Kingma and Ba (2015), algorithm 1.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import Adam
    >>> theta = np.array([1.0, 2.0])
    >>> Adam(0.1).update(theta, [1.0, -3.0])
    >>> theta.round(6)
    array([0.9, 2.1])
    """

    @checked(beta1=_decay, beta2=_decay, eps=check_positive)
    def __init__(self, lr: float = 1e-3, beta1: float = 0.9, beta2: float = 0.999, eps: float = 1e-8) -> None:
        self.lr, self.beta1, self.beta2, self.eps, self.t = lr, beta1, beta2, eps, 0
        self.m = self.v = None

    def update(self, theta: Floats, gradient: ArrayLike) -> None:
        gradient = _check_gradient(theta, gradient, self.m)
        if self.m is None:
            self.m, self.v, self._work = np.zeros_like(theta), np.zeros_like(theta), np.empty_like(theta)
        m, v, work = self.m, self.v, self._work
        self.t += 1
        m += np.multiply(np.subtract(gradient, m, out=work), 1 - self.beta1, out=work)
        v *= self.beta2
        v += np.multiply(np.square(gradient, out=work), 1 - self.beta2, out=work)
        unbias = (1 - self.beta2**self.t) ** 0.5  # of sqrt(v), moved to the numbers beside it: one pass less
        np.sqrt(v, out=work)
        work += self.eps * unbias
        np.divide(m, work, out=work)
        work *= self.lr * unbias / (1 - self.beta1**self.t)
        theta -= work


def take_step(net: Network, gradient: ArrayLike) -> None:
    """One step of the network's optimizer, for `step` of MLP and TorchNet."""
    if net.optimizer is None:
        raise ValueError("optimizer: got None, step needs an SGD or Adam: give it to the network, or set net.optimizer")
    net.optimizer.update(net.theta, gradient)


def _check_gradient(theta, gradient, state):
    """gradient as an array of theta's shape and dtype."""
    if not isinstance(theta, np.ndarray) or theta.dtype.kind != "f":
        raise ValueError(f"theta: got {show(theta)}, must be an array of floats, which changes in place")
    gradient = check_samples("gradient", gradient, theta.dtype)
    if gradient.shape != theta.shape or (state is not None and state.shape != theta.shape):
        raise ValueError(f"gradient: got shape {gradient.shape}, must be that of theta, {theta.shape}, always")
    return gradient


@checked(gradient=function_of("a number"), v=check_finite, epsilon=check_finite)
def gradient_descent(gradient: Callable[[float], float], v: float, epsilon: float, n_steps: int) -> Floats:
    """The points v_0 ... v_n of v <- v - epsilon C'(v).

    On C(v) = L v^2 / 2 each step multiplies v by 1 - epsilon L: it converges for 0 < epsilon < 2 / L.

    Parameters
    ----------
    gradient : Callable[[float], float]
        C', a function of one number.
    v : float
        Where it starts.
    epsilon : float
        The learning rate; a negative one ascends.
    n_steps : int
        Number of steps.

    Returns
    -------
    Floats
        (n_steps + 1,).

    Notes
    -----
    Ledger: fig-11, ex-learning-rate.

    Examples
    --------
    >>> from rlcore import gradient_descent
    >>> gradient_descent(lambda v: 2 * v, 1.0, 0.25, 3)
    array([1.   , 0.5  , 0.25 , 0.125])
    """
    history = [v]
    for _ in range(n_steps):
        history.append(history[-1] - epsilon * gradient(history[-1]))
    return np.array(history)
