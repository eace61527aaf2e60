import copy
import dataclasses
import math

import numpy as np
import pytest
import torch

from robots.bodies.go2 import GO2
from robots.locomotion.gait import START_UP_TIME
from robots.locomotion.kernels import (
    ACTION_SIZE,
    GYRO_SCALE,
    LEVELLING_LIMIT,
    LEVELLING_TIME,
    OBSERVATION_SIZE,
    RATE_SCALE,
    fill_observation,
    level_trunk,
    trot_angles,
)
from robots.locomotion.model import QuadrupedModel
from robots.locomotion.odometry import LegSensors
from robots.noise import NoiseConfig
from tests.robots.gaits import untaught
from train.locomotion.batch import Batch, SensorNoise
from train.locomotion.config import GAIT_PPO, Stage, TrainingConfig
from train.locomotion.environment import EnvironmentConfig, LocomotionEnvironment
from train.locomotion.evaluate import CONTROL, Track, tracking_errors
from train.locomotion.floors import Floor
from train.locomotion.kernels import CRITIC_SIZE, FALL_COST, NUM_NORMAL, NUM_UNIFORM, Challenge, _reset
from train.locomotion.policy import Normaliser, action_mirror, observation_mirror, privileged_mirror
from train.locomotion.rewards import REWARDS
from train.locomotion.training import make_learner
from vuca_nav.errors import BadArgument
from vuca_nav.files import prepare_file
from vuca_nav.types import VelocityCommand

SMALL = EnvironmentConfig(num_robots=8)


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
    trot_angles(model.legs, tuning, np.array([0.5, 0.2, 0.7]), np.array([0.2, 1.0]), np.zeros(4), here)
    trot_angles(model.legs, tuning, np.array([0.5, -0.2, -0.7]), np.array([0.7, 1.0]), np.zeros(4), there)
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
    noise = SensorNoise.of(NoiseConfig(), 1.0 / 60.0, 1.0)
    batch = Batch.zeros(1, 38)
    challenge = Challenge(-np.ones(3), np.ones(3), 0.0, 3.0, 50.0)
    u, g = np.random.default_rng(0).random(NUM_UNIFORM), np.random.default_rng(1).normal(size=NUM_NORMAL)
    _reset(tuning, noise, batch, 0, u, g, challenge)
    errors, start, wanted = batch.sensor_errors.copy(), batch.state.copy(), batch.wanted.copy()
    g[:] = np.random.default_rng(2).normal(size=NUM_NORMAL)
    _reset(tuning, noise, batch, 0, u, g, challenge)
    assert (batch.sensor_errors != errors).all()
    assert (batch.state == start).all()
    assert (batch.wanted == wanted).all()
    errors[:] = batch.sensor_errors
    u[:] = np.random.default_rng(3).random(NUM_UNIFORM)
    _reset(tuning, noise, batch, 0, u, g, challenge)
    assert (batch.sensor_errors == errors).all()


def test_training_measures_with_the_simulations_noise():
    """What robots.locomotion.odometry.LegSensors makes of the same state, noise-free but for the episode's errors."""
    config = dataclasses.replace(NoiseConfig(), gyro_noise_density=0.0, joint_angle_noise=0.0, joint_speed_noise=0.0)
    config = dataclasses.replace(config, tilt_noise=0.0)
    environment = LocomotionEnvironment(
        GO2, dataclasses.replace(SMALL, noise=config, noise_factor=1.0), np.random.default_rng(0)
    )
    zeros = np.zeros((8, ACTION_SIZE), np.float32)
    for _ in range(10):
        step = environment.step(zeros)
    state, errors = environment.batch.state[0], environment.batch.sensor_errors[0]
    sensors = LegSensors(config, np.random.default_rng(0), 1.0 / 60.0)
    sensors.flaws = sensors.flaws._replace(
        gyro_scale=1.0 + errors[:3], gyro_bias=errors[3:6], pitch=errors[6], roll=errors[7], zeros=errors[8:]
    )
    sensors.sample(state[23:26], state[4:8], state[8:20], state[26:38])
    assert step.observation[0, :3] == pytest.approx(GYRO_SCALE * sensors.gyro, abs=1e-6)
    assert step.observation[0, 3:6] == pytest.approx(sensors.up, abs=1e-6)
    assert step.observation[0, 9:21] == pytest.approx(sensors.q - environment.tuning.nominal, abs=1e-6)
    assert step.observation[0, 21:33] == pytest.approx(RATE_SCALE * sensors.dq, abs=1e-6)


