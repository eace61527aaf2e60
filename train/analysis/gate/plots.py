"""Pictures of a gate's shares by situation, and of a moment of each situation."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from numpy.typing import NDArray

from train.analysis.gate.play import Decisions, Scene
from train.analysis.gate.summary import MOTIONS
from train.analysis.situations import OTHER, SITUATIONS

AROUND = 2.0
"""Time shown before and after a situation begins [s]."""
LASTING = 0.5
"""Least duration of a situation that is shown, if any of its kind lasts so long [s]."""
SCENE = 3.0
"""Distance shown around the robot [m]."""
FARTHEST = 6.0
"""Greatest clearance that is drawn, in place of all above it and of none at all [m]; policies see so far."""
_EXPERTS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")
"""Paul Tol's bright colours, which the colour-blind can distinguish."""
_MOTIONS = ("#1b9e77", "#7570b3", "#d95f02", "#e7298a", "#bbbbbb")
_LABELLED = 0.08
"""Smallest piece of a bar that is labelled."""


def draw_shares(summary: dict, title: str, picture: Path) -> None:
    """Draw mean shares of the experts by situation, and what each expert alone would do there; PNG.

    Args:
        summary: Result of ``summary.summarise``.
        title: Title of the figure.
        picture: File to be written.
    """
    rows = {name: row for name, row in summary["situations"].items() if row["decisions"]}
    experts = len(summary["situations"]["all"]["experts"])
    figure = Figure(figsize=(14.0, 5.5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    titles = ["\n".join((*name.split(), "")[:2]) for name in rows]
    labels = [f"{title}\n{row['decisions']:,}\n{row['episodes']:,}" for title, row in zip(titles, rows.values())]
    shares = np.array([[expert["share"][0] for expert in row["experts"]] for row in rows.values()])
    _stack(left, np.arange(len(rows)), shares, _EXPERTS, [f"expert {n + 1}" for n in range(experts)], 0.75)
    left.set(ylabel="mean share of the experts", title="who leads where")
    motions = np.array(
        [[[e["motion_alone"][motion][0] for motion in MOTIONS] for e in row["experts"]] for row in rows.values()]
    )  # (situations, E, motions)
    at = np.arange(len(rows))[:, None] + 0.2 * (np.arange(experts) - 0.5 * (experts - 1))
    _stack(right, at.ravel(), motions.reshape(-1, len(MOTIONS)), _MOTIONS, list(MOTIONS), 0.18)
    for x, n in zip(at.ravel(), np.tile(np.arange(experts), len(rows))):
        right.text(x, 1.005, str(n + 1), ha="center", va="bottom", fontsize=8, color=_EXPERTS[n % len(_EXPERTS)])
    right.set(ylabel="share of the decisions", title="what each expert alone would do there (its number on top)")
    right.title.set_position((0.5, 1.05))
    for axes in (left, right):
        axes.set_xticks(np.arange(len(rows)), labels, fontsize=8)
        axes.set_xlabel("situation, number of decisions, of episodes")
        axes.set_ylim(0.0, 1.06)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=5, frameon=False, fontsize=8)
    figure.suptitle(title)
    figure.savefig(picture, dpi=110)


def _stack(axes: Axes, at: np.ndarray, parts: np.ndarray, colours: tuple, names: list[str], width: float) -> None:
    """Draw stacked bars: parts (bars, pieces) that add up to 1."""
    bottom = np.zeros(len(parts))
    for k, name in enumerate(names):
        axes.bar(at, parts[:, k], width, bottom, color=colours[k % len(colours)], label=name)
        if width > 0.5:
            for x, low, part in zip(at, bottom, parts[:, k]):
                if part >= _LABELLED:
                    axes.text(x, low + part / 2.0, f"{100 * part:.0f}%", ha="center", va="center", fontsize=8)
        bottom += parts[:, k]


def typical_moment(decisions: Decisions, situation: int, rate: float) -> tuple[int, int] | None:
    """Find the most ordinary moment at which a situation begins.

    Args:
        decisions: Decisions of all episodes.
        situation: Index into SITUATIONS.
        rate: Rate of decisions [Hz].

    Returns:
        First and one past the last decision in it: of those that are led on average by the expert that leads the
        situation, that last for LASTING, and begin AROUND after their episode's start and before its end, if there are
        any, the one with shares nearest to their mean. None if there are no decisions in the situation.
    """
    there = decisions.situation == situation
    if not there.any():
        return None
    episode = decisions.episode
    joined = np.zeros(len(there) + 1, np.bool_)
    joined[1:-1] = there[1:] & there[:-1] & (episode[1:] == episode[:-1])
    begins, ends = np.flatnonzero(there & ~joined[:-1]), np.flatnonzero(there & ~joined[1:]) + 1
    around = round(AROUND * rate)
    first, last = np.searchsorted(episode, episode[begins]), np.searchsorted(episode, episode[begins], "right")
    lasting = ends - begins >= LASTING * rate
    whole = (begins - first >= around) & (last - begins > around)
    totals = np.concatenate([np.zeros((1, decisions.shares.shape[1])), np.cumsum(decisions.shares, 0, dtype=float)])
    shares = (totals[ends] - totals[begins]) / (ends - begins)[:, None]
    foremost = shares.argmax(1) == decisions.shares[there].mean(0).argmax()
    masks = (foremost & lasting & whole, foremost & lasting, foremost & whole, foremost, there[begins])
    chosen = np.flatnonzero(next(mask for mask in masks if mask.any()))
    best = chosen[np.abs(shares[chosen] - shares[chosen].mean(0)).sum(1).argmin()]
    return int(begins[best]), int(ends[best])


def draw_moments(
    decisions: Decisions, scenes: dict[tuple[int, int], Scene], rate: float, title: str, picture: Path
) -> None:
    """Draw a column for each situation but ``other``: scene, shares, command and clearance around its beginning; PNG.

    Args:
        decisions: Decisions of all episodes.
        scenes: Scenes by episode and number of the decision within it.
        rate: Rate of decisions [Hz].
        title: Title of the figure.
        picture: File to be written.
    """
    columns = [k for k in range(len(SITUATIONS)) if k != OTHER]
    figure = Figure(figsize=(4.0 * len(columns), 11.0), layout="constrained")
    panels = figure.subplots(4, len(columns), height_ratios=(1.5, 1.0, 1.0, 1.0), squeeze=False)
    for column, situation in zip(panels.T, columns):
        column[0].set_title(SITUATIONS[situation])
        moment = typical_moment(decisions, situation, rate)
        if moment is None:
            for axes in column:
                axes.set_axis_off()
            column[0].text(0.5, 0.5, "no decisions", ha="center", transform=column[0].transAxes)
            continue
        begin, end = moment
        episode = decisions.episode[begin]
        first, last = np.searchsorted(decisions.episode, [episode, episode + 1])
        shown = np.arange(max(begin - round(AROUND * rate), first), min(begin + round(AROUND * rate) + 1, last))
        draw_scene(column[0], scenes[int(episode), int(begin - first)])
        _courses(column[1:], decisions, shown, (shown - begin) / rate, (end - begin) / rate)
    for axes, label in zip(panels[1:, 0], ("shares of the experts", "command [of the limits]", "clearance [m]")):
        axes.set_ylabel(label)
    for axes in panels[3]:
        axes.set_xlabel("time since the situation began [s]")
    experts = [Patch(color=_EXPERTS[n], label=f"expert {n + 1}") for n in range(decisions.shares.shape[1])]
    marks = [
        Line2D([], [], color="k", label="v_x"), Line2D([], [], color="k", ls="--", label="w_z"),
        Patch(color="0.9", label="in the situation"), Line2D([], [], color="b", marker="*", ls="", label="goal's side"),
        Line2D([], [], color="r", marker="o", mfc="none", ls="", label="mover, and its way in 1 s"),
    ]  # fmt: skip
    figure.legend(handles=[*experts, *marks], loc="outside lower center", ncols=9, frameon=False)
    figure.suptitle(title)
    figure.savefig(picture, dpi=100)


def _courses(panels: NDArray, decisions: Decisions, shown: NDArray[np.int64], time: np.ndarray, lasts: float) -> None:
    shares, command, clearance = panels
    shares.stackplot(time, decisions.shares[shown].T, colors=_EXPERTS[: decisions.shares.shape[1]])
    shares.set_ylim(0.0, 1.0)
    for axis, style in ((0, "k-"), (2, "k--")):
        command.plot(time, decisions.action[shown, axis], style, lw=1.2)
    command.set_ylim(-1.05, 1.05)
    command.axhline(0.0, color="0.7", lw=0.8, zorder=0)
    nearest = np.minimum(decisions.clearance[shown], FARTHEST)
    clearance.plot(time, nearest, "k-", lw=1.2)
    clearance.set_ylim(0.0, max(2.0, 1.05 * float(nearest.max())))
    for axes in panels:
        axes.set_xlim(-AROUND, AROUND)
        axes.axvspan(0.0, min(lasts, AROUND), color="0.5", alpha=0.2, lw=0, zorder=0)
        for edge in (0.0, lasts):
            axes.axvline(edge, color="k", lw=1.0, ls=":")


def draw_scene(axes: Axes, scene: Scene) -> None:
    """Draw the lidar's returns, the movers, where they will be in a second, and the goal's direction."""
    angles = -math.pi + np.arange(len(scene.ranges)) * (2.0 * math.pi / len(scene.ranges))
    seen = scene.ranges < SCENE
    axes.add_patch(Circle((0.0, 0.0), SCENE, facecolor="0.97", edgecolor="0.6"))
    axes.plot(-np.sin(angles[seen]) * scene.ranges[seen], np.cos(angles[seen]) * scene.ranges[seen], "k.", ms=3)
    for x, y, v_x, v_y, radius in scene.movers:
        if math.hypot(x, y) < SCENE:
            axes.add_patch(Circle((-y, x), radius, facecolor="none", edgecolor="red", lw=1.2))
            axes.annotate("", (-y - v_y, x + v_x), (-y, x), arrowprops={"arrowstyle": "->", "color": "red"})
    axes.add_patch(Polygon(np.column_stack([-scene.footprint[:, 1], scene.footprint[:, 0]]), facecolor="0.6"))
    front = scene.footprint[:, 0].max()
    axes.annotate("", (0.0, front + 0.4), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": "k"})
    away = max(math.hypot(*scene.goal), 1e-6)
    shown = min(away, SCENE)
    axes.plot(-scene.goal[1] / away * shown, scene.goal[0] / away * shown, "b*", ms=11)
    axes.set(xlim=(-1.1 * SCENE, 1.1 * SCENE), ylim=(-1.1 * SCENE, 1.1 * SCENE), aspect="equal")
    axes.set_axis_off()
    axes.text(0.0, -1.08 * SCENE, f"within {SCENE:.0f} m, ahead is up", ha="center", va="top", fontsize=8)
