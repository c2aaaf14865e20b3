"""How long each live cell takes, in plain Python, and whether it prints what the page shows, in any order of clicks.

python tests/live.py [PAGE ...]      writes book/_live/seconds.json; an hour for the whole book, a page at a time
"""

import json
import os
import random
import signal
import sys
import time
from pathlib import Path

os.environ |= {"RLCORE_NO_NUMBA": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
ROOT = Path(__file__).parents[1]
LIVE = ROOT / "book" / "_live"
SECONDS = LIVE / "seconds.json"
SLOWER = 2.5  # a browser's Python against this one
LONGEST = 60  # seconds in a browser
sys.path.insert(0, str(LIVE))


class TooLong(BaseException):
    pass


def late(*_):
    raise TooLong


def cells(path):
    """(source, text that it printed) of each code cell."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [
        ("".join(c["source"]), "".join("".join(o.get("text", "")) for o in c["outputs"]))
        for c in notebook["cells"]
        if c["cell_type"] == "code"
    ]


def measure(path):
    """Own seconds of each cell of a notebook, in order; None where it, or what it builds on, takes too long."""
    from needs import analyse
    from shell import Shell

    sources, stored = zip(*cells(path), strict=True)
    needs, _ = analyse(sources)
    printed, seconds = [], {}
    shell = Shell(lambda output: printed.append(json.loads(output)))
    signal.signal(signal.SIGPROF, late)

    def run(n):
        printed.clear()
        well = shell.run(sources, n)
        text = "".join(o["text"] for o in printed if o["type"] == "stream")
        errors = [o["text"] for o in printed if o["type"] == "error"]
        return well, text, errors

    for n in range(len(sources)):
        if any(seconds[i] is None for i in needs[n]):
            seconds[n] = None
            continue
        signal.setitimer(signal.ITIMER_PROF, LONGEST / SLOWER)
        start = time.process_time()
        try:
            well, text, errors = run(n)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        seconds[n] = (time.process_time() - start) * SLOWER
        if errors and "TooLong" in errors[0]:
            seconds[n] = None
        elif errors:
            print(f"  {path.name}, cell {n + 1}: {errors[0].strip().splitlines()[-1]}")
        elif text != stored[n]:
            print(f"  {path.name}, cell {n + 1}: printed\n{text}\ninstead of\n{stored[n]}")
    total = {n: None if seconds[n] is None else seconds[n] + sum(seconds[i] for i in needs[n]) for n in seconds}
    return sources, stored, seconds, total


if __name__ == "__main__":
    paths = [Path(name).resolve() for name in sys.argv[1:]] or [*ROOT.glob("book/0*.ipynb"), *ROOT.glob("book/exercises/*.ipynb")]
    os.chdir(ROOT / "book")
    for path in sorted(paths):
        start = time.process_time()
        sources, stored, seconds, total = measure(path)
        slow = sum(value is None for value in seconds.values())
        print(f"{path.name}: {len(sources)} cells, {slow} too slow, {time.process_time() - start:.0f} s", flush=True)
        print({n + 1: None if v is None else round(v, 1) for n, v in seconds.items() if v is None or v > 3}, flush=True)
