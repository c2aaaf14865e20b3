"""Exercises of chapter 4: temporal-difference prediction and control."""

import numpy as np

from rlcore.batch import batch_mc, certainty_equivalence
from rlcore.bellman import greedy
from rlcore.envs import cliff_walking, random_walk
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.mdp import FiniteMDP, rollout, uniform_policy
from rlcore.td import sarsa, td0

TITLE = "Exercises: temporal-difference learning"
NOTEBOOK = "04_temporal_difference"


Exercise(
    id="ch04-edge-by-hand",
    kind="by hand",
    tier="core",
    section="TD(0)",
    title="Is the fall inevitable?",
    statement=r"""
        An $\epsilon$-greedy agent with $\epsilon = 0.1$ and four actions walks along the edge of the cliff: ten cells, each
        visited once, and in each of them one of the three actions that are not greedy falls. With which probability does it take the
        greedy action in a cell, with which does it fall there, and with which does it fall at least once on the ten cells?
        Bind the three numbers, in this order, to `chances`.
    """,
    stub="chances = ...",
    cases=lambda rng: [Case({}, (0.925, 0.025, 1 - 0.975**10))],
    hints=(
        r"With probability $\epsilon$ the action is drawn from all four, the greedy one among them.",
        "Not to fall on ten cells is not to fall ten times in a row.",
    ),
    solution="chances = (1 - 0.1 + 0.1 / 4, 0.1 / 4, 1 - (1 - 0.1 / 4) ** 10)",
    wrong=(
        Wrong(
            "chances = (0.9, 0.025, 1 - 0.975 ** 10)",
            "the random action may be the greedy one, too: 0.9 leaves out a quarter of epsilon",
        ),
        Wrong(
            "chances = (0.925, 0.1, 1 - 0.9 ** 10)",
            "epsilon is shared by four actions, of which one falls: 0.1 / 4 in a cell",
        ),
        Wrong(
            "chances = (0.9, 0.1 / 3, 1 - (1 - 0.1 / 3) ** 10)",
            "epsilon is shared by all four actions, not by the three that are not greedy",
        ),
        Wrong(
            "chances = (0.925, 0.025, 0.25)",
            "the ten chances are added: that counts walks with two falls twice; use the chance never to fall",
        ),
    ),
    minutes=2,
    digits=4,
    covers=("alg-eps-greedy", "cl-059"),
)


TOTAL = np.array([30.0, 40.0, 35.0, 40.0, 43.0, 43.0])

Exercise(
    id="ch04-driving-home",
    kind="by hand",
    tier="core",
    section="Learning from a later guess",
    title="Driving home with half a step",
    statement=r"""
        | event | minutes gone | minutes still to go, predicted |
        | --- | --- | --- |
        | leave the office | 0 | 30 |
        | reach the car, it rains | 5 | 35 |
        | leave the highway | 20 | 15 |
        | behind a truck | 30 | 10 |
        | home street | 40 | 3 |
        | home | 43 | 0 |

        $\gamma = 1$ and $\alpha = 0.5$; the reward of a leg is its minutes. By how much does the prediction of each of the first five
        events change, under Monte Carlo ({eq}`eq-18`) and under TD(0) ({eq}`eq-19`)? Bind the pair
        `(mc, td)` of two arrays of five numbers to `changes`.
    """,
    stub="changes = ...",
    cases=lambda rng: [Case({}, (0.5 * (43 - TOTAL[:5]), 0.5 * (TOTAL[1:] - TOTAL[:5])))],
    hints=(
        "Add the two columns: the predicted totals are 30, 40, 35, 40, 43, 43. What both methods compare is totals.",
        "Monte Carlo moves each total half the way to 43, TD half the way to the next total.",
    ),
    solution="""
        total = np.array([0, 5, 20, 30, 40, 43]) + np.array([30, 35, 15, 10, 3, 0])
        mc = 0.5 * (total[-1] - total[:-1])
        td = 0.5 * (total[1:] - total[:-1])
        changes = (mc, td)
    """,
    wrong=(
        Wrong(
            "changes = (np.array([13.0, 3, 8, 3, 0]), np.array([10.0, -5, 5, 3, 0]))",
            "these are the errors themselves; with alpha = 0.5 a prediction moves half the way",
        ),
        Wrong(
            "changes = (np.array([5.0, -2.5, 2.5, 1.5, 0]), np.array([6.5, 1.5, 4, 1.5, 0]))",
            "the two are swapped: Monte Carlo first, then TD",
        ),
        Wrong(
            "changes = (np.array([6.5, 1.5, 4, 1.5, 0]), np.array([2.5, -10, -2.5, -3.5, -1.5]))",
            "the TD changes leave out the reward, the minutes of the leg: compare totals, not minutes to go",
        ),
        Wrong(
            "changes = (-np.array([6.5, 1.5, 4, 1.5, 0]), -np.array([5.0, -2.5, 2.5, 1.5, 0]))",
            "all signs are turned round: the error is target minus estimate",
        ),
    ),
    minutes=6,
    covers=("table-driving", "fig-14", "fig-15", "ex-driving"),
)


Exercise(
    id="ch04-predict-first-episode",
    kind="predict",
    tier="core",
    section="TD against Monte Carlo",
    title="What one episode changes",
    statement=r"""
        Random walk A to E, all values 0.5, $\alpha = 0.1$, $\gamma = 1$. The first episode is C, D, C, B, A, left end, without any
        reward. Predict which values change under TD(0), and which under every-visit Monte Carlo with constant $\alpha$. Then bind
        the pair `(td, mc)` of arrays, the five values of A to E after this episode, to `after`.
    """,
    stub="after = ...",
    cases=lambda rng: [Case({}, (np.array([0.45, 0.5, 0.5, 0.5, 0.5]), np.array([0.45, 0.45, 0.405, 0.45, 0.5])))],
    hints=(
        "Between two states of value 0.5 the TD error is $0 + 0.5 - 0.5$.",
        "Monte Carlo moves every visited state towards the return 0, and C is visited twice.",
    ),
    solution="""
        td, mc = np.full(5, 0.5), np.full(5, 0.5)
        td[0] += 0.1 * (0 - td[0])
        for s in (2, 3, 2, 1, 0):
            mc[s] += 0.1 * (0 - mc[s])
        after = (td, mc)
    """,
    wrong=(
        Wrong(
            "after = (np.array([0.45, 0.5, 0.5, 0.5, 0.5]), np.array([0.45, 0.45, 0.45, 0.45, 0.5]))",
            "C is visited twice, and every visit counts: 0.5, 0.45, then 0.405",
        ),
        Wrong(
            "after = (np.array([0.45, 0.45, 0.405, 0.45, 0.5]), np.array([0.45, 0.45, 0.405, 0.45, 0.5]))",
            "TD(0) does not see the end from C: only the last step, from A, has a TD error that is not 0",
        ),
        Wrong(
            "after = (np.array([0.45, 0.45, 0.405, 0.45, 0.5]), np.array([0.45, 0.5, 0.5, 0.5, 0.5]))",
            "the two are swapped: TD first, then Monte Carlo",
        ),
        Wrong(
            "after = (np.full(5, 0.5), np.array([0.45, 0.45, 0.405, 0.45, 0.5]))",
            "TD learns something, too: the left end is worth 0, so that the last step has the error 0 - 0.5",
        ),
    ),
    minutes=4,
    covers=("ex-random-walk", "fig-16", "cl-040"),
)


