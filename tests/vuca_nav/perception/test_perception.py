"""What ``Perception`` makes of scans and odometry: validity, memory, moving tracks, the levelled scan."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vuca_nav.rooms import (
    LIDAR,
    NO_BOXES,
    NOTHING,
    PERCEPTION,
    Sensors,
    percept_of,
    ranges_to_boxes,
    ranges_to_discs,
    room,
)
from vuca_nav.errors import BadArgument
from vuca_nav.geometry import compose, transform_points
from vuca_nav.perception.perception import Perception, PerceptionConfig
from vuca_nav.perception.tracks import V_X, V_Y, X, Y
from vuca_nav.types import STANDING, LidarSpec, Odometry, Pose2, Scan, Twist2

DT = 1.0 / LIDAR.rate
HERE = Pose2(4.0, 2.6, 0.0)
ONE_BEAM = LidarSpec(num_beams=1)


def crossing(time: float, speed: float = 0.8) -> np.ndarray:
    """A hall, and a pillar of 0.4 m that crosses it at x = 6."""
    y = 1.0 + speed * time
    return np.vstack([room(30.0, 10.0), [[5.8, y - 0.2, 6.2, y + 0.2]]])


def watch(ticks: int, config: PerceptionConfig = PERCEPTION, speed: float = 0.8):
    """Sensors that have seen so much of ``crossing``, and the last percept."""
    sensors = Sensors(config=config)
    for k in range(ticks - 1):
        sensors.see(ranges_to_boxes(crossing(k * DT, speed), HERE))
    return sensors, sensors.see(ranges_to_boxes(crossing((ticks - 1) * DT, speed), HERE))


def test_a_percept_holds_what_the_sensors_said():
    perception, ranges = Perception(LIDAR), ranges_to_boxes(room(8.0, 6.0), Pose2(2.0, 3.0, 0.0))
    scan = Scan(7.0, ranges)
    percept = perception.update(scan, Odometry(7.0, Pose2(5.0, 1.0, 2.0), Twist2(0.3, 0.1, 0.2)))
    assert percept.scan is scan
    assert percept.stamp == 7.0
    assert percept.odom_from_base == (5.0, 1.0, 2.0)
    assert percept.twist == (0.3, 0.1, 0.2)
    assert percept.is_valid
    assert not percept.is_blind
    np.testing.assert_array_equal(percept.level.ranges, ranges)
    angles = LIDAR.angles_in_base()
    np.testing.assert_array_equal(percept.level.beams, np.column_stack([np.cos(angles), np.sin(angles)]))


def test_motion_is_the_displacement_in_the_base_frame_of_the_last_tick():
    sensors, motions = Sensors(), [Pose2(9.0, 9.0, 1.0), Pose2(0.03, 0.0, 0.02), Pose2(-0.01, 0.02, -0.5), STANDING]
    found = [sensors.see(NOTHING, motion).motion for motion in motions]
    assert found[0] == STANDING  # where the odometry begins does not matter
    for motion, seen in zip(motions[1:], found[1:]):
        assert seen == pytest.approx(motion, abs=1e-12)
    sensors.perception.reset()
    assert sensors.see(NOTHING, Pose2(1.0, 0.0, 0.0)).motion == STANDING


@pytest.mark.parametrize(
    ("ranges", "twist", "motion", "valid"),
    [
        (np.where(np.arange(360) < 180, np.nan, 3.0), (0.0, 0.0, 0.0), STANDING, True),  # exactly half
        (np.where(np.arange(360) < 181, np.nan, 3.0), (0.0, 0.0, 0.0), STANDING, False),
        (np.full(360, np.nan), (0.0, 0.0, 0.0), STANDING, False),
        (np.full(360, np.inf), (0.0, 0.0, 0.0), STANDING, True),
        (np.full(360, 3.0), (0.0, 0.0, math.nan), STANDING, False),
        (np.full(360, 3.0), (math.inf, 0.0, 0.0), STANDING, False),
        (np.full(360, 3.0), (0.0, 0.0, 0.0), Pose2(math.nan, 0.0, 0.0), False),
        (np.full(360, 3.0), (0.0, 0.0, 0.0), Pose2(0.0, math.inf, 0.0), False),
        (np.full(360, 3.0), (0.0, 0.0, 0.0), Pose2(0.0, 0.0, math.nan), False),
    ],
)
def test_what_is_valid(ranges, twist, motion, valid):
    perception = Perception(LIDAR)
    perception.update(Scan(0.0, np.full(360, 3.0)), Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0)))
    assert perception.update(Scan(DT, ranges), Odometry(DT, motion, Twist2(*twist))).is_valid == valid


def test_a_scan_without_any_return_is_blind_and_valid():
    few = NOTHING.copy()
    few[7] = 11.0
    for ranges, blind in ((NOTHING, True), (np.full(360, [math.inf, math.nan] * 180), True), (few, False)):
        percept = percept_of(ranges)
        assert percept.is_valid
        assert percept.is_blind == blind
        assert len(percept.tracks) == 0


@pytest.mark.parametrize("speed", [0.2, 0.8])  # the factory's slowest and fastest
def test_a_mover_is_told_and_a_block_is_not(speed):
    sensors = Sensors()
    percept = sensors.see(ranges_to_boxes(crossing(0.0), HERE))
    for k in range(1, round(1.6 / speed / DT)):
        boxes = np.vstack([crossing(k * DT, speed), [[3.0, 4.5, 3.3, 4.8]]])
        percept = sensors.see(ranges_to_boxes(boxes, HERE))
    (mover,) = percept.moving  # not the block that stands there
    assert mover[:2] == pytest.approx((2.0, 1.0 + 1.6 - 2.6), abs=0.12)
    assert 0.1 <= mover[2] <= 0.3
    assert len(percept.tracks) == 2


def test_a_mover_that_comes_back_past_where_it_was_first_seen_still_moves():
    sensors, speeds = Sensors(), []
    for k in range(round(5.0 / DT)):
        way = 0.8 * k * DT
        y = 3.5 + way if way < 1.6 else 5.1 - (way - 1.6)  # up, and back again: past 3.5 after 4 s
        boxes = np.vstack([room(30.0, 10.0), [[5.8, y - 0.2, 6.2, y + 0.2]]])
        percept = sensors.see(ranges_to_boxes(boxes, Pose2(4.0, 3.5, 0.0)))
        if k * DT > 2.7:
            assert len(percept.moving) == 1
            (track,) = percept.tracks
            speeds.append(np.hypot(track[V_X], track[V_Y]))
    assert min(speeds) > 0.6


@pytest.mark.parametrize("seed", range(3))
def test_posts_do_not_move_while_odometry_overstates_a_turn(seed):
    """By 2%, a gyro's scale: at 1 rad/s what stands 6 m off seems to go at 0.12 m/s."""
    rng = np.random.default_rng(seed)
    angles, away = np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False), rng.uniform(4.0, 7.5, 14)
    posts = [(a * math.cos(b), a * math.sin(b)) for a, b in zip(away, angles)]
    boxes = np.array([(x - 0.15, y - 0.15, x + 0.15, y + 0.15) for x, y in posts])
    sensors, pose, seen = Sensors(), STANDING, 0
    for k in range(round(6.0 / DT)):
        x = 1.5 - 0.6 * k * DT  # one does move
        scene = np.vstack([boxes, [[x - 0.2, 1.3, x + 0.2, 1.7]]])
        percept = sensors.see(ranges_to_boxes(scene, pose), Pose2(0.0, 0.0, 1.02 * DT), Twist2(0.0, 0.0, 1.0))
        movers = transform_points(pose, percept.moving[:, :2])
        assert (np.hypot(movers[:, 0] - x, movers[:, 1] - 1.5) < 0.3).all()
        seen += len(movers)
        pose = compose(pose, Pose2(0.0, 0.0, DT))
    assert seen > 0.7 * 6.0 / DT


