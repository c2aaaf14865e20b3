"""Exercises of chapter 5: n-step targets, lambda-returns and eligibility traces."""

import numpy as np

from rlcore.envs import random_walk
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.mdp import uniform_policy
from rlcore.nstep import error_reduction, forward_increments, lambda_return, lambda_weights, n_step_return
from rlcore.studies.ch04 import repeat, walk_error
from rlcore.traces import backward_increments, td_lambda, trace_course

TITLE = "Exercises: eligibility traces"
NOTEBOOK = "05_eligibility_traces"


Exercise(
    id="ch05-weights-by-hand",
    kind="by hand",
    tier="core",
    section="Averages of returns",
    title="Who gets how much",
    statement=r"""
        Five steps are left in the episode and $\lambda = 0.9$. With which weights do the 1-step, 2-step, 3-step and 4-step returns and
        the complete return enter the $\lambda$-return ({eq}`eq-32`)? Bind the array of the five numbers to `weights`.
    """,
    stub="weights = ...",
    cases=lambda rng: [Case({}, lambda_weights(5, 0.9))],
    hints=(
        r"The first weight is $1 - \lambda$, and each later one is $\lambda$ times the one before.",
        "The complete return gets all that the others leave, so that the sum is 1.",
    ),
    solution="weights = np.append(0.1 * 0.9 ** np.arange(4), 0.9**4)",
    wrong=(
        Wrong(
            "weights = 0.1 * 0.9 ** np.arange(5)",
            "these weights sum to 0.41: the complete return gets all the rest, without the factor 1 - lambda",
        ),
        Wrong("weights = 0.9 ** np.arange(5)", "these weights sum to 4.1: the factor 1 - lambda is missing"),
        Wrong(
            "weights = np.append(0.1 * 0.9 ** np.arange(1, 5), 0.9**5)",
            "all powers are one too high: the 1-step return has lambda to the power 0",
        ),
        Wrong("weights = np.full(5, 0.2)", "the weights are not equal: each is lambda times the one before"),
    ),
    minutes=2,
    covers=("eq-32", "fig-23", "fig-24"),
)


Exercise(
    id="ch05-half-life",
    kind="by hand",
    tier="core",
    section="Three kinds of trace",
    title="How far back a trace reaches",
    statement=r"""
        $\gamma = 0.95$ and $\lambda = 0.9$. A state is visited once. After how many steps has its trace ({eq}`eq-34`) fallen to one half?
        And how large does the accumulating trace ({eq}`eq-35`) of a state get that is visited at every step for ever? Bind the two
        numbers, the first not rounded, to the tuple `reach`.
    """,
    stub="reach = ...",
    cases=lambda rng: [Case({}, (float(np.log(0.5) / np.log(0.855)), 1 / (1 - 0.855)))],
    hints=(
        r"After $k$ steps the trace is $(\gamma \lambda)^k$. Set it to one half and take logarithms.",
        r"The largest trace $e$ reproduces itself: $e = \gamma \lambda e + 1$.",
    ),
    solution="reach = (float(np.log(0.5) / np.log(0.95 * 0.9)), 1 / (1 - 0.95 * 0.9))",
    wrong=(
        Wrong(
            "reach = (float(np.log(0.5) / np.log(0.9)), 1 / (1 - 0.9))",
            "gamma is missing: a trace decays by gamma lambda in a step",
        ),
        Wrong(
            "reach = (0.5 / 0.855, 1 / (1 - 0.855))",
            "a trace does not fall by equal amounts: it is multiplied by gamma lambda at each step; take logarithms",
        ),
        Wrong(
            "reach = (float(np.log(0.5) / np.log(0.855)), 0.855 / (1 - 0.855))",
            "the newest visit counts 1, not gamma lambda: the bump comes after the decay",
        ),
    ),
    minutes=3,
    digits=4,
    covers=("eq-34", "eq-35", "cl-075"),
)


def _courses():
    return tuple(trace_course([0, 1, 2], 5, 0.8, kind, 0.25) for kind in ("accumulating", "dutch", "replacing"))


Exercise(
    id="ch05-three-traces",
    kind="by hand",
    tier="core",
    section="Three kinds of trace",
    title="Three traces of one state",
    statement=r"""
        $\gamma \lambda = 0.8$ and $\alpha = 0.25$. A state is visited at times 0, 1 and 2, and not again. Write down its accumulating, its
        dutch and its replacing trace at times 0 to 4. Mind that a dutch trace is shrunk by $1 - \alpha$ where the state is visited,
        and only there. Bind the tuple of three arrays of five numbers to `courses`.
    """,
    stub="courses = ...",
    cases=lambda rng: [Case({}, _courses())],
    hints=(
        "First decay by 0.8. If the state is visited, keep all of what is left, three quarters of it, or nothing; then add 1.",
        r"Dutch at time 1: $0.75 \cdot 0.8 \cdot 1 + 1 = 1.6$. At times 3 and 4 all three decay alike.",
    ),
    solution="""
        courses = ()
        for keep in (1, 0.75, 0):
            e = [1]
            for visited in (True, True, False, False):
                e.append(0.8 * e[-1] * keep + 1 if visited else 0.8 * e[-1])
            courses += (np.array(e),)
    """,
    wrong=(
        Wrong(
            "courses = (np.array([1, 1.8, 2.44, 1.952, 1.5616]), np.array([1, 1.6, 1.96, 1.176, 0.7056]), np.array([1, 1, 1, 0.8, 0.64]))",
            "the dutch trace shrinks where the state is not visited, too, as printed: at times 3 and 4 it decays by 0.8 alone",
        ),
        Wrong(
            "courses = (np.array([1, 1.8, 2.44, 1.952, 1.5616]), np.array([1, 1, 1, 0.8, 0.64]), np.array([1, 1.6, 1.96, 1.568, 1.2544]))",
            "the dutch and the replacing trace are swapped",
        ),
        Wrong(
            "courses = (np.array([1.0, 2, 3, 3, 3]), np.array([1, 1.75, 2.3125, 2.3125, 2.3125]), np.array([1.0, 1, 1, 1, 1]))",
            "nothing decays: a step multiplies every trace by 0.8",
        ),
        Wrong(
            "courses = (0.8 * np.array([1, 1.8, 2.44, 1.952, 1.5616]), 0.8 * np.array([1, 1.6, 1.96, 1.568, 1.2544]), 0.8 * np.array([1, 1, 1, 0.8, 0.64]))",
            "the newest visit has decayed already: first decay, then add 1",
        ),
        Wrong(
            "courses = (np.array([1, 1.8, 2.44, 1.952, 1.5616]), np.array([1, 1.2, 1.24, 0.992, 0.7936]), np.array([1, 1, 1, 0.8, 0.64]))",
            "the dutch trace is shrunk by alpha: what a visit leaves of it is 1 - alpha",
        ),
    ),
    minutes=6,
    covers=("fig-26", "om-state-traces", "eq-u-trace-dutch", "cl-076"),
)


