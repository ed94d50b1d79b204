"""A ROS node that waits for transforms that never come: `waiting_child.py SIDE MAIN`.

The main thread waits in the way MAIN, and one thread in each other way. It prints "waits", then the
end of each wait as JSON. Timeouts are minutes, so a signal must end the waits.
"""

from __future__ import annotations

import asyncio
import json
import sys
import threading
from contextlib import suppress

side, main = sys.argv[1:]
LONG = 600

if side == "ros1":
    sys.path.append("/usr/lib/python3/dist-packages")
    import rospy

    from tfdb import tf2
    from tfdb.tf2 import tf1

    rospy.init_node("waits")
    now, limit = rospy.Time(0), rospy.Duration(LONG)
    buffer = tf2.Buffer()
    listener = tf2.TransformListener(buffer)
else:
    import rclpy
    from rclpy.duration import Duration
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.time import Time

    from tfdb import tf2
    from tfdb.tf2 import tf1

    rclpy.init()
    node = rclpy.create_node("waits")
    now, limit = Time(), Duration(seconds=LONG)
    buffer = tf2.Buffer(node=node)
    if side == "ros2 spinning":
        listener = tf2.TransformListener(buffer, node, spin_thread=True)
    else:
        listener = tf2.TransformListener(buffer, node)

        def spin() -> None:
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            with suppress(ExternalShutdownException):
                while rclpy.ok():  # rclpy's own `spin` may sleep through a signal
                    executor.spin_once(timeout_sec=0.1)

        threading.Thread(target=spin).start()

store = buffer.buffer
simple = ("map", "base", now)
full = ("map", now, "base", now, "odom")


client = tf2.BufferClient("nobody") if side == "ros1" else tf2.BufferClient(node, "nobody")
older = tf1.TransformListener(node=None if side == "ros1" else node)

WAITS = {
    "lookup": lambda: buffer.lookup_transform(*simple, limit),
    "lookup_full": lambda: buffer.lookup_transform_full(*full, limit),
    "can": lambda: buffer.can_transform(*simple, limit, True),
    "can_full": lambda: buffer.can_transform_full(*full, limit),
    "future": lambda: asyncio.run(buffer.lookup_transform_async(*simple)),
    "wait_for": lambda: buffer.wait_for_transform(*simple),
    "store": lambda: store.wait_for_transform("map", "base"),
    "store_commit": lambda: store.wait_for_commit(store.commit),
    "store_async": lambda: asyncio.run(store.wait_for_transform_async("map", "base")),
    "store_commit_async": lambda: asyncio.run(store.wait_for_commit_async(store.commit)),
    "client": lambda: client.lookup_transform(*simple, limit),
    "tf1": lambda: older.waitForTransform(*simple, limit),
}

ends: dict[str, str] = {}


def wait(how: str) -> None:
    """Wait in one way, and store how the wait ended."""
    try:
        ends[how] = f"returned {WAITS[how]()}"
    except Exception as error:
        ends[how] = f"{type(error).__name__} {error}"


threads = [threading.Thread(target=wait, args=(how,)) for how in WAITS if how != main]
for each in threads:
    each.start()
print("waits", flush=True)
wait(main)
for each in threads:
    each.join()
print(json.dumps(ends), flush=True)
if side != "ros1":
    rclpy.try_shutdown()
