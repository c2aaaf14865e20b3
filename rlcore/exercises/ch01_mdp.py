"""Exercises of chapter 1: processes, returns, averages of returns."""

import numpy as np

from rlcore.envs import random_mdp, recycling_robot
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.mdp import FiniteMDP, discounted_returns

TITLE = "Exercises: Markov decision processes"
NOTEBOOK = "01_mdp"

Exercise(
    id="ch01-return-by-hand",
    kind="by hand",
    tier="core",
    section="A return contains the next return",
    title="One return with pencil and paper",
    statement=r"""
        An episode pays $R_1 = 5$, $R_2 = 2$, $R_3 = -4$, $R_4 = 32$ and ends. With $\gamma = 0.5$, what is $G_0$
        ({eq}`eq-7`)? Bind the number to `G0`.
    """,
    stub="G0 = ...",
    cases=lambda rng: [Case({}, float(discounted_returns([5, 2, -4, 32], 0.5)[0]))],
    hints=(
        "The first reward counts in full; each later one is halved once more than the one before.",
        "The four terms are $5$, $2/2$, $-4/4$ and $32/8$.",
    ),
    solution="G0 = 5 + 0.5 * 2 + 0.25 * -4 + 0.125 * 32",
    wrong=(
        Wrong("G0 = 5 + 2 - 4 + 32", "gamma is missing: this is the plain sum of the rewards"),
        Wrong(
            "G0 = 0.5 * 5 + 0.25 * 2 + 0.125 * -4 + 0.0625 * 32",
            "the first reward is discounted already: R_1 counts with gamma to the power 0",
        ),
        Wrong(
            "G0 = 5 + 0.5 * 5",
            "this is the misprinted recursion R_1 + gamma R_1; the second term must be gamma times the return G_1",
        ),
    ),
    minutes=2,
    covers=("eq-7", "eq-8"),
)

Exercise(
    id="ch01-backward-returns",
    kind="fill in",
    tier="core",
    section="A return contains the next return",
    title="All returns in one backward pass",
    statement=r"""
        Fill in the recursion {eq}`eq-8`. `rewards[t]` is $R_{t+1}$; return $G_0, \dots, G_{T-1}$ as an array of the same
        length, with $G_T = 0$. For rewards $-1, 2, 6, 3, 2$ and $\gamma = 0.5$ the result is $2, 6, 8, 4, 2$.
    """,
    stub="""
        def returns(rewards, gamma):
            G = np.zeros(len(rewards))
            following = 0.0
            for t in reversed(range(len(rewards))):
                G[t] = ...
                following = ...
            return G
    """,
    cases=lambda rng: [
        Case(dict(rewards=r, gamma=gamma), discounted_returns(r, gamma), printed=r.size == 5)
        for r, gamma in [
            (np.array([-1.0, 2, 6, 3, 2]), 0.5),
            (rng.normal(size=4).round(2), 0.9),
            (rng.normal(size=7).round(2), 0.3),
            (np.array([1.5]), 0.7),
            (np.array([3, -1, 2]), 0.3),
        ]
    ],
    hints=(
        "Going backwards, the return of the next step is known when you need it: it is `following`.",
        "`G[t]` is the reward `rewards[t]` plus `gamma` times `following`; then `G[t]` becomes `following`.",
    ),
    solution="""
        def returns(rewards, gamma):
            G = np.zeros(len(rewards))
            following = 0.0
            for t in reversed(range(len(rewards))):
                G[t] = rewards[t] + gamma * following
                following = G[t]
            return G
    """,
    wrong=(
        Wrong(
            """
            def returns(rewards, gamma):
                return rewards + gamma * rewards
            """,
            "the recursion uses R_{t+1} twice, as misprinted; the second term is gamma times the next return",
        ),
        Wrong(
            """
            def returns(rewards, gamma):
                return np.cumsum(rewards[::-1])[::-1]
            """,
            "gamma is missing: these are undiscounted sums of the rewards to come",
        ),
        Wrong(
            {
                "G[t] = rewards[t] + gamma * following": "following = gamma * (rewards[t] + following)",
                "following = G[t]": "G[t] = following",
            },
            "the first reward is discounted too: R_{t+1} counts in full in G_t",
        ),
        Wrong(
            """
            def returns(rewards, gamma):
                G = np.zeros(len(rewards))
                so_far = 0.0
                for t in range(len(rewards)):
                    so_far = rewards[t] + gamma * so_far
                    G[t] = so_far
                return G
            """,
            "the pass runs forwards: it adds up past rewards instead of those to come",
        ),
    ),
    minutes=4,
    covers=("eq-8", "alg-returns"),
)


