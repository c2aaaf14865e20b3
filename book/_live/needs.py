"""Which cells a cell builds on, found from their code.

A cell needs the last cell above that binds a name it reads, every cell in between that changes the name's value in
place, and what those need in turn.
"""

import ast
import builtins
import dis
import re
from functools import cache
from types import CodeType

READS = {"LOAD_NAME", "LOAD_GLOBAL", "LOAD_FROM_DICT_OR_GLOBALS", "DELETE_NAME"}
CHANGING = {"append", "extend", "update", "add", "insert", "pop", "setdefault", "sort", "shuffle", "remove", "clear"}
QUIET = {"print", "display"}  # they leave their arguments as they are


def reads(code):
    """Global names that a function or a class reads, and what is defined in it."""
    steps = list(dis.get_instructions(code))
    inner = [reads(step.argval) for step in steps if isinstance(step.argval, CodeType)]
    own = {step.argval for step in steps if step.opname == "STORE_NAME"}  # of a class
    return ({step.argval for step in steps if step.opname in READS} - own).union(*inner)


def flow(tree):
    """(names read from above, names bound), in the order in which Python meets them."""
    branches = [node for node in ast.walk(tree) if isinstance(node, (ast.If, ast.Try))]
    unsure = {line for node in branches for line in range(node.lineno, node.end_lineno + 1)}
    above, bound, sure = set(), set(), set(dir(builtins))
    for step in dis.get_instructions(compile(tree, "cell", "exec")):
        if step.opname in READS:
            above |= {step.argval} - sure
        elif isinstance(step.argval, CodeType):
            above |= reads(step.argval) - sure
        elif step.opname == "STORE_NAME":
            bound.add(step.argval)
            sure |= {step.argval} if step.positions.lineno not in unsure else set()
    return above, bound


def root(node):
    while isinstance(node, (ast.Subscript, ast.Attribute)):
        node = node.value
    return {node.id} if isinstance(node, ast.Name) else set()


def changes(tree):
    """Names whose value is changed in place: x[i] = 1, x += 1, x.append(1), or taken by a call that gives nothing."""
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.AugAssign():
                found += [node.target]
            case ast.Assign() | ast.Delete():
                found += [target for target in node.targets if not isinstance(target, ast.Name)]
            case ast.Call(func=ast.Attribute(attr=name)) if name in CHANGING:
                found += [node.func.value]
            case ast.Expr(value=ast.Call(func=func) as call) if ast.unparse(func) not in QUIET:
                found += [*call.args, *(word.value for word in call.keywords), getattr(func, "value", None)]
    return set().union(*map(root, found))


def generators(tree):
    """Names bound to random generators, which every use changes."""
    pairs = [(target, node.value) for node in ast.walk(tree) if isinstance(node, ast.Assign) for target in node.targets]
    for target, value in pairs:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            pairs += zip(target.elts, value.elts, strict=False)
    made = [t for t, v in pairs if isinstance(v, ast.Call) and ast.unparse(v.func).endswith(("default_rng", "spawn"))]
    return set().union(*map(root, made))


@cache
def facts(source):
    """(names read from above, names bound, names changed in place, generators made, names imported)."""
    try:
        tree = ast.parse(source)
        above, bound = flow(tree)
    except SyntaxError:  # it binds what it seems to, so that what builds on it meets the error
        return set(), {a or b for a, b in re.findall(r"^(?:(?:def|class) +(\w+)|(\w+) *=)", source, re.M)}, *[set()] * 3
    imports = [alias for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom)) for alias in node.names]
    imported = {(alias.asname or alias.name).split(".")[0] for alias in imports}
    return above, bound, changes(tree), generators(tree), imported


def own(source):
    """Names that a cell makes, not those that it only goes on with."""
    above, bound, places, *_ = facts(source)
    return bound - (above & places)


def analyse(sources):
    """For each cell: the cells that it needs, in order, and the cells whose values it changes."""
    known, modules, needs, changed = set(), set(), [], []
    for i, (above, _, places, made, imported) in enumerate(map(facts, sources)):
        known |= made
        modules |= imported
        mine, mutated = set(), set()
        for name in above:
            makers = [j for j in range(i) if name in own(sources[j])]
            mine |= set(makers[-1:])
            if not makers or name in modules:
                continue
            mutated |= {makers[-1]} if name in places | known else set()
            for j in range(makers[-1] + 1, i):
                read, _, there, *_ = facts(sources[j])
                mine |= {j} if name in there or name in known & read else set()
        needs.append(sorted(mine.union(*(needs[j] for j in mine))))
        changed.append(mutated)
    return needs, changed
