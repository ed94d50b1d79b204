"""The containers of new recordings: ROS 1 bags, MCAP files, ROS 2 databases.

Formats: https://wiki.ros.org/Bags/Format/2.0, https://mcap.dev/spec, rosbag2_storage_sqlite3.
"""

from __future__ import annotations

import bz2
import json
import sqlite3
import struct
from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from tfdb._core import MessageChunk
from tfdb.data.errors import RecordingError

from .raw_file import zstd_module
from .tf_definition import ROS1_DIGEST, ROS1_TEXT, ROS2_DIGEST, ROS2_TEXT, TYPE, qos_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from tfdb._core import Recorded

    from .containers import Encoding

_CHUNK = 1 << 20
"""A chunk ends with the first message that makes it larger than this many bytes."""
_MOST_CHANNELS = 0xFFFF
_BAG_END = 2**32 * 10**9
_DB3_END = 2**63
_ROS2_TYPE = TYPE.replace("/", "/msg/")
_VERSION = 8
"""Version of the metadata of rosbag2."""


@dataclass(frozen=True)
class Connection:
    """A topic of a new recording, and its publisher."""

    topic: str
    authority: str
    static: bool


class ContainerWriter(Protocol):
    """A writer of one file format. Not for several threads at once."""

    encoding: Encoding

    def connect(self, number: int, connection: Connection) -> None:
        """Add a connection; connections are numbered from 0."""

    def write(self, messages: Recorded) -> None:
        """Add messages; their sources are connection numbers."""

    def finish(self) -> None:
        """Write the end of the file, and close it."""

    def close(self) -> None:
        """Close the incomplete file."""


def open_container(path: Path, named: Path, *, compress: bool) -> ContainerWriter:
    """Make a new file in the format of its extension; errors name `named`."""
    if path.suffix == ".bag":
        return _Bag(path, named, compress=compress)
    if path.suffix == ".mcap":
        return _Mcap(path, named, compress=compress)
    return _Database(path, named)


