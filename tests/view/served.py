"""A server of the page in a thread, and viewers that speak to it."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Self
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tfdb.view.server import Server

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb.view.model import Model

PATIENCE = 60.0
"""Seconds: longer than any answer takes."""


class Served:
    """A server that runs, and its address."""

    def __init__(self) -> None:
        self.address = ""
        self.error: BaseException | None = None
        self.ended = threading.Event()

    @property
    def base(self) -> str:
        return self.address.partition("?")[0]

    def get(
        self, path: str, method: str = "GET", **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Get a path, with headers in place of its own."""
        request = Request(self.base + path.removeprefix("/"), headers=headers, method=method)
        try:
            with urlopen(request, timeout=PATIENCE) as response:
                return response.status, dict(response.headers), response.read()
        except HTTPError as error:
            with error:
                return error.code, dict(error.headers), error.read()

    def connect(self, path: str = "live", **options: Any) -> Viewer:
        address = self.base.replace("http:", "ws:") + path
        options = {"open_timeout": PATIENCE, "compression": None, "max_size": None, **options}
        return Viewer(address, options)

    def metrics(self) -> dict[str, int]:
        """Return the counts of the server."""
        lines = self.get("/metrics")[2].decode().splitlines()
        return {
            name.removeprefix("tfdb_view_"): int(value)
            for name, value in (line.split() for line in lines if line.startswith("tfdb_view_"))
        }


class Poses:
    """Poses as a viewer reads them."""

    def __init__(self, data: bytes) -> None:
        self.kind, self.topology, self.stamp, count, zero = struct.unpack_from("<IIqII", data)
        assert zero == 0
        assert len(data) == 24 + 32 * count
        self.rows = np.frombuffer(data, "<u4", count, 24).tolist()
        self.poses = np.frombuffer(data, "<f4", 7 * count, 24 + 4 * count).reshape(-1, 7)


class Viewer:
    """A viewer that knows the messages; it connects where it is entered."""

    connection: ClientConnection

    def __init__(self, address: str, options: dict[str, Any]) -> None:
        self._address, self._options = address, options
        self._stack = ExitStack()
        self.tree: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self.connection = self._stack.enter_context(connect(self._address, **self._options))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def receive(self) -> Any:
        """Return the next message: a dict, or poses."""
        message = self.connection.recv(timeout=PATIENCE)
        if isinstance(message, bytes):
            return Poses(message)
        body = json.loads(message)
        if body["type"] == "tree":
            self.tree = body
        return body

    def until(self, matches: Callable[[Any], bool]) -> Any:
        """Return the next message that matches."""
        while True:
            message = self.receive()
            if matches(message):
                return message

    def until_text(self, kind: str) -> Any:
        return self.until(lambda each: isinstance(each, dict) and each["type"] == kind)

    def until_poses(self, matches: Callable[[Poses], bool] = lambda _: True) -> Poses:
        found: Poses = self.until(lambda each: isinstance(each, Poses) and matches(each))
        return found

    def ask(self, kind: str, **fields: Any) -> None:
        self.connection.send(json.dumps({"type": kind, **fields}))

    def pose_of(self, poses: Poses, name: str) -> list[float]:
        """Return the pose of a moving frame."""
        row = self.tree["names"].index(name)
        pose = poses.poses[poses.rows.index(row)].astype(float)
        pose[:3] += self.tree["origins"].get(str(row), [0, 0, 0])
        return pose.tolist()  # type: ignore[no-any-return]


@contextmanager
def serving(model: Model, *, expects_error: bool = False, **options: Any) -> Iterator[Served]:
    """Serve a model in a thread."""
    served, ready = Served(), threading.Event()
    loop = asyncio.new_event_loop()

    def told(address: str) -> None:
        served.address = address
        ready.set()

    def run() -> None:
        task = loop.create_task(Server(model, **options).run(told))
        tasks.append(task)
        try:
            loop.run_until_complete(task)
        except asyncio.CancelledError:
            pass
        except BaseException as error:
            served.error = error
        finally:
            ready.set()
            served.ended.set()

    tasks: list[asyncio.Task[None]] = []
    thread = threading.Thread(target=run)
    thread.start()
    assert ready.wait(PATIENCE)
    try:
        yield served
    except ConnectionClosed:
        if served.error is None or expects_error:
            raise
    finally:
        if not served.ended.is_set():
            loop.call_soon_threadsafe(tasks[0].cancel)
        thread.join(PATIENCE)
        assert not thread.is_alive()
        loop.close()
    if served.error is not None and not expects_error:
        raise served.error
