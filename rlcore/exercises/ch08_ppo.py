"""Exercises of chapter 8: advantages, ratios and clipping, KL penalties, trust regions, PPO as a whole."""

from functools import cache

import numpy as np

from rlcore.distributions import Categorical, Gaussian
from rlcore.envs import recycling_robot
from rlcore.exercises.engine import Case, Exercise, Proof, Question, Wrong
from rlcore.gae import gae
from rlcore.neurons import softmax
from rlcore.ppo import PPOConfig, clip_gradient, objective_gradient
from rlcore.trpo import conjugate_gradient
from rlcore.trust_region import adapt_beta, eta, local_performance, lower_bound, mean_kl, old_policy

TITLE = "Exercises: trust regions and PPO"
NOTEBOOK = "08_ppo"
LABELS = {"build": "build a measure"}
SOFTMAX = "import numpy as np\nfrom rlcore.neurons import softmax"


# ---------------------------------------------------------------------- from labels to advantages


def _at(shape, *places):
    flags = np.zeros(shape, bool)
    for place in places:
        flags[place] = True
    return flags


Exercise(
    id="ch08-up-down",
    kind="fill in",
    tier="more",
    section="Outcomes",
    title="What the label says",
    statement=r"""
        A unit with the weights `w` sees the input `x`, and chooses UP with probability $p = \sigma(w \cdot x)$, else DOWN. The label of the example is `up`: 1 if UP is right, 0 if DOWN is. Return the
        gradient of the logarithm of the probability of the right answer with respect to `w`, an array like `w`. For UP it is that of {eq}`eq-ppo-40`.
    """,
    stub="""
        def log_prob_gradient(w, x, up):
            ...
    """,
    cases=lambda rng: [
        Case(dict(w=w, x=x, up=up), (up - 1 / (1 + np.exp(-(w @ x)))) * x)
        for n, up in ((3, 1), (3, 0), (2, 1), (4, 0))
        for w, x in [rng.normal(size=(2, n)).round(1)]
    ],
    hints=(
        r"The derivative of $\ln \sigma(z)$ is $1 - \sigma(z)$, that of $\ln (1 - \sigma(z))$ is $-\sigma(z)$; and $z = w \cdot x$.",
        "Both cases in one: the label minus the probability of UP, times the input.",
    ),
    solution="""
        def log_prob_gradient(w, x, up):
            p = 1 / (1 + np.exp(-(w @ x)))
            return (up - p) * x
    """,
    wrong=(
        Wrong({"(up - p)": "(1 - p)"}, "right for the label UP only: where DOWN is right, UP has to become rarer"),
        Wrong(
            {"(up - p)": "(p - up)"},
            "the sign is turned round: this is the gradient of the cost, and would make the right answer rarer",
        ),
        Wrong(
            {"(up - p)": "(2 * up - 1) * p * (1 - p)"},
            "this is the gradient of the probability: its logarithm divides it by the probability of the right answer",
        ),
        Wrong(
            {"(up - p)": "(2 * up - 1)"}, "the probability is missing: an answer that is already certain needs no push"
        ),
    ),
    minutes=4,
    covers=("eq-ppo-40", "fig-57", "ex-up-down", "alg-supervised-logprob"),
)


Exercise(
    id="ch08-gae",
    kind="fill in",
    tier="core",
    section="Generalised advantage estimation",
    title="Advantages, and where episodes end",
    statement=r"""
        A rollout of $T$ steps goes through several episodes. `values[t]` is $\hat v$ of the state of step $t$, `next_values[t]` that of the state which the step led to, also where the episode was over with it. `terminated[t]` says that this state is terminal, `truncated[t]` that the episode was cut there by a
        time limit. Return the generalised advantage estimates $\hat A_t = \sum_{l \ge 0} (\gamma \lambda)^l \delta_{t+l}$ with $\delta_t = R_{t+1} + \gamma \hat v(s_{t+1}) - \hat v(s_t)$, where the sum stops with the episode and a terminal state is worth 0; `rewards[t]` is $R_{t+1}$, the reward of step $t$.
    """,
    stub="""
        def advantages_of_steps(rewards, values, next_values, terminated, truncated, gamma, lam):
            A = np.zeros(len(rewards))
            ...
            return A
    """,
    cases=lambda rng: [
        Case(g, gae(**g))
        for ends, cuts, gamma, lam in (
            ((0, 1, 0, 0, 0), (0, 0, 0, 1, 0), 0.9, 0.8),
            ((0, 0, 1, 0, 0, 0), (1, 0, 0, 0, 0, 1), 0.5, 0.5),
            ((0, 0, 0, 1), (0, 1, 0, 0), 0.99, 0.95),
            ((0, 1, 0, 0), (0, 1, 0, 0), 0.9, 0.8),
        )
        for n in [len(ends)]
        for g in [
            dict(
                rewards=rng.normal(size=n).round(1),
                values=(rng.normal(size=n) + 2).round(1),
                next_values=(rng.normal(size=n) + 2).round(1),
                terminated=np.array(ends, bool),
                truncated=np.array(cuts, bool),
                gamma=gamma,
                lam=lam,
            )
        ]
    ],
    hints=(
        r"Go backward: $\hat A_t = \delta_t + \gamma \lambda \hat A_{t+1}$, and after the last step there is nothing.",
        "`(not terminated[t])` multiplies the next value; `(not (terminated[t] or truncated[t]))` multiplies what is carried over from the next step.",
    ),
    solution="""
        def advantages_of_steps(rewards, values, next_values, terminated, truncated, gamma, lam):
            A, last = np.zeros(len(rewards)), 0.0
            for t in reversed(range(len(rewards))):
                delta = rewards[t] + gamma * next_values[t] * (not terminated[t]) - values[t]
                last = delta + gamma * lam * (not (terminated[t] or truncated[t])) * last
                A[t] = last
            return A
    """,
    wrong=(
        Wrong(
            {"next_values[t] * (not terminated[t])": "next_values[t]"},
            "what the network says of a terminal state still counts: nothing follows it, so it is worth 0",
        ),
        Wrong(
            {"next_values[t] * (not terminated[t])": "next_values[t] * (not (terminated[t] or truncated[t]))"},
            "truncation is taken for termination: an episode that was only cut would have gone on, so its last state keeps its value",
        ),
        Wrong(
            {" * (not (terminated[t] or truncated[t]))": ""},
            "the sum runs on into the next episode: stop it where the episode terminated or was cut",
        ),
        Wrong(
            {"(not (terminated[t] or truncated[t]))": "(not terminated[t])"},
            "the sum runs on where an episode was cut: the next step belongs to another episode",
        ),
        Wrong(
            {"gamma * lam *": "gamma *"}, "lambda is missing: this is the return minus the value, as with lambda = 1"
        ),
        Wrong({"gamma * lam *": "lam *"}, "the factor between two steps is gamma times lambda, not lambda alone"),
        Wrong(
            {"return A": "return A + values"},
            "these are the targets of the value network, the lambda-returns: the advantage is that minus the value",
        ),
        Wrong(
            {"last = delta + gamma * lam * (not (terminated[t] or truncated[t])) * last": "last = delta"},
            "these are the errors of single steps, as with lambda = 0: add up those that follow",
        ),
    ),
    minutes=12,
    covers=("om-gae", "alg-gae", "eq-ppo-42"),
)


Exercise(
    id="ch08-two-endings",
    kind="by hand",
    tier="core",
    section="Generalised advantage estimation",
    title="Dead, or out of time?",
    statement=r"""
        An episode of three steps gets the rewards 1, 0, 2. The network says 2, 1, 4 of the three states in which they were taken, and 4 of the state after the last step. $\gamma = \lambda = 0.5$. Work out the three advantages,
        first if that last state is terminal, then if a time limit cut the episode there. Bind the tuple of the two arrays to `two_endings`.
    """,
    stub="two_endings = ...",
    cases=lambda rng: [
        Case(
            {},
            tuple(
                gae([1.0, 0, 2], [2.0, 1, 4], [1.0, 4, 4], [0, 0, not cut], [0, 0, cut], 0.5, 0.5)
                for cut in (False, True)
            ),
        )
    ],
    hints=(
        r"The errors are $1 + 0.5 \cdot 1 - 2$, $0 + 0.5 \cdot 4 - 1$, and in the last step $2 - 4$ or $2 + 0.5 \cdot 4 - 4$.",
        r"Go backward: each advantage is the error plus $\gamma \lambda = 0.25$ times the next advantage.",
    ),
    solution="two_endings = (np.array([-0.375, 0.5, -2.0]), np.array([-0.25, 1.0, 0.0]))",
    wrong=(
        Wrong(
            "two_endings = (np.array([-0.25, 1.0, 0.0]), np.array([-0.375, 0.5, -2.0]))",
            "the two are swapped: the terminal state is worth 0, the one where the episode was cut keeps its value",
        ),
        Wrong(
            "two_endings = (np.array([-0.375, 0.5, -2.0]), np.array([-0.375, 0.5, -2.0]))",
            "truncation is taken for termination: after the cut the episode would have gone on",
        ),
        Wrong(
            "two_endings = (np.array([-0.5, 1.0, -2.0]), np.array([-0.5, 1.0, 0.0]))",
            "these are the errors: each advantage adds a part of those that follow",
        ),
        Wrong(
            "two_endings = (np.array([-0.5, 0.0, -2.0]), np.array([0.0, 1.0, 0.0]))",
            "lambda is missing: the factor from step to step is gamma times lambda, 0.25",
        ),
        Wrong(
            "two_endings = (np.array([1.625, 1.5, 2.0]), np.array([1.75, 2.0, 4.0]))",
            "these are the targets of the value network: subtract the values",
        ),
    ),
    minutes=8,
    covers=("om-gae", "alg-gae", "eq-ppo-42"),
)


