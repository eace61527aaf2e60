import dataclasses
import json
import math

import numpy as np
import pytest
import torch

from robots.go2 import GO2
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE, fill_observation, trot_angles
from robots.locomotion.model import QuadrupedModel
from robots.locomotion.network import load_policy
from train.locomotion.curves import read_log
from train.locomotion.environment import EnvironmentConfig, LocomotionEnvironment
from train.locomotion.evaluate import CONTROL, prepare_out, tracking_errors
from train.locomotion.kernels import CRITIC_SIZE, NUM_UNIFORM, REWARDS, Batch, _reset
from train.locomotion.policy import Normaliser, action_mirror, observation_mirror, privileged_mirror
from train.locomotion.ppo import PpoConfig
from train.locomotion.run import Stage, Training, TrainingConfig
from vuca_nav.cli import main
from vuca_nav.errors import BadArgument
from vuca_nav.types import VelocityCommand

SMALL = EnvironmentConfig(num_robots=8)
STAGES = (Stage(0.0, 120, 0, 0.0), Stage(0.5, 120, 2, 1.0))


def tiny(minutes):
    ppo = PpoConfig(horizon=4, epochs=1, minibatches=2)
    return TrainingConfig(seed=1, minutes=minutes, threads=1, environment=SMALL, ppo=ppo, stages=STAGES)


@pytest.mark.parametrize(
    ("mirror", "size"),
    [(action_mirror(), ACTION_SIZE), (observation_mirror(), OBSERVATION_SIZE), (privileged_mirror(), CRITIC_SIZE)],
)
def test_a_mirror_twice_is_no_mirror(mirror, size):
    order, signs = np.array(mirror[0]), np.array(mirror[1])
    x = np.random.default_rng(0).normal(size=size)
    once = signs * x[order]
    assert not np.allclose(once, x)
    assert signs * once[order] == pytest.approx(x)


def test_the_observation_of_a_mirrored_robot_is_the_mirrored_observation():
    model = QuadrupedModel(GO2)
    tuning = model.tuning(1.0 / 60.0)
    rng = np.random.default_rng(0)
    order, signs = (np.array(part) for part in action_mirror())
    gyro, up, command = rng.normal(size=(3, 3))
    q, dq, action = rng.normal(size=(3, 12))
    velocity, clock = rng.normal(size=2), np.array([0.15, 1.0])
    here, there = np.empty(OBSERVATION_SIZE), np.empty(OBSERVATION_SIZE)
    fill_observation(tuning, gyro, up, command, q, dq, action, clock, velocity, here)
    fill_observation(
        tuning, gyro * (-1, 1, -1), up * (1, -1, 1), command * (1, -1, -1), signs * q[order], signs * dq[order],
        signs * action[order], np.array([0.65, 1.0]), velocity * (1, -1), there,
    )  # fmt: skip
    order, signs = (np.array(part) for part in observation_mirror())
    assert there == pytest.approx(signs * here[order], abs=1e-9)


def test_the_nominal_trot_is_symmetric():
    model = QuadrupedModel(GO2)
    tuning = model.tuning(1.0 / 60.0)
    order, signs = (np.array(part) for part in action_mirror())
    here, there = np.empty(12), np.empty(12)
    trot_angles(model.legs, tuning, np.array([0.5, 0.2, 0.7]), np.array([0.2, 1.0]), here)
    trot_angles(model.legs, tuning, np.array([0.5, -0.2, -0.7]), np.array([0.7, 1.0]), there)
    assert there == pytest.approx(signs * here[order], abs=1e-9)


def test_the_normaliser_knows_mean_and_deviation():
    normaliser = Normaliser(3, ([0, 1, 2], [1.0, 1.0, 1.0]))
    x = torch.tensor(np.random.default_rng(0).normal((1.0, -2.0, 5.0), (1.0, 2.0, 0.1), (4000, 3)), dtype=torch.float32)
    for part in x.split(500):
        normaliser.update(part)
    assert normaliser.mean.numpy() == pytest.approx(x.mean(0).numpy(), abs=1e-3)
    assert normaliser(x).std(0).numpy() == pytest.approx([1.0, 1.0, 1.0], abs=0.02)


