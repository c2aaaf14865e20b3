"""The package as somebody else gets it: built, checked, installed alone in an empty environment, tried far from here.

python tests/release.py          wheel and sdist are left in _build/dist
python tests/release.py v0.1.0   the tag must be the version; what CHANGELOG.md says of it, and how to cite it, is
                                 left in _build/notes.md
"""

import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST, NOTES = ROOT / "_build" / "dist", ROOT / "_build" / "notes.md"
TOOLS = ["build==1.6.1", "twine==7.0.0"]
BASE = {"rlcore", "numpy", "scipy", "pip", "setuptools"}  # setuptools: venv of Python 3.11 brings it
NEEDS = {"rlcore.plots": "plots", "rlcore.envs.gym": "gym", "rlcore.losses": "deep"}  # with what is in them
CLUSTER = {"dask", "dask_jobqueue", "dask_kubernetes"}  # an example that imports one needs Slurm or Kubernetes
ADVICE = r"pip install '(rlcore\[(\w+)\])'"
IMPORTS = rf"""
import importlib, pathlib, re, rlcore
root = pathlib.Path(rlcore.__file__).parent
for path in sorted(root.rglob("*.py")):
    name = ".".join(["rlcore", *path.relative_to(root).with_suffix("").parts]).removesuffix(".__init__")
    try:
        importlib.import_module(name)
    except ImportError as error:
        advice = re.search({ADVICE!r}, str(error))
        print(name, advice[2] if advice else repr(error))
"""


def version():
    return re.search(r'^__version__ = "(.+)"$', (ROOT / "rlcore" / "__init__.py").read_text(encoding="utf-8"), re.M)[1]


def notes(wanted):
    """What CHANGELOG.md says of a version; None where it says nothing."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = re.search(rf"^## \[{re.escape(wanted)}\] - \d{{4}}-\d\d-\d\d\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    return found and found[1].strip() + "\n"


def citation():
    """How to cite this version, from CITATION.cff."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (by,), (title,), (date,) = (
        re.findall(rf'^ *(?:- )?{key}: "?(.+?)"?$', text, re.M) for key in ("name", "title", "date-released")
    )
    return f"{by}: *{title}*, version {version()}, {date}."


def examples(text):
    """(file name, source) of each Python example of a Markdown text; the name is the one in its first line, if any."""
    for n, source in enumerate(re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S), 1):
        named = re.match(r"# (\w+\.py)\b", source)
        yield (named[1] if named else f"example_{n}.py"), source


def imported(source):
    """Top-level names of the modules that a source imports."""
    nodes = list(ast.walk(ast.parse(source)))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
    return {name.partition(".")[0] for name in names}


def unexpected(lines):
    """What is wrong with the lines that IMPORTS prints where nothing but NumPy and SciPy is installed."""
    failed = dict(line.split(" ", 1) for line in lines.splitlines())
    wrong = [f"{name} imports without {extra}" for name, extra in NEEDS.items() if name not in failed]
    for name, said in failed.items():
        home = next((home for home in NEEDS if name == home or name.startswith(home + ".")), None)
        if said != NEEDS.get(home):
            wrong.append(f"{name}: {said}")
    return wrong


def missing(stderr):
    """The extra that brings what an example did not find: the one that the error names, or that lists the package."""
    if advice := re.search(ADVICE, stderr):
        return advice[1]
    absent = re.search(r"No module named '(\w+)", stderr)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for extra, needs in extras.items():
        if absent and any(re.match(r"[\w-]+", need)[0] == absent[1] for need in needs):
            return f"rlcore[{extra}]"
    return None


class Failed(Exception):
    pass


def run(*command, cwd, check=True):
    """A command outside the checkout, in an environment that leads nowhere near it."""
    env = {
        name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV", "RLCORE"))
    }
    done = subprocess.run([str(part) for part in command], cwd=cwd, env=env, capture_output=True, text=True)
    if check and done.returncode:
        raise Failed(f"{' '.join(map(str, command))[:300]}\n{done.stdout}{done.stderr}")
    return done


