"""Planning with a learned model, and learning with planning: counts, certainty equivalence, Dyna (chapter 3)."""

import itertools
from collections import Counter, defaultdict, namedtuple
from dataclasses import dataclass

import numpy as np

from rlcore.bellman import check_q
from rlcore.core.checks import (
    check_count,
    check_gamma,
    check_index,
    check_policy,
    check_probability,
    check_rate,
    check_rng,
    check_world,
)
from rlcore.core.compiled import compiled
from rlcore.core.results import PlanningRun
from rlcore.core.sampling import cumulative, draw, step
from rlcore.core.worlds import books
from rlcore.dp import value_iteration
from rlcore.mdp import FiniteMDP, rollout
from rlcore.policies import epsilon_greedy, max_value, soft_greedy


def predict(run, s, a):
    """p(s'|s, a) as (S,) and r(s, a), as the model kept by `run` has them. ex-prediction-test, cl-029

    Raises ValueError where `run` keeps no model, as every model-free method.
    """
    model = getattr(run, "model", None)
    if model is None:
        raise ValueError(f"run: {type(run).__name__} keeps no model, must be the result of a model-based method")
    s, a = check_index("s", s, model.n_states), check_index("a", a, model.n_actions)
    p = np.bincount(model.next_state[s, a], weights=model.prob[s, a], minlength=model.n_states)
    return p, float(model.prob[s, a] @ model.reward[s, a])


# ---------------------------------------------------------------------- a model from counts


@dataclass(frozen=True, eq=False)
class Transitions:
    """Rows (s, a, r, s') in the order in which they happened: integers, integers, floats, integers, each (n,)."""

    s: np.ndarray
    a: np.ndarray
    r: np.ndarray
    s_next: np.ndarray


def sample_transitions(mdp, pi, n_steps, *, rng):
    """n_steps transitions under pi, starting anew after each terminal state. alg-model-learning"""
    pi, n_steps = check_policy(mdp, pi), check_count("n_steps", n_steps)
    return Transitions(*_sample_transitions(mdp.sampler(), cumulative(pi), n_steps, check_rng(rng)))


@compiled
def _sample_transitions(world, pi_cdf, n_steps, rng):
    s, a = np.zeros(n_steps, np.int64), np.zeros(n_steps, np.int64)
    r, s_next = np.zeros(n_steps), np.zeros(n_steps, np.int64)
    state = draw(world.start_cdf, rng)
    for t in range(n_steps):
        if world.terminal[state]:
            state = draw(world.start_cdf, rng)
        s[t], a[t] = state, draw(pi_cdf[state], rng)
        state, r[t] = step(world, state, a[t], rng)
        s_next[t] = state
    return s, a, r, s_next


def estimate_model(data, n_states, n_actions, *, terminal=(), legal=None, start=None, unseen=0.0):
    """The maximum-likelihood FiniteMDP: p(s', r|s, a) is how often (s', r) followed (s, a). alg-model-learning

    data: Transitions. terminal: states that end an episode. legal: (S, A) bool, all where None. start: state or (S,).
    unseen: a pair never tried is taken to stay where it is with this reward; 0 says "nothing to gain there", a reward
    that no state can beat makes the planner try everything once (optimism). Source: Brafman and Tennenholtz (2002).
    """
    S, A = check_count("n_states", n_states), check_count("n_actions", n_actions)
    terminal = {check_index("terminal", s, S) for s in terminal}
    legal = np.ones((S, A), bool) if legal is None else np.asarray(legal, bool)
    if legal.shape != (S, A):
        raise ValueError(f"legal: got shape {legal.shape}, must be {(S, A)}")
    rows = Counter(zip(data.s.tolist(), data.a.tolist(), data.s_next.tolist(), data.r.tolist()))
    outcomes = defaultdict(list)
    for (s, a, s_next, r), count in rows.items():
        if s in terminal or not 0 <= s < S or not 0 <= a < A or not legal[s, a]:
            raise ValueError(f"data: got action {a} in state {s}, must be legal and the state not terminal")
        outcomes[s, a].append((count, s_next, r))
    model = {}
    for s, a in itertools.product(range(S), range(A)):
        if s not in terminal and legal[s, a]:
            seen = outcomes.get((s, a), [(1, s, unseen)])
            total = sum(count for count, _, _ in seen)
            model[s, a] = [(count / total, s_next, r) for count, s_next, r in seen]
    return FiniteMDP.from_outcomes(model, n_states=S, n_actions=A, start=start)


