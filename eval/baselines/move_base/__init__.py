"""The paper's first baseline: ROS's move_base with an initially unknown map (Zhang et al., Section IV).

Names, behaviours and default numbers are those of the ROS navigation stack (github.com/ros-planning/navigation).
"""
