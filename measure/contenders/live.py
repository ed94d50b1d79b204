"""What a process costs that only listens."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from pathlib import Path


class Listens(ABC):
    """A contender that listens, and does nothing else."""

    @abstractmethod
    def received(self) -> int:
        """Messages since it listens."""

    def memory(self) -> float:
        """MiB of the process: its share of what it has together with others."""
        for line in Path("/proc/self/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) / 1024
        raise RuntimeError("this kernel does not say what a process has in memory")

    def cost(self, seconds: float) -> dict[str, float]:
        """CPU of the process in percent of a core, and messages per second."""
        began, used, before = time.perf_counter(), time.process_time(), self.received()
        time.sleep(seconds)
        received = self.received() - before
        used = time.process_time() - used
        took = time.perf_counter() - began
        return {"cpu": 100 * used / took, "per_s": received / took}


class Waits(Listens):
    """One that also waits for what it hears of."""

    @abstractmethod
    def wait_at(self, stamp: int) -> None:
        """Wait for the first edge's transform at a stamp."""

    @abstractmethod
    def newest(self) -> int:
        """Newest stamp of the first edge."""

    def delays(self, count: int) -> list[float]:
        """Milliseconds from publishing to the return of a lookup that waited for it."""
        found = []
        for _ in range(count):
            self.wait_at(time.monotonic_ns())
            found.append(1e-6 * (time.monotonic_ns() - self.newest()))
        return found
