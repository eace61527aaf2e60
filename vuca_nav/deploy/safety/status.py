"""What goes into a tick of the safety layer and comes out of it."""

import math
from enum import IntEnum
from typing import Literal, NamedTuple

from vuca_nav.types import Odometry, Scan, VelocityCommand


class Level(IntEnum):
    """Level of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Reason(NamedTuple):
    """Something that is wrong."""

    name: str
    """Kind of the fault, one of ``faults.REASONS``, as in "scan_silent"."""
    text: str
    """What it is, in one line with figures."""


class Tick(NamedTuple):
    """What the layer knows at a tick. Two clocks: a steady one, and the one that stamps are of.

    They may be the same, as they are in the simulator.
    """

    now: float
    """The steady clock [s]."""
    clock: float
    """The clock that stamps are of [s]."""
    scan: Scan | None = None
    """The latest scan as it was received; None before the first."""
    scan_received: float = -math.inf
    """When it was received, by the steady clock [s]."""
    odometry: Odometry | None = None
    """The latest odometry; None before the first."""
    odometry_received: float = -math.inf
    """When it was received, by the steady clock [s]."""
    has_goal: bool = False
    """Whether there is a goal; nothing moves without one."""
    localisation: float | None = None
    """Quality of the localisation, 0 lost to 1; None where nothing measures it."""
    publishers: int = 1
    """Number of publishers of the velocity command, with our own."""


Action = Literal[
    "passed", "limited", "slowed", "approach", "stopped", "standing", "overdue", "waiting", "fault", "emergency"
]
"""What became of a proposed command:

- passed: it went through as it was;
- limited: beyond the body's limits of velocity or acceleration;
- slowed: something is near, or the lidar does not look there;
- approach: scaled to the speed from which the body can stop;
- stopped: any motion as proposed comes too near to something;
- standing: no goal, or no command was proposed;
- overdue: scan or odometry should have come; the body stands until it does, or it is a fault;
- waiting: not healthy for long enough;
- fault: a watchdog stops the body;
- emergency: the emergency stop is latched.
"""


class SafetyState(NamedTuple):
    """State of the layer after a tick, as ``/diagnostics`` shows it."""

    level: Level
    action: Action
    message: str
    """One line."""
    reasons: tuple[Reason, ...] = ()
    """Present faults; empty if there are none."""


class Allowed(NamedTuple):
    """Result of a tick."""

    command: VelocityCommand
    """The command that may go to the body."""
    state: SafetyState
