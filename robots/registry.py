"""The registry of bodies: robots by their names."""

from collections.abc import Callable

from robots.bodies.a1 import A1
from robots.bodies.body import Body
from robots.bodies.go2 import GO2, Go2
from robots.bodies.tiago import Tiago
from robots.locomotion.config import QuadrupedConfig
from vuca_nav.errors import UnknownName

ROBOTS: dict[str, Callable[[], Body]] = {"go2": Go2, "tiago": Tiago}

QUADRUPEDS: dict[str, QuadrupedConfig] = {config.spec.name: config for config in (A1, GO2)}
"""Quadrupeds by name; ``vuca train locomotion`` makes their gaits."""


def find_quadruped(name: str) -> QuadrupedConfig:
    """Find the constants of the quadruped of that name.

    Raises:
        UnknownName: If there is none; lists those there are.
    """
    if name not in QUADRUPEDS:
        raise UnknownName("quadruped", name, QUADRUPEDS)
    return QUADRUPEDS[name]


def make_body(name: str) -> Body:
    """Make the body of that name.

    Raises:
        UnknownName: If there is none; lists those there are.
    """
    if name not in ROBOTS:
        raise UnknownName("robot", name, ROBOTS)
    return ROBOTS[name]()
