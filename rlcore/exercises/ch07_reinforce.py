"""Exercises of chapter 7: softmax and Gaussian policies, policy gradients, REINFORCE, baselines, actor-critic."""

from functools import cache

import numpy as np

from rlcore.distributions import Categorical, Gaussian
from rlcore.envs import short_corridor
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.mdp import FiniteMDP
from rlcore.neurons import softmax
from rlcore.policy_gradient import episode_gradient, gradient_estimates, objective, policy_gradient_exact
from rlcore.studies.ch07 import bluff_guarantee

TITLE = "Exercises: policy gradients"
NOTEBOOK = "07_reinforce"


# ---------------------------------------------------------------------- the policy


Exercise(
    id="ch07-softmax",
    kind="fill in",
    tier="core",
    section="The softmax policy and its score",
    title="From preferences to probabilities",
    statement=r"""
        A softmax policy chooses action $a$ with a probability proportional to $e^{h_a}$, where $h_a$ is its preference for $a$. `h` is the array of the preferences
        of all actions in one state. Return the array of their probabilities. Preferences of 3000 must do no harm.
    """,
    stub="""
        def softmax(h):
            ...
    """,
    cases=lambda rng: [
        Case(dict(h=h), softmax(h))
        for h in (
            rng.normal(size=4).round(1),
            rng.normal(size=2).round(1),
            np.full(3, 800.0),
            np.array([3000.0, 2999.0, -3000.0]),
            np.array([0.0, 0.0, 0.0, 3000.0, 0.0]),
        )
    ],
    hints=(
        "Adding the same number to all preferences multiplies every $e^{h_a}$ by the same factor: it changes no probability.",
        "Subtract the largest preference first: no exponent is then above 0, and the sum is at least 1.",
    ),
    solution="""
        def softmax(h):
            weights = np.exp(h - h.max())
            return weights / weights.sum()
    """,
    wrong=(
        Wrong(
            """
            def softmax(h):
                with np.errstate(all="ignore"):
                    return np.exp(h) / np.exp(h).sum()
            """,
            "right for small preferences, but the exponential of 800 overflows: subtract the largest one first",
        ),
        Wrong(
            """
            def softmax(h):
                with np.errstate(all="ignore"):
                    weights = np.exp(h - h.mean())
                    return weights / weights.sum()
            """,
            "what is subtracted is not the largest preference: that may still lie far above the mean, or the smallest",
        ),
        Wrong(
            """
            def softmax(h):
                return np.exp(h - h.max())
            """,
            "these do not sum to 1: divide by their sum",
        ),
        Wrong(
            """
            def softmax(h):
                return np.eye(len(h))[h.argmax()]
            """,
            "this is the greedy policy: a softmax leaves every action a chance",
        ),
        Wrong(
            """
            def softmax(h):
                h = h - h.max()
                return h - np.log(np.exp(h).sum())
            """,
            "these are the logarithms of the probabilities",
        ),
    ),
    minutes=3,
    covers=("om-softmax", "alg-softmax-policy"),
)


def _three_scores():
    p = np.array([1.0, 2.0, 3.0]) / 6
    scores = np.eye(3) - p
    return scores, p @ scores


Exercise(
    id="ch07-score",
    kind="fill in",
    tier="core",
    section="The softmax policy and its score",
    title="The score of a softmax",
    statement=r"""
        Which change of the preferences makes the action that was taken more probable? `h` holds the preferences of one state, and `a` is the action taken. Return the
        gradient of $\ln \pi(a)$ with respect to `h`, an array of the same shape. Preferences of 1000 must do no harm.
    """,
    stub="""
        def score(h, a):
            ...
    """,
    cases=lambda rng: [
        Case(dict(h=h, a=a), Categorical(h).grad_log_prob(a))
        for h, a in (
            (rng.normal(size=4).round(1), 2),
            (rng.normal(size=2).round(1), 0),
            (rng.normal(size=3).round(1), 1),
            (np.array([1000.0, 998.0]), 1),
            (np.array([1000.0, 0.0, 0.0, 0.0]), 3),
            (np.array([-1000.0, 0.0, 0.5]), 0),
        )
    ],
    hints=(
        r"$\ln \pi(a) = h_a - \ln \sum_b e^{h_b}$. The derivative of the second part with respect to $h_b$ is $\pi(b)$.",
        "It is 1 at the place of `a` and 0 elsewhere, minus the probabilities.",
    ),
    solution="""
        def score(h, a):
            p = np.exp(h - h.max())
            p = p / p.sum()
            return np.eye(len(p))[a] - p
    """,
    wrong=(
        Wrong(
            {"np.eye(len(p))[a] - p": "p - np.eye(len(p))[a]"},
            "the sign is turned round: this is the gradient of the cost of a classifier, and it would make the action rarer",
        ),
        Wrong(
            """
            def score(h, a):
                return np.eye(len(h))[a]
            """,
            "the probabilities are missing: the other preferences enter through the sum in the denominator",
        ),
        Wrong(
            {"np.eye(len(p))[a] - p": "p[a] * (np.eye(len(p))[a] - p)"},
            "this is the gradient of the probability: divide it by the probability to get that of its logarithm",
        ),
        Wrong(
            {"np.eye(len(p))[a] - p": "np.eye(len(p))[a] * (1 - p)"},
            "only the preference of the chosen action moves: the others have to fall",
        ),
        Wrong({"    p = p / p.sum()\n": ""}, "the probabilities are not divided by their sum"),
    ),
    minutes=6,
    covers=("om-score", "alg-softmax-policy"),
)


Exercise(
    id="ch07-zero-mean",
    kind="by hand",
    tier="core",
    section="The softmax policy and its score",
    title="The score is zero on average",
    statement=r"""
        Three actions have the preferences $0$, $\ln 2$ and $\ln 3$. On paper, work out the score (the gradient of $\ln \pi(a)$ with respect to the three preferences) of each
        action, and the mean of the three under the policy itself. Bind `three_scores` to the tuple of a 3 x 3 array, whose row $a$ is the score of action $a$, and
        the array of the three numbers of the mean.
    """,
    stub="three_scores = ...",
    cases=lambda rng: [Case({}, _three_scores())],
    hints=(
        r"The weights are 1, 2 and 3, so the probabilities are 1/6, 1/3 and 1/2.",
        "Row $a$ is a 1 at place $a$, minus the three probabilities. Weight each row with the probability of its action, and add.",
    ),
    solution="""
        p = np.array([1, 2, 3]) / 6
        scores = np.eye(3) - p
        three_scores = (scores, p @ scores)
    """,
    wrong=(
        Wrong(
            {"p @ scores": "scores.mean(axis=0)"},
            "the scores are right; the mean weights each with the probability of its action, not all alike",
        ),
        Wrong(
            {"np.eye(3) - p": "p - np.eye(3)"},
            "the sign of the scores is turned round: the preference of the chosen action grows",
        ),
        Wrong(
            {"np.eye(3) - p": "(np.eye(3) - p).T"},
            "rows and columns are swapped: the row is the action taken, and it sums to 0",
        ),
        Wrong(
            {"[1, 2, 3]) / 6": "[0, np.log(2), np.log(3)]) / np.log(6)"},
            "the probabilities are proportional to exp(h), not to h",
        ),
        Wrong(
            {"np.eye(3) - p": "np.eye(3) - 1 / 3"}, "the actions are not equally probable: the weights are 1, 2 and 3"
        ),
    ),
    minutes=5,
    digits=4,
    covers=("om-score", "eq-u-baseline-zero"),
)


