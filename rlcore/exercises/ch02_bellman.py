"""Exercises of chapter 2: the Bellman equations."""

import numpy as np

from rlcore.bellman import q_from_v
from rlcore.envs import random_mdp, recycling_robot
from rlcore.exercises.engine import Case, Exercise, Question, Wrong

TITLE = "Exercises: the Bellman equations"
NOTEBOOK = "02_bellman"


def _models(rng):
    """A process without and one with a terminal state."""
    yield random_mdp(4, 2, n_next=3, rng=rng)
    yield recycling_robot(alpha=0.7, beta=0.2)


Exercise(
    id="ch02-q-from-v",
    kind="fill in",
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
        Case(
            dict(prob=m.prob, reward=m.reward, next_state=m.next_state, V=V, gamma=gamma),
            np.where(m.legal, q_from_v(m, V, gamma), 0.0),
        )
        for m in _models(rng)
        for gamma in (0.9, 0.0)
        for V in [rng.normal(size=m.n_states)]
    ],
    hints=(
        "`V[next_state]` looks up the value of every successor at once; its shape is `(S, A, K)`.",
        "Multiply by the probabilities and sum over the last axis.",
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
    ),
    minutes=5,
    covers=("eq-15", "alg-bellman-operators"),
)

QUESTIONS = (
    Question(
        "The Bellman optimality equation for $v_*$ is a system of how many equations?",
        (
            ("One for each state", True, "Each state has one unknown and one equation."),
            ("One for each pair", False, "That is the system for $q_*$."),
        ),
    ),
)
