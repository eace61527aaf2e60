import io
import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from tests.vuca_nav.deploy.bundles import write
from tests.vuca_nav.deploy.missions import write_log
from vuca_nav.deploy.bundle import load_bundle
from vuca_nav.errors import BadLog
from vuca_nav.slam_log.command import slam
from vuca_nav.slam_log.reading import read_log
from vuca_nav.types import STANDING, Pose2

mcap_writer = pytest.importorskip("mcap.writer")
typesys = pytest.importorskip("rosbags.typesys")


def recording(path, *, with_odometry=True, scans=5, cut=0, change=None):
    """A robot that drives 0.1 m between scans, with a lidar 0.2 m ahead of its middle.

    Args:
        path: The file.
        with_odometry: Whether there is Odometry, or else tf.
        scans: Number of scans.
        cut: Number of bytes that are missing at the end.
        change: Called with the topic, the stamp and the message before it is written; what it returns is written,
            bytes as they are.
    """
    beams = 90
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = store.types
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    point = types["geometry_msgs/msg/Point"]
    buffer = io.BytesIO()
    writer = mcap_writer.Writer(buffer, chunk_size=2000)
    writer.start("ros2", "test")
    channels = {}

    def write(topic, kind, message, stamp):
        if topic not in channels:
            schema = writer.register_schema(kind, "ros2msg", b"")
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        message = message if change is None else change(topic, stamp, message)
        data = message if isinstance(message, bytes) else bytes(store.serialize_cdr(message, kind))
        writer.add_message(channels[topic], int(1e9 * stamp), data, int(1e9 * stamp))

    def head(stamp, frame):
        return header(stamp=time(sec=int(stamp), nanosec=round(1e9 * (stamp % 1.0))), frame_id=frame)

    def transform(stamp, parent, child, x):
        kind = types["geometry_msgs/msg/TransformStamped"]
        turn = quaternion(x=0.0, y=0.0, z=math.sin(0.05), w=math.cos(0.05))
        body = types["geometry_msgs/msg/Transform"](translation=vector(x=x, y=0.0, z=0.0), rotation=turn)
        return kind(header=head(stamp, parent), child_frame_id=child, transform=body)

    tf = types["tf2_msgs/msg/TFMessage"]
    write("/tf_static", "tf2_msgs/msg/TFMessage", tf(transforms=[transform(0.0, "base_link", "laser", 0.2)]), 0.0)
    for k in range(scans):
        stamp = 1.0 + 0.2 * k
        if with_odometry:
            kind = types["nav_msgs/msg/Odometry"]
            turn = quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
            pose = types["geometry_msgs/msg/Pose"](position=point(x=0.1 * k, y=0.0, z=0.0), orientation=turn)
            pose = types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))
            still = vector(x=0.0, y=0.0, z=0.0)
            twist = types["geometry_msgs/msg/Twist"](linear=still, angular=still)
            twist = types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36))
            message = kind(header=head(stamp, "odom"), child_frame_id="base_link", pose=pose, twist=twist)
            write("/odom", "nav_msgs/msg/Odometry", message, stamp)
        else:
            write(
                "/tf", "tf2_msgs/msg/TFMessage", tf(transforms=[transform(stamp, "odom", "base_link", 0.1 * k)]), stamp
            )
        ranges = np.full(beams, 2.0, np.float32)
        ranges[0] = np.inf
        scan = types["sensor_msgs/msg/LaserScan"](
            header=head(stamp, "laser"),
            angle_min=-0.5,
            angle_max=0.5,
            angle_increment=0.01,
            time_increment=0.0,
            scan_time=0.2,
            range_min=0.1,
            range_max=12.0,
            ranges=ranges,
            intensities=np.zeros(0, np.float32),
        )
        write("/scan", "sensor_msgs/msg/LaserScan", scan, stamp)
    writer.finish()
    content = buffer.getvalue()
    path.write_bytes(content[: len(content) - cut])
    return path


