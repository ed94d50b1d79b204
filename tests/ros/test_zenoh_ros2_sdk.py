"""A bridge and PyPI's zenoh-ros2-sdk, a separate implementation of rmw_zenoh's messages.

Its publishers are not latched: the bridge must listen before its static transform is sent.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import tfdb
from ros.hearing import LIMIT, S
from ros.routers import free_endpoint, overriding, router_at
from ros.test_bridge import fix, move

pytestmark = pytest.mark.skipif(
    not importlib.util.find_spec("zenoh_ros2_sdk") and "CI" not in os.environ,
    reason="zenoh-ros2-sdk is not installed",
)
CHILD = Path(__file__).with_name("sdk_child.py")
COUNT = 50


def test_both_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    from tfdb.bridge import Bridge
    from tfdb.ros import ZenohNode
    from tfdb.ros.ros2_names import kind_of

    endpoint, store = free_endpoint(), tfdb.Buffer(history=None)
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overriding(endpoint))
    monkeypatch.delenv("ZENOH_SESSION_CONFIG_URI", raising=False)
    fix(store, "lidar", 1)
    arguments = [endpoint.rpartition(":")[2], "7", kind_of("tf2_msgs/TFMessage").hash]
    with (
        router_at(endpoint),
        ZenohNode("ours", domain=7, arguments=[]) as node,
        Bridge(store, node) as bridge,
        subprocess.Popen(
            [sys.executable, CHILD, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "GIT_PYTHON_REFRESH": "quiet"},  # so that it does not need git
        ) as child,
    ):
        try:
            check_both_ways(child, store)
            assert bridge.stats.received == COUNT + 1
        finally:
            child.kill()


def check_both_ways(child: Any, store: tfdb.Buffer) -> None:
    def heard(topic: str, name: str) -> float:
        """Return the next received transform, except its own."""
        while True:
            line = child.stdout.readline()
            assert line, "the program has ended"
            on, found = json.loads(line)
            (first, x), *_ = found
            if not first.startswith("theirs"):
                assert (on, first) == (topic, name)
                return float(x)

    def tell(topic: str, name: str, x: int) -> None:
        child.stdin.write(json.dumps([topic, name, x]) + "\n")
        child.stdin.flush()

    assert heard("/tf_static", "lidar") == 0.1  # it joins later
    tell("/tf_static", "theirs_fixed", 7)
    store.lookup_transform("map", "theirs_fixed", None, timeout=LIMIT)
    authority = store.frame_info("theirs_fixed").authority.removeprefix("ros2+zenoh:7/")
    assert len(bytes.fromhex(authority)) == 16  # without a token
    for number in range(COUNT):
        tell("/tf", "theirs", number)
        move(store, "ours", number)
    store.lookup_transform("map", "theirs", 5 * S + COUNT - 1, timeout=LIMIT)
    assert len(store.samples("theirs")[0]) == COUNT
    assert [heard("/tf", "ours") for _ in range(COUNT)] == [0.1 * each for each in range(COUNT)]
