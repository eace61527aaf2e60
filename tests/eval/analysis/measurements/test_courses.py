"""The course of a mission in a hall, and the choice of the missions."""

import json

import pytest

from eval.analysis.measurements.courses import CoursesArguments, course_of, keep_courses, main, missions
from eval.analysis.report.cells import cells_of, read_evaluation
from eval.episode import EpisodeConfig, run_episode
from tests.eval.analysis.report.synthetic import episodes, write_evaluation
from tests.robots.halls import hall
from vuca_nav.errors import BadArgument
from vuca_nav.types import Pose2
from worlds import save_scene


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "hall.yaml"
    save_scene(hall(10.0, Pose2(3.0, 5.0, 0.0)), path)
    return EpisodeConfig(str(path), method="fusion", goal=(6.0, 5.0))


def test_the_course_of_a_mission(config):
    row = json.loads(json.dumps(course_of(config)))
    assert row["path"][0] == [3.0, 5.0]
    assert row["outcome"] == "success"
    assert row["path"][-1] == pytest.approx([6.0, 5.0], abs=0.5)
    # A point every half second from the start on, and the end.
    assert len(row["path"]) == int(row["duration"] / 0.5 + 1e-9) + 2
    assert len(row["expert_shares"]) == len(row["path"]) - 1
    assert row["expert_shares"][0] == []
    assert sum(row["expert_shares"][1]) == pytest.approx(1.0, abs=0.01)
    assert row["scene"]["goal"] == [6.0, 5.0]
    assert row["gate"] is None  # the method's option, not what it did


def test_it_is_told_whether_a_mission_came_out_as_before(config, tmp_path):
    row = run_episode(config).row()
    (kept,), crashes = keep_courses([row], tmp_path / "a.jsonl", workers=1)
    assert not crashes
    assert kept["is_repeated"]
    (other,), _ = keep_courses([row | {"duration": 1.0}], tmp_path / "b.jsonl", workers=1)
    assert not other["is_repeated"]


def test_one_seed_of_all_plain_places(tmp_path):
    rows = episodes({"world": "square", "method": "ours"}, ["success"] * 3, first_seed=1)
    rows += episodes({"world": "factory", "region": 4, "method": "ours"}, ["success"] * 3, first_seed=2)
    rows += episodes({"world": "square", "method": "ours", "movers": 8}, ["success"] * 3, first_seed=7)
    cells = cells_of([read_evaluation(write_evaluation(tmp_path / "e", rows))])
    assert [(row["world"], row["seed"]) for row in missions(cells, None)] == [("factory", 2), ("square", 2)]
    assert [(row["world"], row["seed"]) for row in missions(cells, 1)] == [("square", 1)]
    with pytest.raises(BadArgument, match="no row has seed 9"):
        missions(cells, 9)
    with pytest.raises(BadArgument, match="all its difficulties"):
        missions([cell for cell in cells if not cell.is_plain], None)


def test_python_of_ones_own_needs_trust(tmp_path):
    folder = write_evaluation(tmp_path / "e", episodes({"world": "square", "method": "mine:build"}, ["success"]))
    with pytest.raises(BadArgument, match="add --trust"):
        main(CoursesArguments(folders=(folder,), out=tmp_path / "c.jsonl"))
