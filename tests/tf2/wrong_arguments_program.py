"""A program of ROS 1 that gives wrong arguments; it prints how each call ends.

Run by Debian's Python with the real packages, and by ours with the argument `tfdb`.
"""

from __future__ import annotations

import json
import sys
from io import BytesIO

if sys.argv[1:] == ["tfdb"]:
    from tfdb import tf2

    tf2.install()

import rospy
import tf2_ros
from geometry_msgs.msg import PointStamped, TransformStamped, Vector3

rospy.rostime.set_rostime_initialized(True)
rospy.rostime.switch_to_wallclock()


def stored(child: str = "base") -> TransformStamped:
    made = TransformStamped()
    made.header.stamp, made.header.frame_id, made.child_frame_id = rospy.Time(12), "map", child
    made.transform.translation.x, made.transform.rotation.z = 1.5, 0.6
    made.transform.rotation.w = 0.8
    return made


class Topic:
    """It serialises what is sent, as rospy does."""

    @staticmethod
    def publish(message: object) -> None:
        message.serialize(BytesIO())


def broadcaster() -> tf2_ros.TransformBroadcaster:
    made = tf2_ros.TransformBroadcaster.__new__(tf2_ros.TransformBroadcaster)
    if sys.argv[1:] == ["tfdb"]:
        from tf2.loopback import LoopbackNode

        made.__init__(LoopbackNode())
    made.pub_tf = Topic
    return made


core = tf2_ros.BufferCore(rospy.Duration(10))
buffer = tf2_ros.Buffer(debug=False)
for each in (core, buffer):
    each.set_transform(stored(), "me")
point = PointStamped()
point.header.frame_id, point.header.stamp = "base", rospy.Time(12)
now = rospy.Time(0)
CALLS = {
    "integer time": lambda: core.lookup_transform_core("map", "base", 0),
    "no time": lambda: core.lookup_transform_core("map", "base", None),
    "text as a time": lambda: core.lookup_transform_core("map", "base", "now"),
    "float time": lambda: core.lookup_transform_core("map", "base", 12.0),
    "integer time of a buffer": lambda: buffer.lookup_transform("map", "base", 0),
    "float timeout": lambda: buffer.lookup_transform("map", "base", now, 0.1),
    "text as a timeout": lambda: buffer.lookup_transform("map", "base", now, "1"),
    "number of seconds": lambda: tf2_ros.Buffer(10, debug=False),
    "text as cache_time": lambda: tf2_ros.Buffer("x", debug=False),
    "number of a core": lambda: tf2_ros.BufferCore(10.5),
    "by name": lambda: core.set_transform(transform=stored("arm"), authority="me"),
    "one too many of set": lambda: core.set_transform(stored(), "me", "you"),
    "one too few of set": lambda: core.set_transform(stored()),
    "one too many of clear": lambda: core.clear(1),
    "one too many of lookup": lambda: core.lookup_transform_core("map", "base", now, 4),
    "unknown name": lambda: core.lookup_transform_core(target="map", source="base", time=now),
    "integer frame": lambda: buffer.lookup_transform(3, "base", now),
    "integer authority": lambda: core.set_transform(stored(), 3),
    "type not imported": lambda: buffer.transform(point, "map"),
    "unknown type": lambda: buffer.transform("x", "map"),
    "no conversion": lambda: tf2_ros.convert(1, str),
    "no header": lambda: tf2_ros.Stamped(Vector3(), now, "map"),
    "send nothing": lambda: broadcaster().sendTransform(None),
    "send text": lambda: broadcaster().sendTransform("x"),
    "send a list of nothing": lambda: broadcaster().sendTransform([None]),
    "send a number": lambda: broadcaster().sendTransform(3),
    "send a tuple": lambda: broadcaster().sendTransform((stored(),)),
    "send a list": lambda: broadcaster().sendTransform([stored()]),
}


def main() -> None:
    ends = {}
    for name, call in CALLS.items():
        try:
            call()
        except Exception as error:
            ends[name] = [str(error), *(each.__name__ for each in type(error).__mro__)]
        else:
            ends[name] = []
    print(json.dumps(ends))


main()