def _tables(rng):
    """Outcome arrays of a small random process, and of the recycling robot."""
    yield random_mdp(3, 2, n_next=3, rng=rng)
    yield recycling_robot(alpha=0.8, beta=0.3, r_search=5.0, r_wait=2.0, r_rescue=-7.0)


def _arrays(mdp, *names):
    return {name: getattr(mdp, name) for name in names}


Exercise(
    id="ch01-expected-reward",
    kind="fill in",
    tier="core",
    section="The dynamics in one function",
    title="Expected reward of a pair",
    statement=r"""
        Write equation {eq}`eq-4`: from the outcome arrays `prob` and `reward`, both `(S, A, K)`, compute $r(s, a)$ as an
        array `(S, A)`. Outcome `k` of the pair `(s, a)` has probability `prob[s, a, k]` and pays `reward[s, a, k]`.
    """,
    stub="""
        def expected_reward(prob, reward):
            ...
    """,
    cases=lambda rng: [Case(_arrays(m, "prob", "reward"), m.expected_reward()) for m in _tables(rng)],
    hints=(
        "An expectation is a sum of values, each times its probability.",
        "Multiply the two arrays and sum over the last axis, the outcomes.",
    ),
    solution="""
        def expected_reward(prob, reward):
            return (prob * reward).sum(axis=2)
    """,
    wrong=(
        Wrong(
            {"(prob * reward).sum": "reward.mean"},
            "every outcome counts alike: weigh the rewards with their probabilities",
        ),
        Wrong({"(prob * reward)": "reward"}, "the rewards are added without their probabilities"),
        Wrong(
            {
                "(prob * reward).sum(axis=2)": "np.take_along_axis(reward, prob.argmax(axis=2)[:, :, None], axis=2)[:, :, 0]"
            },
            "this is the reward of the likeliest outcome, not the expected one",
        ),
    ),
    minutes=3,
    covers=("eq-4", "alg-model-marginals"),
)


def _doubled(rng):
    """Outcomes with the same next state and another reward, so that one next state occurs twice in a row."""
    for S in (3, 2):
        prob = rng.dirichlet(np.ones(3), size=(S, 2))
        next_state = rng.integers(S, size=(S, 2, 3))
        next_state[:, :, 2] = next_state[:, :, 0]
        yield FiniteMDP(
            next_state,
            prob,
            rng.normal(size=(S, 2, 3)).round(1),
            np.ones((S, 2), bool),
            np.zeros(S, bool),
            np.eye(S)[0],
        )


