"""Messages to values of the stack and back, and what is refused."""

import math
from typing import Any

import numpy as np
import pytest

from vuca_nav.deploy.messages import (
    MOST_MAP_CELLS,
    Refused,
    header_message,
    lidar_of,
    map_message,
    odometry_of,
    path_message,
    pose_message,
    pose_of,
    scan_of,
    tracks_message,
    transform_message,
    twist_stamped_message,
    vertical_of_imu,
)
from vuca_nav.deploy.robot_file import Frames
from vuca_nav.deploy.transforms import StaticTransforms
from vuca_nav.deploy.transport.ros_types import decode, encode, new
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.types import LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand
from vuca_nav.wire import quaternion_of, round_odometry, round_scan, tilt_of, vertical_of

FRAMES = Frames()
LIDAR = LidarSpec(num_beams=271, angle_min=-2.35, angle_increment=0.0174, mount=Pose2(0.2, 0.0, 0.1))
NS = 1_000_000_000


def scan_message(ranges: np.ndarray, lidar: LidarSpec = LIDAR, stamp: int = 5 * NS + 7) -> Any:
    return new(
        "sensor_msgs/msg/LaserScan",
        header=header_message(stamp, "laser"),
        angle_min=lidar.angle_min,
        angle_increment=lidar.pitch,
        scan_time=1.0 / lidar.rate,
        range_min=lidar.min_range,
        range_max=lidar.max_range,
        ranges=ranges.astype(np.float32),
    )


def odometry_message(odometry: Odometry, stamp: int) -> Any:
    message = new("nav_msgs/msg/Odometry", header=header_message(stamp, "odom"), child_frame_id="base_link")
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y, yaw = odometry.odom_from_base
    turn = quaternion_of(*tilt_of(odometry.up), yaw)
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = turn
    twist.linear.x, twist.linear.y, twist.angular.z = odometry.twist
    return message


def over_the_wire(message: Any, type_name: str) -> Any:
    return decode(encode(message, type_name), type_name)


def test_readings_are_the_same_to_the_bit_behind_the_wire() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        stamp = int(rng.integers(1, 10**12))
        ranges = np.where(rng.random(271) < 0.1, np.inf, rng.uniform(0.05, 12.0, 271))
        scan = round_scan(Scan((stamp - NS) / NS, ranges))
        first = over_the_wire(scan_message(scan.ranges), "sensor_msgs/msg/LaserScan")
        assert lidar_of(first, LIDAR) is LIDAR
        message = over_the_wire(scan_message(scan.ranges, stamp=stamp), "sensor_msgs/msg/LaserScan")
        again = scan_of(message, first).scan(epoch=NS)
        assert again.stamp == (stamp - NS) / NS
        assert again.ranges.tobytes() == scan.ranges.tobytes()

        up = vertical_of(rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5))
        pose = Pose2(rng.normal(), rng.normal(), rng.uniform(-math.pi, math.pi))
        odometry = round_odometry(Odometry((stamp - NS) / NS, pose, Twist2(*rng.normal(size=3).tolist()), up))
        message = over_the_wire(odometry_message(odometry, stamp), "nav_msgs/msg/Odometry")
        assert odometry_of(message, FRAMES).odometry(epoch=NS) == odometry


def test_another_lidar_than_that_of_the_bundle_is_taken_as_it_is() -> None:
    message = scan_message(np.full(181, 3.0), LidarSpec(181, 0.05, 25.0, angle_min=-1.57, angle_increment=0.01745))
    lidar = lidar_of(message, LIDAR, Pose2(0.1, 0.0, 0.0))
    assert (lidar.num_beams, lidar.mount, lidar.rate) == (181, Pose2(0.1, 0.0, 0.0), LIDAR.rate)
    assert lidar.max_range == pytest.approx(25.0)
    inverted = lidar_of(message, LIDAR, is_inverted=True)
    assert inverted.angles_in_base()[0] == pytest.approx(LIDAR.mount.yaw + 1.57)
    assert inverted.pitch == pytest.approx(-0.01745)


