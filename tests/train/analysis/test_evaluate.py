import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from train.analysis import evaluate as module
from train.analysis.episodes import EpisodeRecords, Evaluation
from train.analysis.evaluate import EvaluateArguments, Played, evaluate, knock_outs, main, play
from train.analysis.page import GateUse, markdown, row_names
from train.arena.config import ArenaConfig, Imperfections
from train.navigation.networks import FusedActor, NetworkConfig, make_critic
from train.navigation.weights import actor_of, export
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.policy.observation import ObservationConfig, action_from_command, command_from_action
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.types import VelocityCommand

WORLD = ArenaConfig(layouts=2, pairs=4, num_bodies=2).of("static")
SEEN = ObservationConfig(sectors=12)


def write(path, experts, seed=0):
    generator = torch.Generator().manual_seed(seed)
    network = NetworkConfig(experts=experts, hidden=8, gate=8, critic=8)
    actor, critic = FusedActor(SEEN.size, network, generator), make_critic(SEEN.size, network, generator)
    for parameter in actor.parameters():
        parameter.data = torch.randn(parameter.shape, generator=generator)
    export(path, path.stem, actor, critic, network, SEEN, 10.0, {})
    return path


def test_the_same_policy_meets_the_same_episodes(tmp_path):
    actor = actor_of(load_weights(write(tmp_path / "a.safetensors", 1)))
    first, second = (play(actor, Evaluation(WORLD, SEEN, 8, 0)) for _ in range(2))
    assert np.array_equal(first.records.success, second.records.success)
    assert np.array_equal(first.records.time, second.records.time)
    assert (first.records.success | first.records.collision | first.records.timeout).all()


def test_a_gate_that_is_overruled(tmp_path):
    actor = actor_of(load_weights(write(tmp_path / "a.safetensors", 3)))

    def gate_with(overrule):
        return play(actor, Evaluation(WORLD, SEEN, 8, 0), overrule).gate

    free = gate_with(None)
    assert sum(free.mean) == pytest.approx(1.0, abs=1e-5)
    assert 0.0 < free.entropy < np.log(3.0)
    assert free.information > 0.001
    variants = knock_outs(3, free.mean)
    assert set(variants) == {"gate's average", "uniform", "without 1", "without 2", "without 3"}
    assert gate_with(variants["uniform"]).mean == pytest.approx([1 / 3] * 3, abs=1e-5)
    constant = gate_with(variants["gate's average"])
    assert constant.mean == pytest.approx(free.mean, abs=1e-5)
    assert constant.information == pytest.approx(0.0, abs=1e-4)
    without = gate_with(variants["without 2"])
    assert without.mean[1] == 0.0
    assert sum(without.mean) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.slow
def test_the_table_of_two_policies(tmp_path, capsys):
    one, three = write(tmp_path / "one.safetensors", 1), write(tmp_path / "three.safetensors", 3, seed=1)
    arguments = EvaluateArguments((one, three), tmp_path / "out", 20, kinds=("static",), knock_outs=True)
    main(arguments)
    results = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert set(results["one"]) == {"as it is"}
    assert set(results["three"]) == {"as it is", "gate's average", "uniform", "without 1", "without 2", "without 3"}
    row = results["three"]["as it is"]["static"]
    assert row["success"] + row["collision"] + row["timeout"] == pytest.approx(1.0)
    assert "| three, without 1 |" in capsys.readouterr().out


