"""move_base: straight through the unknown, layers and weights by hand, the order of its recoveries."""

import math

import numpy as np
import pytest

from eval.baselines.move_base.config import LayersConfig, MoveBaseConfig, RecoveryConfig
from eval.baselines.move_base.layers import LayeredCostmap, ObstacleLayer, inscribed_radius
from eval.baselines.move_base.recovery import Recovery
from eval.baselines.move_base.stack import MoveBase
from eval.method_config import PAPER_EXPLORER
from eval.user_method import Request
from tests.vuca_nav.planning.test_planning import as_grid, hall
from tests.vuca_nav.rooms import LIDAR, disc_body, room, scan_of
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose, distance
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, Odometry, Pose2, Twist2

DT = 1.0 / 30.0
BODY = disc_body()
START, GOAL = Pose2(2.0, 3.0, 0.0), (23.0, 3.0)
HALL = np.vstack([room(26.0, 8.0), [[16.0, 0.0, 16.2, 4.6]]])
"""A hall with a wall across it that the robot does not see from its start; the way is at its upper end."""


class Told(Telemetry):
    def __init__(self):
        self.events: list[str] = []

    def event(self, text, level="INFO"):
        self.events.append(text)


def drive(stack: MoveBase, boxes: np.ndarray, seconds: float, goal=GOAL):
    """True poses (n, 3) and commands (n, 3) of a body that does at once what it is told."""
    pose, twist, poses, commands = START, Twist2(0.0, 0.0, 0.0), [], []
    stack.reset(START, goal)
    for k in range(round(seconds / DT)):
        odom = compose(Pose2(-START.x, -START.y, 0.0), pose)
        command = stack.step(scan_of(boxes, pose, k * DT), Odometry(k * DT, odom, twist))
        pose = compose(pose, Pose2(command.v_x * DT, 0.0, command.w_z * DT))
        twist = Twist2(*command)
        poses.append(pose)
        commands.append(command)
        if distance(pose, goal) < 0.2:
            break
    return np.array(poses), np.array(commands)


def test_it_plans_straight_through_the_unknown_and_round_what_it_meets():
    stack = MoveBase(MoveBaseConfig(), Request(BODY, LIDAR))
    stack.reset(START, GOAL)
    stack.step(scan_of(HALL, START), Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0)))
    path = stack.plan.path_in_map
    assert path[-1] == pytest.approx(GOAL)
    assert np.abs(path[:, 1] - 3.0).max() < 0.15  # 21 m, of which the lidar sees 12; the wall's place is unknown
    assert distance(START, stack.plan.waypoint_in_map) == pytest.approx(2.0, abs=0.15)
    poses, _ = drive(stack, HALL, 60.0)
    assert distance(tuple(poses[-1, :2]), GOAL) < 0.2
    crossing = poses[np.abs(poses[:, 0] - 16.1).argmin()]
    assert crossing[1] > 4.6 + 0.26


def test_with_exploration_it_plans_through_what_is_known():
    stack = MoveBase(MoveBaseConfig(explorer=PAPER_EXPLORER), Request(BODY, LIDAR))
    stack.reset(START, GOAL)
    stack.step(scan_of(HALL, START), Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0)))
    assert len(stack.plan.path_in_map) > 0
    assert stack.plan.path_in_map[:, 0].max() < 14.5  # the lidar's range from x = 2
    poses, _ = drive(stack, HALL, 60.0)
    assert distance(tuple(poses[-1, :2]), GOAL) < 0.2


def test_where_there_is_no_way_the_recoveries_come_in_order_and_the_goal_is_sent_again():
    told = Told()
    stack = MoveBase(MoveBaseConfig(), Request(BODY, LIDAR, telemetry=told))
    _, commands = drive(stack, room(6.0, 6.0), 70.0, goal=(9.0, 3.0))  # beyond a closed wall
    recoveries = [text.removeprefix("recovery: ") for text in told.events if text.startswith("recovery")]
    order = ["conservative clear", "rotate", "aggressive clear", "rotate", "abort"]
    assert recoveries[:6] == [*order, order[0]]
    turning = np.abs(commands[:, 2]) == 0.5
    # Twice about at 0.5 rad/s.
    assert turning.sum() * DT >= 2 * 2.0 * math.pi / 0.5 - 0.2


