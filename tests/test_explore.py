"""The moving figure: every combination has its picture, its rule and its words; the same call gives the same bytes."""

import base64
import hashlib
import itertools
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote
from xml.dom import minidom

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from rlcore.explore import MAX_FRAMES, explore

GAMMAS, SHAPES = [0.5, 0.9, 0.99], ["step", "slope"]


def draw(gamma, shape="step", words=""):
    fig = Figure(figsize=(2, 1))
    ax = fig.subplots()
    ax.plot([0, 1, 2], [1, gamma, gamma**2], drawstyle="steps-post" if shape == "step" else "default")
    ax.set_title(f"{gamma} {shape} {words}")
    return fig


def panel(title="Weights", **more):
    return explore(draw, title=title, **({"gamma": GAMMAS, "shape": SHAPES} | more))


def contrast(*colours):
    linear = [
        [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)] for colour in colours
    ]
    low, high = sorted(0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in linear)
    return (high + 0.05) / (low + 0.05)


class Page(HTMLParser):
    """The tags of a panel, as (name, attributes), and the text in each."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.texts = [], []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        if data.strip():
            self.texts.append((self.tags[-1][0], data.strip()))

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


def shown(page, chosen):
    """What the panel's own CSS shows when these radio buttons are checked: the classes of the visible frames."""
    rules = re.findall(r"((?::has\(#[\w-]+:checked\))+) \.(f[\d-]+) \{display:block!important\}", page)
    visible = [frame for has, frame in rules if set(re.findall(r"#([\w-]+):checked", has)) <= set(chosen)]
    radios = [tag for tag in Page(page).all("input") if tag["id"] in chosen]
    other = any(tag.get("class") == "other" for tag in radios)  # then the first frame is hidden
    assert re.search(r":has\(\.other:checked\) \.first \{display:none\}", page)
    (first,) = re.findall(r'class="frame (f[\d-]+) first"', page)
    return visible if other else [*visible, first]


@pytest.mark.parametrize("start", [None, {"gamma": 0.9}, {"gamma": 0.99, "shape": "slope"}])
def test_every_combination_shows_exactly_its_own_frame(start):
    page = panel(start=start).to_html()
    (names,) = {tuple(sorted({tag["name"] for tag in Page(page).all("input")}))}
    frames = [tag["class"].split()[1] for tag in Page(page).all("div") if tag.get("class", "").startswith("frame")]
    assert len(frames) == len(set(frames)) == 6
    for i, j in itertools.product(range(3), range(2)):
        assert shown(page, [f"{names[0]}-{i}", f"{names[1]}-{j}"]) == [f"f{i}-{j}"]
        assert f"f{i}-{j}" in frames


def test_each_frame_holds_the_picture_and_the_alt_text_of_its_values():
    images = Page(panel(alt=lambda gamma, shape: f"{gamma} by {shape}").to_html()).all("img")
    for image, (gamma, shape) in zip(images, itertools.product(GAMMAS, SHAPES), strict=True):
        kind, data = image["src"].split(",", 1)
        svg = unquote(data)
        assert kind == "data:image/svg+xml" and minidom.parseString(svg)
        assert f">{gamma} {shape} <" in svg or f">{gamma} {shape}<" in svg
        assert image["alt"] == f"{gamma} by {shape}"


def test_only_the_first_frame_is_visible_without_css_or_script():
    page = panel().to_html()
    frames = [tag for tag in Page(page).all("div") if tag.get("class", "").startswith("frame")]
    assert frames[0]["class"].split() == ["frame", "f0-0", "first"] and "style" not in frames[0]
    assert all(tag["style"] == "display:none" for tag in frames[1:])
    assert "<script" not in page and "http" not in re.sub(r'src="[^"]*"', "", page)


def test_controls_are_grouped_named_and_start_at_the_first_value():
    page = Page(panel(labels={"shape": "form"}).to_html())
    assert [text for tag, text in page.texts if tag == "legend"] == ["γ", "form"]
    assert [text for tag, text in page.texts if tag == "label"] == ["0.5", "0.9", "0.99", "step", "slope"]
    radios = page.all("input")
    assert all(tag["type"] == "radio" for tag in radios)
    assert [tag["for"] for tag in page.all("label")] == [tag["id"] for tag in radios]
    assert [i for i, tag in enumerate(radios) if "checked" in tag] == [0, 3]
    assert [i for i, tag in enumerate(radios) if "class" not in tag] == [0, 3]
    (group,) = (tag for tag in page.all("div") if tag.get("role") == "group")
    assert group["aria-labelledby"] in [tag.get("id") for tag in page.all("div")]