Exercise(
    id="ch01-bug-transitions",
    kind="find the bug",
    tier="more",
    section="The dynamics in one function",
    title="Probabilities that get lost",
    statement=r"""
        This function should compute $p(s' \mid s, a)$ as `(S, A, S)` (equation {eq}`eq-3`) from the outcome arrays `prob` and
        `next_state`, both `(S, A, K)`. It runs, and for many processes its result is right. Two outcomes of a pair may lead to the same $s'$ with different rewards; then its rows do not
        sum to 1. Find the line and mend it.
    """,
    stub="""
        def transition_probs(prob, next_state):
            S, A, K = prob.shape
            P = np.zeros((S, A, S))
            for s in range(S):
                for a in range(A):
                    for k in range(K):
                        P[s, a, next_state[s, a, k]] = prob[s, a, k]
            return P
    """,
    cases=lambda rng: [Case(_arrays(m, "prob", "next_state"), m.transition_probs()) for m in _doubled(rng)],
    hints=(
        "Print the sums of the rows. What happens to the first of two outcomes that lead to the same state?",
        "Equation (3) sums over the rewards: the probabilities of outcomes with the same next state add up.",
    ),
    solution="""
        def transition_probs(prob, next_state):
            S, A, K = prob.shape
            P = np.zeros((S, A, S))
            for s in range(S):
                for a in range(A):
                    for k in range(K):
                        P[s, a, next_state[s, a, k]] += prob[s, a, k]
            return P
    """,
    wrong=(
        Wrong(
            """
            def transition_probs(prob, next_state):
                P = np.zeros((*prob.shape[:2], prob.shape[0]))
                np.put_along_axis(P, next_state.astype(int), prob, axis=2)
                return P
            """,
            "the second of two outcomes with the same next state overwrites the first: add the probabilities up",
        ),
        Wrong(
            """
            def transition_probs(prob, next_state):
                P = np.zeros((*prob.shape[:2], prob.shape[0]))
                np.put_along_axis(P, next_state.astype(int), prob, axis=2)
                return P / P.sum(axis=2, keepdims=True)
            """,
            "the lost probability is hidden by dividing each row by its sum: add the probabilities up instead",
        ),
        Wrong({"prob[s, a, k]": "1 / K"}, "every outcome counts alike: add prob[s, a, k], not 1 / K"),
    ),
    minutes=6,
    covers=("eq-3", "eq-2"),
)

Exercise(
    id="ch01-predict-pole",
    kind="predict",
    tier="core",
    section="One task, two returns",
    title="A pole that falls for ever",
    statement=r"""
        In the continuing form of pole balancing the reward is $-1$ on a failing step and 0 on all others. A policy fails on
        every 5th step, for ever: $R_5 = R_{10} = R_{15} = \dots = -1$. With $\gamma = 0.8$, predict $G_0$ before you run
        anything; then bind the number to `G0_pole`.
    """,
    stub="G0_pole = ...",
    cases=lambda rng: [Case({}, -(0.8**4) / (1 - 0.8**5))],
    hints=(
        r"The first failure contributes $-\gamma^4$. The second one comes 5 steps later.",
        r"The contributions form a geometric series with ratio $\gamma^5$.",
    ),
    solution="G0_pole = -(0.8**4) / (1 - 0.8**5)",
    wrong=(
        Wrong("G0_pole = -(0.8**4)", "this counts the first failure only, as the document's formula does"),
        Wrong({"0.8**4": "0.8**5"}, "one factor gamma too many: R_5 counts with gamma to the power 4"),
        Wrong({"0.8**5": "0.8"}, "the failures come every 5 steps: the ratio of the series is gamma to the 5"),
        Wrong({"-(0.8**4)": "(0.8**4)"}, "the sign: a failure pays -1"),
    ),
    minutes=4,
    digits=4,
    covers=("eq-u-pole-return", "ex-pole-continuing"),
)


def _ferry(p=0.75):
    outcomes = {
        (0, 0): [(p, 1, -2.0), (1 - p, 0, -2.0)],
        (0, 1): [(1.0, 0, -1.0)],
        (1, 0): [(1.0, 2, 10.0)],
        (1, 1): [(1.0, 0, -1.0)],
    }
    return FiniteMDP.from_outcomes(outcomes, start=0)


