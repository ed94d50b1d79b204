"""A node of rclpy that publishes on /tf, as bytes: what listens is measured, and not this."""

from __future__ import annotations

import atexit
import struct
import time

import rclpy
import scenario
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import serialize_message
from tf2_calls import message
from tf2_msgs.msg import TFMessage

MARK = 0x12345678  # stands for the seconds of each stamp, and is nowhere else


class Contender:
    """A node."""

    def make(self, chain: int) -> None:
        """Become a node that publishes messages of so many edges."""
        rclpy.init()
        atexit.register(rclpy.shutdown)
        self.node = rclpy.create_node("robot")
        self.publisher = self.node.create_publisher(TFMessage, "/tf", 100)
        names = scenario.names(chain)
        sent = TFMessage()
        for edge in range(chain):
            stamp = rclpy.time.Time(seconds=MARK, nanoseconds=edge).to_msg()
            pose = scenario.moving_pose(edge, 0.5)
            sent.transforms.append(message(TransformStamped, *names[edge : edge + 2], stamp, pose))
        self.data = bytearray(serialize_message(sent))
        self.places = [self.data.index(struct.pack("<iI", MARK, edge)) for edge in range(chain)]

    def write_each(self) -> None:
        """One message with a sample of each edge, stamped with the time of day."""
        stamp = struct.pack("<iI", *divmod(time.time_ns(), 10**9))
        for place in self.places:
            self.data[place : place + 8] = stamp
        self.publisher.publish(bytes(self.data))
