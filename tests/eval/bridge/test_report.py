import json
from pathlib import Path

import pytest

from eval.bridge.faults.campaign import Trial
from eval.bridge.faults.kept import Keeper
from eval.bridge.report import ReportArguments, run
from eval.bridge.trials import MONITORED, typed
from eval.episode import EpisodeConfig
from tests.eval.analysis.report.synthetic import row_of
from vuca_nav.errors import BadArgument

MACHINE = {"cpu": "a cpu", "cores": 4, "python": "3.11.7"}
MB = 1 << 20


def write_rows(folder: Path, module: str, outcomes, settings, asked=None, **changes):
    config = EpisodeConfig("factory", 2, "tiago", "ours-dh", options=changes.pop("options", EpisodeConfig().options))
    rows = [
        {**row_of(config, outcome), "seed": seed, "steps": 100, **changes.get(f"of_{seed}", {})}
        for seed, outcome in enumerate(outcomes)
    ]
    command = f"/somewhere/eval/bridge/{module}.py --out /else/where"
    stored = {
        "config": {"suite": "bridge", "configurations": {"ours-dh": settings}, "episodes": asked or len(rows)},
        "made_by": {},
        "runs": [{"began": "2026-05-01T10:00:00+00:00", "command": command, "machine": MACHINE, "commit": "abc"}],
    }
    folder.mkdir(parents=True)
    (folder / "config.json").write_text(json.dumps(stored))
    (folder / "episodes.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))


def write_parity(folder: Path, **changes):
    write_rows(folder / "tiago-factory-2" / "wire", "parity", ["success"] * 3, {"lockstep": True}, asked=20, **changes)
    write_rows(folder / "tiago-factory-2" / "alone", "parity", ["success"] * 20, {}, options=MONITORED)
    return folder


def write_real_time(folder: Path):
    cell = folder / "tiago-factory-2"
    write_rows(cell / "wire", "real_time", ["success", "collision", "success", "success"], {"real_time_factor": 1.0})
    write_rows(cell / "alone", "real_time", ["success", "success", "collision", "success"], {})
    times = {"latencies": [0.002, 0.002, 0.002], "periods": [0.1] * 30 + [1 / 30 + 0.004], "idle": [1 / 30 - 0.001]}
    lines = [{"seed": seed, "late": 2, "load": 1.5, **times} for seed in range(4)]
    (cell / "timing.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return folder


def write_faults(folder: Path, soak=False):
    good = Trial("lidar_silent", "", 0.6, 0.15, False, True, 0.7, 0.8, 1.2, 0.1)
    keeper = Keeper(folder)
    keeper.note_run("python -m eval.bridge.faults --out /else/where", {"robot": "go2", "method": "ours-dh"})
    keeper.add_trial(good)
    keeper.add_trial(good._replace(rest=0.9))
    keeper.add_trial(good._replace(fault="odometry_nan", zero=0.25))
    for k in range(100 if soak else 0):
        keeper.add_memory(float(k), 300 * MB)
    return folder


def report(tmp_path, *folders, note=""):
    run(ReportArguments(folders=folders, out=tmp_path / "out", note=note))
    return (tmp_path / "out" / "index.md").read_text()


def cells(page: str, first: str) -> list[str]:
    (line,) = [line for line in page.splitlines() if line.startswith(f"| {first} |")]
    return line.strip("| ").split(" | ")


def test_rows_in_lockstep_are_counted_and_what_differs_is_named(tmp_path):
    page = report(tmp_path, write_parity(tmp_path / "lockstep", of_1={"min_clearance": 0.5}))
    assert cells(page, "tiago-factory-2") == ["tiago-factory-2", "3 of 20", "2", "3", "seed 1: min_clearance"]


def test_outcomes_in_real_time_have_intervals_and_a_test_of_pairs(tmp_path):
    line = cells(report(tmp_path, write_real_time(tmp_path / "rt")), "tiago-factory-2")
    assert line[:4] == ["tiago-factory-2", "4", "3 [30, 95%]", "3 [30, 95%]"]
    assert line[4].startswith("+0.00 [-0.")
    assert line[5:] == ["1", "1", "1.000", "2.00", "2.00", "4.00", "1.00", "2.00", "1.5"]


def test_faults_have_a_table_for_each_campaign_and_a_verdict_on_the_memory(tmp_path):
    page = report(tmp_path, write_faults(tmp_path / "faults"), write_faults(tmp_path / "soak", soak=True))
    assert page.count("## Faults: go2, ours-dh\n") == 1
    assert page.count("## Faults at random: go2, ours-dh\n") == 1
    assert page.count("Memory of vuca deploy over 99 s: flat (300.0 MB") == 1
    line = cells(page.split("## Faults at random")[0], "all that must stop")
    assert (line[1], line[5], line[9]) == ("3", "2 [21, 94%]", "2 [21, 94%]")
    assert (tmp_path / "out" / "tables" / "soak.csv").read_text().startswith("fault,trials,stopped by")


def test_the_page_names_commands_commits_and_machines_but_no_place(tmp_path):
    folders = write_parity(tmp_path / "lockstep"), write_faults(tmp_path / "faults")
    page = report(tmp_path, *folders, note="At a priority.")
    command, commit, date, machine = cells(page, "lockstep")[1:]
    assert command == "`python -m eval.bridge.parity --out runs/lockstep`"
    assert (commit, date, machine) == ("abc", "2026-05-01", "a cpu, 4 cores, Python 3.11.7")
    assert cells(page, "faults")[1] == "`python -m eval.bridge.faults --out runs/faults`"
    assert "At a priority." in page
    assert str(tmp_path) not in page
    assert "/else/where" not in page


def test_the_same_directories_give_the_same_bytes_in_any_order(tmp_path):
    folders = write_parity(tmp_path / "lockstep"), write_real_time(tmp_path / "rt"), write_faults(tmp_path / "faults")
    assert report(tmp_path, *folders) == report(tmp_path, *reversed(folders))


def test_cells_of_two_directories_are_told_apart(tmp_path):
    page = report(tmp_path, write_parity(tmp_path / "first"), write_parity(tmp_path / "second"))
    assert cells(page, "tiago-factory-2 (first)")[1] == cells(page, "tiago-factory-2 (second)")[1] == "3 of 20"


@pytest.mark.parametrize("name", ["nothing", "empty", "unfinished"])
def test_what_no_command_of_the_bridge_wrote_is_refused(tmp_path, name):
    (tmp_path / "empty").mkdir()
    write_rows(tmp_path / "unfinished" / "tiago-factory-2" / "alone", "parity", ["success"], {})
    with pytest.raises(BadArgument, match="holds neither faults nor a mission"):
        report(tmp_path, tmp_path / name)


@pytest.mark.parametrize(
    "line", ["no json", '{"trial": {"fault": "lidar_silent"}}', '{"memory": 3}', '{"run": {"command": 3}}', "[]"]
)
def test_a_damaged_file_of_trials_is_refused_by_its_line(tmp_path, line):
    folder = write_faults(tmp_path / "faults")
    with (folder / "trials.jsonl").open("a") as file:
        file.write(f"{line}\n")
    with pytest.raises(BadArgument, match=r"trials.jsonl: line 5"):
        report(tmp_path, folder)


def test_commands_are_told_as_they_are_typed():
    words = ["--out", "a b"]
    assert typed(["/x/eval/bridge/parity.py", *words]) == "python -m eval.bridge.parity --out 'a b'"
    assert typed(["/x/eval/bridge/faults/__main__.py", *words]) == "python -m eval.bridge.faults --out 'a b'"
    assert typed(["python", "-m", "eval.bridge.parity"]) == "python -m eval.bridge.parity"
