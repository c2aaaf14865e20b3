"""Run groups of checks, a line for each with its count and its time, and at the end what failed, in one screen.

python tests/run.py lint unit html pages narrow      the output of each group is in _build/logs
"""

import os
import re
import resource
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOGS, HOME = ROOT / "_build" / "logs", ROOT / "_build" / "home"
BIN = Path(sys.executable).parent
COUNT = re.compile(r"^(?:=+ )?((?:\d+ [a-z]+(?:, )?)+) in [\d.]+s", re.M)
FAILED = re.compile(r"^(?:FAILED|ERROR) .*|^(?:[A-Z]\d+ .*|Would reformat: .*|.*(?:WARNING|ERROR): .*)$", re.M)


def pytest(*arguments):
    return [str(BIN / "pytest"), "-n", "2", "-rsfE", *arguments]


def nbval(names):
    folder = ROOT / "book"
    notebooks = [str(path.relative_to(ROOT)) for name in names for path in sorted(folder.glob(name))]
    options = ["--nbval", "--nbval-current-env", "--nbval-sanitize-with", "tests/nbval.cfg", "--dist", "loadfile"]
    return pytest(*options, *notebooks)


def threads(n):
    return dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), str(n))


# numpy's wide vector units off (its names for them), an old kernel for OpenBLAS, plain code from numba and torch
NARROW = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Nehalem",
    "ATEN_CPU_CAPABILITY": "default",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
}
ALL = ["*.ipynb", "record/*.ipynb", "exercises/*.ipynb"]
BLAS = ["0[68]_*.ipynb", "record/0[68]_*.ipynb"]  # networks: results that come out of products of larger matrices
LINT = [("ruff", "check", "."), ("ruff", "format", "--check", "."), ("mypy",)]
GROUPS = {  # name: (what it is, commands, environment)
    "lint": ("lint, format and types", [[str(BIN / command), *arguments] for command, *arguments in LINT], {}),
    "unit": ("unit tests", [pytest("-p", "no:nbval", "-m", "not pages and not built")], {}),
    "quick": ("unit tests but the long ones", [pytest("-p", "no:nbval", "-m", "not (pages or built or long)")], {}),
    "narrow": ("notebooks, one thread, no wide vector units", [nbval(ALL)], threads(1) | NARROW),
    "blas": ("notebooks of large matrices, two threads", [nbval(BLAS)], threads(2)),
    "single": ("notebooks, one thread", [nbval(ALL)], threads(1)),
    "double": ("notebooks, two threads", [nbval(ALL)], threads(2)),
    "html": ("the book is built", [[str(BIN / "jupyter-book"), "build", ".", "-W", "-n", "--keep-going"]], {}),
    "pages": ("built pages", [pytest("--dist", "loadgroup", "-m", "(pages or built) and not slow")], {}),
    "slow": ("built pages, the slower part", [pytest("--dist", "loadgroup", "-m", "pages and slow")], {}),
    "live": ("cells and exercises in the page", [pytest("--dist", "loadgroup", "tests/pages/test_live.py")], {}),
    "wheel": ("the package, installed alone", [[sys.executable, "tests/release.py"]], {}),
}


def cpu():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(name):
    """Whether a group passes, and its line."""
    title, commands, environment = GROUPS[name]
    start, before = time.time(), cpu()
    with open(LOGS / f"{name}.log", "w+", encoding="utf-8") as log:
        options = {"cwd": ROOT, "env": {**os.environ, **environment}, "stdout": log, "stderr": subprocess.STDOUT}
        codes = [subprocess.run(command, **options).returncode for command in commands]
        log.seek(0)
        text = log.read()
    counts = ", ".join(COUNT.findall(text)) or ("passed" if not any(codes) else "failed")
    print(f"{title}: {counts} ({time.time() - start:.0f} s, {cpu() - before:.0f} s of CPU)", flush=True)
    reasons = Counter()
    for number, reason in re.findall(r"^SKIPPED \[(\d+)\] \S+ (.*)$", text, re.M):
        reasons[reason] += int(number)
    for reason, number in reasons.items():
        print(f"  {number} skipped: {reason}", flush=True)
    return not any(codes), text


def main(names):
    if unknown := sorted(set(names) - set(GROUPS)):
        sys.exit(f"groups: got {', '.join(unknown)}; there are {', '.join(GROUPS)}")
    for folder in (LOGS, HOME):
        folder.mkdir(parents=True, exist_ok=True)
    os.environ["HOME"] = str(HOME)  # whatever lies in the caller's, or where there is none that can be written
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "MPLCONFIGDIR", "NUMBA_CACHE_DIR"):
        os.environ.pop(name, None)
    subprocess.run([sys.executable, "-c", "import matplotlib.font_manager"])  # says so where that takes it long
    failed = {}
    for name in names:
        fine, text = run(name)
        if not fine:
            failed[name] = FAILED.findall(text)[:10] or text.strip().splitlines()[-5:]
    for name, lines in failed.items():
        print(f"\n{GROUPS[name][0]} failed; all of it is in _build/logs/{name}.log")
        print("\n".join(line[:160] for line in lines))
    print(f"{len(names) - len(failed)} passed, {len(failed)} failed")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or list(GROUPS)))