Exercise(
    id="ch07-gaussian",
    kind="fill in",
    tier="more",
    section="The softmax policy and its score",
    title="Continuous actions",
    statement=r"""
        For a continuous action the policy is a normal distribution with the mean $\mu$ and the standard deviation $\sigma = e^{\ell}$; the network learns $\mu$ and
        $\ell$, `log_std`. All arguments are numbers. Return the tuple of the logarithm of the density at `a`, and its derivatives with
        respect to `mean` and to `log_std`.
    """,
    stub="""
        def gaussian(mean, log_std, a):
            ...
            return log_prob, d_mean, d_log_std
    """,
    cases=lambda rng: [
        Case(
            dict(mean=mean, log_std=log_std, a=a),
            (
                float(policy.log_prob(np.array([a]))),
                *(float(part[0]) for part in policy.grad_log_prob(np.array([a]))),
            ),
        )
        for mean, log_std, a in ((0.5, 0.4, 2.0), (-1.0, -0.7, -1.5), (2.0, 0.3, 2.0))
        for policy in [Gaussian(np.array([mean]), np.array([log_std]))]
    ],
    hints=(
        r"With $z = (a - \mu) / \sigma$ the logarithm of the density is $-z^2 / 2 - \ell - \ln(2 \pi) / 2$.",
        r"$z$ changes by $-1 / \sigma$ with $\mu$, and by $-z$ with $\ell$.",
    ),
    solution="""
        def gaussian(mean, log_std, a):
            z = (a - mean) / np.exp(log_std)
            log_prob = -(z**2) / 2 - log_std - np.log(2 * np.pi) / 2
            return float(log_prob), float(z / np.exp(log_std)), float(z**2 - 1)
    """,
    wrong=(
        Wrong(
            """
            def gaussian(mean, log_std, a):
                z = (a - mean) / np.exp(log_std)
                return -(z**2) / 2 - log_std - np.log(2 * np.pi) / 2, z / np.exp(log_std), z**2
            """,
            "the -1 is missing in the last derivative: log_std also stands on its own in the density",
        ),
        Wrong(
            """
            def gaussian(mean, log_std, a):
                z = (a - mean) / np.exp(log_std)
                return -(z**2) / 2 - log_std - np.log(2 * np.pi) / 2, z, z**2 - 1
            """,
            "the derivative with respect to the mean is z divided by the standard deviation",
        ),
        Wrong(
            """
            def gaussian(mean, log_std, a):
                z = (a - mean) / np.exp(log_std)
                return -(z**2) / 2 - log_std - np.log(2 * np.pi) / 2, z / np.exp(log_std), (z**2 - 1) / np.exp(log_std)
            """,
            "this is the derivative with respect to the standard deviation, not to its logarithm",
        ),
        Wrong(
            """
            def gaussian(mean, log_std, a):
                z = (a - mean) / np.exp(log_std)
                return -(z**2) / 2 - np.log(2 * np.pi) / 2, z / np.exp(log_std), z**2 - 1
            """,
            "the density is lower where the spread is larger: its logarithm holds - log_std",
        ),
        Wrong(
            """
            def gaussian(mean, log_std, a):
                z = (a - mean) / np.exp(log_std)
                return -(z**2) / 2 - log_std, z / np.exp(log_std), z**2 - 1
            """,
            "the derivatives are right; the density lacks its constant, - ln(2 pi) / 2",
        ),
        Wrong(
            """
            def gaussian(mean, log_std, a):
                z = (a - mean) / np.exp(log_std)
                return -(z**2) / 2 - log_std - np.log(2 * np.pi) / 2, -z / np.exp(log_std), z**2 - 1
            """,
            "the mean moves away from the action: an action above it pulls it up",
        ),
    ),
    minutes=12,
    covers=("om-score",),
)


Exercise(
    id="ch07-entropy",
    kind="fill in",
    tier="more",
    section="The softmax policy and its score",
    title="How undecided is a policy?",
    statement=r"""
        The entropy $-\sum_a \pi(a) \ln \pi(a)$ is largest where all actions are equally probable, and 0 where the policy is
        deterministic. `p` holds the probabilities, and some may be 0. Return the entropy.
    """,
    stub="""
        def entropy(p):
            ...
    """,
    cases=lambda rng: [
        Case(dict(p=p), float(-(p[p > 0] @ np.log(p[p > 0]))))
        for p in (
            np.full(4, 0.25),
            np.array([0.7, 0.2, 0.1]),
            np.array([0.0, 0.4, 0.6]),
            np.array([1.0, 0.0]),
            np.array([0.95, 0.0499, 0.0001]),
        )
    ],
    hints=(
        r"$x \ln x$ goes to 0 as $x$ does: an action of probability 0 adds nothing.",
        "`p = p[p > 0]` leaves the actions that can happen.",
    ),
    solution="""
        def entropy(p):
            p = p[p > 0]
            return float(-(p @ np.log(p)))
    """,
    wrong=(
        Wrong(
            """
            def entropy(p):
                with np.errstate(all="ignore"):
                    return float(-(p * np.log(p)).sum())
            """,
            "right where all probabilities are positive; 0 times the logarithm of 0 is NaN: leave these actions out",
        ),
        Wrong(
            {"-(p @ np.log(p))": "p @ np.log(p)"},
            "the sign is turned round: logarithms of probabilities are negative, and the entropy is not",
        ),
        Wrong({"np.log": "np.log2"}, "this is measured in bits: take the natural logarithm"),
        Wrong(
            """
            def entropy(p):
                return float(-np.log(p[p > 0]).mean())
            """,
            "the mean is taken under equal weights: weight each logarithm with its own probability",
        ),
        Wrong(
            """
            def entropy(p):
                return float(np.log((p > 0).sum()))
            """,
            "this is the largest entropy that so many actions allow, whatever their probabilities",
        ),
    ),
    minutes=4,
    covers=("alg-softmax-policy", "cl-100"),
)


