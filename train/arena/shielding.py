"""The robot's shield over policies in the arena, so that both can be measured in the same episodes."""

import numpy as np
from numpy.typing import NDArray

from train.arena.arena import Arena
from vuca_nav.perception.tracks import MAX_TRACKS, SLOT_SIZE, Tracker
from vuca_nav.policy.delay import Unanswered
from vuca_nav.policy.observation import command_from_action, limits_of
from vuca_nav.shield.shield import TRACK_SPACING, Guard, ShieldConfig
from vuca_nav.types import LidarSpec, VelocityCommand


class ArenaShield:
    """Guards every row of an arena on one thread, with what its robot senses. Made before the first decision.

    Args:
        arena: Whose rows run one episode each.
    """

    def __init__(self, arena: Arena):
        (self._shard,) = arena.shards
        bodies, rate, beams = arena.bodies.bodies, arena.config.decision_rate, arena.config.num_beams
        lidar = LidarSpec(num_beams=beams)
        kinds = arena.gather("body").tolist()
        guards = {k: Guard(bodies[k].spec, lidar) for k in set(kinds)}
        specs = [bodies[k].spec for k in kinds]
        self._guards = [guards[k] for k in kinds]
        self._limits = [limits_of(spec) for spec in specs]
        self._unanswered = [Unanswered(spec, rate) for spec in specs]
        self._tracker = Tracker(arena.n, beams, 1.0 / rate, TRACK_SPACING)
        self._reaches, self._fresh = np.full(arena.n, ShieldConfig().sight), np.ones(arena.n, np.bool_)
        self._things = np.zeros((MAX_TRACKS, SLOT_SIZE))

    def guard(self, rows: NDArray[np.int64], action: NDArray[np.float32]) -> None:
        """Replace what is not safe.

        Args:
            rows: That still go on.
            action: (n, 3) of all rows, shares of the bodies' limits; changed.
        """
        ranges = self._shard.ranges
        self._tracker.update(rows, ranges, self._shard.motion, self._reaches, self._fresh)
        self._fresh[rows] = False
        for i in rows.tolist():
            limits, unanswered = self._limits[i], self._unanswered[i]
            things = self._things[: self._tracker.things(i, self._things)]
            wanted = VelocityCommand(*command_from_action(action[i].astype(np.float64), limits).tolist())
            command = self._guards[i].choose(wanted, unanswered.last, unanswered.pose(), ranges[i], things)
            unanswered.add(command)
            if command != wanted:
                action[i] = action_from_command(command, limits)


def action_from_command(command: VelocityCommand, limits: NDArray[np.floating]) -> tuple[float, float, float]:
    """The inverse of ``command_from_action`` for a command within the limits (4,)."""
    v_x, v_y, w_z = command
    backward = -limits[1] if limits[1] < 0.0 else 1.0
    return (
        v_x / limits[0] if v_x >= 0.0 else v_x / backward,
        v_y / limits[2] if limits[2] > 0.0 else 0.0,
        w_z / limits[3],
    )
