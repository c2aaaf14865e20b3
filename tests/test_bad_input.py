"""Bad input: each call raises a ValueError that names the argument, shows what came and says what is allowed."""

import re
from fractions import Fraction

import gymnasium as gym
import numpy as np
import pytest
from worlds import awkward, loop, stay_or_go

from rlcore import bellman, dp, envs, mdp, td, traces
from rlcore.batch import batch_td
from rlcore.core.checks import as_floats, check_count, check_rate
from rlcore.core.learner import learner
from rlcore.core.rules import anything, checked
from rlcore.core.schedules import check_schedule, decaying
from rlcore.mdp import FiniteMDP, uniform_policy
from rlcore.monte_carlo import mc_prediction
from rlcore.mpc import linear_dynamics
from rlcore.nstep import n_step_td
from rlcore.planning import Transitions, dyna_q, replay
from rlcore.policies import softmax_policy
from rlcore.policy_gradient import gradient_ascent
from rlcore.reinforce import reinforce
from rlcore.solver import solve
from rlcore.studies.ch02 import cost_of_a_sweep, td0_groups
from rlcore.studies.ch03 import reinforce_linear, spread_updates, trajectories, trajectory_probability
from rlcore.studies.ch04 import first_updates, repeat
from rlcore.studies.ch07 import bluff_guarantee, bluff_learning

ROBOT = envs.recycling_robot()  # 2 states, 3 actions; action 2 is not legal in state 0
PI = uniform_policy(ROBOT)
ILLEGAL = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
ONE_NAN = [[0.0, float("nan"), 1.0], [0.0, 0.0, 0.0]]
RNG = np.random.default_rng(0)
nan, inf = float("nan"), float("inf")
ARRAYS = dict(
    next_state=[[[1]], [[1]]], prob=[[[1.0]], [[1.0]]], reward=[[[-1.0]], [[0.0]]], legal=[[True], [True]],
    terminal=[False, True], start=[1.0, 0.0],
)  # fmt: skip


def arrays(**change):
    return lambda: FiniteMDP(**(ARRAYS | change))


def outcomes(*rows, **more):
    return lambda: FiniteMDP.from_outcomes({(0, 0): list(rows)}, **more)


def from_arrays(P, R, **more):
    return lambda: FiniteMDP.from_arrays(P, R, **more)


def sampled(**change):
    call = dict(pi=PI, gamma=0.9, n_episodes=2, s=0, max_steps=3, rng=RNG) | change
    return lambda: mdp.sample_returns(ROBOT, call.pop("pi"), call.pop("gamma"), call.pop("n_episodes"), **call)


def rolled(**change):
    call = dict(pi=PI, n_steps=3, rng=RNG) | change
    return lambda: mdp.rollout(ROBOT, call.pop("pi"), call.pop("n_steps"), **call)


class Table(gym.Env):
    """A table that enters state 1 both with and without terminated."""

    observation_space, action_space = gym.spaces.Discrete(2), gym.spaces.Discrete(2)
    initial_state_distrib = np.array([1.0, 0.0])
    P = {0: {0: [(1.0, 1, 0.0, True)], 1: [(1.0, 1, 0.0, False)]}, 1: {0: [(1.0, 1, 0.0, True)]}}


