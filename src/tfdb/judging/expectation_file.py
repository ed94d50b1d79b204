"""The TOML file of expectations: reading it, with the lines of errors, and writing it."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import fields
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from tfdb.data.argument_checks import unknown_word
from tfdb.data.errors import ExpectationError, InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

_Made = TypeVar("_Made")

VERSION = 1
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
UNITS: dict[str, dict[str, float]] = {
    "deadline": TIME,
    "lifespan": TIME,
    "liveliness": TIME,
    "max_step": _LENGTH,
    "max_speed": {"m/s": 1.0, "km/h": 1 / 3.6},
    "max_turn": {"rad": 1.0, "deg": math.pi / 180},
    "max_late": TIME,
}
"""The limits, each with its units."""
_PLACE = re.compile(r"\(at line (\d+), column \d+\)")
_REQUIRED = {"edge": ("parent", "child"), "authority": ("name", "liveliness"), "default": ()}


class ExpectationFile:
    """Reader of a file; each error is an ExpectationError with its line.

    Parameters
    ----------
    path
        The file.
    kinds
        The dataclass of each table: `edge`, `authority`, `default`.
    """

    def __init__(self, path: Path, kinds: Mapping[str, Any]) -> None:
        self._path, self._kinds = path, kinds
        self._keys = {table: [each.name for each in fields(kind)] for table, kind in kinds.items()}
        self._keys["default"] = [k for k in self._keys["default"] if k not in ("parent", "child")]
        try:
            self._text = path.read_bytes().decode()
        except OSError as error:
            raise ExpectationError(path, f"cannot be read: {error.strerror}") from error
        except UnicodeDecodeError as error:
            raise ExpectationError(path, "is not UTF-8 text; give a TOML file") from error

    def read(self, whole: Callable[..., _Made]) -> _Made:
        """Return the expectations in the file."""
        try:
            body = tomllib.loads(self._text)
        except tomllib.TOMLDecodeError as error:
            place = _PLACE.search(str(error))
            line = int(place[1]) if place else self._text.count("\n") + 1
            self._refuse(_PLACE.sub("", str(error)).strip() + "; give TOML", line)
        self._check_keys(body, ["version", "clock", *self._keys], "", 0)
        version = body.get("version")
        if version is None:
            self._refuse(f"version is missing; write version = {VERSION}", 1)
        if version != VERSION or isinstance(version, bool):
            self._refuse(
                f"version is {version!r}; this tfdb reads version {VERSION}",
                self._line("", 0, "version"),
            )
        edges = [self._make("edge", *each) for each in self._sections(body, "edge")]
        authorities = [self._make("authority", *each) for each in self._sections(body, "authority")]
        default = body.get("default", {})
        if not isinstance(default, dict):
            line = self._line("default", 0, "") or self._line("", 0, "default")
            self._refuse("default must be a table; write [default]", line)
        made = self._make("default", 0, default)
        try:
            return whole(edges, authorities, made, body.get("clock", "stamps"))
        except InvalidArgument as error:
            index = error.index
            name = str(error).split()[0]
            table = "" if index is None else "authority" if name == "authority" else "edge"
            self._refuse(str(error), self._line(table, index or 0, "clock" if not table else ""))

    def _sections(self, body: dict[str, Any], table: str) -> Iterator[tuple[int, dict[str, Any]]]:
        found = body.get(table, [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            line = self._line(table, 0, "") or self._line("", 0, table)
            self._refuse(f"{table} must be an array of tables; write [[{table}]]", line)
        yield from enumerate(found)

    def _make(self, table: str, index: int, body: dict[str, Any]) -> Any:
        """Make one section's object."""
        self._check_keys(body, self._keys[table], table, index)
        for key in _REQUIRED[table]:
            if key not in body:
                self._refuse(f"[[{table}]] lacks {key}", self._line(table, index, ""))
        for key in ("severity", "authority"):
            wanted: Any = dict if key == "severity" else (str, list)
            if key in body and not isinstance(body[key], wanted):
                what = "a table of kinds" if key == "severity" else "a name, or a list of names"
                text = f"{key} is {body[key]!r}; give {what}"
                self._refuse(text, self._line(table, index, key))
        try:
            return self._kinds[table](**body)
        except InvalidArgument as error:
            self._refuse(str(error), self._line(table, index, re.split(r"\W", str(error))[0]))

    def _check_keys(self, body: dict[str, Any], known: list[str], table: str, index: int) -> None:
        for key in body:
            if key not in known:
                where = f" of {table}" if table else ""
                text = f"key{where} {unknown_word(key, known)}"
                self._refuse(text, self._line(table, index, key) or self._line(key, 0, ""))

    def _line(self, table: str, index: int, key: str) -> int:
        """Find the line of a key of the table that is the index-th of its name; 0: not found.

        If the section has no such key, for example because it is inline, return the line of its
        header.
        """
        within, seen, head = table == "", -1, 0
        for number, line in enumerate(self._text.splitlines(), 1):
            found = re.match(r"\s*\[\[?\s*\"?([\w-]+)\"?((?:\.\w+)*)\s*\]\]?", line)
            if found:
                if found[1] == table and not found[2]:
                    seen += 1
                    head = number if seen == index else head
                within = found[1] == table and seen == index
                if within and found[2].lstrip(".") == key:
                    return number
            elif within and key and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*[.=]", line):
                return number
        return head

    def _refuse(self, reason: str, line: int) -> NoReturn:
        raise ExpectationError(self._path, reason, line=line or None)


def text_of(expectations: Any) -> str:
    """Return the text of the file."""
    lines = [f"version = {VERSION}", f'clock = "{expectations.clock}"', ""]
    default = list(_lines_of(expectations.default))
    if default:
        lines += ["[default]", *default, ""]
    for edge in expectations.edges:
        names = (f"parent = {_text(edge.parent)}", f"child = {_text(edge.child)}")
        lines += ["[[edge]]", *names, *_lines_of(edge), ""]
    for each in expectations.authorities:
        lines += ["[[authority]]", f"name = {_text(each.name)}", *_lines_of(each), ""]
    return "\n".join(lines)


def _lines_of(each: Any) -> Iterator[str]:
    for name in UNITS:
        value = getattr(each, name, None)
        if value is not None:
            yield f"{name} = {value!r}"
    names = getattr(each, "authority", ())
    if names:
        yield f"authority = [{', '.join(map(_text, names))}]"
    if each.severity:
        some = ", ".join(f'{kind} = "{given}"' for kind, given in each.severity.items())
        yield f"severity = {{ {some} }}"


def _text(name: str) -> str:
    """A name as a string of TOML."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'