def test_recoveries_by_the_clock():
    recovery = Recovery(RecoveryConfig(planner_patience=5.0, progress_time=10.0, progress_distance=0.5))
    here = Pose2(0.0, 0.0, 0.0)
    recovery.reset(0.0, here)
    assert recovery.update(4.9, here, has_plan=False) is None
    assert recovery.update(5.0, here, has_plan=False) == "conservative clear"
    assert recovery.update(9.9, here, has_plan=False) is None
    assert recovery.update(10.0, here, has_plan=False) == "rotate"
    assert recovery.is_turning
    for k in range(4):
        recovery.turn(math.pi / 2.0, 11.0 + k, is_possible=True)
    assert not recovery.is_turning
    # With a plan, but without progress, it takes longer.
    assert recovery.update(19.1, here, has_plan=True) is None
    assert recovery.update(24.0, here, has_plan=True) == "aggressive clear"
    # Progress begins the list again.
    assert recovery.update(25.0, Pose2(0.6, 0.0, 0.0), has_plan=True) is None
    assert recovery.update(35.0, Pose2(0.6, 0.0, 0.0), has_plan=True) == "conservative clear"
    assert recovery.update(40.0, Pose2(0.6, 0.0, 0.0), has_plan=False) == "rotate"
    recovery.turn(0.1, 40.1, is_possible=False)
    assert not recovery.is_turning


def test_marks_stay_until_a_beam_passes_and_recoveries_forget_those_beyond():
    grid, layer = as_grid(hall(80, 80)), ObstacleLayer(LayersConfig(obstacle_range=2.5, raytrace_range=3.0))
    here, angles = Pose2(4.0, 4.0, 0.0), np.array([0.0, math.pi / 2.0, math.pi])

    def marked(x: float, y: float) -> bool:
        i, j = grid.cell(x, y)
        return bool(layer.marks[i, j])

    layer.update(grid, here, np.array([2.01, 1.01, 2.61]), angles)
    assert marked(6.01, 4.0)
    assert marked(4.0, 5.01)
    assert not marked(1.39, 4.0)  # beyond the range of obstacles
    layer.update(grid, here, np.array([np.inf, 0.51, np.inf]), angles)
    assert marked(6.01, 4.0)  # nothing came back, which clears nothing
    assert marked(4.0, 5.01)  # behind the return
    assert marked(4.0, 4.51)
    layer.update(grid, here, np.array([5.0, np.inf, np.inf]), angles)
    assert not marked(6.01, 4.0)
    layer.update(grid, here, np.array([2.01, np.inf, np.inf]), angles)
    layer.clear_beyond(1.5, (4.0, 4.0))
    assert not marked(6.01, 4.0)
    assert marked(4.0, 5.01)
    assert marked(4.0, 4.51)


def test_weights_are_navfns_of_an_exponential_inflation():
    grid, layer = as_grid(hall(100, 100)), ObstacleLayer(LayersConfig())
    layer.update(grid, Pose2(5.0, 5.04, 0.0), np.array([2.04]), np.array([0.0]))
    config = LayersConfig(inflation_radius=0.8, cost_scaling=4.0)
    costmap = LayeredCostmap(grid, layer, BODY, (2.0, 2.0), None, config)
    inscribed = inscribed_radius(BODY.footprint)
    assert inscribed == pytest.approx(0.28 * math.cos(math.pi / 24.0))
    for cells in (2, 3, 4, 6, 8, 12):
        i, j = costmap.cell(7.05 + 0.1 * cells, 5.05)
        away = 0.1 * cells - 0.05
        cost = 252.0 * math.exp(-4.0 * (away - inscribed)) if away <= 0.8 else 0.0
        expected = 0 if away <= inscribed else round(4 * (1.0 + 0.8 * cost / 50.0))
        assert costmap.weight[i, j] == expected, cells


def test_the_inscribed_circle_touches_the_nearest_edge():
    assert inscribed_radius(np.array([(0.4, -0.2), (0.4, 0.2), (-0.3, 0.2), (-0.3, -0.2)])) == pytest.approx(0.2)


@pytest.mark.parametrize("wrong", [{"look_ahead": 0.0}, {"planning_rate": -1.0}])
def test_settings_out_of_their_range_are_refused(wrong):
    with pytest.raises(BadArgument):
        MoveBaseConfig(**wrong)
