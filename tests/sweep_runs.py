"""Functions for the tests of sweeps, at the top level of a module so that workers can import them.

python tests/sweep_runs.py STORE LOG    a sweep to be killed: six quick runs, then two of an hour
"""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

FRESH = True  # unless somebody changed it, in a process that then forked


def draw(x, rng):
    if x == "bad":
        raise KeyError("no such number")
    if x == "exit":
        sys.exit("left")
    if x == "odd":
        return {1, 2}
    return {"x": np.float32(x), "u": rng.random(2), "pair": (1, None), "flag": np.bool_(True)}


def wait_for(condition):
    end = time.monotonic() + 300
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def logged(x, log, rng, seconds=0.0, kill=False, until=None):
    """Leaves a line with its process each time that it starts; until = (folder, n): ends once n records lie there."""
    with open(Path(log) / str(x), "a") as out:
        out.write(f"{os.getpid()}\n")
    time.sleep(seconds)
    if until:
        wait_for(lambda: len(list(Path(until[0]).glob("*.json"))) >= until[1])
    if kill:
        os.kill(os.getpid(), signal.SIGKILL)
    ignored = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    return {
        "x": x, "process": os.getpid(), "threads": os.environ.get("OMP_NUM_THREADS"), "fresh": FRESH,
        "interrupts": not ignored,
    }  # fmt: skip


def starts(log, x):
    """The processes that started the run, in order."""
    path = Path(log) / str(x)
    return [int(line) for line in path.read_text().splitlines()] if path.exists() else []


if __name__ == "__main__":
    from rlcore.sweep import sweep

    store, log = sys.argv[1:]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore interrupts
    settings = [dict(x=x, log=log, seconds=0.02 if x < 6 else 3600.0) for x in range(8)]
    sweep(logged, settings, [0], store)
