"""Bytes of a diagnostic_msgs/DiagnosticArray, for ROS 1 and ROS 2."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb.data.decimal_time import NS_PER_SECOND as NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

LEVELS = ("ok", "warning", "error", "stale")
"""The levels in the order of their numbers."""


@dataclass(frozen=True)
class DiagnosticStatus:
    """The state of one part of a robot."""

    level: str
    """One of LEVELS."""
    name: str
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def encode_diagnostics(stamp: int, statuses: Sequence[DiagnosticStatus], *, cdr: bool) -> bytes:
    """Return the bytes; `cdr`: for ROS 2, with the encapsulation header.

    The nearest stamp that the message can hold replaces a stamp before 1970, or after 2038 (ROS 2)
    or 2106 (ROS 1): a report is more useful than its exact time.
    """
    seconds = 1 << (31 if cdr else 32)
    stamp = min(max(stamp, 0), seconds * NS - 1)
    out = _Writer(cdr=cdr)
    if not cdr:
        out.number(0)
    out.number(stamp // NS)
    out.number(stamp % NS)
    out.text("")
    out.number(len(statuses))
    for status in statuses:
        out.data.append(LEVELS.index(status.level))
        for text in (status.name, status.message, "tfdb"):
            out.text(text)
        out.number(len(status.values))
        for key, value in status.values.items():
            out.text(key)
            out.text(value)
    return bytes(out.data)


class _Writer:
    """Numbers of 32 bits and texts, little-endian; CDR aligns numbers and ends texts with a 0."""

    def __init__(self, *, cdr: bool) -> None:
        self._cdr = cdr
        self.data = bytearray(b"\0\1\0\0" if cdr else b"")

    def number(self, value: int) -> None:
        if self._cdr:
            self.data += bytes(-len(self.data) % 4)
        self.data += struct.pack("<I", value)

    def text(self, value: str) -> None:
        encoded = value.encode(errors="replace") + (b"\0" if self._cdr else b"")
        self.number(len(encoded))
        self.data += encoded
