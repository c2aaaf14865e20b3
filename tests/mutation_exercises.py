"""Change the solution of every exercise in one place: the cases must notice.

    python tests/mutation_exercises.py [id or beginning of ids ...]     all where none is named
    python tests/mutation_exercises.py --list ...                       what passes, as lines for the list of excuses

A change that passes is equivalent, and listed with its reason in tests/mutation_exercises_allowed.txt, or the cases are
too kind. Exit status 1 where one is not listed, or a listed one is no longer there.
"""

import ast
import itertools
import signal
import sys
import warnings
from copy import deepcopy
from pathlib import Path

import mutation
import numpy as np

from rlcore.exercises import EXERCISES
from rlcore.exercises.compare import difference, unchanged

ALLOWED = Path(__file__).parent / "mutation_exercises_allowed.txt"
SECONDS = 2.0  # for all cases of an exercise
SWAPS = {
    "s": "s_next",
    "s_next": "s",
    "a": "a_next",
    "a_next": "a",
    "V_new": "V",
    "V": "V_new",
    "old": "new",
    "new": "old",
}


class TooSlow(BaseException):
    pass


def _stop(*_):
    raise TooSlow


def changes(tree):
    """(node, label, change) of one change each: those of mutation.py, dropped terms and swapped names."""
    yield from mutation.mutants(tree)
    known = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    known |= {node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and SWAPS.get(node.id) in known:
            yield node, f"{node.id} to {SWAPS[node.id]}", mutation._set(node, "id", SWAPS[node.id])
        for field, value in ast.iter_fields(node):
            if isinstance(value, ast.BinOp) and isinstance(value.op, (ast.Add, ast.Sub, ast.Mult, ast.Div)):
                for side in ("left", "right"):
                    label = f"only the {side} of {type(value.op).__name__}"
                    yield value, label, mutation._set(node, field, getattr(value, side))


def mutants(exercise):
    """(name, program) of each change."""
    seen, lines = {}, exercise.solution.splitlines()
    for i in range(sum(1 for _ in changes(ast.parse(exercise.solution)))):
        tree = ast.parse(exercise.solution)
        node, label, change = next(itertools.islice(changes(tree), i, None))
        line = lines[node.lineno - 1].strip()
        change()
        name = f"{exercise.id}: {line} | {label}"
        seen[name] = seen.get(name, 0) + 1
        program = "_same = lambda x: x\n" + ast.unparse(ast.fix_missing_locations(tree))
        yield name + (f" #{seen[name]}" if seen[name] > 1 else ""), program


def passes(exercise, cases, program):
    """Whether the answer that the program binds passes all cases."""
    signal.signal(signal.SIGALRM, _stop)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        answer = exercise.bind(program)
        for case in cases:
            given = deepcopy(case.given)
            got = answer(*given.values()) if case.given else answer
            if difference(got, case.expected, exercise.rule(case)) or unchanged(given, case.given):
                return False
        return True
    except (Exception, TooSlow):
        return False
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def allowed():
    rows = ALLOWED.read_text(encoding="utf-8").splitlines() if ALLOWED.exists() else []
    pairs = (row.rsplit("  # ", 1) for row in rows if row.strip() and not row.startswith("#"))
    return {name.strip(): reason for name, reason in pairs}


def survivors(exercise):
    """(number of changes, names of those that pass) of one exercise."""
    cases, n, alive = exercise.make_cases(), 0, []
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for name, program in mutants(exercise):
            n += 1
            if passes(exercise, cases, program):
                alive.append(name)
    return n, alive


def main(arguments):
    wanted = tuple(a for a in arguments if not a.startswith("-"))
    chosen = [e for id, e in EXERCISES.items() if e.is_function and id.startswith(wanted or "")]
    excuses, total, left = allowed(), 0, 0
    for exercise in chosen:
        n, alive = survivors(exercise)
        total += n
        new = [name for name in alive if name not in excuses]
        gone = [name for name in excuses if name.startswith(f"{exercise.id}: ") and name not in alive]
        left += len(new) + len(gone)
        print(*(name if "--list" in arguments else f"passes: {name}" for name in new), sep="\n", end="\n" * bool(new))
        print(*(f"no longer passes: {name}" for name in gone), sep="\n", end="\n" * bool(gone), flush=True)
    if "--list" not in arguments:
        print(f"{len(chosen)} exercises, {total} changes, {left} not accounted for")
    return int(left > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
