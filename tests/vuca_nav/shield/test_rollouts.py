"""The shield's rollouts: their risk and their clearance against the same by brute force."""

import math

import numpy as np
import pytest

from tests.vuca_nav.rooms import LIDAR, NOTHING, disc_body, ranges_to_boxes, room
from vuca_nav.footprint import cover_by_discs, size_of
from vuca_nav.perception.distance_field import DistanceField, fill_field, smooth_clearance_at
from vuca_nav.perception.percept import LevelScan
from vuca_nav.perception.tracks import CERTAINTY, HAS_LEFT, RADIUS, TRACK_SIZE, V_X, V_Y, X, Y, select_moving
from vuca_nav.policy.observation import limits_of
from vuca_nav.shield.futures import Futures
from vuca_nav.shield.rollouts import (
    _OBEY,
    BodyState,
    ShieldScene,
    ShieldSettings,
    WaysOut,
    _harm,
    _lack_of_clearance,
    _risk,
    _roll_out,
    cheapest,
    stops_clear,
    what_may_be_met,
    without_tracks,
)
from vuca_nav.shield.shield import ShieldConfig, ways_out
from vuca_nav.types import BodySpec, Pose2

CONFIG = ShieldConfig()
STEPS = round(CONFIG.futures.horizon / CONFIG.futures.time_step)
FREE = DistanceField.empty(CONFIG.reach, CONFIG.resolution)
NO_LIMIT = 1e9
ANGLES = LIDAR.angles_in_base()
BEAMS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
BOX = np.array([[-0.38, -0.19], [0.38, -0.19], [0.38, 0.19], [-0.38, 0.19]])
LONG = BodySpec("long", BOX, 1.2, -0.6, 0.4, 1.2, 2.0, 2.0, 5.0)
NO_TRACKS, NO_FUTURES = np.zeros((0, TRACK_SIZE)), np.zeros((CONFIG.futures.scenarios, 0, STEPS, 2))


def settings_of(body: BodySpec) -> ShieldSettings:
    discs = cover_by_discs(body.footprint)
    of_config = {name: getattr(CONFIG, name) for name in ShieldSettings._fields if hasattr(CONFIG, name)}
    return ShieldSettings(
        limits=limits_of(body),
        accelerations=np.array([body.max_a_x, body.max_a_y, body.max_a_w]),
        discs=discs,
        size=size_of(discs),
        time_step=CONFIG.futures.time_step,
        **of_config,
    )


DISC = settings_of(disc_body())


def state_at(x=0.0, y=0.0, yaw=0.0, v_x=0.0, v_y=0.0, w_z=0.0) -> BodyState:
    return BodyState(x, y, yaw, math.cos(yaw), math.sin(yaw), v_x, v_y, w_z)


def movers(rng: np.random.Generator) -> np.ndarray:
    """One to three that come at the robot more or less, (k, TRACK_SIZE)."""
    k = rng.integers(1, 4)
    angle, away = rng.uniform(-math.pi, math.pi, k), rng.uniform(1.0, 2.5, k)
    heading, speed = angle + math.pi + rng.normal(0.0, 0.5, k), rng.uniform(0.4, 1.5, k)
    tracks = np.ones((k, TRACK_SIZE))
    tracks[:, X], tracks[:, Y] = away * np.cos(angle), away * np.sin(angle)
    tracks[:, V_X], tracks[:, V_Y], tracks[:, RADIUS] = speed * np.cos(heading), speed * np.sin(heading), 0.3
    return tracks


@pytest.mark.parametrize("seed", range(100))
def test_in_every_future_the_best_of_all_ways_out_is_taken(seed):
    rng = np.random.default_rng(seed)
    tracks, ways = movers(rng), ways_out(CONFIG.num_ways_out)
    futures = Futures(16, CONFIG.futures).draw(tracks, DistanceField.empty(CONFIG.far_reach, CONFIG.far_resolution))
    near, first = np.arange(len(tracks)), round(CONFIG.segment / CONFIG.futures.time_step)
    command = np.array([rng.uniform(-0.4, 1.0), 0.0, rng.uniform(-1.0, 1.0)])
    state = state_at(v_x=float(rng.uniform(0, 1)))
    scene = ShieldScene(FREE, FREE, tracks, futures, near)
    scratch = WaysOut(ways, np.zeros((len(ways), STEPS, 4)))
    risk = _risk(command, state, scene, scratch, DISC, NO_LIMIT, math.inf)

    obeyed = np.zeros((first, 4))
    turned = _roll_out(_OBEY, command, state, FREE, DISC, NO_LIMIT, obeyed)
    trajectories = np.zeros((len(ways), STEPS, 4))
    for way, trajectory in zip(ways, trajectories):
        trajectory[:first] = obeyed
        _roll_out(way, command, turned, FREE, DISC, NO_LIMIT, trajectory[first:])
    harms = []
    for future in futures:
        at_first = _harm(future, tracks, near, trajectories[0], 0, first, DISC)
        then = [_harm(future, tracks, near, trajectory, first, STEPS, DISC) for trajectory in trajectories]
        harms.append(max(at_first, min(then)))
    assert risk == pytest.approx(np.mean(harms), abs=1e-12)
    for most in (0.3 * risk, 2.0 * risk):  # it is added up only as far as it matters
        capped = _risk(command, state, scene, scratch, DISC, NO_LIMIT, most)
        assert min(capped, most) == pytest.approx(min(risk, most), abs=1e-12)


