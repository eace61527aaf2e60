import math
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import save_file

from tests.vuca_nav.random_policy import random_policy
from tests.vuca_nav.random_safety import TRACKED, random_safety, random_tensors
from tests.vuca_nav.rooms import LIDAR, disc_body, ranges_to_boxes, room, scan_of
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.exploration.critic import SHIPPED, LearnedSafety, check_goes_with, load_safety
from vuca_nav.exploration.explorer import ExplorerConfig
from vuca_nav.geometry import compose, inverse, transform_points
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.base import LocalObservation
from vuca_nav.policy.learned import LearnedPolicy
from vuca_nav.policy.observation import goal_features
from vuca_nav.policy.weights_file import WEIGHTS_FOLDER, load_weights
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STOP, Odometry, Pose2, Scan, Twist2

DT = 1.0 / 30.0
BODY = replace(disc_body(), min_v_x=-0.4, max_v_y=0.3, max_w_z=1.5)
ROOM = room(8.0, 6.0)
POINTS = np.array([[4.0, 1.0], [2.0, 3.0], [-9.0, 20.0]])


@pytest.fixture
def policy(tmp_path):
    return LearnedPolicy(BODY, LIDAR, load_weights(random_policy(tmp_path / "p.safetensors", TRACKED)))


@pytest.fixture
def critic(policy, tmp_path):
    return LearnedSafety(policy, load_safety(random_safety(tmp_path / "s.safetensors")))


def seen(tick: int, waypoint=(2.0, 1.0)) -> LocalObservation:
    scan = ranges_to_boxes(ROOM, Pose2(2.0 + 0.01 * tick, 3.0, 0.01 * tick))
    return LocalObservation(Scan(tick * DT, scan), waypoint, False, Twist2(0.3, 0.0, 0.1), Pose2(0.01, 0.0, 0.01))


def test_chances_are_the_networks_for_the_observation_with_the_goal_replaced(policy, critic):
    pose = Pose2(2.0, 3.0, 0.7)
    assert (critic.values(POINTS, pose) == 1.0).all()  # nothing seen yet
    policy.command(seen(0))
    chances = critic.values(POINTS, pose)
    tensors = {name: tensor.astype(np.float64) for name, tensor in random_tensors().items()}
    goals = goal_features(transform_points(inverse(pose), POINTS))
    for goal, chance in zip(goals, chances):
        x = policy.observation.astype(np.float64)
        x[TRACKED.goal_slice] = goal
        for k in range(3):
            x = tensors[f"weight_{k}"] @ x + tensors[f"bias_{k}"]
            x = np.maximum(x, 0.0) if k < 2 else x
        assert chance == pytest.approx(1.0 / (1.0 + math.exp(-x[0])), abs=1e-5)
    assert len(set(chances)) == 3
    policy.reset()  # where the waypoint is does not matter
    policy.command(seen(0, waypoint=(-3.0, 0.5)))
    assert critic.values(POINTS, pose) == pytest.approx(chances, abs=1e-6)
    assert len(critic.values(np.empty((0, 2)), pose)) == 0
    many = np.tile(POINTS, (2000, 1))  # more than are rated at a time
    assert critic.values(many, pose) == pytest.approx(np.tile(chances, 2000), abs=1e-6)


def test_a_policy_that_looks_at_something_else_is_refused(tmp_path):
    other = LearnedPolicy(BODY, LIDAR, load_weights(random_policy(tmp_path / "paper.safetensors")))
    critic = load_safety(random_safety(tmp_path / "s.safetensors"))
    with pytest.raises(BadArgument, match=r"paper.safetensors looks at .* but V\^h's critic s.safetensors at"):
        LearnedSafety(other, critic)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": None}, "format is None, expected 'vuca-safety-1'"),
        ({"format": "vuca-policy-1"}, "format is 'vuca-policy-1'"),
        ({"observation": "[1]"}, "expected the fields"),
    ],
)
def test_files_that_are_something_else_are_refused(tmp_path, changes, message):
    with pytest.raises(BadWeights, match=message):
        load_safety(random_safety(tmp_path / "s.safetensors", changes))


