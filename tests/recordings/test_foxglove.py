"""Foxglove's transforms: loading without options, timestamps, and exports that load again.

foxglove-sdk, google.protobuf and rosbags make the messages, mcap the files.
"""

from __future__ import annotations

import json
import struct
import warnings
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter

import tfdb
from tfdb.data.decimal_time import rfc3339_ns
from tfdb.recordings import Recording, follow_recording
from tfdb.recordings.containers import Source
from tfdb.recordings.pose_messages import decode_poses

S = 1_000_000_000
START = 1_700_000_000 * S
CASES = Path(__file__).parents[1] / "cases"
ONE, SEVERAL = "foxglove.FrameTransform", "foxglove.FrameTransforms"
TURN = (0.6, 0.0, 0.0, 0.8)


def write_mcap(path: Path, messages: list[tuple[str, str, str, int, bytes]]) -> Path:
    """Write messages, each given by topic, type, encoding, log time and bytes."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channels: dict[str, int] = {}
        for topic, type_, encoding, received, data in messages:
            if topic not in channels:
                schema = writer.register_schema(type_, encoding, b"")
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], received, data, received)
        writer.finish()
    return path


def transform(x: float, parent: str = "odom", child: str = "base", **time: Any) -> dict[str, Any]:
    """Make a JSON message, with a `timestamp` if given."""
    return {
        **time,
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": {"x": x, "y": -2.0, "z": 0.0},
        "rotation": dict(zip("xyzw", TURN, strict=True)),
    }


def json_file(
    path: Path, messages: list[tuple[int, dict[str, Any]]], topic: str = "/poses"
) -> Path:
    return write_mcap(
        path, [(topic, ONE, "json", at, json.dumps(each).encode()) for at, each in messages]
    )


def check(buffer: tfdb.Buffer, parent: str, child: str, expected: dict[int, float]) -> None:
    """Check the stamps and the x of T[parent<-child]."""
    stamps, poses, parents = buffer.samples(child)
    assert dict(zip(stamps.tolist(), poses[:, 0].tolist(), strict=True)) == expected
    assert set(parents) == {parent}


@pytest.mark.parametrize(
    "name", ["pb_FrameTransform", "json_FrameTransforms", "json_iso", "pb_notime"]
)
@pytest.mark.filterwarnings("ignore:.*have no timestamp:tfdb.TfdbWarning")
def test_cases_load_without_an_option(name: str) -> None:
    expected = {START + i * 20_000_000: i * 0.02 for i in range(50)}
    buffer = tfdb.load(CASES / f"{name}.mcap")
    check(buffer, "odom", "base_link", expected)


def test_the_report_of_a_load(tmp_path: Path) -> None:
    messages = [(START + i, transform(i, timestamp={"sec": i, "nsec": 7})) for i in range(1, 5)]
    path = json_file(tmp_path / "a.mcap", messages)
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(path)
    assert (report.messages, report.transforms, report.refused) == (4, 4, 0)
    assert [(each.name, each.messages, each.static) for each in report.topics] == [
        ("/poses", 4, False)
    ]
    expected = {i * S + 7: float(i) for i in range(1, 5)}
    check(buffer, "odom", "base", expected)
    check(tfdb.load(path, topics="/poses"), "odom", "base", expected)
    check(tfdb.load(path, topics=(), pose_topics={"/poses": "tool"}), "odom", "tool", expected)
    assert tfdb.load(path, topics={"/poses": "tf_static"}).frame_info("base").is_static
    prefixed = tfdb.load(path, prefix="r/", start="+1")
    check(prefixed, "r/odom", "r/base", {at: x for at, x in expected.items() if at > 2 * S})


def test_they_are_read_beside_tf(tmp_path: Path) -> None:
    arm = tfdb.TransformStamped("base", "arm", 5 * S, (1.0, 2.0, 3.0), TURN)
    tf = ("/tf", "tf2_msgs/msg/TFMessage", "cdr", 1, tfdb.encode_tf_message([arm], "cdr"))
    data = json.dumps(transform(4.0, timestamp={"sec": 5, "nsec": 1})).encode()
    path = write_mcap(tmp_path / "a.mcap", [tf, ("/poses", ONE, "json", 2, data)])
    buffer = tfdb.load(path)
    check(buffer, "base", "arm", {5 * S: 1.0})
    check(buffer, "odom", "base", {5 * S + 1: 4.0})
    assert tfdb.load(path, topics="/tf").frames() == ["arm", "base"]
    assert tfdb.load(path, exclude="/poses").frames() == ["arm", "base"]
    other = ("/poses", ONE, "flatbuffer", 2, b"1234")
    assert tfdb.load(write_mcap(tmp_path / "b.mcap", [tf, other])).frames() == ["arm", "base"]


def test_an_encoding_that_is_not_read_is_named(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", [("/poses", ONE, "flatbuffer", 2, b"1234")])
    words = r"topic '/poses' is encoded as 'flatbuffer'; tfdb reads ros1, cdr, protobuf"
    for options in ({}, {"topics": "/poses"}, {"pose_topics": "/poses"}):
        with pytest.raises(tfdb.errors.RecordingError, match=words):
            tfdb.load(path, **options)  # type: ignore[arg-type]


# -- exports load back ----------------------------------------------------------------------------


def store() -> tfdb.Buffer:
    """Two moving edges, one with stamp 0, one that changes its parent, and a static chain."""
    rng = np.random.default_rng(3)
    poses = rng.normal(size=(40, 7))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    buf = tfdb.Buffer(history=None)
    stamps = np.arange(20) * 100_000_007
    buf.set_transforms(tfdb.Columns("map", "base", stamps, poses[:20]))
    buf.set_transforms(tfdb.Columns("map", "cup", stamps[:4] + 1, poses[20:24]))
    buf.set_transforms(tfdb.Columns("base", "cup", stamps[4:] + 1, poses[24:]))
    buf.set_static_transform("base", "größe", poses[0, :3], poses[1, 3:])
    buf.set_static_transform("größe", "eye", poses[2, :3], poses[3, 3:])
    return buf


def everything(buf: tfdb.Buffer) -> dict[str, tuple[Any, ...]]:
    """Return for each frame: whether it is static, stamps, poses and parents."""
    found = {}
    for info in buf.tree():
        stamps, poses, parents = buf.samples(info.name)
        times = None if info.is_static else stamps.tolist()
        found[info.name] = (info.is_static, times, poses.tolist(), list(parents))
    return found


@pytest.mark.parametrize("topic", ["/tf", "/robot/poses"])
def test_an_export_loads_back(topic: str, tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    path = tmp_path / "a.mcap"
    buf = store()
    tfdb.to_foxglove(buf, path, topic=topic)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        back = tfdb.load(path)
    found, expected = everything(back), everything(buf)
    assert found.keys() == expected.keys()
    assert [info.name for info in back.tree() if info.is_static] == ["eye", "größe"]
    for frame, (static, stamps, poses, parents) in expected.items():
        assert found[frame][:2] == (static, stamps), frame
        np.testing.assert_allclose(found[frame][2], poses, atol=1e-15, rtol=0)
        assert found[frame][3] == parents


def test_statics_alone_load_back(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    buf = tfdb.Buffer(history=None)
    buf.set_static_transform("base", "eye", (1.0, 2.0, 3.0), TURN)
    tfdb.to_foxglove(buf, tmp_path / "a.mcap")
    assert everything(tfdb.load(tmp_path / "a.mcap")) == everything(buf)


# -- times ----------------------------------------------------------------------------------------


def message_class() -> Any:
    """Make the protobuf class of `foxglove.FrameTransform` from foxglove-sdk's schema."""
    foxglove = pytest.importorskip("foxglove.messages")
    files = descriptor_pb2.FileDescriptorSet.FromString(foxglove.FrameTransform.get_schema().data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(ONE))


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
@pytest.mark.parametrize("names", ["camel", "snake"])
def test_messages_of_google_protobuf(encoding: str, names: str) -> None:
    """google.protobuf's JSON omits zeros, and writes times with 0, 3, 6 or 9 decimals."""
    kind = message_class()
    rng = np.random.default_rng(17)
    source = Source("/x", encoding, "/x", 1, ONE)  # type: ignore[arg-type]
    for digits in (0, 3, 6, 9) * 25:
        nanoseconds = int(rng.integers(10**digits)) * 10 ** (9 - digits)
        stamp = int(rng.integers(2**31)) * S + nanoseconds
        made = kind(parent_frame_id="map", child_frame_id="base")
        made.timestamp.FromNanoseconds(stamp)
        x, y, z = (rng.normal(size=3) * rng.integers(2, size=3)).tolist()
        made.translation.x, made.translation.y, made.translation.z = x, y, z
        made.rotation.x, made.rotation.w = 0.6, 0.8
        data = made.SerializeToString()
        if encoding == "json":
            snake = names == "snake"
            data = json_format.MessageToJson(made, preserving_proto_field_name=snake).encode()
        poses = decode_poses(data, source, None, 5)
        (found,) = poses.transforms
        assert (found.parent, found.child, found.stamp) == ("map", "base", stamp)
        assert (*found.translation, *found.rotation) == (x, y, z, *TURN)
        assert (poses.untimed, poses.refused) == (0, [])


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("1970-01-01T00:00:00Z", 0),
        ("2023-11-14T22:13:20.020Z", START + 20_000_000),
        ("2023-11-14t22:13:20.123456789z", START + 123_456_789),
        ("2023-11-14 22:13:20.000000001Z", START + 1),
        ("2023-11-15T03:43:20+05:30", START),
        ("2023-11-14T12:13:20.5-10:00", START + 500_000_000),
        ("2023-11-14T22:13:20-00:00", START),
        ("2024-02-29T23:59:59.999999999Z", 1_709_251_199 * S + 999_999_999),
        ("2023-11-14T22:13:20.0000000004Z", START),
        ("2023-11-14T22:13:20.9999999999Z", START + S),
    ],
)
def test_times_of_rfc_3339(text: str, stamp: int, tmp_path: Path) -> None:
    assert rfc3339_ns(text) == stamp
    path = json_file(tmp_path / "a.mcap", [(5, transform(1.0, timestamp=text))])
    check(tfdb.load(path), "odom", "base", {stamp: 1.0})