Exercise(
    id="ch07-predict-jump",
    kind="predict",
    tier="core",
    section="Smooth changes",
    title="A tiny change of a value",
    statement=r"""
        Two actions have the values 0 and $d$. As $d$ goes from $-0.1$ to $0.1$, how does the probability of the second action change under an
        $\varepsilon$-greedy policy with $\varepsilon = 0.1$, and how under a softmax over the values? Predict, then compute. Bind the 2 x 2 array `jump`: row 0
        $\varepsilon$-greedy, row 1 softmax, in each row the probability at $d = -0.1$, then at $d = 0.1$.
    """,
    stub="jump = ...",
    cases=lambda rng: [Case({}, np.array([[0.05, 0.95], [softmax(np.array([0, d]))[1] for d in (-0.1, 0.1)]]))],
    hints=(
        r"The $\varepsilon$-greedy policy draws from both actions with probability $\varepsilon$: the greedy one gets a share of that, too.",
        r"With two actions the softmax is $1 / (1 + e^{-d})$.",
    ),
    solution="jump = np.array([[0.05, 0.95], [1 / (1 + np.exp(0.1)), 1 / (1 + np.exp(-0.1))]])",
    wrong=(
        Wrong(
            {"[0.05, 0.95]": "[0.1, 0.9]"},
            "exploring, the policy draws from both actions: the worse one gets half of epsilon",
        ),
        Wrong(
            {"[0.05, 0.95]": "[0.0, 1.0]"}, "this is the greedy policy: with epsilon = 0.1 both actions keep a chance"
        ),
        Wrong(
            "jump = np.array([[0.95, 0.05], [1 / (1 + np.exp(-0.1)), 1 / (1 + np.exp(0.1))]])",
            "this is the probability of the first action",
        ),
        Wrong(
            "jump = np.array([[1 / (1 + np.exp(0.1)), 1 / (1 + np.exp(-0.1))], [0.05, 0.95]])",
            "the rows are swapped: epsilon-greedy is the one that jumps",
        ),
        Wrong(
            "jump = np.array([[0.475, 0.525], [0.475, 0.525]])",
            "epsilon-greedy does not see how small the difference is, only its sign",
        ),
    ),
    minutes=3,
    digits=4,
    covers=("cl-103", "ex-eps-greedy-jump"),
)


Exercise(
    id="ch07-predict-limits",
    kind="predict",
    tier="more",
    section="The softmax policy and its score",
    title="Who becomes decided?",
    statement=r"""
        A bandit has two arms with the values 0 and 1. Three agents learn for ever, with small steps. The first estimates the values and draws from a softmax over the estimates, the second estimates them and is
        $\varepsilon$-greedy with $\varepsilon = 0.1$, the third changes the preferences of a softmax along the gradient of its expected reward. To which numbers do their probabilities of the better arm go? Predict, and bind
        the tuple of the three to `limits`.
    """,
    stub="limits = ...",
    cases=lambda rng: [Case({}, (float(softmax(np.array([0.0, 1.0]))[1]), 0.95, 1.0))],
    hints=(
        "The estimates go to 0 and 1, and stay there. What does a softmax make of 0 and 1?",
        r"A preference estimates nothing: as long as $\pi$ of the better arm is below 1 the gradient pushes the preferences farther apart.",
    ),
    solution="limits = (float(1 / (1 + np.exp(-1))), 0.95, 1.0)",
    wrong=(
        Wrong(
            "limits = (1.0, 0.95, 1.0)",
            "the estimates stop at 0 and 1, and a softmax of these is far from decided",
        ),
        Wrong(
            "limits = (0.731, 0.95, 0.731)",
            "preferences are not estimates of values: nothing keeps them 1 apart",
        ),
        Wrong("limits = (0.731, 0.9, 1.0)", "half of the exploring pulls go to the better arm, too"),
        Wrong("limits = (0.731, 1.0, 1.0)", "an epsilon that stays at 0.1 never stops exploring"),
        Wrong("limits = (0.269, 0.05, 0.0)", "these are the probabilities of the worse arm"),
    ),
    minutes=4,
    digits=4,
    covers=("cl-100", "cl-101", "om-softmax"),
)


# ---------------------------------------------------------------------- policy gradients


def _division():
    p, r = np.array([0.9, 0.1]), np.array([1.0, 1.2])
    scores = np.eye(2) - p
    return (p * r) @ scores, (p * p * r) @ scores


Exercise(
    id="ch07-division",
    kind="by hand",
    tier="more",
    section="From the theorem to an episode",
    title="Why divide by the probability?",
    statement=r"""
        A bandit has two arms. The first pays 1, the second 1.2; a softmax policy with two preferences pulls them with probability 0.9 and
        0.1. REINFORCE moves the preferences by $\alpha G \nabla \pi(a) / \pi(a)$. Compute the expected direction (without $\alpha$), an array of two numbers, once with this update and
        once with the division left out. Bind the tuple of the two arrays to `division`. Towards which arm does each go?
    """,
    stub="division = ...",
    cases=lambda rng: [Case({}, _division(), tol=1e-4)],
    hints=(
        r"$\nabla \pi(a) / \pi(a)$ is the score: $(0.1, -0.1)$ for the first arm, $(-0.9, 0.9)$ for the second.",
        r"The expectation weights each arm with its probability. Without the division the arm's update has a further factor $\pi(a)$.",
    ),
    solution="""
        p, r = np.array([0.9, 0.1]), np.array([1, 1.2])
        scores = np.eye(2) - p
        division = ((p * r) @ scores, (p * p * r) @ scores)
    """,
    wrong=(
        Wrong(
            {"(p * r) @ scores, (p * p * r) @ scores": "(p * p * r) @ scores, (p * r) @ scores"},
            "the two are swapped: with the division the better arm wins, although it is rarely pulled",
        ),
        Wrong(
            {"(p * r) @ scores, (p * p * r) @ scores": "r @ scores, (p * r) @ scores"},
            "this adds up over the arms without their probabilities: the first arm is pulled nine times as often",
        ),
        Wrong(
            {"np.eye(2) - p": "p - np.eye(2)"},
            "the sign is turned round: the preference of the arm that was pulled grows with its reward",
        ),
        Wrong({"np.eye(2) - p": "np.eye(2)"}, "the score of each arm also lowers the preference of the other one"),
        Wrong(
            {"(p * p * r) @ scores": "(p * r) @ scores"},
            "both are with the division: without it each update has a further factor pi(a)",
        ),
    ),
    minutes=8,
    covers=("fig-51", "eq-u-reinforce", "cl-105", "cl-099"),
)


