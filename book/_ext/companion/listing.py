"""Functions of rlcore as pages show them: the code itself, with its first sentence for a docstring and without types.

Types, shapes, ranges, examples and sources stand on the API page.
"""

import ast
import re
import textwrap

from docutils import nodes
from sphinx.directives.code import LiteralInclude

WIDTH = 120


def brief(source):
    """The source of a function or class, each docstring cut to its first sentence, arguments without their types."""
    lines = textwrap.dedent(source).splitlines()
    found = [n for n in ast.walk(ast.parse("\n".join(lines))) if isinstance(n, ast.FunctionDef | ast.ClassDef)]
    for node in sorted(found, key=lambda n: -n.lineno):
        doc = node.body[0]
        if ast.get_docstring(node):
            indent = " " * doc.col_offset
            lines[doc.lineno - 1 : doc.end_lineno] = [f'{indent}"""{first_sentence(ast.get_docstring(node))}"""']
        if isinstance(node, ast.FunctionDef):
            first = min([inner.lineno for inner in [doc, *getattr(doc, "decorator_list", [])]])
            lines[node.lineno - 1 : first - 1] = header(node, "\n".join(lines))
    return "\n".join(lines) + "\n"


def first_sentence(text):
    """Up to the first full stop that ends one, on one line."""
    start = " ".join(text.split("\n\n")[0].split())
    return re.split(r"(?<=[^.][^.]\.) (?=[A-Z`])", start)[0]


def header(node, text):
    """`def name(arguments):` without types, in lines that are not too long."""
    a = node.args
    positional = [*a.posonlyargs, *a.args]
    defaults = [None] * (len(positional) - len(a.defaults)) + a.defaults
    given = [argument(x, default, text) for x, default in zip(positional, defaults)]
    if a.posonlyargs:
        given.insert(len(a.posonlyargs), "/")
    given += [f"*{a.vararg.arg}"] if a.vararg else ["*"] if a.kwonlyargs else []
    given += [argument(x, default, text) for x, default in zip(a.kwonlyargs, a.kw_defaults)]
    given += [f"**{a.kwarg.arg}"] if a.kwarg else []
    indent = " " * node.col_offset
    whole = f"{indent}def {node.name}({', '.join(given)}):"
    if len(whole) <= WIDTH:
        return [whole]
    inner = textwrap.wrap(", ".join(given) + ",", WIDTH - len(indent) - 4, break_long_words=False)
    return [f"{indent}def {node.name}(", *(f"{indent}    {line}" for line in inner), f"{indent}):"]


def argument(x, default, text):
    return x.arg if default is None else f"{x.arg}={ast.get_source_segment(text, default)}"


class Listing(LiteralInclude):
    """`literalinclude`; with `:pyobject:` what it shows is brief."""

    def run(self):
        out = super().run()
        for node in out if "pyobject" in self.options else ():
            for block in node.findall(nodes.literal_block):
                block.rawsource = brief(block.astext())
                block.children = [nodes.Text(block.rawsource)]
        return out


def setup(app):
    app.add_directive("literalinclude", Listing, override=True)
