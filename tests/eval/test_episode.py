"""The episode's rules, on a point that slides along a line; the real loop is tested by the command line."""

import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import eval.episode
from eval.episode import Episode, EpisodeConfig, run_episode
from eval.metrics import TIMING_FIELDS
from vuca_nav.errors import BadArgument, BadWorld, UnknownName
from vuca_nav.geometry import between
from vuca_nav.types import BodySpec, LidarSpec, Odometry, Pose2, Scan, VelocityCommand
from worlds.world import Box, Obstacle, World

SPEC = BodySpec("point", np.array([[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0]]), 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0)
BODY = SimpleNamespace(spec=SPEC, lidar=LidarSpec(num_beams=4), height=1.0)
WORLD = World("line", 0, (0.0, -2.0, 20.0, 2.0), (), (), Pose2(1.0, 0.0, 0.0), (4.0, 0.0))


class SlidingPoint:
    """Does exactly what it is told, 30 times a second; hits a wall at ``wall_x``, falls at ``cliff_x``."""

    wall_x = cliff_x = math.inf
    made_with: ClassVar[dict] = {}

    def __init__(self, world, body, seed, *, noise, telemetry, perfect_odometry=False):
        type(self).made_with = {"seed": seed, "noise": noise, "perfect_odometry": perfect_odometry}
        self.world_start = self.true_pose = world.start
        self.ticks = 0
        self.contact = self.contact_name = self.contact_facts = None
        self.fallen = False
        self.clearance = 1.0

    @property
    def time(self):
        return self.ticks / 30.0

    def reset(self):
        self.true_pose = self.start = Pose2(self.world_start.x + 1e-5, *self.world_start[1:])  # it comes to rest
        return self._sense()

    def step(self, command):
        self.ticks += 1
        x = self.true_pose.x + command.v_x / 30.0
        self.true_pose = Pose2(x, self.true_pose.y, self.true_pose.yaw)
        if x >= self.wall_x:
            self.contact, self.contact_name = "wall", "wall_3"
        self.fallen = x >= self.cliff_x
        return self._sense()

    def _sense(self):
        odometry = Odometry(self.time, between(self.start, self.true_pose), SimpleNamespace())  # type: ignore[arg-type]
        return Scan(self.time, np.full(4, np.inf)), odometry


class StraightOn:
    """Believes to be where it started, and drives on."""

    finding = None

    speed = 1.0
    was_given = told = None

    def reset(self, start, goal, prior_map=None):
        self.map_from_base = start
        type(self).was_given, type(self).told = prior_map, (start, goal)

    def step(self, scan, odometry):
        return VelocityCommand(self.speed, 0.0, 0.0)


@pytest.fixture
def simulation(monkeypatch):
    class Point(SlidingPoint):
        pass

    monkeypatch.setattr(eval.episode, "Simulation", Point)
    monkeypatch.setattr(eval.episode, "make_body", lambda name, trust: BODY)
    monkeypatch.setattr(eval.episode, "make_world", lambda name, seed, **kwargs: WORLD)
    monkeypatch.setattr(eval.episode, "build", lambda *_: StraightOn())
    return Point


def config(**changes):
    return EpisodeConfig(world="line", method="dwa-dh", **changes)


def test_success_is_the_true_position_within_0_3_m_of_the_goal(simulation):
    row = run_episode(config()).row()
    assert row["outcome"] == "success"
    # 2.7 m at 1/30 m a step; the estimate, still at the start, plays no part.
    assert row["steps"] in (81, 82)
    assert row["arriving_time"] == row["duration"] == row["steps"] / 30.0
    assert (row["contact"], row["failure"]) == (None, None)
    assert row["path_length"] == pytest.approx(row["steps"] / 30.0, abs=1e-4)
    assert row["spl"] == 1.0
    assert row["ansps"] == pytest.approx(row["path_length"] / 3.0 / row["steps"], rel=1e-4)
    assert row["slam_final_error"] == pytest.approx((row["steps"] - 1) / 30.0, abs=1e-4)
    assert row["odometry_final_error"] == pytest.approx(1e-5)


def test_any_contact_is_a_collision_even_at_the_goal(simulation):
    simulation.wall_x = 3.7 - 1e-9
    row = run_episode(config()).row()
    assert (row["outcome"], row["collided_with"]) == ("collision", "wall")
    assert row["arriving_time"] is None
    assert row["spl"] == 0.0


def test_a_fall(simulation):
    simulation.cliff_x = 2.0
    row = run_episode(config()).row()
    assert (row["outcome"], row["collided_with"]) == ("fall", None)
    assert (row["contact"], row["failure"]["class"]) == (None, "fall")
    assert row["duration"] == pytest.approx(1.0, abs=0.05)


def test_timeout_is_four_shortest_ways_at_full_speed_and_a_minute(simulation, monkeypatch):
    monkeypatch.setattr(StraightOn, "speed", 0.0)
    row = run_episode(config()).row()
    assert row["outcome"] == "timeout"
    assert row["duration"] == pytest.approx(4.0 * 3.0 / 1.0 + 60.0, abs=0.05)
    assert row["ansps"] == pytest.approx(0.0, abs=1e-8)
    assert (row["failure"]["class"], row["failure"]["since"]) == ("stuck", 0.0)
    assert row["failure"]["where"] == pytest.approx([1.0, 0.0], abs=1e-4)


