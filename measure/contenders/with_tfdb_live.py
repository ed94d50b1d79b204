"""tfdb's listener in a live graph of ROS 1: in a node of its own, without any package of ROS."""

from __future__ import annotations

import os
import time

from live import Waits

import tfdb
from tfdb import tf2
from tfdb.ros.tcpros_node import TcprosNode
from tfdb.tf2 import msgs


class Contender(Waits):
    """A node that listens."""

    def join(self, uri: str) -> None:
        """Become a node of that master."""
        os.environ |= {"ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1"}
        self.node = TcprosNode(arguments=[])

    def listen(self, target: str, source: str) -> None:
        """Subscribe; return when lookups are answered."""
        self.buffer = tf2.Buffer(flavor="ros1", debug=False)
        self.listener = tf2.TransformListener(self.buffer, self.node)
        while not self.buffer.can_transform(target, source, 0):
            time.sleep(0.01)

    def listen_into(self, store: str, target: str, source: str) -> None:
        """Subscribe for all processes that share a store; return when lookups are answered."""
        self.attach(store, target, source)
        self.listener = tf2.TransformListener(self.buffer, self.node)
        while not self.buffer.can_transform(target, source, 0):
            time.sleep(0.01)

    def attach(self, store: str, target: str, source: str) -> None:
        """Use the store that another process fills."""
        self.buffer = tf2.Buffer(store=store, flavor="ros1", debug=False)
        self.ends = target, source

    def detach(self, store: str) -> None:
        """Remove the store."""
        tfdb.Buffer.unlink(store)

    def look_up(self) -> None:
        self.buffer.lookup_transform(*self.ends, 0)

    def received(self) -> int:
        """Messages since it listens."""
        return self.buffer.buffer.commit

    def wait_at(self, stamp: int) -> None:
        """Wait for the first edge's transform at a stamp."""
        self.buffer.lookup_transform("frame_0", "frame_1", stamp, 1.0)

    def newest(self) -> int:
        """Newest stamp of the first edge."""
        return self.buffer.buffer.latest_common_time("frame_0", "frame_1")

    def futures(self, count: int) -> dict[str, list[float]]:
        """What futures that wait cost a write of other frames, us, and all of them ended, ms."""
        unrelated, ended = [], []
        for _ in range(7):
            buffer = tf2.Buffer(flavor="ros1", debug=False)
            for stamp in (1, 2):
                self.write(buffer, "wheel", stamp)
            self.write(buffer, "base", 1)
            waits = [
                buffer.wait_for_transform_async("map", "base", msgs.Time(2)) for _ in range(count)
            ]
            began = time.perf_counter()
            for stamp in range(3, 103):
                self.write(buffer, "wheel", stamp)
            unrelated.append(1e4 * (time.perf_counter() - began))
            began = time.perf_counter()
            self.write(buffer, "base", 3)
            waits[-1].result(60.0)  # they end as they were begun
            ended.append(1e3 * (time.perf_counter() - began))
            if not all(wait.done() for wait in waits):
                raise RuntimeError("the last one has its result before another")
            buffer.close()
        return {"unrelated": unrelated, "ended": ended}

    def write(self, buffer: tf2.Buffer, child: str, stamp: int) -> None:
        """Store T[map<-child] at so many seconds."""
        header = msgs.Header(msgs.Time(stamp), "map")
        buffer.set_transform(msgs.TransformStamped(header, child), "measure")

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()
