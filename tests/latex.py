"""Evaluates the LaTeX of chapters 1 to 5: sums, maxima, expectations, fractions, p(s', r | s, a), pi(a | s), v, q, and
the updates along an episode: V(S_t), Q(S_t, A_t), R_{t+1}, G_t^{t+n}(c), L_t, delta_t, E_{t-1}(s, a), I_{s S_t}.

`sides(latex)` splits an equation at its signs of equality and gives one function of a `Scope` for each side. What it
cannot read is a SyntaxError: nothing on the page is passed over in silence.
"""

import itertools
import json
import re
from functools import cache
from pathlib import Path

BOOK = Path(__file__).parents[1] / "book"
IGNORED = r"\\[,;!:> ]|\\(?:quad|qquad|[Bb]igg?[lr]?|left|right|displaystyle|notag|nonumber)(?![a-zA-Z])|&|~"
TOKEN = re.compile(r"\\[a-zA-Z]+'*|[a-zA-Z]'*|\d+|\\[{}]|\S")


class Scope:
    """Names and tables of one process.

    sets: {letter: values} over which sums and maxima run. tables: {(name, subscript, number of arguments): array or
    function}. rewards: R_1 ... R_T of one episode, for the returns. greek: values of alpha and lambda.
    """

    def __init__(self, sets, tables, rewards=(), gamma=0.9, greek=None):
        self.sets, self.tables, self.rewards, self.gamma = sets, tables, rewards, gamma
        self.greek = greek or {}

    def call(self, name, subscript, args):
        table = self.tables[name, subscript, len(args)]
        return table(*args) if callable(table) else table[tuple(int(x) for x in args)]


def sides(latex):
    """One function (scope, names) -> number for each side of the equation."""
    text = re.sub(r"\\(?:begin|end)\{\w+\*?\}|\\\\(?:\[[^]]*\])?", " ", latex)
    text = re.split(r",?\s*\\(?:q?quad)\b", text)[0] if r"\quad" in text or r"\qquad" in text else text
    text = re.sub(IGNORED, " ", text).strip().rstrip(".,")
    text = re.sub(
        r"\\(?:mathbb|mathcal|operatorname|mathrm)\*?\s*(?:\{\s*([A-Za-z]+)\s*\}|([A-Za-z]))", r"\\\1\2 ", text
    )
    text = re.sub(r"\\(?:doteq|leftarrow)\b", "=", text).replace(r"\mid", "|").replace(r"\ast", "*")
    text = re.sub(r"\^\{?\\prime\}?", "'", text)
    text = re.sub(r"\\[td]?frac\s*(\d)\s*(\d)", r"\\frac{\1}{\2}", text)
    reader = Reader(re.findall(TOKEN, re.sub(r"([a-zA-Z])\s+'", r"\1'", text)))
    found = [reader.expression()]
    while reader.take("="):
        found.append(reader.expression())
    reader.end()
    return found


