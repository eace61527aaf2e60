import math
import subprocess
import sys

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, disc_body, room, scan_of
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose, distance, inverse, levelling, transform_points
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, LidarSpec, Odometry, Pose2, Scan, Twist2

DT = 1.0 / 30.0

# A hall with a blind alley on the straight way to the goal: open towards the start, closed before the goal.
ALLEY = np.vstack(
    [
        room(20.0, 12.0),
        [[6.0, 3.0, 12.0, 3.2], [6.0, 7.0, 12.0, 7.2], [11.8, 3.0, 12.0, 7.2]],
    ]
)
START, GOAL = Pose2(2.0, 5.1, 0.0), (17.0, 5.1)


class Counting(Telemetry):
    def __init__(self):
        self.commands = self.paths = self.decisions = 0

    def command(self, command):
        self.commands += 1

    def path(self, points_in_map):
        self.paths += 1

    def frontiers(self, view):
        self.decisions += 1


def drive(seed: int, seconds: float = 90.0, telemetry: Telemetry = Telemetry()):
    """Noisy scans and odometry that drifts; the true poses (n, 3), the navigator, and the least clearance."""
    body = disc_body()
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR), telemetry=telemetry)
    navigator.reset(START, GOAL)
    rng = np.random.default_rng(seed)
    pose, odom, twist = START, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)
    poses, least = [], np.inf
    for k in range(round(seconds / DT)):
        least = min(least, float(scan_of(ALLEY, pose).ranges.min()))
        command = navigator.step(scan_of(ALLEY, pose, k * DT, rng), Odometry(k * DT, odom, twist))
        pose = compose(pose, Pose2(command.v_x * DT, 0.0, command.w_z * DT))
        odom = compose(odom, Pose2(1.03 * command.v_x * DT, 0.0, 1.02 * command.w_z * DT + rng.normal(0.0, 2e-4)))
        twist = Twist2(*command)
        poses.append(pose)
        if distance(pose, GOAL) < 0.2:
            break
    return np.array(poses), navigator, least


def test_it_finds_its_way_round_a_blind_alley():
    told = Counting()
    poses, navigator, least = drive(0, telemetry=told)
    assert distance(tuple(poses[-1, :2]), GOAL) < 0.2
    assert least > 0.28
    assert distance(navigator.map_from_base, tuple(poses[-1, :2])) < 0.1
    assert told.commands == len(poses)
    assert told.paths >= len(poses) // 30
    assert told.decisions >= 1


def test_same_input_same_bits():
    a, _, _ = drive(3, seconds=8.0)
    b, _, _ = drive(3, seconds=8.0)
    c, _, _ = drive(4, seconds=8.0)
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(a, c)


