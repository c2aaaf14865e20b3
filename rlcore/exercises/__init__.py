"""Exercises with a checker that names the mistake: check(id, answer), hint(id), solution(id)."""

import importlib
import pkgutil

from rlcore.exercises.engine import (
    EXERCISES,
    KINDS,
    TIERS,
    Case,
    Exercise,
    Proof,
    Question,
    Verdict,
    Wrong,
    check,
    hint,
    solution,
)

_modules = sorted(m.name for m in pkgutil.iter_modules(__path__))
CHAPTERS = {name: importlib.import_module(f"{__name__}.{name}") for name in _modules if name.startswith("ch")}
BUILDS = {name: importlib.import_module(f"{__name__}.{name}") for name in _modules if name.endswith("_steps")}
PAGES = {**CHAPTERS, **BUILDS}

__all__ = [
    "BUILDS",
    "CHAPTERS",
    "EXERCISES",
    "KINDS",
    "PAGES",
    "TIERS",
    "Case",
    "Exercise",
    "Proof",
    "Question",
    "Verdict",
    "Wrong",
    "check",
    "hint",
    "solution",
]
