"""MessageFilter delivers each message once, with its transforms, or drops it with a reason."""

from __future__ import annotations

import queue
import random
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import pytest

from tf2.loopback import LoopbackNode
from tf2.ours import message, plain
from tfdb import tf2
from tfdb.tf2 import msgs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SECOND = 1_000_000_000
POSE = [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
FOREVER = 60.0
Reason = tf2.FilterFailureReason


@dataclass
class Scan:
    """Any message with a header."""

    header: msgs.Header = field(default_factory=msgs.Header)


def scan(stamp: float, frame: str = "lidar") -> Scan:
    return Scan(msgs.Header(msgs.Time.from_nanoseconds(round(stamp * SECOND)), frame))


class Setting:
    """A filter, and what came out of it."""

    def __init__(self, targets: Any = "map", queue_size: int = 10, **options: Any) -> None:
        self.buffer = tf2.Buffer(flavor="ros2", clock=options.pop("clock", None))
        self.filter = tf2.MessageFilter(self.buffer, targets, queue_size, **options)
        self.out: queue.SimpleQueue[tuple[str, Any, Any]] = queue.SimpleQueue()
        self.filter.register_callback(lambda m, t: self.out.put(("passed", m, t)))
        self.filter.register_failure_callback(lambda m, r: self.out.put(("dropped", m, r)))

    def put(self, stamp: float, parent: str = "map", child: str = "lidar") -> None:
        made = message(parent, child, round(stamp * SECOND), POSE)
        self.buffer.set_transform(made, "test")

    def next(self) -> tuple[str, Any, Any]:
        return self.out.get(timeout=FOREVER)


@pytest.fixture
def setting() -> Iterator[Setting]:
    made = Setting()
    yield made
    made.buffer.close()


def test_a_message_is_handed_on_with_its_transform(setting: Setting) -> None:
    setting.put(1)
    waits, now = scan(2), scan(1)
    setting.filter.add(waits)
    setting.filter.add(now)
    what, passed, found = setting.next()
    assert (what, passed) == ("passed", now)
    assert passed is now
    setting.put(3)
    what, passed, found = setting.next()
    assert passed is waits
    assert plain(found["map"])[:3] == ["map", "lidar", 2 * SECOND]
    assert plain(found["map"])[3] == pytest.approx(POSE)


def test_all_target_frames_and_the_tolerance_count() -> None:
    setting = Setting(["map", "/odom"], tolerance=msgs.Duration(1))
    assert setting.filter.get_target_frames_string() == "map odom"
    setting.filter.add(scan(2))
    setting.put(1)
    setting.put(2.5)
    setting.put(1, "odom", "map")
    setting.put(5, "odom", "map")
    assert setting.out.empty()
    setting.put(3)
    what, _, found = setting.next()
    assert what == "passed"
    assert plain(found["odom"])[2] == 2 * SECOND
    assert set(found) == {"map", "odom"}


def test_a_full_queue_drops_the_oldest() -> None:
    setting = Setting(queue_size=2)
    scans = [scan(stamp) for stamp in (5, 6, 7)]
    for one in scans:
        setting.filter.add(one)
    assert setting.next() == ("dropped", scans[0], Reason.QueueFull)
    setting.put(1)
    setting.put(8)
    # In their order, unless the second commit came while the first was looked at.
    assert {id(setting.next()[1]) for _ in range(2)} == {id(one) for one in scans[1:]}


def test_messages_older_than_the_cache_are_dropped(setting: Setting) -> None:
    setting.put(20)
    old = scan(5)
    setting.filter.add(old)
    assert setting.next() == ("dropped", old, Reason.OutTheBack)
    waits = scan(21)
    setting.filter.add(waits)
    setting.put(50)
    setting.put(51)
    # Both sides of 21 are known, or nothing around it any more.
    assert setting.next()[1] is waits


def test_no_frame_and_closing(setting: Setting) -> None:
    nameless, waits = scan(1, ""), scan(1)
    setting.filter.add(nameless)
    assert setting.next() == ("dropped", nameless, Reason.EmptyFrameID)
    setting.filter.add(waits)
    setting.buffer.close()
    assert setting.next() == ("dropped", waits, Reason.Unknown)


def test_a_time_limit_by_the_clock_that_is_named() -> None:
    clock = LoopbackNode()
    clock.set_time(100 * SECOND)
    setting = Setting(buffer_timeout=msgs.Duration(2), clock=clock)
    waits = scan(1)
    setting.filter.add(waits)
    clock.set_time(101 * SECOND)
    clock.set_time(102 * SECOND)
    assert setting.next() == ("dropped", waits, Reason.NoTransformFound)
    assert len(clock.watches) == 1  # of the buffer, for the node's end


def test_other_targets_are_looked_at_again(setting: Setting) -> None:
    waits = scan(1)
    setting.filter.add(waits)
    setting.put(1, "odom", "lidar")
    setting.filter.set_target_frames("odom")
    assert setting.next()[:2] == ("passed", waits)
    setting.filter.add(scan(9))
    setting.filter.clear()
    setting.put(10, "odom", "lidar")
    last = scan(10)
    setting.filter.add(last)
    assert setting.next()[1] is last


def test_message_filters_can_be_connected() -> None:
    class Source:
        def __init__(self) -> None:
            self.callbacks: list[Callable[..., None]] = []

        def registerCallback(self, callback: Any, *_: Any) -> None:  # noqa: N802
            self.callbacks.append(callback)

    source = Source()
    setting = Setting(source=source)
    got: queue.SimpleQueue[Any] = queue.SimpleQueue()
    setting.filter.registerCallback(lambda m, extra: got.put((m, extra)), "extra")
    setting.put(1)
    one = scan(1)
    source.callbacks[0](one)
    assert got.get(timeout=FOREVER) == (one, "extra")


def test_each_message_ends_once() -> None:
    rng = random.Random(7)
    setting = Setting(queue_size=50)
    scans = [scan(rng.randrange(1, 30)) for _ in range(600)]

    def add() -> None:
        for one in scans:
            setting.filter.add(one)

    adding = threading.Thread(target=add)
    adding.start()
    for stamp in range(1, 31):
        setting.put(stamp)
    adding.join()
    setting.buffer.close()
    ended = [setting.next()[1] for _ in scans]
    assert {id(one) for one in ended} == {id(one) for one in scans}
    assert setting.out.empty()


def test_invalid_arguments_of_a_filter_are_refused() -> None:
    buffer = tf2.Buffer(flavor="ros2")
    for targets, size, tolerance in (
        ("map", -1, None),
        ("", 1, None),
        ("a\0b", 1, None),
        (["map", "x" * 1025], 1, None),
        ([], 1, None),
        ("map", 1, msgs.Duration(-1)),
    ):
        with pytest.raises(tf2.InvalidArgumentException):
            tf2.MessageFilter(buffer, targets, size, tolerance=tolerance)
    made = tf2.MessageFilter(buffer, "map", 1)
    wrong: list[tuple[str, Callable[[Any], object]]] = [
        ("buffer must be a tfdb.tf2.Buffer, got 5", lambda five: tf2.MessageFilter(five, "map", 1)),
        ("target_frame must be a frame name or several, got 5", made.set_target_frames),
        ("a target frame must be a str, got int", lambda five: made.set_target_frames([five])),
        ("queue_size must be a number of", lambda _: tf2.MessageFilter(buffer, "map", 0.5)),  # type: ignore[arg-type]
        ("source must be a filter of message_filters", made.connect_input),
        ("message must be a message with a header, got 5", made.add),
        ("header.frame_id must be a str, got int", lambda five: made.add(scan(1, five))),
        ("callback must be a function, got 5", made.registerCallback),
        ("callback must be a function, got 5", made.register_callback),
        ("callback must be a function, got 5", made.register_failure_callback),
    ]
    for said, make in wrong:
        with pytest.raises(TypeError, match=f"^{said}"):
            make(5)


def test_a_message_in_a_frame_that_cannot_be_is_dropped(setting: Setting) -> None:
    one = scan(1, "a\0b")
    setting.filter.add(one)
    assert setting.next() == ("dropped", one, Reason.Unknown)


def test_a_filter_of_a_closed_buffer_drops(setting: Setting) -> None:
    setting.buffer.close()
    one = scan(1)
    setting.filter.add(one)
    assert setting.next() == ("dropped", one, Reason.Unknown)
    assert setting.out.empty()
