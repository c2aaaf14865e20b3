"""The arrays of a FiniteMDP from scipy's sparse matrices, which are never made dense."""

from __future__ import annotations

from typing import Any

import numpy as np

from rlcore.core.checks import as_floats, check_entries
from rlcore.core.types import Array, Flags


def is_sparse(P: Any) -> bool:
    """Whether P is a sparse matrix, or a list of them."""
    return hasattr(P, "tocsr") or (isinstance(P, (list, tuple)) and bool(P) and all(hasattr(p, "tocsr") for p in P))


def rows_of(name: str, P: Any, axes: str, A: int | None = None) -> tuple[Any, int]:
    """P as a CSR array of rows s A + a, and A; from one matrix (S, S) an action, or all rows in the order of axes."""
    from scipy.sparse import csr_array, vstack

    if isinstance(P, (list, tuple)):
        shapes = {p.shape for p in P}
        if len(shapes) > 1 or len(set(P[0].shape)) > 1:
            raise ValueError(f"{name}: got matrices of shapes {sorted(shapes)}, must be (S, S), one for each action")
        (S, _), n, axes, P = P[0].shape, len(P), "ASS", vstack(P)
    else:
        S, n = P.shape[1] if A is None else P.shape[0] // A, P.shape[0] // max(P.shape[1], 1)
    if not S or P.shape != (S * n, S):
        raise ValueError(f"{name}: got shape {P.shape}, must be (S A, S), or a list of (S, S), one for each action")
    P = csr_array(P)
    P.sum_duplicates()
    if axes == "ASS":
        P = P[np.arange(S * n).reshape(n, S).T.ravel()]
    if P.dtype.kind not in "iufb" or not (np.isfinite(P.data).all() and (name == "R" or (P.data >= 0).all())):
        raise ValueError(f"{name}: contains {P.data.min() if P.data.size else P.dtype}, must be finite numbers of 0 up")
    return P.astype(float), n


def from_sparse(P: Any, R: Any, terminal: Flags | None, axes: str, normalise: bool) -> tuple[Array, ...]:
    """next_state, prob, reward, legal and terminal."""
    P, A = rows_of("P", P, axes)
    S = P.shape[1]
    terminal = np.zeros(S, bool) if terminal is None else terminal
    if terminal.shape != (S,):
        raise ValueError(f"terminal: got shape {terminal.shape}, must be ({S},)")
    P.eliminate_zeros()
    ends = np.repeat(terminal, A)
    counts = np.where(ends, 1, np.diff(P.indptr))
    K = max(1, int(counts.max()))
    check_entries("P", S, A, K)
    row, k = (
        np.repeat(np.arange(S * A), np.diff(P.indptr)),
        np.arange(P.nnz) - np.repeat(P.indptr[:-1], np.diff(P.indptr)),
    )
    if (P.indices != row // A)[ends[row]].any():
        s = row[ends[row] & (P.indices != row // A)][0] // A
        raise ValueError(f"P: leads out of state {s}, must stay there as {s} is terminal")
    r = _rewards(R, P, row, S, A, axes)
    if r[ends[row]].any():
        raise ValueError(f"R: got {r[ends[row]][r[ends[row]] != 0][0]:g} in a terminal state, must be 0")
    next_state, prob, reward = np.zeros((S * A, K), np.int32), np.zeros((S * A, K)), np.zeros((S * A, K))
    next_state[:] = (np.arange(S * A) // A)[:, None]
    keep = ~ends[row]
    next_state[row[keep], k[keep]], prob[row[keep], k[keep]], reward[row[keep], k[keep]] = (
        P.indices[keep], P.data[keep], r[keep]
    )  # fmt: skip
    prob[ends, 0] = 1.0
    legal, shape = (prob > 0).any(axis=1), (S, A, K)
    if normalise:
        prob[legal] /= prob[legal].sum(axis=1, keepdims=True)
    return next_state.reshape(shape), prob.reshape(shape), reward.reshape(shape), legal.reshape(S, A), terminal


def _rewards(R, P, row, S, A, axes):
    """The reward of each entry of P."""
    if is_sparse(R):
        R, n = rows_of("R", R, axes, A)
        if (R.shape, n) != (P.shape, A):
            raise ValueError(f"R: got {R.shape[0]} rows, must be as P, {P.shape[0]}")
        return np.asarray(R[row, P.indices]).ravel() if row.size else np.zeros(0)
    R = as_floats("R", R)
    if R.shape == (S * A,):
        R = R.reshape(S, A) if axes == "SAS" else R.reshape(A, S).T
    if R.shape != (S, A):
        raise ValueError(f"R: got shape {R.shape}, must be ({S}, {A}), or sparse as P is")
    if not np.isfinite(R).all():
        raise ValueError("R: contains a value that is not finite, must be numbers")
    return R.ravel()[row]
