"""Recordings of the missions that failed."""

from dataclasses import replace
from functools import partial
from itertools import product

from eval.episode import EpisodeConfig, run_episode
from eval.metrics import TIMING_FIELDS
from eval.recordings import file_name, record_episode, record_failures
from eval.suites import SUITES, choose, episodes_of
from tests.eval import jobs

CONFIGS = episodes_of(choose(SUITES["smoke"], ["dwa-dh", "ours"]), seeds=range(3))
ROWS = [jobs.episode_by_hash(config) for config in CONFIGS]
FAILED = {file_name(row) for row in ROWS if row["outcome"] != "success"}


def test_failed_missions_are_recorded_once(tmp_path, capsys):
    assert 0 < len(FAILED) < len(ROWS)
    out = tmp_path / "recordings"
    job = partial(jobs.recording_by_hash, out)
    assert record_failures(ROWS, CONFIGS, out, 1, job) == []
    assert {path.name for path in out.iterdir()} == FAILED
    # What is there is not made again; what is missing is.
    (out / min(FAILED)).unlink()
    before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    record_failures(ROWS, CONFIGS, out, 1, job)
    after = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    assert after.keys() == FAILED
    assert all(after[name] == time for name, time in before.items())
    assert "otherwise" not in capsys.readouterr().err


def test_a_recording_of_another_course_is_told(tmp_path, capsys):
    rows = [{**row, "path_length": 0.0} for row in ROWS]
    record_failures(rows, CONFIGS, tmp_path, 1, partial(jobs.recording_by_hash, tmp_path))
    assert capsys.readouterr().err.count("is of a mission that went otherwise than its row says") == len(FAILED)


def test_nothing_failed_nothing_is_written(tmp_path):
    rows = [{**row, "outcome": "success"} for row in ROWS]
    assert record_failures(rows, CONFIGS, tmp_path / "recordings", 1) == []
    assert not (tmp_path / "recordings").exists()


def test_names_tell_tasks_and_methods_apart():
    names = {file_name(config.row()) for name in SUITES for config in episodes_of(SUITES[name], seeds=range(2))}
    kinds = {replace(config) for name in SUITES for config in episodes_of(SUITES[name], seeds=range(2))}
    assert len(names) == len(kinds)
    config = EpisodeConfig("factory", 4, "go2", "ours", 7, without="U", speed=1.5)
    assert file_name(config.row()) == "factory-4-speed-x-1.5-without-U-go2-ours-7.rrd"


def test_a_recording_is_of_the_same_mission(tmp_path):
    config = EpisodeConfig(world="square", movers=2, seed=7, start=(4.0, 4.0, 0.0), goal=(5.0, 4.0), method="dwa-dh")
    row, plain = record_episode(tmp_path, config), run_episode(config).row()
    assert {k: v for k, v in row.items() if k not in TIMING_FIELDS} == {
        k: v for k, v in plain.items() if k not in TIMING_FIELDS
    }
    (file,) = tmp_path.iterdir()
    assert file.name == file_name(row)
    assert file.stat().st_size > 10_000


def test_tasks_of_one_world_have_recordings_of_their_own():
    goals = ((2.0, 5.0), (-2.0, 5.0), (2.0, -5.0), None)
    assert len({file_name(EpisodeConfig(world="map:a/room.yaml", goal=goal).row()) for goal in goals}) == len(goals)


def test_worlds_of_one_name_in_two_folders_have_recordings_of_their_own():
    folders = ("map:a/room.yaml", "map:b/room.yaml", "barn:a/room.world", "a/room.yaml")
    worlds = product(folders, (None, "tracks:c.csv"))
    rows = [EpisodeConfig(world=world, obstacles=crowd).row() for world, crowd in worlds]
    assert len({file_name(row) for row in rows}) == len(rows)
