"""A longer build: a tabular agent from the process to Watkins's Q(lambda)."""

import numpy as np

from rlcore.exercises.compare import Judged
from rlcore.exercises.engine import Case, Exercise, Wrong
from rlcore.mdp import FiniteMDP

TITLE = "Build: an agent that finds its way"
NOTEBOOK = "build_agent"
INTRO = """Eight steps, about {minutes} minutes in all, to an agent of your own that learns the way through a maze with Watkins's
Q(lambda). A step calls the functions of those before it, yours; where one of them is wrong its check says so. It builds on
[chapter 1](../01_mdp.ipynb), [chapter 4](../04_temporal_difference.ipynb) and [chapter 5](../05_eligibility_traces.ipynb)."""
LABELS = dict.fromkeys(("fill in", "build", "experiment"), "a step of a longer build")
MOVES = ((-1, 0), (1, 0), (0, 1), (0, -1))
MAZE = ("S..#....", ".#.#.##.", ".#...#..", ".####...", "......#G")
SMALL = ("S.", "#G"), ("..S", ".#.", "G#."), MAZE


def _maze(rows):
    place = {}
    for i, row in enumerate(rows):
        for j, cell in enumerate(row):
            if cell != "#":
                place[i, j] = len(place)
    cells = "".join(rows).replace("#", "")
    outcomes = {
        (s, a): [(1.0, place.get((i + di, j + dj), s), -1.0)]
        for (i, j), s in place.items()
        if cells[s] != "G"
        for a, (di, dj) in enumerate(MOVES)
    }
    return FiniteMDP.from_outcomes(outcomes, start=cells.index("S"))


def _draw(p, rng):
    return int(np.searchsorted(np.cumsum(p), rng.random(), side="right"))


def _chances(q, epsilon):
    best = np.asarray(q) == np.max(q)
    return epsilon / len(q) + (1 - epsilon) * best / best.sum()


def _step(mdp, s, a, rng):
    k = _draw(mdp.prob[s, a], rng)
    s_next = int(mdp.next_state[s, a, k])
    return s_next, float(mdp.reward[s, a, k]), bool(mdp.terminal[s_next])


def _slippery(p):
    outcomes = {
        (0, 0): [(p, 1, -1.0), (1 - p, 0, -2.0)],
        (0, 1): [(0.5, 0, 0.0), (0.5, 2, -3.0)],
        (1, 0): [(1 - p, 2, 5.0), (p, 0, 1.0)],
        (1, 1): [(1.0, 0, -1.0)],
    }
    return FiniteMDP.from_outcomes(outcomes, start=0)


def _episode(mdp, Q, gamma, lam, alpha, epsilon, rng):
    Q, E = Q.copy(), np.zeros(Q.shape)
    s, terminated = int(mdp.start.argmax()), False
    a = _draw(_chances(Q[s], epsilon), rng)
    while not terminated:
        s_next, r, terminated = _step(mdp, s, a, rng)
        delta = r + gamma * Q[s_next].max() * (not terminated) - Q[s, a]
        E[s, a] += 1
        Q += alpha * delta * E
        if not terminated:
            a_next = _draw(_chances(Q[s_next], epsilon), rng)
            E *= gamma * lam * (Q[s_next, a_next] == Q[s_next].max())
            s, a = s_next, a_next
    return Q


