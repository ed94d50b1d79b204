"""`MessageFilter`: delivers messages once they can be transformed, with their transforms."""

from __future__ import annotations

import enum
import logging
import operator
import threading
from collections import OrderedDict
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any

from tfdb import _core
from tfdb.data.argument_checks import check_name, refuse_without
from tfdb.data.errors import TfdbError
from tfdb.data.stamps import shown
from tfdb.ros.times import duration, nanoseconds

from .deadlines import deadline_in
from .exceptions import InvalidArgumentException, TransformException
from .transformable_requests import TransformableResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from tfdb.store import waiting

    from .buffer import Buffer
    from .deadlines import Timer

__all__ = ["FilterFailureReason", "MessageFilter"]

LOGGER = logging.getLogger("tfdb.tf2")


class FilterFailureReason(enum.Enum):
    """Why a message was dropped. The value is tf2's text."""

    Unknown = "unknown"
    OutTheBack = "the timestamp on the message is earlier than all the data in the transform cache"
    EmptyFrameID = "the frame id of the message is empty"
    NoTransformFound = (
        "did not find a valid transform, this usually happens at startup or when a frame is "
        "published late"
    )
    QueueFull = "discarding message because the queue is full"


@dataclass(eq=False)
class _Waiting:
    """A message that cannot be transformed yet."""

    number: int
    message: Any
    frame: str
    stamps: tuple[int, ...]
    waits: list[waiting.Wait]
    timer: Timer | None = None


