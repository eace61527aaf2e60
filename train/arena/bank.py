"""The layouts that episodes are drawn from: made once by the worlds' generators, as arrays that all rows share."""

import hashlib
import io
import math
import os
import sys
import time
import zipfile
import zlib
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from tqdm import tqdm

import worlds
from train.arena.bodies import LARGEST_RADIUS
from train.arena.config import ALL_KINDS, CROWDED_KINDS, ArenaConfig
from vuca_nav.errors import BadWorld
from vuca_nav.files import write_whole
from vuca_nav.types import FloatArray
from worlds.arrays import pack_shapes
from worlds.clearance import ClearanceField, clearance_field, distance_to_wide_ways
from worlds.level_raycast import LEVEL_COLUMNS, level_columns
from worlds.registry import make_world
from worlds.scenes import crowded
from worlds.scenes.parts.population import BODIES, MOVER_WAY, long_ways
from worlds.shortest_path import STEPS
from worlds.world import World

MARGIN = 0.1
"""Clearance of the largest body's circle at start, goal and on the path between them [m]."""
MOVER_KINDS = ("cylinder", "box", "cart", "legs", "cylinder", "box", "legs", "person")
"""Kinds of the bank's movers, in turn."""
NUM_MOVERS = 48
"""Number of different movers."""
MAX_PARTS = 3
"""Greatest number of parts of a mover."""
CACHE_ABOVE = 10.0
"""Time from which on a bank that took it to make is kept on disk [s]."""
_STARTS = 16
"""Number of starts in each layout; the goals are spread around them."""
_STARTS_A_ROBOT = 4
"""The same for each robot of a layout that several share: enough for all to start apart."""
_PATH_CELL = 2
"""Spacing of the nodes of paths, in cells of the clearance grid."""
_SOURCES = {"static": "static", "dynamic": "dynamic", "mixed": "static", "square": "square", "corridor": "factory"} | {
    kind: kind for kind in CROWDED_KINDS
}
_CROWDED = {"circle": crowded.circle, "hall": crowded.hall}
_RADII = {"circle": crowded.CIRCLE_RADIUS}
"""Radius of the circle about the middle of the ground that starts and goals lie in, where there is one [m]."""


@dataclass(frozen=True, slots=True)
class Bank:
    """All layouts, one after the other, and the movers' shapes."""

    kind_first: np.ndarray
    """Index of the first layout of each of ``ALL_KINDS``, and one past its last, (kinds, 2)."""
    static: FloatArray
    """Shapes of the static obstacles, (s, LEVEL_COLUMNS)."""
    first: np.ndarray
    """Index of each layout's first shape, and the number of all shapes, (layouts + 1,)."""
    grids: FloatArray
    """Origin x, y and resolution of each layout's grids, (layouts, 3) [m]."""
    grid_shape: np.ndarray
    """Index of the first cell of each layout's grid, its rows and its columns, (layouts, 3)."""
    clearance: np.ndarray
    """Clearance of every cell's centre from static obstacles, all layouts, (cells,) float32 [m]."""
    away: np.ndarray
    """Distance of every cell to the wide paths that movers keep to, (cells,) float32 [m]."""
    places: FloatArray
    """Places where movers may start, (q, 2) [m]."""
    places_of: np.ndarray
    """Index of each layout's first place, and the number of all places, (layouts + 1,)."""
    pairs: FloatArray
    """Tasks: start x, y, goal x, y and length of the shortest path, (layouts, p, 5) [m]."""
    part_shapes: FloatArray
    """Shapes of the movers' parts, (b, MAX_PARTS, LEVEL_COLUMNS)."""
    part_local: FloatArray
    """x, y, cos, sin of the parts in the mover's frame, and their swing, (b, MAX_PARTS, 5) [m]."""
    part_count: np.ndarray
    """Number of parts of each mover, (b,)."""
    mover_radius: FloatArray
    """(b,) [m]"""


