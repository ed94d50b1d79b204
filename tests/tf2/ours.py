"""The same operations as tf2_child.py's, on tfdb.tf2."""

from __future__ import annotations

import logging
from typing import Any

from tfdb import tf2
from tfdb.tf2 import msgs


class Records(logging.Handler):
    """What `tfdb.tf2` logged."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.errors: list[Any] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())
        self.errors.append(record.__dict__["error"])


def message(parent: str, child: str, stamp: int, pose: Any) -> msgs.TransformStamped:
    x, y, z, *rotation = (float(value) for value in pose)
    return msgs.TransformStamped(
        msgs.Header(msgs.Time.from_nanoseconds(stamp), parent),
        child,
        msgs.Transform(msgs.Vector3(x, y, z), msgs.Quaternion(*rotation)),
    )


def plain(found: Any) -> list[Any]:
    move, turn = found.transform.translation, found.transform.rotation
    pose = [move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w]
    return [found.header.frame_id, found.child_frame_id, found.header.stamp.nanoseconds, pose]


class Ours:
    """A BufferCore of ours; each operation answers as that of the child does."""

    def __init__(self, flavor: tf2.times.Flavor, records: Records) -> None:
        self.flavor, self.records = flavor, records
        self.core = tf2.BufferCore(flavor=flavor)

    def answer(self, operation: list[Any]) -> tuple[str, Any]:
        verb, *arguments = operation
        try:
            return "ok", getattr(self, verb)(*arguments)
        except tf2.TransformException as error:
            return type(error).__name__, str(error)

    def new(self, cache_time: int) -> None:
        length = msgs.Duration.from_nanoseconds(cache_time)
        self.core = tf2.BufferCore(length, flavor=self.flavor)

    def set(
        self, static: bool, parent: str, child: str, stamp: int, pose: Any, authority: str
    ) -> str:
        write = self.core.set_transform_static if static else self.core.set_transform
        before = len(self.records.texts)
        commit = self.core.buffer.commit
        write(message(parent, child, stamp, pose), authority)
        logged = "\n".join(self.records.texts[before:])
        assert (self.core.buffer.commit > commit) == (not logged)
        return logged

    def get(self, target: str, source: str, stamp: int) -> list[Any]:
        time = msgs.Time.from_nanoseconds(stamp)
        return plain(self.core.lookup_transform_core(target, source, time))

    def full(
        self, target: str, target_stamp: int, source: str, source_stamp: int, fixed: str
    ) -> list[Any]:
        return plain(
            self.core.lookup_transform_full_core(target, target_stamp, source, source_stamp, fixed)
        )

    def can(self, target: str, source: str, stamp: int) -> list[Any]:
        return list(self.core.can_transform_core(target, source, stamp))

    def canfull(
        self, target: str, target_stamp: int, source: str, source_stamp: int, fixed: str
    ) -> list[Any]:
        return list(
            self.core.can_transform_full_core(target, target_stamp, source, source_stamp, fixed)
        )

    def latest(self, target: str, source: str) -> int:
        found: int = self.core.get_latest_common_time(target, source).nanoseconds
        return found

    def clear(self) -> None:
        self.core.clear()

    def chain(
        self, target: str, target_stamp: int, source: str, source_stamp: int, fixed: str
    ) -> list[str]:
        return self.core._chain(target, target_stamp, source, source_stamp, fixed)

    def exists(self, name: str) -> bool:
        return self.core._frameExists(name)

    def frames(self) -> list[str]:
        return self.core._getFrameStrings()

    def yaml(self) -> str:
        return self.core.all_frames_as_yaml()

    def string(self) -> str:
        return self.core.all_frames_as_string()

    def dot(self, *stamp: int) -> str:
        return self.core._allFramesAsDot(*stamp)