# (call, the message begins with, the message also says)
CASES = {
    # the process itself
    "prob of two dimensions": (arrays(prob=[[1.0], [1.0]]), "prob: got shape (2, 1)", "must be (S, A, K)"),
    "no states": (arrays(prob=np.zeros((0, 1, 1))), "prob: got shape (0, 1, 1)", "at least 1"),
    "next_state of another shape": (arrays(next_state=[[1], [1]]), "next_state: got shape (2, 1)", "(2, 1, 1)"),
    "reward of another shape": (arrays(reward=[[[0.0, 1.0]]] * 2), "reward: got shape (2, 1, 2)", "(2, 1, 1)"),
    "legal of another shape": (arrays(legal=[True, True]), "legal: got shape (2,)", "must be (2, 1)"),
    "terminal of another shape": (arrays(terminal=[True]), "terminal: got shape (1,)", "must be (2,)"),
    "start of another shape": (arrays(start=[1.0, 0.0, 0.0]), "start: got shape (3,)", "must be (2,)"),
    "rows that are ragged": (arrays(prob=[[[1.0]], [[1.0, 0.0]]]), "prob: got [[[1.0]]", "must be numbers"),
    "probabilities in words": (arrays(prob="certain"), "prob: got 'certain'", "must be numbers"),
    "probability nan": (arrays(prob=[[[nan]], [[1.0]]]), "prob: not finite at (s=0, a=0, k=0)", "finite"),
    "reward inf": (arrays(reward=[[[inf]], [[0.0]]]), "reward: not finite at (s=0, a=0, k=0)", "finite"),
    "negative probability": (arrays(prob=[[[-1.0]], [[1.0]]]), "prob: negative at (s=0, a=0, k=0)", "at least 0"),
    "sum below 1": (arrays(prob=[[[0.9]], [[1.0]]]), "prob: sums to 0.9 at (s=0, a=0)", "must be 1"),
    "sum just above 1": (arrays(prob=[[[1 + 5e-9]], [[1.0]]]), "prob: sums to 1.000000005 at (s=0, a=0)", "must be 1"),
    "start just above 1": (arrays(start=[1 + 5e-9, 0.0]), "start: sums to 1.000000005", "must be 1"),
    "sum of an illegal row": (
        arrays(legal=[[False], [True]]), "prob: sums to 1 at (s=0, a=0)", "0 for an action that is not legal",
    ),
    "no legal action": (
        arrays(legal=[[False], [True]], prob=[[[0.0]], [[1.0]]]), "legal: no action at (s=0)", "at least one",
    ),
    "legal that is not a truth value": (arrays(legal=[[2], [1]]), "legal: got", "True or False"),
    "terminal nan": (arrays(terminal=[nan, 1.0]), "terminal: got", "True or False"),
    "successor out of range": (arrays(next_state=[[[2]], [[1]]]), "next_state: got 2 at (s=0, a=0, k=0)", "0..1"),
    "successor negative": (arrays(next_state=[[[-1]], [[1]]]), "next_state: got -1 at (s=0, a=0, k=0)", "0..1"),
    "successor between states": (arrays(next_state=[[[0.5]], [[1.0]]]), "next_state: got dtype float64", "integers"),
    "terminal state left": (arrays(next_state=[[[1]], [[0]]]), "next_state: terminal state left at (s=1", "itself"),
    "reward on a terminal state": (arrays(reward=[[[0.0]], [[5.0]]]), "reward: got 5 on a terminal state at (s=1", "0"),
    "start does not sum to 1": (arrays(start=[0.5, 0.0]), "start: sums to 0.5", "must be 1"),
    "start negative": (arrays(start=[2.0, -1.0]), "start: negative at (s=1)", "at least 0"),
    "start nan": (arrays(start=[nan, 0.0]), "start: not finite at (s=0)", "finite"),
    "start on a terminal state": (arrays(start=[0.5, 0.5]), "start: puts probability on a terminal state", "0"),
    "too few state names": (arrays(state_names=["a"]), "state_names: got 1 names", "must be 2"),
    "too many action names": (arrays(action_names=["a", "b"]), "action_names: got 2 names", "must be 1"),
    "one name for all": (arrays(state_names="ab"), "state_names: got 'ab'", "sequence of names"),
    "names that are a number": (arrays(action_names=3), "action_names: got 3", "sequence of names"),
    # constructors
    "empty table": (lambda: FiniteMDP.from_outcomes({}), "outcomes: got {}", "at least one"),
    "table that is a list": (lambda: FiniteMDP.from_outcomes([(0, 0)]), "outcomes: got [(0, 0)]", "table"),
    "key that is no pair": (lambda: FiniteMDP.from_outcomes({0: []}), "outcomes: got key 0", "(s, a)"),
    "key with a float": (lambda: FiniteMDP.from_outcomes({(0.0, 0): []}), "outcomes: got key (0.0, 0)", "integers"),
    "key that is negative": (lambda: FiniteMDP.from_outcomes({(-1, 0): []}), "outcomes: got key (-1, 0)", "least 0"),
    "no outcome": (outcomes(), "outcomes: no outcome at (0, 0)", "at least one"),
    "outcome of two parts": (outcomes((1.0, 0)), "outcomes: got (1.0, 0) at (0, 0)", "(probability, s_next, reward)"),
    "outcome with a word": (outcomes((1.0, 0, "+1")), "outcomes: got (1.0, 0, '+1') at (0, 0)", "reward"),
    "outcomes that are a number": (
        lambda: FiniteMDP.from_outcomes({(0, 0): 1.0}), "outcomes: got 1.0 at (0, 0)", "(probability, s_next, reward)",
    ),
    "successor that is a float": (outcomes((1.0, 0.5, 0.0)), "outcomes: got s_next = 0.5 at (0, 0)", "integer"),
    "successor that is negative": (outcomes((1.0, -1, 0.0)), "outcomes: got s_next = -1 at (0, 0)", "at least 0"),
    "outcome of negative probability": (
        outcomes((1.5, 0, 0.0), (-0.5, 0, 0.0)), "outcomes: got probability -0.5 at (0, 0)", "at least 0",
    ),
    "outcomes that sum to 2": (outcomes((1.0, 0, 0.0), (1.0, 1, 0.0)), "prob: sums to 2 at (s=0, a=0)", "must be 1"),
    "key outside the states": (
        lambda: FiniteMDP.from_outcomes({(2, 0): [(1, 0, 0)]}, n_states=2), "outcomes: key (2, 0) is outside", "0..1",
    ),
    "key outside the actions": (
        lambda: FiniteMDP.from_outcomes({(0, 2): [(1, 0, 0)]}, n_actions=2), "outcomes: key (0, 2)", "0..1 actions",
    ),
    "successor outside the states": (outcomes((1.0, 4, 0.0), n_states=2), "next_state: got 4 at (s=0", "in 0..1"),
    "0 states": (outcomes((1.0, 0, 0.0), n_states=0), "n_states: got 0", "whole number of at least 1"),
    "2.5 actions": (outcomes((1.0, 0, 0.0), n_actions=2.5), "n_actions: got 2.5", "whole number"),
    "start that does not exist": (outcomes((1.0, 0, 0.0), start=7), "start: got 7", "0..0"),
    "start in words": (outcomes((1.0, 0, 0.0), start="here"), "start: got 'here'", "integer"),
    "start at the end": (outcomes((1.0, 1, 0.0), start=1), "start: puts probability on a terminal state", "must be 0"),
    "P that is not square": (from_arrays(np.ones((2, 1, 3)), np.ones((2, 1))), "P: got shape (2, 1, 3)", "(S, A, S)"),
    "P in words": (from_arrays("P", 0.0), "P: got 'P'", "numbers"),
    "R of a wrong shape": (from_arrays(np.ones((1, 1, 1)), [1.0]), "R: got shape (1,)", "(1, 1)"),
    "R in words": (from_arrays(np.ones((1, 1, 1)), [["+1"]] and "one"), "R: got 'one'", "numbers"),
    "P without states": (from_arrays(np.ones((0, 1, 0)), np.ones((0, 1))), "P: got shape (0, 1, 0)", "(S, A, S)"),
    "P of zeros": (from_arrays([[[0.0]]], [[0.0]]), "legal: no action at (s=0)", "at least one"),
    "P with nan": (from_arrays([[[nan, -1.0]], [[0, 1]]], [[0.0], [0.0]]), "P: contains nan", "probabilities"),
    "P negative": (from_arrays([[[0.0, -1.0]], [[0, 1]]], [[0.0], [0.0]]), "P: contains -1", "probabilities"),
    "P with inf": (from_arrays([[[np.inf, 1.0]], [[0, 1]]], [[0.0], [0.0]]), "P: contains inf", "probabilities"),
    "P that sums to a half": (from_arrays([[[0.5]]], [[0.0]]), "prob: sums to 0.5 at (s=0, a=0)", "must be 1"),
    "R that is nan": (from_arrays([[[1.0]]], [[nan]]), "reward: not finite at (s=0, a=0, k=0)", "finite"),
    "terminal of a wrong shape": (
        from_arrays([[[1.0]]], [[0.0]], terminal=[False, True]), "terminal: got shape (2,)", "(1,)",
    ),
    "all states terminal": (from_arrays([[[1.0]]], [[0.0]], terminal=[True]), "terminal: every state", "at least one"),
    "R on a terminal state": (
        from_arrays([[[0, 1.0]], [[0, 0]]], [[0.0], [3.0]], terminal=[False, True]),
        "R: got 3 at (s=1, a=0, s_next=0", "must be 0",
    ),
    "P leaves a terminal state": (
        from_arrays([[[0, 1.0]], [[1.0, 0]]], [[0.0], [0.0]], terminal=[False, True]), "P: got 1 at (s=1, a=0", "0",
    ),
    # environments
    "Blackjack has no table": (
        lambda: FiniteMDP.from_env(gym.make("Blackjack-v1")), "env: BlackjackEnv has no transition table P", "toy-text",
    ),
    "nor has CartPole": (lambda: FiniteMDP.from_env(gym.make("CartPole-v1")), "env: CartPoleEnv has no", "toy-text"),
    "the name of an environment": (lambda: FiniteMDP.from_env("FrozenLake-v1"), "env: str has no", "toy-text"),
    "no environment": (lambda: FiniteMDP.from_env(None), "env: NoneType has no", "toy-text"),
    "a state entered both ways": (
        lambda: FiniteMDP.from_env(Table()), "env: (s=0, a=1) enters the terminal state 1", "terminated=False",
    ),
    "an environment of an environment": (
        lambda: envs.MDPEnv(gym.make("FrozenLake-v1")), "mdp: got", "must be a FiniteMDP",
    ),
    "an illegal step": (lambda: _step(2), "action: got 2 in state 0", "[0, 1]"),
    "a step that does not exist": (lambda: _step(3), "action: got 3", "0..2"),
    "a step without action": (lambda: _step(None), "action: got None", "0..2"),
    # indices
    "state that does not exist": (lambda: ROBOT.p(2, 0.0, 0, 0), "s_next: got 2", "0..1"),
    "state before the first": (lambda: ROBOT.p(0, 0.0, -1, 0), "s: got -1", "0..1"),
    "action that is no integer": (lambda: ROBOT.p(0, 0.0, 0, 0.5), "a: got 0.5", "0..2"),
    "state by its name": (lambda: ROBOT.p("low", 0.0, 0, 0), "s_next: got 'low'", "0..1"),
    # policies
    "policy as actions": (lambda: bellman.solve_policy(ROBOT, [0, 0], 0.9), "pi: got shape (2,)", "(2, 3)"),
    "policy with nan": (lambda: dp.policy_evaluation(ROBOT, PI * nan, 0.9), "pi: row 0 is [nan", "sum to 1"),
    "policy with a negative entry": (
        lambda: bellman.solve_policy(ROBOT, [[1, 0, 0], [1.5, -0.5, 0]], 0.9), "pi: row 1 is [ 1.5 -0.5",
        "probabilities",
    ),
    "policy that does not sum to 1": (
        lambda: dp.policy_iteration(ROBOT, 0.9, pi0=[[1, 0, 0], [0.5, 0, 0]]), "pi0: row 1 is [0.5", "sum to 1",
    ),
    "policy that hardly misses 1": (
        lambda: bellman.solve_policy(ROBOT, [[1, 0, 0], [1 + 5e-9, 0, 0]], 0.9), "pi: row 1 is [1.", "sum to 1",
    ),
    "policy with an illegal action": (
        lambda: bellman.expectation_backup(ROBOT, ILLEGAL, 0.0, 0.9), "pi: probability on an action that is not legal",
        "(s=0, a=2)",
    ),
    "policy to improve": (
        lambda: dp.policy_improvement(ROBOT, 0.0, 0.9, pi=ILLEGAL), "pi: probability on an action", "(s=0, a=2)",
    ),
    "learning under an illegal policy": (
        lambda: td.td0(ROBOT, ILLEGAL, 0.9, 1, alpha=0.1, max_steps=3, rng=RNG), "pi: probability on an action that",
        "(s=0, a=2)",
    ),
    "traces under an illegal policy": (
        lambda: traces.td_lambda(ROBOT, ILLEGAL, 0.9, 0.5, 1, alpha=0.1, max_steps=3, rng=RNG), "pi: probability on",
        "(s=0, a=2)",
    ),
    "policy in words": (lambda: bellman.is_proper(ROBOT, "uniform"), "pi: got 'uniform'", "numbers"),
    "no policy": (lambda: bellman.policy_matrix(ROBOT, None), "pi: got None", "numbers"),
    "actions of a wrong length": (lambda: mdp.deterministic_policy(ROBOT, [0]), "actions: got shape (1,)", "(2,)"),
    "actions that are floats": (lambda: mdp.deterministic_policy(ROBOT, [0.0, 1.0]), "actions: got dtype", "integers"),
    "action out of range": (lambda: mdp.deterministic_policy(ROBOT, [0, 3]), "actions: got 0..3", "0..2"),
    "action before the first": (lambda: mdp.deterministic_policy(ROBOT, [0, -1]), "actions: got -1..0", "0..2"),
    "illegal action": (lambda: mdp.deterministic_policy(ROBOT, [2, 0]), "actions: got 2 in state 0", "legal: [0 1]"),
    "environment for a process": (
        lambda: uniform_policy(gym.make("FrozenLake-v1")), "mdp: got", "must be a FiniteMDP",
    ),
    "environment to solve": (lambda: dp.policy_iteration(envs.MDPEnv(ROBOT), 0.9), "mdp: got MDPEnv", "FiniteMDP"),
    "nothing to evaluate": (lambda: dp.policy_evaluation(None, PI, 0.9), "mdp: got NoneType", "FiniteMDP"),
    "nothing to look ahead in": (lambda: bellman.q_from_v(None, 0.0, 0.9), "mdp: got NoneType", "FiniteMDP"),
    "nothing to act in": (lambda: mdp.deterministic_policy(None, [0]), "mdp: got NoneType", "FiniteMDP"),
    "nothing to back up": (lambda: bellman.optimality_backup_q(None, PI, 0.9), "mdp: got NoneType", "FiniteMDP"),
    "nothing to search": (lambda: bellman.heuristic_search(None, 0, 1, 0.9), "mdp: got NoneType", "FiniteMDP"),
    "weights for another table": (lambda: bellman.v_from_q(np.zeros((2, 2)), PI), "pi: got shape (2, 3)", "(2, 2)"),
    "negative weights": (lambda: bellman.v_from_q([[0.0, 1.0]], [[2.0, -1.0]]), "pi: contains -1", "probabilities"),
    "weights nan": (lambda: bellman.v_from_q([[0.0]], [[nan]]), "pi: contains nan", "probabilities"),
    # gamma
    "gamma above 1": (lambda: bellman.solve_policy(ROBOT, PI, 1.1), "gamma: got 1.1", "[0, 1]"),
    "gamma below 0": (lambda: dp.policy_iteration(ROBOT, -0.1), "gamma: got -0.1", "[0, 1]"),
    "gamma nan": (lambda: dp.value_iteration(ROBOT, nan), "gamma: got nan", "[0, 1]"),
    "gamma None": (lambda: bellman.q_from_v(ROBOT, 0.0, None), "gamma: got None", "[0, 1]"),
    "gamma in words": (lambda: mdp.discounted_returns([1.0], "0.9"), "gamma: got '0.9'", "[0, 1]"),
    "gamma to evaluate": (lambda: dp.policy_evaluation(ROBOT, PI, "0.9"), "gamma: got '0.9'", "[0, 1]"),
    "gamma to iterate policies": (lambda: dp.policy_iteration(ROBOT, "0.9"), "gamma: got '0.9'", "[0, 1]"),
    "gamma to iterate values": (lambda: dp.value_iteration(ROBOT, "0.9"), "gamma: got '0.9'", "[0, 1]"),
    "gamma as an array": (lambda: mdp.discounted_return([1.0], np.array([0.9])), "gamma: got array", "[0, 1]"),
    "gamma of a search": (lambda: bellman.heuristic_search(ROBOT, 0, 2, 2), "gamma: got 2", "[0, 1]"),
    "gamma of solve": (lambda: solve(ROBOT, 1.5), "gamma: got 1.5", "[0, 1]"),
    "gamma of Newton": (lambda: bellman.newton_optimality(ROBOT, inf, 1), "gamma: got inf", "[0, 1]"),
    "pi never ends": (lambda: dp.policy_evaluation(ROBOT, PI, 1.0), "pi: never terminates from state 0", "gamma = 1"),
    "no end to plan for": (lambda: dp.value_iteration(loop(), 1.0), "gamma: got 1, but no policy terminates", "0"),
    "iteration meets a policy without end": (
        lambda: dp.policy_iteration(stay_or_go(), 1, pi0=[[1, 0], [1, 0]]), "pi: never terminates from state 0", "= 1",
    ),
    # values
    "V of a wrong length": (lambda: bellman.optimality_backup(ROBOT, [1.0] * 3, 0.9), "V: got shape (3,)", "(2,)"),
    "V that is a table": (lambda: bellman.q_from_v(ROBOT, PI, 0.9), "V: got shape (2, 3)", "a number or (2,)"),
    "V with nan": (lambda: dp.policy_improvement(ROBOT, [nan, 0.0], 0.9), "V: contains nan", "finite"),
    "V in words": (lambda: bellman.q_from_v(ROBOT, "zero", 0.9), "V: got 'zero'", "numbers"),
    "V0 of a wrong length": (lambda: dp.value_iteration(ROBOT, 0.9, V0=[0.0]), "V0: got shape (1,)", "(2,)"),
    "V0 infinite": (lambda: dp.policy_evaluation(ROBOT, PI, 0.9, V0=[0.0, -inf]), "V0: contains -inf", "finite"),
    "V0 of a search": (lambda: bellman.heuristic_search(ROBOT, 0, 1, 0.9, V0=nan), "V0: contains nan", "finite"),
    "V to bound": (lambda: dp.error_bound(ROBOT, inf, 0.9), "V: contains inf", "finite"),
    "infinite V to bound for pi": (lambda: dp.policy_error_bound(ROBOT, PI, inf, 0.9), "V: contains inf", "finite"),
    "V to bound for pi": (lambda: dp.policy_error_bound(ROBOT, PI, [0.0], 0.9), "V: got shape (1,)", "(2,)"),
    "Q of a wrong shape": (lambda: bellman.optimality_backup_q(ROBOT, PI.T, 0.9), "Q: got shape (3, 2)", "(2, 3)"),
    "Q with nan": (lambda: bellman.expectation_backup_q(ROBOT, PI, ONE_NAN, 0.9), "Q: contains NaN", "numbers"),
    "Q that is a row": (lambda: bellman.greedy([1.0, 2.0]), "Q: got shape (2,)", "(S, A)"),
    "Q without actions": (lambda: bellman.greedy_actions(np.zeros((2, 0))), "Q: got shape (2, 0)", "(S, A)"),
    "Q with nan to act on": (lambda: bellman.greedy(ONE_NAN), "Q: got shape (2, 3) with NaN", "numbers"),
    "Q in words": (lambda: bellman.greedy("best"), "Q: got 'best'", "numbers"),
    "Q in words to back up": (lambda: bellman.optimality_backup_q(ROBOT, "Q", 0.9), "Q: got 'Q'", "numbers"),
    "a margin without end": (lambda: bellman.greedy_actions([[0.0]], tol=inf), "tol: got inf", "at least 0"),
    "a margin in words": (lambda: bellman.greedy_actions([[0.0]], tol="none"), "tol: got 'none'", "at least 0"),
    "a margin below 0": (lambda: bellman.greedy_actions([[0.0]], tol=-1.0), "tol: got -1.0", "at least 0"),
    # how much
    "tol 0": (lambda: dp.policy_evaluation(ROBOT, PI, 0.9, tol=0), "tol: got 0", "positive"),
    "tol negative": (lambda: dp.value_iteration(ROBOT, 0.9, tol=-1), "tol: got -1", "positive"),
    "tol infinite": (lambda: dp.value_iteration(ROBOT, 0.9, tol=inf), "tol: got inf", "positive"),
    "tol nan": (lambda: dp.value_iteration(ROBOT, 0.9, tol=nan), "tol: got nan", "positive"),
    "tol in words": (lambda: dp.value_iteration(ROBOT, 0.9, tol="small"), "tol: got 'small'", "positive"),
    "tol of solve": (lambda: solve(ROBOT, 0.9, tol=0.0), "tol: got 0.0", "positive"),
    "max_iter 0": (lambda: dp.value_iteration(ROBOT, 0.9, max_iter=0), "max_iter: got 0", "at least 1"),
    "max_iter 1.5": (lambda: dp.policy_evaluation(ROBOT, PI, 0.9, max_iter=1.5), "max_iter: got 1.5", "whole number"),
    "max_iter None": (lambda: dp.policy_iteration(ROBOT, 0.9, max_iter=None), "max_iter: got None", "whole number"),
    "max_iter infinite": (lambda: dp.policy_iteration(ROBOT, 0.9, max_iter=inf), "max_iter: got inf", "whole number"),
    "V0 of Newton": (lambda: bellman.newton_optimality(ROBOT, 0.9, 1, V0=nan), "V0: contains nan", "finite"),
    "n_iter of Newton": (lambda: bellman.newton_optimality(ROBOT, 0.9, 0), "n_iter: got 0", "at least 1"),
    "depth 0": (lambda: bellman.heuristic_search(ROBOT, 0, 0, 0.9), "depth: got 0", "at least 1"),
    "search from nowhere": (lambda: bellman.heuristic_search(ROBOT, 5, 1, 0.9), "s: got 5", "0..1"),
    # returns and trajectories
    "rewards as a table": (lambda: mdp.discounted_returns([[1.0]], 0.9), "rewards: got shape (1, 1)", "(T,)"),
    "rewards with nan": (lambda: mdp.discounted_return([1.0, nan], 0.9), "rewards: contains", "finite"),
    "rewards in words": (lambda: mdp.discounted_return(["one"], 0.9), "rewards: got ['one']", "numbers"),
    "t after the end": (lambda: mdp.discounted_return([1.0], 0.9, t=2), "t: got 2", "0..1"),
    "t before the start": (lambda: mdp.discounted_return([1.0], 0.9, t=-1), "t: got -1", "0..1"),
    "t between": (lambda: mdp.discounted_return([1.0], 0.9, t=0.5), "t: got 0.5", "0..1"),
    "no steps": (rolled(n_steps=0), "n_steps: got 0", "at least 1"),
    "steps in words": (rolled(n_steps="ten"), "n_steps: got 'ten'", "whole number"),
    "rollout from nowhere": (rolled(s=2), "s: got 2", "0..1"),
    "rollout of an illegal policy": (rolled(pi=ILLEGAL), "pi: probability on an action", "(s=0, a=2)"),
    "rollout without rng": (rolled(rng=None), "rng: got None", "numpy.random.Generator"),
    "rollout with a seed": (rolled(rng=0), "rng: got 0", "numpy.random.Generator"),
    "rollout with the old generator": (
        rolled(rng=np.random.RandomState(0)), "rng: got RandomState", "numpy.random.Generator",  # noqa: NPY002
    ),
    "sampling with a seed": (sampled(rng=1), "rng: got 1", "default_rng"),
    "sampling with the module": (sampled(rng=np.random), "rng: got <module", "default_rng"),
    "no episodes": (sampled(n_episodes=0), "n_episodes: got 0", "at least 1"),
    "half an episode": (sampled(n_episodes=0.5), "n_episodes: got 0.5", "whole number"),
    "max_steps negative": (sampled(max_steps=-5), "max_steps: got -5", "at least 1"),
    "sampling from nowhere": (sampled(s=-1), "s: got -1", "0..1"),
    "sampling an illegal action": (sampled(a=2), "a: got 2, which is not legal in state 0", "[0 1]"),
    "sampling an action that does not exist": (sampled(a=3), "a: got 3", "0..2"),
    "sampling with gamma 2": (sampled(gamma=2.0), "gamma: got 2.0", "[0, 1]"),
    # worlds
    "grid without rows": (lambda: envs.gridworld(0, 4), "n_rows: got 0", "at least 1"),
    "grid with half columns": (lambda: envs.gridworld(4, 4.5), "n_cols: got 4.5", "whole number"),
    "slip above 1": (lambda: envs.gridworld(slip=1.5), "slip: got 1.5", "[0, 1]"),
    "slip nan": (lambda: envs.gridworld(slip=nan), "slip: got nan", "[0, 1]"),
    "terminal off the grid": (lambda: envs.gridworld(terminals=[16]), "terminals: got [16]", "0..15"),
    "terminal as a cell": (lambda: envs.gridworld(terminals=[(0, 1)]), "terminals: got [[0 1]]", "0..15"),
    "terminal between cells": (lambda: envs.gridworld(terminals=[0.5]), "terminals: got dtype float64", "integers"),
    "every cell terminal": (lambda: envs.gridworld(1, 1, terminals=[0]), "terminals: got [0]", "left out"),
    "grid with reward nan": (lambda: envs.gridworld(reward=nan), "reward: got nan", "finite"),
    "alpha of the robot": (lambda: envs.recycling_robot(alpha=1.2), "alpha: got 1.2", "[0, 1]"),
    "beta of the robot": (lambda: envs.recycling_robot(beta="high"), "beta: got 'high'", "[0, 1]"),
    "reward of the robot": (lambda: envs.recycling_robot(r_wait="one"), "r_wait: got 'one'", "number"),
    "walk of no states": (lambda: envs.random_walk(0), "n: got 0", "at least 1"),
    "walk with three rewards": (lambda: envs.random_walk(5, rewards=(0, 1, 2)), "rewards: got [0. 1. 2.]", "two"),
    "walk from the end": (lambda: envs.random_walk(5, start=0), "start: puts probability on a terminal state", "0"),
    "grid beyond memory": (lambda: envs.gridworld(10**6, 10**6), "n_cols: needs an array of 1000000 x", "at most"),
    "maze beyond memory": (
        lambda: envs.maze(10**4, 10**4, start=(0, 0), goals={(1, 1): 1.0}), "n_cols: needs an array of 10000 x", "most",
    ),
    "walk beyond memory": (lambda: envs.random_walk(10**8), "n: got 100000000", "at most 1,000,000"),
    "long jumps": (lambda: envs.jumping_walk(10**6, 10**3), "reach: needs an array of 1000000 x 2", "at most"),
    "dense process beyond memory": (lambda: envs.random_mdp(10**5, 2, rng=RNG), "n_states: needs an array", "at most"),
    "sparse process beyond memory": (
        lambda: envs.random_mdp(10**6, 2, n_next=10**3, rng=RNG), "n_next: needs an array", "at most",
    ),
    "branches beyond memory": (lambda: envs.branching_mdp(10**6, 10**4, rng=RNG), "n_next: needs an array", "at most"),
    "line beyond memory": (lambda: envs.golf_line(10**9), "putter: needs an array of 1000000000", "at most"),
    "course beyond memory": (
        lambda: envs.golf_course(shape=(900, 900), putter=300), "putter: needs an array of 900 x 900", "at most",
    ),
    "wide scatter": (lambda: envs.golf_course(scatter=100), "scatter: needs an array of 341 x", "at most"),
    "a board too large": (lambda: envs.game_values(4, 4), "cols: got 4 and 4 rows", "at most 12 cells"),
    "states beyond memory": (outcomes((1.0, 0, 0.0), n_states=10**9), "n_states: needs an array of 1000000000", "most"),
    "actions beyond memory": (outcomes((1.0, 0, 0.0), n_actions=10**9), "n_actions: needs an array of 1 x", "at most"),
    "a count beyond use": (lambda: envs.gridworld(10**10, 1), "n_rows: got 10000000000", "at most 1,000,000,000"),
    "a number beyond floats": (lambda: envs.zero_loop(reward=10**400), "reward: got 1000", "finite number"),
    "wall that is a number": (lambda: envs.dyna_maze(walls=3), "walls: got 3", "cells (row, column)"),
    "wall of three numbers": (lambda: envs.dyna_maze(walls=[(1, 2, 3)]), "walls: got cell (1, 2, 3)", "(row, column)"),
    "goal that is a number": (lambda: envs.dyna_maze(goal=3), "goal: got cell 3", "(row, column)"),
    "goals that are a list": (
        lambda: envs.maze(2, 2, start=(0, 0), goals=[(0, 1)]), "goals: got [(0, 1)]", "{cell: reward}",
    ),
    "a seed below 0": (lambda: envs.MDPEnv(ROBOT).reset(seed=-1), "seed: got -1", "at least 0"),
    "a push that is none": (
        lambda: envs.pole_balancing(lambda x, rng: 2, 1, max_steps=5, rng=RNG), "policy: got 2", "0..1",
    ),
    "pushes of three": (lambda: envs.push_pole([0, 2]), "pushes: got array([0, 2])", "0 and 1"),
    "a class for a function": (lambda: envs.balance(int, rng=RNG), "choose: got <class 'int'>", "a function of"),
    "poles of three numbers": (lambda: envs.cartpole_step(np.zeros((2, 3)), 0), "x: got shape (2, 3)", "(..., 4)"),
    "targets that do not fit": (
        lambda: td.td_error([1.0, 2.0], 0.0, [1.0, 2.0, 3.0], 0.9), "V_next: got shape (3,)", "fit to [(2,), ()]",
    ),
    "a reward that is nan": (lambda: td.td_target(nan, 0.0, 0.9), "r: contains nan", "finite"),
    "an end that is 2": (lambda: td.td_target(1.0, 0.0, 0.9, 2), "terminated: got 2", "True or False"),
    "nothing to repeat": (lambda: repeat("td0", n_runs=2, rng=RNG), "method: got 'td0'", "a function of"),
    "nothing to update": (
        lambda: first_updates(None, ROBOT, 0.9, 1, alpha=0.1, epsilon=0.1, rng=RNG), "method: got None", "function",
    ),
    "too many trajectories": (lambda: trajectories(ROBOT, PI, 12), "T: got 12, makes 6^12", "at most"),
    "a state that is not there": (
        lambda: trajectory_probability(ROBOT, PI, [0, 2], [0, 0]), "states: got array([0, 2])", "0..1",
    ),
    "an action for each state": (
        lambda: trajectory_probability(ROBOT, PI, [0, 1], [0]), "actions: got array([0])", "(2,)",
    ),
    "start without life": (
        lambda: reinforce_linear(lambda rng: np.ones(1), np.add, lambda x: False, 2, 0.9, 1, alpha=0.1, rng=RNG),
        "start: gave a state", "alive",
    ),
    "a scale for another state": (
        lambda: reinforce_linear(
            lambda rng: np.ones(2), np.add, np.all, 2, 0.9, 1, alpha=0.1, scale=[1.0, 2.0, 3.0], rng=RNG
        ), "scale: got 3 numbers", "2 of a state",
    ),
    "columns of two lengths": (
        lambda: replay(Transitions([0, 1], [0], [0.0], [1]), 2, 2, 0.9, alpha=0.1), "data: got columns", "(n,)",
    ),
    "a model of too few numbers": (
        lambda: linear_dynamics(np.ones((2, 2)), [[0.0, 0.0]], [0]), "W: got shape (2, 2)", "at least one action",
    ),
    "random process of no states": (lambda: envs.random_mdp(0, 2, rng=RNG), "n_states: got 0", "at least 1"),
    "random process from a seed": (lambda: envs.random_mdp(3, 2, rng=0), "rng: got 0", "default_rng"),
    "random process without successors": (lambda: envs.random_mdp(3, 2, n_next=0, rng=RNG), "n_next: got 0", "least 1"),
    "random process without spread": (
        lambda: envs.random_mdp(3, 2, concentration=0, rng=RNG), "concentration: got 0", "positive",
    ),
}  # fmt: skip


