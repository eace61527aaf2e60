"""Local policies of the stack in the arena: shield and dynamic window on the same episodes as networks."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from train.arena.arena import Arena
from vuca_nav.geometry import compose
from vuca_nav.perception.percept import Percept
from vuca_nav.perception.perception import Perception
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.observation import action_from_command, command_from_action, limits_of
from vuca_nav.shield.shield import CommandFilter, Shield
from vuca_nav.types import STANDING, STOP, BodySpec, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand


class ArenaPolicies:
    """A policy of the stack for every row of an arena on one thread. To be made before the first decision.

    Args:
        arena: An arena whose rows run one episode each.
        make: Function that makes a policy for a body and its lidar.
    """

    def __init__(self, arena: Arena, make: Callable[[BodySpec, LidarSpec], LocalPolicy]):
        (self._shard,) = arena.shards
        self._rate = arena.config.decision_rate
        lidar = LidarSpec(num_beams=arena.config.num_beams, rate=float(self._rate))
        specs = [arena.bodies.bodies[k].spec for k in arena.gather("body").tolist()]
        self.policies = [make(spec, lidar) for spec in specs]
        self._perceptions = [Perception(lidar) for _ in specs]
        self._odometry = [STANDING] * len(specs)
        self._limits = [limits_of(spec) for spec in specs]
        self._decisions = 0

    def decide(self, rows: NDArray[np.int64], action: NDArray[np.float32]) -> None:
        """Write the next actions.

        Args:
            rows: Rows that still go on.
            action: (n, 3) of all rows, shares of the bodies' limits; written to.
        """
        for i, command in zip(rows.tolist(), self.commands(rows)):
            action[i] = action_from_command(command, self._limits[i])

    def commands(self, rows: NDArray[np.int64]) -> list[VelocityCommand]:
        """Commands for the rows, all of which still go on."""
        shard, stamp, commands = self._shard, self._decisions / self._rate, []
        self._decisions += 1
        for i in rows.tolist():
            self._odometry[i] = compose(self._odometry[i], Pose2(*shard.motion[i].tolist()))
            odometry = Odometry(stamp, self._odometry[i], Twist2(*shard.measured[i].tolist()))
            percept = self._perceptions[i].update(Scan(stamp, shard.ranges[i]), odometry)
            goal_x, goal_y = shard.goals[i].tolist()
            commands.append(self.policies[i].command(percept, LocalGoal((goal_x, goal_y), True)))
        return commands


class ArenaShield:
    """Filter over every row's actions, as the robot's shield is. To be made before the first decision.

    Args:
        arena: An arena on one thread whose rows run one episode each.
    """

    def __init__(self, arena: Arena):
        filters: dict[str, CommandFilter] = {}
        self._given: list[_Given] = []

        def make(body: BodySpec, lidar: LidarSpec) -> Shield:
            if body.name not in filters:
                filters[body.name] = CommandFilter(body, lidar)
            self._given.append(_Given())
            return Shield(body, lidar, self._given[-1], command_filter=filters[body.name])

        self._shields = ArenaPolicies(arena, make)
        self._limits = [limits_of(arena.bodies.bodies[k].spec) for k in arena.gather("body").tolist()]

    def filter(self, rows: NDArray[np.int64], action: NDArray[np.float32]) -> None:
        """Replace unsafe actions.

        Args:
            rows: Rows that still go on.
            action: (n, 3) of all rows, shares of the bodies' limits; changed.
        """
        given = []
        for i in rows.tolist():
            command = command_from_action(action[i].astype(np.float64), self._limits[i]).tolist()
            given.append(VelocityCommand(*command))
            self._given[i].command_given = given[-1]
        for i, wanted, command in zip(rows.tolist(), given, self._shields.commands(rows)):
            if command != wanted:
                action[i] = action_from_command(command, self._limits[i])


class _Given(LocalPolicy):
    """A policy that returns the command it was given."""

    def __init__(self) -> None:
        self.command_given = STOP

    def reset(self) -> None:
        """Do nothing: there is no memory."""

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        """The command that was given."""
        return self.command_given
