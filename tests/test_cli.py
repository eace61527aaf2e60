"""The command line from outside: what goes to which stream, exit codes, one clear line for each mistake."""

import contextlib
import importlib.metadata
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

from eval.metrics import TIMING_FIELDS
from vuca_nav.cli import main, run_module
from worlds.fairness import FairnessArguments


def vuca(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vuca_nav.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=cwd, check=False)


def test_help_lists_every_command_with_a_line():
    result = vuca("--help")
    assert result.returncode == 0
    for name in ("run", "list", "eval", "compare", "report", "bench"):
        assert any(line.startswith(f"  {name} ") and len(line) > 20 for line in result.stdout.splitlines())


def test_no_command_is_an_error_with_the_help_on_stderr():
    result = vuca()
    assert result.returncode == 2
    assert "usage: vuca COMMAND" in result.stderr


def test_help_of_a_command():
    result = vuca("run", "--help")
    assert result.returncode == 0
    assert "--without" in result.stdout


def test_version():
    assert vuca("--version").stdout.strip().count(".") == 2


def python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)


def test_help_is_quick_because_it_imports_nothing_heavy():
    result = python(
        "import sys; from vuca_nav.cli import main; main(['--help']);"
        "print(*({'numpy', 'numba', 'mujoco', 'rerun'} & set(sys.modules)), file=sys.stderr)"
    )
    assert result.stderr.strip() == ""


def test_without_the_simulator_it_says_which_extra_to_install():
    result = python("import sys; sys.modules['mujoco'] = None; from vuca_nav.cli import main; sys.exit(main(['run']))")
    assert_one_clear_line(result, "run", "needs the package 'mujoco': run pip install -e '.[sim]' in your clone")


MODULE = """
import sys
from dataclasses import dataclass
from vuca_nav.cli import run_module

@dataclass(frozen=True)
class Arguments:
    n: int = 1

def main(arguments):
    {}

run_module("module", main, Arguments)
"""


@pytest.mark.parametrize(
    ("body", "code", "line"),
    [
        ("import sys; sys.modules['matplotlib'] = None; import matplotlib", 2,
         "module: needs the package 'matplotlib': run pip install -e '.[sim]' in your clone of vuca-nav"),
        ("raise KeyboardInterrupt", 130, "module: interrupted"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGTERM)", 143, "module: terminated"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGHUP)", 129, "module: terminated"),
        ("import os, signal; from vuca_nav.cli import undisturbed\n    with undisturbed():\n"
         "        os.kill(os.getpid(), signal.SIGHUP); os.kill(os.getpid(), signal.SIGINT)\n"
         "        sys.stderr.write('said')",
         0, "said"),
        ("from vuca_nav.errors import BadArgument; raise BadArgument('n must\\nbe 2')", 2, "module: n must be 2"),
        ("print(arguments.n, file=sys.stderr)", 0, "1"),
    ],
)  # fmt: skip
def test_a_module_of_one_command_ends_as_the_others_do(body, code, line):
    result = python(MODULE.format(body))
    assert result.returncode == code
    assert result.stderr.strip() == line


def test_bad_arguments_of_a_module_are_one_line(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["worlds", "square", "--radius", "wide"])
    with pytest.raises(SystemExit) as ended:
        run_module("fairness", lambda _: None, FairnessArguments)
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith("fairness: ")
    assert "wide" in error
    assert "--help)" in error


