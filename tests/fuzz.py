"""Bad values for every argument of every public function, and one good call of each to start from."""

import importlib
import inspect
import pkgutil
import re
import resource
import signal
from contextlib import contextmanager
from fractions import Fraction

import numpy as np
import psutil

import rlcore
from rlcore.mdp import FiniteMDP, rollout, uniform_policy

LEFT_OUT = {  # what no user calls: the ground that the others stand on, and what only draws or declares
    f"rlcore.core.{name}"
    for name in ("chains", "checks", "compiled", "endings", "extras", "files", "learner", "outcomes", "results",
                 "rules", "running", "samples", "sampling", "sparse", "types", "worlds")
}  # fmt: skip
BAD = {
    "None": None, "NaN": np.nan, "infinity": np.inf, "minus infinity": -np.inf, "text": "text", "digits": "1",
    "bytes": b"1", "True": True, "minus one": -1, "a half": 0.5, "huge": 10**30, "many": 10**18, "complex": 1j,
    "a dict": {}, "a set": {1}, "nothing": [], "ragged": [[1.0], [1.0, 2.0]], "words": ["a", "b"],
    "NaNs": np.full(3, np.nan), "infinite": np.full((2, 2), np.inf), "another shape": np.zeros((2, 3, 1, 2)),
    "complexes": np.ones(3) * 1j, "objects": np.array([None, object()]), "a class": int, "an object": object(),
    "a fraction": Fraction(7, 2), "far below": -(10**30),
}  # fmt: skip


def modules():
    for found in pkgutil.walk_packages(rlcore.__path__, "rlcore."):
        if not found.name.startswith(("rlcore.exercises", "rlcore.plots")) and found.name not in LEFT_OUT:
            yield importlib.import_module(found.name)


def is_good(name, argument, kind):
    """Whether a value of BAD is a good one of this argument."""
    return kind in GOOD.get(argument, ()) or kind in GOOD.get(f"{name} {argument}", ())


GOOD = {  # by argument, or function and argument: kinds of BAD that are slow, leave files, or give NaN rightly
    "studies.ch04.walk_error V": ["NaNs"], "sweep.sweep executor": ["None"], "sweep.sweep store": ["text", "digits"],
    "log": ["text", "digits"], "saving.save path": ["text", "digits"], "judging.film path": ["text", "digits"],
    "saving.save thing": list(BAD),
}  # fmt: skip


def public():
    """{name: function} of what users call; methods as Class.method."""
    found = {}
    for module in modules():
        for name, thing in vars(module).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
                continue
            full = f"{module.__name__.removeprefix('rlcore.')}.{name}"
            if full in HOLDERS or not (inspect.isfunction(thing) or inspect.isclass(thing)) or is_rule(thing):
                continue
            found[full] = thing
            if inspect.isclass(thing):
                for inner, method in vars(thing).items():
                    if not inner.startswith("_") and inspect.isfunction(getattr(method, "__func__", method)):
                        found[f"{full}.{inner}"] = method
    return found


def is_rule(thing):
    """Whether it is one of the rules of arguments, or what makes a Run of what a loop found."""
    parameters = list(inspect.signature(thing).parameters) if inspect.isfunction(thing) else []
    return thing.__name__.startswith("check_") or bool({"given", "name"} & set(parameters[:2] + parameters[-1:]))


def is_compiled(thing):
    """Whether it is a loop that numba compiles where there is one, which nobody calls."""
    return inspect.isfunction(thing) and "\n@compiled\n" in "\n" + inspect.getsource(thing)


