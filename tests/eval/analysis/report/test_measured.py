"""What a report makes of measurements and of the choice of branch and of default: hand-worked rows."""

import json
from typing import Any

import pytest

from eval.analysis.measurements.files import keep_measurements, read_measurement
from eval.analysis.report.branch import branch_table
from eval.analysis.report.cells import cells_of, read_evaluation
from eval.analysis.report.claims import CLAIMS, claims_table
from eval.analysis.report.comparisons import BEHAVIOURS, Evidence
from eval.analysis.report.default import default_table
from eval.analysis.report.moments import moments_table
from eval.analysis.report.pages import write_reports
from eval.commands import report
from tests.eval.analysis.report.measured import (
    course_row,
    gate_row,
    heatmap_row,
    moment_row,
    view,
    write_each,
    write_measurement,
)
from tests.eval.analysis.report.synthetic import episodes, write_evaluation
from vuca_nav.errors import BadArgument

BRANCH = "robots take the quiet branch"
GATE = "each behaviour has a leading expert"
HEATMAP = "open space is safer in the heatmap"


def answers(evidence) -> dict[tuple, Any]:
    return {(row[0], row[1], row[2]): row[3:] for row in claims_table(evidence).rows}


def evidence_of(tmp_path, rows=(), kind=None, measured=()):
    rows = rows or episodes({"world": "square"}, ["success"])
    cells = cells_of([read_evaluation(write_evaluation(tmp_path / "e", rows))])
    files = [read_measurement(write_measurement(tmp_path / "m.jsonl", kind, measured))] if kind else []
    return Evidence(cells, files)


def branches(method, quiet_of):
    """20 seeds with 0, 4, 8 and 12 movers; ``quiet_of`` gives the number that take the quiet branch."""
    rows = []
    for movers, quiet in quiet_of.items():
        found = episodes({"world": "double_branch", "method": method, "movers": movers}, ["success"] * 20)
        rows += [{**row, "way": "quiet" if k < quiet else "short"} for k, row in enumerate(found)]
    return rows


@pytest.mark.parametrize(
    ("ours", "bare", "answer"),
    [
        ({0: 0, 4: 8, 8: 18, 12: 20}, {0: 0, 4: 0, 8: 0, 12: 0}, "yes"),
        ({0: 0, 4: 8, 8: 18, 12: 20}, {0: 0, 4: 8, 8: 18, 12: 20}, "undecided"),  # as much without V^h
        ({0: 20, 4: 20, 8: 20, 12: 20}, {0: 0, 4: 0, 8: 0, 12: 0}, "undecided"),  # whatever moves
        ({0: 0, 4: 0, 8: 0, 12: 0}, {0: 0, 4: 0, 8: 0, 12: 0}, "no"),
        ({0: 20, 4: 20, 8: 0, 12: 0}, {0: 0, 4: 0, 8: 0, 12: 0}, "no"),
    ],
)
def test_the_quiet_branch(tmp_path, ours, bare, answer):
    evidence = evidence_of(tmp_path, branches("ours", ours) + branches("ours-dh", bare))
    found = answers(evidence)[BRANCH, "ours", "tiago"]
    assert found[0] == answer
    if answer == "yes":
        # 18 and 20 of 20 with many movers, 0 and 8 with few: 95% less 20%.
        assert "ours takes it more often with many movers than with few: +75 points" in found[1]
        assert "that rises more than with ours-dh: +75 points" in found[1]
        assert "ours takes it in double_branch, 12 movers: 100% [84, 100] (claimed: more than 50%)" in found[1]


def test_the_quiet_branch_needs_all_its_rows(tmp_path):
    evidence = evidence_of(tmp_path, branches("paper", {0: 0, 4: 0, 8: 20}) + branches("paper-dh", {0: 0, 4: 0, 8: 0}))
    answer, because, command = answers(evidence)[BRANCH, "paper", "tiago"]
    assert answer == "undecided"
    assert "no rows" in because
    assert command == (
        "vuca eval paper-branch --robot tiago --method paper,paper-dh,ours,ours-dh --out runs/paper-branch-tiago"
    )


