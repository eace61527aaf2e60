import re
from dataclasses import asdict
from typing import Any

import pytest

from eval.analysis.report.cells import cells_of, read_evaluation
from eval.analysis.report.results import bodies, contacts, failures, measures, outcomes, paired_tests
from eval.analysis.report.tables import Share, Table
from eval.episode import EpisodeConfig
from eval.methods import MethodOptions
from tests.eval.analysis.report.synthetic import CONTACT, FAILURE, episodes, row_of, write_evaluation
from vuca_nav.errors import BadArgument

SQUARE: dict[str, Any] = {"world": "square", "robot": "tiago", "method": "ours-dh"}


def cells(tmp_path, *evaluations):
    folders = [write_evaluation(tmp_path / f"e{k}", rows) for k, rows in enumerate(evaluations)]
    return cells_of([read_evaluation(folder) for folder in folders])


def rows_of(table: Table) -> list[list[Any]]:
    return table.rows


def test_disjoint_seeds_of_one_hash_are_joined(tmp_path):
    first, second = episodes(SQUARE, ["success"] * 3), episodes(SQUARE, ["collision"] * 2, first_seed=2003)
    (row,) = rows_of(outcomes(cells(tmp_path, first, second)))
    assert row[:6] == ["square", "tiago", "ours-dh", 5, Share(3, 5), Share(2, 5)]


def test_an_episode_that_two_evaluations_hold_counts_once(tmp_path):
    rows = episodes(SQUARE, ["success"] * 3)
    later = [row | {"real_time_factor": 0.2, "wall_time": 9.0} for row in rows]
    (row,) = rows_of(outcomes(cells(tmp_path, rows, later)))
    assert row[3] == 3


def test_rows_of_other_code_are_another_method(tmp_path):
    rows = episodes(SQUARE, ["success"] * 3)
    found = cells(tmp_path, rows, [row | {"bits": "0123456789abcdef", "outcome": "fall"} for row in rows])
    assert [(cell.method, len(cell.rows)) for cell in found] == [("ours-dh (01234567)", 3), ("ours-dh (ours-dh-)", 3)]


def test_one_hash_with_two_outcomes_is_refused(tmp_path):
    rows = episodes(SQUARE, ["success"] * 2)
    other = [rows[0], row_of(EpisodeConfig(**SQUARE, seed=2001), "collision")]
    with pytest.raises(
        BadArgument,
        match=r"e0 and \S+e1 have the same episode of one hash with different outcome, .*: square, tiago, ours-dh, "
        r"seed 2001; leave out",
    ):
        cells(tmp_path, rows, other)


def test_contacts_by_class_and_by_own_fault(tmp_path):
    rows = episodes(SQUARE, ["success"] + ["collision"] * 4)
    rows[2]["contact"] = CONTACT | {"class": "front", "own": True}
    rows[3]["contact"] = None  # of an older version
    (row,) = rows_of(contacts(cells(tmp_path, rows)))
    # static, stopped, yielding, front, side, rear, not classified
    assert row[3:] == [5, 4, 0, 2, 0, 1, 0, 0, 1, Share(1, 3)]


def test_missions_that_did_not_arrive(tmp_path):
    rows = episodes(SQUARE, ["success", "collision", "timeout", "timeout", "fall"])
    rows[3]["failure"] = FAILURE | {"class": "out_of_time"}
    rows[4]["failure"] = FAILURE | {"class": "fall"}
    (row,) = rows_of(failures(cells(tmp_path, rows)))
    # fall, unreachable, lost, stuck, out of time, not classified
    assert row[3:] == [5, 3, 1, 0, 0, 1, 1, 0]


@pytest.mark.parametrize("change", [{"class": "bent"}, {"own": 1}, {"closing": None}, {"with": 3}])
def test_a_contact_of_another_kind_is_refused(tmp_path, change):
    (row,) = episodes(SQUARE, ["collision"])
    with pytest.raises(BadArgument, match="not the result of an episode"):
        cells(tmp_path, [row | {"contact": CONTACT | change}])


def test_paired_tests_with_holm(tmp_path):
    # Against ours-dh, which arrives 10 times of 10: three methods lose 5, 6 and 0 pairs.
    found = []
    for method, lost in (("ours-dh", 0), ("paper-dh", 5), ("move_base", 6), ("ours", 0)):
        found += episodes({**SQUARE, "method": method}, ["collision"] * lost + ["success"] * (10 - lost))
    table = paired_tests(cells(tmp_path, found))
    rows = {row[2]: dict(zip(table.header[3:], row[3:])) for row in rows_of(table)}
    assert {row["against"] for row in rows.values()} == {"ours-dh"}
    assert (rows["paper-dh"]["p"], rows["move_base"]["p"]) == (2 / 2**5, 2 / 2**6)
    assert (rows["paper-dh"]["mid-p"], rows["move_base"]["mid-p"]) == (1 / 2**5, 1 / 2**6)
    assert rows["move_base"]["Holm's p"] == pytest.approx(3 * 2 / 2**6)
    assert rows["paper-dh"]["Holm's p"] == pytest.approx(2 * 2 / 2**5)
    assert (rows["ours"]["p"], rows["ours"]["E"]) == (1.0, "1")
    assert (rows["move_base"]["only it arrives"], rows["move_base"]["only the other"]) == (0, 6)
    assert rows["move_base"]["success"].value == pytest.approx(-60.0)
    assert rows["move_base"]["collision"].value == pytest.approx(60.0)


def test_the_cost_of_the_body(tmp_path):
    tiago = episodes(SQUARE, ["success"] * 3 + ["collision"], [30.0, 40.0, 50.0, 5.0])
    go2 = episodes({**SQUARE, "robot": "go2"}, ["success"] * 2 + ["fall", "success"], [35.0, 47.0, 8.0, 60.0])
    (row,) = rows_of(bodies(cells(tmp_path, tiago + go2)))
    assert row[:5] == ["square", "go2", "ours-dh", "tiago", 4]
    success, p, collision, fall, time = row[5:]
    assert (success.value, p, collision.value, fall.value) == (0.0, 1.0, -25.0, 25.0)
    assert time.value == pytest.approx(6.0)  # both arrive twice, 5 and 7 s later


def test_interquartile_means_of_worlds_and_of_training_seeds(tmp_path):
    rows = []
    for seed, time in ((1, 30.0), (2, 40.0), (3, 50.0)):
        options: Any = MethodOptions(policy=f"runs/seed-{seed}/policy.safetensors")
        config = asdict(EpisodeConfig(world="square", method="fusion")) | {"options": options}
        rows += episodes({k: v for k, v in config.items() if k != "seed"}, ["success"] * 2, [time - 1.0, time + 1.0])
    rows += episodes({"world": "factory", "region": 1, "method": "ours-dh"}, ["success"] * 4, [10.0, 20.0, 30.0, 1e3])
    rows += episodes(SQUARE, ["timeout"])
    table = measures(cells(tmp_path, rows))
    found = {(row[0], row[2], row[3]): row[4:6] for row in rows_of(table)}
    n, time = found["factory 1", "ours-dh", "episodes"]
    assert (n, time.value) == (4, 25.0)  # the smallest and the greatest of four are left out
    assert found["square", "ours-dh", "episodes"] == [1, None]
    assert found["all worlds", "ours-dh", "episodes"][0] == 5
    ((key, (n, time)),) = [item for item in found.items() if item[0][2] == "training seeds"]
    assert re.search(r"seed-N", key[1])
    assert (n, time.value, time.low, time.high) == (3, 40.0, pytest.approx(30.0, abs=4), pytest.approx(50.0, abs=4))
