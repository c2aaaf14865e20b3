"""Exercises of chapter 3: dynamic programming and what learns without a model."""

import numpy as np

from rlcore.dp import value_iteration
from rlcore.envs import gridworld, random_mdp
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.mdp import FiniteMDP
from rlcore.planning import Transitions, estimate_model

TITLE = "Exercises: dynamic programming"
NOTEBOOK = "03_dynamic_programming"


def _arrays(mdp, *names):
    return {name: getattr(mdp, name) for name in names}


Exercise(
    id="ch03-two-sweeps-by-hand",
    kind="by hand",
    tier="core",
    section="Policy evaluation: what is this policy worth?",
    title="Two sweeps with pencil and paper",
    statement=r"""
        From $x$ you may stop for a reward of 7.5, which ends the episode, or go on to $y$ for a reward of 2. From $y$ the only
        action returns to $x$ and pays 6. $\gamma = 0.5$. Value iteration starts at $V_0 = 0$ and computes $V_1$ and
        $V_2$ with two arrays. What is $V_2(x)$? And what is $v_*(x)$? Bind `answer` to the pair `(V2, v_star)`.
    """,
    stub="answer = ...",
    cases=lambda rng: [Case({}, (7.5, 7.5))],
    hints=(
        "$V_1(x) = \\max(7.5, 2) = 7.5$ and $V_1(y) = 6$. Repeat with these values on the right.",
        "$V_2(x) = \\max(7.5, 2 + 0.5 \\cdot 6)$. For $v_*$, see whether going round for ever beats 7.5.",
    ),
    solution="""
        V2 = max(7.5, 2 + 0.5 * 6)
        v_star = max(7.5, 2 + 0.5 * (6 + 0.5 * 7.5))
        answer = (float(V2), float(v_star))
    """,
    wrong=(
        Wrong(
            "answer = (7.5, 8.0)",
            "v_*(x) = 8 would need going round to be worth more than stopping: 2 + 0.5 (6 + 0.5 * 8) is 7, not 8",
        ),
        Wrong("answer = (5.0, 7.5)", "this V_2 goes on; stopping pays 7.5, and value iteration takes the larger"),
        Wrong("answer = (8.0, 7.5)", "gamma is missing from V_2: going on is worth 2 + 0.5 * 6"),
        Wrong(
            "answer = (7.5, 6.875)", "6.875 is the value of going on once and then stopping; stopping at once is better"
        ),
    ),
    minutes=4,
    covers=("eq-u-value-iteration", "alg-value-iteration"),
)


def _worlds(rng):
    yield random_mdp(4, 3, n_next=3, rng=rng), 0.8
    yield gridworld(2, 3, reward=-1.5, terminals=[5]), 1.0
    yield gridworld(3, 3, slip=0.3), 0.9


MODEL = ("prob", "reward", "next_state", "terminal")

