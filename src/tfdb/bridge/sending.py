"""Commits of a store as messages on /tf and /tf_static."""

from __future__ import annotations

import logging
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

# Imported at the start: after Ctrl-C during an import in the main thread, an import in another
# thread would hang.
import numpy as np  # noqa: TID253

from tfdb._core import encode_tf_message
from tfdb.data.errors import FeedLapped, SnapshotTooOld, TfdbError, WatchClosed
from tfdb.data.types import Columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb._core import Buffer, Snapshot
    from tfdb.data.types import Changes
    from tfdb.ros import DdsNode, Publisher, TcprosNode, ZenohNode

__all__ = ["BridgeStats", "CommitSender"]

LOGGER = logging.getLogger("tfdb.bridge")
KIND = "tf2_msgs/TFMessage"
_AT_ONCE = 256
"""Largest number of commits that are read at once."""
_LOOK = 1.0
"""Seconds between two checks of an idle store, after which the held snapshot is renewed."""


class BridgeStats(NamedTuple):
    """Counts of a bridge."""

    received: int
    """Messages from the graph, without the bridge's own."""
    sent: int
    """Messages sent on /tf, one for each commit."""
    sent_static: int
    """Messages sent on /tf_static. Each has all static transforms."""
    refused: int
    """Transforms with stamps that ROS messages cannot express."""
    missed: int
    """Commits that left the feed before they were read, including those from the graph."""
    gone: int
    """Samples that left the store before they were read."""


class CommitSender:
    """Sends commits to a graph, but not those with an authority below `origin`.

    One thread runs it; any thread may read the counts and call `end`.
    """

    def __init__(self, buffer: Buffer, node: ZenohNode | DdsNode | TcprosNode, origin: str) -> None:
        self._buffer, self._encoding = buffer, node.encoding
        self._prefix = f"{origin}/"
        self.sent: int = 0
        self.sent_static: int = 0
        self.refused: int = 0
        self.missed: int = 0
        self.gone: int = 0
        none = Columns([], [], None, np.empty((0, 7)))  # imports the modules for `run`, see above
        self._statics: bytes = encode_tf_message(none, node.encoding)
        self._children: frozenset[str] = frozenset()
        self._is_due, self._is_forced = True, False
        self._ending = False
        self._told: set[str] = set()
        self._topics: list[Publisher] = []
        self._watch = buffer.watch((), every=True)
        self._held = buffer.snapshot()
        try:
            self._watch.next(self._held.commit, 0)  # it reports commits from its first call on
            self._position = self._held.commit
            self._topics.append(node.advertise("/tf", KIND, depth=100))
            self._topics.append(node.advertise("/tf_static", KIND, latched=True, depth=1))
            self._senders = node.senders
        except BaseException:
            self.close()
            raise

    def run(self) -> None:
        """Send until `end` is called, then send the commits made before."""
        is_last = False
        while not is_last:
            is_last = self._ending
            self._send_to(self._buffer.snapshot())
            if not is_last:
                with suppress(FeedLapped, WatchClosed):  # the next read continues from there
                    self._watch.next(self._position, _LOOK, limit=1)

    def end(self) -> None:
        """Let `run` return."""
        self._ending = True
        self._watch.close()

    def close(self) -> None:
        """Release the held snapshot."""
        self._watch.close()
        self._held.close()
        for topic in self._topics:
            topic.close()

    def _send_to(self, taken: Snapshot) -> None:
        """Send the commits up to that of a snapshot, and hold it instead of the previous one.

        If they have left the feed meanwhile, hold a later snapshot.
        """
        last = taken.commit  # a faster writer must not delay the end
        while self._position < last:
            limit = min(last - self._position, _AT_ONCE)
            try:
                records = self._buffer.changes(self._position, limit)
            except FeedLapped as error:
                self._skip(error)
                taken.close()
                taken = self._buffer.snapshot()
                continue
            for record in records:
                self._send(record)
            self._position = records[-1].commit
        if self._is_due:
            with suppress(SnapshotTooOld):  # then from a later one
                self._send_statics(taken)
        self._held.close()
        self._held = taken

    def _skip(self, error: FeedLapped) -> None:
        """Continue after the commits that left the feed; send all static transforms."""
        next_one = self._position if error.commit is None else error.commit
        lost = next_one - self._position
        if not self.missed:
            LOGGER.warning(
                "%d commits were not sent: they came faster than the bridge read them", lost
            )
        self.missed += lost
        self._position = next_one
        self._is_due = self._is_forced = True

    def _send(self, record: Changes) -> None:
        """Send the moving samples of a commit; note whether static transforms may differ."""
        self.gone += sum(record.gone.values())
        moving = len(record.stored)
        own = self._own(record.authorities[:moving])
        if own:
            chosen = record.stored if len(own) == moving else _rows(record.stored, own)
            if (data := self._encoded(chosen)) is not None:
                self._topics[0].publish(data)
                self.sent += 1
        self._is_forced |= bool(self._own(record.authorities[moving:]))
        self._is_due |= bool(
            len(record.stored_static)
            or record.removed
            or record.cleared
            or record.moved
            or not self._children.isdisjoint(record.stored.children)
        )

    def _own(self, authorities: Sequence[str]) -> list[int]:
        """Return the indices of the authorities that are not from the graph.

        This also skips messages of this sender that another listener has stored.
        """
        return [
            i
            for i, name in enumerate(authorities)
            if not name.startswith(self._prefix) and name not in self._senders
        ]

    def _send_statics(self, state: Snapshot) -> None:
        """Send all static transforms in one message, if they differ or were stored again."""
        tree = state.tree_columns()
        own = [
            i
            for i, name in enumerate(tree.authorities)
            if tree.is_static[i] and not name.startswith(self._prefix)
        ]
        names = [tree.names[i] for i in own]
        poses = state.lookup_edges(names)
        edges = Columns([tree.parents[i] or "" for i in own], names, None, poses)
        has_pose = ~np.isnan(poses[:, 0])
        if not has_pose.all():  # a frame was cleared
            edges = _rows(edges, np.flatnonzero(has_pose).tolist())
        data = self._encoded(edges)
        if data is not None and (data != self._statics or (self._is_forced and len(edges))):
            self._topics[1].publish(data)
            self.sent_static += 1
            self._statics, self._children = data, frozenset(edges.children)
        self._is_due = self._is_forced = False

    def _encoded(self, edges: Columns) -> bytes | None:
        """Encode a message without transforms that ROS cannot express; None: no others remain."""
        try:
            return encode_tf_message(edges, self._encoding)
        except TfdbError:
            good = [i for i in range(len(edges)) if self._is_sendable(_rows(edges, [i]))]
            return encode_tf_message(_rows(edges, good), self._encoding) if good else None

    def _is_sendable(self, edge: Columns) -> bool:
        try:
            encode_tf_message(edge, self._encoding)
        except TfdbError as error:
            self.refused += 1
            (child,) = edge.children
            if child not in self._told and len(self._told) < 1000:
                self._told.add(child)
                LOGGER.warning("a transform of %s was not sent: %s", child, error)
            return False
        return True


def _rows(edges: Columns, rows: list[int]) -> Columns:
    """Some rows of a batch."""
    stamps = edges.stamps
    return Columns(
        [edges.parents[i] for i in rows],
        [edges.children[i] for i in rows],
        None if stamps is None else [stamps[i] for i in rows],  # type: ignore[index]
        edges.poses[rows],
    )
