import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
import torch
from torch.multiprocessing.spawn import start_processes

from tests.train.navigation.open_ground import OpenGround
from train.arena.config import ArenaConfig
from train.critic.config import CriticConfig
from train.navigation.commands import train_navigation
from train.navigation.config import NavigationPpoConfig, RunConfig
from train.navigation.learner import make_local_learner
from train.navigation.networks import NetworkConfig
from train.navigation.skills import skill_labels
from train.navigation.stages import STAGES, StageConfig
from train.navigation.training import NavigationTraining, check_run
from train.ppo import run_directory
from train.ppo.learner import PpoLearner
from train.ppo.run_directory import read_log
from train.ppo.team import Alone, Team
from vuca_nav.errors import BadArgument
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.provenance import Commit

SMALL = ObservationConfig(sectors=4)
PPO = NavigationPpoConfig(worlds=16, horizon=8, minibatch=32, epochs=2)
NETWORK = NetworkConfig(experts=2, hidden=16, gate=8, critic=16)
STAGE = StageConfig("tiny", "For tests.", "go-straight", ArenaConfig(), SMALL, NETWORK, PPO, 6 * 16 * 8)


def test_what_follows_a_time_out_is_the_last_thing_seen_in_it():
    stage = dataclasses.replace(STAGE, ppo=dataclasses.replace(PPO, horizon=64, minibatch=32))
    ground = OpenGround(stage, PPO.worlds)
    mind = make_local_learner(stage, 0, Alone(), ground)
    mind.restart()
    seen = []
    step = ground.step

    def watched(action):
        outcome = step(action)
        seen.append(outcome)
        return outcome

    ground.step = watched  # type: ignore[method-assign]
    with torch.no_grad():
        rollout, _ = mind.rollouts.collect(0.0, torch.Generator().manual_seed(0))
        timed_out = torch.from_numpy(np.array([outcome.timed_out for outcome in seen]))
        reached = torch.from_numpy(np.array([outcome.reached for outcome in seen]))
        assert timed_out.any()
        for t, outcome in enumerate(seen):
            final = mind.critic(torch.from_numpy(outcome.final_observation))
            then = mind.critic(torch.from_numpy(outcome.observation))
            assert torch.allclose(rollout.following[t, timed_out[t]], final[timed_out[t]], atol=1e-6)
            goes_on = ~(timed_out[t] | reached[t])
            assert torch.allclose(rollout.following[t, goes_on], then[goes_on], atol=1e-6)
    assert torch.equal(rollout.terminated[..., 0], reached)
    assert torch.equal(rollout.done[..., 0], reached | timed_out)


def learner(team=None, ppo=PPO, seed=0, network=NETWORK):
    stage = dataclasses.replace(STAGE, ppo=ppo, network=network)
    mind = make_local_learner(stage, seed, team or Alone(), OpenGround(stage, ppo.worlds))
    mind.restart()
    return mind


class TwoInOne(Alone):
    """Stands for two workers: averages with gradients that are put in."""

    def __init__(self, others):
        self.others = others

    def average_gradients(self, parameters):
        for parameter, other in zip(parameters, self.others):
            assert parameter.grad is not None
            parameter.grad = (parameter.grad + other) / 2.0


def part_of(batch, rows):
    from tensordict import TensorDict

    return TensorDict({key: tensor[rows].clone() for key, tensor in batch.items()}, [len(rows)])


def test_averaged_gradients_of_halves_are_those_of_the_whole():
    generator = torch.Generator().manual_seed(1)
    batch = {
        "observation": torch.randn(64, SMALL.size, generator=generator),
        "action": torch.randn(64, 3, generator=generator), "action_log_prob": torch.zeros(64) - 3.0,
        "advantage": torch.randn(64, 1, generator=generator), "value_target": torch.randn(64, 1, generator=generator),
    }  # fmt: skip
    whole, half = learner(), learner()
    seen = []
    half.team = TwoInOne([])
    half.team.average_gradients = lambda parameters: seen.append([p.grad.clone() for p in parameters])  # type: ignore
    state = {key: tensor.clone() for key, tensor in half.actor.state_dict().items()}
    critic = {key: tensor.clone() for key, tensor in half.critic.state_dict().items()}
    half.update(part_of(batch, torch.arange(32)))
    half = learner(TwoInOne(seen[0]))
    half.actor.load_state_dict(state)
    half.critic.load_state_dict(critic)
    half.update(part_of(batch, torch.arange(32, 64)))
    whole.update(part_of(batch, torch.arange(64)))
    for one, other in zip(half.actor.parameters(), whole.actor.parameters()):
        assert torch.allclose(one.grad, other.grad, atol=1e-6)  # type: ignore[arg-type]
    for one, other in zip(half.critic.parameters(), whole.critic.parameters()):
        assert torch.allclose(one.grad, other.grad, atol=1e-6)  # type: ignore[arg-type]


