"""The contract of a bundle: what goes in and what comes out, with shape, unit, frame, order and rate."""

from typing import Any

from vuca_nav.build import StackConfig
from vuca_nav.deploy.manifest import CRITIC_GRAPH, POLICY_GRAPH
from vuca_nav.deploy.robot_file import RobotFile
from vuca_nav.exploration.critic import CriticWeights
from vuca_nav.perception.ring import ring_of
from vuca_nav.plain import to_plain
from vuca_nav.policy.frames import FARTHEST_GOAL
from vuca_nav.policy.learned import BLIND_SHARE
from vuca_nav.policy.observation import (
    ACCELERATION_SCALE,
    BODY_SIZE,
    CLOSING_SPEED,
    HALF_DISTANCE,
    SPEED_SCALE,
    TURN_SCALE,
    TWIST_LIMIT,
    TWIST_SIZE,
    ObservationConfig,
)
from vuca_nav.policy.track_features import (
    DIRECTIONS,
    HORIZON,
    POSITION_SCALE,
    RADIUS_SCALE,
    SLOT_SIZE,
    SLOTS,
    SPEEDS,
    VELOCITY_SCALE,
)
from vuca_nav.policy.weights_file import PolicyWeights

Contract = dict[str, Any]

_RANGES = {
    "range_min to range_max": "a return",
    "inf, range_max and beyond, 0 and negative numbers": "nothing came back",
    "above 0 and below range_min, and -inf": "an obstacle too near to be measured: kept clear of, not mapped",
    "NaN": "a fault of the beam (REP-117): unknown",
}


def contract_of(
    robot: RobotFile, config: StackConfig, policy: PolicyWeights | None, critic: CriticWeights | None
) -> Contract:
    """The contract of a stack and of its networks.

    Args:
        robot: The robot.
        config: The stack.
        policy: Weights of the policy, if a network drives.
        critic: Weights of the critic, if there is one.
    """
    networks: Contract = {}
    if policy is not None:
        networks[POLICY_GRAPH] = policy_contract(robot, policy)
    if critic is not None:
        networks[CRITIC_GRAPH] = critic_contract(robot, critic)
    return {
        "rate": {"value": config.navigator.rate, "unit": "Hz", "meaning": "of ticks: one command each"},
        "inputs": _inputs(robot),
        "outputs": _outputs(robot, config),
        "networks": networks,
    }


def policy_contract(robot: RobotFile, policy: PolicyWeights) -> Contract:
    """The contract of ``policy.onnx``."""
    body = robot.body
    outputs: Contract = {
        "action": {
            "shape": ["N", 3], "dtype": "float32", "unit": "share of the limit, -1 to 1",
            "meaning": "v_x, v_y, w_z",
        },
        "command": {
            "shape": ["N", 3], "dtype": "float32", "unit": "m/s, m/s, rad/s", "frame": robot.frames.base,
            "meaning": "v_x, v_y, w_z: the action times the limits of this robot; forwards "
            f"{body.max_v_x:g}, backwards {-body.min_v_x:g}, sideways {body.max_v_y:g}, turning {body.max_w_z:g}",
            "not_in_it": f"the stack stands without a goal or with faulty sensors, gives {BLIND_SHARE:g} of the "
            "command while no beam returns, and has its shield, if it has one, over the command",
        },
        "shares": {
            "shape": ["N", policy.experts], "dtype": "float32", "unit": "1",
            "meaning": "shares a_n of the experts, in their order; every layer is W = sum_n a_n W_n",
        },
    }  # fmt: skip
    return {"inputs": {"observation": observation_contract(policy.observation, robot)}, "outputs": outputs}


def critic_contract(robot: RobotFile, critic: CriticWeights) -> Contract:
    """The contract of ``critic.onnx``."""
    meaning = "the chance of getting to the goal without meeting a moving obstacle, 0 to 1"
    if not critic.is_chance:
        meaning = "the value that the policy was trained with, in the unit of its scaled rewards"
    observation = observation_contract(critic.observation, robot)
    value = {"shape": ["N", 1], "dtype": "float32", "unit": "1", "meaning": f"V^h of the observation's goal: {meaning}"}
    return {"inputs": {"observation": observation}, "outputs": {"value": value}}


