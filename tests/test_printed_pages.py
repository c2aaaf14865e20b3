"""Every equation on the pages is compared with rlcore, step by step where it is a derivation, or stands here with the
reason why nothing can be compared.
"""

import re

import pytest
import test_printed_equations as equations
import test_printed_networks as networks
import test_printed_ppo as ppo
import test_printed_processes as processes
import test_printed_reinforce as reinforce
import test_printed_updates as updates
from derivations import REGISTRY
from latex import cells, displays

TESTED = {
    **equations.CHAPTER, **updates.PAGE, **processes.PAGE,
    **dict.fromkeys(networks.TESTED, networks.PAGE), **dict.fromkeys(reinforce.TESTED, reinforce.PAGE),
    **dict.fromkeys(ppo.TESTED, ppo.PAGE),
    "om-state-traces": "05_eligibility_traces", "eq-u-watkins-trace": "05_eligibility_traces",
}  # fmt: skip
NOTATION = {
    "eq-u-trajectory": "the order of an episode, no equality: rollout is tested",
    "om-mdp-tuple": "a list of what a process consists of",
    "eq-u-policy-inline": "names pi(a | s), in the text",
    "eq-u-dynamics": "says from what S' is drawn: the sampling of rollout and MDPEnv is tested",
    r"x_{t+1} \approx": "a model to be fitted, which holds approximately: estimate_model is tested",
    "eq-u-model-and-policy": "names two distributions",
    "eq-u-transition-inline": "names p(s' | s, a), in the text",
    "eq-u-td-target": "the target in the text, part of (19)",
    "om-convergence-conditions": "conditions on infinite sequences of step sizes",
    "eq-27": "adds (26) to the table: what is added is compared",
    "eq-28": "says that nothing changes before the end",
}
PAGES = sorted({*TESTED.values()})


def keys(names, latex):
    return names or [key for key in (*TESTED, *NOTATION) if latex.strip().startswith(key)]


@pytest.mark.parametrize("page", PAGES)
def test_every_display_is_tested_or_listed(page):
    for names, latex in displays(page):
        assert {*keys(names, latex)} & {*TESTED, *NOTATION, *REGISTRY}, f"{names}: {latex}"


@pytest.mark.parametrize("page", PAGES)
def test_every_equation_with_an_id_is_tested_or_listed(page):
    anchors = {*re.findall(r'<span id="(eq-[^"]*)">|\((eq-[\w-]+)\)\s', "\n".join(cells(page, "markdown")))}
    ids = {name for pair in anchors for name in pair if name}
    assert ids and ids <= {*TESTED, *NOTATION}, ids - {*TESTED, *NOTATION}


def test_what_is_listed_is_on_a_page_and_not_tested():
    there = {key for page in PAGES for names, latex in displays(page) for key in keys(names, latex)}
    text = "\n".join(text for page in PAGES for text in cells(page, "markdown"))
    there |= {*re.findall(r'<span id="(eq-[^"]*)">', text)}
    assert {*NOTATION} <= there and not {*NOTATION} & {*TESTED}
    assert all(len(reason) > 20 for reason in NOTATION.values())
