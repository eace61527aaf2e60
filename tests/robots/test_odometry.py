import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robots.bodies.kinematics import heading_rate
from robots.locomotion.odometry import LegOdometer
from robots.noise import NoiseConfig
from robots.own.body import OwnRobot
from robots.registry import ROVER_FILE
from robots.sensors import LidarNoise, WheelOdometer
from robots.simulation import Simulation
from tests.robots.halls import hall
from vuca_nav.geometry import between, wrap_angle
from vuca_nav.types import LidarSpec, Pose2, VelocityCommand

DT = 1.0 / 60.0


def drift(body, noise, seed, length):
    """Error of the final position over the distance of a random drive: two seconds straight on or in an arc."""
    simulation = Simulation(hall(300.0, Pose2(150.0, 150.0, 0.0)), body, seed, noise=noise)
    _, odometry = simulation.reset()
    rng = np.random.default_rng(seed)
    distance, last, tick = 0.0, simulation.true_pose, 0
    command = VelocityCommand(0.0, 0.0, 0.0)
    while distance < length:
        if tick % 60 == 0:
            turn = rng.uniform(-1.0, 1.0) if rng.random() < 0.5 else 0.0
            command = VelocityCommand(rng.uniform(0.3, 1.0), 0.0, turn)
        _, odometry = simulation.step(command)
        pose = simulation.true_pose
        distance += math.hypot(pose.x - last.x, pose.y - last.y)
        last, tick = pose, tick + 1
    truth, believed = between(simulation.world.start, last), odometry.odom_from_base
    return math.hypot(truth.x - believed.x, truth.y - believed.y) / distance


def test_dead_reckoning_drifts_by_2_to_4_percent_of_the_way(tiago):
    drifts = [drift(tiago, NoiseConfig(), seed, 40.0) for seed in range(30)]
    assert 0.02 < np.mean(drifts) < 0.04
    assert np.max(drifts) < 0.12


def test_a_skid_steer_base_needs_a_gyro(tmp_path):
    # 40 m each. With perfect sensors what is left is the skidding, of which the wheels know nothing.
    for name in ("robot.yaml", "rover.xml"):
        text = (ROVER_FILE.parent / name).read_text().replace("heading: gyro", "heading: wheels")
        (tmp_path / name).write_text(text)
    rover, by_wheels = OwnRobot(ROVER_FILE), OwnRobot(tmp_path / "robot.yaml")
    assert 0.01 < np.mean([drift(rover, NoiseConfig(), seed, 40.0) for seed in range(4)]) < 0.05
    assert 0.002 < drift(rover, NoiseConfig.none(), 0, 40.0) < 0.01
    assert drift(by_wheels, NoiseConfig.none(), 0, 40.0) > 0.1


def test_perfect_sensors_do_not_drift(tiago):
    assert max(drift(tiago, NoiseConfig.none(), seed, 40.0) for seed in range(3)) < 0.002


def odometer(noise, seed=0):
    odometer = WheelOdometer(noise, np.random.default_rng(seed), 0.1, DT)
    odometer.start(0.0, 0.0)
    return odometer


def test_a_straight_line_and_a_circle_by_hand():
    straight = odometer(NoiseConfig.none())
    for i in range(1, 61):
        straight.update(10.0 * i * DT, 10.0 * i * DT, 0.0)
    estimate = straight.odometry(1.0)
    assert estimate.odom_from_base == pytest.approx((1.0, 0.0, 0.0))
    assert estimate.twist == pytest.approx((1.0, 0.0, 0.0))
    circle = odometer(NoiseConfig.none())
    circle.update(0.0, 0.0, math.pi / 2.0)  # the gyro is integrated by trapezoids: one sample of standing start
    for i in range(1, 241):
        circle.update(5.0 * i * DT, 15.0 * i * DT, math.pi / 2.0)
    x, y, _ = circle.odometry(4.0).odom_from_base
    assert math.hypot(x, y) < 1e-9  # a full turn


