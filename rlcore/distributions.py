"""Policies as distributions over a network's outputs, with the gradients that learning needs (chapters 7 and 8)."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import e, log, pi

import numpy as np

from rlcore.core.checks import check_rng, show
from rlcore.core.samples import check_labels, check_samples
from rlcore.core.sampling import cumulative
from rlcore.core.types import ArrayLike, Floats, Ints, Rng
from rlcore.neurons import log_softmax


@dataclass(frozen=True, eq=False)
class Categorical:
    """Softmax over A actions; every method treats each row of the batch alone.

    Gradients are with respect to the logits, (B, A).

    Parameters
    ----------
    logits : np.ndarray
        (B, A), or (A,) for one state; their dtype is kept.

    Notes
    -----
    Ledger: om-softmax, alg-softmax-policy.

    References
    ----------
    Sutton and Barto (2018), (13.2).

    Examples
    --------
    >>> from rlcore import Categorical
    >>> Categorical([0.0, 0.0]).probs
    array([0.5, 0.5])
    """

    logits: np.ndarray
    log_probs: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        logits = _outputs("logits", self.logits)
        object.__setattr__(self, "logits", logits)
        object.__setattr__(self, "log_probs", log_softmax.unchecked(logits))

    @property
    def probs(self) -> Floats:
        """pi(.|s), (B, A)."""
        return np.exp(self.log_probs)

    def sample(self, rng: Rng) -> Ints:
        """One action a row, (B,) integers."""
        u = check_rng(rng).random(self.logits.shape[:-1])
        return (cumulative(self.probs) <= u[..., None]).sum(axis=-1)

    def log_prob(self, a: ArrayLike) -> Floats:
        """ln pi(a|s), (B,). a: (B,) integers."""
        a = self._actions(a)
        return self.log_probs.reshape(-1, self.logits.shape[-1])[np.arange(a.size), a.ravel()].reshape(a.shape)

    def entropy(self) -> Floats:
        """-sum over a of pi(a|s) ln pi(a|s), (B,)."""
        return -(self.probs * self.log_probs).sum(axis=-1)

    def kl(self, other: Categorical) -> Floats:
        """KL(self, other) = sum over a of pi(a|s) ln(pi(a|s) / other(a|s)), (B,)."""
        return (self.probs * (self.log_probs - _same(self, other).log_probs)).sum(axis=-1)

    def grad_log_prob(self, a: ArrayLike) -> Floats:
        """The score, gradient of ln pi(a|s). om-score, alg-softmax-policy"""
        return np.eye(self.logits.shape[-1], dtype=self.logits.dtype)[self._actions(a)] - self.probs  # om-score

    def grad_entropy(self) -> Floats:
        """Gradient of the entropy."""
        return -self.probs * (self.log_probs + self.entropy()[..., None])

    def grad_kl(self, other: Categorical) -> Floats:
        """Gradient of KL(self, other) with respect to the logits of `other`: in chapter 8 that is the new policy."""
        return _same(self, other).probs - self.probs

    def take(self, rows: ArrayLike) -> Categorical:
        """The policy in some of the states, by their numbers."""
        return Categorical(self.logits[_rows(rows, self.logits)])

    def fisher(self, d_logits: ArrayLike) -> Floats:
        """Fisher information of the logits times a change of them, (B, A): second derivative of KL(self, .) at self."""
        p, d_logits = self.probs, _like("d_logits", d_logits, self.logits)
        return p * (d_logits - (p * d_logits).sum(axis=-1, keepdims=True))

    def _actions(self, a):
        *shape, A = self.logits.shape
        return check_labels("a", a, A, tuple(shape), "integers; continuous actions need a Gaussian")


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Normal distribution over d continuous actions that do not depend on each other; each row of the batch alone.

    Gradients are pairs, with respect to (mean, log_std), each of mean's shape: where log_std is shared, sum them over
    the batch.

    Parameters
    ----------
    mean : np.ndarray
        (B, d), or (d,) for one state.
    log_std : np.ndarray
        (d,) for one spread in all states, or the shape of mean.

    References
    ----------
    Sutton and Barto (2018), section 13.7; Williams (1992), section 6.

    Examples
    --------
    >>> from rlcore import Gaussian
    >>> Gaussian([0.0, 1.0], [0.0, 0.0]).entropy().round(4)
    np.float64(2.8379)
    """

    mean: np.ndarray
    log_std: np.ndarray

    def __post_init__(self) -> None:
        mean, log_std = _outputs("mean", self.mean), _outputs("log_std", self.log_std)
        if log_std.shape not in (mean.shape, mean.shape[-1:]):
            raise ValueError(f"log_std: got shape {log_std.shape}, must be {mean.shape} or {mean.shape[-1:]}")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "log_std", np.broadcast_to(log_std, mean.shape))

    def sample(self, rng: Rng) -> Floats:
        """One action a row, (B, d), of mean's dtype."""
        noise = check_rng(rng).standard_normal(self.mean.shape).astype(self.mean.dtype)
        return self.mean + np.exp(self.log_std) * noise

    def log_prob(self, a: ArrayLike) -> Floats:
        """ln of the density at a, (B,). a: (B, d)."""
        return (-0.5 * self._z(a) ** 2 - self.log_std - 0.5 * log(2 * pi)).sum(axis=-1)

    def entropy(self) -> Floats:
        """Differential entropy, (B,); negative where the spread is small."""
        return (self.log_std + 0.5 * log(2 * pi * e)).sum(axis=-1)

    def kl(self, other: Gaussian) -> Floats:
        """KL(self, other), (B,)."""
        z = (self.mean - _same(self, other).mean) * np.exp(-other.log_std)
        narrower = self.log_std - other.log_std
        return 0.5 * (np.exp(2 * narrower) + z**2 - 1 - 2 * narrower).sum(axis=-1)

    def grad_log_prob(self, a: ArrayLike) -> tuple[Floats, Floats]:
        """The score, gradient of ln pi(a|s). om-score"""
        z = self._z(a)
        return z * np.exp(-self.log_std), z**2 - 1  # om-score

    def grad_entropy(self) -> tuple[Floats, Floats]:
        """Gradient of the entropy: the mean has no part in it."""
        return np.zeros_like(self.mean), np.ones_like(self.mean)

    def grad_kl(self, other: Gaussian) -> tuple[Floats, Floats]:
        """Gradient of KL(self, other) with respect to the outputs of `other`: in chapter 8 that is the new policy."""
        z = (_same(self, other).mean - self.mean) * np.exp(-other.log_std)
        return z * np.exp(-other.log_std), 1 - np.exp(2 * (self.log_std - other.log_std)) - z**2

    def take(self, rows: ArrayLike) -> Gaussian:
        """The policy in some of the states, by their numbers."""
        rows = _rows(rows, self.mean)
        return Gaussian(self.mean[rows], self.log_std[rows])

    def fisher(self, d_mean: ArrayLike, d_log_std: ArrayLike) -> tuple[Floats, Floats]:
        """Fisher information of (mean, log_std) times a change of them: second derivative of KL(self, .) at self."""
        d_mean, d_log_std = _like("d_mean", d_mean, self.mean), _like("d_log_std", d_log_std, self.mean)
        return d_mean * np.exp(-2 * self.log_std), 2 * d_log_std

    def _z(self, a):
        a = check_samples("a", a, self.mean.dtype)
        if a.shape != self.mean.shape:
            raise ValueError(f"a: got shape {a.shape}, must be {self.mean.shape}")
        return (a - self.mean) * np.exp(-self.log_std)


