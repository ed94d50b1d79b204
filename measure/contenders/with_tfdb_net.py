"""Homes and mirrors over Zenoh, beside an empty callback: CPU, latency, and their limits."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import zenoh

import tfdb
from tfdb.net.link import ALL, log_key
from tfdb.net.messages import in_epoch
from tfdb.net.zenoh_link import config_for

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.net.link import Declared

SHARED = "map"
RAW = "tfdb_measure/raw"
SIZE = 900
"""Bytes of a message with one commit of ten."""
STEP = 100_000_000
"""Nanoseconds between the stamps of commits at full speed, as of a view of 10 Hz."""
HISTORY = 10.0


class Contender:
    """Homes, their mirrors, or an empty callback, by which of its methods is called."""

    def __init__(self) -> None:
        self.buffers: list[tfdb.Buffer] = []
        self.homes: list[tfdb.net.Home] = []
        self.mirrors: list[tfdb.net.Mirror] = []
        self.messages: list[list[bytes]] = []
        self.flooding: threading.Thread | None = None
        self.stamp = 0
        self.sessions = ExitStack()
        self.delays: list[float] = []

    # -- homes -------------------------------------------------------------------------------------

    def publish(self, endpoint: str, count: int, edges: int, max_delay: float = 0.002) -> None:
        """Be so many homes, each with a commit of so many edges, and the router of all."""
        self.session = self.sessions.enter_context(tfdb.net.Session(listen=endpoint))
        self.buffers = [tfdb.Buffer(history=HISTORY) for _ in range(count)]
        self.names = [f"frame{number}" for number in range(edges)]
        self.commit()
        self.homes = [
            tfdb.net.publish(each, f"robot{number}", session=self.session, max_delay=max_delay)
            for number, each in enumerate(self.buffers)
        ]
        drop = zenoh.CongestionControl.DROP
        raw = self._open_raw(endpoint)
        self.publisher = raw.declare_publisher(RAW, congestion_control=drop, express=True)

    def commit(self, stamp: int | None = None) -> None:
        """Commit a sample of each edge to each store."""
        self.stamp = time.time_ns() if stamp is None else stamp
        count = len(self.names)
        poses = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (count, 1))
        poses[:, 0] += 1e-9 * (self.stamp % 1_000_000_000)
        stamps = np.full(count, self.stamp)
        columns = tfdb.Columns([SHARED] * count, self.names, stamps, poses)
        for each in self.buffers:
            each.set_transforms(columns)

    def commit_and_put(self) -> None:
        """Commit, and send as many bytes without tfdb."""
        self.commit()
        self.publisher.put(time.time_ns().to_bytes(8, "little").ljust(SIZE, b"x"))

    def fall_silent(self) -> None:
        """Close the homes: from now on `flood` alone sends."""
        for each in self.homes:
            each.close()
        # Not what `Home` uses: a home's messages may be dropped, and each is sent alone.
        self.publishers = [
            self.session.link._data.declare_publisher(
                log_key(f"robot{number}"), congestion_control=zenoh.CongestionControl.BLOCK
            )
            for number in range(len(self.buffers))
        ]

    def prepare(self, messages: int, group: int) -> None:
        """Make the next messages of each home, of so many commits each."""
        self.messages = []
        for _ in range(messages):
            before = [each.commit for each in self.buffers]
            for _ in range(group):
                self.commit(self.stamp + STEP)
            data = [b.commits_bytes(since) for b, since in zip(self.buffers, before, strict=True)]
            homes = zip(data, self.homes, strict=True)
            self.messages.append([in_epoch(each, home.epoch) for each, home in homes])

    def flood(self) -> None:
        """Send these messages as fast as it goes, from now on."""
        self.flooding = threading.Thread(target=self._flood)
        self.flooding.start()

    def _flood(self) -> None:
        for messages in self.messages:
            for publisher, data in zip(self.publishers, messages, strict=True):
                publisher.put(data)

    def flooded(self) -> int:
        """Wait until all is sent, and return the last commit."""
        if self.flooding is not None:
            self.flooding.join()
        return self.buffers[0].commit

    def publish_shared(self, endpoint: str, name: str) -> None:
        """Be the home of a shared store."""
        self.session = self.sessions.enter_context(tfdb.net.Session(listen=endpoint))
        self.buffers = [tfdb.Buffer.open(name, create=True, size=1 << 28)]
        self.homes = [tfdb.net.publish(self.buffers[0], "robot0", session=self.session)]

    def sent(self) -> int:
        """The commits that the home has sent."""
        return self.homes[0].stats.commits

    def write(self, name: str, seconds: float) -> float:
        """Write to a shared store at full speed; return the commits per second."""
        self.buffers = [tfdb.Buffer.open(name)]
        self.names = [f"frame{number}" for number in range(10)]
        begin, before = time.perf_counter(), self.buffers[0].commit
        while time.perf_counter() - begin < seconds:
            self.commit(self.stamp + STEP)
        return (self.buffers[0].commit - before) / (time.perf_counter() - begin)

    def publish_large(self, endpoint: str, frames: int, samples: int) -> None:
        """Be the home of many frames."""
        self.publish(endpoint, 1, frames)
        for _ in range(samples - 1):
            self.commit()

    def leave(self) -> None:
        """Close all."""
        for each in (*self.mirrors, *self.homes):
            each.close()
        self.sessions.close()

    def unlink(self, name: str) -> None:
        """Remove the shared store."""
        tfdb.Buffer.unlink(name)

    # -- mirrors -----------------------------------------------------------------------------------

    def mirror(self, endpoint: str, count: int) -> None:
        """Mirror so many homes into one store."""
        self.session = self.sessions.enter_context(tfdb.net.Session(connect=endpoint))
        self.buffers = [tfdb.Buffer(history=HISTORY)]
        for number in range(count):
            name = f"robot{number}"
            options = {"prefix": f"{name}/", "shared": SHARED} if count > 1 else {}
            made = tfdb.net.mirror(name, into=self.buffers[0], session=self.session, **options)
            self.mirrors.append(made)
        for each in self.mirrors:
            each.wait_until_live(120.0)

    def used_by_mirrors(self, seconds: float) -> tuple[float, float]:
        """Percent of a core that this process uses, and the commits that it applies a second."""
        before = sum(each.stats.commits for each in self.mirrors)
        begin = time.perf_counter()
        percent = self.used(seconds)
        commits = sum(each.stats.commits for each in self.mirrors) - before
        return percent, commits / (time.perf_counter() - begin)

    def threads(self) -> int:
        """The threads of this process."""
        return len(list(Path("/proc/self/task").iterdir()))

    def position(self, mirror: tfdb.net.Mirror) -> int:
        """The commits that a mirror has applied."""
        return mirror.position.commit if mirror.position else 0

    def catch(self, last: int) -> float:
        """Wait until each mirror is at that commit; return how many commits came per second."""
        before = [self.position(each) for each in self.mirrors]
        while self.position(self.mirrors[0]) == before[0]:
            time.sleep(0.001)
        begin = time.perf_counter()
        for each in self.mirrors:
            while self.position(each) < last:
                time.sleep(0.001)
        commits = last * len(before) - sum(before)
        return commits / (time.perf_counter() - begin)

    def join(self, endpoint: str) -> float:
        """Mirror one home into a new store; return the seconds until it is live."""
        with tfdb.net.Session(connect=endpoint) as session:
            begin = time.perf_counter()
            with tfdb.net.mirror("robot0", into=tfdb.Buffer(), session=session) as made:
                made.wait_until_live(60.0)
                return time.perf_counter() - begin

    def find(self, endpoint: str, count: int) -> float:
        """Open a session; return the seconds until it knows so many homes."""
        begin = time.perf_counter()
        with tfdb.net.Session(connect=endpoint) as session:
            while len(session.link.tokens(ALL)) < count:
                pass
            return time.perf_counter() - begin

    # -- beside an empty callback ------------------------------------------------------------------

    def hear(self, endpoint: str, key: str) -> None:
        """Be an empty callback, on a home's log or on the raw bytes."""
        raw = self._open_raw(endpoint)
        heard = self._note_raw if key == RAW else lambda _sample: None
        self.subscriber = raw.declare_subscriber(key, heard)

    def _open_raw(self, endpoint: str) -> zenoh.Session:
        raw = zenoh.open(config_for("client", [endpoint], []))
        self.sessions.callback(raw.close)
        return raw

    def _note_raw(self, sample: zenoh.Sample) -> None:
        sent = int.from_bytes(sample.payload.to_bytes()[:8], "little")
        self.delays.append(1e-6 * (time.time_ns() - sent))

    def mirror_and_note(self, endpoint: str) -> None:
        """Be a mirror; note how long each commit took until it was visible here."""
        self.session = self.sessions.enter_context(tfdb.net.Session(connect=endpoint))
        link = self.session.link
        hear = link.hear

        def hear_and_note(name: str, take: Callable[[bytes], None]) -> Declared:
            def noted(data: bytes) -> None:
                take(data)
                self._note()

            return hear(name, noted)

        link.hear = hear_and_note  # type: ignore[method-assign]
        self.buffers = [tfdb.Buffer()]
        self.mirrors = [tfdb.net.mirror("robot0", into=self.buffers[0], session=self.session)]
        self.mirrors[0].wait_until_live(10.0)
        self.delays.clear()

    def _note(self) -> None:
        now = time.time_ns()
        info = self.buffers[0].frame_info("frame0") if self.buffers[0].commit else None
        if info is not None and info.newest is not None and info.newest != self.stamp:
            self.stamp = info.newest
            self.delays.append(1e-6 * (now - info.newest))

    def delays_ms(self) -> list[float]:
        """The delays so far."""
        return self.delays

    def used(self, seconds: float) -> float:
        """Percent of a core that this process uses."""
        begin, before = time.perf_counter(), time.process_time()
        time.sleep(seconds)
        return 100 * (time.process_time() - before) / (time.perf_counter() - begin)
