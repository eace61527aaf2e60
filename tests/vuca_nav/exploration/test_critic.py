import math
from dataclasses import replace

import numpy as np
import pytest
from safetensors.numpy import save_file

from tests.vuca_nav.random_policy import PAPER, random_policy
from tests.vuca_nav.random_policy import random_tensors as policy_tensors
from tests.vuca_nav.random_safety import TRACKED, random_safety, random_tensors
from tests.vuca_nav.rooms import LIDAR, Sensors, disc_body, percept_of, ranges_to_boxes, room, scan_of
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.exploration.critic import SHIPPED, LearnedCritic, load_critic, value_network
from vuca_nav.exploration.explorer import ExplorerConfig
from vuca_nav.geometry import compose, inverse, transform_points
from vuca_nav.navigator import Navigator, NavigatorConfig
from vuca_nav.policy.dynamic_window import DynamicWindow
from vuca_nav.policy.observation import PerceptObserver, goal_features
from vuca_nav.policy.weights_file import load_weights
from vuca_nav.telemetry.interface import Telemetry
from vuca_nav.types import STANDING, STOP, LidarSpec, Odometry, Pose2, Twist2

DT = 1.0 / 30.0
BODY = replace(disc_body(), min_v_x=-0.4, max_v_y=0.3, max_w_z=1.5)
ROOM = room(8.0, 6.0)
POINTS = np.array([[4.0, 1.0], [2.0, 3.0], [-9.0, 20.0]])


@pytest.fixture
def critic(tmp_path):
    return LearnedCritic(BODY, LIDAR, load_critic(random_safety(tmp_path / "s.safetensors")))


def percept_in_room():
    """After a drive in which something moved."""
    sensors = Sensors()

    def tick(k: int):
        mover = np.array([[5.0, 1.0 + 0.03 * k, 5.4, 1.4 + 0.03 * k]])
        ranges = ranges_to_boxes(np.vstack([ROOM, mover]), Pose2(2.0 + 0.01 * k, 3.0, 0.01 * k))
        return sensors.see(ranges, Pose2(0.01, 0.0, 0.01), Twist2(0.3, 0.0, 0.1))

    return [tick(k) for k in range(30)][-1]


def test_chances_are_the_networks_for_the_observation_with_the_goal_replaced(critic):
    pose, percept = Pose2(2.3, 3.0, 0.7), percept_in_room()
    assert len(percept.tracks) > 0
    chances = critic.values(POINTS, percept, pose)
    tensors = {name: tensor.astype(np.float64) for name, tensor in random_tensors().items()}
    observer = PerceptObserver(TRACKED, BODY, LIDAR)
    points_in_base = transform_points(inverse(pose), POINTS)
    for point, goal, chance in zip(points_in_base, goal_features(points_in_base), chances):
        x = observer.observe(percept, (-3.0, 0.5)).astype(np.float64)  # where the waypoint is does not matter
        x[TRACKED.goal_slice] = goal
        assert x == pytest.approx(observer.observe(percept, tuple(point)), abs=1e-6)
        for k in range(3):
            x = tensors[f"weight_{k}"] @ x + tensors[f"bias_{k}"]
            x = np.maximum(x, 0.0) if k < 2 else x
        assert chance == pytest.approx(1.0 / (1.0 + math.exp(-x[0])), abs=1e-5)
    assert len(set(chances)) == 3
    assert critic.values(POINTS, percept, pose) == pytest.approx(chances, abs=1e-12)  # it remembers nothing
    assert len(critic.values(np.empty((0, 2)), percept, pose)) == 0
    many = np.tile(POINTS, (2000, 1))  # more than are rated at a time
    assert critic.values(many, percept, pose) == pytest.approx(np.tile(chances, 2000), abs=1e-6)


@pytest.mark.parametrize("activation", ["relu", "elu"])
def test_a_policys_own_value_is_its_critic_for_the_observation_with_the_goal_replaced(tmp_path, activation):
    weights = load_weights(random_policy(tmp_path / "p.safetensors", PAPER, activation, critic=20, seed=3))
    critic = LearnedCritic(BODY, LIDAR, value_network(weights))
    pose, percept = Pose2(2.3, 3.0, 0.7), percept_in_room()
    values = critic.values(POINTS, percept, pose)
    tensors = {name: t.astype(np.float64) for name, t in policy_tensors(PAPER, critic=20, seed=3).items()}
    observer = PerceptObserver(PAPER, BODY, LIDAR)
    for point, value in zip(transform_points(inverse(pose), POINTS), values):
        x = (observer.observe(percept, tuple(point)).astype(np.float64) - tensors["mean"]) * tensors["scale"]
        for k in range(3):
            x = tensors[f"critic_weight_{k}"] @ x + tensors[f"critic_bias_{k}"]
            if k < 2:
                x = np.maximum(x, 0.0) if activation == "relu" else np.where(x > 0.0, x, np.exp(x) - 1.0)
        assert value == pytest.approx(x[0], abs=2e-5)
    assert np.ptp(values) > 1e-3


