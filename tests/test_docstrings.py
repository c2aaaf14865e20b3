"""What users call is documented in numpydoc's sections, and the examples give what they print."""

import doctest
import importlib
import inspect
import re
import sys
from pathlib import Path

import pytest
from numpydoc.validate import validate

import rlcore

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "book" / "_ext"))
INDEX = [f"rlcore.{room}.{name}" for rooms in rlcore.INDEX.values() for room, names in rooms.items()
         for name in names.split()]  # fmt: skip
RESULTS = ["rlcore.core.results.Run", "rlcore.core.results.Solution"]
CORE = ["core.agents", "core.results", "core.running", "core.schedules"]  # the rest of core is for our own modules
ROOMS = CORE + sorted(
    ".".join(path.relative_to(ROOT / "rlcore").with_suffix("").parts)
    for folder in ("", "envs", "plots", "studies") for path in (ROOT / "rlcore" / folder).glob("[a-z]*.py")
)  # fmt: skip
BEHIND = {  # public, but for our own modules: one sentence will do
    "batch": "episode_pairs", "bellman": "table", "dp": "evaluation_sweep optimality_sweep", "explore": "Explorer",
    "gae": "learning_data", "nn": "network check_network", "optimizers": "take_step", "planning":
    "Transitions empty_memory remember", "policies": "max_value expected_value control probabilities choose add_score "
    "dot check_features check_parameters check_p_min linear gradient", "policy_gradient": "softmax_episode",
    "ppo": "improve", "reinforce": "network_world sizes make_networks TimeBaseline", "sweep": "Record",
    "nstep": "reward_list value_list visited values_on_the_way return_to_horizon lambda_returns",
    "traces": "kept visit credit", "trpo": "fit_values", "trust_region": "OldPolicy",
    "core.agents": "action_box make_agent", "core.results": "PlanningRun WatkinsRun",
    "core.running": "Watch interruptible marks watched",
    "core.schedules": "constant check_schedule at now", "plots.ch02": "draw_tree",
    "plots.style": "Figure method_of rung",
}  # fmt: skip
CODES = {  # https://numpydoc.readthedocs.io/en/stable/validation.html
    "GL03",  # double blank lines
    "GL05",  # tabs
    "GL06",  # an unknown section
    "GL07",  # sections in another order
    "GL08",  # no docstring
    "SS01",  # no summary
    "SS03",  # a summary without its full stop
    "SS06",  # a summary of several lines
    "PR01",  # an argument that is not documented
    "PR02",  # a documented one that there is not
    "PR03",  # arguments in another order
    "PR04",  # an argument without its type
    "PR07",  # an argument without a description
    "PR09",  # a description without its full stop
    "PR10",  # a colon without a space before it
    "RT01",  # no Returns section
    "RT03",  # a returned value without a description
    "RT05",  # its description without a full stop
}
PER_USER = CODES | {"EX01"}  # of what INDEX lists: no example


def rooms_functions():
    """Names of the public functions and classes of ROOMS, but for those that are BEHIND."""
    for room in ROOMS:
        module = importlib.import_module(f"rlcore.{room}")
        for name, thing in vars(module).items():
            own = getattr(thing, "__module__", None) == module.__name__
            called = inspect.isclass(thing) or inspect.isfunction(inspect.unwrap(thing)) if own else False
            named_tuple = inspect.isclass(thing) and issubclass(thing, tuple)
            if called and not named_tuple and not name.startswith("_") and name not in BEHIND.get(room, "").split():
                yield f"rlcore.{room}.{name}"


DOCUMENTED = sorted({*INDEX, *rooms_functions()})


@pytest.mark.parametrize("name", DOCUMENTED)
def test_numpydoc_finds_nothing_wrong(name):
    wanted = PER_USER if name in INDEX or name in RESULTS else CODES
    assert [text for code, text in validate(name)["errors"] if code in wanted] == []


def test_types_of_arguments_are_those_of_the_annotations():
    for name in DOCUMENTED:
        home, _, last = name.rpartition(".")
        thing = getattr(importlib.import_module(home), last)
        documented = inspect.getdoc(thing).partition("\nReturns\n")[0]
        documented = dict(re.findall(r"^(\w+) : (.*)$", documented, re.M))
        annotated = {p.name: p.annotation for p in inspect.signature(thing).parameters.values()}
        assert {key: kind for key, kind in documented.items() if annotated[key] != kind} == {}, name


def test_what_is_behind_exists():
    assert all(hasattr(importlib.import_module(f"rlcore.{room}"), name)
               for room, names in BEHIND.items() for name in names.split())  # fmt: skip
    assert len(DOCUMENTED) > 330  # measured: 348


EXAMPLES = [f"rlcore.{room}" for room in ROOMS]


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_print_what_they_say(name):
    module, told = importlib.import_module(name), []
    for test in doctest.DocTestFinder(exclude_empty=True).find(module):
        test.globs = {}  # an example imports what it needs, as who copies it does
        doctest.DocTestRunner(verbose=False).run(test, out=told.append)
    assert "".join(told) == ""


def test_examples_of_decorated_functions_are_found():
    tests = doctest.DocTestFinder(exclude_empty=True).find(importlib.import_module("rlcore.td"))
    found = {test.name for test in tests if test.examples}
    assert found == {f"rlcore.td.{name}" for name in rlcore.INDEX[4]["td"].split()}


WHOLE = '''@learner(control)
def f(
    self, world: World, /, *more: int, alpha: Rate = 1e-3, pi: ArrayLike | None = None, **rest: Any,
) -> Run:  # fmt: skip
    """Q moves, E[R | s] too. It says more.

    Parameters
    ----------
    """
    # why
    return g(world)[1:]  # eq-21
'''
BRIEF = '''@learner(control)
def f(self, world, /, *more, alpha=1e-3, pi=None, **rest):
    """Q moves, E[R | s] too."""
    # why
    return g(world)[1:]  # eq-21
'''


def test_pages_show_the_code_without_types_and_with_one_sentence():
    listing = importlib.import_module("companion.listing")
    assert listing.brief(WHOLE) == BRIEF == listing.brief(BRIEF)
