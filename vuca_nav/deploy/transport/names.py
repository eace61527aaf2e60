"""Names and arguments of ROS: full names, remapping, a parameter, as ROS users write them; types as DDS names them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from vuca_nav.errors import BadArgument

WRAPPED = "_Wrapped"
"""Ending of the name of a request's or response's wrapper."""
_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def _check(name: str, what: str, right: str) -> None:
    if not all(_TOKEN.fullmatch(part) for part in name.split("/")):
        raise BadArgument(f"--ros-args: {what} must be {right}, got {name!r}")


@dataclass(frozen=True, slots=True)
class RosArguments:
    """What stands behind ``--ros-args``."""

    node: str = "vuca_deploy"
    """The node's name."""
    namespace: str = "/"
    remappings: tuple[tuple[str, str], ...] = ()
    """Pairs of names: what the node calls a topic, and what it is on the network."""
    use_sim_time: bool = False
    """Whether time is that of the topic ``clock``."""

    def __post_init__(self) -> None:
        """Check the names.

        Raises:
            BadArgument: If one is no name of ROS.
        """
        _check(self.node, "the node's name", "letters, digits and underscores")
        for pair in self.remappings:
            for name in pair:
                _check(name.removeprefix("~/").removeprefix("/"), f"the name {name!r} of a remapping", "a/b or /a/b")
        if self.namespace != "/":
            _check(self.namespace.removeprefix("/"), "the namespace", "/robot1 or /fleet/robot1")

    def full_name(self, name: str) -> str:
        """The full name of a topic or service that the node calls ``name``."""
        own = self._expand(name)
        for before, after in self.remappings:
            if self._expand(before) == own:
                return self._expand(after)
        return own

    def _expand(self, name: str) -> str:
        """The name with namespace, and with the node's name for a leading ``~``."""
        if name.startswith("/"):
            return name
        base = self.namespace if self.namespace.startswith("/") else "/" + self.namespace
        base = base.rstrip("/")
        return f"{base}/{self.node}/{name[2:]}" if name.startswith("~/") else f"{base}/{name}"


UNCHANGED = RosArguments()
"""No namespace, nothing remapped."""


def parse_ros_arguments(words: Sequence[str], node: str) -> RosArguments:
    """The words behind ``--ros-args``: ``-r from:=to``, ``-r __ns:=/robot1``, ``-p use_sim_time:=true``.

    Args:
        words: Words, without ``--ros-args`` itself.
        node: The node's name unless it is remapped by ``__node:=``.

    Raises:
        BadArgument: If a word is not understood.
    """
    settings: dict[str, str] = {"node": node, "namespace": "/"}
    remappings: list[tuple[str, str]] = []
    use_sim_time = False
    waiting = list(words)
    while waiting:
        flag = waiting.pop(0)
        if flag not in ("-r", "--remap", "-p", "--param"):
            raise BadArgument(f"--ros-args: {flag!r} is not understood; known are -r FROM:=TO and -p NAME:=VALUE")
        rule = waiting.pop(0) if waiting else ""
        left, separator, right = rule.partition(":=")
        if not separator or not left or not right:
            raise BadArgument(
                f"--ros-args {flag}: {rule!r} must be of the form left:=right, as in -r scan:=/front/scan"
            )
        before, colon, name = left.rpartition(":")
        if colon and before != settings["node"]:
            continue  # of another node
        if flag in ("-p", "--param"):
            if name != "use_sim_time" or right.lower() not in ("true", "false"):
                raise BadArgument(f"--ros-args {flag}: the only parameter is use_sim_time:=true or false, got {rule!r}")
            use_sim_time = right.lower() == "true"
        elif name in ("__ns", "__node", "__name"):
            settings["namespace" if name == "__ns" else "node"] = right
        else:
            remappings.append((name, right))
    return RosArguments(**settings, remappings=tuple(remappings), use_sim_time=use_sim_time)


def split_ros_arguments(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words of a command line that are not ROS's, and those that are: from ``--ros-args`` to ``--`` or the end."""
    own: list[str] = []
    ros: list[str] = []
    target = own
    for word in argv:
        if word == "--ros-args":
            target = ros
        elif word == "--" and target is ros:
            target = own
        else:
            target.append(word)
    return own, ros


def dds_type(type_name: str) -> str:
    """Name on DDS of a ROS type."""
    package, folder, name = type_name.removesuffix(WRAPPED).split("/")
    return f"{package}::{folder}::dds_::{name}_"


def ros_type(dds_name: str) -> str:
    """ROS name of a type on DDS; the name itself where it is not ROS's."""
    parts = dds_name.split("::")
    if len(parts) == 4 and parts[2] == "dds_" and parts[3].endswith("_"):
        return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"
    return dds_name