SPOKEN = [
    # What users are most likely to get wrong, asked of the real program; the rest is asked in this process.
    (["run", "--robot", "gp2"], "unknown robot 'gp2'"),
    (["run", "--world", "nowhere"], "unknown world 'nowhere'"),
    (["run", "--regon", "3"], "--regon"),
]
MISTAKES = [
    (["rn"], "unknown command 'rn'; did you mean 'run'?"),
    (["run", "--robot", "tiag"], "unknown robot 'tiag'; did you mean 'tiago'?"),
    (["run", "--world", "factori"], "unknown world 'factori'; did you mean 'factory'?"),
    (["run", "--method", "dwa"], "unknown method 'dwa'"),
    (["run", "--region", "9"], "region"),
    (["run", "--region", "four"], "--region"),
    (["run", "--world", "square", "--region", "2"], "region"),
    (["run", "--world", "square", "--movers", "400"], "movers"),
    (["run", "--without", "X"], "--without X: unknown difficulty 'X'"),
    (["run", "--seed", "-3"], "seed"),
    (["run", "--start", "1", "2"], "--start"),
    (["run", "--start", "1.5", "1.5", "inf"], "--start: inf is not a finite number"),
    (["run", "--goal", "nan", "1"], "--goal: nan is not a finite number"),
    (["run", "--world", "square", "--movers", "3", "--without", "V"], "--movers 3 does not go with --without V"),
    (["run", "--world", "static", "--movers", "3"], "--movers: static has nothing that moves (only factory, square"),
    (["run", "--speed", "9"], "--speed 9: a factor of 0 to 2.5"),
    (["run", "--sighted", "nan"], "--sighted: nan is not a finite number"),
    (["eval", "square", "--sighted", "2", "--out", "x"], "--sighted 2: a share of 0 to 1"),
    (["run", "--record", "a.rrd", "--serve"], "exclude each other"),
    (["run", "--method", "FUSION"], "unknown method 'FUSION'; did you mean 'fusion'?"),
    (["run", "--critic", "s.safetensors"], "'ours-dh' has no V^h; --critic goes with: ours"),
    (
        ["run", "--method", "dwa-dh", "--gate", "uniform"],
        "--gate goes with: ours, ours-dh, paper, paper-dh, fusion, fusion-plus",
    ),
    (["run", "--gate", "skewed"], "--gate must be uniform, or left out for the trained gate; got 'skewed'"),
    (["run", "--without-expert", "0"], "cannot leave out expert 0: fusion-plus.safetensors has 4, numbered 1 to 4"),
    (["run", "--method", "single", "--no-shield"], "'single' has no shield; --no-shield goes with: ours, ours-dh"),
    (["run", "--method", "ours", "--critic", "s.safetensors"], "no weights of a critic at s.safetensors"),
    (["heatmap", "--out", "h.png", "--critic", "s.safetensors"], "no weights of a critic at s.safetensors"),
    (["heatmap", "--out", "h.png", "--method", "ours-dh", "--gamma", "1"], "--gamma goes with: ours"),
    (["heatmap", "--out", "."], "--out . is a directory, expected a file"),
    (["eval", "smoke", "--out", "out", "--critic", "s.safetensors"], "'ours-dh' has no V^h; --critic goes with: ours"),
    (["eval", "smoke", "--out", "out", "--gate", "uniform", "--method", "go-straight"], "--gate goes with: ours"),
    (["run", "--world", "missing.yaml"], "missing.yaml cannot be read: No such file"),
    (["list", "planets"], "planets"),
    (["eval", "smoke"], "--out"),
    (["compare", "one"], "one/episodes.jsonl cannot be read"),
    (["compare", "none", "other"], "none/episodes.jsonl cannot be read"),
    (["report", "none"], "--out"),
    (["report", "none", "--out", "out"], "none/config.json cannot be read: No such file or directory"),
    (["eval", "smok", "--out", "out"], "unknown suite 'smok'; did you mean 'smoke'?"),
    (["eval", "smoke", "--out", "out", "--seeds", "junk"], "--seeds must be A:B"),
    (["eval", "smoke", "--out", "out", "--workers", "0"], "--workers must be 1 or more"),
    (["eval", "smoke", "--out", "out", "--robot", "gp2"], "unknown robot 'gp2'"),
]


def assert_one_clear_line(result: subprocess.CompletedProcess[str], command: str, text: str):
    assert result.returncode == 2, result.stderr
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith(f"vuca {command}: ")
    assert text in lines[0]