Exercise(
    id="ch03-value-iteration",
    kind="fill in",
    tier="core",
    section="How fast, and when to stop",
    title="Value iteration, whole",
    statement=r"""
        Write value iteration ({ref}`the update <eq-u-value-iteration>`) with two arrays: start at $V = 0$, sweep until no
        value changes by `tol` or more, and return `(V, n)`, the values `(S,)` and the number of sweeps, the last one
        included. The outcome arrays are `(S, A, K)`; all actions are legal. Terminal states (`terminal`, `(S,)`) return to
        themselves with reward 0, so that they keep the value 0 by themselves.
    """.replace("({ref}`the update <eq-u-value-iteration>`) ", ""),
    stub="""
        def value_iteration(prob, reward, next_state, terminal, gamma, tol):
            ...
    """,
    cases=lambda rng: [
        Case({**_arrays(m, *MODEL), "gamma": gamma, "tol": tol}, (solution.V, solution.n_iter), tol=1e-9)
        for m, gamma, tol in (*((m, gamma, 1e-6) for m, gamma in _worlds(rng)), (_corridor(4, 0.0), 0.5, 0.25))
        for solution in [value_iteration(m, gamma, tol=tol)]
    ],
    hints=(
        "One sweep is `(prob * (reward + gamma * V[next_state])).sum(axis=2).max(axis=1)`.",
        "The change of a sweep is `np.abs(V_new - V).max()`; stop when it is below `tol`, after taking the new values.",
    ),
    solution="""
        def value_iteration(prob, reward, next_state, terminal, gamma, tol):
            V = np.zeros(len(terminal))
            n, change = 0, np.inf
            while change >= tol:
                V_new = (prob * (reward + gamma * V[next_state])).sum(axis=2).max(axis=1)
                change = np.abs(V_new - V).max()
                V = V_new
                n += 1
            return V, n
    """,
    wrong=(
        Wrong(
            """
            def value_iteration(prob, reward, next_state, terminal, gamma, tol):
                V, n, change = np.zeros(len(terminal)), 0, np.inf
                while change >= tol and n < 5000:
                    V_new = (prob * (reward + V[next_state])).sum(axis=2).max(axis=1) * gamma
                    change, V, n = np.abs(V_new - V).max(), V_new, n + 1
                return V, n
            """,
            "the reward is discounted too: gamma belongs to the value of the next state alone",
        ),
        Wrong(
            """
            def value_iteration(prob, reward, next_state, terminal, gamma, tol):
                V = (prob * (reward + gamma * 0)).sum(axis=2).max(axis=1)
                return V, 1
            """,
            "one sweep only: repeat until the values stand still",
        ),
        Wrong(
            """
            def value_iteration(prob, reward, next_state, terminal, gamma, tol):
                V, n, change = np.zeros(len(terminal)), 0, np.inf
                while change >= tol:
                    V_new = (prob * (reward + gamma * V[next_state])).sum(axis=2).mean(axis=1)
                    change, V, n = np.abs(V_new - V).max(), V_new, n + 1
                return V, n
            """,
            "averages over the actions: this evaluates the equiprobable policy, value iteration takes the best action",
        ),
        Wrong(
            """
            def value_iteration(prob, reward, next_state, terminal, gamma, tol):
                V, n, change = np.zeros(len(terminal)), 0, np.inf
                while change >= tol:
                    V_new = (prob * (reward + gamma * V[next_state])).sum(axis=2).max(axis=1)
                    change = np.abs(V_new - V).max()
                    if change >= tol:
                        V, n = V_new, n + 1
                return V, n
            """,
            "the last sweep is thrown away: it counts, and its values are the better ones",
        ),
    ),
    minutes=15,
    covers=("eq-u-value-iteration", "alg-value-iteration", "fig-13"),
)


def _in_place(m, pi, V, gamma):
    V = V.copy()
    for s in np.flatnonzero(~m.terminal):
        V[s] = (pi[s, :, None] * m.prob[s] * (m.reward[s] + gamma * V[m.next_state[s]])).sum()
    return V


Exercise(
    id="ch03-in-place-sweep",
    kind="fill in",
    tier="core",
    section="Policy evaluation: what is this policy worth?",
    title="One sweep in place",
    statement=r"""
        Do one sweep of policy evaluation **in place**: states in order 0, 1, 2, ..., each using the values that this sweep has
        already computed. `pi` is `(S, A)`, the outcome arrays are `(S, A, K)`, `terminal` and `V` are `(S,)`. Skip terminal states: their values stay. Start from a copy of `V` and return it.
    """,
    stub="""
        def sweep(pi, prob, reward, next_state, terminal, V, gamma):
            V = V.copy()
            for s in range(len(V)):
                ...
            return V
    """,
    cases=lambda rng: [
        Case({"pi": pi, **_arrays(m, *MODEL), "V": V, "gamma": gamma}, _in_place(m, pi, V, gamma))
        for m, gamma in _worlds(rng)
        for V in [rng.normal(size=m.n_states).round(2)]
        for pi in [rng.dirichlet(np.ones(m.n_actions), size=m.n_states)]
    ],
    hints=(
        "Inside the loop, `prob[s]`, `reward[s]` and `next_state[s]` are `(A, K)`; the action values are a sum over the last axis.",
        "Write the result into `V[s]` at once, so that the next states of the sweep see it.",
    ),
    solution="""
        def sweep(pi, prob, reward, next_state, terminal, V, gamma):
            V = V.copy()
            for s in range(len(V)):
                if not terminal[s]:
                    q = (prob[s] * (reward[s] + gamma * V[next_state[s]])).sum(axis=1)
                    V[s] = pi[s] @ q
            return V
    """,
    wrong=(
        Wrong(
            """
            def sweep(pi, prob, reward, next_state, terminal, V, gamma):
                return (pi * (prob * (reward + gamma * V[next_state])).sum(axis=2)).sum(axis=1)
            """,
            "this is the sweep with two arrays: in place, a state uses the values that this sweep has computed before it",
        ),
        Wrong(
            """
            def sweep(pi, prob, reward, next_state, terminal, V, gamma):
                V = V.copy()
                for s in reversed(range(len(V))):
                    if not terminal[s]:
                        V[s] = pi[s] @ (prob[s] * (reward[s] + gamma * V[next_state[s]])).sum(axis=1)
                return V
            """,
            "the states are swept from the last to the first; the order matters in place",
        ),
        Wrong(
            """
            def sweep(pi, prob, reward, next_state, terminal, V, gamma):
                V = V.copy()
                for s in range(len(V)):
                    if not terminal[s]:
                        V[s] = (prob[s] * (reward[s] + gamma * V[next_state[s]])).sum(axis=1).max()
                return V
            """,
            "takes the best action: that is value iteration; evaluation averages over the policy",
        ),
        Wrong(
            """
            def sweep(pi, prob, reward, next_state, terminal, V, gamma):
                V = V.copy()
                for s in range(len(V)):
                    if not terminal[s]:
                        V[s] = (prob[s] * (reward[s] + gamma * V[next_state[s]])).sum()
                return V
            """,
            "sums over actions without pi",
        ),
    ),
    minutes=10,
    covers=("alg-policy-evaluation", "om-policy-evaluation"),
)


