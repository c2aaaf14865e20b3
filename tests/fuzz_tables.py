"""Good calls of the functions of processes, tables and planning, where the names of ARGUMENTS do not say enough."""

import numpy as np
from fuzz import MDP, PI, model, rng

from rlcore.envs import MDPEnv, golf_line
from rlcore.envs.gym import Catch
from rlcore.planning import dyna_q
from rlcore.td import q_learning, td0

OUTCOMES = {(0, 0): [(0.5, 1, 1.0), (0.5, 0, 0.0)], (0, 1): [(1.0, 2, -1.0)], (1, 0): [(1.0, 2, 2.0)]}
EPISODE = {"states": lambda: [0, 0, 1], "rewards": lambda: [1.0, 0.0, 2.0]}  # ended
WEIGHTS = {"weights": lambda: {1: 0.5, 2: 0.5}}
GOLF = golf_line(4)
POLE = {"x": lambda: np.zeros((2, 4)), "a": lambda: np.array([0, 1])}
LINE = {"x": lambda: np.array([[0.0], [1.0]]), "model": lambda: model, "n_actions": lambda: 2}
SELF = {"self": lambda: MDP}


def played(env):
    env.reset(seed=0)
    return env


def push(x):
    return np.asarray(x)[..., 2] > 0


def policy(state, rng):
    return int(state[2] > 0)


def planned():
    return dyna_q(MDP, 0.9, 3, n_planning=2, alpha=0.5, epsilon=0.1, max_steps=20, rng=rng())


def start(rng):
    return rng.uniform(-0.1, 0.1, 2)


