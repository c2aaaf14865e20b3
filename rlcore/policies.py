"""Policies: epsilon-greedy in a table, softmax in features, and distributions over a network's outputs."""

from dataclasses import dataclass
from math import e, exp, log, pi

import numpy as np

from rlcore.bellman import greedy_actions
from rlcore.core.checks import as_floats, as_integers, check_probability, check_rng, is_number
from rlcore.core.compiled import compiled
from rlcore.core.sampling import cumulative
from rlcore.neurons import log_softmax, softmax


@compiled
def epsilon_greedy(Q, s, epsilon, rng):
    """A legal action at random with probability epsilon, else a maximising one; ties at random. -inf: not legal."""
    lowest, n = -np.inf, 0
    for a in range(Q.shape[1]):  # maximum and ties in one pass: 1.6 times the speed where there is no numba
        q = Q[s, a]
        if q > lowest:
            lowest, n = q, 1
        elif q == lowest:
            n += 1
    if rng.random() < epsilon:
        lowest, n = -1.7976931348623157e308, 0
        for a in range(Q.shape[1]):
            if Q[s, a] >= lowest:
                n += 1
    pick = int(rng.random() * n)
    for a in range(Q.shape[1]):
        if Q[s, a] >= lowest:
            if pick == 0:
                return a
            pick -= 1
    return -1


@compiled
def max_value(Q, s):
    """max over a of Q(s, a)."""
    best = Q[s, 0]
    for a in range(1, Q.shape[1]):
        best = max(best, Q[s, a])
    return best


@compiled
def expected_value(Q, s, epsilon):
    """Mean of Q(s, .) under the epsilon-greedy policy of Q; -inf marks actions that are not legal."""
    total, n = 0.0, 0
    for a in range(Q.shape[1]):
        if Q[s, a] > -np.inf:
            total += Q[s, a]
            n += 1
    return (1 - epsilon) * max_value(Q, s) + epsilon * (total / n)


def soft_greedy(Q, epsilon):
    """The epsilon-greedy policy (S, A) of Q: ties share the greedy part, -inf marks actions that are not legal."""
    best, legal = greedy_actions(Q), np.isfinite(Q)
    share = [x / x.sum(axis=1, keepdims=True) for x in (best, legal)]
    return (1 - check_probability("epsilon", epsilon)) * share[0] + epsilon * share[1]


# ---------------------------------------------------------------------- the policy


def softmax_policy(theta, x=None, legal=None, *, p_min=0.0):
    """pi(a|s) proportional to exp(h), h(s, a) = theta[a] . x(s), as (S, A). om-softmax, alg-softmax-policy

    theta: (A, d). x: (S, d) features, rows that are equal where states look alike; None where there is one feature a
    state, theta[a, s] = h(s, a). legal: (S, A) bool. p_min: below it no legal action's probability falls; the others
    share the rest. Source: Sutton and Barto (2018), (13.2), (13.3).
    """
    theta = check_parameters("theta", theta)
    x = np.eye(theta.shape[1]) if x is None else check_features(x, None, theta.shape[1])
    legal = np.ones((len(x), len(theta)), bool) if legal is None else np.asarray(legal, bool)
    p_min = check_p_min(p_min, len(theta))
    if legal.shape != (len(x), len(theta)) or not legal.any(axis=1).all():
        raise ValueError(f"legal: got shape {legal.shape}, must be {(len(x), len(theta))}, an action in every state")
    return np.array([probabilities(np.zeros(len(theta)), theta, row, ok, p_min) for row, ok in zip(x, legal)])


def grad_log_softmax(theta, x, a):
    """The score, gradient of ln pi(a|x) with respect to theta, (A, d). om-score, alg-softmax-policy

    x: (d,) features of one state.
    """
    theta = check_parameters("theta", theta)
    x, a = check_features([x], None, theta.shape[1])[0], check_indices("a", a, len(theta))
    return np.outer(np.eye(len(theta))[a] - softmax(theta @ x), x)  # om-score


