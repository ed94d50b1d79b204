"""Homes and mirrors over Zenoh at their limits: messages as fast as they come, and late joiners."""

from __future__ import annotations

import threading
import time

import numpy as np
import zenoh

import tfdb
from tfdb.net.link import ALL, log_key
from tfdb.net.messages import in_epoch

SHARED = "map"


class Contender:
    """Homes, or their mirrors, by which of its methods is called."""

    def __init__(self) -> None:
        self.buffers: list[tfdb.Buffer] = []
        self.homes: list[tfdb.net.Home] = []
        self.mirrors: list[tfdb.net.Mirror] = []
        self.messages: list[list[bytes]] = []
        self.flooding: threading.Thread | None = None
        self.stamp = 0

    # -- homes -------------------------------------------------------------------------------------

    def publish(self, endpoint: str, count: int, edges: int) -> None:
        """Be so many homes, each with a commit of so many edges, and the router of all."""
        self.session = tfdb.net.Session(listen=endpoint)
        self.buffers = [tfdb.Buffer() for _ in range(count)]
        self.names = [f"frame{number}" for number in range(edges)]
        self.commit()
        self.homes = [
            tfdb.net.publish(each, f"robot{number}", session=self.session)
            for number, each in enumerate(self.buffers)
        ]

    def commit(self) -> None:
        """Commit a sample of each edge to each store."""
        self.stamp += 10_000_000
        count = len(self.names)
        poses = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (count, 1))
        poses[:, 0] += 1e-9 * self.stamp
        stamps = np.full(count, self.stamp)
        columns = tfdb.Columns([SHARED] * count, self.names, stamps, poses)
        for each in self.buffers:
            each.set_transforms(columns)

    def fall_silent(self) -> None:
        """Close the homes: from now on `flood` alone sends."""
        for each in self.homes:
            each.close()
        # Not what `Home` uses: a home's messages may be dropped, these wait.
        block = zenoh.CongestionControl.BLOCK
        self.publishers = [
            self.session.link._data.declare_publisher(
                log_key(f"robot{number}"), congestion_control=block, express=True
            )
            for number in range(len(self.buffers))
        ]

    def prepare(self, messages: int, group: int) -> None:
        """Make the next messages of each home, of so many commits each."""
        self.messages = []
        for _ in range(messages):
            before = [each.commit for each in self.buffers]
            for _ in range(group):
                self.commit()
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
        self.session = tfdb.net.Session(listen=endpoint)
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
            self.commit()
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
        self.session.close()

    def unlink(self, name: str) -> None:
        """Remove the shared store."""
        tfdb.Buffer.unlink(name)

    # -- mirrors -----------------------------------------------------------------------------------

    def mirror(self, endpoint: str, count: int) -> None:
        """Mirror so many homes into one store."""
        self.session = tfdb.net.Session(connect=endpoint)
        self.buffers = [tfdb.Buffer()]
        for number in range(count):
            name = f"robot{number}"
            options = {"prefix": f"{name}/", "shared": SHARED} if count > 1 else {}
            made = tfdb.net.mirror(name, into=self.buffers[0], session=self.session, **options)
            self.mirrors.append(made)
        for each in self.mirrors:
            each.wait_until_live(120.0)

    def position(self) -> int:
        """The commits that all mirrors have applied."""
        return sum(each.position.commit for each in self.mirrors if each.position)

    def catch(self, last: int) -> float:
        """Wait until each mirror is at that commit; return how many commits came per second."""
        wanted = last * len(self.mirrors)
        at = before = self.position()
        begin = time.perf_counter()
        while at < wanted:
            if at == before:  # nothing has come yet
                begin = time.perf_counter()
            time.sleep(0.001)
            at = self.position()
        return (wanted - before) / (time.perf_counter() - begin)

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
