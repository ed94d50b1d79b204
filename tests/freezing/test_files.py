"""The file of a frozen store is complete or missing, and damaged files are refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import tfdb
from tests.sharing.all_reads import TURN, fill


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "a.tfdb"
    buffer = tfdb.Buffer()
    fill(buffer)
    buffer.freeze(made)
    return made


def moved(number: float) -> tfdb.Buffer:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 10, (number, 2, 3), TURN)
    return buffer


def number_in(store: tfdb.Buffer) -> float:
    return float(store.lookup_transform("map", "base").translation[0])


def test_a_file_is_replaced_only_when_asked(tmp_path: Path) -> None:
    path = tmp_path / "a.tfdb"
    moved(1).freeze(path)
    with pytest.raises(tfdb.InvalidArgument, match="exists already"):
        moved(2).freeze(path)
    old = tfdb.open(path)
    moved(2).freeze(path, overwrite=True)
    assert (number_in(old), number_in(tfdb.open(path))) == (1, 2)
    assert [file.name for file in tmp_path.iterdir()] == ["a.tfdb"]
    path.unlink()
    assert number_in(old) == 1


def test_the_longest_name(tmp_path: Path) -> None:
    path = tmp_path / ("n" * os.pathconf(tmp_path, "PC_NAME_MAX"))
    for number in (1, 2):
        moved(number).freeze(path, overwrite=number > 1)
        assert number_in(tfdb.open(path, verify=True)) == number
    assert [*tmp_path.iterdir()] == [path]


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="missing folder"):
        moved(1).freeze(tmp_path / "none" / "a.tfdb")
    with pytest.raises(tfdb.InvalidArgument):
        moved(1).freeze(tmp_path, overwrite=True)
    with pytest.raises(tfdb.InvalidArgument):
        moved(1).freeze("")


def test_a_full_disk(tmp_path: Path) -> None:
    path = tmp_path / "a.tfdb"
    moved(1).freeze(path)
    program = f"""
import resource, signal, tfdb
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
buffer = tfdb.Buffer()
for i in range(500):
    buffer.set_transform("map", "base", i, (i, 2, 3), (0, 0.6, 0, 0.8))
buffer.lookup_transform("map", "base")
from tfdb.store.frozen import freeze_into
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
for target in ({str(path)!r}, {str(tmp_path / "new.tfdb")!r}):
    try:
        buffer.freeze(target, overwrite=True)
    except tfdb.errors.CapacityExceeded as error:
        assert error.path == target and target in str(error), error
    else:
        raise AssertionError("it fits")
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
    assert [file.name for file in tmp_path.iterdir()] == ["a.tfdb"]
    assert number_in(tfdb.open(path, verify=True)) == 1


def test_other_files_are_refused(tmp_path: Path, path: Path) -> None:
    for name in ("none.tfdb", "none/a.tfdb"):
        with pytest.raises(tfdb.errors.NoSuchStore, match="tfdb freeze"):
            tfdb.open(tmp_path / name)
    for made, content in (("empty", b""), ("short", b"TFDBFRZ1"), ("text", b"hello" * 9999)):
        (tmp_path / made).write_bytes(content)
        with pytest.raises(tfdb.errors.CorruptStore) as caught:
            tfdb.open(tmp_path / made)
        assert caught.value.path == str(tmp_path / made)
    os.mkfifo(tmp_path / "pipe")
    for other in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(tfdb.errors.CorruptStore, match="not a regular file"):
            tfdb.open(other)
    with pytest.raises(tfdb.errors.CorruptStore, match=r"tfdb\.open opens it"):
        tfdb.Buffer.open(path, create=False)
    with pytest.raises(tfdb.errors.CorruptStore, match=r"tfdb\.open opens it"):
        tfdb.Buffer.unlink(path)
    with pytest.raises(tfdb.errors.RecordingError, match=r"tfdb\.open\('a\.tfdb'\) opens it"):
        tfdb.load(path)
    for bad in (5, None):
        with pytest.raises(tfdb.InvalidArgument, match="a path must be a str"):
            tfdb.open(bad)  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument, match="no file can have this name"):
        tfdb.open("a\0b")


