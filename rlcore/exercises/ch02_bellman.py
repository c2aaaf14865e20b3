"""Exercises of chapter 2: the Bellman equations."""

import numpy as np

from rlcore.bellman import expectation_backup, optimality_backup_q, q_from_v, solve_policy
from rlcore.envs import random_mdp, recycling_robot
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.mdp import FiniteMDP, uniform_policy

TITLE = "Exercises: the Bellman equations"
NOTEBOOK = "02_bellman"


def _chain():
    """Two states and a terminal one: go on for 1, or stop for 3 and end."""
    return FiniteMDP.from_outcomes(
        {
            (0, 0): [(0.5, 1, 1.0), (0.5, 0, 1.0)],
            (0, 1): [(1.0, 2, 3.0)],
            (1, 0): [(1.0, 2, 4.0)],
            (1, 1): [(1.0, 0, -1.0)],
        }
    )


def _models(rng):
    yield _chain()
    yield random_mdp(3, 2, n_next=2, rng=rng)


def _arrays(mdp, *names):
    return {name: getattr(mdp, name) for name in names}


Exercise(
    id="ch02-backup-by-hand",
    kind="by hand",
    tier="core",
    section="The Bellman equation",
    title="One backup with pencil and paper",
    statement=r"""
        In state $s$ a policy goes left with probability 0.25 and right with 0.75. Left pays 4 and leads to a state of value
        10. Right leads, with probability 0.5 each, to a state of value 8 with reward 0, or to a state of value $-4$ with
        reward 2. With $\gamma = 0.5$, what does the Bellman equation {eq}`eq-12` give for $v_\pi(s)$? Bind it to `v`.
    """,
    stub="v = ...",
    cases=lambda rng: [Case({}, 3.75)],
    hints=(
        "First the value of each action: reward plus half the value of the next state, averaged over what may happen.",
        "Left is worth $4 + 5 = 9$, right $0.5 (0 + 4) + 0.5 (2 - 2) = 2$. Average them with the policy.",
    ),
    solution="v = 0.25 * (4 + 0.5 * 10) + 0.75 * (0.5 * (0 + 0.5 * 8) + 0.5 * (2 + 0.5 * -4))",
    wrong=(
        Wrong(
            "v = 9 + 2", "sums over actions without pi: weigh each action with the probability that the policy takes it"
        ),
        Wrong("v = (9 + 2) / 2", "both actions count alike: the policy takes them with probabilities 0.25 and 0.75"),
        Wrong("v = 9", "this is the better action's value: (12) averages over the policy, (16) maximises"),
        Wrong("v = 0.25 * 14 + 0.75 * (0.5 * 8 + 0.5 * -2)", "gamma is missing from the bootstrap"),
    ),
    minutes=3,
    covers=("eq-12", "fig-3"),
)

