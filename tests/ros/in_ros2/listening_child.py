"""A process that ends while its listener has messages: `listening_child.py HOW`."""

from __future__ import annotations

import sys
import threading
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException

from ros.in_ros2.graph import as_bytes
from tfdb.ros.rclpy_node import RclpyNode

how = sys.argv[1]
rclpy.init()
node = rclpy.create_node("child")
ours = RclpyNode(node, own_thread=True)
publisher = ours.advertise("/tf", "tf2_msgs/TFMessage")
came = threading.Event()


def on_message(data: bytes | memoryview, _: str) -> None:
    """Publish the next message for each one, so messages never end."""
    publisher.publish(bytes(data))
    came.set()


ours.subscribe("/tf", "tf2_msgs/TFMessage", on_message)
while not came.wait(0.01):
    publisher.publish(as_bytes(1))
if how == "raises":
    print("listening", flush=True)
    raise ArithmeticError("the user's mistake")
ended = threading.Event()
ours.on_clock(lambda now: ended.set())
try:
    print("listening", flush=True)
    if how == "sys.exit":
        sys.exit(3)
    if how == "interrupted":
        rclpy.spin(node)
    if how == "kept":
        # No thread spins or shuts down: only the signal ends the listener.
        ended.wait(20)
except (KeyboardInterrupt, ExternalShutdownException):
    if how == "interrupted":
        # rclpy's thread of signals may shut the context down at the same moment.
        with suppress(RuntimeError):
            rclpy.try_shutdown()
    ended.wait(20)
print("closed", ours.closed)
