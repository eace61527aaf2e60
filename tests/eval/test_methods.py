"""Learned methods, from a weights file to an episode and a picture."""

import hashlib
import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from eval import methods
from eval.analysis.heatmap import check_writable, colours_of, view_at
from eval.arguments import HeatmapArguments, RunArguments
from eval.commands import eval_, heatmap
from eval.episode import Episode, EpisodeConfig
from eval.methods import (
    ALL,
    EXPLORATION_RATE,
    GAMMA,
    METHODS,
    Learned,
    StackRequest,
    find_method,
    identity_of,
    runnable,
)
from eval.suites import SUITES, episodes_of
from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.random_safety import random_safety
from tests.vuca_nav.rooms import LIDAR, disc_body
from vuca_nav.errors import BadArgument, BadWeights, UnknownName
from vuca_nav.exploration.critic import SHIPPED, LearnedSafety, load_safety
from vuca_nav.exploration.heuristic import NoCritic
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.shield.shield import Shield
from vuca_nav.telemetry.interface import Telemetry


@pytest.fixture
def weights(tmp_path) -> str:
    return str(random_policy(tmp_path / "p.safetensors", ObservationConfig(kind="tracked")))


@pytest.fixture
def critic(tmp_path) -> str:
    return str(random_safety(tmp_path / "s.safetensors"))


def build(name: str, **options):
    request = StackRequest(disc_body(), LIDAR, "slam", Telemetry(), **options)
    return find_method(name, **options).build(request)


def test_only_methods_that_can_run_are_listed(tmp_path, monkeypatch):
    assert list(METHODS) == list(ALL)  # all weights are shipped
    monkeypatch.setattr(methods, "WEIGHTS_FOLDER", tmp_path)
    monkeypatch.setattr(methods, "SHIPPED", tmp_path / "safety.safetensors")
    assert list(runnable()) == ["dwa-dh"]
    (tmp_path / "fusion-plus.safetensors").touch()
    assert set(runnable()) == {"dwa-dh", "ours-dh", "fusion-plus", "fusion-plus-uniform"}
    (tmp_path / "safety.safetensors").touch()
    assert set(runnable()) == {"dwa-dh", "ours-dh", "fusion-plus", "fusion-plus-uniform", "ours"}


def test_what_the_methods_differ_in(weights):
    ours = build("ours", policy=weights)
    assert isinstance(ours.explorer.critic, LearnedSafety)
    assert isinstance(ours.policy, Shield)
    assert ours.explorer.critic.policy is ours.policy.policy
    assert ours.explorer.config.gamma == GAMMA
    assert build("ours", policy=weights, gamma=2.0).explorer.config.gamma == 2.0
    assert ours.config.exploration_rate == EXPLORATION_RATE
    without = build("ours-dh", policy=weights)
    assert isinstance(without.policy, Shield)
    assert isinstance(without.explorer.critic, NoCritic)
    assert without.config.exploration_rate == 0.2
    assert isinstance(build("fusion-plus", policy=weights).policy, LearnedPolicy)
    uniform = build("fusion-uniform", policy=weights).policy
    assert isinstance(uniform, LearnedPolicy)
    assert uniform.network.gate.uniform
    assert not isinstance(build("dwa-dh").policy, LearnedPolicy)


def test_a_shipped_file_is_found_by_its_methods(tmp_path, monkeypatch):
    monkeypatch.setattr(methods, "WEIGHTS_FOLDER", tmp_path)
    random_policy(tmp_path / "single.safetensors", experts=1)
    learned = Learned("single")
    assert isinstance(learned.build(StackRequest(disc_body(), LIDAR, "slam", Telemetry())).policy, LearnedPolicy)
    with pytest.raises(BadWeights, match="no policy weights at"):
        Learned("none").build(StackRequest(disc_body(), LIDAR, "slam", Telemetry()))