def test_start_is_what_page_notebook_and_print_show_first():
    made = panel(start={"shape": "slope", "gamma": 0.9 + 1e-12})
    page = Page(made.to_html())
    frames = [tag for tag in page.all("div") if tag.get("class", "").startswith("frame")]
    assert [i for i, tag in enumerate(frames) if "style" not in tag] == [3]
    assert frames[3]["class"].split() == ["frame", "f1-1", "first"]
    radios = page.all("input")
    assert [i for i, tag in enumerate(radios) if "checked" in tag] == [1, 4]
    assert [i for i, tag in enumerate(radios) if "class" not in tag] == [1, 4]
    assert [text for tag, text in page.texts if tag == "label"] == ["0.5", "0.9", "0.99", "step", "slope"]
    _, gamma, shape, view = made.widget().children
    assert (gamma.label, shape.label, view.value) == ("0.9", "slope", made.frames[1, 1])
    alone = explore(draw, title="Weights", gamma=[0.9], shape=["slope"])
    assert made.fallback == alone.fallback != panel().fallback


def test_a_choice_may_be_called_start():
    made = explore(lambda gamma, start: draw(gamma), title="T", gamma=[0.5, 0.9], start=[0, 1])
    assert made.choices == {"gamma": [0.5, 0.9], "start": [0, 1]} and made.start == (0, 0) and len(made.frames) == 4


def test_focus_and_choice_are_seen_on_light_and_dark_ground():
    page = panel().to_html()
    fill, letters = re.search(r"input:checked\+label \{background:(#\w+);color:(#\w+)", page).groups()
    (ring,) = re.findall(r"input:focus-visible\+label \{outline:3px solid (#\w+);outline-offset:2px\}", page)
    for ground in ("#ffffff", "#121212", "#000000"):
        assert contrast(fill, ground) >= 3 and contrast(ring, ground) >= 3  # WCAG 2.2, 1.4.11
    assert contrast(fill, letters) >= 4.5  # 1.4.3


def same_alt(**values):
    return "a falling line"


@pytest.mark.parametrize(
    "other",
    [{"title": "Others"}, {"gamma": [0.1, 0.2, 0.3]}, {"alt": lambda **v: "a rising line"}, {"start": {"gamma": 0.9}}],
)
def test_ids_are_unique_on_a_page_with_two_panels(other):
    tags = Page(panel(alt=same_alt).to_html() + panel(**{"alt": same_alt} | other).to_html()).tags
    ids = [attributes["id"] for _, attributes in tags if "id" in attributes]
    assert len(ids) == len(set(ids)) >= 12
    assert len({attributes["name"] for tag, attributes in tags if tag == "input"}) == 4


@pytest.mark.long
@pytest.mark.parametrize("fmt", ["svg", "png"])
def test_same_call_same_bytes(fmt):
    assert panel(fmt=fmt).to_html() == panel(fmt=fmt).to_html()
    assert panel(fmt=fmt).fallback == panel(fmt=fmt).fallback


@pytest.mark.long
def test_same_bytes_in_another_process():
    code = "import hashlib, test_explore as t; print(hashlib.sha256(t.panel().to_html().encode()).hexdigest())"
    here = os.path.dirname(__file__)
    run = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([here, os.path.dirname(here)]), "PYTHONHASHSEED": "77"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.strip() == hashlib.sha256(panel().to_html().encode()).hexdigest()


def test_awkward_texts_arrive_whole():
    words = 'a < b & "c" isn\'t #1, 50%'
    made = explore(
        lambda gamma: draw(gamma, words=words), title=words, alt=lambda gamma: f"{words} <i>", gamma=[0.5, 0.9]
    )
    html = made.to_html()
    page = Page(html)
    assert [image["alt"] for image in page.all("img")] == [f"{words} <i>"] * 2
    assert "<i>" not in html and ("div", words) in page.texts
    for image in page.all("img"):
        svg = minidom.parseString(unquote(image["src"].split(",", 1)[1]))
        drawn = [node.firstChild.data for node in svg.getElementsByTagName("text") if node.firstChild]
        assert any(text.endswith(words) for text in drawn)


def test_default_alt_text_says_title_and_values():
    images = Page(explore(draw, title="Weights", gamma=[0.1 + 0.2, 1]).to_html()).all("img")
    assert [image["alt"] for image in images] == ["Weights: γ = 0.3", "Weights: γ = 1"]


def test_numpy_values_are_choices_like_any_other():
    assert explore(draw, title="T", gamma=np.array([0.5, 0.9])).to_html() == (
        explore(draw, title="T", gamma=[0.5, 0.9]).to_html()
    )


