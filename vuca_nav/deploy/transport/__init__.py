"""ROS 2 topics, services and actions on the wire, without ROS: one interface, implemented on DDS."""
