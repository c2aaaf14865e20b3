"""Figures of chapter 1: the loop, the robots, the pole, discounting, Monte Carlo errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rlcore.core.results import Solution
from rlcore.core.types import ArrayLike
from rlcore.envs.robots import BINNED, HELD, OFFICE, arm_motion, pole_return, push_pole
from rlcore.mdp import FiniteMDP, Trajectory
from rlcore.plots.style import (
    PALETTE,
    SMALL,
    Figure,
    arrow,
    band,
    box,
    circle,
    heatmap,
    new_diagram,
    new_figure,
    styles,
)

SYMBOLS = {"slow left": "←", "slow right": "→", "fast left": "⇇", "fast right": "⇉", "grip": "grip"}


def agent_environment_diagram(
    mdp: FiniteMDP | None = None, trajectory: Trajectory | None = None, t: int | None = None
) -> Figure:
    """The loop of figure 1; with a trajectory, one step of it is written on the arrows.

    Parameters
    ----------
    mdp : FiniteMDP | None
        Gives the names of states and actions.
    trajectory : Trajectory | None
        Gives the numbers.
    t : int | None
        The step, 0..T - 1.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-1.
    """
    action, reward, state, now = "$A_t$", "$R_{t+1}$", "$S_{t+1}$", "$S_t$"
    if trajectory is not None:
        s, a = [mdp.state_names[i] for i in trajectory.states], mdp.action_names[trajectory.actions[t]]
        now, action = f"$S_{t}$ = {s[t]}", f"$A_{t}$ = {a}"
        reward, state = f"$R_{t + 1}$ = {trajectory.rewards[t]:+g}", f"$S_{t + 1}$ = {s[t + 1]}"
    fig, ax = new_diagram((0, 10), (0, 5.6))
    box(ax, (5, 4.6), f"agent, in {now}", width=5, height=1.1, fontsize=15)
    box(ax, (5, 1.0), "environment", width=5, height=1.1, fontsize=15)
    out, back, inner = PALETTE["blue"], PALETTE["vermillion"], PALETTE["green"]
    ax.plot([7.5, 8.9, 8.9], [4.6, 4.6, 1.0], color=out, ls="-", lw=1.8)
    arrow(ax, (8.9, 1.0), (7.5, 1.0), colour=out)
    ax.text(8.8, 2.8, action, color=out, ha="right", va="center", fontsize=15)
    for x, y, y_in, colour in ((0.7, 4.9, 0.7, inner), (1.6, 4.35, 1.3, back)):
        ax.plot([2.5, x, x], [y_in, y_in, y], color=colour, ls="-", lw=1.8)
        arrow(ax, (x, y), (2.5, y), colour=colour)
    ax.text(1.75, 2.45, reward, color=back, ha="left", va="center", fontsize=15)
    ax.text(0.85, 3.3, state, color=inner, ha="left", va="center", fontsize=15, bbox={"fc": "white", "ec": "none"})
    ax.plot([2.1, 2.1], [0.2, 1.7], color=PALETTE["grey"], ls="--", lw=1.4)
    return fig


def recycling_graph(mdp: FiniteMDP) -> Figure:
    """The recycling robot as a graph: states are open circles, actions filled dots.

    Parameters
    ----------
    mdp : FiniteMDP
        `recycling_robot(...)`.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-recycling.
    """
    fig, ax = new_diagram((0, 10), (-0.4, 6.4))
    places = {0: (2.2, 3.0), 1: (7.8, 3.0)}
    dots = {(0, 0): (5.0, 5.3), (0, 1): (0.8, 5.3), (1, 0): (5.0, 0.7), (1, 1): (9.2, 0.7), (1, 2): (5.0, 3.0)}
    curves = {(0, 0, 0): -0.3, (1, 0, 1): -0.3, (0, 1, 0): 0.5, (1, 1, 1): 0.5}
    edges = []
    for (s, a), dot in dots.items():
        ax.plot(*zip(places[s], dot), color=PALETTE["grey"], ls="-", lw=1.4, zorder=0)
        for k in np.flatnonzero(mdp.prob[s, a]):
            s_next = int(mdp.next_state[s, a, k])
            edges.append((s, a, s_next, f"{mdp.prob[s, a, k]:g}, {mdp.reward[s, a, k]:+g}"))
    for s, a, s_next, text in edges:
        start, end = np.array(dots[s, a]), np.array(places[s_next])
        end = end - 0.75 * (end - start) / np.hypot(*(end - start))
        arrow(ax, start, end, text, curve=curves.get((s, a, s_next), 0.0), fontsize=SMALL)
    for (_, a), dot in dots.items():
        circle(ax, dot, radius=0.16, face=PALETTE["black"])
        ax.text(dot[0], dot[1] + (0.42 if dot[1] > 2 else -0.42), mdp.action_names[a], ha="center", va="center")
    for s, place in places.items():
        circle(ax, place, mdp.state_names[s], radius=0.7, fontsize=14)
    return fig


def pick_and_place_policy(mdp: FiniteMDP, solution: Solution, actions: ArrayLike) -> Figure:
    """Values (shade) and best actions of the pick-and-place arm, empty above and holding below.

    Parameters
    ----------
    mdp : FiniteMDP
        `pick_and_place(...)`.
    solution : Solution
        Its values.
    actions : ArrayLike
        (S, A) bool, the best actions of each state.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-pick-and-place.
    """
    fig, ax = new_figure(height=2.9)
    words = []
    for s in range(mdp.n_states):
        names = [SYMBOLS[mdp.action_names[a]] for a in np.flatnonzero(actions[s])]
        words.append(f"{' or '.join(names)}\n{solution.V[s]:.2f}")
    heatmap(ax, solution.V.reshape(2, 5), labels=np.reshape(words, (2, 5)), vmin=1.2, vmax=4.0, fontsize=14)
    ax.set(xticks=range(5), yticks=[0, 1], yticklabels=["empty", "holding"], xlabel="cell (grips at 0, releases at 4)")
    ax.tick_params(length=0)
    return fig


def arm(smoothness: float) -> Figure:
    """Position and voltage of the continuous arm for one weight of the smoothness penalty.

    The title says what the weight buys: when the arm is there for good (within 2 %), and its highest voltage.

    Parameters
    ----------
    smoothness : float
        The weight, at least 0.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-pick-and-place.
    """
    position, _, voltage, _ = arm_motion(smoothness)
    seconds = 0.05 * np.arange(position.size)
    there = seconds[np.flatnonzero(np.abs(position - 1) > 0.02)[-1] + 1]
    fig, axes = new_figure(2, 1, height=4.2, sharex=True)
    axes[0].axhline(1, color=PALETTE["grey"], ls="--", lw=1.2)
    axes[0].plot(seconds, position, color=PALETTE["blue"])
    axes[0].text(seconds[-1], 1.04, "target", ha="right", va="bottom", color=PALETTE["grey"], fontsize=SMALL)
    axes[0].plot([there], [np.interp(there, seconds, position)], "o", color=PALETTE["black"])
    axes[0].set(ylabel="position", ylim=(-0.05, 1.25), xlim=(-0.05, 3.05))
    axes[0].set_title(f"penalty {smoothness:g}: there after {there:.2f} s, at most {np.abs(voltage).max():.1f} V")
    axes[1].step(seconds[:-1], voltage, where="post", color=PALETTE["vermillion"], ls="-")
    axes[1].set(ylabel="voltage", xlabel="time (s)", ylim=(-22, 29))
    return fig


def can_office(mdp: FiniteMDP, trajectory: Trajectory, t: int) -> Figure:
    """The office of the can-collecting robot after some steps: its way, the cans, the rewards.

    Parameters
    ----------
    mdp : FiniteMDP
        `can_robot(...)`.
    trajectory : Trajectory
        What the robot does.
    t : int
        Steps, 0..T.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-recycling, cl-008.
    """
    robots, cans = zip(*((robot, cans) for robot, *cans in (mdp.state_names[s] for s in trajectory.states[: t + 1])))
    fig, ax = new_diagram((-0.1, 9.4), (-0.1, 5.1))
    for cell, kind in enumerate("".join(OFFICE)):
        x, y = cell % 5, 4 - cell // 5
        ax.add_patch(_square(x, y, PALETTE["grey"] if kind == "#" else "white"))
        if kind in "Bw":
            ax.text(x + 0.5, y + 0.06, {"B": "bin", "w": "glass"}[kind], ha="center", va="bottom", fontsize=SMALL)
        if cell in cans[-1]:
            ax.text(x + 0.5, y + 0.06, "can", ha="center", va="bottom", fontsize=SMALL, color=PALETTE["blue"])
    x, y = np.array([robot % 5 + 0.5 for robot in robots]), np.array([4.68 - robot // 5 for robot in robots])
    ax.plot(x, y, color=PALETTE["vermillion"], ls="-", lw=4, alpha=0.35, solid_capstyle="round")
    circle(ax, (x[-1], y[-1]), "R", radius=0.26, face=PALETTE["vermillion"], fontsize=SMALL)
    did = mdp.action_names[trajectory.actions[t - 1]] if t else "starts"
    lines = [
        f"step {t}: {did}",
        f"reward so far: {trajectory.rewards[:t].sum():+g}",
        "a can in its hand" if HELD in cans[-1] else "nothing in its hand",
        f"cans in the bin: {cans[-1].count(BINNED)}",
    ]
    ax.text(5.3, 4.7, "\n".join(lines), va="top", linespacing=1.7, fontsize=SMALL)
    return fig


def _square(x, y, colour):
    from matplotlib.patches import Rectangle

    return Rectangle((x, y), 1, 1, fc=colour, ec=PALETTE["grey"], lw=1.2)


def cart_pole(states: ArrayLike) -> Figure:
    """A cart with its pole at the last of the states, those just before pale, and the limits.

    Parameters
    ----------
    states : ArrayLike
        (T, 4).

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-2.
    """
    fig, ax = new_diagram((-2.9, 2.9), (-0.5, 2.0))
    ax.plot([-2.4, 2.4], [0, 0], color=PALETTE["black"], ls="-", lw=1.5)
    for x in (-2.4, 2.4):
        ax.plot([x, x], [-0.12, 0.3], color=PALETTE["vermillion"], ls="-", lw=3)
        ax.text(x, -0.36, f"x = {x:+g}", ha="center", fontsize=SMALL)
    for state in states[-17:-1:4]:
        _draw_cart(ax, state, alpha=0.18)
    x = states[-1][0]
    for side in (-1, 1):
        tip = np.array([np.sin(np.radians(12)), np.cos(np.radians(12))]) * 1.35
        ax.plot([x, x + side * tip[0]], [0.4, 0.4 + tip[1]], color=PALETTE["grey"], ls=":", lw=1.4)
    _draw_cart(ax, states[-1])
    ax.text(x + 0.42, 1.72, "12°", fontsize=SMALL, color=PALETTE["grey"])
    return fig


def cart_pole_strip(states: ArrayLike, steps: Sequence[int]) -> Figure:
    """The cart and its pole after several numbers of steps, a picture for each, in rows of three.

    Parameters
    ----------
    states : ArrayLike
        (T, 4).
    steps : Sequence[int]
        Which of the states.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-2, fig-56.
    """
    rows = -(-len(steps) // 3)
    fig, axes = new_figure(rows, 3, height=1.75 * rows, squeeze=False)
    for ax, step in zip(axes.flat, steps):
        ax.plot([-2.4, 2.4], [0, 0], color=PALETTE["black"], ls="-", lw=1.5)
        for x in (-2.4, 2.4):
            ax.plot([x, x], [-0.12, 0.3], color=PALETTE["vermillion"], ls="-", lw=3)
        _draw_cart(ax, states[step])
        ax.set(xlim=(-2.6, 2.6), ylim=(-0.3, 1.8), aspect="equal", title=f"step {step}")
    for ax in axes.flat:
        ax.axis("off")
    return fig


def _draw_cart(ax, state, alpha=1.0):
    x, _, theta, _ = state
    pole = np.array([[x, 0.4], [x + 1.2 * np.sin(theta), 0.4 + 1.2 * np.cos(theta)]])
    ax.add_patch(_cart(x, alpha))
    ax.plot(*pole.T, color=PALETTE["ochre"], ls="-", lw=6, solid_capstyle="round", alpha=alpha)


def _cart(x, alpha):
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.35, 0.1), 0.7, 0.3, fc=PALETTE["blue"], ec="none", alpha=alpha)


def push_game(*pushes: str) -> Figure:
    """The cart-pole after pushes of 4 steps of 0.02 s each, with what has become of it.

    Parameters
    ----------
    *pushes : str
        "left" or "right" each.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-2.
    """
    states = push_pole([int(push == "right") for push in pushes])
    fig = cart_pole(states)
    T, degrees = len(states) - 1, np.degrees(states[-1][2])
    fell = abs(degrees) > 12 or abs(states[-1][0]) > 2.4
    verdict = f"fell at step {T}" if fell else f"up after {T} steps"
    fig.axes[0].text(-2.85, 1.72, f"{verdict}\nangle {degrees:+.0f}°", fontsize=14, va="center")
    return fig


def pole_returns(gamma: float) -> Figure:
    """The two returns of pole balancing against the failing step K.

    Parameters
    ----------
    gamma : float
        Discount, in [0, 1].

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: fig-2, ex-pole-continuing.
    """
    K = np.arange(1, 101)
    fig, (left, right) = new_figure(1, 2, height=3.2)
    left.plot(K, K, color=PALETTE["blue"])
    left.set(title="episodic: +1 a step", xlabel="failing step K", ylabel="return $G_0$", ylim=(0, 105))
    right.plot(K, pole_return(K, gamma), color=PALETTE["vermillion"], ls="-", label="one failure")
    again = pole_return(K, gamma, again=True)
    right.plot(K, again, color=PALETTE["purple"], ls="--", label="every K steps")
    right.set(title="continuing: -1 a failure", xlabel="failing step K", ylim=(-2.05, 0.1))
    right.legend(loc="lower right", handlelength=1.4)
    return fig


def discount_weights(gamma: float) -> Figure:
    """How much the k-th reward from now counts: gamma^(k-1), and the horizon 1 / (1 - gamma).

    Parameters
    ----------
    gamma : float
        Discount, below 1.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-002, cl-006.
    """
    fig, ax = new_figure(height=3.4)
    k, horizon = np.arange(1, 61), 1 / (1 - gamma) if gamma < 1 else np.inf
    ax.vlines(k, 0, float(gamma) ** (k - 1), color=PALETTE["blue"], lw=3)
    if horizon <= k[-1]:
        ax.axvline(horizon, color=PALETTE["vermillion"], ls="--")
    ax.set(xlabel="k-th reward from now", ylabel="weight $γ^{k-1}$", ylim=(0, 1.05), xlim=(0, 61))
    ax.set_xticks([1, 10, 20, 30, 40, 50, 60])
    where = f"{horizon:.4g}".replace("inf", "∞") + (", off the axis" if horizon > k[-1] else "")
    ax.set_title(f"γ = {gamma:g}: horizon 1/(1 − γ) = {where}", color=PALETTE["vermillion"])
    return fig


def partial_sums(gamma: float, n: int = 120) -> Figure:
    """Sums of the first n discounted rewards for rewards 1, k and 1.2^k.

    Parameters
    ----------
    gamma : float
        Discount.
    n : int
        How many.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-003, cl-004, ex-constant-reward.
    """
    fig, ax = new_figure(height=3.4)
    k = np.arange(1, n + 1)
    for label, rewards in (("$R_k = 1$", np.ones(n)), ("$R_k = k$", k), ("$R_k = 1.2^k$", 1.2**k)):
        ax.plot(k, np.cumsum(gamma ** (k - 1) * rewards), label=label)
    ax.set(yscale="log", ylim=(0.8, 1e6), xlim=(1, n), xlabel="number of rewards summed", ylabel="partial sum")
    ax.legend(loc="upper left", ncols=3)
    return fig


def myopic_values(gamma: float, switch: float) -> Figure:
    """What the two choices of `myopic` are worth against gamma.

    Parameters
    ----------
    gamma : float
        One that is marked.
    switch : float
        Where both are worth the same.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-myopic.
    """
    fig, ax = new_figure(height=3.2)
    x = np.linspace(0, 1, 101)
    ax.plot(x, np.ones_like(x), label="+1 now")
    ax.plot(x, 10 * x**3, label="0, 0, 0, +10")
    ax.axvline(switch, color=PALETTE["grey"], ls=":")
    ax.plot([gamma, gamma], [1, 10 * gamma**3], "o", color=PALETTE["black"])
    best = "later" if 10 * gamma**3 > 1 else "now"
    ax.set(xlabel="γ", ylabel="return of the choice", title=f"γ = {gamma:g}: take it {best}", ylim=(-0.4, 10.5))
    ax.legend(loc="upper left")
    return fig


def absorbing_chain(rewards: ArrayLike = (1, 1, 1)) -> Figure:
    """An episode that ends in an absorbing state, drawn as a square.

    Parameters
    ----------
    rewards : ArrayLike
        (T,).

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: ex-absorbing.
    """
    n = len(rewards)
    fig, ax = new_diagram((-0.6, 2.2 * n + 1.6), (-0.6, 1.15))
    for i, r in enumerate(rewards):
        circle(ax, (2.2 * i, 0), f"$S_{i}$", radius=0.45)
        arrow(ax, (2.2 * i + 0.45, 0), (2.2 * i + 1.75, 0), f"{r:+g}", offset=(0, 0.32))
    box(ax, (2.2 * n, 0), "end", width=0.95, height=0.9, face="#D9D9D9", fontsize=SMALL)
    loop = np.linspace(1.05 * np.pi, -0.35 * np.pi, 40)
    x, y = 2.2 * n + 0.5 + 0.45 * np.cos(loop), 0.5 + 0.45 * np.sin(loop)
    ax.plot(x, y, color=PALETTE["black"], ls="-", lw=1.8, zorder=0)
    arrow(ax, (x[-1], y[-1]), (2.2 * n + 0.46, 0.0))
    ax.text(2.2 * n + 1.15, 0.75, "0", va="center")
    return fig


def monte_carlo_error(n_episodes: ArrayLike, errors: ArrayLike, slopes: Sequence[float]) -> Figure:
    """Root-mean-square errors of Monte Carlo averages on log-log axes, with the slope -1/2.

    Parameters
    ----------
    n_episodes : ArrayLike
        (n,), episodes averaged.
    errors : ArrayLike
        {"first visit": (runs, n)}.
    slopes : Sequence[float]
        {"first visit": number}.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-011.
    """
    fig, ax = new_figure(height=3.6)
    for (label, runs), style in zip(errors.items(), styles(errors).values()):
        spread = np.percentile(runs, [10, 90], axis=0)
        band(ax, n_episodes, np.median(runs, axis=0), spread, f"{label}: slope {slopes[label]:.1f}", **style)
    ax.plot(n_episodes, 0.5 / np.sqrt(n_episodes), color=PALETTE["grey"], ls=":", label="slope -1/2")
    ax.set(xscale="log", yscale="log", xlabel="episodes", ylabel="error of V (rms)")
    ax.legend()
    return fig


def averages(n: ArrayLike, runs: ArrayLike, truth: ArrayLike) -> Figure:
    """Running averages of sampled returns, with the exact value.

    Parameters
    ----------
    n : ArrayLike
        (m,), how many returns are averaged.
    runs : ArrayLike
        (runs, m).
    truth : ArrayLike
        The exact value.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: eq-10, eq-11.
    """
    fig, ax = new_figure(height=3.2)
    for run in runs:
        ax.plot(n, run, color=PALETTE["blue"], ls="-", lw=1.2, alpha=0.7)
    ax.axhline(truth, color=PALETTE["vermillion"], ls="--", label=f"exact value {truth:.4f}")
    ax.set(xscale="log", xlabel="returns averaged", ylabel="average")
    ax.legend()
    return fig


def return_ranking(episodic: ArrayLike, continuing: ArrayLike, labels: Sequence[Any]) -> Figure:
    """Ranks of policies under the episodic return against their ranks under the continuing ones.

    Parameters
    ----------
    episodic : ArrayLike
        (n,).
    continuing : ArrayLike
        {gamma: (n,)}.
    labels : Sequence[Any]
        Of the policies.

    Returns
    -------
    Figure
        The figure.

    Notes
    -----
    Ledger: cl-007.
    """
    fig, ax = new_figure(height=3.4)
    rank = np.argsort(np.argsort(episodic)) + 1
    for (gamma, values), mark in zip(continuing.items(), "os"):
        ax.plot(rank, np.argsort(np.argsort(values)) + 1, mark, label=labels[gamma])
    ax.plot([1, rank.size], [1, rank.size], color=PALETTE["grey"], ls=":")
    ticks = [1, *range(5, rank.size + 1, 5)]
    ax.set(xlabel="rank by steps until failure", ylabel="rank by discounted\nfailures", xticks=ticks, yticks=ticks)
    ax.legend()
    return fig
