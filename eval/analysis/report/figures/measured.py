"""The figures of measurements: courses over the map, V^h around a robot, the shares of a gate's experts."""

import math
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from eval.analysis.measurements.openness import levels_of
from eval.analysis.report.cells import place_of, unique
from eval.analysis.report.comparisons import BEHAVIOURS, Evidence, gate_counts
from eval.analysis.report.figures.drawing import INK, STYLE, Picture, colours_of, label_of, legend, picture_of
from eval.methods import METHODS, title_of
from eval.store import Row

STANDING, MOVING = "#8a93a0", "#d55e00"
ENDS = {"success": "*", "collision": "X", "fall": "v", "timeout": "s"}
"""Markers of the ends of courses."""
EXPERTS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377")
"""Paul Tol's bright colours, which the colour-blind can distinguish."""
LABELLED = 0.08
"""Smallest piece of a bar that is labelled."""
MOST_PANELS = 12
"""Greatest number of panels of a figure."""
LONGEST = 60.0
"""Longest time that shares are drawn over [s]."""


def measured_figures(evidence: Evidence) -> list[Picture]:
    """All figures for which there are measurements."""
    with matplotlib.rc_context(STYLE):  # pyright: ignore[reportArgumentType]
        return [*_courses(evidence), *_heatmaps(evidence), *_gates(evidence), *_gates_in_time(evidence)]


def _courses(evidence: Evidence) -> list[Picture]:
    """Where the methods drove in one mission: for each robot, a panel a place."""
    rows = evidence.rows("courses")
    pictures = []
    for robot in sorted({row["robot"] for row in rows}):
        here = sorted((row for row in rows if row["robot"] == robot), key=_rank)
        colours = colours_of(_title(row) for row in here)
        missions = unique(sorted((place_of(row), row["seed"]) for row in here))[:MOST_PANELS]
        columns = min(2, len(missions))
        lines = math.ceil(len(missions) / columns)
        figure = Figure(figsize=(8.0, 0.6 + 8.0 / columns * lines), layout="constrained")
        panels = figure.subplots(lines, columns, squeeze=False).ravel()
        for axes, (place, seed) in zip(panels, missions):
            members = [row for row in here if (place_of(row), row["seed"]) == (place, seed)]
            _draw_scene(axes, members[0]["scene"])
            for row in members:
                x, y = zip(*row["path"], strict=True)
                axes.plot(x, y, color=colours[_title(row)], linewidth=1.3)
                axes.plot(
                    x[-1], y[-1], ENDS.get(row["outcome"], "o"), color=colours[_title(row)], markersize=7,
                    markeredgecolor=INK, markeredgewidth=0.5,
                )  # fmt: skip
            axes.set_title(label_of(f"{place}, seed {seed}"), fontsize=9)
        for axes in panels[len(missions) :]:
            axes.set_axis_off()
        legend(figure, list(colours), colours)
        caption = (
            "Where each method drove, the same mission for all of a panel. Square: start; circle: goal. Where a course "
            "ends: a star, it arrived; a cross, a collision; a triangle, a fall; a small square, out of time. What "
            "moves is not drawn. Axes in metres."
        )
        pictures.append(picture_of(f"courses-{robot}", f"Courses, {robot}", caption, figure))
    return pictures


def _draw_scene(axes: Axes, scene: dict[str, Any], within: tuple[float, ...] | None = None) -> None:
    """What stands, as one shape, so that a scene of hundreds of obstacles stays small."""
    square = Path.unit_rectangle()
    parts = [
        Affine2D().translate(-0.5, -0.5).scale(length, width).rotate(yaw).translate(x, y).transform_path(square)
        for x, y, yaw, length, width in scene["boxes"]
    ]
    parts += [Affine2D().scale(radius).translate(x, y).transform_path(_CIRCLE) for x, y, radius in scene["cylinders"]]
    if parts:
        axes.add_patch(PathPatch(Path.make_compound_path(*parts), facecolor=STANDING, linewidth=0))
    axes.plot(*scene["start"], "s", color=INK, markersize=4)
    axes.plot(*scene["goal"], "o", color="none", markeredgecolor=INK, markersize=9)
    x0, y0, x1, y1 = within or scene["bounds"]
    axes.set(xlim=(x0, x1), ylim=(y0, y1), aspect="equal")
    axes.tick_params(labelsize=7)


