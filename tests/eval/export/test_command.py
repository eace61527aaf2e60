"""``vuca export`` and ``vuca check``: what was exported is what was evaluated, and what is wrong is told."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from eval.export.command import export
from eval.method_config import MethodConfig
from eval.methods import resolve, stack_config
from robots.registry import make_body
from vuca_nav.cli import EXTRA_OF_MODULE
from vuca_nav.deploy.bundle import load_bundle
from vuca_nav.deploy.check import check
from vuca_nav.deploy.manifest import CRITIC_GRAPH, POLICY_GRAPH, STEPS, write_bundle
from vuca_nav.deploy.steps import read_steps, steps_file
from vuca_nav.errors import BadArgument, BadBundle
from vuca_nav.plain import to_plain


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A bundle of TIAGo and `ours`, with few steps."""
    out = tmp_path_factory.mktemp("exported") / "bundle"
    assert export(["--method", "ours", "--gamma", "200", "--steps", "60", "--out", str(out)]) == 0
    return out


@pytest.fixture
def copy(exported, tmp_path):
    return shutil.copytree(exported, tmp_path / "copy")


def rewrite(directory, about=None, **changed):
    """Change files of a bundle, and sign it again."""
    manifest = load_bundle(directory).manifest
    files = {name: (directory / name).read_bytes() for name in manifest.files}
    before = {key: value for key, value in manifest.content.items() if key not in ("files", "digest")}
    write_bundle(directory, {**files, **changed}, {**before, **(about or {})})


def test_a_bundle_is_the_stack_that_the_testbed_drives(exported):
    bundle, body = load_bundle(exported), make_body("tiago")
    method = resolve("ours")
    assert isinstance(method, MethodConfig)
    expected = stack_config(replace(method, gamma=200.0))
    assert to_plain(bundle.body) == to_plain(body.spec)
    assert bundle.lidar == body.lidar
    assert bundle.config == replace(expected, weights=bundle.config.weights, critic=bundle.config.critic)
    for copied, own in ((bundle.config.weights, method.weights), (bundle.config.critic, method.critic)):
        assert isinstance(copied, Path)
        assert isinstance(own, Path)
        assert copied.parent == exported
        assert copied.read_bytes() == own.read_bytes()