Exercise(
    id="ch01-build-ferry",
    kind="build",
    tier="more",
    section="The dynamics in one function",
    title="A ferry from its description",
    statement="""
        Build this process with `FiniteMDP.from_outcomes` and return it. States: 0 home bank, 1 middle of the river, 2 far
        bank. Actions: 0 row, 1 wait. Rowing from home costs 2 and gets the boat to the middle with probability `p`,
        otherwise the current brings it back home. Rowing from the middle reaches the far bank for certain and pays 10;
        there the episode ends. Waiting costs 1: at home nothing happens, in the middle the boat drifts home. Episodes start
        at home. `from_outcomes` takes `{(s, a): [(probability, s_next, reward), ...]}` and `start`.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def ferry(p):
            ...
    """,
    cases=lambda rng: [Case(dict(p=p), _ferry(p)) for p in (0.75, 0.4)],
    hints=(
        "A state that has no action in the table is terminal: leave state 2 out of the keys.",
        "Rowing from home has two outcomes, both with reward -2: `[(p, 1, -2), (1 - p, 0, -2)]`.",
    ),
    solution="""
        def ferry(p):
            outcomes = {
                (0, 0): [(p, 1, -2), (1 - p, 0, -2)],
                (0, 1): [(1, 0, -1)],
                (1, 0): [(1, 2, 10)],
                (1, 1): [(1, 0, -1)],
            }
            return FiniteMDP.from_outcomes(outcomes, start=0)
    """,
    wrong=(
        Wrong(
            {"(1, 1): [(1, 0, -1)],": "(1, 1): [(1, 0, -1)], (2, 0): [(1, 2, 0)], (2, 1): [(1, 2, 0)],"},
            "the far bank is not terminal: a state is terminal when the table has no action for it",
        ),
        Wrong(
            {"(1 - p, 0, -2)": "(1 - p, 0, 0)"},
            "rowing costs 2 whether the boat gets on or is brought back: both outcomes pay -2",
        ),
        Wrong(
            {"(p, 1, -2), (1 - p, 0, -2)": "(1 - p, 1, -2), (p, 0, -2)"},
            "the probabilities are swapped: p is the chance of reaching the middle",
        ),
        Wrong({", start=0": ""}, "episodes start at home: pass start=0"),
    ),
    minutes=10,
    covers=("alg-model-marginals", "eq-1"),
)

Exercise(
    id="ch01-claim-bounded",
    kind="experiment",
    tier="more",
    section="What discounting does",
    title="Must rewards be bounded?",
    statement=r"""
        The document says that with $\gamma < 1$ the infinite return is finite *only if* the rewards are bounded. Test it with
        the unbounded rewards $R_k = k$ and $\gamma = 0.95$: add up $\gamma^{k-1} R_k$ until the sum stands still. Bind
        `verdict` to a pair: `"confirmed"` or `"refuted"`, and the sum rounded to a whole number (`inf` if it diverges), such as
        `("confirmed", float("inf"))`.
    """,
    stub="verdict = ...",
    cases=lambda rng: [Case({}, ("refuted", 400.0))],
    hints=(
        "`k = np.arange(1, 2000)` and `gamma ** (k - 1) * k`; the terms shrink although the rewards grow.",
        r"The closed form is $1 / (1 - \gamma)^2$.",
    ),
    solution="""
        k = np.arange(1, 2000)
        total = np.sum(0.95 ** (k - 1) * k)
        verdict = ("refuted", float(round(total)))
    """,
    wrong=(
        Wrong(
            'verdict = ("confirmed", float("inf"))',
            "add up a few hundred terms: the sum stands still, it does not diverge",
        ),
        Wrong(
            'verdict = ("confirmed", 400.0)',
            "the number is right, and it is finite although the rewards are not bounded: that refutes the claim",
        ),
        Wrong('verdict = ("refuted", 20.0)', "this is the return of a constant reward 1; here R_k = k"),
        Wrong('verdict = ("refuted", 380.0)', "one factor gamma too many: R_k counts with gamma to the power k - 1"),
    ),
    minutes=6,
    covers=("cl-003", "eq-7"),
)


def _episodes(rng, n, S):
    for _ in range(n):
        T = int(rng.integers(3, 7))
        yield rng.integers(S, size=T), rng.normal(size=T).round(1)


def _first_visit(episodes, gamma, S):
    found = [[] for _ in range(S)]
    for states, rewards in episodes:
        G = discounted_returns(rewards, gamma)
        for s in set(states.tolist()):
            found[s].append(G[list(states).index(s)])
    return np.array([np.mean(g) if g else 0.0 for g in found])


