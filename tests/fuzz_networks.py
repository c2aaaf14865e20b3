"""Good calls of what learns with networks, where the names of ARGUMENTS do not say enough."""

import numpy as np
from fuzz import network, torch_net


def run(net):
    """A network that has seen two samples."""
    net.forward(np.array([[0.1, 0.2], [0.3, -0.4]]))
    return net


def mlp():
    return run(network(2, 2))


def twin():
    return run(torch_net())


def module():
    import torch

    return torch.nn.Sequential(torch.nn.Linear(2, 2))


def sgd_net():
    from rlcore.optimizers import SGD

    return SGD(0.1)


def adam():
    from rlcore.optimizers import Adam

    return Adam(0.1)


STEP, D, V = (lambda: np.full(17, 0.5)), (lambda: np.array([[0.1, 0.2], [0.3, 0.4]])), (lambda: np.full(17, 0.1))
THETA = dict(theta=lambda: np.zeros(3), gradient=lambda: np.ones(3))
NEURONS = {
    "neurons.neuron": dict(w=lambda: np.array([0.5, -1.0])),
    "neurons.one_hot": dict(k=lambda: np.array([0, 2]), n=lambda: 3),
    "neurons.quadratic_cost": dict(a=D, y=D),
    "neurons.quadratic_gradient": dict(a=D, y=D),
    "neurons.step_position": dict(w=lambda: 2.0, b=lambda: -1.0),
    "neurons.step_neuron": {"s": lambda: 0.3},
    "neurons.bump": dict(s1=lambda: 0.2, s2=lambda: 0.6, h=lambda: 0.5),
    "neurons.tower": dict(y=D, x_range=lambda: (0.1, 0.5), y_range=lambda: (0.2, 0.6), h=lambda: 1.0),
}
NETWORKS = {
    "nn.MLP": dict(sizes=lambda: [2, 3, 2], optimizer=adam),
    "nn.MLP.forward": dict(self=mlp),
    "nn.MLP.backward": dict(self=mlp, d_outputs=D),
    "nn.MLP.jvp": dict(self=mlp, v=V),
    "nn.MLP.step": dict(self=mlp, gradient=STEP),
    "nn.MLP.copy": dict(self=mlp, dtype=lambda: np.float64),
    "nn.backprop": dict(y=D),
    "nn.gradient_check": dict(y=D),
    "nn.sgd": dict(y=D, optimizer=adam, batch=lambda: 1, epochs=lambda: 2, on_epoch=lambda: lambda epoch, cost: None),
    "nn.step_bump_network": dict(f=lambda: np.sin),
    "optimizers.SGD.update": dict(self=sgd_net, **THETA),
    "optimizers.GradientDescent.update": dict(self=sgd_net, **THETA),
    "optimizers.Adam.update": dict(self=adam, **THETA),
    "optimizers.take_step": dict(gradient=STEP),
    "optimizers.gradient_descent": dict(gradient=lambda: lambda v: v, v=lambda: 1.0),
    "torchnet.TorchNet": dict(module=module, optimizer=adam),
    "torchnet.TorchNet.like": dict(mlp=mlp),
    "torchnet.TorchNet.forward": dict(self=twin),
    "torchnet.TorchNet.backward": dict(self=twin, d_outputs=D),
    "torchnet.TorchNet.jvp": dict(self=twin, v=V),
    "torchnet.TorchNet.step": dict(self=twin, gradient=STEP),
    "torchnet.TorchNet.copy": dict(self=twin, dtype=lambda: np.float64),
}


def categorical():
    from rlcore.distributions import Categorical

    return Categorical(np.array([[0.5, 1.0], [0.0, 2.0]]))


def gaussian():
    from rlcore.distributions import Gaussian

    return Gaussian(np.array([[0.5, 1.0], [0.0, 2.0]]), np.zeros(2))


ACTIONS = dict(a=lambda: np.array([0, 1]))
ROWS = dict(rows=lambda: np.array([1]))
POLICIES = {
    "distributions.Categorical.log_prob": ACTIONS,
    "distributions.Categorical.grad_log_prob": ACTIONS,
    "distributions.Categorical.kl": dict(other=categorical),
    "distributions.Categorical.grad_kl": dict(other=categorical),
    "distributions.Categorical.take": ROWS,
    "distributions.Categorical.fisher": dict(d_logits=D),
    "distributions.Gaussian": dict(mean=D, log_std=lambda: np.zeros(2)),
    "distributions.Gaussian.log_prob": dict(a=D),
    "distributions.Gaussian.grad_log_prob": dict(a=D),
    "distributions.Gaussian.kl": dict(other=gaussian),
    "distributions.Gaussian.grad_kl": dict(other=gaussian),
    "distributions.Gaussian.take": ROWS,
    "distributions.Gaussian.fisher": dict(d_mean=D, d_log_std=lambda: np.array([0.1, 0.2])),
    "policies.softmax_policy": dict(
        x=lambda: np.eye(3), legal=lambda: np.array([[True, True], [True, False], [True, True]])
    ),
    "policies.grad_log_softmax": dict(x=lambda: np.array([1.0, 0.0, 2.0]), a=lambda: 1),
    "policy_gradient.episode_gradient": dict(features=lambda: np.eye(3)),
}
for name in ("sample", "log_prob", "entropy", "kl", "grad_log_prob", "grad_entropy", "grad_kl", "take", "fisher"):
    for kind, make in dict(Categorical=categorical, Gaussian=gaussian).items():
        full = f"distributions.{kind}.{name}"
        POLICIES[full] = dict(self=make) | POLICIES.get(full, {})
CALLS = NEURONS | NETWORKS | POLICIES
