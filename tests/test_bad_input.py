"""Bad transforms, names and stamps raise a typed error and leave the store unchanged."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from refused_calls import refused
from robot import COUNT, Robot, make_robot, stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable

TURN = quaternion((1, -2, 0.5), 0.9)
NAN = float("nan")
INF = float("inf")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return make_robot()


# -- other types than text -------------------------------------------------------------------------

NO_TEXT: list[tuple[str, Callable[[tfdb.Buffer, Any], object]]] = [
    ("name", lambda buf, x: buf.frame_info(x)),
    ("name", lambda buf, x: buf.parent_of(x)),
    ("name", lambda buf, x: buf.frame_exists(x)),
    ("name", lambda buf, x: buf.samples(x)),
    ("names", lambda buf, x: buf.remove_frames(x)),
    ("names", lambda buf, x: buf.remove_frames(["map", x])),
    ("source", lambda buf, x: buf.common_times("map", x)),
    ("target", lambda buf, x: buf.latest_common_time(x, "map")),
    ("target", lambda buf, x: buf.lookup_transform(x, "map")),
    ("fixed_frame", lambda buf, x: buf.lookup_transform_full("map", 1, "map", 1, x)),
    ("fixed_frame", lambda buf, x: buf.can_transform_full("map", 1, "map", 1, x)),
    ("target", lambda buf, x: buf.lookup_velocity(x, "map")),
    ("source", lambda buf, x: buf.transform_points("map", x, [[0, 0, 0]], [1])),
    ("parent", lambda buf, x: buf.set_static_transform(x, "new", (0, 0, 0))),
    ("authority", lambda buf, x: buf.set_static_transform("map", "new", (0, 0, 0), authority=x)),
    ("authority", lambda buf, x: buf.set_transforms([], authority=x)),
    ("encoding", lambda buf, x: buf.ingest(b"", encoding=x)),
    ("encoding", lambda buf, x: buf.ingest_many([b""], encoding=x)),
    ("authority", lambda buf, x: buf.ingest_many([], encoding="ros1", authority=x)),
    ("messages", lambda buf, x: buf.ingest_many(x, encoding="ros1")),
]


@pytest.mark.parametrize("wrong", [5, None, 1.5])
@pytest.mark.parametrize(("role", "call"), NO_TEXT)
def test_texts_must_be_str(
    robot: Robot, role: str, call: Callable[[tfdb.Buffer, Any], object], wrong: object
) -> None:
    with refused(robot.buffer, TypeError) as caught:
        call(robot.buffer, wrong)
    kind = type(wrong).__name__
    assert str(caught.value).startswith(f"{role} must be ")
    assert str(caught.value).endswith(f", got {kind}")


# -- transforms ------------------------------------------------------------------------------------

BAD_POSES = [
    ((NAN, 2, 3), TURN, "translation"),
    ((1, INF, 3), TURN, "translation"),
    ((1, 2, -INF), TURN, "translation"),
    ((1, 2, 3), (NAN, 0, 0, 1), "rotation"),
    ((1, 2, 3), (0, INF, 0, 1), "rotation"),
    ((1, 2, 3), (0, 0, 0, 0), "rotation"),
    ((1, 2, 3), (0, 0, 0, 1.0051), "rotation"),
    ((1, 2, 3), (0, 0, 0, 0.994), "rotation"),
    ((1, 2, 3), (1, 1, 1, 1), "rotation"),
]


@pytest.mark.parametrize(("translation", "rotation", "what"), BAD_POSES)
def test_numbers_that_are_no_transform(
    robot: Robot, translation: object, rotation: object, what: str
) -> None:
    buffer = robot.buffer
    with refused(buffer, tfdb.errors.InvalidTransform) as caught:
        buffer.set_transform("map", "odom", stamp_of(50), translation, rotation, authority="ekf")
    assert caught.value.index == 0
    assert "odom" in str(caught.value)
    assert caught.value.authority == "ekf"
    with refused(buffer, tfdb.errors.InvalidTransform):
        buffer.set_static_transform("base", "lidar", translation, rotation)
    good = tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)
    bad = tfdb.TransformStamped("map", "new_frame", stamp_of(50), translation, rotation)
    with refused(buffer, tfdb.errors.InvalidTransform) as caught:
        buffer.set_transforms([good, good, bad])
    assert caught.value.index == 2
    with refused(buffer, tfdb.errors.InvalidTransform):
        buffer.ingest(tfdb.encode_tf_message([bad]))
    found = buffer.ingest_many([tfdb.encode_tf_message([good, bad])], encoding="cdr")
    assert (found.transforms, found.refused_transforms, found.refused) == (1, 1, 0)
    assert [(each.edge, each.error) for each in found.refused_edges] == [
        ("new_frame", "InvalidTransform")
    ]
    assert "new_frame" not in buffer.frames()
    assert buffer.lookup_transform("map", "odom", stamp_of(50)).translation[0] == 1


def test_a_frame_is_not_its_own_parent(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.errors.InvalidTransform) as caught:
        robot.buffer.set_transform("base", "base", stamp_of(50), (1, 2, 3), TURN)
    assert "base" in str(caught.value)


@pytest.mark.parametrize(
    ("translation", "rotation"),
    [
        ((1, 2), TURN),
        ((1, 2, 3, 4), TURN),
        ([1, 2, "x"], TURN),
        ("123", TURN),
        (7, TURN),
        (None, TURN),
        (np.zeros((3, 1)), TURN),
        (np.zeros(4), TURN),
        ((1, 2, 3), TURN[:3]),
        ((1, 2, 3), SimpleNamespace(x=0, y=0, z=0)),
        ((1, 2, 3), np.eye(4)),
        ((1, 2, 3), {"x": 0, "y": 0, "z": 0, "w": 1}),
    ],
)
def test_parts_of_the_wrong_shape(robot: Robot, translation: object, rotation: object) -> None:
    buffer = robot.buffer
    with refused(buffer, tfdb.errors.InvalidArray) as caught:
        buffer.set_transform("map", "odom", stamp_of(50), translation, rotation)
    assert "numbers (x, y, z" in str(caught.value)
    with refused(buffer, tfdb.errors.InvalidArray) as caught:
        buffer.set_transforms(
            [tfdb.TransformStamped("map", "odom", stamp_of(50), translation, rotation)]
        )
    assert caught.value.index == 0


def test_a_cycle(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.errors.CycleError) as caught:
        robot.buffer.set_transform("left_hand", "base", stamp_of(60), (1, 2, 3), TURN)
    assert caught.value.index == 0
    assert {"base", "left_hand"} <= set(caught.value.frames or ())
    batch = [
        tfdb.TransformStamped(parent, child, stamp_of(5), (1, 2, 3), TURN)
        for parent, child in (("x", "y"), ("y", "z"), ("z", "x"))
    ]
    with refused(robot.buffer, tfdb.errors.CycleError):
        robot.buffer.set_transforms(batch)


def test_samples_older_than_the_history() -> None:
    buffer = make_robot(history=1.0).buffer
    with refused(buffer, tfdb.errors.TooOld) as caught:
        buffer.set_transform("map", "odom", stamp_of(COUNT - 12), (1, 2, 3), TURN)
    error = caught.value
    assert error.stamp == stamp_of(COUNT - 12)
    assert error.oldest == stamp_of(COUNT - 11)
    assert error.index == 0


# -- names -----------------------------------------------------------------------------------------

BAD_NAMES = ["", "x" * 10_240, "ab\0c", "ab\nc", "ab\tc", "\x7f", "ä" * 513, "\ud800"]


@pytest.mark.parametrize("name", BAD_NAMES, ids=lambda name: repr(name[:8]))
def test_names_that_are_none(robot: Robot, name: str) -> None:
    buffer = robot.buffer
    with refused(buffer, tfdb.errors.InvalidName):
        buffer.set_transform("map", name, stamp_of(50), (1, 2, 3), TURN)
    with refused(buffer, tfdb.errors.InvalidName):
        buffer.set_static_transform(name, "sensor", (1, 2, 3), TURN)
    good = tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)
    bad = tfdb.TransformStamped("map", name, stamp_of(50), (1, 2, 3), TURN)
    with refused(buffer, tfdb.errors.InvalidName) as caught:
        buffer.set_transforms([good, bad])
    assert caught.value.index == 1


@pytest.mark.parametrize("name", BAD_NAMES[:-1], ids=lambda name: repr(name[:8]))
def test_no_such_name_is_an_unknown_frame(robot: Robot, name: str) -> None:
    with refused(robot.buffer, tfdb.UnknownFrame) as caught:
        robot.buffer.lookup_transform("map", name)
    assert caught.value.frame == name
    assert not robot.buffer.can_transform(name, "map")
    assert not robot.buffer.frame_exists(name)


@pytest.mark.parametrize("name", [7, None, b"map", ("map",)])
def test_names_of_the_wrong_type(robot: Robot, name: Any) -> None:
    for call in (
        lambda: robot.buffer.lookup_transform("map", name),
        lambda: robot.buffer.can_transform(name, "map"),
        lambda: robot.buffer.set_transform(name, "odom", stamp_of(50), (1, 2, 3), TURN),
        lambda: robot.buffer.lookup_transforms("map", name, [5]),
    ):
        with pytest.raises(TypeError):
            call()


def test_unknown_frames_are_named(robot: Robot) -> None:
    buffer = robot.buffer
    commit = buffer.commit
    with refused(buffer, tfdb.UnknownFrame) as caught:
        buffer.lookup_transform("nowhere", "camera", stamp_of(5))
    assert (caught.value.frame, caught.value.target) == ("nowhere", "nowhere")
    assert caught.value.commit == commit
    assert isinstance(caught.value, LookupError)
    with refused(buffer, tfdb.UnknownFrame) as caught:
        buffer.lookup_latest_transform("map", "nowhere")
    assert caught.value.frame == "nowhere"


@pytest.mark.parametrize("time", [None, 5])
def test_target_equal_to_source_with_an_unknown_name(robot: Robot, time: int | None) -> None:
    with refused(robot.buffer, tfdb.UnknownFrame) as caught:
        robot.buffer.lookup_transform("nowhere", "nowhere", time)
    assert caught.value.frame == "nowhere"
    with refused(robot.buffer, tfdb.UnknownFrame):
        robot.buffer.lookup_transforms("nowhere", "nowhere", [5, 6])
    with refused(robot.buffer, tfdb.UnknownFrame):
        robot.buffer.lookup_latest_transform("nowhere", "nowhere")


@pytest.mark.parametrize(
    "call",
    [
        lambda buffer: buffer.frame_info("nowhere"),
        lambda buffer: buffer.samples("nowhere"),
        lambda buffer: buffer.remove_frames("nowhere"),
        lambda buffer: buffer.latest_common_time("map", "nowhere"),
        lambda buffer: buffer.lookup_velocity("map", "nowhere"),
        lambda buffer: buffer.trajectory("map", "nowhere"),
        lambda buffer: buffer.transform_points("map", "nowhere", np.zeros((2, 3)), 5),
    ],
)
def test_all_other_reads_refuse_unknown_frames(
    robot: Robot, call: Callable[[tfdb.Buffer], object]
) -> None:
    with refused(robot.buffer, tfdb.UnknownFrame):
        call(robot.buffer)


# -- stamps ----------------------------------------------------------------------------------------

BAD_STAMPS = [
    -1,
    True,
    False,
    1.5,
    NAN,
    2**61,
    np.int64(2**61),
    2**63,
    -(2**70),
    "5",
    b"5",
    [5],
    np.float64(5),
    np.bool_(True),
    np.datetime64("NaT"),
    np.datetime64("2043-02-01"),
    np.datetime64("2500-01-01"),
    np.datetime64("1969-12-31", "ns"),
    np.timedelta64(5, "ns"),
    np.int64(-5),
    SimpleNamespace(sec=-1, nanosec=0),
    SimpleNamespace(sec=5, nanosec=10**9),
    SimpleNamespace(sec=5.0, nanosec=0),
    SimpleNamespace(secs=2**62, nsecs=0),
    SimpleNamespace(nanoseconds=-5),
]


@pytest.mark.parametrize("stamp", BAD_STAMPS, ids=repr)
def test_stamps_that_are_none(robot: Robot, stamp: Any) -> None:
    buffer = robot.buffer
    good = tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)
    bad = tfdb.TransformStamped("map", "odom", stamp, (1, 2, 3), TURN)
    for call, index in (
        (lambda: buffer.set_transform("map", "odom", stamp, (1, 2, 3), TURN), None),
        (lambda: buffer.set_transforms([good, bad]), 1),
        (lambda: buffer.lookup_transform("map", "odom", stamp), None),
        (lambda: buffer.can_transform("map", "odom", stamp), None),
        (lambda: buffer.lookup_transform_full("map", stamp, "odom", 5, "base"), None),
        (lambda: buffer.lookup_latest_transform("map", "odom", 1.0, stamp), None),
        (lambda: buffer.lookup_transforms("map", "odom", [stamp_of(1), stamp]), 1),
        (lambda: buffer.explain("map", "odom", stamp), None),
        (lambda: buffer.tree(stamp), None),
    ):
        with refused(buffer, tfdb.InvalidStamp) as caught:
            call()
        assert caught.value.index == index
        assert caught.value.value is stamp
        assert "nanoseconds" in str(caught.value)
        assert isinstance(caught.value, ValueError)


def test_a_stamp_must_be_given_where_it_is_stored(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.InvalidStamp):
        robot.buffer.set_transform("map", "odom", None, (1, 2, 3), TURN)


@pytest.mark.parametrize(
    "seconds",
    [
        *(-1, NAN, INF, True, "soon", "", 1e10, "1e999999", None, 10**5000, b"5", "2026-05-17"),
        *("5-6", "nan", "1_000", "\uff11\uff12", "\uff12026-05-17T12:00:00Z"),
        "2026-05-17T12:00:00.\uff11Z",
    ],
    ids=lambda value: ascii(value)[:30] if value != 10**5000 else "10**5000",
)
def test_seconds_that_are_no_stamp(seconds: Any) -> None:
    with pytest.raises(tfdb.InvalidStamp) as caught:
        tfdb.stamp(seconds)
    assert caught.value.value is seconds