def test_the_nominal_trot_stands():
    """Without commands and pushes, a zero action keeps the robots up: the servos' targets carry the weight."""
    environment = LocomotionEnvironment(GO2, SMALL, np.random.default_rng(0))
    environment.difficulty = 0.0
    falls, reward = 0, 0.0
    for _ in range(60):
        step = environment.step(np.zeros((8, ACTION_SIZE), np.float32))
        falls += int(step.terminated.sum())
        reward += float(step.reward.mean())
    assert falls <= 1  # one may start with a step it did not want
    assert reward > 1.5  # of about 3.9 that a perfect robot gets
    assert step.observation[:, 5] == pytest.approx(1.0, abs=0.1)  # upright
    assert set(environment.reward_terms()) == set(REWARDS)


def test_a_robot_on_its_back_has_fallen_and_starts_anew():
    environment = LocomotionEnvironment(GO2, SMALL, np.random.default_rng(0))
    zeros = np.zeros((8, ACTION_SIZE), np.float32)
    environment.step(zeros)
    environment.step(zeros)
    environment.batch.state[3, 4:8] = (0.0, 1.0, 0.0, 0.0)
    step = environment.step(zeros)
    assert step.terminated.tolist() == [k == 3 for k in range(8)]
    assert environment.batch.age[3] == 0
    assert environment.batch.state[3, 4] ** 2 + environment.batch.state[3, 7] ** 2 == pytest.approx(1.0)


def test_training_writes_weights_that_a_mission_loads_and_goes_on(tmp_path):
    training = Training(GO2, tiny(0.04), tmp_path)
    training.run()
    policy = load_policy(GO2, tmp_path / GO2.weights)
    observation = np.random.default_rng(0).normal(size=OBSERVATION_SIZE)
    action = np.empty(ACTION_SIZE)
    policy(observation, action)
    learner = training.learner
    with torch.no_grad():
        expected = learner.network.layers(learner.see(torch.tensor(observation, dtype=torch.float32)))
    assert action == pytest.approx(expected.numpy(), abs=1e-4)
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert len(rows) == learner.iteration > 2
    assert rows[-1]["roughness"] > 0.0
    assert (tmp_path / "curves.png").stat().st_size > 1000

    with pytest.raises(BadArgument, match="--resume"):
        Training(GO2, tiny(0.04), tmp_path)
    longer = Training(GO2, tiny(0.06), tmp_path, resume=True)
    assert longer.learner.iteration == learner.iteration
    assert longer.elapsed == training.elapsed
    longer.run()
    assert longer.learner.iteration > learner.iteration


def test_a_run_of_another_robot_is_not_gone_on_with(tmp_path):
    Training(GO2, tiny(0.01), tmp_path).run()
    other = dataclasses.replace(GO2, spec=dataclasses.replace(GO2.spec, name="other"))
    with pytest.raises(BadArgument, match="'go2', not of 'other'"):
        Training(other, tiny(0.02), tmp_path, resume=True)
    with pytest.raises(BadArgument, match=r"there is no .*checkpoint.pt"):
        Training(GO2, tiny(0.02), tmp_path / "empty", resume=True)


def test_a_lost_state_or_action_ends_the_episode():
    environment = LocomotionEnvironment(GO2, SMALL, np.random.default_rng(0))
    zeros = np.zeros((8, ACTION_SIZE), np.float32)
    environment.step(zeros)
    environment.step(zeros)
    environment.batch.state[2, 22] = math.nan
    action = zeros.copy()
    action[5, 1] = math.nan
    step = environment.step(action)
    assert np.flatnonzero(step.terminated).tolist() == [2, 5]
    assert np.isfinite(step.observation).all()
    assert np.isfinite(step.reward).all()
    assert np.isfinite(list(environment.reward_terms().values())).all()


def test_encoder_errors_are_drawn_apart_from_all_else():
    tuning = QuadrupedModel(GO2).tuning(1.0 / 60.0)
    batch = Batch.zeros(1, 38)
    high = np.ones(3)
    u = np.random.default_rng(0).random(NUM_UNIFORM)
    _reset(tuning, batch, 0, u, -high, high)
    bias, start, wanted = batch.joint_bias.copy(), batch.state.copy(), batch.wanted.copy()
    u[-12:] = np.random.default_rng(1).random(12)
    _reset(tuning, batch, 0, u, -high, high)
    assert (batch.joint_bias != bias).all()
    assert (batch.state == start).all()
    assert (batch.wanted == wanted).all()
    bias[:] = batch.joint_bias
    u[:-12] = np.random.default_rng(2).random(NUM_UNIFORM - 12)
    _reset(tuning, batch, 0, u, -high, high)
    assert (batch.joint_bias == bias).all()


