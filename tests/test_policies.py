import numpy as np
import pytest

from rlcore import neurons
from rlcore.distributions import Categorical, Gaussian
from rlcore.neurons import log_softmax, softmax

B, A, D = 7, 4, 3
TOLERANCE = {np.float32: 1e-5, np.float64: 1e-10}


def rng(seed=0):
    return np.random.default_rng(seed)


def categoricals(dtype=np.float64):
    logits = rng(1).normal(scale=2.0, size=(2, B, A)).astype(dtype)
    return Categorical(logits[0]), Categorical(logits[1]), rng(2).integers(A, size=B)


def gaussians(dtype=np.float64, shared=False):
    mean, log_std = rng(1).normal(size=(2, B, D)).astype(dtype), rng(2).normal(scale=0.5, size=(2, B, D)).astype(dtype)
    if shared:
        log_std = log_std[:, 0]
    return *(Gaussian(m, s) for m, s in zip(mean, log_std)), rng(3).normal(size=(B, D)).astype(dtype)


def outputs(policy):
    return (policy.logits,) if isinstance(policy, Categorical) else (policy.mean, policy.log_std)


def pair(gradient):
    return gradient if isinstance(gradient, tuple) else (gradient,)


def quantities(old, new, a):
    """Name, value as a function of the outputs of `new`, closed-form gradient."""
    make = type(new)
    return [
        ("log_prob", lambda *out: make(*out).log_prob(a), new.grad_log_prob(a)),
        ("entropy", lambda *out: make(*out).entropy(), new.grad_entropy()),
        ("kl", lambda *out: old.kl(make(*out)), old.grad_kl(new)),
    ]


@pytest.mark.parametrize("make", [categoricals, gaussians])
def test_gradients_equal_finite_differences(make):
    old, new, a = make()
    for name, value, gradient in quantities(old, new, a):
        for i, (out, g) in enumerate(zip(outputs(new), pair(gradient))):
            for j in range(out.shape[1]):
                h = np.zeros_like(out)
                h[:, j] = 1e-6
                moved = [[*outputs(new)] for _ in range(2)]
                moved[0][i], moved[1][i] = out + h, out - h
                slope = (value(*moved[0]) - value(*moved[1])) / 2e-6
                np.testing.assert_allclose(g[:, j], slope, rtol=1e-7, atol=1e-8, err_msg=name)


def torch_policy(policy, parts):
    import torch

    if isinstance(policy, Categorical):
        return torch.distributions.Categorical(logits=parts[0])
    return torch.distributions.Independent(torch.distributions.Normal(parts[0], parts[1].exp()), 1)


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize("make", [categoricals, gaussians])
def test_values_and_gradients_equal_autograd(make, dtype):
    torch = pytest.importorskip("torch")
    old, new, a = make(dtype)
    tolerance = dict(rtol=TOLERANCE[dtype], atol=TOLERANCE[dtype])
    parts = [torch.tensor(np.array(out), requires_grad=True) for out in outputs(new)]
    theirs = torch_policy(new, parts)
    fixed = torch_policy(old, [torch.tensor(np.array(out)) for out in outputs(old)])
    values = [
        (new.log_prob(a), theirs.log_prob(torch.tensor(a)), new.grad_log_prob(a)),
        (new.entropy(), theirs.entropy(), new.grad_entropy()),
        (old.kl(new), torch.distributions.kl_divergence(fixed, theirs), old.grad_kl(new)),
    ]
    for ours, value, gradient in values:
        assert ours.dtype == dtype
        np.testing.assert_allclose(ours, value.detach(), **tolerance)
        expected = torch.autograd.grad(value.sum(), parts, allow_unused=True, retain_graph=True)
        for g, e in zip(pair(gradient), expected):
            assert g.dtype == dtype
            np.testing.assert_allclose(g, np.zeros_like(g) if e is None else e, **tolerance)