Exercise(
    id="ch05-n-step-return",
    kind="fill in",
    tier="core",
    section="n-step returns",
    title="n steps, or to the end",
    statement=r"""
        Write the $n$-step return of time `t` ({eq}`eq-25`; its horizon is $h = t + n$). The episode
        terminated: `rewards` holds $R_1, \dots, R_T$, `values` holds $V(S_0), \dots, V(S_{T-1})$. Where the horizon reaches or
        passes the end, $n \ge T - t$, the result is the complete return. Return a number.
    """,
    stub="""
        def n_step(rewards, values, gamma, n, t):
            ...
    """,
    cases=lambda rng: [
        Case(dict(rewards=rewards, values=values, gamma=gamma, n=n, t=t), n_step_return(rewards, values, gamma, n, t))
        for n, t, gamma in ((2, 1, 0.9), (3, 3, 0.9), (4, 3, 0.8), (1, 0, 0.7), (9, 0, 0.9), (4, 1, 0.95))
        for rewards in [rng.normal(size=6).round(1)]
        for values in [rng.normal(size=6).round(1) + 3]
    ],
    hints=(
        "The last reward that counts is that of step `h = min(t + n, T)`, that is `rewards[h - 1]`.",
        "Start with `values[h]`, or 0 where `h` is `T`, and go backwards: `G = rewards[k] + gamma * G`.",
    ),
    solution="""
        def n_step(rewards, values, gamma, n, t):
            h = min(t + n, len(rewards))
            G = values[h] if h < len(rewards) else 0.0
            for k in reversed(range(t, h)):
                G = rewards[k] + gamma * G
            return float(G)
    """,
    wrong=(
        Wrong(
            {"values[h] if h < len(rewards) else 0.0": "values[min(h, len(values) - 1)]"},
            "at the end of the episode it bootstraps from the last state: nothing follows the end, start with 0 there",
        ),
        Wrong(
            """
            def n_step(rewards, values, gamma, n, t):
                end = t + n >= len(rewards)
                rest = 0.0 if end else values[t + n]
                return float(rewards[t] + gamma**n * rest)
            """,
            "only one reward enters, as the printed h = t + 1 has it: the horizon is t + n",
        ),
        Wrong(
            """
            def n_step(rewards, values, gamma, n, t):
                h = min(t + n, len(rewards))
                rest = values[h] if h < len(rewards) else 0.0
                return float(sum(gamma ** (k - t) * rewards[k] for k in range(t, h)) + gamma * rest)
            """,
            "the value at the horizon is n steps away: its factor is gamma to the power n",
        ),
        Wrong(
            {
                "h = min(t + n, len(rewards))\n    G = values[h] if h < len(rewards) else 0.0": "G = 0.0",
                "range(t, h)": "range(t, len(rewards))",
            },
            "this is always the complete return: stop after n rewards and use the value of the state reached",
        ),
        Wrong(
            {"values[h] if h < len(rewards) else 0.0": "0.0"},
            "the value at the horizon is missing: after n rewards comes gamma to the power n times V",
        ),
    ),
    minutes=8,
    covers=("eq-22", "eq-25", "cl-064"),
)


def _increment(rewards, V_t, V_h, gamma, alpha):
    G = V_h
    for r in rewards[::-1]:
        G = r + gamma * G
    return float(alpha * (G - V_t))


Exercise(
    id="ch05-bug-increment",
    kind="find the bug",
    tier="more",
    section="n-step TD",
    title="What the return is a function of",
    statement=r"""
        The increment of $V(S_t)$ from an $n$-step return that ends inside the episode: `rewards` $R_{t+1}, \dots, R_{t+n}$,
        `V_t` $= V(S_t)$, `V_h` $= V(S_{t+n})$. It was written from {eq}`eq-26` as the document prints it, with a parenthesis misplaced, and passed all tests, which had
        $\gamma = 1$. Mend it.
    """,
    stub="""
        def increment(rewards, V_t, V_h, gamma, alpha):
            G = V_h - V_t
            for r in rewards[::-1]:
                G = r + gamma * G
            return float(alpha * G)
    """,
    cases=lambda rng: [
        Case(g, _increment(**g))
        for n, gamma in ((2, 0.9), (1, 0.5), (4, 0.8), (3, 1.0))
        for g in [dict(rewards=rng.normal(size=n).round(1), V_t=2.0, V_h=-1.5, gamma=gamma, alpha=0.2)]
    ],
    hints=(
        r"By which power of $\gamma$ is $V(S_t)$ multiplied in this function?",
        "Compute the whole return first; the old estimate is subtracted from it at the end.",
    ),
    solution="""
        def increment(rewards, V_t, V_h, gamma, alpha):
            G = V_h
            for r in rewards[::-1]:
                G = r + gamma * G
            return float(alpha * (G - V_t))
    """,
    wrong=(
        Wrong(
            """
            def increment(rewards, V_t, V_h, gamma, alpha):
                n = len(rewards)
                return float(alpha * (gamma ** np.arange(n) @ rewards + gamma**n * (V_h - V_t)))
            """,
            "V(S_t) is still discounted with gamma to the power n: it belongs outside the return",
        ),
        Wrong(
            """
            def increment(rewards, V_t, V_h, gamma, alpha):
                n = len(rewards)
                return float(alpha * (gamma ** np.arange(n) @ rewards + gamma**n * V_h))
            """,
            "V(S_t) is gone altogether: the increment is alpha times return minus old estimate",
        ),
        Wrong(
            """
            def increment(rewards, V_t, V_h, gamma, alpha):
                n = len(rewards)
                return float(alpha * (gamma ** np.arange(n) @ rewards + gamma**n * V_h) - V_t)
            """,
            "the step size multiplies the return only: it multiplies the whole difference",
        ),
        Wrong(
            """
            def increment(rewards, V_t, V_h, gamma, alpha):
                return float(alpha * (rewards.sum() + V_h - V_t))
            """,
            "without gamma it is right for gamma = 1 only",
        ),
    ),
    minutes=5,
    covers=("eq-26", "alg-n-step-online"),
)


