"""Messages of homes and mirrors as bytes: docs/wire.md."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from tfdb._core import crc32c
from tfdb.data.errors import CorruptMessage
from tfdb.data.sample_heads import numbers_of
from tfdb.data.types import Epoch

if TYPE_CHECKING:
    from typing import TypeAlias

Role: TypeAlias = "Literal['home', 'mirror']"
COMMITS, STATE, HEAD, PART, STATUS = 1, 2, 3, 4, 5
LIMIT = 1 << 20
"""Approximate maximum of the bytes in a message of commits or a part of a state."""
PIECE = 1 << 16
"""Approximate number of bytes in a message of an answer, which even a slow link carries in seconds.
"""
MOST_PARTS = 4096
MOST_NUMBER = 1 << 63
"""Numbers of epochs are less than this, so each number has a successor."""
_MOST_COMMIT = 1 << 44
_MOST_COUNT = 1 << 63
_FRONT = struct.Struct("<4sBBHQ16s")
_HEAD = struct.Struct("<QQ16sQQ")
_PART = struct.Struct("<QII")
_STATUS = struct.Struct("<BB8sQQQ")
_SUM = struct.Struct("<I")
FRONT = _FRONT.size
"""Number of bytes at the start of each message, equal for all commits of an epoch."""
_LEAST = FRONT + 8
NONE = Epoch(0, bytes(16))
"""The previous epoch of a home that continues no other home."""


class Commits(NamedTuple):
    """Commits for `apply`."""

    epoch: Epoch
    since: int
    last: int
    data: bytes


class State(NamedTuple):
    """A state for `apply`."""

    epoch: Epoch
    commit: int
    data: bytes


class Head(NamedTuple):
    """The head message of a home."""

    epoch: Epoch
    commit: int
    """The last commit that it has sent."""
    previous: Epoch
    """The epoch that it continues from commit `fork`, or `NONE`."""
    fork: int
    begin: int = 0
    """Its own commit with exactly that state. 0: it had more data, or continues no home."""


class Part(NamedTuple):
    """A piece of a state."""

    epoch: Epoch
    commit: int
    place: int
    """Its index, from 0."""
    parts: int
    """Number of parts of the state."""
    data: bytes


Message: TypeAlias = "Commits | State | Head | Part"


class Told(NamedTuple):
    """The status of a home or a mirror."""

    epoch: Epoch
    """The home's epoch, or the latest that the mirror has received; `NONE`."""
    role: Role
    state: str
    owner: str
    """16 hexadecimal digits that identify a mirror."""
    commit: int
    """The last commit that was sent, or applied."""
    newest: int
    """The last known commit of the home."""
    behind: int
    """Nanoseconds since the mirror last had all commits."""
    counts: tuple[int, ...]
    """The `HomeStats` or `MirrorStats`."""


_ROLES: tuple[Role, Role] = "home", "mirror"
_STATES = {
    "home": ("publishing", "fenced", "ended", "closed"),
    "mirror": ("absent", "catching up", "live", "stale", "ended", "closed"),
}
_COUNTS = {"home": 6, "mirror": 8}


class Question(NamedTuple):
    """A request of a mirror to its home."""

    epoch: Epoch
    """The latest epoch that it knows."""
    since: int | None
    """It requests the commits after this one. None: a state."""
    of: Epoch = NONE
    """The epoch of that commit."""

    def __str__(self) -> str:
        text = f"epoch={epoch_text(self.epoch)}"
        return text if self.since is None else f"since={self.since};of={epoch_text(self.of)};{text}"


def question_of(since: str | None, of: str | None, epoch: str | None) -> Question:
    """Read a request. Raises ValueError for an invalid one."""
    latest = epoch_of_text(epoch or "")
    if since is None:
        return Question(latest, None)
    if not (since.isascii() and since.isdecimal() and len(since) < 16):
        raise ValueError(f"since={since!r} is not the number of a commit")
    return Question(latest, int(since), epoch_of_text(of or ""))


def epoch_text(epoch: Epoch) -> str:
    """Write an epoch as in keys: NUMBER-ID."""
    return f"{epoch.number}-{epoch.id.hex()}"


def epoch_of_text(text: str) -> Epoch:
    """Read an epoch of keys. Raises ValueError."""
    number, _, ident = text.partition("-")
    if not (number.isascii() and number.isdecimal() and len(number) < 20 and len(ident) == 32):
        raise ValueError(f"{text!r} is not an epoch NUMBER-ID")
    return _checked(Epoch(int(number), bytes.fromhex(ident)))


def _checked(epoch: Epoch) -> Epoch:
    if epoch.number >= MOST_NUMBER:
        raise ValueError(f"the number of an epoch is {epoch.number}: it must be below 2^63")
    return epoch


def head_bytes(head: Head) -> bytes:
    """Write the head message of a home."""
    before = head.previous
    body = _HEAD.pack(head.commit, before.number, before.id, head.fork, head.begin)
    return _sealed(HEAD, head.epoch, body)


