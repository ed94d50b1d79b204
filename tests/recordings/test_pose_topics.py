"""Poses and joint states of recordings written by rosbags and mcap."""

from __future__ import annotations

import io
import json
import struct
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

import contextlib

from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

import tfdb
from tfdb.recordings import RecordingWriter, follow_recording
from tfdb.recordings.containers import Source
from tfdb.recordings.open_recordings import OpenRecordings
from tfdb.recordings.pose_messages import decode_joint_state, decode_poses
from tfdb.recordings.rewriting import rewrite
from tfdb.recordings.selection import Selection

if TYPE_CHECKING:
    from pathlib import Path

S = 1_000_000_000
KINDS = ["bag", "mcap", "db3"]
Pose = tuple[float, ...]


def poses(count: int, seed: int = 7) -> list[Pose]:
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return [tuple(row) for row in np.hstack((rng.normal(size=(count, 3)), turns)).tolist()]


class Messages:
    """Makes messages of one ROS version with rosbags."""

    def __init__(self, kind: str) -> None:
        self.ros1 = kind == "bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_JAZZY)

    def make(self, of_type: str, /, **fields: Any) -> Any:
        return self.store.types[of_type](**fields)

    def header(self, stamp: int, frame: str) -> Any:
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // S, nanosec=stamp % S)
        more = {"seq": 3} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **more)

    def pose(self, pose: Pose) -> Any:
        x, y, z, *turn = pose
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self.make(
                "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True))
            ),
        )

    def of(self, type_: str, stamp: int, pose: Pose) -> Any:
        """Make a message of a type, with the frames map and base if the type has them."""
        name = type_.rsplit("/", 1)[-1]
        header = self.header(stamp, "/map")
        if name == "PoseStamped":
            return self.make(type_, header=header, pose=self.pose(pose))
        if name == "PoseWithCovarianceStamped":
            return self.make(type_, header=header, pose=self.with_covariance(pose))
        if name == "Odometry":
            zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
            twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
            return self.make(
                type_,
                header=header,
                child_frame_id="base",
                pose=self.with_covariance(pose),
                twist=self.make(
                    "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.ones(36)
                ),
            )
        if name == "TransformStamped":
            x, y, z, *_turn = pose
            move = self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
            rotation = self.pose(pose).orientation
            transform = self.make(
                "geometry_msgs/msg/Transform", translation=move, rotation=rotation
            )
            return self.make(type_, header=header, child_frame_id="base", transform=transform)
        raise AssertionError(name)

    def with_covariance(self, pose: Pose) -> Any:
        return self.make(
            "geometry_msgs/msg/PoseWithCovariance", pose=self.pose(pose), covariance=np.ones(36)
        )

    def path(self, poses: list[tuple[int, str, Pose]]) -> Any:
        of_type = "geometry_msgs/msg/PoseStamped"
        inner = [
            self.make(of_type, header=self.header(stamp, frame), pose=self.pose(pose))
            for stamp, frame, pose in poses
        ]
        return self.make("nav_msgs/msg/Path", header=self.header(9 * S, "map"), poses=inner)

    def joints(self, stamp: int, names: list[str], positions: list[float]) -> Any:
        return self.make(
            "sensor_msgs/msg/JointState",
            header=self.header(stamp, ""),
            name=names,
            position=np.array(positions, dtype=np.float64),
            velocity=np.array([], dtype=np.float64),
            effort=np.array([], dtype=np.float64),
        )

    def bytes(self, type_: str, message: Any) -> bytes:
        encode = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
        return bytes(encode(message, type_))

    def write(self, folder: Path, messages: list[tuple[str, str, int, Any]]) -> Path:
        """Write messages, each given by topic, type, receive time and content, to a recording."""
        if self.ros1:
            path = folder / "run.bag"
            writer: Any = BagWriter(path)
        else:
            path = folder / "run"
            writer = Ros2Writer(path, version=9, storage_plugin=self.plugin)
        with writer:
            connections: dict[str, Any] = {}
            for topic, type_, received, message in messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, type_, typestore=self.store)
                data = message if isinstance(message, bytes) else self.bytes(type_, message)
                writer.write(connections[topic], received, data)
        return path

    plugin = StoragePlugin.MCAP


@pytest.fixture(params=KINDS)
def ros(request: pytest.FixtureRequest) -> Messages:
    made = Messages(request.param)
    made.plugin = StoragePlugin.SQLITE3 if request.param == "db3" else StoragePlugin.MCAP
    return made


