"""ROS 2 databases: one SQLite file with the tables `topics` and `messages`."""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from tfdb.errors import RecordingError

from .containers import (
    NO_START,
    Container,
    Source,
    Topic,
    encoding_of,
    is_read_type,
    plain_type,
    typed_errors,
)
from .raw_file import MAX_CHUNK, BadDataError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from .containers import Payload

_TOPICS = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
_COUNTS = "SELECT topic_id, count(*), min(timestamp) FROM messages GROUP BY topic_id"
_MESSAGE = (int, int, bytes)
_TABLES = (
    "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('messages', 'topics')"
)


def open_db3(path: Path, *, salvage: bool = False) -> Container:
    """Open a `.db3` file; raises `RecordingError`.

    There is nothing to salvage: SQLite reads zeros where a file was cut.
    """
    del salvage
    log = path.with_name(path.name + "-wal")
    if log.is_file() and log.stat().st_size:
        raise RecordingError(
            path,
            f"the recorder did not finish and left messages in {log.name}: merge them with "
            f"`sqlite3 {path.name} 'PRAGMA wal_checkpoint'`",
        )
    with typed_errors(path, _hint(path)), _database_errors():
        database = sqlite3.connect(
            f"file:{quote(str(path.absolute()))}?immutable=1", uri=True, check_same_thread=False
        )
        try:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
            return _open(path, database)
        except BaseException:
            database.close()
            raise


def _open(path: Path, database: sqlite3.Connection) -> Container:
    ((tables,),) = database.execute(_TABLES)
    if tables != 2:
        raise BadDataError("a database without the tables of a recording: missing tables")
    topics = [_typed(row, (int, str, str, str)) for row in database.execute(_TOPICS)]
    found = [_typed(row, (int, int, int)) for row in database.execute(_COUNTS)]
    counts = {id_: count for id_, count, _ in found}
    start = min((first for _, _, first in found), default=NO_START)
    rows = [Topic(name, type_, counts.get(id_, 0)) for id_, name, type_, _ in topics]
    sources = {
        id_: Source(
            name,
            encoding_of(path, name, type_, format_),
            name,
            counts.get(id_, 0),
            plain_type(type_),
        )
        for id_, name, type_, format_ in topics
        if is_read_type(type_)
    }
    payloads = partial(_messages, database)
    return Container(path, rows, sources, start, payloads, database.close, hint=_hint(path))


def _hint(path: Path) -> str:
    return f"`sqlite3 {path.name} .recover` may save the rest"


def _messages(database: sqlite3.Connection, ids: Collection[int]) -> Iterator[Payload]:
    marks = ", ".join("?" for _ in ids)
    query = f"""SELECT timestamp, topic_id, data FROM messages
                WHERE topic_id IN ({marks}) ORDER BY timestamp"""  # noqa: S608 - marks alone
    with _database_errors():
        for row in database.execute(query, tuple(ids)):
            if tuple(map(type, row)) != _MESSAGE:
                raise BadDataError("a message of another type than the format has")
            yield row


def _typed(row: tuple[object, ...], types: tuple[type, ...]) -> tuple[Any, ...]:
    """A row with the types that the format wants: SQLite itself minds none."""
    if not all(isinstance(value, type_) for value, type_ in zip(row, types, strict=True)):
        raise BadDataError("a row of a table holds something else than it should")
    return row


@contextmanager
def _database_errors() -> Iterator[None]:
    """Let what SQLite says of a damaged file count as that; a wrong call of it does not."""
    try:
        yield
    except sqlite3.ProgrammingError:
        raise
    except sqlite3.DatabaseError as error:
        raise BadDataError(str(error)) from error
