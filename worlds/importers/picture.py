"""A picture of a world that was brought in, for comparison with its source's."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.transforms import Affine2D

from vuca_nav.errors import BadArgument
from worlds.importers.occupancy_map import FREE, OCCUPIED, CellMap
from worlds.world import Box, Cylinder, Keyframes, Shape, World

WALL, COURSE, START, GOAL = "tab:red", "tab:orange", "tab:blue", "goldenrod"
SIZE = 9.0
"""Longer side of the picture [inch]."""


def draw(world: World, path: Path, cells: CellMap | None = None) -> None:
    """Draw what stands as outlines, the courses of keyframes, start and goal.

    Args:
        world: The world.
        path: PNG file, written over if it exists.
        cells: The map that it comes from, drawn beneath: black, white, and grey where it is unknown.

    Raises:
        BadArgument: The file cannot be written.
    """
    x0, y0, x1, y1 = world.bounds
    longer = max(x1 - x0, y1 - y0)
    figure = Figure(figsize=(SIZE * (x1 - x0) / longer + 1.0, SIZE * (y1 - y0) / longer + 1.0), layout="constrained")
    axes = figure.subplots()
    if cells is not None:
        shades = np.where(cells.cells == OCCUPIED, 0.0, np.where(cells.cells == FREE, 1.0, 0.75))
        rows, columns = shades.shape
        place = Affine2D().scale(cells.resolution).rotate(cells.origin[2]).translate(*cells.origin[:2])
        axes.imshow(
            shades, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", interpolation="nearest",
            extent=(0.0, columns, 0.0, rows), transform=place + axes.transData,
        )  # fmt: skip
    for obstacle in world.obstacles:
        axes.add_patch(_outline(obstacle.shape, cells is None))
    for mover in world.movers:
        if isinstance(mover.motion, Keyframes):
            axes.plot(*zip(*mover.motion.points), color=COURSE, linewidth=0.6, alpha=0.6)
        axes.add_patch(Circle(mover.start[:2], mover.radius, color=COURSE, alpha=0.5, linewidth=0))
    axes.plot(world.start.x, world.start.y, "s", color=START, label="start")
    axes.plot(*world.goal, "*", color=GOAL, markersize=14, label="goal")
    axes.add_patch(Circle(world.goal, world.tolerance, fill=False, color=GOAL))
    pad = 0.02 * longer
    axes.set(
        aspect="equal", xlim=(x0 - pad, x1 + pad), ylim=(y0 - pad, y1 + pad), xlabel="x [m]", ylabel="y [m]",
        title=f"{world.name}: {len(world.obstacles)} shapes, {len(world.movers)} movers",
    )  # fmt: skip
    try:
        figure.savefig(path, dpi=110)
    except OSError as error:
        raise BadArgument(f"cannot write {path}: {error.strerror or error}") from error


def _outline(shape: Shape, is_filled: bool) -> Patch:
    look = {"facecolor": "0.6" if is_filled else "none", "edgecolor": WALL, "linewidth": 0.5}
    if isinstance(shape, Cylinder):
        return Circle((shape.x, shape.y), shape.radius, **look)
    assert isinstance(shape, Box)
    corner = shape.x - shape.length / 2.0, shape.y - shape.width / 2.0
    return Rectangle(corner, shape.length, shape.width, angle=np.degrees(shape.yaw), rotation_point="center", **look)
