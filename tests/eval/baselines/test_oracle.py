"""The oracles in rooms whose answers are known: times, crossing movers, a corridor that has to be waited for."""

import math
from typing import Any, cast

import numpy as np
import pytest

from eval.baselines.oracle.config import OracleConfig, SearchConfig
from eval.baselines.oracle.search import STEP, TICKS, Path, SpaceTimeSearch
from eval.baselines.oracle.stack import Oracle
from eval.baselines.oracle.truth import Truth, foreseen, outlines_of, straight_on
from eval.episode import Episode, EpisodeConfig
from eval.methods import build, resolve
from robots.clearance import FootprintClearance
from robots.registry import make_body
from tests.vuca_nav.rooms import LIDAR
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose
from vuca_nav.types import Odometry, Pose2, Scan, Twist2
from worlds.arrays import pack_shapes
from worlds.clearance import clearance_field
from worlds.motion.movers import MoverField
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol, World

BODY = make_body("tiago")
RADIUS = BODY.spec.radius
START = Pose2(2.0, 5.0, 0.0)
REST = (0.0, 0.0)


def wall(x0: float, y0: float, x1: float, y1: float) -> Obstacle:
    return Obstacle("wall", Box(0.5 * (x0 + x1), 0.5 * (y0 + y1), x1 - x0, y1 - y0, 0.0, 2.0))


def walker(speed: float, *waypoints: tuple[float, float], radius: float = 0.4) -> Mover:
    part = MoverPart(Cylinder(0.0, 0.0, radius, 1.5))
    return Mover("cylinder", (part,), radius, Pose2(*waypoints[0], 0.0), Patrol(speed, waypoints))


def world_of(*movers: Mover, walls: tuple[Obstacle, ...] = (), goal: tuple[float, float] = (14.0, 5.0)) -> World:
    return World("room", 0, (0.0, 0.0, 16.0, 10.0), walls, movers, START, goal)


def search(world: World, *, seconds: float = 60.0) -> Path:
    movers = MoverField(world)
    static = clearance_field(world.obstacles, world.bounds, 0.05, 1.5)
    planner = SpaceTimeSearch(BODY.spec, static, outlines_of(movers, BODY.height), world.goal, SearchConfig())
    future = foreseen(movers, seconds, None)
    planner.foresee(future)
    return planner.search(START, REST, future, math.inf)


def least_clearance(world: World, path: Path) -> float:
    """Least clearance of the footprint along a path, exact, at every tick between its states too."""
    movers = MoverField(world)
    shapes = pack_shapes([obstacle.shape for obstacle in world.obstacles])
    exact = FootprintClearance(shapes, movers.part_shapes, BODY.spec.footprint, BODY.height)
    least = math.inf
    for before, after in zip(path.states, path.states[1:]):
        for tick in range(TICKS):
            x, y, yaw, *_ = before + (after - before) * (tick / TICKS)
            least = min(least, exact.distance(x, y, yaw, movers.part_poses))
            movers.step(STEP / TICKS)
    return least


def test_in_an_empty_room_it_goes_straight_at_full_speed():
    path = search(world_of())
    assert path.arrives
    assert np.abs(path.states[:, 1] - 5.0).max() < 0.05
    # 12 m at 1 m/s, half a second lost by speeding up at 1 m/s^2, and the last 0.2 m spared.
    assert (len(path.states) - 1) * STEP == pytest.approx(12.0 + 0.5 - 0.2, abs=0.15)
    assert np.abs(np.diff(path.states[:, 3])).max() <= BODY.spec.max_a_x * STEP + 1e-9
    assert np.abs(np.diff(path.states[:, 4])).max() <= BODY.spec.max_a_w * STEP + 1e-9
    assert path.states[:, 3].max() <= BODY.spec.max_v_x


def test_it_passes_a_crossing_mover_that_would_have_met_it():
    # Straight on, the robot is at x = 8 after 6.5 s; so is this mover, from either side.
    for y in (-1.0, 1.0):
        world = world_of(walker(0.6, (8.0, 5.0 + 3.9 * y), (8.0, 5.0 - 4.3 * y)))
        straight = search(world_of())
        assert least_clearance(world, straight) == 0.0
        path = search(world)
        assert path.arrives
        assert least_clearance(world, path) > 0.04
        assert len(path.states) - len(straight.states) <= 30  # 3 s


def test_it_waits_until_a_corridor_is_free():
    # The only way is 1.2 m wide and 6 m long. A mover fills it on its way towards the robot, then goes aside.
    walls = (wall(5.0, 0.0, 11.0, 4.4), wall(5.0, 5.6, 11.0, 10.0))
    world = world_of(walker(0.5, (10.5, 5.0), (4.0, 5.0), (4.0, 9.0)), walls=walls)
    path = search(world)
    assert path.arrives
    assert least_clearance(world, path) > 0.03
    entered = STEP * int(np.argmax(path.states[:, 0] > 5.5))
    assert entered > (10.5 - 5.0) / 0.5  # not before the mover has come out


