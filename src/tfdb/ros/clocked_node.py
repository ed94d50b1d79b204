"""The clock of nodes without ROS packages: the system's, or simulated time."""

from __future__ import annotations

import os
import threading
import time
import weakref
from abc import ABC, abstractmethod
from contextlib import ExitStack
from typing import TYPE_CHECKING

from tfdb.data.closable import Closable

from .loop import LOG

if TYPE_CHECKING:
    from collections.abc import Callable

    from .node import Subscription

__all__ = ["ClockedNode", "open_nodes"]


class ClockedNode(Closable, ABC):
    """A node with a clock. Threads: any."""

    def __init__(self, name: str, *, simulated: bool) -> None:
        self.name: str = name
        """Its full name in the graph."""
        self._lock = threading.RLock()
        self._simulated = simulated
        self._now = 0
        self._clock_listeners: list[_ClockListener] = []
        self._process = os.getpid()

    @property
    @abstractmethod
    def closed(self) -> bool:
        """Whether the node has ended."""

    @abstractmethod
    def close(self) -> None:
        """End the node. A second call does nothing."""

    def now(self) -> int:
        """Nanoseconds by the node's clock: the system's, or /clock with `use_sim_time`.

        The latter is 0 before the first message on /clock.
        """
        return self._now if self._simulated else time.time_ns()

    @property
    def simulated(self) -> bool:
        """Whether `now` is simulated time."""
        return self._simulated

    def on_clock(self, called: Callable[[int], None]) -> Subscription:
        """Call `called(now)` whenever simulated time is set, and once when the node ends.

        If the node has already ended, call it at once.
        """
        listener = _ClockListener(self, called)
        with self._lock:
            ended = self.closed
            self._clock_listeners.append(listener)
        if ended:
            called(self.now())
        return listener

    def _set_clock(self, now: int) -> None:
        self._now = now
        self._report_clock()

    def _report_clock(self) -> None:
        with self._lock:
            listeners = list(self._clock_listeners)
        for listener in listeners:
            try:
                listener.called(self.now())
            except Exception:
                LOG.exception("a clock callback of %s failed", self.name)


class _ClockListener:
    """A callback for a new time. Threads: any."""

    native = None

    def __init__(self, node: ClockedNode, called: Callable[[int], None]) -> None:
        self.called = called
        self._node = node

    def close(self) -> None:
        """Stop calling the function."""
        with self._node._lock:
            if self in self._node._clock_listeners:
                self._node._clock_listeners.remove(self)


open_nodes: weakref.WeakSet[ClockedNode] = weakref.WeakSet()
"""The nodes that are closed when the process ends."""
# A child of `fork` has no threads of its parent's nodes, and may find their locks held.
os.register_at_fork(after_in_child=open_nodes.clear)


def _close_all() -> None:
    with ExitStack() as stack:  # it closes all nodes, even if one of them raises
        for node in list(open_nodes):
            stack.callback(node.close)


# A process waits at its end for Python threads, such as those of a node, before `atexit` functions
# run.
threading._register_atexit(_close_all)  # type: ignore[attr-defined]