def test_a_leaning_body_heads_where_its_x_axis_points():
    # It spins, pitches and rolls at once; the spin about the vertical alone would be some degrees off.
    dt, world_from_base = 1e-3, Rotation.identity()
    odometer = LegOdometer(NoiseConfig.none(), np.random.default_rng(0), dt)
    odometer.start()
    furthest = 0.0
    for i in range(4000):
        t = (i + 0.5) * dt
        omega = np.array([1.5 * math.cos(3.0 * t), 1.2 * math.cos(2.0 * t + 0.5), 0.4 * math.sin(t)])
        world_from_base = world_from_base * Rotation.from_rotvec(omega * dt)
        matrix = world_from_base.as_matrix()
        odometer.update(np.zeros(2), omega, matrix[2])
        heading = math.atan2(matrix[1, 0], matrix[0, 0])
        furthest = max(furthest, abs(wrap_angle(odometer.odometry(t).odom_from_base.yaw - heading)))
    assert furthest < 2e-3


def test_the_heading_rate_of_a_body_on_its_nose_is_finite():
    assert math.isfinite(heading_rate(np.array([0.0, 1.0, 1.0]), np.array([1.0, 0.0, 0.0])))


def test_scale_errors_and_bias_have_the_size_that_is_configured():
    config = NoiseConfig.none()
    scales, biases = [], []
    for seed in range(400):
        wheels = odometer(NoiseConfig(**{**_fields(config), "encoder_scale_sigma": 0.03}), seed)
        wheels.update(10.0, 10.0, 0.0)
        scales.append(wheels.odometry(0.0).odom_from_base.x - 1.0)
        gyro = odometer(NoiseConfig(**{**_fields(config), "gyro_bias_sigma": 0.01}), seed)
        gyro.update(0.0, 0.0, 0.0)
        biases.append(gyro.odometry(0.0).twist.w_z)
    assert np.std(scales) == pytest.approx(0.03 / math.sqrt(2.0), rel=0.15)  # mean of two wheels
    assert np.std(biases) == pytest.approx(0.01, rel=0.15)


def test_slip_has_the_variance_of_pals_odometry():
    # 0.001 m^2 a metre for each wheel, half of that for their mean; over 20 m, where correlation is forgotten.
    errors = []
    for seed in range(300):
        wheels = odometer(NoiseConfig(**{**_fields(NoiseConfig.none()), "slip_sigma": 0.022, "slip_length": 1.0}), seed)
        for i in range(1, 401):
            wheels.update(0.5 * i, 0.5 * i, 0.0)
        errors.append(wheels.odometry(0.0).odom_from_base.x - 20.0)
    assert np.var(errors) == pytest.approx(0.5 * 0.001 * 20.0, rel=0.25)


def test_lidar_noise_has_the_configured_spread_and_dropouts():
    lidar = LidarSpec()
    noisy = LidarNoise(lidar, NoiseConfig(), np.random.default_rng(0))
    clean = np.full(lidar.num_beams, 5.0)
    scans = np.array([noisy.corrupt(clean) for _ in range(300)])
    lost = np.isinf(scans)
    assert lost.mean() == pytest.approx(0.01, rel=0.1)
    assert np.std(scans[~lost]) == pytest.approx(0.02, rel=0.02)
    assert np.mean(scans[~lost]) == pytest.approx(5.0, abs=0.001)
    assert abs(np.corrcoef(scans[0][~lost[0] & ~lost[64]], scans[64][~lost[0] & ~lost[64]])[0, 1]) < 0.2


def test_lidar_reports_only_valid_ranges():
    lidar = LidarSpec()
    clean = np.full(lidar.num_beams, np.inf)
    clean[:3] = 0.05, 12.0, 3.0
    reported = LidarNoise(lidar, NoiseConfig.none(), np.random.default_rng(0)).corrupt(clean)
    np.testing.assert_array_equal(reported[:3], (np.inf, 12.0, 3.0))
    assert np.isinf(reported[3:]).all()
    scans = LidarNoise(lidar, NoiseConfig(), np.random.default_rng(0)).corrupt(np.full(lidar.num_beams, 12.0))
    assert (scans[np.isfinite(scans)] <= lidar.max_range).all()


def _fields(config):
    return {name: getattr(config, name) for name in config.__dataclass_fields__}
