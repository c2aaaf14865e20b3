"""Every figure of the book: ``rlcore.plots.style`` is shared, ``rlcore.plots.chNN`` holds one chapter each.

``from rlcore import plots`` gives all of it: ``plots.use_style()``, ``plots.name_of_a_figure(...)``. A chapter's
module is loaded when one of its figures is first asked for.
"""

import importlib
import pkgutil

from rlcore.plots.style import (
    CYCLE,
    PALETTE,
    arrow,
    band,
    box,
    circle,
    encode,
    heatmap,
    new_diagram,
    new_figure,
    text_colour,
    use_style,
)

__all__ = [
    "CYCLE",
    "PALETTE",
    "arrow",
    "band",
    "box",
    "circle",
    "encode",
    "heatmap",
    "new_diagram",
    "new_figure",
    "text_colour",
    "use_style",
]
_CHAPTERS = sorted(m.name for m in pkgutil.iter_modules(__path__) if m.name.startswith(("ch", "front")))


def __getattr__(name):
    if name in _CHAPTERS:
        return importlib.import_module(f"{__name__}.{name}")
    if not name.startswith("_"):
        for chapter in _CHAPTERS:
            module = importlib.import_module(f"{__name__}.{chapter}")
            if getattr(getattr(module, name, None), "__module__", None) == module.__name__:
                return getattr(module, name)
    raise AttributeError(f"rlcore.plots has no figure {name!r}; its chapters are {', '.join(_CHAPTERS) or 'none'}")


def __dir__():
    figures = []
    for chapter in _CHAPTERS:
        module = importlib.import_module(f"{__name__}.{chapter}")
        figures += [n for n, f in vars(module).items() if getattr(f, "__module__", None) == module.__name__]
    return sorted({*__all__, *_CHAPTERS, *(n for n in figures if not n.startswith("_"))})
