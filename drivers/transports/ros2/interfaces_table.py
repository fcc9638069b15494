"""Interfaces of ROS 2 that labweb speaks by itself, as their packages publish them.

Fields alone: comments and constants do not travel. A test holds them against the files that ROS
has installed.

Source:
    ros2/common_interfaces, ros2/rcl_interfaces, ros2/rmw_dds_common, ros2/unique_identifier_msgs
    and ros2/geometry2, branch kilted.
"""

INTERFACES = {
    "action_msgs/msg/GoalInfo": (
        "unique_identifier_msgs/UUID goal_id\nbuiltin_interfaces/Time stamp"
    ),
    "action_msgs/msg/GoalStatus": "GoalInfo goal_info\nint8 status",
    "action_msgs/msg/GoalStatusArray": "GoalStatus[] status_list",
    "action_msgs/srv/CancelGoal": (
        "GoalInfo goal_info\n---\nint8 return_code\nGoalInfo[] goals_canceling"
    ),
    "builtin_interfaces/msg/Duration": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\nPose pose",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "std_msgs/Header header\nPoseWithCovariance pose"
    ),
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\nTransform transform"
    ),
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "rcl_interfaces/msg/FloatingPointRange": "float64 from_value\nfloat64 to_value\nfloat64 step",
    "rcl_interfaces/msg/IntegerRange": "int64 from_value\nint64 to_value\nuint64 step",
    "rcl_interfaces/msg/ListParametersResult": "string[] names\nstring[] prefixes",
    "rcl_interfaces/msg/Parameter": "string name\nParameterValue value",
    "rcl_interfaces/msg/ParameterDescriptor": (
        "string name\nuint8 type\nstring description\nstring additional_constraints\n"
        "bool read_only\nbool dynamic_typing\nFloatingPointRange[<=1] floating_point_range\n"
        "IntegerRange[<=1] integer_range"
    ),
    "rcl_interfaces/msg/ParameterValue": (
        "uint8 type\nbool bool_value\nint64 integer_value\nfloat64 double_value\n"
        "string string_value\nbyte[] byte_array_value\nbool[] bool_array_value\n"
        "int64[] integer_array_value\nfloat64[] double_array_value\nstring[] string_array_value"
    ),
    "rcl_interfaces/msg/SetParametersResult": "bool successful\nstring reason",
    "rcl_interfaces/srv/DescribeParameters": (
        "string[] names\n---\nParameterDescriptor[] descriptors"
    ),
    "rcl_interfaces/srv/GetParameterTypes": "string[] names\n---\nuint8[] types",
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nParameterValue[] values",
    "rcl_interfaces/srv/ListParameters": (
        "string[] prefixes\nuint64 depth\n---\nListParametersResult result"
    ),
    "rcl_interfaces/srv/SetParameters": (
        "Parameter[] parameters\n---\nSetParametersResult[] results"
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "Parameter[] parameters\n---\nSetParametersResult result"
    ),
    "rmw_dds_common/msg/Gid": "char[16] data",
    "rmw_dds_common/msg/NodeEntitiesInfo": (
        "string<=256 node_namespace\nstring<=256 node_name\nGid[] reader_gid_seq\n"
        "Gid[] writer_gid_seq"
    ),
    "rmw_dds_common/msg/ParticipantEntitiesInfo": (
        "Gid gid\nNodeEntitiesInfo[] node_entities_info_seq"
    ),
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort"
    ),
    "std_msgs/msg/Bool": "bool data",
    "std_msgs/msg/Float64": "float64 data",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/msg/Int64": "int64 data",
    "std_msgs/msg/String": "string data",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "unique_identifier_msgs/msg/UUID": "uint8[16] uuid",
}
"""Text by full name."""
