r"""Evaluates the LaTeX of chapters 1 to 8: sums, maxima, expectations, fractions, p(s', r | s, a), pi(a | s), v, q; the
updates along an episode: V(S_t), Q(S_t, A_t), R_{t+1}, G_t^{t+n}(c), L_t, delta_t, E_{t-1}(s, a), I_{s S_t}; vectors
and matrices: w_{jk}^l, w^l a^{l-1}, \odot; slopes, by central differences: \partial J / \partial b_j^l, \nabla \ln \pi;
means over a batch and distributions: \hat{\mathbb E}_t[r_t(\theta) \hat A_t], KL[\pi_{\theta_{old}}(\cdot | s_t), ...];
values as vectors: (I - \gamma P_\pi)^{-1} r_\pi, T_\pi^k v, (T_* Q)(s, a), \lVert v - w \rVert_\infty.

`sides(latex)` splits an equation at its signs of equality and gives one function of a `Scope` for each side;
`chain(latex)` keeps the signs. What they cannot read is a SyntaxError: nothing on the page is passed over in silence.
"""

import itertools
import json
import math
import re
from functools import cache, reduce
from pathlib import Path

import numpy as np

BOOK = Path(__file__).parents[1] / "book"
IGNORED = (
    r"\\[,;!:> ]|\\(?:quad|qquad|[Bb]igg?[lr]?|left|right|displaystyle|notag|nonumber|boldsymbol)(?![a-zA-Z])"
    r"|\\(?:wide)?hat(?![a-zA-Z])|&|~"
)
TOKEN = re.compile(r"\\[a-zA-Z]+'*|[a-zA-Z]'*|\d+\.\d+|\d+|\\[{}]|\S")
RELATIONS = ("=", "<", ">", r"\le", r"\ge", r"\approx")
ENDS = (None, *RELATIONS, "+", "-", "/", ")", "]", "}", "|", ",", r"\}", r"\rVert", r"\rvert")
WORDS = (
    "ell|kappa|muold|[AqvPr]old|omega|pi|theta|tau|sigma|mu|nu|delta|eta|output|activation|high|low|Delta|KL|ones|S|min"
    "|clip|UP"
)
NAMES = rf"\\(?:{WORDS}|bar[a-zA-Z]|piold|thetaold|dtarg|Vtarg|L[A-Z]+)'*|[a-zA-Z]'*"
TIMED = ("Delta", "r", "LCPI", "LCLIP", "LVF")  # functions whose index is a time: r_t(\theta)
DOTS = [[r"\dots"], [r"\cdots"], [r"\ldots"], [r"\vdots"], [r"\ddots"]]
POLICIES = (r"\pi", r"\pi'")
LAYERED = ("a", "b", "w", "z", "delta", "W")  # an exponent of these is the number of a layer, or a horizon
FUNCTIONS = {r"\ln": np.log, r"\log": np.log, r"\cos": np.cos, r"\sqrt": np.sqrt}


