"""Speed, measured against named references in one run on one core."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled bindings are invisible to a static checker.)

import contextlib
import math
from dataclasses import replace
from functools import partial
from typing import Any, TextIO

import mujoco
import numpy as np

from eval.bench.lower_layer import lower_layer
from eval.bench.timing import Result, StageClock, best_of, result
from eval.episode import Episode, EpisodeConfig, EpisodeResult
from eval.runner import worker_pool
from robots.simulation import Simulation
from vuca_nav.exploration.critic import LearnedCritic
from vuca_nav.exploration.explorer import Explorer
from vuca_nav.mapping.alignment import Aligner
from vuca_nav.mapping.grid import OccupancyGrid
from vuca_nav.mapping.slam import Slam
from vuca_nav.navigator import Navigator
from vuca_nav.perception.perception import Perception
from vuca_nav.planning.costmap import Costmap
from vuca_nav.planning.paths import PathField
from vuca_nav.planning.planner import Planner
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.shield.shield import Shield
from vuca_nav.types import FloatArray, LidarSpec
from worlds.arrays import pack_shapes
from worlds.mjcf import build_arena
from worlds.motion.movers import MoverField
from worlds.raycast import RayCaster
from worlds.registry import make_world

SEED = 0
POSES = 200
"""Number of random poses that the lidar is cast from."""
LOOP = EpisodeConfig(world="factory", region=4)
REFERENCE, OURS = "dwa-dh", "ours"
"""The methods whose loops are timed."""
LOOP_TIME, EPISODE_TIME = 100.0, 60.0
"""Least time that is simulated in all, and greatest of one episode [s]."""
STAGES: list[dict[str, Any]] = [
    {"name": "physics", "owner": mujoco, "call": "mj_step"},
    {"name": "moving obstacles", "owner": MoverField, "call": "step"},
    {"name": "lidar", "owner": RayCaster, "call": "cast"},
    {"name": "simulation, other", "owner": Simulation, "call": "step"},
    {"name": "perception", "owner": Perception, "call": "update"},
    {"name": "scan matching", "owner": Aligner, "call": "align"},
    {"name": "grid update", "owner": OccupancyGrid, "call": "insert"},
    {"name": "slam, other", "owner": Slam, "call": "update"},
    {"name": "costmap", "owner": Costmap, "call": "__init__"},
    {"name": "path field", "owner": PathField, "call": "__init__"},
    {"name": "exploration", "owner": Explorer, "call": "update"},
    {"name": "planning", "owner": Planner, "call": "update"},
    {"name": "triggers", "owner": Explorer, "call": "trigger"},
    {"name": "V^h", "owner": LearnedCritic, "call": "values"},
    {"name": "local control", "owner": DynamicWindow, "call": "command"},
    {"name": "policy", "owner": LearnedPolicy, "call": "command"},
    {"name": "shield", "owner": Shield, "call": "command"},
    {"name": "navigator, other", "owner": Navigator, "call": "step"},
]
"""The calls that are timed, each without the others that it calls; those of one name count together."""
WORLD = ("physics", "moving obstacles", "lidar", "simulation, other", "rest")
"""The stages that do not belong to the stack."""


def lidar_against_mujoco() -> list[Result]:
    """Compare ``RayCaster`` with ``mj_multiRay``: the same beams from the same poses, movers included."""
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

    fast, slow = best_of(5, ours) / POSES, best_of(5, mujocos) / POSES
    return [
        result("lidar_caster", 1e6 * fast, "us", f"a scan of {lidar.num_beams} beams in factory region 4"),
        result("lidar_mj_multiray", 1e6 * slow, "us", f"the same by mj_multiRay, {model.ngeom} geoms"),
        result("lidar_speedup", slow / fast, "x", "mj_multiRay's time over ours"),
    ]


def whole_loop(method: str) -> list[Result]:
    """Time the loop in factory region 4 with movers, telemetry off: real-time factor, then each stage's time."""
    _episode(method, SEED)  # compiles the kernels, or loads them from their cache
    plain = _episodes(method)
    simulated, wall = sum(episode.duration for episode in plain), sum(episode.wall_time for episode in plain)
    clock = StageClock()
    with contextlib.ExitStack() as stack:
        for stage in STAGES:
            stack.enter_context(clock.watch(stage["name"], stage["owner"], stage["call"]))
        timed = _episodes(method)
    steps, timed_wall = sum(e.metrics.steps for e in timed), sum(e.wall_time for e in timed)
    loop, stage_of = ("loop", "stage") if method == REFERENCE else (f"{method}_loop", method)
    where = (
        f"{method} in factory region 4, all moving obstacles, seeds 0 to {len(plain) - 1}, {simulated:.0f} s simulated"
    )
    return [
        result(f"{loop}_real_time_factor", simulated / wall, "x", where),
        *stage_results(clock.seconds, timed_wall, steps, loop, stage_of),
    ]


def stage_results(seconds: dict[str, float], wall: float, steps: int, loop: str, stage: str) -> list[Result]:
    """Each stage's time a tick, and that of the whole stack.

    Args:
        seconds: Time of each stage [s]; a stage that never ran is left out.
        wall: Time of the whole loop [s].
        steps: Number of its ticks.
        loop: Prefix of the name of the stack's result.
        stage: Prefix of the names of the stages' results.
    """
    ran = {name: spent for name, spent in seconds.items() if spent > 0.0}
    ran["rest"] = wall - sum(ran.values())
    whole = sum(spent for name, spent in ran.items() if name not in WORLD)

    def share(spent: float, *, of_the_stack: bool) -> str:
        of_the_loop = f"a tick of 1/30 s, {100.0 * spent / wall:.1f}% of the loop"
        return f"{of_the_loop}, {100.0 * spent / whole:.1f}% of the stack" if of_the_stack else of_the_loop

    return [
        result(f"{loop}_stack", 1e6 * whole / steps, "us", share(whole, of_the_stack=False)),
        *(
            result(f"{stage}: {name}", 1e6 * spent / steps, "us", share(spent, of_the_stack=name not in WORLD))
            for name, spent in ran.items()
        ),
    ]


def _episodes(method: str) -> list[EpisodeResult]:
    """Run episodes, one seed after the other, until enough time has been simulated."""
    results: list[EpisodeResult] = []
    while sum(episode.duration for episode in results) < LOOP_TIME:
        results.append(_episode(method, len(results)))
    return results


def _episode(method: str, seed: int) -> EpisodeResult:
    episode = Episode(replace(LOOP, method=method, seed=seed))
    episode.timeout = min(episode.timeout, EPISODE_TIME)
    return episode.run()


BENCHMARKS: list[dict[str, Any]] = [
    {"name": "lidar", "measure": lidar_against_mujoco},
    {"name": f"loop of {REFERENCE}", "measure": partial(whole_loop, REFERENCE)},
    {"name": f"loop of {OURS}", "measure": partial(whole_loop, OURS)},
    {"name": "policy, shield and V^h", "measure": lower_layer},
]


def run_benchmarks(progress: TextIO) -> list[Result]:
    """Run all benchmarks, one after the other, in a process of a single thread.

    Args:
        progress: Receives the name of the benchmark that runs.
    """
    results: list[Result] = []
    with worker_pool(1) as pool:
        for benchmark in BENCHMARKS:
            print(f"measuring: {benchmark['name']}", file=progress, flush=True)
            results += pool.submit(benchmark["measure"]).result()
    return results


def _about_z(yaw: float) -> FloatArray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
