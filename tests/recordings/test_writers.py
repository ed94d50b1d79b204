"""Recordings written from a store, read by tfdb and by rosbags."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import tfdb
from tfdb.recordings import RecordingWriter, write_recording, write_transforms

if TYPE_CHECKING:
    from pathlib import Path

KINDS = [(".bag", False), (".bag", True), (".mcap", False), (".mcap", True), (".db3", False)]


@pytest.fixture
def store() -> tfdb.Buffer:
    """Three moving edges (one changes its parent) and two static ones; some stamps are common."""
    rng = np.random.default_rng(2)
    poses = rng.normal(size=(300, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    buffer = tfdb.Buffer(history=None)
    stamps = 1_700_000_000_000_000_000 + np.arange(100) * 20_000_000
    buffer.set_transforms(tfdb.Columns("odom", "base", stamps, poses[:100]), authority="/ekf")
    arm = stamps[::2] + (stamps[::2] % 3)
    buffer.set_transforms(tfdb.Columns("base", "arm", arm, poses[100:150]), authority="/joints")
    parents = ["arm"] * 50 + ["base"] * 50
    buffer.set_transforms(tfdb.Columns(parents, "ball", stamps, poses[150:250]))
    buffer.set_static_transform("base", "camera", (1, 2, 3), authority="/model")
    buffer.set_static_transform("base", "lidar", (3, 2, 1), (0, 0, 0.6, 0.8), authority="/model")
    return buffer


def assert_same(left: tfdb.Buffer, right: tfdb.Buffer) -> None:
    assert left.frames() == right.frames()
    for info in left.tree():
        assert right.frame_info(info.name).is_static == info.is_static
        if info.parent is None:
            continue
        (s1, p1, n1), (s2, p2, n2) = left.samples(info.name), right.samples(info.name)
        assert np.array_equal(s1, s2)
        # The store normalises each quaternion, even one that it normalised before.
        assert np.abs(p1 - p2).max() < 1e-15
        assert n1 == n2


@pytest.mark.parametrize(("suffix", "compress"), KINDS)
def test_round_trip(store: tfdb.Buffer, tmp_path: Path, suffix: str, compress: bool) -> None:
    path = tmp_path / f"out{suffix}"
    written = write_recording(path, store, compress=compress)
    found = tfdb.Buffer(history=None)
    report = found.load(path)
    assert report.messages == written == found.commit
    assert report.transforms == 252
    assert_same(store, found)
    assert all(info.late == 0 for info in found.tree())
    if suffix == ".bag":
        assert found.frame_info("base").authority == "/ekf"
        assert found.frame_info("lidar").authority == "/model"
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(("suffix", "compress"), KINDS)
def test_rosbags_reads_it(store: tfdb.Buffer, tmp_path: Path, suffix: str, compress: bool) -> None:
    path = tmp_path / f"out{suffix}"
    write_recording(path, store, compress=compress)
    count = 0
    with AnyReader([path]) as reader:
        for index, (connection, received, data) in enumerate(reader.messages()):
            message: Any = reader.deserialize(data, connection.msgtype)
            count += len(message.transforms)
            if index == 0:
                assert connection.topic == "/tf_static"
                assert {t.child_frame_id for t in message.transforms} == {"camera", "lidar"}
            else:
                assert connection.topic == "/tf"
                for each in message.transforms:
                    stamp = each.header.stamp
                    assert stamp.sec * 10**9 + stamp.nanosec == received
        qualities = {c.topic: c.ext for c in reader.connections}
    assert count == 252
    static = qualities["/tf_static"]
    if suffix == ".bag":
        assert (static.latching, qualities["/tf"].latching) == (1, 0)
    else:
        durabilities = [q.offered_qos_profiles[0].durability.name for q in qualities.values()]
        assert sorted(durabilities) == ["TRANSIENT_LOCAL", "VOLATILE"]


def test_the_metadata_of_a_database_without_messages(tmp_path: Path) -> None:
    path = tmp_path / "out.db3"
    with RecordingWriter(path):
        pass
    with closing(sqlite3.connect(path)) as database:
        ((text,),) = database.execute("SELECT metadata FROM metadata").fetchall()
    about = json.loads(text)
    assert about["message_count"] == 0
    assert about["starting_time"] == {"nanoseconds_since_epoch": 0}
    assert about["duration"] == {"nanoseconds": 0}


def records(path: Path, store: tfdb.Buffer) -> list[tuple[str, int, bytes]]:
    """Write the messages of a store 100 times, into several chunks."""
    given = [
        (f"/robot{number % 3}/tf", 10**18 + number, data)
        for number in range(100)
        for data in [tfdb.encode_tf_message(transforms(store, number), "cdr")]
    ]
    with RecordingWriter(path, compress=path.stem == "packed") as writer:
        for topic, received, data in given:
            writer.write(data, received, topic=topic)
    return given


def transforms(store: tfdb.Buffer, number: int) -> list[tfdb.TransformStamped]:
    stamps, poses, parents = store.samples("ball")
    return [
        tfdb.TransformStamped(parent, f"ball{number}", stamp, pose[:3], pose[3:])
        for parent, stamp, pose in zip(parents, stamps.tolist(), poses.tolist(), strict=True)
    ] * 4


@pytest.mark.parametrize("name", ["plain", "packed"])
def test_mcap_reads_it(store: tfdb.Buffer, tmp_path: Path, name: str) -> None:
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / f"{name}.mcap"
    given = records(path, store)
    with path.open("rb") as file:
        opened = reader.make_reader(file, validate_crcs=True)
        summary = opened.get_summary()
        found = [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in opened.iter_messages(topics=["/robot1/tf"])
        ]
        (metadata,) = opened.iter_metadata()
    assert found == [each for each in given if each[0] == "/robot1/tf"]
    assert len(summary.chunk_indexes) > 2
    assert summary.statistics.message_count == 100
    assert sorted(summary.statistics.channel_message_counts.values()) == [33, 33, 34]
    assert (summary.statistics.message_start_time, summary.statistics.message_end_time) == (
        10**18,
        10**18 + 99,
    )
    about = json.loads(metadata.metadata["serialized_metadata"])
    assert about["message_count"] == 100


@pytest.mark.parametrize(
    ("suffix", "received"), [(".bag", 2**32 * 10**9), (".db3", 2**63), (".mcap", 2**64)]
)
def test_times_that_no_file_holds(tmp_path: Path, suffix: str, received: int) -> None:
    path = tmp_path / f"late{suffix}"
    data = tfdb.encode_tf_message([], "ros1" if suffix == ".bag" else "cdr")
    with RecordingWriter(path) as writer:
        writer.write(data, received - 1, topic="/tf")
    (message,) = tfdb.recordings.Recording(path).messages()
    assert message[1] == received - 1
    with (
        pytest.raises(tfdb.TfdbError, match=str(received)),
        RecordingWriter(path, overwrite=True) as w,
    ):
        w.write(data, received, topic="/tf")
    assert path.exists()


def test_samples_with_one_stamp_are_one_message(store: tfdb.Buffer, tmp_path: Path) -> None:
    distinct = {int(s) for frame in ("base", "arm", "ball") for s in store.samples(frame)[0]}
    assert write_recording(tmp_path / "a.mcap", store) == len(distinct) + 1
    # A bag keeps the publishers: /ekf, /joints and an unnamed one.
    samples = sum(len(store.samples(frame)[0]) for frame in ("base", "arm", "ball"))
    assert write_recording(tmp_path / "a.bag", store) == samples + 1


def test_a_snapshot_is_written_as_it_was(store: tfdb.Buffer, tmp_path: Path) -> None:
    with store.snapshot() as snapshot:
        store.clear()
        write_recording(tmp_path / "a.mcap", snapshot)
    assert len(tfdb.load(tmp_path / "a.mcap").samples("base")[0]) == 100


def test_static_transforms_alone(tmp_path: Path) -> None:
    buffer = tfdb.Buffer()
    buffer.set_static_transform("a", "b", (1, 2, 3))
    for suffix in (".bag", ".mcap", ".db3"):
        path = tmp_path / f"a{suffix}"
        assert write_recording(path, buffer) == 1
        assert tfdb.load(path).frame_info("b").is_static


def test_progress(store: tfdb.Buffer, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    write_recording(
        tmp_path / "a.mcap", store, progress=lambda done, total: seen.append((done, total))
    )
    assert seen[-1] == (250, 250)


def test_a_stream_of_transforms(tmp_path: Path) -> None:
    stream = [
        tfdb.TransformStamped("a", "b", 5, (1, 2, 3), (0, 0, 0, 1)),
        tfdb.TransformStamped("b", "c", 5, (1, 2, 3), (0, 0, 0, 1)),
        tfdb.TransformStamped("a", "b", 6, (1, 2, 4), (0, 0, 0, 1)),
    ]
    fixed = [tfdb.TransformStamped("c", "d", 0, (0, 0, 1))]
    path = tmp_path / "a.bag"
    assert write_transforms(path, iter(stream), iter(fixed)) == 3
    buffer = tfdb.load(path)
    assert buffer.commit == 3
    assert buffer.samples("b")[0].tolist() == [5, 6]
    assert buffer.frame_info("d").is_static


def test_streams_that_cannot_be_written(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    half = tfdb.TransformStamped("a", "b", 1.5, (1, 2, 3))  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidStamp):
        write_transforms(path, [half])
    far = tfdb.TransformStamped("a", "b", 2**62, (1, 2, 3))
    with pytest.raises(tfdb.InvalidStamp):
        write_transforms(path.with_suffix(".mcap"), [far])
    with pytest.raises(tfdb.errors.RecordingError, match="no transform to write"):
        write_transforms(path, [])
    assert list(tmp_path.iterdir()) == []


def test_wrong_targets(store: tfdb.Buffer, tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    with pytest.raises(tfdb.errors.RecordingError, match=r"must end in \.bag, \.mcap or \.db3"):
        write_recording(tmp_path / "a.txt", store)
    with pytest.raises(tfdb.errors.RecordingError, match="holds no transform to write"):
        write_recording(path, tfdb.Buffer())
    with pytest.raises(tfdb.InvalidArgument, match="cannot be compressed"):
        write_recording(tmp_path / "a.db3", store, compress=True)
    path.write_text("precious")
    with pytest.raises(tfdb.errors.RecordingError, match="exists already") as caught:
        write_recording(path, store)
    assert caught.value.path == str(path)
    assert path.read_text() == "precious"
    assert write_recording(path, store, overwrite=True) > 100
    with pytest.raises(FileNotFoundError):
        write_recording(tmp_path / "none" / "a.bag", store)


def test_a_failed_write_leaves_nothing(store: tfdb.Buffer, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("precious")

    def stop() -> None:
        with RecordingWriter(path, overwrite=True) as writer:
            writer.write(b"\0\1\0\0\0\0\0\0", 5, topic="/tf")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop()
    assert path.read_text() == "precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]
    with pytest.raises(tfdb.errors.RecordingError, match="not open"):
        RecordingWriter(path, overwrite=True).write(b"", 5, topic="/tf")