def test_a_robot_that_believes_to_be_elsewhere_is_lost(simulation, monkeypatch):
    monkeypatch.setattr(StraightOn, "speed", -0.02)
    assert run_episode(config()).row()["failure"]["class"] == "lost"


def test_same_seed_same_row_but_for_timing(simulation):
    def row(seed):
        return {k: v for k, v in run_episode(config(seed=seed)).row().items() if k not in TIMING_FIELDS}

    assert row(3) == row(3)
    assert row(3) != row(4)


def test_sensors_have_a_stream_of_their_own_for_each_seed(simulation):
    seeds = set()
    for seed in range(20):
        run_episode(config(seed=seed))
        seeds.add(int(simulation.made_with["seed"].generate_state(1)[0]))
    assert len(seeds) == 20
    assert not seeds & set(range(20))


def test_rows_are_json_without_nan(simulation):
    simulation.clearance = math.inf
    row = run_episode(config(start=(2.0, 0.0, 0.0), goal=(4.0, 0.0))).row()
    assert json.loads(json.dumps(row, allow_nan=False)) == row


def test_start_and_goal_replace_the_worlds(simulation):
    episode = Episode(config(start=(2.0, 1.0, 0.5), goal=(9.0, 1.0)))
    assert episode.world.start == Pose2(2.0, 1.0, 0.5)
    assert episode.world.goal == (9.0, 1.0)


def test_without_ambiguity_odometry_is_true_and_nothing_is_noisy(simulation, monkeypatch):
    asked = []

    def build(method, body, lidar, localisation, telemetry, truth):
        asked.append(localisation)
        return StraightOn()

    monkeypatch.setattr(eval.episode, "build", build)
    run_episode(config())
    assert asked[-1] == "slam"
    assert simulation.made_with["perfect_odometry"] is False
    noisy = simulation.made_with["noise"]
    run_episode(config(without="A"))
    assert asked[-1] == "odometry"
    assert simulation.made_with["perfect_odometry"] is True
    assert simulation.made_with["noise"] != noisy


def test_without_uncertainty_the_stack_is_given_the_map(simulation):
    run_episode(config())
    assert StraightOn.was_given is None
    run_episode(config(without="U"))
    assert StraightOn.was_given is not None
    assert StraightOn.was_given.state(2.0, 0.0) == -1


def test_difficulties_are_checked_and_ordered():
    assert EpisodeConfig(without="AU").without == "UA"
    assert EpisodeConfig(without="AU") == EpisodeConfig(without="UA")
    with pytest.raises(BadArgument, match="unknown difficulty 'X'"):
        EpisodeConfig(without="VX")
    with pytest.raises(BadArgument, match="seed must be 0 or more"):
        EpisodeConfig(seed=-1)


def test_unknown_method_is_named():
    with pytest.raises(UnknownName, match="unknown method 'dwa-hd'; did you mean 'dwa-dh'"):
        Episode(EpisodeConfig(method="dwa-hd"))


def test_the_stack_is_told_the_missions_start_not_where_the_body_came_to_rest(simulation):
    run_episode(config())
    assert StraightOn.told == (WORLD.start, WORLD.goal)


def test_headings_beyond_half_a_turn_are_wrapped(simulation):
    assert Episode(config(start=(2.0, 1.0, 7.0))).world.start.yaw == pytest.approx(7.0 - 2.0 * math.pi)


@pytest.mark.parametrize("number", [math.inf, -math.inf, math.nan])
def test_start_and_goal_are_finite(number):
    for k in range(3):
        start = tuple(number if i == k else 1.0 for i in range(3))
        with pytest.raises(BadArgument, match=r"--start: (-?inf|nan) is not a finite number"):
            EpisodeConfig(start=start)  # type: ignore[arg-type]
    with pytest.raises(BadArgument, match="--goal: "):
        EpisodeConfig(goal=(1.0, number))


def test_a_world_without_a_way_is_no_episode(simulation, monkeypatch):
    """Whoever made it: an endless time limit would never end."""
    wall = Obstacle("wall", Box(3.0, 0.0, 0.2, 4.0, 0.0, 2.0))
    monkeypatch.setattr(eval.episode, "make_world", lambda name, seed, **kwargs: replace(WORLD, obstacles=(wall,)))
    with pytest.raises(BadWorld, match="no way leads from the start"):
        Episode(config())


def test_every_accepted_task_ends():
    """The documented scene with a goal 0.315 m from a wall: a place beside it that leaves 0.05 m stands for it."""
    text = (Path(__file__).parents[2] / "docs" / "scene-format.md").read_text()
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.yaml"
        scene.write_text(text.split("```yaml\n")[1].split("```")[0])
        episode = Episode(EpisodeConfig(world=str(scene), without="V", goal=(5.61, 1.5)))
    assert episode.shortest_path == pytest.approx(4.05, rel=0.01)
    assert episode.timeout == pytest.approx(4.0 * episode.shortest_path / episode.body.spec.max_v_x + 60.0)
