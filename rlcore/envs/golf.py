"""Golf: each stroke costs 1; the putter is exact and short, the driver long and inexact."""

import numpy as np

from rlcore.core.checks import check_count
from rlcore.mdp import FiniteMDP

SAND = tuple(
    (r, c) for rows, columns in (((2, 3), (20, 21, 22)), ((7, 8), (22, 23, 24))) for r in rows for c in columns
)


def golf_line(length=12, *, putter=2, driver=5):
    """Golf in one dimension: states are distances 0 (the hole) to `length`, reward -1 a stroke. ex-golf-putter, fig-5

    putter: the ball moves 1 to `putter` towards the hole, as chosen. driver: it moves exactly `driver`, past the hole
    if need be; a drive never holes, a ball that would is left at distance 1. Start at the far end.
    """
    length, putter, driver = (check_count(n, v) for n, v in dict(length=length, putter=putter, driver=driver).items())
    outcomes = {}
    for d in range(1, length + 1):
        for step in range(1, min(putter, d) + 1):
            outcomes[d, step - 1] = [(1.0, d - step, -1.0)]
        if abs(d - driver) <= length:
            outcomes[d, putter] = [(1.0, abs(d - driver) or 1, -1.0)]
    names = [f"putter {step + 1}" for step in range(putter)] + [f"driver {driver}"]
    return FiniteMDP.from_outcomes(outcomes, n_actions=putter + 1, start=length, action_names=names)


def golf_course(
    *, shape=(11, 31), hole=(5, 26), tee=(5, 4), sand=SAND, putter=4, driver=(3, 11), scatter=1, with_driver=True
):
    """A golf hole seen from above: cells numbered row by row, reward -1 a stroke. fig-5, ex-golf-driver, cl-018

    putter: reaches any cell at a distance of at most this, exactly; in sand it does not move the ball.
    driver: (nearest, farthest) distance of the cell aimed at; the ball lands on any of the (2 scatter + 1)^2 cells
    around it with equal chance, or on the edge of the grid where that is outside. A drive never holes: a ball on the
    hole rolls one cell on. Actions are named "putter +0 -2": rows down, columns to the right.
    Source: built after the contours of Sutton and Barto (2018), figure 3.3; the geometry is this book's own.
    """
    cell = _check_course(shape, hole=[hole], tee=[tee], sand=sand)
    S, driver = shape[0] * shape[1], (driver[0], driver[1])
    if not 1 <= hole[0] < shape[0] - 1 or not 1 <= hole[1] < shape[1] - 1:
        raise ValueError(f"hole: got {hole}, must not lie on the edge of the course")
    if driver[1] < driver[0]:
        raise ValueError(f"driver: got {driver}, must be (nearest, farthest) in this order")
    putts = _offsets(shape, 1, check_count("putter", putter))
    drives = _offsets(shape, check_count("driver", driver[0]), check_count("driver", driver[1])) if with_driver else []
    spread = check_count("scatter", scatter, 0) if with_driver else 0
    next_state, prob, legal = _strokes(shape, list(putts) + list(drives), spread)
    next_state[:, : len(putts)] = next_state[:, : len(putts), next_state.shape[2] // 2, None]  # exactly where aimed
    prob[:, : len(putts)] = legal[:, : len(putts), None] * np.eye(prob.shape[2])[0]
    next_state[cell["sand"], : len(putts)] = np.array(cell["sand"])[:, None, None]
    away = np.sign(np.array(hole) - np.stack(np.unravel_index(np.arange(S), shape), 1)) @ [shape[1], 1]
    drive = next_state[:, len(putts) :]
    drive[:] = np.where(drive == cell["hole"][0], cell["hole"][0] + away[:, None, None], drive)
    end = np.arange(S) == cell["hole"][0]
    next_state[end], prob[end], legal[end] = cell["hole"][0], np.eye(prob.shape[2])[0], True
    reward = np.where((prob > 0) & ~end[:, None, None], -1.0, 0.0)
    names = [f"putter {dr:+d} {dc:+d}" for dr, dc in putts] + [f"driver {dr:+d} {dc:+d}" for dr, dc in drives]
    return FiniteMDP(next_state, prob, reward, legal, end, np.eye(S)[cell["tee"][0]], action_names=names)


def _check_course(shape, **places):
    """Cell numbers of each list of places; ValueError for one that is outside."""
    for name, cells in places.items():
        for r, c in cells:
            if not (0 <= r < shape[0] and 0 <= c < shape[1]):
                raise ValueError(f"{name}: got {(r, c)}, must be a cell of the {shape[0]} x {shape[1]} course")
    if places["hole"] == places["tee"] or places["hole"][0] in places["sand"]:
        raise ValueError(f"hole: got {places['hole'][0]}, must be neither the tee nor in the sand")
    return {name: [r * shape[1] + c for r, c in cells] for name, cells in places.items()}


def _offsets(shape, nearest, farthest):
    """Every (rows, columns) at a distance of nearest to farthest."""
    rows, columns = (range(-min(n - 1, farthest), min(n - 1, farthest) + 1) for n in shape)
    return [(r, c) for r in rows for c in columns if nearest**2 <= r * r + c * c <= farthest**2]


def _strokes(shape, offsets, spread):
    """next_state, prob (S, A, K) and legal (S, A): the cells around the aim, equally likely; aims on the grid only."""
    cells = np.stack(np.unravel_index(np.arange(shape[0] * shape[1]), shape), axis=1)
    aim = cells[:, None] + np.array(offsets)
    legal = ((aim >= 0) & (aim < shape)).all(axis=2)
    side = np.arange(-spread, spread + 1)
    around = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    ball = np.clip(aim[:, :, None] + around, 0, np.array(shape) - 1)
    next_state = ball @ [shape[1], 1]
    return next_state, np.where(legal[:, :, None], np.full(next_state.shape, 1 / len(around)), 0.0), legal