def _td0_step(V, s, r, s_next, terminated, alpha, gamma):
    V = V.copy()
    V[s] += alpha * (r + gamma * V[s_next] * (not terminated) - V[s])
    return V


Exercise(
    id="ch04-td0-update",
    kind="fill in",
    tier="core",
    section="TD(0)",
    title="One step of TD(0)",
    statement=r"""
        Write the update of TD(0) after one transition ({eq}`eq-19`; the discount belongs to
        $V(S_{t+1})$ alone). If the transition `terminated` the episode, nothing follows: whatever the table holds
        for `s_next`, it does not count. Return a new table `(S,)`.
    """,
    stub="""
        def td0_update(V, s, r, s_next, terminated, alpha, gamma):
            V = V.copy()
            target = ...
            V[s] += ...
            return V
    """,
    cases=lambda rng: [
        Case(g, _td0_step(**g))
        for terminated, gamma, s, s_next in (
            (False, 0.9, 1, 3),
            (True, 0.9, 2, 4),
            (False, 0.6, 3, 3),
            (True, 1.0, 0, 4),
        )
        for V in [rng.normal(size=5).round(2) + 2]
        for g in [dict(V=V, s=s, r=1.5, s_next=s_next, terminated=terminated, alpha=0.2, gamma=gamma)]
    ],
    hints=(
        "The target is `r` where the episode ended, else `r + gamma * V[s_next]`.",
        "`V[s]` moves by `alpha * (target - V[s])`.",
    ),
    solution="""
        def td0_update(V, s, r, s_next, terminated, alpha, gamma):
            V = V.copy()
            target = r + gamma * V[s_next] * (not terminated)
            V[s] += alpha * (target - V[s])
            return V
    """,
    wrong=(
        Wrong(
            """
            def td0_update(V, s, r, s_next, terminated, alpha, gamma):
                V = V.copy()
                V[s] += alpha * (r + gamma * V[s_next] - V[s])
                return V
            """,
            "the terminal state is bootstrapped: after the end the target is the reward alone",
        ),
        Wrong(
            """
            def td0_update(V, s, r, s_next, terminated, alpha, gamma):
                V = V.copy()
                V[s] += alpha * (r + gamma * (V[s_next] * (not terminated) - V[s]))
                return V
            """,
            "V(s) is discounted, too, as a kind reading of the misprint has it: gamma belongs to V(s') alone",
        ),
        Wrong(
            """
            def td0_update(V, s, r, s_next, terminated, alpha, gamma):
                V = V.copy()
                V[s] += alpha * (r + gamma * V[s_next] * (not terminated))
                return V
            """,
            "V(s) is not subtracted: the step is alpha times (target - V(s))",
        ),
        Wrong(
            """
            def td0_update(V, s, r, s_next, terminated, alpha, gamma):
                V = V.copy()
                if not terminated:
                    V[s] += alpha * (r + gamma * V[s_next] - V[s])
                return V
            """,
            "the last step of an episode is skipped: it has a target, too, its reward",
        ),
    ),
    minutes=5,
    covers=("eq-19", "eq-u-td-target", "alg-td0", "om-td-error"),
)


def _steps(rng, n, S):
    s = rng.integers(S, size=n)
    return dict(s=s, r=rng.normal(size=n).round(2), s_next=(s + rng.integers(1, S, size=n)) % S)


def _td0_steps(V, s, r, s_next, alpha, gamma):
    V = V.copy()
    for i in range(len(s)):
        V[s[i]] += alpha * (r[i] + gamma * V[s_next[i]] - V[s[i]])
    return V


Exercise(
    id="ch04-bug-parenthesis",
    kind="find the bug",
    tier="more",
    section="TD(0)",
    title="Right until something is discounted",
    statement=r"""
        This function runs TD(0) over recorded steps: step $i$ led from `s[i]` to `s_next[i]` and paid `r[i]`. (The table holds 0 for
        terminal states.) On the random walk, where $\gamma = 1$, it learns the true values, and its author is content. With
        $\gamma = 0.9$ it settles elsewhere: the five values come out as 0.185, 0.370, 0.556, 0.741, 0.926 instead of 0.066,
        0.146, 0.258, 0.428, 0.693. Mend it.
    """,
    stub="""
        def learn(V, s, r, s_next, alpha, gamma):
            V = V.copy()
            for i in range(len(s)):
                V[s[i]] += alpha * (r[i] + gamma * (V[s_next[i]] - V[s[i]]))
            return V
    """,
    cases=lambda rng: [
        Case(g, _td0_steps(**g))
        for gamma, alpha in ((0.9, 0.2), (0.5, 0.1), (1.0, 0.3))
        for g in [dict(V=rng.normal(size=4).round(1), **_steps(rng, 6, 4), alpha=alpha, gamma=gamma)]
    ],
    hints=(
        r"What becomes of the error of a step if $r = 0$ and $V(s') = V(s)$? It should be $(\gamma - 1) V(s)$.",
        "Compare the parentheses with the TD error: reward, plus gamma times the next value, minus this value.",
    ),
    solution="""
        def learn(V, s, r, s_next, alpha, gamma):
            V = V.copy()
            for i in range(len(s)):
                V[s[i]] += alpha * (r[i] + gamma * V[s_next[i]] - V[s[i]])
            return V
    """,
    wrong=(
        Wrong({"- V[s[i]]": "- gamma * V[s[i]]"}, "V(s) is still discounted: close the parenthesis after V(s')"),
        Wrong({"gamma * V[s_next[i]]": "V[s_next[i]]"}, "without gamma it is right for gamma = 1 only: discount V(s')"),
        Wrong(
            {"r[i] + gamma * V[s_next[i]]": "gamma * (r[i] + V[s_next[i]])"},
            "the reward is discounted, too: it comes one step before V(s')",
        ),
        Wrong(
            {"V = V.copy()": "W = V.copy()", "V[s[i]] +=": "W[s[i]] +=", "return V": "return W"},
            "the parenthesis is right, but the errors come from the old table: TD(0) uses each new value at once",
        ),
    ),
    minutes=6,
    covers=("eq-19", "alg-td0"),
)


