"""Reads of a frozen store equal those of the frozen state."""

from __future__ import annotations

import multiprocessing
import pickle
from pathlib import Path

import numpy as np
import pytest

import tfdb
from tests.sharing.all_reads import RECORDING, TURN, answers, fill


@pytest.fixture
def filled() -> tfdb.Buffer:
    buffer = tfdb.Buffer(history=1000.0)
    fill(buffer)
    return buffer


def test_every_way_to_ask(filled: tfdb.Buffer, tmp_path: Path) -> None:
    filled.freeze(tmp_path / "a.tfdb")
    expected = answers(filled)
    frozen = tfdb.open(tmp_path / "a.tfdb", verify=True)
    assert answers(frozen) == expected
    with frozen.snapshot() as snapshot:
        snapshot.freeze(tmp_path / "b.tfdb")
    assert answers(tfdb.open(tmp_path / "b.tfdb")) == expected


def test_a_snapshot_is_frozen_as_it_was(filled: tfdb.Buffer, tmp_path: Path) -> None:
    expected = answers(filled)
    with filled.snapshot() as snapshot:
        filled.set_transform("hand", "new", 50, (1, 2, 3), TURN)
        filled.set_transform("map", "base", 14, (9, 9, 9), TURN, authority="ekf")
        filled.remove_frames("camera")
        filled.clear()
        snapshot.freeze(tmp_path / "a.tfdb")
    found = answers(tfdb.open(tmp_path / "a.tfdb"))
    # How many came late is not versioned.
    late = {key for key in expected if "tree" in key or key.endswith("info base")}
    for key in expected.keys() - late:
        assert found[key] == expected[key], key
    with pytest.raises(tfdb.errors.SnapshotClosed):
        snapshot.freeze(tmp_path / "c.tfdb")


@pytest.mark.parametrize("concurrency", ["giant", "silo", "wound"])
def test_of_other_engines(concurrency: str, tmp_path: Path) -> None:
    engine = {"wound": "2pl-wound-wait"}.get(concurrency, concurrency)
    buffer = tfdb.Buffer(concurrency=engine)  # type: ignore[arg-type]
    buffer.set_transform("map", "base", 10, (1, 2, 3), TURN)
    buffer.freeze(tmp_path / "a.tfdb")
    frozen = tfdb.open(tmp_path / "a.tfdb")
    assert frozen.lookup_transform("map", "base") == buffer.lookup_transform("map", "base")
    assert frozen.concurrency == "snapshot"


def test_of_a_shared_store(tmp_path: Path, name: str) -> None:
    with tfdb.Buffer.open(name, create=True).snapshot():
        pass
    shared = tfdb.Buffer.open(name, create=False)
    fill(shared)
    tfdb.Buffer.open(name, mode="r").freeze(tmp_path / "a.tfdb")
    assert answers(tfdb.open(tmp_path / "a.tfdb")) == answers(shared)


def test_nothing_can_be_written(filled: tfdb.Buffer, tmp_path: Path) -> None:
    path = tmp_path / "a.tfdb"
    filled.freeze(path)
    before = path.read_bytes()
    frozen = tfdb.open(path)
    pose = ((1, 2, 3), TURN)
    one = tfdb.TransformStamped("map", "base", 60, *pose)
    columns = tfdb.Columns("base", "arm", np.array([60]), np.array([[1, 2, 3, 0, 0, 0, 1.0]]))

    def in_transaction() -> None:
        with frozen.transaction() as tx:
            tx.set_transform("map", "base", 60, *pose)

    for write in (
        lambda: frozen.set_transform("map", "base", 60, *pose),
        lambda: frozen.set_static_transform("map", "fixed", *pose),
        lambda: frozen.set_transforms([one]),
        lambda: frozen.set_transforms([one], partial=True),
        lambda: frozen.set_transforms(columns),
        lambda: frozen.ingest(tfdb.encode_tf_message([one])),
        lambda: frozen.load(RECORDING),
        lambda: frozen.remove_frames("hand"),
        lambda: frozen.remove_frames(["hand"]),
        frozen.clear,
        lambda: frozen.run(lambda tx: tx.set_transform("map", "base", 60, *pose)),
        in_transaction,
    ):
        with pytest.raises(tfdb.errors.ReadOnly, match="is frozen") as caught:
            write()
        assert caught.value.path == str(path)
    assert path.read_bytes() == before