Exercise(
    id="ch02-q-from-v",
    kind="fill in",
    tier="core",
    section="The same for action values",
    title="Action values from state values",
    statement=r"""
        Write the one-step lookahead {eq}`eq-15`: given the values `V` of all states, return
        $q(s, a) = \sum_{s', r} p(s', r \mid s, a)\,[r + \gamma V(s')]$ for every pair, as an array `(S, A)`.
        `prob`, `reward` and `next_state` are the outcome arrays `(S, A, K)` of a `FiniteMDP`.
    """,
    stub="""
        def q_from_values(prob, reward, next_state, V, gamma):
            ...
    """,
    cases=lambda rng: [
        Case({**_arrays(m, "prob", "reward", "next_state"), "V": V, "gamma": gamma}, q_from_v(m, V, gamma))
        for m in _models(rng)
        for gamma in (0.9, 0.5)
        for V in [np.where(m.terminal, 0.0, rng.normal(size=m.n_states).round(2))]
    ],
    hints=(
        "`V[next_state]` looks up the value of every successor at once; its shape is `(S, A, K)`.",
        "Multiply the sum of reward and discounted value by the probabilities and sum over the last axis.",
    ),
    solution="""
        def q_from_values(prob, reward, next_state, V, gamma):
            target = reward + gamma * V[next_state]
            return (prob * target).sum(axis=2)
    """,
    wrong=(
        Wrong(
            """
            def q_from_values(prob, reward, next_state, V, gamma):
                return (prob * (reward + V[next_state])).sum(axis=2)
            """,
            "gamma is missing from the bootstrap: the value of the next state is not discounted",
        ),
        Wrong(
            """
            def q_from_values(prob, reward, next_state, V, gamma):
                return (reward + gamma * V[next_state]).sum(axis=2)
            """,
            "the outcomes are summed without their probabilities",
        ),
        Wrong(
            """
            def q_from_values(prob, reward, next_state, V, gamma):
                return gamma * (prob * (reward + V[next_state])).sum(axis=2)
            """,
            "the reward is discounted too: gamma belongs to the value of the next state alone",
        ),
        Wrong(
            """
            def q_from_values(prob, reward, next_state, V, gamma):
                return (prob * reward).sum(axis=2) + gamma * V[:, None]
            """,
            "this bootstraps from the state itself: look up the value of the next state",
        ),
    ),
    minutes=5,
    covers=("eq-15", "alg-greedy-lookahead"),
)

Exercise(
    id="ch02-expectation-backup",
    kind="fill in",
    tier="core",
    section="The Bellman equation",
    title="The Bellman equation as a function",
    statement=r"""
        Write the right-hand side of {eq}`eq-12` for all states at once and return it as `(S,)`. `pi` is `(S, A)`, the outcome
        arrays are `(S, A, K)`. `terminal` is `(S,)`; a terminal state counts 0, **whatever `V` and its rows of the arrays say**, as a successor
        and as a state.
    """,
    stub="""
        def backup(pi, prob, reward, next_state, terminal, V, gamma):
            ...
    """,
    cases=lambda rng: [
        Case(
            {
                "pi": pi,
                **_arrays(m, "prob", "reward", "next_state", "terminal"),
                "reward": paid,
                "V": V,
                "gamma": gamma,
            },
            expectation_backup(m, pi, V, gamma),
        )
        for m in _models(rng)
        for gamma in (0.9, 0.6)
        for V in [rng.normal(size=m.n_states).round(2) + 1]
        for pi in [rng.dirichlet(np.ones(m.n_actions), size=m.n_states)]
        for paid in [np.where(m.terminal[:, None, None], 1.0, m.reward)]  # of a terminal state: means nothing
    ],
    hints=(
        "Set the terminal values to 0 in a copy first: `V = np.where(terminal, 0.0, V)`.",
        "Then compute the action values as in *Action values from state values*, and average them with `pi` over the actions; a terminal state itself is worth 0, whatever its row of the arrays says.",
    ),
    solution="""
        def backup(pi, prob, reward, next_state, terminal, V, gamma):
            V = np.where(terminal, 0.0, V)
            Q = (prob * (reward + gamma * V[next_state])).sum(axis=2)
            return np.where(terminal, 0.0, (pi * Q).sum(axis=1))
    """,
    wrong=(
        Wrong(
            {
                "    V = np.where(terminal, 0.0, V)\n": "",
            },
            "the terminal state is bootstrapped: its value as a successor is 0",
        ),
        Wrong(
            """
            def backup(pi, prob, reward, next_state, terminal, V, gamma):
                V = np.where(terminal, 0.0, V)
                return np.where(terminal, 0.0, (prob * (reward + gamma * V[next_state])).sum(axis=2).sum(axis=1))
            """,
            "sums over actions without pi",
        ),
        Wrong(
            """
            def backup(pi, prob, reward, next_state, terminal, V, gamma):
                V = np.where(terminal, 0.0, V)
                return np.where(terminal, 0.0, (prob * (reward + gamma * V[next_state])).sum(axis=2).max(axis=1))
            """,
            "takes the best action: this is the optimality equation (2.16); (2.12) averages over the policy",
        ),
        Wrong(
            """
            def backup(pi, prob, reward, next_state, terminal, V, gamma):
                V = np.where(terminal, 0.0, V)
                return np.where(terminal, 0.0, (pi * (prob * (reward + V[next_state])).sum(axis=2)).sum(axis=1))
            """,
            "gamma is missing from the bootstrap",
        ),
        Wrong(
            {"np.where(terminal, 0.0, (pi * Q).sum(axis=1))": "(pi * Q).sum(axis=1)"},
            "a terminal state counts 0 as a state, too, whatever its row of `reward` says",
        ),
    ),
    minutes=8,
    covers=("eq-12", "alg-bellman-operators"),
)


