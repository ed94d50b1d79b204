"""tf2_kdl by tfdb, with Debian's PyKDL: vectors, frames, twists and wrenches."""

from __future__ import annotations

from tf2.test_debians_packages import run

PROGRAM = """
import math
import PyKDL, tf2_kdl
from tf2_kdl import *

def near(one, other):
    return all(abs(a - b) < 1e-12 for a, b in zip(one, other, strict=True))

placed = geometry_msgs.msg.TransformStamped()
placed.header.frame_id, placed.child_frame_id, placed.header.stamp = "map", "base", rospy.Time(5)
placed.transform.translation.x, placed.transform.translation.z = 1.5, -0.5
placed.transform.rotation.y, placed.transform.rotation.w = 0.6, 0.8
buffer = tf2_ros.Buffer(debug=False)
buffer.set_transform(placed, "me")

vector = tf2_ros.Stamped(PyKDL.Vector(1, 2, 3), rospy.Time(5), "base")
moved = buffer.transform(vector, "map")
assert near(moved, (4.66, 2.0, -0.62)) and moved.header.frame_id == "map", moved
message = tf2_ros.convert(moved, geometry_msgs.msg.PointStamped)
assert (message.point.y, message.header.stamp) == (2.0, rospy.Time(5))
back = tf2_ros.convert(message, PyKDL.Vector)
assert near(back, moved) and back.header.frame_id == "map"
again = tf2_ros.convert(back, PyKDL.Vector)
assert near(again, back) and again.header.stamp == rospy.Time(5) and again is not back

frame = PyKDL.Frame(PyKDL.Rotation.RotY(-math.atan2(0.96, 0.28)), PyKDL.Vector(1, 2, 3))
found = do_transform_frame(frame, placed)
assert near(found.p, moved) and near(found.M.GetQuaternion(), (0, 0, 0, 1)), found
twist = do_transform_twist(PyKDL.Twist(PyKDL.Vector(), PyKDL.Vector(0, 1, 0)), placed)
assert near(twist.rot, (0, 1, 0)) and near(twist.vel, (0.5, 0, 1.5)), twist
wrench = do_transform_wrench(PyKDL.Wrench(PyKDL.Vector(0, 1, 0), PyKDL.Vector()), placed)
assert near(wrench.force, (0, 1, 0)) and near(wrench.torque, (0.5, 0, 1.5)), wrench
assert wrench.header.frame_id == "map" and near(do_transform_vector(vector, placed), moved)
print("done")
"""


def test_kdl() -> None:
    assert run((), PROGRAM) == "done\n"
