"""What a process does at a steady rate, in a thread, and what that costs the process."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


class Paced:
    """Does `work` so many times a second until it is ended; what came late is made up for."""

    def __init__(self, work: Callable[[], object], rate: float) -> None:
        self._work, self._period, self._done = work, 1.0 / rate, 0
        self._error: Exception | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._began, self._used = time.perf_counter(), time.process_time()
        self._thread.start()

    def end(self) -> dict[str, float]:
        """Times a second that it was done, and CPU of the whole process in percent of a core."""
        seconds = time.perf_counter() - self._began
        used = time.process_time() - self._used
        done = self._done
        self._ending.set()
        self._thread.join()
        if self._error is not None:
            raise self._error
        return {"per_s": done / seconds, "cpu": 100 * used / seconds}

    def _run(self) -> None:
        due = time.perf_counter()
        try:
            while not self._ending.is_set():
                self._work()
                self._done += 1
                due += self._period
                time.sleep(max(0.0, due - time.perf_counter()))
        except Exception as error:  # raised again where it is ended
            self._error = error
