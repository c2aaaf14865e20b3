"""Gradient descent on a function of one variable (chapter 3; chapter 6 has the optimisers of networks)."""

import numpy as np

from rlcore.mdp import check_count, check_function

__all__ = ["gradient_descent"]


def gradient_descent(gradient, v, epsilon, n_steps):
    """v_0 ... v_n of v <- v - epsilon C'(v), shape (n_steps + 1,). fig-11, ex-learning-rate

    gradient: C', a function of one number. v: start. epsilon: the learning rate; a negative one ascends.
    On C(v) = L v^2 / 2 each step multiplies v by 1 - epsilon L: it converges for 0 < epsilon < 2 / L.
    """
    if not np.isfinite(epsilon):
        raise ValueError(f"epsilon: got {epsilon!r}, must be a finite number")
    history, gradient = [float(v)], check_function("gradient", gradient, "a number")
    for _ in range(check_count("n_steps", n_steps)):
        history.append(history[-1] - epsilon * gradient(history[-1]))
    return np.array(history)