def _improved(Q, actions):
    best = Q.max(axis=1)
    keep = Q[np.arange(len(Q)), actions] >= best - 1e-9
    return np.where(keep, actions, Q.argmax(axis=1))


Exercise(
    id="ch03-improvement-ties",
    kind="fill in",
    tier="more",
    section="Policy improvement: what would be better?",
    title="Improve, but do not dither",
    statement=r"""
        Policy improvement for a deterministic policy: `Q` `(S, A)` holds $q_\pi$, `actions` `(S,)` the actions of $\pi$.
        Return the greedy actions `(S,)`, **keeping the old action wherever it is as good as the best** (within `1e-9`);
        elsewhere take the first best one. Otherwise policy iteration can swap two equally good policies for ever.
    """,
    stub="""
        def improve(Q, actions):
            ...
    """,
    cases=lambda rng: [
        Case(dict(Q=Q, actions=a), _improved(Q, a))
        for Q, a in (
            (np.array([[1.0, 1.0, 0.0], [0.0, 2.0, 2.0], [3.0, 1.0, 3.0]]), np.array([1, 0, 2])),
            (np.array([[0.3, 0.1 + 0.2], [0.1 + 0.2, 0.3], [-1.0, -2.0]]), np.array([0, 1, 1])),
            (rng.integers(3, size=(6, 3)).astype(float), rng.integers(3, size=6)),
            (np.array([[1.0, 1 + 5e-10], [1 - 3e-9, 1.0], [1e6 - 1e-3, 1e6], [0.5, 0.0]]), np.array([0, 0, 0, 1])),
            (np.array([[-2.0, -2.0, -3.0], [-1e6, 1e-3 - 1e6, -2e6]]), np.array([1, 0])),
        )
    ],
    hints=(
        "`Q[np.arange(len(Q)), actions]` is the value of the old action in each state.",
        "`np.where(old_value >= best - 1e-9, actions, Q.argmax(axis=1))`.",
    ),
    solution="""
        def improve(Q, actions):
            old = Q[np.arange(len(Q)), actions]
            keep = old >= Q.max(axis=1) - 1e-9
            return np.where(keep, actions, Q.argmax(axis=1))
    """,
    wrong=(
        Wrong(
            """
            def improve(Q, actions):
                return Q.argmax(axis=1)
            """,
            "always the first best action: the old one must be kept where it is as good",
        ),
        Wrong(
            """
            def improve(Q, actions):
                return np.where(Q[np.arange(len(Q)), actions] == Q.max(axis=1), actions, Q.argmax(axis=1))
            """,
            "exact comparison: 0.1 + 0.2 and 0.3 differ by rounding only; allow 1e-9",
        ),
        Wrong(
            """
            def improve(Q, actions):
                return Q.shape[1] - 1 - Q[:, ::-1].argmax(axis=1)
            """,
            "always the last best action: the old one must be kept where it is as good",
        ),
        Wrong(
            """
            def improve(Q, actions):
                return actions.copy()
            """,
            "nothing is improved: take the best action wherever the old one is worse",
        ),
    ),
    minutes=6,
    covers=("alg-policy-improvement", "om-policy-improvement", "cl-038"),
)


