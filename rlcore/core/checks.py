"""What an argument may be: one table by name, and `checked`, which looks up every argument of a function in it.

A rule is rule(name, value, given): it returns the value that the code works with, or raises a ValueError that names the
argument, what came and what is allowed. given: the arguments before it, checked already, by name.
"""

import functools
import inspect
from numbers import Real

import numpy as np

LARGEST = 10**9  # of anything that is counted


class Model:
    """What a FiniteMDP is known by here: `rlcore.mdp` imports this module, not the other way round."""


def checked(function=None, /, **special):
    """The function, its arguments checked by name: as RULES says, or as `special` where a name means another thing.

    An argument whose default is None may be None. Raises TypeError at once where an argument has no rule.
    """
    if function is None:
        return functools.partial(checked, **special)
    check = checker(function, special)

    @functools.wraps(function)
    def call(*args, **kwargs):
        return function(**check(*args, **kwargs))

    return call


def checker(function, special):
    """A function of the same arguments that returns them as they come out of their rules, {name: value}."""
    signature, empty = inspect.signature(function), inspect.Parameter.empty
    rules, defaults = [], {name: parameter.default for name, parameter in signature.parameters.items()}
    places = [name for name, p in signature.parameters.items() if p.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
    for name, default in defaults.items():
        rule = special.get(name, RULES.get(name))
        if rule is None and name != "self":
            raise TypeError(f"{function.__qualname__}: no rule for the argument {name}")
        rules.append((name, rule, default is None and not hasattr(rule, "takes_none")))

    def check(*args, **kwargs):
        given = defaults.copy()  # signature.bind does the same, three times as slowly
        given.update(zip(places, args))
        given.update(kwargs)
        if (
            len(args) > len(places)
            or len(given) > len(defaults)
            or (kwargs and not kwargs.keys().isdisjoint(places[: len(args)]))
        ):
            try:
                signature.bind(*args, **kwargs)
            except TypeError as error:
                raise TypeError(f"{function.__name__}(): {error}") from None
        for name, rule, optional in rules:
            value = given[name]
            if value is empty:
                raise TypeError(f"{function.__name__}(): missing a required argument: {name!r}")
            if rule is not None and not (optional and value is None):
                given[name] = rule(name, value, given)
        return given

    return check


def show(value):
    """repr of a value, short."""
    text = repr(value)
    return text if len(text) < 200 else f"{text[:190]}..."


# ---------------------------------------------------------------------- one value


def is_number(value):
    """Whether value is a real number; True and False are not."""
    return isinstance(value, (float, int, Real)) and not isinstance(value, bool)  # the common ones first


def check_probability(name, value, given=None):
    """value as a float; ValueError unless it is a number in [0, 1]."""
    if not is_number(value) or not 0 <= value <= 1:
        raise ValueError(f"{name}: got {show(value)}, must be a number in [0, 1]")
    return float(value)


def check_gamma(gamma):
    """gamma as a float; ValueError unless 0 <= gamma <= 1."""
    return check_probability("gamma", gamma)


def check_positive(name, value, given=None):
    """value as a float; ValueError unless it is a finite number above 0."""
    if not is_number(value) or not 0 < value < np.inf:
        raise ValueError(f"{name}: got {show(value)}, must be a positive number")
    return float(value)


def check_nonnegative(name, value, given=None):
    """value as a float; ValueError unless it is a finite number, 0 or more."""
    if not is_number(value) or not 0 <= value < np.inf:
        raise ValueError(f"{name}: got {show(value)}, must be a number of at least 0")
    return float(value)


def check_fraction(name, value, given=None):
    """value as a float; ValueError unless it is above 0 and below 1."""
    if not is_number(value) or not 0 < value < 1:
        raise ValueError(f"{name}: got {show(value)}, must be above 0 and below 1")
    return float(value)


def check_rate(name, value, given=None):
    """value as a float; ValueError unless it is in (0, 1]."""
    if not (is_number(value) and 0 < value <= 1):
        raise ValueError(f"{name}: got {show(value)}, must be in (0, 1]")
    return float(value)


def check_finite(name, value, given=None):
    """value as a float; ValueError unless it is a finite number."""
    if not is_number(value) or not -np.inf < value < np.inf:
        raise ValueError(f"{name}: got {show(value)}, must be a finite number")
    return float(value)


def check_count(name, value, least=1):
    """value as an int; ValueError unless it is a whole number from `least` to LARGEST."""
    if not is_number(value) or not least <= value < np.inf or int(value) != value:
        raise ValueError(f"{name}: got {show(value)}, must be a whole number of at least {least}")
    if value > LARGEST:
        raise ValueError(f"{name}: got {show(value)}, must be a whole number of at most {LARGEST:,}")
    return int(value)


def check_index(name, value, size):
    """value as an int; ValueError unless it is a whole number in 0..size - 1."""
    if not is_number(value) or not 0 <= value < size or int(value) != value:
        raise ValueError(f"{name}: got {show(value)}, must be an integer in 0..{size - 1}")
    return int(value)


def check_flag(name, value, given=None):
    """value as a bool; ValueError unless it is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}: got {show(value)}, must be True or False")
    return bool(value)


def check_rng(rng):
    """rng; ValueError unless it is a numpy.random.Generator."""
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng: got {show(rng)}, must be a numpy.random.Generator such as numpy.random.default_rng(0)")
    return rng


def check_function(name, f, of):
    """f; ValueError unless it can be called. of: what it is called with, for the message."""
    if not callable(f):
        raise ValueError(f"{name}: got {show(f)}, must be a function of {of}")
    return f


# ---------------------------------------------------------------------- arrays


def as_floats(name, values):
    """values as a float array; ValueError where they are not numbers."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values
    array = _array(name, values, "numbers")
    if array.dtype.kind == "O" and all(is_number(x) for x in array.flat):
        array = array.astype(float)
    if array.dtype.kind not in "iuf" and array.size:
        raise ValueError(f"{name}: got {show(values)}, must be numbers")
    return array.astype(float, copy=False)


def as_integers(name, values):
    """values as an array of integers; ValueError where they are not."""
    array = _array(name, values, "integers")
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"{name}: got dtype {array.dtype}, must be integers")
    return array.astype(np.int64, copy=False)


