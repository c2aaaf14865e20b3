"""Change the solution of every exercise in one place: the cases must notice.

    python tests/mutation_exercises.py [id or beginning of ids ...]     all where none is named
    python tests/mutation_exercises.py --list ...                       what passes, as lines for the list of excuses
    python tests/mutation_exercises.py --named ...                      which mistakes are named for the changes

A change that passes is equivalent, and listed with its reason in tests/mutation_exercises_allowed.txt, or the cases
are too kind. A change that is in no catalogue and gets the name of a mistake all the same was looked at: it is that
mistake, written otherwise, and listed in tests/mutation_exercises_named.txt with the beginning of what is said of it;
or cases or words are mended until it is. Exit status 1 where one is not listed, or a listed one is no longer there.
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

from rlcore.exercises import EXERCISES, engine
from rlcore.exercises.compare import difference, unchanged
from rlcore.exercises.sandbox import plain

NAMED = Path(__file__).parent / "mutation_exercises_named.txt"
ALLOWED = Path(__file__).parent / "mutation_exercises_allowed.txt"
SECONDS = 2.0  # of computing, for all cases of an exercise
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
    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
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
        signal.setitimer(signal.ITIMER_PROF, 0)


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


def results_of(exercise, cases, program):
    """What the answer that the program binds gives, as the checker has it; None where it raises or takes too long."""
    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        answer = exercise.bind(program)
        return [engine.call(answer, c.given) for c in cases] if exercise.is_function else [(plain(answer), None)]
    except (Exception, TooSlow):
        return None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def named(exercise):
    """(number of changes that fail and are not catalogued, {name: message} of those that get a catalogued message)."""
    cases, n, found = exercise.make_cases(), 0, {}
    rules = [exercise.rule(case) for case in cases]
    known = {ast.dump(ast.parse(wrong.source)) for wrong in exercise.wrong}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for name, program in mutants(exercise):
            if ast.dump(ast.parse(program.partition("\n")[2])) in known:
                continue
            results = results_of(exercise, cases, program)
            if results and any(engine.problem_of(exercise, got, case) for (got, _), case in zip(results, cases)):
                n += 1
                if message := engine.known_mistake(exercise, cases, results, rules):
                    found[name] = message
    return n, found


def judged():
    """{name: beginning of the message} of the changes that are a catalogued mistake, written otherwise."""
    rows = NAMED.read_text(encoding="utf-8").splitlines()
    return dict(row.split("  => ", 1) for row in rows if row.strip() and not row.startswith("#"))


def report_named(chosen, as_list):
    looked_at, total, count, left = judged(), 0, 0, 0
    for exercise in chosen:
        n, found = named(exercise)
        total, count = total + n, count + len(found)
        new = [name for name, message in found.items() if not message.startswith(looked_at.get(name, "\0"))]
        gone = [name for name in looked_at if name.startswith(f"{exercise.id}: ") and name not in found]
        left += len(new) + len(gone)
        for name in new:
            print(f"{name}  => {found[name][:60]}" if as_list else f"named: {name}\n    {found[name]}", flush=True)
        for name in gone:
            print(f"no longer named: {name}", flush=True)
    if not as_list:
        print(f"{len(chosen)} exercises, {total} changes that fail, {count} named, {left} not judged")
    return int(left > 0)


def main(arguments):
    wanted = tuple(a for a in arguments if not a.startswith("-"))
    chosen = [e for id, e in EXERCISES.items() if id.startswith(wanted or "")]
    if "--named" in arguments:
        return report_named(chosen, "--list" in arguments)
    chosen = [e for e in chosen if e.is_function]
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
