"""Messages and calls of the native code equal those of Python."""

from __future__ import annotations

import copy
import gc
import pickle
import sys
import weakref
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import pytest

import tfdb
from tf2.ours import message, plain
from tfdb import tf2
from tfdb._core import MessageMaker
from tfdb.ros import ros_messages
from tfdb.tf2 import msgs

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

SECOND = 1_000_000_000
STAMP = 1_700_000_000_123_456_789
POSE = [1.5, -2.5, 3.25, 0.0, 0.6, 0.0, 0.8]


class Generated:
    """What rosidl generates: each slot behind a property whose setter checks."""

    __slots__ = ("_check_fields",)
    fields: ClassVar[dict[str, Callable[[], Any]]] = {}

    def __init__(self) -> None:
        self._check_fields = False
        for name, default in self.fields.items():
            setattr(self, name, default())

    def __init_subclass__(cls) -> None:
        def bind(slot: str) -> property:
            kind = type(cls.fields[slot[1:]]())

            def write(self: Generated, value: Any) -> None:
                assert isinstance(value, kind), slot
                setattr(self, slot, value)

            return property(lambda self: getattr(self, slot), write)

        for name in cls.fields:
            setattr(cls, name, bind(f"_{name}"))


class Time(Generated):
    __slots__ = ("_nanosec", "_sec")
    fields: ClassVar = {"sec": int, "nanosec": int}


class Header(Generated):
    __slots__ = ("_frame_id", "_stamp")
    fields: ClassVar = {"stamp": Time, "frame_id": str}


class Vector3(Generated):
    __slots__ = ("_x", "_y", "_z")
    fields: ClassVar = dict.fromkeys("xyz", float)


class Quaternion(Generated):
    __slots__ = ("_w", "_x", "_y", "_z")
    fields: ClassVar = {**dict.fromkeys("xyz", float), "w": lambda: 1.0}


class Transform(Generated):
    __slots__ = ("_rotation", "_translation")
    fields: ClassVar = {"translation": Vector3, "rotation": Quaternion}


class TransformStamped(Generated):
    __slots__ = ("_child_frame_id", "_header", "_transform")
    fields: ClassVar = {"header": Header, "child_frame_id": str, "transform": Transform}


def make_generated(target: str, source: str, stamp: int, pose: Sequence[float]) -> Any:
    made: Any = TransformStamped()
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(stamp, SECOND)
    return ros_messages.fill(made, target, source, pose)


def slots(value: Any) -> Any:
    """All that a message holds, whatever the classes call it; also what is not set."""
    names = [
        name for base in type(value).__mro__ for name in getattr(base, "__slots__", ()) if name
    ]
    if not names:
        return type(value), value
    return type(value), {name: slots(getattr(value, name, None)) for name in names}


def parts(value: Any) -> list[Any]:
    """The objects of a message, itself included."""
    held = gc.get_referents(value)
    inner = [each for each in held if type(each).__module__ == type(value).__module__]
    return [value, *(part for each in inner for part in parts(each))]


MAKES = [ros_messages.make_ours, make_generated]


@pytest.mark.parametrize("make", MAKES)
@pytest.mark.parametrize("stamp", [0, 1, STAMP, 2**31 * SECOND - 1, 2**31 * SECOND, 2**61, -1])
def test_each_field_is_that_of_the_function(make: Callable[..., Any], stamp: int) -> None:
    maker = MessageMaker(make)
    assert maker.is_quick
    made, expected = maker("map", "ba\u00dfe", stamp, POSE), make("map", "ba\u00dfe", stamp, POSE)
    assert slots(made) == slots(expected)
    assert made.transform.rotation.w == 0.8


@pytest.mark.parametrize("make", MAKES)
def test_messages_share_no_part(make: Callable[..., Any]) -> None:
    maker = MessageMaker(make)
    first, second = maker("a", "b", STAMP, POSE), maker("a", "b", STAMP, POSE)
    assert len(parts(first)) == 6
    assert not {id(part) for part in parts(first)} & {id(part) for part in parts(second)}
    second.transform.translation.x = second.transform.rotation.w = 9.0
    second.header.frame_id = "c"
    assert slots(first) == slots(make("a", "b", STAMP, POSE))
    copied = copy.deepcopy(first)
    assert slots(copied) == slots(first)


