"""The objectives in torch, and the closed-form gradients of rlcore.ppo against autograd's of them."""

import numpy as np
import pytest
from agents import A, make_small, move, rng, samples

from rlcore.distributions import Categorical, Gaussian
from rlcore.nn import MLP
from rlcore.ppo import PPOConfig, improve, objective_gradient
from rlcore.studies.ch08 import supervised_logprob_grad
from rlcore.torchnet import TorchNet

torch = pytest.importorskip("torch")
losses = pytest.importorskip("rlcore.losses")

TOLERANCE = {np.float32: 1e-5, np.float64: 1e-10}
KINDS = pytest.mark.parametrize("discrete", [True, False])


def tensors(*arrays):
    return [torch.tensor(np.asarray(a)) for a in arrays]


def case(discrete, B=6, seed=3):
    """Outputs of a new and an old policy, actions and advantages, as arrays."""
    g = rng(seed)
    if discrete:
        return g.normal(size=(B, 4)), g.normal(size=(B, 4)), g.integers(4, size=B), g.normal(size=B)
    pairs = [(g.normal(size=(B, 2)), g.normal(scale=0.3, size=2)) for _ in range(2)]
    return *pairs, g.normal(size=(B, 2)), g.normal(size=B)


def in_torch(outputs):
    return tuple(tensors(*outputs)) if isinstance(outputs, tuple) else tensors(outputs)[0]


def in_numpy(outputs):
    return Gaussian(*outputs) if isinstance(outputs, tuple) else Categorical(outputs)


# ---------------------------------------------------------------------- the objectives


@KINDS
def test_objectives_are_those_of_our_distributions(discrete):
    outputs, old, actions, A = case(discrete)
    new, before = in_numpy(outputs), in_numpy(old)
    r = np.exp(new.log_prob(actions) - before.log_prob(actions))
    args = in_torch(outputs), in_torch(old), *tensors(actions, A)
    v, target = rng(4).normal(size=(2, 6))
    clipped = np.minimum(r * A, np.clip(r, 0.7, 1.3) * A).mean()
    full, error = losses.ppo_objective(*args, *tensors(v, target), clip=0.3, c1=0.7, c2=0.2), ((v - target) ** 2).mean()
    for ours, expected in (
        (losses.ratio(*args[:3]), r),
        (losses.pg_objective(args[0], *args[2:]), (new.log_prob(actions) * A).mean()),
        (losses.surrogate(*args), (r * A).mean()),
        (losses.mean_kl(args[1], args[0]), before.kl(new).mean()),
        (losses.kl_penalised(*args, 0.7), (r * A).mean() - 0.7 * before.kl(new).mean()),
        (losses.clip_objective(*args, 0.3), clipped),
        (losses.entropy(args[0]), new.entropy()),
        (losses.value_loss(*tensors(v, target)), error),
        (full, clipped - 0.7 * error + 0.2 * new.entropy().mean()),
        (losses.ppo_objective(*args, *tensors(v, target), c1=0), losses.clip_objective(*args, 0.2)),
        (losses.ppo_objective(*args, *tensors(v, target)), losses.clip_objective(*args, 0.2) - 0.5 * error),
    ):  # fmt: skip
        np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-14)


POINTS = np.array([(0, 0, -0.8), (0.5, 0.5, -0.8), (1, 1, -1), (1.2, 1.2, -1.2), (1.5, 1.2, -1.5), (2, 1.2, -2)])


@pytest.mark.parametrize("sign", [1, -1])
def test_published_points_of_the_clipped_objective(sign):
    """(r, L for A = 1, L for A = -1) at epsilon 0.2; two actions, the old policy even, so r = 2 p. eq-ppo-49"""
    for r, positive, negative in POINTS:
        p = np.clip(r / 2, 1e-12, 1 - 1e-12)
        logits = torch.tensor([[np.log(p), np.log(1 - p)]])
        args = logits, torch.zeros(1, 2, dtype=float), torch.tensor([0]), torch.tensor([float(sign)])
        assert losses.clip_objective(*args, 0.2).item() == pytest.approx(positive if sign > 0 else negative, abs=1e-11)
        assert losses.clip_objective(*args, 0.2) <= losses.surrogate(*args) + 1e-15