def test_after_a_fall_it_counts_as_standing_still():
    told = (0.5, 0.0, -0.2)
    command = VelocityCommand(*told)
    whole = tracking_errors([told] * 100, command, CONTROL + 80)
    assert whole.shape == (80, 3)
    assert not whole[:40].any()
    assert (whole[40:] == (-0.5, 0.0, 0.2)).all()
    for early in ([], [told] * 10):
        assert (tracking_errors(early, command, CONTROL + 80) == (-0.5, 0.0, 0.2)).all()


def test_results_that_cannot_be_written_are_refused_at_the_start(tmp_path):
    with pytest.raises(BadArgument, match="is a directory"):
        prepare_out(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(BadArgument, match="cannot be written"):
        prepare_out(tmp_path / "file" / "results.json")
    prepare_out(tmp_path / "new" / "results.json")


def test_a_torn_last_line_of_the_log_is_left_out(tmp_path):
    log = tmp_path / "log.jsonl"
    log.write_text('{"iteration": 1}\n{"iteration": 2}\n{"itera')
    assert [row["iteration"] for row in read_log(log)] == [1, 2]


def test_a_killed_run_is_gone_on_with_from_its_checkpoint(tmp_path):
    killed = Training(GO2, tiny(0.01), tmp_path)
    killed.run()
    done = killed.learner.iteration
    with (tmp_path / "log.jsonl").open("a") as log:
        log.write(json.dumps({"iteration": done + 1, "seconds": 9.0}) + '\n{"iter')
    Training(GO2, tiny(0.02), tmp_path, resume=True)
    lines = (tmp_path / "log.jsonl").read_text().splitlines()
    assert [json.loads(line)["iteration"] for line in lines] == list(range(1, done + 1))

    for other, key in (
        (dataclasses.replace(tiny(0.02), seed=2), "seed"),
        (dataclasses.replace(tiny(0.02), ppo=PpoConfig(hidden=64)), "ppo"),
    ):
        with pytest.raises(BadArgument, match=f"is a run of {key} "):
            Training(GO2, other, tmp_path, resume=True)
    stiffer = dataclasses.replace(GO2, kp=50.0)
    with pytest.raises(BadArgument, match="is a run of gait "):
        Training(stiffer, tiny(0.02), tmp_path, resume=True)

    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    state["learner"]["actor"]["layers.0.bias"] = torch.zeros(3)
    torch.save(state, tmp_path / "checkpoint.pt")
    with pytest.raises(BadArgument, match="does not fit"):
        Training(GO2, tiny(0.02), tmp_path, resume=True)
    (tmp_path / "checkpoint.pt").write_bytes(b"broken")
    with pytest.raises(BadArgument, match="can be read"):
        Training(GO2, tiny(0.02), tmp_path, resume=True)


def test_an_interrupted_run_is_saved(tmp_path, monkeypatch):
    training = Training(GO2, tiny(1.0), tmp_path)
    iterate = training.learner.iterate

    def interrupted(progress):
        if training.learner.iteration == 2:
            raise KeyboardInterrupt
        return iterate(progress)

    monkeypatch.setattr(training.learner, "iterate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        training.run()
    assert torch.load(tmp_path / "checkpoint.pt", weights_only=True)["learner"]["iteration"] == 2


@pytest.mark.parametrize(
    "bad", ["--minutes nan", "--minutes inf", "--minutes=-1", "--threads 0", "--seed=-1", "--robot tiago", "--resume"]
)
def test_bad_arguments_are_one_line(tmp_path, monkeypatch, capsys, bad):
    monkeypatch.chdir(tmp_path)
    assert main(["train", "locomotion", *bad.split()]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_without_out_a_run_goes_to_runs(tmp_path, monkeypatch):
    class Run:
        robot = GO2

        def __init__(self, robot, config, out, *, resume):
            self.out = out

        def run(self):
            self.out.mkdir(parents=True)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("train.locomotion.run.Training", Run)
    assert main(["train", "locomotion", "--robot", "go2"]) == 0
    assert (tmp_path / "runs" / "go2").is_dir()
