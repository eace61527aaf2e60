import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.vuca_nav.random_policy import random_policy
from train.arena.arena import Arena
from train.arena.config import ArenaConfig, Imperfections
from train.critic import learner as learner_module
from train.critic import samples as samples_module
from train.critic.config import CriticConfig
from train.critic.learner import CriticLearner
from train.critic.samples import BINS, Samples, judge, play
from train.critic.training import CriticTraining
from train.navigation.commands import train_navigation
from train.navigation.mirror import observation_mirror
from train.navigation.networks import NetworkConfig, make_critic
from train.navigation.weights import actor_of
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.exploration.critic import load_critic
from vuca_nav.policy.observation import ObservationConfig, goal_features
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.provenance import commit

TRACKED = ObservationConfig(kind="tracked")
STRAIGHT_ON = np.array([1.0, 0.0, 0.0], np.float32)
ARENA = ArenaConfig(layouts=1, pairs=8, num_bodies=2)
TINY = CriticConfig(arena=ARENA, rounds=3, episodes=12, passes=1, hidden=8, minibatch=64)


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / "fusion-plus" / "fusion-plus.safetensors"
    path.parent.mkdir()
    return random_policy(path, TRACKED, hidden=8)


class Ahead:
    """A policy that only goes straight on."""

    def gate(self, observation):
        return observation[:, :1]

    def mean(self, observation, shares):
        return torch.from_numpy(STRAIGHT_ON).expand(len(observation), 3)


def test_what_a_meeting_counts_falls_with_the_time_before_it():
    arena = Arena(replace(ARENA.of("dynamic"), movers=(20, 20)), TRACKED, 64, 0, once=True)
    config = replace(TINY, spacing=1, sent=0.0)
    samples = play(arena, Ahead(), config, 5)  # type: ignore[arg-type]
    again = Arena(replace(ARENA.of("dynamic"), movers=(20, 20)), TRACKED, 64, 0, once=True)
    again.reset(5)
    ages = np.zeros(64, int)
    while (active := again.active).any():
        again.step(np.tile(STRAIGHT_ON, (64, 1)))
        ages[active] += 1
    assert len(samples.safety) == ages.sum()
    first = samples.safety[:64]  # of the first decision; the others have hit the outer wall
    met = first < 1.0
    assert 10 < met.sum() < 64
    assert first[met] == pytest.approx(1.0 - np.exp(-0.1 * ages[met] / config.time), abs=1e-6)
    assert samples.safety.min() == pytest.approx(1.0 - math.exp(-0.1 / config.time), abs=1e-6)


def test_walls_count_for_nothing():
    arena = Arena(ARENA.of("static"), TRACKED, 64, 0, once=True)
    samples = play(arena, Ahead(), TINY, 5)  # type: ignore[arg-type]
    assert arena.outputs.collided.sum() > 10
    assert (samples.safety == 1.0).all()


def test_who_is_sent_elsewhere_sees_it_at_once():
    arena = Arena(replace(ARENA, imperfections=Imperfections.none()), TRACKED, 4, 3, threads=2)
    observation = arena.reset()
    before = observation.copy()
    second = arena.shards[1]
    goals = second.rows.pose[:1, :2] + (3.0, 4.0)
    second.send_to(np.array([0]), goals)
    assert (observation[[0, 1, 3]] == before[[0, 1, 3]]).all()
    yaw = second.rows.pose[0, 2]
    c, s = math.cos(yaw), math.sin(yaw)
    expected = goal_features(np.array([[3.0 * c + 4.0 * s, 4.0 * c - 3.0 * s]]))[0]
    assert observation[2, TRACKED.goal_slice] == pytest.approx(expected, abs=1e-6)
    rest = np.delete(np.arange(TRACKED.size), np.arange(TRACKED.size)[TRACKED.goal_slice])
    assert (observation[2, rest] == before[2, rest]).all()
    progress = arena.step(np.zeros((4, 3), np.float32)).progress
    assert progress[2] == pytest.approx(0.0, abs=1e-6)  # of 5 m, it has gone nowhere
    assert observation[2, TRACKED.goal_slice] == pytest.approx(expected, abs=1e-5)