Exercise(
    id="ch05-lambda-return",
    kind="fill in",
    tier="core",
    section="Four lines instead of a sum",
    title="All lambda-returns in one backward pass",
    statement=r"""
        The sums of {eq}`eq-32` need not be formed: $L_t = R_{t+1} + \gamma \left((1 - \lambda) V(S_{t+1}) + \lambda L_{t+1}\right)$, and nothing
        follows the end. `rewards` holds $R_1, \dots, R_T$, `values` holds $V(S_0), \dots, V(S_{T-1})$ of an episode that terminated. Return
        $L_0, \dots, L_{T-1}$ as an array.
    """,
    stub="""
        def lambda_returns(rewards, values, gamma, lam):
            L = np.zeros(len(rewards))
            following, V_next = 0.0, 0.0
            for t in reversed(range(len(rewards))):
                ...
            return L
    """,
    cases=lambda rng: [
        Case(dict(rewards=rewards, values=values, gamma=gamma, lam=lam), lambda_return(rewards, values, gamma, lam))
        for T, gamma, lam in ((4, 0.9, 0.8), (6, 0.8, 0.3), (3, 0.9, 0.0), (5, 0.95, 1.0), (1, 0.9, 0.5))
        for rewards in [rng.normal(size=T).round(1)]
        for values in [rng.normal(size=T).round(1) + 2]
    ],
    hints=(
        "`following` is the lambda-return of the next step, `V_next` the value of the next state; both are 0 at the end.",
        "After computing `following` anew, store it in `L[t]`, and let `values[t]` become `V_next` for the step before.",
    ),
    solution="""
        def lambda_returns(rewards, values, gamma, lam):
            L = np.zeros(len(rewards))
            following, V_next = 0.0, 0.0
            for t in reversed(range(len(rewards))):
                following = rewards[t] + gamma * ((1 - lam) * V_next + lam * following)
                V_next = values[t]
                L[t] = following
            return L
    """,
    wrong=(
        Wrong(
            """
            def lambda_returns(rewards, values, gamma, lam):
                L, following, V_next = np.zeros(len(rewards)), 0.0, 0.0
                for t in reversed(range(len(rewards))):
                    L[t] = following = rewards[t] + gamma * (lam * V_next + (1 - lam) * following)
                    V_next = values[t]
                return L
            """,
            "the weights are swapped: lambda belongs to the lambda-return that follows, so that lambda = 0 is the one-step target",
        ),
        Wrong(
            """
            def lambda_returns(rewards, values, gamma, lam):
                L, following = np.zeros(len(rewards)), 0.0
                for t in reversed(range(len(rewards))):
                    L[t] = following = rewards[t] + gamma * ((1 - lam) * values[t] + lam * following)
                return L
            """,
            "it bootstraps from the state of this step: the value in the mixture is that of the next state",
        ),
        Wrong(
            """
            def lambda_returns(rewards, values, gamma, lam):
                L, V_next = np.zeros(len(rewards)), values[-1]
                following = V_next
                for t in reversed(range(len(rewards))):
                    L[t] = following = rewards[t] + gamma * ((1 - lam) * V_next + lam * following)
                    V_next = values[t]
                return L
            """,
            "the last step bootstraps: the episode terminated, and nothing follows its end",
        ),
        Wrong(
            """
            def lambda_returns(rewards, values, gamma, lam):
                L, following, V_next = np.zeros(len(rewards)), 0.0, 0.0
                for t in reversed(range(len(rewards))):
                    L[t] = following = rewards[t] + gamma * (V_next + lam * following)
                    V_next = values[t]
                return L
            """,
            "the weights add up to more than 1: the value of the next state gets 1 - lambda",
        ),
        Wrong(
            """
            def lambda_returns(rewards, values, gamma, lam):
                L, following, V_next = np.zeros(len(rewards)), 0.0, 0.0
                for t in reversed(range(len(rewards))):
                    L[t] = following = rewards[t] + gamma * (1 - lam) * V_next + lam * following
                    V_next = values[t]
                return L
            """,
            "gamma multiplies the value only: what follows is one step later, whichever way it is estimated",
        ),
    ),
    minutes=10,
    covers=("eq-31", "eq-32", "alg-lambda-return", "cl-070"),
)


def _episode(rng, S, T):
    """An episode with revisits that ends in the terminal state S - 1, whose value is 0."""
    V = rng.normal(size=S).round(1)
    V[-1] = 0.0
    states = np.append(rng.integers(S - 1, size=T), S - 1)
    states[1] = states[0]
    return dict(V=V, states=states, rewards=rng.normal(size=T).round(1))


Exercise(
    id="ch05-both-views",
    kind="fill in",
    tier="deep",
    section="Forward and backward are the same",
    title="Forward is backward",
    statement=r"""
        One recorded episode, `states` $S_0, \dots, S_T$ (the last one terminal, with `V` = 0) and `rewards` $R_1, \dots, R_T$; `V` stays fixed. Return
        the pair `(forward, backward)` of two `(T, S)` arrays. Row `t` of `forward`: $\alpha (L_t - V(S_t))$ at $S_t$, 0 elsewhere
        ({eq}`eq-33`). Row `t` of `backward`: $\alpha\, \delta_t E_t(s)$ for every $s$, with accumulating traces ({eq}`eq-37`). The two arrays
        differ, but the sums of their columns agree: print `forward.sum(axis=0) - backward.sum(axis=0)`. Then show on paper why: put
        $G_t - V(S_t) = \sum_k \gamma^k \delta_{t+k}$ into {eq}`eq-32`, and see in which order the two arrays add the same numbers.
    """,
    stub="""
        def both_views(V, states, rewards, gamma, lam, alpha):
            T, values = len(rewards), V[states]
            forward, backward = np.zeros((T, len(V))), np.zeros((T, len(V)))
            ...
            return forward, backward
    """,
    cases=lambda rng: [
        Case(
            dict(V=V, states=states, rewards=rewards, gamma=gamma, lam=lam, alpha=0.2),
            tuple(view(states, rewards, V, gamma, lam, 0.2) for view in (forward_increments, backward_increments)),
        )
        for S, T, gamma, lam in ((4, 6, 0.9, 0.8), (3, 5, 0.7, 0.5), (5, 9, 1.0, 0.9))
        for V, states, rewards in [_episode(rng, S, T).values()]
    ],
    hints=(
        "Forward: the lambda-return by its recursion, from the last step back. Backward: from the first step on, with the traces `e`.",
        "In a step of the backward view: decay all traces by `gamma * lam`, add 1 to that of `states[t]`, then multiply by the TD error.",
        r"On paper: $L_t - V(S_t) = \sum_k (\gamma \lambda)^k \delta_{t+k}$. Forward collects the later errors of a visit, backward hands each error to the earlier visits.",
    ),
    solution="""
        def both_views(V, states, rewards, gamma, lam, alpha):
            T, values = len(rewards), V[states]
            forward, backward = np.zeros((T, len(V))), np.zeros((T, len(V)))
            L, e = 0.0, np.zeros(len(V))
            for t in reversed(range(T)):
                L = rewards[t] + gamma * ((1 - lam) * values[t + 1] + lam * L)
                forward[t, states[t]] = alpha * (L - values[t])
            for t in range(T):
                e *= gamma * lam
                e[states[t]] += 1
                delta = rewards[t] + gamma * values[t + 1] - values[t]
                backward[t] = alpha * delta * e
            return forward, backward
    """,
    wrong=(
        Wrong(
            {"e[states[t]] += 1": "e[states[t]] = 1"},
            "these traces are replacing: where a state comes back, forward and backward differ",
        ),
        Wrong(
            {"e *= gamma * lam": "e = e * lam"},
            "the traces decay by lambda alone: an error k steps later counts gamma lambda to the power k",
        ),
        Wrong(
            {"((1 - lam) * values[t + 1] + lam * L)": "L"},
            "forward holds complete returns, lambda = 1: mix in the values of the next states",
        ),
        Wrong(
            {"values[t + 1] - values[t]\n": "(values[t + 1] - values[t])\n"},
            "the TD error discounts V(S_t), too: gamma belongs to the next value alone",
        ),
        Wrong({"return forward, backward": "return backward, forward"}, "the two arrays are swapped: forward first"),
        Wrong(
            {"backward[t] = alpha * delta * e": "backward[t, states[t]] = alpha * delta * e[states[t]]"},
            "each error changes one state only: in the backward view it changes every state that has a trace",
        ),
    ),
    minutes=30,
    covers=("eq-33", "eq-34", "eq-35", "eq-36", "eq-37", "cl-073", "fig-25", "fig-27"),
)