def _with_length(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


class _Chunked(ABC):
    """A file of chunks of messages."""

    def __init__(self, path: Path, named: Path, chunk: MessageChunk) -> None:
        self._file = path.open("xb")
        self._named = named
        self._chunk = chunk
        self._connections: list[Connection] = []

    def write(self, messages: Recorded) -> None:
        first = 0
        while first < len(messages):
            first = self._chunk.fill(messages, first, _CHUNK)
            if len(self._chunk) > _CHUNK:
                self._end_chunk()

    @abstractmethod
    def _end_chunk(self) -> None:
        """Write the chunk with its indexes, and begin a new one."""

    def close(self) -> None:
        self._file.close()


# -- ROS 1 ----------------------------------------------------------------------------------------


class _Bag(_Chunked):
    encoding: Encoding = "ros1"
    _HEADER_BYTES = 4096
    _MAGIC = b"#ROSBAG V2.0\n"

    def __init__(self, path: Path, named: Path, *, compress: bool) -> None:
        super().__init__(path, named, MessageChunk("bag"))
        # Not LZ4: ROS's reader refuses the frames of Python's lz4 library.
        self._pack: Callable[[bytes], bytes] = bz2.compress if compress else bytes
        self._packing = b"bz2" if compress else b"none"
        self._infos: list[bytes] = []
        self._file.write(self._MAGIC + self._head(0))

    def connect(self, number: int, connection: Connection) -> None:
        self._connections.append(connection)
        self._chunk.add_record(self._connection(number))

    def _end_chunk(self) -> None:
        chunk = self._chunk
        if chunk.end >= _BAG_END:
            raise RecordingError(
                self._named, f"a bag holds times before {_BAG_END} ns, got {chunk.end}"
            )
        at, size = self._file.tell(), len(chunk)
        head = {b"op": b"\x05", b"compression": self._packing, b"size": struct.pack("<I", size)}
        self._file.write(_bag_record(head, self._pack(chunk.records())))
        indexes = chunk.indexes()
        for number, count, entries in indexes:
            numbers = {b"conn": number, b"count": count, b"ver": 1}
            head = {key: struct.pack("<I", value) for key, value in numbers.items()}
            self._file.write(_bag_record({b"op": b"\x04", **head}, entries))
        start = min(chunk.start, chunk.end)
        head = {
            b"op": b"\x06",
            b"ver": struct.pack("<I", 1),
            b"chunk_pos": struct.pack("<Q", at),
            b"start_time": struct.pack("<II", *divmod(start, 10**9)),
            b"end_time": struct.pack("<II", *divmod(chunk.end, 10**9)),
            b"count": struct.pack("<I", len(indexes)),
        }
        counts = b"".join(struct.pack("<II", number, count) for number, count, _ in indexes)
        self._infos.append(_bag_record(head, counts))
        chunk.clear()

    def finish(self) -> None:
        if len(self._chunk):
            self._end_chunk()
        index = self._file.tell()
        for number in range(len(self._connections)):
            self._file.write(self._connection(number))
        self._file.writelines(self._infos)
        self._file.seek(len(self._MAGIC))
        self._file.write(self._head(index))
        self._file.close()

    def _head(self, index: int) -> bytes:
        head = {
            b"op": b"\x03",
            b"index_pos": struct.pack("<Q", index),
            b"conn_count": struct.pack("<I", len(self._connections)),
            b"chunk_count": struct.pack("<I", len(self._infos)),
        }
        rest = self._HEADER_BYTES - len(_bag_record(head, b""))
        return _bag_record(head, b" " * rest)

    def _connection(self, number: int) -> bytes:
        connection = self._connections[number]
        topic = connection.topic.encode()
        about = {
            b"topic": topic,
            b"type": TYPE.encode(),
            b"md5sum": ROS1_DIGEST.encode(),
            b"message_definition": ROS1_TEXT.encode(),
            b"latching": b"1" if connection.static else b"0",
        }
        if connection.authority:
            about[b"callerid"] = connection.authority.encode()
        head = {b"op": b"\x07", b"conn": struct.pack("<I", number), b"topic": topic}
        return _bag_record(head, _bag_fields(about))


def _bag_fields(fields: dict[bytes, bytes]) -> bytes:
    return b"".join(_with_length(name + b"=" + value) for name, value in fields.items())


def _bag_record(head: dict[bytes, bytes], data: bytes) -> bytes:
    return _with_length(_bag_fields(head)) + _with_length(data)


# -- MCAP -----------------------------------------------------------------------------------------


class _Mcap(_Chunked):
    encoding: Encoding = "cdr"
    _MAGIC = b"\x89MCAP0\r\n"

    def __init__(self, path: Path, named: Path, *, compress: bool) -> None:
        super().__init__(path, named, MessageChunk("mcap"))
        self._pack: Callable[[bytes], bytes] = zstd_module().compress if compress else bytes
        self._packing = b"zstd" if compress else b""
        self._indexes: list[bytes] = []
        self._counts: Counter[int] = Counter()
        self._start, self._end = 2**64 - 1, 0
        schema = _with_length(_ROS2_TYPE.encode()) + _with_length(b"ros2msg")
        self._schema = _mcap_record(
            0x03, struct.pack("<H", 1) + schema + _with_length(ROS2_TEXT.encode())
        )
        self._channels: list[bytes] = []
        head = _with_length(b"ros2") + _with_length(b"tfdb")
        self._file.write(self._MAGIC + _mcap_record(0x01, head))
        self._chunk.add_record(self._schema)

    def connect(self, number: int, connection: Connection) -> None:
        if number > _MOST_CHANNELS:
            raise RecordingError(self._named, f"an MCAP file holds {_MOST_CHANNELS + 1} channels")
        self._connections.append(connection)
        qos = _mcap_text("offered_qos_profiles", qos_text(static=connection.static))
        self._channels.append(
            _mcap_record(
                0x04,
                struct.pack("<HH", number, 1)
                + _mcap_text(connection.topic, "cdr")
                + _with_length(qos),
            )
        )
        self._chunk.add_record(self._channels[number])

    def _end_chunk(self) -> None:
        chunk = self._chunk
        packed, size = self._pack(chunk.records()), len(chunk)
        times = struct.pack("<QQ", min(chunk.start, chunk.end), chunk.end)
        sizes = struct.pack("<QI", size, 0) + _with_length(self._packing)
        at = self._file.tell()
        self._file.write(
            _mcap_record(0x06, times + sizes + struct.pack("<Q", len(packed)) + packed)
        )
        end, places = self._file.tell(), b""
        for number, count, entries in chunk.indexes():
            places += struct.pack("<HQ", number, self._file.tell())
            self._counts[number] += count
            self._file.write(_mcap_record(0x07, struct.pack("<H", number) + _with_length(entries)))
        self._indexes.append(
            _mcap_record(
                0x08,
                times
                + struct.pack("<QQ", at, end - at)
                + _with_length(places)
                + struct.pack("<Q", self._file.tell() - end)
                + _with_length(self._packing)
                + struct.pack("<QQ", len(packed), size),
            )
        )
        self._start, self._end = min(self._start, chunk.start), max(self._end, chunk.end)
        chunk.clear()

    def finish(self) -> None:
        self._end_chunk()
        about = _metadata("mcap", self._named.name, self._connections, self._counts, self._span)
        metadata = _with_length(b"rosbag2") + _with_length(_mcap_text("serialized_metadata", about))
        at = self._file.tell()
        self._file.write(_mcap_record(0x0C, metadata))
        place = struct.pack("<QQ", at, self._file.tell() - at) + _with_length(b"rosbag2")
        self._file.write(_mcap_record(0x0F, struct.pack("<I", 0)))
        counts = b"".join(struct.pack("<HQ", *each) for each in sorted(self._counts.items()))
        statistics = struct.pack(
            *("<QHIIIIQQ", self._counts.total(), 1, len(self._channels), 0, 1),
            *(len(self._indexes), *self._span),
        )
        start, offsets = self._file.tell(), b""
        for kind, records in (
            (0x03, [self._schema]),
            (0x04, self._channels),
            (0x08, self._indexes),
            (0x0D, [_mcap_record(0x0D, place)]),
            (0x0B, [_mcap_record(0x0B, statistics + _with_length(counts))]),
        ):
            if records:
                at = self._file.tell()
                self._file.writelines(records)
                group = struct.pack("<BQQ", kind, at, self._file.tell() - at)
                offsets += _mcap_record(0x0E, group)
        foot = struct.pack("<QQI", start, self._file.tell(), 0)
        self._file.write(offsets + _mcap_record(0x02, foot) + self._MAGIC)
        self._file.close()

    @property
    def _span(self) -> tuple[int, int]:
        """Return the times of the first and the last message."""
        return min(self._start, self._end), self._end


def _mcap_record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _mcap_text(*texts: str) -> bytes:
    return b"".join(_with_length(text.encode()) for text in texts)


# -- ROS 2 databases ------------------------------------------------------------------------------


class _Database:
    encoding: Encoding = "cdr"
    _TABLES = """
    CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
    CREATE TABLE metadata(
      id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL);
    CREATE TABLE topics(
      id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
      serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
      type_description_hash TEXT NOT NULL);
    CREATE TABLE message_definitions(
      id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
      encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
    CREATE TABLE messages(
      id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
      data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);
    INSERT INTO schema(schema_version, ros_distro) VALUES (4, 'unknown');
    """

    def __init__(self, path: Path, named: Path) -> None:
        self._named = named
        self._connections: list[Connection] = []
        self._counts: Counter[int] = Counter()
        self._start, self._end = _DB3_END, 0
        self._database = sqlite3.connect(path)
        self._database.executescript(self._TABLES)
        definition = (_ROS2_TYPE, "ros2msg", ROS2_TEXT, ROS2_DIGEST)
        self._insert("message_definitions", [(None, *definition)])

    def _insert(self, table: str, rows: Iterable[tuple[object, ...]]) -> None:
        marks = {"messages": 4, "metadata": 3, "message_definitions": 5, "topics": 6}[table]
        self._database.executemany(
            f"INSERT INTO {table} VALUES ({', '.join('?' * marks)})",  # noqa: S608 - constants
            rows,
        )

    def connect(self, number: int, connection: Connection) -> None:
        self._connections.append(connection)
        qos = qos_text(static=connection.static)
        row = (number + 1, connection.topic, _ROS2_TYPE, "cdr", qos, ROS2_DIGEST)
        self._insert("topics", [row])

    def write(self, messages: Recorded) -> None:
        if not len(messages):
            return
        first, last = messages.span()
        if last >= _DB3_END:
            raise RecordingError(
                self._named, f"a database holds times before {_DB3_END} ns, got {last}"
            )
        rows = map(messages.__getitem__, range(len(messages)))
        self._insert("messages", ((None, number + 1, at, data) for at, number, data in rows))
        self._counts.update(messages.counts())
        self._start, self._end = min(self._start, first), max(self._end, last)

    def finish(self) -> None:
        span = (min(self._start, self._end), self._end)
        about = _metadata("sqlite3", self._named.name, self._connections, self._counts, span)
        self._insert("metadata", [(None, _VERSION, about)])
        self._database.commit()
        self._database.execute("PRAGMA optimize")
        self._database.close()

    def close(self) -> None:
        self._database.close()


def _metadata(
    storage: str,
    name: str,
    connections: Iterable[Connection],
    counts: Counter[int],
    span: tuple[int, int],
) -> str:
    """Return the metadata of rosbag2 as JSON, which is valid YAML and needs no library."""
    start, end = span
    times = {
        "starting_time": {"nanoseconds_since_epoch": start},
        "duration": {"nanoseconds": end - start},
        "message_count": counts.total(),
    }
    topics = [
        {
            "topic_metadata": {
                "name": each.topic,
                "type": _ROS2_TYPE,
                "serialization_format": "cdr",
                "offered_qos_profiles": qos_text(static=each.static),
                "type_description_hash": ROS2_DIGEST,
            },
            "message_count": counts[number],
        }
        for number, each in enumerate(connections)
    ]
    about = {
        "version": _VERSION,
        "storage_identifier": storage,
        "relative_file_paths": [name],
        **times,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": name, **times}],
        "custom_data": None,
        "ros_distro": "unknown",
    }
    return json.dumps(about)
