"""Steps a second of tabular learning: rlcore compiled and interpreted, the same loop in C, plain gymnasium loops.

    python benchmarks/tabular.py                every job that results/tabular.csv does not hold yet
    python benchmarks/tabular.py --only cliff   jobs whose name contains this word
    python benchmarks/tabular.py --again        measure anew what is there already

Every job is a process of its own with one thread (a second one where numba is switched off): each implementation learns
once for compilers and caches, then all take turns, five times; the least CPU time counts. The loops in tabular.c use
the outcome tables of rlcore and are compiled on the spot. With numpy's PCG64, their own or numpy's own through its
pointer, they must return rlcore's values to the last bit; with xoshiro256+, which is quicker, only the number of steps
can be compared.
"""

import argparse
import csv
import ctypes
import datetime
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dp import THREADS, processor, short, versions

HERE = Path(__file__).resolve().parent
RESULTS, BUILD = HERE / "results" / "tabular.csv", HERE.parent / "_build" / "benchmarks"
COLUMNS = ["job", "implementation", "status", "steps", "seconds", "rate", "wall", "difference"]
COLUMNS += ["date", "cpu", "versions"]
ROUNDS, CONTROL = 5, dict(gamma=0.99, alpha=0.5, epsilon=0.1)

# ---------------------------------------------------------------------- jobs
# name: (method, world, settings, episodes of a compiled run, of a Python run)

JOBS = {
    "sarsa cliff": ("sarsa", "cliff", CONTROL, 300_000, 700),
    "q_learning cliff": ("q_learning", "cliff", CONTROL, 300_000, 700),
    "sarsa lake": ("sarsa", "lake", CONTROL, 150_000, 200),
    "q_learning lake": ("q_learning", "lake", CONTROL, 150_000, 200),
    "sarsa taxi": ("sarsa", "taxi", CONTROL, 300_000, 150),
    "q_learning taxi": ("q_learning", "taxi", CONTROL, 300_000, 150),
    "td0 walk": ("td0", "walk", dict(gamma=1.0, alpha=0.1), 100_000, 300),
    "td_lambda walk": ("td_lambda", "walk", dict(gamma=1.0, alpha=0.1, lam=0.8), 50_000, 150),
    "dyna_q maze": ("dyna_q", "maze", dict(gamma=0.95, alpha=0.1, epsilon=0.1, n_planning=5), 50_000, 50),
}
ENVS = {"cliff": "CliffWalking-v1", "lake": "FrozenLake8x8-v1", "taxi": "Taxi-v4"}
MAX_STEPS = 200  # of an episode, in all implementations


class Table:
    """A FiniteMDP as one writes an environment by hand: lists, no checks."""

    def __init__(self, mdp):
        pairs = [range(mdp.n_actions)] * mdp.n_states
        self.rows = [
            [list(zip(mdp.prob[s, a].tolist(), mdp.next_state[s, a].tolist(), mdp.reward[s, a].tolist())) for a in A]
            for s, A in enumerate(pairs)
        ]
        self.ends, self.start, self.n_actions = mdp.terminal.tolist(), int(mdp.start.argmax()), mdp.n_actions
        self.n_states = mdp.n_states

    def reset(self):
        self.s, self.t = self.start, 0
        return self.s, {}

    def step(self, a):
        row, u, k = self.rows[self.s][a], random.random(), 0
        while u >= row[k][0] and k + 1 < len(row):
            u -= row[k][0]
            k += 1
        _, self.s, r = row[k]
        self.t += 1
        return self.s, r, self.ends[self.s], self.t == MAX_STEPS, {}


def make_world(name):
    from rlcore import envs
    from rlcore.mdp import FiniteMDP

    if name in ("lake", "taxi"):
        return FiniteMDP.from_env(make_env(name))
    return {"cliff": envs.cliff_walking, "walk": lambda: envs.random_walk(19), "maze": envs.dyna_maze}[name]()


def make_env(name):
    if name not in ENVS:
        return Table(make_world(name))
    import gymnasium

    return gymnasium.make(ENVS[name], max_episode_steps=MAX_STEPS)


def sizes(env):
    return (env.n_states, env.n_actions) if isinstance(env, Table) else (env.observation_space.n, env.action_space.n)


# ---------------------------------------------------------------------- ours


