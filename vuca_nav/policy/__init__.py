"""Local control (30 Hz): from scan, waypoint and velocity to a command."""
