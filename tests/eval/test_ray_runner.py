"""Episodes on a Ray cluster of this computer."""

import sys

import pytest

from eval.commands import eval_
from eval.evaluate import evaluate
from eval.ray_runner import run_on_ray
from eval.runner import Crash
from eval.suites import SUITES, choose, episodes_of
from tests.eval import jobs
from vuca_nav.cli import main
from vuca_nav.errors import BadArgument

CONFIGS = episodes_of(choose(SUITES["smoke"], ["dwa-dh", "ours"]), seeds=range(2))
IDENTITY = {"suite": "smoke", "seeds": [0, 2]}
NEEDS_RAY = "needs Ray, which has an environment of its own: make test-ray"


def files_of(directory):
    return {name: (directory / name).read_bytes() for name in ("episodes.jsonl", "summary.json")}


@pytest.mark.slow
def test_two_workers_on_ray_give_the_same_files_and_go_on_after_a_kill(tmp_path, monkeypatch):
    pytest.importorskip("ray", reason=NEEDS_RAY)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    evaluate(IDENTITY, CONFIGS, tmp_path / "local", workers=1, job=jobs.episode_by_hash)
    evaluate(IDENTITY, CONFIGS, tmp_path / "ray", workers=2, job=jobs.episode_by_hash, run=run_on_ray)
    assert files_of(tmp_path / "ray") == files_of(tmp_path / "local")
    rows = tmp_path / "ray" / "episodes.jsonl"
    lines = rows.read_bytes().splitlines(keepends=True)
    rows.write_bytes(lines[4] + lines[1] + lines[9][:30])
    evaluate(IDENTITY, CONFIGS, tmp_path / "ray", workers=2, job=jobs.episode_by_hash, run=run_on_ray)
    assert files_of(tmp_path / "ray") == files_of(tmp_path / "local")


@pytest.mark.slow
def test_crashes_on_ray_are_reported_and_threads_are_single(monkeypatch):
    pytest.importorskip("ray", reason=NEEDS_RAY)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    results = list(run_on_ray(CONFIGS, 2, jobs.episode_that_fails_on_seed_1))
    assert sum(isinstance(result, Crash) for result in results) == len(CONFIGS) // 2
    assert {result.error for result in results if isinstance(result, Crash)} == {
        "ZeroDivisionError: seed 1 divides by zero"
    }
    (crash,) = run_on_ray(CONFIGS[:1], 1, jobs.episode_that_kills_its_worker)
    assert isinstance(crash, Crash)
    assert "a worker process or its node died" in crash.error
    (row,) = run_on_ray(CONFIGS[:1], 1, jobs.threads_of_a_worker)
    assert isinstance(row, dict)
    assert set(row["threads"]) == {"1"}


@pytest.mark.slow
def test_a_node_with_other_code_is_refused(monkeypatch):
    pytest.importorskip("ray", reason=NEEDS_RAY)
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr("eval.ray_runner.common", lambda: {"code": "fedcba987654"})
    with pytest.raises(BadArgument, match=r'a node of the cluster has code "\w+", not "fedcba987654"'):
        list(run_on_ray(CONFIGS[:1], 1, jobs.episode_by_hash))


@pytest.mark.slow
def test_an_address_without_a_cluster_is_told(monkeypatch):
    pytest.importorskip("ray", reason=NEEDS_RAY)
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    with pytest.raises(BadArgument, match=r"RAY_ADDRESS=127\.0\.0\.1:1"):
        list(run_on_ray(CONFIGS[:1], 1, jobs.episode_by_hash))


def test_without_ray_it_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ray", None)  # import fails
    with pytest.raises(ModuleNotFoundError):
        eval_(["smoke", "--out", str(tmp_path / "out"), "--backend", "ray"])
    assert main(["eval", "smoke", "--out", str(tmp_path / "out"), "--backend", "ray"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs the package 'ray'" in line
    assert "distributed" in line
    assert not (tmp_path / "out").exists()
