import math
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.random_safety import TRACKED, random_safety
from tests.vuca_nav.rooms import LIDAR, REST, disc_body, ranges_to_boxes, room, scan_of
from vuca_nav.errors import BadArgument
from vuca_nav.exploration.critic import LearnedCritic, load_critic
from vuca_nav.exploration.explorer import Explorer
from vuca_nav.exploration.heuristic import NoCritic
from vuca_nav.geometry import compose, distance, levelling, transform_points
from vuca_nav.mapping.grid import GridConfig, OccupancyGrid
from vuca_nav.mapping.slam import Slam, SlamConfig
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.perception.perception import Perception, PerceptionConfig
from vuca_nav.perception.tracks import Tracker
from vuca_nav.planning.planner import Planner
from vuca_nav.policy.base import LocalPolicy
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.shield.shield import Shield
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, STOP, LidarSpec, Odometry, Pose2, Scan, Twist2, VelocityCommand

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


class Hall:
    """A disc with exact sensors in an empty hall."""

    def __init__(self, navigator: Navigator, start: Pose2):
        self.navigator, self.pose, self.odom, self.twist, self.tick = navigator, start, STANDING, REST, 0

    def drive(self, ticks: int, goal: tuple[float, float] | None = None) -> list[VelocityCommand]:
        """Drive for a time or to within 0.1 m of a goal; the commands."""
        commands = []
        for _ in range(ticks):
            stamp = self.tick * DT
            scan, odometry = scan_of(room(12.0, 9.0), self.pose, stamp), Odometry(stamp, self.odom, self.twist)
            command = self.navigator.step(scan, odometry)
            commands.append(command)
            step = Pose2(command.v_x * DT, 0.0, command.w_z * DT)
            self.pose, self.odom, self.twist = compose(self.pose, step), compose(self.odom, step), Twist2(*command)
            self.tick += 1
            if goal is not None and distance(self.pose, goal) < 0.1:
                break
        return commands


def test_without_a_goal_it_stands_and_maps_and_then_heads_for_one():
    body, start, goal = disc_body(), Pose2(2.0, 2.0, 0.0), (9.0, 7.0)
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    navigator.reset(start, None)
    hall = Hall(navigator, start)
    assert set(hall.drive(20)) == {STOP}
    assert navigator.slam.navigation_grid.state(5.0, 2.0) == -1  # seen to be free
    navigator.head_for(goal)
    assert hall.drive(1) != [STOP]  # planned at once, not at the next time of planning
    hall.drive(900, goal)
    assert distance(hall.pose, goal) < 0.1


def test_another_goal_while_driving_keeps_the_map_and_turns_to_it():
    body, start, goal = disc_body(), Pose2(2.0, 2.0, 0.0), (4.0, 7.0)
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    navigator.reset(start, (10.0, 2.0))
    hall = Hall(navigator, start)
    hall.drive(120)
    assert hall.pose.x > 4.0
    entropy = navigator.slam.navigation_grid.entropy
    navigator.head_for(goal)
    assert navigator.slam.navigation_grid.entropy == entropy
    hall.drive(900, goal)
    assert distance(hall.pose, goal) < 0.1
    assert distance(navigator.map_from_base, hall.pose) < 0.05
    navigator.head_for(None)
    assert set(hall.drive(3)) == {STOP}
    with pytest.raises(BadArgument, match="finite"):
        navigator.head_for((math.nan, 0.0))


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
    path = navigator.plan.path_in_map
    assert path[-1] == pytest.approx(GOAL)
    # Round the alley, not through it.
    beside = path[(path[:, 0] > 8.0) & (path[:, 0] < 11.0)]
    assert ((beside[:, 1] < 2.7) | (beside[:, 1] > 7.5)).all()


def test_a_mover_that_was_last_seen_in_the_only_way_on_is_not_there_for_ever():
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
    assert len(navigator.plan.path_in_map) > 0


@pytest.mark.parametrize("another_way_on", [True, False])
def test_doubt_comes_before_what_was_given_up_but_leads_nowhere_then(another_way_on):
    # From the west room one free gap, below, and one above that a mover was last seen in; beyond each an opening to
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
    target, path = navigator.explorer.target, navigator.plan.path_in_map
    assert target is not None
    through = path[abs(path[:, 0] - 4.6) < 0.2, 1]
    assert len(through) > 0
    assert (target.point[1] > 3.5) == another_way_on
    assert ((through > 3.5) == another_way_on).all()


