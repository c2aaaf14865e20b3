"""Sweeps: what is stored, what is run again, and what happens when processes die."""

import numpy as np
import pytest

from rlcore.sweep import sweep


def draw(x, rng):
    if x < 0:
        raise KeyError("negative")
    return {"x": np.float32(x), "u": rng.random(2), "pair": (1, None)}


def test_a_run_is_the_function_at_its_seed(tmp_path):
    records = sweep(draw, [dict(x=1), dict(x=0.5)], [3, 0], tmp_path / "new" / "store")
    assert [(r.setting, r.seed) for r in records] == [({"x": x}, seed) for x in (1, 0.5) for seed in (3, 0)]
    for r in records:
        u = draw(**r.setting, rng=np.random.default_rng(r.seed))["u"]
        assert r.result == {"x": r.setting["x"], "u": list(u), "pair": [1, None]} and r.error is None


def test_a_lambda_is_refused(tmp_path):
    with pytest.raises(ValueError, match="function: got .*top level"):
        sweep(lambda x, rng: x, [dict(x=1)], [0], tmp_path)
