"""What PPO approximates, exact on small processes: surrogate, KL, lower bound, and the steps they allow (chapter 8)."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rlcore.bellman import expected_visits, q_from_v, solve_policy
from rlcore.core.checks import (
    as_floats,
    check_finite,
    check_fraction,
    check_nonnegative,
    check_positive,
    finite,
    rounding,
)
from rlcore.core.rules import array, checked, function_of, instance
from rlcore.core.samples import numbers
from rlcore.core.types import ArrayLike, Floats
from rlcore.mdp import FiniteMDP
from rlcore.neurons import softmax

# ---------------------------------------------------------------------- at the old policy


@checked
def eta(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> float:
    """Performance of pi: the expected discounted return from the start distribution.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    float
        The performance.

    Notes
    -----
    Ledger: fig-58.
    """
    return float(mdp.start @ solve_policy(mdp, pi, gamma))


@checked
def advantage(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> Floats:
    """The advantages A(s, a) = q_pi(s, a) - v_pi(s).

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Floats
        (S, A), -inf where a is not in A(s).

    Notes
    -----
    Ledger: eq-ppo-42, cl-122.
    """
    V = solve_policy(mdp, pi, gamma)
    return q_from_v(mdp, V, gamma) - V[:, None]  # eq-ppo-42


@dataclass(frozen=True, eq=False)
class OldPolicy:
    """What is known exactly at pi_old, around which the surrogates are built.

    pi: (S, A). gamma: the discount. eta: its performance. A: (S, A) advantages, 0 where an action is not legal.
    visits: (S,) expected discounted number of visits, 0 at terminal states.
    """

    pi: np.ndarray
    gamma: float
    eta: float
    A: np.ndarray
    visits: np.ndarray

    @property
    def weight(self) -> Floats:
        """Part of the (discounted) time steps that is spent in each state, (S,)."""
        return self.visits / self.visits.sum()


@checked
def old_policy(mdp: FiniteMDP, pi: ArrayLike, gamma: float) -> OldPolicy:
    """What is known exactly at pi, around which the surrogates are built.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    OldPolicy
        The policy with its performance, advantages and visits.

    Notes
    -----
    Ledger: alg-trpo, om-trpo-step.
    """
    A = np.where(mdp.legal & ~mdp.terminal[:, None], advantage(mdp, pi, gamma), 0.0)
    return OldPolicy(pi, gamma, eta(mdp, pi, gamma), A, expected_visits(mdp, pi, gamma))


# ---------------------------------------------------------------------- objectives of the new policy


def _policies(name, pi, given):
    """The rule of policies (..., S, A) beside an old one."""
    rounded, error = rounding(pi)
    pi, shape = as_floats(name, pi), given["old"].pi.shape
    if pi.shape[-2:] != shape:
        raise ValueError(f"{name}: got shape {pi.shape}, must end in {shape}")
    if not ((pi >= 0).all() and (np.abs(pi.sum(axis=-1) - 1) <= error).all()):
        raise ValueError(f"{name}: has a row that is no distribution, must be probabilities that sum to 1")
    return pi / pi.sum(axis=-1, keepdims=True) if rounded else pi


OLD = dict(old=instance(OldPolicy, "what old_policy returns"), pi=_policies)


@checked(**OLD)
def surrogate(old: OldPolicy, pi: ArrayLike) -> Floats:
    """Mean over the old policy's time steps of r_t A_t with r_t = pi / pi_old: 0 at pi_old.

    The ratio times the old probability is the new one.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    pi : ArrayLike
        (..., S, A), one policy or many.

    Returns
    -------
    Floats
        (...).

    Notes
    -----
    Ledger: eq-ppo-44, eq-ppo-48.
    """
    return (pi * old.A).sum(axis=-1) @ old.weight  # eq-ppo-44


@checked(**OLD)
def local_performance(old: OldPolicy, pi: ArrayLike) -> Floats:
    """The performance of pi to first order, with the states that pi_old meets instead of its own.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    pi : ArrayLike
        (..., S, A), one policy or many.

    Returns
    -------
    Floats
        L_old(pi), (...).

    Notes
    -----
    Ledger: eq-ppo-46.

    References
    ----------
    Kakade and Langford (2002); Schulman et al. (2015), equation (3).
    """
    return old.eta + old.visits.sum() * surrogate.unchecked(old, pi)


@checked(**OLD)
def kl(old: OldPolicy, pi: ArrayLike) -> Floats:
    """KL(pi_old(.|s), pi(.|s)) in each state; inf where pi never does what pi_old may do.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    pi : ArrayLike
        (..., S, A), one policy or many.

    Returns
    -------
    Floats
        (..., S).

    Notes
    -----
    Ledger: eq-ppo-45.
    """
    used = old.pi > 0
    with np.errstate(divide="ignore"):
        return (old.pi * (np.log(np.where(used, old.pi, 1.0)) - np.log(np.where(used, pi, 1.0)))).sum(axis=-1)


@checked(**OLD)
def mean_kl(old: OldPolicy, pi: ArrayLike) -> Floats:
    """KL averaged over the old policy's time steps.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    pi : ArrayLike
        (..., S, A), one policy or many.

    Returns
    -------
    Floats
        (...).

    Notes
    -----
    Ledger: eq-ppo-45.
    """
    return np.where(old.weight > 0, kl.unchecked(old, pi), 0.0) @ old.weight  # eq-ppo-45


@checked(**OLD)
def max_kl(old: OldPolicy, pi: ArrayLike) -> Floats:
    """The largest KL of any state that the old policy can be in.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    pi : ArrayLike
        (..., S, A), one policy or many.

    Returns
    -------
    Floats
        (...).

    Notes
    -----
    Ledger: eq-ppo-46 corrected.
    """
    return np.where(old.weight > 0, kl.unchecked(old, pi), 0.0).max(axis=-1)


@checked(**OLD)
def penalty_coefficient(old: OldPolicy) -> float:
    """The coefficient C = 4 epsilon gamma / (1 - gamma)^2 with epsilon the largest absolute advantage.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.

    Returns
    -------
    float
        C.

    Raises
    ------
    ValueError
        At gamma = 1.

    Notes
    -----
    Ledger: eq-ppo-46 corrected, cl-128.

    References
    ----------
    Schulman et al. (2015), theorem 1.
    """
    if old.gamma == 1:
        raise ValueError("gamma: got 1, must be below 1 for the bound: its coefficient grows without limit")
    return 4 * np.abs(old.A).max() * old.gamma / (1 - old.gamma) ** 2


@checked(**OLD, C=check_nonnegative)
def lower_bound(old: OldPolicy, pi: ArrayLike, C: float | None = None) -> Floats:
    """The bound L_old(pi) - C max_s KL: never above eta(pi) with the C of `penalty_coefficient`.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    pi : ArrayLike
        (..., S, A), one policy or many.
    C : float | None
        Another coefficient, for which that is not guaranteed.

    Returns
    -------
    Floats
        (...).

    Notes
    -----
    Ledger: eq-ppo-46 corrected, fig-58, cl-128, cl-129.

    Examples
    --------
    >>> from rlcore import lower_bound, uniform_policy
    >>> from rlcore.envs.small import two_state_mdp
    >>> from rlcore.trust_region import old_policy
    >>> mdp = two_state_mdp()
    >>> old = old_policy(mdp, uniform_policy(mdp), 0.9)
    >>> bool(lower_bound(old, old.pi).round(9) == round(old.eta, 9))
    True
    """
    C = penalty_coefficient(old) if C is None else C
    return local_performance.unchecked(old, pi) - C * max_kl.unchecked(old, pi)


def _beside_base(name, direction, given):
    direction, base = finite(name, direction), given["base"]
    if base.shape != direction.shape:
        raise ValueError(f"{name}: got shape {direction.shape} with base of {base.shape}, must be both (S, A)")
    return direction


@checked(base=array("S", "A"), direction=_beside_base, theta=finite)
def policy_line(base: ArrayLike, direction: ArrayLike, theta: ArrayLike) -> Floats:
    """Softmax policies with one parameter: preferences base + theta direction.

    Parameters
    ----------
    base, direction : ArrayLike
        (S, A).
    theta : ArrayLike
        Any shape.

    Returns
    -------
    Floats
        (..., S, A).

    Notes
    -----
    Ledger: fig-58.
    """
    return softmax(base + theta[..., None, None] * direction)


@checked(bound=function_of("(theta, candidates)"), theta=check_finite, reach=check_positive)
def mm_maximise(
    bound: Callable[[float, Floats], ArrayLike], theta: float, n_steps: int, *, reach: float = 4.0
) -> Floats:
    """Points theta_0 ... theta_n where each maximises the bound built at the one before.

    Parameters
    ----------
    bound : Callable[[float, Floats], ArrayLike]
        Gives bound(theta, candidates), the minorizer built at theta, at each of the candidates (n,).
    theta : float
        Where it starts.
    n_steps : int
        Number of steps.
    reach : float
        The candidates lie up to this to either side of theta, denser near it; theta is one of them, so that what the
        bound minorizes never falls.

    Returns
    -------
    Floats
        (n_steps + 1,).

    Notes
    -----
    Ledger: alg-mm, ex-mm.

    References
    ----------
    Hunter and Lange (2004).

    Examples
    --------
    >>> from rlcore import mm_maximise
    >>> mm_maximise(lambda at, x: -(x**2) - (x - at) ** 2, 1.0, 3).round(2)
    array([1.  , 0.5 , 0.25, 0.12])
    """
    side = reach * np.geomspace(1e-6, 1, 300)
    offsets, history = np.concatenate([[0.0], side, -side]), [theta]
    for _ in range(n_steps):
        candidates = history[-1] + offsets
        history.append(float(candidates[np.argmax(numbers("bound", bound(history[-1], candidates)))]))
    return np.array(history)


# ---------------------------------------------------------------------- line search and trust region


def _beside_x(name, d, given):
    d, x = finite(name, d), given["x"]
    if x.shape != d.shape:
        raise ValueError(f"{name}: got shape {d.shape}, must be that of x, {x.shape}")
    return d


OF_X = function_of("x (d,)")


@checked(f=OF_X, x=array("d"), direction=_beside_x, slope=check_positive, shrink=check_fraction, c=check_fraction)
def backtracking_line_search(
    f: Callable[[Floats], float], x: ArrayLike, direction: ArrayLike, slope: float, *, shrink: float = 0.5,
    c: float = 1e-4, max_steps: int = 60,
) -> tuple[float, Floats]:  # fmt: skip
    """The first of the step sizes 1, shrink, shrink^2, ... that raises f enough, and where it leads.

    Enough is f(x + t d) >= f(x) + c t slope, the condition of Armijo.

    Parameters
    ----------
    f : Callable[[Floats], float]
        The function, of (d,).
    x : ArrayLike
        (d,), where the line begins.
    direction : ArrayLike
        (d,).
    slope : float
        The directional derivative of f at x, positive: the direction goes up.
    shrink : float
        What a step is multiplied by, in (0, 1).
    c : float
        Part of the slope that is enough, in (0, 1).
    max_steps : int
        Most cuts.

    Returns
    -------
    tuple[float, Floats]
        The step size and the point, (d,); 0 and x where no step is good.

    Notes
    -----
    Ledger: alg-line-search.

    References
    ----------
    Nocedal and Wright (2006), algorithm 3.1.

    Examples
    --------
    >>> from rlcore import backtracking_line_search
    >>> backtracking_line_search(lambda x: -(x @ x), [1.0], [-4.0], 8.0)
    (0.25, array([0.]))
    """
    t, here = 1.0, f(x)
    for _ in range(max_steps):
        if f(x + t * direction) >= here + c * t * slope:
            return t, x + t * direction
        t *= shrink
    return 0.0, x


def _symmetric(name, H, given):
    H, g = finite(name, H), given["g"]
    if H.shape != (g.size, g.size) or not np.allclose(H, H.T):
        raise ValueError(f"{name}: got shape {H.shape}, must be symmetric, {(g.size, g.size)}")
    return H


@checked(g=array("d"), H=_symmetric, radius=check_positive)
def trust_region_step(g: ArrayLike, H: ArrayLike, radius: float) -> Floats:
    """The step p that maximises g . p + p . H p / 2 with |p| <= radius.

    Where the top is not inside, p solves (lambda I - H) p = g with |p| = radius.

    Parameters
    ----------
    g : ArrayLike
        (d,), gradient.
    H : ArrayLike
        (d, d), symmetric, of any sign.
    radius : float
        Above 0.

    Returns
    -------
    Floats
        (d,).

    Notes
    -----
    Ledger: alg-trust-region.

    References
    ----------
    Nocedal and Wright (2006), theorem 4.1 and section 4.3.
    """
    curve, axes = np.linalg.eigh(H)
    b, top = axes.T @ g, max(curve[-1], 0.0)
    if curve[-1] < 0 and np.linalg.norm(b / curve) <= radius:
        return -axes @ (b / curve)
    low, high = top, top + np.linalg.norm(b) / radius  # at high the step is no longer than the radius
    for _ in range(200):
        lam = (low + high) / 2
        longer = np.linalg.norm(np.divide(b, lam - curve, out=np.zeros_like(b), where=b != 0)) > radius
        low, high = (lam, high) if longer else (low, lam)
    p = np.divide(b, high - curve, out=np.zeros_like(b), where=high > curve)
    if curve[-1] > 0:  # the hard case: g says nothing about the steepest axis, go along it to the edge
        p[-1] += np.copysign(np.sqrt(max(radius**2 - p @ p, 0.0)), p[-1])
    return axes @ p


@checked(f=OF_X, gradient=OF_X, hessian=OF_X, x=array("d"), radius=check_positive, max_radius=check_positive)
def trust_region_ascent(
    f: Callable[[Floats], float], gradient: Callable[[Floats], ArrayLike], hessian: Callable[[Floats], ArrayLike],
    x: ArrayLike, n_steps: int, *, radius: float = 1.0, max_radius: float = 10.0,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Ascent by steps within a trust region whose radius adapts.

    The radius halves where f rises by less than a quarter of what the quadratic model says, doubles where it rises by
    more than three quarters and the step went to the edge; a step that lowers f is not taken.

    Parameters
    ----------
    f : Callable[[Floats], float]
        The function, of (d,).
    gradient : Callable[[Floats], ArrayLike]
        Its gradient, of (d,).
    hessian : Callable[[Floats], ArrayLike]
        Its second derivatives, (d, d), of (d,).
    x : ArrayLike
        (d,), where it starts.
    n_steps : int
        Number of steps.
    radius : float
        The first radius.
    max_radius : float
        The largest one.

    Returns
    -------
    tuple[Floats, Floats]
        Positions (n_steps + 1, d) and radii (n_steps + 1,).

    Notes
    -----
    Ledger: alg-trust-region.

    References
    ----------
    Nocedal and Wright (2006), algorithm 4.1.

    Examples
    --------
    >>> from rlcore import trust_region_ascent
    >>> f, gradient, hessian = lambda x: -(x @ x), lambda x: -2 * x, lambda x: [[-2.0]]
    >>> trust_region_ascent(f, gradient, hessian, [3.0], 2)
    (array([[3.],
           [2.],
           [0.]]), array([1., 2., 4.]))
    """
    xs, radii = [x], [radius]
    for _ in range(n_steps):
        x, r, g, H = xs[-1], radii[-1], gradient(xs[-1]), hessian(xs[-1])
        p = trust_region_step(g, H, r)
        rise, model = f(x + p) - f(x), g @ p + p @ H @ p / 2
        ratio = rise / model if model > 0 else 1.0
        at_edge = np.linalg.norm(p) > 0.999 * r
        radii.append(r / 2 if ratio < 0.25 else min(2 * r, max_radius) if ratio > 0.75 and at_edge else r)
        xs.append(x + p if rise > 0 else x)
    return np.array(xs), np.array(radii)