def check(buffer: tfdb.Buffer, parent: str, child: str, expected: dict[int, Pose]) -> None:
    stamps, found, parents = buffer.samples(child)
    assert stamps.tolist() == sorted(expected)
    assert set(parents) == {parent}
    assert np.abs(found - [expected[stamp] for stamp in sorted(expected)]).max() < 1e-12


TYPES = ["nav_msgs/msg/Odometry", "geometry_msgs/msg/TransformStamped"]
NAMELESS = ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"]


@pytest.mark.parametrize("type_", TYPES + NAMELESS)
def test_poses_become_edges(ros: Messages, type_: str, tmp_path: Path) -> None:
    expected = {(10 + i) * S + 7: pose for i, pose in enumerate(poses(5))}
    given = [("/odom", type_, at + 1, ros.of(type_, at, pose)) for at, pose in expected.items()]
    path = ros.write(tmp_path, given)
    if type_ in TYPES:
        check(tfdb.load(path, pose_topics="odom"), "map", "base", expected)
    check(tfdb.load(path, pose_topics={"/odom": "/robot"}), "map", "robot", expected)
    part = tfdb.load(
        path, pose_topics={"/odom": "base"}, start="+1", end="-1", rename={"map": "w"}, prefix="r/"
    )
    inner = {at: pose for at, pose in expected.items() if 11 * S <= at <= 13 * S + 7}
    check(part, "r/w", "r/base", inner)


def test_poses_of_two_files_may_not_contradict(ros: Messages, tmp_path: Path) -> None:
    paths = []
    for name, seed in (("one", 7), ("other", 8)):
        (tmp_path / name).mkdir()
        type_ = "nav_msgs/msg/Odometry"
        messages = [
            ("/odom", type_, at, ros.of(type_, at * S, pose))
            for at, pose in enumerate(poses(5, seed), 1)
        ]
        paths.append(ros.write(tmp_path / name, messages))
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        tfdb.load(paths, pose_topics="/odom")
    assert list((caught.value.groups or {}).values()) == [("/odom",), ("/odom",)]
    tfdb.load(paths, pose_topics="/odom", mix=True)


def two_ways(ros: Messages, folder: Path, odometry: list[Pose], tf: list[Pose]) -> Path:
    """Write one edge on /odom (map to base), on /amcl (no child named) and on /tf."""
    register_tf(ros)
    encoding = "ros1" if ros.ros1 else "cdr"
    messages: list[tuple[str, str, int, Any]] = []
    for at, (one, other) in enumerate(zip(odometry, tf, strict=True), 1):
        edge = tfdb.TransformStamped("map", "base", at * S, other[:3], other[3:])
        for topic, type_ in (("/odom", "Odometry"), ("/amcl", "PoseStamped")):
            name = f"{'nav' if topic == '/odom' else 'geometry'}_msgs/msg/{type_}"
            pose = one if topic == "/odom" else other
            messages.append((topic, name, at, ros.of(name, at * S, pose)))
        data = tfdb.encode_tf_message([edge], encoding)
        messages.append(("/tf", "tf2_msgs/msg/TFMessage", at, data))
    return ros.write(folder, messages)


@pytest.mark.parametrize(
    ("topics", "posed", "groups"),
    [
        (None, {"/odom": None}, {"/odom", "/tf"}),
        ("/tf", {"/odom": None}, {"/odom", "/tf"}),
        ((), {"/odom": None, "/amcl": "base"}, {"/amcl", "/odom"}),
    ],
    ids=["every topic", "a named topic", "poses only"],
)
def test_pose_topics_that_disagree_are_refused(
    ros: Messages, tmp_path: Path, topics: Any, posed: dict[str, str | None], groups: set[str]
) -> None:
    path = two_ways(ros, tmp_path, poses(5), poses(5, 8))
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        tfdb.load(path, topics=topics, pose_topics=posed)
    assert set(caught.value.groups or {}) == groups
    assert caught.value.frames == ("base",)
    for way in ("--exclude", "--pose-topic TOPIC=CHILD", "--mix"):
        assert way in str(caught.value)
    for options in ({"mix": True}, {"exclude": "/odom"}, {"pose_topics": posed | {"/odom": "b"}}):
        loaded = tfdb.load(path, **{"topics": topics, "pose_topics": posed, **options})
        assert "base" in loaded.frames()


