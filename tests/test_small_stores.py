"""Memory use of small private stores."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

STORES = 1_000
MOST_BYTES = 100 << 10  # of a store with one sample
LARGE = 400_000  # samples: about 30 MB

PROGRAM = """
import sys
import numpy as np
import tfdb

TURN = (0, 0, 0.6, 0.8)

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096

def made(samples):
    buffer = tfdb.Buffer(None)
    if samples == 1:
        buffer.set_transform("map", "base", 5, (1, 2, 3), TURN)
        assert buffer.lookup_transform("base", "map").stamp == 5
    elif samples:
        poses = np.tile(np.array([1.0, 2, 3, *TURN]), (samples, 1))
        buffer.set_transforms(tfdb.Columns("map", "base", np.arange(samples), poses))
    return buffer

first = made(1)
before = resident()
stores = [made(int(sys.argv[2])) for _ in range(int(sys.argv[1]))]
print((resident() - before) // len(stores))
# Of each mapping of a store: how much of it is resident, and what was asked for it.
kept = 0
for line in open("/proc/self/smaps"):
    key, _, value = line.partition(":")
    if key == "Rss":
        kept = int(value.split()[0]) * 1024
    elif key == "VmFlags" and kept >= 1 << 20:
        print(kept, *value.split())
"""


def measured(stores: int, samples: int) -> tuple[int, list[list[str]]]:
    """Bytes that each of so many stores takes, and the large mappings of their process."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(stores), str(samples)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    each, *mappings = done.stdout.splitlines()
    return int(each), [mapping.split() for mapping in mappings]


linux = pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="Linux tells it so")


@linux
@pytest.mark.parametrize("samples", [0, 1])
def test_thousands_of_small_stores_take_little_memory(samples: int) -> None:
    each, _ = measured(STORES, samples)
    assert each < MOST_BYTES


@linux
def test_a_large_store_asks_for_huge_pages() -> None:
    if not Path("/sys/kernel/mm/transparent_hugepage").exists():
        pytest.skip("this kernel has no huge pages")
    each, mappings = measured(1, LARGE)
    samples = max(mappings, key=lambda mapping: int(mapping[0]))
    assert int(samples[0]) > each // 2
    assert "hg" in samples