def _masked(V, states, rewards, alpha, gamma):
    V = V.copy()
    for t in range(len(rewards)):
        goes_on = t < len(rewards) - 1
        V[states[t]] += alpha * (rewards[t] + gamma * V[states[t + 1]] * goes_on - V[states[t]])
    return V


Exercise(
    id="ch04-bug-terminal",
    kind="find the bug",
    tier="more",
    section="TD(0)",
    title="The end is worth something",
    statement=r"""
        One episode of TD(0): `states` $S_0, \dots, S_T$, the last of them terminal, and `rewards` $R_1, \dots, R_T$. Somebody started the
        whole table at 0.5, the terminal states included, and all values come out too large. Make the function right for
        **any** table that it is given. The entry of the terminal state must stay as it came.
    """,
    stub="""
        def learn_episode(V, states, rewards, alpha, gamma):
            V = V.copy()
            for t in range(len(rewards)):
                target = rewards[t] + gamma * V[states[t + 1]]
                V[states[t]] += alpha * (target - V[states[t]])
            return V
    """,
    cases=lambda rng: [
        Case(g, _masked(**g))
        for states, gamma in (([3, 2, 1, 0], 1.0), ([2, 3, 2, 3, 4], 0.9), ([1, 0], 0.8), ([0, 4, 0, 2], 0.9))
        for g in [
            dict(
                V=rng.normal(size=5).round(1) + 0.55,
                states=np.array(states),
                rewards=rng.normal(size=len(states) - 1).round(1),
                alpha=0.1,
                gamma=gamma,
            )
        ]
    ],
    hints=(
        "What is the target of the last step? Nothing follows the terminal state.",
        "The last step is the one with `t == len(rewards) - 1`; multiply the bootstrap by whether the episode goes on.",
    ),
    solution="""
        def learn_episode(V, states, rewards, alpha, gamma):
            V = V.copy()
            for t in range(len(rewards)):
                goes_on = t < len(rewards) - 1
                target = rewards[t] + gamma * V[states[t + 1]] * goes_on
                V[states[t]] += alpha * (target - V[states[t]])
            return V
    """,
    wrong=(
        Wrong(
            """
            def learn_episode(V, states, rewards, alpha, gamma):
                V = V.copy()
                for s, r, s_next in zip(states[:-1], rewards, states[1:]):
                    V[s] += alpha * (r + gamma * V[s_next] - V[s])
                return V
            """,
            "the last step still bootstraps from the terminal state: there the target is the reward alone",
        ),
        Wrong(
            """
            def learn_episode(V, states, rewards, alpha, gamma):
                V = V.copy()
                V[states[-1]] = 0.0
                for t in range(len(rewards)):
                    V[states[t]] += alpha * (rewards[t] + gamma * V[states[t + 1]] - V[states[t]])
                return V
            """,
            "the other values are right, but the entry of the terminal state was to stay: leave the bootstrap out instead",
        ),
        Wrong(
            """
            def learn_episode(V, states, rewards, alpha, gamma):
                V = V.copy()
                for t in range(len(rewards) - 1):
                    V[states[t]] += alpha * (rewards[t] + gamma * V[states[t + 1]] - V[states[t]])
                return V
            """,
            "the last step is left out: its reward is the one thing that is known for certain",
        ),
        Wrong(
            {
                "        target = rewards[t] + gamma * V[states[t + 1]] * goes_on\n": "",
                "target - V[states[t]]": "(rewards[t] + gamma * V[states[t + 1]]) * goes_on - V[states[t]]",
            },
            "the mask takes the last reward away, too: it belongs to the bootstrap alone",
        ),
    ),
    minutes=6,
    covers=("eq-19", "alg-td0"),
)


def _cut_targets(r, V_next, terminated, truncated, gamma):
    return r + gamma * V_next * ~terminated


Exercise(
    id="ch04-bug-time-limit",
    kind="find the bug",
    tier="core",
    section="TD(0)",
    title="The clock is not the end",
    statement=r"""
        The TD targets of a batch of steps, an array `(n,)`: `r` `(n,)` holds the rewards, `V_next` `(n,)` what the table says of
        the next states. `terminated` says that the step reached a terminal state; `truncated`, that a
        time limit stopped the recording although the task goes on (both can be true in the same step). The function runs, and the
        values near the time limit are too small. Mend it.
    """,
    stub="""
        def targets(r, V_next, terminated, truncated, gamma):
            done = terminated | truncated
            return r + gamma * V_next * ~done
    """,
    cases=lambda rng: [
        Case(g, _cut_targets(**g))
        for gamma in (0.9, 1.0)
        for g in [
            dict(
                r=rng.normal(size=5).round(1),
                V_next=rng.normal(size=5).round(1) + 3,
                terminated=np.array([False, True, False, True, False]),
                truncated=np.array([False, False, True, True, True]),
                gamma=gamma,
            )
        ]
    ],
    hints=(
        "Which of the two flags says that no reward follows?",
        "A truncated step has a next state, and that state has a value: bootstrap from it.",
    ),
    solution="""
        def targets(r, V_next, terminated, truncated, gamma):
            return r + gamma * V_next * ~terminated
    """,
    wrong=(
        Wrong(
            {"r + gamma * V_next * ~terminated": "np.where(terminated | truncated, r, r + gamma * V_next)"},
            "a truncated step is still taken for the end: it goes on unseen, so bootstrap",
        ),
        Wrong(
            {"~terminated": "~truncated"},
            "the flags are swapped: the terminal step bootstraps, the truncated one does not",
        ),
        Wrong({" * ~terminated": ""}, "no step is masked any more: after a terminal state nothing follows"),
        Wrong(
            {"~terminated": "~(terminated & ~truncated)"},
            "a step that terminates at the very time limit bootstraps: terminated decides, whatever truncated says",
        ),
    ),
    minutes=5,
    covers=("eq-u-td-target", "alg-td0"),
)


def _averages(V, s, G):
    return np.array([G[s == i].mean() if (s == i).any() else V[i] for i in range(len(V))])


