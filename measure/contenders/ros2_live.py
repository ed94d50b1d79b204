"""What every process does that listens to /tf in ROS 2, whoever takes the messages."""

from __future__ import annotations

import atexit
import statistics
import threading
import time
from abc import abstractmethod

import rclpy
from live import Listens
from rclpy.executors import SingleThreadedExecutor


class ListensInRos2(Listens):
    """A node that listens, and knows how late each message was when it was stored."""

    def join(self, way: str) -> None:
        """Become a node; `way` says how it is to listen."""
        rclpy.init()
        self.way = way
        self.node = rclpy.create_node("listener")
        self.late: list[int] = []
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        ended = threading.Event()

        def spin() -> None:
            while not ended.is_set():
                executor.spin_once()

        def end() -> None:
            ended.set()
            executor.create_task(lambda: None)
            thread.join()
            rclpy.shutdown()

        thread = threading.Thread(target=spin, daemon=True)
        thread.start()
        atexit.register(end)

    def stored(self, stamp: int) -> None:
        """Say that the message of this stamp is stored."""
        self.late.append(time.time_ns() - stamp)

    def listen(self, target: str, source: str) -> None:
        """Subscribe; return when messages come."""
        del target, source
        self.late.clear()
        self.begin()
        while not self.late:
            time.sleep(0.01)

    @abstractmethod
    def begin(self) -> None:
        """Subscribe."""

    def received(self) -> int:
        """Messages since it listens."""
        return len(self.late)

    def cost(self, seconds: float) -> dict[str, float]:
        """The cost, with the delays from publishing to being stored in milliseconds."""
        self.late.clear()
        found = super().cost(seconds)
        cuts = statistics.quantiles(self.late, n=100)
        return {**found, "p50": 1e-6 * cuts[49], "p99": 1e-6 * cuts[98]}
