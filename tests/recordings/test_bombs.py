"""Small files that decompress to huge ones, and other kinds of files, are refused fast."""

from __future__ import annotations

import bz2
import functools
import gzip
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb
from tfdb.recordings import raw_file

zstandard = pytest.importorskip("zstandard")
lz4 = pytest.importorskip("lz4.frame")

Drive = list[Any]
# Memory limit of a child process; a decompressed bomb needs many times more.
BOUND = 1_400_000_000
ZEROS = bytes(2**20)


@functools.cache
def packed_zeros(packing: str, mebibytes: int) -> bytes:
    """Compress zeros of this size into one frame, piece by piece."""
    made = {
        "bz2": bz2.BZ2Compressor,
        "zstd": lambda: zstandard.ZstdCompressor().compressobj(),
        "lz4": lz4.LZ4FrameCompressor,
    }[packing]()
    begun = made.begin() if packing == "lz4" else b""
    return begun + b"".join(made.compress(ZEROS) for _ in range(mebibytes)) + made.flush()


def record(fields: dict[str, bytes], data: bytes) -> bytes:
    header = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields.items()
    )
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def bag_of(packing: str, packed: bytes, declared: int) -> bytes:
    """Make a bag with one chunk, and an index that lists one message in it."""
    u32, u64 = struct.Struct("<I").pack, struct.Struct("<Q").pack
    chunk = record({"op": b"\x05", "compression": packing.encode(), "size": u32(declared)}, packed)
    connection = record(
        {"op": b"\x07", "conn": u32(0), "topic": b"/tf"},
        record({"topic": b"/tf", "type": b"tf2_msgs/TFMessage", "md5sum": b"*"}, b"")[4:-4],
    )
    at = 13 + 4096
    info = record(
        {
            "op": b"\x06",
            "ver": u32(1),
            "chunk_pos": u64(at),
            "start_time": u64(1),
            "end_time": u64(9),
            "count": u32(1),
        },
        u32(0) + u32(1),
    )

    def head(pad: int) -> bytes:
        fields = {"op": b"\x03", "index_pos": u64(at + len(chunk)), "conn_count": u32(1)}
        return record({**fields, "chunk_count": u32(1)}, b" " * pad)

    return b"#ROSBAG V2.0\n" + head(4096 - len(head(0))) + chunk + connection + info


def mcap_of(packing: str, packed: bytes, declared: int) -> bytes:
    """Make an MCAP file with one chunk and without a summary."""
    name = packing.encode()
    body = struct.pack("<QQQI", 1, 2, declared, 0) + struct.pack("<I", len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    start = b"\x89MCAP0\r\n\x01" + struct.pack("<Q", 8) + bytes(8)
    end = b"\x02" + struct.pack("<Q", 20) + bytes(20) + b"\x89MCAP0\r\n"
    return start + b"\x06" + struct.pack("<Q", len(body)) + body + end


PROGRAM = """
import resource, sys, tfdb
resource.setrlimit(resource.RLIMIT_AS, ({bound}, {bound}))
for salvage in (False, True):
    try:
        tfdb.Buffer(history=None).load(sys.argv[1], salvage=salvage)
    except tfdb.errors.RecordingError as error:
        print(error.reason)
    else:
        raise AssertionError("it loads")
"""


def refused(path: Path) -> list[str]:
    """Return the errors, without and with salvage, from a child process with little memory."""
    program = PROGRAM.format(bound=BOUND)
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    reasons = done.stdout.splitlines()
    assert len(reasons) == 2, done.stdout
    return reasons


@pytest.mark.parametrize("declared", ["little", "the truth"])
@pytest.mark.parametrize(
    ("container", "packing"),
    [("bag", "bz2"), ("bag", "lz4"), ("mcap", "lz4"), ("mcap", "zstd")],
)
def test_chunks(tmp_path: Path, container: str, packing: str, declared: str) -> None:
    mebibytes = 2000 if packing != "bz2" else 300
    packed = packed_zeros(packing, mebibytes)
    size = 100_000 if declared == "little" else mebibytes * 2**20
    path = tmp_path / f"a.{container}"
    path.write_bytes((bag_of if container == "bag" else mcap_of)(packing, packed, size))
    strict, salvaged = refused(path)
    wanted = "a chunk that declares 100000 bytes holds more" if declared == "little" else "limit"
    assert wanted in strict
    assert "transform" in salvaged


@pytest.mark.parametrize("kind", ["file", "message"])
def test_folders(recorder: Any, messages: Drive, tmp_path: Path, kind: str) -> None:
    import sqlite3

    folder = recorder.folder(tmp_path / "a", messages[:9], "sqlite3", kind)
    bomb = packed_zeros("zstd", 4000)
    assert len(bomb) < 500_000
    if kind == "file":
        path = next(folder.glob("*.zstd"))
        path.write_bytes(bomb)
    else:
        path = next(folder.glob("*.db3"))
        database = sqlite3.connect(path)
        database.execute("UPDATE messages SET data = ?", (bomb,))
        database.commit()
        database.close()
    strict, _ = refused(folder)
    assert ("decompresses to more than" if kind == "file" else "more than the limit") in strict


def test_npz(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, stamps=np.arange(10**6), poses=np.zeros((1, 7)))
    monkeypatch.setattr("tfdb.trajectories.reading.MAX_BYTES", 10**6)
    with pytest.raises(tfdb.errors.TrajectoryError, match="its arrays take 8000"):
        tfdb.Trajectory.read(path)


def test_a_packed_message_up_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raw_file, "MAX_MESSAGE", 100)
    assert raw_file.unpack_message(zstandard.compress(bytes(100))) == bytes(100)
    with pytest.raises(raw_file.BadDataError, match="more than the limit of 100 bytes"):
        raw_file.unpack_message(zstandard.compress(bytes(101)))


