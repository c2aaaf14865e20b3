"""The API page: autodoc and numpydoc on every public function and class of rlcore, in reading order.

Docstrings are plain text, in which v_*, S_ and |s are symbols; `as_markup` keeps them so, and makes a link of each
entry of the ledger that is cited.
"""

import importlib
import inspect
import pkgutil
import re

from docutils import nodes
from docutils.statemachine import StringList
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


def kind(thing):
    return "class" if inspect.isclass(thing) else "function"


class Api(SphinxDirective):
    """A section for each module: what it is about, then autodoc's entry of each function and class."""

    def run(self):
        out, shown = [], modules()
        for module in shown:
            title = re.sub(r"([._])(?=\w)", "\\1\u200b", module.__name__)  # may break on a phone
            section = nodes.section("", nodes.title("", title), ids=[module.__name__])
            text = re.sub(r"^  (?=\S)", "\n- ", inspect.getdoc(module), flags=re.M)  # what is indented is a list
            lines = [*escaped(re.sub(r"^    (?=\S)", "  ", text, flags=re.M).splitlines()), ""]
            for name, thing in public(module):
                lines += [f".. auto{kind(thing)}:: {module.__name__}.{name}"]
                inner = [inner for inner, _ in members(thing)] if inspect.isclass(thing) else []
                lines += [f"   :members: {', '.join(inner)}"] * bool(inner) + [""]
            for name in getattr(module, "__all__", ()):
                home = getattr(getattr(module, name), "__module__", module.__name__)
                if home != module.__name__ and home in [m.__name__ for m in shown]:
                    lines += elsewhere(module.__name__, name, home)
            self.state.nested_parse(StringList(lines, module.__file__), 0, section)
            out.append(section)
        return out


def elsewhere(module, name, home):
    """A name that a module offers and another one defines."""
    return [f".. py:data:: {module}.{name}", "", f"   Defined in :py:obj:`{home}.{name}`.", ""]


MARKUP = re.compile(r"[*|\\]|_(?!\w)")  # what would begin or end markup


def escaped(lines):
    """Lines of plain text as reStructuredText that shows them as they are; `name` as code."""
    out = []
    for line in lines:
        parts = re.split(r"(`+[^`]+`+)", line)
        parts[::2] = [MARKUP.sub(r"\\\g<0>", part) for part in parts[::2]]
        parts[1::2] = ["``" + part.strip("`") + "``" for part in parts[1::2]]
        out.append("".join(parts))
    return out


def as_markup(app, what, name, thing, options, lines):
    """Before numpydoc: all but the examples escaped, and links to the entries of the ledger that are cited."""
    rows = ledger.rows(app.srcdir)

    def cited(found):
        row, word = rows.get(found.group()), found.group()
        return f"`{word} <{row['page'].replace('#', '.html#')}>`__" if row and ledger.is_done(row) else word

    end = lines.index("Examples") if "Examples" in lines else len(lines)
    lines[:end] = [MENTION.sub(cited, line) for line in escaped(lines[:end])]


def source(domain, info):
    """Address of a definition in the repository, for sphinx.ext.linkcode; None where the repository is not known."""
    thing = importlib.import_module(info["module"])
    for part in info["fullname"].split("."):
        thing = inspect.getattr_static(thing, part) if inspect.isclass(thing) else getattr(thing, part)
    thing = getattr(thing, "__func__", None) or getattr(thing, "fget", None) or thing
    try:
        path, line = inspect.getsourcefile(inspect.unwrap(thing)), inspect.getsourcelines(inspect.unwrap(thing))[1]
    except (OSError, TypeError):
        return None
    return repository.source_link("rlcore/" + path.rpartition("rlcore/")[2], line)


def resolve(app, config):
    config.linkcode_resolve = source


def setup(app):
    app.add_directive("api", Api)
    for extension in ("sphinx.ext.autodoc", "sphinx.ext.linkcode", "numpydoc"):
        app.setup_extension(extension)
    app.connect("config-inited", resolve)
    app.connect("autodoc-process-docstring", as_markup, priority=100)
