"""Implements `Buffer.follow`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from tfdb.data.errors import InvalidArgument
from tfdb.data.stamps import shown

from .answers import AnswerStream
from .stream import Stream

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tfdb._core import Buffer

    from .cursor import Lapped


def follow(
    buffer: Buffer,
    frames: str | Iterable[str] | None,
    pair: tuple[str, str] | None,
    since: int | Literal["held"] | None,
    hold: bool,
    min_separation: float | None,
    lapped: Lapped,
    poll: float,
) -> Stream | AnswerStream:
    """Make a stream of samples, or of the results of a pair."""
    held = since == "held"
    commit = None if held else since
    if pair is None:
        names = None if frames is None else _names_of(frames)
        return Stream(
            buffer, names, commit, held,
            hold=hold, min_separation=min_separation, lapped=lapped, poll=poll,
        )  # fmt: skip
    if frames is not None:
        raise InvalidArgument("frames and a pair exclude each other; pass one", value=frames)
    if commit is not None:
        raise InvalidArgument(
            f"since must be 'held' or None for a pair, got {shown(commit)}: the store does not "
            "keep older states",
            value=commit,
        )
    return AnswerStream(
        buffer, pair, held,
        hold=hold, min_separation=min_separation, lapped=lapped, poll=poll,
    )  # fmt: skip


def _names_of(frames: str | Iterable[str]) -> list[str]:
    if isinstance(frames, str):
        return [frames]
    try:
        names = list(frames)
    except TypeError:
        names = []
    if not names:
        raise InvalidArgument(
            f"frames must be a frame name or several, got {shown(frames)}", value=frames
        )
    return names
