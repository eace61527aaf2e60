"""Names of the columns of the movers' arrays, for the kernels that work on them."""

RANDOM_WALK, PATROL, SOCIAL_FORCE, KEYFRAMES, USER_MOTION = range(5)
"""Values of ``MOTION``."""
MOTION, SPEED, RADIUS, FIRST_WAYPOINT, WAYPOINTS = range(5)
"""Columns of a mover's constants."""
X, Y, YAW, V_X, V_Y, WALKED, RUN, SINCE_TURN, TARGET, DIRECTION, PROGRESS, STUCK = range(12)
"""Columns of a mover's state."""
STATE_SIZE = 12
GO_TIME, STOP_TIME, UNTIL_CHANGE, STOPPED = range(4)
"""Columns of the pauses of a mover that stops and goes."""
START_X, START_Y, GOAL_X, GOAL_Y = range(4)
"""Columns of the robot's task."""
