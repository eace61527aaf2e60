import math
from dataclasses import replace

import numpy as np
import pytest

from train.analysis.episodes import Evaluation
from train.analysis.situations import (
    DEAD_END,
    DEFINITIONS,
    KNOWN_MOVER,
    NEWS,
    OPEN_FLOOR,
    OTHER,
    PRECEDENCE,
    SITUATIONS,
    SUDDEN_MOVER,
    TIGHT_PASSAGE,
    ArenaSituations,
    Sight,
    Threats,
    follow_threats,
    label_situations,
)
from train.arena.config import ArenaConfig, Imperfections
from train.arena.rows import Rows
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.track_features import time_to_meeting
from worlds.motion.mover_columns import RADIUS, V_X, V_Y, X, Y

NUM_BEAMS, BODY = 180, 0.27
"""A disc of TIAGo's size."""
ANGLES = -math.pi + np.arange(NUM_BEAMS) * (2.0 * math.pi / NUM_BEAMS)
BEAMS = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
ROW = np.zeros(1, np.int64)
OUTLINE = np.full((1, NUM_BEAMS), BODY)


def walled(ahead=math.inf, behind=math.inf, left=math.inf, right=math.inf, heading=0.0):
    """Ranges from within a box whose walls are so far off, of a body that is turned to ``heading`` in it."""
    cos, sin = np.cos(ANGLES + heading), np.sin(ANGLES + heading)
    with np.errstate(divide="ignore"):
        along = np.where(cos > 1e-9, ahead / cos, np.where(cos < -1e-9, behind / -cos, math.inf))
        aside = np.where(sin > 1e-9, left / sin, np.where(sin < -1e-9, right / -sin, math.inf))
    return np.minimum(along, aside)[None]


def label(standing, sudden=False, threatened=False, gap=math.inf):
    out = np.full(1, -1)
    size = np.full(1, BODY)
    label_situations(
        ROW, BEAMS, Sight(standing, OUTLINE), size, size,
        Threats(np.zeros((1, 1)), np.zeros((1, 1)), np.array([sudden]), np.array([threatened]), np.array([gap])), out,
    )  # fmt: skip
    return int(out[0])


def test_every_situation_has_a_definition_and_a_rank():
    assert set(DEFINITIONS) == set(SITUATIONS)
    assert sorted(PRECEDENCE) == list(range(len(SITUATIONS)))


def test_an_open_hall():
    hall = walled(5.0, 5.0, 5.0, 5.0)
    assert label(hall) == OPEN_FLOOR
    assert label(walled()) == OPEN_FLOOR
    assert label(hall, gap=1.49) == OTHER
    assert label(hall, gap=1.51) == OPEN_FLOOR
    assert label(walled(left=1.5 + BODY - 0.01)) == OTHER
    assert label(walled(left=1.5 + BODY + 0.01)) == OPEN_FLOOR


@pytest.mark.parametrize("heading", [0.0, 0.4, -0.4, math.pi])
def test_a_corridor_one_metre_wide(heading):
    assert label(walled(left=0.5, right=0.5, heading=heading)) == TIGHT_PASSAGE
    assert label(walled(left=0.3, right=0.7, heading=heading)) == TIGHT_PASSAGE


def test_what_is_no_passage():
    assert label(walled(left=0.5)) == OTHER
    assert label(walled(left=0.9, right=0.9)) == OTHER  # 1.26 m of room
    assert label(walled(left=0.86, right=0.86)) == TIGHT_PASSAGE  # 1.18 m
    assert label(walled(left=0.5, right=0.5, heading=math.pi / 2)) == OTHER  # crosswise in it