def test_a_sound_bundle_is_found_sound_and_drives_to_the_bit(exported, capsys):
    assert check([str(exported), "--json"]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["sound"]
    assert {parity["steps"] for parity in report["parity"] if "policy" in parity["name"]} == {60}
    assert report["stack"]["equal"] == report["stack"]["ticks"] >= 60
    assert report["stack"]["first"] is None
    assert all(latency["median"] > 0.0 for latency in report["latency"])


def test_the_manifest_tells_what_goes_in_and_what_was_measured(exported):
    content = load_bundle(exported).manifest.content
    scan = content["contract"]["inputs"]["scan"]
    assert (scan["shape"], scan["unit"], scan["frame"], scan["rate"]) == ([360], "m", "laser", 30.0)
    assert "NaN" in scan["values"]
    assert content["training"]["policy"]["at_the_end"]["reached"] == "77.2%"
    assert content["evaluation"]["evaluations"] is None  # none is kept with this gamma
    assert "none of ours --gamma 200" in content["evaluation"]["reason"]


def test_a_wrong_graph_is_told_with_exit_code_1(copy, capsys):
    model = onnx.load(copy / POLICY_GRAPH)
    bias = next(each for each in model.graph.initializer if list(each.dims) == [4, 3])
    values = onnx.numpy_helper.to_array(bias).copy()
    values += 0.05
    bias.CopyFrom(onnx.numpy_helper.from_array(values, bias.name))
    rewrite(copy, **{POLICY_GRAPH: model.SerializeToString()})
    assert check([str(copy)]) == 1
    told = capsys.readouterr().out
    assert "NOT SOUND" in told
    assert "the stack's network action and the recorded" in told


def test_steps_of_another_network_are_told(copy, capsys):
    steps = read_steps(copy / STEPS)
    rewrite(copy, **{STEPS: steps_file(steps._replace(actions=steps.actions + 2e-5), {})})
    assert check([str(copy)]) == 1
    rewrite(copy, **{STEPS: steps_file(steps._replace(observations=steps.observations[:, :-1]), {})})
    with pytest.raises(BadBundle, match="takes 157 numbers, the recorded steps have 156"):
        check([str(copy)])


def test_a_stack_that_drives_otherwise_is_told_on_a_machine_of_the_same_kind(copy, capsys):
    steps = read_steps(copy / STEPS)
    commands = steps.commands.copy()
    commands[40, 2] += 1e-9
    rewrite(copy, **{STEPS: steps_file(steps._replace(commands=commands), {})})
    assert check([str(copy)]) == 1
    assert "from tick 40 on they differ, by up to 1e-09: NO, on a machine of the same kind" in capsys.readouterr().out
    made_by = load_bundle(copy).manifest.content["made_by"]
    rewrite(copy, {"made_by": {**made_by, "machine": {**made_by["machine"], "cpu": "another"}}})
    assert check([str(copy)]) == 0
    assert "another processor, C library or version" in capsys.readouterr().out


def test_a_graph_with_another_contract_is_told(copy):
    model = onnx.load(copy / CRITIC_GRAPH)
    onnx.helper.set_model_props(model, {"vuca.contract": "{}"})
    rewrite(copy, **{CRITIC_GRAPH: model.SerializeToString()})
    assert check([str(copy)]) == 1


@pytest.mark.parametrize("content", [b"", b"no graph", np.random.default_rng(0).bytes(1000)])
def test_what_is_no_graph_is_refused(copy, content):
    rewrite(copy, **{POLICY_GRAPH: content})
    with pytest.raises(BadBundle, match="is no graph that ONNX Runtime runs"):
        check([str(copy)])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("first_ticks", np.array([1]), "does not divide"),
        ("commands", np.zeros((3, 3)), "has shape"),
        ("goals", np.full((1, 2), np.nan), "not finite"),
    ],
)
def test_steps_that_cannot_be_are_refused(copy, name, content, message):
    steps = read_steps(copy / STEPS)
    rewrite(copy, **{STEPS: steps_file(steps._replace(**{name: content}), {})})
    with pytest.raises(BadBundle, match=message):
        check([str(copy)])


def test_a_bundle_without_a_network_has_no_graph(tmp_path, capsys):
    out = tmp_path / "bundle"
    assert export(["--method", "dwa-dh", "--steps", "30", "--out", str(out)]) == 0
    assert not (out / POLICY_GRAPH).exists()
    assert check([str(out)]) == 0
    assert "no network drives" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("method", "message"),
    [
        ("oracle", "needs the truth of the simulation"),
        ("move_base", "is part of the testbed"),
        ("json:loads", "a planner of your own is Python"),
    ],
)
def test_what_cannot_be_exported_is_told(tmp_path, method, message):
    with pytest.raises(BadArgument, match=message):
        export(["--method", method, "--trust", "--out", str(tmp_path / "bundle")])
    assert not (tmp_path / "bundle").exists()


def test_what_runs_the_users_own_code_needs_trust(tmp_path):
    with pytest.raises(BadArgument, match="add --trust"):
        export(["--method", "my_planner:build", "--out", str(tmp_path / "bundle")])


def test_a_planner_of_the_users_own_is_refused_without_being_run(tmp_path, monkeypatch):
    (tmp_path / "my_planner.py").write_text("raise SystemExit('it ran')\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadArgument, match="a planner of your own is Python"):
        export(["--method", "my_planner:build", "--trust", "--out", str(tmp_path / "bundle")])


def test_the_manifest_does_not_tell_where_the_bundle_lay(exported):
    command = load_bundle(exported).manifest.content["command"]
    assert command == "vuca export --method ours --gamma 200 --steps 60 --out bundle"


def test_the_extra_that_brings_onnxruntime_is_named(copy, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        check([str(copy)])
    assert EXTRA_OF_MODULE[caught.value.name or ""] == "deploy"
