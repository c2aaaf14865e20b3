"""The objectives of chapter 8 as they are printed, corrected where they are wrong, in torch.

`rlcore.ppo` and `rlcore.trpo` differentiate the same objectives by hand; here autograd does. All are maximised.
A policy is given by its outputs for B states: logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
actions: (B,) integers, or (B, A). advantage: (B,). `old` stands for outputs of the policy that acted, held constant.
Source: Schulman et al. (2015, 2017).
"""

from __future__ import annotations

from typing import TypeAlias

from rlcore.core.checks import check_finite, check_positive, show
from rlcore.core.extras import extra
from rlcore.core.rules import checked

with extra("deep"):
    import torch
    from torch import Tensor
    from torch.distributions import Categorical, Independent, Normal, kl_divergence

Outputs: TypeAlias = Tensor | tuple[Tensor, Tensor]  # logits, or mean and log_std


def _floats(name, x):
    """x; ValueError unless it is a tensor of floats, all finite, of one dimension at least."""
    if not isinstance(x, torch.Tensor) or not x.is_floating_point() or not x.ndim or not x.numel():
        kind = f"{x.dtype} of shape {tuple(x.shape)}" if isinstance(x, torch.Tensor) else show(x)
        raise ValueError(f"{name}: got {kind}, must be a tensor of floats")
    if not x.isfinite().all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return x


def _outputs(name, outputs, given):
    """The rule of a policy's outputs: logits, or a pair (mean, log_std)."""
    if isinstance(outputs, torch.Tensor):
        return _floats(name, outputs)
    if not isinstance(outputs, tuple) or len(outputs) != 2:
        raise ValueError(f"{name}: got {type(outputs).__name__}, must be logits, or a pair (mean, log_std)")
    mean, log_std = (_floats(name, part) for part in outputs)
    if log_std.shape not in (mean.shape, mean.shape[-1:]):
        shapes = f"{tuple(mean.shape)} and {tuple(log_std.shape)}"
        raise ValueError(f"{name}: got shapes {shapes}, must be (B, A), and (A,) or (B, A)")
    return outputs


def _of(name):
    """The rule of outputs of another policy in the same states."""

    def rule(this, outputs, given):
        outputs, shapes = _outputs(this, outputs, given), []
        for policy in (outputs, given[name]):
            parts = policy if isinstance(policy, tuple) else (policy,)
            shapes.append((len(parts), tuple(parts[0].shape)))
        if shapes[0] != shapes[1]:
            raise ValueError(f"{this}: got shape {shapes[0][1]}, must be that of {name}, {shapes[1][1]}")
        return outputs

    return rule


def _integers_or_floats(name, actions, given):
    """The rule of actions or labels, in the shape and range of what outputs stand for."""
    policy = distribution.unchecked(given["outputs"] if "outputs" in given else given["logits"])
    shape = tuple(policy.batch_shape + policy.event_shape)
    if not isinstance(actions, torch.Tensor):
        raise ValueError(f"{name}: got {show(actions)}, must be a tensor of shape {shape}")
    if tuple(actions.shape) != shape:
        raise ValueError(f"{name}: got shape {tuple(actions.shape)}, must be {shape}")
    if not policy.support.check(actions).all() or actions.is_complex():
        raise ValueError(f"{name}: got {show(actions)}, must be actions of the policy")
    return actions


def _like(*others):
    """The rule of numbers, one for each sample: (B, 1) would broadcast to (B, B) in silence."""

    def rule(name, numbers, given):
        numbers, shape = _floats(name, numbers), next(given[other].shape[:1] for other in others if other in given)
        if numbers.shape != shape:
            raise ValueError(f"{name}: got shape {tuple(numbers.shape)}, must be {tuple(shape)}")
        return numbers

    return rule


TENSORS = dict(
    outputs=_outputs, logits=_outputs, actions=_integers_or_floats, labels=_integers_or_floats,
    advantage=_like("actions"), values=lambda name, values, given: _floats(name, values), target=_like("values"),
    beta=check_finite, clip=check_positive, c1=check_finite, c2=check_finite,
)  # fmt: skip
NEW = TENSORS | dict(old=_of("outputs"))


@checked(**TENSORS)
def distribution(outputs: Outputs) -> torch.distributions.Distribution:
    """The policy that outputs stand for, one for each row: softmax of logits, or independent normals.

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).

    Returns
    -------
    torch.distributions.Distribution
        One distribution for each row.

    Notes
    -----
    Ledger: om-softmax.
    """
    if isinstance(outputs, torch.Tensor):
        return Categorical(logits=outputs)
    mean, log_std = outputs
    return Independent(Normal(mean, log_std.exp().expand_as(mean)), 1)


@checked(**TENSORS)
def label_objective(logits: Tensor, labels: Tensor) -> Tensor:
    """Mean of log p(y|x) over samples with their right labels; its gradient for one sample is (40).

    Parameters
    ----------
    logits : Tensor
        (B, K).
    labels : Tensor
        (B,), integers.

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-40.
    """
    return _log_prob(logits, labels).mean()  # eq-ppo-40