def _chain_of_policy(rng, S):
    return rng.dirichlet(np.ones(S), size=S), rng.normal(size=S).round(2)


Exercise(
    id="ch02-solve-exactly",
    kind="fill in",
    tier="core",
    section="The inverse exists",
    title="The value of a policy without iteration",
    statement=r"""
        For a fixed policy the Bellman equation is linear: $v = r + \gamma P v$, with $P$ `(S, S)` the transition matrix of the
        policy, rows summing to 1, and $r$ `(S,)` its expected rewards. Return $v$ exactly, with `np.linalg.solve`.
    """,
    stub="""
        def value(P, r, gamma):
            ...
    """,
    cases=lambda rng: [
        Case(dict(P=P, r=r, gamma=gamma), np.linalg.inv(np.eye(S) - gamma * P) @ r)
        for S, gamma in ((2, 0.5), (4, 0.9), (3, 0.99))
        for P, r in [_chain_of_policy(rng, S)]
    ],
    hints=(
        "Bring all terms with $v$ to one side.",
        r"$(I - \gamma P)\, v = r$; `np.eye(len(r))` is $I$.",
    ),
    solution="""
        def value(P, r, gamma):
            A = np.eye(len(r)) - gamma * P
            return np.linalg.solve(A, r)
    """,
    wrong=(
        Wrong(
            """
            def value(P, r, gamma):
                return np.linalg.solve(np.eye(len(r)) + gamma * P, r)
            """,
            "the sign: v - gamma P v = r",
        ),
        Wrong(
            """
            def value(P, r, gamma):
                return np.linalg.solve(np.eye(len(r)) - gamma * P.T, r)
            """,
            "P is transposed: its rows are the states that are left, the columns those that are entered",
        ),
        Wrong(
            """
            def value(P, r, gamma):
                return r + gamma * P @ r
            """,
            "this looks one step ahead only; the solution counts all steps",
        ),
    ),
    minutes=6,
    covers=("eq-12", "cl-012"),
)


def _with_illegal(rng):
    """All values below 0, so that an action that is not there looks best."""
    for _ in range(2):
        Q = -1 - rng.random((3, 3)).round(2)
        legal = np.array([[True, True, False], [True, False, False], [True, True, True]])
        next_state = rng.integers(3, size=(3, 3, 2))
        prob = np.where(legal[:, :, None], rng.dirichlet(np.ones(2), size=(3, 3)), 0.0)
        reward = np.where(prob > 0, -rng.random((3, 3, 2)).round(2), 0.0)
        mdp = FiniteMDP(next_state, prob, reward, legal, np.zeros(3, bool), np.eye(3)[0])
        yield mdp, np.where(legal, Q, 0.0)