def make_bank(config: ArenaConfig) -> Bank:
    """Make the bank of a configuration, or read it from the cache."""
    sizes = f"{config.layouts} {config.pairs} {config.lengths} {config.world_seed}"
    what = f"{sizes} {LARGEST_RADIUS} {_used(config)} {config.robots}"
    file = cache_folder() / f"{hashlib.sha256(_code() + what.encode()).hexdigest()[:32]}.npz"
    names = [field.name for field in fields(Bank)]
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return Bank(**{name: arrays[name] for name in names})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        pass  # not there yet, or not readable: make it
    began = time.perf_counter()
    bank = _make(config)
    if time.perf_counter() - began > CACHE_ABOVE:
        _store(file, {name: getattr(bank, name) for name in names})
    return bank


@cache
def _code() -> bytes:
    """Hash of all code that makes a bank: a bank made by other code is not found."""
    files = [Path(__file__), *sorted(Path(worlds.__path__[0]).rglob("*.py"))]
    return b"".join(hashlib.sha256(file.read_bytes()).digest() for file in files)


def cache_folder() -> Path:
    """Folder of the banks that took long to make."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "vuca-nav" / "arena"


def _used(config: ArenaConfig) -> list[str]:
    """Generators that this configuration needs, each once."""
    return list(dict.fromkeys(_SOURCES[kind] for kind, share in zip(ALL_KINDS, config.shares) if share > 0.0))


def _make(config: ArenaConfig) -> Bank:
    sources, columns = _used(config), _mover_shapes(config.world_seed)
    statics, firsts, grids, shapes, clearances, aways, places, places_of, pairs = [], [0], [], [], [], [], [], [0], []
    total = len(sources) * config.layouts
    bar = tqdm(total=total, desc="worlds", unit="layout", file=sys.stderr, disable=total < 20)
    for source in sources:
        for k in range(config.layouts):
            rng = np.random.default_rng(np.random.SeedSequence((config.world_seed, sources.index(source), k)))
            world, tasks = _layout(source, config, k, rng)
            field = clearance_field(world.obstacles, world.bounds)
            away = distance_to_wide_ways(field, MOVER_WAY)
            free = field.centres(np.argwhere(long_ways(away, field.resolution)))
            shapes.append((sum(len(c) for c in clearances), *away.shape))
            clearances.append(field.distance.astype(np.float32).ravel())
            aways.append(away.astype(np.float32).ravel())
            grids.append((*field.origin, field.resolution))
            statics.append(level_columns(pack_shapes([o.shape for o in world.obstacles])))
            firsts.append(firsts[-1] + len(statics[-1]))
            places.append(free)
            places_of.append(places_of[-1] + len(free))
            pairs.append(tasks)
            bar.update()
    bar.close()
    kind_first = np.array([_span(sources, _SOURCES[kind], config.layouts) for kind in ALL_KINDS], np.int64)
    return Bank(
        kind_first, np.concatenate(statics), np.array(firsts), np.array(grids), np.array(shapes),
        np.concatenate(clearances), np.concatenate(aways), np.concatenate(places), np.array(places_of),
        np.stack(pairs), *columns,
    )  # fmt: skip


def _span(sources: list[str], source: str, layouts: int) -> tuple[int, int]:
    if source not in sources:
        return 0, 0
    k = sources.index(source)
    return k * layouts, (k + 1) * layouts


def _layout(source: str, config: ArenaConfig, k: int, rng: np.random.Generator) -> tuple[World, FloatArray]:
    """Make the k-th world of a source that can be made and holds tasks: without its movers, and its tasks (p, 5)."""
    region, movers = 1 if source == "factory" else None, 0 if source in ("square", "dynamic") else None
    for attempt in range(20):
        seed = config.world_seed + k + attempt * config.layouts
        try:
            if source in _CROWDED:
                world = _CROWDED[source](seed, LARGEST_RADIUS)
            else:
                world = make_world(source, seed, region=region, movers=movers, footprint_radius=LARGEST_RADIUS)
        except BadWorld:
            continue
        tasks = _tasks(clearance_field(world.obstacles, world.bounds), config, rng, _RADII.get(source, math.inf))
        if len(tasks):
            return world, tasks
    raise BadWorld(
        f"{source}, seeds from {config.world_seed + k}: no layout has ways of {config.lengths} m; shorter ones"
    )


def _tasks(field: ClearanceField, config: ArenaConfig, rng: np.random.Generator, radius: float) -> FloatArray:
    """Draw starts and goals with shortest paths of evenly spread lengths in the wanted range, (pairs, 5), or none.

    All are within ``radius`` of the middle of the ground [m].
    """
    free = field.distance >= LARGEST_RADIUS + MARGIN
    if radius < math.inf:
        middle = 0.5 * np.array(free.shape)
        rows, columns = np.indices(free.shape)
        free &= np.hypot(rows + 0.5 - middle[0], columns + 0.5 - middle[1]) * field.resolution <= radius
    coarse = free[::_PATH_CELL, ::_PATH_CELL]
    cells = np.argwhere(coarse)
    if len(cells) < 2:
        return np.empty((0, 5))
    graph = _graph(coarse, field.resolution * _PATH_CELL)
    starts = _STARTS if config.robots == 1 else _STARTS_A_ROBOT * config.robots
    chosen = rng.choice(len(cells), starts)
    lengths = csgraph.dijkstra(graph, indices=chosen)  # (starts, cells)
    low, high = config.lengths
    tasks = np.empty((config.pairs, 5))
    centres = field.centres(cells * _PATH_CELL)
    filled = 0
    for _ in range(20 * config.pairs):
        start = int(rng.integers(starts))
        wanted = rng.uniform(low, high)
        near = np.flatnonzero(np.abs(lengths[start] - wanted) < 0.3)
        if len(near) == 0:
            continue
        goal = int(rng.choice(near))
        tasks[filled] = (*centres[chosen[start]], *centres[goal], lengths[start, goal])
        filled += 1
        if filled == config.pairs:
            return tasks
    return np.empty((0, 5))


def _graph(free: np.ndarray, cell: float) -> sparse.csr_matrix:
    """Graph of the cells and the king's and knight's moves between them [m]."""
    index = np.full(free.shape, -1)
    index[free] = np.arange(int(free.sum()))
    padded = np.pad(index, 2, constant_values=-1)
    rows, columns = np.nonzero(free)
    begins, ends, lengths = [], [], []
    for di, dj in STEPS:
        neighbours = padded[rows + 2 + di, columns + 2 + dj]
        there = neighbours >= 0
        begins.append(index[rows, columns][there])
        ends.append(neighbours[there])
        lengths.append(np.full(int(there.sum()), cell * math.hypot(di, dj)))
    size = int(free.sum())
    return sparse.csr_matrix((np.concatenate(lengths), (np.concatenate(begins), np.concatenate(ends))), (size, size))


def _mover_shapes(seed: int) -> tuple[FloatArray, FloatArray, np.ndarray, FloatArray]:
    """Shapes of NUM_MOVERS movers as the worlds draw them."""
    rng = np.random.default_rng(np.random.SeedSequence((seed, 8)))
    shapes = np.zeros((NUM_MOVERS, MAX_PARTS, LEVEL_COLUMNS))
    local = np.zeros((NUM_MOVERS, MAX_PARTS, 5))
    count, radius = np.zeros(NUM_MOVERS, np.int64), np.zeros(NUM_MOVERS)
    for b in range(NUM_MOVERS):
        kind = MOVER_KINDS[b % len(MOVER_KINDS)]
        parts, radius[b] = BODIES[kind](rng)
        if kind == "cart":
            parts = parts[:1]  # load and handle stay within the platform's outline
        packed = pack_shapes([part.shape for part in parts])
        count[b] = len(parts)
        shapes[b, : len(parts)] = level_columns(packed)
        local[b, : len(parts), :2] = packed.centre
        local[b, : len(parts), 2], local[b, : len(parts), 3] = np.cos(packed.yaw), np.sin(packed.yaw)
        local[b, : len(parts), 4] = [part.swing for part in parts]
    return shapes, local, count, radius


def _store(file: Path, arrays: dict[str, np.ndarray]) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        whole = io.BytesIO()
        np.savez_compressed(whole, **arrays)  # type: ignore[arg-type]
        write_whole(file, whole.getvalue())
    except OSError:
        return  # a cache that cannot be written only costs time