def test_the_score_has_mean_zero():
    new = categoricals()[1]
    scores = [new.grad_log_prob(np.full(B, a)) for a in range(A)]
    np.testing.assert_allclose(sum(p[:, None] * g for p, g in zip(new.probs.T, scores)), 0, atol=1e-15)
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)  # exact integrals of polynomials against the normal density
    for z_power, exact in ((1, 0.0), (2, 1.0)):
        assert weights @ nodes**z_power / weights.sum() == pytest.approx(exact, abs=1e-14)
    g = Gaussian(np.full((20, 1), 0.3), np.array([-0.7]))
    d_mean, d_log_std = g.grad_log_prob(0.3 + np.exp(-0.7) * nodes[:, None])
    np.testing.assert_allclose([weights @ d_mean[:, 0], weights @ d_log_std[:, 0]], 0, atol=1e-13)


def test_score_is_the_gradient_of_pi_over_pi():
    logits, h = rng(4).normal(size=A), 1e-6
    for a in range(A):
        slopes = [
            (Categorical(logits + h * e).probs[a] - Categorical(logits - h * e).probs[a]) / (2 * h) for e in np.eye(A)
        ]
        policy = Categorical(logits)
        np.testing.assert_allclose(np.array(slopes) / policy.probs[a], policy.grad_log_prob(a), rtol=0, atol=1e-9)


def test_closed_forms():
    even = Categorical(np.zeros((1, 4)))
    assert even.entropy()[0] == pytest.approx(np.log(4), abs=1e-15)
    np.testing.assert_allclose(even.grad_entropy(), 0, atol=1e-16)
    assert Categorical([0.0, 1.0]).probs[1] == pytest.approx(1 / (1 + np.exp(-1)), abs=1e-15)
    unit = Gaussian(np.zeros(1), np.zeros(1))
    assert unit.entropy() == pytest.approx(1.4189385332046727, abs=1e-15)
    assert unit.log_prob(np.zeros(1)) == pytest.approx(-0.9189385332046727, abs=1e-15)
    assert unit.kl(Gaussian(np.array([2.0]), np.zeros(1))) == pytest.approx(2.0, abs=1e-15)
    wide = Gaussian(np.zeros(1), np.log([3.0]))
    assert unit.kl(wide) == pytest.approx(np.log(3) + 1 / 18 - 0.5, abs=1e-15)
    assert wide.kl(unit) == pytest.approx(-np.log(3) + 4.5 - 0.5, abs=1e-14)


@pytest.mark.parametrize("make", [categoricals, gaussians])
def test_kl_is_zero_and_flat_at_itself_and_positive_elsewhere(make):
    old, new, _ = make()
    np.testing.assert_allclose(old.kl(old), 0, atol=1e-15)
    for g in pair(old.grad_kl(old)):
        np.testing.assert_allclose(g, 0, atol=1e-15)
    assert (old.kl(new) > 0).all() and (new.kl(old) > 0).all()


def test_a_shared_spread_is_that_spread_in_every_row():
    old, new, a = gaussians(shared=True)
    full = Gaussian(new.mean, np.tile(new.log_std[0], (B, 1)))
    assert new.log_std.shape == (B, D)
    np.testing.assert_array_equal(new.log_prob(a), full.log_prob(a))
    np.testing.assert_array_equal(old.kl(new), old.kl(full))


