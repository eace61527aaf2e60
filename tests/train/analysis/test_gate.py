import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from tqdm import tqdm

from eval.analysis.measurements.files import read_measurement
from train.analysis.episodes import Evaluation
from train.analysis.evaluate import EvaluateArguments, evaluate
from train.analysis.gate.play import Decisions, Scene, play_without, watch
from train.analysis.gate.plots import draw_moments, draw_shares, typical_moment
from train.analysis.gate.summary import MOTIONS, episode_rows, motions, summarise
from train.analysis.gate.tables import tables
from train.analysis.gate.watch import GateArguments, main
from train.analysis.situations import DEAD_END, OPEN_FLOOR, OTHER, SITUATIONS, SUDDEN_MOVER, ArenaSituations
from train.arena.config import ArenaConfig
from train.navigation.networks import FusedActor, NetworkConfig, make_critic
from train.navigation.weights import export
from vuca_nav.cli import run_module
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig

SEEN = ObservationConfig(sectors=12)
WORLD = ArenaConfig(layouts=1, pairs=8, num_bodies=2, movers=(4, 8), time_factor=0.5, time_slack=2.0).driven_by("tiago")


def actor_with(gate, means):
    """A policy that does not look: its gate has these shares, its experts do these actions (E, 3)."""
    actor = FusedActor(SEEN.size, NetworkConfig(experts=len(gate), hidden=4, gate=4), torch.Generator())
    for parameter in actor.parameters():
        parameter.data.zero_()
    actor.layers[2].bias.data = torch.atanh(torch.tensor(means))
    assert actor.gate_layers is not None
    actor.gate_layers[2].bias.data = torch.tensor(gate).log()
    return actor


def bar():
    return tqdm(disable=True)


class Recording(Evaluation):
    """Notes down every decision's situation and action."""

    def again(self, only=None):
        super().again(only)
        self.situations, self.seen = ArenaSituations(self.arena), []

    def step(self, action):
        rows = np.flatnonzero(self.active)
        self.situations.look(rows)
        self.seen += zip(self.situations.label[rows].tolist(), action[rows].tolist())
        return super().step(action)


def test_what_is_noted_of_every_decision():
    actor = actor_with([0.7, 0.3], [[0.8, 0.5, 0.0], [-0.4, 0.5, 0.6]])
    evaluation = Recording(WORLD.of("dynamic"), SEEN, 10, 0)
    watched = watch(actor, SEEN, evaluation, bar())
    decisions = watched.decisions
    assert (np.diff(decisions.episode) >= 0).all()
    count = np.bincount(decisions.episode, minlength=10)
    assert count == pytest.approx(np.ceil(evaluation.records().time * 10 - 1e-6))
    assert decisions.shares == pytest.approx(np.tile([0.7, 0.3], (count.sum(), 1)), abs=1e-6)
    assert decisions.alone[5] == pytest.approx(np.array([[0.8, 0.0, 0.0], [-0.4, 0.0, 0.6]]))  # TIAGo has no v_y
    fused = np.tanh(0.7 * np.arctanh([0.8, 0.0]) + 0.3 * np.arctanh([-0.4, 0.6]))
    assert decisions.action[7] == pytest.approx([fused[0], 0.0, fused[1]], abs=1e-6)
    assert sorted(decisions.situation.tolist()) == sorted(label for label, _ in evaluation.seen)
    assert np.array_equal(watched.success, evaluation.records().success)
    for (episode, age), scene in watched.scenes.items():
        at = np.flatnonzero(decisions.episode == episode)[age]
        assert decisions.situation[at] != OTHER
        assert age == 0 or decisions.situation[at - 1] != decisions.situation[at]
        assert len(scene.ranges) == WORLD.num_beams


def test_an_expert_is_knocked_out_in_its_situation_only():
    actor = actor_with([0.999, 0.001], [[0.6, 0.0, 0.1], [0.0, 0.0, 0.9]])
    evaluation = Recording(WORLD.of("dynamic"), SEEN, 10, 0)
    only = np.arange(10) < 6
    play_without(actor, evaluation, only, 0, OPEN_FLOOR, bar())
    labels, actions = np.array([label for label, _ in evaluation.seen]), np.array([a for _, a in evaluation.seen])
    assert {OPEN_FLOOR, OTHER} <= set(labels.tolist())
    assert actions[labels == OPEN_FLOOR] == pytest.approx(np.tile([0.0, 0.0, 0.9], ((labels == OPEN_FLOOR).sum(), 1)))
    assert (actions[labels != OPEN_FLOOR, 0] > 0.59).all()
    assert (evaluation.records().time[6:] == 0.0).all()


