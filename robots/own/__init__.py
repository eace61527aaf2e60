"""Robots of one's own: a file that names an MJCF or a URDF, its drive, limits, lidar and odometry."""
