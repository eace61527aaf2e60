import json
import os

import pytest

from eval.store import ResultStore
from vuca_nav.errors import BadArgument

CONFIG = {"suite": "smoke", "seeds": [0, 2]}
VERSIONS = {"vuca-nav": "0.1.0"}


def rows_of(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_rows_are_on_disk_as_soon_as_they_are_appended(tmp_path):
    with ResultStore(tmp_path / "new" / "dir", CONFIG, VERSIONS) as store:
        store.append({"seed": 0})
        assert rows_of(tmp_path / "new" / "dir" / "episodes.jsonl") == [{"seed": 0}]


def test_a_torn_last_line_is_dropped_and_the_next_row_is_whole(tmp_path):
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        store.append({"seed": 0})
        store.append({"seed": 1})
    path = tmp_path / "episodes.jsonl"
    path.write_bytes(path.read_bytes()[:-4])
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        assert store.rows == [{"seed": 0}]
        store.append({"seed": 1})
    assert rows_of(path) == [{"seed": 0}, {"seed": 1}]


def test_a_broken_line_in_the_middle_is_named(tmp_path):
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        store.append({"seed": 0})
    path = tmp_path / "episodes.jsonl"
    for broken in ('{"seed"', '{"seed": NaN}', "[" * 100_000, '{"seed": 1, "seed": 2}'):
        path.write_text(f'{{"seed": 0}}\n{broken}\n{{"seed": 2}}\n')
        with pytest.raises(BadArgument, match=r"episodes\.jsonl:2 is not JSON"):
            ResultStore(tmp_path, CONFIG, VERSIONS)


def test_rows_that_are_no_regular_file_are_refused_at_once(tmp_path):
    with ResultStore(tmp_path, CONFIG, VERSIONS):
        pass
    path = tmp_path / "episodes.jsonl"
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(BadArgument, match=r"episodes\.jsonl is a pipe or a device"):
        ResultStore(tmp_path, CONFIG, VERSIONS)


def test_another_configuration_is_refused_and_nothing_is_changed(tmp_path):
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        store.append({"seed": 0})
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(BadArgument, match=r"begun with seeds = \[0, 2\], not \[0, 5\]"):
        ResultStore(tmp_path, {**CONFIG, "seeds": [0, 5]}, VERSIONS)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_machine_that_computes_other_bits_is_refused_last_of_all(tmp_path):
    made_by = {**VERSIONS, "arithmetic": "1d36da8c1bfd2269"}
    with ResultStore(tmp_path, CONFIG, made_by) as store:
        store.append({"seed": 0})
    with ResultStore(tmp_path, CONFIG, made_by) as store:
        assert store.rows == [{"seed": 0}]
    other = {**made_by, "arithmetic": "2f0cfb9ec0aed0aa"}
    with pytest.raises(BadArgument, match=r"begun where the C library or MuJoCo compute other bits than here, .*--out"):
        ResultStore(tmp_path, CONFIG, other)
    with pytest.raises(BadArgument, match="begun with vuca-nav"):
        ResultStore(tmp_path, CONFIG, {**other, "vuca-nav": "0.2.0"})


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"vuca-nav": "0.2.0"}, 'begun with vuca-nav = "0.1.0", not "0.2.0"'),
        ({"commit": "0123456789ab-dirty"}, 'begun with commit = "0123456789ab", not "0123456789ab-dirty"'),
        ({"commit": None}, 'begun with commit = "0123456789ab", not null'),
        ({"navigator": {"slam": {"beams": 90}}}, "begun with navigator.slam.beams = 60, not 90"),
        ({"noise": {}}, "begun with noise.sigma = 0.01, not null"),
    ],
)
def test_other_code_or_settings_are_refused(changed, text, tmp_path):
    made_by = {**VERSIONS, "commit": "0123456789ab", "navigator": {"slam": {"beams": 60}}, "noise": {"sigma": 0.01}}
    ResultStore(tmp_path, CONFIG, made_by).__exit__()
    ResultStore(tmp_path, CONFIG, made_by).__exit__()
    with pytest.raises(BadArgument) as refused:
        ResultStore(tmp_path, CONFIG, {**made_by, **changed})
    assert text in str(refused.value)
    assert "go on with the same code" in str(refused.value)


def test_rows_without_a_configuration_are_not_mixed_with_ours(tmp_path):
    (tmp_path / "episodes.jsonl").write_text('{"seed": 0}\n')
    with pytest.raises(BadArgument, match=r"no config\.json"):
        ResultStore(tmp_path, CONFIG, VERSIONS)


@pytest.mark.parametrize("line", ["[]", "7", "null"])
def test_a_line_that_is_no_row_is_named(line, tmp_path):
    ResultStore(tmp_path, CONFIG, VERSIONS).__exit__()
    (tmp_path / "episodes.jsonl").write_text(f'{{"seed": 0}}\n{line}\n')
    with pytest.raises(BadArgument, match=r"episodes\.jsonl:2 is not a row"):
        ResultStore(tmp_path, CONFIG, VERSIONS)
    with pytest.raises(BadArgument, match=r"episodes\.jsonl:2 is not a row"):  # the lock was let go
        ResultStore(tmp_path, CONFIG, VERSIONS)


@pytest.mark.parametrize(
    "content",
    ["[1, 2", "[]", "{}", '{"config": [], "made_by": {}}', '{"config": {}, "made_by": 3}', '{"config": {}}'],
)
def test_a_broken_configuration_is_named(content, tmp_path):
    (tmp_path / "config.json").write_text(content)
    with pytest.raises(BadArgument, match=r"config\.json is not the configuration"):
        ResultStore(tmp_path, CONFIG, VERSIONS)


def test_two_writers_are_refused(tmp_path):
    with (
        ResultStore(tmp_path, CONFIG, VERSIONS),
        pytest.raises(BadArgument, match="being written by another vuca eval"),
    ):
        ResultStore(tmp_path, CONFIG, VERSIONS)


def test_a_directory_that_is_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadArgument, match="cannot write"):
        ResultStore(tmp_path / "file", CONFIG, VERSIONS)
    with pytest.raises(BadArgument, match="cannot write"):
        ResultStore(tmp_path / "file" / "below", CONFIG, VERSIONS)


def test_a_row_is_written_whole_or_not_at_all(tmp_path, small_files):
    rows = [{"seed": seed, "pad": "x" * 900} for seed in range(6)]
    path = tmp_path / "episodes.jsonl"
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        for row in rows[:3]:
            store.append(row)
        with small_files(path.stat().st_size + 500), pytest.raises(BadArgument, match="the 3 rows before are whole"):
            store.append(rows[3])  # a part of it fits
        assert rows_of(path) == rows[:3]
        for row in rows[3:]:  # there is room again
            store.append(row)
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        assert store.rows == rows


def test_a_row_that_was_torn_off_is_told(tmp_path, capsys):
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        store.append({"seed": 0})
    with (tmp_path / "episodes.jsonl").open("a") as file:
        file.write('{"see')
    with ResultStore(tmp_path, CONFIG, VERSIONS) as store:
        assert store.rows == [{"seed": 0}]
    assert "episodes.jsonl: dropped a last row" in capsys.readouterr().err
