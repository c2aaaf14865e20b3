"""Names for annotations: what a caller gives, before its check, and what comes back."""

from __future__ import annotations

import os
from collections import namedtuple
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol, TypeAlias, TypeVar, Union, overload

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


# max(floor, first / (1 + rate n)^power) after n visits (a step size), n episodes or n steps (epsilon)
Schedule = namedtuple("Schedule", "first rate power floor per_step")

BODIES = False  # true for mypy here (pyproject.toml): a body does not see what came, but what the rules made of it
if BODIES:
    ArrayLike: TypeAlias = Any
    World: TypeAlias = Any
    Rate: TypeAlias = Any
    Cell: TypeAlias = Any
    File: TypeAlias = Any
else:
    from numpy.typing import ArrayLike as ArrayLike

    World: TypeAlias = Union[Model, "gymnasium.Env[Any, Any]", str]  # a FiniteMDP, an environment or its id
    Rate: TypeAlias = float | Schedule  # alpha, epsilon: a number or decaying(...)
    Cell: TypeAlias = tuple[int, int]  # (row, column), counted from 0
    File: TypeAlias = str | os.PathLike[str]

Given: TypeAlias = dict[str, Any]  # arguments by name, checked already
Rule: TypeAlias = Callable[[str, Any, Given], Any]  # rule(name, value, given), see rlcore.core.rules
OnEpisode: TypeAlias = Callable[[float, int], object]  # on_episode(return, steps so far); True ends the training
F = TypeVar("F", bound=Callable[..., Any])  # a function, and the same one decorated
C = TypeVar("C", bound=Callable[..., None] | type)  # an __init__, or a class
P = ParamSpec("P")
R = TypeVar("R")


class Checked(Protocol[P, R]):
    """A function of the same signature that checks what comes in; `unchecked` is the one that does not."""

    unchecked: Callable[P, R]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R: ...

    def __get__(self, instance: Any, owner: Any = None) -> Callable[..., R]: ...


class Checks(Protocol):
    """What `checked(...)` is, before it has its function or class."""

    @overload
    def __call__(self, function: C, /) -> C: ...  # type: ignore[overload-overlap]

    @overload
    def __call__(self, function: Callable[P, R], /) -> Checked[P, R]: ...


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