@compiled
def probabilities(pi, theta, x, legal, p_min):
    """pi (A,), filled with the softmax of theta x over the legal actions.

    One number at a time, beside neurons.softmax: 3 times as fast as arrays in compiled loops, and the same bits without
    numba, whose exp of an array differs from numpy's.
    """
    top, total = -np.inf, 0.0
    for a in range(pi.size):
        pi[a] = -np.inf
        if legal[a]:
            pi[a] = 0.0
            for i in range(x.size):
                pi[a] += theta[a, i] * x[i]
            top = max(top, pi[a])
    for a in range(pi.size):
        pi[a] = exp(pi[a] - top)
        total += pi[a]
    for a in range(pi.size):
        pi[a] /= total  # om-softmax
    n_low, before, scale = 0, -1, 1.0
    while n_low > before:  # what is scaled down may fall below the floor in its turn
        before, n_low, rest = n_low, 0, 0.0
        for a in range(pi.size):
            if legal[a] and pi[a] * scale < p_min:
                n_low += 1
            else:
                rest += pi[a]
        if n_low > 0 and rest > 0.0:
            scale = (1.0 - n_low * p_min) / rest
    for a in range(pi.size):
        if legal[a]:
            pi[a] = max(pi[a] * scale, p_min)
    return pi


@compiled
def choose(pi, rng):
    u, last = rng.random(), 0
    for a in range(pi.size):
        if pi[a] > 0.0:
            last = a
            u -= pi[a]
            if u < 0.0:
                break
    return last


@compiled
def add_score(g, scale, pi, x, a):
    """g += scale * grad ln pi(a|s). om-score"""
    for b in range(pi.size):
        for i in range(x.size):
            g[b, i] += scale * ((1.0 if b == a else 0.0) - pi[b]) * x[i]  # om-score


@compiled
def dot(w, x):
    total = 0.0
    for i in range(x.size):
        total += w[i] * x[i]
    return total


# ---------------------------------------------------------------------- checks


def check_features(x, n_states, d=None):
    """x as (S, d) floats; one feature a state where None."""
    if x is None:
        return np.eye(n_states)
    x = np.ascontiguousarray(as_floats("features", x))
    if x.ndim != 2 or x.size == 0 or len(x) != (n_states or len(x)) or x.shape[1] != (d or x.shape[1]):
        expected = (n_states or "S", d or "d")
        raise ValueError(f"features: got shape {x.shape}, must be ({expected[0]}, {expected[1]})")
    if not np.isfinite(x).all():
        raise ValueError("features: contains a value that is not finite, must be numbers")
    return x


def check_parameters(name, values, shape=None):
    """values as a new float array, a number broadcast to shape; (A, d) where shape is None."""
    values = as_floats(name, values)
    if shape is not None and values.ndim == 0:
        values = np.full(shape, values)
    if values.shape != (shape or values.shape) or values.ndim != len(shape or "Ad") or values.size == 0:
        raise ValueError(f"{name}: got shape {values.shape}, must be {shape or '(A, d)'}")
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return np.array(values)


def check_indices(name, values, n):
    values = as_integers(name, values)
    if ((values < 0) | (values >= n)).any():
        raise ValueError(f"{name}: got {values.min()}..{values.max()}, must be in 0..{n - 1}")
    return values


def check_step(name, value, least=None):
    if not is_number(value) or not (value > 0 or value == least) or not value < np.inf:
        raise ValueError(f"{name}: got {value!r}, must be a number {'of at least' if least == 0 else 'above'} 0")
    return float(value)


def check_p_min(p_min, A):
    if not is_number(p_min) or not 0 <= p_min < 1 / A:
        raise ValueError(f"p_min: got {p_min!r}, must be in [0, 1 / {A})")
    return float(p_min)


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
