"""Contenders in processes of their own, taken in turns."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from collections.abc import Mapping

CONTENDERS = Path(__file__).resolve().parents[1] / "contenders"
TOLERANCE = 1e-12

Rounds = dict[str, list[float]]
"""Values of each contender, one for each round."""


class Worker:
    """A running worker.py; see there for the requests."""

    def __init__(
        self, contender: str, python: Path, environment: Mapping[str, str] = os.environ
    ) -> None:
        # Nothing that differs from run to run: no hash salt, one thread for numpy.
        environment = {**environment, "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
        self.contender = contender
        self._process = subprocess.Popen(
            [python, CONTENDERS / "worker.py", contender],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("a worker without pipes")
        self._in, self._out = self._process.stdin, self._process.stdout

    def ask(self, **request: Any) -> Any:
        """Send one request and return the answer."""
        self._in.write(json.dumps(request) + "\n")
        self._in.flush()
        line = self._out.readline()
        if not line:
            raise RuntimeError(f"the worker of {self.contender} ended")
        return json.loads(line)

    def call(self, function: str, *arguments: Any) -> Any:
        """Call a method of the contender's."""
        return self.ask(do="call", function=function, arguments=arguments)

    def begin(self, function: str, per_s: float) -> None:
        """Have a method of the contender's called so many times a second from now on."""
        self.ask(do="begin", function=function, per_s=per_s)

    def end(self) -> dict[str, float]:
        """End that: times a second that it was done, and CPU in percent of a core."""
        found: dict[str, float] = self.ask(do="end")
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        self._in.close()
        self._process.wait(timeout=60)


Turn = tuple[str, Worker, str]
"""A contender's title, its process, the operation."""


def process_output(command: list[str]) -> str:
    """Run a process to its end and return what it printed."""
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def difference(a: list[float], b: list[float]) -> float:
    """How far two poses are apart: relative to large translations; q and -q are the same."""
    scale = max(1.0, *(abs(x) for x in b[:3]))
    dot = sum(x * y for x, y in zip(a[3:], b[3:], strict=True))
    sign = math.copysign(1.0, dot)
    translation = max(abs(x - y) for x, y in zip(a[:3], b[:3], strict=True)) / scale
    return max(translation, *(abs(x - sign * y) for x, y in zip(a[3:], b[3:], strict=True)))


def compare_poses(
    ours: list[list[float]], theirs: list[list[float]], what: str, tolerance: float = TOLERANCE
) -> None:
    """Ends the run if the answers differ: a time counts for the same result only."""
    worst = max(difference(a, b) for a, b in zip(ours, theirs, strict=True))
    if not worst <= tolerance:
        sys.exit(f"{what}: answers differ by {worst:g}")


def calibrate(worker: Worker, operation: str, seconds: float) -> int:
    """How many operations take about `seconds`; the loops run in steps of 1,024."""
    count = 1_024
    while True:
        result = worker.ask(do="time", operation=operation, count=count)
        took = 1e-9 * result["ns"] * result["count"]
        if took > 0.3 * seconds or result["count"] > count:
            steps: int = round(seconds / took * result["count"] / 1_024)
            return 1_024 * max(1, steps)
        count *= 2


def interleave(turns: list[Turn], rounds: int, seconds: float = 0.05) -> Rounds:
    """Nanoseconds per operation of each (title, worker, operation), A B A B ..."""
    counts = [calibrate(worker, operation, seconds) for _, worker, operation in turns]
    times: Rounds = {title: [] for title, _, _ in turns}
    for _ in range(rounds):
        for (title, worker, operation), count in zip(turns, counts, strict=True):
            result = worker.ask(do="time", operation=operation, count=count)
            times[title].append(result["ns"])
    return times
