"""One robot's observation from its percepts: the same as training's, a row at a time."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, NO_BOXES, Sensors, disc_body, ranges_to_discs, room
from vuca_nav.errors import BadArgument
from vuca_nav.footprint import outline_ranges
from vuca_nav.geometry import compose
from vuca_nav.perception.perception import PerceptionConfig
from vuca_nav.perception.tracks import MAX_TRACKS
from vuca_nav.policy.observation import BODY_SIZE, TWIST_SIZE, ObservationConfig, Observer, PerceptObserver
from vuca_nav.policy.track_features import SLOT_SIZE, SLOTS
from vuca_nav.types import STANDING, BodySpec, LidarSpec, Pose2, Twist2

BOX = np.array([[-0.35, -0.2], [0.35, -0.2], [0.35, 0.2], [-0.35, 0.2]])
BODIES = {
    "disc": disc_body(),
    "box": BodySpec("box", BOX, 1.2, -0.6, 0.4, 1.2, 2.0, 2.0, 5.0),
    "wide": replace(disc_body(0.5), max_v_x=0.5, min_v_x=0.0),
}
DT = 1.0 / LIDAR.rate


def noise(rng: np.random.Generator, tick: int) -> np.ndarray:
    """Every beam for itself, dropouts and faults too."""
    ranges = rng.uniform(0.2, 5.0, 360)
    ranges[rng.random(360) < 0.1] = np.inf
    ranges[rng.random(360) < 0.1] = np.nan
    return ranges


def hall(rng: np.random.Generator, tick: int) -> np.ndarray:
    """Two that move and a post in a hall, with noise; all within 5 m."""
    discs = [(3.5 - 0.03 * tick, 2.0, 0.3), (2.0, 4.2 - 0.02 * tick, 0.2), (1.2, 1.0, 0.15)]
    ranges = ranges_to_discs(discs, room(4.6, 4.4), Pose2(2.2, 2.0, 0.01 * tick)) + rng.normal(0.0, 0.02, 360)
    ranges[rng.random(360) < 0.01] = np.inf
    return ranges


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("world", [noise, hall])
@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("kind", ["paper", "tracked", "frames"])
def test_it_is_what_training_sees(kind, body, world, seed):
    """To the bit, if perception tracks as far as training does; after a reset too."""
    rng, config = np.random.default_rng(seed), ObservationConfig(kind=kind)
    sight = config.max_range + outline_ranges(body.footprint, 360).max()
    sensors, observer = Sensors(config=PerceptionConfig(sight=sight)), Observer(config, [body], 360, LIDAR.rate)
    of_percepts, out = PerceptObserver(config, body, LIDAR), np.zeros((1, config.size), np.float32)
    anything = False
    for tick in range(60):
        if tick == 35:
            sensors.perception.reset()
            observer.reset()
        motion, twist = Pose2(*rng.normal(0.0, 0.02, 3)), Twist2(*rng.normal(0.0, 0.6, 3))
        goal = (float(rng.normal()), float(rng.normal()))
        percept = sensors.see(world(rng, tick), motion, twist)
        observer.observe(
            percept.scan.ranges[None], np.array([goal]), np.array([twist]), np.array([percept.motion]), out
        )
        seen = of_percepts.observe(percept, goal)
        np.testing.assert_array_equal(seen, out[0])
        anything = anything or len(percept.tracks) > 0
    assert anything
    assert np.abs(out[0, 60 : config.goal_slice.start]).max() > 0.05


def test_that_perception_sees_farther_changes_little():
    """Tracks wholly beyond the policy's reach are left out; one that comes in has been known for longer."""
    config, body = ObservationConfig(kind="tracked"), BODIES["disc"]
    sensors, observer = Sensors(), Observer(config, [body], 360, LIDAR.rate)
    of_percepts, out = PerceptObserver(config, body, LIDAR), np.zeros((1, config.size), np.float32)
    reach, first_slot = config.max_range + 0.28, config.goal_slice.stop + TWIST_SIZE + BODY_SIZE + 1
    known, shown = [], []
    for tick in range(120):
        x = 8.5 - 1.0 * tick * DT
        percept = sensors.see(ranges_to_discs([(x, 0.5, 0.3)], NO_BOXES, STANDING))
        observer.observe(percept.scan.ranges[None], np.zeros((1, 2)), np.zeros((1, 3)), np.zeros((1, 3)), out)
        seen = of_percepts.observe(percept, (0.0, 0.0))
        slots, of_training = (o[first_slot:].reshape(SLOTS, SLOT_SIZE) for o in (seen, out[0]))
        known.append(len(percept.tracks))
        shown.append((slots[:, 5] > 0.0).sum())
        if x > reach + 0.6:
            assert shown[-1] == 0
        elif x < reach - 1.2:  # all that both know by then
            assert slots == pytest.approx(of_training, abs=0.03)
    assert known[60] == shown[-1] == 1
    assert max(known) < MAX_TRACKS