Exercise(
    id="ch02-bug-illegal",
    kind="find the bug",
    tier="more",
    section="Why acting greedily on optimal values is optimal",
    title="An action that is not there",
    statement=r"""
        This is the Bellman optimality equation {eq}`eq-17`. From `Q` `(S, A)`, which holds 0 where an action does
        not exist, and `legal` `(S, A)`, which says where one does, it computes the right side for every pair, `(S, A)`; the
        outcome arrays are `(S, A, K)`. All values of this process are negative. The function runs, and its values
        creep upwards. Find the reason and mend it. (What it returns for actions that do not exist does not matter: leave 0.)
    """,
    stub="""
        def optimality(prob, reward, next_state, legal, Q, gamma):
            best = Q.max(axis=1)
            return (prob * (reward + gamma * best[next_state])).sum(axis=2)
    """,
    cases=lambda rng: [
        Case(
            {**_arrays(m, "prob", "reward", "next_state", "legal"), "Q": Q, "gamma": 0.9},
            np.where(m.legal, optimality_backup_q(m, Q, 0.9), 0.0),
        )
        for m, Q in _with_illegal(rng)
    ],
    hints=(
        "What is the largest entry in a row of `Q`, if all real values are negative and a missing one is 0?",
        "Take the maximum over legal actions only: put `-np.inf` where `legal` is False.",
    ),
    solution="""
        def optimality(prob, reward, next_state, legal, Q, gamma):
            best = np.where(legal, Q, -np.inf).max(axis=1)
            return (prob * (reward + gamma * best[next_state])).sum(axis=2)
    """,
    wrong=(
        Wrong(
            """
            def optimality(prob, reward, next_state, legal, Q, gamma):
                return (prob * (reward + gamma * Q[next_state].max(axis=3))).sum(axis=2)
            """,
            "the maximum still includes actions that do not exist, whose 0 beats every real value",
        ),
        Wrong(
            {"np.where(legal, Q, -np.inf).max": "Q.sum(axis=1) / legal.sum"},
            "this averages over the legal actions: (17) takes the best one",
        ),
        Wrong(
            {"max(axis=1)": "max()", "best[next_state]": "best"},
            "one maximum for all states: each next state has its own",
        ),
        Wrong(
            {"np.where(legal, Q, -np.inf).max": "Q.min"},
            "this takes the worst action: the best one is the largest among the legal",
        ),
    ),
    minutes=8,
    covers=("eq-17",),
)


def _shared(Q):
    best = Q.max(axis=1, keepdims=True) - Q <= 1e-9
    return best / best.sum(axis=1, keepdims=True)


Exercise(
    id="ch02-greedy-ties",
    kind="fill in",
    tier="more",
    section="Looking further ahead",
    title="A greedy policy that shares ties",
    statement=r"""
        Any policy that gives probability to maximising actions only is optimal if `Q` is $q_*$. Return the policy `(S, A)`
        that gives **equal probability to all maximising actions** of a state and 0 to the others. Values within
        `1e-9` of the maximum are ties. For the row `[1, 3, 3]` the result is `[0, 0.5, 0.5]`.
    """,
    stub="""
        def greedy(Q):
            ...
    """,
    cases=lambda rng: [
        Case(dict(Q=Q), _shared(Q), printed=len(Q) == 1)
        for Q in (
            np.array([[1.0, 3.0, 3.0]]),
            np.array([[2.0, 2.0, 2.0], [0.0, -1.0, 0.0], [-5.0, -4.0, -3.0], [0.3, 0.1 + 0.2, 0.0]]),
            rng.integers(3, size=(4, 4)).astype(float),
            np.array([[1.0, 1 + 5e-10, 1 - 3e-9], [1e6, 1e6 - 1e-3, 0.0], [0.0, 2e-9, -7e-9], [0.01, 0.0, 0.015]]),
        )
    ],
    hints=(
        "Compare every entry with the maximum of its row; `keepdims=True` keeps the shapes compatible.",
        "Turn the comparison into numbers and divide each row by its sum.",
    ),
    solution="""
        def greedy(Q):
            best = Q >= Q.max(axis=1, keepdims=True) - 1e-9
            return best / best.sum(axis=1, keepdims=True)
    """,
    wrong=(
        Wrong(
            """
            def greedy(Q):
                return np.eye(Q.shape[1])[Q.argmax(axis=1)]
            """,
            "only the first maximising action gets probability: share it among all of them",
        ),
        Wrong(
            """
            def greedy(Q):
                return (Q >= Q.max(axis=1, keepdims=True) - 1e-9).astype(float)
            """,
            "rows with ties sum to more than 1: divide by the number of maximising actions",
        ),
        Wrong(
            {">= Q.max(axis=1, keepdims=True) - 1e-9": "== Q.max(axis=1, keepdims=True)"},
            "exact comparison breaks ties that differ by rounding only, such as 0.1 + 0.2 and 0.3: allow 1e-9",
        ),
        Wrong(
            """
            def greedy(Q):
                best = Q >= Q.max() - 1e-9
                return np.divide(best, best.sum(axis=1, keepdims=True), where=best.any(axis=1, keepdims=True), out=np.zeros(Q.shape))
            """,
            "one maximum for the whole table: each state has its own",
        ),
    ),
    minutes=6,
    covers=("cl-013", "cl-015", "alg-greedy-lookahead"),
)

