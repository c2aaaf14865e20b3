"""Policies as distributions over a network's outputs, with the gradients that learning needs (chapters 7 and 8)."""

from dataclasses import dataclass
from math import e, log, pi

import numpy as np

from rlcore.core.checks import check_rng
from rlcore.core.sampling import cumulative
from rlcore.neurons import log_softmax


@dataclass(frozen=True, eq=False)
class Categorical:
    """Softmax over A actions; every method treats each row of the batch alone. om-softmax, alg-softmax-policy

    logits: (B, A), or (A,) for one state; their dtype is kept. Gradients are with respect to the logits, (B, A).
    Source: Sutton and Barto (2018), (13.2).
    """

    logits: np.ndarray

    def __post_init__(self):
        logits = _outputs("logits", self.logits)
        object.__setattr__(self, "logits", logits)
        object.__setattr__(self, "log_probs", log_softmax(logits))

    @property
    def probs(self):
        """pi(.|s), (B, A)."""
        return np.exp(self.log_probs)

    def sample(self, rng):
        """One action a row, (B,) integers."""
        u = check_rng(rng).random(self.logits.shape[:-1])
        return (cumulative(self.probs) <= u[..., None]).sum(axis=-1)

    def log_prob(self, a):
        """ln pi(a|s), (B,). a: (B,) integers."""
        return np.take_along_axis(self.log_probs, self._actions(a)[..., None], axis=-1)[..., 0]

    def entropy(self):
        """-sum over a of pi(a|s) ln pi(a|s), (B,)."""
        return -(self.probs * self.log_probs).sum(axis=-1)

    def kl(self, other):
        """KL(self, other) = sum over a of pi(a|s) ln(pi(a|s) / other(a|s)), (B,)."""
        return (self.probs * (self.log_probs - _same(self, other).log_probs)).sum(axis=-1)

    def grad_log_prob(self, a):
        """The score, gradient of ln pi(a|s). om-score, alg-softmax-policy"""
        return np.eye(self.logits.shape[-1], dtype=self.logits.dtype)[self._actions(a)] - self.probs  # om-score

    def grad_entropy(self):
        """Gradient of the entropy."""
        return -self.probs * (self.log_probs + self.entropy()[..., None])

    def grad_kl(self, other):
        """Gradient of KL(self, other) with respect to the logits of `other`: in chapter 8 that is the new policy."""
        return _same(self, other).probs - self.probs

    def take(self, rows):
        """The policy in some of the states."""
        return Categorical(self.logits[rows])

    def fisher(self, d_logits):
        """Fisher information of the logits times a change of them, (B, A): second derivative of KL(self, .) at self."""
        p = self.probs
        return p * (d_logits - (p * d_logits).sum(axis=-1, keepdims=True))

    def _actions(self, a):
        a, A = np.asarray(a), self.logits.shape[-1]
        if a.dtype.kind not in "iu":
            raise ValueError(f"a: got dtype {a.dtype}, must be integers; continuous actions need a Gaussian")
        if a.shape != self.logits.shape[:-1]:
            raise ValueError(f"a: got shape {a.shape}, must be {self.logits.shape[:-1]}")
        if ((a < 0) | (a >= A)).any():
            raise ValueError(f"a: got {a.min()}..{a.max()}, must be in 0..{A - 1}")
        return a


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Normal distribution over d continuous actions that do not depend on each other; each row of the batch alone.

    mean: (B, d), or (d,) for one state. log_std: (d,) for one spread in all states, or the shape of mean. Gradients are
    pairs, with respect to (mean, log_std), each of mean's shape: where log_std is shared, sum them over the batch.
    Source: Sutton and Barto (2018), section 13.7; Williams (1992), section 6.
    """

    mean: np.ndarray
    log_std: np.ndarray

    def __post_init__(self):
        mean, log_std = _outputs("mean", self.mean), _outputs("log_std", self.log_std)
        if log_std.shape not in (mean.shape, mean.shape[-1:]):
            raise ValueError(f"log_std: got shape {log_std.shape}, must be {mean.shape} or {mean.shape[-1:]}")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "log_std", np.broadcast_to(log_std, mean.shape))

    def sample(self, rng):
        """One action a row, (B, d), of mean's dtype."""
        noise = check_rng(rng).standard_normal(self.mean.shape).astype(self.mean.dtype)
        return self.mean + np.exp(self.log_std) * noise

    def log_prob(self, a):
        """ln of the density at a, (B,). a: (B, d)."""
        return (-0.5 * self._z(a) ** 2 - self.log_std - 0.5 * log(2 * pi)).sum(axis=-1)

    def entropy(self):
        """Differential entropy, (B,); negative where the spread is small."""
        return (self.log_std + 0.5 * log(2 * pi * e)).sum(axis=-1)

    def kl(self, other):
        """KL(self, other), (B,)."""
        z = (self.mean - _same(self, other).mean) * np.exp(-other.log_std)
        narrower = self.log_std - other.log_std
        return 0.5 * (np.exp(2 * narrower) + z**2 - 1 - 2 * narrower).sum(axis=-1)

    def grad_log_prob(self, a):
        """The score, gradient of ln pi(a|s). om-score"""
        z = self._z(a)
        return z * np.exp(-self.log_std), z**2 - 1  # om-score

    def grad_entropy(self):
        """Gradient of the entropy: the mean has no part in it."""
        return np.zeros_like(self.mean), np.ones_like(self.mean)

    def grad_kl(self, other):
        """Gradient of KL(self, other) with respect to the outputs of `other`: in chapter 8 that is the new policy."""
        z = (_same(self, other).mean - self.mean) * np.exp(-other.log_std)
        return z * np.exp(-other.log_std), 1 - np.exp(2 * (self.log_std - other.log_std)) - z**2

    def take(self, rows):
        """The policy in some of the states."""
        return Gaussian(self.mean[rows], self.log_std[rows])

    def fisher(self, d_mean, d_log_std):
        """Fisher information of (mean, log_std) times a change of them: second derivative of KL(self, .) at self."""
        return d_mean * np.exp(-2 * self.log_std), 2 * np.broadcast_to(d_log_std, self.mean.shape)

    def _z(self, a):
        a = np.asarray(a, self.mean.dtype)
        if a.shape != self.mean.shape:
            raise ValueError(f"a: got shape {a.shape}, must be {self.mean.shape}")
        return (a - self.mean) * np.exp(-self.log_std)


def _outputs(name, values):
    """values as a floating array of at least one dimension, all finite."""
    values = np.asarray(values)
    if values.dtype.kind not in "fiu" or values.ndim == 0 or values.shape[-1] == 0:
        raise ValueError(f"{name}: got {values.dtype} of shape {values.shape}, must be numbers, (B, A) or (A,)")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return values if values.dtype.kind == "f" else values.astype(float)


def _same(policy, other):
    """other; ValueError unless it is of the same kind and shape as policy."""
    shapes = [getattr(p, "logits", getattr(p, "mean", None)) for p in (policy, other)]
    if type(other) is not type(policy) or shapes[0].shape != shapes[1].shape:
        raise ValueError(f"other: got {other!r}, must be a {type(policy).__name__} of shape {shapes[0].shape}")
    return other
