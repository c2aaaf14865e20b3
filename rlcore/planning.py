"""Planning with a learned model, and learning with planning: counts, certainty equivalence, Dyna (chapter 3)."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict, namedtuple
from dataclasses import dataclass

import numpy as np

from rlcore.core.checks import (
    as_flags,
    as_integers,
    check_count,
    check_finite,
    check_index,
    check_nonnegative,
    check_probability,
    check_world,
    finite,
    model_of,
    show,
    spaces,
)
from rlcore.core.compiled import compiled
from rlcore.core.learner import learner, log, note
from rlcore.core.results import PlanningRun
from rlcore.core.rules import anything, checked, count, index, sized, takes_none
from rlcore.core.sampling import draw, step
from rlcore.core.schedules import at, constant, now
from rlcore.core.types import ArrayLike, Floats, OnEpisode, Rate, Rng, World
from rlcore.core.worlds import act, reset
from rlcore.dp import value_iteration
from rlcore.mdp import FiniteMDP, rollout
from rlcore.policies import control, epsilon_greedy, max_value, soft_greedy
from rlcore.td import td_error


def _with_a_model(name, run, given):
    if getattr(run, "model", None) is None:
        raise ValueError(f"{name}: {type(run).__name__} keeps no model, must be the result of a model-based method")
    return run


@checked(
    run=_with_a_model, s=index(lambda given: given["run"].model.n_states),
    a=index(lambda given: given["run"].model.n_actions),
)  # fmt: skip
def predict(run: PlanningRun, s: int, a: int) -> tuple[Floats, float]:
    """What the model kept by `run` says will follow.

    Parameters
    ----------
    run : PlanningRun
        A run of a method that keeps its model.
    s : int
        The state.
    a : int
        The action.

    Returns
    -------
    tuple[Floats, float]
        p(s'|s, a), (S,), and r(s, a).

    Raises
    ------
    ValueError
        Where `run` keeps no model, as every model-free method.

    Notes
    -----
    Ledger: ex-prediction-test, cl-029.
    """
    model = run.model
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


@learner(lambda given, *found: Transitions(*found), world=check_world)
def sample_transitions(world: World, pi: ArrayLike, n_steps: int, *, rng: Rng) -> Transitions:
    """Transitions under pi, starting anew after each terminal state.

    Parameters
    ----------
    world : World
        The process.
    pi : ArrayLike
        (S, A), the policy; rows sum to 1.
    n_steps : int
        Number of steps.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    Transitions
        (s, a, r, s') of each step.

    Notes
    -----
    Ledger: alg-model-learning.
    """
    s, a = np.zeros(n_steps, np.int64), np.zeros(n_steps, np.int64)
    r, s_next = np.zeros(n_steps), np.zeros(n_steps, np.int64)
    state = reset(world, rng)
    for t in range(n_steps):
        if world.terminal[state]:
            state = reset(world, rng)
        s[t], a[t] = state, draw(pi[state], rng)
        state, r[t] = step(world, state, a[t], rng)
        s_next[t] = state
    return s, a, r, s_next


def _recorded(name, data, given):
    """The rule of recorded Transitions; `_within` looks at how many states and actions they are of."""
    if not isinstance(data, Transitions):
        raise ValueError(f"{name}: got {show(data)}, must be Transitions")
    kinds = dict(s=as_integers, a=as_integers, r=finite, s_next=as_integers)
    columns = [kind(f"{name}: {column}", getattr(data, column)) for column, kind in kinds.items()]
    if columns[0].ndim != 1 or len({column.shape for column in columns}) > 1:
        raise ValueError(f"{name}: got columns of shapes {[x.shape for x in columns]}, must be (n,) each")
    return Transitions(*columns)


def _within(data, n_states, n_actions):
    for name, column, n in (("s", data.s, n_states), ("a", data.a, n_actions), ("s_next", data.s_next, n_states)):
        if column.size and not 0 <= column.min() <= column.max() < n:
            raise ValueError(f"data: {name} runs from {column.min()} to {column.max()}, must be in 0..{n - 1}")


def _some_states(name, states, given):
    if not hasattr(states, "__iter__"):
        raise ValueError(f"{name}: got {show(states)}, must be a list of states")
    return {check_index(name, s, given["n_states"]) for s in states}


def _legal(name, legal, given):
    legal, shape = as_flags(name, legal), (given["n_states"], given["n_actions"])
    if legal.shape != shape:
        raise ValueError(f"{name}: got shape {legal.shape}, must be {shape}")
    return legal


@checked(data=_recorded, n_actions=sized("n_states"), terminal=_some_states, legal=_legal, start=anything)
def estimate_model(
    data: Transitions, n_states: int, n_actions: int, *, terminal: ArrayLike = (), legal: ArrayLike | None = None,
    start: ArrayLike | None = None, unseen: float = 0.0,
) -> FiniteMDP:  # fmt: skip
    """The maximum-likelihood FiniteMDP: p(s', r|s, a) is how often (s', r) followed (s, a).

    Parameters
    ----------
    data : Transitions
        What was tried, as `sample_transitions` gives it.
    n_states : int
        Number of states, S.
    n_actions : int
        Number of actions, A.
    terminal : ArrayLike
        States that end an episode.
    legal : ArrayLike | None
        (S, A) bool, all where None.
    start : ArrayLike | None
        A state, or (S,).
    unseen : float
        A pair never tried is taken to stay where it is with this reward; 0 says "nothing to gain there", a reward that
        no state can beat makes the planner try everything once (optimism).

    Returns
    -------
    FiniteMDP
        The model, a process of its own.

    Notes
    -----
    Ledger: alg-model-learning.

    References
    ----------
    Brafman and Tennenholtz (2002).

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import estimate_model
    >>> from rlcore.envs.small import random_walk
    >>> from rlcore.planning import sample_transitions
    >>> data = sample_transitions(random_walk(3), np.ones((5, 1)), 100, rng=np.random.default_rng(0))
    >>> estimate_model(data, 5, 1, terminal=[0, 4])
    FiniteMDP(5 states, 1 actions, 2 outcomes, 2 terminal)
    """
    _within(data, n_states, n_actions)
    legal = np.ones((n_states, n_actions), bool) if legal is None else legal
    rows = Counter(zip(data.s.tolist(), data.a.tolist(), data.s_next.tolist(), data.r.tolist()))
    outcomes = defaultdict(list)
    for (s, a, s_next, r), times in rows.items():
        if s in terminal or not legal[s, a]:
            raise ValueError(f"data: got action {a} in state {s}, must be legal and the state not terminal")
        outcomes[s, a].append((times, s_next, r))
    model = {}
    for s, a in itertools.product(range(n_states), range(n_actions)):
        if s not in terminal and legal[s, a]:
            seen = outcomes.get((s, a), [(1, s, unseen)])
            total = sum(times for times, _, _ in seen)
            model[s, a] = [(times / total, s_next, r) for times, s_next, r in seen]
    return FiniteMDP.from_outcomes(model, n_states=n_states, n_actions=n_actions, start=start)


def _below_one(name, gamma, given):
    if check_probability(name, gamma) == 1:
        raise ValueError(f"{name}: got 1, must be below 1: pairs that were never tried lead nowhere in the model")
    return float(gamma)


@checked(world=check_world, gamma=_below_one)
def certainty_equivalent_control(
    world: FiniteMDP, gamma: float, n_episodes: int, *, epsilon: Rate = 0.1, unseen: float = 0.0,
    max_steps: int = 10_000, record: int = 0, rng: Rng,
) -> PlanningRun:  # fmt: skip
    """Estimate the model, plan in it as if it were true, act on the plan for an episode, repeat.

    Parameters
    ----------
    world : FiniteMDP
        The process to act in; of it, the method knows A(s) and the terminal states.
    gamma : float
        Discount, in [0, 1): pairs that were never tried lead nowhere in the model.
    n_episodes : int
        Number of episodes.
    epsilon : Rate
        Probability of a random action.
    unseen : float
        As in estimate_model.
    max_steps : int
        An episode is cut there.
    record : int
        history keeps the Q planned before the first and after each record-th episode; 0 keeps none.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    PlanningRun
        It keeps its model, for `predict`.

    Notes
    -----
    Ledger: alg-ce-planning.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import certainty_equivalent_control
    >>> from rlcore.envs.grids import dyna_maze
    >>> run = certainty_equivalent_control(dyna_maze(), 0.95, 10, rng=np.random.default_rng(0))
    >>> bool(run.lengths[-1] < run.lengths[0])
    True
    """
    S, A = world.legal.shape
    known = dict(terminal=np.flatnonzero(world.terminal), legal=world.legal, start=world.start, unseen=unseen)
    paths, plan, history = [], None, []
    for k in range(n_episodes + 1):
        model = estimate_model(_transitions(paths), S, A, **known)
        plan = value_iteration(model, gamma, V0=0.0 if plan is None else plan.V)
        if record and k % record == 0:
            history.append(plan.Q)
        paths.append(rollout(world, soft_greedy(plan.Q, epsilon), max_steps, rng=rng))
    paths.pop()
    returns, lengths = [p.rewards.sum() for p in paths], [p.actions.size for p in paths]
    history = np.array(history) if record else None
    planned = dict(V=plan.V, Q=plan.Q, policy=plan.pi, history=history, model=model)
    return PlanningRun(np.array(returns), np.array(lengths), **planned)


def _transitions(paths):
    """Transitions of a list of trajectories."""
    parts = [(p.states[:-1], p.actions, p.rewards, p.states[1:]) for p in paths]
    empty = (np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros(0, int))
    return Transitions(*(np.concatenate(columns) for columns in zip(empty, *parts)))


# ---------------------------------------------------------------------- Dyna

# What Dyna remembers: the last outcome (S, A) of each pair, whether it ended the episode, and its time; the states met,
# (S,), how many; the actions taken in each, (S, A), how many. next_state is -1 where nothing is known.
Memory = namedtuple("Memory", "next_state reward ended last states n_states actions n_actions")


@compiled
def empty_memory(S: int, A: int) -> Memory:
    """A Memory of nothing."""
    return Memory(
        np.full((S, A), -1), np.zeros((S, A)), np.zeros((S, A), np.bool_), np.zeros((S, A)), np.zeros(S, np.int64),
        np.zeros(1, np.int64), np.zeros((S, A), np.int64), np.zeros(S, np.int64),
    )  # fmt: skip


@compiled
def remember(memory: Memory, Q: Floats, s: int, a: int, untried: bool) -> None:
    """List the pair (s, a), which was never tried before, and with `untried` the other actions of s."""
    if memory.n_actions[s] == 0:
        memory.states[memory.n_states[0]] = s
        memory.n_states[0] += 1
    for b in range(Q.shape[1]):  # Dyna-Q+ also lists the untried actions: until they are tried they stay and pay 0
        if memory.next_state[s, b] < 0 and (b == a or (untried and Q[s, b] > -np.inf)):
            memory.next_state[s, b] = s
            memory.actions[s, memory.n_actions[s]] = b
            memory.n_actions[s] += 1


NEVER = np.iinfo(np.int64).max


@takes_none
def _change(name, change, given):
    """The rule of a world to come: (step, FiniteMDP) with the same actions and terminal states."""
    world = given["world"]
    if change is None:
        return NEVER, world.sampler() if isinstance(world, FiniteMDP) else None
    if not isinstance(change, (tuple, list)) or len(change) != 2 or not isinstance(change[1], FiniteMDP):
        raise ValueError(f"{name}: got {show(change)}, must be (step, FiniteMDP)")
    step, later = check_count(name, change[0], 0), change[1]
    if not np.array_equal(later.legal, check_world("world", world).legal) or (later.terminal != world.terminal).any():
        raise ValueError(f"{name}: got a world with other actions or terminal states, must have the same")
    return step, later.sampler()


def _with_model(given, Q, returns, lengths, history, visits, memory):
    given = given | {"epsilon": constant(0.0)}  # the policy it found, not the one that explored
    model = _remembered(given["world"], memory) if given["n_planning"] else None
    return control(given, Q, returns, lengths, history, visits, kind=PlanningRun, model=model)


@learner(_with_model, n_planning=count(0), kappa=check_nonnegative, change=_change)
def dyna_q(
    world: World, gamma: float, n_episodes: int, *, n_planning: int, alpha: Rate, epsilon: Rate, Q0: ArrayLike = 0.0,
    kappa: float = 0.0, max_steps: int | None = None, change: tuple[int, FiniteMDP] | None = None, record: int = 0,
    on_episode: OnEpisode | None = None, rng: Rng,
) -> PlanningRun:  # fmt: skip
    """Q-learning that also replays n_planning remembered transitions after each real one.

    n_planning = 0 is Q-learning, without a model. The model is the last outcome of each pair tried, which is right
    where the world is deterministic.

    Parameters
    ----------
    world : World
        FiniteMDP, gymnasium environment with numbered states and actions, or its id.
    gamma : float
        Discount, in [0, 1].
    n_episodes : int
        Number of episodes.
    n_planning : int
        Remembered transitions that are replayed after each real one.
    alpha : Rate
        Step size in (0, 1], or decaying(...).
    epsilon : Rate
        Probability of a random action, or decaying(...).
    Q0 : ArrayLike
        First estimates, a number or (S, A).
    kappa : float
        A transition not tried for tau steps is replayed with its reward + kappa sqrt(tau), untried actions of states
        met included (Dyna-Q+).
    max_steps : int | None
        An episode is cut there, as a truncation; None: a million steps.
    change : tuple[int, FiniteMDP] | None
        (step, FiniteMDP), the world from that step on.
    record : int
        history keeps Q before the first and after each record-th episode; 0 keeps none.
    on_episode : OnEpisode | None
        on_episode(return, steps so far) is called after each episode; True ends the run. Interpreted, not compiled.
    rng : Rng
        Source of all that is random.

    Returns
    -------
    PlanningRun
        The policy is greedy in the last Q.

    Notes
    -----
    Ledger: alg-dyna, fig-12.

    References
    ----------
    Sutton and Barto (2018), sections 8.2 and 8.3.

    Examples
    --------
    >>> import numpy as np
    >>> from rlcore import dyna_q
    >>> from rlcore.envs.grids import dyna_maze
    >>> rng = np.random.default_rng(0)
    >>> run = dyna_q(dyna_maze(), 0.95, 20, n_planning=20, alpha=0.5, epsilon=0.1, rng=rng)
    >>> bool(run.lengths[-1] < 40)
    True
    """
    Q, N, memory, t = Q0, np.zeros(Q0.shape, np.int64), empty_memory(*Q0.shape), 0
    returns, lengths, history = log(Q, n_episodes, record)
    for k in range(n_episodes):
        s, done = reset(world, rng), False
        while not done:
            a = epsilon_greedy(Q, s, now(epsilon, k, t), rng)
            s_next, r, terminated, truncated = act(world if t < change[0] else change[1], s, a, rng)
            Q[s, a] += at(alpha, N[s, a]) * td_error(r, Q[s, a], max_value(Q, s_next), gamma, terminated)  # eq-21
            N[s, a] += 1
            if memory.next_state[s, a] < 0:  # asked here, not inside: calls with many arrays cost 40 ns
                remember(memory, Q, s, a, kappa > 0)
            memory.next_state[s, a], memory.reward[s, a], memory.last[s, a] = s_next, r, t
            memory.ended[s, a] = terminated
            t += 1
            for _ in range(n_planning):
                i = memory.states[int(rng.random() * memory.n_states[0])]
                b = memory.actions[i, int(rng.random() * memory.n_actions[i])]
                r_model = memory.reward[i, b] + kappa * np.sqrt(t - memory.last[i, b])
                V_next = max_value(Q, memory.next_state[i, b])
                Q[i, b] += at(alpha, N[i, b]) * td_error(r_model, Q[i, b], V_next, gamma, memory.ended[i, b])  # eq-21
                N[i, b] += 1
            returns[k] += r
            lengths[k] += 1
            s, done = s_next, terminated or truncated or lengths[k] == max_steps
        if note(world, history, Q, k, record):
            break
    return Q, returns, lengths, history, N, memory


@checked(data=_recorded, n_actions=sized("n_states"), Q0=check_finite)
def replay(
    data: Transitions, n_states: int, n_actions: int, gamma: float, *, alpha: float, Q0: ArrayLike = 0.0
) -> Floats:
    """One pass of Q-learning over recorded transitions, in their order.

    Whoever chose the actions, they index the updates. States that occur only as s' keep Q0, so that with Q0 = 0
    terminal states count 0.

    Parameters
    ----------
    data : Transitions
        What was tried, as `sample_transitions` gives it.
    n_states : int
        Number of states, S.
    n_actions : int
        Number of actions, A.
    gamma : float
        Discount, in [0, 1].
    alpha : float
        Step size in (0, 1].
    Q0 : ArrayLike
        First estimate, a number or (S, A).

    Returns
    -------
    Floats
        Q, (S, A).

    Notes
    -----
    Ledger: cl-034, eq-21.
    """
    _within(data, n_states, n_actions)
    Q = np.full((n_states, n_actions), Q0)
    _replay(data.s, data.a, data.r, data.s_next, gamma, alpha, Q)
    return Q


@compiled
def _replay(s, a, r, s_next, gamma, alpha, Q):
    for t in range(s.size):
        Q[s[t], a[t]] += alpha * (r[t] + gamma * max_value(Q, s_next[t]) - Q[s[t], a[t]])  # eq-21


def _remembered(world, memory):
    """What was remembered as a FiniteMDP; a pair never tried stays with reward 0."""
    (legal, terminal), known, mdp = spaces(world), memory.next_state >= 0, model_of(world)
    if mdp is None:  # it tells neither its terminal states nor where it starts; a state that was left is no end
        terminal = np.isin(np.arange(len(legal)), memory.next_state[memory.ended]) & ~known.any(axis=1)
    next_state = np.where(known, memory.next_state, np.arange(len(legal))[:, None])[:, :, None]
    prob = (legal | terminal[:, None]).astype(float)[:, :, None]
    start = ~terminal / np.sum(~terminal) if mdp is None else mdp.start
    return FiniteMDP(next_state, prob, memory.reward[:, :, None], legal, terminal, start)
