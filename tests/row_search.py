"""Find breaks that the rows of the ledger notice: changes of the lines that they name, as a person would err."""

import ast
import re
import sys
from itertools import zip_longest
from pathlib import Path

import rows
import yaml

TRIES, SECONDS = 5, 100
KINDS = [  # (pattern, replacement): the likeliest errors first
    (r"\bgamma \* ", ""),
    (r" \* gamma\b", ""),
    (r"\bs_next\b", "s"),
    (r"\bargmax\b", "argmin"),
    (r"(?<=\.)max\(", "min("),
    (r"\bmax\(", "min("),
    (r" - ", " + "),
    (r" \+ ", " - "),
    (r"\+=", "-="),
    (r" / ", " * "),
    (r" \* ", " / "),
    (r"\*\*", "*"),
    (r"\bepsilon\b", "0.0"),
    (r" >= | > ", " < "),
    (r" <= | < ", " > "),
    (r" == ", " != "),
    (r" != ", " == "),
    (r" not ", " "),
    (r"\bgamma\b", "1.0"),
    (r"\bpi\b(?!\[)", "np.ones_like(pi)"),
    (r"\baxis=1\b", "axis=0"),
    (r" and ", " or "),
    (r"\bTrue\b", "False"),
    (r"\bFalse\b", "True"),
    (r"(?<![\w.])0\.\d+", "0.77"),
    (r"(?<![\w.])1(?![\w.])", "2"),
    (r"(?<![\w.])[02-9](?![\w.])", "1"),
    (r"\bsum\(", "max("),
    (r"\bmean\(", "max("),
    (r"\bzeros\b", "ones"),
    (r"\bones\b", "zeros"),
]
PICTURE = [
    (r'(?<=label\()f?"[^"]+"', '"wrong"'),
    (r'(?<=label=)f?"[^"]+"', '"wrong"'),
    (r"(\.(?:plot|bar|errorbar|step)\()(\w+), (\w+)", r"\1\3, \2"),
    (r'(?<=title\()f?"[^"]+"', '"wrong"'),
    (r'(?<=annotate\()f?"[^"]+"', '"wrong"'),
    (r'f?"[^"]*\{[^"]*"', '"wrong"'),
    *KINDS,
]


def candidates(name, file, first, last):
    """(old, new) for the lines of a name, those that come first in KINDS first."""
    path = rows.ROOT / file
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    skip = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Raise, ast.Import, ast.ImportFrom)) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        ):
            skip |= {*range(node.lineno, node.end_lineno + 1)}
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            start = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            skip |= {*range(start, node.body[0].lineno if isinstance(node, ast.FunctionDef) else node.lineno + 1)}
        elif isinstance(node, ast.While) or (isinstance(node, ast.If) and isinstance(node.body[0], ast.Raise)):
            skip.add(node.lineno)
    found = []
    for kind, (pattern, new) in enumerate(PICTURE if ".plots." in name else KINDS):
        for number in range(first, last + 1):
            line = lines[number - 1]
            code = line.split("  #")[0]
            if number in skip or not (match := re.search(pattern, code)):
                continue
            if pattern == r"\bs_next\b" and re.search(r"\bs_next\b.* = |for .* in ", code):
                continue
            changed = match.expand(new) if "\\" in new else new
            after = line[: match.start()] + changed + line[match.end() :]
            if after != line:
                found.append((kind, number, after))
    seen, out = set(), []
    for _, number, after in sorted(found):
        old, new = whole(text, lines, number, after)
        try:
            ast.parse(text.replace(old, new))
        except SyntaxError:
            continue
        if (old, new) not in seen:
            seen.add((old, new))
            out.append((old, new))
    return out


def whole(text, lines, number, after):
    """The change as a piece of text that stands in the file once."""
    old, new = lines[number - 1].strip(), after.strip()
    first, last = number, number
    while text.count(old) != 1:
        if first > 1 and (last - first) % 2 == 0:
            first -= 1
        else:
            last += 1
        old = "".join(lines[first - 1 : last])
        new = "".join([*lines[first - 1 : number - 1], after, *lines[number:last]])
    return old, new


def wanted(chosen, pictures=False):
    """{name: rows that have no break in it yet}; first the names that a row needs most."""
    have = {(b["row"], b["file"]) for b in rows.breaks()} | {b["row"] for b in rows.breaks()}
    found = {}
    for row in chosen:
        names = sorted(rows.ROWS[row]["code"], key=lambda n: ".plots." not in n)
        if row in have or (".plots." in names[0]) != pictures:
            continue
        found.setdefault(names[0], []).append(row)
    return found


def spans(names):
    """{name: places of its source, and then of what it calls}"""
    found = {}
    for name in names:
        thing, more = rows.resolved(name), []
        if not isinstance(thing, type):
            called = [thing.__globals__.get(n) for n in thing.__code__.co_names]
            more = [f for f in called if getattr(f, "__module__", "").startswith("rlcore.") and callable(f)]
        for part in [thing, *more]:
            try:
                found.setdefault(name, []).append(place(part))
            except (TypeError, AttributeError, OSError):
                continue
    return found


def place(thing):
    f, a, b = rows.span_of(thing)
    return str(Path(f).relative_to(Path(sys.path[0]))), a, b


def search(worker, workers, chosen, pictures):
    folder = rows.copy(rows.SCRATCH / f"search-{chosen[0]}-{worker}{pictures:d}")
    mine = list(wanted(chosen, pictures).items())[worker::workers]
    places = {}

    def ask():
        sys.path.insert(0, str(rows.ROOT))
        yield spans([name for name, _ in mine])

    for line in rows.child(ask, rows.LIMIT):
        places = line
    for name, left in mine:
        if name not in places:
            print("NO SOURCE", name, flush=True)
            continue
        first, *others = [[(p[0], *c) for c in candidates(name, *p)] for p in places[name]]
        for file, old, new in [*first[:TRIES], *[c for few in zip_longest(*others) for c in few if c]][: TRIES + 2]:
            changed, better = rows.compiled_at(file, old), []
            with rows.broken(folder, file, old, new):
                for line in rows.child(lambda left=left, c=changed: rows.tried(folder, c, left), SECONDS):
                    print(name, repr(new.strip()[:70]), line, flush=True)
                    if line["how"].startswith("assert") or line["how"].startswith("raises: ValueError"):
                        better.append(line["row"])
            with open(rows.BREAKS, "a", encoding="utf-8") as out:
                for row in better:
                    change = dict(row=row, file=file, old=old, new=new)
                    out.write(f"- {yaml.safe_dump(change, sort_keys=False, default_flow_style=True, width=10**6)}")
            left = [row for row in left if row not in better]
            if not left:
                break
        if left:
            print("UNNOTICED", name, left, flush=True)


def main(chosen, workers, pictures=False):
    return rows.parallel(lambda worker: search(worker, workers, chosen, pictures), workers)