Exercise(
    id="ch07-gamma-by-hand",
    kind="by hand",
    tier="core",
    section="The algorithm",
    title="The factor that the box leaves out",
    statement=r"""
        There is one state and two actions with equal preferences. An episode takes the actions 0, 1, 1 and gets the rewards 1, 0, 8; $\gamma = 0.5$. Compute the returns ({eq}`eq-rf-38`), and from them the estimate of the gradient with respect to the
        preference of action 0: first as the box of figure 52 has it, then with the factor $\gamma^t$ that the discounted objective ({eq}`eq-rf-39`)
        asks for. Bind the tuple of the two numbers to `two_estimates`.
    """,
    stub="two_estimates = ...",
    cases=lambda rng: [
        Case(
            {},
            tuple(
                float(
                    episode_gradient(np.zeros((2, 1)), [0, 0, 0], [0, 1, 1], [1, 0, 8], 0.5, discount_states=with_it)[
                        0, 0
                    ]
                )
                for with_it in (False, True)
            ),
        )
    ],
    hints=(
        "Go backward: the last return is 8, the one before $0 + 0.5 \\cdot 8$, and so on.",
        "The score of the preference of action 0 is 0.5 where action 0 was taken, and -0.5 where action 1 was.",
    ),
    solution="""
        G = np.array([3, 4, 8])
        scores = np.array([0.5, -0.5, -0.5])
        two_estimates = (float(G @ scores), float(G * 0.5 ** np.arange(3) @ scores))
    """,
    wrong=(
        Wrong("two_estimates = (-0.5, -4.5)", "the two are swapped: the factor makes late steps count less"),
        Wrong(
            "two_estimates = (-1.5, 0.375)",
            "every step is credited with the return of the whole episode, 3: only the rewards that follow it count",
        ),
        Wrong("two_estimates = (4.5, 0.5)", "this is the preference of action 1; that of action 0 falls"),
        Wrong("two_estimates = (-3.5, 1.5)", "the returns are not discounted: they are 3, 4 and 8"),
        Wrong("two_estimates = (3.0, 3.0)", "the score lacks the probability: it is -0.5 where action 1 was taken"),
        Wrong(
            "two_estimates = (-3.5, -0.5)",
            "these steps are credited with their own reward only: what follows is missing",
        ),
    ),
    minutes=8,
    covers=("eq-rf-38", "eq-rf-39", "eq-u-alg2-gradient", "fig-52"),
)


