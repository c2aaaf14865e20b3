"""One source, two speeds: the same bits with and without numba, and imports that stay light."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from worlds import awkward, gambler

from rlcore import dp, mdp
from rlcore.core import compiled
from rlcore.envs import dyna_maze, gridworld, random_mdp, random_walk, recycling_robot
from rlcore.planning import dyna_q, sample_transitions
from rlcore.solver import solve

needs_numba = pytest.mark.skipif(not compiled.HAVE_NUMBA, reason="numba is absent or switched off")
HERE = Path(__file__).parent


def results():
    """{name: arrays} of every function of mdp and dp that computes, on processes of several kinds."""
    found = {}
    processes = {
        "robot": recycling_robot(),
        "awkward": awkward(),
        "slippery": gridworld(4, 5, slip=0.3),
        "walk": random_walk(9),
        "dense": random_mdp(15, 3, rng=np.random.default_rng(0)),
        "sparse": random_mdp(40, 3, n_next=3, rng=np.random.default_rng(1)),
    }
    for name, m in processes.items():
        rng, pi = np.random.default_rng(7), mdp.uniform_policy(m)
        tau = mdp.rollout(m, pi, 200, rng=rng)
        found[f"rollout {name}"] = [tau.states, tau.actions, tau.rewards]
        s = int(m.start.argmax())
        found[f"sample_returns {name}"] = [mdp.sample_returns(m, pi, 0.9, 50, s=s, max_steps=60, rng=rng)]
        a = int(m.legal[s].argmax())
        found[f"sample_returns a {name}"] = [mdp.sample_returns(m, pi, 0.9, 50, s=s, a=a, max_steps=60, rng=rng)]
        world = m.sampler()
        found[f"step {name}"] = [[mdp.step(world, s, a, rng) for _ in range(50)]]
        found[f"draw {name}"] = [[mdp.draw(world.start_cdf, rng) for _ in range(50)]]
        found[f"rng {name}"] = [rng.random(3)]  # both have drawn equally often
        found[f"sample_transitions {name}"] = list(vars(sample_transitions(m, pi, 100, rng=rng)).values())
        for in_place in (False, True):
            solutions = [
                dp.policy_evaluation(m, pi, 0.9, in_place=in_place, V0=1.0, tol=1e-4, record=1),
                dp.value_iteration(m, 0.9, in_place=in_place, V0=-1.0, tol=1e-4, record=1),
            ]
            for k, x in enumerate(solutions):
                found[f"sweeps {k} {in_place} {name}"] = [x.V, x.Q, x.pi, x.history, [x.n_iter, x.bound, x.converged]]
        for gamma, tol in ((0.5, 1e-9), (0.9, 1e-4)):
            x = solve(m, gamma, tol=tol)
            found[f"solve {gamma} {name}"] = [x.V, x.Q, x.pi, [x.n_iter, x.bound]]
        x = dp.policy_iteration(m, 0.9, record=1)
        found[f"policy_iteration {name}"] = [x.V, x.pi, x.history]
    found["gambler"] = [dp.value_iteration(gambler(0.4, goal=20), 1.0, record=1).history]
    run = dyna_q(dyna_maze(), 0.95, 4, n_planning=5, alpha=0.1, epsilon=0.1, record=1, rng=np.random.default_rng(3))
    found["dyna_q"] = [run.Q, run.returns, run.lengths, run.history, run.visits, run.model.next_state, run.model.reward]
    assert not [name for name, arrays in found.items() if any(np.asarray(x).dtype == object for x in arrays)]
    return found


def digests():
    return {
        name: hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in arrays)).hexdigest()
        for name, arrays in results().items()
    }


def python(code, **env):
    """Output of a fresh interpreter."""
    env = {**os.environ, "PYTHONPATH": str(HERE), **env}
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], env=env, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")  # nor any note: this is no terminal
    return done.stdout


@pytest.mark.long
@needs_numba
def test_compiled_and_interpreted_results_have_the_same_bits():
    code = "import json, test_compiled as t; assert not t.compiled.HAVE_NUMBA; print(json.dumps(t.digests()))"
    interpreted = json.loads(python(code, RLCORE_NO_NUMBA="1"))
    here = digests()
    assert here.keys() == interpreted.keys() and len(here) > 60
    assert [name for name in here if here[name] != interpreted[name]] == []


def test_digest_sees_the_last_bit():
    x = np.array([1.0, 2.0])
    assert hashlib.sha256(x.tobytes()).digest() != hashlib.sha256(np.nextafter(x, 3.0).tobytes()).digest()
    assert digests() == digests()  # same seeds, same results


LATE = """
from rlcore.core.compiled import compiled
from rlcore.core.sampling import draw

@compiled
def before(cdf, rng):
    return draw(cdf, rng) + after(cdf, rng)

@compiled
def after(cdf, rng):
    return 10 * draw(cdf, rng)
"""
LINK = """
import sys, numpy
from rlcore.core import compiled, sampling
assert isinstance(sampling.draw, compiled._Lazy) and sampling.draw.dispatcher is None
sys.path.insert(0, {folder!r})
cdf, rng = numpy.array([0.0, 1.0]), numpy.random.default_rng(0)
if {first}:
    sampling.draw(cdf, rng)
