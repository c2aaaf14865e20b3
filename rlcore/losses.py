"""The objectives of chapter 8 as they are printed, corrected where they are wrong, in torch.

`rlcore.ppo` and `rlcore.trpo` differentiate the same objectives by hand; here autograd does. All are maximised.
A policy is given by its outputs for B states: logits (B, A), or a pair of mean (B, A) and log_std (A,) or (B, A).
actions: (B,) integers, or (B, A). advantage: (B,). `old` stands for outputs of the policy that acted, held constant.
Source: Schulman et al. (2015, 2017).
"""

from rlcore.core.checks import check_positive
from rlcore.core.extras import extra

with extra("deep"):
    import torch
    from torch.distributions import Categorical, Independent, Normal, kl_divergence


def distribution(outputs):
    """The policy that outputs stand for, one for each row: softmax of logits, or independent normals. om-softmax"""
    if isinstance(outputs, torch.Tensor):
        return Categorical(logits=outputs)
    if not isinstance(outputs, tuple) or len(outputs) != 2:
        raise ValueError(f"outputs: got {type(outputs).__name__}, must be logits, or a pair (mean, log_std)")
    mean, log_std = outputs
    return Independent(Normal(mean, log_std.exp().expand_as(mean)), 1)


def label_objective(logits, labels):
    """Mean of log p(y|x) over samples with their right labels; its gradient for one sample is (40). eq-ppo-40"""
    return _log_prob(logits, labels).mean()  # eq-ppo-40


def pg_objective(outputs, actions, advantage):
    """L^PG, whose gradient is the estimator of (41). eq-ppo-43, eq-ppo-41"""
    log_prob = _log_prob(outputs, actions)
    return (log_prob * _like("advantage", advantage, log_prob)).mean()  # eq-ppo-43


def ratio(outputs, old, actions):
    """r_t = pi(a|s) / pi_old(a|s), (B,). eq-ppo-47"""
    return (_log_prob(outputs, actions) - _log_prob(_constant(old), actions)).exp()  # eq-ppo-47


def surrogate(outputs, old, actions, advantage):
    """L^CPI, which TRPO maximises: the mean of r_t A_t. eq-ppo-44, eq-ppo-48"""
    r = ratio(outputs, old, actions)
    return (r * _like("advantage", advantage, r)).mean()  # eq-ppo-48


def mean_kl(old, outputs):
    """Mean of KL(pi_old, pi) over the states: the left side of the constraint. eq-ppo-45"""
    return kl_divergence(distribution(_constant(old)), distribution(outputs)).mean()  # eq-ppo-45


def kl_penalised(outputs, old, actions, advantage, beta):
    """The surrogate less beta times the mean KL. eq-ppo-46"""
    return surrogate(outputs, old, actions, advantage) - beta * mean_kl(old, outputs)  # eq-ppo-46


def clip_objective(outputs, old, actions, advantage, clip):
    """L^CLIP. clip: epsilon > 0. eq-ppo-49, fig-59, fig-60"""
    r, epsilon = ratio(outputs, old, actions), check_positive("clip", clip)
    A = _like("advantage", advantage, r)
    return torch.minimum(r * A, r.clamp(1 - epsilon, 1 + epsilon) * A).mean()  # eq-ppo-49


def value_loss(values, target):
    """L^VF, the mean squared error of the values (B,). om-value-loss"""
    return (values - _like("target", target, values)).square().mean()  # om-value-loss


def entropy(outputs):
    """S[pi](s), (B,). om-value-loss"""
    return distribution(outputs).entropy()  # om-value-loss


def ppo_objective(outputs, old, actions, advantage, values, target, clip=0.2, c1=0.5, c2=0.0):
    """L^(CLIP+VF+S): clipped surrogate, less c1 times the value loss, plus c2 times the mean entropy. eq-ppo-50"""
    L_clip = clip_objective(outputs, old, actions, advantage, clip)
    return L_clip - c1 * value_loss(values, target) + c2 * entropy(outputs).mean()  # eq-ppo-50


# ---------------------------------------------------------------------- checks


def _constant(outputs):
    return outputs.detach() if isinstance(outputs, torch.Tensor) else tuple(part.detach() for part in outputs)


def _log_prob(outputs, actions):
    policy = distribution(outputs)
    if actions.shape != policy.batch_shape + policy.event_shape:
        shape = tuple(policy.batch_shape + policy.event_shape)
        raise ValueError(f"actions: got shape {tuple(actions.shape)}, must be {shape}")
    return policy.log_prob(actions)


def _like(name, numbers, samples):
    """numbers; ValueError unless there is one for each sample: (B, 1) would broadcast to (B, B) in silence."""
    if numbers.shape != samples.shape:
        raise ValueError(f"{name}: got shape {tuple(numbers.shape)}, must be {tuple(samples.shape)}")
    return numbers
