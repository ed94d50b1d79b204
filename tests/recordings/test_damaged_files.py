"""Cut files of each format, flipped bytes, missing parts: a typed error, or all messages.

With `salvage` the rest is read and the losses are counted.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard

import tfdb
from tfdb.data.loss import Loss
from tfdb.recordings import Recording
from tfdb.recordings.containers import Gathered
from tfdb.trajectories.writing import write_trajectory

Drive = list[Any]
Make = Callable[[Any, Path, Drive], Path]


def bag(compression: str | None) -> Make:
    return lambda recorder, at, drive: recorder.bag(at / "a.bag", drive, compression)


def part(plugin: str, mode: str, suffix: str) -> Make:
    return lambda recorder, at, drive: next(
        recorder.folder(at / "a", drive, plugin, mode).glob(f"*{suffix}")
    )


FILES: dict[str, Make] = {
    "bag": bag(None),
    "bag-bz2": bag("bz2"),
    "bag-lz4": bag("lz4"),
    "mcap": part("mcap", "none", ".mcap"),
    "mcap-zstd": part("mcap", "storage", ".mcap"),
    "db3": part("sqlite3", "none", ".db3"),
    # Files that are cut in folders with complete metadata.
    "db3-in-folder": part("sqlite3", "none", ".db3"),
    "db3-packed": part("sqlite3", "file", ".zstd"),
    "db3-messages": part("sqlite3", "message", ".db3"),
    "mcap-packed": part("mcap", "file", ".zstd"),
    "metadata": part("sqlite3", "none", ".yaml"),
}
IN_FOLDER = ("db3-in-folder", "db3-packed", "db3-messages", "mcap-packed", "metadata")


def all_of(path: Path, **options: Any) -> list[tuple[int, bytes]]:
    with Recording(path, **options) as recording:
        return [(received, data) for _, received, data in recording.messages()]


def saved_of(path: Path) -> list[tuple[int, bytes]]:
    """Return what `salvage` reads; nothing if it fails as well."""
    try:
        with Recording(path, salvage=True) as recording:
            found = [(received, data) for _, received, data in recording.messages()]
            assert recording.losses
    except tfdb.errors.RecordingError:
        return []
    return found


@pytest.mark.parametrize("name", FILES)
def test_cuts_at_every_hundredth(recorder: Any, messages: Drive, tmp_path: Path, name: str) -> None:
    file = FILES[name](recorder, tmp_path, messages[:240])
    path = file.parent if name in IN_FOLDER else file
    whole = all_of(path)
    assert all_of(path, salvage=True) == whole
    raw = file.read_bytes()
    saved = []
    for hundredth in range(100):
        file.write_bytes(raw[: len(raw) * hundredth // 100])
        try:
            # Only cut metadata may cause no loss.
            assert (name, all_of(path)) == ("metadata", whole)
        except tfdb.errors.RecordingError as error:
            assert str(file.name if name in IN_FOLDER else path) in str(error)
            found = saved_of(path)
        else:
            found = whole
        assert set(found) <= set(whole)
        assert found == [each for each in whole if each in set(found)], "out of order"
        saved.append(len(found))
    print(name, len(whole), saved)
    if name == "metadata":
        assert set(saved) == {len(whole)}
    elif name in ("bag", "bag-bz2", "bag-lz4", "mcap"):
        # Chunks are small or uncompressed, so all data before the cut are read.
        assert saved == sorted(saved)
        assert saved[99] > 0.9 * len(whole)
        assert saved[50] > 0.3 * len(whole)


@pytest.mark.parametrize("kind", ["tum", "csv", "euroc", "kitti", "npz"])
def test_cut_trajectories(tmp_path: Path, kind: str) -> None:
    rng = np.random.default_rng(9)
    poses = rng.normal(size=(60, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    whole = tfdb.Trajectory("world", "body", np.arange(60) * 10_000_000 + 10**18, poses)
    path = tmp_path / "a"
    write_trajectory(path, whole, kind)
    raw = path.read_bytes()
    read = 0
    for hundredth in range(100):
        path.write_bytes(raw[: len(raw) * hundredth // 100])
        try:
            found = tfdb.Trajectory.read(path, kind)
        except tfdb.errors.TrajectoryError as error:
            assert error.path == str(path)
        else:
            # Text that is cut after a line, or in the middle of the last number.
            assert np.array_equal(found.stamps, whole.stamps[: len(found)])
            assert np.allclose(found.poses[:-1], whole.poses[: len(found) - 1], atol=1e-9)
            read += 1
    assert kind in ("tum", "csv", "euroc") or read == 0


@pytest.mark.parametrize("salvage", [False, True])
@pytest.mark.parametrize("name", FILES)
def test_flipped_bytes(
    recorder: Any, messages: Drive, tmp_path: Path, name: str, salvage: bool
) -> None:
    """Any damage raises the typed error, and no other exception."""
    file = FILES[name](recorder, tmp_path, messages[:40])
    path = file.parent if name in IN_FOLDER else file
    raw = file.read_bytes()
    rng = np.random.default_rng(17)
    ends = []
    for _ in range(100):
        damaged = bytearray(raw)
        for at in rng.integers(0, len(raw), rng.integers(1, 4)):
            damaged[at] = rng.integers(0, 256)
        file.write_bytes(damaged)
        try:
            ends.append(len(all_of(path, salvage=salvage)))
        except tfdb.errors.RecordingError as error:
            assert error.path in (str(path), str(file))
            ends.append(-1)
    print(name, salvage, ends)


@pytest.mark.parametrize("name", ["bag", "bag-lz4"])
def test_no_more_is_lost_than_there_was(
    recorder: Any, messages: Drive, tmp_path: Path, name: str
) -> None:
    """A flipped bit in a record outside the chunks: such records have the message counts."""
    path = FILES[name](recorder, tmp_path, messages[:120])
    whole = all_of(path)
    raw = path.read_bytes()
    # Each uncompressed message has its own "conn" field: a changed one moves to another topic.
    words = (b"count=",) if name == "bag" else (b"count=", b"conn=\0")
    counts = [at for at in range(len(raw) - 10) if raw[at : at + 6] in words]
    index = raw.index(b"index_pos=") + len(b"index_pos=")
    behind = range(int.from_bytes(raw[index : index + 8], "little"), len(raw), 23)
    for at in [at + 5 + number % 5 for number, at in enumerate(counts)] + list(behind):
        damaged = bytearray(raw)
        damaged[at] ^= 1 << at % 8
        path.write_bytes(damaged)
        try:
            with Recording(path, salvage=True) as recording:
                found = [(received, data) for _, received, data in recording.messages()]
                lost = sum(loss.messages for loss in recording.losses)
        except tfdb.errors.RecordingError:
            continue
        assert len(found) + lost <= len(whole), at
        assert recording.losses or found == whole, at


def test_losses_are_counted(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    """The index has the number of messages in a damaged chunk."""
    for name, count in (("bag-bz2", 601), ("mcap-zstd", 601)):
        file = FILES[name](recorder, tmp_path, messages)
        raw = bytearray(file.read_bytes())
        middle = len(raw) // 2
        raw[middle : middle + 40] = bytes(40)
        file.write_bytes(raw)
        buffer = tfdb.Buffer(history=None)
        with pytest.raises(tfdb.errors.RecordingError, match="salvage=True"):
            buffer.load(file)
        if name == "mcap-zstd":
            continue  # one chunk, without any other record
        report = buffer.load(file, salvage=True)
        (loss,) = report.lost
        assert report.messages + loss.messages == count
        assert 0 < loss.messages < count
        assert loss.path == str(file)
        assert 0 < loss.bytes < len(raw)
        assert f"lost at least {loss.messages} messages" in str(loss)
        assert " more" not in loss.reason  # it is the only one


@pytest.mark.parametrize("plugin", ["sqlite3", "mcap"])
def test_a_cut_packed_file_promises_no_number(
    recorder: Any, messages: Drive, tmp_path: Path, plugin: str
) -> None:
    plain = next(recorder.folder(tmp_path / "a", messages, plugin).glob("a.*"))
    raw, packer = plain.read_bytes(), zstandard.ZstdCompressor().compressobj()
    packed = b""
    for at in range(0, len(raw) * 2 // 3, 4096):  # blocks that decompress independently
        packed += packer.compress(raw[at : at + 4096])
        packed += packer.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
    file = tmp_path / f"{plain.name}.zstd"
    file.write_bytes(packed)
    with Recording(file, salvage=True) as recording:
        assert list(recording.messages())
        loss = recording.losses[-1]
    assert loss.reason.startswith("its zstd data are damaged")
    assert (loss.path, loss.messages, loss.bytes) == (str(file), 0, 0)


def test_a_loss_names_the_first_reason_and_counts_the_others() -> None:
    gathered, path = Gathered(), Path("a.bag")
    assert gathered.losses(path, {}) == []
    for number, words in enumerate(["one", "one, and 1 more", "one, and 2 more"]):
        gathered.lose(5, ["one", "two", "three"][number])
        assert gathered.losses(path, {}) == [Loss("a.bag", words, 0, 5 * number + 5)]


def test_a_bag_without_an_index(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages, "lz4")
    whole = all_of(path)
    raw = bytearray(path.read_bytes())
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(raw[at : at + 8], "little")
    path.write_bytes(raw[:index])  # no message is lost
    assert tfdb.Buffer(history=None).load(path, salvage=True).lost == ()
    raw[at : at + 8] = bytes(8)
    path.write_bytes(raw[:index])
    with pytest.raises(tfdb.errors.RecordingError, match="not indexed"):
        tfdb.load(path)
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(path, salvage=True)
    assert (report.messages, report.lost) == (601, ())
    assert all_of(path, salvage=True) == whole
    assert buffer.frame_info("base").authority == "/odometry"
    assert buffer.frame_info("camera").is_static


CONNECTION = b"conn=\2\0\0\0\x10\0\0\0topic=/tf_static"
"""The header of the third connection, in a chunk and in the index."""


def renumbered(raw: bytearray) -> None:
    raw[raw.rindex(CONNECTION) + len(b"conn=\2\0\0")] = 1


def declared_twice(raw: bytearray) -> None:
    raw[raw.rindex(CONNECTION) + len(b"conn=")] = 1


def of_another_type(raw: bytearray) -> None:
    raw[raw.rindex(b"TFMessage'")] = ord("t")


def without_its_type(raw: bytearray) -> None:
    raw[raw.rindex(b"type=tf2")] = ord("T")


def one_chunk_less(raw: bytearray) -> None:
    raw[raw.index(b"chunk_count=") + len(b"chunk_count=")] -= 1


def longer(raw: bytearray) -> None:
    raw += bytes(7)


def without_its_last_message(raw: bytearray) -> None:
    """The last field of the index is the number of a connection's messages in the last chunk."""
    raw[-4:] = bytes(4)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (renumbered, "counts messages of connection 2, but does not declare it"),
        (declared_twice, "declares connection 1 twice"),
        (of_another_type, "connection 2 differs between its chunks and its index"),
        (without_its_type, "without a topic or a type"),
        (one_chunk_less, "bytes after its index"),
        (longer, "7 bytes after its index"),
        (without_its_last_message, "counts no message of a connection in a chunk"),
    ],
)
def test_a_bag_with_a_contradicting_index(
    recorder: Any,
    messages: Drive,
    tmp_path: Path,
    damage: Callable[[bytearray], None],
    reason: str,
) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages[:303])
    whole = all_of(path)
    raw = bytearray(path.read_bytes())
    damage(raw)
    path.write_bytes(raw)
    with pytest.raises(tfdb.errors.RecordingError, match=reason):
        all_of(path)
    assert all_of(path, salvage=True) == whole