def _outputs(name, values):
    """values as a floating array of at least one dimension, all finite."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "f":
        values = check_samples(name, values, values.dtype)
    else:
        values = check_samples(name, values, float)
    if values.ndim == 0 or values.shape[-1] == 0:
        raise ValueError(f"{name}: got shape {values.shape}, must be (B, A) or (A,)")
    return values


def _like(name, values, outputs):
    """values in the dtype and, where there is more than one row, in the shape of the outputs."""
    values = check_samples(name, values, outputs.dtype)
    if values.shape not in (outputs.shape, outputs.shape[-1:]):
        raise ValueError(f"{name}: got shape {values.shape}, must be {outputs.shape}")
    return np.broadcast_to(values, outputs.shape)


def _rows(rows, outputs):
    """rows as an index; ValueError unless they are numbers of rows of the outputs."""
    return check_labels("rows", rows, len(outputs))


def _same(policy, other):
    """other; ValueError unless it is of the same kind and shape as policy."""
    if type(other) is not type(policy) or _parts(other)[0].shape != _parts(policy)[0].shape:
        kind, shape = type(policy).__name__, _parts(policy)[0].shape
        raise ValueError(f"other: got {show(other)}, must be a {kind} of shape {shape}")
    return other


def _parts(policy):
    return (policy.logits,) if isinstance(policy, Categorical) else (policy.mean, policy.log_std)
