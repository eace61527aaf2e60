import pickle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eval.bench import loop, lower_layer
from eval.bench.loop import BENCHMARKS, STAGES, stage_results
from eval.bench.lower_layer import Tape, Tick, Timed, record, replay
from eval.bench.timing import StageClock
from eval.episode import EpisodeConfig
from vuca_nav.policy.base import LocalObservation, LocalPolicy
from vuca_nav.types import STOP, Scan, Twist2


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

    def __init__(self, work, look, command, other=None):
        self.work, self.times, self.other = work, (look, command), other

    def reset(self):
        pass

    def look(self, observation):
        self.work(self.times[0])
        if self.other:
            self.other.look(observation)

    def command(self, observation):
        self.work(self.times[1])
        return self.other.command(observation) if self.other else STOP


def observation(stamp):
    scan = Scan(stamp, np.full(4, 2.0))
    return LocalObservation(scan, (1.0, 0.0), False, Twist2(0.0, 0.0, 0.0))


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


def test_a_shields_time_is_without_the_policys(work):
    here, there = observation(0.0), observation(0.1)
    tapes = [[Tick(here, here), Tick(there, None)], [Tick(here, here)]]
    policy = Timed(Worker(work, 0.5, 1.0))
    shield = Worker(work, 2.0, 4.0, policy)
    assert replay(tapes, policy, shield).tolist() == [[1.5, 6.0]] * 2  # where it was not asked does not count
    assert replay(tapes, policy).tolist() == [[1.5, 0.0]] * 2


def test_a_tape_keeps_what_is_asked_and_passes_it_on(work):
    tape = Tape(Worker(work, 0.0, 0.0))
    one, two, other = observation(0.0), observation(0.1), observation(0.2)
    tape.look(one)
    assert tape.command(other) is STOP
    tape.look(two)
    tape.stopped()
    assert tape.ticks == [Tick(one, other), Tick(two, None)]


def test_an_episodes_tape_has_every_tick():
    near = EpisodeConfig(world="dynamic", movers=0, method="fusion", start=(3.0, 3.0, 0.0), goal=(3.6, 3.0), seed=3)
    first, second = record(near, 1.0)[:2]
    assert first[0].seen.scan.stamp == second[0].seen.scan.stamp == 0.0
    assert any(tick.asked is not None for tick in first)
    assert np.diff([tick.seen.scan.stamp for tick in first]) == pytest.approx(1.0 / 30.0)


def test_the_lower_layer_is_measured_against_its_goals(monkeypatch):
    near = EpisodeConfig(world="dynamic", movers=3, start=(3.0, 3.0, 0.0), goal=(3.6, 3.0))
    monkeypatch.setattr(lower_layer, "CROWD", near)
    monkeypatch.setattr(lower_layer, "CROWD_TIME", 0.1)
    monkeypatch.setattr(lower_layer, "CALLS", 2)
    results = {result["name"]: result for result in lower_layer.lower_layer()}
    assert list(results) == [
        "fusion_step_mean", "fusion_step_p99", "fusion-plus_step_mean", "fusion-plus_step_p99", "shield_step_mean",
        "shield_step_p99", "shield_step_max", "v_h_of_200",
    ]  # fmt: skip
    text = (Path(__file__).parents[2] / "docs" / "performance.md").read_text()
    assert all(f"`{name}`" in text for name in results)
    for name, limit in (("fusion_step_mean", 0.3), ("v_h_of_200", 2.0), ("shield_step_p99", 100.0 / 3.0)):
        value, meaning = results[name]["value"], results[name]["meaning"]
        assert value > 0.0
        assert float(meaning.split()[0]) == pytest.approx(value / limit, abs=1e-3)


def test_each_benchmark_can_be_sent_to_its_process():
    for benchmark in BENCHMARKS:
        pickle.dumps(benchmark["measure"])  # raises what the pool would raise
    assert loop.OURS in BENCHMARKS[2]["name"]
