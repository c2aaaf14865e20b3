"""Half a street of poker, in which whoever never bluffs, or always does, gives money away."""

import numpy as np

from rlcore.mdp import as_floats, check_count, check_probability, is_number

__all__ = ["bluff_gradients", "bluff_guarantee", "bluff_learning", "bluff_values"]

POT, BET = 2.0, 1.0


def bluff_values(x, y):
    """Expected gain of the bettor, who bluffs with probability x while the other calls with probability y. ex-bluff

    The pot is 2, the bet 1. The bettor has the better hand half of the time, and then bets; with the worse it bets
    (bluffs) or checks and loses the pot. Equilibrium: x = 1/3, y = 2/3, value 4/3. x, y: numbers or arrays in [0, 1].
    Source: von Neumann and Morgenstern (1944), chapter 19, in spirit.
    """
    x, y = _probabilities(x=x, y=y)
    good = y * (POT + BET) + (1 - y) * POT
    bad = x * (-y * BET + (1 - y) * POT)
    return 0.5 * good + 0.5 * bad


def bluff_guarantee(x):
    """What bluffing with probability x gains against the caller who does best against it. ex-bluff"""
    return np.minimum(bluff_values(x, 0.0), bluff_values(x, 1.0))


def bluff_gradients(x, y):
    """Derivatives of each player's own gain with respect to its preference for bluffing, for calling. ex-bluff

    Both are softmax policies of two actions: x = 1 / (1 + exp(-theta)), and y alike.
    """
    x, y = _probabilities(x=x, y=y)
    d_x = 0.5 * (POT - y * (POT + BET))
    d_y = -0.5 * (BET - x * (POT + BET))
    return x * (1 - x) * d_x, y * (1 - y) * d_y


def bluff_learning(x, y, n_steps, *, alpha, epsilon=None, caller="gradient"):
    """Both players learn with exact gradients, the bettor first: (n_steps + 1, 2) probabilities x, y. ex-bluff, cl-102

    x, y: start, inside (0, 1). caller: "gradient", or "best" for one who always answers with what is best against x.
    epsilon: instead, each player takes the action that is better against the other's last policy with probability
    1 - epsilon / 2; alpha does not matter then. Of two learning players the policies circle the equilibrium; their mean
    goes to it. Against the best caller x itself does, up to alpha.
    """
    if caller not in ("gradient", "best"):
        raise ValueError(f'caller: got {caller!r}, allowed are "gradient" and "best"')
    if not is_number(alpha) or not 0 < alpha < np.inf:
        raise ValueError(f"alpha: got {alpha!r}, must be a number above 0")
    epsilon = None if epsilon is None else check_probability("epsilon", epsilon)
    x, y = _probabilities(x=x, y=y)
    if not (0 < x < 1 and 0 < y < 1):
        raise ValueError(f"x, y: got {x}, {y}, must be inside (0, 1): at the ends the gradient is 0")
    theta, history = [np.log(p / (1 - p)) for p in (x, y)], [(x, y)]
    for _ in range(check_count("n_steps", n_steps)):
        for player in (0, 1):
            slope = bluff_gradients(x, y)[player]
            theta[player] += alpha * slope
            p = 1 / (1 + np.exp(-theta[player]))
            if epsilon is not None:
                p = 1 - epsilon / 2 if slope > 0 else epsilon / 2
            if player == 1 and caller == "best":
                p = float(bluff_values(x, 1.0) < bluff_values(x, 0.0))
            x, y = (p, y) if player == 0 else (x, p)
        history.append((x, y))
    return np.array(history, float)


def _probabilities(**values):
    for name, p in values.items():
        values[name] = p = as_floats(name, p)
        if not ((p >= 0) & (p <= 1)).all():
            raise ValueError(f"{name}: got {p}, must be in [0, 1]")
    return values.values()
