"""rlcore.solver.solve beside quantecon, pymdptoolbox and mdpsolver: CPU time, peak memory, true error.

    python benchmarks/dp.py                 every problem and solver that results/dp.csv does not hold yet
    python benchmarks/dp.py --quick         the small problems only
    python benchmarks/dp.py --only grid     problems whose name contains this word
    python benchmarks/dp.py --again         measure anew what is there already
    python benchmarks/dp.py --plot          also draw results/dp.png: time against number of states

Every measurement is a process of its own with one thread: it builds the process, hands it to the solver in the solver's
own form (not timed), solves once for compilers and caches (not counted, unless it takes more than 20 s: then it is the
only one), then for ten seconds again, each time from the start; the least CPU time counts. All are asked for the same
error, 1e-6. The true error is taken against a reference solved by rlcore to a certified 1e-9, or as far as doubles go
(kept in _build/benchmarks).
"""

import argparse
import csv
import datetime
import importlib.metadata
import json
import os
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
RESULTS, REFERENCE = HERE / "results" / "dp.csv", HERE.parent / "_build" / "benchmarks"
TOL = 1e-6
COLUMNS = ["problem", "states", "solver", "status", "seconds", "solves", "build_mb", "peak_mb", "error", "bound"]
COLUMNS += ["date", "cpu", "versions"]
THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
THREADS["PYTHONPATH"] = str(HERE.parent)

# ---------------------------------------------------------------------- problems


def dense(n):
    from rlcore.envs import random_mdp

    return random_mdp(n, 4, rng=np.random.default_rng(n)), 0.99


def sparse(n):
    from rlcore.envs import random_mdp

    return random_mdp(n, 4, n_next=5, concentration=1.0, rng=np.random.default_rng(n)), 0.99


def grid(n):
    """Cost 1 a step to the exits in two corners of an open floor: the span contracts quickly."""
    from rlcore.envs import gridworld

    return gridworld(n, n, slip=0.2), 0.999


def maze(n):
    """The same with a fifth of the cells walled in and one exit: the span contracts no faster than gamma."""
    from rlcore.mdp import FiniteMDP

    open_floor, gamma = grid(n)
    S = n * n
    wall = np.random.default_rng(n).random(S) < 0.2
    wall[[0, S - 1]] = False
    next_state = open_floor.next_state.copy()
    next_state[0] = 0, n, 1, 0  # up, down, right, left: an exit no longer
    here = np.arange(S)[:, None, None]
    next_state = np.where(wall[next_state] | wall[:, None, None], here, next_state)
    prob = np.broadcast_to(open_floor.prob[n + 1], next_state.shape)
    terminal = np.arange(S) == S - 1
    reward = np.where(terminal[:, None, None], 0.0, np.full(prob.shape, -1.0))
    return FiniteMDP(next_state, prob, reward, open_floor.legal, terminal, ~terminal / (S - 1)), gamma


def toy_text(name, **options):
    import gymnasium

    from rlcore.mdp import FiniteMDP

    return FiniteMDP.from_env(gymnasium.make(name, **options)), 0.99


PROBLEMS = {
    **{f"dense {n}": (n, lambda n=n: dense(n)) for n in (100, 300, 1000)},
    **{f"sparse {n}": (n, lambda n=n: sparse(n)) for n in (10**4, 10**5, 10**6)},
    **{f"maze {n}x{n}": (n * n, lambda n=n: maze(n)) for n in (100, 300, 1000)},
    **{f"grid {n}x{n}": (n * n, lambda n=n: grid(n)) for n in (100, 300, 1000)},
    "FrozenLake 8x8": (64, lambda: toy_text("FrozenLake-v1", map_name="8x8")),
    "Taxi": (500, lambda: toy_text("Taxi-v4")),
}
TARGETS = {"dense": [1, 1, 1], "sparse": [1.5] * 3, "maze": [20, 8, 5], "grid": [20, 8, 5], "Frozen": [5], "Taxi": [5]}

