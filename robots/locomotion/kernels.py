"""One control step of a gait around the network, compiled: nominal trot, velocity estimate, observation.

The simulation runs these on one robot, the training on hundreds; arrays are one robot's rows, filled in place.
All results follow from the robot's own measurements and commands.
"""

import math
from typing import NamedTuple

import numpy as np

from robots.locomotion.legs import foot_jacobian, foot_position, leg_angles
from vuca_nav.kernel_cache import njit

OBSERVATION_SIZE = 49
"""Size of the observation: gyro 3, up 3, command 3, joint angles 12, joint speeds 12, last action 12, clock 2,
estimated velocity 2."""
ACTION_SIZE = 12
RATE_SCALE = 0.05
"""Scale of joint speeds in the observation [s/rad]."""
GYRO_SCALE = 0.25
"""Scale of angular rates in the observation [s/rad]."""
TRIM_RATE = 1.0
"""Rate of the integral that removes steady errors of the velocity [1/s]."""
TRIM_LIMIT = 0.1
"""Greatest trim of v_x and of v_y [m/s]."""
TURN_TRIM_LIMIT = 0.1
"""Greatest trim of w_z [rad/s]."""
LEVELLING_TIME = 0.5
"""Time constant with which the trunk is levelled while it rises, and with which that fades afterwards [s]."""
LEVELLING_LIMIT = 0.2
"""Greatest tilt that is levelled [rad]."""


class Tuning(NamedTuple):
    """Numbers of a QuadrupedConfig that the kernels need."""

    dt: float
    frequency: float
    duty: float
    swing_height: float
    hip_height: float
    stance_width: float
    ramp_time: float
    deadband: float
    kp: float
    kd: float
    weight: float
    """Weight of the robot [N]."""
    max_torque: np.ndarray
    """Torque limits of a leg's joints (3,) [N m]."""
    stall_torque: np.ndarray
    """Torque at standstill on the straight line of torque against speed (3,) [N m]."""
    no_load_speed: np.ndarray
    """Speed at which that line reaches zero torque (3,) [rad/s]."""
    slew: np.ndarray
    """Largest change of the command, v_x, v_y, w_z (3,) [m/s^2, rad/s^2]."""
    nominal: np.ndarray
    """Joint angles when standing (12,) [rad]."""
    action_scale: np.ndarray
    """Change of a joint's target by an action of one (12,) [rad]."""
    lower: np.ndarray
    """Lower limits of the joints (12,) [rad]."""
    upper: np.ndarray
    """Upper limits of the joints (12,) [rad]."""
    fall_height: float
    """Height of base_link over the floor below which the robot lies [m]."""
    side_slip: float
    """Sideways drift, see QuadrupedConfig [s]."""
    yaw_lever: float
    """Lever of the turn rate, see QuadrupedConfig [m]."""


@njit(cache=True)
def advance_clock(tuning, wanted, command, clock):
    """Move the command towards the wanted one, and the gait's clock on.

    Args:
        tuning: The gait's constants.
        wanted: (3,) v_x, v_y, w_z.
        command: (3,) command to the policy; changed.
        clock: (2,) phase 0-1 and how far stepping has faded in, 0-1; changed.
    """
    for i in range(3):
        step = tuning.slew[i] * tuning.dt
        command[i] += min(max(wanted[i] - command[i], -step), step)
    speed = math.sqrt(command[0] ** 2 + command[1] ** 2 + (tuning.yaw_lever * command[2]) ** 2)
    step = tuning.dt / tuning.ramp_time
    clock[1] = min(max(clock[1] + (step if speed > tuning.deadband else -step), 0.0), 1.0)
    clock[0] = (clock[0] + tuning.frequency * tuning.dt) % 1.0 if clock[1] > 0.0 else 0.0


@njit(cache=True)
def advance_trim(tuning, command, clock, velocity, yaw_rate, trim, asked):
    """Integrate the difference of command and estimated velocity, so that no steady error stays.

    Args:
        tuning: The gait's constants.
        command: (3,) after the slew limit.
        clock: (2,); standing still, the trim fades.
        velocity: (2,) as estimated.
        yaw_rate: Turn rate as measured [rad/s].
        trim: (3,) added to the command; changed.
        asked: (3,) command plus trim, the input of trot and policy; changed.
    """
    for i in range(3):
        if clock[1] == 1.0:
            measured = velocity[i] if i < 2 else yaw_rate
            trim[i] += TRIM_RATE * tuning.dt * (command[i] - measured)
            limit = TRIM_LIMIT if i < 2 else TURN_TRIM_LIMIT
            trim[i] = min(max(trim[i], -limit), limit)
        else:
            trim[i] -= tuning.dt / tuning.ramp_time * trim[i]
        asked[i] = command[i] + trim[i]


@njit(cache=True)
def leg_phase(leg, phase):
    """Phase of one leg's stride, 0-1; diagonal legs go together."""
    return (phase + (0.5 if leg == 1 or leg == 2 else 0.0)) % 1.0