def test_other_field_types_are_made_by_the_python_function() -> None:
    class Name(str):
        __slots__ = ()

    maker = MessageMaker(ros_messages.make_ours)
    made = maker(Name("a"), "b", 2**70, POSE)
    assert type(made.header.frame_id) is Name
    assert made.header.stamp.nanoseconds == 2**70
    with pytest.raises(ValueError, match="unpack"):
        maker("a", "b", STAMP, [1.0])


class WithDict:
    def __init__(self, *values: Any) -> None:
        self.values = values


class Slotted:
    __slots__ = ("a", "b", "extra", "numbers")

    def __init__(self, extra: Any, a: Any, b: Any, *numbers: Any) -> None:
        self.extra, self.a, self.b = extra, a, b
        self.numbers = Numbers(*numbers)


class Numbers:
    __slots__ = ("n", "q", "s", "t")

    def __init__(self, stamp: int, pose: Sequence[float]) -> None:
        self.s, self.n = divmod(stamp, SECOND)
        self.t, self.q = msgs.Vector3(*pose[:3]), msgs.Quaternion(*pose[3:])


class Counted(Slotted):
    __slots__ = ()
    made = 0

    def __new__(cls, *_: Any) -> Self:
        cls.made += 1
        return super().__new__(cls)


class Pair(tuple[Any, ...]):
    __slots__ = ()


UNUSUAL: dict[str, Callable[..., Any]] = {
    "a dict": WithDict,
    "a list inside": lambda *given: Slotted([1], *given),
    "no object": lambda *given: list(given),
    "a class that counts": lambda *given: Counted(0, *given),
    "a tuple": lambda *given: Pair(given),
    "a value twice": lambda *given: Slotted(given[0], *given),
    "a value missing": lambda _, *given: Slotted(0, "?", *given),
    "a value derived": lambda *given: Slotted(given[2] + 1, *given),
    "a circle": lambda *given: circle(Slotted(0, *given)),
}


def circle(made: Slotted) -> Slotted:
    made.extra = made
    return made


@pytest.mark.parametrize("name", UNUSUAL)
def test_classes_that_are_otherwise(name: str) -> None:
    make = UNUSUAL[name]
    maker = MessageMaker(make)
    assert not maker.is_quick
    before = Counted.made
    made = maker("a", "b", STAMP, POSE)
    assert type(made) is type(make("a", "b", STAMP, POSE))
    assert Counted.made == (before + 2 if name == "a class that counts" else before)
    assert MessageMaker(lambda *given: Slotted(0, *given)).is_quick


def test_a_function_that_fails_once_is_asked_again() -> None:
    failures = [ImportError("not yet")]

    def make(*given: Any) -> Any:
        if failures:
            raise failures.pop()
        return ros_messages.make_ours(*given)

    maker = MessageMaker(make)
    with pytest.raises(ImportError, match="not yet"):
        maker("a", "b", STAMP, POSE)
    assert plain(maker("a", "b", STAMP, POSE)) == ["a", "b", STAMP, POSE]
    assert maker.is_quick


def test_nothing_leaks() -> None:
    maker = MessageMaker(make_generated)
    target, source = "t" * 50, "s" * 50

    def run(count: int) -> int:
        for _ in range(count):
            maker(target, source, STAMP, POSE)
        gc.collect()
        return sys.getallocatedblocks()

    run(100)
    counts = [sys.getrefcount(each) for each in (target, source, Vector3, TransformStamped)]
    before = run(100)
    assert run(2_000) - before < 100
    assert [sys.getrefcount(each) for each in (target, source, Vector3, TransformStamped)] == counts


# The calls


