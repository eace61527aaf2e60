"""The safety heatmap at one moment of a run: V^h of every place around the robot, drawn over its map."""

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.episode import Episode, EpisodeConfig, Progress
from eval.methods import BEST_WITH_CRITIC, title_of
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.heatmap import SafetyMap, safety_around
from vuca_nav.exploration.heuristic import LEAST, NoCritic
from vuca_nav.files import write_whole
from vuca_nav.geometry import distance
from vuca_nav.navigator import Navigator
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import FloatArray, Pose2

MOST_PLACES = 1_000_000
"""Greatest number of places: some seconds of the critic's time."""
SIZE = 900
"""Least side of the picture [px]."""
VIRIDIS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]])
"""Five of matplotlib's colours of that name, evenly spaced; equal steps of value are equal steps to the eye."""
WALL, ROBOT, RETURN, GOAL, TARGET = (15, 15, 15), (255, 255, 255), (255, 70, 70), (255, 200, 0), (255, 0, 190)
MARGIN, BAR = 40, 60
"""Margin for the text, and width of the scale [px]."""


@dataclass(frozen=True, slots=True)
class View:
    """The state of an episode that a heatmap shows."""

    config: EpisodeConfig
    time: float
    """Moment of the run [s]."""
    map_from_base: Pose2
    safety: SafetyMap
    occupied: NDArray[np.bool_]
    """(rows, columns) mask of the cells that are occupied in the robot's map, on the same grid."""
    returns_in_map: FloatArray
    """(n, 2) returns of the last scan [m]."""
    target: tuple[float, float] | None
    """The explorer's target [m]; None if it has none."""
    goal: tuple[float, float]
    """Goal of the mission [m]."""

    @property
    def least(self) -> float:
        """Least of the values."""
        return float(self.safety.values.min())

    @property
    def greatest(self) -> float:
        """Greatest of the values."""
        return float(self.safety.values.max())

    def row(self) -> dict[str, Any]:
        """The view as JSON holds it, the values left out."""
        return {
            **self.config.row(),
            "time": self.time,
            "map_from_base": list(self.map_from_base),
            "least": self.least,
            "greatest": self.greatest,
        }


class _Returns(Telemetry):
    """Keeps the last scan's returns."""

    def __init__(self) -> None:
        self.points_in_map = np.empty((0, 2))

    def scan(self, scan, points_in_map) -> None:
        self.points_in_map = points_in_map.copy()


def view_at(
    config: EpisodeConfig, at: float, half_side: float, resolution: float, progress: Progress | None = None
) -> View:
    """Run an episode up to a moment, and ask its critic.

    Args:
        config: The episode.
        at: The moment [s]; if the episode is over earlier, its last one.
        half_side: Half side of the square about the robot [m].
        resolution: Distance between two places [m].
        progress: Called after every step.

    Raises:
        VucaError: The episode cannot be built, its method has no critic, or the grid is no grid.
    """
    if not 0.0 <= at < math.inf:
        raise BadArgument(f"--at must be 0 or more, got {at}")
    if not (0.0 < resolution <= half_side and (2.0 * half_side / resolution) ** 2 <= MOST_PLACES):
        raise BadArgument(
            f"--half-side {half_side} and --resolution {resolution} must be positive and give 1 to {MOST_PLACES} places"
        )
    episode, telemetry = Episode(config), _Returns()
    simulation, navigator, scan, odometry = episode.begin(telemetry)
    critic = navigator.explorer.critic if isinstance(navigator, Navigator) else NoCritic()
    if isinstance(critic, NoCritic) or not isinstance(navigator, Navigator):
        raise BadArgument(f"method {config.method!r} has no critic; take one with V^h, such as {BEST_WITH_CRITIC!r}")
    while True:
        command = navigator.step(scan, odometry)
        if simulation.time >= at - 1e-9 or episode.judge(simulation) is not None:
            break
        scan, odometry = simulation.step(command)
        if progress is not None:
            progress(simulation.time, distance(simulation.true_pose, episode.world.goal))
    pose, percept = navigator.map_from_base, navigator.percept
    assert percept is not None  # it has stepped
    safety = safety_around(lambda points: critic.values(points, percept, pose), pose[:2], half_side, resolution)
    grid, (rows, columns) = navigator.slam.navigation_grid, safety.values.shape
    xs = safety.lower_left[0] + (np.arange(columns) + 0.5) * safety.resolution
    ys = safety.lower_left[1] + (np.arange(rows) + 0.5) * safety.resolution
    target = navigator.explorer.target
    return View(
        config=config,
        time=simulation.time,
        map_from_base=pose,
        safety=safety,
        occupied=np.array([[grid.state(x, y) > 0 for x in xs] for y in ys]),
        returns_in_map=telemetry.points_in_map,
        target=None if target is None else target.point,
        goal=episode.world.goal,
    )