@njit(cache=True)
def level_trunk(legs, tuning, up, tilt, lifts):
    """Shorten the higher legs of a robot that stands, and lengthen the lower ones, until its trunk is level.

    Args:
        legs: The legs' dimensions.
        tuning: The gait's constants.
        up: (3,) the vertical in base_link.
        tilt: (2,) tilt that is levelled, forward and left [rad]; changed.
        lifts: (4,) how much higher than in the nominal trot each foot is [m]; changed.
    """
    for i in range(2):
        tilt[i] += tuning.dt / LEVELLING_TIME * up[i]
        tilt[i] = min(max(tilt[i], -LEVELLING_LIMIT), LEVELLING_LIMIT)
    for leg in range(4):
        lifts[leg] = tilt[0] * legs.hips[leg, 0] + tilt[1] * (legs.hips[leg, 1] + legs.offsets[leg])


@njit(cache=True)
def trot_angles(legs, tuning, command, clock, lifts, out):
    """Compute joint angles of the nominal trot, the feet higher by ``lifts`` (4,) [m]. out: (12,) [rad].

    In stance a foot goes back over the ground on the arc of the commanded twist; in swing it
    returns, lifted along a half sine of its phase. The servos are soft: a standing leg's targets are ahead of its
    angles by as much as carrying its share of the weight takes.
    """
    stance_time = tuning.duty / tuning.frequency
    standing = 0
    for leg in range(4):
        if leg_phase(leg, clock[0]) < tuning.duty:
            standing += 1
    jacobian = np.empty((3, 3))
    for leg in range(4):
        side = 1.0 if legs.offsets[leg] > 0.0 else -1.0
        x, y = legs.hips[leg, 0], legs.hips[leg, 1] + legs.offsets[leg] + side * tuning.stance_width
        phase = leg_phase(leg, clock[0])
        if phase < tuning.duty:
            along, lift = 0.5 - phase / tuning.duty, 0.0
        else:
            swing = (phase - tuning.duty) / (1.0 - tuning.duty)
            along, lift = -0.5 * math.cos(math.pi * swing), math.sin(math.pi * swing)
        along *= clock[1] * stance_time
        z = legs.foot_radius - tuning.hip_height + lift * clock[1] * tuning.swing_height + lifts[leg]
        # Where a point of the floor under the resting foot is, ``along`` before the body passes over it.
        turn = along * command[2]
        c, t = math.cos(turn), math.sin(turn)
        c_half, t_half = math.cos(0.5 * turn), math.sin(0.5 * turn)
        forward, left = along * command[0], along * command[1]
        foot_x = c * x - t * y + c_half * forward - t_half * left
        foot_y = t * x + c * y + t_half * forward + c_half * left
        leg_angles(legs, leg, foot_x, foot_y, z, out[3 * leg : 3 * leg + 3])
        if phase < tuning.duty:
            foot_jacobian(legs, leg, out[3 * leg : 3 * leg + 3], jacobian)
            for j in range(3):  # torque = -J^T force, the floor's force being up
                out[3 * leg + j] -= jacobian[2, j] * tuning.weight / (standing * tuning.kp)


@njit(cache=True)
def servo_torque(tuning, joint, target, q, dq):
    """Torque of a joint's servo, limited as in the model's actuators [N m]."""
    k = joint % 3
    limit, stall, share = tuning.max_torque[k], tuning.stall_torque[k], dq / tuning.no_load_speed[k]
    torque = min(max(tuning.kp * (target - q) - tuning.kd * dq, -stall * (1.0 + share)), stall * (1.0 - share))
    return min(max(torque, -limit), limit)


@njit(cache=True)
def foot_motion(legs, leg, q, dq, gyro, up, torque, out):
    """Compute the body's velocity from one leg whose foot stands and rolls without slipping.

    Args:
        legs: The legs' dimensions.
        leg: Index of the leg.
        q: (3,) angles.
        dq: (3,) their speeds.
        gyro: (3,) angular velocity in base_link.
        up: (3,) the vertical in base_link.
        torque: (3,) of the leg's servos.
        out: (3,) velocity of base_link's origin in base_link.

    Returns:
        The upward force of the floor on the foot, from the torques, the leg's own inertia neglected [N].
    """
    p, jacobian = np.empty(3), np.empty((3, 3))
    foot_position(legs, leg, q, p)
    foot_jacobian(legs, leg, q, jacobian)
    c, s = math.cos(q[0]), math.sin(q[0])
    bend = dq[1] + dq[2]
    w0, w1, w2 = gyro[0] + dq[0], gyro[1] + bend * c, gyro[2] + bend * s
    r = legs.foot_radius
    # Rolling: the sphere's centre moves at w_shank x (r up); it also is v + w x p + J dq.
    out[0] = r * (w1 * up[2] - w2 * up[1]) - (gyro[1] * p[2] - gyro[2] * p[1])
    out[1] = r * (w2 * up[0] - w0 * up[2]) - (gyro[2] * p[0] - gyro[0] * p[2])
    out[2] = r * (w0 * up[1] - w1 * up[0]) - (gyro[0] * p[1] - gyro[1] * p[0])
    for i in range(3):
        for j in range(3):
            out[i] -= jacobian[i, j] * dq[j]
    # torque = -J^T force, so up . force = -(J^-1 up) . torque, by Cramer's rule.
    a, b, e = jacobian[:, 0], jacobian[:, 1], jacobian[:, 2]
    det = _triple(a, b, e)
    if abs(det) < 1e-5:  # a stretched leg gives no force
        return 0.0
    return -(
        _triple(up, b, e) * torque[0] + _triple(a, up, e) * torque[1] + _triple(a, b, up) * torque[2]
    ) / det  # fmt: skip