@KINDS
def test_at_the_old_policy_they_all_have_the_gradient_of_the_estimator(discrete):
    outputs, _, actions, A = case(discrete)
    old, args = in_torch(outputs), tensors(actions, A)
    functions = [
        lambda new: losses.pg_objective(new, *args),
        lambda new: losses.surrogate(new, old, *args),
        lambda new: losses.clip_objective(new, old, *args, 0.2),
        lambda new: losses.kl_penalised(new, old, *args, 3.0),
    ]
    gradients = []
    for function in functions:
        new = in_torch(outputs)
        parts = [part.requires_grad_() for part in (new if isinstance(new, tuple) else (new,))]
        gradients.append(np.concatenate([g.ravel() for g in torch.autograd.grad(function(new), parts)]))
    score = in_numpy(outputs).grad_log_prob(actions)
    if not discrete:
        score = np.concatenate([(A[:, None] * score[0]).ravel(), (A[:, None] * score[1]).sum(axis=0)]) / A.size
    else:
        score = (A[:, None] * score).ravel() / A.size
    for g in gradients:
        np.testing.assert_allclose(g, score, atol=1e-10)
    assert losses.surrogate(old, old, *args).item() == pytest.approx(A.mean(), abs=1e-15)


def test_kl_is_not_symmetric_and_entropy_is_largest_where_even():
    half, nine = (torch.log(torch.tensor([[p, 1 - p]], dtype=float)) for p in (0.5, 0.9))
    assert losses.mean_kl(half, nine).item() == pytest.approx(0.511, abs=5e-4)
    assert losses.mean_kl(nine, half).item() == pytest.approx(0.368, abs=5e-4)
    even = torch.zeros(1, 2, dtype=float, requires_grad=True)
    S = losses.entropy(even)
    assert S.item() == pytest.approx(np.log(2), abs=1e-15)
    np.testing.assert_allclose(torch.autograd.grad(S.sum(), even)[0], 0, atol=1e-16)
    outputs, old, actions, _ = case(True, B=1)
    p = np.exp(in_numpy(old).log_probs[0])
    rs = [losses.ratio(in_torch(outputs), in_torch(old), torch.tensor([a])).item() for a in range(4)]
    assert p @ rs == pytest.approx(1, abs=1e-12)  # eq-ppo-47


def test_no_gradient_reaches_the_old_policy():
    for discrete in (True, False):
        outputs, old, actions, A = case(discrete)
        new, old = in_torch(outputs), in_torch(old)
        for part in old if isinstance(old, tuple) else (old,):
            part.requires_grad_()
        for part in new if isinstance(new, tuple) else (new,):
            part.requires_grad_()
        losses.kl_penalised(new, old, *tensors(actions, A), 1.0).backward()
        assert all(part.grad is None for part in (old if isinstance(old, tuple) else (old,)))
        assert all(part.grad.abs().max() > 0 for part in (new if isinstance(new, tuple) else (new,)))


def test_labels_have_the_gradient_of_the_logistic_unit_and_of_ours():
    """d ln p(UP|x) / dw = (1 - p) x for a logistic unit, here a softmax over (w x, 0). eq-ppo-40"""
    x, w = rng(1).normal(size=(2, 5))
    t = torch.tensor(w, requires_grad=True)
    logits = torch.stack([t @ torch.tensor(x), torch.tensor(0.0, dtype=float)])[None]
    losses.label_objective(logits, torch.tensor([0])).backward()
    p = 1 / (1 + np.exp(-w @ x))
    np.testing.assert_allclose(t.grad, (1 - p) * x, atol=1e-15)
    net, x, y = MLP([3, 5, 4], dtype=np.float64, rng=rng(2)), rng(3).normal(size=(7, 3)), rng(4).integers(4, size=7)
    twin = TorchNet.like(net)
    losses.label_objective(twin.module(torch.tensor(x)), torch.tensor(y)).backward()
    theirs = np.concatenate([p.grad.ravel() for p in twin.module.parameters()])
    np.testing.assert_allclose(supervised_logprob_grad(net, x, y) / 7, theirs, atol=1e-14)


# ---------------------------------------------------------------------- gradients by hand against autograd


class Keep:
    """An optimizer that keeps the gradient and changes nothing."""

    def __init__(self, lr):
        self.lr = lr

    def update(self, theta, gradient):
        self.gradient = np.array(gradient)