def test_pose_topics_that_agree_are_loaded(ros: Messages, tmp_path: Path) -> None:
    path = two_ways(ros, tmp_path, poses(5), poses(5))
    buffer = tfdb.load(path, pose_topics={"/odom": None, "/amcl": "base"})
    assert buffer.frame_info("base").samples == 5


def test_a_copy_joins_poses_with_tf_only_if_they_agree(ros: Messages, tmp_path: Path) -> None:
    """A copy writes poses on /tf."""
    path = two_ways(ros, tmp_path, poses(5), poses(5, 8))
    with (
        OpenRecordings(path, Selection(pose_topics={"/odom": "base"})) as recordings,
        pytest.raises(tfdb.errors.MixedSources, match="transforms of base: /odom; /tf"),
    ):
        recordings.rewriter(one_tree=False)
    agreeing = Selection(pose_topics={"/amcl": "base"})
    with (
        OpenRecordings(path, agreeing) as recordings,
        RecordingWriter(tmp_path / "out.mcap") as writer,
    ):
        rewrite(recordings, [recordings.rewriter(one_tree=False)], writer)
    assert tfdb.load(tmp_path / "out.mcap").frame_info("base").samples == 5


def test_pose_topics_of_a_growing_recording_are_judged(tmp_path: Path) -> None:
    ros = Messages("mcap")
    folder = two_ways(ros, tmp_path, poses(5), poses(5, 8))
    (path,) = folder.glob("*.mcap")
    buffer = tfdb.Buffer(history=None)
    with pytest.raises(tfdb.errors.MixedSources, match="of base: /odom; /tf"):
        follow_recording(buffer, path, pose_topics="/odom")
    follow_recording(buffer, path, pose_topics={"/amcl": "base"})
    assert buffer.frame_info("base").samples == 5


def test_paths(ros: Messages, tmp_path: Path) -> None:
    """Paths repeat poses: those of the newer message count. The header fills empty fields."""
    first, second, third, fourth = poses(4)
    type_ = "nav_msgs/msg/Path"
    one = ros.path([(1 * S, "", first), (2 * S, "map", second)])
    two = ros.path([(1 * S, "map", third), (2 * S, "map", second), (0, "map", fourth)])
    path = ros.write(tmp_path, [("/path", type_, 1, one), ("/path", type_, 2, two)])
    expected = {1 * S: third, 2 * S: second, 9 * S: fourth}
    check(tfdb.load(path, pose_topics={"/path": "base"}), "map", "base", expected)


def test_a_path_without_times_is_refused(ros: Messages, tmp_path: Path) -> None:
    plan = ros.path([(0, "map", pose) for pose in poses(3)])
    path = ros.write(tmp_path, [("/plan", "nav_msgs/msg/Path", 1, plan)])
    with pytest.raises(tfdb.errors.RecordingError, match="with InvalidStamp: a path of 3 poses"):
        tfdb.load(path, pose_topics={"/plan": "base"})


def register_tf(ros: Messages) -> None:
    from rosbags.typesys import get_types_from_msg

    if ros.ros1:
        text = "geometry_msgs/TransformStamped[] transforms"
        ros.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))


def test_poses_join_transforms(ros: Messages, tmp_path: Path) -> None:
    odometry, tf = poses(2)
    encoding = "ros1" if ros.ros1 else "cdr"
    data = tfdb.encode_tf_message(
        [tfdb.TransformStamped("base", "camera", S, tf[:3], tf[3:])], encoding
    )
    register_tf(ros)
    type_ = "nav_msgs/msg/Odometry"
    path = ros.write(
        tmp_path,
        [
            ("/tf", "tf2_msgs/msg/TFMessage", 1, data),
            ("/odom", type_, 2, ros.of(type_, S, odometry)),
        ],
    )
    buffer = tfdb.Buffer(history=None)
    report = buffer.load(path, pose_topics="/odom")
    assert (report.messages, report.commits, report.refused) == (2, 2, 0)
    assert {topic.name for topic in report.topics} == {"/tf", "/odom"}
    check(buffer, "map", "base", {S: odometry})
    check(buffer, "base", "camera", {S: tf})
    assert tfdb.load(path).frames() == ["base", "camera"]
    assert tfdb.load(path, topics=(), pose_topics="/odom").frames() == ["base", "map"]


