"""V^h against the space around places: correlations worked out by hand, and a mission in a small room."""

import json

import numpy as np
import pytest

from eval.analysis.measurements.openness import HALF_SIDE, Moment, correlations, levels_of, main, openness_of
from eval.analysis.measurements.openness import OpennessArguments as Arguments
from eval.episode import EpisodeConfig
from tests.robots.halls import hall
from vuca_nav.errors import BadArgument
from vuca_nav.types import Pose2
from worlds import save_scene


def test_a_critic_that_follows_the_space():
    clearance = np.array([1.0, 2.0, 3.0, 4.0])
    distance = np.array([1.0, 3.0, 2.0, 4.0])
    plain, at_same = correlations(Moment(np.array([0.1, 0.5, 0.6, 0.9]), clearance, distance))
    assert (plain, at_same) == (pytest.approx(1.0), pytest.approx(1.0))
    plain, at_same = correlations(Moment(np.array([9.0, 7.0, 5.0, 1.0]), clearance, distance))
    assert (plain, at_same) == (pytest.approx(-1.0), pytest.approx(-1.0))


def test_a_critic_that_knows_the_distance_alone():
    rng = np.random.default_rng(0)
    distance = rng.uniform(0.0, 6.0, 500)
    clearance = distance + rng.normal(0.0, 2.0, 500)  # there is more space further off
    plain, at_same = correlations(Moment(distance + 0.5 * rng.normal(size=500), clearance, distance))
    assert plain is not None
    assert plain > 0.5
    assert at_same == pytest.approx(0.0, abs=0.1)


def test_by_hand():
    # Ranks 1 2 3 against 1 3 2: 1 - 6 * 2 / (3 * 8) = 0.5; distance against both: 0.5 and -0.5.
    values, clearance, distance = np.array([1.0, 2.0, 3.0]), np.array([1.0, 3.0, 2.0]), np.array([2.0, 1.0, 3.0])
    plain, at_same = correlations(Moment(values, clearance, distance))
    assert plain == pytest.approx(0.5)
    # (0.5 - 0.5 * -0.5) / sqrt(0.75 * 0.75)
    assert at_same == pytest.approx(1.0)


def test_what_does_not_vary_has_no_correlation():
    one, rising = np.ones(3), np.array([1.0, 2.0, 3.0])
    assert correlations(Moment(one, rising, rising)) == (None, None)
    assert correlations(Moment(rising, one, rising)) == (None, None)
    assert correlations(Moment(rising, rising, one)) == (pytest.approx(1.0), None)


@pytest.fixture
def room(tmp_path):
    """A hall of 10 m; the goal is near."""
    path = tmp_path / "hall.yaml"
    save_scene(hall(10.0, Pose2(3.0, 5.0, 0.0)), path)
    return path


def test_a_mission(room):
    config = EpisodeConfig(str(room), method="ours", goal=(6.0, 5.0))
    row = json.loads(json.dumps(openness_of(config, every=1.0)))
    assert [moment["time"] for moment in row["moments"][:2]] == [1.0, 2.0]
    for moment in row["moments"]:
        # All of the hall that lies within 6 m is in sight: less than 10 m by 12 m, 0.4 m apart.
        assert 300 < moment["places"] < 700
        assert -1.0 <= moment["correlation"] <= 1.0
    view = row["view"]
    assert view["time"] == 2.0
    assert levels_of(view).shape == (48, 48)
    assert view["half_side"] == HALF_SIDE
    assert view["scene"]["boxes"]


def test_what_cannot_be_measured(room, tmp_path):
    out = tmp_path / "m.jsonl"
    for arguments, words in (
        (Arguments(seeds="3:4", out=out, world=str(room), method="ours-dh"), "'ours-dh' has no critic"),
        (Arguments(seeds="3:3", out=out), "--seeds must be A:B"),
        (Arguments(seeds="3:4", out=out, every=0.0), "--every must be 0.1 or more"),
        (Arguments(seeds="3:4", out=tmp_path), "is a directory"),
        (Arguments(seeds="3:4", out=out, method="mine:build"), "of your own"),
    ):
        with pytest.raises(BadArgument, match=words):
            main(arguments)
    assert not out.exists()
