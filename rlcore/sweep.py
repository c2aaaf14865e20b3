"""Many runs, settings x seeds, on this machine or on a cluster; a sweep that was stopped goes on where it was."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import platform
import re
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, ProcessPoolExecutor, as_completed, wait
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from typing import Any

import numpy as np

from rlcore.core.checks import check_count, check_flag, show
from rlcore.core.files import whole
from rlcore.core.rules import checked, instance
from rlcore.core.types import File

ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
PACKAGES = ("numpy", "numba", "gymnasium", "torch")


@dataclass(frozen=True)
class Record:
    """One run of a sweep.

    result: what the function returned, as JSON data; None where it failed. seconds: wall time in the worker. error: the
    traceback where it failed, else None. versions: of Python and of the packages that were loaded where it ran. A
    worker that died leaves neither seconds nor versions.
    """

    function: str
    setting: dict
    seed: int
    result: object
    seconds: float | None
    error: str | None
    versions: dict


# ---------------------------------------------------------------------- what may be asked


def _plain(name, value):
    """value as JSON data; ValueError where it is not."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(name, item) for item in value]
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: _plain(name, item) for key, item in value.items()}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise ValueError(f"{name}: got {value!r}, must be numbers, strings, lists, and dicts with strings as keys")


def _function(name, function, given):
    home = sys.modules.get(getattr(function, "__module__", None))
    place = getattr(function, "__qualname__", None)
    if not isinstance(place, str) or getattr(home, place, None) is not function or not hasattr(home, "__file__"):
        raise ValueError(f"{name}: got {function!r}, must be at the top level of a module, for workers to import")
    return function


def _settings(name, settings, given):
    if not isinstance(settings, list | tuple) or not settings:
        raise ValueError(f"{name}: got {show(settings)}, must be a list of at least one dict")
    seen = []
    for i, setting in enumerate(settings):
        if not isinstance(setting, dict) or "rng" in setting:
            raise ValueError(f"{name}[{i}]: got {setting!r}, must be a dict of keyword arguments, without rng")
        try:
            inspect.signature(given["function"]).bind(**_plain(f"{name}[{i}]", setting), rng=None)
        except TypeError as error:
            raise ValueError(f"{name}[{i}]: got {setting!r}, must be what the function takes: {error}") from None
        digest = _digest(_plain(name, setting))
        if digest in seen:
            raise ValueError(f"{name}[{i}]: got {setting!r}, must differ from {name}[{seen.index(digest)}]")
        seen.append(digest)
    return [_plain(name, setting) for setting in settings]


def _seeds(name, seeds, given):
    if isinstance(seeds, (str, bytes)) or not hasattr(seeds, "__iter__"):
        raise ValueError(f"{name}: got {show(seeds)}, must be whole numbers")
    seeds = [check_count(name, seed, 0) for seed in seeds]
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"{name}: got {seeds}, must be at least one, each once")
    return seeds


def _store(name, store, given):
    try:
        return Path(store)
    except TypeError:
        raise ValueError(f"{name}: got {show(store)}, must be a folder, or where one can be made") from None


EXECUTOR = instance(Executor, "a concurrent.futures.Executor; Dask's: get_executor()")


# ---------------------------------------------------------------------- the sweep


@checked(function=_function, settings=_settings, seeds=_seeds, store=_store, executor=EXECUTOR, progress=check_flag)
def sweep(
    function: Callable[..., Any], settings: Sequence[dict[str, Any]], seeds: Iterable[int], store: File,
    executor: Executor | None = None, *, progress: bool | None = None,
) -> list[Record]:  # fmt: skip
    """Many runs: function(**setting, rng=default_rng(seed)) for each setting and each seed, on many processes.

    A run that fails leaves its traceback, and the others go on. Warns of failed runs, and of files in the store that
    are not whole records: they do not count.

    Parameters
    ----------
    function : Callable[..., Any]
        At the top level of a module, or of a script with `if __name__ == "__main__":`, so that workers can import it.
        The rng depends on the seed alone: every setting meets the same randomness, and a run can be repeated by hand.
    settings : Sequence[dict[str, Any]]
        List of dicts of keyword arguments. Settings and results are JSON data; NumPy's numbers and arrays become
        Python's, tuples lists.
    seeds : Iterable[int]
        Whole numbers, at least 0.
    store : File
        Folder, one file for each run that has ended. Those runs are not repeated, unless they failed. The store knows
        functions by name: after a change of code take a new one; and one sweep at a time.
    executor : Executor | None
        Any concurrent.futures.Executor, such as Dask's `client.get_executor()`; by default a process of one thread for
        each core.
    progress : bool | None
        A line on stderr; by default where that is a terminal.

    Returns
    -------
    list[Record]
        One for each setting and each seed; seeds vary faster.

    Raises
    ------
    ValueError
        For bad input, before any run.
    """
    name, store = function.__qualname__, _made(store)
    runs = {_file_name(name, setting, seed): (setting, seed) for setting in settings for seed in seeds}
    records = {file: record for file, record in _read(store).items() if record.error is None}
    left = {file: run for file, run in runs.items() if file not in records}
    report = _reporter(len(left), sys.stderr.isatty() if progress is None else progress)

    def keep(file, future):
        records[file] = Record(name, *runs[file], **_outcome(future))
        _write(store / file, records[file])
        report(records[file])

    if left:
        _on_processes(function, left, keep) if executor is None else _on_executor(executor, function, left, keep)
    errors = [records[file].error for file in runs if records[file].error]
    if errors:
        last = errors[0].splitlines()[-1]
        warnings.warn(f"{len(errors)} of {len(runs)} runs failed, the next call repeats them: {last}", stacklevel=3)
    return [records[file] for file in runs]


