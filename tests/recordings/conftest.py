"""Recordings that the third-party library rosbags writes and serializes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
)
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
OLD_TF_MESSAGE = "tf/msg/tfMessage"
TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"


@dataclass
class Message:
    """A message to record: transforms are (parent, child, stamp, pose)."""

    topic: str
    received: int
    transforms: Sequence[tuple[str, str, int, Sequence[float]]]
    callerid: str | None = None


@dataclass
class Recorder:
    """Writes recordings in each container, serialized by rosbags."""

    ros1: Any = field(default_factory=lambda: get_typestore(Stores.ROS1_NOETIC))
    ros2: Any = field(default_factory=lambda: get_typestore(Stores.ROS2_JAZZY))

    def __post_init__(self) -> None:
        for name in (TF_MESSAGE, OLD_TF_MESSAGE):
            self.ros1.register(get_types_from_msg(TRANSFORMS, name))

    def encode(self, message: Message, encoding: str) -> bytes:
        """Payload of a message, `ros1` or `cdr`."""
        store = self.ros1 if encoding == "ros1" else self.ros2
        types = store.types
        stamped = []
        for parent, child, stamp, pose in message.transforms:
            time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            sequence = {"seq": 0} if encoding == "ros1" else {}
            header = types["std_msgs/msg/Header"](stamp=time, frame_id=parent, **sequence)
            x, y, z, qx, qy, qz, qw = map(float, pose)
            transform = types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                rotation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
            )
            stamped.append(
                types["geometry_msgs/msg/TransformStamped"](
                    header=header, child_frame_id=child, transform=transform
                )
            )
        whole = types[TF_MESSAGE](transforms=stamped)
        if encoding == "ros1":
            return bytes(store.serialize_ros1(whole, TF_MESSAGE))
        return bytes(store.serialize_cdr(whole, TF_MESSAGE))

    def bag(
        self,
        path: Path,
        messages: Iterable[Message],
        compression: str | None = None,
        type_name: str = TF_MESSAGE,
    ) -> Path:
        """A ROS 1 bag; `compression` is `bz2` or `lz4`."""
        writer = BagWriter(path)
        writer.chunk_threshold = 4096
        if compression is not None:
            writer.set_compression(BagWriter.CompressionFormat[compression.upper()])
        connections: dict[Any, Any] = {}
        with writer:
            for message in messages:
                key = message.topic, message.callerid
                if key not in connections:
                    connections[key] = writer.add_connection(
                        message.topic, type_name, typestore=self.ros1, callerid=message.callerid
                    )
                writer.write(connections[key], message.received, self.encode(message, "ros1"))
        return path

    def folder(
        self,
        path: Path,
        messages: Iterable[Message],
        plugin: str = "mcap",
        mode: str = "none",
    ) -> Path:
        """A ROS 2 bag folder; `mode` is `none`, `file`, `message` or (MCAP) `storage`."""
        writer = Ros2Writer(path, version=9, storage_plugin=StoragePlugin[plugin.upper()])
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
        connections: dict[str, Any] = {}
        with writer:
            for message in messages:
                if message.topic not in connections:
                    connections[message.topic] = writer.add_connection(
                        message.topic, TF_MESSAGE, typestore=self.ros2
                    )
                data = self.encode(message, "cdr")
                writer.write(connections[message.topic], message.received, data)
        return path


@pytest.fixture(scope="session")
def recorder() -> Recorder:
    return Recorder()


def drive(count: int = 300) -> list[Message]:
    """A robot with two publishers; static transforms are recorded in the middle of the drive."""
    rng = np.random.default_rng(11)
    messages = []
    for index in range(count):
        received = 1_700_000_000_000_000_000 + index * 10_000_000
        poses = rng.normal(size=(3, 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        base = ("odom", "base", received - 5, poses[0])
        arm = [("base", "arm", received - 3, poses[1]), ("arm", "hand", received - 3, poses[2])]
        messages.append(Message("/tf", received, [base], "/odometry"))
        messages.append(Message("/tf", received + 7, arm, "/joints"))
        if index == count // 2:
            fixed = [("base", "camera", 0, (0.1, 0.2, 0.3, 0, 0, 0.6, 0.8))]
            messages.append(Message("/tf_static", received + 8, fixed, "/model"))
    return messages


@pytest.fixture(scope="session")
def messages() -> list[Message]:
    return drive()
