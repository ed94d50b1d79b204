"""A store's only bridge to a graph: a second one would store and send each message again."""

from __future__ import annotations

import fcntl
import hashlib
import os
import struct
import weakref
from typing import TYPE_CHECKING

from tfdb.data.closable import Closable
from tfdb.data.errors import InvalidArgument

if TYPE_CHECKING:
    from tfdb._core import Buffer

__all__ = ["Claim"]

_private: dict[tuple[int, str], Claim] = {}
"""Claims of private buffers, by the buffer's id and the graph.

It has no lock, because a forked child could find it held.
"""


class Claim(Closable):
    """Makes a bridge the store's only one to the graph `origin`, until `close`.

    Threads: one at a time. In a shared store it is a lock on a byte beyond the end of the file,
    which ends with the process. Raises InvalidArgument if another bridge has it.
    """

    def __init__(self, buffer: Buffer, origin: str) -> None:
        self._buffer = buffer  # while it is referenced, no other object has its id
        self._key = id(buffer), origin
        self._file = _opened(buffer)
        _open.add(self)
        if not (
            _private.setdefault(self._key, self) is self
            if self._file is None
            else _set_lock(self._file, origin, fcntl.F_WRLCK)
        ):
            self.leave()
            text = (
                f"the store has a bridge to {origin} already: end that bridge. For another graph,"
            )
            raise InvalidArgument(f"{text} pass another origin (--origin)", value=origin)

    def close(self) -> None:
        """Permit another bridge to the graph. A second call does nothing."""
        if self._file is not None:
            _set_lock(self._file, self._key[1], fcntl.F_UNLCK)  # also in forked children
            self.leave()
        if _private.get(self._key) is self:
            del _private[self._key]

    def leave(self) -> None:
        """Close the file in this process; forked processes keep theirs."""
        file, self._file = self._file, None
        if file is not None:
            os.close(file)


def _opened(buffer: Buffer) -> int | None:
    """Open the file of a shared store. None: the store is not shared."""
    if buffer.shared is None:
        return None
    try:
        return os.open(buffer.shared.path, os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:  # the store was removed
        return None


def _set_lock(file: int, origin: str, kind: int) -> bool:
    """Lock or unlock the byte of a graph. False: another bridge has it."""
    digest = hashlib.sha256(origin.encode()).digest()
    byte = 1 << 62 | int.from_bytes(digest[:7], "little")
    wanted = struct.pack("hhqqi4x", kind, os.SEEK_SET, byte, 1, 0)
    try:
        fcntl.fcntl(file, fcntl.F_OFD_SETLK, wanted)
    except (BlockingIOError, PermissionError):
        return False
    return True


_open: weakref.WeakSet[Claim] = weakref.WeakSet()


def _leave_all() -> None:
    for each in list(_open):
        each.leave()


# A forked child's copy would keep the lock after its parent has ended.
os.register_at_fork(after_in_child=_leave_all)
