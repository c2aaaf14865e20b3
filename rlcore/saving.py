"""Results and agents in files: `save` what a run left, `load` it in another process, and go on.

The format, version 1. A file is a zip archive, which `numpy.load` opens, too: each array is a member `<number>.npy`,
and `rlcore.json` says what they are. It holds {"format": "rlcore", "version": 1, "content": node}. A node is null,
true, false, a number, a string, or one of::

    {"list": [node, ...]}, {"tuple": [node, ...]}, {"dict": [[node, node], ...]}
    {"array": number}                     of the member that holds it
    {"kind": name, "fields": {name: node}}  an object, whose class is one of KINDS or, a generator, of numpy.random
    {"values of": node}                   the method `values` of an ActorCritic, which is V of the runs of ppo and trpo
    {"again": number}                     the object that is the number-th of the file, counted from 0 as they begin

No member holds code, none is run on loading; a torch module is saved as its state_dict.
"""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from rlcore.core.agents import ActorCritic, Normaliser
from rlcore.core.checks import show
from rlcore.core.extras import extra
from rlcore.core.files import check_path, whole
from rlcore.core.results import PlanningRun, Run, Solution, WatkinsRun
from rlcore.core.rules import anything, checked
from rlcore.core.schedules import Schedule
from rlcore.judging import Curve, Evaluation
from rlcore.mdp import FiniteMDP, Trajectory
from rlcore.nn import MLP
from rlcore.optimizers import SGD, Adam
from rlcore.ppo import PPOConfig
from rlcore.torchnet import TorchNet
from rlcore.trpo import TRPOConfig

VERSION = 1
KINDS = {
    kind.__name__: kind
    for kind in (Solution, Run, PlanningRun, WatkinsRun, Evaluation, Curve, Trajectory, FiniteMDP, ActorCritic,
                 PPOConfig, TRPOConfig, Schedule, MLP, TorchNet, SGD, Adam, Normaliser)
}  # fmt: skip
GENERATORS = ("PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64")
LEFT_OUT = {"_work", "_n", "_d"}  # made anew