@pytest.mark.parametrize(
    ("name", "tensor", "message"),
    [
        ("weight_1", None, "has no tensor 'weight_1'"),
        ("weight_2", np.zeros((2, 24)), r"'weight_2' has shape \(2, 24\), expected \(1, 24\)"),
        ("bias_0", np.zeros(0), "'bias_0' is empty"),
        ("bias_2", np.full(1, np.nan), "not finite"),
        ("more", np.zeros(1), "'more' does not belong there"),
    ],
)
def test_tensors_that_do_not_fit_are_refused(tmp_path, name, tensor, message):
    whole, path = random_safety(tmp_path / "s.safetensors"), tmp_path / "t.safetensors"
    tensors = random_tensors()
    if tensor is None:
        del tensors[name]
    else:
        tensors[name] = np.asarray(tensor, np.float32)
    save_file(tensors, path, load_safety(whole).metadata)
    with pytest.raises(BadWeights, match=message):
        load_safety(path)


def test_a_missing_file_is_told_how_to_be_made(tmp_path):
    with pytest.raises(BadWeights, match="make them with: vuca train critic"):
        load_safety(tmp_path / "none.safetensors")


class Told(Telemetry):
    def __init__(self):
        self.asked: list[np.ndarray] = []

    def safety(self, rate):
        self.asked.append(rate(np.array([[3.0, 3.0], [5.0, 2.0]])))


def test_in_the_stack_the_critic_is_asked_at_the_first_decision_already(policy, critic):
    told = Told()
    config = NavigatorConfig(explorer=ExplorerConfig(gamma=10.0), exploration_rate=1.0)
    navigator = Navigator(BODY, LIDAR, policy, config, told, critic)
    walls = np.array([[0.0, 1.0, 30.0, 1.2], [0.0, 5.0, 30.0, 5.2], [-0.2, 1.0, 0.0, 5.2]])
    start = Pose2(1.0, 3.0, 0.0)
    navigator.reset(start, (40.0, 3.0))
    pose, odom, command = start, Pose2(0.0, 0.0, 0.0), STOP
    for k in range(61):
        command = navigator.step(scan_of(walls, pose, k * DT), Odometry(k * DT, odom, Twist2(*command)))
        step = Pose2(command.v_x * DT, command.v_y * DT, command.w_z * DT)
        pose, odom = compose(pose, step), compose(odom, step)
    assert told.asked[0][0] != told.asked[0][1]
    assert len(told.asked) >= 3  # every second


def chances_among_walkers(start: tuple[float, float], velocity: tuple[float, float], ask: np.ndarray) -> np.ndarray:
    """What the shipped critic makes of points, after a second in a corridor along x with a walker in it."""
    weights = load_weights(WEIGHTS_FOLDER / "fusion-plus.safetensors")
    policy = LearnedPolicy(BODY, LIDAR, weights)
    critic = LearnedSafety(policy, load_safety(SHIPPED))
    walls = np.array([[-15.0, -1.6, 15.0, -1.4], [-15.0, 1.4, 15.0, 1.6]])
    here = Pose2(0.0, 0.0, 0.0)
    for tick in range(31):
        x, y = start[0] + velocity[0] * tick * DT, start[1] + velocity[1] * tick * DT
        body = np.array([[x - 0.2, y - 0.2, x + 0.2, y + 0.2]])
        ranges = ranges_to_boxes(np.vstack([walls, body]), here)
        policy.look(LocalObservation(Scan(tick * DT, ranges), (2.0, 0.0), False, Twist2(0.0, 0.0, 0.0), here))
    return critic.values(ask, here)


def test_the_shipped_critic_fears_who_comes_and_not_who_stands():
    ask = np.array([[4.0, 0.0], [-4.0, 0.0]])
    ahead, behind = chances_among_walkers((5.0, 0.0), (-1.0, 0.0), ask)
    assert ahead < behind - 0.03
    behind, ahead = chances_among_walkers((-5.0, 0.0), (1.0, 0.0), ask[::-1])
    assert behind < ahead
    still = chances_among_walkers((4.0, 0.9), (0.0, 0.0), ask)
    assert still.min() > 0.9


def test_what_is_shipped_looks_at_what_its_policy_looks_at():
    check_goes_with(load_weights(WEIGHTS_FOLDER / "fusion-plus.safetensors"), load_safety(SHIPPED))
    assert load_safety(SHIPPED).metadata["command"].startswith("vuca train safety")
