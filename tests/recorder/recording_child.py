"""Records a store that it writes to, and prints each commit that is flushed: `PATH SEED`."""

from __future__ import annotations

import random
import sys

import tfdb
from tests.test_changes import pose


def main(path: str, seed: int) -> None:
    """Run until it is killed."""
    rng = random.Random(seed)
    buf = tfdb.Buffer(history=1.0)
    with tfdb.Recorder(buf, path, flush=rng.choice([0, 0.005, 60.0])) as recorder:
        stamp = 0
        while True:
            for _ in range(rng.randrange(1, 300)):
                stamp += 1
                authority = rng.choice(["", "", "slam"])
                buf.set_transform("map", "base", stamp, *pose(stamp), authority=authority)
            print(recorder.flush(), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