class Reader:
    """Recursive descent; each method returns a function (scope, names) -> number."""

    def __init__(self, tokens):
        self.tokens, self.i = tokens, 0

    def peek(self):
        return self.tokens[self.i] if self.i < len(self.tokens) else None

    def take(self, *wanted):
        if self.peek() in wanted:
            self.i += 1
            return self.tokens[self.i - 1]
        return None

    def need(self, *wanted):
        if not (token := self.take(*wanted)):
            raise SyntaxError(f"{' '.join(self.tokens[: self.i])} >>> {self.peek()}, expected {wanted}")
        return token

    def end(self):
        if self.peek() is not None:
            raise SyntaxError(f"cannot read from here: {' '.join(self.tokens[self.i :])}")

    def expression(self):
        parts, spans = [], []
        sign = -1 if self.take("-") else 1
        while True:
            start = self.i
            if self.take(r"\dots", r"\cdots", r"\ldots"):
                parts.append((sign, None))
            else:
                parts.append((sign, self.product()))
            spans.append(self.tokens[start : self.i])
            if self.peek() not in ("+", "-"):
                break
            sign = 1 if self.need("+", "-") == "+" else -1
        for i, (sign, part) in enumerate(parts):
            if part is None:
                parts[i] = (sign, _continued(spans[i - 1], spans[i + 1 : i + 2]))
        return lambda scope, names: sum(sign * part(scope, names) for sign, part in parts)

    def product(self):
        factors = [self.factor()]
        while self.peek() not in (None, "+", "-", "=", ")", "]", "}", "|", ",", r"\}"):
            factors.append(self.factor())

        def value(scope, names):
            result = 1.0
            for factor in factors:
                result = result * factor(scope, names)
            return result

        return value

    def factor(self):
        base = self.atom()
        if not self.take("^"):
            return base
        power = self.group()
        return lambda scope, names: base(scope, names) ** power(scope, names)

    def group(self):
        """{...} or a single token."""
        if not self.take("{"):
            return self.atom()
        inner = self.expression()
        self.need("}")
        return inner

    def atom(self):
        token = self.need(self.peek() or "an expression")
        if token.isdigit():
            return lambda scope, names: float(token)
        if token == r"\gamma":
            return lambda scope, names: scope.gamma
        if token in ("(", "[", "{"):
            inner = self.expression()
            self.need({"(": ")", "[": "]", "{": "}"}[token])
            return inner
        if token == r"\frac":
            over, under = self.group(), self.group()
            return lambda scope, names: over(scope, names) / under(scope, names)
        if token == r"\infty":
            return lambda scope, names: len(scope.rewards)
        if token == r"\sum":
            return self.sum()
        if token == r"\arg":
            self.need(r"\max")
            return self.extreme(lambda pairs: max(pairs)[1])
        if token == r"\max":
            return self.extreme(lambda pairs: max(pairs)[0])
        if token in (r"\E", r"\Pr"):
            return self.expectation(token)
        if token in (r"\alpha", r"\lambda"):
            return lambda scope, names: scope.greek[token]
        if token == "I":
            return self.indicator()
        if token in ("R", "G", "S", "A", "L", r"\delta") and self.peek() == "_" or token == "T" and self.peek() != "(":
            return self.variable(token)
        if re.fullmatch(r"\\pi'*|[a-zA-Z]'*", token):
            return self.name(token.strip("\\"))
        raise SyntaxError(f"cannot read {token} in {' '.join(self.tokens)}")

    def name(self, token):
        """A variable, or a function with its arguments: v_\\pi(s), p(s', r | s, a), V_{k+1}(s)."""
        subscript = ""
        if self.take("_"):
            start = self.i
            if self.take("{"):
                while not self.take("}"):
                    self.need(self.peek() or "}")
            else:
                self.i += 1
            subscript = "".join(self.tokens[start : self.i]).strip("{}\\")
        if not self.take("("):
            if subscript:
                raise SyntaxError(f"{token}_{subscript} without arguments")
            return lambda scope, names: names[token]
        args, bars = [self.expression()], ""
        while sign := self.take(",", "|"):
            bars += sign
            args.append(self.expression())
        self.need(")")
        label = token + ("|" + str(bars.index("|")) if "|" in bars else "")
        return lambda scope, names: scope.call(label, subscript, [arg(scope, names) for arg in args])

    def variable(self, letter):
        """R_{t+1}, G_t, S_{t+1}, A_t; T."""
        if letter == "T":
            return lambda scope, names: len(scope.rewards)
        index = self.index()
        if letter == "G" and self.take("^"):
            return self.to_horizon(index)

        def value(scope, names):
            at = index(scope, {"t": 0, **names})
            if (letter, at) in names:
                return names[letter, at]
            if letter == "R":
                return scope.rewards[int(at) - 1] if 1 <= at <= len(scope.rewards) else 0.0
            if letter == "G" and ("S", at) in names:
                return scope.call("v", "pi", [names["S", at]])
            return scope.call(letter, "", [at])

        return value

    def to_horizon(self, index):
        """G_t^{h}(c): the discounted rewards up to h, then c; c is read only where h is not beyond the end."""
        horizon = self.group()
        self.need("(")
        rest = self.expression()
        self.need(")")

        def value(scope, names):
            t, h = int(index(scope, names)), int(horizon(scope, names))
            total = sum(scope.gamma ** (k - t) * scope.rewards[k] for k in range(t, h))
            return total + scope.gamma ** (h - t) * rest(scope, names)

        return value

    def indicator(self):
        """I_{xy} = 1 where x = y, else 0."""
        self.need("_")
        self.need("{")
        x, y = self.atom(), self.atom()
        self.need("}")
        return lambda scope, names: float(x(scope, names) == y(scope, names))

    def index(self):
        self.need("_")
        return self.group()

    def bound(self):
        """What stands under a sum or a maximum: its variables and, for \\sum_{k=a}^{b}, the limits."""
        self.need("_")
        many = self.take("{")
        names = [self.need(self.peek() or "a variable")]
        first = None
        while many and not self.take("}"):
            if self.take(","):
                names.append(self.need(self.peek()))
            elif self.take("="):
                first = self.expression()
            elif self.take(r"\in"):
                depth = 0
                while depth or self.peek() not in (",", "}"):
                    depth += {"(": 1, ")": -1, "{": 1, "}": -1}.get(self.need(self.peek() or "}"), 0)
            else:
                raise SyntaxError(f"cannot read {self.peek()} under a sum")
        if any(not re.fullmatch(r"[a-z]'*", name) for name in names):
            raise SyntaxError(f"cannot run over {names}")
        last = self.group() if first is not None and self.need("^") else None
        return names, first, last

    def sum(self):
        names, first, last = self.bound()
        body = self.product()

        def value(scope, known):
            if first is not None:
                low, high = first(scope, known), last(scope, known)
                return sum(body(scope, {**known, names[0]: k}) for k in range(int(low), int(high) + 1))
            spaces = [scope.sets[name.strip("'")] for name in names]
            return sum(body(scope, {**known, **dict(zip(names, x))}) for x in itertools.product(*spaces))

        return value

    def extreme(self, pick):
        names, *_ = self.bound()
        body = self.product()
        return lambda scope, known: pick(
            [(body(scope, {**known, names[0]: x}), x) for x in scope.sets[names[0].strip("'")]]
        )

    def expectation(self, kind):
        """E[X | S_t = s, A_t = a], E_pi[X | S_t = s], Pr{S_t = s', R_t = r | ...}: one step of the process."""
        policy = self.take("_") and self.need(r"\pi", "{")
        if policy == "{":
            policy = self.need(r"\pi") and self.need("}")
        close = {"[": "]", r"\{": r"\}", "(": ")", "{": "}"}[self.need("[", r"\{", "(", "{")]
        what = self.events() if kind == r"\Pr" else self.expression()
        self.need("|")
        given = self.events()
        self.need(close)

        def value(scope, names):
            base = {"t": 0, **names}
            fixed = {(letter, at(scope, base)): x(scope, base) for letter, at, x in given}
            now = min(at for letter, at in fixed if letter == "S")
            if ("A", now) not in fixed and not policy:
                raise SyntaxError("an expectation needs an action or a policy")
            total = weight = 0.0
            actions = [fixed["A", now]] if ("A", now) in fixed else scope.sets["a"]
            for a, s_next, r in itertools.product(actions, scope.sets["s"], scope.sets["r"]):
                s = fixed["S", now]
                seen = {("S", now): s, ("A", now): a, ("S", now + 1): s_next, ("R", now + 1): r}
                if any(seen.get(key, x) != x for key, x in fixed.items()):
                    continue
                p = scope.call("p|1", "", [s_next, r, s, a])
                p *= 1.0 if ("A", now) in fixed else scope.call("pi|0", "", [a, s])
                if now == base["t"]:  # one step is written out; what follows is worth v
                    seen["G", now] = r + scope.gamma * scope.call("v", "pi", [s_next])
                here = {**names, **seen, "t": base["t"]}
                if kind == r"\Pr":
                    total += p * all(here[letter, at(scope, here)] == x(scope, here) for letter, at, x in what)
                else:
                    total += p * what(scope, here)
                weight += p
            return total / weight

        return value

    def events(self):
        """S_t = s, A_t = a, ..."""
        found = []
        while True:
            letter, index = self.need("S", "A", "R"), self.index()
            self.need("=")
            found.append((letter, index, self.product()))
            if not self.take(","):
                return found


