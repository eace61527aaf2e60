"""Occupancy maps of ROS's map_server: a YAML file beside an image, every occupied cell a wall.

Format: https://wiki.ros.org/map_server and nav2_map_server (``map_io.cpp``), with its modes trinary, scale and raw.
"""

import io
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from vuca_nav.data_files import read_bytes, shown
from vuca_nav.errors import BadWorld, UnknownName
from vuca_nav.geometry import wrap_angle
from vuca_nav.types import Pose2
from vuca_nav.yaml_file import Document, read_yaml
from worlds.checks import MAX_EXTENT, BadField, check_world
from worlds.importers.fields import Fields, world_name
from worlds.importers.tasks_of_maps import longest_way
from worlds.wall_grid import WallGrid, rectangles_of
from worlds.world import Box, Obstacle, World, walls_of

UNKNOWNS = ("solid", "free", "unknown")
"""What unknown cells may be: walls, free floor, or free floor that a map given to the robot leaves unknown."""
OCCUPIED, FREE, UNKNOWN = 1, 0, 2
"""Values of cells."""
MODES = ("trinary", "scale", "raw")
MOST_PIXELS = 40_000_000
"""Greatest number of cells; 200 m at 0.05 m are 16 million."""
MOST_WALLS = 20_000
"""Greatest number of rectangles, as in scene files."""
MOST_BYTES = 64 * 2**20
"""Greatest size of an image file [bytes]."""
WALL_HEIGHT = 2.0
"""Height of the walls [m], that of the generated worlds'; a map has none."""
FENCE = 0.1
"""Thickness of the walls about a map whose unknown cells are solid [m]."""
_FORMATS = ("PNG", "PPM")


class CellMap(NamedTuple):
    """Cells of a map with their place in the world."""

    cells: NDArray[np.uint8]
    """``OCCUPIED``, ``FREE`` or ``UNKNOWN``, (rows, columns); row 0 is the lowest, not the image's first."""
    resolution: float
    """Side of a cell [m]."""
    origin: tuple[float, float, float]
    """Lower-left corner of the lowest row's first cell, and the direction of the rows [m, m, rad]."""


class Task(NamedTuple):
    """Where a robot starts and has to go."""

    start: Pose2
    goal: tuple[float, float]
    """[m]"""


def read_map(path: str | Path) -> CellMap:
    """Read a map by its YAML file.

    A pixel's occupancy is its darkness from 0 to 1, or its brightness with ``negate``. Above ``occupied_thresh`` a cell
    is occupied, below ``free_thresh`` free, between them unknown. A transparent pixel is unknown in the mode scale; in
    the mode trinary transparency is averaged in, as map_server does. In the mode raw the pixel's number is the
    occupancy in percent, and unknown above 100.

    Raises:
        BadWorld: The file or its image cannot be read, the image is too large, out of the file's folder, or of another
            kind, or a field is missing or out of range.
    """
    path = Path(path)
    document = read_yaml(path, BadWorld)
    try:
        return _read(path, document)
    except BadField as error:
        line = document.line_of(error.field)
        raise BadWorld(f"{error} (line {line})" if line else str(error)) from None


def _read(path: Path, document: Document) -> CellMap:
    fields = Fields(str(path), document.value)
    resolution = fields.number("resolution", 1e-3, 10.0)
    x, y, yaw = fields.numbers("origin", 3)
    negate = fields.flag("negate") if "negate" in fields else False
    occupied, free = (
        fields.number(name, 0.0, 1.0) if name in fields else default
        for name, default in (("occupied_thresh", 0.65), ("free_thresh", 0.25))
    )
    if free > occupied:
        raise fields.error("free_thresh", f"{free:g} is above occupied_thresh, which is {occupied:g}; less is right")
    mode = fields.text("mode") if "mode" in fields else "trinary"
    if mode not in MODES:
        raise fields.error("mode", f"{shown(mode)} is not one of {', '.join(MODES)}")
    pixels, depth = _pixels(_image_path(path, fields), resolution)
    cells = _classified(pixels, depth, _Rule(mode, negate, occupied, free))
    return CellMap(
        np.ascontiguousarray(cells[::-1]), resolution, (x, y, yaw if abs(yaw) <= math.pi else wrap_angle(yaw))
    )


def image_of(path: str | Path) -> Path:
    """Path of the image of a map.

    Raises:
        BadWorld: The file cannot be read, or names no image in its folder.
    """
    path = Path(path)
    return _image_path(path, Fields(str(path), read_yaml(path, BadWorld).value))


def load_map(path: str | Path, unknown: str = "solid", task: Task | None = None) -> World:
    """The world of an occupancy map: a wall where a cell is occupied, none where it is free.

    Args:
        path: The map's YAML file.
        unknown: What unknown cells are, one of ``UNKNOWNS``. Where they are solid, the map is fenced in, for all
            beyond it is unknown, too. Otherwise its borders are open.
        task: Start and goal; None for the longest way that there is between two places.

    Raises:
        UnknownName: Unknown cells are to be something else.
        BadWorld: As by :func:`read_map`; the map has too many walls, or no free place for a task.
    """
    if unknown not in UNKNOWNS:
        raise UnknownName("kind of unknown cells", unknown, UNKNOWNS)
    found = read_map(path)
    solid = found.cells == OCCUPIED
    if unknown == "solid":
        solid |= found.cells == UNKNOWN
    walls = rectangles_of(solid)
    unknowns = rectangles_of(found.cells == UNKNOWN) if unknown == "unknown" else ()
    most = max(len(walls), len(unknowns))
    if most > MOST_WALLS:
        raise BadWorld(
            f"{path}: the map's cells make {most} rectangles; at most {MOST_WALLS} would be right, as after removing "
            "single cells"
        )
    rows, columns = found.cells.shape
    grid = WallGrid(found.origin, found.resolution, (columns, rows), walls, unknowns, WALL_HEIGHT)
    fence = _fence(grid) if unknown == "solid" else ()
    if task is None:
        way = longest_way(solid, found.resolution)
        if way is None:
            raise BadWorld(
                f"{path}: no free place for a robot; --start and --goal, or another --unknown, would be right"
            )
        (x, y), goal = (grid.centre((column, row, 1, 1)) for row, column in way)
        task = Task(Pose2(x, y, math.atan2(goal[1] - y, goal[0] - x)), goal)
    world = World(
        world_name(path), 0, grid.bounds, (*fence, *walls_of(grid)), (), task.start, task.goal,
        open_borders=unknown != "solid", grid=grid,
    )  # fmt: skip
    check_world(world, str(path))
    return world


