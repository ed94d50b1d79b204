"""/diagnostics of `tfdb watch`: its bytes as rosbags reads them, and on a graph of ROS 1."""

from __future__ import annotations

import queue
import signal
from typing import TYPE_CHECKING, Any

import pytest
from rosbags.typesys import Stores, get_typestore

from ros.commands import Command, tfdb_says
from tfdb.ros.diagnostics import DiagnosticStatus, encode_diagnostics
from tfdb.ros.open_node import open_node

if TYPE_CHECKING:
    from pathlib import Path

S = 10**9
ARRAY = "diagnostic_msgs/msg/DiagnosticArray"


def decoded(data: bytes, *, cdr: bool) -> Any:
    if cdr:
        return get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(data, ARRAY)
    return get_typestore(Stores.ROS1_NOETIC).deserialize_ros1(data, ARRAY)


@pytest.mark.parametrize("cdr", [False, True], ids=["ros1", "cdr"])
def test_the_bytes_are_read_by_rosbags(cdr: bool) -> None:
    given = [
        DiagnosticStatus("warning", "tfdb: \u00e9", "late 1 s", {"late": "12", "step": "3"}),
        DiagnosticStatus("stale", "tfdb: odom -> base", ""),
    ]
    found = decoded(encode_diagnostics(1_700_000_000 * S + 5, given, cdr=cdr), cdr=cdr)
    assert (found.header.stamp.sec, found.header.stamp.nanosec) == (1_700_000_000, 5)
    one, other = found.status
    assert (one.level, one.name, one.message) == (1, "tfdb: \u00e9", "late 1 s")
    assert {each.key: each.value for each in one.values} == {"late": "12", "step": "3"}
    assert (other.level, other.message, other.hardware_id) == (3, "", "tfdb")
    assert list(decoded(encode_diagnostics(0, [], cdr=cdr), cdr=cdr).status) == []


@pytest.mark.parametrize(
    ("stamp", "cdr", "expected"),
    [
        ((1 << 31) * S - 1, True, ((1 << 31) - 1, S - 1)),
        ((1 << 31) * S, True, ((1 << 31) - 1, S - 1)),
        ((1 << 61) - 1, True, ((1 << 31) - 1, S - 1)),
        ((1 << 61) - 1, False, divmod((1 << 61) - 1, S)),
        ((1 << 63) - 1, False, ((1 << 32) - 1, S - 1)),
        (-1, True, (0, 0)),
        (-1, False, (0, 0)),
    ],
)
def test_a_stamp_outside_the_range_becomes_the_nearest_one(
    stamp: int, cdr: bool, expected: tuple[int, int]
) -> None:
    found = decoded(encode_diagnostics(stamp, [], cdr=cdr), cdr=cdr)
    time = found.header.stamp
    seconds = time.sec if cdr else time.sec % (1 << 32)  # rosbags reads those of ROS 1 as signed
    assert (seconds, time.nanosec) == expected


def test_watch_publishes_diagnostics(ros1: str, tmp_path: Path) -> None:
    file = tmp_path / "e.toml"
    file.write_text('version = 1\n[[edge]]\nparent = "odom"\nchild = "base"\n')
    heard: queue.Queue[Any] = queue.Queue()
    with open_node("ros1", "listener") as node:
        node.subscribe(
            "/diagnostics",
            "diagnostic_msgs/DiagnosticArray",
            lambda data, _: heard.put(decoded(bytes(data), cdr=False)),
        )
        with Command("watch", "ros1:", "--expect", file, "--diagnostics") as watching:
            while len((found := heard.get(timeout=20)).status) < 2:
                assert (found.status[0].level, found.status[0].message) == (0, "OK")
            assert watching.end(signal.SIGINT)[0] == 130
    whole, edge = found.status
    assert (whole.level, whole.name, whole.message) == (2, "tfdb: expectations", "1 broken")
    assert (edge.level, edge.name) == (2, "tfdb: odom -> base")
    assert edge.message == "missing 1 s (limit 1 s)"
    assert [(each.key, each.value) for each in edge.values] == [("missing", "1")]


def test_diagnostics_need_a_graph(tmp_path: Path) -> None:
    arguments = ("watch", "shm:x", "--expect", tmp_path / "e.toml", "--diagnostics")
    assert "needs ros1: or ros2:" in tfdb_says(*arguments, code=2)
