"""The class Player: plays recordings into a store."""

from __future__ import annotations

import math
import time
from bisect import bisect_left, bisect_right
from collections import deque
from contextlib import suppress
from itertools import chain
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

from tfdb.data.decimal_time import NS_PER_SECOND as NS
from tfdb.data.errors import Fenced, InvalidArgument, OutOfOrder
from tfdb.data.stamps import MAX_STAMP
from tfdb.recordings.load_report import Tally

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb._core import Buffer
    from tfdb.data.types import Position

    from .tape import Part, Tape

SOURCE = "tfdb play"
"""The source name of played data in `Buffer.positions()`."""

_LOOK = 0.02  # seconds between two checks for controls
_REVERSE_RATE = 30  # steps per second
_LAG = NS  # greatest delay of a player; beyond it, a clock set ahead is a jump
_STEP = NS // 1000  # between two rounds, where the recording has one message
_TIMES = 1 << 16  # messages that a step back can reach
_BATCH = 4096  # messages that a jump stores at once
_TAKEN_OVER = "another player took over the store"
_KEPT_EVERY = 1000
"""Number of messages between two states that are kept for jumps."""
_KEPT_BYTES = 1 << 28
"""Largest size of all kept states. Beyond it every other state is dropped."""


class Player:
    """Plays recordings into a store, at the pace of the store's clock.

    The tape is played into a private store, which is copied to the target (`Buffer.apply`). So each
    message is one commit. A jump is one commit as well: it replaces the played samples by the
    history before the new time. Frames of other writers stay.

    The clock shows the receive time. The player follows a process that sets the clock: it pauses,
    changes its speed, or jumps.

    Threads: one thread runs it; any thread may call the other methods.
    """

    def __init__(
        self,
        store: Buffer,
        tape: Tape,
        *,
        speed: float = 1.0,
        loop: bool = False,
        keep_stamps: bool = False,
        paused: bool = False,
    ) -> None:
        if not speed > 0:
            raise InvalidArgument(f"speed must be positive, got {speed:g}", value=speed)
        for position in store.positions():
            if position.source != SOURCE:  # each prefix begins with the empty one of the player
                text = f"the store has frames of source {position.source!r}: play into another"
                raise InvalidArgument(f"{text} store", value=store)
        self._store, self._tape = store, tape
        self._history = store.history
        self._clock = store.clock
        self._speed, self._loop = speed, loop
        self._keeps_stamps = keep_stamps or not tape.shifts
        self._begins_paused = paused
        self._has_clock = math.isfinite(speed)  # otherwise it plays without pauses
        self._played = tape.begin(self._history)
        self._held = self._played.snapshot()  # the other store is a copy of it
        self._applied: Position | None = None
        self.tally: Tally = Tally(self._played)
        self.tally.transforms = sum(info.is_static for info in self._played.tree())
        self._parts: Iterator[Part] = iter(())
        self._states: list[tuple[int, bytes]] = []  # by the reception of their last message
        self._every = _KEPT_EVERY
        self._since_kept = 0  # messages that were read after the last of these states
        self._read = -1  # when the last message in `_played` was received
        self._next: int | None = None  # when the next message was received; None: not read yet
        self._position = -1  # when the last one was
        self._times: deque[int] = deque(maxlen=_TIMES)  # of messages up to the position
        self._count = 0  # of messages in this round
        self._first: int | None = None
        self._settings = 0  # clock settings that were followed
        self._orders: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._has_ended = False
        self._reversed: tuple[float, int] | None = None  # since when, from which position
        self.rounds: int = 0

    @property
    def shift(self) -> int:
        """Nanoseconds that are added to the stamps in this round."""
        return self._tape.shift

    @property
    def position(self) -> int:
        """Receive time of the last played message, nanoseconds."""
        return self._position

    # -- from any thread --------------------------------------------------------------------------

    def pause(self) -> None:
        """Pause or resume."""
        if self._clock.paused:
            self._clock.resume()
        else:
            self._clock.pause()

    def set_speed(self, speed: float) -> None:
        """Set the speed, as a multiple of the recorded one."""
        self._clock.speed = speed

    def change_speed(self, factor: float) -> None:
        """Multiply the speed."""
        self._clock.speed = self._clock.speed * factor

    def seek(self, seconds: float) -> None:
        """Jump to a time after the recording's first message."""
        self._orders.put(lambda: self._jump_to((self._first or 0) + _nanoseconds(seconds)))

    def seek_by(self, seconds: float) -> None:
        """Jump forward or back."""
        now = self._clock.now
        self._orders.put(lambda: self._jump_to(now() - self.shift + _nanoseconds(seconds)))

    def step(self) -> None:
        """Pause, and play the next commit."""
        self._orders.put(self._step)

    def step_back(self) -> None:
        """Pause, and take the last commit back."""
        self._orders.put(self._step_back)

    def reverse(self) -> None:
        """Change between backward and forward."""
        self._orders.put(self._toggle_reverse)

    def stop(self) -> None:
        """End `run`, after the earlier controls."""
        self._orders.put(self._end)

    # -- of the thread that runs it ---------------------------------------------------------------

    def run(self) -> None:
        """Play to the end, or until `stop`. The clock then follows the system again.

        Raises
        ------
        Fenced
            Another player plays into the store.
        FrameInUse
            A frame of the recording has another writer in the store.
        RecordingError
            The recording is damaged.
        """
        try:
            self._begin()
            while not self._has_ended:
                if not self._orders.empty():
                    self._obey()
                elif self._next is None and not self._prepare():
                    if self._rests():
                        continue
                    self.rounds += 1
                    if not self._loop or self._first is None:
                        break
                    self._begin_round()
                elif self._is_due():
                    self._play()
                else:
                    self._follow_clock()
        except (Fenced, OutOfOrder) as error:
            self._has_clock = False  # it is the other player's
            raise Fenced(_TAKEN_OVER) from error
        finally:
            self._held.close()
            if self._applied in self._store.positions():  # no other player's
                self._store.forget_source(SOURCE)
            if self._has_clock:
                self._clock.follow_system()

    def _begin(self) -> None:
        """Replace the data of an earlier player by the first message, in one commit."""
        self._store.forget_source(SOURCE)  # its clock may have been ahead
        self._states = [(-1, self._tape.keep(self._played))]
        self._parts = self._tape.parts(*self._states[0])
        has_message = self._read_on()
        due = self._due
        if has_message:
            self._position = self._next or 0
            if due > self._clock.now():  # the store never has a message after the clock
                self._set_clock(due)
        if self._store.commit or self._played.commit:
            self._show()
        if not has_message:
            return
        self._go_on()
        if not self._has_clock:
            return
        self._set_clock(due)
        self._clock.speed = self._speed
        if self._begins_paused:
            self._clock.pause()
        elif self._clock.paused:
            self._clock.resume()
        self._settings = self._clock._settings

    def _show(self) -> None:
        """Replace the played samples in the store by those of the private one."""
        if self._applied is not None and self._applied not in self._store.positions():
            raise Fenced(_TAKEN_OVER)
        self._hold()
        self._applied = self._store.apply(self._held.state_bytes(), source=SOURCE)

    def _hold(self) -> None:
        """Hold the newest state of the private store, which the store now equals."""
        self._held.close()
        self._held = self._played.snapshot()

    def _is_state_due(self, before: int, received: int) -> bool:
        """Count a message; return whether to keep the state before it for later jumps."""
        if before < self._states[-1][0]:
            return False
        self._since_kept += 1
        return self._since_kept > self._every and received > before

    def _keep_state(self) -> None:
        self._since_kept = 1
        self._states.append((self._read, self._tape.keep(self._played)))
        if sum(len(data) for _, data in self._states) > _KEPT_BYTES:
            del self._states[1::2]
            self._every *= 2

    def _prepare(self) -> bool:
        """Read on, and set the clock if the message takes no time. False: the tape has ended."""
        takes_no_time = self._tape.takes_no_time
        if not self._read_on():
            return False
        if takes_no_time:
            self._set_clock(self._due)
        return True

    def _read_on(self) -> bool:
        """Read up to the next message with a stored transform. False: the tape has ended."""
        for part in self._parts:
            self._first = part.received if self._first is None else self._first
            if self._is_state_due(self._read, part.received):
                self._keep_state()
            self._read = part.received
            self._tape.store([part], self._played, self.tally)
            if self._played.commit > self._held.commit:
                self._next = part.received
                return True
        return False

    def _set_clock(self, time: int) -> None:
        if self._has_clock:
            self._clock.seek(time)
            self._settings = self._clock._settings

    @property
    def _due(self) -> int:
        return (self._next or 0) + self.shift

    def _is_due(self) -> bool:
        """Return whether the clock has reached the next message's time; wait briefly for it."""
        if not self._has_clock:
            return True
        patience = _LOOK if self._reversed is None else 1 / _REVERSE_RATE
        return self._clock._sleep_unless_set(self._due, patience, self._settings)

    def _rests(self) -> bool:
        """Return whether it is paused at the end; wait briefly for a control that goes back."""
        if not (self._has_clock and self._clock.paused):
            return False
        self._clock._sleep_unless_set(MAX_STAMP, _LOOK, self._settings)
        self._follow_clock()
        return True

    def _play(self) -> None:
        self._position = self._next or 0
        copied = self._held.commit
        while copied < self._played.commit:
            data = self._played.commits_bytes(copied)
            self._applied = self._store.apply(data, source=SOURCE)
            copied = self._applied.commit
        self._hold()
        self._go_on()

    def _go_on(self) -> None:
        """Count the message that the store has now."""
        self._count += 1
        self._times.append(self._position)
        self._next = None

    def _begin_round(self) -> None:
        """Return to the first message; shift the later stamps, unless they are kept."""
        first = self._first or 0
        if self._keeps_stamps:
            self._jump_to(first)
            return
        length = self._position - first
        step = length // (self._count - 1) if self._count > 1 else 0
        self._tape.shift += length + (step or _STEP)
        self._times.clear()
        self._count = 0
        self._position = self._read = first - 1
        self._states, self._since_kept = [(first - 1, self._tape.keep(self._played))], 0
        self._parts = self._tape.parts(*self._states[0])

    def _obey(self) -> None:
        with suppress(Empty):
            while not self._has_ended:
                self._orders.get_nowait()()

    def _follow_clock(self) -> None:
        """Jump to the time of a clock that was set."""
        settings = self._clock._settings
        if settings == self._settings:
            if self._reversed is not None:
                self._move_back(*self._reversed)
            return
        self._settings = settings
        if not self._clock.paused:
            self._reversed = None
        at = self._clock._set_to - self.shift
        lag = _LAG * max(self._clock.speed, 1.0)
        if at < self._position or at > (self._next or 0) + lag:
            self._move_to(at)

    def _end(self) -> None:
        self._has_ended = True

    def _jump_to(self, at: int) -> None:
        """Jump, not before the first message. The store never has a stamp after the clock."""
        at = min(max(at, self._first or 0), MAX_STAMP - self.shift)
        shown = at + self.shift
        if self._has_clock and shown > self._clock.now():
            self._set_clock(shown)
        self._move_to(at)
        self._set_clock(shown)

    def _move_to(self, at: int) -> None:
        """Fill the store with the data that were received until a time."""
        if self._position <= at < (self._next or at):
            return
        received, state = self._state_at(at)
        if not received <= self._read <= at:
            self._played = self._tape.restore(state, self._history)
            self.tally.buffer = self._played
            self._read, self._since_kept = received, 0
            self._parts = self._tape.parts(received, state)
            self._times.clear()
            self._times.append(received)
        elif self._next is not None:
            self._times.append(self._next)
        batch: list[Part] = []
        for part in self._parts:
            if part.received > at:
                self._parts = chain([part], self._parts)
                break
            before = batch[-1].received if batch else self._read
            is_due = self._is_state_due(before, part.received)
            if is_due or len(batch) == _BATCH:
                self._take(batch)
                batch = []
            if is_due:
                self._keep_state()
            batch.append(part)
        self._take(batch)
        self._show()
        self._position = at
        self._next = None

    def _state_at(self, at: int) -> tuple[int, bytes]:
        """Return the last kept state at or before a receive time."""
        place = bisect_right(self._states, at, key=lambda kept: kept[0]) - 1
        return self._states[max(place, 0)]

    def _take(self, parts: list[Part]) -> None:
        """Store parts in the private store."""
        self._tape.store(parts, self._played, None)
        self._times.extend(part.received for part in parts)
        self._read = parts[-1].received if parts else self._read

    def _step(self) -> None:
        self._pause()
        if self._next is not None or self._prepare():
            self._set_clock(self._due)

    def _step_back(self) -> None:
        self._pause()
        last = self._time_below(self._position + 1)
        self._jump_to(-1 if last is None else self._time_below(last) or -1)

    def _time_below(self, limit: int) -> int | None:
        """Return the receive time of the last message before a time; None without one."""
        times = list(self._times)
        place = bisect_left(times, limit) - 1
        if place >= 0:
            return times[place] if times[place] >= 0 else None
        last, state = self._state_at(limit - 1)
        for part in self._tape.parts(last, state):
            if part.received >= limit:
                break
            last = part.received
        return last if last >= 0 else None

    def _pause(self) -> None:
        self._clock.pause()
        self._settings = self._clock._settings

    def _toggle_reverse(self) -> None:
        self._pause()
        began = time.monotonic(), self._position
        self._reversed = began if self._reversed is None else None

    def _move_back(self, since: float, position: int) -> None:
        passed = time.monotonic() - since
        at = position - round(passed * self._clock.speed * NS)
        if at < (self._first or 0):
            self._reversed = None
        self._jump_to(at)


def _nanoseconds(seconds: float) -> int:
    """Convert seconds to nanoseconds, limited to the range of stamps."""
    return round(min(max(seconds * NS, -MAX_STAMP), MAX_STAMP))