def change(path: str, value: Any) -> Any:
    def apply(message: Any) -> None:
        *parents, name = path.split(".")
        for parent in parents:
            message = getattr(message, parent)
        setattr(message, name, value)

    return apply


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (change("header.frame_id", "camera"), "frame"),
        (change("header.stamp.sec", -1), "no time"),
        (change("header.stamp.nanosec", NS), "no time"),
        (change("header.stamp", header_message(0, "").stamp), "no stamp"),
        (change("ranges", np.ones(270, np.float32)), "another number"),
        (change("ranges", np.zeros(0, np.float32)), "another number"),
        (change("angle_min", 0.0), "angles or limits"),
        (change("angle_increment", math.nan), "angles or limits"),
        (change("range_max", math.inf), "angles or limits"),
    ],
)
def test_a_scan_of_another_lidar_than_at_first_is_refused(spoil: Any, reason: str) -> None:
    first, message = scan_message(np.ones(271)), scan_message(np.ones(271))
    scan_of(message, first)
    spoil(message)
    with pytest.raises(Refused, match=reason):
        scan_of(message, first)


@pytest.mark.parametrize(
    "spoil",
    [
        change("ranges", np.ones(1, np.float32)),
        change("ranges", np.ones(100_001, np.float32)),
        change("angle_increment", 0.5),
        change("angle_min", math.nan),
        change("range_max", -1.0),
        change("scan_time", math.inf),
    ],
)
def test_a_first_scan_that_is_no_lidars_is_refused(spoil: Any) -> None:
    message = scan_message(np.ones(271))
    spoil(message)
    with pytest.raises(Refused):
        lidar_of(message, LIDAR)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (change("header.frame_id", "map"), "frame"),
        (change("child_frame_id", "base_footprint"), "child frame"),
        (change("pose.pose.position.x", math.nan), "position"),
        (change("pose.pose.position.y", 1e7), "position"),
        (change("pose.pose.orientation.w", 0.0), "rotation"),
        (change("pose.pose.orientation.z", math.nan), "rotation"),
        (change("twist.twist.linear.x", 50.0), "velocity"),
        (change("twist.twist.angular.z", math.inf), "velocity"),
    ],
)
def test_odometry_that_is_none_is_refused(spoil: Any, reason: str) -> None:
    message = odometry_message(Odometry(0.0, Pose2(1.0, 2.0, 0.0), Twist2(0.1, 0.0, 0.0)), NS)
    odometry_of(message, FRAMES)
    spoil(message)
    with pytest.raises(Refused, match=reason):
        odometry_of(message, FRAMES)


def test_an_imu_shows_the_vertical_if_it_has_one() -> None:
    message = new("sensor_msgs/msg/Imu", header=header_message(NS, "base_link"))
    x, y, z, w = quaternion_of(0.1, 0.2, 1.0)
    message.orientation = new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    assert vertical_of_imu(message, FRAMES) == pytest.approx(vertical_of(0.1, 0.2))
    message.orientation_covariance[0] = -1.0
    with pytest.raises(Refused, match="no orientation"):
        vertical_of_imu(message, FRAMES)


def test_goals_are_poses_of_the_map() -> None:
    header = header_message(NS, "map")
    assert pose_of(header, pose_message(Pose2(1.0, -2.0, 0.5)), "map") == Pose2(1.0, -2.0, 0.5)
    with pytest.raises(Refused, match="frame is not map"):
        pose_of(header_message(NS, "odom"), pose_message(Pose2(1.0, -2.0, 0.5)), "map")
    with pytest.raises(Refused, match="position"):
        pose_of(header, pose_message(Pose2(math.inf, 0.0, 0.0)), "map")
    with pytest.raises(Refused, match="zero"):
        pose_of(header, new("geometry_msgs/msg/Pose"), "map")


def test_a_command_carries_the_stamp_that_it_answers() -> None:
    message = twist_stamped_message(VelocityCommand(0.5, 0.1, -0.3), 3 * NS + 5, FRAMES)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (3, 5, "base_link")
    assert (message.twist.linear.x, message.twist.linear.y, message.twist.angular.z) == (0.5, 0.1, -0.3)


