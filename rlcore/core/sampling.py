"""Drawing from tables of probabilities, in compiled loops, too."""

from __future__ import annotations

from collections import namedtuple
from typing import Any

import numpy as np

from rlcore.core.compiled import part
from rlcore.core.types import ArrayLike, Floats, Rng

Sampler = namedtuple("Sampler", "next_state reward cdf terminal start_cdf marks")


def cumulative(prob: ArrayLike) -> Floats:
    """Cumulative probabilities along the last axis, exactly 1 from the last positive entry on."""
    prob = np.asarray(prob)
    positive_after = np.cumsum(prob[..., ::-1] > 0, axis=-1)[..., ::-1] - (prob > 0)
    return np.where(positive_after > 0, np.cumsum(prob, axis=-1), 1.0)


@part
def draw(cdf: Floats, rng: Rng) -> int:
    """Index drawn from cumulative probabilities cdf, (K,)."""
    u = rng.random()
    k = 0
    while cdf[k] <= u:
        k += 1
    return k


@part
def step(world: Any, s: int, a: int, rng: Rng) -> tuple[int, float]:
    """One transition (s', r) of the sampled process. eq-1"""
    k = draw(world.cdf[s, a], rng)
    return world.next_state[s, a, k], world.reward[s, a, k]
