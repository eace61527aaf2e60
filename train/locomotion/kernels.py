"""Control step of a batch after the physics: reward and end of episode, then reset and next observation; compiled."""

import math
from typing import NamedTuple

import numpy as np

from robots.locomotion.kernels import (
    ACTION_SIZE,
    OBSERVATION_SIZE,
    advance_clock,
    fill_observation,
    foot_motion,
    leg_phase,
    leg_velocity,
    level_velocity,
    servo_torque,
)
from robots.locomotion.odometry import VELOCITY_GAIN
from train.locomotion.batch import NUM_ERRORS
from train.locomotion.rewards import (
    LINEAR_FINE_WIDTH,
    LINEAR_WIDTH,
    MEAN_ERROR_WIDTH,
    MEAN_YAW_SHARE,
    REWARDS,
    STAND_SPEED_SHARE,
    YAW_FINE_WIDTH,
    YAW_WIDTH,
)
from vuca_nav.kernel_cache import njit

CRITIC_SIZE = OBSERVATION_SIZE + 11
"""Size of the critic's input: observation, then velocity 3, height, contacts 4, slow tracking error 3."""
NUM_UNIFORM = 26
"""Number of uniform numbers that a reset takes."""
NUM_NORMAL = 49
"""Number of normal numbers: 29 for a sample of the sensors, 20 for their errors of an episode."""
_FALL_UP = 0.5
"""Vertical part of base_link's z axis below which the robot has fallen: 60 degrees."""
_CONTACT = 2.0
"""Force that counts as contact [N]."""
_MAX_STATE = 1e10
"""Value beyond which, as in MuJoCo, the physics has diverged [any unit]."""
FALL_COST = 5.0
"""Cost of a fall: the reward of some 1.3 s of walking well."""
_SLOW = 0.5
"""Time constant of the slow tracking error [s]."""
_NUM_SAMPLE = 29
"""Number of normal numbers of a sample: gyro 3, tilt 2, joint angles 12, joint speeds 12."""
_STILL, _ONE_AXIS, _CORNER = 0.1, 0.4, 0.8
"""Cumulative shares of the commands: a tenth stand still, three tenths move along one axis only; beyond the last, a
fifth are near a corner."""
_SHORTEST_COMMAND, _COMMAND_SPREAD = 60, 240.0
"""Control steps for which a command is kept, at least, and the most that are added: 1 to 5 s."""
_DROP = 0.02
"""Height above standing at which robots begin [m]."""
_FIRST_ANGLE, _FIRST_SPEED = 0.1, 0.4
"""Largest deviation of the joints at the start [rad], and largest velocities there [m/s, rad/s]."""
_HALF_LANE = 2.0
"""Half width of a lane [m]: a robot's place across it is wrapped there, as the floor is the same all over it."""


class PhysicsResult(NamedTuple):
    """Results of MuJoCo's steps."""

    states: np.ndarray
    """MuJoCo's states, (n, state size)."""
    sensors: np.ndarray
    """Values of the sensors, (n, sensor values)."""
    touch: np.ndarray
    """Index of each foot's force among the sensors, (4,)."""


class Verdict(NamedTuple):
    """Judgement of a control step."""

    reward: np.ndarray
    """Rewards, (n,)."""
    terminated: np.ndarray
    """Whether each robot fell, (n,)."""
    truncated: np.ndarray
    """Whether each episode's time was up, (n,)."""
    terms: np.ndarray
    """Terms of the reward, (n, terms), in the order of ``REWARDS``."""


class Chance(NamedTuple):
    """Random numbers of a control step."""

    uniform: np.ndarray
    """Uniform numbers in [0, 1), (n, NUM_UNIFORM)."""
    normal: np.ndarray
    """Standard normal numbers, (n, NUM_NORMAL)."""


