"""Growing MCAP files: the loaded parts equal those of the whole file."""

from __future__ import annotations

import io
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

import tfdb
from tfdb.recordings.mcap_reader import GrowingMcap

S = 10**9
MCAP = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.mcap"


def written(*, chunks: bool = True, count: int = 60) -> bytes:
    """Write a file with small chunks, or without chunks, and a channel that begins late."""
    raw = io.BytesIO()
    writer = McapWriter(raw, chunk_size=400, compression=CompressionType.ZSTD, use_chunking=chunks)
    writer.start()
    schema = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"")
    tf = writer.register_channel("/tf", "cdr", schema)
    late = None
    for number in range(count):
        at = (number + 1) * S
        pose = (number, 1.0, 2.0), (0.0, 0.0, 0.6, 0.8)
        data = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", at, *pose)])
        writer.add_message(tf, at, data, at)
        if number == count // 2:
            late = writer.register_channel("/tf_static", "cdr", schema)
            data = tfdb.encode_tf_message([tfdb.TransformStamped("base", "eye", 0, *pose)])
            writer.add_message(late, at, data, at)
    writer.finish()
    return raw.getvalue()


@pytest.fixture
def grow(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A clock for `follow_recording`: each sleep runs the next step at once."""
    now = [0.0]
    steps: list[Any] = []

    def sleep(seconds: float) -> None:
        now[0] += seconds
        if steps:
            steps.pop(0)()

    clock = SimpleNamespace(sleep=sleep, monotonic=lambda: now[0], perf_counter=lambda: now[0])
    monkeypatch.setattr("tfdb.recordings.following.time", clock)
    return steps


@pytest.mark.parametrize("chunks", [True, False])
def test_every_prefix_gives_its_complete_messages(chunks: bool, tmp_path: Path) -> None:
    whole = written(chunks=chunks)
    path = tmp_path / "run.mcap"
    path.write_bytes(b"")
    file = GrowingMcap(path)
    found: list[tuple[int, int, bytes]] = []
    seen = []
    try:
        with path.open("ab", buffering=0) as out:
            for at in range(0, len(whole), 7):
                out.write(whole[at : at + 7])
                for messages, _ in file.read():
                    found += [messages[index] for index in range(len(messages))]
                seen.append(len(found))
                assert file.is_complete == (at + 7 >= len(whole))
    finally:
        file.close()
    path.write_bytes(whole)
    with tfdb.recordings.Recording(path) as recording:
        expected = [(at, data) for _, at, data in recording.messages()]
    assert [(at, data) for at, _, data in found] == expected
    assert len(set(seen)) > 5


def test_it_ends_at_the_footer(grow: Any, tmp_path: Path) -> None:
    whole, path = written(), tmp_path / "run.mcap"
    path.write_bytes(whole[:300])
    buffer = tfdb.Buffer(history=None)
    samples: list[int] = []

    def piece(size: int) -> Any:
        def step() -> None:
            samples.append(buffer.frame_info("base").samples if "base" in buffer.frames() else 0)
            path.write_bytes(whole[:size])

        return step

    grow += [piece(size) for size in range(500, len(whole), 500)] + [piece(len(whole))]
    report = tfdb.recordings.follow_recording(buffer, path, prefix="r/")
    assert not grow
    assert len(set(samples)) == 1  # the frame names have a prefix
    assert (report.messages, report.commits, report.forgotten) == (61, 61, 0)
    assert {topic.name: topic.messages for topic in report.topics} == {"/tf": 60, "/tf_static": 1}
    loaded = tfdb.load(path, prefix="r/")
    for frame in ("r/base", "r/eye"):
        ours, theirs = buffer.samples(frame), loaded.samples(frame)
        assert np.array_equal(ours[0], theirs[0])
        assert np.array_equal(ours[1], theirs[1])


def test_other_processes_read_loaded_messages(grow: Any, tmp_path: Path) -> None:
    whole, path = written(), tmp_path / "run.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    buffer = tfdb.Buffer(history=5.0)
    samples: list[int] = []

    def half() -> None:
        samples.append(buffer.frame_info("base").newest or 0)
        path.write_bytes(whole)

    grow.append(half)
    tfdb.recordings.follow_recording(buffer, path, topics="/tf", start=0)
    assert S < samples[0] < 60 * S
    assert buffer.frames() == ["base", "map"]
    assert buffer.frame_info("base").newest == 60 * S
    assert buffer.frame_info("base").samples < 10  # the store's history


def test_a_real_recording_in_pieces(grow: Any, tmp_path: Path) -> None:
    whole, path = MCAP.read_bytes(), tmp_path / "run.mcap"
    path.write_bytes(b"")
    rng = np.random.default_rng(2)
    cuts = [*sorted(rng.integers(0, len(whole), 30).tolist()), len(whole)]
    grow += [lambda size=size: path.write_bytes(whole[:size]) for size in cuts]
    buffer = tfdb.Buffer(history=None)
    report = tfdb.recordings.follow_recording(buffer, path, timeout=100)
    loaded = tfdb.load(MCAP)
    assert report.messages == 750
    assert buffer.tree() == loaded.tree()


def test_a_writer_that_stopped(grow: Any, tmp_path: Path) -> None:
    whole, path = written(), tmp_path / "run.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    buffer = tfdb.Buffer(history=None)
    words = "not grown for 3 s and has no end: its writer stopped; salvage=True"
    with pytest.raises(tfdb.errors.RecordingError, match=words):
        tfdb.recordings.follow_recording(buffer, path, timeout=3, interval=0.5)
    assert 0 < buffer.frame_info("base").samples < 60


def test_the_timeout_counts_since_the_last_growth(grow: Any, tmp_path: Path) -> None:
    whole, path = written(), tmp_path / "run.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    looks: list[None] = []
    grow += [lambda: looks.append(None)] * 5
    grow.append(lambda: path.write_bytes(whole[:-100]))  # after 3 s
    grow += [lambda: looks.append(None)] * 100
    with pytest.raises(tfdb.errors.RecordingError, match="not grown for 3 s"):
        tfdb.recordings.follow_recording(tfdb.Buffer(), path, timeout=3, interval=0.5)
    assert len(looks) == 5 + 7  # the last one is 3.5 s after the growth


def test_other_files_cannot_be_followed(grow: Any, tmp_path: Path) -> None:
    whole, path = written(), tmp_path / "run.mcap"
    buffer = tfdb.Buffer(history=None)
    path.write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(tfdb.errors.RecordingError, match="not an MCAP file"):
        tfdb.recordings.follow_recording(buffer, path)
    path.write_bytes(whole[:600])
    grow.append(lambda: path.write_bytes(whole[:100]))
    with pytest.raises(tfdb.errors.RecordingError, match="shrank from 600 to 100 bytes"):
        tfdb.recordings.follow_recording(buffer, path)
    damaged = bytearray(whole)
    damaged[whole.index(b"zstd") + 20] ^= 255
    path.write_bytes(damaged)
    with pytest.raises(tfdb.errors.RecordingError, match="damaged"):
        tfdb.recordings.follow_recording(buffer, path)
    path.write_bytes(whole[:8] + b"\0" * 50)
    with pytest.raises(tfdb.errors.RecordingError, match="no record at 8"):
        tfdb.recordings.follow_recording(buffer, path)
    with pytest.raises(FileNotFoundError):
        tfdb.recordings.follow_recording(buffer, tmp_path / "none.mcap")
    os.mkfifo(tmp_path / "pipe.mcap")
    for what in (tmp_path / "pipe.mcap", tmp_path):
        with pytest.raises(tfdb.errors.RecordingError, match="not a regular file"):
            tfdb.recordings.follow_recording(buffer, what, timeout=1)
    with pytest.raises(TypeError, match="buffer must be a Buffer"):
        tfdb.recordings.follow_recording(None, path)  # type: ignore[arg-type]
    path.write_bytes(whole)
    for options, words in (
        ({"frames": "map"}, "frames: not valid while the file is"),
        ({"keep": 1, "start": "+1"}, "keep, start as an offset: not valid"),
        ({"timeout": 0}, "timeout must be a positive number of seconds, got 0"),
        ({"interval": "1"}, "interval must be a positive number of seconds, got '1'"),
    ):
        with pytest.raises(tfdb.InvalidArgument, match=words):
            tfdb.recordings.follow_recording(buffer, path, **options)


def test_topics_that_never_came_are_named(grow: Any, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(written())
    buffer = tfdb.Buffer(history=None)
    for options in ({"topics": "/nope"}, {"pose_topics": "/nope"}):
        with pytest.raises(tfdb.errors.RecordingError, match="no topic '/nope'; its topics: /tf "):
            tfdb.recordings.follow_recording(buffer, path, **options)
    with pytest.raises(tfdb.errors.RecordingError, match=r"'/tf' holds .*, not poses"):
        tfdb.recordings.follow_recording(tfdb.Buffer(), path, topics=(), pose_topics="/tf")