@pytest.mark.parametrize(
    "time", [{"sec": "5", "nsec": "7"}, {"sec": "5", "nsec": 7}, {"sec": 5, "nsec": "007"}]
)
def test_integers_of_a_time_as_text(time: Any, tmp_path: Path) -> None:
    """Protobuf's JSON mapping writes 64-bit integers as text."""
    path = json_file(tmp_path / "a.mcap", [(9, transform(1.0, timestamp=time))])
    check(tfdb.load(path), "odom", "base", {5 * S + 7: 1.0})


def test_times_of_rfc_3339_as_datetime_has_them() -> None:
    rng = np.random.default_rng(23)
    for _ in range(300):
        zone = timezone(timedelta(minutes=int(rng.integers(-1439, 1440))))
        microseconds = int(rng.integers(-(10**15), 4 * 10**15))
        moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=microseconds)
        assert rfc3339_ns(moment.astimezone(zone).isoformat()) == microseconds * 1000


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ("2023-11-14T22:13:20", "timestamp: '2023-11-14T22:13:20' has no time zone"),
        ("yesterday", "timestamp: 'yesterday' is not a time such as"),
        ("2023-13-14T22:13:20Z", "timestamp: .* is not a time: month must be in 1..12"),
        ("2023-02-29T22:13:20Z", "timestamp: .* is not a time: day is out of range"),
        ("2023-11-14T24:13:20Z", "timestamp: .* is not a time: hour must be in 0..23"),
        ("2023-11-14T22:13:20+24:00", "timestamp: .* is not a time: hour must be"),
        ("٢023-11-14T22:13:20Z", "timestamp: .* is not a time such as"),
        ("1969-12-31T23:59:59Z", "InvalidStamp: timestamp: -1 s and 0 ns are not a stamp"),
        ("2099-12-31T23:59:59Z", "InvalidStamp: timestamp: .* are not a stamp"),
        ({"sec": 5}, "timestamp.nsec is not an integer: None"),
        ({"sec": "5.0", "nsec": 0}, "timestamp.sec is not an integer: 5.0"),
        ({"sec": "five", "nsec": 0}, "timestamp.sec is not an integer: five"),
        ({"sec": 5, "nsec": ""}, "timestamp.nsec is not an integer: "),
        ({"sec": 5, "nsec": "1_0"}, "timestamp.nsec is not an integer: 1_0"),
        ({"sec": "\u0665", "nsec": 0}, "timestamp.sec is not an integer: \u0665"),
        ({"sec": True, "nsec": 0}, "timestamp.sec is not an integer: True"),
        ({"sec": "-5", "nsec": "0"}, "timestamp: -5 s and 0 ns are not a stamp"),
        ({"sec": 5, "nsec": 1.0}, "timestamp.nsec is not an integer: 1.0"),
        ({"sec": 5, "nsec": S}, "timestamp: 5 s and 1000000000 ns are not a stamp"),
        ({"sec": 5, "nsec": -1}, "timestamp: 5 s and -1 ns are not a stamp"),
        (1.7e9, "timestamp is neither an object of sec and nsec nor an RFC 3339 string"),
    ],
)
def test_a_time_that_cannot_be_read_names_its_field(time: Any, words: str, tmp_path: Path) -> None:
    path = json_file(tmp_path / "a.mcap", [(5, transform(1.0, timestamp=time))])
    with pytest.raises(tfdb.errors.RecordingError, match=words):
        tfdb.load(path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"parent_frame_id": 3}, "parent_frame_id is not a string"),
        ({"parent_frame_id": None}, "it names no parent frame"),
        ({"translation": 3}, "translation is not an object"),
        ({"translation": {"X": 3}}, "translation has none of the fields x, y, z"),
        ({"translation": {"x": "far"}}, "translation.x is not a number: 'far'"),
        ({"rotation": {"w": True}}, "rotation.w is not a number"),
        ({"rotation": {"w": [1]}}, "rotation.w is not a number"),
        ({"translation": {"x": 10**400}}, "translation.x is not a number"),
        ({"rotation": None}, "InvalidTransform"),
        ({"translation": {"x": "NaN"}}, "InvalidTransform"),
    ],
)
def test_fields_that_cannot_be_read_are_named(
    change: dict[str, Any], words: str, tmp_path: Path
) -> None:
    message = {**transform(1.0, timestamp={"sec": 5, "nsec": 0}), **change}
    with pytest.raises(tfdb.errors.RecordingError, match=words):
        tfdb.load(json_file(tmp_path / "a.mcap", [(5, message)]))
    if "InvalidTransform" not in words:  # the store refuses these
        good = transform(1.0, timestamp={"sec": 1, "nsec": 0})
        several = json.dumps({"transforms": [message, good]}).encode()
        path = write_mcap(tmp_path / "b.mcap", [("/tf", SEVERAL, "json", 5, several)])
        buffer = tfdb.Buffer(history=None)
        where = "" if "names no" in words else r"transforms\[0\]."
        with pytest.warns(tfdb.TfdbWarning, match=where + words):
            buffer.load(path)
        check(buffer, "odom", "base", {S: 1.0})


