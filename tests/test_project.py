"""The repository as a whole: what lies at the top, what an import costs, what docstrings cite, the workflows."""

import ast
import importlib
import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import rlcore

ROOT = Path(__file__).parents[1]
TOP = {"book", "rlcore", "tests", "benchmarks", ".ci", ".github", "_config.yml", "_toc.yml", "requirements.txt"}
TOP |= {"requirements.lock", "README.md", "pyproject.toml", "Makefile", "LICENSE", ".gitignore"}
TOP |= {"ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "CITATION.cff", ".pre-commit-config.yaml"}
BIN = Path(sys.executable).parent


def tracked():
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("not a git checkout, or no git")
    command = ["git", "-c", "safe.directory=*", "ls-files"]  # whoever owns the checkout
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()


def test_nothing_else_lies_at_the_top():
    top = {path.split("/")[0] for path in tracked()}
    assert top == TOP


def test_no_two_modules_on_the_path_of_tests_share_a_name():
    """The one that is imported first would stand for both."""
    folders = [ROOT / name for name in ("tests", "tests/pages", "book/_ext", "book/_live", "book/_paper")]
    names = [path.stem for folder in folders for path in folder.iterdir() if path.suffix == ".py"]
    names += [path.parent.name for folder in folders for path in folder.glob("*/__init__.py")]
    assert sorted(names) == sorted(set(names))


ROOMS = {  # every module but the exercises, by name
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted((ROOT / "rlcore").rglob("*.py"))
    if "exercises" not in path.parts
}
MODULES = [
    name for name in ROOMS if not name.startswith("rlcore.plots") and name not in ("rlcore.losses", "rlcore.envs.gym")
]


IMPORTING = f"""
import sys, numpy
before, calls = set(sys.modules), 0

def count(frame, event, arg):
    global calls
    calls += event in ("call", "c_call")

sys.setprofile(count)
import {", ".join(MODULES)}
sys.setprofile(None)
new = {{name for name in set(sys.modules) - before if not name.startswith("rlcore")}}
foreign = {{name.split(".")[0] for name in new}} - set(sys.stdlib_module_names) - {{"__mp_main__", "numpy"}}
print(calls, len(new), *sorted(foreign))
"""


def test_importing_is_quick_and_light():
    """Nothing but NumPy and a part of the standard library is loaded; a sixth of a million calls took 0.3 s."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", IMPORTING], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    calls, modules, *foreign = done.stdout.split()
    assert foreign == [] and int(modules) < 120 and int(calls) < 130_000  # measured: 66 and 103,000


def imports(path):
    """(module, name) of what a file takes from rlcore."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    found = [node for node in nodes if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rlcore")]
    return [(node.module, alias.name) for node in found for alias in node.names]


def test_imports_make_no_circle():
    needs = {
        room: {f"{module}.{name}" if f"{module}.{name}" in ROOMS else module for module, name in imports(path)}
        for room, path in ROOMS.items()
    }
    while free := [room for room, others in needs.items() if not others & needs.keys()]:
        for room in free:
            del needs[room]
    assert not needs, f"in a circle, or on the way to one: {sorted(needs)}"


def length(path):
    """Lines of a file, docstrings left out: what is said about a function does not make a room larger."""
    text = path.read_text(encoding="utf-8")
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    documented = [n.body[0] for n in ast.walk(ast.parse(text)) if isinstance(n, kinds) and ast.get_docstring(n)]
    return len(text.splitlines()) - sum(doc.end_lineno - doc.lineno + 1 for doc in documented)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_is_short_and_keeps_its_own_to_itself(room):
    assert length(ROOMS[room]) <= 350
    assert not [name for _, name in imports(ROOMS[room]) if name.startswith("_")]


def test_the_index_lists_what_there_is():
    rooms = [pair for chapter in rlcore.INDEX.values() for pair in chapter.items()]
    listed = [(module, name) for module, names in rooms for name in names.split()]
    for module, name in listed:
        home = importlib.import_module(f"rlcore.{module}")
        assert getattr(home, name).__module__ == home.__name__
        assert getattr(rlcore, name) is (home if name == module else getattr(home, name))
    assert sorted(rlcore.INDEX) == list(range(1, 9)) and len(listed) == len({name for _, name in listed})
    with pytest.raises(AttributeError, match="rlcore.INDEX lists"):
        _ = rlcore.sarsa_of_mars


def test_only_plots_imports_matplotlib():
    for path in (ROOT / "rlcore").rglob("*.py"):
        if "plots" not in path.parts:
            assert not re.search(r"^\s*(import|from) matplotlib", path.read_text(encoding="utf-8"), re.M), path