@pytest.mark.parametrize("width", [1.0, 1.8, 2.9])
def test_a_blind_alley(width):
    side = width / 2.0

    def alley(depth, heading=0.0):
        return label(walled(ahead=depth, left=side, right=side, heading=heading))

    assert alley(2.0) == DEAD_END
    assert alley(2.0, 0.3) == DEAD_END
    assert alley(2.8 + BODY) == DEAD_END  # to a corner it is a little farther
    assert alley(3.0 + BODY + 0.02) == label(walled(left=side, right=side)) != DEAD_END
    assert alley(2.0, math.pi) != DEAD_END  # the way out is ahead
    # No way out at all, and a way on to the left: neither is a dead end.
    assert label(walled(2.0, 2.0, side, side)) != DEAD_END
    assert label(walled(ahead=2.0, right=side)) != DEAD_END


def test_a_gap_that_the_body_fits_through_is_a_way():  # beams at its sides are 7 cm apart
    standing = walled(ahead=2.0, left=0.9, right=0.9)
    for width, expected in ((0.4, DEAD_END), (0.7, OTHER)):
        gap = np.abs(np.tan(ANGLES) * 2.0) < width / 2.0
        opened = np.where(gap & (np.abs(ANGLES) < 1.0), math.inf, standing[0])[None]
        assert label(opened) == expected


def test_what_moves_comes_before_what_stands():
    alley = walled(ahead=2.0, left=0.5, right=0.5)
    assert label(alley) == DEAD_END
    assert label(alley, threatened=True) == KNOWN_MOVER
    assert label(alley, sudden=True, threatened=True) == SUDDEN_MOVER
    assert label(walled(), threatened=True) == KNOWN_MOVER


def test_when_two_meet():
    assert time_to_meeting(3.0, 0.0, -1.0, 0.0, 0.5) == pytest.approx(2.5)
    assert time_to_meeting(0.0, 3.0, 0.0, -2.0, 1.0) == pytest.approx(1.0)
    assert time_to_meeting(3.0, 0.4, -1.0, 0.0, 0.5) == pytest.approx(3.0 - 0.3)  # a chord of 3, 4, 5
    assert time_to_meeting(3.0, 0.6, -1.0, 0.0, 0.5) == math.inf
    assert time_to_meeting(3.0, 0.0, 1.0, 0.0, 0.5) == math.inf
    assert time_to_meeting(3.0, 0.0, 0.0, 0.0, 0.5) == math.inf
    assert time_to_meeting(0.3, 0.0, -1.0, 0.0, 0.5) == 0.0
    assert time_to_meeting(0.3, 0.0, 1.0, 0.0, 0.5) == math.inf  # it is leaving


class Crossing:
    """A robot that goes along x at 1 m/s, and one mover of radius 0.3 m, at 10 Hz."""

    def __init__(self, standing=None, yaw=0.0):
        rows = Rows.zeros(1, 1)
        rows.pose[0, 2], rows.velocity[0, 0], rows.counts[0], rows.constants[0, 0, RADIUS] = yaw, 1.0, 1, 0.3
        self.robots, self.movers = rows.robots(), rows.mover_rows()
        self.sight = Sight(np.full((1, NUM_BEAMS), math.inf) if standing is None else standing, OUTLINE)
        self.threats = Threats(
            np.zeros((1, 1)), np.full((1, 1), math.inf), np.zeros(1, np.bool_), np.zeros(1, np.bool_), np.zeros(1)
        )

    def look(self, x, y, v_x, v_y):
        self.movers.state[0, 0, [X, Y, V_X, V_Y]] = x, y, v_x, v_y
        follow_threats(ROW, 0.1, self.robots, np.full(1, BODY), self.movers, self.sight, self.threats)
        return bool(self.threats.sudden[0]), bool(self.threats.threatened[0])


def test_a_mover_that_crosses_is_sudden_for_a_second():
    scene = Crossing()
    calm, across = (3.0, -3.0, 0.0, 0.0), (1.5, -1.5, 0.0, 1.0)  # the latter is met in about 1.1 s
    for _ in range(5):
        assert scene.look(*calm) == (False, False)
    assert scene.threats.gap[0] == pytest.approx(math.hypot(3.0, 3.0) - 0.3 - BODY)
    for _ in range(round(NEWS * 10)):
        assert scene.look(*across) == (True, True)
    for _ in range(5):
        assert scene.look(*across) == (False, True)
    # Out of the way for less than a second, it is the same threat; for more than one, a new one.
    for _ in range(5):
        assert scene.look(*calm) == (False, False)
    assert scene.look(*across) == (False, True)
    for _ in range(round(NEWS * 10)):
        assert scene.look(*calm) == (False, False)
    assert scene.look(*across) == (True, True)


