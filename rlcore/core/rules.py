"""One table of rules by argument name, and `checked`, which looks up every argument of a function in it.

A rule is rule(name, value, given): it returns the value that the code works with, or raises a ValueError that names the
argument, what came and what is allowed. given: the arguments before it, checked already, by name.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, overload

import numpy as np

from rlcore.core.checks import (
    LARGEST,
    check_count,
    check_entries,
    check_finite,
    check_flag,
    check_function,
    check_index,
    check_mdp,
    check_pi,
    check_positive,
    check_probability,
    check_q,
    check_q0,
    check_rate,
    check_rng,
    check_v0,
    finite,
    finite_values,
    show,
    spaces,
)
from rlcore.core.types import Array, C, Checked, Checks, Given, Optimizer, P, R, Rule


def count(least: int = 1, most: int = LARGEST) -> Rule:
    """The rule of a whole number from `least` to `most`."""
    return lambda name, value, given: check_count(name, value, least, most)


def sized(*others: str | int) -> Rule:
    """The rule of a count that multiplies the entries of an array; others: numbers, and names of earlier arguments."""

    def rule(name, value, given):
        value = check_count(name, value)
        check_entries(name, *(given.get(other, other) for other in others), value)
        return value

    return rule


def index(size: Callable[[Given], int]) -> Rule:
    """The rule of a whole number below size(given)."""
    return lambda name, value, given: check_index(name, value, size(given))


def choice(*allowed: str) -> Rule:
    """The rule of one of the strings `allowed`."""

    def rule(name, value, given):
        if not isinstance(value, str) or value not in allowed:
            raise ValueError(f"{name}: got {show(value)}, allowed are {', '.join(map(repr, allowed))}")
        return value

    return rule


def function_of(what: str) -> Rule:
    """The rule of something that can be called with `what`."""
    return lambda name, value, given: check_function(name, value, what)


def array(*shape: str, kind: Callable[[str, Any], Array] = finite, empty: bool = False) -> Rule:
    """The rule of an array of as many dimensions as `shape` has letters; of numbers unless `kind` differs."""

    def rule(name, values, given):
        values = kind(name, values)
        if values.ndim != len(shape) or (0 in values.shape and not empty):
            must = f"({', '.join(shape)}{',' * (len(shape) == 1)}){' and not empty' * (0 in values.shape)}"
            raise ValueError(f"{name}: got shape {values.shape}, must be {must}")
        return values

    return rule


def like(other: str, kind: Callable[[str, Any], Array] = finite) -> Rule:
    """The rule of an array of the shape of the argument `other`."""

    def rule(name, values, given):
        values, shape = kind(name, values), np.shape(given[other])
        if values.shape != shape:
            raise ValueError(f"{name}: got shape {values.shape}, must be that of {other}, {shape}")
        return values

    return rule


def instance(kind: Any, what: str | None = None) -> Rule:
    """The rule of an instance of a class, which `what` says more about."""

    def rule(name, value, given):
        if not isinstance(value, kind):
            raise ValueError(f"{name}: got {type(value).__name__}, must be {what or 'a ' + kind.__name__}")
        return value

    return rule


def elementwise(*others: str, kind: Callable[[str, Any], Array] = finite) -> Rule:
    """The rule of a number, or of an array that fits to the arguments `others`, number by number."""

    def rule(name, values, given):
        array, shapes = kind(name, values), [np.shape(given[other]) for other in others if other in given]
        try:
            if 0 in np.broadcast_shapes(array.shape, *shapes):
                raise ValueError
        except ValueError:
            raise ValueError(f"{name}: got shape {array.shape}, must fit to {shapes}, not be empty") from None
        return array if array.ndim else values

    return rule


def rule_of(check: Callable[[str, Any], Any]) -> Rule:
    """The rule of a check(name, value)."""
    return lambda name, value, given: check(name, value)


def check_dtype(name: str, dtype: Any, given: Given | None = None) -> np.dtype[Any]:
    """dtype as a numpy.dtype; ValueError unless float32 or float64."""
    try:
        found = None if dtype is None else np.dtype(dtype)
    except (TypeError, ValueError):
        found = None
    if found not in (np.float32, np.float64):
        raise ValueError(f"{name}: got {show(dtype)}, must be numpy.float32 or numpy.float64")
    return found


def check_optimizer(name: str, optimizer: Any, given: Given | None = None) -> Optimizer:
    """optimizer; ValueError unless it has what a network's step calls."""
    if not callable(getattr(optimizer, "update", None)) or isinstance(optimizer, type):
        raise ValueError(f"{name}: got {show(optimizer)}, must be an SGD or Adam")
    return optimizer


def anything(name: str, value: Any, given: Given) -> Any:
    """The rule of an argument that the function itself, or what it calls, checks."""
    return value


