import itertools

import numpy as np
import pytest

from robots.bodies.go2 import GO2
from robots.registry import QUADRUPEDS
from tests.robots.gaits import untaught
from train.locomotion import evaluate
from train.locomotion.evaluate import CONTROL, Track, count_falls, grid, real_time_factor, track_grid
from vuca_nav.types import STOP, VelocityCommand


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    return untaught(tmp_path_factory.mktemp("gait"))


class Puppet:
    """Moves at nine tenths of its command, with a jolt of 0.1 m/s to and fro, and falls when told to."""

    fall_after = 10**9
    pushes = 0
    made: list["Puppet"]

    def __init__(self, body, seed, *, vary, floor=None):
        self.seed, self.vary, self.floor = seed, vary, floor
        self.ticks, self.fallen, self.restarts = 0, False, 0
        self.made.append(self)

    def step(self, command):
        self.ticks += 1
        self.fallen = self.ticks % self.fall_after == 0
        jolt = 0.1 if self.ticks % 2 else -0.1
        return 0.9 * command.v_x + jolt, 0.9 * command.v_y, 0.9 * command.w_z

    def push(self, speed):
        assert speed == 0.5
        type(self).pushes += 1

    def restart(self):
        self.restarts += 1


@pytest.fixture
def puppet(monkeypatch):
    monkeypatch.setattr(evaluate, "Track", Puppet)
    monkeypatch.setattr(Puppet, "made", [], raising=False)
    monkeypatch.setattr(Puppet, "pushes", 0)
    return Puppet


@pytest.mark.parametrize("spec", [config.spec for config in QUADRUPEDS.values()], ids=list(QUADRUPEDS))
def test_the_grid_covers_the_range(spec):
    commands = np.array(grid(spec))
    assert commands.shape == (60, 3)
    assert len(set(map(tuple, commands.tolist()))) == 60
    assert commands.min(axis=0).tolist() == [spec.min_v_x, -spec.max_v_y, -spec.max_w_z]
    assert commands.max(axis=0).tolist() == [spec.max_v_x, spec.max_v_y, spec.max_w_z]


def test_errors_over_the_grid_are_those_that_were_made(body, puppet):
    tracking = track_grid(body, push_every=None, seconds=3.0)
    tenth = 0.1 * np.sqrt((np.array(grid(GO2.spec)) ** 2).mean(axis=0))
    assert tracking.mean_error == pytest.approx(tenth)
    assert tracking.rmse == pytest.approx([np.hypot(tenth[0], 0.1), tenth[1], tenth[2]])
    assert (tracking.falls, tracking.commands) == (0, 60)
    assert puppet.pushes == 0
    assert all(track.vary and track.ticks == 180 for track in puppet.made)
    assert len({track.seed for track in puppet.made}) == 60


def test_pushes_and_falls_of_the_grid_are_counted(body, puppet, monkeypatch):
    track_grid(body, push_every=2.0, seconds=6.0)
    assert puppet.pushes == 3 * 60  # after 1, 3 and 5 s
    monkeypatch.setattr(Puppet, "fall_after", 2 * CONTROL)
    tracking = track_grid(body, push_every=None, seconds=3.0)
    assert tracking.falls == 60
    # Of two seconds that count one is walked, the other lain: errors of a tenth and of all of the command.
    whole = np.sqrt((np.array(grid(GO2.spec)) ** 2).mean(axis=0))
    assert tracking.mean_error == pytest.approx(0.55 * whole, abs=1e-3)


def test_falls_are_counted_and_gone_on_after(body, puppet, monkeypatch):
    monkeypatch.setattr(Puppet, "fall_after", 25 * CONTROL)
    assert count_falls(body, 3.0, rough=False) == 6  # at 25 s and 50 s of each minute
    assert [track.restarts for track in puppet.made] == [2, 2, 2]
    assert puppet.pushes == 3 * 12
    assert all(not track.floor.tops and track.floor.slope == 0.0 for track in puppet.made)
    puppet.made.clear()
    count_falls(body, 3.0, rough=True)
    assert [track.floor.slope == evaluate.SLOPE for track in puppet.made] == [True, False, False]
    assert all(max(track.floor.tops) == evaluate.SILL for track in puppet.made)


def walk(track, command, seconds):
    return np.array([track.step(command) for _ in range(round(seconds * CONTROL))])


def test_a_robot_that_learned_nothing_stands(body):
    track = Track(body, 0, vary=False)
    assert not track.fallen
    assert np.abs(walk(track, STOP, 0.5)).mean() < 0.05
    assert track.data.qpos[2] == pytest.approx(GO2.trot.hip_height, abs=0.05)


def test_velocities_are_told_in_the_heading_frame(body):
    track = Track(body, 2, vary=False)  # put down in some direction
    w, x, y, z = track.data.qpos[3:7]
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    assert abs(yaw) > 0.3
    track.data.qvel[:3] += 0.4 * np.cos(yaw), 0.4 * np.sin(yaw), 0.0
    v_x, v_y, _ = track.step(STOP)
    assert v_x == pytest.approx(0.4, abs=0.15)
    assert v_y == pytest.approx(0.0, abs=0.1)


def test_a_push_is_as_strong_as_said(body):
    track = Track(body, 0, vary=False)
    before = track.data.qvel[:6].copy()
    track.push(0.5)
    change = track.data.qvel[:6] - before
    assert np.hypot(*change[:2]) == pytest.approx(0.5)
    assert not change[2:].any()


def test_a_varied_robot_is_another_each_time_and_the_same_for_a_seed(body):
    tracks = [Track(body, seed, vary=True) for seed in (0, 1, 0)]
    delays = [float(track.model.actuator_delay[0]) for track in tracks]
    assert delays[0] == delays[2] != delays[1]
    assert all(0.0 <= delay <= 1.0 / CONTROL for delay in delays)
    masses = [float(track.model.body_subtreemass[0]) for track in tracks]
    assert masses[0] == masses[2] != masses[1]
    command = VelocityCommand(0.4, 0.1, 0.2)
    assert (walk(tracks[0], command, 0.5) == walk(tracks[2], command, 0.5)).all()
    assert Track(body, 0, vary=False).model.actuator_delay == pytest.approx(GO2.latency)


def test_after_a_fall_it_gets_up_again(body):
    track = Track(body, 0, vary=False)
    track.data.qpos[3:7] = (0.0, 1.0, 0.0, 0.0)  # on its back
    walk(track, STOP, 0.2)
    assert track.fallen
    track.restart()
    assert not track.fallen


def test_the_real_time_factor_is_one_over_the_time_taken(body, monkeypatch):
    clock = itertools.count(step=0.5)
    monkeypatch.setattr(evaluate.time, "perf_counter", lambda: next(clock))
    assert real_time_factor(body, 1.0) == pytest.approx(2.0)