def test_frames_of_zstd() -> None:
    """Frames with and without a declared size, several frames, and invalid ones."""
    data = bytes(range(256)) * 40
    frame = zstandard.compress(data)
    stream = zstandard.ZstdCompressor().compressobj()
    unsized = stream.compress(data) + stream.flush()
    half = zstandard.compress(data[:5120])
    assert zstandard.frame_content_size(unsized) == -1
    for good in (frame, memoryview(frame), unsized, half + half, frame + zstandard.compress(b"")):
        assert raw_file.unpack("zstd", good, len(data)) == data
    assert raw_file.unpack("zstd", zstandard.compress(b""), 0) == b""
    for bad, reason in (
        (frame + frame, "holds more"),
        (frame + unsized, "holds more"),
        (half, "holds 5120"),
        (frame[:-1], "zstd|holds"),
        (frame + b"junk", "zstd|holds"),
        (b"", "zstd|holds"),
    ):
        with pytest.raises(raw_file.BadDataError, match=reason):
            raw_file.unpack("zstd", bad, len(data))


def test_a_chunk_within_the_limit_loads(
    recorder: Any, messages: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages, "bz2")
    monkeypatch.setattr(raw_file, "MAX_CHUNK", 1000)
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"limit of 1000 \(tfdb.recordings.raw_file.MAX_CHUNK"
    ):
        tfdb.load(path)
    monkeypatch.setattr(raw_file, "MAX_CHUNK", 8192)
    assert tfdb.load(path).commit == len(messages)


def test_special_files_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero.bag").symlink_to("/dev/zero")
    for path in (tmp_path / "pipe", tmp_path / "zero.bag", Path("/dev/zero"), Path("/dev/null")):
        with pytest.raises(tfdb.errors.RecordingError, match="not a regular file") as caught:
            tfdb.load(path)
        assert caught.value.path == str(path)
    for path in (tmp_path / "zero.bag", Path("/dev/zero"), Path("/dev/null")):
        with pytest.raises(tfdb.errors.TrajectoryError, match="not a regular file"):
            tfdb.Trajectory.read(path)


@pytest.mark.parametrize("magic", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
@pytest.mark.parametrize("salvage", [False, True])
def test_huge_and_empty(tmp_path: Path, magic: bytes, salvage: bool) -> None:
    """A sparse file of one terabyte."""
    path = tmp_path / "a"
    with path.open("wb") as file:
        file.write(magic)
        file.truncate(2**40)
    with pytest.raises(tfdb.errors.RecordingError):
        tfdb.load(path, salvage=salvage)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 5\n", "git lfs pull"),
        (b"\x28\xb5\x2f\xfd1234", "its zstd data are damaged"),
        (b"\x04\x22\x4d\x181234", "lz4 -dc"),
        (b"\x1f\x8b1234", "gzip -dc"),
        (b"BZh91AY", "bzip2 -dc"),
    ],
)
def test_other_packed_files_are_refused_by_name(tmp_path: Path, start: bytes, words: str) -> None:
    path = tmp_path / "a.mcap.zstd"
    path.write_bytes(start)
    with pytest.raises(tfdb.errors.RecordingError, match=words):
        tfdb.load(path)


@pytest.mark.parametrize("name", ["two words.bag", "-dash.tum", "it's.mcap"])
def test_the_command_that_unpacks_a_file_runs_in_a_shell(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(gzip.compress(b"unpacked"))
    for reads in (tfdb.load, tfdb.Trajectory.read):
        with pytest.raises(tfdb.TfdbError) as caught:
            reads(path)
        command = str(caught.value).partition("`")[2].partition("`")[0]
        command = command.replace("> FILE", "")
        assert subprocess.check_output(command, shell=True, cwd=tmp_path) == b"unpacked"