def colours_of(values: FloatArray, scale: tuple[float, float]) -> NDArray[np.uint8]:
    """RGB of values, dark to bright over the scale, (..., 3)."""
    low, high = scale
    at = np.clip((values - low) / max(high - low, LEAST), 0.0, 1.0) * (len(VIRIDIS) - 1)
    return np.stack([np.interp(at, np.arange(len(VIRIDIS)), VIRIDIS[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def draw(view: View, path: Path) -> None:
    """Draw a view into a PNG file.

    Raises:
        OSError: It cannot be written.
    """
    from PIL import Image, ImageDraw

    rows, columns = view.safety.values.shape
    zoom = max(1, round(SIZE / rows))
    low, high = view.safety.scale
    colours = colours_of(view.safety.values, (low, high))
    colours[view.occupied] = WALL
    field = Image.fromarray(np.ascontiguousarray(colours[::-1])).resize(
        (columns * zoom, rows * zoom), Image.Resampling.NEAREST
    )
    picture = Image.new("RGB", (field.width + 2 * MARGIN + BAR, field.height + 2 * MARGIN), (255, 255, 255))
    picture.paste(field, (MARGIN, MARGIN))
    pen = ImageDraw.Draw(picture)
    per_metre = zoom / view.safety.resolution

    def pixel(x: float, y: float) -> tuple[float, float]:
        left, lower = view.safety.lower_left
        return MARGIN + (x - left) * per_metre, MARGIN + field.height - (y - lower) * per_metre

    def dot(x: float, y: float, radius: float, colour: tuple[int, int, int]) -> None:
        u, v = pixel(x, y)
        if MARGIN <= u <= MARGIN + field.width and MARGIN <= v <= MARGIN + field.height:
            pen.ellipse((u - radius, v - radius, u + radius, v + radius), fill=colour, outline=WALL)

    for x, y in view.returns_in_map:
        dot(x, y, 2, RETURN)
    if view.target is not None:
        dot(*view.target, 7, TARGET)
    dot(*view.goal, 9, GOAL)
    pose = view.map_from_base
    corners = [(0.5, 0.0), (-0.3, 0.22), (-0.15, 0.0), (-0.3, -0.22)]
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    arrow = [pixel(pose.x + c * x - s * y, pose.y + s * x + c * y) for x, y in corners]
    pen.polygon(arrow, fill=ROBOT, outline=WALL)

    method = title_of(view.config.method, view.config.options.given())
    words = f"V^h  {view.config.world}, {view.config.robot}, {method}, seed {view.config.seed}"
    pen.text((MARGIN, 8), f"{words}, {view.time:.1f} s", fill=WALL, font_size=18)
    legend = "white: robot   red: returns   magenta: exploration point   gold: goal   black: occupied"
    pen.text((MARGIN, picture.height - MARGIN + 10), legend, fill=WALL, font_size=14)
    bar = colours_of(np.linspace(high, low, field.height)[:, None].repeat(20, axis=1), (low, high))
    picture.paste(Image.fromarray(bar), (2 * MARGIN + field.width - 20, MARGIN))
    for text, v in ((f"{high:.2f}", MARGIN), (f"{low:.2f}", MARGIN + field.height - 16)):
        pen.text((2 * MARGIN + field.width + 4, v), text, fill=WALL, font_size=14)
    content = io.BytesIO()
    picture.save(content, "PNG")
    write_whole(path, content.getvalue())