def ours(method, world, settings):
    from rlcore import planning, td, traces
    from rlcore.mdp import uniform_policy

    mdp, settings = make_world(world), dict(settings)
    first = [mdp]
    if world == "walk":
        first.append(uniform_policy(mdp))
    else:
        settings["max_steps"] = MAX_STEPS
    first += [settings.pop(name) for name in ("gamma", "lam") if name in settings]
    function = getattr({"td_lambda": traces, "dyna_q": planning}.get(method, td), method)

    def learn(n_episodes):
        run = function(*first, n_episodes, **settings, rng=np.random.default_rng(0))
        return run.lengths.sum(), run.V if run.Q is None else run.Q

    return learn


# ---------------------------------------------------------------------- C


class Task(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int64) for name in ("S", "A", "K", "n_episodes", "max_steps", "n_planning")]
    _fields_ += [(name, ctypes.c_double) for name in ("gamma", "alpha", "epsilon", "lam")]
    _fields_ += [(name, ctypes.c_void_p) for name in ("next_state", "reward", "cdf", "start_cdf", "terminal")]
    _fields_ += [("rng", ctypes.c_uint64 * 4)]


def library(generator):
    """tabular.c compiled for this processor; products and sums stay apart where the bits are compared."""
    BUILD.mkdir(parents=True, exist_ok=True)
    path = BUILD / f"tabular_{generator}.so"
    options = {"xoshiro": ["-DXOSHIRO"], "numpy": ["-DNUMPY", "-ffp-contract=off"]}.get(
        generator, ["-ffp-contract=off"]
    )
    command = ["cc", "-O3", "-march=native", "-shared", "-fPIC", *options, "-o", path, HERE / "tabular.c"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(path))


def in_c(generator):
    def prepare(method, world, settings):
        mdp = make_world(world)
        arrays, function = mdp.sampler(), getattr(library(generator), method)
        function.restype = ctypes.c_int64
        tables = {name: np.ascontiguousarray(getattr(arrays, name)) for name in arrays._fields}
        assert mdp.legal.all()

        def learn(n_episodes):
            S, A, K = mdp.prob.shape
            task = Task(S=S, A=A, K=K, n_episodes=n_episodes, max_steps=MAX_STEPS, **settings)
            for name, table in tables.items():
                setattr(task, name, table.ctypes.data)
            source = np.random.default_rng(0).bit_generator
            if generator == "numpy":
                task.rng[:2] = (
                    source.ctypes.state_address,
                    ctypes.cast(source.ctypes.next_double, ctypes.c_void_p).value,
                )
            else:
                state = source.state["state"]
                task.rng[:] = [state[name] >> shift & 2**64 - 1 for name in ("state", "inc") for shift in (64, 0)]
            values = np.zeros(S if world == "walk" else (S, A))
            steps = function(ctypes.byref(task), values.ctypes.data_as(ctypes.c_void_p))
            return steps, values

        return learn

    return prepare


# ---------------------------------------------------------------------- plain Python


def gymnasium_loop(method, world, settings):
    """As tutorials write it: an array, env.step, np.argmax."""
    env, rng = make_env(world), np.random.default_rng(0)
    (S, A), gamma, alpha = sizes(env), settings["gamma"], settings["alpha"]

    def choose(Q, s):
        return int(rng.integers(A)) if rng.random() < settings["epsilon"] else int(np.argmax(Q[s]))

    def sarsa(n_episodes):
        Q, steps = np.zeros((S, A)), 0
        for _ in range(n_episodes):
            s, done = env.reset()[0], False
            a = choose(Q, s)
            while not done:
                s_next, r, terminated, truncated, _ = env.step(a)
                a_next = choose(Q, s_next)
                Q[s, a] += alpha * (r + gamma * Q[s_next, a_next] * (not terminated) - Q[s, a])
                s, a, done, steps = s_next, a_next, terminated or truncated, steps + 1
        return steps, Q

    def q_learning(n_episodes):
        Q, steps, model = np.zeros((S, A)), 0, {}
        for _ in range(n_episodes):
            s, done = env.reset()[0], False
            while not done:
                a = choose(Q, s)
                s_next, r, terminated, truncated, _ = env.step(a)
                Q[s, a] += alpha * (r + gamma * np.max(Q[s_next]) * (not terminated) - Q[s, a])
                if method == "dyna_q":
                    model[s, a] = r, s_next
                    keys = list(model)
                    for _ in range(settings["n_planning"]):
                        i, b = keys[rng.integers(len(keys))]
                        r_model, s_model = model[i, b]
                        Q[i, b] += alpha * (r_model + gamma * np.max(Q[s_model]) - Q[i, b])
                s, done, steps = s_next, terminated or truncated, steps + 1
        return steps, Q

    def td0(n_episodes):
        V, steps = np.zeros(S), 0
        for _ in range(n_episodes):
            s, done = env.reset()[0], False
            while not done:
                s_next, r, done, _, _ = env.step(0)
                V[s] += alpha * (r + gamma * V[s_next] * (not done) - V[s])
                s, steps = s_next, steps + 1
        return steps, V

    def td_lambda(n_episodes):
        V, steps = np.zeros(S), 0
        for _ in range(n_episodes):
            s, e, done = env.reset()[0], np.zeros(S), False
            while not done:
                s_next, r, done, _, _ = env.step(0)
                delta = r + gamma * V[s_next] * (not done) - V[s]
                e[s] += 1
                V += alpha * delta * e
                e *= gamma * settings["lam"]
                s, steps = s_next, steps + 1
        return steps, V

    return {"sarsa": sarsa, "td0": td0, "td_lambda": td_lambda}.get(method, q_learning)