Exercise(
    id="ch08-bug-time-limit",
    kind="find the bug",
    tier="more",
    section="Generalised advantage estimation",
    title="A time limit that looks like death",
    statement=r"""
        HalfCheetah never falls: each of its episodes is cut after 1000 steps. This program tells the value network, once in 1000 steps, that nothing follows, in a state like all the others, and running seems to be worth less than it is. `rewards`, `terminated` and `truncated` are `(T, N)`, for $N$ environments side by side, and `values` is `(T + 1, N)`, with the state that step $t$ led to in row $t + 1$. Mend the program.
    """,
    stub="""
        def advantages_of_rollout(rewards, values, terminated, truncated, gamma, lam):
            A, last = np.zeros(rewards.shape), 0.0
            done = terminated | truncated
            for t in reversed(range(len(rewards))):
                delta = rewards[t] + gamma * values[t + 1] * ~done[t] - values[t]
                last = delta + gamma * lam * ~done[t] * last
                A[t] = last
            return A
    """,
    cases=lambda rng: [
        Case(g, gae(g["rewards"], v[:-1], v[1:], g["terminated"], g["truncated"], gamma, lam))
        for T, N, end, cut, gamma, lam in (
            (4, 2, (0, 1), (1, 0), 0.9, 0.8),
            (5, 3, (3, 0), (1, 2), 0.99, 0.95),
            (3, 2, (1, 1), (2, 0), 0.5, 0.5),
            (4, 2, (1, 0), (1, 0), 0.9, 0.8),
        )
        for v in [(rng.normal(size=(T + 1, N)) + 2).round(1)]
        for g in [
            dict(
                rewards=rng.normal(size=(T, N)).round(1),
                values=v,
                terminated=_at((T, N), end),
                truncated=_at((T, N), cut),
                gamma=gamma,
                lam=lam,
            )
        ]
    ],
    hints=(
        "`done` stands in two lines. In which one does it matter whether the state has a future, and in which one only whether the next row belongs to the same episode?",
        "The value of the next state is masked by `terminated` alone; the sum stops at either ending.",
    ),
    solution="""
        def advantages_of_rollout(rewards, values, terminated, truncated, gamma, lam):
            A, last = np.zeros(rewards.shape), 0.0
            done = terminated | truncated
            for t in reversed(range(len(rewards))):
                delta = rewards[t] + gamma * values[t + 1] * ~terminated[t] - values[t]
                last = delta + gamma * lam * ~done[t] * last
                A[t] = last
            return A
    """,
    wrong=(
        Wrong(
            {"~done[t]": "~terminated[t]"},
            "now the advantages of the next episode flow back over the cut: there the sum has to stop",
        ),
        Wrong(
            {"~terminated[t]": "(1 - done[t])", "~done[t]": "~terminated[t]"},
            "the other line was right: the two masks are exchanged",
        ),
        Wrong(
            {"~terminated[t]": "~truncated[t]"}, "the wrong ending is masked: it is the terminal state that is worth 0"
        ),
        Wrong(
            {" * ~terminated[t]": ""}, "now nothing is masked: what the network says of a terminal state must not count"
        ),
    ),
    minutes=6,
    covers=("om-gae", "alg-gae", "om-ppo-box"),
)


Exercise(
    id="ch08-bug-axis",
    kind="find the bug",
    tier="core",
    section="Generalised advantage estimation",
    title="Everybody is above average",
    statement=r"""
        Before the epochs PPO centres and scales the advantages of the whole rollout: `advantages` is `(T, N)`, for $T$ steps of $N$ environments. With this program
        an environment in which everything went better than expected learns nothing from that, and about half of its actions become rarer. Mend it.
    """,
    stub="""
        def normalise(advantages):
            centred = advantages - advantages.mean(axis=0)
            return centred / (advantages.std(axis=0) + 1e-8)
    """,
    cases=lambda rng: (
        [
            Case(dict(advantages=A), (A - A.mean()) / (A.std() + 1e-8))
            for T, N in ((4, 2), (3, 3), (5, 4))
            for A in [(rng.normal(size=(T, N)) + 2 * np.arange(N)).round(1)]
        ]
        + [Case(dict(advantages=A), (A - A.mean()) / (A.std() + 1e-8)) for A in (np.ones((2, 2)), 1e-8 * np.eye(3))]
    ),
    hints=(
        "What does `axis=0` go along? Over how many numbers is each mean taken, and over how many should it be?",
        "Without `axis` both are taken over all the steps of all the environments.",
    ),
    solution="""
        def normalise(advantages):
            centred = advantages - advantages.mean()
            return centred / (advantages.std() + 1e-8)
    """,
    wrong=(
        Wrong(
            {"mean()": "mean(axis=1, keepdims=True)", "std()": "std(axis=1, keepdims=True)"},
            "still the wrong axis: now each time step is compared with itself only, over the environments",
        ),
        Wrong({"std()": "std(axis=0)"}, "the mean is right, but each environment is still scaled on its own"),
        Wrong({"mean()": "mean(axis=0)"}, "the scale is right, but each environment is still centred on its own"),
        Wrong({"std()": "var()"}, "this divides by the variance: the result would not have a spread of 1"),
        Wrong({"advantages - advantages.mean()": "advantages"}, "the advantages are scaled, but not centred"),
    ),
    minutes=4,
    covers=("om-ppo-box", "alg-ppo-full"),
)


Exercise(
    id="ch08-bug-targets",
    kind="find the bug",
    tier="more",
    section="Generalised advantage estimation",
    title="Targets on the wrong scale",
    statement=r"""
        The value network should learn $\hat A_t + \hat v(s_t)$, the $\lambda$-return; the policy learns from the advantages centred and scaled. `advantages` are the estimates as they come, `values` is $\hat v(s_t)$. With
        this program, in a task with returns near 3000, the value network stays near 0 for ever. Mend it; it returns the tuple of normalised advantages and targets.
    """,
    stub="""
        def prepare(advantages, values):
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
            targets = advantages + values
            return advantages, targets
    """,
    cases=lambda rng: (
        [
            Case(dict(advantages=A, values=v), ((A - A.mean()) / (A.std() + 1e-8), A + v))
            for n, scale in ((4, 100), (3, 1000), (6, 10))
            for A, v in [((scale * (rng.normal(size=n) + 1)).round(1), rng.normal(size=n).round(1))]
        ]
        + [
            Case(dict(advantages=A, values=v), ((A - A.mean()) / (A.std() + 1e-8), A + v))
            for A, v in ((np.ones(3), np.array([1.0, 2.0, 4.0])), (np.array([1e-8, 0.0]), np.array([0.5, -1.0])))
        ]
    ),
    hints=(
        "Which advantages enter the targets: those of the argument, or those of the line above?",
        "The lines are right, their order is not.",
    ),
    solution="""
        def prepare(advantages, values):
            targets = advantages + values
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
            return advantages, targets
    """,
    wrong=(
        Wrong(
            {"return advantages, targets": "return targets - values, targets"},
            "the targets are right, but the policy gets its advantages unscaled",
        ),
        Wrong(
            {"targets = advantages + values": "targets = advantages"},
            "the target is the lambda-return: the advantage plus the value that was subtracted from it",
        ),
        Wrong(
            {"targets = advantages + values": "targets = values - advantages"},
            "the sign is turned round: where it went better than expected the value has to grow",
        ),
        Wrong(
            {"return advantages, targets": "return advantages, (targets - targets.mean()) / targets.std()"},
            "the targets are scaled on their own now: the network has to learn returns, in the units of the rewards",
        ),
    ),
    minutes=4,
    covers=("om-value-loss", "om-gae", "om-ppo-box"),
)


