"""Pictures of failed episodes: the scene, what the robot and the other did last, and how it could have ended well."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from eval.analysis.attribution import Explanation
from eval.analysis.survival import TICK_RATE
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import transform_points
from vuca_nav.types import FloatArray, Pose2
from worlds.world import Cylinder, Shape, World

LAST = 6.0
"""Time before a contact that is drawn [s]."""
AROUND = 4.5
"""Least half side of the part of the scene that is drawn about a contact [m]."""
OUTLINE_PERIOD = 1.0
"""Time between two outlines on a path [s]."""
ROBOT, OTHER, WAY, STANDING = "tab:blue", "tab:red", "tab:green", "0.6"


def draw(explanation: Explanation, path: Path) -> None:
    """Draw an explained episode.

    Args:
        explanation: The episode.
        path: PNG file, written over if it exists.

    Raises:
        BadArgument: The file cannot be written.
    """
    figure = Figure(figsize=(7.0, 8.0), layout="constrained")
    axes = figure.subplots()
    result, world = explanation.result, explanation.episode.world
    _draw_scene(axes, world)
    if result.contact is None:
        poses = explanation.trace.poses
        axes.plot(*poses[:, :2].T, color=ROBOT, label="the robot's way")
        if result.failure is not None:
            axes.plot(*result.failure.where, "x", color=OTHER, markersize=12, label=result.failure.failure_class)
        x0, y0, x1, y1 = world.bounds
        axes.set(xlim=(x0, x1), ylim=(y0, y1))
    else:
        _draw_contact(axes, explanation)
    axes.plot(world.start.x, world.start.y, "s", color=ROBOT)
    axes.plot(*world.goal, "*", color="goldenrod", markersize=16, label="goal")
    config = result.config
    region = "" if config.region is None else f" {config.region}"
    title = f"{config.world}{region}, {config.robot}, {config.method}, seed {config.seed}: {result.outcome}"
    figure.suptitle(f"{title} at {result.duration:.1f} s", fontsize=11)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise BadArgument(f"cannot write {path}: {error.strerror or error}") from error


def _draw_contact(axes: Axes, explanation: Explanation) -> None:
    episode, result, trace, found = explanation.episode, explanation.result, explanation.trace, explanation.avoidable
    assert result.contact is not None
    assert found is not None
    last = len(trace.commands)
    first = max(last - round(LAST * TICK_RATE), 0)
    path = trace.poses[first : last + 1]
    axes.plot(*path[:, :2].T, color=ROBOT, linewidth=2.0, label=f"robot, last {(last - first) / TICK_RATE:.0f} s")
    _draw_outlines(axes, episode.body.spec.footprint, path, ROBOT)
    number = result.contact.other.rpartition("_")[2]
    is_mover = result.contact.straight_for is not None
    if is_mover:
        mover = int(number)
        parts = [p for p, (m, _) in enumerate(_parts(episode.world)) if m == mover]
        course = trace.part_poses[first : last + 1, parts]
        axes.plot(*course[:, :, :2].mean(axis=1).T, color=OTHER, linewidth=2.0, label=result.contact.other)
    _draw_movers(axes, episode.world, trace.part_poses[last], int(number) if is_mover else -1)
    if len(found.way):
        axes.plot(
            *found.way[:, :2].T,
            "--",
            color=WAY,
            linewidth=2.0,
            label=f"a way that survives, {found.seconds:g} s before",
        )
        axes.plot(*found.way[0, :2], "o", color=WAY, markersize=8)
        _draw_outlines(axes, episode.body.spec.footprint, found.way, WAY)
    point = _point_of_contact(explanation)
    axes.plot(*point, "X", color="black", markersize=10, label="contact")
    shown = np.vstack([path[:, :2], found.way[:, :2], [point]])
    middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    half = max(AROUND, 0.5 * float((shown.max(axis=0) - shown.min(axis=0)).max()) + 1.0)
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))


def _point_of_contact(explanation: Explanation) -> tuple[float, float]:
    """Where the outline lies in the direction of the contact [m]."""
    contact = explanation.result.contact
    assert contact is not None
    x, y, yaw = explanation.trace.poses[len(explanation.trace.commands)]
    footprint = explanation.episode.body.spec.footprint
    towards = np.array([np.cos(contact.bearing), np.sin(contact.bearing)])
    reach = float((footprint @ towards).max())
    angle = yaw + contact.bearing
    return float(x + reach * np.cos(angle)), float(y + reach * np.sin(angle))


def _parts(world: World) -> list[tuple[int, Shape]]:
    return [(m, part.shape) for m, mover in enumerate(world.movers) for part in mover.parts]


def _draw_scene(axes: Axes, world: World) -> None:
    for obstacle in world.obstacles:
        shape = obstacle.shape
        _draw_shape(axes, shape, (shape.x, shape.y, 0.0 if isinstance(shape, Cylinder) else shape.yaw), STANDING, 1.0)


def _draw_movers(axes: Axes, world: World, part_poses: FloatArray, touched: int) -> None:
    for (mover, shape), pose in zip(_parts(world), part_poses, strict=True):
        _draw_shape(axes, shape, tuple(pose.tolist()), OTHER if mover == touched else "tab:orange", 0.5)


def _draw_shape(axes: Axes, shape: Shape, pose: tuple[float, ...], colour: str, alpha: float) -> None:
    x, y, yaw = pose
    if not np.isfinite(x):  # a mover that is not there
        return
    if isinstance(shape, Cylinder):
        axes.add_patch(Circle((x, y), shape.radius, color=colour, alpha=alpha, linewidth=0))
        return
    a, b = 0.5 * shape.length, 0.5 * shape.width
    corners = np.array([(a, b), (-a, b), (-a, -b), (a, -b)])
    points = transform_points(Pose2(x, y, yaw), corners)
    axes.add_patch(Polygon(points, color=colour, alpha=alpha, linewidth=0))


def _draw_outlines(axes: Axes, footprint: FloatArray, path: FloatArray, colour: str) -> None:
    """The footprint every second, counted back from the end of the path."""
    for pose in path[:: -round(OUTLINE_PERIOD * TICK_RATE)]:
        points = transform_points(Pose2(*pose.tolist()), footprint)
        axes.add_patch(Polygon(points, fill=False, edgecolor=colour, linewidth=1.0, alpha=0.7))
