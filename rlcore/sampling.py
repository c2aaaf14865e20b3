"""Where to spend updates: along trajectories, or evenly over all pairs (section 2.3)."""

from dataclasses import dataclass

import numpy as np

from rlcore.compiled import compiled
from rlcore.mdp import check_count, check_gamma, check_probability, draw, step
from rlcore.planning import epsilon_greedy, max_value


@dataclass(frozen=True, eq=False)
class Updates:
    """Q (S, A); visits (S, A), how often each pair was updated; history (n_updates // record + 1, S, A), Q_0 first."""

    Q: np.ndarray
    visits: np.ndarray
    history: np.ndarray


def spread_updates(mdp, gamma, n_updates, *, where, epsilon=0.1, record=1, rng):
    """n_updates backups (17), each of one pair, with the choice of pairs as the only difference. cl-022

    where: "trajectory" updates the pairs that an epsilon-greedy agent meets, from the start state to the end and again;
    "uniform" draws every pair outside terminal states equally often. Source: Sutton and Barto (2018), section 8.6.
    """
    if where not in ("trajectory", "uniform"):
        raise ValueError(f'where: got {where!r}, must be "trajectory" or "uniform"')
    epsilon = check_probability("epsilon", epsilon)
    n_updates, record = check_count("n_updates", n_updates), check_count("record", record)
    pairs = np.argwhere(mdp.legal & ~mdp.terminal[:, None])
    Q0 = np.where(mdp.legal, 0.0, -np.inf)
    follow = where == "trajectory"
    arguments = (mdp.sampler(), mdp.prob, pairs, Q0, check_gamma(gamma), n_updates, epsilon, follow, record, rng)
    return Updates(*_spread_updates(*arguments))


@compiled
def _spread_updates(world, prob, pairs, Q0, gamma, n_updates, epsilon, follow, record, rng):
    Q, visits = Q0.copy(), np.zeros(Q0.shape, np.int64)
    history = np.zeros((n_updates // record + 1, *Q0.shape))
    history[0] = Q
    s = draw(world.start_cdf, rng)
    for i in range(n_updates):
        if follow:
            a = epsilon_greedy(Q, s, epsilon, rng)
        else:
            j = int(rng.random() * len(pairs))
            s, a = pairs[j, 0], pairs[j, 1]
        q = 0.0
        for k in range(prob.shape[2]):
            if prob[s, a, k] > 0:
                q += prob[s, a, k] * (world.reward[s, a, k] + gamma * max_value(Q, world.next_state[s, a, k]))
        Q[s, a] = q  # eq-17
        visits[s, a] += 1
        if (i + 1) % record == 0:
            history[(i + 1) // record] = Q
        if follow:
            s, _ = step(world, s, a, rng)
            if world.terminal[s]:
                s = draw(world.start_cdf, rng)
    return Q, visits, history
