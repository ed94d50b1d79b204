"""/clock of `tfdb play`: its bytes as rosbags reads them, and on graphs."""

from __future__ import annotations

import queue
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

import tfdb
from ros.commands import Command, tfdb_says
from tfdb.ros.clock_messages import encode_clock
from tfdb.ros.open_node import open_node
from tfdb.store.shared import find_stores

S = 10**9
CLOCK = "rosgraph_msgs/msg/Clock"
BAG = Path(__file__).parents[2] / "examples" / "data" / "pr2.bag"


def decoded(data: bytes, *, cdr: bool) -> int:
    if cdr:
        found: Any = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(data, CLOCK)
    else:
        found = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1(data, CLOCK)
    stamp: int = found.clock.sec * S + found.clock.nanosec
    return stamp


@pytest.mark.parametrize("cdr", [False, True], ids=["ros1", "cdr"])
@pytest.mark.parametrize("stamp", [0, 1_700_000_000 * S + 5, 2**31 * S - 1])
def test_the_bytes_are_read_by_rosbags(stamp: int, cdr: bool) -> None:
    assert decoded(encode_clock(stamp, cdr=cdr), cdr=cdr) == stamp


def test_play_publishes_the_clock(ros1: str, name: str) -> None:
    """It also publishes while it is paused, and never the system's time."""
    heard: queue.Queue[int] = queue.Queue()
    with open_node("ros1", "listener") as node:
        node.subscribe(
            "/clock",
            "rosgraph_msgs/Clock",
            lambda data, _: heard.put(decoded(bytes(data), cdr=False)),
        )
        arguments = ("play", BAG, "--into", name, "--paused", "--clock", "ros1:")
        with Command(*arguments, "--clock-rate", "100") as playing:
            first = heard.get(timeout=30)
            assert heard.get(timeout=30) == first
            clock = tfdb.Buffer.open(name).clock
            assert clock.now() == first
            clock.resume()
            until = time.monotonic() + 30
            while heard.get(timeout=30) < first + S // 10:
                assert time.monotonic() < until, (clock.now(), first)
            assert playing.end(signal.SIGINT)[0] == 130
        span = tfdb.load(BAG).tree()
        newest = max(each.newest for each in span if each.newest is not None)
        while not heard.empty():
            assert first <= heard.get_nowait() <= newest + S


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--clock", "robot.mcap"), "'robot.mcap' is not a graph"),
        (("--clock", "ros1:", "--speed", "inf"), "--clock needs a finite --speed"),
        (("--clock", "ros1:http://127.0.0.1:1"), "no ROS master"),
    ],
)
def test_an_impossible_clock_is_refused(name: str, options: tuple[str, ...], text: str) -> None:
    assert text in tfdb_says("play", BAG, "--into", name, *options, code=2)
    assert name not in find_stores()