Exercise(
    id="agent-maze",
    kind="build",
    tier="core",
    title="The maze",
    statement=r"""
        `rows` is a tuple of texts of equal length, a maze seen from above: `#` is a wall, `S` the start, `G` the goal, `.` any other cell. Number the cells that are no walls from 0, row by row from the top left. Actions: 0 up, 1 down, 2 right, 3 left; a move into a wall or over the border stays where it is. Every step pays $-1$; the goal is terminal. Return the `FiniteMDP`, made by
        `FiniteMDP.from_outcomes`, which takes `{(s, a): [(probability, s_next, reward), ...]}` and `start`.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def maze(rows):
            ...
    """,
    cases=lambda rng: [Case(dict(rows=rows), _maze(rows)) for rows in SMALL],
    hints=(
        "First a dict from `(row, column)` to the number of the cell, for all that are no walls.",
        "`place.get((i + di, j + dj), s)` is the number of the neighbour, or `s` where there is none. Leave the goal out of the keys.",
    ),
    solution="""
        def maze(rows):
            place = {}
            for i, row in enumerate(rows):
                for j, cell in enumerate(row):
                    if cell != "#":
                        place[i, j] = len(place)
            outcomes = {}
            for (i, j), s in place.items():
                if rows[i][j] == "S":
                    start = s
                if rows[i][j] != "G":
                    for a, (di, dj) in enumerate([(-1, 0), (1, 0), (0, 1), (0, -1)]):
                        outcomes[s, a] = [(1, place.get((i + di, j + dj), s), -1)]
            return FiniteMDP.from_outcomes(outcomes, start=start)
    """,
    wrong=(
        Wrong({'if rows[i][j] != "G":': "if True:"}, "the goal is not terminal: leave it out of the table"),
        Wrong({"(0, 1), (0, -1)": "(0, -1), (0, 1)"}, "right and left are exchanged: action 2 is right"),
        Wrong({"(-1, 0), (1, 0)": "(1, 0), (-1, 0)"}, "up and down are exchanged: action 0 is up, to the row before"),
        Wrong({"s), -1)]": "s), -1 * (place.get((i + di, j + dj), s) != s))]"}, "a step that stays where it is costs 1 as well"),
        Wrong({"start=start": "start=0"}, "the episode starts at S, wherever that is"),
    ),
    minutes=15,
    covers=("om-mdp-tuple", "eq-1"),
)  # fmt: skip

Exercise(
    id="agent-draw",
    kind="fill in",
    tier="core",
    title="Draw from a distribution",
    statement=r"""
        Draw a whole number $k$ with the probability `p[k]`. So that the check can follow: call `rng.random()` once, and return how many of the running sums of `p` are less than or equal to that number: with the probabilities 0.3, 0.7 the number 0.2 gives 0 and 0.5 gives 1.
    """,
    stub="""
        def draw(p, rng):
            ...
    """,
    cases=lambda rng: [
        Case(dict(p=np.array(p), rng=np.random.default_rng(seed)), _draw(p, np.random.default_rng(seed)))
        for seed, p in enumerate(
            ([0.3, 0.7], [0.2, 0.2, 0.6], [0.1, 0.1, 0.1, 0.7], [0.25] * 4, [0.0, 0.5, 0.5], [0.9, 0.1], [0.5, 0.5], [0.05] * 20)
        )
    ],
    hints=("`np.cumsum(p)` holds the running sums.", "Count those that are at most the number drawn: `(u >= np.cumsum(p)).sum()`."),
    solution="""
        def draw(p, rng):
            return int((rng.random() >= np.cumsum(p)).sum())
    """,
    wrong=(
        Wrong({"(rng.random() >= np.cumsum(p)).sum()": "np.argmax(p)"}, "this takes the most probable number: it has to be drawn"),
        Wrong({"np.cumsum(p)": "p"}, "the number is compared with the probabilities: compare it with their running sums"),
        Wrong({"(rng.random() >= np.cumsum(p)).sum()": "rng.integers(len(p))"}, "every number has the same chance here: use p"),
    ),
    minutes=4,
    covers=("alg-eps-greedy",),
)  # fmt: skip

Exercise(
    id="agent-chances",
    kind="fill in",
    tier="core",
    title="Mostly the best action",
    statement=r"""
        `q` `(A,)` is a row of the table. Return the probabilities `(A,)` of the $\epsilon$-greedy policy: with probability `epsilon` any action, else the best one; **where several are best they share the greedy part equally**.
    """,
    stub="""
        def chances(q, epsilon):
            ...
    """,
    cases=lambda rng: [
        Case(dict(q=np.array(q, float), epsilon=epsilon), _chances(q, epsilon))
        for q, epsilon in (([1, 2, 0], 0.1), ([0, 0, 0, 0], 0.2), ([3, -1, 3], 0.3), ([-2, -1, -3, -1], 0.0))
    ],
    hints=(
        "Every action gets `epsilon / len(q)`; what is left goes to the best ones.",
        "`best = q == q.max()`; `best / best.sum()` shares 1 among them.",
    ),
    solution="""
        def chances(q, epsilon):
            best = q == q.max()
            return epsilon / len(q) + (1 - epsilon) * best / best.sum()
    """,
    wrong=(
        Wrong({"best = q == q.max()": "best = np.eye(len(q))[q.argmax()]"}, "only the first best action gets the greedy part: share it"),
        Wrong({" / best.sum()": ""}, "each of several best actions gets the whole greedy part: the sum is above 1"),
        Wrong({"epsilon / len(q) + (1 - epsilon) * best / best.sum()": "epsilon * ~best / max(1, (~best).sum()) + (1 - epsilon) * best / best.sum()"}, "the random part may hit the best action, too: every action gets epsilon / A of it"),
    ),
    minutes=5,
    covers=("alg-eps-greedy",),
)  # fmt: skip