def _credited(Q, s, a, delta, decay, cut=True):
    E, total = np.zeros_like(Q), np.zeros_like(Q)
    for t in range(len(a)):
        if cut and Q[s[t], a[t]] != Q[s[t]].max():
            E[:] = 0.0
        E *= decay
        E[s[t], a[t]] += 1
        total += delta[t] * E
    return total


def _actions(rng, T):
    Q = rng.permutation(12).reshape(4, 3).astype(float)
    s, a = rng.integers(4, size=T), rng.integers(3, size=T)
    a[::2] = Q[s[::2]].argmax(axis=1)
    a[1] = Q[s[1]].argmin()
    a[4] = a[3] = Q[s[3]].argmax()
    s[4] = s[3]
    s[5], a[5] = s[1], a[1]
    return dict(Q=Q, s=s, a=a, delta=rng.normal(size=T).round(1))


Exercise(
    id="ch05-bug-cut",
    kind="find the bug",
    tier="more",
    section="Which errors arrive?",
    title="The wrong action decides",
    statement=r"""
        Watkins's Q($\lambda$) forgets all traces when an exploratory action comes. Here `Q` `(S, A)` stays fixed, the pairs `s[t]`, `a[t]` and the
        TD errors `delta[t]` are recorded, `decay` is $\gamma \lambda$, and the function returns the credit
        $\sum_t \delta_t E_t(s, a)$ of each pair. On the maze it learns, but not what it should: the error of an exploratory step
        reaches the pairs before it, and the exploratory pair itself hears nothing of what comes later. Which action decides about the cut?
        Mend it.
    """,
    stub="""
        def credit(Q, s, a, delta, decay):
            E, total = np.zeros_like(Q), np.zeros_like(Q)
            for t in range(len(a)):
                E[s[t], a[t]] += 1
                total += delta[t] * E
                greedy = Q[s[t], a[t]] == Q[s[t]].max()
                E *= decay if greedy else 0.0
            return total
    """,
    cases=lambda rng: [
        Case(g, _credited(**g))
        for T, decay in ((6, 0.8), (8, 0.9), (10, 0.5))
        for g in [dict(**_actions(rng, T), decay=decay)]
    ],
    hints=(
        "When the error of step `t` has been credited, it is the action of step `t + 1` that decides what becomes of the traces.",
        "Either look at `a[t + 1]` at the end of the loop, or decide with `a[t]` at its beginning, before the bump.",
    ),
    solution="""
        def credit(Q, s, a, delta, decay):
            E, total = np.zeros_like(Q), np.zeros_like(Q)
            for t in range(len(a)):
                greedy = Q[s[t], a[t]] == Q[s[t]].max()
                E *= decay if greedy else 0.0
                E[s[t], a[t]] += 1
                total += delta[t] * E
            return total
    """,
    wrong=(
        Wrong(
            """
            def credit(Q, s, a, delta, decay):
                E, total = np.zeros_like(Q), np.zeros_like(Q)
                for t in range(len(a)):
                    E[s[t], a[t]] += 1
                    total += delta[t] * E
                    E *= decay
                    if Q[s[t], a[t]] < Q[s[t]].max():
                        E[:] = 0.0
                return total
            """,
            "the action of step t still decides after its own error: what comes after step t depends on the action of step t + 1",
        ),
        Wrong(
            {"greedy = Q[s[t], a[t]] == Q[s[t]].max()\n        E *= decay if greedy else 0.0": "E *= decay"},
            "nothing is cut any more: this is the credit of SARSA(lambda)",
        ),
        Wrong(
            {
                "greedy = Q[s[t], a[t]] == Q[s[t]].max()": "E *= decay",
                "E *= decay if greedy else 0.0": "if Q[s[t], a[t]] < Q[s[t]].max():\n            E[s[t], a[t]] = 0.0",
            },
            "only the trace of the exploratory pair is reset, as the document says in one place: all traces are",
        ),
        Wrong(
            """
            def credit(Q, s, a, delta, decay):
                E, total = np.zeros_like(Q), np.zeros_like(Q)
                for t in range(len(a)):
                    E[s[t], a[t]] += 1
                    if t + 1 < len(a) and Q[s[t + 1], a[t + 1]] < Q[s[t + 1]].max():
                        E[:] = 0.0
                    total += delta[t] * E
                    E *= decay
                return total
            """,
            "now it cuts one step too early: the error of the step before the exploratory action is still credited",
        ),
        Wrong(
            """
            def credit(Q, s, a, delta, decay):
                E, total = np.zeros_like(Q), np.zeros_like(Q)
                for t in range(len(a)):
                    E *= decay if Q[s[t], a[t]] == Q[s[t]].max() else 0.0
                    E[s[t], a[t]] = 1
                    total += delta[t] * E
                return total
            """,
            "the cut is right, but the traces have become replacing: add 1, as before",
        ),
    ),
    minutes=12,
    covers=("eq-u-watkins-trace", "alg-watkins", "fig-29", "cl-082"),
)


