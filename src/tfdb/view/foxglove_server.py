"""Serves a live store to Foxglove and Lichtblick by their protocol; needs foxglove-sdk."""

from __future__ import annotations

import logging
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import foxglove
import numpy as np
from foxglove.channels import FrameTransformsChannel
from foxglove.messages import FrameTransforms
from foxglove.websocket import ServerListener

from tfdb.data.errors import TfdbError, WaitTimeout
from tfdb.data.types import Columns
from tfdb.viewers.foxglove_writer import frame_transform

if TYPE_CHECKING:
    from collections.abc import Callable

    from foxglove.websocket import ChannelView, Client, WebSocketServer

    from tfdb._core import Buffer, Snapshot

_WAIT = 0.02
"""Seconds for which samples are collected into one message."""
_LOOK = 1.0
"""Seconds between two checks for viewers while the store has no commits."""
_REST = 0.1
"""Seconds between two checks for viewers while the store has commits."""
_LOGGER = logging.getLogger("tfdb.view")


def serve_foxglove(
    store: Buffer, source: str, *, host: str, port: int, ready: Callable[[str], None]
) -> None:
    """Send each committed sample to all viewers, until an error or Ctrl-C.

    `ready` is called with the address. A new viewer first gets the static edges and the newest
    sample of each other edge. Raises OSError if it cannot listen, and the error that ends the
    store.
    """
    context = foxglove.Context()
    sender = _Sender(store, context)
    server = _start(context, sender, source, host, port)
    try:
        shown = f"[{host}]" if ":" in host else host
        ready(f"ws://{shown}:{server.port}")
        while True:
            sender.wait()
            sender.follow()
    finally:
        server.stop()


def _start(
    context: foxglove.Context, sender: _Sender, source: str, host: str, port: int
) -> WebSocketServer:
    try:
        return foxglove.start_server(
            name=f"tfdb: {source}", host=host, port=port, server_listener=sender, context=context
        )
    except RuntimeError as error:
        raise OSError(None, str(error)) from error


class _Sender(ServerListener):
    """Writes edges as messages. Threads: one; the server's threads call `on_subscribe`."""

    def __init__(self, store: Buffer, context: foxglove.Context) -> None:
        self._store = store
        self._moving = FrameTransformsChannel("/tf", context=context)
        self._static = FrameTransformsChannel("/tf_static", context=context)
        self._newest = 0
        """The newest sent stamp; static edges are logged at it."""
        self._lock = threading.Lock()
        self._follows = False
        self._since: int | None = None
        """The commit that the first viewer got; following continues after it."""
        self._came = threading.Event()

    def wait(self) -> None:
        """Wait for a viewer. Raises the error that ends the store."""
        while self._since is None:
            # The removal of a store ends only waits for its commits.
            with suppress(WaitTimeout):
                self._store.wait_for_commit(self._store.commit, _LOOK)
                self._came.wait(_REST)

    def follow(self) -> None:
        """Send each committed sample until the last viewer leaves."""
        with self._lock:
            since, self._since = self._since, None
            self._follows = True
            self._came.clear()
        with self._store.follow(since=since, lapped="skip") as stream:
            for batch in stream.batches(max_wait=_WAIT):
                self.send(batch.stored_static)
                self.send(batch.stored)
                with self._lock:
                    self._follows = self._moving.has_sinks() or self._static.has_sinks()
                    if not self._follows:
                        return

    def send(self, rows: Columns) -> None:
        """Send rows as one message, logged at their newest stamp."""
        if not len(rows.poses):
            return
        channel = self._static if rows.stamps is None else self._moving
        stamps = [self._newest] * len(rows.poses)
        if rows.stamps is not None:
            stamps = np.asarray(rows.stamps, dtype=np.int64).tolist()
            self._newest = max(stamps)
        if not channel.has_sinks():
            return
        made = [*map(frame_transform, stamps, rows.parents, rows.children, rows.poses)]
        channel.log(FrameTransforms(transforms=made), log_time=max(stamps) or None)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Send the stored transforms to a new viewer, which has not received their commits."""
        try:
            with self._lock, self._store.snapshot() as state:
                if not self._follows:
                    self._since = state.commit if self._since is None else self._since
                    self._came.set()
                held = self._held(state, is_static=channel.id == self._static.id())
            self.send(held)
        except TfdbError as error:
            _LOGGER.warning("viewer %s gets no transforms: %s", client.id, error)

    def _held(self, state: Snapshot, *, is_static: bool) -> Columns:
        """Return the static edges of a state, or the newest samples of the others."""
        columns = state.tree_columns()
        wanted = np.flatnonzero(columns.is_static if is_static else columns.newest >= 0)
        poses = state.lookup_edges([columns.names[each] for each in wanted])
        good = np.isfinite(poses).all(axis=1)
        places = wanted[good].tolist()
        self._newest = max(self._newest, int(columns.newest.max(initial=0)))
        return Columns(
            [columns.parents[each] or "" for each in places],
            [columns.names[each] for each in places],
            None if is_static else columns.newest[places],
            poses[good],
        )