Exercise(
    id="agent-step",
    kind="fill in",
    tier="core",
    title="One step of the world",
    statement=r"""
        Take action `a` in state `s` of the `FiniteMDP` `mdp`: draw the number `k` of an outcome by your `draw` from `mdp.prob[s, a]`, and return the tuple `(s_next, r, terminated)`: `mdp.next_state[s, a, k]`, `mdp.reward[s, a, k]`, and whether the next state is terminal (`mdp.terminal` `(S,)`).
    """,
    stub="""
        def step(mdp, s, a, rng):
            ...
    """,
    cases=lambda rng: [
        Case(dict(mdp=mdp, s=s, a=a, rng=np.random.default_rng(seed)), _step(mdp, s, a, np.random.default_rng(seed)))
        for seed, (mdp, s, a) in enumerate(
            [(_slippery(0.6), s, a) for s in (0, 1) for a in (0, 1)] + [(_slippery(0.3), 1, 0), (_maze(MAZE), 0, 2)]
        )
    ],
    hints=(
        "`k = draw(mdp.prob[s, a], rng)`, one number for the outcome.",
        "The answers of the arrays serve as they are; `mdp.terminal[s_next]`, not `mdp.terminal[s]`.",
    ),
    solution="""
        def step(mdp, s, a, rng):
            k = draw(mdp.prob[s, a], rng)
            s_next = mdp.next_state[s, a, k]
            return int(s_next), float(mdp.reward[s, a, k]), bool(mdp.terminal[s_next])
    """,
    wrong=(
        Wrong({"mdp.terminal[s_next]": "mdp.terminal[s]"}, "this asks whether the old state is terminal: ask for the next one"),
        Wrong({"mdp.reward[s, a, k]": "(mdp.prob[s, a] @ mdp.reward[s, a])"}, "this is the expected reward: return that of the outcome which was drawn"),
        Wrong({"draw(mdp.prob[s, a], rng)": "mdp.prob[s, a].argmax()"}, "always the most probable outcome: draw it"),
    ),
    minutes=5,
    covers=("eq-1", "om-mdp-tuple"),
    uses=("agent-draw",),
)  # fmt: skip