_ANGLES = np.linspace(0.0, 2.0 * np.pi, 13)
_CIRCLE = Path(np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]), closed=True)


def _heatmaps(evidence: Evidence) -> list[Picture]:
    """V^h around the robot at one moment: for each robot, a panel a method and place."""
    rows = sorted((row for row in evidence.rows("heatmap") if row["view"] is not None), key=_rank)
    pictures = []
    for robot in sorted({row["robot"] for row in rows}):
        here = _first_views([row for row in rows if row["robot"] == robot])[:MOST_PANELS]
        columns = min(2, len(here))
        lines = math.ceil(len(here) / columns)
        figure = Figure(figsize=(4.2 * columns, 3.4 * lines), layout="constrained")
        for axes, row in zip(figure.subplots(lines, columns, squeeze=False).ravel(), here):
            view = row["view"]
            (x, y, yaw), half, (low, high) = view["pose"], view["half_side"], view["scale"]
            around = (x - half, y - half, x + half, y + half)
            image = axes.imshow(
                low + (high - low) * levels_of(view), origin="lower", vmin=low, vmax=high,
                extent=(x - half, x + half, y - half, y + half), interpolation="nearest",
            )  # fmt: skip
            _draw_scene(axes, view["scene"], around)
            for at_x, at_y, radius in view["movers"]:
                if max(abs(at_x - x), abs(at_y - y)) < half:
                    circle = Affine2D().scale(radius).translate(at_x, at_y).transform_path(_CIRCLE)
                    axes.add_patch(PathPatch(circle, facecolor=MOVING, linewidth=0))
            axes.annotate(
                "", (x + 0.9 * math.cos(yaw), y + 0.9 * math.sin(yaw)), (x, y),
                arrowprops={"arrowstyle": "-|>", "color": "white", "linewidth": 2.0},
            )  # fmt: skip
            axes.plot(x, y, "o", color="white", markersize=6)
            axes.set_title(label_of(f"{_title(row)}, {place_of(row)}, seed {row['seed']}"), fontsize=9)
            figure.colorbar(image, ax=axes, shrink=0.8, label="V^h")
        caption = (
            "V^h of every place around the robot as a goal, at one moment of a mission. White: the robot and its "
            "heading; grey: what stands; orange: what moves. That of ours is a chance, that of paper its policy's own "
            "value. Axes in metres."
        )
        pictures.append(picture_of(f"heatmap-{robot}", f"V^h around the robot, {robot}", caption, figure))
    return pictures


def _first_views(rows: Sequence[Row]) -> list[Row]:
    """For each place and method the view of the least seed, of those that all methods have if there is one."""
    found = []
    for place in unique(place_of(row) for row in rows):
        here = [row for row in rows if place_of(row) == place]
        by_method = {title: {row["seed"]: row for row in here if _title(row) == title} for title in map(_title, here)}
        common = set.intersection(*(set(views) for views in by_method.values()))
        found += [views[min(common or views)] for views in by_method.values()]
    return found