def _step(action):
    env = envs.MDPEnv(ROBOT)
    env.reset(seed=0)
    env.step(action)


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_named(name):
    call, begins, says = CASES[name]
    with pytest.raises(ValueError) as error:
        call()
    message = str(error.value)
    assert message.startswith(begins) and says in message[len(begins.split(":")[0]) :], message
    assert re.match(r"\w+: ", message)


def test_there_are_many_bad_calls():
    calls = [begins for _, begins, _ in CASES.values()]
    assert len(calls) >= 60 and len({begins.split(":")[0] for begins in calls}) >= 30


def test_rng_is_required():
    for call in (
        lambda: mdp.rollout(ROBOT, PI, 3),
        lambda: mdp.sample_returns(ROBOT, PI, 0.9, 2, s=0, max_steps=3),
        lambda: envs.random_mdp(3, 2),
    ):
        with pytest.raises(TypeError, match=r"^\w+\(\) missing .*required .*argument: 'rng'"):
            call()


def test_a_learner_that_is_called_amiss_says_its_name():
    for call, says in (
        (lambda: td.td0(ROBOT, PI, 0.9, 1, rng=RNG), r"td0\(\) missing a required argument: 'alpha'"),
        (lambda: td.td0(ROBOT, PI, 0.9, 1, 0.1, rng=RNG), r"td0\(\) too many positional arguments"),
        (lambda: td.q_learning(ROBOT, pi=PI), r"q_learning\(\) missing a required argument: 'gamma'"),
        (lambda: td.td0(ROBOT, PI, 0.9, 1, alpha=0.1, world=ROBOT, rng=RNG), r"td0\(\) multiple values .* 'world'"),
        (
            lambda: td.td0(ROBOT, PI, 0.9, 1, alpha=0.1, groups=[0, 0], rng=RNG),
            r"td0\(\) got an unexpected .*'groups'",
        ),
        (lambda: dp.value_iteration(ROBOT, gama=0.9), r"value_iteration\(\) .*'gam"),
    ):
        with pytest.raises(TypeError, match=f"^{says}"):
            call()


