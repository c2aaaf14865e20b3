"""Which cells a cell builds on, found from their code.

A cell needs the last cell above that binds a name it reads, every cell in between that changes the name's value in
place, and what those need in turn.
"""

import ast
import builtins
import re
import symtable
from functools import cache

CHANGING = {"append", "extend", "update", "add", "insert", "pop", "setdefault", "sort", "shuffle", "remove", "clear"}
QUIET = {"print", "display"}  # they leave their arguments as they are
GENERATORS = ("default_rng", "spawn")
KNOWN = {*dir(builtins), "display"}


def tables(table):
    yield table
    for child in table.get_children():
        yield from tables(child)


def reads(node):
    """Global names that an expression or a statement reads, in its functions too."""
    top = symtable.symtable(ast.unparse(node), "cell", "exec")
    found = [(table is top, name) for table in tables(top) for name in table.get_symbols()]
    return {name.get_name() for is_top, name in found if name.is_referenced() and (is_top or name.is_global())}


def binds(node):
    table = symtable.symtable(ast.unparse(node), "cell", "exec")
    return {s.get_name() for s in table.get_symbols() if s.is_assigned() or s.is_imported() or s.is_namespace()}


def targets(node):
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def walk(statements, bound, outside):
    """In the order of execution: what is read before it is bound goes to outside."""
    for node in statements:
        if not isinstance(node, (ast.For, ast.While, ast.If, ast.With, ast.Try)):
            outside |= reads(node) - bound
            if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
                outside |= {node.target.id} - bound
            bound |= binds(node)
            continue
        heads = {ast.For: ["iter"], ast.While: ["test"], ast.If: ["test"]}.get(type(node), [])
        heads = [getattr(node, head) for head in heads] + [item.context_expr for item in getattr(node, "items", [])]
        for head in heads:
            outside |= reads(head) - bound
            bound |= targets(head)
        for target in [getattr(node, "target", None), *(item.optional_vars for item in getattr(node, "items", []))]:
            bound |= targets(target) if target else set()
        bodies = [getattr(node, part, []) for part in ("body", "orelse", "finalbody")]
        bodies += [handler.body for handler in getattr(node, "handlers", [])]
        inner = [set(bound) for _ in bodies]
        for body, names in zip(bodies, inner, strict=True):
            walk(body, names if isinstance(node, ast.If) else bound, outside)
        if isinstance(node, ast.If):  # bound for sure only where both ways bind
            bound |= inner[0] & inner[1]


def root(node):
    while isinstance(node, (ast.Subscript, ast.Attribute)):
        node = node.value
    return {node.id} if isinstance(node, ast.Name) else set()


def changes(tree):
    """Names whose value is changed in place: x[i] = 1, x += 1, x.append(1), and what a call that gives nothing takes."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.AugAssign):
            found |= root(node.target)
        elif isinstance(node, (ast.Assign, ast.Delete)):
            for target in node.targets:
                found |= root(target) if isinstance(target, (ast.Subscript, ast.Attribute)) else set()
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGING:
            found |= root(node.func.value)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            call = node.value
            if ast.unparse(call.func) not in QUIET:
                taken = [*call.args, *(word.value for word in call.keywords)]
                taken += [call.func.value] if isinstance(call.func, ast.Attribute) else []
                found = found.union(*map(root, taken))
    return found


def generators(tree):
    """Names bound to random generators, which every use changes."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            sides = zip(node.targets[0].elts, node.value.elts, strict=False) if (
                isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
            ) else [(target, node.value) for target in node.targets]
            for target, value in sides:
                if isinstance(value, ast.Call) and ast.unparse(value.func).endswith(GENERATORS):
                    found |= root(target)
    return found


@cache
def facts(source):
    """(names read from above, names bound, names changed in place, generators made)."""
    try:
        tree = ast.parse(source)
    except SyntaxError:  # it binds what it seems to, so that what builds on it meets the error
        return set(), {a or b for a, b in re.findall(r"^(?:(?:def|class) +(\w+)|(\w+) *=)", source, re.M)}, set(), set()
    outside = set()
    walk(tree.body, set(KNOWN), outside)
    return outside, binds(tree), changes(tree), generators(tree)


def analyse(sources):
    """For each cell: (cells that it needs, in order; {cell above: cells that change what that one made})."""
    known, needs, changed = set(), [], []
    for i, source in enumerate(sources):
        outside, _, places, made = facts(source)
        known |= made
        mine, mutated = set(), set()
        for name in outside:
            above = [j for j in range(i) if name in facts(sources[j])[1]]
            own = [j for j in above if not (name in facts(sources[j])[2] and name in facts(sources[j])[0])]
            if not own:
                continue
            mine.add(own[-1])
            touching = places | known
            mutated |= {own[-1]} if name in touching else set()
            for j in range(own[-1] + 1, i):
                read, _, there, _ = facts(sources[j])
                if name in there or (name in known and name in read):
                    mine.add(j)
        for j in sorted(mine):
            mine |= set(needs[j])
        needs.append(sorted(mine))
        changed.append(mutated)
    return needs, changed