def test_what_does_not_go_together_is_refused(weights, tmp_path):
    with pytest.raises(BadArgument, match="drives by no weights"):
        find_method("dwa-dh", policy=weights)
    with pytest.raises(BadArgument, match=r"has no V\^h; --gamma goes with: ours"):
        find_method("ours-dh", policy=weights, gamma=1.0)
    with pytest.raises(BadWeights, match="no policy weights at"):
        find_method("ours", policy=str(tmp_path / "none"))
    with pytest.raises(UnknownName, match="did you mean 'ours'"):
        find_method("our", policy=weights)
    with pytest.raises(BadArgument, match=r"paper.safetensors looks at .*: take a method without V\^h"):
        find_method("ours", policy=str(random_policy(tmp_path / "paper.safetensors")))
    for gamma in (-1.0, float("nan"), float("inf")):
        with pytest.raises(BadArgument, match="--gamma"):
            EpisodeConfig(gamma=gamma)
    with pytest.raises(BadWeights, match="no policy weights at"):
        episodes_of(SUITES["smoke"], method="ours", policy=str(tmp_path / "none"))


def test_a_critic_of_ones_own_rates_the_ways(weights, critic):
    for given, path in (
        ({}, SHIPPED),
        ({"safety": critic}, Path(critic)),
        ({"safety": critic, "policy": None}, critic),
    ):
        rates = build("ours", **{"policy": weights, **given}).explorer.critic
        assert isinstance(rates, LearnedSafety)
        for a, b in zip(rates._weights, load_safety(Path(path)).weights, strict=True):
            assert np.array_equal(a, b)


def test_a_critic_that_cannot_be_used_is_refused(weights, critic, tmp_path):
    for name in ("dwa-dh", "ours-dh", "fusion-plus"):
        with pytest.raises(BadArgument, match=rf"'{re.escape(name)}' has no V\^h; --safety goes with: ours$"):
            find_method(name, safety=critic)
    with pytest.raises(BadWeights, match=r"no weights of a safety critic at .*none; make them with: vuca train critic"):
        find_method("ours", safety=str(tmp_path / "none"))
    with pytest.raises(BadWeights, match=r"p.safetensors: format is 'vuca-policy-1', expected 'vuca-safety-1'"):
        find_method("ours", safety=weights)
    with pytest.raises(BadWeights, match=r"s.safetensors: format is 'vuca-safety-1', expected 'vuca-policy-1'"):
        find_method("ours", policy=critic)
    odd = random_safety(tmp_path / "odd.safetensors", {"observation": json.dumps({})})
    with pytest.raises(BadWeights, match=r"odd.safetensors: observation is \{\}"):
        Episode(EpisodeConfig(world="static", safety=str(odd)))
    paper = str(random_policy(tmp_path / "paper.safetensors"))
    with pytest.raises(BadArgument, match=r"critic s\.safetensors at .*or a critic that looks at the same"):
        episodes_of(SUITES["smoke"], policy=paper, safety=critic)


def test_what_it_is_given_is_in_every_row(weights, critic):
    configs = episodes_of(SUITES["smoke"], method="ours", policy=weights, gamma=1.5, safety=critic)
    assert {(c.row()["policy"], c.row()["gamma"], c.row()["safety"]) for c in configs} == {(weights, 1.5, critic)}


def test_other_weights_of_the_same_name_are_another_evaluation(weights, critic, tmp_path):
    ours = identity_of("ours")
    assert {key: ours[key] for key in ("policy", "gamma", "safety")} == {
        "policy": "fusion-plus", "gamma": GAMMA, "safety": "safety",
    }  # fmt: skip
    assert ours["safety_sha256"] == hashlib.sha256(SHIPPED.read_bytes()).hexdigest()
    given = identity_of("ours", policy=weights, gamma=2.0, safety=critic)
    assert {key: given[key] for key in ("policy", "gamma", "safety")} == {
        "policy": weights, "gamma": 2.0, "safety": critic,
    }  # fmt: skip
    Path(critic).write_bytes(SHIPPED.read_bytes())
    again = identity_of("ours", policy=weights, gamma=2.0, safety=critic)
    assert {key for key in given if given[key] != again[key]} == {"safety_sha256"}
    assert set(identity_of("ours-dh")) == {"policy", "sha256"}
    assert identity_of("dwa-dh") == {}