def _sweeps_down(V0, gamma, tol):
    V, n, change = V0.copy(), 0, np.inf
    while change >= tol:
        V_new = -1 + gamma * np.concatenate([[0.0], V[:-1]])
        change, V, n = np.abs(V_new - V).max(), V_new, n + 1
    return V, n


Exercise(
    id="ch03-bug-stops-early",
    kind="find the bug",
    tier="core",
    section="Policy evaluation: what is this policy worth?",
    title="It stops, and it is wrong",
    statement=r"""
        A corridor: from cell $i$ the robot moves to cell $i - 1$, from cell 0 out of the corridor; each step costs 1. This
        function should sweep, from the values `V` on, until no value changes by `tol` or more in a sweep, up or down, and
        return `(V, n)`: the values after the last sweep, and the number of sweeps, the last one included. It always stops
        after one sweep. Find the reason and mend it.
    """,
    stub="""
        def corridor(V, gamma, tol):
            n, change = 0, np.inf
            while change >= tol:
                V_new = -1 + gamma * np.concatenate([[0.0], V[:-1]])
                change = (V_new - V).max()
                V = V_new
                n += 1
            return V, n
    """,
    cases=lambda rng: [
        Case(dict(V=V0, gamma=gamma, tol=tol), _sweeps_down(V0, gamma, tol))
        for V0, gamma, tol in (
            (np.zeros(4), 1.0, 1e-6),
            (np.full(6, 2.0), 0.9, 0.3),
            (rng.normal(size=5).round(1), 0.7, 1e-6),
            (np.array([-9.0, -1.0, -9.0, -1.0]), 0.9, 0.05),
            (np.array([0.0, -3.0, 1.0]), 0.5, 1.0),
            (np.array([-1.6, -3.04]), 0.9, 0.7),
            (np.array([5.0, 3.5]), 0.9, 0.05),
            (np.array([-1.0, -1.0]), 1.0, 1.0),
            (np.array([-1.0, -2.0, -3.0]), 1.0, 1e-6),
        )
    ],
    hints=(
        "Values of a task with costs fall from sweep to sweep. What is the largest of four negative changes?",
        "The change of a sweep is the largest absolute difference.",
    ),
    solution="""
        def corridor(V, gamma, tol):
            n, change = 0, np.inf
            while change >= tol:
                V_new = -1 + gamma * np.concatenate([[0.0], V[:-1]])
                change = np.abs(V_new - V).max()
                V = V_new
                n += 1
            return V, n
    """,
    wrong=(
        Wrong(
            """
            def corridor(V, gamma, tol):
                n, change = 0, np.inf
                while change >= tol:
                    V, V_old = -1 + gamma * np.concatenate([[0.0], V[:-1]]), V
                    n, change = n + 1, np.max(V - V_old)
                return V, n
            """,
            "a fall counts as no change: take the absolute difference",
        ),
        Wrong(
            """
            def corridor(V, gamma, tol):
                n, change = 0, np.inf
                while change >= tol:
                    V, V_old = -1 + gamma * np.concatenate([[0.0], V[:-1]]), V
                    n, change = n + 1, np.abs(V - V_old).min()
                return V, n
            """,
            "the smallest change stops it: it must be the largest",
        ),
        Wrong(
            """
            def corridor(V, gamma, tol):
                for n in range(1000):
                    V = -1 + gamma * np.concatenate([[0.0], V[:-1]])
                return V, n + 1
            """,
            "a fixed number of sweeps: stop when no value changes by tol or more",
        ),
        Wrong(
            """
            def corridor(V, gamma, tol):
                n, change = 0, np.inf
                while change >= tol:
                    V, V_old = -1 + gamma * np.concatenate([[0.0], V[:-1]]), V
                    n, change = n + 1, np.abs(V - V_old).mean()
                return V, n
            """,
            "the mean change stops it while single values still move: take the largest",
        ),
    ),
    minutes=6,
    covers=("alg-value-iteration", "cl-037"),
)