# ---------------------------------------------------------------------- solvers
# prepare(mdp, gamma) gives fresh(), which gives solve(), which gives V; only solve() is timed. fresh() matters to
# mdpsolver and pymdptoolbox, whose models otherwise go on from where the last solve stopped.


def rlcore(mdp, gamma):
    from rlcore.solver import solve

    return lambda: lambda: solve(mdp, gamma, TOL)


def pair_rows(mdp):
    """Transition probabilities as a sparse matrix, one row for each (s, a)."""
    from scipy.sparse import csr_matrix

    S, A, K = mdp.prob.shape
    used = mdp.prob.ravel() > 0
    ends = np.concatenate([[0], np.cumsum(used.reshape(-1, K).sum(axis=1))])
    P = csr_matrix((mdp.prob.ravel()[used], mdp.next_state.ravel()[used], ends), shape=(S * A, S))
    P.sum_duplicates()
    return P


def quantecon(method, form):
    def prepare(mdp, gamma):
        from quantecon.markov import DiscreteDP

        S, A = mdp.legal.shape
        if form == "dense":
            process = DiscreteDP(np.where(mdp.legal, mdp.expected_reward(), -np.inf), mdp.transition_probs(), gamma)
        else:
            s, a = np.divmod(np.arange(S * A), A)
            process = DiscreteDP(mdp.expected_reward().ravel(), pair_rows(mdp), gamma, s, a)
        return lambda: lambda: process.solve(method, epsilon=TOL, max_iter=100 if method == "pi" else 10**6).v

    return prepare


def toolbox(method):
    def prepare(mdp, gamma):
        import mdptoolbox.mdp
        from scipy.sparse import csr_matrix

        S, A = mdp.legal.shape
        few = mdp.prob.shape[2] < S / 10
        rows = pair_rows(mdp) if few else mdp.transition_probs()
        P = [csr_matrix(rows[a::A]) for a in range(A)] if few else np.ascontiguousarray(rows.transpose(1, 0, 2))
        R = mdp.expected_reward()

        def fresh():
            options = {} if method == "PolicyIteration" else {"epsilon": TOL}
            solver = getattr(mdptoolbox.mdp, method)(P, R, gamma, max_iter=10**6, **options)
            return lambda: solver.run() or np.array(solver.V)

        return fresh

    return prepare


def mdpsolver(algorithm, update):
    def prepare(mdp, gamma):
        import mdpsolver

        S, A, K = mdp.prob.shape
        P, R = pair_rows(mdp), mdp.expected_reward().tolist()
        columns, probs = (
            [[x[P.indptr[i] : P.indptr[i + 1]].tolist() for i in range(s * A, s * A + A)] for s in range(S)]
            for x in (P.indices, P.data)
        )

        def fresh():
            model = mdpsolver.model()
            model.mdp(discount=gamma, rewards=R, tranMatProbs=probs, tranMatColumns=columns)

            def solve():
                model.solve(algorithm=algorithm, update=update, tolerance=TOL, parallel=False)
                return np.array(model.getValueVector())

            return solve

        return fresh

    return prepare


SOLVERS = {
    "rlcore solve": rlcore,
    "quantecon mpi": quantecon("mpi", "pairs"),
    "quantecon mpi dense": quantecon("mpi", "dense"),
    "quantecon vi": quantecon("vi", "pairs"),
    "quantecon pi": quantecon("pi", "pairs"),
    "quantecon pi dense": quantecon("pi", "dense"),
    "pymdptoolbox vi": toolbox("ValueIteration"),
    "pymdptoolbox pi": toolbox("PolicyIteration"),
    "mdpsolver mpi": mdpsolver("mpi", "standard"),
    "mdpsolver mpi gs": mdpsolver("mpi", "gs"),
    "mdpsolver vi": mdpsolver("vi", "standard"),
}


def applies(solver, problem):
    """Left out: a sparse form for dense rows, dense forms beyond 1000 states, exact evaluation beyond 10 000."""
    states = PROBLEMS[problem][0]
    if solver.endswith(" dense"):
        return states <= 1000
    if problem.startswith("dense") and solver.startswith("quantecon"):
        return False
    return not (" pi" in solver and states > 10_000)


