"""What is told of one of many that was refused: errors refer to it, so it knows nothing of them."""

from __future__ import annotations

from dataclasses import dataclass

from .on_demand import belong_to

__all__ = ["Refusal", "Refused"]


@dataclass(frozen=True, slots=True)
class Refused:
    """A member of a batch that was refused."""

    index: int
    """Its position in the batch."""
    error: str
    """Name of the error class, such as `TooOld`."""
    message: str
    """What the error would say."""
    reason: str
    """The same, in a few words where they suffice."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Messages that were refused for one reason."""

    count: int
    """How many."""
    index: int
    """Position of the first."""
    first: str
    """The error message of the first."""


belong_to("tfdb", globals(), __all__)