class Scope:
    """Names and tables of one process.

    sets: {letter: values} over which sums and maxima run. tables: {(name, subscript, number of arguments): array or
    function}; the subscript is "indexed" for a symbol without arguments, a_j^l: its arguments are l and j. rewards:
    R_1 ... R_T of one episode, for the returns. greek: values of alpha and lambda. trajectories: (probability, names)
    of every episode, for expectations; without them, one step of the process.
    """

    def __init__(self, sets, tables, rewards=(), gamma=0.9, greek=None, trajectories=()):
        self.sets, self.tables, self.rewards, self.gamma = sets, tables, rewards, gamma
        self.greek, self.trajectories = greek or {}, trajectories

    def call(self, name, subscript, args):
        table = self.tables[name, subscript, len(args)]
        return table(*args) if callable(table) else table[tuple(int(x) for x in args)]

    def gradient(self, f, x):
        return gradient(f, x)

    def stand_in(self, h, state):
        """What stands for all that comes after the horizon h in G_t^h."""
        return self.call("V", "", [state])

    def variable(self, letter, at, names):
        """R_t, G_t, S_t, A_t where the names do not say."""
        if letter == "R":
            return self.rewards[int(at) - 1] if 1 <= at <= len(self.rewards) else 0.0
        if letter == "G" and ("S", at) in names:
            return self.call("v", "pi", [names["S", at]])
        return self.call(letter, "", [at])

    def expect(self, kind, policy, what, given, names):
        """E[X | S_t = s, A_t = a], E_pi[X | S_t = s], Pr{S_t = s', R_t = r | ...}: one step of the process.

        E_{tau ~ pi_theta}[X]: over whole episodes. E_pi[X] without a condition, too, summed over the steps t.
        """
        if not given:
            steps = (lambda T: range(T + 1)) if policy == "pi" else lambda T: [None]
            return sum(
                p * what(self, {**names, **seen, **({} if t is None else {"t": t})})
                for p, seen in self.trajectories for t in steps(seen["T"])
            )  # fmt: skip
        base = {"t": 0, **names}
        fixed = {(letter, at(self, base)): x(self, base) for letter, at, x in given}
        if self.trajectories:
            paths = [(p, seen) for p, seen in self.trajectories if all(seen.get(i) == x for i, x in fixed.items())]
            return sum(p * what(self, {**base, **seen}) for p, seen in paths) / sum(p for p, _ in paths)
        now = min(at for letter, at in fixed if letter == "S")
        if ("A", now) not in fixed and not policy:
            raise SyntaxError("an expectation needs an action or a policy")
        total = weight = 0.0
        actions = [fixed["A", now]] if ("A", now) in fixed else self.sets["a"]
        for a, s_next, r in itertools.product(actions, self.sets["s"], self.sets["r"]):
            s = fixed["S", now]
            seen = {("S", now): s, ("A", now): a, ("S", now + 1): s_next, ("R", now + 1): r}
            if any(seen.get(key, x) != x for key, x in fixed.items()):
                continue
            p = self.call("p|1", "", [s_next, r, s, a])
            p *= 1.0 if ("A", now) in fixed else self.call("pi|0", "", [a, s])
            if now == base["t"]:  # one step is written out; what follows is worth v
                seen["G", now] = r + self.gamma * self.call("v", "pi", [s_next])
            here = {**names, **seen, "t": base["t"]}
            if kind == r"\Pr":
                total += p * all(here[letter, at(self, here)] == x(self, here) for letter, at, x in what)
            else:
                total += p * what(self, here)
            weight += p
        return total / weight


def sides(latex):
    """One function (scope, names) -> number for each side of the equation."""
    return [side for _, side in chain(latex)]


def chain(latex):
    """[(sign, side)]: what stands left of each side, "" at the first unless the text begins with a sign."""
    text = re.sub(r"\\begin\{bmatrix\}(.*?)\\end\{bmatrix\}", _bmatrix, latex, flags=re.S)
    text = re.sub(r"\\(?:begin|end)\{\w+\*?\}|\\\\(?:\[[^]]*\])?", " ", text)
    text = re.split(r",?\s*\\(?:q?quad)\b", text)[0] if r"\quad" in text or r"\qquad" in text else text
    text = re.sub(r"\\hat\s*([mv])_t", r"\\bar\1 _t", text)  # of Adam: corrected, not estimated
    text = re.sub(IGNORED, " ", text).strip().rstrip(".,;")
    text = re.sub(r"\\bar\s+([a-zA-Z])", r"\\bar\1 ", text)
    text = re.sub(r"\\mathbf\s*\{?1\}?", r"\\ones ", text)
    text = re.sub(
        r"\\(?:mathbb|mathcal|operatorname|mathrm|text)\*?\s*(?:\{\s*([A-Za-z]+)\s*\}|([A-Za-z]))", r"\\\1\2 ", text
    )
    text = re.sub(r"\\(?:doteq|leftarrow|propto)\b", "=", text).replace(r"\mid", "|").replace(r"\ast", "*")
    text = re.sub(r"\^\{?\\prime\}?", "'", text)
    text = re.sub(r"\{\s*(\\E)\s*\}", r"\1", text)  # the hat was here
    text = re.sub(r"\\?([a-zA-Z]+)_\{(old|targ)\}", r"\\\1\2 ", text)
    text = re.sub(r"([LV])(_t|)\^\{([A-Z+]+|targ)\}", lambda m: rf"\{m[1]}{m[3].replace('+', '')}{m[2]} ", text)
    text = re.sub(r"S\[([^][]*)\]", r"\\S_{\1}", text)
    text = re.sub(r"KL\[([^][]*)\]", r"\\KL(\1)", text)
    text = re.sub(r"\\partial (\w) / \\partial (\S+)", r"\\frac{\\partial \1}{\\partial \2}", text)
    text = re.sub(r"\\[td]?frac\s*(\d)\s*(\d)", r"\\frac{\1}{\2}", text)
    reader = Reader(re.findall(TOKEN, re.sub(r"([a-zA-Z])\s+'", r"\1'", text)))
    found = [(reader.take(*RELATIONS) or "", reader.expression())]
    while sign := reader.take(*RELATIONS):
        found.append((sign, reader.expression()))
    reader.end()
    return found


