from typing import Any

import pytest

from eval.analysis.report.cells import cells_of, read_evaluation
from eval.analysis.report.claims import CLAIMS, Claim, claims_table
from eval.analysis.report.comparisons import Comparison, Evidence
from tests.eval.analysis.report.synthetic import episodes, write_evaluation

PLACES = [{"world": "factory", "region": region} for region in (1, 2, 3, 4)] + [{"world": "square"}]


def answers(tmp_path, rows, claims=CLAIMS) -> dict[tuple, Any]:
    cells = cells_of([read_evaluation(write_evaluation(tmp_path / "e", rows))])
    return {(row[0], row[1]): row[3:] for row in claims_table(Evidence(cells), claims).rows}


def runs(method, outcomes, times=None, places=PLACES):
    return [row for place in places for row in episodes({**place, "method": method}, outcomes, times)]


def test_a_share_against_its_bound(tmp_path):
    well = Comparison("it arrives", "success", ("drl",), True, 0.8, ("square",))
    fails = well._replace(more=False, bound=0.2)
    claims = [
        Claim("well", "paper", "paper-system", (well,)),
        Claim("fails", "paper", "paper-system", (fails,)),
        Claim("both", "paper", "paper-system", (well, well._replace(more=False))),
    ]
    # Wilson's interval of 29 of 30 is 83 to 99%.
    found = answers(tmp_path, runs("drl", ["success"] * 29 + ["collision"]), claims)
    assert [found[name, "paper"][0] for name in ("well", "fails", "both")] == ["yes", "no", "no"]
    assert "97% [83, 99] (claimed: more than 80%) in 30 episodes: holds" in found["well", "paper"][1]
    # That of 28 of 30 is 79 to 98%.
    less = answers(tmp_path / "less", runs("drl", ["success"] * 28 + ["collision"] * 2), claims)
    assert less["well", "paper"][0] == "undecided"


@pytest.mark.parametrize(
    ("lost", "answer"),
    [(12, "yes"), (0, "undecided"), (-12, "no")],
)
def test_success_in_pairs(tmp_path, lost, answer):
    weak, strong = ["timeout"] * abs(lost) + ["success"] * (20 - abs(lost)), ["success"] * 20
    rows = runs("paper-dh", weak if lost >= 0 else strong) + runs("paper", strong if lost >= 0 else weak)
    found = answers(tmp_path, rows)["V^h raises success", "paper"]
    assert found[0] == answer
    assert "in 100 pairs" in found[1]
    assert found[2] is None


def test_times_where_both_arrive(tmp_path):
    slow = [50.0 + k for k in range(20)]
    rows = runs("move_base", ["success"] * 20, slow) + runs("move_base+dh", ["success"] * 20, [t - 5.0 for t in slow])
    found = answers(tmp_path, rows)["D^h shortens the arriving time", "both systems"]
    assert found[:2] == ["yes", "move_base+dh arrives sooner than move_base: -5.0 s [-5.0, -5.0] in 100 pairs: holds"]
    few = runs("move_base", ["success"] * 3, slow) + runs("move_base+dh", ["success"] * 3, [t - 5.0 for t in slow])
    assert answers(tmp_path / "few", few)["D^h shortens the arriving time", "both systems"][0] == "undecided"


def test_missing_rows_leave_a_claim_open_and_say_what_makes_them(tmp_path):
    rows = runs("paper-dh", ["timeout"] * 20, places=PLACES[:2]) + runs("paper", ["success"] * 20, places=PLACES[:2])
    answer, because, command = answers(tmp_path, rows)["V^h raises success", "paper"]
    assert answer == "undecided"
    assert "in 40 pairs, without paper in factory 3, paper-dh in factory 3, paper in factory 4" in because
    assert command.startswith("vuca eval paper-system --robot tiago --method ")
    assert command.endswith(" --out runs/paper-system-tiago")
    methods = command.split()[6].split(",")
    assert len(set(methods)) == len(methods)
    assert {"paper", "paper-dh", "move_base", "ours"} <= set(methods)


def test_every_claim_is_of_methods_and_worlds_that_there_are():
    from eval.methods import METHODS
    from eval.suites import SUITES

    for claim in CLAIMS:
        assert claim.suite in SUITES or claim.suite in ("gate", "heatmap")
        for comparison in claim.comparisons:
            if isinstance(comparison, Comparison):
                assert set(comparison.methods) <= METHODS.keys()
    assert {claim.system for claim in CLAIMS} == {"paper", "ours", "both systems"}


def test_rows_of_other_tasks_make_no_table_of_open_answers(tmp_path):
    still = {"world": "factory", "region": 1, "without": "U"}
    assert answers(tmp_path, runs("ours", ["success"] * 20, places=[still])) == {}