Exercise(
    id="ch05-predict-sixth",
    kind="predict",
    tier="more",
    section="Which errors arrive?",
    title="Five greedy actions and a sixth",
    statement=r"""
        Watkins's Q($\lambda$) with $\gamma \lambda = 0.9$. A pair is visited at time $t$ and not again. The actions at $t + 1, \dots, t + 5$ are greedy, the one
        at $t + 6$ is exploratory. How much of each TD error $\delta_t, \delta_{t+1}, \dots, \delta_{t+7}$ is credited to the pair? Predict whether
        the sixth error, $\delta_{t+5}$, counts. Then bind the array of the eight factors $E_t, \dots, E_{t+7}$ of the pair to `factors`.
    """,
    stub="factors = ...",
    cases=lambda rng: [Case({}, np.append(0.9 ** np.arange(6), [0, 0]))],
    hints=(
        r"$\delta_{t+5}$ contains the largest $Q(S_{t+6}, \cdot)$, whatever is done at $t + 6$.",
        "The traces are set to 0 when the exploratory action comes, at $t + 6$. Which errors are known before?",
    ),
    solution="factors = np.append(0.9 ** np.arange(6), [0, 0])",
    wrong=(
        Wrong(
            "factors = np.append(0.9 ** np.arange(5), [0, 0, 0])",
            "the sixth error counts, though the document excludes it: it uses five greedy actions and a maximum, not the action at t + 6",
        ),
        Wrong(
            "factors = np.append(0.9 ** np.arange(7), [0])",
            "the error of the exploratory action itself is not credited: the trace is 0 from t + 6 on",
        ),
        Wrong("factors = 0.9 ** np.arange(8)", "the traces are cut when the exploratory action comes, at t + 6"),
        Wrong({"arange(6)": "arange(1, 7)"}, "the error of the visit itself counts in full: the first factor is 1"),
    ),
    minutes=4,
    covers=("ex-trace-example", "cl-079", "cl-080"),
)


def _learned(V, s, r, s_next, starts, gamma, lam, alpha):
    V, e = V.copy(), np.zeros(len(V))
    for i in range(len(s)):
        e *= gamma * lam * (not starts[i])
        e[s[i]] += 1
        V += alpha * (r[i] + gamma * V[s_next[i]] - V[s[i]]) * e
    return V


def _stream(rng, n_episodes, T, S):
    """Steps of several episodes in a row; the last state is terminal and worth 0."""
    states = rng.integers(S - 1, size=(n_episodes, T + 1))
    states[:, -1] = S - 1
    V = np.append(rng.normal(size=S - 1).round(1), 0.0)
    starts = np.zeros((n_episodes, T), bool)
    starts[:, 0] = True
    rewards = rng.normal(size=n_episodes * T).round(1)
    return dict(V=V, s=states[:, :-1].ravel(), r=rewards, s_next=states[:, 1:].ravel(), starts=starts.ravel())


Exercise(
    id="ch05-bug-reset",
    kind="find the bug",
    tier="more",
    section="SARSA(lambda)",
    title="Blame for what happened before",
    statement=r"""
        TD($\lambda$) over a stream of steps: step $i$ led from `s[i]` to `s_next[i]` and paid `r[i]`; `starts[i]` says that it is the first
        step of an episode. (The terminal state holds the value 0.) The first episode is learned as it should be; in the later ones, states of
        earlier episodes change that were not visited. Mend it.
    """,
    stub="""
        def stream(V, s, r, s_next, starts, gamma, lam, alpha):
            V, e = V.copy(), np.zeros(len(V))
            for i in range(len(s)):
                e *= gamma * lam
                e[s[i]] += 1
                V += alpha * (r[i] + gamma * V[s_next[i]] - V[s[i]]) * e
            return V
    """,
    cases=lambda rng: [
        Case(g, _learned(**g))
        for n, T, S, gamma, lam in ((3, 3, 6, 0.9, 0.8), (2, 4, 5, 1.0, 0.9), (4, 2, 7, 0.8, 0.5))
        for g in [dict(**_stream(rng, n, T, S), gamma=gamma, lam=lam, alpha=0.2)]
    ],
    hints=(
        "What do the traces hold when the second episode begins?",
        "Set all of them to 0 at a step that starts an episode, before the trace of its state is raised.",
    ),
    solution="""
        def stream(V, s, r, s_next, starts, gamma, lam, alpha):
            V, e = V.copy(), np.zeros(len(V))
            for i in range(len(s)):
                if starts[i]:
                    e[:] = 0.0
                e *= gamma * lam
                e[s[i]] += 1
                V += alpha * (r[i] + gamma * V[s_next[i]] - V[s[i]]) * e
            return V
    """,
    wrong=(
        Wrong(
            {"if starts[i]:\n            e[:] = 0.0\n        e *= gamma * lam": "e = gamma * lam * e"},
            "the traces still live on into the next episode: its errors have nothing to do with earlier episodes",
        ),
        Wrong(
            {
                "        if starts[i]:\n            e[:] = 0.0\n": "",
                "e[s[i]] += 1": "e[s[i]] += 1\n        if starts[i]:\n            e[:] = 0.0",
            },
            "the reset comes after the bump: the first state of each episode loses its own trace",
        ),
        Wrong(
            {"if starts[i]:\n            e[:] = 0.0\n        e *= gamma * lam": "e[:] = 0.0"},
            "the traces are reset at every step: this is TD(0)",
        ),
        Wrong(
            {"e[:]": "e[s[i]]"},
            "only the trace of the first state is reset: all traces must be 0 when an episode starts",
        ),
    ),
    minutes=6,
    covers=("eq-34", "eq-37", "alg-td-lambda-acc"),
)


def _one_episode(V, states, rewards, gamma, lam, alpha):
    starts = np.arange(len(rewards)) == 0
    return _learned(V, states[:-1], rewards, states[1:], starts, gamma, lam, alpha)


