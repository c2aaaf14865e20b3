"""A model of continuous states by least squares, and plans by random shooting in it (chapter 3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rlcore.core.checks import check_count, finite, show
from rlcore.core.rules import array, checked, count, function_of, like, sized
from rlcore.core.types import ArrayLike, Floats, Ints, Rng


def _actions_below(n_actions):
    """The rule of actions (n,), one for each row of x."""

    def rule(name, a, given):
        a, n, rows = finite(name, a), n_actions(given), len(given["x"])
        if a.shape != (rows,) or not np.isin(a, np.arange(n)).all():
            raise ValueError(f"{name}: got {show(a)}, must be ({rows},) actions in 0..{n - 1}")
        return a.astype(int)

    return rule


MOST_ACTIONS = 10_000  # of a model that sees them as one-hot rows


@checked(
    x=array("n", "d"), a=_actions_below(lambda given: check_count("n_actions", given["n_actions"], most=MOST_ACTIONS)),
    x_next=like("x"), n_actions=count(most=MOST_ACTIONS),
)  # fmt: skip
def fit_linear_dynamics(x: ArrayLike, a: ArrayLike, x_next: ArrayLike, n_actions: int) -> Floats:
    """The linear model x' = [x, one-hot a] W that is closest to the data in least squares.

    Parameters
    ----------
    x : ArrayLike
        (n, d), states.
    a : ArrayLike
        (n,), actions in 0..A-1.
    x_next : ArrayLike
        (n, d), the states that followed.
    n_actions : int
        Number of actions, A.

    Returns
    -------
    Floats
        W, (d + A, d).

    Notes
    -----
    Ledger: alg-model-learning, fig-7.

    Examples
    --------
    >>> from rlcore import fit_linear_dynamics
    >>> fit_linear_dynamics([[0.0], [1.0], [1.0]], [0, 0, 1], [[1.0], [2.0], [0.0]], 2).round(6)
    array([[ 1.],
           [ 1.],
           [-1.]])
    """
    return np.linalg.lstsq(_features(x, a, n_actions), x_next, rcond=None)[0]


def _fitted(name, W, given):
    W = array("d + A", "d")(name, W, given)
    if len(W) <= W.shape[1]:
        raise ValueError(f"{name}: got shape {W.shape}, must be (d + A, d) with at least one action")
    return W


def _states(name, x, given):
    x, d = finite(name, x), given["W"].shape[1]
    if x.ndim != 2 or x.shape[1] != d:
        raise ValueError(f"{name}: got shape {x.shape}, must be (n, {d})")
    return x


@checked(W=_fitted, x=_states, a=_actions_below(lambda given: len(given["W"]) - given["W"].shape[1]))
def linear_dynamics(W: ArrayLike, x: ArrayLike, a: ArrayLike) -> Floats:
    """Next states that the fitted model predicts.

    Parameters
    ----------
    W : ArrayLike
        (d + A, d), as `fit_linear_dynamics` gives it.
    x : ArrayLike
        (n, d), states.
    a : ArrayLike
        (n,), actions.

    Returns
    -------
    Floats
        (n, d).

    Notes
    -----
    Ledger: eq-u-dynamics.
    """
    return _features(x, a, W.shape[0] - W.shape[1]) @ W


def _features(x, a, n_actions):
    return np.hstack([x, np.eye(n_actions)[a]])


def _plans(name, actions, given):
    finite(name, actions)
    if np.ndim(actions) != 2 or np.shape(actions)[1] != len(given["x"]):
        raise ValueError(f"{name}: got shape {np.shape(actions)}, must be (T, {len(given['x'])})")
    return np.asarray(actions)


@checked(model=function_of("(x, a)"), x=array("n", "d"), actions=_plans)
def simulate(model: Callable[[Floats, Ints], Floats], x: ArrayLike, actions: ArrayLike) -> Floats:
    """States that n runs of the model visit.

    Parameters
    ----------
    model : Callable[[Floats, Ints], Floats]
        Gives model(x, a), the next states (n, d) of n states at once.
    x : ArrayLike
        (n, d), first states.
    actions : ArrayLike
        (T, n).

    Returns
    -------
    Floats
        (T + 1, n, d).

    Notes
    -----
    Ledger: cl-026, fig-7.
    """
    path = [x]
    for a in actions:
        path.append(model(path[-1], a))
    return np.array(path)


@checked(model=function_of("(x, a)"), cost=function_of("x"), x=array("d"), n_candidates=sized("horizon"))
def random_shooting(
    model: Callable[[Floats, Ints], Floats], cost: Callable[[Floats], Floats], x: ArrayLike, n_actions: int, *,
    horizon: int, n_candidates: int, rng: Rng,
) -> int:  # fmt: skip
    """First action of the cheapest of n_candidates random plans, each simulated `horizon` steps in the model.

    Planned anew at each step, this is model-predictive control.

    Parameters
    ----------
    model : Callable[[Floats, Ints], Floats]
        Gives model(x, a), the next states (n, d) of n states at once.
    cost : Callable[[Floats], Floats]
        Gives cost(x), (n,), which is added up over the states met.
    x : ArrayLike
        (d,), the state now.
    n_actions : int
        Number of actions, A.
    horizon : int
        Steps of a plan.
    n_candidates : int
        Number of plans.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    int
        An action.

    Notes
    -----
    Ledger: alg-mpc.

    References
    ----------
    Nagabandi et al. (2018).

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import random_shooting
    >>> model, cost = lambda x, a: x + np.where(a, 1.0, -1.0)[:, None], lambda x: np.abs(x - 3.0)[:, 0]
    >>> random_shooting(model, cost, [0.0], 2, horizon=3, n_candidates=50, rng=np.random.default_rng(0))
    1
    """
    plans = (rng.random((horizon, n_candidates)) * n_actions).astype(int)
    path = simulate(model, np.tile(x, (n_candidates, 1)), plans)
    return int(plans[0, sum(cost(states) for states in path[1:]).argmin()])
