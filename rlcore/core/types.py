"""Names for annotations: what a caller gives, before its check, and what comes back."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar, Union

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import gymnasium  # noqa: F401

Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.floating[Any]]  # float64 in tables, float32 in networks
Ints: TypeAlias = NDArray[np.integer[Any]]
Flags: TypeAlias = NDArray[np.bool_]
Rng: TypeAlias = "np.random.Generator"  # numpy loads it late


class Model:
    """What a FiniteMDP is known by in modules that `rlcore.mdp` imports."""

    next_state: Ints
    prob: Floats
    reward: Floats
    legal: Flags
    terminal: Flags
    start: Floats

    if TYPE_CHECKING:

        @property
        def n_states(self) -> int: ...

        @property
        def n_actions(self) -> int: ...

        def sampler(self) -> Any: ...


World: TypeAlias = Union[Model, "gymnasium.Env[Any, Any]", str]  # a FiniteMDP, an environment or its id
Given: TypeAlias = dict[str, Any]  # arguments by name, checked already
Rule: TypeAlias = Callable[[str, Any, Given], Any]  # rule(name, value, given), see rlcore.core.rules
OnEpisode: TypeAlias = Callable[[float, int], object]  # on_episode(return, steps so far); True ends the training
F = TypeVar("F", bound=Callable[..., Any])  # a function, and the same one decorated


class Optimizer(Protocol):
    """What a network's step calls."""

    lr: float

    def update(self, theta: Floats, gradient: Floats) -> None: ...


class Network(Protocol):
    """What MLP and TorchNet have in common."""

    theta: Floats
    optimizer: Optimizer | None

    def forward(self, x: Floats) -> Floats: ...

    def backward(self, d_outputs: Floats) -> Floats: ...

    def jvp(self, v: Floats) -> Floats: ...

    def step(self, gradient: Floats) -> None: ...