def _log(rng, S, A, n):
    return dict(s=rng.integers(S, size=n), a=rng.integers(A, size=n), s_next=rng.integers(S, size=n), S=S, A=A)


def _counts(s, a, s_next, S, A):
    model = estimate_model(Transitions(s, a, np.zeros(len(s)), s_next), S, A)
    seen = np.zeros((S, A), bool)
    seen[s, a] = True
    return np.where(seen[:, :, None], model.transition_probs(), 0.0)


Exercise(
    id="ch03-count-model",
    kind="fill in",
    tier="more",
    section="Learning a model by counting",
    title="A model from counts",
    statement=r"""
        Estimate $p(s' \mid s, a)$ from recorded transitions: `s`, `a`, `s_next` are `(n,)` integers, one row for each
        transition. Return `(S, A, S)`: how often $s'$ followed the pair, divided by how often the pair was tried; zeros where
        it never was.
    """,
    stub="""
        def model(s, a, s_next, S, A):
            ...
    """,
    cases=lambda rng: [
        Case(g, _counts(**g))
        for g in (_log(rng, 3, 2, 30), _log(rng, 4, 3, 12), _log(rng, 2, 2, 3), _log(rng, 9, 8, 5))
    ],
    hints=(
        "Count in a loop, or with `np.add.at(counts, (s, a, s_next), 1)`; `counts[s, a, s_next] += 1` counts repeats once.",
        "Divide by `counts.sum(axis=2, keepdims=True)`, but not where that is 0: `np.maximum(total, 1)`.",
    ),
    solution="""
        def model(s, a, s_next, S, A):
            counts = np.zeros((S, A, S))
            np.add.at(counts, (s, a, s_next), 1)
            total = counts.sum(axis=2, keepdims=True)
            return counts / np.maximum(total, 1)
    """,
    wrong=(
        Wrong(
            """
            def model(s, a, s_next, S, A):
                counts = np.zeros((S, A, S))
                counts[s, a, s_next] += 1
                return counts / np.maximum(counts.sum(axis=2, keepdims=True), 1)
            """,
            "repeated transitions are counted once: use np.add.at or a loop",
        ),
        Wrong(
            {"    total = counts.sum(axis=2, keepdims=True)\n": "", "np.maximum(total, 1)": "len(s)"},
            "divided by the number of all transitions: divide by how often the pair was tried",
        ),
        Wrong(
            """
            def model(s, a, s_next, S, A):
                counts = np.ones((S, A, S))
                np.add.at(counts, (s, a, s_next), 1)
                return counts / counts.sum(axis=2, keepdims=True)
            """,
            "one imagined transition to every state is added; the exercise asks for plain frequencies",
        ),
        Wrong(
            """
            def model(s, a, s_next, S, A):
                counts = np.zeros((S, A, S))
                np.add.at(counts, (s_next, a, s), 1)
                return counts / np.maximum(counts.sum(axis=2, keepdims=True), 1)
            """,
            "state and next state are swapped",
        ),
    ),
    minutes=10,
    covers=("alg-model-learning", "eq-u-dynamics"),
)


def _updated(Q, s, a, r, s_next, terminated, alpha, gamma):
    Q = Q.copy()
    Q[s, a] += alpha * (r + gamma * Q[s_next].max() * (not terminated) - Q[s, a])
    return Q


