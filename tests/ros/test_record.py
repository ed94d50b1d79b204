"""`tfdb record` of a graph of ROS 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import tfdb
from ros.commands import Command
from tfdb.ros.open_node import open_node

if TYPE_CHECKING:
    from pathlib import Path

S = 10**9
STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def count_of(path: Path) -> int:
    """Return the number of samples of the frame base in the file so far."""
    try:
        loaded = tfdb.load(path, salvage=True)
    except tfdb.errors.RecordingError:  # no transform yet
        return 0
    return loaded.frame_info("base").samples


def test_a_graph_is_recorded_with_its_publishers(ros1: str, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    part = tmp_path / "drive.mcap.part"
    with (
        open_node("ros1", "driver") as node,
        Command("record", "ros1:", "-o", path, "--flush", "0.01") as recording,
    ):
        recording.line()
        publisher = node.advertise("/tf", "tf2_msgs/TFMessage")
        stamp = 1_700_000_000 * S
        while count_of(part) < 10:
            stamp += S // 100
            one = tfdb.TransformStamped("map", "base", stamp, *STILL)
            publisher.publish(tfdb.encode_tf_message([one], "ros1"))
        code, _ = recording.end()
    assert code == 0
    copy = tfdb.Buffer(history=None)
    for each in tfdb.recorded_commits(path):
        copy.apply(each.data)
    assert copy.frame_info("base").authority == "/driver"
    assert tfdb.load(path).frame_info("base").samples >= 10
