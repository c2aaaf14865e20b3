"""The API page, from the signatures and docstrings of rlcore itself.

Not by sphinx.ext.autodoc: the docstrings are plain text, in which v_*, S_ and |s are symbols, and markup for it; what a
package gathers or loads late belongs to its page; and each entry of the ledger that a docstring cites is a link here.
"""

import importlib
import inspect
import pkgutil
import re

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from companion import ledger, repository

ORDER = [
    "mdp", "bellman", "dp", "solver", "planning", "mpc", "monte_carlo", "td", "batch", "nstep", "traces",
    "neurons", "nn", "optimizers", "torchnet", "policies", "distributions", "policy_gradient", "reinforce",
    "actor_critic", "gae", "trust_region", "ppo", "trpo", "losses", "explore", "sweep", "envs", "plots", "core",
    "studies",
]  # fmt: skip
MENTION = re.compile(r"\b(?:eq|fig|tab|alg|ex|cl|om)-[a-z0-9-]*[a-z0-9]\b")


def modules():
    """Public modules of rlcore that are importable here, in reading order."""
    package = importlib.import_module("rlcore")
    names = [m.name for m in pkgutil.iter_modules(package.__path__) if not m.name.startswith("_")]
    names.sort(key=lambda n: (ORDER.index(n) if n in ORDER else len(ORDER), n))
    for room in ("plots", "core", "studies"):
        inner = pkgutil.iter_modules(importlib.import_module(f"rlcore.{room}").__path__)
        names += [f"{room}.{m.name}" for m in inner if m.name != "style"]
    return [importlib.import_module(f"rlcore.{n}") for n in names]


def public(module):
    """What a module offers: its own functions and classes, and what a package gathers from its parts."""
    later = {name: getattr(module, name) for name in getattr(module, "ENVIRONMENTS", ())}
    for name, thing in (vars(module) | later).items():
        home = getattr(thing, "__module__", "") or ""
        own = home == module.__name__ or home.startswith(module.__name__ + ".")
        if not name.startswith("_") and callable(thing) and own:
            yield name, thing


def members(cls):
    """Public methods and properties that a class defines itself and documents."""
    for name, thing in vars(cls).items():
        inner = (
            getattr(thing, "__func__", None) or getattr(thing, "fget", None) or getattr(thing, "func", None) or thing
        )
        if not name.startswith("_") and inspect.isfunction(inner) and inner.__doc__:
            yield name, inner


def signature(name, thing):
    """The call as it may be copied: arguments with their types and defaults, what it returns."""
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return f"{name}(...)"
    parts, keywords = [], False
    for p in found.parameters.values():
        if p.kind is p.KEYWORD_ONLY and not keywords:
            parts.append("*")
        keywords |= p.kind in (p.KEYWORD_ONLY, p.VAR_POSITIONAL)
        kind = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "")
        default = getattr(p.default, "__name__", None) or repr(p.default)
        typed = "" if p.annotation is p.empty else f": {type_name(p.annotation)}"
        given = "" if p.default is p.empty else f" = {default}" if typed else f"={default}"
        parts.append(f"{kind}{p.name}{typed}{given}")
    returned = "" if found.return_annotation is found.empty else f" -> {type_name(found.return_annotation)}"
    return f"{name}({', '.join(parts)}){returned}"


def type_name(annotation):
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    return re.sub(r"\b(?:numpy\.random\._generator|numpy|np|collections\.abc|rlcore\.[a-z_.]+)\.", "", text)


