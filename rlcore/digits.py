"""Pictures of handwritten digits to train a network on (chapter 6)."""

import gzip
from pathlib import Path

import numpy as np

from rlcore.core.extras import extra
from rlcore.mdp import check_count, check_rng


def load_digits_28(*, size=28, n_train=1500, rng):
    """scikit-learn's 1,797 digits of 8x8 pixels, enlarged by bilinear interpolation, in random order. fig-47, ex-digits

    size: pixels a side; 8 leaves them as they are. n_train: how many are for training, the others for testing.
    Returns x_train (n_train, size * size) float32 in [0, 1], labels_train (n_train,), x_test, labels_test.
    Source: Alpaydin and Kaynak (1998), UCI; scikit-learn's load_digits.
    """
    with extra("digits"):
        from sklearn.datasets import load_digits

    size, n_train, rng = check_count("size", size, least=2), check_count("n_train", n_train), check_rng(rng)
    data = load_digits()
    if n_train >= len(data.images):
        raise ValueError(f"n_train: got {n_train}, must be below {len(data.images)}, the number of pictures")
    where = np.linspace(0, 7, size)  # positions of the new pixels among the old
    enlarge = np.maximum(0, 1 - np.abs(where[:, None] - np.arange(8)))  # (size, 8): linear interpolation
    x = (enlarge @ (data.images / 16) @ enlarge.T).reshape(-1, size * size).astype(np.float32)
    order = rng.permutation(len(x))
    train, test = order[:n_train], order[n_train:]
    return x[train], data.target[train], x[test], data.target[test]


def load_mnist(folder):
    """MNIST's 60,000 and 10,000 digits of 28x28 pixels from its four files, packed (.gz) or not. ex-digits

    folder: where train-images-idx3-ubyte, train-labels-idx1-ubyte and their t10k twins lie.
    Returns x_train (n, 784) float32 in [0, 1], labels_train (n,), x_test, labels_test.
    """
    arrays = []
    for part in ("train", "t10k"):
        images, labels = _read_idx(folder, f"{part}-images", 3), _read_idx(folder, f"{part}-labels", 1)
        if len(images) != len(labels):
            raise ValueError(f"folder: {part} has {len(images)} images and {len(labels)} labels, must be as many")
        arrays += [images.reshape(len(images), -1).astype(np.float32) / 255, labels.astype(np.int64)]
    return tuple(arrays)


def _read_idx(folder, name, n_dims):
    """One array of unsigned bytes: four bytes (0, 0, 8, n_dims), n_dims sizes of four bytes, the data."""
    found = sorted(path for path in Path(folder).glob(f"{name}*") if path.is_file())
    if not found:
        raise ValueError(f"folder: got {str(folder)!r}, must hold {name}-idx{n_dims}-ubyte, with or without .gz")
    raw = found[0].read_bytes()
    raw = gzip.decompress(raw) if found[0].suffix == ".gz" else raw
    shape = tuple(np.frombuffer(raw[4 : 4 + 4 * n_dims], ">u4"))
    data = np.frombuffer(raw[4 + 4 * n_dims :], np.uint8)
    if raw[:4] != bytes((0, 0, 8, n_dims)) or data.size != np.prod(shape):
        raise ValueError(f"folder: {found[0].name} is not an IDX file of {n_dims} dimensions of bytes")
    return data.reshape(shape)