@pytest.mark.parametrize("with_odometry", [True, False])
def test_a_recording_is_scans_with_odometry_or_tf(tmp_path, with_odometry):
    log = read_log(recording(tmp_path / "a.mcap", with_odometry=with_odometry))
    assert log.stamps == pytest.approx([1.0, 1.2, 1.4, 1.6, 1.8])
    assert log.odometry[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert log.odometry[:, 2] == pytest.approx(np.full(5, 0.0 if with_odometry else 0.1))
    assert log.lidar.mount == pytest.approx((0.2, 0.0, 0.1))
    assert (log.lidar.num_beams, log.lidar.max_range) == (90, 12.0)
    assert log.ranges.shape == (5, 90)


def test_the_directory_of_a_rosbag_is_a_recording_in_the_order_of_its_numbers(tmp_path):
    def later(topic, stamp, message):
        for head in [message.header] if hasattr(message, "header") else [each.header for each in message.transforms]:
            head.stamp.sec += 10
        return message

    recording(tmp_path / "bag_9.mcap")
    recording(tmp_path / "bag_10.mcap", change=later)
    log = read_log(tmp_path)
    assert log.stamps == pytest.approx([1.0, 1.2, 1.4, 1.6, 1.8, 11.0, 11.2, 11.4, 11.6, 11.8])
    assert (log.skipped, log.warnings) == ({}, ())


def test_what_is_no_recording_is_refused(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"ROBOTLASER1 0 0 0\n" * 100)
    with pytest.raises(BadLog, match="MCAP"):
        read_log(other)
    with pytest.raises(BadLog, match="LaserScan"):
        read_log(recording(tmp_path / "none.mcap", scans=0))
    whole = recording(tmp_path / "cut.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:300])
    with pytest.raises(BadLog, match=r"LaserScan.*read only in part"):
        read_log(tmp_path / "cut.mcap")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadLog, match=r"no \.mcap"):
        read_log(tmp_path / "empty")
    with pytest.raises(BadLog, match="needs odometry"):
        read_log(recording(tmp_path / "still.mcap", change=lambda topic, _, m: b"\0" * 8 if topic == "/odom" else m))


def test_of_a_recording_that_was_cut_off_what_is_there_is_read(tmp_path):
    whole = recording(tmp_path / "a.mcap", scans=40).read_bytes()
    (tmp_path / "a.mcap").write_bytes(whole[: len(whole) * 6 // 10])
    log = read_log(tmp_path / "a.mcap")
    assert 15 < len(log.stamps) < 40
    assert len(log.warnings) == 1
    assert "a.mcap is read only in part" in log.warnings[0]


def test_odometry_whose_time_runs_backwards_is_left_out_and_counted(tmp_path):
    """Sorted in, it would pull the poses between to and fro."""

    def change(topic, stamp, message):
        if topic == "/odom" and stamp == pytest.approx(1.4):
            message.header.stamp.nanosec, message.pose.pose.position.x = 100_000_000, 50.0
        if topic == "/odom" and stamp == pytest.approx(1.6):
            message.pose.pose.position.x = np.nan
        return message

    log = read_log(recording(tmp_path / "a.mcap", change=change))
    assert log.odometry[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert set(log.warnings) == {
        "1 poses of odometry left out: time runs backwards",
        "1 poses of odometry left out: no finite pose",
    }


@pytest.mark.parametrize(
    ("broken", "cause"),
    [
        (lambda scan: setattr(scan, "ranges", scan.ranges[:50]), "another size"),
        (lambda scan: setattr(scan, "ranges", np.full(90, np.nan, np.float32)), "more than half of the ranges NaN"),
        (lambda scan: setattr(scan.header.stamp, "sec", 0), "time runs backwards"),
        (lambda scan: setattr(scan.header.stamp, "sec", 1000), "no odometry"),
        (lambda scan: setattr(scan, "angle_increment", np.nan), "another size"),
    ],
)
def test_scans_of_no_use_are_left_out_and_counted(tmp_path, broken, cause):
    def change(topic, stamp, message):
        if topic == "/scan" and stamp == pytest.approx(1.4):
            broken(message)
        return message

    log = read_log(recording(tmp_path / "a.mcap", change=change))
    assert log.skipped == {cause: 1}
    assert log.stamps == pytest.approx([1.0, 1.2, 1.6, 1.8])


def test_messages_that_cannot_be_decoded_are_counted(tmp_path):
    def change(topic, stamp, message):
        return b"\0\1\0\0abc" if topic == "/scan" and stamp == pytest.approx(1.4) else message

    log = read_log(recording(tmp_path / "a.mcap", change=change))
    assert len(log.stamps) == 4
    assert log.warnings == ("1 messages left out: /scan: not a message of its type",)


@pytest.mark.parametrize("limits", [(0.1, np.inf), (0.1, 0.0), (5.0, 1.0)])
def test_scans_of_no_lidar_are_refused(tmp_path, limits):
    def change(topic, _, message):
        if topic == "/scan":
            message.range_min, message.range_max = limits
        return message

    with pytest.raises(BadLog, match=r"a\.mcap: its scans are of no lidar: m.._range must be"):
        read_log(recording(tmp_path / "a.mcap", change=change))


def test_a_lidar_may_hang_upside_down_but_not_lean(tmp_path):
    def turned(x, w):
        def change(topic, _, message):
            if topic == "/tf_static":
                rotation = message.transforms[0].transform.rotation
                rotation.x, rotation.y, rotation.z, rotation.w = x, 0.0, 0.0, w
            return message

        return change

    lidar = read_log(recording(tmp_path / "a.mcap", change=turned(1.0, 0.0))).lidar
    assert (lidar.angle_min, lidar.angle_increment) == pytest.approx((0.5, -0.01))
    assert lidar.mount == pytest.approx((0.2, 0.0, 0.0))
    with pytest.raises(BadLog, match="plane is not level"):
        read_log(recording(tmp_path / "b.mcap", change=turned(math.sin(0.2), math.cos(0.2))))


def test_a_lidar_whose_place_nothing_tells_is_said_to_be(tmp_path):
    def change(topic, _, message):
        if topic == "/tf_static":
            message.transforms[0].transform.translation.x = np.nan
        return message

    log = read_log(recording(tmp_path / "a.mcap", change=change))
    assert log.lidar.mount == STANDING
    assert any("a translation is not finite" in warning for warning in log.warnings)
    assert any("nothing tells where the lidar (laser) stands" in warning for warning in log.warnings)


def test_of_the_frames_in_odom_the_one_that_is_told_most_is_the_robots(tmp_path):
    def change(topic, stamp, message):
        if topic == "/tf" and stamp == pytest.approx(1.4):
            message.transforms[0].child_frame_id = "target"
            message.transforms[0].transform.translation.x = 50.0
        return message

    log = read_log(recording(tmp_path / "a.mcap", with_odometry=False, change=change))
    assert log.odometry[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert log.lidar.mount == pytest.approx((0.2, 0.0, 0.1))


def test_a_log_of_a_mission_tells_where_the_lidar_stands(tmp_path):
    bundle = load_bundle(write(tmp_path / "bundle"))
    lidar = replace(bundle.lidar, mount=Pose2(0.15, 0.0, 0.0))
    write_log(bundle, tmp_path / "mission.mcap", ticks=60, lidar=lidar)
    log = read_log(tmp_path / "mission.mcap")
    assert log.lidar.mount == lidar.mount
    assert (log.skipped, log.warnings) == ({}, ())
    assert len(log.stamps) == 60
    assert slam([str(tmp_path / "mission.mcap"), "--save-map", str(tmp_path / "hall.yaml")]) == 0
    with Image.open(tmp_path / "hall.pgm") as image:
        assert np.array(image.size) * 0.05 == pytest.approx([8.0, 6.0], abs=0.3)
