"""Messages and times of a real ROS 1 or ROS 2 go in and come out."""

from __future__ import annotations

from tf2.real_ros import run_with_ros1, run_with_ros2

PROGRAM = """
import io
import pickle
import geometry_msgs.msg
import rospy
from tfdb import tf2
from tfdb.ros import ros_messages

STAMP = 1_700_000_000, 123_456_789
message = geometry_msgs.msg.TransformStamped()
message.header.frame_id, message.child_frame_id = "/a", "b"
message.header.stamp = rospy.Time(*STAMP)
message.transform.translation.x = 1.5
message.transform.rotation.y, message.transform.rotation.w = 0.6, 0.8
core = tf2.BufferCore(rospy.Duration(5))
assert core.flavor == "ros1" and core.buffer.history == 5.0
assert core.set_transform(message, "me") is None is core.set_transform(message, "again")
found = core.lookup_transform_core("b", "a", rospy.Time(0))
assert type(found) is geometry_msgs.msg.TransformStamped
assert type(found.header.stamp) is rospy.Time
assert (found.header.stamp.secs, found.header.stamp.nsecs) == STAMP
assert (found.header.frame_id, found.child_frame_id) == ("b", "a")
assert found.transform.translation.x != 1.5 and abs(found.transform.rotation.y + 0.6) < 1e-12
assert core.get_latest_common_time("a", "b") == rospy.Time(*STAMP)
# The second one is made without Python, and is the same to the last field.
maker, _ = ros_messages.makers("ros1")
again = core.lookup_transform_core("b", "a", rospy.Time(*STAMP))
assert maker.is_quick and again == found and again is not found
for made in (found, again):
    assert (made.header.seq, type(made.header.stamp)) == (0, rospy.Time)
    assert not hasattr(made, "_connection_header")
    assert pickle.loads(pickle.dumps(made)) == again
    made._check_types()
buffer = io.BytesIO()
again.serialize(buffer)
assert geometry_msgs.msg.TransformStamped().deserialize(buffer.getvalue()) == again
try:
    core.lookup_transform_core("a", "b", rospy.Time(1))
except tf2.ExtrapolationException as error:
    assert "but only time 1700000000.123456789 is in the buffer" in str(error)
else:
    raise AssertionError("it found one")
print("done")
"""


OF_ROS2 = """
import builtin_interfaces.msg
import geometry_msgs.msg
import rclpy.time
from tf2.test_messages_made import slots
from tfdb import tf2
from tfdb.ros import ros_messages

STAMP = 1_700_000_000_123_456_789
POSE = [1.5, -2.5, 3.25, 0.0, 0.6, 0.0, 0.8]
maker, _ = ros_messages.makers("ros2")
assert maker.is_quick
made, expected = (make("a", "b", STAMP, POSE) for make in (maker, ros_messages.make_ros2))
assert type(made) is geometry_msgs.msg.TransformStamped
assert made == expected and slots(made) == slots(expected)
assert slots(made)[1]["_check_fields"][1] in (True, False)
made.transform.translation.x = 1.25
made.header.stamp.sec += 1
assert expected.transform.translation.x == 1.5 and made != expected
core = tf2.BufferCore()
assert core.set_transform(made, "me") is None is core.set_transform(expected, "me")
for time in (rclpy.time.Time(nanoseconds=STAMP), expected.header.stamp):
    for _ in range(2):
        found = core.lookup_transform_core("a", "b", time)
        assert slots(found) == slots(expected), found
        assert core.can_transform_core("a", "b", time) == (1, "")
assert core.flavor == "ros2"
late = maker("a", "b", 2**31 * 10**9 - 1, POSE)
assert late.header.stamp == builtin_interfaces.msg.Time(sec=2**31 - 1, nanosec=999_999_999)
print("done")
"""


def test_messages_of_ros2() -> None:
    run_with_ros2(OF_ROS2)


def test_messages_of_ros1() -> None:
    run_with_ros1(PROGRAM)
