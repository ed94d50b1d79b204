"""`tfdb.Recorder`: what is in its files, and that stores made of them are equal."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import tfdb
from tests.test_changes import NAMES, SEEDS, Writer, pose
from tfdb import errors
from tfdb._core import commit_of_messages, messages_of_commits
from tfdb.judging.proposing import judge_recording, recorded_arrivals
from tfdb.recorder import mcap_file

from .reading import Message, applied, messages_of, metadata_of, state_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
TF = ("/tf", "/tf_static")


def contents(path: Path) -> list[Message]:
    """The TFMessages of the recorded commits: without time and number."""
    return [each._replace(time=0, sequence=0) for each in messages_of(path, *TF)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_recording_that_is_applied_and_recorded_again_is_equal(tmp_path: Path, seed: int) -> None:
    history = 60e-9 if seed % 2 else None
    source, copy = tfdb.Buffer(history=history), tfdb.Buffer(history=history)
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    writer = Writer(seed)
    with tfdb.Recorder(source, first) as recorder:
        for number in range(1500):
            writer.act(source)
            if number % 7 == 0:
                source.set_transform("map", "late", 5 + number % 3, *pose(number), authority="x")
            if number % 100 == 99:
                recorder.flush()
    assert writer.refused > 10
    with tfdb.Recorder(copy, second) as again:
        applied(first, copy)
        assert state_of(copy) == state_of(source)
    assert again.commits == recorder.commits > 500
    assert contents(second) == contents(first)
    assert len(messages_of(second, "/tfdb/commits")) == len(messages_of(first, "/tfdb/commits"))
    assert state_of(applied(second, tfdb.Buffer(history=history))) == state_of(source)


def test_the_messages_of_a_file(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("base", "camera", (0.2, 0, 1.1))
    buf.set_transform("map", "odom", 5, *pose(1), authority="amcl")
    buf.set_transform("map", "odom", 9, *pose(2), authority="amcl")
    path = tmp_path / "drive.mcap"
    with tfdb.Recorder(buf, path) as recorder:
        assert (tmp_path / "drive.mcap.part").exists()
        assert not path.exists()
        buf.set_transform("odom", "base", 10, *pose(3))
        with buf.transaction() as tx:
            tx.set_transform("odom", "base", 12, *pose(4))
            tx.set_static_transform("base", "lidar", (0, 0, 1))
        buf.set_transform("odom", "base", 14, *pose(5), authority="ekf")
        buf.remove_frames("lidar")
        assert recorder.flush() == buf.commit
    found = messages_of(path)
    assert [(each.topic, each.sequence) for each in found] == [
        ("/tfdb/state", 3),
        ("/tf_static", 3),
        ("/tf", 3),
        ("/tf", 4),
        ("/tf_static", 5),
        ("/tf", 5),
        ("/tfdb/commits", 6),
        ("/tf", 6),
        ("/tfdb/commits", 7),
    ]
    assert [each.child for each in found[1].transforms] == ["camera"]
    assert [(each.child, each.stamp) for each in found[2].transforms] == [("odom", 9)]
    transform = found[3].transforms[0]
    assert (*transform.translation, *transform.rotation) == (*pose(3)[0], *pose(3)[1])
    assert sorted(each.time for each in found) == [each.time for each in found]
    assert (recorder.commits, recorder.lost, recorder.files) == (4, 0, (path,))
    assert recorder.size == path.stat().st_size
    assert recorder.ended
    assert list(tmp_path.iterdir()) == [path]


def test_readers_of_others_and_ours(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("base", "camera", (0.2, 0, 1.1))
    path = tmp_path / "drive.mcap"
    with tfdb.Recorder(buf, path):
        for i in range(100):
            buf.set_transform("map", "base", 10**9 + i, *pose(i), authority="slam")
    with AnyReader([path]) as reader:
        topics = {each.topic: (each.msgtype, each.msgcount) for each in reader.connections}
        assert topics["/tf"] == ("tf2_msgs/msg/TFMessage", 100)
        assert topics["/tfdb/commits"] == ("std_msgs/msg/UInt8MultiArray", 100)
        connections = [each for each in reader.connections if each.topic == "/tf_static"]
        ((connection, _, data),) = reader.messages(connections)
        message: Any = reader.deserialize(data, connection.msgtype)
        assert message.transforms[0].transform.translation.z == 1.1
    loaded = tfdb.load(path)
    assert loaded.frame_info("base").samples == 100
    assert np.array_equal(loaded.samples("base")[1], buf.samples("base")[1])
    written = tmp_path / "again.bag"
    tfdb.recordings.write_recording(written, loaded)
    grown = tfdb.Buffer(history=None)
    tfdb.recordings.follow_recording(grown, path)
    assert grown.frame_info("base").samples == 100


def test_each_commit_of_many_threads_is_recorded_once(tmp_path: Path) -> None:
    buf = tfdb.Buffer(history=1e-3)
    path = tmp_path / "drive.mcap"

    def write(number: int) -> None:
        for stamp in range(3000):
            buf.set_transform("map", f"f{number}", stamp * 1000, *pose(stamp))

    threads = [threading.Thread(target=write, args=(number,)) for number in range(4)]
    with tfdb.Recorder(buf, path, flush=0.01) as recorder:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert recorder.lost == 0
    found = messages_of(path, "/tf")
    assert [each.sequence for each in found] == list(range(1, 12_001))


def test_a_chunk_holds_whole_commits(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    frames = [f"f{number:03}" for number in range(500)]
    stamps = np.zeros(500, dtype=np.int64)
    poses = np.random.default_rng(1).normal(size=(500, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    path = tmp_path / "drive.mcap"
    with tfdb.Recorder(buf, path, flush=60.0):
        for stamp in range(100):
            batch = tfdb.Columns(["map"] * 500, frames, stamps + stamp, poses)
            buf.set_transforms(batch, authority="all")
    data = path.read_bytes()
    part = tmp_path / "cut.mcap.part"
    seen = set()
    for size in range(len(data) // 10, len(data), len(data) // 10):
        part.write_bytes(data[:size])
        found = messages_of(part)
        by_topic = [{m.sequence for m in found if m.topic == t} for t in ("/tf", "/tfdb/commits")]
        assert by_topic[0] == by_topic[1]
        seen.add(len(by_topic[0]))
        copy = tfdb.Buffer()
        for each in tfdb.recorded_commits(part, salvage=True):
            copy.apply(each.data)
        last = max(by_topic[0], default=0)
        assert copy.lookup_latest_transform("map", "f000").stamp == last - 1 if last else True
    assert len(seen) > 4
    with pytest.raises(tfdb.errors.RecordingError, match="salvage"):
        list(tfdb.recorded_commits(part))


def test_a_removed_file_ends_the_recording_at_its_next_flush(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    recorder = tfdb.Recorder(buf, tmp_path / "drive.mcap")
    buf.set_transform("map", "base", 1, *STILL)
    (tmp_path / "drive.mcap.part").unlink()
    with pytest.raises(errors.RecordingError, match=r"drive\.mcap\.part.*was removed"):
        recorder.flush()
    with pytest.raises(errors.RecordingError, match="was removed"):
        recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_frames_exclude_and_rename(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("base", "camera", (1, 0, 0), authority="urdf")
    buf.set_static_transform("camera", "lens", (2, 0, 0))

    def drive(path: Path, **options: Any) -> tfdb.Buffer:
        with tfdb.Recorder(buf, path, **options):
            for i in range(3):
                stamp = buf.commit * 10
                with buf.transaction() as tx:
                    tx.set_transform("map", "base", stamp, *pose(i))
                    tx.set_transform("base", "arm", stamp, *pose(i), authority="joints")
            buf.clear()
        return applied(path)

    some = drive(tmp_path / "frames.mcap", frames=["base", "lens"])
    assert some.frames() == ["base", "camera", "lens", "map"]
    assert some.parent_of("camera") is None
    assert len(messages_of(tmp_path / "frames.mcap", "/tfdb/commits")) == 1, "of the clear"
    others = drive(tmp_path / "exclude.mcap", exclude=["cam*", "lens"])
    assert others.frames() == ["arm", "base", "map"]
    under = drive(tmp_path / "under.mcap", exclude="cam*")
    assert under.frames() == ["arm", "base", "camera", "lens", "map"]
    assert under.parent_of("camera") is None
    assert len(messages_of(tmp_path / "exclude.mcap", "/tfdb/commits")) == 4
    named = drive(tmp_path / "rename.mcap", rename={"base": "z/base", "map": "world"})
    assert named.frames() == ["arm", "camera", "lens", "world", "z/base"]
    assert named.frame_info("camera").authority == "urdf"
    loaded = tfdb.load(tmp_path / "rename.mcap")
    assert loaded.lookup_latest_transform("z/base", "lens").translation.tolist() == [3, 0, 0]
    assert loaded.parent_of("z/base") == "world"
    with pytest.warns(tfdb.TfdbWarning, match="the options name 'nowhere', but"):
        drive(tmp_path / "none.mcap", frames=["base", "nowhere"])
    recorder = tfdb.Recorder(buf, tmp_path / "same.mcap", rename={"map": "joint"})
    buf.set_transform("map", "joint", 1, *STILL)
    with pytest.raises(tfdb.InvalidArgument, match="would have the same name, 'joint'"):
        recorder.close()
    assert applied(tmp_path / "same.mcap").frames() == ["arm", "base", "camera", "joint", "lens"]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    "options",
    [
        {"frames": NAMES[:3]},
        {"exclude": NAMES[:2]},
        {"frames": NAMES[2:5], "rename": {NAMES[2]: "zz", NAMES[6]: "aa"}},
    ],
)
def test_chosen_edges_are_equal(tmp_path: Path, seed: int, options: dict[str, Any]) -> None:
    buf = tfdb.Buffer(history=None)
    writer = Writer(seed)
    for _ in range(50):
        writer.act(buf)
    with tfdb.Recorder(buf, tmp_path / "drive.mcap", **options):
        for _ in range(300):
            writer.act(buf)
    copy = applied(tmp_path / "drive.mcap")
    names = options.get("rename", {})
    kept = set(options.get("frames", NAMES)) - set(options.get("exclude", ()))
    for frame in kept & set(buf.frames()):
        theirs, ours = buf.frame_info(frame), copy.frame_info(names.get(frame, frame))
        assert ours.parent == (theirs.parent and names.get(theirs.parent, theirs.parent))
        assert (ours.newest, ours.is_static) == (theirs.newest, theirs.is_static)
    for frame in set(NAMES) - kept:
        if copy.frame_exists(names.get(frame, frame)):
            assert copy.parent_of(names.get(frame, frame)) is None


def test_split_files_begin_with_the_state(tmp_path: Path) -> None:
    buf = tfdb.Buffer(history=None)
    buf.set_static_transform("base", "camera", (1, 0, 0), authority="urdf")
    path = tmp_path / "drive.mcap"
    rng = np.random.default_rng(2)
    with tfdb.Recorder(buf, path, split_size=20_000, flush=0) as recorder:
        stamp = 0
        while len(recorder.files) < 3:
            for _ in range(50):
                stamp += 1
                buf.set_transform("map", "base", stamp, rng.normal(size=3), STILL[1])
            buf.clear()
            recorder.flush()
    files = list(recorder.files)
    assert files[:2] == [tmp_path / "drive_0.mcap", tmp_path / "drive_1.mcap"]
    assert sorted(tmp_path.iterdir()) == files
    assert state_of(applied(files)) == state_of(applied([*files[1:], files[0]])) == state_of(buf)
    for each in files:
        assert applied(each).frame_info("camera").authority == "urdf"
        assert messages_of(each)[0].topic == "/tfdb/state"
        assert "camera" in tfdb.load(each).frames()
    assert all(each.stat().st_size >= 20_000 for each in files[:-1])
    assert recorder.size == sum(each.stat().st_size for each in files)


def test_a_split_ends_no_silence_when_it_is_judged(tmp_path: Path) -> None:
    """The newest samples that begin each file have not arrived again."""
    buf, second = tfdb.Buffer(), 10**9
    files = [tmp_path / f"drive_{number}.mcap" for number in range(3)]
    for number, path in enumerate(files):
        file = mcap_file.McapFile(path, tmp_path, sync=False)
        with buf.snapshot() as held:
            state = held.state_bytes(newest=1)
        begun = (10 + 2 * number) * second
        (whole,) = messages_of_commits(state, 0, None)
        file.write(begun, whole, is_state=True)
        for tick in range(20):
            stamp = begun + tick * second // 10 + 1
            children = ["base", "arm"] if number == 0 else ["base"]
            rows = [tfdb.TransformStamped("map", each, stamp, *pose(tick)) for each in children]
            buf.set_transforms(rows)
            file.write(stamp, (buf.commit, tfdb.encode_tf_message(rows), None, None))
        file.close()
    expected = tfdb.Expectations(default=tfdb.judging.Expectation(deadline=1.5))
    found = judge_recording(recorded_arrivals(files), expected)
    assert [(event.child, event.begins) for event in found] == [("arm", True)]
    alone = judge_recording(recorded_arrivals(files[1:]), expected)
    assert [(event.child, event.begins) for event in alone] == [("arm", True)]
    assert recorded_arrivals(files).log.count == 20 * (2 + 1 + 1)
    assert tfdb.load(files).frame_info("arm").samples == 20


def test_split_files_with_a_static_transform_that_changes_are_loaded(tmp_path: Path) -> None:
    def record(name: str, y: int) -> list[Path]:
        buf = tfdb.Buffer()
        with tfdb.Recorder(buf, tmp_path / name, split_size=1, flush=0) as recorder:
            while len(recorder.files) < 2:
                buf.set_static_transform("base", "camera", (buf.commit, y, 0))
                recorder.flush()
            buf.set_static_transform("base", "camera", (1000, y, 0))
        return list(recorder.files)

    files = record("drive.mcap", 0)
    loaded = tfdb.load(files[::-1])
    assert loaded.lookup_latest_transform("base", "camera").translation.tolist() == [1000, 0, 0]
    with pytest.raises(errors.MixedSources, match=r"drive_0\.mcap.*other_0\.mcap"):
        tfdb.load([files[0], record("other.mcap", 1)[0]])


def test_log_times_keep_the_order_of_commits_if_the_clock_is_set_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, behind = time.time_ns, [0]
    monkeypatch.setattr(time, "time_ns", lambda: system() - behind[0])
    buf = tfdb.Buffer()
    path = tmp_path / "drive.mcap"
    with tfdb.Recorder(buf, path) as recorder:
        for x, hours in enumerate((0, 1, 0, 2)):
            behind[0] = hours * 3600 * 10**9
            buf.set_static_transform("base", "camera", (x, 0, 0))
            recorder.flush()
    times = [each.time for each in messages_of(path)]
    assert times == sorted(times)
    assert times[-1] - times[0] < 3600 * 10**9
    assert tfdb.load(path).lookup_latest_transform("base", "camera").translation[0] == 3


def test_a_time_splits_files(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    with tfdb.Recorder(buf, tmp_path / "a.mcap", split_time=1e-6) as recorder:
        stamp = 0
        while len(recorder.files) < 2:
            stamp += 1
            buf.set_transform("map", "base", stamp, *STILL)
            recorder.flush()
    assert applied(list(recorder.files)).frame_info("base").newest == stamp


def test_a_recorder_that_only_loses_commits_splits_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lapped(*_: object, **__: object) -> bytes:
        raise errors.FeedLapped("the feed went on", oldest=1)

    buf = tfdb.Buffer()
    monkeypatch.setattr(tfdb.Buffer, "commits_bytes", lapped)
    recorder = tfdb.Recorder(buf, tmp_path / "a.mcap", split_time=1e-6)
    stamp = 0
    while len(recorder.files) < 3:
        stamp += 1
        buf.set_transform("map", "base", stamp, *STILL)
        recorder.flush()
    with pytest.warns(tfdb.TfdbWarning, match="were lost"):
        recorder.close()
    assert recorder.commits == 0
    assert recorder.lost == stamp


def test_a_name_that_exists_is_refused(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    path = tmp_path / "drive.mcap"
    path.write_text("mine")
    with pytest.raises(errors.RecordingError, match="exists already"):
        tfdb.Recorder(buf, path)
    path.unlink()
    part = tmp_path / "drive.mcap.part"
    part.write_text("mine")
    with pytest.raises(errors.RecordingError, match=r"drive\.mcap\.part: exists already"):
        tfdb.Recorder(buf, path)
    part.unlink()
    recorder = tfdb.Recorder(buf, path)
    path.write_text("mine")
    with pytest.raises(errors.RecordingError, match=r"complete in .*drive\.mcap\.part"):
        recorder.close()
    assert path.read_text() == "mine"
    assert applied(part).frames() == []
    next_one = tmp_path / "b_1.mcap"
    next_one.write_text("mine")
    recorder = tfdb.Recorder(buf, tmp_path / "b.mcap", split_time=1e-6)
    stamp = 0
    while not recorder.ended:
        stamp += 1
        buf.set_transform("map", "base", stamp, *STILL)
    with pytest.raises(errors.RecordingError, match=r"b_1\.mcap: exists already"):
        recorder.close()
    assert recorder.files == (tmp_path / "b_0.mcap",)
    assert "base" in applied(tmp_path / "b_0.mcap").frames()
    assert next_one.read_text() == "mine"


@pytest.fixture
def slow_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """A disk that takes nothing until the event is set."""
    ready = threading.Event()
    flush = mcap_file.McapFile.flush

    def wait(file: mcap_file.McapFile) -> None:
        assert ready.wait(60)
        flush(file)

    monkeypatch.setattr(mcap_file.McapFile, "flush", wait)
    yield ready
    ready.set()


def test_commits_that_the_disk_does_not_take_are_counted(
    tmp_path: Path, slow_disk: threading.Event
) -> None:
    buf = tfdb.Buffer(history=None)
    buf.set_static_transform("base", "camera", (1, 0, 0))
    path = tmp_path / "drive.mcap"
    recorder = tfdb.Recorder(buf, path, flush=0, queue=10_000)
    for stamp in range(500):  # several times what is read at once
        batch = [tfdb.TransformStamped("map", f"f{i}", stamp, *pose(stamp)) for i in range(100)]
        buf.set_transforms(batch, authority="slam")
    buf.clear()
    buf.set_transform("odom", "base", 6000, *pose(1), authority="slam")
    slow_disk.set()
    with pytest.warns(tfdb.TfdbWarning, match="were lost"):
        recorder.close()
    assert recorder.lost > 100
    assert recorder.commits + recorder.lost == 502
    lost = [about for name, about in metadata_of(path) if name == "tfdb.lost"]
    assert sum(int(each["commits"]) for each in lost) == recorder.lost
    with pytest.warns(tfdb.TfdbWarning, match=f"{recorder.lost} commits were lost when it was rec"):
        tfdb.load(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    with pytest.warns(tfdb.TfdbWarning, match=f"{recorder.lost} commits were lost when it was rec"):
        tfdb.load(path, salvage=True)
    path.write_bytes(whole)
    copy = applied(path)
    assert copy.frame_info("base").parent == "odom"
    assert copy.frame_info("base").authority == "slam"
    states = messages_of(path, "/tfdb/state")
    assert len(states) == len(lost) + 1
    assert {each.sequence for each in messages_of(path, "/tf_static")} == {
        each.sequence for each in states
    }


def test_a_buffer_that_is_closed_ends_the_recording(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    path = tmp_path / "drive.mcap"
    recorder = tfdb.Recorder(buf, path)
    buf.set_transform("map", "base", 1, *STILL)
    recorder.flush()
    buf.close()
    assert recorder.wait(60)
    with pytest.raises(errors.BufferClosed):
        recorder.close()
    recorder.close()
    assert applied(path).frames() == ["base", "map"]


def test_a_shared_store_that_is_removed_ends_the_recording(tmp_path: Path, name: str) -> None:
    path = tmp_path / "drive.mcap"
    with tfdb.Buffer.open(name) as writer:
        writer.set_transform("map", "base", 1, *STILL, authority="x")
        with tfdb.Buffer.open(name, create=False, mode="r") as reader:
            recorder = tfdb.Recorder(reader, path)
            writer.set_transform("map", "base", 2, *STILL, authority="x")
            recorder.flush()
            tfdb.Buffer.unlink(name)
            assert recorder.wait(60)
            with pytest.raises(errors.NoSuchStore):
                recorder.close()
    assert applied(path).frame_info("base").newest == 2


def test_a_child_of_fork_leaves_the_file_alone(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    path = tmp_path / "drive.mcap"
    with tfdb.Recorder(buf, path) as recorder:
        buf.set_transform("map", "base", 1, *STILL)
        recorder.flush()
        child = os.fork()
        if child == 0:
            for call in (recorder.flush, recorder.wait):
                with pytest.raises(errors.Forked):
                    call()
            recorder.close()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        assert not path.exists()
        buf.set_transform("map", "base", 2, *STILL)
    assert applied(path).frame_info("base").newest == 2


@pytest.mark.parametrize("is_closed", [False, True], ids=["open buffer", "closed buffer"])
def test_the_end_of_a_program_closes_a_recorder(tmp_path: Path, is_closed: bool) -> None:
    path = tmp_path / "drive.mcap"
    program = f"""
