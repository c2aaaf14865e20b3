r"""The derivations of the chapters: where each stands, on which processes it is evaluated, which variables are free.

A derivation is a display after an anchor <span id="dv-..."></span>: one statement a line, its reason after &&. A line
that begins with a sign goes on from the line before; one that begins with \quad is the rest of it.
"""

import itertools
import re
from functools import cache

import derivations_gradients
import derivations_networks
import derivations_tables
import derivations_traces
import derivations_trust
import numpy as np
from latex import BOOK, cells, chain

CHAPTERS = derivations_tables, derivations_traces, derivations_networks, derivations_gradients, derivations_trust
REGISTRY = {name: found for module in CHAPTERS for name, found in module.REGISTRY.items()}
HARMLESS = {name: found for module in CHAPTERS for name, found in module.HARMLESS.items()}


# ---------------------------------------------------------------------- the page


@cache
def texts():
    """{name of the page: its Markdown}"""
    return {path.stem: "\n\n".join(cells(path.stem, "markdown")) for path in sorted(BOOK.glob("0*.ipynb"))}


ANCHOR = r'<span id="(dv-[^"]*)"></span>'


@cache
def derivations():
    """{id: (number of the chapter, LaTeX)} of every display after an anchor dv-..."""
    found = {}
    for page, text in texts().items():
        for name, latex in re.findall(ANCHOR + r"\s*\$\$(.+?)\$\$", text, re.S):
            found[name] = (int(re.search(r"\d+", page)[0]), latex)
    return found


def anchors():
    """Every anchor dv-... of the pages, whether or not a display follows."""
    return [name for text in texts().values() for name in re.findall('<span id="(dv-[^"]*)"', text)]


def lines(latex):
    """[(formula, reason)] of a display, a formula that goes on in the next line in one piece."""
    text = re.sub(r"\\(?:begin|end)\{(?:aligned|gathered)\}|\{\}", "", latex)
    found = []
    for line in re.split(r"\\\\(?:\[[^]]*\])?", text):
        formula, _, reason = line.strip().partition("&&")
        formula = formula.strip()
        if found and re.match(r"&?\s*\\q?quad", formula):
            before, said = found.pop()
            formula, reason = before + " " + re.sub(r"^&?\s*(\\q?quad\s*)+", "", formula), said + reason
        if re.search(r"\\q?quad|\\text(?!bf)", formula):
            raise SyntaxError(f"words in a formula: {formula}")
        found.append((formula, reason.strip()))
    return found


@cache
def worlds(name):
    return [(scope, names) for scope, found in REGISTRY[name].worlds() for names in found]


# ---------------------------------------------------------------------- the check


@cache
def evaluated(name, formula):
    """[(sign, values)]: each side of a line on every process of a derivation."""
    return [(sign, [side(scope, names) for scope, names in worlds(name)]) for sign, side in chain(formula)]


def statements(name, latex):
    """[[(sign, values, formula)]]: the chains of a display, without what cannot be evaluated."""
    found = []
    for formula, _ in lines(latex):
        plain = formula.replace("&", "").strip()
        if any(plain.startswith(start) for start in REGISTRY[name].unread):
            continue
        parts = [(sign, values, plain) for sign, values in evaluated(name, formula)]
        if parts[0][0]:
            found[-1] += parts  # without a chain to go on from: an IndexError
        else:
            found.append(parts)
    if any(len(parts) < 2 for parts in found):
        raise SyntaxError(f"{name}: a statement without a sign")
    return found


ROUNDED = 1e-4  # how far numbers with four decimals may lie from what they stand for


def holds(sign, x, y):
    """A plain 0 stands for a vector of zeros, too."""
    if np.shape(x) != np.shape(y) and not (np.ndim(y) == 0 and y == 0):
        return False
    size = 1e-9 * (1 + np.abs(x).max() + np.abs(y).max())
    gap = np.subtract(y, x, dtype=float)
    return bool(
        {"=": np.abs(gap) <= size, r"\le": gap >= -size, r"\ge": gap <= size, r"\approx": np.abs(gap) <= ROUNDED}[
            sign
        ].all()
        and np.isfinite(gap).all()
    )


def check(name, latex):
    """The number of steps; AssertionError where one does not hold, SyntaxError where it cannot be read.

    An inequality is also to be an equality somewhere: else a larger bound, or a lost factor, would pass for it.
    """
    steps = [step for parts in statements(name, latex) for step in itertools.pairwise(parts)]
    for (_, before, _), (sign, after, formula) in steps:
        for (_, names), x, y in zip(worlds(name), before, after, strict=True):
            assert holds(sign, x, y), f"{name}, {names}: {formula}: {x} {sign} {y}"
        known = sign == r"\approx" or any(formula.startswith(start) for start in REGISTRY[name].slack)
        assert known or any(holds("=", *pair) for pair in zip(before, after)), f"{name}: never attained: {formula}"
    return len(steps)


# ---------------------------------------------------------------------- errors made on purpose

