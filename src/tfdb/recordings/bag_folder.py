"""ROS 2 bag folders: `metadata.yaml` and the files that it names."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from tfdb.data.errors import RecordingError
from tfdb.data.loss import Loss
from tfdb.data.path_checks import errors_name

from .containers import NO_START, Container, is_tf_type, kind_of, typed_errors
from .db3_reader import open_db3
from .mcap_reader import open_mcap
from .packed_file import open_packed
from .raw_file import BadDataError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from tfdb._core import Recorded

    from .containers import Kind, Source

_METADATA = "metadata.yaml"
_MAX_METADATA = 16 * 2**20
_PART = re.compile(r".*\.(db3|mcap)(\.zstd)?", re.DOTALL)
_NUMBERED = re.compile(r"(.*)_(\d{1,9})(\.(?:db3|mcap)(?:\.zstd)?)", re.DOTALL)


@dataclass
class _Metadata:
    """The metadata that is used: file names, and the number of messages of each topic.

    `first` and `last` are the receive times of the first and the last message, nanoseconds.
    """

    files: list[str]
    first: int = 0
    last: int = NO_START - 1
    counts: dict[str, int] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)


def open_folder(folder: Path, *, salvage: bool = False) -> Container:
    """Open a bag folder by its metadata; without metadata, open all its files.

    Missing files, unreadable metadata, and files with fewer messages than the metadata states raise
    `RecordingError`; with `salvage` they count as lost. Files that the metadata do not name replace
    missing files if they begin in its time span and all messages are there. With `salvage` they may
    have fewer messages.
    """
    problems: list[str] = []
    notes: list[str] = []

    def problem(reason: str) -> None:
        if not salvage:
            raise RecordingError(folder, f"{reason}; salvage=True (--salvage) reads what is there")
        problems.append(reason)

    with typed_errors(folder), ExitStack() as stack:
        metadata = _metadata(folder, problem)
        missing = [name for name in metadata.files if not (folder / name).exists()]
        there = [name for name in metadata.files if name not in missing]
        parts = _opened(folder, there, stack, problem, salvage=salvage)
        if missing:
            names = sorted(set(_recordings_in(folder)) - set(there))
            found = _opened(folder, names, stack, problem, salvage=salvage)
            others = [part for part in found if metadata.first <= part.start <= metadata.last]
            parts += others
            told = f"files that its {_METADATA} names are missing: {', '.join(missing)}"
            listed = ", ".join(part.path.name for part in others)
            if others and _found(parts) == Counter(metadata.counts):
                notes.append(f"{told}; {listed} is read instead: it holds the promised messages")
            else:
                problem(told + (f"; {listed} may replace them" if others else ""))
        if not parts:
            raise RecordingError(folder, _why_none(folder, problems))
        lost = _lost(metadata, parts)
        if lost and not problems:
            listed = ", ".join(f"{count} of {name!r}" for name, count in lost.items())
            problem(f"its metadata promises messages that its files lack: {listed}")
        losses = [loss for part in parts for loss in part.losses]
        if problems:
            known = sum(loss.messages for loss in losses)
            count = max(0, sum(lost.values()) - known)
            losses.append(Loss(str(folder), "; ".join(problems), count, 0))
        return _Joined(folder, parts, losses, notes, stack.pop_all().close)


def _opened(
    folder: Path,
    names: list[str],
    stack: ExitStack,
    problem: Callable[[str], None],
    *,
    salvage: bool,
) -> list[Container]:
    """Open files. A file that cannot be opened raises RecordingError, with `salvage` it is lost."""
    parts = []
    for name in names:
        try:
            parts.append(_open(folder / name, stack, salvage=salvage))
        except RecordingError as error:
            if not salvage:
                raise
            problem(str(error))
    return parts


def _recordings_in(folder: Path) -> list[str]:
    """Return the names of .db3 and .mcap files, without packed copies of files beside them."""
    names = sorted(each.name for each in folder.iterdir() if _PART.fullmatch(each.name))
    return [name for name in names if name.removesuffix(".zstd") == name or name[:-5] not in names]


def _why_none(folder: Path, problems: list[str]) -> str:
    """Return the reason why no file of a folder can be read."""
    if problems:
        return "; ".join(problems)
    held = sorted(each.name + "/" * each.is_dir() for each in folder.iterdir())
    listed = ", ".join(held[:5]) + (f" and {len(held) - 5} more" if len(held) > 5 else "")
    return f"a folder without .db3 or .mcap files; it holds {listed or 'nothing'}"


class _Joined(Container):
    """Several files as one container, one after the other by their start."""

    def __init__(
        self,
        folder: Path,
        parts: list[Container],
        losses: list[Loss],
        notes: list[str],
        close: Callable[[], None],
    ) -> None:
        self._parts = sorted(parts, key=lambda part: part.start)
        topics = [topic for part in self._parts for topic in part.topics]
        super().__init__(folder, topics, {}, self._parts[0].start, lambda *_: (), close, losses)
        self.sources = tuple(source for part in self._parts for source in part.sources)
        parts_notes = [f"{part.path.name}: {note}" for part in self._parts for note in part.notes]
        self.notes = (*notes, *parts_notes)

    def messages(
        self, wanted: Callable[[Source], bool], since: int = 0
    ) -> Iterator[tuple[Source, int, bytes]]:
        """See `Container.messages`."""
        for part in self._parts:
            yield from part.messages(wanted, since)

    def read(
        self, wanted: Callable[[Source], bool], step: Callable[[int], None]
    ) -> Iterator[tuple[Recorded, Mapping[int, Source]]]:
        """See `Container.read`."""
        return chain.from_iterable([part.read(wanted, step) for part in self._parts])


def _found(parts: list[Container]) -> Counter[str]:
    """Count the messages of each topic."""
    found: Counter[str] = Counter()
    for part in parts:
        for topic in part.topics:
            found[topic.name] += topic.messages
    return found


def _lost(metadata: _Metadata, parts: list[Container]) -> dict[str, int]:
    """Count the missing messages of each topic: those in the metadata but not in the files."""
    found = _found(parts)
    return {
        name: count - found[name]
        for name, count in metadata.counts.items()
        if count > found[name] and is_tf_type(metadata.types[name])
    }


def _metadata(folder: Path, problem: Callable[[str], None]) -> _Metadata:
    """Read the metadata; without metadata, list the files of the folder."""
    path = folder / _METADATA
    if path.exists():
        try:
            return _parse(path)
        except BadDataError as error:
            problem(f"its {_METADATA} is broken: {error}")
    names = _recordings_in(folder)
    missing = _holes(names)
    if missing:
        problem(f"parts are missing, judging by the names: {', '.join(missing)}")
    return _Metadata(names)


def _holes(names: list[str]) -> list[str]:
    """Return the names of missing parts between others. Recorders may drop the first parts."""
    numbers: dict[tuple[str, str], set[int]] = defaultdict(set)
    for name in names:
        if numbered := _NUMBERED.fullmatch(name):
            numbers[numbered[1], numbered[3]].add(int(numbered[2]))
    return [
        f"{stem}_{number}{end}"
        for (stem, end), found in numbers.items()
        for number in range(min(found), min(max(found), min(found) + len(found) + 10))
        if number not in found
    ]


def _parse(path: Path) -> _Metadata:
    from ruamel.yaml import YAML  # noqa: PLC0415 - an extra, and slow to import
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415

    if path.stat().st_size > _MAX_METADATA:
        raise BadDataError(f"it has more than {_MAX_METADATA} bytes")
    try:
        with errors_name(path):
            text = path.read_text("utf-8")
        whole = YAML(typ="safe").load(text)
    except (YAMLError, ValueError, RecursionError) as error:
        words = " ".join(str(error).split())[:200]
        raise BadDataError(f"no YAML: {words}") from error
    found = _get(whole, "rosbag2_bagfile_information", dict)
    names = [PurePath(name).name for name in _get(found, "relative_file_paths", list, of=str)]
    if not names or not all(names):
        raise BadDataError("it names no files")
    packing = str(found.get("compression_mode") or "").lower()
    made = _Metadata(names)
    if packing not in ("", "none", "storage", "file", "message"):
        raise BadDataError(f"the compression mode {packing[:40]!r} is unknown")
    format_ = str(found.get("compression_format") or "").lower()
    if packing in ("file", "message") and format_ != "zstd":
        raise BadDataError(f"the compression format {format_[:40]!r} is not zstd")
    if "starting_time" in found and "duration" in found:
        made.first = _get(_get(found, "starting_time", dict), "nanoseconds_since_epoch", int)
        made.last = made.first + _get(_get(found, "duration", dict), "nanoseconds", int)
    for topic in _get(found, "topics_with_message_count", list, of=dict):
        inner = _get(topic, "topic_metadata", dict)
        name = _get(inner, "name", str)
        made.counts[name] = made.counts.get(name, 0) + _get(topic, "message_count", int)
        made.types[name] = _get(inner, "type", str)
    return made


def _get(whole: Any, key: str, kind: type, of: type | None = None) -> Any:
    value: Any = whole.get(key) if isinstance(whole, dict) else None
    fits = isinstance(value, kind)
    if not fits or (of is not None and not all(isinstance(each, of) for each in value)):
        raise BadDataError(f"its {key!r} is missing or invalid")
    return value


def _open(path: Path, stack: ExitStack, *, salvage: bool) -> Container:
    """Open one file of the folder."""
    kind = kind_of(path)
    if kind not in _OPENERS:
        raise RecordingError(path, "neither a ROS 2 database (.db3) nor an MCAP file")
    part = _OPENERS[kind](path, salvage=salvage)
    stack.callback(part.close)
    return part


_OPENERS: dict[Kind, Callable[..., Container]] = {
    "mcap": open_mcap,
    "db3": open_db3,
    "packed": open_packed,
}