@contextmanager
def limit(seconds):
    """TimeoutError after so many seconds, MemoryError with 2 GB more than now."""

    def stop(signum, frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    memory = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + 2**31, memory[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, memory)
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def problem(call, name, has_nan):
    """What is wrong with how a call with a bad value of `name` ends; None where it is fine."""
    try:
        with limit(10), np.errstate(all="ignore"):
            result = call()
    except (ValueError, TypeError) as error:
        text = str(error)
        if not re.search(rf"\b{name}\b", text):
            return f"{type(error).__name__} does not name it: {text[:150]}"
        if isinstance(error, ValueError) and not any(word in text for word in ("must", "allowed", "need")):
            return f"ValueError does not say what is allowed: {text[:150]}"
        return None
    except TimeoutError:
        return "hangs"
    except BaseException as error:
        return f"{type(error).__name__}: {str(error)[:150]}"
    return "NaN in silence" if not has_nan and holds_nan(result) else None


def holds_nan(result, depth=0):
    if isinstance(result, np.ndarray) and result.dtype.kind in "fc":
        return bool(np.isnan(result).any())
    if isinstance(result, (float, complex)):
        return bool(np.isnan(result))
    if depth < 2 and isinstance(result, (list, tuple)):
        return any(holds_nan(x, depth + 1) for x in result)
    if depth < 2 and hasattr(result, "__dict__"):
        return any(holds_nan(x, depth + 1) for x in vars(result).values())
    return False


# ---------------------------------------------------------------------- one good call of each

HOLDERS = {  # what functions return or pass on, which no user makes or calls
    "batch.Batch", "core.rollouts.Rollout", "core.rollouts.OneEnv", "core.rollouts.Episodes",
    "mdp.Trajectory", "planning.Transitions", "planning.Memory", "reinforce.Baseline", "studies.ch03.Updates",
    "studies.ch04.Update", "studies.ch07.Runs", "studies.figure61.Line", "sweep.Record", "trust_region.OldPolicy",
    "trust_region.Steps", "judging.Evaluation", "judging.Curve",
    "nstep.values_on_the_way", "traces.kept", "explore.Explorer", "envs.gym.LegalActions",
    # what algorithms that learn with networks share, called with what they have checked
    "optimizers.take_step", "ppo.improve", "core.agents.make_agent", "core.agents.action_box", "core.rollouts.collect",
    "core.rollouts.Learning", "core.rollouts.Learning.rollouts", "core.rollouts.Learning.note",
    "core.rollouts.Learning.run", "core.rollouts.config_of", "trpo.fit_values",
    "gae.learning_data", "reinforce.sizes", "reinforce.make_networks",
    "reinforce.TimeBaseline", "policies.probabilities", "policies.choose", "policies.add_score", "policies.dot",
    "policies.epsilon_greedy", "policies.max_value", "policies.expected_value", "policy_gradient.softmax_episode",
    "core.schedules.at", "core.schedules.constant", "core.schedules.now",
}  # fmt: skip


def rng():
    return np.random.default_rng(0)


MDP = FiniteMDP.from_outcomes(
    {(0, 0): [(0.5, 1, 1.0), (0.5, 0, 0.0)], (0, 1): [(1.0, 2, -1.0)], (1, 0): [(1.0, 2, 2.0)]}, start=0
)
PI = uniform_policy(MDP)


def network(n_in, n_out, **more):
    from rlcore.nn import MLP
    from rlcore.optimizers import Adam

    return MLP([n_in, 3, n_out], optimizer=Adam(), rng=rng(), **more)


def torch_net():
    import torch

    from rlcore.torchnet import TorchNet

    return TorchNet(torch.nn.Sequential(torch.nn.Linear(2, 3), torch.nn.Tanh(), torch.nn.Linear(3, 2)), lr=0.1)


def agent(discrete=True):
    from rlcore.core.agents import ActorCritic

    return ActorCritic(network(2, 2), network(2, 1)) if discrete else None


def old():
    from rlcore.trust_region import old_policy

    return old_policy(MDP, PI, 0.9)


def transitions():
    from rlcore.planning import sample_transitions

    return sample_transitions(MDP, PI, 20, rng=rng())


def tensors(*shapes):
    import torch

    return [torch.linspace(0.1, 0.9, int(np.prod(shape)), dtype=torch.float64).reshape(shape) for shape in shapes]


def model(x, a):
    return x + np.asarray(a)[:, None]


def cost(x):
    return (np.asarray(x) ** 2).sum(axis=-1)


def table61():
    return np.linspace(0, 1, 11 * 7 * 2).reshape(11, 7, 2)


def rows61():
    from rlcore.studies.figure61 import SETTINGS, TASKS

    return [dict(task=t, setting=s, seed=0.0, **{"return": 1.0}) for t in list(TASKS) for s in list(SETTINGS)]


def job(a, rng):
    return a


ARGUMENTS = {  # by name, for most functions
    "mdp": lambda: MDP, "world": lambda: MDP, "pi": lambda: PI, "gamma": lambda: 0.9, "lam": lambda: 0.5, "V":
    lambda: np.array([1.0, 2.0, 0.0]), "Q": lambda: np.array([[1.0, 2.0], [3.0, -np.inf], [0.0, -np.inf]]),
    "n_episodes": lambda: 2, "n_steps": lambda: 3, "n_iter": lambda: 2, "n": lambda: 2, "max_steps": lambda: 20,
    "rng": rng, "alpha": lambda: 0.1, "epsilon": lambda: 0.1, "s": lambda: 0, "depth": lambda: 2, "n_states":
    lambda: 3, "n_actions": lambda: 2, "T": lambda: 2, "tol": lambda: 1e-3, "episodes": lambda: [rollout(MDP,
    PI, 50, rng=g) for g in rng().spawn(3)], "theta": lambda: np.array([[0.1, 0.2, 0.0], [0.3, 0.4, 0.0]]),
    "old": old, "net": lambda: network(2, 2), "rewards": lambda: np.array([1.0, 0.0, 2.0]), "values": lambda:
    np.array([0.5, 1.0, 1.5]), "states": lambda: np.array([0, 0, 1, 2]), "actions": lambda: np.array([0, 0, 0]),
    "z": lambda: np.array([0.5, -1.0]), "logits": lambda: np.array([[0.5, 1.0], [0.0, 2.0]]), "labels": lambda:
    np.array([0, 1]), "label": lambda: np.array([0, 1]), "x": lambda: np.array([[0.1, 0.2], [0.3, -0.4]]),
    "data": transitions, "on_episode":
    lambda: None, "agent": agent, "f": lambda: cost, "table": table61, "lr": lambda: 0.1, "gamma_lam":
    lambda: 0.5, "trace": lambda: "accumulating", "kind": lambda: "dutch", "beta": lambda: 1.0, "delta": lambda:
    0.01, "clip": lambda: 0.2, "d_target": lambda: 0.01, "d": lambda: 0.02,
}  # fmt: skip


def env_of(name="CartPole-v1"):
    import gymnasium as gym

    return gym.make(name, disable_env_checker=True)
