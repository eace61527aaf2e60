import pytest

from robots.go2 import GO2
from vuca_nav.cli import main


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """What the command hands to a run that trains nothing."""
    made = []

    class Run:
        def __init__(self, robot, config, out, *, resume, threads):
            self.robot = robot
            made.append((config, out, resume, threads))

        def run(self):
            pass

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("train.locomotion.run.Training", Run)
    return made


def test_arguments_reach_the_run(calls, capsys, tmp_path):
    line = ["train", "locomotion", "--out", "here", "--seed", "7", "--steps", "1000", "--threads", "3", "--resume"]
    assert main(line) == 0
    config, out, resume, threads = calls[0]
    assert (config.seed, config.steps, str(out), resume, threads) == (7, 1000, "here", True, 3)
    assert capsys.readouterr().out == f"weights: here/{GO2.weights}\n"


def test_without_arguments_the_full_recipe_goes_to_runs(calls):
    assert main(["train", "locomotion"]) == 0
    config, out, resume, threads = calls[0]
    assert (config.seed, str(out), resume) == (0, "runs/go2", False)
    assert config.steps == 8_000_000
    assert threads >= 1


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ("--steps 0", "--steps"),
        ("--steps=-5", "--steps"),
        ("--steps many", "many"),
        ("--threads 0", "--threads"),
        ("--seed=-1", "seed"),
        ("--robot tiago", "tiago"),
        ("--resume", "--resume"),
        ("--out file", "is a file"),
        ("--out file/run", "cannot be written"),
        ("--out /proc/run", "cannot be written"),
    ],
)
def test_bad_arguments_are_one_line(tmp_path, monkeypatch, capsys, bad, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert main(["train", "locomotion", *bad.split()]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert named in error
