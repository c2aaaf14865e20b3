"""Many runs, settings x seeds, on this machine or on a cluster; a sweep that was stopped goes on where it was."""

import hashlib
import importlib.metadata
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
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, ProcessPoolExecutor, as_completed, wait
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path

import numpy as np

from rlcore.mdp import check_count

__all__ = ["Record", "sweep"]
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
PACKAGES = ("rlcore", "numpy", "numba", "gymnasium", "torch")


@dataclass(frozen=True)
class Record:
    """One run of a sweep.

    result: what the function returned, as JSON data; None where it failed. seconds: wall time in the worker. error: the
    traceback where it failed, else None. versions: of Python and of the packages where it ran. A worker that died
    leaves neither seconds nor versions.
    """

    function: str
    setting: dict
    seed: int
    result: object
    seconds: float | None
    error: str | None
    versions: dict


def sweep(function, settings, seeds, store, executor=None, *, progress=None):
    """[Record], one for each setting and each seed (seeds vary faster), of function(**setting, rng=default_rng(seed)).

    function: at the top level of a module, or of a script with `if __name__ == "__main__":`, so that workers can
    import it. The rng depends on the seed alone: every setting meets the same randomness, and that call repeats one run.
    settings: list of dicts of keyword arguments. Settings and results are JSON data (numpy's numbers and arrays become
    Python's, tuples lists). seeds: whole numbers, at least 0. store: folder, one file for each run that has ended; those
    runs are not repeated, except where they failed. A store knows functions by name: after a change of code take a new
    one; one sweep at a time. executor: any concurrent.futures.Executor, such as Dask's `client.get_executor()`; by
    default a process of one thread for each core. progress: a line on stderr; by default where that is a terminal.
    A run that fails leaves its traceback and the others go on. Warns of failed runs, and of files in the store that are
    not whole records: they do not count. Raises ValueError for bad input, before any run.
    """
    name = _check_function(function)
    runs = [(setting, seed) for setting in _check_settings(function, settings) for seed in _check_seeds(seeds)]
    store = _check_store(store)
    if not isinstance(executor, Executor | None):
        raise ValueError(f"executor: got {executor!r}, must be a concurrent.futures.Executor (Dask: get_executor())")
    files = [_file_name(name, *run) for run in runs]
    records = {file: record for file, record in _read(store).items() if record.error is None}
    left = [run for run, file in zip(runs, files) if file not in records]
    report = _reporter(len(left), sys.stderr.isatty() if progress is None else progress)

    def keep(run, future):
        record = Record(name, *run, **_outcome(future))
        _write(store, record)
        records[_file_name(name, *run)] = record
        report(record)

    if left:
        _on_processes(function, left, keep) if executor is None else _on_executor(executor, function, left, keep)
    records = [records[file] for file in files]
    failed = [record for record in records if record.error is not None]
    if failed:
        last = failed[0].error.strip().splitlines()[-1]
        warnings.warn(f"{len(failed)} of {len(runs)} runs failed, to be tried again next time: {last}", stacklevel=2)
    return records


# ---------------------------------------------------------------------- running


def _run(function, setting, seed):
    """In a worker: what a Record holds beside the question."""
    start, result, error = time.perf_counter(), None, None
    try:
        result = _plain("result", function(**setting, rng=np.random.default_rng(seed)))
    except (Exception, SystemExit):
        error = traceback.format_exc()
    return dict(result=result, seconds=time.perf_counter() - start, error=error, versions=_versions())


def _outcome(future):
    error = future.exception()
    if error is None:
        return future.result()
    return dict(result=None, seconds=None, error="".join(traceback.format_exception(error)), versions={})


def _on_executor(executor, function, left, keep):
    futures = {}
    try:
        for run in left:
            futures[executor.submit(_run, function, *run)] = run
        for future in as_completed(list(futures)):
            if isinstance(future.exception(), BrokenExecutor):
                raise future.exception()
            keep(futures[future], future)
            del futures[future]
    finally:
        _keep_finished(futures, keep)


def _on_processes(function, left, keep):
    """A pool of one process for each core: where a worker dies, that is the failure of its own run and of no other."""
    left, running, before = list(reversed(left)), {}, set(active_children())
    with ExitStack() as pools, _environment(ONE_THREAD):
        idle = [pools.enter_context(_pool()) for _ in range(min(_cores(), len(left)))]
        try:
            while left or running:
                while left and idle:
                    run, pool = left.pop(), idle.pop()
                    running[pool.submit(_run, function, *run)] = run, pool
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    run, pool = running[future]
                    keep(run, future)
                    del running[future]
                    died = isinstance(future.exception(), BrokenExecutor)
                    idle.append(pools.enter_context(_pool()) if died else pool)
        finally:
            _keep_finished({future: run for future, (run, _) in running.items()}, keep)
            for process in set(active_children()) - before:
                process.terminate()


