"""What a process costs that only listens."""

from __future__ import annotations

import time


class Listens:
    """A contender that listens, and does nothing else."""

    def received(self) -> int:
        """Messages since it listens."""
        raise NotImplementedError

    def cost(self, seconds: float) -> dict[str, float]:
        """CPU of the process in percent of a core, and messages per second."""
        began, used, before = time.perf_counter(), time.process_time(), self.received()
        time.sleep(seconds)
        received = self.received() - before
        used = time.process_time() - used
        took = time.perf_counter() - began
        return {"cpu": 100 * used / took, "per_s": received / took}
