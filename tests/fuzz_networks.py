"""Good calls of what learns with networks, where the names of ARGUMENTS do not say enough."""

import tempfile
from concurrent.futures import Executor, Future
from functools import cache
from pathlib import Path

import numpy as np
from fuzz import env_of, job, network, tensors, torch_net


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


def cartpole():
    return env_of()


def net42(n_out=2):
    return network(4, n_out)


def never(*_):
    return False


LEARNERS = {
    name: dict(world=cartpole, max_steps=lambda: 4, net=net42, critic=lambda: network(4, 1), on_episode=lambda: never)
    for name in ("reinforce.reinforce_network", "actor_critic.actor_critic_network")
}
LEARNERS["reinforce.reinforce_network"]["baseline"] = lambda: "value"
LEARNERS["core.schedules.decaying"] = dict(first=lambda: 0.5)


def critic():
    return network(2, 1)


def learner():
    """An actor-critic that has seen two samples."""
    from rlcore.core.agents import ActorCritic

    made = ActorCritic(network(2, 2), critic())
    made.forward(np.array([[0.1, 0.2], [0.3, -0.4]], np.float32))
    return made


def normaliser():
    from rlcore.core.agents import Normaliser

    return Normaliser(2)


def on_policy():
    return learner().forward(np.array([[0.1, 0.2], [0.3, -0.4]]))[0]


def small(kind="PPOConfig", **more):
    import rlcore.ppo
    import rlcore.trpo

    made = getattr(rlcore.ppo, kind, None) or getattr(rlcore.trpo, kind)
    return made(horizon=4, epochs=1, minibatch=4, hidden=(3,), **more)


def quadratic(x):
    return -float(np.square(x).sum())


LABELS, TWO = (lambda: np.array([0, 1])), (lambda: np.array([0.5, -1.0]))
POINT, UP = (lambda: np.array([1.0, 1.0])), (lambda: np.array([-1.0, -1.0]))
AGENTS = {
    "core.agents.ActorCritic": dict(critic=critic, log_std=lambda: np.zeros(2), log_std_optimizer=adam,

                                    normaliser=normaliser, box=lambda: np.outer([0, 1, -1, 1], [1.0, 1])),
    "core.agents.ActorCritic.distribution": dict(outputs=D),
    "core.agents.ActorCritic.policy": dict(observations=D),
    "core.agents.ActorCritic.values": dict(observations=D),
    "core.agents.ActorCritic.see": dict(observations=D),
    "core.agents.ActorCritic.likeliest": dict(observation=TWO),
    "core.agents.ActorCritic.step": dict(d_policy=D, d_values=TWO),
    "core.agents.Normaliser": dict(d=lambda: 2),
    "core.agents.Normaliser.update": dict(self=normaliser),
    "core.rollouts.vector_env": dict(world=cartpole),
    "gae.gae": dict(
        next_values=lambda: np.array([1.0, 1.5, 2.0]),
        terminated=lambda: np.array([False, False, True]),
        truncated=lambda: np.array([False, True, False]),
    ),
    "ppo.surrogate_gradient": dict(ratio=TWO, advantage=TWO),
    "ppo.clip_gradient": dict(ratio=TWO, advantage=TWO),
    "ppo.objective_gradient": dict(
        policy=categorical, old=categorical, actions=LABELS, old_log_prob=TWO, advantage=TWO,
        config=lambda: small(objective="kl_fixed"), beta=lambda: 1.0,
    ),
    "ppo.ppo": dict(world=cartpole, net=net42, critic=lambda: network(4, 1), config=small, on_episode=lambda: never,
                    agent=lambda: None),
    "trpo.trpo": dict(
        world=cartpole, net=net42, critic=lambda: network(4, 1), config=lambda: small("TRPOConfig"),
        on_episode=lambda: never, agent=lambda: None,
    ),
    "trpo.conjugate_gradient": dict(product=lambda: lambda v: 2 * v, b=TWO),
    "trpo.fisher_vector_product": dict(agent=learner, policy=on_policy, v=V),
    "trpo.trpo_step": dict(agent=learner, actions=LABELS, advantage=TWO, config=lambda: small("TRPOConfig")),
}  # fmt: skip
for name in ("forward", "distribution", "policy", "values", "likeliest", "step", "set_lr", "see", "acting"):
    full = f"core.agents.ActorCritic.{name}"
    AGENTS[full] = dict(self=learner) | AGENTS.get(full, {})
REGIONS = {
    "trust_region.lower_bound": dict(C=lambda: 1.0),
    "trust_region.policy_line": dict(base=D, direction=D, theta=lambda: 0.5),
    "trust_region.mm_maximise": dict(bound=lambda: lambda theta, new: -np.square(new - theta + 0.1), theta=lambda: 1.0),
    "trust_region.backtracking_line_search": dict(
        f=lambda: quadratic, x=POINT, direction=UP, slope=lambda: 4.0, max_steps=lambda: 5
    ),
    "trust_region.trust_region_step": dict(g=TWO, H=lambda: -np.eye(2), radius=lambda: 1.0),
    "trust_region.trust_region_ascent": dict(
        f=lambda: quadratic, gradient=lambda: lambda x: -2 * x, hessian=lambda: lambda x: -2 * np.eye(2), x=POINT
    ),
    "trust_region.penalised_ascent": dict(d_target=lambda: 0.01),
}