Exercise(
    id="ch08-reset-steps",
    kind="fill in",
    tier="deep",
    section="Generalised advantage estimation",
    title="Steps that are none",
    statement=r"""
        By default, in Gymnasium's vector environments the step after the end of an episode ignores the action and only resets: its row in the rollout leads from the last state of one episode to the first of the next, and must not be learned from. `terminated` and `truncated` are `(T, N)`; `over` `(N,)` says
        in which environments an episode ended with the last step of the rollout before. Return the `(T, N)` array of truth values, `True` where a row is a real step.
    """,
    stub="""
        def real_steps(terminated, truncated, over):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(terminated=(e := _at((T, N), *ends)), truncated=(c := _at((T, N), *cuts)), over=(o := np.array(over))),
            np.array([[not (o[i] if t == 0 else e[t - 1, i] or c[t - 1, i]) for i in range(N)] for t in range(T)]),
        )
        for T, N, ends, cuts, over in (
            (4, 3, ((1, 0), (3, 1)), ((2, 2),), (False, True, False)),
            (5, 2, ((0, 1),), ((4, 0), (2, 1)), (True, False)),
            (3, 4, ((2, 3), (1, 1)), ((0, 2),), (True, False, False, True)),
            (4, 2, ((1, 0),), ((1, 0), (2, 1)), (False, False)),
        )
    ],
    hints=(
        "The step in which an episode ends is a real one, and holds its last reward. Which row is not?",
        "Shift the endings down by one row: `np.vstack([over, done[:-1]])` is `True` where a row only resets.",
    ),
    solution="""
        def real_steps(terminated, truncated, over):
            done = terminated | truncated
            return ~np.vstack([over, done[:-1]])
    """,
    wrong=(
        Wrong(
            {"np.vstack([over, done[:-1]])": "done"},
            "the last step of an episode is thrown away, and with it the reward that ended it: it is the next row that only resets",
        ),
        Wrong({"~np": "np"}, "this marks the rows that only reset: turn it round"),
        Wrong(
            {"[over,": "[np.zeros_like(over),"},
            "an episode that ended with the rollout before is forgotten: its reset is the first row of this one",
        ),
        Wrong(
            {"np.vstack([over, done[:-1]])": "np.roll(done, 1, axis=0)"},
            "an ending in the last row comes round to the first: that one depends on the rollout before",
        ),
        Wrong({"terminated | truncated": "terminated"}, "an episode that was cut is reset, too"),
        Wrong(
            {"[over, done[:-1]]": "[done[1:], over]"},
            "the endings are shifted the wrong way: the reset comes after the end, not before it",
        ),
    ),
    minutes=6,
    covers=("om-ppo-box", "alg-ppo-full"),
)


# ---------------------------------------------------------------------- the ratio


Exercise(
    id="ch08-ratio",
    kind="fill in",
    tier="core",
    section="Old data, new policy",
    title="A ratio of two tiny numbers",
    statement=r"""
        `logp` and `logp_old` hold $\ln \pi_\theta(a_t | s_t)$ and $\ln \pi_{\theta_{old}}(a_t | s_t)$ of some steps. Return the array of the probability ratios ({eq}`eq-ppo-47`). With many action dimensions logarithms of $-800$ do occur, and must do no harm.
    """,
    stub="""
        def probability_ratio(logp, logp_old):
            ...
    """,
    cases=lambda rng: [
        Case(dict(logp=old + change, logp_old=old), np.exp((old + change) - old))
        for old, change in (
            (rng.normal(-1, 0.5, 4).round(1), np.array([0.3, 0.0, -0.4, 1.1])),
            (np.array([-800.0, -760.0, -2.0]), np.array([0.25, -0.5, 0.0])),
            (rng.normal(2, 1, 5).round(1), rng.normal(0, 0.5, 5).round(1)),
        )
    ],
    hints=(
        "The exponential of $-800$ is 0 in the computer's arithmetic, and 0 / 0 is no number.",
        "The logarithm of a quotient is the difference of the logarithms: take the difference first, the exponential last.",
    ),
    solution="""
        def probability_ratio(logp, logp_old):
            return np.exp(logp - logp_old)
    """,
    wrong=(
        Wrong(
            """
            def probability_ratio(logp, logp_old):
                with np.errstate(all="ignore"):
                    return np.exp(logp) / np.exp(logp_old)
            """,
            "right for moderate logarithms, but the exponential of -800 is 0: subtract before you take the exponential",
        ),
        Wrong(
            {"np.exp(logp - logp_old)": "logp - logp_old"},
            "this is the logarithm of the ratio: it is 0, not 1, where nothing has changed",
        ),
        Wrong(
            {"np.exp(logp - logp_old)": "logp / logp_old"},
            "a quotient of logarithms is not the ratio of the probabilities: subtract them, and take the exponential",
        ),
        Wrong({"logp - logp_old": "logp_old - logp"}, "the ratio is upside down: the new policy stands on top"),
        Wrong(
            {"np.exp(logp - logp_old)": "1 + logp - logp_old"},
            "this is the ratio to first order only: good near 1, wrong where the policy has moved",
        ),
    ),
    minutes=3,
    covers=("eq-ppo-47", "eq-ppo-48"),
)


Exercise(
    id="ch08-dimensions",
    kind="fill in",
    tier="more",
    section="Solving without the matrix",
    title="Six joints, one probability",
    statement=r"""
        HalfCheetah's action has six numbers, each drawn on its own from a normal distribution. `mean` and `actions` are `(B, A)`, for `B` steps with `A` numbers each; `log_std` `(A,)` holds the logarithms of the standard deviations, the same in all states. Return
        $\ln \pi(a | s)$ of each step, `(B,)`, from which the one ratio of that step ({eq}`eq-ppo-47`) is made.
    """,
    stub="""
        def log_density(mean, log_std, actions):
            ...
    """,
    cases=lambda rng: [
        Case(dict(mean=mean, log_std=log_std, actions=a), Gaussian(mean, log_std).log_prob(a))
        for B, A in ((3, 2), (2, 6), (4, 3))
        for mean, a in [rng.normal(size=(2, B, A)).round(1)]
        for log_std in [rng.normal(-0.3, 0.3, A).round(1)]
    ],
    hints=(
        r"One number has the logarithm $-z^2 / 2 - \ln \sigma - \ln (2 \pi) / 2$ with $z = (a - \mu) / \sigma$.",
        "The density of the whole action is the product of the densities of its numbers, so its logarithm is their sum, along `axis=1`.",
    ),
    solution="""
        def log_density(mean, log_std, actions):
            z = (actions - mean) / np.exp(log_std)
            return (-(z**2) / 2 - log_std - np.log(2 * np.pi) / 2).sum(axis=1)
    """,
    wrong=(
        Wrong(
            {".sum(axis=1)": ""},
            "this gives each number of an action a logarithm, and so a ratio, of its own: a step has one, so add along the numbers",
        ),
        Wrong({"sum": "mean"}, "the mean over the numbers of an action takes a root of its density: add them up"),
        Wrong({"sum(axis=1)": "sum(axis=0)"}, "this adds up over the steps: add along the numbers of an action"),
        Wrong({"sum(axis=1)": "sum()"}, "this adds up the steps, too: each has a ratio of its own"),
        Wrong(
            {
                "(-(z**2) / 2 - log_std - np.log(2 * np.pi) / 2).sum(axis=1)": "-(z**2).sum(axis=1) / 2 - log_std.sum() - np.log(2 * np.pi) / 2"
            },
            "the constant ln(2 pi) / 2 belongs to each number of the action: it is counted once only",
        ),
        Wrong({"sum(axis=1)": "prod(axis=1)"}, "densities multiply, so their logarithms add"),
        Wrong({" - log_std": ""}, "the density is lower where the spread is larger: its logarithm holds - log_std"),
    ),
    minutes=6,
    covers=("eq-ppo-47", "alg-ppo-full"),
)


# ---------------------------------------------------------------------- clipping


Exercise(
    id="ch08-clip",
    kind="fill in",
    tier="core",
    section="Clipping: PPO",
    title="The lower of two",
    statement=r"""
        Return $L^{CLIP}$ ({eq}`eq-ppo-49`) of some steps, a number: `ratio` and `advantage` are arrays, `clip` is $\epsilon$.
    """,
    stub="""
        def clip_objective(ratio, advantage, clip):
            ...
    """,
    cases=lambda rng: (
        [
            Case(
                dict(ratio=r, advantage=A, clip=clip),
                float(np.mean([min(x * a, min(max(x, 1 - clip), 1 + clip) * a) for x, a in zip(r, A)])),
            )
            for clip, r in (
                (0.2, np.array([0.5, 1.5, 0.7, 1.1, 1.9])),
                (0.1, np.array([1.3, 0.6, 0.95])),
                (0.3, np.array([0.4, 1.0, 1.6, 2.0])),
            )
            for A in [rng.permutation(np.resize([1.0, -2.0, 0.5, -1.5], len(r)))]
        ]
        + [Case(dict(ratio=np.array([1.5, 0.9]), advantage=np.array([4.0, -4.0]), clip=0.2), (4.8 - 3.6) / 2)]
    ),
    hints=(
        "`np.clip(ratio, 1 - clip, 1 + clip)` is the clipped ratio. Multiply both ratios with the advantage before you compare them.",
        "`np.minimum` takes the lower one of each pair; $\\hat{\\mathbb E}_t$ is the mean over the steps.",
    ),
    solution="""
        def clip_objective(ratio, advantage, clip):
            clipped = np.clip(ratio, 1 - clip, 1 + clip)
            return float(np.minimum(ratio * advantage, clipped * advantage).mean())
    """,
    wrong=(
        Wrong(
            {"minimum": "maximum"},
            "min and max are confused: the higher of the two is a bound from above, and never stops a step that goes too far",
        ),
        Wrong(
            {"np.minimum(ratio * advantage, clipped * advantage)": "(clipped * advantage)"},
            "only the clipped term is there: a step that has made things worse would have no gradient that leads back",
        ),
        Wrong(
            {"np.minimum(ratio * advantage, clipped * advantage)": "(np.minimum(ratio, clipped) * advantage)"},
            "the lower ratio is not the lower product where the advantage is negative: multiply first",
        ),
        Wrong(
            {"np.minimum(ratio * advantage, clipped * advantage)": "(ratio * advantage)"},
            "nothing is clipped: this is the surrogate of (48)",
        ),
        Wrong(
            {"clipped * advantage": "np.clip(ratio * advantage, 1 - clip, 1 + clip)"},
            "the product with the advantage is clipped: it is the ratio that has to stay near 1",
        ),
        Wrong(
            {"float(": "-float("}, "this is the loss for an optimizer that descends: the objective itself has no minus"
        ),
        Wrong({".mean()": ".sum()"}, "this adds up over the steps: take the mean"),
    ),
    minutes=6,
    covers=("eq-ppo-49", "alg-ppo-clip", "cl-132"),
)


Exercise(
    id="ch08-predict-clip-values",
    kind="predict",
    tier="core",
    section="Clipping: PPO",
    title="Four cases of the minimum",
    statement=r"""
        $\epsilon = 0.2$. Predict $\min(r \hat A, \mathrm{clip}(r, 1 - \epsilon, 1 + \epsilon) \hat A)$ for $(r, \hat A) = (1.5, 1)$, $(0.5, 1)$, $(1.5, -1)$ and $(0.5, -1)$, in this order. In how many of them is it the unclipped term? Bind the array of the four numbers to `four_values`.
    """,
    stub="four_values = ...",
    cases=lambda rng: [Case({}, np.array([1.2, 0.5, -1.5, -0.8]))],
    hints=(
        "Write both terms down: for (0.5, -1) they are -0.5 and -0.8. Of two negative numbers the lower one is farther from 0.",
        "The unclipped term is the lower one in two cases, where the step has made things worse: a good action that became rarer, and a bad one that became more frequent.",
    ),
    solution="four_values = np.array([1.2, 0.5, -1.5, -0.8])",
    wrong=(
        Wrong(
            "four_values = np.array([1.5, 0.8, -1.2, -0.5])",
            "these are the higher ones: min and max are confused",
        ),
        Wrong(
            "four_values = np.array([1.2, 0.8, -1.2, -0.8])",
            "these are the clipped terms: in two cases the unclipped one is lower",
        ),
        Wrong(
            "four_values = np.array([1.5, 0.5, -1.5, -0.5])",
            "these are the unclipped terms: in two cases the clipped one is lower",
        ),
        Wrong(
            "four_values = np.array([1.2, 0.5, -1.2, -0.5])",
            "this takes the lower ratio and multiplies afterwards: with a negative advantage that is the higher product",
        ),
        Wrong(
            "four_values = np.array([1.2, 0.8, -1.5, -0.8])",
            "(1.5, -1) is not the only case in which the unclipped term is lower: compare 0.5 and 0.8",
        ),
    ),
    minutes=4,
    covers=("eq-ppo-49", "ex-clip-cases", "cl-132", "cl-134"),
)


def _slopes():
    ratio = np.array([0.5, 0.9, 1.1, 1.5])
    return np.array([4 * clip_gradient(ratio, np.full(4, A), 0.2) for A in (1.0, -1.0)])


Exercise(
    id="ch08-predict-slopes",
    kind="predict",
    tier="more",
    section="Clipping: PPO",
    title="Who still pushes?",
    statement=r"""
        $\epsilon = 0.2$. For the ratios 0.5, 0.9, 1.1 and 1.5 predict the derivative of the clipped term of one step ({eq}`eq-ppo-49`) with respect to $\ln \pi_\theta(a | s)$. Bind the 2 x 4 array `slopes`: row 0 with $\hat A = 1$, row 1 with $\hat A = -1$. Where is it 0?
    """,
    stub="slopes = ...",
    cases=lambda rng: [Case({}, _slopes())],
    hints=(
        r"The ratio is $e^{\ln \pi_\theta - \ln \pi_{\theta_{old}}}$, so its derivative is the ratio itself.",
        "The objective is flat where the policy has already moved far enough in the right direction: to the right for a good action, to the left for a bad one, figures 59 and 60.",
    ),
    solution="slopes = np.array([[0.5, 0.9, 1.1, 0.0], [0.0, -0.9, -1.1, -1.5]])",
    wrong=(
        Wrong(
            "slopes = np.array([[0.0, 0.9, 1.1, 0.0], [0.0, -0.9, -1.1, 0.0]])",
            "it is flat on one side only: a step that has made things worse keeps its gradient, and finds back",
        ),
        Wrong(
            "slopes = np.array([[0.0, 0.9, 1.1, 1.5], [-0.5, -0.9, -1.1, 0.0]])",
            "the flat sides are exchanged, as if the higher of the two terms were taken",
        ),
        Wrong(
            "slopes = np.array([[1.0, 1.0, 1.0, 0.0], [0.0, -1.0, -1.0, -1.0]])",
            "this is the derivative with respect to the ratio: with respect to the logarithm it is multiplied by the ratio",
        ),
        Wrong(
            "slopes = np.array([[0.0, -0.9, -1.1, -1.5], [0.5, 0.9, 1.1, 0.0]])",
            "the rows are swapped: row 0 has the advantage 1",
        ),
        Wrong(
            "slopes = np.array([[0.5, 0.9, 1.1, 1.5], [-0.5, -0.9, -1.1, -1.5]])",
            "nothing is clipped: these are the slopes of the surrogate of (48)",
        ),
        Wrong(
            "slopes = np.array([[0.5, 0.9, 1.1, 1.2], [-0.8, -0.9, -1.1, -1.5]])",
            "where the clipped term is the lower one it is a constant, and a constant has no slope",
        ),
    ),
    minutes=6,
    covers=("fig-59", "fig-60", "ex-clip-cases", "cl-133", "cl-134"),
)


Exercise(
    id="ch08-bug-no-way-back",
    kind="find the bug",
    tier="more",
    section="Clipping: PPO",
    title="The step that cannot be taken back",
    statement=r"""
        The derivative of the mean of the clipped terms ({eq}`eq-ppo-49`) with respect to each $\ln \pi_\theta(a_t | s_t)$, `(B,)`. With this program an action that became ten times rarer by accident, although it is a good one, stays rare for the rest of the epochs. Mend it.
    """,
    stub="""
        def clip_slope(ratio, advantage, clip):
            flat = np.abs(ratio - 1) > clip
            return np.where(flat, 0.0, ratio * advantage) / len(ratio)
    """,
    cases=lambda rng: [
        Case(dict(ratio=r, advantage=A, clip=clip), clip_gradient(r, A, clip))
        for clip, r, A in (
            (0.2, np.array([0.5, 1.5, 0.5, 1.5, 1.1]), np.array([1.0, 2.0, -1.0, -0.5, 1.5])),
            (0.1, np.array([1.3, 0.95, 0.6]), np.array([-1.0, 2.0, 0.5])),
            (0.3, np.array([0.4, 1.2, 1.6, 2.0]), np.array([-2.0, -1.0, 1.0, -0.5])),
            (0.2, np.array([4.0, 0.02, 4.0]), np.array([1.0, -1.0, -1.0])),
        )
    ],
    hints=(
        "The minimum is the clipped term only where this is the lower one. On which side is that, for a positive and for a negative advantage?",
        "Flat: ratio above $1 + \\epsilon$ and advantage positive, or ratio below $1 - \\epsilon$ and advantage negative.",
    ),
    solution="""
        def clip_slope(ratio, advantage, clip):
            flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
            return np.where(flat, 0.0, ratio * advantage) / len(ratio)
    """,
    wrong=(
        Wrong(
            {"advantage > 0": "advantage <= 0", "advantage < 0": "advantage > 0"},
            "the sides are exchanged: now only what goes the right way goes on and on, as with max in place of min",
        ),
        Wrong(
            {" | ((ratio < 1 - clip) & (advantage < 0))": ""},
            "bad actions are pushed down without limit: for them it is flat below 1 - epsilon",
        ),
        Wrong(
            {"((ratio > 1 + clip) & (advantage > 0)) | ": ""},
            "good actions are pushed up without limit: for them it is flat above 1 + epsilon",
        ),
        Wrong(
            {" & (advantage > 0)": "", "((ratio < 1 - clip) & (advantage < 0))": "False"},
            "it depends on the advantage, too: a bad action far above 1 must come down again",
        ),
        Wrong(
            {"ratio * advantage)": "advantage)"},
            "this is the derivative with respect to the ratio: with respect to the logarithm it is multiplied by the ratio",
        ),
        Wrong(
            {" / len(ratio)": ""},
            "the flat parts are right; the objective is a mean, so each step counts one part in B",
        ),
    ),
    minutes=6,
    covers=("eq-ppo-49", "alg-ppo-clip", "fig-59", "fig-60", "cl-133"),
)


# ---------------------------------------------------------------------- the update


def _clip_step(h, actions, logp_old, advantage, clip, alpha):
    policy = Categorical(np.tile(h, (len(actions), 1)))
    gradient, _ = objective_gradient(policy, None, actions, logp_old, advantage, PPOConfig(clip=clip))
    return h + alpha * gradient.sum(axis=0)


def _bandit(rng, n, B):
    return rng.normal(size=n).round(1), np.resize(np.arange(n), B), np.resize([1.0, -1.5, 0.4, -0.5, 1.5], B)


Exercise(
    id="ch08-bug-minus",
    kind="find the bug",
    tier="core",
    section="Clipping: PPO",
    title="It learns the worst arm",
    statement=r"""
        One step of gradient ascent on $L^{CLIP}$ ({eq}`eq-ppo-49`) for a bandit with a softmax policy: `h` holds the preferences, `actions` the arms that were pulled, `logp_old` and `advantage` what belongs to them. The lines were taken from a program whose optimizer descends. With them the best arm dies out first. Mend one line.
    """,
    setup=SOFTMAX,
    stub="""
        def clip_step(h, actions, logp_old, advantage, clip, alpha):
            p = softmax(h)
            ratio = np.exp(np.log(p[actions]) - logp_old)
            flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
            weight = np.where(flat, 0.0, ratio * advantage) / len(ratio)
            return h - alpha * weight @ (np.eye(len(p))[actions] - p)
    """,
    cases=lambda rng: [
        Case(g, _clip_step(**g))
        for n, B, moved, clip, alpha in ((3, 6, 0.4, 0.2, 0.1), (2, 5, -0.3, 0.1, 0.5), (4, 8, 0.5, 0.3, 1.0))
        for h, actions, A in [_bandit(rng, n, B)]
        for logp_old in [np.log(softmax(h + moved * np.linspace(-1, 1, n))[actions])]
        for g in [dict(h=h, actions=actions, logp_old=logp_old, advantage=A, clip=clip, alpha=alpha)]
    ],
    hints=(
        "The objective is to be maximised. Which way along its gradient does the last line go?",
        "A loss is minus the objective, and descent on the loss is ascent on the objective: here there is no loss, only the objective.",
    ),
    solution="""
        def clip_step(h, actions, logp_old, advantage, clip, alpha):
            p = softmax(h)
            ratio = np.exp(np.log(p[actions]) - logp_old)
            flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
            weight = np.where(flat, 0.0, ratio * advantage) / len(ratio)
            return h + alpha * weight @ (np.eye(len(p))[actions] - p)
    """,
    wrong=(
        Wrong(
            {"p = softmax(h)": "p, advantage = softmax(h), -advantage", "h + alpha": "h - alpha"},
            "the direction is right again, but with the advantage negated the flat parts have changed sides",
        ),
        Wrong(
            {"weight @": "np.abs(weight) @"}, "now every arm that was pulled becomes more frequent, the bad ones, too"
        ),
        Wrong(
            {"np.log(p[actions]) - logp_old": "logp_old - np.log(p[actions])"},
            "the direction is right, but the ratio is upside down now",
        ),
        Wrong(
            {"np.where(flat, 0.0, ratio * advantage)": "ratio * advantage"},
            "the direction is right, but nothing is clipped any more",
        ),
        Wrong(
            {" / len(ratio)": ""}, "the direction is right, but the sum of the steps has taken the place of their mean"
        ),
    ),
    minutes=5,
    covers=("eq-ppo-41", "eq-ppo-49", "alg-ppo-clip", "cl-121"),
)


def _clip_epochs(h, actions, advantage, clip, alpha, n_epochs):
    logp_old = np.log(softmax(h)[actions])
    for _ in range(n_epochs):
        h = _clip_step(h, actions, logp_old, advantage, clip, alpha)
    return h


Exercise(
    id="ch08-bug-old-policy",
    kind="find the bug",
    tier="more",
    section="Clipping: PPO",
    title="The clip that never clips",
    statement=r"""
        Several epochs of ascent on $L^{CLIP}$ with the same data, for a bandit with a softmax policy over the preferences `h`. Whatever `clip` is, 0.01 or 100, this program returns the same, and after many epochs the policy has run away. Find out why, and mend it.
    """,
    setup=SOFTMAX,
    stub="""
        def clip_epochs(h, actions, advantage, clip, alpha, n_epochs):
            for _ in range(n_epochs):
                logp_old = np.log(softmax(h)[actions])
                p = softmax(h)
                ratio = np.exp(np.log(p[actions]) - logp_old)
                flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
                weight = np.where(flat, 0.0, ratio * advantage) / len(ratio)
                h = h + alpha * weight @ (np.eye(len(p))[actions] - p)
            return h
    """,
    cases=lambda rng: (
        [
            Case(g, _clip_epochs(**g))
            for n, B, clip, alpha, n_epochs in ((3, 6, 0.2, 0.5, 8), (2, 5, 0.1, 0.5, 5), (4, 8, 0.3, 0.5, 8))
            for h, actions, A in [_bandit(rng, n, B)]
            for g in [dict(h=h, actions=actions, advantage=A, clip=clip, alpha=alpha, n_epochs=n_epochs)]
        ]
        + [
            Case(g, _clip_epochs(**g))  # the good arm has a bad sample, too
            for g in [dict(h=np.zeros(2), actions=np.array([0, 0, 1]), advantage=np.array([2.0, -0.5, 0.3]))]
            for g in [g | dict(clip=0.05, alpha=0.5, n_epochs=4)]
        ]
    ),
    hints=(
        "Print `ratio` in each epoch. What should it be in the first one, and what in the others?",
        "The old policy is the one that pulled the arms: it stays as it was until new data come.",
    ),
    solution="""
        def clip_epochs(h, actions, advantage, clip, alpha, n_epochs):
            logp_old = np.log(softmax(h)[actions])
            for _ in range(n_epochs):
                p = softmax(h)
                ratio = np.exp(np.log(p[actions]) - logp_old)
                flat = ((ratio > 1 + clip) & (advantage > 0)) | ((ratio < 1 - clip) & (advantage < 0))
                weight = np.where(flat, 0.0, ratio * advantage) / len(ratio)
                h = h + alpha * weight @ (np.eye(len(p))[actions] - p)
            return h
    """,
    wrong=(
        Wrong(
            {"    return h": "        logp_old = np.log(p[actions])\n    return h"},
            "the old policy is that of the epoch before: it has to be the one that pulled the arms, through all epochs",
        ),
        Wrong(
            {"np.where(flat, 0.0, ratio * advantage)": "ratio * advantage"},
            "the old policy is right now, but nothing is clipped any more",
        ),
        Wrong(
            {"p = softmax(h)\n": "p = softmax(h) if _ == 0 else p\n"},
            "now the new policy stays as it was, too: its probabilities belong into the loop",
        ),
        Wrong(
            {"np.log(p[actions]) - logp_old": "logp_old - np.log(p[actions])"},
            "the old policy is right, but the ratio is upside down now",
        ),
        Wrong(
            {"weight = np.where(flat, 0.0, ratio * advantage)": "weight = np.where(flat, 0.0, advantage)"},
            "the old policy is right, but the gradient has lost its factor, the ratio, which is no longer 1",
        ),
    ),
    minutes=8,
    covers=("om-ppo-box", "eq-ppo-47", "alg-ppo-clip", "cl-137"),
)


Exercise(
    id="ch08-full-loss",
    kind="fill in",
    tier="core",
    section="Three terms",
    title="What the optimizer gets",
    statement=r"""
        An optimizer such as Adam *descends*. Return the number that it has to get, so that the objective of PPO ({eq}`eq-ppo-50`, with $L^{VF}$ the squared error) grows: `l_clip`, `v`, `target` and `entropy` are arrays with an entry for each step: the clipped term, $\hat v(s_t)$, its target, and the entropy of the policy; `c1` and `c2` are the two coefficients.
    """,
    stub="""
        def full_loss(l_clip, v, target, entropy, c1, c2):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(l_clip=L, v=v, target=G, entropy=S, c1=c1, c2=c2),
            float(np.mean(c1 * (v - G) ** 2 - L - c2 * S)),
        )
        for n, c1, c2 in ((4, 0.5, 0.01), (3, 1.0, 0.1), (5, 0.25, 0.5))
        for L, v, G, S in [rng.normal(size=(4, n)).round(1) + [[0.5], [1], [2], [2]]]
    ],
    hints=(
        "What should grow: the clipped term? The squared error? The entropy?",
        "Write down the objective as (50) has it, and put a minus before the whole.",
    ),
    solution="""
        def full_loss(l_clip, v, target, entropy, c1, c2):
            value_loss = ((v - target) ** 2).mean()
            return float(-(l_clip.mean() - c1 * value_loss + c2 * entropy.mean()))
    """,
    wrong=(
        Wrong(
            {"float(-(": "float(("},
            "the minus is missing: an optimizer that descends on the objective makes it as small as it can",
        ),
        Wrong(
            {"+ c2": "- c2"}, "the entropy has the wrong sign: it is a bonus, and this punishes a policy for exploring"
        ),
        Wrong({"- c1": "+ c1"}, "the value loss has the wrong sign: the network would flee from its targets"),
        Wrong(
            {
                "-(l_clip.mean() - c1 * value_loss + c2 * entropy.mean())": "-l_clip.mean() - c1 * value_loss + c2 * entropy.mean()"
            },
            "the minus stands before the first term only: it belongs before the whole",
        ),
        Wrong(
            {"c1 * value_loss + c2 *": "c2 * value_loss + c1 *"},
            "the two coefficients are swapped: c1 belongs to the values, c2 to the entropy",
        ),
        Wrong(
            {"** 2).mean()": "** 2).mean() / 2"},
            "half the squared error is another convention: (50) has the whole, and c1 for its weight",
        ),
    ),
    minutes=5,
    covers=("eq-ppo-50", "om-value-loss", "alg-ppo-full"),
)


