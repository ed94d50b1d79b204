"""Loaded recordings equal those decoded by rosbags."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as BagReader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import tfdb
from tfdb.recordings import LoadReport, Recording

TF_TYPES = {"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"}
Sample = tuple[str, str, int, tuple[float, ...], bool]

REAL = [
    ("panda/rosbagFrankaPanda.bag", 112, 23),
    ("panda/ros2", 112, 23),
    ("panda/ros2/rosbagFrankaPandaRos2.bag.db3", 112, 23),
    ("turtlebot3/rosbag2_turtlebot3_tf", 1083, 5),
    ("turtlebot_nav/tf_example.bag", 518, 3),
    ("turtlebot_nav/tf_example", 518, 3),
]


def decode_with_rosbags(path: Path) -> Iterator[Sample]:
    """Return all transforms of a recording: parent, child, stamp, pose, static."""
    ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    if ros1:
        for name in TF_TYPES:
            text = "geometry_msgs/TransformStamped[] transforms"
            store.register(get_types_from_msg(text, name))
    decode: Callable[[bytes, str], Any] = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    with (BagReader if ros1 else Ros2Reader)(path) as reader:
        wanted = [each for each in reader.connections if each.msgtype in TF_TYPES]
        for connection, _, data in reader.messages(connections=wanted):
            static = connection.topic.endswith("tf_static")
            for each in decode(data, connection.msgtype).transforms:
                stamp, move, turn = (
                    each.header.stamp,
                    each.transform.translation,
                    each.transform.rotation,
                )
                yield (
                    each.header.frame_id.removeprefix("/"),
                    each.child_frame_id.removeprefix("/"),
                    stamp.sec * 10**9 + stamp.nanosec,
                    (move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w),
                    static,
                )


def check_against(buffer: tfdb.Buffer, samples: list[Sample]) -> None:
    """Check that the store has exactly these samples; of those with one stamp, the last."""
    expected: dict[str, dict[int, tuple[str, tuple[float, ...]]]] = {}
    for parent, child, stamp, pose, static in samples:
        expected.setdefault(child, {})[0 if static else stamp] = parent, pose
    frames = {sample[0] for sample in samples} | set(expected)
    assert set(buffer.frames()) == frames
    for child, by_stamp in expected.items():
        stamps, poses, parents = buffer.samples(child)
        order = sorted(by_stamp)
        assert stamps.tolist() == order
        assert parents == [by_stamp[stamp][0] for stamp in order]
        raw = np.array([by_stamp[stamp][1] for stamp in order])
        raw[:, 3:] /= np.linalg.norm(raw[:, 3:], axis=1, keepdims=True)
        assert np.abs(poses - raw).max() < 1e-12


@pytest.mark.parametrize(("name", "messages", "frames"), REAL)
def test_real_recordings(shared_data: Path, name: str, messages: int, frames: int) -> None:
    path = shared_data / name
    samples = list(decode_with_rosbags(path))
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(path)
    assert (report.messages, report.refused, report.reasons) == (messages, 0, {})
    assert report.commits == buffer.commit == messages
    assert report.transforms == len(samples)
    assert len(buffer.frames()) == frames
    assert report.files == (str(path),)
    check_against(buffer, samples)


def test_example_recordings_hold_the_same(repository: Path) -> None:
    folder = repository / "examples" / "data"
    bag, mcap = tfdb.load(folder / "pr2.bag"), tfdb.load(folder / "pr2.mcap")
    assert bag.frames() == mcap.frames()
    assert len(bag.frames()) == 85
    for frame in bag.frames():
        for left, right in zip(bag.samples(frame), mcap.samples(frame), strict=True):
            assert np.array_equal(left, right)
    # Only the bag names the publishing node.
    assert bag.frame_info("odom").authority == "/localization"
    assert mcap.frame_info("odom").authority == "/tf"


Make = Callable[[Any, Path, Any], Path]


def bag(compression: str | None) -> Make:
    return lambda recorder, at, drive: recorder.bag(at / "a.bag", drive, compression)


def folder(plugin: str, mode: str) -> Make:
    return lambda recorder, at, drive: recorder.folder(at / "a", drive, plugin, mode)


def file_of(plugin: str, mode: str, suffix: str) -> Make:
    return lambda recorder, at, drive: next(
        recorder.folder(at / "a", drive, plugin, mode).glob(f"*{suffix}")
    )


CONTAINERS = {
    "bag": bag(None),
    "bag-bz2": bag("bz2"),
    "bag-lz4": bag("lz4"),
    "db3-folder": folder("sqlite3", "none"),
    "db3-folder-file-zstd": folder("sqlite3", "file"),
    "db3-folder-message-zstd": folder("sqlite3", "message"),
    "mcap-folder": folder("mcap", "none"),
    "mcap-folder-message-zstd": folder("mcap", "message"),
    "mcap-folder-file-zstd": folder("mcap", "file"),
    "db3": file_of("sqlite3", "none", ".db3"),
    "mcap": file_of("mcap", "none", ".mcap"),
    "mcap-zstd": file_of("mcap", "storage", ".mcap"),
}


@pytest.mark.parametrize("container", CONTAINERS)
def test_every_container(
    recorder: Any, messages: list[Any], tmp_path: Path, container: str
) -> None:
    path = CONTAINERS[container](recorder, tmp_path, messages)
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(path)
    samples = [
        (parent, child, stamp, tuple(pose), message.topic == "/tf_static")
        for message in messages
        for parent, child, stamp, pose in message.transforms
    ]
    assert (report.messages, report.commits) == (len(messages), len(messages))
    assert report.transforms == len(samples)
    assert (report.start, report.end) == (messages[0].received, messages[-1].received)
    assert {(t.name, t.messages, t.static) for t in report.topics} == {
        ("/tf", 600, False),
        ("/tf_static", 1, True),
    }
    assert 0 < report.seconds_reading_container < report.seconds
    check_against(buffer, samples)
    # Static transforms hold from the start, although they were recorded in the middle.
    first = messages[0].transforms[0][2]
    assert buffer.can_transform("odom", "camera", first)
    expected = ("/odometry", "/joints", "/model") if container.startswith("bag") else ("/tf",) * 3
    found = [buffer.frame_info(frame).authority for frame in ("base", "hand", "camera")]
    assert found[:2] == list(expected[:2])


def write_mcap(
    path: Path, recorder: Any, messages: list[Any], *, encoding: str = "cdr", **options: Any
) -> Path:
    """Write an MCAP file with the library `mcap`, whose options cover the whole format."""
    from mcap.writer import Writer

    profile = options.pop("profile", "ros2")
    reverse = options.pop("reverse", False)
    foreign = options.pop("foreign", False)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096, **options)
        writer.start(profile=profile, library="test")
        if foreign:
            schema = writer.register_schema("foxglove.Log", "protobuf", b"\xff\xfe\x00")
            log = writer.register_channel("/log", "protobuf", schema)
            writer.add_message(log, messages[0].received, b"\x01", messages[0].received)
        name = "tf2_msgs/msg/TFMessage" if encoding == "cdr" else "tf2_msgs/TFMessage"
        schema = writer.register_schema(name, "ros2msg" if encoding == "cdr" else "ros1msg", b"")
        channels: dict[str, int] = {}
        for message in reversed(messages) if reverse else messages:
            if message.topic not in channels:
                channels[message.topic] = writer.register_channel(message.topic, encoding, schema)
            data = recorder.encode(message, encoding)
            writer.add_message(channels[message.topic], message.received, data, message.received)
        writer.finish()
    return path


def mcap_corners() -> dict[str, dict[str, Any]]:
    from mcap.writer import CompressionType, IndexType

    return {
        "lz4": {"compression": CompressionType.LZ4},
        "zstd": {"compression": CompressionType.ZSTD},
        "no-chunks": {"use_chunking": False},
        "no-summary": {
            "index_types": IndexType.NONE,
            "repeat_channels": False,
            "repeat_schemas": False,
            "use_statistics": False,
            "use_summary_offsets": False,
        },
        "no-statistics": {"use_statistics": False},
        "no-message-index": {"index_types": IndexType.CHUNK},
        "no-summary-and-out-of-order": {
            "index_types": IndexType.NONE,
            "use_statistics": False,
            "reverse": True,
        },
        "out-of-order": {"reverse": True},
        "no-profile": {"profile": ""},
        "ros1": {"profile": "ros1", "encoding": "ros1"},
        "foreign-schemas": {"foreign": True},
    }


@pytest.mark.parametrize("corner", mcap_corners())
def test_corners_of_mcap(recorder: Any, messages: list[Any], tmp_path: Path, corner: str) -> None:
    path = write_mcap(tmp_path / "a.mcap", recorder, messages, **mcap_corners()[corner])
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(path)
    assert (report.messages, report.commits, report.refused) == (601, 601, 0)
    assert (report.start, report.end) == (messages[0].received, messages[-1].received)
    samples = [
        (parent, child, stamp, tuple(pose), message.topic == "/tf_static")
        for message in messages
        for parent, child, stamp, pose in message.transforms
    ]
    check_against(buffer, samples)


def test_old_type_of_bags(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "old.bag", messages, None, "tf/msg/tfMessage")
    assert tfdb.load(path).commit == len(messages)


def test_folder_without_metadata(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    half = len(messages) // 2
    late = recorder.folder(tmp_path / "a", messages[half:], "sqlite3")
    early = recorder.folder(tmp_path / "b", messages[:half], "mcap")
    shutil.copy(early / "b.mcap", late)
    (late / "metadata.yaml").unlink()
    buffer = tfdb.Buffer(history=None)
    assert buffer.load(late).messages == len(messages)
    # Files are read in the order of their start, so no sample is late.
    assert all(info.late == 0 for info in buffer.tree())


def test_metadata_that_does_not_fit_the_files(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    path = recorder.folder(tmp_path / "a", messages, "sqlite3")
    text = (path / "metadata.yaml").read_text()
    assert "message_count: 600" in text
    (path / "metadata.yaml").write_text(text.replace("message_count: 600", "message_count: 590"))
    assert tfdb.load(path).commit == len(messages)


@pytest.mark.parametrize("key", ["starting_time", "duration"])
def test_metadata_without_a_time(
    recorder: Any, messages: list[Any], tmp_path: Path, key: str
) -> None:
    path = recorder.folder(tmp_path / "a", messages, "sqlite3")
    text = (path / "metadata.yaml").read_text()
    cut = re.sub(rf"\n  {key}:\n    nanoseconds\w*: \d+", "", text, count=1)
    assert len(cut) < len(text)
    (path / "metadata.yaml").write_text(cut)
    assert tfdb.load(path).commit == len(messages)


def test_several_files_in_order_of_their_start(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    parts = [messages[:200], messages[200:400], messages[400:]]
    paths = [
        recorder.bag(tmp_path / "1.bag", parts[1]),
        recorder.folder(tmp_path / "2", parts[2]),
        recorder.bag(tmp_path / "3.bag", parts[0], "lz4"),
    ]
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(paths)
    assert report.files == (str(paths[2]), str(paths[0]), str(paths[1]))
    assert report.messages == len(messages)
    assert all(info.late == 0 for info in buffer.tree())


def other_names(messages: list[Any]) -> list[Any]:
    from copy import copy

    found = []
    for message in messages:
        renamed = copy(message)
        renamed.topic = f"/robot1{message.topic}"
        found.append(renamed)
    return found


@pytest.mark.parametrize(
    "topics",
    [
        None,
        {"/robot1/tf": "tf", "/robot1/tf_static": "tf_static"},
        ["/robot1/tf", "robot1/tf_static"],
    ],
)
def test_remapped_topics(recorder: Any, messages: list[Any], tmp_path: Path, topics: Any) -> None:
    path = recorder.bag(tmp_path / "a.bag", other_names(messages))
    buffer = tfdb.Buffer(history=None)
    assert buffer.load(path, topics=topics).messages == len(messages)
    assert buffer.frame_info("camera").is_static
    assert not buffer.frame_info("hand").is_static


def test_selected_topics(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages + other_names(messages))
    for topics in (["/tf_static"], "/tf_static", {"tf_static": "tf_static"}):
        buffer = tfdb.Buffer(history=None)
        assert buffer.load(path, topics=topics).messages == 1
        assert buffer.frames() == ["base", "camera"]
    buffer = tfdb.Buffer(history=None)
    # A topic with another name, read as static transforms.
    buffer.load(path, topics={"/robot1/tf_static": "/tf"})
    assert not buffer.frame_info("camera").is_static


def test_progress(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    seen: list[tuple[int, int]] = []
    tfdb.load(path, progress=lambda done, total: seen.append((done, total)))
    done, total = zip(*seen, strict=True)
    assert list(done) == sorted(done)
    assert set(total) == {2 * len(messages)}
    assert done[-1] == total[-1]


def test_refused_messages_are_counted(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    broken = list(messages)
    bad = [("odom", "base", 5, (0, 0, 0, 0, 0, 0, 2))]
    broken.insert(100, type(messages[0])("/tf", messages[100].received, bad, "/odometry"))
    conflict = [("base", "camera", 9, (0, 0, 0, 0, 0, 0, 1))]
    broken += [type(messages[0])("/tf", messages[-1].received + n, conflict) for n in range(3)]
    buffer = tfdb.Buffer(history=None)
    path = recorder.bag(tmp_path / "a.bag", broken)
    words = "3 transforms of frame 'camera' were refused with Static|1 transform of frame 'base'"
    with pytest.warns(tfdb.TfdbWarning, match=words) as warned:
        report = buffer.load(path)
    assert report.messages == len(broken)
    assert len(warned) == 2
    assert (report.commits, report.refused) == (len(messages), 4)
    assert report.refused_transforms == 4
    assert [(each.edge, each.count) for each in report.refused_edges] == [
        ("camera", 3),
        ("base", 1),
    ]
    assert report.reasons == {"InvalidTransform": 1, "StaticConflict": 3}
    assert set(report.first_refusals) == set(report.reasons)
    assert "camera" in report.first_refusals["StaticConflict"]


def test_the_error_of_refusals_alone_names_the_most_frequent(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    made = type(messages[0])
    bad = [("odom", "base", 5, (0, 0, 0, 0, 0, 0, 2))]
    worse = [("odom", "arm", 5, (0, 0, 0, 0, 0, 0, 2))]
    found = [made("/tf", 1, bad), made("/tf", 2, worse), made("/tf", 3, worse), made("/tf", 4, bad)]
    path = recorder.bag(tmp_path / "a.bag", [*found, made("/tf", 5, worse)])
    words = "all messages were refused; 3 transforms of frame 'arm'"
    with pytest.raises(tfdb.errors.RecordingError, match=words):
        tfdb.load(path)


@pytest.mark.parametrize("kind", ["bag", "folder"])
def test_messages_since_a_time_of_reception(
    recorder: Any, messages: list[Any], tmp_path: Path, kind: str
) -> None:
    with Recording(getattr(recorder, kind)(tmp_path / "a.bag", messages)) as recording:
        found = list(recording.messages())
        for since in (found[0][1], found[150][1], found[150][1] + 1, found[-1][1] + 1):
            assert list(recording.messages(since=since)) == [m for m in found if m[1] >= since]


@pytest.mark.parametrize("kind", ["bag", "mcap", "sqlite3"])
def test_a_recording_is_closed(
    recorder: Any, messages: list[Any], tmp_path: Path, kind: str
) -> None:
    def files() -> int:
        """List the open files of this process."""
        open_files = Path("/proc/self/fd").iterdir()
        return sum(
            each.is_symlink() and str(tmp_path) in str(each.readlink()) for each in open_files
        )

    if kind == "bag":
        path = recorder.bag(tmp_path / "a.bag", messages)
    else:
        path = recorder.folder(tmp_path / "a", messages, kind)
    with Recording(path) as recording:
        assert list(recording.messages())
        assert files()
    assert not files()


def test_a_recording_by_itself(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    with Recording(path) as recording:
        assert {(t.name, t.type, t.messages) for t in recording.topics} == {
            ("/tf", "tf2_msgs/msg/TFMessage", 600),
            ("/tf_static", "tf2_msgs/msg/TFMessage", 1),
        }
        assert {source.authority for source in recording.sources} == {
            "/odometry",
            "/joints",
            "/model",
        }
        assert recording.start == messages[0].received
        found = list(recording.messages())
        only = list(recording.messages(lambda source: source.authority == "/joints"))
    assert [(s.topic, s.authority, at) for s, at, _ in found] == [
        (m.topic, m.callerid, m.received) for m in messages
    ]
    assert [data for _, _, data in found] == [recorder.encode(m, "ros1") for m in messages]
    assert len(only) == 300


def test_the_report_has_the_time_it_took(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    report = tfdb.Buffer(history=None).load([str(path)])
    assert isinstance(report, LoadReport)
    assert report.seconds > 0


def test_reports_print_in_one_line(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    report = replace(tfdb.Buffer(history=None).load(path, exclude="hand"), seconds=0.25)
    assert str(report) == (
        f"{path}: 601 transforms in 601 messages, loaded in 250 ms; 300 transforms left out"
    )
    track = tmp_path / "track.tum"
    track.write_text("1 1 2 3 0 0.6 0 0.8\n1 1 2 3 0 0.6 0 0.8\nno row\n")
    with pytest.warns(tfdb.TfdbWarning):
        report = tfdb.Buffer(history=None).load(track, salvage=True)
    rows = (
        "3 rows, 1 with a repeated stamp (the last row counts), 1 skipped (line 3: 2 columns "
        "instead of `seconds x y z qx qy qz qw`)"
    )
    told = str(replace(report, seconds=0.25))
    assert told == f"{track}: 1 transform, loaded in 250 ms; {rows}"
    assert str(report.trajectories[0]) == f"{track}: {rows}"


def test_senders_of_single_messages(recorder: Any, messages: list[Any]) -> None:
    payloads = [recorder.encode(message, "cdr") for message in messages[:4]]
    senders = ["/a", "/b", "/c", "/d"]
    buffer = tfdb.Buffer(history=None)
    result = buffer.ingest_many(payloads, encoding="cdr", authority=senders)
    assert (result.messages, result.refused) == (4, 0)
    assert buffer.frame_info("base").authority == "/c"
    assert buffer.frame_info("hand").authority == "/d"
    for wrong in (senders[:3], [*senders, "/e"]):
        with pytest.raises(tfdb.InvalidArgument, match="one for each"):
            buffer.ingest_many(payloads, encoding="cdr", authority=wrong)
    with pytest.raises(tfdb.InvalidArgument, match="one for each"):
        buffer.ingest_many(iter(payloads), encoding="cdr", authority=senders)
    assert buffer.commit == 4


def test_dropped_samples_are_counted(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)  # three seconds, 100 samples each
    buffer = tfdb.Buffer(history=1)
    with pytest.warns(tfdb.TfdbWarning, match=r"Buffer\(history=None\) keeps everything") as said:
        report = buffer.load(path)
    assert said[0].filename == __file__
    kept = sum(info.samples for info in buffer.tree() if info.oldest is not None)
    assert report.forgotten == 900 - kept > 500
    assert (report.transforms, report.refused) == (901, 0)
    for keeps in (tfdb.Buffer(history=None), tfdb.Buffer(history=3)):
        assert keeps.load(path).forgotten == 0


def test_too_old_samples_are_counted(recorder: Any, messages: list[Any], tmp_path: Path) -> None:
    late = [*messages[300:], *messages[:300]]
    for number, message in enumerate(late):
        late[number] = type(message)(
            message.topic, messages[number].received, message.transforms, message.callerid
        )
    path = recorder.bag(tmp_path / "a.bag", late)
    buffer = tfdb.Buffer(history=1)
    with pytest.warns(tfdb.TfdbWarning, match="samples are not kept"):
        report = buffer.load(path)
    assert set(report.reasons) == {"TooOld"}
    kept = sum(info.samples for info in buffer.tree() if info.oldest is not None)
    assert report.forgotten == 900 - kept


def test_repeated_samples_are_not_forgotten(
    recorder: Any, messages: list[Any], tmp_path: Path
) -> None:
    path = recorder.bag(tmp_path / "a.bag", [each for each in messages for _ in range(2)])
    assert tfdb.Buffer(history=10).load(path).forgotten == 0


@pytest.mark.parametrize("role", ["foo", "/robot1/tff", "", "/", "tf_static/x"])
def test_a_topic_is_read_as_moving_or_static(recorder: Any, tmp_path: Path, role: str) -> None:
    path = recorder.bag(tmp_path / "a.bag", [])
    with pytest.raises(tfdb.InvalidArgument, match="only as tf or tf_static"):
        tfdb.load(path, topics={"/tf": role})


@pytest.mark.parametrize("role", ["tf_static", "/tf_static/", "/robot1/tf_static"])
def test_static_by_the_last_part_of_the_new_name(
    recorder: Any, messages: list[Any], tmp_path: Path, role: str
) -> None:
    path = recorder.bag(tmp_path / "a.bag", other_names(messages))
    buffer = tfdb.load(path, topics={"/robot1/tf_static": role})
    assert buffer.frame_info("camera").is_static


@pytest.mark.parametrize("topics", [{"/tf": 5}, {5: "/tf"}, [5], 5, [b"/tf"]])
def test_topics_are_names(recorder: Any, tmp_path: Path, topics: Any) -> None:
    path = recorder.bag(tmp_path / "a.bag", [])
    with pytest.raises(tfdb.InvalidArgument, match="topics must be names"):
        tfdb.load(path, topics=topics)


@pytest.mark.parametrize("topics", [[], (), {}, iter(())])
def test_no_topics(recorder: Any, messages: list[Any], tmp_path: Path, topics: Any) -> None:
    path = recorder.bag(tmp_path / "a.bag", messages)
    with pytest.raises(
        tfdb.InvalidArgument, match=r"topics is empty: .*its topics: /tf "
    ) as caught:
        tfdb.load(path, topics=topics)
    assert caught.value.path == str(path)