def _of_mdp(check):
    return lambda name, value, given: check(given["mdp"], value, name)


def _pi(name, pi, given):
    return check_pi(given["mdp"].legal if "mdp" in given else spaces(given["world"])[0], pi)


def rules(rule: Rule, names: str) -> dict[str, Rule]:
    """One rule under several names."""
    return dict.fromkeys(names.split(), rule)


def takes_none(rule: Any) -> Any:
    """Mark a rule that is asked even where the default None came."""
    rule.takes_none = True
    return rule


def _v0(name, V0, given):
    return check_v0(spaces(given["world"])[1], V0) if "world" in given else finite_values(given["mdp"], V0, name)


def _q0(name, Q0, given):
    return check_q0(*spaces(given["world"]), Q0)


RULES = {
    "mdp": lambda name, mdp, given: check_mdp(mdp),
    "world": anything,
    "pi": _pi,
    "V": _of_mdp(finite_values),
    "Q": _of_mdp(check_q),
    "V0": _v0,
    "Q0": _q0,
    "rng": lambda name, rng, given: check_rng(rng),
    "s": index(lambda given: given["mdp"].n_states),
    "a": index(lambda given: given["mdp"].n_actions),
    "rewards": array("T", empty=True),
    "alpha": check_rate,
    **rules(check_probability, "gamma lam gamma_lam epsilon slip stop jerk"),
    **rules(check_positive, "tol lr"),
    **rules(check_finite, "unseen unvisited reward"),
    **rules(count(), "n n_states n_actions n_steps n_episodes n_iter n_runs max_iter max_steps T depth n_rows n_cols"),
    **rules(count(), "n_sweeps max_sweeps n_updates horizon n_candidates hold"),
    **rules(count(0), "record"),
    "dtype": check_dtype,
    "optimizer": check_optimizer,
    "on_episode": function_of("(return, steps so far)"),
    **rules(check_flag, "in_place online first_visit discount_states every_step printed each again"),
}


@overload
def checked(function: C, /, **special: Rule) -> C: ...  # type: ignore[overload-overlap]
@overload
def checked(function: Callable[P, R], /, **special: Rule) -> Checked[P, R]: ...
@overload
def checked(**special: Rule) -> Checks: ...
def checked(function: Any = None, /, **special: Rule) -> Any:
    """The function, its arguments checked by name: as RULES says, or as `special` where a name means another thing.

    An argument whose default is None may be None. A class: what makes its instances. `unchecked`: the function itself,
    for loops that know their arguments to be good. Raises TypeError at once where an argument has no rule.
    """
    if function is None:
        return functools.partial(checked, **special)
    if isinstance(function, type):
        function.__init__ = checked(function.__init__, **special)  # type: ignore[misc]
        return function
    check, signature = checker(function, special), inspect.signature(function)
    others = takes_others(signature)

    @functools.wraps(function)
    def call(*args, **kwargs):
        given = check(*args, **kwargs)
        if not others:
            return function(**given)
        bound = inspect.BoundArguments(signature, given)
        return function(*bound.args, **bound.kwargs)

    call.unchecked = function  # type: ignore[attr-defined]
    return call


def takes_others(signature: inspect.Signature) -> bool:
    """Whether a function takes arguments beyond those that it names."""
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return any(parameter.kind in kinds for parameter in signature.parameters.values())


def checker(function: Callable[..., Any], special: dict[str, Rule]) -> Callable[..., Given]:
    """A function of the same arguments that returns them as they come out of their rules, {name: value}."""
    signature = inspect.signature(function)
    parameters, others = signature.parameters.values(), takes_others(signature)
    every = {parameter.name: parameter.default for parameter in parameters}
    required = {parameter.name for parameter in parameters if parameter.default is parameter.empty}
    positional = [parameter.name for parameter in parameters if parameter.kind != parameter.KEYWORD_ONLY]
    rules = []
    for name, default in every.items():
        rule = special.get(name, RULES.get(name))
        if rule is None and name not in ("self", "cls"):
            raise TypeError(f"{function.__qualname__}: no rule for the argument {name}")
        rules.append((name, rule, default is None and not hasattr(rule, "takes_none")))

    def check(*args, **kwargs):
        given = dict(zip(positional, args)) | kwargs  # signature.bind takes 10 us
        if others or len(given) < len(args) + len(kwargs) or not required <= given.keys() <= every.keys():
            try:
                bound = signature.bind(*args, **kwargs)
            except TypeError as error:
                raise TypeError(f"{function.__qualname__}() {error}") from None
            bound.apply_defaults()
            given = bound.arguments
        given = every | given
        for name, rule, optional in rules:
            if rule is not None and not (optional and given[name] is None):
                given[name] = rule(name, given[name], given)
        return given

    return check
