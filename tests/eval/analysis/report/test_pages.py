import json
from dataclasses import replace

import pytest

from eval.analysis.report.pages import write_reports
from eval.commands import report
from eval.episode import EpisodeConfig
from eval.methods import MethodOptions
from tests.eval.jobs import episode_by_hash
from vuca_nav.errors import BadArgument

MACHINE = {"cpu": "A CPU | fast", "cores": 8, "os": "Linux-6.1", "python": "3.11.7"}
BARE = EpisodeConfig(world="square", robot="go2", method="dwa-dh", movers=8)
OURS = replace(BARE, method="ours", options=MethodOptions(gamma=0.0))


def evaluation(folder, config, outcomes, runs=1):
    """A directory of ``vuca eval``: an episode of seed 0, 1, ... for each outcome."""
    folder.mkdir()
    stored = {"suite": "crowd", "robots": [config.robot], "methods": [config.method]}
    stored |= {"seeds": [0, len(outcomes)], "episodes": len(outcomes) + 1}
    noted = [
        {"began": f"2026-01-0{k + 1}T10:00:00+00:00", "command": f"vuca eval crowd --out {folder}",
         "machine": MACHINE | {"cores": 8 * (k + 1)}, "commit": "0123456789ab"}
        for k in range(runs)
    ]  # fmt: skip
    made_by = {"code": "c0de", "libraries": {"mujoco": "3.17.0", "numpy": "2.0"}}
    (folder / "config.json").write_text(json.dumps({"config": stored, "made_by": made_by, "runs": noted}))
    rows = [
        episode_by_hash(replace(config, seed=k))
        | {"outcome": outcome, "path_length": 30.0, "spl": 0.5, "arriving_time": 20.0 if outcome == "success" else None}
        for k, outcome in enumerate(outcomes)
    ]
    (folder / "episodes.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    return folder


@pytest.fixture
def two(tmp_path):
    bare = evaluation(tmp_path / "bare", BARE, ["collision"] * 6 + ["success"] * 2)
    return bare, evaluation(tmp_path / "ours", OURS, ["success"] * 8, runs=2)


def test_a_page_says_what_was_run_and_what_came_of_it(two, tmp_path):
    write_reports(two, tmp_path / "out")
    page = (tmp_path / "out" / "bare.md").read_text()
    for line in (
        "| command | `vuca eval crowd --out runs/bare` |",
        "| commit | 0123456789ab |",
        "| seeds | 0 to 7 |",
        "| episodes | 8 of 9 |",
        "| machine | A CPU \\| fast, 8 cores, Linux-6.1, Python 3.11.7 |",
        "| libraries | mujoco 3.17.0, numpy 2.0 |",
        "| date | 2026-01-01 |",
        # Wilson's interval of 2 of 8 is 7 to 59%; 240 m, six collisions.
        "| square, 8 movers | go2 | `dwa-dh` | 8 | 2 [7, 59%] | 6 [41, 93%] | 0 [0, 32%] | 0 [0, 32%] "
        "| 20.0 | 0.500 | 40 |",
    ):
        assert line in page.splitlines()


def test_all_machines_of_an_evaluation_are_named(two, tmp_path):
    write_reports(two, tmp_path / "out")
    lines = (tmp_path / "out" / "ours.md").read_text().splitlines()
    assert [line.split(", ")[1] for line in lines if line.startswith("| machine |")] == ["8 cores", "16 cores"]
    assert sum(line.startswith("| command |") for line in lines) == 1
    assert "| date | 2026-01-01 to 2026-01-02 |" in lines
    assert "| method | `ours --gamma 0.0` |" in lines


def test_the_index_compares_what_shares_episodes(two, tmp_path):
    apart = evaluation(tmp_path / "tiago", replace(BARE, robot="tiago"), ["success"])
    written = write_reports([*two, apart], tmp_path / "out")
    assert [path.name for path in written if path.suffix == ".md"] == ["index.md", "bare.md", "ours.md", "tiago.md"]
    index = (tmp_path / "out" / "index.md").read_text()
    assert "| [bare](bare.md) | crowd | go2 | `dwa-dh` | 8 | 2 [7, 59%] |" in index
    # Six of eight pairs go to the second: p = 2 / 2^6, mid-p 1 / 2^6, and Holm has one hypothesis.
    start = "| square, 8 movers | go2 | ours --gamma 0.0 | dwa-dh | 8 | 6 | 0 | +75 ["
    (line,) = [line for line in index.splitlines() if line.startswith(start)]
    assert "] | 0.0312 | 0.0156 | 0.0312 | 14.4 | -75 [" in line  # E = 2^6 (1/2 3/4 5/6 7/8 9/10 11/12)


def test_the_same_directories_give_the_same_bytes(two, tmp_path):
    written = [
        {
            str(path.relative_to(tmp_path / out)): path.read_bytes()
            for path in write_reports(directories, tmp_path / out)
        }
        for directories, out in ((two, "a"), (two[::-1], "b"))
    ]
    assert written[0] == written[1]


def test_the_command_tells_what_it_wrote(two, tmp_path, capsys):
    out = tmp_path / "out"
    assert report([str(two[0]), "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["files"][:3] == [str(out / "index.md"), str(out / "report.html"), str(out / "bare.md")]
    assert set(map(str, out.rglob("*.*"))) == set(told["files"])


def test_what_is_no_evaluation_is_said(two, tmp_path):
    with pytest.raises(BadArgument, match=r"none/config\.json cannot be read: No such file"):
        write_reports([tmp_path / "none"], tmp_path / "out")
    with pytest.raises(BadArgument, match=r"two pages named bare\.md; rename one"):
        write_reports([two[0], two[0]], tmp_path / "out")
    with pytest.raises(BadArgument, match="one or more directories"):
        report(["--out", str(tmp_path / "out")])
    rows = two[0] / "episodes.jsonl"
    rows.write_text(rows.read_text().replace('"spl": 0.5', '"spl": "much"'))
    with pytest.raises(BadArgument, match=r"bare has a row that is not the result of an episode"):
        write_reports([two[0]], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_tasks_of_a_folder_have_a_line_of_their_own_with_scores_and_what_was_refused(tmp_path):
    folder = evaluation(tmp_path / "barn", BARE, ["success", "success", "refused"])
    rows = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    for row, score in zip(rows, (0.5, 0.25, None), strict=True):
        row |= {"task": "world_1"} | ({} if score is None else {"score": score})
    (folder / "episodes.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    write_reports([folder], tmp_path / "out")
    page = (tmp_path / "out" / "barn.md").read_text()
    assert [line.split(" | ")[0] for line in page.splitlines() if "`dwa-dh`" in line and "[" in line] == [
        "| all",
        "| world_1, 8 movers",
    ]
    assert all(line.endswith("0.3750 | 1 |") for line in page.splitlines() if "`dwa-dh`" in line and "[" in line)
    assert "| score | refused |" in page
    (line,) = (tmp_path / "out" / "tables" / "tasks.csv").read_text().splitlines()[1:]
    assert line.startswith("barn,go2,dwa-dh,1,2,2,2,")
    assert line.endswith(",0.375")
