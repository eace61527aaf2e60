"""The simulator behind a robot's ROS 2 topics: what drives a robot on the wire drives the simulated one."""
