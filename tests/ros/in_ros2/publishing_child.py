"""A process that publishes message N on /tf until it is killed: `publishing_child.py N`."""

from __future__ import annotations

import sys

import rclpy
from tf2_msgs.msg import TFMessage

from ros.in_ros2.graph import message

rclpy.init()
node = rclpy.create_node("child")
publisher = node.create_publisher(TFMessage, "/tf", 10)
sent = message(int(sys.argv[1]))
node.create_timer(0.01, lambda: publisher.publish(sent))
rclpy.spin(node)