Exercise(
    id="ch08-bug-entropy",
    kind="find the bug",
    tier="more",
    section="Three terms",
    title="A bonus for making up one's mind",
    statement=r"""
        The entropy term of {eq}`eq-ppo-50` on its own: one step of the preferences `h` that should make the policy a little less decided, by ascent on $c_2 S$. With this program PPO stops exploring within a few updates, the sooner the larger $c_2$ is. Mend it.
    """,
    setup=SOFTMAX,
    stub="""
        def bonus_step(h, c2, alpha):
            p = softmax(h)
            S = -(p @ np.log(p))
            return h + alpha * c2 * p * (np.log(p) + S)
    """,
    cases=lambda rng: [
        Case(dict(h=h, c2=c2, alpha=alpha), h + alpha * c2 * Categorical(h).grad_entropy())
        for n, c2, alpha in ((3, 0.1, 1.0), (4, 0.5, 0.5), (2, 1.0, 0.2))
        for h in [rng.normal(size=n).round(1)]
    ],
    hints=(
        "Take two actions, one of them nearly certain. Which preference does the last line raise?",
        r"The derivative of $S$ with respect to the preference of $a$ is $-\pi(a) (\ln \pi(a) + S)$: positive for a rare action.",
    ),
    solution="""
        def bonus_step(h, c2, alpha):
            p = softmax(h)
            S = -(p @ np.log(p))
            return h + alpha * c2 * -p * (np.log(p) + S)
    """,
    wrong=(
        Wrong(
            {"(np.log(p) + S)": "np.log(p)"},
            "the sign is right; the entropy itself is missing in the derivative, and with it all preferences would grow together",
        ),
        Wrong(
            {"(np.log(p) + S)": "(np.log(p) + 1)"},
            "this is the derivative with respect to the probability, times it: all probabilities change with one preference",
        ),
        Wrong({"-p * (np.log(p) + S)": "-(np.log(p) + S)"}, "the sign is right, but the probability is missing"),
        Wrong(
            {"-p * (np.log(p) + S)": "(1 / len(p) - p)"},
            "this leads to the uniform policy, too, but up another hill: it is the gradient of the mean of ln pi, not of the entropy",
        ),
        Wrong({"S = -(p": "S = (p"}, "the entropy itself has the wrong sign now: it is never negative"),
    ),
    minutes=5,
    covers=("eq-ppo-50", "ex-entropy", "cl-142"),
)


