"""Motion by a class of the user's own, ``module:Class`` in a scene file, loaded only under ``--trust``.

The class is built once for each mover and asked at each tick::

    class Pacing(worlds.motion.user_motion.UserMover):
        def place(self, now):
            v_x = 1.0 if now.time % 4.0 < 2.0 else -1.0
            return Place(now.x, now.y, v_x, 0.0)
"""

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.types import FloatArray
from vuca_nav.user_code import Wanted, load_user_code, told
from worlds.motion.interface import FAR, MotionDriver, Movers
from worlds.motion.mover_columns import RADIUS, SPEED, USER_MOTION, V_X, V_Y, YAW, X, Y
from worlds.world import Mover, UserMotion


class Now(NamedTuple):
    """What a mover knows at a tick."""

    time: float
    """Time since the start [s]."""
    x: float
    """Where it is; where it starts, if it is not there [m]."""
    y: float
    """[m]"""
    yaw: float
    """Heading [rad]."""
    others: FloatArray
    """x, y, v_x, v_y, radius of the others that are there, (n, 5) [m, m/s]."""
    robot: tuple[float, float, float] | None
    """x, y, radius of the robot [m]; None if there is none, or the mover is not sighted."""


class Place(NamedTuple):
    """Place of a mover, and its velocity until the next tick."""

    x: float
    """[m]"""
    y: float
    """[m]"""
    v_x: float
    """[m/s]"""
    v_y: float
    """[m/s]"""


class UserMover(ABC):
    """Motion of one mover. A copy of it (``copy.deepcopy``) must go on like the original.

    Args:
        mover: The mover.
        seed: Seed of the episode.
        options: ``options`` of the scene file.
    """

    def __init__(self, mover: Mover, seed: int, **options: Any):
        self.mover, self.seed, self.options = mover, seed, options

    @abstractmethod
    def place(self, now: Now) -> Place | None:
        """Its place now and its velocity until the next tick, 1/30 s; None while it is not there."""


class UserDriver(MotionDriver):
    """Movers by classes of the user's own.

    Raises:
        BadArgument: A class cannot be loaded or built.
    """

    def __init__(self, movers: Movers):
        self._rows = movers.rows(USER_MOTION)
        self._movers: list[UserMover] = []

    def reset(self, movers: Movers) -> None:
        """Implements :class:`MotionDriver`; the classes are built anew."""
        self._movers = [_build(movers.world.movers[i]) for i in self._rows]
        movers.present[self._rows] = True

    def decide(self, time: float, movers: Movers, robot: FloatArray) -> None:
        """Implements :class:`MotionDriver`."""
        state, before = movers.state, movers.state.copy()
        there = movers.present.copy()
        for i, own in zip(self._rows, self._movers, strict=True):
            mover = own.mover
            x, y, yaw = before[i, : YAW + 1].tolist() if there[i] else mover.start
            others = there.copy()
            others[i] = False
            seen = np.column_stack([before[others][:, [X, Y, V_X, V_Y]], movers.constants[others, RADIUS]])
            near = tuple(robot.tolist()) if robot[2] >= 0.0 and movers.sees[i] else None
            place = _asked(own, Now(time, x, y, yaw, seen, near))
            if place is None:
                state[i, X] = state[i, Y] = FAR
                state[i, V_X] = state[i, V_Y] = 0.0
            else:
                speed, most = math.hypot(place[2], place[3]), movers.constants[i, SPEED]
                cut = most / speed if speed > most else 1.0
                state[i, X], state[i, Y], state[i, V_X], state[i, V_Y] = *place[:2], cut * place[2], cut * place[3]
            movers.present[i] = place is not None


def _build(mover: Mover) -> UserMover:
    motion = mover.motion
    assert isinstance(motion, UserMotion)
    source = f"motion {motion.name}"
    wanted = Wanted(source, "a motion of your own", "my_motion:Pacing", "a class derived from UserMover")
    kind = load_user_code(motion.name, wanted).thing
    if not (isinstance(kind, type) and issubclass(kind, UserMover)):
        raise BadArgument(f"{source}: it is no class derived from worlds.motion.user_motion.UserMover, as is right")
    try:
        return kind(mover, motion.seed, **dict(motion.options))
    except Exception as error:  # whatever the user's code raises is the user's to mend
        raise BadArgument(f"{source}: {told(error)}") from error


def _asked(own: UserMover, now: Now) -> Place | None:
    """The mover's place, checked."""
    source = f"motion {getattr(own.mover.motion, 'name', '')} at {now.time:.2f} s"
    try:
        place = own.place(now)
        numbers = None if place is None else Place(*(float(number) for number in place))
    except Exception as error:  # as above
        raise BadArgument(f"{source}: {told(error)}") from error
    if numbers is not None and not all(math.isfinite(number) and abs(number) < FAR for number in numbers):
        raise BadArgument(f"{source}: {place} is no place; four finite numbers, or None, would be right")
    return numbers