Exercise(
    id="ch05-bug-order",
    kind="find the bug",
    tier="core",
    section="SARSA(lambda)",
    title="Decayed before it counts",
    statement=r"""
        One episode of TD($\lambda$): `states` $S_0, \dots, S_T$, the last one terminal with the value 0, `rewards` $R_1, \dots, R_T$. With $\gamma = \lambda = 1$ it
        is right; with $\lambda = 0$, where it should be TD(0), it learns nothing at all. Two lines stand in the wrong order. Mend it.
    """,
    stub="""
        def episode(V, states, rewards, gamma, lam, alpha):
            V, e = V.copy(), np.zeros(len(V))
            for t in range(len(rewards)):
                delta = rewards[t] + gamma * V[states[t + 1]] - V[states[t]]
                e[states[t]] += 1
                e *= gamma * lam
                V += alpha * delta * e
            return V
    """,
    cases=lambda rng: [
        Case(g, _one_episode(**g))
        for S, T, gamma, lam in ((4, 6, 0.9, 0.8), (5, 5, 0.8, 0.4), (4, 5, 0.9, 0.0), (3, 4, 1.0, 1.0))
        for g in [dict(**_episode(rng, S, T), gamma=gamma, lam=lam, alpha=0.2)]
    ],
    hints=(
        "How large is the trace of the state that has just been visited when the error is credited? It should be at least 1.",
        "Decay what is left of earlier steps, then add 1 for this one, then credit the error.",
    ),
    solution="""
        def episode(V, states, rewards, gamma, lam, alpha):
            V, e = V.copy(), np.zeros(len(V))
            for t in range(len(rewards)):
                delta = rewards[t] + gamma * V[states[t + 1]] - V[states[t]]
                e *= gamma * lam
                e[states[t]] += 1
                V += alpha * delta * e
            return V
    """,
    wrong=(
        Wrong(
            {"        e *= gamma * lam\n": "", "e[states[t]] += 1": "e[states[t]] += 1\n        e = gamma * lam * e"},
            "the newest visit is still decayed before the error is credited: decay comes before the bump, or after the update",
        ),
        Wrong({"        e *= gamma * lam\n": ""}, "the decay is gone: traces must shrink by gamma lambda at each step"),
        Wrong(
            {"e *= gamma * lam\n        e[states[t]] += 1": "e[states[t]] = gamma * lam * e[states[t]] + 1"},
            "only the trace of the visited state decays: the others must shrink, too",
        ),
        Wrong(
            """
            def episode(V, states, rewards, gamma, lam, alpha):
                V, e = V.copy(), np.zeros(len(V))
                for t in range(len(rewards)):
                    e *= gamma * lam
                    e[states[t]] += 1
                    V += alpha * rewards[t] * e
                    delta = gamma * V[states[t + 1]] - V[states[t]]
                    V += alpha * delta * e
                return V
            """,
            "the table changes between the two parts of the error: compute all of delta before V changes",
        ),
    ),
    minutes=6,
    covers=("eq-34", "eq-35", "eq-37", "cl-074"),
)


def _dutch(E, s, a, alpha, decay):
    E = decay * E
    E[s, a] = (1 - alpha) * E[s, a] + 1
    return E


Exercise(
    id="ch05-bug-dutch",
    kind="find the bug",
    tier="more",
    section="Three kinds of trace",
    title="A dutch trace for one pair",
    statement=r"""
        The dutch traces of all pairs, `E` `(S, A)`, after the pair `(s, a)` was visited; `decay` is $\gamma \lambda$. The function follows the
        printed formula, $E_t(s, a) = (1 - \alpha) \gamma \lambda E_{t-1}(s, a) + 1$ for the visited pair and the same without the 1 for all others. The
        boxes of the algorithms shrink by $1 - \alpha$ the trace of the visited pair only. Make the function do what the boxes do.
    """,
    stub="""
        def dutch(E, s, a, alpha, decay):
            E = (1 - alpha) * decay * E
            E[s, a] += 1
            return E
    """,
    cases=lambda rng: [
        Case(g, _dutch(**g))
        for s, a, alpha, decay in ((1, 0, 0.5, 0.8), (0, 1, 0.1, 0.9), (2, 1, 0.3, 0.5))
        for g in [dict(E=rng.random(size=(3, 2)).round(2) + 0.1, s=s, a=a, alpha=alpha, decay=decay)]
    ],
    hints=(
        "Decay all traces alike first.",
        "Then only the entry `E[s, a]` is multiplied by `1 - alpha` and raised by 1.",
    ),
    solution="""
        def dutch(E, s, a, alpha, decay):
            E = decay * E
            E[s, a] = (1 - alpha) * E[s, a] + 1
            return E
    """,
    wrong=(
        Wrong(
            {"decay * E": "E * decay * (1 - alpha)", "(1 - alpha) * E[s, a]": "E[s, a]"},
            "all pairs are still shrunk by 1 - alpha: that belongs to the visited pair",
        ),
        Wrong(
            {"= (1 - alpha) * E[s, a] + 1": "+= 1"},
            "this trace accumulates: the visited pair keeps only 1 - alpha of its old trace",
        ),
        Wrong(
            {"(1 - alpha) * E[s, a] + 1": "1"},
            "this trace is replacing: the visited pair keeps 1 - alpha of its old trace",
        ),
        Wrong({"E[s, a] + 1": "(E[s, a] + 1)"}, "the 1 is shrunk, too: first shrink what is old, then add 1"),
        Wrong(
            {
                "E = decay * E": "kept = decay * E[s, a]\n    E = (1 - alpha) * decay * E",
                "(1 - alpha) * E[s, a]": "kept",
            },
            "it is the other way round: the visited pair is shrunk by 1 - alpha, the others are not",
        ),
    ),
    minutes=5,
    covers=("eq-u-trace-dutch", "om-indicator", "fig-28"),
)


Exercise(
    id="ch05-predict-first-reward",
    kind="predict",
    tier="core",
    section="The lambda-return algorithm",
    title="News travels ten cells",
    statement=r"""
        Ten cells in a row, 0 to 9, one action that steps right, and a reward of 1 for leaving cell 9, where the episode ends. All values are 0,
        $\gamma = 1$, $\alpha = 0.1$, accumulating traces. Predict for $\lambda = 0$, $0.5$ and $1$ how much cell 0 learns from the **first**
        episode. Bind the array of its three values after this episode to `news`.
    """,
    stub="news = ...",
    cases=lambda rng: [Case({}, 0.1 * np.array([0.0, 0.5, 1.0]) ** 9)],
    hints=(
        "Only the last step has a TD error that is not 0, and it is 1. What is the trace of cell 0 then?",
        r"From the visit of cell 0 to that of cell 9 the trace decays nine times: it is $\lambda^9$.",
    ),
    solution="news = 0.1 * np.array([0.0, 0.5, 1.0]) ** 9",
    wrong=(
        Wrong({"0.1 * ": ""}, "the step size is missing: these are the traces"),
        Wrong({"** 9": "** 10"}, "one decay too many: between the visits of cell 0 and cell 9 lie nine steps"),
        Wrong({"0.0": "1.0"}, "with lambda = 0 the error reaches the last cell only: cell 0 learns nothing"),
        Wrong({" ** 9": ""}, "the trace decays at each of the nine steps, not once"),
    ),
    minutes=3,
    digits=4,
    covers=("alg-td-lambda-acc", "eq-34", "cl-061"),
)