# ---------------------------------------------------------------------- the distance of two policies


def _bernoulli(p, q):
    return float(p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q)))


Exercise(
    id="ch08-two-kls",
    kind="by hand",
    tier="core",
    section="Distance between policies",
    title="There is not as far as back",
    statement=r"""
        The old policy takes two actions with the probabilities 0.5 and 0.5, the new one with 0.9 and 0.1. Compute $KL[\pi_{\theta_{old}}, \pi_\theta]$, as in {eq}`eq-ppo-45`, and $KL[\pi_\theta, \pi_{\theta_{old}}]$, with natural logarithms. Bind the two numbers, in this order, to `two_kls`.
    """,
    stub="two_kls = ...",
    cases=lambda rng: [Case({}, (_bernoulli(0.5, 0.9), _bernoulli(0.9, 0.5)))],
    hints=(
        r"$KL[p, q] = \sum_a p(a) \ln (p(a) / q(a))$: the weights, and what stands on top, are those of the first one.",
        r"$0.5 \ln (0.5 / 0.9) + 0.5 \ln (0.5 / 0.1)$, and $0.9 \ln (0.9 / 0.5) + 0.1 \ln (0.1 / 0.5)$.",
    ),
    solution="""
        old, new = np.array([0.5, 0.5]), np.array([0.9, 0.1])
        two_kls = (float(old @ np.log(old / new)), float(new @ np.log(new / old)))
    """,
    wrong=(
        Wrong(
            "two_kls = (0.3681, 0.5108)",
            "the KL is the wrong way round: the first one weights with the old policy",
        ),
        Wrong("two_kls = (0.737, 0.531)", "these are bits: take natural logarithms"),
        Wrong("two_kls = (-0.5108, -0.3681)", "the quotients are upside down: a KL is never negative"),
        Wrong(
            "two_kls = (1.0217, -1.0217)",
            "each logarithm has to be weighted with a probability: that of the first policy",
        ),
        Wrong(
            "two_kls = (0.4394, 0.4394)",
            "this is their mean: the KL is not symmetric, and PPO and TRPO use one direction",
        ),
        Wrong("two_kls = (0.4, 0.4)", "this is how far the probabilities are apart: a KL compares their logarithms"),
    ),
    minutes=5,
    digits=4,
    covers=("eq-ppo-45", "cl-123"),
)