def split(recorder: Any, folder: Path, messages: Drive, plugin: str) -> list[Path]:
    """A folder of three parts, as `ros2 bag record --max-bag-size` makes it."""
    suffix = ".mcap" if plugin == "mcap" else ".db3"
    parts = []
    folder.mkdir()
    for number in range(3):
        one = recorder.folder(
            folder.with_name(f"part{number}"), messages[number * 200 : number * 200 + 200], plugin
        )
        parts.append(folder / f"drive_{number}{suffix}")
        shutil.move(next(one.glob(f"*{suffix}")), parts[-1])
    whole = recorder.folder(folder.with_name("whole"), messages[:600], plugin)
    text = (whole / "metadata.yaml").read_text()
    names = "\n".join(f"  - {part.name}" for part in parts)
    assert f"  - whole{suffix}\n" in text
    (folder / "metadata.yaml").write_text(text.replace(f"  - whole{suffix}", names, 1))
    return parts


@pytest.mark.parametrize("plugin", ["sqlite3", "mcap"])
def test_missing_parts(recorder: Any, messages: Drive, tmp_path: Path, plugin: str) -> None:
    folder = tmp_path / "drive"
    parts = split(recorder, folder, messages, plugin)
    assert tfdb.load(folder).commit == 600
    parts[1].unlink()
    with pytest.raises(tfdb.errors.RecordingError, match=parts[1].name) as caught:
        tfdb.load(folder)
    assert caught.value.path == str(folder)
    assert "missing" in str(caught.value)
    report = tfdb.Buffer(history=None).load(folder, salvage=True)
    assert report.messages == 400
    assert sum(loss.messages for loss in report.lost) == 200
    # Without the metadata, the names reveal a missing part between others.
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    metadata.unlink()
    with pytest.raises(tfdb.errors.RecordingError, match=parts[1].name):
        tfdb.load(folder)
    for broken in ("{", "[]", "rosbag2_bagfile_information: 5", "\x00", "[" * 400, text[:300]):
        metadata.write_text(broken)
        with pytest.raises(tfdb.errors.RecordingError, match=r"metadata\.yaml is broken"):
            tfdb.load(folder)
        assert tfdb.Buffer(history=None).load(folder, salvage=True).messages == 400


