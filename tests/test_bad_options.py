"""Bad options, calls and messages raise a typed error and leave the store unchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from refused_calls import refused, refused_when_full
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
        {"max_frames": -1},
        {"max_frames": 2**63},
        {"max_frames": 1 << 40_000},
        {"max_frames": 10.0},
        {"max_frames": None},
        {"max_frames": True},
        {"memory_limit": -1},
        {"memory_limit": 2**64},
        {"memory_limit": 1e9},
        {"snapshot_memory": -1},
        {"snapshot_memory": 2**64},
        {"snapshot_memory": None},
    ],
)
def test_buffers_that_cannot_be(options: dict[str, Any]) -> None:
    (name,) = options
    with pytest.raises(tfdb.InvalidArgument, match=f"^{name} must be "):
        tfdb.Buffer(**options)


def test_limits_of_a_buffer_are_any_integers_in_range() -> None:
    buffer = tfdb.Buffer(
        max_frames=np.int32(3),
        memory_limit=2**64 - 1,
        snapshot_memory=0,
    )
    buffer.set_transform("map", "base", 5, (1, 2, 3), TURN)
    with buffer.snapshot() as snapshot:
        assert snapshot.can_transform("map", "base", 5)


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
    buffer.remove_frames("a")
    buffer.set_static_transform("map", "d", (1, 2, 3), TURN)
    assert buffer.frames() == ["b", "c", "d", "map"]


def test_too_little_memory() -> None:
    buffer = tfdb.Buffer(history=None, memory_limit=1 << 20)

    def fill() -> None:
        for i in range(100_000):
            buffer.set_transform("map", "base", i, (1, 2, 3), TURN)

    with pytest.raises(tfdb.errors.CapacityExceeded):
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
        lambda: tfdb.Interpolate(max_gap_ns=2**63),
        lambda: tfdb.Interpolate(max_gap_ns=1 << 40_000),
        lambda: tfdb.Interpolate(1 << 40_000),
        lambda: tfdb.Interpolate("1"),  # type: ignore[arg-type]
        lambda: tfdb.Previous(max_age_ns=1.5),  # type: ignore[arg-type]
        lambda: tfdb.Nearest(tolerance_ns=True),
        lambda: tfdb.Extrapolate(max_ns=2**64),
    ],
)
def test_policies_that_cannot_be(make: Callable[[], object]) -> None:
    with pytest.raises(tfdb.InvalidArgument) as caught:
        make()
    assert str(caught.value).startswith(("max", "tolerance", "give tolerance", "Extrapolate needs"))
    assert len(str(caught.value)) < 200


def test_the_longest_limits_of_policies() -> None:
    assert tfdb.Interpolate(max_gap_ns=2**63 - 1).limit_ns is None  # no gap is longer
    assert tfdb.Previous(max_age_ns=np.int64(7)).limit_ns == 7
    assert tfdb.Nearest(np.float32(0.5)).limit_ns == 500_000_000


@pytest.mark.parametrize("policy", ["linear", 7, tfdb.Exact])
def test_policies_of_the_wrong_type(robot: Robot, policy: Any) -> None:
    with pytest.raises(TypeError, match="policy"):
        robot.buffer.lookup_transform("map", "odom", stamp_of(1), policy)


@pytest.mark.parametrize(
    "options",
    [
        {"layout": "euler"},
        {"missing": "zero"},
        {"layout": "\udc80"},
        {"missing": "\udc80"},
        {"layout": "\N{GREEK SMALL LETTER PI}"},
    ],
)
def test_options_of_batches(robot: Robot, options: dict[str, Any]) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument) as caught:
        robot.buffer.lookup_transforms("map", "odom", [stamp_of(1)], **options)
    ((name, value),) = options.items()
    assert type(caught.value) is tfdb.InvalidArgument
    assert str(caught.value).startswith(f"{name} must be '")
    assert caught.value.value == value


@pytest.mark.parametrize("age", [-1, NAN, "1", True])
def test_ages_that_are_none(robot: Robot, age: Any) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.lookup_latest_transform("map", "odom", age)


@pytest.mark.parametrize("interval", [0, -1, NAN, None])
def test_intervals_that_are_none(robot: Robot, interval: Any) -> None:
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.lookup_velocity("map", "base", stamp_of(5), interval)


@pytest.mark.parametrize(
    "call",
    [
        lambda b: b.lookup_transform("map"),
        lambda b: b.lookup_transform("map", "odom", 5, None, None),
        lambda b: b.lookup_transform("map", "odom", when=5),
        lambda b: b.lookup_transform("map", "odom", target="map"),
        lambda b: b.set_transform("map", "odom", 5),
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
        with pytest.raises(tfdb.errors.CorruptMessage) as caught:
            buffer.ingest(data[:size], encoding=encoding)
        assert caught.value.offset is not None
        assert caught.value.offset <= size
        assert caught.value.reason
        with pytest.raises(tfdb.errors.CorruptMessage):
            tfdb.decode_tf_message(data[:size], encoding)
    with refused(buffer, tfdb.errors.CorruptMessage):
        buffer.ingest(b"", encoding=encoding)
    assert not buffer.frame_exists("tool")


def test_names_on_the_wire_that_are_no_text() -> None:
    buffer = make_robot().buffer
    data = tfdb.encode_tf_message([tfdb.TransformStamped("map", "abcd", 5, (1, 2, 3), TURN)])
    bad = data.replace(b"abcd", b"a\xff\xfed")
    with refused(buffer, tfdb.errors.InvalidName) as caught:
        buffer.ingest(bad)
    assert caught.value.index == 0
    with pytest.raises(tfdb.errors.InvalidName):
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
        (("map", "base", (1, 2)), tfdb.errors.InvalidArray),
        (("map", "base", (1, 2, NAN)), tfdb.errors.InvalidTransform),
        (("map", "base", (1, 2, 3), (0, 0, 0, 2)), tfdb.errors.InvalidTransform),
        (("map", "base", (1, 2, 3), TURN, 1.5), tfdb.InvalidStamp),
        (("map", 7, (1, 2, 3)), TypeError),
        (("map", "base", (1, 2, INF)), tfdb.errors.InvalidTransform),
        (("", "base", (1, 2, 3)), tfdb.errors.InvalidName),
        (("map", "ba\nse", (1, 2, 3)), tfdb.errors.InvalidName),
        (("m" * 1025, "base", (1, 2, 3)), tfdb.errors.InvalidName),
        (("map", "\ud800", (1, 2, 3)), tfdb.errors.InvalidName),
    ],
)
def test_transforms_that_cannot_be(arguments: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        tfdb.Transform(*arguments)


FAR = 1.7e308
HALF_TURN = (0.5**0.5, 0.0, 0.0, 0.5**0.5)


def test_results_of_transforms_are_finite_or_refused() -> None:
    """By the rule of the store, which takes the numbers and refuses the same results."""
    there = tfdb.Transform("a", "b", (FAR, FAR, FAR), HALF_TURN, 7)
    on = tfdb.Transform("b", "c", (FAR, FAR, FAR), HALF_TURN)
    store = tfdb.Buffer(history=None)
    for made in (there, on):
        assert np.isfinite(made.pose).all()
        store.set_static_transform(made.target, made.source, made.translation, made.rotation)
    calls: list[tuple[str, str, Callable[[], object]]] = [
        ("b", "a", there.inverse),
        ("a", "c", lambda: there @ on),
    ]
    for target, source, compute in calls:
        for call in (compute, lambda: store.lookup_transform(target, source, 7)):  # noqa: B023
            with pytest.raises(tfdb.errors.InvalidTransform) as caught:
                call()
            error = caught.value
            assert (error.target, error.source, error.stamp) == (target, source, 7)
            assert error.reason == "not finite"


@pytest.mark.parametrize(("dtype", "far"), [(np.float64, FAR), (np.float32, 3e38)])
def test_points_without_a_finite_place_are_refused(dtype: type, far: float) -> None:
    there = tfdb.Transform("a", "b", (far, far, far), HALF_TURN, 7)
    points = np.array([[1, 2, 3], [NAN, 2, 3], [1, INF, 3], [far, far, far]], dtype)
    taken = there.apply(points[:3])
    assert np.isfinite(taken).all(axis=1).tolist() == [True, False, False]
    with pytest.raises(tfdb.errors.InvalidTransform) as caught:
        there.apply(points)
    assert (caught.value.index, caught.value.reason) == (3, "not finite")
    with pytest.raises(tfdb.errors.InvalidTransform):
        there.apply(points[3])