def raw_step(method, world, settings):
    """Random actions, nothing learned."""
    env, rng = make_env(world), np.random.default_rng(0)
    _, A = sizes(env)

    def learn(n_episodes):
        steps = 0
        for _ in range(n_episodes):
            env.reset()
            done = False
            while not done:
                _, _, terminated, truncated, _ = env.step(int(rng.integers(A)))
                done, steps = terminated or truncated, steps + 1
        return steps, None

    return learn


def book_loop(method, world, settings):
    """The cliff as code beside the textbook has it: cells as lists, numpy.random, a list comprehension for ties."""
    gamma, alpha, epsilon = (settings[name] for name in ("gamma", "alpha", "epsilon"))
    generator = np.random.RandomState(0)

    def step(s, a):
        row, col = s
        row, col = [[max(row - 1, 0), col], [row, min(col + 1, 11)], [min(row + 1, 3), col], [row, max(col - 1, 0)]][a]
        return ([3, 0], -100) if row == 3 and 1 <= col <= 10 else ([row, col], -1)

    def choose(Q, s):
        if generator.binomial(1, epsilon) == 1:
            return generator.choice([0, 1, 2, 3])
        values = Q[s[0], s[1], :]
        return generator.choice([a for a, value in enumerate(values) if value == np.max(values)])

    def learn(n_episodes):
        Q, steps = np.zeros((4, 12, 4)), 0
        for _ in range(n_episodes):
            s = [3, 0]
            a = choose(Q, s)
            while s != [3, 11]:
                if method == "q_learning":
                    a = choose(Q, s)
                s_next, r = step(s, a)
                if method == "sarsa":
                    a_next = choose(Q, s_next)
                    target = Q[s_next[0], s_next[1], a_next]
                else:
                    a_next, target = None, np.max(Q[s_next[0], s_next[1], :])
                Q[s[0], s[1], a] += alpha * (r + gamma * target - Q[s[0], s[1], a])
                s, a, steps = s_next, a_next, steps + 1
        return steps, Q

    return learn


IMPLEMENTATIONS = {
    "rlcore": ours,
    "C numpy": in_c("numpy"),
    "C pcg64": in_c("pcg64"),
    "C xoshiro": in_c("xoshiro"),
    "gymnasium loop": gymnasium_loop,
    "env.step": raw_step,
    "textbook loop": book_loop,
    "rlcore interpreted": ours,
}
COMPILED = ("rlcore", "C numpy", "C pcg64", "C xoshiro")

# ---------------------------------------------------------------------- measuring


def applies(implementation, job):
    return implementation != "textbook loop" or job.endswith("cliff")


def measure(job, names):
    """In a process of its own: all implementations take turns; print one line of JSON."""
    method, world, settings, n_compiled, n_python = JOBS[job]
    learners = {name: IMPLEMENTATIONS[name](method, world, settings) for name in names}
    found = {name: dict(seconds=np.inf) for name in names}
    for k in range(ROUNDS + 1):
        for name, learn in learners.items():
            n_episodes = (n_compiled if name in COMPILED else n_python) if k else 2
            begin = time.process_time()
            steps, values = learn(n_episodes)
            seconds = time.process_time() - begin
            if k and seconds < found[name]["seconds"]:
                found[name] = dict(steps=int(steps), seconds=seconds, rate=steps / seconds, values=values)
    for name, row in found.items():
        values = row.pop("values")
        if name == "rlcore":
            expected = values
        elif name in ("C numpy", "C pcg64"):
            row["difference"] = float(np.abs(values - expected).max())
    print(json.dumps(found))