def tensor(*shape):
    return lambda: tensors(shape)[0]


def chosen():
    import torch

    return torch.tensor([0, 1])


TENSORS = dict(
    outputs=tensor(2, 3), logits=tensor(2, 3), old=tensor(2, 3), actions=chosen, labels=chosen, advantage=tensor(2),
    values=tensor(2), target=tensor(2),
)  # fmt: skip
LOSSES = {
    f"losses.{name}": TENSORS
    for name in (
        "distribution", "label_objective", "pg_objective", "ratio", "surrogate", "mean_kl", "kl_penalised",
        "clip_objective", "value_loss", "entropy", "ppo_objective",
    )
}  # fmt: skip


class Here(Executor):
    """Runs at once, in this process."""

    def submit(self, function, *args):
        future = Future()
        future.set_result(function(*args))
        return future


@cache
def folder():
    return tempfile.TemporaryDirectory()


def picture(choices=0):
    from matplotlib.figure import Figure

    return Figure(figsize=(1, 1))


def settings():
    return [dict(a=1)]


WIDE = {
    "sweep.sweep": dict(
        function=lambda: job, settings=settings, seeds=lambda: [0], store=lambda: folder().name, executor=Here
    ),
    "explore.explore": dict(
        draw=lambda: picture, title=lambda: "T", alt=lambda: lambda choices: "a picture", choices=lambda: [1, 2],
        labels=lambda: dict(choices="c"),
    ),
}  # fmt: skip


def row56():
    setting = dict(baseline="time", hidden=16.0, lr=0.01, gamma=0.99)
    return setting | dict(solved=150.0, last=190.0, steps=9e4, blocks="20 30.5")


STUDIES = {
    "studies.ch06.load_digits_28": dict(size=lambda: 8),
    "studies.ch07.solved": dict(lengths=lambda: np.full(120, 200.0)),
    "studies.ch07.runs": dict(rows=lambda: [row56()]),
    "studies.ch07.bluff_values": dict(x=lambda: 0.3, y=lambda: 0.6),
    "studies.ch07.bluff_guarantee": dict(x=lambda: 0.3),
    "studies.ch07.bluff_gradients": dict(x=lambda: 0.3, y=lambda: 0.6),
    "studies.ch07.bluff_learning": dict(x=lambda: 0.3, y=lambda: 0.6),
    "studies.ch08.supervised_logprob_grad": dict(net=mlp),
    "studies.ch08.supervised_logprob_step": dict(net=mlp),
    "studies.ch08.episode_outcome_pg": dict(features=lambda: np.eye(3)),
    "studies.ch08.label_bandit": dict(n_classes=lambda: 2),
    "studies.ch08.factorise": dict(
        ratings=D, known=lambda: np.array([[True, False], [True, True]]), items=lambda: np.ones((2, 1))
    ),
    "studies.ch08.recommend": dict(truth=D, n_rounds=lambda: 2),
    "studies.figure61.scores": dict(rows=lambda: [dict(task="Hopper", setting="none", seed=0.0, score=1.0)]),
    "studies.figure61.rank_correlation": dict(x=TWO, y=TWO),
    "studies.tables.read": dict(path=lambda: Path(__file__).parents[1] / "book" / "data" / "figure56.csv"),
}


def lamp():
    """An environment that gives pictures."""
    from test_judging import Lamp

    return Lamp()


def to_lamp():
    return np.array([[0.0, 1.0], [1.0, 0.0]])


def kept():
    from rlcore.saving import save

    save([1.0], Path(folder().name) / "kept.rl")
    return Path(folder().name) / "kept.rl"


JUDGING = {
    "judging.evaluate": dict(agent=to_lamp, world=lamp, max_steps=lambda: 5),
    "judging.film": dict(
        agent=to_lamp, env=lamp, path=lambda: Path(folder().name) / "film.gif", fps=lambda: 10.0, max_steps=lambda: 5
    ),
    "judging.interquartile_mean": dict(scores=lambda: np.arange(5.0)),
    "judging.learning_curve": dict(runs=lambda: [np.arange(4.0), np.ones(4)]),
    "saving.save": dict(thing=lambda: [1.0], path=lambda: Path(folder().name) / "thing.rl"),
    "saving.load": dict(path=kept),
    "core.agents.ActorCritic.bounded": dict(self=learner, actions=D),
}

CALLS = JUDGING | NEURONS | NETWORKS | POLICIES | LEARNERS | AGENTS | REGIONS | LOSSES | WIDE | STUDIES