Exercise(
    id="ch04-sample-average",
    kind="fill in",
    tier="core",
    section="From averages to steps",
    title="A step size that averages",
    statement=r"""
        Visits come one after the other: state `s[i]`, followed by the return `G[i]`. Write {eq}`eq-18` with the step size $1 / N$, where
        $N$ is the number of visits of **this** state so far, the present one included, so that each value is the mean of
        the returns of its state. `V` holds the first guesses; return the new table.
    """,
    stub="""
        def averages(V, s, G):
            V, N = V.copy(), np.zeros(len(V))
            for i in range(len(s)):
                ...
            return V
    """,
    cases=lambda rng: (
        [
            Case(g, _averages(**g))
            for n, S in ((7, 3), (12, 4))
            for g in [dict(V=np.full(S, 5.0), s=rng.integers(S, size=n), G=rng.normal(size=n).round(1))]
        ]
        + [
            Case(g, _averages(**g))
            for g in [dict(V=np.array([5.0, -2.0, 4.0]), s=np.array([0, 0, 2, 0]), G=np.array([1.0, 2.0, 0.5, 4.0]))]
        ]
    ),
    hints=(
        "Count first: `N[s[i]] += 1`. Then the first visit has the step size 1, and the guess is forgotten.",
        "`V[s[i]] += (G[i] - V[s[i]]) / N[s[i]]`.",
    ),
    solution="""
        def averages(V, s, G):
            V, N = V.copy(), np.zeros(len(V))
            for i in range(len(s)):
                N[s[i]] += 1
                V[s[i]] += (G[i] - V[s[i]]) / N[s[i]]
            return V
    """,
    wrong=(
        Wrong(
            {"/ N[s[i]]": "/ (N[s[i]] + 1)"},
            "the first guess counts as one of the returns: the first visit needs the step size 1, not 1/2",
        ),
        Wrong(
            """
            def averages(V, s, G):
                V = V.copy()
                for i in range(len(s)):
                    V[s[i]] += (G[i] - V[s[i]]) / (i + 1)
                return V
            """,
            "N counts the visits of all states together: each state needs a count of its own",
        ),
        Wrong(
            """
            def averages(V, s, G):
                V = V.copy()
                for i in range(len(s)):
                    V[s[i]] += 0.1 * (G[i] - V[s[i]])
                return V
            """,
            "a constant step size never forgets the first guess altogether; here it is 1 / N",
        ),
        Wrong({" - V[s[i]]": ""}, "the old value is not subtracted: the step goes from V(s) towards G"),
    ),
    minutes=6,
    covers=("eq-18", "alg-constant-alpha-mc"),
)


Exercise(
    id="ch04-predict-forgetting",
    kind="predict",
    tier="more",
    section="From averages to steps",
    title="How long is the first guess remembered?",
    statement=r"""
        After 20 updates $V \leftarrow V + \alpha_n (G_n - V)$, $n = 1, \dots, 20$, the estimate is a mixture of the first guess and the 20
        returns. Predict which of three schedules remembers most of the guess: $\alpha_n = 0.1$, $\alpha_n = 1 / n$,
        $\alpha_n = 1 / (n + 1)$. Then compute the weight of the guess for each and bind the three numbers, as an array, to `left`.
    """,
    stub="left = ...",
    cases=lambda rng: [Case({}, np.array([0.9**20, 0.0, 1 / 21]))],
    hints=(
        r"An update multiplies the weight of everything older by $1 - \alpha_n$.",
        r"For $1 / (n + 1)$ the product $\frac12 \cdot \frac23 \cdot \frac34 \cdots$ telescopes. What is its first factor for $1 / n$?",
    ),
    solution="""
        n = np.arange(1, 21)
        left = np.array([np.prod(1 - alpha) for alpha in (np.full(20, 0.1), 1 / n, 1 / (n + 1))])
    """,
    wrong=(
        Wrong(
            "left = np.array([0.1 ** 20, 0, 1 / 21])",
            "0.1 is the weight of the newest return; what is older keeps 1 - 0.1 at each update",
        ),
        Wrong(
            "left = np.array([0.9 ** 20, 1 / 20, 1 / 21])",
            "with 1 / n the first step has size 1: nothing of the guess is left after it",
        ),
        Wrong(
            "left = np.array([0.9 ** 20, 0, 0])",
            "1 / (n + 1) starts with a step of 1/2: the guess counts as one more sample among 21",
        ),
        Wrong(
            "left = 1 - np.array([0.9 ** 20, 0, 1 / 21])",
            "these are the weights of all returns together; asked is that of the guess",
        ),
    ),
    minutes=5,
    digits=4,
    covers=("eq-18", "om-convergence-conditions"),
)


EPISODES = [([0, 1, 2], [0.0, 0.0]), *[([1, 2], [1.0])] * 6, ([1, 2], [0.0]), ([0, 1, 2], [2.0, 1.0])]


def _both_answers():
    mc, td = batch_mc(EPISODES, 3, 1.0), certainty_equivalence(EPISODES, 3, 1.0)
    return float(mc[0]), float(mc[1]), float(td[0]), float(td[1])


Exercise(
    id="ch04-predictor",
    kind="by hand",
    tier="more",
    section="What a fixed batch of data says",
    title="The predictor sees a ninth episode",
    statement=r"""
        You have the eight episodes of the predictor: once A, 0, B, 0; six times B, 1; once B, 0 (state, reward, state, reward). Now
        comes a ninth: A, **2**, B, 1. $\gamma = 1$. Which values do batch Monte Carlo and batch TD(0) settle at now? Bind the four
        numbers $V(A)$, $V(B)$ of Monte Carlo, then $V(A)$, $V(B)$ of TD, to the tuple `values`.
    """,
    stub="values = ...",
    cases=lambda rng: [Case({}, _both_answers())],
    hints=(
        "Monte Carlo: the mean of the two returns that followed A, and of the nine that followed B.",
        "TD: B as before. From A, B always follows, and the mean reward on the way is 1: what is 1 plus the value of B?",
    ),
    solution="values = ((0 + 3) / 2, 7 / 9, (0 + 2) / 2 + 7 / 9, 7 / 9)",
    wrong=(
        Wrong(
            "values = (1.5, 7 / 9, 1.5, 7 / 9)",
            "Monte Carlo is right; TD does not average the returns of A: it uses the value of B, which all nine episodes inform",
        ),
        Wrong(
            "values = (1.5, 7 / 9, 2 + 7 / 9, 7 / 9)",
            "only one of the two steps from A paid 2: the mean reward is 1",
        ),
        Wrong(
            "values = (1.5, 7 / 9, 7 / 9, 7 / 9)",
            "the reward on the way from A to B is missing from the TD value of A",
        ),
        Wrong(
            "values = (1.5, 0.75, 1.75, 0.75)",
            "B was visited nine times, not eight, and seven of the visits paid 1: the ninth episode passes through B, too",
        ),
        Wrong("values = (16 / 9, 7 / 9, 1.5, 7 / 9)", "the two values of A are swapped: Monte Carlo first, then TD"),
    ),
    minutes=5,
    digits=4,
    covers=("ex-predictor", "table-predictor", "fig-19", "cl-046"),
)


