"""tf2's BufferCore on tfdb: rules, texts and types, of both sides of ROS."""

from __future__ import annotations

import copy
import logging
import math
import pickle
import subprocess
import sys
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

import numpy as np
import pytest

import tfdb
from tf2.loopback import LoopbackNode
from tf2.ours import message, plain
from tfdb import tf2
from tfdb.tf2 import msgs
from tfdb.tf2.differences import DIFFERENCES
from tfdb.tf2.received_messages import BufferWriter

SECOND = 1_000_000_000
TODAY = 1_700_000_000_123_456_789
TURNED = [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
MOVED = [5.0, 2.0, 3.0, 0.6, 0.0, 0.0, 0.8]
FLAVORS = ["ros1", "ros2"]
EXTRAPOLATIONS = (
    tf2.NoDataForExtrapolationException,
    tf2.ForwardExtrapolationException,
    tf2.BackwardExtrapolationException,
)


@dataclass
class Ros1Time:
    """What rospy.Time offers."""

    secs: int
    nsecs: int

    def to_sec(self) -> float:
        return self.secs + self.nsecs / 1e9

    def to_nsec(self) -> int:
        return self.secs * SECOND + self.nsecs


@dataclass
class Ros2Time:
    """What rclpy.time.Time offers."""

    nanoseconds: int


@dataclass
class SecondsOnly:
    """What tf2 of ROS 1 asks for."""

    value: float

    def to_sec(self) -> float:
        return self.value


@pytest.fixture(params=FLAVORS)
def core(request: pytest.FixtureRequest) -> tf2.BufferCore:
    """Frames a <- b <- c; b moves from 1 s to 3 s, c at 2 s only; a <- s is static."""
    made = tf2.BufferCore(flavor=request.param)
    made.set_transform(message("a", "b", SECOND, TURNED), "first")
    made.set_transform(message("a", "b", 3 * SECOND, MOVED), "second")
    made.set_transform(message("b", "c", 2 * SECOND, MOVED), "third")
    made.set_transform_static(message("a", "s", 9 * SECOND, MOVED), "fourth")
    return made


def with_seconds(core: tf2.BufferCore, text: str) -> str:
    """Nine digits are ROS 1's; ROS 2 writes six."""
    return text if core.flavor == "ros1" else text.replace("000000000", "000000")


@pytest.mark.parametrize(("target", "source"), [("a", "c"), ("c", "a"), ("b", "s"), ("s", "b")])
@pytest.mark.parametrize("stamp", [0, 2 * SECOND])
def test_lookup_is_that_of_the_store(
    core: tf2.BufferCore, target: str, source: str, stamp: int
) -> None:
    frame, child, found, pose = plain(core.lookup_transform_core(target, source, stamp))
    expected = core.buffer.lookup_transform(target, source, stamp or None)
    assert (frame, child, found) == (target, source, expected.stamp)
    assert pose == expected.pose.tolist()
    assert core.can_transform_core(target, source, stamp) == (1, "")


def test_full_lookup_in_both_directions(core: tf2.BufferCore) -> None:
    found = core.lookup_transform_full_core(
        target_frame="b", target_time=SECOND, source_frame="b", source_time=3 * SECOND,
        fixed_frame="a",
    )  # fmt: skip
    expected = core.buffer.lookup_transform_full("b", SECOND, "b", 3 * SECOND, "a")
    assert plain(found) == ["b", "b", SECOND, expected.pose.tolist()]
    back = core.lookup_transform_full_core("b", 3 * SECOND, "b", SECOND, "a")
    assert plain(back)[2:] == [3 * SECOND, pytest.approx(expected.inverse().pose.tolist())]
    assert core.can_transform_full_core("b", SECOND, "b", 3 * SECOND, "a") == (1, "")


def test_keywords_are_those_of_tf2(core: tf2.BufferCore) -> None:
    simple: dict[str, Any] = {"target_frame": "a", "source_frame": "b", "time": 2 * SECOND}
    full: dict[str, Any] = {
        "target_frame": "a", "target_time": 2 * SECOND, "source_frame": "b",
        "source_time": 2 * SECOND,        "fixed_frame": "a",
    }  # fmt: skip
    assert plain(core.lookup_transform_core(**simple)) == plain(
        core.lookup_transform_full_core(**full)
    )
    assert core.can_transform_core(**simple) == core.can_transform_full_core(**full) == (1, "")
    assert core._chain(**full) == ["b", "a"]
    assert core._allFramesAsDot(time=5 * SECOND).startswith("digraph G {")


@pytest.mark.parametrize(
    "time",
    [
        TODAY,
        np.int64(TODAY),
        msgs.Time.from_nanoseconds(TODAY),
        Ros1Time(*divmod(TODAY, SECOND)),
        Ros2Time(TODAY),
    ],
    ids=lambda time: type(time).__name__,
)
def test_no_nanosecond_is_lost(time: Any) -> None:
    core = tf2.BufferCore()
    stamped = message("a", "b", 0, TURNED)
    stamped.header.stamp = time
    core.set_transform(stamped, "me")
    assert core.lookup_transform_core("a", "b", time).header.stamp.nanoseconds == TODAY
    assert core.get_latest_common_time("a", "b").nanoseconds == TODAY
    assert core.can_transform_core("a", "b", TODAY - 1)[0] == 0


def test_times_with_seconds_only() -> None:
    core = tf2.BufferCore(SecondsOnly(5.0))
    assert core.flavor == "ros1"
    assert core.buffer.history == 5.0
    assert tf2.BufferCore(5).buffer.history == tf2.BufferCore(np.float32(5)).buffer.history == 5.0
    core.set_transform(message("a", "b", SECOND + SECOND // 2, TURNED), "me")
    assert core.can_transform_core("a", "b", SecondsOnly(1.5)) == (1, "")


@pytest.mark.parametrize(
    "time", [1.5, None, "1", True, object(), timedelta(1)], ids=lambda time: repr(time)[:9]
)
def test_other_types_of_times_are_refused(core: tf2.BufferCore, time: Any) -> None:
    words = {
        "ros1": "must have a to_sec method, e.g. rospy.Time or rospy.Duration",
        "ros2": "must have sec and nanosec, or nanoseconds.",
    }[core.flavor]
    for ask in (core.lookup_transform_core, core.can_transform_core):
        with pytest.raises(TypeError, match=f"^time {words}"):
            ask("a", "b", time)
    # As a duration a number is seconds.
    if time is not None and not isinstance(time, float):
        with pytest.raises(TypeError, match=f"^cache_time {words}"):
            tf2.BufferCore(time, flavor=core.flavor)


@pytest.mark.parametrize("part", [2.0, 2.9, "2", None, True], ids=repr)
def test_no_part_of_a_time_is_cut_off(core: tf2.BufferCore, part: Any) -> None:
    core.set_transform(message("a", "b", 2 * SECOND, TURNED), "me")
    before = core.buffer.commit
    of_ros1, of_ros2 = Ros1Time(2, 0), Ros2Time(2)
    of_ros1.secs, of_ros2.nanoseconds = part, part
    for time in (msgs.Time(part, 0), msgs.Time(2, part), of_ros1, of_ros2):
        for ask in (core.lookup_transform_core, core.can_transform_core):
            with pytest.raises(TypeError, match="of a time must be an integer"):
                ask("a", "b", time)
        stamped = message("a", "b", 0, TURNED)
        stamped.header.stamp = time
        with pytest.raises(TypeError, match="of a time must be an integer"):
            core.set_transform(stamped, "me")
        with pytest.raises(TypeError, match="of a time must be an integer"):
            tf2.BufferCore(time)
    assert core.buffer.commit == before
    assert core.can_transform_core("a", "b", msgs.Time(np.int32(2), np.uint32(0)))[0] == 1


@pytest.mark.parametrize(
    ("time", "flavor"),
    [(Ros1Time(1, 0), "ros1"), (SecondsOnly(1), "ros1"), (Ros2Time(1), "ros2")],
)
def test_flavor_is_found_from_the_messages(time: Any, flavor: str) -> None:
    assert tf2.BufferCore(time).flavor == flavor
    core = tf2.BufferCore()
    core.set_transform(message("a", "b", SECOND, TURNED), "says nothing")
    stamped = message("a", "b", SECOND, TURNED)
    stamped.header.stamp = time
    core.set_transform(stamped, "me")
    assert core.flavor == flavor
    assert tf2.BufferCore(time, flavor="ros2").flavor == "ros2"


def test_invalid_arguments_of_a_core_are_refused() -> None:
    with pytest.raises(tf2.InvalidArgumentException, match="flavor"):
        tf2.BufferCore(flavor="ros3")  # type: ignore[arg-type]
    with pytest.raises(tf2.InvalidArgumentException, match="negative"):
        tf2.BufferCore(msgs.Duration(-1))
    with pytest.raises(tfdb.InvalidArgument, match="seconds from 0"):
        tf2.BufferCore(-1)
    with pytest.raises(tf2.InvalidArgumentException, match="history"):
        tf2.BufferCore(5, buffer=tfdb.Buffer())
    with pytest.raises(TypeError, match=r"tfdb\.Buffer, got str"):
        tf2.BufferCore(buffer="text")  # type: ignore[arg-type]


def test_a_store_that_is_there() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("a", "b", SECOND, TURNED[:3], TURNED[3:])
    core = tf2.BufferCore(buffer=buffer)
    assert core.buffer is buffer
    assert plain(core.lookup_transform_core("a", "b", SECOND))[3] == pytest.approx(TURNED)


# Errors

EMPTY = {
    "ros1": "Invalid argument passed to {} in tf2 frame_ids cannot be empty",
    "ros2": 'Invalid argument "" passed to {} - in tf2 frame_ids cannot be empty',
}
SLASH = {
    "ros1": "Invalid argument \"/a\" passed to {} in tf2 frame_ids cannot start with a '/' like: ",
    "ros2": "Invalid argument \"/a\" passed to {} - in tf2 frame_ids cannot start with a '/'",
}
UNKNOWN = dict.fromkeys(FLAVORS, '"zz" passed to {} does not exist. ')


@pytest.mark.parametrize("role", ["target_frame", "source_frame", "fixed_frame"])
@pytest.mark.parametrize(
    ("name", "words", "kind", "beneath"),
    [
        ("", EMPTY, tf2.InvalidArgumentException, tfdb.InvalidArgument),
        ("/a", SLASH, tf2.InvalidArgumentException, tfdb.InvalidArgument),
        ("zz", UNKNOWN, tf2.LookupException, tfdb.UnknownFrame),
    ],
)
def test_names_that_are_refused(
    core: tf2.BufferCore, role: str, name: str, words: dict[str, str], kind: Any, beneath: Any
) -> None:
    frames = {"target_frame": "a", "source_frame": "b", role: name}
    text = words[core.flavor]
    if role != "fixed_frame":
        with pytest.raises(kind) as simple:
            core.lookup_transform_core(**frames, time=SECOND)
        assert str(simple.value) == text.format(f"lookupTransform argument {role}")
        assert isinstance(simple.value, beneath)
        assert core.can_transform_core(**frames, time=SECOND)[0] == 0
        with pytest.raises(kind) as common:
            core.get_latest_common_time(frames["target_frame"], frames["source_frame"])
        assert str(common.value) == text.format("get_latest_common_time")
    full = {"fixed_frame": "a", **frames}
    with pytest.raises(kind) as caught:
        core.lookup_transform_full_core(**full, target_time=0, source_time=0)
    assert str(caught.value) == text.format(f"lookupTransform argument {role}")
    can, why = core.can_transform_full_core(**full, target_time=0, source_time=0)
    assert can == 0
    assert role in why


def test_why_not_of_names() -> None:
    ones = tf2.BufferCore(flavor="ros1"), tf2.BufferCore(flavor="ros2")
    told = [core.can_transform_core("zz", "a", 0)[1] for core in ones]
    assert told == [
        "canTransform: target_frame zz does not exist.",
        'Invalid frame ID "zz" passed to canTransform argument target_frame - frame does not exist',
    ]
    assert ones[1].can_transform_core("/a", "a", 0)[1] == (
        'Invalid frame ID "/a" passed to canTransform argument target_frame'
        " - in tf2 frame_ids cannot start with a '/'"
    )
    for core in ones:
        assert "same_frame" in DIFFERENCES
        assert core.can_transform_core("zz", "zz", 0)[0] == 0


@pytest.mark.parametrize(
    ("stamp", "kind", "reason", "one", "two"),
    [
        (
            4 * SECOND,
            tf2.ForwardExtrapolationException,
            "future",
            "Lookup would require extrapolation 1.000000000s into the future.  Requested time "
            "4.000000000 but the latest data is at time 3.000000000, ",
            "Lookup would require extrapolation into the future.  Requested time 4.000000 but the "
            "latest data is at time 3.000000, ",
        ),
        (
            SECOND // 2,
            tf2.BackwardExtrapolationException,
            "past",
            "Lookup would require extrapolation 0.500000000s into the past.  Requested time "
            "0.500000000 but the earliest data is at time 1.000000000, ",
            "Lookup would require extrapolation into the past.  Requested time 0.500000 but the "
            "earliest data is at time 1.000000, ",
        ),
    ],
)
def test_extrapolation(
    core: tf2.BufferCore, stamp: int, kind: Any, reason: str, one: str, two: str
) -> None:
    for target, source in (("a", "b"), ("b", "a")):
        with pytest.raises(tf2.ExtrapolationException) as caught:
            core.lookup_transform_core(target, source, stamp)
        error = caught.value
        start = one if core.flavor == "ros1" else two
        end = f"when looking up transform from frame [{source}] to frame [{target}]"
        assert str(error) == start + end
        assert type(error) is kind
        assert isinstance(error, tfdb.Extrapolation)
        assert (error.target, error.source, error.edge) == (target, source, "b")
        assert (error.stamp, error.oldest, error.newest) == (stamp, SECOND, 3 * SECOND)
        assert error.reason == reason
        assert isinstance(error.__cause__, tfdb.Extrapolation)
        assert core.can_transform_core(target, source, stamp) == (0, str(error))


def test_one_sample_and_none(core: tf2.BufferCore) -> None:
    end = ", when looking up transform from frame [c] to frame [b]"
    with pytest.raises(tf2.NoDataForExtrapolationException) as caught:
        core.lookup_transform_core("b", "c", 3 * SECOND)
    one = "Lookup would require extrapolation at time 3.000000000, but only time 2.000000000 is in"
    assert str(caught.value) == with_seconds(core, f"{one} the buffer") + end
    core.buffer.clear()  # as another process may, of a store that they share
    with pytest.raises(tf2.NoDataForExtrapolationException) as caught:
        core.lookup_transform_core("b", "c", 3 * SECOND)
    none = "Lookup would require extrapolation at time 3.000000, but only time 0.000000 is in the"
    assert str(caught.value) == ("" if core.flavor == "ros1" else f"{none} buffer") + end
    with pytest.raises(tf2.ConnectivityException):
        core.lookup_transform_core("b", "c", 0)
    assert core._getFrameStrings() == ["a", "b", "c", "s"]
    assert plain(core.lookup_transform_core("a", "s", 7 * SECOND))[3] == pytest.approx(MOVED)


def test_two_trees(core: tf2.BufferCore) -> None:
    core.set_transform(message("q", "r", 2 * SECOND, TURNED), "me")
    text = (
        "Could not find a connection between 'c' and 'r' because they are not part of the same "
        "tree.Tf has two or more unconnected trees."
    )
    with pytest.raises(tf2.ConnectivityException) as caught:
        core.lookup_transform_core("c", "r", 2 * SECOND)
    assert str(caught.value) == text
    assert caught.value.frames == ("a", "q")
    assert isinstance(caught.value, tfdb.Disconnected)
    assert core.can_transform_core("c", "r", 0) == (0, text)
    with pytest.raises(tf2.TransformException, match=r"same tree\.Tf has two"):
        core.get_latest_common_time("c", "r")


def test_the_exceptions_are_errors_of_tfdb() -> None:
    pairs = {
        tf2.TransformException: tfdb.TfdbError,
        tf2.LookupException: tfdb.UnknownFrame,
        tf2.ConnectivityException: tfdb.Disconnected,
        tf2.ExtrapolationException: tfdb.Extrapolation,
        tf2.InvalidArgumentException: tfdb.InvalidArgument,
        tf2.TimeoutException: tfdb.WaitTimeout,
    }
    for ours, beneath in pairs.items():
        assert issubclass(ours, tf2.TransformException)
        assert issubclass(ours, beneath)
    assert all(issubclass(each, tf2.ExtrapolationException) for each in EXTRAPOLATIONS)
    error = tf2.LookupException("no frame", frame="zz")
    for copied in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert (type(copied), str(copied), copied.frame) == (tf2.LookupException, "no frame", "zz")


# Writes


@pytest.mark.parametrize(
    ("change", "text", "beneath"),
    [
        ({"child": "a"}, "TF_SELF_TRANSFORM", tfdb.errors.InvalidTransform),
        ({"child": ""}, "TF_NO_CHILD_FRAME_ID", tfdb.errors.InvalidName),
        ({"parent": ""}, "TF_NO_FRAME_ID", tfdb.errors.InvalidName),
        ({"pose": [math.nan, *TURNED[1:]]}, "TF_NAN_INPUT", tfdb.errors.InvalidTransform),
        ({"pose": [math.inf, *TURNED[1:]]}, "TF_NAN_INPUT", tfdb.errors.InvalidTransform),
        (
            {"pose": [1, 2, 3, 0, 0, 0, 0]},
            "TF_DENORMALIZED_QUATERNION",
            tfdb.errors.InvalidTransform,
        ),
        ({"stamp": SECOND}, "TF_OLD_DATA", tfdb.errors.TooOld),
        ({"stamp": -1}, "TF_BAD_STAMP", tfdb.InvalidStamp),
        ({"parent": "b", "child": "a"}, "TF_LOOP", tfdb.errors.CycleError),
        ({"child": "tab\t"}, "TF_BAD_FRAME_ID", tfdb.errors.InvalidName),
    ],
)
@pytest.mark.parametrize("flavor", FLAVORS)
def test_refused_writes(
    flavor: Any,
    change: dict[str, Any],
    text: str,
    beneath: type[tfdb.TfdbError],
    caplog: pytest.LogCaptureFixture,
) -> None:
    core = tf2.BufferCore(flavor=flavor)
    core.set_transform(message("a", "b", 50 * SECOND, TURNED), "me")
    before = core.buffer.commit
    values = {"parent": "a", "child": "b", "stamp": 51 * SECOND, "pose": MOVED, **change}
    with caplog.at_level(logging.WARNING, "tfdb.tf2"):
        core.set_transform(message(**values), "who")
    (record,) = caplog.records
    assert record.getMessage().startswith(text)
    assert "who" in record.getMessage()
    assert type(record.__dict__["error"]) is beneath
    assert core.buffer.commit == before


def test_other_types_of_messages_are_refused(core: tf2.BufferCore) -> None:
    stamped = message("a", "b", 4 * SECOND, TURNED)
    for broken, text in (
        (5, "TransformStamped, got int"),
        (stamped.header, "TransformStamped, got Header"),
        (msgs.TransformStamped(stamped.header, 5, stamped.transform), "child_frame_id must be str"),
        (
            msgs.TransformStamped(stamped.header, "b", msgs.Transform(5)),
            "transform.translation must have members x, y, z",
        ),
        *(
            (
                msgs.TransformStamped(
                    stamped.header,
                    "b",
                    msgs.Transform(msgs.Vector3(0, bad, 0)),  # type: ignore[arg-type]
                ),
                r"transform\.translation\.y must be a number",
            )
            for bad in (None, "1")
        ),
    ):
        with pytest.raises(TypeError, match=text):
            core.set_transform(broken, "me")
    with pytest.raises(TypeError, match="authority"):
        core.set_transform(stamped, 5)  # type: ignore[arg-type]


LONG = [1.0, 2.0, 3.0, 0.0, 0.0, 0.7, 0.7]
UNIT = [1.0, 2.0, 3.0, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]


def by_bytes(core: tf2.BufferCore, stamp: int, poses: list[list[float]], *, static: bool) -> int:
    """Store T[a<-f0], T[a<-f1], ... as a listener of ROS 2 does."""
    node = LoopbackNode()
    members = [message("a", f"f{i}", stamp, pose) for i, pose in enumerate(poses)]
    data = tfdb.encode_tf_message(members, node.encoding)
    return BufferWriter(core, node, static=static).store(data, "who")


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize("road", ["set_transform", "bytes"])
def test_ros_2_normalizes_a_quaternion_of_any_length_and_logs_it_once(
    road: str, static: bool, caplog: pytest.LogCaptureFixture
) -> None:
    core = tf2.BufferCore(flavor="ros2")
    tiny = [*LONG[:3], *(value * 1e-200 for value in LONG[3:])]
    huge = [*LONG[:3], *(value * 1e300 for value in LONG[3:])]
    lengths = [LONG, TURNED, tiny, huge]
    with caplog.at_level(logging.WARNING, "tfdb.tf2"):
        for stamp in (SECOND, 2 * SECOND):
            if road == "bytes":
                assert by_bytes(core, stamp, lengths, static=static) == 0
                continue
            write = core.set_transform_static if static else core.set_transform
            for i, pose in enumerate(lengths):
                write(message("a", f"f{i}", stamp, pose), "who")
    for stamp in (SECOND, 2 * SECOND):
        for i, expected in enumerate([UNIT, TURNED, UNIT, UNIT]):
            found = core.lookup_transform_core("a", f"f{i}", stamp)
            assert plain(found)[3] == pytest.approx(expected, abs=1e-15)
    texts = [record.getMessage() for record in caplog.records]
    assert len(texts) == 3
    assert texts[0].startswith(
        'TF_DENORMALIZED_QUATERNION: The quaternion of child_frame_id "f0" from authority "who" '
        "has the length 0.989949, not 1 (0.000000 0.000000 0.700000 0.700000)."
    )


@pytest.mark.parametrize("spoilt", [[0.0] * 4, [math.inf, 0.0, 0.0, 1.0], [math.nan] * 4])
def test_a_quaternion_that_has_no_direction_is_refused_in_ros_2(
    spoilt: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    core = tf2.BufferCore(flavor="ros2")
    core.set_transform(message("a", "f0", SECOND, [*TURNED[:3], *spoilt]), "who")
    assert by_bytes(core, SECOND, [[*TURNED[:3], *spoilt], TURNED], static=False) == 1
    assert core._getFrameStrings() == ["a", "f1"]
    assert [record.getMessage()[:3] for record in caplog.records] == ["TF_", "TF_"]


def test_other_errors_are_logged_beside_a_normalized_quaternion(
    caplog: pytest.LogCaptureFixture,
) -> None:
    core = tf2.BufferCore(flavor="ros2")
    core.set_transform(message("a", "b", 50 * SECOND, TURNED), "me")
    core.set_transform(message("a", "b", SECOND, LONG), "me")
    core.set_transform(message("b", "a", SECOND, LONG), "me")
    core.set_transform(message("a", "c", SECOND, [math.inf, *LONG[1:]]), "me")
    starts = [record.getMessage().split()[0] for record in caplog.records]
    assert starts == ["TF_OLD_DATA", "TF_LOOP:", "TF_NAN_INPUT:"]


def test_ros_1_refuses_a_quaternion_of_another_length(caplog: pytest.LogCaptureFixture) -> None:
    core = tf2.BufferCore(flavor="ros1")
    core.set_transform(message("a", "b", SECOND, LONG), "me")
    assert core._getFrameStrings() == []
    assert "TF_DENORMALIZED_QUATERNION: Ignoring transform" in caplog.text


def test_one_slash_is_dropped() -> None:
    core = tf2.BufferCore()
    core.set_transform(message("/a", "/b", SECOND, TURNED), "me")
    assert core._getFrameStrings() == ["a", "b"]
    assert core._frameExists("a")
    assert not core._frameExists("/a")
    assert not core._frameExists("")


def test_the_same_stamp_again() -> None:
    x = {}
    for flavor in FLAVORS:
        core = tf2.BufferCore(flavor=flavor)
        for pose in (TURNED, MOVED):
            core.set_transform(message("a", "b", SECOND, pose), "me")
        x[flavor] = plain(core.lookup_transform_core("a", "b", SECOND))[3][0]
    assert x == {"ros1": 1.0, "ros2": 5.0}
    assert "same_stamp" in DIFFERENCES


def test_static_and_moving_switch() -> None:
    """ROS 1: the first write decides for ever. ROS 2: the last one, and the history is gone."""
    for flavor, moving_after_static, static_after_moving in (
        ("ros1", True, False),
        ("ros2", False, True),
    ):
        core = tf2.BufferCore(flavor=flavor)
        core.set_transform_static(message("a", "b", 0, TURNED), "me")
        core.set_transform(message("a", "b", 2 * SECOND, MOVED), "me")
        found = core.can_transform_core("a", "b", 9 * SECOND)[0]
        assert bool(found) == moving_after_static
        assert plain(core.lookup_transform_core("a", "b", 2 * SECOND))[3][0] == 5.0

        core.set_transform(message("c", "d", SECOND, TURNED), "me")
        core.set_transform_static(message("c", "d", 2 * SECOND, MOVED), "me")
        assert bool(core.can_transform_core("c", "d", 9 * SECOND)[0]) == static_after_moving
        first = plain(core.lookup_transform_core("c", "d", SECOND))[3]
        assert first == pytest.approx(MOVED if static_after_moving else TURNED)


def test_a_frame_keeps_its_kind_when_cleared() -> None:
    core = tf2.BufferCore(flavor="ros1")
    core.set_transform(message("a", "b", SECOND, TURNED), "me")
    core.clear()
    core.set_transform_static(message("a", "b", 2 * SECOND, MOVED), "me")
    assert core.can_transform_core("a", "b", 3 * SECOND)[0] == 0
    assert plain(core.lookup_transform_core("a", "b", 2 * SECOND))[3] == pytest.approx(MOVED)


def test_parent_change(core: tf2.BufferCore) -> None:
    """Up to the sample with the new parent the old one is held."""
    core.set_transform(message("q", "c", 3 * SECOND, TURNED), "me")
    held = core.lookup_transform_core("b", "c", 3 * SECOND - 1)
    assert plain(held)[3] == pytest.approx(MOVED)
    with pytest.raises(tf2.ConnectivityException):
        core.lookup_transform_core("b", "c", 3 * SECOND)
    assert plain(core.lookup_transform_core("q", "c", 0))[3] == pytest.approx(TURNED)


@pytest.mark.parametrize("length", [0, 10 * SECOND])
def test_cache_length(length: int) -> None:
    core = tf2.BufferCore(msgs.Duration.from_nanoseconds(length))
    start = 100 * SECOND
    for stamp in (start, start + 5 * SECOND, start + length + 5 * SECOND):
        core.set_transform(message("a", "b", stamp, TURNED), "me")
    assert core.can_transform_core("a", "b", start)[0] == 0
    assert core.can_transform_core("a", "b", start + 5 * SECOND) == (1, "")
    assert core.can_transform_core("a", "b", start + length + 5 * SECOND) == (1, "")


def test_negative_times(core: tf2.BufferCore) -> None:
    """No data is there; a path on which nothing moves has an answer."""
    assert plain(core.lookup_transform_core("a", "s", -5))[2:] == [-5, pytest.approx(MOVED)]
    assert core.can_transform_core("a", "s", -5) == (1, "")
    with pytest.raises(tf2.BackwardExtrapolationException, match=r"Requested time -2.500000"):
        core.lookup_transform_core("a", "b", -2_500_000_000)
    far = 2**61
    with pytest.raises(tf2.ForwardExtrapolationException):
        core.lookup_transform_core("a", "b", far)
    assert plain(core.lookup_transform_core("s", "a", far))[2] == far


# The rest


def test_velocity() -> None:
    core = tf2.BufferCore(flavor="ros2")
    for stamp in range(11):
        angle = 0.1 * stamp
        pose = [0.2 * stamp, 0, 0, 0, 0, math.sin(angle / 2), math.cos(angle / 2)]
        core.set_transform(message("map", "base", stamp * SECOND // 10 + SECOND, pose), "me")
    time, interval = msgs.Time.from_nanoseconds(SECOND * 3 // 2), msgs.Duration(0, SECOND // 5)
    linear, angular = core.lookupVelocityCore("base", "map", time, interval)
    assert linear == pytest.approx((2, 0, 0))
    assert angular == pytest.approx((0, 0, 1))
    point = core.lookupVelocityFullCore("base", "map", "map", (1, 0, 0), "base", time, interval)
    turned = (2 - math.sin(0.5), math.cos(0.5), 0)
    assert point[0] == pytest.approx(turned, rel=1e-2)
    with pytest.raises(tf2.LookupException, match='"zz" passed to lookupVelocity'):
        core.lookupVelocityCore("zz", "map", time, interval)
    with pytest.raises(tf2.ExtrapolationException):
        core.lookupVelocityCore("base", "map", msgs.Time(9), interval)
    with pytest.raises(tf2.InvalidArgumentException):
        core.lookupVelocityCore("base", "map", time, 0)
    for bad in ((math.nan, 0, 0), (0, math.inf, 0)):
        with pytest.raises(tf2.InvalidArgumentException, match="reference point of the velocity"):
            core.lookupVelocityFullCore("base", "map", "map", bad, "base", time, interval)


def test_chain(core: tf2.BufferCore) -> None:
    assert core._chain("s", 2 * SECOND, "c", 2 * SECOND, "a") == ["c", "b", "a", "s"]
    assert core._chain("s", 2 * SECOND, "c", 2 * SECOND, "b") == ["c", "b", "a", "s"]
    assert core._chain("b", 2 * SECOND, "c", 2 * SECOND, "a") == ["c", "b"]
    assert core._chain("c", 2 * SECOND, "s", 2 * SECOND, "a") == ["s", "a", "b", "c"]
    with pytest.raises(tf2.LookupException):
        core._chain("zz", 0, "c", 0, "a")


def test_messages_are_those_of_geometry_msgs() -> None:
    assert msgs.Time.from_nanoseconds(-1) == msgs.Time(-1, SECOND - 1)
    time = msgs.Time(3, 5)
    assert (time.secs, time.nsecs, time.to_nsec()) == (3, 5, 3 * SECOND + 5)
    assert time.to_sec() == pytest.approx(3.000000005)
    assert msgs.TransformStamped().transform.rotation.w == 1.0
    one, other = msgs.TransformStamped(), msgs.TransformStamped()
    one.header.stamp.sec = 5
    assert other.header.stamp.sec == 0


def test_import_of_tfdb_does_not_bring_tf2() -> None:
    code = "import tfdb, sys; assert 'tfdb.tf2' not in sys.modules; tfdb.tf2.BufferCore()"
    subprocess.run([sys.executable, "-c", code], check=True)