def state_messages(epoch: Epoch, commit: int, state: bytes, piece: int = PIECE) -> list[bytes]:
    """Return a state as one message, or as at most `MOST_PARTS` parts of `piece` bytes or more."""
    if len(state) <= piece:
        return [state]
    size = max(piece, -(-len(state) // MOST_PARTS))
    pieces = [state[at : at + size] for at in range(0, len(state), size)]
    return [
        _sealed(PART, epoch, _PART.pack(commit, index, len(pieces)) + piece)
        for index, piece in enumerate(pieces)
    ]


def commits_front(epoch: Epoch) -> bytes:
    """Return the first bytes of all commits of an epoch."""
    return _FRONT.pack(b"TFDB", 0, COMMITS, 0, epoch.number, epoch.id)


def in_epoch(sample: bytes, epoch: Epoch) -> bytes:
    """Return commits or a state with another epoch."""
    front = sample[:8] + epoch.number.to_bytes(8, "little") + epoch.id
    return _with_sum(front + memoryview(sample)[32:-4])


def _sealed(kind: int, epoch: Epoch, body: bytes) -> bytes:
    return _with_sum(_FRONT.pack(b"TFDB", 0, kind, 0, epoch.number, epoch.id) + body)


def _with_sum(data: bytes) -> bytes:
    return data + _SUM.pack(crc32c(data))


def status_bytes(told: Told) -> bytes:
    """Write the status of a home or a mirror."""
    role, state = _ROLES.index(told.role), _STATES[told.role].index(told.state)
    owner = bytes.fromhex(told.owner or "00" * 8)
    body = _STATUS.pack(role, state, owner, told.commit, told.newest, told.behind)
    return _sealed(STATUS, told.epoch, body + struct.pack(f"<{len(told.counts)}Q", *told.counts))


def status_of(data: bytes) -> Told:
    """Read a status. Raises CorruptMessage."""
    _, number, ident = _front(data, STATUS, STATUS)
    try:
        return _told(_checked(Epoch(number, ident)), data)
    except (ValueError, struct.error) as error:
        raise _corrupt(_FRONT.size, str(error)) from None


def message_of(data: bytes) -> Message:
    """Read a message of a log or an answer to a mirror.

    Raises CorruptMessage; `apply` validates the content of commits and states.
    """
    kind, number, ident = _front(data, COMMITS, PART)
    try:
        epoch = _checked(Epoch(number, ident))
        if kind == COMMITS:
            return Commits(epoch, *_numbers(data), data)
        if kind == STATE:
            return State(epoch, _numbers(data)[0], data)
        return (_head if kind == HEAD else _part)(epoch, data)
    except (ValueError, IndexError, struct.error) as error:
        raise _corrupt(_FRONT.size, str(error)) from None


def _front(data: bytes, first: int, last: int) -> tuple[int, int, bytes]:
    """Return kind, number and id of a complete message of a known kind. Raises CorruptMessage."""
    if len(data) < _LEAST:
        raise _corrupt(len(data), "it is cut short")
    magic, version, kind, flags, number, ident = _FRONT.unpack_from(data)
    if magic != b"TFDB":
        raise _corrupt(0, "it does not begin with TFDB")
    if version != 0:
        raise _corrupt(4, f"version {version}: this program reads version 0")
    if flags or not first <= kind <= last:
        raise _corrupt(5, f"unknown kind {kind}, flags {flags}")
    if _SUM.unpack_from(data, len(data) - 4)[0] != crc32c(memoryview(data)[:-4]):
        raise _corrupt(len(data) - 4, "the checksum is wrong")
    return kind, number, ident


def _told(epoch: Epoch, data: bytes) -> Told:
    role_at, state_at, owner, commit, newest, behind = _STATUS.unpack_from(data, _FRONT.size)
    if role_at >= len(_ROLES) or state_at >= len(_STATES[_ROLES[role_at]]):
        raise ValueError(f"role {role_at}, state {state_at} is not known")
    role = _ROLES[role_at]
    begin, count = _FRONT.size + _STATUS.size, _COUNTS[role]
    if len(data) != begin + 8 * count + 4:
        raise ValueError(f"the status of a {role} has another size")
    counts = struct.unpack_from(f"<{count}Q", data, begin)
    if max(commit, newest) >= _MOST_COMMIT or max(behind, *counts) >= _MOST_COUNT:
        raise ValueError("a commit is beyond 2^44, or a count beyond 2^63")
    state = _STATES[role][state_at]
    return Told(epoch, role, state, owner.hex(), commit, newest, behind, counts)


def _numbers(data: bytes) -> tuple[int, int]:
    since, last = numbers_of(data)
    if last >= _MOST_COMMIT:
        raise ValueError(f"commit {last} is beyond 2^44")
    return since, last


def _head(epoch: Epoch, data: bytes) -> Head:
    if len(data) != _FRONT.size + _HEAD.size + 4:
        raise ValueError("a head has another size")
    commit, number, ident, fork, begin = _HEAD.unpack_from(data, _FRONT.size)
    if max(commit, fork, begin) >= _MOST_COMMIT:
        raise ValueError("a commit is beyond 2^44")
    return Head(epoch, commit, _checked(Epoch(number, ident)), fork, begin)


def _part(epoch: Epoch, data: bytes) -> Part:
    commit, place, parts = _PART.unpack_from(data, _FRONT.size)
    piece = data[_FRONT.size + _PART.size : -4]
    if not place < parts <= MOST_PARTS or not 0 < len(piece) <= LIMIT or commit >= _MOST_COMMIT:
        raise ValueError(f"part {place} of {parts}, of {len(piece)} bytes, is not valid")
    return Part(epoch, commit, place, parts, piece)


def _corrupt(offset: int, reason: str) -> CorruptMessage:
    fields: dict[str, Any] = {"offset": offset, "reason": reason}
    return CorruptMessage(f"corrupt message at byte {offset}: {reason}", **fields)
