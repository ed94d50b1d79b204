"""Losses of a damaged file."""

from __future__ import annotations

from dataclasses import dataclass

from .counting import counted


@dataclass(frozen=True)
class Loss:
    """The loss of a damaged file: the least number of messages and bytes, and the reason.

    Only messages on topics with transforms count, if the rest of the file still lists them.
    """

    path: str
    reason: str
    messages: int
    bytes: int

    def __str__(self) -> str:
        lost = {"message": self.messages, "byte": self.bytes}
        known = " and ".join(counted(count, word) for word, count in lost.items() if count)
        what = f"at least {known}" if known else "an unknown part"
        return f"{self.path}: lost {what}: {self.reason}"