@pytest.mark.parametrize("encoding", ["protobuf", "cdr"])
def test_one_bad_member_leaves_the_others(encoding: str) -> None:
    """A bad member has invalid nanoseconds, no parent, or cut bytes."""
    source = Source("/x", encoding, "/x", 1, SEVERAL)  # type: ignore[arg-type]
    times = [(5, 6), (7, S), (8, 9), (10, 11)]
    if encoding == "cdr":
        parents = [b"map\0", b"map\0", b"\0\0\0\0", b"map\0"]
        data = b"\0\1\0\0" + struct.pack("<I", len(times))
        for time, parent in zip(times, parents, strict=True):
            data += struct.pack("<iII4sI4s", *time, 4 if parent[0] else 1, parent, 4, b"arm\0")
            data += b"\0" * (-(len(data) - 4) % 8) + struct.pack("<7d", 1, 2, 3, *TURN)
    else:
        kind = message_class()
        data = b""
        for time, parent in zip(times, ("map", "map", "", "map"), strict=True):
            made = kind(parent_frame_id=parent, child_frame_id="arm")
            made.timestamp.seconds, made.timestamp.nanos = time
            made.rotation.w, made.translation.x = 1.0, 1.0
            part = made.SerializeToString()
            data += b"\x0a" + bytes([len(part)]) + part
        data += b"\x0a\x02\x0a\x09"  # a timestamp that is longer than the message
    found = decode_poses(data, source, None, 99)
    assert [each.stamp for each in found.transforms] == [5 * S + 6, 10 * S + 11]
    assert {each.child for each in found.transforms} == {"arm"}
    kinds = [type(error).__name__ for error in found.refused]
    assert kinds[:2] == ["InvalidStamp", "CorruptMessage"]
    assert len(kinds) == (2 if encoding == "cdr" else 3)
    assert str(found.refused[0]).startswith("timestamp" if encoding == "protobuf" else "stamp")