Exercise(
    id="ch02-predict-depth",
    kind="predict",
    tier="more",
    section="Looking further ahead",
    title="How deep must the search go?",
    statement=r"""
        A search of depth $d$ uses estimates at its leaves that are wrong by at most 10. With $\gamma = 0.9$, the value at the
        root is wrong by at most $\gamma^d \cdot 10$. Predict first: 10, 20, 40 or 80 steps? Then find the smallest $d$ for
        which the bound is at most 0.1, and bind it to `d`.
    """,
    stub="d = ...",
    cases=lambda rng: [Case({}, int(np.ceil(np.log(0.01) / np.log(0.9))))],
    hints=(
        r"Solve $0.9^d \cdot 10 \le 0.1$, that is $0.9^d \le 0.01$, with logarithms; mind the direction of rounding.",
        "Or count: `next(d for d in range(1000) if 10 * 0.9**d <= 0.1)`.",
    ),
    solution="d = next(d for d in range(1000) if 10 * 0.9**d <= 0.1)",
    wrong=(
        Wrong("d = 43", "one step too few: at this depth the bound is still above 0.1"),
        Wrong("d = 10", "10 is 1 / (1 - gamma); after that many steps the bound has only fallen to 3.5"),
        Wrong("d = 22", "this brings the bound to 1, not to 0.1"),
    ),
    minutes=4,
    covers=("alg-heuristic-search", "cl-016"),
)


def _machine(wear, cost):
    outcomes = {
        (0, 0): [(1 - wear, 0, 5.0), (wear, 1, 5.0)],
        (0, 1): [(1.0, 0, -cost)],
        (1, 0): [(0.5, 1, 2.0), (0.5, 2, 2.0)],
        (1, 1): [(1.0, 0, -cost)],
        (2, 1): [(1.0, 0, -3 * cost)],
    }
    return FiniteMDP.from_outcomes(outcomes, start=0)


