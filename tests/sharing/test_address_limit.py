"""Limited addresses (`ulimit -v`): stores take fewer, or the error names a remedy."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

LIMITED = """
import resource, sys
import tfdb
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
bound = used + (int(sys.argv[1]) << 20)
resource.setrlimit(resource.RLIMIT_AS, (bound, bound))
try:
    store = eval(sys.argv[2])
except tfdb.errors.CapacityExceeded as error:
    print("refused:", error)
else:
    store.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8)) if not store.frozen else None
    print(store.lookup_transform("map", "base", 5).translation.tolist())
"""


def limited(mebibytes: int, made: str) -> str:
    command = [sys.executable, "-c", LIMITED, str(mebibytes), made]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_store_takes_the_addresses_that_it_gets() -> None:
    assert limited(700, "tfdb.Buffer()") == "[1.0, 2.0, 3.0]"


@pytest.mark.parametrize("made", ["tfdb.Buffer()", "tfdb.Buffer(memory_limit=64 << 20)"])
def test_the_error_for_too_few_addresses_names_remedies(made: str) -> None:
    assert limited(100, made) == (
        "refused: cannot reserve 256 MiB of addresses for a store: raise the process's limit of "
        "addresses (ulimit -v), or close other stores"
    )


def test_a_shared_store_needs_addresses_for_its_size(name: str) -> None:
    made = f"tfdb.Buffer.open({name!r}, size={{}})"
    said = limited(500, made.format(1 << 30))
    assert said.startswith("refused: cannot map 1073741824 bytes of ")
    assert "it needs 1073741824 bytes of addresses" in said
    assert "raise the process's limit of addresses (ulimit -v)" in said
    assert limited(1500, made.format(64 << 20)) == "[1.0, 2.0, 3.0]"


def test_a_frozen_file_needs_addresses_for_its_size(tmp_path: Path) -> None:
    store = tfdb.Buffer()
    store.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    store.freeze(tmp_path / "a.tfdb")
    made = f"tfdb.open({str(tmp_path / 'a.tfdb')!r})"
    assert "needs 1073840128 bytes of addresses" in limited(700, made)
    assert limited(1500, made) == "[1.0, 2.0, 3.0]"