Exercise(
    id="ch03-q-learning-update",
    kind="fill in",
    tier="more",
    section="Q-learning, a first look",
    title="The update of Q-learning",
    statement=r"""
        Write the update after one transition: `Q[s, a]` moves by the fraction `alpha` towards the target
        $r + \gamma \max_{a'} Q(s', a')$. If the episode `terminated`, nothing follows, and the target is $r$. Return the new
        table; leave the old one as it is.
    """,
    stub="""
        def update(Q, s, a, r, s_next, terminated, alpha, gamma):
            Q = Q.copy()
            ...
            return Q
    """,
    cases=lambda rng: [
        Case(g, _updated(**g))
        for terminated in (False, True)
        for s, s_next in ((0, 2), (3, 1))
        for g in [
            dict(
                Q=rng.normal(size=(4, 3)).round(1) + 2,
                s=s,
                a=1,
                r=1.5,
                s_next=s_next,
                terminated=terminated,
                alpha=0.2,
                gamma=0.9,
            )
        ]
    ],
    hints=(
        "The target uses the largest entry of the row of the next state, `Q[s_next].max()`, unless the episode has ended.",
        "`Q[s, a] += alpha * (target - Q[s, a])`.",
    ),
    solution="""
        def update(Q, s, a, r, s_next, terminated, alpha, gamma):
            Q = Q.copy()
            target = r if terminated else r + gamma * Q[s_next].max()
            Q[s, a] += alpha * (target - Q[s, a])
            return Q
    """,
    wrong=(
        Wrong(
            """
            def update(Q, s, a, r, s_next, terminated, alpha, gamma):
                Q = Q.copy()
                Q[s, a] += alpha * (r + gamma * Q[s_next].max() - Q[s, a])
                return Q
            """,
            "the terminal state is bootstrapped: after the end the target is the reward alone",
        ),
        Wrong(
            """
            def update(Q, s, a, r, s_next, terminated, alpha, gamma):
                Q = Q.copy()
                Q[s, a] += alpha * (r + gamma * Q[s_next, a] * (not terminated) - Q[s, a])
                return Q
            """,
            "the same action is taken again in the next state: use the best entry of its row",
        ),
        Wrong(
            """
            def update(Q, s, a, r, s_next, terminated, alpha, gamma):
                Q = Q.copy()
                Q[s, a] += alpha * (r + Q[s_next].max() * (not terminated) - Q[s, a])
                return Q
            """,
            "gamma is missing from the bootstrap",
        ),
        Wrong(
            """
            def update(Q, s, a, r, s_next, terminated, alpha, gamma):
                Q = Q.copy()
                Q[s, a] += alpha * (r + gamma * Q[s_next].max() * (not terminated))
                return Q
            """,
            "the old value is not subtracted: the step goes towards the target, alpha times (target - Q[s, a])",
        ),
    ),
    minutes=8,
    covers=("fig-12", "cl-034"),
)

Exercise(
    id="ch03-predict-descent",
    kind="predict",
    tier="more",
    section="Policy optimisation, a first look",
    title="Three learning rates",
    statement=r"""
        Gradient descent on $C(v) = v^2 / 2$ from $v = 3$: each step replaces $v$ by $v - \epsilon\, v$. Predict the sign and size
        after 4 steps with $\epsilon = 0.5$, $1.5$ and $2.5$. Then compute the three numbers and bind them, in this order, to
        the array `v`.
    """,
    stub="v = ...",
    cases=lambda rng: [Case({}, 3 * (1 - np.array([0.5, 1.5, 2.5])) ** 4)],
    hints=(
        r"Each step multiplies $v$ by $1 - \epsilon$.",
        "`3 * (1 - np.array([0.5, 1.5, 2.5])) ** 4`. Which of the factors is larger than 1 in size?",
    ),
    solution="v = 3 * (1 - np.array([0.5, 1.5, 2.5])) ** 4",
    wrong=(
        Wrong({"1 - np.array": "1 + np.array"}, "the steps climb: descent subtracts the gradient"),
        Wrong({"** 4": "** 3"}, "one step too few: four steps give the fourth power"),
        Wrong("v = 3 * np.array([0.5, 1.5, 2.5]) ** 4", "the factor of a step is 1 - epsilon, not epsilon"),
        Wrong(
            "v = 3 - 4 * 3 * np.array([0.5, 1.5, 2.5])",
            "the gradient shrinks with v: each step uses the gradient where it stands",
        ),
    ),
    minutes=5,
    covers=("fig-11", "cl-032", "cl-033"),
)


def _corridor(n, slip):
    outcomes = {}
    for s in range(1, n + 1):
        for a, move in ((0, -1), (1, 1)):
            outcomes[s, a] = [(1 - slip, s + move, float(s + move == n + 1)), (slip, s, 0.0)]
    return FiniteMDP.from_outcomes(outcomes, start=1)