def test_a_shared_store_is_none(tmp_path: Path) -> None:
    name = Path("/dev/shm") / f"test-files-{os.getpid()}"
    tfdb.Buffer.open(name, create=True)
    try:
        with pytest.raises(tfdb.errors.CorruptStore, match=r"Buffer\.open opens it"):
            tfdb.open(name)
    finally:
        tfdb.Buffer.unlink(name)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read(path: Path) -> None:
    path.chmod(0)
    with pytest.raises(tfdb.errors.ReadOnly, match="is not readable"):
        tfdb.open(path)


def test_one_that_was_cut(path: Path) -> None:
    whole = path.read_bytes()
    for length in (len(whole) - 8, len(whole) - 1, 20_000, 16_384, 4096, 64, 7):
        path.write_bytes(whole[:length])
        with pytest.raises(tfdb.errors.CorruptStore):
            tfdb.open(path)
    path.write_bytes(whole + bytes(64))
    with pytest.raises(tfdb.errors.CorruptStore, match="cut or extended"):
        tfdb.open(path)


def test_another_version_is_named(path: Path) -> None:
    whole = bytearray(path.read_bytes())
    whole[8 * 12] ^= 1
    path.write_bytes(whole)
    with pytest.raises(tfdb.errors.CorruptStore, match="it is from another version of tfdb"):
        tfdb.open(path)


def test_a_flipped_bit_is_found_when_all_is_verified(path: Path) -> None:
    whole = path.read_bytes()
    for at in range(16_384, len(whole), 997):
        damaged = bytearray(whole)
        damaged[at] ^= 4
        path.write_bytes(damaged)
        tfdb.open(path)  # what stands in front is whole
        with pytest.raises(tfdb.errors.CorruptStore, match="it is damaged"):
            tfdb.open(path, verify=True)


def test_contradictions_raise_corrupt_store(tmp_path: Path) -> None:
    buffer = tfdb.Buffer()
    for i in range(300):  # so many that they are not all in front
        buffer.set_transform("map", f"frame{i}", 10, (1, 2, 3), TURN)
    path = tmp_path / "a.tfdb"
    buffer.freeze(path)
    whole = path.read_bytes()
    told = 0
    for at in range(16_384, 20_000, 64):
        path.write_bytes(
            whole[:at] + bytes(255 - byte for byte in whole[at : at + 64]) + whole[at + 64 :]
        )
        store = tfdb.open(path)
        for ask in (store.tree, store.snapshot().tree):
            try:
                ask()
            except tfdb.errors.CorruptStore as error:
                assert (error.path, error.reason) == (str(path), "damaged")
                assert str(path) in str(error)
                told += 1
    assert told > 0


def test_a_damaged_name_raises_corrupt_store(tmp_path: Path) -> None:
    buffer = tfdb.Buffer()
    for i in range(300):  # so many that their names are not in front
        buffer.set_transform("map", f"näher{i:03}", 10, (1, 2, 3), TURN, authority="Süd")
    path = tmp_path / "a.tfdb"
    buffer.freeze(path)
    whole = path.read_bytes()
    at = whole.index("näher299".encode()) + 1
    assert at > 16_384
    path.write_bytes(whole[:at] + b"\xff" + whole[at + 1 :])
    store = tfdb.open(path)
    for ask in (
        store.frames,
        store.tree,
        store.snapshot().frames,
        lambda: store.explain("map", "name"),
    ):
        with pytest.raises(tfdb.errors.CorruptStore, match="not valid UTF-8") as caught:
            ask()
        assert caught.value.reason == "a name is not valid UTF-8"
    assert store.lookup_transform("map", "näher001").stamp == 10
    # An authority is not a frame's name: programs in C++ may store any bytes.
    at = whole.index("Süd".encode()) + 1
    path.write_bytes(whole[:at] + b"\xff" + whole[at + 1 :])
    assert tfdb.open(path).frame_info("näher000").authority == r"S\xff\xbcd"
