"""ROS 2 on the wire, without ROS: topics, services and actions over DDS."""
