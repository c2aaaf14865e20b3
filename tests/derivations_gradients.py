r"""The derivations of chapter 7: on which processes each is evaluated, which variables are free."""

REGISTRY = {}
HARMLESS = {}
BREAKS = {}
