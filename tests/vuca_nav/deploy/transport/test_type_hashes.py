"""Type hashes are those that ROS 2's own packages carry, as others have read them from installed distributions.

Sources, none of which shares code with rosbags: ``components/payloads/cu_ros2_payloads/all_rihs.md`` of
github.com/copper-project/copper-rs (extracted from the JSON files of Jazzy's packages); the test of hashes of CARLA's
ROS 2 interface (``CHECK_GOLDEN_HASH``, from the packages of the image osrf/ros:jazzy-desktop);
``ros_discovery_info.rs`` of github.com/eclipse-zenoh/zenoh-plugin-ros2dds for ParticipantEntitiesInfo.
"""

import pytest

from vuca_nav.deploy.transport import ros_types
from vuca_nav.deploy.transport.ros_types import type_hash

PUBLISHED = {
    "action_msgs/msg/GoalStatusArray": "6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e",
    "action_msgs/srv/CancelGoal": "573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "geometry_msgs/msg/PoseStamped": "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    "geometry_msgs/msg/TransformStamped": "0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
    "geometry_msgs/msg/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/msg/TwistStamped": "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    "nav_msgs/msg/OccupancyGrid": "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "nav_msgs/msg/Path": "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
    "rmw_dds_common/msg/ParticipantEntitiesInfo": "91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e",
    "rosgraph_msgs/msg/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "sensor_msgs/msg/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/LaserScan": "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828",
    "service_msgs/msg/ServiceEventInfo": "41bcbbe07a75c9b52bc96bfd5c24d7f0fc0a08c0cb7921b3373c5732345a6f45",
    "std_msgs/msg/Bool": "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    "std_msgs/msg/Header": "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "visualization_msgs/msg/MarkerArray": "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
}
"""All types of the topics of ``vuca deploy`` and ``vuca bridge``, and of the services but those of nav2_msgs."""


@pytest.mark.parametrize(("name", "digest"), PUBLISHED.items(), ids=PUBLISHED)
def test_the_hash_is_the_published_one(name: str, digest: str) -> None:
    assert type_hash(name) == f"RIHS01_{digest}"


def test_hashes_of_an_action_are_the_published_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody publishes those of nav2_msgs; another action's are made the same way."""
    action = "action_tutorials_interfaces/action/Fibonacci"
    fields = {"Goal": "int32 order", "Result": "int32[] sequence", "Feedback": "int32[] partial_sequence"}
    own = {f"{action}_{part}": text for part, text in fields.items()}
    monkeypatch.setattr(ros_types, "_MESSAGES", ros_types._MESSAGES | own)
    monkeypatch.setattr(ros_types, "_ACTIONS", (*ros_types._ACTIONS, action))
    store = ros_types._store.__wrapped__()
    assert {part: store.hash_rihs01(f"{action}_{part}") for part in ("SendGoal", "GetResult", "FeedbackMessage")} == {
        "SendGoal": "RIHS01_a0603060ed69fe2dfbd1a6f3b982a1749957ef346e4a4d2b311a05e305ec37bb",
        "GetResult": "RIHS01_8b47e383f1e31f6d8df6417ab54957e7d5ea24dad315646ad711ac3fdea81d58",
        "FeedbackMessage": "RIHS01_50fc26b9cac313652ecbeab3adf9b5414d59fd4d4d5f9058ddcc7525169927f1",
    }
