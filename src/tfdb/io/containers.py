"""What a recording's container gives, whichever library opens it.

One file per library implements `Container` (`rosbags_reader`, `mcap_reader`); nothing else imports
them. Payloads stay bytes: the store decodes them itself.
"""

from __future__ import annotations

import errno
import os
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

from tfdb.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

Encoding: TypeAlias = Literal["ros1", "cdr"]
Kind: TypeAlias = Literal["bag", "db3", "mcap", "folder"]

NEEDS_EXTRA = "needs a library that is not installed: pip install 'tfdb[recordings]'"

_TF_TYPES = frozenset({"tf2_msgs/TFMessage", "tf/tfMessage"})
_MCAP = b"\x89MCAP0\r\n"
_MAGICS: tuple[tuple[bytes, Kind], ...] = (
    (b"#ROSBAG V2.0", "bag"),
    (_MCAP, "mcap"),
    (b"SQLite format 3\0", "db3"),
)


@dataclass(frozen=True)
class Topic:
    """A topic of a recording, of any type, with the number of its messages."""

    name: str
    type: str
    messages: int


@dataclass(frozen=True)
class Source:
    """One stream of TFMessages: a ROS 1 connection, a ROS 2 topic or an MCAP channel.

    `authority` is who published: the node's name where the container knows it (ROS 1), else the
    topic.
    """

    topic: str
    encoding: Encoding
    authority: str
    messages: int


class Container(Protocol):
    """An open recording. Not for several threads at once."""

    @property
    def topics(self) -> tuple[Topic, ...]:
        """All topics, also those without transforms."""

    @property
    def sources(self) -> tuple[Source, ...]:
        """The streams of transforms."""

    @property
    def start(self) -> int:
        """When the first message was received, nanoseconds; 2**63 - 1 without messages."""

    def messages(self, wanted: Callable[[Source], bool]) -> Iterator[tuple[Source, int, bytes]]:
        """Source, time of reception (ns) and payload of each message, in order of reception.

        Raises `RecordingError` where the file is damaged, also after some messages.
        """

    def close(self) -> None:
        """Close the file."""


def is_tf_type(name: str) -> bool:
    """Whether a message type, as ROS 1 or ROS 2 spells it, is one of transforms."""
    return name.replace("/msg/", "/") in _TF_TYPES


def encoding_of(path: Path, topic: str, name: str) -> Encoding:
    """The store's word for a container's; refuses encodings that transforms never have."""
    if name == "cdr":
        return "cdr"
    if name in ("ros1", "ros1msg"):
        return "ros1"
    raise RecordingError(path, f"topic {topic!r} is encoded as {name!r}, not as cdr or ros1")


def check_count(path: Path, source: Source, found: int) -> None:
    """Refuse a file whose index promises other messages than it holds."""
    if found != source.messages:
        reason = f"its index promises {source.messages} messages on {source.topic!r}"
        raise RecordingError(path, f"{reason}, the file holds {found}")


@contextmanager
def typed_errors(path: Path, hint: str = "") -> Iterator[None]:
    """Turn whatever the libraries raise on bad files into `RecordingError`, with a hint.

    Errors of the file system pass; bz2 raises `OSError` on bad data, too, but without a number.
    """
    try:
        yield
    except (RecordingError, GeneratorExit):
        raise
    except ModuleNotFoundError as error:
        raise RecordingError(path, f"{NEEDS_EXTRA} ({error.name})") from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        detail = " ".join(str(error).split())[:300] or type(error).__name__
        raise RecordingError(path, f"damaged or cut short: {detail.rstrip('.')}{hint}") from error


def kind_of(path: Path) -> Kind:
    """What a file is, by its first bytes; the name does not matter.

    Raises `RecordingError` for anything that is no recording, `OSError` where it cannot be opened.
    """
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    if path.is_dir():
        return "folder"
    with path.open("rb") as file:
        start = file.read(16)
        file.seek(-min(len(_MCAP), len(start)), os.SEEK_END)
        end = file.read()
    if not start:
        raise RecordingError(path, "the file is empty")
    if start.startswith(_MCAP) and end != _MCAP:
        raise RecordingError(path, "cut short, its end is missing: `mcap recover` saves the rest")
    for magic, kind in _MAGICS:
        if start.startswith(magic):
            return kind
    if start.startswith(b"#ROSBAG V1"):
        raise RecordingError(path, "a bag of the old version 1: convert it with `rosbag fix`")
    raise RecordingError(path, "neither a ROS 1 bag, nor a ROS 2 database (.db3), nor an MCAP file")