def _meet(rank, meeting, out):
    team = Team(rank, 2, meeting)
    parameters = [torch.nn.Parameter(torch.zeros(2, 2)), torch.nn.Parameter(torch.zeros(3))]
    for k, parameter in enumerate(parameters):
        parameter.grad = torch.full_like(parameter, float(10 * rank + k))
    team.average_gradients(parameters)
    torch.save([parameter.grad for parameter in parameters], out / f"{rank}.pt")
    team.close()


def test_two_processes_average_their_gradients(tmp_path):
    start_processes(_meet, (tmp_path / "meeting", tmp_path), nprocs=2, start_method="fork")
    for rank in range(2):
        first, second = torch.load(tmp_path / f"{rank}.pt", weights_only=True)
        assert torch.equal(first, torch.full((2, 2), 5.0))
        assert torch.equal(second, torch.full((3,), 6.0))


def test_a_point_learns_to_walk_to_its_goal():
    ppo = NavigationPpoConfig(worlds=64, horizon=16, minibatch=256)
    mind = learner(ppo=ppo)
    reports = [mind.iterate(k / 40) for k in range(40)]
    assert reports[0]["reward/R_g"] < 0.02
    assert reports[-1]["reward/R_g"] > 0.15  # 3 * 0.1 m straight to the goal would be 0.3


def test_critic_first_leaves_the_actor_alone():
    mind = learner(ppo=dataclasses.replace(PPO, critic_first=1))
    actor = [p.clone() for p in mind.actor.parameters()]
    critic = [p.clone() for p in mind.critic.parameters()]
    mind.iterate(0.0)
    assert all(torch.equal(p, q) for p, q in zip(actor, mind.actor.parameters()))
    assert not all(torch.equal(p, q) for p, q in zip(critic, mind.critic.parameters()))
    mind.iterate(0.0)
    assert not all(torch.equal(p, q) for p, q in zip(actor, mind.actor.parameters()))


def test_a_gate_is_taught_before_the_experts_learn():
    ppo = dataclasses.replace(PPO, worlds=64, critic_first=12, teach_gate=True, minibatch=128, gate_rate=10.0)
    mind = learner(ppo=ppo, network=dataclasses.replace(NETWORK, experts=4))
    experts = [p.clone() for p in mind.actor.layers.parameters()]  # type: ignore[attr-defined]
    for _ in range(12):
        mind.iterate(0.0)
    assert all(torch.equal(p, q) for p, q in zip(experts, mind.actor.layers.parameters()))  # type: ignore[attr-defined]
    with torch.no_grad():
        rollout, _ = mind.rollouts.collect(0.0, torch.Generator().manual_seed(0))
    seen = rollout.seen["observation"].flatten(0, 1)
    labels = skill_labels(seen, SMALL)
    assert len(labels.unique()) > 1
    right = mind.actor.gate(seen).argmax(1) == labels  # type: ignore[operator]
    assert float(right.float().mean()) > 0.9


def test_only_a_gate_of_four_can_be_taught():
    with pytest.raises(BadArgument, match="teach_gate"):
        learner(ppo=dataclasses.replace(PPO, critic_first=1, teach_gate=True))


def run(out, stage=STAGE, workers=1, **options):
    training = NavigationTraining(stage, RunConfig(1, workers, ()), out, OpenGround, **options)
    training.run()
    return training.weights.read_bytes()


def numbers(out):
    rows = read_log(out / "log.jsonl")
    return [{key: value for key, value in row.items() if "speed" not in key and key != "seconds"} for row in rows]


