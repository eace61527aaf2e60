import multiprocessing
import os
import signal
from dataclasses import replace

import pytest

from tests.train.navigation.open_ground import OpenGround
from train.arena.config import ALL_KINDS, ArenaConfig
from train.critic.config import CriticConfig
from train.navigation import commands
from train.navigation.commands import train_navigation
from train.navigation.learner import make_local_learner
from train.navigation.stages import EVERYTHING, STAGES, StageConfig, from_scratch
from train.navigation.training import NavigationTraining
from train.ppo.learner import PpoLearner
from train.ppo.run_directory import read_log
from train.ppo.team import Alone
from vuca_nav.exploration.critic import load_critic
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights

ITERATIONS = 4


def shrunken(stage: StageConfig) -> StageConfig:
    """The same stage with next to nothing to do."""
    shares = {kind: getattr(stage.arena, kind) for kind in ALL_KINDS}
    robots = min(stage.arena.robots, 2)
    arena = ArenaConfig(**shares, robots=robots, lengths=stage.arena.lengths, layouts=1, pairs=4, num_bodies=2)
    ppo = replace(stage.ppo, worlds=8, horizon=4, minibatch=16, critic_first=min(stage.ppo.critic_first, 2))
    network = replace(stage.network, hidden=8, gate=4, critic=8)
    return replace(stage, arena=arena, ppo=ppo, network=network, steps=ITERATIONS * 8 * 4)


@pytest.fixture
def tiny(monkeypatch):
    for name, stage in list(STAGES.items()):
        monkeypatch.setitem(STAGES, name, shrunken(stage))
    monkeypatch.setattr(NavigationTraining, "save_every", 2)
    critic = CriticConfig(arena=ArenaConfig(layouts=1, pairs=4, num_bodies=2), rounds=2, episodes=8, hidden=8)
    monkeypatch.setattr(commands, "CriticConfig", lambda: critic)


@pytest.mark.parametrize("stage", STAGES.values(), ids=list(STAGES))
def test_what_is_shipped_was_trained_as_its_row_says(stage):
    weights = load_weights(WEIGHTS_FOLDER / f"{stage.name}.safetensors")
    # The shipped weights are of a time when names were spelt with underscores.
    about = {key: weights.metadata[key].replace("_", "-") for key in ("command", "rewards", "steps", "experts_from")}
    assert about["command"].startswith(f"vuca train {stage.name}")
    assert about["rewards"] == stage.rewards
    assert 0 <= int(about["steps"]) - stage.steps < stage.ppo.worlds * stage.ppo.horizon
    assert tuple(about["experts_from"].split()) == stage.sources
    assert weights.observation == stage.observation
    assert weights.experts == stage.network.experts


def train_all(out, *options):
    return train_navigation("all", ["--out", str(out), "--workers", "1", *options])


def _die_in(out, name):
    """Be killed, as by a power cut, in this stage's last iteration."""
    real = NavigationTraining.train

    def train(self, learner, **options):
        if self.stage.name == name:
            iterate = PpoLearner.iterate

            def torn(self, progress):
                if self.iteration == ITERATIONS - 1:
                    os.kill(os.getpid(), signal.SIGKILL)
                return iterate(self, progress)

            PpoLearner.iterate = torn  # type: ignore[method-assign]
        real(self, learner, **options)

    NavigationTraining.train = train  # type: ignore[method-assign]
    train_all(out)


@pytest.mark.slow
def test_all_of_them_one_after_another_killed_and_gone_on_with(tmp_path, tiny, capsys):
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    assert train_all(whole) == 0
    assert [line.rsplit("/", 2)[1] for line in capsys.readouterr().out.splitlines()] == [*EVERYTHING, "critic"]
    child = multiprocessing.get_context("fork").Process(target=_die_in, args=(torn, "fusion"))
    child.start()
    child.join()
    assert child.exitcode == -signal.SIGKILL
    assert {path.name for path in torn.iterdir()} == {*EVERYTHING[: EVERYTHING.index("fusion") + 1]}
    assert train_all(torn, "--resume") == 0
    critics = [load_critic(out / "critic" / "critic.safetensors") for out in (whole, torn)]
    assert all((a == b).all() for a, b in zip(critics[0].weights, critics[1].weights))
    for name in EVERYTHING:
        first, second = (out / name / f"{name}.safetensors" for out in (whole, torn))
        weights, again = load_weights(first), load_weights(second)
        assert weights.observation == STAGES[name].observation
        assert weights.experts == STAGES[name].network.experts
        assert weights.metadata["experts_from"].split() == list(STAGES[name].sources)
        for one, other in ((weights.weights, again.weights), (weights.critic_weights, again.critic_weights)):
            assert all((a == b).all() for a, b in zip(one, other))
        assert [row["iteration"] for row in read_log(torn / name / "log.jsonl")] == list(range(1, ITERATIONS + 1))
        assert (torn / name / f"{name}.md").read_text().startswith(f"# {name}\n")


@pytest.mark.parametrize("name", EVERYTHING)
def test_every_stage_can_also_start_from_scratch(name, tiny):
    stage = from_scratch(STAGES[name])
    assert not stage.sources
    assert "random weights" in stage.about or stage == STAGES[name]
    ground = OpenGround(stage, stage.ppo.worlds)
    mind = make_local_learner(stage, 0, Alone(), ground)
    mind.restart()
    before = [parameter.clone() for name, parameter in mind.actor.named_parameters() if name != "log_std"]
    mind.iterate(0.0)
    after = [parameter for name, parameter in mind.actor.named_parameters() if name != "log_std"]
    assert any((a != b).any() for a, b in zip(before, after))