def as_flags(name, values):
    """values as a bool array; ValueError unless they are True or False, or 1 and 0."""
    array = _array(name, values, "True or False")
    if array.dtype.kind not in "biuf" or ((array != 0) & (array != 1)).any():
        raise ValueError(f"{name}: got {show(values)}, must be True or False")
    return array.astype(bool, copy=False)


def _array(name, values, what):
    try:
        return np.asarray(values)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: got {show(values)}, must be {what}") from None


def finite(name, values, given=None):
    """values as a float array; ValueError where one is not finite."""
    values = as_floats(name, values)
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: contains {values[~np.isfinite(values)][0]:g}, must be finite")
    return values


def where(bad):
    """The first place that is True, as (s=0, a=1)."""
    return "(" + ", ".join(f"{name}={i}" for name, i in zip("sak", np.argwhere(bad)[0])) + ")"


# ---------------------------------------------------------------------- processes, policies, values


def check_mdp(mdp):
    """mdp; ValueError unless it is a FiniteMDP."""
    if not isinstance(mdp, Model):
        raise ValueError(f"mdp: got {type(mdp).__name__}, must be a FiniteMDP; from_env reads gymnasium's tables")
    return mdp


def check_world(name, world, given=None):
    """world; ValueError unless it is a FiniteMDP to act in. cl-031"""
    if not isinstance(world, Model):
        raise ValueError(f"{name}: got {type(world).__name__}, must be a FiniteMDP to act in")
    return world


def model_of(world):
    """The FiniteMDP that world is, or that its MDPEnv plays; None where there is none."""
    model = world if isinstance(world, Model) else getattr(getattr(world, "unwrapped", None), "mdp", None)
    return model if isinstance(model, Model) else None


def spaces(world):
    """(legal, terminal) of a world, (S, A) and (S,) bool; every action is legal and no state known to be terminal in an
    environment that is not an MDPEnv.

    Raises ValueError unless world is a FiniteMDP or a gymnasium.Env whose observations and actions are Discrete.
    """
    model = model_of(world)
    if model is not None:
        return model.legal, model.terminal
    sizes = [getattr(getattr(world, f"{name}_space", None), "n", None) for name in ("observation", "action")]
    if None in sizes:
        kind = type(world).__name__
        raise ValueError(
            f"world: got {kind}, must be a FiniteMDP or a gymnasium.Env with Discrete observations and actions"
        )
    return np.ones(sizes, bool), np.zeros(sizes[0], bool)


def check_policy(mdp, pi):
    """pi as a float array; ValueError unless it is (S, A) with rows that are distributions over A(s)."""
    return check_pi(check_mdp(mdp).legal, pi)


def check_pi(legal, pi):
    """As check_policy, where all that is known is which actions are legal, (S, A) bool."""
    pi = as_floats("pi", pi)
    if pi.shape != legal.shape:
        raise ValueError(f"pi: got shape {pi.shape}, must be {legal.shape}")
    bad = ~((pi >= 0).all(axis=1) & (np.abs(pi.sum(axis=1) - 1) <= 1e-9))
    if bad.any():
        s = np.flatnonzero(bad)[0]
        raise ValueError(f"pi: row {s} is {pi[s]}, must be probabilities that sum to 1")
    if (pi[~legal] > 0).any():
        raise ValueError(f"pi: probability on an action that is not legal at {where((pi > 0) & ~legal)}, must be 0")
    return pi


