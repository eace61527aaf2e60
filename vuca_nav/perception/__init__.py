"""Perception: levelled scan, distance fields and tracks from one scan and the odometry."""
