"""Rewards of a gait at each control step: named terms, their weights, and their widths."""

from typing import NamedTuple


class RewardWeights(NamedTuple):
    """Weight of each term, in the order of the terms; found by training Go2 and counting its falls.

    The terms that are errors or costs have negative weights. The reward is the sum, at least 0, times the time step.
    """

    linear: float = 1.0
    """Tracking of the commanded velocity, coarsely; see ``LINEAR_WIDTH``."""
    linear_fine: float = 1.25
    """Tracking of the commanded velocity, finely."""
    yaw: float = 0.5
    """Tracking of the commanded turn rate, coarsely."""
    yaw_fine: float = 2.0
    """Tracking of the commanded turn rate, finely."""
    mean_error: float = 1.0
    """Tracking of velocity and turn rate on the average of the last half second."""
    clock: float = 0.5
    """Share of the feet whose contact agrees with the gait's clock: on the ground in stance, off it in swing."""
    alive: float = 0.3
    """Constant reward of every step."""
    bounce: float = -1.0
    """Vertical velocity squared [(m/s)^-2]."""
    roll_pitch_rate: float = -0.05
    """Roll and pitch rates squared [(rad/s)^-2]."""
    tilt: float = -10.0
    """Horizontal part of the floor's normal squared."""
    height: float = -40.0
    """Deviation from the standing height squared [m^-2]."""
    torque: float = -1e-4
    """Torques squared [(N m)^-2]."""
    action_rate: float = -0.02
    """Change of the action squared."""
    action_jerk: float = -0.01
    """Change of that change squared."""
    hips: float = -0.3
    """Sideways angles of the hips squared [rad^-2]."""
    slip: float = -0.1
    """Velocity of standing feet over the ground squared [(m/s)^-2]."""
    clearance: float = -15.0
    """Missing height of swinging feet, squared [m^-2]."""
    stand: float = -0.5
    """Deviation of the joints from standing, while nothing is commanded."""


REWARDS = RewardWeights._fields
"""Names of the terms."""
LINEAR_WIDTH, LINEAR_FINE_WIDTH = 0.25, 0.015
"""Widths of ``exp(-error^2 / width)`` for the horizontal velocity [m^2/s^2]; the coarse one is legged_gym's (Rudin et
al.)."""
YAW_WIDTH, YAW_FINE_WIDTH = 0.25, 0.03
"""Widths for the turn rate [rad^2/s^2]; the coarse one is legged_gym's."""
MEAN_ERROR_WIDTH = 0.01
"""Width for the averaged error, in which a turn rate's counts half [m^2/s^2]."""
MEAN_YAW_SHARE = 0.5
"""Weight of an averaged error of the turn rate, beside one of the velocity [m/rad]."""
STAND_SPEED_SHARE = 0.05
"""Weight of a joint's speed beside its angle, in ``stand`` [s]."""
