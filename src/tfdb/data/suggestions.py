"""Which of the names that there are may have been meant."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def near_names(name: str, known: Iterable[str], *, most: int = 3, cutoff: float = 0.5) -> list[str]:
    """Those of `known` that are most like `name`, whatever their case; the nearest first."""
    alike: dict[str, list[str]] = {}
    for each in known:
        alike.setdefault(each.casefold(), []).append(each)
    near = difflib.get_close_matches(name.casefold(), alike, most, cutoff)
    return [each for folded in near for each in alike[folded]][:most]