def test_good_input_of_unusual_types_is_accepted():
    m = awkward()
    pi = uniform_policy(m)
    V = bellman.solve_policy(m, pi.tolist(), np.float32(0.5))
    assert np.array_equal(V, bellman.solve_policy(m, pi, 0.5))
    assert dp.value_iteration(m, 0, max_iter=np.int64(3)).converged
    assert m.p(np.int64(1), 2, np.uint8(0), 0.0) == 0.5
    assert mdp.discounted_return((1, 2), np.int64(1)) == 3.0
    assert not envs.gridworld(terminals=[]).terminal.any()
    assert envs.gridworld(terminals=np.array([3])).terminal[3]


@pytest.mark.parametrize("value", ["fast", None, 0.0, 1.5, True])
def test_a_step_size_that_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match=f"^alpha: got {value!r}, must be in \\(0, 1\\]"):
        check_rate("alpha", value)


NO_NUMBERS = [True, np.True_, "1", None, [1.0], 1j]
TAKES_A_NUMBER = {
    "gamma": lambda x: bellman.q_from_v(ROBOT, 0.0, x),
    "n": lambda x: check_count("n", x),
    "s": lambda x: ROBOT.p(0, 0.0, x, 0),
    "tol": lambda x: dp.value_iteration(ROBOT, 0.9, tol=x),
    "tol of ties": lambda x: bellman.greedy_actions(np.zeros((1, 2)), tol=x),
    "tol of solve": lambda x: solve(ROBOT, 0.9, tol=x),
    "tol of batches": lambda x: batch_td([([0, 1], [1.0])], 2, 0.9, alpha=0.1, tol=x),
    "alpha": lambda x: check_schedule("alpha", x),
    "epsilon": lambda x: check_schedule("epsilon", x),
    "first": lambda x: decaying(x),
    "rate": lambda x: decaying(1.0, rate=x),
    "power": lambda x: decaying(1.0, power=x),
    "floor": lambda x: decaying(1.0, floor=x),
    "alpha of TD": lambda x: td.td0(ROBOT, PI, 0.9, 1, alpha=x, max_steps=3, rng=RNG),
    "lam": lambda x: traces.td_lambda(ROBOT, PI, 0.9, x, 1, alpha=0.1, max_steps=3, rng=RNG),
    "n_episodes": lambda x: td.td0(ROBOT, PI, 0.9, x, alpha=0.1, max_steps=3, rng=RNG),
    "kappa": lambda x: dyna_q(ROBOT, 0.9, 1, n_planning=1, alpha=0.1, epsilon=0.1, kappa=x, max_steps=3, rng=RNG),
    "w0": lambda x: td0_groups(ROBOT, PI, 0.9, 1, groups=[0, 0], alpha=0.1, w0=x, max_steps=3, rng=RNG),
    "concentration": lambda x: envs.random_mdp(2, 2, concentration=x, rng=RNG),
    "n_states": lambda x: cost_of_a_sweep(x),
    "alpha of bluffs": lambda x: bluff_learning(0.5, 0.4, 1, alpha=x),
    "epsilon of samples": lambda x: spread_updates(ROBOT, 0.9, 1, where="uniform", epsilon=x, rng=RNG),
    "alpha of ascent": lambda x: gradient_ascent(ROBOT, np.zeros((3, 2)), 0.9, 1, alpha=x),
    "p_min": lambda x: softmax_policy(np.zeros((2, 1)), p_min=x),
    "alpha of chapter 3": lambda x: reinforce_linear(print, print, print, 2, 0.9, 1, alpha=x, rng=RNG),
}


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize("name", TAKES_A_NUMBER)
def test_what_is_no_number_is_refused(name, value):
    argument = name.partition(" of ")[0]
    with pytest.raises(ValueError, match=rf"^{argument}: .*must be"):
        TAKES_A_NUMBER[name](value)


