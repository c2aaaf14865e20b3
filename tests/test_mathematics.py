"""Formulas as the build sets them: what is in them stays in order, long ones may break where TeX breaks them."""

import re
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "book" / "_ext"))
mathematics = pytest.importorskip("companion.mathematics")
CONFIG = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))["sphinx"]["config"]["mathjax3_config"]


@pytest.fixture(scope="module")
def typesetter():
    return mathematics.Typesetter(CONFIG)


def signs(html):
    return re.findall(r"<mjx-c class=\"(mjx-c[0-9A-F]+)", html)


def parts(html):
    return [signs(part) for part in re.split(r"<mjx-math ", html)[1:]]


def test_a_short_formula_is_one_piece(typesetter):
    html = typesetter.typeset(r"\gamma = 1", False)
    assert parts(html) == [["mjx-c1D6FE", "mjx-c3D", "mjx-c31"]] and 'class="MathJax"' in html


def test_a_long_one_breaks_after_relations_and_operators_and_outside_of_brackets(typesetter):
    html = typesetter.typeset(r"f(a - b) = c + d + e + g + h + k", False)
    ends = [part[-1] for part in parts(html)]
    assert ends == ["mjx-c3D"] + ["mjx-c2B"] * 5 + ["mjx-c1D458"] and "parts" in html
    assert sum(parts(html), []) == signs(typesetter._typeset(r"f(a-b)=c+d+e+g+h+k", True))


def test_what_is_too_wide_in_brackets_breaks_there(typesetter):
    inside = " + ".join("abcdefgh")
    assert len(parts(typesetter.typeset(f"f({inside})", False))) == 8
    assert len(parts(typesetter.typeset(f"f({inside})", True))) == 1  # a display has room for it
    assert len(parts(typesetter.typeset(f"f({inside} + {inside})", True))) == 16


def test_what_cannot_break_may_scroll(typesetter):
    html = typesetter.typeset(r"\frac{abcdefghijklmnop}{2}", False)
    assert "wide" in re.search(r'<mjx-container class="([^"]*)"', html)[1].split() and len(parts(html)) == 1


def test_words_for_those_who_listen_stand_beside(typesetter):
    assert "<mfrac><mi>a</mi><mi>b</mi></mfrac>" in typesetter.typeset(r"\frac{a}{b}", True)


def test_the_books_own_commands_are_known(typesetter):
    assert "mjx-c1D53C" in signs(typesetter.typeset(r"\E_\pi", False))


@pytest.mark.parametrize("tex", [r"\frac{a", r"\nosuchcommand", r"a_b_c"])
def test_what_is_no_tex_stops_the_build(typesetter, tex):
    with pytest.raises(ValueError, match="cannot set it"):
        typesetter.typeset(tex, False)


def test_the_stylesheet_has_the_signs_of_the_pages_and_no_others(typesetter, tmp_path):
    page = tmp_path / "page.html"
    page.write_text(typesetter.typeset(r"\{a\}", False), encoding="utf-8")
    rules = typesetter.stylesheet([page])
    assert set(re.findall(r"\bmjx-c[0-9A-F]+\b", rules)) == {"mjx-c7B", "mjx-c7D", "mjx-c1D44E"}
    assert rules.count("{") == rules.count("}") and "mjx-math" in rules and r'content: "\7B"' in rules


class Node(dict):
    def astext(self):
        return self["text"]


@pytest.mark.parametrize(
    "text, nowrap, expected",
    [
        ("a = b", False, "a = b"),
        (r"a \\ b", False, r"\begin{split}a \\ b\end{split}"),
        ("a\n\nb", False, r"\begin{align}\begin{aligned}&a\\ &b\end{aligned}\end{align}"),
        (r"\begin{align}a\end{align}", True, r"\begin{align}a\end{align}"),
    ],
)
def test_lines_of_a_display(text, nowrap, expected):
    assert mathematics.whole(Node(text=text, nowrap=nowrap)) == expected