def test_the_table_of_branches(tmp_path):
    rows = branches("ours", {4: 5, 0: 0})
    rows[0]["way"] = None
    rows_told: list[list[Any]] = branch_table(evidence_of(tmp_path, rows).cells).rows
    none, five = rows_told
    assert none[:4] == ["tiago", "ours", 0, 20]
    assert [five[k] for k in (2, 3)] == [4, 20]
    assert (five[4].count, five[5].count, five[6]) == (4, 15, 1)


def heatmaps(plain, at_same, seeds=20):
    return [heatmap_row(3000 + k, plain + 0.01 * (k % 3), at_same + 0.01 * (k % 3)) for k in range(seeds)]


@pytest.mark.parametrize(
    ("rows", "answer"),
    [
        (heatmaps(0.3, 0.2), "yes"),
        (heatmaps(0.3, -0.01), "undecided"),
        (heatmaps(0.3, -0.2), "no"),
        (heatmaps(-0.3, 0.2), "no"),
        (heatmaps(0.3, 0.2, 9), "undecided"),
    ],
)
def test_the_heatmap(tmp_path, rows, answer):
    found = answers(evidence_of(tmp_path, (), "heatmap", rows))
    assert found[HEATMAP, "ours", "tiago"][0] == answer
    assert found[HEATMAP, "paper", "tiago"][0] == "undecided"
    assert found[HEATMAP, "paper", "tiago"][2] == (
        "python -m eval.analysis.measurements.openness --robot tiago --method paper --seeds 3000:3020 "
        "--out runs/heatmap-tiago-paper.jsonl"
    )


def test_a_mean_of_correlations(tmp_path):
    rows = [heatmap_row(3000 + k, value, value) for k, value in enumerate([0.1, 0.2, 0.3] * 4)]
    rows += [heatmap_row(3000, None, None), heatmap_row(3001, 0.9, 0.9, method="paper")]
    found = answers(evidence_of(tmp_path, (), "heatmap", rows))[HEATMAP, "ours", "tiago"][1]
    # Of 12 values with a spread of 0.0853 the half width is 2.201 * 0.0853 / sqrt(12).
    assert found.startswith("V^h rises with the clearance: +0.20 [+0.15, +0.25] in 12 seeds: holds")


def gates(leads_of, policy="fusion-plus"):
    return [gate_row(seed, policy, leads_of) for seed in range(80)]


def test_the_gate(tmp_path):
    taught = {name: [0, 0, 0, 0] for name in BEHAVIOURS}
    for k, name in enumerate(BEHAVIOURS):
        taught[name][k % 4] = 9
        taught[name][(k + 1) % 4] = 1
    found = answers(evidence_of(tmp_path, (), "gate", gates(taught)))
    answer, because, command = found[GATE, "ours", "all"]
    assert (answer, command) == ("yes", None)
    assert because.startswith("in open floor, expert 1 leads: 90% [90, 90] (claimed: more than 50%) in 40 episodes")
    assert "not the same everywhere: in " in because
    assert found[GATE, "paper", "all"][2] == (
        "python -m train.analysis.gate vuca_nav/policy/weights/paper.safetensors --out runs/gate"
    )
    one = {name: [8, 1, 1, 0] for name in BEHAVIOURS}
    same = evidence_of(tmp_path / "one", (), "gate", gates(one))
    assert answers(same)[GATE, "ours", "all"][0] == "no"  # one expert leads whatever the situation
    split = {**taught, "dead end": [4, 3, 2, 1]}
    assert answers(evidence_of(tmp_path / "split", (), "gate", gates(split)))[GATE, "ours", "all"][0] == "no"


def test_policies_of_more_and_of_fewer_experts(tmp_path):
    rows = [gate_row(seed, "fusion-plus", {n: [9, 1] if seed % 4 < 2 else [9, 0, 1] for n in BEHAVIOURS})
            for seed in range(80)]  # fmt: skip
    because = answers(evidence_of(tmp_path, (), "gate", rows))[GATE, "ours", "all"][1]
    assert because.startswith("in open floor, expert 1 leads: 90% [90, 90]")


def test_the_leader_is_not_chosen_where_it_is_measured(tmp_path):
    # In the even half expert 1 leads all, in the odd half expert 2: chosen there, it would lead.
    rows = [gate_row(seed, "fusion-plus", {n: [9, 1] if seed % 2 == 0 else [1, 9] for n in BEHAVIOURS})
            for seed in range(80)]  # fmt: skip
    answer, because, _ = answers(evidence_of(tmp_path, (), "gate", rows))[GATE, "ours", "all"]
    assert answer == "no"
    assert because.startswith("in open floor, expert 1 leads: 10% [10, 10]")


