"""Counts in text: "1 edge", "2,000 edges"."""

from __future__ import annotations

__all__: list[str] = []


def counted(count: int, thing: str) -> str:
    """Write a count and its noun, with an `s` for the plural."""
    return f"{count:,} {thing}" if count == 1 else f"{count:,} {thing}s"