def test_the_same_seed_gives_the_same_bits_also_when_interrupted(tmp_path, monkeypatch):
    monkeypatch.setattr(NavigationTraining, "save_every", 2)
    whole = run(tmp_path / "whole")
    assert run(tmp_path / "again") == whole

    real = PpoLearner.iterate

    def torn(self, progress):
        if self.iteration == 5:
            raise KeyboardInterrupt
        return real(self, progress)

    monkeypatch.setattr(PpoLearner, "iterate", torn)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "torn")
    monkeypatch.setattr(PpoLearner, "iterate", real)
    with pytest.raises(BadArgument, match="--resume"):
        run(tmp_path / "torn")
    assert run(tmp_path / "torn", resume=True) == whole
    assert numbers(tmp_path / "torn") == numbers(tmp_path / "whole")
    assert len(numbers(tmp_path / "whole")) == 6
    for name in ("curves.png", "tiny.md", "tensorboard", "config.json"):
        assert (tmp_path / "whole" / name).exists()
    with pytest.raises(BadArgument, match=r"stage\.ppo\.gamma"):
        run(tmp_path / "whole", dataclasses.replace(STAGE, ppo=dataclasses.replace(PPO, gamma=0.9)), resume=True)


def test_the_page_and_the_weights_name_the_commits_and_the_seed(tmp_path, monkeypatch):
    monkeypatch.setattr(NavigationTraining, "save_every", 2)
    real, out = PpoLearner.iterate, tmp_path / "run"

    def torn(self, progress):
        if self.iteration == 3:
            raise KeyboardInterrupt
        return real(self, progress)

    monkeypatch.setattr(run_directory, "find_commit", lambda: Commit("0123456789ab", None))
    monkeypatch.setattr(PpoLearner, "iterate", torn)
    with pytest.raises(KeyboardInterrupt):
        run(out)
    monkeypatch.setattr(PpoLearner, "iterate", real)
    changed = dataclasses.replace(STAGE, about="Said in other words.")
    for now in ("ba9876543210-dirty", "of a run that has nothing left to do"):
        monkeypatch.setattr(run_directory, "find_commit", lambda now=now: Commit(now, None))
        run(out, changed, resume=True)
    page = (out / "tiny.md").read_text()
    assert "- Commit: 0123456789ab, then ba9876543210-dirty\n" in page
    assert "; seed 1, 1 workers\n" in page
    assert load_weights(out / "tiny.safetensors").metadata["commit"] == "0123456789ab, ba9876543210-dirty"


def test_a_run_that_began_before_commits_were_noted(finished, tmp_path):
    out = shutil.copytree(finished, tmp_path / "run")
    config = json.loads((out / "config.json").read_text())
    assert config.pop("commits")
    (out / "config.json").write_text(json.dumps(config))
    run(out, resume=True)
    assert "- Commit: not known\n" in (out / "tiny.md").read_text()


def _damaged(out, name, content):
    (out / name).unlink()
    if content is not None:
        (out / name).write_bytes(content)
    return out


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("finished") / "run"
    run(out)
    (out / "tiny.md").unlink()  # as if it had been killed just before the end
    return out


@pytest.mark.parametrize(
    "content", [None, b"", b"garbage\n" * 9, b"[]\n", b"null\n{}\n", b"\xff\n", b'{"iteration": 1}\n']
)
def test_a_damaged_log_is_told_in_one_line(finished, tmp_path, content):
    out = _damaged(shutil.copytree(finished, tmp_path / "run"), "log.jsonl", content)
    with pytest.raises(BadArgument, match=r"log\.jsonl.*; put it back.*, or give another --out$"):
        run(out, resume=True)


@pytest.mark.parametrize("content", [None, b"", b"[]", b"3", b"{", b"\xff"])
def test_a_damaged_configuration_is_told_in_one_line(finished, tmp_path, content):
    out = _damaged(shutil.copytree(finished, tmp_path / "run"), "config.json", content)
    with pytest.raises(
        BadArgument, match=r"config\.json (cannot be read|is not the configuration).*; give another --out$"
    ):
        run(out, resume=True)


def test_a_log_that_came_to_no_checkpoint_is_begun_anew(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "log.jsonl").write_text("garbage\n" * 3)
    run(tmp_path / "run")
    assert [row["iteration"] for row in numbers(tmp_path / "run")] == [1, 2, 3, 4, 5, 6]


