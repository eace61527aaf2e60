"""Perception: what one scan and the odometry say about the surroundings."""