# ---------------------------------------------------------------------- measuring


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(problem, solver):
    """In a process of its own: solve again and again, print one line of JSON."""
    mdp, gamma = PROBLEMS[problem][1]()
    V_reference = reference(problem, mdp, gamma)
    fresh = SOLVERS[solver](mdp, gamma)
    built, times, begun = peak_mb(), [], time.monotonic()
    while len(times) < 2 or (time.monotonic() - begun < 10 and len(times) < 300):
        solve = fresh()
        begin = time.process_time()
        found = solve()
        times.append(time.process_time() - begin)
        if times[0] > 20 and not solver.startswith("rlcore"):  # compiling is a part of a second: once is enough
            break
    times = times[1:] or times
    V, bound = (found.V, found.bound) if hasattr(found, "V") else (found, None)
    error = float(np.abs(V - V_reference)[~mdp.terminal].max())
    print(
        json.dumps(
            dict(seconds=min(times), solves=len(times), build_mb=built, peak_mb=peak_mb(), error=error, bound=bound)
        )
    )


def reference(problem, mdp, gamma):
    """Values with the smallest certified bound that is quick to have; kept on disk."""
    path = REFERENCE / f"{problem}.npz"
    if not path.exists():
        from rlcore.solver import solve

        found = solve(mdp, gamma, 1e-9)
        REFERENCE.mkdir(parents=True, exist_ok=True)
        np.savez(path, V=found.V, bound=found.bound)
    return np.load(path)["V"]


def run(problem, solver, limit, memory):
    """One row of the table: measured, or why there is none."""
    command = [sys.executable, __file__, "--measure", problem, solver]
    row = dict(problem=problem, states=PROBLEMS[problem][0], solver=solver, status="ok")
    row |= dict(date=datetime.date.today().isoformat(), cpu=processor(), versions=versions(solver))
    ahead = lambda: resource.setrlimit(resource.RLIMIT_AS, (memory * 2**30,) * 2)  # noqa: E731
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, env={**os.environ, **THREADS}, preexec_fn=ahead
        )
    except subprocess.TimeoutExpired:
        return row | dict(status=f"over {limit} s")
    if done.returncode == 0:
        return row | json.loads(done.stdout.splitlines()[-1])
    reason = (done.stderr.strip().splitlines() or [f"signal {-done.returncode}"])[-1]
    short = "out of memory" if "emory" in reason or "bad_alloc" in done.stderr else reason[:60]
    return row | dict(status=f"{short} (limit {memory} GiB)" if short == "out of memory" else short)


def processor():
    for line in Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []:
        if line.startswith("model name"):
            return line.split(":")[1].strip()
    return platform.processor()


def versions(solver):
    packages = ["numpy", "numba"] + ([] if solver.startswith("rlcore") else [solver.split()[0]])
    return " ".join(f"{name} {importlib.metadata.version(name)}" for name in packages)


def load():
    if not RESULTS.exists():
        return {}
    with RESULTS.open(newline="") as file:
        return {(row["problem"], row["solver"]): row for row in csv.DictReader(file)}


def save(rows):
    RESULTS.parent.mkdir(exist_ok=True)
    order = {name: i for i, name in enumerate([*PROBLEMS, *SOLVERS])}
    with RESULTS.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for key in sorted(rows, key=lambda key: (order[key[0]], order[key[1]])):
            writer.writerow({name: short(rows[key].get(name, "")) for name in COLUMNS})


def short(value):
    return f"{value:.4g}" if isinstance(value, float) else value


# ---------------------------------------------------------------------- table and figure


def right(row):
    """Solved, and within the error that was asked for (and that the row itself may claim)."""
    return row["status"] == "ok" and float(row["error"]) <= TOL