Exercise(
    id="ch02-build-machine",
    kind="build",
    tier="more",
    section="The inverse exists",
    title="A machine that wears out",
    statement="""
        Build this process with `FiniteMDP.from_outcomes` and return it. States: 0 good, 1 worn, 2 broken. Actions: 0 run,
        1 repair. A good machine that runs earns 5 and becomes worn with probability `wear`. A worn machine that runs
        earns 2 and breaks with probability one half. Repair makes the machine good again and costs `cost`, three times
        that when it is broken. A broken machine cannot run. It starts good and nothing ever ends.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def machine(wear, cost):
            ...
    """,
    cases=lambda rng: [Case(dict(wear=w, cost=c), _machine(w, c)) for w, c in ((0.2, 4.0), (0.7, 1.0))],
    hints=(
        "Five pairs have outcomes; the pair (2, 0) is left out of the table, since a broken machine cannot run.",
        "Costs are negative rewards: `(2, 1): [(1, 0, -3 * cost)]`.",
    ),
    solution="""
        def machine(wear, cost):
            outcomes = {
                (0, 0): [(1 - wear, 0, 5), (wear, 1, 5)],
                (0, 1): [(1, 0, -cost)],
                (1, 0): [(0.5, 1, 2), (0.5, 2, 2)],
                (1, 1): [(1, 0, -cost)],
                (2, 1): [(1, 0, -3 * cost)],
            }
            return FiniteMDP.from_outcomes(outcomes, start=0)
    """,
    wrong=(
        Wrong(
            {"(2, 1):": "(2, 0): [(1, 2, 0)], (2, 1):"},
            "a broken machine cannot run: leave the pair (2, 0) out instead of letting it run in vain",
        ),
        Wrong(
            {
                "(0, 1): [(1, 0, -cost)]": "(0, 1): [(1, 0, cost)]",
                "(1, 1): [(1, 0, -cost)]": "(1, 1): [(1, 0, cost)]",
                "-3 * cost": "3 * cost",
            },
            "the sign of the cost: a repair is a negative reward",
        ),
        Wrong({"-3 * cost": "-cost"}, "repairing a broken machine costs three times as much"),
        Wrong(
            {"(1 - wear, 0, 5), (wear, 1, 5)": "(wear, 0, 5), (1 - wear, 1, 5)"},
            "the probabilities are swapped: wear is the chance of becoming worn",
        ),
    ),
    minutes=10,
    covers=("eq-16",),
)


def _printed_q():
    robot = recycling_robot(beta=0.9)
    return float(q_from_v(robot, solve_policy(robot, uniform_policy(robot), 0.9), 0.9)[0, 0])


Exercise(
    id="ch02-claim-eq-17",
    kind="experiment",
    tier="deep",
    section="Why acting greedily on optimal values is optimal",
    title="Does the first line of (17) hold?",
    statement=r"""
        The document writes $q_*(s, a) = \mathbb E[R_{t+1} + \gamma G_{t+1} \mid S_t = s, A_t = a]$. Test it on the recycling
        robot with `beta=0.9` and $\gamma = 0.9$, the return $G_{t+1}$ being that of the **equiprobable** policy. Compute this
        expectation for searching with high charge (state 0, action 0), compare it with $q_*$, and bind `verdict` to
        `("confirmed", number)` or `("refuted", number)`, the number being the expectation rounded to two decimals.
        `solve_policy`, `q_from_v` and `value_iteration` do the work.
    """,
    setup=(
        "import numpy as np\nfrom rlcore.bellman import q_from_v, solve_policy\nfrom rlcore.dp import value_iteration\n"
        "from rlcore.envs import recycling_robot\nfrom rlcore.mdp import uniform_policy"
    ),
    stub="verdict = ...",
    cases=lambda rng: [Case({}, ("refuted", round(_printed_q(), 2)))],
    hints=(
        "The expectation is $q_\\pi$ of the pair: solve for $v_\\pi$, then look one step ahead.",
        "`V = solve_policy(robot, uniform_policy(robot), 0.9)`, then `q_from_v(robot, V, 0.9)[0, 0]`.",
    ),
    solution="""
        robot = recycling_robot(beta=0.9)
        V = solve_policy(robot, uniform_policy(robot), 0.9)
        verdict = ("refuted", round(float(q_from_v(robot, V, 0.9)[0, 0]), 2))
    """,
    wrong=(
        Wrong(
            """
            robot = recycling_robot(beta=0.9)
            verdict = ("confirmed", round(float(value_iteration(robot, 0.9).Q[0, 0]), 2))
            """,
            "this is q_* itself: the return must be that of the equiprobable policy",
        ),
        Wrong(
            {"q_from_v(robot, V, 0.9)[0, 0]": "V[0]"}, "this is v_pi of the state; the first action is fixed: search"
        ),
        Wrong({'"refuted"': '"confirmed"'}, "the number is right; it is not q_*, so that the printed line is refuted"),
        Wrong({"beta=0.9": ""}, "this is the robot with beta = 0.6; the exercise asks for beta = 0.9"),
    ),
    minutes=10,
    covers=("eq-17", "ex-recycling"),
)

