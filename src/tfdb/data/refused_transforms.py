"""Records of refused transforms; separate to avoid an import cycle with the errors."""

from __future__ import annotations

from dataclasses import dataclass

from .lazy_names import belong_to

__all__ = ["Refusal", "Refused", "RefusedEdge"]


@dataclass(frozen=True, slots=True)
class Refused:
    """A member of a batch that was refused."""

    index: int
    """Its position in the batch."""
    error: str
    """Name of the error class, such as `TooOld`."""
    message: str
    """The error's message."""
    reason: str
    """A short form of the message, if there is one."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Transforms that were refused with one error."""

    count: int
    """Number of transforms; of messages if the error concerns a message as a whole."""
    index: int
    """Position of the first message with a refused transform."""
    first: str
    """The error message of the first."""


@dataclass(frozen=True, slots=True)
class RefusedEdge:
    """Transforms of one edge that were refused with one error."""

    edge: str
    """The child frame; empty if `is_message`."""
    error: str
    """Name of the error class, such as `InvalidTransform`."""
    count: int
    """Number of transforms; of messages if `is_message`."""
    first: str
    """The error message of the first."""
    is_message: bool = False
    """Whether the error concerns messages as a whole, such as `CorruptMessage`."""


belong_to("tfdb.types", globals(), __all__)
