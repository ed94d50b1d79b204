"""Losses of a damaged file."""

from __future__ import annotations

from dataclasses import dataclass

from .counting import counted


@dataclass(frozen=True)
class Loss:
    """What could not be saved of a damaged file: at least so many messages and bytes, and why.

    Messages count on the topics of transforms, and where what is left of the file tells of them.
    """

    path: str
    reason: str
    messages: int
    bytes: int

    def __str__(self) -> str:
        what = f"{counted(self.messages, 'message')} and {counted(self.bytes, 'byte')}"
        return f"{self.path}: lost at least {what}: {self.reason}"