def test_who_is_far_passes_or_follows_is_no_threat():
    assert Crossing().look(5.0, -5.0, 0.0, 1.0) == (False, False)  # in 4.6 s
    assert Crossing().look(1.5, -0.7, 0.0, -1.0) == (False, False)
    assert Crossing().look(1.5, 0.0, 1.2, 0.0) == (False, False)  # ahead, faster
    assert Crossing().look(1.5, 0.0, 0.0, 0.0) == (True, True)  # ahead, stands: met in 0.93 s
    assert Crossing(yaw=math.pi / 2).look(0.0, 1.5, 0.0, 0.0) == (True, True)


def test_who_is_behind_a_wall_is_not_in_sight():
    assert Crossing(walled(ahead=1.0)).look(1.8, 0.0, -1.0, 0.0) == (False, False)
    assert Crossing(walled(ahead=3.0)).look(1.8, 0.0, -1.0, 0.0) == (True, True)


WORLD = ArenaConfig(layouts=2, pairs=8, num_bodies=2)


def test_labels_come_from_the_truth_not_from_what_the_robot_senses():
    worse = replace(Imperfections(), range_sigma=0.2, dropout=0.5, empty_scan=0.5, velocity_noise=0.0)
    labels = []
    for flaws in (replace(worse, range_sigma=0.0, dropout=0.0, empty_scan=0.0), worse):
        evaluation = Evaluation(replace(WORLD, imperfections=flaws).of("static"), ObservationConfig(), 20, 0)
        situations = ArenaSituations(evaluation.arena)
        situations.look(np.arange(20))
        labels.append(situations.label.copy())
        far = evaluation.arena.outputs.clearance >= 1.5
        assert (far[situations.label == OPEN_FLOOR]).all()
        assert not (far[situations.label == OTHER]).any()
    assert np.array_equal(*labels)


def test_movers_of_an_arena_threaten_who_stands_in_their_way():
    """Whoever hits a robot that stands has been a threat before, and near at last."""
    config = replace(WORLD, movers=(20, 20), imperfections=Imperfections.none()).of("dynamic")
    evaluation = Evaluation(config, ObservationConfig(), 40, 0)
    situations, before = ArenaSituations(evaluation.arena), np.full((3, 40), -1)
    while evaluation.active.any():
        rows = np.flatnonzero(evaluation.active)
        situations.look(rows)
        before[:, rows] = np.vstack([before[1:, rows], situations.label[rows]])
        evaluation.step(np.zeros((40, 3), np.float32))
    hit = evaluation.records().collision
    assert hit.sum() > 20
    assert (before[-1, hit] != OPEN_FLOOR).all()
    assert np.isin(before[-1, hit], (SUDDEN_MOVER, KNOWN_MOVER)).mean() > 0.9


def test_movers_in_the_frame_of_the_robot():
    evaluation = Evaluation(replace(WORLD, movers=(6, 6)).of("dynamic"), ObservationConfig(), 4, 0)
    situations, (shard,) = ArenaSituations(evaluation.arena), evaluation.arena.shards
    x, y, yaw = shard.rows.pose[2]
    seen = situations.movers_in_base(2)
    assert len(seen) == shard.rows.counts[2] > 0
    away, forwards = complex(*seen[0, :2]), complex(*seen[0, 2:4])
    turn = complex(math.cos(yaw), math.sin(yaw))
    mover = shard.rows.movers[2, 0]
    assert complex(x, y) + away * turn == pytest.approx(complex(mover[X], mover[Y]))
    assert forwards * turn == pytest.approx(complex(mover[V_X], mover[V_Y]))
