"""A figure with controls that moves in a live notebook and on the static page, from one call.

In Jupyter an ipywidgets panel switches the pictures. On the page the same pictures, all drawn beforehand, are switched
by radio buttons and CSS alone: no script, no server. In print and in a PDF there is one picture.
"""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
import math
import numbers
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from rlcore.core.checks import show
from rlcore.core.extras import extra
from rlcore.core.rules import checked, choice, function_of

MAX_FRAMES = 40
GREEK = {"alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "theta": "θ", "lam": "λ", "pi": "π"}

CSS = """
#{u} {{margin:0 0 1rem;color:inherit}}
#{u} .title {{font-weight:600;margin:0 0 .4rem}}
#{u} fieldset {{border:0;margin:0 0 .4rem;padding:0;min-width:0;display:flex;flex-wrap:wrap;\
gap:.3rem;align-items:center}}
#{u} legend {{float:left;margin:0 .4rem 0 0;padding:0;font-size:1em;line-height:1.5;width:auto;min-width:4rem}}
#{u} .knob {{position:relative;display:inline-block}}
#{u} input {{position:absolute;inset:0;opacity:0;margin:0}}
#{u} label {{display:block;margin:0;min-width:1.8rem;text-align:center;line-height:1.5;border:1px solid currentColor;\
border-radius:.3rem;padding:.1rem .55rem;cursor:pointer}}
#{u} input:checked+label {{background:#1a6bbf;color:#fff;border-color:#1a6bbf}}
#{u} input:focus-visible+label {{outline:3px solid #1a6bbf;outline-offset:2px}}
#{u} .frame {{margin:0}}
#{u} img {{display:block;box-sizing:border-box;width:100%;max-width:46rem;height:auto;margin:0;padding:.4rem;\
background:#fff;border-radius:.3rem;filter:none}}
#{u}:has(.other:checked) .first {{display:none}}
@supports not selector(:has(a)) {{#{u} fieldset {{display:none}}}}
@media (forced-colors:active) {{#{u} input:checked+label {{forced-color-adjust:none;\
background:Highlight;color:HighlightText}}}}
@media print {{#{u} input:not(:checked)+label {{display:none}}}}
"""


@dataclass(frozen=True)
class Explorer:
    """The drawn frames of one ``explore`` call; shows itself in a notebook.

    choices: name -> values. labels: name -> text of the legend. frames: index into each choice -> an HTML image.
    fallback: the first frame as PNG bytes, for print.
    """

    title: str
    choices: dict[str, list]
    labels: dict[str, str]
    frames: dict[tuple[int, ...], str]
    alts: dict[tuple[int, ...], str]
    fallback: bytes

    def to_html(self) -> str:
        """The whole panel as HTML; its ids come from the title, the choices and the alt texts."""
        known = repr(
            (self.title, [(k, list(map(_text, v))) for k, v in self.choices.items()], list(self.alts.values()))
        )
        u = "x" + hashlib.sha256(known.encode()).hexdigest()[:10]
        style, pictures = [CSS.format(u=u).strip()], []
        for index, picture in self.frames.items():
            name = "f" + "-".join(map(str, index))
            if any(index):
                has = "".join(f":has(#{u}-{n}-{i}:checked)" for n, i in enumerate(index))
                style.append(f"#{u}{has} .{name} {{display:block!important}}")
                pictures.append(f'<div class="frame {name}" style="display:none">{picture}</div>')
            else:
                pictures.append(f'<div class="frame {name} first">{picture}</div>')
        knobs = "\n".join(self._fieldset(u, n, name) for n, name in enumerate(self.choices))
        return (
            "<style>\n" + "\n".join(style) + "\n</style>\n"
            f'<div id="{u}" class="explore" role="group" aria-labelledby="{u}-title">\n'
            f'<div class="title" id="{u}-title">{html.escape(self.title)}</div>\n{knobs}\n'
            '<div aria-live="polite">\n' + "\n".join(pictures) + "\n</div>\n</div>"
        )

    def _fieldset(self, u, n, name):
        knobs = []
        for i, value in enumerate(self.choices[name]):
            mark = ' class="other"' if i else " checked"
            knobs.append(
                f'<span class="knob"><input type="radio" name="{u}-{n}" id="{u}-{n}-{i}"{mark}>'
                f'<label for="{u}-{n}-{i}">{html.escape(_text(value))}</label></span>'
            )
        return f"<fieldset><legend>{html.escape(self.labels[name])}</legend>{''.join(knobs)}</fieldset>"

    def widget(self) -> Any:
        """The live panel (ipywidgets): a slider for numbers, buttons for words, and the picture they choose."""
        with extra("notebook"):
            import ipywidgets as w

        knobs = []
        for name, values in self.choices.items():
            options = [(_text(value), i) for i, value in enumerate(values)]
            kind = w.SelectionSlider if all(isinstance(v, numbers.Number) for v in values) else w.ToggleButtons
            knobs.append(kind(options=options, value=0, description=self.labels[name]))
        view = w.HTML()

        def show(_=None):
            view.value = self.frames[tuple(knob.value for knob in knobs)]

        for knob in knobs:
            knob.observe(show, "value")
        show()
        return w.VBox([w.HTML(f"<b>{html.escape(self.title)}</b>"), *knobs, view])

    def _repr_mimebundle_(self, include=None, exclude=None):
        bundle = {
            "text/plain": f"<explore: {self.title}>",
            "text/html": self.to_html(),
            "image/png": base64.b64encode(self.fallback).decode(),
        }
        try:
            return {**self.widget()._repr_mimebundle_(), **bundle}
        except ImportError:
            return bundle


def _title(name, title, given):
    if not isinstance(title, str) or not title.strip():
        raise ValueError(f"{name}: got {show(title)}, must be a text that is not empty")
    return title


def _labels(name, labels, given):
    if not isinstance(labels, dict) or set(labels) - set(given["choices"]):
        raise ValueError(f"{name}: got {show(labels)}, must be texts for some of the choices {list(given['choices'])}")
    return {key: str(text) for key, text in labels.items()}


def _choices(name, choices, given):
    """The rule of {name: values}: as lists, of numbers and words that look different from each other."""
    if not choices:
        raise ValueError(f"{name}: got none, must be one at least, such as gamma=[0.5, 0.9]")
    lists = {}
    for key, values in choices.items():
        if isinstance(values, str | bytes) or not hasattr(values, "__iter__"):
            raise ValueError(f"{key}: got {show(values)}, must be a list of numbers or words")
        lists[key] = values = list(values)
        if not values or not all(isinstance(value, str | numbers.Real) for value in values):
            raise ValueError(f"{key}: got {show(values)}, must be numbers or words, one at least")
        if len({_text(value) for value in values}) < len(values):
            raise ValueError(f"{key}: got {show(values)}, must be values that look different from each other")
    count = math.prod(map(len, lists.values()))
    if count > MAX_FRAMES:
        sizes = " x ".join(f"{len(values)} {key}" for key, values in lists.items())
        raise ValueError(f"{name}: got {count} frames ({sizes}), must be at most {MAX_FRAMES}")
    return lists


@checked(
    draw=function_of("the choices that returns a matplotlib Figure"), title=_title, labels=_labels, choices=_choices,
    alt=function_of("the choices that returns a text"), fmt=choice("svg", "png"),
)  # fmt: skip
def explore(
    draw: Callable[..., Any], *, title: str, alt: Callable[..., str] | None = None, fmt: str = "svg",
    labels: dict[str, str] | None = None, **choices: Any,
) -> Explorer:  # fmt: skip
    """Show a figure for every combination of the choices, with a control for each choice.

    Parameters
    ----------
    draw : Callable[..., Any]
        Called with one value for each choice; returns a matplotlib Figure.
    title : str
        Shown above the controls.
    alt : Callable[..., str] | None
        Called like draw; returns the text that says what the picture shows.
    fmt : str
        "svg", or "png" for pictures with very many points.
    labels : dict[str, str] | None
        Maps a name to its legend, where the name itself (gamma is written γ) does not do.
    **choices : Any
        name=[value, ...], numbers or words, the first value of each shown first; at most 40 combinations.

    Returns
    -------
    Explorer
        It shows itself in a notebook.

    Raises
    ------
    ValueError
        Where an argument cannot be used, and where draw does not return a Figure.
    """
    from rlcore.plots.style import encode

    labels = {name: GREEK.get(name, name.replace("_", " ")) for name in choices} | (labels or {})
    frames, alts, fallback = {}, {}, b""
    for index in itertools.product(*(range(len(values)) for values in choices.values())):
        values = {name: choices[name][i] for name, i in zip(choices, index, strict=True)}
        fig = draw(**values)
        mime, raw = encode(fig, fmt)
        fallback = fallback or encode(fig, "png")[1]
        words = ", ".join(f"{labels[name]} = {_text(value)}" for name, value in values.items())
        alts[index] = alt(**values) if alt else f"{title}: {words}"
        if not isinstance(alts[index], str) or not alts[index].strip():
            raise ValueError(f"alt: returned {show(alts[index])} for {words}, must return a text that is not empty")
        frames[index] = _img(mime, raw, alts[index])
    return Explorer(title, choices, labels, frames, alts, fallback)


def _text(value):
    is_float = isinstance(value, numbers.Real) and not isinstance(value, numbers.Integral)
    return f"{value:.6g}" if is_float else str(value)


def _img(mime, raw, alt):
    """An HTML image that holds its data; as an <img>, each SVG keeps its ids to itself."""
    if mime == "image/svg+xml":
        text = re.sub(r">[^<]*<", lambda words: words.group().replace('"', "&quot;"), raw.decode())
        data = "," + quote(text.replace("'", "&#39;").replace('"', "'"), safe=" '!$()*+,-./:;=?@[]^_`{|}~")
    else:
        data = ";base64," + base64.b64encode(raw).decode()
    return f'<img src="data:{mime}{data}" alt="{html.escape(alt, quote=True)}">'
