"""Learning from labels, and from outcomes in their place: the way from one to the other (chapter 8)."""

from __future__ import annotations

import itertools

import numpy as np

from rlcore.core.checks import (
    as_flags,
    as_floats,
    check_count,
    check_finite,
    check_nonnegative,
    check_positive,
    check_probability,
)
from rlcore.core.results import Run
from rlcore.core.rules import anything, array, checked, count, rules
from rlcore.core.samples import check_labels, finite_numbers
from rlcore.core.types import ArrayLike, Flags, Floats, Network, Rng, Rule, World
from rlcore.distributions import Categorical
from rlcore.mdp import FiniteMDP
from rlcore.nn import network
from rlcore.reinforce import reinforce


def _label(name, label, given):
    """The rule of labels, one for each sample, below the number of the net's outputs."""
    outputs = given["net"].forward(given["x"])
    return check_labels(name, label, outputs.shape[-1], outputs.shape[:-1])


LABELLED: dict[str, Rule] = dict(net=network, x=finite_numbers, label=_label)


@checked(**LABELLED)
def supervised_logprob_grad(net: Network, x: ArrayLike, label: int) -> Floats:
    """Gradient of ln p(label | x) with respect to the network's parameters.

    Parameters
    ----------
    net : Network
        Its outputs are logits.
    x : ArrayLike
        (d,) or (B, d).
    label : int
        A class, or (B,) of them, which are summed.

    Returns
    -------
    Floats
        (P,).

    Notes
    -----
    Ledger: eq-ppo-40, alg-supervised-logprob.
    """
    return net.backward(Categorical(net.forward(x)).grad_log_prob(label))  # eq-ppo-40


@checked(**LABELLED, weight=check_finite)
def supervised_logprob_step(
    net: Network, x: ArrayLike, label: int, lr: float, *, weight: float = 1.0
) -> tuple[Floats, Floats]:
    """One ascent step on weight ln p(label | x), theta changed in place.

    Parameters
    ----------
    net : Network
        Its outputs are logits.
    x : ArrayLike
        (d,) or (B, d).
    label : int
        A class, or (B,) of them.
    lr : float
        Step size.
    weight : float
        What is put on the log probability: 1 for the right label, +1 or -1 for a drawn action and its outcome.

    Returns
    -------
    before : Floats
        ln p before the step, a number or (B,).
    after : Floats
        ln p after it.

    Notes
    -----
    Ledger: alg-supervised-logprob, fig-57, ex-up-down.
    """
    before = Categorical(net.forward(x)).log_prob(label)
    net.theta += (lr * weight * supervised_logprob_grad.unchecked(net, x, label)).astype(net.theta.dtype)
    return before, Categorical(net.forward(x)).log_prob(label)


@checked(world=anything, features=anything, alpha=anything)
def episode_outcome_pg(world: World, n_episodes: int, *, features: ArrayLike, alpha: float, rng: Rng) -> Run:
    """Gradient of every action of an episode, times +1 or -1 once its outcome is known.

    It is `reinforce` without discount or baseline.

    Parameters
    ----------
    world : World
        It pays +1 or -1 at the end, else 0.
    n_episodes : int
        Episodes.
    features : ArrayLike
        As of `reinforce`.
    alpha : float
        Step size.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Run
        history holds theta before and after, (2, A, d).

    Notes
    -----
    Ledger: alg-pg-plus-minus, ex-outcome, cl-120.
    """
    return reinforce(world, 1.0, n_episodes, alpha=alpha, features=features, record=n_episodes, rng=rng)


def _n_classes(name, A, given):
    A = check_count(name, A)
    given["labels"] = check_labels("labels", given["labels"], A)
    if given["labels"].ndim != 1:
        raise ValueError(f"labels: got shape {given['labels'].shape}, must be (n,)")
    return A


@checked(labels=anything, n_classes=_n_classes)
def label_bandit(labels: ArrayLike, n_classes: int) -> FiniteMDP:
    """Labels as a process: a picture at random, an action for its class, reward 1 if right, the end.

    Parameters
    ----------
    labels : ArrayLike
        (n,), classes.
    n_classes : int
        A.

    Returns
    -------
    FiniteMDP
        State i is picture i, state n the end: features for it are a row to append.

    Notes
    -----
    Ledger: cl-117, alg-supervised-logprob.
    """
    n, A = labels.size, n_classes
    next_state, terminal = np.full((n + 1, A, 1), n), np.arange(n + 1) == n
    reward, start = np.zeros((n + 1, A, 1)), np.append(np.full(n, 1 / n), 0.0)
    reward[np.arange(n), labels] = 1.0
    return FiniteMDP(next_state, np.ones((n + 1, A, 1)), reward, np.ones((n + 1, A), bool), terminal, start)


def concept_cards() -> tuple[Floats, Flags, list[str]]:
    """Twelve cards, each "red or square" or not.

    Returns
    -------
    features : Floats
        (12, 7), 0 or 1: circle, square, triangle, red, blue, small, large.
    labels : Flags
        (12,), whether "red or square".
    names : list[str]
        What they are.

    Notes
    -----
    Ledger: ex-concept-learning.
    """
    kinds = [("circle", "square", "triangle"), ("red", "blue"), ("small", "large")]
    cards = list(itertools.product(*kinds))
    x = np.array([[float(word in card) for kind in kinds for word in kind] for card in cards])
    y = np.array([int("red" in card or "square" in card) for card in cards])
    return x, y, [f"{size} {colour} {shape}" for shape, colour, size in cards]


