"""ROS 2 databases: one SQLite file with the tables `topics` and `messages`.

A recorder that did not finish leaves a write-ahead log or a journal beside the file. SQLite merges
the log into a temporary copy. Beside a recorder that may be running, it reads under the recorder's
locks. No file of the recording is changed.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from collections import Counter
from contextlib import closing, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from tfdb.data.new_file import temporary_folder

from .containers import (
    NO_START,
    SALVAGE,
    Container,
    Gathered,
    Source,
    Topic,
    encoding_of,
    is_read_type,
    plain_type,
    typed_errors,
)
from .raw_file import MAX_CHUNK, BadDataError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path

    from .containers import Payload

_TOPIC_ROWS = "SELECT rowid, id, name, type, serialization_format FROM topics NOT INDEXED"
_MESSAGE_ROWS = "SELECT rowid, timestamp, topic_id, data FROM messages NOT INDEXED"
_TOPICS = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
_COUNTS = "SELECT topic_id, count(*), min(timestamp) FROM messages GROUP BY topic_id"
_TOPIC, _COUNT, _MESSAGE = (int, str, str, str), (int, int, int), (int, int, bytes)
_TABLES = (
    "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('messages', 'topics')"
)
_LAST_ROW = 2**62
_PLACES = 1 << 14
"""Largest number of places at which a gap is searched for intact pages."""
_SHORT = 64
"""Bytes of a short message with its row."""
_WAL_MAGICS = (0x377F0682, 0x377F0683)
_DISORDER = "its rows are out of order"
_NO_MESSAGE = "a row is not a message: its time is negative, or its types are wrong"


def open_db3(path: Path, *, salvage: bool = False) -> Container:
    """Open a `.db3` file, with the log that its recorder left; raises `RecordingError`.

    `salvage` reads the rows that SQLite can reach.
    """
    more = f"`sqlite3 {path.name} .recover` may save more"
    hint = more if salvage else f"{SALVAGE}; {more}"
    gathered = Gathered()
    with typed_errors(path, hint), _database_errors():
        real = path.resolve()  # the logs are beside the file
        logs = _logs(real, gathered if salvage else None)
        database = _connected(real, logs, gathered if salvage else None)
        try:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
            if salvage:  # lets SQLite read a file with fewer pages than its header says
                database.execute("PRAGMA writable_schema=ON").fetchall()
            _check_tables(database)
            made = _salvaged(path, database, gathered) if salvage else _open(path, database, hint)
        except BaseException:
            database.close()
            raise
    if logs:
        names = " and ".join(log.name for log in logs)
        made.notes = (f"its recorder did not finish; what it committed to {names} is read",)
    return made


def _check_tables(database: sqlite3.Connection) -> None:
    ((tables,),) = database.execute(_TABLES)
    if tables != 2:
        raise BadDataError("a database without the tables of a recording: missing tables")


def _open(path: Path, database: sqlite3.Connection, hint: str) -> Container:
    topics = [_typed(row, _TOPIC) for row in database.execute(_TOPICS)]
    found = [_typed(row, _COUNT) for row in database.execute(_COUNTS)]
    counts = {id_: count for id_, count, _ in found}
    start = min((first for _, _, first in found), default=NO_START)
    rows = [Topic(name, type_, counts.get(id_, 0)) for id_, name, type_, _ in topics]
    sources = _sources(path, topics, counts)
    payloads = partial(_messages, database)
    return Container(path, rows, sources, start, payloads, database.close, hint=hint)


def _sources(
    path: Path, topics: list[tuple[Any, ...]], counts: Mapping[int, int]
) -> dict[int, Source]:
    return {
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


def _messages(database: sqlite3.Connection, ids: Collection[int], since: int) -> Iterator[Payload]:
    marks = ", ".join("?" for _ in ids)
    # Without the condition, so that rows without a time are found.
    later = "AND timestamp >= ?" if since else ""
    query = f"""SELECT timestamp, topic_id, data FROM messages
                WHERE topic_id IN ({marks}) {later}
                ORDER BY timestamp"""  # noqa: S608 - marks alone
    with _database_errors():
        for row in database.execute(query, (*ids, since) if since else tuple(ids)):
            if not _is(row, _MESSAGE) or row[0] < 0:
                raise BadDataError(_NO_MESSAGE)
            yield row


def _is(row: tuple[object, ...], types: tuple[type, ...]) -> bool:
    """Return whether a row has the types of the format: SQLite does not enforce them."""
    return tuple(map(type, row)) == types


def _typed(row: tuple[object, ...], types: tuple[type, ...]) -> tuple[Any, ...]:
    if not _is(row, types):
        raise BadDataError("a row of a table has a value of the wrong type")
    return row


# -- unfinished databases --------------------------------------------------------------------------


def _logs(path: Path, gathered: Gathered | None) -> list[Path]:
    """Return the logs beside the file that are not empty.

    A damaged write-ahead log is noted as lost in `gathered`; without it, raises BadDataError.
    """
    named = [path.with_name(path.name + end) for end in ("-wal", "-journal")]
    logs = [log for log in named if log.is_file() and log.stat().st_size]
    if logs and logs[0].name.endswith("-wal") and not _is_log(logs[0]):
        reason = f"its write-ahead log {logs[0].name} is damaged or cut short"
        if gathered is None:
            raise BadDataError(reason)
        gathered.lose(logs[0].stat().st_size, reason)
        del logs[0]
    return logs


def _is_log(log: Path) -> bool:
    """Return whether the header of a write-ahead log is valid: SQLite ignores an invalid log."""
    with log.open("rb") as file:
        head = file.read(32)
    magic = int.from_bytes(head[:4], "big")
    if len(head) < 32 or magic not in _WAL_MAGICS:
        return False
    words = struct.unpack(f"{'>' if magic & 1 else '<'}6I", head[:24])
    one = two = 0
    for first, second in zip(words[::2], words[1::2], strict=True):
        one = (one + first + two) & 0xFFFFFFFF
        two = (two + second + one) & 0xFFFFFFFF
    return struct.unpack(">2I", head[24:]) == (one, two)


def _connected(path: Path, logs: list[Path], gathered: Gathered | None) -> sqlite3.Connection:
    if logs:
        shared = path.with_name(path.name + "-shm")
        if [log.name for log in logs] == [f"{path.name}-wal"] and shared.is_file():
            database = _connect(path, "mode=ro&readonly_shm=1")
            database.execute("BEGIN")  # all reads see one state while the recorder writes
            return database
        return _copied(path, logs)
    if gathered is not None:
        size, promised = _pages(path)
        if promised > path.stat().st_size:
            gathered.lose(promised - path.stat().st_size, "cut short, its end is missing")
            # SQLite would read zeros where a page ends early.
            return _copied(path, [], size)
    return _connect(path, "immutable=1")


def _connect(path: Path, how: str) -> sqlite3.Connection:
    name = quote(str(path.absolute()))
    return sqlite3.connect(f"file:{name}?{how}", uri=True, check_same_thread=False)


def _copied(path: Path, logs: list[Path], size: int | None = None) -> sqlite3.Connection:
    """Connect to a copy of the file, or of its first `size` bytes, with the logs merged.

    The copy is already deleted; its data last as long as the connection.
    """
    with temporary_folder() as folder:
        for file in (path, *logs):
            shutil.copyfile(file, folder / file.name)
        copy = folder / path.name
        if size is not None:
            os.truncate(copy, size)
        if logs:
            with closing(_connect(copy, "mode=rw")) as database:
                database.execute(_TABLES).fetchall()
        database = _connect(copy, "immutable=1")
        with suppress(sqlite3.DatabaseError):  # this opens the file, valid or not
            database.execute("PRAGMA schema_version").fetchall()
    return database


def _pages(path: Path) -> tuple[int, int]:
    """Return the bytes of a file's whole pages, and its size according to its header."""
    with path.open("rb") as file:
        head = file.read(32)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else max(page, 512)
    size = path.stat().st_size
    return size - size % page, int.from_bytes(head[28:32], "big") * page


