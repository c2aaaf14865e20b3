"""Figures of chapter 3: models, planning in them, and what learns without them."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

from rlcore.core.types import ArrayLike, Cell, Floats
from rlcore.mdp import FiniteMDP
from rlcore.plots.style import (
    PALETTE,
    SMALL,
    Axes,
    Curves,
    Figure,
    Point,
    arrow,
    band,
    box,
    heatmap,
    new_diagram,
    new_figure,
    styles,
)

BLUE, RED, GREEN, GREY, PALE = (PALETTE[c] for c in ("blue", "vermillion", "green", "grey", "light"))
# Figure 10: group -> leaves (method, function, chapter).
FAMILY = {
    "model given": [
        ("policy evaluation", "rlcore.dp.policy_evaluation", "3"),
        ("policy iteration", "rlcore.dp.policy_iteration", "3"),
        ("value iteration", "rlcore.dp.value_iteration", "3"),
    ],
    "model learned": [
        ("certainty equivalence", "rlcore.planning.certainty_equivalent_control", "3"),
        ("Dyna-Q", "rlcore.planning.dyna_q", "3"),
        ("random shooting", "rlcore.mpc.random_shooting", "3"),
    ],
    "model-free, by values": [
        ("Monte Carlo", "rlcore.monte_carlo.mc_prediction", "4"),
        ("TD(0)", "rlcore.td.td0", "4"),
        ("SARSA", "rlcore.td.sarsa", "4"),
        ("Q-learning", "rlcore.td.q_learning", "4"),
        ("traces", "rlcore.traces.td_lambda", "5"),
    ],
    "model-free, by policies": [
        ("REINFORCE", "rlcore.studies.ch03.reinforce_linear", "7"),
        ("actor-critic", "rlcore.actor_critic.actor_critic", "7"),
        ("TRPO", "rlcore.trpo.trpo", "8"),
        ("PPO", "rlcore.ppo.ppo", "8"),
    ],
}


def loop_diagram(
    labels: Sequence[Any] = ("act", "store (s, a, r, s')", "fit the model", "plan in the model"),
) -> Figure:
    """Four boxes in a circle: what a method does in turn.

    Parameters
    ----------
    labels : Sequence[Any]
        Of the boxes.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-7, fig-12.
    """
    fig, ax = new_diagram((0, 10), (0, 5))
    places = [(2.3, 4), (7.7, 4), (7.7, 1), (2.3, 1)]
    for place, label, face in zip(places, labels, (PALE, PALE, BLUE, BLUE)):
        box(ax, place, label, width=4.2, height=1.3, face=face, fontsize=SMALL)
    for start, end in (
        ((4.4, 4), (5.6, 4)),
        ((7.7, 3.35), (7.7, 1.65)),
        ((5.6, 1), (4.4, 1)),
        ((2.3, 1.65), (2.3, 3.35)),
    ):
        arrow(ax, start, end)
    return fig


def prediction_errors(real: ArrayLike, predicted: ArrayLike, k: int) -> Figure:
    """Angular velocity of the pole some steps ahead, real against predicted, and how the error grows.

    Parameters
    ----------
    real : ArrayLike
        (T + 1, n, 4) states of n runs.
    predicted : ArrayLike
        (T + 1, n, 4), of the same runs under the same actions.
    k : int
        Steps ahead.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-7.
    """
    fig, (left, right) = new_figure(1, 2, height=3.3)
    spin = np.degrees(np.stack([real, predicted])[..., 3])
    ends = [spin[0].min(), spin[0].max()]
    left.plot(ends, ends, color=GREY, ls="-", lw=1.2)
    left.plot(spin[0, k], spin[1, k], ".", color=BLUE, ms=6)
    left.set(xlabel="real speed (degrees/s)", ylabel="predicted", title=f"{k} step{'s' * (k > 1)} ahead")
    error = np.sqrt(np.mean((spin[1] - spin[0]) ** 2, axis=1))
    right.plot(np.arange(1, error.size), error[1:], color=RED)
    right.plot([k], [error[k]], "o", color=RED, ms=9)
    right.set(
        xlabel="steps ahead k", ylabel="error (degrees/s)", yscale="log", ylim=(0.01, 30), title="root mean square"
    )
    right.minorticks_off()
    return fig


def trajectory_factors(mdp: FiniteMDP, pi: ArrayLike, states: ArrayLike, actions: ArrayLike) -> Figure:
    """The factors of one trajectory's probability, in order; policy and dynamics in two colours.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy.
    states : ArrayLike
        (T,).
    actions : ArrayLike
        (T,).

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-8.
    """
    P = mdp.transition_probs()
    factors = [(r"$p(s_1)$", mdp.start[states[0]], PALE)]
    for t, (s, a) in enumerate(zip(states, actions), start=1):
        factors.append((rf"$\pi(a_{t}|s_{t})$", pi[s, a], BLUE))
        if t < len(states):
            factors.append((rf"$p(s_{t + 1}|s_{t},a_{t})$", P[s, a, states[t]], RED))
    fig, ax = new_diagram((0, 12), (0, 3.6))
    for i, (name, value, face) in enumerate(factors):
        place = (1.5 + 3 * (i % 4), 2.7 if i < 4 else 0.9)
        box(ax, place, f"{name}\n{value:g}", width=2.7, height=1.4, face=face, fontsize=SMALL)
    return fig


def trajectory_bars(
    states: ArrayLike, actions: ArrayLike, prob: ArrayLike, totals: ArrayLike, expected: ArrayLike
) -> Figure:
    """Probability of every possible trajectory, ordered by its sum of rewards, and the expected sum.

    Parameters
    ----------
    states : ArrayLike
        (n, T).
    actions : ArrayLike
        (n, T).
    prob : ArrayLike
        (n,).
    totals : ArrayLike
        (n,), sums of rewards.
    expected : ArrayLike
        Their mean.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-8.
    """
    order = np.lexsort((np.arange(prob.size), totals))
    order = order[states[order, 0] == 0]  # those that begin in the start state
    fig, (top, bottom) = new_figure(2, 1, height=4.2, sharex=True, height_ratios=[2, 1])
    top.bar(np.arange(order.size), prob[order], color=BLUE, width=0.85)
    top.set(ylabel="probability", ylim=(0, 0.85))
    bottom.step(np.arange(order.size), totals[order], where="mid", color=GREY, ls="-")
    bottom.axhline(expected, color=RED, ls="--")
    bottom.set(ylabel="reward sum", xlabel=f"the {order.size} trajectories; expected sum {expected:.3f} (dashed)")
    return fig


def model_and_policy(mdp: FiniteMDP, pi: ArrayLike, a: int) -> Figure:
    """p(s'|s, a) for each action; below pi(a|s), and P_pi, the model under the policy.

    Parameters
    ----------
    mdp : FiniteMDP
        The process.
    pi : ArrayLike
        (S, A), the policy.
    a : int
        The action in front.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-9.
    """
    P, A, names = mdp.transition_probs(), mdp.n_actions, mdp.state_names
    fig, axes = new_figure(2, A, height=4.6)
    for b, ax in enumerate(axes[0]):
        heatmap(ax, np.where(mdp.legal[:, [b]], P[:, b], np.nan), fmt="{:.1f}", vmin=0, vmax=1)
        ax.set_title(mdp.action_names[b], color=RED if b == a else GREY, fontweight="bold" if b == a else "normal")
        ax.patch.set_alpha(0)
        for side in ax.spines.values():
            side.set(visible=b == a, color=RED, linewidth=3)
    heatmap(axes[1, 0], np.where(mdp.legal, pi, np.nan).T, fmt="{:.2f}", vmin=0, vmax=1)
    axes[1, 0].set(title="policy π", yticks=range(A), yticklabels=mdp.action_names, xlabel="state")
    heatmap(axes[1, -1], np.einsum("sa,saz->sz", pi, P), fmt="{:.2f}", vmin=0, vmax=1)
    axes[1, -1].set(title="$P_π$", yticks=range(len(names)), yticklabels=names)
    for ax in axes[1, 1:-1]:
        ax.axis("off")
    axes[1, A // 2].text(
        0.35, 0.5, "Σ π(a|s) p(s'|s, a)\n⟶", transform=axes[1, A // 2].transAxes, ha="center", va="center"
    )
    axes[0, 0].set(yticks=range(len(names)), yticklabels=names, ylabel="state")
    for ax in (*axes[0], axes[1, 0], axes[1, -1]):
        ax.set(xticks=range(len(names)), xticklabels=names)
        ax.tick_params(length=0)
    for ax in (*axes[0], axes[1, -1]):
        ax.set_xlabel("next state")
    return fig


def family_tree(leaf: Any = None) -> Figure:
    """Methods of the book by what they know and what they learn.

    Parameters
    ----------
    leaf : Any
        The method whose chapter and function are written below.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-10.
    """
    fig, ax = new_diagram((0, 12), (-0.9, 10.6), height=5.4)
    ax.set_aspect("auto")
    y, note = 10.2, ""
    for group, leaves in FAMILY.items():
        middle = y - 0.66 * (len(leaves) - 1) / 2
        box(ax, (2.6, middle), group, width=5.0, height=0.8, face=PALE, fontsize=SMALL)
        for name, function, chapter in leaves:
            chosen = name == leaf
            ax.plot([5.1, 6.6], [middle, y], color=GREY, ls="-", lw=1.2, zorder=0)
            box(ax, (9.1, y), name, width=5.0, height=0.6, face=BLUE if chosen else "white", fontsize=SMALL)
            if chosen:
                note = f"chapter {chapter}: {function}"
            y -= 0.66
        y -= 0.25
    ax.text(6, -0.5, note, ha="center", va="center", fontsize=SMALL, color=BLUE)
    return fig


def descent_path(C: Callable[[Floats], ArrayLike], path: ArrayLike, epsilon: float, ax: Axes | None = None) -> Figure:
    """Points of gradient descent on a curve.

    Parameters
    ----------
    C : Callable[[Floats], ArrayLike]
        The curve, of an array.
    path : ArrayLike
        (n,) points.
    epsilon : float
        The learning rate, for the title.
    ax : Axes | None
        Where to draw; a new figure where None.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-11.
    """
    fig, ax = (None, ax) if ax is not None else new_figure()
    v = np.linspace(-3, 3, 101)
    ax.plot(v, C(v), color=GREY, ls="-")
    shown = path[np.abs(path) <= 3.5]
    ax.plot(shown, C(shown), "o-", color=BLUE, lw=1.2, ms=5)
    ax.plot(path[0], C(path[0]), "s", color=RED, ms=9)
    ax.set(xlim=(-3, 3), ylim=(C(v).min() - 0.3, min(C(v).max(), 6)), xlabel="v", ylabel="C(v)")
    last = f"{path[-1]:.4f}" if abs(path[-1]) < 1e3 else "beyond 1000"
    ax.set_title(rf"$\epsilon$ = {epsilon:g}: $v_{{{path.size - 1}}}$ = {last}")
    return fig


def descent_panels(C: Callable[[Floats], ArrayLike], paths: Curves) -> Figure:
    """Several learning rates side by side.

    Parameters
    ----------
    C : Callable[[Floats], ArrayLike]
        The curve, of an array.
    paths : Curves
        {epsilon: (n,) points}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-11.
    """
    fig, axes = new_figure(2, 2, height=5.2, sharex=True, sharey=True)
    for ax, (epsilon, path) in zip(axes.flat, paths.items()):
        descent_path(C, path, epsilon, ax)
    for ax in axes.flat:
        ax.label_outer()
    return fig


# A logarithmic scale, so that the first small values show; white: still 0
Q_CMAP, Q_NORM = mpl.colormaps["YlGnBu"].resampled(256), LogNorm(1e-4, 1)
Q_CMAP = mpl.colors.ListedColormap(Q_CMAP(np.linspace(0.2, 1, 256))).with_extremes(under="white", bad="white")


def q_table(
    Q: ArrayLike,
    mdp: FiniteMDP,
    shape: Cell,
    *,
    flash: tuple[int, int] | None = None,
    old: ArrayLike | None = None,
    title: str = "",
    ax: Axes | None = None,
) -> Figure | None:
    """A Q-table of a maze: each cell in four triangles, one an action (up, down, right, left).

    Walls are grey, S is the start, G the goal.

    Parameters
    ----------
    Q : ArrayLike
        (S, 4), drawn on a logarithmic scale up to 1.
    mdp : FiniteMDP
        The maze.
    shape : Cell
        (rows, columns).
    flash : tuple[int, int] | None
        (s, a), drawn in red, its value below.
    old : ArrayLike | None
        (S, 4), gives what the value was before.
    title : str
        Written above.
    ax : Axes | None
        Where to draw; a new figure where None.

    Returns
    -------
    Figure | None
        The figure.

    Notes
    -----
    Ledger: fig-12.
    """
    alone = ax is None
    fig, ax = new_figure(height=3.9) if alone else (ax.figure, ax)
    side = np.arange(24) - 11.5
    across, down = np.meshgrid(side, side)
    action = np.where(np.abs(across) > np.abs(down), np.where(across > 0, 2, 3), np.where(down < 0, 0, 1))
    colour = Q_CMAP(Q_NORM(np.where(Q > 0, Q, np.nan)).filled(-1))[..., :3]
    if flash is not None:
        colour[flash] = mpl.colors.to_rgb(RED)
        s, a = flash
        change = f"{Q[flash]:.3g}" if old is None else f"{old:.3g} → {Q[flash]:.3g}"
        ax.set_xlabel(
            f"Q(row {s // shape[1] + 1}, column {s % shape[1] + 1}; {mdp.action_names[a]}) = {change}", color=RED
        )
    wall = (mdp.next_state == np.arange(mdp.n_states)[:, None, None]).all(axis=(1, 2)) & ~mdp.terminal
    cells = np.where(wall[:, None, None, None], 0.6, colour[:, action])
    lines = (np.abs(across) == np.abs(down)) | (np.abs(across) == 11.5) | (np.abs(down) == 11.5)
    cells[:, lines] = 0.75
    bitmap = cells.reshape(*shape, 24, 24, 3).swapaxes(1, 2).reshape(shape[0] * 24, shape[1] * 24, 3)
    ax.imshow(bitmap, extent=(-0.5, shape[1] - 0.5, shape[0] - 0.5, -0.5), interpolation="none")
    for s, text in ((mdp.start.argmax(), "S"), (mdp.terminal.argmax(), "G")):
        ground = {"fc": "white", "ec": "none", "pad": 1}
        ax.text(s % shape[1], s // shape[1], text, ha="center", va="center", fontweight="bold", bbox=ground)
    ax.set(xticks=[], yticks=[], title="\n".join(textwrap.wrap(title, 46)))
    ax.grid(False)
    if alone:
        fig.colorbar(ScalarMappable(Q_NORM, Q_CMAP), ax=ax, shrink=0.8, pad=0.02, label="white: 0")
    return fig


def q_tables(history: ArrayLike, episodes: Sequence[int], mdp: FiniteMDP, shape: Cell) -> Figure:
    """The Q-table after several numbers of episodes.

    Parameters
    ----------
    history : ArrayLike
        (n + 1, S, 4).
    episodes : Sequence[int]
        Which of them.
    mdp : FiniteMDP
        The maze.
    shape : Cell
        (rows, columns).

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-12.
    """
    fig, axes = new_figure(2, 2, height=4.2)
    for ax, k in zip(axes.flat, episodes):
        word = "episode" if k == 1 else "episodes"
        q_table(history[k], mdp, shape, title=f"after {k} {word}", ax=ax)
    fig.colorbar(ScalarMappable(Q_NORM, Q_CMAP), ax=axes, shrink=0.8, label="Q(s, a); white: 0")
    return fig


def learning_curves(
    lengths: Curves, *, ylabel: str = "steps per episode", log: bool = True, ylim: Point | None = None,
    x: ArrayLike | None = None, xlabel: str = "episode",
) -> Figure:  # fmt: skip
    """Mean over runs with the middle half of the runs.

    Parameters
    ----------
    lengths : Curves
        {label: (n_runs, n)}.
    ylabel : str
        Of the y axis.
    log : bool
        Whether y is logarithmic.
    ylim : Point | None
        Ends of the axis.
    x : ArrayLike | None
        (n,); 1, 2, ... where None.
    xlabel : str
        Of the x axis.

    Returns
    -------
    Figure
        The figure.
    """
    fig, ax = new_figure()
    for (label, values), style in zip(lengths.items(), styles(lengths).values()):
        values = np.asarray(values, float)
        at = np.arange(1, values.shape[1] + 1) if x is None else x
        band(ax, at, values.mean(axis=0), np.percentile(values, [25, 75], axis=0), label, **style)
    ax.set(xlabel=xlabel, ylabel=ylabel, yscale="log" if log else "linear", ylim=ylim)
    ax.legend()
    return fig


def decay(
    errors: ArrayLike, *, xlabel: str, ylabel: str, reference: Curves | None = None, log_x: bool = True
) -> Figure:
    """Errors on log axes, with a reference line in grey.

    An error that is only rounding (below 1e-11 of the largest) is drawn as "exact" at the foot.

    Parameters
    ----------
    errors : ArrayLike
        {label: (x, y)}.
    xlabel : str
        Of the x axis.
    ylabel : str
        Of the y axis.
    reference : Curves | None
        {label: (x, y)}.
    log_x : bool
        False: linear; from 0 to 1 linear, then logarithmic, where one curve has ten times as many points as another.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: alg-model-learning, fig-13.
    """
    fig, ax = new_figure()
    curves = {label: (np.asarray(x, float), np.asarray(y, float)) for label, (x, y) in errors.items()}
    largest = max(y.max() for _, y in curves.values())
    lowest = min(y[y > 1e-11 * largest].min() for _, y in curves.values())
    foot = 10.0 ** np.floor(np.log10(lowest) - 0.5)
    sizes = [x.size for x, _ in curves.values()]
    for (label, (x, y)), style in zip(curves.items(), styles(curves).values()):
        exact = y <= 1e-11 * largest
        style |= {"marker": "o", "ms": 6} if x.size <= 8 else {}
        ax.plot(x, np.where(exact, foot, y), label=label, **style)
        for at in x[exact]:
            ax.annotate("exact", (at, foot), (8, 4), textcoords="offset points", color=style["color"])
    for label, (x, y) in (reference or {}).items():
        ax.plot(x, y, color=GREY, ls="-", lw=1.2, label=label)
    ax.set(xlabel=xlabel, ylabel=ylabel, yscale="log", xscale="log" if log_x else "linear")
    if not log_x and max(sizes) > 10 * min(sizes):
        ax.set_xscale("symlog", linthresh=1)
        ticks = [
            t for t in (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if t <= max(x[-1] for x, _ in curves.values())
        ]
        ax.set_xticks(ticks, [str(t) for t in ticks])
        ax.minorticks_off()
        ax.set_xlim(-0.1, 1.1 * max(x[-1] for x, _ in curves.values()))
    ax.legend()
    return fig


def cart_pole_costs(run_lengths: Sequence[ArrayLike], n_fit: int) -> Figure:
    """Length of each REINFORCE episode against the transitions used so far, one line a seed.

    Parameters
    ----------
    run_lengths : Sequence[ArrayLike]
        (n,) of each seed.
    n_fit : int
        Transitions that the model is fitted to.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-model-based.
    """
    fig, ax = new_figure()
    for lengths in run_lengths:
        smooth = np.convolve(lengths, np.ones(10) / 10, "valid")
        ax.plot(np.cumsum(lengths)[9:], smooth, color=BLUE, ls="-", lw=1.2)
    ax.plot([], [], color=BLUE, ls="-", label="REINFORCE, mean of 10 episodes")
    ax.axvline(n_fit, color=RED, ls="--", label=f"shooting: model from {n_fit} transitions, 200 steps")
    ax.plot([n_fit], [200], "o", color=RED, ms=9)
    ax.set(xscale="log", xlabel="real transitions used (log scale)", ylabel="steps balanced", ylim=(0, 310))
    ax.legend(loc="upper left")
    return fig


def rewards_over_time(curves: Curves, change: float) -> Figure:
    """Cumulative reward against real steps, with the change marked.

    Parameters
    ----------
    curves : Curves
        {label: (n_runs, n)}.
    change : float
        The step of the change.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-model-wrong.
    """
    fig, ax = new_figure()
    for (label, values), style in zip(curves.items(), styles(curves).values()):
        values = np.asarray(values, float)
        x = np.linspace(0, 3000, values.shape[1])
        band(ax, x, values.mean(axis=0), np.percentile(values, [25, 75], axis=0), label, **style)
    ax.axvline(change, color=GREY, ls="-", lw=1.2)
    ax.text(change + 40, 0, "the passage moves", color=GREY, fontsize=SMALL)
    ax.set(xlabel="real steps", ylabel="rewards so far")
    ax.legend(loc="upper left")
    return fig


def spread_by_setting(x: ArrayLike, values: ArrayLike, *, xlabel: str, ylabel: str) -> Figure:
    """Mean and spread over runs at each setting.

    Parameters
    ----------
    x : ArrayLike
        (n_settings,).
    values : ArrayLike
        (n_settings, n_runs).
    xlabel : str
        Of the x axis.
    ylabel : str
        Of the y axis.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-explore.
    """
    fig, ax = new_figure()
    band(ax, range(len(x)), np.mean(values, axis=1), np.percentile(values, [25, 75], axis=1), "", marker="o")
    ax.set(xlabel=xlabel, ylabel=ylabel, xticks=range(len(x)), xticklabels=[f"{v:g}" for v in x])
    return fig


def sweep_values(V: ArrayLike, shape: Cell, title: str) -> Figure:
    """Values of a grid after some sweeps.

    Parameters
    ----------
    V : ArrayLike
        (S,), values.
    shape : Cell
        (rows, columns).
    title : str
        Written above.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: alg-policy-evaluation.
    """
    fig, ax = new_figure(height=4.2)
    heatmap(ax, V.reshape(shape), fmt="{:.2f}", vmin=-22, vmax=0)
    ax.set_title(title)
    return fig


def value_iteration_progress(V: ArrayLike, shape: Cell, errors: ArrayLike, gamma: float, k: int) -> Figure:
    """Left: V_k of a grid. Right: the error in another problem, along the bound gamma^k.

    Parameters
    ----------
    V : ArrayLike
        (S,), values.
    shape : Cell
        (rows, columns).
    errors : ArrayLike
        (n,), largest error after 0, 1, ... sweeps of the random process.
    gamma : float
        Discount.
    k : int
        Sweeps done.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-13.
    """
    fig, (left, right) = new_figure(1, 2, height=3.3, width_ratios=[1, 1.15])
    heatmap(left, V.reshape(shape), fmt="{:.2f}", vmin=-3, vmax=0)
    left.set_title(f"grid: $V_{{{k}}}$, $\\gamma$ = {gamma:g}")
    x = np.arange(min(errors.size, 101))
    right.plot(x, gamma**x * errors[0], color=RED, ls="-", lw=7, alpha=0.35, label=r"bound $\gamma^k$")
    right.plot(x, errors[: x.size], color=BLUE, ls="-", lw=1.6, label="error")
    if k < errors.size:
        right.plot([k], [errors[k]], "o", color=BLUE, ms=9)
        right.annotate(
            f"{errors[k]:.2g}",
            (k, errors[k]),
            (4, 9),
            textcoords="offset points",
            color=BLUE,
            ha="left" if k < 50 else "right",
        )
    right.set(yscale="log", ylim=(1e-9, 1e4), xlim=(-4, 104), xlabel="sweeps k", ylabel="largest error")
    right.set_title("random process")
    right.minorticks_off()
    right.legend(loc="lower left" if gamma > 0.6 else "upper right", handlelength=1.4)
    return fig