def _gates(evidence: Evidence) -> list[Picture]:
    """Mean shares of the experts by situation: a panel a policy."""
    rows = [row for row in evidence.rows("gate") if row["situations"]]
    policies = unique(row["policy"] for row in rows)
    if not policies:
        return []
    figure = Figure(figsize=(8.0, 0.6 + 2.9 * len(policies)), layout="constrained")
    experts = 0
    for axes, policy in zip(figure.subplots(len(policies), 1, squeeze=False)[:, 0], policies):
        here = [row for row in rows if row["policy"] == policy]
        known = {name for row in here for name in row["situations"]}
        names = [*(name for name in BEHAVIOURS if name in known), *sorted(known - set(BEHAVIOURS))]
        counts = gate_counts(here, names)
        shares = counts.shares.sum(axis=0) / np.maximum(counts.decisions.sum(axis=0), 1.0)[:, None]
        experts = max(experts, shares.shape[1])
        bottom = np.zeros(len(names))
        for k, part in enumerate(shares.T):
            axes.bar(range(len(names)), 100.0 * part, 0.7, 100.0 * bottom, color=EXPERTS[k % len(EXPERTS)])
            for x, (low, piece) in enumerate(zip(bottom, part)):
                if piece >= LABELLED:
                    at = 100.0 * (low + piece / 2.0)
                    axes.text(x, at, f"{100 * piece:.0f}", ha="center", va="center", fontsize=8, color="#14181e")
            bottom += part
        decisions = counts.decisions.sum(axis=0)
        axes.set_xticks(range(len(names)), [f"{label_of(n)}\n{d:,.0f}" for n, d in zip(names, decisions)])
        axes.set(ylim=(0.0, 100.0), ylabel="mean share [%]")
        axes.set_title(label_of(policy), fontsize=9)
    _experts(figure, experts)
    caption = (
        "Mean shares of the experts by the robot's situation, by the truth, with the number of decisions; "
        "python -m train.analysis.gate tells what each situation is."
    )
    return [picture_of("gate", "The gate by situation", caption, figure)]


def _gates_in_time(evidence: Evidence) -> list[Picture]:
    """Shares of the experts over the time of one mission: for each robot, a panel a method of the hardest place."""
    rows = sorted((row for row in evidence.rows("courses") if row["expert_shares"]), key=_rank)
    pictures = []
    for robot in sorted({row["robot"] for row in rows}):
        here = [row for row in rows if row["robot"] == robot]
        longest = max(here, key=lambda row: len(row["path"]))
        here = [row for row in here if (place_of(row), row["seed"]) == (place_of(longest), longest["seed"])]
        here = here[:MOST_PANELS]
        figure = Figure(figsize=(8.0, 0.8 + 1.5 * len(here)), layout="constrained")
        experts = 0
        for axes, row in zip(figure.subplots(len(here), 1, squeeze=False)[:, 0], here):
            count = max(map(len, row["expert_shares"]))
            told = row["expert_shares"][: round(LONGEST / max(row["period"], 1e-3))]
            shares = np.array([each if len(each) == count else [0.0] * count for each in told])
            times = row["period"] * np.arange(len(shares))
            experts = max(experts, count)
            axes.stackplot(times, 100.0 * shares.T, colors=EXPERTS[:count], linewidth=0, step="post")
            axes.set(ylim=(0.0, 100.0), xlim=(0.0, times[-1] or 1.0), ylabel="share [%]")
            axes.set_title(label_of(f"{_title(row)}: {row['outcome']}"), fontsize=9)
        figure.axes[-1].set_xlabel("time [s]")
        _experts(figure, experts)
        caption = (
            f"Shares of the experts over the first {LONGEST:g} s of one mission in {place_of(longest)}, seed "
            f"{longest['seed']}; white where the policy was not asked."
        )
        pictures.append(picture_of(f"gate-{robot}", f"The gate over time, {robot}", caption, figure))
    return pictures


def _experts(figure: Figure, count: int) -> None:
    patches = [Patch(color=EXPERTS[k % len(EXPERTS)], label=f"expert {k + 1}") for k in range(count)]
    figure.legend(handles=patches, loc="outside upper center", ncols=max(count, 1))


def _title(row: Row) -> str:
    return title_of(row["method"], row)


def _rank(row: Row) -> tuple:
    names = list(METHODS)
    name = row["method"]
    return (names.index(name) if name in names else len(names), _title(row), place_of(row), row["seed"])