def test_path_size_and_origin(filled: tfdb.Buffer, tmp_path: Path) -> None:
    path = tmp_path / "a.tfdb"
    filled.freeze(path)
    frozen = tfdb.open(path)
    assert frozen.frozen == tfdb.types.Frozen(str(path), path.stat().st_size, "")
    assert frozen.shared is None
    assert filled.frozen is None
    assert f"<tfdb.Buffer at commit {filled.commit}, history 1000 s, frozen in {path}: " in repr(
        frozen
    )
    assert frozen.counters().commits == filled.commit
    assert frozen.memory().samples == sum(info.samples for info in filled.tree())
    assert frozen.memory().used_bytes <= path.stat().st_size
    assert frozen.changes(filled.commit) == []
    with pytest.raises(tfdb.errors.FeedLapped) as lapped:
        frozen.changes(3)
    assert (lapped.value.oldest, lapped.value.newest) == (filled.commit, filled.commit)


def test_its_clock(tmp_path: Path) -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 10**9, (1, 2, 3), TURN)
    buffer.freeze(tmp_path / "a.tfdb")
    frozen = tfdb.open(tmp_path / "a.tfdb", clock=lambda: 3 * 10**9)
    assert frozen.lookup_latest_transform("map", "base", max_age=2.5).stamp == 10**9
    with pytest.raises(tfdb.errors.Stale):
        frozen.lookup_latest_transform("map", "base", max_age=1.5)


def test_it_pickles_by_its_path(
    filled: tfdb.Buffer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    filled.freeze("a.tfdb")
    pickled = pickle.dumps(tfdb.open("a.tfdb"))
    monkeypatch.chdir("/")
    assert answers(pickle.loads(pickled)) == answers(filled)
    Path(tmp_path / "a.tfdb").unlink()
    with pytest.raises(tfdb.errors.NoSuchStore):
        pickle.loads(pickled)


def private_and_shared_pages(path: str) -> tuple[int, int]:
    """Kilobytes of a file's mappings in this process: private ones, and its share of the rest."""
    private = proportional = 0
    ours = False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        words = line.split()
        if not words[0].endswith(":"):
            ours = line.endswith(path)
        elif ours and words[0] == "Pss:":
            proportional += int(words[1])
        elif ours and words[0].startswith("Private"):
            private += int(words[1])
    return private, proportional


def touch_all(buffer: tfdb.Buffer, barrier: object, pipe: object) -> None:
    stamps, poses, _ = buffer.samples("base")
    assert buffer.frozen is not None
    barrier.wait()  # type: ignore[attr-defined]
    told = private_and_shared_pages(buffer.frozen.path)
    barrier.wait()  # type: ignore[attr-defined]
    pipe.send((len(stamps), float(poses[:, 0].sum()), told))  # type: ignore[attr-defined]


@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_processes_share_its_pages(tmp_path: Path, method: str) -> None:
    count = 50_000
    poses = np.tile([1.0, 2, 3, 0, 0.6, 0, 0.8], (count, 1))
    poses[:, 0] = np.arange(count)
    buffer = tfdb.Buffer(history=None)
    buffer.set_transforms(tfdb.Columns("map", "base", np.arange(count), poses))
    buffer.freeze(tmp_path / "a.tfdb")
    frozen = tfdb.open(tmp_path / "a.tfdb")
    context = multiprocessing.get_context(method)
    barrier = context.Barrier(3)
    pipes, children = [], []
    for _ in range(3):
        here, there = context.Pipe()
        child = context.Process(target=touch_all, args=(frozen, barrier, there))
        child.start()
        pipes.append(here)
        children.append(child)
    told = [pipe.recv() for pipe in pipes]
    for child in children:
        child.join()
    size = (tmp_path / "a.tfdb").stat().st_size / 1024
    for length, total, (private, proportional) in told:
        assert (length, total) == (count, count * (count - 1) / 2)
        assert private < size / 10
        assert proportional < size / 2
