"""What ``python -m`` of the training's modules answers to bad input: one line that says what would be right."""

import runpy

import pytest

from vuca_nav.policy.weights_file import WEIGHTS_FOLDER

FUSION = WEIGHTS_FOLDER / "fusion.safetensors"


@pytest.mark.filterwarnings("ignore:.*found in sys.modules")
@pytest.mark.parametrize(
    ("module", "arguments", "said"),
    [
        ("train.analysis.oracle", "--kind foo", "no kind of world 'foo'; there are static, "),
        ("train.analysis.oracle", "--body foo", "no body 'foo'; there are tiago, "),
        ("train.analysis.oracle", "--episodes 0", "--episodes must be 1 or more"),
        ("train.analysis.oracle", "--seed -1", "--seed 0 or more"),
        ("train.analysis.oracle", "--movers 9 3", "movers"),
        ("train.analysis.bench.arena", "--kind foo", "paper or tracked or frames, got 'foo'"),
        ("train.analysis.bench.arena", "--threads 0", "--threads and --rows must be 1 or more"),
        ("train.analysis.bench.arena", "--seconds nan", "--seconds positive"),
        ("train.analysis.bench.learner", "--stage foo", "unknown policy 'foo'"),
        ("train.analysis.bench.learner", "--iterations 0", "--iterations must be 1 or more, got 0"),
        ("train.analysis.response", "--robot x --out here", "unknown robot 'x'"),
        ("train.analysis.response", "--robot tiago --out file", "--out file is a file"),
        ("train.analysis.response", "--robot tiago --out here --seed -1", "--seed must be 0 or more"),
        ("train.analysis.response", "", "--out"),
        ("train.locomotion.evaluate", "--robot tiago", "tiago"),
        ("train.locomotion.evaluate", "--minutes nan", "--minutes must be 0 or more"),
        ("train.locomotion.evaluate", "--out file/results.json", "cannot be written"),
        ("train.analysis.evaluate", "--epsodes 3", "epsodes"),
        ("train.analysis.evaluate", "missing.safetensors", "missing.safetensors"),
        ("train.analysis.evaluate", "", "give one or more weights files"),
        ("train.analysis.evaluate", f"{FUSION} --out file", "--out file is a file, expected a directory"),
        ("train.analysis.evaluate", f"{FUSION} --threads 0", "--threads must be 1 or more, got 0"),
        ("train.analysis.evaluate", f"{FUSION} --seed -1", "--seed must be 0 or more, got -1"),
        ("train.analysis.evaluate", f"{FUSION} --episodes 0", "--episodes must be 1 or more, got 0"),
        ("train.analysis.evaluate", f"{FUSION} --decision-rate 0", "decision_rate"),
        ("train.analysis.evaluate", f"{FUSION} --speeds 2 1", "mover_speeds"),
        ("train.analysis.evaluate", f"{FUSION} --kinds", "--kinds must name one or more of static, "),
        ("train.analysis.evaluate", f"{FUSION} {FUSION}", "fusion.safetensors is given twice"),
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
