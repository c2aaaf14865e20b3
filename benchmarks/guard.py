"""What the guard around an environment costs: Q-learning as it is called, beside the same loop without it.

    python benchmarks/guard.py                  four tasks, about a minute and a half of CPU time
    python benchmarks/guard.py --rounds 1000    steadier ratios

Four take turns in one process: `q_learning` on the environment (guarded); the same body, each function of it the same,
on the environment itself, whose answers nobody looks at (bare); that body written out in plain Python, with our choice
of actions (plain); and a loop as tutorials write it, with np.argmax (tutorial). The first three must end with the same
Q, all bits equal. CPU time a step, the least of all rounds; the order changes from round to round. The first ratio,
with its median over the rounds, is what the guard costs; the others, what learning in an environment costs beside a
loop that one writes.
"""

import argparse
import time

import gymnasium
import numpy as np

from rlcore import q_learning
from rlcore.core.learner import interpreted, log
from rlcore.core.schedules import constant
from rlcore.policies import epsilon_greedy, max_value

TASKS = {"CliffWalking-v1": 120, "FrozenLake-v1": 900, "FrozenLake8x8-v1": 180, "Taxi-v4": 24}  # episodes a turn
GAMMA, ALPHA, EPSILON, MAX_STEPS = 0.99, 0.5, 0.1, 200


def guarded(env, n_episodes):
    options = dict(alpha=ALPHA, epsilon=EPSILON, max_steps=MAX_STEPS, rng=np.random.default_rng(0))
    run = q_learning(env, GAMMA, n_episodes, **options)
    return run.Q, int(run.lengths.sum())


def bare(env, n_episodes):
    rng = np.random.default_rng(0)
    env.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    env.unwrapped.np_random = rng
    step = env.step
    changes = dict(
        reset=lambda env, rng: env.reset()[0], act=lambda env, s, a, rng: step(a)[:4], note=lambda *_: False, log=log
    )
    Q0, schedules = np.zeros((env.observation_space.n, env.action_space.n)), (constant(ALPHA), constant(EPSILON))
    loop = interpreted(q_learning.loop, **changes)
    found = loop(env, GAMMA, n_episodes, *schedules, Q0, MAX_STEPS, 0, None, rng)
    return found[0], int(found[2].sum())


def plain(env, n_episodes, choose=epsilon_greedy.__wrapped__, best=max_value):
    """The body of q_learning, written out."""
    rng = np.random.default_rng(0)
    env.reset(seed=int(rng.spawn(1)[0].integers(2**31)))
    env.unwrapped.np_random = rng
    Q = np.zeros((env.observation_space.n, env.action_space.n))
    N, returns, lengths = np.zeros(Q.shape, np.int64), np.zeros(n_episodes), np.zeros(n_episodes, np.int64)
    for k in range(n_episodes):
        s, done = env.reset()[0], False
        while not done:
            a = choose(Q, s, EPSILON, rng)
            s_next, r, terminated, truncated, _ = env.step(a)
            Q[s, a] += ALPHA * (r + GAMMA * best(Q, s_next) * (1 - terminated) - Q[s, a])
            N[s, a] += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == MAX_STEPS
    return Q, int(lengths.sum())


def tutorial(env, n_episodes):
    rng, steps = np.random.default_rng(0), 0
    Q = np.zeros((env.observation_space.n, env.action_space.n))
    for _ in range(n_episodes):
        (s, _), done, t = env.reset(), False, 0
        while not done:
            a = env.action_space.sample() if rng.random() < EPSILON else int(np.argmax(Q[s]))
            s_next, r, terminated, truncated, _ = env.step(a)
            Q[s, a] += ALPHA * (r + GAMMA * np.max(Q[s_next]) * (not terminated) - Q[s, a])
            t += 1
            s, done = s_next, terminated or truncated or t == MAX_STEPS
        steps += t
    return Q, steps


WAYS = [guarded, bare, plain, tutorial]


def measure(task, n_episodes, rounds):
    """CPU seconds a step, (rounds, 4)."""
    env = gymnasium.make(task)
    (Q, steps), *others = [way(env, n_episodes) for way in WAYS[:3]]
    assert all(np.array_equal(Q, other) and steps == n for other, n in others)
    times = np.zeros((rounds, len(WAYS)))
    for i in range(rounds):
        for j in np.roll(range(len(WAYS)), i):
            begin = time.process_time()
            _, steps = WAYS[j](env, n_episodes)
            times[i, j] = (time.process_time() - begin) / steps
    return times


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=70)
    rounds = parser.parse_args().rounds
    print(
        f"{'us a step':18}" + "".join(f"{way.__name__:>9}" for way in WAYS),
        " guarded / bare (median), / plain, / tutorial",
    )
    for task, n_episodes in TASKS.items():
        times = measure(task, n_episodes, rounds)
        least = 1e6 * times.min(axis=0)
        ratios, middle = least[0] / least[1:], np.median(times[:, 0] / times[:, 1])
        print(f"{task:18}" + "".join(f"{t:9.2f}" for t in least), end="")
        print(f"{ratios[0]:15.3f} ({middle:.3f}) {ratios[1]:10.3f} {ratios[2]:10.3f}", flush=True)


if __name__ == "__main__":
    main()
