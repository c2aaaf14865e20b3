"""Every public function with bad values for every argument: an error that names it, never another, a hang, or NaN."""

import inspect

import fuzz
import fuzz_networks
import fuzz_tables
import pytest

pytestmark = pytest.mark.long
CALLS = fuzz_tables.CALLS | fuzz_networks.CALLS
FUNCTIONS = {name: thing for name, thing in fuzz.public().items() if not fuzz.is_compiled(thing)}


def arguments(name):
    """{argument: value} of a good call; made anew each time, since a call may use its arguments up."""
    given = {}
    for argument, parameter in inspect.signature(
        getattr(FUNCTIONS[name], "__func__", FUNCTIONS[name])
    ).parameters.items():
        make = CALLS.get(name, {}).get(argument) or fuzz.ARGUMENTS.get(argument)
        if argument == "cls":
            continue
        if argument in CALLS.get(name, {}) or parameter.default is inspect.Parameter.empty:
            assert make is not None, f"{name}: no good value of {argument} in ARGUMENTS or CALLS"
            given[argument] = make()
        elif parameter.default is not None and parameter.kind != inspect.Parameter.VAR_KEYWORD:
            given[argument] = parameter.default
        elif make is not None:
            given[argument] = make()
    return given


def call(name, given):
    """The function called; `args` stand behind its first argument, `settings` are keywords beyond its names."""
    function, given = FUNCTIONS[name], dict(given)
    owner = FUNCTIONS.get(name.rpartition(".")[0])
    if inspect.isclass(owner) and isinstance(vars(owner)[name.rpartition(".")[2]], classmethod):
        function = getattr(owner, name.rpartition(".")[2])
    elif isinstance(function, staticmethod):
        function = function.__func__
    behind = given.pop("args", ())
    if behind:
        return function(given.pop("method"), *behind, **given.pop("settings", {}), **given)
    return function(**given)


def test_calls_are_of_functions_that_exist():
    assert set(CALLS) <= set(FUNCTIONS)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_bad_values_are_named(name):
    good = arguments(name)
    has_nan = fuzz.holds_nan(call(name, good))
    found = []
    for argument in good:
        if argument in ("self", "args", "settings"):
            continue
        for kind, value in fuzz.BAD.items():
            given = arguments(name)
            if fuzz.is_good(name, argument, kind):
                continue
            given[argument] = value
            wrong = fuzz.problem(lambda given=given: call(name, given), argument, has_nan)
            if wrong:
                found.append(f"{argument} = {kind}: {wrong}")
    assert not found, "\n" + "\n".join(found)