def finite_values(mdp, V, name="V"):
    """V as a new (S,) float array, from a number or an array of finite numbers; terminal states get 0."""
    V = finite(name, V)
    if V.shape not in ((), (check_mdp(mdp).n_states,)):
        raise ValueError(f"{name}: got shape {V.shape}, must be a number or ({mdp.n_states},)")
    return np.where(mdp.terminal, 0.0, V)


def check_q(mdp, Q, name="Q"):
    """Q as (S, A) floats with -inf at actions that are not legal; ValueError for another shape or NaN."""
    Q = as_floats(name, Q)
    if Q.shape != check_mdp(mdp).legal.shape:
        raise ValueError(f"{name}: got shape {Q.shape}, must be {mdp.legal.shape}")
    if np.isnan(Q).any():
        raise ValueError(f"{name}: contains NaN, must be numbers")
    return np.where(mdp.legal, Q, -np.inf)


def check_v0(terminal, V0):
    """V0, a number or (S,), as a new (S,) float array with 0 at terminal states."""
    return _table("V0", V0, terminal.shape, np.zeros(terminal.shape), ~terminal)


def check_q0(legal, terminal, Q0):
    """Q0, a number or (S, A), as a new (S, A) float array: -inf where not legal, 0 at terminal states."""
    Q0 = _table("Q0", Q0, legal.shape, np.full(legal.shape, -np.inf), legal)
    Q0[terminal] = 0.0
    return Q0


def _table(name, values, shape, otherwise, where):
    values = as_floats(name, values)
    if values.shape not in ((), shape):
        raise ValueError(f"{name}: got shape {values.shape}, must be a number or {shape}")
    values = np.where(where, values, otherwise)
    if not np.isfinite(values[where]).all():
        raise ValueError(f"{name}: contains a value that is not finite, must be numbers")
    return values


# ---------------------------------------------------------------------- rules


def count(least=1):
    """The rule of a whole number of at least `least`."""
    return lambda name, value, given: check_count(name, value, least)


def index(size):
    """The rule of a whole number below size(given)."""
    return lambda name, value, given: check_index(name, value, size(given))


def choice(*allowed):
    """The rule of one of the strings `allowed`."""

    def rule(name, value, given):
        if not isinstance(value, str) or value not in allowed:
            raise ValueError(f"{name}: got {show(value)}, allowed are {', '.join(map(repr, allowed))}")
        return value

    return rule


def function_of(what):
    """The rule of something that can be called with `what`."""
    return lambda name, value, given: check_function(name, value, what)


def array(*shape, kind=finite):
    """The rule of an array: letters of `shape` that repeat in a call are equal; numbers unless `kind` differs."""

    def rule(name, values, given):
        values = kind(name, values)
        if values.ndim != len(shape) or 0 in values.shape:
            raise ValueError(f"{name}: got shape {values.shape}, must be ({', '.join(shape)}{',' * (len(shape) == 1)})")
        return values

    return rule


def rule_of(check):
    """The rule of a check(name, value)."""
    return lambda name, value, given: check(name, value)


def anything(name, value, given):
    """The rule of an argument that the function itself, or what it calls, checks."""
    return value


def _of_mdp(check):
    return lambda name, value, given: check(given["mdp"], value, name)


def _pi(name, pi, given):
    return check_pi(given["mdp"].legal if "mdp" in given else spaces(given["world"])[0], pi)


def rules(rule, names):
    """One rule under several names."""
    return dict.fromkeys(names.split(), rule)


def takes_none(rule):
    """Mark a rule that is asked even where the default None came."""
    rule.takes_none = True
    return rule


def _world(name, world, given):
    spaces(world)
    return world


def _v0(name, V0, given):
    return check_v0(spaces(given["world"])[1], V0) if "world" in given else finite_values(given["mdp"], V0, name)


def _q0(name, Q0, given):
    return check_q0(*spaces(given["world"]), Q0)


RULES = {
    "mdp": lambda name, mdp, given: check_mdp(mdp),
    "world": _world,
    "pi": _pi,
    "V": _of_mdp(finite_values),
    "Q": _of_mdp(check_q),
    "V0": _v0,
    "Q0": _q0,
    "rng": lambda name, rng, given: check_rng(rng),
    "s": index(lambda given: given["mdp"].n_states),
    "a": index(lambda given: given["mdp"].n_actions),
    **rules(check_probability, "gamma lam gamma_lam"),
    **rules(check_positive, "tol lr"),
    **rules(count(), "n n_states n_actions n_steps n_episodes n_iter n_runs max_iter max_steps T depth"),
    **rules(count(0), "record"),
    **rules(check_flag, "in_place online first_visit discount_states every_step"),
}
