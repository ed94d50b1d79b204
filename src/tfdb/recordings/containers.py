"""The interface of a recording's container, for all formats.

One file per format makes a `Container` (`bag_reader`, `mcap_reader`, `db3_reader`, `bag_folder`).
Payloads stay bytes: the store decodes them itself.
"""

from __future__ import annotations

import stat
import struct
from bisect import bisect_left
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import zip_longest
from operator import itemgetter
from typing import TYPE_CHECKING, Literal, TypeAlias, TypeVar

from tfdb._core import Recorded
from tfdb.data.errors import RecordingError
from tfdb.data.loss import Loss
from tfdb.data.path_checks import errors_name, shell_word

from .raw_file import ZSTD, BadDataError, BrokenChunkError, unpack_message

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from tfdb.trajectories.reading_report import TrajectoryRows

T = TypeVar("T")

Encoding: TypeAlias = Literal["ros1", "cdr", "protobuf", "json"]
"""Message types with transforms; the first two are TFMessage."""
Kind: TypeAlias = Literal["bag", "db3", "mcap", "packed", "folder", "trajectory"]
Payload: TypeAlias = "tuple[int, int, bytes]"
"""Receive time (ns), id of the source, bytes."""
Surveyed: TypeAlias = "tuple[dict[int, int], bool, Iterator[Recorded]]"
Survey: TypeAlias = "Callable[[Collection[int], Callable[[int], None]], Surveyed]"

SALVAGE = "salvage=True (--salvage) reads as far as possible"
NO_START = 2**63 - 1