def test_the_known_part_of_the_map_is_published() -> None:
    grid = OccupancyGrid(GridConfig(), (0.0, 0.0))
    level = np.zeros((40, 60), np.int8)
    level[3, 5], level[10:20, 10:30] = 20, -20
    grid.fill(level, (1.0, -1.0))
    message = map_message(grid, NS, FRAMES)
    cells = message.data.reshape(message.info.height, message.info.width)
    corner = message.info.origin.position
    assert message.info.resolution == pytest.approx(0.05)
    row, column = round((-1.0 + 3 * 0.05 - corner.y) / 0.05), round((1.0 + 5 * 0.05 - corner.x) / 0.05)
    assert cells[row, column] == 100
    assert (cells == 100).sum() == 1
    assert (cells == 0).sum() == 200
    assert set(np.unique(cells)) == {-1, 0, 100}
    over_the_wire(message, "nav_msgs/msg/OccupancyGrid")


def test_a_vast_map_is_published_coarser() -> None:
    grid = OccupancyGrid(GridConfig(), (0.0, 0.0))
    level = np.full((2100, 4100), -5, np.int8)
    level[1000, 2000] = 9
    grid.fill(level, (0.0, 0.0))
    message = map_message(grid, NS, FRAMES)
    assert len(message.data) <= MOST_MAP_CELLS
    assert message.info.resolution == pytest.approx(0.1)
    assert (message.data == 100).sum() == 1


def test_a_path_looks_along_itself() -> None:
    message = path_message(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), NS, FRAMES)
    yaws = [pose_of(pose.header, pose.pose, "map").yaw for pose in message.poses]
    assert yaws == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert path_message(np.empty((0, 2)), NS, FRAMES).poses == []
    assert len(path_message(np.zeros((5000, 2)), NS, FRAMES).poses) <= 1000


def test_a_moving_track_has_an_arrow() -> None:
    tracks = np.array([[1.0, 2.0, 0.5, 0.0, 0.3, 1.0, 1.0], [4.0, 0.0, 0.0, 0.0, 0.2, 1.0, 0.0]])
    markers = tracks_message(tracks, NS, FRAMES).markers
    assert [marker.type for marker in markers] == [3, 0, 3]
    assert markers[1].points[1].x == 1.5
    assert markers[0].header.frame_id == "base_link"


def transform(parent: str, child: str, roll: float, yaw: float, *move: float) -> Any:
    message = transform_message(Pose2(0.0, 0.0, 0.0), 0, parent, child)
    stamped = message.transforms[0].transform
    stamped.translation.x, stamped.translation.y, stamped.translation.z = move
    x, y, z, w = quaternion_of(roll, 0.0, yaw)
    stamped.rotation = new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    return message


def test_the_mount_follows_the_tree_of_frames() -> None:
    static = StaticTransforms()
    static.add(transform("torso", "laser", 0.0, math.pi / 2, 0.0, 0.1, 0.2))
    assert static.mount("base_link", "laser") is None
    static.add(transform("base_footprint", "base_link", 0.0, 0.0, 0.0, 0.0, 0.1))
    static.add(transform("base_footprint", "torso", 0.0, math.pi / 2, 0.3, 0.0, 0.5))
    mount = static.mount("base_link", "laser")
    assert mount is not None
    assert mount.base_from_lidar == pytest.approx((0.2, 0.0, math.pi), abs=1e-9)
    assert not mount.is_inverted


def test_a_lidar_may_hang_but_not_lean() -> None:
    static = StaticTransforms()
    static.add(transform("base_link", "laser", math.pi, 0.3, 0.1, 0.0, 0.2))
    mount = static.mount("base_link", "laser")
    assert mount is not None
    assert mount.is_inverted
    assert mount.base_from_lidar.yaw == pytest.approx(0.3)
    static.add(transform("base_link", "leaning", 0.2, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(Refused, match="level"):
        static.mount("base_link", "leaning")


def test_bad_transforms_change_nothing() -> None:
    static = StaticTransforms()
    for message in (transform("a", "b", 0.0, 0.0, math.nan, 0.0, 0.0), transform("a", "b", 0.0, 0.0, 0.0, 0.0, 1e9)):
        with pytest.raises(Refused):
            static.add(message)
    static.add(transform("a", "b", 0.0, 0.0, 1.0, 0.0, 0.0))
    static.add(transform("b", "a", 0.0, 0.0, 1.0, 0.0, 0.0))  # a circle
    assert static.mount("base_link", "b") is None
