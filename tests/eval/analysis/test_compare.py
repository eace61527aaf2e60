import json

import numpy as np
import pytest

from eval.analysis.compare import by_method, compare, read_methods, read_rows, table
from eval.analysis.statistics import paired_difference
from eval.commands import compare as compare_command
from vuca_nav.errors import BadArgument, UnknownName

TASK = {"world": "square", "region": None, "movers": 8, "without": "", "robot": "go2", "start": None, "goal": None}


def evaluation(folder, outcomes, **task):
    """A directory with an episode of seed 0, 1, ... for each outcome; None leaves one out."""
    folder.mkdir(exist_ok=True)
    rows = [{**TASK, **task, "seed": k, "outcome": outcome} for k, outcome in enumerate(outcomes) if outcome]
    with open(folder / "episodes.jsonl", "a") as file:
        file.writelines(json.dumps(row) + "\n" for row in rows)
    return folder


def read_episodes(folder, seeds=None):
    """The episodes of a directory of one method."""
    (episodes,) = by_method(read_rows(folder, seeds)).values()
    return episodes


def test_pairs_are_of_the_same_episode(tmp_path):
    a = evaluation(tmp_path / "a", ["success", "collision", "collision", "timeout", "success"])
    b = evaluation(tmp_path / "b", [None, "success", "success", "success", "collision", "success"])
    (name, row), *others = compare(read_episodes(a), read_episodes(b)).items()
    assert not others
    assert name == "go2, square, 8 movers"
    assert row.pairs == 4
    first, second = [False, False, False, True], [True, True, True, False]
    assert row.of["success"] == paired_difference(np.array(first), np.array(second))
    assert row.of["success"][0] == pytest.approx(0.5)
    assert row.of["collision"][0] == pytest.approx(-0.25)
    assert row.of["timeout"][0] == pytest.approx(-0.25)


def test_tasks_are_told_apart_and_added_up(tmp_path):
    a, b = tmp_path / "a", tmp_path / "b"
    for movers, before, after in ((8, "collision", "success"), (16, "success", "success")):
        evaluation(a, [before] * 3, movers=movers)
        evaluation(b, [after] * 3, movers=movers)
    differences = compare(read_episodes(a), read_episodes(b))
    assert [(name, row.pairs, row.of["success"][0]) for name, row in differences.items()] == [
        ("go2, square, 8 movers", 3, 1.0),
        ("go2, square, 16 movers", 3, 0.0),
        ("all", 6, 0.5),
    ]
    assert "| all | 6 of 3 seeds | +50 [" in table("b", "a", differences)


def test_a_seed_in_several_tasks_is_one_observation(tmp_path):
    a, b = tmp_path / "a", tmp_path / "b"
    before, after = ["collision", "success", "success"], ["success", "success", "collision"]
    for movers in (8, 16, 24, 40):  # the same comes of a seed, whatever the number of movers
        evaluation(a, before, movers=movers)
        evaluation(b, after, movers=movers)
    differences = compare(read_episodes(a), read_episodes(b))
    assert (differences["all"].pairs, differences["all"].seeds) == (12, 3)
    assert differences["all"].of == differences["go2, square, 8 movers"].of


def test_a_body_that_falls_less_is_seen_to(tmp_path):
    a = evaluation(tmp_path / "a", ["fall", "fall", "success", "fall"])
    b = evaluation(tmp_path / "b", ["timeout", "success", "success", "fall"])
    differences = compare(read_episodes(a), read_episodes(b))
    (row,) = differences.values()
    assert {name: of[0] for name, of in row.of.items()} == {
        "success": 0.25,
        "collision": 0.0,
        "fall": -0.5,
        "timeout": 0.25,
    }
    header, _, line = table("b", "a", differences).splitlines()[2:]
    assert header == "| task | pairs | success | collision | fall | timeout |"
    assert line.split(" | ")[4].startswith("-50 [")


def test_only_some_seeds(tmp_path):
    a = evaluation(tmp_path / "a", ["success"] * 6)
    assert len(read_episodes(a, range(2, 5))) == 3
    with pytest.raises(BadArgument, match="of these seeds"):
        read_episodes(a, range(7, 9))


def test_p_values_are_of_independent_pairs(tmp_path):
    a, b = tmp_path / "a", tmp_path / "b"
    for movers in (8, 16):
        evaluation(a, ["collision"] * 5, movers=movers)
        evaluation(b, ["success"] * 5, movers=movers)
    differences = compare(read_episodes(a), read_episodes(b))
    assert differences["go2, square, 8 movers"].p["success"] == 0.0625
    assert differences["all"].p["success"] is None
    task, _, every = table("b", "a", differences).splitlines()[4:]
    assert "| +100 [" in task
    assert "p = 0.062 |" in task
    assert "p" not in every.partition("seeds |")[2]


def test_what_cannot_be_compared_is_said(tmp_path):
    a = evaluation(tmp_path / "a", ["success"])
    with pytest.raises(BadArgument, match="two or more"):
        compare_command([str(a)])
    with pytest.raises(BadArgument, match=r"none.*episodes\.jsonl"):
        compare_command([str(a), str(tmp_path / "none")])
    with pytest.raises(BadArgument, match="in common"):
        compare_command([str(a), str(evaluation(tmp_path / "b", ["success"], robot="tiago"))])
    with pytest.raises(BadArgument, match="--seeds must be A:B"):
        compare_command([str(a), str(a), "--seeds", "3"])
    (tmp_path / "a" / "episodes.jsonl").write_text("[1]\n")
    with pytest.raises(BadArgument, match="not a list of episodes"):
        read_episodes(a)


def test_the_table_is_printed(tmp_path, capsys):
    a, b = (evaluation(tmp_path / name, ["success", "collision"]) for name in "ab")
    assert compare_command([str(a), str(b), "--seeds", "0:1"]) == 0
    printed = capsys.readouterr().out
    assert "`b` less `a`" in printed
    assert "| go2, square, 8 movers | 1 |" in printed


def test_methods_of_one_evaluation_are_compared(tmp_path, capsys):
    for method, outcomes in (("paper", ["collision"] * 6), ("ours", ["success"] * 6), ("ours", [None, "timeout"])):
        evaluation(tmp_path / "a", outcomes, method=method, gamma=2.0 if outcomes[0] is None else None)
    single = evaluation(tmp_path / "single", ["success"] * 2, method="drl")
    assert list(read_methods([tmp_path / "a"])) == ["paper", "ours", "ours --gamma 2.0"]
    assert list(read_methods([tmp_path / "a", single])) == ["a: paper", "a: ours", "a: ours --gamma 2.0", "single"]
    assert compare_command([str(tmp_path / "a"), "--against", "ours", "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["against"] == "ours"
    task = "go2, square, 8 movers"
    assert [(name, rows[task]["of"]["success"][0]) for name, rows in told["differences"].items()] == [
        ("paper", -1.0), ("ours --gamma 2.0", -1.0),
    ]  # fmt: skip
    with pytest.raises(UnknownName, match="did you mean 'ours'"):
        compare_command([str(tmp_path / "a"), "--against", "our"])
    with pytest.raises(BadArgument, match="two or more methods to compare, got single"):
        compare_command([str(single)])