@pytest.mark.parametrize(("arguments", "text"), SPOKEN, ids=[" ".join(a) for a, _ in SPOKEN])
def test_a_mistake_is_answered_by_one_line_and_exit_code_2(arguments, text, tmp_path):
    assert_one_clear_line(vuca(*arguments, cwd=tmp_path), arguments[0], text)
    assert list(tmp_path.iterdir()) == []


def vuca_here(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The same without a process of its own."""
    command = list(map(str, arguments))
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(command)
    return subprocess.CompletedProcess(command, code, out.getvalue(), err.getvalue())


@pytest.mark.parametrize(("arguments", "text"), MISTAKES, ids=[" ".join(a) for a, _ in MISTAKES])
def test_every_mistake_has_its_line(arguments, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_one_clear_line(vuca_here(*arguments), arguments[0], text)
    assert list(tmp_path.iterdir()) == []


def test_a_broken_scene_names_the_field(room, tmp_path):
    broken = tmp_path / "broken.yaml"
    broken.write_text(room.read_text().replace("length: 6.0", "length: long", 1))
    result = vuca_here("run", "--world", broken)
    assert_one_clear_line(result, "run", "obstacles")
    assert "length" in result.stderr


def test_a_scene_without_end(room, tmp_path):
    endless = tmp_path / "endless.yaml"
    endless.write_text(room.read_text().replace("x_max: 6", "x_max: 1.0e+6"))
    assert_one_clear_line(vuca_here("run", "--world", endless), "run", "bounds.x_max")
    endless.write_text(room.read_text().replace("x_max: 6", "x_max: 900"))
    assert_one_clear_line(vuca_here("run", "--world", endless), "run", "bounds.x_max: 900 m from x_min; 200 m or less")


def test_a_start_on_a_mover(room, tmp_path):
    cart = """\
movers:
  - kind: cylinder
    radius: 0.2
    start: {x: 3.0, y: 2.0, yaw: 0.0}
    motion: {type: patrol, speed: 0.0, waypoints: [{x: 3.0, y: 2.0}, {x: 3.0, y: 2.5}]}
    parts: [{shape: {type: cylinder, x: 0.0, y: 0.0, radius: 0.2, height: 1.0}}]
"""
    crowded = tmp_path / "crowded.yaml"
    crowded.write_text(room.read_text().replace("movers: []\n", cart))
    result = vuca_here("run", "--world", crowded, "--start", "3.3", "2", "0")
    assert_one_clear_line(result, "run", "start: movers[0] (a cylinder) begins at (3, 2), -0.18 m from the body")
    crowded.write_text(crowded.read_text().replace("start: {x: 1.2", "start: {x: 2.6"))
    assert_one_clear_line(vuca_here("run", "--world", crowded), "run", "crowded.yaml: start: movers[0]")


def test_a_scene_that_is_no_yaml(tmp_path):
    broken = tmp_path / "broken.yaml"
    broken.write_text("bounds: [0, 0\nstart: }")
    assert_one_clear_line(vuca_here("run", "--world", broken), "run", "broken.yaml")


def test_a_goal_inside_a_wall(room):
    assert_one_clear_line(vuca_here("run", "--world", room, "--goal", "5.95", "2"), "run", "goal")


def test_a_start_inside_a_wall(room):
    assert_one_clear_line(vuca_here("run", "--world", room, "--start", "3", "0.05", "0"), "run", "start")


def test_a_goal_outside_the_bounds(room):
    assert_one_clear_line(vuca_here("run", "--world", room, "--goal", "50", "2"), "run", "goal")


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_mistake_is_told_alike_on_every_terminal(encoding, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    line = vuca("run", "--region", "four").stderr
    assert line.startswith(
        "vuca run: Error parsing --region: no type matching INT could be instantiated from ['four'] ("
    )


@pytest.mark.parametrize("path", ["missing/dir/run.rrd", "."])
def test_an_unwritable_recording_is_noticed_before_the_run(path, room, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_one_clear_line(vuca_here("run", "--world", room, "--record", path), "run", path)
    assert list(tmp_path.iterdir()) == []


def json_of(result: subprocess.CompletedProcess[str]) -> dict:
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def first_run(room) -> subprocess.CompletedProcess[str]:
    return vuca("run", "--world", room, "--seed", "5", "--json")


def test_a_run_reaches_the_goal_and_says_so(first_run, room):
    row = json_of(first_run)
    assert row["outcome"] == "success"
    assert row["collided_with"] is None
    assert (row["world"], row["robot"], row["seed"]) == (str(room), "tiago", 5)
    assert row["steps"] == round(row["arriving_time"] * 30)
    # 2.8 m apart, less the 0.3 m that count as arrived.
    assert 2.5 <= row["path_length"] < 5.0
    assert 0.5 < row["spl"] <= 1.0
    assert row["slam_ate"] < 0.1
    assert 0.0 < row["min_clearance"] < 2.0
    assert row["made_by"]["machine"]["libraries"]["mujoco"] == importlib.metadata.version("mujoco")
    assert row["made_by"].keys() == {"commit", "machine"}
    for name in ("arithmetic", "arsps", "ansps", "real_time_factor", "method", "odometry_ate", "odometry_final_error"):
        assert row[name] is not None
    assert "outcome" in first_run.stdout.splitlines()[1]


def test_the_same_seed_gives_the_same_bits(first_run, room):
    first = json_of(first_run)
    again = json_of(vuca("run", "--world", room, "--seed", "5", "--json"))
    assert first.keys() == again.keys()
    assert {k for k in first if first[k] != again[k]} <= set(TIMING_FIELDS)
    other = json_of(vuca("run", "--world", room, "--seed", "6", "--json"))
    assert {"path_length", "slam_ate", "odometry_ate"} <= {k for k in first if first[k] != other[k]}


def test_without_ambiguity_localisation_is_exact(room):
    row = json_of(vuca("run", "--world", room, "--without", "UA", "--json"))
    assert row["outcome"] == "success"
    # Told the mission's start; the body came to rest some micrometres from it.
    assert row["slam_ate"] == pytest.approx(0.0, abs=1e-4)
    assert row["odometry_ate"] == pytest.approx(0.0, abs=1e-4)


def test_a_recording_is_written(room, tmp_path):
    result = vuca("run", "--world", room, "--record", tmp_path / "run.rrd")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "run.rrd").stat().st_size > 100_000


@pytest.mark.parametrize(
    ("what", "name"),
    [("worlds", "factory"), ("robots", "tiago"), ("methods", "dwa-dh"), ("suites", "factory-still")],
)
def test_list(what, name):
    result = vuca_here("list", what, "--json")
    names = json_of(result)
    assert name in names
    assert all(len(description) > 10 for description in names.values())
    assert len(result.stdout.splitlines()) == len(names) + 1


def test_an_evaluation_goes_on_and_refuses_another_configuration(tmp_path):
    out = tmp_path / "out"
    arguments = ("eval", "smoke", "--out", out, "--workers", "1", "--episodes", "1")
    summary = json_of(vuca(*arguments, "--json"))
    assert summary["groups"][0]["n"] == 1
    before = (out / "episodes.jsonl").read_text()
    assert json_of(vuca_here(*arguments, "--json"))["groups"] == summary["groups"]
    assert (out / "episodes.jsonl").read_text() == before
    refused = vuca_here("eval", "smoke", "--out", out, "--episodes", "2")
    assert_one_clear_line(refused, "eval", "was begun with episodes = 1, not 2")
    for spoilt in ('{"a": 1}', "[]"):
        (out / "episodes.jsonl").write_text(f"{spoilt}\n")
        assert_one_clear_line(vuca_here(*arguments), "eval", "episodes.jsonl:1 is not a row")
    (out / "config.json").write_text('{"config": [], "made_by": {}}')
    assert_one_clear_line(vuca_here(*arguments), "eval", "config.json is not the configuration of an evaluation")
