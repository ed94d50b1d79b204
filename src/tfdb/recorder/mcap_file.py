"""One MCAP file of a recording, called `NAME.part` until it is closed."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import TYPE_CHECKING

from mcap.writer import CompressionType, Writer

from tfdb._core import __version__
from tfdb.data.errors import RecordingError
from tfdb.data.new_file import bring_to_disk, refuse_existing, take_name
from tfdb.data.path_checks import errors_name
from tfdb.data.sample_heads import epoch_of
from tfdb.recordings.tf_definition import LOST, STATE, STORE, qos_text

from .channels import BYTES, COMMITS, SEQUENCES, TF, TF_STATIC, TRANSFORMS, wrapped

if TYPE_CHECKING:
    from pathlib import Path

    from .channels import Messages

_CHUNK = 1 << 20
"""A chunk ends with the first commit that makes it larger: no commit is in two chunks."""
_NEVER = 1 << 62
_TAKEN = "exists already: give another name, or remove it"


class _Disk:
    """The unbuffered file: after an error, its content is known.

    Threads: one.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        self._descriptor = os.open(path, flags, 0o666)
        self.size = 0

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            written = os.write(self._descriptor, left)
            self.size += written
            left = left[written:]
        return len(data)

    def tell(self) -> int:
        return self.size

    def flush(self) -> None:
        """Do nothing: the system has all written data."""

    def sync(self) -> None:
        os.fsync(self._descriptor)

    def cut(self, size: int) -> None:
        os.ftruncate(self._descriptor, size)

    @property
    def is_removed(self) -> bool:
        return os.fstat(self._descriptor).st_nlink == 0

    @property
    def is_open(self) -> bool:
        return self._descriptor >= 0

    def close(self) -> None:
        descriptor, self._descriptor = self._descriptor, -1
        os.close(descriptor)


class McapFile:
    """Threads: one. Raises `OSError`; afterwards it can only be abandoned.

    Raises `RecordingError` if a file of this name, or of the name with `.part`, exists, or if the
    file was removed.
    """

    def __init__(self, path: Path, folder: Path, *, sync: bool) -> None:
        self.path: Path = path
        self.part: Path = path.with_name(path.name + ".part")
        # The process may change its working directory.
        self._places = folder / path.name, folder / self.part.name
        for each in self._places:
            refuse_existing(each, refusal=RecordingError, hint=_TAKEN)
        self._sync = sync
        self._flushed = 0
        self.pending: int = 0
        """Size of the messages that are not flushed, in bytes."""
        self.begun: int | None = None
        """The time of the first message, nanoseconds."""
        with errors_name(self.part):
            self._disk = _Disk(self._places[1])
            self._writer = Writer(self._disk, chunk_size=_NEVER, compression=CompressionType.ZSTD)
            try:
                self._begin()
            except BaseException:
                self.remove()
                raise

    def _begin(self) -> None:
        self._writer.start("ros2", f"tfdb {__version__}")
        transforms, self._others = (self._schema(*each) for each in (TRANSFORMS, BYTES))
        self._tf = self._channel(TF, transforms)
        self._tf_static = self._channel(TF_STATIC, transforms, is_static=True)
        self._commits = self._channel(COMMITS, self._others)
        self._state = -1  # the first state opens this channel, whose metadata names the store

    def _schema(self, name: str, text: str) -> int:
        return int(self._writer.register_schema(name, "ros2msg", text.encode()))

    def _channel(self, topic: str, schema: int, *, is_static: bool = False, store: str = "") -> int:
        about = {"offered_qos_profiles": qos_text(static=is_static)}
        if store:
            about[STORE] = store
        return int(self._writer.register_channel(topic, "cdr", schema, about))

    @property
    def size(self) -> int:
        """Size of the flushed part of the file, in bytes."""
        return self._flushed

    def write(self, time: int, messages: Messages, *, is_state: bool = False) -> None:
        """Write the messages of a commit, or of a state, that was read at `time` (ns)."""
        commit, moving, static, whole = messages
        sequence = commit % SEQUENCES
        if self.begun is None:
            self.begun = time
        if whole is not None:
            # It comes first: its readers skip the TFMessages of the same commit.
            if is_state and self._state < 0:
                store = epoch_of(whole).hex()
                self._state = self._channel(STATE, self._others, is_static=True, store=store)
            channel = self._state if is_state else self._commits
            self._add(channel, time, wrapped(whole), sequence)
        if static is not None:
            self._add(self._tf_static, time, static, sequence)
        if moving is not None:
            self._add(self._tf, time, moving, sequence)
        if self.pending > _CHUNK:
            self.flush()

    def _add(self, channel: int, time: int, data: bytes, sequence: int) -> None:
        self._writer.add_message(channel, time, data, time, sequence)
        self.pending += len(data)

    def write_lost(self, commits: int, last: int, time: int) -> None:
        """Write that a number of commits up to `last` are not in the file."""
        self.flush()
        about = {"commits": commits, "last_commit": last, "time_ns": time}
        with errors_name(self.part):
            self._writer.add_metadata(LOST, {key: str(value) for key, value in about.items()})

    def flush(self) -> None:
        """End the chunk, and pass it to the system; with `sync`, sync it to the disk."""
        if self._disk.is_removed:
            raise RecordingError(self.part, "the file was removed, so its commits are lost")
        with errors_name(self.part):
            self._writer.flush()
            if self._sync:
                self._disk.sync()
        self._flushed, self.pending = self._disk.size, 0

    def close(self) -> None:
        """Write the end of the file, and give it its name."""
        self.flush()
        with errors_name(self.part):
            self._writer.finish()
            self._disk.sync()
            self._flushed = self._disk.size
            self._disk.close()
            whole, part = self._places
            try:
                take_name(part, whole)
            except FileExistsError:
                reason = f"{_TAKEN}; the recording is complete in {self.part}"
                raise RecordingError(self.path, reason) from None
            part.unlink(missing_ok=True)
            bring_to_disk(whole.parent)

    def remove(self) -> None:
        """Remove the file, unless it is closed."""
        if self._disk.is_open:
            self._disk.close()
            self._places[1].unlink(missing_ok=True)

    def abandon(self) -> None:
        """Keep the flushed part under the name with `.part`, after an error."""
        if self._disk.is_open:
            with suppress(OSError):  # a reader leaves out what was not flushed
                self._disk.cut(self._flushed)
            self._disk.close()
