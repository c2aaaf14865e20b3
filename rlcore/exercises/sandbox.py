"""Running a learner's function so that an endless loop or a huge allocation harms nobody."""

from __future__ import annotations

import builtins
import ctypes
import io
import numbers
import os
import pickle
import select
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np

from rlcore.exercises.compare import Opaque, kind
from rlcore.mdp import FiniteMDP

MEMORY = 2 << 30  # bytes that an answer may allocate on top of what the notebook holds
LARGEST = 64 << 20  # bytes of a result
PRINTED = 20_000  # characters that are shown of what an answer prints
PATIENCE = 5  # on a busy machine, or asleep, an answer takes longer by the clock than it computes: so many times
PROCESSES = (
    "os.fork",
    "os.forkpty",
    "os.exec",
    "os.posix_spawn",
    "os.spawn",
    "os.system",
    "subprocess.Popen",
    "os.kill",
)


class Crash(Exception):
    """The answer raised, or was stopped; the message says which, with the learner's own traceback."""


class TooLarge(Exception):
    """A result of more than LARGEST bytes."""


class TimeIsUp(BaseException):
    """Raised inside an answer that runs too long, where there is no process of its own to end."""


def run_guarded(function: Callable[[], Any], seconds: float) -> Any:
    """function() with at most `seconds` of computing and MEMORY bytes; raises Crash where it raises or is stopped.

    The clock may show PATIENCE times as much. On systems that fork, function runs in a child process, which is ended
    when the time is up. Elsewhere (Windows) it runs in a thread that gets an exception when the time is up; memory is
    not limited there. In a browser, which has neither, it runs in place, and the clock is looked at in between. The
    result comes back as numbers, text, arrays, tuples, lists, dicts and processes; anything else as an Opaque. What it
    prints and draws appears as if it had run here, also where it fails.
    """
    run = _in_place if sys.platform == "emscripten" else _in_child if hasattr(os, "fork") else _in_thread
    status, value, printed, figures = run(function, seconds)
    if printed:
        print(printed, end="" if printed.endswith("\n") else "\n")
    _display(figures)
    if status == "crash":
        raise Crash(value)
    return value


# ---------------------------------------------------------------------- results that run no code


def plain(value: Any) -> Any:
    """value made of plain data only, so that whoever compares it runs no code of the answer's."""
    try:
        return _plain(value)
    except RecursionError:
        return Opaque("a list without end: it contains itself, or thousands of others")


def _plain(value):
    if value is None or value is ... or type(value) in (bool, int, float, complex, str, Fraction, Decimal, FiniteMDP):
        return value
    if isinstance(value, np.ma.MaskedArray) and np.ma.getmaskarray(value).any():
        return Opaque("a masked array with masked entries")
    if isinstance(value, np.ndarray):
        if value.nbytes > LARGEST:
            raise TooLarge
        value = np.asarray(value)
        if value.dtype.kind != "O":
            return value
        copy = np.empty(value.shape, object)
        copy.ravel()[:] = [_plain(v) for v in value.ravel()]
        return copy
    if isinstance(value, np.generic):
        return np.asarray(value)[()]
    if type(value).__module__.partition(".")[0] == "torch" and hasattr(value, "detach"):
        return value.detach().cpu().numpy()
    for base in (tuple, list):
        if isinstance(value, base):
            return base(map(_plain, value))
    if isinstance(value, dict):
        return {_plain(k): _plain(v) for k, v in value.items()}
    if isinstance(value, str):
        return str(value)
    if isinstance(value, numbers.Real):
        return float(value)
    return Opaque(kind(value))


class _Unpickler(pickle.Unpickler):
    def find_class(self, module, name):
        ours = {("rlcore.mdp", "FiniteMDP"): FiniteMDP, ("rlcore.exercises.compare", "Opaque"): Opaque}
        ours |= {("fractions", "Fraction"): Fraction, ("decimal", "Decimal"): Decimal, ("builtins", "complex"): complex}
        if (module, name) in ours:
            return ours[module, name]
        if (module, name) == ("builtins", "Ellipsis"):
            return ...
        if module.startswith("numpy") and name in ("_reconstruct", "_frombuffer", "ndarray", "dtype", "scalar"):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name}")