def _batch_steps(rng, n, S):
    s_next = rng.integers(-1, S, size=n)
    s_next[-2:] = -1
    return dict(s=rng.integers(1, S, size=n), r=rng.normal(size=n).round(1), s_next=s_next)


def _batch_answer(s, r, s_next, n_states, gamma):
    M, b = np.eye(n_states), np.zeros(n_states)
    for i in range(n_states):
        if (mine := s == i).any():
            b[i] = r[mine].mean()
            for j in range(n_states):
                M[i, j] -= gamma * (s_next[mine] == j).mean()
    return np.linalg.solve(M, b)


Exercise(
    id="ch04-batch-answer",
    kind="fill in",
    tier="deep",
    section="What a fixed batch of data says",
    title="Where batch TD(0) settles",
    statement=r"""
        Batch TD(0) stands still where, for each state, the TD errors of all its recorded steps add up to 0:
        $N(s) V(s) = \sum (r + \gamma V(s'))$, the sum over the steps from $s$. This is a linear system. Solve it: step $i$ led
        from `s[i]` to `s_next[i]`, which is `-1` where the episode ended, and paid `r[i]`. Return `(n_states,)`, 0 for states that were
        never left.
    """,
    stub="""
        def batch_answer(s, r, s_next, n_states, gamma):
            ...
    """,
    cases=lambda rng: (
        [
            Case(g, _batch_answer(**g))
            for n, S, gamma in ((9, 3, 0.9), (14, 4, 0.7), (12, 4, 0.95))
            for g in [dict(**_batch_steps(rng, n, S), n_states=S, gamma=gamma)]
        ]
        + [
            Case(g, _batch_answer(**g))  # back to state 0, and a last state that is never met
            for s, s_next in [(np.array([0, 1, 2, 0, 1]), np.array([1, 0, 0, 2, -1]))]
            for g in [dict(s=s, r=np.array([1.0, -2.0, 0.5, 3.0, 1.5]), s_next=s_next, n_states=5, gamma=0.8)]
        ]
    ),
    hints=(
        "Write it as `M @ V = b` with the number of visits on the diagonal of `M` (1 where there are none) and the sums of rewards in `b`.",
        "For each step that did not end the episode, subtract `gamma` from `M[s, s_next]`: in a loop, or with `np.subtract.at`.",
    ),
    solution="""
        def batch_answer(s, r, s_next, n_states, gamma):
            M = np.diag(np.maximum(np.bincount(s, minlength=n_states), 1.0))
            b = np.bincount(s, r, n_states)
            for i in range(len(s)):
                if s_next[i] >= 0:
                    M[s[i], s_next[i]] -= gamma
            return np.linalg.solve(M, b)
    """,
    wrong=(
        Wrong(
            """
            def batch_answer(s, r, s_next, n_states, gamma):
                M = np.diag(np.maximum(np.bincount(s, minlength=n_states), 1.0))
                M[s[s_next >= 0], s_next[s_next >= 0]] -= gamma
                return np.linalg.solve(M, np.bincount(s, r, n_states))
            """,
            "a transition that was seen twice is subtracted once: use a loop, or np.subtract.at",
        ),
        Wrong(
            """
            def batch_answer(s, r, s_next, n_states, gamma):
                M = np.diag(np.maximum(np.bincount(s, minlength=n_states), 1.0))
                np.subtract.at(M, (s, s_next), gamma)
                return np.linalg.solve(M, np.bincount(s, r, n_states))
            """,
            "the end, -1, is taken for the last state: Python counts -1 from behind; leave these steps out",
        ),
        Wrong(
            """
            def batch_answer(s, r, s_next, n_states, gamma):
                M = np.eye(n_states)
                on = s_next >= 0
                np.subtract.at(M, (s[on], s_next[on]), gamma)
                return np.linalg.solve(M, np.bincount(s, r, n_states))
            """,
            "sums instead of means: V(s) must count once for each visit, N(s) on the diagonal",
        ),
        Wrong(
            """
            def batch_answer(s, r, s_next, n_states, gamma):
                return np.bincount(s, r, n_states) / np.maximum(np.bincount(s, minlength=n_states), 1)
            """,
            "this is the mean reward of one step: the value of the next state is missing",
        ),
    ),
    minutes=15,
    covers=("alg-batch-td", "alg-certainty-equivalence", "cl-050", "ex-batch"),
)


def _sarsa_episode(Q, s, a, r, alpha, gamma):
    Q = Q.copy()
    for t in range(len(r)):
        bootstrap = gamma * Q[s[t + 1], a[t + 1]] if t + 1 < len(r) else 0.0
        Q[s[t], a[t]] += alpha * (r[t] + bootstrap - Q[s[t], a[t]])
    return Q


