import math
from dataclasses import replace

import numpy as np
import pytest

from robots.noise import NoiseConfig
from robots.registry import make_body
from robots.simulation import Rates, Simulation, SimulationDiverged
from tests.robots.halls import hall
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import between
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, Pose2, VelocityCommand
from vuca_nav.wire import nanoseconds, quaternion_of, round_odometry, round_scan, seconds, tilt_of, yaw_of
from worlds.checks import check_task
from worlds.registry import make_world
from worlds.world import Box, Cylinder, Mover, MoverPart, Obstacle, Patrol

FORWARD = VelocityCommand(1.0, 0.0, 0.0)


def run(simulation, command, ticks):
    return [simulation.step(command) for _ in range(ticks)]


def test_a_square_hall_is_seen_as_it_is(tiago):
    simulation = Simulation(hall(8.0, Pose2(3.0, 5.0, math.pi / 2.0)), tiago, 0, noise=NoiseConfig.none())
    scan, odometry = simulation.reset()
    assert (scan.stamp, odometry.stamp) == (0.0, 0.0)
    assert odometry.odom_from_base == (0.0, 0.0, 0.0)
    # Beam 180 is ahead (+y of the hall), 270 to the left (-x).
    np.testing.assert_allclose(scan.ranges[[180, 270, 0, 90]], (3.0, 3.0, 5.0, 5.0), atol=1e-3)
    assert simulation.clearance == pytest.approx(3.0 - 0.267, abs=0.003)


def test_time_and_stamps_do_not_drift(simulation):
    for scan, odometry in run(simulation, STOP, 100):
        assert scan.stamp == odometry.stamp
    assert simulation.time == 3.333333333  # whole nanoseconds
    assert simulation.data.time == pytest.approx(0.5 + 100 / 30, abs=1e-9)


@pytest.mark.parametrize("name", ["tiago", "go2"])
def test_readings_are_what_messages_carry(name):
    simulation = Simulation(hall(8.0, Pose2(4.0, 4.0, 0.3)), make_body(name), 0, noise=NoiseConfig())
    simulation.reset()
    for scan, odometry in run(simulation, VelocityCommand(0.3, 0.0, 1.0), 20):
        assert round_scan(scan).ranges.tobytes() == scan.ranges.tobytes()
        assert (round_odometry(odometry), seconds(nanoseconds(odometry.stamp))) == (odometry, odometry.stamp)
        yaw = odometry.odom_from_base.yaw
        assert yaw_of(quaternion_of(*tilt_of(odometry.up), yaw)) == yaw != 0.0


def test_driving_into_a_wall_is_reported_and_so_is_the_clearance(tiago):
    simulation = Simulation(hall(6.0, Pose2(4.0, 3.0, 0.0)), tiago, 0, noise=NoiseConfig.none())
    simulation.reset()
    clearances = []
    while simulation.contact is None and simulation.time < 5.0:
        simulation.step(FORWARD)
        clearances.append(simulation.clearance)
    assert (simulation.contact, simulation.contact_name) == ("wall", "wall_3")
    assert 6.0 - simulation.true_pose.x == pytest.approx(0.265, abs=0.02)
    assert clearances == sorted(clearances, reverse=True)
    assert clearances[-1] < 0.02
    run(simulation, STOP, 30)
    assert simulation.contact == "wall"  # the first touch is kept


def test_a_mover_that_walks_into_it_is_reported_by_its_kind(tiago):
    mover = Mover(
        "person", (MoverPart(Cylinder(0.0, 0.0, 0.2, 1.7)),), 0.2, Pose2(32.0, 30.0, 0.0),
        Patrol(0.8, ((32.0, 30.0), (28.0, 30.0))),
    )  # fmt: skip
    simulation = Simulation(replace(hall(), movers=(mover,)), tiago, 0, noise=NoiseConfig.none())
    simulation.reset()
    while simulation.contact is None and simulation.time < 5.0:
        simulation.step(STOP)
    assert simulation.contact == "person"
    assert simulation.time == pytest.approx((2.0 - 0.2 - 0.265) / 0.8, abs=0.1)


def test_something_low_that_the_laser_cannot_see_is_still_touched(tiago):
    low = Obstacle("low", Cylinder(31.5, 30.0, 0.2, 0.07))
    world = hall()
    simulation = Simulation(replace(world, obstacles=(*world.obstacles, low)), tiago, 0, noise=NoiseConfig.none())
    scan, _ = simulation.reset()
    assert np.isinf(scan.ranges).all()
    run(simulation, FORWARD, 90)
    assert simulation.contact == "low"


@pytest.mark.parametrize(("base", "touched"), [(2.1, None), (1.27, None), (1.2, "wall"), (0.5, "wall")])
def test_a_beam_is_touched_by_a_body_that_is_taller_than_its_lower_face(tiago, base, touched):
    """It hangs above the laser, which sees nothing; contact, clearance and the check of the task agree."""
    beam = Obstacle("wall", Box(31.5, 30.0, 0.2, 8.0, 0.0, 0.3, base=base))
    world = replace(hall(), obstacles=(*hall().obstacles, beam), goal=(33.0, 30.0))
    simulation = Simulation(world, tiago, 0, noise=NoiseConfig.none())
    scan, _ = simulation.reset()
    assert np.isinf(scan.ranges).all()
    assert (simulation.clearance < 2.0) == (touched is not None)
    run(simulation, FORWARD, 120)
    assert simulation.contact == touched
    if touched is None:
        assert simulation.true_pose.x > 32.0
        assert check_task(world, tiago.spec.footprint, height=tiago.height) == pytest.approx(3.0, rel=0.01)