def test_only_tracks_that_surely_move_are_selected():
    tracks = np.zeros((4, TRACK_SIZE))
    tracks[:, V_X], tracks[:, CERTAINTY], tracks[:, HAS_LEFT] = 0.3, 0.8, 1.0
    tracks[:, X] = range(4)
    tracks[0, V_X] = 0.2  # too slow
    tracks[1, CERTAINTY] = 0.5
    tracks[2, HAS_LEFT] = 0.0
    out = np.zeros((16, TRACK_SIZE))
    assert select_moving(tracks, 0.25, 0.6, out) == 1
    np.testing.assert_array_equal(out[0], tracks[3])


def test_the_returns_of_tracks_are_taken_out_of_a_scan():
    ranges, out = np.full(360, 2.0), np.zeros(360)
    ranges[10:15], ranges[20:25] = np.nan, np.inf
    tracks = np.ones((1, TRACK_SIZE))
    tracks[0, [X, Y, RADIUS]] = 2.0, 0.0, 0.3
    level = LevelScan(ranges, BEAMS, np.zeros(360, np.bool_))
    without_tracks(ranges, level, tracks, out)
    own = np.hypot(*(2.0 * BEAMS - (2.0, 0.0)).T) < 0.45
    assert own.sum() > 20
    np.testing.assert_array_equal(out, np.where(own | ~(ranges < np.inf), np.inf, 2.0))


# -- clearance ---------------------------------------------------------------------------------------------------------


def random_ranges(rng: np.random.Generator) -> np.ndarray:
    """A room of any size about the robot, with blocks, range noise and faults; or single returns."""
    if rng.random() < 0.3:
        return np.where(rng.random(360) < 0.02, rng.uniform(0.3, 2.5, 360), np.inf)
    width, height = rng.uniform(1.2, 6.0, 2)
    boxes, centre = room(width, height), (0.5 * width, 0.5 * height)
    for x, y in rng.uniform((0.0, 0.0), (width, height), (2, 2)):
        if math.dist((x, y), centre) > 0.8:
            boxes = np.vstack([boxes, [[x - 0.2, y - 0.2, x + 0.2, y + 0.2]]])
    ranges = ranges_to_boxes(boxes, Pose2(*centre, rng.uniform(-3.0, 3.0))) + rng.normal(0.0, 0.02, 360)
    ranges[rng.random(360) < 0.02] = rng.choice([np.inf, np.nan])
    return ranges


def random_state(rng: np.random.Generator, body: BodySpec) -> BodyState:
    """Anything that the body can do, and where it is after a delay of up to 0.2 s."""
    speeds = random_command(rng, body)
    return state_at(*rng.uniform([-0.2, -0.2, -0.3], [0.2, 0.2, 0.3]), *speeds)


def random_command(rng: np.random.Generator, body: BodySpec) -> np.ndarray:
    return rng.uniform([body.min_v_x, -body.max_v_y, -body.max_w_z], [body.max_v_x, body.max_v_y, body.max_w_z])


def field_of(ranges: np.ndarray, reach: float, resolution: float) -> DistanceField:
    field = DistanceField.empty(reach, resolution)
    fill_field(ranges, BEAMS, field)
    return field


FIELDS = {"a percept's": (2.6, 0.05), "the shield's": (CONFIG.reach, CONFIG.resolution), "a coarse one": (2.6, 0.1)}


def still_scene(field: DistanceField) -> ShieldScene:
    return ShieldScene(field, field, NO_TRACKS, NO_FUTURES, np.empty(0, np.int64))


def lack(command, state, settings, field):
    """Of clearance, if nothing moves [m]."""
    now = smooth_clearance_at(field, settings.discs, state.x, state.y, state.cos, state.sin) - settings.margin
    return _lack_of_clearance(command, state, still_scene(field), settings, (now, now))


