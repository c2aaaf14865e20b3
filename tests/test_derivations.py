"""Every step of every derivation, read from the page and evaluated on processes; and each step broken on purpose."""

import pytest
from derivations import HARMLESS, REGISTRY, anchors, broken, check, derivations, difference, lines
from latex import NOTICED

FOUND = derivations()


@pytest.mark.parametrize("name", FOUND)
def test_each_step_follows_from_the_one_before(name):
    chapter, latex = FOUND[name]
    assert name in REGISTRY, f"{name} has no process to be evaluated on"
    assert REGISTRY[name].chapter == chapter
    assert check(name, latex) > 0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # a wrong denominator may be 0
@pytest.mark.parametrize("name", FOUND)
def test_each_error_is_noticed(name):
    formulas, changed, missed = lines(FOUND[name][1]), set(), {}
    for latex in broken(name, FOUND[name][1]):
        try:
            changed |= {i for i, (x, y) in enumerate(zip(lines(latex), formulas, strict=True)) if x != y}
            check(name, latex)
        except NOTICED:
            continue
        line = difference(latex, FOUND[name][1])
        known = [text for text in HARMLESS.get(name, {}) if text in line]
        missed[line] = known[0] if known else None
    assert changed == {*range(len(formulas))}, "a line in which nothing is broken"
    assert None not in missed.values(), [line for line, known in missed.items() if not known]
    assert {*missed.values()} == {*HARMLESS.get(name, {})}, "what is listed as harmless is noticed"


def test_each_anchor_stands_once_and_before_a_display():
    assert sorted(anchors()) == sorted(FOUND)


def test_each_exception_is_a_line_of_its_derivation():
    for name, (_, latex) in FOUND.items():
        formulas = [formula.replace("&", "").strip() for formula, _ in lines(latex)]
        for start in [*REGISTRY[name].unread, *REGISTRY[name].slack]:
            assert any(formula.startswith(start) for formula in formulas), f"{name}: no line begins with {start}"


def test_nearly_all_lines_are_evaluated():
    total = sum(len(lines(latex)) for _, latex in FOUND.values())
    assert 5 * sum(len(REGISTRY[name].unread) for name in FOUND) < total


def test_each_line_has_a_reason():
    """Two lines in three at least: a result at the end speaks for itself."""
    for name, (_, latex) in FOUND.items():
        said = [bool(reason) for _, reason in lines(latex)]
        assert 3 * sum(said) >= 2 * len(said), name


def test_each_derivation_is_on_a_page():
    assert sorted(FOUND) == sorted(REGISTRY) and {*HARMLESS} <= {*REGISTRY}