Exercise(
    id="ch04-bug-sarsa",
    kind="find the bug",
    tier="core",
    section="What SARSA converges to",
    title="On the edge in spite of SARSA",
    statement=r"""
        One recorded episode, `s` $S_0, \dots, S_T$, `a` $A_0, \dots, A_{T-1}$, `r` $R_1, \dots, R_T$, and the updates of SARSA
        ({eq}`eq-20`). On the cliff the agent that learns with it walks along the edge and keeps falling, as Q-learning does.
        Why? Mend it.
    """,
    stub="""
        def sarsa_episode(Q, s, a, r, alpha, gamma):
            Q = Q.copy()
            for t in range(len(r)):
                target = r[t]
                if t + 1 < len(r):
                    target = target + gamma * Q[s[t + 1]].max()
                Q[s[t], a[t]] += alpha * (target - Q[s[t], a[t]])
            return Q
    """,
    cases=lambda rng: [
        Case(g, _sarsa_episode(**g))
        for states, gamma in (([0, 1, 2, 3], 0.9), ([1, 0, 1, 2, 2, 3], 1.0), ([2, 3], 0.5))
        for n in [len(states) - 1]
        for g in [
            dict(
                Q=rng.normal(size=(4, 3)).round(1),
                s=np.array(states),
                a=rng.integers(3, size=n),
                r=rng.normal(size=n).round(1),
                alpha=0.5,
                gamma=gamma,
            )
        ]
    ],
    hints=(
        "Which action does the target assume in the next state? Which one was taken there?",
        "SARSA is named after the five things that it uses: the last one is `a[t + 1]`.",
    ),
    solution="""
        def sarsa_episode(Q, s, a, r, alpha, gamma):
            Q = Q.copy()
            for t in range(len(r)):
                target = r[t]
                if t + 1 < len(r):
                    target = target + gamma * Q[s[t + 1], a[t + 1]]
                Q[s[t], a[t]] += alpha * (target - Q[s[t], a[t]])
            return Q
    """,
    wrong=(
        Wrong(
            """
            def sarsa_episode(Q, s, a, r, alpha, gamma):
                Q = Q.copy()
                for t in range(len(r)):
                    bootstrap = gamma * np.max(Q[s[t + 1]]) * (t + 1 < len(r))
                    Q[s[t], a[t]] += alpha * (r[t] + bootstrap - Q[s[t], a[t]])
                return Q
            """,
            "the target still takes the best action: that is Q-learning; SARSA takes the action that was chosen",
        ),
        Wrong(
            """
            def sarsa_episode(Q, s, a, r, alpha, gamma):
                Q = Q.copy()
                for t in range(len(r)):
                    bootstrap = gamma * np.mean(Q[s[t + 1]]) * (t + 1 < len(r))
                    Q[s[t], a[t]] += alpha * (r[t] + bootstrap - Q[s[t], a[t]])
                return Q
            """,
            "the mean over all actions is the value of a random policy, not of the one that acts",
        ),
        Wrong(
            """
            def sarsa_episode(Q, s, a, r, alpha, gamma):
                Q = Q.copy()
                for t in range(len(r)):
                    bootstrap = gamma * Q[s[t + 1], a[t]] * (t + 1 < len(r))
                    Q[s[t], a[t]] += alpha * (r[t] + bootstrap - Q[s[t], a[t]])
                return Q
            """,
            "the action of this step is used in the next state: take a[t + 1] there",
        ),
        Wrong(
            """
            def sarsa_episode(Q, s, a, r, alpha, gamma):
                Q = Q.copy()
                for t in range(len(r)):
                    bootstrap = Q[s[t + 1], a[t + 1]] if t + 1 < len(r) else 0
                    Q[s[t], a[t]] += alpha * (r[t] + bootstrap - Q[s[t], a[t]])
                return Q
            """,
            "the action is right, but gamma is gone from the bootstrap",
        ),
    ),
    minutes=6,
    covers=("eq-20", "alg-sarsa", "fig-20", "cl-053"),
)


def _expected_target(q_next, r, gamma, epsilon):
    best = q_next == q_next.max()
    p = (1 - epsilon) * best / best.sum() + epsilon / len(q_next)
    return p, float(r + gamma * p @ q_next)


Exercise(
    id="ch04-expected-sarsa-ties",
    kind="fill in",
    tier="more",
    section="The cliff",
    title="Expected SARSA and ties",
    statement=r"""
        `q_next` `(A,)` is the row of $Q$ at the next state. Return `(p, target)`: the probabilities `(A,)` of the actions of
        the $\epsilon$-greedy policy, **where several actions are best the greedy part is shared equally**, and the target
        $r + \gamma \sum_a p(a) Q(s', a)$ of expected SARSA.
    """,
    stub="""
        def expected_target(q_next, r, gamma, epsilon):
            ...
            return p, target
    """,
    cases=lambda rng: [
        Case(g, _expected_target(**g))
        for q, gamma, epsilon in (
            ([1.0, 3.0, 3.0, -2.0], 0.9, 0.1),
            ([2.0, 2.0, 2.0], 0.5, 0.3),
            ([0.5, -1.0, 4.0, 1.0], 1.0, 0.2),
        )
        for g in [dict(q_next=np.array(q), r=-1.0, gamma=gamma, epsilon=epsilon)]
    ],
    hints=(
        r"Every action gets $\epsilon / |A|$; what is left, $1 - \epsilon$, goes to the best ones together.",
        "`best = q_next == q_next.max()` marks them; `best / best.sum()` shares 1 among them.",
    ),
    solution="""
        def expected_target(q_next, r, gamma, epsilon):
            best = q_next == q_next.max()
            p = (1 - epsilon) * best / best.sum() + epsilon / len(q_next)
            target = r + gamma * p @ q_next
            return p, target
    """,
    wrong=(
        Wrong(
            """
            def expected_target(q_next, r, gamma, epsilon):
                p = (1 - epsilon) * (q_next == q_next.max()) + epsilon / len(q_next)
                return p, r + gamma * p @ q_next
            """,
            "each of several best actions gets the whole greedy part: the probabilities add up to more than 1",
        ),
        Wrong(
            """
            def expected_target(q_next, r, gamma, epsilon):
                p = np.full(len(q_next), epsilon / len(q_next))
                p[q_next.argmax()] += 1 - epsilon
                return p, r + gamma * p @ q_next
            """,
            "the first of several best actions gets all: the target is the same, the policy is not",
        ),
        Wrong(
            """
            def expected_target(q_next, r, gamma, epsilon):
                best = q_next == q_next.max()
                p = np.where(best, (1 - epsilon) / best.sum(), epsilon / max((~best).sum(), 1))
                return p, r + gamma * p @ q_next
            """,
            "the random action is drawn among the others only: epsilon is shared by all actions, the best among them",
        ),
        Wrong(
            {"    target = r + gamma * p @ q_next\n": "", "p, target": "p, r + gamma * q_next.max()"},
            "the target is that of Q-learning: weigh the values with the probabilities",
        ),
    ),
    minutes=8,
    covers=("alg-expected-sarsa", "alg-eps-greedy"),
)


