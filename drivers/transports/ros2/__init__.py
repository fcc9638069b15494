"""ROS 2 on the wire, without ROS: topics, services and actions over DDS.

Topics go through Cyclone DDS. Requests and replies need what its Python binding does not
give: `rpc` says why and speaks RTPS for them alone.
"""