def test_which_returns_are_a_movers():
    _, percept = watch(60)
    (mover,) = percept.moving
    ends = percept.level.ranges[:, None] * percept.level.beams
    with np.errstate(invalid="ignore"):
        own = np.hypot(*(ends - mover[:2]).T) < mover[2] + PERCEPTION.own_returns
    np.testing.assert_array_equal(percept.level.is_mover, own)
    assert 5 < own.sum() < 30
    # All of the pillar's near side, and nothing of the hall.
    y = 1.0 + 0.8 * 59 * DT - HERE.y
    pillar = (np.abs(ends[:, 0] - 1.8) < 1e-6) & (np.abs(ends[:, 1] - y) < 0.2)
    assert pillar.sum() > 5
    assert own[pillar].all()


def test_without_tracks_there_is_no_mover():
    _, percept = watch(60, PerceptionConfig(tracks=False))
    assert percept.is_valid
    assert len(percept.tracks) == len(percept.moving) == 0
    assert not percept.level.is_mover.any()


@pytest.mark.parametrize(
    "lost",
    [
        {"ranges": np.full(360, np.nan)},
        {"motion": Pose2(math.nan, 0.0, 0.0)},
        {"twist": Twist2(math.nan, 0.0, 0.0)},
    ],
)
def test_while_the_sensors_are_broken_nothing_is_known_and_all_is_forgotten(lost):
    sensors, percept = watch(60)
    assert len(percept.moving) == 1
    whole = ranges_to_boxes(crossing(2.0), HERE)
    percept = sensors.perception.update(
        Scan(60 * DT, lost.get("ranges", whole)),
        Odometry(60 * DT, lost.get("motion", STANDING), lost.get("twist", Twist2(0.0, 0.0, 0.0))),
    )
    assert not percept.is_valid
    assert len(percept.tracks) == len(percept.moving) == 0
    assert not percept.level.is_mover.any()
    tick = 61
    while not percept.is_valid:  # a pose that is not finite breaks the motion to the next one, too
        percept = sensors.perception.update(
            Scan(tick * DT, whole), Odometry(tick * DT, STANDING, Twist2(0.0, 0.0, 0.0))
        )
        tick += 1
    assert tick <= 63
    assert len(percept.moving) == 0  # tracks begin anew
    assert (percept.history.past(np.arange(percept.history.depth)) == whole).all()