class Watching(Telemetry):
    """Keeps where the last scan's returns are, which corrections there were, and events."""

    def __init__(self):
        self.points_in_map, self.corrections, self.events = np.empty((0, 2)), [], []

    def scan(self, scan, points_in_map):
        self.points_in_map = points_in_map.copy()

    def map_correction(self, map_correction):
        self.corrections.append(map_correction)

    def event(self, text, level="INFO"):
        self.events.append(text)


@pytest.mark.parametrize("tracks", [True, False])
def test_a_mover_is_kept_out_of_the_map_by_the_tracks_of_this_very_tick(tracks):
    """While the robot turns by 0.06 rad a tick: where it was in the last base_link is 0.24 m off."""
    body, told = disc_body(), Watching()
    config = NavigatorConfig(perception=PerceptionConfig(tracks=tracks, own_returns=0.1))
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR), config, told)
    navigator.reset(START, GOAL)
    grid, pose, rises = navigator.slam.navigation_grid, START, []
    for k in range(120):
        turn = 0.06 if k > 75 else 0.0
        pose = compose(pose, Pose2(0.0, 0.0, turn))
        y = 3.2 + 0.8 * k * DT
        scan = scan_of(np.vstack([room(20.0, 12.0), [[5.8, y - 0.2, 6.2, y + 0.2]]]), pose, k * DT)
        odom_from_base, before = Pose2(0.0, 0.0, pose.yaw), grid.level.copy()
        navigator.step(scan, Odometry(k * DT, odom_from_base, Twist2(0.0, 0.0, turn / DT)))
        own = told.points_in_map[np.hypot(*(told.points_in_map - (5.8, y)).T) < 0.25]
        assert len(own) >= 4
        if k > 75:
            cells = [grid.cell(*point) for point in own]
            rises.append(max(int(grid.level[cell]) - before[cell] for cell in cells))
    assert max(rises) <= 0 if tracks else min(rises) > 0


@pytest.mark.parametrize("tracks", [True, False])
def test_a_mover_is_kept_out_of_the_map_while_the_robot_leans(tracks):
    """It comes along the beams that are level still."""
    body, lean = disc_body(), 0.35
    up = (-math.sin(lean), math.sin(lean) * math.cos(lean), math.cos(lean) ** 2)
    bearing = math.atan2(-up[0], up[1])  # level beams go there
    navigator = Navigator(
        body, LIDAR, DynamicWindow(body, LIDAR), NavigatorConfig(perception=PerceptionConfig(tracks=tracks))
    )
    navigator.reset(STANDING, GOAL)
    away = 0.0
    for k in range(90):
        away = 6.5 - 0.6 * k * DT
        ranges = np.where(abs(LIDAR.angles_in_base() - bearing) < 0.2 / away, away, np.inf)
        navigator.step(Scan(k * DT, ranges), Odometry(k * DT, STANDING, Twist2(0.0, 0.0, 0.0), up))
    there = levelling(up) @ [away * math.cos(bearing), away * math.sin(bearing)]
    assert abs(math.atan2(there[1], there[0]) - bearing) > math.radians(3.0)
    state = max(navigator.slam.navigation_grid.state(*(there * share)) for share in (0.99, 1.0, 1.01))
    assert state == 1 if not tracks else state < 1


class Recorder(LocalPolicy):
    """Gives a command; keeps the percepts and goals that it is asked with."""

    def __init__(self, wanted: VelocityCommand = STOP):
        self.wanted, self.percepts, self.goals = wanted, [], []

    def reset(self):
        self.percepts, self.goals = [], []

    def command(self, percept, goal):
        self.percepts.append(percept)
        self.goals.append(goal)
        return STOP if goal is None else self.wanted