def test_large_and_shifted_logits_are_safe():
    logits = np.array([[1e4, -1e4, 0.0], [-1e30, 1e30, 0.0]])
    policy = Categorical(logits)
    for values in (policy.probs, policy.entropy(), policy.grad_entropy(), policy.kl(policy), policy.log_probs):
        assert np.isfinite(values).all()
    np.testing.assert_array_equal(policy.probs, [[1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(log_softmax(np.array([1.0, 2.0])), log_softmax(np.array([1001.0, 1002.0])), atol=1e-12)
    np.testing.assert_allclose(softmax(np.log([[1.0, 3.0], [2.0, 2.0]])), [[0.25, 0.75], [0.5, 0.5]], atol=1e-15)
    assert neurons.log_softmax is log_softmax and neurons.softmax is softmax, "written once"
    assert softmax(np.float32([1, 2])).dtype == np.float32


def test_samples_follow_the_policy():
    """n = 40,000: standard errors below 0.0025; bands of 4 of them."""
    n = 40_000
    logits = np.log([0.5, 0.3, 0.2])
    counts = np.bincount(Categorical(np.tile(logits, (n, 1))).sample(rng(5)), minlength=3) / n
    np.testing.assert_allclose(counts, [0.5, 0.3, 0.2], atol=0.01)
    a = Gaussian(np.tile([1.0, -2.0], (n, 1)), np.log([0.5, 2.0])).sample(rng(6))
    np.testing.assert_allclose(a.mean(axis=0), [1, -2], atol=4 * 2 / n**0.5)
    np.testing.assert_allclose(a.std(axis=0), [0.5, 2.0], rtol=0.02)
    assert np.corrcoef(a.T)[0, 1] == pytest.approx(0, abs=4 / n**0.5)


@pytest.mark.parametrize("make", [categoricals, gaussians])
def test_same_rng_same_actions_of_the_right_kind(make):
    for dtype in TOLERANCE:
        policy = make(dtype)[0]
        a, again = policy.sample(rng(7)), policy.sample(rng(7))
        np.testing.assert_array_equal(a, again)
        assert a.dtype == dtype if isinstance(policy, Gaussian) else a.dtype.kind == "i"
        assert policy.log_prob(a).shape == (B,)
    one = Categorical(np.zeros(3)).sample(rng(1))
    assert np.ndim(one) == 0 and 0 <= one < 3


def test_an_action_without_probability_is_never_drawn():
    policy = Categorical(np.tile([0.0, -800.0, 0.0, -800.0], (1000, 1)))
    assert set(policy.sample(rng(8))) == {0, 2}


CATEGORICAL, GAUSSIAN = Categorical(np.zeros((2, 3))), Gaussian(np.zeros((2, 3)), np.zeros(3))


@pytest.mark.parametrize(
    "call, name",
    [
        (lambda: Categorical([[0.0, np.nan]]), "logits"),
        (lambda: Categorical([[0.0, np.inf]]), "logits"),
        (lambda: Categorical(1.0), "logits"),
        (lambda: Categorical(np.zeros((3, 0))), "logits"),
        (lambda: Categorical(["a", "b"]), "logits"),
        (lambda: CATEGORICAL.log_prob([0, 3]), "a: got 0..3"),
        (lambda: CATEGORICAL.log_prob([-1, 0]), "a: got -1..0"),
        (lambda: CATEGORICAL.log_prob([0.0, 1.0]), "continuous actions need a Gaussian"),
        (lambda: CATEGORICAL.grad_log_prob([0, 1, 2]), "a: got shape"),
        (lambda: CATEGORICAL.kl(GAUSSIAN), "other"),
        (lambda: CATEGORICAL.kl(Categorical(np.zeros((3, 3)))), "other"),
        (lambda: CATEGORICAL.grad_kl(None), "other"),
        (lambda: CATEGORICAL.sample(0), "rng"),
        (lambda: Gaussian([np.nan], [0.0]), "mean"),
        (lambda: Gaussian([0.0], [np.inf]), "log_std"),
        (lambda: Gaussian(np.zeros((2, 3)), np.zeros(2)), "log_std"),
        (lambda: GAUSSIAN.log_prob(np.zeros((2, 2))), "a: got shape"),
        (lambda: GAUSSIAN.kl(CATEGORICAL), "other"),
        (lambda: GAUSSIAN.sample(None), "rng"),
    ],
)
def test_bad_calls_name_the_argument(call, name):
    with pytest.raises(ValueError, match=name):
        call()