FIRST_CALL = """
import time
wall, cpu = time.perf_counter(), time.process_time()
import numpy
from rlcore.envs import cliff_walking
from rlcore.td import sarsa
sarsa(cliff_walking(), 1.0, 10, alpha=0.5, epsilon=0.1, max_steps=200, rng=numpy.random.default_rng(0))
print(time.perf_counter() - wall, time.process_time() - cpu)
"""


def first_call(implementation):
    """SARSA in a fresh process, imports included: the first call there, its machine code on disk or not."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(ROUNDS + 1):
            cache = f"{folder}/{k if implementation == 'nothing on disk' else ''}"
            done = child(["-c", FIRST_CALL], NUMBA_CACHE_DIR=cache)
            times.append([float(x) for x in done.stdout.split()])
    wall, cpu = np.min(times[1:], axis=0)
    return dict(wall=float(wall), seconds=float(cpu))


def child(arguments, **env):
    env = {**os.environ, **THREADS, **env}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, env=env, check=True)


def run(job):
    """Rows of one job."""
    if job == "first call":
        found = {name: first_call(name) for name in ("machine code on disk", "nothing on disk")}
    else:
        names = [name for name in IMPLEMENTATIONS if applies(name, job)]
        found = json.loads(child([__file__, "--measure", job, *names[:-1]]).stdout.splitlines()[-1])
        alone = child([__file__, "--measure", job, names[-1]], RLCORE_NO_NUMBA="1")
        found |= json.loads(alone.stdout.splitlines()[-1])
    about = dict(date=datetime.date.today().isoformat(), cpu=processor(), versions=versions("rlcore"))
    status = {name: "ok" if not row.get("difference") else "other values" for name, row in found.items()}
    return {
        (job, name): dict(job=job, implementation=name, status=status[name]) | row | about
        for name, row in found.items()
    }


def load():
    if not RESULTS.exists():
        return {}
    with RESULTS.open(newline="") as file:
        return {(row["job"], row["implementation"]): row for row in csv.DictReader(file)}


def save(rows):
    RESULTS.parent.mkdir(exist_ok=True)
    order = {name: i for i, name in enumerate([*JOBS, "first call", *IMPLEMENTATIONS])}
    with RESULTS.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for key in sorted(rows, key=lambda key: (order[key[0]], order.get(key[1], 0))):
            writer.writerow({name: short(rows[key].get(name, "")) for name in COLUMNS})


# ---------------------------------------------------------------------- table


def show(rows):
    """Millions of steps per CPU second, and what the targets are about."""
    names = list(IMPLEMENTATIONS)
    print(f"\n{'million steps/s':18}" + "".join(f"{name:>20}" for name in names))
    ratios = []
    for job in JOBS:
        rate = {name: float(rows[job, name]["rate"]) for name in names if (job, name) in rows}
        if rate:
            print(f"{job:18}" + "".join(f"{rate[n] / 1e6:20.3f}" if n in rate else f"{'':20}" for n in names))
            ratios.append((job, rate))
        if rows.get((job, "C pcg64"), {}).get("status", "ok") != "ok":
            print(f"{'':18} C pcg64 differs by {rows[job, 'C pcg64']['difference']}")
    print(f"\n{'rlcore /':18}" + "".join(f"{name:>20}" for name in names[1:6]))
    for job, rate in ratios:
        print(
            f"{job:18}" + "".join(f"{rate['rlcore'] / rate[n]:20.2f}" if n in rate else f"{'':20}" for n in names[1:6])
        )
    print(f"\n{'interpreted /':18}{'gymnasium loop':>20}{'textbook loop (3)':>20}")
    for job, rate in ratios:
        peers = [
            rate["rlcore interpreted"] / rate[n] if n in rate else np.nan for n in ("gymnasium loop", "textbook loop")
        ]
        print(f"{job:18}" + "".join(f"{x:20.2f}" for x in peers))
    print()
    for (job, name), row in rows.items():
        if job == "first call":
            print(f"first call, {name}: {float(row['wall']):.2f} s wall, {float(row['seconds']):.2f} s CPU")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="word that the job's name must contain")
    parser.add_argument("--again", action="store_true", help="measure anew what is there already")
    parser.add_argument("--measure", nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        return measure(options.measure[0], options.measure[1:])
    rows = load()
    for job in [*JOBS, "first call"]:
        if options.only in job and (options.again or job not in {key[0] for key in rows}):
            print(job, file=sys.stderr, flush=True)
            rows |= run(job)
            save(rows)
            rows = load()
    show(rows)


if __name__ == "__main__":
    main()