@pytest.mark.parametrize("values", ["1", None, True, 1j, [1.0, None], ["1", "2"], [True, False], [[1.0], [1.0, 2.0]]])
def test_what_are_no_numbers_are_refused(values):
    for name, call in {
        "V": lambda: bellman.q_from_v(ROBOT, values, 0.9),
        "V0": lambda: td.td0(ROBOT, PI, 0.9, 1, alpha=0.1, V0=values, max_steps=3, rng=RNG),
        "Q0": lambda: td.q_learning(ROBOT, 0.9, 1, alpha=0.1, epsilon=0.1, Q0=values, max_steps=3, rng=RNG),
        "pi": lambda: td.td0(ROBOT, values, 0.9, 1, alpha=0.1, max_steps=3, rng=RNG),
        "rewards": lambda: mdp.discounted_returns(values, 0.9),
        "reward": arrays(reward=values),
        "R": from_arrays(np.ones((1, 1, 1)), values),
        "P": from_arrays(values, 0.0),
        "x": lambda: as_floats("x", values),
    }.items():
        with pytest.raises(ValueError, match=rf"^{name}: got .*, must be numbers"):
            call()


def test_numbers_of_any_kind_are_taken_for_numbers():
    for values in ([1, 2.5], (1, 2), [Fraction(1, 2), 3], np.array([1, 2], np.uint8), [], np.float32(3), 7):
        found = as_floats("x", values)
        assert found.dtype == np.float64 and found.tolist() == np.array(values).tolist()
    x = np.array([1.0, 2.0])
    assert as_floats("x", x) is x


