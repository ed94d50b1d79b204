"""New recordings through PyPI's `rosbags`: ROS 1 bags, MCAP files, ROS 2 databases."""

from __future__ import annotations

import errno
import os
import sqlite3
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from tfdb.data.argument_checks import given_flag, unknown_ending
from tfdb.data.errors import InvalidArgument, RecordingError
from tfdb.data.new_file import new_file, refuse_existing
from tfdb.data.path_checks import given_path

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractContextManager
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from .containers import Encoding
    from .recording import PathLike

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
SUFFIXES = (".bag", ".mcap", ".db3")


class _Target(Protocol):
    """One kind of file to be."""

    encoding: Encoding

    def connect(self, topic: str, authority: str, static: bool) -> Any:
        """A new connection."""

    def write(self, connection: Any, received: int, data: bytes) -> None:
        """One message."""

    @property
    def writer(self) -> AbstractContextManager[Any]:
        """The library's writer, which closes the file."""

    def deliver(self) -> None:
        """Put the closed file where it was to be made."""


class RecordingWriter:
    """Writes messages of transforms to a new recording. Not for several threads at once.

    A context manager: the file appears under its name when all is written, and not at all when an
    exception ends the block.

    Parameters
    ----------
    path
        A name that ends in `.bag` (ROS 1), `.mcap` or `.db3` (ROS 2).
    compress
        zstd for MCAP, bz2 for bags; `.db3` files have no compression.
    overwrite
        Whether a file of that name may be replaced.

    Raises
    ------
    RecordingError
        Another ending, the file exists, or `rosbags` is not installed. Fields: path, reason.
    """

    def __init__(self, path: PathLike, *, compress: bool = False, overwrite: bool = False) -> None:
        path = given_path(path, RecordingError)
        if path.suffix not in SUFFIXES:
            raise RecordingError(path, unknown_ending(str(path), SUFFIXES))
        refuse_existing(path, overwrite=overwrite, refusal=RecordingError)
        if given_flag("compress", compress) and path.suffix == ".db3":
            raise InvalidArgument(".db3 files are not compressed; write .mcap or .bag")
        self._path = path
        self._compress = compress
        self._overwrite = overwrite
        self._connections: dict[tuple[str, str, bool], Any] = {}
        self._stack = ExitStack()
        self._target: _Target | None = None

    @property
    def encoding(self) -> Encoding:
        """How the messages of this kind of file are encoded."""
        return "ros1" if self._path.suffix == ".bag" else "cdr"

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            file = new_file(self._path, overwrite=self._overwrite, refusal=RecordingError)
            made = stack.enter_context(file)
            stack.enter_context(_database_errors(self._path))
            try:
                target = self._make(made)
            except ModuleNotFoundError as error:
                reason = f"to write it needs {error.name}: pip install 'tfdb[recordings]'"
                raise RecordingError(self._path, reason) from error
            stack.push(lambda kind, *_: target.deliver() if kind is None else None)
            stack.enter_context(target.writer)
            self._target = target
            self._stack = stack.pop_all()
        return self

    def _make(self, made: Path) -> _Target:
        if self._path.suffix == ".bag":
            return _Ros1Target(made, self._compress)
        return _Ros2Target(made, self._compress)

    def write(
        self, data: bytes, received: int, *, topic: str, static: bool = False, authority: str = ""
    ) -> None:
        """Append one TFMessage, encoded as `encoding` says, received at a stamp (ns)."""
        if self._target is None:
            raise RecordingError(self._path, "the writer is not open: use it in a `with` block")
        # Files of ROS 2 do not say who published: one connection for all of a topic.
        key = topic, authority if self.encoding == "ros1" else "", static
        connection = self._connections.get(key)
        if connection is None:
            connection = self._target.connect(topic, authority, static)
            self._connections[key] = connection
        self._target.write(connection, received, data)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._target = None
        self._stack.__exit__(kind, error, traceback)


@contextmanager
def _database_errors(path: Path) -> Iterator[None]:
    """Turn what SQLite says of the file system into `OSError`."""
    try:
        yield
    except sqlite3.OperationalError as error:
        full = error.sqlite_errorcode == sqlite3.SQLITE_FULL
        number = errno.ENOSPC if full else errno.EIO
        raise OSError(number, f"{os.strerror(number)} ({error})", str(path)) from error


class _Ros1Target:
    """A ROS 1 bag: one connection for each topic and publisher."""

    encoding: Encoding = "ros1"
    writer: Any

    def __init__(self, made: Path, compress: bool) -> None:
        from rosbags.rosbag1 import Writer  # noqa: PLC0415 - an extra
        from rosbags.typesys import (  # noqa: PLC0415
            Stores,
            get_types_from_msg,
            get_typestore,
        )

        self._types = get_typestore(Stores.ROS1_NOETIC)
        # rosbags knows the messages of ROS 1 but for those of tf2.
        text = "geometry_msgs/TransformStamped[] transforms"
        self._types.register(get_types_from_msg(text, TF_MESSAGE))
        self.writer = Writer(made)
        if compress:
            # Not LZ4: ROS's own reader refuses the frames that rosbags makes.
            self.writer.set_compression(Writer.CompressionFormat.BZ2)

    def connect(self, topic: str, authority: str, static: bool) -> Any:
        return self.writer.add_connection(
            topic,
            TF_MESSAGE,
            typestore=self._types,
            callerid=authority or None,
            latching=int(static),
        )

    def write(self, connection: Any, received: int, data: bytes) -> None:
        self.writer.write(connection, received, data)

    def deliver(self) -> None:
        """It was written there."""


class _Ros2Target:
    """An MCAP file or a ROS 2 database, taken out of the folder that rosbags makes around it."""

    encoding: Encoding = "cdr"
    writer: Any

    def __init__(self, made: Path, compress: bool) -> None:
        from rosbags.rosbag2 import (  # noqa: PLC0415 - an extra
            CompressionFormat,
            CompressionMode,
            StoragePlugin,
            Writer,
        )
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

        self._types = get_typestore(Stores.ROS2_JAZZY)
        plugin = StoragePlugin.MCAP if made.suffix == ".mcap" else StoragePlugin.SQLITE3
        self._made = made
        folder = made.with_name("new")
        self._path = folder / f"new{made.suffix}"
        self.writer = Writer(folder, version=8, storage_plugin=plugin)
        if compress:
            self.writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)

    def connect(self, topic: str, authority: str, static: bool) -> Any:
        del authority  # ROS 2 recordings do not say who published
        return self.writer.add_connection(
            topic, TF_MESSAGE, typestore=self._types, offered_qos_profiles=[_qos(static)]
        )

    def write(self, connection: Any, received: int, data: bytes) -> None:
        self.writer.write(connection, received, data)

    def deliver(self) -> None:
        self._path.replace(self._made)


def _qos(static: bool) -> Any:
    """The quality of service with which tf2 publishes: static transforms reach late joiners."""
    from rosbags.interfaces import (  # noqa: PLC0415 - an extra
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    unlimited = QosTime(sec=9223372036, nsec=854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if static else 100,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if static else QosDurability.VOLATILE,
        deadline=unlimited,
        lifespan=unlimited,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=unlimited,
        avoid_ros_namespace_conventions=False,
    )
