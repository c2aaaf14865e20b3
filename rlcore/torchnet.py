"""A network of torch behind the interface of rlcore's own (chapters 6 to 8)."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

from numpy.typing import DTypeLike

from rlcore.core.extras import extra
from rlcore.core.rules import check_dtype, checked
from rlcore.core.samples import check_samples
from rlcore.core.types import ArrayLike, Floats, Optimizer
from rlcore.nn import MLP
from rlcore.optimizers import Adam, take_step

if TYPE_CHECKING:
    import torch


def _module(name, module, given):
    with extra("deep"):
        import torch

    if not isinstance(module, torch.nn.Module):
        raise ValueError(f"{name}: got {type(module).__name__}, must be a torch.nn.Module")
    if len({p.dtype for p in module.parameters()}) != 1:
        raise ValueError(f"{name}: its parameters must be of one dtype, and at least one")
    return module


class TorchNet:
    """Any torch module with the forward, backward, step and theta of `MLP`; autograd does the backward pass.

    Parameters
    ----------
    module : torch.nn.Module
        A torch.nn.Module from (d,) or (B, d) to outputs; its parameters become views of theta where it lives on the
        CPU, and are read from theta before each forward pass where it does not.
    optimizer : Optimizer | None
        What `step` uses, an SGD or Adam of its own.
    lr : float | None
        Short for Adam(lr).

    Examples
    --------
    >>> import torch
    >>> from rlcore import TorchNet
    >>> TorchNet(torch.nn.Linear(3, 2), lr=0.01).n_parameters
    8
    """

    @checked(module=_module)
    def __init__(self, module: torch.nn.Module, optimizer: Optimizer | None = None, lr: float | None = None) -> None:
        with extra("deep"):
            import torch

        self._torch, self.module = torch, module
        self.optimizer = Adam(lr) if optimizer is None and lr is not None else optimizer
        self._parameters = list(module.parameters())
        self._flat = torch.cat([p.detach().reshape(-1) for p in self._parameters])
        for p, part in zip(self._parameters, self._flat.split([p.numel() for p in self._parameters])):
            p.data = part.view_as(p)
        self.theta, self._outputs = self._flat.cpu().numpy(), None

    @classmethod
    def like(cls, mlp: MLP) -> TorchNet:
        """The twin of an MLP: same layers, same parameters, a copy of its optimizer."""
        with extra("deep"):
            import torch

        if not isinstance(mlp, MLP):
            raise ValueError(f"mlp: got {type(mlp).__name__}, must be an MLP")
        layer = {"sigmoid": torch.nn.Sigmoid, "relu": torch.nn.ReLU, "tanh": torch.nn.Tanh, "linear": torch.nn.Identity}
        modules = []
        for w, b in zip(mlp.weights, mlp.biases):
            linear = torch.nn.Linear(*w.shape[::-1], dtype=getattr(torch, w.dtype.name))
            linear.weight.data[:], linear.bias.data[:] = torch.from_numpy(w), torch.from_numpy(b)
            modules += [linear, layer[mlp.hidden if len(modules) < 2 * len(mlp.weights) - 2 else mlp.output]()]
        return cls(torch.nn.Sequential(*modules), copy.deepcopy(mlp.optimizer))

    @property
    def n_parameters(self) -> int:
        return self.theta.size

    def forward(self, x: ArrayLike) -> Floats:
        if self._flat.device.type != "cpu":
            self._flat.copy_(self._torch.from_numpy(self.theta))
        x = self._tensor("x", x)
        try:
            self._x, self._outputs = x, self.module(x)
        except RuntimeError as error:
            raise ValueError(f"x: got shape {tuple(x.shape)}, must be what the module takes ({error})") from error
        return self._outputs.detach().cpu().numpy()

    def backward(self, d_outputs: ArrayLike) -> Floats:
        d = self._tensor("d_outputs", d_outputs)
        if self._outputs is None or d.shape != self._outputs.shape:
            raise ValueError(f"d_outputs: got shape {tuple(d.shape)}, must be that of the outputs of forward")
        options = dict(retain_graph=True, allow_unused=True, materialize_grads=True)
        parts = self._torch.autograd.grad(self._outputs, self._parameters, d, **options)
        return self._torch.cat([part.reshape(-1) for part in parts]).cpu().numpy()

    def jvp(self, v: ArrayLike) -> Floats:
        v = self._tensor("v", v)
        if v.shape != self._flat.shape or self._outputs is None:
            raise ValueError(f"v: got shape {tuple(v.shape)}, must be {self.theta.shape}, after a forward pass")
        names, sizes = zip(*((name, p.numel()) for name, p in self.module.named_parameters()))
        values = {name: p.detach() for name, p in self.module.named_parameters()}
        changes = {name: part.view_as(values[name]) for name, part in zip(names, v.split(sizes))}
        call = self._torch.func.functional_call
        _, change = self._torch.func.jvp(lambda p: call(self.module, p, (self._x,)), (values,), (changes,))
        return change.cpu().numpy()

    def step(self, gradient: ArrayLike) -> None:
        take_step(self, gradient)

    def _tensor(self, name, values):
        return self._torch.as_tensor(check_samples(name, values, self.theta.dtype), device=self._flat.device)

    def __reduce__(self) -> tuple[Any, ...]:
        return TorchNet, (self.module, self.optimizer)

    def copy(self, dtype: DTypeLike | None = None) -> TorchNet:
        module = copy.deepcopy(self.module)
        if dtype is not None:
            module = module.to(getattr(self._torch, check_dtype("dtype", dtype).name))
        return TorchNet(module, copy.deepcopy(self.optimizer) if dtype is None else None)
