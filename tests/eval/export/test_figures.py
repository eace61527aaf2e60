"""The figures of a manifest are those of the kept rows and of the cards."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from eval.analysis.statistics import wilson_interval
from eval.export.figures import ROWS, evaluation_figures, training_figures
from eval.method_config import MethodConfig
from eval.methods import resolve
from tests.vuca_nav.random_policy import random_policy

TABLE = ROWS.parent / "paper-system" / "tables" / "outcomes.csv"


@pytest.mark.parametrize(("robot", "method"), [("tiago", "ours"), ("go2", "paper")])
def test_the_outcomes_are_those_of_the_reports_table(robot, method):
    with TABLE.open(newline="") as file:
        table = [row for row in csv.DictReader(file) if (row["robot"], row["method"]) == (robot, method)]
    evaluations = evaluation_figures(robot, method, resolve(method))["evaluations"]
    told = {(group["world"], group["region"]): group for evaluation in evaluations for group in evaluation["of"]}
    assert len(told) == len(table) > 0
    for row in table:
        world, _, region = row["world"].partition(" ")
        group = told[world, int(region) if region else None]
        assert group["episodes"] == int(row["episodes"])
        count = group["success"]["count"]
        assert row["success"].startswith(str(count))
        assert group["success"]["interval"] == pytest.approx(wilson_interval(count, group["episodes"]))


def test_rows_of_other_weights_do_not_count(tmp_path):
    config = resolve("ours")
    assert isinstance(config, MethodConfig)
    other = replace(config, weights=random_policy(tmp_path / "w.safetensors"))
    figures = evaluation_figures("tiago", "ours", other)
    assert figures["evaluations"] is None
    assert "none of ours on tiago with these weights" in figures["reason"]


def test_weights_without_a_card_are_told_as_such(tmp_path):
    weights = random_policy(tmp_path / "w.safetensors")
    told = training_figures(weights, {"seed": "3", "observation": "{}"})
    assert told == {"weights": "w", "seed": "3", "card": None, "reason": "there is no card beside the weights"}


def test_the_card_of_a_training_of_ones_own_is_read(tmp_path: Path):
    (tmp_path / "card.md").write_text(
        "# mine\n\n- Steps: 5\n- Arena: `{}`\n\n| reached | collided |\n|---|---|\n| 80.0% | 20.0% |\n"
    )
    told = training_figures(random_policy(tmp_path / "w.safetensors"), {})
    assert told["card"] == {"Steps": "5"}
    assert (told["at_the_end"]["reached"], told["at_the_end"]["interval"]) == ("80.0%", None)
