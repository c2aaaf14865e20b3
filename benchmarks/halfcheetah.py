"""PPO on HalfCheetah, one detail changed at a time, beside Stable-Baselines3: 100,000 steps, ten seeds and more.

    python benchmarks/halfcheetah.py          what is not done yet, to book/data/halfcheetah.csv: an hour of a core
    python benchmarks/halfcheetah.py table    what the table holds: means, standard errors, differences

Runs are kept in _build/halfcheetah/, one file each: stop when you like, the same command goes on. Settings are those of
benchmarks/ppo.py, which are the PPO paper's; both cut observations at 5. Rows of Stable-Baselines3 are made where it is
installed, and kept where not. `last` is the mean of the last 20 training episodes, `all` that of all 100.
"""

import argparse
import csv
import datetime
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

os.environ |= {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}

import gymnasium as gym  # noqa: E402
import numpy as np  # noqa: E402
from gymnasium.wrappers import NormalizeReward, RecordEpisodeStatistics  # noqa: E402

import rlcore.ppo  # noqa: E402
from rlcore.core.agents import ActorCritic, make_agent  # noqa: E402
from rlcore.core.rollouts import vector_env  # noqa: E402
from rlcore.ppo import PPOConfig, objective_gradient, ppo  # noqa: E402
from rlcore.studies.tables import read  # noqa: E402
from rlcore.sweep import sweep  # noqa: E402

ROOT = Path(__file__).parents[1]
TABLE, STORE = ROOT / "book" / "data" / "halfcheetah.csv", ROOT / "_build" / "halfcheetah"
TASK, N_STEPS, LAST, PEER = "HalfCheetah-v5", 102_400, 20, "Stable-Baselines3"
PEERS_OWN = dict(orthogonal=True, by_minibatch=True, longest=0.5)
DETAILS = {  # name: what differs from rlcore.ppo as it stands
    "rlcore": {},
    "log_std from -0.5": dict(log_std=-0.5),
    "log_std from -1": dict(log_std=-1.0),
    "advantages as they are": dict(normalise_advantages=False),
    "advantages by minibatch": dict(by_minibatch=True),
    "value loss clipped": dict(value_clip=0.2),
    "observations cut at 10": dict(limit=10.0),
    "rewards scaled": dict(scale_rewards=True),
    "orthogonal weights": dict(orthogonal=True),
    "gradients clipped": dict(longest=0.5),
    "the peer's three": PEERS_OWN,
}


class Shortened(ActorCritic):
    """An ActorCritic whose gradients together are no longer than longest."""

    def step(self, d_policy, d_values):
        parts = self.net.backward(d_policy[0]), self.critic.backward(d_values[:, None]), d_policy[1].sum(axis=0)
        share = min(1.0, self.longest / np.sqrt(sum(float(part @ part) for part in parts)))
        self.net.step(share * parts[0])
        self.critic.step(share * parts[1])
        self.log_std_optimizer.update(self.log_std, share * parts[2])


def orthogonal(net, last, rng):
    """Rows of each layer at right angles, of length sqrt(2), in the last layer of another length."""
    for weights in net.weights:
        size = last if weights is net.weights[-1] else np.sqrt(2)
        q, r = np.linalg.qr(rng.normal(size=(max(weights.shape), min(weights.shape))))
        q *= np.sign(np.diag(r))
        weights[:] = size * (q if weights.shape[0] >= weights.shape[1] else q.T)


def improve_with(by_minibatch, value_clip):
    """rlcore.ppo.improve with advantages scaled in each minibatch, or with a value loss clipped as ratios are."""

    def improve(agent, data, config, beta, rng):
        x, actions, advantage, target = data
        old, old_values = agent.forward(x)
        old_log_prob = old.log_prob(actions)
        for _ in range(config.epochs):
            order = rng.permutation(len(x))
            for i in range(0, len(x), config.minibatch):
                b = order[i : i + config.minibatch]
                A, (policy, v) = advantage[b], agent.forward(x[b])
                if by_minibatch:
                    A = (A - A.mean()) / (A.std() + 1e-8)
                (d_mean, d_log_std), _ = objective_gradient.unchecked(
                    policy, None, actions[b], old_log_prob[b], A, config
                )
                error = v - target[b]
                if value_clip:
                    moved = np.clip(v - old_values[b], -value_clip, value_clip)
                    error[(old_values[b] + moved - target[b]) ** 2 > error**2] = 0  # the larger loss is the flat one
                agent.step((-d_mean, -d_log_std), 2 * config.c1 / error.size * error)
        new, _ = agent.forward(x)
        return float(old.kl(new).mean()), 0.0, 0.0, float(new.entropy().mean()), 0.0

    return improve