import late
drawn = late.before(cdf, rng), late.after(cdf, rng), sampling.draw(cdf, rng)
print(*drawn, type(late.before).__name__, type(late.draw).__name__)
"""


@pytest.mark.long
@needs_numba
@pytest.mark.parametrize("first", [False, True])
def test_functions_of_several_modules_find_each_other(first, tmp_path):
    """A compiled function may call one of another module, or one defined below it, whichever is called first.

    What is a part of others has no entry for Python: it stays what it was there, and its Python body runs.
    """
    (tmp_path / "late.py").write_text(LATE)
    assert python(LINK.format(folder=str(tmp_path), first=first)) == "11 10 1 CPUDispatcher _Part\n"


NESTED = """
from rlcore.core.compiled import compiled

@compiled
def outer(x):
    return inner(x)

@compiled
def inner(x):
    return x
"""
NOTE = """
import sys, numba
sys.path.insert(0, {folder!r})
import nested
nested.outer(1)
nested.inner(1.0)
if {first}:
    numba.njit(lambda x: x)(1)
"""


@pytest.mark.long
@needs_numba
def test_compiling_is_announced_once(tmp_path):
    """A line for a function and what it calls, where RLCORE_NOTES=1 asks for it; none from the disk or for others."""
    (tmp_path / "nested.py").write_text(NESTED)
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "RLCORE_NOTES": "1"}
    notes = []
    for first in (True, False):
        command = [sys.executable, "-c", NOTE.format(folder=str(tmp_path), first=first)]
        notes.append(subprocess.run(command, env=env, capture_output=True, text=True, check=True).stderr)
    lines = [f"rlcore: compiling {name}, once (a few seconds)\n" for name in ("outer", "inner")]
    assert notes == ["".join(lines), ""]


CHAIN = """
from rlcore.core.compiled import compiled
from rlcore.link import link

@compiled
def chain():
    return 10 * link()
"""
CALLS = """
import sys
for number in {numbers}:
    with open({link!r}, "w") as file:
        file.write(f"from rlcore.core.compiled import compiled\\n\\n@compiled\\ndef link():\\n    return {{number}}\\n")
    for name in [name for name in sys.modules if name.startswith("rlcore")]:
        del sys.modules[name]
    from rlcore.chain import chain
    print(number, chain(), sys.modules["rlcore.core.compiled"].__file__)
    print(number, file=sys.stderr)
"""


@pytest.fixture
def package(tmp_path):
    """rlcore with two functions, one of which calls the other: `chain` gives ten times what `link` returns."""
    package = tmp_path / "site" / "rlcore"
    package.mkdir(parents=True)
    (package / "core").mkdir()
    (package / "__init__.py").touch()
    for name in ("__init__.py", "compiled.py", "types.py"):
        shutil.copy(Path(compiled.__file__).with_name(name), package / "core")
    (package / "chain.py").write_text(CHAIN)
    return package


def calls(package, *numbers, path=None, **env):
    """What is compiled where `link` returns one number after the other, each time in a rlcore imported anew."""
    env = {**os.environ, "PYTHONPATH": str(path or package.parent), "NUMBA_CACHE_DIR": "", **env}
    env |= {"PYTHONDONTWRITEBYTECODE": "1", "RLCORE_NOTES": "1"}
    command = [sys.executable, "-W", "error", "-c", CALLS.format(numbers=numbers, link=str(package / "link.py"))]
    done = subprocess.run(command, env=env, cwd=package.parents[1], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    file = (path / "rlcore" if path else package) / "core" / "compiled.py"
    assert done.stdout == "".join(f"{number} {10 * number} {file}\n" for number in numbers)
    return [line.split()[2].rstrip(",") if "compiling" in line else int(line) for line in done.stderr.splitlines()]


@pytest.mark.long
@needs_numba
@pytest.mark.parametrize("folder", ["", "cache"])
def test_machine_code_is_kept_until_what_it_calls_changes(package, tmp_path, folder):
    env = {"NUMBA_CACHE_DIR": str(tmp_path / folder) if folder else ""}
    assert calls(package, 1, 1, 2, 2, **env) == ["chain", 1, 1, "chain", 2, 2]
    assert calls(package, 2, **env) == [2]


@pytest.mark.long
@needs_numba
def test_compiled_without_a_writable_folder(package):
    (package / "__pycache__").touch()
    nowhere = str(package / "chain.py" / "cache")
    assert calls(package, 1, 1, HOME=nowhere, XDG_CACHE_HOME=nowhere, NUMBA_CACHE_DIR=nowhere) == ["chain", 1] * 2


@pytest.mark.long
@needs_numba
def test_compiled_in_a_zip(package, tmp_path):
    (package / "link.py").write_text(
        "from rlcore.core.compiled import compiled\n\n@compiled\ndef link():\n    return 3\n"
    )
    path = shutil.make_archive(str(tmp_path / "rlcore"), "zip", package.parent)
    assert calls(package, 3, path=Path(path), NUMBA_CACHE_DIR=str(tmp_path / "cache")) == ["chain", 3]
    assert not (tmp_path / "cache").exists()


def test_plain_python_where_numba_is_switched_off():
    code = "from rlcore.core import sampling; import types; print(isinstance(sampling.draw, types.FunctionType))"
    assert python(code, RLCORE_NO_NUMBA="1") == "True\n"


@pytest.mark.parametrize("module", ["mdp", "bellman", "dp", "planning", "envs"])
def test_import_is_light(module):
    """Neither numba nor torch nor matplotlib nor gymnasium is loaded before it is needed."""
    heavy = ("numba", "torch", "matplotlib", "gymnasium", "ipywidgets")
    code = f"import sys, rlcore.{module}; print([name for name in {heavy} if name in sys.modules])"
    assert python(code) == "[]\n"