def test_docstrings_cite_entries_that_exist():
    ids = {row["id"] for row in yaml.safe_load((ROOT / "book" / "concordance.yml").read_text(encoding="utf-8"))}
    cited = re.compile(r"\b(?:eq|fig|tab|alg|ex|cl|om)-[a-z0-9][a-z0-9-]*")
    found = 0
    for path in (ROOT / "rlcore").rglob("*.py"):
        if "exercises" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)):
                for name in cited.findall(ast.get_docstring(node) or ""):
                    found += 1
                    assert name in ids, f"{path.name}: {name}"
    assert found > 50


def test_jupyter_book_stays_below_2_and_torch_is_pinned():
    lines = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    assert any(re.fullmatch(r"jupyter-book==1\..*", line) for line in lines)
    assert "torch==2.13.0" in lines and "-e ." in lines
    assert all("==" in line for line in lines if re.match(r"[a-z]", line))


GITHUB = ROOT / ".github"
WORKFLOWS = sorted(str(path) for path in (GITHUB / "workflows").glob("*.yml"))
FORMS = sorted(str(path) for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config")
SCHEMAS = {
    "github-workflows": WORKFLOWS,
    "github-issue-forms": FORMS,
    "github-issue-config": [str(GITHUB / "ISSUE_TEMPLATE" / "config.yml")],
    "citation-file-format": [str(ROOT / "CITATION.cff")],
}


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [["zizmor", "--offline", "-q", "--config", str(GITHUB / "zizmor.yml"), *WORKFLOWS],
     *(["check-jsonschema", "--builtin-schema", f"vendor.{name}", *files] for name, files in SCHEMAS.items())],
    ids=lambda command: command[2].removeprefix("vendor."),
)  # fmt: skip
def test_workflows_forms_and_citation_pass_the_linters(command):
    done = subprocess.run([str(BIN / command[0]), *command[1:]], capture_output=True, text=True, env=os.environ)
    assert len(WORKFLOWS) >= 4 and len(FORMS) >= 3 and done.returncode == 0, done.stdout + done.stderr


def test_hooks_run_what_is_pinned():
    pins = (ROOT / "requirements.txt").read_text(encoding="utf-8")
    (repository,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"]
    assert repository["repo"] == "local"
    for hook in repository["hooks"]:
        tool = hook["entry"].split()[0]
        if hook["language"] == "system":
            assert re.search(rf"^{tool.removeprefix('.venv/bin/')}==", pins, re.M), tool
        else:
            assert all("==" in package for package in hook["additional_dependencies"]), tool
    assert {"ruff-check", "ruff-format", "end-of-file-fixer", "check-yaml"} <= {h["id"] for h in repository["hooks"]}


def test_the_lock_holds_every_pin_with_hashes_and_what_torch_needs():
    entries = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", "").splitlines()
    lock = {}
    for entry in entries:
        if not entry.startswith("#"):
            whole = re.fullmatch(r"([a-z0-9-]+)==(\S+)( ; [^-]+)?( +--hash=sha256:[0-9a-f]{64})+", entry)
            assert whole, entry[:99]
            name, version = whole.group(1, 2)
            lock.setdefault(name, set()).add(version)
    pins = (ROOT / "requirements.txt").read_text(encoding="utf-8")
    for name, version in re.findall(r"^([a-z0-9-]+)(?:\[.*\])?==(\S+)$", pins, re.M):
        assert name == "torch" or lock.get(name) == {version}, name
    wanted = [need for need in importlib.metadata.requires("torch") if "extra ==" not in need]
    names = {re.match(r"[\w-]+", need)[0] for need in wanted if not re.match("nvidia|cuda|triton", need)}
    assert len(lock) > 100 and names <= set(lock) and not re.search("torch|nvidia|cuda|triton|://", " ".join(entries))


def test_the_weekly_run_takes_every_pin_off(tmp_path):
    for name in ("requirements.txt", "pyproject.toml"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    weekly = yaml.safe_load((ROOT / ".github" / "workflows" / "weekly.yml").read_text(encoding="utf-8"))
    steps = {step.get("name"): step.get("run") for step in weekly["jobs"]["newest"]["steps"]}
    script = steps["Take all pins off, but keep Jupyter Book below 2"]
    newest = subprocess.run(["sh", "-ec", script], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert "==" not in newest + (tmp_path / "pyproject.toml").read_text(encoding="utf-8")
    assert {"jupyter-book<2", "torch", "gymnasium[mujoco]", "-e .[all]"} <= set(newest.splitlines())
