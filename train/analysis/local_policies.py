"""Local policies of the stack in the arena: what does not learn meets the same episodes as what does."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from train.arena.arena import Arena
from train.arena.shielding import action_from_command
from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.policy.observation import limits_of
from vuca_nav.types import BodySpec, LidarSpec, Pose2, Scan, Twist2


class ArenaPolicies:
    """One for every row of an arena on one thread, with what its robot senses. Made before the first decision.

    Args:
        arena: Whose rows run one episode each.
        make: Makes one for a body and its lidar.
    """

    def __init__(self, arena: Arena, make: Callable[[BodySpec, LidarSpec], LocalPolicy]):
        (self._shard,) = arena.shards
        self._rate = arena.config.decision_rate
        lidar = LidarSpec(num_beams=arena.config.num_beams, rate=float(self._rate))
        specs = [arena.bodies.bodies[k].spec for k in arena.gather("body").tolist()]
        self._policies = [make(spec, lidar) for spec in specs]
        self._limits = [limits_of(spec) for spec in specs]
        self._decisions = 0

    def decide(self, rows: NDArray[np.int64], action: NDArray[np.float32]) -> None:
        """The next actions.

        Args:
            rows: That still go on.
            action: (n, 3) of all rows, shares of the bodies' limits; written to.
        """
        shard, stamp = self._shard, self._decisions / self._rate
        self._decisions += 1
        for i in rows.tolist():
            goal_x, goal_y = shard.goals[i].tolist()
            seen = LocalObservation(
                Scan(stamp, shard.ranges[i]), (goal_x, goal_y), True, Twist2(*shard.measured[i].tolist()),
                Pose2(*shard.motion[i].tolist()),
            )  # fmt: skip
            policy = self._policies[i]
            policy.look(seen)
            action[i] = action_from_command(policy.command(seen), self._limits[i])
