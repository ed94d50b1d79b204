"""A program of PyPI's zenoh-ros2-sdk: prints received messages, sends its input."""

from __future__ import annotations

import json
import sys
import threading
from typing import Any

from zenoh_ros2_sdk.publisher import ROS2Publisher
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.subscriber import ROS2Subscriber

TYPES = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\nTransform transform"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}
TF = "tf2_msgs/msg/TFMessage"
LATCHED = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1)
printing = threading.Lock()


def main(port: int, domain: int, type_hash: str) -> None:
    session = ZenohSession.get_instance("127.0.0.1", port)
    types = {name: session.register_message_type(text, name) for name, text in TYPES.items()}

    def of(name: str, *values: Any) -> Any:
        return types[name](*values)

    def made(child: str, x: float, stamp: int) -> Any:
        time = of("builtin_interfaces/msg/Time", 5, stamp)
        moved = of("geometry_msgs/msg/Vector3", x, 2.0, -3.0)
        turned = of("geometry_msgs/msg/Quaternion", 0.6, 0.0, 0.0, 0.8)
        return of(
            "geometry_msgs/msg/TransformStamped",
            of("std_msgs/msg/Header", time, "map"),
            child,
            of("geometry_msgs/msg/Transform", moved, turned),
        )

    def show(topic: str, message: Any) -> None:
        with printing:
            found = [
                [one.child_frame_id, one.transform.translation.x] for one in message.transforms
            ]
            print(json.dumps([topic, found]), flush=True)

    common: dict[str, Any] = {
        "msg_type": TF,
        "msg_definition": TYPES[TF],
        "type_hash": type_hash,
        "domain_id": domain,
        "router_port": port,
        "node_name": "sdk",
    }
    publishers = {}
    for topic, qos in (("/tf", None), ("/tf_static", LATCHED)):
        ROS2Subscriber(topic, callback=lambda got, on=topic: show(on, got), qos=qos, **common)
        publishers[topic] = ROS2Publisher(topic, qos=qos, **common)
    for line in sys.stdin:
        topic, child, x = json.loads(line)
        publishers[topic].publish(transforms=[made(child, float(x), x)])


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
