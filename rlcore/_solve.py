"""solve: optimal values and policy, quick at every scale."""


def solve(mdp, gamma, tol=1e-6):
    """Optimal values and policy with a certified sup-norm error of at most tol."""
    from rlcore.dp import value_iteration

    return value_iteration(mdp, gamma, tol=max(tol * (1 - gamma) / 2, 1e-12))
