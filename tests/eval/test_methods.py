"""Learned methods, from a weights file to an episode and a picture."""

import hashlib
import json
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest

from eval.analysis.heatmap import colours_of, view_at
from eval.arguments import HeatmapArguments, RunArguments
from eval.commands import eval_, heatmap
from eval.episode import CONFIG_FIELDS, Episode, EpisodeConfig
from eval.methods import (
    ALERT_RATE,
    BEST,
    BEST_WITH_CRITIC,
    GAMMA,
    METHODS,
    OWN_VALUE,
    PAPER_GAMMA,
    ExplorerSettings,
    Method,
    MethodConfig,
    MethodOptions,
    build,
    identity_of,
    resolve,
    title_of,
)
from eval.suites import SUITES, choose, episodes_of
from robots.registry import make_body
from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.random_safety import random_safety
from tests.vuca_nav.rooms import LIDAR, disc_body
from vuca_nav.errors import BadArgument, BadWeights, UnknownName
from vuca_nav.exploration.critic import SHIPPED, LearnedCritic, load_critic
from vuca_nav.exploration.heatmap import SafetyMap
from vuca_nav.exploration.heuristic import NoCritic
from vuca_nav.files import prepare_file
from vuca_nav.navigator import Navigator
from vuca_nav.perception.perception import PerceptionConfig
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.handover import Handover
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.network import Gate
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.shield.shield import Shield
from vuca_nav.types import BodySpec, LidarSpec


@pytest.fixture
def weights(tmp_path) -> str:
    return str(random_policy(tmp_path / "p.safetensors", ObservationConfig(kind="tracked")))


@pytest.fixture
def critic(tmp_path) -> str:
    return str(random_safety(tmp_path / "s.safetensors"))


def configured(name: str, **options) -> MethodConfig:
    config = resolve(name, MethodOptions(**options))
    assert isinstance(config, MethodConfig)
    return config


def navigator_of(config: MethodConfig, body: BodySpec, lidar: LidarSpec) -> Navigator:
    navigator = build(config, body, lidar)
    assert isinstance(navigator, Navigator)
    return navigator


def built(name: str, **options) -> Navigator:
    return navigator_of(configured(name, **options), disc_body(), LIDAR)


def test_the_table():
    assert list(METHODS) == [
        "dwa-dh", "ours", "ours-dh", "paper", "paper-dh", "move_base", "move_base+dh", "oracle",
        "oracle-map", "go-straight", "obstacle-avoidance", "single", "fusion", "fusion-plus", "single-plus", "drl",
    ]  # fmt: skip
    assert resolve("dwa-dh") == MethodConfig("dynamic-window")
    assert resolve("ours").row() == {
        "controller": "network",
        "weights": "fusion-plus",
        "gate": {"uniform": False, "without": None},
        "hands_over": True,
        "recovers": True,
        "shield": True,
        "critic": "critic",
        "explorer": {
            "score": "metres",
            "rate": 0.2,
            "alert_rate": 1.0,
            "hysteresis": 3.0,
            "unknown": 4.0,
            "look_ahead": 4.0,
        },
        "gamma": 300.0,
        "tracks": "all",
        "perception": asdict(PerceptionConfig()),
    }
    assert (BEST, EpisodeConfig().method) == ("ours-dh", "ours-dh")
    assert configured(BEST_WITH_CRITIC).critic is not None


@pytest.mark.parametrize("name", [name for name in METHODS if isinstance(METHODS[name].config, MethodConfig)])
def test_every_method_of_the_table_can_be_built(name):
    navigator, config = built(name), configured(name)
    assert isinstance(navigator.policy, Shield) == config.shield
    assert isinstance(navigator.explorer.critic, NoCritic) == (config.critic is None)
    policy = navigator.policy.policy if isinstance(navigator.policy, Shield) else navigator.policy
    assert isinstance(policy, Handover) == config.hands_over
    if isinstance(policy, Handover):
        policy = policy.policy
    assert isinstance(policy, DynamicWindow if config.controller == "dynamic-window" else LearnedPolicy)
    if isinstance(policy, LearnedPolicy):
        assert policy.network.weights.path == config.weights
        assert (policy.network.weights.experts > 1) == (config.gate is not None)


def test_drl_heads_for_the_goal_itself():
    """The paper's baseline2 is given the goal and has no global planning (Section IV-C)."""
    navigator = built("drl")
    assert navigator.config.direct
    assert not built("ours-dh").config.direct
    policy = navigator.policy
    assert isinstance(policy, LearnedPolicy)
    assert policy.network.weights.observation.kind == "frames"


