"""The host's devices as ROS 2 nodes: what they tell, how they are set, what they can be asked."""