@checked(**TENSORS)
def pg_objective(outputs: Outputs, actions: Tensor, advantage: Tensor) -> Tensor:
    """The objective L^PG, whose gradient is the estimator of (41).

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
    actions : Tensor
        (B,) integers, or (B, A).
    advantage : Tensor
        (B,).

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-43, eq-ppo-41.
    """
    return (_log_prob(outputs, actions) * advantage).mean()  # eq-ppo-43


@checked(**NEW)
def ratio(outputs: Outputs, old: Outputs, actions: Tensor) -> Tensor:
    """The ratio r_t = pi(a|s) / pi_old(a|s).

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
    old : Outputs
        Outputs of the policy that acted, held constant.
    actions : Tensor
        (B,) integers, or (B, A).

    Returns
    -------
    Tensor
        (B,).

    Notes
    -----
    Ledger: eq-ppo-47.
    """
    return (_log_prob(outputs, actions) - _log_prob(_constant(old), actions)).exp()  # eq-ppo-47


@checked(**NEW)
def surrogate(outputs: Outputs, old: Outputs, actions: Tensor, advantage: Tensor) -> Tensor:
    """The surrogate L^CPI, which TRPO maximises: the mean of r_t A_t.

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
    old : Outputs
        Outputs of the policy that acted, held constant.
    actions : Tensor
        (B,) integers, or (B, A).
    advantage : Tensor
        (B,).

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-44, eq-ppo-48.
    """
    return (ratio(outputs, old, actions) * advantage).mean()  # eq-ppo-48


@checked(old=_outputs, outputs=_of("old"))
def mean_kl(old: Outputs, outputs: Outputs) -> Tensor:
    """The mean of KL(pi_old, pi) over the states: the left side of the constraint.

    Parameters
    ----------
    old : Outputs
        Outputs of the policy that acted, held constant.
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-45.
    """
    return kl_divergence(distribution.unchecked(_constant(old)), distribution.unchecked(outputs)).mean()  # eq-ppo-45


@checked(**NEW)
def kl_penalised(outputs: Outputs, old: Outputs, actions: Tensor, advantage: Tensor, beta: float) -> Tensor:
    """The surrogate less beta times the mean KL.

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
    old : Outputs
        Outputs of the policy that acted, held constant.
    actions : Tensor
        (B,) integers, or (B, A).
    advantage : Tensor
        (B,).
    beta : float
        The coefficient.

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-46.
    """
    return surrogate(outputs, old, actions, advantage) - beta * mean_kl(old, outputs)  # eq-ppo-46


@checked(**NEW)
def clip_objective(outputs: Outputs, old: Outputs, actions: Tensor, advantage: Tensor, clip: float) -> Tensor:
    """The clipped surrogate L^CLIP.

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
    old : Outputs
        Outputs of the policy that acted, held constant.
    actions : Tensor
        (B,) integers, or (B, A).
    advantage : Tensor
        (B,).
    clip : float
        The epsilon of the clipped ratio, above 0.

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-49, fig-59, fig-60.
    """
    r, A = ratio(outputs, old, actions), advantage
    return torch.minimum(r * A, r.clamp(1 - clip, 1 + clip) * A).mean()  # eq-ppo-49


@checked(**TENSORS)
def value_loss(values: Tensor, target: Tensor) -> Tensor:
    """The mean squared error of the values, L^VF.

    Parameters
    ----------
    values, target : Tensor
        (B,).

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: om-value-loss.
    """
    return (values - target).square().mean()  # om-value-loss


@checked(**TENSORS)
def entropy(outputs: Outputs) -> Tensor:
    """The entropy S[pi](s) in each state.

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).

    Returns
    -------
    Tensor
        (B,).

    Notes
    -----
    Ledger: om-value-loss.
    """
    return distribution.unchecked(outputs).entropy()  # om-value-loss


@checked(**NEW)
def ppo_objective(
    outputs: Outputs, old: Outputs, actions: Tensor, advantage: Tensor, values: Tensor, target: Tensor,
    clip: float = 0.2, c1: float = 0.5, c2: float = 0.0,
) -> Tensor:  # fmt: skip
    """The objective L^(CLIP+VF+S): clipped surrogate, less c1 times the value loss, plus c2 times the mean entropy.

    Parameters
    ----------
    outputs : Outputs
        Logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
    old : Outputs
        Outputs of the policy that acted, held constant.
    actions : Tensor
        (B,) integers, or (B, A).
    advantage, values, target : Tensor
        (B,).
    clip : float
        The epsilon of the clipped ratio, above 0.
    c1 : float
        Weight of the value loss.
    c2 : float
        Weight of the entropy.

    Returns
    -------
    Tensor
        A number.

    Notes
    -----
    Ledger: eq-ppo-50.
    """
    L_clip = clip_objective(outputs, old, actions, advantage, clip)
    return L_clip - c1 * value_loss(values, target) + c2 * entropy(outputs).mean()  # eq-ppo-50


def _constant(outputs):
    return outputs.detach() if isinstance(outputs, torch.Tensor) else tuple(part.detach() for part in outputs)


def _log_prob(outputs, actions):
    return distribution.unchecked(outputs).log_prob(actions)