def test_a_motion_that_was_not_finite_does_not_displace_the_tracks():
    sensors = Sensors()
    perception = sensors.perception
    percept = None
    for k in range(60):
        odom_from_base = Pose2(math.nan, 0.0, 0.0) if k == 10 else STANDING
        ranges = ranges_to_boxes(crossing(k * DT), HERE)
        percept = perception.update(Scan(k * DT, ranges), Odometry(k * DT, odom_from_base, Twist2(0.0, 0.0, 0.0)))
    assert percept is not None
    (track,) = percept.tracks
    assert track[[X, Y]] == pytest.approx((2.0, 1.0 + 0.8 * 59 * DT - 2.6), abs=0.12)


def test_after_a_gap_in_time_tracks_and_past_scans_are_forgotten():
    sensors, fastest = Sensors(), 0.0
    percept = None
    for k in [*range(45), *range(60, 72)]:  # half a second is lost
        if k == 60:
            sensors.skip(15)
        percept = sensors.see(ranges_to_boxes(crossing(k * DT, 0.64), HERE))
        fastest = max(fastest, np.hypot(*percept.tracks[:, [V_X, V_Y]].T).max(initial=0.0))
        if k == 60:
            past = percept.history.past(np.arange(percept.history.depth))
            assert (past == percept.scan.ranges).all()
            assert len(percept.moving) == 0
    assert fastest < 1.0  # it goes at 0.64


@pytest.mark.parametrize(("lost", "forgotten"), [(0, False), (1, False), (2, True), (9, True)])
def test_a_single_lost_scan_is_no_gap(lost, forgotten):
    sensors, percept = watch(60)
    assert len(percept.moving) == 1
    sensors.skip(lost)
    percept = sensors.see(ranges_to_boxes(crossing((60 + lost) * DT), HERE))
    assert (len(percept.moving) == 0) == forgotten


def test_a_stamp_that_goes_back_is_a_gap():
    sensors, _ = watch(60)
    sensors.skip(-40)
    assert len(sensors.see(ranges_to_boxes(crossing(2.0), HERE)).moving) == 0


def test_a_new_mission_repeats_the_first():
    sensors = Sensors()

    def mission() -> list[np.ndarray]:
        sensors.perception.reset()
        return [sensors.see(ranges_to_boxes(crossing(k * DT), HERE)).tracks.copy() for k in range(40)]

    first, second = mission(), mission()
    assert len(first[-1]) == 1
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_history_holds_the_scans_of_the_last_ticks():
    sensors = Sensors(config=PerceptionConfig(memory=0.2))
    scans = [np.full(360, 1.0 + 0.01 * k) for k in range(20)]
    for k, ranges in enumerate(scans):
        history = sensors.see(ranges).history
        assert history.depth == 7  # 0.2 s of 30 Hz, and now
        ages = np.array([0, 1, 3, 6])
        expected = [scans[max(k - age, 0)] for age in ages]  # the first stands for what was before it
        np.testing.assert_array_equal(history.past(ages), expected)


def test_the_scan_that_was_handed_in_may_be_written_over():
    sensors, ranges = Sensors(), np.full(360, 2.0)
    sensors.see(ranges)
    ranges[:] = 5.0
    history = sensors.see(ranges).history
    np.testing.assert_array_equal(history.past(np.array([1])), np.full((1, 360), 2.0))


# -- the levelled scan -------------------------------------------------------------------------------------------------