def _bmatrix(found):
    return r"\bmatrix{" + found[1].replace(r"\\", ";").replace("&", "@") + "}"


def read(tokens):
    reader = Reader(tokens)
    side = reader.expression()
    reader.end()
    return side


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
        groups = [[self.factor()]]
        while self.peek() not in ENDS:
            if self.take(r"\odot"):
                groups.append([])
            self.take(r"\cdot")
            groups[-1].append(self.factor())
        under = self.take("/") and self.product()

        def value(scope, names):
            over = reduce(_entrywise, [reduce(_times, [x(scope, names) for x in group]) for group in groups])
            return over / under(scope, names) if under else over

        return value

    def factor(self):
        base = self.atom()
        if not self.take("^"):
            return base
        if self.take("T"):
            return lambda scope, names: _transposed(base(scope, names))
        power = self.group()
        return lambda scope, names: _power(base(scope, names), power(scope, names))

    def group(self):
        """{...} or a single token."""
        if not self.take("{"):
            return read([self.need(self.peek() or "an index")])
        inner = self.expression()
        self.need("}")
        return inner

    def atom(self):
        token = self.need(self.peek() or "an expression")
        if token[0].isdigit():
            return lambda scope, names: float(token)
        if token == r"\gamma":
            return lambda scope, names: scope.gamma
        if token in ("(", "[", "{"):
            inner = self.row({"(": ")", "[": "]", "{": "}"}[token])
            return self.entry(inner) if token == "(" and self.is_entry() else inner
        if token == "|" and "".join(self.tokens[self.i : self.i + 2]) == "B|":
            self.i += 2
            return lambda scope, names: len(scope.sets["B"])
        if token in ("|", r"\lvert", r"\lVert"):
            inner, size = self.expression(), np.linalg.norm if token == r"\lVert" else abs
            self.need(token.replace(r"\l", r"\r"))
            if token == r"\lVert" and self.take("_"):
                self.need(r"\infty")
                size = _largest
            return lambda scope, names: size(inner(scope, names))
        if token == r"\frac" and self.tokens[self.i : self.i + 2] == ["{", r"\partial"]:
            return self.partial()
        if token == r"\frac":
            over, under = self.group(), self.group()
            return lambda scope, names: over(scope, names) / under(scope, names)
        if token == r"\partial":  # \partial_i f: the slope in the i-th parameter
            at, body = self.index(), self.factor()
            return lambda scope, names: scope.slope(lambda: body(scope, names), int(at(scope, names)))
        if token == r"\nabla":
            return self.nabla()
        if token == r"\bmatrix":
            return self.matrix()
        if token in FUNCTIONS:
            power, x = self.take("^") and self.group(), self.factor()
            return lambda scope, names: FUNCTIONS[token](x(scope, names)) ** (power(scope, names) if power else 1)
        if token == "e" and self.peek() == "^":
            return lambda scope, names: math.e
        if token == r"\infty":
            return lambda scope, names: names["infinity"] if "infinity" in names else len(scope.rewards)
        if token in (r"\sum", r"\prod"):
            return self.sum(sum if token == r"\sum" else math.prod)
        if token == r"\arg":
            self.need(r"\max")
            return self.extreme(lambda pairs: max(pairs)[1])
        if token == r"\max" and self.take(r"\{"):
            among = self.row(r"\}")
            return lambda scope, names: np.max(among(scope, names))
        if token == r"\max" and self.take("("):
            among = self.row(")")
            return lambda scope, names: np.max(among(scope, names))
        if token in (r"\max", r"\sup"):
            return self.extreme(lambda pairs: max(pairs)[0])
        if token in (r"\E", r"\Pr"):
            return self.expectation(token)
        if token == r"\Var":
            return self.variance()
        if token in (r"\alpha", r"\beta", r"\lambda", r"\epsilon", r"\varepsilon", r"\rho"):
            if self.peek() == "_" and {*self.tokens[self.i + 1 : self.i + 2]} & {"t", "k", "j", "0"}:
                return self.symbol(token.strip("\\"), *self.indices(token))
            letter = token + "_" + self.need("w", "r", "p", "1", "2") if self.take("_") else token
            return lambda scope, names: scope.greek[letter]
        if token == "I" and self.peek() == "_":
            return self.indicator()
        if token == "T" and self.peek() == "_" and {*self.tokens[self.i + 1 : self.i + 4]} & {*POLICIES, "*"}:
            return self.operator()
        of_policy = self.tokens[self.i : self.i + 3] == ["_", "{", r"\piold"]
        letters = ("R", "G", "S", "A", "L")
        if token in letters and self.peek() == "_" and not of_policy or token == "T" and self.peek() != "(":
            return self.variable(token)
        if re.fullmatch(NAMES, token):
            return self.name(token.strip("\\"))
        raise SyntaxError(f"cannot read {token} in {' '.join(self.tokens)}")

    def is_entry(self):
        """Whether (s) or (s, a) comes next, which picks from what stands in brackets before it: (T_\\pi v)(s)."""
        found = [token for token in self.tokens[self.i : self.i + 5] if re.fullmatch("[(),]|[sa]'*", token)]
        return re.match(r"\(s'*(,[as]'*)?\)", "".join(found)) and self.tokens[self.i + 1] == found[1]

    def entry(self, of):
        args = self.need("(") and self.row(")")
        return lambda scope, names: of(scope, names)[tuple(np.atleast_1d(args(scope, names)).astype(int))]

    def operator(self):
        """T_\\pi v, T_*^k v: what the scope's operator makes of the vector right of it."""
        below, _ = self.indices("T")
        power, of = self.take("^") and self.group(), self.factor()

        def value(scope, names):
            x = of(scope, names)
            for _ in range(int(power(scope, names)) if power else 1):
                x = scope.tables["T", "".join(below).strip("\\"), 1](x)
            return x

        return value

    def row(self, close):
        """What stands between brackets: one expression, or several, which make a vector."""
        items, spans = [], []
        while not items or self.take(","):
            start = self.i
            items.append(None if self.take(r"\dots") else self.expression())
            spans.append(self.tokens[start : self.i])
        self.need(close)
        if len(items) == 1 and items[0]:
            return items[0]
        return lambda scope, names: np.array([read(x)(scope, names) for x in _filled(spans, names)])

    def matrix(self):
        """\\begin{bmatrix} with its corners, or the ends of a column, and dots between them."""
        self.need("{")
        rows, depth = [[[]]], 1
        while depth := depth + {"{": 1, "}": -1}.get(token := self.need(self.peek() or "}"), 0):
            if token in (";", "@"):
                rows.append([[]]) if token == ";" else rows[-1].append([])
            else:
                rows[-1][-1] += list(token) if token.isdigit() else [token]

        if len(rows) != 3 or any(cell not in DOTS for cell in rows[1]):
            raise SyntaxError("a matrix has a first row, dots and a last row here")

        def value(scope, names):
            ends = [_filled(rows[i], names) for i in (0, 2)]
            columns = [_filled([first, DOTS[0], last], names) for first, last in zip(*ends, strict=True)]
            table = np.array([[read(cell)(scope, names) for cell in column] for column in columns]).T
            return table[:, 0] if len(columns) == 1 else table

        return value

    def partial(self):
        """\\frac{\\partial J}{\\partial z_j^l}"""
        self.need("{"), self.need(r"\partial")
        what = self.need(self.peek() or "a cost")
        of = self.places(*self.indices(what))
        self.need("}"), self.need("{"), self.need(r"\partial")
        token = self.need("w", "b", "z", "a")
        at = of + self.places(*self.indices(token))
        self.need("}")
        kinds = ("d" + what, "d" + token) if of else (token, "d" + what)
        return lambda scope, names: scope.call(*kinds, [i(scope, names) for i in at])

    def nabla(self):
        """The gradient of what follows with respect to theta, or W; to w where that is what it depends on."""
        by = self.take("_") and self.need("a", "h", "W", r"\theta")
        if by == "a":
            what = self.need("J")
            return lambda scope, names: scope.call("nabla_a", what, [])
        start = self.i
        body = self.factor()
        variable = by if by in ("W", "h") else "w" if "w" in self.tokens[start : self.i] else "theta"
        return lambda scope, names: scope.gradient(lambda: body(scope, names), scope.tables[variable, "", 0])

    def indices(self, token):
        """What stands below a letter, as tokens, and, where that counts layers, what stands above."""
        below, above = [], []
        if self.take("_"):
            start = self.i
            if self.take("{"):
                while not self.take("}"):
                    self.need(self.peek() or "}")
            else:
                self.i += 1
            below = self.tokens[start : self.i]
            below = below[1:-1] if below[0] == "{" else below
        if token in LAYERED and self.peek() == "^" and self.tokens[self.i + 1 : self.i + 2] != ["T"]:
            self.need("^")
            above = [self.group()]
        return below, above

    def places(self, below, above):
        """w_{jk}^l, w_{12}^1: an index each where layers are counted; w_{10}, without a layer, is the tenth."""
        apart = [x for i in below for x in (i if above and i.isdigit() else [i])]
        split = [below] if {"+", "-"} & {*below} else [[x] for x in apart]
        return above + [read(tokens) for tokens in split]

    def symbol(self, token, below, above):
        """w_{jk}^l, at l, j and k. Where no layers are counted, w_i^2 is a square."""
        at = self.places(below, above)

        def value(scope, names):
            index = [i(scope, names) for i in at]
            plain = (token, *index[1:]) if below else token
            if above and plain in names:
                return names[plain] ** index[0]
            if any(np.ndim(i) for i in index):  # \pi_\theta
                return scope.call(token, "indexed", index)
            return names[token, *index] if (token, *index) in names else scope.call(token, "indexed", index)

        return value

    def name(self, token):
        """A variable, a_j^l, or a function with its arguments: v_\\pi(s), p(s', r | s, a), V_{k+1}(s)."""
        below, above = self.indices(token)
        if above and token == "W" and self.take("("):  # W_k^h(s): after k updates towards what is known at h
            at = [read(below), *above, *self.row_of_arguments()]
            return lambda scope, names: scope.call("W", "timed", [x(scope, names) for x in at])
        if above or below and self.peek() != "(":
            return self.whole(token, below) or self.symbol(token, below, above)
        if not self.take("("):
            return lambda scope, names: names[token] if token in names else scope.call(token, "", [])
        subscript = "".join(below).strip("\\")
        args, bars = [self.argument()], ""
        while sign := self.take(",", "|"):
            bars += sign
            args.append(self.argument())
        self.need(")")
        label = token + ("|" + str(bars.index("|")) if "|" in bars else "")
        if token in TIMED and below == ["t"]:
            args.insert(0, read(below))
        timed = (label, "timed", len(args) + 1)

        def value(scope, names):
            found = [arg(scope, names) for arg in args]
            if below and timed in scope.tables:  # E_{t-1}(s), a function at each time
                return scope.call(label, "timed", [read(below)(scope, names), *found])
            return scope.call(label, subscript, found)

        return value

    def row_of_arguments(self):
        """What is left of f(x, y) after the first bracket."""
        args = [self.argument()]
        while self.take(","):
            args.append(self.argument())
        self.need(")")
        return args

    def whole(self, token, below):
        """v_\\pi, P_\\pi, v_*: all entries at once."""
        if token in LAYERED or not below:
            return None
        key = token, "".join(below).strip("\\"), 0
        try:
            entry = self.symbol(token, below, []) if "*" not in below else None
        except SyntaxError:
            entry = None
        return lambda scope, names: scope.tables[key] if key in scope.tables or not entry else entry(scope, names)

    def argument(self):
        """s; y = s, the value of y; or a dot for all of them."""
        if self.take(r"\cdot"):
            return lambda scope, names: slice(None)
        argument = self.expression()
        return self.expression() if self.take("=") else argument

    def variable(self, letter):
        """R_{t+1}, G_t, S_{t+1}, A_t; T."""
        if letter == "T":
            return lambda scope, names: names["T"] if "T" in names else len(scope.rewards)
        index = self.index()
        if letter == "R" and self.tokens[self.i : self.i + 3] == ["(", r"\tau", ")"]:
            self.i, letter = self.i + 3, "R(tau)"
        if letter == "G" and self.take("^"):
            return self.to_horizon(index)
        if letter == "A" and self.take("^"):  # A_t^{(k)}: an advantage of k steps
            steps = self.group()
            return lambda scope, names: scope.call("A", "steps", [index(scope, names), steps(scope, names)])
        if letter == "L" and self.take("^"):  # L_t^h: the lambda-return of what is known at h
            horizon = self.group()
            return lambda scope, names: scope.call("L", "timed", [index(scope, names), horizon(scope, names)])

        def value(scope, names):
            at = index(scope, {"t": 0, **names})
            return names[letter, at] if (letter, at) in names else scope.variable(letter, at, names)

        return value

    def to_horizon(self, index):
        """G_t^{h}(c): the discounted rewards up to h, then c; c is read only where h is not beyond the end.

        G_t^{h}: the same with V(S_h) for c.
        """
        horizon, rest = self.group(), None
        if self.take("("):
            rest = self.expression()
            self.need(")")

        def value(scope, names):
            def seen(letter, at):
                return names[letter, at] if (letter, at) in names else scope.variable(letter, at, names)

            t, h = int(index(scope, names)), int(horizon(scope, names))
            last = min(h, len(scope.rewards)) if scope.rewards is not None else h
            total = sum(scope.gamma ** (k - t - 1) * seen("R", k) for k in range(t + 1, last + 1))
            ends = rest(scope, names) if rest else scope.stand_in(h, seen("S", h))
            return total + scope.gamma ** (h - t) * ends

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
        """What stands under a sum or a maximum: its variables and, for \\sum_{k=a}^{b}, the limits.

        \\sum_{k \\ge a} has no upper one.
        """
        self.need("_")
        many = self.take("{")
        names = [self.need(self.peek() or "a variable")]
        first, upwards = None, False
        while many and not self.take("}"):
            if self.take(","):
                names.append(self.need(self.peek()))
            elif sign := self.take("=", r"\ge"):
                first, upwards = self.expression(), sign != "="
            elif self.take(r"\in"):
                depth = 0
                while depth or self.peek() not in (",", "}"):
                    depth += {**dict.fromkeys("([{", 1), **dict.fromkeys(")]}", -1)}.get(
                        self.need(self.peek() or "}"), 0
                    )
            else:
                raise SyntaxError(f"cannot read {self.peek()} under a sum")
        if any(not re.fullmatch(r"[a-z]'*|\\pi|\\theta", name) for name in names):
            raise SyntaxError(f"cannot run over {names}")
        last = self.group() if first is not None and not upwards and self.need("^") else None
        return names, first, last

    def sum(self, add=sum):
        names, first, last = self.bound()
        body = self.product()

        def value(scope, known):
            if first is not None:
                low, high = first(scope, known), last(scope, known) if last else max(scope.sets[names[0]])
                return add(body(scope, {**known, names[0]: k}) for k in range(int(low), int(high) + 1))
            spaces = [scope.sets[name.strip("'")] for name in names]
            return add(body(scope, {**known, **dict(zip(names, x))}) for x in itertools.product(*spaces))

        return value

    def extreme(self, pick):
        names, *_ = self.bound()
        body = self.product()
        if names[0] in (r"\pi", r"\theta"):  # over policies: a scope for each
            return lambda scope, known: pick([(body(other, known), i) for i, other in enumerate(scope.sets[names[0]])])

        def value(scope, known):
            spaces = [scope.sets[name.strip("'")] for name in names]
            return pick([
                (body(scope, {**known, **dict(zip(names, x))}), x[0]) for x in itertools.product(*spaces)
            ])  # fmt: skip

        return value

    def expectation(self, kind):
        """E[X | S_t = s, A_t = a], E_pi[X], Pr{S_t = s' | ...}: as the scope says. E_t[X]: the mean over a batch."""
        if self.tokens[self.i : self.i + 3] == ["_", "t", "["]:
            self.i += 3
            body = self.row("]")
            return lambda scope, names: np.mean([body(scope, {**names, "t": t}) for t in scope.sets["t"]], axis=0)
        policy = self.take("_") and self.need(*POLICIES, "{")
        if policy == "{":
            policy = self.need(r"\tau", *POLICIES)
            while not self.take("}"):
                self.need(self.peek() if policy == r"\tau" else "}")
        policy = policy and policy.strip("\\")
        close = {"[": "]", r"\{": r"\}", "(": ")", "{": "}"}[self.need("[", r"\{", "(", "{")]
        what = self.events() if kind == r"\Pr" else self.expression()
        given = [] if self.take(close) else self.need("|") and self.events()
        if given:
            self.need(close)
        return lambda scope, names: scope.expect(kind, policy, what, given, names)

    def variance(self):
        """Var(X) = E[X^2] - (E[X])^2"""
        self.need("(")
        what = self.row(")")

        def value(scope, names):
            mean = scope.expect(r"\E", None, what, [], names)
            return scope.expect(r"\E", None, lambda *at: (what(*at) - mean) ** 2, [], names)

        return value

    def events(self):
        """S_t = s, A_t = a, ...; S_t alone: whatever it is; dots: all that is known; \\tau = t."""
        found = []
        while True:
            if self.take(*DOTS[0]):
                found.append(("...", lambda scope, names: 0, lambda scope, names: 0))
                self.need(",")
            letter = self.need("S", "A", "R", r"\tau").strip("\\")
            index = self.index() if letter != "tau" else lambda scope, names: 0
            is_known = self.peek() != "="
            found.append((letter, index, self.known(letter, index) if is_known else self.need("=") and self.product()))
            if not self.take(","):
                return found

    def known(self, letter, index):
        def value(scope, names):
            at = index(scope, names)
            return names[letter, at] if (letter, at) in names else scope.variable(letter, at, names)

        return value