def show(rows):
    print(f"\n{'problem':16} {'solver':20} {'CPU time':>11} {'ratio':>7} {'peak MB':>8} {'true error':>10}  note")
    for problem in PROBLEMS:
        ours = rows.get((problem, "rlcore solve"))
        for solver in SOLVERS:
            row = rows.get((problem, solver))
            if row is None:
                continue
            if row["status"] != "ok":
                print(f"{problem:16} {solver:20} {'':>11} {'':>7} {'':>8} {'':>10}  {row['status']}")
                continue
            ratio = float(row["seconds"]) / float(ours["seconds"]) if ours and ours["status"] == "ok" else np.nan
            note = f"bound {float(row['bound']):.1e}" if row["bound"] else "" if right(row) else "misses 1e-6"
            print(
                f"{problem:16} {solver:20} {1e3 * float(row['seconds']):8.3f} ms {ratio:7.2f} "
                f"{float(row['peak_mb']):8.0f} {float(row['error']):10.1e}  {note}"
            )
    print(f"\n{'problem':16} {'target':>7} {'quantecon mpi / ours':>21} {'best other that is right / ours':>32}")
    for problem in PROBLEMS:
        ours = rows.get((problem, "rlcore solve"))
        others = {
            s: float(r["seconds"]) for (p, s), r in rows.items() if p == problem and s != "rlcore solve" and right(r)
        }
        if not ours or ours["status"] != "ok" or not others:
            continue
        kind = [name for name in PROBLEMS if name.split()[0] == problem.split()[0]]
        target = next(values for start, values in TARGETS.items() if problem.startswith(start))[kind.index(problem)]
        mpi = min((t for s, t in others.items() if s.startswith("quantecon mpi")), default=np.nan)
        best = min(others, key=others.get)
        a, b = mpi / float(ours["seconds"]), others[best] / float(ours["seconds"])
        print(f"{problem:16} {target:7} {a:21.2f} {b:18.2f} {best}")


def plot(rows):
    """Time against number of states, one panel a kind of problem."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    looks = {
        "rlcore solve": ("#0072B2", "o-"),
        "quantecon mpi": ("#D55E00", "s--"),
        "quantecon mpi dense": ("#D55E00", "s--"),
    }
    looks |= {"mdpsolver mpi": ("#009E73", "^-."), "pymdptoolbox vi": ("#CC79A7", "v:")}
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.4), sharey=True, layout="constrained")
    for ax, kind in zip(axes, ("dense", "sparse", "grid", "maze")):
        for solver, (color, line) in looks.items():
            found = [r for (p, s), r in rows.items() if p.startswith(kind) and s == solver and right(r)]
            found.sort(key=lambda row: int(row["states"]))
            if found:
                x, y = [int(r["states"]) for r in found], [float(r["seconds"]) for r in found]
                ax.loglog(x, y, line, color=color, label=solver.removesuffix(" dense"))
        ax.set(title=kind, xlabel="states")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("CPU seconds for an error of 1e-6")
    axes[1].legend(fontsize=8)
    figure.savefig(RESULTS.with_suffix(".png"), dpi=110)
    print(f"wrote {RESULTS.with_suffix('.png')}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="problems of at most 10 000 states")
    parser.add_argument("--only", default="", help="word that the problem's name must contain")
    parser.add_argument("--solver", default="", help="word that the solver's name must contain")
    parser.add_argument("--again", action="store_true", help="measure anew what is there already")
    parser.add_argument("--limit", type=int, default=900, help="seconds that one process may take")
    parser.add_argument("--memory", type=int, default=12, help="GiB of address space that one process may take")
    parser.add_argument("--plot", action="store_true", help="draw results/dp.png")
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        return measure(*options.measure)
    rows = load()
    for problem, (states, _) in PROBLEMS.items():
        for solver in SOLVERS:
            wanted = options.only in problem and options.solver in solver and applies(solver, problem)
            known = (problem, solver) in rows and not options.again
            if wanted and not known and not (options.quick and states > 10_000):
                print(f"{problem}: {solver}", file=sys.stderr, flush=True)
                rows[problem, solver] = run(problem, solver, options.limit, options.memory)
                save(rows)
                rows = load()
    show(rows)
    if options.plot:
        plot(rows)


if __name__ == "__main__":
    main()
