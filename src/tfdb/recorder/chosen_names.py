"""Selection of the frames that are recorded, and their new names."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.recordings.edge_rules import EdgeRules
from tfdb.recordings.selection import Choice, Selection

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


class ChosenNames:
    """Selects and renames the frames of `messages_of_commits`. Threads: one."""

    def __init__(
        self,
        frames: str | Iterable[str] | None,
        exclude: str | Iterable[str],
        rename: Mapping[str, str] | None,
    ) -> None:
        self._choice = Choice(Selection(frames=frames, exclude=exclude, rename=rename))
        self._rules = EdgeRules(self._choice, None)
        self._found: dict[str, tuple[str, bool]] = {}
        self.is_all: bool = self._choice.is_idle

    def __call__(self, frame: str) -> tuple[str, bool]:
        """Return the new name of a frame, and whether the edge to its parent is recorded."""
        if frame not in self._found:
            kept = self._choice.frames
            is_kept = (kept is None or frame in kept) and not self._rules.excludes_frame(frame)
            self._found[frame] = self._rules.name(frame), is_kept
        return self._found[frame]

    def unseen(self) -> list[str]:
        """Return the names in the options that matched no frame."""
        choice = self._choice
        left = {*(choice.frames or ()), *choice.rename} - self._found.keys()
        return sorted(left | set(choice.exclude) - self._rules.used)