@pytest.mark.parametrize("value", [0, 1, 1.0, "yes", None, [True], np.array([True, False])], ids=repr)
def test_a_flag_is_true_or_false(value):
    step = dict(alpha=0.1, max_steps=3, rng=RNG)
    for name, call in {
        "first_visit": lambda: mc_prediction(ROBOT, PI, 0.9, 1, first_visit=value, max_steps=3, rng=RNG),
        "online": lambda: traces.td_lambda(ROBOT, PI, 0.9, 0.5, 1, online=value, **step),
        "in_place": lambda: dp.value_iteration(ROBOT, 0.9, in_place=value),
        "per_step": lambda: decaying(1.0, per_step=value),
    }.items():
        with pytest.raises(ValueError, match=rf"^{name}: got .*, must be True or False"):
            call()
    assert decaying(1.0, per_step=np.True_).per_step is True


@pytest.mark.parametrize("value", [10**9 + 1, 1e12, 2**70, inf], ids=repr)
def test_a_count_is_at_most_a_thousand_million(value):
    says = "of at least" if value == inf else "of at most 1,000,000,000"
    step = dict(alpha=0.1, rng=RNG)
    for name, call in {
        "n_episodes": lambda: td.td0(ROBOT, PI, 0.9, value, max_steps=3, **step),
        "max_steps": lambda: td.td0(ROBOT, PI, 0.9, 1, max_steps=value, **step),
        "record": lambda: td.td0(ROBOT, PI, 0.9, 1, max_steps=3, record=value, **step),
        "n": lambda: n_step_td(ROBOT, PI, 0.9, value, 1, max_steps=3, **step),
        "n_planning": lambda: dyna_q(ROBOT, 0.9, 1, n_planning=value, epsilon=0.1, max_steps=3, **step),
        "max_iter": lambda: dp.value_iteration(ROBOT, 0.9, max_iter=value),
    }.items():
        with pytest.raises(ValueError, match=rf"^{name}: got .*, must be a whole number {says}"):
            call()
    assert check_count("n", 1e9) == 10**9


