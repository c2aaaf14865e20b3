"""Running a learner's function so that an endless loop or a huge allocation harms nobody."""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import select
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from typing import Any

MEMORY = 2 << 30  # bytes that an answer may allocate on top of what the notebook holds
PATIENCE = 5  # on a busy machine, or asleep, an answer takes longer by the clock than it computes: so many times


class Crash(Exception):
    """The answer raised, or was stopped; the message says which, with the learner's own traceback."""


class TimeIsUp(BaseException):
    """Raised inside an answer that runs too long, where there is no process of its own to end."""


def run_guarded(function: Callable[[], Any], seconds: float) -> Any:
    """function() with at most `seconds` of computing and MEMORY bytes; raises Crash where it raises or is stopped.

    The clock may show PATIENCE times as much. On systems that fork, function runs in a child process, which is ended
    when the time is up. Elsewhere (Windows) it runs in a thread that gets an exception when the time is up; memory is
    not limited there.
    What it prints appears as if it had run here.
    """
    outcome = _in_child(function, seconds) if hasattr(os, "fork") else _in_thread(function, seconds)
    status, value, printed = outcome
    if printed:
        print(printed, end="" if printed.endswith("\n") else "\n")
    if status == "crash":
        raise Crash(value)
    return value


def _too_slow(seconds):
    return f"stopped after {seconds:g} s: is there a loop that never ends?"


def _attempt(function):
    """(status, value, printed) of one call."""
    out = io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(out):
            value = function()
        return "done", value, out.getvalue()[:20_000]
    except MemoryError:
        return (
            "crash",
            f"needs more than {MEMORY >> 30} GiB of memory: is an array far too large?",
            out.getvalue()[:20_000],
        )
    except TimeIsUp:
        return "crash", None, out.getvalue()[:20_000]
    except BaseException as error:
        return "crash", _own_traceback(error), out.getvalue()[:20_000]


def _own_traceback(error):
    """The traceback from the learner's first line on."""
    here = os.path.dirname(__file__)
    trace = error.__traceback__
    while trace and trace.tb_next and os.path.dirname(trace.tb_frame.f_code.co_filename) == here:
        trace = trace.tb_next
    if (
        trace and os.path.dirname(trace.tb_frame.f_code.co_filename) == here
    ):  # wrong signature: no line of the learner's
        return f"{type(error).__name__}: {error}"
    return "".join(traceback.format_exception(type(error), error, trace)).strip()


def _in_child(function, seconds):
    read, write = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(read)
        try:
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_PROF, seconds)
            _limit_memory()
            outcome = _attempt(function)
            try:
                data = pickle.dumps(outcome)
            except Exception:
                kind = type(outcome[1]).__name__
                data = pickle.dumps(("crash", f"the result cannot be compared: {kind}", outcome[2]))
            with os.fdopen(write, "wb") as pipe:
                pipe.write(data)
        finally:
            os._exit(0)
    os.close(write)
    data = None
    try:
        data = _read(read, time.monotonic() + PATIENCE * seconds)
    finally:
        os.close(read)
        if data is None:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    if data is None:
        return "crash", _too_slow(PATIENCE * seconds), ""
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGPROF:
        return "crash", _too_slow(seconds), ""
    if not data:
        reason = f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else "an exit"
        return "crash", f"the process that ran your answer ended with {reason}; did it need too much memory?", ""
    return pickle.loads(data)


def _read(pipe, deadline):
    parts = []
    while (left := deadline - time.monotonic()) > 0:
        if select.select([pipe], [], [], left)[0]:
            part = os.read(pipe, 1 << 20)
            if not part:
                return b"".join(parts)
            parts.append(part)
    return None


def _limit_memory():
    try:
        import resource

        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    except (ImportError, OSError, ValueError):  # macOS: the time limit alone guards
        pass


def _in_thread(function, seconds):
    outcome = []
    thread = threading.Thread(target=lambda: outcome.append(_attempt(function)), daemon=True)
    computed, clock = time.process_time(), time.monotonic()
    thread.start()
    while thread.is_alive():
        thread.join(0.05)
        if time.process_time() - computed < seconds and time.monotonic() - clock < PATIENCE * seconds:
            continue
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident), ctypes.py_object(TimeIsUp))
        thread.join(1.0)
        return "crash", _too_slow(seconds), ""
    return outcome[0]
