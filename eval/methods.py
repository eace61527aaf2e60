"""The methods that can be put in an episode, by name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from vuca_nav.errors import UnknownName
from vuca_nav.mapping.slam import SlamConfig
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.dwa import DynamicWindow
from vuca_nav.telemetry import Telemetry
from vuca_nav.types import BodySpec, LidarSpec


@dataclass(frozen=True, slots=True)
class StackRequest:
    """What a method is built for."""

    body: BodySpec
    lidar: LidarSpec
    localisation: Literal["slam", "odometry"]
    """"odometry" where the odometry is the true pose (``--without A``)."""
    telemetry: Telemetry


@dataclass(frozen=True, slots=True)
class Method:
    """A way to build a navigator."""

    description: str
    build: Callable[[StackRequest], Navigator]


def _dwa_dh(request: StackRequest) -> Navigator:
    return Navigator(
        request.body,
        request.lidar,
        DynamicWindow(request.body, request.lidar),
        NavigatorConfig(slam=SlamConfig(localisation=request.localisation)),
        request.telemetry,
    )


METHODS: dict[str, Method] = {
    "dwa-dh": Method("SLAM, frontier exploration by D^h and waypoints, over a dynamic window controller", _dwa_dh),
}
BEST = "dwa-dh"
"""What runs when no method is named."""


def find_method(name: str) -> Method:
    """The method of that name.

    Raises:
        UnknownName: There is none.
    """
    if name not in METHODS:
        raise UnknownName("method", name, METHODS)
    return METHODS[name]