def test_the_policy_is_told_to_stand_when_it_is_there():
    body, recorder = disc_body(), Recorder(VelocityCommand(0.5, 0.0, 0.0))
    navigator = Navigator(body, LIDAR, recorder)
    navigator.reset(Pose2(5.0, 5.0, 0.0), (7.0, 5.0))
    ranges = ranges_to_boxes(room(10.0, 10.0), Pose2(5.0, 5.0, 0.0))

    def step(k: int) -> VelocityCommand:
        return navigator.step(Scan(k * DT, ranges), Odometry(k * DT, STANDING, Twist2(0.0, 0.0, 0.0)))

    commands = [step(k) for k in range(15)]
    assert all(command.v_x == 0.5 for command in commands)
    goal = recorder.goals[-1]
    assert goal is not None
    assert goal.is_final
    assert goal.point_in_base == pytest.approx((2.0, 0.0), abs=0.01)
    navigator.head_for((5.0, 5.0))  # it is there
    commands = [step(k) for k in range(15, 60)]
    assert navigator.arrived
    assert commands == [STOP] * 45
    assert recorder.goals[15:] == [None] * 45


def test_a_policy_without_planning_is_given_the_goal_itself():
    """Straight through the blind alley's walls, by the estimated pose, and without a survey of the map."""
    recorder, told = Recorder(VelocityCommand(0.5, 0.0, 0.0)), Counting()
    config = NavigatorConfig(direct=True)
    navigator = Navigator(disc_body(), LIDAR, recorder, config, told)
    start = Pose2(2.0, 5.1, 0.5 * math.pi)
    navigator.reset(start, GOAL)
    for k in range(61):
        navigator.step(scan_of(ALLEY, start, k * DT), Odometry(k * DT, STANDING, Twist2(0.0, 0.0, 0.0)))
    assert (told.decisions, told.paths) == (0, 3)
    for goal in recorder.goals:
        assert goal is not None
        assert goal.is_final
        assert goal.point_in_base == pytest.approx((0.0, -15.0), abs=0.1)
    assert navigator.plan.path_in_map == pytest.approx(np.array([start[:2], GOAL]), abs=0.05)
    navigator.goal = start[:2]  # it is there
    navigator.step(scan_of(ALLEY, start, 61 * DT), Odometry(61 * DT, STANDING, Twist2(0.0, 0.0, 0.0)))
    assert recorder.goals[-1] is None


def test_every_stage_is_entered_once_a_tick(monkeypatch, tmp_path):
    """With all that looks at the percept: a shield over a network with tracks, and a critic."""
    calls: Counter[str] = Counter()

    def count(owner, method):
        inner = getattr(owner, method)

        def counted(*arguments, **named):
            calls[owner.__name__] += 1
            return inner(*arguments, **named)

        monkeypatch.setattr(owner, method, counted)

    for owner, method in (
        (Perception, "update"), (Tracker, "update"), (Slam, "update"), (Explorer, "update"), (Planner, "update"),
        (LearnedPolicy, "command"), (Shield, "command"),
    ):  # fmt: skip
        count(owner, method)
    body = disc_body()
    weights = load_weights(random_policy(tmp_path / "p.safetensors", TRACKED))
    policy = Shield(body, LIDAR, LearnedPolicy(body, LIDAR, weights))
    critic = LearnedCritic(body, LIDAR, load_critic(random_safety(tmp_path / "s.safetensors")))
    navigator = Navigator(body, LIDAR, policy, critic=critic)
    navigator.reset(START, GOAL)
    decided, ticks = 0, 70
    for k in range(ticks):
        calls.clear()
        navigator.step(scan_of(ALLEY, START, k * DT), Odometry(k * DT, STANDING, Twist2(0.0, 0.0, 0.0)))
        each_tick = {name: calls[name] for name in ("Perception", "Tracker", "Slam", "LearnedPolicy", "Shield")}
        assert each_tick == dict.fromkeys(each_tick, 1)
        assert calls["Explorer"] == calls["Planner"] <= 1
        if k % 30 == 0:
            assert calls["Planner"] == 1
        decided += calls["Planner"]
    assert decided < ticks / 5


def test_every_stage_and_the_policy_get_the_same_percept():
    class Critical(NoCritic):
        percept = None

        def values(self, points_in_map, percept, map_from_base):
            self.percept = percept
            return super().values(points_in_map, percept, map_from_base)

    recorder, critic = Recorder(), Critical()
    navigator = Navigator(disc_body(), LIDAR, recorder, critic=critic)
    navigator.reset(START, GOAL)
    navigator.step(scan_of(ALLEY, START), Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0)))
    assert navigator.percept is not None
    assert recorder.percepts == [navigator.percept]
    assert critic.percept is navigator.percept