Exercise(
    id="ch08-mean-kl",
    kind="fill in",
    tier="more",
    section="Distance between policies",
    title="How far is the new policy?",
    statement=r"""
        `old` and `new` are `(B, A)`: the probabilities of the old and of the new policy in the states of a rollout. Return the left side of the constraint ({eq}`eq-ppo-45`), a number. The new policy gives every action a chance, the old one may not.
    """,
    stub="""
        def average_kl(old, new):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(old=old, new=new),
            float(np.mean([sum(p * np.log(p / q) for p, q in zip(o, n) if p > 0) for o, n in zip(old, new)])),
        )
        for B, A, never in ((3, 2, ()), (2, 4, ((0, 1),)), (4, 3, ((1, 2), (3, 0))))
        for old, new in [rng.integers(1, 9, (2, B, A)).astype(float)]
        for old in [np.where(_at((B, A), *never), 0.0, old)]
        for old, new in [(old / old.sum(axis=1, keepdims=True), new / new.sum(axis=1, keepdims=True))]
    ],
    hints=(
        r"In each state $\sum_a \pi_{old}(a) (\ln \pi_{old}(a) - \ln \pi(a))$, then the mean over the states.",
        "An action that the old policy never takes adds 0. `np.where(old > 0, old, 1.0)` keeps its logarithm finite.",
    ),
    solution="""
        def average_kl(old, new):
            used = np.where(old > 0, old, 1.0)
            return float((old * (np.log(used) - np.log(new))).sum(axis=1).mean())
    """,
    wrong=(
        Wrong(
            """
            def average_kl(old, new):
                with np.errstate(all="ignore"):
                    return float((new * (np.log(new) - np.log(old))).sum(axis=1).mean())
            """,
            "the KL is the wrong way round: the old policy gives the weights, since it is the one that met these states and chose",
        ),
        Wrong(
            """
            def average_kl(old, new):
                with np.errstate(all="ignore"):
                    return float((old * (np.log(old) - np.log(new))).sum(axis=1).mean())
            """,
            "right where the old policy gives every action a chance; 0 times the logarithm of 0 is NaN: these actions add 0",
        ),
        Wrong(
            {".mean()": ".max()"},
            "this is the largest KL of any state: it belongs to the bound of the theory, (45) has the mean",
        ),
        Wrong(
            {".sum(axis=1).mean()": ".mean()"},
            "the mean is taken over the actions, too: add them up, then take the mean over the states",
        ),
        Wrong({".sum(axis=1).mean()": ".sum()"}, "this adds up over the states: take the mean"),
        Wrong(
            {"np.log(used) - np.log(new)": "np.log(new) - np.log(used)"},
            "the sign is turned round: a KL is never negative",
        ),
    ),
    minutes=6,
    covers=("eq-ppo-45", "alg-trpo"),
)


def _sigmoid(z):
    return 1 / (1 + np.exp(-z))


Exercise(
    id="ch08-predict-distances",
    kind="predict",
    tier="deep",
    section="Distance between policies",
    title="The same step, twice",
    statement=r"""
        A policy with one parameter takes the first of two actions with probability $\sigma(\theta)$. It moves from $\theta = 0$ to 1, and another time from 6 to 7. Predict how much farther the first step takes the policy than the second, as far as the KL is concerned: twice, ten times, a hundred times? Then compute
        $KL[\pi_{old}, \pi]$ of both steps, and bind the two numbers to `distances`.
    """,
    stub="distances = ...",
    cases=lambda rng: [Case({}, tuple(_bernoulli(_sigmoid(a), _sigmoid(a + 1.0)) for a in (0.0, 6.0)))],
    hints=(
        r"The probabilities are 0.5 and 0.731 in the first step, 0.99753 and 0.99909 in the second.",
        r"Both actions count: $p \ln (p / q) + (1 - p) \ln ((1 - p) / (1 - q))$, with the old policy's $p$.",
    ),
    solution="""
        def kl(a, b):
            p, q = 1 / (1 + np.exp(-a)), 1 / (1 + np.exp(-b))
            return float(p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q)))
        distances = (kl(0, 1), kl(6, 7))
    """,
    wrong=(
        Wrong(
            {"(kl(0, 1), kl(6, 7))": "(kl(1, 0), kl(7, 6))"},
            "the KL is the wrong way round: the old policy is the one before the step",
        ),
        Wrong(
            {"(kl(0, 1), kl(6, 7))": "(kl(0, 1), kl(0, 1))"},
            "the steps are equally long in the parameter, not in the policy: at 6 it is nearly certain already",
        ),
        Wrong(
            {" + (1 - p) * np.log((1 - p) / (1 - q))": ""},
            "the second action is missing: what one becomes more frequent, the other becomes rarer",
        ),
        Wrong(
            {"float(p * np.log(p / q) + (1 - p) * np.log((1 - p) / (1 - q)))": "float(q - p)"},
            "this is the change of the probability: the KL compares logarithms",
        ),
        Wrong({"(kl(0, 1), kl(6, 7))": "(kl(6, 7), kl(0, 1))"}, "the two are swapped: the first step starts at 0"),
    ),
    minutes=6,
    digits=4,
    covers=("cl-123", "ex-distance"),
)


Exercise(
    id="ch08-penalty",
    kind="fill in",
    tier="deep",
    section="A penalty instead",
    title="A rubber band",
    statement=r"""
        One step in one state, with a softmax policy: `h` holds the new preferences, `h_old` the old ones, `a` is the action, `advantage` a number, `beta` the coefficient of the KL. Return the gradient of the penalised objective ({eq}`eq-ppo-46`) with respect to `h`, an array like it.
    """,
    setup=SOFTMAX,
    stub="""
        def penalised_gradient(h, h_old, a, advantage, beta):
            ...
    """,
    cases=lambda rng: [
        Case(
            dict(h=h, h_old=h_old, a=a, advantage=A, beta=beta),
            objective_gradient(
                Categorical(h[None]),
                Categorical(h_old[None]),
                np.array([a]),
                Categorical(h_old[None]).log_prob([a]),
                np.array([A]),
                PPOConfig(objective="kl_fixed", beta=beta),
            )[0][0],
        )
        for n, a, A, beta in ((3, 1, 1.5, 1.0), (2, 0, -1.0, 3.0), (4, 3, 0.5, 0.3))
        for h, h_old in [rng.normal(size=(2, n)).round(1)]
    ],  # fmt: skip
    hints=(
        r"The gradient of the ratio is the ratio times the score, $1_{a = b} - \pi(b)$.",
        r"The gradient of $KL[\pi_{old}, \pi]$ with respect to the preferences of the new policy is $\pi - \pi_{old}$: its sum over the old policy's actions leaves nothing else.",
    ),
    solution="""
        def penalised_gradient(h, h_old, a, advantage, beta):
            p, p_old = softmax(h), softmax(h_old)
            ratio = p[a] / p_old[a]
            return ratio * advantage * (np.eye(len(p))[a] - p) - beta * (p - p_old)
    """,
    wrong=(
        Wrong(
            {"- beta": "+ beta"}, "the penalty has the wrong sign: it pushes the policy away from the old one, not back"
        ),
        Wrong({"ratio * advantage": "advantage"}, "the ratio is missing: it is 1 at the old policy only"),
        Wrong(
            {"(p - p_old)": "p * (np.log(p / p_old) - p @ np.log(p / p_old))"},
            "this penalises the KL the wrong way round: (46) has the old policy first",
        ),
        Wrong(
            {"- beta * (p - p_old)": "- beta * (h - h_old)"},
            "this pulls the parameters back, not the policy: distances of the two are not the same",
        ),
        Wrong(
            {"np.eye(len(p))[a] - p)": "np.eye(len(p))[a])"},
            "the score lacks the probabilities: when one preference grows, the other actions become rarer",
        ),
        Wrong({" - beta * (p - p_old)": ""}, "the penalty is missing: this is the gradient of (44)"),
    ),
    minutes=10,
    covers=("eq-ppo-46", "alg-kl-penalty"),
)


def _betas(beta, kls, d_target):
    history = [beta]
    for d in kls:
        history.append(adapt_beta(history[-1], d, d_target))
    return np.array(history)


Exercise(
    id="ch08-adaptive-beta",
    kind="fill in",
    tier="deep",
    section="A penalty instead",
    title="A penalty that finds its size",
    statement=r"""
        After an update that moved the policy by a mean KL of $d$, the adaptive variant halves $\beta$ if $d < d_{targ} / 1.5$, doubles it if $d > 1.5 \, d_{targ}$, and leaves it as it is otherwise. `beta` is the first coefficient, `kls` holds the KL of each update. Return the array of all coefficients: the first one, and the one after each update.
    """,
    stub="""
        def betas(beta, kls, d_target):
            history = [beta]
            ...
            return np.array(history)
    """,
    cases=lambda rng: (
        [
            Case(dict(beta=beta, kls=np.array(kls) * d, d_target=d), _betas(beta, np.array(kls) * d, d))
            for beta, d, kls in (
                (1.0, 0.01, (0.1, 0.3, 0.9, 1.2, 1.8, 5.0)),
                (3.0, 0.03, (2.5, 1.7, 0.6, 0.7, 1.4)),
                (100.0, 0.003, (0.2, 0.4, 0.55, 0.8, 1.6)),
            )
        ]
        + [
            Case(dict(beta=2.0, kls=kls, d_target=0.75), _betas(2.0, kls, 0.75))
            for kls in [np.array([0.5, 1.125, 0.25, 2])]
        ]
    ),
    hints=(
        "If the policy moved too far, should the penalty be larger or smaller?",
        "`if ... elif ...` inside the loop, and an `append` after it, whatever happened.",
    ),
    solution="""
        def betas(beta, kls, d_target):
            history = [beta]
            for d in kls:
                if d < d_target / 1.5:
                    beta = beta / 2
                elif d > 1.5 * d_target:
                    beta = 2 * beta
                history.append(beta)
            return np.array(history)
    """,
    wrong=(
        Wrong(
            {"if d < d_target / 1.5": "if d > 1.5 * d_target", "elif d > 1.5 * d_target": "elif d < d_target / 1.5"},
            "the wrong way: where the policy moved too far the penalty has to grow",
        ),
        Wrong(
            {"d_target / 1.5": "d_target", "1.5 * d_target": "d_target"},
            "there is no zone in which beta stays: it is left as it is while d is within a factor of 1.5 of the target",
        ),
        Wrong(
            {"beta / 2": "beta / 1.5", "2 * beta": "1.5 * beta"},
            "1.5 belongs to the comparison: beta itself is halved or doubled",
        ),
        Wrong(
            {"d_target / 1.5": "d_target / 2", "1.5 * d_target": "2 * d_target"},
            "2 belongs to beta: the comparison is with a factor of 1.5",
        ),
        Wrong(
            {"beta = beta / 2": "beta = history[0] / 2", "beta = 2 * beta": "beta = 2 * history[0]"},
            "each change starts again from the first beta: it has to start from the last one",
        ),
        Wrong(
            {"d_target / 1.5": "d_target * 1.5", "d > 1.5 * d_target": "d > d_target / 1.5"},
            "the bounds are exchanged: halve below d_target / 1.5, double above 1.5 d_target",
        ),
    ),
    minutes=5,
    covers=("om-adaptive-beta", "alg-kl-adaptive", "cl-131"),
)


# ---------------------------------------------------------------------- trust regions


def _spd(rng, n):
    M = rng.normal(size=(n, n)).round(1)
    return M @ M.T + np.eye(n)


Exercise(
    id="ch08-conjugate-gradient",
    kind="fill in",
    tier="deep",
    section="Solving without the matrix",
    title="Without the matrix",
    statement=r"""
        TRPO needs the $x$ with $H x = g$ for a matrix of ten thousand rows, of which it can only afford products $H p$. Conjugate gradient starts with $x = 0$ and $r = p = b$, and repeats: $\alpha = r \cdot r / (p \cdot H p)$; $x$ moves by $\alpha p$; the residual $r$ loses $\alpha H p$; the next direction is the new $r$ plus
        (new $r \cdot r$ / old $r \cdot r$) times the last direction. Return $x$ after `n_steps`, fewer than would give the exact answer. `H` is `(n, n)`; only multiply with it.
    """,
    stub="""
        def solve_by_products(H, b, n_steps):
            x, r, p = np.zeros(len(b)), b, b
            ...
            return x
    """,
    cases=lambda rng: [
        Case(dict(H=H, b=b, n_steps=n_steps), conjugate_gradient(lambda v, H=H: H @ v, b, n_steps))
        for n, n_steps in ((3, 2), (5, 3), (4, 1), (6, 4))
        for H, b in [(_spd(rng, n), rng.normal(size=n).round(1))]
    ],
    hints=(
        "Keep the new residual under a name of its own: the next direction needs both $r \\cdot r$.",
        "`p = r_next + (r_next @ r_next) / (r @ r) * p`, and only then `r = r_next`.",
    ),
    solution="""
        def solve_by_products(H, b, n_steps):
            x, r, p = np.zeros(len(b)), b, b
            for _ in range(n_steps):
                alpha = (r @ r) / (p @ H @ p)
                x = x + alpha * p
                r_next = r - alpha * (H @ p)
                p = r_next + (r_next @ r_next) / (r @ r) * p
                r = r_next
            return x
    """,
    wrong=(
        Wrong(
            {" + (r_next @ r_next) / (r @ r) * p": ""},
            "each direction is the residual alone: that is steepest descent, which undoes what the steps before achieved",
        ),
        Wrong(
            {"(r_next @ r_next) / (r @ r)": "(r @ r) / (r_next @ r_next)"},
            "the factor of the last direction is upside down: the new residual belongs on top",
        ),
        Wrong(
            """
            def solve_by_products(H, b, n_steps):
                return np.linalg.solve(H, b)
            """,
            "this is the exact answer, for which H itself has to be at hand: stop after n_steps products",
        ),
        Wrong({"p @ H @ p": "p @ p"}, "the step ignores the curvature: divide by p . H p"),
        Wrong(
            {"r_next + (r_next @ r_next) / (r @ r) * p": "r_next + p"},
            "the last direction enters in full: weight it with the quotient of the squared residuals",
        ),
        Wrong(
            {"r_next = r - alpha * (H @ p)": "r_next = b - alpha * (H @ p)"},
            "each step takes its part from the residual that is left, not from b",
        ),
    ),
    minutes=10,
    covers=("om-trpo-step", "alg-trpo"),
)


def _natural_step(g, H, delta):
    x = conjugate_gradient(lambda v: H @ v, g, 50, tol=1e-24)
    return x * (2 * delta) ** 0.5 / (g @ x) ** 0.5


Exercise(
    id="ch08-step-length",
    kind="fill in",
    tier="deep",
    section="Solving without the matrix",
    title="As far as the KL allows",
    statement=r"""
        Near the old policy the mean KL of a step $s$ is $\frac 1 2 s \cdot H s$, and the surrogate grows by $g \cdot s$. Return the step that makes the most of $g \cdot s$ while this KL is at most `delta`: along the natural gradient $x$ with $H x = g$, as long as possible. `H` is `(n, n)`, symmetric and positive definite.
    """,
    stub="""
        def natural_step(g, H, delta):
            ...
    """,
    cases=lambda rng: [
        Case(dict(g=g, H=H, delta=delta), _natural_step(g, H, delta))
        for n, delta in ((2, 0.01), (3, 0.05), (4, 0.5))
        for g, H in [(rng.normal(size=n).round(1), _spd(rng, n))]
    ],
    hints=(
        r"Put $s = c x$ into $\frac 1 2 s \cdot H s = \delta$, and solve for $c$.",
        r"$c = \sqrt{2 \delta / (x \cdot H x)}$.",
    ),
    solution="""
        def natural_step(g, H, delta):
            x = np.linalg.solve(H, g)
            return np.sqrt(2 * delta / (x @ H @ x)) * x
    """,
    wrong=(
        Wrong(
            {"2 * delta": "delta"},
            "the 2 is missing: half of s . H s is the KL, so this step uses half of what is allowed",
        ),
        Wrong(
            {"np.sqrt(2 * delta / (x @ H @ x))": "(2 * delta / (x @ H @ x))"},
            "the square root is missing: the KL grows with the square of the step",
        ),
        Wrong(
            {"np.linalg.solve(H, g)": "g"},
            "the length is right, but this is the plain gradient: the natural one solves H x = g",
        ),
        Wrong({"x @ H @ x": "x @ x"}, "this fixes the length in the parameters: the KL measures it with H"),
        Wrong(
            {"np.linalg.solve(H, g)": "H @ g"},
            "the gradient is multiplied by H: solve H x = g, so that directions in which the policy hardly changes go farther",
        ),
        Wrong(
            {"np.sqrt(2 * delta / (x @ H @ x)) * x": "x"},
            "this is the direction only: scale it so that the KL is delta",
        ),
    ),
    minutes=8,
    covers=("om-trpo-step", "alg-trpo", "eq-ppo-45"),
)


def _line_search(h, step, advantage, delta, n_tries):
    old = Categorical(h)
    for k in range(n_tries):
        new = Categorical(h + step / 2**k)
        if old.kl(new) <= delta and (new.probs - old.probs) @ advantage > 0:
            return h + step / 2**k
    return h


Exercise(
    id="ch08-bug-line-search",
    kind="find the bug",
    tier="deep",
    section="Trust regions: TRPO",
    title="A search that is content too soon",
    statement=r"""
        TRPO halves its step until it is good enough, here for a bandit: `h` holds the preferences, `step` is the full step, `advantage` has an estimate of the advantage of every arm, so the surrogate ({eq}`eq-ppo-44`) is `new @ advantage`, which need not be 0 for the old policy. If none of `n_tries` lengths will do, `h` stays. The policies of this program
        jump, and the constraint ({eq}`eq-ppo-45`) with its `delta` might as well not exist. Mend it.
    """,
    setup=SOFTMAX,
    stub="""
        def line_search(h, step, advantage, delta, n_tries):
            old = softmax(h)
            for k in range(n_tries):
                new = softmax(h + 0.5**k * step)
                if new @ advantage > old @ advantage:
                    return h + 0.5**k * step
            return h
    """,
    cases=lambda rng: [
        Case(g, _line_search(**g))
        for h, step, advantage, delta, n_tries in (
            ((0, 0, 0), (2, -1, -1), (1, -0.5, -0.5), 0.268, 10),
            ((0, 0, 0), (4, 7.2, 0), (1, -0.5, -0.5), 0.05, 10),
            ((2, 0, 0), (-1, 2, 0), (-0.5, 1.5, 0.5), 1.0, 10),
            ((-2, 1, 0), (3, -1, 0), (2, -0.5, 0.1), 0.1, 2),
            ((0, 0, 0), (1, -1, 0), (0, 0, 0), 1.0, 3),
            ((0, 0, 0), (1, -1, 0), (-0.5, -1.5, -1.0), 1.0, 10),
        )
        for g in [
            dict(
                h=np.array(h, float),
                step=np.array(step, float),
                advantage=np.array(advantage),
                delta=delta,
                n_tries=n_tries,
            )
        ]
    ],  # fmt: skip
    hints=(
        "Two things have to hold before a length is accepted. Which argument is never used?",
        "`old @ np.log(old / new)` is the KL of (45).",
    ),
    solution="""
        def line_search(h, step, advantage, delta, n_tries):
            old = softmax(h)
            for k in range(n_tries):
                new = softmax(h + 0.5**k * step)
                kl = old @ np.log(old / new)
                if new @ advantage > old @ advantage and kl <= delta:
                    return h + 0.5**k * step
            return h
    """,
    wrong=(
        Wrong(
            {"new @ advantage > old @ advantage and kl": "kl"},
            "now the KL is checked, but no longer that the surrogate is better than before",
        ),
        Wrong(
            {"old @ np.log(old / new)": "new @ np.log(new / old)"},
            "the KL is the wrong way round: the constraint has the old policy first",
        ),
        Wrong(
            {"step\n    return h": "step\n    return h + 0.5**k * step"},
            "where no length is good enough the last one is taken all the same: then h has to stay",
        ),
        Wrong(
            {
                "softmax(h + 0.5**k * step)": "softmax(h + 0.5**(k + 1) * step)",
                "return h + 0.5**k": "return h + 0.5**(k + 1)",
            },
            "the full step is never tried: the first length is the whole",
        ),
        Wrong(
            {" and kl <= delta": " or kl <= delta"},
            "one of the two is not enough: the surrogate has to be better, and the KL small",
        ),
    ),
    minutes=6,
    covers=("alg-line-search", "alg-trpo", "eq-ppo-44", "eq-ppo-45"),
)


# ---------------------------------------------------------------------- tables and claims


def _scores(R, base):
    scaled = lambda x, i: (x - base[i]) / (R[:, i].max() - base[i])  # noqa: E731
    return np.array([np.mean([scaled(x, i) for i in range(len(base)) for x in setting[i]]) for setting in R])


Exercise(
    id="ch08-build-score",
    kind="build",
    tier="deep",
    section="Is the other program better?",
    title="The score of figure 61",
    statement=r"""
        Eleven settings on seven tasks with returns from $-100$ to 5000: how does one rank them? Build the score. `returns` is `(settings, tasks, seeds)`, `random` `(tasks,)` holds the return of a random policy. Shift and scale the returns of each task so that the random policy gets 0 and the best run of the task 1,
        then take the mean over tasks and seeds. Return the array of the settings' scores, `(settings,)`.
    """,
    stub="""
        def table_scores(returns, random):
            ...
    """,
    cases=lambda rng: (
        [
            Case(dict(returns=R, random=base), _scores(R, base))
            for n, scale, seeds in ((3, (1000, 10), 2), (4, (20, 300, 80), 3), (2, (50, 2000, 10), 2))
            for scale in [np.array(scale, float)]
            for base in [(-scale * rng.uniform(0.2, 0.6, len(scale))).round(1)]
            for R in [(base[:, None] + scale[:, None] * rng.uniform(-0.1, 1, (n, len(scale), seeds))).round(1)]
        ]
        + [  # a run farther below the random policy than the best is above
            Case(dict(returns=R, random=base), _scores(R, base))
            for R, base in [(np.array([[[10.0, 12.0]], [[-40.0, 11.0]]]), np.array([2.0]))]
        ]
    ),
    hints=(
        "First take the random policy away, task by task: `returns - random[:, None]`.",
        "The best run of a task is the largest number over all settings and seeds: `max(axis=(0, 2))`.",
    ),
    solution="""
        def table_scores(returns, random):
            above = returns - random[:, None]
            best = above.max(axis=(0, 2))
            return (above / best[:, None]).mean(axis=(1, 2))
    """,
    wrong=(
        Wrong(
            {"above.max(axis=(0, 2))": "np.full(len(random), above.max())"},
            "all tasks are divided by the same number: those with large returns decide alone",
        ),
        Wrong(
            {"above.max(axis=(0, 2))": "above.mean(axis=2).max(axis=0)"},
            "this gives 1 to the best setting, averaged over its seeds: the best single run should get it",
        ),
        Wrong(
            {"returns - random[:, None]": "returns - returns.min(axis=(0, 2))[:, None]"},
            "0 goes to the worst run: the random policy should get it, and a setting may well be below",
        ),
        Wrong(
            {"(above / best[:, None])": "(above / above.max(axis=2, keepdims=True))"},
            "each setting is compared with its own best run: compare it with the best of all settings",
        ),
        Wrong(
            {"returns - random[:, None]": "returns"},
            "the random policy is not taken away: some tasks give a lot, or nothing but costs, for doing nothing",
        ),
        Wrong(
            {"mean(axis=(1, 2))": "max(axis=2).mean(axis=1)"},
            "this keeps the luckiest seed of each task: take the mean over all of them",
        ),
        Wrong({"axis=(1, 2)": "axis=(0, 2)"}, "these are the scores of the tasks: take the mean over tasks and seeds"),
    ),
    minutes=8,
    covers=("fig-61", "table-figure-61", "ex-ppo-table"),
)


@cache
def _violations():
    mdp = recycling_robot()
    old = old_policy(mdp, mdp.legal / mdp.legal.sum(axis=1, keepdims=True), 0.9)
    pis = np.random.default_rng(0).random((500, 2, 3)) * mdp.legal
    pis /= pis.sum(axis=2, keepdims=True)
    etas = np.array([eta(mdp, pi, 0.9) for pi in pis])
    bounds = lower_bound(old, pis), local_performance(old, pis) - mean_kl(old, pis)
    return tuple(int((etas < bound - 1e-9).sum()) for bound in bounds)


Exercise(
    id="ch08-claim-bound",
    kind="experiment",
    tier="deep",
    section="Climbing by bounds",
    title="Is the penalised objective a lower bound?",
    statement=r"""
        *The penalised objective ({eq}`eq-ppo-46`) is a lower bound on the performance.* Test it on the recycling robot with $\gamma = 0.9$. The old policy chooses uniformly among the legal actions: `old = old_policy(mdp, mdp.legal / mdp.legal.sum(axis=1, keepdims=True), 0.9)`. Draw 500 new ones as `pis = rng.random((500, 2, 3)) * mdp.legal`
        with `np.random.default_rng(0)`, and divide each row by its sum. `eta(mdp, pi, 0.9)` is the performance of a policy; `lower_bound(old, pis)` subtracts the constant of the theory times the largest KL from `local_performance(old, pis)`, and (46) with $\beta = 1$ subtracts `mean_kl(old, pis)` instead. Count the policies whose performance is
        below the bound by more than `1e-9`, for the theory's bound and for (46). Bind `verdict_bound` to `(word, n_theory, n_46)`, with the word `"confirmed"` or `"refuted"`.
    """,
    setup="import numpy as np\nfrom rlcore.envs import recycling_robot\nfrom rlcore.trust_region import eta, local_performance, lower_bound, mean_kl, old_policy",
    stub="verdict_bound = ...",
    cases=lambda rng: [Case({}, ("refuted", *_violations()))],
    hints=(
        "`np.array([eta(mdp, pi, 0.9) for pi in pis])` has the 500 performances; the other functions take all policies at once.",
        "A bound that is broken once is none.",
    ),
    solution="""
        mdp, rng = recycling_robot(), np.random.default_rng(0)
        old = old_policy(mdp, mdp.legal / mdp.legal.sum(axis=1, keepdims=True), 0.9)
        pis = rng.random((500, 2, 3)) * mdp.legal
        pis = pis / pis.sum(axis=2, keepdims=True)
        etas = np.array([eta(mdp, pi, 0.9) for pi in pis])
        broken = []
        for bound in (lower_bound(old, pis), local_performance(old, pis) - mean_kl(old, pis)):
            broken.append(int((etas < bound - 1e-9).sum()))
        word = "confirmed" if broken[1] == 0 else "refuted"
        verdict_bound = (word, *broken)
    """,
    wrong=(
        Wrong(
            {"broken[1] == 0": "broken[0] == 0"},
            "the numbers are right: the theory's bound holds, but the claim is about (46), with the mean KL and any beta",
        ),
        Wrong({"*broken)": "*broken[::-1])"}, "the two counts are swapped: that of the theory comes first"),
        Wrong(
            {"etas < bound - 1e-9": "etas > bound + 1e-9"},
            "these are the policies for which the bound holds: count those whose performance is below it",
        ),
        Wrong({"- mean_kl(old, pis)": "+ mean_kl(old, pis)"}, "the KL has to be subtracted from the local performance"),
        Wrong(
            {" - mean_kl(old, pis)": ""},
            "the penalty is missing in the second bound: without any it is broken more often",
        ),
    ),
    minutes=15,
    covers=("cl-128", "cl-129", "eq-ppo-46", "fig-58"),
)


PROOFS = (
    Proof(
        "Clipping only takes away",
        r"""
        Let $L(\theta) = \hat{\mathbb E}_t [r_t(\theta) \hat A_t]$ be the surrogate without clipping ({eq}`eq-ppo-48`), and $L^{CLIP}$ that of
        {eq}`eq-ppo-49` with $\epsilon > 0$; the ratios are differentiable in $\theta$. Show that $L^{CLIP}(\theta) \le L(\theta)$ for all $\theta$, and that at
        $\theta_{old}$ both have the same value and the same gradient.
        """,
        (
            "The minimum of two numbers is at most the first of them, step by step; then the mean.",
            "At $\\theta_{old}$ all ratios are 1, and 1 lies strictly between $1 - \\epsilon$ and $1 + \\epsilon$.",
            "By continuity the ratios stay there in a whole neighbourhood: with finitely many steps there is one for all of them.",
            "In it the clip does nothing, the two functions are the same, and so are their gradients; equal values at one point would not be enough.",
        ),
        r"""
        For each step $\min(r_t \hat A_t, \mathrm{clip}(r_t, 1 - \epsilon, 1 + \epsilon) \hat A_t) \le r_t \hat A_t$, whatever the sign of the advantage. The mean over the
        steps keeps the inequality: $L^{CLIP}(\theta) \le L(\theta)$.

        At $\theta_{old}$ every ratio is $\pi_{\theta_{old}} / \pi_{\theta_{old}} = 1$. A ratio is differentiable, so it is continuous: for each of the finitely many
        steps there is a distance from $\theta_{old}$ within which it stays between $1 - \epsilon$ and $1 + \epsilon$. Within the smallest of these distances
        this holds for all of them at once. There $\mathrm{clip}(r_t, 1 - \epsilon, 1 + \epsilon) = r_t$, both terms of each minimum are the same, and
        $L^{CLIP} = L$. Two functions that agree in a neighbourhood of a point have the same value and the same gradient in it.
        """,
    ),
)


QUESTIONS = (
    Question(
        "In the first minibatch of the first epoch, what does clipping change?",
        (
            ("It halves the gradient", False, "It sets terms to 0, or leaves them as they are; it scales none."),
            (
                "Nothing: all ratios are 1",
                True,
                "The policy is still the one that acted. The clip only acts on the steps that follow.",
            ),
            ("It removes the negative advantages", False, "With a ratio of 1 no term is flat, whatever its advantage."),
        ),
    ),
    Question(
        "Why does the minimum keep the unclipped term where the step has made things worse?",
        (
            (
                "So that a gradient is left that leads back",
                True,
                "A good action that became rarer, or a bad one that became more frequent, is still pushed the right way.",
            ),
            ("Because it is the larger one there", False, "It is the lower one: a minimum takes no other."),
            ("Because ratios near 1 need no clip", False, "The ratios in question are far from 1."),
        ),
    ),
    Question(
        "Does clipping guarantee that all ratios stay within 1 - epsilon and 1 + epsilon?",
        (
            ("Yes, by construction", False, "Only the objective is clipped, the policy is not."),
            (
                "No: it only takes away the reason to go farther",
                True,
                "One step may overshoot, and the gradients of other samples move the same network.",
            ),
            ("Only with a small epsilon", False, "No epsilon bounds what a single large step does."),
        ),
    ),
    Question(
        "All rewards are multiplied by 10, and advantages are not normalised. Which update takes the same step as before?",
        (
            (
                "TRPO with the same delta",
                True,
                "The direction is the same and the constraint sets the length, so the scale of the rewards drops out.",
            ),
            (
                "The penalty with the same fixed beta",
                False,
                "The surrogate weighs ten times more, so the penalty seems ten times smaller.",
            ),
            (
                "Plain gradient ascent with the same step size",
                False,
                "Its step is ten times longer.",
            ),
        ),
    ),
)
