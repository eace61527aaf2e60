"""Why an episode failed: it is run again to the bit, and branched from before its contact.

Runs repeat to the bit, and blind movers do not react: so the movements of all movers are known, and from every half
second before a contact it can be asked whether any commands would have avoided it. Where movers see the robot they
would have moved otherwise; then what the search proposes is only a proposal, which the simulation confirms or not.
"""

from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from eval.analysis.survival import TICK_RATE, body_model, commands_of, scene_about, start_of, survive
from eval.episode import Episode, EpisodeConfig, EpisodeResult, Progress
from eval.methods import MethodOptions
from eval.store import Row
from robots.simulation import Simulation
from vuca_nav.errors import VucaError
from vuca_nav.stack import Stack
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, FloatArray, Odometry, Pose2, Scan, VelocityCommand
from worlds.arrays import pack_shapes

BRANCH_PERIOD = 0.5
"""Time between two moments from which ways are searched [s]."""
EARLIEST = 10.0
"""Time before the contact beyond which no ways are searched [s]."""
SURVIVED = 3.0
"""Time without a contact after the moment of the contact that counts as survival [s]."""
MARGINS = (0.03, 0.10)
"""Distances that a way is to keep [m]; the greater one if the body did not follow the model closely enough."""
MEMORY = 90
"""Number of commands before a branch from which the body's velocity follows."""


class NotRepeated(VucaError):
    """The episode did not come out again as it did before."""


class Trace(NamedTuple):
    """The true course of an episode."""

    commands: FloatArray
    """Commands of every tick (n, 3)."""
    poses: FloatArray
    """x, y, yaw of the robot at the start and after every tick (n + 1 or more, 3) [m, rad]."""
    part_poses: FloatArray
    """x, y, yaw of the movers' parts at the same moments (n + 1 or more, p, 3) [m, rad]."""


@dataclass(frozen=True, slots=True)
class Avoidable:
    """The last moment at which a contact could be avoided."""

    seconds: float | None
    """How long before the contact it was [s]; None if no way was found in ``EARLIEST``."""
    way: FloatArray
    """x, y, yaw of the robot on the way that survives, from that moment on (ticks, 3) [m, rad]."""
    is_certain: bool
    """Whether all ways from later moments were tried, up to the search's voxels and commands."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """An episode that was run again."""

    episode: Episode
    result: EpisodeResult
    trace: Trace
    avoidable: Avoidable | None
    """None without a contact."""

    def row(self) -> Row:
        """The episode's row, with ``t_inevitable``: seconds before the contact, None if there is no such moment."""
        found = self.avoidable
        return self.result.row() | {
            "t_inevitable": None if found is None else found.seconds,
            "t_inevitable_is_certain": None if found is None else found.is_certain,
        }


def config_of(row: Row, *, trust: bool = False) -> EpisodeConfig:
    """The configuration of the episode that a row is of.

    Args:
        row: The row.
        trust: Whether motions of the user's own, in its scene file, may be run: no row may say so.
    """
    options = {field.name: row[field.name] for field in fields(MethodOptions) if field.name in row}
    own = {
        field.name: row[field.name]
        for field in fields(EpisodeConfig)
        if field.name in row and field.name not in ("options", "trust")
    }
    given: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in own.items()}
    return EpisodeConfig(**given, options=MethodOptions(**options), trust=trust)


class TracedEpisode(Episode):
    """An episode that remembers the commands given."""

    def __init__(self, config: EpisodeConfig):
        super().__init__(config)
        self.commands: list[VelocityCommand] = []

    def build(self, telemetry: Telemetry) -> tuple[Simulation, Stack]:
        """As of an episode, but the navigator's commands are kept."""
        simulation, navigator = super().build(telemetry)
        decide = navigator.step

        def step(scan: Scan, odometry: Odometry) -> VelocityCommand:
            self.commands.append(decide(scan, odometry))
            return self.commands[-1]

        navigator.step = step
        self.commands.clear()
        return simulation, navigator


class _Tracer(Telemetry):
    """Keeps the true poses of the robot and of the movers' parts."""

    def __init__(self) -> None:
        self.poses: list[Pose2] = []
        self.part_poses: list[FloatArray] = []

    def true_pose(self, world_from_base: Pose2) -> None:
        self.poses.append(world_from_base)

    def movers(self, poses: FloatArray) -> None:
        self.part_poses.append(poses.copy())


