"""Sweeps over settings: which set is kept, what the page says, and that every set drives the same missions."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from eval.analysis import tuning
from eval.analysis.summary import MEANS
from eval.analysis.tuning import Tuning, TuningArguments, best_of, page_of, tunings
from eval.method_config import MethodConfig
from eval.suites import Task
from vuca_nav.errors import BadArgument, UnknownName

TASKS = (Task("factory", 1), Task("square"))


def row(world: str, outcome: str, time: float | None = None) -> dict:
    region = 1 if world == "factory" else None
    return {"world": world, "region": region, "movers": None, "outcome": outcome, "arriving_time": time}


ROWS = {
    "slow": [row("factory", "success", 40.0), row("square", "success", 60.0)],
    "fast": [row("factory", "success", 30.0), row("square", "success", 50.0)],
    "wild": [row("factory", "success", 5.0), row("square", "collision")],
    "shy": [row("factory", "timeout"), row("square", "timeout")],
}


def test_the_set_of_which_most_arrived_is_kept_and_of_equals_the_faster():
    assert best_of(ROWS) == "fast"
    assert best_of({name: ROWS[name] for name in ("shy", "wild")}) == "wild"
    assert best_of({"shy": ROWS["shy"]}) == "shy"


def test_the_page_shows_every_set_with_its_counts():
    page = page_of(Tuning("paper", {}, TASKS, range(700, 702)), ROWS, "python -m x")
    assert "seeds 700 to 701" in page
    assert "Kept: **fast**" in page
    lines = {line.split(" | ")[0].strip("|* "): line for line in page.splitlines() if line.startswith("| ")}
    assert lines["settings"] == "| settings | factory 1 | square | all | collision | time-out | time |"
    assert lines["fast"] == "| **fast** | 1/1 | 1/1 | 2/2 [34-100%] | 0 | 0 | 40.0 |"
    assert lines["wild"] == "| wild | 1/1 | 0/1 | 1/2 [9-91%] | 1 | 0 | 5.0 |"
    assert lines["shy"] == "| shy | 0/1 | 0/1 | 0/2 [0-66%] | 0 | 2 | - |"


def test_sweeps_are_over_seeds_of_which_nothing_is_reported():
    assert set(tunings()) == {"paper", "move_base"}
    for each in tunings().values():
        assert (each.seeds.start, each.seeds.stop) == (700, 720)
        assert len(set(map(repr, each.sets.values()))) == len(each.sets) >= 5


def test_every_set_drives_the_same_missions(tmp_path, monkeypatch):
    asked = []

    def run_episodes(configs, workers, job):
        method = job.args[0]
        asked.append((method.gamma, [(c.world, c.region, c.seed, c.method) for c in configs]))
        for config in configs:
            arrives = method.gamma == 2.0
            metrics = dict.fromkeys((*MEANS, "way"), None)
            yield config.row() | metrics | {"outcome": "success" if arrives else "collision", "arriving_time": 3.0}

    paper = tunings()["paper"]
    config = paper.sets["gamma 2"]
    assert isinstance(config, MethodConfig)
    sets = {"one": replace(config, gamma=1.0), "two": config}
    monkeypatch.setattr(tuning, "tunings", lambda: {"paper": paper._replace(sets=sets, tasks=TASKS)})
    monkeypatch.setattr("eval.evaluate.run_episodes", run_episodes)
    monkeypatch.setattr(sys, "argv", ["tuning", "paper"])
    out = tmp_path / "page.md"
    arguments = TuningArguments("paper", tmp_path / "runs", out, seeds="700:702", workers=1)
    tuning.main(arguments)
    missions = [(task.world, task.region, seed, "paper") for seed in (700, 701) for task in TASKS]
    assert asked == [(1.0, missions), (2.0, missions)]
    assert "Kept: **two**" in out.read_text()
    tuning.main(arguments)  # it goes on where it was: there is nothing left to run
    assert len(asked) == 2


def test_what_cannot_be_asked_for_is_refused(tmp_path):
    with pytest.raises(UnknownName, match="unknown sweep 'papers'; did you mean 'paper'"):
        tuning.main(TuningArguments("papers", tmp_path, tmp_path / "p.md"))
    with pytest.raises(BadArgument, match="--workers must be 1 or more"):
        tuning.main(TuningArguments("paper", tmp_path, Path("p.md"), workers=0))
