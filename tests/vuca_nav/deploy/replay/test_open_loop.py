"""A log of others, written by an independent writer, drives the stack in the open loop; what is wrong is told."""

import json

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tests.vuca_nav.deploy.bundles import write
from tests.vuca_nav.deploy.missions import odometry_message, scan_message
from vuca_nav.deploy.bundle import load_bundle
from vuca_nav.deploy.replay.command import replay
from vuca_nav.deploy.transport.ros_types import encode, new
from vuca_nav.errors import BadArgument, BadLog
from vuca_nav.types import LidarSpec, Pose2, Twist2
from vuca_nav.wire import NANOSECONDS

SCAN, ODOMETRY, TRANSFORMS = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
BEGAN = 100 * NANOSECONDS
LIDAR = LidarSpec(num_beams=241, min_range=0.05, max_range=10.0, angle_min=-2.1, angle_increment=0.0175)
SPEED = 0.5


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return write(tmp_path_factory.mktemp("bundle") / "b")


def mount_message(x, frame="laser"):
    message = new("geometry_msgs/msg/TransformStamped", child_frame_id=frame)
    message.header.frame_id = "base_link"
    message.transform.translation.x, message.transform.rotation.w = x, 1.0
    return new(TRANSFORMS, transforms=[message])


def readings(duration=3.0, scan_rate=15, odometry_rate=30, mount=0.2):
    """Messages of a robot that drives 0.5 m/s along a corridor of 12 m by 3 m: time, topic, type, CDR."""
    rng = np.random.default_rng(0)
    out = [(BEGAN - 1, "/tf_static", TRANSFORMS, encode(mount_message(mount), TRANSFORMS))]
    for k in range(int(duration * odometry_rate)):
        now = BEGAN + k * NANOSECONDS // odometry_rate
        pose = Pose2(SPEED * k / odometry_rate, 0.0, 0.0)
        message = odometry_message(pose, Twist2(SPEED, 0.0, 0.0), now)
        out.append((now, "/odom", ODOMETRY, encode(message, ODOMETRY)))
    for k in range(int(duration * scan_rate)):
        now = BEGAN + k * NANOSECONDS // scan_rate + 1000
        x, angles = SPEED * k / scan_rate + mount, LIDAR.angles_in_base()
        with np.errstate(divide="ignore"):
            walls = [
                (9.0 - x) / np.cos(angles),
                (-3.0 - x) / np.cos(angles),
                1.5 / np.sin(angles),
                -1.5 / np.sin(angles),
            ]
        ranges = np.min([np.where(wall > 0.0, wall, np.inf) for wall in walls], axis=0)
        ranges += 0.01 * rng.normal(size=len(ranges))
        out.append((now, "/scan", SCAN, encode(scan_message(ranges, now, LIDAR), SCAN)))
    return sorted(out, key=lambda message: message[0])