Exercise(
    id="ch07-theorem",
    kind="fill in",
    tier="deep",
    section="The theorem",
    title="The gradient without sampling",
    statement=r"""
        Figure 50 with nothing left to chance: every state has preferences of its own, `pi` `(S, A)` is their softmax, `Q` `(S, A)` holds the action values of this policy, and `visits` `(S,)` says how often, discounted, an episode is expected to be in each state. Return the gradient
        of the objective ({eq}`eq-rf-39`) with respect to the preferences, `(S, A)`. With these `visits` it is an equality; nothing is left of the constant of proportion.
    """,
    stub="""
        def policy_gradient(visits, pi, Q):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(visits=visits, pi=pi, Q=Q),
            visits[:, None] * np.array([q @ (np.diag(p) - np.outer(p, p)) for p, q in zip(pi, Q)]),
        )
        for S, A in ((3, 2), (2, 4), (3, 3))
        for visits, pi, Q in [
            (rng.integers(1, 9, S) / 2, rng.dirichlet(np.ones(A), S).round(2), rng.normal(size=(S, A)).round(1))
        ]
        for pi in [pi / pi.sum(axis=1, keepdims=True)]
    ],
    hints=(
        r"The gradient of $\pi(a)$ with respect to the preference for $b$ is $\pi(a) (1_{a = b} - \pi(b))$. Sum it over $a$ with the weights $q(a)$.",
        r"What comes out for each $b$ is $\pi(b) (q(b) - v)$, where $v = \sum_a \pi(a) q(a)$ is the value of the state.",
    ),
    solution="""
        def policy_gradient(visits, pi, Q):
            V = (pi * Q).sum(axis=1, keepdims=True)
            return visits[:, None] * pi * (Q - V)
    """,
    wrong=(
        Wrong(
            {"    V = (pi * Q).sum(axis=1, keepdims=True)\n": "", "(Q - V)": "Q"},
            "the value of the state is missing: when one preference grows, the probabilities of all the others fall",
        ),
        Wrong(
            {" * pi": ""},
            "the probability is missing: a preference matters in proportion to the probability of its action",
        ),
        Wrong({"visits[:, None] * ": ""}, "the states count alike: weight each with its visits"),
        Wrong(
            {"visits[:, None]": "(visits / visits.sum())[:, None]"},
            "this is proportional to the gradient only: the visits are counts, and must not be scaled to sum to 1",
        ),
        Wrong(
            {"(pi * Q).sum": "Q.mean"},
            "the value of a state weights each action value with the probability of the action",
        ),
    ),
    minutes=10,
    covers=("eq-u-pg-theorem", "fig-50", "alg-policy-gradient-exact", "eq-rf-39"),
)


FORWARD = """
            def reinforce_gradient(theta, states, actions, rewards, gamma):
                g = np.zeros_like(theta)
                for t, (s, a) in enumerate(zip(states, actions)):
                    G = WHICH
                    p = np.exp(theta[:, s] - theta[:, s].max())
                    g[:, s] += G * (np.eye(len(p))[a] - p / p.sum())
                return g
"""

Exercise(
    id="ch07-episode-gradient",
    kind="fill in",
    tier="core",
    section="The algorithm",
    title="One episode of REINFORCE",
    statement=r"""
        Lines 4 to 9 of the box of figure 52. `theta[a, s]` is the preference for action `a` in state `s`; `states`, `actions` and `rewards` are arrays of the same length, and `rewards[t]` follows
        `actions[t]`. Add up the return from `t` on ({eq}`eq-rf-38`) times the gradient of $\ln \pi(a_t | s_t)$ over the episode, without a factor $\gamma^t$, and return the sum, an array like `theta`.
    """,
    stub="""
        def reinforce_gradient(theta, states, actions, rewards, gamma):
            g = np.zeros_like(theta)
            ...
            return g
    """,
    cases=lambda rng: [
        Case(g, episode_gradient(**g))
        for A, S, T, gamma in ((2, 3, 4, 0.9), (3, 2, 5, 0.5), (2, 2, 3, 1.0))
        for g in [
            dict(
                theta=rng.normal(size=(A, S)).round(1),
                states=rng.integers(S, size=T),
                actions=rng.integers(A, size=T),
                rewards=rng.normal(size=T).round(1),
                gamma=gamma,
            )
        ]
    ],
    hints=(
        "Go backward through the episode: `G = r + gamma * G` gives each return from the one after it.",
        "Only the column `theta[:, s]` of the state matters: its score is `np.eye(A)[a] - p`.",
    ),
    solution="""
        def reinforce_gradient(theta, states, actions, rewards, gamma):
            g, G = np.zeros_like(theta), 0.0
            for s, a, r in zip(states[::-1], actions[::-1], rewards[::-1]):
                G = r + gamma * G
                p = np.exp(theta[:, s] - theta[:, s].max())
                g[:, s] += G * (np.eye(len(p))[a] - p / p.sum())
            return g
    """,
    wrong=(
        Wrong(
            FORWARD.replace("WHICH", "rewards @ gamma ** np.arange(len(rewards))"),
            "every action is credited with the return of the whole episode: use the return from t on, the reward to go",
        ),
        Wrong(
            FORWARD.replace("WHICH", "gamma**t * (rewards[t:] @ gamma ** np.arange(len(rewards) - t))"),
            "the factor gamma^t of the theorem is in it: the box, as asked for here, leaves it out",
        ),
        Wrong(
            FORWARD.replace("WHICH", "rewards[t]"),
            "each action is credited with its next reward only: add what follows",
        ),
        Wrong(
            FORWARD.replace("WHICH", "rewards[t:].sum()"),
            "the rewards that follow are not discounted",
        ),
        Wrong(
            FORWARD.replace("WHICH", "rewards[: t + 1] @ gamma ** np.arange(t + 1)"),
            "these are the rewards up to t: an action can only be credited with what comes after it",
        ),
        Wrong(
            {"- p / p.sum())": ")"},
            "the score lacks the probabilities: the other actions' preferences have to move, too",
        ),
        Wrong(
            {"g[:, s] +=": "g[:, s] ="}, "a state that is visited again overwrites what its other visits gave: add up"
        ),
    ),
    minutes=12,
    covers=("alg-reinforce", "fig-52", "eq-rf-38", "eq-u-alg2-return", "eq-u-alg2-gradient"),
)


Exercise(
    id="ch07-bug-baseline",
    kind="find the bug",
    tier="more",
    section="Baselines",
    title="A baseline that knows too much",
    statement=r"""
        A policy gradient for a bandit with a baseline: `h` holds the preferences, `q_hat` the estimated values of the arms, `a` and `r` are the arm pulled and its reward. The baseline should be
        the value of the policy, and then it leaves the expected update as it was. In this program the variance is small, but the policy hardly learns: as the estimates get better, the
        expected update vanishes. Find the line and mend it.
    """,
    stub="""
        def bandit_step(h, q_hat, a, r, alpha):
            p = np.exp(h - h.max())
            p = p / p.sum()
            b = q_hat[a]
            return h + alpha * (r - b) * (np.eye(len(p))[a] - p)
    """,
    cases=lambda rng: [
        Case(dict(h=h, q_hat=q, a=a, r=r, alpha=alpha), h + alpha * (r - softmax(h) @ q) * (np.eye(n)[a] - softmax(h)))
        for n, a, r, alpha in ((3, 1, 1.5, 0.1), (2, 0, -0.5, 0.5), (4, 3, 2.0, 0.2))
        for h, q in [(rng.normal(size=n).round(1), rng.normal(size=n).round(1))]
    ],
    hints=(
        "Which of the four lines asks for the arm that was pulled? Which of them may?",
        "The value of the policy is the mean of the values of the arms, each weighted with its probability.",
    ),
    solution="""
        def bandit_step(h, q_hat, a, r, alpha):
            p = np.exp(h - h.max())
            p = p / p.sum()
            b = p @ q_hat
            return h + alpha * (r - b) * (np.eye(len(p))[a] - p)
    """,
    wrong=(
        Wrong(
            {"p @ q_hat": "q_hat.max()"}, "this adds no bias, but it is the value of the best arm, not of the policy"
        ),
        Wrong(
            {"p @ q_hat": "q_hat.mean()"},
            "this adds no bias, but it is the value of pulling all arms equally often, not of the policy",
        ),
        Wrong({"p @ q_hat": "p[a] * q_hat[a]"}, "the baseline still depends on the arm: add up over all arms"),
        Wrong({"p @ q_hat": "0.0"}, "without a baseline there is no bias either, but all the variance is back"),
        Wrong(
            {"p @ q_hat": "q_hat[a]", "[a] - p)": "[a])"}, "the score was right: the baseline still depends on the arm"
        ),
    ),
    minutes=8,
    covers=("eq-u-baseline-zero", "eq-u-reinforce-baseline", "cl-110"),
)


Exercise(
    id="ch07-bug-order",
    kind="find the bug",
    tier="core",
    section="The algorithm",
    title="The faster it learns, the slower it learns",
    statement=r"""
        REINFORCE with a learned baseline, where there is one state: `h` holds the preferences, the number `w` is the baseline, `a` the action and `G` the return. Both learn from the
        difference between the return and what was expected **before** it came. In this program the policy learns the more slowly, the larger the step size of the baseline is, and with
        `alpha_w = 1` not at all. Mend it, and return the new `h` and the new `w`.
    """,
    stub="""
        def step_both(h, w, a, G, alpha, alpha_w):
            w = w + alpha_w * (G - w)
            delta = G - w
            p = np.exp(h - h.max())
            p = p / p.sum()
            return h + alpha * delta * (np.eye(len(p))[a] - p), w
    """,
    cases=lambda rng: [
        Case(
            dict(h=h, w=w, a=a, G=G, alpha=alpha, alpha_w=alpha_w),
            (h + alpha * (G - w) * Categorical(h).grad_log_prob(a), w + alpha_w * (G - w)),
        )
        for n, w, a, G, alpha, alpha_w in (
            (2, 1.0, 0, 3.0, 0.1, 0.5),
            (3, -2.0, 2, -5.0, 0.2, 1.0),
            (4, 0.5, 1, 2.0, 0.5, 0.1),
        )
        for h in [rng.normal(size=n).round(1)]
    ],
    hints=(
        "What is `delta` where `alpha_w = 1`? Which `w` should it be taken from?",
        "After the first line `w` already contains a part of the return, and so of the action: take the difference first.",
    ),
    solution="""
        def step_both(h, w, a, G, alpha, alpha_w):
            delta = G - w
            w = w + alpha_w * delta
            p = np.exp(h - h.max())
            p = p / p.sum()
            return h + alpha * delta * (np.eye(len(p))[a] - p), w
    """,
    wrong=(
        Wrong(
            {"w = w + alpha_w * delta": "pass"},
            "the baseline does not learn any more: it has to move towards the return, only after the difference is taken",
        ),
        Wrong({"alpha_w * delta": "alpha * delta"}, "the baseline moves with the step size of the policy"),
        Wrong(
            {"delta = G - w": "delta = w - G", "w + alpha_w": "w - alpha_w"},
            "the sign of the policy's step is turned round, and it goes downhill",
        ),
        Wrong(
            {"h + alpha * delta": "h + alpha * (1 - alpha_w) * delta"},
            "this is the old behaviour in other words: the difference shrinks with the step size of the baseline",
        ),
        Wrong({"h + alpha * delta": "h + alpha * G"}, "the baseline learns, but the policy no longer subtracts it"),
    ),
    minutes=6,
    covers=("alg-reinforce-baseline", "om-baseline-update", "eq-u-reinforce-baseline"),
)


Exercise(
    id="ch07-critic-error",
    kind="fill in",
    tier="core",
    section="Actor-critic",
    title="What the critic says",
    statement=r"""
        A one-step actor-critic learns after each step from $\delta = r + \gamma \hat v(s') - \hat v(s)$. All arguments but `gamma` are arrays with a step each: `v` and `v_next` hold $\hat v(s)$ and $\hat v(s')$, whatever
        the network says, even of a state in which the episode ended. `terminated` and `truncated` are truth values: nothing follows a terminal state, but an episode that was only cut by a time limit would have gone on. Return the errors.
    """,
    stub="""
        def critic_error(v, v_next, r, gamma, terminated, truncated):
            ...
    """,
    cases=lambda rng: [
        Case(g, g["r"] + gamma * g["v_next"] * ~g["terminated"] - g["v"])
        for gamma, ends, cuts in (
            (0.9, (False, True, False), (False, False, True)),
            (0.5, (False, False, True), (False, True, True)),
            (0.99, (True, False, False), (False, False, True)),
        )
        for g in [
            dict(
                v=rng.normal(size=3).round(1) + 2,
                v_next=rng.normal(size=3).round(1) + 2.05,
                r=rng.normal(size=3).round(1),
                gamma=gamma,
                terminated=np.array(ends),
                truncated=np.array(cuts),
            )
        ]
    ],
    hints=(
        r"Where the episode has terminated, $\hat v(s')$ counts as 0.",
        "`~terminated` is 1 where the episode goes on, and it multiplies `v_next`. What is `truncated` good for here?",
    ),
    solution="""
        def critic_error(v, v_next, r, gamma, terminated, truncated):
            return r + gamma * v_next * ~terminated - v
    """,
    wrong=(
        Wrong(
            {" * ~terminated": ""}, "what the network says of a terminal state still counts: mask it with terminated"
        ),
        Wrong(
            {"~terminated": "~(terminated | truncated)"},
            "a truncated episode would have gone on: its last state keeps its value",
        ),
        Wrong(
            {"~terminated": "~truncated"},
            "the wrong ending is masked: terminated, not truncated, means that nothing follows",
        ),
        Wrong(
            {"r + gamma * v_next * ~terminated - v": "(r + gamma * v_next - v) * ~terminated"},
            "the whole error is masked: the last reward is the most certain news of all",
        ),
        Wrong({" - v": ""}, "this is the target: subtract what was expected, the value of the state"),
        Wrong(
            {"r + gamma * v_next * ~terminated - v": "v - r - gamma * v_next * ~terminated"},
            "the sign is turned round: an outcome better than expected is positive",
        ),
        Wrong({"gamma * v_next": "v_next"}, "the discount factor is missing"),
    ),
    minutes=5,
    covers=("alg-actor-critic", "om-baseline-update", "cl-112"),
)


# ---------------------------------------------------------------------- stochastic optimal policies


@cache
def _corridor_values():
    best = 2 - np.sqrt(2)
    theta = [np.array([[0.0], [np.log(p / (1 - p))]]) for p in (0.5, best)]
    half, top = (objective(short_corridor(), t, 1.0, features=np.ones((4, 1))) for t in theta)
    return half, float(best), top


Exercise(
    id="ch07-corridor-value",
    kind="by hand",
    tier="deep",
    section="States that look alike",
    title="The short corridor",
    statement=r"""
        Three cells in a row, 0, 1, 2, then the end; each step costs 1, and $\gamma = 1$. From cell 0 left stays and right goes to cell 1. In cell 1 the two actions are confused: left goes to cell 2,
        right back to cell 0. From cell 2 left goes to cell 1, and right to the end. The policy cannot tell the cells apart and goes right with probability $p$. Write down the three Bellman equations, solve them for the value of cell 0, and bind `corridor` to the
        tuple of the value at $p = 0.5$, the best $p$, and the value there ({eq}`eq-rf-39`).
    """,
    stub="corridor = ...",
    cases=lambda rng: [Case({}, _corridor_values())],
    hints=(
        "$v_0 = -1 + (1 - p) v_0 + p v_1$, $v_1 = -1 + (1 - p) v_2 + p v_0$, $v_2 = -1 + (1 - p) v_1$.",
        r"$v_0 = -(4 - 2p) / (p (1 - p))$. Its derivative is 0 where $p^2 - 4 p + 2 = 0$.",
    ),
    solution="""
        p = 2 - np.sqrt(2)
        corridor = (-12, float(p), float(-(4 - 2 * p) / (p * (1 - p))))
    """,
    wrong=(
        Wrong("corridor = (-12, 0.5, -12)", "the cells are not symmetric: going right a little more often is better"),
        Wrong(
            "corridor = (-12, 1.0, -3.0)",
            "3 steps need other actions in cell 1 than elsewhere: always going right, this policy never leaves cells 0 and 1",
        ),
        Wrong("corridor = (-12, 0.4142, -11.657)", "this is the probability of going left"),
        Wrong(
            "corridor = (12, 0.5858, 11.657)", "these are the steps that it takes: each costs 1, so values are negative"
        ),
        Wrong(
            "corridor = (-10, 0.5858, -9.950)",
            "this is the value of cell 1: the episode starts in cell 0",
        ),
    ),
    minutes=12,
    digits=4,
    covers=("ex-corridor", "fig-53", "eq-rf-39", "cl-102", "cl-108"),
)


Exercise(
    id="ch07-bluff",
    kind="by hand",
    tier="deep",
    section="An opponent who looks on",
    title="How often to bluff",
    statement=r"""
        The pot holds 2. Half of the time you have the better hand, and then you bet 1. With the worse hand you either bet too, a bluff, with probability $x$, or give the pot up and gain 0. The other
        player sees your bet, not your hand, and calls with probability $y$. You gain 2 if nobody calls, 3 if you are called with the better hand, and $-1$ if a bluff is called. Which $x$ gains
        most against a caller who always answers with what is best against you, and how much does it gain? Bind the two numbers to `best_bluff`.
    """,
    stub="best_bluff = ...",
    cases=lambda rng: [Case({}, (1 / 3, float(bluff_guarantee(1 / 3))))],
    hints=(
        "Against $y = 0$ you gain $1 + x$, against $y = 1$ you gain $(3 - x) / 2$. The other player picks the smaller one.",
        "One line rises with $x$, the other falls: the best is where they cross.",
    ),
    solution="best_bluff = (1 / 3, 4 / 3)",
    wrong=(
        Wrong("best_bluff = (0, 1)", "who never bluffs is never called, and gains 1; a few bluffs gain more"),
        Wrong("best_bluff = (1, 1)", "who always bluffs is always called, and gains 1: bluff less often"),
        Wrong(
            "best_bluff = (0.5, 1.25)", "half of the bluffs is too many: a caller who always calls holds you to 1.25"
        ),
        Wrong(
            "best_bluff = (2 / 3, 4 / 3)", "2/3 is how often the other player calls; with so many bluffs you gain 7/6"
        ),
        Wrong("best_bluff = (1, 2)", "you gain 2 only from a caller who never calls: this one answers your bluffs"),
    ),
    minutes=8,
    digits=4,
    covers=("ex-bluff", "cl-102"),
)


def _corridor(n, confused):
    outcomes = {}
    for s in range(n):
        back, on = max(s - 1, 0), s + 1
        for a, s_next in enumerate((on, back) if s in confused else (back, on)):
            outcomes[s, a] = [(1.0, s_next, -1.0)]
    return FiniteMDP.from_outcomes(outcomes, start=0)


Exercise(
    id="ch07-build-corridor",
    kind="build",
    tier="more",
    section="States that look alike",
    title="A corridor that confuses",
    statement=r"""
        Build the short corridor with any number of cells. Cells 0 to `n - 1` stand in a row, and cell `n` is the end. Action 0, left, leads to the cell before (from cell 0: nowhere, it stays), action 1, right, to the next one. In the cells of the tuple `confused` the two are exchanged. Each step
        costs 1; the start is cell 0. Return the `FiniteMDP`. With `n = 3` and `confused = (1,)` it is the corridor of figure 53.
    """,
    setup="import numpy as np\nfrom rlcore.mdp import FiniteMDP",
    stub="""
        def confusing_corridor(n, confused):
            outcomes = {}
            ...
            return FiniteMDP.from_outcomes(outcomes, start=0)
    """,
    cases=lambda rng: [
        Case(dict(n=3, confused=(1,)), short_corridor()),
        Case(dict(n=5, confused=(0, 3)), _corridor(5, (0, 3))),
        Case(dict(n=2, confused=()), _corridor(2, ())),
    ],
    hints=(
        "`outcomes[s, a]` is a list of `(probability, next state, reward)`, here with one entry; a state without outcomes is terminal.",
        "The two next states are `max(s - 1, 0)` and `s + 1`; in a confused cell they change places.",
    ),
    solution="""
        def confusing_corridor(n, confused):
            outcomes = {}
            for s in range(n):
                back, on = max(s - 1, 0), s + 1
                moves = (on, back) if s in confused else (back, on)
                for a in (0, 1):
                    outcomes[s, a] = [(1.0, moves[a], -1.0)]
            return FiniteMDP.from_outcomes(outcomes, start=0)
    """,
    wrong=(
        Wrong(
            {"(on, back) if s in confused else (back, on)": "(back, on)"},
            "no cell is confused: exchange the two actions in the cells of the tuple",
        ),
        Wrong(
            {"(on, back) if s in confused else (back, on)": "(back, on) if s in confused else (on, back)"},
            "the wrong cells are confused: right leads on everywhere but in the cells of the tuple",
        ),
        Wrong({"max(s - 1, 0)": "(s - 1) % n"}, "going left from cell 0 comes out at the other end: it should stay"),
        Wrong(
            {"-1.0)]": "float(moves[a] == n))]"},
            "the end pays 1 and the steps cost nothing: at gamma = 1 every policy that arrives would be as good as any other",
        ),
        Wrong({"-1.0)]": "-float(moves[a] != n))]"}, "the step into the end is free: every step costs 1"),
        Wrong(
            {"s in confused": "s + 1 in confused"},
            "the cell before each confused one is exchanged: the cells are counted from 0",
        ),
    ),
    minutes=12,
    covers=("ex-corridor", "fig-53"),
)


# ---------------------------------------------------------------------- claims


LIBRARY = "import numpy as np\nfrom rlcore.envs import short_corridor\n"


@cache
def _baseline_numbers():
    g0, g1 = (
        gradient_estimates(
            short_corridor(), np.zeros((2, 1)), 1.0, 20_000, features=np.ones((4, 1)), baseline=b,
            rng=np.random.default_rng(0),
        )[:, 1, 0]
        for b in (0.0, -12.0)
    )  # fmt: skip
    return float(g0.mean()), float(g1.mean()), float(g1.var() / g0.var())


Exercise(
    id="ch07-claim-baseline",
    kind="experiment",
    tier="deep",
    section="Baselines",
    title="Does a baseline change the direction?",
    statement=r"""
        *A baseline leaves the expected update unchanged.* Measure it in the short corridor with a policy that cannot tell the cells apart: `gradient_estimates(short_corridor(), theta, 1.0, 20_000, features=x, baseline=b, rng=rng)`
        with `theta = np.zeros((2, 1))` and `x = np.ones((4, 1))` gives the estimates of 20,000 episodes, `(20_000, 2, 1)`. Do it for `b = 0.0` and for `b = -12.0`, the value of the start, each time with a new `np.random.default_rng(0)`, and look at the component of action 1, right. Bind
        `verdict_baseline` to `(word, mean_0, mean_b, ratio)`: the word; the two means; and the variance with the baseline divided by that without. For the word, subtract the two estimates of each episode (the same generator gives the same episodes). The means agree if the mean of these 20,000 differences is nearer to 0 than three times its standard error, their standard deviation divided by $\sqrt{20{,}000}$: then it is `"confirmed"`, else `"refuted"`.
    """,
    setup=LIBRARY + "from rlcore.policy_gradient import gradient_estimates",
    stub="verdict_baseline = ...",
    cases=lambda rng: [Case({}, ("confirmed", *_baseline_numbers()), tol=1e-6)],
    hints=(
        "`estimates[:, 1, 0]` is the component of action 1, one number an episode.",
        "The same generator gives the same episodes, so the difference can be taken episode by episode; its standard error is `difference.std() / np.sqrt(20_000)`.",
    ),
    solution="""
        theta, x = np.zeros((2, 1)), np.ones((4, 1))
        g = []
        for b in (0.0, -12.0):
            rng = np.random.default_rng(0)
            estimates = gradient_estimates(short_corridor(), theta, 1.0, 20_000, features=x, baseline=b, rng=rng)
            g.append(estimates[:, 1, 0])
        error = (g[1] - g[0]).std() / np.sqrt(20_000)
        word = "confirmed" if abs(g[1].mean() - g[0].mean()) < 3 * error else "refuted"
        verdict_baseline = (word, float(g[0].mean()), float(g[1].mean()), float(g[1].var() / g[0].var()))
    """,
    wrong=(
        Wrong(
            {'"confirmed" if abs(g[1].mean() - g[0].mean()) < 3 * error else "refuted"': '"refuted"'},
            "the numbers are right, but means of samples differ a little even where the expectations are the same: compare with the standard error",
        ),
        Wrong(
            {"g[1].var() / g[0].var()": "g[0].var() / g[1].var()"},
            "the ratio is upside down: the variance with the baseline belongs on top",
        ),
        Wrong(
            {"g[1].var() / g[0].var()": "g[1].std() / g[0].std()"},
            "this is the ratio of the standard deviations: the variance is their square",
        ),
        Wrong({"[:, 1, 0]": "[:, 0, 0]"}, "this is the component of action 0, left"),
        Wrong(
            {"(0.0, -12.0)": "(0.0, 12.0)"},
            "the value of the start is negative: with +12 the variance grows, though the mean stays",
        ),
    ),
    minutes=15,
    covers=("cl-110", "cl-111", "fig-54", "eq-u-reinforce-baseline"),
)


@cache
def _critic_numbers():
    theta, x, V = np.zeros((2, 1)), np.ones((4, 1)), np.array([-12.0, -12.0, -12.0, 0.0])
    exact = policy_gradient_exact(short_corridor(), theta, 1.0, features=x)[1, 0]
    actor_critic = policy_gradient_exact(short_corridor(), theta, 1.0, features=x, V=V)[1, 0]
    rng = np.random.default_rng(0)
    g = gradient_estimates(short_corridor(), theta, 1.0, 20_000, features=x, baseline=V, rng=rng)
    return float(exact), float(actor_critic), float(g[:, 1, 0].mean())


Exercise(
    id="ch07-claim-critic",
    kind="experiment",
    tier="deep",
    section="Actor-critic",
    title="Baseline or critic?",
    statement=r"""
        *REINFORCE with the baseline V(S, w) is an actor-critic.* If so, both would move the policy alike, also while V is wrong. Test it in the short corridor, with `theta = np.zeros((2, 1))`, `x = np.ones((4, 1))` and a V that knows the cells no better than the policy does, `V = np.array([-12.0, -12.0, -12.0, 0.0])`. All
        for the component of action 1, index `[1, 0]`: the exact gradient, `policy_gradient_exact(mdp, theta, 1.0, features=x)`; the mean direction of a one-step actor-critic, the same call with `V=V`; and the mean of 20,000 estimates of REINFORCE with the baseline,
        `gradient_estimates(mdp, theta, 1.0, 20_000, features=x, baseline=V, rng=np.random.default_rng(0))`. Bind `verdict_critic` to `(word, exact, critic, baseline)`: `"confirmed"` if the last two differ by less than 0.5, else `"refuted"`, and the three numbers.
    """,
    setup=LIBRARY + "from rlcore.policy_gradient import gradient_estimates, policy_gradient_exact",
    stub="verdict_critic = ...",
    cases=lambda rng: [Case({}, ("refuted", *_critic_numbers()), tol=1e-6)],
    hints=(
        "Predict first: as a baseline V is only subtracted from the true return; as a critic it also stands for all that comes after the next reward.",
        "`gradient_estimates` returns `(20_000, 2, 1)`: average over the episodes.",
    ),
    solution="""
        theta, x, V = np.zeros((2, 1)), np.ones((4, 1)), np.array([-12.0, -12.0, -12.0, 0.0])
        mdp, rng = short_corridor(), np.random.default_rng(0)
        exact = float(policy_gradient_exact(mdp, theta, 1.0, features=x)[1, 0])
        critic = float(policy_gradient_exact(mdp, theta, 1.0, features=x, V=V)[1, 0])
        g = gradient_estimates(mdp, theta, 1.0, 20_000, features=x, baseline=V, rng=rng)
        baseline = float(g[:, 1, 0].mean())
        word = "confirmed" if abs(critic - baseline) < 0.5 else "refuted"
        verdict_critic = (word, exact, critic, baseline)
    """,
    wrong=(
        Wrong(
            {'"confirmed" if abs(critic - baseline) < 0.5 else "refuted"': '"confirmed"'},
            "the numbers are right, and one is three times the other: the critic bootstraps, and its error becomes a bias",
        ),
        Wrong(
            {"(word, exact, critic, baseline)": "(word, exact, baseline, critic)"},
            "the last two are swapped: the baseline is the one that stays near the exact gradient",
        ),
        Wrong(
            {", V=V)": ")", "abs(critic - baseline) < 0.5": "False"},
            "V is missing in the second call: it gives the exact gradient once more",
        ),
        Wrong(
            {"x)[1, 0]": "x)[0, 0]", "V=V)[1, 0]": "V=V)[0, 0]", "[:, 1, 0]": "[:, 0, 0]"},
            "these are the components of action 0, left",
        ),
        Wrong(
            {"baseline=V, ": ""},
            "the baseline is missing in the last call: the mean is nearly the same, but it is not the algorithm in question",
        ),
    ),
    minutes=20,
    covers=("cl-112", "alg-actor-critic", "alg-reinforce-baseline", "om-baseline-update"),
)


PROOFS = (
    Proof(
        "The preferences keep their sum",
        r"""
        A softmax policy has a table of preferences $\theta(s, a)$. Show that REINFORCE, with any returns and any baseline,
        never changes $\sum_a \theta(s, a)$ in any state, and that for every probability distribution with positive
        probabilities there is exactly one set of preferences with a given sum.
        """,
        (
            "The score of the action taken: $1_{a = b} - \\pi(b)$ in the state of the step, 0 in all other states.",
            "Its sum over $b$ is $1 - 1 = 0$, and every update is a multiple of a score.",
            "Existence: logarithms of the probabilities, shifted by a constant to give the sum.",
            "Uniqueness: equal probabilities mean that all preferences differ by the same constant, and the sum fixes it.",
        ),
        r"""
        A step in state $s$ with action $a$ changes the preferences by a number times the gradient of $\ln \pi(a \mid s)$,
        whatever return, baseline and step size that number is made of. The component for $\theta(s, b)$ is
        $1_{a = b} - \pi(b \mid s)$; those of other states are 0. Summed over $b$: $1 - \sum_b \pi(b \mid s) = 1 - 1 = 0$. So each
        update leaves the sum of every state as it was, and so does any number of updates.

        Let $p$ be a distribution with $p_b > 0$ over $n$ actions, and $m$ the given sum. The preferences $\ln p_b + c$ have the softmax
        $e^c p_b / (e^c \sum_d p_d) = p_b$, and their sum is $m$ for $c = (m - \sum_b \ln p_b) / n$. If $\theta$ is any set of preferences with the
        softmax $p$, then $e^{\theta_b} = p_b Z$ with $Z = \sum_d e^{\theta_d}$, so $\theta_b = \ln p_b + \ln Z$: it has this form, with $c = \ln Z$, and
        the sum allows a single $c$. So the policy and the constant sum determine the table.
        """,
    ),
)


QUESTIONS = (
    Question(
        "Why does the gradient of the logarithm of the policy appear in REINFORCE?",
        (
            ("Logarithms are easier to compute", False, "They are, but plain probabilities would do for the computer."),
            (
                "It is the gradient of the probability divided by the probability",
                True,
                "The division makes up for frequent actions being sampled more often, so that the mean is the gradient.",
            ),
            ("It keeps the probabilities positive", False, "The softmax does that, whatever the gradient."),
        ),
    ),
    Question(
        "Which of these may a baseline depend on, if the expected update is to stay the same?",
        (
            ("The state", True, "Given the state it is a constant, and the mean of the score is 0."),
            ("The action", False, "Then it can no longer be taken out of the sum over the actions."),
            ("Nothing: it has to be a number", False, "Any function of the state will do; the value is a good one."),
        ),
    ),
    Question(
        "What makes an algorithm an actor-critic, rather than REINFORCE with a baseline?",
        (
            ("It learns a value function", False, "REINFORCE with a learned baseline does, too."),
            ("It has two networks", False, "Their number says nothing about how they are used."),
            (
                "The value of the next state replaces the rest of the return",
                True,
                "It bootstraps, and so can learn at every step, with less variance and, while the values are wrong, a bias.",
            ),
        ),
    ),
    Question(
        "When is the best policy of a class stochastic, though the environment is fully known?",
        (
            (
                "When states that need different actions look the same to it",
                True,
                "The short corridor is such a case; so is an opponent who adapts, as in poker.",
            ),
            ("Always", False, "With states that can be told apart some deterministic policy is as good as any."),
            ("When the rewards are random", False, "Only their means matter for the expected return."),
        ),
    ),
)
