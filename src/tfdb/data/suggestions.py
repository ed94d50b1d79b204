"""Suggestions for mistyped names."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

from .errors import UnknownFrame

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


def near_names(name: str, known: Iterable[str], *, most: int = 3, cutoff: float = 0.5) -> list[str]:
    """Return the names in `known` most similar to `name`, ignoring case, nearest first."""
    alike: dict[str, list[str]] = {}
    for each in known:
        alike.setdefault(each.casefold(), []).append(each)
    near = difflib.get_close_matches(name.casefold(), alike, most, cutoff)
    return [each for folded in near for each in alike[folded]][:most]


def did_you_mean(names: Iterable[str], known: Iterable[str]) -> str:
    """Suggest the known names nearest to missing ones; empty if none is near."""
    known = sorted(known)
    near = dict.fromkeys(each for name in names for each in near_names(name, known, most=1))
    return f"; did you mean {', '.join(map(repr, near))}?" if near else ""


def first_few(names: Sequence[str]) -> str:
    """List the first ten names in their order, and count the others."""
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(map(repr, sorted(names)[:10])) + more


def no_frame(option: str, frame: str, frames: Sequence[str]) -> UnknownFrame:
    """Return the error for a frame that an option names and `frames` lack."""
    near = near_names(frame, frames)
    hint = (
        f"did you mean {', '.join(map(repr, near))}?"
        if near
        else f"the frames are {first_few(frames)}"
    )
    return UnknownFrame(f"{option}: frame {frame!r} does not exist; {hint}", frame=frame)
