"""The format of recorded histories, and their parser.

A history is a text file, one JSON object a line. The first line is the header:

    {"tfdb_history": 1, "engine": "silo", "seed": 7}

Only `tfdb_history` is needed, the rest is free. Every further line is one operation or transaction:

    {"process": 0, "thread": 2, "id": "2-17", "begin": 120, "end": 190, "status": "committed",
     "reads": [{"edge": "base", "kind": "latest", "value": 41},
               {"edge": "arm", "kind": "at", "stamp": 30, "before": 17, "after": 19, "own": 0}],
     "writes": [{"edge": "base", "value": 57, "stamp": 40, "parent": "map"},
                {"edge": "tool", "value": 58, "op": "remove"}],
     "commit": 9, "as_of": 8}

process, thread
    Integers: who. One thread does one thing at a time.
id
    A text or integer of its own.
begin, end
    Nanoseconds on one monotonic clock of the machine, read before the call and after its return.
status
    `committed`; `aborted`: it left nothing behind; `unknown`: its process died meanwhile.
reads
    An edge is named by its child frame. `latest`: its newest sample; null: there was none, or no
    such frame. `at`: what stood around a stamp, `before` (at or before it) and `after` (at or after
    it); null: nothing on that side, left out: that side was not looked at. `own`: how many of the
    transaction's own writes came before this read (default 0).
writes
    In their order. `value` is unique in the whole history. `stamp` left out or null: a static edge,
    which has one value at a time. `parent` may be left out. `op`: `set` (the default: makes the
    frame where it is new, re-parents it where the parent is another) or `remove`.
commit
    The number that the store gave the commit, where one is known; on each edge they must be in the
    order of the commits.
as_of
    The commit whose state was read, where the store says so: a hint, never a proof.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

from tfdb.data.errors import FileError
from tfdb.data.path_checks import check_path, errors_name

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

FORMAT = 1
STATUSES = ("committed", "aborted", "unknown")

Value = int | str


class HistoryError(FileError):
    """A recorded history that cannot be judged: `HistoryError(path, line, reason)`.

    Fields: path, line (None where the file as a whole is wrong), reason.
    """

    def __init__(self, path: object, line: int | None, reason: str) -> None:
        super().__init__(path, reason, line=line)


class Unseen(Enum):
    """The side of a read that was not looked at."""

    UNSEEN = "unseen"


UNSEEN = Unseen.UNSEEN


class Read(NamedTuple):
    """One edge as it was seen: newest (`stamp` None, then only `before` counts), or at a stamp."""

    edge: str
    stamp: int | None
    before: Value | Unseen | None
    after: Value | Unseen | None = UNSEEN
    own: int = 0


class Write(NamedTuple):
    """One value written to an edge, or the removal of its frame."""

    edge: str
    value: Value
    stamp: int | None = None
    parent: str | None = None
    remove: bool = False


@dataclass(slots=True)
class Transaction:
    """One operation or transaction: what it read and wrote, and when."""

    id: Value
    begin: int
    end: int
    reads: tuple[Read, ...] = ()
    writes: tuple[Write, ...] = ()
    status: str = "committed"
    process: int = 0
    thread: int = 0
    commit: int | None = None
    as_of: int | None = None
    line: int | None = None


@dataclass
class History:
    """All transactions of a run, in any order, and what the recorder says of itself."""

    transactions: list[Transaction]
    header: dict[str, Any] = field(default_factory=dict)
    path: str = "history"


def load_history(path: str | Path) -> History:
    """Read a history from a file of JSON lines.

    Raises
    ------
    HistoryError
        With path, line and reason, where a line is not what it should be.
    OSError
        Where the file cannot be read.
    """
    file = check_path(path)
    with errors_name(file), file.open("rb") as lines:
        return parse_history(lines, str(path))


def parse_history(lines: Iterable[str | bytes], path: str = "history") -> History:
    """Parse lines of JSON; `path` is for messages. Raises as `load_history`."""
    numbered = enumerate(lines, start=1)
    header = _header(next(numbered, (1, ""))[1], path)
    parser = _Parser()
    transactions = []
    for number, line in numbered:
        if not line.strip():
            continue
        try:
            body = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise HistoryError(path, number, f"no JSON object: {error}") from None
        try:
            transactions.append(parser.transaction(body, number))
        except _Bad as bad:
            raise HistoryError(path, number, str(bad)) from None
    _one_at_a_time(transactions, path)
    return History(transactions, header, path)


class _Bad(Exception):  # noqa: N818
    """What is wrong with a line."""


def _header(line: str | bytes, path: str) -> dict[str, Any]:
    try:
        body = json.loads(line)
    except (ValueError, RecursionError):
        body = None
    if not isinstance(body, dict) or "tfdb_history" not in body:
        raise HistoryError(path, 1, 'no history: the first line must hold {"tfdb_history": 1}')
    if body["tfdb_history"] != FORMAT or isinstance(body["tfdb_history"], bool):
        reason = f"format {body['tfdb_history']!r} is not known, only {FORMAT} is"
        raise HistoryError(path, 1, reason)
    return body


def _one_at_a_time(transactions: list[Transaction], path: str) -> None:
    latest: dict[tuple[int, int], Transaction] = {}
    for one in sorted(transactions, key=lambda t: (t.begin, t.end)):
        before = latest.get((one.process, one.thread))
        if before is not None and one.begin < before.end:
            reason = f"thread {one.thread} begins {one.id!r} before it has ended {before.id!r}"
            raise HistoryError(path, one.line, reason)
        latest[one.process, one.thread] = one


class _Parser:
    """Turns objects into transactions; remembers what must be unique."""

    def __init__(self) -> None:
        self._ids: dict[Value, int] = {}
        self._values: dict[Value, int] = {}

    def transaction(self, body: Any, line: int) -> Transaction:
        if not isinstance(body, dict):
            raise _Bad("no JSON object")
        begin, end = _integer(body, "begin"), _integer(body, "end")
        if end < begin:
            raise _Bad(f"ends at {end}, before it begins at {begin}")
        status = body.get("status")
        if status not in STATUSES:
            raise _Bad(f"status {status!r} is none of {', '.join(STATUSES)}")
        name = _value(body.get("id"), "id")
        if self._ids.setdefault(name, line) != line:
            raise _Bad(f"id {name!r} is already that of line {self._ids[name]}")
        writes = tuple(self._write(item, line) for item in _list(body, "writes"))
        reads = tuple(_read(item, len(writes)) for item in _list(body, "reads"))
        return Transaction(
            name,
            begin,
            end,
            reads,
            writes,
            status,
            _integer(body, "process"),
            _integer(body, "thread"),
            _optional_integer(body, "commit"),
            _optional_integer(body, "as_of"),
            line,
        )

    def _write(self, item: Any, line: int) -> Write:
        edge = _edge(item, "write")
        value = _value(item.get("value"), "value of a write")
        if value in self._values:
            raise _Bad(f"value {value!r} was already written in line {self._values[value]}")
        self._values[value] = line
        op = item.get("op", "set")
        if op not in {"set", "remove"}:
            raise _Bad(f"op {op!r} is neither 'set' nor 'remove'")
        parent = item.get("parent")
        if parent is not None and not isinstance(parent, str):
            raise _Bad(f"parent {parent!r} is not a text")
        return Write(edge, value, _optional_integer(item, "stamp"), parent, op == "remove")


def _read(item: Any, writes: int) -> Read:
    edge = _edge(item, "read")
    own = item.get("own", 0)
    if type(own) is not int or not 0 <= own <= writes:
        raise _Bad(f"own {own!r} is not a number from 0 to {writes}")
    kind = item.get("kind", "latest")
    if kind == "latest":
        if "value" not in item:
            raise _Bad("a read of kind 'latest' without its value")
        return Read(edge, None, _seen(item, "value"), UNSEEN, own)
    if kind != "at":
        raise _Bad(f"kind {kind!r} is neither 'latest' nor 'at'")
    if "before" not in item and "after" not in item:
        raise _Bad("a read of kind 'at' with neither before nor after")
    return Read(edge, _integer(item, "stamp"), _seen(item, "before"), _seen(item, "after"), own)


def _edge(item: Any, what: str) -> str:
    if not isinstance(item, dict):
        raise _Bad(f"a {what} that is not a JSON object: {item!r}")
    edge = item.get("edge")
    if not isinstance(edge, str):
        raise _Bad(f"edge {edge!r} of a {what} is not a text")
    return edge


def _seen(item: dict[str, Any], key: str) -> Value | Unseen | None:
    if key not in item:
        return UNSEEN
    found = item[key]
    return None if found is None else _value(found, key)


def _value(found: Any, what: str) -> Value:
    if type(found) is int or isinstance(found, str):
        return found
    raise _Bad(f"{what} {found!r} is neither text nor integer")


def _list(body: dict[str, Any], key: str) -> list[Any]:
    found = body.get(key, [])
    if not isinstance(found, list):
        raise _Bad(f"{key} is not a list: {found!r}")
    return found


def _integer(body: dict[str, Any], key: str) -> int:
    found = body.get(key)
    if type(found) is not int:
        raise _Bad(f"{key} {found!r} is not an integer" if key in body else f"no {key}")
    return found


def _optional_integer(body: dict[str, Any], key: str) -> int | None:
    return None if body.get(key) is None else _integer(body, key)