def environment(folder):
    """The Python of a new environment, and a function that installs into it."""
    run(sys.executable, "-m", "venv", folder, cwd=folder.parent)
    python = folder / "bin" / "python"
    return python, lambda *what: run(python, "-m", "pip", "install", "--quiet", *what, cwd=folder.parent)


def build(work):
    """Build the sdist, and the wheel from it, from a copy that holds what a clone does; the path of the wheel."""
    source = work / "source"
    shutil.copytree(ROOT / "rlcore", source / "rlcore", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    python, install = environment(work / "tools")
    install(*TOOLS)
    shutil.rmtree(DIST, ignore_errors=True)
    run(python, "-m", "build", "--outdir", DIST, source, cwd=work)
    run(python, "-m", "twine", "check", "--strict", *DIST.iterdir(), cwd=work)
    (wheel,), (sdist,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    if (sdist.name, wheel.name) != (f"rlcore-{version()}.tar.gz", f"rlcore-{version()}-py3-none-any.whl"):
        raise Failed(f"rlcore is {version()}, the files are {sdist.name}, {wheel.name}")
    here = {path.relative_to(source).as_posix() for path in (source / "rlcore").rglob("*") if path.is_file()}
    there = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    if here != there:
        raise Failed(f"{wheel.name} and the checkout differ in: {', '.join(sorted(here ^ there))}")
    print(f"built and checked: {wheel.name}, {sdist.name}", flush=True)
    return wheel


def try_example(python, install, name, source, folder):
    """Run an example, with the extras that its errors ask for; what was done, in words."""
    (folder / name).write_text(source, encoding="utf-8")
    if imported(source) & CLUSTER:
        compile(source, name, "exec")
        return "needs a cluster: compiled only"
    added = []
    while (done := run(python, name, cwd=folder, check=False)).returncode:
        extra = missing(done.stderr)
        if extra is None or extra in added:
            raise Failed(f"README.md, {name}:\n{source}\n{done.stdout}{done.stderr}")
        install(extra)
        added.append(extra)
    return "runs" + "".join(f", with {extra}" for extra in added)


def main(tag=None):
    began = time.monotonic()
    if tag is not None:
        text = notes(version())
        if tag != f"v{version()}" or text is None:
            raise Failed(f"tag: got {tag}; rlcore is {version()}, and CHANGELOG.md must have a dated entry for it")
        NOTES.parent.mkdir(exist_ok=True)
        NOTES.write_text(
            f"{text}\nTo cite: {citation()} SHA256SUMS has the checksums of all files.\n", encoding="utf-8"
        )
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        wheel = build(work)
        python, install = environment(work / "empty")
        install(wheel)
        listed = run(python, "-m", "pip", "list", "--format=freeze", cwd=work).stdout
        if more := set(re.findall(r"^([\w-]+)==", listed, re.M)) - BASE:
            raise Failed(f"comes with rlcore and should not: {', '.join(sorted(more))}")
        if wrong := unexpected(run(python, "-c", IMPORTS, cwd=work).stdout):
            raise Failed("with NumPy and SciPy alone: " + "; ".join(wrong))
        print(f"installed alone: every module imports but {', '.join(NEEDS)}, which name their extra", flush=True)
        run(python, "-m", "pip", "install", "--quiet", "--dry-run", f"{wheel}[all]", cwd=work)
        print("rlcore[all]: its packages go together", flush=True)
        count = 4
        for name, source in examples((ROOT / "README.md").read_text(encoding="utf-8")):
            print(f"README.md, {name}: {try_example(python, install, name, source, work)}", flush=True)
            count += 1
    print(f"{count} passed in {time.monotonic() - began:.0f}s")


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Failed as error:
        sys.exit(f"FAILED {error}")
