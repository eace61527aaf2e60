"""Message types of ROS 2: dataclasses, CDR and type hashes, all from the definitions of one distribution.

``rosbags`` brings the definitions of Jazzy and the code that reads and writes CDR. What it lacks, actions and services,
is defined here.
"""

import functools
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from vuca_nav.deploy.transport.names import WRAPPED
from vuca_nav.errors import VucaError

SMALL = 64 << 10
"""Greatest size of an ordinary message [bytes]: diagnostics and transforms of a large robot have a few kilobytes."""
MOST_BYTES = 8 << 20
"""Greatest size of any message [bytes]: a map of 140 m by 140 m at 0.05 m."""
_SIZES = {
    "sensor_msgs/msg/LaserScan": 1 << 20,  # vuca_nav.types.MOST_BEAMS ranges and intensities of 4 bytes
    "nav_msgs/msg/OccupancyGrid": MOST_BYTES,
    "nav_msgs/msg/Path": 4 << 20,
    "visualization_msgs/msg/MarkerArray": 1 << 20,
    "diagnostic_msgs/msg/DiagnosticArray": 1 << 20,
}

_MESSAGES = {
    # nav2_msgs of Jazzy; later distributions add fields, and their clients do not find the action by its type hash.
    "nav2_msgs/action/NavigateToPose_Goal": "geometry_msgs/PoseStamped pose\nstring behavior_tree",
    "nav2_msgs/action/NavigateToPose_Result": "uint16 error_code",
    "nav2_msgs/action/NavigateToPose_Feedback": (
        "geometry_msgs/PoseStamped current_pose\n"
        "builtin_interfaces/Duration navigation_time\n"
        "builtin_interfaces/Duration estimated_time_remaining\n"
        "int16 number_of_recoveries\n"
        "float32 distance_remaining"
    ),
    "action_msgs/srv/CancelGoal_Request": "action_msgs/GoalInfo goal_info",
    # The project's own, in a mission's log (vuca_nav.deploy.log).
    "vuca_msgs/msg/Mission": (
        "bool is_reset\nfloat64[3] start\nbool has_goal\nfloat64[2] goal\nstring lidar\nbuiltin_interfaces/Time stamp"
    ),
    "vuca_msgs/msg/Tick": (
        "builtin_interfaces/Time stamp\nuint32 scan\nfloat64 scan_stamp\nfloat64[10] odometry\nfloat64[3] command"
    ),
    "action_msgs/srv/CancelGoal_Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
}
_UNITREE = {
    "unitree_api/msg/RequestIdentity": "int64 id\nint64 api_id",
    "unitree_api/msg/RequestLease": "int64 id",
    "unitree_api/msg/RequestPolicy": "int32 priority\nbool noreply",
    "unitree_api/msg/RequestHeader": "RequestIdentity identity\nRequestLease lease\nRequestPolicy policy",
    "unitree_api/msg/Request": "RequestHeader header\nstring parameter\nuint8[] binary",
    "unitree_go/msg/TimeSpec": "int32 sec\nuint32 nanosec",
    "unitree_go/msg/IMUState": (
        "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint8 temperature"
    ),
    "unitree_go/msg/SportModeState": (
        "TimeSpec stamp\nuint32 error_code\nIMUState imu_state\nuint8 mode\nfloat32 progress\nuint8 gait_type\n"
        "float32 foot_raise_height\nfloat32[3] position\nfloat32 body_height\nfloat32[3] velocity\nfloat32 yaw_speed\n"
        "float32[4] range_obstacle\nint16[4] foot_force\nfloat32[12] foot_position_body\nfloat32[12] foot_speed_body"
    ),
}
"""Types of a Go2's own services, after Unitree's published interface; the quaternion is w, x, y, z."""
_ACTIONS = ("nav2_msgs/action/NavigateToPose",)
_SERVICES = ("action_msgs/srv/CancelGoal",)


class BadMessage(VucaError):
    """A message that cannot be decoded, or is larger than its type may be."""


class FieldType(NamedTuple):
    """Type of a field."""

    base: str
    """A primitive ("float32", "string") or the name of a message type."""
    is_message: bool
    length: int | None
    """None for a single value, otherwise the length of an array, or the bound of a sequence (0: unbounded)."""
    is_array: bool
    """Whether the length is fixed."""


def message_type(type_name: str) -> type:
    """The dataclass of a message type, "geometry_msgs/msg/Twist" for example."""
    return _store().types[type_name]


def new(type_name: str, **fields: Any) -> Any:
    """A message of the type; numbers that are not given are 0, texts and sequences empty."""
    values = {name: fields.pop(name) if name in fields else _default(kind) for name, kind in fields_of(type_name)}
    if fields:
        raise TypeError(f"{type_name} has no field {', '.join(fields)}")
    return message_type(type_name)(**values)


def encode(message: Any, type_name: str) -> bytes:
    """The message as CDR with its header, padded to whole words, as DDS wants it."""
    data = bytes(_store().serialize_cdr(message, type_name, little_endian=True))
    return data + bytes(-len(data) % 4)