Exercise(
    id="agent-error",
    kind="fill in",
    tier="core",
    title="The error of Q-learning",
    statement=r"""
        Return the TD error of Q-learning for one step, a number: $r + \gamma \max_{a'} Q(s', a') - Q(s, a)$, where nothing follows a step that `terminated`, whatever the table `Q` `(S, A)` holds.
    """,
    stub="""
        def td_error(Q, s, a, r, s_next, terminated, gamma):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(Q=Q, s=0, a=1, r=r, s_next=2, terminated=over, gamma=gamma),
            float(r + (0.0 if over else gamma * max(Q[2])) - Q[0, 1]),
        )
        for r, over, gamma in ((-1.0, False, 0.9), (2.0, True, 0.9), (0.5, False, 0.5))
        for Q in [rng.normal(size=(3, 3)).round(1) + 0.05]
    ],
    hints=(
        "`Q[s_next].max()` is the value of what is best in the next state.",
        "Multiply it by `(not terminated)`.",
    ),
    solution="""
        def td_error(Q, s, a, r, s_next, terminated, gamma):
            return float(r + gamma * Q[s_next].max() * (not terminated) - Q[s, a])
    """,
    wrong=(
        Wrong({" * (not terminated)": ""}, "after the end nothing follows: the target is the reward alone"),
        Wrong({"gamma * Q": "Q"}, "gamma is missing"),
        Wrong({" - Q[s, a]": ""}, "this is the target: the error is the target minus Q(s, a)"),
        Wrong(
            {"Q[s_next].max()": "Q[s_next, a]"}, "the same action again is assumed in the next state: take the best one"
        ),
    ),
    minutes=4,
    covers=("eq-21", "alg-q-learning"),
)

Exercise(
    id="agent-traces",
    kind="fill in",
    tier="core",
    title="What is remembered",
    statement=r"""
        The traces of Watkins's Q($\lambda$): `E` `(S, A)` are those left by the steps so far. The action that comes next is greedy or not: if it is, all traces shrink by `decay` $= \gamma \lambda$; if not, all become 0. Return the new traces, `(S, A)`, and leave `E` as it is.
    """,
    stub="""
        def faded(E, greedy, decay):
            ...
    """,
    cases=lambda rng: [
        Case(dict(E=E, greedy=greedy, decay=decay), E * decay if greedy else 0 * E)
        for greedy, decay in ((True, 0.8), (False, 0.8), (True, 0.5))
        for E in [rng.random((3, 2)).round(1) + 0.1]
    ],
    hints=("Two cases: `decay * E`, and zeros of the same shape.", "`decay * E * greedy` is both."),
    solution="""
        def faded(E, greedy, decay):
            return decay * E * greedy
    """,
    wrong=(
        Wrong({"decay * E * greedy": "decay * E"}, "an exploratory action forgets: the traces become 0"),
        Wrong({"decay * E * greedy": "E * greedy * 1.0"}, "the decay is missing"),
        Wrong(
            {"decay * E * greedy": "decay * E * (not greedy)"},
            "the two are exchanged: it is the exploratory action that forgets",
        ),
    ),
    minutes=3,
    covers=("eq-u-watkins-trace", "alg-watkins"),
)

ALL = ("agent-draw", "agent-chances", "agent-step", "agent-error", "agent-traces")

Exercise(
    id="agent-episode",
    kind="build",
    tier="core",
    title="An episode",
    statement=r"""
        One episode of Watkins's Q($\lambda$), with your functions. It starts in the state `mdp.start.argmax()` with traces of 0; the first action is drawn from the chances of its row. Until the episode has terminated: take the step; compute the error with the table as it is; raise the trace of the pair by 1; add `alpha` times the error times the traces to the whole table. Then, if the
        episode goes on, draw the next action from the chances of the next state in the new table, let the traces fade (the action is greedy if no other one has a larger value), and go on with that state and action. Return the new table; leave `Q` as it is. Nothing else is drawn, so that the check can follow.
    """,
    stub="""
        def episode(mdp, Q, gamma, lam, alpha, epsilon, rng):
            Q, E = Q.copy(), np.zeros(Q.shape)
            ...
            return Q
    """,
    cases=lambda rng: [
        Case(
            dict(mdp=mdp, Q=Q, gamma=gamma, lam=lam, alpha=alpha, epsilon=epsilon, rng=np.random.default_rng(seed)),
            _episode(mdp, Q, gamma, lam, alpha, epsilon, np.random.default_rng(seed)),
        )
        for seed, (mdp, gamma, lam, alpha, epsilon) in enumerate(
            ((_slippery(0.6), 0.9, 0.8, 0.5, 0.2), (_maze(SMALL[1]), 1.0, 0.9, 0.3, 0.4), (_slippery(0.3), 0.9, 0.5, 0.1, 0.9))
        )
        for Q in [rng.normal(size=(mdp.n_states, mdp.n_actions)).round(1)]
    ],
    hints=(
        "Before the loop: `s, terminated = mdp.start.argmax(), False` and `a = draw(chances(Q[s], epsilon), rng)`.",
        "In the loop: `step`, `td_error`, `E[s, a] += 1`, `Q += alpha * delta * E`; then, if it goes on, `a_next`, `E = faded(E, Q[s_next, a_next] == Q[s_next].max(), gamma * lam)`.",
    ),
    solution="""
        def episode(mdp, Q, gamma, lam, alpha, epsilon, rng):
            Q, E = Q.copy(), np.zeros(Q.shape)
            s, terminated = mdp.start.argmax(), False
            a = draw(chances(Q[s], epsilon), rng)
            while not terminated:
                s_next, r, terminated = step(mdp, s, a, rng)
                delta = td_error(Q, s, a, r, s_next, terminated, gamma)
                E[s, a] += 1
                Q += alpha * delta * E
                if not terminated:
                    a_next = draw(chances(Q[s_next], epsilon), rng)
                    E = faded(E, Q[s_next, a_next] == Q[s_next].max(), gamma * lam)
                    s, a = s_next, a_next
            return Q
    """,
    wrong=(
        Wrong({"E = faded(E, Q[s_next, a_next] == Q[s_next].max(), gamma * lam)": "E = faded(E, True, gamma * lam)"}, "the traces live on after exploratory actions: hand over whether the next one is greedy"),
        Wrong({"E = faded(E, Q[s_next, a_next] == Q[s_next].max(), gamma * lam)": "E = faded(E, Q[s, a] == Q[s].max(), gamma * lam)"}, "it is the next action that decides about the traces, not the one that was taken"),
        Wrong({"gamma * lam)": "lam)"}, "the traces fade by gamma times lambda"),
        Wrong({"Q += alpha * delta * E": "Q[s, a] += alpha * delta"}, "only the last pair learns: this is Q-learning without traces"),
        Wrong({"E[s, a] += 1": "E[s, a] = 1"}, "these are replacing traces: raise the trace of the pair by 1"),
    ),
    minutes=20,
    covers=("alg-watkins", "eq-u-watkins-trace"),
    uses=ALL,
)  # fmt: skip


def _finds(got):
    mdp = _maze(MAZE)
    shape = (mdp.n_states, mdp.n_actions)
    if not isinstance(got, np.ndarray) or got.shape != shape or got.dtype.kind != "f":
        return f"the result must be the table of action values, an array of shape {shape}"
    if not np.isfinite(got).all():
        return "some values are no finite numbers: is the step size too large?"
    s, steps = int(mdp.start.argmax()), 0
    while not mdp.terminal[s] and steps < 100:
        s, steps = int(mdp.next_state[s, got[s].argmax(), 0]), steps + 1
    if not mdp.terminal[s]:
        return "its greedy policy does not reach the goal from S"
    return None if steps == LENGTH else f"its greedy policy takes {steps} steps from S to G; there is a shorter way"


LENGTH = 13
START = """
rows = ("S..#....", ".#.#.##.", ".#...#..", ".####...", "......#G")
"""

Exercise(
    id="agent-finds",
    kind="experiment",
    tier="core",
    title="It finds its way",
    statement=r"""
        Let your agent learn in the maze of the stub: start with a table of zeros, run 200 episodes one after the other with $\gamma = 1$, $\lambda = 0.8$, `alpha=0.2`, `epsilon=0.1` and one generator, and bind the last table to `Q_maze`, `(S, A)`. The check follows its greedy policy from S, the first of several best actions: it must reach G in as few steps as there can be.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub=START + "Q_maze = ...",
    cases=lambda rng: [Case({}, Judged("a table whose greedy policy takes a shortest way from S to G", _finds))],
    hints=(
        "`mdp = maze(rows)` and `Q = np.zeros((mdp.n_states, mdp.n_actions))`.",
        "In the loop: `Q = episode(mdp, Q, 1.0, 0.8, 0.2, 0.1, rng)`, with one `rng` from before the loop.",
    ),
    solution=START
    + """
mdp, rng = maze(rows), np.random.default_rng(0)
Q_maze = np.zeros((mdp.n_states, mdp.n_actions))
for _ in range(200):
    Q_maze = episode(mdp, Q_maze, 1.0, 0.8, 0.2, 0.1, rng)
""",
    wrong=(
        Wrong({"range(200)": "range(0)"}, "a table of zeros has learned nothing: its greedy policy bumps into the wall for ever"),
        Wrong({"episode(mdp, Q_maze,": "episode(mdp, 0 * Q_maze,"}, "every episode starts with an empty table: hand over the one that the last episode returned"),
        Wrong({"range(200)": "range(1)"}, "after one episode it knows hardly more than before: run 200"),
    ),
    minutes=8,
    covers=("alg-watkins", "fig-28"),
    uses=("agent-maze", *ALL, "agent-episode"),
)  # fmt: skip