def test_a_negative_timestamp_is_named() -> None:
    made = message_class()(parent_frame_id="map", child_frame_id="arm")
    made.timestamp.seconds = -1
    part = made.SerializeToString()
    source = Source("/x", "protobuf", "/x", 1, SEVERAL)  # type: ignore[arg-type]
    words = "timestamp: -1 s and 0 ns are not a stamp"
    with pytest.raises(tfdb.errors.InvalidStamp, match=words) as caught:
        decode_poses(b"\x0a" + bytes([len(part)]) + part, source, None, 99)
    assert caught.value.value == (-1, 0)


def test_a_list_without_transforms_is_not_damage(tmp_path: Path) -> None:
    good = json.dumps({"transforms": [transform(1.0, timestamp={"sec": 1, "nsec": 0})]})
    data = [good.encode(), b"{}", b'{"transforms": []}', b'{"other": 3}']
    path = write_mcap(
        tmp_path / "a.mcap", [("/tf", SEVERAL, "json", at, each) for at, each in enumerate(data)]
    )
    with pytest.warns(tfdb.TfdbWarning, match="1 message was refused with Corr"):
        report = tfdb.Buffer(history=None).load(path)
    assert "transforms is not a list" in report.first_refusals["CorruptMessage"]


# -- no time --------------------------------------------------------------------------------------