def test_an_evaluation_begun_by_another_critic_is_not_gone_on_with(critic, tmp_path, monkeypatch):
    monkeypatch.setattr("eval.evaluate.run_episodes", lambda *_: iter(()))
    arguments = ["smoke", "--out", str(tmp_path / "out"), "--safety", critic]
    assert eval_(arguments) == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["safety"] == critic
    Path(critic).write_bytes(SHIPPED.read_bytes())
    with pytest.raises(BadArgument, match="was begun with safety_sha256 = "):
        eval_(arguments)


def test_an_episode_with_any_weights_ends_the_same_every_time(weights):
    config = EpisodeConfig(world="static", method="ours", policy=weights, without="V")
    episode = Episode(config)
    episode.timeout = 2.0
    rows = [episode.run().row() for _ in range(2)]
    for row in rows:
        for timing in ("real_time_factor", "wall_time", "set_up_time"):
            del row[timing]
    assert rows[0] == rows[1]
    assert rows[0]["policy"] == weights


def test_a_heatmap_shows_the_critics_values_around_the_robot(weights, tmp_path, capsys):
    out = tmp_path / "h.png"
    arguments = ["--out", str(out), "--world", "static", "--without", "V", "--policy", weights]
    arguments += ["--at", "0.5", "--half-side", "2", "--resolution", "0.5", "--json"]
    assert heatmap(arguments) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["time"] == pytest.approx(0.5)
    assert out.read_bytes().startswith(b"\x89PNG")
    config = EpisodeConfig(world="static", without="V", method="ours", policy=weights)
    view = view_at(config, 0.5, 2.0, 0.5)
    assert view.safety.values.shape == (8, 8)
    assert (told["least"], told["greatest"]) == (view.least, view.greatest)
    pose = view.map_from_base
    assert view.safety.lower_left == pytest.approx((pose.x - 2.0, pose.y - 2.0))
    with pytest.raises(BadArgument, match="has no critic"):
        view_at(EpisodeConfig(world="static", method="dwa-dh"), 0.0, 2.0, 0.5)
    for at, half_side, resolution in ((-1.0, 2.0, 0.5), (1.0, 2.0, 0.0), (1.0, 0.1, 0.5), (1.0, 800.0, 0.1)):
        with pytest.raises(BadArgument, match="must be"):
            view_at(config, at, half_side, resolution)


def test_a_heatmap_is_told_of_its_scene_what_a_run_is(tmp_path, monkeypatch):
    for kind in (RunArguments, HeatmapArguments):
        assert {field.name for field in fields(EpisodeConfig)} <= {field.name for field in fields(kind)}
    asked = []

    def view(config, *_):
        asked.append(config)
        raise KeyboardInterrupt

    monkeypatch.setattr("eval.analysis.heatmap.view_at", view)
    scene = ["--world", "square", "--movers", "3", "--seed", "4", "--start", "1", "2", "0.5", "--goal", "8", "5"]
    with pytest.raises(KeyboardInterrupt):
        heatmap([*scene, "--robot", "go2", "--gamma", "7", "--out", str(tmp_path / "h.png")])
    assert asked == [
        EpisodeConfig("square", None, "go2", "ours", 4, movers=3, start=(1.0, 2.0, 0.5), goal=(8.0, 5.0), gamma=7.0)
    ]


@pytest.mark.parametrize("place", ["no/h.png", "."])
def test_a_picture_that_cannot_be_written_is_noticed_before_the_run(place, tmp_path, monkeypatch):
    def view(*_):
        raise AssertionError("it was run")

    monkeypatch.setattr("eval.analysis.heatmap.view_at", view)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadArgument, match=f"cannot write {place}: "):
        heatmap(["--out", place])
    assert list(tmp_path.iterdir()) == []


def test_looking_whether_a_file_can_be_written_changes_nothing(tmp_path):
    check_writable(tmp_path / "new.png")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old.png").write_text("old")
    check_writable(tmp_path / "old.png")
    assert (tmp_path / "old.png").read_text() == "old"


def test_colours_run_from_dark_to_bright():
    colours = colours_of(np.array([[0.5, 1.0], [0.75, 0.2]]))
    assert colours[0, 0].tolist() == [68, 1, 84]
    assert colours[0, 1].tolist() == [253, 231, 37]
    assert colours[1, 0].tolist() == [33, 145, 140]
    assert colours[1, 1].tolist() == colours[0, 0].tolist()
