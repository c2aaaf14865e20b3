"""Inventory of up to 1,999 items from sparse matrices: when to order, and how much."""

import numpy as np
from scipy.sparse import csr_matrix

from rlcore.mdp import FiniteMDP
from rlcore.solver import solve

S, ORDERS, DEMAND = 2000, 5 * np.arange(20), np.arange(30)  # all demands are equally likely
P, R = [], np.zeros((S, len(ORDERS)))
for a, order in enumerate(ORDERS):
    stock = np.minimum(np.arange(S) + order, S - 1)
    sold = np.minimum(stock[:, None], DEMAND)
    left = stock[:, None] - sold
    P.append(csr_matrix((np.full(left.size, 1 / DEMAND.size), (np.repeat(np.arange(S), DEMAND.size), left.ravel()))))
    P[a].resize(S, S)
    R[:, a] = 5 * sold.mean(axis=1) - 0.01 * left.mean(axis=1) - 2 * order - 50 * (order > 0)
plan = solve(FiniteMDP.from_arrays(P, R, normalise=True), 0.95)
order = ORDERS[plan.pi.argmax(axis=1)]
print(f"certified to {plan.bound:.0e}; order {order[0]} at 0, nothing from {np.flatnonzero(order == 0)[0]} on")
