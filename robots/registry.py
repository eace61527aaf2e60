"""Bodies by name."""

from collections.abc import Callable

from robots.body import Body
from robots.tiago import Tiago
from vuca_nav.errors import UnknownName

ROBOTS: dict[str, Callable[[], Body]] = {"tiago": Tiago}


def make_body(name: str) -> Body:
    """The body of that name.

    Raises:
        UnknownName: If there is none; lists those there are.
    """
    if name not in ROBOTS:
        raise UnknownName("robot", name, ROBOTS)
    return ROBOTS[name]()