Exercise(
    id="ch05-build-walk",
    kind="build",
    tier="more",
    section="All of them together",
    title="A long random walk",
    statement="""
        Build the walk on which this chapter compares methods, for any odd `n`, and return it. States 1 to `n` in a row; a terminal state 0 at the left
        end and `n + 1` at the right end. One action, 0: a step to the left or to the right, each with probability 1/2. Entering the left end
        pays -1, entering the right end 1, everything else 0. Episodes start in the middle.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def walk(n):
            outcomes = {}
            ...
            return FiniteMDP.from_outcomes(outcomes, start=...)
    """,
    cases=lambda rng: [Case(dict(n=n), random_walk(n, rewards=(-1.0, 1.0))) for n in (19, 5)],
    hints=(
        "`outcomes[s, 0]` is a list of two outcomes `(probability, s_next, reward)`, for `s` from 1 to `n`.",
        "The reward of a step to the left is -1 if `s == 1`, that of a step to the right 1 if `s == n`; the middle is `(n + 1) // 2`.",
    ),
    solution="""
        def walk(n):
            outcomes = {}
            for s in range(1, n + 1):
                left, right = -1.0 * (s == 1), 1.0 * (s == n)
                outcomes[s, 0] = [(0.5, s - 1, left), (0.5, s + 1, right)]
            return FiniteMDP.from_outcomes(outcomes, start=(n + 1) // 2)
    """,
    wrong=(
        Wrong({"-1.0 * (s == 1)": "0.0"}, "the left end pays nothing: on this walk it pays -1"),
        Wrong({"start=(n + 1) // 2": "start=1"}, "episodes start beside the left end: start in the middle"),
        Wrong(
            {"(0.5, s - 1, left), (0.5, s + 1, right)": "(0.5, s - 1, left + right), (0.5, s + 1, left + right)"},
            "beside an end both steps pay: only the step that enters the end does",
        ),
        Wrong(
            {
                "outcomes[s, 0] = [(0.5, s - 1, left), (0.5, s + 1, right)]": "outcomes[s, 0], outcomes[s, 1] = [(1, s - 1, left)], [(1, s + 1, right)]"
            },
            "two actions: this walk has one, whose outcome is left or right by chance",
        ),
        Wrong(
            {"-1.0 * (s == 1), 1.0": "1.0 * (s == 1), -1.0"},
            "the rewards of the two ends are swapped: -1 left, 1 right",
        ),
    ),
    minutes=10,
    covers=("ex-random-walk-19",),
)


def _refutation():
    mdp = random_walk(5)
    pi = uniform_policy(mdp)
    v = np.array([0, *np.linalg.solve(np.eye(5) - 0.45 * (np.eye(5, k=1) + np.eye(5, k=-1)), [0, 0, 0, 0, 0.5]), 0])
    return tuple(error_reduction(mdp, pi, v, 2, 0.9, printed=printed)[0] for printed in (True, False))


Exercise(
    id="ch05-claim-error-reduction",
    kind="experiment",
    tier="deep",
    section="Why they are better targets",
    title="A bound that the right answer breaks",
    statement=r"""
        {eq}`eq-30`, as the document prints it, bootstraps from $v(S_{t+1})$ whatever $n$ is. Test it on `random_walk(5)` with `uniform_policy`, $\gamma = 0.9$, $n = 2$ and
        $v = v_\pi$, so that the right-hand side is 0. With `P, r = policy_matrix(mdp, pi)` the expected two-step return is
        $r + \gamma P r + \gamma^2$ times the expected value at the state that it bootstraps from. Bind `verdict_contraction` to `(word, printed, right)`: `"confirmed"`
        if the printed inequality holds within `1e-9`, else `"refuted"`, and the left-hand sides with $S_{t+1}$ and with $S_{t+2}$. A left-hand side is
        the largest absolute difference over all states. `P` is a sparse matrix of SciPy: multiply with `@`, as in `P @ (P @ v)`.
    """,
    setup="""
        import numpy as np
        from rlcore.bellman import policy_matrix, solve_policy
        from rlcore.envs import random_walk
        from rlcore.mdp import uniform_policy
    """,
    stub="verdict_contraction = ...",
    cases=lambda rng: [Case({}, ("refuted", *_refutation()), tol=1e-9)],
    hints=(
        "`P @ v` holds the expected value of the next state, `P @ P @ v` that of the state after it.",
        "`solve_policy(mdp, pi, 0.9)` is $v_\\pi$. The left-hand side is the largest absolute entry of expected return minus $v_\\pi$.",
    ),
    solution="""
        mdp = random_walk(5)
        pi = uniform_policy(mdp)
        v_pi = solve_policy(mdp, pi, 0.9)
        P, r = policy_matrix(mdp, pi)
        two_rewards = r + 0.9 * P @ r
        printed = float(np.abs(two_rewards + 0.81 * P @ v_pi - v_pi).max())
        right = float(np.abs(two_rewards + 0.81 * P @ P @ v_pi - v_pi).max())
        verdict_contraction = ("refuted" if printed > 1e-9 else "confirmed", printed, right)
    """,
    wrong=(
        Wrong(
            {"printed, right)": "right, printed)"},
            "the two numbers are swapped: first the printed form, with the state S_{t+1}",
        ),
        Wrong(
            {'"refuted" if printed > 1e-9 else "confirmed"': '"confirmed"'},
            "the numbers are right, and the first is larger than the right-hand side 0: the printed form does not hold",
        ),
        Wrong(
            {"0.81 * P @ v_pi": "0.9 * P @ v_pi", "0.81 * P @ P": "0.9 * P @ P"},
            "after two rewards the value is discounted twice: gamma squared",
        ),
        Wrong({"r + 0.9 * P @ r": "r"}, "the second reward is missing: the two-step return holds two rewards"),
    ),
    minutes=12,
    covers=("eq-30", "alg-error-reduction", "cl-065"),
)


def _errors(alpha=0.05):
    mdp, truth = random_walk(19), np.arange(1, 20) / 10 - 1
    errors = []
    for lam in (0.0, 0.9, 1.0):
        settings = dict(alpha=alpha, n_runs=10, rng=np.random.default_rng(0))
        runs = repeat(td_lambda, mdp, uniform_policy(mdp), 1.0, lam, 10, **settings)
        errors.append(float(np.mean([walk_error(run.V, truth) for run in runs])))
    return errors


