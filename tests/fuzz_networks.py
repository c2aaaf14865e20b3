"""Good calls of what learns with networks, where the names of ARGUMENTS do not say enough."""

import numpy as np  # noqa: F401
from fuzz import network, rng  # noqa: F401

CALLS = {}