def certainty_equivalent_control(world, gamma, n_episodes, *, epsilon=0.1, unseen=0.0, max_steps=10_000, rng):
    """Estimate the model, plan in it as if it were true, act on the plan for an episode, repeat. alg-ce-planning

    world: FiniteMDP to act in; of it, the method knows A(s) and the terminal states. epsilon: probability of a random
    action. unseen: as in estimate_model. max_steps: an episode is cut there. Returns a PlanningRun; history
    (n_episodes + 1, S, A) holds the Q planned before the first and after each episode.
    """
    gamma, epsilon = check_gamma(gamma), check_probability("epsilon", epsilon)
    S, A = check_world(world).legal.shape
    known = dict(terminal=np.flatnonzero(world.terminal), legal=world.legal, start=world.start, unseen=unseen)
    paths, plan, history = [], None, []
    for _ in range(check_count("n_episodes", n_episodes) + 1):
        model = estimate_model(_transitions(paths), S, A, **known)
        plan = value_iteration(model, gamma, V0=0.0 if plan is None else plan.V)
        history.append(plan.Q)
        paths.append(rollout(world, soft_greedy(plan.Q, epsilon), max_steps, rng=rng))
    paths.pop()
    returns, lengths = [p.rewards.sum() for p in paths], [p.actions.size for p in paths]
    return PlanningRun(np.array(returns), np.array(lengths), plan.V, plan.Q, plan.pi, np.array(history), model)


def _transitions(paths):
    """Transitions of a list of trajectories."""
    parts = [(p.states[:-1], p.actions, p.rewards, p.states[1:]) for p in paths]
    empty = (np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros(0, int))
    return Transitions(*(np.concatenate(columns) for columns in zip(empty, *parts)))


# ---------------------------------------------------------------------- Dyna


def dyna_q(
    world, gamma, n_episodes, *, n_planning, alpha, epsilon, Q0=0.0, kappa=0.0, max_steps=None, change=None, rng
):
    """Q-learning that also replays n_planning remembered transitions after each real one. alg-dyna, fig-12

    world: FiniteMDP. n_planning = 0 is Q-learning, without a model. The model is the last outcome of each pair tried,
    which is right where the world is deterministic. alpha: in (0, 1]. epsilon: probability of a random action.
    Q0: first estimates, a number or (S, A). max_steps: an episode is cut there, as a truncation; None: never.
    kappa: a transition not tried for tau steps is replayed with its reward + kappa sqrt(tau), untried actions of states
    met included (Dyna-Q+). change: (step, FiniteMDP), the world from that step on.
    Returns a PlanningRun; history (n_episodes + 1, S, A). Source: Sutton and Barto (2018), sections 8.2 and 8.3.
    """
    gamma, n_planning, rng = check_gamma(gamma), check_count("n_planning", n_planning, 0), check_rng(rng)
    alpha, epsilon = check_rate(alpha), check_probability("epsilon", epsilon)
    if not kappa >= 0:
        raise ValueError(f"kappa: got {kappa!r}, must be at least 0")
    world = check_world(world)
    at, later = (np.iinfo(np.int64).max, world) if change is None else (check_count("change", change[0], 0), change[1])
    if not np.array_equal(later.legal, world.legal) or not np.array_equal(later.terminal, world.terminal):
        raise ValueError("change: got a world with other actions or terminal states, must have the same")
    max_steps = np.iinfo(np.int64).max if max_steps is None else check_count("max_steps", max_steps)
    Q = check_q(world, np.broadcast_to(np.asarray(Q0, float), world.legal.shape))
    Q[world.terminal] = 0.0
    n_episodes, memory = check_count("n_episodes", n_episodes), _memory(*Q.shape)
    numbers = (at, gamma, n_episodes, n_planning, alpha, epsilon, float(kappa), max_steps)
    returns, lengths, history = _dyna_q(world.sampler(), later.sampler(), *numbers, Q, memory, rng)
    model = _remembered(world, memory) if n_planning else None
    return PlanningRun(returns, lengths, Q.max(axis=1), Q, soft_greedy(Q, 0.0), history, model)


@compiled
def _dyna_q(world, later, change_at, gamma, n_episodes, n_planning, alpha, epsilon, kappa, max_steps, Q, memory, rng):
    (history, returns, lengths), now = books(Q, n_episodes, 1), 0
    for k in range(n_episodes):
        s = draw(world.start_cdf, rng)
        while not world.terminal[s] and lengths[k] < max_steps:
            a = epsilon_greedy(Q, s, epsilon, rng)
            s_next, r = step(world if now < change_at else later, s, a, rng)
            Q[s, a] += alpha * (r + gamma * max_value(Q, s_next) - Q[s, a])  # eq-21
            if memory.next_state[s, a] < 0:  # asked here, not inside: calls with many arrays cost 40 ns
                _remember(memory, Q, s, a, kappa > 0)
            memory.next_state[s, a], memory.reward[s, a], memory.last[s, a] = s_next, r, now
            now += 1
            for _ in range(n_planning):
                i = memory.states[int(rng.random() * memory.n_states[0])]
                b = memory.actions[i, int(rng.random() * memory.n_actions[i])]
                r_model = memory.reward[i, b] + kappa * np.sqrt(now - memory.last[i, b])
                Q[i, b] += alpha * (r_model + gamma * max_value(Q, memory.next_state[i, b]) - Q[i, b])  # eq-21
            returns[k] += r
            lengths[k] += 1
            s = s_next
        history[k + 1] = Q
    return returns, lengths, history