def test_broken_messages_are_refused(ros: Messages, tmp_path: Path) -> None:
    good = ros.of("nav_msgs/msg/Odometry", S, poses(1)[0])
    nowhere = ros.of("nav_msgs/msg/Odometry", 2 * S, poses(1)[0])
    nowhere.header.frame_id = ""
    skewed = ros.of("nav_msgs/msg/Odometry", 3 * S, (0, 0, 0, 0, 0, 0, 2.0))
    short = ros.bytes("nav_msgs/msg/Odometry", good)[:70]
    messages = [
        ("/odom", "nav_msgs/msg/Odometry", n, m)
        for n, m in enumerate((good, nowhere, skewed, short), 1)
    ]
    stamped = ros.of("geometry_msgs/msg/PoseStamped", S, poses(1)[0])
    messages.append(("/pose", "geometry_msgs/msg/PoseStamped", 9, stamped))
    messages.append(("/twist", "geometry_msgs/msg/Point", 9, ros.pose(poses(1)[0]).position))
    path = ros.write(tmp_path, messages)
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning, match="2 messages were refused with Corr|1 transform of"):
        report = buffer.load(path, pose_topics="/odom")
    assert (report.messages, report.commits, report.refused) == (4, 1, 3)
    assert dict(report.reasons) == {"CorruptMessage": 2, "InvalidTransform": 1}
    assert "names no parent frame" in report.first_refusals["CorruptMessage"]
    for topics, words in (
        ("/pose", r"does not name the child frame: .* pose_topics=\{'/pose': 'base_link'\}"),
        ("/none", "no topic '/none'; its topics: /odom"),
        ("/twist", "holds geometry_msgs/msg/Point, not poses: those are"),
    ):
        with pytest.raises(tfdb.errors.RecordingError, match=words):
            tfdb.load(path, pose_topics=topics)
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"pose_topics='/odom' .--pose-topic /odom. reads"
    ):
        tfdb.load(path)
    for bad in (3, {"/odom": ""}, {"/odom": 3}, [None]):
        with pytest.raises(tfdb.InvalidArgument):
            tfdb.load(path, pose_topics=bad)


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_every_cut_and_every_changed_byte_is_typed(encoding: str) -> None:
    ros = Messages("bag" if encoding == "ros1" else "mcap")
    rng = np.random.default_rng(11)
    path = ros.path([(S, "map", pose) for pose in poses(2)])
    joints = ros.joints(S, ["a", "b"], [1.0, 2.0])
    for type_, message in (
        ("nav_msgs/Odometry", ros.of("nav_msgs/msg/Odometry", S, poses(1)[0])),
        ("nav_msgs/Path", path),
        ("sensor_msgs/JointState", joints),
    ):
        source = Source("/x", encoding, "", 1, type_)  # type: ignore[arg-type]
        whole = ros.bytes(type_.replace("/", "/msg/"), message)
        changed = [whole[:size] for size in range(0, len(whole), 3)]
        for _ in range(300):
            data = bytearray(whole)
            data[rng.integers(len(data))] = rng.integers(256)
            changed.append(bytes(data))
        for data in changed:
            try:
                if type_.endswith("JointState"):
                    decode_joint_state(data, source)
                else:
                    decode_poses(data, source, "b", 0)
            except tfdb.TfdbError:
                pass


def test_big_endian_messages() -> None:
    """Messages of a big-endian writer differ only in their encapsulation."""
    head = b"\0\0\0\0" + struct.pack(">iI", 5, 6) + struct.pack(">I", 4) + b"map\0"
    body = struct.pack(">7d", 1, 2, 3, 0.6, 0, 0, 0.8)
    data = head + b"\0" * (-(len(head) - 4) % 8) + body
    source = Source("/pose", "cdr", "", 1, "geometry_msgs/PoseStamped")
    (made,) = decode_poses(data, source, "base", 0).transforms
    assert (made.parent, made.child, made.stamp) == ("map", "base", 5 * S + 6)
    assert (*made.translation, *made.rotation) == (1, 2, 3, 0.6, 0, 0, 0.8)


# -- Foxglove -------------------------------------------------------------------------------------

