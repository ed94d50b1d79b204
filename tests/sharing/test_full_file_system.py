"""A store on a full file system raises typed errors and never ends the process (SIGBUS)."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb

from .all_reads import TURN

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

ROWS = 500
POSES = np.tile([1.0, 2.0, 3.0, *TURN], (ROWS, 1))


@contextmanager
def small_file_system(folder: Path, kib: int) -> Iterator[Path]:
    """Mount one that holds so much; the test is skipped where that is not allowed."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", str(folder)]
    mounted = os.geteuid() == 0 and subprocess.run(command, check=False).returncode == 0
    if not mounted:
        pytest.skip("no small file system can be mounted: only root may, where the machine lets it")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def fill_up(folder: Path) -> Path:
    """Leave not a page of room there."""
    path = folder / "filler"
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(b"x" * 4096)
        except OSError:
            return path


def apart(work: Callable[[], None]) -> int | None:
    """Run in a process of its own, and give its exit code."""
    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    process.join(60)
    return process.exitcode


def until_full(step: Callable[[int], object]) -> int:
    """Call `step(0)`, `step(1)`, ... until the file system is full; how often it went well."""
    for number in range(10**6):
        try:
            step(number)
        except tfdb.errors.CapacityExceeded as error:
            assert "No space left" in str(error)
            return number
    pytest.fail("there was room for everything")


def write_on(buffer: tfdb.Buffer, number: int) -> None:
    stamps = np.arange(ROWS, dtype=np.int64) + ROWS * number
    buffer.set_transforms(tfdb.Columns("map", "base", stamps, POSES))


def read_all(buffer: tfdb.Buffer, rows: int) -> None:
    """Look at all that a store shows, also behind what it holds."""
    assert len(buffer.samples("base")[0]) == rows
    assert buffer.lookup_transform("map", "base").stamp == rows - 1
    assert buffer.frames() == ["base", "map"]
    assert sum(info.samples for info in buffer.tree()) == rows
    assert buffer.memory().samples == rows
    assert len(buffer.changes(buffer.commit - 1)) == 1
    with buffer.snapshot() as state:
        assert state.lookup_transform("map", "base").stamp == rows - 1
    with pytest.raises(tfdb.UnknownFrame):
        buffer.lookup_transform("map", "none")


@pytest.mark.parametrize("kib", [0, 64, 300])
def test_a_full_file_system_refuses_a_new_store(tmp_path: Path, kib: int) -> None:
    with small_file_system(tmp_path / "full", 400) as folder:
        filler = fill_up(folder)
        os.truncate(filler, filler.stat().st_size - kib * 1024)

        def make() -> None:
            with pytest.raises(tfdb.errors.CapacityExceeded, match="No space left"):
                tfdb.Buffer.open(folder / "store", max_frames=1000)

        assert apart(make) == 0
        assert [path.name for path in folder.iterdir()] == ["filler"]


def test_a_store_that_cannot_grow_keeps_its_data(tmp_path: Path) -> None:
    with small_file_system(tmp_path / "full", 4096) as folder:

        def grow() -> None:
            ballast = folder / "ballast"
            ballast.write_bytes(bytes(600 << 10))
            buffer = tfdb.Buffer.open(folder / "store", history=None, max_frames=10_000)
            number = until_full(lambda number: write_on(buffer, number))
            assert number > 10
            fill_up(folder)
            for reads in (buffer, tfdb.Buffer.open(folder / "store", mode="r")):
                read_all(reads, ROWS * number)
            write = buffer.set_transform
            made = until_full(lambda n: write("map", f"frame{n}", 5, (1, 2, 3), TURN))
            buffer.remove_frames([f"frame{n}" for n in range(made)])
            until_full(lambda n: write("map", "base", 10**6 + n, (1, 2, 3), TURN))
            again = buffer.lookup_transform("map", "base").stamp
            ballast.unlink()
            write("map", "base", again + 1, (1, 2, 3), TURN)
            assert buffer.lookup_transform("map", "base").stamp == again + 1

        assert apart(grow) == 0


def test_returned_memory_is_used_by_others_and_again(tmp_path: Path) -> None:
    with small_file_system(tmp_path / "full", 16384) as folder:

        def fill_and_empty() -> None:
            path = folder / "store"
            buffer = tfdb.Buffer.open(path, history=None, max_frames=1000)
            reads = tfdb.Buffer.open(path, mode="r")
            buffer.set_transform("map", "arm", 7, (3, 2, 1), TURN)
            number = until_full(lambda number: write_on(buffer, number))
            held = buffer.snapshot()
            buffer.remove_frames("base")
            assert not buffer.compact()
            assert len(held.samples("base")[0]) == ROWS * number
            held.close()
            taken = path.stat().st_blocks * 512
            assert buffer.compact()
            kept = path.stat().st_blocks * 512
            assert taken - kept > 8 << 20
            assert buffer.compact()
            assert path.stat().st_blocks * 512 <= kept

            filler = fill_up(folder)
            rows = ROWS * until_full(lambda n: write_on(buffer, n))
            assert buffer.compact()
            for buf in (buffer, reads):
                assert buf.lookup_transform("map", "arm").stamp == 7
                if rows:
                    assert len(buf.samples("base")[0]) == rows
            filler.unlink()
            again = until_full(lambda n: write_on(buffer, n + 10**6))
            assert again + rows // ROWS > number * 3 // 4
            assert len(reads.samples("base")[0]) == rows + ROWS * again
            assert reads.lookup_transform("map", "arm").stamp == 7

        assert apart(fill_and_empty) == 0


def test_readers_that_come_to_a_full_file_system(tmp_path: Path) -> None:
    with small_file_system(tmp_path / "full", 4096) as folder:
        path = folder / "store"
        with_store = tfdb.Buffer.open(path, history=None, max_frames=10_000)
        write_on(with_store, 0)
        fill_up(folder)

        def read() -> None:
            read_all(tfdb.Buffer.open(path, mode="r"), ROWS)

        assert [apart(read) for _ in range(3)] == [0, 0, 0]
        del with_store


def test_a_file_system_other_than_shm(tmp_path: Path) -> None:
    with small_file_system(tmp_path / "other", 8192) as folder:
        path = folder / "store"
        buffer = tfdb.Buffer.open(path)
        write_on(buffer, 0)
        read_all(tfdb.Buffer.open(path, mode="r"), ROWS)
        tfdb.Buffer.unlink(path)
        assert not list(folder.iterdir())
        read_all(buffer, ROWS)
        del buffer