def observation_contract(config: ObservationConfig, robot: RobotFile) -> Contract:
    """The contract of a network's input, part by part."""
    parts: list[Contract] = []

    def part(name: str, size: int, unit: str, meaning: str) -> None:
        start = parts[-1]["stop"] if parts else 0
        parts.append({"name": name, "start": start, "stop": start + size, "unit": unit, "meaning": meaning})

    reach, sectors = config.max_range, config.sectors
    nothing = f"{reach:g} m, or nothing came back: the greatest value; unknown beams are left out"
    if config.kind == "frames":
        for age in range(config.history, -1, -1):
            part(
                f"scan {age * config.spacing:g} s ago", sectors, "1",
                "least clearance beyond the footprint of each sector, from -pi/2 to pi/2, divided by "
                f"{reach:g} m, less 0.5; {nothing}",
            )  # fmt: skip
        part("goal", 2, "m", f"x and y in base_link, at most {FARTHEST_GOAL:g} m away")
        part("speed", 2, "share of the limit", f"v_x and w_z, clipped to {TWIST_LIMIT:g}")
    else:
        part(
            "O_L", sectors, "1",
            "least clearance beyond the footprint of each sector, counter-clockwise from -pi, from 0 to "
            f"{reach:g} m as -1 to 1; {nothing}",
        )  # fmt: skip
        if config.kind == "paper":
            part(
                "O_m", sectors, "1",
                f"change of the clearance since the scans {_ages(config)} s ago, weighed 1/k, {CLOSING_SPEED:g} m/s "
                "as 1, clipped to -1 to 1",
            )  # fmt: skip
        else:
            for speed in SPEEDS:
                part(
                    f"urgency at {speed:g} of max_v_x", DIRECTIONS, "1",
                    f"of meeting a track when going in each of {DIRECTIONS} directions, counter-clockwise from -pi: 1 "
                    f"now, 0 after {HORIZON:g} s or never",
                )  # fmt: skip
        part(
            "O_g", 3, "1", f"waypoint: 2 d / (d + {HALF_DISTANCE:g} m) - 1, cosine and sine of its bearing in base_link"
        )
        part("O_v", TWIST_SIZE, "share of the limit", f"v_x, v_y, w_z measured, clipped to {TWIST_LIMIT:g}")
        if config.kind == "tracked":
            part(
                "body", BODY_SIZE, "1",
                f"max_v_x, min_v_x, max_v_y over {SPEED_SCALE:g} m/s, max_w_z over {TURN_SCALE:g} rad/s, max_a_x over "
                f"{ACCELERATION_SCALE:g} m/s^2, the footprint's radius over {RADIUS_SCALE:g} m",
            )  # fmt: skip
            part("urgency of standing still", 1, "1", "as above")
            part(
                "tracks", SLOTS * SLOT_SIZE, "1",
                f"the {SLOTS} most threatening: x, y over {POSITION_SCALE:g} m, v_x, v_y over {VELOCITY_SCALE:g} m/s, "
                f"radius over {RADIUS_SCALE:g} m, certainty; all 0 where there is none",
            )  # fmt: skip
    ring = ring_of(robot.lidar, robot.rates.cmd_vel)
    return {
        "shape": ["N", config.size],
        "dtype": "float32",
        "frame": robot.frames.base,
        "made_of": f"a ring of {ring.num_beams} beams about base_link, beam i at -pi + i * 2 pi / {ring.num_beams}",
        "rate": robot.rates.cmd_vel,
        "normalised": "mean and scale of the training are in the graph",
        "parts": parts,
    }


def _ages(config: ObservationConfig) -> str:
    return ", ".join(f"{lag * config.spacing:g}" for lag in config.lags)


def _inputs(robot: RobotFile) -> Contract:
    lidar, frames, topics = robot.lidar, robot.frames, robot.topics
    return {
        "scan": {
            "topic": topics.scan, "type": "sensor_msgs/msg/LaserScan", "shape": [lidar.num_beams], "unit": "m",
            "frame": frames.lidar, "mount_in_base": to_plain(lidar.mount), "rate": lidar.rate,
            "beam_order": "beam i points at angle_min + i * angle_increment in the lidar's frame, from x to y",
            "angle_min": lidar.angle_min, "angle_increment": lidar.pitch,
            "range_min": lidar.min_range, "range_max": lidar.max_range, "values": _RANGES,
            "others": "a lidar of any field of view, number of beams and direction drives too, by its own geometry",
        },
        "odometry": {
            "topic": topics.odom, "type": "nav_msgs/msg/Odometry", "shape": [6], "unit": "m, m, rad, m/s, m/s, rad/s",
            "frame": f"pose of {frames.base} in {frames.odom}, twist in {frames.base}", "rate": robot.rates.odom,
            "values": {"NaN, beyond the body's limits, a jump": "a fault: the robot stands"},
        },
        "up": {
            "topic": topics.imu, "type": "sensor_msgs/msg/Imu", "shape": [3], "unit": "1", "frame": frames.base,
            "values": {"left out": "0, 0, 1: a base that does not lean"}, "meaning": "the vertical, a unit vector",
        },
        "goal": {
            "topic": topics.goal, "type": "geometry_msgs/msg/PoseStamped", "shape": [2], "unit": "m",
            "frame": frames.map, "meaning": "x and y; the orientation is not driven to",
        },
        "start": {
            "topic": topics.initial_pose, "type": "geometry_msgs/msg/PoseWithCovarianceStamped", "shape": [3],
            "unit": "m, m, rad", "frame": frames.map, "values": {"left out": "0, 0, 0: the map begins at the robot"},
        },
    }  # fmt: skip


def _outputs(robot: RobotFile, config: StackConfig) -> Contract:
    frames, topics, body, rate = robot.frames, robot.topics, robot.body, robot.rates.cmd_vel
    return {
        "cmd_vel": {
            "topic": topics.cmd_vel, "type": "geometry_msgs/msg/Twist or TwistStamped", "shape": [3],
            "unit": "m/s, m/s, rad/s", "frame": frames.base, "rate": rate,
            "least": [body.min_v_x, -body.max_v_y, -body.max_w_z], "most": [body.max_v_x, body.max_v_y, body.max_w_z],
            "meaning": "v_x forwards, v_y to the left, w_z counter-clockwise: to be held until the next, and no longer "
            "than 0.2 s",
        },
        "map": {"topic": topics.map, "type": "nav_msgs/msg/OccupancyGrid", "frame": frames.map,
                "rate": config.navigator.planning_rate, "unit": "percent; -1 unknown"},
        "plan": {"topic": topics.plan, "type": "nav_msgs/msg/Path", "frame": frames.map,
                 "rate": config.navigator.planning_rate, "unit": "m"},
        "transform": {"topic": "tf", "type": "tf2_msgs/msg/TFMessage", "frame": f"{frames.odom} in {frames.map}",
                      "rate": rate, "unit": "m, rad"},
    }  # fmt: skip
