"""Readers and writers in processes of their own share one store for long: what they did is judged.

    python -m tests.isolation.long_run --seconds 60 --readers 8 --writers 2

One round after another, each with a new store and a seed of its own, which is printed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from tfdb_measure.verify import check

from .engines import record

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb_measure.verify import Transaction


def span(operations: Sequence[Transaction]) -> float:
    """Seconds from the begin of the first operation to the end of the last."""
    return (max(one.end for one in operations) - min(one.begin for one in operations)) / 1e9


def main() -> int:
    """Run until the time is up, or a history is not strictly serializable."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="how long the processes work")
    parser.add_argument("--readers", type=int, default=8)
    parser.add_argument("--writers", type=int, default=2)
    parser.add_argument("--operations", type=int, default=4000, help="of each process, in a round")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    total: Counter[str] = Counter()
    worked = 0.0
    rounds = 0
    with tempfile.TemporaryDirectory() as folder:
        while worked < given.seconds:
            history = record(
                Path(folder),
                processes=given.readers + given.writers,
                writers=given.writers,
                operations=given.operations,
                seed=given.seed + rounds,
            )
            # The first operation is made before the others begin.
            worked += span(history.transactions[1:])
            verdict = check(history)
            if verdict.serializable is not True:
                print(f"seed {given.seed + rounds}: {verdict}")
                return 1
            rounds += 1
            total.update(verdict.counts)
    counted = ", ".join(f"{number:,} {what}" for what, number in sorted(total.items()))
    print(f"{rounds} rounds, {worked:.0f} s of work, strictly serializable: {counted}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