def pack(status: str, value: Any, figures: list) -> bytes:
    """The outcome as bytes, at most LARGEST of them."""
    try:
        data = pickle.dumps((status, plain(value), figures))
    except (MemoryError, TooLarge):
        data = None
    except Exception as error:
        return pickle.dumps(("crash", f"the result cannot be read: {_own_traceback(error)}", figures))
    if data is None or len(data) > LARGEST:
        return pickle.dumps(("crash", _too_large(), []))
    return data


def unpack(data: bytes) -> tuple[str, Any, list]:
    """(status, value, figures), made without running any code that the bytes name."""
    try:
        return _Unpickler(io.BytesIO(data)).load()
    except Exception:
        return "crash", "the result that came back cannot be read", []


# ---------------------------------------------------------------------- one call


def _attempt(function):
    """(status, value) of one call."""
    try:
        return "done", function()
    except MemoryError:
        return "crash", f"needs more than {MEMORY >> 30} GiB of memory: is an array far too large?"
    except TooLarge:
        return "crash", _too_large()
    except TimeIsUp:
        return "crash", None
    except BaseException as error:
        return "crash", _own_traceback(error)


class _Printed(io.TextIOBase):
    """The first PRINTED characters, in a file that outlives the process."""

    def __init__(self, file):
        self.file, self.left = file, PRINTED

    def write(self, text):
        part = text[: self.left]
        self.left -= len(part)
        if part:
            self.file.write(part.encode("utf-8", "backslashreplace"))
            self.file.flush()
        return len(text)


def _printed(file):
    file.seek(0)
    return file.read().decode("utf-8", "replace")


def _own_traceback(error):
    """The traceback from the learner's first line on."""
    here = os.path.dirname(__file__)
    trace = error.__traceback__
    while trace and trace.tb_next and os.path.dirname(trace.tb_frame.f_code.co_filename) == here:
        trace = trace.tb_next
    try:
        if trace and os.path.dirname(trace.tb_frame.f_code.co_filename) == here:  # wrong signature: no line of theirs
            return f"{type(error).__name__}: {error}"
        return "".join(traceback.format_exception(type(error), error, trace)).strip()
    except Exception:  # an error whose text raises
        return type(error).__name__


def _new_figures(before):
    """PNGs of the figures that the answer has drawn and left open, five at most."""
    plt = sys.modules.get("matplotlib.pyplot")
    pictures = []
    for number in sorted(set(plt.get_fignums()) - before)[:5] if plt else ():
        file = io.BytesIO()
        plt.figure(number).savefig(file, format="png")
        pictures.append(file.getvalue())
    return pictures


def _open_figures():
    plt = sys.modules.get("matplotlib.pyplot")
    return set(plt.get_fignums()) if plt else set()


def _display(figures):
    if figures and "IPython" in sys.modules:
        from IPython.display import Image, display

        for png in figures:
            display(Image(png))


# ---------------------------------------------------------------------- in a process of its own


def _in_child(function, seconds):
    read, write = os.pipe()
    sys.stdout.flush()
    with tempfile.TemporaryFile() as file:
        child = os.fork()
        if child == 0:
            try:
                os.close(read)
                _child(function, seconds, write, file)
            finally:
                os._exit(0)
        os.close(write)
        data, status = None, None
        try:
            data = _read(read, time.monotonic() + PATIENCE * seconds)
            status = _end(child, patient=data == b"")
        finally:
            os.close(read)
            if status is None:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
        return _outcome(data, status, seconds, _printed(file))


def _child(function, seconds, write, file):
    _limit(seconds)
    before = _open_figures()
    out = _Printed(file)
    with redirect_stdout(out), redirect_stderr(out):
        status, value = _attempt(function)
        try:
            figures = _new_figures(before)
        except Exception:  # a picture that cannot be drawn is no reason to fail
            figures = []
        data = pack(status, value, figures)
    data = len(data).to_bytes(8, "big") + data
    while data:
        data = data[os.write(write, data) :]


def _limit(seconds):
    """Limits of time and memory, no further processes, no waiting for the keyboard, figures for later."""
    os.setsid()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    sys.addaudithook(_no_processes)
    builtins.input = _no_input
    if plt := sys.modules.get("matplotlib.pyplot"):
        plt.show = lambda *_, **__: None
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 2, int(seconds) + 3))  # no answer can take it back
        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    except (ImportError, OSError, ValueError):  # macOS: the time limit alone guards
        pass