Exercise(
    id="ch01-first-visit",
    kind="fill in",
    tier="deep",
    section="Why averages converge, and how fast",
    title="First-visit Monte Carlo from recorded episodes",
    statement=r"""
        Estimate $v_\pi$ by averaging returns ({eq}`eq-10`). `episodes` is a list of pairs of arrays `(states, rewards)`:
        `rewards[t]` is the reward that followed `states[t]`, and the episode ends after the last one. For each state,
        average the return that followed its **first** visit in every episode in which it occurs. States that never occur
        get 0. Return an array `(S,)`.
    """,
    stub="""
        def first_visit(episodes, gamma, S):
            ...
    """,
    cases=lambda rng: [
        Case(dict(episodes=e, gamma=gamma, S=S), _first_visit(e, gamma, S))
        for gamma, S, n in ((0.9, 3, 6), (0.5, 4, 5), (1.0, 8, 2))
        for e in [list(_episodes(rng, n, S))]
    ],
    hints=(
        "Compute all returns of an episode in one backward pass, as in *All returns in one backward pass*.",
        "Go through the steps in order and skip a state that this episode has met before.",
        "Keep a sum and a count per state; divide at the end, and only where the count is not 0.",
    ),
    solution="""
        def first_visit(episodes, gamma, S):
            total = np.zeros(S)
            count = np.zeros(S)
            for states, rewards in episodes:
                G = 0.0
                first = {}
                for s, r in zip(states[::-1], rewards[::-1]):
                    G = r + gamma * G
                    first[s] = G
                for s in first:
                    total[s] += first[s]
                    count[s] += 1
            return total / np.maximum(count, 1)
    """,
    wrong=(
        Wrong(
            """
            def first_visit(episodes, gamma, S):
                total, count = np.zeros(S), np.zeros(S)
                for states, rewards in episodes:
                    G = 0.0
                    for s, r in zip(states[::-1], rewards[::-1]):
                        G = r + gamma * G
                        total[s] += G
                        count[s] += 1
                return total / np.maximum(count, 1)
            """,
            "this averages over every visit; only the first one in each episode counts here",
        ),
        Wrong(
            """
            def first_visit(episodes, gamma, S):
                total, count = np.zeros(S), np.zeros(S)
                for states, rewards in episodes:
                    G, last = 0.0, {}
                    for s, r in zip(states[::-1], rewards[::-1]):
                        G = r + gamma * G
                        last.setdefault(s, G)
                    for s in last:
                        total[s] += last[s]
                        count[s] += 1
                return total / np.maximum(count, 1)
            """,
            "this takes the last visit of each episode instead of the first",
        ),
        Wrong(
            """
            def first_visit(episodes, gamma, S):
                total, count = np.zeros(S), np.zeros(S)
                for states, rewards in episodes:
                    G, first = 0.0, {}
                    for s, r in zip(states[::-1], rewards[::-1]):
                        first[s] = G
                        G = r + gamma * G
                    for s in first:
                        total[s] += first[s]
                        count[s] += 1
                return total / np.maximum(count, 1)
            """,
            "the reward that follows the visit is left out: G_t begins with R_{t+1}",
        ),
        Wrong(
            """
            def first_visit(episodes, gamma, S):
                total = np.zeros(S)
                for states, rewards in episodes:
                    G, first = 0.0, {}
                    for s, r in zip(states[::-1], rewards[::-1]):
                        G = r + gamma * G
                        first[s] = G
                    for s in first:
                        total[s] += first[s]
                return total / len(episodes)
            """,
            "the sum is divided by the number of all episodes; divide by those in which the state occurs",
        ),
    ),
    minutes=25,
    covers=("eq-10", "alg-mc-prediction"),
)