def record(directory, messages):
    """Write messages as ``ros2 bag record -s mcap`` does, by rosbags; returns the file."""
    store, links = get_typestore(Stores.ROS2_JAZZY), {}
    with Writer(directory, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for now, topic, kind, data in messages:
            if topic not in links:
                links[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(links[topic], now, data)
    return next(directory.glob("*.mcap"))


def run(bundle, log, capsys, *options):
    assert replay([str(bundle), str(log), *options, "--json"]) == 0
    told = capsys.readouterr().out
    return json.loads(told.splitlines()[-1]), told


def test_the_stack_runs_at_its_own_rate_and_says_commands(bundle, tmp_path, capsys):
    log = record(tmp_path / "bag", readings())
    result, told = run(bundle, log, capsys, "--goal", "6", "0")
    assert not result["exact"]
    assert (result["scans"], result["odometry"], result["refused"]) == (45, 90, {})
    assert result["ticks"] == pytest.approx(30 * result["duration"] + 1, abs=1)
    assert (result["num_beams"], result["mount"]) == (241, [pytest.approx(0.2), 0.0, 0.0])
    assert result["end"][0] == pytest.approx(SPEED * result["duration"], abs=0.05)
    assert [said["time"] for said in result["said"]] == pytest.approx([0.0, 1.0, 2.0], abs=0.04)
    assert all(said["driven"] == [SPEED, 0.0, 0.0] for said in result["said"])
    assert any(any(said["command"]) for said in result["said"])
    assert "driven" in told


def test_it_is_the_same_a_second_time(bundle, tmp_path, capsys):
    log = record(tmp_path / "bag", readings(1.0))
    assert run(bundle, log, capsys, "--goal", "6", "0") == run(bundle, log, capsys, "--goal", "6", "0")


def test_without_a_goal_it_stands_and_maps(bundle, tmp_path, capsys):
    result, told = run(bundle, record(tmp_path / "bag", readings(1.0)), capsys)
    assert result["goal"] is None
    assert not any(any(said["command"]) for said in result["said"])
    assert "it stands and maps" in told


def test_a_goal_of_the_log_is_taken(bundle, tmp_path, capsys):
    kind = "geometry_msgs/msg/PoseStamped"
    goal = new(kind, header=new("std_msgs/msg/Header", frame_id="map"))
    goal.pose.position.x, goal.pose.orientation.w = 6.0, 1.0
    messages = sorted([*readings(1.0), (BEGAN + NANOSECONDS // 2, "/goal_pose", kind, encode(goal, kind))])
    assert run(bundle, record(tmp_path / "bag", messages), capsys)[0]["goal"] == [6.0, 0.0]


def test_an_initial_pose_of_the_log_is_where_the_map_begins(bundle, tmp_path, capsys):
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    start = new(kind, header=new("std_msgs/msg/Header", frame_id="map"))
    start.pose.pose.position.x, start.pose.pose.position.y, start.pose.pose.orientation.w = 3.0, 1.0, 1.0
    messages = sorted([*readings(1.0), (BEGAN - 2, "/initialpose", kind, encode(start, kind))])
    end = run(bundle, record(tmp_path / "bag", messages), capsys)[0]["end"]
    assert end[:2] == pytest.approx([3.0 + SPEED * 14 / 15, 1.0], abs=0.05)


def test_a_scan_faster_than_the_stack_is_taken_at_the_stacks_rate(bundle, tmp_path, capsys):
    result, _ = run(bundle, record(tmp_path / "bag", readings(1.0, scan_rate=60, odometry_rate=60)), capsys)
    assert result["scans"] == 60
    assert 28 <= result["ticks"] <= 31


def test_what_is_wrong_is_refused_and_counted(bundle, tmp_path, capsys):
    nan = odometry_message(Pose2(float("nan"), 0.0, 0.0), Twist2(0.0, 0.0, 0.0), BEGAN + 5)
    other = scan_message(np.ones(7), BEGAN + NANOSECONDS, LIDAR)
    messages = sorted([
        *readings(2.0),
        (BEGAN + 5, "/odom", ODOMETRY, encode(nan, ODOMETRY)),
        (BEGAN + 6, "/odom", ODOMETRY, b"\x00\x01\x00\x00garbage!"),
        (BEGAN + NANOSECONDS + 7, "/scan", SCAN, encode(other, SCAN)),
    ])  # fmt: skip
    result, told = run(bundle, record(tmp_path / "bag", messages), capsys)
    assert sum(result["refused"].values()) == 3
    assert "/odom: not a message of its type" in result["refused"]
    assert "messages refused" in told


@pytest.mark.parametrize(
    ("left_out", "message"),
    [
        (SCAN, r"no sensor_msgs/msg/LaserScan, which the stack needs \(it has: tf2_msgs/msg/TFMessage\)"),
        (ODOMETRY, "no nav_msgs/msg/Odometry"),
    ],
)
def test_a_log_without_a_sensor_is_told(bundle, tmp_path, left_out, message):
    messages = [each for each in readings(0.5) if each[2] != left_out]
    with pytest.raises(BadLog, match=message):
        replay([str(bundle), str(record(tmp_path / "bag", messages))])


def test_of_several_scans_one_has_to_be_named(bundle, tmp_path, capsys):
    messages = [
        (now, f"{topic}{side}" if topic == "/scan" else topic, kind, data)
        for now, topic, kind, data in readings(0.5)
        for side in (("_front", "_rear") if topic == "/scan" else ("",))
    ]
    log = record(tmp_path / "bag", messages)
    with pytest.raises(
        BadLog, match="several sensor_msgs/msg/LaserScan: /scan_front, /scan_rear; give one of them by --scan"
    ):
        replay([str(bundle), str(log)])
    assert run(bundle, log, capsys, "--scan", "/scan_rear")[0]["scans"] == 7
    with pytest.raises(BadLog, match="has no sensor_msgs/msg/LaserScan of that name"):
        replay([str(bundle), str(log), "--scan", "/scan"])


def test_a_log_of_nothing_is_told(bundle, tmp_path):
    messages = [each for each in readings(0.5) if each[2] != SCAN]
    early = [each for each in readings(0.5) if each[2] == SCAN]
    log = record(tmp_path / "bag", [*early, *messages])
    with pytest.raises(BadLog, match="nothing of the log can be used: /scan: it comes before any odometry"):
        replay([str(bundle), str(log)])


def test_options_of_other_logs_do_not_go_with_our_own(bundle, tmp_path):
    from tests.vuca_nav.deploy.missions import write_log

    write_log(load_bundle(bundle), tmp_path / "log.mcap", 5)
    with pytest.raises(BadArgument, match="go with logs of others"):
        replay([str(bundle), str(tmp_path / "log.mcap"), "--goal", "1", "1"])