import tfdb
buf = tfdb.Buffer()
recorder = tfdb.Recorder(buf, {str(path)!r}, flush=1000)
for i in range(100):
    buf.set_transform("map", "base", i, (i, 0, 0))
if {is_closed}:
    buf.close()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert ("BufferClosed" in done.stderr) == is_closed
    assert not (tmp_path / "drive.mcap.part").exists()
    if not is_closed:
        assert applied(path).frame_info("base").samples == 100


@pytest.mark.parametrize("failing", ["tfdb recorder: reads", "tfdb recorder: writes"])
def test_an_interrupted_start_leaves_no_unfinished_file(
    failing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        if thread.name == failing:
            raise KeyboardInterrupt
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    buf = tfdb.Buffer()
    with pytest.raises(KeyboardInterrupt):
        tfdb.Recorder(buf, tmp_path / "drive.mcap")
    assert not list(tmp_path.iterdir())


def test_an_error_of_the_disk_is_raised_though_the_file_cannot_be_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(disk: Any, *_: object) -> None:
        raise OSError(5, "the first error" if disk.size else "the last error")

    thrown: list[Any] = []
    monkeypatch.setattr(threading, "excepthook", thrown.append)
    buf = tfdb.Buffer()
    recorder = tfdb.Recorder(buf, tmp_path / "drive.mcap")
    recorder.flush()
    monkeypatch.setattr(mcap_file._Disk, "write", fail)
    monkeypatch.setattr(mcap_file._Disk, "close", fail)
    buf.set_transform("map", "base", 1, *STILL)
    with pytest.raises(OSError, match="the first error"):
        recorder.close()
    assert len(thrown) == 1


def test_stamps_that_no_message_holds(tmp_path: Path) -> None:
    buf = tfdb.Buffer(history=None)
    path = tmp_path / "drive.mcap"
    far = 2**31 * 10**9
    with tfdb.Recorder(buf, path):
        buf.set_transform("map", "base", far, *STILL)
        with buf.transaction() as tx:
            tx.set_transform("map", "arm", 1, *STILL)
            tx.set_transform("map", "base", far + 1, *STILL)
    assert [(each.topic, each.sequence) for each in messages_of(path)] == [
        ("/tfdb/state", 0),
        ("/tfdb/commits", 1),
        ("/tfdb/commits", 2),
        ("/tf", 2),
    ]
    assert state_of(applied(path)) == state_of(buf)


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"flush": -1}, tfdb.InvalidArgument, "flush"),
        ({"queue": 0}, tfdb.InvalidArgument, "queue must be an integer of at least 1"),
        ({"split_size": 1.5}, tfdb.InvalidArgument, "split_size must be an integer of at least 1"),
        ({"split_time": float("nan")}, tfdb.InvalidArgument, "split_time"),
        ({"sync": "no"}, tfdb.InvalidArgument, "sync must be True or False"),
        ({"frames": []}, tfdb.InvalidArgument, "frames is empty"),
        ({"rename": "map"}, tfdb.InvalidArgument, "rename must map names"),
    ],
)
def test_bad_options(
    tmp_path: Path, options: dict[str, Any], error: type[Exception], text: str
) -> None:
    with pytest.raises(error, match=text):
        tfdb.Recorder(tfdb.Buffer(), tmp_path / "drive.mcap", **options)
    assert not list(tmp_path.iterdir())


