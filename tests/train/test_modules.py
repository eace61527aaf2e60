"""What ``python -m`` of the training's modules answers to bad input: one line that says what would be right."""

import runpy

import pytest

from vuca_nav.policy.weights_file import WEIGHTS_FOLDER

FUSION = WEIGHTS_FOLDER / "fusion.safetensors"


@pytest.mark.filterwarnings("ignore:.*found in sys.modules")
@pytest.mark.parametrize(
    ("module", "arguments", "said"),
    [
        ("train.arena.oracle", "--kind foo", "no kind of world 'foo'; there are static, "),
        ("train.arena.oracle", "--body foo", "no body 'foo'; there are tiago, "),
        ("train.arena.oracle", "--episodes 0", "--episodes must be 1 or more"),
        ("train.arena.oracle", "--seed -1", "--seed 0 or more"),
        ("train.arena.oracle", "--movers 9 3", "movers"),
        ("train.arena.bench", "--kind foo", "paper or tracked, got 'foo'"),
        ("train.arena.bench", "--threads 0", "--threads and --rows must be 1 or more"),
        ("train.arena.bench", "--seconds nan", "--seconds positive"),
        ("train.navigation.bench", "--stage foo", "unknown policy 'foo'"),
        ("train.navigation.bench", "--iterations 0", "--iterations must be 1 or more, got 0"),
        ("train.response", "--robot x --out here", "unknown robot 'x'"),
        ("train.response", "--robot tiago --out file", "--out file is a file"),
        ("train.response", "--robot tiago --out here --seed -1", "--seed must be 0 or more"),
        ("train.response", "", "--out"),
        ("train.locomotion.evaluate", "--robot tiago", "tiago"),
        ("train.locomotion.evaluate", "--minutes nan", "--minutes must be 0 or more"),
        ("train.locomotion.evaluate", "--out file/results.json", "cannot be written"),
        ("train.navigation.evaluate", "--epsodes 3", "epsodes"),
        ("train.navigation.evaluate", "missing.safetensors", "missing.safetensors"),
        ("train.navigation.evaluate", "", "give one or more weights files"),
        ("train.navigation.evaluate", f"{FUSION} --out file", "--out file is a file, expected a directory"),
        ("train.navigation.evaluate", f"{FUSION} --threads 0", "--threads must be 1 or more, got 0"),
        ("train.navigation.evaluate", f"{FUSION} --seed -1", "--seed must be 0 or more, got -1"),
        ("train.navigation.evaluate", f"{FUSION} --episodes 0", "--episodes must be 1 or more, got 0"),
        ("train.navigation.evaluate", f"{FUSION} --decision-rate 0", "decision_rate"),
        ("train.navigation.evaluate", f"{FUSION} --speeds 2 1", "mover_speeds"),
        ("train.navigation.evaluate", f"{FUSION} --kinds", "--kinds must name one or more of static, "),
        ("train.navigation.evaluate", f"{FUSION} {FUSION}", "fusion.safetensors is given twice"),
    ],
)
def test_bad_arguments_are_one_line(module, arguments, said, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    monkeypatch.setattr("sys.argv", [module, *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    assert ended.value.code == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.count("\n") == 1
    assert said in error
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