_TF_TYPES = frozenset({"tf2_msgs/TFMessage", "tf/tfMessage"})
TRAJECTORIES = (".tum", ".txt", ".csv", ".npz", ".parquet")
"""Extensions of trajectory files."""
POSES_WITHOUT_CHILD = frozenset(
    {
        "geometry_msgs/PoseStamped",
        "geometry_msgs/PoseWithCovarianceStamped",
        "nav_msgs/Path",
        "foxglove.PoseInFrame",
    }
)
"""Types of messages with a pose that do not name the child frame."""
FRAME_TRANSFORMS = frozenset({"foxglove.FrameTransform", "foxglove.FrameTransforms"})
"""Types of Foxglove's messages with transforms between two named frames."""
POSE_TYPES = (
    POSES_WITHOUT_CHILD | FRAME_TRANSFORMS | {"nav_msgs/Odometry", "geometry_msgs/TransformStamped"}
)
"""Types of messages whose poses are read on the topics of `pose_topics`."""
JOINT_STATE = "sensor_msgs/JointState"
_MAGICS: tuple[tuple[bytes, Kind], ...] = (
    (b"#ROSBAG V2.0", "bag"),
    (b"\x89MCAP0\r\n", "mcap"),
    (b"SQLite format 3\0", "db3"),
    (ZSTD, "packed"),
)
_BINARY: dict[str, Kind] = {".bag": "bag", ".mcap": "mcap"}
OTHER_START = "its first bytes are damaged"
"""The loss of a file whose kind is known only by its extension."""
_LOG = "the log of a .db3: give the .db3 instead, which is read with its log"
_OTHERS = (
    (b"#ROSBAG V1", "a bag of the old version 1: convert it with `rosbag fix`"),
    (
        b"version https://git-lfs",
        "a Git LFS pointer, not the recording itself: fetch it with `git lfs pull`",
    ),
    (b"TFDBFRZ1", "a frozen store: tfdb.open('{name}') opens it"),
    (b"\x37\x7f\x06\x82", _LOG),
    (b"\x37\x7f\x06\x83", _LOG),
    (b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", _LOG),
    (b"rosbag2_bagfile_information:", "the metadata of a bag folder: give the folder"),
    (
        b"\x04\x22\x4d\x18",
        "compressed as a whole with lz4: run `lz4 -dc {word} > FILE` first, and give FILE",
    ),
    (
        b"BZh",
        "compressed as a whole with bzip2: run `bzip2 -dc {word} > FILE` first, and give FILE",
    ),
    (
        b"\x1f\x8b",
        "compressed as a whole with gzip: run `gzip -dc {word} > FILE` first, and give FILE",
    ),
)


@dataclass(frozen=True)
class Topic:
    """A topic of a recording, of any type, with the number of its messages."""

    name: str
    type: str
    messages: int


@dataclass(frozen=True)
class Source:
    """One stream of messages: a ROS 1 connection, a ROS 2 topic or an MCAP channel.

    `authority` is the publisher: the node's name if the container has it (ROS 1), otherwise the
    topic. `type` is the message type in ROS 1's spelling.
    """

    topic: str
    encoding: Encoding
    authority: str
    messages: int
    type: str = "tf2_msgs/TFMessage"

    @property
    def is_tf(self) -> bool:
        """Whether its messages are TFMessages, which the store decodes."""
        return self.type in _TF_TYPES

    @property
    def holds_transforms(self) -> bool:
        """Whether its messages are transforms: TFMessages, or Foxglove's own."""
        known = self.type in FRAME_TRANSFORMS and self.encoding in encodings_of(self.type)
        return self.is_tf or known

    @property
    def holds_joint_states(self) -> bool:
        """Whether its messages are joint states."""
        return self.type == JOINT_STATE

    @property
    def is_static(self) -> bool:
        """Whether its transforms are static, by the topic's name.

        The last part of the name is `tf_static`; for Foxglove's transforms it ends in `_static`.
        """
        last = self.topic.rstrip("/").rsplit("/", 1)[-1]
        foxglove = self.type in FRAME_TRANSFORMS and last.endswith("_static")
        return self.holds_transforms and (last == "tf_static" or foxglove)


class Container:
    """An open recording. Not for several threads at once.

    Parameters
    ----------
    path
        The file or folder, for errors.
    topics
        All topics, also those without transforms.
    sources
        The streams of transforms, poses and joint states, by id.
    start
        Receive time of the first message, nanoseconds; `NO_START` without messages.
    payloads
        Returns the messages of the sources with the given ids, sorted by receive time; messages of
        one time keep the order of the file. It may skip messages that were received before its
        second argument.
    close
        Closes the file. A second call does nothing.
    losses
        The losses of a damaged file.
    hint
        Advice for a damaged file.
    survey
        For containers that are read in C++: reads the whole file, and calls its second argument
        with the number of messages of each step. Returns the number of messages by id, whether each
        message is compressed by itself, and the messages of `payloads` in parts, which are read
        again when they are needed.
    """

    notes: tuple[str, ...] = ()
    """Remarks on how an unfinished or renamed file was read."""
    store: str = ""
    """The store that a tfdb.Recorder recorded; empty for other files."""
    rows: TrajectoryRows | None = None
    """Counts of the rows of a trajectory file."""

    def __init__(
        self,
        path: Path,
        topics: Iterable[Topic],
        sources: Mapping[int, Source],
        start: int,
        payloads: Callable[[Collection[int], int], Iterable[Payload]],
        close: Callable[[], None],
        losses: Sequence[Loss] = (),
        *,
        hint: str = SALVAGE,
        survey: Survey | None = None,
    ) -> None:
        self.path = path
        self._sources = sources
        self._payloads = payloads
        self.topics: tuple[Topic, ...] = tuple(topics)
        self.sources: tuple[Source, ...] = tuple(sources.values())
        self.start = start
        self.close = close
        self.losses: tuple[Loss, ...] = tuple(losses)
        self._hint = hint
        self._survey = survey

    def messages(
        self, wanted: Callable[[Source], bool], since: int = 0
    ) -> Iterator[tuple[Source, int, bytes]]:
        """Yield source, receive time (ns) and payload of each message, sorted by receive time.

        `since`: the earliest receive time. Raises `RecordingError` if the file is damaged, possibly
        after some messages.
        """
        sources = {id_: source for id_, source in self._sources.items() if wanted(source)}
        found = dict.fromkeys(sources, 0)
        with typed_errors(self.path, self._hint):
            for received, id_, data in self._payloads(sources.keys(), since):
                if received < since:
                    continue
                found[id_] += 1
                source = sources[id_]
                yield source, received, unpack_message(data) if is_packed(source, data) else data
            if not since:
                _check_counts(sources, found)

    def read(
        self, wanted: Callable[[Source], bool], step: Callable[[int], None]
    ) -> Iterator[tuple[Recorded, Mapping[int, Source]]]:
        """Return all messages in parts, each with its sources by their numbers in the part.

        It checks the whole file first, and raises `RecordingError` if the file is damaged. So do
        the parts if the file changes meanwhile. `step` is called with the number of messages
        since the last call.
        """
        if self._survey is not None:
            sources = {id_: source for id_, source in self._sources.items() if wanted(source)}
            with typed_errors(self.path, self._hint):
                counts, packed, parts = self._survey(sources.keys(), step)
                _check_counts(sources, counts)
            if not packed:
                return ((part, sources) for part in self._typed(parts))
        recorded = Recorded()
        # Containers return the same object for the same source.
        numbers = {id(source): number for number, source in enumerate(self.sources)}
        for source, received, data in self.messages(wanted):
            recorded.add(received, numbers[id(source)], data)
            if len(recorded) % _STEP == 0:
                step(_STEP)
        step(len(recorded) % _STEP)
        return iter([(recorded, dict(enumerate(self.sources)))])

    def _typed(self, parts: Iterable[Recorded]) -> Iterator[Recorded]:
        with typed_errors(self.path, self._hint):
            yield from parts


def is_packed(source: Source, data: bytes) -> bool:
    """Return whether a message is compressed with zstd, as by rosbag2; CDR never begins like it."""
    return data[:4] == ZSTD and source.encoding == "cdr"


def are_packed(messages: Recorded, sources: Mapping[int, Source]) -> bool:
    """Return whether messages (at least one) are compressed singly: a recorder does all or none."""
    _, id_, data = messages[0]
    return is_packed(sources[id_], data)


def unpacked(messages: Recorded, sources: Mapping[int, Source]) -> Recorded:
    """Return messages (at least one), decompressed if they are compressed singly."""
    if not are_packed(messages, sources):
        return messages
    made = Recorded()
    for index in range(len(messages)):
        received, id_, data = messages[index]
        made.add(received, id_, unpack_message(data) if is_packed(sources[id_], data) else data)
    return made


def _check_counts(sources: Mapping[int, Source], found: Mapping[int, int]) -> None:
    """Refuse a file whose numbers of messages differ from its index."""
    for id_, source in sources.items():
        if found.get(id_, 0) != source.messages:
            promise = f"its index promises {source.messages} messages on {source.topic!r}"
            raise BadDataError(f"{promise}, the file holds {found.get(id_, 0)}")


@dataclass
class Gathered:
    """Messages found by a scan without the index; only those that may have transforms.

    `promised` are the message counts in records outside the chunks, by id.
    """

    messages: list[Payload] = field(default_factory=list)
    promised: Counter[int] = field(default_factory=Counter)
    bytes_lost: int = 0
    reasons: list[str] = field(default_factory=list)

    def lose(self, count: int, reason: object) -> None:
        """Count bytes without a message."""
        self.bytes_lost += max(count, 0)
        self.reasons.append(str(reason))

    def take(self, messages: Iterable[Payload], size: int) -> int:
        """Add the messages of a chunk of `size` bytes; return how many bytes were valid."""
        try:
            for message in messages:
                self.messages.append(message)
        except BrokenChunkError as error:
            return error.at
        return size

    def found(self) -> Counter[int]:
        """Count the messages of each source."""
        return Counter(id_ for _, id_, _ in self.messages)

    def payloads(self, ids: Collection[int], since: int) -> list[Payload]:
        """Return the messages of some sources, sorted by time."""
        self.messages.sort(key=_time)
        first = bisect_left(self.messages, since, key=_time)
        return [message for message in self.messages[first:] if message[1] in ids]

    def losses(self, path: Path, sources: Mapping[int, Source]) -> list[Loss]:
        """Return the losses of the readable sources; empty without a loss."""
        found = self.found()
        lost = sum(max(0, self.promised[id_] - found[id_]) for id_ in sources)
        if not lost and not self.reasons:
            return []
        first = self.reasons[0] if self.reasons else "messages are missing"
        more = f", and {len(self.reasons) - 1} more" if len(self.reasons) > 1 else ""
        return [Loss(str(path), first + more, lost, self.bytes_lost)]


_time = itemgetter(0)
_STEP = 4096


def in_order(
    chunks: Iterable[tuple[int, T]], read: Callable[[T], Iterable[Payload]]
) -> Iterator[Payload]:
    """Sort messages by time; messages of one time keep the order of the file.

    Chunks come by the time of their first message. They may overlap, so a message waits until no
    later chunk can have an earlier one.
    """
    by_start = sorted(enumerate(chunks), key=lambda numbered: numbered[1][0])
    ends = [start for _, (start, _) in by_start[1:]]
    waiting: dict[int, list[Payload]] = {}
    for (number, (_, chunk)), end in zip_longest(by_start, ends):
        waiting[number] = sorted(read(chunk), key=_time)
        ready: list[Payload] = []
        for each in sorted(waiting):
            messages = waiting[each]
            cut = len(messages) if end is None else bisect_left(messages, end, key=_time)
            ready += messages[:cut]
            del messages[:cut]
            if not messages:
                del waiting[each]
        ready.sort(key=_time)
        yield from ready


def plain_type(name: str) -> str:
    """Return a message type in the spelling of ROS 1 or Foxglove."""
    return name.replace("/msg/", "/").replace("foxglove_msgs/", "foxglove.")


def encodings_of(type_: str) -> tuple[str, ...]:
    """Return the encodings in which messages of a type can be read."""
    return ("ros1", "cdr", "protobuf", "json") if type_.startswith("foxglove.") else ("ros1", "cdr")


def is_tf_type(name: str) -> bool:
    """Whether messages of a type, in the spelling of ROS 1 or ROS 2, are transforms."""
    return plain_type(name) in _TF_TYPES


def is_read_type(name: str) -> bool:
    """Whether messages of a type can become transforms."""
    return plain_type(name) in _TF_TYPES | POSE_TYPES | {JOINT_STATE}


def encoding_of(path: Path, topic: str, type_: str, name: str) -> Encoding:
    """Return the store's name of a container's encoding. Refuses encodings without transforms.

    Messages that are read on demand may have another encoding: their reader raises the error.
    """
    if name in ("ros1", "ros1msg"):
        return "ros1"
    if name == "cdr" or not is_tf_type(type_):
        return name  # type: ignore[return-value]  # any word, until it is read
    raise RecordingError(path, f"topic {topic!r} is encoded as {name[:40]!r}, not as cdr or ros1")


@contextmanager
def typed_errors(path: Path, hint: str = SALVAGE) -> Iterator[None]:
    """Convert the exceptions of parsers of damaged data to `RecordingError`.

    Errors of reading get the name of the file. Other exceptions do not change.
    """
    try:
        with errors_name(path):
            yield
    except ModuleNotFoundError as error:
        reason = f"needs {error.name}, which comes with tfdb, but is missing: pip install tfdb"
        raise RecordingError(path, reason) from error
    except (BadDataError, struct.error, UnicodeDecodeError) as error:
        raise RecordingError(path, f"damaged or cut short: {error}; {hint}") from error


def kind_of(path: Path, *, salvage: bool = False) -> Kind:
    """Return the kind of a file by its first bytes, or of a trajectory by its extension.

    `salvage`: if the first bytes are damaged, also of a bag or MCAP file by its extension.

    Raises `RecordingError` for anything that is not a recording, `OSError` where it cannot be
    opened.
    """
    with errors_name(path):
        mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        return "folder"
    if not stat.S_ISREG(mode):
        raise RecordingError(path, "not a regular file")
    with errors_name(path), path.open("rb") as file:
        start = file.read(32)
    if not start:
        raise RecordingError(path, "the file is empty")
    for magic, kind in _MAGICS:
        if start.startswith(magic):
            return kind
    for magic, reason in _OTHERS:
        if start.startswith(magic):
            raise RecordingError(path, reason.format(name=path.name, word=shell_word(path.name)))
    if path.suffix.lower() in TRAJECTORIES:
        return "trajectory"
    if path.suffix.lower() == ".urdf":
        raise RecordingError(
            path,
            "a robot model, not a recording: give it beside a recording with joint states (urdf=, "
            "--urdf), or read it with tfdb.robots.load_urdf",
        )
    by_name = _BINARY.get(path.suffix.lower())
    if salvage and by_name is not None and b"\0" in start:
        return by_name
    raise RecordingError(
        path,
        "neither a ROS 1 bag, nor a ROS 2 database (.db3), nor an MCAP file; the name of a "
        f"trajectory ends in {', '.join(TRAJECTORIES[:-1])} or {TRAJECTORIES[-1]}",
    )


def prefix_of(source: Source) -> str:
    """Return the prefix of a topic's group: `robot1/` for `/robot1/tf`, empty for `/tf`.

    A topic of poses belongs to its namespace.
    """
    return prefix_of_topic(source.topic, transforms=source.holds_transforms)


def prefix_of_topic(name: str, *, transforms: bool) -> str:
    """Return the prefix for the name of a topic, of transforms or of poses."""
    topic = name.strip("/").removesuffix("_static")
    space, _, last = topic.rpartition("/")
    whole = topic if transforms and last != "tf" else space
    return f"{whole}/" if whole else ""