def test_a_sure_gate_can_be_knocked_out():
    actor = actor_with([1.0, 1.0], [[0.6, 0.0, 0.0], [0.0, 0.0, 0.9]])
    assert actor.gate_layers is not None
    actor.gate_layers[2].bias.data = torch.tensor([500.0, 0.0])  # the other share is 0 in single precision
    evaluation = Recording(WORLD.of("static"), SEEN, 4, 0)
    play_without(actor, evaluation, np.ones(4, np.bool_), 0, OTHER, bar())
    assert all(action[2] == pytest.approx(0.9) for label, action in evaluation.seen if label == OTHER)


def test_what_a_command_does_most_of():
    commands = [[0.9, 0, 0.3], [0.3, 0, -0.9], [0.05, 0.1, -0.1], [-0.5, 0, 0.2], [0.2, -0.6, 0.3], [-0.5, 0, 0.7]]
    names = [MOTIONS[k] for k in motions(np.array(commands))]
    assert names == ["forward", "turn", "stop", "backward", "sideways", "turn"]


def made(situation, shares, episode, w_z=0.5):
    count = len(episode)
    alone = np.zeros((count, 2, 3), np.float32)
    alone[:, 0, 0], alone[:, 1, 0] = 0.8, -0.5
    action = np.zeros((count, 3), np.float32)
    action[:, 0], action[:, 2] = shares[:, 0], w_z * (-1.0) ** np.arange(count)
    return Decisions(
        np.asarray(episode), np.asarray(situation), np.arange(count) % 4, shares.astype(np.float32), action, alone,
        np.linspace(0.0, 2.0, count).astype(np.float32),
    )  # fmt: skip


def test_means_by_situation():
    first = np.array([0.9, 0.7, 0.2, 0.2, 0.4, 0.6])
    decisions = made([0, 0, 3, 3, 3, 3], np.stack([first, 1.0 - first], 1), [0, 0, 0, 0, 1, 1])
    summary = summarise(decisions, np.array([0, 1]), ("static", "mixed"))
    hall, end = summary["situations"]["open floor"], summary["situations"]["dead end"]
    assert (hall["decisions"], hall["episodes"], end["decisions"], end["episodes"]) == (2, 1, 4, 2)
    assert hall["experts"][0]["share"][0] == pytest.approx(0.8)
    assert hall["experts"][0]["leads"] == [1.0, 1.0, 1.0]
    assert hall["experts"][1]["command_where_it_leads"]["v_x"] is None
    assert [expert["leads"][0] for expert in end["experts"]] == [0.25, 0.75]
    assert end["experts"][1]["command_where_it_leads"]["v_x"][0] == pytest.approx((0.2 + 0.2 + 0.4) / 3)
    assert end["experts"][1]["command_where_it_leads"]["turn"][0] == pytest.approx(0.5)
    assert end["experts"][1]["command_where_it_leads"]["w_z"][0] == pytest.approx(0.5 / 3)
    assert end["experts"][0]["command_alone"]["v_x"] == pytest.approx([0.8, 0.8, 0.8])
    assert end["experts"][1]["motion_alone"]["backward"][0] == 1.0
    entropy = -np.mean([p * np.log(p) + (1 - p) * np.log(1 - p) for p in (0.9, 0.7)])
    assert hall["entropy"][0] == pytest.approx(entropy)
    assert summary["situations"]["sudden mover"]["decisions"] == 0
    assert summary["situations"]["all"]["experts"][0]["share"][0] == pytest.approx(first.mean())
    assert summary["worlds"]["mixed"] == dict.fromkeys(SITUATIONS, 0) | {"dead end": 2}
    assert summary["skills"]["forward"]["leads"][0][0] == pytest.approx(0.5)
    one, other = episode_rows(decisions, np.array([0, 1]), ("static", "mixed"), "two")
    assert one["situations"] == {
        "open floor": {"decisions": 2, "leads": [2, 0], "shares": [1.6, 0.4]},
        "dead end": {"decisions": 2, "leads": [0, 2], "shares": [0.4, 1.6]},
    }
    assert (one["policy"], one["kind"], one["seed"], other["kind"], other["seed"]) == ("two", "static", 0, "mixed", 0)
    assert other["situations"]["dead end"]["leads"] == [1, 1]
    text = tables(summary)
    assert "| dead end | 4 | 2 |" in text
    assert "\n| sudden mover |" not in text


def test_intervals_draw_episodes_not_decisions():
    """Forty episodes of 100 alike decisions are forty observations: +-1.96 sqrt(0.25 / 40), not a tenth of that."""
    episode = np.repeat(np.arange(40), 100)
    first = (episode % 2).astype(float)
    decisions = made(np.zeros(4000, int), np.stack([first, 1.0 - first], 1), episode)
    share = summarise(decisions, np.zeros(40, int), ("static",))["situations"]["open floor"]["experts"][0]["share"]
    assert share[0] == 0.5
    assert share[1] == pytest.approx(0.5 - 0.155, abs=0.03)
    assert share[2] == pytest.approx(0.5 + 0.155, abs=0.03)
    # With the kinds of worlds as strata, what differs between them alone is no doubt.
    by_kind = summarise(decisions, np.arange(40) % 2, ("static", "mixed"))["situations"]["open floor"]["experts"][0]
    assert by_kind["share"] == pytest.approx([0.5, 0.5, 0.5])


