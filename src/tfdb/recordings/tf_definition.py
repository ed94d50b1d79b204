"""The definition and the quality of service of tf2_msgs/TFMessage in written recordings."""

from __future__ import annotations

STATE = "/tfdb/state"
"""A topic that files of tfdb.Recorder have: the first message of each file is the newest state."""
STORE = "tfdb.store"
"""Key in that topic's metadata: id of the recorded store, in hexadecimal digits."""
LOST = "tfdb.lost"
"""The metadata of commits that a tfdb.Recorder did not record."""

TYPE = "tf2_msgs/TFMessage"
ROS1_DIGEST = "94810edda583a504dfda3829e70d7eec"
ROS2_DIGEST = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"

_RULE = "=" * 80
_TRANSFORMS = f"""\
geometry_msgs/TransformStamped[] transforms
{_RULE}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
"""
_TRANSFORM = f"""\
{_RULE}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
ROS1_TEXT = f"""\
{_TRANSFORMS}{_RULE}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
{_TRANSFORM}"""
ROS2_TEXT = f"""\
{_TRANSFORMS}{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_TRANSFORM}"""


def qos_text(*, static: bool) -> str:
    """Return the quality of service of tf2 as YAML: static transforms reach late subscribers."""
    unlimited = "{nsec: 854775807, sec: 9223372036}"
    return (
        "- avoid_ros_namespace_conventions: false\n"
        f"  deadline: {unlimited}\n"
        f"  depth: {1 if static else 100}\n"
        f"  durability: {1 if static else 2}\n"
        "  history: 1\n"
        f"  lifespan: {unlimited}\n"
        "  liveliness: 1\n"
        f"  liveliness_lease_duration: {unlimited}\n"
        "  reliability: 1"
    )
