"""Networks: one gradient step of actor and critic beside torch, scikit-learn's digits beside MLPClassifier.

    python benchmarks/nn.py             both jobs, results into results/nn.csv
    python benchmarks/nn.py --quick     fewer rounds and seeds, nothing written

All run in one process with one thread and take turns; CPU time. A step is forward, backward and Adam of a policy
4-64-64-2 and a value 4-64-64-1, minibatch 64, float32; the least time of all rounds counts, each a few steps long, so
that a busy machine disturbs few of them. Digits: 1,347 pictures of 8x8 for training, 450 for testing, the same split
for all who take part in a round; median time and mean accuracy over the seeds.
"""

import argparse
import csv
import datetime
import importlib.metadata
import os
import sys
import time
from pathlib import Path

from dp import THREADS, processor

RESULTS = Path(__file__).resolve().parent / "results" / "nn.csv"
if __name__ == "__main__" and any(os.environ.get(name) != value for name, value in THREADS.items()):
    os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | THREADS)  # numpy reads them when it starts

import numpy as np  # noqa: E402
import torch  # noqa: E402
from sklearn.neural_network import MLPClassifier  # noqa: E402

from rlcore.nn import MLP, sgd  # noqa: E402
from rlcore.optimizers import Adam  # noqa: E402
from rlcore.studies.ch06 import load_digits_28  # noqa: E402
from rlcore.torchnet import TorchNet  # noqa: E402

# ---------------------------------------------------------------------- one gradient step


def steppers():
    """{name: function of no argument that takes one gradient step of both networks}; all start alike."""
    rng = np.random.default_rng(0)
    nets = [MLP([4, 64, 64, n], optimizer=Adam(3e-4), rng=rng) for n in (2, 1)]
    x = rng.standard_normal((64, 4)).astype(np.float32)
    d_outputs = [rng.standard_normal((64, n)).astype(np.float32) / 64 for n in (2, 1)]

    def ours(nets):
        def step():
            for net, d in zip(nets, d_outputs):
                net.forward(x)
                net.step(net.backward(d))

        return step

    def plain(**options):
        modules = [TorchNet.like(net).module for net in nets]
        adams = [torch.optim.Adam(module.parameters(), 3e-4, **options) for module in modules]
        x_, d_ = torch.from_numpy(x), [torch.from_numpy(d) for d in d_outputs]

        def step():
            for module, adam, d in zip(modules, adams, d_):
                adam.zero_grad()
                module(x_).backward(d)
                adam.step()

        return step

    return {
        "rlcore MLP": ours([net.copy() for net in nets]),
        "rlcore TorchNet": ours([TorchNet.like(net) for net in nets]),
        "torch": plain(),
        "torch, fused Adam": plain(fused=True),
    }


def measure_steps(rounds, n=5):
    best = {}
    jobs = steppers()
    for _ in range(rounds):
        for name, step in jobs.items():
            start = time.thread_time()
            for _ in range(n):
                step()
            best[name] = min(best.get(name, np.inf), (time.thread_time() - start) / n)
    return [dict(job="gradient step", implementation=name, microseconds=f"{1e6 * t:.0f}") for name, t in best.items()]


# ---------------------------------------------------------------------- digits


def rlcore_digits(x, labels, x_test, seed):
    rng = np.random.default_rng(seed)
    net = MLP([64, 256, 10], hidden="relu", init="he", optimizer=Adam(0.01), rng=rng)
    sgd(net, x, labels, batch=64, epochs=20, cost="cross_entropy", rng=rng)
    return net.forward(x_test).argmax(axis=1)


def sklearn_digits(x, labels, x_test, seed, **settings):
    return MLPClassifier(random_state=seed, **settings).fit(x, labels).predict(x_test)


SAME = dict(hidden_layer_sizes=(256,), learning_rate_init=0.01, batch_size=64, max_iter=20, alpha=0.0)
LEARNERS = {
    "rlcore MLP": rlcore_digits,
    "MLPClassifier": sklearn_digits,
    "MLPClassifier, our settings": lambda *args: sklearn_digits(*args, **SAME),
}


def measure_digits(seeds):
    seconds, accuracy = {name: [] for name in LEARNERS}, {name: [] for name in LEARNERS}
    for seed in range(100, 100 + seeds):  # our settings were chosen on other splits
        x, labels, x_test, labels_test = load_digits_28(size=8, n_train=1347, rng=np.random.default_rng(seed))
        for name, learn in LEARNERS.items():
            start = time.process_time()
            answer = learn(x, labels, x_test, seed)
            seconds[name].append(time.process_time() - start)
            accuracy[name].append((answer == labels_test).mean())
    return [
        dict(job="digits", implementation=name, seconds=f"{np.median(seconds[name]):.3f}",
             accuracy=f"{np.mean(accuracy[name]):.4f}", least=f"{np.min(accuracy[name]):.4f}", seeds=seeds)
        for name in LEARNERS
    ]  # fmt: skip


# ---------------------------------------------------------------------- table

COLUMNS = ["job", "implementation", "microseconds", "seconds", "accuracy", "least", "seeds", "date", "cpu", "versions"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer rounds and seeds, nothing written")
    quick = parser.parse_args().quick
    torch.set_num_threads(1)
    import warnings

    warnings.filterwarnings("ignore", category=UserWarning)  # MLPClassifier is not content with 20 epochs
    rows = measure_steps(50 if quick else 1000) + measure_digits(3 if quick else 10)
    names = ("numpy", "torch", "scikit-learn")
    versions = " ".join(f"{name} {importlib.metadata.version(name)}" for name in names)
    for row in rows:
        row |= dict(date=datetime.date.today().isoformat(), cpu=processor(), versions=versions)
        result = f"{row['microseconds']} us" if "microseconds" in row else f"{row['seconds']} s  {row['accuracy']}"
        print(f"{row['job']:14} {row['implementation']:28} {result}")
    if not quick:
        with RESULTS.open("w", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
