"""Learning from labels, and from outcomes in their place: the way from one to the other (chapter 8)."""

import itertools

import numpy as np

from rlcore.core.checks import as_floats, as_integers, check_count, check_positive, check_probability, check_rng
from rlcore.distributions import Categorical
from rlcore.mdp import FiniteMDP
from rlcore.reinforce import reinforce


def supervised_logprob_grad(net, x, label):
    """Gradient of ln p(label | x) with respect to the network's parameters, (P,). eq-ppo-40, alg-supervised-logprob

    net: MLP or TorchNet whose outputs are logits. x: (d,) or (B, d). label: a class, or (B,) of them, which are summed.
    """
    return net.backward(Categorical(net.forward(x)).grad_log_prob(np.asarray(label)))  # eq-ppo-40


def supervised_logprob_step(net, x, label, lr, *, weight=1.0):
    """One ascent step on weight ln p(label | x), theta changed in place; ln p before and after. fig-57, ex-up-down

    weight: what is put on the log probability: 1 for the right label, +1 or -1 for a drawn action and its outcome.
    lr: step size. Returns two numbers, or two (B,). alg-supervised-logprob
    """
    lr, weight = check_positive("lr", lr), as_floats("weight", weight)
    if weight.shape != () or not np.isfinite(weight):
        raise ValueError(f"weight: got {weight}, must be a finite number")
    before = Categorical(net.forward(x)).log_prob(np.asarray(label))
    net.theta += (lr * weight * supervised_logprob_grad(net, x, label)).astype(net.theta.dtype)
    return before, Categorical(net.forward(x)).log_prob(np.asarray(label))


def episode_outcome_pg(world, n_episodes, *, features, alpha, rng):
    """Gradient of every action of an episode, times +1 or -1 once its outcome is known. alg-pg-plus-minus, ex-outcome

    Arguments and result as for `reinforce`, which this is: without discount or baseline, in a world that pays +1 or -1
    at the end. Run.history holds theta before and after, (2, A, d). cl-120
    """
    n_episodes = check_count("n_episodes", n_episodes)
    return reinforce(world, 1.0, n_episodes, alpha=alpha, features=features, record=n_episodes, rng=rng)


def label_bandit(labels, n_classes):
    """Labels (n,) as a process: a picture at random, an action for its class, reward 1 if right, the end. cl-117

    State i is picture i, state n the end: features for it are a row to append. alg-supervised-logprob
    """
    labels, A = as_integers("labels", labels), check_count("n_classes", n_classes)
    if labels.ndim != 1 or labels.size == 0 or labels.min() < 0 or labels.max() >= A:
        raise ValueError(f"labels: got {labels!r}, must be (n,) whole numbers from 0 to {A - 1}")
    n = labels.size
    next_state, terminal = np.full((n + 1, A, 1), n), np.arange(n + 1) == n
    reward, start = np.zeros((n + 1, A, 1)), np.append(np.full(n, 1 / n), 0.0)
    reward[np.arange(n), labels] = 1.0
    return FiniteMDP(next_state, np.ones((n + 1, A, 1)), reward, np.ones((n + 1, A), bool), terminal, start)


def concept_cards():
    """Twelve cards: features (12, 7), whether each is "red or square" (12,), and their names. ex-concept-learning

    Features are 0 or 1: circle, square, triangle, red, blue, small, large.
    """
    kinds = [("circle", "square", "triangle"), ("red", "blue"), ("small", "large")]
    cards = list(itertools.product(*kinds))
    x = np.array([[float(word in card) for kind in kinds for word in kind] for card in cards])
    y = np.array([int("red" in card or "square" in card) for card in cards])
    return x, y, [f"{size} {colour} {shape}" for shape, colour, size in cards]


# ---------------------------------------------------------------------- recommendations


def make_ratings(n_users=200, n_items=50, rank=3, *, rng):
    """What users think of items, (n_users, n_items): products of normal vectors of `rank` tastes. ex-netflix"""
    shape = check_count("n_users", n_users), check_count("n_items", n_items)
    rank, rng = check_count("rank", rank), check_rng(rng)
    return rng.normal(size=(shape[0], rank)) @ rng.normal(size=(rank, shape[1])) / np.sqrt(rank)


def factorise(ratings, known, items, *, n_sweeps=20, penalty=0.1):
    """Vectors of users and items whose products fit the known ratings, by alternating least squares. ex-netflix

    ratings: (U, I). known: (U, I) bool. items: (I, rank), where to start. penalty: on the squared length of the
    vectors. Returns users (U, rank) and items (I, rank): users @ items.T predicts. Source: Koren et al. (2009).
    """
    ratings, known = as_floats("ratings", ratings), np.asarray(known, float)
    if ratings.ndim != 2 or known.shape != ratings.shape:
        raise ValueError(f"known: got shape {known.shape}, must be that of ratings, {ratings.shape}")
    items, penalty, seen = as_floats("items", items), check_positive("penalty", penalty), np.where(known, ratings, 0.0)
    if items.ndim != 2 or len(items) != ratings.shape[1]:
        raise ValueError(f"items: got shape {items.shape}, must be ({ratings.shape[1]}, rank)")
    for _ in range(check_count("n_sweeps", n_sweeps)):
        users = _least_squares(items, seen, known, penalty)
        items = _least_squares(users, seen.T, known.T, penalty)
    return users, items


def _least_squares(vectors, seen, known, penalty):
    """For each row of seen the vector whose products with `vectors` fit what is known of it."""
    squares = np.einsum("ui,ij,ik->ujk", known, vectors, vectors, optimize=True) + penalty * np.eye(vectors.shape[1])
    return np.linalg.solve(squares, (seen @ vectors)[:, :, None])[:, :, 0]


def recommend(truth, n_rounds, *, epsilon, noise=0.3, rng):
    """True ratings, means over the users: of what each round shows, and of the best guess after it. ex-netflix

    In each round every user is shown one item, the best by prediction or with probability epsilon any, and only that
    one gets a rating, with normal noise; then all is predicted anew from what was rated. truth: (U, I). Returns two
    arrays (n_rounds,). The first counts what exploring costs, the second only what is known by then.
    """
    truth, epsilon, rng = as_floats("truth", truth), check_probability("epsilon", epsilon), check_rng(rng)
    if truth.ndim != 2 or truth.size == 0:
        raise ValueError(f"truth: got shape {truth.shape}, must be (n_users, n_items)")
    users, total, count = np.arange(len(truth)), np.zeros_like(truth), np.zeros_like(truth)
    best, ratings = rng.integers(truth.shape[1], size=len(truth)), []
    items = rng.normal(size=(truth.shape[1], 3))
    for _ in range(check_count("n_rounds", n_rounds)):
        explore = rng.random(len(truth)) < epsilon
        shown = np.where(explore, rng.integers(truth.shape[1], size=len(truth)), best)
        total[users, shown] += truth[users, shown] + noise * rng.normal(size=len(truth))
        count[users, shown] += 1
        tastes, items = factorise(total / np.maximum(count, 1), count > 0, items, n_sweeps=2)
        best = (tastes @ items.T).argmax(axis=1)
        ratings.append((truth[users, shown].mean(), truth[users, best].mean()))
    return tuple(np.array(ratings).T)
