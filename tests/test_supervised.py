"""From labels to outcomes: gradients by identities, then what is learned from either."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rlcore.envs import catch, catch_pixels
from rlcore.mdp import rollout
from rlcore.nn import MLP, backprop
from rlcore.policies import softmax_policy
from rlcore.policy_gradient import episode_gradient, policy_gradient_exact
from rlcore.studies import ch08 as sup
from rlcore.studies.ch06 import load_digits_28


def rng(seed=0):
    return np.random.default_rng(seed)


def net(sizes=(50, 2), seed=0, **more):
    return MLP(list(sizes), dtype=np.float64, rng=rng(seed), **more)


X, LABELS = rng(1).random((6, 50)), np.array([0, 1, 1, 0, 1, 0])


# ---------------------------------------------------------------------- labels


def test_gradient_of_a_logistic_unit_is_one_minus_p_times_x():
    unit, x = net(), X[0]
    p = 1 / (1 + np.exp(unit.forward(x)[0] - unit.forward(x)[1]))
    g = sup.supervised_logprob_grad(unit, x, 1)
    assert_allclose(g[50:100], (1 - p) * x, rtol=1e-12)  # weights of class 1; those of class 0 get the opposite
    assert_allclose(g[:50], -(1 - p) * x, rtol=1e-12)
    assert_allclose(g[100:], [-(1 - p), 1 - p], rtol=1e-12)


@pytest.mark.parametrize("label", [0, 1])
def test_gradient_is_that_of_central_differences(label):
    n, x = net((50, 4, 2)), X[0]
    g, i = sup.supervised_logprob_grad(n, x, label), rng(2).permutation(n.n_parameters)[:20]
    for j in i:
        values = []
        for h in (1e-5, -1e-5):
            twin = n.copy()
            twin.theta[j] += h
            z = twin.forward(x)
            values.append(z[label] - np.log(np.exp(z).sum()))
        assert g[j] == pytest.approx((values[0] - values[1]) / 2e-5, rel=1e-6, abs=1e-8)


def test_ascent_on_log_p_is_descent_on_the_cross_entropy():
    n = net((50, 4, 2))
    ours = sup.supervised_logprob_grad(n, X, LABELS)
    assert_allclose(ours, -len(X) * backprop(n, X, LABELS, "cross_entropy")[1], rtol=1e-12)
    assert_allclose(ours, sum(sup.supervised_logprob_grad(n, x, a) for x, a in zip(X, LABELS)), rtol=1e-9)


@pytest.mark.parametrize("weight, sign", [(1.0, 1), (-1.0, -1), (0.5, 1)])
def test_a_small_step_raises_log_p_by_its_slope(weight, sign):
    n = net((50, 4, 2))
    g = sup.supervised_logprob_grad(n, X[0], 1)
    theta = n.theta.copy()
    before, after = sup.supervised_logprob_step(n, X[0], 1, 1e-4, weight=weight)
    assert_allclose(n.theta - theta, 1e-4 * weight * g, rtol=1e-9)
    assert after - before == pytest.approx(1e-4 * weight * g @ g, rel=1e-2) and np.sign(after - before) == sign


def test_a_million_parameters_take_the_same_step():
    wide = MLP([50, 20_000, 2], rng=rng())
    before, after = sup.supervised_logprob_step(wide, catch_pixels()[60], 0, 1e-4)
    assert wide.n_parameters == 1_060_002 and wide.theta.dtype == np.float32 and after > before


@pytest.mark.long
def test_the_concept_is_learned_from_labels():
    x, y, names = sup.concept_cards()
    assert x.shape == (12, 7) and (x.sum(axis=1) == 3).all() and len(set(names)) == 12
    assert (
        y.sum() == 8 and dict(zip(names, y))["small blue square"] == 1 and not dict(zip(names, y))["large blue circle"]
    )
    assert (x[[name.endswith("square") for name in names], 1] == 1).all() and x[names.index("small red circle"), 3] == 1
    right = []
    for seed in range(20):
        order, n = rng(seed).permutation(12), MLP([7, 2], init="zeros", rng=None)
        for _ in range(300):
            sup.supervised_logprob_step(n, x[order[:8]], y[order[:8]], 0.1)
        right.append((n.forward(x[order[8:]]).argmax(axis=1) == y[order[8:]]).mean())
    assert np.mean(right) > 0.8  # 0.88 over 100 splits; always "yes" is right on 0.67


# ---------------------------------------------------------------------- outcomes


def test_filling_in_the_outcome_is_the_score_of_every_action_times_it():
    world, features = catch(), np.c_[catch_pixels(), np.ones(250)]
    for seed in range(6):
        run = sup.episode_outcome_pg(world, 1, features=features, alpha=0.05, rng=rng(seed))
        assert run.history.shape == (2, 3, 51) and not run.history[0].any() and run.returns[0] in (-1, 1)
        change = (run.history[1] - run.history[0]) / 0.05
        # 9 scores at theta = 0, 1 - 1/3 for the action taken, all times the outcome: the constant feature counts them
        assert_allclose(run.returns[0] * change[:, -1] + 3, np.round(run.returns[0] * change[:, -1] + 3), atol=1e-9)
        assert (run.returns[0] * change[:, -1] + 3).sum() == pytest.approx(9)


def test_the_outcome_gradient_of_a_given_episode():
    world, features = catch(), catch_pixels().astype(float)
    theta = rng(3).normal(size=(3, 50))
    path = rollout(world, softmax_policy(theta, features), 20, rng=rng(4))
    scores = episode_gradient(theta, path.states, path.actions, np.r_[np.zeros(8), 1.0], 1.0, features=features)
    g = episode_gradient(theta, path.states, path.actions, path.rewards, 1.0, features=features)
    assert_allclose(g, path.rewards[-1] * scores)


@pytest.mark.long
def test_catch_is_learned_with_a_small_step_more_often_than_with_a_large_one():
    features = np.c_[catch_pixels(), np.ones(250)]
    rates = {
        alpha: [
            (1 + sup.episode_outcome_pg(catch(), 6000, features=features, alpha=alpha, rng=rng(s)).returns) / 2
            for s in range(20)
        ]
        for alpha in (0.05, 0.2)
    }
    first = np.mean([r[:200].mean() for r in rates[0.05]])
    last = {alpha: np.array([r[-500:].mean() for r in runs]) for alpha, runs in rates.items()}
    assert 0.18 < first < 0.26  # random play catches 0.2
    # 60 seeds: at 0.05 a mean of 0.81, worst 0.20, 0.53 of them at 0.9 or more; at 0.2 0.53, 0.18, 0.15
    assert last[0.05].mean() > last[0.2].mean() + 0.1 and (last[0.05] > 0.9).sum() > (last[0.2] > 0.9).sum()
    assert last[0.05].max() > 0.95 and last[0.2].min() < 0.3


def test_label_bandit_pays_for_the_right_label_only():
    world = sup.label_bandit(LABELS, 3)
    assert world.n_states == 7 and world.terminal.tolist() == [False] * 6 + [True]
    assert (world.reward[:6, :, 0] == np.eye(3)[LABELS]).all() and (world.next_state[:6] == 6).all()
    assert_allclose(world.start, [1 / 6] * 6 + [0])


def test_the_bandit_gradient_is_the_supervised_one_times_the_probability_of_the_label():
    n, features = net((50, 2)), np.vstack([np.c_[X, np.ones(6)], np.zeros(51)])
    theta = np.c_[n.weights[0], n.biases[0]]
    exact = policy_gradient_exact(sup.label_bandit(LABELS, 2), theta, 1.0, features=features)
    expected = 0
    for x, label in zip(X, LABELS):
        g = sup.supervised_logprob_grad(n, x, label)
        p = softmax_policy(theta, np.append(x, 1.0)[None])[0, label]
        expected = expected + p * np.c_[g[:100].reshape(2, 50), g[100:]] / 6
    assert_allclose(exact, expected, rtol=1e-10)


def test_digits_from_labels():
    x, labels, x_test, labels_test = load_digits_28(size=8, n_train=1500, rng=rng())
    for lr in (0.03, 0.1, 0.3):
        n, r = MLP([64, 10], init="zeros", rng=None), rng(1)
        for i in r.integers(1500, size=1500):
            sup.supervised_logprob_step(n, x[i], labels[i], lr)
        assert (n.forward(x_test).argmax(axis=1) == labels_test).mean() > 0.86  # 0.89 to 0.95; seeds 0, 1 worst 0.889


# ---------------------------------------------------------------------- recommendations


def test_ratings_have_their_rank_and_are_recovered_from_some():
    truth = sup.make_ratings(rng=rng())
    assert truth.shape == (200, 50) and np.linalg.matrix_rank(truth) == 3
    known = rng(1).random(truth.shape) < 0.4
    users, items = sup.factorise(truth, known, rng(2).normal(size=(50, 3)), penalty=1e-6, n_sweeps=100)
    assert users.shape == (200, 3) and items.shape == (50, 3)
    assert_allclose(users @ items.T, truth, atol=1e-3)
    again, _ = sup.factorise(
        np.where(known, truth, 99.0), known, rng(2).normal(size=(50, 3)), penalty=1e-6, n_sweeps=100
    )
    assert_allclose(again, users)  # what is not known is not looked at


def test_the_penalty_shortens_the_vectors():
    truth, start = sup.make_ratings(20, 10, rng=rng()), rng(2).normal(size=(10, 3))
    sizes = [np.abs(sup.factorise(truth, np.ones((20, 10)), start, penalty=p)[0]).mean() for p in (0.01, 5.0)]
    assert sizes[1] < 0.9 * sizes[0]


def test_who_never_explores_knows_less_and_shows_more():
    shown, known = np.zeros((2, 4)), np.zeros((2, 4))
    for i, epsilon in enumerate((0.0, 0.1)):
        for seed in range(4):
            truth = sup.make_ratings(rng=rng(seed))
            ratings, guesses = sup.recommend(truth, 40, epsilon=epsilon, rng=rng(1))
            shown[i, seed], known[i, seed] = np.array([ratings[-10:].mean(), guesses[-1]]) / truth.max(axis=1).mean()
    (greedy, exploring), (greedy_shown, exploring_shown) = 1 - known.mean(axis=1), shown.mean(axis=1)
    assert exploring < 0.03 < 0.05 < greedy  # worlds 0 to 5: greedy 0.01 to 0.13, exploring 0.01 or less
    assert exploring_shown < 0.9 < greedy_shown  # 0.88 and 0.92: one in ten shown at random is worth 0


def test_what_is_shown_is_the_guess_of_the_round_before_or_any():
    truth = sup.make_ratings(rng=rng())
    shown, guesses = sup.recommend(truth, 6, epsilon=0.0, rng=rng(1))
    assert shown.shape == guesses.shape == (6,)
    assert_allclose(shown[1:], guesses[:-1])
    at_random, guesses = sup.recommend(truth, 40, epsilon=1.0, rng=rng(1))
    assert abs(at_random.mean() - truth.mean()) < 0.05  # 8,000 ratings of spread 1: standard error 0.011
    assert guesses[-1] > 0.95 * truth.max(axis=1).mean()  # 0.99


# ---------------------------------------------------------------------- bad input

ONES = np.ones((3, 2))
BAD = {
    "a class too many": (lambda: sup.supervised_logprob_grad(net(), X[0], 2), "label: got 2..2, must be in 0..1"),
    "half a class": (lambda: sup.supervised_logprob_grad(net(), X[0], 0.5), "label: got dtype float64, must be"),
    "labels of another length": (lambda: sup.supervised_logprob_grad(net(), X, LABELS[:2]), "label: got shape (2,)"),
    "pixels of another number": (lambda: sup.supervised_logprob_grad(net(), X[0, :9], 0), "x: got shape (9,)"),
    "step 0": (lambda: sup.supervised_logprob_step(net(), X[0], 0, 0.0), "lr: got 0.0, must be a positive number"),
    "a weight for each": (
        lambda: sup.supervised_logprob_step(net(), X, LABELS, 0.1, weight=np.ones(6)), "weight: got array([1., 1.",
    ),
    "weight nan": (lambda: sup.supervised_logprob_step(net(), X, LABELS, 0.1, weight=np.nan), "weight: got nan"),
    "no episodes": (
        lambda: sup.episode_outcome_pg(catch(), 0, features=None, alpha=0.1, rng=rng()), "n_episodes: got 0",
    ),
    "no labels": (lambda: sup.label_bandit([], 3), "labels: got shape (0,), must be (n,)"),
    "a label too high": (lambda: sup.label_bandit([0, 3], 3), "labels: got 0..3, must be in 0..2"),
    "labels in words": (lambda: sup.label_bandit(["cat"], 3), "labels: got dtype"),
    "no users": (lambda: sup.make_ratings(0, rng=rng()), "n_users: got 0"),
    "no rng": (lambda: sup.make_ratings(rng=1), "rng: got 1, must be a numpy.random.Generator"),
    "known of another shape": (lambda: sup.factorise(ONES, ONES.T, ONES), "known: got shape (2, 3), must be"),
    "items of another number": (lambda: sup.factorise(ONES, ONES, ONES), "items: got shape (3, 2), must be (2, rank)"),
    "penalty 0": (lambda: sup.factorise(ONES, ONES, ONES[:2], penalty=0), "penalty: got 0, must be a positive number"),
    "epsilon above 1": (lambda: sup.recommend(ONES, 2, epsilon=1.5, rng=rng()), "epsilon: got 1.5"),
    "a truth of one dimension": (lambda: sup.recommend([1.0], 2, epsilon=0.1, rng=rng()), "truth: got shape (1,)"),
    "no rounds": (lambda: sup.recommend(ONES, 0, epsilon=0.1, rng=rng()), "n_rounds: got 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    call, message = BAD[case]
    with pytest.raises(ValueError) as caught:
        call()
    assert str(caught.value).startswith(message)
