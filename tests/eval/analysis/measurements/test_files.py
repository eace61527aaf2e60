"""Files of measurements: they go on where they were, and are refused by what would mix them."""

import json

import pytest

from eval.analysis.measurements import files
from eval.analysis.measurements.files import is_measurement, measure, read_measurement
from eval.episode import EpisodeConfig
from tests.eval.jobs import episode_by_hash, episode_that_fails_on_seed_1
from vuca_nav.errors import BadArgument

CONFIGS = [EpisodeConfig("square", method="dwa-dh", seed=seed) for seed in range(4)]


@pytest.fixture(autouse=True)
def lenient(monkeypatch):
    """The stand-in rows are of no kind that a report reads."""
    monkeypatch.setitem(files.KINDS, "made-up", files.Fields({}, ("world",)))


def test_begun_again_it_goes_on_where_it_was(tmp_path, capsys):
    path = tmp_path / "m.jsonl"
    some, _ = measure(path, "made-up", CONFIGS[:2], episode_by_hash, workers=1, command="first")
    with path.open("a") as file:
        file.write('{"torn')
    rows, crashes = measure(path, "made-up", CONFIGS, episode_by_hash, workers=1, command="second")
    assert not crashes
    assert [row["seed"] for row in rows] == [0, 1, 2, 3]
    assert rows[:2] == some
    stored = read_measurement(path)
    assert [run["command"] for run in stored.runs] == ["first", "second"]
    assert stored.rows == rows
    before = path.read_bytes()
    assert measure(path, "made-up", CONFIGS[1:], episode_that_fails_on_seed_1, workers=1)[0] == rows[1:]
    assert path.read_bytes() == before  # nothing was left to do
    assert is_measurement(path)


def test_a_finished_row_says_what_decided_on_its_bits(tmp_path):
    rows, _ = measure(
        tmp_path / "m.jsonl", "made-up", CONFIGS[:1], episode_by_hash, workers=1, finish=lambda row: {**row, "more": 7}
    )
    assert rows[0]["more"] == 7
    assert len(rows[0]["bits"]) == 16


def test_a_crash_is_told_and_tried_again(tmp_path, capsys):
    path = tmp_path / "m.jsonl"
    rows, crashes = measure(path, "made-up", CONFIGS, episode_that_fails_on_seed_1, workers=1)
    assert [row["seed"] for row in rows] == [0, 2, 3]
    assert "divides by zero" in crashes[0].error
    rows, crashes = measure(path, "made-up", CONFIGS, episode_by_hash, workers=1)
    assert [row["seed"] for row in rows] == [0, 1, 2, 3]
    assert not crashes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"measurement": "moments"}, "holds another measurement, moments; choose another --out"),
        ({"made_by": {}}, "was begun with other code, libraries, arithmetic, noise, settings; go on with the same"),
        ({"measurement": None}, "is not a file of measurements"),
    ],
)
def test_what_cannot_be_gone_on_with(tmp_path, change, words):
    path = tmp_path / "m.jsonl"
    measure(path, "made-up", CONFIGS[:1], episode_by_hash, workers=1)
    head, *_ = path.read_text().splitlines()
    path.write_text(json.dumps({**json.loads(head), **change}) + "\n")
    with pytest.raises(BadArgument, match=words):
        measure(path, "made-up", CONFIGS, episode_by_hash, workers=1)


def test_other_settings_are_refused(tmp_path):
    path = tmp_path / "m.jsonl"
    measure(path, "made-up", CONFIGS[:1], episode_by_hash, workers=1, settings={"every": 5.0})
    with pytest.raises(BadArgument, match="was begun with other settings"):
        measure(path, "made-up", CONFIGS, episode_by_hash, workers=1, settings={"every": 10.0})
