"""Lookups per second of one and two Python threads on one store: what the GIL costs, or does not.

Run it with any Python that has tfdb installed; without a GIL the second thread counts.
"""

from __future__ import annotations

import itertools
import statistics
import sys
import threading
import time

import tfdb

SECOND = 1_000_000_000
LOOKUPS = 200_000
REPEATS = 7


def chain(depth: int) -> tuple[tfdb.Buffer, list[str]]:
    """Return a store with `depth` moving edges of 100 samples at 100 Hz, and its frames."""
    buffer = tfdb.Buffer(history=None)
    names = [f"frame{index}" for index in range(depth + 1)]
    for sample in range(100):
        for parent, child in itertools.pairwise(names):
            stamp = SECOND + sample * SECOND // 100
            buffer.set_transform(parent, child, stamp, (sample, 1.0, -2.0), (0.1, 0.2, 0.3, 0.927))
    return buffer, names


def rate(buffer: tfdb.Buffer, target: str, source: str, threads: int) -> float:
    """Return lookups per second of all threads together."""
    barrier = threading.Barrier(threads + 1)
    stamp = SECOND + 985 * SECOND // 1000

    def work() -> None:
        lookup = buffer.lookup_transform
        barrier.wait()
        for _ in range(LOOKUPS):
            lookup(target, source, stamp)

    workers = [threading.Thread(target=work) for _ in range(threads)]
    for worker in workers:
        worker.start()
    barrier.wait()
    start = time.perf_counter()
    for worker in workers:
        worker.join()
    return threads * LOOKUPS / (time.perf_counter() - start)


def main() -> None:
    """Print a row per chain: one thread, two threads, their ratio."""
    gil = getattr(sys, "_is_gil_enabled", lambda: True)()
    print(f"Python {sys.version.split()[0]}, GIL {'on' if gil else 'off'}, median of {REPEATS}")
    for depth in (1, 4, 10):
        buffer, names = chain(depth)
        ends = names[0], names[-1]
        pairs = [(rate(buffer, *ends, 1), rate(buffer, *ends, 2)) for _ in range(REPEATS)]
        one = statistics.median(pair[0] for pair in pairs)
        two = statistics.median(pair[1] for pair in pairs)
        ratio = statistics.median(pair[1] / pair[0] for pair in pairs)
        print(f"chain of {depth:2}: {one / 1e6:5.2f} M/s, {two / 1e6:5.2f} M/s, x {ratio:.2f}")


if __name__ == "__main__":
    main()