def test_same_seed_same_bits_other_seed_other_bits(tiago):
    world = make_world("factory", 1, region=1)
    rng = np.random.default_rng(0)
    commands = [VelocityCommand(*rng.uniform(-1, 1, 3)) for _ in range(60)]

    def record(simulation):
        trace = [simulation.reset(), *(simulation.step(command) for command in commands)]
        ranges = np.array([scan.ranges for scan, _ in trace])
        poses = np.array([odometry.odom_from_base for _, odometry in trace])
        return ranges, poses, np.array(simulation.true_pose)

    first = Simulation(world, tiago, 5, noise=NoiseConfig())
    runs = [record(first), record(first), record(Simulation(world, tiago, 5, noise=NoiseConfig()))]
    for other in runs[1:]:
        for a, b in zip(runs[0], other):
            np.testing.assert_array_equal(a, b)
    other = record(Simulation(world, tiago, np.random.SeedSequence(6), noise=NoiseConfig()))
    assert (other[0] != runs[0][0]).any()
    assert (other[1] != runs[0][1]).any()
    np.testing.assert_array_equal(other[2], runs[0][2])  # noise of the sensors does not move the robot


@pytest.mark.parametrize("robot", ["tiago", "go2"])
def test_leaving_the_scene_out_of_the_physics_where_it_is_out_of_reach_changes_nothing(robot, monkeypatch):
    world, body = make_world("factory", 2, region=1), make_body(robot)
    commands = [VelocityCommand(0.6, 0.0, math.sin(0.05 * i)) for i in range(300)]

    def record():
        simulation = Simulation(world, body, 0, noise=NoiseConfig.none())
        simulation.reset()
        return [(*simulation.data.qpos, simulation.contact) for _ in map(simulation.step, commands)]

    skipping = record()
    monkeypatch.setattr("robots.simulation.SAFE_DISTANCE", math.inf)
    always = record()
    assert skipping == always
    assert skipping[0][-1] is None
    assert skipping[-1][-1] is not None


def test_perfect_odometry_is_the_true_pose(tiago):
    world = hall(start=Pose2(30.0, 30.0, 2.0))
    simulation = Simulation(world, tiago, 0, noise=NoiseConfig.none(), perfect_odometry=True)
    simulation.reset()
    _, odometry = run(simulation, VelocityCommand(0.5, 0.0, 0.4), 120)[-1]
    assert odometry.odom_from_base == pytest.approx(between(world.start, simulation.true_pose), abs=1e-4)
    assert odometry.twist == pytest.approx((0.5, 0.0, 0.4), abs=0.01)


@pytest.mark.parametrize(
    ("rates", "complaint"), [((300, 70, 35), "physics 300"), ((300, 60, 25), "control 60"), ((300, 0, 30), "control 0")]
)
def test_rates_that_do_not_divide_are_refused(rates, complaint):
    with pytest.raises(BadArgument, match=complaint):
        Rates(*rates)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_command_that_is_not_finite_is_refused(simulation, bad):
    with pytest.raises(BadArgument, match="not finite"):
        simulation.step(VelocityCommand(0.1, 0.0, bad))


@pytest.mark.parametrize("bad", [None, 1.0, (0.1, 0.0), (0.1, 0.0, None), "abc", ("a", "b", "c")])
def test_what_is_no_command_is_refused(simulation, bad):
    with pytest.raises(BadArgument, match="no v_x, v_y, w_z"):
        simulation.step(bad)


def test_three_numbers_are_a_command_however_large(simulation):
    for command in ((1, 0, 0), np.array([0.1, 0.0, 0.2]), (1e300, -1e300, 1e300)):
        simulation.step(command)
    assert math.isfinite(sum(simulation.true_pose))


def test_diverging_physics_ends_the_episode(simulation, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log there
    simulation.data.qvel[0] = math.nan
    with pytest.raises(SimulationDiverged, match="diverged"):
        simulation.step(STOP)


def test_telemetry_hears_statics_once_and_poses_every_tick(tiago):
    class Recorder(Telemetry):
        def __init__(self):
            self.calls = []

    def note(name):
        return lambda self, *arguments: self.calls.append((name, [np.copy(a) for a in arguments]))

    names = ("scene", "robot_model", "mover_model", "time", "robot_parts", "true_pose", "movers")
    recorder = type("Recorder", (Recorder,), {name: note(name) for name in names})()
    world = make_world("factory", 1, region=1)
    simulation = Simulation(world, tiago, 0, noise=NoiseConfig.none(), telemetry=recorder)
    simulation.reset()
    run(simulation, FORWARD, 3)
    counts = {name: sum(call[0] == name for call in recorder.calls) for name in names}
    assert counts == {
        "scene": 1, "robot_model": 1, "mover_model": 1, "time": 4, "robot_parts": 4, "true_pose": 4, "movers": 4,
    }  # fmt: skip
    positions, quaternions = next(arguments for name, arguments in recorder.calls if name == "robot_parts")
    assert len(positions) == len(quaternions) == len(tiago.visuals())
    np.testing.assert_allclose(positions[0], (*world.start[:2], tiago.base_height), atol=1e-3)