def _cliff(n_rows, n_cols):
    start, goal = (n_rows - 1) * n_cols, n_rows * n_cols - 1
    outcomes = {}
    for s in range(goal):
        for a, (down, right) in enumerate(((-1, 0), (1, 0), (0, 1), (0, -1))):
            row, col = min(max(s // n_cols + down, 0), n_rows - 1), min(max(s % n_cols + right, 0), n_cols - 1)
            s_next = row * n_cols + col
            outcomes[s, a] = [(1.0, start, -100.0) if start < s_next < goal else (1.0, s_next, -1.0)]
    return FiniteMDP.from_outcomes(outcomes, start=start)


Exercise(
    id="ch04-build-cliff",
    kind="build",
    tier="deep",
    section="The cliff",
    title="A cliff of any size",
    statement=r"""
        Build the cliff world with `n_rows` x `n_cols` cells, numbered row by row from the top left, and return it. The start is the bottom left
        cell, the goal the bottom right one, and the cells between them are the cliff. Actions: 0 up, 1 down, 2 right, 3 left; a move
        against the border stays where it is. A step costs 1. A step into the cliff costs 100 instead and leads back to the start;
        **the episode goes on**. The goal is terminal. Give the cliff cells the four moves of any other cell: nobody ever
        stands there, but the table needs them.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def cliff(n_rows, n_cols):
            start, goal = (n_rows - 1) * n_cols, n_rows * n_cols - 1
            outcomes = {}
            ...
            return FiniteMDP.from_outcomes(outcomes, start=start)
    """,
    cases=lambda rng: [Case(dict(n_rows=4, n_cols=12), cliff_walking()), Case(dict(n_rows=3, n_cols=5), _cliff(3, 5))],
    hints=(
        "For `s` in `range(goal)`: row `s // n_cols`, column `s % n_cols`; clip both after the move.",
        "The cliff is `start < s_next < goal`; there the outcome is `(1, start, -100)`.",
    ),
    solution="""
        def cliff(n_rows, n_cols):
            start, goal = (n_rows - 1) * n_cols, n_rows * n_cols - 1
            outcomes = {}
            for s in range(goal):
                for a, (down, right) in enumerate([(-1, 0), (1, 0), (0, 1), (0, -1)]):
                    row = min(max(s // n_cols + down, 0), n_rows - 1)
                    col = min(max(s % n_cols + right, 0), n_cols - 1)
                    s_next = row * n_cols + col
                    r = -1
                    if start < s_next < goal:
                        s_next, r = start, -100
                    outcomes[s, a] = [(1, s_next, r)]
            return FiniteMDP.from_outcomes(outcomes, start=start)
    """,
    wrong=(
        Wrong(
            {"s_next, r = start, -100": "s_next, r = goal, -100"},
            "a fall ends the episode: it should lead back to the start, and the episode goes on",
        ),
        Wrong(
            {"s_next, r = start, -100": "r = -100"},
            "after a fall the agent stands in the cliff: it should be back at the start",
        ),
        Wrong(
            {"s_next, r = start, -100": "s_next, r = start, -101"},
            "a fall costs 101: the 100 replaces the cost of the step, it is not added to it",
        ),
        Wrong(
            {"min(max(s % n_cols + right, 0), n_cols - 1)": "(s % n_cols + right) % n_cols"},
            "a move against the left or right border comes out on the other side: it should stay where it is",
        ),
        Wrong(
            {"(-1, 0), (1, 0), (0, 1), (0, -1)": "(-1, 0), (0, 1), (1, 0), (0, -1)"},
            "the actions are in another order: 0 up, 1 down, 2 right, 3 left",
        ),
    ),
    minutes=20,
    covers=("ex-cliff", "fig-22"),
)


def _discounted(gamma):
    mdp = random_walk(5)
    rng = np.random.default_rng(0)
    return float(td0(mdp, uniform_policy(mdp), gamma, 100, alpha=0.1, V0=0.5, rng=rng).V[3])


Exercise(
    id="ch04-claim-gamma",
    kind="experiment",
    tier="deep",
    section="The cliff",
    title="Does TD do without the discount factor?",
    statement=r"""
        The document explains the speed of TD by an update that does not contain $\gamma$. If that were so, $\gamma$ could not
        matter. Run `td0` on `random_walk(5)` with `uniform_policy`, 100 episodes, `alpha=0.1`, `V0=0.5`, and a fresh `np.random.default_rng(0)`
        each time, with $\gamma = 1$ and with $\gamma = 0.5$. Bind `verdict_gamma` to `(word, v1, v05)`: `"confirmed"` if the value of the middle
        state, number 3, is the same in both runs, else `"refuted"`, and this value in both runs.
    """,
    setup="import numpy as np\nfrom rlcore.envs import random_walk\nfrom rlcore.mdp import uniform_policy\nfrom rlcore.td import td0",
    stub="verdict_gamma = ...",
    cases=lambda rng: [Case({}, ("refuted", _discounted(1.0), _discounted(0.5)))],
    hints=(
        "`td0(mdp, pi, gamma, 100, alpha=0.1, V0=0.5, rng=np.random.default_rng(0)).V[3]`.",
        "Both runs see the same walks, since the generator starts anew: whatever differs comes from gamma.",
    ),
    solution="""
        mdp = random_walk(5)
        v1, v05 = [
            float(td0(mdp, uniform_policy(mdp), gamma, 100, alpha=0.1, V0=0.5, rng=np.random.default_rng(0)).V[3])
            for gamma in (1.0, 0.5)
        ]
        verdict_gamma = ("confirmed" if v1 == v05 else "refuted", v1, v05)
    """,
    wrong=(
        Wrong(
            """
            mdp = random_walk(5)
            v1 = float(td0(mdp, uniform_policy(mdp), 1.0, 100, alpha=0.1, V0=0.5, rng=np.random.default_rng(0)).V[3])
            verdict_gamma = ("confirmed", v1, v1)
            """,
            "both numbers come from gamma = 1: run it again with gamma = 0.5",
        ),
        Wrong(
            """
            mdp, rng = random_walk(5), np.random.default_rng(0)
            v1, v05 = [float(td0(mdp, uniform_policy(mdp), g, 100, alpha=0.1, V0=0.5, rng=rng).V[3]) for g in (1.0, 0.5)]
            verdict_gamma = ("refuted", v1, v05)
            """,
            "the second run went on with the generator of the first and saw other walks: make a fresh one each time",
        ),
        Wrong(
            """
            mdp = random_walk(5)
            v1, v05 = [float(td0(mdp, uniform_policy(mdp), g, 100, alpha=0.1, rng=np.random.default_rng(0)).V[3]) for g in (1.0, 0.5)]
            verdict_gamma = ("refuted", v1, v05)
            """,
            "these runs start at 0: give V0=0.5",
        ),
        Wrong(
            """
            mdp = random_walk(5)
            v1, v05 = [float(td0(mdp, uniform_policy(mdp), g, 100, alpha=0.1, V0=0.5, rng=np.random.default_rng(0)).V[3]) for g in (1.0, 0.5)]
            verdict_gamma = ("confirmed", v1, v05)
            """,
            "the numbers are right, and they differ: gamma is in the update",
        ),
    ),
    minutes=8,
    covers=("cl-042", "eq-19"),
)


def _sarsa_path(alpha):
    mdp = cliff_walking()
    run = sarsa(mdp, 1.0, 2000, alpha=alpha, epsilon=0.1, record=1, rng=np.random.default_rng(1))
    Q = run.history[-1000:].mean(axis=0)
    return len(rollout(mdp, greedy(Q), 100, rng=np.random.default_rng(0)).rewards)


Exercise(
    id="ch04-claim-safest-path",
    kind="experiment",
    tier="deep",
    section="The cliff",
    title="Does SARSA take the safest path?",
    statement=r"""
        On the cliff the path along the edge has 13 steps, through the second row 15, along the top row, farthest from the cliff,
        17. The document says that SARSA takes the safest one. Run `sarsa` on `cliff_walking()` with $\gamma = 1$, 2000 episodes,
        `epsilon=0.1`, once with `alpha=0.1` and once with `alpha=0.5`, each time with a new `np.random.default_rng(1)`. A single
        table is restless, so keep the table after every episode: with `record=1`, `run.history` is `(2001, S, A)`. Average the
        last 1000 tables, follow the greedy policy of the average with `rollout` for at most 100 steps (nothing in it is left to
        chance, so any generator will do), and count the steps to the goal. Bind `verdict_path` to `(word, n01, n05)`: `"confirmed"` if both paths have 17 steps, else `"refuted"`, and the two
        numbers of steps.
    """,
    setup="""
        import numpy as np
        from rlcore.bellman import greedy
        from rlcore.envs import cliff_walking
        from rlcore.mdp import rollout
        from rlcore.td import sarsa
    """,
    stub="verdict_path = ...",
    cases=lambda rng: [Case({}, ("refuted", _sarsa_path(0.1), _sarsa_path(0.5)))],
    hints=(
        "`run.history[-1000:].mean(axis=0)` is the averaged table, `(S, A)`.",
        "`len(rollout(mdp, greedy(Q), 100, rng=rng).rewards)` counts the steps to the goal: the rollout ends there.",
    ),
    solution="""
        mdp, steps = cliff_walking(), []
        for alpha in (0.1, 0.5):
            run = sarsa(mdp, 1.0, 2000, alpha=alpha, epsilon=0.1, record=1, rng=np.random.default_rng(1))
            Q = run.history[-1000:].mean(axis=0)
            steps.append(len(rollout(mdp, greedy(Q), 100, rng=np.random.default_rng(0)).rewards))
        verdict_path = ("refuted" if min(steps) < 17 else "confirmed", *steps)
    """,
    wrong=(
        Wrong(
            "verdict_path = ('confirmed', 17, 17)",
            "the first number is not that of alpha = 0.1: its path is shorter than the longest; run it, and count",
        ),
        Wrong(
            "verdict_path = ('refuted', 13, 13)",
            "13 steps is the path of Q-learning, along the edge: the runs must be of sarsa, with epsilon = 0.1",
        ),
        Wrong("verdict_path = ('refuted', 17, 15)", "the two numbers are swapped: alpha = 0.1 first"),
        Wrong(
            "verdict_path = ('confirmed', 15, 17)",
            "15 steps is not the path farthest from the cliff: one path is enough to refute the claim",
        ),
    ),
    minutes=25,
    covers=("cl-058", "fig-22", "alg-sarsa"),
)


PROOFS = (
    Proof(
        "The largest estimate is too large",
        r"""
        In some state the actions have the values $q_1, \dots, q_n$, and $X_1, \dots, X_n$ are estimates that are right on average,
        $\mathbb E[X_i] = q_i$. Q-learning bootstraps from $\max_i X_i$. Show that $\mathbb E[\max_i X_i] \ge \max_i q_i$. Then let
        $Y_1, \dots, Y_n$ be a second set of such estimates, independent of the first, and let $I$ be the place of the largest
        $X$: show that $\mathbb E[Y_I] \le \max_i q_i$.
        """,
        (
            "$\\max_i X_i \\ge X_j$ for every single $j$, in every outcome.",
            "Expectations keep that inequality; then the best $j$ is chosen.",
            "For the second part, the expectation given $I = i$: independence turns $\\mathbb E[Y_i \\mid I = i]$ into $q_i$.",
            "A mean of the $q_i$ with the weights $P(I = i)$ is at most the largest of them.",
        ),
        r"""
        In every outcome $\max_i X_i \ge X_j$ for each $j$, so $\mathbb E[\max_i X_i] \ge \mathbb E[X_j] = q_j$. This holds for every $j$, the
        best one among them: $\mathbb E[\max_i X_i] \ge \max_j q_j$.

        $I$ is computed from the $X$ alone, so each $Y_i$ is independent of it, and $\mathbb E[Y_i \mid I = i] = \mathbb E[Y_i] = q_i$. Then

        $$
        \mathbb E[Y_I] = \sum_i P(I = i)\, \mathbb E[Y_i \mid I = i] = \sum_i P(I = i)\, q_i \le \max_i q_i ,
        $$

        since the weights are not negative and sum to 1. Two tables, one that chooses and one that values, turn the
        overestimate of a single one into an underestimate.
        """,
    ),
)


QUESTIONS = (
    Question(
        "The target of TD(0) is biased, the return is not. Why does TD still learn faster on the random walk?",
        (
            (
                "Its target varies less",
                True,
                "One random step enters it instead of all steps to the end; on this walk that outweighs the bias.",
            ),
            ("Its update does without the discount factor", False, "The discount factor multiplies the next value."),
            ("It sees more data", False, "Both methods see the same episodes."),
        ),
    ),
    Question(
        "On the cliff Q-learning collects less reward than SARSA while it learns, with epsilon fixed. What is the reason?",
        (
            ("It has learned the wrong values", False, "Its values come close to those of the optimal policy."),
            (
                "It learns values of a policy that never explores, while it explores",
                True,
                "Its path along the edge is best for a greedy agent; an agent that steps aside now and then falls there.",
            ),
            ("It explores more", False, "Both explore with the same probability."),
        ),
    ),
    Question(
        "A few episodes are replayed again and again until nothing changes. Where does TD(0) settle?",
        (
            ("At the mean of the returns that followed each state", False, "There Monte Carlo settles."),
            (
                "At the values of the process whose transitions are as frequent as in the data",
                True,
                "This is the certainty-equivalence estimate.",
            ),
            ("At the true values", False, "Only as well as the data tell them; more replay does not add data."),
        ),
    ),
    Question(
        "With which epsilon is expected SARSA the same as Q-learning?",
        (
            ("Never", False, "The mean under the policy becomes a maximum where the policy is greedy."),
            ("With epsilon = 0", True, "The mean under a greedy policy is the largest value."),
            ("With epsilon = 1", False, "Then the target is the plain mean over the actions."),
        ),
    ),
    Question(
        "On the recycling robot SARSA runs with epsilon fixed at 0.1 and falling step sizes. What do its values approach?",
        (
            (
                "Those of the best policy that keeps exploring as much",
                True,
                "The policy never becomes greedy, and the values are those of the policy that acts.",
            ),
            ("The optimal values", False, "For that epsilon must fall to 0, too."),
            ("Nothing: they keep moving", False, "Falling step sizes let them settle; only not at the optimal values."),
        ),
    ),
)
