"""Every algorithm of the companion, implemented once: `from rlcore import q_learning`.

INDEX says in which module each stands, chapter by chapter, TOOLS what else a user calls; a name is loaded when it is
first asked for. Where a module and its algorithm share a name (reinforce, actor_critic, ppo, trpo, gae, explore,
sweep), `rlcore.ppo` is the module and `rlcore.ppo.ppo` the algorithm.
"""

import importlib

__version__ = "0.1.0"

INDEX = {
    1: {
        "mdp": "FiniteMDP uniform_policy deterministic_policy discounted_return discounted_returns rollout "
        "sample_returns",
        "monte_carlo": "mc_prediction constant_alpha_mc",
    },
    2: {
        "bellman": "q_from_v v_from_q expectation_backup optimality_backup greedy solve_policy newton_optimality "
        "heuristic_search error_bound policy_error_bound",
    },
    3: {
        "dp": "policy_evaluation policy_improvement policy_iteration value_iteration",
        "solver": "solve",
        "planning": "estimate_model certainty_equivalent_control dyna_q",
        "mpc": "fit_linear_dynamics random_shooting",
    },
    4: {
        "td": "td_target td_error td0 sarsa expected_sarsa q_learning",
        "batch": "batch_mc batch_td certainty_equivalence",
        "core.schedules": "decaying",
    },
    5: {
        "nstep": "n_step_return lambda_return n_step_td offline_lambda_return",
        "traces": "td_lambda true_online_td_lambda sarsa_lambda watkins_q_lambda",
    },
    6: {
        "neurons": "neuron sigmoid softmax cross_entropy",
        "nn": "MLP backprop gradient_check sgd step_bump_network",
        "optimizers": "SGD Adam gradient_descent",
        "torchnet": "TorchNet",
    },
    7: {
        "policies": "epsilon_greedy soft_greedy softmax_policy grad_log_softmax",
        "distributions": "Categorical Gaussian",
        "policy_gradient": "policy_gradient_exact gradient_ascent episode_gradient gradient_estimates",
        "reinforce": "reinforce reinforce_network",
        "actor_critic": "actor_critic actor_critic_network",
    },
    8: {
        "trust_region": "lower_bound mm_maximise backtracking_line_search trust_region_ascent",
        "gae": "gae",
        "ppo": "ppo PPOConfig",
        "trpo": "trpo TRPOConfig conjugate_gradient trpo_step",
    },
}
TOOLS = {  # what a user calls beside the algorithms
    "core.running": "Interrupted",
    "judging": "evaluate film interquartile_mean learning_curve",
    "saving": "save load",
}
_ROOMS = (*INDEX.values(), TOOLS)
_LISTED = {name: module for rooms in _ROOMS for module, names in rooms.items() for name in names.split()}
_HOME = {name: module for name, module in _LISTED.items() if name != module}  # rlcore.ppo is the module
__all__ = sorted(_HOME)


def __getattr__(name):
    if name in _HOME:
        return getattr(importlib.import_module(f"rlcore.{_HOME[name]}"), name)
    raise AttributeError(f"rlcore has no {name!r}; rlcore.INDEX lists its algorithms by chapter and module")


def __dir__():
    return sorted({*globals(), *__all__})