class Buffer(tf2.Buffer):
    """Notes which of its calls were not plain."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.slow: list[str] = []

    def _lookup_transform_core(self, *given: Any) -> Any:
        self.slow.append("lookup_transform_core")
        return super()._lookup_transform_core(*given)

    def _can_transform_core(self, *given: Any) -> Any:
        self.slow.append("can_transform_core")
        return super()._can_transform_core(*given)

    def _set_transform(self, *given: Any) -> Any:
        self.slow.append("set_transform")
        return super()._set_transform(*given)

    def _lookup_transform(self, *given: Any) -> Any:
        self.slow.append(f"lookup_transform {given[3]}")
        return super()._lookup_transform(*given)

    def _can_transform(self, *given: Any) -> Any:
        self.slow.append(f"can_transform {given[3]}")
        return super()._can_transform(*given)


class Ros1Time:
    """What rospy.Time offers."""

    def __init__(self, stamp: int) -> None:
        self.secs, self.nsecs = divmod(stamp, SECOND)

    def to_sec(self) -> float:
        return self.secs + self.nsecs / 1e9


class Ros2Time:
    """What rclpy.time.Time offers."""

    def __init__(self, stamp: int) -> None:
        self.nanoseconds = stamp


@pytest.fixture(params=["ros1", "ros2"])
def buffer(request: pytest.FixtureRequest) -> Buffer:
    """Frame a <- b <- c, both moving from 1 s to 3 s; every kind of call was there once."""
    made = Buffer(flavor=request.param)
    for second, turned in ((1, POSE), (3, [2.0, 1.0, 0.0, 0.6, 0.0, 0.0, 0.8])):
        made.set_transform(message("a", "b", second * SECOND, turned), "me")
        made.set_transform(message("/b", "c", second * SECOND, turned[3:6] + POSE[3:]), "me")
    made.slow.clear()
    return made


@pytest.mark.parametrize("kind", [int, msgs.Time.from_nanoseconds, Ros1Time, Ros2Time])
@pytest.mark.parametrize("stamp", [0, 2 * SECOND, 2 * SECOND + 7])
def test_plain_calls(buffer: Buffer, kind: Callable[[int], Any], stamp: int) -> None:
    time = kind(stamp)
    found = buffer.lookup_transform("a", "c", time)
    expected = buffer.buffer.lookup_transform("a", "c", stamp or None)
    assert plain(found) == ["a", "c", expected.stamp, expected.pose.tolist()]
    assert slots(found) == slots(buffer.lookup_transform_core("a", "c", time))
    assert slots(found) == slots(buffer.lookup_transform("a", "c", time, msgs.Duration(1, 0)))
    assert buffer.can_transform("a", "c", time, 2.5) == 1
    assert buffer.can_transform_core("c", "a", time) == (1, "")
    assert not buffer.slow
    assert slots(found) == slots(buffer._lookup_transform_core("a", "c", time))


def test_keywords(buffer: Buffer) -> None:
    asked: dict[str, Any] = {"target_frame": "a", "source_frame": "c", "time": 2 * SECOND}
    found = plain(buffer.lookup_transform("a", "c", 2 * SECOND))
    assert plain(buffer.lookup_transform(**asked)) == found
    assert plain(buffer.lookup_transform(**asked, timeout=msgs.Duration())) == found
    assert plain(buffer.lookup_transform_core(**asked)) == found
    assert buffer.can_transform(**asked, timeout=1, return_debug_tuple=False) == 1
    assert buffer.can_transform_core(**asked) == (1, "")
    later = message("a", "b", 4 * SECOND, POSE)
    assert buffer.set_transform(authority="me", transform=later) is None
    assert not buffer.slow
    for call in (buffer.lookup_transform, buffer.can_transform, buffer.lookup_transform_core):
        with pytest.raises(TypeError, match="missing the argument 'time'"):
            call("a", "c")  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="unexpected keyword argument 'stamp'"):
            call("a", "c", stamp=1)  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="at most"):
            call("a", "c", 1, 2, 3, 4)  # type: ignore[call-arg]


def test_other_calls_are_answered_in_python(buffer: Buffer) -> None:
    late = 9 * SECOND
    assert buffer.can_transform("a", "c", late) == 0
    assert not buffer.slow
    assert buffer.can_transform("a", "c", late, 0.002) == 0
    assert buffer.can_transform("a", "c", late, None, True)[0] == 0
    with pytest.raises(tf2.ExtrapolationException):
        buffer.lookup_transform("a", "c", late)
    with pytest.raises(tf2.LookupException):
        buffer.lookup_transform("a", "z", 0, timeout=msgs.Duration(0, 2_000_000))
    with pytest.raises(TypeError, match="time must have"):
        buffer.lookup_transform("a", "c", 1.5)
    with pytest.raises(TypeError):
        buffer.can_transform_core("a", 5, 0)  # type: ignore[arg-type]
    assert set(buffer.slow) == {
        "can_transform 0.002", "can_transform None", "can_transform_core",
        f"lookup_transform {msgs.Duration(0, 2_000_000)}", "lookup_transform None",
        "lookup_transform_core",
    }  # fmt: skip


def test_times_of_other_types_reach_python_unchanged(buffer: Buffer) -> None:
    buffer.slow.clear()
    found = buffer.lookup_transform("a", "c", np.int64(2 * SECOND))
    assert plain(found) == plain(buffer.lookup_transform("a", "c", 2 * SECOND))
    assert buffer.slow == ["lookup_transform None", "lookup_transform_core"]


class Interrupting:
    """Has no number: reading it ends the program."""

    @property
    def sec(self) -> int:
        raise KeyboardInterrupt


class Failing:
    @property
    def sec(self) -> int:
        raise ArithmeticError("no clock")


def test_exceptions_of_a_time_object_are_raised(buffer: Buffer) -> None:
    with pytest.raises(KeyboardInterrupt):
        buffer.lookup_transform("a", "c", Interrupting())
    assert not buffer.slow
    with pytest.raises(ArithmeticError, match="no clock"):
        buffer.lookup_transform("a", "c", Failing())
    with pytest.raises(ArithmeticError, match="no clock"):
        buffer.can_transform("a", "c", Failing())


def test_writes(buffer: Buffer) -> None:
    stamped = message("/a", "/d", 2 * SECOND, POSE)
    assert buffer.set_transform(stamped, "me") is None
    assert not buffer.slow
    assert plain(buffer.lookup_transform("a", "d", 2 * SECOND))[3] == pytest.approx(POSE)
    assert buffer.buffer.frame_info("d").authority == "me"
    # Of the same stamp ROS 1 keeps the first value, ROS 2 the last one.
    again = message("a", "d", 2 * SECOND, [5.0, *POSE[1:]])
    buffer.set_transform(again, "me")
    kept = 1.5 if buffer.flavor == "ros1" else 5.0
    assert buffer.lookup_transform("a", "d", 2 * SECOND).transform.translation.x == kept
    assert buffer.slow == (["set_transform"] if buffer.flavor == "ros1" else [])
    # And of a static frame ROS 1 keeps the kind.
    buffer.set_transform_static(message("a", "s", 0, POSE), "me")
    buffer.set_transform(message("a", "s", 5 * SECOND, POSE), "me")
    assert buffer.buffer.frame_info("s").is_static is (buffer.flavor == "ros1")


@pytest.mark.parametrize(
    ("given", "authority", "text"),
    [
        (5, "me", "transform must be a TransformStamped, got int"),
        (message("a", "b", 0, POSE), 5, "authority must be a str, got int"),
        (msgs.TransformStamped(msgs.Header(), 5), "me", "must be str"),  # type: ignore[arg-type]
        (
            msgs.TransformStamped(msgs.Header(1.5, "a"), "b"),  # type: ignore[arg-type]
            "me",
            "time must have",
        ),
        (
            msgs.TransformStamped(
                msgs.Header(msgs.Time(1), "a"),
                "b",
                msgs.Transform(msgs.Quaternion(), None),  # type: ignore[arg-type]
            ),
            "me",
            r"transform\.rotation must have members",
        ),
    ],
)
def test_other_types_of_messages_are_refused(
    buffer: Buffer, given: Any, authority: Any, text: str
) -> None:
    with pytest.raises(TypeError, match=text):
        buffer.set_transform(given, authority)


def test_the_first_time_object_sets_the_flavor() -> None:
    buffer = Buffer()
    buffer.set_transform(message("a", "b", SECOND, POSE), "me")
    buffer.set_transform(message("a", "b", 2 * SECOND, POSE), "me")
    assert buffer.can_transform("a", "b", msgs.Time(1, 5)) == 1
    assert buffer.slow == ["set_transform"]
    assert buffer.can_transform("a", "b", Ros1Time(SECOND)) == 1
    assert buffer.flavor == "ros1"
    assert buffer.slow == ["set_transform", "can_transform None"]
    assert buffer.can_transform("a", "b", Ros1Time(SECOND)) == 1
    assert buffer.lookup_transform("a", "b", Ros2Time(SECOND)).child_frame_id == "b"
    assert len(buffer.slow) == 2


def test_a_method_of_a_subclass_counts() -> None:
    class Mirrored(Buffer):
        def lookup_transform_core(self, target_frame: str, source_frame: str, time: Any) -> Any:
            return super().lookup_transform_core(source_frame, target_frame, time)

        def can_transform_core(self, *_: Any) -> tuple[int, str]:
            return 0, "never"

    buffer = Mirrored(flavor="ros2")
    for stamp in (SECOND, 2 * SECOND):
        buffer.set_transform(message("a", "b", stamp, POSE), "me")
    assert plain(buffer.lookup_transform("b", "a", SECOND))[:2] == ["a", "b"]
    assert buffer.can_transform("a", "b", SECOND) == 0
    assert buffer.can_transform("a", "b", SECOND, return_debug_tuple=True) == (0, "never")


def test_a_store_of_the_users_own_class_is_asked_itself() -> None:
    class Noting(tfdb.Buffer):
        asked = 0

        def lookup_transform(self, *given: Any, **named: Any) -> Any:
            self.asked += 1
            return super().lookup_transform(*given, **named)

    store = Noting()
    buffer = Buffer(buffer=store, flavor="ros2")
    buffer.set_transform(message("a", "b", SECOND, POSE), "me")
    for _ in range(3):
        buffer.lookup_transform("a", "b", SECOND)
    assert store.asked == 3


def test_a_closed_store_raises(buffer: Buffer) -> None:
    buffer.buffer.close()
    for call in (
        lambda: buffer.lookup_transform("a", "b", SECOND),
        lambda: buffer.can_transform("a", "b", SECOND),
        lambda: buffer.set_transform(message("a", "b", 9 * SECOND, POSE), "me"),
    ):
        with pytest.raises(tfdb.errors.BufferClosed):
            call()


def test_before_init_and_after() -> None:
    bare = Buffer.__new__(Buffer)
    with pytest.raises(AttributeError):
        bare.lookup_transform("a", "b", 0)
    buffer = Buffer(flavor="ros2")
    for copied in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match="pickle"):
            copied(buffer)


def test_a_core_in_a_circle_is_collected() -> None:
    class Holder:
        core: Any = None

        def __call__(self) -> int:
            return 0

    clock = Holder()
    core = Buffer(buffer=tfdb.Buffer(clock=clock), flavor="ros2")
    clock.core = core
    core.me = core  # type: ignore[attr-defined]
    core.set_transform(message("a", "b", SECOND, POSE), "me")
    core.lookup_transform("a", "b", SECOND)
    gone = weakref.ref(core)
    del core, clock
    gc.collect()
    assert gone() is None


def test_calls_leak_nothing(buffer: Buffer) -> None:
    stamped = [message("a", "b", (4 + i) * SECOND, POSE) for i in range(3)]
    times = [Ros1Time(2 * SECOND), Ros2Time(2 * SECOND), msgs.Time(2, 0), 2 * SECOND]

    def run(count: int) -> int:
        for _ in range(count):
            for time in times:
                buffer.lookup_transform("a", "c", time)
                buffer.can_transform_core("a", "c", time)
                buffer.can_transform("a", "c", 9 * SECOND)
            for each in stamped:
                buffer.set_transform(each, "me")
        gc.collect()
        return sys.getallocatedblocks()

    buffer.buffer.set_transform("a", "b", 3 * SECOND, POSE[:3], POSE[3:])
    if buffer.flavor == "ros1":
        stamped.clear()  # it logs each that is there already
    run(50)
    before = run(50)
    held = (buffer.buffer, Buffer, msgs.Time, *times)
    counts = [sys.getrefcount(each) for each in held]
    assert run(500) - before < 100
    # Fewer where garbage of other tests has gone meanwhile.
    now = [sys.getrefcount(each) for each in held]
    assert all(later <= count for later, count in zip(now, counts, strict=True)), (counts, now)
