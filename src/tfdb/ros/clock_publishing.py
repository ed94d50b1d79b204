"""The clock of a store on /clock of a graph."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from tfdb.data.closable import Closable
from tfdb.data.decimal_time import NS_PER_SECOND
from tfdb.data.errors import NodeClosed

from .clock_messages import CLOCK, CLOCK_KIND, encode_clock
from .loop import LOG

if TYPE_CHECKING:
    from tfdb._core import Clock

    from .node import Node

__all__ = ["ClockPublisher"]

_SECONDS = 1 << 31  # of ROS 2


class ClockPublisher(Closable):
    """Publishes a store's clock on /clock while a player sets it. Use it in a `with` block.

    Times before 1970 or after 2038 are not published, because ROS 2 cannot express them.

    Parameters
    ----------
    node
        A node of the graph.
    clock
        The store's clock.
    rate
        Messages per second.
    """

    def __init__(self, node: Node, clock: Clock, rate: float) -> None:
        self._clock, self._pause = clock, 1 / rate
        self._is_cdr = node.encoding == "cdr"
        self._publisher = node.advertise(CLOCK, CLOCK_KIND, depth=1)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="tfdb clock", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop publishing. A second call does nothing."""
        self._ended.set()
        self._thread.join()
        self._publisher.close()

    def _run(self) -> None:
        while not self._ended.wait(self._pause):
            if self._clock.is_system:
                continue
            now = self._clock.now()
            if not 0 <= now < _SECONDS * NS_PER_SECOND:
                continue
            try:
                self._publisher.publish(encode_clock(now, cdr=self._is_cdr))
            except NodeClosed as error:
                LOG.warning("/clock stops: %s", error)
                return