def _no_processes(event, arguments):
    if event in PROCESSES:
        raise RuntimeError(f"an answer must not start or end processes ({event})")


def _no_input(*_):
    raise RuntimeError("input() waits for the keyboard, and a check has none: take what is needed as arguments")


def _read(pipe, deadline):
    """The message, whole; b"" where the pipe ended before, None where the time did."""
    data, size = b"", None
    parts, length = [], 0
    while (left := deadline - time.monotonic()) > 0:
        if not select.select([pipe], [], [], left)[0]:
            continue
        part = os.read(pipe, 1 << 20)
        if not part:
            return b""
        parts.append(part)
        length += len(part)
        if size is None and length >= 8:
            data = b"".join(parts)
            size = int.from_bytes(data[:8], "big")
        if size is not None and length >= 8 + size:
            return b"".join(parts)[8 : 8 + size]
        if length > LARGEST + 1024:
            return b""
    return None


def _end(child, patient):
    """The exit status of the child, which is killed unless it ends within a second by itself; then -1."""
    for _ in range(100 if patient else 0):
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return status
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1


def _outcome(data, status, seconds, printed):
    if data:
        return *unpack(data)[:2], printed, unpack(data)[2]
    if data is None:
        reason = _too_long(PATIENCE * seconds)
    elif status == -1:
        reason = "your answer has closed the way by which its result comes back, and was ended"
    elif os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGPROF, signal.SIGXCPU):
        reason = _too_slow(seconds)
    else:
        how = f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else "an exit"
        reason = f"the process that ran your answer ended with {how}; did it need too much memory?"
    return "crash", reason, printed, []


def _too_large():
    return f"the result takes more than {LARGEST >> 20} MiB: is it far too large?"


def _too_slow(seconds):
    return f"stopped after {seconds:g} s of computing: is there a loop that never ends?"


def _too_long(seconds):
    return f"stopped after {seconds:g} s by the clock: it waits for something, or never ends"


# ---------------------------------------------------------------------- in a thread


def _in_thread(function, seconds):
    outcome, file = [], io.BytesIO()
    thread = threading.Thread(target=lambda: outcome.append(pack(*_attempt(function), [])), daemon=True)
    computed, clock, out = time.process_time(), time.monotonic(), _Printed(file)
    with redirect_stdout(out), redirect_stderr(out):  # for all threads, and no longer than it is waited for
        thread.start()
        while thread.is_alive():
            thread.join(0.05)
            if time.process_time() - computed < seconds and time.monotonic() - clock < PATIENCE * seconds:
                continue
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident), ctypes.py_object(TimeIsUp))
            thread.join(1.0)
            slow = time.process_time() - computed >= seconds
            return "crash", _too_slow(seconds) if slow else _too_long(PATIENCE * seconds), _printed(file), []
    status, value, _ = unpack(outcome[0])
    return status, value, _printed(file), []


# ---------------------------------------------------------------------- in a browser: neither processes nor threads


def _in_place(function, seconds):
    """A look at the clock wherever Python code calls or jumps back; one long call into C is not interrupted."""
    watch, file, end = sys.monitoring, io.BytesIO(), time.monotonic() + seconds
    events = watch.events.PY_START, watch.events.JUMP, watch.events.PY_RESUME

    def look(*_):
        nonlocal end
        if time.monotonic() > end:
            end += 0.05  # an answer that catches the exception soon gets another
            raise TimeIsUp

    outcome, out = ("crash", None), _Printed(file)
    watch.use_tool_id(watch.PROFILER_ID, "rlcore")
    try:
        for event in events:
            watch.register_callback(watch.PROFILER_ID, event, look)
        watch.set_events(watch.PROFILER_ID, sum(events))
        with redirect_stdout(out), redirect_stderr(out):
            outcome = _attempt(function)
    except TimeIsUp:
        pass  # between the end of the answer and here
    finally:
        watch.set_events(watch.PROFILER_ID, 0)
        watch.free_tool_id(watch.PROFILER_ID)
    if outcome == ("crash", None):
        return "crash", _too_slow(seconds), _printed(file), []
    return *unpack(pack(*outcome, []))[:2], _printed(file), []
