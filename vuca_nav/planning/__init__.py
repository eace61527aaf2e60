"""Planning (1 Hz): shortest paths on the inflated grid and sparse waypoints (Zhang et al., Section III-C)."""
