"""Bad options, calls and messages: a typed error that says what, an unchanged store."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from refusal import refused, refused_when_full
from robot import SECOND, Robot, make_robot, stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable

TURN = quaternion((1, -2, 0.5), 0.9)
NAN = float("nan")
INF = float("inf")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return make_robot()


# -- options ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"history": 0},
        {"history": -1.0},
        {"history": NAN},
        {"history": INF},
        {"history": True},
        {"history": "10"},
        {"max_frames": 0},
        {"max_frames": 2**20},
    ],
)
def test_buffers_that_cannot_be(options: dict[str, Any]) -> None:
    with pytest.raises(tfdb.InvalidArgument):
        tfdb.Buffer(**options)


def test_too_many_frames() -> None:
    buffer = tfdb.Buffer(max_frames=4)
    for name in "abc":
        buffer.set_static_transform("map", name, (1, 2, 3), TURN)
    with refused_when_full(buffer):
        buffer.set_static_transform("map", "d", (1, 2, 3), TURN)
    with refused_when_full(buffer):
        buffer.set_transforms(
            [tfdb.TransformStamped("a", name, 5, (1, 2, 3), TURN) for name in ("x", "y", "z")]
        )
    buffer.remove_frame("a")
    buffer.set_static_transform("map", "d", (1, 2, 3), TURN)
    assert buffer.frames() == ["b", "c", "d", "map"]


def test_too_little_memory() -> None:
    buffer = tfdb.Buffer(history=None, memory_limit=1 << 20)

    def fill() -> None:
        for i in range(100_000):
            buffer.set_transform("map", "base", i, (1, 2, 3), TURN)

    with pytest.raises(tfdb.CapacityExceeded):
        fill()
    commit = buffer.commit
    assert commit == buffer.frame_info("base").samples > 1000
    assert buffer.can_transform("map", "base", 10)
    with refused_when_full(buffer):
        buffer.set_transforms(
            tfdb.Columns("map", "other", range(20_000), np.tile([1, 2, 3, *TURN], (20_000, 1)))
        )


@pytest.mark.parametrize(
    "make",
    [
        lambda: tfdb.Interpolate(-1),
        lambda: tfdb.Interpolate(NAN),
        lambda: tfdb.Interpolate(True),
        lambda: tfdb.Previous(INF),
        lambda: tfdb.Nearest(1.0, tolerance_ns=5),
        lambda: tfdb.Nearest(tolerance_ns=-5),
        tfdb.Extrapolate,
    ],
)
def test_policies_that_cannot_be(make: Callable[[], object]) -> None:
    with pytest.raises(tfdb.InvalidArgument):
        make()


@pytest.mark.parametrize("policy", ["linear", 7, tfdb.Exact])
def test_policies_of_the_wrong_type(robot: Robot, policy: Any) -> None:
    with pytest.raises(TypeError, match="policy"):
        robot.buffer.lookup_transform("map", "odom", stamp_of(1), policy)


@pytest.mark.parametrize(
    "options",
    [
        {"layout": "euler"},
        {"missing": "zero"},
    ],
)
def test_options_of_batches(robot: Robot, options: dict[str, Any]) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.lookup_transforms("map", "odom", [stamp_of(1)], **options)


@pytest.mark.parametrize("age", [-1, NAN, "1", True])
def test_ages_that_are_none(robot: Robot, age: Any) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.lookup_latest_transform("map", "odom", age)


@pytest.mark.parametrize("interval", [0, -1, NAN, None])
def test_intervals_that_are_none(robot: Robot, interval: Any) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.lookup_velocity("base", "map", stamp_of(5), interval)


@pytest.mark.parametrize(
    "call",
    [
        lambda b: b.lookup_transform("map"),
        lambda b: b.lookup_transform("map", "odom", 5, None, None),
        lambda b: b.lookup_transform("map", "odom", when=5),
        lambda b: b.lookup_transform("map", "odom", target="map"),
        lambda b: b.set_transform("map", "odom", 5, (1, 2, 3)),
        lambda b: b.set_transform("map", "odom", 5, (1, 2, 3), TURN, "ekf"),
        lambda b: b.can_transform(),
    ],
)
def test_calls_with_the_wrong_arguments(
    robot: Robot, call: Callable[[tfdb.Buffer], object]
) -> None:
    commit = robot.buffer.commit
    with pytest.raises(TypeError, match=r"\(\)"):
        call(robot.buffer)
    assert robot.buffer.commit == commit


# -- messages --------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_every_way_to_cut_a_message(encoding: str) -> None:
    buffer = make_robot().buffer
    batch = [tfdb.TransformStamped("map", "tool", SECOND, (1, 2, 3), TURN)] * 2
    data = tfdb.encode_tf_message(batch, encoding)
    for size in range(len(data)):
        with pytest.raises(tfdb.CorruptMessage) as caught:
            buffer.ingest(data[:size], encoding=encoding)
        assert caught.value.offset is not None
        assert caught.value.offset <= size
        assert caught.value.reason
        with pytest.raises(tfdb.CorruptMessage):
            tfdb.decode_tf_message(data[:size], encoding)
    with refused(buffer, tfdb.CorruptMessage):
        buffer.ingest(b"", encoding=encoding)
    assert not buffer.frame_exists("tool")


def test_names_on_the_wire_that_are_no_text() -> None:
    buffer = make_robot().buffer
    data = tfdb.encode_tf_message([tfdb.TransformStamped("map", "abcd", 5, (1, 2, 3), TURN)])
    bad = data.replace(b"abcd", b"a\xff\xfed")
    with refused(buffer, tfdb.InvalidName) as caught:
        buffer.ingest(bad)
    assert caught.value.index == 0
    with pytest.raises(tfdb.InvalidName):
        tfdb.decode_tf_message(bad)


def test_encodings_and_data_of_the_wrong_kind(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.ingest(b"", encoding="json")
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.ingest_many([], encoding="")
    with pytest.raises(TypeError, match="bytes-like"):
        robot.buffer.ingest("text")
    with pytest.raises(TypeError, match="bytes-like"):
        robot.buffer.ingest_many([b"", 7], encoding="cdr")
    with pytest.raises(tfdb.InvalidStamp) as caught:
        tfdb.encode_tf_message(
            [tfdb.TransformStamped("a", "b", stamp, (1, 2, 3)) for stamp in (5, 2**62)]
        )
    assert caught.value.index == 1


# -- handmade transforms ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("map", "base", (1, 2)), tfdb.InvalidArray),
        (("map", "base", (1, 2, NAN)), tfdb.InvalidTransform),
        (("map", "base", (1, 2, 3), (0, 0, 0, 2)), tfdb.InvalidTransform),
        (("map", "base", (1, 2, 3), TURN, 1.5), tfdb.InvalidStamp),
        (("map", 7, (1, 2, 3)), TypeError),
    ],
)
def test_transforms_that_cannot_be(arguments: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        tfdb.Transform(*arguments)