PROOFS = (
    Proof(
        "Rewards that change nothing",
        r"""
        Let $\Phi$ be any bounded function of the states, 0 in terminal ones. Somebody pays
        $R'_{t+1} = R_{t+1} + \gamma \Phi(S_{t+1}) - \Phi(S_t)$ in place of $R_{t+1}$, to help the agent along. Let $\gamma < 1$, or let
        every episode end. Show that under every policy $v'_\pi(s) = v_\pi(s) - \Phi(s)$, and that therefore the same
        policies are best.
        """,
        (
            "The new return as a sum, with both kinds of added terms written out.",
            "The added terms cancel in pairs: $\\gamma^{k+1} \\Phi(S_{t+k+1})$ comes once with plus and once with minus.",
            "What is left at the far end goes to 0: because $\\Phi$ is bounded and $\\gamma < 1$, or because the last state is terminal.",
            "The expectation given $S_t = s$, and that $\\Phi(s)$ does not depend on the policy.",
        ),
        r"""
        The return of $T$ steps from $t$ on is

        $$
        \sum_{k=0}^{T-1} \gamma^k R'_{t+k+1} = \sum_{k=0}^{T-1} \gamma^k R_{t+k+1} + \sum_{k=0}^{T-1} \left( \gamma^{k+1} \Phi(S_{t+k+1}) - \gamma^k \Phi(S_{t+k}) \right) .
        $$

        In the last sum each term $\gamma^k \Phi(S_{t+k})$ with $0 < k < T$ comes with both signs; what is left is
        $\gamma^T \Phi(S_{t+T}) - \Phi(S_t)$. If the episode ends at step $T$, then $\Phi(S_{t+T}) = 0$. If it goes on for ever, then
        $\gamma < 1$, and $|\gamma^T \Phi(S_{t+T})| \le \gamma^T \max |\Phi|$ goes to 0. So $G'_t = G_t - \Phi(S_t)$ on every path. Taking the
        expectation given $S_t = s$ under $\pi$ gives $v'_\pi(s) = v_\pi(s) - \Phi(s)$. For two policies
        $v'_\pi(s) - v'_\mu(s) = v_\pi(s) - v_\mu(s)$ in every state, so their order is the same, and so are the best ones.
        """,
    ),
)


QUESTIONS = (
    Question(
        "A reward of 1 arrives now, another one three steps later. With a discount of 0.9, which counts more in the return?",
        (
            (
                "The one now",
                True,
                "It counts 1; the later one counts 0.9 cubed, 0.729. The document has it the wrong way round.",
            ),
            ("The later one", False, "Discounting multiplies later rewards by a factor below 1."),
            ("Both count the same", False, "That is so only without discounting."),
        ),
    ),
    Question(
        "What does the Markov property say about the recycling robot when its battery level is left out of the state?",
        (
            (
                "It still holds: the world has not changed",
                False,
                "It is a property of the state that was chosen, not of the world.",
            ),
            (
                "It fails: the past tells more about what comes next",
                True,
                "A robot that has just recharged will not run empty soon; the shortened state has forgotten it.",
            ),
            (
                "It cannot be tested",
                False,
                "Next-state frequencies given one and given two past observations can be compared.",
            ),
        ),
    ),
    Question(
        "An episode is padded with a hundred steps in an absorbing state with reward 0. What happens to its return?",
        (
            (
                "It stays the same",
                True,
                "Zeros add nothing, whatever the discount; that is why one formula serves both kinds of task.",
            ),
            (
                "It shrinks by the discount to the power 100",
                False,
                "The rewards that came before keep their places and weights.",
            ),
            ("It is not defined with a discount of 1", False, "It is: only finitely many rewards differ from 0."),
        ),
    ),
    Question(
        "A deterministic policy is followed for a very long time. Which averages of returns converge to the right values?",
        (
            ("Those of all pairs of state and action", False, "Pairs that the policy never chooses are never seen."),
            (
                "Those of the states that are visited again and again",
                True,
                "The law of large numbers needs visits; for action values every pair must be visited.",
            ),
            ("None, since the policy does not explore", False, "State values of visited states need no exploration."),
        ),
    ),
)
