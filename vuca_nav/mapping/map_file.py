"""Maps as files: what ROS's map_server reads, PGM and YAML, and a PNG to look at."""

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_directory, prepare_file, write_whole
from vuca_nav.mapping.grid import FREE_BELOW, OCCUPIED_ABOVE, OccupancyGrid

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Grey levels of map_server's images."""


def prepare_map(given: Path) -> Path:
    """Make the folder of a map, and see that the map can be written, before an hour is spent on it.

    Args:
        given: What ``--save-map`` names: a file that ends in .yaml, or a directory, which gets map.yaml.

    Returns:
        The YAML file; the images go beside it.

    Raises:
        BadArgument: If one of the files cannot be written.
    """
    if given.suffix not in (".yaml", ".yml"):
        if given.is_file():
            raise BadArgument(f"--save-map {given}: a file that ends in .yaml, or a directory, would be right")
        prepare_directory(given, "--save-map")
        given = given / "map.yaml"
    for path in (given, given.with_suffix(".pgm"), given.with_suffix(".png")):
        prepare_file(path, "--save-map")
    return given


def map_image(grid: OccupancyGrid) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """The known part of a grid as an image.

    Returns:
        (rows, columns) grey levels, the greatest y first, and the lower-left corner of the image in the map [m].
    """
    known = np.nonzero(grid.level)
    if not len(known[0]):
        return np.full((1, 1), UNKNOWN, np.uint8), grid.origin
    (low_row, high_row), (low_column, high_column) = ((int(v.min()), int(v.max())) for v in known)
    rows, columns = slice(low_row, high_row + 1), slice(low_column, high_column + 1)
    probability = grid.probability_of_level[grid.level[rows, columns].astype(np.int16) + 128]
    image = np.full(probability.shape, UNKNOWN, np.uint8)
    image[probability > OCCUPIED_ABOVE] = OCCUPIED
    image[probability < FREE_BELOW] = FREE
    corner = (grid.origin[0] + low_column * grid.resolution, grid.origin[1] + low_row * grid.resolution)
    return image[::-1], corner


def write_map(grid: OccupancyGrid, path: Path) -> None:
    """Write a map as ``NAME.pgm`` and ``NAME.yaml``, and for the eye ``NAME.png``.

    Args:
        grid: The map.
        path: The YAML file.
    """
    from PIL import Image

    image, corner = map_image(grid)
    height, width = image.shape
    write_whole(path.with_suffix(".pgm"), b"P5\n%d %d\n255\n" % (width, height) + image.tobytes())
    facts = {
        "image": path.with_suffix(".pgm").name,
        "mode": "trinary",
        "resolution": float(grid.resolution),
        "origin": [round(corner[0], 6), round(corner[1], 6), 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    write_whole(path, yaml.safe_dump(facts, sort_keys=False))
    Image.fromarray(image).save(path.with_suffix(".png"))