@checked(thing=anything, path=check_path)
def save(thing: Any, path: str | os.PathLike[str]) -> None:
    """Write a result or an agent to a file that `load` reads, here or in another process.

    Networks keep the state of their optimizers, agents their log_std and normaliser, so that learning goes on with the
    same next step. No code is ever written.

    Parameters
    ----------
    thing : Any
        A Run, Solution, Evaluation, Curve, Trajectory, FiniteMDP, ActorCritic, MLP, TorchNet, optimizer, Schedule,
        PPOConfig, TRPOConfig, numpy.random.Generator, array, number or string, or a list, tuple or dict of them, such
        as {"run": run, "rng": rng}.
    path : str | os.PathLike[str]
        Name of the file, taken as it is; one that is there is replaced when the new one is complete.

    Raises
    ------
    ValueError
        For anything else.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from rlcore import load, save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save({"V": np.zeros(2), "name": "walk"}, folder + "/kept.rl")
    ...     load(folder + "/kept.rl")
    {'V': array([0., 0.]), 'name': 'walk'}
    """
    writer = _Writer()
    try:
        header = {"format": "rlcore", "version": VERSION, "content": writer.node(thing)}
    except RecursionError:
        raise ValueError(f"thing: got {type(thing).__name__} that holds itself, must have an end") from None
    with whole(path, "wb") as out, zipfile.ZipFile(out, "w") as archive:
        archive.writestr("rlcore.json", json.dumps(header))
        for number, array in enumerate(writer.arrays):
            with archive.open(f"{number}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def _modules(name, modules, given):
    if isinstance(modules, str | bytes) or not hasattr(modules, "__iter__"):
        raise ValueError(f"{name}: got {show(modules)}, must be a list of torch modules")
    modules = list(modules)
    for module in modules:
        if not hasattr(module, "load_state_dict") or isinstance(module, type):
            raise ValueError(f"{name}: got {show(module)}, must be torch modules")
    return modules


_BROKEN = (  # what a file that is cut, changed or foreign may raise while it is read
    OSError, zipfile.BadZipFile, zlib.error, ValueError, KeyError, TypeError, EOFError, AttributeError, IndexError,
    NotImplementedError, RuntimeError, MemoryError,
)  # fmt: skip


@checked(path=check_path, modules=_modules)
def load(path: str | os.PathLike[str], *, modules: Iterable[Any] = ()) -> Any:
    """Read what `save` wrote to a file.

    Parameters
    ----------
    path : str | os.PathLike[str]
        Name of the file.
    modules : Iterable[Any]
        A torch.nn.Module for each TorchNet in the file, in the order net, critic: it has their parameters, no code.

    Returns
    -------
    Any
        What was saved.

    Raises
    ------
    ValueError
        Where the file is cut, changed, of another program or of a later version.

    Examples
    --------
    >>> import tempfile
    >>> from rlcore import load, save
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save([1, 2.5], folder + "/kept.rl")
    ...     load(folder + "/kept.rl")
    [1, 2.5]
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.testzip() is not None:
                raise ValueError
            header = json.loads(archive.read("rlcore.json"))
            if header["format"] != "rlcore":
                raise ValueError
            version = header["version"]
            if type(version) is not int or version < 1:
                raise ValueError
            if version == VERSION:
                return _Reader(archive, modules).thing(header["content"])
    except FileNotFoundError:
        raise ValueError(f"path: got {show(str(path))}, must be a file that is there") from None
    except PermissionError:
        raise ValueError(f"path: got {show(str(path))}, must be a file that may be read") from None
    except _Misfit as error:
        raise ValueError(str(error)) from None
    except _BROKEN:
        raise ValueError(f"path: {path} is cut, changed or of another program, must be what save wrote") from None
    raise ValueError(f"path: {path} is of version {version}, must be at most {VERSION}: a newer rlcore reads it")


class _Misfit(Exception):
    """What the caller gave does not fit to a file that is whole."""


class _Writer:
    def __init__(self):
        self.arrays, self.seen = [], {}  # seen: {id: (number, object)}; the object is held, so that no id comes twice

    def node(self, x):
        """The node of x; its arrays are kept."""
        if x is None or isinstance(x, bool | str) or type(x) in (int, float):
            return x
        if isinstance(x, np.ndarray | np.generic):
            if x.dtype.hasobject or isinstance(x, np.ma.MaskedArray):
                kind = "a masked array" if isinstance(x, np.ma.MaskedArray) else f"an array of {x.dtype}"
                raise ValueError(f"thing: got {kind}, must be of numbers or strings")
            self.arrays.append(np.asarray(x))
            return {"array": len(self.arrays) - 1}
        for kind in (list, tuple):
            if type(x) is kind:
                return {kind.__name__: [self.node(value) for value in x]}
        if type(x) is dict:
            return {"dict": [[self.node(key), self.node(value)] for key, value in x.items()]}
        if getattr(x, "__func__", None) is ActorCritic.values:
            return {"values of": self.node(x.__self__)}
        if id(x) in self.seen:
            return {"again": self.seen[id(x)][0]}
        self.seen[id(x)] = len(self.seen), x
        name, fields = _parts(x)
        return {"kind": name, "fields": {key: self.node(value) for key, value in fields.items()}}


def _parts(x):
    """Name of an object's kind, and its fields."""
    if isinstance(x, np.random.Generator) and type(x.bit_generator).__name__ in GENERATORS:
        return type(x.bit_generator).__name__, {"state": x.bit_generator.state, "seed": _seed(x)}
    if KINDS.get(type(x).__name__) is not type(x):
        raise ValueError(f"thing: got {show(x)}, must be made of {', '.join(KINDS)}, generators, arrays and numbers")
    if isinstance(x, TorchNet):
        state = {name: value.detach().cpu().numpy() for name, value in x.module.state_dict().items()}
        return "TorchNet", {"state": state, "optimizer": x.optimizer}
    fields = x.__getstate__() if isinstance(x, MLP) else x._asdict() if isinstance(x, Schedule) else vars(x)
    return type(x).__name__, {name: value for name, value in fields.items() if name not in LEFT_OUT}


def _seed(rng):
    """What rng.spawn depends on."""
    seed = rng.bit_generator.seed_seq
    if not isinstance(seed, np.random.SeedSequence):
        return None
    names = ("entropy", "spawn_key", "pool_size", "n_children_spawned")
    return {name: getattr(seed, name) for name in names}


class _Reader:
    def __init__(self, archive, modules):
        self.archive, self.modules, self.things = archive, iter(modules), []

    def thing(self, node):
        """What a node stands for."""
        if not isinstance(node, dict):
            return node
        (name, content), *fields = node.items()
        if name == "array":
            with self.archive.open(f"{content}.npy") as member:
                array = np.lib.format.read_array(member, allow_pickle=False)
            return array[()] if array.dtype.names is None else array.view(np.recarray)
        if name in ("list", "tuple"):
            return {"list": list, "tuple": tuple}[name](self.thing(x) for x in content)
        if name == "dict":
            return {self.thing(key): self.thing(value) for key, value in content}
        if name == "values of":
            return self.thing(content).values
        if name == "again":
            return self.things[content]
        number = len(self.things)
        self.things.append(None)
        fields = {key: self.thing(value) for key, value in fields[0][1].items()}
        self.things[number] = found = self.made(content, fields)
        return found

    def made(self, name, fields):
        """An object of a kind, with these fields."""
        if name in GENERATORS:
            seed = fields["seed"] and np.random.SeedSequence(**fields["seed"])
            generator = getattr(np.random, name)(seed)
            generator.state = fields["state"]
            return np.random.Generator(generator)
        kind = KINDS[name]
        if kind is TorchNet:
            return self.torch_net(**fields)
        if kind not in (MLP, SGD, Adam, Normaliser):
            return kind(**fields)
        found = kind.__new__(kind)
        if kind is MLP:
            found.__setstate__(fields)
        else:
            vars(found).update(fields)
        if kind is Adam and found.m is not None:
            found._work = np.empty_like(found.m)
        return found

    def torch_net(self, state, optimizer):
        with extra("deep"):
            import torch

        module = next(self.modules, None)
        if module is None:
            raise _Misfit("modules: got too few, needs a torch.nn.Module for each TorchNet in the file")
        try:
            module.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in state.items()})
        except RuntimeError as error:
            raise _Misfit(f"modules: got {type(module).__name__}, must be as the saved one: {error}") from None
        return TorchNet(module, optimizer)
