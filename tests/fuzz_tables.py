"""Good calls of the functions of processes, tables and planning, where the names of ARGUMENTS do not say enough."""

from fuzz import MDP, PI, rng  # noqa: F401

CALLS = {}