class Twin:
    """An agent's networks as torch modules with gradients: outputs(x) and values(x) for autograd."""

    def __init__(self, agent):
        nets = [net for net in (agent.net, agent.critic) if net is not None]
        self.modules = [(net.copy() if isinstance(net, TorchNet) else TorchNet.like(net)).module for net in nets]
        self.log_std = None if agent.log_std is None else torch.tensor(agent.log_std, requires_grad=True)

    def forward(self, x):
        out = self.modules[0](torch.tensor(x))
        values = self.modules[-1](torch.tensor(x))[:, -1]
        out = out if len(self.modules) == 2 else out[:, :-1]
        return (out if self.log_std is None else (out, self.log_std)), values

    def parameters(self):
        """For each network, and for log_std where there is one: its parameters."""
        last = [] if self.log_std is None else [[self.log_std]]
        return [list(module.parameters()) for module in self.modules] + last

    def gradients(self, objective):
        flat = [p for group in self.parameters() for p in group]
        parts = iter(torch.autograd.grad(objective, flat, allow_unused=True, materialize_grads=True))
        return [np.concatenate([next(parts).numpy().ravel() for _ in group]) for group in self.parameters()]


def objective(twin, x, old, actions, A, target, config):
    """What `ppo` maximises, in the words of losses.py."""
    outputs, values = twin.forward(x)
    args = outputs, old, *tensors(actions, A)
    policy = {
        "clip": lambda: losses.clip_objective(*args, config.clip),
        "none": lambda: losses.surrogate(*args),
        "kl_fixed": lambda: losses.kl_penalised(*args, config.beta),
        "kl_adaptive": lambda: losses.kl_penalised(*args, config.beta),
    }[config.objective]()
    loss = losses.value_loss(values, torch.tensor(target))
    return policy - config.c1 * loss + config.c2 * losses.entropy(outputs).mean()


@pytest.mark.parametrize("dtype", TOLERANCE)
@pytest.mark.parametrize("torch_net", [False, True])
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("name", ["clip", "none", "kl_fixed", "kl_adaptive"])
@KINDS
def test_gradients_by_hand_are_autograds(discrete, name, shared, torch_net, dtype):
    agent = make_small(discrete, dtype, shared=shared, torch_net=torch_net, optimizer=Keep)
    x, actions, A, target = samples(agent)
    old = agent.forward(x)[0]
    old_log_prob = old.log_prob(actions)
    outputs = old.logits if discrete else (old.mean, old.log_std[0])
    move(agent, 0.2)
    config = PPOConfig(objective=name, clip=0.15, beta=0.7, c1=0.3, c2=0.05, shared=shared)
    policy, v = agent.forward(x)
    gradient, ratio = objective_gradient(policy, old, actions, old_log_prob, A, config)
    assert 5 < np.count_nonzero(abs(ratio - 1) > 0.15) < 36 and (abs(abs(ratio - 1) - 0.15) > 1e-4).all()
    d_values = 2 * config.c1 / v.size * (v - target)
    agent.step(-gradient if discrete else tuple(-g for g in gradient), d_values)
    twin = Twin(agent)
    expected = twin.gradients(-objective(twin, x, in_torch(outputs), actions, A, target, config))
    owners = [agent.net.optimizer, None if shared else agent.critic.optimizer, agent.log_std_optimizer]
    for owner, e in zip([owner for owner in owners if owner is not None], expected):
        assert owner.gradient.dtype == dtype
        np.testing.assert_allclose(owner.gradient, e, rtol=0, atol=TOLERANCE[dtype] * abs(e).max())


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("name", ["clip", "none", "kl_fixed", "kl_adaptive"])
@KINDS
def test_the_epochs_are_ascent_on_the_full_objective(discrete, name, shared):
    """Three epochs with minibatches of 16 out of 40 and SGD: the same steps by autograd; and what is recorded."""
    agent = make_small(discrete, shared=shared)
    x, actions, A, target = samples(agent)
    config = PPOConfig(objective=name, epochs=3, minibatch=16, clip=0.05, beta=2.0, c1=0.3, c2=0.05, shared=shared)
    beta = 0.4 if name == "kl_adaptive" else 2.0
    meant = PPOConfig(**{**vars(config), "beta": beta})
    twin, g = Twin(agent), rng(6)
    old = tuple(p.detach().clone() for p in twin.forward(x)[0]) if not discrete else twin.forward(x)[0].detach()
    ratios, errors = [], []
    for _ in range(3):
        order = g.permutation(40)
        for i in range(0, 40, 16):
            c = order[i : i + 16]
            old_c = old[c] if discrete else (old[0][c], old[1])
            outputs, values = twin.forward(x[c])
            ratios.append(losses.ratio(outputs, old_c, torch.tensor(actions[c])).detach().numpy())
            errors.append(values.detach().numpy() - target[c])
            steps = twin.gradients(objective(twin, x[c], old_c, actions[c], A[c], target[c], meant))
            for group, step in zip(twin.parameters(), steps):
                for p, part in zip(group, torch.tensor(step).split([p.numel() for p in group])):
                    p.data += 0.1 * part.view_as(p)
    ratios, errors = np.concatenate(ratios), np.concatenate(errors)
    kl, largest, outside, entropy, value_loss = improve(agent, (x, actions, A, target), config, beta, rng(6))
    ours = [net.theta for net in (agent.net, agent.critic) if net is not None] + [agent.log_std] * (not discrete)
    for theta, group in zip(ours, twin.parameters()):
        np.testing.assert_allclose(theta, np.concatenate([p.data.ravel() for p in group]), rtol=0, atol=1e-12)
    outputs = twin.forward(x)[0]
    assert kl == pytest.approx(losses.mean_kl(old, outputs).item(), rel=1e-9) and kl > 1e-4
    assert largest == pytest.approx(ratios.max(), rel=1e-9)
    assert outside == np.mean(abs(ratios - 1) > config.clip) and 0.05 < outside < 0.95
    assert entropy == pytest.approx(losses.entropy(outputs).mean().item(), rel=1e-9)
    assert value_loss == pytest.approx(np.mean(errors**2), rel=1e-9)


