"""New recordings: ROS 1 bags, MCAP files, ROS 2 databases."""

from __future__ import annotations

import errno
import os
import sqlite3
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from tfdb._core import Recorded
from tfdb.data.argument_checks import check_flag, unknown_ending
from tfdb.data.errors import InvalidArgument, InvalidStamp, RecordingError
from tfdb.data.new_file import new_file, refuse_existing
from tfdb.data.path_checks import check_path

from .container_writers import Connection, open_container

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from .container_writers import ContainerWriter
    from .containers import Encoding
    from .recording import PathLike

SUFFIXES = (".bag", ".mcap", ".db3")
_TOGETHER = 1024
"""Number of single messages that are collected and written together."""


class RecordingWriter:
    """Writes messages of transforms to a new recording. Not for several threads at once.

    It is a context manager. The file appears under its name at the end of the block, but not after
    an exception.

    Parameters
    ----------
    path
        A name that ends in `.bag` (ROS 1), `.mcap` or `.db3` (ROS 2).
    compress
        zstd for MCAP, bz2 for bags; `.db3` files have no compression.
    overwrite
        Replace an existing file.

    Raises
    ------
    RecordingError
        An unknown extension, or the file exists. Fields: path, reason.
    """

    def __init__(self, path: PathLike, *, compress: bool = False, overwrite: bool = False) -> None:
        path = check_path(path, RecordingError)
        if path.suffix not in SUFFIXES:
            raise RecordingError(path, unknown_ending(str(path), SUFFIXES))
        refuse_existing(path, overwrite=overwrite, refusal=RecordingError)
        if check_flag("compress", compress) and path.suffix == ".db3":
            raise InvalidArgument(".db3 files cannot be compressed; write .mcap or .bag")
        self._path = path
        self._compress = compress
        self._overwrite = overwrite
        self._connections: dict[Connection, int] = {}
        self._pending = Recorded()
        self._stack = ExitStack()
        self._container: ContainerWriter | None = None

    @property
    def encoding(self) -> Encoding:
        """Encoding of the messages in this file format."""
        return "ros1" if self._path.suffix == ".bag" else "cdr"

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            file = new_file(self._path, overwrite=self._overwrite, refusal=RecordingError)
            made = stack.enter_context(file)
            stack.enter_context(_database_errors(self._path))
            container = open_container(made, self._path, compress=self._compress)
            stack.callback(container.close)
            stack.push(lambda kind, *_: self._finish(container) if kind is None else None)
            self._container = container
            self._stack = stack.pop_all()
        return self

    def write(
        self, data: bytes, received: int, *, topic: str, static: bool = False, authority: str = ""
    ) -> None:
        """Append one TFMessage in the encoding `encoding`, received at a stamp (ns).

        Raises InvalidStamp for a time outside 0 to 2**64 - 1 ns.
        """
        if not 0 <= received < 2**64:
            raise InvalidStamp(f"received must be 0 to 2^64 - 1 ns, got {received}", value=received)
        self._pending.add(received, self.connection(topic, authority, static=static), bytes(data))
        if len(self._pending) >= _TOGETHER:
            self.write_messages(Recorded())

    def connection(self, topic: str, authority: str = "", *, static: bool = False) -> int:
        """Return the number of a topic and its publisher, for `write_messages`."""
        # ROS 2 files have no publisher names: one connection for each topic.
        connection = Connection(topic, authority if self.encoding == "ros1" else "", static)
        number = self._connections.get(connection)
        if number is None:
            number = len(self._connections)
            self._opened().connect(number, connection)
            self._connections[connection] = number
        return number

    def write_messages(self, messages: Recorded) -> None:
        """Append messages; the source of each is the number of a connection."""
        container = self._opened()
        pending, self._pending = self._pending, Recorded()
        for each in (pending, messages):
            container.write(each)

    def _opened(self) -> ContainerWriter:
        if self._container is None:
            raise RecordingError(self._path, "the writer is not open: use it in a `with` block")
        return self._container

    def _finish(self, container: ContainerWriter) -> None:
        container.write(self._pending)
        container.finish()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._container = None
        self._stack.__exit__(kind, error, traceback)


@contextmanager
def _database_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's file system errors into `OSError`."""
    try:
        yield
    except sqlite3.OperationalError as error:
        full = error.sqlite_errorcode == sqlite3.SQLITE_FULL
        number = errno.ENOSPC if full else errno.EIO
        raise OSError(number, f"{os.strerror(number)} ({error})", str(path)) from error