def test_the_behaviours_are_the_situations_of_the_gate():
    from train.analysis.situations import SITUATIONS

    assert {*BEHAVIOURS, "other"} == set(SITUATIONS)
    assert {claim.suite for claim in CLAIMS} >= {"gate", "heatmap", "paper-branch"}


def test_the_last_avoidable_moments():
    rows = [
        moment_row(1, 0.5, True), moment_row(2, 1.0, False), moment_row(3, 3.5, False), moment_row(4, None, False),
        moment_row(5, 0.5, False, t_inevitable_is_certain=False), moment_row(6, None, True, contact=None),
    ]  # fmt: skip
    table = moments_table(rows)
    assert table.header[4:] == [
        "collisions", "to 0.5 s", "to 1 s", "to 1.5 s", "to 2 s", "to 2.5 s", "to 3 s", "earlier", "never", "uncertain",
        "not repeated",
    ]  # fmt: skip
    assert [row[2:] for row in table.rows] == [
        ["ours", "all", 6, 2, 1, 0, 0, 0, 0, 1, 1, 1, 1],
        ["ours", "own", 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        ["ours", "not own", 4, 1, 1, 0, 0, 0, 0, 1, 1, 1, 0],
        ["ours", "unknown", 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    ]


def suites(tmp_path, outcomes):
    """An evaluation for each suite: outcomes of ours-dh and of ours by robot."""
    found = []
    for suite, by_robot in outcomes.items():
        rows = []
        for robot, (first, second) in by_robot.items():
            world = {"world": "building"} if suite == "building" else {"world": "square"}
            rows += episodes({**world, "robot": robot, "method": "ours-dh"}, first)
            rows += episodes({**world, "robot": robot, "method": "ours"}, second)
        found.append(read_evaluation(write_evaluation(tmp_path / suite, rows, suite)))
    return found


GOOD, BAD = ["success"] * 12, ["timeout"] * 12


def test_which_default(tmp_path):
    table = default_table(suites(tmp_path, {
        "paper-system": {"tiago": (GOOD, GOOD), "go2": (GOOD, BAD)}, "building": {"tiago": (GOOD, BAD)}
    }))  # fmt: skip
    assert [row[:4] for row in table.rows] == [
        ["all", "all", 36, 12], ["all", "go2", 12, 12], ["all", "tiago", 24, 12], ["paper-system", "all", 24, 12],
        ["paper-system", "go2", 12, 12], ["paper-system", "tiago", 12, 12], ["building", "tiago", 12, 12],
    ]  # fmt: skip
    by_name: dict[tuple, Any] = {tuple(row[:2]): row for row in table.rows}
    # 12 seeds in which only ours-dh arrives: p = 2 / 2^12; adjusted for three lines.
    assert by_name["building", "tiago"][9:] == [2 / 2**12, pytest.approx(6 / 2**12), "ours-dh"]
    assert by_name["paper-system", "tiago"][9:] == [1.0, 1.0, "undecided"]
    # A seed counts once, whatever the number of its episodes.
    assert by_name["all", "all"][9:] == [2 / 2**12, None, "ours-dh"]
    assert by_name["all", "all"][6].value == pytest.approx(-200 / 3)
    assert table.note.endswith("Answer: ours-dh.")


@pytest.mark.parametrize(
    ("building", "system", "answer"),
    [
        ((GOOD, BAD), (BAD, GOOD), "Answer: undecided: neither is better in all suites together on all robots; ours in "
                                   "paper-system on tiago; ours-dh in building on tiago."),
        ((GOOD, GOOD), (BAD, GOOD), "Answer: ours."),
        ((GOOD, GOOD), (GOOD, GOOD), "Answer: undecided: neither is better in all suites together on all robots."),
    ],
)  # fmt: skip
def test_the_answer_to_which_default(tmp_path, building, system, answer):
    found = suites(tmp_path, {"paper-system": {"tiago": system}, "building": {"tiago": building}})
    assert default_table(found).note.endswith(answer)


def test_a_method_that_is_better_but_not_everywhere(tmp_path):
    crowd, long = ["timeout"] * 40, ["success"] * 40
    found = suites(tmp_path, {"paper-system": {"tiago": (crowd, long)}, "building": {"tiago": (GOOD, BAD)}})
    assert default_table(found).note.endswith(
        "Answer: ours in all suites together, but it is worse in building on tiago."
    )


@pytest.fixture
def measured(tmp_path):
    """A file of each kind of measurement."""
    return write_each(tmp_path)


def test_a_report_with_measurements(tmp_path, measured):
    folder = write_evaluation(tmp_path / "e", branches("ours", {0: 2, 4: 9}))
    written = write_reports([*measured, folder], tmp_path / "out")
    names = {path.name for path in written}
    assert {
        "moments.csv", "branch.csv", "gate.svg", "gate-tiago.svg", "heatmap-tiago.svg", "courses-tiago.svg",
        "branch-tiago.svg",
    } <= names  # fmt: skip
    before = {path: path.read_bytes() for path in written}
    write_reports([folder, *reversed(measured)], tmp_path / "out")
    assert {path: path.read_bytes() for path in written} == before
    index = (tmp_path / "out" / "index.md").read_text()
    assert "## Measured: courses" in index
    assert "| command | `python -m made.up --out runs/courses.jsonl` |" in index
    assert (tmp_path / "out" / "figures" / "courses-tiago.svg").stat().st_size < 60_000


def test_kept_measurements_are_read_like_files(tmp_path, measured):
    folder = write_evaluation(tmp_path / "e", branches("ours", {0: 2, 4: 9}))
    assert report([str(folder), *map(str, measured), "--out", str(tmp_path / "out"), "--rows"]) == 0
    kept = sorted((tmp_path / "out" / "rows").iterdir())
    assert len(kept) == 5
    write_reports(kept, tmp_path / "again")
    for name in ("figures/courses-tiago.svg", "tables/moments.csv", "tables/claims.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    again = keep_measurements(kept, tmp_path)
    assert {path.read_bytes() for path in again} <= {path.read_bytes() for path in kept}


@pytest.mark.parametrize(
    ("kind", "row", "words"),
    [
        ("moments", {"seed": 1}, "line 2: world, region"),
        ("courses", {**course_row("ours"), "path": [[1.0, "x"]]}, "line 2: path is"),
        ("courses", {**course_row("ours"), "path": []}, "line 2: path is"),
        ("heatmap", heatmap_row(1, 0.1, 0.1, view={**view(), "half_side": "x"}), "line 2: view is"),
        ("courses", {**course_row("ours"), "scene": {}}, "line 2: scene is"),
        ("heatmap", {**heatmap_row(1, 0.1, 0.1), "moments": [{"time": 1.0}]}, "line 2: moments is"),
        ("gate", {"policy": "p", "kind": "k", "seed": 1, "situations": {"a": {}}}, "line 2: situations is"),
        ("weather", {}, "its first line names none of moments, heatmap, courses, lost, gate"),
    ],
)
def test_damaged_measurements_are_refused(tmp_path, kind, row, words):
    path = write_measurement(tmp_path / "m.jsonl", kind, [row])
    folder = write_evaluation(tmp_path / "e", episodes({"world": "square"}, ["success"]))
    with pytest.raises(BadArgument, match=words):
        write_reports([folder, path], tmp_path / "out")


def test_measurements_alone_are_no_report(tmp_path, measured):
    with pytest.raises(BadArgument, match="give one or more directories of vuca eval beside"):
        write_reports(measured, tmp_path / "out")


def test_a_damaged_view_is_refused(tmp_path):
    damaged = heatmap_row(1, 0.1, 0.1, view={**view(), "levels": "%"})
    path = write_measurement(tmp_path / "m.jsonl", "heatmap", [damaged])
    folder = write_evaluation(tmp_path / "e", episodes({"world": "square"}, ["success"]))
    with pytest.raises(BadArgument, match="view is damaged"):
        write_reports([folder, path], tmp_path / "out")


def test_a_torn_last_line_is_left_out(tmp_path):
    path = write_measurement(tmp_path / "m.jsonl", "gate", [gate_row(1, "paper", {"open floor": [3, 1]})])
    with path.open("a") as file:
        file.write(json.dumps(gate_row(2, "paper", {}))[:20])
    assert len(read_measurement(path).rows) == 1
