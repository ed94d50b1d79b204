"""What people do today with a recording: rosbags decodes it, Debian's tf2 stores it.

Both live in one process: the environment's rosbags, then the system's tf2 behind it on the path.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

sys.path.append("/usr/lib/python3/dist-packages")

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def typestore(path: Path) -> Any:
    """ROS 1's types with tf2_msgs added, which rosbags lacks; ROS 2's have it."""
    if path.suffix != ".bag":
        return get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.ROS1_NOETIC)
    definition = "geometry_msgs/TransformStamped[] transforms"
    store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    return store


class Contender:
    """`load` fills a tf2 buffer, `read` only takes the raw messages out of the container."""

    def read(self, path: str) -> dict[str, float]:
        start = time.process_time()
        count = 0
        with AnyReader([Path(path)], default_typestore=typestore(Path(path))) as reader:
            for _connection, _stamp, raw in reader.messages():
                count += len(raw) > 0
        return {"seconds": time.process_time() - start, "messages": count}

    def load(self, path: str) -> dict[str, float]:
        start = time.process_time()
        buffer = tf2_ros.Buffer(rospy.Duration(10**6), debug=False)
        message = TransformStamped()  # filled again and again: generous to the rival
        stored = 0
        with AnyReader([Path(path)], default_typestore=typestore(Path(path))) as reader:
            for connection, _stamp, raw in reader.messages():
                store = (
                    buffer.set_transform_static
                    if connection.topic == "/tf_static"
                    else buffer.set_transform
                )
                for transform in reader.deserialize(raw, connection.msgtype).transforms:
                    stamp = transform.header.stamp
                    message.header.stamp = rospy.Time(stamp.sec, stamp.nanosec)
                    message.header.frame_id = transform.header.frame_id
                    message.child_frame_id = transform.child_frame_id
                    t, q = transform.transform.translation, transform.transform.rotation
                    into_t, into_q = message.transform.translation, message.transform.rotation
                    into_t.x, into_t.y, into_t.z = t.x, t.y, t.z
                    into_q.x, into_q.y, into_q.z, into_q.w = q.x, q.y, q.z, q.w
                    store(message, "bench")
                    stored += 1
        self.buffer = buffer
        return {"seconds": time.process_time() - start, "samples": stored}

    def poses_at(self, target: str, source: str, stamps: list[int]) -> list[list[float]]:
        poses = []
        for stamp in stamps:
            time_ = rospy.Time(stamp // 10**9, stamp % 10**9)
            result = self.buffer.lookup_transform(target, source, time_).transform
            t, q = result.translation, result.rotation
            poses.append([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
        return poses
