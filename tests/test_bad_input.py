"""Bad input: a typed error that names what and where, and an unchanged store."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from robot import COUNT, SECOND, Robot, make_robot, stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TURN = quaternion((1, -2, 0.5), 0.9)
NAN = float("nan")
INF = float("inf")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return make_robot()


@contextmanager
def refused(buffer: tfdb.Buffer, error: type[tfdb.TfdbError]) -> Iterator[Any]:
    """The call raises `error`, and the store is what it was: commit, frames, samples, lookups."""

    def state() -> object:
        stored = [[part.tolist() for part in buffer.samples(f)[:2]] for f in buffer.frames()]
        return buffer.commit, buffer.tree(), stored

    before = state()
    with pytest.raises(error) as caught:
        yield caught
    assert type(caught.value) is error
    assert state() == before
    buffer.set_static_transform("base", "still_alive", (1, 2, 3), TURN)
    buffer.remove_frame("still_alive")


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
    with refused(buffer, tfdb.InvalidTransform) as caught:
        buffer.set_transform("map", "odom", stamp_of(50), translation, rotation, authority="ekf")
    assert caught.value.index == 0
    assert "odom" in str(caught.value)
    assert caught.value.authority == "ekf"
    with refused(buffer, tfdb.InvalidTransform):
        buffer.set_static_transform("base", "lidar", translation, rotation)
    good = tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)
    bad = tfdb.TransformStamped("map", "new_frame", stamp_of(50), translation, rotation)
    with refused(buffer, tfdb.InvalidTransform) as caught:
        buffer.set_transforms([good, good, bad])
    assert caught.value.index == 2
    with refused(buffer, tfdb.InvalidTransform):
        buffer.ingest(tfdb.encode_tf_message([good, bad]))


@pytest.mark.parametrize("rotation", [(0, 0, 0, 1.0049), (0, 0, 0, 0.9951)])
def test_quaternions_slightly_off_are_mended_and_counted(rotation: tuple[float, ...]) -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 5, (1, 2, 3), rotation)
    assert buffer.counters().normalised == 1
    assert buffer.lookup_transform("map", "base", 5).rotation.tolist() == [0, 0, 0, 1]


def test_a_frame_is_not_its_own_parent(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.InvalidTransform) as caught:
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
    with refused(buffer, tfdb.InvalidArray) as caught:
        buffer.set_transform("map", "odom", stamp_of(50), translation, rotation)
    assert "numbers (x, y, z" in str(caught.value)
    with refused(buffer, tfdb.InvalidArray) as caught:
        buffer.set_transforms(
            [tfdb.TransformStamped("map", "odom", stamp_of(50), translation, rotation)]
        )
    assert caught.value.index == 0


def test_a_cycle(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.CycleError) as caught:
        robot.buffer.set_transform("left_hand", "base", stamp_of(60), (1, 2, 3), TURN)
    assert caught.value.index == 0
    assert {"base", "left_hand"} <= set(caught.value.frames or ())
    batch = [
        tfdb.TransformStamped(parent, child, stamp_of(5), (1, 2, 3), TURN)
        for parent, child in (("x", "y"), ("y", "z"), ("z", "x"))
    ]
    with refused(robot.buffer, tfdb.CycleError):
        robot.buffer.set_transforms(batch)


def test_static_and_moving_do_not_mix(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.StaticConflict) as caught:
        robot.buffer.set_transform("base", "lidar", stamp_of(60), (1, 2, 3), TURN)
    assert caught.value.index == 0
    assert "lidar" in str(caught.value)
    with refused(robot.buffer, tfdb.StaticConflict):
        robot.buffer.set_static_transform("map", "odom", (1, 2, 3), TURN)


def test_samples_older_than_the_history() -> None:
    buffer = make_robot(history=1.0).buffer
    with refused(buffer, tfdb.TooOld) as caught:
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
    with refused(buffer, tfdb.InvalidName):
        buffer.set_transform("map", name, stamp_of(50), (1, 2, 3), TURN)
    with refused(buffer, tfdb.InvalidName):
        buffer.set_static_transform(name, "sensor", (1, 2, 3), TURN)
    good = tfdb.TransformStamped("map", "odom", stamp_of(50), (1, 2, 3), TURN)
    bad = tfdb.TransformStamped("map", name, stamp_of(50), (1, 2, 3), TURN)
    with refused(buffer, tfdb.InvalidName) as caught:
        buffer.set_transforms([good, bad])
    assert caught.value.index == 1


@pytest.mark.parametrize("name", BAD_NAMES[:-1], ids=lambda name: repr(name[:8]))
def test_no_such_name_is_an_unknown_frame(robot: Robot, name: str) -> None:
    with refused(robot.buffer, tfdb.UnknownFrame) as caught:
        robot.buffer.lookup_transform("map", name)
    assert caught.value.frame == name
    assert not robot.buffer.can_transform(name, "map")
    assert not robot.buffer.frame_exists(name)


def test_the_longest_valid_name() -> None:
    buffer = tfdb.Buffer()
    name = "ä" * 512
    buffer.set_transform("map", name, 5, (1, 2, 3), TURN)
    assert buffer.lookup_transform("map", name, 5).source == name


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
        lambda buffer: buffer.remove_frame("nowhere"),
        lambda buffer: buffer.latest_common_time("map", "nowhere"),
        lambda buffer: buffer.lookup_velocity("nowhere", "map"),
        lambda buffer: buffer.trajectory("map", "nowhere"),
        lambda buffer: buffer.transform_points("map", "nowhere", np.zeros((2, 3)), 5),
    ],
)
def test_everything_else_knows_unknown_frames_too(
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
    2**63,
    -(2**70),
    "5",
    b"5",
    [5],
    np.float64(5),
    np.bool_(True),
    np.datetime64("NaT"),
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
    with refused(robot.buffer, tfdb.InvalidStamp):
        robot.buffer.lookup_transform_full("map", None, "odom", 5, "base")


@pytest.mark.parametrize("seconds", [-1, NAN, INF, True, "soon", "", 1e10, "1e999999", None])
def test_seconds_that_are_no_stamp(seconds: Any) -> None:
    with pytest.raises(tfdb.InvalidStamp) as caught:
        tfdb.stamp(seconds)
    assert caught.value.value is seconds


# -- arrays ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamps", "error", "words"),
    [
        (np.array([1.5, 2.5]), tfdb.InvalidArray, "float64"),
        (np.array([True, False]), tfdb.InvalidArray, "bool"),
        (np.array(["a"]), tfdb.InvalidArray, "<U1"),
        (np.zeros((2, 2), np.int64), tfdb.InvalidArray, "(2, 2)"),
        (np.int64(5), tfdb.InvalidArray, "int64"),
        (np.zeros(2, "timedelta64[ns]"), tfdb.InvalidArray, "timedelta64"),
        (7, tfdb.InvalidArray, "int"),
        ("7", tfdb.InvalidArray, "str"),
        (None, tfdb.InvalidArray, "NoneType"),
        (np.array([stamp_of(1), -1]), tfdb.InvalidStamp, "negative"),
        (np.array([stamp_of(1), 2**63], np.uint64), tfdb.InvalidStamp, "negative"),
        (np.array([np.datetime64(stamp_of(1), "ns"), np.datetime64("NaT")]), tfdb.InvalidStamp, ""),
        ([stamp_of(1), 2.5], tfdb.InvalidStamp, "float"),
    ],
)
def test_arrays_of_stamps(
    robot: Robot, stamps: Any, error: type[tfdb.TfdbError], words: str
) -> None:
    with refused(robot.buffer, error) as caught:
        robot.buffer.lookup_transforms("map", "odom", stamps)
    assert words in str(caught.value)
    if error is tfdb.InvalidStamp:
        assert caught.value.index == 1
    columns = tfdb.Columns("map", "odom", stamps, np.tile([1, 2, 3, *TURN], (2, 1)))
    with refused(robot.buffer, error):
        robot.buffer.set_transforms(columns)


@pytest.mark.parametrize(
    "out",
    [
        np.zeros((2, 7), np.float32),
        np.zeros((3, 7)),
        np.zeros((2, 4, 4)),
        np.zeros(14),
        np.zeros((7, 2)).T,
        np.zeros((2, 14))[:, ::2],
        np.zeros((2, 7), ">f8"),
        np.frombuffer(bytes(112)).reshape(2, 7),
        [[0.0] * 7] * 2,
    ],
)
def test_out_of_the_wrong_kind(robot: Robot, out: Any) -> None:
    with refused(robot.buffer, tfdb.InvalidArray) as caught:
        robot.buffer.lookup_transforms("map", "odom", [stamp_of(1), stamp_of(2)], out=out)
    assert "float64 (2, 7)" in str(caught.value)
    if isinstance(out, np.ndarray):
        assert str(out.shape) in str(caught.value)


def overlapping() -> dict[str, Any]:
    memory = np.zeros((4, 3))
    return {"points": memory[:3], "out": memory[1:]}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"points": np.zeros((3, 2))}, "(3, 2)"),
        ({"points": np.zeros(3)}, "(3,)"),
        ({"points": np.zeros((1, 3, 3))}, "(1, 3, 3)"),
        ({"points": np.zeros((3, 3), np.int32)}, "int32"),
        ({"points": np.zeros((3, 3), complex)}, "complex128"),
        ({"points": np.zeros((3, 3), ">f8")}, ">f8"),
        ({"points": np.zeros((3, 3)).T}, "strides"),
        ({"points": np.zeros((3, 6))[:, ::2]}, "strides"),
        ({"points": np.zeros((3, 3))[::-1]}, "strides"),
        ({"points": np.lib.stride_tricks.as_strided(np.zeros(9), (3, 3), (8, 8))}, "strides"),
        ({"points": np.broadcast_to(np.zeros(3), (3, 3))}, "strides"),
        ({"points": [["a", "b", "c"]] * 3}, "float64"),
        ({"stamps": np.full(2, stamp_of(1))}, "2 stamps"),
        ({"stamps": np.full((3, 1), stamp_of(1))}, "(3, 1)"),
        ({"out": np.zeros((2, 3))}, "(2, 3)"),
        ({"out": np.zeros((3, 3), np.float32)}, "float64"),
        ({"out": [[0.0] * 3] * 3}, "list"),
        ({"out": np.zeros((3, 3)).T}, "strides"),
        (overlapping(), "overlap"),
    ],
)
def test_points_of_the_wrong_kind(robot: Robot, arguments: dict[str, Any], words: str) -> None:
    call: dict[str, Any] = {"points": np.zeros((3, 3)), "stamps": np.full(3, stamp_of(1))}
    with refused(robot.buffer, tfdb.InvalidArray) as caught:
        robot.buffer.transform_points("map", "odom", **(call | arguments))
    assert words in str(caught.value)


def test_one_bad_stamp_for_all_points(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.InvalidStamp):
        robot.buffer.transform_points("map", "odom", np.zeros((3, 3)), 1.5)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 2)), np.zeros(4), [[1, 2]], "abc", np.zeros((2, 3, 3)), None]
)
def test_apply_of_the_wrong_shape(robot: Robot, points: Any) -> None:
    with refused(robot.buffer, tfdb.InvalidArray):
        robot.buffer.lookup_transform("map", "odom").apply(points)


@pytest.mark.parametrize(
    "arguments",
    [
        {"poses": np.zeros((2, 6))},
        {"poses": np.zeros(14)},
        {"poses": "poses"},
        {"poses": [[1, 2, 3, 0, 0, 0, "w"]] * 2},
        {"poses": None},
        {"poses": None, "translations": np.zeros((2, 3))},
        {"translations": np.zeros((2, 3)), "rotations": np.zeros((2, 4))},
        {"poses": None, "translations": np.zeros((2, 2)), "rotations": np.zeros((2, 4))},
    ],
)
def test_columns_that_are_none(arguments: dict[str, Any]) -> None:
    call: dict[str, Any] = {"poses": np.tile([1, 2, 3, *TURN], (2, 1))} | arguments
    with pytest.raises(tfdb.InvalidArray):
        tfdb.Columns("map", "odom", [1, 2], **call)


@pytest.mark.parametrize(
    ("parents", "children", "stamps", "error"),
    [
        (["map"], ["odom", "odom"], [1, 2], tfdb.InvalidArray),
        ("map", ["odom"] * 3, [1, 2], tfdb.InvalidArray),
        ("map", "odom", [1, 2, 3], tfdb.InvalidArray),
        ("map", "odom", [], tfdb.InvalidArray),
        ("map", "odom", None, tfdb.InvalidArray),
        (["map", ""], "new", [1, 2], tfdb.InvalidName),
        (["map", "\ud800"], "new", [1, 2], tfdb.InvalidName),
    ],
)
def test_columns_that_do_not_fit(
    robot: Robot, parents: Any, children: Any, stamps: Any, error: type[tfdb.TfdbError]
) -> None:
    columns = tfdb.Columns(parents, children, stamps, np.tile([1, 2, 3, *TURN], (2, 1)))
    with refused(robot.buffer, error) as caught:
        robot.buffer.set_transforms(columns)
    if error is tfdb.InvalidName:
        assert caught.value.index == 1


def test_columns_with_one_bad_row(robot: Robot) -> None:
    poses = np.tile([1.0, 2.0, 3.0, *TURN], (5, 1))
    poses[3, 1] = NAN
    stamps = [stamp_of(50 + i) for i in range(5)]
    with refused(robot.buffer, tfdb.InvalidTransform) as caught:
        robot.buffer.set_transforms(tfdb.Columns("map", "odom", stamps, poses))
    assert caught.value.index == 3


@pytest.mark.parametrize("item", [7, None, ("map", "odom", 5), {"parent": "map"}, object()])
def test_batches_of_other_things(robot: Robot, item: object) -> None:
    commit = robot.buffer.commit
    with pytest.raises(TypeError, match="item 0"):
        robot.buffer.set_transforms([item])
    assert robot.buffer.commit == commit


# -- trajectories ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamps", "rows"),
    [([], 0), ([1, 3, 2], 3), ([1, 1], 2), ([1, 2], 3), ([1.0, 2.0], 2)],
)
def test_trajectories_with_bad_stamps(stamps: list[int], rows: int) -> None:
    with pytest.raises(tfdb.InvalidArray):
        tfdb.Trajectory("map", "odom", np.array(stamps), np.zeros((rows, 7)))


def test_unsorted_trajectories_say_where() -> None:
    with pytest.raises(tfdb.InvalidArray) as caught:
        tfdb.Trajectory("map", "odom", np.array([1, 3, 2]), np.zeros((3, 7)))
    assert (caught.value.index, caught.value.stamp) == (2, 2)


@pytest.mark.parametrize(
    "arguments",
    [
        {"rate": 0},
        {"rate": -1.0},
        {"rate": NAN},
        {"rate": INF},
        {"rate": True},
        {"rate": 1e12},
        {"rate": 1.0, "start": stamp_of(5), "end": stamp_of(4)},
        {"source": "lidar", "target": "base"},
        {"source": "lidar", "target": "base", "rate": 1.0},
        {"start": stamp_of(100)},
    ],
)
def test_trajectories_that_cannot_be(robot: Robot, arguments: dict[str, Any]) -> None:
    call: dict[str, Any] = {"target": "map", "source": "camera"} | arguments
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.trajectory(**call)


def test_a_trajectory_beyond_the_data(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.Extrapolation) as caught:
        robot.buffer.trajectory("map", "camera", 1.0, stamp_of(0), stamp_of(COUNT + 10))
    assert caught.value.index == 4


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


@contextmanager
def refused_when_full(buffer: tfdb.Buffer) -> Iterator[None]:
    before = (buffer.commit, buffer.frames())
    with pytest.raises(tfdb.CapacityExceeded):
        yield
    assert (buffer.commit, buffer.frames()) == before


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