def test_chances_are_added_up_in_a_fixed_order(tmp_path):
    """Bit for bit the sum over inputs in their order, each product and sum rounded once in single precision."""
    weights = load_critic(random_safety(tmp_path / "s.safetensors"))
    pose, percept = Pose2(2.3, 3.0, 0.7), percept_in_room()
    points = np.random.default_rng(1).uniform(-4.0, 8.0, (40, 2))
    chances = LearnedCritic(BODY, LIDAR, weights).values(points, percept, pose)
    observation = PerceptObserver(TRACKED, BODY, LIDAR).observe(percept, (0.0, 0.0))
    at = TRACKED.goal_slice
    others = [k for k in range(TRACKED.size) if k not in range(at.start, at.stop)]

    def added_up(x, weight, total):
        for k, column in zip(x[0], x[1]):
            total = total + weight[:, column] * k
        return total

    (first, second, last), (bias, bias_1, bias_2) = weights.weights, weights.biases
    common = added_up((observation[others], others), first, bias)
    goals = goal_features(transform_points(inverse(pose), points))
    for goal, chance in zip(goals, chances):
        hidden = np.maximum(added_up((goal, range(at.start, at.stop)), first, common), np.float32(0.0))
        hidden = np.maximum(added_up((hidden, range(len(hidden))), second, bias_1), np.float32(0.0))
        logit = float(added_up((hidden, range(len(hidden))), last, bias_2)[0])
        assert chance == 1.0 / (1.0 + math.exp(-logit))


@pytest.mark.parametrize("broken", [{"ranges": np.full(360, np.nan)}, {"twist": Twist2(math.nan, 0.0, 0.0)}])
def test_while_the_percept_is_not_valid_all_are_alike(critic, broken):
    percept = Sensors().see(**{"ranges": np.full(360, 3.0), **broken})
    assert (critic.values(POINTS, percept, STANDING) == 1.0).all()
    assert (critic.values(POINTS, percept_of(np.full(360, 3.0)), STANDING) < 1.0).all()


@pytest.mark.parametrize("beams", [181, 361, 720, 1081])
def test_any_number_of_beams_will_do(tmp_path, beams):
    lidar = LidarSpec(num_beams=beams)
    critic = LearnedCritic(BODY, lidar, load_critic(random_safety(tmp_path / "s.safetensors")))
    values = critic.values(POINTS, percept_of(np.full(beams, 3.0), lidar), STANDING)
    assert ((values > 0.0) & (values < 1.0)).all()
    with pytest.raises(BadArgument, match="give both the same LidarSpec"):
        critic.values(POINTS, percept_of(np.full(1440, 3.0), LidarSpec(num_beams=1440)), STANDING)


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
        load_critic(random_safety(tmp_path / "s.safetensors", changes))


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
    save_file(tensors, path, load_critic(whole).metadata)
    with pytest.raises(BadWeights, match=message):
        load_critic(path)


def test_a_missing_file_is_told_how_to_be_made(tmp_path):
    with pytest.raises(BadWeights, match="make them with: vuca train critic"):
        load_critic(tmp_path / "none.safetensors")


class Told(Telemetry):
    def __init__(self):
        self.asked: list[np.ndarray] = []

    def safety(self, rate):
        self.asked.append(rate(np.array([[3.0, 3.0], [5.0, 2.0]])))


def test_in_the_stack_the_critic_is_asked_at_the_first_decision_already(critic):
    told = Told()
    config = NavigatorConfig(explorer=ExplorerConfig(gamma=10.0), exploration_rate=1.0)
    navigator = Navigator(BODY, LIDAR, DynamicWindow(BODY, LIDAR), config, told, critic)
    walls = np.array([[0.0, 1.0, 30.0, 1.2], [0.0, 5.0, 30.0, 5.2], [-0.2, 1.0, 0.0, 5.2]])
    start = Pose2(1.0, 3.0, 0.0)
    navigator.reset(start, (40.0, 3.0))
    pose, odom, command = start, STANDING, STOP
    for k in range(61):
        command = navigator.step(scan_of(walls, pose, k * DT), Odometry(k * DT, odom, Twist2(*command)))
        step = Pose2(command.v_x * DT, command.v_y * DT, command.w_z * DT)
        pose, odom = compose(pose, step), compose(odom, step)
    assert told.asked[0][0] != told.asked[0][1]
    assert len(told.asked) >= 3  # every second


def chances_near_a_mover(start: tuple[float, float], velocity: tuple[float, float], ask: np.ndarray) -> np.ndarray:
    """What the shipped critic makes of points, after a second in a corridor along x with a mover in it."""
    critic, sensors = LearnedCritic(BODY, LIDAR, load_critic(SHIPPED)), Sensors()
    walls = np.array([[-15.0, -1.6, 15.0, -1.4], [-15.0, 1.4, 15.0, 1.6]])

    def tick(k: int):
        x, y = start[0] + velocity[0] * k * DT, start[1] + velocity[1] * k * DT
        body = np.array([[x - 0.2, y - 0.2, x + 0.2, y + 0.2]])
        return sensors.see(ranges_to_boxes(np.vstack([walls, body]), STANDING))

    return critic.values(ask, [tick(k) for k in range(31)][-1], STANDING)


def test_the_shipped_critic_fears_what_comes_and_not_what_stands():
    ask = np.array([[4.0, 0.0], [-4.0, 0.0]])
    ahead, behind = chances_near_a_mover((5.0, 0.0), (-1.0, 0.0), ask)
    assert ahead < behind - 0.03
    behind, ahead = chances_near_a_mover((-5.0, 0.0), (1.0, 0.0), ask[::-1])
    assert behind < ahead
    still = chances_near_a_mover((4.0, 0.9), (0.0, 0.0), ask)
    assert still.min() > 0.9


def test_what_is_shipped_says_how_it_was_made():
    assert load_critic(SHIPPED).metadata["command"].startswith("vuca train safety")