def test_the_typical_moment_is_of_the_foremost_expert():
    situation = np.full(120, OTHER)
    situation[30:40] = situation[50:60] = situation[90:100] = situation[3:13] = DEAD_END
    situation[110] = SUDDEN_MOVER
    first = np.full(120, 0.5)
    first[30:40], first[50:60], first[90:100], first[3:13] = 0.1, 0.8, 0.75, 1.0
    episode = np.repeat([0, 1], 60)
    decisions = made(situation, np.stack([first, 1.0 - first], 1), episode)
    assert typical_moment(decisions, DEAD_END, 10.0) == (90, 100)  # 50 is too near to the episode's end
    assert typical_moment(decisions, SUDDEN_MOVER, 10.0) == (110, 111)
    assert typical_moment(decisions, OPEN_FLOOR, 10.0) is None


def test_the_pictures(tmp_path):
    situation = np.array([OTHER] * 25 + [OPEN_FLOOR] * 25)
    decisions = made(situation, np.tile([0.7, 0.3], (50, 1)), np.zeros(50, int))
    draw_shares(summarise(decisions, np.zeros(1, int), ("static",)), "title", tmp_path / "shares.png")
    square = np.array([(0.2, -0.2), (0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2)])
    scene = Scene(np.full(180, 2.0, np.float32), np.array([(1.0, 1.0, 0.5, 0.0, 0.3)]), (4.0, 1.0), square)
    draw_moments(decisions, {(0, 25): scene}, 10.0, "title", tmp_path / "moments.png")
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in ("shares.png", "moments.png"))


def write(path, experts):
    network = NetworkConfig(experts=experts, hidden=8, gate=8, critic=8)
    generator = torch.Generator().manual_seed(0)
    actor, critic = FusedActor(SEEN.size, network, generator), make_critic(SEEN.size, network, generator)
    for parameter in actor.parameters():
        parameter.data = torch.randn(parameter.shape, generator=generator)
    export(path, path.stem, actor, critic, network, SEEN, 10.0, {})
    return path


def evaluated(path, episodes):
    return evaluate(EvaluateArguments((path,), episodes=episodes, kinds=("static", "mixed")))


@pytest.mark.slow
def test_the_command(tmp_path, capsys):
    two = write(tmp_path / "two.safetensors", 2)
    main(GateArguments((two,), tmp_path / "out", 8, kinds=("static", "mixed"), knock_outs=True))
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    result = summary["policies"]["two"]
    assert summary["arguments"]["episodes"] == 8
    assert (
        sum(row["decisions"] for name, row in result["situations"].items() if name != "all")
        == (result["situations"]["all"]["decisions"])
    )
    assert result["success"] == {
        kind: row["success"] for kind, row in evaluated(two, 8)["two"]["as it is"].items()
    }  # fmt: skip
    assert [row["expert"] for row in result["knock_outs"]] == [1, 2] * len(SITUATIONS)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "summary.json", "two_shares.png", "two_moments.png", "gate.jsonl"
    }  # fmt: skip
    rows = read_measurement(tmp_path / "out" / "gate.jsonl").rows
    assert [(row["policy"], row["kind"], row["seed"]) for row in rows] == [
        ("two", kind, seed) for kind in ("static", "mixed") for seed in range(8)
    ]
    for situation, told in result["situations"].items():
        here = [row["situations"][situation]["decisions"] for row in rows if situation in row["situations"]]
        assert situation == "all" or (sum(here), len(here)) == (told["decisions"], told["episodes"])
    table = capsys.readouterr().out
    assert "Without an expert in one situation" in table
    assert "| situation | episodes | success % | expert 1 | expert 2 |" in table


def test_what_cannot_be_watched(tmp_path, monkeypatch, capsys):
    one, two = write(tmp_path / "one.safetensors", 1), write(tmp_path / "two.safetensors", 2)
    good = GateArguments((two,), tmp_path / "out")
    for wrong, message in (
        (replace(good, files=(one,)), "without a gate"),
        (replace(good, files=()), "one or more"),
        (replace(good, files=(two, two)), "same name"),
        (replace(good, episodes=0), "one or more"),
        (replace(good, kinds=()), "one or more"),
        (replace(good, out=two), "is a file, expected a directory"),
    ):
        with pytest.raises(BadArgument, match=message):
            main(wrong)
    monkeypatch.setattr("sys.argv", ["gate", str(tmp_path / "no.safetensors")])
    with pytest.raises(SystemExit) as exit_request:
        run_module("gate", main, GateArguments)
    assert exit_request.value.code == 2
    assert "no.safetensors" in capsys.readouterr().err
