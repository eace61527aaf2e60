import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eval.bench import loop, lower_layer
from eval.bench.loop import BENCHMARKS, STAGES, stage_results
from eval.bench.lower_layer import Tape, Tick, Timed, record, replay
from eval.bench.timing import StageClock
from eval.episode import EpisodeConfig
from vuca_nav.policy.base import LocalGoal, LocalPolicy
from vuca_nav.types import STOP, Odometry, Pose2, Scan, Twist2


@pytest.fixture
def work(monkeypatch):
    """Makes a clock that only work moves on."""
    now = 0.0

    def work(seconds: float) -> None:
        nonlocal now
        now += seconds

    monkeypatch.setattr("eval.bench.timing.time.perf_counter", lambda: now)
    return work


class Worker(LocalPolicy):
    """Takes its time, and the other policy's."""

    def __init__(self, work, seconds, other=None):
        self.work, self.seconds, self.other = work, seconds, other

    def reset(self):
        pass

    def command(self, percept, goal):
        self.work(self.seconds)
        return self.other.command(percept, goal) if self.other else STOP


GOAL = LocalGoal((1.0, 0.0), False)
ODOMETRY = Odometry(0.0, Pose2(0.0, 0.0, 0.0), Twist2(0.0, 0.0, 0.0))


def test_inner_calls_are_not_counted_twice(work):
    place = SimpleNamespace(inner=lambda: work(2.0))

    def outer():
        work(1.0)
        place.inner()
        place.inner()
        return "done"

    place.outer = outer
    clock = StageClock()
    with clock.watch("inner", place, "inner"), clock.watch("outer", place, "outer"):
        assert place.outer() == "done"
    assert place.outer is outer
    assert clock.seconds == {"inner": 4.0, "outer": 1.0}


def test_every_stage_exists():
    for stage in STAGES:
        assert callable(getattr(stage["owner"], stage["call"])), stage["name"]


def test_shares_are_of_the_loop_and_of_the_stack():
    seconds = {"physics": 2.0, "policy": 1.0, "shield": 3.0, "local control": 0.0}
    found = {r["name"]: r for r in stage_results(seconds, wall=10.0, steps=1000, loop="ours_loop", stage="ours")}
    assert {name: r["value"] for name, r in found.items()} == {
        "ours_loop_stack": 4000.0, "ours: physics": 2000.0, "ours: policy": 1000.0, "ours: shield": 3000.0,
        "ours: rest": 4000.0,
    }  # fmt: skip
    assert found["ours: shield"]["meaning"] == "a tick of 1/30 s, 30.0% of the loop, 75.0% of the stack"
    assert found["ours: rest"]["meaning"] == "a tick of 1/30 s, 40.0% of the loop"
    assert "40.0% of the loop" in found["ours_loop_stack"]["meaning"]


def test_the_times_of_perception_policy_and_shield_are_apart(work):
    perception: Any = SimpleNamespace(reset=lambda: None, update=lambda scan, odometry: work(0.5))
    here, standing = Tick(Scan(0.0, np.full(4, 2.0)), ODOMETRY, GOAL), Tick(Scan(0.1, np.full(4, 2.0)), ODOMETRY, None)
    policy = Timed(Worker(work, 1.5))
    shield = Worker(work, 6.0, policy)
    tapes = [[here, standing], [here]]
    assert replay(tapes, perception, policy, shield).tolist() == [[0.5, 1.5, 6.0]] * 2  # standing does not count
    assert replay(tapes, perception, policy).tolist() == [[0.5, 1.5, 0.0]] * 2


def test_a_tape_keeps_what_is_asked_and_passes_it_on(work):
    tape, percept = Tape(Worker(work, 0.0)), cast(Any, None)
    assert tape.command(percept, GOAL) is STOP
    tape.command(percept, None)
    assert tape.goals == [GOAL, None]


def test_an_episodes_tape_has_every_tick():
    near = EpisodeConfig(world="dynamic", movers=0, method="fusion", start=(3.0, 3.0, 0.0), goal=(3.6, 3.0), seed=3)
    first, second = record(near, 1.0)[:2]
    assert first[0].scan.stamp == second[0].scan.stamp == 0.0
    assert any(tick.goal is not None for tick in first)
    assert np.diff([tick.scan.stamp for tick in first]) == pytest.approx(1.0 / 30.0)
    assert len({id(tick.scan.ranges) for tick in first}) == len(first)


def test_the_lower_layer_is_measured_against_its_goals(monkeypatch):
    near = EpisodeConfig(world="dynamic", movers=3, start=(3.0, 3.0, 0.0), goal=(3.6, 3.0))
    monkeypatch.setattr(lower_layer, "CROWD", near)
    monkeypatch.setattr(lower_layer, "CROWD_TIME", 0.1)
    monkeypatch.setattr(lower_layer, "CALLS", 2)
    results = {result["name"]: result for result in lower_layer.lower_layer()}
    assert list(results) == [
        "perception_step_mean", "perception_step_p99", "fusion_step_mean", "fusion_step_p99", "fusion-plus_step_mean",
        "fusion-plus_step_p99", "shield_step_mean", "shield_step_p99", "shield_step_max", "v_h_of_200",
    ]  # fmt: skip
    text = (Path(__file__).parents[3] / "docs" / "performance.md").read_text()
    assert all(f"`{name}`" in text for name in results)
    for name, limit in (("fusion_step_mean", 0.3), ("v_h_of_200", 2.0), ("shield_step_p99", 100.0 / 3.0)):
        value, meaning = results[name]["value"], results[name]["meaning"]
        assert value > 0.0
        assert float(meaning.split()[0]) == pytest.approx(value / limit, abs=1e-3)


def test_each_benchmark_can_be_sent_to_its_process():
    for benchmark in BENCHMARKS:
        pickle.dumps(benchmark["measure"])  # raises what the pool would raise
    assert loop.OURS in BENCHMARKS[2]["name"]
