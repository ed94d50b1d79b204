"""Messages between the page's server and its viewers: JSON as text, poses as bytes.

Stamps are strings of digits, because JavaScript's numbers lose nanoseconds.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tfdb.data.suggestions import first_few

if TYPE_CHECKING:
    from collections.abc import Callable

CHANGED, WHOLE, PAST = 1, 2, 3
"""Kinds of pose messages: changed rows, all rows, all rows at a past stamp."""
MOST_BYTES = 1 << 16
"""Largest size of a viewer's message, in bytes."""
EVENTS = 500
"""Number of kept events, the newest ones."""
FASTEST = 60
"""Largest rate of poses that a viewer may request, in Hz."""
_HEADER = struct.Struct("<IIqII")
_STAMP = re.compile(r"[0-9]{1,19}", re.ASCII)
_LATEST = 2**63 - 1


class BadMessage(ValueError):  # noqa: N818 - as the viewer reads it
    """A viewer's message is invalid; the text names the valid values."""


@dataclass(frozen=True)
class At:
    """Request to show all poses at a stamp; None: each edge's newest sample."""

    stamp: int | None


@dataclass(frozen=True)
class Lookup:
    """Request of T[target<-source] at a stamp; None: from each edge's newest sample."""

    number: int
    target: str
    source: str
    stamp: int | None
    trail: float
    """Length of the source's trail in the target before the stamp, in seconds; 0: no trail."""


@dataclass(frozen=True)
class Rate:
    """Request to limit the rate of poses."""

    hz: int


Question: TypeAlias = At | Lookup | Rate


def read_question(message: str | bytes) -> Question:
    """Parse a viewer's message. Raises BadMessage."""
    if not isinstance(message, str):
        raise BadMessage("a message is JSON text, not bytes")
    try:
        body = json.loads(message)
    except (ValueError, RecursionError):
        raise BadMessage('a message is a JSON object, as {"type": "at", "stamp": null}') from None
    kind = body.get("type") if isinstance(body, dict) else None
    if not isinstance(kind, str) or kind not in _READERS:
        raise BadMessage(f"the type of a message is one of {first_few(list(_READERS))}")
    return _READERS[kind](body)


def _read_at(body: dict[str, Any]) -> At:
    return At(_stamp(body))


def _read_lookup(body: dict[str, Any]) -> Lookup:
    number, trail = body.get("id"), body.get("trail", 0)
    if type(number) is not int or not 0 <= number < 2**53:
        raise BadMessage("the id of a lookup is an integer from 0 on")
    if type(trail) not in (int, float) or not 0 <= trail <= 3600:
        raise BadMessage("the trail of a lookup is 0 to 3600 seconds")
    return Lookup(number, _name(body, "target"), _name(body, "source"), _stamp(body), float(trail))


def _read_rate(body: dict[str, Any]) -> Rate:
    hz = body.get("hz")
    if type(hz) is not int or not 1 <= hz <= FASTEST:
        raise BadMessage(f"the hz of a rate is an integer from 1 to {FASTEST}")
    return Rate(hz)


_READERS: dict[str, Callable[[dict[str, Any]], Question]] = {
    "at": _read_at,
    "lookup": _read_lookup,
    "rate": _read_rate,
}


def _name(body: dict[str, Any], key: str) -> str:
    name = body.get(key)
    if not isinstance(name, str) or not name:
        raise BadMessage(f"the {key} of a lookup is the name of a frame")
    return name


def _stamp(body: dict[str, Any]) -> int | None:
    value = body.get("stamp", "")
    if value is None:
        return None
    if not isinstance(value, str) or not _STAMP.fullmatch(value) or int(value) > _LATEST:
        raise BadMessage(
            f"a stamp is null or a string of nanoseconds from '0' to '{_LATEST}', not a number"
        )
    return int(value)


def write_text(kind: str, /, **fields: Any) -> str:
    """Write a server message as JSON text."""
    return json.dumps({"type": kind, **fields}, separators=(",", ":"))


def write_poses(
    kind: int,
    topology: int,
    stamp: int,
    rows: npt.NDArray[np.int64],
    poses: npt.NDArray[np.float32],
) -> bytes:
    """Write poses as bytes: a header, the rows of the tree, and 7 numbers for each."""
    head = _HEADER.pack(kind, topology, stamp, len(rows), 0)
    values = poses.astype("<f4", order="C", copy=False)
    return b"".join((head, rows.astype("<u4").data, values.data))


def as_numbers(values: npt.NDArray[np.float64]) -> list[Any]:
    """Return numbers for JSON, with None for NaN, which JSON lacks."""
    if np.isfinite(values).all():
        return values.tolist()  # type: ignore[no-any-return]
    found = values.astype(object)
    found[~np.isfinite(values)] = None
    return found.tolist()  # type: ignore[no-any-return]