@pytest.mark.parametrize("value", [1.5, -0.1, nan, inf])
def test_a_floor_is_a_probability(value):
    with pytest.raises(ValueError, match=rf"^floor: got {value}, must be a number in \[0, 1\]"):
        decaying(1.0, floor=value)


def test_an_argument_without_a_rule_is_refused_where_it_is_written():
    with pytest.raises(TypeError, match=r"<lambda>: no rule for the argument colour$"):
        checked(lambda gamma, colour: None)
    with pytest.raises(TypeError, match="no rule for the argument colour"):

        @learner(tuple)
        def paint(world, gamma, colour, *, rng):
            return (colour,)

    def shade(gamma, colour, *, depth=None):
        return gamma, colour, depth

    assert checked(colour=anything)(shade)(1, "red") == (1.0, "red", None)
    assert checked(shade, colour=anything)(0.5, None, depth=2.0) == (0.5, None, 2)
    with pytest.raises(ValueError, match="^depth: got 0, must be a whole number of at least 1"):
        checked(shade, colour=anything)(0.5, None, depth=0)


@pytest.mark.parametrize("value", [True, [1.0], ("value",)])
def test_a_baseline_that_is_no_number_is_refused(value):
    with pytest.raises(ValueError, match="^baseline: got"):
        reinforce(ROBOT, 0.9, 1, max_steps=2, baseline=value, rng=RNG)


@pytest.mark.parametrize("row", [(True, 0, 1.0), (1.0, True, 1.0), (1.0, 0, True)])
def test_truth_values_are_no_outcomes(row):
    with pytest.raises(ValueError, match="^outcomes: got"):
        FiniteMDP.from_outcomes({(0, 0): [row]})
    with pytest.raises(ValueError, match="^outcomes: got key"):
        FiniteMDP.from_outcomes({(False, 0): [(1.0, 0, 1.0)]})


@pytest.mark.parametrize("x", [[0.5, -0.5], [0.5, 1.5], -1e-9, [np.nan, 0.5]])
def test_every_probability_is_looked_at(x):
    with pytest.raises(ValueError, match=r"^x: got .*, must be in \[0, 1\]"):
        bluff_guarantee(x)
    assert np.shape(bluff_guarantee([0.0, 1.0])) == (2,)
