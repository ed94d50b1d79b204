"""Converts a ROS 1 bag of TFMessages to an MCAP file in the ROS 2 flavour (CDR, zstd chunks).

    python make_example_recording_convert.py IN.bag OUT.mcap

Stamps, both of the messages and of their reception, stay those of the recording.
"""

from __future__ import annotations

import sys
from pathlib import Path

from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
STATIC_QOS = """\
- history: 3
  depth: 0
  reliability: 1
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
TRANSIENT_LOCAL, VOLATILE = 1, 2


def convert(source: str, destination: str) -> None:
    """Writes every message of the bag `source` to the MCAP file `destination`."""
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    ros2 = get_typestore(Stores.ROS2_JAZZY)
    definition = "geometry_msgs/TransformStamped[] transforms"
    ros1.register(get_types_from_msg(definition, TF_MESSAGE))
    types = ros2.types
    with Reader(source) as bag, Path(destination).open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="rosbags and mcap")
        text, _ = ros2.generate_msgdef(TF_MESSAGE, ros_version=2)
        schema = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", text.encode())
        channels: dict[str, int] = {}
        for sequence, (connection, received, raw) in enumerate(bag.messages()):
            topic = connection.topic
            if topic not in channels:
                durability = TRANSIENT_LOCAL if topic == "/tf_static" else VOLATILE
                qos = STATIC_QOS.format(durability=durability)
                metadata = {"offered_qos_profiles": qos}
                channels[topic] = writer.register_channel(topic, "cdr", schema, metadata)
            message = upgrade(ros1.deserialize_ros1(raw, TF_MESSAGE), types)
            cdr = ros2.serialize_cdr(message, TF_MESSAGE)
            writer.add_message(channels[topic], received, bytes(cdr), received, sequence)
        writer.finish()


def upgrade(message: object, types: dict[str, type]) -> object:
    """The same TFMessage in ROS 2's classes: the header there has no sequence number."""
    header, stamped = types["std_msgs/msg/Header"], types["geometry_msgs/msg/TransformStamped"]
    return types[TF_MESSAGE](
        transforms=[
            stamped(
                header=header(stamp=t.header.stamp, frame_id=t.header.frame_id),
                child_frame_id=t.child_frame_id,
                transform=t.transform,
            )
            for t in message.transforms  # type: ignore[attr-defined]
        ]
    )


if __name__ == "__main__":
    convert(sys.argv[1], sys.argv[2])
