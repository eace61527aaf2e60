"""The catalogue of faults: what can happen to the sensors, the clock and the programs, and what has to follow."""

from typing import Literal, NamedTuple

ZERO_WITHIN = 0.2
"""Time within which the zero command is out after a fault, or the base has timed out [s]."""
BASE_TIMEOUT = 0.2
"""Age of the last velocity command from which on a base has to stand [s]: all that helps when this program dies."""


class Fault(NamedTuple):
    """A fault that a test injects, and what has to happen."""

    what: str
    """What goes wrong, in one sentence."""
    target: Literal["scan", "odometry", "clock", "command", "process", "localisation"]
    """What it goes wrong with."""
    stopped_by: Literal["layer", "base", "nobody"]
    """Who makes the body stand within ``ZERO_WITHIN``: the safety layer, the base by its time-out, or nobody, because
    the body may drive on."""
    reasons: tuple[str, ...] = ()
    """Names of the reasons, of which the layer gives one or more."""
    resumes: bool = True
    """Whether the body moves on by itself after the fault has ended and a healthy time has passed."""


FAULTS: dict[str, Fault] = {
    "lidar_silent": Fault("No scan comes any more.", "scan", "layer", ("scan_silent",)),
    "odometry_silent": Fault("No odometry comes any more.", "odometry", "layer", ("odometry_silent",)),
    "lidar_repeated": Fault(
        "The last scan comes again and again, with its stamp.", "scan", "layer", ("scan_repeated",)
    ),
    "odometry_repeated": Fault(
        "The last odometry comes again and again, with its stamp.", "odometry", "layer", ("odometry_repeated",)
    ),
    "lidar_frozen": Fault("Scans have new stamps and the ranges of the last one.", "scan", "layer", ("scan_frozen",)),
    "odometry_frozen": Fault(
        "Odometry has new stamps and the pose and velocity of the last one.", "odometry", "layer", ("odometry_frozen",)
    ),
    "lidar_nan": Fault("All ranges are NaN.", "scan", "layer", ("scan_invalid",)),
    "odometry_nan": Fault("Pose and velocity are NaN.", "odometry", "layer", ("odometry_invalid",)),
    "odometry_jump": Fault("The pose jumps by 3 m, once.", "odometry", "layer", ("odometry_invalid",)),
    "lidar_resized": Fault("Scans have half the number of ranges.", "scan", "layer", ("scan_size",)),
    "lidar_time_back": Fault("Stamps of the scans jump back by 5 s.", "scan", "layer", ("scan_time", "scan_old")),
    "lidar_time_ahead": Fault("Stamps of the scans jump ahead by 5 s.", "scan", "layer", ("scan_time",)),
    "odometry_time_back": Fault(
        "Stamps of the odometry jump back by 5 s.", "odometry", "layer", ("odometry_time", "odometry_old")
    ),
    "odometry_time_ahead": Fault("Stamps of the odometry jump ahead by 5 s.", "odometry", "layer", ("odometry_time",)),
    "clock_back": Fault("The clock that stamps are of jumps back by 5 s, once.", "clock", "layer", ("clock_jump",)),
    "clock_ahead": Fault("The clock that stamps are of jumps ahead by 5 s, once.", "clock", "layer", ("clock_jump",)),
    "localisation_lost": Fault("The localisation reports no quality.", "localisation", "layer", ("lost",)),
    "second_publisher": Fault(
        "Another program publishes velocity commands as well.", "command", "layer", ("second_publisher",)
    ),
    "process_paused": Fault("The program is paused for a second (SIGSTOP, SIGCONT).", "process", "base", ("late",)),
    "process_killed": Fault("The program is killed (SIGKILL).", "process", "base", resumes=False),
    "lidar_malformed": Fault(
        "Messages that are malformed, too large or of another type come in place of scans.",
        "scan",
        "layer",
        ("scan_silent",),
    ),
    "lidar_beside": Fault(
        "Messages that are malformed, too large or of another type come beside good scans: they are refused.",
        "scan",
        "nobody",
    ),
}
"""All faults by name."""

REASONS = frozenset(
    {
        *(reason for fault in FAULTS.values() for reason in fault.reasons),
        "command_invalid",
    }
)
"""Names of all reasons that the layer gives."""