def ours(detail, rng):
    """rlcore.ppo with one detail changed."""
    if detail == PEER:
        return peer(rng)
    changed = DETAILS[detail]
    env = RecordEpisodeStatistics(gym.make(TASK, disable_env_checker=True), buffer_length=1000)
    world = NormalizeReward(env, gamma=0.99) if changed.get("scale_rewards") else env
    scaled = changed.get("normalise_advantages", not changed.get("by_minibatch"))
    config = PPOConfig(normalise_observations=True, normalise_advantages=scaled)
    agent = make_agent(vector_env(world), config, None, None, rng)
    agent.log_std[:] = changed.get("log_std", 0.0)
    agent.normaliser.limit = changed.get("limit", agent.normaliser.limit)
    if changed.get("orthogonal"):
        orthogonal(agent.net, 0.01, rng)
        orthogonal(agent.critic, 1.0, rng)
    if "longest" in changed:
        agent.__class__, agent.longest = Shortened, changed["longest"]
    own = rlcore.ppo.improve
    try:
        if changed.get("by_minibatch") or changed.get("value_clip"):
            rlcore.ppo.improve = improve_with(changed.get("by_minibatch"), changed.get("value_clip"))
        ppo(world, rng=rng, n_steps=N_STEPS, config=config, agent=agent)
    finally:
        rlcore.ppo.improve = own
    return outcome(env.return_queue)


def peer(rng):
    """Stable-Baselines3 with the same settings, and with what it does otherwise by default."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(1)
    seed = int(rng.integers(2**31))
    settings = dict(n_steps=2048, batch_size=64, n_epochs=10, learning_rate=3e-4, gamma=0.99, gae_lambda=0.95)
    inner = make_vec_env(TASK, n_envs=1, seed=seed)
    env = VecNormalize(inner, norm_reward=False, clip_obs=5.0)
    PPO("MlpPolicy", env, seed=seed, device="cpu", **settings).learn(N_STEPS)
    return outcome(inner.envs[0].get_episode_rewards())


def outcome(returns):
    returns = np.array(returns, float)
    return {"last": returns[-LAST:].mean(), "all": returns.mean()}


def main():
    """A few seeds of everything, then the others."""
    for n_seeds in (5, 10, 20):
        names = [dict(detail=name) for name in (["rlcore"] if n_seeds == 20 else DETAILS)]
        records = sweep(ours, names, range(n_seeds), STORE, progress=True)
        if n_seeds <= 10 and installed("stable-baselines3"):
            records += sweep(ours, [dict(detail=PEER)], range(n_seeds), STORE, progress=True)
        write(record for record in records if record.error is None)


def write(records):
    """The table with these runs in it; its first lines say where the numbers come from."""
    rows = {(row["detail"], row["seed"]): row for row in read(TABLE)}
    rows |= {(r.setting["detail"], r.seed): r.setting | dict(seed=r.seed) | r.result for r in records}
    order = [*DETAILS, PEER]
    names = ("numpy", "gymnasium", "mujoco", "torch", "stable-baselines3")
    packages = ", ".join(f"{name} {installed(name)}" for name in names if installed(name))
    with open(TABLE, "w", newline="", encoding="utf-8") as file:
        file.write(f"# python benchmarks/halfcheetah.py, {datetime.date.today()}\n")
        file.write(f"# Python {platform.python_version()}, {packages}; rng = default_rng(seed)\n")
        out = csv.DictWriter(file, ["detail", "seed", "last", "all"], lineterminator="\n")
        out.writeheader()
        for row in sorted(rows.values(), key=lambda row: (order.index(row["detail"]), row["seed"])):
            out.writerow(row | {key: f"{row[key]:.5g}" for key in ("seed", "last", "all")})


def installed(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def show():
    rows = read(TABLE)
    print(f"{'detail':26}{'runs':>5}{'last':>7}{'error':>7}{'to rlcore':>11}{'error':>7}{'all':>7}{'error':>7}")
    of = {name: [row for row in rows if row["detail"] == name] for name in dict.fromkeys(row["detail"] for row in rows)}
    for name, runs in of.items():
        last, whole = (mean_and_error([row[key] for row in runs]) for key in ("last", "all"))
        base = mean_and_error([row["last"] for row in of["rlcore"]])
        apart, error = last[0] - base[0], np.hypot(last[1], base[1])
        print(
            f"{name:26}{len(runs):5}{last[0]:7.0f}{last[1]:7.0f}{apart:11.0f}{error:7.0f}{whole[0]:7.0f}{whole[1]:7.0f}"
        )


def mean_and_error(x):
    return np.mean(x), np.std(x, ddof=1) / np.sqrt(len(x))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="?", choices=["run", "table"], default="run")
    try:
        if parser.parse_args().what == "run":
            main()
        show()
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on from here")