# ---------------------------------------------------------------------- running


def _run(function, setting, seed):
    """In a worker: what a Record holds beside the question."""
    start, result, error = time.perf_counter(), None, None
    try:
        result = _plain("result", function(**setting, rng=np.random.default_rng(seed)))
    except (Exception, SystemExit):
        error = traceback.format_exc()
    versions = {name: sys.modules[name].__version__ for name in PACKAGES if name in sys.modules}
    versions["python"] = platform.python_version()
    return dict(result=result, seconds=time.perf_counter() - start, error=error, versions=versions)


def _outcome(future):
    if future.exception() is None:
        return future.result()
    error = "".join(traceback.format_exception(future.exception()))
    return dict(result=None, seconds=None, error=error, versions={})


def _on_executor(executor, function, left, keep):
    futures = {}
    try:
        for file, run in left.items():
            futures[executor.submit(_run, function, *run)] = file
        for future in as_completed(futures):
            if isinstance(future.exception(), BrokenExecutor):
                raise future.exception()
            keep(futures[future], future)
            del futures[future]
    finally:
        _keep_finished(futures, keep)


def _on_processes(function, left, keep):
    """A pool of one process for each core: where a worker dies, its own run fails and no other."""
    todo, futures, pool_of, before = list(left.items())[::-1], {}, {}, set(active_children())
    with ExitStack() as pools, _environment(ONE_THREAD):
        idle = [pools.enter_context(_pool()) for _ in range(min(_cores(), len(todo)))]
        try:
            while todo or futures:
                while todo and idle:
                    (file, run), pool = todo.pop(), idle.pop()
                    future = pool.submit(_run, function, *run)
                    futures[future], pool_of[future] = file, pool
                for future in wait(futures, return_when=FIRST_COMPLETED).done:
                    keep(futures[future], future)
                    del futures[future]
                    died, pool = isinstance(future.exception(), BrokenExecutor), pool_of.pop(future)
                    idle.append(pools.enter_context(_pool()) if died else pool)
        finally:
            _keep_finished(futures, keep)
            for process in set(active_children()) - before:
                process.terminate()


def _keep_finished(futures, keep):
    """After an interrupt: what has ended is kept, the rest called off."""
    for future, file in futures.items():
        if not future.cancel() and future.done() and future.exception() is None:
            keep(file, future)


def _pool():
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_start_worker)


def _start_worker():
    """Interrupts are the parent's business; a worker without a parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=lambda: (parent_process().join(), os._exit(1)), daemon=True).start()


def _cores():
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


@contextmanager
def _environment(values):
    """For the processes started inside: libraries read these variables when they load."""
    before = {name: os.environ[name] for name in values if name in os.environ}
    os.environ.update(values)
    try:
        yield
    finally:
        for name in values:
            del os.environ[name]
        os.environ.update(before)


def _reporter(n, shown):
    """A function to call after each of n runs."""
    start, failed = time.monotonic(), []

    def report(record):
        failed.append(record.error is not None)
        minutes = (time.monotonic() - start) / len(failed) * (n - len(failed)) / 60
        line = f"{len(failed)} of {n} runs, {sum(failed)} failed, {minutes:.1f} min left"
        end = "\r" if sys.stderr.isatty() and len(failed) < n else "\n"
        print(f"{line:<60}", end=end, file=sys.stderr)

    return report if shown else lambda record: None


# ---------------------------------------------------------------------- the store


def _file_name(function, setting, seed):
    """Readable, and different for different runs."""
    words = [function, *(f"{key}={setting[key]}" for key in sorted(setting))]
    readable = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", "_".join(words))[:120]
    return f"{readable}_seed={seed}_{_digest([function, setting, seed])[:12]}.json"


def _made(store):
    """The folder, made where there is none."""
    try:
        store.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError):
        raise ValueError(f"store: got {show(str(store))}, must be a folder, or where one can be made") from None
    return store


def _digest(data):
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()


def _write(path, record):
    with whole(path) as out:
        json.dump({"run": asdict(record), "sha256": _digest(asdict(record))}, out)


def _read(store):
    """{file name: Record} of the whole records; a warning for everything else."""
    records = {}
    for path in sorted(store.iterdir()):
        try:
            data = json.loads(path.read_text())
            record = Record(**data["run"])
            name = _file_name(record.function, record.setting, record.seed)
            if data["sha256"] != _digest(data["run"]) or path.name != name:
                raise ValueError
        except (OSError, ValueError, TypeError, KeyError):
            warnings.warn(f"{path}: not a whole record of a run, it does not count", stacklevel=4)
        else:
            records[path.name] = record
    return records