def test_where_nothing_can_be_reached_the_path_survives():
    walls = (wall(7.0, 0.0, 7.2, 10.0),)
    world = world_of(walker(0.5, (5.5, 5.0), (1.0, 5.0), (5.5, 9.0)), walls=walls)
    movers = MoverField(world)
    static = clearance_field(world.obstacles, world.bounds, 0.05, 1.5)
    planner = SpaceTimeSearch(
        BODY.spec, static, outlines_of(movers, BODY.height), world.goal, SearchConfig(nodes=5_000)
    )
    path = planner.search(START, REST, foreseen(movers, 20.0, None), math.inf)
    assert not path.arrives
    assert math.isinf(planner.length_to_goal(START.x, START.y))
    assert planner.length_to_goal(9.0, 5.0) == pytest.approx(5.0, abs=0.1)


def test_the_future_is_the_movers_own_and_leaves_them_alone():
    world = world_of(walker(0.7, (8.0, 2.0), (8.0, 4.0), (3.0, 4.0)), walker(1.1, (3.0, 8.0), (12.0, 8.0)))
    movers = MoverField(world)
    future = foreseen(movers, 10.0, None)
    assert movers.time == 0.0
    for tick in range(1, 301):
        movers.step(1.0 / 30.0)
        np.testing.assert_allclose(future.movers[tick], movers.poses[:, :2], atol=1e-9)


def test_without_the_future_movers_in_sight_go_straight_on():
    hidden, seen = walker(1.0, (12.0, 8.0), (12.0, 2.0)), walker(0.5, (4.0, 2.0), (4.0, 4.0))
    world = world_of(hidden, seen, walls=(wall(7.0, 5.5, 7.2, 10.0),))
    movers = MoverField(world)
    static = clearance_field(world.obstacles, world.bounds, 0.05, 1.5)
    future = straight_on(movers, 3.0, static, START, sight=12.0)
    assert np.isinf(future.movers[:, 0]).all()
    np.testing.assert_allclose(future.movers[90, 1], (4.0, 2.0 + 3.0 * 0.5))
    assert len(future.movers) == 91


class Simulated:
    """A body that does what it is told at once, among the world's movers."""

    def __init__(self, world: World):
        self.true_pose, self.movers = world.start, MoverField(world)

    def step(self, command) -> None:
        self.true_pose = compose(self.true_pose, Pose2(command.v_x / 30.0, 0.0, command.w_z / 30.0))
        self.movers.step(1.0 / 30.0)


@pytest.mark.parametrize("knows_future", [True, False])
def test_driven_in_closed_loop_it_arrives(knows_future):
    world = world_of(walker(0.6, (8.0, 8.9), (8.0, 0.7)), walker(0.4, (11.0, 2.0), (11.0, 8.0)))
    simulated = Simulated(world)
    oracle = Oracle(OracleConfig(knows_future=knows_future), Truth(world, BODY, cast(Any, simulated)))
    exact = FootprintClearance(pack_shapes([]), simulated.movers.part_shapes, BODY.spec.footprint, BODY.height)
    twist, least = Twist2(0.0, 0.0, 0.0), math.inf
    for tick in range(30 * 30):
        now = tick / 30.0
        command = oracle.step(Scan(now, np.full(LIDAR.num_beams, np.inf)), Odometry(now, START, twist))
        simulated.step(command)
        twist = Twist2(*command)
        least = min(least, exact.distance(*simulated.true_pose, simulated.movers.part_poses))
        if math.dist(simulated.true_pose[:2], world.goal) < 0.3:
            break
    assert math.dist(simulated.true_pose[:2], world.goal) < 0.3
    assert least > 0.03


def test_the_truth_comes_from_an_episode_only():
    body = make_body("tiago")
    for name in ("oracle", "oracle-map"):
        with pytest.raises(BadArgument, match="an oracle drives in the simulation only"):
            build(resolve(name), body.spec, body.lidar)
    episode = Episode(EpisodeConfig(world="square", method="oracle", movers=4, seed=3))
    episode.timeout = 1.0
    result = episode.run()
    assert (result.outcome, result.metrics.slam_ate) == ("timeout", 0.0)
    assert result.metrics.path_length > 0.3


@pytest.mark.parametrize("wrong", [{"cell": 0.0}, {"nodes": 0}, {"static_margin": -0.1}])
def test_settings_out_of_their_range_are_refused(wrong):
    with pytest.raises(BadArgument):
        SearchConfig(**wrong)
