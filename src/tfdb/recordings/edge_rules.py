"""Selection of edges of recorded messages, and new frame names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tfdb.recordings.containers import prefix_of

if TYPE_CHECKING:
    from .containers import Source
    from .selection import Choice


class EdgeRules:
    """Decides about edges, and remembers which entries of `exclude` matched.

    It has no reference to its callers, so that `_core.Selection`, which keeps it, is in no cycle.

    Parameters
    ----------
    choice
        The selection.
    children
        Child frames of the edges to keep; None: all.
    """

    def __init__(self, choice: Choice, children: frozenset[str] | None) -> None:
        self.children = children
        self.used: set[str] = set()
        """The entries of `exclude` that matched a name."""
        self.seen: set[str] = set()
        """The frames of all edges seen, before they are renamed."""
        self._choice = choice
        self._excluded = [(entry, _pattern(entry)) for entry in choice.exclude]
        self._excluded_edges = [
            (entry, _pattern(entry.replace(":/", ":", 1)))
            for entry in choice.exclude
            if ":" in entry
        ]
        self._is_out: dict[str, bool] = {}
        self._numbers: dict[tuple[str, str], int] = {}
        self._sources: list[Source] = []

    @property
    def names(self) -> set[str]:
        """The names that were compared with `exclude`, for warnings."""
        return {name.removeprefix("/") for name in self._is_out if name.isprintable()}

    def number(self, source: Source) -> int:
        """Return the rule of a source, for `edge`."""
        key = source.topic, source.authority
        number = self._numbers.setdefault(key, len(self._sources))
        if number == len(self._sources):
            self._sources.append(source)
        return number

    def space(self, source: Source) -> str:
        """Return the prefix that `by_namespace` gives to the frames of a topic."""
        return prefix_of(source) if self._choice.by_namespace else ""

    def frames(self, rule: int, parent: str, child: str) -> tuple[str, str]:
        """Return the names of an edge's frames before they are renamed."""
        space = self.space(self._sources[rule])
        return space + parent, space + child

    def edge(self, rule: int, parent: str, child: str) -> tuple[str, str] | None:
        """Return the new names of an edge; None: it is skipped.

        An empty name gets no prefix: the store refuses it.
        """
        source = self._sources[rule]
        old = self.frames(rule, parent, child)
        is_taken = self.takes(source, *old)
        if self.excludes_source(source) or not is_taken:
            return None
        return (self.name(old[0]), self.name(old[1])) if parent and child else (parent, child)

    def excludes_source(self, source: Source) -> bool:
        """Return whether a topic or its publisher is excluded."""
        return self._excludes(source.topic, source.authority)

    def excludes_frame(self, frame: str) -> bool:
        """Return whether a frame is excluded by its name, in every edge."""
        return self._excludes(frame)

    def takes(self, source: Source, parent: str, child: str) -> bool:
        """Return whether an edge of a source that is not excluded is kept."""
        self.seen.update((parent, child))
        is_out = self._excludes(parent, child)
        is_out |= self._excludes(f"{source.topic}:{child}", edges=True)
        return not is_out and (self.children is None or child in self.children)

    def name(self, frame: str) -> str:
        """Return the new name of a frame."""
        return self._choice.prefix + self._choice.rename.get(frame, frame)

    def _excludes(self, *names: str, edges: bool = False) -> bool:
        """Return whether a name is excluded. `edges`: only entries with ':' name edges."""
        excluded = self._excluded_edges if edges else self._excluded
        if not excluded:
            return False
        for name in names:
            if name not in self._is_out:
                plain = name.removeprefix("/")
                used = {entry for entry, pattern in excluded if pattern.fullmatch(plain)}
                self.used |= used
                self._is_out[name] = bool(used)
        return any(self._is_out[name] for name in names)


def _pattern(entry: str) -> re.Pattern[str]:
    """The pattern for a name: `*` stands for any characters, `?` for one."""
    parts = {"*": ".*", "?": "."}
    return re.compile("".join(parts.get(each, re.escape(each)) for each in entry), re.DOTALL)