# Of foxglove-schemas-protobuf 0.4.0: map to odom at 12 s, odom to base at 13.5 s; map at 14 s.
PROTOBUF = {
    "foxglove.FrameTransforms": (
        "0a370a02080c12036d61701a046f646f6d221209000000000000f83f1100000000000000c02a1209333333333333"
        "e33f219a9999999999e93f0a3e0a08080d1080cab5ee0112046f646f6d1a0462617365221209000000000000044"
        "01100000000000000c02a1209333333333333e33f219a9999999999e93f"
    ),
    "foxglove.FrameTransform": (
        "0a08080d1080cab5ee0112046f646f6d1a046261736522120900000000000004401100000000000000c02a120933"
        "3333333333e33f219a9999999999e93f"
    ),
    "foxglove.PoseInFrame": (
        "0a02080e12036d61701a1f0a09190000000000000840121211333333333333e3bf219a9999999999e93f"
    ),
}
TURN = (0.6, 0.0, 0.0, 0.8)
FOXGLOVE = {
    "foxglove.FrameTransforms": [
        ("map", "odom", 12 * S, (1.5, -2.0, 0.0), TURN),
        ("odom", "base", 27 * S // 2, (2.5, -2.0, 0.0), TURN),
    ],
    "foxglove.FrameTransform": [("odom", "base", 27 * S // 2, (2.5, -2.0, 0.0), TURN)],
    "foxglove.PoseInFrame": [("map", "tool", 14 * S, (0.0, 0.0, 3.0), (0.0, -0.6, 0.0, 0.8))],
}


def as_json(type_: str) -> bytes:
    def time(stamp: int) -> dict[str, int]:
        return {"sec": stamp // S, "nsec": stamp % S}

    def fields(names: str, values: Pose) -> dict[str, float]:
        return dict(zip(names, values, strict=True))

    made: list[dict[str, Any]] = []
    for parent, child, stamp, move, turn in FOXGLOVE[type_]:
        if type_ == "foxglove.PoseInFrame":
            pose = {"position": fields("xyz", move), "orientation": fields("xyzw", turn)}
            made.append({"timestamp": time(stamp), "frame_id": parent, "pose": pose})
        else:
            names = {"parent_frame_id": parent, "child_frame_id": child}
            move_, turn_ = fields("xyz", move), fields("xyzw", turn)
            made.append(
                {"timestamp": time(stamp), **names, "translation": move_, "rotation": turn_}
            )
    return json.dumps({"transforms": made} if type_.endswith("s") else made[0]).encode()


def write_mcap(path: Path, type_: str, encoding: str, data: bytes) -> Path:
    raw = io.BytesIO()
    writer = McapWriter(raw)
    writer.start()
    schema = writer.register_schema(type_, {"json": "jsonschema"}.get(encoding, encoding), b"")
    channel = writer.register_channel("/poses", encoding, schema)
    writer.add_message(channel, log_time=5, data=data, publish_time=5)
    writer.finish()
    path.write_bytes(raw.getvalue())
    return path


@pytest.mark.parametrize("type_", FOXGLOVE)
@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_foxglove(type_: str, encoding: str, tmp_path: Path) -> None:
    data = bytes.fromhex(PROTOBUF[type_]) if encoding == "protobuf" else as_json(type_)
    path = write_mcap(tmp_path / "run.mcap", type_, encoding, data)
    child = "tool" if type_.endswith("InFrame") else None
    buffer = tfdb.load(path, pose_topics={"/poses": child})
    for parent, child_, stamp, move, turn in FOXGLOVE[type_]:
        check(buffer, parent, child_, {stamp: (*move, *turn)})


def test_damaged_foxglove_is_typed(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for type_ in FOXGLOVE:
        for encoding, whole in (
            ("protobuf", bytes.fromhex(PROTOBUF[type_])),
            ("json", as_json(type_)),
        ):
            source = Source("/x", encoding, "", 1, type_)  # type: ignore[arg-type]
            changed = [whole[:size] for size in range(len(whole))]
            for _ in range(300):
                data = bytearray(whole)
                data[rng.integers(len(data))] = rng.integers(256)
                changed.append(bytes(data))
            for data in changed:
                with contextlib.suppress(tfdb.TfdbError):
                    decode_poses(bytes(data), source, "b", 0)
    for text in ("[]", "3", '{"transforms": 3}', "[" * 100_000, '{"timestamp": {"sec": 1e999}}'):
        source = Source("/x", "json", "", 1, "foxglove.FrameTransforms")
        with pytest.raises(
            tfdb.errors.CorruptMessage, match=r"no foxglove.FrameTransforms in json"
        ):
            decode_poses(text.encode(), source, None, 0)
    path = write_mcap(tmp_path / "run.mcap", "foxglove.FrameTransform", "flatbuffer", b"1234")
    with pytest.raises(tfdb.errors.RecordingError, match="encoded as 'flatbuffer'; tfdb reads"):
        tfdb.load(path, pose_topics="/poses")


def test_poses_that_salvage_lost_are_counted(tmp_path: Path) -> None:
    ros, type_ = Messages("bag"), "nav_msgs/msg/Odometry"
    given = [("/odom", type_, i * S, ros.of(type_, i * S, p)) for i, p in enumerate(poses(5), 1)]
    path = ros.write(tmp_path, given)
    data = bytearray(path.read_bytes())
    header = data.index(b"op=\x02")
    data[data.index(b"conn=", header - 40) + 5] = 9  # a connection that is not declared
    path.write_bytes(data)
    with pytest.raises(
        tfdb.errors.RecordingError, match=r"promises 5 messages on '/odom', .* holds 4"
    ):
        tfdb.load(path, pose_topics="/odom")
    report = tfdb.Buffer(history=None).load(path, pose_topics="/odom", salvage=True)
    assert (report.commits, [loss.messages for loss in report.lost]) == (4, [1])


# -- joint states ---------------------------------------------------------------------------------

URDF = """<robot name="arm">
  <link name="foot"/><link name="upper"/><link name="slide"/><link name="finger"/><link name="eye"/>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="upper"/>
    <origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="push" type="prismatic"><parent link="upper"/><child link="slide"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" velocity="1" effort="1"/></joint>
  <joint name="grip" type="prismatic"><parent link="slide"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>
    <mimic joint="push" multiplier="-2" offset="0.1"/></joint>
  <joint name="look" type="fixed"><parent link="upper"/><child link="eye"/>
    <origin xyz="0 0.2 0"/></joint>
</robot>"""


def by_hand(turn: float, push: float) -> dict[str, np.ndarray]:
    """Compute T[foot<-link] by matrices."""

    def moved(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
        made = np.eye(4)
        made[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        made[:3, 3] = x, y, z
        return made

    upper = moved(0, 0, 0.5, np.pi / 2 + turn)
    slide = upper @ moved(push, 0, 0)
    return {
        "upper": upper,
        "slide": slide,
        "finger": slide @ moved(0, 0.1 - 2 * push, 0),
        "eye": upper @ moved(0, 0.2, 0),
    }


JOINTS = "sensor_msgs/msg/JointState"


def joint_run(ros: Messages, folder: Path, extra: list[Any] | None = None) -> Path:
    rows = [(1, 0.2, 0.1), (2, -0.7, 0.2), (3, 0.9, 0.4)]
    messages: list[Any] = []
    for at, turn, push in rows:
        messages.append(("/joint_states", JOINTS, at, ros.joints(at * S, ["turn"], [turn])))
        messages.append(("/joint_states", JOINTS, at, ros.joints(at * S, ["push"], [push])))
    return ros.write(folder, messages + (extra or []))


def test_joint_states(ros: Messages, tmp_path: Path) -> None:
    model = tfdb.robots.parse_urdf(URDF)
    path = joint_run(ros, tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        buffer = tfdb.recordings.load_joint_states(model, path)
    (tmp_path / "arm.urdf").write_text(URDF)
    loaded = tfdb.load(path, urdf=tmp_path / "arm.urdf")
    for at, turn, push in [(1, 0.2, 0.1), (2, -0.7, 0.2), (3, 0.9, 0.4)]:
        for link, expected in by_hand(turn, push).items():
            for store in (buffer, loaded):
                found = store.lookup_transform("foot", link, at * S).matrix
                assert np.abs(np.asarray(found) - expected).max() < 1e-12, link
    assert {info.name for info in buffer.tree() if info.is_static} == {"eye"}
    part = tfdb.load(path, urdf=model, frames={"foot", "slide"}, keep=1, prefix="a/")
    assert part.frames() == ["a/foot", "a/slide", "a/upper"]
    assert part.samples("a/upper")[0].tolist() == [2 * S, 3 * S]


def test_a_rewriting_has_the_fixed_joints(ros: Messages, tmp_path: Path) -> None:
    """They are one static message, which progress counts, on a topic with transient-local QoS."""
    seen: list[tuple[int, int]] = []
    chosen = Selection(urdf=tfdb.robots.parse_urdf(URDF))
    with (
        OpenRecordings(joint_run(ros, tmp_path), chosen) as recordings,
        RecordingWriter(tmp_path / "out.mcap") as writer,
    ):
        rewriters = [recordings.rewriter()]
        rewrite(recordings, rewriters, writer, lambda *step: seen.append(step))
        count = recordings.count + 1
    assert seen[-1] == (count, count)
    with AnyReader([tmp_path / "out.mcap"]) as reader:
        static, moving = sorted(reader.connections, key=lambda each: each.topic, reverse=True)
    assert (static.topic, static.msgcount, moving.topic) == ("/tf_static", 1, "/tf")
    profiles: Any = [each.ext for each in (static, moving)]
    durabilities = [each.offered_qos_profiles[0].durability.name for each in profiles]
    assert durabilities == ["TRANSIENT_LOCAL", "VOLATILE"]


def test_times_do_not_count_from_joint_states_of_another_topic(
    ros: Messages, tmp_path: Path
) -> None:
    other = [("/other", JOINTS, 1, ros.joints(S // 2, ["turn"], [0.5]))]
    path, model = joint_run(ros, tmp_path, other), tfdb.robots.parse_urdf(URDF)
    found = tfdb.load(path, urdf=model, joint_topic="/joint_states", end="+1")
    assert found.samples("upper")[0].tolist() == [S, 2 * S]


def test_a_list_longer_than_its_message_is_refused() -> None:
    source = Source("/joints", "ros1", "/joints", 1, JOINTS)
    data = struct.pack("<4I", 0, 5, 0, 0) + struct.pack("<I", 1000) + bytes(8)
    with pytest.raises(tfdb.errors.CorruptMessage, match="1000 members in the last 8 bytes"):
        decode_joint_state(data, source)


def test_joint_states_of_two_files_may_not_contradict(ros: Messages, tmp_path: Path) -> None:
    model = tfdb.robots.parse_urdf(URDF)
    paths = []
    for name, turn in (("one", 0.2), ("again", 0.2), ("other", -0.7)):
        (tmp_path / name).mkdir()
        messages = [
            ("/joint_states", JOINTS, at, ros.joints(at * S, ["turn", "push"], [turn, 0.1 * at]))
            for at in (1, 2, 3)
        ]
        paths.append(ros.write(tmp_path / name, messages))
    assert tfdb.load(paths[:2], urdf=model).frame_info("slide").samples == 3
    with pytest.raises(tfdb.errors.MixedSources) as caught:
        tfdb.load(paths[1:], urdf=model)
    assert caught.value.frames == ("upper",)


def test_joints_that_mimic_have_limits_too(ros: Messages, tmp_path: Path) -> None:
    path = joint_run(ros, tmp_path)
    before, mimic, after = URDF.partition("<mimic")
    model = tfdb.robots.parse_urdf("-0.5".join(before.rsplit("-1", 1)) + mimic + after)
    with pytest.warns(tfdb.TfdbWarning, match=r"joint 'grip' is beyond its limits, -0\.5 to 1, in"):
        report = tfdb.Buffer(history=None).load(path, urdf=model)
    assert report.joints is not None
    (grip,) = report.joints.beyond
    assert (grip.joint, grip.stamp, grip.count) == ("grip", 3 * S, 1)
    assert grip.position == pytest.approx(0.1 - 2 * 0.4)
    with pytest.raises(tfdb.errors.RecordingError, match="'grip' is beyond"):
        tfdb.recordings.load_joint_states(model, path, limits="raise")


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("taken", [False, True])
def test_floating_and_planar_joints(
    ros: Messages, tmp_path: Path, named: bool, taken: bool
) -> None:
    """Joint states cannot place them: a warning names those that are not on /tf either."""
    more = """<link name="world"/><link name="cart"/>
      <joint name="fly" type="floating"><parent link="world"/><child link="foot"/></joint>
      <joint name="drive" type="planar"><parent link="world"/><child link="cart"/></joint>
    </robot>"""
    model = tfdb.robots.parse_urdf(URDF.replace("</robot>", more))
    extra: list[Any] = []
    if named:
        extra.append(("/joint_states", JOINTS, 4, ros.joints(4 * S, ["drive", "turn"], [1.0, 0.1])))
    if taken:
        register_tf(ros)
        found = poses(2)
        edges = [
            tfdb.TransformStamped("world", child, 2 * S, pose[:3], pose[3:])
            for child, pose in zip(("foot", "cart"), found, strict=True)
        ]
        data = tfdb.encode_tf_message(edges, "ros1" if ros.ros1 else "cdr")
        extra.append(("/tf", "tf2_msgs/msg/TFMessage", 2 * S, data))
    path = joint_run(ros, tmp_path, extra)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        store = tfdb.load(path, urdf=model)
    said = [str(each.message) for each in caught]
    if taken:
        assert not said
        assert store.frame_info("cart").parent == "world"
        return
    assert said == [
        f"{path}: no sensor_msgs/JointState moves joint 'fly' (floating), 'drive' (planar): "
        "T[world<-foot], T[world<-cart] must come from /tf, set_transform or "
        "set_joint_state"
    ]
    assert store.frame_exists("slide")
    assert not store.frame_exists("cart")


def test_mismatches_of_joint_states_are_reported(ros: Messages, tmp_path: Path) -> None:
    extra = [
        ("/joint_states", JOINTS, 4, ros.joints(4 * S, ["turn", "wheel"], [1.5, 0.0])),
        ("/joint_states", JOINTS, 5, ros.joints(5 * S, ["turn"], [-2.25])),
        ("/joint_states", JOINTS, 6, ros.joints(6 * S, ["turn"], [float("nan")])),
        ("/joint_states", JOINTS, 7, ros.joints(7 * S, ["turn", "push"], [0.1])),
    ]
    path = joint_run(ros, tmp_path, extra)
    model = tfdb.robots.parse_urdf(
        URDF.replace('name="push" type', 'name="press" type').replace(
            'joint="push"', 'joint="press"'
        )
    )
    buffer = tfdb.Buffer(history=None)
    with pytest.warns(tfdb.TfdbWarning) as caught:
        report = buffer.load(path, urdf=model)
    texts = " | ".join(str(each.message) for each in caught)
    assert report.joints is not None
    assert (report.joints.missing, report.joints.unknown) == (("press",), ("push", "wheel"))
    (beyond,) = report.joints.beyond
    assert (beyond.joint, beyond.count, beyond.position, beyond.stamp) == ("turn", 2, -2.25, 5 * S)
    assert report.joints.not_finite == {"turn": 1}
    assert dict(report.reasons) == {"CorruptMessage": 1}
    for words in (
        "no joint state names 'press'",
        "the joint states name 'push', 'wheel', which the model lacks",
        "'turn' is beyond its limits, -1 to 1, in 2 states; the furthest is -2.25 at 5 s",
        "infinite or NaN positions are skipped, of 'turn'",
    ):
        assert words in texts
    with pytest.raises(tfdb.errors.RecordingError, match="'turn' is beyond its limits"):
        tfdb.recordings.load_joint_states(model, path, limits="raise")
    with pytest.warns(tfdb.TfdbWarning) as caught:
        tfdb.recordings.load_joint_states(model, path, limits="ignore")
    assert "beyond" not in " ".join(str(each.message) for each in caught)
    with pytest.raises(tfdb.InvalidArgument, match="limits must be 'warn', 'raise' or 'ignore'"):
        tfdb.recordings.load_joint_states(model, path, limits="never")  # type: ignore[arg-type]


def test_topics_of_joint_states(ros: Messages, tmp_path: Path) -> None:
    model = tfdb.robots.parse_urdf(URDF)
    state = ros.joints(S, ["turn", "push"], [0.1, 0.1])
    path = ros.write(tmp_path, [("/b", JOINTS, 1, state), ("/a", JOINTS, 1, state)])
    with pytest.raises(tfdb.errors.RecordingError, match=r"several topics .* name one .*: /a, /b"):
        tfdb.recordings.load_joint_states(model, path)
    assert len(tfdb.recordings.load_joint_states(model, path, topic="b").frames()) == 5
    with pytest.raises(tfdb.errors.RecordingError, match="no topic '/c' with joint states"):
        tfdb.recordings.load_joint_states(model, path, topic="/c")
    with pytest.raises(tfdb.InvalidArgument, match="joint_topic needs urdf"):
        tfdb.load(path, joint_topic="/a")


def test_joint_states_of_a_real_arm_equal_its_transforms(shared_data: Path) -> None:
    path = shared_data / "panda" / "rosbagFrankaPanda.bag"
    model = tfdb.robots.load_urdf(shared_data / "urdf" / "panda.urdf")
    ours, theirs = tfdb.recordings.load_joint_states(model, path), tfdb.load(path)
    for number in range(1, 8):
        link = f"panda_link{number}"
        stamps = theirs.samples(link)[0]
        pair = [store.lookup_transforms("panda_link0", link, stamps) for store in (ours, theirs)]
        assert np.abs(pair[0][:, :3] - pair[1][:, :3]).max() < 1e-6
        same = np.abs(np.sum(pair[0][:, 3:] * pair[1][:, 3:], axis=1))
        assert same.min() > 1 - 1e-9
    joined = tfdb.load(path, urdf=model)
    assert set(theirs.frames()) <= set(joined.frames())
    for frame in theirs.frames():
        assert joined.frame_info(frame).samples == theirs.frame_info(frame).samples