def trace(episode: Episode, commands: list[VelocityCommand], after: float = 0.0) -> tuple[Trace, Simulation]:
    """Give commands again, without the stack that found them, and then let the movers go on.

    Args:
        episode: The episode.
        commands: Commands of every tick.
        after: Time for which the robot stands and the movers go on afterwards [s].
    """
    tracer = _Tracer()
    simulation = episode.simulation(tracer)
    simulation.reset()
    for command in commands:
        simulation.step(command)
    for _ in range(round(after * TICK_RATE)):
        simulation.step(STOP)
    given = np.array(commands, float).reshape(-1, 3)
    return Trace(given, np.array(tracer.poses), np.array(tracer.part_poses)), simulation


def last_avoidable_moment(episode: Episode, course: Trace, progress: Progress | None = None) -> Avoidable:
    """Search backwards from the contact that ended an episode for the last moment at which it could be avoided.

    Args:
        episode: The episode.
        course: Its course, and that of the movers for ``SURVIVED`` longer; the contact is in the last command's tick.
        progress: Called with the time before the contact [s] and ``EARLIEST``, before each search.

    Raises:
        NotRepeated: The episode did not come out as in ``course``.
    """
    body, contact = episode.body, len(course.commands)
    model, choices = body_model(body.spec), commands_of(body.spec)
    movers = [part.shape for mover in episode.world.movers for part in mover.parts]
    shapes = pack_shapes([obstacle.shape for obstacle in episode.world.obstacles]), pack_shapes(movers)
    certain = True
    for k in range(1, round(EARLIEST / BRANCH_PERIOD) + 1):
        branch = contact - round(k * BRANCH_PERIOD * TICK_RATE)
        if branch < 0:
            break
        if progress is not None:
            progress(k * BRANCH_PERIOD, EARLIEST)
        pose = Pose2(*course.poses[branch].tolist())
        start = start_of(model, pose, course.commands[max(branch - MEMORY, 0) : branch])
        futures = course.part_poses[branch + 1 : contact + 1 + round(SURVIVED * TICK_RATE)]
        for margin in MARGINS:
            found = survive(start, scene_about(pose, body.spec, body.height, shapes, futures, margin), model, choices)
            if not found.commands:
                certain = certain and found.is_exhausted
                break
            way = _drive(episode, course, branch, found.commands)
            if way is not None:
                return Avoidable(k * BRANCH_PERIOD, way, certain)
            certain = False
    return Avoidable(None, np.zeros((0, 3)), certain)


def _drive(episode: Episode, course: Trace, branch: int, commands: tuple[VelocityCommand, ...]) -> FloatArray | None:
    """Drive other commands from a branch on in the simulation; the poses, None if they end in a contact or a fall."""
    before = [VelocityCommand(*row) for row in course.commands[:branch].tolist()]
    driven, simulation = trace(episode, [*before, *commands])
    if not np.array_equal(driven.poses[: branch + 1], course.poses[: branch + 1]):
        raise NotRepeated("the episode did not come out as before; nothing can be said of what might have been")
    if simulation.contact is not None or simulation.fallen:
        return None
    return driven.poses[branch:]


def explain(
    config: EpisodeConfig,
    telemetry: Telemetry | None = None,
    progress: Progress | None = None,
    searching: Progress | None = None,
) -> Explanation:
    """Run an episode again, and find the last moment at which its contact could be avoided.

    Args:
        config: The episode.
        telemetry: Listens to the run; it is told of the moment at the end.
        progress: Called after every step of the run.
        searching: Called with the time before the contact [s] and ``EARLIEST``, before each search.

    Raises:
        VucaError: The episode cannot be run, or did not come out twice the same.
    """
    telemetry = telemetry or Telemetry()
    episode = TracedEpisode(config)
    result = episode.run(telemetry, progress)
    if result.contact is None:
        course, _ = trace(episode, episode.commands)
        if result.failure is not None:
            telemetry.moment(result.failure.since, result.failure.where, result.failure.failure_class)
        return Explanation(episode, result, course, None)
    course, simulation = trace(episode, episode.commands, SURVIVED)
    facts = simulation.contact_facts
    if facts is None or facts.name != result.contact.other:
        raise NotRepeated("the contact did not come about again; nothing can be said of what might have been")
    avoidable = last_avoidable_moment(episode, course, searching)
    telemetry.moment(facts.time, facts.point, f"contact with {facts.name}: {result.contact.contact_class}")
    if avoidable.seconds is not None:
        text = f"last avoidable moment: {avoidable.seconds:g} s before the contact"
        telemetry.moment(facts.time - avoidable.seconds, tuple(avoidable.way[0, :2].tolist()), text)
    return Explanation(episode, result, course, avoidable)
