"""Reads of a shared store equal those of a private one, in every process."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

import tfdb

from . import child
from .all_reads import RECORDING, TURN, answers, fill


def same(found: dict[str, str], expected: dict[str, str]) -> None:
    assert found.keys() == expected.keys()
    assert {k: v for k, v in found.items() if v != expected[k]} == {}


def private() -> tfdb.Buffer:
    buffer = tfdb.Buffer(history=None)
    fill(buffer)
    return buffer


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_every_way_to_start_a_process(name: str, method: str) -> None:
    expected = answers(private())
    buffer = tfdb.Buffer.open(name, history=None)
    fill(buffer)
    same(answers(buffer), expected)
    same(answers(tfdb.Buffer.open(name, create=False, mode="r")), expected)
    context = multiprocessing.get_context(method)
    here, there = context.Pipe()
    process = context.Process(target=child.exchange, args=(buffer, there))
    process.start()
    found, shared = here.recv()
    process.join()
    assert process.exitcode == 0
    same(found, expected)
    assert shared.path == f"/dev/shm/tfdb.{name}"
    assert shared.mode == "rw"
    assert buffer.frame_info("from_child").authority == "child"
    assert buffer.lookup_transform("map", "from_child", 5).translation.tolist() == [1, 2, 3]
    with buffer.snapshot() as snapshot:
        buffer.set_transform("map", "base", 40, (4, 4, 4), TURN)
        assert snapshot.commit == buffer.commit - 1


def test_a_pool_of_readers(name: str) -> None:
    buffer = tfdb.Buffer.open(name)
    child.move_arm(buffer, 7)
    reader = tfdb.Buffer.open(name, mode="r")
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(2, context) as pool:
        assert list(pool.map(child.read_number, [buffer, reader, buffer])) == [7, 7, 7]


def test_recordings_are_loaded_alike(name: str) -> None:
    buffer = tfdb.Buffer.open(name, history=None)
    report = buffer.load(RECORDING)
    expected = tfdb.load(RECORDING)
    assert report.refused == 0
    assert buffer.tree() == expected.tree()
    for info in expected.tree():
        stamps, poses, parents = buffer.samples(info.name)
        others = expected.samples(info.name)
        assert stamps.tobytes() == others[0].tobytes()
        assert poses.tobytes() == others[1].tobytes()
        assert parents == others[2]


def test_conflicts_between_openings(name: str) -> None:
    one, other = tfdb.Buffer.open(name), tfdb.Buffer.open(name)
    child.move_arm(one, 1)

    def lose(tx: tfdb.Transaction) -> None:
        tx.lookup_transform("map", "base")
        child.move_arm(other, child.arm_in(other) + 1)
        tx.set_transform("map", "seen", 5, (1, 2, 3), TURN)

    with pytest.raises(tfdb.Conflict):
        one.run(lose, retries=2)
    assert "seen" not in other.frames()


def test_settings_are_those_of_the_maker(name: str) -> None:
    made = tfdb.Buffer.open(name, history=3.0, max_frames=50, size=1 << 25)
    again = tfdb.Buffer.open(name, history=99.0, max_frames=9, size=1 << 26)
    assert made.history == again.history == 3.0
    assert again.shared is not None
    assert again.shared.size == 1 << 25
    assert made.shared is not None
    assert made.shared.processes == again.shared.processes == 1
    assert again.shared.lock_timeout == 10.0
    assert tfdb.Buffer().shared is None


def test_a_removed_store_stays_usable_where_it_is_open(name: str) -> None:
    buffer = tfdb.Buffer.open(name)
    reader = tfdb.Buffer.open(name, mode="r")
    tfdb.Buffer.unlink(name)
    child.move_arm(buffer, 3)
    assert child.arm_in(reader) == 3
    with pytest.raises(tfdb.errors.NoSuchStore):
        tfdb.Buffer.open(name, create=False)
    assert tfdb.Buffer.open(name).frames() == []


def test_a_path_and_a_clock(name: str) -> None:
    path = Path(f"/dev/shm/{name}.store")
    buffer = tfdb.Buffer.open(path, clock=lambda: 5_000_000_000)
    child.move_arm(buffer, 1)
    with pytest.raises(tfdb.errors.Stale):
        buffer.lookup_latest_transform("map", "base", max_age=1.0)
    tfdb.Buffer.unlink(path)
    assert not list(Path("/dev/shm").glob(f"{name}.store*"))
