"""A signal ends a node and all its waits, with the errors of their timeouts."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ros import real_ros1, ros2

CHILD = Path(__file__).with_name("waiting_child.py")
WITHIN = 30.0  # seconds; the timeouts of the child are minutes
NO_MAP = 'LookupException "map" passed to lookupTransform argument target_frame does not exist'
NO_FRAME = "UnknownFrame frame 'map' does not exist in commit 0; waited "
NO_COMMIT = "WaitTimeout no commit followed commit 0; waited "
ENDS = {
    "lookup": NO_MAP,
    "lookup_full": NO_MAP,
    "can": "returned (0, ",
    "can_full": "returned 0",
    "future": NO_MAP,
    "wait_for": "TimeoutException Timed out waiting for transform from base to map at any common",
    "store": NO_FRAME,
    "store_commit": NO_COMMIT,
    "store_async": NO_FRAME,
    "store_commit_async": NO_COMMIT,
    "client": "TimeoutException The ",
    "tf1": "TransformException ",
}
SAID = ("store", "wait_for")  # kinds of waits whose error reports that the node was shut down


def check_ends(sent: signal.Signals, side: str, main: str, environment: dict[str, str]) -> None:
    """Send a signal to a node with all kinds of waits, and check the end of each."""
    with subprocess.Popen(
        [sys.executable, CHILD, side, main],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as child:
        assert child.stdout is not None
        try:
            assert child.stdout.readline() == "waits\n"
            child.send_signal(sent)
            out, err = child.communicate(timeout=WITHIN)
        finally:
            child.kill()
    assert child.returncode == 0, out + err
    ends = json.loads(out)
    assert set(ends) == set(ENDS)
    for how, end in ends.items():
        assert end.startswith(ENDS[how]), (how, end)
        assert ("then its node was shut down" in end) == how.startswith(SAID), (how, end)


@pytest.mark.parametrize(
    ("sent", "main"), [(signal.SIGINT, "lookup"), (signal.SIGTERM, "lookup_full")]
)
def test_rospy(ros1: str, sent: signal.Signals, main: str) -> None:
    check_ends(sent, "ros1", main, real_ros1.environment(ros1))


@pytest.mark.parametrize("side", ["ros2 spinning", "ros2 by an executor"])
def test_rclpy(side: str) -> None:
    check_ends(signal.SIGTERM, side, "store", ros2.environment())