def test_what_was_seen_before_another_goal_was_given_is_not_learnt_from(monkeypatch):
    arena = Arena(replace(ARENA.of("square"), movers=(0, 0)), TRACKED, 64, 0, once=True)
    config = replace(TINY, spacing=1, sent=1.0, sent_elsewhere=(4, 5))
    goals = []
    real = samples_module._send_elsewhere

    def spy(arena, sent, draws):
        real(arena, sent, draws)
        if sent.any():
            goals.append((sent.copy(), arena.outputs.observation[:, TRACKED.goal_slice].copy()))

    monkeypatch.setattr(samples_module, "_send_elsewhere", spy)
    samples = play(arena, Ahead(), config, 5)  # type: ignore[arg-type]
    ((sent, seen),) = goals
    assert sent.sum() > 32
    # The first samples are of the decision at which they were sent, with the goals that they were given.
    assert samples.observations[: sent.sum(), TRACKED.goal_slice] == pytest.approx(seen[sent])
    original = Arena(replace(ARENA.of("square"), movers=(0, 0)), TRACKED, 64, 0, once=True)
    observation = original.reset(5)
    for _ in range(4):
        original.step(np.tile(STRAIGHT_ON, (64, 1)))
    changed = (observation[sent, TRACKED.goal_slice] != seen[sent]).any(axis=1)
    assert changed.mean() > 0.7  # some are sent where they were going


def test_samples_do_not_depend_on_the_threads(policy):
    actor = actor_of(load_weights(policy))
    one, two = (play(Arena(ARENA, TRACKED, 12, 0, threads, once=True), actor, TINY, 9) for threads in (1, 2))
    for a, b in zip(one, two):
        assert np.array_equal(a, b)
    assert 0 < len(one.safety) == len(one.observations)


def test_foresight_is_judged_by_hand():
    network = make_critic(1, NetworkConfig(critic=4), torch.Generator().manual_seed(0))
    with torch.no_grad():
        for layer in network:
            if isinstance(layer, torch.nn.Linear):
                layer.weight.zero_()
        network[-1].bias.fill_(math.log(0.8 / 0.2))  # type: ignore[union-attr]
    report = judge(network, Samples(np.zeros((4, 1), np.float32), np.array([1.0, 1.0, 1.0, 0.0], np.float32)))
    assert report["loss"] == pytest.approx(-(3.0 * math.log(0.8) + math.log(0.2)) / 4.0)
    assert report["baseline"] == pytest.approx(-(0.75 * math.log(0.75) + 0.25 * math.log(0.25)))
    assert report["met"] == pytest.approx(0.25)
    assert sum(report["count"]) == 4
    at = report["count"].index(4)
    assert at in (7, 8)
    assert (report["foreseen"][at], report["came"][at]) == (pytest.approx(0.8), pytest.approx(0.75))
    assert len(report["came"]) == BINS


