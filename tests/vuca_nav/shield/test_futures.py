"""Futures of moving tracks, against what can be said of them exactly."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, NO_BOXES, NOTHING, ranges_to_boxes, room
from vuca_nav.perception.distance_field import DistanceField, fill_field
from vuca_nav.shield.futures import Futures, FuturesConfig
from vuca_nav.types import STANDING, Pose2

CONFIG = FuturesConfig()
RESOLUTION, REACH = 0.1, 8.0
TRACK = np.array([[1.0, 0.5, 0.6, -0.3, 0.25, 1.0, 1.0]])


def field_of(boxes, pose=STANDING) -> DistanceField:
    angles, field = LIDAR.angles_in_base(), DistanceField.empty(REACH, RESOLUTION)
    ranges = ranges_to_boxes(boxes, pose) if len(boxes) else NOTHING
    fill_field(ranges, np.column_stack([np.cos(angles), np.sin(angles)]), field)
    return field


def draw(tracks, field, config=CONFIG):
    return Futures(16, config).draw(tracks, field).copy()


def test_in_the_first_future_tracks_go_straight_on():
    times = CONFIG.time_step * np.arange(1, round(CONFIG.horizon / CONFIG.time_step) + 1)
    straight = draw(TRACK, field_of(NO_BOXES))[0, 0]
    assert straight == pytest.approx(TRACK[0, :2] + times[:, None] * TRACK[0, 2:4])


def test_they_keep_their_speed_and_turn_as_often_as_is_said():
    config = replace(CONFIG, scenarios=200, turn_rate=0.3)
    futures = draw(TRACK, field_of(NO_BOXES), config)[:, 0]
    steps = np.diff(np.concatenate([np.broadcast_to(TRACK[0, :2], (200, 1, 2)), futures], axis=1), axis=1)
    assert np.hypot(*steps.transpose(2, 0, 1)) == pytest.approx(math.hypot(0.6, 0.3) * config.time_step)
    straight = np.abs(steps - config.time_step * TRACK[0, 2:4]).max(axis=(1, 2)) < 1e-9
    assert straight.mean() == pytest.approx(math.exp(-0.3 * config.horizon), abs=0.02)
    ends = futures[~straight, -1] - TRACK[0, :2]
    assert np.hypot(*ends.T).max() <= math.hypot(0.6, 0.3) * config.horizon + 1e-9


def test_they_do_not_go_through_walls():
    hall = room(5.0, 4.0)  # about (0, 0) to (5, 4), seen from (2.5, 2)
    field = field_of(hall, Pose2(2.5, 2.0, 0.0))
    tracks = np.array([[1.0, 0.5, 1.5, 0.8, 0.25, 1.0, 1.0], [-1.0, -0.5, -0.9, 0.1, 0.3, 1.0, 1.0]])
    futures = draw(tracks, field, replace(CONFIG, turn_rate=0.5))
    for k, radius in enumerate(tracks[:, 4]):
        clearance = np.minimum(2.5 - np.abs(futures[:, k, :, 0]), 2.0 - np.abs(futures[:, k, :, 1]))
        assert clearance.min() > radius - RESOLUTION
    assert (futures[:, 1, -1] != futures[0, 1, -1]).any()  # and where to is not known


def test_the_same_scene_has_the_same_futures():
    field, futures = field_of(room(5.0, 4.0), Pose2(2.5, 2.0, 0.0)), Futures(16)
    first = futures.draw(TRACK, field).copy()
    futures.draw(np.tile(-TRACK, (5, 1)), field)  # another scene between
    assert futures.draw(TRACK, field).tobytes() == first.tobytes()


def test_one_that_never_turns_in_the_open_goes_straight_in_all_futures():
    futures = draw(TRACK, field_of(NO_BOXES), replace(CONFIG, turn_rate=0.0))
    assert (futures == futures[0]).all()


def test_one_without_a_way_out_stands():
    nowhere = DistanceField.empty(REACH, RESOLUTION)
    nowhere.fifths[:] = 0
    nowhere.fifths[85, 90] = 10  # the cell that it stands in is a little freer than all others
    assert (draw(TRACK, nowhere) == TRACK[0, :2]).all()
