"""Pictures of handwritten digits to train a network on (chapter 6)."""

from __future__ import annotations

import numpy as np

from rlcore.core.checks import check_count
from rlcore.core.extras import extra
from rlcore.core.rules import checked
from rlcore.core.types import Floats, Ints, Rng

N_PICTURES = 1797


def _n_train(name, n, given):
    n = check_count(name, n)
    if n >= N_PICTURES:
        raise ValueError(f"{name}: got {n}, must be below {N_PICTURES}, the number of pictures")
    return n


def _size(name, size, given):
    size = check_count(name, size, 2)
    if size > 1000:
        raise ValueError(f"{name}: got {size}, must be at most 1,000 pixels a side")
    return size


@checked(size=_size, n_train=_n_train)
def load_digits_28(*, size: int = 28, n_train: int = 1500, rng: Rng) -> tuple[Floats, Ints, Floats, Ints]:
    """scikit-learn's 1,797 digits of 8x8 pixels, enlarged by bilinear interpolation, in random order.

    Parameters
    ----------
    size : int
        Pixels a side; 8 leaves them as they are.
    n_train : int
        How many are for training, the others for testing.
    rng : Rng
        What draws the order.

    Returns
    -------
    x_train : Floats
        (n_train, size * size), float32 in [0, 1].
    labels_train : Ints
        (n_train,).
    x_test : Floats
        Likewise.
    labels_test : Ints
        Likewise.

    Notes
    -----
    Ledger: fig-47, ex-digits.

    References
    ----------
    Alpaydin and Kaynak (1998), UCI; scikit-learn's load_digits.
    """
    with extra("digits"):
        from sklearn.datasets import load_digits

    data = load_digits()
    where = np.linspace(0, 7, size)  # positions of the new pixels among the old
    enlarge = np.maximum(0, 1 - np.abs(where[:, None] - np.arange(8)))  # (size, 8): linear interpolation
    x = (enlarge @ (data.images / 16) @ enlarge.T).reshape(-1, size * size).astype(np.float32)
    order = rng.permutation(len(x))
    train, test = order[:n_train], order[n_train:]
    return x[train], data.target[train], x[test], data.target[test]