# ---------------------------------------------------------------------- bad input

LOGITS, ACTIONS, ONES = torch.zeros(4, 3), torch.zeros(4, dtype=int), torch.ones(4)
NORMAL = torch.zeros(4, 2), torch.zeros(2)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: losses.distribution([LOGITS]), "outputs: got list, must be logits, or a pair"),
        (lambda: losses.distribution((LOGITS,)), "outputs: got tuple"),
        (lambda: losses.pg_objective(LOGITS, ACTIONS, ONES[:, None]), r"advantage: got shape \(4, 1\), must be \(4,\)"),
        (lambda: losses.surrogate(LOGITS, LOGITS, ACTIONS, ONES[:3]), r"advantage: got shape \(3,\)"),
        (lambda: losses.clip_objective(LOGITS, LOGITS, ACTIONS, ONES[:1], 0.2), r"advantage: got shape \(1,\)"),
        (lambda: losses.clip_objective(LOGITS, LOGITS, ACTIONS, ONES, 0.0), "clip: got 0.0"),
        (lambda: losses.ratio(LOGITS, LOGITS, ACTIONS[:, None]), r"actions: got shape \(4, 1\), must be \(4,\)"),
        (lambda: losses.ratio(NORMAL, NORMAL, ONES), r"actions: got shape \(4,\), must be \(4, 2\)"),
        (lambda: losses.value_loss(ONES, ONES[:, None]), r"target: got shape \(4, 1\), must be \(4,\)"),
        (lambda: losses.label_objective(LOGITS, ACTIONS[:2]), r"labels: got shape \(2,\)"),
    ],
)
def test_bad_calls_name_the_argument(call, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        call()


@pytest.mark.parametrize("discrete", [True, False])
def test_outputs_of_another_shape_are_refused(discrete):
    agent = make_small(discrete)
    assert agent.distribution(np.zeros((5, A))).sample(np.random.default_rng(0)).shape == ((5,) if discrete else (5, A))
    for shape in ((A,), (5, A, 1), *([] if discrete else [(5, A + 1), (A, 5)])):
        with pytest.raises(ValueError, match=r"^outputs: got shape \(.*\), must be \(B, A\)"):
            agent.distribution(np.zeros(shape))