# -- a damaged database ---------------------------------------------------------------------------


def _salvaged(path: Path, database: sqlite3.Connection, gathered: Gathered) -> Container:
    topics = [row for row in _rows(database, _TOPIC_ROWS, gathered) if _is(row, _TOPIC)]
    read = {id_ for id_, _, type_, _ in topics if is_read_type(type_)}
    counts: Counter[int] = Counter()
    start = NO_START
    for row in _rows(database, _MESSAGE_ROWS, gathered):
        if not _is(row, _MESSAGE) or row[0] < 0:
            gathered.lose(0, _NO_MESSAGE)
            continue
        received, id_, data = row
        counts[id_] += 1
        start = min(start, received)
        if id_ in read:
            gathered.messages.append((received, id_, data))
    rows = [Topic(name, type_, counts[id_]) for id_, name, type_, _ in topics]
    sources = _sources(path, topics, counts)
    losses = gathered.losses(path, sources)
    return Container(path, rows, sources, start, gathered.payloads, database.close, losses)


def _rows(
    database: sqlite3.Connection, query: str, gathered: Gathered
) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a table in the order of their numbers, without those on damaged pages.

    After a damaged page, the search continues in steps that double. The gap before the next row
    is then searched for intact pages. A row that precedes smaller numbers has a wrong number, if
    these follow the rows before it.
    """
    before, last, step = -1, -1, 0
    end = _last_row(database, query)
    while last + step < end:
        try:
            for number, *row in _rows_between(database, query, last + step, end):
                if before < number < last and not step:
                    gathered.lose(0, _DISORDER)
                else:
                    _check_order(last, number)
                    before = last
                if step:
                    yield from _rows_in_gap(database, query, last, number)
                last, step = number, 0
                yield tuple(row)
            if end < _LAST_ROW and last + step < end - 1:
                _check_order(end, last)  # a wrong number ended the search
        except BadDataError as error:
            if not step:
                gathered.lose(0, error)
            step = max(1, 2 * step)
        else:
            break
    if step:
        yield from _rows_in_gap(database, query, last, min(end, last + _most_rows(database)))


def _last_row(database: sqlite3.Connection, query: str) -> int:
    """Return the number after that of the last row, or a larger one if it cannot be read."""
    with suppress(BadDataError):
        for number, *_ in _rows_between(database, query, -1, _LAST_ROW, back=True):
            return int(number) + 1
    return _LAST_ROW


def _most_rows(database: sqlite3.Connection) -> int:
    """Return a number of rows that a table of short messages may have, by the size of the file."""
    with _database_errors():
        (pages,), (size,) = (
            database.execute(f"PRAGMA {each}").fetchone() for each in ("page_count", "page_size")
        )
    return int(pages * size) // _SHORT


def _check_order(last: int, number: int) -> None:
    """Refuse rows out of order, which a damaged table may repeat without end."""
    if number <= last:
        raise BadDataError(_DISORDER)


def _rows_in_gap(
    database: sqlite3.Connection, query: str, first: int, last: int
) -> Iterator[tuple[Any, ...]]:
    """Yield the rows on intact pages between two numbers, of a gap that begins with damage.

    It looks at `_PLACES` numbers of a longer gap. The caller has counted the damage.
    """
    behind = _rows_before(database, query, first, last)
    last = behind[-1][0] if behind else last
    stride = max(1, (last - first) // _PLACES)
    looked = first + stride
    while looked < last:
        with suppress(BadDataError):
            for number, *row in _rows_between(database, query, looked, last):
                _check_order(looked, number)
                if looked != first:  # rows before the place that was looked at
                    for _, *each in reversed(_rows_before(database, query, first, number)):
                        yield tuple(each)
                first = looked = number
                yield tuple(row)
        looked += stride
    for _, *each in reversed(behind):
        yield tuple(each)


def _rows_before(
    database: sqlite3.Connection, query: str, first: int, last: int
) -> list[tuple[Any, ...]]:
    """Return rows with their numbers, back from the later of two, until a page cannot be read."""
    found = []
    with suppress(BadDataError):  # the caller counts that page
        for number, *row in _rows_between(database, query, first, last, back=True):
            if not first < number < last:
                break
            last = number
            found.append((number, *row))
    return found


def _rows_between(
    database: sqlite3.Connection, query: str, first: int, last: int, *, back: bool = False
) -> Iterator[tuple[Any, ...]]:
    """Yield the rows between two numbers, until a page is damaged.

    Python's sqlite3 reads one row ahead, and drops a row if the next one cannot be read: that row
    is read again by itself.
    """
    order = f"{query} WHERE rowid > ? AND rowid < ? ORDER BY rowid{' DESC' * back}"
    with _database_errors():
        try:
            for row in database.execute(order, (first, last)):
                yield row
                first, last = (first, row[0]) if back else (row[0], last)
        except sqlite3.DatabaseError:
            yield from database.execute(f"{order} LIMIT 1", (first, last))
            raise


@contextmanager
def _database_errors() -> Iterator[None]:
    """Convert SQLite's errors for damaged files to BadDataError, but not those of wrong calls."""
    try:
        yield
    except sqlite3.ProgrammingError:
        raise
    except sqlite3.DatabaseError as error:
        raise BadDataError(str(error)) from error