def _fence(grid: WallGrid) -> tuple[Obstacle, ...]:
    """Four walls along the outside of a map's borders."""
    x0, y0, yaw = grid.origin
    width, height = grid.size[0] * grid.resolution, grid.size[1] * grid.resolution
    c, s = math.cos(yaw), math.sin(yaw)
    half = FENCE / 2.0
    sides = (
        (width / 2.0, -half, width + 2.0 * FENCE, FENCE),
        (width / 2.0, height + half, width + 2.0 * FENCE, FENCE),
        (-half, height / 2.0, FENCE, height),
        (width + half, height / 2.0, FENCE, height),
    )
    return tuple(
        Obstacle("wall", Box(x0 + c * u - s * v, y0 + s * u + c * v, length, width_, yaw, grid.height), outer=True)
        for u, v, length, width_ in sides
    )


# -- the image -----------------------------------------------------------------------------------------------------


def _image_path(path: Path, fields: Fields) -> Path:
    """Path of the image, which is in the file's folder or in one beneath."""
    name = fields.text("image")
    folder = path.parent.resolve()
    try:
        image = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a loop of links, a NUL
        raise fields.error("image", f"{shown(name)} is no path of a file") from error
    if not image.is_relative_to(folder):
        raise fields.error("image", f"{shown(name)} leads out of the map's folder; an image in it would be right")
    if not image.exists():
        raise fields.error("image", f"there is no {shown(name)} in {folder}; the image belongs beside the file")
    return image


def _pixels(path: Path, resolution: float) -> tuple[NDArray[Any], int]:
    """Grey values, or red, green, blue with or without alpha, (rows, columns[, channels]), and their greatest value."""
    content = read_bytes(path, MOST_BYTES, BadWorld)
    wrong = f"{path}: not an image that can be read; PGM or PNG would be right"
    try:
        with _quietly(), Image.open(io.BytesIO(content), formats=_FORMATS) as image:
            columns, rows = image.size  # known before the pixels are decoded
            if columns * rows > MOST_PIXELS or max(columns, rows) * resolution > MAX_EXTENT:
                raise BadWorld(
                    f"{path}: {columns} x {rows} pixels of {resolution:g} m; at most {MOST_PIXELS:,} pixels and "
                    f"{MAX_EXTENT:g} m each way would be right"
                )
            if image.mode in ("1", "L"):
                return np.asarray(image.convert("L")), 255
            if image.mode in ("LA", "P", "RGB", "RGBA"):  # map_server reads grey with alpha as colours, too
                has_alpha = image.mode.endswith("A") or (image.mode == "P" and "transparency" in image.info)
                return np.asarray(image.convert("RGBA" if has_alpha else "RGB")), 255
            if image.mode.startswith("I"):
                return np.asarray(image), 65535
    except Image.DecompressionBombError as error:
        raise BadWorld(f"{path}: too many pixels; at most {MOST_PIXELS:,} would be right") from error
    except UnidentifiedImageError as error:  # its own words name a buffer, not the file
        raise BadWorld(wrong) from error
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise BadWorld(f"{wrong} ({shown(error)})") from error
    raise BadWorld(f"{wrong} (of the kind {image.mode})")


@contextmanager
def _quietly() -> Iterator[None]:
    """Leave out Pillow's own warning of large images."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        yield


class _Rule(NamedTuple):
    mode: str
    negate: bool
    occupied: float
    free: float


def _classified(pixels: NDArray[Any], depth: int, rule: _Rule) -> NDArray[np.uint8]:
    """Cells by the rule of nav2_map_server, in the image's order."""
    alpha = pixels[..., 3] if pixels.ndim == 3 and pixels.shape[2] == 4 else None
    if pixels.ndim == 2:
        total, count = pixels.astype(np.uint32), 1
    else:
        total, count = pixels[..., :3].sum(axis=2, dtype=np.uint32), 3
        if alpha is not None and rule.mode == "trinary":
            total, count = total + alpha, count + 1
    # Few different sums: each is judged once, so that a large map costs no floats of its size.
    shade = np.arange(count * depth + 1) / (count * depth)
    if rule.mode == "raw":
        percent = np.rint(255.0 * shade)
        occupancy = percent / 100.0
        unknown = percent > 100
    else:
        occupancy = shade if rule.negate else 1.0 - shade
        unknown = np.zeros(len(shade), np.bool_)
    table = np.full(len(shade), UNKNOWN, np.uint8)
    table[(occupancy > rule.occupied) & ~unknown] = OCCUPIED
    table[(occupancy < rule.free) & ~unknown] = FREE
    cells = table[total]
    if alpha is not None and rule.mode == "scale":
        cells[alpha < depth] = UNKNOWN
    return cells
