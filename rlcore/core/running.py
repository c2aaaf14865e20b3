"""A run while it goes on: Ctrl-C is heard, a bar shows how far it is, and what was learned so far is not lost."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from functools import cache, wraps
from select import select
from typing import Any

import numpy as np

from rlcore.core.types import F, Ints, OnEpisode

STOPPED, LOST, ENOUGH = 1, 2, 3  # why a run ends: by Ctrl-C; estimates that are no numbers; by on_episode
CUT = 2  # in place of the marks of terminal states in a Sampler: the episode is to end here
PATIENCE = 2.0  # seconds before a bar is shown
PAUSE = 0.5  # seconds between two looks at how far a run is


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or a notebook's stop button: what was learned so far is its `run`.

    Parameters
    ----------
    run : Any
        A Run whose `interrupted` is True; of planning a Solution that has not converged; of `evaluate` an Evaluation of
        the episodes that ended.
    """

    def __init__(self, run: Any) -> None:
        super().__init__("what was learned so far is in the `run` of this exception, sys.last_value.run")
        self.run = run


class Watch:
    """What a run and those who watch it tell each other, and the bar that shows how far it is.

    marks: (2,) why it is to end, 0 while it goes on, and how many episodes have ended. terminal: (S,) the marks that a
    compiled loop looks at in each step; empty where there are none. The bar, of n episodes or steps, is shown on
    stderr after two seconds where that is a terminal, or with RLCORE_NOTES=1.
    """

    def __init__(self, n: int = 0, unit: str = "episodes") -> None:
        self.marks, self.terminal, self.asked = np.zeros(2, np.int64), np.zeros(0, np.uint8), False
        self.n, self.unit, self.start, self.bar, self.lock = n, unit, time.monotonic(), None, threading.Lock()
        looked_at = sys.stderr is not None and (sys.stderr.isatty() or os.environ.get("RLCORE_NOTES") == "1")
        self.wanted = n > 0 and looked_at

    def stop(self, why: int = STOPPED) -> None:
        """Ask the run to end, unless it has been asked."""
        if not self.marks[0]:
            self.marks[0], self.terminal[:], self.asked = why, CUT, True

    def ended(self, returns: list[float], lengths: list[int], on_episode: OnEpisode | None) -> bool:
        """Count an episode, tell on_episode of it, and say whether it was the last."""
        self.marks[1] = len(returns)
        if on_episode is not None and on_episode(float(returns[-1]), sum(lengths)):
            self.stop(ENOUGH)
        return bool(self.marks[0])

    def left(self, run: Any) -> Any:
        """The Run, or an Interrupted with it where Ctrl-C came."""
        if self.marks[0] == STOPPED:
            raise Interrupted(replace(run, interrupted=True))
        return run

    def show(self, done: int | None = None) -> None:
        """Show how many are done, marks[1] where None."""
        if not self.wanted or time.monotonic() - self.start < PATIENCE:
            return
        with self.lock:
            if self.bar is None and self.wanted:
                self.wanted = importlib.util.find_spec("tqdm") is not None
                if self.wanted:
                    from tqdm import tqdm

                    self.bar = tqdm(total=self.n, unit=f" {self.unit}", file=sys.stderr, leave=False)
            if self.bar is not None:
                self.bar.n = min(int(self.marks[1]) if done is None else done, self.n)
                self.bar.refresh()

    def close(self) -> None:
        """Take the bar away."""
        with self.lock:
            self.wanted = False
            if self.bar is not None:
                self.bar.close()


_now: ContextVar[Watch | None] = ContextVar("watch", default=None)


def interruptible(function: F) -> F:
    """The function; after Ctrl-C its loop, which looks at marks(), ends, and what it returns is on an Interrupted."""

    @wraps(function)
    def call(*args, **kwargs):
        watch = Watch()
        before = _now.set(watch)
        try:
            with watched(watch):
                found = function(*args, **kwargs)
        finally:
            _now.reset(before)
        if watch.marks[0] == STOPPED:
            raise Interrupted(found)
        return found

    return call  # type: ignore[return-value]


def marks() -> Ints:
    """Those of the Watch of the function that runs and is interruptible; the first is 0 while it is to go on."""
    watch = _now.get()
    return np.zeros(2, np.int64) if watch is None else watch.marks


@contextmanager
def watched(watch: Watch) -> Iterator[None]:
    """A first Ctrl-C only asks the run inside to end, by its watch; a second one is a KeyboardInterrupt.

    Python's own handlers wait until compiled code returns. What Python's C code does at once is to write to a socket,
    which a thread listens to: compiled loops leave it the interpreter.
    """
    here = threading.current_thread() is threading.main_thread() and sys.platform != "emscripten"  # has no threads
    if not here or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        try:
            yield
        finally:
            watch.close()
        return
    ear, asked = _ear(os.getpid()), []

    def ask(signum, frame):
        ear.asked += 1
        if asked:
            raise KeyboardInterrupt
        asked.append(True)
        watch.stop()

    before, ear.watch = ear.watch, watch
    wakes = signal.set_wakeup_fd(ear.sends.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGINT, ask)
    if watch.wanted:
        ear.sends.send(b"\0")
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.set_wakeup_fd(wakes)
        while asked and ear.heard < ear.asked:  # or the next run would be stopped by what this one was told
            time.sleep(1e-3)
        ear.watch = before
        watch.close()


class _Ear(threading.Thread):
    """Listens to signals, and shows how far a run is; sleeps where there is none."""

    def __init__(self):
        super().__init__(name="rlcore", daemon=True)
        self.hears, self.sends = socket.socketpair()
        self.sends.setblocking(False)
        self.watch, self.heard, self.asked = None, 0, 0  # how often a signal came here, and to Python's handler

    def run(self):
        while True:
            ready = select([self.hears], [], [], self.watch and PAUSE)[0]
            heard = self.hears.recv(64).count(signal.SIGINT) if ready else 0
            if (watch := self.watch) is not None:
                if heard:
                    watch.stop()
                watch.show()
            self.heard = max(self.heard + heard, self.asked)


@cache
def _ear(process):
    """The one of this process, which a fork leaves without."""
    ear = _Ear()
    ear.start()
    return ear
