"""The bodies of the robots: MJCF, limits, actuation."""
