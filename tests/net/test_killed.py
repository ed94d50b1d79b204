"""The processes of a home and a mirror are killed repeatedly, while a third one reads."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress

import tfdb
from tests.net.conftest import LONGEST, free_endpoint, needs_zenoh
from tests.recorder.reading import state_of

pytestmark = needs_zenoh
CYCLES = int(os.environ.get("TFDB_NET_CYCLES", "6"))

HOME = """
import sys, time, tfdb
store, endpoint = sys.argv[1:]
buf = tfdb.Buffer.open(store, size=1 << 25)
with tfdb.net.Session(connect=endpoint) as session:
    with tfdb.net.publish(buf, "robot1", session=session, take_over=True):
        print("ready", flush=True)
        while True:
            number = buf.commit + 1
            pair = [("base", number), ("arm", -number)]
            still = (0.0, 0.0, 0.0, 1.0)
            buf.set_transforms(
                [tfdb.TransformStamped("map", name, number, (x, 1, 2), still) for name, x in pair]
            )
            time.sleep(0.001)
"""
MIRROR = """
import sys, time, tfdb
store, endpoint = sys.argv[1:]
buf = tfdb.Buffer.open(store, size=1 << 25)
with tfdb.net.Session(connect=endpoint) as session:
    with tfdb.net.mirror("robot1", into=buf, session=session):
        print("ready", flush=True)
        sys.stdin.read()
"""


class Process:
    """One of the two programs."""

    def __init__(self, code: str, store: str, endpoint: str) -> None:
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        command = [sys.executable, "-c", code, store, endpoint]
        self.process = subprocess.Popen(command, text=True, **pipes)  # type: ignore[call-overload]
        assert self.process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        """Kill it."""
        self.process.send_signal(signal.SIGKILL)
        self.process.communicate(timeout=LONGEST)


def read(copy: tfdb.Buffer, until: float, last: int) -> tuple[int, int]:
    """Check states: commits are whole, and states never go back. Returns the last one and the
    count.
    """
    seen = 0
    while time.monotonic() < until:
        with copy.snapshot() as snap:
            if not snap.frame_exists("arm"):
                continue
            stamps, poses = snap.samples("base")[:2]
            others = snap.samples("arm")[1]
        number = int(poses[-1][0])
        assert stamps[-1] == number == -int(others[-1][0])
        assert number >= last
        seen += number > last
        last = number
    return last, seen


def test_kills_tear_nothing_and_nothing_goes_back(names: tuple[str, str]) -> None:
    draw = random.Random(7)
    endpoint = free_endpoint()
    last = seen = 0
    with tfdb.net.Session(listen=endpoint) as session:
        home, mirror = Process(HOME, names[0], endpoint), Process(MIRROR, names[1], endpoint)
        try:
            copy = tfdb.Buffer.open(names[1], mode="r")
            for cycle in range(CYCLES):
                last, more = read(copy, time.monotonic() + draw.uniform(0.2, 0.6), last)
                seen += more
                if cycle % 2:
                    home.kill()
                    home = Process(HOME, names[0], endpoint)
                else:
                    mirror.kill()
                    mirror = Process(MIRROR, names[1], endpoint)
            home.kill()
            with (
                tfdb.Buffer.open(names[0], create=False) as source,
                tfdb.net.publish(source, "robot1", session=session, take_over=True),
            ):
                wait_for_position(copy, source.commit)
                assert state_of(copy) == state_of(source)
        finally:
            for each in (home, mirror):
                each.kill()
    assert seen > 10 * CYCLES


def wait_for_position(copy: tfdb.Buffer, commit: int) -> None:
    """Wait for a commit of the home."""
    until = time.monotonic() + LONGEST
    while copy.positions()[0].commit < commit:
        assert time.monotonic() < until
        with suppress(tfdb.WaitTimeout):
            copy.wait_for_commit(copy.commit, 0.05)