def decode(data: bytes, type_name: str) -> Any:
    """The message in CDR bytes. Lengths inside it are checked against its size before anything is allocated.

    Raises:
        BadMessage: If the bytes are not a message of the type, or more than its type may have.
    """
    if len(data) > _SIZES.get(type_name, SMALL):
        raise BadMessage("larger than a message of its type may be")
    try:
        return _store().deserialize_cdr(data, type_name)
    except SerdeError as error:
        raise BadMessage("not a message of its type") from error


@functools.cache
def type_hash(type_name: str) -> str:
    """The RIHS01 hash of a message or service type (REP-2011, REP-2016)."""
    return _store().hash_rihs01(type_name)


def fields_of(type_name: str) -> list[tuple[str, FieldType]]:
    """Names and types of a message type's fields, in order."""
    return [(name, _field_type(kind)) for name, kind in _store().fielddefs[type_name][1]]


def definition_of(type_name: str) -> str:
    """The definition as text with those of all types it uses, as a rosbag2 log holds it."""
    return _store().generate_msgdef(type_name, ros_version=2)[0]


def known(type_name: str) -> bool:
    """Whether a message type is known."""
    return type_name in _store().types


def _field_type(kind: Any) -> FieldType:
    node, argument = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        (inner, base), length = argument
        is_message = inner == Nodetype.NAME
        return FieldType(base if is_message else base[0], is_message, length, node == Nodetype.ARRAY)
    is_message = node == Nodetype.NAME
    return FieldType(argument if is_message else argument[0], is_message, None, False)


def _default(kind: FieldType) -> Any:
    import numpy as np

    if kind.length is not None:
        number = kind.length if kind.is_array else 0
        if kind.is_message:
            return [new(kind.base) for _ in range(number)]
        if kind.base == "string":
            return [""] * number
        return np.zeros(number, {"char": "uint8", "byte": "uint8"}.get(kind.base, kind.base))
    if kind.is_message:
        return new(kind.base)
    return "" if kind.base == "string" else (False if kind.base == "bool" else 0)


@functools.cache
def _store() -> Any:
    """The definitions of Jazzy and those of this module."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, (constants, fields) in store.fielddefs.items():
        # ROS translates char of a .msg file into IDL's uint8; rosbags hashes it as char.
        store.fielddefs[name] = constants, [(field, _without_char(kind)) for field, kind in fields]
    definitions = _MESSAGES | _UNITREE
    services = list(_SERVICES)
    for action in _ACTIONS:
        goal_id = "unique_identifier_msgs/UUID goal_id"
        definitions |= {
            f"{action}_SendGoal_Request": f"{goal_id}\n{_in_text(action)}_Goal goal",
            f"{action}_SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp",
            f"{action}_GetResult_Request": goal_id,
            f"{action}_GetResult_Response": f"int8 status\n{_in_text(action)}_Result result",
            f"{action}_FeedbackMessage": f"{goal_id}\n{_in_text(action)}_Feedback feedback",
        }
        services += [f"{action}_SendGoal", f"{action}_GetResult"]
    for name, text in definitions.items():
        (parsed,) = get_types_from_msg(text, name.replace("/action/", "/msg/").replace("/srv/", "/msg/")).values()
        store.register({name: (parsed[0], [(field, _with_folder(kind, definitions)) for field, kind in parsed[1]])})
    for service in services:
        _register_service(store, service)
    return store


def _without_char(kind: Any) -> Any:
    node, argument = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return node, (_without_char(argument[0]), argument[1])
    return (node, ("uint8", 0)) if argument == ("char", 0) else kind


def _in_text(name: str) -> str:
    """The name of a type as a field of a definition gives it, "package/Name"."""
    package, _, own = name.split("/")
    return f"{package}/{own}"


def _with_folder(kind: Any, definitions: dict[str, str]) -> Any:
    """The field's type with "action" or "srv" in its name where it is one of ours: text says "msg" for all."""
    node, argument = kind
    if node == Nodetype.NAME:
        for folder in ("action", "srv"):
            if argument.replace("/msg/", f"/{folder}/") in definitions:
                return node, argument.replace("/msg/", f"/{folder}/")
    return kind


def _register_service(store: Any, name: str) -> None:
    """Add the type of a service itself, whose hash its endpoints announce, and those of its requests on DDS.

    Cyclone DDS's ROS layer puts the client's number and the request's before the message: a wrapper that is not a type
    of ROS.
    """

    def sequence_of(what: str) -> Any:
        return Nodetype.SEQUENCE, ((Nodetype.NAME, what), 1)

    event, info = f"{name}_Event", (Nodetype.NAME, "service_msgs/msg/ServiceEventInfo")
    store.register(
        {
            event: (
                [],
                [
                    ("info", info),
                    ("request", sequence_of(f"{name}_Request")),
                    ("response", sequence_of(f"{name}_Response")),
                ],
            ),
            name: (
                [],
                [
                    ("request_message", (Nodetype.NAME, f"{name}_Request")),
                    ("response_message", (Nodetype.NAME, f"{name}_Response")),
                    ("event_message", (Nodetype.NAME, event)),
                ],
            ),
        }
    )
    for part in ("Request", "Response"):
        fields = [
            ("guid", (Nodetype.BASE, ("uint64", 0))),
            ("seq", (Nodetype.BASE, ("int64", 0))),
            ("message", (Nodetype.NAME, f"{name}_{part}")),
        ]
        store.register({f"{name}_{part}{WRAPPED}": ([], fields)})