def leaning(roll: float, pitch: float) -> tuple[float, float, float]:
    return (-math.sin(pitch), math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch))


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
@settings(max_examples=25, deadline=None)
def test_a_leaning_body_sees_walls_where_they_are(roll, pitch):
    # Walls of any height 1 m ahead and behind, 0.8 m left and right; what is above or below the band is left out.
    angles = LIDAR.angles_in_base()
    x = np.cos(angles) * math.cos(pitch) + np.sin(angles) * math.sin(roll) * math.sin(pitch)
    y = np.sin(angles) * math.cos(roll)
    ranges = np.minimum(1.0 / np.maximum(abs(x), 1e-9), 0.8 / np.maximum(abs(y), 1e-9))
    level = percept_of(ranges, up=leaning(roll, pitch)).level
    mapped = np.isfinite(level.ranges)
    ends = level.ranges[mapped, None] * level.beams[mapped]
    assert len(ends) > 50
    assert np.maximum(abs(ends[:, 0]), abs(ends[:, 1]) / 0.8) == pytest.approx(1.0)
    np.testing.assert_allclose(np.hypot(*level.beams.T), 1.0)


def test_neither_the_floor_nor_what_is_looked_over_is_level():
    """A lidar at 0.37 m in an empty hall, 5 degrees nose down: ahead it meets the floor at 4.2 m."""
    lidar, lean = LidarSpec(height=0.37), math.radians(5.0)
    rise = -np.sin(lean) * np.cos(lidar.angles_in_base())
    ranges = np.full(360, 5.0)
    floor = rise < -0.37 / 5.0
    ranges[floor] = -0.37 / rise[floor]
    level = percept_of(ranges, lidar, leaning(0.0, lean)).level
    ends = 5.0 * rise
    np.testing.assert_array_equal(np.isnan(level.ranges), floor | (ends < -0.7 * 0.37) | (ends > 0.25))
    assert floor.any()
    assert (ends > 0.25).any()
    np.testing.assert_allclose(level.ranges[np.isfinite(level.ranges)], 5.0, atol=0.02)


def test_an_upright_scan_is_itself_after_a_leaning_one():
    sensors, ranges = Sensors(), np.full(360, 3.0)
    sensors.see(ranges, up=leaning(0.3, 0.2))
    level = sensors.see(ranges).level
    np.testing.assert_array_equal(level.ranges, ranges)
    angles = LIDAR.angles_in_base()
    np.testing.assert_array_equal(level.beams, np.column_stack([np.cos(angles), np.sin(angles)]))


@pytest.mark.parametrize("roll", [0.0, 0.6])
def test_tracks_of_a_leaning_body_are_over_ground(roll):
    """A pillar at x = 3 m that moves by 0.8 m/s, seen by a body that leans to the side."""
    angles = LIDAR.angles_in_base()
    # What a beam meets lies, seen from above, at cos(roll) times its y.
    directions = np.arctan2(np.sin(angles) * math.cos(roll), np.cos(angles))
    shares = np.hypot(np.sin(angles) * math.cos(roll), np.cos(angles))
    sensors, tracks = Sensors(), np.empty((0, 7))
    for k in range(40):
        pillar = [(3.0, 1.0 + 0.8 * k * DT, 0.3)]
        beams = [Pose2(0.0, 0.0, direction + math.pi) for direction in directions]  # the only beam looks backwards
        ground = np.array([ranges_to_discs(pillar, NO_BOXES, beam, ONE_BEAM)[0] for beam in beams])
        tracks = sensors.see(ground / shares, up=leaning(roll, 0.0)).tracks
    (track,) = tracks
    assert track[[X, Y]] == pytest.approx((3.0, 1.0 + 0.8 * 39 * DT), abs=0.08)
    assert track[[V_X, V_Y]] == pytest.approx((0.0, 0.8), abs=0.1)


@pytest.mark.parametrize(
    "bad",
    [
        {"sight": 0.0}, {"spacing": 0.0}, {"own_returns": -1.0}, {"field_reach": math.nan}, {"field_resolution": 0.0},
        {"memory": -0.1}, {"moving_speed": -0.1}, {"certainty": math.nan},
    ],
)  # fmt: skip
def test_a_bad_configuration_is_refused(bad):
    with pytest.raises(BadArgument):
        PerceptionConfig(**bad)


@pytest.mark.parametrize("beams", [1, 180, 359, 720])
def test_a_scan_of_another_size_is_refused(beams):
    with pytest.raises(BadArgument, match=rf"shape \({beams},\), the lidar {LIDAR.num_beams} beams"):
        Perception(LIDAR).update(Scan(0.0, np.full(beams, 2.0)), Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0)))


def test_a_vertical_that_is_not_finite_is_not_valid():
    assert not percept_of(np.full(LIDAR.num_beams, 2.0), up=(math.nan, 0.0, 1.0)).is_valid


def test_a_scan_in_single_precision_is_taken_in_double():
    odometry = Odometry(0.0, STANDING, Twist2(0.0, 0.0, 0.0))
    single: Any = np.full(LIDAR.num_beams, 2.5, np.float32)
    percept = Perception(LIDAR).update(Scan(0.0, single), odometry)
    assert percept.scan.ranges.dtype == np.float64
    np.testing.assert_array_equal(percept.level.ranges, 2.5)