Exercise(
    id="ch05-claim-memory",
    kind="experiment",
    tier="deep",
    section="Three kinds of trace",
    title="Is more memory always better?",
    statement=r"""
        The document praises traces without saying how long they should be. Put this claim to the test: *the larger $\lambda$, the smaller the error*. Run `td_lambda` on
        `random_walk(19)` with `uniform_policy`, $\gamma = 1$, 10 episodes, `alpha=0.05`, for $\lambda = 0$, $0.9$ and $1$; use `repeat` with
        `n_runs=10` and, for each $\lambda$, `rng=np.random.default_rng(0)`. The true values of states 1 to 19 are `np.arange(1, 20) / 10 - 1`, and `walk_error(run.V, truth)` is the error of a run. Bind
        `verdict_memory` to `(word, e0, e09, e1)`: `"confirmed"` if the mean errors fall in this order, else `"refuted"`, and the three mean errors.
    """,
    setup="""
        import numpy as np
        from rlcore.envs import random_walk
        from rlcore.mdp import uniform_policy
        from rlcore.studies.ch04 import repeat, walk_error
        from rlcore.traces import td_lambda
    """,
    stub="verdict_memory = ...",
    cases=lambda rng: [Case({}, ("refuted", *_errors()), tol=1e-6)],
    hints=(
        "`repeat(td_lambda, mdp, pi, 1.0, lam, 10, alpha=0.05, n_runs=10, rng=np.random.default_rng(0))` gives a list of ten runs.",
        "Average `walk_error(run.V, truth)` over the runs, once for each lambda.",
    ),
    solution="""
        mdp, truth, errors = random_walk(19), np.arange(1, 20) / 10 - 1, []
        for lam in (0.0, 0.9, 1.0):
            settings = dict(alpha=0.05, n_runs=10, rng=np.random.default_rng(0))
            runs = repeat(td_lambda, mdp, uniform_policy(mdp), 1.0, lam, 10, **settings)
            errors.append(float(np.mean([walk_error(run.V, truth) for run in runs])))
        verdict_memory = ("confirmed" if errors[0] > errors[1] > errors[2] else "refuted", *errors)
    """,
    wrong=(
        Wrong(
            {'"confirmed" if errors[0] > errors[1] > errors[2] else "refuted"': '"confirmed"'},
            "the errors are right, but the last one is larger than the second: with lambda = 1 the returns of long walks vary too much",
        ),
        Wrong({"(0.0, 0.9, 1.0)": "(1.0, 0.9, 0.0)"}, "the order is turned round: lambda = 0 first"),
        Wrong(
            {"alpha=0.05, n_runs=10": "alpha=0.05, n_runs=1"},
            "this is a single run for each lambda: use ten, one run is an anecdote",
        ),
        Wrong(
            {"for lam": "rng = np.random.default_rng(0)\nfor lam", "rng=np.random.default_rng(0)": "rng=rng"},
            "one generator serves all three: make a new one for each lambda, so that the three start alike",
        ),
        Wrong(
            {"alpha=0.05": 'alpha=0.05, trace="replacing"'},
            "these traces are replacing; the default, accumulating, is asked for",
        ),
    ),
    minutes=15,
    covers=("cl-061", "cl-062", "alg-td-lambda-acc", "ex-random-walk-19"),
)


PROOFS = (
    Proof(
        "How much trace there can be",
        r"""
        Accumulating traces ({eq}`eq-34`, {eq}`eq-35`) start at 0, and $\gamma \lambda < 1$. Show that at time $t$, the visit of $S_t$
        included, they sum to $\sum_s E_t(s) = \left( 1 - (\gamma \lambda)^{t+1} \right) / (1 - \gamma \lambda)$, whatever states were visited. Conclude that no trace
        exceeds $1 / (1 - \gamma \lambda)$, and say when one comes as near to that as you like.
        """,
        (
            "One step of the sum: all traces fade by the same factor, and exactly one gains 1.",
            "Induction from $t = 0$, or the geometric series written out.",
            "Traces are not negative, so a single one is at most the sum of all.",
            "The case in which the sum is a single trace: one state that is visited at every step.",
        ),
        r"""
        Let $M_t = \sum_s E_t(s)$. At a step every trace is multiplied by $\gamma \lambda$, and that of the one state which is visited
        gains 1, so $M_t = \gamma \lambda M_{t-1} + 1$ with $M_{-1} = 0$. For $t = 0$ this is 1, as the formula says. If
        $M_{t-1} = (1 - (\gamma \lambda)^t) / (1 - \gamma \lambda)$, then

        $$
        M_t = \frac{\gamma \lambda - (\gamma \lambda)^{t+1} + 1 - \gamma \lambda}{1 - \gamma \lambda} = \frac{1 - (\gamma \lambda)^{t+1}}{1 - \gamma \lambda} .
        $$

        Which states were visited plays no part. A trace is never negative: it starts at 0, is multiplied by a number
        that is not negative, and gains 1 at times. So $E_t(s) \le M_t \le 1 / (1 - \gamma \lambda)$. If one state is visited at every step,
        all other traces stay 0, its own trace is $M_t$, and that goes to $1 / (1 - \gamma \lambda)$.
        """,
    ),
)


QUESTIONS = (
    Question(
        "What does the forward view do with the n-step returns of a state?",
        (
            ("It looks for the best of them", False, "Nothing is chosen or maximised; the policy is only evaluated."),
            ("It averages them with fixed weights", True, "The weights depend on lambda alone, not on the rewards."),
            ("It takes the longest one", False, "That is Monte Carlo, the case of lambda = 1."),
        ),
    ),
    Question(
        "Why is an n-step target with n between the extremes often best?",
        (
            ("Modern problems need it", False, "It is so on the plain random walk."),
            (
                "Longer targets are less biased and more variable",
                True,
                "The best n balances the bias of the first values and the variance of the rewards.",
            ),
            ("It needs the least memory", False, "One-step targets need less."),
        ),
    ),
    Question(
        "When do replacing and accumulating traces give the same values?",
        (
            ("Always", False, "A state that comes back while its trace is alive gets more than 1 when it accumulates."),
            ("Never", False, "Think of episodes that never come back to a state."),
            (
                "When no state is visited again while its trace is alive",
                True,
                "Then every visit finds a trace of 0, and both make it 1.",
            ),
        ),
    ),
    Question(
        "Which error is invisible as long as the discount factor is 1?",
        (
            (
                "The old value placed inside the bootstrapped part of the return",
                True,
                "It is then multiplied by a power of 1.",
            ),
            ("A trace that is not reset", False, "It credits states of earlier episodes, with any discount."),
            ("A trace that does not decay", False, "The decay is gamma times lambda, and lambda is still below 1."),
        ),
    ),
    Question(
        "The traces of Watkins's method are cut by an exploratory action. What does this cost?",
        (
            (
                "With much exploration errors reach only a few steps back",
                True,
                "With epsilon = 0.8 a cut comes after 1.6 steps on average in the maze of the chapter.",
            ),
            ("The values become wrong", False, "The cut is what keeps them those of the greedy policy."),
            ("Exploratory actions are never learned about", False, "Each gets a trace of 1 and the error of its step."),
        ),
    ),
)
