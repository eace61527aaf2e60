"""Constants of the leg odometry."""

VELOCITY_GAIN = 0.3
"""Share by which the velocity estimate follows the standing legs each control step: a low-pass of 0.05 s."""