# ---------------------------------------------------------------------- exact steps of a tabular softmax


@checked(**OLD, beta=check_positive)
def penalised_step(old: OldPolicy, beta: float) -> Floats:
    """The policy that maximises surrogate - beta mean KL.

    In each state pi(a) = beta pi_old(a) / (mu - A(a)), where mu makes the sum over a 1; Newton from the left finds it.
    An action that pi_old never takes stays so, as with any softmax.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    beta : float
        Above 0.

    Returns
    -------
    Floats
        (S, A).

    Notes
    -----
    Ledger: eq-ppo-46, alg-kl-penalty, ex-beta.

    References
    ----------
    Grill et al. (2020), section 3.
    """
    A = np.where(old.pi > 0, old.A, -np.inf)
    gap = A.max(axis=1, keepdims=True) - A
    above = (beta * old.pi - gap).max(axis=1, keepdims=True)  # mu - max A, from where one of the terms is 1
    for _ in range(30):
        terms = beta * old.pi / (above + gap)
        above += (terms.sum(axis=1, keepdims=True) - 1) / (terms / (above + gap)).sum(axis=1, keepdims=True)
    pi = beta * old.pi / (above + gap)
    return pi / pi.sum(axis=1, keepdims=True)


@checked(**OLD, delta=check_positive)
def constrained_step(old: OldPolicy, delta: float) -> tuple[Floats, float]:
    """The policy that maximises the surrogate under mean KL <= delta, and its beta.

    The beta whose `penalised_step` has a mean KL of delta: the constraint chooses the penalty.

    Parameters
    ----------
    old : OldPolicy
        The old policy, as `old_policy` gives it.
    delta : float
        Largest mean KL, above 0.

    Returns
    -------
    tuple[Floats, float]
        The policy (S, A) and its beta; pi_old itself with beta = inf where no advantage is left.

    Notes
    -----
    Ledger: eq-ppo-44, eq-ppo-45, alg-trpo.

    References
    ----------
    Schulman et al. (2015), equation (12).
    """
    scale = np.abs(old.A).max()
    if scale <= 1e-12 * max(1.0, abs(old.eta)):
        return old.pi, np.inf
    low, high = np.log(scale) - 30, np.log(scale) + 30
    for _ in range(60):
        middle = (low + high) / 2
        farther = mean_kl.unchecked(old, penalised_step.unchecked(old, np.exp(middle))) > delta
        low, high = (middle, high) if farther else (low, middle)
    return penalised_step(old, np.exp(high)), float(np.exp(high))