def test_what_the_methods_differ_in(weights):
    ours = built("ours", policy=weights)
    assert isinstance(ours.explorer.critic, LearnedCritic)
    assert isinstance(ours.policy, Shield)
    assert ours.explorer.config.gamma == GAMMA
    assert built("ours", policy=weights, gamma=2.0).explorer.config.gamma == 2.0
    assert ours.config.exploration_rate == 0.2
    assert ours.config.alert_rate == ALERT_RATE
    assert ours.config.explorer.movers_only
    assert built("ours-dh", policy=weights).config.exploration_rate == 0.2


def test_knock_outs_are_options():
    assert resolve("ours-dh", MethodOptions(no_shield=True)) == replace(configured("fusion-plus"), hands_over=True)
    uniform = built("fusion", gate="uniform").policy
    assert isinstance(uniform, LearnedPolicy)
    assert uniform.network.gate == Gate(uniform=True)
    first = built("fusion-plus", without_expert=1).policy
    assert isinstance(first, LearnedPolicy)
    assert first.network.shares == pytest.approx([0.0, 1 / 3, 1 / 3, 1 / 3])
    both = configured("ours", gate="uniform", without_expert=4, gamma=0.0)
    assert (both.gate, both.gamma, both.shield) == (Gate(uniform=True, without=4), 0.0, True)


def test_a_method_is_written_as_it_is_typed():
    row = EpisodeConfig(options=MethodOptions(gamma=0.0, no_shield=True, gate="uniform", policy="p")).row()
    assert title_of("ours", row) == "ours --policy p --gate uniform --no-shield --gamma 0.0"
    assert title_of("ours", {}) == "ours"


GOES_WITH_A_GATE = "ours, ours-dh, paper, paper-dh, fusion, fusion-plus"


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("dwa-dh", {"policy": "p"}, "drives by no weights; --policy goes with: ours, ours-dh, paper, "),
        ("dwa-dh", {"gate": "uniform"}, f"no gate over several experts; --gate goes with: {GOES_WITH_A_GATE}$"),
        ("single", {"without_expert": 1}, f"several experts; --without-expert goes with: {GOES_WITH_A_GATE}$"),
        ("fusion", {"no_shield": True}, "has no shield; --no-shield goes with: ours, ours-dh$"),
        ("fusion", {"critic": "c"}, r"has no V\^h; --critic goes with: ours, paper$"),
        ("ours-dh", {"gamma": 0.0}, r"has no V\^h; --gamma goes with: ours, paper$"),
        ("fusion", {"without_expert": 5}, "cannot leave out expert 5: .* has 4, numbered 1 to 4"),
        ("fusion", {"without_expert": 0}, "cannot leave out expert 0: .* has 4, numbered 1 to 4"),
    ],
)
def test_an_option_that_does_not_go_with_a_method_is_refused(name, options, message):
    with pytest.raises(BadArgument, match=message):
        resolve(name, MethodOptions(**options))


def test_what_does_not_go_together_is_refused(weights, tmp_path):
    with pytest.raises(BadWeights, match="no policy weights at"):
        resolve("ours", MethodOptions(policy=str(tmp_path / "none")))
    for name in ("our", "OURS"):
        with pytest.raises(UnknownName, match="did you mean 'ours'"):
            resolve(name, MethodOptions(policy=weights))
    alone = str(random_policy(tmp_path / "alone.safetensors", ObservationConfig(kind="tracked"), experts=1))
    with pytest.raises(BadArgument, match=r"alone.safetensors has a single expert; --gate goes with"):
        resolve("ours", MethodOptions(policy=alone, gate="uniform"))
    for gamma in (-1.0, float("nan"), float("inf")):
        with pytest.raises(BadArgument, match="--gamma"):
            MethodOptions(gamma=gamma)
    with pytest.raises(BadWeights, match="no policy weights at"):
        choose(SUITES["smoke"], ["ours"], options=MethodOptions(policy=str(tmp_path / "none")))
    with pytest.raises(BadWeights, match=r"none cannot be read"):
        identity_of(MethodConfig("network", tmp_path / "none"))


def test_a_critic_of_ones_own_rates_the_ways(weights, critic):
    for given, path in (({}, SHIPPED), ({"critic": critic}, critic), ({"critic": critic, "policy": None}, critic)):
        rates = built("ours", **{"policy": weights, **given}).explorer.critic
        assert isinstance(rates, LearnedCritic)
        for a, b in zip(rates.network.weights.weights, load_critic(Path(path)).weights, strict=True):
            assert np.array_equal(a, b)


