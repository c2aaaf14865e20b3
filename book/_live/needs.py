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


class Scopes(ast.NodeTransformer):
    """Comprehensions as generators, whose names are their own in every Python; since 3.12 those of a list are not."""

    def visit_ListComp(self, node):
        return self.generic_visit(ast.GeneratorExp(node.elt, node.generators))

    visit_SetComp = visit_ListComp

    def visit_DictComp(self, node):
        return self.generic_visit(ast.GeneratorExp(ast.Tuple([node.key, node.value], ast.Load()), node.generators))


def names(node):
    """(global names that a statement reads, in its functions too; names that it binds)."""
    top = symtable.symtable(ast.unparse(Scopes().visit(ast.parse(ast.unparse(node)))), "cell", "exec")
    tables, read = [top], set()
    for table in tables:
        tables += table.get_children()
        read |= {s.get_name() for s in table.get_symbols() if s.is_referenced() and (table is top or s.is_global())}
    bound = {s.get_name() for s in top.get_symbols() if s.is_assigned() or s.is_imported() or s.is_namespace()}
    return read | (
        {node.target.id} if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name) else set()
    ), bound


def steps(node):
    """A statement as the parts that run one after the other: a loop's head, its name, its body."""
    if not isinstance(node, (ast.For, ast.While, ast.With)):
        return [node]
    heads = (
        [(i.context_expr, i.optional_vars) for i in node.items]
        if isinstance(node, ast.With)
        else ([(node.iter, node.target)] if isinstance(node, ast.For) else [(node.test, None)])
    )
    parts = [ast.Assign([name], head, lineno=0) if name else ast.Expr(head) for head, name in heads]
    return parts + [part for child in [*node.body, *getattr(node, "orelse", [])] for part in steps(child)]


def root(node):
    while isinstance(node, (ast.Subscript, ast.Attribute)):
        node = node.value
    return {node.id} if isinstance(node, ast.Name) else set()


def changes(tree):
    """Names whose value is changed in place: x[i] = 1, x += 1, x.append(1), or taken by a call that gives nothing."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.AugAssign):
            found += [node.target]
        elif isinstance(node, (ast.Assign, ast.Delete)):
            found += [target for target in node.targets if isinstance(target, (ast.Subscript, ast.Attribute))]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGING:
            found += [node.func.value]
        elif (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Call)
            and ast.unparse(node.value.func) not in QUIET
        ):
            found += [*node.value.args, *(word.value for word in node.value.keywords)]
            found += [node.value.func.value] if isinstance(node.value.func, ast.Attribute) else []
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
    except SyntaxError:  # it binds what it seems to, so that what builds on it meets the error
        return set(), {a or b for a, b in re.findall(r"^(?:(?:def|class) +(\w+)|(\w+) *=)", source, re.M)}, *[set()] * 3
    above, bound, sure = set(), set(), set(dir(builtins))
    for part in (part for statement in tree.body for part in steps(statement)):
        read, made = names(part)
        above |= read - sure
        bound |= made
        sure |= set() if isinstance(part, (ast.If, ast.Try)) else made
    imported = {name for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom)) for name in names(node)[1]}
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
