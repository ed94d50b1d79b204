"""The chain behind tf2's Python calls, whoever answers them and whatever the messages are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import scenario

if TYPE_CHECKING:
    from collections.abc import Callable


def message(kind: type[Any], parent: str, child: str, time: Any, pose: Any) -> Any:
    """A fresh message, as a node makes it."""
    result = kind()
    result.header.stamp, result.header.frame_id, result.child_frame_id = time, parent, child
    t, q = result.transform.translation, result.transform.rotation
    t.x, t.y, t.z, q.x, q.y, q.z, q.w = pose
    return result


class Tf2Calls:
    """Holds one chain; `operations` are the loops that are timed.

    `encode` makes the bytes of a message on /tf; `receive` stores such bytes in a buffer.
    """

    def __init__(
        self,
        empty: Callable[[], Any],
        time: Callable[[int], Any],
        message_kind: type[Any],
        encode: Callable[[list[Any]], bytes],
        receive: Callable[[Any, bytes], object],
    ) -> None:
        self.empty, self.time, self.kind = empty, time, message_kind
        self.encode, self.receive = encode, receive

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        self.buffer = self.empty()
        for i, stamp in enumerate(scenario.samples(samples)):
            for edge in range(chain):
                pose = scenario.moving_pose(edge, 1e-3 * i)
                parent, child = self.names[edge], self.names[edge + 1]
                moved = message(self.kind, parent, child, self.time(stamp), pose)
                self.buffer.set_transform(moved, "bench")
        self.mid = [self.time(stamp) for stamp in scenario.mid_stamps(samples)]
        self.next = scenario.START + samples * scenario.PERIOD
        edges = [*zip(range(chain), self.names, self.names[1:], strict=False)]
        self.messages = [
            self.encode(
                [
                    message(
                        self.kind, parent, child, self.time(stamp), scenario.moving_pose(edge, 0.5)
                    )
                    for edge, parent, child in edges
                ]
            )
            for stamp in scenario.samples(1_024)
        ]
        self.operations = {
            "lookup mid": self.lookup_mid,
            "lookup latest": self.lookup_latest,
            "can_transform": self.can_transform,
            "can_transform, no answer": self.can_transform_never,
            "set_transform": self.set_transform,
            "message of all edges from bytes": self.receive_all,
        }

    def pose(self, stamp: int) -> tuple[float, ...]:
        result = self.buffer.lookup_transform(self.names[0], self.names[-1], self.time(stamp))
        t, q = result.transform.translation, result.transform.rotation
        return (t.x, t.y, t.z, q.x, q.y, q.z, q.w)

    def lookup_mid(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                lookup(target, source, stamp)

    def lookup_latest(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        latest = self.time(0)
        for _ in range(count):
            lookup(target, source, latest)

    def can_transform(self, count: int) -> None:
        can, target, source = self.buffer.can_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                can(target, source, stamp)

    def can_transform_never(self, count: int) -> None:
        can, target, source = self.buffer.can_transform, self.names[0], self.names[-1]
        never = self.time(self.next + 10**15)
        for _ in range(count):
            can(target, source, never)

    def set_transform(self, count: int) -> None:
        store, parent, child = self.buffer.set_transform, self.names[0], self.names[1]
        pose = scenario.moving_pose(0, 0.5)
        for _ in range(count):
            store(message(self.kind, parent, child, self.time(self.next), pose), "bench")
            self.next += scenario.PERIOD

    def receive_all(self, count: int) -> None:
        for _ in range(count // len(self.messages)):
            buffer, receive = self.empty(), self.receive  # stamps of one buffer only grow
            for data in self.messages:
                receive(buffer, data)
