"""The arrays of a FiniteMDP: made from outcomes, matrices or a table of gymnasium, owned, compared, and checked."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np

from rlcore.core.checks import (
    as_flags,
    as_floats,
    check_entries,
    check_flag,
    check_index,
    is_float,
    is_number,
    show,
    veil,
)
from rlcore.core.rules import anything, array, checked, choice, rule_of
from rlcore.core.sparse import from_sparse, is_sparse
from rlcore.core.types import Array, ArrayLike, Given, Model

INT32 = np.iinfo(np.int32)


def freeze(*arrays: Any) -> tuple[Any, ...]:
    """The arrays, read-only from now on."""
    for x in arrays:
        x.flags.writeable = False
    return arrays


def own(name: str, given: Any, kind: Callable[..., Array]) -> Array:
    """kind(name, given), an array, as one that is read-only and that nobody else can write to; next_state as int32."""
    states = name == "next_state"
    values = given if states and type(given) is np.ndarray and given.dtype == np.int32 else kind(name, given)
    if states and values.size and not INT32.min <= values.min() <= values.max() <= INT32.max:
        raise ValueError(f"{name}: got {values.min()}..{values.max()}, must be states of the process")
    values = np.ascontiguousarray(values, np.int32 if states else None)
    made = values.base is None and values is not given and isinstance(given, (list, tuple, np.ndarray))
    return freeze(values if made or _is_frozen(values) else values.copy())[0]


def _is_frozen(x):
    while isinstance(x, np.ndarray) and not x.flags.writeable:
        x = x.base
    return x is None


def _table(name, outcomes, given):
    if not isinstance(outcomes, dict) or not outcomes:
        raise ValueError(f"{name}: got {show(outcomes)}, must be a table with at least one (s, a)")
    return {_pair(key): _merge(key, rows) for key, rows in outcomes.items()}


@checked(outcomes=_table, start=anything)
def from_outcomes(
    outcomes: Any, n_states: int | None = None, n_actions: int | None = None, start: Any = None
) -> tuple[Array, ...]:
    """next_state, prob, reward, legal, terminal and start of {(s, a): [(probability, s_next, reward), ...]}."""
    merged, largest = outcomes, max(s for row in outcomes.values() for s, _ in row)
    S = 1 + max(largest, max(s for s, _ in merged)) if n_states is None else n_states
    A = 1 + max(a for _, a in merged) if n_actions is None else n_actions
    K = max(len(row) for row in merged.values())
    check_entries("n_actions" if n_actions else "n_states" if n_states else "outcomes", S, A, K)
    if largest >= S:
        (s, a), k = next((pair, k) for pair, row in merged.items() for k, (s, _) in enumerate(row) if s >= S)
        raise ValueError(f"next_state: got {largest} at (s={s}, a={a}, k={k}), must be in 0..{S - 1}")
    next_state = np.repeat(np.arange(S), A * K).reshape(S, A, K)
    prob, reward, legal = np.zeros((S, A, K)), np.zeros((S, A, K)), np.zeros((S, A), bool)
    for (s, a), row in merged.items():
        if s >= S or a >= A:
            raise ValueError(f"outcomes: key {(s, a)} is outside 0..{S - 1} states, 0..{A - 1} actions")
        legal[s, a] = True
        for k, ((s_next, r), p) in enumerate(row.items()):
            next_state[s, a, k], prob[s, a, k], reward[s, a, k] = s_next, p, r
    terminal = ~legal.any(axis=1)
    legal[terminal], prob[terminal, :, 0] = True, 1.0
    return *freeze(next_state, prob, reward, legal, terminal), _start(start, terminal)


def _square(name, P, given):
    P = array("S", "A", "S", kind=as_floats)(name, P, given)
    if P.shape[0] != P.shape[2]:
        raise ValueError(f"{name}: got shape {P.shape}, must be (S, A, S)")
    if not (np.isfinite(P).all() and (P >= 0).all()):
        raise ValueError(f"{name}: contains {P[~(np.isfinite(P) & (P >= 0))][0]:g}, must be probabilities")
    return P


def _rewards(name, R, given):
    R, shape = as_floats(name, R), given["P"].shape
    if R.shape not in (shape, shape[:2]):
        raise ValueError(f"{name}: got shape {R.shape}, must be {shape[:2]} or {shape}")
    return R


@checked(
    P=anything, R=anything, terminal=rule_of(as_flags), start=anything, axes=choice("SAS", "ASS"), normalise=check_flag,
)  # fmt: skip
def from_arrays(
    P: Any, R: Any, terminal: ArrayLike | None = None, start: Any = None, axes: str = "SAS", normalise: bool = False
) -> tuple[Array, ...]:
    """The same of p(s'|s, a) (S, A, S) and r(s, a) or r(s, a, s'), or of sparse matrices, in either order of axes."""
    if is_sparse(P):
        *arrays, terminal = from_sparse(P, R, terminal, axes, normalise)
        return *freeze(*arrays), terminal, _start(start, terminal)
    if axes == "ASS":
        P, R = as_floats("P", P), as_floats("R", R)
        P, R = (x.transpose(1, 0, 2) if x.ndim == 3 else x for x in (P, R))
        R = np.repeat(R[:, None], P.shape[1], axis=1) if R.ndim == 1 and P.ndim == 3 else R
    return _from_dense(P, R, terminal, start, normalise)


@checked(P=_square, R=_rewards, terminal=anything, start=anything, normalise=anything)
def _from_dense(P, R, terminal, start, normalise):
    R = np.broadcast_to(R if R.ndim == 3 else R[:, :, None], P.shape)
    terminal = np.zeros(len(P), bool) if terminal is None else terminal
    if terminal.shape != (len(P),):
        raise ValueError(f"terminal: got shape {terminal.shape}, must be ({len(P)},)")
    bad = terminal[:, None, None] & (
        (np.nan_to_num(R) != 0) | (P > 0) & (np.arange(len(P)) != np.arange(len(P))[:, None, None])
    )
    if bad.any():
        s, a, s_next = np.argwhere(bad)[0]
        name, value = ("R", R[s, a, s_next]) if R[s, a, s_next] else ("P", P[s, a, s_next])
        raise ValueError(f"{name}: got {value:g} at (s={s}, a={a}, s_next={s_next}), must be 0 as {s} is terminal")
    K = max(1, int((P > 0).sum(axis=2).max()))
    order = np.argsort(P == 0, axis=2, kind="stable")[:, :, :K]  # positive entries first, in order of s'
    prob = np.take_along_axis(P, order, axis=2)
    legal = (prob > 0).any(axis=2) | terminal[:, None]
    if normalise:
        prob = np.divide(prob, prob.sum(axis=2, keepdims=True), out=prob, where=legal[:, :, None])
    reward = np.where(prob > 0, np.take_along_axis(R, order, axis=2), 0.0)
    prob[terminal], prob[terminal, :, 0], order[terminal] = 0.0, 1.0, np.flatnonzero(terminal)[:, None, None]
    return order, *freeze(prob, reward, legal), terminal, _start(start, terminal)


def rounded_sums(prob: Array) -> Array:
    """prob, rows of K divided by their sums where these miss 1 by more than rounding does: K times the last digit."""
    total = prob.sum(axis=-1, keepdims=True)
    rounding = min(prob.shape[-1] * np.finfo(float).eps, 1e-12)
    off = (np.abs(total - 1) > rounding) & (total > 0)
    return freeze(np.divide(prob, total, out=prob.copy(), where=off))[0] if off.any() else prob


def from_env(env: Any) -> tuple[dict[tuple[int, int], Any], dict[tuple[int, int], Any], Given]:
    """Outcomes, the rows (p, s', r, ends) that the table `P` of an environment has, and sizes, start and names."""
    if (changed := veil(env)) is not None:
        raise ValueError(f"env: got one in a {changed}, which its table knows nothing of; must be env.unwrapped")
    env = getattr(env, "unwrapped", env)
    table = getattr(env, "P", None)
    if table is None:
        raise ValueError(
            f"env: {type(env).__name__} has no transition table P; from_env reads toy-text tables, must have one"
        )
    table = {(s, a): [_row(s, a, row) for row in out] for s, rows in _items(table) for a, out in _items(rows, s)}
    S = _size(env, "observation", 1 + max(s for s, _ in table))
    A = _size(env, "action", 1 + max(a for _, a in table))
    terminal = {s2 for out in table.values() for p, s2, _, done in out if done and p > 0}
    told = any(done is not None for out in table.values() for *_, done in out)
    if not told:  # three fields: what ends is what stays for ever, for nothing
        stays = [all(s2 == s and not r for p, s2, r, _ in out if p > 0) for (s, _), out in table.items()]
        terminal = {s for s in range(S) if all(stay for (other, _), stay in zip(table, stays) if other == s)}
    outcomes = {(s, a): [row[:3] for row in out] for (s, a), out in table.items() if s not in terminal}
    start = getattr(env, "initial_state_distrib", None)
    names = {f"{kind}_names": getattr(env, f"{kind}_names", None) for kind in ("state", "action")}
    settings = dict(n_states=S, n_actions=A, start=None if start is None else np.asarray(start, float), **names)
    return outcomes, table if told else {}, settings


def _items(table, *place):
    """Pairs (place, rows) of a dict or a list."""
    kinds = dict, list, tuple, np.ndarray
    pairs = list(table.items() if isinstance(table, dict) else enumerate(table if isinstance(table, kinds) else ()))
    if (
        (not pairs and not place)
        or not isinstance(table, kinds)
        or not all(_is_index(i) and isinstance(rows, kinds) for i, rows in pairs)
    ):
        where = f" in state {place[0]}" if place else ""
        raise ValueError(f"env: P has {show(table)}{where}, must be lists, or dicts by number, of lists of outcomes")
    return pairs


def _row(s, a, row):
    good = isinstance(row, (tuple, list)) and len(row) in (3, 4) and all(map(is_float, row[:3]))
    if not good or not all(isinstance(ends, (bool, np.bool_)) or ends in (0, 1) for ends in row[3:]):
        raise ValueError(f"env: P has {show(row)} at (s={s}, a={a}), must be (probability, s_next, reward[, ends])")
    return (*row, None)[:4]


def _size(env, kind, least):
    n = getattr(getattr(env, f"{kind}_space", None), "n", None)
    return least if n is None else int(n)


def check_ends(mdp: Model, table: dict[tuple[int, int], Any]) -> None:
    """ValueError where a state that ends an episode can also be entered without ending it."""
    met = _reachable(mdp) & ~mdp.terminal
    for (s, a), out in table.items():
        for p, s_next, _, done in out if met[s] else ():
            if p > 0 and not done and mdp.terminal[s_next]:
                raise ValueError(f"env: (s={s}, a={a}) enters the terminal state {s_next} with terminated=False")


def names(name: str, values: Any) -> tuple[Any, ...]:
    """values as a tuple; ValueError unless it is a sequence of what can be told apart."""
    if isinstance(values, (str, bytes)) or not hasattr(values, "__iter__"):
        raise ValueError(f"{name}: got {show(values)}, must be a sequence of names")
    values = tuple(values)
    if not all(isinstance(x, Hashable) and x == x for x in values):
        raise ValueError(f"{name}: got {show(values)}, must be a sequence of names")
    return values


def check_shapes(mdp: Model) -> tuple[int, int]:
    if mdp.prob.ndim != 3 or 0 in mdp.prob.shape:
        raise ValueError(f"prob: got shape {mdp.prob.shape}, must be (S, A, K) with S, A, K at least 1")
    S, A, _ = mdp.prob.shape
    shapes = dict(next_state=mdp.prob.shape, reward=mdp.prob.shape, legal=(S, A), terminal=(S,), start=(S,))
    for name, shape in shapes.items():
        if getattr(mdp, name).shape != shape:
            raise ValueError(f"{name}: got shape {getattr(mdp, name).shape}, must be {shape}")
    for name, size in (("state_names", S), ("action_names", A)):
        if getattr(mdp, name) is not None and len(getattr(mdp, name)) != size:
            raise ValueError(f"{name}: got {len(getattr(mdp, name))} names, must be {size}")
    return S, A


def _is_index(i):
    return is_number(i) and isinstance(i, (int, np.integer)) and i >= 0


def _pair(key):
    if not (isinstance(key, tuple) and len(key) == 2 and all(_is_index(i) for i in key)):
        raise ValueError(f"outcomes: got key {key!r}, must be (s, a), two integers that are at least 0")
    return key


def _merge(key, rows):
    merged = {}
    for row in rows if hasattr(rows, "__iter__") else [rows]:
        if not (isinstance(row, (tuple, list)) and len(row) == 3 and all(map(is_float, row))):
            raise ValueError(f"outcomes: got {show(row)} at {key}, must be (probability, s_next, reward)")
        p, s_next, r = row
        if not _is_index(s_next):
            raise ValueError(f"outcomes: got s_next = {s_next!r} at {key}, must be an integer that is at least 0")
        if p < 0:
            raise ValueError(f"outcomes: got probability {p!r} at {key}, must be at least 0")
        merged[int(s_next), float(r)] = merged.get((int(s_next), float(r)), 0.0) + float(p)
    if not merged:
        raise ValueError(f"outcomes: no outcome at {key}, needs at least one; leave the pair out if it is not in A(s)")
    return merged


def _start(start, terminal):
    if start is None:
        if terminal.all():
            raise ValueError("terminal: every state is terminal, needs at least one that is not")
        return ~terminal / np.sum(~terminal)
    if isinstance(start, (list, tuple, np.ndarray)) and np.ndim(start := as_floats("start", start)):
        return start
    return 1.0 * (np.arange(terminal.size) == check_index("start", start, terminal.size))


def canonical(mdp: Model) -> list[Array]:
    """Arrays with equal outcomes merged, ordered by (s', r) and padding blanked: equal processes have equal arrays."""
    s_next, r, p = _ordered(mdp.next_state, mdp.reward, mdp.prob)
    for k in range(1, p.shape[2]):
        same = (p[:, :, k] > 0) & (s_next[:, :, k] == s_next[:, :, k - 1]) & (r[:, :, k] == r[:, :, k - 1])
        p[:, :, k] += np.where(same, p[:, :, k - 1], 0.0)
        p[:, :, k - 1] = np.where(same, 0.0, p[:, :, k - 1])
    return [*_ordered(s_next, r, p), mdp.legal, mdp.terminal, mdp.start]


def _ordered(next_state, reward, prob):
    used = prob > 0
    fields = [np.where(used, x, 0) for x in (next_state, reward, prob)]
    order = np.lexsort((fields[1], fields[0], ~used), axis=2)[:, :, : int(used.sum(axis=2).max())]
    return [np.take_along_axis(x, order, axis=2) for x in fields]


def _reachable(mdp):
    """States that some policy can meet, (S,) bool."""
    seen, frontier = mdp.start > 0, np.flatnonzero(mdp.start > 0)
    while frontier.size:
        found = np.unique(mdp.next_state[frontier][mdp.prob[frontier] > 0])
        frontier = found[~seen[found]]
        seen[frontier] = True
    return seen