def policies(tmp_path):
    """Every kind."""
    body = disc_body()
    paper, tracked = (
        LearnedPolicy(
            body, LIDAR, load_weights(random_policy(tmp_path / f"{kind}.safetensors", ObservationConfig(kind=kind)))
        )
        for kind in ("paper", "tracked")
    )
    return {
        "dynamic window": DynamicWindow(body, LIDAR),
        "paper": paper,
        "tracked": tracked,
        "shield over dynamic window": Shield(body, LIDAR, DynamicWindow(body, LIDAR)),
        "shield over tracked": Shield(body, LIDAR, tracked),
    }


@pytest.mark.parametrize(
    "name", ["dynamic window", "paper", "tracked", "shield over dynamic window", "shield over tracked"]
)
@pytest.mark.parametrize("broken", ["scan", "twist", "odometry"])
def test_every_method_stands_while_its_sensors_are_broken(tmp_path, name, broken):
    navigator = Navigator(disc_body(), LIDAR, policies(tmp_path)[name])
    navigator.reset(START, GOAL)
    ranges, nan = scan_of(ALLEY, START).ranges, math.nan
    for k in range(40):
        faulty = 20 <= k < 30
        scan = np.where(np.arange(360) < 181, nan, ranges) if faulty and broken == "scan" else ranges
        twist = Twist2(0.0, nan, 0.0) if faulty and broken == "twist" else Twist2(0.0, 0.0, 0.0)
        odom_from_base = Pose2(0.0, nan, nan) if faulty and broken == "odometry" else STANDING
        command = navigator.step(Scan(k * DT, scan), Odometry(k * DT, odom_from_base, twist))
        assert all(math.isfinite(value) for value in (*command, *navigator.map_from_base))
        if faulty:
            assert command == STOP
        elif k != 30:  # one tick later the motion is known again
            assert command != STOP
    assert distance(navigator.map_from_base, START) < 0.01


# -- a correction of the map -------------------------------------------------------------------------------------------

CORRECTION = Pose2(0.6, -0.4, 0.3)
"""Far more than the distance at which the robot counts as not stuck."""
BY_ODOMETRY = NavigatorConfig(slam=SlamConfig(localisation="odometry"))
"""Corrections move the estimate, the grid follows with its submaps: nothing here is matched."""


def twins(policy: Callable[[], LocalPolicy], ticks: int, config: NavigatorConfig = BY_ODOMETRY):
    """Two navigators that did the same, with what is told of them; and a function for their next ticks."""
    told = [Watching(), Watching()]
    both = [Navigator(disc_body(), LIDAR, policy(), config, t) for t in told]
    for navigator in both:
        navigator.reset(START, GOAL)
    odom, tick = STANDING, 0

    def step() -> list[VelocityCommand]:
        nonlocal odom, tick
        scan, odometry = scan_of(ALLEY, START, tick * DT), Odometry(tick * DT, odom, Twist2(0.1, 0.0, 0.0))
        tick, odom = tick + 1, compose(odom, Pose2(0.001, 0.0, 0.0))
        return [navigator.step(scan, odometry) for navigator in both]

    for _ in range(ticks):
        step()
    return both, told, step


def test_what_is_remembered_in_the_map_follows_a_correction_and_commands_stay():
    (corrected, other), (told, told_nothing), step = twins(lambda: DynamicWindow(disc_body(), LIDAR), 40)
    assert len(corrected.plan.path_in_map) > 5
    assert corrected.explorer.target is not None
    assert other.explorer.target is not None
    corrected.slam.correct(CORRECTION)
    for k in range(5):  # no stage that plans is due before the next trigger
        a, b = step()
        assert a == pytest.approx(b, abs=1e-9)
        assert a.v_x > 0.2
        assert told.corrections == [pytest.approx(CORRECTION)], f"told at tick {k}"
        assert corrected.map_from_base == pytest.approx(compose(CORRECTION, other.map_from_base), abs=1e-9)
        assert corrected.plan.path_in_map == pytest.approx(transform_points(CORRECTION, other.plan.path_in_map))
        waypoint, target = other.plan.waypoint_in_map, other.explorer.target
        expected = transform_points(CORRECTION, np.array([waypoint, target.point, target.approach]))
        moved = corrected.explorer.target
        assert np.array([corrected.plan.waypoint_in_map, moved.point, moved.approach]) == pytest.approx(expected)
    assert corrected.slam.map_from_odom == pytest.approx(compose(CORRECTION, START))
    assert other.slam.map_from_odom == START
    assert told_nothing.corrections == []
    assert corrected.goal == GOAL


