"""Situations that users report, and what happens now: an error that says what is wrong, or the value that is right.

python benchmarks/situations.py [word ...]      those that have one of these words; all where none is given
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from contextlib import chdir
from pathlib import Path

import gymnasium as gym
import numpy as np
from scipy.sparse import csr_matrix, vstack

from rlcore import PPOConfig, evaluate, load, q_learning, sarsa_lambda, save, solve
from rlcore.dp import policy_iteration, value_iteration
from rlcore.envs import cliff_walking, random_walk, recycling_robot
from rlcore.mdp import FiniteMDP
from rlcore.mpc import fit_linear_dynamics
from rlcore.planning import certainty_equivalent_control, dyna_q
from rlcore.ppo import ppo
from rlcore.td import td0
from rlcore.trust_region import adapt_beta

ROOT = Path(__file__).parents[1]
SITUATIONS = {}
BOX = gym.spaces.Box(-1, 1, (1,), np.float32)


def situation(name):
    return lambda function: SITUATIONS.setdefault(name, function)


def rng():
    return np.random.default_rng(0)


class World(gym.Env):
    """Two steps to the end, reward 1 each; what the arguments name is put in the place of what is right."""

    def __init__(self, observations=None, actions=None, first=None, **answer):
        self.observation_space = gym.spaces.Discrete(3) if observations is None else observations
        self.action_space = gym.spaces.Discrete(2) if actions is None else actions
        self.first, self.answer = (0, {}) if first is None else first, answer

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.s = 0
        return self.first

    def step(self, action):
        assert action in self.action_space, f"{action} is not an action"
        self.s += 1
        right = dict(s=self.s, r=1.0, terminated=self.s == 2, truncated=False, info={})
        return tuple(self.answer.get("all") or (right | self.answer).values())


def learn(world, n_episodes=20, gamma=0.9, epsilon=0.1, **settings):
    return q_learning(world, gamma, n_episodes, alpha=0.5, epsilon=epsilon, rng=rng(), **settings)


def environment(name, result=lambda run: run, **odd):
    SITUATIONS[name] = lambda: result(learn(World(**odd)))


environment("an observation of 10**9 in Discrete(3)", s=10**9)
environment("an observation one beyond the end", s=3)
environment("an observation that is a list", s=[1])
START5 = gym.spaces.Discrete(3, start=5)
environment(
    "Discrete(3, start=5): Q", lambda run: run.Q.tolist(), observations=START5, first=(5, {}), s=6, terminated=True
)
environment("actions Discrete(2, start=7)", actions=gym.spaces.Discrete(2, start=7))
environment("a reward of NaN", r=np.nan)
environment("an infinite reward", r=np.inf)
environment("a reward of shape (1,)", r=np.array([1.0]))
environment("a reward that is a word", r="one")
environment("terminated of numpy", terminated=np.True_)
environment("the old reset: an observation alone", first=0)
environment("the old step: four values", all=(1, 1.0, True, {}))
environment("three values", all=(1, 1.0, True))
environment("MultiBinary observations", observations=gym.spaces.MultiBinary(3))
environment("MultiDiscrete actions", actions=gym.spaces.MultiDiscrete([2, 2]))
environment("a Dict of observations", observations=gym.spaces.Dict(x=gym.spaces.Discrete(2)))
environment("a Box of observations for a table", observations=BOX)


@situation("an error inside env.step")
def _():
    class Broken(World):
        def step(self, action):
            return {}["no such key"]

    return learn(Broken())


@situation("a wrapper that doubles rewards: largest Q")
def _():
    return learn(gym.wrappers.TransformReward(World(), lambda r: 2 * r), 500).Q.max().round(3), "of 2 + 0.9 2"


@situation("from_env of a wrapped environment")
def _():
    return FiniteMDP.from_env(gym.wrappers.TransformReward(gym.make("FrozenLake-v1"), lambda r: 2 * r))


@situation("from_env of what has no table (Blackjack)")
def _():
    return FiniteMDP.from_env(gym.make("Blackjack-v1"))


@situation("solve(env), without a FiniteMDP")
def _():
    return solve(gym.make("FrozenLake-v1"), 0.9).V.max().round(3)


@situation("a generator of the environment's own, after a run")
def _():
    env = World()
    env.reset(seed=3)
    before = env.np_random.bit_generator.state
    learn(env)
    return "as before" if env.np_random.bit_generator.state == before else "another one"


STAY = FiniteMDP.from_outcomes({(0, 0): [(1.0, 0, 0.0)], (0, 1): [(1.0, 1, -1.0)]})


@situation("epsilon 0 with stay for 0 or leave for -1")
def _():
    return learn(STAY, 2, 1.0, 0.0)


@situation("the same, max_steps=1000")
def _():
    return learn(STAY, 2, 1.0, 0.0, max_steps=1000)


@situation("dyna_q on a process without an end")
def _():
    return dyna_q(recycling_robot(), 0.9, 2, n_planning=1, alpha=0.1, epsilon=0.1, rng=rng())


@situation("an environment that never ends")
def _():
    return learn(World(s=1, terminated=False), 1)


@situation("sarsa_lambda that diverges on the cliff")
def _():
    return sarsa_lambda(cliff_walking(), 1.0, 0.95, 500, alpha=0.9, epsilon=0.1, rng=rng())


def lake(method):
    mdp = FiniteMDP.from_env(gym.make("FrozenLake-v1", is_slippery=False))
    plan = method(mdp, 1.0)
    returns = evaluate(plan.pi, mdp, 1, max_steps=100, rng=rng()).mean
    return f"V(0) = {plan.V[0]:.0f}, its policy earns {returns:.0f}, converged: {plan.converged}"


CYCLE = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 0.0)], (0, 1): [(1.0, 2, -1.0)], (1, 0): [(1.0, 0, 0.0)]})
for method in (value_iteration, policy_iteration, solve):
    SITUATIONS[f"{method.__name__}: FrozenLake without slip, gamma = 1"] = lambda method=method: lake(method)
    SITUATIONS[f"{method.__name__}: a cycle of reward 0, gamma = 1"] = lambda method=method: method(CYCLE, 1.0)


@situation("certainty_equivalent_control at gamma = 1")
def _():
    return certainty_equivalent_control(cliff_walking(), 1.0, 20, rng=rng())


@situation("solve with rewards of 1e308")
def _():
    return solve(FiniteMDP.from_arrays([[[1.0]]], [[1e308]]), 0.99).V


@situation("the caller writes to his array afterwards")
def _():
    P = np.ones((1, 1, 1))
    mdp = FiniteMDP.from_arrays(P, [[1.0]])
    P[:] = 0.0
    return mdp.prob.ravel(), "writable" if mdp.prob.flags.writeable else "read-only"


@situation("next_state + 2**32")
def _():
    one = np.ones((1, 1, 1))
    return FiniteMDP(np.full((1, 1, 1), 2**32), one, one, np.ones((1, 1), bool), np.zeros(1, bool), np.ones(1))


@situation("terminal=[2, 0, 0] for a mask")
def _():
    return FiniteMDP.from_arrays(np.eye(3)[:, None], np.zeros((3, 1)), terminal=[2, 0, 0])


@situation("a float32 policy")
def _():
    pi = np.full((5, 1), 1, np.float32)
    three = np.full((1, 3), np.float32(1) / np.float32(3))
    mdp = FiniteMDP.from_arrays(np.ones((1, 3, 1)), np.ones((1, 3)))
    return td0(random_walk(3), pi, 1.0, 5, alpha=0.1, rng=rng()), evaluate(three, mdp, 1, max_steps=3, rng=rng()).mean


@situation("rows rounded to four digits")
def _():
    return FiniteMDP.from_arrays([[[0.3333, 0.6666]]] * 2, [[1.0]] * 2)


@situation("the same, normalise=True: a row")
def _():
    return FiniteMDP.from_arrays([[[0.3333, 0.6666]]] * 2, [[1.0]] * 2, normalise=True).prob[0, 0]


CHAIN = np.array([[[0.9, 0.1], [0.5, 0.5]], [[0.2, 0.8], [0.0, 1.0]]])  # (S, A, S)


@situation("sparse models: a list of (S, S), one of (S A, S), dense in either order; V")
def _():
    R = np.array([[1.0, 0.0], [0.0, 2.0]])
    by_action = [csr_matrix(CHAIN[:, a]) for a in range(2)]
    stacked = vstack([csr_matrix(CHAIN[s]) for s in range(2)]).tocsr()
    models = [(by_action, R, "SAS"), (stacked, R, "SAS"), (CHAIN, R, "SAS"), (CHAIN.transpose(1, 0, 2), R, "ASS")]
    return [solve(FiniteMDP.from_arrays(P, R, axes=axes), 0.9).V.round(4).tolist() for P, R, axes in models]


class Target(gym.Env):
    """Name the number that is shown, times `reach`; the reward is minus the distance, as a part of `reach`."""

    def __init__(self, reach, dtype=np.float32):
        self.observation_space, self.reach = BOX, reach
        self.action_space = gym.spaces.Box(-reach, reach, (1,), dtype)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = self.np_random.uniform(-1, 1, 1).astype(np.float32)
        return self.x, {}

    def step(self, action):
        assert action in self.action_space, f"{action} is outside"
        return self.x, -abs(float(self.x[0]) - float(action[0]) / self.reach), True, False, {}


@situation("PPO with actions to +-1, and to +-20: last returns")
def _():
    config = PPOConfig(horizon=256, hidden=(16,), lr=3e-3)
    runs = [ppo(Target(reach), n_steps=5000, config=config, rng=rng()) for reach in (1, 20)]
    return [round(float(run.returns[-500:].mean()), 2) for run in runs]


@situation("a Box of whole numbers for actions")
def _():
    return ppo(Target(3, np.int64), n_steps=512, rng=rng())


@situation("PPO with a horizon of 1")
def _():
    return ppo("CartPole-v1", n_steps=4, config=PPOConfig(horizon=1), rng=rng())


@situation("PPO: saved, loaded and gone on with, beside the same in one process")
def _():
    config, draws = PPOConfig(horizon=128), rng()
    run = ppo("CartPole-v1", n_steps=512, config=config, rng=draws)
    with tempfile.TemporaryDirectory() as folder:
        save({"agent": run.policy, "rng": draws}, f"{folder}/a.rl")
        kept = load(f"{folder}/a.rl")
    ends = [ppo("CartPole-v1", n_steps=512, config=config, agent=agent, rng=draws).policy.net.theta
            for agent, draws in ((run.policy, draws), (kept["agent"], kept["rng"]))]  # fmt: skip
    return "the same bits" if np.array_equal(*ends) else "another agent"


def bytes_of(change):
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        path = Path("a.rl")
        save(learn(cliff_walking()), path)
        path.write_bytes(change(path.read_bytes()))
        return load(path)


SITUATIONS["a saved file that is cut"] = lambda: bytes_of(lambda data: data[: len(data) // 2])
SITUATIONS["a file of something else"] = lambda: bytes_of(lambda data: b"\x80\x04K\x01.")


@situation("Ctrl-C in a compiled loop")
def _():
    learn(cliff_walking(), 1)  # compiles
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    try:
        return learn(cliff_walking(), 10**7)
    except KeyboardInterrupt as stopped:
        late = time.monotonic() - start - 1
        kept = f"interrupted: {stopped.run.interrupted}, Q kept: {stopped.run.Q.any()}"
        return kept, "within a second" if late < 1 else f"after {late:.1f} s"


PROGRAM = """
import numpy as np
from rlcore import q_learning
from rlcore.envs.grids import cliff_walking
print(q_learning(cliff_walking(), 1.0, 20, alpha=.5, epsilon=.1, rng=np.random.default_rng(0)))
"""


def elsewhere(path, **environment):
    env = {**os.environ, "PYTHONPATH": str(path), **environment}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=env, capture_output=True, text=True, cwd="/")
    return (done.stdout or done.stderr).strip().splitlines()[-1]


@situation("numba without a folder that can be written")
def _():
    return elsewhere(ROOT, NUMBA_CACHE_DIR="/proc/none", HOME="/proc/none")


@situation("rlcore from a zip")
def _():
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(f"{folder}/rlcore.zip", "w") as file:
            for path in (ROOT / "rlcore").rglob("*.py"):
                file.write(path, path.relative_to(ROOT))
        return elsewhere(f"{folder}/rlcore.zip")


@situation("adapt_beta after 2,000 quiet rollouts")
def _():
    beta = 1.0
    for _ in range(2000):
        beta = adapt_beta(beta, 0.0, 0.01)
    return beta


@situation("one inf in fit_linear_dynamics")
def _():
    x = rng().normal(size=(50, 2))
    x[3, 1] = np.inf
    return fit_linear_dynamics(x, np.zeros(50, int), x, 2)


@situation("gamma=None")
def _():
    return solve(cliff_walking(), None)


@situation("a flag that is a word: in_place='no'")
def _():
    return value_iteration(cliff_walking(), 0.9, in_place="no")


@situation("dyna_q with Q0 of shape (A,)")
def _():
    return dyna_q(cliff_walking(), 0.9, 2, n_planning=1, alpha=0.1, epsilon=0.1, Q0=np.zeros(4), rng=rng())


def happens(function):
    """What a call gives, or the first line of its error; as if it were an error where it takes more than a minute."""

    def late(signum, frame):
        raise TimeoutError("does not end")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    try:
        found = function()
    except Exception as error:
        return " | ".join([f"{type(error).__name__}: {str(error).splitlines()[0]}", *getattr(error, "__notes__", [])])
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return ", ".join(map(str, found)) if isinstance(found, tuple) else " ".join(str(found).split())


if __name__ == "__main__":
    words = sys.argv[1:]
    for name, function in SITUATIONS.items():
        if not words or any(word in name for word in words):
            print(f"{name}\n    {happens(function)}", flush=True)
