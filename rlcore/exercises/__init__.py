"""Exercises with a checker that names the mistake: check(id, answer), hint(id), solution(id)."""

import importlib
import pkgutil

from rlcore.exercises.engine import (
    EXERCISES,
    KINDS,
    Case,
    Exercise,
    Question,
    Verdict,
    Wrong,
    check,
    hint,
    solution,
)

CHAPTERS = {}
for _module in sorted(m.name for m in pkgutil.iter_modules(__path__) if m.name.startswith("ch")):
    CHAPTERS[_module] = importlib.import_module(f"rlcore.exercises.{_module}")

__all__ = [
    "CHAPTERS",
    "EXERCISES",
    "KINDS",
    "Case",
    "Exercise",
    "Question",
    "Verdict",
    "Wrong",
    "check",
    "hint",
    "solution",
]
