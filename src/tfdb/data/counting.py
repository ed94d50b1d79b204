"""Counts in text: "1 edge", "2,000 edges"."""

from __future__ import annotations

__all__: list[str] = []


def counted(count: int, thing: str) -> str:
    """Write a count and what it counts; an `s` makes the plural."""
    return f"{count:,} {thing}" if count == 1 else f"{count:,} {thing}s"