def test_png_frames_are_small_and_readable():
    images = Page(panel(fmt="png").to_html()).all("img")
    assert len(images) == 6
    for image in images:
        kind, data = image["src"].split(",", 1)
        assert kind == "data:image/png;base64" and base64.b64decode(data).startswith(b"\x89PNG")


@pytest.mark.long
def test_live_panel_changes_its_picture_with_every_control():
    made = panel()
    _, gamma, shape, view = made.widget().children
    assert [gamma.description, shape.description] == ["γ", "shape"]
    assert view.value == made.frames[0, 0]
    for i, j in [(2, 0), (2, 1), (0, 1), (1, 0)]:
        gamma.value, shape.value = i, j
        assert view.value == made.frames[i, j]
        assert f'alt="Weights: γ = {GAMMAS[i]}, shape = {SHAPES[j]}"' in view.value


SLIDES = {
    "four numbers": ([0, 0.5, 0.9, 1], True),
    "of numpy": (np.linspace(0, 1, 5), True),
    "three numbers": ([0, 1, 2], False),
    "out of order": ([0, 2, 1, 3], False),
    "words": (list("abcd"), False),
    "a word among numbers": ([1, 2, 3, "more"], False),
}


@pytest.mark.parametrize("values, slider", SLIDES.values(), ids=SLIDES)
def test_many_numbers_in_ascending_order_are_a_slider(values, slider):
    made = explore(lambda gamma: draw(0.5), title="T", gamma=values)
    (row,) = Page(made.to_html()).all("fieldset")
    assert row == ({"class": "ordered"} if slider else {})
    assert type(made.widget().children[1]).__name__ == ("SelectionSlider" if slider else "ToggleButtons")


def test_bundle_serves_notebook_page_and_print():
    made = panel()
    bundle = made._repr_mimebundle_()
    assert bundle["text/plain"] == "<explore: Weights>" and bundle["text/html"] == made.to_html()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert base64.b64decode(bundle["image/png"]) == made.fallback and made.fallback.startswith(b"\x89PNG")


def test_frames_of_pyplot_are_closed():
    before = plt.get_fignums()
    explore(lambda gamma: plt.figure(figsize=(1, 1)), title="T", gamma=[1, 2, 3])
    assert plt.get_fignums() == before


BAD = {
    "no choices": ({}, "choices: got none"),
    "an empty choice": ({"gamma": []}, r"gamma: got \[\], must be numbers or words"),
    "a value twice": ({"gamma": [0.5, 0.5]}, r"gamma: got \[0.5, 0.5\], must be values that look different"),
    "too many frames": ({"gamma": range(6), "shape": list("abcdefg")}, r"42 frames \(6 gamma x 7 shape\).* 40"),
    "an empty title": ({"title": " ", "gamma": [1]}, "title: got ' ', must be a text"),
    "alt not a function": ({"alt": "text", "gamma": [1]}, "alt: got 'text', must be a function"),
    "alt without a text": ({"alt": lambda gamma: "", "gamma": [1]}, "alt: returned ''"),
    "unknown format": ({"fmt": "gif", "gamma": [1]}, "fmt: got 'gif', allowed are"),
    "label of nothing": (
        {"labels": {"beta": "b"}, "gamma": [1]},
        r"labels: got .'beta': 'b'., must be texts for .*\['gamma'\]",
    ),
    "start of nothing": ({"start": {"beta": 1}, "gamma": [1]}, r"start: got .'beta': 1., must be values .*\['gamma'\]"),
    "start without names": ({"start": 0.9, "gamma": [0.9]}, "start: got 0.9, must be values"),
    "start not there": ({"start": {"gamma": 0.7}, "gamma": [0.5, 0.9]}, "start: got 0.7 for gamma, .* of 0.5, 0.9"),
    "draw not a function": ({"draw": 3, "gamma": [1]}, "draw: got 3, must be a function"),
    "draw without a figure": ({"draw": lambda gamma: None, "gamma": [1]}, "draw returned NoneType"),
}


@pytest.mark.parametrize("arguments, message", BAD.values(), ids=BAD)
def test_bad_calls_say_what_came_and_what_is_allowed(arguments, message):
    arguments = {"draw": draw, "title": "T"} | arguments
    with pytest.raises(ValueError, match=message):
        explore(arguments.pop("draw"), **arguments)


def test_forty_frames_are_allowed():
    fig = draw(0.5)
    assert len(explore(lambda gamma: fig, title="T", gamma=range(MAX_FRAMES), fmt="svg").frames) == MAX_FRAMES == 40