@njit(cache=True)
def _triple(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])


@njit(cache=True)
def leg_velocity(legs, tuning, gyro, up, q, dq, targets, last_targets, out):
    """Compute the body's velocity along the floor from the standing feet. out: (2,) forward, left [m/s].

    Each foot counts by the cube of the force it carries. Targets reach the servos up to a control step late, so it is
    not known which ones a measurement was made under: a foot carries the force that both the present and the last ones
    give.
    The result is in the heading frame: base_link's x axis, levelled.

    Returns:
        Share of the robot's weight on the feet, at most 1, by which the result is weighted.
    """
    carried, total, v0, v1, v2 = 0.0, 0.0, 0.0, 0.0, 0.0
    torque, velocity = np.empty(3), np.empty(3)
    for leg in range(4):
        j = 3 * leg
        for i in range(3):
            torque[i] = servo_torque(tuning, j + i, last_targets[j + i], q[j + i], dq[j + i])
        force = foot_motion(legs, leg, q[j : j + 3], dq[j : j + 3], gyro, up, torque, velocity)
        for i in range(3):
            torque[i] = servo_torque(tuning, j + i, targets[j + i], q[j + i], dq[j + i])
        force = min(force, foot_motion(legs, leg, q[j : j + 3], dq[j : j + 3], gyro, up, torque, velocity))
        # Below a tenth of the weight a foot may be swinging: its leg's inertia looks like that much force. The cube
        # leaves little to feet just set down or about to lift off, which carry some weight but do not stand.
        share = min(max(force / tuning.weight - 0.1, 0.0), 0.5)
        carried += share
        share = share**3
        total += share
        v0 += share * velocity[0]
        v1 += share * velocity[1]
        v2 += share * velocity[2]
    if total < 1e-4:
        return 0.0
    level_velocity(up, v0 / total, v1 / total, v2 / total, out)
    yaw_rate = gyro[0] * up[0] + gyro[1] * up[1] + gyro[2] * up[2]
    forward, left = out[0], out[1]
    out[0] = forward + tuning.side_slip * yaw_rate * left
    out[1] = left - tuning.side_slip * yaw_rate * forward
    return min(carried, 1.0)


@njit(cache=True)
def level_velocity(up, v0, v1, v2, out):
    """Split a velocity in base_link into forward and left along the floor. out: (2,)."""
    # Forward is x less its part along up; left is up x forward.
    f0, f1, f2 = 1.0 - up[0] * up[0], -up[0] * up[1], -up[0] * up[2]
    length = math.sqrt(max(f0 * f0 + f1 * f1 + f2 * f2, 1e-9))
    f0, f1, f2 = f0 / length, f1 / length, f2 / length
    l0, l1, l2 = up[1] * f2 - up[2] * f1, up[2] * f0 - up[0] * f2, up[0] * f1 - up[1] * f0
    out[0] = v0 * f0 + v1 * f1 + v2 * f2
    out[1] = v0 * l0 + v1 * l1 + v2 * l2


@njit(cache=True)
def fill_observation(tuning, gyro, up, command, q, dq, action, clock, velocity, out):
    """Fill the policy's input. out: (OBSERVATION_SIZE,)."""
    for i in range(3):
        out[i] = GYRO_SCALE * gyro[i]
        out[3 + i] = up[i]
        out[6 + i] = command[i]
    for j in range(12):
        out[9 + j] = q[j] - tuning.nominal[j]
        out[21 + j] = RATE_SCALE * dq[j]
        out[33 + j] = action[j]
    angle = 2.0 * math.pi * clock[0]
    out[45], out[46] = clock[1] * math.sin(angle), clock[1] * math.cos(angle)
    out[47], out[48] = velocity[0], velocity[1]


@njit(cache=True)
def joint_targets(legs, tuning, command, clock, lifts, action, out):
    """Add the policy's correction to the nominal trot, within the joints' limits. out: (12,) [rad].

    The policy does without the lifts of the start-up: they fade.
    """
    for leg in range(4):
        lifts[leg] -= tuning.dt / LEVELLING_TIME * lifts[leg]
    trot_angles(legs, tuning, command, clock, lifts, out)
    for j in range(12):
        out[j] = min(max(out[j] + tuning.action_scale[j] * action[j], tuning.lower[j]), tuning.upper[j])