def test_a_critic_that_cannot_be_used_is_refused(weights, critic, tmp_path):
    with pytest.raises(BadWeights, match=r"no weights of a critic at .*none; make them with: vuca train critic"):
        resolve("ours", MethodOptions(critic=str(tmp_path / "none")))
    with pytest.raises(BadWeights, match=r"p.safetensors: format is 'vuca-policy-1', expected 'vuca-safety-1'"):
        resolve("ours", MethodOptions(critic=weights))
    with pytest.raises(BadWeights, match=r"s.safetensors: format is 'vuca-safety-1', expected 'vuca-policy-1'"):
        resolve("ours", MethodOptions(policy=critic))
    odd = random_safety(tmp_path / "odd.safetensors", {"observation": json.dumps({})})
    with pytest.raises(BadWeights, match=r"odd.safetensors: observation is \{\}"):
        Episode(EpisodeConfig(world="static", method="ours", options=MethodOptions(critic=str(odd))))


def test_what_it_is_given_is_in_every_row(weights, critic):
    options = MethodOptions(policy=weights, gamma=1.5, critic=critic, without_expert=2, no_shield=True)
    (row,) = {json.dumps(asdict(c.options)) for c in episodes_of(choose(SUITES["smoke"], ["ours"], options=options))}
    assert json.loads(row) == {
        "policy": weights, "gate": None, "without_expert": 2, "no_shield": True, "critic": critic, "gamma": 1.5,
        "monitor": False,
    }  # fmt: skip
    flat = episodes_of(choose(SUITES["smoke"], ["ours"], options=options))[0].row()
    assert {key: flat[key] for key in json.loads(row)} == json.loads(row)


def test_other_weights_of_the_same_name_are_another_evaluation(weights, critic):
    ours = identity_of(resolve("ours"))
    assert {key: ours[key] for key in ("weights", "gamma", "critic")} == {
        "weights": "fusion-plus", "gamma": GAMMA, "critic": "critic",
    }  # fmt: skip
    assert ours["critic_sha256"] == hashlib.sha256(SHIPPED.read_bytes()).hexdigest()
    given = identity_of(resolve("ours", MethodOptions(policy=weights, gamma=2.0, critic=critic)))
    assert {key: given[key] for key in ("weights", "gamma", "critic")} == {
        "weights": weights, "gamma": 2.0, "critic": critic,
    }  # fmt: skip
    Path(critic).write_bytes(SHIPPED.read_bytes())
    again = identity_of(resolve("ours", MethodOptions(policy=weights, gamma=2.0, critic=critic)))
    assert {key for key in given if given[key] != again[key]} == {"critic_sha256"}
    assert not {"weights_sha256", "critic_sha256"} & set(identity_of(resolve("dwa-dh")))


def test_an_evaluation_under_another_configuration_is_not_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr("eval.evaluate.run_episodes", lambda *_: iter(()))
    arguments = ["smoke", "--out", str(tmp_path / "out"), "--method", "fusion", "--gate", "uniform"]
    assert eval_(arguments) == 0
    config = json.loads((tmp_path / "out" / "config.json").read_text())["config"]
    assert config["methods"] == ["fusion --gate uniform"]
    assert config["configurations"]["fusion --gate uniform"]["gate"]["uniform"] is True
    with pytest.raises(BadArgument, match=r"was begun with configurations\.fusion = null, not "):
        eval_(arguments[:-2])
    explorer = replace(configured("fusion"), explorer=ExplorerSettings(hysteresis=1.0))
    monkeypatch.setitem(METHODS, "fusion", Method("changed", explorer))
    with pytest.raises(
        BadArgument,
        match=r"was begun with configurations\.fusion --gate uniform\.explorer\.hysteresis = 3\.0, not 1\.0",
    ):
        eval_(arguments)


def test_an_evaluation_begun_by_another_critic_is_not_gone_on_with(critic, tmp_path, monkeypatch):
    monkeypatch.setattr("eval.evaluate.run_episodes", lambda *_: iter(()))
    arguments = ["smoke", "--out", str(tmp_path / "out"), "--method", "ours", "--critic", critic]
    assert eval_(arguments) == 0
    (ours,) = json.loads((tmp_path / "out" / "summary.json").read_text())["configurations"].values()
    assert ours["critic"] == critic
    Path(critic).write_bytes(SHIPPED.read_bytes())
    with pytest.raises(BadArgument, match=r"was begun with configurations\..*\.critic_sha256 = "):
        eval_(arguments)


def test_an_episode_with_any_weights_ends_the_same_every_time(weights):
    config = EpisodeConfig(world="static", method="ours", options=MethodOptions(policy=weights), without="V")
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
    config = EpisodeConfig(world="static", without="V", method="ours", options=MethodOptions(policy=weights))
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
    for kind, without in (
        (RunArguments, set()),
        (HeatmapArguments, {"monitor"}),
    ):  # the critic is asked under no monitor
        assert set(CONFIG_FIELDS) - without <= {field.name for field in fields(kind)}
    asked = []

    def view(config, *_):
        asked.append(config)
        raise KeyboardInterrupt

    monkeypatch.setattr("eval.analysis.heatmap.view_at", view)
    scene = ["--world", "square", "--movers", "3", "--seed", "4", "--start", "1", "2", "0.5", "--goal", "8", "5"]
    with pytest.raises(KeyboardInterrupt):
        heatmap([*scene, "--robot", "go2", "--gamma", "7", "--out", str(tmp_path / "h.png")])
    there = EpisodeConfig("square", None, "go2", "ours", 4, movers=3, start=(1.0, 2.0, 0.5), goal=(8.0, 5.0))
    assert asked == [replace(there, options=MethodOptions(gamma=7.0))]


