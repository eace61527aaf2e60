import pytest

from robots.bodies.go2 import GO2
from train.commands import TRAINABLE
from vuca_nav.cli import main


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """What the command hands to a run that trains nothing."""
    made = []

    class Run:
        def __init__(self, robot, config, out, *, resume, threads):
            self.weights = out / robot.weights
            made.append((config, out, resume, threads))

        def run(self):
            pass

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("train.locomotion.training.GaitTraining", Run)
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


def test_help_names_all_that_can_be_trained(capsys):
    from train.navigation.stages import STAGES

    assert set(TRAINABLE) == {"locomotion", *STAGES, "critic", "all"}
    assert main(["train", "--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "usage: vuca train WHAT [OPTIONS]"
    for name in TRAINABLE:
        assert any(line.startswith(f"  {name} ") and len(line) > 30 for line in lines)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("train", f"give what to train: {', '.join(TRAINABLE)} "),
        ("train --seed 1 locomotion", "what to train comes first, before --seed: locomotion, "),
        ("train go_strait", "'go_strait'; did you mean 'go-straight'?"),
    ],
)
def test_what_to_train_must_be_named(line, said, capsys):
    assert main(line.split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error


def test_help_of_the_gait(capsys):
    assert main(["train", "locomotion", "--help"]) == 0
    assert "--threads" in capsys.readouterr().out
