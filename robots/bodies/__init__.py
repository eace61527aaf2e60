"""The bodies: MJCF, limits, actuation."""
