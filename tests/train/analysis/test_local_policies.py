import math

import numpy as np
import pytest

from train.analysis.episodes import Evaluation
from train.analysis.local_policies import ArenaPolicies
from train.arena.config import ArenaConfig, Imperfections
from vuca_nav.perception.percept import Percept
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.types import VelocityCommand

WORLD = ArenaConfig(layouts=2, pairs=4, num_bodies=2, imperfections=Imperfections.none())


class TowardsGoal(LocalPolicy):
    """Turns to the goal, then goes there, whatever is in the way."""

    def __init__(self, body, lidar):
        self.body, self.seen = body, []

    def reset(self) -> None:
        pass

    def command(self, percept: Percept, goal: LocalGoal | None) -> VelocityCommand:
        assert goal is not None
        self.seen.append((percept, goal))
        x, y = goal.point_in_base
        bearing = math.atan2(y, x)
        ahead = 0.5 * self.body.max_v_x if abs(bearing) < 0.3 else 0.0
        return VelocityCommand(ahead, 0.0, float(np.clip(2.0 * bearing, -self.body.max_w_z, self.body.max_w_z)))


def played(kind, make, episodes=8, movers=(6, 6)):
    config = WORLD.of(kind)
    config = ArenaConfig(**{name: getattr(config, name) for name in config.__slots__} | {"movers": movers})
    evaluation = Evaluation(config, ObservationConfig(), episodes, 0)
    policies = ArenaPolicies(evaluation.arena, make)
    while evaluation.active.any():
        action = np.zeros((episodes, 3), np.float32)
        policies.decide(np.flatnonzero(evaluation.active), action)
        evaluation.step(action)
    return policies, evaluation.records()


def test_who_goes_straight_to_the_goal_arrives_where_nothing_is():
    _, records = played("dynamic", TowardsGoal, movers=(0, 0))
    assert records.success.all()
    assert records.path_length == pytest.approx(records.shortest, rel=0.15, abs=0.5)


def test_a_policy_sees_its_own_row_at_the_arenas_rate():
    policies, _ = played("static", TowardsGoal)
    for policy in policies.policies:
        assert isinstance(policy, TowardsGoal)
        stamps = [seen.stamp for seen, _ in policy.seen]
        assert np.diff(stamps) == pytest.approx(1.0 / WORLD.decision_rate)
        (first, goal), (second, next_goal) = policy.seen[:2]
        assert len(first.scan.ranges) == WORLD.num_beams
        # What it was told of its motion explains how the goal has moved in its frame.
        c, s = math.cos(second.motion.yaw), math.sin(second.motion.yaw)
        dx, dy = goal.point_in_base[0] - second.motion.x, goal.point_in_base[1] - second.motion.y
        assert next_goal.point_in_base == pytest.approx((c * dx + s * dy, c * dy - s * dx), abs=1e-6)


def test_the_dynamic_window_stops_before_walls():
    blind, window = played("static", TowardsGoal, 16)[1], played("static", DynamicWindow, 16)[1]
    assert blind.collision.sum() > 4
    assert window.collision.sum() == 0
