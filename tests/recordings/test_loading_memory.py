"""After a load its memory is returned to the system."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

MESSAGES, EDGES = 1500, 10
TYPE = "tf2_msgs/msg/TFMessage"
# Allowed bytes in addition to the store; all messages together have three times as many.
BOUND = 10_000_000
CHILD = """
import sys
from pathlib import Path
import tfdb

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

held = []

def keep(done, total):
    if len(held) < 2 and done >= 0.3 * total:
        held.append(bytearray(60_000))

buffer = tfdb.load(sys.argv[1])  # what is imported and allocated once
del buffer
before = resident()
buffer = tfdb.load(sys.argv[1], progress=keep)
assert held
print(resident() - before - buffer.memory().used_bytes)
"""


def payload(stamp: int, encoding: str) -> bytes:
    """Make a message with long names, which is far larger than its samples in the store."""
    names = [f"{i}".rjust(1000, "x") for i in range(EDGES + 1)]
    pose = (1, 2, 3), (0, 0.6, 0, -0.8)
    return tfdb.encode_tf_message(
        [tfdb.TransformStamped(names[i], names[i + 1], stamp, *pose) for i in range(EDGES)],
        encoding,
    )


@pytest.mark.parametrize("container", ["bag", "sqlite3", "mcap"])
def test_nothing_of_the_messages_stays(tmp_path: Path, recorder: Any, container: str) -> None:
    path = tmp_path / "a"
    writer: Any
    if container == "bag":
        writer, encoding, store = BagWriter(path), "ros1", recorder.ros1
    else:
        plugin = StoragePlugin[container.upper()]
        writer, encoding = Ros2Writer(path, version=9, storage_plugin=plugin), "cdr"
        store = recorder.ros2
    with writer:
        topic = writer.add_connection("/tf", TYPE, typestore=store)
        for stamp in range(1, MESSAGES + 1):
            writer.write(topic, stamp, payload(stamp, encoding))
    told = subprocess.run(
        [sys.executable, "-c", CHILD, path], check=True, capture_output=True, text=True
    )
    print(told.stdout)
    assert int(told.stdout) < BOUND


PEAK = r"""
import re, sys, tfdb
from pathlib import Path
assert tfdb.Buffer(history=1.0).load(sys.argv[1]).forgotten > 0
# Of this program alone: getrusage starts with the peak of its parent.
print(1024 * int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]))
"""


def peak_of_a_limited_load(path: Path, messages: int) -> int:
    pose = (1, 2, 3), (0, 0.6, 0, -0.8)
    with tfdb.recordings.RecordingWriter(path) as writer:
        for stamp in range(1, messages + 1):
            now = stamp * 20_000_000
            members = [tfdb.TransformStamped("map", f"f{i}", now, *pose) for i in range(EDGES)]
            writer.write(tfdb.encode_tf_message(members, writer.encoding), now, topic="/tf")
    command = [sys.executable, "-W", "ignore", "-c", PEAK, path]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def test_a_limited_history_takes_the_same_memory_for_a_longer_recording(tmp_path: Path) -> None:
    short = peak_of_a_limited_load(tmp_path / "short.mcap", 2_000)
    long = peak_of_a_limited_load(tmp_path / "long.mcap", 22_000)  # 15 MB of samples more
    assert long - short < BOUND