def _largest(x):
    return np.abs(x).max()


def _power(x, n):
    """Of a number, or of a square matrix: its inverse for -1."""
    return x**n if np.ndim(x) != 2 else np.linalg.matrix_power(x, int(n))


def _times(x, y):
    """Numbers and arrays; a matrix and what stands right of it. Two vectors need a sign between them."""
    if np.ndim(x) == 0 or np.ndim(y) == 0:
        return x * y
    if np.ndim(x) != 2:
        raise ValueError("a vector with a vector or a matrix right of it")
    return (x @ y)[0] if len(x) == 1 and np.ndim(y) == 1 else x @ y


def _entrywise(x, y):
    if np.ndim(x) == 0 or np.shape(x) != np.shape(y):
        raise ValueError(f"entrywise product of shapes {np.shape(x)} and {np.shape(y)}")
    return x * y


def _transposed(x):
    return x[None, :] if np.ndim(x) == 1 else np.transpose(x)


def gradient(f, x, h=1e-6):
    """Central differences of f() in every entry of the array x, which f reads; of x's shape."""
    slope = np.zeros(x.shape)
    for i in np.ndindex(x.shape):
        old = x[i]
        x[i] = old + h
        above = f()
        x[i] = old - h
        slope[i] = (above - f()) / (2 * h)
        x[i] = old
    return slope