@pytest.mark.parametrize("reach_and_resolution", FIELDS.values(), ids=FIELDS)
@pytest.mark.parametrize("body", [disc_body(), LONG], ids=["disc", "long"])
def test_what_stops_clear_lacks_no_clearance_by_any_field(body, reach_and_resolution):
    settings, clear, lacking = settings_of(body), 0, 0
    blur = DistanceField.empty(*reach_and_resolution).uncertainty
    for seed in range(1500):
        rng = np.random.default_rng(seed)
        ranges, state, command = random_ranges(rng), random_state(rng, body), random_command(rng, body)
        missing = lack(command, state, settings, field_of(ranges, *reach_and_resolution))
        if stops_clear(ranges, BEAMS, command, state, settings, blur):
            clear += 1
            assert missing == 0.0, f"seed {seed}"
        lacking += missing > 0.0
    assert min(clear, lacking) > 100  # neither by chance


@pytest.mark.parametrize("body", [disc_body(), LONG], ids=["disc", "long"])
def test_what_stops_clear_is_the_cheapest_of_all(body):
    settings = settings_of(body)
    ways = ways_out(CONFIG.num_ways_out)
    scratch, clear = WaysOut(ways, np.zeros((len(ways), STEPS, 4))), 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        ranges, state = random_ranges(rng), random_state(rng, body)
        candidates = np.array([random_command(rng, body) for _ in range(20)])
        field = field_of(ranges, 2.6, 0.05)
        best = cheapest(candidates, state, still_scene(field), scratch, settings, 0)
        if stops_clear(ranges, BEAMS, candidates[0], state, settings, field.uncertainty):
            clear += 1
            assert best == 0
    assert clear > 30


def test_it_stops_clear_before_a_wall_that_is_far_enough():
    """From 1 m/s at 1 m/s^2 the disc needs 0.5 m and 0.2 m of holding on, its radius, and the margins."""
    state, ahead = state_at(v_x=1.0), np.array([1.0, 0.0, 0.0])
    needs = 0.5 + 0.2 + 0.28 + CONFIG.margin
    for wall, clear in ((needs - 0.05, False), (needs + 0.2, True)):
        ranges = ranges_to_boxes(np.array([[wall, -8.0, wall + 0.2, 8.0]]), Pose2(0.0, 0.0, 0.0))
        assert stops_clear(ranges, BEAMS, ahead, state, DISC, 1.5 * math.sqrt(2.0) * 0.05) == clear
    assert stops_clear(NOTHING, BEAMS, ahead, state, DISC, 0.1)
    slow = DISC._replace(accelerations=np.array([1e-9, 0.0, 1e-9]))  # a braking that does not end
    assert not stops_clear(NOTHING, BEAMS, ahead, state, slow, 0.1)


@pytest.mark.parametrize("body", [disc_body(), LONG], ids=["disc", "long"])
def test_the_cheapest_is_the_same_whatever_is_guessed(body):
    settings, ways = settings_of(body), ways_out(CONFIG.num_ways_out)
    scratch, chosen = WaysOut(ways, np.zeros((len(ways), STEPS, 4))), []
    futures = Futures(16, CONFIG.futures)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        ranges, state, tracks = random_ranges(rng), random_state(rng, body), movers(rng)
        field, far = field_of(ranges, 4.0, 0.05), field_of(ranges, CONFIG.far_reach, CONFIG.far_resolution)
        drawn = futures.draw(tracks, far)
        near = what_may_be_met(tracks, drawn, state, settings)
        scene = ShieldScene(field, field, tracks, drawn, near)
        candidates = np.array([random_command(rng, body) for _ in range(30)])
        best = cheapest(candidates, state, scene, scratch, settings, 0)
        assert {cheapest(candidates, state, scene, scratch, settings, guess) for guess in range(1, 30, 4)} == {best}
        assert cheapest(candidates, state, scene, scratch, settings, best) == best
        chosen.append(best)
    assert len(set(chosen)) > 5


def test_what_may_be_met_comes_near_in_some_future():
    tracks = np.ones((3, TRACK_SIZE))
    tracks[:, RADIUS] = 0.3
    tracks[0, [X, Y, V_X, V_Y]] = 1.5, 0.0, -0.5, 0.0  # comes
    tracks[1, [X, Y, V_X, V_Y]] = -7.5, 0.0, -1.0, 0.0  # far, and goes
    tracks[2, [X, Y, V_X, V_Y]] = 0.8, 0.2, 0.0, 0.3  # near
    drawn = Futures(16, CONFIG.futures).draw(tracks, DistanceField.empty(CONFIG.far_reach, CONFIG.far_resolution))
    assert sorted(what_may_be_met(tracks, drawn, state_at(), DISC)) == [0, 2]
    many = np.ones((9, TRACK_SIZE))
    many[:, X], many[:, Y], many[:, V_X:RADIUS] = 0.6 + 0.1 * np.arange(9), 0.0, 0.0
    drawn = Futures(16, CONFIG.futures).draw(many, DistanceField.empty(CONFIG.far_reach, CONFIG.far_resolution))
    assert what_may_be_met(many, drawn, state_at(), DISC).tolist() == list(range(6))  # the nearest
