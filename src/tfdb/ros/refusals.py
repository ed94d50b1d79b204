"""Messages of a graph that do not have the wanted type."""

from __future__ import annotations

import threading

from .loop import LOG

__all__ = ["Refusals"]

_MOST_TOLD = 1000


class Refusals:
    """Counts messages that a node refuses, and logs each reason once. Threads: any."""

    def __init__(self) -> None:
        self.count: int = 0
        self._lock = threading.Lock()
        self._told: set[tuple[str, str]] = set()

    def add(self, topic: str, source: str, why: str) -> None:
        """Count a message of `source`, and log it once."""
        with self._lock:
            self.count += 1
            if (source, why) in self._told or len(self._told) >= _MOST_TOLD:
                return
            self._told.add((source, why))
        LOG.warning("ignored a message on %s (%s): %s; logged once", topic, source, why)
