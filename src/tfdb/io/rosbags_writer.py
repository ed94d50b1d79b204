"""New recordings through PyPI's `rosbags`: ROS 1 bags, MCAP files, ROS 2 databases."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from tfdb.errors import InvalidArgument, RecordingError

from .containers import NEEDS_EXTRA, Encoding

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
SUFFIXES = (".bag", ".mcap", ".db3")


class _Target(Protocol):
    """One kind of file to be."""

    encoding: Encoding

    def connect(self, topic: str, authority: str, static: bool) -> Any:
        """A new connection."""

    def write(self, connection: Any, received: int, data: bytes) -> None:
        """One message."""

    def finish(self) -> Path:
        """Close the file and say where it is."""


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

    def __init__(self, path: Path, *, compress: bool = False, overwrite: bool = False) -> None:
        if path.suffix not in SUFFIXES:
            raise RecordingError(path, f"the name must end in one of {', '.join(SUFFIXES)}")
        if path.exists() and not overwrite:
            raise RecordingError(path, "exists already; pass overwrite=True to replace it")
        if compress and path.suffix == ".db3":
            raise InvalidArgument(".db3 files are not compressed; write .mcap or .bag")
        self._path = path
        self._compress = compress
        self._connections: dict[tuple[str, str, bool], Any] = {}
        self._stack = ExitStack()
        self._target: _Target | None = None

    @property
    def encoding(self) -> Encoding:
        """How the messages of this kind of file are encoded."""
        return "ros1" if self._path.suffix == ".bag" else "cdr"

    def __enter__(self) -> Self:
        # Beside the target, so that moving it there is one atomic step.
        folder = tempfile.TemporaryDirectory(prefix=".tfdb-", dir=self._path.parent)
        work = Path(self._stack.enter_context(folder))
        try:
            if self._path.suffix == ".bag":
                self._target = _Ros1Target(work, self._compress)
            else:
                self._target = _Ros2Target(work, self._path.suffix, self._compress)
        except ModuleNotFoundError as error:
            self._stack.close()
            raise RecordingError(self._path, f"{NEEDS_EXTRA} ({error.name})") from error
        return self

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
        target, self._target = self._target, None
        with self._stack:
            if target is not None:
                written = target.finish()
                if kind is None:
                    written.replace(self._path)


class _Ros1Target:
    """A ROS 1 bag: one connection for each topic and publisher."""

    encoding: Encoding = "ros1"

    def __init__(self, work: Path, compress: bool) -> None:
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
        self._path = work / "new.bag"
        self._writer = Writer(self._path)
        if compress:
            # Not LZ4: ROS's own reader refuses the frames that rosbags makes.
            self._writer.set_compression(Writer.CompressionFormat.BZ2)
        self._writer.open()

    def connect(self, topic: str, authority: str, static: bool) -> Any:
        return self._writer.add_connection(
            topic,
            TF_MESSAGE,
            typestore=self._types,
            callerid=authority or None,
            latching=int(static),
        )

    def write(self, connection: Any, received: int, data: bytes) -> None:
        self._writer.write(connection, received, data)

    def finish(self) -> Path:
        self._writer.close()
        return self._path


class _Ros2Target:
    """An MCAP file or a ROS 2 database, taken out of the folder that rosbags makes around it."""

    encoding: Encoding = "cdr"

    def __init__(self, work: Path, suffix: str, compress: bool) -> None:
        from rosbags.rosbag2 import (  # noqa: PLC0415 - an extra
            CompressionFormat,
            CompressionMode,
            StoragePlugin,
            Writer,
        )
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415

        self._types = get_typestore(Stores.ROS2_JAZZY)
        plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
        self._path = work / "new" / f"new{suffix}"
        self._writer = Writer(work / "new", version=8, storage_plugin=plugin)
        if compress:
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()

    def connect(self, topic: str, authority: str, static: bool) -> Any:
        del authority  # ROS 2 recordings do not say who published
        return self._writer.add_connection(
            topic, TF_MESSAGE, typestore=self._types, offered_qos_profiles=[_qos(static)]
        )

    def write(self, connection: Any, received: int, data: bytes) -> None:
        self._writer.write(connection, received, data)

    def finish(self) -> Path:
        self._writer.close()
        return self._path


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
