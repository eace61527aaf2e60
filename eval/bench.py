"""Speed, measured against named references in one run on one core."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import contextlib
import functools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, TextIO

import mujoco
import numpy as np

from eval.episode import Episode, EpisodeConfig, EpisodeResult
from robots.simulation import Simulation
from vuca_nav.exploration.explorer import Explorer
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.scan_matching import ScanMatcher
from vuca_nav.mapping.slam import Slam
from vuca_nav.navigator import Navigator
from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import PathField
from vuca_nav.policy.dwa import DynamicWindow
from vuca_nav.types import FloatArray, LidarSpec
from worlds.arrays import pack_shapes
from worlds.mjcf import build_arena
from worlds.movers import MoverField
from worlds.raycast import RayCaster
from worlds.registry import make_world

SEED = 0
POSES = 200
"""From so many random poses the lidar looks."""
LOOP = EpisodeConfig(world="factory", region=4, method="dwa-dh")
LOOP_TIME = 100.0
"""Simulated at least [s]."""
STAGES: list[dict[str, Any]] = [
    {"name": "physics", "owner": mujoco, "call": "mj_step"},
    {"name": "moving obstacles", "owner": MoverField, "call": "step"},
    {"name": "lidar", "owner": RayCaster, "call": "cast"},
    {"name": "simulation, other", "owner": Simulation, "call": "step"},
    {"name": "scan matching", "owner": ScanMatcher, "call": "match"},
    {"name": "grid update", "owner": OccupancyGrid, "call": "insert"},
    {"name": "slam, other", "owner": Slam, "call": "update"},
    {"name": "costmap", "owner": Costmap, "call": "__init__"},
    {"name": "path field", "owner": PathField, "call": "__init__"},
    {"name": "exploration", "owner": Explorer, "call": "choose"},
    {"name": "triggers", "owner": Explorer, "call": "trigger"},
    {"name": "local control", "owner": DynamicWindow, "call": "command"},
    {"name": "navigator, other", "owner": Navigator, "call": "step"},
]
"""What is timed; each without the others that it calls."""

Result = dict[str, Any]


def lidar_against_mujoco() -> list[Result]:
    """Our caster against ``mj_multiRay``: the same beams from the same poses, movers included."""
    world, lidar = make_world("factory", SEED, region=4), LidarSpec()
    movers = MoverField(world)
    caster = RayCaster(pack_shapes([o.shape for o in world.obstacles]), movers.part_shapes, lidar)
    model = mujoco.MjModel.from_xml_string(build_arena(world).to_xml_string())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(SEED)
    low, high = np.array(world.bounds[:2]), np.array(world.bounds[2:])
    origins = np.column_stack([rng.uniform(low, high, (POSES, 2)), np.full(POSES, lidar.height)])
    rotations = [_about_z(yaw) for yaw in rng.uniform(-math.pi, math.pi, POSES)]
    angles = lidar.angles_in_base()
    beams = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(lidar.num_beams)])
    directions = [np.ascontiguousarray(beams @ rotation.T).ravel() for rotation in rotations]
    ranges = np.empty(lidar.num_beams)
    geoms, distances = np.empty(lidar.num_beams, np.int32), np.empty(lidar.num_beams)

    def ours() -> None:
        for origin, rotation in zip(origins, rotations):
            caster.cast(origin, rotation, movers.part_poses, ranges)

    def mujocos() -> None:
        for origin, vectors in zip(origins, directions):
            mujoco.mj_multiRay(
                model,
                data,
                origin,
                vectors,
                None,
                1,
                -1,
                geoms,
                distances,
                None,
                lidar.num_beams,
                lidar.max_range,
            )

    fast, slow = _best_of(5, ours) / POSES, _best_of(5, mujocos) / POSES
    return [
        _result("lidar_caster", 1e6 * fast, "us", f"a scan of {lidar.num_beams} beams in factory region 4"),
        _result("lidar_mj_multiray", 1e6 * slow, "us", f"the same by mj_multiRay, {model.ngeom} geoms"),
        _result("lidar_speedup", slow / fast, "x", "mj_multiRay's time over ours"),
    ]


def whole_loop() -> list[Result]:
    """Factory region 4 with its moving obstacles, telemetry off: real-time factor, then each stage's time."""
    Episode(LOOP).run()  # compiles the kernels, or loads them from their cache
    plain = _episodes()
    simulated, wall = sum(episode.duration for episode in plain), sum(episode.wall_time for episode in plain)
    clock = StageClock()
    with contextlib.ExitStack() as stack:
        for stage in STAGES:
            stack.enter_context(clock.watch(stage["name"], stage["owner"], stage["call"]))
        timed = _episodes()
    steps, timed_wall = sum(e.metrics.steps for e in timed), sum(e.wall_time for e in timed)
    seconds = {**clock.seconds, "rest": timed_wall - sum(clock.seconds.values())}
    meaning = f"factory region 4, all moving obstacles, seeds 0 to {len(plain) - 1}, {simulated:.0f} s simulated"
    return [
        _result("loop_real_time_factor", simulated / wall, "x", meaning),
        *(
            _result(
                f"stage: {name}",
                1e6 * spent / steps,
                "us",
                f"a tick of 1/30 s, {100.0 * spent / timed_wall:.1f}% of the loop",
            )
            for name, spent in seconds.items()
        ),
    ]


def _episodes() -> list[EpisodeResult]:
    """One seed after the other until enough time has been simulated."""
    results: list[EpisodeResult] = []
    while sum(result.duration for result in results) < LOOP_TIME:
        results.append(Episode(replace(LOOP, seed=len(results))).run())
    return results


BENCHMARKS: list[dict[str, Any]] = [
    {"name": "lidar", "measure": lidar_against_mujoco},
    {"name": "loop", "measure": whole_loop},
]


def run_benchmarks(progress: TextIO) -> list[Result]:
    """All results, one benchmark after the other; says on ``progress`` which one runs."""
    results: list[Result] = []
    for benchmark in BENCHMARKS:
        print(f"measuring: {benchmark['name']}", file=progress, flush=True)
        results += benchmark["measure"]()
    return results


class StageClock:
    """Times the calls it watches; the time of a watched call inside another counts for the inner one only."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._inner = [0.0]
        """Time of the watched calls inside each call that is going on."""

    @contextlib.contextmanager
    def watch(self, name: str, owner: Any, call: str) -> Iterator[None]:
        """Replace ``owner.call`` by a timed one for as long as the context lasts."""
        original = getattr(owner, call)
        seconds, inner, clock = self.seconds, self._inner, time.perf_counter
        seconds.setdefault(name, 0.0)

        @functools.wraps(original)
        def timed(*args: Any, **kwargs: Any) -> Any:
            inner.append(0.0)
            began = clock()
            try:
                return original(*args, **kwargs)
            finally:
                elapsed = clock() - began
                seconds[name] += elapsed - inner.pop()
                inner[-1] += elapsed

        setattr(owner, call, timed)
        try:
            yield
        finally:
            setattr(owner, call, original)


def _best_of(repeats: int, job: Callable[[], None]) -> float:
    """Least wall time [s], after one run that does not count: the least disturbed one."""
    job()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        job()
        times.append(time.perf_counter() - began)
    return min(times)


def _about_z(yaw: float) -> FloatArray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _result(name: str, value: float, unit: str, meaning: str) -> Result:
    return {"name": name, "value": value, "unit": unit, "meaning": meaning}