def test_a_message_without_a_time_has_its_log_time() -> None:
    words = (
        r"pb_notime.mcap: 50 transforms of topic '/transforms' have no timestamp and get the log "
        "time of their message"
    )
    expected = {START + i * 20_000_000: i * 0.02 for i in range(50)}
    for options in ({}, {"pose_topics": "/transforms"}, {"keep": 3600.0}):
        with pytest.warns(tfdb.TfdbWarning) as caught:
            buffer = tfdb.load(CASES / "pb_notime.mcap", **options)  # type: ignore[arg-type]
        assert len(caught) == 1
        assert caught[0].message.args[0].endswith(words)
        check(buffer, "odom", "base_link", expected)


def test_only_those_without_a_time_have_the_log_time(tmp_path: Path) -> None:
    messages = [
        (START + 1, transform(1.0)),
        (START + 2, transform(2.0, timestamp=None)),
        (START + 3, transform(3.0, timestamp={"sec": 1_700_000_000, "nsec": 9})),
        (START + 4, transform(4.0, timestamp="2023-11-14T22:13:20.000000011Z")),
    ]
    path = json_file(tmp_path / "a.mcap", messages)
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match=r": 2 transforms of topic '/poses' have no"):
        report = buffer.load(path)
    assert report.untimed == {"/poses": 2}
    expected = {START + 1: 1.0, START + 2: 2.0, START + 9: 3.0, START + 11: 4.0}
    check(buffer, "odom", "base", expected)