def _continued(before, after):
    """The terms that dots stand for: the one before with every number raised by 1, 2, ..., up to the one after."""
    if not before or not any(token.isdigit() for token in before):
        raise SyntaxError("dots without a term to continue")

    def term(n):
        reader = Reader([str(int(token) + n) if token.isdigit() else token for token in before])
        read = reader.product()
        reader.end()
        return read

    start = int(before[max(i for i, token in enumerate(before) if token.isdigit())])
    closed = [token for tokens in after for token in tokens]

    def value(scope, names):
        known = {"t": 0, **names}
        last = len(scope.rewards) - known["t"] - bool(closed)  # a closing term, R_T, is written out
        return sum(term(n)(scope, names) for n in range(1, last - start + 1))

    return value


# ---------------------------------------------------------------------- the page


@cache
def markdown(page):
    cells = json.loads((BOOK / f"{page}.ipynb").read_text(encoding="utf-8"))["cells"]
    return "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


@cache
def displays(page):
    """[(ids, LaTeX)] of every $$ ... $$, in order: its label, eq-7, and the anchors eq-... and om-... before it."""
    found, end = [], 0
    for m in re.finditer(r"\$\$(.+?)\$\$(?:[ ]*\(([\w-]+)\))?", markdown(page), re.S):
        anchors = re.findall(r'<span id="((?:eq|om)-[^"]*)">', markdown(page)[end : m.start()])
        found.append((anchors + [m[2]] * bool(m[2]), m[1]))
        end = m.end()
    return found


def printed(page):
    """{id: LaTeX} of the displays."""
    return {name: latex for names, latex in displays(page) for name in names}


def inline(page, anchor, start):
    """The first $ ... $ after an anchor that begins with `start`."""
    text = markdown(page).split(f'<span id="{anchor}"></span>')[1]
    return next(m for m in re.findall(r"(?<!\$)\$([^$]+)\$", text) if m.startswith(start))