def test_a_map_known_beforehand_is_used_from_the_first_step():
    body = disc_body()
    known = OccupancyGrid(GridConfig())
    level = np.full((240, 400), -1, np.int8)
    for x0, y0, x1, y1 in ALLEY:
        rows = slice(max(round(y0 / 0.05), 0), max(round(y1 / 0.05), 0))
        level[rows, max(round(x0 / 0.05), 0) : max(round(x1 / 0.05), 0)] = 1
    known.fill(level, (0.0, 0.0))
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    navigator.reset(START, GOAL, prior_map=known)
    navigator.step(scan_of(ALLEY, START), Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
    assert navigator.explorer.target is not None
    assert navigator.explorer.target.is_goal
    path = navigator._path_in_map
    assert path[-1] == pytest.approx(GOAL)
    # Round the alley, not through it.
    beside = path[(path[:, 0] > 8.0) & (path[:, 0] < 11.0)]
    assert ((beside[:, 1] < 2.7) | (beside[:, 1] > 7.5)).all()


class Seeing(DynamicWindow):
    """Knows of one walker, where he stands in the room."""

    pose = START

    def walkers(self):
        x, y = transform_points(inverse(self.pose), np.array([[6.0, 5.1]]))[0]
        return np.array([[x, y, 0.25]])


def test_who_walks_is_not_mapped_while_the_robot_turns_either():
    body = disc_body()
    person = np.vstack([room(20.0, 12.0), [[5.8, 4.9, 6.2, 5.3]]])
    for policy, state in ((DynamicWindow(body, LIDAR), 1), (Seeing(body, LIDAR), 0)):
        navigator = Navigator(body, LIDAR, policy)
        navigator.reset(START, GOAL)
        Seeing.pose = START
        for k in range(40):
            turned = Pose2(0.0, 0.0, 0.06 * k)  # 1.8 rad/s
            pose = compose(START, turned)
            navigator.step(scan_of(person, pose, k * DT), Odometry(k * DT, turned, Twist2(0.0, 0.0, 1.8)))
            Seeing.pose = pose  # what it knows is of this scan
        grid = navigator.slam.navigation_grid
        beside = [grid.state(5.81, y) for y in np.arange(4.925, 5.3, 0.05)]
        assert max(beside) == state


def test_who_was_last_seen_in_the_only_way_on_is_not_there_for_ever():
    # A room that is known, its way on at (6.1, 5) out of sight behind a wall, and beyond that the unknown.
    boxes = np.vstack([room(6.0, 6.0), [[4.5, 2.0, 4.7, 6.0]]])
    level = np.full((120, 160), -1, np.int8)
    level[:, 124:] = 0
    level[[0, -1], :124] = level[:, 0] = level[:88, 120:124] = level[112:, 120:124] = level[40:, 90:94] = 1
    known = OccupancyGrid(GridConfig())
    known.fill(level, (0.0, 0.0))
    body, start = disc_body(), Pose2(2.0, 4.0, 0.0)
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    navigator.reset(start, (9.0, 5.0), known)
    cells = np.array([(x, y) for x in np.arange(4.975, 5.75, 0.05) for y in (3.025, 3.075)])  # 0.8 of 1.3 m
    box = np.array([4.9, 3.0, 5.8, 4.0])
    for _ in range(5):
        navigator.slam.navigation_grid.insert(Pose2(5.4, 4.0, 0.0), cells, len(cells), np.full(len(cells), 0.1), box)
    targets = []
    for k in range(90):
        navigator.step(scan_of(boxes, start, k * DT), Odometry(k * DT, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
        targets.append(navigator.explorer.target)
    assert not any(targets[:60])
    assert targets[-1] is not None
    assert distance(targets[-1].point, (6.1, 5.0)) < 0.8
    assert len(navigator._path_in_map) > 0


@pytest.mark.parametrize("another_way_on", [True, False])
def test_doubt_comes_before_what_was_given_up_but_leads_nowhere_then(another_way_on):
    # From the west room one free gap, below, and one above that somebody was last seen in; beyond each an opening to
    # the unknown, or beyond both the lower one's.
    level = np.full((120, 180), -1, np.int8)
    level[:, 164:] = 0
    level[[0, -1], :164] = level[:, 0] = level[:, 90:94] = level[:, 160:164] = 1
    level[10:36, 90:94] = level[76:102, 90:94] = level[10:36, 160:164] = -1
    if another_way_on:
        level[76:102, 160:164] = -1
        level[58:62, 94:160] = 1
    known = OccupancyGrid(GridConfig())
    known.fill(level, (0.0, 0.0))
    body, start = disc_body(), Pose2(2.0, 4.4, 0.0)
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    navigator.reset(start, (12.0, 3.0), known)
    cells = np.array([(x, y) for x in (4.575, 4.625) for y in np.arange(4.075, 4.85, 0.05)])  # 0.8 of 1.3 m
    box = np.array([3.4, 3.8, 5.0, 5.2])
    for _ in range(5):
        navigator.slam.navigation_grid.insert(Pose2(3.5, 4.4, 0.0), cells, len(cells), np.full(len(cells), 0.1), box)
    nothing = np.full(LIDAR.num_beams, np.nan)
    for k in range(90):
        if k == 70:
            assert navigator.explorer.target is not None
            assert navigator.explorer.target.point[1] < 2.0
            navigator.explorer.give_up(70 * DT)
        navigator.step(Scan(k * DT, nothing), Odometry(k * DT, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
    target, path = navigator.explorer.target, navigator._path_in_map
    assert target is not None
    through = path[abs(path[:, 0] - 4.6) < 0.2, 1]
    assert len(through) > 0
    assert (target.point[1] > 3.5) == another_way_on
    assert ((through > 3.5) == another_way_on).all()


class SeeingAhead(DynamicWindow):
    """Knows of one walker 5 m off, at a bearing."""

    bearing = 0.0

    def walkers(self):
        return np.array([[5.0 * math.cos(self.bearing), 5.0 * math.sin(self.bearing), 0.25]])


def test_who_walks_is_not_mapped_while_the_robot_leans_either():
    body, lean = disc_body(), 0.35
    up = (-math.sin(lean), math.sin(lean) * math.cos(lean), math.cos(lean) ** 2)
    bearing = SeeingAhead.bearing = math.atan2(-up[0], up[1])  # level beams go there
    ranges = np.where(abs(LIDAR.angles_in_base() - bearing) < 0.03, 5.0, np.nan)
    there = levelling(up) @ [5.0 * math.cos(bearing), 5.0 * math.sin(bearing)]
    assert abs(math.atan2(there[1], there[0]) - bearing) > math.radians(3.0)
    for policy, state in ((DynamicWindow(body, LIDAR), 1), (SeeingAhead(body, LIDAR), 0)):
        navigator = Navigator(body, LIDAR, policy)
        navigator.reset(Pose2(0.0, 0.0, 0.0), GOAL)
        for k in range(20):
            odometry = Odometry(k * DT, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0), up)
            navigator.step(Scan(k * DT, ranges), odometry)
        assert max(navigator.slam.navigation_grid.state(*(there * share)) for share in (0.98, 1.0, 1.02)) == state


def test_the_policy_is_told_when_it_is_stopped():
    body = disc_body()
    policy = DynamicWindow(body, LIDAR)
    navigator = Navigator(body, LIDAR, policy)
    navigator.reset(Pose2(5.0, 5.0, 0.0), (7.0, 5.0))
    scan = scan_of(room(10.0, 10.0), Pose2(5.0, 5.0, 0.0))
    for k in range(15):
        navigator.step(Scan(k * DT, scan.ranges), Odometry(k * DT, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
    assert policy._last.v_x > 0.2
    assert policy._unanswered.last.v_x > 0.2
    navigator.goal = (5.0, 5.0)  # it is there
    for k in range(15, 60):
        navigator.step(Scan(k * DT, scan.ranges), Odometry(k * DT, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0)))
    assert navigator.arrived
    assert policy._last == STOP
    assert policy._unanswered.last == STOP


def test_rates_must_divide():
    body = disc_body()
    with pytest.raises(BadArgument, match="7"):
        Navigator(body, LIDAR, DynamicWindow(body, LIDAR), NavigatorConfig(planning_rate=7.0))
    with pytest.raises(BadArgument, match="make them equal"):
        Navigator(body, LidarSpec(rate=10.0), DynamicWindow(body, LIDAR))


def test_the_stack_imports_without_simulator_and_torch():
    code = (
        "import sys; [sys.modules.__setitem__(m, None) for m in ('mujoco', 'dm_control', 'torch', 'trimesh', 'worlds',"
        " 'robots', 'eval')]; import vuca_nav.navigator, vuca_nav.policy.dynamic_window,"
        " vuca_nav.telemetry.interface, vuca_nav.cli"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