BREAKS = {
    "plus": (r" \+ ", " - "),
    "minus": (r" - ", " + "),
    "gamma": (r"\\gamma(?!\^)(\\,)?", " "),
    "power of gamma": (r"\\gamma\^(\{[^}]*\}|\w)", r"\\gamma"),
    "another power": (r"\^([kjn])(?!\w)", r"^{\1+1}"),
    "power lowered": (r"\^\{([kjn])([+-]1)\}", r"^{\1}"),
    "square": (r"\^2", ""),
    "inverse": (r"\^\{-1\}", ""),
    "prime": (r"(?<=[a-z])'", ""),
    "prime of the policy": (r"(?<=\\pi)'", ""),
    "index": (r"_\{t([+-]1)\}", r"_t"),
    "index too high": (r"(?<=[A-Zxu])_t(?!\w)", r"_{t+1}"),
    "index of a sum": (r"_\{t\+([kj])\+1\}", r"_{t+\1}"),
    "start": (r"(?<=[kji])=([01])", lambda m: f"={int(m[1]) + 1}"),
    "limit": (r"\^\{?n(-1)?\}?(?=\s*[\\(])", lambda m: "^{n}" if m[1] else "^{n-1}"),
    "policy": (r"\\pi'?\(a'? \\mid s'?\)", ""),
    "chances": (r"p\(s'(, r)? \\mid s, a\)", ""),
    "chance of the time": (r"\\Pr\\\{\\tau = t\\\}", ""),
    "swapped": (r"p\(s', r \\mid s, a\)", r"p(s, r \\mid s', a)"),
    "maximum for sum": (r"\\sum(?=_(a|\{?a'))", r"\\max"),
    "sum for maximum": (r"\\max(?=_)", r"\\sum"),
    "average lost": (r"\\frac\{?1\}?(\{?n(\^2)?\}?)", ""),
    "denominator": (r"\\frac(\{[^{}]*\})\{[^{}]*\}", r"\1"),
    "reward": (r"(?<=[\[ ({])(r|R_\{t\+1\}) \+", ""),
    "condition": (r"(S_t = s|A_t = a)(?!')", lambda m: m[1][:6] + "0"),
    "condition lost": (r", A_t = a(?!')", ""),
    "sign": (r"\\le(?![a-z])", r"\\ge"),
    "sign too low": (r"\\ge(?![a-z])", r"\\le"),
    "no inequality": (r"\\[lg]e(?![a-z])", "="),
    "one": (r"(?<![\w={^-])1 - ", "2 - "),
    "two": (r"(?<![\w={^+-])2(?= )", "3"),
    "root": (r"\\sqrt", ""),
    "value": (r"v_\\pi(?!')", "v_*"),
    "best value": (r"(?<![a-zA-Z])([vq])_\*", r"\1_\\pi"),
    "factor": (r"&\s*(=|\\le|\\ge|\\doteq)(?![a-z])", r"\g<0> 2"),
    "average": (r"(\\bar )?P_(\\pi|\{\\pi(_\*|')\})(\^\{?\w+\}?)?(?!\()(\\,)? ", ""),
    "model": (r"\\bar\s*", ""),
    "step size": (r"\\alpha(_\w)?(\^2)?(?!\w) ?", ""),
    "epsilon": (r"\\varepsilon(_[rp])?(?!\w)", "1"),
    "mean": (r" - \\mu", ""),
    "discount left out": (r"\(1 - \\gamma\)", ""),
    "noise": (r"\\sigma(\^2)?", ""),
    "indicator": (r"I_\{s'? S_(t|\{t\+1\})\}", ""),
    "visits": (r"N\(s\)", ""),
    "number": (r"(?<=[XV])_([ij]|n|\{n-1\})(?!\w)", r"_1"),
    "exponent": (r"\^(\{n-i\}|\{k-t\}|\{k-1\})", ""),
    "sum left out": (r"\\(sum|prod)_(\w|\{[^}]*\})(\^(\{[^}]*\}|\w))?(?!\w)", ""),
    "term left out": (r"(?<=[^&=]) [+-] (?!\\(sum|prod|max|E|mathbb|big|Big|l))[^+\-=&\\()\[\]]+(?= )", ""),
    "largest for sum": (r"\\lVert (.*?) \\rVert_\\infty", r"\1"),
    "operator": (r"T_\*", r"T_\\pi"),
    "backup": (r"T_(\\pi|\*)(?![\^{]) ", ""),
}


def broken(name, latex):
    """The display with one place changed in one way, in its formulas alone."""
    more = next((module.BREAKS for module in CHAPTERS if name in module.REGISTRY), {})
    reasons = [m.span() for m in re.finditer(r"&&.*?(?=\\\\|\\end|$)", latex, re.S)]
    for pattern, new in [*BREAKS.values(), *more.values()]:
        found = [m for m in re.finditer(pattern, latex) if not any(a <= m.start() < b for a, b in reasons)]
        for m in found:
            yield latex[: m.start()] + (new(m) if callable(new) else m.expand(new)) + latex[m.end() :]


def difference(latex, original):
    """The line that an error has changed."""
    return next(
        (x for x, y in itertools.zip_longest(latex.split("\n"), original.split("\n")) if x != y), "no line is changed"
    )