PROOFS = (
    Proof(
        "Two properties make a contraction",
        r"""
        An operator $T$ takes value functions to value functions. It is *monotone*: if $v(s) \le w(s)$ in all states, then
        $(T v)(s) \le (T w)(s)$ in all states. And it *discounts*: for every number $c \ge 0$, $T (v + c) = T v + \gamma c$, where
        $v + c$ adds $c$ in every state. Show that $\max_s |T v - T w| \le \gamma \max_s |v - w|$ for all $v$ and $w$, and check that
        the operator of {eq}`eq-16` has both properties; let terminal states lead to themselves with the reward 0.
        """,
        (
            "A bound of $v$ by $w$ plus a constant, with $c = \\max_s |v - w|$.",
            "Monotone first, then discounting, in this order, and what each gives.",
            "The other direction, with $v$ and $w$ exchanged: only both bound the absolute value.",
            "For the operator: larger values make each backup larger, so also the largest; and a constant leaves the maximum as $\\gamma c$, because the probabilities sum to 1.",
        ),
        r"""
        Let $c = \max_s |v(s) - w(s)|$. Then $v \le w + c$ in every state. Since $T$ is monotone and discounts,
        $T v \le T (w + c) = T w + \gamma c$, that is $T v - T w \le \gamma c$ in every state. With $v$ and $w$ exchanged,
        $T w - T v \le \gamma c$. Both together say $|T v - T w| \le \gamma c$ in every state, so the largest is at most $\gamma c$.

        The operator of {eq}`eq-16` is $(T v)(s) = \max_a \sum_{s', r} p(s', r \mid s, a) (r + \gamma v(s'))$. If $v \le w$, each sum
        with $v$ is at most that with $w$, since the probabilities are not negative; so is the largest sum. And with $v + c$ each
        sum grows by $\sum_{s', r} p(s', r \mid s, a)\, \gamma c = \gamma c$, hence the maximum does.
        """,
    ),
)


QUESTIONS = (
    Question(
        "How many equations has the Bellman optimality equation for $v_*$, and of what kind?",
        (
            (
                "One for each state, linear",
                False,
                "The maximum makes them nonlinear; those of a fixed policy are linear.",
            ),
            (
                "One for each state, nonlinear",
                True,
                "n states give n equations in n unknowns, piecewise linear through the maximum.",
            ),
            ("One for each pair of state and action", False, "That is the system for $q_*$."),
        ),
    ),
    Question(
        "You know $v_*$ but not the dynamics. Can you act optimally?",
        (
            (
                "Yes, the optimal values say everything",
                False,
                "To compare actions you must know where they lead, which is the model.",
            ),
            (
                "No, one step of lookahead needs the dynamics",
                True,
                "With $q_*$ you would only compare the entries of a row.",
            ),
        ),
    ),
    Question(
        "Two deterministic policies are both optimal in a finite process with a discount below 1. Which is true?",
        (
            ("They take the same actions", False, "Where two actions are equally good they may differ."),
            ("They have the same values in all states", True, "All optimal policies share $v_*$ and $q_*$."),
            ("One of them is better in some states", False, "Then the other would not be optimal."),
        ),
    ),
    Question(
        "Which of the three usual assumptions makes solving the Bellman equation for backgammon a matter of thousands of years?",
        (
            ("Knowing the dynamics", False, "The rules and the dice are known exactly."),
            (
                "Enough computing power",
                True,
                "One sweep over 10 to the 20 states takes 3,169 years at a thousand million backups a second.",
            ),
            ("The Markov property", False, "The position says all that matters."),
        ),
    ),
)