class Challenge(NamedTuple):
    """Difficulty of the task: commands, pushes and floor."""

    low: np.ndarray
    """Lowest commands, (3,)."""
    high: np.ndarray
    """Highest commands, (3,)."""
    push_speed: float
    """Largest sudden change of velocity [m/s]."""
    push_interval: float
    """Mean time between pushes [s]."""
    wrap: float
    """A robot's place along its lane is taken modulo this [m]."""


class Observations(NamedTuple):
    """Inputs of actor and critic."""

    observation: np.ndarray
    """Inputs of the actor, (n, OBSERVATION_SIZE)."""
    privileged: np.ndarray
    """Inputs of the critic, (n, CRITIC_SIZE)."""


(
    _LINEAR, _LINEAR_FINE, _YAW, _YAW_FINE, _MEAN_ERROR, _CLOCK, _ALIVE, _BOUNCE, _ROLL_PITCH_RATE, _TILT, _HEIGHT,
    _TORQUE, _ACTION_RATE, _ACTION_JERK, _HIPS, _SLIP, _CLEARANCE, _STAND,
) = range(len(REWARDS))  # fmt: skip


@njit(cache=True)
def _in_base(quaternion, v, out):
    """Rotate a vector of the world into base_link: R^T v for the quaternion w, x, y, z."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    u0, u1, u2 = v[0], v[1], v[2]
    out[0] = (1 - 2 * (y * y + z * z)) * u0 + 2 * (x * y + w * z) * u1 + 2 * (x * z - w * y) * u2
    out[1] = 2 * (x * y - w * z) * u0 + (1 - 2 * (x * x + z * z)) * u1 + 2 * (y * z + w * x) * u2
    out[2] = 2 * (x * z + w * y) * u0 + 2 * (y * z - w * x) * u1 + (1 - 2 * (x * x + y * y)) * u2


@njit(cache=True)
def _draw_command(u, low, high, out):
    """Draw a command from the range; a share stands still, moves along one axis, or is near a corner."""
    for k in range(3):
        out[k] = low[k] + (high[k] - low[k]) * u[k]
    if u[3] < _STILL:
        out[:] = 0.0
    elif u[3] < _ONE_AXIS:
        axis = int((u[3] - _STILL) * 10.0)  # three axes over three tenths
        for k in range(3):
            if k != axis:
                out[k] = 0.0
    elif u[3] > _CORNER:  # density grows in proportion to the distance from the middle of the range
        for k in range(3):
            x = 2.0 * u[k] - 1.0
            share = 0.5 + 0.5 * math.copysign(math.sqrt(abs(x)), x)
            out[k] = low[k] + (high[k] - low[k]) * share


@njit(cache=True)
def _reset(tuning, noise, batch, i, u, g, challenge):
    state = batch.state[i]
    state[:] = 0.0
    yaw = math.pi * (2.0 * u[0] - 1.0)
    state[3] = tuning.hip_height + _DROP
    state[4], state[7] = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
    for j in range(12):
        state[8 + j] = tuning.nominal[j] + _FIRST_ANGLE * (2.0 * u[1 + j] - 1.0)
    for k in range(3):
        state[20 + k] = _FIRST_SPEED * (2.0 * u[13 + k] - 1.0)
        state[23 + k] = _FIRST_SPEED * (2.0 * u[16 + k] - 1.0)
    batch.action[i] = 0.0
    batch.last_action[i] = 0.0
    batch.older_action[i] = 0.0
    batch.targets[i] = tuning.nominal
    batch.last_targets[i] = tuning.nominal
    batch.velocity[i] = 0.0
    batch.slow_error[i] = 0.0
    batch.command[i] = 0.0
    batch.clock[i, 0], batch.clock[i, 1] = u[19], 1.0 if u[20] < 0.5 else 0.0
    _draw_command(u[21:25], challenge.low, challenge.high, batch.wanted[i])
    batch.age[i] = 0
    batch.until_command[i] = _SHORTEST_COMMAND + int(_COMMAND_SPREAD * u[25])
    for k in range(NUM_ERRORS):
        sigma = noise.gyro_scale if k < 3 else noise.gyro_bias if k < 6 else noise.tilt if k < 8 else noise.joint_zero
        batch.sensor_errors[i, k] = sigma * g[_NUM_SAMPLE + k]


@njit(cache=True)
def judge(legs, tuning, batch, physics, weights, episode, verdict):
    """Compute reward and end of a control step whose physics is done.

    Args:
        legs: The robot's ``Legs``.
        tuning: The robot's ``Tuning``.
        batch: A ``Batch``; changed.
        physics: A ``PhysicsResult``.
        weights: ``RewardWeights``.
        episode: Longest episode [control steps].
        verdict: Output, a ``Verdict``.
    """
    states, sensors, touch = physics
    reward, terminated, truncated, terms = verdict
    up, v_base, position, rolling, planar = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(2)
    floor_up, normal = np.empty(3), np.array([0.0, 0.0, 1.0])
    torque = np.empty(3)
    for i in range(len(states)):
        batch.state[i] = states[i]
        state = batch.state[i]
        command, clock, action = batch.command[i], batch.clock[i], batch.action[i]
        _in_base(state[4:8], batch.up_world[i], up)
        _in_base(state[4:8], normal, floor_up)
        _in_base(state[4:8], state[20:23], v_base)
        gyro = state[23:26]
        level_velocity(up, v_base[0], v_base[1], v_base[2], planar)
        yaw_rate = gyro[0] * up[0] + gyro[1] * up[1] + gyro[2] * up[2]
        v_up = v_base[0] * up[0] + v_base[1] * up[1] + v_base[2] * up[2]

        # -- motion of the feet, from the true state
        slip, clearance, matches, effort, ground, standing = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for leg in range(4):
            j = 3 * leg
            for k in range(3):
                torque[k] = servo_torque(tuning, j + k, batch.targets[i, j + k], state[8 + j + k], state[26 + j + k])
                effort += torque[k] ** 2
            foot_motion(legs, leg, state[8 + j : 11 + j], state[26 + j : 29 + j], gyro, up, torque, rolling)
            contact = sensors[i, touch[leg]] > _CONTACT
            phase = leg_phase(leg, clock[0])
            stance = phase < tuning.duty or clock[1] < 0.5
            matches += 1.0 if contact == stance else 0.0
            foot_height = _foot_height(legs, leg, state[8 + j : 11 + j], up, position)
            if contact:
                slip += (rolling[0] - v_base[0]) ** 2 + (rolling[1] - v_base[1]) ** 2
                ground += foot_height - legs.foot_radius
                standing += 1.0
        ground = ground / standing if standing > 0.0 else -tuning.hip_height
        height = -ground
        batch.height[i] = height
        for leg in range(4):
            phase = leg_phase(leg, clock[0])
            if phase >= tuning.duty and clock[1] > 0.5:
                lift = tuning.swing_height * math.sin(math.pi * (phase - tuning.duty) / (1.0 - tuning.duty))
                j = 3 * leg
                now = _foot_height(legs, leg, state[8 + j : 11 + j], up, position) - legs.foot_radius - ground
                clearance += min(now - lift, 0.0) ** 2

        # -- the reward
        e_x, e_y, e_w = command[0] - planar[0], command[1] - planar[1], command[2] - yaw_rate
        keep = math.exp(-tuning.dt / _SLOW)
        slow = batch.slow_error[i]
        slow[0] = keep * slow[0] + (1.0 - keep) * e_x
        slow[1] = keep * slow[1] + (1.0 - keep) * e_y
        slow[2] = keep * slow[2] + (1.0 - keep) * e_w
        linear2 = e_x * e_x + e_y * e_y
        slow2 = slow[0] ** 2 + slow[1] ** 2 + (MEAN_YAW_SHARE * slow[2]) ** 2
        rate, jerk, hips, still = 0.0, 0.0, 0.0, 0.0
        for j in range(12):
            rate += (action[j] - batch.last_action[i, j]) ** 2
            jerk += (action[j] - 2.0 * batch.last_action[i, j] + batch.older_action[i, j]) ** 2
            if j % 3 == 0:
                hips += (tuning.action_scale[j] * action[j]) ** 2
            still += abs(state[8 + j] - tuning.nominal[j]) + STAND_SPEED_SHARE * abs(state[26 + j])
        t, w = terms[i], weights
        t[_LINEAR] = w.linear * math.exp(-linear2 / LINEAR_WIDTH)
        t[_LINEAR_FINE] = w.linear_fine * math.exp(-linear2 / LINEAR_FINE_WIDTH)
        t[_YAW] = w.yaw * math.exp(-e_w * e_w / YAW_WIDTH)
        t[_YAW_FINE] = w.yaw_fine * math.exp(-e_w * e_w / YAW_FINE_WIDTH)
        t[_MEAN_ERROR] = w.mean_error * math.exp(-slow2 / MEAN_ERROR_WIDTH)
        t[_CLOCK] = w.clock * matches / 4.0
        t[_ALIVE] = w.alive
        t[_BOUNCE] = w.bounce * v_up * v_up
        t[_ROLL_PITCH_RATE] = w.roll_pitch_rate * (gyro[0] ** 2 + gyro[1] ** 2)
        t[_TILT] = w.tilt * (floor_up[0] ** 2 + floor_up[1] ** 2)
        t[_HEIGHT] = w.height * (height - tuning.hip_height) ** 2
        t[_TORQUE] = w.torque * effort
        t[_ACTION_RATE] = w.action_rate * rate
        t[_ACTION_JERK] = w.action_jerk * jerk
        t[_HIPS] = w.hips * hips
        t[_SLIP] = w.slip * slip
        t[_CLEARANCE] = w.clearance * clearance
        t[_STAND] = w.stand * still if clock[1] == 0.0 else 0.0
        total = 0.0
        for k in range(len(t)):
            total += t[k]
        reward[i] = max(total, 0.0) * tuning.dt

        # -- the end
        batch.age[i] += 1
        finite = True
        for k in range(len(state)):
            if not abs(state[k]) < _MAX_STATE:
                finite = False
        for j in range(ACTION_SIZE):
            if not math.isfinite(action[j]):
                finite = False
        terminated[i] = not finite or up[2] < _FALL_UP or height < tuning.fall_height
        if terminated[i]:
            reward[i] -= FALL_COST
        truncated[i] = (batch.age[i] >= episode or batch.must_reset[i]) and not terminated[i]
        if not finite:
            reward[i] = 0.0
            t[:] = 0.0
        batch.must_reset[i] = False
        batch.older_action[i] = batch.last_action[i]
        batch.last_action[i] = action


@njit(cache=True)
def go_on(legs, tuning, noise, batch, done, physics, chance, challenge, observations):
    """Reset ended episodes, push robots, draw new commands, and fill in the observations.

    Args:
        legs: The robot's ``Legs``.
        tuning: The robot's ``Tuning``.
        noise: A ``SensorNoise``.
        batch: A ``Batch``; changed.
        done: Whether each episode is over, (n,).
        physics: A ``PhysicsResult``.
        chance: A ``Chance``.
        challenge: A ``Challenge``.
        observations: Output, an ``Observations``.
    """
    uniform, normal = chance
    observation, privileged = observations
    push_speed, wrap = challenge.push_speed, challenge.wrap
    up, v_base, planar = np.empty(3), np.empty(3), np.empty(2)
    noisy_gyro, noisy_up, q, dq = np.empty(3), np.empty(3), np.empty(12), np.empty(12)
    clean = np.empty(OBSERVATION_SIZE)
    for i in range(len(done)):
        state, u, g = batch.state[i], uniform[i], normal[i]
        command, clock, gyro = batch.command[i], batch.clock[i], state[23:26]
        if done[i]:
            _reset(tuning, noise, batch, i, u, g, challenge)
            batch.height[i] = tuning.hip_height
        else:
            batch.until_command[i] -= 1
            if batch.until_command[i] <= 0:
                _draw_command(u[0:4], challenge.low, challenge.high, batch.wanted[i])
                batch.until_command[i] = _SHORTEST_COMMAND + int(_COMMAND_SPREAD * u[4])
            if u[5] < tuning.dt / challenge.push_interval:
                angle, speed = 2.0 * math.pi * u[6], push_speed * u[7]
                state[20] += speed * math.cos(angle)
                state[21] += speed * math.sin(angle)
                state[25] += push_speed * (u[8] - 0.5)
            if abs(state[1]) > wrap:
                state[1] -= math.copysign(2.0 * wrap, state[1])
            if abs(state[2]) > _HALF_LANE:
                state[2] -= math.copysign(_HALF_LANE, state[2])

        # -- what the robot measures, as robots.locomotion.odometry.LegSensors does, what it estimates, and its command
        _in_base(state[4:8], batch.up_world[i], up)
        _in_base(state[4:8], state[20:23], v_base)
        errors = batch.sensor_errors[i]
        for k in range(3):
            noisy_gyro[k] = (1.0 + errors[k]) * gyro[k] + errors[3 + k] + noise.gyro * g[k]
        pitch, roll = errors[6] + noise.tilt_noise * g[3], errors[7] + noise.tilt_noise * g[4]
        noisy_up[0], noisy_up[1] = up[0] - pitch * up[2], up[1] + roll * up[2]
        noisy_up[2] = up[2] + pitch * up[0] - roll * up[1]
        length = math.sqrt(noisy_up[0] ** 2 + noisy_up[1] ** 2 + noisy_up[2] ** 2)
        for k in range(3):
            noisy_up[k] /= length
        for j in range(12):
            q[j] = state[8 + j] + errors[8 + j] + noise.joint_angle * g[5 + j]
            dq[j] = state[26 + j] + noise.joint_speed * g[17 + j]
        worth = leg_velocity(legs, tuning, noisy_gyro, noisy_up, q, dq, batch.targets[i], batch.last_targets[i], planar)
        for k in range(2 if worth > 0.0 else 0):  # of no worth, it was not written: it may be of a lost state
            batch.velocity[i, k] += VELOCITY_GAIN * worth * (planar[k] - batch.velocity[i, k])
        advance_clock(tuning, batch.wanted[i], command, clock)
        fill_observation(
            tuning, noisy_gyro, noisy_up, command, q, dq, batch.last_action[i], clock, batch.velocity[i], clean
        )
        for k in range(OBSERVATION_SIZE):
            observation[i, k] = clean[k]
        fill_observation(
            tuning, gyro, up, command, state[8:20], state[26:38], batch.last_action[i], clock, batch.velocity[i], clean
        )
        for k in range(OBSERVATION_SIZE):
            privileged[i, k] = clean[k]
        n = OBSERVATION_SIZE
        privileged[i, n], privileged[i, n + 1], privileged[i, n + 2] = v_base[0], v_base[1], v_base[2]
        privileged[i, n + 3] = batch.height[i]
        for leg in range(4):
            touches = physics.sensors[i, physics.touch[leg]] > _CONTACT
            privileged[i, n + 4 + leg] = 1.0 if touches and not done[i] else 0.0
        for k in range(3):
            privileged[i, n + 8 + k] = batch.slow_error[i, k]


@njit(cache=True)
def _foot_height(legs, leg, q, up, scratch):
    """Height of a foot's centre over base_link's origin, along the vertical [m]."""
    x = -legs.thigh * math.sin(q[1]) - legs.shank * math.sin(q[1] + q[2])
    h = legs.thigh * math.cos(q[1]) + legs.shank * math.cos(q[1] + q[2])
    d, c, s = legs.offsets[leg], math.cos(q[0]), math.sin(q[0])
    scratch[0] = legs.hips[leg, 0] + x
    scratch[1] = legs.hips[leg, 1] + d * c + h * s
    scratch[2] = legs.hips[leg, 2] + d * s - h * c
    return scratch[0] * up[0] + scratch[1] * up[1] + scratch[2] * up[2]