CALLS = {
    "batch.batch_td": {"alpha": lambda: 0.1},
    "bellman.greedy_actions": {"tol": lambda: 0.1},
    "dp.policy_improvement": {"pi": lambda: PI},
    "dp.policy_iteration": {"pi0": lambda: PI},
    "envs.cartpole.balance": {"choose": lambda: push},
    "envs.cartpole.cartpole_step": POLE,
    "envs.cartpole.cartpole_upright": POLE,
    "envs.cartpole.steps_upright": {"choose": lambda: push, "x": lambda: np.zeros((2, 4))},
    "envs.games.game_values": {"rows": lambda: 2, "cols": lambda: 2},
    "envs.golf.golf_course": {
        "shape": lambda: (4, 5), "hole": lambda: (2, 3), "tee": lambda: (1, 0), "sand": lambda: [(0, 1)],
        "driver": lambda: (1, 2), "putter": lambda: 1,
    },
    "envs.grids.gridworld": {"n_rows": lambda: 2, "n_cols": lambda: 3, "terminals": lambda: [0], "slip": lambda: 0.1},
    "envs.grids.maze": {
        "n_rows": lambda: 2, "n_cols": lambda: 3, "walls": lambda: [(0, 1)], "start": lambda: (0, 0),
        "goals": lambda: {(1, 2): 1.0},
    },
    "envs.gym.Catch.reset": {"self": Catch, "seed": lambda: 0},
    "envs.gym.Catch.step": {"self": lambda: played(Catch()), "action": lambda: 1},
    "envs.gym.MDPEnv.action_mask": {"self": lambda: played(MDPEnv(MDP))},
    "envs.gym.MDPEnv.reset": {"self": lambda: MDPEnv(MDP), "seed": lambda: 0},
    "envs.gym.MDPEnv.step": {"self": lambda: played(MDPEnv(MDP)), "action": lambda: 1},
    "envs.robots.arm_motion": {"smoothness": lambda: 0.1},
    "envs.robots.pole_balancing": {"policy": lambda: policy},
    "envs.robots.pole_continuing": {"policy": lambda: policy},
    "envs.robots.pole_return": {"fail_step": lambda: np.array([1.0, 5.0])},
    "envs.robots.push_pole": {"pushes": lambda: [0, 1, 1]},
    "envs.small.branching_mdp": {"n_next": lambda: 2},
    "envs.small.jumping_walk": {"n": lambda: 5, "reach": lambda: 2},
    "envs.small.random_mdp": {"n_next": lambda: 2},
    "envs.small.random_walk": {"rewards": lambda: (0.0, 1.0), "start": lambda: 1},
    "mdp.FiniteMDP": {
        name: lambda name=name: getattr(MDP, name)
        for name in ("next_state", "prob", "reward", "legal", "terminal", "start")
    } | {"state_names": lambda: ("a", "b", "c"), "action_names": lambda: ("x", "y")},
    "mdp.FiniteMDP.expected_reward": SELF,
    "mdp.FiniteMDP.expected_reward_sas": SELF,
    "mdp.FiniteMDP.from_arrays": {
        "P": MDP.transition_probs, "R": MDP.expected_reward, "terminal": lambda: [False, False, True],
        "start": lambda: [1.0, 0.0, 0.0], "state_names": lambda: ("a", "b", "c"), "action_names": lambda: ("x", "y"),
    },
    "mdp.FiniteMDP.from_env": {"env": lambda: MDPEnv(MDP)},
    "mdp.FiniteMDP.from_outcomes": {
        "outcomes": lambda: OUTCOMES, "n_states": lambda: 3, "n_actions": lambda: 2, "start": lambda: 0,
        "state_names": lambda: ("a", "b", "c"), "action_names": lambda: ("x", "y"),
    },
    "mdp.FiniteMDP.p": SELF | {"s_next": lambda: 1, "r": lambda: 1.0, "a": lambda: 0},
    "mdp.FiniteMDP.predecessors": SELF,
    "mdp.FiniteMDP.sampler": SELF,
    "mdp.FiniteMDP.transition_probs": SELF,
    "mdp.FiniteMDP.validate": SELF,
    "mdp.deterministic_policy": {"actions": lambda: [1, 0, 0]},
    "mdp.rollout": {"s": lambda: 0},
    "mdp.sample_returns": {"a": lambda: 1},
    "nstep.complex_backup": WEIGHTS,
    "nstep.error_reduction": {"v": lambda: 0.0},
    "nstep.forward_increments": EPISODE,
    "nstep.lambda_weights": {"T_minus_t": lambda: 3},
    "nstep.n_step_return": {"t": lambda: 0},
    "planning.dyna_q": {"n_planning": lambda: 2, "change": lambda: (3, MDP)},
    "planning.estimate_model": {"legal": lambda: MDP.legal, "terminal": lambda: [2], "start": lambda: 0},
    "mpc.fit_linear_dynamics": {"a": lambda: [0, 1], "x_next": lambda: [[0.1], [1.1]]} | LINE,
    "mpc.linear_dynamics": {"W": lambda: np.ones((3, 1)), "a": lambda: [0, 1]} | LINE,
    "planning.predict": {"run": planned, "a": lambda: 0},
    "mpc.random_shooting": LINE | {
        "cost": lambda: lambda x: (x**2).sum(axis=1), "x": lambda: [0.5], "horizon": lambda: 2,
        "n_candidates": lambda: 3,
    },
    "mpc.simulate": LINE | {"actions": lambda: [[0, 1], [1, 1]]},
    "studies.ch02.best_with_club": {"mdp": lambda: GOLF, "club": lambda: "putter", "Q": lambda: np.zeros((5, 3))},
    "studies.ch02.board_states": {"rows": lambda: 2, "cols": lambda: 2},
    "studies.ch02.cost_of_a_sweep": {"n_states": lambda: 1e20},
    "studies.ch02.putting_values": {"n_sweeps": lambda: 2},
    "studies.ch02.td0_groups": {"groups": lambda: [0, 1, 1]},
    "studies.ch03.reinforce_linear": {
        "start": lambda: start, "step": lambda: lambda x, a: x + a - 0.5, "alive": lambda: lambda x: abs(x).max() < 1,
    },
    "studies.ch03.spread_updates": {"n_updates": lambda: 5, "where": lambda: "uniform"},
    "studies.ch03.trajectory_probability": {"states": lambda: [0, 1], "actions": lambda: [0, 0]},
    "studies.ch04.first_updates": {"method": lambda: q_learning, "n_steps": lambda: 1, "epsilon": lambda: 0.0},
    "studies.ch04.repeat": {
        "method": lambda: td0, "args": lambda: (MDP, PI, 0.9, 2), "n_runs": lambda: 2,
        "settings": lambda: dict(alpha=0.1),
    },
    "studies.ch04.walk_error": {"V": lambda: np.zeros((2, 5)), "truth": lambda: [0.25, 0.5, 0.75]},
    "td.sarsa": {"pi": lambda: None},
    "td.td_error": {"r": lambda: 1.0, "V_next": lambda: [1.0, 2.0], "V": lambda: 0.5, "terminated": lambda: False},
    "td.td_target": {"r": lambda: 1.0, "V_next": lambda: [1.0, 2.0], "terminated": lambda: [False, True]},
    "traces.backward_increments": EPISODE,
    "traces.trace_course": {"visits": lambda: [0, 2]},
    "traces.trace_update": {"e": lambda: [1.0, 0.5], "visited": lambda: [1, 0]},
}  # fmt: skip