LEAST_BETA, LARGEST_BETA = 1e-30, 1e30


@checked(beta=check_positive, d=check_nonnegative, d_target=check_positive)
def adapt_beta(beta: float, d: float, d_target: float) -> float:
    """The coefficient beta after an update that moved the policy by a mean KL of d.

    Half where d < d_target / 1.5, twice where d > 1.5 d_target, and never beyond LEAST_BETA and LARGEST_BETA, so that
    it stays a number that float32 can weight with.

    Parameters
    ----------
    beta : float
        The coefficient so far.
    d : float
        The mean KL, at least 0.
    d_target : float
        What it should be.

    Returns
    -------
    float
        The next beta.

    Notes
    -----
    Ledger: om-adaptive-beta, alg-kl-adaptive, cl-131.

    References
    ----------
    Schulman et al. (2017), section 4.
    """
    if d < d_target / 1.5:
        return max(beta / 2, min(beta, LEAST_BETA))  # om-adaptive-beta
    return min(2 * beta, max(beta, LARGEST_BETA)) if d > 1.5 * d_target else beta


Steps = namedtuple("Steps", "eta kl beta pi")  # (n + 1,), (n,), (n,), (S, A): performance, mean KL, beta, last policy


@checked(beta=check_positive, d_target=check_positive)
def penalised_ascent(
    mdp: FiniteMDP, pi: ArrayLike, gamma: float, n_steps: int, *, beta: float, d_target: float | None = None
) -> Steps:
    """Exact penalised steps from pi; beta stays, or adapts to d_target.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    n_steps : int
        Number of steps.
    beta : float
        The first coefficient.
    d_target : float | None
        The mean KL that beta adapts to; None: it stays.

    Returns
    -------
    Steps
        eta, kl and beta of each step, and the last policy.

    Notes
    -----
    Ledger: alg-kl-adaptive, ex-beta.
    """
    old, etas, kls, betas = old_policy(mdp, pi, gamma), [], [], []
    for _ in range(n_steps):
        new = penalised_step(old, beta)
        etas, kls, betas = [*etas, old.eta], [*kls, float(mean_kl(old, new))], [*betas, float(beta)]
        beta = beta if d_target is None else adapt_beta(beta, kls[-1], d_target)
        old = old_policy(mdp, new, gamma)
    return Steps(np.array([*etas, old.eta]), np.array(kls), np.array(betas), old.pi)


@checked(delta=check_positive)
def constrained_ascent(mdp: FiniteMDP, pi: ArrayLike, gamma: float, n_steps: int, *, delta: float) -> Steps:
    """Exact constrained steps from pi, with the beta that each constraint implies.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    gamma : float
        Discount, in [0, 1].
    n_steps : int
        Number of steps.
    delta : float
        Largest mean KL of a step.

    Returns
    -------
    Steps
        eta, kl and beta of each step, and the last policy.

    Notes
    -----
    Ledger: alg-trpo, cl-127.
    """
    old, etas, kls, betas = old_policy(mdp, pi, gamma), [], [], []
    for _ in range(n_steps):
        new, beta = constrained_step(old, delta)
        etas, kls, betas = [*etas, old.eta], [*kls, float(mean_kl(old, new))], [*betas, beta]
        old = old_policy(mdp, new, gamma)
    return Steps(np.array([*etas, old.eta]), np.array(kls), np.array(betas), old.pi)
