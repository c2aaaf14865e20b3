r"""The derivations of chapter 8: on which processes each is evaluated, which variables are free."""

REGISTRY = {}
HARMLESS = {}
BREAKS = {}