def test_rows_are_filed_under_what_is_true_of_a_policy_and_of_the_window(tmp_path, monkeypatch):
    arrived, hit = np.eye(4, dtype=bool)[:2]
    some, none = np.ones(4), np.zeros(4, np.int64)
    records = EpisodeRecords(arrived, hit, ~(arrived | hit), some, some, some, some, some, some, none, none)
    for name in ("episodes_of", "_arena"):
        monkeypatch.setattr(module, name, lambda *_: None)
    monkeypatch.setattr(module, "play_dynamic_window", lambda *_: records)
    monkeypatch.setattr(module, "play", lambda *_, **__: Played(records, GateUse([1.0], 0.0, 0.0)))
    arguments = EvaluateArguments(
        (write(tmp_path / "b.safetensors", 1),), episodes=4, kinds=("static",), shield=True, dynamic_window=True
    )
    results = evaluate(arguments)
    assert {name: set(variants) for name, variants in results.items()} == {
        "b": {"as it is", "shielded"},
        "dynamic window": {"as it is"},
    }
    assert results["b"]["shielded"]["static"]["against_as_it_is"][0] == 0.0
    assert results["dynamic window"]["as it is"]["static"]["against_first"][0] == 0.0
    names = [
        line.split(" | ")[0]
        for line in markdown(results, arguments.kinds, arguments.episodes, arguments.seed).splitlines()
        if line.startswith("| ")
    ]
    assert names == ["| policy", "| b", "| b, shielded", "| dynamic window"]


def test_what_cannot_be_evaluated(tmp_path):
    with pytest.raises(BadArgument, match="one or more"):
        evaluate(EvaluateArguments(()))
    with pytest.raises(BadWeights, match=r"no\.safetensors"):
        evaluate(EvaluateArguments((tmp_path / "no.safetensors",)))


def test_rows_of_files_with_the_same_name_are_told_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = [Path("one.safetensors"), *(Path(f"runs/seed-{seed}/two/two.safetensors") for seed in (0, 1))]
    files += [Path("shipped/two.safetensors"), Path("runs/../other/three.safetensors")]
    assert row_names(files) == ["one", "seed-0/two/two", "seed-1/two/two", "shipped/two", "three"]
    assert row_names([Path("/a.safetensors"), Path("/b/a.safetensors")]) == ["//a", "b/a"]
    with pytest.raises(BadArgument, match=r"x/../one.safetensors is given twice"):
        row_names([Path("x/../one.safetensors"), *files])


def test_files_of_the_same_name_are_rows_of_their_own(tmp_path, monkeypatch):
    files = tuple(write(tmp_path / folder / "same.safetensors", 1, seed) for seed, folder in enumerate("ab"))
    monkeypatch.setattr(module, "_arena", lambda kind, rate, arguments, seen: Evaluation(WORLD, seen, 4, 0))
    main(EvaluateArguments(files, tmp_path / "out", 4, kinds=("static",)))
    results = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert list(results) == ["a/same", "b/same"]
    assert "| b/same |" in (tmp_path / "out" / "evaluation.md").read_text()


def test_without_torch_it_says_what_to_install():
    code = "import sys, runpy; sys.modules['torch'] = None; sys.argv = ['evaluate', sys.argv[1]]; "
    code += "runpy.run_module('train.analysis.evaluate', run_name='__main__')"
    weights = str(WEIGHTS_FOLDER / "fusion.safetensors")
    result = subprocess.run([sys.executable, "-c", code, weights], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "needs the package 'torch': run pip install -e '.[train]'" in result.stderr


@pytest.mark.parametrize("backward", [0.0, -0.6])
def test_an_action_becomes_the_same_command_again(backward):
    limits = np.array([1.2, backward, 0.4, 1.1])
    for command in ((0.7, -0.3, 0.5), (backward / 2.0, 0.4, -1.1), (0.0, 0.0, 0.0)):
        action = np.array(action_from_command(VelocityCommand(*command), limits))
        assert command_from_action(action, limits) == pytest.approx(command)


def test_the_shield_spares_a_blind_policy_most_collisions(tmp_path):
    """A policy of random weights in still worlds, on bodies that do exactly what they are told."""
    world = replace(WORLD, imperfections=Imperfections.none(), tiago=1.0, go2=0.0, random=0.0)
    actor = actor_of(load_weights(write(tmp_path / "a.safetensors", 1)))
    alone = play(actor, Evaluation(world, SEEN, 24, 0)).records
    guarded = play(actor, Evaluation(world, SEEN, 24, 0), shielded=True).records
    assert alone.collision.sum() >= 12
    assert guarded.collision.sum() <= 1
