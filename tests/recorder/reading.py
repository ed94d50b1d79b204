"""Recorded files, as readers of others find them."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

import mcap.exceptions
from mcap.reader import NonSeekingReader, make_reader

import tfdb
from tfdb.recorder.channels import unwrapped

if TYPE_CHECKING:
    from pathlib import Path


class Message(NamedTuple):
    """A message of an MCAP file."""

    topic: str
    sequence: int
    time: int
    data: bytes

    @property
    def transforms(self) -> list[tfdb.TransformStamped]:
        """What a TFMessage holds."""
        return tfdb.decode_tf_message(self.data)

    @property
    def sample(self) -> bytes:
        """The bytes for `apply`."""
        return unwrapped(self.data)


def messages_of(path: Path, *topics: str) -> list[Message]:
    """Messages of a file, in its order, as PyPI's mcap reads them; of a cut one all that it has."""
    found: list[Message] = []
    with path.open("rb") as file:
        reader = NonSeekingReader(file, validate_crcs=True)
        try:
            for _, channel, message in reader.iter_messages(topics or None, log_time_order=False):
                about = message.sequence, message.log_time, message.data
                found.append(Message(channel.topic, *about))
        except (mcap.exceptions.EndOfFile, struct.error):  # the latter amid the last bytes
            assert path.suffix == ".part"
    return found


def metadata_of(path: Path) -> list[tuple[str, dict[str, str]]]:
    """The metadata of a complete file."""
    with path.open("rb") as file:
        return [(each.name, each.metadata) for each in make_reader(file).iter_metadata()]


def applied(path: Path | list[Path], copy: tfdb.Buffer | None = None) -> tfdb.Buffer:
    """A store that has applied all recorded commits."""
    copy = copy or tfdb.Buffer(history=None)
    for each in tfdb.recorded_commits(path):
        assert copy.apply(each.data).commit == each.commit
    return copy


def state_of(buf: tfdb.Buffer) -> bytes:
    """The state of a store, without its epoch and the number of its commit."""
    with buf.snapshot() as snap:
        data = snap.state_bytes()
    at = 36
    while data[at] >= 0x80:
        at += 1
    return data[at + 1 : -4]