@pytest.mark.parametrize("place", ["file/h.png", "."])
def test_a_picture_that_cannot_be_written_is_noticed_before_the_run(place, tmp_path, monkeypatch):
    def view(*_):
        raise AssertionError("it was run")

    monkeypatch.setattr("eval.analysis.heatmap.view_at", view)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("old")
    with pytest.raises(BadArgument, match=f"^--out {place} "):
        heatmap(["--out", place])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_looking_whether_a_file_can_be_written_changes_nothing(tmp_path):
    prepare_file(tmp_path / "new.png")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old.png").write_text("old")
    prepare_file(tmp_path / "old.png")
    assert (tmp_path / "old.png").read_text() == "old"


def test_colours_run_from_dark_to_bright():
    colours = colours_of(np.array([[0.5, 1.0], [0.75, 0.2]]), (0.5, 1.0))
    assert colours[0, 0].tolist() == [68, 1, 84]
    assert colours[0, 1].tolist() == [253, 231, 37]
    assert colours[1, 0].tolist() == [33, 145, 140]
    assert colours[1, 1].tolist() == colours[0, 0].tolist()


def test_chances_are_drawn_alike_and_a_policys_values_over_their_range():
    assert SafetyMap(np.array([[0.6, 0.9]]), (0.0, 0.0), 0.1).scale == (0.5, 1.0)
    assert SafetyMap(np.array([[-1.0, 3.0]]), (0.0, 0.0), 0.1).scale == (-1.0, 3.0)


def test_the_papers_system_is_as_printed():
    paper = configured("paper")
    assert paper.row() == {
        **resolve("fusion").row(),
        "weights": "paper",
        "critic": "own-value",
        "explorer": {
            "score": "normalised",
            "rate": 0.2,
            "alert_rate": None,
            "hysteresis": 0.0,
            "unknown": None,
            "look_ahead": None,
        },
        "gamma": PAPER_GAMMA,
        "recovers": False,
        "tracks": "map",
    }
    assert resolve("paper-dh") == replace(paper, critic=None, gamma=None)
    navigator = built("paper")
    assert navigator.explorer.config.hysteresis == 0.0
    assert navigator.explorer.config.look_ahead is None
    assert navigator.config.exploration_rate == 0.2
    assert isinstance(navigator.explorer.critic, LearnedCritic)
    assert built("paper", gamma=2.0).explorer.config.gamma == 2.0


def test_the_papers_weights_are_pinned():
    """Those of the two stages, whatever ``fusion`` becomes."""
    identity = identity_of(resolve("paper"))
    assert identity["weights_sha256"] == "44388017e26b131dc42a65241678bf714096dfcfff72cfafd2f6acabc145b686"
    assert load_weights(WEIGHTS_FOLDER / "paper.safetensors").observation.kind == "paper"


def test_what_takes_tracks_is_refused_where_they_are_for_the_map_alone(weights, critic):
    for options in ({"policy": weights}, {"critic": critic}):
        with pytest.raises(BadArgument, match=r"takes tracks, which this method has for map and costmap alone"):
            resolve("paper", MethodOptions(**options))
    with pytest.raises(BadArgument, match="a shield foresees tracks"):
        replace(configured("paper"), shield=True)


def test_every_controller_goes_with_a_shield_and_a_critic():
    body = make_body("tiago")
    config = MethodConfig("dynamic-window", shield=True, critic=SHIPPED, gamma=10.0)
    navigator = navigator_of(config, body.spec, body.lidar)
    assert isinstance(navigator.policy, Shield)
    assert isinstance(navigator.policy.policy, DynamicWindow)
    assert isinstance(navigator.explorer.critic, LearnedCritic)


@pytest.mark.parametrize(
    "wrong",
    [
        {"controller": "network"},
        {"controller": "dynamic-window", "weights": SHIPPED},
        {"controller": "dynamic-window", "gate": Gate()},
        {"controller": "dynamic-window", "gamma": 1.0},
        {"controller": "dynamic-window", "critic": OWN_VALUE},
    ],
)
def test_a_configuration_whose_parts_do_not_go_together_is_refused(wrong):
    with pytest.raises(BadArgument):
        MethodConfig(**wrong)