def _filled(terms, names):
    """Terms, as tokens, with w_2 ... in place of the dots between w_1 and w_n: a number there counts up to a name."""
    filled = []
    for i, term in enumerate(terms):
        if term not in DOTS:
            filled.append(term)
            continue
        before, after = terms[i - 1], terms[i + 1]
        at = [k for k, (x, y) in enumerate(zip(before, after, strict=True)) if x != y]
        for n in range(int(before[at[0]]) + 1, int(names[after[at[0]]])):
            filled.append([str(n) if k in at else token for k, token in enumerate(before)])
    return filled


def _counted(before, after):
    """Whether dots between the two stand for terms that count up to a name: w_3 x_3 + ... + w_n x_n."""
    changes = {(x, y) for x, y in zip(before, after) if x != y}
    return len(before) == len(after) and len(changes) == 1 and changes.pop()[0].isdigit()


def _continued(before, after):
    """The terms that dots stand for: the one before with every number raised by 1, 2, ..., up to the one after."""
    if after and _counted(before, after[0]):
        terms = [before, DOTS[0], after[0]]
        return lambda scope, names: sum(read(x)(scope, names) for x in _filled(terms, names)[1:-1])
    before = [x for i, token in enumerate(before) for x in ([token, "^", "1"] if token == r"\gamma"
              and before[i + 1] != "^" else [token])]  # fmt: skip
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
def cells(page, kind):
    found = json.loads((BOOK / f"{page}.ipynb").read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


@cache
def displays(page):
    """[(ids, LaTeX)] of every $$ ... $$, in order: its label, eq-7, and the anchors eq-, om- and dv-... before it."""
    found = []
    for text in cells(page, "markdown"):
        end = 0
        for m in re.finditer(r"\$\$(.+?)\$\$(?:[ ]*\(([\w-]+)\))?", text, re.S):
            anchors = re.findall(r'<span id="((?:eq|om|dv)-[^"]*)">', text[end : m.start()])
            found.append((anchors + [m[2]] * bool(m[2]), m[1]))
            end = m.end()
    return found


def printed(page):
    """{id: LaTeX} of the displays."""
    return {name: latex for names, latex in displays(page) for name in names}


def unnamed(page):
    """The displays that have no id."""
    return [latex.strip() for names, latex in displays(page) if not names]


def inline(page, anchor, start, end=""):
    """The first $ ... $ after an anchor that begins with `start` and ends with `end`."""
    text = "\n\n".join(cells(page, "markdown")).split(f'<span id="{anchor}"></span>')[1]
    return next(m for m in re.findall(r"(?<!\$)\$([^$]+)\$", text) if m.startswith(start) and m.endswith(end))


def code(page, start):
    """What stands right of `start` in the code cells."""
    lines = "\n".join(cells(page, "code")).splitlines()
    return next(line.removeprefix(start) for line in lines if line.startswith(start))


# what a wrong equation leads to: another number, or a text that cannot be read
NOTICED = (AssertionError, SyntaxError, KeyError, IndexError, ValueError, TypeError, ZeroDivisionError)


def broken(equations, breaks):
    """[(name, kind, i, LaTeX)] with the i-th place of each kind changed. breaks: {kind: (pattern, what replaces it)}"""
    return [
        (name, kind, i, m.string[: m.start()] + m.expand(new) + m.string[m.end() :])
        for name, latex in equations.items()
        for kind, (pattern, new) in breaks.items()
        for i, m in enumerate(re.finditer(pattern, latex))
    ]
