import io
import math

import numpy as np
import pytest

from vuca_nav.slam_log.reading import read_log
from vuca_nav.slam_log.robot_log import BadLog

mcap_writer = pytest.importorskip("mcap.writer")
typesys = pytest.importorskip("rosbags.typesys")


def recording(path, *, with_odometry=True, scans=5, beams=90, cut=0):
    """A robot that drives 0.1 m between scans, with a lidar 0.2 m ahead of its middle."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    types = store.types
    time, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    point = types["geometry_msgs/msg/Point"]
    buffer = io.BytesIO()
    writer = mcap_writer.Writer(buffer)
    writer.start("ros2", "test")
    channels = {}

    def write(topic, kind, message, stamp):
        if topic not in channels:
            schema = writer.register_schema(kind, "ros2msg", b"")
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        data = bytes(store.serialize_cdr(message, kind))
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


def test_the_directory_of_a_rosbag_is_a_recording(tmp_path):
    recording(tmp_path / "bag_0.mcap")
    assert len(read_log(tmp_path).stamps) == 5


def test_what_is_no_recording_is_refused(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"ROBOTLASER1 0 0 0\n" * 100)
    with pytest.raises(BadLog, match="MCAP"):
        read_log(other)
    with pytest.raises(BadLog, match="damaged"):
        read_log(recording(tmp_path / "cut.mcap", cut=2000))
    with pytest.raises(BadLog, match="LaserScan"):
        read_log(recording(tmp_path / "none.mcap", scans=0))
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadLog, match=r"no \.mcap"):
        read_log(tmp_path / "empty")
