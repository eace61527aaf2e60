"""The deployed stack as a node of a ROS 2 network: what it hears, when it ticks, what it says."""