def test_the_time_0_is_a_time(tmp_path: Path) -> None:
    path = json_file(tmp_path / "a.mcap", [(5, transform(1.0, timestamp={"sec": 0, "nsec": 0}))])
    check(tfdb.load(path), "odom", "base", {0: 1.0})


def test_static_transforms_need_no_time(tmp_path: Path) -> None:
    path = json_file(tmp_path / "a.mcap", [(5, transform(1.0))], "/tf_static")
    buffer = tfdb.Buffer()
    assert buffer.load(path).untimed == {}
    assert buffer.frame_info("base").is_static


def test_a_pose_without_a_time_has_its_log_time(tmp_path: Path) -> None:
    pose = {"position": {"x": 1.0}, "orientation": {"w": 1.0}}
    data = json.dumps({"frame_id": "map", "pose": pose}).encode()
    path = write_mcap(tmp_path / "a.mcap", [("/p", "foxglove.PoseInFrame", "json", 77, data)])
    with pytest.warns(tfdb.TfdbWarning, match="1 transform of topic '/p' has no timestamp"):
        buffer = tfdb.load(path, pose_topics={"/p": "base"})
    check(buffer, "map", "base", {77: 1.0})


# -- other ways into a store ----------------------------------------------------------------------


def test_they_are_followed_while_they_are_written(tmp_path: Path) -> None:
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match="50 transforms of topic '/transforms'"):
        report = follow_recording(buffer, CASES / "pb_notime.mcap", timeout=1.0)
    assert (report.messages, report.refused) == (50, 0)
    check(buffer, "odom", "base_link", {START + i * 20_000_000: i * 0.02 for i in range(50)})


def test_messages_of_ros_2(tmp_path: Path) -> None:
    """`foxglove_msgs` as rosbags writes it from its definition."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_JAZZY)
    text = (
        "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n"
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    )
    name = "foxglove_msgs/msg/FrameTransform"
    types.register(get_types_from_msg(text, name))
    lists = "foxglove_msgs/msg/FrameTransforms"
    types.register(get_types_from_msg("foxglove_msgs/FrameTransform[] transforms", lists))
    t = types.types

    def made(child: str, at: int) -> Any:
        return t[name](
            timestamp=t["builtin_interfaces/msg/Time"](sec=at, nanosec=3),
            parent_frame_id="map",
            child_frame_id=child,
            translation=t["geometry_msgs/msg/Vector3"](x=float(at), y=2.0, z=3.0),
            rotation=t["geometry_msgs/msg/Quaternion"](**dict(zip("xyzw", TURN, strict=True))),
        )

    for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        path = tmp_path / plugin.name
        with Writer(path, version=9, storage_plugin=plugin) as writer:
            one = writer.add_connection("/one", name, typestore=types)
            many = writer.add_connection("/robot/tf_static", lists, typestore=types)
            writer.write(one, 1, types.serialize_cdr(made("base", 5), name))
            both = t[lists](transforms=[made("eye", 6), made("ear", 7)])
            writer.write(many, 2, types.serialize_cdr(both, lists))
        buffer = tfdb.load(path)
        check(buffer, "map", "base", {5 * S + 3: 5.0})
        assert buffer.frame_info("eye").is_static
        assert buffer.lookup_transform("map", "ear", 0).translation.tolist() == [7.0, 2.0, 3.0]


def test_raw_messages_of_a_recording_stay_those_of_tf() -> None:
    """By default `Recording.messages` returns only TFMessages, which `decode_tf_message` reads."""
    with Recording(CASES / "json_iso.mcap") as recording:
        assert list(recording.messages()) == []
        assert [source.holds_transforms for source in recording.all_sources] == [True]
        assert len(list(recording.messages(lambda source: source.holds_transforms))) == 50


def test_the_oracle_reads_the_times_of_the_case() -> None:
    with (CASES / "json_iso.mcap").open("rb") as file:
        times = [
            (message.log_time, json.loads(message.data)["timestamp"])
            for _, _, message in make_reader(file).iter_messages()
        ]
    assert [rfc3339_ns(text) for _, text in times] == [at for at, _ in times]
