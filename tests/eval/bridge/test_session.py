import json
from contextlib import nullcontext
from dataclasses import replace
from typing import Any, cast

import pytest

from eval.bridge.real_time import TimedDrive
from eval.bridge.remote_stack import Lockstep, RealTime, RemoteStack, StackSilent
from eval.bridge.robot_wire import RobotWire
from eval.bridge.session import BridgedEpisode, drive_all, wait_for_stack
from eval.episode import Episode, EpisodeConfig
from eval.metrics import TIMING_FIELDS
from robots.registry import make_body
from tests.eval.bridge.other_side import OtherSide
from tests.vuca_nav.deploy.loopback import Network
from vuca_nav.telemetry.interface import Telemetry

SCENE = """
format: vuca-scene-1
name: hall
seed: 0
bounds: {x_min: 0.0, y_min: 0.0, x_max: 8.0, y_max: 6.0}
start: {x: 1.5, y: 1.5, yaw: 0.3}
goal: {x: 5.0, y: 3.0}
obstacles:
- {kind: wall, shape: {type: box, x: 4.0, y: 0.1, length: 8.0, width: 0.2, yaw: 0.0, height: 2.0}, outer: true}
- {kind: wall, shape: {type: box, x: 4.0, y: 5.9, length: 8.0, width: 0.2, yaw: 0.0, height: 2.0}, outer: true}
- {kind: pillar, shape: {type: cylinder, x: 3.0, y: 4.0, radius: 0.3, height: 2.0}}
movers:
- kind: cylinder
  radius: 0.3
  start: {x: 6.5, y: 1.5, yaw: 0.0}
  motion: {type: random_walk, speed: 0.2, seed: 7}
  parts:
  - shape: {type: cylinder, x: 0.0, y: 0.0, radius: 0.3, height: 1.2}
"""


@pytest.fixture
def short(tmp_path):
    scene = tmp_path / "hall.yaml"
    scene.write_text(SCENE)
    return EpisodeConfig(world=str(scene), method="dwa-dh")


def connected(config):
    """The simulation's side, with the stack of the configuration on the other."""
    network, body = Network(), make_body(config.robot)
    _, stack = Episode(config).build(Telemetry())
    other = OtherSide(network, stack=stack)
    return other, RemoteStack(RobotWire(network.join(), body), Lockstep(10.0))


def results(row):
    return {name: value for name, value in row.items() if name not in (*TIMING_FIELDS, "method")}


@pytest.mark.parametrize("robot", ["tiago", "go2"])
def test_a_mission_over_messages_is_the_same_row_to_the_bit_as_without(short, robot):
    config = replace(short, robot=robot, seed=2)
    _, stack = connected(config)
    row = BridgedEpisode(replace(config, method="somebody"), stack).run().row()
    alone = Episode(config).run().row()
    assert row["outcome"] == "success"
    assert row["steps"] > 30
    assert results(row) == results(alone)
    assert row["method"] == "somebody"


def test_missions_are_kept_as_those_of_an_evaluation_and_go_on(short, tmp_path):
    configs = [replace(short, method="nav2", seed=seed) for seed in (3, 4)]
    other, stack = connected(short)
    drive_all(configs, lambda: nullcontext(stack), tmp_path / "out", "vuca bridge", {"lockstep": True})
    rows = [json.loads(line) for line in (tmp_path / "out" / "episodes.jsonl").read_text().splitlines()]
    assert [(row["seed"], row["method"], row["outcome"]) for row in rows] == [
        (3, "nav2", "success"),
        (4, "nav2", "success"),
    ]
    heard = len(other.heard)
    evaluation = drive_all(configs, lambda: nullcontext(stack), tmp_path / "out", "vuca bridge", {"lockstep": True})
    assert len(other.heard) == heard
    assert len(evaluation.rows) == 2


def test_a_stack_that_falls_silent_ends_the_command_and_keeps_the_rows(short, tmp_path):
    configs = [replace(short, method="nav2", seed=seed) for seed in (3, 4)]
    other, stack = connected(short)
    stack.pace = Lockstep(0.2)
    assert other.stack is not None
    decide = other.stack.step

    def step(scan, odometry):
        if other.began > 2_000_000_000:  # of the second mission
            other.stack, other.decide = None, None
            raise StackSilent("gone")
        return decide(scan, odometry)

    other.stack.step = step
    with pytest.raises(StackSilent):
        drive_all(configs, lambda: nullcontext(stack), tmp_path / "out", "vuca bridge", {"lockstep": True})
    assert len((tmp_path / "out" / "episodes.jsonl").read_text().splitlines()) == 1


def test_nobody_there_is_said_in_one_line():
    wire = RobotWire(Network().join(), make_body("tiago"))
    with pytest.raises(StackSilent, match=r"nobody subscribes to scan, .*nobody publishes cmd_vel as TwistStamped"):
        wait_for_stack(wire, 0.1)


def test_a_timed_mission_keeps_latencies_and_periods_of_its_commands(short, tmp_path):
    class Idle:
        def take(self):
            return [0.03, 0.04]

    _, stack = connected(short)
    pace = stack.pace = RealTime(20.0)
    drive: Any = TimedDrive(pace, cast(Any, Idle()), tmp_path / "timing.jsonl")
    row = drive(short, stack)
    (line,) = [json.loads(text) for text in (tmp_path / "timing.jsonl").read_text().splitlines()]
    assert (line["seed"], line["idle"]) == (short.seed, [0.03, 0.04])
    assert len(line["latencies"]) == row["steps"]
    assert len(line["periods"]) == row["steps"] - 1
    assert all(0.0 < latency < 60.0 for latency in line["latencies"])
