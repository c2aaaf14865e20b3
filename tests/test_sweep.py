"""Sweeps: what is stored, what is run again, and what happens when processes are killed."""

import importlib.util
import json
import os
import platform
import re
import signal
import subprocess
import sys
import time
import warnings
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from multiprocessing import active_children, get_context
from pathlib import Path

import numpy as np
import psutil
import pytest
import sweep_runs
from conftest import absent
from sweep_runs import draw, logged, starts, wait_for

from rlcore import sweep as module
from rlcore.sweep import sweep

HERE = Path(__file__).parent
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{HERE}{os.pathsep}{Path(module.__file__).parents[1]}"}


class Here(Executor):
    """Runs at once, in this process, and counts; `cut` lists the runs at which the user presses Ctrl-C."""

    def __init__(self, cut=()):
        self.calls, self.cut = 0, cut

    def submit(self, function, *args):
        self.calls += 1
        if self.calls in self.cut:
            raise KeyboardInterrupt
        future = Future()
        future.set_running_or_notify_cancel()
        future.set_result(function(*args))
        return future


@pytest.fixture(autouse=True)
def no_surprises():
    """A warning that no test expects is a failure."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("default", category=DeprecationWarning)
        yield


def alive(process):
    try:
        return psutil.Process(process).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def end(process):
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


# ---------------------------------------------------------------------- records and files


@pytest.mark.parametrize("executor", [None, Here(), ThreadPoolExecutor(3)], ids=["processes", "here", "threads"])
def test_a_run_is_the_function_at_its_seed_on_every_executor(tmp_path, executor):
    store, start = tmp_path / "new" / "store", time.perf_counter()
    records = sweep(draw, [dict(x=1), dict(x=np.float64(0.5))], (3, np.int64(0)), str(store), executor)
    elapsed = time.perf_counter() - start
    assert [(r.setting, r.seed) for r in records] == [({"x": x}, seed) for x in (1, 0.5) for seed in (3, 0)]
    for r in records:
        u = draw(r.setting["x"], np.random.default_rng(r.seed))["u"]
        assert r.result == {"x": r.setting["x"], "u": u.tolist(), "pair": [1, None], "flag": True}
        assert r.function == "draw" and r.error is None and 0 <= r.seconds <= elapsed
        assert r.versions["python"] == platform.python_version() and r.versions["numpy"] == np.__version__
    assert len(list(store.iterdir())) == 4
    again = Here()
    assert sweep(draw, [dict(x=1), dict(x=0.5)], [3, 0], store, again) == records and again.calls == 0


def test_more_settings_and_seeds_run_only_what_is_new(tmp_path):
    first = sweep(draw, [dict(x=1)], [0], tmp_path, Here())
    executor = Here()
    more = sweep(draw, [dict(x=2), dict(x=1)], [1, 0], tmp_path, executor)
    assert executor.calls == 3 and more[3] == first[0]
    assert [(r.setting["x"], r.seed) for r in more] == [(2, 1), (2, 0), (1, 1), (1, 0)]
    assert sweep(draw, [dict(x=1)], [0], tmp_path, executor) == first and executor.calls == 3


def name(run, seed=7, **setting):
    return module._file_name(run, module._plain("setting", setting), seed)


def test_only_runs_that_are_equal_share_a_file():
    assert name("f", x=(1, 2)) == name("f", x=[1, 2]) == name("f", x=np.arange(1, 3))
    assert name("f", a=1, b=2) == name("f", b=2, a=1)
    different = [0, 1, 1.0, True, "1", None, "None", [1], {"1": 1}]
    names = {name(function, seed, x=x) for x in different for function in "fg" for seed in (0, 1)}
    assert len(names) == 4 * len(different)


def test_names_are_readable_and_fit_any_file_system():
    assert re.fullmatch(r"run_lr=0\.001_name=a-b-c_seed=7_[0-9a-f]{12}\.json", name("run", lr=0.001, name="a/b: c"))
    long = name("run", text="/../" * 500)
    assert len(long) == 120 + len("_seed=7_") + 12 + len(".json") and "/" not in long and "-" in long
    assert name("run", text="/../" * 501) != long


def test_the_file_holds_the_record_and_nothing_is_left_beside_it(tmp_path):
    (record,) = sweep(draw, [dict(x=1)], [0], tmp_path, Here())
    (path,) = tmp_path.iterdir()
    data = json.loads(path.read_text())
    assert module.Record(**data["run"]) == record
    assert data["sha256"] == module._digest(data["run"]) and len(data["sha256"]) == 64


def test_a_file_is_complete_on_disk_before_it_gets_its_name(tmp_path, monkeypatch):
    calls, sync, rename = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: (calls.append(os.fstat(fd).st_size), sync(fd)))
    monkeypatch.setattr(os, "replace", lambda a, b: (calls.append((str(a), str(b))), rename(a, b)))
    sweep(draw, [dict(x=1)], [0], tmp_path, Here())
    (path,) = tmp_path.iterdir()
    (size, (part, name)) = calls
    assert size == path.stat().st_size and name == str(path) and Path(part).parent == tmp_path and part != name


def test_numbers_of_different_kinds_are_different_settings(tmp_path):
    records = sweep(draw, [dict(x=1), dict(x=1.0), dict(x=True)], [0], tmp_path, Here())
    assert len(list(tmp_path.iterdir())) == 3
    assert [type(r.setting["x"]) for r in records] == [int, float, bool]


def test_a_run_is_kept_when_it_ends_however_long_others_take(tmp_path, monkeypatch):
    write, order = module._write, []
    monkeypatch.setattr(module, "_write", lambda path, r: (order.append(r.setting["x"]), write(path, r)))
    store = tmp_path / "store"
    settings = [dict(x=x, log=str(tmp_path), until=[str(store), n]) for x, n in enumerate((2, 0, 1))]
    with ThreadPoolExecutor(3) as executor:
        sweep(logged, settings, [0], store, executor)
    assert order == [1, 2, 0]


# ---------------------------------------------------------------------- what is in the store and should not count


def spoil(text, kind):
    if kind in TEXTS:
        return TEXTS[kind](text)
    data = json.loads(text)
    run = data["run"]
    change = dict(result=lambda: run["result"].update(x=9), seed=lambda: run.update(seed=run["seed"] + 1))
    change |= dict(field=lambda: run.pop("seconds"), seal=lambda: data.pop("sha256"))
    change[kind]()
    if kind in ("seed", "field"):  # as if another program had written them
        data["sha256"] = module._digest(run)
    return json.dumps(data)


TEXTS = dict(half=lambda text: text[: len(text) // 2], short=lambda text: text[:-1])
TEXTS |= dict(empty=lambda text: "", list=lambda text: "[1]", number=lambda text: "7")


@pytest.mark.parametrize("kind", [*TEXTS, "result", "seed", "field", "seal"])
def test_a_spoilt_record_is_named_and_run_again(tmp_path, kind):
    first = sweep(draw, [dict(x=1), dict(x=2)], [0], tmp_path, Here())
    path = min(tmp_path.iterdir())
    path.write_text(spoil(path.read_text(), kind))
    executor = Here()
    with pytest.warns(UserWarning, match=re.escape(path.name) + ": not a whole record") as caught:
        second = sweep(draw, [dict(x=1), dict(x=2)], [0], tmp_path, executor)
    assert executor.calls == 1 and len(caught) == 1 and caught[0].filename == __file__
    assert [r.result for r in second] == [r.result for r in first]
    assert sweep(draw, [dict(x=1), dict(x=2)], [0], tmp_path, executor) == second and executor.calls == 1


def test_foreign_files_are_named_and_never_counted(tmp_path):
    (record,) = sweep(draw, [dict(x=1)], [0], tmp_path, Here())
    (path,) = tmp_path.iterdir()
    foreign = [tmp_path / name for name in ("notes.txt", "copy.json", f"{path.name}.part", "binary", "folder")]
    foreign[0].write_text("x=1 went well")
    foreign[1].write_bytes(path.read_bytes())  # whole, under a name that is not its own
    foreign[2].write_bytes(path.read_bytes()[:50])  # the process was killed while it wrote
    foreign[3].write_bytes(b"\xff\xfe\x00")
    foreign[4].mkdir()
    with pytest.warns(UserWarning, match="not a whole record") as caught:
        assert sweep(draw, [dict(x=1)], [0], tmp_path, Here()) == [record]
    assert [str(w.message).split(": not")[0] for w in caught] == sorted(map(str, foreign))
    assert all(path.exists() for path in foreign)


# ---------------------------------------------------------------------- runs that fail, interrupts


@pytest.mark.parametrize("executor", [None, Here()], ids=["processes", "here"])
def test_a_run_that_fails_leaves_its_traceback_and_is_tried_again(tmp_path, executor):
    settings = [dict(x=x) for x in ("bad", 1, "odd", "exit")]
    with pytest.warns(UserWarning, match="^3 of 4 runs failed, .*: KeyError: 'no such number'$") as caught:
        records = sweep(draw, settings, [0], tmp_path, executor)
    assert caught[0].filename == __file__
    assert [r.result is None for r in records] == [True, False, True, True] and records[1].error is None
    assert "sweep_runs.py" in records[0].error and "in draw" in records[0].error
    assert "ValueError: result: got {1, 2}, must be numbers" in records[2].error
    assert "SystemExit: left" in records[3].error
    assert all(r.seconds >= 0 and "python" in r.versions for r in records)
    assert len(list(tmp_path.iterdir())) == 4
    executor = Here()
    with pytest.warns(UserWarning, match="3 of 4"):
        sweep(draw, settings, [0], tmp_path, executor)
    assert executor.calls == 3


def test_a_repaired_run_takes_the_place_of_its_failure(tmp_path, monkeypatch):
    with pytest.warns(UserWarning, match="1 of 1"):
        (failed,) = sweep(draw, [dict(x="bad")], [0], tmp_path, Here())
    path = min(tmp_path.iterdir())
    module._write(path, replace(failed, result=1, error=None))
    assert sweep(draw, [dict(x="bad")], [0], tmp_path, Here())[0].result == 1


def test_an_interrupt_loses_nothing_that_has_finished(tmp_path):
    settings = [dict(x=x) for x in range(5)]
    with pytest.raises(KeyboardInterrupt):
        sweep(draw, settings, [0], tmp_path, Here(cut=[4]))  # in submit, with three runs done and none looked at
    assert len(list(tmp_path.iterdir())) == 3
    executor = Here()
    assert [r.setting["x"] for r in sweep(draw, settings, [0], tmp_path, executor)] == list(range(5))
    assert executor.calls == 2


def test_an_interrupt_calls_off_what_has_not_started(tmp_path):
    class Full(Here):
        """A place for one run; the others queue. The user presses Ctrl-C while the third is handed over."""

        futures = []

        def submit(self, function, *args):
            self.futures.append(Future() if self.futures else super().submit(function, *args))
            if len(self.futures) == 3:
                raise KeyboardInterrupt
            return self.futures[-1]

    executor = Full()
    with pytest.raises(KeyboardInterrupt):
        sweep(draw, [dict(x=x) for x in range(5)], [0], tmp_path, executor)
    assert [future.cancelled() for future in executor.futures[:2]] == [False, True] and len(
        list(tmp_path.iterdir())
    ) == 1


def test_a_result_that_cannot_travel_is_the_failure_of_its_run(tmp_path):
    class Lost(Here):
        def submit(self, function, *args):
            future = super().submit(function, *args)
            if self.calls == 2:
                future = Future()
                future.set_exception(OSError("the network is down"))
            return future

    with pytest.warns(UserWarning, match="1 of 3 runs failed, .*: OSError: the network is down"):
        records = sweep(draw, [dict(x=x) for x in range(3)], [0], tmp_path, Lost())
    assert [r.error is None for r in records] == [True, False, True]
    assert (records[1].seconds, records[1].versions, records[1].result) == (None, {}, None)


# ---------------------------------------------------------------------- processes that are killed


def test_there_is_a_process_for_each_core_that_is_ours(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 5, 6} if process == 0 else {}, raising=False)
    assert module._cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 9)
    assert module._cores() == 9


@pytest.mark.parametrize("cores, pools", [(2, 2), (9, 3)])
def test_no_more_pools_than_cores_and_a_free_one_takes_the_next_run(tmp_path, monkeypatch, cores, pools):
    write, order, made = module._write, [], []
    monkeypatch.setattr(module, "_write", lambda path, r: (order.append(r.setting["x"]), write(path, r)))
    monkeypatch.setattr(module, "_pool", lambda: made.append(ThreadPoolExecutor(1)) or made[-1])
    monkeypatch.setattr(module, "_cores", lambda: cores)
    store = tmp_path / "store"
    settings = [dict(x=x, log=str(tmp_path), until=[str(store), n]) for x, n in enumerate((2, 0, 1))]
    sweep(logged, settings, [0], store)
    assert order == [1, 2, 0] and len(made) == pools
    with pytest.raises(RuntimeError, match="shutdown"):
        made[0].submit(print)


def test_each_process_has_one_thread_and_the_rest_of_us_keep_ours(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    monkeypatch.setattr(sweep_runs, "FRESH", False)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    (tmp_path / "log").mkdir()
    records = sweep(logged, [dict(x=x, log=str(tmp_path / "log")) for x in range(3)], [0], tmp_path / "store")
    signal.signal(signal.SIGINT, before)
    assert all(r.result["threads"] == "1" and r.result["fresh"] and not r.result["interrupts"] for r in records)
    assert os.environ["OMP_NUM_THREADS"] == "7" and "MKL_NUM_THREADS" not in os.environ
    assert {r.result["process"] for r in records}.isdisjoint({os.getpid()})
    assert not any(alive(r.result["process"]) for r in records) and not active_children()


class Counted(ProcessPoolExecutor):
    """A pool that notes when it is made and when it is shut down."""

    made, shut = [], []

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.made.append(self)

    def shutdown(self, *args, **kwargs):
        self.shut.append(self)
        super().shutdown(*args, **kwargs)


def test_a_worker_that_is_killed_fails_its_own_run_alone(tmp_path, monkeypatch):
    log, store = tmp_path / "log", tmp_path / "store"
    log.mkdir()
    monkeypatch.setattr(module, "ProcessPoolExecutor", Counted)
    settings = [dict(x=x, log=str(log), seconds=0.05, kill=x in (1, 2)) for x in range(6)]
    with pytest.warns(UserWarning, match="2 of 6 runs failed, .*terminated abruptly"):
        records = sweep(logged, settings, [0], store)
    assert [r.error is None for r in records] == [True, False, False, True, True, True]
    assert records[1].seconds is None and "BrokenProcessPool" in records[1].error
    assert [len(starts(log, x)) for x in range(6)] == [1] * 6
    assert len(Counted.made) >= 3 and set(Counted.shut) == set(Counted.made)


def test_a_worker_without_work_ends_with_its_pool():
    pool = module._pool()
    worker = pool.submit(os.getpid).result(timeout=300)
    pool.shutdown(wait=False)
    try:
        wait_for(lambda: not alive(worker))
    finally:
        end(worker)


def test_an_executor_that_breaks_is_an_error_and_loses_nothing(tmp_path):
    log, store = tmp_path / "log", tmp_path / "store"
    log.mkdir()
    settings = [dict(x=x, log=str(log), kill=x == 2) for x in range(6)]
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor,
        pytest.raises(BrokenExecutor, match="abruptly"),
    ):
        sweep(logged, settings, [0], store, executor)
    kept = len(list(store.iterdir()))
    assert kept == 2 and all(json.loads(path.read_text())["run"]["error"] is None for path in store.iterdir())
    settings[2]["kill"] = False
    assert [r.result["x"] for r in sweep(logged, settings, [0], store, Here())] == list(range(6))
    assert [len(starts(log, x)) for x in range(6)] == [1, 1, 2, 1, 1, 1]


@pytest.mark.parametrize("how", ["SIGKILL", "SIGINT", "SIGINT to all"])
def test_a_killed_sweep_ends_its_workers_and_goes_on_where_it_was(tmp_path, how):
    log, store = tmp_path / "log", tmp_path / "store"
    log.mkdir()
    command = [sys.executable, HERE / "sweep_runs.py", store, log]
    started = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)
    workers = []
    try:
        wait_for(lambda: len(list(store.glob("*.json")) if store.exists() else []) == 6 and starts(log, 6))
        workers = [process for x in range(8) for process in starts(log, x)]
        number = getattr(signal, how.split()[0])
        (os.killpg if "all" in how else os.kill)(started.pid, number)
        _, errors = started.communicate(timeout=300)  # the two that were going on take an hour
        assert started.returncode == -number and ("KeyboardInterrupt" in errors) == (number == signal.SIGINT)
        wait_for(lambda: not any(map(alive, workers)))
    finally:
        started.kill()
        for process in workers:
            end(process)
    assert len(list(store.glob("*.json"))) == 6
    settings = [dict(x=x, log=str(log), seconds=0.02) for x in range(6)]
    executor = Here()
    assert [r.result["x"] for r in sweep(logged, settings, [0], store, executor)] == list(range(6))
    assert executor.calls == 0 and [len(starts(log, x)) for x in range(6)] == [1] * 6


# ---------------------------------------------------------------------- Dask


@pytest.fixture
def cluster(tmp_path):
    """Address of a scheduler on the loopback interface; two workers in processes of their own, without a nanny."""
    if importlib.util.find_spec("distributed") is None:
        absent("no Dask: pip install distributed, to run a sweep on a cluster")
    address = tmp_path / "scheduler.json"
    scheduler = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    worker = ["distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
    commands = [scheduler, [*worker, "--name", "one"], [*worker, "--name", "two"]]
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", *command, "--scheduler-file", address],
            env=ENVIRONMENT,
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for command in commands
    ]
    yield address, [process.pid for process in processes[1:]]
    for process in reversed(processes):
        process.kill()
        process.wait()


@pytest.mark.long
def test_a_cluster_that_loses_a_worker_loses_and_repeats_nothing_that_counts(tmp_path, cluster):
    from distributed import Client

    address, workers = cluster
    log, store = tmp_path / "log", tmp_path / "store"
    log.mkdir()
    (gate := tmp_path / "gate").mkdir()  # opened when a worker has been killed at one of the runs that wait for it
    settings = [dict(x=x, log=str(log), until=[str(gate), int(x >= 4)]) for x in range(16)]
    killed = []

    wait_for(address.exists)
    with Client(scheduler_file=str(address), timeout="300s") as client:
        client.wait_for_workers(2, timeout=300)
        with pytest.MonkeyPatch.context() as patch:
            write, kept = module._write, []

            def write_and_kill(path, record):
                write(path, record)
                kept.append(record.result["process"])
                if len(kept) == 3:
                    killed.append(kept[-1])
                    wait_for(lambda: any(killed == starts(log, x) for x in range(4, 16)))
                    os.kill(killed[0], signal.SIGKILL)
                    (gate / "open.json").touch()

            patch.setattr(module, "_write", write_and_kill)
            records = sweep(logged, settings, [0], store, client.get_executor())
    assert killed and killed[0] in workers
    assert [r.result["x"] for r in records] == list(range(16)) and all(r.error is None for r in records)
    assert len(kept) == 16 and len(list(store.iterdir())) == 16
    assert {r.result["process"] for r in records} <= set(workers)
    began = [starts(log, x) for x in range(16)]
    assert any(len(processes) > 1 for processes in began[4:])  # what the killed one was at
    for x, (record, processes) in enumerate(zip(records, began)):
        assert record.result["process"] in processes and len(processes) <= 2
        if len(processes) > 1:
            assert processes[0] == killed[0]
            assert x < 4 or record.result["process"] != killed[0]  # the first may have been handed over already
    executor = Here()
    assert sweep(logged, settings, [0], store, executor) == records and executor.calls == 0


# ---------------------------------------------------------------------- progress


def test_progress_goes_to_stderr_where_it_is_asked_for(tmp_path, capsys):
    settings = [dict(x=1), dict(x="bad"), dict(x=2), dict(x=3)]
    with pytest.warns(UserWarning):
        sweep(draw, settings, [0], tmp_path / "a", Here(), progress=True)
    out, err = capsys.readouterr()
    assert err.count("\n") == 4 and "\r" not in err
    lines = [re.sub(r"[0-9.]+ min", "m min", line.strip()) for line in err.splitlines()]
    assert out == "" and [line.split(" runs")[0] for line in lines] == [f"{k} of 4" for k in (1, 2, 3, 4)]
    assert lines[-1] == "4 of 4 runs, 1 failed, m min left"
    with pytest.warns(UserWarning):
        sweep(draw, settings, [0], tmp_path / "b", Here())
        sweep(draw, settings, [0], tmp_path / "c", Here(), progress=False)
    assert capsys.readouterr() == ("", "")


def test_time_left_is_that_of_a_run_so_far_times_what_is_left(monkeypatch, capsys):
    clock = iter([100.0, 6100.0, 12100.0, 24100.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    report = module._reporter(3, True)
    for _ in range(3):
        report(module.Record("f", {}, 0, 1, 1.0, None, {}))
    lines = [
        f"{k} of 3 runs, 0 failed, {left} min left".ljust(60) for k, left in ((1, "200.0"), (2, "100.0"), (3, "0.0"))
    ]
    assert capsys.readouterr().err == "\r".join(lines) + "\n"


# ---------------------------------------------------------------------- bad input


def nested():
    def inner(rng):
        return 1

    return inner


class Method:
    def run(self, rng):
        return 1


def asked(tmp_path, **change):
    call = dict(function=draw, settings=[dict(x=1)], seeds=[0], store=tmp_path / "store", executor=Here()) | change
    return sweep(**call)


BAD = {
    "not callable": (dict(function=3), "function: got 3, must be at the top level of a module"),
    "lambda": (dict(function=lambda x, rng: x), "function: got <function <lambda>"),
    "nested": (dict(function=nested()), "function: got <function nested.<locals>.inner"),
    "method": (dict(function=Method().run), "function: got <bound method Method.run"),
    "no settings": (dict(settings=[]), "settings: got [], must be a list of at least one dict"),
    "one dict": (dict(settings=dict(x=1)), "settings: got {'x': 1}, must be a list"),
    "a setting that is a number": (dict(settings=[dict(x=1), 3]), "settings[1]: got 3, must be a dict"),
    "rng in a setting": (dict(settings=[dict(x=1, rng=2)]), "settings[0]: got {'x': 1, 'rng': 2}, must be a dict"),
    "argument unknown": (dict(settings=[dict(x=1, y=2)]), "settings[0]: got {'x': 1, 'y': 2}, must be what"),
    "argument missing": (dict(settings=[dict(x=1), {}]), "settings[1]: got {}, must be what the function takes: miss"),
    "setting not JSON": (dict(settings=[dict(x={1})]), "settings[0]: got {1}, must be numbers, strings"),
    "setting complex": (dict(settings=[dict(x=np.complex64(1))]), "settings[0]: got (1+0j), must be numbers"),
    "key not a string": (dict(settings=[dict(x={1: 2})]), "settings[0]: got {1: 2}, must be numbers"),
    "setting twice": (dict(settings=[dict(x=(1,)), dict(x=2), dict(x=[1])]), "differ from settings[0]"),
    "no seeds": (dict(seeds=[]), "seeds: got [], must be at least one, each once"),
    "one seed twice": (dict(seeds=[1, 2, 1]), "seeds: got [1, 2, 1], must be at least one, each once"),
    "negative seed": (dict(seeds=[-1]), "seeds: got -1, must be a whole number of at least 0"),
    "half a seed": (dict(seeds=[0.5]), "seeds: got 0.5, must be a whole number of at least 0"),
    "seeds a number": (dict(seeds=3), "seeds: got 3, must be whole numbers"),
    "seeds a string": (dict(seeds="123"), "seeds: got '123', must be whole numbers"),
    "store nothing": (dict(store=None), "store: got None, must be a folder"),
    "store a file": (dict(store=__file__), "must be a folder, or where one can be made"),
    "store below a file": (dict(store=f"{__file__}/store"), "must be a folder, or where one can be made"),
    "executor a number": (dict(executor=4), "executor: got int, must be a concurrent.futures.Executor"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_before_anything_runs(tmp_path, case):
    change, message = BAD[case]
    with pytest.raises(ValueError) as error:
        asked(tmp_path, **change)
    assert message in str(error.value)
    assert not (tmp_path / "store").exists()


def test_a_function_of_a_notebook_is_refused(tmp_path):
    code = f"from rlcore.sweep import sweep\ndef f(rng): return 1\nsweep(f, [{{}}], [0], {str(tmp_path / 's')!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "ValueError: function: got <function f" in done.stderr
