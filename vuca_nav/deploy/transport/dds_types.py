"""ROS names and types on DDS: mangled names, and the types that Cyclone DDS checks arriving messages by.

Messages cross as the CDR bytes that ``ros_types`` makes, which costs a third of letting Cyclone DDS's Python convert
them. Cyclone DDS gets a type only to announce it, and to refuse what does not have its structure.
"""

import functools
from typing import Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl

from vuca_nav.deploy.transport.names import WRAPPED, dds_type
from vuca_nav.deploy.transport.ros_types import FieldType, fields_of

_PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "byte": idl.byte,
    "char": idl.uint8,
    "string": str,
    "float32": idl.float32,
    "float64": idl.float64,
    **{f"{sign}int{bits}": getattr(idl, f"{sign}int{bits}") for sign in ("", "u") for bits in (8, 16, 32, 64)},
}


def dds_topic(full_name: str, prefix: str = "rt", suffix: str = "") -> str:
    """Name on DDS of a ROS topic ("rt"), of a service's requests ("rq") or replies ("rr")."""
    return f"{prefix}{full_name}{suffix}"


def ros_topic(dds_name: str) -> str:
    """ROS name of a topic on DDS; the name itself where it is not ROS's."""
    return dds_name[2:] if dds_name.startswith("rt/") else dds_name


@functools.cache
def idl_struct(type_name: str) -> Any:
    """The structure of a ROS type as Cyclone DDS knows it."""
    fields = fields_of(type_name)
    if type_name.endswith(WRAPPED):  # flat: the wrapper and what it wraps have one name
        fields = fields[:-1] + fields_of(fields[-1][1].base)
    return make_idl_struct(
        type_name.replace("/", "_"), dds_type(type_name), {field: _idl_type(kind) for field, kind in fields}
    )


def _idl_type(kind: FieldType) -> Any:
    single = idl_struct(kind.base) if kind.is_message else _PRIMITIVES[kind.base]
    if kind.length is None:
        return single
    if kind.is_array:
        return idl.array[single, kind.length]
    return idl.sequence[single, kind.length] if kind.length else idl.sequence[single]