def test_a_run_that_began_from_other_weights_is_not_gone_on_with(tmp_path):
    alone = dataclasses.replace(STAGE, name="alone", network=dataclasses.replace(NETWORK, experts=1), steps=16 * 8)

    def start(out, seed):
        training = NavigationTraining(alone, RunConfig(seed, 1, ()), out, OpenGround)
        training.run()
        return training.weights

    source, other = start(tmp_path / "a", 1), start(tmp_path / "b", 2)
    config = RunConfig(1, 1, (source, other))
    NavigationTraining(STAGE, config, tmp_path / "two", OpenGround).run()
    NavigationTraining(STAGE, config, tmp_path / "two", OpenGround, resume=True).run()
    with pytest.raises(BadArgument, match="sources"):
        NavigationTraining(STAGE, RunConfig(1, 1, (other, source)), tmp_path / "two", OpenGround, resume=True)
    source.write_bytes(other.read_bytes())
    with pytest.raises(BadArgument, match="sources"):
        NavigationTraining(STAGE, config, tmp_path / "two", OpenGround, resume=True)


def test_workers_learn_the_same_from_shares_of_the_worlds(tmp_path):
    first, second = (run(tmp_path / name, workers=2) for name in "ab")
    assert first == second
    assert first != run(tmp_path / "c")


@pytest.mark.parametrize(("workers", "what"), [(0, "--workers"), (10_000, "--workers")])
def test_bad_workers(tmp_path, workers, what):
    with pytest.raises(BadArgument, match=what):
        NavigationTraining(STAGE, RunConfig(0, workers, ()), tmp_path, OpenGround)


def test_worlds_must_be_shared_out_evenly(tmp_path, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 12)
    stage = dataclasses.replace(STAGE, ppo=dataclasses.replace(PPO, worlds=12))
    message = "--workers 3 cannot share out 12 worlds and minibatches of 32 evenly; 1, 2, 4 can"
    with pytest.raises(BadArgument, match=message):
        NavigationTraining(stage, RunConfig(0, 3, ()), tmp_path, OpenGround)


@pytest.mark.parametrize(("cores", "workers"), [(1, 1), (3, 2), (6, 4), (7, 4), (10, 8), (12, 8), (100, 64)])
def test_by_default_as_many_workers_as_cores_that_share_out_evenly(cores, workers, tmp_path, monkeypatch):
    class Run:
        weights = "there"

        def __init__(self, stage, run, *_, resume):
            check_run(stage, run)
            started.append(run.workers)

        def run(self):
            pass

    started = []
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(cores)))
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    monkeypatch.setattr("train.navigation.commands.NavigationTraining", Run)
    for name in STAGES:
        assert train_navigation(name, ["--out", str(tmp_path)]) == 0
    one_world = [stage.ppo.worlds == stage.arena.robots > 1 for stage in STAGES.values()]
    assert started == [1 if is_one else workers for is_one in one_world]


@pytest.mark.parametrize(
    ("config", "field", "value"),
    [
        (PPO, "worlds", 0), (PPO, "minibatch", 129), (PPO, "gamma", 1.5), (PPO, "first_rate", float("nan")),
        (PPO, "entropy", -1.0), (NETWORK, "hidden", 0), (NETWORK, "initial_std", 0.0), (STAGE, "steps", 0),
        (STAGE, "copy_noise", float("nan")), (SMALL, "sectors", 0), (SMALL, "max_range", float("inf")),
        (CriticConfig(), "rounds", 0), (CriticConfig(), "time", float("inf")), (CriticConfig(), "rate", float("inf")),
        (CriticConfig(), "sent", 1.5), (CriticConfig(), "sent_elsewhere", (5, 5)),
    ],
)  # fmt: skip
def test_settings_out_of_their_range(config, field, value):
    with pytest.raises(BadArgument, match=f"^{field} must be .*, got {re.escape(repr(value))}$") as caught:
        dataclasses.replace(config, **{field: value})
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize("name", ["../evil", "a/b", "/a", "a/", "..", ".", ""])
def test_a_policy_stays_in_its_directory(name):
    with pytest.raises(BadArgument, match="name must be the plain name of a file, without a path"):
        dataclasses.replace(STAGE, name=name)


def test_every_policy_comes_after_those_it_starts_from():
    seen = set()
    for name, stage in STAGES.items():
        assert name == stage.name
        assert set(stage.sources) <= seen
        assert len(stage.sources) in (0, stage.network.experts)
        json.dumps(dataclasses.asdict(stage))
        seen.add(name)
