"""Rows that are kept for good."""

import json
import lzma
from dataclasses import replace

import pytest

from eval import kept
from eval.analysis.compare import read_methods
from eval.analysis.report.cells import read_evaluation
from eval.commands import report
from eval.episode import EpisodeConfig
from eval.methods import MethodOptions
from tests.eval.jobs import episode_by_hash
from vuca_nav.errors import BadArgument

OURS = EpisodeConfig(world="square", robot="go2", method="ours", options=MethodOptions(gamma=0.0))
DRL = EpisodeConfig(world="square", robot="go2", method="drl")
HASHES = {"ours": "0123456789abcdef", "drl": "fedcba9876543210"}


def evaluation(folder, configs, seeds, **changes):
    """A directory of ``vuca eval``."""
    folder.mkdir(parents=True)
    stored = {
        "suite": "crowd",
        "robots": ["go2"],
        "methods": ["ours --gamma 0.0", "drl"],
        "tasks": [{"world": "square"}],
    }
    stored |= {"configurations": {"ours --gamma 0.0": {"gamma": 0.0}, "drl": {}}, "seeds": [0, 9], "episodes": 18}
    made_by = {"code": "c0de", "settings": {"go2, ours --gamma 0.0": {"a": 1}, "go2, drl": {"b": 2}}}
    run = {"began": f"2026-01-0{seeds.start + 1}", "command": f"vuca eval crowd --out {folder}", "commit": "0123"}
    (folder / "config.json").write_text(json.dumps({"config": stored, "made_by": made_by, "runs": [run]}))
    rows = [
        {**episode_by_hash(replace(config, seed=seed)), "bits": HASHES[config.method], "wall_time": seed, **changes}
        for seed in seeds
        for config in configs
    ]
    (folder / "episodes.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    return folder


def test_a_file_for_each_robot_and_method_with_the_rows_of_all_seeds(tmp_path):
    first = evaluation(tmp_path / "first", [OURS, DRL], range(3))
    second = evaluation(tmp_path / "second", [OURS], range(3, 5))
    drl, ours = kept.keep_rows([second, first], tmp_path / "rows")
    assert drl.name == "crowd-go2-drl-fedcba9876543210.jsonl.xz"
    assert ours.name == "crowd-go2-ours-gamma-0.0-0123456789abcdef.jsonl.xz"
    head, *rows = [json.loads(line) for line in lzma.decompress(ours.read_bytes()).splitlines()]
    assert [row["seed"] for row in rows] == [0, 1, 2, 3, 4]
    assert {key: head["config"][key] for key in ("suite", "robots", "methods", "seeds", "episodes")} == {
        "suite": "crowd", "robots": ["go2"], "methods": ["ours --gamma 0.0"], "seeds": [0, 5], "episodes": 5,
    }  # fmt: skip
    assert head["config"]["configurations"] == {"ours --gamma 0.0": {"gamma": 0.0}}
    assert head["made_by"]["settings"] == {"go2, ours --gamma 0.0": {"a": 1}}
    assert [run["command"] for run in head["runs"]] == [f"vuca eval crowd --out runs/{n}" for n in ("first", "second")]
    assert str(tmp_path) not in lzma.decompress(ours.read_bytes()).decode()


def test_the_same_rows_give_the_same_bytes_and_more_are_added(tmp_path):
    first = evaluation(tmp_path / "first", [OURS], range(3))
    second = evaluation(tmp_path / "second", [OURS], range(2, 5), wall_time=7.0)
    (whole,) = kept.keep_rows([first, second], tmp_path / "whole")
    (added,) = kept.keep_rows([first], tmp_path / "added")
    assert kept.keep_rows([second], tmp_path / "added") == [added]
    assert added.read_bytes() == whole.read_bytes()
    (again,) = kept.keep_rows([whole], tmp_path / "again")
    assert again.read_bytes() == whole.read_bytes()


def test_many_rows_go_into_several_files(tmp_path, monkeypatch):
    monkeypatch.setattr(kept, "MOST_ROWS", 2)
    first = evaluation(tmp_path / "first", [DRL], range(3))
    written = kept.keep_rows([first], tmp_path / "rows")
    assert [path.name.partition("-part-")[2] for path in written] == ["", "2.jsonl.xz"]
    written = kept.keep_rows([evaluation(tmp_path / "second", [DRL], range(3, 6))], tmp_path / "rows")
    assert [len(read_evaluation(path).rows) for path in written] == [2, 2, 2]
    assert [read_evaluation(path).stored.config["seeds"] for path in written] == [[0, 2], [2, 4], [4, 6]]


def test_kept_rows_are_read_like_a_directory(tmp_path, capsys):
    folder = evaluation(tmp_path / "first", [OURS, DRL], range(3))
    assert report([str(folder), "--out", str(tmp_path / "out"), "--rows", "--json"]) == 0
    files = json.loads(capsys.readouterr().out.splitlines()[-1])["files"]
    rows = sorted((tmp_path / "out" / "rows").iterdir())
    assert set(map(str, rows)) <= set(files)
    methods = read_methods(rows)
    assert [len(episodes) for episodes in methods.values()] == [3, 3]
    assert report([*map(str, rows), "--out", str(tmp_path / "again")]) == 0
    assert "| commit | 0123 |" in (tmp_path / "again" / f"{kept.name_of(rows[0])}.md").read_text()


def test_rows_that_do_not_go_together_are_refused(tmp_path):
    first = evaluation(tmp_path / "first", [OURS], range(3))
    other = evaluation(tmp_path / "other", [OURS], range(2, 4), path_length=9.0)
    with pytest.raises(BadArgument, match="other: seed 2 has two rows of one hash that differ"):
        kept.keep_rows([first, other], tmp_path / "rows")
    rows = first / "episodes.jsonl"
    rows.write_text(rows.read_text().replace('"bits"', '"bit"'))
    with pytest.raises(BadArgument, match="row 1 does not say what decided on its bits"):
        kept.keep_rows([first], tmp_path / "rows")
    torn = tmp_path / "torn.jsonl.xz"
    for content in (b"junk", lzma.compress(b'{"config": {}}\n' * 9)[:-20], lzma.compress(b"[]\n")):
        torn.write_bytes(content)
        with pytest.raises(BadArgument, match="torn"):
            read_evaluation(torn)