# ---------------------------------------------------------------------- recommendations


@checked(**rules(count(), "n_users n_items rank"))
def make_ratings(n_users: int = 200, n_items: int = 50, rank: int = 3, *, rng: Rng) -> Floats:
    """What users think of items: products of normal vectors of tastes.

    Parameters
    ----------
    n_users : int
        U.
    n_items : int
        I.
    rank : int
        Numbers of a vector.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    Floats
        (n_users, n_items).

    Notes
    -----
    Ledger: ex-netflix.
    """
    return rng.normal(size=(n_users, rank)) @ rng.normal(size=(rank, n_items)) / np.sqrt(rank)


def _known(name, known, given):
    known, shape = as_flags(name, known), given["ratings"].shape
    if known.shape != shape:
        raise ValueError(f"{name}: got shape {known.shape}, must be that of ratings, {shape}")
    if not np.isfinite(given["ratings"][known]).all():
        raise ValueError("ratings: a known one is not finite, must be a number")
    return known


def _items(name, items, given):
    items = array("I", "rank")(name, items, given)
    if len(items) != given["ratings"].shape[1]:
        raise ValueError(f"{name}: got shape {items.shape}, must be ({given['ratings'].shape[1]}, rank)")
    return items


@checked(ratings=array("U", "I", kind=as_floats), known=_known, items=_items, n_sweeps=count(), penalty=check_positive)
def factorise(
    ratings: ArrayLike, known: ArrayLike, items: ArrayLike, *, n_sweeps: int = 20, penalty: float = 0.1
) -> tuple[Floats, Floats]:
    """Vectors of users and items whose products fit the known ratings, by alternating least squares.

    Parameters
    ----------
    ratings : ArrayLike
        (U, I).
    known : ArrayLike
        (U, I), bool.
    items : ArrayLike
        (I, rank), where to start.
    n_sweeps : int
        Sweeps over users and items.
    penalty : float
        On the squared length of the vectors.

    Returns
    -------
    users : Floats
        (U, rank).
    items : Floats
        (I, rank): users @ items.T predicts.

    Raises
    ------
    ValueError
        Where ratings are too large for the penalty.

    Notes
    -----
    Ledger: ex-netflix.

    References
    ----------
    Koren et al. (2009).
    """
    known, seen = known.astype(float), np.where(known, ratings, 0.0)
    for _ in range(n_sweeps):
        users = _least_squares(items, seen, known, penalty)
        items = _least_squares(users, seen.T, known.T, penalty)
    return users, items


def _noise(name, noise, given):
    if check_nonnegative(name, noise) > 1000:
        raise ValueError(f"{name}: got {noise}, must be a number from 0 to 1,000")
    return float(noise)


def _least_squares(vectors, seen, known, penalty):
    """For each row of seen the vector whose products with `vectors` fit what is known of it."""
    squares = np.einsum("ui,ij,ik->ujk", known, vectors, vectors, optimize=True) + penalty * np.eye(vectors.shape[1])
    try:
        return np.linalg.solve(squares, (seen @ vectors)[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        largest = f"up to {np.abs(seen).max():g} with penalty {penalty:g}"
        raise ValueError(f"ratings: {largest}, must be smaller, or the penalty larger") from None


@checked(truth=array("U", "I"), n_rounds=count(), epsilon=check_probability, noise=_noise)
def recommend(
    truth: ArrayLike, n_rounds: int, *, epsilon: float, noise: float = 0.3, rng: Rng
) -> tuple[Floats, Floats]:
    """How well a recommender does that learns from what it shows.

    In each round every user is shown one item, and only that one gets a rating; then all is predicted anew.

    Parameters
    ----------
    truth : ArrayLike
        (U, I), the true ratings.
    n_rounds : int
        Rounds.
    epsilon : float
        Probability that a user is shown any item, not the best by prediction.
    noise : float
        Deviation of a rating, from 0 to 1,000.
    rng : Rng
        What everything random is drawn from.

    Returns
    -------
    shown : Floats
        (n_rounds,), mean true rating of what each round shows: it counts what exploring costs.
    best : Floats
        (n_rounds,), of the best guess after it: only what is known by then.

    Notes
    -----
    Ledger: ex-netflix.
    """
    users, total, seen = np.arange(len(truth)), np.zeros_like(truth), np.zeros_like(truth)
    best, ratings = rng.integers(truth.shape[1], size=len(truth)), []
    items = rng.normal(size=(truth.shape[1], 3))
    for _ in range(n_rounds):
        explore = rng.random(len(truth)) < epsilon
        shown = np.where(explore, rng.integers(truth.shape[1], size=len(truth)), best)
        total[users, shown] += truth[users, shown] + noise * rng.normal(size=len(truth))
        seen[users, shown] += 1
        tastes, items = factorise(total / np.maximum(seen, 1), seen > 0, items, n_sweeps=2)
        best = (tastes @ items.T).argmax(axis=1)
        ratings.append((truth[users, shown].mean(), truth[users, best].mean()))
    return tuple(np.array(ratings).T)