class Api(SphinxDirective):
    """Every public function and class: signature, docstring, links to the entries that it cites."""

    def run(self):
        self.ledger = ledger.rows(self.env.srcdir)
        out, shown = [], modules()
        for module in shown:
            title = re.sub(r"([._])(?=\w)", "\\1\u200b", module.__name__)  # may break on a phone
            section = nodes.section("", nodes.title("", title), ids=[module.__name__])
            section += self.paragraphs(inspect.getdoc(module))
            entries = nodes.definition_list(classes=["api"])
            for name, thing in public(module):
                entries += self.entry(f"{module.__name__}.{name}", name, thing)
                if inspect.isclass(thing):
                    for inner, method in members(thing):
                        entries += self.entry(f"{module.__name__}.{name}.{inner}", f"{name}.{inner}", method)
            for name in getattr(module, "__all__", ()):
                home = getattr(getattr(module, name), "__module__", module.__name__)
                if home != module.__name__ and home in [m.__name__ for m in shown]:
                    entries += self.elsewhere(f"{module.__name__}.{name}", name, home)
            if entries.children:
                section += entries
            out.append(section)
        return out

    def entry(self, identity, name, thing):
        term = nodes.term("", "", nodes.literal("", signature(name, thing)), ids=[identity])
        address = self.source(thing)
        if address:
            term += [nodes.Text(" "), ledger.link("source", address)]
        own = thing.__dict__.get("__doc__") if inspect.isclass(thing) else inspect.getdoc(thing)
        text, sections = split(inspect.cleandoc(own) if own else "")
        body = self.paragraphs(text)
        for title, lines in sections:
            body += SECTIONS[title](self, title, lines)
        return nodes.definition_list_item("", term, nodes.definition("", *body))

    def described(self, title, lines):
        """Names or types, each on a line with what is said about it."""
        found = nodes.line_block("", nodes.line("", "", nodes.strong("", title)), classes=["doc"])
        for item in re.split(r"\n(?=\S)", "\n".join(lines)):
            name, _, text = item.partition("\n")
            found += nodes.line("", "", nodes.literal("", name), nodes.Text(" "), *self.inline(" ".join(text.split())))
        return [found]

    def prose(self, title, lines):
        text = self.inline(" ".join(" ".join(lines).split()))
        return [nodes.line_block("", nodes.line("", "", nodes.strong("", f"{title} "), *text), classes=["doc"])]

    def example(self, title, lines):
        return [nodes.literal_block("", "\n".join(lines), language="pycon")]

    def elsewhere(self, identity, name, home):
        """A name that a module offers and another one defines."""
        term = nodes.term("", "", nodes.literal("", name), ids=[identity])
        there = ledger.link(ledger.name_node(f"{home}.{name}"), f"appendix_api.html#{home}.{name}")
        see = nodes.paragraph("", "", nodes.Text("Defined in "), there, nodes.Text("."))
        return nodes.definition_list_item("", term, nodes.definition("", see))

    def source(self, thing):
        inner = inspect.unwrap(thing)
        try:
            path, line = inspect.getsourcefile(inner), inspect.getsourcelines(inner)[1]
        except (OSError, TypeError):
            return None
        return repository.source_link("rlcore/" + path.rpartition("rlcore/")[2], line)

    def paragraphs(self, text):
        """Docstring blocks: prose as paragraphs, anything indented or shaped like a list of arguments line by line."""
        out = []
        for block in re.split(r"\n\s*\n", text or ""):
            lines = block.strip("\n").splitlines()
            if not lines or not lines[0].strip():
                continue
            if all(line.startswith("    ") or line.startswith(">>>") for line in lines):
                out.append(nodes.literal_block("", inspect.cleandoc(block), language="python"))
                continue
            group = nodes.line_block(classes=["doc"])
            for line in self.joined(lines):
                group += nodes.line("", "", *self.inline(line))
            out.append(group)
        return out

    def joined(self, lines):
        """Wrapped prose joined again; a line that names an argument, or Raises and Source, starts a new one."""
        out = []
        for line in lines:
            if out and not re.match(r"(?:[\w, *`]+:|Returns\b|Raises\b|Source\b|- )", line.strip()):
                out[-1] += " " + line.strip()
            else:
                out.append(line.strip())
        return out

    def inline(self, text):
        """Text with the cited entries as links, and `code` as code."""
        out, at = [], 0
        for found in re.finditer(MENTION.pattern + r"|`+[^`]+`+", text):
            out.append(nodes.Text(text[at : found.start()]))
            word, at = found.group(), found.end()
            row = self.ledger.get(word)
            if word.startswith("`"):
                out.append(nodes.literal("", word.strip("`")))
            elif row and ledger.is_done(row):
                out.append(ledger.page_link(word, row["page"]))
            else:
                out.append(nodes.Text(word))
        return [*out, nodes.Text(text[at:])]


SECTIONS = {
    "Parameters": Api.described, "Returns": Api.described, "Raises": Api.described,
    "Notes": Api.prose, "References": Api.prose, "Examples": Api.example,
}  # fmt: skip


def split(text):
    """What stands before the sections of a docstring, and (title, lines) of each section."""
    before, *rest = re.split(r"^(Parameters|Returns|Raises|Notes|References|Examples)\n-+\n", text, flags=re.M)
    return before.strip(), [(title, lines.strip().splitlines()) for title, lines in zip(rest[::2], rest[1::2])]


def setup(app):
    app.add_directive("api", Api)
