"""Learned methods, from a weights file to an episode and a picture."""

import json
from dataclasses import fields

import numpy as np
import pytest

from eval import methods
from eval.arguments import HeatmapArguments, RunArguments
from eval.commands import heatmap
from eval.episode import Episode, EpisodeConfig
from eval.heatmap import check_writable, colours_of, view_at
from eval.methods import ALL, EXPLORATION_RATE, GAMMA, METHODS, Learned, StackRequest, find_method
from eval.suites import SUITES, episodes_of
from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.rooms import LIDAR, disc_body
from vuca_nav.errors import BadArgument, BadWeights, UnknownName
from vuca_nav.exploration.heuristic import NoCritic
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.safety import LearnedSafety
from vuca_nav.policy.shield import Shield
from vuca_nav.telemetry import Telemetry


@pytest.fixture
def weights(tmp_path) -> str:
    return str(random_policy(tmp_path / "p.safetensors", ObservationConfig(kind="tracked")))


def build(name: str, **options):
    request = StackRequest(disc_body(), LIDAR, "slam", Telemetry(), **options)
    return find_method(name, **options).build(request)


def test_only_methods_that_can_run_are_listed():
    for name, method in ALL.items():
        assert (name in METHODS) == (method.learned is None or method.learned.is_shipped)


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
    assert isinstance(build("fusion+", policy=weights).policy, LearnedPolicy)
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
    with pytest.raises(BadArgument, match="has no safety term; --gamma goes with: ours"):
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


def test_weights_and_gamma_are_in_every_row(weights):
    configs = episodes_of(SUITES["smoke"], method="ours", policy=weights, gamma=1.5)
    assert {(c.row()["policy"], c.row()["gamma"]) for c in configs} == {(weights, 1.5)}


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

    monkeypatch.setattr("eval.heatmap.view_at", view)
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

    monkeypatch.setattr("eval.heatmap.view_at", view)
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