def test_a_missing_and_a_damaged_part_count_each_loss_once(
    recorder: Any, messages: Drive, tmp_path: Path
) -> None:
    folder = tmp_path / "drive"
    parts = split(recorder, folder, messages, "mcap")
    parts[1].unlink()
    raw = bytearray(parts[2].read_bytes())
    middle = raw.index(messages[500].received.to_bytes(8, "little"))
    raw[middle - 200 : middle] = bytes(200)
    parts[2].write_bytes(raw)
    with Recording(folder, salvage=True) as recording:
        saved = len(list(recording.messages()))
        lost = [loss.messages for loss in recording.losses]
    assert 200 <= saved < 400
    assert all(lost)
    assert (len(lost), saved + sum(lost)) == (2, 600)


def test_few_missing_parts_are_named(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    """The error stays short for any number of the last part."""
    folder = tmp_path / "drive"
    parts = split(recorder, folder, messages, "mcap")
    (folder / "metadata.yaml").unlink()
    parts[2].rename(folder / "drive_5000.mcap")
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"are missing, .*: drive_2\.mcap"
    ) as caught:
        tfdb.load(folder)
    assert str(caught.value).count("drive_") == 11


def test_parts_that_hold_less_than_promised(recorder: Any, messages: Drive, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    parts = split(recorder, folder, messages, "sqlite3")
    shutil.copy(parts[0], tmp_path / "saved")
    short = recorder.folder(tmp_path / "short", messages[:150], "sqlite3")
    shutil.copy(next(short.glob("*.db3")), parts[0])
    with pytest.raises(
        tfdb.errors.RecordingError, match="promises messages that its files lack: 50 of"
    ):
        tfdb.load(folder)
    report = tfdb.Buffer(history=None).load(folder, salvage=True)
    assert (report.messages, sum(loss.messages for loss in report.lost)) == (550, 50)
    for broken in (b"", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", b"junk" * 9):
        parts[0].write_bytes(broken)
        with pytest.raises(tfdb.errors.RecordingError) as caught:
            tfdb.load(folder)
        assert caught.value.path == str(parts[0])
        report = tfdb.Buffer(history=None).load(folder, salvage=True)
        assert (report.messages, sum(loss.messages for loss in report.lost)) == (400, 200)