# What Dyna remembers: the last outcome (S, A) of each pair and its time; the states met, (S,), how many; the actions
# taken in each, (S, A), how many. next_state is -1 where nothing is known.
Memory = namedtuple("Memory", "next_state reward last states n_states actions n_actions")


def _memory(S, A):
    counts = [np.zeros(n, np.int64) for n in (S, 1, (S, A), S)]
    return Memory(np.full((S, A), -1, np.int64), np.zeros((S, A)), np.zeros((S, A)), *counts)


@compiled
def _remember(memory, Q, s, a, untried):
    if memory.n_actions[s] == 0:
        memory.states[memory.n_states[0]] = s
        memory.n_states[0] += 1
    for b in range(Q.shape[1]):  # Dyna-Q+ also lists the untried actions: until they are tried they stay and pay 0
        if memory.next_state[s, b] < 0 and (b == a or (untried and Q[s, b] > -np.inf)):
            memory.next_state[s, b] = s
            memory.actions[s, memory.n_actions[s]] = b
            memory.n_actions[s] += 1


def replay(data, n_states, n_actions, gamma, *, alpha, Q0=0.0):
    """Q (S, A) after one pass of Q-learning over recorded transitions, in their order. cl-034, eq-21

    data: Transitions. Whoever chose the actions, they index the updates. States that occur only as s' keep Q0, so that
    with Q0 = 0 terminal states count 0.
    """
    shape = check_count("n_states", n_states), check_count("n_actions", n_actions)
    for name, index, n in (("s", data.s, shape[0]), ("a", data.a, shape[1]), ("s_next", data.s_next, shape[0])):
        if index.size and not 0 <= index.min() <= index.max() < n:
            raise ValueError(f"data: {name} runs from {index.min()} to {index.max()}, must be in 0..{n - 1}")
    Q = np.full(shape, float(Q0))
    _replay(data.s, data.a, data.r, data.s_next, check_gamma(gamma), check_rate(alpha), Q)
    return Q


@compiled
def _replay(s, a, r, s_next, gamma, alpha, Q):
    for t in range(s.size):
        Q[s[t], a[t]] += alpha * (r[t] + gamma * max_value(Q, s_next[t]) - Q[s[t], a[t]])  # eq-21


def _remembered(world, memory):
    """What was remembered as a FiniteMDP; a pair never tried stays with reward 0."""
    known, S = memory.next_state >= 0, world.n_states
    next_state = np.where(known, memory.next_state, np.arange(S)[:, None])[:, :, None]
    prob = (world.legal | world.terminal[:, None]).astype(float)[:, :, None]
    return FiniteMDP(next_state, prob, memory.reward[:, :, None], world.legal, world.terminal, world.start)


# ---------------------------------------------------------------------- a continuous model: least squares, shooting


def fit_linear_dynamics(x, a, x_next, n_actions):
    """W (d + A, d) with x' = [x, one-hot a] W closest to the data in least squares. alg-model-learning, fig-7

    x, x_next: (n, d) states; a: (n,) actions in 0..A-1.
    """
    x, x_next = np.asarray(x, float), np.asarray(x_next, float)
    if x.ndim != 2 or x_next.shape != x.shape or np.shape(a) != x.shape[:1]:
        raise ValueError(f"x: got shapes {x.shape}, {np.shape(a)}, {x_next.shape}, must be (n, d), (n,), (n, d)")
    return np.linalg.lstsq(_features(x, a, n_actions), x_next, rcond=None)[0]


def linear_dynamics(W, x, a):
    """Next states (n, d) that the fitted model W predicts for states x (n, d) and actions a (n,). eq-u-dynamics"""
    return _features(np.asarray(x, float), a, W.shape[0] - W.shape[1]) @ W


def _features(x, a, n_actions):
    return np.hstack([x, np.eye(n_actions)[np.asarray(a, int)]])


def simulate(model, x, actions):
    """States (T + 1, n, d) that n runs of the model visit from x (n, d) under actions (T, n). cl-026, fig-7"""
    path = [np.asarray(x, float)]
    for a in np.asarray(actions):
        path.append(model(path[-1], a))
    return np.array(path)


def random_shooting(model, cost, x, n_actions, *, horizon, n_candidates, rng):
    """First action of the cheapest of n_candidates random plans, each simulated `horizon` steps in the model. alg-mpc

    model(x, a) -> (n, d) next states of n states at once; cost(x) -> (n,) is added up over the states met; x: (d,), the
    state now. Planned anew at each step, this is model-predictive control. Source: Nagabandi et al. (2018).
    """
    shape = check_count("horizon", horizon), check_count("n_candidates", n_candidates)
    plans = (check_rng(rng).random(shape) * check_count("n_actions", n_actions)).astype(int)
    path = simulate(model, np.tile(x, (shape[1], 1)), plans)
    return int(plans[0, sum(cost(states) for states in path[1:]).argmin()])
