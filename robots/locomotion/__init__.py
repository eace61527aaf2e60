"""Locomotion of quadrupeds: from a velocity command to joint targets, and leg odometry."""
