"""How long each live cell takes, and whether it prints what the page shows, in whatever order cells are clicked.

python tests/live_seconds.py [NOTEBOOK ...]  plain Python, as in a browser; an hour; writes book/_live/seconds.json
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
NOTEBOOKS = [*ROOT.glob("book/0*.ipynb"), *ROOT.glob("book/exercises/*.ipynb")]
SLOWER = 2.5  # a browser's Python against this one
LONGEST = 60  # seconds in a browser, of a cell and what it builds on
sys.path.insert(0, str(LIVE))
for missing in ("sklearn", "torch", "tqdm"):  # a browser has them not
    sys.modules[missing] = None


class TooLong(BaseException):
    pass


def too_long(*_):
    raise TooLong


def cells(path):
    """Source, and text that it printed, of each code cell."""
    parts = [c for c in json.loads(path.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    return ["".join(c["source"]) for c in parts], [
        "".join("".join(o.get("text", "")) for o in c["outputs"]) for c in parts
    ]


class Page:
    """The cells of a notebook in a shell of their own."""

    def __init__(self, path):
        from needs import analyse
        from shell import Shell

        self.printed = []
        self.shell = Shell(lambda output: self.printed.append(json.loads(output)))
        self.sources, self.stored = cells(path)
        self.needs, _ = analyse(self.sources)

    def run(self, n):
        """What is wrong with what cell n prints, or ""."""
        self.printed.clear()
        if not self.shell.run(self.sources, n):
            return self.printed[-1]["text"]
        text = "".join(o["text"] for o in self.printed if o["type"] == "stream")
        return "" if text == self.stored[n] else f"printed {text!r} instead of {self.stored[n]!r}"

    def time(self, n):
        signal.signal(signal.SIGPROF, too_long)
        signal.setitimer(signal.ITIMER_PROF, LONGEST / SLOWER)
        start = time.process_time()
        try:
            problem = self.run(n)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        out = "TooLong" in problem or "ModuleNotFoundError" in problem
        return None if out else time.process_time() - start, "" if out else problem

    def click(self, n):
        """Run a cell and what it builds on, as the page does."""
        return [problem for i in self.shell.plan(self.sources, n) if (problem := self.run(i))]


def measure(path):
    """Seconds in a browser of each cell with what it builds on, None where it is too long; and what is wrong."""
    page, own, problems = Page(path), {}, []
    for n in range(len(page.sources)):
        own[n], problem = (None, "") if any(own[i] is None for i in page.needs[n]) else page.time(n)
        problems += [f"cell {n + 1}: {problem}"] if problem else []
        own[n] = own[n] if n in page.shell.made else None  # it ended with an error
    total = {}
    for n in own:
        parts = [own[i] for i in [*page.needs[n], n]]
        total[n] = None if None in parts or SLOWER * sum(parts) > LONGEST else round(SLOWER * sum(parts))
    return page.sources, total, problems


def shuffle(path, quick, seed=0):
    """What goes wrong when the cells named are clicked in a random order, each twice."""
    page, order = Page(path), [*quick, *quick]
    random.Random(seed).shuffle(order)
    return [f"cell {n + 1}, clicked in another order: {problem}" for n in order for problem in page.click(n)]


def main(paths):
    from live import digest

    failed = False
    for path in sorted(paths):
        sources, total, problems = measure(path)
        problems += shuffle(path, [n for n, seconds in total.items() if seconds is not None and seconds < 10])
        known = json.loads(SECONDS.read_text())
        known |= {digest(sources[n]): seconds or 0 for n, seconds in total.items() if seconds is None or seconds >= 3}
        there = {digest(source) for notebook in NOTEBOOKS for source in cells(notebook)[0]}
        known = {key: seconds for key, seconds in known.items() if key in there}
        SECONDS.write_text(json.dumps(known, indent=0, sort_keys=True) + "\n")
        slow = sum(seconds is None for seconds in total.values())
        print(
            f"{path.name}: {len(total)} cells, {slow} too slow, {len(problems)} problems",
            *problems,
            sep="\n  ",
            flush=True,
        )
        failed |= bool(problems)
    return failed


if __name__ == "__main__":
    names = [Path(name).resolve() for name in sys.argv[1:]]
    os.chdir(ROOT / "book")
    sys.exit(main(names or NOTEBOOKS))