Exercise(
    id="ch03-build-corridor",
    kind="build",
    tier="deep",
    section="The problem, and the running example",
    title="A slippery corridor",
    statement="""
        Build this process and return it. Cells 1 to `n` in a row, terminal states 0 at the left end and `n + 1` at the right
        end; episodes start in cell 1. Actions: 0 left, 1 right. A step succeeds with probability `1 - slip`; otherwise the robot
        stays where it is. Entering the right end pays 1, everything else 0.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def slippery_corridor(n, slip):
            ...
    """,
    cases=lambda rng: [Case(dict(n=n, slip=slip), _corridor(n, slip)) for n, slip in ((3, 0.1), (5, 0.4))],
    hints=(
        "Loop over cells 1 to n and the moves -1 and +1; the terminal states need no entry in the table.",
        "The reward of a successful step is 1 if `s + move == n + 1`, else 0; staying pays 0.",
    ),
    solution="""
        def slippery_corridor(n, slip):
            outcomes = {}
            for s in range(1, n + 1):
                for a, move in ((0, -1), (1, 1)):
                    arrives = s + move == n + 1
                    outcomes[s, a] = [(1 - slip, s + move, float(arrives)), (slip, s, 0)]
            return FiniteMDP.from_outcomes(outcomes, start=1)
    """,
    wrong=(
        Wrong(
            {
                "arrives = s + move == n + 1": "r = float(s + move == n + 1)",
                "float(arrives)": "r",
                "(slip, s, 0)": "(slip, s, r)",
            },
            "slipping beside the right end pays too: only entering it does",
        ),
        Wrong(
            {
                "            arrives = s + move == n + 1\n": "",
                "float(arrives)": "float(s + move == n + 1)",
                "(slip, s, 0)": "(slip, s - move, float(s - move == n + 1))",
            },
            "slipping moves the other way: the robot should stay where it is",
        ),
        Wrong(
            {
                "((0, -1), (1, 1))": "((0, 1), (1, -1))",
                "            arrives = s + move == n + 1\n": "",
                "float(arrives)": "float(s + move == n + 1)",
            },
            "the actions are swapped: 0 is left, 1 is right",
        ),
        Wrong(
            {"            arrives = s + move == n + 1\n": "", "float(arrives)": "float(s + move in (0, n + 1))"},
            "the left end pays too: only the right end does",
        ),
    ),
    minutes=12,
    covers=("om-mdp-tuple",),
)

Exercise(
    id="ch03-claim-any-start",
    kind="experiment",
    tier="deep",
    section="How fast, and when to stop",
    title="Do the first values matter?",
    statement=r"""
        The document lets value iteration start at random values. Take `gridworld()` with $\gamma = 0.9$ and tolerance `1e-10`;
        run `value_iteration` from `V0=0.0` and from `V0=1000.0`. Bind `verdict` to `(word, n0, n1000)`: the word `"confirmed"` if
        both limits agree within `1e-6` in every state, else `"refuted"`, and the two numbers of sweeps; `value_iteration` returns
        a `Solution` with the values as `.V` and the number of sweeps as `.n_iter`.
    """,
    setup="import numpy as np\nfrom rlcore.dp import value_iteration\nfrom rlcore.envs import gridworld",
    stub="verdict = ...",
    cases=lambda rng: [
        Case({}, ("confirmed", *(value_iteration(gridworld(), 0.9, tol=1e-10, V0=V0).n_iter for V0 in (0.0, 1000.0))))
    ],
    hints=(
        "`value_iteration(gridworld(), 0.9, tol=1e-10, V0=1000.0)` returns a Solution with `.V` and `.n_iter`.",
        "Compare `np.abs(one.V - two.V).max()` with `1e-6`.",
    ),
    solution="""
        low = value_iteration(gridworld(), 0.9, tol=1e-10, V0=0.0)
        high = value_iteration(gridworld(), 0.9, tol=1e-10, V0=1000.0)
        word = "confirmed" if np.abs(low.V - high.V).max() < 1e-6 else "refuted"
        verdict = (word, low.n_iter, high.n_iter)
    """,
    wrong=(
        Wrong(
            {'word = "confirmed" if np.abs(low.V - high.V).max() < 1e-6 else "refuted"\n': "", "(word,": '("refuted",'},
            "the numbers of sweeps are right, the word is not: more sweeps lead to the same limits; compare the values",
        ),
        Wrong(
            """
            low = value_iteration(gridworld(), 0.9, tol=1e-10, V0=0.0)
            verdict = ("confirmed", low.n_iter, low.n_iter)
            """,
            "both runs take as many sweeps: the second one must start at V0=1000.0, and takes more",
        ),
        Wrong(
            """
            low = value_iteration(gridworld(), 0.9, tol=1e-10, V0=0.0)
            high = value_iteration(gridworld(), 0.9, tol=1e-10, V0=1000.0)
            verdict = ("confirmed", high.n_iter, low.n_iter)
            """,
            "the two numbers are swapped: first the run from 0, then the one from 1000",
        ),
    ),
    minutes=6,
    covers=("cl-037", "alg-value-iteration"),
)