class MessageFilter:
    """Delivers each message once it can be transformed into all target frames. tf2 has it in C++.

    A thread of the buffer delivers messages as soon as their transforms are available, without
    polling. Messages that can no longer be transformed are dropped with a reason. Any thread may
    call it, including callbacks.

    Parameters
    ----------
    buffer
        The buffer of the transforms.
    target_frame
        One or several frames; a message must be transformable into all of them.
    queue_size
        Largest number of waiting messages; one more drops the oldest. 0: no limit.
    tolerance
        A duration: transforms must be available at the stamp and at this time after it.
    buffer_timeout
        A duration after which a waiting message is dropped; None: never.
    source
        The source of messages, as for `connect_input`.

    Raises InvalidArgumentException.
    """

    def __init__(
        self,
        buffer: Buffer,
        target_frame: str | Iterable[str],
        queue_size: int,
        *,
        tolerance: Any = None,
        buffer_timeout: Any = None,
        source: Any = None,
    ) -> None:
        refuse_without(buffer, "buffer", "a tfdb.tf2.Buffer", "add_transformable_request")
        self._buffer = buffer
        self._lock = threading.Lock()
        self._numbers = count()
        self._waiting: OrderedDict[int, _Waiting] = OrderedDict()
        self._callbacks: list[tuple[Callable[..., object], tuple[Any, ...], bool]] = []
        self._failure_callbacks: list[Callable[[Any, FilterFailureReason], object]] = []
        self._targets: tuple[str, ...] = ()
        refuse_without(queue_size, "queue_size", "a number of messages", "__index__")
        if operator.index(queue_size) < 0:
            text = f"queue_size is how many messages may wait, from 0 on, got {queue_size!r}"
            raise InvalidArgumentException(text, value=queue_size)
        self.queue_size = queue_size
        """Largest number of waiting messages; 0: no limit."""
        self._tolerance = 0
        self._timeout = (
            None if buffer_timeout is None else duration(buffer_timeout, None, "buffer_timeout")
        )
        self.set_target_frames(target_frame)
        if tolerance is not None:
            self.set_tolerance(tolerance)
        if source is not None:
            self.connect_input(source)

    def connect_input(self, source: Any) -> None:
        """Add the messages of a `message_filters` filter, or of a similar registerCallback."""
        what = "a filter of message_filters, or has its registerCallback"
        refuse_without(source, "source", what, "registerCallback")
        source.registerCallback(self.add)

    def registerCallback(  # noqa: N802 - message_filters' name
        self, callback: Callable[..., object], *args: Any
    ) -> None:
        """Call `callback(message, *args)` for each message that can be transformed."""
        refuse_without(callback, "callback", "a function", "__call__")
        with self._lock:
            self._callbacks.append((callback, args, False))

    def register_callback(self, callback: Callable[[Any, dict[str, Any]], object]) -> None:
        """Call `callback(message, transforms)` for each message that can be transformed.

        `transforms` has T[target<-frame of the message] at its stamp for each target frame, all
        from one state. So the callback needs no lookups.
        """
        refuse_without(callback, "callback", "a function", "__call__")
        with self._lock:
            self._callbacks.append((callback, (), True))

    def register_failure_callback(
        self, callback: Callable[[Any, FilterFailureReason], object]
    ) -> None:
        """Call `callback(message, reason)` for each message that is dropped."""
        refuse_without(callback, "callback", "a function", "__call__")
        with self._lock:
            self._failure_callbacks.append(callback)

    def set_target_frames(self, target_frame: str | Iterable[str]) -> None:
        """Set the target frames; waiting messages are checked again."""
        refuse_without(target_frame, "target_frame", "a frame name or several", "__iter__")
        names = [target_frame] if isinstance(target_frame, str) else [*target_frame]
        targets = tuple(check_name("a target frame", name).removeprefix("/") for name in names)
        if not targets or not all(map(_core.Buffer._may_be_frame, targets)):
            text = (
                "target frames have names of 1 to 1024 bytes without control characters, "
                f"got {shown(target_frame)}"
            )
            raise InvalidArgumentException(text, value=target_frame)
        self._targets = targets
        self._retry_all()

    def get_target_frames_string(self) -> str:
        """Return the names of the target frames, joined as tf2 joins them."""
        return " ".join(self._targets)

    def set_tolerance(self, tolerance: Any) -> None:
        """Set the tolerance."""
        wanted = duration(tolerance, None, "tolerance")
        if wanted < 0:
            text = f"tolerance must not be negative, got {wanted} ns"
            raise InvalidArgumentException(text, value=tolerance)
        self._tolerance = wanted
        self._retry_all()

    def clear(self) -> None:
        """Drop the waiting messages, without a callback."""
        with self._lock:
            forgotten = [*self._waiting.values()]
            self._waiting.clear()
        for one in forgotten:
            _end(one)

    def _retry_all(self) -> None:
        with self._lock:
            again = [*self._waiting.values()]
            self._waiting.clear()
        for one in again:
            _end(one)
            self.add(one.message)

    def add(self, message: Any) -> None:
        """Add a message, whose header has its frame and stamp."""
        refuse_without(message, "message", "a message with a header", "header")
        frame = check_name("header.frame_id", message.header.frame_id).removeprefix("/")
        if not frame:
            self._drop(message, FilterFailureReason.EmptyFrameID)
            return
        stamp = nanoseconds(message.header.stamp, self._buffer.flavor)
        stamps = (stamp, stamp + self._tolerance) if self._tolerance else (stamp,)
        one = _Waiting(next(self._numbers), message, frame, stamps, [])
        dropped = None
        with self._lock:
            self._waiting[one.number] = one
            if 0 < self.queue_size < len(self._waiting):
                dropped = self._waiting.popitem(last=False)[1]
        if dropped is not None:
            _end(dropped)
            self._drop(dropped.message, FilterFailureReason.QueueFull)
        self._wait_for_next(one)
        if self._timeout is not None:
            self._set_timer(one)

    def _set_timer(self, one: _Waiting) -> None:
        timer = deadline_in(self._timeout or 0, self._buffer.clock).call(
            lambda: self._fail(one, FilterFailureReason.NoTransformFound)
        )
        with self._lock:
            if one.number in self._waiting:
                one.timer = timer
                return
        timer.cancel()

    def _wait_for_next(self, one: _Waiting) -> None:
        """Deliver a message, or wait for its first missing transform."""
        try:
            self._deliver_or_wait(one)
        except TfdbError:  # the buffer was closed, or its store removed
            self._fail(one, FilterFailureReason.Unknown)

    def _deliver_or_wait(self, one: _Waiting) -> None:
        available, failure = TransformableResult

        def tell(result: TransformableResult | None) -> None:
            if result is available:
                self._wait_for_next(one)
            else:
                gone = result is failure
                reasons = FilterFailureReason
                self._fail(one, reasons.OutTheBack if gone else reasons.Unknown)

        begun: TransformableResult | None = available
        while begun is available and (lacks := self._deliver_or_missing(one)) is not None:
            target, stamp = lacks
            begun = self._buffer._begin_request(
                (target, one.frame), stamp, tell, lambda wait: self._hold(one, wait)
            )
        if begun is failure:
            self._fail(one, FilterFailureReason.OutTheBack)

    def _hold(self, one: _Waiting, wait: waiting.Wait) -> None:
        """Store a wait with its message, unless the message has left the queue."""
        with self._lock:
            if one.number in self._waiting:
                one.waits.append(wait)
                return
        wait.cancel()

    def _deliver_or_missing(self, one: _Waiting) -> tuple[str, int] | None:
        """Deliver a message, or return target and stamp of its first missing transform."""
        found: dict[str, Any] = {}
        core = self._buffer
        for target in self._targets:
            for stamp in reversed(one.stamps):
                try:
                    found[target] = core.lookup_transform_core(target, one.frame, stamp)
                except TransformException:
                    return target, stamp
        if self._dequeue(one):
            with self._lock:
                callbacks = [*self._callbacks]
            for callback, args, with_transforms in callbacks:
                core._requests.call(callback, one.message, *((found,) if with_transforms else args))
        return None

    def _dequeue(self, one: _Waiting) -> bool:
        """Remove a message from the queue; False: another thread did."""
        with self._lock:
            mine = self._waiting.pop(one.number, None) is not None
        if mine:
            _end(one)
        return mine

    def _fail(self, one: _Waiting, reason: FilterFailureReason) -> None:
        if self._dequeue(one):
            self._drop(one.message, reason)

    def _drop(self, message: Any, reason: FilterFailureReason) -> None:
        header = message.header
        stamp = nanoseconds(header.stamp, self._buffer.flavor)
        LOGGER.info(
            "Message Filter dropping message: frame '%s' at time %.3f for reason '%s'",
            header.frame_id,
            stamp / 1e9,
            reason.value,
        )
        with self._lock:
            callbacks = [*self._failure_callbacks]
        for callback in callbacks:
            self._buffer._requests.call(callback, message, reason)


def _end(one: _Waiting) -> None:
    for wait in one.waits:
        wait.cancel()
    if one.timer is not None:
        one.timer.cancel()
