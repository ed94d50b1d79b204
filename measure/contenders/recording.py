"""Makes the recording of the loading rows: many messages of ten transforms, in three containers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import scenario
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

EDGES = 10
PERIOD = 10_000_000  # 100 Hz
TYPE = "tf2_msgs/msg/TFMessage"
DEFINITION = "geometry_msgs/TransformStamped[] transforms"


def frames() -> list[str]:
    """The chain's frames, the root first; names as long as a robot's."""
    return ["base_footprint", *(f"left_arm_{i}_joint_link" for i in range(1, EDGES + 1))]


def messages(count: int) -> Iterator[tuple[int, list[scenario.Pose]]]:
    """Stamp and poses of each message."""
    for i in range(count):
        t = 1e-2 * i
        poses = [scenario.moving_pose(edge, t) for edge in range(EDGES)]
        yield scenario.START + i * PERIOD, poses


def ros1_bytes(stamp: int, poses: list[scenario.Pose], names: list[bytes]) -> bytes:
    """The message in ROS 1's serialization: nothing is aligned, strings have a length."""
    parts = [struct.pack("<I", len(poses))]
    for edge, pose in enumerate(poses):
        parent, child = names[edge], names[edge + 1]
        parts.append(struct.pack("<IIII", 0, stamp // 10**9, stamp % 10**9, len(parent)))
        parts.append(parent)
        parts.append(struct.pack("<I", len(child)))
        parts.append(child)
        parts.append(struct.pack("<7d", *pose))
    return b"".join(parts)


def cdr_bytes(stamp: int, poses: list[scenario.Pose], names: list[bytes]) -> bytes:
    """The message in CDR, little endian: fields aligned to their size, strings end with NUL."""
    out = bytearray(struct.pack("<I", len(poses)))
    for edge, pose in enumerate(poses):
        out += struct.pack("<iI", stamp // 10**9, stamp % 10**9)
        for name in (names[edge], names[edge + 1]):
            out += bytes(-len(out) % 4) + struct.pack("<I", len(name) + 1) + name + b"\0"
        out += bytes(-len(out) % 8) + struct.pack("<7d", *pose)
    return b"\x00\x01\x00\x00" + bytes(out)


Encoder = Callable[[int, list[scenario.Pose], list[bytes]], bytes]


def encoded(count: int, encode: Encoder) -> Iterator[tuple[int, bytes]]:
    """Stamp and bytes of each message."""
    names = [name.encode() for name in frames()]
    for stamp, poses in messages(count):
        yield stamp, encode(stamp, poses, names)


def write_mcap(path: Path, count: int, compression: CompressionType) -> None:
    """An MCAP file in the ROS 2 profile."""
    text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(TYPE, ros_version=2)
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start(profile="ros2", library="tfdb benchmarks")
        schema = writer.register_schema(TYPE, "ros2msg", text.encode())
        channel = writer.register_channel("/tf", "cdr", schema)
        for stamp, data in encoded(count, cdr_bytes):
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()


def write_bag(path: Path, count: int) -> None:
    """A ROS 1 bag."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(DEFINITION, TYPE))
    with BagWriter(path) as writer:
        connection = writer.add_connection("/tf", TYPE, typestore=store)
        for stamp, data in encoded(count, ros1_bytes):
            writer.write(connection, stamp, data)


def write_db3(folder: Path, count: int) -> None:
    """A ROS 2 bag folder with an SQLite file."""
    with Ros2Writer(folder, version=9) as writer:
        store = get_typestore(Stores.ROS2_JAZZY)
        connection = writer.add_connection("/tf", TYPE, typestore=store)
        for stamp, data in encoded(count, cdr_bytes):
            writer.write(connection, stamp, data)


def make(folder: Path, count: int) -> dict[str, Path]:
    """All containers, by their names in the tables."""
    paths = {
        "mcap": folder / "plain.mcap",
        "mcap, zstd": folder / "zstd.mcap",
        "bag": folder / "long.bag",
        "db3": folder / "long_db3",
    }
    write_mcap(paths["mcap"], count, CompressionType.NONE)
    write_mcap(paths["mcap, zstd"], count, CompressionType.ZSTD)
    write_bag(paths["bag"], count)
    write_db3(paths["db3"], count)
    return paths


if __name__ == "__main__":
    import sys

    if sys.argv[1] == "--mcap":
        write_mcap(Path(sys.argv[2]), int(sys.argv[3]), CompressionType.NONE)
    else:
        make(Path(sys.argv[1]), int(sys.argv[2]))