PROOFS = (
    Proof(
        "Policy iteration never needs more rounds",
        r"""
        Let $\pi_{k+1}$ be greedy for $v_{\pi_k}$, and let $T_*$ be the operator of value iteration, $T_\pi$ that of a policy. Show that
        $v_{\pi_{k+1}} \ge T_* v_{\pi_k}$ in every state, and conclude, with $\gamma < 1$, that after $k$ rounds policy iteration is at
        least as near to $v_*$ as $k$ sweeps of value iteration that started from $v_{\pi_0}$.
        """,
        (
            "Greedy means $T_{\\pi_{k+1}} v_{\\pi_k} = T_* v_{\\pi_k}$, and that is at least $T_{\\pi_k} v_{\\pi_k} = v_{\\pi_k}$.",
            "$T_{\\pi_{k+1}}$ is monotone: applied again and again it can only raise the values.",
            "Its repeated application converges to $v_{\\pi_{k+1}}$, because it is a contraction.",
            "Induction over $k$, with $T_*$ monotone, and $v_*$ as an upper bound of both.",
        ),
        r"""
        Write $v_k$ for $v_{\pi_k}$ and $T$ for $T_{\pi_{k+1}}$. Since $\pi_{k+1}$ is greedy, $T v_k = T_* v_k \ge T_{\pi_k} v_k = v_k$.
        $T$ is monotone, so $T v_k \ge v_k$ gives $T^2 v_k \ge T v_k$, and so on: $T^n v_k \ge T v_k = T_* v_k$ for all $n \ge 1$. As
        $n$ grows, $T^n v_k$ goes to the fixed point of the contraction $T$, which is $v_{k+1}$. So $v_{k+1} \ge T_* v_k$.

        Let $u_k = T_*^k v_0$ be the values of value iteration. $v_0 \ge u_0$ holds, they are equal. If $v_k \ge u_k$, then
        $v_{k+1} \ge T_* v_k \ge T_* u_k = u_{k+1}$, since $T_*$ is monotone. So $v_k \ge u_k$ for all $k$. No policy is worth more than
        $v_*$, so $v_* \ge v_k \ge u_k$, and $0 \le v_* - v_k \le v_* - u_k$ in every state: policy iteration is at least as near.
        """,
    ),
)


QUESTIONS = (
    Question(
        "Value iteration stops when a sweep changes no value by more than a small number. How far are the values from $v_*$?",
        (
            ("By at most that number", False, "With a discount near 1 many small changes may still follow."),
            (
                "By at most that number times gamma / (1 - gamma)",
                True,
                "Every later sweep changes them by at most gamma times as much; the "
                "changes add up to a geometric series.",
            ),
            ("Nothing can be said", False, "The contraction gives a bound, for a discount below 1."),
        ),
    ),
    Question(
        "Which method needs no model?",
        (
            ("Value iteration", False, "Every update sums over all next states with their probabilities."),
            ("Policy iteration", False, "Evaluation and improvement both use the dynamics."),
            ("Q-learning", True, "It uses one experienced transition for each update."),
        ),
    ),
    Question(
        "In the 6x9 maze Dyna-Q with 50 planning steps needs fewer real steps than Q-learning. Why?",
        (
            ("It explores less", False, "Both are epsilon-greedy with the same epsilon."),
            (
                "It uses each real transition many times",
                True,
                "The remembered model lets a reward spread over the table at once.",
            ),
            ("It knows the maze beforehand", False, "Its model holds only what it has met."),
        ),
    ),
    Question(
        "Why does `policy_improvement` keep the old action where several are equally good?",
        (
            (
                "Otherwise rounding can swap equal actions for ever",
                True,
                "The policy would never be the same twice in a row, and policy iteration would not stop.",
            ),
            ("The old action is better", False, "It is exactly as good."),
            ("The values would be wrong", False, "Both policies have the same values."),
        ),
    ),
)