def test_the_policy_gets_the_same_waypoint_in_base_at_the_tick_of_a_correction():
    (corrected, other), _, step = twins(lambda: Recorder(), 40)
    corrected.slam.correct(CORRECTION)
    step()
    mine, others = corrected.policy.goals[-1], other.policy.goals[-1]  # pyright: ignore[reportAttributeAccessIssue]
    assert mine.point_in_base == pytest.approx(others.point_in_base, abs=1e-9)
    assert mine.is_final == others.is_final


def test_a_correction_is_no_progress():
    """A robot that stands is stuck after 2 s, although the map has carried it 0.7 m along after 1 s."""
    config = replace(BY_ODOMETRY, stuck_time=2.0)
    both, told, step = twins(lambda: Recorder(), 30, config)
    both[0].slam.correct(CORRECTION)
    given_up = [[], []]
    for tick in range(30, 90):
        step()
        for k in range(2):
            if "no progress: target given up" in told[k].events:
                given_up[k].append(tick)
    assert given_up[0][0] == given_up[1][0] == 60


def test_rates_must_divide():
    body = disc_body()
    with pytest.raises(BadArgument, match="7"):
        Navigator(body, LIDAR, DynamicWindow(body, LIDAR), NavigatorConfig(planning_rate=7.0))
    with pytest.raises(BadArgument, match=r"made for 10\.0 Hz, the navigator's loop runs at 30\.0 Hz"):
        Navigator(body, LIDAR, DynamicWindow(body, LIDAR, rate=10.0))
    slow = LidarSpec(rate=10.0)
    Navigator(body, slow, DynamicWindow(body, slow, rate=30.0))


def test_the_stack_imports_without_simulator_and_torch():
    code = (
        "import sys; [sys.modules.__setitem__(m, None) for m in ('mujoco', 'dm_control', 'torch', 'trimesh', 'worlds',"
        " 'robots', 'eval')]; import vuca_nav.navigator, vuca_nav.policy.dynamic_window,"
        " vuca_nav.telemetry.interface, vuca_nav.cli"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(("goal", "finds_out"), [((9.0, 3.0), True), ((5.0, 4.5), False)])
def test_a_goal_that_cannot_be_reached_is_found_out_and_said(goal, finds_out):
    """Beyond the walls of a closed room, or in a corner of it."""

    class Saying(Telemetry):
        def __init__(self):
            self.said = []

        def event(self, text, level="INFO"):
            self.said.append(text)

    body, walls, telemetry = disc_body(), room(6.0, 6.0), Saying()
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR), telemetry=telemetry)
    pose = start = Pose2(2.0, 2.0, 0.0)
    navigator.reset(start, goal)
    odom, twist = STANDING, REST
    for k in range(round(25.0 / DT)):
        command = navigator.step(scan_of(walls, pose, k * DT), Odometry(k * DT, odom, twist))
        motion = Pose2(command.v_x * DT, 0.0, command.w_z * DT)
        pose, odom, twist = compose(pose, motion), compose(odom, motion), Twist2(*command)
    said = [text for text in telemetry.said if text.startswith("the goal cannot be reached: ")]
    assert (navigator.finding is not None) is finds_out
    assert len(said) == finds_out
    navigator.head_for((3.0, 3.0))
    assert navigator.finding is None


def test_without_sight_nothing_is_found_out_about_the_goal():
    body = disc_body()
    navigator = Navigator(body, LIDAR, DynamicWindow(body, LIDAR))
    navigator.reset(Pose2(2.0, 2.0, 0.0), (9.0, 3.0))
    for k in range(300):
        navigator.step(Scan(k * DT, np.full(LIDAR.num_beams, np.nan)), Odometry(k * DT, STANDING, REST))
    assert navigator.finding is None