def test_a_run_that_is_gone_on_with_gives_the_same_bits(policy, tmp_path, monkeypatch):
    def train(out, config=TINY, resume=False):
        training = CriticTraining(config, 4, policy, out, 1, "vuca train critic", resume=resume)
        training.run()
        return load_critic(training.weights)

    whole = train(tmp_path / "whole")
    export = CriticTraining.export

    def torn(self, learner, done, elapsed):
        if done == 2:  # after the log's row, before the checkpoint
            raise KeyboardInterrupt
        export(self, learner, done, elapsed)

    monkeypatch.setattr(CriticTraining, "export", torn)
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path / "torn")
    monkeypatch.setattr(CriticTraining, "export", export)
    with pytest.raises(BadArgument, match="go on with it by --resume"):
        train(tmp_path / "torn")
    with pytest.raises(BadArgument, match=r"differs in critic.passes"):
        train(tmp_path / "torn", replace(TINY, passes=2), resume=True)
    again = train(tmp_path / "torn", resume=True)
    for a, b in zip((*whole.weights, *whole.biases), (*again.weights, *again.biases)):
        assert np.array_equal(a, b)
    rows = [json.loads(line) for line in (tmp_path / "torn" / "log.jsonl").read_text().splitlines()]
    assert [row["iteration"] for row in rows] == [1, 2, 3]
    assert (tmp_path / "torn" / "curves.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "torn" / "critic.md").read_text()
    assert page.startswith("# critic\n")
    assert f"- Commit: {commit() or 'not known'}" in page
    assert "; seed 4\n" in page


@pytest.mark.parametrize(
    "damaged", [None, b"", b"garbage\n" * 3, b"[]\n", b"{}\n", b"\xff\xfe\n", b'{"iteration": 2}\n']
)
def test_a_damaged_log_is_told_in_one_line(policy, tmp_path, damaged):
    def train(resume):
        CriticTraining(replace(TINY, rounds=1), 4, policy, tmp_path / "run", 1, "", resume=resume).run()

    train(False)
    log, page = tmp_path / "run" / "log.jsonl", tmp_path / "run" / "critic.md"
    page.unlink()
    log.unlink()
    if damaged is not None:
        log.write_bytes(damaged)
    with pytest.raises(BadArgument, match=r"log\.jsonl.*; put it back.*, or give another --out$"):
        train(True)


def test_the_arenas_threads_are_let_go_also_when_it_is_interrupted(policy, tmp_path, monkeypatch):
    def interrupted(arena, *_):
        raise KeyboardInterrupt

    closed = []
    monkeypatch.setattr(learner_module, "play", interrupted)
    monkeypatch.setattr(Arena, "close", lambda self: closed.append(self))
    with pytest.raises(KeyboardInterrupt):
        CriticTraining(TINY, 4, policy, tmp_path / "run", 2, "", resume=False).run()
    assert len(closed) == 1


def test_the_command(policy, tmp_path, capsys):
    small = ["--rounds", "1", "--episodes", "8", "--layouts", "1", "--pairs", "4", "--num-bodies", "2", "--hidden", "8"]
    arguments = ["--out", str(tmp_path), "--workers", "1", *small]
    assert train_navigation("critic", arguments) == 0
    assert capsys.readouterr().out.strip() == f"weights: {tmp_path}/critic/critic.safetensors"
    assert load_critic(tmp_path / "critic" / "critic.safetensors").metadata["seed"] == "0"
    with pytest.raises(BadArgument, match="seed must be 0 or more"):
        train_navigation("critic", [*arguments, "--seed", "-1", "--out", str(tmp_path / "b")])
    with pytest.raises(BadWeights, match=r"no policy weights at .*none/mine/mine.safetensors"):
        train_navigation("critic", [*arguments, "--out", str(tmp_path / "none"), "--policy", "mine"])
    with pytest.raises(BadArgument, match="--workers must be 1 or more"):
        train_navigation("critic", [*arguments, "--workers", "0"])
    for changes in ({"rounds": 0}, {"sent_elsewhere": (5, 5)}, {"time": 0.0}):
        with pytest.raises(BadArgument):
            replace(TINY, **changes)


def test_who_drives_is_ones_own_policy_or_the_shipped_one(policy, tmp_path, monkeypatch, capsys):
    drove = []

    class Noted(CriticTraining):
        def run(self):
            drove.append(self.policy.path)

    monkeypatch.setattr("train.navigation.commands.CriticTraining", Noted)
    assert train_navigation("critic", ["--out", str(tmp_path)]) == 0
    assert "shipped" not in capsys.readouterr().err
    assert train_navigation("critic", ["--out", str(tmp_path / "other")]) == 0
    assert f"no {tmp_path}/other/fusion-plus/fusion-plus.safetensors, so the shipped" in capsys.readouterr().err
    assert drove == [policy, WEIGHTS_FOLDER / "fusion-plus.safetensors"]


def test_what_is_learnt_on_one_side_holds_on_the_other():
    config = replace(TINY, passes=30, rate=1e-2, hidden=16)
    learner = CriticLearner(config, 1, None, TRACKED, None)  # type: ignore[arg-type]
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (512, TRACKED.size)).astype(np.float32)
    sine = TRACKED.goal_slice.start + 2
    samples = Samples(x, (x[:, sine] > 0.0).astype(np.float32))  # safe to the left, which nobody can know
    learner.learn(samples, torch.Generator().manual_seed(2))
    ask = torch.zeros(1, TRACKED.size)
    ask[0, sine] = 1.0
    order, signs = observation_mirror(TRACKED)
    with torch.no_grad():
        left, right = (learner.network(seen).sigmoid().item() for seen in (ask, ask[:, order] * signs))
    assert abs(left - right) < 0.3