def test_it_remembers_nothing():
    """What a percept says does not depend on what was asked before."""
    for kind in ("paper", "tracked"):
        config, rng = ObservationConfig(kind=kind), np.random.default_rng(1)
        asked_always = PerceptObserver(config, BODIES["box"], LIDAR)
        sensors, percept = Sensors(), None
        for tick in range(30):
            percept = sensors.see(hall(rng, tick))
            asked_always.observe(percept, (5.0, -2.0))
        assert percept is not None
        late = PerceptObserver(config, BODIES["box"], LIDAR).observe(percept, (1.0, 0.5))
        np.testing.assert_array_equal(asked_always.observe(percept, (1.0, 0.5)), late)


def test_the_waypoint_changes_only_its_part():
    config, sensors = ObservationConfig(), Sensors()
    observer, percept = PerceptObserver(config, BODIES["disc"], LIDAR), sensors.see(np.full(360, 3.0))
    one, two = (observer.observe(percept, goal).copy() for goal in ((3.0, 0.0), (0.0, -3.0)))
    assert one[config.goal_slice] == pytest.approx([0.0, 1.0, 0.0])
    assert two[config.goal_slice] == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)
    outside = np.ones(config.size, np.bool_)
    outside[config.goal_slice] = False
    np.testing.assert_array_equal(one[outside], two[outside])


def test_a_perception_that_does_not_remember_enough_is_refused():
    config = ObservationConfig(history=3, spacing=0.1)  # 9 ticks before now
    observer = PerceptObserver(config, BODIES["disc"], LIDAR)
    enough, short = (Sensors(config=PerceptionConfig(memory=memory)) for memory in (0.3, 0.26))
    observer.observe(enough.see(np.full(360, 3.0)), (1.0, 0.0))
    with pytest.raises(BadArgument, match=r"compares scans of 0.3 s, perception keeps 9 of the 10"):
        observer.observe(short.see(np.full(360, 3.0)), (1.0, 0.0))
    # Tracks need no past scans.
    tracked = PerceptObserver(ObservationConfig(kind="tracked"), BODIES["disc"], LIDAR)
    none = Sensors(config=PerceptionConfig(memory=0.0)).see(np.full(360, 3.0))
    assert none.history.depth == 1
    assert np.isfinite(tracked.observe(none, (1.0, 0.0))).all()


@pytest.mark.parametrize(
    ("config", "lidar", "message"),
    [
        (ObservationConfig(sectors=7), LIDAR, "do not divide"),
        (ObservationConfig(spacing=0.05), LIDAR, "spaced by"),
        (ObservationConfig(spacing=0.1), LidarSpec(rate=25.0), "spaced by"),
    ],
)
def test_a_lidar_that_does_not_fit_is_refused(config, lidar, message):
    with pytest.raises(BadArgument, match=message):
        PerceptObserver(config, BODIES["disc"], lidar)


def test_a_mirrored_drive_gives_the_mirrored_observation():
    for kind in ("paper", "tracked"):
        config = ObservationConfig(kind=kind)
        order, signs = config.mirror()
        left, right = (PerceptObserver(config, BODIES["box"], LIDAR) for _ in range(2))
        here, there, pose = Sensors(), Sensors(), Pose2(2.0, 3.0, 0.2)
        step, twist = Pose2(0.03, 0.01, 0.02), Twist2(0.9, 0.2, 0.6)
        for tick in range(45):
            discs = [(4.0 + 0.02 * tick, 4.5 - 0.03 * tick, 0.3), (3.3, 1.7, 0.2)]
            walls = room(10.0, 8.0)
            a = here.see(ranges_to_discs(discs, walls, pose), step, twist)
            mirrored = Pose2(pose.x, 8.0 - pose.y, -pose.yaw)
            b = there.see(
                ranges_to_discs([(x, 8.0 - y, r) for x, y, r in discs], walls, mirrored),
                Pose2(step.x, -step.y, -step.yaw), Twist2(twist.v_x, -twist.v_y, -twist.w_z),
            )  # fmt: skip
            one, other = left.observe(a, (2.0, 1.0)), right.observe(b, (2.0, -1.0))
            assert other == pytest.approx(one[order] * signs, abs=1e-5)
            assert math.isfinite(one.sum())
            pose = compose(pose, step)