def test_a_new_floor_comes_with_a_new_episode():
    environment = LocomotionEnvironment(GO2, SMALL, np.random.default_rng(0))
    zeros = np.zeros((8, ACTION_SIZE), np.float32)
    environment.step(zeros)
    environment.step(zeros)
    before = [model.body_mass.copy() for model in environment._models]
    environment.new_floors(0.5)
    step = environment.step(zeros)
    fresh = [bool((model.body_mass != mass).any()) for model, mass in zip(environment._models, before)]
    assert fresh == step.truncated.tolist()
    assert 0 < sum(fresh) < 8
    assert (environment.batch.age == 0).tolist() == fresh


def test_an_environment_goes_on_from_its_state_bit_by_bit():
    """On rough floors drawn anew several times: nothing may stay of what was there before."""
    action = np.random.default_rng(5).normal(0.0, 0.3, (8, ACTION_SIZE)).astype(np.float32)
    config = dataclasses.replace(SMALL, num_sills=6)

    def make(rng, threads):
        environment = LocomotionEnvironment(GO2, config, rng, threads)
        environment.difficulty = environment.roughness = 1.0
        return environment

    rng, other_rng = np.random.default_rng(0), np.random.default_rng(99)
    first, second = make(rng, 1), make(other_rng, 2)
    for _ in range(4):
        first.new_floors(0.5)
        for _ in range(15):
            first.step(action)
    first.new_floors(0.5)
    state, generator = copy.deepcopy(first.state()), copy.deepcopy(rng.bit_generator.state)
    second.load(state)
    other_rng.bit_generator.state = generator
    for _ in range(60):
        here = first.step(action).observation.copy()
        there = second.step(action).observation
        assert here.tobytes() == there.tobytes()


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
        prepare_file(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(BadArgument, match="cannot be written"):
        prepare_file(tmp_path / "file" / "results.json")
    prepare_file(tmp_path / "new" / "results.json")
    assert (tmp_path / "new").is_dir()
    assert not list((tmp_path / "new").iterdir())


def test_a_higher_leg_is_shortened_until_the_trunk_is_level():
    model = QuadrupedModel(GO2)
    tuning = model.tuning(1.0 / 60.0)
    tilt, lifts = np.zeros(2), np.zeros(4)
    level_trunk(model.legs, tuning, np.array([0.06, 0.0, 1.0]), tilt, lifts)  # the front is higher
    assert tilt == pytest.approx([0.06 / 60.0 / LEVELLING_TIME, 0.0])
    assert lifts == pytest.approx(tilt[0] * model.legs.hips[:, 0])
    assert (lifts > 0.0).tolist() == [True, True, False, False]
    for _ in range(1000):
        level_trunk(model.legs, tuning, np.array([0.0, -0.5, 0.9]), tilt, lifts)  # the right is higher
    assert tilt[1] == -LEVELLING_LIMIT
    assert (lifts > 0.0).tolist() == [False, True, False, True]


@pytest.mark.parametrize("uphill", [0.0, 1.3, math.pi])
def test_it_gets_up_level_on_a_slope(tmp_path, uphill):
    body = untaught(tmp_path)
    body.settle_time = START_UP_TIME - 1.0 / CONTROL  # until its policy would take over
    track = Track(body, 0, vary=False, floor=Floor(slope=0.1, uphill=uphill))
    w, x, y, z = track.data.qpos[3:7]
    lean = math.acos(1.0 - 2.0 * (x * x + y * y))
    assert lean < 0.04  # the floor's is 0.1, and legs of one length lean more than that
    assert w * w + z * z > 0.9


def test_the_divergence_is_that_of_the_policy_not_of_its_two_sides():
    """A policy that has not changed has none, however unlike left and right are in it."""
    ppo = dataclasses.replace(GAIT_PPO, horizon=4, epochs=1, first_rate=1e-12)
    learner = make_learner(GO2, TrainingConfig(environment=SMALL, ppo=ppo, stages=(Stage(0.0, 120, 0, 0.0),)))
    with torch.no_grad():
        for weight in learner.actor.parameters():
            if weight.ndim == 2:
                weight.normal_(generator=torch.Generator().manual_seed(1))
    assert learner.iterate(0.9)["divergence"] == pytest.approx(0.0, abs=1e-6)


def test_a_fall_costs_and_the_rest_does_not():
    environment = LocomotionEnvironment(GO2, SMALL, np.random.default_rng(0))
    zeros = np.zeros((8, ACTION_SIZE), np.float32)
    environment.step(zeros)
    environment.step(zeros)
    environment.batch.state[3, 4:8] = (0.0, 1.0, 0.0, 0.0)
    reward = environment.step(zeros).reward
    assert reward[3] == pytest.approx(-FALL_COST, abs=0.1)
    assert (np.delete(reward, 3) >= 0.0).all()
