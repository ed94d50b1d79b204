"""A robot with one static transform, which runs until its input ends."""

import sys

import rclpy
from geometry_msgs.msg import TransformStamped

from tfdb import tf2

rclpy.init()
node = rclpy.create_node("robot")
placed = TransformStamped()
placed.header.frame_id, placed.child_frame_id = "map", "base_link"
placed.transform.translation.x = 1.25
tf2.StaticTransformBroadcaster(node).sendTransform(placed)
print("here", flush=True)
sys.stdin.read()
rclpy.shutdown()