def _keep_finished(futures, keep):
    """After an interrupt: what has ended is kept, the rest is called off."""
    for future, run in futures.items():
        if not future.cancel() and future.done() and not future.cancelled() and future.exception() is None:
            keep(run, future)


def _pool():
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_start_worker)


def _start_worker():
    """Interrupts are the parent's; without the parent there is nobody to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=lambda: (parent_process().join(), os._exit(1)), daemon=True).start()


def _cores():
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


@contextmanager
def _environment(values):
    """Processes started inside see these variables, numpy among them when it loads."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _versions():
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _reporter(n, shown):
    """A function to call after each of n runs."""
    start, seen = time.monotonic(), []

    def report(record):
        seen.append(record.error is not None)
        left = (time.monotonic() - start) / len(seen) * (n - len(seen))
        text = f"{len(seen)} of {n} runs, {sum(seen)} failed, {left / 60:.1f} min left"
        end = "\r" if sys.stderr.isatty() and len(seen) < n else "\n"
        print(f"{text:<60}", end=end, file=sys.stderr, flush=True)

    return report if shown else lambda record: None


# ---------------------------------------------------------------------- the store


def _file_name(function, setting, seed):
    """Readable, and different for different runs."""
    words = [function, *(f"{key}={setting[key]}" for key in sorted(setting))]
    text = json.dumps([function, setting, seed], sort_keys=True)
    readable = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", "_".join(words))[:120]
    return f"{readable}_seed={seed}_{hashlib.sha256(text.encode()).hexdigest()[:12]}.json"


def _seal(run):
    return hashlib.sha256(json.dumps(run).encode()).hexdigest()


def _write(store, record):
    """All of the file or nothing: written aside, then renamed."""
    path, run = store / _file_name(record.function, record.setting, record.seed), asdict(record)
    part = path.with_name(path.name + ".part")
    with open(part, "w", encoding="utf-8") as out:
        json.dump({"run": run, "sha256": _seal(run)}, out)
        out.flush()
        os.fsync(out.fileno())
    os.replace(part, path)


def _read(store):
    """{file name: Record} of the whole records; a warning for everything else."""
    records = {}
    for path in sorted(store.iterdir()):
        try:
            text = json.loads(path.read_text(encoding="utf-8"))
            record = Record(**text["run"])
            whole = text["sha256"] == _seal(text["run"])
            whole = whole and path.name == _file_name(record.function, record.setting, record.seed)
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            whole = False
        if whole:
            records[path.name] = record
        else:
            warnings.warn(f"{path}: not a whole record of a sweep, it does not count", stacklevel=3)
    return records


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
    raise ValueError(f"{name}: got {value!r}, must be numbers, strings, lists and dicts with strings as keys")


def _check_function(function):
    home = sys.modules.get(getattr(function, "__module__", None))
    name = getattr(function, "__qualname__", "")
    if not callable(function) or getattr(home, name, None) is not function or not hasattr(home, "__file__"):
        raise ValueError(f"function: got {function!r}, must be at the top level of a module, for workers to import")
    return name


def _check_settings(function, settings):
    if not isinstance(settings, list | tuple) or not settings:
        raise ValueError(f"settings: got {settings!r}, must be a list of at least one dict")
    for i, setting in enumerate(settings):
        if not isinstance(setting, dict):
            raise ValueError(f"settings[{i}]: got {setting!r}, must be a dict of keyword arguments")
        try:
            inspect.signature(function).bind(**setting | {"rng": None})
        except TypeError as error:
            raise ValueError(f"settings[{i}]: got {setting!r}, must be arguments beside rng: {error}") from None
        if "rng" in setting:
            raise ValueError(f"settings[{i}]: got an rng, must leave it to the seeds")
    settings = [_plain(f"settings[{i}]", setting) for i, setting in enumerate(settings)]
    texts = [json.dumps(setting, sort_keys=True) for setting in settings]
    for i, text in enumerate(texts):
        if text in texts[:i]:
            raise ValueError(f"settings[{i}]: got {text}, must differ from settings[{texts.index(text)}]")
    return settings


def _check_seeds(seeds):
    if isinstance(seeds, str) or not hasattr(seeds, "__iter__"):
        raise ValueError(f"seeds: got {seeds!r}, must be a sequence of whole numbers")
    seeds = [check_count("seeds", seed, 0) for seed in seeds]
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: got {seeds}, must be at least one, each once")
    return seeds


def _check_store(store):
    if not isinstance(store, str | Path) or Path(store).exists() and not Path(store).is_dir():
        raise ValueError(f"store: got {store!r}, must be a folder, or the name of a new one")
    Path(store).mkdir(parents=True, exist_ok=True)
    return Path(store)
