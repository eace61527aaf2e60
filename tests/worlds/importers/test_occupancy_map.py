"""Maps of map_server: every cell is what the format says it is, to the pixel; broken maps are refused in one line."""

import math
import struct
import zlib

import numpy as np
import pytest
import yaml
from PIL import Image

from tests.shared_data import data_files
from vuca_nav.errors import BadWorld
from worlds import load_scene, save_scene
from worlds.importers.occupancy_map import load_map
from worlds.wall_grid import rectangles_of
from worlds.world import Box, Cylinder

PIXELS = np.full((30, 40), 254, np.uint8)
PIXELS[5:8, 10:30] = 0  # a wall
PIXELS[20:25, 3:6] = 205  # unknown
PIXELS[0, 39] = 0  # a single cell, in the image's upper right corner


def write_map(tmp_path, pixels: np.ndarray = PIXELS, name="room.png", **fields):
    Image.fromarray(pixels).save(tmp_path / name)
    content = {
        "image": name,
        "resolution": 0.1,
        "origin": [-1.0, 2.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        **fields,
    }
    path = tmp_path / "room.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value is not None}))
    return path


def solid_cells(world, shape, resolution, origin):
    """Whether the middle of each pixel is in a shape of the world; row 0 is the image's first, as it is drawn."""
    rows, columns = shape
    x0, y0, yaw = origin
    u = (np.arange(columns) + 0.5) * resolution
    v = (rows - np.arange(rows) - 0.5) * resolution
    c, s = math.cos(yaw), math.sin(yaw)
    xs, ys = x0 + c * u[None, :] - s * v[:, None], y0 + s * u[None, :] + c * v[:, None]
    solid = np.zeros(shape, bool)
    for obstacle in world.obstacles:
        box = obstacle.shape
        assert not isinstance(box, Cylinder)
        c, s = math.cos(box.yaw), math.sin(box.yaw)
        dx, dy = xs - box.x, ys - box.y
        solid |= (abs(c * dx + s * dy) < box.length / 2) & (abs(c * dy - s * dx) < box.width / 2)
    return solid


def expected(pixels, negate=False, occupied=0.65, free=0.196):
    """The rule of map_server's trinary mode, a pixel at a time: 1 occupied, 0 free, -1 unknown."""
    darkness = pixels / 255.0 if negate else 1.0 - pixels / 255.0
    return np.where(darkness > occupied, 1, np.where(darkness < free, 0, -1))


@pytest.mark.parametrize("name", ["room.png", "room.pgm"])
@pytest.mark.parametrize("unknown", ["solid", "free", "unknown"])
@pytest.mark.parametrize("origin", [(-1.0, 2.0, 0.0), (3.0, -2.0, 0.7), (0.0, 0.0, -math.pi / 2)])
def test_every_cell_is_what_the_image_says(tmp_path, name, unknown, origin):
    world = load_map(write_map(tmp_path, name=name, origin=list(origin)), unknown)
    wanted = expected(PIXELS)
    solid = solid_cells(world, PIXELS.shape, 0.1, origin)
    np.testing.assert_array_equal(solid, (wanted == 1) | ((wanted == -1) if unknown == "solid" else False))
    assert world.open_borders == (unknown != "solid")


def test_a_cell_lies_where_its_pixel_is_drawn(tmp_path):
    """The image's last row is the lowest; the origin is its lower-left corner."""
    world = load_map(write_map(tmp_path), "free")
    boxes = [o.shape for o in world.obstacles if isinstance(o.shape, Box)]
    corner = min(boxes, key=lambda box: box.length)
    assert (corner.x, corner.y) == pytest.approx((-1.0 + 39.5 * 0.1, 2.0 + 29.5 * 0.1))
    assert (corner.length, corner.width) == pytest.approx((0.1, 0.1))
    assert world.bounds == pytest.approx((-1.0, 2.0, 3.0, 5.0))


def grey(*values):
    return np.array([values], np.uint8).repeat(12, axis=0).repeat(6, axis=1)


@pytest.mark.parametrize(
    ("fields", "values", "wanted"),
    [
        ({}, (0, 89, 90, 206, 254), (1, 1, -1, 0, 0)),
        ({"negate": 1}, (0, 49, 60, 170, 254), (0, 0, -1, 1, 1)),
        ({"occupied_thresh": 0.5, "free_thresh": 0.5}, (0, 127, 128, 255), (1, 1, 0, 0)),
        ({"mode": "scale"}, (0, 100, 254), (1, -1, 0)),
        ({"mode": "raw"}, (0, 19, 50, 66, 100, 101, 255), (0, 0, -1, 1, 1, -1, -1)),
        ({"mode": "raw", "negate": 1}, (0, 100, 255), (0, 1, -1)),
        ({"free_thresh": None, "occupied_thresh": None, "negate": None}, (0, 89, 192, 254), (1, 1, 0, 0)),
    ],
)
def test_modes_and_thresholds(tmp_path, fields, values, wanted):
    pixels = grey(*values)
    path = write_map(tmp_path, pixels, resolution=0.5, **fields)
    for unknown in ("solid", "unknown"):
        world = load_map(path, unknown)
        solid = solid_cells(world, pixels.shape, 0.5, (-1.0, 2.0, 0.0))[0, 3::6]
        assert solid.tolist() == [w == 1 or (w == -1 and unknown == "solid") for w in wanted]
        assert world.grid is not None
    cells = world.grid.cells(world.grid.unknown)[0, 3::6]
    assert cells.tolist() == [w == -1 for w in wanted]


def test_colours_are_averaged_and_transparency_as_map_server_does(tmp_path):
    colour = np.zeros((12, 36, 4), np.uint8)
    colour[..., 3] = 255
    colour[:, :12, :3] = 250, 250, 250  # free
    colour[:, 12:24, :3] = 255, 0, 0  # a third of the brightness: occupied, 0.667 above 0.65
    colour[:, 24:] = 255, 255, 255, 0  # transparent
    for mode, third in (("trinary", -1), ("scale", -1)):
        path = write_map(tmp_path, colour, resolution=0.5, mode=mode)
        world = load_map(path, "unknown")
        assert world.grid is not None
        solid = solid_cells(world, (12, 36), 0.5, (-1.0, 2.0, 0.0))[0]
        unknown = world.grid.cells(world.grid.unknown)[0]
        # In the mode trinary alpha is a fourth channel: red is (255 + 0 + 0 + 255) / 4, half dark.
        assert solid[18] == (mode == "scale")
        assert unknown[18] == (mode == "trinary")
        assert unknown[30] == (third == -1)


def test_grey_with_transparency_is_read_as_colours_as_map_server_does(tmp_path):
    grey = np.full((12, 24, 2), 255, np.uint8)
    grey[:, :12, 0] = 0  # black and opaque: (0 + 0 + 0 + 255) / 4, dark by three quarters
    world = load_map(write_map(tmp_path, grey, resolution=0.5), "free")
    assert world.grid is not None
    assert world.grid.cells(world.grid.walls)[0].tolist() == [True] * 12 + [False] * 12


def test_rectangles_cover_a_mask_and_nothing_else():
    rng = np.random.default_rng(0)
    for share in (0.1, 0.5, 0.9):
        mask = rng.random((37, 23)) < share
        covered = np.zeros(mask.shape, int)
        for column, row, columns, rows in rectangles_of(mask):
            covered[row : row + rows, column : column + columns] += 1
        np.testing.assert_array_equal(covered, mask.astype(int))
    assert rectangles_of(np.ones((500, 500), bool)) == ((0, 0, 500, 500),)
    assert rectangles_of(np.zeros((5, 5), bool)) == ()


def test_a_map_comes_back_equal_from_a_scene_file(tmp_path):
    for unknown in ("solid", "free", "unknown"):
        world = load_map(write_map(tmp_path, origin=[3.0, -2.0, 0.7]), unknown)
        save_scene(world, tmp_path / "scene.yaml")
        assert load_scene(tmp_path / "scene.yaml") == world


def test_a_map_without_a_task_gets_the_longest_way(tmp_path):
    pixels = np.full((60, 100), 254, np.uint8)
    pixels[:50, 48:52] = 0  # a wall with a way round its lower end
    world = load_map(write_map(tmp_path, pixels), "solid")
    assert (world.start.x - 4.0) * (world.goal[0] - 4.0) < 0.0  # one on each side
    assert min(world.start.y, world.goal[1]) > 6.0  # far from the opening


def png_of(width, height):
    """The head of a PNG of that size, with hardly any data."""

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def outside(tmp_path, path):
    Image.fromarray(PIXELS).save(tmp_path.parent / "outside.png")
    path.write_text(path.read_text().replace("room.png", "../outside.png"))


def link_outside(tmp_path, path):
    Image.fromarray(PIXELS).save(tmp_path.parent / "outside.png")
    (tmp_path / "room.png").unlink()
    (tmp_path / "room.png").symlink_to(tmp_path.parent / "outside.png")


def edited(old, new):
    return lambda tmp_path, path: path.write_text(path.read_text().replace(old, new))


def image_of(content):
    return lambda tmp_path, path: (tmp_path / "room.png").write_bytes(content)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda tmp_path, path: (tmp_path / "room.png").unlink(), "image: there is no room.png"),
        (image_of(png_of(20_000, 20_000)), "at most 40,000,000"),
        (image_of(png_of(10_000, 10_000)), "10000 x 10000 pixels"),
        (image_of(b"P5\n20000 20000\n255\n"), "at most 40,000,000"),
        (image_of(png_of(6_000, 3_000)), "200 m each way"),
        (image_of(b""), "not an image"),
        (image_of(b"\x00\x01\x02" * 100), "not an image"),
        (image_of(png_of(40, 30)), "not an image"),
        (image_of(b"GIF89a" + b"\x00" * 50), "not an image"),
        (image_of(b"P5\n40 30\n255\n"), "not an image"),
        (outside, "leads out of the map's folder"),
        (link_outside, "leads out of the map's folder"),
        (edited("room.png", "/etc/hostname"), "leads out of the map's folder"),
        (edited("resolution: 0.1", "resolution: -0.1"), "resolution: -0.1 is out of range"),
        (edited("resolution: 0.1", "resolution: .nan"), "resolution: nan is out of range"),
        (edited("resolution: 0.1", "resolution: fine"), "resolution: 'fine' is not a number"),
        (edited("resolution: 0.1", ""), "resolution: it is missing"),
        (edited("occupied_thresh: 0.65", "occupied_thresh: 65"), "occupied_thresh: 65 is out of range"),
        (edited("free_thresh: 0.196", "free_thresh: 0.9"), "free_thresh: 0.9 is above occupied_thresh"),
        (edited("negate: 0", "negate: maybe"), "negate: 'maybe' is neither"),
        (edited("negate: 0", "mode: fuzzy"), "mode: fuzzy is not one of trinary, scale, raw"),
        (edited("- 2.0\n", ""), "origin: [-1.0, 0.0] is not a list of 3 numbers"),
        (lambda tmp_path, path: path.write_text(""), "the file: None is not a mapping"),
        (lambda tmp_path, path: path.write_bytes(b"\x89PNG\x00\xff"), "not a text"),
        (lambda tmp_path, path: path.unlink(), "cannot be read"),
    ],
)
def test_a_broken_map_is_refused_in_one_line(tmp_path, change, text):
    path = write_map(tmp_path)
    change(tmp_path, path)
    with pytest.raises(BadWorld) as told:
        load_map(path)
    assert text in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("path", data_files("maps/*/*.yaml"))
def test_public_maps_are_exact_to_the_pixel(path, tmp_path):
    fields = yaml.safe_load(path.read_text())
    pixels = np.asarray(Image.open(path.parent / fields["image"]))
    wanted = expected(pixels, bool(fields["negate"]), fields["occupied_thresh"], fields["free_thresh"])
    world = load_map(path, "free")
    assert world.grid is not None
    solid = world.grid.cells(world.grid.walls)[::-1]
    np.testing.assert_array_equal(solid, wanted == 1)
    if pixels.size < 500_000:  # the shapes themselves, not only the rectangles that they come from
        np.testing.assert_array_equal(solid_cells(world, pixels.shape, fields["resolution"], fields["origin"]), solid)
    save_scene(world, tmp_path / "scene.yaml")
    assert load_scene(tmp_path / "scene.yaml") == world
