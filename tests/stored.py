"""All that a store holds, for comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tfdb._core import StoreReader


def samples_of(reads: StoreReader) -> dict[str, Any]:
    """The stamps, poses and parents of each frame, to the last bit."""
    found: dict[str, Any] = {}
    for name in reads.frames():
        stamps, poses, parents = reads.samples(name)
        found[name] = stamps.tolist(), poses.tobytes(), list(parents)
    return found


def stored(reads: StoreReader) -> object:
    """The facts and the samples of each frame."""
    return reads.tree(), samples_of(reads)