def test_bad_buffers_and_paths(tmp_path: Path) -> None:
    nothing: Any = None
    with pytest.raises(TypeError, match="buffer must be a Buffer"):
        tfdb.Recorder(nothing, tmp_path / "drive.mcap")
    with pytest.raises(errors.RecordingError, match=r"must end in \.mcap"):
        tfdb.Recorder(tfdb.Buffer(), tmp_path / "drive.bag")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        tfdb.Recorder(tfdb.Buffer(), tmp_path / "nowhere" / "drive.mcap")
    with pytest.raises(errors.NotSupported):
        tfdb.Recorder(tfdb.Buffer(concurrency="fine"), tmp_path / "drive.mcap")
    assert not list(tmp_path.iterdir())


def test_files_that_no_recorder_wrote(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 1, *STILL)
    tfdb.recordings.write_recording(other, buf)
    with pytest.raises(errors.RecordingError, match="use tfdb"):
        list(tfdb.recorded_commits(other))
    rubbish = tmp_path / "rubbish.mcap"
    rubbish.write_bytes(b"rubbish" * 100)
    with pytest.raises(errors.RecordingError, match="damaged"):
        list(tfdb.recorded_commits(rubbish))
    with pytest.raises(FileNotFoundError):
        list(tfdb.recorded_commits(tmp_path / "nowhere.mcap"))
    path = tmp_path / "drive.mcap"
    with tfdb.Recorder(buf, path):
        for stamp in range(100):
            buf.set_transform("map", "base", stamp, *pose(stamp))
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(errors.RecordingError, match="damaged"):
        list(tfdb.recorded_commits(path))


def test_numbers_of_commits_go_on_beyond_32_bits(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 1, *STILL)
    with buf.snapshot() as snap:
        state = snap.state_bytes()
    one = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", 5, *STILL)])
    first = 2**32 - 2
    path = tmp_path / "drive.mcap"
    whole = commit_of_messages(state[8:32], 0, first, one, None)
    file = mcap_file.McapFile(path, tmp_path, sync=True)
    file.write(7, (1, None, None, state), is_state=True)
    file.write(8, (first, one, None, whole))
    for number in range(first + 1, first + 5):
        file.write(9, (number, one, None, None))
    file.close()
    found = list(tfdb.recorded_commits(path))
    assert [each.commit for each in found] == [1, *range(first, first + 5)]
    assert [each.sequence for each in messages_of(path, "/tf")] == [first, first + 1, 0, 1, 2]
    for each in found:
        buf.apply(each.data, source="other", prefix="other/")
    assert buf.positions()[0].commit == first + 4
