"""A home and its mirrors over Zenoh, beside an empty callback: CPU and latency."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

import tfdb
from tfdb.net.zenoh_link import config_for

FRAMES = [f"frame{i:02d}" for i in range(10)]
RAW = "tfdb_measure/raw"
SIZE = 900
"""Bytes of a message with one commit of ten."""


class Noting(tfdb.Buffer):
    """A mirror's store that notes when each commit became visible, and how old it then was."""

    delays: list[float] | None = None

    def apply(self, data: bytes, **options: Any) -> tfdb.types.Position:
        """Apply commits; from now on every lookup sees them."""
        position = super().apply(data, **options)
        now = time.time_ns()
        if self.delays is not None:
            newest = self.frame_info(FRAMES[-1]).newest
            self.delays.append(1e-6 * (now - (newest or 0)))
        return position


class Contender:
    """A home, a mirror, or an empty callback, by which of its methods is called."""

    def __init__(self) -> None:
        self.buffer = Noting()
        self.raw: zenoh.Session | None = None
        self.delays: list[float] = []
        self.fleet: list[tfdb.Buffer] = []
        self.mirrors: list[tfdb.net.Mirror] = []

    def publish(self, endpoint: str, max_delay: float) -> None:
        """Be the home, and the router of all."""
        self.session = tfdb.net.Session(listen=endpoint)
        self.home = tfdb.net.publish(
            self.buffer, "robot1", session=self.session, max_delay=max_delay
        )
        self.raw = zenoh.open(config_for("client", [endpoint], []))
        drop = zenoh.CongestionControl.DROP
        self.publisher = self.raw.declare_publisher(RAW, congestion_control=drop, express=True)
        self.rows = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (10, 1))

    def commit(self) -> None:
        """Commit ten transforms."""
        self.rows[:, 0] += 0.001
        stamps = np.full(10, time.time_ns())
        self.buffer.set_transforms(tfdb.Columns(["map"] * 10, FRAMES, stamps, self.rows))

    def commit_and_put(self) -> None:
        """Commit, and send as many bytes without tfdb."""
        self.commit()
        self.publisher.put(time.time_ns().to_bytes(8, "little").ljust(SIZE, b"x"))

    def mirror(self, endpoint: str) -> None:
        """Be a mirror."""
        self.session = tfdb.net.Session(connect=endpoint)
        self.following = tfdb.net.mirror("robot1", into=self.buffer, session=self.session)
        self.following.wait_until_live(10.0)

    def publish_fleet(self, endpoint: str, count: int) -> None:
        """Be many homes, and the router of all."""
        self.session = tfdb.net.Session(listen=endpoint)
        self.fleet = [tfdb.Buffer() for _ in range(count)]
        self.homes = [
            tfdb.net.publish(each, f"robot{number}", session=self.session)
            for number, each in enumerate(self.fleet)
        ]
        self.rows = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (10, 1))

    def commit_fleet(self) -> None:
        """Commit ten transforms to the store of each home."""
        self.rows[:, 0] += 0.001
        stamps = np.full(10, time.time_ns())
        for each in self.fleet:
            each.set_transforms(tfdb.Columns(["map"] * 10, FRAMES, stamps, self.rows))

    def mirror_fleet(self, endpoint: str, count: int) -> None:
        """Mirror many homes into one store."""
        self.session = tfdb.net.Session(connect=endpoint)
        for number in range(count):
            name = f"robot{number}"
            options = {"prefix": f"{name}/", "shared": "map", "session": self.session}
            self.mirrors.append(tfdb.net.mirror(name, into=self.buffer, **options))
        for each in self.mirrors:
            each.wait_until_live(60.0)

    def used_by_fleet(self, seconds: float) -> tuple[float, float]:
        """Percent of a core that this process uses, and the commits that it applies a second."""
        before = sum(each.stats.commits for each in self.mirrors)
        begin = time.perf_counter()
        percent = self.used(seconds)
        commits = sum(each.stats.commits for each in self.mirrors) - before
        return percent, commits / (time.perf_counter() - begin)

    def threads(self) -> int:
        """The threads of this process."""
        return len(list(Path("/proc/self/task").iterdir()))

    def hear(self, endpoint: str, key: str) -> None:
        """Be an empty callback, on the home's log or on the raw bytes."""
        self.raw = zenoh.open(config_for("client", [endpoint], []))
        heard = self._note if key == RAW else lambda _sample: None
        self.subscriber = self.raw.declare_subscriber(key, heard)

    def _note(self, sample: zenoh.Sample) -> None:
        sent = int.from_bytes(sample.payload.to_bytes()[:8], "little")
        self.delays.append(1e-6 * (time.time_ns() - sent))

    def watch(self) -> None:
        """Note from now on how long each commit took until it was visible here."""
        self.buffer.delays = self.delays

    def delays_ms(self) -> list[float]:
        """The delays so far."""
        return self.delays

    def leave(self) -> None:
        """Let the process end."""
        if self.raw is not None:
            self.raw.close()

    def used(self, seconds: float) -> float:
        """Percent of a core that this process uses."""
        begin, before = time.perf_counter(), time.process_time()
        time.sleep(seconds)
        return 100 * (time.process_time() - before) / (time.perf_counter() - begin)
